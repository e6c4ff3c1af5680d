"""From and to the arrays and tables of other programs."""

import subprocess
import sys

import numpy as np
import pytest

from ema.data import Channel, FrfSet, LawParameter, ModalModel, Recording, poles_from
from ema.dof import Dof
from ema.errors import InputError
from ema.shapes import compare, mac

FREQUENCIES = np.linspace(1.0, 100.0, 7)
VALUES = np.random.default_rng(5).standard_normal((7, 3, 2)) * (1 + 2j)


def frfs(values: np.ndarray = VALUES, **changes: object) -> FrfSet:
    given: dict = {"outputs": ["1:+Z", "2:-X", Dof(3)], "inputs": ["1:+Z", "7:+Y"], "quantity": "mobility"} | changes
    return FrfSet.from_arrays(FREQUENCIES, values, **given)


def test_frfs_from_arrays_are_those_of_the_constructor() -> None:
    made = frfs()
    assert made.outputs == (Dof(1, "+Z"), Dof(2, "-X"), Dof(3)) and made.inputs == (Dof(1, "+Z"), Dof(7, "+Y"))
    assert (made.quantity, made.unit) == ("mobility", "(m/s)/N")
    np.testing.assert_array_equal(made.values, VALUES)
    one = frfs(VALUES[:, 0, 0], outputs=["1:+Z"], inputs=["1:+Z"])
    column = frfs(VALUES[:, :, 0], inputs=["1:+Z"])
    np.testing.assert_array_equal(one.values[:, 0, 0], VALUES[:, 0, 0])
    np.testing.assert_array_equal(column.values[:, :, 0], VALUES[:, :, 0])


