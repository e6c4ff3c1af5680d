"""A killed writer, a full disk, a read-only folder: the former file survives, and the caller gets one sentence."""

import errno
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

from ema import store
from ema.data import Channel, Recording
from ema.errors import FailureError, InputError
from ema.store.atomic import replacing, write_failure

PREPARE = """
import os, resource, sys, time
import ema.store.writing
from pathlib import Path
import numpy as np
from ema import store
from ema.data import Channel, Recording
from ema.errors import FailureError
def record(samples, value=0.0):
    rng = np.random.default_rng(0)
    return Recording(rng.standard_normal((1, samples)) + value, 1000.0, (Channel("a"),))
def attempt(action):
    try:
        action()
    except FailureError as error:
        print(error)
        sys.exit(error.exit_code)
path = Path(sys.argv[1])
"""


def record(samples: int, value: float = 0.0) -> Recording:
    return Recording(np.full((1, samples), value), 1000.0, (Channel("a"),))


def run(script: str, path: Path) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-c", PREPARE + script, str(path)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def ctrl_c(process: "subprocess.Popen[str]") -> int:
    """Press Ctrl-C, as a user does, until the process ends; its exit status.

    Once need not be enough: Python drops an exception raised inside the callback of a weak reference or a finaliser
    (sys.unraisablehook), KeyboardInterrupt too, and h5py has such callbacks.
    """
    try:
        for _ in range(20):
            process.send_signal(signal.SIGINT)
            try:
                return process.wait(3)
            except subprocess.TimeoutExpired:
                continue
        raise AssertionError("the process does not end by Ctrl-C")
    finally:
        process.kill()


@pytest.mark.parametrize("moment", ["while writing", "before renaming"])
def test_a_killed_writer_leaves_the_former_file(tmp_path: Path, moment: str) -> None:
    path = tmp_path / "a.h5"
    store.save(path, record(1000, 7.0))
    script = {
        "while writing": """
with store.Writer(path) as writer:
    block = writer.begin(record(0))
    while True:
        block.append(record(100_000).signals)
        print("written", flush=True)
""",
        "before renaming": """
from ema.store import atomic
def wait(file):
    print("written", flush=True)
    time.sleep(60)
atomic._to_disk = wait
store.save(path, record(500_000))
""",
    }[moment]
    with subprocess.Popen(
        [sys.executable, "-c", PREPARE + script, str(path)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "written\n"
        time.sleep(0.05)
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL
    assert (store.load(path).signals == 7.0).all()
    assert len(list(tmp_path.glob(".a.h5.*.tmp"))) == 1, "the writer was killed in the middle"
    other = tmp_path / ".a.h5.of-another-kind.tmp"
    other.touch()
    store.save(path, record(10, 5.0))
    assert sorted(each.name for each in tmp_path.iterdir()) == [other.name, "a.h5"], "the next writer tidies up"


@pytest.mark.parametrize("room", [0, 1000, 30_000, 150_000, 1_500_000])
def test_a_full_disk_is_a_failure_and_the_former_file_survives(tmp_path: Path, room: int) -> None:
    path = tmp_path / "a.h5"
    store.save(path, record(1000, 7.0))
    done = run(
        f"resource.setrlimit(resource.RLIMIT_FSIZE, ({room}, {room}))\n"
        "attempt(lambda: store.save(path, {str(k): record(50_000) for k in range(8)}))",
        path,
    )
    assert done.returncode == 3, done.stderr
    assert "a.h5: the file is larger than this system allows" in done.stdout and "Traceback" not in done.stderr
    assert (store.load(path).signals == 7.0).all()
    assert [each.name for each in tmp_path.iterdir()] == ["a.h5"]


def test_a_disk_that_fills_between_blocks_is_a_failure(tmp_path: Path) -> None:
    script = """
resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, 1_000_000))
def write():
    with store.Writer(path) as writer:
        block = writer.begin(record(0))
        for _ in range(100):
            block.append(record(100_000).signals)
            print("block", flush=True)
attempt(write)
"""
    done = run(script, tmp_path / "a.h5")
    assert done.returncode == 3, done.stderr
    assert done.stdout.count("block") < 20, "the failure shows within the buffer of the library"
    assert list(tmp_path.iterdir()) == []


def test_a_read_only_folder_is_a_failure() -> None:
    folder = Path(tempfile.mkdtemp())
    try:
        store.save(folder / "a.h5", record(10, 7.0))
        folder.chmod(0o555)
        script = """
if os.geteuid() == 0:
    os.setuid(65534)  # root may write anywhere
attempt(lambda: store.save(path, record(10)))
"""
        done = run(script, folder / "a.h5")
        assert done.returncode == 3, done.stderr
        assert "no permission to write here; choose a folder" in done.stdout
        folder.chmod(0o755)
        assert (store.load(folder / "a.h5").signals == 7.0).all()
        assert [each.name for each in folder.iterdir()] == ["a.h5"]
    finally:
        folder.chmod(0o755)
        shutil.rmtree(folder)


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (errno.ENOSPC, "the disk is full; make room"),
        (errno.EDQUOT, "quota"),
        (errno.EROFS, "read-only"),
        (errno.EIO, "cannot be written"),
    ],
)
def test_each_cause_has_its_sentence(code: int, words: str) -> None:
    failure = write_failure(OSError(code, os.strerror(code)), Path("a.h5"))
    assert isinstance(failure, FailureError) and words in str(failure) and str(failure).startswith("a.h5: ")


def test_an_error_or_interrupt_while_writing_leaves_nothing_behind(tmp_path: Path) -> None:
    store.save(tmp_path / "a.h5", record(10, 7.0))
    for stop in (KeyboardInterrupt, InputError("no")):
        with pytest.raises((KeyboardInterrupt, InputError)), store.Writer(tmp_path / "a.h5") as writer:
            writer.add(record(10), "x")
            raise stop
    assert [each.name for each in tmp_path.iterdir()] == ["a.h5"]
    assert (store.load(tmp_path / "a.h5").signals == 7.0).all()


def test_ctrl_c_at_any_moment_leaves_the_former_file(tmp_path: Path) -> None:
    store.save(tmp_path / "a.h5", record(1000, 7.0))
    script = """
try:
    print("ready", flush=True)
    while True:
        store.save(path.with_name("b.h5"), {str(k): record(30_000) for k in range(5)})
except KeyboardInterrupt:
    sys.exit(130)
"""
    for number in range(6):
        with subprocess.Popen(
            [sys.executable, "-c", PREPARE + script, str(tmp_path / "a.h5")], stdout=subprocess.PIPE, text=True
        ) as process:
            assert process.stdout is not None and process.stdout.readline() == "ready\n"
            time.sleep(0.05 + 0.037 * number)
            assert ctrl_c(process) == 130
    assert (store.load(tmp_path / "a.h5").signals == 7.0).all()
    assert {each.name for each in tmp_path.iterdir()} <= {"a.h5", "b.h5"}
    if (tmp_path / "b.h5").exists():
        assert len(store.load(tmp_path / "b.h5")) == 5


def test_any_file_can_be_replaced_atomically(tmp_path: Path) -> None:
    target, link = tmp_path / "a.txt", tmp_path / "link.txt"
    target.write_text("old")
    link.symlink_to(target)
    with replacing(link) as temporary:
        temporary.write_text("new")
        assert target.read_text() == "old"
    assert target.read_text() == "new" and link.is_symlink()
    mask = os.umask(0)
    os.umask(mask)
    assert target.stat().st_mode & 0o777 == 0o666 & ~mask
