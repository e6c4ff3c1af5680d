"""Friction in two directions and plates with nodes in the middle layer.

Gaul, Roseira and Becker, Shock and Vibration 15 (2008), Sec. 1: the tangential force is divided in x and y.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

from ema.contact.call_kernels import CROSS, EXCESS, FORCE, LIMIT, SLOPE, WAY
from ema.contact.laws import Couplings, compiled, contact_laws
from ema.data import BeamModel, Joint, Matrices
from ema.dof import Dof
from ema.elements import Plate, Section, plate_matrices
from ema.errors import InputError
from ema.simulate import (
    BoucWen,
    Dahl,
    Iwan,
    LuGre,
    Masing,
    ParallelMasing,
    RegularisedMasing,
    Unilateral,
    Valanis,
    double_beam,
    register_law,
    respond,
    snapback,
    snapback_reference,
)
from ema.simulate.friction import check_isotropic
from ema.simulate.loops import drive
from ema.simulate.reduction import modal_base
from ema.simulate.structure import assemble

K, MU, FN = 1e6, 0.3, 100.0
FC, XC = 30.0, 30e-6
CIRCLE, BOX = Masing(MU, K), Masing(MU, K, isotropic=False)


def drive_plane(law, path, normal_force):
    """Friction force in N of one contact that is moved in its plane, from the unstressed state; without
    ``isotropic`` it acts in x and y on its own."""
    if not law.isotropic:
        return np.array([drive(law, row, normal_force) for row in path])
    check_isotropic(law, f"law {law.name}")
    alone = np.full(2, -1)
    ties = Couplings(np.array([1, 0]), alone, np.zeros(2), np.zeros((0, 8)), np.zeros((3, 2)))
    laws = contact_laws([law, law], np.full(2, law.contact_stiffness), [1, 1], ties)
    return laws.drive(path, np.full(path.shape[1], law.friction_coefficient * normal_force), 1e-3)


def work(law, path):
    """Energy of the last of three cycles."""
    forces = drive_plane(law, path, FN)
    count = (path.shape[1] - 1) // 3
    last = slice(-count - 1, None)
    moved, mean = np.diff(path[:, last]), 0.5 * (forces[:, last][:, 1:] + forces[:, last][:, :-1])
    return float((moved * mean).sum())


def line(angle, amplitude, samples=4000):
    s = amplitude * np.sin(2 * np.pi * np.linspace(0, 3, 3 * samples + 1))
    return np.array([np.cos(angle) * s, np.sin(angle) * s])


def test_the_circle_is_isotropic():
    areas = [work(CIRCLE, line(angle, 2.5 * XC)) for angle in (0.0, 0.3, 0.7, 1.2)]
    np.testing.assert_allclose(areas, areas[0], rtol=1e-9)
    turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    path = np.array([3 * XC * np.sin(np.linspace(0, 9, 900)), 2 * XC * np.cos(np.linspace(0, 13, 900)) - 2 * XC])
    np.testing.assert_allclose(
        drive_plane(CIRCLE, turn @ path, FN), turn @ drive_plane(CIRCLE, path, FN), atol=1e-9 * FC
    )


@pytest.mark.parametrize(("ratio", "expected"), [(2.0, 0.828), (5.0, 1.268)])
def test_box_against_circle_on_the_diagonal(ratio, expected):
    found = work(BOX, line(np.pi / 4, ratio * XC)) / work(CIRCLE, line(np.pi / 4, ratio * XC))
    assert found == pytest.approx(expected, rel=0.005)


def test_the_box_exceeds_the_slip_force_and_the_circle_does_not():
    path = line(np.pi / 4, 5 * XC)
    assert np.hypot(*drive_plane(BOX, path, FN)).max() == pytest.approx(np.sqrt(2) * FC, rel=1e-9)
    assert np.hypot(*drive_plane(CIRCLE, path, FN)).max() == pytest.approx(FC, rel=1e-9)


@pytest.mark.parametrize("ratio", [1.5, 4.0, 20.0])
def test_closed_form_on_a_circular_path(ratio):
    """W = 2 pi F_C A sqrt(1 - (u_c/A)^2); the divided law dissipates more on large circles."""
    found, box = [], []
    for samples in (4000, 8000):
        angle = 2 * np.pi * np.linspace(0, 3, 3 * samples + 1)
        path = ratio * XC * np.array([np.cos(angle), np.sin(angle)])
        found.append(work(CIRCLE, path))
        box.append(work(BOX, path))
    closed = 2 * np.pi * FC * ratio * XC * np.sqrt(1 - 1 / ratio**2)
    assert found[1] == pytest.approx(closed, rel=1e-5)
    # the straight increments are of second order in the step
    assert found[1] + (found[1] - found[0]) / 3 == pytest.approx(closed, rel=1e-6)
    if ratio > 10:
        assert box[1] > 1.1 * closed


LAWS = [
    CIRCLE,
    ParallelMasing(MU, K, [0.6, 0.4], [0.3, 0.7]),
    Iwan(MU, K, chi=-0.3, beta=0.5, springs=12),
    RegularisedMasing(MU, K, exponent=8),
    RegularisedMasing(MU, K, exponent=1.5),
    Dahl(MU, K),
    Dahl(MU, K, shape=0.6),
    LuGre(MU, K, bristle_damping=20.0, viscous=5.0, static_ratio=1.4, stribeck_velocity=0.05),
]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_every_vector_form_is_isotropic_and_is_the_law_in_one_direction(law):
    turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    t = np.linspace(0, 9, 900)
    path = np.array([3 * XC * np.sin(t), 2 * XC * np.cos(13 / 9 * t) - 2 * XC])
    np.testing.assert_allclose(drive_plane(law, turn @ path, FN), turn @ drive_plane(law, path, FN), atol=1e-9 * FC)
    for direction in (np.array([1.0, 0.0]), np.array([0.0, -1.0]), np.array([np.cos(0.4), np.sin(0.4)])):
        along = drive_plane(law, np.outer(direction, path[0]), FN)
        np.testing.assert_allclose(along, np.outer(direction, drive(law, path[0], FN)), atol=2e-9 * FC)


@pytest.mark.parametrize("law", LAWS[:-1], ids=lambda law: law.name)
def test_vector_forms_stay_inside_the_circle_and_dissipate(law):
    rng = np.random.default_rng(4)
    path = np.cumsum(rng.normal(size=(2, 3000)), axis=1) * 0.3 * XC
    forces = drive_plane(law, path, FN)
    assert np.hypot(*forces).max() <= FC * (1 + 1e-9)
    if law.name == "masing":
        moved, mean = np.diff(path), 0.5 * (forces[:, 1:] + forces[:, :-1])
        lost = (moved * mean).sum(axis=0) - np.diff((forces**2).sum(axis=0)) / (2 * K)
        assert lost.min() >= -1e-12 * FC * XC


def two_lanes(law):
    """A law on one contact in two directions, and a function for its increments: force, slopes (2, 2) by the way."""
    none = np.full(2, -1)
    laws = contact_laws(
        [law, law],
        np.full(2, K),
        [1, 1],
        Couplings(np.array([1, 0]), none, np.zeros(2), np.zeros((0, 8)), np.zeros((3, 2))),
    )
    (row,), parameters, curves, _ = laws.arguments()

    def increment(way, state):
        exchange, after = laws.exchange(), np.zeros_like(state)
        exchange[WAY], exchange[LIMIT] = way, FC
        compiled(laws.groups[0][0])(row, 1e4, (parameters, curves), exchange, (state.copy(), after))
        (xx, yy), (xy, yx) = exchange[SLOPE] + K, exchange[CROSS]
        return exchange[FORCE].copy(), np.array([[xx, xy], [yx, yy]]), exchange[EXCESS].copy()

    return laws, increment


def jenkins(force, du, k, limit, p0, p1, p2, p3):
    return min(max(force + k * du, -limit), limit)


PROJECTED = [register_law("jenkins in a plane", jenkins)(MU, K), BoucWen(MU, K, 1.5, 0.1), Valanis(MU, K, 0.8)]


def test_slopes_of_the_vector_forms_are_their_derivatives():
    rng = np.random.default_rng(7)
    # what the Stribeck effect adds to the slope is left out, in two directions as in one
    for law in (*LAWS[:-1], LuGre(MU, K, bristle_damping=20.0, viscous=5.0), *PROJECTED):
        laws, increment = two_lanes(law)
        for _ in range(20):
            state, way = np.zeros((2, laws.states)), rng.normal(size=2) * 0.6 * XC
            springs = laws.flexibility[0] > 0
            state[:, springs] = 0.2 * FC * np.minimum(laws.capacity[0, springs], 1.0)
            state[:, 1 if law.name == "lugre" else 0] *= -1.0
            step = 1e-5 * XC
            force, slope, excess = increment(way, state)
            expected = np.array(
                [increment(way + step * e, state)[0] - increment(way - step * e, state)[0] for e in np.eye(2)]
            ).T
            np.testing.assert_allclose(slope, expected / (2 * step), atol=3e-4 * np.abs(slope).max() + 1e-6 * K)
            begun = state[:, springs].sum(axis=1) + (state[:, 1] if law.name == "lugre" else 0.0)
            np.testing.assert_allclose(excess, force - begun - K * way, atol=1e-12 * FC)


def test_laws_of_the_users_own_return_radially():
    """Radial return (Wilkins 1964): the elastic force, brought straight back to the circle."""
    rng = np.random.default_rng(3)
    path = np.cumsum(rng.normal(size=(2, 500)), axis=1) * XC
    path -= path[:, :1]
    force, expected = np.zeros(2), []
    for way in np.diff(path, prepend=path[:, :1]).T:
        trial = force + K * way
        force = trial * min(1.0, FC / max(np.hypot(*trial), 1e-300))
        expected.append(force)
    np.testing.assert_allclose(drive_plane(PROJECTED[0], path, FN), np.array(expected).T, atol=1e-12 * FC)


@pytest.mark.parametrize("law", PROJECTED, ids=lambda law: law.name)
def test_projected_laws_are_isotropic_and_the_law_in_one_direction(law):
    turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    t = np.linspace(0, 9, 900)
    path = np.array([3 * XC * np.sin(t), 2 * XC * np.cos(13 / 9 * t) - 2 * XC])
    np.testing.assert_allclose(drive_plane(law, turn @ path, FN), turn @ drive_plane(law, path, FN), atol=1e-9 * FC)
    assert np.hypot(*drive_plane(law, path, FN)).max() <= FC * (1 + 1e-9)
    for direction in (np.array([1.0, 0.0]), np.array([0.0, -1.0]), np.array([np.cos(0.4), np.sin(0.4)])):
        along = drive_plane(law, np.outer(direction, path[0]), FN)
        np.testing.assert_allclose(along, np.outer(direction, drive(law, path[0], FN)), atol=2e-9 * FC)


def test_projected_laws_come_to_the_closed_form_on_a_circle():
    """As for the circle; of first order in the angle of an increment, so half of it leaves half the error."""
    ratio = 4.0
    closed, errors = 2 * np.pi * FC * ratio * XC * np.sqrt(1 - 1 / ratio**2), []
    for samples in (500, 1000, 2000):
        angle = 2 * np.pi * np.linspace(0, 3, 3 * samples + 1)
        errors.append(work(PROJECTED[0], ratio * XC * np.array([np.cos(angle), np.sin(angle)])) / closed - 1)
    assert abs(errors[2]) < 2e-3
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.2) and errors[1] / errors[2] == pytest.approx(2.0, rel=0.2)


def test_laws_without_isotropic_form_say_so():
    def one_sided(force, du, k, limit, p0, p1, p2, p3):
        return min(max(force + k * du, -0.5 * limit), limit)

    def soft(force, du, k, limit, p0, p1, p2, p3):
        return min(max(force + p0 * k * du, -limit), limit)

    wrong = (
        (register_law("one-sided in a plane", one_sided)(MU, K), "1 F_C one way and -0.5 F_C the other"),
        (register_law("soft in a plane", soft)(MU, K, 0.5), "a first slope of 0.5 k_T"),
    )
    for law, words in wrong:
        with pytest.raises(InputError, match=f"no isotropic form.*{words}") as refused:
            drive_plane(law, line(0.0, XC, 10), FN)
        assert "\n" not in str(refused.value)
        with pytest.raises(InputError, match="no isotropic form"):
            snapback(strip(law, ("X", "Y")), 20.0, "plate 2:5:+Z", 0.01)
    with pytest.raises(InputError, match="no isotropic friction in two directions"):
        snapback_reference(strip(CIRCLE, ("X", "Y")), 20.0, "plate 2:5:+Z", 0.01)


def strip(law, directions, elements=6):
    lower, upper = (
        plate_matrices(Plate(0.5, 0.04, 0.005, poisson=0.0, elements=(elements, 1)), part=f"plate {number}")
        for number in (1, 2)
    )
    pairs = tuple((node, node) for node in range(2, 2 * (elements + 1)))
    areas = np.concatenate([np.ones(2 * (elements - 1)), [0.5, 0.5]])
    joint = Joint("interface", pairs, (0.0025, 0.0025), law, 1000.0, 1e9, None, directions, areas / areas.sum())
    return BeamModel(lower, upper, (joint,), name="strip")


def test_a_strip_without_lateral_contraction_is_a_beam():
    law = Masing(MU, 1e9, isotropic=False)
    plate, beam = strip(law, ("X", "Y")), double_beam(law, 1000.0, Section(0.5, 0.04, 0.005, elements=6))
    along = modal_base(assemble(strip(law, ("X",)))).frequencies[0]
    assert along == pytest.approx(modal_base(assemble(beam)).frequencies[0], rel=0.01)
    flat = plate_matrices(Plate(0.5, 0.04, 0.005, poisson=0.0, elements=(12, 1)))
    first = np.sqrt(eigh(flat.stiffness, flat.mass, eigvals_only=True)[0]) / (2 * np.pi)
    assert first == pytest.approx(16.710, rel=0.01)
    # the same load, shared by both corners of the free edge, against the tip of the beam: same decay
    one = snapback(beam, 20.0, "beam 2:6:+Z", 0.15)
    two = snapback(plate, 20.0, "plate 2:12:+Z", 0.15, outputs=["plate 2:12:+Z", "plate 2:13:+Z"])
    middle = two.displacements.mean(axis=0)
    assert middle[0] == pytest.approx(one.displacements[0, 0], rel=0.01)
    assert two.energy.error <= 1e-6
    assert two.energy.friction[-1] == pytest.approx(one.energy.friction[-1], rel=0.01)
    np.testing.assert_allclose(middle, one.displacements[0], atol=0.01 * middle[0])


def test_bad_plates_get_a_sentence():
    with pytest.raises(InputError, match="height = 0"):
        plate_matrices(Plate(0.5, 0.04, 0.0))
    with pytest.raises(InputError, match=r"nu 0\.5"):
        plate_matrices(Plate(0.5, 0.04, 0.005, poisson=0.5))


def test_free_square_plate_converges_to_kirchhoff():
    """13.468, 19.596, 24.270, 34.801 (nu 0.3): the element from below with the square of its size, extrapolated."""
    expected = np.array([13.468, 19.596, 24.270, 34.801])
    values = {}
    for count in (6, 9):
        flat = plate_matrices(Plate(1.0, 1.0, 0.001, elements=(count, count)), clamped=False)
        bend = [k for k, dof in enumerate(flat.dofs) if dof.axis not in ("X", "Y")]
        squares = eigh(flat.stiffness[np.ix_(bend, bend)], flat.mass[np.ix_(bend, bend)], eigvals_only=True)
        rigidity = 210e9 * 0.001**3 / (12 * (1 - 0.09))
        values[count] = np.sqrt(squares[3:7] * 7850 * 0.001 / rigidity)
    extrapolated = values[9] + (values[9] - values[6]) / ((9 / 6) ** 2 - 1)
    np.testing.assert_allclose(values[9], expected, rtol=0.02)
    np.testing.assert_allclose(extrapolated, expected, rtol=1e-3)


def two_plates(law, normal_force=200.0):
    """Two square plates on each other, each on soft springs at its corners that are alike in x and y."""
    side, count = 0.2, 2
    parts = []
    for number in (1, 2):
        free = plate_matrices(Plate(side, side, 0.005, elements=(count, count)), clamped=False, part=f"plate {number}")
        stiffness = np.array(free.stiffness)
        for place, dof in enumerate(free.dofs):
            if dof.node in (0, 2, 6, 8) and dof.axis in ("X", "Y", "Z"):
                stiffness[place, place] += 2e4 if number == 2 else 2e5
        parts.append(Matrices(free.mass, stiffness, free.dofs))
    pairs = tuple((node, node) for node in range(9))
    joint = Joint("interface", pairs, (0.0, 0.0), law, normal_force, 1e8, None, ("X", "Y"))
    return BeamModel(*parts, (joint,), name="square plates")


def released(model, angle, load=100.0, tolerance=1e-3):
    """A force in the plane is raised slowly at the middle of the upper plate in a direction, and let go."""
    rate = 5000.0
    times = np.arange(301) / rate
    force = load * np.where(times < 0.02, times / 0.02, 0.0)
    loads = np.array([np.cos(angle) * force, np.sin(angle) * force])
    at = ["plate 2:4:+X", "plate 2:4:+Y"]
    found = respond(model, loads, at, rate, at, tolerance=tolerance)
    assert found.energy.error <= 1e-6
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return turn @ found.displacements, found


def test_a_square_set_up_moves_alike_in_every_direction():
    circle, box = Masing(MU, 5e7), Masing(MU, 5e7, isotropic=False)
    along, straight = released(two_plates(circle), 0.0)
    scale = np.abs(along).max()
    assert 0.2 < straight.energy.friction[-1] / straight.energy.supplied[-1] < 1.01
    for angle in (np.pi / 2, np.pi / 4, 0.3):
        skew, found = released(two_plates(circle), angle)
        np.testing.assert_allclose(skew, along, atol=2e-3 * scale)
        assert found.energy.friction[-1] == pytest.approx(straight.energy.friction[-1], rel=2e-3)
    divided, _ = released(two_plates(box), np.pi / 4)
    assert np.abs(divided - along).max() > 0.05 * scale
    # along an axis circle and box are the same law
    np.testing.assert_allclose(released(two_plates(box), 0.0)[0], along, atol=2e-3 * scale)


@pytest.mark.parametrize(
    "law",
    [
        CIRCLE,
        Iwan(MU, K, springs=6),
        RegularisedMasing(MU, K),
        Dahl(MU, K),
        LuGre(MU, K, bristle_damping=10.0),
        *PROJECTED,
    ],
    ids=lambda law: law.name,
)
def test_one_mass_in_the_plane_against_its_motion_in_one_direction(law):
    """Loaded along a skew line, a mass on isotropic springs moves as it does along an axis in one direction."""
    dofs = tuple(Dof.parse(f"{node}:{axis}") for node in (1, 2) for axis in ("+X", "+Y", "+Z"))
    host = Matrices(np.diag([50.0] * 3 + [2.0] * 3), np.diag([1e8] * 3 + [4e4] * 3), dofs)
    rate, found = 4000.0, {}
    times = np.arange(401) / rate
    force = 90.0 * np.sin(2 * np.pi * 20 * times) * np.exp(-((times - 0.03) ** 2) / 4e-4)
    for directions, angle in ((("X",), 0.0), (("X", "Y"), 0.0), (("X", "Y"), 0.7)):
        joint = Joint("J", ((1, 2),), (0.0, 0.0), law, FN, 1e8, None, directions)
        loads = np.outer([np.cos(angle), np.sin(angle)], force)
        response = respond(BeamModel(host, None, (joint,)), loads, ["2:+X", "2:+Y"], rate, ["2:+X", "2:+Y"])
        assert response.energy.error <= 1e-6
        found[len(directions), angle] = np.array([[np.cos(angle), np.sin(angle)]]) @ response.displacements
    line = found[1, 0.0]
    for key in ((2, 0.0), (2, 0.7)):
        np.testing.assert_allclose(found[key], line, atol=2e-5 * np.abs(line).max())


@pytest.mark.parametrize("law", [Masing(MU, 5e7), replace(PROJECTED[0], contact_stiffness=5e7)], ids=["masing", "own"])
def test_plates_pressed_together_part_in_two_directions(law):
    """Both at once: isotropic friction under a normal force that changes, with its energy."""
    model = two_plates(law, 60.0).with_normal_contact(Unilateral())
    times = np.arange(101) / 5000.0
    pull = 80.0 * np.sin(np.pi * times / times[-1])
    loads = np.array([pull, 0.7 * pull, 40.0 * pull / 80.0])
    found = respond(
        model, loads, ["plate 2:4:+Z", "plate 2:4:+X", "plate 2:4:+Y"], 5000.0, ["plate 2:4:+X"], tolerance=1e-2
    )
    assert found.energy.error <= 1e-6
    assert found.pressure.open_time.max() > 0 and "lift-off" in [f.code for f in found.findings]
    # no pair ever bears more friction than its normal force allows
    assert np.hypot(found.forces[:9], found.forces[9:]).max() <= MU * found.pressure.greatest.max() * (1 + 1e-9)
