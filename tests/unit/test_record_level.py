"""`ema record --level`: the force of a shaker at resonance, on the virtual table and on openDAQ's simulated device."""

import re
import tomllib
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

import acquisition
from acquisition import rig_file
from ema import store
from ema.cli.level_control import (
    DAMPING,
    MISSES,
    MOVING_MASS,
    NORMAL_FORCE,
    TOLERANCE,
    LevelSource,
    ShakerAtLevel,
    VirtualShaker,
)
from ema.data import Finding
from ema.datasets import work_table
from ema.errors import FailureError, InputError
from ema.simulate import FrictionRig, damping_map
from tests.journeys.small_campaign import ema_command

DOCS = Path(__file__).parents[2] / "docs" / "record.md"
DEVICE = """
[rig]
device = "opendaq:daqref://device0"
sampling_rate = 2000
[rig.properties]
NumberOfChannels = 2
GlobalSampleRate = 2000.0
"RefCh1.Frequency" = 40.0
"RefCh1.Amplitude" = 1.0

[take]
points = [5]
takes = 1

[shaker]
band = [30, 50]
step = 5.0
stay = "0.2 s"
settle = "0.1 s"
first = 1.0
largest = 4.0
amplitude = "RefCh0.Amplitude"
frequency = "RefCh0.Frequency"

[[channels]]
name = "force"
source = "RefCh0"
role = "reference"
sensitivity = "100 mV/N"
dof = "{point}:+Z"

[[channels]]
name = "acc"
source = "RefCh1"
role = "response"
sensitivity = "100 mV/g"
dof = "5:+Z"
"""


