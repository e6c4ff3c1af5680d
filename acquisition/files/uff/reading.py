"""Read a universal file: list its sets, fetch its functions, make containers of all of it."""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from io import BytesIO
from os import PathLike
from pathlib import Path

from acquisition import units
from acquisition.contents import Contents
from acquisition.files import sniff
from acquisition.files.layout import Layout
from acquisition.files.suppressed_warnings import suppressed_warnings
from acquisition.files.uff import geometry_sets, header58, mode_sets, values58
from acquisition.files.uff.functions import Damaged, gather
from acquisition.files.uff.header58 import mended, text_of
from acquisition.files.uff.index import ByteFile, Entry, index
from acquisition.files.uff.unit_system import UnitSystem, parse164
from acquisition.files.uff.values58 import Function
from ema.data import Finding
from ema.errors import InputError

_GEOMETRY: dict[int, Callable[[geometry_sets.Parts, list[bytes]], None]] = {
    15: geometry_sets.nodes15,
    18: geometry_sets.systems18,
    82: geometry_sets.lines82,
    2411: geometry_sets.nodes2411,
    2412: geometry_sets.elements2412,
    2420: geometry_sets.systems2420,
}
_MODES = {55: mode_sets.shape55, 2414: mode_sets.shape2414}
_SILENT = frozenset({151, 164, 58, 2400, 2467, 2477, 1858})
"""Sets that need no finding: read elsewhere, or of no bearing on measurements (groups, model headers, qualifiers)."""
_MODEL_FIELDS = ("model name", "model description", "program", "created", "modified", "written by", "written")


@contextmanager
def opened(path: Path) -> Iterator[ByteFile]:
    """The file; in memory where it is gzipped, or text in another code or with other line ends than the format's.

    Raises
    ------
    InputError : its text was converted, with binary values in it.
    """
    with path.open("rb", buffering=0) as file:
        start = file.read(sniff.HEAD)
        if start[:2] != b"\x1f\x8b" and not _converted(start):
            yield file
            return
    whole = sniff.whole(path)
    yield BytesIO(_as_written(whole, path.name) if _converted(whole[: sniff.HEAD]) else whole)


def _converted(start: bytes) -> bool:
    """Whether a file begins in another code than ASCII, or with line ends that are carriage returns alone."""
    return sniff.as_ascii(start) != start or re.match(rb"\s*-1[ ]*\r(?!\n)", start) is not None


def _as_written(data: bytes, where: str) -> bytes:
    """The text of a file in ASCII with the line ends of the format.

    Raises
    ------
    InputError : it has binary values, which converting text has changed.
    """
    text = sniff.as_ascii(data)
    bare = re.match(rb"\s*-1[ ]*\r(?!\n)", text) is not None
    wide = len(data) - len(text) > 3
    if (bare or wide) and re.search(rb"-1[ ]*\r?\n?[ ]*58b", text):
        raise InputError(
            "a universal file with binary values was converted as if it were text",
            where=where,
            got="line ends of carriage returns alone" if bare else "UTF-16",
            advice="copy the file as it was exported, or export it as text",
        )
    return re.sub(rb"\r(?!\n)", b"\n", text) if bare else text


def list_sets(path: "str | PathLike[str]") -> tuple[Entry, ...]:
    """The data sets of a universal file, without reading the values of its functions.

    Raises
    ------
    InputError : the file cannot be read.
    """
    try:
        with opened(Path(path)) as file:
            return index(file)
    except OSError as error:
        raise InputError(
            f"the file cannot be read: {error.strerror or error}",
            where=str(path),
            advice="check the name, and that it is a file that you may read",
        ) from error


def functions(path: "str | PathLike[str]", sets: Sequence[int] | None = None) -> tuple[Function, ...]:
    """The functions (data set 58) of a file as written, of any type, all or those with the given set numbers.

    Raises
    ------
    InputError : the file cannot be read, or a function is damaged.
    """
    with opened(Path(path)) as file:
        entries = [entry for entry in index(file) if entry.type == 58 and (sets is None or entry.number in sets)]
        for entry in entries:
            if entry.problem or entry.header is None:
                raise InputError(
                    entry.problem or "damaged",
                    where=f"{Path(path).name}, data set {entry.number + 1}",
                    advice="export the file again",
                )
        try:
            found = tuple(fetch(file, entry) for entry in entries)
        except ValueError as error:
            raise InputError(
                f"a function is damaged: {error}", where=Path(path).name, advice="export the file again"
            ) from error
        for entry, function in zip(entries, found, strict=True):
            if function.problem or len(function.y) != function.header.points:
                raise InputError(
                    function.problem or "fewer values than its header announces",
                    where=f"{Path(path).name}, data set {entry.number + 1}",
                    advice="export the file again",
                )
        return found


