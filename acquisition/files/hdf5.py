"""HDF5 files of any layout; arrays are named by their path: ``InputTask/data``."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from acquisition.contents import Contents
from acquisition.files.array_contents import contents_of
from acquisition.files.arrays import Arrays, fields
from acquisition.files.layout import Layout
from acquisition.files.reconcile import differs
from acquisition.isolated import call
from ema.data import Finding
from ema.errors import InputError

_FACTORS = re.compile(
    r"scale|scaling|gain|calibration|sensitivity|conversion|multiplier|slope|(^|_)factor", re.IGNORECASE
)
_OFFSETS = re.compile(r"offset|intercept", re.IGNORECASE)
"""Names of attributes by which numbers are multiplied or shifted; 1 and 0 change nothing."""
_ABSENT = ("_FillValue", "missing_value")
_CLOCKS = re.compile(
    r"fs|sampl(e|ing)[ _-]?(rate|freq\w*|interval)|dt|delta[ _-]?t|wf_increment|time[ _-]?step", re.IGNORECASE
)
"""Names of attributes that state a sampling rate or interval, which are numbers of the file like any other."""
_SIGNATURE = b"\x89HDF\r\n\x1a\n"


def read(path: Path, layout: Layout) -> Contents:
    """Read the arrays of an HDF5 file.

    A group that holds ``data``, ``sample_rate`` and ``channel_names`` (or ``time``) describes itself; anything else
    needs a layout.

    Parameters
    ----------
    path : Path
        File that exists and whose format was recognised.
    layout : Layout
        Which array is what, in a file that does not describe itself; ``salvage``: read a file of another length than
        its superblock states.

    Returns
    -------
    Contents
        What the layout, or the file itself, names; with findings for what was not read.

    Raises
    ------
    InputError
        The file is damaged, or needs a layout.
    """
    notes = compare_length(path, layout)
    pool = variables(path)
    contents = contents_of(pool, layout if layout.kind else replace(layout, **_itself(pool.arrays, layout)))
    return replace(contents, findings=(*notes, *contents.findings))


def compare_length(path: Path, layout: Layout) -> tuple[Finding, ...]:
    """Compare the length of the file with the one in its superblock; the library looks for files that are shorter only.

    Bytes that were put in or doubled move all arrays behind them. Source: HDF5 File Format Specification 3.0, II.A: the
    superblock stands at byte 0, or behind a block of the user's own at 512, 1024, ...

    Raises
    ------
    InputError : they differ, and salvage was not asked for.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        place = 0
        while place < size:
            file.seek(place)
            head = file.read(96)
            if head[:8] == _SIGNATURE:
                break
            place = 2 * place or 512
        else:
            return ()  # the library says what is wrong
    version = head[8]
    width, begin = (head[13], 24 + 4 * (version == 1)) if version < 2 else (head[9], 12)
    base, end = (int.from_bytes(head[begin + k * width : begin + (k + 1) * width], "little") for k in (0, 2))
    if width not in (2, 4, 8) or base + end == size or end == size:
        return ()
    return differs(
        "the file is not as long as it announces",
        where=path.name,
        layout=layout,
        got=f"{size} bytes",
        expected=base + end,
        recovered="what the library finds is read" if size > base + end else "",
    )


def variables(path: Path) -> Arrays:
    """All arrays by path; text attributes as metadata, ``unit`` or ``units`` attributes as units.

    Raises
    ------
    InputError : an array or link that leads to another file, or values that were never written.
    """
    there = call("hdf5", path)
    numeric = [name for name, array in there["arrays"].items() if getattr(array, "ndim", 0) == 2]
    notes = [not_read(path.name, there["left"])] if there["left"] else []
    notes += [Finding("warning", "meaning", f"{path.name}, {name}", f"{text}.") for name, text in there["meant"]]
    return Arrays(
        path.name,
        there["arrays"],
        numeric[0] if len(numeric) == 1 else "",
        there["stated"],
        metadata=tuple((name, text) for name, text in there["metadata"]),
        labels=there["stated"],
        findings=tuple(notes),
        left_out=there["left"],
    )


def tree(path: Path) -> dict[str, Any]:
    """The ``arrays`` of a file by path, units ``stated``, ``metadata`` and the names of what is ``left`` out.

    Raises
    ------
    InputError : an array or link that leads to another file, or values that were never written.
    """
    from ema.store import untrusted

    found = _Found()
    with untrusted.opened(path) as file:
        try:
            _attributes(file, "", found)
            _gather(file, "", found, set())
        except InputError as error:
            raise InputError(
                error.what, where=str(path), got=error.got, expected=error.expected, advice=error.advice
            ) from error
    return vars(found)


def not_read(where: str, left: Mapping[str, str]) -> Finding:
    """Arrays of a kind that holds no measurement, and what each is."""
    shown = ", ".join(f"{name} ({what})" for name, what in list(left.items())[:5]) + (" ..." if len(left) > 5 else "")
    message = f"{len(left)} of its arrays not read: {shown}."
    return Finding("info", "not-read", where, message)


