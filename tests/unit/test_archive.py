"""The archive: every campaign once, its modes as they were kept, and what has become of the campaigns since."""

import errno
import gzip
import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pytest
from filelock import FileLock, Timeout

from ema import archive, store
from ema.archive import Observation, Query, cache, parts
from ema.archive.adding import recorded, sources_of
from ema.archive.record import record_of
from ema.data import FrfSet, MapResult, ModalMap, Provenance, StudyResult
from ema.errors import InputError
from ema.examples import campaign as example_campaign
from tests.bench import archive_campaigns as generated

SEED = 660917
CAMPAIGNS, RUNS = 6, 8


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("EMA_CACHE", str(tmp_path / "cache"))


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("campaigns")
    for number in range(CAMPAIGNS):
        generated.write(root / f"c{number}", number, RUNS, SEED)
    return root


@pytest.fixture
def campaigns(written: Path, tmp_path: Path) -> Path:
    shutil.copytree(written, tmp_path / "campaigns")
    return tmp_path / "campaigns"


def added(folder: Path, *campaigns: Path) -> archive.Added:
    return archive.add(folder, [generated.source_of(one) for one in campaigns])


def all_of(root: Path) -> list[Path]:
    return sorted(root.iterdir())


def codes(answer: archive.Answer) -> list[str]:
    return [finding.code for finding in answer.findings]


def expected(query: Query) -> list[tuple[str, str, int]]:
    """What the truth of the generator says, without a data base."""
    found = []
    for campaign in range(CAMPAIGNS):
        for run in range(RUNS):
            truth = generated.truth(campaign, run, SEED)
            for mode, frequency in enumerate(truth.frequencies):
                inside = query.frequency is None or query.frequency[0] <= frequency <= query.frequency[1]
                force, limits = truth.normal_force, query.normal_force
                inside &= limits is None or (force is not None and limits[0] <= force <= limits[1])
                inside &= query.since is None or truth.date >= query.since.isoformat()
                inside &= not query.bare or force is None
                if inside:
                    found.append((truth.campaign, truth.run, mode + 1))
    return sorted(found)


def keys(rows: tuple[Observation, ...]) -> list[tuple[str, str, int]]:
    return sorted((row.campaign, row.run, row.mode) for row in rows)


@pytest.mark.parametrize(
    "query",
    [
        Query(),
        Query(frequency=(490.0, 510.0), normal_force=(100.0, 300.0)),
        Query(frequency=(490.0, 510.0), since=date(2020, 1, 1)),
        Query(bare=True, frequency=(0.0, 200.0)),
    ],
)
def test_the_answer_is_what_the_truth_says(campaigns: Path, tmp_path: Path, query: Query) -> None:
    told = added(tmp_path / "archive", *all_of(campaigns))
    assert (told.new, told.runs, told.findings) == (CAMPAIGNS, CAMPAIGNS * RUNS, ())
    answer = archive.find(tmp_path / "archive", query)
    assert keys(answer.observations) == expected(query) and len(answer.observations) > 0
    assert (answer.campaigns, answer.runs, answer.findings) == (CAMPAIGNS, CAMPAIGNS * RUNS, ())


def test_values_intervals_and_conditions_are_those_that_were_kept(campaigns: Path, tmp_path: Path) -> None:
    added(tmp_path / "archive", campaigns / "c2")
    rows = archive.find(tmp_path / "archive", Query(run="run_003")).observations
    truth = generated.truth(2, 3, SEED)
    half = 1.959964 * generated.STD
    np.testing.assert_allclose([row.frequency for row in rows], truth.frequencies, rtol=1e-12)
    np.testing.assert_allclose([row.damping for row in rows], truth.damping, rtol=1e-9)
    np.testing.assert_allclose([row.frequency_high - row.frequency_low for row in rows], 2 * half[0], rtol=1e-9)
    np.testing.assert_allclose([row.damping_high - row.damping_low for row in rows], 2 * half[1], rtol=1e-9)
    assert {(row.date, row.structure, row.normal_force, row.force_level, row.kind) for row in rows} == {
        (truth.date, truth.structure, truth.normal_force, 100.0, "hammer")
    }
    assert rows[0].folder == (campaigns / "c2").as_posix()


