"""Wave audio; it knows no unit, so the numbers are fractions of full scale."""

from pathlib import Path

import numpy as np

from acquisition.contents import Contents
from acquisition.files.arrays import Arrays, not_finite
from acquisition.files.layout import Layout
from acquisition.files.signals import channel_units, make_recording
from ema.data import Finding
from ema.errors import require


def read(path: Path, layout: Layout) -> Contents:
    """Read all channels.

    Raises
    ------
    MissingExtraError : soundfile is not installed.
    InputError : damaged.
    """
    soundfile = require("soundfile", "formats")
    signals, rate = soundfile.read(str(path), dtype="float64", always_2d=True)
    pool = Arrays(path.name, {"": signals})
    names = [f"channel {number + 1}" for number in range(signals.shape[1])]
    if layout.names is not None:
        names = pool.texts(layout.names)
    record = make_recording(
        np.ascontiguousarray(signals.T), names, channel_units(pool, layout, names), float(rate), path.name
    )
    note = Finding(
        "info", "full-scale", path.name, "the numbers of a wave file are fractions of full scale.",
        advice="Say units or sensitivities in the channel table.",
    )  # fmt: skip
    notes = () if layout.units is not None else (note,)
    return Contents(recordings=(record,), findings=(*notes, *not_finite(record.signals, path.name)))
