"""Tutorial 1 as it is written, and the numbers that a user has to see."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from ema import shapes
from ema.datasets import table

SNIPPET = Path(__file__).with_name("journey_1.py")


def test_a_hammer_campaign_becomes_modes(table_hammer, root, monkeypatch, capsys):
    monkeypatch.chdir(root)
    seen = runpy.run_path(str(SNIPPET))

    run, frfs, modes, truth = seen["run"], seen["frfs"], seen["modes"], table.with_beam()
    assert [joint.joint for joint in run.condition.joints] == ["J1", "J2"]
    for joint in run.condition.joints:
        assert joint.mean == pytest.approx(1020, abs=1) and joint.std == pytest.approx(30, abs=1)
    assert frfs.values.shape[1:] == (2, 80) and frfs.quantity == "accelerance" and frfs.scaled

    inside = slice(3, 6)  # behind the three modes of the suspension
    assert truth.natural_frequencies[inside] == pytest.approx([492.0, 750.58, 981.85], abs=0.01)
    assert modes.natural_frequencies == pytest.approx(truth.natural_frequencies[inside], abs=0.01)
    assert modes.damping_ratios == pytest.approx(truth.damping_ratios[inside], rel=1e-3)
    assert modes.scaling == "unit modal mass"
    place = {dof.positive: row for row, dof in enumerate(modes.dofs)}
    ordered = modes.shapes[[place[dof] for dof in truth.dofs]]
    signs = np.array([dof.sign for dof in modes.dofs])[[place[dof] for dof in truth.dofs]]
    ordered = ordered * signs[:, None]
    assert np.diag(shapes.mac(ordered, truth.shapes[:, inside])) == pytest.approx(1, abs=1e-4)
    sizes = np.linalg.norm(ordered, axis=0) / np.linalg.norm(truth.shapes[:, inside], axis=0)
    assert sizes == pytest.approx(1, abs=0.01), "unit modal mass"

    header, _, first, *_ = capsys.readouterr().out.splitlines()
    assert "f [Hz]" in header and "zeta [%]" in header
    assert [float(word) for word in first.split()[:3]] == pytest.approx([1, 492.0, 1.8], abs=0.01)


def test_a_campaign_that_is_not_generated_yet_says_which_command_makes_it(root, tmp_path):
    import shutil

    import acquisition
    from ema.errors import InputError

    source = root / "datasets" / "virtual_table_hammer"
    shutil.copytree(source, tmp_path / "copy", ignore=shutil.ignore_patterns("raw", ".raw-*"))
    with pytest.raises(InputError, match=r"ema run reports/table_hammer.toml"):
        acquisition.open_campaign(tmp_path / "copy")
