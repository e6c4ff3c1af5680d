"""Normal force per joint: from a channel, from side data, stated, unknown; and what is wrong with it."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

import acquisition
from acquisition.force import Trace, drift
from acquisition.force_drift import drift_findings
from acquisition.force_levels import against_nominal_levels
from ema import store
from ema.data import Campaign, Channel, Condition, Finding, JointForce, Recording, Run
from ema.errors import InputError

START = datetime(2026, 11, 21, 10, 0, tzinfo=UTC)
BASE = """
[campaign]
name = "test"
files = "raw"

[[channels]]
name = "hammer"
role = "reference"
unit = "N"

[[joints]]
name = "J1"
load_cell = "ring 7"
calibrated_on = 2026-01-10

[[runs]]
id = "beam"
kind = "hammer"
files = "beam_{point}.h5"
"""


def opened(path: Path, text: str, side: str = "", base: str = BASE, signals: "list[np.ndarray] | None" = None) -> Run:
    (path / "raw").mkdir(exist_ok=True)
    (path / "campaign.toml").write_text(base + text)
    (path / "rings.csv").write_text(side)
    for number, signal in enumerate(signals or [np.zeros(1000), np.zeros(1000)]):
        start = START + timedelta(seconds=60 * number)
        take = Recording(np.array([signal, signal]), 100.0, (Channel("hammer"), Channel("ring")), start)
        store.save(path / "raw" / f"beam_{number + 1}.h5", take)
    return acquisition.open_campaign(path)["beam"]


def force(text: str, joint: str = "J1") -> str:
    return f'[[runs.normal_force]]\njoint = "{joint}"\n{text}\n'


def codes(run: Run) -> list[str]:
    return [finding.code for finding in run.findings]


def test_a_bare_structure_has_no_joints(tmp_path: Path) -> None:
    for text in ("", "beam = false\n"):
        run = opened(tmp_path, text)
        assert run.condition.joints == () and run.findings == ()


def test_a_stated_force_with_its_circumstances(tmp_path: Path) -> None:
    text = 'value = "1.02 kN"\nstd = "0.03 kN"\ntorque = "12 N m"\nsequence = "up"\nrun_in = 20'
    run = opened(tmp_path, force(text))
    joint = run.condition.joints[0]
    assert (joint.joint, joint.mean, joint.std, joint.torque, joint.sequence, joint.run_in) == (
        "J1",
        1020.0,
        pytest.approx(30.0),
        12.0,
        "up",
        20,
    )
    assert joint.calibration == "ring 7, calibrated on 2026-01-10" and codes(run) == []


@pytest.mark.parametrize("text", ["beam = true\n", force(""), force('torque = "12 N m"')])
def test_an_unknown_force_is_admitted_with_a_finding(tmp_path: Path, text: str) -> None:
    run = opened(tmp_path, text)
    assert not run.condition.joints[0].known and codes(run) == ["normal-force-unknown"]
    assert run.findings[0].severity == "error"


def test_a_joint_of_the_campaign_that_the_run_forgets_is_unknown(tmp_path: Path) -> None:
    base = BASE.replace("[[runs]]", '[[joints]]\nname = "J2"\n\n[[runs]]')
    run = opened(tmp_path, force('value = "1 kN"'), base=base)
    assert [(joint.joint, joint.known) for joint in run.condition.joints] == [("J1", True), ("J2", False)]
    assert codes(run) == ["normal-force-unknown"] and "J2" in run.findings[0].where


def test_a_channel_of_the_record_is_reduced(tmp_path: Path) -> None:
    """A ramp from 990 to 1010 N over two records, one minute apart."""
    base = BASE.replace(
        "[[joints]]", '[[channels]]\nname = "ring"\nrole = "normal force"\njoint = "J1"\nunit = "kN"\n\n[[joints]]'
    )
    ramp = np.linspace(0.99, 1.01, 2000)
    for text in ("", force('channel = "ring"')):
        run = opened(tmp_path, text, base=base, signals=[ramp[:1000], ramp[1000:]])
        joint = run.condition.joints[0]
        assert joint.mean == pytest.approx(1000.0, abs=1e-9)
        assert joint.std == pytest.approx(float(np.std(1000 * ramp)), rel=1e-9)
        assert joint.trace is not None and joint.trace_times is not None and len(joint.trace) == 128
        assert joint.trace_times[0] == pytest.approx(0.075, abs=0.05) and 69 < joint.trace_times[-1] < 70
        assert joint.drift == pytest.approx(20.0, rel=0.5) and joint.drift > 0


def test_a_channel_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match="no such normal-force channel in the record; got ring 9, expected one of hammer"
    ):
        opened(tmp_path, force('channel = "ring 9"'))


SIDE = 'file = "rings.csv"\ncolumn = "J1"\nunit = "kN"\n'


def test_side_data_without_clock_are_used_whole(tmp_path: Path) -> None:
    run = opened(tmp_path, force(SIDE + 'time = "t"\ntime_unit = "min"'), "t;J1\n0;0,98\n1;1,00\n2;1,02\n")
    joint = run.condition.joints[0]
    assert joint.mean == pytest.approx(1000.0) and joint.drift == pytest.approx(40.0)
    np.testing.assert_allclose(joint.trace_times, [0.0, 60.0, 120.0])


@pytest.mark.parametrize("clock", ["stamps", "start"])
def test_side_data_with_a_clock_are_cut_to_the_run(tmp_path: Path, clock: str) -> None:
    """The run lasts from 10:00:00 to 10:01:10; before and after it the joint had another force."""
    seconds = np.arange(-100, 200, 10)
    values = np.where((seconds >= 0) & (seconds <= 70), 500.0, 3.0)
    if clock == "stamps":
        stamps = [(START + timedelta(seconds=int(each) + 3600)).strftime("%Y-%m-%dT%H:%M:%S+01:00") for each in seconds]
        text = force(SIDE.replace("kN", "N") + 'time = "t"')
    else:
        stamps = [str(each + 100) for each in seconds]
        text = force(SIDE.replace("kN", "N") + 'time = "t"\ntime_unit = "s"\nstart = 2026-11-21T09:58:20Z')
    side = "t,J1\n" + "\n".join(f"{stamp},{value}" for stamp, value in zip(stamps, values, strict=True))
    joint = opened(tmp_path, text, side).condition.joints[0]
    assert joint.mean == 500.0 and joint.std == 0.0
    np.testing.assert_allclose(joint.trace_times, np.arange(0, 71, 10))


def test_a_stretch_of_the_side_data(tmp_path: Path) -> None:
    text = force(SIDE + 'time = "t"\ntime_unit = "s"\nbetween = ["1 min", "2 min"]')
    joint = opened(tmp_path, text, "t,J1\n0,9\n60,1\n120,1\n180,9\n").condition.joints[0]
    assert joint.mean == 1000.0 and joint.trace_times is not None and joint.trace_times.tolist() == [0.0, 60.0]


@pytest.mark.parametrize(
    ("text", "side", "message"),
    [
        (SIDE, "t,J2\n0,1\n", "no such column; got J1, expected one of t, J2"),
        (SIDE, "", "the table is empty"),
        (SIDE, "t,J1\n0,much\n", "not a number; got 'much'"),
        (SIDE.replace("rings", "ring"), "", "there is no such file"),
        (SIDE + 'time = "t"', "t,J1\n0,1\n", "the time column has no unit"),
        (
            SIDE + 'time = "t"\ntime_unit = "s"\nbetween = ["5 s", "6 s"]',
            "t,J1\n0,1\n",
            "no normal force within the time",
        ),
        (SIDE + 'time = "t"', "t,J1\n2026-11-20T10:00:00Z,1\n", "no normal force within the time"),
        (SIDE.replace("kN", "kg"), "", "unit"),
        (SIDE + 'value = "1 kN"', "", "state one"),
        ('file = "rings.csv"\ncolumn = "J1"', "", "side data have no unit"),
    ],
)
def test_side_data_that_cannot_be_used_are_refused(tmp_path: Path, text: str, side: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        opened(tmp_path, force(text), side)
    assert len(str(caught.value).splitlines()) == 1


def test_drift_that_changes_damping_by_more_than_its_interval_is_a_finding(tmp_path: Path) -> None:
    """A change by 0.9 % does to the damping of a joint what the intervals of a test hold."""
    for end, expected in ((1009, []), (1060, ["normal-force-drift"])):
        side = "J1\n" + "\n".join(str(value) for value in np.linspace(1000, end, 101))
        run = opened(tmp_path, force(SIDE.replace("kN", "N")), side)
        assert codes(run) == expected
    finding = run.findings[0]
    assert finding.limit == 0.01 and finding.value == pytest.approx(60 * 0.9 / 1030, rel=0.02)


def load_cell(rng: np.random.Generator) -> np.ndarray:
    """Block means (64 of each record) of a constant force of 1 N: white and flicker noise, ripple of the shaker."""
    rate, records, seconds = 1000.0, int(rng.integers(1, 6)), float(np.exp(rng.uniform(np.log(2), np.log(16))))
    samples = int(rate * seconds)
    spectrum = rng.standard_normal((2, 2 * samples * records + 1))
    slow = np.fft.irfft((spectrum[0] + 1j * spectrum[1])[1:] / np.sqrt(np.arange(1, 2 * samples * records + 1)))
    slow = (slow - slow[: samples * records].mean())[: samples * records]
    time, low = np.arange(samples) / rate, float(np.exp(rng.uniform(np.log(10), np.log(80))))
    high = low if rng.random() < 0.5 else 0.4 * rate
    ripple = np.sin(2 * np.pi * (low * time + 0.5 * (high - low) * time**2 / seconds))
    white, flicker, moving = np.exp(rng.uniform(np.log([1e-3, 2e-4, 1e-3]), np.log([0.03, 0.01, 0.1])))
    signal = 1 + white * rng.standard_normal(samples * records) + flicker * slow / np.std(slow)
    signal += moving * np.tile(ripple, records)
    edges = np.concatenate([k * samples + np.linspace(0, samples, 65)[:-1].astype(int) for k in range(records)])
    return np.asarray(np.add.reduceat(signal, edges) / np.diff([*edges, len(signal)]))


def drifts(trace: np.ndarray, together: int | None = 6) -> list[Finding]:
    times = np.arange(len(trace), dtype=float)
    mean, std = float(np.mean(trace)), float(np.std(trace))
    ended = drift(Trace(times, trace, mean, std))
    return list(drift_findings(JointForce("J1", mean, std, ended, trace, times), "run", together))


def test_a_constant_force_with_the_noise_of_a_load_cell_did_not_drift() -> None:
    rng = np.random.default_rng(7300021)
    traces = [load_cell(rng) for _ in range(200)]
    assert sum(bool(drifts(trace)) for trace in traces) <= 2
    drifted = [drifts(trace + 0.03 * np.linspace(-0.5, 0.5, len(trace))) for trace in traces]
    assert sum(map(bool, drifted)) > 150


def test_a_drift_of_three_per_cent_that_is_thirty_times_the_scatter_is_named() -> None:
    rng = np.random.default_rng(7300022)
    for count in (12, 20, 64, 640):
        trace = 1000 + np.linspace(-15, 15, count) + rng.standard_normal(count)
        (found,) = drifts(trace, 6 if count >= 64 else None)
        assert found.value == pytest.approx(0.027, abs=0.004) and "its scatter explains" in found.message


def test_scatter_between_joints_above_ten_per_cent_is_a_finding(tmp_path: Path) -> None:
    base = BASE.replace("[[runs]]", '[[joints]]\nname = "J2"\n\n[[runs]]')
    for second, expected in (("1.2 kN", []), ("1.25 kN", ["normal-force-scatter"])):
        run = opened(tmp_path, force('value = "1 kN"') + force(f'value = "{second}"', "J2"), base=base)
        assert codes(run) == expected
    assert run.findings[0].value == pytest.approx(0.125 / 1.125)


def test_kilonewtons_taken_for_newtons_are_noticed(tmp_path: Path) -> None:
    side = "J1\n" + "1.01\n" * 20
    run = opened(tmp_path, force(SIDE.replace("kN", "N") + 'nominal = "1 kN"'), side)
    assert codes(run) == ["normal-force-unit"] and "as if kN had been taken for N" in run.findings[0].message
    assert run.findings[0].value == pytest.approx(1.01e-3)
    jumping = "J1\n" + "1010\n" * 15 + "1.01\n" * 5
    run = opened(tmp_path, force(SIDE.replace("kN", "N")), jumping)
    assert codes(run)[0] == "normal-force-unit" and "25 %" in run.findings[0].message
    assert codes(opened(tmp_path, force(SIDE + 'nominal = "1 kN"'), side)) == []


def test_a_joint_that_would_be_pulled_apart_is_a_finding(tmp_path: Path) -> None:
    """Load cells often count compression negative."""
    rng = np.random.default_rng(3)
    signals = [-480.0 + rng.standard_normal(1000) for _ in range(2)]
    table = '[[channels]]\nname = "ring"\nrole = "normal force"\nunit = "N"\njoint = "J1"\n\n[[joints]]'
    base = BASE.replace("[[joints]]", table)
    run = opened(tmp_path, "", base=base, signals=signals)
    assert codes(run) == ["normal-force-negative"] and run.findings[0].value == pytest.approx(-480, abs=0.2)
    turned = '[[repairs]]\nwhat = "reverse sign"\nchannel = "ring"\nwho = "A"\nwhy = "compression is negative"\n'
    assert codes(opened(tmp_path, turned, base=base, signals=signals)) == []


@pytest.mark.parametrize("value", [0.0, 500.0])
def test_a_load_cell_that_never_moves_is_a_finding(tmp_path: Path, value: float) -> None:
    table = '[[channels]]\nname = "ring"\nrole = "normal force"\nunit = "N"\njoint = "J1"\n\n[[joints]]'
    run = opened(tmp_path, "", base=BASE.replace("[[joints]]", table), signals=[np.full(1000, value)] * 2)
    assert codes(run) == ["normal-force-constant"]


@pytest.mark.parametrize(("unit", "quantity"), [("V", "voltage"), ("g", "acceleration")])
def test_volts_are_no_normal_force(tmp_path: Path, unit: str, quantity: str) -> None:
    table = f'[[channels]]\nname = "ring"\nrole = "normal force"\nunit = "{unit}"\njoint = "J1"\n\n[[joints]]'
    with pytest.raises(InputError, match=f"channel ring: .* measures no force; got {quantity}, expected force"):
        opened(tmp_path, "", base=BASE.replace("[[joints]]", table))


RING = BASE.replace(
    "[[joints]]", '[[channels]]\nname = "ring"\nrole = "normal force"\nunit = "N"\njoint = "J1"\n\n[[joints]]'
)


def rings(path: Path, *courses: "np.ndarray", text: str = "") -> Run:
    """A run whose load cell saw these courses, with noise of 2 N."""
    rng = np.random.default_rng(5)
    return opened(path, text, base=RING, signals=[course + 2 * rng.standard_normal(len(course)) for course in courses])


FLAT, TIME = np.full(1000, 900.0), np.linspace(0, 1, 1000)
COURSES = {
    "another in the second of three": ((FLAT, 0.8 * FLAT, FLAT), 0.2 * 900 / 840),
    "falls in every record": ((FLAT * (1.1 - 0.2 * TIME),) * 3, 0.18),
    "swings": ((FLAT * (1 + 0.1 * np.sin(6 * np.pi * TIME)),) * 2, 0.19),
}


@pytest.mark.parametrize("name", COURSES)
def test_a_normal_force_that_comes_back_has_moved(tmp_path: Path, name: str) -> None:
    """Only the difference of end and start had counted."""
    courses, expected = COURSES[name]
    run = rings(tmp_path, *courses)
    assert codes(run) == ["normal-force-drift"] and "moved between" in run.findings[0].message
    assert run.findings[0].value == pytest.approx(expected, rel=0.15)


def test_noise_and_vibration_of_a_normal_force_are_no_drift(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    for seconds in (0.6, 3.0, 10.0):
        t = np.arange(int(100 * seconds)) / 100
        course = 900 * (1 + 0.05 * rng.standard_normal(len(t)) + 0.1 * np.sin(2 * np.pi * 31 * t))
        assert codes(rings(tmp_path, course, course[::-1])) == []
    values = 1000 + 30 * rng.standard_normal(20)
    side = "J1\n" + "\n".join(f"{value:.1f}" for value in values)
    assert "moved" not in str(opened(tmp_path, force(SIDE.replace("kN", "N")), side).findings)


def test_a_load_cell_that_shows_nothing_but_noise_is_named(tmp_path: Path) -> None:
    assert codes(rings(tmp_path, 0.01 * TIME, 0.01 * TIME)) == ["normal-force-none"]


def test_samples_that_are_no_numbers_cost_themselves_alone(tmp_path: Path) -> None:
    """The whole mean had been NaN, and the normal force one that nobody stated."""
    gap = np.where((TIME > 0.3) & (TIME < 0.5), np.nan, FLAT)
    run = rings(tmp_path, gap, FLAT)
    assert run.condition.joints[0].mean == pytest.approx(900, abs=0.2) and codes(run) == ["not-finite"]
    assert run.findings[0].value == pytest.approx(0.1, abs=0.002)
    with pytest.raises(InputError, match="holds no numbers"):
        rings(tmp_path, np.nan * FLAT, np.nan * FLAT)


@pytest.mark.parametrize(("nominal", "expected"), [("1 kN", []), ("2 kN", ["normal-force-not-as-stated"])])
def test_a_normal_force_far_from_the_nominal_one_is_named(tmp_path: Path, nominal: str, expected: list[str]) -> None:
    run = rings(tmp_path, FLAT, FLAT, text=force(f'channel = "ring"\nnominal = "{nominal}"'))
    assert codes(run) == expected
    assert not expected or run.findings[0].value == pytest.approx(0.45, rel=0.01)


def test_kilonewtons_of_one_run_are_noticed_by_the_others(tmp_path: Path) -> None:
    more = "".join(
        f'\n[[runs]]\nid = "run {n}"\nkind = "hammer"\nfiles = "beam_{{point}}.h5"\n' + force(f'value = "{value} N"')
        for n, value in enumerate((300, 1000, 0.6))
    )
    opened(tmp_path, force('value = "100 N"') + more)
    runs = acquisition.open_campaign(tmp_path).runs
    assert [codes(run) for run in runs] == [[], [], [], ["normal-force-unit"]]
    opened(
        tmp_path, force('value = "1 N"') + more.replace('"300', '"10').replace('"1000', '"3000').replace("0.6", "100")
    )
    assert not any(codes(run) for run in acquisition.open_campaign(tmp_path).runs)


def levels(path: Path, nominal: "list[float]", measured: "list[float]") -> Campaign:
    """A campaign whose runs have these nominal normal forces and side data with these means, in N."""
    base = BASE[: BASE.index("[[runs]]")]
    (path / "raw").mkdir(exist_ok=True)
    take = Recording(np.zeros((1, 100)), 100.0, (Channel("hammer"),), START)
    rng = np.random.default_rng(8)
    for number, (stated, mean) in enumerate(zip(nominal, measured, strict=True)):
        store.save(path / "raw" / f"{number}.h5", replace(take, start=START + timedelta(seconds=60 * number)))
        values = mean + 1e-3 * mean * rng.standard_normal(20)
        (path / f"{number}.csv").write_text("J1\n" + "\n".join(f"{value:.4f}" for value in values))
        base += f'[[runs]]\nid = "run {number}"\nkind = "hammer"\nfiles = "{number}.h5"\n'
        base += force(f'file = "{number}.csv"\ncolumn = "J1"\nunit = "N"\nnominal = "{stated} N"')
    (path / "campaign.toml").write_text(base)
    return acquisition.open_campaign(path)


def every(campaign: Campaign) -> list[str]:
    return [one.code for one in (*campaign.findings, *(one for run in campaign.runs for one in run.findings))]


@pytest.mark.parametrize("seed", [7300031, 7300032, 7300033])
def test_a_zero_of_the_load_cell_is_named_with_its_interval(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    nominal = [100.0, 200.0, 400.0, 800.0, 1600.0]
    zero, gain = rng.choice([-1, 1]) * rng.uniform(40, 60), rng.uniform(0.97, 1.03)
    measured = [gain * force * (1 + 0.005 * rng.standard_normal()) + zero for force in nominal]
    campaign = levels(tmp_path, nominal, measured)
    assert every(campaign) == ["normal-force-zero"]
    (found,) = campaign.findings
    assert found.value is not None and found.limit is not None
    assert abs(found.value - zero) < 2 * found.limit and found.limit < 0.3 * abs(zero)
    assert "joint J1" in found.where and " ± " in found.message


def test_runs_at_one_setting_count_once_for_the_zero() -> None:
    """A bolt that is off by a fifth is so in all runs of its level: twelve runs are no twelve levels."""
    rng = np.random.default_rng(7300034)
    named = 0
    for _ in range(300):
        count = int(rng.integers(3, 7))
        nominal = np.sort(rng.choice(np.geomspace(50, 3000, 12), count, replace=False))
        scatter = np.exp(rng.uniform(np.log(0.01), np.log(0.2)))
        set_to = nominal * rng.uniform(0.9, 1.1) * (1 + scatter * rng.standard_normal(count))
        runs = [(n, k, level) for n, level in enumerate(nominal) for k in range(3)]
        measured = [
            Run(
                f"{n} {k}",
                Condition(joints=(JointForce("J1", abs(set_to[n]) * (1 + 1e-3 * rng.standard_normal())),)),
            )
            for n, k, _ in runs
        ]
        stated = {f"{n} {k}": {"J1": float(level)} for n, k, level in runs}
        named += len(against_nominal_levels(measured, stated)[1])
    assert named <= 9, "one in a hundred by its threshold"


def test_exchanged_files_are_named_once(tmp_path: Path) -> None:
    rng = np.random.default_rng(7300035)
    nominal = [100.0, 200.0, 400.0, 800.0, 1600.0]
    measured = [force * (1 + 0.02 * rng.standard_normal()) for force in nominal]
    assert every(levels(tmp_path, nominal, measured)) == []
    measured[1], measured[3] = measured[3], measured[1]
    campaign = levels(tmp_path, nominal, measured)
    assert every(campaign) == ["normal-force-exchanged"]
    assert "run 1" in campaign.findings[0].message and "run 3" in campaign.findings[0].message
    measured[3] = 300.0
    assert "normal-force-exchanged" not in every(levels(tmp_path, nominal, measured))


def exchanged_by_every_pair(measured: dict[str, dict[str, float]], nominal: dict[str, dict[str, float]]) -> list[str]:
    """Every pair of runs, judged by the median and its scatter over all other runs."""
    found: list[str] = []
    for one, other in combinations(measured, 2):
        rest = [
            np.log(force / nominal[name][joint])
            for name, forces in measured.items()
            for joint, force in forces.items()
            if name not in (one, other)
        ]
        usual = np.median(rest) if len(rest) > 2 else 0.0
        limit = 4 * max(1.4826 * np.median(np.abs(np.array(rest) - usual)) if len(rest) > 2 else 0.1, 0.02)
        offs = {
            (name, stated): [abs(np.log(force / nominal[stated][j]) - usual) for j, force in measured[name].items()]
            for name in (one, other)
            for stated in (one, other)
        }
        fits = [max(offs[pair]) < limit for pair in ((one, other), (other, one))]
        if {one, other}.isdisjoint(found) and all(fits) and min(offs[one, one] + offs[other, other]) > limit:
            found += [one, other]
    return found


def test_exchanged_files_are_found_as_by_looking_at_every_pair() -> None:
    rng, number = np.random.default_rng(7300036), 0
    for _ in range(300):
        count, joints = int(rng.integers(2, 14)), [f"J{j}" for j in range(rng.integers(1, 4))]
        levels = rng.choice(np.geomspace(50, 3000, 8), count)
        nominal = {f"r{run}": dict.fromkeys(joints, float(level)) for run, level in enumerate(levels)}
        scatter, order = np.exp(rng.uniform(np.log(0.002), np.log(0.5))), np.arange(count)
        for _ in range(rng.integers(0, 3)):
            a, b = rng.integers(0, count, 2)
            order[[a, b]] = order[[b, a]]
        measured = {
            f"r{run}": {joint: float(levels[order[run]] * np.exp(scatter * rng.standard_normal())) for joint in joints}
            for run in range(count)
        }
        runs = [
            Run(name, Condition(joints=tuple(JointForce(joint, force) for joint, force in forces.items())))
            for name, forces in measured.items()
        ]
        findings = [one for one in against_nominal_levels(runs, nominal)[1] if one.code == "normal-force-exchanged"]
        named = sorted(name for one in findings for name in one.where.removeprefix("runs ").split(", "))
        assert named == sorted(exchanged_by_every_pair(measured, nominal))
        number += len(named)
    assert number > 100


def stated_forces(path: Path, forces: "list[float]", torque: str = "") -> Campaign:
    """A campaign of runs with these normal forces in N and nothing that says what they should be."""
    (path / "raw").mkdir(exist_ok=True)
    base = BASE[: BASE.index("[[runs]]")]
    for number, value in enumerate(forces):
        store.save(path / "raw" / f"{number}.h5", Recording(np.zeros((1, 100)), 100.0, (Channel("hammer"),)))
        base += f'[[runs]]\nid = "run {number}"\nkind = "hammer"\nfiles = "{number}.h5"\n'
        base += force(f'value = "{value:.6g} N"\n{torque}')
    (path / "campaign.toml").write_text(base)
    return acquisition.open_campaign(path)


def test_kilonewtons_of_several_runs_are_noticed_by_the_others(tmp_path: Path) -> None:
    """Levels measured three times, once in another unit: the wrong runs are each other's neighbours."""
    rng = np.random.default_rng(7300036)
    for draw in range(6):
        levels = np.exp(rng.uniform(np.log(100), np.log(3000), 3))
        forces = np.tile(levels, 3) * (1 + 0.05 * rng.standard_normal(9))
        wrong = [3 * int(rng.integers(3)) + n for n in range(3)]
        forces[wrong] *= 1000.0 if draw % 2 else 0.001
        named = [one.id for one in stated_forces(tmp_path, list(forces)).runs if "normal-force-unit" in codes(one)]
        assert named == [f"run {n}" for n in sorted(wrong)]


