"""What a newcomer passes by mistake is answered in a sentence, by every public function and constructor."""

import importlib
import inspect
import pickle
import subprocess
import sys
import types
import typing
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args, get_origin

import numpy as np
import pandas as pd
import pytest
from beartype.roar import BeartypeCallHintViolation
from hypothesis import given
from hypothesis import strategies as some
from jaxtyping import Complex, Float, Int

import acquisition
from ema import archive, compare, data, estimate, examples, fit, interop, place, shapes, show, simulate, store
from ema.arguments import checked, hint_of
from ema.dof import Dof
from ema.errors import EmaError, InputError
from ema.show.frf import frf_overview as overview_where_it_is_defined
from tests.containers import Draw

PACKAGES = (
    *("ema.data", "ema.shapes", "ema.interop", "ema.archive", "ema.store"),
    *("ema.estimate", "ema.fit", "ema.simulate", "ema.show", "ema.proposal", "ema.datasets", "acquisition"),
    *("ema.compare", "ema.place", "ema.report", "ema.study"),
)
WRONG: dict[str, Any] = {
    "path as text": "modes.h5",
    "path": Path("modes.h5"),
    "list": [1.0, 2.0],
    "table": pd.DataFrame({"a": [1.0]}),
    "quantity": "5 Hz",
    "number as text": "5",
    "nothing": None,
    "integers": [1, 2],
    "complex number": 1 + 2j,
    "complex array": 1j * np.ones((2, 2)),
    "vector": np.ones(3),
    "number": 3.0,
    "FRFs": examples.frf_set(),
    "modes": examples.modal_model(),
}
"""What is plausible for somebody else's library."""
GIVEN = {
    type(one): one for one in (examples.modal_model(), examples.frf_set(), examples.geometry(), examples.modal_map())
}
NOT_CALLED = {
    ("ema.data", "Source"),  # a protocol
    ("ema.shapes", "with_body_uncertainty"),  # needs a surface with a constant term
    ("ema.show", "renderer_works"),  # kept by functools.cache, which makes no function of it
    *(("acquisition", module) for module in ("campaign_file", "columns", "model_file", "quantities", "rig_file")),
}
NOT_SEEN = ("progress",)
"""A protocol: what it asks for is seen when the work advances."""
LEFT = {
    ("acquisition", "record", "source"),  # what a protocol asks for is seen when records are taken
    ("ema.estimate", "level_bins", "tolerance"),  # is no share above 1
}
"""Parameters of which a wrong value still ends in an error of Python."""
EXPENSIVE = {("ema.compare", "amplitude_draws"), ("ema.compare", "predict_amplitudes"), ("ema.show", "rendered_shape")}
"""Functions that are called with one argument alone, since with the others they would run."""


def public() -> list[tuple[str, str]]:
    names = (Path(__file__).parents[1] / "architecture" / "public_names.txt").read_text(encoding="utf-8").split()
    pairs = [(package, name) for package, _, name in (full.rpartition(".") for full in names) if package in PACKAGES]
    return [pair for pair in pairs if pair not in NOT_CALLED]


