"""Normal contact: preload, pressure, lift-off, and slip forces that follow the momentary normal force."""

from dataclasses import replace

import numpy as np
import pytest

from ema.data import BeamModel, Joint, NormalContact
from ema.elements import beam
from ema.errors import InputError
from ema.simulate import Masing, assemble, double_beam
from ema.simulate.contact import ContactCurve, PowerContact, Unilateral, own_contact, preload

LAW = Masing(0.3, 1e9)


def pressed(contact, force=1000.0, upper_clamped=True, shares=None, stiffness=1e9, elements=10):
    """The double beam; or with an upper beam that nothing holds but the lower one."""
    model = double_beam(LAW, force, elements=elements, normal_stiffness=stiffness).with_normal_contact(contact)
    if not upper_clamped:
        free = beam(0.5, 0.04, 0.005, elements=elements, clamped=(False, False), part="beam 2")
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
            beam(0.01, 0.04, 0.01, elements=1, clamped=(number == 1, False), part=f"b{number}") for number in (1, 2)
        )
        joint = Joint("J", ((1, 0), (1, 1)), (0.0, 0.0), LAW, force, stiffness,
                      normal_contact=PowerContact(exponent, reference))  # fmt: skip
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
