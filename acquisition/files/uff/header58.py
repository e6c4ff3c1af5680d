"""The header of data set 58, function at a nodal DOF (I-DEAS universal file format)."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

_CONTROL = re.compile(rb"[\0-\x08\x0e-\x1f]")
"""What no text holds; a conversion to numbers may skip it, and with it the sign that it replaced."""
FUNCTION_TYPES = {
    0: "general",
    1: "time response",
    2: "auto spectrum",
    3: "cross spectrum",
    4: "frequency response function",
    5: "transmissibility",
    6: "coherence",
    7: "auto correlation",
    8: "cross correlation",
    9: "power spectral density",
    10: "energy spectral density",
    11: "probability density",
    12: "spectrum",
    18: "mode indicator function",
    26: "multiple coherence",
    27: "order function",
}
QUANTITY_CODES = {
    2: "pressure",
    3: "strain",
    5: "temperature",
    8: "displacement",
    9: "force",
    11: "velocity",
    12: "acceleration",
    13: "force",
    15: "pressure",
    17: "time",
    18: "frequency",
}
"""Specific data types of an axis that say what it measures (stress counts as a pressure)."""
TIME, FRF, COHERENCE, MULTIPLE_COHERENCE = 1, 4, 6, 26
"""Function types of data set 58, record 6 field 1 (universal file format): time response, FRF, coherence, multiple
coherence."""
RECORDS = 11
"""Lines of the header behind the line with the set's number."""


@dataclass(frozen=True)
class Axis:
    """What an axis holds: specific data type, exponents of length, force and temperature, label, unit label."""

    code: int = 0
    exponents: tuple[int, int, int] = (0, 0, 0)
    label: str = "NONE"
    unit: str = "NONE"

    @property
    def quantity(self) -> str:
        """What the specific data type says."""
        return QUANTITY_CODES.get(self.code, "unstated")


@dataclass(frozen=True)
class Point:
    """Entity (component), node and direction code."""

    entity: str = "NONE"
    node: int = 0
    direction: int = 0


@dataclass(frozen=True)
class Header:
    """All that data set 58 says in front of its values.

    ``kind`` is the ordinate data type: 2 and 4 real, 5 and 6 complex, single and double precision.
    """

    ids: tuple[str, ...] = ("NONE",) * 5
    function: int = 0
    identification: int = 0
    version: int = 0
    load_case: int = 0
    response: Point = Point()
    reference: Point = Point()
    kind: int = 4
    points: int = 0
    even: bool = True
    start: float = 0.0
    step: float = 0.0
    z: float = 0.0
    abscissa: Axis = Axis()
    ordinate: Axis = Axis()
    denominator: Axis = Axis()
    third: Axis = Axis()
    binary: bool = False
    byte_order: int = 1
    float_format: int = 2
    undirected: bool = False
    """Whether a DOF has a node and a blank where its direction should be."""
    step_digits: int = 6
    """Significant digits with which the step is written: its precision."""

    @property
    def is_complex(self) -> bool:
        """Whether the ordinate is complex."""
        return self.kind in (5, 6)

    @property
    def double(self) -> bool:
        """Whether the ordinate has double precision."""
        return self.kind in (4, 6)

    @property
    def title(self) -> str:
        """What kind of function it is."""
        return FUNCTION_TYPES.get(self.function, f"function of type {self.function}")


def text_of(raw: bytes) -> str:
    """Text of a line; single bytes that are no ASCII are Latin-1, so that the columns stay in place."""
    return raw.decode("latin-1").rstrip("\r\n")


def mended(text: str) -> str:
    """A field whose UTF-8 bytes were read as Latin-1, as text."""
    if text.isascii():
        return text.strip()
    try:
        return text.encode("latin-1").decode("utf-8").strip()
    except UnicodeError:
        return text.strip()


def integer(line: str, start: int, stop: int, default: int = 0) -> int:
    """The integer in columns ``start`` to ``stop`` of a line."""
    field = _number_field(line, start, stop)
    return int(field) if field else default


def real(line: str, start: int, stop: int) -> float:
    """The real number in columns ``start`` to ``stop`` of a line, with E or D exponent."""
    field = _number_field(line, start, stop)
    return float(field.replace("D", "E").replace("d", "e")) if field else 0.0


def _number_field(line: str, start: int, stop: int) -> str:
    """A field of a number without its blanks; Python takes further bytes for blanks, and lines between digits."""
    field = line[start:stop]
    if not field.isascii() or "_" in field:
        raise ValueError(f"{field!r} is no number")
    return field.strip()


