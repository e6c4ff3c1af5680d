"""Set-ups of roving sensors whose natural frequencies differ: modes once, shifts with intervals, the cause told apart."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition.setups import Part, merge
from ema.data import FrfSet, ModalModel, SetUps, poles_from
from ema.dof import Dof
from ema.errors import InputError
from ema.fit import modes, stabilise
from ema.synthesis import frfs as synthesise

FREQUENCIES = np.arange(40.0, 400.0, 0.25)
NATURAL = np.array([62.0, 97.0, 141.0, 188.0, 230.0, 311.0])
ZETA = np.array([0.004, 0.003, 0.006, 0.004, 0.005, 0.003])
NODES, FORCES = 16, (0, 5)
SEATS = ((0, 3, 5, 8, 11), (1, 4, 6, 9, 12, 14), (2, 7, 10, 13, 15))
REACH = 5.0
"""Standard deviations; chance exceeds them less than once in a million."""


def shapes() -> np.ndarray:
    """Six smooth shapes on sixteen points, of unit modal mass by definition."""
    x = (np.arange(NODES) + 0.4) / NODES
    return np.array([np.cos(np.pi * (mode + 1) * x + 0.3 * mode) for mode in range(len(NATURAL))]).T


def response(mass: np.ndarray, omega: np.ndarray, rows: list[int], columns: list[int]) -> np.ndarray:
    """Accelerance (freq, out, in) of M = ``mass``, K = diag(w^2), D = diag(2 z w) in modal coordinates."""
    w = 2 * np.pi * FREQUENCIES[:, None, None]
    dynamic = np.diag(omega**2) + 1j * w * np.diag(2 * ZETA * omega) - w**2 * mass
    phi = shapes()
    forces = np.broadcast_to(phi[columns].T, (len(w), len(omega), len(columns)))
    return -(w**2) * (phi[rows] @ np.linalg.solve(dynamic, forces))


def measured(
    seed: int, factors: tuple[float, ...] = (0.0, 0.0, 0.0), sensor: float = 0.0, roving: str = "sensors"
) -> FrfSet:
    """Three set-ups with relative shifts ``factors`` and sensors of mass ``sensor``; 0.5 % noise."""
    rng = np.random.default_rng(seed)
    dofs = [Dof(node + 1, "+Z") for node in range(NODES)]
    parts = []
    for number, (seats, factor) in enumerate(zip(SEATS, factors, strict=True)):
        moved, fixed = list(seats), list(FORCES)
        rows, columns = (moved, fixed) if roving == "sensors" else (fixed, moved)
        mass = np.eye(len(NATURAL)) + sensor * shapes()[rows].T @ shapes()[rows]
        clean = response(mass, 2 * np.pi * NATURAL * (1 + factor), rows, columns)
        noise = rng.standard_normal((2, *clean.shape)) * 0.005 * np.sqrt(np.mean(np.abs(clean) ** 2) / 2)
        frfs = FrfSet(
            FREQUENCIES,
            clean + noise[0] + 1j * noise[1],
            tuple(dofs[row] for row in rows),
            tuple(dofs[column] for column in columns),
            "accelerance",
            "m/s^2/N",
        )
        parts.append(Part(frfs, f"S{number + 1}"))
    return merge(parts, "roving")


def fitted(frfs: FrfSet) -> ModalModel:
    return modes(frfs, stabilise(frfs))


def codes(model: ModalModel) -> set[str]:
    return {finding.code for finding in model.findings if finding.severity != "info"}


@pytest.mark.parametrize("roving", ["sensors", "forces"])
@pytest.mark.parametrize("size", [0.0006, 0.003, 0.01])
def test_modes_of_set_ups_with_a_common_shift_are_each_there_once(roving: str, size: float) -> None:
    factors = (0.0, -size, 0.4 * size)
    model = fitted(measured(int(1e5 * size) + len(roving), factors, roving=roving))
    f, std = model.natural_frequencies, np.sqrt(model.covariance[:, [0, 1], [0, 1]])
    assert len(f) == len(NATURAL)
    assert np.all(np.abs(f - NATURAL * (1 + np.mean(factors))) <= REACH * std[:, 0])
    # The interval of a frequency holds the values of the set-ups.
    spread = np.std(np.outer(1 + np.array(factors), NATURAL), axis=0, ddof=1)
    assert np.all(std[:, 0] > 0.9 * spread)
    assert np.all(np.abs(model.damping_ratios - ZETA) <= REACH * std[:, 1])
    assert "setup-shift" in codes(model)
    found = model.set_ups
    assert found.names == ("S1", "S2", "S3") and found.cause == "common shift"
    true = (1 + np.array(factors)) / (1 + np.mean(factors)) - 1
    assert np.all(np.abs(found.common - true) <= REACH * found.common_std)
    assert found.common_std.max() < 2e-5
    assert np.nanmax(np.abs(found.shifts - true[:, None]) / found.std) <= REACH


def test_shapes_and_modal_masses_are_those_of_the_structure() -> None:
    model = fitted(measured(3, (0.004, -0.002, -0.006)))
    rows = [dof.node - 1 for dof in model.dofs]
    exact = shapes()[rows]
    sign = np.sign(np.sum(model.shapes.real * exact, axis=0))
    assert model.scaling == "unit modal mass"
    np.testing.assert_allclose(model.shapes.real * sign, exact, atol=0.02)


def test_sensors_that_load_the_structure_are_told_apart_from_temperature() -> None:
    """Mass and frequencies without sensors: the loaded structure is solved exactly in the generator."""
    sensor = 0.002
    model = fitted(measured(11, sensor=sensor))
    found = model.set_ups
    assert found.cause == "mass loading" and "mass-loading" in codes(model)
    assert len(model.poles) == len(NATURAL)
    assert abs(found.mass - sensor) <= REACH * found.mass_std and found.mass_std < 0.1 * sensor
    assert np.all(np.abs(found.unloaded - NATURAL) <= REACH * found.unloaded_std)
    # Without the extrapolation they are 20 and more standard deviations off.
    assert np.max(np.abs(found.frequencies - NATURAL) / found.unloaded_std) > 20


def test_set_ups_that_agree_change_nothing() -> None:
    together = measured(5)
    labelled, plain = fitted(together), fitted(replace(together, set_ups=None))
    np.testing.assert_array_equal(labelled.poles, plain.poles)
    np.testing.assert_array_equal(labelled.covariance, plain.covariance)
    assert labelled.set_ups.cause == "none" and plain.set_ups is None
    assert not codes(labelled) & {"setup-shift", "mass-loading"}
    (note,) = [one for one in labelled.findings if one.code == "setup-shift"]
    assert note.severity == "info" and "agree within their noise" in note.message


def test_naming_chooses_from_the_same_fit() -> None:
    frfs = measured(6, (0.0, 0.003, -0.003))
    table = stabilise(frfs)
    every, some = modes(frfs, table), modes(frfs, table, near=[141.0, 311.0])
    rows = [int(np.argmin(np.abs(every.natural_frequencies - one))) for one in (141.0, 311.0)]
    np.testing.assert_array_equal(some.poles, every.poles[rows])
    # the order in which BLAS sums follows the place of an array in memory: the last bit is no choice of the fit
    np.testing.assert_allclose(some.covariance, every.covariance[rows], rtol=1e-14)
    assert some.set_ups.frequencies.tolist() == every.set_ups.frequencies.tolist()
    with pytest.raises(InputError, match="no pole near"):
        modes(frfs, table, near=[270.0])


def test_a_mode_on_a_node_of_all_sensors_of_a_set_up_is_found_in_the_others() -> None:
    """A set-up of two sensors next to nodes of a mode does not show it; its other modes say how it moved."""
    frfs = measured(8, (0.0, 0.002, -0.002))
    few = frfs.pick(outputs=[row for row, dof in enumerate(frfs.outputs) if row < 11 or dof.node in (8, 11)])
    model = fitted(few)
    assert len(model.poles) == len(NATURAL)
    std = np.sqrt(model.covariance[:, 0, 0])
    assert np.all(np.abs(model.natural_frequencies - NATURAL) <= REACH * std)


def test_set_ups_go_with_their_frfs() -> None:
    frfs = measured(2)
    assert frfs.set_ups.names == ("S1", "S2", "S3")
    picked = frfs.band(100, 200).pick(outputs=[0, 6, 12], inputs=[1])
    assert picked.set_ups.number.tolist() == [[0], [1], [2]]
    one = frfs.pick(outputs=[0, 1])
    assert np.unique(one.set_ups.number).tolist() == [0]
    assert fitted(one).set_ups is None


def test_set_ups_that_share_no_side_are_fitted_together() -> None:
    """Nothing ties their shapes to each other."""
    frfs = measured(4)
    number = np.array(frfs.set_ups.number)
    number[:8, 1] = 1
    assert fitted(replace(frfs, set_ups=SetUps(frfs.set_ups.names, number))).set_ups is None


def test_a_dead_set_up_leaves_the_others_as_they_are() -> None:
    frfs = measured(9)
    values = np.array(frfs.values)
    values[:, :5] = 0
    model = fitted(replace(frfs, values=values))
    assert model.set_ups is None and len(model.poles) == len(NATURAL)
    assert "dead-output" in codes(model)


def test_shifts_are_those_of_the_set_ups_that_are_left() -> None:
    frfs = measured(10, (0.0, 0.004, -0.004)).pick(outputs=range(5, 16))
    found = fitted(frfs).set_ups
    assert found.names == ("S2", "S3") and found.shifts.shape == (2, len(NATURAL))
    assert found.frequencies.tolist() == sorted(found.frequencies)
    true = np.array([1.004, 0.996]) / 1.0 - 1
    assert np.all(np.abs(found.common - true) <= REACH * found.common_std)


def test_the_truth_of_this_test_is_that_of_a_synthesis() -> None:
    """The direct inverse used here and the project's synthesis agree for the structure without sensors."""
    poles = poles_from(NATURAL, ZETA)
    dofs = tuple(Dof(node + 1, "+Z") for node in range(NODES))
    phi = shapes().astype(complex)
    model = ModalModel(poles, phi, dofs, phi[:1] / (2j * poles.imag), dofs[:1], scaling="unit modal mass")
    exact = synthesise(model, FREQUENCIES, "accelerance", outputs=dofs, inputs=dofs[:1])
    direct = response(np.eye(len(NATURAL)), 2 * np.pi * NATURAL, list(range(NODES)), [0])
    np.testing.assert_allclose(exact.values, direct, atol=1e-10 * np.abs(direct).max())
