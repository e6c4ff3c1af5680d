"""A measured modal model as host gives what its matrices give."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

from ema.data import Damping, ModalModel, Residuals, poles_from
from ema.errors import InputError
from ema.simulate import Masing, double_beam, resonance, snapback
from ema.simulate.reduction import modal_base
from ema.simulate.structure import assemble

TIP = "beam 1:6:+Z"
LAW = Masing(0.3, 1e9)


def measured(matrices, count=None, ratio=0.0, residual=False):
    """The modal model a perfect test of a structure would give: its lowest modes, and the rest as residual."""
    squares, shapes = eigh(matrices.stiffness, matrices.mass)
    keep = slice(0, count)
    omega, phi = np.sqrt(squares[keep]), shapes[:, keep]
    poles = poles_from(omega / (2 * np.pi), np.full(len(omega), ratio))
    rest = np.linalg.inv(matrices.stiffness) - (phi / omega**2) @ phi.T
    residuals = Residuals(np.zeros_like(rest, complex), rest.astype(complex)) if residual else None
    return ModalModel(
        poles, phi.astype(complex), matrices.dofs, phi / (2j * poles.imag), matrices.dofs, residuals, "unit modal mass"
    )


def models(count=None, ratio=0.0, residual=False, force=1000.0):
    plain = double_beam(LAW, force, elements=6)
    return plain, replace(plain, host=measured(plain.host, count, ratio, residual))


def test_all_modes_are_the_structure():
    plain, modal = models()
    np.testing.assert_allclose(
        modal_base(assemble(modal)).frequencies, modal_base(assemble(plain)).frequencies, rtol=1e-6
    )
    one, two = (snapback(m, 20.0, TIP, 0.05) for m in (plain, modal))
    np.testing.assert_allclose(two.displacements, one.displacements, atol=2e-3 * one.displacements.max())
    assert two.energy.error <= 1e-6


def test_few_modes_need_their_residual():
    plain, bare = models(6)
    _, full = models(6, residual=True)
    exact, without, with_rest = (modal_base(assemble(m)).frequencies[0] for m in (plain, bare, full))
    assert abs(with_rest / exact - 1) < 2e-3
    assert abs(with_rest / exact - 1) < 0.2 * abs(without / exact - 1)


def test_the_damping_of_the_host_arrives():
    plain, modal = models(ratio=0.02, force=0.0)
    damped = replace(plain, damping=Damping(ratio=0.02))
    sliding = resonance(modal, 1.0, TIP, TIP, (14.0, 19.0))
    assert sliding.frequency == pytest.approx(16.71, rel=2e-3)
    # host and beam move alike, only the host is damped
    assert sliding.damping == pytest.approx(0.01, rel=1e-3)
    assert resonance(damped.with_normal_force(1e6), 1.0, TIP, TIP, (25.0, 36.0)).damping == pytest.approx(
        0.02, rel=0.02
    )


def test_bad_hosts_get_a_sentence():
    _, modal = models(4, ratio=0.02)
    with pytest.raises(InputError, match="scaled shapes"):
        assemble(replace(modal, host=replace(modal.host, scaling="unscaled")))
    with pytest.raises(InputError, match="negative damping"):
        assemble(replace(modal, host=replace(modal.host, poles=np.conj(-modal.host.poles))))
    whole = models(4, residual=True)[1].host
    rest = Residuals(whole.residuals.lower[:, :1], whole.residuals.upper[:, :1])
    lonely = replace(whole, inputs=whole.inputs[:1], participation=whole.participation[:1], residuals=rest)
    assert "no-residuals" in {finding.code for finding in assemble(replace(modal, host=lonely)).findings}
