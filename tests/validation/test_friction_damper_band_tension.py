"""Measured loops of a banded rotary friction damper: areas, backlash, and a band tension that is no normal force.

ARTS-Laboratory, Dataset-Friction-Damper-with-Backlash (CC BY-SA 4.0), Lehigh 2023; raw in lb, in and kip. Each record
has seven cycles: two of run-up, two and a half at full amplitude between turning points, the rest runs down.
"""

import gzip
import json
import re

import numpy as np
import pytest

from ema.simulate import measured_loop
from ema.simulate.hysteresis import equivalent_slip_force

INCH, KIP, POUND = 0.0254, 4448.2216, 4.4482216

LISTED = {
    "1Hz36lbtension0.5amplitude": 1.336, "1Hz36lbtension1amplitude": 1.944, "1Hz36lbtension1.5amplitude": 2.115,
    "2Hz36lbtension0.5amplitude": 1.393, "0.5Hz36lbtension1amplitude": 1.973, "1Hz30lbtension0.5amplitude": 0.973,
    "1Hz30lbtension1amplitude": 1.290, "1Hz30lbtension1.5amplitude": 1.317, "2Hz30lbtension0.5amplitude": 1.084,
    "1Hz0lbtension1.5amplitude": 0.468,
}  # fmt: skip
"""Dissipated energy / (4 x amplitude) in kip as the list of the measurements has it."""

STEADY = {
    "1Hz36lbtension0.5amplitude": 2.254, "1Hz36lbtension1amplitude": 2.836, "1Hz36lbtension1.5amplitude": 2.887,
    "2Hz36lbtension0.5amplitude": 1.910, "0.5Hz36lbtension1amplitude": 2.914, "1Hz30lbtension0.5amplitude": 1.499,
    "1Hz30lbtension1amplitude": 1.818, "1Hz30lbtension1.5amplitude": 1.764, "2Hz30lbtension0.5amplitude": 1.386,
    "1Hz0lbtension1.5amplitude": 0.632,
}  # fmt: skip
"""The same of the last whole cycles at full amplitude, as found here: a regression, no reference."""


class Record:
    """One file in SI."""

    def __init__(self, folder, name):
        raw = json.loads(gzip.decompress((folder / f"dataset-2_{name}.json.gz").read_bytes()))
        assert (raw["displacement units"], raw["friction force units"], raw["actuator force units"]) == (
            "in", "kip", "lb",
        )  # fmt: skip
        table = np.array(raw["data"])
        self.name, self.frequency = name, float(re.match(r"[\d.]+", name).group())
        self.times, self.x, self.f = table[:, 0], table[:, 1] * INCH, table[:, 2] * KIP
        self.tension = 0.5 * (table[:, 4] + table[:, 5]) * POUND

    def loop(self, part=slice(None), sign=1.0, **options):
        return measured_loop(self.times[part], self.x[part], sign * self.f[part], self.frequency, self.tension[part],
                             name=self.name, **options)  # fmt: skip

    def before_end(self, seconds, periods=3):
        end = self.times[-1] - seconds
        return (self.times <= end) & (self.times > end - periods / self.frequency)


@pytest.fixture(params=LISTED)
def record(request, datasets):
    return Record(datasets / "09_friction_damper_band_tension", request.param)


def test_listed_values_are_three_periods_that_end_a_fifth_of_a_second_before_the_record(record):
    """All ten to the printed digits (0.1 %; asked are 3 %), with the amplitude of those three periods.

    So the "last three cycles" of the list hold the run-down. The window is sharp: a hundredth of a second more or less
    moves the 2 Hz records by 2.5 %.
    """
    found = record.loop(record.before_end(0.2), steady=False)
    assert found.cycles == 3
    assert equivalent_slip_force(found) / KIP == pytest.approx(LISTED[record.name], rel=1e-3)


def test_no_definition_by_whole_cycles_gives_the_listed_values(datasets):
    """Evidence: the last three cycles of the record, of the steady motion, and between zero crossings."""
    worst = dict.fromkeys(("record", "steady", "zero crossings"), 0.0)
    for name, listed in LISTED.items():
        record = Record(datasets / "09_friction_damper_band_tension", name)
        middle = 0.5 * (record.x.max() + record.x.min())
        rising = np.flatnonzero((record.x[:-1] < middle) & (record.x[1:] >= middle))
        whole = slice(rising[-4], rising[-1] + 1)
        for kind, loop in (
            ("record", record.loop(steady=False)),
            ("steady", record.loop()),
            ("zero crossings", record.loop(whole, steady=False)),
        ):
            worst[kind] = max(worst[kind], abs(equivalent_slip_force(loop) / KIP / listed - 1))
    assert min(worst.values()) > 0.1


def test_steady_cycles(record):
    """What a designer needs: the dissipation at full amplitude is 1.2 to 1.7 times the listed one."""
    found = record.loop()
    assert found.cycles == 2
    assert equivalent_slip_force(found) / KIP == pytest.approx(STEADY[record.name], rel=1e-3)
    assert 1.2 < equivalent_slip_force(found) / KIP / LISTED[record.name] < 1.72
    one = record.loop(cycles=1)
    assert one.area == pytest.approx(found.area, rel=0.1)


def test_what_is_suspicious_is_said(record):
    codes = {finding.code for finding in record.loop().findings}
    assert {"run-down", "backlash", "normal-force-swings", "no-normal-force"} <= codes
    part = record.before_end(0.2)
    forward, backward = (record.loop(part, sign, steady=False) for sign in (1.0, -1.0))
    assert backward.area == pytest.approx(forward.area, rel=1e-9)
    assert len({"force-sign" in {f.code for f in loop.findings} for loop in (forward, backward)}) == 2


def test_tension_follows_friction(record):
    """The finding's number: the mean tension of the band ends goes with the size of the friction force."""
    finding = next(f for f in record.loop().findings if f.code == "no-normal-force")
    assert finding.value == pytest.approx(
        np.corrcoef(*(a[(record.times > 2 / record.frequency) & (record.times < 5 / record.frequency)]
                      for a in (record.tension, np.abs(record.f))))[0, 1], abs=0.05
    )  # fmt: skip
    assert finding.value > 0.8
