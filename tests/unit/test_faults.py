"""Stopped at any operation or moment, and on a full disk: nothing finished is lost, and the next start goes on.

A sample with fixed seeds; ``python -m tests.faults`` does all of it with fresh ones.
"""

import os
import random
import signal
from dataclasses import dataclass
from pathlib import Path

import pytest
from matplotlib.figure import Figure

pytest.importorskip("fcntl", reason="processes are forked")

from ema import report
from ema.datasets import builtin
from ema.place import shortlist
from ema.report import writing
from ema.store import atomic
from ema.study import chain
from ema.study.study import make_folder
from tests.faults import campaign
from tests.faults.operations import HOWS
from tests.faults.subjects import Mapping, Measuring, Placing, Saving, Studying

SAMPLE = {"save": 4, "record": 3}
"""Disturbances of each kind that the suite has time for."""


@pytest.mark.parametrize("how", HOWS)
@pytest.mark.parametrize("subject", [Saving(samples=2000), Measuring(takes=1)], ids=lambda one: one.name)
def test_at_any_operation(subject, how: str):
    operations = campaign.operations_of(subject)
    assert {one.split()[0] for one in operations} >= {"create", "write"}
    numbers = [n for n in campaign.representatives(operations) if how != "half" or operations[n].startswith("write")]
    for number in random.Random(f"{subject.name} {how}").sample(numbers, SAMPLE[subject.name]):
        assert campaign.at_operation(subject, number, how).wrong == "", operations[number]


@pytest.mark.parametrize("name", campaign.SIGNALS)
@pytest.mark.parametrize("subject", [Saving(samples=2000), Measuring(takes=1)], ids=lambda one: one.name)
def test_at_any_moment(subject, name: str):
    drawn, whole = random.Random(f"{subject.name} {name}"), campaign.duration(subject)
    for seed in range(2):
        assert campaign.at_moment(subject, drawn.uniform(0, whole), name, seed).wrong == ""


@pytest.mark.slow
@pytest.mark.parametrize("subject", [Studying(), Mapping(), Placing()], ids=lambda one: one.name)
def test_a_study_a_map_and_a_placement_at_some_operations(subject, monkeypatch):
    for module, name in (
        (chain, "analyse"),
        (report, "write"),
        (writing, "document_of"),
        (Figure, "draw"),
        (shortlist, "answer"),
    ):
        # The subjects replace them in their own process, which is that of all other tests.
        monkeypatch.setattr(module, name, getattr(module, name))
    operations = campaign.operations_of(subject)
    renames = [n for n, one in enumerate(operations) if one.startswith("rename")]
    for number, how in zip((renames[0], renames[1], renames[-1]), ("before", "after", "full"), strict=True):
        assert campaign.at_operation(subject, number, how).wrong == ""


@dataclass
class Careless(Saving):
    """Writes over the former file in place."""

    name: str = "careless"

    def work(self, folder: Path, seed: int, report) -> None:
        from ema import store

        for number in range(3):
            store.save(folder / "b.h5", self._record(number))
            content = (folder / "b.h5").read_bytes()
            os.unlink(folder / "b.h5")
            with open(folder / "a.h5", "wb") as file:
                file.write(content)
            report(str(number))


def test_the_campaign_finds_out_who_writes_carelessly():
    subject = Careless(samples=2000)
    operations = campaign.operations_of(subject)
    number = operations.index("write a.h5")
    assert "InputError" in campaign.at_operation(subject, number, "before").wrong
    assert "InputError" in campaign.at_operation(subject, number, "half").wrong


def test_a_generator_of_a_built_in_campaign_that_was_killed_leaves_nothing_behind(tmp_path, monkeypatch):
    """The folder with what it had written of hundreds of megabytes stayed for ever."""

    def generate(target: Path, progress) -> None:
        (target / "a.h5").write_bytes(bytes(100_000))
        if not (tmp_path / "again").exists():
            os.kill(os.getpid(), signal.SIGKILL)
        (target / builtin.TRUTH).write_text(f"version = {builtin.VERSION}\n")

    monkeypatch.setitem(builtin.GENERATORS, "small", generate)
    (tmp_path / "campaign").mkdir()
    other = tmp_path / "campaign" / f".raw-{atomic.mark()}-alive"
    other.mkdir()
    child = os.fork()
    if not child:
        builtin.ensure(tmp_path / "campaign", "small")
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
    assert len(list((tmp_path / "campaign").iterdir())) == 2
    (tmp_path / "again").touch()
    assert builtin.ensure(tmp_path / "campaign", "small")
    assert {path.name for path in (tmp_path / "campaign").iterdir()} == {"raw", other.name}
    assert not builtin.ensure(tmp_path / "campaign", "small")


def test_what_a_killed_process_left_goes_with_the_next_start(tmp_path: Path):
    (tmp_path / "runs").mkdir()
    machine, ours = atomic.mark().split("-")
    child = os.fork()
    if not child:
        os._exit(0)
    os.waitpid(child, 0)
    stranger = "ffffff" if machine != "ffffff" else "000000"
    gone = [tmp_path / f".a.h5.{machine}-{child}-0a1b.tmp", tmp_path / "runs" / f".b.h5.{machine}-{child}-0a1b.tmp"]
    kept = [
        tmp_path / "a.h5",
        tmp_path / f".a.h5.{machine}-{ours}-0a1b.tmp",  # of a process that lives
        tmp_path / f".a.h5.{stranger}-{child}-0a1b.tmp",  # of another computer
        tmp_path / "notes.tmp",
    ]
    for path in (*gone, *kept):
        path.write_text("x")
    make_folder(tmp_path)
    assert sorted(path for path in tmp_path.rglob("*") if path.is_file()) == sorted(kept)
