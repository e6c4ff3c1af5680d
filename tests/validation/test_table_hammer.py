"""The built-in hammer campaign against the modes that it was made from, as `ema demo` runs it outside the checkout."""

import os
import shutil
import tomllib

import pytest

from ema import synthesis
from ema.datasets import builtin, table
from tests.validation.recipes import result_of


@pytest.fixture(scope="module")
def folder(demonstration, tmp_path_factory):
    """Where the demonstration writes its files; its signals, which would come out the same, are there."""
    folder = tmp_path_factory.mktemp("demonstration")
    written = demonstration("virtual_table_hammer") / builtin.RAW
    shutil.copytree(written, folder / "datasets" / "virtual_table_hammer" / builtin.RAW)
    return folder


@pytest.fixture(scope="module")
def result(root, folder):
    """The quickest demonstration; CI runs the main one from the wheel."""
    stored = folder / "reports" / "_build" / "table_hammer.h5"
    environment = os.environ | {"PYTHONPATH": str(root)}
    return result_of(["demo", folder, "--name", "table_hammer"], stored, environment, said="virtual rig", cwd=folder)


def test_every_number_of_the_recipe_is_met(result):
    assert len(result.expectations) == 36
    assert [one for one in result.expectations if not one.met] == []


def test_the_faults_are_found_and_nothing_else_is_left_out(result):
    for run, code, point, hit in ((result.runs[0], "double-hit", 17, 2), (result.runs[1], "overload", 42, 1)):
        rejected = [one for one in run.hits.hits if not one.accepted]
        assert {(one.dof.node, one.index) for one in rejected} <= {(point, hit), (point, hit + 1)}
        assert len(run.hits.accepted) == 399
        assert [one.code for one in run.findings if one.severity != "info"] == [code]


def test_the_repair_is_in_the_result(result):
    (repair,) = result.repairs
    assert repair.what.startswith("reverse") and repair.who == "virtual rig" and "upside down" in repair.why


def test_frfs_are_those_of_the_truth(result):
    for run, truth in zip(result.runs, (table.bare(), table.with_beam()), strict=True):
        measured = run.frfs.band(200, 2200)
        exact = synthesis.frfs(
            truth, measured.frequencies, "accelerance", outputs=measured.outputs, inputs=measured.inputs
        )
        error = abs(measured.values - exact.values).max() / abs(exact.values).max()
        assert error < 5e-3, "a reversed sensor would give 2"


def test_the_written_truth_is_the_truth(result, folder):
    written = tomllib.loads((folder / "datasets/virtual_table_hammer/raw" / builtin.TRUTH).read_text(encoding="utf-8"))
    for run, truth in (("bare", table.bare()), ("beam_1kN", table.with_beam())):
        assert written["runs"][run]["natural_frequencies"] == pytest.approx(list(truth.natural_frequencies), abs=1e-4)
        assert written["runs"][run]["damping_ratios"] == pytest.approx(list(truth.damping_ratios), abs=1e-6)
    assert written["runs"]["beam_1kN"]["natural_frequencies"][3] == pytest.approx(492, abs=1e-4)
    assert written["runs"]["beam_1kN"]["damping_ratios"][3] == pytest.approx(0.018, abs=1e-6)