def listing(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in (folder / parts.FOLDER).iterdir()}


def test_adding_twice_changes_nothing(campaigns: Path, tmp_path: Path) -> None:
    folder = tmp_path / "archive"
    added(folder, *all_of(campaigns))
    before, answer = listing(folder), archive.find(folder)
    again = added(folder, *all_of(campaigns), *all_of(campaigns))
    assert (again.new, again.changed, again.unchanged) == (0, 0, 2 * CAMPAIGNS)
    assert listing(folder) == before and archive.find(folder) == answer


def test_a_changed_campaign_is_named_until_it_is_added_again(campaigns: Path, tmp_path: Path) -> None:
    folder, changed = tmp_path / "archive", campaigns / "c1"
    added(folder, *all_of(campaigns))
    source = generated.source_of(changed)
    store.save(source.kept / "run_002.h5", generated.result_of(99, 2, SEED, generated.of_files([source.file])))
    answer = archive.find(folder)
    assert codes(answer) == ["campaign-changed"] and "c1" in str(answer.findings[0])
    assert added(folder, *all_of(campaigns)).changed == 1
    answer = archive.find(folder, Query(campaign="campaign 00001", run="run_002"))
    assert codes(answer) == [] and len(answer.observations) == 6
    assert answer.observations[0].frequency == pytest.approx(generated.truth(99, 2, SEED).frequencies[0])
    assert len(archive.find(folder).observations) == CAMPAIGNS * RUNS * 6


def test_a_campaign_file_changed_after_the_analysis_is_named(campaigns: Path, tmp_path: Path) -> None:
    path = campaigns / "c0" / "campaign.toml"
    path.write_text(path.read_text() + "\n# a note\n")
    told = added(tmp_path / "archive", campaigns / "c0")
    assert [finding.code for finding in told.findings] == ["analysed-before"]
    assert {row.state for row in archive.find(tmp_path / "archive").observations} == {"older"}


def test_a_moved_campaign_is_named_and_is_one_where_it_is_now(campaigns: Path, tmp_path: Path) -> None:
    folder = tmp_path / "archive"
    added(folder, *all_of(campaigns))
    (tmp_path / "elsewhere").mkdir()
    shutil.move(campaigns / "c3", tmp_path / "elsewhere" / "c3")
    answer = archive.find(folder)
    assert codes(answer) == ["campaign-gone"] and "c3" in str(answer.findings[0])
    assert len(answer.observations) == CAMPAIGNS * RUNS * 6
    told = added(folder, tmp_path / "elsewhere" / "c3")
    assert (told.moved, told.new) == (1, 0)
    answer = archive.find(folder)
    assert answer.findings == () and len(answer.observations) == CAMPAIGNS * RUNS * 6
    assert str(tmp_path / "elsewhere" / "c3") in {row.folder for row in answer.observations}


def test_a_campaign_moved_and_changed_at_once_is_one(campaigns: Path, tmp_path: Path) -> None:
    folder = tmp_path / "archive"
    added(folder, *all_of(campaigns))
    shutil.move(campaigns / "c3", tmp_path / "c3")
    (generated.source_of(tmp_path / "c3").kept / "run_007.h5").unlink()
    assert added(folder, tmp_path / "c3").moved == 1
    answer = archive.find(folder)
    assert codes(answer) == ["not-analysed"] and len(answer.observations) == (CAMPAIGNS * RUNS - 1) * 6


def test_a_vanished_campaign_stays_in_the_index_and_is_named(campaigns: Path, tmp_path: Path) -> None:
    folder = tmp_path / "archive"
    added(folder, *all_of(campaigns))
    shutil.rmtree(campaigns / "c5")
    answer = archive.find(folder)
    assert codes(answer) == ["campaign-gone"] and len(answer.observations) == CAMPAIGNS * RUNS * 6
    again = archive.add(folder, sources_of(folder))
    assert [finding.code for finding in again.findings] == ["not-indexed"] and again.unchanged == CAMPAIGNS - 1
    assert len(archive.find(folder).observations) == CAMPAIGNS * RUNS * 6


