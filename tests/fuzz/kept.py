"""Inputs that once failed, kept as files in ``kept/``: what each must end in, and whether it still does."""

import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from acquisition.files import matrices
from ema.errors import EmaError
from tests.fuzz import frd
from tests.fuzz.cases import Reading, channels, reading
from tests.fuzz.uff_model import contents_of

KEPT = Path(__file__).parent / "kept"


def _read(path: Path) -> Reading:
    if path.suffix in (".mtx", ".hb"):
        try:
            matrices.read_matrix(path)
        except EmaError as error:
            return Reading(refusal=str(error))
        return Reading()
    if path.suffix in (".frd", ".rst"):
        return reading(path, frd.contents_of, unit="m")
    return reading(path, contents_of if path.suffix == ".unv" else channels)


def _count(one: Reading, what: str) -> int:
    """How many signals of a kind there are; of a mode its pole and its values at every node."""
    return sum(name.startswith(what) for name in one.signals)


def _moves(one: Reading, node: int, *expected: float) -> bool:
    """Whether a node moves so in the lowest of two modes."""
    return np.allclose(one.signals[f"mode at 12.3456789, node {node}"][1], expected, rtol=1e-9)


EXPECTED: dict[str, Callable[[Reading], bool]] = {
    # two coordinates of a node touch, and the end of one had been read as a whole number
    "coordinates-that-touch.unv": lambda one: one.named == 2 and _count(one, "node ") == 0,
    # one FRF of two holds the number -3.216689-01; it vanished without a word
    "number-without-exponent.uff": lambda one: one.named == 1 and len(one.signals) == 1,
    # the last number of a text is cut from -1.317660708129e+00 to -1
    "last-number-cut.uff": lambda one: one.named == 1 and len(one.signals) == 1,
    # seven bytes lost: the closing line was read as values, the next opening line as the closing one
    "end-eaten.uff": lambda one: one.named >= 1 and "1:+Z/99:+Z" not in one.signals and len(one.signals) == 1,
    # the sign of an exponent is lost, and the end of the last line
    "sign-of-an-exponent.uff": lambda one: "an exponent without its sign" in one.refusal,
    # a form feed in the place of the first digit: 3.51274e-02 was read as .51274e-02
    "form-feed-of-a-number.uff": lambda one: one.named == 1 and len(one.signals) == 2,
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
    # a byte in front of the number of points that Python takes for a blank; another changes the entity of the DOF
    "blank-of-the-points.uff": lambda one: one.named == 1 and len(one.signals) == 2,
    # the last number of a line cut away between two full lines, in a function of three lines
    "line-cut.uff": lambda one: one.named == 1 and len(one.signals) == 1,
    # a time record whose type became that of a coherence
    "coherence.uff": lambda one: one.named == 1 and len(one.signals) == 1,
    # FRFs in text: a frequency line lost from an axis that is even but for it
    "frequency-line-lost.txt": lambda one: one.named == 1 and len(one.signals) == 1,
    "frequency-line-lost.csv": lambda one: one.named == 1 and len(one.signals) == 1,
    # the mark between the real and the imaginary column became a letter, and both were one imaginary number
    "mark-became-j.txt": lambda one: "a complex number in a column of real ones" in one.refusal,
    # the first number of the first row is none: the row was taken for a line of the header
    "first-row-damaged.txt": lambda one: "a row that holds no numbers" in one.refusal,
    # a zero byte within it, and a blank in place of the second tab
    "first-row-in-noise.txt": lambda one: "a row that holds no numbers" in one.refusal,
    # a cell behind the last tab of a row: all rows from there on were lost
    "row-of-four-cells.txt": lambda one: "another number of cells" in one.refusal,
    # geometry and modes: the title of a trace line lost, so that its nodes were taken for it
    "trace-line-without-title.unv": lambda one: one.named == 1 and _count(one, "line") == 1,
    # all elements behind a blank record were lost
    "blank-element.unv": lambda one: one.named == 1 and _count(one, "face") == 0,
    # the last coordinate of a node cut short; a line within one, which Python takes for a mark between digits
    "coordinate-cut.unv": lambda one: one.named >= 1 and _count(one, "node") == 0,
    "line-in-a-coordinate.unv": lambda one: one.named >= 1 and _count(one, "node") == 0,
    # all nodes of a shape behind a blank one were lost
    "blank-node.unv": lambda one: one.named == 1 and _count(one, "mode") == 1 + 3,
    # a data type that does not exist: real and imaginary parts were taken for the values of three directions
    "data-type-7.unv": lambda one: one.named == 1 and _count(one, "mode") == 1 + 3,
    "shape-cut.unv": lambda one: one.named == 1 and _count(one, "mode") == 1 + 3,
    # a digit more than the other coordinates have, and an exponent without its sign; a digit less; an exponent cut
    "digit-more.unv": lambda one: one.named == 2 and _count(one, "node") == 0 and _count(one, "mode") == 1 + 7,
    "digit-less.unv": lambda one: one.named >= 1 and _count(one, "node") == 0,
    "exponent-cut.unv": lambda one: one.named == 1 and _count(one, "mode") == 1 + 3,
    # five bytes of a trace line lost: its first node became 0, which lifts the pen
    "nodes-off-their-columns.unv": lambda one: one.named == 1 and _count(one, "line") == 1,
    # an end and a beginning on one line: the next data set vanished in the one of the units
    "set-swallowed.unv": lambda one: one.named == 1 and _count(one, "node") == 0,
    # a blank and a sign lost between two numbers, which were read without the sign
    "sign-of-a-shape.unv": lambda one: one.named == 1 and _count(one, "mode") == 1 + 6,
    # the first digit of modal A lost: it became 0, and all modes lost their scale
    "modal-a-cut.unv": lambda one: one.named == 1 and _count(one, "mode") == 1 + 3,
    # the last node blanked: the set holds no count, and the blank record was taken for none
    "blank-last-node.unv": lambda one: one.named == 1 and _count(one, "node") == 6,
    # the node of a response lost with the bytes that keep its columns: it became node 0
    "node-lost.uff": lambda one: one.named >= 1 and "0:-Z" not in one.signals,
    # a non-breaking space in the place of a sign: -0.196205 was read as 0.196205
    "space-for-a-sign.lvm": lambda one: "a row is no numbers" in one.refusal,
    # the title of a channel lost; the tab behind the title of the times, which became a channel
    "title-lost.lvm": lambda one: one.named == 1 and len(one.signals) == 2,
    "title-of-the-times.lvm": lambda one: "other time columns" in one.refusal,
    # the first row of the table stands in front of the titles
    "row-before-titles.csv": lambda one: "in front of its titles" in one.refusal,
    # the mark between two numbers of the first row became another byte: the row vanished in the header
    "first-mark-lost.csv": lambda one: "holds no numbers" in one.refusal,
    # a second delimiter in the last row but one: both rows vanished
    "delimiter-twice.csv": lambda one: "a row of 4 cells" in one.refusal,
    # the last digit of a row became a delimiter, which was taken for one that closes the row
    "digit-tab.csv": lambda one: "a row of 4 cells" in one.refusal,
    # the mark behind the first number of the last row became a letter: the row had been taken for one with a name
    "letter-for-a-mark.csv": lambda one: "begins with a damaged number" in one.refusal,
    # rows that are none: in front of, within and behind the table
    "first-row.csv": lambda one: "holds no numbers" in one.refusal,
    # the first row was broken in two, and its beginning passed for a line of titles
    "first-row-in-two.csv": lambda one: "holds no numbers" in one.refusal,
    # damaged in two places, so that none of its cells is a number; it begins with the frequency one step before the next
    "first-row-twice-hit.csv": lambda one: "holds no numbers" in one.refusal,
    "two-rows.csv": lambda one: "holds no numbers" in one.refusal,
    "last-row.csv": lambda one: "begins with no number" in one.refusal,
    # both rows at the end are none, and the last begins with what could be its name
    "two-rows-damaged.csv": lambda one: "holds no numbers" in one.refusal,
    # a digit became the letter d, which Fortran writes for an exponent, but never without a sign: 0.0109001 was 0.1
    "digit-d.csv": lambda one: "holds no numbers" in one.refusal,
    "digit-d-2.csv": lambda one: "holds no numbers" in one.refusal,
    "behind.csv": lambda one: "holds no numbers" in one.refusal,
    # a carriage return between two of the sizes, which not all parsers take for a blank
    "return-between-sizes.mtx": lambda one: "damaged Matrix Market file" in one.refusal,
    "form-feed-in-the-banner.mtx": lambda one: "damaged Matrix Market file" in one.refusal,
    # 0.565x56 was read as 0.565; two entries on one line; a header line that is blank
    "number.mtx": lambda one: "no entry" in one.refusal,
    "two-on-a-line.mtx": lambda one: "no entry" in one.refusal,
    "blank-header.hb": lambda one: bool(one.refusal),
    "control-for-a-sign.hb": lambda one: "a control character" in one.refusal,
    "shifted.hb": lambda one: bool(one.refusal),
    # one row index of a symmetric matrix is another: its entry fell into the other triangle, and no mirror was made
    "entry-beyond-the-diagonal.hb": lambda one: "wrong side of the diagonal" in one.refusal,
    # the digit before a point became a blank
    "first-digit-lost.hb": lambda one: "lost its first digit" in one.refusal,
    # an E became a D, and what had become of a digit elsewhere was read
    "exponent-letter.hb": lambda one: "with E and with D" in one.refusal,
    # the last digit of an exponent became a blank
    "exponent-cut.hb": lambda one: "does not end where its field does" in one.refusal,
    # displacements: the line of a node lost, which became 0; D1 and D2 exchanged in the list of components
    "row-lost.frd": lambda one: "expected node 4 of 4" in one.refusal,
    "components-exchanged.frd": lambda one: "record -5 of a component" in one.refusal,
    # three nodes announced, and four are there; a digit lost, and a blank put in behind the number
    "count-of-nodes.frd": lambda one: "no end behind 3 nodes" in one.refusal,
    "column-shifted.frd": lambda one: "expected node 3 of 4" in one.refusal,
    # the first mode lost whole, doubled whole, and without the record of its step
    "mode-lost.frd": lambda one: "results are missing or stand twice" in one.refusal,
    "mode-doubled.frd": lambda one: "two displacements of one mode" in one.refusal,
    "step-lost.frd": lambda one: "the number of a step is missing" in one.refusal,
    # a digit of a frequency, which its stiffness tells as well
    "frequency.frd": lambda one: "contradicts the stiffness" in one.refusal,
    # valid: a static step in front of a mode, which was taken for a mode at 1 Hz; a node without results, which was at rest
    "static-step.frd": lambda one: _count(one, "mode") == 1 + 4,
    "nodes-without-results.frd": lambda one: _count(one, "mode") == 2 * (1 + 3) and _count(one, "node") == 4,
    # displacements by another name vanished; so did those behind which the head of the stresses was swallowed
    "field-renamed.frd": lambda one: "displacements of a mode by another name" in one.refusal,
    "parameters-swallowed.frd": lambda one: "a record of parameters" in one.refusal,
    # the end within binary elements
    "binary-cut.frd": lambda one: "ends within binary data" in one.refusal,
    # valid: directions Y, Z, X, which were taken for X, Y, Z; a node without results, which got those of another
    "directions.rst": lambda one: _moves(one, 3, 0.7622597120847118, -0.6414703941072214, 2.000416546342423),
    "node-without-results.rst": lambda one: _count(one, "mode") == 2 * (1 + 3) and _count(one, "node") == 4,
    # valid: a node with axes of its own that has no third direction; the number that says so was turned with the others
    "absent-and-turned.rst": lambda one: _moves(one, 5, -1.022233352179296, -0.5915779146234558, 0.22118111059743722),
    # a displacement is NaN, which became 0; the second direction of a set is none, and moved by 0
    "nan.rst": lambda one: "mode 2: a displacement is NaN" in one.refusal,
    "direction-of-a-set.rst": lambda one: "other degrees of freedom" in one.refusal,
    # three sets of results of which two are announced
    "fewer-sets.rst": lambda one: "number of sets of results contradicts" in one.refusal,
    # SHELL181 with the number 182; a shell of four nodes with the type of a brick, which was drawn with a corner many times
    "routine-number.rst": lambda one: "another name than number" in one.refusal,
    "type-of-a-shell.rst": lambda one: one.named == 1 and _count(one, "face") == 0,
}
"""What must be made of each file."""


def replay() -> Iterator[tuple[str, str]]:
    """The kept files, each with what is wrong, if anything."""
    with tempfile.TemporaryDirectory() as folder:
        for name, fits in EXPECTED.items():
            shutil.copy(KEPT / name, folder)
            made = _read(Path(folder) / name)
            yield name, "" if fits(made) else f"{len(made.signals)} signals, {made.named} named, {made.refusal!r}"
