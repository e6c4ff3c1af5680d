"""FRFs of a structure known in closed form that were exported or described wrongly: right, or named."""

from dataclasses import replace

import numpy as np
import pytest

from ema.data import FrfSet, ModalModel
from ema.dof import Dof
from ema.estimate import quality
from ema.fit import modes, stabilise
from tests.unit.closed_form_impacts import DAMPING, FREQUENCIES, SHAPES

LINES = np.arange(5.0, 200.25, 0.5)


def accelerances(
    outputs: tuple[int, ...] = (1, 2, 3), noise: float = 0.003, lines: np.ndarray = LINES, seed: int = 11
) -> FrfSet:
    """Force at point 1; additive noise relative to the rms of all values."""
    jw, omega = 2j * np.pi * lines[:, None], 2 * np.pi * FREQUENCIES
    modal = jw**2 / (jw**2 + 2 * DAMPING * omega * jw + omega**2)
    values = modal @ (SHAPES[[one - 1 for one in outputs]] * SHAPES[0]).T
    rng = np.random.default_rng(seed)
    draw = (rng.standard_normal(values.shape) + 1j * rng.standard_normal(values.shape)) / np.sqrt(2)
    values = values + noise * np.sqrt(np.mean(np.abs(values) ** 2)) * draw
    dofs = tuple(Dof(one, "+Z") for one in outputs)
    return FrfSet(lines, values[:, :, None], dofs, (Dof(1, "+Z"),), "accelerance", "(m/s^2)/N", name="bare")


def fitted(frfs: FrfSet) -> ModalModel:
    return modes(frfs, stabilise(frfs))


@pytest.mark.parametrize("step", [0.25, 0.5, 1.0])
@pytest.mark.parametrize("noise", [0.0, 0.003, 0.3])
def test_conjugated_frfs_are_named_and_no_fault(step: float, noise: float) -> None:
    frfs = accelerances(noise=noise, lines=np.arange(5.0, 200.1, step))
    assert not {"conjugate-frfs", "drive-point-sign"} & {finding.code for finding in quality(frfs)}
    turned = replace(frfs, values=frfs.values.conj())
    found = [finding for finding in quality(turned) if finding.code in ("conjugate-frfs", "drive-point-sign")]
    assert [finding.code for finding in found] == ["conjugate-frfs"], "a sensor turned round is not the cause"


def test_conjugated_frfs_have_no_modes() -> None:
    frfs = accelerances()
    model = fitted(replace(frfs, values=frfs.values.conj()))
    assert not len(model.poles) and "no-modes" in {finding.code for finding in model.findings}


def test_noise_alone_is_no_conjugate() -> None:
    rng = np.random.default_rng(3)
    for lines in (60, 400):
        frfs = accelerances((1,), lines=LINES[:lines])
        draw = rng.standard_normal((2, *frfs.values.shape))
        found = quality(replace(frfs, values=draw[0] + 1j * draw[1]))
        assert "conjugate-frfs" not in {finding.code for finding in found}


def test_an_exponential_window_that_was_stated_and_not_applied_is_an_error() -> None:
    """Decays from 1.5 to 4.9 1/s; a window of 3 1/s would leave none of them below it."""
    model = fitted(replace(accelerances(), added_decay=3.0))
    (finding,) = [finding for finding in model.findings if finding.code == "window-not-applied"]
    assert finding.severity == "error" and finding.value == pytest.approx(1.548, rel=0.02) and finding.limit == 3.0


@pytest.mark.parametrize("added", [0.0, 1.0])
def test_an_exponential_window_that_was_applied_is_taken_off(added: float) -> None:
    frfs = accelerances()
    if added:  # residues of accelerances change with the window: the closed form of displaced poles, as receptances
        jw, omega = 2j * np.pi * LINES[:, None] + added, 2 * np.pi * FREQUENCIES
        values = (1 / (jw**2 + 2 * DAMPING * omega * jw + omega**2)) @ (SHAPES[:3] * SHAPES[0]).T
        frfs = replace(frfs, values=values[:, :, None], quantity="receptance", unit="m/N", added_decay=added)
    model = fitted(frfs)
    np.testing.assert_allclose(model.damping_ratios, DAMPING, rtol=0.01)
    assert "window-not-applied" not in {finding.code for finding in model.findings}
