"""How a command ends: one sentence on the error stream, and a status that scripts can use."""

import functools
import os
import sys
import tempfile
import traceback
from collections.abc import Callable
from typing import NoReturn, ParamSpec

from ema.errors import EmaError

FINE = 0
"""Exit status of a command with nothing to complain about."""
FINDINGS = 1
"""Findings above the limit, or an expectation missed."""
FAILURE = 3
"""A full disk, or a fault of ours; wrong use and bad input end with 2, as of `InputError` and the argument parser."""
INTERRUPTED = 130
"""Interrupted: 128 and the number of the signal, as shells count (POSIX)."""

P = ParamSpec("P")


def ends_well(command: Callable[P, int]) -> Callable[P, None]:
    """Turn what ``command`` returns or raises into an exit status; nobody but us ever sees a traceback."""

    @functools.wraps(command)
    def ended(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            status = command(*args, **kwargs)
            sys.stdout.flush()
        except EmaError as error:
            _end(str(error), error.exit_code)
        except KeyboardInterrupt:
            _end("interrupted", INTERRUPTED)
        except BrokenPipeError:
            # the reader of our output has left; what it has not read need not be flushed at the end
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            status = FINE
        except Exception as error:
            if is_interruption(error):
                _end("interrupted", INTERRUPTED)
            _end(_fault(error), FAILURE)
        raise SystemExit(status)

    return ended


def is_interruption(error: BaseException) -> bool:
    """Whether it is Ctrl-C within a call of a compiled library (h5py's attributes) that cannot hand it on as it is."""
    return isinstance(error, SystemError) and isinstance(error.__cause__ or error.__context__, KeyboardInterrupt)


def _end(sentence: str, status: int) -> NoReturn:
    print(f"ema: {sentence}", file=sys.stderr)
    raise SystemExit(status)


def _fault(error: Exception) -> str:
    """What to say about a fault of ours; the details go to a file, which a report should contain."""
    brief = (
        f"a fault in ema itself: {type(error).__name__}: {str(error).splitlines()[0] if str(error) else 'no message'}"
    )
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="ema-fault-", suffix=".txt", delete=False, encoding="utf-8"
        ) as file:
            traceback.print_exception(error, file=file)
    except OSError:
        return f"{brief}; please report it with the output of `ema doctor --json`"
    return f"{brief}; please report it with the output of `ema doctor --json` and the file {file.name}"
