"""A mode that may be several: what the residual leaves room for is said, and such a mode is not told."""

import numpy as np
import pytest

import ema.fit
from ema.data import ModalModel
from ema.fit import estimator, overlap
from ema.fit.prepare import prepare
from tests.bench.cases import random_system
from tests.bench.scoring import cramer_rao, score
from tests.unit import fit_rig as rig

LOW, HIGH = 100.0, 500.0
FREQUENCIES, DAMPING = [150.0, 210.0, 300.0, 309.0, 420.0], [0.004, 0.006, 0.06, 0.05, 0.005]
HEAVY = 2


def fitted(
    truth: ModalModel, modes: list[int], noise: float, seed: int = 0
) -> tuple[estimator.Observations, estimator.Fit, float]:
    """Some modes of the truth, refined without the others, and the residual energy over that of the noise."""
    measured = prepare(rig.frfs(truth, LOW, HIGH, 801, noise, seed))
    data = estimator.observe(measured.frequencies, measured.values, measured.derivative, measured.noise)
    participation = truth.participation[:, modes]
    participation = participation / participation[np.argmax(np.abs(participation), axis=0), np.arange(len(modes))]
    terms = estimator.residual_terms(data, estimator.fixed_poles(measured.frequencies))
    fit = estimator.refine(data, estimator.evaluate(data, truth.poles[modes], participation, terms), 30)
    return data, fit, fit.variance_factor(data)


def probability(truth: ModalModel, modes: list[int], noise: float, seed: int) -> np.ndarray:
    """Of another mode under each of some modes of the truth, refined without the others."""
    data, fit, factor = fitted(truth, modes, noise, seed)
    return overlap.another_mode(data, fit, factor, (LOW, HIGH), np.arange(len(modes)))


@pytest.mark.parametrize("drive", [(0,), (0, 3)])
@pytest.mark.parametrize("seed", range(3))
def test_a_complete_fit_leaves_no_room_for_another_mode(drive, seed):
    truth = rig.model(FREQUENCIES, DAMPING, drive=drive, seed=seed)
    assert np.all(probability(truth, [0, 1, 2, 3, 4], 0.01, seed) < 0.1)


@pytest.mark.parametrize("drive", [(0,), (0, 3)])
@pytest.mark.parametrize("seed", range(3))
def test_a_mode_that_is_not_in_the_fit_shows_under_the_one_that_took_its_place(drive, seed):
    truth = rig.model(FREQUENCIES, DAMPING, drive=drive, seed=seed)
    assert probability(truth, [0, 1, 2, 4], 0.2, seed)[HEAVY] > 0.9


def test_where_noise_hides_everything_as_many_modes_are_expected_as_there_are():
    data, fit, _ = fitted(rig.model(FREQUENCIES, DAMPING), [0, 1, 2, 3, 4], 0.01)
    found = overlap.another_mode(data, fit, 1e12, (LOW, HIGH), np.array([HEAVY]))
    # One and a half in 120 Hz, the reach of a mode where five share 400 Hz.
    assert found == pytest.approx(1.5 / 2.5, rel=1e-3)


def test_without_modes_there_is_nothing_to_ask():
    data, one, _ = fitted(rig.model(FREQUENCIES, DAMPING), [0], 0.01)
    fit = estimator.drop(data, one, np.zeros(1, bool))
    assert overlap.another_mode(data, fit, 1.0, (LOW, HIGH), np.zeros(0, int)).shape == (0,)


def test_few_frfs_of_many_overlapping_modes_give_few_false_ones():
    """One reference and fewer outputs than modes: what is told is one mode, and what can be told is."""
    false = missed = identifiable = 0
    reasons = ""
    for seed in range(5):
        case = random_system(seed, 0.05, modes=40, outputs=12, references=1, lines=801)
        model = ema.fit.modes(case.frfs, ema.fit.stabilise(case.frfs))
        found = score(case, model, cramer_rao(case))
        false, missed = false + len(found.false), missed + len(found.missed)
        identifiable += int(found.identifiable.sum())
        reasons += " ".join(finding.message for finding in model.findings)
    assert false <= 2
    assert missed <= 0.02 * identifiable
    assert "modes that overlap" in reasons
