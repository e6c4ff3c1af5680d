"""FRFs of several set-ups in one set, and the frequency shift between set-ups."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import acquisition
from acquisition.setups import SHIFT_LIMIT, Part, merge, relative_shift
from ema import store
from ema.data import FrfSet, ModalModel, poles_from
from ema.dof import Dof
from ema.errors import InputError
from ema.synthesis import frfs as synthesise

FREQUENCIES = np.arange(20.0, 400.0, 0.25)
NODES = 8


def truth(shift: float = 0.0, damping: float = 0.003) -> ModalModel:
    """Five modes of a beam-like structure with all frequencies shifted by the same fraction."""
    natural = np.array([35.0, 96.0, 140.0, 188.0, 311.0]) * (1 + shift)
    poles = poles_from(natural, np.full(5, damping))
    x = (np.arange(1, NODES + 1) - 0.3) / NODES
    shapes = np.array([np.cos(np.pi * (mode + 1) * x + 0.3 * mode) for mode in range(5)]).T.astype(complex)
    dofs = tuple(Dof(node, "+Z") for node in range(1, NODES + 1))
    return ModalModel(poles, shapes, dofs, shapes[:1] / (2j * poles.imag), dofs[:1], scaling="unit modal mass")


def part(setup: str, nodes: list[int], shift: float = 0.0, noise: float = 0.0, sign: int = 1) -> Part:
    outputs = tuple(Dof(node, "+Z" if sign > 0 else "-Z") for node in nodes)
    frf = synthesise(truth(shift), FREQUENCIES, "accelerance", outputs=outputs, inputs=(Dof(1, "+Z"),))
    rng = np.random.default_rng(len(setup) + nodes[0])
    scatter = (
        noise
        * np.abs(frf.values).mean()
        * (rng.standard_normal(frf.values.shape) + 1j * rng.standard_normal(frf.values.shape))
    )
    values = frf.values + scatter
    made = FrfSet(FREQUENCIES, values, outputs, (Dof(1, "+Z"),), "accelerance", "(m/s^2)/N", np.abs(values) / 1e9)
    return Part(made, setup, f"{setup}.h5")


def test_roving_accelerometers_become_one_set_in_the_order_of_the_files() -> None:
    merged = merge([part("A", [1, 4, 5]), part("B", [1, 2, 7]), part("C", [8, 1, 3], sign=-1)], "run a")
    assert [str(dof) for dof in merged.outputs] == ["1:+Z", "4:+Z", "5:+Z", "2:+Z", "7:+Z", "8:-Z", "3:-Z"]
    expected = synthesise(truth(), FREQUENCIES, "accelerance", outputs=merged.outputs, inputs=merged.inputs)
    np.testing.assert_allclose(merged.values, expected.values, rtol=1e-12, atol=1e-15)
    assert merged.coherence is not None
    np.testing.assert_allclose(merged.coherence, np.abs(merged.values) / 1e9)
    assert [finding.severity for finding in merged.findings] == ["info", "info"]
    assert all(abs(finding.value) < 1e-6 for finding in merged.findings if finding.value is not None)


@pytest.mark.parametrize("shift", [-0.02, -0.004, -0.0003, 0.0, 0.0011, 0.013])
@pytest.mark.parametrize(("shared", "noise"), [(True, 0.0), (True, 0.05), (False, 0.0), (False, 0.05)])
def test_the_shift_between_set_ups_is_found(shift: float, shared: bool, noise: float) -> None:
    """To a tenth of the half-power bandwidth of 0.6 %, with lines that are 0.7 % apart at the lowest resonance."""
    second = [1, 6, 7, 8] if shared else [6, 7, 8]
    found, resemblance = relative_shift(
        [part("A", [1, 2, 3, 4, 5], noise=noise).frfs], [part("B", second, shift, noise).frfs]
    )
    assert found == pytest.approx(shift, abs=6e-4)
    assert resemblance > 0.5


def test_a_shift_above_the_limit_warns_with_its_size() -> None:
    merged = merge([part("A", [1, 2, 3]), part("B", [1, 6, 7], -0.005)], "run a")
    (finding,) = merged.findings
    assert (finding.severity, finding.code, finding.limit) == ("warning", "setup-shift", SHIFT_LIMIT)
    assert finding.value == pytest.approx(-0.005, abs=1e-4)
    assert re.fullmatch(r"The resonances of set-up B lie 0\.50\d % below those of set-up A\.", finding.message)


def test_set_ups_without_resemblance_are_not_compared() -> None:
    rng = np.random.default_rng(0)
    other = part("B", [1, 6])
    noise = rng.standard_normal(other.frfs.values.shape) + 0j
    strange = FrfSet(FREQUENCIES, noise, other.frfs.outputs, other.frfs.inputs, "accelerance", "(m/s^2)/N")
    (finding,) = merge([part("A", [1, 2]), Part(strange, "B", "b")]).findings
    assert finding.severity == "warning" and "resemble" in finding.message


def test_no_parts_are_refused() -> None:
    with pytest.raises(InputError, match="no FRFs to merge"):
        merge([])


def test_the_same_frf_twice_needs_set_ups() -> None:
    with pytest.raises(InputError, match=r"twice in one set-up; got 1:\+Z/1:\+Z in A.h5 and A.h5"):
        merge([part("A", [1, 2]), part("A", [1, 3])])


def test_a_campaign_of_three_set_ups(tmp_path: Path) -> None:
    (tmp_path / "raw").mkdir()
    for setup, nodes in (("A", [1, 2, 3]), ("B", [1, 4, 5]), ("C", [1, 6, 7])):
        store.save(tmp_path / "raw" / f"setup_{setup}.h5", part(setup, nodes, 0.004 if setup == "C" else 0.0).frfs)
    (tmp_path / "campaign.toml").write_text(
        '[campaign]\nname = "x"\nfiles = "raw"\n[[runs]]\nid = "a"\nfiles = "setup_{setup}.h5"\n'
    )
    run = acquisition.open_campaign(tmp_path)["a"]
    assert run.frfs[0].values.shape == (len(FREQUENCIES), 7, 1)
    assert [(finding.severity, finding.where) for finding in run.findings] == [
        ("info", "run a, set-up B"),
        ("warning", "run a, set-up C"),
    ]


@pytest.mark.parametrize(("factor", "code"), [(9.80665, "setup-level"), (-1.0, "setup-sign"), (1.1, "")])
@pytest.mark.parametrize("shift", [0.0, 0.004])
def test_level_and_sign_of_what_set_ups_have_in_common(factor: float, code: str, shift: float) -> None:
    """A beam of five known modes; the second set-up counts g, hangs upside down, or is calibrated within 10 %."""
    other = part("B", [1, 4, 5], shift, noise=0.002)
    other = replace(other, frfs=replace(other.frfs, values=factor * other.frfs.values))
    found = merge([part("A", [1, 2, 3], noise=0.002), other], "run").findings
    assert [finding.code for finding in found if finding.code != "setup-shift"] == ([code] if code else [])
    if code:
        finding = next(finding for finding in found if finding.code == code)
        assert finding.severity == "error" and finding.where == "run, set-up B, 1:+Z/1:+Z"
    if code == "setup-level":
        assert "as if g had been taken for m/s^2" in finding.message
        assert finding.value == pytest.approx(factor, rel=0.02)


def test_a_sensor_turned_round_and_noted_so_has_no_other_sign() -> None:
    parts = [part("A", [1, 2]), part("B", [1, 3], sign=-1)]
    assert [finding.code for finding in merge(parts).findings] == ["setup-shift"]


def test_set_ups_with_nothing_in_common_are_not_compared_in_level() -> None:
    parts = [part("A", [1, 2]), replace(part("B", [3, 4]), setup="B")]
    assert {finding.code for finding in merge(parts).findings} == {"setup-shift"}
