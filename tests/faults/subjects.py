"""Work that writes, and what must hold after it was disturbed: nothing finished lost, the next start goes on."""

import contextlib
import csv
import io
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

import acquisition
from ema import store
from ema.data import Channel, MapResult, Placement, Recording, Run, RunResult
from ema.errors import FailureError
from tests.unit.recording_rig import DrawnImpacts, nothing, rig_folder, session

Report = Callable[[str], None]
"""What the work announces, one line each: ``finished X``, ``computing X``, or words of the subject's own."""


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
    """``run``: a study of two runs with result and report; modes and what the report holds are computed once and kept in
    this process, and all of it is written each time."""

    name: str = "run"
    results: list[RunResult] = field(default_factory=list)

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

            def once(run: Run, *rest: Any, **more: Any) -> RunResult:
                if not self.results:
                    self.results.append(analyse(run, *rest, **more))
                return replace(self.results[0], run=run)

            chain.analyse = once
            _composed_once()
            study = Study.load(folder / "recipe.toml")
            study.run()
            shutil.rmtree(folder / "_build")

    def work(self, folder: Path, seed: int, report: Report) -> None:
        """Run it, taking what is finished."""
        from ema.study import Study, chain

        chain.analyse = _announced(chain.analyse, report, "computing", lambda run, *rest, **more: run.id)
        Study._keep = _announced(Study._keep, report, "finished", lambda study, run, *rest: run.id)  # type: ignore
        Study.load(folder / "recipe.toml").run(resume=True)
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
        assert (folder / "_build" / "recipe.html").stat().st_size > 10_000
        assert remains(folder / "_build") == []


@dataclass
class Mapping:
    """``map``: a map in a study, which is kept and taken up again, and the files of ``ema map``."""

    name: str = "map"

    def prepare(self, folder: Path) -> None:
        """Stepped sines at two levels and two normal forces; what has to be compiled or loaded is."""
        from tests.unit import test_map_campaign

        test_map_campaign.campaign(folder / "campaign")
        (folder / "recipe.toml").write_text('campaign = "campaign"\n[[map]]\nnear = 495\n', encoding="utf-8")
        _without_report()
        _blank_pictures()
        self.work(folder, 0, lambda line: None)
        shutil.rmtree(folder / "_build")
        shutil.rmtree(folder / "out")

    def work(self, folder: Path, seed: int, report: Report) -> None:
        """The study, and the command."""
        from ema.study import Study, mapping

        computed = mapping.mapped
        mapping.mapped = _announced(computed, report, "computing", lambda *rest: "map")
        saved, Study._map = Study._map, _announced(Study._map, report, "finished", lambda *rest: "map")  # type: ignore
        Study.load(folder / "recipe.toml").run(resume=True)
        mapping.mapped, Study._map = computed, saved  # type: ignore[method-assign]
        command("map", str(folder / "campaign"), "--near", "495", "--output", str(folder / "out"))
        report("finished")

    def check(self, folder: Path, announced: list[str]) -> None:
        """What is there can be read, and all of it is there when the command has ended."""
        for path in [*folder.glob("_build/**/*.h5"), *folder.glob("out/*.h5")]:
            assert store.load(path) is not None
        for path in folder.glob("out/*.csv"):
            assert len(path.read_text(encoding="utf-8").splitlines()) == 5
        for path in folder.glob("out/*.svg"):
            assert path.read_text(encoding="utf-8").rstrip().endswith("</svg>")
        for path in folder.glob("out/*.png"):
            assert b"IEND" in path.read_bytes()[-12:]
        if "finished" in announced:
            assert len(list((folder / "out").iterdir())) == 8

    def finished(self, folder: Path) -> None:
        """Eight files of the command, and nothing else."""
        assert isinstance(store.load(folder / "out" / "mode_near_495_Hz.h5"), MapResult)
        assert len(store.load(folder / "_build" / "recipe.h5").maps) == 1
        assert len(list((folder / "out").iterdir())) == 8 and remains(folder) == []


