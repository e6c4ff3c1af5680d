"""ASAM MDF, versions 3 and 4."""

import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from acquisition.contents import Contents
from acquisition.files import mdf4_blocks
from acquisition.files.layout import Layout
from acquisition.files.reconcile import differs
from acquisition.files.sampled import Sampled, recordings
from acquisition.files.signals import rate_of
from acquisition.files.suppressed_warnings import suppressed_warnings
from acquisition.isolated import call
from ema.data import Finding
from ema.errors import InputError, require


def read(path: Path, layout: Layout) -> Contents:
    """Read the channels that are sampled at a constant rate.

    Parameters
    ----------
    path : Path
        File that exists and whose format was recognised.
    layout : Layout
        ``units`` of the channels where the file states none; ``salvage``: read the whole records of a damaged file.

    Returns
    -------
    Contents
        One recording per sampling rate, with signals (channel, sample) in SI where units are stated.

    Raises
    ------
    MissingExtraError
        asammdf is not installed.
    InputError
        The file is damaged, without channels, or its time axis is not evenly spaced.
    """
    there = call("mdf4", path, salvage=layout.salvage)
    if not there["channels"]:
        raise InputError(
            "no numeric channel in the file",
            where=path.name,
            expected="a channel of numbers with two samples or more",
            advice="measure or export it again",
        )
    sampled = [Sampled(**channel) for channel in there["channels"]]
    contents = recordings(sampled, layout, path.name, [(name, text) for name, text in there["metadata"]])
    notes = [
        Finding("info", "not-read", f"{path.name}, {name}", "the channel holds no row of numbers.")
        for name in there["skipped"]
    ]
    notes += [
        Finding("warning", "invalid-values", f"{path.name}, {name}", "values marked as invalid are NaN.")
        for name in there["invalid"]
    ]
    for stated, right in there["corrected"]:
        notes += differs(
            "other data than the header announces",
            where=path.name,
            layout=layout,
            got=right,
            expected=stated,
            recovered="the whole records that are there are read",
        )
    return replace(contents, findings=(*notes, *contents.findings))


def channels(path: Path, salvage: bool = False) -> dict[str, Any]:
    """The ``channels`` of a file, each with ``name``, ``unit``, ``samples``, ``rate`` in Hz and ``start`` in s, and its
    ``metadata``.

    ``skipped`` names channels that are no numbers, ``invalid`` those with values that the logger marked as invalid;
    ``corrected`` are numbers that contradicted the file, and what they must be, where ``salvage`` was asked for.

    Raises
    ------
    InputError : a time axis that is not even; more or less in the file than it announces.
    """
    asammdf = require("asammdf", "formats")
    cycles, corrections = mdf4_blocks.check(path, salvage) if _version(path) == 4 else (None, [])
    found, skipped, invalid = [], [], []
    # handed an open file: by name the package may open it for writing
    with suppressed_warnings("asammdf"), _corrected(path, corrections) as raw, asammdf.MDF(raw) as file:
        metadata = [("version", str(file.version)), ("start", str(file.start_time))]
        announced = [int(group.channel_group.cycles_nr) for group in file.groups]
        if cycles is not None and announced != cycles:
            raise InputError("other groups of channels than announced", where=path.name, got=announced, expected=cycles)
        for number, group in enumerate(file.groups):
            places = [place for place in range(len(group.channels)) if place != file.masters_db.get(number)]
            for signal in file.select([(None, number, place) for place in places], copy_master=False) if places else ():
                samples, name = np.asarray(signal.samples), str(signal.name)
                if samples.ndim != 1 or samples.dtype.kind not in "biuf" or announced[number] < 2:
                    skipped.append(name)
                    continue
                if len(samples) != announced[number]:
                    raise InputError(
                        "another number of samples than the header announces",
                        where=f"{path.name}, {name}",
                        got=len(samples),
                        expected=announced[number],
                        advice="copy or export the file again",
                    )
                marked = signal.invalidation_bits
                if marked is not None and np.any(marked):
                    invalid.append(name)
                    samples = np.where(np.asarray(marked, dtype=bool), np.nan, samples.astype(np.float64))
                times = np.asarray(signal.timestamps, dtype=np.float64)
                rate = rate_of(times, f"{path.name}, {name}")
                found.append(
                    {
                        "name": name,
                        "unit": str(signal.unit or ""),
                        "samples": samples,
                        "rate": rate,
                        "start": float(times[0]),
                    }
                )
    pairs = [[one.stated, one.right] for one in corrections]
    return {"channels": found, "metadata": metadata, "skipped": skipped, "invalid": invalid, "corrected": pairs}


def _corrected(path: Path, corrections: Sequence[mdf4_blocks.Correction]) -> BinaryIO:
    """The file, or a copy of it in memory with some numbers corrected."""
    if not corrections:
        return path.open("rb")
    data = bytearray(path.read_bytes())
    for one in corrections:
        data[one.place : one.place + 8] = one.right.to_bytes(8, "little")
    return io.BytesIO(data)


def _version(path: Path) -> int:
    """Major version as the identification states it: a number at byte 28, in agreement with the text in front of it."""
    with path.open("rb") as file:
        head = file.read(64)
    number = int.from_bytes(head[28:30], "little") // 100
    if head[:8] != b"MDF     ":
        advice = "finish it with the software of the logger, or copy or export it again"
        raise InputError("the logger did not finish the file", where=path.name, advice=advice)
    if head[8:9] != str(number).encode() and number < 10:
        raise InputError(
            "the version of the file is stated twice and differs",
            where=path.name,
            got=repr(head[8:16].decode("latin-1")),
            expected=str(number),
            advice="copy or export the file again",
        )
    return number
