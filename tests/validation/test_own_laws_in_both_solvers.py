"""A law of a user's own does what the built-in law of the same form does, and a rule of steps what it tends to."""

import math
from itertools import pairwise

import numpy as np
import pytest

from ema.simulate import Dahl, Masing, Section, double_beam, frf, register_law, snapback
from ema.simulate.loops import drive

TIP = "beam 2:4:+Z"
FREQUENCIES = np.linspace(10, 40, 5)


def clip(force, du, k, limit, p0, p1, p2, p3):
    return min(max(force + k * du, -limit), limit)


def closed_form(force, du, k, limit, p0, p1, p2, p3):
    if limit <= 0.0:
        return 0.0
    sign = 1.0 if du >= 0.0 else -1.0
    return force - sign * (limit - sign * force) * math.expm1(-k * abs(du) / limit)


def first_order(force, du, k, limit, p0, p1, p2, p3):
    """Dahl's law in explicit steps."""
    if limit <= 0.0:
        return 0.0
    way = force / limit if du > 0.0 else -force / limit
    return min(max(force + k * (1.0 - way) * du, -limit), limit)


def with_floor(force, du, k, limit, p0, p1, p2, p3):
    """The example of the documentation."""
    if limit <= 0.0:
        return 0.0
    way = force / limit if du > 0.0 else -force / limit
    return min(max(force + k * max(1.0 - way, p0) * du, -limit), limit)


PAIRS = {
    "clip": (register_law("clip as Masing", clip)(0.3, 1e9), Masing(0.3, 1e9)),
    "closed form": (register_law("closed form as Dahl", closed_form)(0.3, 1e9), Dahl(0.3, 1e9)),
    "steps": (register_law("steps as Dahl", first_order)(0.3, 1e9), Dahl(0.3, 1e9)),
}


def model(law):
    return double_beam(law, 1000.0, Section(0.5, 0.04, 0.005, elements=4))


@pytest.mark.parametrize("name", PAIRS)
def test_steady_states_are_those_of_the_built_in_law(name):
    """With the same harmonics nothing but the quadrature differs, which is refined to 1e-6 of the forces."""
    own, built_in = (frf(model(law), FREQUENCIES, 1.0, TIP, [TIP]) for law in PAIRS[name])
    assert own.orders[-1] == built_in.orders[-1]
    first = built_in.values[:, 0, 0]
    assert (abs(own.values[:, 0, 0] - first) <= 1e-5 * abs(first)).all()
    assert (own.error_estimate <= 1.01 * np.maximum(built_in.error_estimate, 0.004)).all()
    assert own.power_error < 1e-6


@pytest.mark.parametrize("name", PAIRS)
def test_free_decays_are_those_of_the_built_in_law(name):
    own, built_in = (snapback(model(law), 20.0, TIP, 0.02).displacements for law in PAIRS[name])
    np.testing.assert_allclose(own, built_in, atol=2e-6 * abs(built_in).max())


def test_a_rule_of_steps_is_followed_to_steps_without_length():
    """Along paths of 4 reversals with few points, against dF/du = k (1 - F/F_C) in closed form, then the
    floor, then sliding."""
    rng, k, limit, floor = np.random.default_rng(20261130), 1e6, 100.0, 0.05
    law = register_law("floor along paths", with_floor)(1.0, k, floor)
    turns = np.concatenate([[0.0], np.resize([1.0, -1.0], 5) * rng.uniform(0.3, 6.0, 5) * limit / k])

    force, exact = 0.0, [0.0]
    for a, b in pairwise(turns):
        sign = np.sign(b - a)
        kink, w = limit * (1.0 - floor), abs(b - a)
        start = sign * force
        if start < kink:
            to_kink = limit / k * math.log((limit - start) / (limit - kink))
            if w <= to_kink:
                force = sign * (limit - (limit - start) * math.exp(-k * w / limit))
                exact.append(force)
                continue
            start, w = kink, w - to_kink
        force = sign * min(start + floor * k * w, limit)
        exact.append(force)
    np.testing.assert_allclose(drive(law, turns, limit), exact, atol=1e-8 * limit)