def right(hint: Any, name: str) -> Any:
    """A value of the declared type."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return right(next(one for one in arguments if one is not type(None)), name)
    if origin in (list, Sequence):
        return [right(arguments[0], name)]
    if hint is str or hint is Path:
        return "absent.h5"
    return GIVEN[hint] if hint in GIVEN else Draw().value(hint, name)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(("package", "name"), public())
def test_no_wrong_argument_ends_in_an_error_of_python(
    package: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    target = getattr(importlib.import_module(package), name)
    parameters = inspect.signature(target).parameters
    hints = {}
    for key, parameter in parameters.items():
        if parameter.kind not in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
            hints[key] = parameter.annotation
    base = {}
    for key, hint in hints.items():
        if parameters[key].default is inspect.Parameter.empty and (package, name) not in EXPENSIVE:
            try:
                base[key] = right(hint, key)
            except (AssertionError, StopIteration, AttributeError, TypeError, InputError):  # any object, a text of ours
                base[key] = None
    for key in hints:
        if key in NOT_SEEN or (package, name, key) in LEFT:
            continue
        for what, value in WRONG.items():
            try:
                target(**base | {key: value})
            except (EmaError, BeartypeCallHintViolation):
                pass
            except TypeError as error:
                if (package, name) not in EXPENSIVE or "required positional argument" not in str(error):
                    pytest.fail(f"{name}({key}={what}): {error}")
            except Exception as error:
                pytest.fail(f"{name}({key}={what}): {type(error).__name__}: {error}")


def test_a_path_in_place_of_an_object_says_how_to_read_it() -> None:
    with pytest.raises(InputError) as refused:
        shapes.compare("modes.h5", examples.modal_model())  # type: ignore[arg-type]
    assert str(refused.value) == (
        "ema.shapes.compare, a: not what this argument takes; got 'modes.h5', expected ModalModel; "
        "ema.fit.modes gives one; read a stored one by ema.store.load(file)"
    )
    with pytest.raises(InputError, match="got None, expected a text or a path"):
        store.load(None)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="got 'beam', expected a sequence of Source"):
        archive.add("here", "beam")  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"got a FrfSet, expected Geometry; read one by acquisition\.read"):
        shapes.align(examples.frf_set(), examples.geometry())  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"to_sdypy, frfs: .*; got a ModalModel, expected FrfSet"):
        interop.to_sdypy(examples.modal_model())  # type: ignore[arg-type]


@given(some.floats(-1e6, 1e6), some.sampled_from(["Hz", "N", "m/s", ""]), some.sampled_from(["", " "]))
def test_a_text_in_place_of_a_number_is_answered_with_the_number(value: float, unit: str, space: str) -> None:
    text = f"{value!r}{space}{unit}"
    with pytest.raises(InputError) as refused:
        data.Excitation("hammer", level=text)  # type: ignore[arg-type]
    assert refused.value.where == "Excitation.level" and refused.value.expected == "a number"
    assert refused.value.got == repr(text)
    assert float(refused.value.advice.removeprefix("write the number alone, in SI units: ")) == value


@pytest.mark.parametrize("text", ["2 %", "20 g", "5 kN", "10mm"])
def test_a_number_in_another_unit_is_not_repeated_as_one_in_si(text: str) -> None:
    with pytest.raises(InputError) as refused:
        data.Excitation("hammer", level=text)  # type: ignore[arg-type]
    assert refused.value.advice == "write the number alone, in SI units"


def test_complex_numbers_are_not_made_real_in_silence() -> None:
    frfs = examples.frf_set()
    with pytest.raises(InputError, match=r"FrfSet\.frequencies: complex numbers where real ones are expected"):
        data.FrfSet(frfs.frequencies + 0j, frfs.values, frfs.outputs, frfs.inputs, "accelerance")


def test_numbers_of_nodes_in_place_of_dofs_say_how_dofs_are_written() -> None:
    frfs = examples.frf_set()
    with pytest.raises(InputError, match=r'expected a sequence of Dof; write Dof\(1, "\+Z"\) or Dof\.parse'):
        data.FrfSet(frfs.frequencies, frfs.values, [1, 2, 3, 4], frfs.inputs, "accelerance")  # type: ignore[arg-type]


def test_a_choice_is_one_of_its_words() -> None:
    with pytest.raises(InputError, match=r"Excitation.kind: .*; got 'hamer', expected one of 'hammer', 'sweep'"):
        data.Excitation("hamer")  # type: ignore[arg-type]


def test_lists_become_arrays_and_tuples() -> None:
    decay = data.Decay([0, 1], [2, 1], [40, 41], [0.02, 0.01])  # type: ignore[arg-type]
    assert decay.times.dtype == float and decay.frequencies.tolist() == [40, 41]
    condition = data.Condition(joints=[data.JointForce("left")])  # type: ignore[arg-type]
    assert condition.joints == (data.JointForce("left"),)
    assert np.allclose(shapes.mac([[1, 1], [1, -1]], [[1], [1]]), [[1], [0]])  # type: ignore[arg-type]
    column = pd.Series([40.0, 41.0])
    assert data.Decay([0, 1], [2, 1], column, [0.02, 0.01]).frequencies.tolist() == [40, 41]  # type: ignore[arg-type]


def test_arrays_of_functions_have_the_axes_of_their_names() -> None:
    with pytest.raises(InputError, match=r"mac, a: .*wrong number of axes; got an array of shape \(3,\), float64"):
        shapes.mac(np.ones(3), np.ones((3, 1)))

    def scaled(a: Float[np.ndarray, "mode 2"], b: Complex[np.ndarray, "mode"], n: Int[np.ndarray, "k"]) -> float:
        return float(len(a) + len(b) + len(n))

    call = checked(scaled, "here")
    assert call(np.ones((3, 2)), np.ones(3), [1.0, 2.0]) == 8  # whole numbers are integers
    with pytest.raises(
        InputError, match=r"here.scaled, b: arrays and axes disagree; got 4 along mode, expected 3, as in a"
    ):
        call(np.ones((3, 2)), np.ones(4), np.ones(1))
    with pytest.raises(InputError, match=r"here.scaled, a: arrays and axes disagree; got 3 along 2, expected 2"):
        call(np.ones((3, 3)), np.ones(3), [1])
    with pytest.raises(InputError, match=r"here.scaled, n: .*got \[1.5\] \(list\), expected an array of integers"):
        call(np.ones((3, 2)), np.ones(3), [1.5])


def test_modes_that_a_model_does_not_have_are_not_combined() -> None:
    model = examples.modal_model()
    for modes in ([7], [-1], []):
        with pytest.raises(InputError, match=r"no positions of modes of the model; .*expected one or more of 0 to 2"):
            shapes.expand_by_modes(model, model, modes)


def test_a_missing_argument_stays_an_error_of_the_call() -> None:
    with pytest.raises(TypeError, match="missing 1 required positional argument: 'b'"):
        shapes.mac(np.ones((2, 1)))  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="unexpected keyword argument 'levels'"):
        data.Excitation(levels=5.0)  # type: ignore[call-arg]


def test_public_functions_are_found_again_in_another_process() -> None:
    named = [shapes.mac, store.load, archive.find, interop.to_xarray, fit.modes, compare.update, show.frf_overview]
    for function in [*named, simulate.damping_map, place.rank, estimate.hammer, overview_where_it_is_defined]:
        assert pickle.loads(pickle.dumps(function)) is function


def test_what_says_nothing_of_values_is_not_compared() -> None:
    assert hint_of(Any) is None and hint_of(object) is None and hint_of(float | Any) is None
    assert hint_of(tuple[Dof, ...] | None).expected == "a sequence of Dof or None"  # type: ignore[union-attr]


def test_classes_stay_what_they_are() -> None:
    """Their constructors are exchanged; equality, copies, subclasses and other processes know nothing of it."""

    class Bar(simulate.Section):
        """A section of a user."""

    for kind in (simulate.Section, Bar):
        section = kind(0.5, 0.04, height=0.005)
        assert section == kind(length=0.5, width=0.04, height=0.005)
        assert replace(section, length=1).length == 1
        with pytest.raises(InputError, match=r"Section\.width: .*got '40 mm', expected a number"):
            kind(0.5, "40 mm", 0.005)  # type: ignore[arg-type]
        with pytest.raises(InputError, match=r"Section\.length: .*got None"):
            replace(section, length=None)  # type: ignore[arg-type]
    section = simulate.Section(0.5, 0.04, 0.005)
    assert pickle.loads(pickle.dumps(section)) == section
    assert simulate.Masing(0.4, 1e7) == simulate.Masing(friction_coefficient=0.4, contact_stiffness=1e7)


def test_named_tuples_are_guarded_and_stay_tuples() -> None:
    costs = place.Costs(2.0, loop=3)
    assert costs == (2.0, 0.25, 3, 5e-4, 0.03, 0.05) and costs._replace(loop=1.0).loop == 1.0
    assert pickle.loads(pickle.dumps(costs)) == costs and place.Costs._make(costs) == costs
    with pytest.raises(InputError, match=r"ema\.place\.Costs, mounting: .*got '1 h', expected a number"):
        place.Costs(mounting="1 h")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="unexpected keyword argument 'mount'"):
        place.Costs(mount=1.0)  # type: ignore[call-arg]


def test_importing_a_package_builds_no_checks() -> None:
    """In a process of its own: the checks, and numpy with them, come with the first name that is used."""
    packages = "ema.compare, ema.estimate, ema.fit, ema.place, ema.show, ema.simulate, ema.study, acquisition"
    code = f"import sys, {packages}; print('numpy' in sys.modules, 'ema.arguments' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]


def test_modules_of_the_project_take_functions_from_where_they_are_defined() -> None:
    from ema.simulate.maps import damping_map

    public: Any = simulate.damping_map
    assert public is not damping_map and public.__wrapped__ is damping_map


MISTAKES: list[tuple[Callable[..., Any], tuple[Any, ...], str]] = [
    (fit.modes, ("beam.uff",), r"ema\.fit\.modes, frfs: .*expected FrfSet; read one by acquisition\.read"),
    (fit.track, (examples.frf_set(),), "got a FrfSet, expected a sequence of FrfSet"),
    (fit.local_fit, (examples.frf_set(), "55 Hz"), "expected a number; write the number alone, in SI units: 55"),
    (compare.modes, (examples.frf_set(), examples.modal_model()), "got a FrfSet, expected ModalModel"),
    (compare.update, ("beam.toml", examples.modal_map()), "expected BeamModel; open one by acquisition"),
    (compare.repeats, ([examples.modal_model()], "a", "b"), "got 'b', expected a sequence of a text"),
    (simulate.resonances, (examples.modal_model(), 5.0), "got a ModalModel, expected BeamModel"),
    (simulate.Section, ("1 m", 0.04, 0.005), r"Section\.length: .*got '1 m', expected a number"),
    (place.rank, (examples.modal_model(), None), "got a ModalModel, expected Task"),
    (acquisition.open_rig, (["rig.toml"],), r"got \['rig.toml'\] \(list\), expected a text, a path or RigFile"),
    (acquisition.read, (["a.uff", "b.uff"],), r"got \['a.uff', 'b.uff'\] \(list\), expected a text or a path"),
    (estimate.control_level, ("rig", 5.0), "measure: .*got 'rig', expected a function"),
    (acquisition.open_campaign, (examples.frf_set(),), "got a FrfSet, expected a text or a path"),
    (show.mac_matrix, (examples.modal_model(),), "got a ModalModel, expected an array of real numbers"),
]


@pytest.mark.parametrize(("function", "arguments", "said"), MISTAKES)
def test_typical_mistakes_are_answered_in_a_sentence(
    function: Callable[..., Any], arguments: tuple[Any, ...], said: str
) -> None:
    with pytest.raises(InputError, match=said):
        function(*arguments)
