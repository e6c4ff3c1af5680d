"""LabVIEW TDMS."""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from acquisition import units
from acquisition.contents import Contents
from acquisition.files.layout import Layout
from acquisition.files.reconcile import differs
from acquisition.files.sampled import Sampled, recordings
from acquisition.files.signals import nice_rate
from acquisition.files.suppressed_warnings import suppressed_warnings
from acquisition.isolated import call
from ema.data import Finding
from ema.errors import InputError, require


def read(path: Path, layout: Layout) -> Contents:
    """Read the waveform channels.

    Parameters
    ----------
    path : Path
        File that exists and whose format was recognised.
    layout : Layout
        ``sampling_rate`` in Hz of channels without a time step; ``units`` where the file states none; ``salvage``: read
        a file that was not closed.

    Returns
    -------
    Contents
        One recording per sampling rate, with signals (channel, sample) in SI where units are stated.

    Raises
    ------
    MissingExtraError
        nptdms is not installed.
    InputError
        The file is damaged, without channels, or without a time step.
    """
    notes = _announced(path, layout)
    there = call("tdms", path)
    sampled = []
    for channel in there["channels"]:
        place = f"{path.name}, {channel['channel']}"
        unit = units.known(channel["axis"] or "s")
        if unit is not None and unit.quantity != "time":
            message = f"its axis is one of {unit.quantity} in {channel['axis']}, not of time."
            notes.append(Finding("warning", "not-read", place, message, advice="Export the time signal."))
            continue
        if unit is None:
            message = f"the unit {channel['axis']!r} of its axis is none of time; it is taken in s."
            notes.append(Finding("warning", "unit-doubtful", place, message, advice="Check the sampling rate."))
        second = 1.0 if unit is None else unit.factor
        rate = nice_rate(second * channel["step"], 1e-9) if channel["step"] else layout.sampling_rate
        if not isinstance(rate, (int, float)):
            raise InputError(
                "the channel has no time step",
                where=place,
                advice="say sampling_rate=... [Hz]",
            )
        start = second * channel["offset"] + channel["start"]
        sampled.append(Sampled(channel["name"], channel["unit"], channel["samples"], float(rate), start))
    if not sampled:
        raise InputError(
            "no channel with numbers over time in the file", where=path.name, advice="export the time signals"
        )
    contents = recordings(sampled, layout, path.name, [(name, text) for name, text in there["metadata"]])
    notes += [
        Finding("info", "not-read", f"{path.name}, {name}", "the channel holds no numbers.") for name in there["left"]
    ]
    if there["cut"]:
        notes.append(
            Finding(
                "error",
                "damaged-set",
                path.name,
                "the last segment of the file is not complete; it is truncated.",
                advice="Export the file again.",
            )
        )
    return replace(contents, findings=(*notes, *contents.findings))


_LEAD = struct.Struct("<4sIIQQ")
_OPEN = 2**64 - 1
"""Length of a segment whose writer did not come to its end."""


def _announced(path: Path, layout: Layout) -> list[Finding]:
    """Compare the lengths of the segments with that of the file.

    Source: TDMS File Format Internal Structure (NI): every segment begins with a lead-in of 28 bytes, in which the
    length of all behind it stands.

    Raises
    ------
    InputError : the last segment does not end where the file does, and salvage was not asked for.
    """
    size, place = path.stat().st_size, 0
    with path.open("rb") as file:
        while place + _LEAD.size <= size:
            file.seek(place)
            tag, _, _, length, raw = _LEAD.unpack(file.read(_LEAD.size))
            if tag not in (b"TDSm", b"TDSh") or (length != _OPEN and raw > length):
                break
            place += _LEAD.size + length
            if place > size or length == _OPEN:
                return []  # cut short: the library reads as far as it goes, which is named
    if place == size:
        return []
    found = differs(
        "other bytes behind a segment than the next one",
        where=path.name,
        layout=layout,
        got=f"{size} bytes",
        expected=place,
        recovered="the segments in front of them are read",
    )
    return list(found)


def channels(path: Path) -> dict[str, Any]:
    """The numeric ``channels`` of a file, its ``metadata``, if its last segment is ``cut``, and what is ``left`` out.

    Each channel has its ``channel`` name, a ``name`` that is its own in the file, ``unit``, ``samples``, the
    ``step``, 0 where none is stated, and the ``offset`` of its axis in the unit ``axis``, empty where none is stated,
    and ``start`` in s after the first time stamp of the file.
    """
    nptdms = require("nptdms", "formats")
    made, left = [], []
    with suppressed_warnings("nptdms"), nptdms.TdmsFile.read(str(path)) as file:
        groups = file.groups()
        stamps = [channel.properties.get("wf_start_time") for group in groups for channel in group.channels()]
        for group in groups:
            for channel in group.channels():
                if len(channel) == 0 or np.asarray(channel[:1]).dtype.kind not in "biuf":
                    left.append(str(channel.name))
                    continue
                properties = channel.properties
                made.append(
                    {
                        "channel": channel.name,
                        "name": channel.name if len(groups) == 1 else f"{group.name}/{channel.name}",
                        "unit": str(properties.get("unit_string") or properties.get("Unit") or ""),
                        "step": float(properties.get("wf_increment") or 0.0),
                        "axis": str(properties.get("wf_xunit_string") or ""),
                        "offset": float(properties.get("wf_start_offset") or 0.0),
                        "start": _seconds(properties, stamps),
                        "samples": np.asarray(channel[:]),
                    }
                )
        metadata = [(str(key), str(value)) for key, value in file.properties.items()]
        return {
            "channels": made,
            "metadata": metadata,
            "cut": bool(file.file_status.incomplete_final_segment),
            "left": left,
        }


def _seconds(properties: Mapping[str, Any], stamps: Sequence[Any]) -> float:
    """Seconds between the first of the time stamps and that of a channel; 0 where one of them has none."""
    if not all(isinstance(stamp, np.datetime64) for stamp in stamps):
        return 0.0
    return float((properties["wf_start_time"] - min(stamps)) / np.timedelta64(1, "ns")) / 1e9
