"""Curves of steady states as a table, a picture and a container show them."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

import acquisition
from acquisition.model_file import FrfTable
from ema import show, simulate, store
from ema.cli.simulation_job import Job
from ema.cli.steady_state_curves import _stretches, with_curves
from ema.data import BeamModel, Damping, FrictionLaw, Joint, Matrices
from ema.data.stability import FloquetMultipliers, SteadyStateCurve
from ema.dof import Dof
from ema.examples import beam_model
from ema.interop import to_dataframe
from ema.progress import silent
from ema.simulate import curve_following, steady_state_curves
from ema.simulate.harmonic import Condensed, _Point
from ema.simulate.stability import _contradicted

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


@pytest.mark.parametrize("present", [("stable",), ("undecided",), ("stable", "undecided"), ("unstable", "stable")])
def test_the_legend_has_the_verdicts_that_are_drawn_and_no_others(present):
    """The last point draws nothing by itself: its verdict is that of no stretch."""
    verdicts = tuple(present[n * len(present) // 6] for n in range(6))
    legend = show.steady_state_curves([replace(FOLDED, verdicts=verdicts)]).axes[0].get_legend()
    words = [label.get_text() for label in legend.get_texts()]
    assert words == ["2 N", *(word for word in ("stable", "unstable", "undecided") if word in present)]


@pytest.mark.parametrize("band", [(90.0, 123.0), (105.0, 160.0), (61.3, 133.7)])
def test_a_curve_ends_at_the_edge_of_its_band(band):
    """There it is the solution that the harmonic balance has at that frequency."""
    (curve,) = simulate.frf_curves(hysteretic(), band, 25.0, "1:+X", ["1:+X"], searched=0, stability=False)
    assert curve.ends == ("edge", "edge")
    np.testing.assert_allclose(curve.frequencies[[0, -1]], band, rtol=1e-12)
    assert np.all((band[0] <= curve.frequencies) & (curve.frequencies <= band[1]))
    alone = simulate.frf(hysteretic(), np.array([band[1]]), 25.0, "1:+X", ["1:+X"])
    value = alone.values[0, 0, list(alone.orders).index(1)]
    allowed = curve.error_estimate[-1] + alone.error_estimate[0]
    assert abs(curve.values[-1, 0] - value) <= allowed * abs(value) and 0 < allowed < 0.011


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


def test_the_curves_of_a_job_are_stored_tabulated_and_drawn(job, tmp_path):
    store.save(tmp_path / "frf.h5", job.contents)
    loaded = store.load(tmp_path / "frf.h5")
    (name,) = loaded
    curve, before = loaded[name], job.contents[name]
    assert name == "curve 1, 1 N, F_N 100 N" and isinstance(curve, SteadyStateCurve)
    for field in fields(curve):
        np.testing.assert_array_equal(getattr(curve, field.name), getattr(before, field.name))
    table = to_dataframe(curve)
    np.testing.assert_array_equal(table["1:+X [m]"], curve.values[:, 0])
    assert table.attrs["units"]["frequency [Hz]"] == "Hz" and set(table["stability"]) == {"stable"}
    assert len(show.plot(curve).axes) == len(show.plot([curve, FOLDED]).axes) == 1


TIP = "beam 2:20:+Z"


def double_beam(pressed: float) -> BeamModel:
    return acquisition.open_model(Path(__file__).parents[2] / "datasets" / "double_beam").with_normal_force(pressed)


@pytest.mark.parametrize(("band", "share"), [((10.9, 11.7), 0.005), ((18.1, 18.7), 0.0025), ((26.0, 26.8), 0.001)])
def test_curves_pass_where_waves_of_higher_modes_make_contacts_stick(band: tuple[float, float], share: float) -> None:
    """Masing springs under a constant normal force and damping have one steady state at each frequency (Visintin 1994).

    So their curve never turns back. Higher modes ride on the motion where an odd multiple of the frequency meets them:
    contacts stick for a moment more within the period, and the curve has a corner.
    """
    pressed = float(np.random.default_rng(int(10 * band[0])).uniform(100.0, 400.0))
    (curve,) = simulate.frf_curves(double_beam(pressed), band, share * pressed, TIP, [TIP], searched=0, stability=False)
    assert curve.ends == ("edge", "edge") and curve.reasons == ("", "")
    assert np.all(np.diff(curve.frequencies) > 0) and curve.frequencies[-1] >= band[1]
    assert curve.error_estimate.max() <= 5e-3 and len(set(curve.harmonics)) > 1


def hysteretic() -> BeamModel:
    """1 kg on springs, held by a wall that does not move and a Masing contact on it."""
    dofs, wall = (Dof(1, "+X"), Dof(1, "+Z")), (Dof(1, "+X", "wall"), Dof(1, "+Z", "wall"))
    joint = Joint("contact", ((1, 1),), (0.0, 0.0), simulate.Masing(1.0, 4e5), 30.0, 1.0)
    host = Matrices(np.eye(2), 4e5 * np.eye(2), dofs)
    return BeamModel(host, Matrices(1e9 * np.eye(2), 1e18 * np.eye(2), wall), (joint,), Damping(mass_factor=18.0))


def followed(model: BeamModel) -> tuple[SteadyStateCurve, ...]:
    return simulate.frf_curves(model, (90.0, 160.0), 25.0, "1:+X", ["1:+X"], searched=1, starts=0, stability=False)


def test_a_curve_that_was_lost_says_where_and_why_and_its_parts_are_not_called_detached(monkeypatch) -> None:
    monkeypatch.setattr(curve_following, "_BUDGETS", 1e-3)
    curves = followed(hysteretic())
    assert len(curves) > 1 and curves[0].ends == ("edge", "lost")
    assert curves[0].reasons == ("", "the budget ended it") and 90.0 < curves[0].frequencies[-1] < 160.0
    assert not any(curve.detached for curve in curves)


def test_a_budget_that_is_enough_follows_the_whole_curve() -> None:
    assert [curve.ends for curve in followed(hysteretic())] == [("edge", "edge")]


def test_states_of_masing_springs_on_a_damped_beam_are_stable() -> None:
    """Friction takes energy from the difference of any two motions, and damping the rest of it: they have to meet.

    Higher modes turn many times in a period of the force; the phases of their multipliers say nothing of that.
    """
    rng = np.random.default_rng(2612)
    pressed = float(rng.uniform(150.0, 300.0))
    model = double_beam(pressed)
    response = simulate.frf(model, np.array([10.0, 13.9, 14.3]), rng.uniform(0.004, 0.006) * pressed, TIP, [TIP])
    multipliers = simulate.floquet_multipliers(model, response)
    assert [one.verdict for one in multipliers] == ["stable"] * 3
    assert all(0.3 < one.largest < 0.9 and one.errors.max() < 1.0 for one in multipliers)


@pytest.mark.parametrize("draw", [(77, 43), (78, 49), (78, 68)])
def test_a_verdict_that_more_steps_do_not_contradict_stands(draw: tuple[int, int]) -> None:
    """States of Masing springs on a damped beam are stable, as above: of draws 0 to 99 of seed 78 five were undecided.

    With fewer steps of the period three of them were stable. With 4096 a contact turns at the very end of a step.
    """
    rng = np.random.default_rng(draw)
    pressed, frequency, share = rng.uniform(100.0, 400.0), rng.uniform(10.0, 40.0), 10 ** rng.uniform(-2.7, -1.7)
    model = double_beam(float(pressed))
    response = simulate.frf(model, np.array([frequency]), float(share * pressed), TIP, [TIP])
    (one,) = simulate.floquet_multipliers(model, response)
    assert one.verdict == "stable" and one.reason == "" and one.largest < 1.0


def test_an_undecided_state_says_why() -> None:
    model = replace(beam_model(), damping=Damping())
    response = simulate.frf(model, np.array([60.0]), 1.0, "1:+X", ["1:+X"])
    (one,) = simulate.floquet_multipliers(model, response)
    assert one.verdict == "undecided" and one.reason == "a multiplier is within its error of the unit circle"


def test_every_undecided_point_of_a_curve_says_why() -> None:
    """Without any damping a multiplier is on the unit circle; with some it is not."""
    computed = {}
    for ratio in (0.0, 0.01):
        model = replace(beam_model(), damping=Damping(ratio=ratio))
        for stability in (True, False):
            (computed[ratio, stability],) = simulate.frf_curves(
                model, (60.0, 61.0), 1.0, "1:+X", ["1:+X"], searched=0, stability=stability
            )
    for (ratio, stability), curve in computed.items():
        decided = bool(ratio) and stability
        assert set(curve.verdicts) == {"stable" if decided else "undecided"}
        why = (
            "a multiplier is within its error of the unit circle" if stability else "its multipliers were not computed"
        )
        assert curve.undecided_because == ("" if decided else why,) * len(curve.frequencies)
        assert list(to_dataframe(curve)["undecided because"]) == list(curve.undecided_because)


def test_a_stretch_of_a_table_has_the_reasons_of_its_undecided_points() -> None:
    because = ("", "", "near", "", "far", "")
    rows = _stretches(replace(FOLDED, undecided_because=because))
    assert [row["undecided because"] for row in rows] == ["", "near", "", "far", ""]
    one = _stretches(replace(FOLDED, verdicts=("undecided",) * 6, undecided_because=because))
    assert [row["undecided because"] for row in one] == ["near or far"]
    assert [row["undecided because"] for row in _stretches(FOLDED)] == [""] * 5
    assert list(to_dataframe(FOLDED)["undecided because"]) == [""] * 6


def smooth(law: FrictionLaw, draw: int) -> tuple[BeamModel, float]:
    """One to three masses in a row, each with a contact on a wall that does not move, and a force in N."""
    rng, spring = np.random.default_rng([2712, draw]), (2 * np.pi * 100) ** 2
    nodes = int(rng.integers(1, 4))
    stiffness = np.diag(np.tile([0.0, 2 * spring], nodes))
    for n in range(0, 2 * nodes, 2):
        stiffness[n, n] += spring * rng.uniform(0.7, 1.4)
        if n:
            link = spring * rng.uniform(0.3, 1.0)
            stiffness[np.ix_([n - 2, n], [n - 2, n])] += link * np.array([[1, -1], [-1, 1]])
    dofs, walls = (
        tuple(Dof(n + 1, axis, body) for n in range(nodes) for axis in ("+X", "+Z")) for body in ("", "wall")
    )
    pairs = tuple((n + 1, n + 1) for n in range(nodes))
    own = replace(law, contact_stiffness=float(spring * 10 ** rng.uniform(-0.3, 0.7)))
    joint, size = Joint("contact", pairs, (0.0, 0.0), own, 30.0 * nodes, 1.0), 2 * nodes
    wall = Matrices(1e9 * np.eye(size), 1e18 * np.eye(size), walls)
    model = BeamModel(Matrices(np.eye(size), stiffness, dofs), wall, (joint,), Damping(ratio=0.01))
    return model, float(10 ** rng.uniform(1.0, 2.2))


@pytest.mark.parametrize(
    "law",
    [simulate.BoucWen(1.0, 1.0, 2.0, 0.1), simulate.Dahl(1.0, 1.0), simulate.LuGre(1.0, 1.0, 30.0, 0.0, 1.1, 1e-2)],
    ids=lambda law: law.name,
)
def test_every_point_of_a_curve_is_in_balance_with_the_nodes_that_it_was_solved_with(law, monkeypatch) -> None:
    """The number of nodes changes along a curve; forces of a point with those of another one leave a residual."""
    seen: list[tuple[Condensed, _Point]] = []
    computed = steady_state_curves.multipliers_of

    def kept(condensed: Condensed, point: _Point):
        seen.append((condensed, point))
        return computed(condensed, point)

    monkeypatch.setattr(steady_state_curves, "multipliers_of", kept)
    for draw in range(2):
        model, force = smooth(law, draw)
        simulate.frf_curves(model, (90.0, 130.0), force, "1:+X", ["1:+X"], searched=0)
    assert len(seen) > 40
    for condensed, point in seen:
        drive, gains = condensed.drive(point.omega, point.count), condensed.gains(point.omega, point.count)
        rest = condensed.kernels.residual(point.amplitudes, drive, gains, point.forces)
        # where Newton's method ends
        assert np.linalg.norm(rest) <= 1.001e-9 * np.linalg.norm(point.amplitudes)


def test_a_decided_state_is_contradicted_by_a_multiplier_beyond_its_errors() -> None:
    stable = FloquetMultipliers(np.array([0.8, -0.3 + 0j]), np.array([0.1, 0.4]))
    unstable = FloquetMultipliers(np.array([1.3, 0.9 + 0j]), np.array([0.1, 0.3]))
    assert [_contradicted(stable, np.array([size, 0.1j])) for size in (0.2, 0.89, 0.91)] == [False, False, True]
    assert [_contradicted(unstable, np.array([size, 0.1j])) for size in (1.19, 1.21, 1.9)] == [True, False, False]


def test_more_harmonics_than_a_period_has_steps_leave_the_multipliers_as_they_are() -> None:
    """Those of few harmonics have the time solver's motion too; steps do not see the highest ones."""
    frequencies, sizes = np.array([125.0]), []
    for highest in (31, 301):
        settings = simulate.HarmonicBalance(harmonics=highest)
        response = simulate.frf(hysteretic(), frequencies, 25.0, "1:+X", ["1:+X"], settings)
        (one,) = simulate.floquet_multipliers(hysteretic(), response, settings)
        assert one.verdict == "stable"
        sizes.append((one.largest, one.errors[0]))
    assert abs(sizes[0][0] - sizes[1][0]) <= sizes[0][1] + sizes[1][1]