def test_a_copy_counts_once_even_where_it_was_changed(campaigns: Path, tmp_path: Path) -> None:
    folder = tmp_path / "archive"
    added(folder, *all_of(campaigns))
    copy = tmp_path / "copy" / "c4"
    shutil.copytree(campaigns / "c4", copy)
    assert added(folder, copy).unchanged == 1
    file = copy / "campaign.toml"
    file.write_text(file.read_text().replace('name = "', 'name = "copy of '))
    assert added(folder, copy).new == 1
    answer = archive.find(folder)
    assert len(answer.observations) == CAMPAIGNS * RUNS * 6 and answer.runs == CAMPAIGNS * RUNS


def test_two_archives_merged_are_one(campaigns: Path, tmp_path: Path) -> None:
    one, two, both = tmp_path / "one", tmp_path / "two", tmp_path / "both"
    places = all_of(campaigns)
    added(one, *places[:4])
    added(two, *places[2:])
    added(both, *places)
    told = archive.add(one, (), archives=[two])
    assert told.merged == 2
    assert archive.find(one).observations == archive.find(both).observations and archive.find(one).findings == ()
    assert archive.add(one, (), archives=[two]).merged == 0


def test_two_states_of_a_campaign_after_a_merge_are_named_and_the_newer_counts(campaigns: Path, tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    added(one, campaigns / "c0")
    kept = generated.source_of(campaigns / "c0").kept
    (kept / "run_000.h5").unlink()
    os.utime(kept, ns=(time.time_ns() + 10**9, time.time_ns() + 10**9))
    added(two, campaigns / "c0")
    for first, second in ((one, two), (two, one)):
        merged = tmp_path / f"merged_{first.name}"
        archive.add(merged, (), archives=[first, second])
        answer = archive.find(merged)
        assert sorted(codes(answer)) == ["not-analysed", "two-states"]
        assert len(answer.observations) == (RUNS - 1) * 6
        added(merged, campaigns / "c0")
        assert codes(archive.find(merged)) == ["not-analysed"]


def test_a_new_archive_of_the_same_campaigns_says_the_same(campaigns: Path, tmp_path: Path) -> None:
    folder = tmp_path / "archive"
    added(folder, *all_of(campaigns))
    before = archive.find(folder)
    sources = sources_of(folder)
    shutil.rmtree(folder)
    assert archive.add(folder, sources).new == CAMPAIGNS
    assert archive.find(folder) == before


def test_a_damaged_part_is_named_and_made_anew(campaigns: Path, tmp_path: Path) -> None:
    folder = tmp_path / "archive"
    added(folder, *all_of(campaigns))
    damaged = sorted((folder / parts.FOLDER).iterdir())[2]
    damaged.write_bytes(damaged.read_bytes()[:-40])
    answer = archive.find(folder)
    assert codes(answer) == [] and len(answer.observations) == CAMPAIGNS * RUNS * 6  # this machine has read it before
    shutil.rmtree(tmp_path / "cache")
    answer = archive.find(folder)
    assert codes(answer) == ["part-unreadable"] and len(answer.observations) == (CAMPAIGNS - 1) * RUNS * 6
    damaged.unlink()
    assert added(folder, *all_of(campaigns)).new == 1
    assert len(archive.find(folder).observations) == CAMPAIGNS * RUNS * 6


def rewritten(folder: Path, change) -> None:
    """Parts as another version writes them."""
    for path in list((folder / parts.FOLDER).iterdir()):
        whole = json.loads(gzip.decompress(path.read_bytes()))
        path.unlink()
        text = parts.canonical(change(whole))
        (path.parent / f"{hashlib.sha256(text).hexdigest()}{parts.SUFFIX}").write_bytes(gzip.compress(text))


def test_parts_of_a_newer_version_are_named(campaigns: Path, tmp_path: Path) -> None:
    added(tmp_path / "archive", campaigns / "c0")
    rewritten(tmp_path / "archive", lambda whole: whole | {"schema": parts.SCHEMA_VERSION + 1})
    answer = archive.find(tmp_path / "archive")
    assert codes(answer) == ["part-unreadable"] and "newer friction-ema" in str(answer.findings[0])


def test_parts_of_an_earlier_version_are_migrated(campaigns: Path, tmp_path: Path, monkeypatch) -> None:
    folder = tmp_path / "archive"
    added(folder, campaigns / "c0")
    before = archive.find(folder)

    def former(whole: dict) -> dict:
        record = whole["campaign"]
        return whole | {"campaign": {**record, "specimen": record["structure"], "structure": None}}

    rewritten(folder, former)
    monkeypatch.setattr(parts, "SCHEMA_VERSION", 2)
    monkeypatch.setattr(
        parts,
        "MIGRATIONS",
        {1: lambda whole: whole | {"campaign": {**whole["campaign"], "structure": whole["campaign"]["specimen"]}}},
    )
    assert archive.find(folder) == before


def test_the_golden_part_of_version_1_is_read_forever() -> None:
    golden = Path(__file__).parent / "golden" / "archive_1"
    answer = archive.find(golden)
    rows = [(row.run, row.mode, round(row.frequency, 3), row.normal_force) for row in answer.observations]
    truth = [generated.truth(0, run, 1) for run in (0, 1)]
    assert [row[2] for row in rows] == [round(f, 3) for one in truth for f in one.frequencies]
    assert rows[-1][3] == 50.0 and codes(answer) == ["campaign-gone", "not-analysed"]


@pytest.mark.parametrize("harm", ["deleted", "no data base", "empty", "cut", "a folder"])
def test_a_cache_that_is_gone_or_damaged_is_made_anew(campaigns: Path, tmp_path: Path, harm: str) -> None:
    folder = tmp_path / "archive"
    added(folder, *all_of(campaigns))
    before, path = archive.find(folder), cache.path_of(folder)
    whole = path.read_bytes()
    path.unlink()
    if harm == "a folder":
        path.mkdir()
    elif harm != "deleted":
        path.write_bytes({"no data base": b"x" * 5000, "empty": b"", "cut": whole[: len(whole) // 2]}[harm])
    assert archive.find(folder) == before and archive.find(folder) == before


def test_without_a_cache_folder_the_answer_is_the_same(campaigns: Path, tmp_path: Path, monkeypatch) -> None:
    added(tmp_path / "archive", *all_of(campaigns))
    before = archive.find(tmp_path / "archive")
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("EMA_CACHE", str(tmp_path / "file" / "cache"))
    assert archive.find(tmp_path / "archive") == before


@pytest.mark.skipif(sys.platform == "win32", reason="flock is of POSIX")
@pytest.mark.filterwarnings("ignore:flock not supported")
def test_on_a_disk_without_locks_the_answer_is_the_same(campaigns: Path, tmp_path: Path, monkeypatch) -> None:
    """``flock`` answers ENOSYS on some disks of the network; filelock then refuses, or counts the file as the lock."""
    added(tmp_path / "archive", *all_of(campaigns))
    before = archive.find(tmp_path / "archive")

    def refused(*_: object) -> None:
        raise OSError(errno.ENOSYS, "Function not implemented")

    with monkeypatch.context() as without:
        Path(f"{cache.path_of(tmp_path / 'archive')}.lock").unlink()  # which no lock has left on such a disk
        without.setattr("fcntl.flock", refused)
        assert archive.find(tmp_path / "archive") == before
    monkeypatch.setattr("filelock.FileLock.acquire", _not_implemented)  # as older versions of filelock do
    assert archive.find(tmp_path / "archive") == before


def _not_implemented(*_: object, **__: object) -> None:
    raise NotImplementedError("FileSystem does not appear to support flock; use SoftFileLock instead")


def test_runs_without_results_have_no_modes_and_are_named(tmp_path: Path) -> None:
    generated.write(tmp_path / "c", 3, RUNS, SEED, analysed=2)
    (tmp_path / "c" / "raw").mkdir()
    told = added(tmp_path / "archive", tmp_path / "c")
    assert [finding.code for finding in told.findings] == ["not-analysed"] and "6 of 8 runs" in told.findings[0].message
    answer = archive.find(tmp_path / "archive")
    assert {row.run for row in answer.observations} == {"run_000", "run_001"} and answer.runs == RUNS
    # of the others those that could belong to the answer are named: 100, 200 and 300 N
    answer = archive.find(tmp_path / "archive", Query(normal_force=(100.0, 300.0)))
    assert answer.observations == () and "3 runs of 1 campaign" in answer.findings[0].message


def test_a_kept_result_that_cannot_be_read_is_named(campaigns: Path, tmp_path: Path) -> None:
    kept = generated.source_of(campaigns / "c0").kept / "run_001.h5"
    kept.write_bytes(kept.read_bytes()[:3000])
    added(tmp_path / "archive", campaigns / "c0")
    answer = archive.find(tmp_path / "archive")
    assert "run_001" not in {row.run for row in answer.observations}
    assert codes(answer) == ["not-analysed"] and len(answer.observations) == (RUNS - 1) * 6


def test_a_result_of_a_study_that_cannot_be_read_is_named(campaigns: Path) -> None:
    source = generated.source_of(campaigns / "c0")
    before = record_of(source)["findings"]
    source.result.parent.mkdir(parents=True, exist_ok=True)
    store.save(source.result, StudyResult(example_campaign(), ()))
    assert record_of(source)["findings"] == before
    source.result.write_bytes(source.result.read_bytes()[:3000])
    (finding,) = (one for one in record_of(source)["findings"] if one not in before)
    assert finding[1:3] == ["kept-unreadable", source.result.name] and "was not indexed" in finding[3]


def test_names_and_patterns_are_values_and_never_sql(campaigns: Path, tmp_path: Path) -> None:
    wicked = "x'); DROP TABLE run; --"
    folder = tmp_path / wicked.replace("/", "_")
    shutil.copytree(campaigns / "c0", folder / "c0")
    file = folder / "c0" / "campaign.toml"
    file.write_text(file.read_text().replace("campaign 00000", wicked))
    added(tmp_path / "archive", folder / "c0")
    rows = archive.find(tmp_path / "archive", Query(campaign=wicked.replace("[", "[[]"))).observations
    assert len(rows) == RUNS * 6 and rows[0].campaign == wicked
    for field in ("structure", "campaign", "run", "kind", "finding"):
        assert archive.find(tmp_path / "archive", Query(**{field: "' OR 1=1 --"})).observations == ()
    assert archive.find(tmp_path / "archive", Query(finding="double-hit")).observations[0].run == "run_003"


def test_maps_and_modes_over_the_amplitude_are_indexed_by_condition(campaigns: Path, tmp_path: Path) -> None:
    source = generated.source_of(campaigns / "c0")
    damping = np.array([[0.01, 0.02, np.nan], [0.03, 0.04, 0.05]])
    chart = ModalMap(
        force_levels=np.array([1.0, 2.0]), normal_forces=np.array([100.0, 200.0, 300.0]), frequency=500 + 0 * damping,
        damping=damping, frequency_std=0.1 + 0 * damping, damping_std=0.001 + 0 * damping,
    )  # fmt: skip
    result = MapResult(
        "map one", chart, np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.ones((2, 3)), ("run_006", "run_007")
    )
    store.save(source.kept / "map_map_one-0123456789ab.h5", {"made": Provenance(), "result": result})
    for run in ("run_006", "run_007"):
        (source.kept / f"{run}.h5").unlink()
    from ema.data import AmplitudeDependentMode, Band

    band = [Band(low=0.9 * v, value=v, high=1.1 * v) for v in (np.array([500.0, 499.0]), np.array([0.01, 0.011]))]
    mode = AmplitudeDependentMode(amplitude=np.array([0.1, 0.2]), frequency=band[0], damping=band[1], name="levels")
    store.save(source.result, replace(StudyResult(example_campaign(), ()), amplitude_modes=(mode,)))
    told = added(tmp_path / "archive", campaigns / "c0")
    assert told.findings == ()
    rows = archive.find(tmp_path / "archive", Query(kind="map", normal_force=(150.0, 300.0))).observations
    assert sorted((row.force_level, row.normal_force, row.damping) for row in rows) == [
        (1.0, 200.0, 0.02), (2.0, 200.0, 0.04), (2.0, 300.0, 0.05),
    ]  # fmt: skip
    assert rows[0].damping_high - rows[0].damping == pytest.approx(1.959964e-3)
    rows = archive.find(tmp_path / "archive", Query(kind="stepped levels")).observations
    assert [row.frequency for row in rows] == [500.0, 499.0]
    assert [row.damping_high for row in rows] == pytest.approx([0.011, 0.0121])


ADD = """
import os, sys, time
from pathlib import Path
from ema import archive
from tests.bench import archive_campaigns as generated
link = os.link
def slowly(*arguments):
    time.sleep(float(sys.argv[3]) / 2)  # a part is written and has no name yet
    link(*arguments)
    time.sleep(float(sys.argv[3]) / 2)
os.link = slowly
places = sorted(Path(sys.argv[2]).iterdir())
print("begun", flush=True)
archive.add(Path(sys.argv[1]), [generated.source_of(one) for one in places])
"""
READ = """
import sys, time
from ema import archive
until = time.monotonic() + 60
whole = 0
print("begun", flush=True)
while whole < int(sys.argv[2]):
    assert time.monotonic() < until, whole
    answer = archive.find(sys.argv[1])
    counts = {}
    for row in answer.observations:
        counts[row.campaign] = counts.get(row.campaign, 0) + 1
    assert set(counts.values()) <= {48} and not answer.findings, (counts, answer.findings)
    assert len(counts) >= whole
    whole = len(counts)
    time.sleep(0.02)
print(whole)
"""


def started(code: str, *arguments: object) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])},
    )
    assert process.stdout is not None and process.stdout.readline() == "begun\n"
    return process


