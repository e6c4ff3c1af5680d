"""Nonlinear modes against closed forms, a solver of its own over all DOFs, and free decays in time.

Extended periodic motion: Krack, Computers & Structures 154 (2015) 59-71. Equivalent stiffness and loop area of a Masing
(Jenkins) element: Caughey, J. Appl. Mech. 27 (1960) 640-643.
"""

import numpy as np
import pytest
from scipy.optimize import brentq, root

from ema.data import BeamModel, Damping, Joint, Matrices
from ema.dof import Dof
from ema.elements import Section
from ema.errors import InputError
from ema.simulate import (
    BoucWen,
    Dahl,
    Iwan,
    LuGre,
    Masing,
    ParallelMasing,
    RegularisedMasing,
    Valanis,
    backbone,
    double_beam,
    respond,
)

K, FC = 4e5, 30.0
LAWS = [
    Masing(1.0, K),
    ParallelMasing(1.0, K, [0.3, 0.7], [0.6, 0.4]),
    Iwan(1.0, K, -0.5, 1.0, 12),
    RegularisedMasing(1.0, K, 8),
    BoucWen(1.0, K, 2.0, 0.1),
    Dahl(1.0, K),
    Valanis(1.0, K, 0.6),
    LuGre(1.0, K, 5.0, 1.0, 1.2, 1e-2),
]


def chain(masses, springs, law, rubbing, damping=0.0, across=2e9, **joint):
    """Masses in a row between two walls, with a spring between each two; those named in ``rubbing`` rub on a wall."""
    count = len(masses)
    stiffness = np.diag(springs[:-1] + springs[1:]) - np.diag(springs[1:-1], 1) - np.diag(springs[1:-1], -1)
    whole = np.zeros((2 * count, 2 * count))
    whole[:count, :count], whole[count:, count:] = stiffness, across * np.eye(count)
    dofs = tuple(Dof(n + 1, axis) for axis in ("+X", "+Z") for n in range(count))
    walls = tuple(Dof(n + 1, axis, "wall") for axis in ("+X", "+Z") for n in range(count))
    pairs = tuple((n + 1, n + 1) for n in rubbing)
    contact = Joint("contact", pairs, (0.0, 0.0), law, FC, 1.0, **joint)
    return BeamModel(
        Matrices(np.diag([*masses, *masses]), whole, dofs),
        Matrices(1e3 * np.eye(2 * count), 1e16 * np.eye(2 * count), walls),
        (contact,),
        Damping(mass_factor=damping),
        "chain",
    )


@pytest.mark.parametrize("ratio", [0.5, 1.5, 4.0, 30.0])
def test_one_mass_on_one_masing_element(ratio):
    """With one harmonic the balance is Caughey's: w^2 = (K + k_eq)/m, and the area of the loop is what is lost."""
    mass, spring = 2.0, 8e5
    amplitude, reach = ratio * FC / K, FC / K
    model = chain(np.array([mass]), np.array([spring, 0.0]), Masing(1.0, K), [0])
    mode = backbone(model, [amplitude * np.sqrt(mass)], near=120.0, outputs=["1:+X"], harmonics=1)
    if ratio <= 1:
        stiffness, area = K, 0.0
    else:
        turn = np.arccos(1 - 2 * reach / amplitude)
        stiffness, area = K / np.pi * (turn - 0.5 * np.sin(2 * turn)), 4 * FC * (amplitude - reach)
    omega = np.sqrt((spring + stiffness) / mass)
    assert mode.frequencies[0] == pytest.approx(omega / (2 * np.pi), rel=1e-6)
    assert mode.damping_ratios[0] == pytest.approx(area / (2 * np.pi * omega**2 * mass * amplitude**2), rel=1e-6)
    assert abs(mode.shapes[0, 0]) == pytest.approx(1 / np.sqrt(mass), rel=1e-6)


def jenkins_over_a_period(motion, stiffness, limit):
    """Forces (sample,) in the closed cycle of a displacement (sample,)."""
    force, before, out = 0.0, 0.0, np.empty_like(motion)
    for _ in range(3):
        for n, u in enumerate(motion):
            force = min(max(force + stiffness * (u - before), -limit), limit)
            out[n], before = force, u
    return out


