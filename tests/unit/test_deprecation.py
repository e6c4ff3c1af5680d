"""Calls as they were one release ago still do what they did, with a warning."""

import ast
from pathlib import Path

import numpy as np
import pytest
from beartype.roar import BeartypeCallHintViolation

import ema.estimate
import ema.place
import ema.simulate
from ema.elements import Plate, Section, beam, double_beam, plate_matrices
from ema.errors import InputError
from ema.estimate import HammerSettings, hammer
from ema.examples import campaign
from ema.simulate import Masing


def same(one, other):
    return np.array_equal(one.mass, other.mass) and np.array_equal(one.stiffness, other.stiffness)


def test_sections_and_plates_by_their_dimensions():
    with pytest.warns(DeprecationWarning, match=r"beam takes section=Section\(length=0.5"):
        former = beam(0.5, 0.04, 0.005, elements=4, clamped=(True, True))
    assert same(former, beam(Section(0.5, 0.04, 0.005, elements=4), clamped=(True, True)))
    with pytest.warns(DeprecationWarning):
        former = beam(0.5, 0.04, 0.005, 70e9, 2700.0, 4, (True, True), "host")
    assert same(former, beam(Section(0.5, 0.04, 0.005, 70e9, 2700.0, 4), (True, True), "host"))
    with pytest.warns(DeprecationWarning):
        former = plate_matrices(0.3, 0.2, 0.004, elements=(3, 2), clamped=False)
    assert same(former, plate_matrices(Plate(0.3, 0.2, 0.004, elements=(3, 2)), clamped=False))


def test_double_beams_by_dimensions_of_which_others_are_the_usual_ones():
    law = Masing(0.3, 1e12)
    with pytest.warns(DeprecationWarning):
        former = double_beam(law, 100.0, elements=4, normal_stiffness=1e8)
    now = double_beam(law, 100.0, Section(0.5, 0.04, 0.005, elements=4), normal_stiffness=1e8)
    assert same(former.host, now.host) and former.joints[0].normal_stiffness == now.joints[0].normal_stiffness


def test_settings_of_a_hammer_test_by_name():
    with pytest.warns(DeprecationWarning, match=r"HammerSettings\(estimator='H2', decay=2.0\)"):
        run = campaign()["bare"]
        former = hammer(run, "H2", decay=2.0)
    assert np.array_equal(former.values, hammer(run, HammerSettings("H2", decay=2.0)).values)


def test_what_is_no_setting_is_answered_in_a_sentence():
    with pytest.raises(InputError, match=r"ema.estimate.hammer, settings: .*expected HammerSettings"):
        hammer(campaign()["bare"], settings=5)
    with pytest.warns(DeprecationWarning), pytest.raises(InputError, match="run: not what this argument takes"):
        hammer("bare", "H2")


def test_what_is_no_argument_at_all_is_said_as_by_any_function():
    with pytest.raises(TypeError, match="lenght"):
        beam(Section(0.5, 0.04, 0.005), lenght=0.5)


def test_public_functions_that_take_former_arguments_put_them_together_before_they_are_compared():
    """Functions decorated in the sources, against those that their packages name; it had been forgotten for ``hammer``."""
    decorated = {
        node.name
        for path in Path(ema.__path__[0]).rglob("*.py")
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.FunctionDef)
        and any("fields_as_arguments" in ast.unparse(one) for one in node.decorator_list)
    }
    packages = {
        ema.simulate: {"beam", "double_beam", "plate_matrices"},
        ema.estimate: {"hammer", "hammer_test"},
        ema.place: {"forecast", "search"},
    }
    for package, names in packages.items():
        assert names == decorated & set(dir(package))
        for name in names:
            # Put together first, these are no fields of the settings; compared first, they are no arguments.
            with pytest.raises((InputError, TypeError, BeartypeCallHintViolation)) as refused:
                getattr(package, name)(*["no setting"] * 4)
            assert not str(refused.value).startswith(f"{package.__name__}.{name}, ")
