"""Beams, interface kinematics and assembly of friction-beam models; bad models are refused with a sentence."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

from ema.data import BeamModel, Damping, FrictionLaw, Joint, Matrices
from ema.dof import Dof
from ema.elements import Section
from ema.errors import InputError
from ema.simulate import Coulomb, Masing, assemble, beam, double_beam, snapback
from ema.simulate.reduction import modal_base

LAW = Masing(0.3, 1e9)


def joint(**changes):
    base = Joint("J", ((1, 1), (2, 2)), (0.0025, 0.004), LAW, 100.0, 1e9)
    return replace(base, **changes)


def model(**changes):
    lower, upper = (beam(Section(0.1, 0.04, 0.005, elements=2), part=part) for part in ("beam 1", "beam 2"))
    return BeamModel(lower, upper, (joint(**changes),), name="test model")


def motion(system, **values):
    """A displacement vector with one value per (part, direction) at every node."""
    x = np.zeros(len(system.dofs))
    for k, dof in enumerate(system.dofs):
        x[k] = values.get(f"{'u' if dof.axis == 'X' else 'w' if dof.axis == 'Z' else 'phi'}{dof.part[-1]}", 0.0)
    return x


def test_interface_kinematics_of_equation_2():
    system = assemble(model())
    slip = system.contacts.slip
    h1, h2 = 0.0025, 0.004
    np.testing.assert_allclose(slip @ motion(system, u1=1.0, u2=1.0), 0, atol=1e-12)
    np.testing.assert_allclose(slip @ motion(system, phi1=0.1, phi2=0.1), 0.1 * (h1 + h2), rtol=1e-12)
    np.testing.assert_allclose(slip @ motion(system, u2=-0.1 * (h1 + h2), phi1=0.1, phi2=0.1), 0, atol=1e-12)
    np.testing.assert_allclose(slip @ motion(system, w1=1.0, w2=1.0), 0, atol=1e-12)
    np.testing.assert_allclose(slip @ motion(system, u2=1.0), 1.0, rtol=1e-12)


def test_normal_coupling_is_symmetric_positive_and_free_of_force_for_a_joint_motion():
    whole = assemble(model())
    alone = assemble(model(normal_stiffness=1e-9))
    coupling = whole.stiffness - alone.stiffness
    np.testing.assert_allclose(coupling, coupling.T, atol=1e-3)
    assert np.linalg.eigvalsh(coupling)[0] > -1e-3
    np.testing.assert_allclose(coupling @ motion(whole, w1=1.0, w2=1.0), 0, atol=1e-3)


def test_reversed_dofs_of_a_host_change_no_result():
    lower = beam(Section(0.1, 0.04, 0.005, elements=2), part="beam 1")
    flipped = Matrices(lower.mass, lower.stiffness, lower.dofs)
    signs = np.array([-1.0 if dof.axis == "RY" else 1.0 for dof in lower.dofs])
    flipped = Matrices(
        lower.mass * np.outer(signs, signs),
        lower.stiffness * np.outer(signs, signs),
        tuple(dof.reversed() if dof.axis == "RY" else dof for dof in lower.dofs),
    )
    one, two = assemble(model()), assemble(replace(model(), host=flipped))
    np.testing.assert_allclose(modal_base(one).frequencies, modal_base(two).frequencies, rtol=1e-9)


def test_power_law_of_contact_stiffness_has_a_cap():
    law = replace(LAW, stiffness_exponent=0.5, reference_force=1000.0, stiffness_cap=2e9)
    for force, expected in ((250.0, 0.5e9), (1000.0, 1e9), (1e6, 2e9)):
        springs = assemble(double_beam(law, force)).contacts.stiffness
        np.testing.assert_allclose(springs.sum(), expected, rtol=1e-12)


def test_static_correction_makes_a_truncated_base_statically_exact():
    system = assemble(double_beam(LAW, 1000.0))
    load = system.row("beam 2:20:+Z")
    exact = np.linalg.solve(
        system.stiffness + system.contacts.slip.T @ (system.contacts.stiffness[:, None] * system.contacts.slip), load
    )
    base = modal_base(system, modes=6, loads=["beam 2:20:+Z"])
    assert len(base.frequencies) < 30
    static = base.shapes @ ((base.shapes.T @ load) / base.frequencies**2)
    np.testing.assert_allclose(static, exact, atol=1e-5 * np.abs(exact).max())


def test_rigid_friction_gets_a_stiff_spring_and_says_so():
    system = assemble(double_beam(Coulomb(0.3), 1000.0))
    assert np.all(np.isfinite(system.contacts.stiffness))
    assert [finding.code for finding in system.findings] == ["rigid-friction"]


def test_free_beam_has_three_rigid_motions():
    free = beam(Section(0.5, 0.04, 0.005), clamped=(False, False))
    values = eigh(free.stiffness, free.mass, eigvals_only=True)
    assert np.all(np.abs(values[:3]) < 1e-6 * values[3])
    assert np.sqrt(values[3]) / (2 * np.pi) == pytest.approx(106.33, rel=1e-3)  # (4.730)^2 sqrt(EI/rho A) / 2 pi L^2


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"pairs": ()}, "without contact pairs"),
        ({"normal_force": -1.0}, "not a normal force"),
        ({"normal_force": float("nan")}, "not a normal force"),
        ({"normal_stiffness": -1e9}, "not a normal stiffness"),
        ({"law": FrictionLaw("masing", -0.3, 1e9)}, "not a friction coefficient"),
        ({"law": FrictionLaw("masing", 0.3, -1e9)}, "tangential contact stiffness"),
        ({"law": FrictionLaw("masing", 0.3, float("nan"))}, "tangential contact stiffness"),
        ({"law": FrictionLaw("masing", 0.3, float("inf"))}, "Coulomb"),
        ({"law": FrictionLaw("masing", float("nan"), 1e9)}, "not a friction coefficient"),
        ({"law": FrictionLaw("masing", 0.3, 0.0)}, "tangential contact stiffness"),
        ({"law": FrictionLaw("masing", 0.3, 1e9, (), float("nan"))}, "not an exponent"),
        ({"law": FrictionLaw("masing", 0.3, 1e9, (), -0.5)}, "not an exponent"),
        ({"law": FrictionLaw("masing", 0.3, 1e9, (), 0.5, 0.0)}, "not a reference force"),
        ({"law": FrictionLaw("masing", 0.3, 1e9, (), 0.5, 1e3, float("nan"))}, "not a cap"),
        ({"normal_force": float("inf")}, "not a normal force"),
        ({"normal_stiffness": float("nan")}, "not a normal stiffness"),
        ({"half_heights": (float("nan"), 0.0)}, "interface"),
        ({"force_shares": np.array([0.5, 0.6])}, "sum 1"),
        ({"force_shares": np.array([1.0])}, "do not fit"),
        ({"pairs": ((1, 1), (9, 9))}, "is missing"),
        ({"directions": ("Z",)}, "X or Y"),
        ({"directions": ("Y",)}, "without Y"),
    ],
)
def test_bad_joints_get_a_sentence(change, words):
    with pytest.raises(InputError, match=words):
        assemble(model(**change))


def test_bad_matrices_get_a_sentence():
    good = beam(Section(0.1, 0.04, 0.005, elements=2), part="beam 1")
    skew = np.array(good.stiffness)
    skew[0, 1] += 1e6
    for stiffness, words in ((skew, "not symmetric"), (-np.array(good.stiffness), "not positive")):
        with pytest.raises(InputError, match=words):
            assemble(replace(model(), host=Matrices(good.mass, stiffness, good.dofs)))
    broken = np.array(good.mass)
    broken[0, 0] = np.nan
    with pytest.raises(InputError, match="NaN"):
        assemble(replace(model(), host=Matrices(broken, good.stiffness, good.dofs)))
    with pytest.raises(InputError, match="does not fit"):
        assemble(replace(model(), host=Matrices(good.mass, good.stiffness, good.dofs[:-1])))
    with pytest.raises(InputError, match="without joints"):
        assemble(replace(model(), joints=()))


def test_bad_beams_and_damping_get_a_sentence():
    with pytest.raises(InputError, match=r"height = -0\.005"):
        beam(Section(0.5, 0.04, -0.005))
    with pytest.raises(InputError, match="needs elements"):
        beam(Section(0.5, 0.04, 0.005, elements=0))
    for damping in (Damping(ratio=-0.1), Damping(ratio=float("nan")), Damping(mass_factor=float("inf"))):
        with pytest.raises(InputError, match="background damping"):
            modal_base(assemble(replace(model(), damping=damping)))
    with pytest.raises(InputError, match="no such DOF"):
        assemble(model()).row(Dof(99, "+Z", "beam 1"))


def test_a_load_beyond_small_displacements_is_told():
    """Node pairs that slide more than 5 % of their distance: the pairing is no longer that of the drawing."""
    whole = double_beam(Masing(0.3, 1e9), 100.0, Section(0.5, 0.04, 0.005, elements=2))
    fine, far = (snapback(whole, load, "beam 2:2:+Z", 1e-3, tolerance=0.1) for load in (20.0, 2e4))
    assert "large-slip" not in [finding.code for finding in fine.findings]
    (finding,) = [finding for finding in far.findings if finding.code == "large-slip"]
    assert finding.severity == "warning" and finding.limit == pytest.approx(0.05 * 0.25)
    assert finding.value == pytest.approx(np.abs(far.slips).max())


def test_a_structure_that_nothing_holds_cannot_be_loaded_slowly():
    free = beam(Section(0.5, 0.04, 0.005, elements=2), clamped=(False, False), part="beam 1")
    held = double_beam(Masing(0.3, 1e9), 100.0, Section(0.5, 0.04, 0.005, elements=2))
    upper = beam(Section(0.5, 0.04, 0.005, elements=2), clamped=(False, False), part="beam 2")
    loose = replace(held, host=free, beam=upper)
    with pytest.raises(InputError, match="the structure is not held"):
        snapback(loose, 20.0, "beam 2:2:+Z", 1e-3)
