"""The sentence on a map: levels that share a best normal force are told together."""

import io
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from ema.cli.screen import show_result
from ema.data import Campaign, Expectation, MapResult, ModalMap, Statement, StudyResult
from ema.report.blocks import Book
from ema.report.expected import expectation_table
from ema.report.maps import map_sentence, statements
from ema.study.expectations import of_verdicts


def result(damping: np.ndarray) -> MapResult:
    chart = ModalMap(np.array([6.0, 10.0, 15.0, 30.0, 40.0]), np.array([25.0, 60.0]), 490 + 0 * damping, damping)
    return MapResult("mode 1", chart, np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.full((5, 2), np.nan))


def test_levels_with_one_best_force_are_a_range():
    told = map_sentence(result(np.array([[3, 1], [4, 1], [5, 1], [np.nan, np.nan], [1, 2.0]]) / 100))
    assert told.startswith("mode 1: most damping 5.00 % at F_E 15 N and F_N 25 N")
    assert told.endswith("best normal force over the excitation: 25 N at 6 to 15 N, 60 N at 40 N.")


def test_an_empty_map_says_so():
    assert map_sentence(result(np.full((5, 2), np.nan))) == "mode 1: no mode was found in any condition."


@pytest.mark.parametrize(
    ("value", "half", "shown"),
    [
        (996.80, 0.11, ("996.80", "996.69 to 996.91")),
        (249.19993, 0.00025, ("249.19993", "249.19968 to 249.20018")),
        (0.638, 0.02, ("0.638", "0.618 to 0.658")),
        (0.0498, 0.0, ("0.049800", "0.049800 to 0.049800")),
    ],
)
def test_an_interval_is_shown_with_the_digits_that_tell_its_ends_apart(value, half, shown):
    one = Statement(
        "f4", "Table 1", "run frequency", 0.0, 1e3, value, "matched", "matched", "", "", value - half, value + half
    )
    book = Book()
    statements(StudyResult(Campaign("beam", ()), (), statements=(one,)), book)
    assert tuple(str(cell) for cell in book.tables[0].rows[0][4:6]) == shown


def test_a_missed_verdict_is_told_in_words():
    """In the report's table and at the end of the command; numbers that were missed keep their numbers."""
    missed, met = (
        Statement("sticking frequency", "p. 3", "q", 62.2, 62.4, 62.3, verdict, "matched")
        for verdict in ("not testable here", "matched")
    )
    told = (*of_verdicts((missed, met)), Expectation("number of modes", 8.0, 0.0, 9.0, met=False))
    result = StudyResult(Campaign("beam", ()), (), statements=(missed, met), expectations=told)
    table = expectation_table(result, Book())
    assert table is not None
    assert [tuple(map(str, row[1:])) for row in table.rows] == [
        ("matched", "–", "not testable here", "missed"),
        ("8", "0", "9", "missed"),
        ("matched", "–", "matched", "met"),
    ]
    screen = Console(file=io.StringIO(), width=300)
    show_result(screen, result, Path("r.html"))
    lines = screen.file.getvalue().splitlines()
    sentence = "p. 3, sticking frequency: the verdict is 'not testable here', the recipe expects 'matched'"
    assert f"missed: {sentence}" in lines and table.rows[0][0] == sentence
    assert "missed: number of modes: found 9, expected 8 +- 0" in lines
    assert not told[0].met and told[1].met