def test_readers_see_whole_campaigns_while_two_others_add(campaigns: Path, tmp_path: Path) -> None:
    folder = parts.make(tmp_path / "archive").parent
    readers = [started(READ, folder, CAMPAIGNS) for _ in range(3)]
    adders = [started(ADD, folder, campaigns, 0.1) for _ in range(2)]
    for process in (*adders, *readers):
        out, wrong = process.communicate(timeout=120)
        assert process.returncode == 0, wrong
    assert out == f"{CAMPAIGNS}\n"
    assert len(listing(folder)) == CAMPAIGNS and len(archive.find(folder).observations) == CAMPAIGNS * RUNS * 6


def test_an_open_reader_sees_one_state_while_a_part_is_taken_away(campaigns: Path, tmp_path: Path) -> None:
    folder = tmp_path / "archive"
    added(folder, *all_of(campaigns))
    with ThreadPoolExecutor(1) as other:
        with cache.opened(folder) as (connection, _):
            (folder / parts.FOLDER / f"{min(parts.names(folder))}{parts.SUFFIX}").unlink()
            later = other.submit(archive.find, folder)
            wait([later], timeout=0.5)
            assert len(cache.known_parts(connection)) == CAMPAIGNS
        assert len(later.result(timeout=60).observations) == (CAMPAIGNS - 1) * RUNS * 6


