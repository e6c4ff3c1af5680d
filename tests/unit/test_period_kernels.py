"""Forces of a Masing spring over a period in closed form, against one followed through samples."""

import numpy as np
import pytest

from ema.simulate.harmonic_kernels import contact_forces

ODD = 2 * np.arange(24) + 1
WAVY = 1e-3 * np.array(
    [
        -19427,
        6458,
        1917,
        -1699,
        -599,
        -630,
        434,
        66,
        88,
        255,
        -176,
        -40,
        -29,
        101,
        -43,
        -22,
        9,
        -35,
        38,
        -41,
        118,
        125,
        -144,
        -21,
        -31,
        18,
        -8,
        -11,
        -1,
        8,
        17,
        11,
        1,
        5,
        -1,
        6,
        -10,
        4,
        -2,
        -6,
        2,
        -2,
        6,
        6,
        1,
        4,
        -7,
        1,
    ]
)
"""A motion that halts again and again; Newton's steps to where it slides go to and fro between two of its halts."""


def closed_form(amplitudes, limit):
    """Harmonics of f - k u with k = 1, in closed form."""
    angle = np.linspace(0.0, np.pi, 4 * ODD[-1] + 5)[:, None] * ODD
    cosine, sine = amplitudes[::2], amplitudes[1::2]
    rates = np.cos(angle) @ (ODD * sine) - np.sin(angle) @ (ODD * cosine)
    bends = -np.cos(angle) @ (ODD**2 * cosine) - np.sin(angle) @ (ODD**2 * sine)
    forces, jacobian, lost, _ = contact_forces(
        amplitudes[None],
        (ODD, np.array([rates, bends])[:, None], 1, 1.0),
        (np.ones(1), np.array([limit]), np.zeros((1, 1), np.int64)),
        (np.ones(1, np.int64), np.ones((1, 1)), np.ones((1, 1)), np.ones(1)),
        None,
        None,
        True,
    )
    return forces[0], lost[0], jacobian[0, 0]


def followed(amplitudes, limit, count=20000):
    """The same from samples."""
    angle = 2 * np.pi * np.arange(2 * count + 1)[:, None] / count * ODD
    motion = np.cos(angle) @ amplitudes[::2] + np.sin(angle) @ amplitudes[1::2]
    force, forces = 0.0, [0.0]
    for step in np.diff(motion):
        force = min(max(force + step, -limit), limit)
        forces.append(force)
    settled = np.array(forces[count:])
    rest = settled[:-1] - motion[count:-1]
    waves = 2 / count * np.array([rest @ np.cos(angle[count:-1]), rest @ np.sin(angle[count:-1])])
    return waves.T.ravel(), 0.5 * (settled[1:] + settled[:-1]) @ np.diff(motion[count:])


@pytest.mark.parametrize("limit", [0.3, 1.0045, 1.00475, 1.005, 3.0])
def test_a_motion_that_nearly_halts(limit):
    forces, lost, _ = closed_form(WAVY, limit)
    expected, area = followed(WAVY, limit)
    np.testing.assert_allclose(forces, expected, atol=1e-5 * limit)
    assert lost == pytest.approx(area, rel=1e-5)


@pytest.mark.parametrize("limit", [0.3, 1.005])
def test_its_derivatives(limit):
    direction = np.random.default_rng(0).normal(size=len(WAVY))
    jacobian = closed_form(WAVY, limit)[2]
    up, down = (closed_form(WAVY + step * direction, limit)[0] for step in (1e-6, -1e-6))
    np.testing.assert_allclose((up - down) / 2e-6, jacobian @ direction, atol=1e-4)
