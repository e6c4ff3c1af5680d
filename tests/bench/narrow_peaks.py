"""Peaks of a few lines in random tests: what is stated of them, what the spectra allow, and what the errors are.

python -m tests.bench.narrow_peaks --lines 1,2,4,8,16 --draws 60
"""

import argparse

import numpy as np

import ema.fit
from ema.data import Channel, Condition, Excitation, Recording, Run
from ema.dof import Dof
from ema.estimate.random_excitation import shaker


def narrow_peak(seed, lines):
    """Record of a mode near 25 Hz whose peak is so many lines wide, in a random test with three responses in 2 % noise.

    Also its pole, the standard deviation of the noise, and spectra of force and responses of both halves.
    """
    rng = np.random.default_rng([seed, lines])
    rate, samples = 128.0, 4096
    half = samples // 2
    natural = 25 + rng.uniform(-2, 2)
    zeta = lines * rate / half / (2 * natural)
    pole = 2 * np.pi * natural * (-zeta + 1j * np.sqrt(1 - zeta**2))
    s = 2j * np.pi * np.arange(2 * samples + 1) * rate / (4 * samples)
    force = rng.standard_normal(s.shape) + 1j * rng.standard_normal(s.shape)
    force[[0, -1]] = 0
    shape = np.array([1.0, -0.7, 0.5])
    motion = shape[:, None] * s**2 / ((s - pole) * (s - np.conj(pole))) * force
    signals = np.fft.irfft(np.vstack([force, motion]), 4 * samples)[:, :samples]
    noise = 0.02 * np.std(signals[1:], axis=1, keepdims=True)
    signals[1:] += noise * rng.standard_normal((3, samples))
    spectra = np.fft.rfft(signals.reshape(4, 2, half), axis=2)[:, :, 1:-1]
    channels = [Channel("force", Dof(1, "+Z"), quantity="force", unit="N", role="reference")]
    channels += [Channel(f"acc {k}", Dof(k, "+Z"), quantity="acceleration", unit="m/s^2") for k in (1, 2, 3)]
    run = Run("random", Condition(Excitation("random")), (Recording(signals, rate, tuple(channels)),))
    return run, pole, noise[:, 0], spectra, 2j * np.pi * np.arange(1, half // 2) * rate / half


def least_std(pole, noise, spectra, s):
    """Standard deviation of the imaginary part of the pole [rad/s] at best, by the spectra on 301 lines around it: the
    residue, a background linear in the frequency, and the transient of each half with one of its own are unknown.
    """
    near = np.abs(s.imag - pole.imag) < 150.5 * (s[1] - s[0]).imag
    s, force = s[near], spectra[0][:, near]
    smooth = np.array([np.ones_like(s), (s - s.mean()) / np.abs(s).max()])
    information = 0.0
    for response, level in zip(spectra[1:], noise, strict=True):
        own = np.concatenate([[s**2 / (s - pole)], smooth])
        columns = [np.concatenate([function * one for one in force]) for function in own]
        for block in range(2):
            for function in np.concatenate([[1 / (s - pole)], smooth]):
                columns.append(np.concatenate([function * (place == block) for place in range(2)]))
        matrix = np.array(columns).T
        matrix /= np.linalg.norm(matrix, axis=0)
        basis, triangle = np.linalg.qr(matrix)
        values = np.concatenate(response[:, near])
        amplitudes = np.linalg.solve(triangle, basis.conj().T @ values)
        moved = sum(amplitudes[k] * matrix[:, k] / np.tile(s - pole, 2) for k in (0, 3, 6))
        moved = moved - basis @ (basis.conj().T @ moved)
        # A line of a block of n samples has noise of n times the variance of a sample.
        information += 2 * np.vdot(moved, moved).real / (2 * (spectra.shape[2] + 1) * level**2)
    return 1 / np.sqrt(information)


def compared(seed: int, lines: int) -> tuple[float, np.ndarray]:
    """Stated over least standard deviation of the frequency, and errors of f and damping over what is stated; NaN where
    no mode was found."""
    run, pole, noise, spectra, s = narrow_peak(seed, lines)
    frfs = shaker(run).band(15.0, 35.0)
    modes = ema.fit.modes(frfs, ema.fit.stabilise(frfs))
    natural = abs(pole) / (2 * np.pi)
    if not len(modes.poles):
        return np.nan, np.full(2, np.nan)
    nearest = int(np.argmin(np.abs(modes.natural_frequencies - natural)))
    stated = np.sqrt(modes.covariance[nearest, [0, 1], [0, 1]])
    errors = np.array(
        [modes.natural_frequencies[nearest] - natural, modes.damping_ratios[nearest] + pole.real / abs(pole)]
    )
    return float(2 * np.pi * stated[0] / least_std(pole, noise, spectra, s)), errors / stated


def main() -> None:
    """Print a line for each width."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lines", default="1,2,4,8,16")
    parser.add_argument("--draws", type=int, default=60)
    options = parser.parse_args()
    for lines in map(int, options.lines.split(",")):
        ratios, errors = zip(*(compared(seed, lines) for seed in range(options.draws)), strict=True)
        kept = np.array(errors)[np.isfinite(ratios)]
        inside, rms = np.mean(np.abs(kept) <= 1.96, axis=0), np.sqrt(np.mean(np.square(kept), axis=0))
        print(
            f"{lines} lines: stated over the bound {np.nanmedian(ratios):.2f}; rms error over stated: f {rms[0]:.2f}, "
            f"zeta {rms[1]:.2f}; inside: f {inside[0]:.0%}, zeta {inside[1]:.0%}; "
            f"no mode in {len(errors) - len(kept)} of {len(errors)}",
            flush=True,
        )


if __name__ == "__main__":
    main()
