"""Releases of the double beam as a laser and an accelerometer at its tip would see them: Figs. 3 and 4 of the paper.

The paper (Gaul, Roseira and Becker 2008) gives no dimensions; they are those of ``datasets/double_beam``. Runs named
``computed`` lack the damping that ``measured_6kN`` has, as the model of the paper does.
"""

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from ema import store
from ema.data import Channel, Damping
from ema.dof import Dof
from ema.progress import Progress, advance, silent
from ema.simulate import FrictionRig, Masing, SnapBack, double_beam

START = datetime(2026, 3, 25, 8, 0, tzinfo=UTC)
SAMPLING_RATE, DURATION, REST = 8192.0, 1.6, 0.3
"""Sampling rate in Hz, length of a record after the release and rest before it in s: chosen, the paper states none."""
LOAD, TIP = 20.0, Dof(20, "+Z", "beam 2")
MATERIAL = 0.001
"""Damping ratio of the sticking beams that the computation lacks."""
STICKING = 31.58
"""Natural frequency in Hz of the sticking beams, for which that ratio holds."""
RUNS: dict[str, tuple[float, float, str]] = {
    "computed_100N": (100.0, 0.0, "displacement"),
    "computed_1kN": (1000.0, 0.0, "displacement"),
    "computed_8kN": (8000.0, 0.0, "displacement"),
    "computed_6kN": (6000.0, 0.0, "velocity"),
    "measured_6kN": (6000.0, MATERIAL, "acceleration"),
}
"""Normal force in N, damping ratio of the material, and what is recorded."""
_NOISE = {"displacement": 2e-7, "velocity": 2e-5, "acceleration": 0.02, "force": 0.01}
_UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s^2"}


def generate(folder: Path, progress: Progress = silent) -> str:
    """Write the records of all runs; returns what is known about the answer, as TOML."""
    for number, (name, (force, ratio, quantity)) in enumerate(RUNS.items()):
        advance(progress, "releasing the virtual double beam", number, len(RUNS))
        damping = Damping(mass_factor=2 * ratio * 2 * np.pi * STICKING)
        sensor = Channel("tip", TIP, quantity=quantity, unit=_UNITS[quantity])  # type: ignore[arg-type]
        rig = FrictionRig(
            double_beam(Masing(0.3, 1e9), force, damping=damping),
            SnapBack(TIP, LOAD, DURATION, pre_trigger=REST),
            (sensor,),
            SAMPLING_RATE,
            noise=_NOISE,
            seed=60 + number,
            name=name,
        )
        record = rig.take(0)
        channels = tuple(replace(channel, dof=None) for channel in record.channels)
        signals = record.signals.astype(np.float32)
        start = START + timedelta(seconds=60 * number)
        store.save(folder / f"{name}.h5", replace(record, signals=signals, channels=channels, start=start))
    return f"sticking = {STICKING}  # Hz\nmissing_damping = {MATERIAL}\nfriction_coefficient = 0.3\n"
