"""Statements about the modes of runs: the number and the interval are those of the table of modes."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

from ema.data import Condition, Finding, FrfSet, ModalModel, Run, RunResult, Statement
from ema.data.modal import COVERAGE_FACTOR, damping_ratios, natural_frequencies
from ema.examples import frf_set, modal_model
from ema.fit import local_fit
from ema.report import maps as maps_of_report
from ema.report.numbers import MISSING
from ema.study import chain, recipe, statements
from tests.unit import measured_signals as drawn

NOT_LINEAR = Finding("error", "slip-then-ring", "run r", "the joint slips first.")


def judged(result: RunResult, quantity: str, near: float, **keys) -> Statement:
    table = recipe.StatementTable(
        text="t", source="s", quantity=quantity, verdict="matched", run="r", near=near, **{"low": 0.0, **keys}
    )
    return statements.judge([table], (), (result,))[0]


def result(modes: ModalModel, frfs: FrfSet | None = None, findings: tuple[Finding, ...] = ()) -> RunResult:
    return RunResult(Run("r", Condition()), frfs or frf_set(0.001), None, modes, findings=findings)


def accepted(shift: float = 0.02, std: tuple[float, float] = (0.05, 1e-4)) -> ModalModel:
    """The modes of the FRFs, each ``shift`` Hz off, with wide intervals."""
    modes = modal_model()
    poles = modes.poles * (1 + shift / modes.natural_frequencies)
    return replace(modes, poles=poles, covariance=np.tile(np.diag(np.square(std)), (3, 1, 1)))


@pytest.mark.parametrize(("row", "near"), [(0, 40.0), (1, 61.5), (2, 87.0)])
def test_a_statement_about_a_mode_has_the_number_and_the_interval_of_the_table_of_modes(row, near):
    modes = accepted()
    frequency = judged(result(modes), "run frequency", near)
    f = modes.natural_frequencies[row]
    assert frequency.value == pytest.approx(f, rel=1e-12) and "accepted mode of r" in frequency.quantity
    assert (frequency.lower, frequency.upper) == pytest.approx((f - 0.05 * COVERAGE_FACTOR, f + 0.05 * COVERAGE_FACTOR))
    damping = judged(result(modes), "run damping", near)
    zeta = 100 * modes.damping_ratios[row]
    assert damping.value == pytest.approx(zeta)
    assert damping.upper - damping.value == pytest.approx(0.01 * COVERAGE_FACTOR, rel=1e-5)


def linear(result: RunResult, near: float) -> Statement:
    """The frequency that is judged, which has to be that of one linear mode fitted to the FRFs."""
    statement = judged(result, "run frequency", near)
    assert statement.value == local_fit(result.frfs, near).natural_frequency
    assert "one linear mode fitted to the FRFs of r" in statement.quantity
    return statement


def test_where_the_structure_is_not_linear_the_frfs_are_read_at_the_level_of_the_test():
    linear(result(accepted(), findings=(NOT_LINEAR,)), 60.0)


def test_runs_that_stand_beside_each_other_are_read_in_one_way():
    """One run that is not linear: the accepted modes of the other are not set beside what a fit to its FRFs reads."""
    slips = replace(result(accepted(), findings=(NOT_LINEAR,)), run=Run("slips", Condition()))
    tables = [
        recipe.StatementTable(
            text="t", source="s", quantity=quantity, verdict="matched", run=run, near=60.0, low=0, **more
        )
        for run, quantity, more in (
            ("r", "run frequency", {}),
            ("slips", "run frequency", {}),
            ("slips", "run damping over run", {"other": "r"}),
        )
    ]
    both = (result(accepted()), slips)
    one, other, ratio = statements.judge(tables, (), both)
    assert one.value == other.value == local_fit(both[0].frfs, 60.0).natural_frequency
    assert ratio.value == 1.0 and all("one linear mode" in each.quantity for each in (one, other, ratio))
    alone = statements.judge(tables[:1], (), both)[0]
    assert "accepted mode" in alone.quantity and alone.value != one.value


def test_a_run_without_an_accepted_mode_makes_a_ratio_one_of_fits():
    lacks = replace(result(replace(accepted(), covariance=None)), run=Run("lacks", Condition()))
    table = recipe.StatementTable(
        text="t",
        source="s",
        quantity="run damping over run",
        verdict="matched",
        run="r",
        near=60.0,
        low=0,
        other="lacks",
    )
    (ratio,) = statements.judge([table], (), (result(accepted(std=(0.05, 1e-3))), lacks))
    assert ratio.value == 1.0 and "one linear mode" in ratio.quantity


def test_a_fit_that_the_report_shows_is_the_one_that_is_judged():
    shown = replace(local_fit(frf_set(0.001), 60.0), natural_frequency=60.4)
    run = replace(result(accepted(), findings=(NOT_LINEAR,)), equivalent=(shown,))
    assert judged(run, "run frequency", 60.0).value == 60.4


def test_a_mode_that_was_not_accepted_is_read_from_its_peak():
    modes = accepted()
    some = replace(
        modes,
        poles=modes.poles[[0, 2]],
        shapes=modes.shapes[:, [0, 2]],
        participation=modes.participation[:, [0, 2]],
        covariance=modes.covariance[[0, 2]],
    )
    linear(result(some), 60.0)
    linear(result(replace(modes, covariance=None)), 60.0)
    beside = replace(some, poles=np.array([modes.poles[0], 1.03 * modes.poles[1]]))
    linear(result(beside), 60.0)


def test_a_mode_that_does_not_exist_is_not_testable_and_the_others_are_judged():
    tables = [
        recipe.StatementTable(
            text=f"{near} Hz", source="s", quantity=quantity, verdict="matched", run="r", near=near, low=0, other="r"
        )
        for quantity in ("run frequency", "run damping", "run misfit", "run damping over run")
        for near in (60.0, 75.0, 500.0)
    ]
    verdicts = statements.judge(tables, (), (result(accepted()),))
    assert [one.verdict for one in verdicts] == ["matched", "not testable here", "not testable here"] * 4
    assert "a mode of r near 75 Hz (no peak near the wanted frequency)" in verdicts[1].reason
    assert "500 Hz" in verdicts[2].reason


def test_a_sentence_that_nothing_measures_is_listed_with_what_it_would_take():
    table = recipe.StatementTable(
        text="the change far from the beam over that beside it",
        source="section 2.2",
        sentence="It affects the whole structure.",
        verdict="not testable here",
        missing="responses beside the beam",
    )
    (one,) = statements.judge([table], (), ())
    assert one.met and one.quoted and np.isnan(one.value)
    assert one.reason == "It would take responses beside the beam."
    shown = [str(cell) for cell in maps_of_report._judged(one)]
    assert shown == [MISSING, MISSING, MISSING, MISSING, "not testable here", one.reason]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"missing": ""}, "needs a quantity, or in missing"),
        ({"verdict": "matched"}, "the verdict 'not testable here'"),
        ({"sentence": ""}, "has its sentence"),
        (
            {"quantity": "run damping", "run": "r", "near": 1.0, "low": 0},
            "leave out quantity, map, run and release, or it",
        ),
    ],
)
def test_such_a_sentence_claims_nothing_else(changes, said):
    whole = {"text": "t", "source": "s", "sentence": "A.", "verdict": "not testable here", "missing": "more"}
    with pytest.raises(ValueError, match=said):
        recipe.StatementTable(**(whole | changes))


@pytest.fixture(scope="module")
def shaken() -> list[tuple[drawn.Beam, RunResult]]:
    """Random tests of fresh beams."""
    pairs = []
    for seed in (9101, 9102):
        rng = np.random.default_rng(seed)
        beam = drawn.beam(rng, modes=3, points=3, nodes=False, dashpot=0.0)
        run = replace(drawn.shaker_run(rng, beam, 0.005, samples=8192), id="r")
        band = (0.01 * beam.rate, 0.4 * beam.rate)
        pairs.append((beam, chain.analyse(run, recipe.EstimateTable(), recipe.FitTable(band=band))))
    return pairs


def test_the_intervals_of_statements_hold_the_truth_of_random_tests(shaken):
    """As many as 95 % intervals do by chance. Of one linear mode fitted to the FRFs, which takes lines as independent, less
    than half did."""
    inside = []
    for beam, run in shaken:
        for f, zeta in zip(natural_frequencies(beam.poles), damping_ratios(beam.poles), strict=True):
            for quantity, truth in (("run frequency", f), ("run damping", 100 * zeta)):
                statement = judged(run, quantity, float(f))
                inside.append(statement.lower <= truth <= statement.upper)
    assert len(inside) == 12 and binom.cdf(np.sum(inside), 12, 0.95) > 1e-3
