"""Recording: takes that are on disk before the next is armed, by the virtual table and by openDAQ's simulated device."""

import errno
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import acquisition
from acquisition import rig_file
from acquisition.live.trigger import Trigger
from acquisition.session import Session
from ema import store
from ema.cli.recording import opened
from ema.data import Channel, Finding, Recording
from ema.datasets import table
from ema.dof import Dof
from ema.errors import FailureError, InputError
from ema.estimate import check_impact
from ema.simulate import RovingHammer, VirtualRig
from ema.simulate.rig import RingCell

RIG = """
[rig]
device = "virtual"
sampling_rate = 4096

[take]
trigger = "hammer > 20 N"
points = [{points}]
takes = {takes}

[campaign]
name = "Recorded"
structure = 'a "table"'

[[channels]]
name = "hammer"
role = "reference"
unit = "N"
dof = "{{point}}:-Z"

[[channels]]
name = "acc 1"
role = "response"
unit = "m/s^2"
dof = "1:+Z"

[[channels]]
name = "acc 2"
role = "response"
unit = "m/s^2"
dof = "67:+Z"

[[channels]]
name = "ring J1"
role = "normal force"
unit = "N"
joint = "J1"

[[joints]]
name = "J1"
load_cell = "ring 17"
"""

SIMULATED = """
[rig]
device = "opendaq:daqref://device0"
sampling_rate = 2000
[rig.properties]
NumberOfChannels = 3
GlobalSampleRate = 2000.0
"RefCh0.Frequency" = 5.0
"RefCh0.Amplitude" = 2.0
"RefCh1.Frequency" = 10.0
"RefCh1.Amplitude" = 1.0
"RefCh2.DC" = 0.51
"RefCh2.Amplitude" = 0.0

[take]
trigger = "hammer > 100 N"
pre_trigger = "20 ms"
duration = "150 ms"
points = [1, 2]
takes = 10

[[channels]]
name = "hammer"
source = "RefCh0"
role = "reference"
sensitivity = "10 mV/N"
dof = "{point}:-Z"

[[channels]]
name = "acc"
source = "RefCh1"
role = "response"
sensitivity = "100 mV/g"
dof = "1:+Z"

[[channels]]
name = "ring"
source = "RefCh2"
role = "normal force"
sensitivity = "0.5 mV/N"
joint = "J1"
"""


def folder_with(path: Path, text: str) -> Path:
    path.mkdir(parents=True, exist_ok=True)
    (path / "rig.toml").write_text(text, encoding="utf-8")
    return path


def virtual(path: Path, points: int = 3, takes: int = 2) -> Path:
    told = ", ".join(str(point) for point in np.linspace(1, 80, points).astype(int)) if points > 3 else "1, 5, 67"
    return folder_with(path, RIG.format(points=told, takes=takes))


def session(folder: Path, judge=check_impact, run: str = "beam") -> Session:
    return Session(folder, rig_file.load(folder), run, judge)


def killed(folder: Path, after: int) -> int:
    """Record in a process that is killed once so many takes are told; how many were told."""
    command = [sys.executable, "-c", "from ema.cli import main; main()", "record", str(folder), "--run", "beam"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=os.environ | {"OMP_NUM_THREADS": "1"})
    told = 0
    for line in process.stdout:
        told += "accepted" in line
        if told >= after:
            break
    process.send_signal(signal.SIGKILL)
    process.wait(30)
    return told


def test_twenty_takes_killed_once_resumed_and_processed_to_modes(tmp_path: Path):
    from ema.fit import modes, stabilise

    folder = virtual(tmp_path / "today", points=20, takes=1)
    told = killed(folder, after=7)
    assert told == 7
    again = session(folder)
    assert told <= again.done <= told + 1, "at most the take in progress is lost, and none that was told"
    takes = list(again.takes(opened(again.rig, again)))
    assert again.done == 20 and again.point is None and all(take.accepted for take in takes)
    campaign = acquisition.open_campaign(folder)
    run = campaign["beam"]
    assert len(run.recordings) == 20
    (joint,) = run.condition.joints
    assert joint.mean == pytest.approx(1020, abs=1) and joint.std == pytest.approx(3, abs=0.5)
    from ema.estimate import hammer

    frfs = hammer(run).band(400, 1100)
    truth = table.with_beam()
    found = modes(frfs, stabilise(frfs, orders=range(2, 31, 2)))
    expected = truth.natural_frequencies[(truth.natural_frequencies > 400) & (truth.natural_frequencies < 1100)]
    np.testing.assert_allclose(found.natural_frequencies, expected, rtol=1e-3)
    journal = (folder / "takes.csv").read_text(encoding="utf-8").splitlines()
    assert len(journal) in (20, 21) and journal[0].endswith("F_N J1 [N],std J1 [N]")


