"""Many of everything: channels and records of a universal file, files of a folder, connections of the server.

``python -m tests.bench.many`` prints seconds by the clock and of processor time (with those of the process of the
parsers) for each; ``connections`` alone prints those.
"""

import argparse
import os
import socket
import tempfile
import threading
import time
import wave
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

import acquisition
from acquisition.isolated.process import _PARSERS
from ema import store
from ema.app.connections import Reply, Server
from ema.data import Channel, Recording
from tests.bench import files
from tests.fuzz.uff import Function

CHANNELS, RECORDS, FILES, IDLE, ACTIVE = 10_000, 50_000, 2000, 2000, 200
HEAD = """
[campaign]
name = "many"
files = "raw"

[[channels]]
name = "a"
role = "reference"
unit = "N"
dof = "1:+Z"

[[channels]]
name = "b"
unit = "m/s^2"
dof = "2:+Z"

[[runs]]
id = "run"
files = "*"
"""


@contextmanager
def timed(name: str, what: str, *, publish: bool) -> Iterator[None]:
    """Print what a block took, and store it where it is to be published."""
    with files.Spent() as spent:
        yield
        _PARSERS.close()  # its processor time counts once it has ended
    print(f"{what}: {spent.clock:.1f} s, {spent.cpu:.1f} CPU s", flush=True)
    if publish:
        files.publish(name, what, vars(spent))


def universal_files(folder: Path, rng: np.random.Generator, publish: bool) -> None:
    """One record of many channels, and many records of one channel."""
    for binary in (False, True):
        form = "58b" if binary else "58"
        for count, what, samples in ((CHANNELS, "channels", 100), (RECORDS, "records", 20)):
            path = folder / f"{what}{form}.uff"
            nodes = range(1, count + 1) if what == "channels" else [1] * count
            with path.open("wb") as file:
                for number, node in enumerate(nodes):
                    values = rng.normal(size=samples)
                    file.write(Function(False, node, 3, 0.0, 0.001, values, True, binary, number + 1).bytes())
            with timed("many files", f"universal file ({form}), {count} {what}", publish=publish):
                contents = acquisition.read(path)
            there = [len(record.channels) for record in contents.recordings]
            assert sum(there) == count and not contents.findings, (there[:5], contents.findings[:2])


def _wave(path: Path, signals: Any) -> None:
    with wave.open(str(path), "wb") as file:
        file.setnchannels(2)
        file.setsampwidth(2)
        file.setframerate(1000)
        file.writeframes((1000 * signals.T).astype("<i2").tobytes())


def _universal(path: Path, signals: Any) -> None:
    sets = [Function(False, n + 1, 3, 0.0, 0.001, row, True, True, n + 1) for n, row in enumerate(signals)]
    path.write_bytes(b"".join(one.bytes() for one in sets))


def _table(path: Path, signals: Any) -> None:
    rows = (f"{n / 1000},{a:.5g},{b:.5g}" for n, (a, b) in enumerate(signals.T))
    path.write_text("t [s],a,b\n" + "\n".join(rows) + "\n", encoding="utf-8")


WRITERS: dict[str, Callable[[Path, Any], None]] = {
    "h5": lambda path, signals: store.save(path, Recording(signals, 1000.0, (Channel("a"), Channel("b")))),
    "uff": _universal,
    "csv": _table,
    "wav": _wave,
}


def folders(folder: Path, rng: np.random.Generator, publish: bool) -> None:
    """A campaign of many files, opened and every record read."""
    for kind, write in WRITERS.items():
        raw = folder / kind / "raw"
        raw.mkdir(parents=True)
        head = HEAD.replace('name = "a"', 'name = "channel 1"').replace('name = "b"', 'name = "channel 2"')
        (folder / kind / "campaign.toml").write_text(head if kind == "wav" else HEAD, encoding="utf-8")
        if kind == "uff":
            (folder / kind / "campaign.toml").write_text(HEAD.split("[[channels]]")[0] + HEAD[HEAD.index("[[runs]]") :])
        for number in range(FILES):
            write(raw / f"take_{number:04d}.{kind}", rng.normal(size=(2, 200)))
        with timed("many folders", f"folder of {FILES} files ({kind})", publish=publish):
            (run,) = acquisition.open_campaign(folder / kind).runs
            assert sum(record.signals.shape[1] == 200 for record in run.recordings) == FILES


def connections(publish: bool) -> None:
    """Idle connections, and active ones that all ask at once."""
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(max(soft, 6000), hard), hard))
    answer = b"HTTP/1.1 200 OK\r\nContent-Length: 1\r\n\r\n0"
    server = Server(("127.0.0.1", 0), lambda request: Reply([answer], close=False), lambda *_: Reply([answer]), dict)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    before, threads = _resident(), threading.active_count()
    idle = [socket.create_connection(server.server_address) for _ in range(IDLE)]
    active = [socket.create_connection(server.server_address, timeout=60) for _ in range(ACTIVE)]
    start, slowest, answered = time.monotonic(), 0.0, 0
    for one in active:
        one.sendall(b"GET / HTTP/1.1\r\nHost: x\r\n\r\n")
    for one in active:
        answered += one.recv(4096).endswith(b"0")
        slowest = time.monotonic() - start
    grown, more = (_resident() - before) / 1e6, threading.active_count() - threads
    print(
        f"{IDLE} idle and {ACTIVE} active connections: {answered} answered, the last after {slowest:.2f} s, "
        f"{grown:.0f} MB and {more} threads more"
    )
    if publish:
        figures = {"idle": IDLE, "active": ACTIVE, "answered": answered, "slowest": slowest}
        files.publish("many connections", "connections", {**figures, "grown": grown, "threads": more})
    for one in (*idle, *active):
        one.close()
    server.shutdown()
    server.server_close()


def _resident() -> int:
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.many", description=__doc__)
    parser.add_argument("what", nargs="?", choices=("files", "folders", "connections"))
    parser.add_argument("--publish", action="store_true", help="store the figures for docs/files.md")
    given = parser.parse_args()
    what, publish = given.what, given.publish
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as folder:
        if what in (None, "files"):
            universal_files(Path(folder), rng, publish)
        if what in (None, "folders"):
            folders(Path(folder), rng, publish)
    if what in (None, "connections"):
        connections(publish)


if __name__ == "__main__":
    main()