@dataclass
class _Found:
    """What was gathered from the groups of one file.

    ``left`` names the arrays that are no numbers and no texts with what they are, ``meant`` those whose attributes give
    their numbers another meaning, and which.
    """

    arrays: dict[str, Any] = field(default_factory=dict)
    stated: dict[str, str] = field(default_factory=dict)
    metadata: list[tuple[str, str]] = field(default_factory=list)
    left: dict[str, str] = field(default_factory=dict)
    meant: list[tuple[str, str]] = field(default_factory=list)


def _gather(group: Any, prefix: str, found: _Found, seen: set[int]) -> None:
    """Everything in a group and below it; each group once, whatever leads to it."""
    import h5py

    from ema.store import untrusted

    for key in group:
        name = f"{prefix}{key}"
        link = group.get(key, getlink=True)
        untrusted.refuse_link(link, name)
        if isinstance(link, h5py.SoftLink):
            continue  # what it names has a name of its own
        item = group[key]
        _attributes(item, name, found)
        if isinstance(item, h5py.Group):
            address = h5py.h5o.get_info(item.id).addr
            if address not in seen:
                seen.add(address)
                _gather(item, f"{name}/", found, seen)
        elif isinstance(item, h5py.Dataset) and item.shape is not None:
            texts = h5py.check_string_dtype(item.dtype) is not None
            if item.dtype.names is not None:
                _records(item, name, found)
                continue
            if not texts and item.dtype.kind not in "biufc":
                found.left[name] = "references or raw bytes"
                continue
            untrusted.check(item, name)
            found.arrays[name] = _texts(item) if texts else item[...]
            if not texts and item.dtype.kind in "iuf":
                _meaning(item, found.arrays[name], name, found)


def _records(item: Any, name: str, found: _Found) -> None:
    """The fields of an array of records, each an array with a name of its own."""
    from ema.store import untrusted

    untrusted.check(item, name)
    numbers, others = fields(item[...], f"{name}/")
    found.arrays.update(numbers)
    found.left.update(others)


def _meaning(item: Any, array: Any, name: str, found: _Found) -> None:
    """Note attributes that give the numbers another meaning, and how many are those that stand for nothing.

    Source: NetCDF Climate and Forecast conventions, 2.5.1 and 8.1, whose attributes others use too.
    """
    neutral = {
        key: 1.0 if _FACTORS.search(key) else 0.0 for key in item.attrs if _FACTORS.search(key) or _OFFSETS.search(key)
    }
    scaled = [key for key, none in neutral.items() if _is_number(item, key) and np.any(item.attrs[key] != none)]
    if scaled:
        found.meant.append((name, f"its attributes {' and '.join(scaled)} are not applied to the numbers"))
    absent = [item.attrs[key] for key in _ABSENT if key in item.attrs and np.size(item.attrs[key]) == 1]
    absent += [item.fillvalue] if np.any(item.fillvalue) else []  # 0 by default, which is a number like any other
    count = max((int(np.count_nonzero(array == value)) for value in absent), default=0)
    if count:
        found.meant.append((name, f"{count} of {array.size} numbers are those that the file states for missing ones"))


def _is_number(item: Any, key: str) -> bool:
    """Whether an attribute is a number or some."""
    return item.attrs.get_id(key).dtype.kind in "iuf"


def _texts(item: Any) -> Any:
    """Texts as an array (of any shape) or, of one alone, as a text."""
    there = item.asstr(errors="replace")[...]
    return np.array(there, dtype=np.str_)


def _attributes(item: Any, name: str, found: _Found) -> None:
    for key in item.attrs:
        if item.attrs.get_id(key).dtype.kind not in "OS":
            if _CLOCKS.fullmatch(key) and _is_number(item, key) and np.size(item.attrs[key]) == 1:
                found.arrays.setdefault(f"{name}/{key}".lstrip("/"), np.asarray(item.attrs[key]).reshape(()))
            continue  # other numbers are not used
        value = item.attrs[key]
        if isinstance(value, bytes):
            value = value.decode("utf-8", "replace")
        if isinstance(value, str):
            found.metadata.append((f"{name}/{key}".lstrip("/"), value))
            if name and key.lower() in ("unit", "units"):
                found.stated[name] = value


def _itself(arrays: Mapping[str, Any], layout: Layout) -> dict[str, Any]:
    """Layout of a group with data, sample_rate, channel_names or time, in whatever order of the axes."""
    for name in arrays:
        group, _, last = name.rpartition("/")
        if last not in ("data", "signals"):
            continue
        inside = {
            key: f"{group}/{key}".lstrip("/")
            for key in ("sample_rate", "sampling_rate", "time", "channel_names", "names")
        }
        there = {key: place for key, place in inside.items() if place in arrays}
        rate = there.get("sampling_rate") or there.get("sample_rate")
        clock = {"sampling_rate": rate} if rate else {}
        if "time" in there:
            clock["time"] = there["time"]
        names = layout.names or there.get("channel_names") or there.get("names")
        if clock:
            return {"signals": name, "names": names, **clock}
    return {}