def parse(number_line: bytes, records: Sequence[bytes]) -> Header:
    """The header from the line with the number and the eleven lines behind it.

    Raises
    ------
    ValueError : a field is no number, or the header cannot be one of a data set 58.
    """
    if any(_CONTROL.search(raw) for raw in records[5:]):
        raise ValueError("a control character among its fields")
    lines = [text_of(raw) for raw in records]
    first = text_of(number_line)
    binary = first[6:7].lower() == "b"
    dof, form = lines[5], lines[6]
    # the columns of the format hold, where its integers end with them: the next number may follow without a blank
    aligned = re.match(r"^ *\d+ +\d+ +-?\d+$", form[:30]) and form[9:30:10].isdigit()
    shape = None if aligned else re.match(r"^\s*(\d+)\s+(\d+)\s+(-?\d+)(?=\s|$|[-.])", form, re.ASCII)
    header = Header(
        ids=tuple(mended(line) for line in lines[:5]),
        function=integer(dof, 0, 5),
        identification=integer(dof, 5, 15),
        version=integer(dof, 15, 20),
        load_case=integer(dof, 20, 30),
        response=Point(mended(dof[30:41]), integer(dof, 41, 51), integer(dof, 51, 55)),
        reference=Point(mended(dof[55:66]), integer(dof, 66, 76), integer(dof, 76, 80)),
        kind=integer(form, 0, 10) if shape is None else int(shape[1]),
        points=integer(form, 10, 20) if shape is None else int(shape[2]),
        even=(integer(form, 20, 30) if shape is None else int(shape[3])) == 1,
        start=real(form, 30, 43),
        step=real(form, 43, 56),
        z=real(form, 56, 69),
        undirected=any(
            dof[node:code].strip(" 0") and not dof[code : code + 4].strip() for node, code in ((41, 51), (66, 76))
        ),
        step_digits=_digits(form[43:56]),
        abscissa=_axis(lines[7]),
        ordinate=_axis(lines[8]),
        denominator=_axis(lines[9]),
        third=_axis(lines[10]),
        binary=binary,
    )
    if binary:
        header = replace(header, byte_order=integer(first, 7, 13, 1), float_format=integer(first, 13, 19, 2))
    if not dof[:5].strip() or dof[80:].strip():
        raise ValueError("the record of its DOFs does not keep to its columns")
    if not dof[41:51].strip() or (header.function == FRF and not dof[66:76].strip()):
        raise ValueError("the number of a node is missing")  # where there is none, a 0 stands there
    if len(form.rstrip()) < 56:
        raise ValueError("the record of its axis ends too early")  # within the step, of which digits would be lost
    if header.kind not in (2, 4, 5, 6):
        raise ValueError(f"ordinate data type {header.kind} is none of 2, 4, 5, 6")
    if header.points < 1:
        raise ValueError(f"{header.points} values")
    if binary and (header.float_format != 2 or header.byte_order not in (1, 2)):
        raise ValueError(f"floating point format {header.float_format}, byte order {header.byte_order} (not IEEE)")
    return header


def _digits(field: str) -> int:
    mantissa = re.split(r"[EeDd]", field.strip())[0]
    return max(1, sum(c.isdigit() for c in mantissa))


@lru_cache(maxsize=256)
def _axis(line: str) -> Axis:
    exponents = (integer(line, 10, 15), integer(line, 15, 20), integer(line, 20, 25))
    return Axis(integer(line, 0, 10), exponents, mended(line[25:46]) or "NONE", mended(line[46:67]) or "NONE")


def render(header: Header, values: int) -> bytes:
    """The header as bytes; ``values`` is the number of bytes that follow in binary form."""
    first = f"{58:6d}"
    if header.binary:
        first += f"b{header.byte_order:6d}{header.float_format:6d}{RECORDS:12d}{values:12d}{0:6d}{0:6d}{0:12d}{0:12d}"
    ids = [(identity.replace("\n", " ") or "NONE")[:80] for identity in header.ids]
    points = [f" {p.entity[:10]:<10}{p.node:10d}{p.direction:4d}" for p in (header.response, header.reference)]
    dof = f"{header.function:5d}{header.identification:10d}{header.version:5d}{header.load_case:10d}" + "".join(points)
    start, step = (header.start, header.step) if header.even else (0.0, 0.0)
    form = f"{header.kind:10d}{header.points:10d}{int(header.even):10d}{_e13(start)}{_e13(step)}{_e13(header.z)}"
    axes = [
        f"{axis.code:10d}"
        + "".join(f"{power:5d}" for power in axis.exponents)
        + f" {axis.label[:20]:<20} {axis.unit[:20]:<20}"
        for axis in (header.abscissa, header.ordinate, header.denominator, header.third)
    ]
    lines = [f"{-1:6d}", first, *(f"{identity:<80}" for identity in ids), dof, form, *axes]
    return "".join(line + "\n" for line in lines).encode("latin-1", errors="replace")


def _e13(value: float) -> str:
    """A number in 13 columns with the fewest digits that hold it exactly, at most eight."""
    for digits in (5, 6, 7):
        text = f"{value:.{digits}e}"
        if len(text) <= 13 and (float(text) == value or digits == 7):
            return f"{text:>13}"
    return f"{value:13.5e}"
