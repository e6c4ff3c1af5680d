"""Hammer tests with faults that laboratories have, on a structure known in closed form: right, or named."""

import numpy as np
import pytest

from ema.data import ModalModel, Run
from ema.estimate import hammer_test
from ema.fit import modes, stabilise
from tests.unit.closed_form_impacts import DAMPING, FREQUENCIES, hammer_run

BAND = (10.0, 200.0)


def fitted(run: Run) -> ModalModel:
    frfs, _ = hammer_test(run)
    inside = frfs.band(*BAND)
    return modes(inside, stabilise(inside))


def test_the_closed_form_is_found_within_its_intervals() -> None:
    model = fitted(hammer_run())
    errors = model.natural_frequencies - FREQUENCIES, model.damping_ratios - DAMPING
    assert np.all(np.abs(errors[0]) < 3 * np.sqrt(model.covariance[:, 0, 0]))
    assert np.all(np.abs(errors[1]) < 3 * np.sqrt(model.covariance[:, 1, 1]))


@pytest.mark.parametrize("phase", [None, 0.3])
@pytest.mark.parametrize("mains", [50.0, 60.0])
def test_one_line_of_the_mains_is_no_mode(mains: float, phase: float | None) -> None:
    """A tone does not decay: the exponential window gives it a damping that is taken off again, down to 0 or below."""

    def humming(point: int, number: int, times: np.ndarray, signals: np.ndarray) -> np.ndarray:
        peaks = np.abs(signals).max(axis=1, keepdims=True) * np.array([[0.0], [0.05], [0.05]])
        turn = np.random.default_rng(10 * point + number).uniform(0, 2 * np.pi) if phase is None else phase
        return signals + peaks * np.sin(2 * np.pi * mains * times + turn)

    model = fitted(hammer_run(humming))
    assert len(model.poles) == 4, model.natural_frequencies
    assert np.all(np.abs(model.natural_frequencies - FREQUENCIES) < 0.001 * FREQUENCIES)
    assert np.all(model.damping_ratios > 0)
