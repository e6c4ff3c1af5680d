"""What a container shows of itself: short, escaped, and nothing of the numbers in its arrays."""

import html.parser
from dataclasses import fields, replace

import numpy as np
import pytest

from ema.data import Finding, Recording
from tests.containers import one_of_each

EACH = one_of_each()


class Parsed(html.parser.HTMLParser):
    """Tags in their order and the text between them."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.words = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: object) -> None:
        self.tags.append(tag)

    def handle_data(self, data: str) -> None:
        self.words += data


@pytest.mark.parametrize("name", sorted(EACH))
def test_every_container_is_shown_in_one_short_line_and_a_folding_table(name: str) -> None:
    shown = repr(EACH[name])
    assert name in shown or name == "Dof"
    assert len(shown) < 1000 and "\n" not in shown
    if name == "Dof":
        return
    page = Parsed(EACH[name]._repr_html_())
    assert page.tags[:3] == ["details", "summary", "b"] and "table" in page.tags
    assert set(page.tags) <= {"details", "summary", "b", "table", "tr", "td"}
    public = [field.name for field in fields(EACH[name]) if not field.name.startswith("_")]
    assert page.tags.count("tr") >= len(public) - 2  # a choice at its default is not listed
    assert len(page.words) < 4000


def test_texts_are_escaped() -> None:
    finding = Finding("warning", "x", "run <script>alert(1)</script>", "a & b")
    page = finding._repr_html_()
    assert "<script" not in page and "&lt;script&gt;" in page and "a &amp; b" in page
    assert "script" not in Parsed(page).tags


def test_large_contents_stay_short() -> None:
    record = EACH["Recording"]
    long = replace(record, signals=np.zeros((2, 10**6)), name="x" * 10**5)
    result = replace(EACH["StudyResult"], title="y" * 10**5, runs=EACH["StudyResult"].runs * 200)
    for thing in (long, result, replace(EACH["ModalModel"], name="z" * 10**5)):
        assert len(repr(thing)) < 1000 and len(thing._repr_html_()) < 20_000


def test_what_matters_of_a_record_is_shown() -> None:
    record = EACH["Recording"]
    assert isinstance(record, Recording)
    shown = repr(replace(record, sampling_rate=1024.0, name="take 1"))
    assert shown.startswith("Recording('take 1', 2 channels x 6 samples, 1024 Hz, 0.005859 s, channels ")
