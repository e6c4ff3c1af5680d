"""Noise that is not independent from line to line is no resonance, and takes no time."""

from dataclasses import replace

import numpy as np
from scipy.signal import savgol_coeffs

from ema.fit import stabilise
from ema.fit.modal import estimated, reconstruction_error
from tests.unit.fit_rig import frfs, model

HANN = np.array([0.245, 1.0, 0.245])
"""Moving sum whose output correlates over lines as averaged H1 of Hann blocks does: 0.44 = (2/3)^2 next to each other
(the product of two spectra, each with the correlation 2/3 of the Hann window)."""
LOCAL = np.ones(9)
"""The same of a local model over nine lines, roughly."""
POLYNOMIAL = savgol_coeffs(9, 2)
"""That of a local model of second degree over nine lines (Savitzky and Golay 1964)."""
LEVEL = 0.01


def measured(kernel, seed, lines, outputs=16):
    """A structure with four modes and noise of a known level, smoothed over the lines."""
    truth = model([100.0, 142.0, 197.0, 251.0], [0.012, 0.008, 0.015, 0.006], dofs=outputs, seed=seed)
    exact = frfs(truth, 70, 300, lines)
    rng = np.random.default_rng([77, seed])
    std = LEVEL * np.sqrt(np.mean(np.abs(exact.values) ** 2, axis=0))
    shape = (lines + len(kernel) - 1, outputs, 1)
    white = np.sqrt(0.5) * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))
    noise = sum(white[k : k + lines] * weight for k, weight in enumerate(kernel / np.linalg.norm(kernel)))
    variance = np.broadcast_to(std**2, exact.values.shape)
    return truth, replace(exact, values=exact.values + std * noise, variance=variance)


def test_correlated_noise_leaves_no_poles_in_the_fit():
    for kernel, lines in ((HANN, 3201), (HANN, 801), (LOCAL, 801), (POLYNOMIAL, 801)):
        further, off = [], []
        for seed in range(8):
            truth, found = measured(kernel, seed, lines)
            estimate = estimated(found, stabilise(found))
            accepted = estimate.model()
            assert len(accepted.poles) == 4
            further.append(len(estimate.optimum.fit.poles) - 4)
            std = np.sqrt(accepted.covariance[:, 0, 0])
            off.append((accepted.natural_frequencies - truth.natural_frequencies) / std)
        # White noise leaves a pole in one fit of a hundred.
        assert sum(further) <= 2, further
        # 32 deviations: beyond 4 stated ones by chance once in 500 runs of other seeds.
        assert np.max(np.abs(off)) < 4


def test_wide_resonances_of_a_local_model_hold_in_their_intervals():
    """Nothing is left that tells whether a peak of 25 lines or more was averaged over nine as its noise was."""
    truth = model([110.0, 190.0, 260.0], [0.04, 0.03, 0.035], dofs=16, seed=4)
    exact = frfs(truth, 70, 300, 801)
    rng = np.random.default_rng(4)
    std = 5 * LEVEL * np.sqrt(np.mean(np.abs(exact.values) ** 2, axis=0))
    white = np.sqrt(0.5) * (rng.standard_normal((809, 16, 1, 2)) @ [1, 1j])
    noise = np.apply_along_axis(np.convolve, 0, white, POLYNOMIAL / np.linalg.norm(POLYNOMIAL), "valid")
    found = replace(
        exact, values=exact.values + std * noise, variance=np.broadcast_to(std**2, exact.values.shape).copy()
    )
    result = estimated(found, stabilise(found)).model()
    stated = np.sqrt(result.covariance[:, [0, 1], [0, 1]])
    assert len(result.poles) == 3
    assert np.all(np.abs(result.natural_frequencies - truth.natural_frequencies) < 5 * stated[:, 0])
    assert np.all(np.abs(result.damping_ratios - truth.damping_ratios) < 5 * stated[:, 1])
    _, error = reconstruction_error(found, truth)
    assert error.max() < 6 * LEVEL
