"""What one more mode would explain: against a dense least-squares problem, and in fits where neighbours hide it."""

from dataclasses import replace

import numpy as np
import pytest

import ema.fit
from ema.data import ModalModel
from ema.fit import estimator, model, trials
from tests.bench.cases import random_system
from tests.bench.draws import Knowledge, drawn
from tests.bench.scoring import assign, cramer_rao
from tests.bench.stated import automatic, errors
from tests.bench.systems import SMALL, Extent, system
from tests.unit import fit_rig


def observed(
    truth: ModalModel, hidden: int, noise: float, rows: int = 1
) -> tuple[estimator.Observations, estimator.Fit]:
    """Receptances of a model from 60 to 200 Hz, and the optimum of a fit without one of its modes."""
    rng = np.random.default_rng([8, rows])
    measured = fit_rig.frfs(truth, 60, 200, 401, noise=noise, seed=3, quantity="receptance")
    s, signals = 2j * np.pi * measured.frequencies, measured.values.transpose(1, 2, 0)
    signals = np.ascontiguousarray(signals.reshape(rows, -1, *signals.shape[1:]))
    uneven = np.exp(rng.normal(0, 0.5, (rows, signals.shape[2], len(s)))) if rows > 1 else 1.0
    weights = np.full((rows, signals.shape[2], len(s)), 2 / np.mean(np.abs(signals) ** 2) / noise**2) * uneven
    data = estimator.Observations(s, signals, weights)
    terms = estimator.residual_terms(data, estimator.fixed_poles(np.asarray(measured.frequencies)))
    largest = truth.participation[np.argmax(np.abs(truth.participation), axis=0), np.arange(len(truth.poles))]
    keep = np.delete(np.arange(len(truth.poles)), hidden)
    start = estimator.evaluate(data, truth.poles[keep], (truth.participation / largest)[:, keep], terms)
    return data, estimator.refine(data, start, 60, tolerance=1e-13, prior=1e-6)


def wide_modes(references: int, size: float, dofs: int = 4) -> ModalModel:
    """Wide modes next to each other; the fourth, at 136.9 Hz, has a residue of this size."""
    truth = fit_rig.model(
        [100.0, 127.0, 132.0, 136.9, 150.0], [0.01, 0.023, 0.055, 0.097, 0.01], dofs, drive=tuple(range(references))
    )
    factor = np.array([1.0, 1.0, 1.0, np.sqrt(size), 1.0])
    return replace(truth, shapes=truth.shapes * factor, participation=truth.participation * factor)


def least_squares_gain(data: estimator.Observations, fit: estimator.Fit, pole: complex, vector: np.ndarray) -> float:
    """The same from a Jacobian of all real unknowns at once, written down from the modal model by itself."""
    s, terms = data.s, fit.terms
    rows, members, references = data.signals.shape[:3]

    def pair(p: complex, coefficient: complex, power: int = 1) -> np.ndarray:
        return coefficient / (s - p) ** power + np.conj(coefficient) / (s - np.conj(p)) ** power

    weight = np.sqrt(data.weights)[:, None]
    columns, further = [], []

    def add(into: list, change: np.ndarray) -> None:
        into.append((change * weight).reshape(-1).view(float))

    nothing = np.zeros(data.signals.shape, complex)
    for row in range(rows):
        for member in range(members):
            for turn in (1.0, 1j):
                for mode, p in enumerate(fit.poles):
                    change = nothing.copy()
                    for i in range(references):
                        change[row, member, i] = pair(p, turn * fit.participation[i, mode])
                    add(columns, change)
                change = nothing.copy()
                for i in range(references):
                    change[row, member, i] = pair(pole, turn * vector[i])
                add(further, change)
            for i in range(references):
                for column in range(terms.mixing.shape[1]):
                    values = np.zeros(terms.mixing.shape[1])
                    values[column] = 1.0
                    change = nothing.copy()
                    found = model.functions(s, fit.poles, terms.poles)
                    both = np.concatenate([np.zeros(len(fit.poles)), terms.coefficients(values)])
                    change[row, member, i] = model.synthesise(found, both[None])[0]
                    add(columns, change)
    for turn in (1.0, 1j):
        for mode, p in enumerate(fit.poles):
            change = nothing.copy()
            for i in range(references):
                residue = fit.shapes[..., mode] * fit.participation[i, mode] * turn
                change[:, :, i] = (
                    residue[..., None] / (s - p) ** 2 + residue.conj()[..., None] / (s - p.conjugate()) ** 2
                )
            add(columns, change)
        for entry in fit.free:
            i, mode = divmod(int(entry), len(fit.poles))
            change = nothing.copy()
            residue = fit.shapes[..., mode] * turn
            change[:, :, i] = residue[..., None] / (s - fit.poles[mode]) + residue.conj()[..., None] / (
                s - fit.poles[mode].conjugate()
            )
            add(columns, change)
    left = (estimator.residual(data, fit) * weight).reshape(-1).view(float)

    def explained(jacobian: list) -> float:
        matrix = np.array(jacobian).T
        base = np.linalg.qr(matrix / np.linalg.norm(matrix, axis=0))[0]
        return float(np.sum((base.T @ left) ** 2))

    return explained(columns + further) - explained(columns)


