"""Joint parameters from hysteresis loops: synthetic loops with noise, and measured ones.

Measured: ARTS-Laboratory, Dataset-Friction-Damper-with-Backlash (CC BY-SA 4.0): banded rotary friction device, raw in
lb, in and kip; its band tension is no normal force, and its loops have play.
"""

import gzip
import json
import re

import numpy as np
import pytest

from ema.data import Loop
from ema.errors import InputError
from ema.simulate import RegularisedMasing, identify, measured_loop
from ema.simulate.hysteresis import equivalent_slip_force
from ema.simulate.loops import drive

INCH, KIP, POUND = 0.0254, 4448.2216, 4.4482216


def noisy_loops(seed, noise=0.01, mu=0.22, stiffness=3e7, alpha=0.55, exponent=8.0):
    generator = np.random.default_rng(seed)
    loops = []
    for normal in (300.0, 800.0, 2000.0, 5000.0):
        law = RegularisedMasing(mu, stiffness * (normal / 1000) ** alpha, exponent)
        amplitude = 3 * mu * normal / law.contact_stiffness
        t = np.arange(3 * 1000) / 1000
        x = amplitude * np.sin(2 * np.pi * t)
        f = drive(law, np.concatenate([x, x]), normal)[len(x) :]
        x = x + noise * amplitude * generator.standard_normal(len(x))
        f = f + noise * mu * normal * generator.standard_normal(len(f))
        loops.append(Loop(x, f, 0.0, amplitude, 3, normal))
    return loops


@pytest.mark.parametrize("seed", [1, 2])
def test_parameters_from_loops_with_one_percent_noise(seed):
    found = identify(noisy_loops(seed))
    assert found.friction_coefficient == pytest.approx(0.22, rel=0.02)
    assert found.contact_stiffness == pytest.approx(3e7, rel=0.02)
    assert found.stiffness_exponent == pytest.approx(0.55, abs=0.03)
    assert found.exponent == pytest.approx(8.0, abs=1.0)
    low, high = found.friction_interval
    assert low < 0.22 < high and high - low < 0.02 * 0.22


def test_loops_that_do_not_slide_are_said_to():
    law = RegularisedMasing(0.2, 1e7, 8)
    x = 0.5 * 0.2 * 1000 / 1e7 * np.sin(2 * np.pi * np.arange(1000) / 1000)
    stuck = Loop(x, drive(law, np.concatenate([x, x]), 1000.0)[1000:], 0.0, float(x.max()), 1, 1000.0, name="small")
    found = identify([*noisy_loops(3)[:2], stuck])
    assert [finding.code for finding in found.findings] == ["no-slip"]
    assert len(found.loops) == 2
    with pytest.raises(InputError, match="no loop slides"):
        identify([stuck])
    with pytest.raises(InputError, match="without normal force"):
        identify([Loop(x, x, 0.0, 1.0, 1)])
    with pytest.raises(InputError, match="less than one cycle"):
        measured_loop(np.arange(10) / 10, np.sin(np.arange(10.0)), np.zeros(10), 0.1)


LISTED = {
    "1Hz36lbtension0.5amplitude": 1.336, "1Hz36lbtension1amplitude": 1.944, "1Hz36lbtension1.5amplitude": 2.115,
    "2Hz36lbtension0.5amplitude": 1.393, "0.5Hz36lbtension1amplitude": 1.973, "1Hz30lbtension0.5amplitude": 0.973,
    "1Hz30lbtension1amplitude": 1.290, "1Hz30lbtension1.5amplitude": 1.317, "2Hz30lbtension0.5amplitude": 1.084,
    "1Hz0lbtension1.5amplitude": 0.468,
}  # fmt: skip


@pytest.mark.parametrize("record", LISTED)
def test_measured_loops(datasets, record):
    path = datasets / "09_friction_damper_band_tension" / f"dataset-2_{record}.json.gz"
    raw = json.loads(gzip.decompress(path.read_bytes()))
    table = np.array(raw["data"])
    assert (raw["displacement units"], raw["friction force units"], raw["actuator force units"]) == ("in", "kip", "lb")
    frequency = float(re.match(r"[\d.]+", record).group())
    tension = 0.5 * (table[:, 4] + table[:, 5]) * POUND
    # the listed values are means over three periods that end 0.2 s before the record does, with the run-down in them
    kept = table[:, 0] <= table[-1, 0] - 0.2
    table, tension = table[kept], tension[kept]
    found = measured_loop(table[:, 0], table[:, 1] * INCH, table[:, 2] * KIP, frequency, tension, 3, False, record)
    assert equivalent_slip_force(found) / KIP == pytest.approx(LISTED[record], rel=0.03)
    assert "run-down" in {finding.code for finding in found.findings}
    steady = measured_loop(table[:, 0], table[:, 1] * INCH, table[:, 2] * KIP, frequency, tension, 2, True, record)
    assert equivalent_slip_force(steady) > 1.2 * equivalent_slip_force(found)
    assert {"run-down", "normal-force-swings"} <= {finding.code for finding in steady.findings}
    assert "normal-force-swings" in {finding.code for finding in found.findings}
    reversed_ = measured_loop(table[:, 0], table[:, 1] * INCH, -table[:, 2] * KIP, frequency, tension, 3, False, record)
    assert reversed_.area == pytest.approx(found.area, rel=1e-9)
    assert ("force-sign" in {f.code for f in found.findings}) != ("force-sign" in {f.code for f in reversed_.findings})
