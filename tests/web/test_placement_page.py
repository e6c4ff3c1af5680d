"""The placement on the page of `ema app`, in a real Chromium."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ema import store
from tests.unit.friction_nouns import placement
from tests.unit.report_corpus import EVIL, plate
from tests.web.conftest import Served


@pytest.fixture
def placed(master: Path, tmp_path: Path):
    folder = tmp_path / "four points"
    shutil.copytree(master, folder)
    store.save(folder / "placement.h5", replace(placement(plate(5, 4), warning=f"DOES NOT AGREE {EVIL}"), title=EVIL))
    app = Served(folder, more=("--placement", str(folder / "placement.h5")))
    app.start()
    yield app
    app.kill()


def click_place(window: Any, candidate: int) -> None:
    """A click of the mouse on a place of the map."""
    window.page.locator("#places").scroll_into_view_if_needed()
    at = window.page.evaluate(
        """one => { const plot = document.getElementById("places"), box = plot.getBoundingClientRect(), axes = plot._fullLayout;
        const [x, y] = page.placement.centres[one];
        return [box.left + axes.xaxis._offset + axes.xaxis.d2p(x), box.top + axes.yaxis._offset + axes.yaxis.d2p(y)]; }""",
        candidate,
    )
    window.page.mouse.move(*at)
    window.page.wait_for_timeout(150)
    window.page.mouse.click(*at)


def rows(window: Any) -> list[list[str]]:
    return [row.locator("td").all_text_contents() for row in window.page.locator("#forecast tbody tr").all()]


def test_a_click_on_a_place_shows_what_the_beam_does_there(placed: Served, window: Any):
    one = window(placed.address)
    shown = "#places[data-candidate='13']"
    one.page.wait_for_selector(shown, timeout=30000)
    assert one.page.inner_text("#warning") == f"DOES NOT AGREE {EVIL}"
    told = one.page.inner_text("#location")
    assert told.startswith("Rank 1. Bolts at (0.85, 0.4) m and (1.15, 0.4) m; F_N 123 N in every joint")
    assert "best for each level: 110, 140 N" in told and "all modes together" in told
    assert rows(one) == [
        ["1", "10", "507.00", "2.110", "1.80 … 2.30", "0.638"],
        ["1", "40", "503.00", "1.870", "1.50 … 2.00", "0.638"],
    ]
    assert "close to the edge" in one.page.inner_text("#flags")

    # a place that was not ranked has the numbers of the predictor, without interval
    click_place(one, 7)
    one.page.wait_for_selector("#places[data-candidate='7']")
    assert "one mode at a time" in one.page.inner_text("#location")
    assert rows(one)[0] == ["1", "10", "505.00", "1.350", "–", "0.638"]

    # without a mouse
    one.page.select_option("#place", "0")
    one.page.wait_for_selector("#places[data-candidate='0']")
    assert one.page.inner_text("#location").startswith("Rank 2.")
    assert one.error() == "" and [text for text in one.told if "favicon" not in text] == []


def test_without_a_placement_there_is_no_such_view(served: Served, window: Any):
    one = window(served.address)
    assert not one.page.is_visible("#placements")
