"""ASAM MDF, versions 3 and 4."""

from pathlib import Path

import numpy as np

from acquisition.contents import Contents
from acquisition.files.layout import Layout
from acquisition.files.quiet import quiet
from acquisition.files.sampled import Sampled, recordings
from acquisition.files.signals import rate_of
from ema.errors import InputError, require


def read(path: Path, layout: Layout) -> Contents:
    """Read the channels that are sampled at a constant rate.

    Raises
    ------
    MissingExtraError : asammdf is not installed.
    InputError : damaged, without channels, or with a time axis that is not even.
    """
    asammdf = require("asammdf", "formats")
    channels = []
    # handed an open file: by name the package may open it for writing
    with quiet("asammdf"), path.open("rb") as raw, asammdf.MDF(raw) as file:
        metadata = [("version", str(file.version)), ("start", str(file.start_time))]
        for signal in file.iter_channels(skip_master=True):
            samples = np.asarray(signal.samples)
            if samples.ndim == 1 and samples.dtype.kind in "biuf" and len(samples) > 1:
                rate = rate_of(np.asarray(signal.timestamps, dtype=np.float64), f"{path.name}, {signal.name}")
                channels.append(Sampled(signal.name, str(signal.unit or ""), samples, rate))
    if not channels:
        raise InputError("no numeric channel in the file", where=path.name)
    return recordings(channels, layout, path.name, metadata)
