"""Curves of steady states as a table, a picture and a container show them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import acquisition
from acquisition.model_file import FrfTable
from ema import show, simulate
from ema.cli.simulation_job import Job
from ema.cli.steady_state_curves import with_curves
from ema.data import Damping
from ema.data.stability import SteadyStateCurve
from ema.dof import Dof
from ema.examples import beam_model
from ema.progress import silent

FOLDED = SteadyStateCurve(
    frequencies=np.array([40.0, 41.0, 42.0, 41.5, 41.0, 42.0]),
    values=np.array([[1e-4], [2e-4], [3e-4], [4e-4], [5e-4], [6e-4]], complex),
    dofs=(Dof(1, "+X"),),
    force=2.0,
    largest=np.array([0.9, 0.95, 1.0, 1.1, 1.0, 0.9]),
    verdicts=("stable", "stable", "undecided", "unstable", "undecided", "stable"),
    losses=("", "", "fold", "fold", "fold", ""),
    error_estimate=np.full(6, 4e-3),
    harmonics=np.array([5, 5, 7, 7, 7, 5]),
)


def test_folds_are_where_a_curve_turns_back():
    np.testing.assert_array_equal(FOLDED.folds, [42.0, 41.0])


def test_unstable_parts_are_dashed_and_undecided_ones_dotted():
    axes = show.steady_state_curves([FOLDED]).axes[0]
    drawn = [(line.get_linestyle(), *line.get_xdata()) for line in axes.lines]
    assert drawn == [("-", 40.0, 41.0, 42.0), (":", 42.0, 41.5), ("--", 41.5, 41.0), (":", 41.0, 42.0)]
    np.testing.assert_allclose(axes.lines[0].get_ydata(), [50.0, 100.0, 150.0])
    assert [label.get_text() for label in axes.get_legend().get_texts()] == ["2 N", "stable", "unstable", "undecided"]


def test_no_curve_is_a_note_in_the_picture():
    assert not show.steady_state_curves([]).axes[0].lines


@pytest.fixture(scope="module")
def job():
    model = replace(beam_model(), damping=Damping(ratio=0.01))
    table = FrfTable(force=["1 N"], at="1:+X", band=["60 Hz", "62 Hz"], lines=5)
    return with_curves(Job({}, {}, []), table, {"100 N": model}, [1.0], silent)


def test_a_job_has_a_row_for_every_stretch_and_says_what_it_cannot(job):
    (row,) = job.more["stability"]
    assert row["from [Hz]"] == pytest.approx(60.0, rel=1e-3) and row["to [Hz]"] >= 62.0
    assert row["stability"] == "stable" and row["loss"] == "" and 0.9 < row["largest multiplier"] < 1
    assert row["curve"] == 1 and not row["detached"]
    assert "there may be others" in job.statement and "stability" in job.pictures


def test_parts_of_a_curve_that_was_lost_are_not_called_detached() -> None:
    """Masing springs under a constant normal force and damping: disturbances never grow, so there is one curve."""
    beams = acquisition.open_model(Path(__file__).parents[2] / "datasets" / "double_beam").with_normal_force(200.0)
    tip = "beam 2:20:+Z"
    curves = simulate.frf_curves(beams, (10.0, 40.0), 1.0, tip, [tip], searched=1, starts=2, stability=False)
    assert len(curves) > 1 and any("lost" in curve.ends for curve in curves)  # else this asks nothing
    assert not any(curve.detached for curve in curves)
