"""Friction laws as increments: limits, order of loading, a law of the user's own, bad parameters."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ema.contact.laws import contact_laws
from ema.errors import InputError
from ema.simulate import (
    Coulomb,
    Dahl,
    Iwan,
    LuGre,
    Masing,
    ParallelMasing,
    RegularisedMasing,
    RoughContact,
    loop,
    register_law,
)
from ema.simulate.friction import iwan_springs
from ema.simulate.loops import drive
from tests.closed_forms import iwan_area

K, MU, FN = 1e6, 0.3, 100.0
LAWS = [
    Masing(MU, K),
    RegularisedMasing(MU, K, 8),
    RegularisedMasing(MU, K, 0.7),
    Dahl(MU, K),
    Dahl(MU, K, 0.5),
    Dahl(MU, K, 2.0),
    Iwan(MU, K),
    ParallelMasing(MU, K, [0.5, 0.5], [0.2, 0.8]),
    LuGre(MU, K),
    RoughContact(MU, 1e-4, separation=2.0, reference_force=FN),
]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
@settings(max_examples=25, deadline=None)
@given(path=st.lists(st.floats(-2e-4, 2e-4), min_size=1, max_size=30))
def test_no_law_leaves_its_limits_or_gives_energy_away(law, path):
    u = np.concatenate([[0.0], path, [0.0]])
    forces = drive(law, u, FN)
    assert np.abs(forces).max() <= MU * FN * (1 + 1e-12)
    fine = np.concatenate([np.linspace(a, b, 40) for a, b in pairwise(u)])
    work = np.sum(0.5 * (drive(law, fine, FN)[1:] + drive(law, fine, FN)[:-1]) * np.diff(fine))
    assert work >= -1e-6 * MU * FN * 2e-4


@pytest.mark.parametrize("law", [law for law in LAWS if law.name != "lugre"], ids=lambda law: law.name)
def test_the_step_does_not_matter_for_monotone_motion(law):
    end = 7e-5
    one = drive(law, np.array([0.0, end]), FN)[-1]
    many = drive(law, np.linspace(0, end, 1001), FN)[-1]
    assert one == pytest.approx(many, abs=2e-11 * MU * FN)


def test_one_parallel_spring_is_a_masing_spring():
    u = 5e-5 * np.sin(np.linspace(0, 12, 400))
    np.testing.assert_allclose(
        drive(ParallelMasing(MU, K, [1.0], [1.0]), u, FN), drive(Masing(MU, K), u, FN), rtol=1e-12
    )


def test_a_user_law_is_the_same_as_the_built_in_one_it_copies():
    def my_jenkins(force, du, k, limit, p0, p1, p2, p3):
        return min(max(force + k * du, -limit), limit)

    mine = register_law("my jenkins", my_jenkins)
    u = 5e-5 * np.sin(np.linspace(0, 12, 400))
    np.testing.assert_allclose(drive(mine(MU, K), u, FN), drive(Masing(MU, K), u, FN), rtol=1e-12)


def test_bad_user_laws_get_a_sentence():
    with pytest.raises(InputError, match="built-in"):
        register_law("masing", lambda *a: 0.0)
    with pytest.raises(InputError, match="cannot be compiled"):
        register_law("opens a file", lambda f, du, k, top, p0, p1, p2, p3: open("x").read())  # noqa: SIM115
    with pytest.raises(InputError, match="no number"):
        register_law("not a number", lambda f, du, k, top, p0, p1, p2, p3: math.nan)


def test_springs_beside_a_law_of_more_states_are_read_without_a_warning():
    laws = contact_laws([Masing(MU, K), LuGre(MU, K)], np.full(2, K), [1, 1])
    with np.errstate(all="raise"):
        counts, stiffness, force, least = laws.springs()
    assert counts.tolist() == [1, 0] and stiffness[0, 0] == force[0, 0] == 1.0 and least.tolist() == [1 / K, 0.0]


def test_friction_falls_with_the_normal_force():
    u = np.linspace(0, 1e-4, 101)
    force = np.linspace(100, 0, 101)
    result = drive(Masing(MU, K), u, force)
    np.testing.assert_allclose(result[60:], MU * force[60:], atol=1e-12)


def test_iwan_springs_hold_the_stiffness_and_force_of_the_continuous_model():
    stiffness, force = iwan_springs(-0.4, 0.7, 400)
    assert stiffness.sum() == pytest.approx(1) and force.sum() == pytest.approx(1)
    errors = [
        abs(
            loop(Iwan(MU, K, -0.4, 0.7, count), FN, 1e-5, samples=8192).area / iwan_area(K, MU * FN, 1e-5, -0.4, 0.7)
            - 1
        )
        for count in (60, 1000)
    ]
    assert errors[0] < 3e-3 and errors[1] < 1e-4


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: RegularisedMasing(MU, K, -1), "m > 0"),
        (lambda: Iwan(MU, K, chi=0.5), "chi"),
        (lambda: Dahl(MU, K, 0), "shape"),
        (lambda: LuGre(MU, K, static_ratio=0.5), "F_S/F_C"),
        (lambda: ParallelMasing(MU, K, [0.5, 0.6], [0.5, 0.5]), "sum 1"),
        (lambda: ParallelMasing(MU, K, [1.0], [0.5, 0.5]), "equal lengths"),
        (lambda: drive(Masing(MU, K), np.zeros(3), -1.0), "normal force"),
        (lambda: drive(Coulomb(MU), np.zeros(3), 1.0), "stick_stiffness"),
        (lambda: drive(Masing(MU, K).__class__("what", MU, K), np.zeros(3), 1.0), "unknown friction law"),
        (lambda: drive(Masing(MU, K).__class__("iwan", MU, K), np.zeros(3), 1.0), "not the parameters.*chi, beta"),
        (lambda: drive(LuGre(MU, K, viscous=float("nan")), np.zeros(3), 1.0), "no number"),
    ],
)
def test_bad_laws_get_a_sentence(make, words):
    with pytest.raises(InputError, match=words):
        make()
