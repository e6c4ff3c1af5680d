"""Homogeneity and causality of FRFs of one mode with a Masing joint, against closed-form steady states."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from ema import estimate
from ema.data import Condition, Excitation, FrfSet
from ema.dof import Dof
from ema.errors import InputError
from tests.closed_forms import masing_oscillator

ZETA = 0.00638
LINES = np.arange(440.0, 580.0, 0.25)


def masing_frf(slip_over_force, kappa=0.03):
    """First harmonic of an oscillator of unit mass with a Masing spring kappa w^2."""
    return masing_oscillator(LINES, 499.0, ZETA, slip_over_force, kappa)[0]


def measured(values, level, noise=0.0, seed=0):
    rng = np.random.default_rng(seed)
    sigma = noise * np.abs(values).max()
    noisy = values + sigma / np.sqrt(2) * (rng.standard_normal(len(values)) + 1j * rng.standard_normal(len(values)))
    return FrfSet(
        LINES,
        noisy[:, None, None],
        (Dof.parse("1:+Z"),),
        (Dof.parse("2:+Z"),),
        "receptance",
        variance=np.full((len(values), 1, 1), sigma**2) if noise else None,
        condition=Condition(Excitation("sweep", level)),
    )


def test_a_linear_structure_is_homogeneous_and_causal():
    stuck = masing_frf(1e9)
    found = estimate.homogeneity(measured(stuck, 10.0), measured(stuck, 20.0))
    assert found.index == pytest.approx(0, abs=1e-9)
    assert found.side == "undecided"
    assert found.levels == (10.0, 20.0)
    assert not found.findings
    assert estimate.causality(measured(stuck, 10.0))[0, 0] < 1e-6


def change(ratio, kappa):
    """||H(2F) - H(F)|| / ||H(F)|| within ten half-power bandwidths of the peak, from the closed forms alone."""
    lower, higher = masing_frf(ratio, kappa), masing_frf(ratio / 2, kappa)
    inside = np.abs(LINES - LINES[np.argmax(np.abs(lower))]) <= 10 * 2 * ZETA * 499.0
    return np.linalg.norm((higher - lower)[inside]) / np.linalg.norm(lower[inside])


@pytest.mark.parametrize("kappa", [0.03, 0.05, 0.09])
@pytest.mark.parametrize("ratio", [0.05, 0.1, 0.2, 0.3])
def test_a_slipping_joint_shows_in_the_index_of_a_doubled_force(ratio, kappa):
    """The index is that of the closed forms within 3 %. At a slip force of a fifth of the excitation it is at least 0.15
    for joints from 0.05 of the stiffness on; for 0.03 the closed forms say 0.147, which is 0.15 in two digits only."""
    found = estimate.homogeneity(measured(masing_frf(ratio, kappa), 10.0), measured(masing_frf(ratio / 2, kappa), 20.0))
    assert found.index == pytest.approx(change(ratio, kappa), rel=0.03)
    if ratio == 0.2:
        assert found.index >= (0.15 if kappa >= 0.05 else 0.1465)
    assert found.side == "slip"
    assert bool(found.findings) == (found.index > 0.05)


def test_the_sign_tells_the_side_of_the_most_damping():
    """60 ratios from 0.05 to 4 with 1 % noise, except those within 20 % of the change-over, at which twice the force
    leaves the closed-form peak as high as it was: the side is right in 95 of 100 or more."""

    def growth(ratio):
        return np.abs(masing_frf(ratio / 2)).max() / np.abs(masing_frf(ratio)).max() - 1

    over = brentq(growth, 0.8, 1.2)
    assert 0.9 < over < 1.0
    rng = np.random.default_rng(30)
    ratios = np.exp(rng.uniform(np.log(0.05), np.log(4.0), 90))
    ratios = ratios[np.abs(np.log(ratios / over)) > np.log(1.2)][:60]
    sides = [
        estimate.homogeneity(
            measured(masing_frf(ratio), 10.0, 0.01, 2 * n), measured(masing_frf(ratio / 2), 20.0, 0.01, 2 * n + 1)
        ).side
        for n, ratio in enumerate(ratios)
    ]
    right = [side == ("slip" if ratio < over else "stick") for side, ratio in zip(sides, ratios, strict=True)]
    assert np.mean(right) >= 0.95, [(round(float(r), 3), s) for r, s, ok in zip(ratios, sides, right) if not ok]


def test_beyond_a_third_a_linear_fit_has_no_meaning():
    found = estimate.homogeneity(measured(masing_frf(1.0), 10.0), measured(masing_frf(0.5), 20.0))
    assert found.index > 0.3
    assert found.findings[0].severity == "error"


def test_noise_is_taken_off():
    stuck = masing_frf(1e9)
    indices = [
        estimate.homogeneity(measured(stuck, 10.0, 0.02, 2 * n), measured(stuck, 20.0, 0.02, 2 * n + 1)).index
        for n in range(20)
    ]
    assert np.median(indices) < 0.02
    slipping = estimate.homogeneity(measured(masing_frf(0.2), 10.0, 0.02, 5), measured(masing_frf(0.1), 20.0, 0.02, 6))
    assert slipping.index == pytest.approx(0.147, rel=0.2)


def test_causality_rises_with_slip():
    linear, little, much = (estimate.causality(measured(masing_frf(r), 1.0))[0, 0] for r in (1e9, 0.2, 1.0))
    assert little > 100 * linear
    assert much > 10 * little
    assert much == pytest.approx(2e-3, rel=0.3)


def test_bad_input_is_told_in_a_sentence():
    one = measured(masing_frf(1e9), 10.0)
    with pytest.raises(InputError, match="different lines"):
        estimate.homogeneity(one, replace(one, frequencies=LINES + 0.1))
    with pytest.raises(InputError, match="different DOFs"):
        estimate.homogeneity(one, replace(one, outputs=(Dof.parse("7:+Z"),)))
    broken = one.values.copy()
    broken[3] = np.nan
    with pytest.raises(InputError, match="NaN"):
        estimate.causality(replace(one, values=broken))
    with pytest.raises(InputError, match="outside"):
        estimate.homogeneity(one, one, near=50.0)
