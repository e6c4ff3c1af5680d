"""Channels of several rates and lengths, as loggers write them, become recordings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np

from acquisition import units
from acquisition.contents import Contents
from acquisition.files.arrays import not_finite
from acquisition.files.layout import Layout
from acquisition.files.signals import make_recording
from ema.data import Finding, Recording


@dataclass(frozen=True)
class Sampled:
    """One channel of a logger: name, unit string (empty where there is none), samples (sample,), rate in Hz."""

    name: str
    unit: str
    samples: Any
    rate: float
    start: datetime | None = None


def recordings(
    channels: Sequence[Sampled], layout: Layout, where: str, metadata: Sequence[tuple[str, str]]
) -> Contents:
    """One recording for each rate and length."""
    groups: dict[tuple[float, int], list[Sampled]] = {}
    for channel in channels:
        groups.setdefault((channel.rate, len(channel.samples)), []).append(channel)
    made: list[Recording] = []
    findings: list[Finding] = []
    for group in groups.values():
        name = where if len(groups) == 1 else f"{where}, {group[0].rate:g} Hz"
        found = [_unit(channel, layout, name, findings) for channel in group]
        signals = np.stack([np.asarray(channel.samples, dtype=np.float64) for channel in group])
        record = make_recording(signals, [c.name for c in group], found, group[0].rate, name, start=group[0].start)
        findings.extend(not_finite(record.signals, name))
        made.append(record)
    return Contents(recordings=tuple(made), findings=tuple(findings), metadata=tuple(metadata))


def _unit(channel: Sampled, layout: Layout, where: str, findings: list[Finding]) -> units.Unit:
    if isinstance(layout.units, Mapping) and channel.name in layout.units:
        return units.parse(layout.units[channel.name])
    unit = units.known(channel.unit) if channel.unit else None
    if channel.unit and unit is None:
        message = f"{channel.unit!r} is not a unit; the numbers are taken without one."
        findings.append(Finding("warning", "unknown-unit", f"{where}, {channel.name}", message))
    return unit or units.parse(units.UNSTATED)