def test_campaigns_over_decades_of_force_are_no_matter_of_units(tmp_path: Path) -> None:
    rng = np.random.default_rng(7300037)
    for _ in range(40):
        decades = rng.uniform(0.3, 3.0)
        forces = 10 ** rng.uniform(1, 1 + decades, int(rng.integers(4, 12)))
        assert not every(stated_forces(tmp_path, list(forces)))


def test_kilonewtons_of_one_joint_are_noticed_by_the_others(tmp_path: Path) -> None:
    base = BASE.replace("[[runs]]", '[[joints]]\nname = "J2"\n\n[[runs]]')
    for first, second in (("1.02 kN", "0.9 N"), ("480 N", "0.55 MN")):
        run = opened(tmp_path, force(f'value = "{first}"') + force(f'value = "{second}"', "J2"), base=base)
        assert codes(run) == ["normal-force-unit"]
        assert "J1" in run.findings[0].message and "J2" in run.findings[0].message
    one, other = force('value = "1.02 kN"\nnominal = "1 kN"'), 'value = "0.9 N"\nnominal = "{nominal}"'
    run = opened(tmp_path, one + force(other.format(nominal="1 kN"), "J2"), base=base)
    assert codes(run) == ["normal-force-unit"] and run.findings[0].where == "run beam, joint J2"
    assert codes(opened(tmp_path, one + force(other.format(nominal="1 N"), "J2"), base=base)) == [
        "normal-force-scatter"
    ]


