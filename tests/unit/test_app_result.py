"""`ema app RESULT.h5` finds the signals behind a result, and only those that it was made from."""

from pathlib import Path

import pytest

import ema.report
from ema.app.state import Workbench
from ema.cli.browsing import workbench
from ema.errors import InputError
from tests.journeys.small_campaign import HAMMER, RUN, campaign

RECIPE = 'campaign = ".."\n[fit]\nband = [20, 300]\norders = [2, 20, 2]\n'


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign with a recipe in a folder of its own, run once; the result is in ``_build`` below the recipe."""
    folder = tmp_path_factory.mktemp("app") / "four points"
    campaign(folder, channels=HAMMER, run=RUN)
    (folder / "reports").mkdir()
    (folder / "reports" / "four.toml").write_text(RECIPE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ema.report, "write", lambda result, path, **more: path, raising=False)
        workbench(folder / "reports" / "four.toml")
    return folder


def opened(study: Path) -> Workbench:
    return workbench(study / "reports" / "_build" / "four.h5")


def test_an_impact_is_excluded_and_frfs_are_shown_from_a_result_file(study: Path) -> None:
    bench = opened(study)
    run = bench.work.result.run.id
    before = bench.work.result
    assert before.hits is not None
    hit = next(place for place, one in enumerate(before.hits.hits) if one.accepted)
    bench.exclude(hit, why="the hand slipped", who="A. Tester")
    after = bench.work.result
    assert after.hits is not None and not after.hits.hits[hit].accepted
    assert (after.frfs.values != before.frfs.values).any()
    assert bench.look is not None and bench.look(run).values.shape[0] == len(before.frfs.frequencies)


def test_signals_or_settings_that_are_others_by_now_are_not_taken(study: Path) -> None:
    recipe = study / "reports" / "four.toml"
    recipe.write_text(RECIPE.replace("300", "290"))
    try:
        bench = opened(study)
        assert bench.again is None and bench.look is None
        with pytest.raises(InputError, match="the signals are not available"):
            bench.exclude(0, why="double hit", who="A. Tester")
    finally:
        recipe.write_text(RECIPE)
    signals = next(path for path in sorted(study.rglob("*")) if path.suffix in (".uff", ".csv", ".npy", ".txt", ".mat"))
    kept = signals.read_bytes()
    signals.write_bytes(kept + b"\n")
    try:
        assert opened(study).again is None
    finally:
        signals.write_bytes(kept)
    assert opened(study).again is not None


def test_a_result_whose_recipe_is_gone_is_shown_without_signals(study: Path, tmp_path: Path) -> None:
    alone = tmp_path / "four.h5"
    alone.write_bytes((study / "reports" / "_build" / "four.h5").read_bytes())
    bench = workbench(alone)
    assert bench.again is None and len(bench.work.result.modes.poles) > 0
