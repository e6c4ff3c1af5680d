"""The parent's side: one kept process of parsers, started when first needed, restarted after a crash."""

import atexit
import os
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any

from acquisition.isolated import memory, wire
from acquisition.isolated.limits import TOO_MUCH, Limits
from ema import errors
from ema.errors import FailureError, InputError

START_SECONDS = 120.0
"""Seconds for a process to begin or to load a package; a cold disk needs ten."""
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


WATCHED = sys.platform == "darwin"
"""Whether the parent watches the memory of the process: macOS has no limit that a process can set for itself."""


class _TooMuch(Exception):
    """The process grew beyond its memory."""


class ParserError(Exception):
    """A parser refuses a file in words of its own."""


class Parsers:
    """A process that parses files; calls from several threads wait for each other."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._owner = 0
        self._served = 0  # files that the process has parsed

    def call(self, task: str, path: Path, options: dict[str, Any]) -> Any:
        """The tree that a task makes of a file; see :func:`call`.

        A process that breaks down may have been damaged by an earlier file: then the file is parsed by a new one.
        """
        request = {"task": task, "path": str(path.absolute()), "options": options}
        limits = Limits.of(path)
        with self._lock:
            while True:
                process, used = self._running(), self._served > 0
                try:
                    reply = self._answer(process, request, limits)
                    break
                except (wire.Broken, OSError) as error:
                    status = self._ended()
                    if not used or status == -getattr(signal, "SIGXCPU", 0):
                        raise _crashed(status, path) from error
        return _result(reply)

    def _answer(self, process: "subprocess.Popen[bytes]", request: dict[str, Any], limits: Limits) -> dict[str, Any]:
        """The answer to a request.

        Raises
        ------
        Broken, OSError : the process crashed.
        InputError : it takes too long.
        ParserError : it grows beyond its memory.
        """
        try:
            wire.send(process.stdin, request)  # type: ignore[arg-type]
            reply = self._reply(process, START_SECONDS)
            if "ready" in reply:
                reply = self._parsed(process, limits)
        except TimeoutError as error:
            self._kill()
            raise InputError(
                "reading the file takes too long",
                where=request["path"],
                got=f"more than {error} s",
                advice="copy or export it again",
            ) from error
        except _TooMuch as error:
            self._kill()
            raise ParserError(TOO_MUCH) from error
        except (wire.Broken, OSError):
            raise
        except BaseException:  # interrupted inside a message: what follows in the stream is of no use
            self._kill()
            raise
        self._served += 1
        return dict(reply)

    def close(self) -> None:
        """End the process."""
        with self._lock:
            if self._owner == os.getpid():
                self._kill()

    def _running(self) -> "subprocess.Popen[bytes]":
        if self._process is not None and (self._owner != os.getpid() or self._process.poll() is not None):
            self._forget()
        if self._process is None:
            try:
                self._process = _begin()
            except OSError as error:
                raise _not_started(str(error)) from error
            self._owner = os.getpid()
            try:
                about = self._reply(self._process, START_SECONDS)
            except (wire.Broken, TimeoutError, OSError) as error:
                self._kill()
                raise _not_started(f"{sys.executable}: {error or 'no answer'}") from error
            if Path(about["package"]).resolve() != _package():
                self._kill()
                raise _not_started(f"it found another version at {about['package']}")
        return self._process

    def _parsed(self, process: "subprocess.Popen[bytes]", limits: Limits) -> Any:
        """The answer of the parser, its memory watched where it cannot limit itself."""
        if not WATCHED:
            return self._reply(process, limits.seconds)
        grown = threading.Event()

        def stop() -> None:
            grown.set()
            process.kill()

        with memory.watched(process.pid, limits.memory, stop):
            try:
                return self._reply(process, limits.seconds)
            except wire.Broken:
                if grown.is_set():
                    raise _TooMuch from None
                raise

    def _reply(self, process: "subprocess.Popen[bytes]", seconds: float) -> Any:
        """The next message.

        Raises
        ------
        TimeoutError : it takes longer; the process is killed.
        Broken : the process ended.
        """
        late = threading.Event()

        def stop() -> None:
            late.set()
            process.kill()

        timer = threading.Timer(seconds, stop)
        timer.daemon = True
        timer.start()
        try:
            return wire.receive(process.stdout)  # type: ignore[arg-type]
        except wire.Broken:
            if late.is_set():
                raise TimeoutError(f"{seconds:.0f}") from None
            raise
        finally:
            timer.cancel()

    def _ended(self) -> int | None:
        """Status of a process that crashed; the next file has a new one."""
        process = self._process
        assert process is not None
        with suppress(subprocess.TimeoutExpired):
            process.wait(5)
        status = process.poll()
        self._kill()
        return status

    def _kill(self) -> None:
        process = self._process
        self._forget()
        if process is not None:
            process.kill()
            with suppress(subprocess.TimeoutExpired):
                process.wait(5)

    def _forget(self) -> None:
        """Let go of the process: its streams are closed, and it ends where it is ours."""
        process, self._process, self._served = self._process, None, 0
        if process is not None:
            for stream in (process.stdin, process.stdout):
                with suppress(OSError, ValueError):
                    stream.close()  # type: ignore[union-attr]
            if self._owner != os.getpid():
                process.returncode = 0  # a child of the process that this one was forked from


def _crashed(status: int | None, path: Path) -> InputError:
    if status is not None and status < 0 and -status == getattr(signal, "SIGXCPU", 0):
        return InputError("reading the file takes too long", where=str(path), advice="copy or export it again")
    how = f"signal {signal.Signals(-status).name}" if status is not None and status < 0 else f"status {status}"
    return InputError(
        "the file is damaged: its reader broke down", where=str(path), got=how, advice="copy or export it again"
    )


def call(task: str, path: Path, **options: Any) -> Any:
    """What a parser of a foreign format makes of a file: a tree of dicts, lists, texts, numbers and arrays.

    Parameters
    ----------
    task : one of :data:`acquisition.isolated.worker.TASKS`.
    options : arguments of the task, of texts and numbers.

    Raises
    ------
    InputError : the parser crashed, or the file takes it too long.
    ParserError : the parser refuses the file; the text is the parser's own.
    OSError : the file cannot be read.
    FailureError : the process cannot be started.
    EmaError : as the task raises it.
    """
    return _PARSERS.call(task, path, options)


def _begin() -> "subprocess.Popen[bytes]":
    if not sys.executable:
        raise OSError("the interpreter does not know its own file")
    installed = [
        folder
        for folder in sys.path
        if os.path.basename(folder) in ("site-packages", "dist-packages") and os.path.isabs(folder)
    ]
    script = Path(__file__).absolute().with_name("__main__.py")
    return subprocess.Popen(
        [sys.executable, "-I", str(script), *installed],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, **dict.fromkeys(_THREADS, "1")},
        creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
    )


def _package() -> Path:
    return Path(__file__).resolve().parent.parent


def _not_started(why: str) -> FailureError:
    return FailureError(
        "the process that reads such files cannot be started",
        got=why,
        advice="run `ema doctor`, or reinstall friction-ema",
    )


def _result(reply: dict[str, Any]) -> Any:
    if "result" in reply:
        return reply["result"]
    if "error" in reply:
        fields = dict(reply["error"])
        kind = getattr(errors, fields.pop("type"), InputError)
        raise kind(fields.pop("what"), **{name: value for name, value in fields.items() if value})
    if reply.get("system"):
        raise OSError(reply["exception"])
    raise ParserError(reply["exception"])


_PARSERS = Parsers()
atexit.register(_PARSERS.close)
