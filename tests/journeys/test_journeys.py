"""Tutorials 2 to 5 as they are written, and the numbers that a user has to see."""

import runpy
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ema
from ema import store
from ema.datasets import table
from tests.unit.test_record import RIG

HERE = Path(__file__).parent


def journey(number: int, folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The names at the end of a journey that was made from ``folder``."""
    monkeypatch.chdir(folder)
    return runpy.run_path(str(HERE / f"journey_{number}.py"))


@pytest.fixture(scope="module")
def place(root: Path, demonstration: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that holds the data of the project and nothing that was computed before."""
    demonstration("work_table_bending")
    folder = tmp_path_factory.mktemp("journeys")
    (folder / "datasets").symlink_to(root / "datasets", target_is_directory=True)
    (folder / "reports" / "_build").mkdir(parents=True)
    (folder / "tests" / "journeys").mkdir(parents=True)
    for name in ("journey_4.toml", "journey_4_place.toml"):
        shutil.copy(HERE / name, folder / "tests" / "journeys" / name)
    return folder


def test_shaker_runs_become_a_map_that_a_model_is_held_against(place: Path, monkeypatch, capsys):
    seen = journey(2, place, monkeypatch)
    chart = seen["chart"]
    assert list(chart.force_levels) == [15, 30] and len(chart.normal_forces) == 7
    best = chart.normal_forces[np.nanargmax(chart.damping, axis=1)]
    assert best == pytest.approx([25, 100], rel=0.02), "the ridge: at twice the force, press harder"
    assert 100 * np.nanmax(chart.damping) == pytest.approx(1.57, abs=0.05)
    assert 100 * chart.damping[0, -1] == pytest.approx(0.617, abs=0.01), "stuck, the damping of the table alone"
    assert (place / "reports" / "_build" / "journey_map.svg").read_text(encoding="utf-8").startswith("<?xml")

    found = journey(3, place, monkeypatch)["found"]
    assert found.verdict.agrees and found.inside == 1 and np.median(found.damping_ratio) == pytest.approx(1, abs=0.02)
    assert np.abs(found.frequency_error).max() < 0.004
    told = "100% of 14 points lie within the bounds."
    assert told in capsys.readouterr().out
    page = (place / "reports" / "_build" / "journey_comparison.html").read_text(encoding="utf-8")
    assert told in page


def test_a_hammer_test_becomes_a_place_and_a_normal_force(place: Path, table_hammer: Path, monkeypatch, capsys):
    pytest.importorskip("docx")
    result = journey(4, place, monkeypatch)["result"]
    best = result.placement.ranking.best
    assert best.damping.min() > 1.3 * 0.00638, "more than the table alone has"
    assert best.normal_force in (60.0, 120.0, 240.0)
    assert str(best.normal_force) in capsys.readouterr().out
    build = place / "reports" / "_build"
    assert "press every joint with" in (build / "journey_placement.html").read_text(encoding="utf-8")
    assert (build / "journey_placement.docx").stat().st_size > 50_000
    assert store.load(build / "journey_placement.h5").placement.ranking.best.normal_force == best.normal_force

    study = place / "tests" / "journeys" / "journey_4.toml"
    task = ema.study.read_placement(study)
    assert np.array_equal(task.modes.poles, result.runs[0].modes.poles), "those of the stored result"
    assert task.recipe.near == [499.0] and np.array_equal(task.geometry.xyz, result.campaign.geometry.xyz)
    study.write_text(study.read_text(encoding="utf-8").replace("[200, 1350]", "[200, 1300]"), encoding="utf-8")
    with pytest.raises(ema.EmaError, match="not that of its present recipe"):
        ema.study.read_placement(study)


def test_takes_become_modes(tmp_path: Path, monkeypatch, capsys):
    text = RIG.format(points="1, 5, 67", takes=2)
    ring, joint = text.index('[[channels]]\nname = "ring J1"'), text.index("[[joints]]")
    assert ring < joint
    (tmp_path / "today").mkdir()
    (tmp_path / "today" / "rig.toml").write_text(text[:ring], encoding="utf-8")
    modes = journey(5, tmp_path, monkeypatch)["modes"]
    truth = table.with_beam()
    for frequency, damping in zip(modes.natural_frequencies, modes.damping_ratios, strict=True):
        near = int(np.argmin(np.abs(truth.natural_frequencies - frequency)))
        assert frequency == pytest.approx(truth.natural_frequencies[near], rel=5e-4)
        assert damping == pytest.approx(truth.damping_ratios[near], rel=0.05)
    assert [round(f) for f in modes.natural_frequencies] == [492, 751, 982]
    assert capsys.readouterr().out.count("accepted") == 6
