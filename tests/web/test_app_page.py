"""The page of `ema app` in a real Chromium."""

import tomllib
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

import acquisition
from ema import store

MODES = [60, 105, 170]


def click_pole(window: Any, row: int) -> None:
    """A click of the mouse on the letter of a pole."""
    place = window.page.evaluate(
        """row => { const plot = document.getElementById("poles"), box = plot.getBoundingClientRect(), axes = plot._fullLayout;
        return [box.left + axes._size.l + axes.xaxis.d2p(page.poles.frequency[row]), box.top + axes._size.t + axes.yaxis.d2p(page.poles.order[row])]; }""",
        row,
    )
    window.page.mouse.move(*place)
    window.page.wait_for_timeout(150)
    window.page.mouse.click(*place)


def still(window: Any) -> bool:
    """Whether two pictures of the moving shape are the same."""
    canvas = window.page.locator("#shape")
    canvas.scroll_into_view_if_needed()
    first = canvas.screenshot()
    window.page.wait_for_timeout(250)
    return bool(first == canvas.screenshot())


def test_a_session_from_opening_to_opening_again(served: Any, window: Any):
    one = window(served.address)
    assert one.modes() == MODES and "no friction beam" in one.page.inner_text("#force")
    picked = one.page.evaluate("page.poles.picked")

    # a click drops the pole, a second one picks it again, undo takes that back
    click_pole(one, picked[1])
    one.waits(1)
    assert one.modes() == [60, 170]
    assert one.page.get_attribute("#mac", "data-modes") == "2"
    assert one.page.locator("#mode option").count() == 2
    assert one.page.inner_text("#undo") == "Undo: drop 105 Hz"
    click_pole(one, picked[1])
    one.waits(2)
    assert one.modes() == MODES
    one.page.keyboard.press("u")
    one.waits(3)
    assert one.modes() == [60, 170]

    # the shape moves, stops and turns
    assert not still(one)
    one.page.click("#move")
    assert still(one)
    before = one.page.locator("#shape").screenshot()
    one.page.locator("#shape").focus()
    one.page.keyboard.press("ArrowLeft")
    assert one.page.locator("#shape").screenshot() != before

    # an excluded blow is a repair with a reason
    used = int(one.page.get_attribute("#gallery", "data-used"))
    one.page.fill("#hit", "2")
    one.page.fill("#why", "<b>a door</b> slammed")
    one.page.fill("#who", "A. Tester")
    one.page.click("#exclude button")
    one.waits(4)
    assert int(one.page.get_attribute("#gallery", "data-used")) == used - 1
    assert one.modes() == [60, 170]

    one.page.keyboard.press("Escape")
    one.page.click("#save")
    one.eventually(lambda: one.page.inner_text("#save") == "Saved")
    (repair,) = tomllib.loads((served.folder / "campaign.toml").read_text(encoding="utf-8"))["repairs"]
    assert (repair["hits"], repair["who"], repair["why"]) == ([1], "A. Tester", "<b>a door</b> slammed")

    # what was not saved is lost with the server, what was saved is there again
    one.page.click("#modes button >> nth=0")
    one.eventually(lambda: one.modes() == [170])
    served.kill()
    one.eventually(lambda: "does not answer" in one.error())
    served.start()
    two = window(served.address)
    assert two.modes() == [60, 170]
    assert int(two.page.get_attribute("#gallery", "data-used")) == used - 1
    two.page.reload()
    two.page.wait_for_selector("body[data-revision]")
    assert two.modes() == [60, 170]
    held = store.load(served.folder / "_build" / "recipe_picked.h5")
    assert [round(f) for f in held.runs[0].modes.natural_frequencies] == [60, 170]
    assert [one for one in two.told if "favicon" not in one] == []


def test_two_windows_show_the_same_and_nothing_leaves_the_machine(served: Any, window: Any):
    one, two = window(served.address), window(served.address)
    one.page.click("#modes button >> nth=2")
    one.eventually(lambda: one.modes() == [60, 105])
    two.eventually(lambda: two.modes() == [60, 105])
    two.page.fill("#frequency", "170")
    two.page.click("#near button")
    one.eventually(lambda: one.modes() == MODES)
    hosts = {urlsplit(url).hostname for url in (*one.asked, *two.asked) if not url.startswith(("data:", "blob:"))}
    assert hosts == {"127.0.0.1"}
    assert one.told == two.told == []


def test_a_mistake_is_shown_and_the_page_lives_on(served: Any, window: Any):
    one = window(served.address)
    one.page.fill("#frequency", "140")
    one.page.click("#near button")
    one.eventually(lambda: "no pole near that frequency; got 140 Hz" in one.error())
    one.page.click("#close")
    assert one.error() == ""
    one.page.click("#modes button >> nth=0")
    one.eventually(lambda: one.modes() == [105, 170])


@pytest.mark.parametrize("kind", ["uff55", "uff58", "csv"])
def test_exports_arrive_as_files(served: Any, window: Any, tmp_path: Path, kind: str):
    one = window(served.address)
    with one.page.expect_download() as waiting:
        one.page.select_option("#export", kind)
    path = tmp_path / waiting.value.suggested_filename
    waiting.value.save_as(path)
    assert path.name == {"uff55": "bare_modes.uff", "uff58": "bare_frfs.uff", "csv": "bare_modes.csv"}[kind]
    if kind == "csv":
        assert len(path.read_text().splitlines()) == 4
    else:
        held = acquisition.read(path)
        assert (held.modes if kind == "uff55" else held.frfs) and held.geometry is not None


def test_the_moving_report_moves_and_asks_for_nothing(chromium: Any, tmp_path: Path):
    import ema.report
    from tests.unit.report_corpus import plate, run_result, study

    geometry = plate(5, 4)
    path = ema.report.write(study((run_result("bare", geometry),), geometry), tmp_path / "r.html")
    page, told, asked = chromium.new_page(), [], []
    page.on("console", lambda message: told.append(message.text))
    page.on("pageerror", lambda error: told.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(path.as_uri())
    canvas = page.locator(".motion canvas")
    canvas.scroll_into_view_if_needed()
    pictures = []
    for _ in range(2):
        page.wait_for_timeout(250)
        pictures.append(canvas.screenshot())
    assert pictures[0] != pictures[1]
    assert page.locator(".motion select option").count() == 4
    assert told == [] and [url for url in asked if not url.startswith("data:")] == [path.as_uri()]
    page.close()
