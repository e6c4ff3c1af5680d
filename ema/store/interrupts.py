"""Keep Ctrl-C out of the HDF5 library, which would lose a write to it and go on as if nothing had happened."""

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType


@contextlib.contextmanager
def deferred() -> Iterator[None]:
    """Hold back SIGINT and SIGTERM while the block runs; their handlers are called at its end.

    Python runs handlers in the main thread only, so elsewhere there is nothing to hold back. A signal without a handler
    of Python's ends the process as ever, which leaves the former file intact.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    caught: list[tuple[int, FrameType | None]] = []
    handlers = {int(number): signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    former = {number: handler for number, handler in handlers.items() if callable(handler)}
    try:
        for number in former:
            signal.signal(number, lambda number, frame: caught.append((number, frame)))
        yield
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
    for number, frame in caught:
        former[number](number, frame)
