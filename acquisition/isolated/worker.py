"""The process of the parsers: one request after the other, until its input ends."""

import os
import signal
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from acquisition.isolated import limits, wire
from ema.errors import EmaError

TASKS = {
    "gzip": "acquisition.files.sniff:unpacked",
    "hdf5": "acquisition.files.hdf5:tree",
    "market": "acquisition.files.matrices:entries",
    "matlab": "acquisition.files.matlab:tree",
    "mdf4": "acquisition.files.mdf4:channels",
    "npz": "acquisition.files.npy:members",
    "rst": "acquisition.files.finite_elements.rst_parser:modes",
    "tdms": "acquisition.files.tdms:channels",
    "wav": "acquisition.files.wav:samples",
    "xlsx": "acquisition.files.xlsx:cells",
}
"""What can be asked for; nothing else is imported or called."""


def serve(package: str, version: str) -> None:
    """Answer requests ``{"task", "path", "options"}`` from the standard input until it ends.

    Each gets ``{"ready": True}`` when its module is loaded, from when on the limits hold, and then
    ``{"result": tree}``, ``{"error": fields of an EmaError}`` or ``{"exception": text}``.

    Parameters
    ----------
    package : the foreign package that the tasks need; it is named in the first message.
    version : version of it that is installed, likewise.
    """
    source, sink = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_RDWR)
    for number in (0, 1, 2):  # what a package prints must not end up between the messages
        os.dup2(nowhere, number)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which ends this process
    if os.name == "nt":
        import msvcrt

        for file in (source, sink):
            msvcrt.setmode(file.fileno(), os.O_BINARY)  # type: ignore[attr-defined]
    wire.send(sink, {"package": package, "version": version})
    while True:
        try:
            request = wire.receive(source)
        except wire.Broken:
            return
        try:
            _answer(request, sink)
        except BrokenPipeError:
            return


def _answer(request: dict[str, Any], sink: Any) -> None:
    try:
        parse = _loaded(TASKS[request["task"]])
        wire.send(sink, {"ready": True})
        path = Path(request["path"])
        try:
            limits.apply(limits.Limits.of(path))
            result = parse(path, **request["options"])
        finally:
            limits.lift()
        wire.send(sink, {"result": result})
    except BrokenPipeError:
        raise
    except EmaError as error:
        fields = {name: getattr(error, name) for name in ("what", "where", "got", "expected", "advice")}
        fields = {name: None if value is None else str(value) for name, value in fields.items()}
        wire.send(sink, {"error": {"type": type(error).__name__, **fields}})
    except MemoryError:
        wire.send(sink, {"exception": limits.TOO_MUCH, "system": False})
    except OSError as error:
        wire.send(sink, {"exception": error.strerror or str(error), "system": error.errno is not None})
    except Exception as error:
        lines = (str(error) or type(error).__name__).splitlines()
        wire.send(sink, {"exception": lines[0][:300], "system": False})


def _loaded(place: str) -> Callable[..., Any]:
    module, _, name = place.partition(":")
    found: Callable[..., Any] = getattr(import_module(module), name)
    return found


if __name__ == "__main__":
    sys.exit("begin this process with its folder, see acquisition.isolated.__main__")
