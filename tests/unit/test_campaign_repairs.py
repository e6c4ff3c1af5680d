"""Repairs of metadata: what changes, what is listed, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

import acquisition
from ema import store
from ema.data import Channel, FrfSet, Recording
from ema.dof import Dof
from ema.errors import InputError

BASE = """
[campaign]
name = "test"
files = "raw"

[[channels]]
name = "hammer"
role = "reference"
sensitivity = "2 mV/N"
dof = "{point}:-Z"

[[channels]]
name = "acc"
unit = "m/s^2"
dof = "3:+Z"

[[runs]]
id = "bare"
kind = "hammer"
files = "bare_{point}.h5"

[[runs]]
id = "beam"
kind = "hammer"
files = "beam_{point}.h5"
"""


def opened(path: Path, *repairs: str) -> acquisition.open_campaign.__class__:
    (path / "raw").mkdir(exist_ok=True)
    text = BASE + "".join(
        f'\n[[repairs]]\nwho = "A. Tester"\nwhy = "seen on the photo"\n{repair}\n' for repair in repairs
    )
    (path / "campaign.toml").write_text(text)
    for run in ("bare", "beam"):
        for point in (1, 2, 3):
            signals = np.array([[1.0, 2.0], [3.0, 4.0]]) * point
            take = Recording(signals, 100.0, (Channel("hammer"), Channel("acc")))
            store.save(path / "raw" / f"{run}_{point}.h5", take)
    return acquisition.open_campaign(path)


def dofs(run: object, row: int = 0) -> list[str]:
    return [str(take.channels[row].dof) for take in run.recordings]  # type: ignore[attr-defined]


def test_swapped_points_change_the_hammer_and_not_the_sensor(tmp_path: Path) -> None:
    campaign = opened(tmp_path, 'what = "swap points"\npoints = [1, 3]\nruns = ["bare"]')
    assert dofs(campaign["bare"]) == ["3:-Z", "2:-Z", "1:-Z"]
    assert dofs(campaign["bare"], 1) == ["3:+Z"] * 3
    assert dofs(campaign["beam"]) == ["1:-Z", "2:-Z", "3:-Z"]
    np.testing.assert_array_equal(campaign["bare"].recordings[0].signals[1], [3.0, 4.0])


def test_a_reversed_sign_negates_one_channel_of_some_files(tmp_path: Path) -> None:
    campaign = opened(tmp_path, 'what = "reverse sign"\nchannel = "acc"\nfiles = ["bare_2.h5"]\nruns = "bare"')
    first, second, _ = campaign["bare"].recordings
    np.testing.assert_array_equal(first.signals[1], [3.0, 4.0])
    np.testing.assert_array_equal(second.signals[1], [-6.0, -8.0])
    np.testing.assert_array_equal(second.signals[0], np.array([2.0, 4.0]) / 2e-3)
    repair = campaign["bare"].repairs[0]
    assert (repair.what, repair.who, repair.why) == ("reverse sign", "A. Tester", "seen on the photo")
    assert repair.where == "run bare, files bare_2.h5, channel acc" and campaign["beam"].repairs == ()


def test_a_wrong_sensitivity_and_a_wrong_unit_rescale(tmp_path: Path) -> None:
    campaign = opened(
        tmp_path,
        'what = "sensitivity"\nchannel = "hammer"\nsensitivity = "4 mV/N"',
        'what = "unit"\nchannel = "acc"\nunit = "g"',
    )
    take = campaign["beam"].recordings[0]
    np.testing.assert_allclose(take.signals, [[1 / 4e-3, 2 / 4e-3], [3 * 9.80665, 4 * 9.80665]], rtol=1e-14)
    assert take.channels[0].sensitivity == pytest.approx(4e-3)
    assert [repair.what for repair in campaign["bare"].repairs] == ["sensitivity 4 mV/N", "unit g"]


def test_a_wrong_sensitivity_that_the_front_end_applied(tmp_path: Path) -> None:
    repair = 'what = "sensitivity"\nchannel = "acc"\nsensitivity = "20 mV/g"\nwas = "10 mV/g"'
    np.testing.assert_allclose(opened(tmp_path, repair)["bare"].recordings[0].signals[1], [1.5, 2.0], rtol=1e-14)


def test_excluded_hits_and_records(tmp_path: Path) -> None:
    campaign = opened(
        tmp_path,
        'what = "exclude hit"\npoints = 2\nhits = [0, 4]\nruns = ["bare"]',
        'what = "exclude record"\nfiles = "beam_[13].h5"\nruns = ["beam"]'.replace("[13]", "1"),
    )
    assert [take.excluded_hits for take in campaign["bare"].recordings] == [
        (),
        ((0, "excluded by A. Tester: seen on the photo"), (4, "excluded by A. Tester: seen on the photo")),
        (),
    ]
    assert dofs(campaign["beam"]) == ["2:-Z", "3:-Z"]


def test_a_moved_dof_keeps_the_sense_of_the_sensor(tmp_path: Path) -> None:
    campaign = opened(
        tmp_path,
        'what = "move dof"\ndof = "3:+Z"\nto = "8:+Z"\nrole = "response"',
        'what = "move dof"\ndof = "2:+Z"\nto = "9:+Y"',
    )
    assert dofs(campaign["bare"], 1) == ["8:+Z"] * 3
    assert dofs(campaign["bare"]) == ["1:-Z", "9:-Y", "3:-Z"]


def test_repairs_apply_in_their_order(tmp_path: Path) -> None:
    campaign = opened(
        tmp_path,
        'what = "move dof"\ndof = "3:+Z"\nto = "8:+Z"',
        'what = "move dof"\ndof = "8:+Z"\nto = "9:+Z"\nrole = "response"',
    )
    assert dofs(campaign["bare"], 1) == ["9:+Z"] * 3 and dofs(campaign["bare"]) == ["1:-Z", "2:-Z", "8:-Z"]


@pytest.mark.parametrize(
    ("repair", "message"),
    [
        ('what = "reverse sign"\nchannel = "acc 7"', r"a repair matches nothing; got channel acc 7"),
        ('what = "swap points"\npoints = [1, 7]', "a repair matches nothing"),
        ('what = "exclude hit"\nhits = 1\nfiles = "bare_9.h5"', "a repair matches nothing; got files bare_9.h5"),
        ('what = "move dof"\ndof = "5:+Z"\nto = "6:+Z"', "a repair matches nothing"),
        ('what = "reverse sign"\nchannel = "acc"\nfiles = "bare_*.h5"\nruns = ["bare", "beam"]', "nothing in run beam"),
        (
            'what = "reverse sign"\nchannel = "acc"\nruns = ["bear"]',
            "does not exist; got bear, expected one of bare, beam",
        ),
        (
            'what = "unit"\nchannel = "acc"\nunit = "N"',
            r"unit of another quantity; got N \(force\), expected a unit of acc",
        ),
        ('what = "exclude record"\nfiles = "bare_*.h5"', "exclude every file of the run"),
        ('what = "swap points"\npoints = [1]', r"needs points = \[5, 6\]"),
        ('what = "polish"\nchannel = "acc"', "input should be 'swap points'"),
    ],
)
def test_repairs_that_cannot_be_done_are_refused(tmp_path: Path, repair: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        opened(tmp_path, repair)


def test_a_repair_says_who_and_why() -> None:
    from acquisition import campaign_file

    text = BASE + '\n[[repairs]]\nwhat = "reverse sign"\nchannel = "acc"\nwho = ""\nwhy = "x"\n'
    with pytest.raises(InputError, match=r"line 30: \[\[repairs\]\] number 1, who: string should have at least 1"):
        campaign_file.parse(text)


def test_frfs_are_repaired_as_well(tmp_path: Path) -> None:
    (tmp_path / "raw").mkdir()
    lines = np.arange(5.0)
    for point in (1, 2):
        values = np.full((5, 1, 1), point, complex)
        held = FrfSet(lines, values, (Dof(9, "+Z"),), (Dof(point, "-Z"),), "accelerance", "(m/s^2)/N")
        store.save(tmp_path / "raw" / f"p_{point}.h5", held)
    (tmp_path / "campaign.toml").write_text(
        '[campaign]\nname = "x"\nfiles = "raw"\n[[runs]]\nid = "a"\nfiles = "p_*.h5"\n'
        '[[repairs]]\nwhat = "swap points"\npoints = [1, 2]\nwho = "me"\nwhy = "x"\n'
        '[[repairs]]\nwhat = "reverse sign"\nrole = "reference"\nfiles = "p_2.h5"\nwho = "me"\nwhy = "x"\n'
        '[[repairs]]\nwhat = "sensitivity"\nrole = "reference"\nsensitivity = "4 mV/N"\nwas = "2 mV/N"\nwho = "me"\nwhy = "x"\n'
    )
    run = acquisition.open_campaign(tmp_path)["a"]
    assert [str(dof) for dof in run.frfs[0].inputs] == ["2:-Z", "1:-Z"]
    np.testing.assert_allclose(run.frfs[0].values[0, 0], [2.0, -4.0])
    assert len(run.repairs) == 3


def test_an_impact_is_excluded_from_the_one_record_that_is_named(tmp_path: Path) -> None:
    """The page names the record as the campaign does; a file may hold several, and a folder below another of its name."""
    raw = tmp_path / "raw"
    (raw / "again").mkdir(parents=True)
    channels = (Channel("hammer", None, "voltage", "reference", "V"), Channel("acc", Dof(3, "+Z")))
    records = [Recording(np.zeros((2, 8)), 1000.0, channels, name=name) for name in ("a", "b")]
    for folder in (raw, raw / "again"):
        store.save(folder / "bare_1.h5", {record.name: record for record in records})
    text = BASE.partition('[[runs]]\nid = "beam"')[0].replace(
        '"bare_{point}.h5"', '["bare_{point}.h5", "again/bare_{point}.h5"]'
    )
    (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
    names = [record.name for record in acquisition.open_campaign(tmp_path)["bare"].recordings]
    assert len(set(names)) == 4
    for name in names:
        repair = (
            f'\n[[repairs]]\nwhat = "exclude hit"\nfiles = ["{name}"]\nhits = [0]\nwho = "A. Tester"\nwhy = "double"\n'
        )
        (tmp_path / "campaign.toml").write_text(text + repair, encoding="utf-8")
        records = acquisition.open_campaign(tmp_path)["bare"].recordings
        assert [record.name for record in records if record.excluded_hits] == [name]
    repair = repair.replace(names[-1], "again/bare_1.h5")
    (tmp_path / "campaign.toml").write_text(text + repair, encoding="utf-8")
    records = acquisition.open_campaign(tmp_path)["bare"].recordings
    assert [record.name for record in records if record.excluded_hits] == ["again/bare_1.h5, a", "again/bare_1.h5, b"]