def test_the_normal_force_of_every_joint_is_told_and_kept_with_each_take(tmp_path: Path):
    one = session(virtual(tmp_path))
    for take in one.takes(opened(one.rig, one)):
        mean, std = take.normal_forces["J1"]
        assert mean == pytest.approx(1020, abs=1) and std == pytest.approx(3, abs=0.3)
        held = store.load(take.path)
        assert held.signal("ring J1").mean() == pytest.approx(mean)
    assert one.done == 6


def test_a_rejected_take_is_kept_aside_with_its_reason_and_the_point_is_struck_again(tmp_path: Path):
    """Three takes at point 1 are numbers 1 to 3 whatever became of them: moved by hand, no file lands on another."""
    verdicts = iter([(), (Finding("error", "no-blow", "take", "no blow of this take can be used."),), ()])
    one = session(virtual(tmp_path), lambda record: next(verdicts, ()))
    takes = list(one.takes(opened(one.rig, one)))
    assert [(take.point, take.accepted) for take in takes] == [
        (1, True),
        (1, False),
        (1, True),
        (5, True),
        (5, True),
        (67, True),
        (67, True),
    ]
    assert len(list((tmp_path / "raw").iterdir())) == 6 and len(list((tmp_path / "rejected").iterdir())) == 1
    lines = (tmp_path / "takes.csv").read_text().splitlines()
    assert lines[2].split(",")[0] == "rejected/beam_1_002.h5" and "no,no blow of this take can be used." in lines[2]


def test_a_disk_that_is_full_loses_the_take_in_progress_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    one = session(virtual(tmp_path))
    takes = one.takes(opened(one.rig, one))
    next(takes), next(takes)

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(FailureError, match="the disk is full"):
            next(takes)
    again = session(tmp_path)
    assert again.done == 2 and [path for path in (tmp_path / "raw").iterdir() if path.name.startswith(".")] == []
    list(again.takes(opened(again.rig, again)))
    assert len(acquisition.open_campaign(tmp_path)["beam"].recordings) == 6


def test_a_second_run_is_added_to_the_campaign_and_notes_of_its_owner_stay(tmp_path: Path):
    one = session(virtual(tmp_path), run="bare")
    list(one.takes(opened(one.rig, one)))
    path = tmp_path / "campaign.toml"
    path.write_text(path.read_text() + "# a note\n")
    two = session(tmp_path, run="beam")
    list(two.takes(opened(two.rig, two)))
    campaign = acquisition.open_campaign(tmp_path)
    assert [run.id for run in campaign.runs] == ["bare", "beam"] and "# a note" in path.read_text()
    assert (campaign.name, campaign.structure) == ("Recorded", 'a "table"')


