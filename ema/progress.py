"""Progress is an injected callback; silent by default, and the way to cancel long work."""

from typing import Protocol, runtime_checkable

from ema.errors import CancelledError


@runtime_checkable
class Progress(Protocol):
    """Called as ``progress(what, done, total)``; returning ``False`` cancels the work."""

    def __call__(self, what: str, done: int, total: int) -> bool | None:
        """Report; ``False`` cancels."""
        ...


def silent(what: str, done: int, total: int) -> None:
    """Report nothing, never cancel."""


def advance(progress: Progress, what: str, done: int, total: int) -> None:
    """Tell ``progress`` how far the work is.

    Raises
    ------
    CancelledError : the callback returned ``False``.
    """
    if progress(what, done, total) is False:
        raise CancelledError("cancelled", where=what, got=f"{done} of {total} steps done")


def note(progress: Progress, sentence: str) -> None:
    """Pass a sentence about the work to a ``progress`` that takes them, by a method ``note``; others stay silent."""
    take = getattr(progress, "note", None)
    if take is not None:
        take(sentence)
