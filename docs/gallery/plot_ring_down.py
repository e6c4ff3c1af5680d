"""
Damping from one ring-down
==========================

A decay with a damping that falls from 3 % to 1 % as the amplitude falls, read back from the signal alone; and the
Brake-Reuss beam (a bolted lap joint), where its measurement is found in the folder that ``EMA_DATASETS`` names.
"""

import os
from pathlib import Path

import numpy as np

import ema
from ema.data import Channel, Recording
from ema.dof import Dof

rate, times = 4096.0, np.arange(3 * 4096) / 4096.0
amplitude, steps = 1.0, []
for _ in times:
    steps.append(amplitude)
    amplitude *= np.exp(-2 * np.pi * 80.0 * (0.01 + 0.02 * amplitude) / rate)
signal = np.array(steps) * np.cos(2 * np.pi * 80.0 * times)
channel = Channel("acc", Dof(1, "+Z"), "acceleration", unit="m/s^2")
decay = ema.estimate.ring_down(Recording(signal[None], rate, (channel,)), (60.0, 100.0))
made = ema.show.ring_down(decay, unit="m/s²")

# %%
# Ten cycles from the ends of the record, whose band-pass needs some, the damping is the one of the signal.

inside = (decay.times > 10 / 80.0) & (decay.times < 1.0)
error = decay.damping_ratios[inside] - (0.01 + 0.02 * decay.amplitudes[inside])
print(f"largest error of the damping ratio: {100 * np.abs(error).max():.3f} %")
assert np.abs(error).max() < 5e-4

# %%
# The beam: frequency and damping at 7 m/s², as read by a program that shares no code with this one.

place = Path(os.environ.get("EMA_DATASETS", "")) / "01_brake_reuss_beam" / "HammerImpact.mat"
if os.environ.get("EMA_DATASETS") and place.is_file():
    from scipy.io import loadmat

    measured = loadmat(place, squeeze_me=True, struct_as_record=False)["HIdata"].acc1
    beam = ema.estimate.ring_down(Recording(np.asarray(measured, float)[None], 12800.0, (channel,)), (60.0, 110.0))
    real = ema.show.ring_down(beam, unit="m/s²")
    here = int(np.argmin(np.abs(beam.amplitudes - 7.0)))
    print(f"{beam.frequencies[here]:.2f} Hz, {100 * beam.damping_ratios[here]:.3f} %")
    assert abs(beam.frequencies[here] - 80.477) < 0.02
    assert abs(100 * beam.damping_ratios[here] - 0.172) < 0.01
else:
    print("not found here: set EMA_DATASETS to see it")
