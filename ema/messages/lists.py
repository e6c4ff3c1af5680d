"""Several words as one."""

from collections.abc import Sequence

from ema.messages.translation import text


def listed(words: Sequence[str]) -> str:
    """``1``, ``1 and 2``, ``1, 2 and 3``, in the language that is spoken."""
    if len(words) < 2:
        return "".join(words)
    return text("{first} and {last}", first=", ".join(words[:-1]), last=words[-1])