@pytest.mark.parametrize(
    ("values", "changes", "message"),
    [
        (VALUES.transpose(1, 2, 0), {}, r"values of shape \(3, 2, 7\), expected \(freq, out, in\) = \(7, 3, 2\)"),
        (VALUES[:, :1], {}, "the FRFs and their axes disagree"),
        (VALUES, {"quantity": "inertance"}, "unknown kind of FRF; got 'inertance', expected receptance"),
        (VALUES, {"inputs": ["1:+Z", "7:+Q"]}, "unknown direction of a DOF|not a DOF"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(values: np.ndarray, changes: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        frfs(values, **changes)


def test_frequencies_have_to_increase() -> None:
    with pytest.raises(InputError, match="not increasing"):
        FrfSet.from_arrays(FREQUENCIES[::-1], VALUES[:, 0, 0], outputs=["1"], inputs=["1"], quantity="mobility")


def test_frfs_as_a_table() -> None:
    table = frfs().to_dataframe()
    assert list(table.columns)[:3] == ["1:+Z/1:+Z", "1:+Z/7:+Y", "2:-X/1:+Z"] and table.shape == (7, 6)
    assert table.index.name == "frequency [Hz]" and table.attrs == {"quantity": "mobility", "unit": "(m/s)/N"}
    np.testing.assert_array_equal(table["2:-X/7:+Y"], VALUES[:, 1, 1])


def test_a_record_from_arrays_and_as_a_table() -> None:
    signals = np.arange(8.0).reshape(2, 4)
    made = Recording.from_arrays(signals, 4, channels=[Channel("hammer", quantity="force", unit="N"), "acc"])
    assert [channel.unit for channel in made.channels] == ["N", "unstated"] and made.duration == 1.0
    table = made.to_dataframe()
    assert list(table.columns) == ["hammer [N]", "acc [unstated]"] and list(table.index) == [0, 0.25, 0.5, 0.75]
    assert list(table["acc [unstated]"]) == [4.0, 5.0, 6.0, 7.0]
    with pytest.raises(InputError, match=r"shape \(4, 2\) for 2 channels, expected \(channel, sample\); turn it by"):
        Recording.from_arrays(signals.T, 4, channels=["a", "b"])
    with pytest.raises(InputError, match="not a sampling rate; got 0 Hz"):
        Recording.from_arrays(signals, 0.0, channels=["a", "b"])


def model(dofs: tuple[Dof, ...], shapes: np.ndarray) -> ModalModel:
    poles = poles_from(np.arange(1.0, 1 + shapes.shape[1]), np.full(shapes.shape[1], 0.01))
    return ModalModel(poles, shapes.astype(complex), dofs, shapes[:1].astype(complex), dofs[:1])


def test_mac_of_two_models_takes_common_dofs_and_turns_opposite_senses() -> None:
    """By the definition, |a^H b|^2 / (a^H a b^H b), on the three points that both have."""
    shapes = np.random.default_rng(6).standard_normal((4, 2))
    first = model((Dof(1, "+Z"), Dof(2, "+Z"), Dof(3, "+X"), Dof(9, "+Z")), shapes)
    other = np.random.default_rng(7).standard_normal((4, 3))
    second = model((Dof(3, "-X"), Dof(5, "+Z"), Dof(1, "+Z"), Dof(2, "-Z")), other)
    a, b = shapes[:3], np.stack([other[2], -other[3], -other[0]])
    expected = np.abs(a.T @ b) ** 2 / np.outer(np.sum(a**2, axis=0), np.sum(b**2, axis=0))
    np.testing.assert_allclose(mac(first, second), expected, rtol=1e-12)
    np.testing.assert_array_equal(mac(first, second), compare(first, second).mac)
    with pytest.raises(InputError, match="no DOF in common"):
        mac(first, model((Dof(77),), np.ones((1, 1))))
    with pytest.raises(InputError, match="one is a modal model and the other is not"):
        mac(first, other)


WRONG = """
import numpy as np
from ema.data import Candidates, Channel, FrfSet, Geometry, Matrices, ModalMap, Recording
from ema.dof import Dof
from ema.errors import InputError

ONE = (Dof(1, "+Z"),)
for make in (
    lambda: FrfSet(np.arange(4.0), np.zeros((3, 1, 1)), ONE, ONE, "receptance"),
    lambda: FrfSet(np.arange(4.0), np.zeros((4, 1, 1)), ONE, ONE, "receptance", coherence=np.zeros((4, 2, 1))),
    lambda: FrfSet(np.arange(4.0), np.zeros(4), ONE, ONE, "receptance"),
    lambda: Recording(np.zeros((2, 8)), 10.0, (Channel("a"), Channel("b")), overloads=np.zeros(3, bool)),
    lambda: Geometry(np.arange(3), np.zeros((2, 3))),
    lambda: Geometry(np.arange(3), np.zeros((3, 2))),
    lambda: ModalMap(np.ones(2), np.ones(3), np.ones((3, 2)), np.ones((2, 3))),
    lambda: Matrices(np.eye(2), np.eye(3), ONE),
    lambda: Candidates(np.zeros((3, 2)), np.zeros(3), np.zeros(2), ()),
):
    try:
        print("accepted", make())
    except InputError as error:
        print(error)
"""
REFUSED = """\
FrfSet.values: arrays and axes disagree; got 3 along freq, expected 4, as in frequencies
FrfSet.coherence: arrays and axes disagree; got 2 along out, expected 1, as in values
FrfSet.values: an array has the wrong number of axes; got shape (4,), expected (freq, out, in)
Recording.overloads: arrays and axes disagree; got 3 along channel, expected 2, as in signals
Geometry.xyz: arrays and axes disagree; got 2 along n, expected 3, as in nodes
Geometry.xyz: arrays and axes disagree; got 2 along 3, expected 3
ModalMap.frequency: arrays and axes disagree; got 3 along level, expected 2, as in force_levels
Matrices.stiffness: arrays and axes disagree; got 3 along n, expected 2, as in mass
Candidates.beams: arrays and axes disagree; got 2 along candidate, expected 3, as in centres
"""


def test_containers_refuse_arrays_whose_axes_disagree() -> None:
    """In a process of its own: here the types are checked before the container sees them."""
    done = subprocess.run([sys.executable, "-c", WRONG], capture_output=True, text=True, timeout=120)
    assert done.stdout == REFUSED, done.stdout + done.stderr


def test_a_parameter_outside_its_interval_is_refused() -> None:
    with pytest.raises(InputError, match="low <= value <= high"):
        LawParameter("iwan", "mu", 0.5, 0.4, 0.6, identifiable=True)
    assert np.isnan(LawParameter("iwan", "mu", float("nan"), 0.4, 0.6, identifiable=False).low)
