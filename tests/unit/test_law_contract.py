"""What every friction law keeps: built-in laws over the ranges of their parameters, and faulty laws of a user's own."""

import math

import numpy as np
import pytest

from ema.contact.catalogue import CATALOGUE
from ema.contact.laws import check_contract
from ema.errors import InputError
from ema.simulate import (
    BoucWen,
    Coulomb,
    Dahl,
    Iwan,
    LuGre,
    Masing,
    ModifiedIwan,
    ParallelMasing,
    RegularisedMasing,
    RoughContact,
    Section,
    Valanis,
    double_beam,
    frf,
    loop,
    register_law,
    snapback,
)

MU, K = 0.3, 1e6
BUILT_IN = [
    Masing(MU, K),
    Coulomb(MU, 1e12),
    ParallelMasing(MU, K, [0.5, 0.3, 0.2], [0.0, 0.3, 0.7]),
    *(
        Iwan(MU, K, chi, beta, springs)
        for chi in (-0.99, -0.5, 0.0)
        for beta in (0.0, 1.0, 20.0)
        for springs in (2, 60)
    ),
    *(ModifiedIwan(MU, K, chi) for chi in (0.5, 1.0)),
    *(RoughContact(MU, 1e-6, 0.3, t, springs) for t in (None, 0.5, 3.0, 6.0) for springs in (2, 60)),
    *(RegularisedMasing(MU, K, m) for m in (0.05, 1.0, 8.0, 100.0)),
    *(BoucWen(MU, K, n, gamma) for n in (0.05, 1.0, 8.0, 60.0) for gamma in (-1.0, 0.0, 0.3, 0.5)),
    *(Dahl(MU, K, shape) for shape in (0.05, 0.5, 1.0, 2.0, 10.0)),
    *(Valanis(MU, K, kappa) for kappa in (0.0, 0.5, 0.9, 0.999)),
    *(LuGre(MU, K, 1e4, 1e3, ratio, velocity) for ratio in (1.0, 1.3, 3.0) for velocity in (1e-6, 1.0)),
]


def test_built_in_laws_keep_it_over_the_ranges_of_their_parameters():
    assert {law.name for law in BUILT_IN} == set(CATALOGUE)
    for law in BUILT_IN:
        check_contract(law, law.contact_stiffness)


def clip(force, du, k, limit, p0, p1, p2, p3):
    return min(max(force + k * du, -limit), limit)


def one_sided(force, du, k, limit, p0, p1, p2, p3):
    return min(max(force + k * du, -0.5 * limit), limit)


def below(force, du, k, limit, p0, p1, p2, p3):
    return min(max(force + k * du, -0.4 * limit), 0.4 * limit)


def reach_of_a_length(force, du, k, limit, p0, p1, p2, p3):
    return min(max(force + min(k, limit / 1e-6) * du, -limit), limit)


def dahl_with_floor(force, du, k, limit, p0, p1, p2, p3):
    if limit <= 0.0:
        return 0.0
    way = force / limit if du > 0.0 else -force / limit
    return min(max(force + k * max(1.0 - way, 0.05) * du, -limit), limit)


def elastic(force, du, k, limit, p0, p1, p2, p3):
    if limit <= 0.0:
        return 0.0
    more = math.tanh(k * du / limit)
    return limit * (force / limit + more) / (1.0 + force / limit * more)


def elastic_in_explicit_steps(force, du, k, limit, p0, p1, p2, p3):
    if limit <= 0.0:
        return 0.0
    return min(max(force + k * (1.0 - (force / limit) ** 2) * du, -limit), limit)


SOUND = (clip, one_sided, below, reach_of_a_length, dahl_with_floor, elastic, elastic_in_explicit_steps)


@pytest.mark.parametrize("function", SOUND, ids=lambda function: function.__name__)
def test_sound_laws_of_ones_own_are_taken(function):
    law = register_law(f"sound: {function.__name__}", function)(MU, K)
    assert np.isfinite(loop(law, 100.0, 1e-4).forces).all()


def above(force, du, k, limit, p0, p1, p2, p3):
    return min(max(force + k * du, -10.0 * limit), 10.0 * limit)


