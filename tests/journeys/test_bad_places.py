"""Places that cannot be written, a full disk, Ctrl-C: status, one sentence, and what was there before is still there."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.journeys.small_campaign import COMMAND, RUN, campaign, ema_command, ema_process, records, with_signal
from tests.unit.report_page import UNDRAWN

posix = pytest.mark.skipif(sys.platform == "win32", reason="limits and signals of POSIX")
NEVER_WRITABLE = Path("/proc/1/results")
UNWRITTEN = "import sys\nsys.dont_write_bytecode = True\n"
"""No compiled modules from a process whose files may not grow: Python keeps what it could write of them, and the next
process fails with them."""


def left_over(folder: Path) -> list[str]:
    """Temporary files that nobody will ever read."""
    return [path.name for path in folder.rglob(".*") if path.is_file()]


def test_output_below_a_file(tmp_path, capsys):
    (tmp_path / "notes.txt").write_text("in the way")
    folder = campaign(tmp_path / "four")
    ended = ema_command(capsys, "run", folder, "--output", tmp_path / "notes.txt" / "results")
    ended.says(3, "the folder for the results cannot be used", "notes.txt", "choose another one with --output")
    assert (tmp_path / "notes.txt").read_text() == "in the way"


@pytest.mark.skipif(not Path("/proc/1").is_dir(), reason="a folder that not even root may write to")
def test_output_in_a_folder_that_nobody_may_write_to(tmp_path, capsys):
    folder = campaign(tmp_path / "four")
    ended = ema_command(capsys, "run", folder, "--output", NEVER_WRITABLE)
    ended.says(3, str(NEVER_WRITABLE), "cannot be used", "--output")


def obey_permissions() -> None:
    """Take from root the right to write where the permissions forbid it."""
    import ctypes

    drop, override = 24, 1  # PR_CAPBSET_DROP, CAP_DAC_OVERRIDE
    ctypes.CDLL(None).prctl(drop, override, 0, 0, 0)


def campaign_without_impacts(folder: Path) -> Path:
    """A campaign whose hammer never hit anything: it opens, and the first step of the computation refuses it."""
    return campaign(folder, [with_signal(record, 0, 0.0) for record in records()])


def test_a_campaign_without_impacts_is_refused_as_soon_as_it_is_computed(tmp_path):
    ended = ema_process("run", campaign_without_impacts(tmp_path / "four"))
    ended.says(2, "hammer")


@pytest.mark.skipif(sys.platform != "linux", reason="root obeys permissions on Linux alone")
@pytest.mark.parametrize("inside", [False, True], ids=["the folder", "a folder in it"])
def test_output_in_a_read_only_folder(tmp_path, inside):
    """The folder is tried out before anything is computed: its sentence comes before that of the silent hammer."""
    folder = campaign_without_impacts(tmp_path / "four")
    closed = tmp_path / "closed"
    closed.mkdir()
    closed.chmod(0o555)
    ended = ema_process("run", folder, "--output", closed / "new" if inside else closed, preexec_fn=obey_permissions)
    ended.says(3, "the folder for the results", str(closed), "Permission denied", "--output")
    assert list(closed.iterdir()) == []


@posix
@pytest.mark.parametrize("limit", [2_000, 100_000], ids=["at the result", "at the report"])
def test_a_full_disk(tmp_path, limit):
    """A file that may not grow stands for a disk that is full."""
    import resource

    folder = campaign(tmp_path / "four")
    (folder / "_build").mkdir()
    report = folder / "_build" / "four.html"
    report.write_text("the report of yesterday")

    def full() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    ended = ema_process("run", folder, before=UNWRITTEN + UNDRAWN, preexec_fn=full)
    ended.says(3, str(folder / "_build"), "write")
    assert report.read_text() == "the report of yesterday"
    assert left_over(folder) == []
    ended = ema_process("run", folder, "--resume", before=UNDRAWN)
    assert ended.status == 0, ended.err
    assert report.stat().st_size > 100_000


def interrupted(folder: Path, when: str, *options: str) -> tuple[int, str]:
    """Run a study and press Ctrl-C as a terminal does, a moment after ``when`` was printed; status and last words."""
    announce = (
        "import time\nfrom ema.study import chain\nfrom ema import fit\n"
        "def told(what, verb):\n"
        "    def wrapped(*args, **more):\n"
        "        print('BEGIN', what, getattr(args[0], 'name', ''), flush=True)\n"
        "        return verb(*args, **more)\n"
        "    return wrapped\n"
        "fit.stabilise, fit.modes = told('stabilise', fit.stabilise), told('modes', fit.modes)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", announce + COMMAND[-1], "run", str(folder), *options],
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
    ) as process:
        assert process.stdout is not None and process.stderr is not None
        for line in process.stdout:
            if line.strip() == f"BEGIN {when}":
                break
        time.sleep(0.1)
        for _ in range(3):  # Python drops a KeyboardInterrupt raised inside the callback of a weak reference
            os.killpg(process.pid, signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                stderr = process.communicate(timeout=60)[1]
                return process.returncode, stderr
        process.kill()
        raise AssertionError("the command does not end by Ctrl-C")


@posix
def test_ctrl_c_in_the_middle_of_a_fit_keeps_the_finished_run(tmp_path):
    campaign(tmp_path / "four", run=RUN + RUN.replace('"bare"', '"again"'))
    # many orders make the second fit last for many seconds
    recipe = tmp_path / "recipe.toml"
    recipe.write_text('campaign = "four"\n\n[fit]\nband = [20, 450]\norders = [2, 140, 1]\n')
    status, told = interrupted(recipe, "modes again")
    assert status == 130, told
    assert told.startswith("ema: interrupted") and told.count("\n") == 1 and "Traceback" not in told
    assert "finished runs: bare" in told and "--resume" in told
    kept = tmp_path / "_build" / "recipe"
    assert [path.name for path in kept.iterdir()] == ["bare.h5"] and left_over(tmp_path) == []
    before = (kept / "bare.h5").stat().st_mtime_ns

    status, told = interrupted(recipe, "stabilise again", "--resume")
    assert status == 130 and "finished runs: bare" in told, "the first run was taken as it was"
    assert (kept / "bare.h5").stat().st_mtime_ns == before

    recipe.write_text(recipe.read_text().replace("[2, 140, 1]", "[2, 30, 2]"))
    ended = ema_process("run", recipe, "--resume", before=UNDRAWN)
    assert ended.status == 0, ended.err
    assert sorted(path.name for path in kept.iterdir()) == ["again.h5", "bare.h5"]
    assert (kept / "bare.h5").stat().st_mtime_ns > before, "other settings, another result"