def fetch(file: ByteFile, entry: Entry) -> Function:
    """Read the values of one function.

    Parameters
    ----------
    file : ByteFile
        The opened file.
    entry : Entry
        Where the data set lies, with its header.

    Returns
    -------
    Function
        Header and values; with a ``problem`` where the values are not those that the header announces.

    Raises
    ------
    ValueError
        Something in the values is no number.
    """
    assert entry.header is not None  # only functions with a sound header are fetched
    file.seek(entry.data)
    data = file.read(entry.end - entry.data)
    if not entry.header.binary:
        function = values58.from_text(entry.header, data)
        return replace(function, problem=entry.problem) if entry.problem else function
    if not entry.problem and len(data) > (sound := _length(entry, len(data))):
        data = data[:sound]
    function = values58.from_binary(entry.header, data)
    return replace(function, problem=entry.problem) if entry.problem else function


def _length(entry: Entry, there: int) -> int:
    """Length of a sound binary block, without a line end behind it."""
    assert entry.header is not None
    lengths = [dtype.itemsize * entry.header.points for dtype in values58.record_types(entry.header)]
    return max((length for length in lengths if length <= there), default=there)


@dataclass
class _File:
    """What reading one file has gathered so far."""

    where: str
    parts: geometry_sets.Parts = field(default_factory=geometry_sets.Parts)
    shapes: list[mode_sets.Shape] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    metadata: list[tuple[str, str]] = field(default_factory=list)
    skipped: dict[str, int] = field(default_factory=dict)

    def damaged(self, entry: Entry, why: str) -> None:
        """Note that a data set is not usable."""
        where = f"{self.where}, data set {entry.number + 1} (type {entry.type})"
        self.findings.append(Finding("error", "damaged-set", where, why + ".", advice="Export the file again."))


def read(path: Path, layout: Layout) -> Contents:
    """Read a universal file; damaged sets are left out with a finding, time records cut short are read up to the cut.

    Parameters
    ----------
    path : Path
        File that exists and whose format was recognised.
    layout : Layout
        ``sets``: numbers of the data sets to read, all by default; ``unit``: length unit of the geometry where no data
        set 164 states it.

    Returns
    -------
    Contents
        Recordings, FRF sets, modal models and geometry of the data sets, with findings for the sets left out.

    Raises
    ------
    InputError
        No data set in it can be used.
    UnitError
        ``unit`` is no unit of length.
    """
    with opened(path) as file, suppressed_warnings():  # damaged numbers may overflow; they are found as such
        there = index(file)
        entries = [entry for entry in there if layout.sets is None or entry.number in layout.sets]
        if not entries:
            raise InputError(
                "no data set in the file", where=str(path), advice="a universal file begins with a line '    -1'"
            )
        gathered = _File(path.name)
        systems = _unit_systems(file, there, gathered)
        for entry in entries:
            if entry.type != 58:
                _plain(file, entry, systems[entry.number], gathered)
        sound = _sound(entries, gathered)
        made = gather(sound, systems, lambda entry: _checked(file, entry, gathered), path.name)
        gathered.parts.units = next((systems[e.number] for e in entries if e.type in (15, 2411)), UnitSystem())
        geometry = geometry_sets.assemble(gathered.parts, path.name, _length_unit(layout))
        modes, notes = mode_sets.models(gathered.shapes, path.name)
    for what, count in gathered.skipped.items():
        times = f"{count} data sets hold" if count > 1 else "1 data set holds"
        gathered.findings.append(Finding("info", "not-read", path.name, f"{times} {what}, not read."))
    findings = tuple(dict.fromkeys((*gathered.findings, *made.findings, *gathered.parts.findings, *notes)))
    metadata = (*gathered.metadata, *_ids(sound))
    contents = Contents(
        tuple(made.recordings),
        tuple(made.frfs),
        tuple(modes),
        geometry,
        findings,
        metadata,
        tuple(made.units),
        tuple(made.frf_units),
    )
    return contents if contents else _nothing(contents, entries, path.name)


def _length_unit(layout: Layout) -> float | None:
    """Unit of length in m that the user says.

    Raises
    ------
    UnitError : not a unit of length.
    """
    if layout.unit is None:
        return None
    unit = units.parse(layout.unit)
    if unit.quantity != "displacement":
        raise units.UnitError("not a unit of length", got=repr(layout.unit), expected="m, mm, in ...")
    return unit.factor


def _nothing(contents: Contents, entries: Sequence[Entry], where: str) -> Contents:
    """Contents of a file in which nothing could be read, with the reason.

    Raises
    ------
    InputError : all that it might hold is damaged.
    """
    worst = next((finding for finding in contents.findings if finding.code == "damaged-set"), None)
    if worst is not None:
        raise InputError(worst.message.rstrip("."), where=worst.where, advice="export the file again")
    if contents.findings:
        return contents
    types = ", ".join(sorted({str(entry.type) for entry in entries}))
    message = f"only data sets of type {types}, which hold no measurement."
    return replace(contents, findings=(Finding("warning", "nothing-to-read", where, message),))