def test_a_take_begins_before_the_rise_wherever_the_blocks_end():
    generator = np.random.default_rng(1)
    force = np.zeros(1000)
    force[437:450] = 50.0
    signals = np.array([force, np.arange(1000.0)])
    for _ in range(30):
        cuts = np.sort(generator.integers(0, 1000, 25))
        blocks = iter(np.split(signals, cuts, axis=1))
        take = Trigger(0, 10.0, 20, 100).cut(blocks)
        np.testing.assert_array_equal(take, signals[:, 417:517])
    early = np.zeros((1, 300))
    early[0, 5:8] = early[0, 200:203] = 50
    np.testing.assert_array_equal(Trigger(0, 10.0, 20, 50).cut(iter([early])), early[:, 180:230])
    with pytest.raises(InputError, match="ended before a take was whole"):
        Trigger(0, 10.0, 20, 900).cut(iter([early]))
    with pytest.raises(InputError, match="no shorter than the take"):
        Trigger(0, 1.0, 50, 50)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('trigger = "hammer > 20 N"', 'trigger = "hammer"', "a channel and a level"),
        ('trigger = "hammer > 20 N"', 'trigger = "hammer > 20 s"', "not a force"),
        ('trigger = "hammer > 20 N"', 'trigger = "hamer > 20 N"', "the trigger names no channel"),
        ('device = "virtual"', 'device = "tape"', "no such kind of device"),
        ('role = "response"', 'role = "reference"', "one channel is the hammer"),
        ("sampling_rate = 4096", "samplingrate = 4096", "did you mean sampling_rate"),
        ('unit = "m/s^2"\n', "", "says in which unit"),
        ('unit = "m/s^2"', 'unit = "Hz"', "not the unit of a signal"),
        ('unit = "m/s^2"', 'unit = "m/s^2"\nrange = "5 V"', "the range is of another quantity"),
        ('unit = "N"', 'unit = "m/s^2"', "the channel of a reference measures no force"),
        ('dof = "{point}:-Z"', 'dof = "3:-Z"', "2 points, and no channel that is at them"),
        ('unit = "m/s^2"', 'unit = "m/s^2"\nsource = "hammer"', "two channels of one source, 'hammer'"),
        ("sampling_rate = 4096", "sampling_rate = inf", "finite number"),
        ("sampling_rate = 4096", "sampling_rate = true", "sampling_rate: input should be a valid number; got true"),
        ('trigger = "hammer > 20 N"', 'trigger = "hammer > -20 N"', "is not above 0"),
        ('trigger = "hammer > 20 N"', 'trigger = "hammer > 20 N"\npre_trigger = "-1 ms"', "pre_trigger: below 0"),
        ('trigger = "hammer > 20 N"', 'trigger = "hammer > 20 N"\nduration = "0 s"', "duration: not above 0"),
        ('trigger = "hammer > 20 N"', 'trigger = "hammer > 20 N"\nduration = "1e999 s"', "duration: not a finite"),
        (
            'trigger = "hammer > 20 N"',
            'trigger = "hammer > 20 N"\nduration = "1e9 s"',
            "a take of 1e.09 s at 4096 Hz on . channels has .* more than fit into memory",
        ),
        ('trigger = "hammer > 20 N"', 'trigger = "hammer > 1e999 N"', "not a finite number"),
        ("sampling_rate = 4096", "sampling_rate = 1e30", "more than fit into memory"),
    ],
)
def test_a_wrong_rig_is_one_sentence(tmp_path: Path, old: str, new: str, told: str):
    text = RIG.format(points="1, 2", takes=1).replace(old, new).replace('"virtual"', '"opendaq:daqref://device0"', 1)
    with pytest.raises(InputError, match=told):
        rig = rig_file.load(folder_with(tmp_path, text))
        rig_file.trigger(rig)
        rig_file.open_rig(replace_device(rig, new))


def test_volts_are_no_normal_force(tmp_path: Path):
    ring = '[[channels]]\nname = "ring"\nrole = "normal force"\nunit = "V"\njoint = "J1"\n'
    rig = rig_file.load(folder_with(tmp_path, RIG.format(points="1, 2", takes=1) + ring))
    with pytest.raises(InputError, match="channel ring: the channel of a normal force measures no force; got voltage"):
        rig_file.wires(rig)


def test_the_virtual_hammer_ends_with_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("ema.cli.recording._IMPACTS", 2)
    one = session(virtual(tmp_path / "table", takes=9))
    takes = []
    with pytest.raises(InputError, match="has struck every point as often as it can"):
        takes.extend(one.takes(opened(one.rig, one)))
    assert len(list((tmp_path / "table" / "raw").glob("*.h5"))) == 2


@pytest.mark.parametrize(
    ("says", "factor", "offset", "full"),
    [
        ('unit = "mV"\nsensitivity = "100 mV/g"\nrange = "5 V"', 0.01 * 9.80665, 0.0, 50 * 9.80665),
        ('sensitivity = "100 mV/g"\nrange = "50 g"', 10 * 9.80665, 0.0, 50 * 9.80665),
        ('unit = "g"\nsensitivity = "100 mV/g"', 9.80665, 0.0, None),
        ('unit = "degC"', 1.0, 273.15, None),
    ],
)
def test_values_of_a_device_become_si_as_those_of_a_file_do(
    tmp_path: Path, says: str, factor: float, offset: float, full: float | None
):
    """A unit beside a sensitivity had been passed over (mV were taken for V), as had the offset of degrees Celsius."""
    text = RIG.format(points="1, 2", takes=1).replace('unit = "m/s^2"', says)
    wire = next(
        one for one in rig_file.wires(rig_file.load(folder_with(tmp_path, text))) if one.channel.name == "acc 1"
    )
    assert (wire.factor, wire.offset) == (pytest.approx(factor, rel=1e-12), offset)
    assert wire.channel.range == (None if full is None else pytest.approx(full, rel=1e-12))


