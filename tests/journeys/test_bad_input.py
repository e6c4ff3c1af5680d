"""Bad input through the command: one sentence with what, where and the next step, the right status, nothing lost."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import acquisition
from ema.data import FrfSet, Recording
from tests.journeys.small_campaign import (
    FREQUENCIES,
    HAMMER,
    RUN,
    Ended,
    campaign,
    ema_command,
    frfs,
    records,
    with_signal,
)

Command = Callable[..., Ended]
FRFS = HAMMER.replace("{point}", "1") + RUN.replace('kind = "hammer"\n', "")


@pytest.fixture
def command(capsys: pytest.CaptureFixture[str], unfitted: None, undrawn: None) -> Command:
    return lambda *arguments: ema_command(capsys, *arguments)


def as_text(path: Path, record: Recording, line: int | None = None, end: str | None = None) -> None:
    """Write a record as a CSV file; the last cell of the row ``line`` becomes ``end``."""
    time = np.arange(record.signals.shape[1]) / record.sampling_rate
    rows = [",".join(f"{value:.7g}" for value in row) for row in np.column_stack([time, record.signals.T])]
    if line is not None:
        rows[line] = rows[line].rpartition(",")[0] + f",{end}"
    path.write_text("t,hammer,acc 1,acc 2\n" + "\n".join(rows) + "\n")


def edited(path: Path, old: bytes, new: bytes) -> None:
    data = path.read_bytes()
    assert old in data
    path.write_bytes(data.replace(old, new, 1))


# ------------------------------------------------------------------------------------------------ files that are wrong


def test_the_campaign_is_sound_before_it_is_spoiled(tmp_path, capsys):
    ended = ema_command(capsys, "check", campaign(tmp_path), "--limit", "warning")
    assert ended.status == 0 and ended.err == "" and "12 of 12 used" in ended.out


@pytest.mark.parametrize(
    ("spoil", "parts"),
    [
        (lambda path: path.write_bytes(b""), ("the file is empty", "measure or export it again")),
        (lambda path: path.write_bytes(path.read_bytes()[:300]), ("data set 1", "the file ends inside", "export")),
        (
            lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3]),
            ("the file is damaged", "the file ends inside the data set", "announced values are read", "Export"),
        ),
        (
            lambda path: edited(path, b"    58b", b"    58x"),
            ("the file is damaged", "no data set begins with '58x", "'hammer'", "Export"),
        ),
        (lambda path: path.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(256))), ("in spite of its name", "\\x89PNG")),
        (lambda path: path.write_text("nothing to see here\n" * 9), ("no table of numbers", "nothing to see")),
    ],
    ids=["empty", "truncated in its head", "truncated", "malformed", "a picture", "prose"],
)
def test_one_wrong_file_of_four(tmp_path, command, spoil, parts):
    folder = campaign(tmp_path)
    spoil(folder / "data" / "bare_2.uff")
    command("run", folder).says(2, "bare_2.uff", *parts)


def test_a_function_whose_values_are_text(tmp_path, command):
    folder = campaign(tmp_path)
    path = folder / "data" / "bare_2.uff"
    acquisition.write(path, records()[1])
    lines = path.read_text().splitlines()
    lines[40] = "hello world"
    path.write_text("\n".join(lines) + "\n")
    command("check", folder).says(
        2, "bare_2.uff", "the file is damaged", "of another length between the values", "Export"
    )


def test_a_folder_or_a_dead_link_in_the_place_of_a_file(tmp_path, command):
    folder = campaign(tmp_path)
    path = folder / "data" / "bare_2.uff"
    path.unlink()
    path.mkdir()
    command("check", folder).says(2, "run bare", "a folder where a file is expected", str(path), "remove it")
    command("run", path).says(2, "bare_2.uff", "there is no campaign here")
    path.rmdir()
    path.symlink_to(tmp_path / "gone.uff")
    command("check", folder).says(2, "a link to a file that is not there", str(path))


def test_no_file_at_all(tmp_path, command):
    folder = campaign(tmp_path, run=RUN.replace("bare_", "beam_"))
    command("run", folder).says(2, "no file matches the pattern", "beam_{point}.uff", "there are bare_1.uff")
    command("run", tmp_path / "nothing.uff").says(2, "nothing.uff", "there is no such file or folder")


@pytest.mark.parametrize("text", ["nan", "inf", "-inf", ""])
def test_values_that_are_no_numbers(tmp_path, command, text):
    folder = campaign(tmp_path)
    as_text(folder / "data" / "bare_2.uff", records()[1], 49, text)
    command("run", folder).says(2, "bare_2.uff, channel acc 2", "1 NaN or infinite", "sample 49", "leave out")


def test_frfs_that_are_no_numbers_are_not_written(tmp_path):
    values = frfs().values.copy()
    values[100, 3, 0] = np.nan
    with pytest.raises(Exception, match=r"not finite|not numbers|NaN"):
        acquisition.write(tmp_path / "bad.uff", replace(frfs(), values=values))
    assert not (tmp_path / "bad.uff").exists(), "half a file is worse than none"


def test_a_wrong_suffix_is_a_remark(tmp_path, command):
    folder = campaign(tmp_path, run=RUN.replace(".uff", ".csv"))
    for path in (folder / "data").iterdir():
        path.rename(path.with_suffix(".csv"))
    ended = command("check", folder)
    assert ended.status == 0 and "12 of 12 used" in ended.out
    other = campaign(tmp_path / "other")
    as_text(other / "data" / "bare_2.uff", records()[1])
    ended = command("check", other)
    assert ended.status == 0 and "the content Text table" in ended.out


def test_a_path_with_blanks_and_letters(tmp_path, command):
    folder = campaign(tmp_path / "Prüfstand 1 ▷ 台" / "Träger, 1 kN")
    ended = command("run", folder, "--output", tmp_path / "Bericht über β")
    assert ended.status == 0, ended.err
    report = tmp_path / "Bericht über β" / "Träger, 1 kN.html"
    assert ended.out.splitlines()[-1] == f"Report: {report}" and report.stat().st_size > 10_000


# ---------------------------------------------------------------------------------------------- records that are wrong


def spoiled(change: Callable[[Recording], Recording], *places: int) -> list[Recording]:
    return [change(record) if not places or place in places else record for place, record in enumerate(records())]


def test_missing_channels(tmp_path, command):
    short = spoiled(
        lambda one: replace(one, signals=one.signals[:2], channels=one.channels[:2], overloads=one.overloads[:2]), 1
    )
    command("run", campaign(tmp_path, short)).says(
        2, "bare_2.uff", "no such channel", "'acc 2'", "one of hammer, acc 1", "channel table"
    )


@pytest.mark.parametrize("twice", ["1:+Z", "1:-Z"])
def test_duplicated_dofs(tmp_path, command, twice):
    folder = campaign(tmp_path, channels=HAMMER.replace('"2:+Z"', f'"{twice}"'))
    command("run", folder).says(2, "bare_1.uff", "two channels with one DOF", "acc 1 and acc 2", "channel table")


@pytest.mark.parametrize("level", [0.0, 3.0], ids=["zero", "constant"])
def test_a_dead_response_is_a_finding_and_the_rest_is_fitted(tmp_path, command, without_report, level):
    ended = command("run", campaign(tmp_path, spoiled(lambda record: with_signal(record, 2, level))))
    assert ended.status == 1 and ended.err == ""
    assert "error: run bare, 2:+Z/1:+Z" in ended.out and "the response channel is dead" in ended.out
    assert all(f"{frequency:.0f}." in ended.out for frequency in FREQUENCIES[1:]), "the other sensor's"


def test_dead_responses_only(tmp_path, command):
    dead = spoiled(lambda record: with_signal(with_signal(record, 1, 0.0), 2, 0.0))
    command("run", campaign(tmp_path, dead)).says(2, "run bare", "no FRF is left", "dead", "Check sensor and cable")


@pytest.mark.parametrize(
    "force",
    [0.0, 5.0, np.random.default_rng(0).normal(size=records()[0].signals.shape[1])],
    ids=["zero", "constant", "noise"],
)
def test_a_force_channel_that_never_triggers(tmp_path, command, force):
    silent = campaign(tmp_path / "all", spoiled(lambda record: with_signal(record, 0, force)))
    command("run", silent).says(2, "run bare", "the force channel never triggers", "no impact in 4 records", "check")
    ended = command("check", campaign(tmp_path / "one", spoiled(lambda record: with_signal(record, 0, force), 1)))
    assert ended.status == 1 and "9 of 9 used" in ended.out
    assert "error: run bare, bare_2.uff: the force channel never triggers" in ended.out


def test_a_reversed_sensor(tmp_path, command):
    reversed_ = spoiled(lambda record: with_signal(record, 1, -record.signals[1]))
    folder = campaign(tmp_path, reversed_)
    ended = command("check", folder)
    assert ended.status == 1
    assert "error: run bare, 1:+Z/1:+Z: the drive point has the wrong sign" in ended.out
    assert "2:+Z/1:+Z and 1:+Z/2:+Z: the two FRFs differ by 200 %: they have opposite signs" in ended.out
    with (folder / "campaign.toml").open("a") as file:
        file.write('\n[[repairs]]\nwhat = "reverse sign"\nchannel = "acc 1"\nwho = "us"\nwhy = "upside down"\n')
    assert command("check", folder).status == 0, "as advised"


def test_a_reversed_hammer(tmp_path, command):
    ended = command("check", campaign(tmp_path, spoiled(lambda record: with_signal(record, 0, -record.signals[0]))))
    assert ended.status == 1
    assert "12 of 12 impacts are negative pulses. A hammer can only push" in ended.out


@pytest.mark.parametrize(("samples", "says"), [(1, "2 or more"), (10, "at least 16")])
@pytest.mark.parametrize("places", [(1,), ()], ids=["one", "all"])
def test_records_of_a_few_samples(tmp_path, command, samples, says, places):
    short = spoiled(lambda record: replace(record, signals=record.signals[:, :samples]), *places)
    name = "bare_2.uff" if places else "bare_1.uff"
    command("run", campaign(tmp_path, short)).says(2, name, "too short", f"got {samples} sample", says)


def velocity(record: Recording) -> Recording:
    hammer, first, *others = record.channels
    return replace(record, channels=(hammer, replace(first, quantity="velocity", unit="m/s"), *others))


def test_mixed_units(tmp_path, command):
    mixed = spoiled(velocity, 1)
    folder = campaign(tmp_path / "free", mixed, channels=HAMMER.replace('unit = "m/s^2"', ""))
    command("run", folder).says(
        2, "bare_2.uff, channel acc 1", "mixed units", "velocity in m/s", "acceleration in m/s^2", "a run of its own"
    )
    folder = campaign(tmp_path / "told", mixed)
    command("run", folder).says(2, "bare_2.uff, channel acc 1", "disagree", "m/s in the file", "a unit of acceleration")


def test_unequal_sampling_rates(tmp_path, command):
    folder = campaign(tmp_path, spoiled(lambda record: replace(record, sampling_rate=2048.0), 1))
    command("run", folder).says(2, "bare_2.uff", "unequal sampling rates", "got 2048 Hz, expected 1024 Hz", "own")


# ------------------------------------------------------------------------------------------------------ FRFs that clash


def frf_campaign(folder: Path, *sets: FrfSet) -> Path:
    """A campaign whose files hold FRFs, one set each."""
    (folder / "data").mkdir(parents=True)
    (folder / "campaign.toml").write_text(
        '[campaign]\nname = "FRFs"\nfiles = "data"\n\n[[runs]]\nid = "ready"\nkind = "hammer"\nfiles = "*.uff"\n'
    )
    for number, one in enumerate(sets):
        acquisition.write(folder / "data" / f"set_{number}.uff", one)
    return folder


def test_unequal_frequency_axes(tmp_path, command):
    left, right = frfs().pick([0, 1]), frfs(401, 0.5).pick([2, 3])
    command("run", frf_campaign(tmp_path, left, right)).says(
        2, "set_1.uff", "unequal frequency axes", "got 401 lines", "in steps of 0.5 Hz", "expected 801 lines", "own"
    )


def test_frfs_of_mixed_units(tmp_path, command):
    left, right = frfs().pick([0, 1]), replace(frfs().pick([2, 3]), quantity="mobility", unit="(m/s)/N")
    command("run", frf_campaign(tmp_path, left, right)).says(
        2, "set_1.uff", "mixed units", "got mobility", "expected receptance", "a run of its own"
    )


def test_frfs_measured_twice_and_never(tmp_path, command):
    command("run", frf_campaign(tmp_path / "twice", frfs(), frfs().pick([3]))).says(
        2, "measured twice", "4:+Z/1:+Z in set_0.uff and set_1.uff", "repair"
    )
    command("run", frf_campaign(tmp_path / "never", frfs().pick([0, 1]), frfs().pick([2, 3], [0]))).says(
        2, "an FRF is missing", "no 3:+Z/2:+Z", "all of 4 outputs x 2 inputs", "measure it"
    )


def test_a_damaged_function_among_good_ones_is_a_finding(tmp_path, command):
    path = tmp_path / "beam.uff"
    acquisition.write(path, frfs(), binary=True)
    whole = path.read_bytes()
    path.write_bytes(whole[:-2000])  # the last of eight functions is cut
    command("fit", path).says(2, "beam", "an FRF is missing", "no 4:+Z/2:+Z", "measure it")
    read = acquisition.read(path)
    assert any(finding.code == "damaged-set" and finding.severity == "error" for finding in read.findings)
    assert sum(one.values[0].size for one in read.frfs) == 7, "seven are kept"


# ----------------------------------------------------------------------------------------------------- what was written


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ('role = "reference"', 'rolle = "reference"', ("line 7: unknown key 'rolle'", "did you mean role?")),
        ('unit = "m/s^2"', 'unit = "m/s^^2"', ("line 14", "not a unit", "did you mean m/s^2")),
        ('kind = "hammer"', 'kind = "hamer"', ("kind", "hammer")),
        ('dof = "1:+Z"', 'dof = "1:+Q"', ("1:+Q",)),
        ('unit = "N"\n', 'unit = ""\n', ("unit",)),
        ('name = "Four points"', "name = Four points", ("not TOML", "line 2", "quotation marks")),
    ],
)
def test_a_campaign_file_with_a_mistake(tmp_path, command, old, new, parts):
    folder = campaign(tmp_path)
    edited(folder / "campaign.toml", old.encode(), new.encode())
    command("run", folder).says(2, "campaign.toml", *parts)


def test_a_recipe_with_an_unknown_key(tmp_path, command):
    campaign(tmp_path / "four")
    recipe = tmp_path / "recipe.toml"
    recipe.write_text('campaign = "four"\n\n[fit]\nbnad = [20, 300]\n')
    command("run", recipe).says(2, "recipe.toml, line 4", "unknown key 'bnad' in [fit]", "did you mean band?")
    recipe.write_text('campaign = "fuor"\n')
    command("run", recipe).says(2, "fuor", "no")
    recipe.write_text('campaign = "four"\n\n[fit]\nband = [600, 900]\n')
    command("run", recipe).says(2, "600")
