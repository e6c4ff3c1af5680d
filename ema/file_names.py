"""Names of files that every common disk keeps, and keeps apart."""

import hashlib
import re
import unicodedata

DEVICES = frozenset(
    {"con", "prn", "aux", "nul", *(f"{port}{number}" for port in ("com", "lpt") for number in range(10))}
)
"""What Windows keeps for devices, in every folder and with every suffix (Microsoft, "Naming Files, Paths, and
Namespaces")."""

_LONGEST = 80
"""Characters that are kept of a name: with a digest, a suffix and a folder it stays below the 255 bytes of a name and
the 260 characters of a path on Windows. Doubled, deep folders would not fit there; halved, long names are cut."""


def natural(text: str) -> list[tuple[int, str]]:
    """Sort key by which ``p2`` comes before ``p10``."""
    return [(int(part), "") if part.isdigit() else (0, part) for part in re.split(r"(\d+)", text)]


def folded(text: str) -> str:
    """Equal for names that some disk takes for one."""
    return unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", text).casefold())


def is_device(text: str) -> bool:
    """Whether Windows would take the name for a device, with or without a suffix."""
    return folded(text).partition(".")[0].strip() in DEVICES


def safe_name(text: str) -> str:
    """The name itself where it is safe in lower case, otherwise what can be kept of it with a digest of the whole.

    Two texts never get names that a disk takes for one, short of a collision of 48 bits.

    Examples
    --------
    >>> safe_name("beam_1"), safe_name("beam 1")
    ('beam_1', 'beam_1-2502f74ef868')
    """
    kept = re.sub(r"[^A-Za-z0-9_.-]", "_", text)[:_LONGEST].strip(".") or "_"
    # a text that looks like a name with a digest gets one of its own
    if kept == text and kept == kept.lower() and not is_device(text) and not re.search(r"-[0-9a-f]{12}$", text):
        return kept
    kept = f"_{kept}" if is_device(kept) else kept
    return f"{kept}-{hashlib.sha256(text.encode('utf-8', 'surrogatepass')).hexdigest()[:12]}"