def replace_device(rig: rig_file.RigFile, new: str) -> rig_file.RigFile:
    return rig.model_copy(
        update={"rig": rig.rig.model_copy(update={"device": "tape" if "tape" in new else rig.rig.device})}
    )


def test_a_folder_without_a_rig_is_told(tmp_path: Path):
    with pytest.raises(InputError, match=r"no rig here; expected a file rig\.toml"):
        rig_file.load(tmp_path)


SCRIPT = """
import sys
from pathlib import Path
from acquisition import rig_file
from acquisition.session import Session
folder = Path(sys.argv[1])
one = Session(folder, rig_file.load(folder), "sine", lambda record: ())
source = rig_file.open_rig(one.rig)
for take in one.takes(source):
    print("taken", take.point, flush=True)
source.close()
"""


def test_twenty_takes_of_the_simulated_device_killed_once_and_resumed(tmp_path: Path):
    pytest.importorskip("opendaq")
    folder = folder_with(tmp_path / "daq", SIMULATED)
    process = subprocess.Popen([sys.executable, "-c", SCRIPT, str(folder)], stdout=subprocess.PIPE, text=True)
    for _ in range(6):
        assert process.stdout.readline().startswith("taken")
    process.send_signal(signal.SIGKILL)
    process.wait(30)
    one = Session(folder, rig_file.load(folder), "sine", lambda record: ())
    assert 6 <= one.done <= 7
    source = rig_file.open_rig(one.rig)
    takes = list(one.takes(source))
    source.close()
    assert one.done == 20 and len(takes) + 6 <= 20
    run = acquisition.open_campaign(folder)["sine"]
    records = list(run.recordings)
    assert len(records) == 20 and {record.signals.shape for record in records} == {(3, 300)}
    phases = []
    for record in records:
        force, acceleration, ring = record.signals
        # 2 V over 10 mV/N; the pre-trigger of 20 ms ends where the sine of 5 Hz rises above 100 N
        assert force.max() == pytest.approx(200, rel=1e-3) and force[39] <= 100 < force[40]
        assert acceleration.max() == pytest.approx(10 * 9.80665, rel=1e-3)
        assert ring.mean() == pytest.approx(1020)
        line = np.exp(-2j * np.pi * 10 * np.arange(200) / 2000)
        twice = (force[:200] ** 2 - np.mean(force[:200] ** 2)) @ line
        phases.append(np.angle(twice / (acceleration[:200] @ line)))
    # channels are read in step: the phase between them is the same in every take
    assert np.ptp(np.unwrap(phases)) < 1e-3
    assert run.condition.joints[0].mean == pytest.approx(1020)


def test_a_device_that_is_not_there_and_one_that_goes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("opendaq")
    from acquisition.live import opendaq_rig

    rig = rig_file.load(folder_with(tmp_path, SIMULATED.replace("daqref://device0", "daqref://device77")))
    with pytest.raises(FailureError, match="the device does not answer"):
        rig_file.open_rig(rig)
    monkeypatch.setattr(opendaq_rig, "SILENCE", 0.5)
    one = Session(tmp_path, rig_file.load(folder_with(tmp_path, SIMULATED)), "sine", lambda record: ())
    source = rig_file.open_rig(one.rig)
    takes = one.takes(source)
    next(takes)
    monkeypatch.setattr(source, "_read", lambda count: np.zeros((3, 0)))
    monkeypatch.setattr(source, "_forget", lambda: None)
    start = time.monotonic()
    with pytest.raises(FailureError, match=r"sent nothing.*takes on disk are safe"):
        next(takes)
    assert time.monotonic() - start < 5
    source.close()
    assert Session(tmp_path, one.rig, "sine", lambda record: ()).done == 1
    with pytest.raises(InputError, match=r"no such channel.*got RefCh9"):
        channels = [one.rig.channels[0].model_copy(update={"source": "RefCh9"}), *one.rig.channels[1:]]
        rig_file.open_rig(one.rig.model_copy(update={"channels": channels}))
    with pytest.raises(InputError, match="does not take this property"):
        wrong = one.rig.rig.model_copy(update={"properties": {"Colour": "red"}})
        rig_file.open_rig(one.rig.model_copy(update={"rig": wrong}))