def periodic_motion(masses, springs, rubbing, damping, amplitude, guess):
    """Extended periodic motion of a chain in its physical coordinates with the orders 1, 3 and 5, by scipy.

    Unknown: complex amplitudes, w and xi; M is the mass, C = damping M; contacts of equal shares of K and FC.
    """
    count, orders, samples = len(masses), np.array([1, 3, 5]), 2048
    matrix = np.diag(springs[:-1] + springs[1:]) - np.diag(springs[1:-1], 1) - np.diag(springs[1:-1], -1)
    waves = np.exp(2j * np.pi * np.outer(np.arange(samples) / samples, orders))

    def open_equations(unknowns):
        omega, xi = unknowns[-2:] * guess[1]
        x = (unknowns[: 3 * count] + 1j * unknowns[3 * count : -2]).reshape(3, count) * amplitude
        motion = (waves @ x).real
        friction = np.zeros((3, count), complex)
        for n in rubbing:
            force = jenkins_over_a_period(motion[:, n], K / len(rubbing), FC / len(rubbing))
            friction[:, n] = 2 / samples * waves.conj().T @ force
        rest = x @ matrix + friction - (orders[:, None] * omega) ** 2 * x * masses
        rest += 1j * orders[:, None] * omega * damping * masses * x
        rest[0] -= 1j * omega * xi * masses * x[0]
        rest = rest.ravel() / (guess[1] ** 2 * masses.max() * amplitude)
        norm = np.sum(masses * np.abs(x[0]) ** 2) / amplitude**2 - 1
        return np.concatenate([rest.real, rest.imag, [norm, x[0].imag @ (masses * guess[0]) / amplitude]])

    start = np.zeros(6 * count + 2)
    start[:count], start[-2:] = guess[0], [1.0, 0.1]
    found = root(open_equations, start, method="hybr", tol=1e-11)
    assert np.abs(found.fun).max() < 1e-8
    return found.x[-2:] * guess[1]


@pytest.mark.parametrize("seed", range(4))
def test_random_chains_against_a_balance_of_all_degrees_of_freedom(seed):
    """Two of four masses rub; from the first slip to three times that amplitude."""
    rng = np.random.default_rng(seed)
    masses, springs = rng.uniform(1.0, 3.0, 4), rng.uniform(1e6, 4e6, 5)
    rubbing, damping = sorted(rng.choice(4, 2, replace=False).tolist()), 5.0
    model = chain(masses, springs, Masing(1.0, K), rubbing, damping)
    stuck = np.diag(springs[:-1] + springs[1:]) - np.diag(springs[1:-1], 1) - np.diag(springs[1:-1], -1)
    stuck[rubbing, rubbing] += K / 2
    squares, shapes = np.linalg.eigh(stuck / np.sqrt(np.outer(masses, masses)))
    shape, omega = shapes[:, 0] / np.sqrt(masses), np.sqrt(squares[0])
    first = FC / K / np.abs(shape[rubbing]).max()
    levels = first * np.array([0.5, 1.3, 3.0])
    mode = backbone(model, levels, near=omega / (2 * np.pi), outputs=["1:+X"], harmonics=5)
    assert mode.frequencies[0] == pytest.approx(omega / (2 * np.pi), rel=1e-6)
    assert mode.damping_ratios[0] == pytest.approx(damping / (2 * omega), rel=1e-5)
    for level in (1, 2):
        expected = periodic_motion(masses, springs, rubbing, damping, levels[level], (shape, omega))
        assert 2 * np.pi * mode.frequencies[level] == pytest.approx(expected[0], rel=2e-6)
        assert mode.damping_ratios[level] == pytest.approx(expected[1] / (2 * expected[0]), rel=2e-4)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_free_decays_follow_the_nonlinear_mode(law):
    """A released mass: frequency and damping of every sixteenth cycle, read from its extremes, against the nonlinear mode.

    A stiff spring beside a soft joint (zeta below 0.2 %), so that the decay is slow and its modal amplitude that of the
    displacement. Extremes give the logarithmic decrement over a cycle, their instants the frequency; both are those of
    the amplitude in between to second order in the damping.
    """
    mass, spring, sampling = 10.0, 4e7, 40_000.0
    model = chain(np.array([mass]), np.array([spring, 0.0]), law, [0], 2.0)
    times = np.arange(int(0.5 * sampling)) / sampling
    load = np.where(times < 0.02, 4 * FC / K * spring * np.minimum(times / 0.018, 1.0), 0.0)
    out = respond(model, load[None], ["1:+X"], sampling, ["1:+X"], tolerance=1e-4)
    x, v = out.displacements[0], np.gradient(out.displacements[0], 1 / sampling)
    before = np.array([n for n in range(int(0.022 * sampling), len(x) - 1) if v[n] * v[n + 1] < 0])
    share = v[before] / (v[before] - v[before + 1])
    instants = (before + share) / sampling
    tops = x[before] + 0.5 * share * (v[before] / sampling) * 1.0
    # friction leaves an offset, which the second difference of the extremes takes out
    heights = np.abs(tops[2:] - 2 * tops[1:-1] + tops[:-2]) / 4
    picked = np.arange(1, len(heights) - 1, 32)
    levels = heights[picked]
    frequencies = 1 / (instants[picked + 2] - instants[picked])
    damping = np.log(heights[picked - 1] / heights[picked + 1]) / (2 * np.pi)
    measured = np.column_stack([frequencies, damping])
    mode = backbone(model, levels * np.sqrt(mass), near=340.0, outputs=["1:+X"])
    assert len(levels) >= 8 and levels[0] > 2 * FC / K
    np.testing.assert_allclose(mode.frequencies, measured[:, 0], rtol=1e-3)
    np.testing.assert_allclose(mode.damping_ratios, measured[:, 1], rtol=0.015, atol=2e-6)


