"""Workbooks as their programs leave them: sheets of charts, hidden sheets, times as dates of the program."""

from datetime import datetime, time, timedelta
from pathlib import Path

import numpy as np
import pytest

import acquisition
from acquisition.contents import Contents
from ema.errors import InputError

openpyxl = pytest.importorskip("openpyxl")
SIGNAL = np.round(np.random.default_rng(5).uniform(-1, 1, 30), 6)


def _rows(
    sheet: object, sign: float = 1.0, titles: tuple[str, ...] = ("t [s]", "a [m/s^2]"), stamps: object = None
) -> None:
    sheet.append(titles)
    for k, value in enumerate(SIGNAL):
        first = (k / 100,) if stamps is None else stamps(k)
        sheet.append([*first, float(sign * value)])


def _as_expected(contents: Contents, rate: float = 100.0) -> None:
    (record,) = contents.recordings
    assert record.sampling_rate == pytest.approx(rate, rel=1e-9)
    assert [channel.name for channel in record.channels] == ["a"]
    np.testing.assert_allclose(record.signals[0], SIGNAL, rtol=1e-15)


def test_an_empty_sheet_of_charts_is_passed_over(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    _rows(book.active)
    book.create_chartsheet("chart", 0)
    book.save(tmp_path / "a.xlsx")
    _as_expected(acquisition.read(tmp_path / "a.xlsx"))


@pytest.mark.parametrize("state", ["hidden", "veryHidden"])
def test_a_sheet_that_nobody_sees_is_read_last(tmp_path: Path, state: str) -> None:
    """The first sheet had been read, hidden or not, without saying so."""
    book = openpyxl.Workbook()
    _rows(book.active, -1.0)
    book.active.title, book.active.sheet_state = "old", state
    _rows(book.create_sheet("new"))
    book.active = 1
    book.save(tmp_path / "a.xlsx")
    contents = acquisition.read(tmp_path / "a.xlsx")
    _as_expected(contents)
    assert [(note.code, "old (hidden)" in note.message) for note in contents.findings] == [("not-read", True)]
    old = acquisition.read(tmp_path / "a.xlsx", sheet="old")
    np.testing.assert_array_equal(old.recordings[0].signals[0], -SIGNAL)
    assert old.findings == ()


def test_numbers_that_only_a_hidden_sheet_holds_are_named(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    _rows(book.active)
    book.active.title, book.active.sheet_state = "old", "hidden"
    book.create_sheet("notes").append(["measured on Monday"])
    book.active = 1
    book.save(tmp_path / "a.xlsx")
    contents = acquisition.read(tmp_path / "a.xlsx")
    _as_expected(contents)
    assert [note.code for note in contents.findings] == ["hidden-sheet", "not-read"]


NOON = datetime(2024, 3, 1, 23, 59, 59, 900000)
STAMPS = {
    "dates and times": (("Time",), lambda k: (NOON + timedelta(milliseconds=10 * k),)),
    "times of day over midnight": (("Time",), lambda k: ((NOON + timedelta(milliseconds=10 * k)).time(),)),
    "durations": (("Time",), lambda k: (timedelta(milliseconds=10 * k),)),
    "a date beside": (("Date", "Time"), lambda k: (datetime(2024, 3, 1), time(12, 0, 0, 10000 * k))),
}


@pytest.mark.parametrize("kind", STAMPS)
@pytest.mark.parametrize("head", [False, True], ids=["titles", "a head"])
def test_dates_of_the_workbook_are_times(tmp_path: Path, kind: str, head: bool) -> None:
    """As the time stamps of text tables are."""
    titles, stamps = STAMPS[kind]
    book = openpyxl.Workbook()
    if head:
        book.active.append(["measured on", datetime(2024, 3, 1, 8)])
        book.active.append([])
    _rows(book.active, 1.0, (*titles, "a [m/s^2]"), stamps)
    book.save(tmp_path / "a.xlsx")
    contents = acquisition.read(tmp_path / "a.xlsx")
    _as_expected(contents)
    assert contents.findings == ()


def test_a_number_among_dates_is_named(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    _rows(
        book.active, 1.0, ("Time", "a [m/s^2]"), lambda k: (3.5 if k == 27 else NOON + timedelta(milliseconds=10 * k),)
    )
    book.save(tmp_path / "a.xlsx")
    with pytest.raises(InputError, match=r"cell A29.*got 3.5, expected a date, a time of day"):
        acquisition.read(tmp_path / "a.xlsx")