@pytest.mark.parametrize(("rows", "references"), [(1, 1), (1, 3), (5, 2)])
def test_gain_of_a_further_mode_is_that_of_a_dense_least_squares_problem(rows: int, references: int) -> None:
    data, fit = observed(wide_modes(references, 0.1, dofs=5), 3, 0.002, rows)
    places = 2 * np.pi * np.array([136.9, 98.0, 115.0]) * (1j - 0.05)
    vectors = np.random.default_rng(1).normal(size=(3, references)) + 0.3j
    vectors /= np.linalg.norm(vectors, axis=1)[:, None]
    found = trials.gains_at(data, fit, places, vectors)
    for gain, pole, vector in zip(found, places, vectors, strict=True):
        # The prior of the shared unknowns and the ridge of the further residues take a little off.
        assert gain == pytest.approx(least_squares_gain(data, fit, complex(pole), vector), rel=2e-2)


def test_neighbours_that_have_moved_to_describe_a_mode_count_in_what_it_would_explain() -> None:
    """What a wide mode explains is what refinement with it then takes off; with the poles of its neighbours where they
    have moved to without it, it would be a quarter less."""
    truth = wide_modes(3, 1.0)
    data, fit = observed(truth, 3, 0.002)
    with_fixed_poles, vectors = trials.residue_gains(data, fit, truth.poles[[3]])
    (gain,), _ = trials.mode_gains(data, fit, truth.poles[[3]])
    larger = estimator.refine(data, estimator.with_modes(data, fit, truth.poles[[3]], vectors), 60)
    assert with_fixed_poles[0] < 0.8 * gain
    assert gain == pytest.approx(fit.cost - larger.cost, rel=0.05)


@pytest.mark.parametrize(("seed", "number"), [(104, 15), (400, 34)])
def test_a_pole_that_stands_still_makes_no_shape_uncertain(seed: int, number: int) -> None:
    """The fits of these systems have poles outside the band whose place rounding alone tells: every identifiable mode is
    accepted, with a shape that is known."""
    case, _ = system(seed, number, SMALL)
    found = ema.fit.modes(case.frfs, ema.fit.stabilise(case.frfs))
    match, _ = assign(case, found.poles, found.shapes)
    assert np.all(match[cramer_rao(case).identifiable] >= 0)


def test_more_poles_than_there_are_modes_are_taken_out_and_the_modes_are_known_again() -> None:
    """Four wide poles had shared what three modes make, all uncertain by 20 to 40 %, and two of the modes were lost.
    Every identifiable mode is accepted, and stated no worse than twice its Cramer-Rao bound."""
    rng = np.random.default_rng([7, 51, 77])
    modes, references = round(np.exp(rng.uniform(np.log(3), np.log(40)))), int(rng.integers(1, 5))
    lines, outputs = int(rng.choice([401, 801, 1601])), round(np.exp(rng.uniform(np.log(2.5), np.log(25))))
    case = random_system(int(rng.integers(1, 2**31)), 0.001, modes, outputs, references, lines)
    frfs = drawn(case, Knowledge("", 3), rng)
    found = ema.fit.modes(frfs, ema.fit.stabilise(frfs))
    match, _ = assign(case, found.poles, found.shapes)
    bound, known = cramer_rao(case, residual_terms=True), cramer_rao(case).identifiable
    assert np.all(match[known] >= 0)
    assert np.all(np.sqrt(found.covariance[match[known], 1, 1]) < 2 * bound.damping_std[known])


def test_gain_of_a_pole_is_what_the_cost_grows_without_it() -> None:
    data, fit = observed(wide_modes(2, 1.0), 4, 0.002)
    for mode, gain in enumerate(estimator.gains(data, fit)):
        without = estimator.drop(data, fit, np.arange(4) != mode).cost - fit.cost
        assert gain == pytest.approx(without, rel=1e-3)


def test_a_pole_that_the_residual_terms_describe_has_no_infinite_gain() -> None:
    """A resonance far below the band: rounding made its variance negative, its gain infinite, and nothing could take it
    out."""
    case, _ = system(261127, 0, Extent())
    with np.errstate(over="raise", invalid="raise"):
        found = errors(case, automatic(case.frfs))
    assert np.isfinite(found.frequency).all() and not found.false