@pytest.mark.parametrize("factor", [0.001, 1000.0])
def test_a_torque_tells_kilonewtons_from_newtons(tmp_path: Path, factor: float) -> None:
    """Bolts from M3 to M24 with friction dry or oiled (nut factor 0.1 to 0.3), one to four of them in a joint."""
    rng = np.random.default_rng(7300038)
    for _ in range(25):
        diameter, nut = rng.choice([3, 4, 5, 6, 8, 10, 12, 16, 20, 24]) / 1000, rng.uniform(0.1, 0.3)
        bolts = int(rng.integers(1, 5))
        torque = np.exp(rng.uniform(np.log(0.5), np.log(300)))
        pressing = bolts * torque / (nut * diameter)
        text = f'torque = "{torque:.4g} N m"'
        assert codes(opened(tmp_path, force(f'value = "{pressing:.5g} N"\n{text}'))) == []
        run = opened(tmp_path, force(f'value = "{factor * pressing:.5g} N"\n{text}'))
        assert codes(run) == ["normal-force-unit"] and "torque" in run.findings[0].message


@pytest.mark.parametrize(("measured", "unit"), [(224.8, "lbf"), (4448.0, "lbf"), (102.0, "kgf"), (9807.0, "kgf")])
def test_another_unit_of_force_is_named_beside_the_nominal_one(tmp_path: Path, measured: float, unit: str) -> None:
    run = opened(tmp_path, force(f'value = "{measured} N"\nnominal = "1 kN"'))
    assert codes(run) == ["normal-force-not-as-stated"] and unit in run.findings[0].advice
    other = opened(tmp_path, force('value = "2000 N"\nnominal = "1 kN"'))
    assert codes(other) == ["normal-force-not-as-stated"] and unit not in other.findings[0].advice


def test_two_levels_a_thousand_apart_that_are_nominal_are_meant(tmp_path: Path) -> None:
    """Sliding at 1 N and stuck at 1 kN."""
    forces = [1.02, 0.97, 1050.0, 980.0, 1010.0]
    campaign = stated_forces(tmp_path, forces)
    assert [codes(run) for run in campaign.runs] == [["normal-force-unit"]] * 2 + [[]] * 3
    assert "nominal" in campaign.runs[0].findings[0].advice
    text = (tmp_path / "campaign.toml").read_text()
    for value in ("1.02", "0.97"):
        text = text.replace(f'value = "{value} N"', f'value = "{value} N"\nnominal = "1 N"')
    (tmp_path / "campaign.toml").write_text(text)
    assert not every(acquisition.open_campaign(tmp_path))
