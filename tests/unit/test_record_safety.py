"""Takes are never mixed and never overwritten: names, numbers, two sessions, a journal that can be lost."""

import csv
import errno
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

import acquisition
from acquisition import rig_file
from ema import store
from ema.data import Recording
from ema.errors import FailureError, InputError
from ema.store import atomic
from tests.unit.recording_rig import DrawnImpacts, everything, fingerprints, nothing, rig_folder, session


def take(folder: Path, count: int, seed: int, run: str = "beam", judge=everything) -> list:
    """So many takes of a run; the session is closed afterwards."""
    one = session(folder, run, judge)
    taken = list(islice(one.takes(DrawnImpacts(seed)), count))
    one.close()
    return taken


def peaks_of(folder: Path, run: str) -> list[float]:
    """The peaks of a run as the campaign reads them, in order."""
    return [float(np.max(record.signals[0])) for record in acquisition.open_campaign(folder)[run].recordings]


def journal(folder: Path) -> list[dict[str, str]]:
    with (folder / "takes.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize(("first", "second"), [("beam_1", "beam"), ("beam", "beam_1"), ("a_1_1", "a"), ("1", "1_1_1")])
def test_a_run_never_takes_the_takes_of_another_whatever_their_names(tmp_path: Path, first: str, second: str):
    """The name of one run may begin with that of another, and a number may follow: neither makes them one."""
    folder = rig_folder(tmp_path, points=(1, 2), takes=3)
    truth = {}
    for seed, run in enumerate((first, second)):
        one, source = session(folder, run), DrawnImpacts(seed)
        assert one.done == 0 and one.point == 1
        assert [taken.point for taken in one.takes(source)] == [1, 1, 1, 2, 2, 2]
        truth[run] = source.peaks
    assert {run: peaks_of(folder, run) for run in truth} == truth
    points = [record.channels[0].dof.node for record in acquisition.open_campaign(folder)[second].recordings]
    assert points == [1, 1, 1, 2, 2, 2]


def test_a_run_that_campaign_and_owner_call_otherwise_keeps_its_takes(tmp_path: Path):
    folder = rig_folder(tmp_path, takes=1)
    taken = take(folder, 2, 0)
    path = folder / "campaign.toml"
    path.write_text(path.read_text(encoding="utf-8").replace('id = "beam"', 'id = "beam at 1 kN"'), encoding="utf-8")
    assert peaks_of(folder, "beam at 1 kN") == [one.peak for one in taken]


@pytest.mark.parametrize("gone", [1, 2, 3])
def test_a_number_whose_take_was_deleted_is_not_given_again(tmp_path: Path, gone: int):
    folder = rig_folder(tmp_path, points=(1,), takes=3)
    take(folder, 3, 0)
    (folder / "raw" / f"beam_1_{gone:03d}.h5").unlink()
    before = fingerprints(folder)
    (again,) = take(folder, 5, 1)
    assert again.path.name == "beam_1_004.h5"
    after = fingerprints(folder)
    assert {name: after[name] for name in before} == before and len(after) == 3
    accepted = {row["file"]: row["accepted"] for row in journal(folder)}
    assert accepted.pop(f"raw/beam_1_{gone:03d}.h5") == "deleted" and set(accepted.values()) == {"yes"}


def test_accepted_and_rejected_takes_share_their_numbers(tmp_path: Path):
    """An operator who overrules a verdict moves the file; it must not land on another take."""
    folder = rig_folder(tmp_path, points=(1,), takes=2)
    take(folder, 1, 0)
    (aside,) = take(folder, 1, 1, judge=nothing)
    take(folder, 1, 2)
    assert sorted(fingerprints(folder)) == ["raw/beam_1_001.h5", "raw/beam_1_003.h5", "rejected/beam_1_002.h5"]
    os.rename(aside.path, folder / "raw" / aside.path.name)
    assert session(folder).done == 3 and len(peaks_of(folder, "beam")) == 3
    row = next(row for row in journal(folder) if row["number"] == "2")
    assert (row["file"], row["accepted"]) == ("raw/beam_1_002.h5", "yes") and row["reason"]
    assert len(journal(folder)) == 3


def test_a_second_session_in_the_folder_is_refused_until_the_first_ends(tmp_path: Path):
    folder = rig_folder(tmp_path, takes=3)
    one = session(folder)
    takes = one.takes(DrawnImpacts(0))
    next(takes)
    for run in ("beam", "other"):
        with pytest.raises(FailureError, match=r"another session records into this folder.*\.record\.lock"):
            session(folder, run)
    assert len(fingerprints(folder)) == 1
    takes.close()
    assert session(folder).done == 1


def test_two_sessions_made_before_either_records_lose_nothing(tmp_path: Path):
    folder = rig_folder(tmp_path, points=(1,), takes=3)
    one, two = session(folder), session(folder)
    first = one.takes(DrawnImpacts(0))
    next(first)
    with pytest.raises(FailureError, match="another session"):
        next(two.takes(DrawnImpacts(1)))
    first.close()
    assert [taken.path.name for taken in two.takes(DrawnImpacts(1))] == ["beam_1_002.h5", "beam_1_003.h5"]
    assert len(fingerprints(folder)) == 3


def test_where_locks_do_not_hold_takes_still_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A network drive may grant one lock twice: a number taken meanwhile is passed over, nothing is replaced."""
    from acquisition.live import folder_lock

    monkeypatch.setattr(folder_lock.FolderLock, "acquire", lambda self: None)
    folder = rig_folder(tmp_path, points=(1,), takes=6)
    one, two = session(folder).takes(DrawnImpacts(0)), session(folder).takes(DrawnImpacts(1))
    told = [next(takes) for _ in range(3) for takes in (one, two)]
    assert len({taken.path for taken in told}) == 6
    for taken in told:
        assert store.load(taken.path).signals[0].max() == taken.peak
    assert len(peaks_of(folder, "beam")) == 6


@pytest.mark.skipif(sys.platform == "win32", reason="flock is of POSIX")
@pytest.mark.filterwarnings("ignore:flock not supported")
def test_a_drive_that_grants_no_lock_has_one_session_or_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """``flock`` answers ENOSYS: filelock counts the file itself as the lock, or refuses, as older versions do."""
    from acquisition.live.folder_lock import FolderLock

    def refused(*_: object) -> None:
        raise OSError(errno.ENOSYS, "Function not implemented")

    monkeypatch.setattr("fcntl.flock", refused)
    first, second = FolderLock(tmp_path), FolderLock(tmp_path)
    try:
        first.acquire()
    except FailureError as error:
        assert "cannot be locked against a second session" in str(error)
        return
    with pytest.raises(FailureError, match=r"another session records.*remove \.record\.lock there"):
        second.acquire()
    first.release()
    second.acquire()
    second.release()


def test_a_killed_session_leaves_no_lock_and_no_temporary_file(tmp_path: Path):
    folder = rig_folder(tmp_path, points=(1,), takes=500)
    script = (
        "import sys; from pathlib import Path; from tests.unit.recording_rig import *\n"
        "for one in session(Path(sys.argv[1])).takes(DrawnImpacts(0)): print(one.path.name, flush=True)"
    )
    command = [sys.executable, "-c", script, str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[2]) as process:
        told = [process.stdout.readline().strip() for _ in range(3)]
        process.kill()
        told += process.stdout.read().split()
    (folder / "raw" / ".beam_1_099.h5.0a0a0a-1-abcdefabcdef.tmp").write_bytes(b"half a take")
    (folder / "raw" / "beam_1_098.h5").touch()
    again = session(folder)
    assert len(told) <= again.done <= len(told) + 1
    assert sorted(path.name for path in (folder / "raw").iterdir()) == sorted(
        f"beam_1_{number:03d}.h5" for number in range(1, again.done + 1)
    )


@pytest.mark.parametrize("loss", ["gone", "empty", "cut", "foreign"])
def test_the_journal_is_made_again_from_the_takes(tmp_path: Path, loss: str):
    folder = rig_folder(tmp_path, points=(1, 2), takes=2)
    take(folder, 1, 0, judge=nothing)
    take(folder, 4, 1)
    whole, path = journal(folder), folder / "takes.csv"
    text = path.read_text(encoding="utf-8")
    assert [row["accepted"] for row in whole] == ["no", "yes", "yes", "yes", "yes"]
    match loss:
        case "gone":
            path.unlink()
        case "empty":
            path.write_text("")
        case "cut":
            path.write_text(text[: len(text) * 2 // 3], encoding="utf-8")
        case "foreign":
            path.write_text("a;b\n1;2\n", encoding="utf-8")
    session(folder)
    assert journal(folder) == whole
    kept = [other.read_text() for other in folder.glob("takes*.csv") if other != path]
    assert kept == (["a;b\n1;2\n"] if loss == "foreign" else []), "what is not ours is set aside, not lost"


def test_a_journal_that_cannot_be_written_costs_no_take(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """As where a spreadsheet has it open: the system refuses to replace it."""
    folder = rig_folder(tmp_path, points=(1,), takes=3)
    one = session(folder)
    replace = os.replace

    def refused(source: str, target: str) -> None:
        if Path(target).name == "takes.csv":
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        replace(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", refused)
        taken = list(one.takes(DrawnImpacts(0)))
    assert len(taken) == 3 and all("takes.csv cannot be written" in " ".join(each.remarks) for each in taken)
    session(folder)
    assert len(journal(folder)) == 3


def test_a_journal_runs_no_formula_of_a_take(tmp_path: Path):
    """A take may come from anybody: what it says of itself is text in a spreadsheet."""
    folder = rig_folder(tmp_path, points=(1,), takes=3)
    (taken,) = take(folder, 1, 0)
    formula = '=cmd|"/c calc"!A1'
    record = store.load(taken.path)
    identity = replace(record.identity, run="-2+3", number=7, key="b", reasons=(formula,), remarks=("@SUM(1)",))
    store.save(folder / "raw" / "other_1_007.h5", replace(record, identity=identity))
    for _ in range(2):  # made, and read again
        session(folder)
        (row,) = [row for row in journal(folder) if row["number"] == "7"]
        assert [row[name] for name in ("run", "reason", "remarks")] == ["'-2+3", f"'{formula}", "'@SUM(1)"]


def test_runs_with_other_joints_have_their_columns(tmp_path: Path):
    folder = rig_folder(tmp_path, points=(1,), takes=1, ring=False)
    bare = session(folder, "bare")
    list(bare.takes(DrawnImpacts(0, ring=False)))
    rig_folder(tmp_path, points=(1,), takes=1)
    take(folder, 1, 1)
    rows = journal(folder)
    assert [row["run"] for row in rows] == ["bare", "beam"]
    assert rows[0]["F_N J1 [N]"] == "" and float(rows[1]["F_N J1 [N]"]) == pytest.approx(1000, abs=1)
    campaign = acquisition.open_campaign(folder)
    assert campaign["bare"].condition.joints == () and campaign["beam"].condition.joints[0].mean == pytest.approx(
        1000, abs=1
    )


@pytest.mark.parametrize(
    ("run", "words"),
    [
        ("Beam", "differs from run beam by capital letters alone"),
        ("CON", "a name that Windows keeps for a device"),
        ("lpt1", "a name that Windows keeps for a device"),
        ("COM²", "a name that Windows keeps for a device"),
        ("x" * 65, "65 characters"),
        ("a.b", "letters, digits, - and _"),
        ("", "letters, digits, - and _"),
    ],
)
def test_a_run_name_that_some_disk_cannot_keep_is_refused(tmp_path: Path, run: str, words: str):
    folder = rig_folder(tmp_path, points=(1,), takes=1)
    take(folder, 1, 0)
    before = fingerprints(folder)
    with pytest.raises(InputError, match=words):
        session(folder, run)
    assert fingerprints(folder) == before


def test_one_name_in_two_spellings_of_unicode_is_one_run(tmp_path: Path):
    """macOS hands names out decomposed; a composed and a decomposed umlaut are one letter."""
    folder = rig_folder(tmp_path, points=(1,), takes=2)
    take(folder, 1, 0, run="Tr\u00e4ger")
    assert session(folder, "Tra\u0308ger").done == 1


@pytest.mark.parametrize(
    ("points", "words"), [("1, 1", "point 1 stands twice"), ("-1, 2", "a point is a number from 0")]
)
def test_points_that_cannot_be_told_apart_are_refused(tmp_path: Path, points: str, words: str):
    folder = rig_folder(tmp_path)
    path = folder / "rig.toml"
    path.write_text(path.read_text().replace("points = [1, 2]", f"points = [{points}]"))
    with pytest.raises(InputError, match=words):
        rig_file.load(folder)


def test_a_copy_of_a_take_is_not_a_second_take(tmp_path: Path):
    folder = rig_folder(tmp_path, points=(1,), takes=3)
    taken = take(folder, 2, 0)
    shutil.copy(taken[0].path, folder / "raw" / "beam_1_007.h5")
    again = session(folder)
    assert again.done == 2 and any("beam_1_007.h5" in note for note in again.notes)
    with pytest.raises(InputError, match=r"one take twice.*beam_1_001\.h5.*beam_1_007\.h5"):
        acquisition.open_campaign(folder)
    assert take(folder, 1, 1)[0].path.name == "beam_1_008.h5"


def test_a_file_that_cannot_be_read_is_named_and_its_number_is_not_given_again(tmp_path: Path):
    folder = rig_folder(tmp_path, points=(1,), takes=3)
    taken = take(folder, 2, 0)
    taken[1].path.write_bytes(taken[1].path.read_bytes()[:3000])
    again = session(folder)
    assert again.done == 1 and any("beam_1_002.h5" in note for note in again.notes)
    assert take(folder, 1, 1)[0].path.name == "beam_1_003.h5"
    assert taken[1].path.stat().st_size == 3000


def test_takes_without_an_identity_count_by_their_whole_name(tmp_path: Path):
    """Files of earlier versions: run, point and number are read from the right, where they cannot be mistaken."""
    folder = rig_folder(tmp_path, points=(1, 2), takes=1)
    (folder / "raw").mkdir()
    record: Recording = next(DrawnImpacts(0).takes())
    store.save(folder / "raw" / "beam_1_2_001.h5", record)
    assert session(folder, "beam").done == 0 and session(folder, "beam_1").done == 1


def test_what_the_owner_wrote_into_the_campaign_is_understood_not_searched(tmp_path: Path):
    folder = rig_folder(tmp_path, points=(1,), takes=1)
    take(folder, 1, 0, run="bare")
    path = folder / "campaign.toml"
    path.write_text(path.read_text(encoding="utf-8") + '# not yet: id = "beam"', encoding="utf-8")
    take(folder, 1, 1)
    assert [run.id for run in acquisition.open_campaign(folder).runs] == ["bare", "beam"]
    text = path.read_text(encoding="utf-8").replace('id = "beam"\nkind', "id = 'beam'\nkind")
    path.write_text(text, encoding="utf-8")
    session(folder)
    assert path.read_text(encoding="utf-8") == text
    path.write_text(text + "\n[[runs]\n", encoding="utf-8")
    with pytest.raises(InputError, match="not TOML"):
        session(folder)
    assert path.read_text(encoding="utf-8").endswith("[[runs]\n")


def test_a_run_of_the_campaign_with_other_files_is_named(tmp_path: Path):
    folder = rig_folder(tmp_path, points=(1,), takes=2)
    take(folder, 1, 0)
    path = folder / "campaign.toml"
    text = path.read_text(encoding="utf-8").replace("beam_{point}_{take}.h5", "beam_{point}_001.h5")
    path.write_text(text, encoding="utf-8")
    assert any("takes other files than" in note for note in session(folder).notes)
    assert path.read_text(encoding="utf-8") == text


def test_a_run_begun_with_other_channels_is_not_mixed(tmp_path: Path):
    folder = rig_folder(tmp_path, takes=2, ring=False)
    one = session(folder)
    next(one.takes(DrawnImpacts(0, ring=False)))
    one.close()
    rig_folder(tmp_path, takes=2)
    with pytest.raises(InputError, match=r"begun with other channels.*ring J1.*another name"):
        session(folder)


def test_a_take_that_cannot_be_judged_is_kept_aside(tmp_path: Path):
    def fails(record: Recording):
        raise InputError("the force channel is dead")

    (taken,) = take(rig_folder(tmp_path), 1, 0, judge=fails)
    assert not taken.accepted and taken.reasons == ("the force channel is dead",) and taken.path.is_file()


def test_a_run_without_a_take_is_not_in_the_campaign(tmp_path: Path):
    folder = rig_folder(tmp_path, points=(1,), takes=1)
    take(folder, 1, 0, run="bare")
    take(folder, 3, 1, judge=nothing)
    assert [run.id for run in acquisition.open_campaign(folder).runs] == ["bare"]


def test_the_command_says_that_no_take_counts(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch):
    from ema import estimate
    from ema.cli import recording
    from tests.journeys.small_campaign import ema_command

    folder = rig_folder(tmp_path / "today", points=(1,), takes=2)
    monkeypatch.setattr(recording, "opened", lambda rig, one: DrawnImpacts(0))
    monkeypatch.setattr(estimate, "check_impact", nothing)
    ended = ema_command(capsys, "record", folder, "--run", "beam", "--takes", 3)
    assert ended.status == 1 and "Next: ema run" not in ended.out
    assert "0 of 2 takes; 3 rejected" in ended.out and "the hammer struck twice" in ended.out
    monkeypatch.setattr(estimate, "check_impact", everything)
    ended = ema_command(capsys, "record", folder, "--run", "beam", "--takes", 1)
    assert ended.status == 0 and "the same command goes on" in ended.out
    ended = ema_command(capsys, "record", folder, "--run", "beam")
    assert ended.status == 0 and "Next: ema run" in ended.out
    ended = ema_command(capsys, "record", folder, "--run", "beam")
    assert ended.status == 0 and "2 of 2 takes" in ended.out and "Next: ema run" in ended.out


@pytest.mark.parametrize("links", [True, False])
def test_a_file_that_is_only_ever_created_replaces_nothing(tmp_path: Path, monkeypatch, links: bool):
    if not links:

        def refused(source: object, target: object, **options: object) -> None:
            raise OSError(errno.EPERM, "no links here, as on FAT")

        monkeypatch.setattr(os, "link", refused)
    path = tmp_path / "a.txt"
    with atomic.replacing(path, exclusive=True) as temporary:
        temporary.write_text("first")
    with (
        pytest.raises(FailureError, match="there is a file of this name already"),
        atomic.replacing(path, exclusive=True) as temporary,
    ):
        temporary.write_text("second")
    assert path.read_text() == "first" and [each.name for each in tmp_path.iterdir()] == ["a.txt"]


def test_a_clock_set_back_changes_no_order_and_no_number(tmp_path: Path):
    """Numbers count takes; nothing is named or sorted by the clock alone."""
    folder = rig_folder(tmp_path, points=(1,), takes=4)
    drawn = np.random.default_rng(412)

    class Back(DrawnImpacts):
        def takes(self):
            for record in super().takes():
                yield replace(record, start=datetime(2026, 1, 1, tzinfo=UTC) - timedelta(days=int(drawn.integers(900))))

    source = Back(0)
    for _ in range(2):
        one = session(folder)
        list(islice(one.takes(source), 2))
        one.close()
    assert peaks_of(folder, "beam") == source.peaks[:2] * 2
    assert [row["number"] for row in journal(folder)] == ["1", "2", "3", "4"]
    (folder / "takes.csv").unlink()
    session(folder)
    assert sorted(row["number"] for row in journal(folder)) == ["1", "2", "3", "4"]


AS_ANOTHER = """
import os, sys
from pathlib import Path
from ema.errors import EmaError
from tests.unit.recording_rig import *
import h5py, acquisition.campaign_file, ema.store.writing, ema.store.reading
rig_file.load(Path(sys.argv[1]))  # whatever is read from the installation is read as ourselves
rig_file.wires(rig_file.load(Path(sys.argv[1])))
if os.geteuid() == 0:
    os.setuid(65534)  # root may write anywhere
try:
    print(next(session(Path(sys.argv[1])).takes(DrawnImpacts(5))).path.name)
except EmaError as error:
    print(error)
    sys.exit(error.exit_code)
"""


@pytest.mark.skipif(os.name != "posix", reason="users and permissions of POSIX systems")
@pytest.mark.parametrize("what", ["folder", "raw", "lock"])
def test_what_another_user_keeps_to_himself_is_a_sentence_before_the_first_take(what: str):
    folder = rig_folder(Path(tempfile.mkdtemp()), points=(1,), takes=3)
    try:
        take(folder, 1, 0)
        before = fingerprints(folder)
        folder.chmod(0o777)
        (folder / "raw").chmod(0o777)
        (folder / "rejected").chmod(0o777)
        locked = {"folder": folder, "raw": folder / "raw", "lock": folder / ".record.lock"}[what]
        locked.chmod(0o500 if what != "lock" else 0o400)
        if what == "folder":
            (folder / ".record.lock").unlink()
            folder.chmod(0o555)
        command = [sys.executable, "-c", AS_ANOTHER, str(folder)]
        done = subprocess.run(command, capture_output=True, text=True, cwd=Path(__file__).parents[2], timeout=120)
        assert done.returncode == 3 and "Traceback" not in done.stderr, done.stdout + done.stderr
        assert len(done.stdout.strip().splitlines()) == 1 and str(folder) in done.stdout
        for each in (folder, folder / "raw"):
            each.chmod(0o755)
        assert fingerprints(folder) == before
    finally:
        for each in (folder, folder / "raw"):
            each.chmod(0o755)
        shutil.rmtree(folder)
