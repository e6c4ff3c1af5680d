"""Loss factors of sticking joints and normal stiffness that grows with the normal force."""

from dataclasses import replace

import numpy as np
import pytest

from ema.data import BeamModel, Damping, Joint, Matrices
from ema.dof import Dof
from ema.errors import InputError
from ema.simulate import Masing, resonance, respond
from ema.simulate.reduction import modal_base
from ema.simulate.structure import assemble

K, K_T = 4.0e6, 1.0e6


def oscillator(tangential=0.0, normal=0.0, exponent=0.0, force=1e9):
    """A mass of 1 kg on a spring, held by a joint in X (tangential) and in Z (normal)."""
    dofs = tuple(Dof(1, d) for d in ("+X", "+Z"))
    host = Matrices(np.eye(2), np.diag([K, K]), dofs)
    ground = Matrices(1e9 * np.eye(2), 1e15 * np.eye(2), tuple(Dof(2, d, "wall") for d in ("+X", "+Z")))
    joint = Joint(
        "J1",
        ((1, 2),),
        (0.0, 0.0),
        Masing(0.3, K_T),
        force,
        2 * K_T,
        tangential_loss=tangential,
        normal_loss=normal,
        normal_exponent=exponent,
    )
    return BeamModel(host, ground, (joint,), Damping(), "oscillator")


def test_damping_of_a_mode_is_half_the_loss_factor_times_the_share_of_its_energy():
    base = modal_base(assemble(oscillator(0.04, 0.02)))
    zeta = {round(f): d / (2 * f) for f, d in zip(base.frequencies, base.decay, strict=True)}
    assert zeta[round(np.sqrt(K + K_T))] == pytest.approx(0.04 / 2 * K_T / (K + K_T), rel=1e-3)
    assert zeta[round(np.sqrt(K + 2 * K_T))] == pytest.approx(0.02 / 2 * 2 * K_T / (K + 2 * K_T), rel=1e-3)


def test_steady_state_and_ring_down_show_it():
    model = oscillator(0.04)
    natural = np.sqrt(K + K_T) / (2 * np.pi)
    top = resonance(model, 1.0, "1:+X", "1:+X", (0.9 * natural, 1.1 * natural))
    assert top.damping == pytest.approx(0.004, rel=1e-3)
    pulse = np.zeros((1, 4000))
    pulse[0, :3] = 1.0
    run = respond(model, pulse, ["1:+X"], 20 * natural, ["1:+X"])
    energy = np.abs(run.displacements[0])
    peaks = [energy[start : start + 40].max() for start in (100, 100 + 20 * 100)]
    assert np.log(peaks[0] / peaks[1]) / (2 * np.pi * 100) == pytest.approx(0.004, rel=0.02)


def test_normal_stiffness_grows_with_the_normal_force():
    stiff = [assemble(oscillator(exponent=0.5, force=f)).stiffness[1, 1] - K for f in (1000.0, 4000.0)]
    assert stiff == pytest.approx([2 * K_T, 4 * K_T], rel=1e-6)


def test_a_loss_factor_is_checked():
    model = oscillator()
    bad = replace(model, joints=(replace(model.joints[0], normal_loss=-0.1),))
    with pytest.raises(InputError, match="not a loss factor"):
        assemble(bad)