def test_the_command_ends_with_sentences(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    from tests.journeys.small_campaign import ema_command

    folder = virtual(tmp_path / "today")
    ended = ema_command(capsys, "record", folder, "--run", "beam", "--takes", 2)
    assert ended.status == 0 and "2 of 6 takes; 0 rejected" in ended.out
    assert "point 1  peak" in ended.out and "F_N J1 1020 +- 3 N  accepted" in ended.out
    assert "average of 2, coherence" in ended.out
    ended = ema_command(capsys, "record", folder, "--run", "beam")
    assert ended.out.startswith("2 of 6 takes are in") and "6 of 6 takes; 0 rejected" in ended.out
    ema_command(capsys, "record", tmp_path).says(2, "there is no rig here; expected a file rig.toml")
    ema_command(capsys, "record").says(2, "no folder is named; expected a folder with a rig.toml")
    (tmp_path / "file").touch()
    ema_command(capsys, "record", tmp_path / "file", "--demo").says(3, "the rig file cannot be written")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        ended = ema_command(capsys, "record", tmp_path / "new", "--demo", "--no-open", "--port", port)
        assert ended.status == 3 and "the page cannot be served" in ended.err and ended.err.count("\n") == 1
    ema_command(capsys, "record", folder, "--run", "a/b").says(2, "a run is named by letters")


def rig_of(points: tuple[int, ...], sensors: int = 2, rate: float = 4096.0) -> VirtualRig:
    """The work table under a hammer that strikes these points one after the other."""
    responses = tuple(
        Channel(f"acc {n}", Dof(node, "+Z"), quantity="acceleration", unit="m/s^2") for n, node in ((1, 1), (2, 67))
    )
    dofs = tuple(Dof(point, "-Z") for point in points)
    drive = RovingHammer(dofs, hits=1, contact_time=0.4e-3, pre_trigger=0.05, spacing=1.0)
    return VirtualRig(table.with_beam(), drive, responses[:sensors], rate, rings=(RingCell("J1", 1020.0, 3.0),))


@dataclass
class Watched:
    """A source that remembers that it was closed."""

    source: VirtualRig
    closed: bool = False

    @property
    def channels(self) -> tuple[Channel, ...]:
        return self.source.channels

    @property
    def sampling_rate(self) -> float:
        return self.source.sampling_rate

    def takes(self) -> Iterator[Recording]:
        return self.source.takes()

    def close(self) -> None:
        self.closed = True


def test_recording_from_python_makes_a_campaign_and_goes_on(tmp_path: Path):
    folder = virtual(tmp_path / "day")
    with acquisition.record(folder, rig_of((1, 1, 5)), "beam", check_impact) as takes:
        told = [(take.point, take.accepted) for take in takes.first(3)]
    assert told == [(1, True), (1, True), (5, True)]
    with acquisition.record(folder, rig_of((5, 67, 67)), "beam", check_impact) as takes:
        assert takes.session.done == 3 and takes.session.point == 5
        assert [take.point for take in takes] == [5, 67, 67]
        assert takes.session.point is None
    run = acquisition.open_campaign(folder)["beam"]
    assert len(run.recordings) == 6
    assert [str(channel.dof) for channel in run.recordings[2].channels[:2]] == ["5:-Z", "1:+Z"]
    assert run.condition.joints[0].mean == pytest.approx(1020, abs=10)


@pytest.mark.parametrize(
    ("rig", "told"),
    [
        (rig_of((1,), sensors=1), "other channels than the rig.toml; got hammer, acc 1, ring J1"),
        (rig_of((1,), rate=2048.0), "another rate than the rig.toml says; got 2048 Hz, expected 4096 Hz"),
    ],
)
def test_a_source_that_is_not_the_rig_is_refused_and_closed(tmp_path: Path, rig: VirtualRig, told: str):
    watched = Watched(rig)
    with pytest.raises(InputError, match=told), acquisition.record(virtual(tmp_path / "day"), watched):
        pytest.fail("recorded")
    assert watched.closed


def test_a_virtual_device_is_no_hardware(tmp_path: Path):
    with pytest.raises(InputError, match="no such kind of device; got virtual"):
        acquisition.open_rig(virtual(tmp_path / "day"))


def test_the_simulated_device_of_a_rig_file(tmp_path: Path):
    pytest.importorskip("opendaq")
    source = acquisition.open_rig(folder_with(tmp_path / "daq", SIMULATED))
    try:
        assert [channel.name for channel in source.channels] == ["hammer", "acc", "ring"]
        assert next(source.takes()).signals.shape == (3, 300)
    finally:
        source.close()