@dataclass
class Placing:
    """``place``: the search for the place of a beam on the work table, with pictures and report."""

    name: str = "place"

    def prepare(self, folder: Path) -> None:
        """Modes of the table and a recipe; places are computed once and their answers kept in this process."""
        from ema.place import shortlist
        from tests.unit.placement_rig import write_recipe

        write_recipe(folder)
        solved, known = shortlist.answer, dict[str, Any]()

        def once(question: shortlist.Question) -> Any:
            name = shortlist.fingerprint_of(question)
            if name not in known:
                known[name] = solved(question)
            return known[name]

        shortlist.answer = once
        _blank_pictures()
        self.work(folder, 0, lambda line: None)
        shutil.rmtree(folder / "out")

    def work(self, folder: Path, seed: int, report: Report) -> None:
        """The command."""
        from ema.place import shortlist

        solved, kept, keep = shortlist.answer, shortlist.KeptPlaces, shortlist.KeptPlaces.keep
        shortlist.answer = _announced(solved, report, "computing", shortlist.fingerprint_of)
        kept.keep = _announced(keep, report, "finished", lambda places, question, answer: question)  # type: ignore
        command("place", str(folder / "place.toml"), "--output", str(folder / "out"), "--resume")
        shortlist.answer, kept.keep = solved, keep  # type: ignore[method-assign]
        report("finished")

    def check(self, folder: Path, announced: list[str]) -> None:
        """Places announced are there, and what is there can be read."""
        for line in announced:
            what, _, place = line.partition(" ")
            assert what != "finished" or not place or list(folder.glob(f"out/checked/{place}-*.npy")), line
        for path in folder.glob("out/checked/*.npy"):
            np.load(path, allow_pickle=False)
        for path in folder.glob("out/*.h5"):
            assert isinstance(store.load(path), Placement)
        for path in folder.glob("out/*.html"):
            assert path.read_text(encoding="utf-8").rstrip().endswith("</html>")
        if "finished" in announced:
            assert (folder / "out" / "placement.html").is_file()

    def finished(self, folder: Path) -> None:
        """Places, store, pictures, report and tables, and nothing else."""
        places = store.load(folder / "out" / "placement.h5").ranking
        assert len(list((folder / "out" / "checked").glob("*.npy"))) == len(places.shortlist) >= 3
        assert (folder / "out" / "placement.html").stat().st_size > 10_000
        assert len(list((folder / "out").glob("*.svg"))) == len(list((folder / "out").glob("*.png"))) == 2
        assert (folder / "out" / "placement_tables" / "places.csv").is_file()
        assert remains(folder) == []


def command(*arguments: str) -> None:
    """A command of ``ema`` in this process.

    Raises
    ------
    FailureError : it ended with one sentence.
    KeyboardInterrupt : it was interrupted.
    AssertionError : it ended in any other way.
    """
    from ema.cli.app import app

    said, status = io.StringIO(), 0
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
        try:
            # an interruption before the command itself begins is returned as its status, not raised
            status = int(app(list(arguments), standalone_mode=False) or 0)
        except SystemExit as ended:
            status = int(ended.code or 0)
    lines = said.getvalue().splitlines()
    sentences = [line for line in lines if line.startswith("ema: ")]
    if status == 130:
        raise KeyboardInterrupt
    if status not in (0, 1):
        assert len(sentences) == 1 and lines[-1] == sentences[0] and "a fault in ema itself" not in lines[-1], lines
        raise FailureError(sentences[0])


def _announced(work: Callable[..., Any], report: Report, what: str, name: Callable[..., str]) -> Callable[..., Any]:
    """``work``, which announces what it is about to compute, or what is finished after it."""

    def announcing(*arguments: Any, **more: Any) -> Any:
        if what == "computing":
            report(f"{what} {name(*arguments)}")
        result = work(*arguments, **more)
        if what == "finished":
            report(f"{what} {name(*arguments)}")
        return result

    return announcing


def _blank_pictures() -> None:
    """Pictures are written as ever but show nothing: drawing takes most of the time, and no operation on the disk."""
    from matplotlib.figure import Figure

    draw = Figure.draw

    def blank(figure: Figure, renderer: Any) -> None:
        figure.clear()
        draw(figure, renderer)

    Figure.draw = blank  # type: ignore[method-assign]


def _composed_once() -> None:
    """The chapters of a report are composed once: that takes most of the time, and no operation on the disk."""
    from ema.report import writing

    compose, kept = writing.document_of, list[Any]()

    def once(result: Any, book: Any) -> Any:
        if not kept:
            kept.extend((compose(result, book), list(book.tables)))
        book.tables[:] = kept[1]
        return kept[0]

    writing.document_of = once


def _without_report() -> None:
    from ema import report as reports

    reports.write = lambda result, path, **more: path


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
    "map": Mapping,
    "place": Placing,
}
