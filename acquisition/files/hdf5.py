"""HDF5 files of any layout; arrays are named by their path: ``InputTask/data``."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from acquisition.contents import Contents
from acquisition.files.arrange import arrange
from acquisition.files.arrays import Arrays
from acquisition.files.layout import Layout


def read(path: Path, layout: Layout) -> Contents:
    """Read the arrays of an HDF5 file.

    A group that holds ``data``, ``sample_rate`` and ``channel_names`` (or ``time``) describes itself; anything else
    needs a layout.

    Raises
    ------
    InputError : damaged, or in need of a layout.
    """
    pool = variables(path)
    return arrange(pool, layout if layout.kind else replace(layout, **_itself(pool.arrays, layout)))


def variables(path: Path) -> Arrays:
    """All arrays by path; text attributes as metadata, ``unit`` or ``units`` attributes as units."""
    import h5py

    arrays: dict[str, Any] = {}
    stated: dict[str, str] = {}
    metadata: list[tuple[str, str]] = []

    def visit(name: str, item: Any) -> None:
        for key, value in item.attrs.items():
            if isinstance(value, bytes):
                value = value.decode("utf-8", "replace")
            if isinstance(value, str):
                metadata.append((f"{name}/{key}", value))
                if key.lower() in ("unit", "units"):
                    stated[name] = value
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "biufcOSU" and item.dtype.names is None:
            arrays[name] = item.asstr()[...] if h5py.check_string_dtype(item.dtype) else item[...]

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    numeric = [name for name, array in arrays.items() if getattr(array, "ndim", 0) == 2]
    return Arrays(path.name, arrays, numeric[0] if len(numeric) == 1 else "", stated, metadata=tuple(metadata))


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
        clock = {"sampling_rate": rate} if rate else {"time": there["time"]} if "time" in there else {}
        names = layout.names or there.get("channel_names") or there.get("names")
        if clock:
            return {"signals": name, "names": names, **clock}
    return {}
