"""Modes narrower than a frequency line, and modes closer than one: with little noise the lines tell them all the same."""

import numpy as np
import pytest

from ema.data import FrfSet, ModalModel, poles_from
from ema.dof import Dof
from ema.fit import modes, stabilise
from ema.synthesis import frfs as synthesise

LINE = 9.6
FREQUENCIES = 490.0 + LINE * np.arange(401)
OUTPUTS = tuple(Dof(node, "+Z") for node in range(1, 41))
NOISE = 0.001


def structure(natural: np.ndarray, zeta: np.ndarray, references: int, rng: np.random.Generator) -> ModalModel:
    """Real shapes drawn at random: no two modes are alike."""
    poles = poles_from(natural, zeta)
    shapes = rng.normal(size=(len(OUTPUTS), len(poles))).astype(complex)
    participation = shapes[:references] / (2j * poles.imag)
    return ModalModel(poles, shapes, OUTPUTS, participation, OUTPUTS[:references], scaling="unit modal mass")


def measured(model: ModalModel, references: int, rng: np.random.Generator) -> FrfSet:
    values = np.array(synthesise(model, FREQUENCIES, "accelerance").values)
    std = NOISE * np.sqrt((np.abs(values) ** 2 + np.mean(np.abs(values) ** 2, axis=0)) / 2)
    error = std * (rng.standard_normal(values.shape) + 1j * rng.standard_normal(values.shape))
    return FrfSet(FREQUENCIES, values + error, OUTPUTS, OUTPUTS[:references], "accelerance", "m/s^2/N")


def deviations(estimate: ModalModel, natural: np.ndarray, zeta: np.ndarray) -> np.ndarray:
    """Errors of frequency and damping ratio in stated standard deviations, (2, mode)."""
    std = np.sqrt(estimate.covariance[:, [0, 1], [0, 1]]).T
    return np.array([estimate.natural_frequencies - natural, estimate.damping_ratios - zeta]) / std


@pytest.mark.parametrize("seed", range(4))
def test_two_modes_within_a_line_of_each_other_are_two(seed: int) -> None:
    """0.6 lines apart, with different shapes and participation: neither is what the other one leaves over."""
    rng = np.random.default_rng([57, seed])
    natural = np.array([709.7, 1008.3, 1014.4, 1707.8, 2276.0, 3461.2])
    zeta = np.array([0.018, 0.0015, 0.00137, 0.004, 0.053, 0.037])
    estimate = modes(frfs := measured(structure(natural, zeta, 4, rng), 4, rng), stabilise(frfs))
    assert estimate.natural_frequencies == pytest.approx(natural, rel=1e-3)
    assert np.abs(deviations(estimate, natural, zeta)).max() < 5.5
    assert "damping-not-resolved" not in {finding.code for finding in estimate.findings}


@pytest.mark.parametrize("width", [0.28, 0.2, 0.1])
@pytest.mark.parametrize("seed", range(2))
def test_little_noise_tells_the_damping_of_a_mode_narrower_than_a_line(width: float, seed: int) -> None:
    """Half-power bandwidths of a few tenths of a line: the flanks and the nearest line give both parts of the pole."""
    rng = np.random.default_rng([29, seed])
    natural = np.array([800.3, 1300.0 + LINE * rng.uniform(0.2, 0.4), 2600.0])
    zeta = np.array([0.012, 0.5 * width * LINE / natural[1], 0.03])
    estimate = modes(frfs := measured(structure(natural, zeta, 2, rng), 2, rng), stabilise(frfs))
    assert estimate.natural_frequencies == pytest.approx(natural, rel=1e-3)
    assert np.abs(deviations(estimate, natural, zeta)).max() < 5.5
    std = np.sqrt(estimate.covariance[1, 1, 1])
    assert std < 0.2 * zeta[1], "the data tell the damping, and so does its interval"


def of_random_force(seed: int, averages: int, noise: float, outputs: int):
    """H1 of four modes from blocks of a random force of a line each, with its coherence, and their frequencies."""
    draw = np.random.default_rng(seed)

    def gauss(*shape: int) -> np.ndarray:
        return (draw.normal(size=shape) + 1j * draw.normal(size=shape)) / np.sqrt(2)

    lines = np.arange(1.0, 801.0)
    wanted, damping = np.sort(draw.uniform(60, 740, 4)), draw.uniform(0.004, 0.02, 4)
    poles = 2 * np.pi * wanted * (-damping + 1j * np.sqrt(1 - damping**2))
    shapes, s = draw.normal(size=(outputs, 4)), 2j * np.pi * lines
    receptance = sum(
        np.outer(1 / (s - p) / (2j * p.imag) - 1 / (s - p.conj()) / (2j * p.imag), phi * phi[0])
        for p, phi in zip(poles, shapes.T, strict=True)
    )
    exact = receptance * (s**2)[:, None]
    force = gauss(averages, 800)
    size = noise * np.sqrt(np.mean(np.abs(exact) ** 2, axis=0))
    response = exact * force[..., None] + size * gauss(averages, 800, outputs)
    power, cross = np.sum(np.abs(force) ** 2, axis=0)[:, None], np.sum(response * force.conj()[..., None], axis=0)
    coherence = np.abs(cross) ** 2 / power / np.sum(np.abs(response) ** 2, axis=0)
    dofs = tuple(Dof(node, "+Z") for node in range(1, outputs + 1))
    averaged = np.full((outputs, 1), float(averages))
    values = (cross / power)[..., None]
    return wanted, FrfSet(
        lines, values, dofs, dofs[:1], "accelerance", coherence=coherence[..., None], averages=averaged
    )


@pytest.mark.parametrize(("averages", "noise", "outputs"), [(2, 0.2, 6), (1, 0.05, 6), (2, 0.05, 2)])
def test_single_lines_of_few_averages_are_no_modes(averages, noise, outputs):
    """Where the blocks have next to no force at a line, the FRF is noise there that no pooled variance tells."""
    for seed in range(100, 108):
        wanted, measured = of_random_force(seed, averages, noise, outputs)
        model = modes(measured, stabilise(measured))
        distance = np.abs(model.natural_frequencies[:, None] - wanted)
        assert np.all(distance.min(axis=1) < 0.02 * model.natural_frequencies), (seed, model.natural_frequencies)
        assert np.count_nonzero(distance.min(axis=0) < 0.02 * wanted) == 4, (seed, wanted)
