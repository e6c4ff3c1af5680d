"""ASAM MDF, versions 3 and 4."""

from pathlib import Path
from typing import Any

import numpy as np

from acquisition.contents import Contents
from acquisition.files.layout import Layout
from acquisition.files.quiet import quiet
from acquisition.files.sampled import Sampled, recordings
from acquisition.files.signals import rate_of
from acquisition.isolated import call
from ema.errors import InputError, require


def read(path: Path, layout: Layout) -> Contents:
    """Read the channels that are sampled at a constant rate.

    Raises
    ------
    MissingExtraError : asammdf is not installed.
    InputError : damaged, without channels, or with a time axis that is not even.
    """
    there = call("mdf4", path)
    if not there["channels"]:
        raise InputError("no numeric channel in the file", where=path.name)
    sampled = [Sampled(one["name"], one["unit"], one["samples"], one["rate"]) for one in there["channels"]]
    return recordings(sampled, layout, path.name, [(name, text) for name, text in there["metadata"]])


def channels(path: Path) -> dict[str, Any]:
    """The ``channels`` of a file, each with ``name``, ``unit``, ``samples`` and ``rate`` in Hz, and its ``metadata``.

    Raises
    ------
    InputError : a time axis that is not even.
    """
    asammdf = require("asammdf", "formats")
    found = []
    # handed an open file: by name the package may open it for writing
    with quiet("asammdf"), path.open("rb") as raw, asammdf.MDF(raw) as file:
        metadata = [("version", str(file.version)), ("start", str(file.start_time))]
        for signal in file.iter_channels(skip_master=True):
            samples = np.asarray(signal.samples)
            if samples.ndim == 1 and samples.dtype.kind in "biuf" and len(samples) > 1:
                rate = rate_of(np.asarray(signal.timestamps, dtype=np.float64), f"{path.name}, {signal.name}")
                found.append(
                    {"name": str(signal.name), "unit": str(signal.unit or ""), "samples": samples, "rate": rate}
                )
    return {"channels": found, "metadata": metadata}
