"""The form in which FRFs are fitted, and the way back (`tests/validation/test_invariance_of_estimates.py`)."""

from dataclasses import replace

import numpy as np
import pytest

from ema.data import FrfSet
from ema.fit import modes, stabilise
from ema.fit.canonical import canonical
from tests.bench import invariance
from tests.bench.invariance import automatic, compared


def test_threads_change_nothing() -> None:
    made = invariance.case(2611521, 13)
    change = compared(automatic(made.frfs), invariance.with_threads(made.frfs, 2), invariance.plain(made.frfs))
    assert change.within, change


def test_modes_are_on_the_degrees_of_freedom_of_the_set_in_its_order() -> None:
    """Shapes, participation, residual terms and variances go with their DOFs, whatever the order."""
    frfs = invariance.case(2611521, 6).frfs
    rows, columns = [2, 0, 1], [1, 2, 0]
    other = frfs.pick(rows, columns)
    first, second = modes(frfs, stabilise(frfs)), modes(other, stabilise(other))
    assert second.dofs == other.outputs
    assert second.inputs == other.inputs
    assert stabilise(other).references == other.inputs
    np.testing.assert_allclose(second.shapes, first.shapes[rows], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(second.participation, first.participation[columns], rtol=1e-9)
    for name in ("lower", "upper"):
        term = getattr(first.residuals, name)
        scale = np.abs(term).max()
        np.testing.assert_allclose(getattr(second.residuals, name), term[rows][:, columns], atol=1e-9 * scale)
    np.testing.assert_allclose(second.residuals.residues, first.residuals.residues[:, rows][:, :, columns], rtol=1e-6)
    a, b = first.uncertainty, second.uncertainty
    np.testing.assert_allclose(b.residues, a.residues[:, rows][:, :, columns], rtol=1e-6)
    np.testing.assert_allclose(b.shapes, a.shapes[:, rows], rtol=1e-6, atol=1e-9 * np.abs(a.shapes).max())
    np.testing.assert_allclose(b.participation, a.participation[:, columns], rtol=1e-6)


def test_degrees_of_freedom_that_are_there_twice_stay_where_they_are() -> None:
    """Nothing but its place tells such an output from the other."""
    frfs = invariance.case(2611521, 6).frfs
    twice = replace(frfs, outputs=(frfs.outputs[1], frfs.outputs[0], frfs.outputs[1]))
    model, own = modes(twice, stabilise(twice)), modes(frfs, stabilise(frfs))
    assert model.dofs == twice.outputs
    np.testing.assert_allclose(model.natural_frequencies, own.natural_frequencies, rtol=1e-6)
    turn = np.sum(model.shapes.conj() * own.shapes, axis=0)
    apart = np.abs(turn) / np.linalg.norm(model.shapes, axis=0) / np.linalg.norm(own.shapes, axis=0)
    assert apart.min() > 0.999


def test_rounding_is_a_small_part_of_the_noise() -> None:
    """What the canonical form takes off the values is uniform within a ten-thousandth of the noise that was added."""
    made = invariance.case(2611521, 6)
    form, scale = canonical(made.frfs)
    assert form.outputs == made.frfs.outputs
    moved = form.values * scale - made.frfs.values
    std = np.std(made.frfs.values - made.clean, axis=0)
    assert 0 < np.abs(moved).max() < 1e-4 * std.min()


@pytest.mark.parametrize(("quantity", "order"), [("receptance", 0), ("mobility", 1), ("accelerance", 2)])
def test_the_form_is_that_with_the_flattest_noise(quantity: str, order: int) -> None:
    """White noise on one of the three, stated as each of them."""
    rng = np.random.default_rng(9400)
    made = invariance.case(2611521, 2).frfs
    omega = 2 * np.pi * made.frequencies[:, None, None]
    noise = rng.standard_normal((*made.values.shape, 2)) @ [1, 1j]
    level = 0.01 * np.sqrt(np.mean(np.abs(made.values) ** 2)) * np.mean(omega) ** (order - 2)
    measured = (made.values * (1j * omega) ** (order - 2)) + level * noise
    variance = np.full(measured.shape, 2 * level**2)
    for stated, own in (("receptance", 0), ("mobility", 1), ("accelerance", 2)):
        factor = (1j * omega) ** (own - order)
        frfs = FrfSet(
            made.frequencies,
            measured * factor,
            made.outputs,
            made.inputs,
            stated,
            {0: "m/N", 1: "(m/s)/N", 2: "(m/s^2)/N"}[own],
            variance=variance * np.abs(factor) ** 2,
        )
        assert canonical(frfs)[0].quantity == quantity
