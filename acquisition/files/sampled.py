"""Channels of several rates and lengths, as loggers write them, become recordings."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from acquisition import units
from acquisition.contents import Contents
from acquisition.files.arrays import not_finite
from acquisition.files.layout import Layout
from acquisition.files.signals import before_si, labelled_units, make_recording
from ema.data import Finding, Recording


@dataclass(frozen=True)
class Sampled:
    """One channel of a logger: name, unit string (empty where there is none), samples (sample,), rate in Hz.

    ``start`` is the time of its first sample in s, on the clock of all channels of the file.
    """

    name: str
    unit: str
    samples: Any
    rate: float
    start: float = 0.0


TOGETHER = 0.01
"""Part of a sample by which channels of one recording may begin apart: at 0.4 of the sampling rate, 1.4 degrees between
their FRFs. Halved or doubled, channels with rounded stamps are taken apart, or 3 degrees go unseen."""


def recordings(
    channels: Sequence[Sampled], layout: Layout, where: str, metadata: Sequence[tuple[str, str]]
) -> Contents:
    """One recording for each rate, length and start."""
    groups: list[list[Sampled]] = []
    for channel in channels:
        fitting = (group for group in groups if _together(group[0], channel))
        group = next(fitting, None)
        if group is None:
            groups.append([channel])
        else:
            group.append(channel)
    first = min((channel.start for channel in channels), default=0.0)
    made: list[Recording] = []
    each, findings = labelled_units(layout, [c.name for c in channels], [c.unit for c in channels], where)
    taken = {id(channel): unit for channel, unit in zip(channels, each, strict=True)}
    stated: list[tuple[str, units.Unit]] = []
    for group in groups:
        late = group[0].start - first
        name = where if len(groups) == 1 else f"{where}, {group[0].rate:g} Hz"
        if late * group[0].rate > TOGETHER:
            name += f", {late:g} s later"
            message = f"its channels begin {late:g} s after the first of the file and are a recording alone."
            advice = "Start all channels by one trigger: phases between recordings mean nothing."
            findings.append(Finding("warning", "begins-later", name, message, late, TOGETHER / group[0].rate, advice))
        names, found = [c.name for c in group], [taken[id(c)] for c in group]
        signals = np.stack([np.asarray(channel.samples, dtype=np.float64) for channel in group])
        record = make_recording(signals, names, found, group[0].rate, name)
        findings.extend(not_finite(record.signals, name))
        stated.extend(before_si(names, found))
        made.append(record)
    return Contents(recordings=tuple(made), findings=tuple(findings), metadata=tuple(metadata), units=tuple(stated))


def _together(one: Sampled, other: Sampled) -> bool:
    """Whether two channels have the same rate and length and begin together."""
    alike = one.rate == other.rate and len(one.samples) == len(other.samples)
    return alike and abs(one.start - other.start) * one.rate <= TOGETHER
