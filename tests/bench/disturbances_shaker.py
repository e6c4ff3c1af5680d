"""Errors that are not noise, put into the signals of a random shaker test and processed as a user would.

Force and responses are periodic in a time several times as long as the record, so that they are exact at all samples:
the record holds no whole number of periods and leakage is as in a test.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import irfft, rfftfreq

import ema.estimate
from ema.data import Channel, Condition, FrfSet, Recording, Run
from tests.bench.cases import Case, _accelerance
from tests.bench.disturbances import HIGH, LOW, Disturbed, Row, structure

RATE = 1280.0
"""Samples per second; the force ends at 560 Hz."""
SAMPLES = 2**16
PERIOD = 3 * 2**16
FORCE_BAND = (20.0, 560.0)
RESPONSE_NOISE = 0.002
"""Noise of the response channels over their rms."""
BLOCK = 2**13
"""Samples of Welch's blocks."""
LOCAL_SAMPLES, LOCAL_BLOCK = 2**15, 2**13
"""Samples of a record and of its blocks for the local model, which has no leakage."""


@dataclass(frozen=True)
class Test:
    """Spectra on the lines of the long period: force, responses, and the generator signal behind the force."""

    case: Case
    force: np.ndarray
    responses: np.ndarray
    generator: np.ndarray


def shaken(rng: np.random.Generator, shaker: float = 0.0, disturbance: float = 0.0) -> Test:
    """A structure on a shaker.

    Parameters
    ----------
    shaker : how strongly the structure pulls the force down at its resonances: F = V / (1 + c Y) with the drive-point
        mobility Y, c such that c Y is ``shaker`` at its largest in the band.
    disturbance : rms of an unmeasured force at the last output over that of the generator; it comes back through the
        shaker into the measured force.
    """
    case = structure(rng)
    frequencies = rfftfreq(PERIOD, 1 / RATE)
    band = (frequencies >= FORCE_BAND[0]) & (frequencies <= FORCE_BAND[1])
    f = frequencies[band]
    # By reciprocity the last output as a second input gives the responses to the unmeasured force.
    accelerance = _responses(case, f, [case.truth.dofs.index(case.truth.inputs[0]), len(case.truth.dofs) - 1])
    drive = accelerance[:, 0, 0] / (2j * np.pi * f)
    other = accelerance[:, 0, 1] / (2j * np.pi * f)
    coupling = shaker / np.abs(drive[(f >= LOW) & (f <= HIGH)]).max()
    generator, second = ((rng.standard_normal((2, len(f))).T @ np.array([1, 1j])) for _ in range(2))
    second = disturbance * second
    force = (generator - coupling * other * second) / (1 + coupling * drive)
    responses = accelerance[:, :, 0] * force[:, None] + accelerance[:, :, 1] * second[:, None]

    def whole(spectrum: np.ndarray) -> np.ndarray:
        full = np.zeros((len(frequencies), *spectrum.shape[1:]), complex)
        full[band] = spectrum
        return full

    return Test(case, whole(force), whole(responses), whole(generator))


def _responses(case: Case, frequencies: np.ndarray, rows: list[int]) -> np.ndarray:
    """Accelerance from the outputs of these rows, (freq, out, in)."""
    total = 0.0
    for model in (case.truth, case.outside):
        participation = model.shapes[rows] / (2j * model.poles.imag)
        inputs = tuple(model.dofs[row] for row in rows)
        total = total + _accelerance(replace(model, participation=participation, inputs=inputs), frequencies)
    return np.asarray(total)


def recorded(rng: np.random.Generator, test: Test, force_noise: float = 0.0, samples: int = SAMPLES) -> Run:
    """The record: force, responses, generator; noise of the force channel over its rms."""
    start = int(rng.integers(PERIOD - samples))
    signals = []
    for spectrum in (test.force, *test.responses.T, test.generator):
        signals.append(irfft(spectrum, PERIOD)[start : start + samples])
    rms = np.sqrt(np.mean(np.square(signals), axis=1))
    noise = np.array([force_noise, *[RESPONSE_NOISE] * test.responses.shape[1], 0.0])
    noisy = np.array(signals) + (noise * rms)[:, None] * rng.standard_normal((len(signals), samples))
    dofs = test.case.truth.dofs
    channels = (
        Channel("force", test.case.truth.inputs[0], quantity="force", role="reference", unit="N"),
        *(Channel(f"acc {dof}", dof, quantity="acceleration", unit="m/s^2") for dof in dofs),
        Channel("generator", role="other"),
    )
    return Run("shaker", Condition(), recordings=(Recording(noisy, RATE, channels, name="shaker"),))


def processed(test: Test, frfs: FrfSet) -> Disturbed:
    """The FRFs in the band, with the truth."""
    return Disturbed(replace(test.case, frfs=frfs.band(LOW, HIGH)))


def local(run: Run) -> FrfSet:
    """FRFs of the local model."""
    return ema.estimate.shaker(run, block=LOCAL_BLOCK)


def force_noise(rng: np.random.Generator, strength: float) -> Disturbed:
    """The force drops at the resonances (shaker), and its channel has flat noise of ``strength`` times its rms."""
    test = shaken(rng, shaker=10.0)
    return processed(test, local(recorded(rng, test, strength, LOCAL_SAMPLES)))


def interaction(rng: np.random.Generator, strength: float) -> Disturbed:
    """An unmeasured force acts, and comes back through the shaker: the force depends on the noise of the responses."""
    test = shaken(rng, shaker=10.0, disturbance=strength)
    return processed(test, local(recorded(rng, test, samples=LOCAL_SAMPLES)))


def short_blocks(rng: np.random.Generator, strength: float) -> Disturbed:
    """Hann blocks that are too short for the damping: samples of a block."""
    test = shaken(rng)
    return processed(test, ema.estimate.shaker(recorded(rng, test), method="welch", block=int(strength), overlap=0.5))


def overlapping(rng: np.random.Generator, strength: float) -> Disturbed:
    """Hann blocks that overlap by ``strength``: averages that are not independent."""
    test = shaken(rng)
    return processed(test, ema.estimate.shaker(recorded(rng, test), method="welch", block=BLOCK, overlap=strength))


ROWS = (
    Row(
        "force noise",
        "noise of the force channel over its rms, force notched by 20 dB",
        (0.0, 0.003, 0.01, 0.03, 0.1),
        force_noise,
        ("force-noise",),
    ),
    Row(
        "shaker interaction",
        "unmeasured force over the generator's",
        (0.0, 0.01, 0.03, 0.1, 0.3),
        interaction,
        ("shaker-interaction", "force-noise"),
    ),
    Row(
        "short blocks",
        "samples of a Hann block at 1280 Hz",
        (16384.0, 8192.0, 4096.0, 2048.0, 1024.0),
        short_blocks,
        ("leakage", "truncated-record"),
    ),
    Row(
        "overlap",
        "overlap of Hann blocks",
        (0.0, 0.5, 0.75, 0.875, 0.9375),
        overlapping,
        ("dependent-lines", "dependent-averages"),
    ),
)
"""The disturbances of shaker signals. The first strength of each is none."""
