"""Normal contact: preload, pressure, lift-off, and slip forces that follow the momentary normal force."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from ema.data import BeamModel, Damping, Joint, Matrices, NormalContact
from ema.dof import Dof
from ema.elements import Section, beam
from ema.errors import InputError
from ema.simulate import (
    ContactCurve,
    Coulomb,
    Iwan,
    Masing,
    PowerContact,
    RegularisedMasing,
    Unilateral,
    assemble,
    double_beam,
    own_contact,
    preload,
    respond,
    snapback,
    snapback_reference,
)

LAW = Masing(0.3, 1e9)


def pressed(contact, force=1000.0, upper_clamped=True, shares=None, stiffness=1e9, elements=10):
    """The double beam; or with an upper beam that nothing holds but the lower one."""
    model = double_beam(
        LAW, force, Section(0.5, 0.04, 0.005, elements=elements), normal_stiffness=stiffness
    ).with_normal_contact(contact)
    if not upper_clamped:
        free = beam(Section(0.5, 0.04, 0.005, elements=elements), clamped=(False, False), part="beam 2")
        joint = replace(model.joints[0], half_heights=(0.0025, 0.0025))
        model = replace(model, beam=free, joints=(joint,))
    if shares is not None:
        model = replace(model, joints=(replace(model.joints[0], force_shares=shares, area=0.02),))
    return model


@pytest.mark.parametrize(("exponent", "slope"), [(1.0, 0.0), (1.5, 1 / 3), (2.0, 0.5), (3.0, 2 / 3)])
def test_power_law_indents_as_its_closed_form(exponent, slope):
    """Between rigid bodies: N = F (d / d_ref)^n, d_ref = n F_ref / k_N; the stiffness grows with N^(1 - 1/n)."""
    stiffness, reference = 2e3, 0.4
    found = []
    for force in (0.1, 0.4, 1.6):
        # short pieces, rigid against these springs
        lower, upper = (
            beam(Section(0.01, 0.04, 0.01, elements=1), clamped=(number == 1, False), part=f"b{number}")
            for number in (1, 2)
        )
        joint = Joint(
            "J", ((1, 0), (1, 1)), (0.0, 0.0), LAW, force, stiffness, normal_contact=PowerContact(exponent, reference)
        )
        normals = assemble(BeamModel(lower, upper, (joint,), name="rigid")).normals
        depth = exponent * reference / stiffness * (force / reference) ** (1 / exponent)
        np.testing.assert_allclose(normals.table[:, 3], depth, rtol=1e-5)
        np.testing.assert_allclose(normals.forces, force / 2, rtol=1e-5)
        found.append(normals.stiffness.sum())
    np.testing.assert_allclose(found[1], stiffness, rtol=1e-5)
    np.testing.assert_allclose(np.diff(np.log(found)) / np.log(4), slope, atol=1e-5)


@pytest.mark.parametrize(
    "contact", [Unilateral(), PowerContact(2.0), own_contact(lambda d: 1e9 * d + 1e14 * d**2, 1e-5)]
)
def test_pressures_sum_to_the_normal_force(contact):
    shares = np.full(10, 0.1)
    rest = preload(pressed(contact, upper_clamped=False, shares=shares))
    assert rest.forces.sum() == pytest.approx(1000.0, rel=1e-9)
    np.testing.assert_allclose(rest.pressures * rest.areas, rest.forces)
    assert rest.areas.sum() == pytest.approx(0.02)
    assert rest.forces.min() > 0 and not rest.findings
    # what a clamped upper beam does not press on the lower one, its clamp carries
    model = pressed(contact, shares=shares)
    assert preload(model).forces.sum() < 1000.0
    stiff = preload(pressed(contact, shares=shares, stiffness=1e12)) if contact.name == "power" else None
    if stiff is not None:
        np.testing.assert_allclose(stiff.forces, 100.0, rtol=0.02)


def test_preload_at_two_bolts_spreads_and_opens_between_them():
    """Equilibrium by an independent solver: the pairs as springs that are switched until none pulls."""
    shares = np.zeros(10)
    shares[[2, 8]] = 0.5
    model = pressed(Unilateral(), shares=shares, stiffness=1e8)
    rest, system = preload(model), assemble(model)
    rows, springs = system.normals.rows, 1e8 * np.append(np.ones(9), 0.5) / 9.5
    closed = np.ones(10, bool)
    for _ in range(30):
        matrix = system.stiffness + rows.T @ (rows * (springs * closed)[:, None])
        depth = -rows @ np.linalg.solve(matrix, -rows.T @ (1000.0 * shares))
        if np.array_equal(depth > 0, closed):
            break
        closed = depth > 0
    np.testing.assert_allclose(rest.forces, np.where(closed, springs * depth, 0.0), atol=1e-6)
    assert 0 < (~closed).sum() < 8
    np.testing.assert_array_equal(rest.open_time, np.where(closed, 0.0, 1.0))
    assert rest.widest_gap.max() == pytest.approx(-depth.min(), rel=1e-6)
    (finding,) = rest.findings
    assert finding.code == "lift-off" and f"{(~closed).sum()} of 10 pairs" in finding.message
    # the slip force of each pair is that of its own pressure
    np.testing.assert_allclose(system.contacts.limits[:10], 0.3 * rest.forces)


def test_a_curve_is_the_law_it_was_taken_from():
    stiffness, reference = 1e9, 1000.0
    depth = 2 * reference / stiffness
    mine = own_contact(lambda d: reference * (d / depth) ** 2, 4 * depth, points=2000)
    one, two = (preload(pressed(contact)) for contact in (PowerContact(2.0), mine))
    np.testing.assert_allclose(two.forces, one.forces, rtol=1e-5)


def test_bad_normal_contacts_get_a_sentence():
    for make, words in (
        (lambda: PowerContact(0.5), "exponent"),
        (lambda: PowerContact(float("nan")), "exponent"),
        (lambda: PowerContact(2.0, 0.0), "reference force"),
        (lambda: ContactCurve([0.0, 1e-6], [0.0]), "pairs of numbers"),
        (lambda: ContactCurve([0.0, 1e-6], [5.0, 10.0]), "first force 0 N"),
        (lambda: ContactCurve([0.0, 1e-6, 1e-6], [0.0, 5.0, 10.0]), "ascending"),
        (lambda: own_contact(lambda depth: -depth, 1e-5), "ascending"),
        (lambda: assemble(pressed(NormalContact("glue"))), "unknown normal contact; got glue"),
    ):
        with pytest.raises(InputError, match=words):
            make()


MASS, SPRING = np.array([4.0, 1.5]), np.array([2e5, 3e4])


def two_masses(contact, force, stiffness=5e5, mu=0.0, law=None):
    """Two masses on springs, one lying on the other; both can also move sideways, where friction acts."""
    dofs = tuple(Dof.parse(f"{node}:{axis}") for node in (1, 2) for axis in ("+X", "+Z"))
    host = Matrices(np.diag(np.repeat(MASS, 2)), np.diag(np.repeat(SPRING, 2)), dofs)
    joint = Joint("J", ((1, 2),), (0.0, 0.0), law or Masing(mu, 1e6), force, stiffness, normal_contact=contact)
    return BeamModel(host, None, (joint,), Damping(), "two masses")


def at_rest(contact, force, stiffness=5e5):
    """The law N(d), the penetration and the normal force under the preload: N = force - K d, both springs in series."""
    reference = contact.reference_force
    depth = contact.exponent * reference / stiffness
    law = lambda d: reference * (max(d, 0.0) / depth) ** contact.exponent  # noqa: E731
    series = 1 / (1 / SPRING).sum()
    closed = brentq(lambda d: law(d) - force + series * d, 0.0, 1.0, xtol=1e-16, rtol=1e-15)
    return law, closed, law(closed)


def independent(contact, force, times, load):
    """The rattling masses by a stiff solver of scipy."""
    law, closed, rest = at_rest(contact, force)

    def rate(t, y):
        z, v = y[:2], y[2:]
        outer = np.array([0.0, np.interp(t, times, load)])
        return np.concatenate(
            [v, (outer - SPRING * z + np.array([-1.0, 1.0]) * (law(closed - z[1] + z[0]) - rest)) / MASS]
        )

    return solve_ivp(rate, (0, times[-1]), np.zeros(4), "LSODA", times, rtol=1e-10, atol=1e-13, max_step=2e-4).y, rest


def small_steps(force, times, load, side, mu, fine=40):
    """Both directions with a Masing spring, by central differences in very small steps."""
    law, closed, rest = at_rest(Unilateral(), force)
    h = (times[1] - times[0]) / fine
    t = h * np.arange(fine * (len(times) - 1) + 1)
    loads, sides = np.interp(t, times, load), np.interp(t, times, side)
    z1 = z2 = v1 = v2 = x1 = x2 = w1 = w2 = friction = 0.0
    out = []
    for n in range(len(t)):
        if n % fine == 0:
            out.append((x1, x2, friction))
        normal = law(closed - z2 + z1)
        v1 += h * (-SPRING[0] * z1 - normal + rest) / MASS[0]
        v2 += h * (-SPRING[1] * z2 + normal - rest + loads[n]) / MASS[1]
        w1 += h * (-SPRING[0] * x1 + friction) / MASS[0]
        w2 += h * (-SPRING[1] * x2 - friction + sides[n]) / MASS[1]
        z1, z2, x1, x2 = z1 + h * v1, z2 + h * v2, x1 + h * w1, x2 + h * w2
        limit = mu * law(closed - z2 + z1)
        friction = min(max(friction + 1e6 * h * (w2 - w1), -limit), limit)
    return np.array(out).T


@pytest.mark.parametrize("contact", [Unilateral(), PowerContact(1.5, 50.0), PowerContact(3.0, 50.0)])
def test_a_mass_that_rattles_moves_as_an_independent_solver_says(contact):
    rate = 5000.0
    times = np.arange(1251) / rate
    load = 60.0 * np.sin(2 * np.pi * 17.0 * times) * np.minimum(times / 0.1, 1)
    model = two_masses(contact, 50.0)
    found = respond(model, load[None], ["2:+Z"], rate, ["1:+Z", "2:+Z"], tolerance=1e-4)
    expected, rest = independent(contact, 50.0, times, load)
    assert found.pressure.forces[0] == pytest.approx(rest, rel=1e-9)
    scale = np.abs(expected[:2]).max()
    np.testing.assert_allclose(found.displacements, expected[:2], atol=2e-4 * scale)
    assert found.energy.error <= 1e-6
    # it rattles: found with its first instant, its share of the time and its widest gap
    depth = (
        contact.exponent * contact.reference_force / 5e5 * (rest / contact.reference_force) ** (1 / contact.exponent)
    )
    assert found.pressure.widest_gap[0] == pytest.approx((expected[1] - expected[0]).max() - depth, rel=5e-3)
    parted = expected[1] - expected[0] > depth
    assert found.pressure.open_time[0] == pytest.approx(parted.mean(), abs=0.01)
    assert found.pressure.first_opening[0] == pytest.approx(times[parted][0], abs=1 / rate)
    assert [finding.code for finding in found.findings] == ["lift-off"]
    assert found.pressure.least[0] == 0.0


def test_the_slip_force_follows_the_momentary_normal_force():
    rate = 10000.0
    times = np.arange(1501) / rate
    load, side = 14.0 * np.sin(2 * np.pi * 30.0 * times), 40.0 * np.sin(2 * np.pi * 21.0 * times)
    drive = np.array([load, side]), ["2:+Z", "2:+X"], rate, ["1:+X", "2:+X"]
    found = respond(two_masses(Unilateral(), 50.0, mu=0.4), *drive, tolerance=1e-4)
    expected = small_steps(50.0, times, load, side, 0.4)
    assert found.pressure.greatest[0] > 1.5 * found.pressure.least[0] > 0
    np.testing.assert_allclose(found.displacements, expected[:2], atol=2e-3 * np.abs(expected[:2]).max())
    np.testing.assert_allclose(found.forces[0], expected[2], atol=0.03 * np.abs(expected[2]).max())
    assert found.energy.error <= 1e-6 and not found.findings
    # with the slip force of the state of rest the answer would be another
    still = respond(two_masses(NormalContact(), 50.0, mu=0.4), *drive, tolerance=1e-4)
    assert np.abs(still.displacements - expected[:2]).max() > 0.03 * np.abs(expected[:2]).max()


TIP = "beam 2:10:+Z"


@pytest.mark.parametrize("law", [Masing(0.0, 1e9), Masing(1e3, 1e9)])
def test_closed_contact_is_the_linear_spring_of_before(law):
    """While no pair parts and no slip force matters, a unilateral spring is the bilateral one, stiff or soft."""
    for stiffness in (1e8, 1e10):
        model = double_beam(law, 1e5, Section(0.5, 0.04, 0.005, elements=6), normal_stiffness=stiffness)
        before = snapback(model, 20.0, "beam 2:6:+Z", 0.01)
        after = snapback(model.with_normal_contact(Unilateral()), 20.0, "beam 2:6:+Z", 0.01)
        np.testing.assert_allclose(
            after.displacements, before.displacements, atol=2e-3 * np.abs(before.displacements).max()
        )
        assert after.pressure.open_time.max() == 0 and not after.findings


@pytest.mark.parametrize("law", [LAW, Iwan(0.3, 1e9, springs=8), RegularisedMasing(0.3, 1e9), Coulomb(0.3)])
def test_energy_balance_with_lift_off(law):
    model = double_beam(law, 100.0, Section(0.5, 0.04, 0.005, elements=6)).with_normal_contact(Unilateral())
    found = snapback(model, 20.0, "beam 2:6:+Z", 0.01, tolerance=1e-2)
    assert found.energy.error <= 1e-6
    assert "lift-off" in [finding.code for finding in found.findings]
    assert found.dissipated.sum() == pytest.approx(found.energy.friction[-1], rel=1e-9)
    assert np.diff(found.energy.total).max() <= 1e-7 * found.energy.total[0]
    # the energy at the start is that of the deflection: half the load times the way of its point
    work = 0.5 * 20.0 * found.displacements[0, 0]
    assert found.energy.total[0] == pytest.approx(work, rel=0.1)


def test_lift_off_where_expected_and_not_otherwise():
    heavy, light = (
        snapback(
            double_beam(LAW, force, Section(0.5, 0.04, 0.005, elements=6), normal_stiffness=1e8).with_normal_contact(
                Unilateral()
            ),
            20.0,
            "beam 2:6:+Z",
            0.02,
        )
        for force in (5000.0, 50.0)
    )
    assert heavy.pressure.open_time.max() == 0 and "lift-off" not in [f.code for f in heavy.findings]
    (finding,) = (f for f in light.findings if f.code == "lift-off")
    assert light.pressure.open_time.max() > 0.05 and finding.value == pytest.approx(light.pressure.widest_gap.max())
    # the load pulls the upper beam off at its tip: there the gap is widest
    assert np.argmax(light.pressure.widest_gap) == 5
    # a linear spring holds on, and says that it does
    bound = snapback(
        double_beam(LAW, 50.0, Section(0.5, 0.04, 0.005, elements=6), normal_stiffness=1e8), 20.0, "beam 2:6:+Z", 0.02
    )
    assert [f.code for f in bound.findings] == ["tension"] and bound.pressure.least.min() < 0


def test_solvers_that_do_not_follow_normal_contact_say_so():
    model = pressed(Unilateral())
    with pytest.raises(InputError, match="does not follow normal contact"):
        snapback_reference(model, 20.0, TIP, 0.01)
    with pytest.raises(InputError, match="does not follow normal contact"):
        respond(model, np.zeros((1, 10)), [TIP], 1e3, [TIP], normal_forces=np.ones((1, 10)))
