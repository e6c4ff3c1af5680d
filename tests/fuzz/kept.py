"""Inputs that once failed, kept as files in ``kept/``: what each must end in, and whether it still does."""

import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from acquisition.files import matrices
from ema.errors import EmaError
from tests.fuzz.cases import Reading, channels, reading

KEPT = Path(__file__).parent / "kept"


def _read(path: Path) -> Reading:
    if path.suffix in (".mtx", ".hb"):
        try:
            matrices.read_matrix(path)
        except EmaError as error:
            return Reading(refusal=str(error))
        return Reading()
    return reading(path, channels)


EXPECTED: dict[str, Callable[[Reading], bool]] = {
    # one FRF of two holds the number -3.216689-01; it vanished without a word
    "number-without-exponent.uff": lambda one: one.named == 1 and len(one.signals) == 1,
    # the last number of a text is cut from -1.317660708129e+00 to -1
    "last-number-cut.uff": lambda one: one.named == 1 and len(one.signals) == 1,
    # seven bytes lost: the closing line was read as values, the next opening line as the closing one
    "end-eaten.uff": lambda one: one.named >= 1 and "1:+Z/99:+Z" not in one.signals and len(one.signals) == 1,
    # no closing line: the next set was lost
    "no-end.uff": lambda one: one.named == 1 and len(one.signals) == 2,
    # the file ends behind an opening line
    "opened-only.uff": lambda one: one.named == 1 and len(one.signals) == 2,
    # a zero byte in front of a number
    "zero-byte.uff": lambda one: one.named == 1 and len(one.signals) == 1,
    # the direction of a DOF is blank
    "no-direction.uff": lambda one: one.named == 1 and len(one.signals) == 2,
    # the sign of a direction is another byte, which Python takes for a blank
    "sign-of-a-direction.uff": lambda one: one.named == 1 and len(one.signals) == 1,
    # a byte in front of the number of a node that Python takes for a blank; a value of the next function is changed
    "blank-of-a-node.uff": lambda one: one.named == 1 and len(one.signals) == 2,
    # the same in the node of the reference
    "blank-of-a-reference.uff": lambda one: "is no number" in one.refusal,
    # the last number of a line cut away between two full lines, in a function of three lines
    "line-cut.uff": lambda one: one.named == 1 and len(one.signals) == 1,
    # rows that are none: in front of, within and behind the table
    "first-row.csv": lambda one: "holds no numbers" in one.refusal,
    "two-rows.csv": lambda one: "holds no numbers" in one.refusal,
    "last-row.csv": lambda one: "begins with no number" in one.refusal,
    "behind.csv": lambda one: "holds no numbers" in one.refusal,
    # 0.565x56 was read as 0.565; two entries on one line; a header line that is blank
    "number.mtx": lambda one: "no entry" in one.refusal,
    "two-on-a-line.mtx": lambda one: "no entry" in one.refusal,
    "blank-header.hb": lambda one: bool(one.refusal),
    "shifted.hb": lambda one: bool(one.refusal),
}
"""What must be made of each file."""


def replay() -> Iterator[tuple[str, str]]:
    """The kept files, each with what is wrong, if anything."""
    with tempfile.TemporaryDirectory() as folder:
        for name, fits in EXPECTED.items():
            shutil.copy(KEPT / name, folder)
            made = _read(Path(folder) / name)
            yield name, "" if fits(made) else f"{len(made.signals)} signals, {made.named} named, {made.refusal!r}"