def _sound(entries: list[Entry], gathered: _File) -> list[Entry]:
    """The functions whose header can be read; of the others the problem is noted."""
    sound = []
    for entry in entries:
        if entry.type != 58:
            continue
        if entry.header is None:
            gathered.damaged(entry, entry.problem or "the header is damaged")
        else:
            sound.append(entry)
    return sound


def _checked(file: ByteFile, entry: Entry, gathered: _File) -> Function:
    """The values of a function; of a time record that is cut short those that are there, with a finding.

    Raises
    ------
    Damaged : the values are not those that the header announces; the finding is noted.
    """
    function = fetch(file, entry)
    there, announced = len(function.y), function.header.points
    if not function.problem and there == announced:
        return function
    why = function.problem or "the data set is cut short"
    # bytes lost in a binary block move all values behind them; only an end that is missing leaves the others right
    exact = not function.header.binary or why.startswith("the file ends")
    if exact and there > 1 and function.header.function == header58.TIME:
        gathered.damaged(
            entry, f"{why}; {there} of {announced} announced values are read, where the others were is lost"
        )
        return function
    gathered.damaged(entry, f"{why}; it is left out ({there} of {announced} announced values are there)")
    raise Damaged


def _unit_systems(file: ByteFile, entries: Sequence[Entry], gathered: _File) -> dict[int, UnitSystem]:
    """The unit system of each set: that of the last 164 in front of it, else of the first in the file."""
    found: dict[int, UnitSystem] = {}
    for entry in entries:
        if entry.type == 164:
            try:
                found[entry.number] = parse164(_lines(file, entry))
            except (ValueError, IndexError) as error:
                gathered.damaged(entry, f"units: {error}")
    for text in dict.fromkeys(system.contradiction for system in found.values() if system.contradiction):
        message = f"{text}; the factors are used."
        gathered.findings.append(
            Finding("warning", "unit-contradiction", gathered.where, message, advice="Check the units.")
        )
    if found:
        gathered.metadata.append(("unit system", next(iter(found.values())).name))
    current = next(iter(found.values()), UnitSystem())
    systems = {}
    for entry in entries:
        current = found.get(entry.number, current)
        systems[entry.number] = current
    return systems


def _lines(file: ByteFile, entry: Entry) -> list[bytes]:
    file.seek(entry.data)
    return file.read(entry.end - entry.data).splitlines()


def _plain(file: ByteFile, entry: Entry, system: UnitSystem, gathered: _File) -> None:
    """A data set of text: geometry, modes or the model's header."""
    lines = _lines(file, entry)
    if any(line.split() == [b"-1", b"-1"] for line in lines):
        gathered.damaged(entry, "its end and the beginning of the next data set stand on one line; both are left out")
        return
    try:
        if entry.type in _GEOMETRY:
            _GEOMETRY[entry.type](gathered.parts, lines)
        elif entry.type in _MODES:
            gathered.shapes.append(_MODES[entry.type](lines, system))
        elif entry.type == 151:
            texts = [mended(text_of(line)) for line in lines]
            gathered.metadata += [
                (name, text)
                for name, text in zip(_MODEL_FIELDS, texts)
                if text and text.upper() not in ("NONE", "UNKNOWN")
            ]
        elif entry.type and entry.type not in _SILENT and _is_function(lines):
            gathered.damaged(entry, "a function whose number is not 58; it is left out")
        elif entry.type and entry.type not in _SILENT:
            what = f"type {entry.type}"
            gathered.skipped[what] = gathered.skipped.get(what, 0) + 1
    except mode_sets.NotAMode as other:
        what = f"a {other}"
        gathered.skipped[what] = gathered.skipped.get(what, 0) + 1
    except (ValueError, IndexError, OverflowError, FloatingPointError) as error:
        gathered.damaged(entry, f"damaged: {error}")
    else:
        if entry.problem:
            gathered.damaged(entry, entry.problem)


def _is_function(lines: list[bytes]) -> bool:
    """Whether lines are those of a function whose number is another, or stands elsewhere in its header."""
    if any(line.rstrip() == b"    58" for line in lines[: header58.RECORDS + 2]):
        return True
    try:
        header = header58.parse(b"    58", lines[: header58.RECORDS])
    except (ValueError, IndexError, OverflowError):
        return False
    return header.function in header58.FUNCTION_TYPES and len(lines) > header58.RECORDS


def _ids(entries: list[Entry]) -> list[tuple[str, str]]:
    """The texts in the heads of the functions, each once."""
    texts: dict[tuple[str, str], None] = {}
    for entry in entries[:200]:
        if entry.header is not None:
            for number, text in enumerate(entry.header.ids):
                if text and text.upper() != "NONE" and not (number == 0 and entry.header.function == 1):
                    texts[f"function id {number + 1}", text] = None
    return list(texts)[:20]
