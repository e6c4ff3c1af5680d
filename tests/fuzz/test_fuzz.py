"""Kept inputs and a few mutated files of fixed seeds for every reader; ``python -m tests.fuzz`` takes fresh ones."""

import os
import random
import signal
import time
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import pytest

pytest.importorskip("resource", reason="processes are forked and limited")

from tests.fuzz import batch, containers
from tests.fuzz.__main__ import FIXED
from tests.fuzz.cases import Case, Reading
from tests.fuzz.kept import EXPECTED, KEPT, replay
from tests.fuzz.subjects import SUBJECTS
from tests.fuzz.uff import Uff


def test_inputs_that_failed_once_do_so_no_more():
    assert {path.name for path in KEPT.iterdir()} == set(EXPECTED)
    assert [f"{name}: {why}" for name, why in replay() if why] == []


@pytest.mark.parametrize("name", SUBJECTS)
def test_mutated_files_of_every_reader(name: str):
    made = batch.run(SUBJECTS[name](), FIXED, range(40))
    assert made.wrong == []
    assert sum(made.outcomes.values()) == 40


@dataclass
class Careless(Uff):
    """Reads what it can and says nothing; crashes or hangs at will."""

    how: str = ""

    def read(self, path: Path) -> Reading:
        if self.how == "crash":
            os.kill(os.getpid(), signal.SIGKILL)
        while self.how == "hang":
            pass
        if self.how == "error":
            raise KeyError("a")
        there = super().read(path)
        return Reading(there.signals)


def test_the_campaign_notices_who_loses_functions_in_silence():
    made = batch.run(Careless(), 1, range(300))
    assert made.outcomes["wrong"] > 50
    assert any("is missing" in why for _, _, why in made.wrong)


@pytest.mark.parametrize(
    ("how", "words"), [("crash", "crash, status -9"), ("error", "KeyError 'a'"), ("hang", "hangs")]
)
def test_the_campaign_notices_crashes_and_hangs_and_goes_on(how: str, words: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(batch, "SECONDS", 0.2)
    start = time.monotonic()
    made = batch.run(Careless(how=how), 1, range(2))
    assert [words in why for _, _, why in made.wrong] == [True, True]
    assert time.monotonic() - start < 30


def test_a_case_is_the_same_whenever_it_is_drawn():
    for make in SUBJECTS.values():
        containers._sample.cache_clear()
        one = batch.case_of(make(), 5, number=3)
        containers._sample.cache_clear()
        later = time.time() + 1e6
        with mock.patch("time.time", return_value=later), mock.patch("time.asctime", return_value=time.ctime(later)):
            other = batch.case_of(make(), 5, number=3)
        assert (one.data, one.kind, one.what) == (other.data, other.kind, other.what)


def test_every_kind_of_case_is_drawn():
    kinds = {type_.kind for number in range(60) if isinstance(type_ := Uff().case(random.Random(number)), Case)}
    assert kinds == {"edit", "damage", "noise"}