def drift(force, du, k, limit, p0, p1, p2, p3):
    return min(max(0.9 * force + k * du, -limit), limit)


def stiff(force, du, k, limit, p0, p1, p2, p3):
    return min(max(force + p0 * k * du, -limit), limit)


def against_the_spring(force, du, k, limit, p0, p1, p2, p3):
    return min(max(force - k * du, -limit), limit)


def falls_in_slip(force, du, k, limit, p0, p1, p2, p3):
    new = force + k * du
    return new if abs(new) <= limit else math.copysign(0.5 * limit, new)


def soft_unloading(force, du, k, limit, p0, p1, p2, p3):
    slope = k if force * du >= 0.0 else 0.9 * k
    return min(max(force + slope * du, -limit), limit)


def gains_under_load(force, du, k, limit, p0, p1, p2, p3):
    """Softer on unloading, above a third of the slip force only."""
    slope = k if force * du >= 0.0 or abs(force) < limit / 3 else 0.5 * k
    return min(max(force + slope * du, -limit), limit)


def no_number_in_slip(force, du, k, limit, p0, p1, p2, p3):
    new = force + k * du
    return new if abs(new) < 0.5 * limit else math.nan


def no_number_without_pressure(force, du, k, limit, p0, p1, p2, p3):
    return limit * min(max((force + k * du) / limit, -1.0), 1.0)


FAULTY = {
    above: r"more than the slip force; got .* N from .* limit = (.*) N, expected \1 N at most",
    drift: r"its force changes without motion; got .* du = 0 m.*, expected the force it was given",
    stiff: r"grows faster than k du; got a slope of 3 k, .*, expected a slope of k at most",
    against_the_spring: r"falls as du grows; got .*, expected a slope of 0 or more",
    falls_in_slip: r"falls as du grows; got .*, expected a slope of 0 or more",
    soft_unloading: r"gives back more work than it took; got -.* J of work .* cycles of .* m about 0 m",
    gains_under_load: r"gives back more work than it took; got -.* J of work .* cycles of",
    no_number_in_slip: r"returns no number; got nan N from .*, expected a finite force",
    no_number_without_pressure: r"returns no number; got nan N .*limit = 0 N",
}


@pytest.mark.parametrize("function", FAULTY, ids=lambda function: function.__name__)
def test_faulty_laws_of_ones_own_are_refused_by_every_solver(function):
    law = register_law(f"faulty: {function.__name__}", function)(MU, K, 3.0)
    model, tip = double_beam(law, 1000.0, Section(0.5, 0.04, 0.005, elements=2)), "beam 2:2:+Z"
    for solve in (
        lambda: loop(law, 100.0, 1e-4),
        lambda: snapback(model, 20.0, tip, 0.01),
        lambda: frf(model, np.array([15.0]), 1.0, tip, [tip]),
    ):
        with pytest.raises(InputError, match=f"law faulty: {function.__name__}: .*{FAULTY[function]}") as refused:
            solve()
        assert "\n" not in str(refused.value) and len(str(refused.value)) < 300


def test_a_law_is_checked_with_its_own_parameters_and_each_of_them_once():
    make = register_law("clip with a slope", stiff)
    for p0 in (0.3, 1.0):
        before = check_contract.cache_info().misses
        for _ in range(3):
            loop(make(MU, K, p0), 100.0, 1e-4)
        assert check_contract.cache_info().misses == before + 1
    with pytest.raises(InputError, match=r"a slope of 1.5 k"):
        loop(make(MU, K, 1.5), 100.0, 1e-4)


def test_a_law_registered_anew_is_checked_anew():
    loop(register_law("changed", clip)(MU, K), 100.0, 1e-4)
    with pytest.raises(InputError, match="its force changes without motion"):
        loop(register_law("changed", drift)(MU, K), 100.0, 1e-4)


def test_a_fifth_parameter_is_not_left_out():
    with pytest.raises(InputError, match="law with five: more parameters than a law of one's own is handed; got 5"):
        loop(register_law("with five", clip)(MU, K, *range(5)), 100.0, 1e-4)
