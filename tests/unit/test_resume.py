"""A kept result is taken only where inputs, settings and code agree; what is computed again is named with the reason."""

import os
import shutil
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from ema import fingerprint
from ema.data import Campaign, Condition, Excitation, JointForce, MapResult, ModalMap, Run, RunResult
from ema.file_names import safe_name
from ema.study import Study, chain, mapping


@dataclass
class Listener:
    """A progress that takes sentences."""

    sentences: list[str] = field(default_factory=list)

    def __call__(self, what: str, done: int, total: int) -> None:
        """Nothing to show."""

    def note(self, sentence: str) -> None:
        """Keep it."""
        self.sentences.append(sentence)


def resumed(recipe: Path) -> list[str]:
    listener = Listener()
    Study.load(recipe).run(progress=listener, resume=True)
    return listener.sentences


@pytest.fixture
def quick(small_study_master: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is computed does not matter here, only whether: every run has the result of the first one."""
    analyse, results = chain.analyse, _RESULTS

    def once(run: Run, *rest: object, **more: object) -> RunResult:
        if not results:
            results.append(analyse(run, *rest, **more))
        return replace(results[0], run=run)

    monkeypatch.setattr(chain, "analyse", once)


_RESULTS: list[RunResult] = []


def test_other_code_makes_a_kept_run_anew_and_says_so(small_study, quick, without_report, monkeypatch):
    """The version string stays as it is while a program is worked on; its text does not."""
    assert all("not computed before" in told for told in resumed(small_study))
    assert resumed(small_study) == [f"run {name}: taken as it was computed" for name in ("first", "second")]
    monkeypatch.setattr(fingerprint, "of_code", lambda: "0" * 64)
    again = resumed(small_study)
    assert len(again) == 2 and all("computed again: the code of friction-ema has changed" in told for told in again)
    assert all("taken as it was" in told for told in resumed(small_study))


def test_what_has_changed_is_named(small_study, quick, without_report):
    resumed(small_study)
    data = small_study.parent / "campaign" / "data"
    shutil.copy(data / "second_1.h5", data / "first_1.h5")
    first, second = resumed(small_study)
    assert first.startswith("run first: computed again: ") and "run first, 5 data files" in first
    assert second == "run second: taken as it was computed"
    small_study.write_text(small_study.read_text().replace("[60, 450]\norders", "[70, 450]\norders"))
    first, second = resumed(small_study)
    assert "fit.band was (60.0, 450.0) and is (70.0, 450.0)" in first and "recipe.toml" in first
    kept = small_study.parent / "_build" / "recipe" / "first.h5"
    kept.write_bytes(kept.read_bytes()[:5000])
    first, second = resumed(small_study)
    assert "run first: computed again: the kept file cannot be read" in first and "taken" in second


def test_the_fingerprint_of_code_is_that_of_what_computes(tmp_path: Path):
    for name in ("ema/fit/a.py", "ema/cli/b.py", "acquisition/c.py"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("x = 1\n")
    before = fingerprint.of_sources(tmp_path)
    (tmp_path / "ema/cli/b.py").write_text("x = 2\n")
    assert fingerprint.of_sources(tmp_path) == before, "what is printed is no result"
    (tmp_path / "ema/fit/a.py").write_text("x = 2\n")
    changed = fingerprint.of_sources(tmp_path)
    (tmp_path / "ema/fit/a.py").rename(tmp_path / "ema/fit/d.py")
    assert len({before, changed, fingerprint.of_sources(tmp_path)}) == 3


def test_runs_whose_names_differ_in_odd_characters_are_kept_apart(small_study, quick, without_report, monkeypatch):
    """``a b`` and ``a_b`` had one file: each was computed again whenever the other had been."""
    campaign = small_study.parent / "campaign" / "campaign.toml"
    text = campaign.read_text().replace('id = "first"', 'id = "a b"').replace('id = "second"', 'id = "A_b"')
    campaign.write_text(text.replace('id = "A_b"', 'id = "a_b"'))
    small_study.write_text(small_study.read_text().replace('run = "first"', 'run = "a b"'))
    resumed(small_study)
    analysed = []
    monkeypatch.setattr(chain, "analyse", lambda run, *rest: analysed.append(run.id))
    assert all("taken as it was" in told for told in resumed(small_study)) and analysed == []


def test_names_of_files_are_safe_and_one_to_one_on_every_disk():
    texts = [
        *["a b", "a_b", "a-b", "A_B", "a_B", "CON", "con", "nul.txt", "é", "é", "ends.", "..", "", "a/b", "lpt1"],
        "x" * 200,
        "x" * 201,
    ]
    names = [safe_name(text) for text in texts]
    assert len({name.casefold() for name in names}) == len(set(texts))
    for name in names:
        assert name.isascii() and set(name) <= set("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_.-")
        assert name.split(".")[0].lower() not in ("con", "nul", "lpt1") and not name.endswith(".") and len(name) <= 100
        assert not name.startswith(".")
    assert safe_name("first") == "first"


def test_a_map_is_made_anew_when_the_run_without_the_beam_has_changed(tmp_path, monkeypatch, without_report):
    """The reference of a map is an input like the runs of the map themselves."""
    from ema.study.recipe import MapTable

    listener, study = Listener(), Study.load(_recipe(tmp_path))
    joint = JointForce("J1", 1000.0)
    stepped = Excitation("stepped sine")
    campaign = Campaign("c", (Run("map run", Condition(stepped, (joint,))), Run("bare", Condition(stepped))))
    monkeypatch.setattr(mapping, "chosen", lambda campaign, table: campaign.runs[:1])
    monkeypatch.setattr(mapping, "mapped", lambda *rest: _map())
    table = MapTable(near=100.0, name="m")
    study.kept.mkdir(parents=True)
    for bare in ("1", "1", "2"):
        data = {"map run": (("map run, 1 data file", "a"),), "bare": (("bare, 1 data file", bare),)}
        study._map(campaign, table, data, listener, True)
    assert [told.partition(": ")[2].split(":")[0] for told in listener.sentences] == [
        "not computed before",
        "taken as it was computed",
        "computed again",
    ]
    assert "bare, 1 data file" in listener.sentences[-1]


def _recipe(folder: Path) -> Path:
    path = folder / "recipe.toml"
    path.write_text('campaign = "campaign"\n', encoding="utf-8")
    (folder / "campaign").mkdir()
    return path


def _map() -> MapResult:
    values = np.full((1, 1), 100.0)
    chart = ModalMap(np.array([1.0]), np.array([1.0]), values, values / 1e4, method="measured")
    return MapResult("m", chart, np.zeros((0, 3)), np.zeros(0), np.zeros(0), values, ("map run",), ())


def test_side_data_in_the_folder_of_the_data_are_inputs(small_study, without_report):
    folder = small_study.parent / "campaign"
    text = (folder / "campaign.toml").read_text()
    text += '\n[[runs.normal_force]]\njoint = "J1"\nfile = "force.csv"\ncolumn = "J1"\nunit = "N"\n'
    (folder / "campaign.toml").write_text(text + '\n[[joints]]\nname = "J1"\n')
    side = folder / "data" / "force.csv"
    side.write_text("time,J1\n0,1000\n1,1001\n")
    campaign = Study.load(small_study).open()
    before = dict(campaign.inputs)
    side.write_text("time,J1\n0,1500\n1,1501\n")
    after = dict(Study.load(small_study).open().inputs)
    assert before.keys() == after.keys() and before["force.csv"] != after["force.csv"]


def test_a_kept_place_of_other_code_is_computed_again(tmp_path: Path, monkeypatch):
    from ema.place import shortlist

    listener = Listener()
    kept = shortlist.KeptPlaces(tmp_path)
    answer = np.ones((1, 4, 2, 2))
    kept.keep("a" * 24, answer)
    kept.keep("b" * 24, answer)
    (tmp_path / kept.name("b" * 24)).write_bytes(b"half")
    assert kept.known("a" * 24) is not None and kept.known("b" * 24) is None and kept.known("c" * 24) is None
    kept.report(listener)
    monkeypatch.setattr(fingerprint, "of_code", lambda: "0" * 64)
    other = shortlist.KeptPlaces(tmp_path)
    assert other.known("a" * 24) is None
    other.report(listener)
    other.keep("a" * 24, 2 * answer)
    assert other.known("a" * 24).max() == 2 and len(os.listdir(tmp_path)) == 2
    assert listener.sentences == [
        "places: 1 taken as computed; 1 computed again: the kept file cannot be read; 1 not computed before",
        "places: 1 computed again: the code or the packages under it have changed",
    ]
