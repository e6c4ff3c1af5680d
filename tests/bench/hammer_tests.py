"""Hammer tests of random systems, from signals on and from the first line of the band: are all modes found, none false,
and do their intervals hold the truth?

Signals come from the exact FRFs by the discrete Fourier transform of a period four times as long as a record, under a
force without content beyond the band: the vibration decays in it, nothing is aliased, and nothing comes from the code
that estimates FRFs.

    python -m tests.bench.hammer_tests --seed 6001 --systems 60
"""

import argparse
from dataclasses import dataclass, replace

import numpy as np

import ema.fit
from ema.data import Channel, Condition, FrfSet, ModalModel, Recording, Run
from ema.data.modal import poles_from
from ema.dof import Dof
from ema.estimate import hammer
from ema.synthesis import frfs as synthesise

RATE, SAMPLES, BEFORE = 5120.0, 8192, 256
"""Samples per second, of an impact and before it."""
IMPACTS = 5
FROM = (0.0, 1.0, 5.0, 20.0)
"""Hz, first lines of the bands, in turn: a force and a response at rest have no line at 0 Hz worth anything."""
TO = (2000.0, 1200.0)
REACH = 1.96
NOT_LINEAR = ("force-noise", "leaning-peak", "broadened-peak", "smoothed-lines")


@dataclass(frozen=True)
class Test:
    """A run, its band in Hz, and the structure."""

    __test__ = False

    run: Run
    band: tuple[float, float]
    truth: ModalModel

    def measured(self) -> FrfSet:
        """FRFs of the run in its band."""
        return hammer(self.run).band(*self.band)


def drawn_test(seed: int, number: int) -> Test:
    """A structure of 1 to 6 modes from 25 to 900 Hz, 2 to 4 points struck, one or two accelerometers."""
    rng = np.random.default_rng([seed, number])
    count, points, sensors = int(rng.integers(1, 7)), int(rng.integers(2, 5)), int(rng.integers(1, 3))
    band = FROM[number % 4], TO[number // 4 % 2]
    natural = np.sort(np.exp(rng.uniform(np.log(25), np.log(900), count)))
    while np.min(np.diff(natural) / natural[1:], initial=1) < 0.1:
        natural = np.sort(np.exp(rng.uniform(np.log(25), np.log(900), count)))
    # Decays to a thousandth within the record, so that no window hides anything.
    least = np.log(1e3) / (2 * np.pi * natural * (SAMPLES - BEFORE) / RATE)
    zeta = np.maximum(np.exp(rng.uniform(np.log(0.003), np.log(0.03), count)), least)
    dofs = tuple(Dof(node, "+Z") for node in range(1, points + 1))
    # No mode has a node at every point: each is there in some FRF as well as in any.
    shapes = rng.choice([-1.0, 1.0], (points, count)) * rng.uniform(0.3, 1.0, (points, count)) * natural**0.25
    poles = poles_from(natural, zeta)
    truth = ModalModel(poles, shapes.astype(complex), dofs, shapes / (2j * poles.imag), dofs, scaling="unit modal mass")
    noise = np.exp(rng.uniform(np.log(1e-4), np.log(1e-2)))
    period = 4 * SAMPLES
    frequencies = np.fft.rfftfreq(period, 1 / RATE)
    values = np.zeros((len(frequencies), points, points), complex)
    values[1:] = synthesise(truth, frequencies[1:], "accelerance", dofs, dofs).values
    channels = (
        Channel("hammer", dofs[0], quantity="force", unit="N", role="reference"),
        *(Channel(f"acc {dof}", dof, quantity="acceleration", unit="m/s^2") for dof in dofs[:sensors]),
    )
    takes = []
    for point, dof in enumerate(dofs):
        blocks = []
        for _ in range(IMPACTS):
            force = rng.uniform(50, 150) * _pulse(frequencies, rng.uniform(2e-4, 2.8e-4))
            motion = values[:, :sensors, point].T * force
            signals = np.fft.irfft(np.vstack([force, motion]), period) * RATE
            signals = np.roll(signals, BEFORE, axis=1)[:, :SAMPLES]
            level = noise * np.sqrt(np.mean(signals[1:] ** 2, axis=1, keepdims=True))
            signals[1:] += level * rng.standard_normal(signals[1:].shape)
            signals[0] += 1e-4 * signals[0].max() * rng.standard_normal(SAMPLES)
            blocks.append(signals)
        struck = (replace(channels[0], dof=dof), *channels[1:])
        takes.append(Recording(np.hstack(blocks), RATE, struck, name=f"point {point + 1}"))
    return Test(Run("hammer", Condition(), tuple(takes)), band, truth)


def _pulse(frequencies: np.ndarray, width: float) -> np.ndarray:
    """Spectrum of a Gaussian pulse of a standard deviation [s]: 45 to 90 dB down at the Nyquist frequency."""
    return np.asarray(1e-3 * np.exp(-0.5 * (2 * np.pi * frequencies * width) ** 2))


@dataclass(frozen=True)
class Score:
    """Errors of frequency and damping ratio over what is stated (mode, 2); modes there are, missed and false; tests of
    which a peak was named as that of no linear mode.
    """

    errors: np.ndarray
    modes: int
    missed: int
    false: int
    named: int

    @property
    def inside(self) -> np.ndarray:
        """Share of the frequencies and damping ratios of the modes found inside their 95 % intervals."""
        return np.asarray(np.mean(np.abs(self.errors) <= REACH, axis=0))


def score(made: Test) -> Score:
    """What the fit of a test finds and states against its truth."""
    frfs = made.measured()
    found = ema.fit.modes(frfs, ema.fit.stabilise(frfs))
    natural, zeta = made.truth.natural_frequencies, made.truth.damping_ratios
    inside = (natural > made.band[0]) & (natural < made.band[1])
    errors, hit = [], set()
    for frequency, damping in zip(natural[inside], zeta[inside], strict=True):
        away = np.abs(found.natural_frequencies / frequency - 1)
        if away.min(initial=1) > max(damping, 1e-3):
            continue
        nearest = int(np.argmin(away))
        hit.add(nearest)
        values = found.natural_frequencies[nearest] - frequency, found.damping_ratios[nearest] - damping
        errors.append(np.array(values) / np.sqrt(found.covariance[nearest, [0, 1], [0, 1]]))
    modes = int(np.count_nonzero(inside))
    missed, false = modes - len(errors), len(found.poles) - len(hit)
    named = any(finding.code in NOT_LINEAR for finding in found.findings)
    return Score(np.array(errors).reshape(-1, 2), modes, missed, false, int(named))


def together(scores: list[Score]) -> Score:
    """Scores of several tests as one."""
    counts = np.array([[one.modes, one.missed, one.false, one.named] for one in scores]).sum(axis=0)
    return Score(np.concatenate([one.errors for one in scores]), *(int(count) for count in counts))


def main() -> None:
    """Score the tests and print what came out."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=6001)
    parser.add_argument("--systems", type=int, default=60)
    options = parser.parse_args()
    scores = []
    for number in range(options.systems):
        scores.append(score(drawn_test(options.seed, number)))
        so_far = together(scores)
        print(
            f"{number + 1} systems, {so_far.modes} modes, {so_far.missed} missed, {so_far.false} false, {so_far.named} "
            f"tests named; "
            f"inside: f {so_far.inside[0]:.1%}, zeta {so_far.inside[1]:.1%}; this one {scores[-1].missed} missed, "
            f"{scores[-1].false} false, largest error {np.abs(scores[-1].errors).max(initial=0):.1f} std",
            flush=True,
        )


if __name__ == "__main__":
    main()
