"""Measured loops of a banded rotary friction damper: areas, backlash, and a band tension that is no normal force.

ARTS-Laboratory, Dataset-Friction-Damper-with-Backlash (CC BY-SA 4.0), Lehigh 2023; raw in lb, in and kip. Each record
has seven cycles: two of run-up, two and a half at full amplitude between turning points, the rest runs down.
"""

import re

import numpy as np
import pytest

import acquisition
from ema.simulate import measured_loop

KIP = 4448.2216152605

LISTED = {
    "1Hz36lbtension0.5amplitude": 1.336,
    "1Hz36lbtension1amplitude": 1.944,
    "1Hz36lbtension1.5amplitude": 2.115,
    "2Hz36lbtension0.5amplitude": 1.393,
    "0.5Hz36lbtension1amplitude": 1.973,
    "1Hz30lbtension0.5amplitude": 0.973,
    "1Hz30lbtension1amplitude": 1.290,
    "1Hz30lbtension1.5amplitude": 1.317,
    "2Hz30lbtension0.5amplitude": 1.084,
    "1Hz0lbtension1.5amplitude": 0.468,
}
"""Dissipated energy / (4 x amplitude) in kip as the list of the measurements has it."""

STEADY = {
    "1Hz36lbtension0.5amplitude": 2.254,
    "1Hz36lbtension1amplitude": 2.836,
    "1Hz36lbtension1.5amplitude": 2.887,
    "2Hz36lbtension0.5amplitude": 1.910,
    "0.5Hz36lbtension1amplitude": 2.914,
    "1Hz30lbtension0.5amplitude": 1.499,
    "1Hz30lbtension1amplitude": 1.818,
    "1Hz30lbtension1.5amplitude": 1.764,
    "2Hz30lbtension0.5amplitude": 1.386,
    "1Hz0lbtension1.5amplitude": 0.632,
}
"""The same of the last whole cycles at full amplitude, as found here: a regression, no reference."""


def equivalent_slip_force(loop):
    """Slip force in N of the rigid rectangle with the same energy and amplitude, W / 4A."""
    return loop.area / (4 * loop.amplitude)


class Record:
    """One run of the campaign ``friction_damper``: raw inches, kips and pounds, which the campaign file turns into SI."""

    def __init__(self, campaign, name):
        (take,) = campaign[name].recordings
        assert [(channel.quantity, channel.unit) for channel in take.channels] == [
            ("displacement", "m"),
            ("force", "N"),
            ("velocity", "m/s"),
            ("force", "N"),
            ("force", "N"),
        ]
        self.name, self.frequency = name, float(re.match(r"[\d.]+", name).group())
        self.times = np.arange(take.signals.shape[1]) / take.sampling_rate
        self.x, self.f, _, *ends = take.signals
        self.tension = np.mean(ends, axis=0)

    def loop(self, part=slice(None), sign=1.0, **options):
        return measured_loop(
            self.times[part],
            self.x[part],
            sign * self.f[part],
            self.frequency,
            self.tension[part],
            name=self.name,
            **options,
        )

    def before_end(self, seconds, periods=3):
        end = self.times[-1] - seconds
        return (self.times <= end) & (self.times > end - periods / self.frequency)


@pytest.fixture
def campaign(root, datasets, monkeypatch):
    monkeypatch.setenv("EMA_DATASETS", str(datasets))
    return acquisition.open_campaign(root / "datasets" / "friction_damper")


@pytest.fixture(params=LISTED)
def record(request, campaign):
    return Record(campaign, request.param)


def test_listed_values_are_three_periods_that_end_a_fifth_of_a_second_before_the_record(record):
    """All ten to the printed digits (0.1 %; asked are 3 %): that is how the list was computed.

    t_end - 0.2 s - 3/f < t <= t_end - 0.2 s for every frequency, the integral of F du by the trapezoidal rule over the
    path as it is, not closed, over three, and half the range of this window as amplitude. So the "last three cycles" of
    the list hold a part of the run-down. Closing the path would change them by up to 13 %, a hundredth of a second less
    trimmed moves the 2 Hz records by 1.2 % and 2.5 %.
    """
    found = record.loop(record.before_end(0.2), steady=False)
    assert found.cycles == 3
    if record.frequency == 2.0:
        shifted = record.loop(record.before_end(0.19), steady=False)
        assert abs(equivalent_slip_force(shifted) / KIP / LISTED[record.name] - 1) > 0.01
    assert equivalent_slip_force(found) / KIP == pytest.approx(LISTED[record.name], rel=1e-3)


def test_no_definition_by_whole_cycles_gives_the_listed_values(campaign):
    """Evidence: the last three cycles of the record, of the steady motion, and between zero crossings."""
    worst = dict.fromkeys(("record", "steady", "zero crossings"), 0.0)
    for name, listed in LISTED.items():
        record = Record(campaign, name)
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
        np.corrcoef(
            *(
                a[(record.times > 2 / record.frequency) & (record.times < 5 / record.frequency)]
                for a in (record.tension, np.abs(record.f))
            )
        )[0, 1],
        abs=0.05,
    )
    assert finding.value > 0.8