def shaker_folder(path: Path, text: str | None = None) -> Path:
    """The rig of the page on recording, or another."""
    text = re.findall(r"```toml\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.DOTALL)[1] if text is None else text
    path.mkdir(parents=True, exist_ok=True)
    (path / "rig.toml").write_text(text, encoding="utf-8")
    return path


def on_the_structure(path: Path, lines: np.ndarray, stay: int, mass: float) -> tuple[float, np.ndarray]:
    """Force on the table at the largest response, and at all lines, by a projection on known frequencies alone."""
    record = store.load(path)
    force, acceleration = record.signals
    time = np.arange(stay) / record.sampling_rate
    reached, height = [], []
    for number, line in enumerate(lines):
        part = slice(number * stay, (number + 1) * stay)
        basis = np.column_stack([np.cos(2 * np.pi * line * time), np.sin(2 * np.pi * line * time)])
        f, a = (np.linalg.lstsq(basis, x[part], rcond=None)[0] @ [1, -1j] for x in (force, acceleration))
        reached.append(abs(f - mass * a))
        height.append(abs(a) / reached[-1])
    return reached[int(np.argmax(height))], np.array(reached)


@pytest.mark.parametrize("level", [6.0, 15.0, 30.0])
def test_a_level_is_reached_where_the_shaker_gives_less_at_resonance(level, tmp_path, capsys):
    """The command of the page's rig begins at 10, the force on the table is read from the take on disk with F - m a.

    The level is between the lines, where the force changes by up to 2 % from one to the next: 5 % and one such step."""
    folder = shaker_folder(tmp_path / "shaker")
    ended = ema_command(capsys, "record", folder, "--run", "one", "--level", f"{level} N", "--takes", 1)
    assert ended.status == 0, ended.out
    commands = [float(text) for text in re.findall(r"command ([\d.]+):", ended.out)]
    assert 2 <= len(commands) <= 8 and max(commands) <= 100
    (take,) = (folder / "raw").iterdir()
    reached, along = on_the_structure(take, np.arange(476.0, 517.0), 1024, 0.05)
    assert reached == pytest.approx(level, rel=TOLERANCE + 0.02)
    # there was something to correct, and beside the resonance the force is higher
    assert commands[-1] > 1.05 * level and along.max() > 1.05 * reached
    run = acquisition.open_campaign(folder)["one"]
    assert run.condition.excitation.level == level and run.kind == "stepped sine"


def test_what_the_model_says_of_its_steady_states_is_said_of_the_take(tmp_path, capsys, monkeypatch):
    """A jump between branches is in the line of the take: it was known to the rig alone."""
    jump = Finding("warning", "branch-jump", "virtual", "the steady states change to another branch", 490.0)
    monkeypatch.setattr(FrictionRig, "findings", property(lambda rig: (jump,)))
    ended = ema_command(capsys, "record", shaker_folder(tmp_path / "shaker"), "--level", "15 N", "--takes", 1)
    assert ended.status == 0 and jump.message in ended.out


def test_what_a_take_within_the_tolerance_may_be_off():
    """Damping of the virtual table, two settings: a level 5 % off changes it by no more than 5 % (largest: 4.95 %)."""
    levels = np.array([[0.95, 1.0, 1.05]]) * np.array([[6.0], [10.0], [20.0], [30.0], [40.0]])
    for setting in (work_table.ABSORBER, work_table.BENDING):
        model = work_table.with_beam(setting, NORMAL_FORCE)
        rows = damping_map(model, levels.ravel(), [50.0, 100.0, 200.0], "91:+Z", "91:+Z", (465, 525), 5e-3)
        damping = rows.damping.reshape(5, 3, 3)
        assert np.abs(damping[:, [0, 2]] / damping[:, [1]] - 1).max() < 1.02 * TOLERANCE
        frequency = rows.frequency.reshape(5, 3, 3)
        assert np.abs(frequency[:, [0, 2]] - frequency[:, [1]]).max() < 1.05


def test_what_the_virtual_shaker_takes_of_its_force(tmp_path):
    """F = F0 - (j w c - w^2 m) x: the force of the coil, taken from the record of the cell, is the command at all lines."""
    rig = rig_file.load(shaker_folder(tmp_path))
    source = ShakerAtLevel(rig, 30.0).opened()
    record = source.shaker.measure(30.0)
    lines, stay = np.arange(476.0, 517.0), 1024
    time = np.arange(stay) / record.sampling_rate
    for number, line in enumerate(lines):
        part = slice(number * stay, (number + 1) * stay)
        basis = np.column_stack([np.cos(2 * np.pi * line * time), np.sin(2 * np.pi * line * time)])
        force, acceleration = (np.linalg.lstsq(basis, x[part], rcond=None)[0] @ [1, -1j] for x in record.signals)
        # the cell also drives the 0.05 kg below it: its force is that of the coil without what the armature takes
        coil = force + acceleration * (DAMPING / (2j * np.pi * line) + MOVING_MASS)
        assert abs(coil) == pytest.approx(30.0, rel=5e-3)


def test_a_generator_of_a_device_is_driven_to_the_level_and_left_at_rest(tmp_path, capsys):
    """openDAQ's reference device: channel 0 is the sine that it is told, 0.1 V per newton, channel 1 hums at 40 Hz.

    So 20 N need 2 V, whatever the way there, and the "resonance" is the line at which the hum is."""
    pytest.importorskip("opendaq")
    folder = shaker_folder(tmp_path / "device", DEVICE)
    ended = ema_command(capsys, "record", folder, "--run", "hum", "--level", "20 N")
    assert ended.status == 0, ended.out
    found = re.findall(r"command ([\d.]+): ([\d.]+) N at ([\d.]+) Hz", ended.out)
    assert [float(one[0]) for one in found] == pytest.approx([1.0, 2.0], rel=1e-3)
    assert float(found[-1][1]) == pytest.approx(20.0, rel=1e-3) and float(found[-1][2]) == pytest.approx(40, abs=1)
    (take,) = (folder / "raw").iterdir()
    record = store.load(take)
    assert record.signals.shape == (2, 5 * 400)
    assert np.abs(record.signals[0]).max() == pytest.approx(20.0, rel=0.02)
    # every stay has its own frequency, without the samples that were on their way before
    for number, line in enumerate((30.0, 35.0, 40.0, 45.0, 50.0)):
        part = record.signals[0, number * 400 : (number + 1) * 400]
        time = np.arange(400) / 2000
        basis = np.column_stack([np.cos(2 * np.pi * line * time), np.sin(2 * np.pi * line * time)])
        rest = part - basis @ np.linalg.lstsq(basis, part, rcond=None)[0]
        assert np.linalg.norm(rest) < 0.01 * np.linalg.norm(part), line


def test_the_device_is_at_rest_behind_every_measurement(tmp_path, monkeypatch):
    pytest.importorskip("opendaq")
    rig = rig_file.load(shaker_folder(tmp_path, DEVICE))
    source = ShakerAtLevel(rig, 20.0).opened()
    assert isinstance(source, LevelSource)
    generator = source.shaker._channel("RefCh0")
    assert generator.get_property_value("Amplitude") == 0
    driven = []
    read = source.shaker._read
    monkeypatch.setattr(
        source.shaker, "_read", lambda count: driven.append(generator.get_property_value("Amplitude")) or read(count)
    )
    source.shaker.measure(1.5)
    assert set(driven) >= {1.5} and generator.get_property_value("Amplitude") == 0

    def gone(count):
        raise FailureError("the device has gone")

    monkeypatch.setattr(source.shaker, "_read", gone)
    with pytest.raises(FailureError, match="has gone"):
        source.shaker.measure(1.5)
    assert generator.get_property_value("Amplitude") == 0
    source.close()
    with pytest.raises(InputError, match=r"does not take this property.*Loudness"):
        text = DEVICE.replace('"RefCh0.Amplitude"', '"RefCh0.Loudness"')
        ShakerAtLevel(rig_file.load(shaker_folder(tmp_path, text)), 20.0).opened()


class _Sagging:
    """A shaker that gives 8 % less when the same command is given once more, as one that heats up while it stays."""

    def __init__(self, rig) -> None:
        self.virtual, self.last = VirtualShaker(rig), 0.0
        self.channels, self.sampling_rate = self.virtual.channels, self.virtual.sampling_rate

    def measure(self, command):
        again, self.last = command == self.last, command
        return self.virtual.measure(0.92 * command if again else command)

    def close(self):
        pass


def test_takes_off_their_level_are_kept_aside_and_the_command_is_sought_again(tmp_path, capsys, monkeypatch):
    """No take is at the level at which its search ended: three are tried."""
    folder = shaker_folder(tmp_path / "sagging")
    rig = rig_file.load(folder)
    monkeypatch.setattr(ShakerAtLevel, "opened", lambda self: LevelSource(self, _Sagging(rig)), raising=True)
    ended = ema_command(capsys, "record", folder, "--run", "one", "--level", "30 N")
    assert ended.status == 1 and "off 30 N" in ended.out and ended.out.count("Seeking") == 4, ended.out
    assert len(list((folder / "rejected").iterdir())) == 3 and not list((folder / "raw").iterdir())
    assert not (folder / "campaign.toml").exists()


def test_bad_levels_are_one_sentence_and_lose_nothing(tmp_path, capsys):
    folder = shaker_folder(tmp_path / "shaker")
    text = (folder / "rig.toml").read_text(encoding="utf-8")

    def refused(*arguments, rig: str = text) -> str:
        (folder / "rig.toml").write_text(rig, encoding="utf-8")
        ended = ema_command(capsys, "record", folder, *arguments)
        assert ended.status == 2 and "Traceback" not in ended.err, ended
        return " ".join(ended.err.split())

    assert "a shaker is measured at a force level" in refused("--run", "one")
    assert "not a force level" in refused("--run", "one", "--level", "-3 N")
    assert "a mass is not" in refused("--run", "one", "--level", "30 kg")
    assert "without a unit" in refused("--run", "one", "--level", "30")
    assert "fewer than five lines" in refused(
        "--run", "one", "--level", "6 N", rig=text.replace("476, 516", "476, 478")
    )
    assert "above the largest" in refused(
        "--run", "one", "--level", "6 N", rig=text.replace("first = 10", "first = 101")
    )
    short = text.replace('stay = "0.125 s"', 'stay = "0.005 s"')
    assert "does not stay long enough" in refused("--run", "one", "--level", "6 N", rig=short)
    beside = text.replace("[476, 516]", "[520, 540]")
    assert "no resonance in the band" in refused("--run", "one", "--level", "6 N", rig=beside)
    low = text.replace("largest = 100.0", "largest = 12.0")
    assert "needs more than the largest command" in refused("--run", "one", "--level", "30 N", rig=low)
    assert not list((folder / "raw").iterdir())
    (folder / "rig.toml").write_text(text, encoding="utf-8")
    assert ema_command(capsys, "record", folder, "--run", "one", "--level", "6 N", "--takes", 1).status == 0
    assert "begun at another force level" in refused("--run", "one", "--level", "30 N")
    hammer = text[: text.index("[shaker]")] + text[text.index("[[channels]]") :]
    hammer = hammer.replace("[take]\n", '[take]\ntrigger = "force > 1 N"\n')
    assert "the rig has none" in refused("--run", "two", "--level", "6 N", rig=hammer)
    assert len(list((folder / "raw").iterdir())) == 1


RING = """
[[channels]]
name = "ring J1"
role = "normal force"
unit = "N"
joint = "{joint}"
"""


def test_takes_at_another_normal_force_do_not_count(tmp_path, capsys):
    """The rings of the virtual hammer's table show 1020 N with 3 N of noise."""
    folder = tmp_path / "hammer"
    folder.mkdir()
    (folder / "rig.toml").write_bytes((files("ema.datasets") / "virtual_rig.toml").read_bytes())

    def record(force: str):
        return ema_command(capsys, "record", folder, "--run", "beam", "--takes", 1, "--normal-force", force)

    ended = record("1.1 kN")
    assert ended.status == 1 and "is 1020 N, -7 % off 1100 N" in ended.out and not any((folder / "raw").iterdir())
    assert record("1 kN").status == 0
    table = tomllib.loads((folder / "campaign.toml").read_text())
    (run,) = table["runs"]
    assert [one["nominal"] for one in run["normal_force"]] == ["1000 N"] * len(table["joints"])
    joints = acquisition.open_campaign(folder)["beam"].condition.joints
    assert [one.mean for one in joints] == pytest.approx([1020.0] * len(joints), abs=1.0)
    assert "begun at another normal force" in record("900 N").err
    assert "a mass is not" in record("1 kg").err and "not a normal force" in record("0 N").err


def test_a_normal_force_that_the_rig_does_not_measure_is_refused(tmp_path, capsys):
    ended = ema_command(
        capsys, "record", shaker_folder(tmp_path), "--level", "6 N", "--normal-force", "50 N", "--takes", 1
    )
    assert ended.status == 2 and "the rig measures no normal force" in ended.err


def test_the_joints_of_the_virtual_table_have_the_normal_force_that_is_asked_for(tmp_path, capsys):
    """And takes at another one end the command, for nobody stands at the shaker to tighten a joint."""
    joint = work_table.with_beam(work_table.ABSORBER, NORMAL_FORCE).joints[0].name
    text = (shaker_folder(tmp_path) / "rig.toml").read_text() + RING.format(joint=joint)
    folder = shaker_folder(tmp_path / "shaker", text)
    ended = ema_command(
        capsys, "record", folder, "--run", "one", "--level", "6 N", "--normal-force", "60 N", "--takes", 1
    )
    assert ended.status == 0, ended.out
    (take,) = (folder / "raw").iterdir()
    record = store.load(take)
    assert record.signals[record.with_role("normal force")[0]].mean() == pytest.approx(60.0, abs=1.0)
    source = ShakerAtLevel(rig_file.load(folder), 6.0, 60.0).opened()
    source.shaker.normal_force = 100.0
    takes = list(source.takes())
    assert len(takes) == MISSES and not any(source.test.judge(one) for one in takes)
