"""Peaks of few frequency lines: modes are found wherever their energy is, tones are none, and what lies beyond the band
is kept as long as the data need it."""

import numpy as np
import pytest

import ema.fit
from ema.data import FrfSet, ModalModel
from ema.dof import Dof
from ema.synthesis import frfs
from tests.bench.scoring import assign, cramer_rao
from tests.bench.systems import SMALL, system

LINE = 0.5
FREQUENCIES = 100 + LINE * np.arange(3201)


def measured(seed: int, *, bandwidth: float, energy: float = 1500.0, tone: bool = False) -> tuple[FrfSet, float]:
    """Accelerances of eight modes with 1 % noise, and a mode of ``bandwidth`` lines whose energy, in units of the noise,
    would let its damping be known to some per cent; or a tone of as much energy. Its frequency is returned."""
    rng = np.random.default_rng([31, seed])
    outputs = tuple(Dof(k + 1, "+Z") for k in range(4))
    others = np.linspace(220, 1550, 8) * rng.uniform(0.97, 1.03, 8)
    special = float(rng.uniform(0.35, 0.65) * (others[3] - others[2]) + others[2])
    natural = np.append(others, special)
    damping = np.append(rng.uniform(0.004, 0.02, 8), bandwidth * LINE / (2 * special))
    poles = 2 * np.pi * natural * (-damping + 1j * np.sqrt(1 - damping**2))
    shapes = rng.normal(size=(4, 9)) + 0j
    participation = rng.normal(size=(2, 9)) / (2j * poles.imag)
    model = ModalModel(
        poles=poles[:8],
        shapes=shapes[:, :8],
        dofs=outputs,
        participation=participation[:, :8],
        inputs=outputs[:2],
    )
    clean = frfs(model, FREQUENCIES, "accelerance", outputs, outputs[:2])
    level = 0.01 * np.sqrt(np.mean(np.abs(clean.values) ** 2, axis=0))
    s = 2j * np.pi * FREQUENCIES[:, None, None]
    pattern = shapes[:, [8]] * participation[None, :, 8]
    if tone:
        extra = np.zeros_like(clean.values)
        extra[np.argmin(np.abs(FREQUENCIES - special))] = rng.normal(size=(4, 2, 2)) @ [1, 1j]
    else:
        extra = s**2 * (pattern / (s - poles[8]) + pattern.conj() / (s - poles[8].conj()))
    extra *= np.sqrt(energy / np.sum(2 * np.abs(extra / level) ** 2))
    noise = level * (rng.normal(size=(*clean.values.shape, 2)) @ [1, 1j]) / np.sqrt(2)
    return FrfSet(FREQUENCIES, clean.values + extra + noise, outputs, outputs[:2], "accelerance", "m/s^2/N"), special


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("bandwidth", [0.6, 1.3, 3.0])
def test_a_narrow_mode_is_found_where_bins_average_it_away(seed: int, bandwidth: float) -> None:
    data, frequency = measured(seed, bandwidth=bandwidth)
    found = ema.fit.modes(data, ema.fit.stabilise(data))
    assert len(found.poles) == 9
    nearest = int(np.argmin(np.abs(found.natural_frequencies - frequency)))
    assert found.covariance is not None
    std = np.sqrt(found.covariance[nearest, [0, 1], [0, 1]])
    assert std[0] < 0.1 * bandwidth * LINE
    assert abs(found.natural_frequencies[nearest] - frequency) < 5 * std[0]
    assert abs(found.damping_ratios[nearest] - bandwidth * LINE / (2 * frequency)) < 5 * std[1]


@pytest.mark.parametrize("seed", range(5))
def test_a_tone_of_as_much_energy_is_no_mode(seed: int) -> None:
    data, frequency = measured(seed, bandwidth=1.0, tone=True)
    found = ema.fit.modes(data, ema.fit.stabilise(data))
    assert len(found.poles) == 8
    assert np.min(np.abs(found.natural_frequencies - frequency)) > 10


@pytest.mark.parametrize(("seed", "number"), [(104, 42), (104, 15), (100, 13)])
def test_no_mode_is_lost_where_a_row_of_resonances_lies_just_outside_the_band(seed: int, number: int) -> None:
    """All identifiable modes of random systems are accepted, within five standard deviations of the truth, and stated
    no worse than twice their Cramer-Rao bound. Poles of the background that nothing else describes had been taken out
    with what the data need of them (the damping of a mode was stated as 1.9 +- 0.3 % instead of +- 0.005 %)."""
    case, _ = system(seed, number, SMALL)
    found = ema.fit.modes(case.frfs, ema.fit.stabilise(case.frfs))
    match, _ = assign(case, found.poles, found.shapes)
    identifiable, bound = cramer_rao(case).identifiable, cramer_rao(case, residual_terms=True)
    assert np.all(match[identifiable] >= 0)
    own = match[identifiable]
    assert found.covariance is not None
    std = np.sqrt(found.covariance[own][:, [0, 1], [0, 1]])
    truth = np.stack([case.truth.natural_frequencies, case.truth.damping_ratios], axis=1)[identifiable]
    stated = np.stack([found.natural_frequencies, found.damping_ratios], axis=1)[own]
    least = np.stack([bound.frequency_std, bound.damping_std], axis=1)[identifiable]
    assert np.all(np.abs(stated - truth) < 5 * std)
    assert np.all(std < 2 * least)
