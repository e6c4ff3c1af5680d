"""Foreign parsers run in a process of their own: crashes, hangs and growth of theirs end in one sentence here."""

import ctypes
import gzip
import os
import subprocess
import sys
import threading
import time
import zipfile
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

import acquisition
from acquisition.isolated import limits, memory, process, wire
from ema.errors import InputError

ROOT = Path(acquisition.__file__).resolve().parent.parent

READS = """
import sys
import acquisition
from acquisition.isolated import process
print(acquisition.read(sys.argv[1], signals="data", sampling_rate=100.0).recordings[0].signals.shape, flush=True)
print(process._PARSERS._process.pid, flush=True)
if len(sys.argv) > 2:
    sys.stdin.read()
"""


@pytest.fixture
def npz(tmp_path: Path) -> Path:
    path = tmp_path / "a.npz"
    np.savez(path, data=np.ones((2, 50)))
    return path


@pytest.fixture
def parsers() -> Iterator[process.Parsers]:
    own = process.Parsers()
    yield own
    own.close()


def test_a_process_that_was_killed_is_started_again(npz: Path, parsers: process.Parsers) -> None:
    (array,) = parsers.call("npz", npz, {})["arrays"].values()
    np.testing.assert_array_equal(array, np.ones((2, 50)))
    first = parsers._process
    assert first is not None
    parsers.call("npz", npz, {})
    assert parsers._process is first
    first.kill()
    first.wait()
    assert parsers.call("npz", npz, {})["left"] == {}
    assert parsers._process is not first


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs a named pipe")
def test_a_parser_that_never_ends_is_stopped(
    tmp_path: Path, npz: Path, parsers: process.Parsers, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A named pipe that nobody writes to keeps whoever opens it waiting."""
    os.mkfifo(tmp_path / "never.gz")
    monkeypatch.setattr(limits, "SECONDS", 1.0)
    start = time.monotonic()
    with pytest.raises(InputError, match=r"never.gz: reading the file takes too long; got more than 1 s"):
        parsers.call("gzip", tmp_path / "never.gz", {})
    assert time.monotonic() - start < 60
    assert parsers.call("npz", npz, {})["left"] == {}


@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_a_crash_is_one_sentence(tmp_path: Path, npz: Path, parsers: process.Parsers) -> None:
    import signal

    os.mkfifo(tmp_path / "never.gz")
    crash = threading.Timer(0.5, parsers._running().send_signal, [signal.SIGSEGV])
    crash.start()
    with pytest.raises(InputError, match=r"never.gz: the file is damaged: its reader broke down; got signal SIGSEGV"):
        parsers.call("gzip", tmp_path / "never.gz", {})
    assert parsers.call("npz", npz, {})["left"] == {}


@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_a_file_is_not_blamed_for_a_crash_that_an_earlier_one_may_have_prepared(
    tmp_path: Path, npz: Path, parsers: process.Parsers
) -> None:
    import signal

    parsers.call("npz", npz, {})
    used, path = parsers._running(), tmp_path / "late.gz"
    os.mkfifo(path)

    def crash() -> None:
        path.unlink()
        path.write_bytes(gzip.compress(b"whole"))
        used.send_signal(signal.SIGSEGV)

    threading.Timer(0.5, crash).start()
    assert bytes(parsers.call("gzip", path, {})["bytes"]) == b"whole"
    assert parsers._process is not used


def test_memory_beyond_the_size_of_the_file_is_refused(tmp_path: Path) -> None:
    """An array that announces 8 TB, in an archive of 200 bytes."""
    head = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }".ljust(117) + b"\n"
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("a.npy", b"\x93NUMPY\x01\x00v\x00" + head)
    with pytest.raises(InputError, match="more memory"):
        acquisition.read(tmp_path / "a.npz", sampling_rate=1.0)
    (tmp_path / "a.npy").write_bytes(b"\x93NUMPY\x01\x00v\x00" + head)
    with pytest.raises(InputError, match="ends inside the array"):
        acquisition.read(tmp_path / "a.npy", sampling_rate=1.0)


@pytest.mark.parametrize("suffix", ["csv", "uff", "json"])
def test_a_packed_file_grows_to_what_measurements_do_and_no_further(tmp_path: Path, suffix: str) -> None:
    """0.3 MB that unpack to 300 MB."""
    begin = {"csv": b"t,a\n", "uff": b"    -1\n   151\n", "json": b'{"a": [[0, 1]'}[suffix]
    with gzip.open(tmp_path / f"a.{suffix}.gz", "wb", compresslevel=9) as file:
        file.write(begin)
        for _ in range(300):
            file.write(b"0.0,0.0\n" * 125_000)
    with pytest.raises(InputError, match="grows too large"):
        acquisition.read(tmp_path / f"a.{suffix}.gz")


def test_a_table_of_zeros_that_is_packed_is_read(tmp_path: Path) -> None:
    rows = "".join(f"{k / 100:.2f},0.0\n" for k in range(200_000))
    with gzip.open(tmp_path / "a.csv.gz", "wb") as file:
        file.write(b"t [s],a [N]\n" + rows.encode())
    (record,) = acquisition.read(tmp_path / "a.csv.gz").recordings
    assert record.signals.shape == (1, 200_000)


@pytest.fixture
def workbook(tmp_path: Path) -> Path:
    import openpyxl

    book = openpyxl.Workbook()
    book.active.append(["t [s]", "a [N]"])
    for k in range(100):
        book.active.append([k / 100, float(np.sin(k))])
    book.save(tmp_path / "a.xlsx")
    return tmp_path / "a.xlsx"


def test_a_cell_far_away_adds_one_cell_to_a_workbook(workbook: Path) -> None:
    """The rectangle that the cells span has 17 thousand million cells; those that are filled are kept, no others."""
    import openpyxl

    from acquisition.files.xlsx import cells

    book = openpyxl.load_workbook(workbook)
    book.active.cell(1_048_576, 16_384, "a note")
    book.save(workbook)
    filled = cells(workbook, None)
    assert filled["values"].shape == (200,) and len(filled["texts"]) == 3
    (record,) = acquisition.read(workbook).recordings
    np.testing.assert_allclose(record.signals[0], np.sin(np.arange(100)), rtol=1e-14)
    book.active.cell(1_048_576, 16_384, 5.0)
    book.save(workbook)
    for salvage in (False, True):
        with pytest.raises(InputError, match="row 102: a row among the numbers holds none"):
            acquisition.read(workbook, salvage=salvage)


def test_a_workbook_is_read_whole_whatever_size_it_announces(workbook: Path) -> None:
    """The element ``dimension`` of a sheet says A1:B20, the sheet holds a hundred rows."""
    with zipfile.ZipFile(workbook) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    sheet = members["xl/worksheets/sheet1.xml"]
    assert b'<dimension ref="A1:B101"' in sheet
    members["xl/worksheets/sheet1.xml"] = sheet.replace(b'ref="A1:B101"', b'ref="A1:B20"')
    with zipfile.ZipFile(workbook, "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    (record,) = acquisition.read(workbook).recordings
    assert record.signals.shape == (1, 100)


def test_a_workbook_that_unpacks_beyond_measure_is_refused(workbook: Path) -> None:
    with zipfile.ZipFile(workbook, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("xl/media/picture.bin", bytes(300_000_000))
    with pytest.raises(InputError, match="grows too large; got 300 MB"):
        acquisition.read(workbook)


def test_the_process_loads_the_packages_of_its_parent_and_nothing_beside_the_data(npz: Path) -> None:
    """The parent finds the packages by ``PYTHONPATH`` alone; the current folder holds others of the same names."""
    (npz.parent / "numpy.py").write_text("raise SystemExit('imported from beside the data')")
    (npz.parent / "json.py").write_text("raise SystemExit('imported from beside the data')")
    (npz.parent / "acquisition").mkdir()
    (npz.parent / "acquisition" / "__init__.py").write_text("raise SystemExit('imported from beside the data')")
    done = subprocess.run(
        [sys.executable, "-P", "-c", READS, str(npz)],
        cwd=npz.parent,
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("(2, 50)")


def _running(number: int) -> bool:
    """Whether a process runs, and is no remainder that nobody has asked after."""
    try:
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
@pytest.mark.parametrize("how", ["ends", "is killed"])
def test_the_process_ends_with_its_parent(npz: Path, how: str) -> None:
    parent = subprocess.Popen(
        [sys.executable, "-c", READS, str(npz), *(["wait"] if how == "is killed" else [])],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert parent.stdout is not None and parent.stdin is not None
    parent.stdout.readline()
    child = int(parent.stdout.readline())
    if how == "is killed":
        assert _running(child)
        parent.kill()
    parent.wait(60)
    parent.stdin.close()
    parent.stdout.close()
    end = time.monotonic() + 30
    while _running(child) and time.monotonic() < end:
        time.sleep(0.05)
    assert not _running(child)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_forked_process_has_parsers_of_its_own(npz: Path, parsers: process.Parsers) -> None:
    parsers.call("npz", npz, {})
    child = os.fork()
    if not child:
        try:
            parsers.call("npz", npz, {})
            parsers.close()
        except BaseException:
            os._exit(1)
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert parsers.call("npz", npz, {})["left"] == {}


def test_messages_hold_arrays_and_texts_and_nothing_that_runs(tmp_path: Path) -> None:
    tree = {
        "a": np.arange(6, dtype=">i2").reshape(2, 3),
        "b": [np.array(1.5), np.zeros((0, 4), np.complex64), "µ\udc80"],
        "c": np.array([["x", "yy"]]),
        "d": {"e": None, "f": float("inf")},
        "g": np.asfortranarray(np.eye(3)),
    }
    with (tmp_path / "wire").open("w+b") as file:
        wire.send(file, tree)
        file.seek(0)
        back = wire.receive(file)
        assert file.read() == b""
        for key in ("a", "c", "g"):
            np.testing.assert_array_equal(back[key], tree[key])
            assert back[key].dtype == tree[key].dtype
        assert back["b"][0] == 1.5 and back["b"][1].shape == (0, 4) and back["b"][2:] == ["µ\udc80"]
        assert back["d"] == tree["d"]
        with pytest.raises(TypeError, match="cannot be sent"):
            wire.send(file, {"a": np.array([object()])})
        for message in (b"\xff" * 8, b"\x02" + bytes(7) + b"{}", b"\x05" + bytes(7) + b"{}"):
            file.seek(0)
            file.truncate()
            file.write(message)
            file.seek(0)
            with pytest.raises(wire.Broken):
                wire.receive(file)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs a named pipe")
def test_a_parser_that_grows_is_ended_by_the_parent_where_it_cannot_limit_itself(
    tmp_path: Path, npz: Path, parsers: process.Parsers, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on macOS: 50 MB come out of a pipe that then stays open, 20 MB more than at the beginning are allowed."""
    parsers.call("npz", npz, {})
    if not memory.resident(os.getpid()):
        pytest.skip("this system does not tell how much memory a process holds")
    monkeypatch.setattr(process, "WATCHED", True)
    monkeypatch.setattr(limits, "MEMORY", 20 << 20)
    os.mkfifo(tmp_path / "grows.gz")
    release = threading.Event()

    def feed() -> None:
        with suppress(BrokenPipeError), (tmp_path / "grows.gz").open("wb") as pipe:
            pipe.write(gzip.compress(bytes(50 << 20)))
            pipe.flush()
            release.wait(60)

    feeder = threading.Thread(target=feed)
    feeder.start()
    try:
        with pytest.raises(process.ParserError, match="more memory than a file of its size should"):
            parsers.call("gzip", tmp_path / "grows.gz", {})
    finally:
        release.set()
        feeder.join()
    assert parsers.call("npz", npz, {})["left"] == {}


class Kernel:
    """Stands for kernel32: keeps what it is called with, and says that 1 GB is committed."""

    def __init__(self, refusing: str = "") -> None:
        self.limits: list[tuple[int, int, int]] = []
        for name in ("GetCurrentProcess", "CreateJobObjectW", "AssignProcessToJobObject"):
            setattr(self, name, self._function(0 if name == refusing else 7))
        self.K32GetProcessMemoryInfo = self._commit
        self.SetInformationJobObject = self._set

    def _function(self, value: int):
        def function(*arguments: object) -> int:
            return value

        return function

    def _commit(self, handle: object, counters, size: ctypes.c_uint32) -> int:
        assert size.value == 72  # PROCESS_MEMORY_COUNTERS of 64 bits; PagefileUsage is its ninth field, at 56
        ctypes.c_size_t.from_address(ctypes.addressof(counters._obj) + 56).value = 1 << 30
        return 1

    def _set(self, job: ctypes.c_void_p, kind: int, limits_, size: ctypes.c_uint32) -> int:
        assert job.value == 7 and kind == 9 and size.value == 144
        at = ctypes.addressof(limits_._obj)  # LimitFlags stand at 16, ProcessMemoryLimit at 112
        flags, most = ctypes.c_uint32.from_address(at + 16).value, ctypes.c_size_t.from_address(at + 112).value
        self.limits.append((kind, flags, most))
        return 1


@pytest.mark.skipif(ctypes.sizeof(ctypes.c_void_p) != 8, reason="offsets of 64 bits")
def test_a_job_object_bounds_what_a_process_commits_beyond_what_it_has() -> None:
    """Offsets and codes are those of winnt.h (JOBOBJECT_EXTENDED_LIMIT_INFORMATION, JOB_OBJECT_LIMIT_PROCESS_MEMORY)."""
    kernel = Kernel()
    job = memory.Job(kernel)
    job.limit(512 << 20)
    job.lift()
    assert kernel.limits == [(9, 0x100, (1 << 30) + (512 << 20)), (9, 0, 0)]
    for refused in ("CreateJobObjectW", "AssignProcessToJobObject"):
        with pytest.raises(OSError, match=refused):
            memory.Job(Kernel(refused))


def test_the_resident_size_is_taken_from_what_libproc_fills_in() -> None:
    """PROC_PIDTASKINFO is 4 and fills 96 bytes; the second of them, at 8, is pti_resident_size (sys/proc_info.h)."""

    def proc_pidinfo(process_: int, flavor: int, argument: object, about, size: int) -> int:
        assert (process_, flavor, size) == (12, 4, 96)
        ctypes.c_uint64.from_address(ctypes.addressof(about._obj) + 8).value = 123_456
        return 96

    assert memory.resident_by(proc_pidinfo, 12) == 123_456
    assert memory.resident_by(lambda *_: 0, 12) == 0