def test_parts_are_listed_under_the_lock(campaigns: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The list of a reader that waits for the lock gets old: parts added since would seem to be taken away."""
    folder, names, locked = tmp_path / "archive", parts.names, list[bool]()
    added(folder, *all_of(campaigns))

    def listed(archive: Path) -> set[str]:
        try:
            FileLock(f"{cache.path_of(archive)}.lock", timeout=0).acquire().lock.release()
            locked.append(False)
        except Timeout:
            locked.append(True)
        return names(archive)

    monkeypatch.setattr(parts, "names", listed)
    archive.find(folder)
    assert locked[-1]


def test_a_part_that_is_there_is_never_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    record, seen = {"name": "A"}, {"study": "A"}
    part = parts.write(tmp_path, record, seen)
    path = parts.make(tmp_path) / f"{part.name}{parts.SUFFIX}"
    before, asked = path.stat().st_ino, iter([False])
    is_file = Path.is_file
    monkeypatch.setattr(Path, "is_file", lambda self: next(asked, is_file(self)))  # written by another one right after
    assert parts.write(tmp_path, record, seen) == part
    assert path.stat().st_ino == before and [one.name for one in path.parent.iterdir()] == [path.name]


@pytest.mark.skipif(os.name == "nt", reason="no SIGKILL")
def test_a_killed_adder_loses_nothing_and_doubles_nothing(campaigns: Path, tmp_path: Path) -> None:
    folder = parts.make(tmp_path / "archive").parent
    for wanted in (0, 1, 2, 3, 5):
        process = started(ADD, folder, campaigns, 0.4)
        until = time.monotonic() + 60
        while len(parts.names(folder)) < wanted and time.monotonic() < until:
            time.sleep(0.01)
        time.sleep(0.1)
        process.send_signal(signal.SIGKILL)
        process.communicate(timeout=60)
        answer = archive.find(folder)
        campaigns_there = {row.campaign for row in answer.observations}
        assert len(answer.observations) == len(campaigns_there) * RUNS * 6 and answer.findings == ()
        assert len(campaigns_there) >= wanted
    added(folder, *all_of(campaigns))
    assert keys(archive.find(folder).observations) == expected(Query()) and len(listing(folder)) == CAMPAIGNS


def test_campaigns_without_a_date_are_named_where_days_are_asked_for(campaigns: Path, tmp_path: Path) -> None:
    file = campaigns / "c0" / "campaign.toml"
    lines = [line for line in file.read_text().splitlines() if not line.startswith("date")]
    file.write_text("\n".join(lines))
    added(tmp_path / "archive", *all_of(campaigns))
    assert "no-date" not in codes(archive.find(tmp_path / "archive"))
    answer = archive.find(tmp_path / "archive", Query(since=date(2000, 1, 1)))
    assert "no-date" in codes(answer) and len(answer.observations) == (CAMPAIGNS - 1) * RUNS * 6


def test_the_picture_has_every_mode_with_its_interval(campaigns: Path, tmp_path: Path) -> None:
    added(tmp_path / "archive", *all_of(campaigns))
    answer = archive.find(tmp_path / "archive", Query(frequency=(480.0, 520.0)))
    figure = archive.trend(answer)
    upper, lower = figure.axes[:2]
    points = np.concatenate([line.get_ydata() for line in upper.lines[1::2]])
    assert sorted(points) == pytest.approx(sorted(100 * row.damping for row in answer.observations))
    ends = np.concatenate([line.get_ydata() for line in lower.lines[::2]]).reshape(-1, 3)
    assert len(ends) == len(answer.observations) == CAMPAIGNS * RUNS
    assert sorted(ends[:, 1]) == pytest.approx(sorted(row.frequency_high for row in answer.observations))


def test_the_bench_asks_an_archive_of_what_is_read(tmp_path: Path) -> None:
    from tests.bench import archive as bench

    source = generated.write(tmp_path / "c3", 3, 5, bench.SEED)
    read, drawn = recorded(source)[0], bench.record_of(3, 5)
    assert read.keys() == drawn.keys() and read["name"] == drawn["name"] and read["date"] == drawn["date"]
    for own, other in zip(read["runs"], drawn["runs"], strict=True):
        np.testing.assert_allclose(own.pop("modes"), other.pop("modes"), rtol=1e-9)
        assert own.pop("data") != other.pop("data") and own == other


def test_bad_questions_are_refused_in_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no archive here.*ema archive add"):
        archive.find(tmp_path)
    with pytest.raises(InputError, match="lowest normal force is not below the highest; got 300 and 100"):
        Query(normal_force=(300.0, 100.0))
    with pytest.raises(InputError, match="first day is after the last"):
        Query(since=date(2024, 1, 1), until=date(2023, 1, 1))
    with pytest.raises(InputError, match="no archive here"):
        archive.add(tmp_path / "new", (), archives=[tmp_path])


def test_fields_are_read_without_the_rest_of_a_file(tmp_path: Path) -> None:
    from ema.examples import frf_set

    store.save(tmp_path / "one.h5", {"frfs": frf_set(), "other": frf_set(0.1)})
    told = store.load_fields(tmp_path / "one.h5", "quantity", "condition.excitation", name="other")
    assert told["quantity"] == "accelerance" and told["condition.excitation"].kind == "unknown"
    with pytest.raises(InputError, match=r"no such field.*got nothing"):
        store.load_fields(tmp_path / "one.h5", "nothing")
    for inside in ("values.$array", "values.crc32"):  # an array is described in the file; that is no field of it
        with pytest.raises(InputError, match=rf"no such field.*got {re.escape(inside)}"):
            store.load_fields(tmp_path / "one.h5", inside)
    with pytest.raises(InputError, match=r"no such item.*got third, expected frfs, other"):
        store.load_fields(tmp_path / "one.h5", "values", name="third")
    values = store.load_fields(tmp_path / "one.h5", "values")["values"]
    assert isinstance(frf_set(), FrfSet) and np.array_equal(values, frf_set().values)