def test_damping_that_couples_modes():
    """Lossy contacts that stick: with C - xi M a mode of the linear structure neither grows nor decays.

    Structural damping eta k of a contact becomes the viscous matrix W^-1/2 S^T eta k S W^-1/2 in modal coordinates.
    """
    masses, springs, loss, damping = np.array([1.0, 2.0, 1.5]), np.array([1e6, 5e5, 8e5, 1e6]), 0.4, 5.0
    model = chain(masses, springs, Masing(1.0, 2 * K), [0, 2], damping, tangential_loss=loss)
    own = np.diag(springs[:-1] + springs[1:]) - np.diag(springs[1:-1], 1) - np.diag(springs[1:-1], -1)
    added = np.diag([K, 0.0, K])
    root_mass = 1 / np.sqrt(masses)
    squares, shapes = np.linalg.eigh((own + added) * np.outer(root_mass, root_mass))
    shapes, root_omega = root_mass[:, None] * shapes, squares**-0.25
    coupled = damping * np.eye(3) + root_omega[:, None] * (shapes.T @ (loss * added) @ shapes) * root_omega

    def growth(xi):
        state = np.block([[np.zeros((3, 3)), np.eye(3)], [-np.diag(squares), xi * np.eye(3) - coupled]])
        poles = np.linalg.eigvals(state)
        return poles[np.argmin(np.abs(poles - 1j * np.sqrt(squares[0])))]

    xi = brentq(lambda x: growth(x).real, 0.0, 1e3, xtol=1e-12)
    level = 0.1 * FC / K
    mode = backbone(model, [level], near=np.sqrt(squares[0]) / (2 * np.pi), outputs=["1:+X"])
    omega = growth(xi).imag
    assert abs(coupled[0, 1]) > 0.1 * coupled[0, 0]
    assert 2 * np.pi * mode.frequencies[0] == pytest.approx(omega, rel=1e-6)
    assert mode.damping_ratios[0] == pytest.approx(xi / (2 * omega), rel=1e-5)


def test_errors_hold_against_many_more_harmonics():
    """The double beam over three decades: frequency, damping and power against a tolerance ten times smaller."""
    model = double_beam(Masing(0.3, 1e9), 1000.0, Section(0.5, 0.04, 0.005, elements=4), damping=Damping(ratio=0.003))
    levels = np.geomspace(3e-5, 3e-2, 5)
    mode = backbone(model, levels, near=31.0, outputs=["beam 2:4:+Z"], tolerance=1e-2)
    fine = backbone(model, levels, near=31.0, outputs=["beam 2:4:+Z"], tolerance=1e-3)
    assert np.all(np.abs(mode.damping_ratios / fine.damping_ratios - 1) <= mode.damping_error)
    assert np.all(np.abs(mode.frequencies / fine.frequencies - 1) <= mode.frequency_error)
    assert np.isfinite(mode.frequencies).all() and mode.frequencies[0] > 1.7 * mode.frequencies[-1]
    power = mode.damping_ratios * (2 * np.pi * mode.frequencies) ** 3 * mode.amplitudes**2
    np.testing.assert_allclose(mode.friction_power + mode.damping_power, power, rtol=1e-6)


