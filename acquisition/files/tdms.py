"""LabVIEW TDMS."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from acquisition.contents import Contents
from acquisition.files.layout import Layout
from acquisition.files.quiet import quiet
from acquisition.files.sampled import Sampled, recordings
from acquisition.files.signals import nice_rate
from ema.data import Finding
from ema.errors import InputError, require


def read(path: Path, layout: Layout) -> Contents:
    """Read the waveform channels; those without a time step need ``sampling_rate`` of the layout.

    Raises
    ------
    MissingExtraError : nptdms is not installed.
    InputError : damaged, without channels, or without a time step.
    """
    nptdms = require("nptdms", "formats")
    channels = []
    with quiet("nptdms"), nptdms.TdmsFile.read(str(path)) as file:
        cut = bool(file.file_status.incomplete_final_segment)
        metadata = [(str(key), str(value)) for key, value in file.properties.items()]
        groups = file.groups()
        for group in groups:
            for channel in group.channels():
                if len(channel) == 0 or np.asarray(channel[:1]).dtype.kind not in "biuf":
                    continue
                step = channel.properties.get("wf_increment") or 0.0
                rate = nice_rate(float(step), 1e-9) if step else layout.sampling_rate
                if not isinstance(rate, (int, float)):
                    raise InputError(
                        "the channel has no time step",
                        where=f"{path.name}, {channel.name}",
                        advice="say sampling_rate=... [Hz]",
                    )
                name = channel.name if len(groups) == 1 else f"{group.name}/{channel.name}"
                unit = str(channel.properties.get("unit_string") or channel.properties.get("Unit") or "")
                channels.append(Sampled(name, unit, channel[:], float(rate)))
    if not channels:
        raise InputError("no numeric channel in the file", where=path.name)
    contents = recordings(channels, layout, path.name, metadata)
    if not cut:
        return contents
    note = Finding(
        "error", "damaged-set", path.name, "the last segment of the file is not complete; it is truncated.",
        advice="Export the file again.",
    )  # fmt: skip
    return replace(contents, findings=(note, *contents.findings))
