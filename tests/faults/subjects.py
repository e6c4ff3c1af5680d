"""Work that writes, and what must hold after it was disturbed: nothing finished lost, the next start goes on."""

import csv
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np

import acquisition
from ema import store
from ema.data import Channel, Recording, Run, RunResult
from tests.unit.recording_rig import DrawnImpacts, nothing, rig_folder, session

Report = Callable[[str], None]
"""What the work has announced as finished, one line each."""


class Subject(Protocol):
    """Work in a folder."""

    name: str

    def prepare(self, folder: Path) -> None:
        """What is there before the work."""

    def work(self, folder: Path, seed: int, report: Report) -> None:
        """The work; may be begun again."""

    def check(self, folder: Path, announced: list[str]) -> None:
        """After a disturbance: what was announced is there, whole."""

    def finished(self, folder: Path) -> None:
        """After the work was begun again and came to its end."""


def remains(folder: Path) -> list[str]:
    """Temporary files, and names without content."""
    return [
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.is_file()
        and path.name != ".record.lock"
        and (path.name.startswith(".") or path.suffix == ".tmp" or not path.stat().st_size)
    ]


@dataclass
class Saving:
    """``store.save`` over a former file."""

    name: str = "save"
    samples: int = 20_000

    def prepare(self, folder: Path) -> None:
        """The former file."""
        store.save(folder / "a.h5", self._record(-1))

    def work(self, folder: Path, seed: int, report: Report) -> None:
        """Save three times."""
        for number in range(3):
            store.save(folder / "a.h5", self._record(number))
            report(str(number))

    def check(self, folder: Path, announced: list[str]) -> None:
        """The file is the last one announced or the one that was being written."""
        last = int(announced[-1]) if announced else -1
        value = int(store.load(folder / "a.h5").signals[0, 0])
        assert value in (last, last + 1), f"{value} after {last} was announced"
        np.testing.assert_array_equal(store.load(folder / "a.h5").signals, self._record(value).signals)

    def finished(self, folder: Path) -> None:
        """One file."""
        assert [path.name for path in folder.iterdir()] == ["a.h5"]

    def _record(self, value: int) -> Recording:
        noise = np.random.default_rng(value + 1).standard_normal((2, self.samples))
        noise[0, 0] = value
        return Recording(noise, 1000.0, (Channel("a"), Channel("b")))


@dataclass
class Measuring:
    """``record``: two runs of two points, with a rejected take in between."""

    name: str = "record"
    takes: int = 2

    def prepare(self, folder: Path) -> None:
        """A rig and a first run."""
        rig_folder(folder, points=(1, 2), takes=self.takes)
        list(session(folder, "beam_1").takes(DrawnImpacts(99)))

    def work(self, folder: Path, seed: int, report: Report) -> None:
        """Measure until the run is complete; every second take is rejected."""
        count = iter(range(1000))
        one = session(folder, "beam", lambda record: nothing(record) if next(count) % 2 else ())
        for taken in one.takes(DrawnImpacts(seed)):
            report(f"{taken.path.relative_to(folder).as_posix()} {taken.peak!r}")

    def check(self, folder: Path, announced: list[str]) -> None:
        """Every take announced is in its file, those of the first run as well."""
        for line in announced:
            name, peak = line.split()
            assert float(store.load(folder / name).signals[0].max()) == float(peak), f"{name} holds another take"
        assert len(list((folder / "raw").glob("beam_1_*_*_*.h5"))) == 0
        assert len(list((folder / "raw").glob("beam_1_[12]_00?.h5"))) == 2 * self.takes

    def finished(self, folder: Path) -> None:
        """Both runs complete, each take once, the journal in line, nothing left behind."""
        one = session(folder, "beam")
        assert one.done == one.wanted and not one.notes, one.notes
        campaign = acquisition.open_campaign(folder)
        keys = []
        for run in campaign.runs:
            assert len(run.recordings) == 2 * self.takes, f"run {run.id} has {len(run.recordings)} takes"
            keys += [record.identity.key for record in run.recordings]
        assert len(set(keys)) == len(keys) and [run.id for run in campaign.runs] == ["beam_1", "beam"]
        with (folder / "takes.csv").open(encoding="utf-8", newline="") as file:
            listed = sorted(row["file"] for row in csv.DictReader(file) if row["accepted"] != "deleted")
        there = [*(folder / "raw").glob("*.h5"), *(folder / "rejected").glob("*.h5")]
        assert listed == sorted(path.relative_to(folder).as_posix() for path in there)
        assert remains(folder) == []


@dataclass
class Studying:
    """``run``: a study of two runs with result and report; modes are computed once and kept in this process."""

    name: str = "run"
    results: list[RunResult] = field(default_factory=list)
    report: bool = True

    def prepare(self, folder: Path) -> None:
        """The small study of the unit tests."""
        from ema.study import Study, chain
        from tests.unit import conftest

        master = conftest.small_study_master.__wrapped__(_Folders(folder / "made"))  # type: ignore[attr-defined]
        shutil.move(master / "campaign", folder / "campaign")
        shutil.move(master / "recipe.toml", folder / "recipe.toml")
        shutil.rmtree(folder / "made")
        recipe = (folder / "recipe.toml").read_text(encoding="utf-8")
        (folder / "recipe.toml").write_text(recipe.partition("[[expect]]")[0], encoding="utf-8")
        if not self.results:
            analyse = chain.analyse

            def once(run: Run, *rest: Any) -> RunResult:
                if not self.results:
                    self.results.append(analyse(run, *rest))
                return replace(self.results[0], run=run)

            chain.analyse = once
            study = Study.load(folder / "recipe.toml")
            study.run()
            shutil.rmtree(folder / "_build")

    def work(self, folder: Path, seed: int, report: Report) -> None:
        """Run it, taking what is finished."""
        from ema.study import Study

        if not self.report:
            from ema import report as reports

            reports.write = lambda result, path, formats=(): path
        Study.load(folder / "recipe.toml").run(progress=_Reporting(report), resume=True)
        report("finished")

    def check(self, folder: Path, announced: list[str]) -> None:
        """What is finished can be read; the result too, once it is there."""
        for path in folder.glob("_build/**/*.h5"):
            assert store.load(path) is not None
        if "finished" in announced:
            assert (folder / "_build" / "recipe.h5").is_file()

    def finished(self, folder: Path) -> None:
        """Result and report are there, and nothing else."""
        held = store.load(folder / "_build" / "recipe.h5")
        assert [one.run.id for one in held.runs] == ["first", "second"]
        if self.report:
            assert (folder / "_build" / "recipe.html").stat().st_size > 10_000
        assert remains(folder / "_build") == []


@dataclass
class _Reporting:
    report: Report

    def __call__(self, what: str, done: int, total: int) -> None:
        """Nothing to show."""

    def note(self, sentence: str) -> None:
        """Pass it on."""
        self.report(sentence)


@dataclass
class _Folders:
    """Stands for the folders of pytest."""

    folder: Path

    def mktemp(self, name: str) -> Path:
        """A folder."""
        (self.folder / name).mkdir(parents=True)
        return self.folder / name


SUBJECTS: dict[str, Callable[[], Any]] = {
    "save": Saving,
    "record": Measuring,
    "run": Studying,
    "run-without-report": partial(Studying, report=False),
}
