"""Cells of CSV files: no formula, and nothing else changed."""

import csv
from io import StringIO

import pytest

from ema.cells import as_text
from ema.report.blocks import Table
from ema.report.files import as_csv


@pytest.mark.parametrize(
    "text",
    [
        "=cmd|' /C calc'!A0",
        "+1+cmd",
        "-2+3",
        "@SUM(A1)",
        "\t=1",
        "\r=1",
        "=1e999",
        "+Z()",
        "-1=2",
        "\uff1d1+1",
        "\uff20SUM(A1)",
    ],
)
def test_what_a_spreadsheet_would_run_is_text(text: str) -> None:
    assert as_text(text) == "'" + text


@pytest.mark.parametrize("text", ["", "beam_1kN", "12:+Z", "+Z", "-RX", "-", "-1.5e-3", "+2", ".5", "1=2", "a=b"])
def test_everything_else_stays(text: str) -> None:
    assert as_text(text) == text


def test_tables_of_a_report() -> None:
    rows = (("=HYPERLINK(1)", "+Z"), ("beam", "-7.5"))
    table = Table(number=1, name="t", caption="caption", columns=("name", "=x"), rows=rows, shown=2)
    found = list(csv.reader(StringIO(as_csv(table.columns, table.rows))))
    assert found == [["name", "'=x"], ["'=HYPERLINK(1)", "+Z"], ["beam", "-7.5"]]
