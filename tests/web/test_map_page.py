"""A map over excitation and normal force on the page of `ema app`, in a real Chromium."""

from pathlib import Path
from typing import Any

import pytest

from tests.unit.test_map_campaign import campaign
from tests.web.conftest import Served

RECIPE = """
campaign = "."
runs = ["run_10_50"]

[fit]
band = [475, 520]
orders = [2, 8, 2]

[[map]]
name = "mode 1"
near = 495
"""


@pytest.fixture
def mapped(tmp_path: Path):
    folder = campaign(tmp_path / "small")
    (folder / "recipe.toml").write_text(RECIPE, encoding="utf-8")
    app = Served(folder)
    app.start()
    yield app
    app.kill()


def click_point(window: Any, level: int, force: int) -> None:
    window.page.locator("#chart").scroll_into_view_if_needed()
    at = window.page.evaluate(
        """([level, force]) => { const plot = document.getElementById("chart"), box = plot.getBoundingClientRect(), axes = plot._fullLayout;
        return [box.left + axes.xaxis._offset + axes.xaxis.c2p(force), box.top + axes.yaxis._offset + axes.yaxis.c2p(level)]; }""",
        [level, force],
    )
    window.page.mouse.move(*at)
    window.page.wait_for_timeout(150)
    window.page.mouse.click(*at)


def test_a_click_on_a_map_shows_the_frf_behind_it(mapped: Served, window: Any):
    one = window(mapped.address)
    assert one.page.locator("#run option").all_text_contents() == ["run_10_50"]
    one.page.wait_for_selector("#chart .heatmaplayer image", state="attached", timeout=30000)
    click_point(one, 1, 1)
    one.page.wait_for_selector("#point[data-run='run_20_100']", timeout=30000)
    told = one.page.inner_text("#seen")
    assert told.startswith("Run run_20_100, 1:+Z/1:+Z, next to F_E 20 N and F_N 100 N: 495.69")
    drawn = one.page.evaluate("document.getElementById('point').data[0].x.length")
    assert drawn > 20
    click_point(one, 0, 0)
    one.page.wait_for_selector("#point[data-run='run_10_50']", timeout=30000)
    assert one.error() == "" and [text for text in one.told if "favicon" not in text] == []