def test_contacts_without_normal_force_slide_from_the_start():
    model = double_beam(Masing(0.3, 1e9), 0.0, Section(0.5, 0.04, 0.005, elements=4), damping=Damping(ratio=0.003))
    mode = backbone(model, [1e-6, 1e-2], near=16.0, outputs=["beam 2:4:+Z"])
    single = double_beam(Masing(0.3, 1e-3), 1e9, Section(0.5, 0.04, 0.005, elements=4), damping=Damping(ratio=0.003))
    free = backbone(single, [1e-6], near=16.0, outputs=["beam 2:4:+Z"])
    np.testing.assert_allclose(mode.frequencies, free.frequencies[0], rtol=1e-6)


def test_levels_in_any_order():
    model = double_beam(Masing(0.3, 1e9), 500.0, Section(0.5, 0.04, 0.005, elements=2), damping=Damping(ratio=0.003))
    levels = [3e-4, 1e-4]
    there, back = (backbone(model, each, near=30.0, outputs=["beam 2:2:+Z"]) for each in (levels, levels[::-1]))
    np.testing.assert_allclose(there.frequencies, back.frequencies[::-1], rtol=1e-3)
    assert there.amplitudes.tolist() == levels


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"amplitudes": []}, "not modal amplitudes"),
        ({"amplitudes": [1e-3, -1e-3]}, "not modal amplitudes"),
        ({"amplitudes": [float("nan")]}, "not modal amplitudes"),
        ({"near": 0.0}, "not a frequency"),
        ({"outputs": []}, "no DOF whose shape is wanted"),
    ],
)
def test_bad_input_is_one_sentence(change, words):
    arguments = {"amplitudes": [1e-3], "near": 30.0, "outputs": ["beam 2:2:+Z"]} | change
    with pytest.raises(InputError, match=words):
        backbone(double_beam(Masing(0.3, 1e9), 100.0, Section(0.5, 0.04, 0.005, elements=2)), **arguments)


def two_bodies(law, first, second):
    """Two bodies of 2 kg on springs along X and Y, a contact between them along X, damped in proportion to mass."""

    def body(stiffness, group=""):
        dofs = tuple(Dof(1, axis, group) for axis in ("+X", "+Y", "+Z"))
        return Matrices(2.0 * np.eye(3), np.diag([*stiffness, 1e5]), dofs)

    joint = Joint("joint", ((1, 1),), (0.0, 0.0), law, 10.0, 1e7, directions=("X",))
    return BeamModel(body(first), body(second, "beam"), (joint,), Damping(mass_factor=3.0), name="two")


@pytest.mark.parametrize("law", [Masing(0.5, 1e6), Dahl(0.5, 1e6), LuGre(0.5, 1e6, bristle_damping=30.0)])
@pytest.mark.parametrize(("near", "output", "square"), [(52.8, "1:+Y", 1.1e5), (50.3, "1:+X", 1e5)])
def test_modes_that_no_contact_sees_are_linear(law, near, output, square):
    """Motion across the contact, and both bodies in phase, whose slip is rounding: at any amplitude the linear mode."""
    model = two_bodies(law, [2e5, 2.2e5], [2e5, 3e4])
    mode = backbone(model, [1e-2, 1e-6, 1e2, 1e-4], near=near, outputs=[output])
    assert not mode.findings
    np.testing.assert_allclose(mode.frequencies, np.sqrt(square) / (2 * np.pi), rtol=1e-12)
    np.testing.assert_allclose(mode.damping_ratios, 3.0 / (2 * np.sqrt(square)), rtol=1e-9)
    shape = np.sqrt(0.5) if output == "1:+Y" else 0.5
    np.testing.assert_allclose(np.abs(mode.shapes[0]), shape, rtol=1e-9)
