"""Hammer tests with noise of the force channel, exact at all samples, on structures of known FRFs.

Forces are Gaussian pulses, whose spectrum falls by 20 dB at a frequency within the band; structures are those of
`tests.bench.disturbances`. Force and responses are periodic in the record, by the end of which the response is gone.

    python -m tests.bench.impact_noise [draws]

writes, by the noise of the force (its rms over that of the force within its window), number of impacts and window, bias
and coverage of H1 and of H1 less noise on lines within 10 dB of the low-frequency force, to -20 dB, and beyond.
"""

import sys
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ema.data import Channel, Condition, Excitation, FrfSet, Recording, Run
from ema.estimate import HammerSettings, hammer
from tests.bench.cases import Case
from tests.bench.disturbances import HIGH, LOW, structure
from tests.bench.disturbances_shaker import _responses

RATE = 2048.0
SAMPLES = 2**14
BEGIN = 0.25
"""Seconds before the middle of an impact."""
COVERED = 3.0
"""Squared error over its variance that is exceeded with a probability of 5 %: complex normal distribution."""


@dataclass(frozen=True)
class Test:
    """A hammer test, its structure, and the 20 dB frequency [Hz] of its impacts."""

    run: Run
    case: Case
    reach: float


def struck(
    rng: np.random.Generator,
    noise: float,
    impacts: int = 5,
    *,
    response_noise: float = 1e-3,
    coloured: float = 0.0,
    begin: float = BEGIN,
) -> Test:
    """Impacts at the first point, one a record.

    Parameters
    ----------
    noise : rms of the noise of the force over that of the first impact within four standard deviations of its middle.
    response_noise : noise of the responses over their largest values.
    coloured : autoregressive coefficient of the noise of the force.
    begin : seconds before the middle of an impact.
    """
    case = structure(rng)
    reach = float(rng.uniform(0.7, 0.9)) * HIGH
    frequencies = np.fft.rfftfreq(SAMPLES, 1 / RATE)
    sigma = np.sqrt(np.log(100.0)) / (2 * np.pi * reach)
    pulse = np.exp(-0.5 * (2 * np.pi * frequencies * sigma) ** 2) * np.sqrt(2 * np.pi) * sigma * RATE
    pulse = pulse * np.exp(-2j * np.pi * frequencies * begin)
    spectra = _responses(case, frequencies, [case.truth.dofs.index(case.truth.inputs[0])])[:, :, 0] * pulse[:, None]
    clean = np.fft.irfft(np.column_stack([pulse, spectra]), SAMPLES, axis=0).T
    # The mean square over 8 sigma is the peak's square times sqrt(pi) / 8.
    rms = noise * np.sqrt(np.sqrt(np.pi) / 8)
    channels = (
        Channel("hammer", case.truth.inputs[0], quantity="force", role="reference", unit="N"),
        *(Channel(f"acc {dof}", dof, quantity="acceleration", unit="m/s^2") for dof in case.truth.dofs),
    )
    records = []
    for number in range(impacts):
        signals = clean * 50 * float(rng.uniform(0.8, 1.25))
        white = rng.standard_normal(signals.shape)
        for sample in range(1, SAMPLES if coloured else 0):
            white[0, sample] = coloured * white[0, sample - 1] + np.sqrt(1 - coloured**2) * white[0, sample]
        size = np.array([50 * rms, *response_noise * np.abs(signals[1:]).max(axis=1)])
        records.append(Recording(signals + size[:, None] * white, RATE, channels, name=f"impact_{number}"))
    return Test(Run("bare", Condition(Excitation("hammer")), tuple(records)), case, reach)


def judged(test: Test, frfs: FrfSet) -> np.ndarray:
    """Mean of H over the true one less 1, and coverage, in each of the three bands of the force: (band, 2)."""
    frfs = frfs.band(LOW, HIGH)
    wanted = _responses(test.case, frfs.frequencies, [test.case.truth.dofs.index(test.case.truth.inputs[0])])
    covered = np.abs(frfs.values - wanted) ** 2 < COVERED * frfs.variance
    large = np.abs(wanted) > np.median(np.abs(wanted), axis=0)
    edges = [0.0, test.reach * np.sqrt(0.5), test.reach, np.inf]
    rows = []
    for low, high in pairwise(edges):
        inside = (frfs.frequencies >= low) & (frfs.frequencies < high)
        ratio = (frfs.values / wanted)[inside]
        rows.append([np.mean(ratio[large[inside]]).real - 1, np.mean(covered[inside])])
    return np.array(rows)


def main(draws: int = 20) -> None:
    """Write the table."""
    print("noise  impacts  window  estimate  bias %, coverage % to -10 dB, to -20 dB, beyond")
    for windowed in (True, False):
        for impacts in (3, 10):
            for noise in (0.01, 0.03, 0.1):
                rows: dict[bool, list[np.ndarray]] = {False: [], True: []}
                for seed in range(draws):
                    rng = np.random.default_rng([9100, seed, impacts, round(1000 * noise), windowed])
                    test = struck(rng, noise, impacts)
                    for less, own in rows.items():
                        settings = HammerSettings(window_force=windowed, decay=0.0, less_noise=less)
                        own.append(judged(test, hammer(test.run, settings)))
                for less, own in rows.items():
                    text = "   ".join(f"{bias:6.2f} {covered:5.1f}" for bias, covered in 100 * np.mean(own, axis=0))
                    print(f"{noise:5g}  {impacts:7d}  {windowed!s:6}  {'less' if less else 'H1':8}  {text}", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
