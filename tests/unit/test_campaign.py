"""campaign.toml opened on small folders made here, and everything that can be wrong with them."""

import dataclasses
from pathlib import Path
from textwrap import dedent

import h5py
import numpy as np
import pytest

import acquisition
from acquisition import campaign_file
from ema import store
from ema.data import Channel, FrfSet, Geometry, Lazy, Recording
from ema.dof import Dof
from ema.errors import CancelledError, InputError
from tests.fuzz.uff import Function

RATE = 1000.0
HEAD = '[campaign]\nname = "test"\nfiles = "raw"\n'
CHANNELS = """
[[channels]]
name = "hammer"
role = "reference"
unit = "N"
dof = "{point}:-Z"

[[channels]]
name = "acc"
unit = "g"
dof = "1:+Z"
range = "50 g"
serial = "77"
calibrated_on = 2026-01-10
"""
RUN = '[[runs]]\nid = "bare"\nkind = "hammer"\nfiles = "bare_{point}.h5"\n'


def record(
    samples: int = 20, rate: float = RATE, names: tuple[str, ...] = ("hammer", "acc"), scale: float = 1.0
) -> Recording:
    signals = scale * np.arange(1.0, 1 + samples * len(names)).reshape(len(names), samples)
    return Recording(signals, rate, tuple(Channel(name) for name in names), name="take")


def folder(path: Path, text: str, files: dict[str, object] | None = None) -> Path:
    (path / "raw").mkdir(parents=True, exist_ok=True)
    (path / "campaign.toml").write_text(dedent(text), encoding="utf-8")
    for name, noun in (files if files is not None else {"bare_2.h5": record(), "bare_10.h5": record(21)}).items():
        store.save(path / "raw" / name, noun)
    return path


def frf(output: str, input_: str, value: complex = 1.0, lines: int = 30, **options: object) -> FrfSet:
    values = np.full((lines, 1, 1), value, complex)
    return FrfSet(
        np.arange(float(lines)),
        values,
        (Dof.parse(output),),
        (Dof.parse(input_),),
        **({"quantity": "accelerance", "unit": "(m/s^2)/N"} | options),
    )  # type: ignore[arg-type]


# what is read ----------------------------------------------------------------------------------------------------------


def test_records_get_dofs_units_and_order_from_the_campaign(tmp_path: Path) -> None:
    campaign = acquisition.open_campaign(folder(tmp_path, HEAD + CHANNELS + RUN))
    run = campaign["bare"]
    assert [take.name for take in run.recordings] == ["bare_2.h5", "bare_10.h5"], "natural order"
    first = run.recordings[0]
    assert [str(channel.dof) for channel in first.channels] == ["2:-Z", "1:+Z"]
    assert [(channel.quantity, channel.unit, channel.role) for channel in first.channels] == [
        ("force", "N", "reference"),
        ("acceleration", "m/s^2", "response"),
    ]
    np.testing.assert_allclose(first.signals, record().signals * [[1.0], [9.80665]], rtol=1e-15)
    assert first.channels[1].range == pytest.approx(50 * 9.80665)
    assert (first.channels[1].serial, first.channels[1].calibrated_on) == ("77", "2026-01-10")
    assert run.kind == "hammer" and run.condition.joints == () and run.findings == ()
    assert campaign.inputs[0][0] == "campaign.toml" and len(campaign.inputs[0][1]) == 64


def test_volts_become_si_through_the_sensitivity(tmp_path: Path) -> None:
    table = """
    [[channels]]
    name = "hammer"
    role = "reference"
    sensitivity = "2.25 mV/N"

    [[channels]]
    name = "acc"
    unit = "mV"
    sensitivity = "100 mV/g"
    range = "5 V"
    """
    take = acquisition.open_campaign(folder(tmp_path, HEAD + dedent(table) + RUN))["bare"].recordings[0]
    np.testing.assert_allclose(take.signals[0], record().signals[0] / 2.25e-3, rtol=1e-14)
    np.testing.assert_allclose(take.signals[1], record().signals[1] * 1e-3 / 0.1 * 9.80665, rtol=1e-14)
    assert take.channels[1].sensitivity == pytest.approx(0.1 / 9.80665) and take.channels[1].range == pytest.approx(
        50 * 9.80665
    )


def test_a_file_with_units_needs_no_table(tmp_path: Path) -> None:
    stated = tuple(
        Channel(name, Dof(1, "+Z"), quantity, role, unit)
        for name, quantity, role, unit in (("f", "force", "reference", "N"), ("a", "acceleration", "response", "m/s^2"))
    )
    take = dataclasses.replace(record(), channels=stated)
    found = acquisition.open_campaign(folder(tmp_path, HEAD + RUN, {"bare_1.h5": take}))["bare"].recordings[0]
    assert found.channels == stated
    np.testing.assert_array_equal(found.signals, take.signals)


def test_signals_stay_on_disk_until_they_are_used(tmp_path: Path) -> None:
    where = folder(tmp_path, HEAD + CHANNELS + RUN, {"bare_2.h5": {"a": record(), "b": record(30)}})
    run = acquisition.open_campaign(where)["bare"]
    assert [take.signals.shape[1] for take in run.recordings] == [20, 30]
    assert [take.name for take in run.recordings] == ["bare_2.h5, take", "bare_2.h5, take"]
    unused = acquisition.open_campaign(where)["bare"]
    (where / "raw" / "bare_2.h5").unlink()
    assert run.recordings[0].signals.shape[1] == 20, "read once while the campaign is open"
    # the type checks of the tests look at one record of a run, which of them is drawn at random, and so read it
    with pytest.raises(InputError, match="no such file"):
        list(unused.recordings)


def test_an_explicit_list_and_a_table_of_files_say_the_same(tmp_path: Path) -> None:
    files = {"b.h5": record(), "a.h5": record()}
    listed = """
    [[runs]]
    id = "bare"
    files = [{ file = "b.h5", point = 5, setup = "B", dofs = { acc = "9:-Y" } }, { file = "a.h5", point = 6 }]
    """
    (tmp_path / "files.csv").write_text("file;point;setup;acc\nb.h5;5;B;9:-Y\na.h5;6;;\n")
    for number, runs in enumerate((dedent(listed), '[[runs]]\nid = "bare"\nfile_table = "files.csv"\n')):
        run = acquisition.open_campaign(folder(tmp_path, HEAD + CHANNELS + runs, files if not number else {}))["bare"]
        found = [(take.name, take.setup, *(str(channel.dof) for channel in take.channels)) for take in run.recordings]
        assert found == [("b.h5", "B", "5:-Z", "9:-Y"), ("a.h5", "", "6:-Z", "1:+Z")]


def test_set_ups_come_from_the_pattern(tmp_path: Path) -> None:
    files = {f"s{setup}_p{point}.h5": record() for setup in "AB" for point in (1, 2)}
    runs = '[[runs]]\nid = "bare"\nfiles = "s{setup}_p{point}.h5"\n'
    run = acquisition.open_campaign(folder(tmp_path, HEAD + CHANNELS + runs, files))["bare"]
    assert [(take.setup, str(take.channels[0].dof)) for take in run.recordings] == [
        ("A", "1:-Z"),
        ("A", "2:-Z"),
        ("B", "1:-Z"),
        ("B", "2:-Z"),
    ]


def test_columns_make_many_channels(tmp_path: Path) -> None:
    table = '[[channels]]\nname = "acc"\ncolumns = "2-4"\nunit = "g"\ndof = "{column}:+Y"\n'
    take = record(names=("a", "b", "c", "d"))
    run = acquisition.open_campaign(folder(tmp_path, HEAD + table + RUN, {"bare_1.h5": take}))["bare"]
    found = run.recordings[0]
    assert [(channel.name, str(channel.dof)) for channel in found.channels] == [
        ("acc 2", "2:+Y"),
        ("acc 3", "3:+Y"),
        ("acc 4", "4:+Y"),
    ]
    np.testing.assert_allclose(found.signals, take.signals[1:] * 9.80665)


def test_an_unstated_unit_is_a_finding_and_bare_numbers(tmp_path: Path) -> None:
    text = (
        (HEAD + CHANNELS + RUN)
        .replace('unit = "g"', 'unit = "unstated"\nquantity = "acceleration"')
        .replace('range = "50 g"\n', "")
    )
    run = acquisition.open_campaign(folder(tmp_path, text))["bare"]
    assert [finding.code for finding in run.findings] == ["unit-unstated"] and "acc" in run.findings[0].message
    channel = run.recordings[0].channels[1]
    assert not channel.scaled and channel.quantity == "acceleration"
    np.testing.assert_array_equal(run.recordings[0].signals, record().signals)


def test_condition_and_repeat_are_read_in_si(tmp_path: Path) -> None:
    more = 'level = "0.25 kN"\nlevel_std = "10 N"\nband = ["20 Hz", "1.5 kHz"]\ntemperature = "21 degC"\nrepeat = "x"\n'
    run = acquisition.open_campaign(folder(tmp_path, HEAD + CHANNELS + RUN + more)).where(repeat="x")[0]
    excitation = run.condition.excitation
    assert (excitation.level, excitation.std, excitation.band) == (250.0, 10.0, (20.0, 1500.0))
    assert run.condition.temperature == pytest.approx(294.15)


def test_foreign_files_are_read_by_the_options_of_the_campaign(tmp_path: Path) -> None:
    options = '[campaign.reader]\ndecimal = ","\ntime = "t"\n'
    where = folder(tmp_path, HEAD + options + CHANNELS + RUN.replace(".h5", ".csv"), {})
    for point in (1, 2):
        rows = "".join(f"{k * 0.001:.3f};{point + k};{k},5\n".replace(".", ",") for k in range(50))
        (where / "raw" / f"bare_{point}.csv").write_text("t;hammer;acc\n" + rows)
    run = acquisition.open_campaign(where)["bare"]
    take = run.recordings[1]
    assert take.sampling_rate == pytest.approx(1000.0) and take.signals.shape == (2, 50)
    np.testing.assert_allclose(take.signals[0], 2.0 + np.arange(50))
    np.testing.assert_allclose(take.signals[1], 9.80665 * (np.arange(50) + 0.5))


def test_what_a_reader_finds_reaches_the_run(tmp_path: Path) -> None:
    where = folder(tmp_path, HEAD + '[campaign.reader]\ntime = "t"\n' + CHANNELS + RUN.replace(".h5", ".csv"), {})
    rows = "".join(f"{k * 0.001:.3f},{k},{'nan' if k == 7 else k}\n" for k in range(50))
    (where / "raw" / "bare_1.csv").write_text("t,hammer,acc\n" + rows)
    run = acquisition.open_campaign(where)["bare"]
    assert "not-finite" in " ".join(finding.code for finding in run.findings)


# geometry, triaxial and skewed sensors -----------------------------------------------------------------------------------


def test_geometry_inline_and_from_a_table_agree(tmp_path: Path) -> None:
    inline = '[geometry]\nunit = "mm"\nnodes = { 1 = [0, 0, 0], 2 = [500, 0, 1] }\nlines = [[1, 2]]\n'
    (tmp_path / "xyz.csv").write_text("punkt;x;y;z\n1;0;0;0\n2;500,0;0;1,0\n")
    table = '[geometry]\nfile = "xyz.csv"\nnode = "punkt"\nunit = "mm"\nlines = [[1, 2]]\n'
    for text in (inline, table):
        found = acquisition.open_campaign(folder(tmp_path, HEAD + CHANNELS + text + RUN)).geometry
        assert found is not None and found.nodes.tolist() == [1, 2] and found.lines == ((1, 2),)
        np.testing.assert_allclose(found.xyz, [[0, 0, 0], [0.5, 0, 0.001]])


def test_geometry_in_our_own_file(tmp_path: Path) -> None:
    where = folder(tmp_path, HEAD + CHANNELS + '[geometry]\nfile = "g.h5"\n' + RUN)
    store.save(where / "raw" / "g.h5", Geometry(np.array([1, 2, 10]), np.zeros((3, 3))))
    campaign = acquisition.open_campaign(where)
    assert campaign.geometry is not None and campaign.geometry.nodes.tolist() == [1, 2, 10]
    assert campaign.findings == ()


def test_a_measured_node_without_position_is_a_finding(tmp_path: Path) -> None:
    text = '[geometry]\nunit = "m"\nnodes = { 1 = [0, 0, 0], 2 = [1, 0, 0] }\n'
    findings = acquisition.open_campaign(folder(tmp_path, HEAD + CHANNELS + text + RUN)).findings
    assert [finding.code for finding in findings] == ["node-without-position"] and "10" in findings[0].message


NODES = '[geometry]\nunit = "m"\nnodes = { 1 = [0, 0, 0], 2 = [1, 0, 0], 10 = [2, 0, 0] }\n'


def test_a_triaxial_sensor_is_three_channels_at_one_node(tmp_path: Path) -> None:
    table = """
    [[channels]]
    names = ["tx", "ty", "tz"]
    unit = "m/s^2"
    node = "{point}"
    directions = ["+Y", "-X", "+Z"]
    """
    files = {"bare_2.h5": record(names=("tz", "hammer", "tx", "ty"))}
    run = acquisition.open_campaign(folder(tmp_path, HEAD + dedent(table) + RUN, files))["bare"]
    assert [str(channel.dof) for channel in run.recordings[0].channels] == ["2:+Y", "2:-X", "2:+Z"]
    np.testing.assert_array_equal(run.recordings[0].signals, files["bare_2.h5"].signals[[2, 3, 0]])


def test_skewed_directions_become_local_axes(tmp_path: Path) -> None:
    """The unit vector of every DOF in the geometry is the vector that the campaign states, sign included."""
    c, s = float(np.cos(np.radians(30))), float(np.sin(np.radians(30)))
    vectors = {"x": [c, s, 0.0], "y": [-s, c, 0.0], "z": [0.0, 0.0, -1.0]}
    table = "[[channels]]\nnames = ['x', 'y', 'z']\nunit = 'm/s^2'\nnode = 2\ndirections = " + str(
        list(vectors.values())
    )
    single = f"\n[[channels]]\nname = 'w'\nunit = 'm/s^2'\nnode = 1\ndirection = {[0.0, -s, c]}\n"
    files = {"bare_1.h5": record(names=("x", "y", "z", "w"))}
    campaign = acquisition.open_campaign(folder(tmp_path, HEAD + NODES + table + single + RUN, files))
    assert campaign.geometry is not None and campaign.geometry.axes is not None
    for axes in campaign.geometry.axes:
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(axes) == pytest.approx(1.0)
    np.testing.assert_array_equal(campaign.geometry.axes[2], np.eye(3))
    channels = campaign["bare"].recordings[0].channels
    for channel, vector in zip(channels, [*vectors.values(), [0.0, -s, c]], strict=True):
        assert channel.dof is not None
        np.testing.assert_allclose(campaign.geometry.direction(channel.dof), vector, atol=1e-9)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (
            "node = 2\ndirection = [0.0, 0.6, 0.8]\n[[channels]]\nname = 'acc'\nunit = 'g'\nnode = 2\ndirection = [0.0, 1.0, 0.0]",
            "not at right angles",
        ),
        (
            "node = 2\ndirection = [0.0, 0.6, 0.8]\n[[channels]]\nname = 'acc'\nunit = 'g'\nnode = 2\ndirection = '+Z'",
            "local axes only",
        ),
        ("node = 2\ndirection = [0.0, 0.0, 0.0]", "without length"),
        ("node = 99\ndirection = [0.0, 0.6, 0.8]", "no such node"),
    ],
)
def test_impossible_directions_are_refused(tmp_path: Path, table: str, message: str) -> None:
    text = HEAD + NODES + "[[channels]]\nname = 'hammer'\nunit = 'N'\n" + table + "\n" + RUN
    with pytest.raises(InputError, match=message):
        acquisition.open_campaign(folder(tmp_path, text))


def test_a_skewed_sensor_needs_a_geometry(tmp_path: Path) -> None:
    text = HEAD + "[[channels]]\nname = 'acc'\nunit = 'g'\nnode = 2\ndirection = [0.0, 0.6, 0.8]\n" + RUN
    with pytest.raises(InputError, match="needs a geometry"):
        acquisition.open_campaign(folder(tmp_path, text))


# FRFs -------------------------------------------------------------------------------------------------------------------


def test_frfs_of_a_roving_hammer_become_one_set(tmp_path: Path) -> None:
    files = {f"bare_{point}.h5": frf("0", "0", point * 1j, unit="unstated") for point in (1, 2, 10)}
    run = acquisition.open_campaign(
        folder(tmp_path, HEAD + CHANNELS + RUN + 'estimator = "H1"\naverages = 5\n', files)
    )["bare"]
    found = run.frfs[0]
    assert found.values.shape == (30, 1, 3) and [str(dof) for dof in found.inputs] == ["1:-Z", "2:-Z", "10:-Z"]
    assert (found.quantity, found.unit, found.estimator) == ("accelerance", "(m/s^2)/N", "H1")
    np.testing.assert_allclose(found.values[0, 0], np.array([1j, 2j, 10j]) * 9.80665)
    assert found.averages is not None and (found.averages == 5).all()
    assert found.condition == run.condition and len(run.recordings) == 0


def test_large_frfs_are_read_when_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    where = folder(tmp_path, HEAD + RUN, {"bare_1.h5": frf("1:+Z", "7:-Z", 1)})
    small = acquisition.open_campaign(where)["bare"]
    monkeypatch.setattr("acquisition.folder._KEPT", 0)
    large = acquisition.open_campaign(where)["bare"]
    assert isinstance(small.frfs, tuple) and isinstance(large.frfs, Lazy)
    np.testing.assert_array_equal(large.frfs[0].values, small.frfs[0].values)
    assert large.frfs[0].condition == large.condition


def test_frfs_have_no_channel_for_the_normal_force(tmp_path: Path) -> None:
    force = '[[runs.normal_force]]\njoint = "J1"\nchannel = "ring"\n'
    with pytest.raises(InputError, match="the run has no records, so no channel of a record; got ring"):
        acquisition.open_campaign(folder(tmp_path, HEAD + RUN + force, {"bare_1.h5": frf("1:+Z", "7:-Z", 1)}))


def test_frfs_with_their_own_dofs_and_units_need_no_table(tmp_path: Path) -> None:
    files = {"bare_1.h5": {"a": frf("1:+Z", "7:-Z", 1), "b": frf("2:-Z", "7:+Z", 2)}}
    found = acquisition.open_campaign(folder(tmp_path, HEAD + RUN, files))["bare"].frfs[0]
    assert [str(dof) for dof in found.outputs] == ["1:+Z", "2:-Z"] and [str(dof) for dof in found.inputs] == ["7:-Z"]
    np.testing.assert_array_equal(found.values[0, :, 0], [1, -2])


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({"bare_1.h5": frf("1", "1"), "bare_2.h5": frf("1", "2", lines=31)}, "unequal frequency axes; got 31 lines"),
        (
            {"bare_1.h5": frf("1", "1"), "bare_2.h5": frf("1", "1")},
            "measured twice in one set-up; got 1:S/1:S in bare_1.h5 and",
        ),
        ({"bare_1.h5": frf("1", "1"), "bare_2.h5": frf("2", "2")}, "an FRF is missing; got no 1:S/2:S"),
        ({"bare_1.h5": frf("1", "1"), "bare_2.h5": frf("1", "2", quantity="mobility", unit="(m/s)/N")}, "mixed units"),
        ({"bare_1.h5": frf("1", "1", unit="unstated")}, "says in which unit"),
        ({"bare_1.h5": {"a": frf("1", "1"), "b": record()}}, "both records and FRFs"),
        ({"bare_1.h5": Geometry(np.array([1]), np.zeros((1, 3)))}, "neither records nor FRFs"),
    ],
)
def test_frfs_that_do_not_fit_are_refused(tmp_path: Path, files: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        acquisition.open_campaign(folder(tmp_path, HEAD + RUN, files))


def test_a_table_of_another_size_than_the_frfs_is_refused(tmp_path: Path) -> None:
    more = CHANNELS + '[[channels]]\nname = "acc 2"\nunit = "g"\ndof = "2:+Z"\n'
    with pytest.raises(InputError, match="another number of response channels than the table; got 1, expected 2"):
        acquisition.open_campaign(folder(tmp_path, HEAD + more + RUN, {"bare_1.h5": frf("1", "1")}))


# what can be wrong ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("files", "message"),
    [
        (
            {"bare_2.h5": record(names=("hammer", "acc2"))},
            "no such channel in the file; got 'acc', expected one of hammer, acc2",
        ),
        ({"bare_2.h5": record(names=("acc", "acc", "hammer"))}, "two channels of one name"),
        ({"bare_2.h5": record(), "bare_3.h5": record(rate=500.0)}, "unequal sampling rates in one run; got 500 Hz"),
        ({"bare_2.h5": record(samples=1)}, "a record without signals; got 1 samples"),
        ({"other.h5": record()}, "no file matches the pattern; got bare_{point}.h5.*there are other.h5"),
        ({}, "the folder of the data files is empty"),
    ],
)
def test_records_that_do_not_fit_are_refused(tmp_path: Path, files: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        acquisition.open_campaign(folder(tmp_path, HEAD + CHANNELS + RUN, files))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('unit = "g"\n', "", 'neither the file nor the channel table says in which unit.*or unit = "unstated"'),
        ('range = "50 g"', 'range = "50 N"', "the range is of another quantity"),
        ('dof = "1:+Z"', 'dof = "one"', "not a DOF"),
        ('dof = "1:+Z"', 'dof = "{station}:+Z"', "nothing says what {station} is"),
        ('name = "acc"', "column = 3", "no such column in the file; got 3, expected 1 to 2"),
        ('name = "acc"', 'name = "acc"\nrole = "reference"', None),
        ('files = "bare_{point}.h5"', 'files = "bare_2.h4"', "there is no such file"),
        (
            'files = "bare_{point}.h5"',
            'files = ["bare_{point}.h5", "bare_2.h5"]',
            "a file is named twice; got bare_2.h5",
        ),
        ('files = "bare_{point}.h5"', 'file_table = "no.csv"', "there is no such file"),
        ('files = "raw"', 'files = "row"', "there is no folder of data files; got"),
        ('files = "raw"', 'files = "${NOT_SET_HERE}/raw"', "an environment variable is not set; got .{NOT_SET_HERE}"),
    ],
)
def test_wrong_statements_are_refused(tmp_path: Path, old: str, new: str, message: str | None) -> None:
    text = HEAD + CHANNELS + RUN
    assert old in text
    where = folder(tmp_path, text.replace(old, new))
    if message is None:
        acquisition.open_campaign(where)
        return
    with pytest.raises(InputError, match=message) as caught:
        acquisition.open_campaign(where)
    assert len(str(caught.value).splitlines()) == 1


def test_two_channels_with_one_dof_are_refused(tmp_path: Path) -> None:
    more = '[[channels]]\nname = "hammer"\nunit = "N"\ndof = "1:-Z"\n'
    with pytest.raises(InputError, match="two channels with one DOF; got 1:-Z for acc and hammer"):
        acquisition.open_campaign(folder(tmp_path, HEAD + CHANNELS + more + RUN))


@pytest.mark.parametrize("link", [False, True])
def test_one_file_under_two_names_is_a_finding(tmp_path: Path, link: bool) -> None:
    rng = np.random.default_rng(4)
    files: dict[str, object] = {
        f"bare_{point}.h5": dataclasses.replace(record(), signals=rng.standard_normal((2, 20))) for point in (1, 2, 3)
    }
    where = folder(tmp_path, HEAD + CHANNELS + RUN, files)
    assert acquisition.open_campaign(where)["bare"].findings == ()
    raw, copy = where / "raw", where / "raw" / "bare_7.h5"
    copy.symlink_to(raw / "bare_2.h5") if link else copy.write_bytes((raw / "bare_2.h5").read_bytes())
    (found,) = acquisition.open_campaign(where)["bare"].findings
    assert (found.code, found.severity, found.value) == ("copied-file", "error", 2)
    assert "bare_2.h5, bare_7.h5" in found.message


@pytest.mark.parametrize(("second", "named"), [("b_7.h5", True), ("a_1.h5", True), ("b_8.h5", False)])
def test_repeats_of_one_measurement_are_a_finding(tmp_path: Path, second: str, named: bool) -> None:
    runs = "".join(
        f'[[runs]]\nid = "{name}"\nkind = "hammer"\nfiles = [{{ file = "{file}", point = 1 }}]\nrepeat = "bare"\n'
        for name, file in (("first", "a_1.h5"), ("second", second))
    )
    files: dict[str, object] = {"a_1.h5": record(), "b_7.h5": record(), "b_8.h5": record(21)}
    found = acquisition.open_campaign(folder(tmp_path, HEAD + CHANNELS + runs, files)).findings
    assert [finding.code for finding in found] == (["copied-file"] if named else [])
    if named:
        assert "Runs first and second repeat one condition with the same measurement" in found[0].message


def test_one_file_may_hold_several_repeats(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    (tmp_path / "raw").mkdir()
    takes = {"first": rng.standard_normal((40, 2)), "second": rng.standard_normal((40, 2))}
    np.savez(tmp_path / "raw" / "both.npz", **takes)
    table = '[[channels]]\ncolumn = 1\nrole = "reference"\nunit = "N"\n[[channels]]\ncolumn = 2\nunit = "g"\n'
    runs = "".join(
        f'[[runs]]\nid = "{name}"\nkind = "hammer"\nfiles = "both.npz"\nrepeat = "bare"\n'
        f'reader = {{ signals = "{name}", sampling_rate = 1000.0 }}\n'
        for name in takes
    )
    assert acquisition.open_campaign(folder(tmp_path, HEAD + table + runs, {})).findings == ()


def test_one_channel_of_a_file_is_not_measured_at_two_places(tmp_path: Path) -> None:
    more = '[[channels]]\nname = "acc"\nunit = "g"\ndof = "4:+Z"\n'
    with pytest.raises(InputError, match="one channel of the file stands twice in the channel table; got 'acc'"):
        acquisition.open_campaign(folder(tmp_path, HEAD + CHANNELS + more + RUN))


def test_a_repair_parts_two_channels_with_one_dof(tmp_path: Path) -> None:
    more = '[[channels]]\nname = "hammer"\nunit = "N"\ndof = "1:-Z"\n'
    repair = '[[repairs]]\nwhat = "move dof"\nchannel = "acc"\ndof = "1:+Z"\nto = "8:+Z"\nwho = "me"\nwhy = "photo"\n'
    take = acquisition.open_campaign(folder(tmp_path, HEAD + CHANNELS + more + RUN + repair))["bare"].recordings[0]
    assert [str(channel.dof) for channel in take.channels] == ["2:-Z", "8:+Z", "1:-Z"]


def test_mixed_units_between_the_files_of_a_run_are_refused(tmp_path: Path) -> None:
    def stated(quantity: str, unit: str) -> Recording:
        channels = (
            Channel("hammer", None, "force", "reference", "N"),
            Channel("acc", None, quantity, "response", unit),
        )  # type: ignore[arg-type]
        return dataclasses.replace(record(), channels=channels)

    files = {"bare_1.h5": stated("acceleration", "m/s^2"), "bare_2.h5": stated("velocity", "m/s")}
    with pytest.raises(
        InputError, match=r"mixed units in one run; got velocity in m/s, expected acceleration in m/s\^2"
    ):
        acquisition.open_campaign(folder(tmp_path, HEAD + RUN, files))
    with pytest.raises(InputError, match="disagree about what is measured; got m/s in the file"):
        acquisition.open_campaign(folder(tmp_path, HEAD + CHANNELS + RUN, files))


def _stating(path: Path, unit: str, kind: str) -> str:
    """A run whose files hold the numbers of :func:`record` in a unit that they state."""
    (path / "raw").mkdir(parents=True)
    hammer, acc = record().signals
    if kind == "uff":
        names = ("hammer", "N"), ("acc", unit)
        channels = tuple(Channel(name, Dof(k), unit="unstated") for k, (name, _) in enumerate(names, 1))
        acquisition.write(path / "raw" / "bare_2.uff", Recording(record().signals, RATE, channels, name="take"))
        text = (path / "raw" / "bare_2.uff").read_text()
        for _, label in names:  # of the ordinates in their order
            text = text.replace(f"{'unstated':<20} unstated", f"{'NONE':<20} {label:<8}", 1)
        (path / "raw" / "bare_2.uff").write_text(text)
    elif kind == "csv":
        rows = "".join(f"{n / RATE:.3f},{a},{b}\n" for n, (a, b) in enumerate(zip(hammer, acc, strict=True)))
        (path / "raw" / "bare_2.csv").write_text(f"t [s],hammer [N],acc [{unit}]\n{rows}")
    else:
        nptdms = pytest.importorskip("nptdms")
        channels = [("hammer", hammer, "N"), ("acc", acc, unit)]
        with nptdms.TdmsWriter(path / "raw" / "bare_2.tdms") as writer:
            writer.write_segment(
                [
                    nptdms.ChannelObject("g", name, values, {"wf_increment": 1 / RATE, "unit_string": text})
                    for name, values, text in channels
                ]
            )
    return RUN.replace("h5", kind)


@pytest.mark.parametrize("kind", ["csv", "tdms", "uff"])
def test_the_file_and_the_channel_table_state_one_unit(tmp_path: Path, kind: str) -> None:
    """The unit of the table had been passed over: numbers in g were taken for those in m/s^2 that the file states."""
    run = _stating(tmp_path / "a", "m/s^2", kind)
    with pytest.raises(
        InputError, match=r"disagree about the unit; got m/s\^2 in the file, expected g as in the table"
    ):
        acquisition.open_campaign(folder(tmp_path / "a", HEAD + CHANNELS + run, {}))
    bare = CHANNELS.replace('unit = "g"\n', "")
    acc = record().signals[1]
    taken = acquisition.open_campaign(folder(tmp_path / "a", HEAD + bare + run, {}))["bare"].recordings[0]
    np.testing.assert_allclose(taken.signals[1], acc, rtol=1e-12)
    run = _stating(tmp_path / "b", "g", kind)
    for table in (bare, CHANNELS, CHANNELS.replace('"g"', '"gn"')):
        taken = acquisition.open_campaign(folder(tmp_path / "b", HEAD + table + run, {}))["bare"].recordings[0]
        np.testing.assert_allclose(taken.signals[1], 9.80665 * acc, rtol=1e-12)
    repair = '[[repairs]]\nwhat = "unit"\nchannel = "acc"\nunit = "m/s^2"\nwho = "me"\nwhy = "data sheet"\n'
    with pytest.raises(InputError, match="a repair that changes nothing"):
        acquisition.open_campaign(folder(tmp_path / "b", HEAD + bare + run + repair, {}))
    repair += 'was = "g"\n'
    taken = acquisition.open_campaign(folder(tmp_path / "b", HEAD + bare + run + repair, {}))["bare"].recordings[0]
    np.testing.assert_allclose(taken.signals[1], acc, rtol=1e-12)


FRF_TABLE = """
[[channels]]
name = "hammer"
role = "reference"
unit = "N"
dof = "1:-Z"

[[channels]]
name = "acc"
role = "response"
unit = "g"
dof = "1:+Z"
"""


def _frf_stating(path: Path, response: str, force: str, kind: str) -> str:
    """A run of one FRF of ones, whose file states the units."""
    (path / "raw").mkdir(parents=True)
    file = path / "raw" / f"bare_2.{kind}"
    match kind:
        case "csv":
            rows = "".join(f"{line},1.0,0.0\n" for line in range(30))
            file.write_text(f"Frequency [Hz],Real [{response}/{force}],Imag [{response}/{force}]\n{rows}")
        case "h5":
            with h5py.File(file, "w") as held:
                held["f"], held["H"] = np.arange(30.0), np.ones(30, complex)
                held["H"].attrs["units"] = f"({response})/{force}"
        case _:
            text = Function(True, 1, 3, 0.0, 1.0, np.ones(30, complex), double=True).bytes().decode()
            labels = (
                (f"{'m/s^2':>20s}", f"{response:>20s}"),
                (f"{'NONE':>20s} {'N':>20s}", f"{'NONE':>20s} {force:>20s}"),
            )
            for was, now in labels:
                text = text.replace(was, now, 1)
            file.write_text(text)
    reader = 'reader = {frf = "H", frequency = "f"}\n' if kind == "h5" else ""
    return RUN.replace("h5", kind) + reader


@pytest.mark.parametrize("kind", ["csv", "h5", "uff"])
def test_a_file_of_frfs_and_the_channel_table_state_one_unit(tmp_path: Path, kind: str) -> None:
    """As with records: the unit of the table had been passed over."""
    one_unit = r"disagree about the unit; got m/s\^2 in the file, expected g as in the table"
    run = _frf_stating(tmp_path / "a", "m/s^2", "N", kind)
    for table in (FRF_TABLE, FRF_TABLE.replace('unit = "N"\n', "")):
        with pytest.raises(InputError, match=one_unit):
            acquisition.open_campaign(folder(tmp_path / "a", HEAD + table + run, {}))
    with pytest.raises(InputError, match="got N in the file, expected lbf as in the table"):
        table = FRF_TABLE.replace('"N"', '"lbf"').replace('unit = "g"\n', "")
        acquisition.open_campaign(folder(tmp_path / "a", HEAD + table + run, {}))
    run = _frf_stating(tmp_path / "b", "g", "lbf", kind)
    stated = FRF_TABLE.replace('"N"', '"lbf"')
    bare = stated.replace('unit = "g"\n', "").replace('unit = "lbf"\n', "")
    for table in (stated, bare, stated.replace('"g"', '"gn"')):
        found = acquisition.open_campaign(folder(tmp_path / "b", HEAD + table + run, {}))["bare"].frfs[0]
        np.testing.assert_allclose(found.values, 9.80665 / 4.4482216152605, rtol=1e-12)
    repair = (
        '[[repairs]]\nwhat = "unit"\nrole = "response"\nunit = "m/s^2"\nwas = "g"\nwho = "me"\nwhy = "data sheet"\n'
    )
    found = acquisition.open_campaign(folder(tmp_path / "b", HEAD + bare + run + repair, {}))["bare"].frfs[0]
    np.testing.assert_allclose(found.values, 1 / 4.4482216152605, rtol=1e-12)


@pytest.mark.parametrize("frf", [False, True], ids=["records", "FRFs"])
def test_units_of_data_set_164_are_compared_with_the_channel_table(tmp_path: Path, frf: bool) -> None:
    values = np.ones(30, complex) if frf else np.sin(np.arange(30.0))
    text = Function(frf, 1, 3, 0.0, 1.0, values, double=True).bytes().decode()
    text = text.replace(f"{'m/s^2':>20s}", f"{'NONE':>20s}", 1).replace(f" {'N':>20s}", f" {'NONE':>20s}", 1)
    factors = "".join(f"{factor:25.17E}" for factor in (1000.0, 1.0, 1.0)).replace("E", "D")
    system = f"    -1\n   164\n{9:10d}{'mm, N':<20s}{2:10d}\n{factors}\n{0.0:25.17E}\n    -1\n"
    (tmp_path / "raw").mkdir()
    (tmp_path / "raw" / "bare_2.uff").write_text(system + text)
    run = RUN.replace("h5", "uff").replace('"hammer"', '"hammer"' if frf else '"sweep"')
    table = FRF_TABLE if frf else '[[channels]]\ncolumn = 1\nname = "acc"\nunit = "g"\ndof = "1:+Z"\n'
    with pytest.raises(InputError, match=r"got mm/s\^2 in the file, expected g as in the table"):
        acquisition.open_campaign(folder(tmp_path, HEAD + table + run, {}))
    found = acquisition.open_campaign(folder(tmp_path, HEAD + table.replace('"g"', '"mm/s^2"') + run, {}))["bare"]
    taken = found.frfs[0].values[:, 0, 0] if frf else found.recordings[0].signals[0]
    np.testing.assert_allclose(taken, values / 1000, rtol=1e-12)


def test_a_path_without_campaign_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no campaign here"):
        acquisition.open_campaign(tmp_path)
    with pytest.raises(InputError, match="there is no campaign here"):
        acquisition.open_campaign(tmp_path / "nowhere")


def test_a_built_in_campaign_names_the_command_that_makes_it(tmp_path: Path) -> None:
    head = HEAD + 'generator = "virtual_table_hammer"\n'
    with pytest.raises(InputError, match=r"not been generated yet; `ema run reports/table_hammer.toml` makes them"):
        acquisition.open_campaign(folder(tmp_path, head + CHANNELS + RUN, {}))


def test_an_absent_measurement_folder_asks_for_the_variable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("EMA_DATASETS", str(tmp_path / "nowhere"))
    text = (HEAD + CHANNELS + RUN).replace('"raw"', '"${EMA_DATASETS}/02"')
    with pytest.raises(InputError, match="set EMA_DATASETS"):
        acquisition.open_campaign(folder(tmp_path, text))


def test_a_path_with_blanks_and_umlauts(tmp_path: Path) -> None:
    where = folder(tmp_path / "Prüf stand №1", HEAD + CHANNELS + RUN)
    assert len(acquisition.open_campaign(where / "campaign.toml")["bare"].recordings) == 2


def test_opening_can_be_cancelled(tmp_path: Path) -> None:
    with pytest.raises(CancelledError):
        acquisition.open_campaign(folder(tmp_path, HEAD + CHANNELS + RUN), progress=lambda what, done, total: False)


# the file itself ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("role =", "rol =", 7, r"unknown key 'rol' in \[\[channels\]\] number 1; did you mean role\?"),
        ("[[runs]]", "[[run]]", 18, r"unknown key 'run' in the file.*did you mean runs\?"),
        ('id = "bare"\n', "", 18, r"\[\[runs\]\] number 1 lacks 'id'"),
        ('unit = "g"', 'unit = "gg"', 13, r"\[\[channels\]\] number 2, unit: not a unit; got 'gg'"),
        ('kind = "hammer"', 'kind = "hamer"', 20, "input should be 'hammer', 'sweep'.*got 'hamer'"),
        ('dof = "1:+Z"', 'dof = "1:+Z"\nnode = 3', 11, "a channel has a dof, or a node with a direction; not both"),
        ('name = "acc"', "", 11, "nothing says which channel of the file this is"),
        ('unit = "g"', 'unit = "g"\nquantity = "force"', 11, "'g' is a unit of acceleration, not of force"),
        ('files = "bare_{point}.h5"\n', "", 18, "a run names its files"),
        (
            'kind = "hammer"',
            "reader = { sampling_rat = 5 }",
            20,
            "unknown option .*'?sampling_rat.*did you mean sampling_rate",
        ),
        ('kind = "hammer"', 'temperature = "-300 degC"', 20, "below absolute zero"),
        ('kind = "hammer"', "averages = true", 20, "averages: input should be a valid integer"),
        ('name = "test"', "name = test", None, "not TOML"),
        ('kind = "hammer"', 'level = "1e999 N"', 20, "level: not a finite number; got '1e999 N'"),
        ('kind = "hammer"', 'level = "-5 N"', 20, "level: not above 0; got '-5 N'"),
        ('kind = "hammer"', 'level_std = "-1 N"', 20, "level_std: below 0; got '-1 N'"),
        ('kind = "hammer"', 'period = "0 s"', 20, "period: not above 0"),
        ('kind = "hammer"', 'band = ["0.2 kHz", "10 Hz"]', 20, "band: .* from the lowest to the highest"),
        ('kind = "hammer"', 'band = ["-1 Hz", "10 Hz"]', 20, "band.*below 0; got '-1 Hz'"),
        ('kind = "hammer"', 'normal_force = [{ joint = "J1", value = "-500 N" }]', 20, "value: below 0; got '-500 N'"),
        (
            'kind = "hammer"',
            'normal_force = [{ joint = "J1", value = "5 N", std = "-1 N" }]',
            20,
            "std: below 0; got '-1 N'",
        ),
        ('kind = "hammer"', 'normal_force = [{ joint = "J1", nominal = "0 N" }]', 20, "nominal: not above 0"),
        (
            'kind = "hammer"',
            'normal_force = [{ joint = "J", file = "f", column = "J", unit = "N", between = ["5 min", "2 min"] }]',
            20,
            "between: .* from the first to the last",
        ),
        ('kind = "hammer"', 'normal_force = [{ joint = "", value = "5 N" }]', 20, "joint: .*at least 1 character"),
        ('id = "bare"', 'id = ""', 19, "id: .*at least 1 character"),
        ('unit = "g"', 'sensitivity = "1e999 mV/g"', 13, "sensitivity: not a finite number"),
        ('range = "50 g"', 'range = "-50 g"', 15, "range: not above 0; got '-50 g'"),
        ('name = "acc"', 'columns = "1-999999999999"', 12, "columns: .*more columns than any file has"),
        ('name = "acc"', 'columns = "9-3"', 12, "columns: .*ends before it begins"),
    ],
)
def test_mistakes_are_named_with_their_line(old: str, new: str, line: int | None, message: str) -> None:
    text = HEAD + CHANNELS + RUN
    assert old in text
    with pytest.raises(InputError, match=message) as caught:
        campaign_file.parse(text.replace(old, new, 1))
    assert len(str(caught.value).splitlines()) == 1
    if line is not None:
        assert f"campaign.toml, line {line}:" in str(caught.value)


def test_the_mark_of_utf_8_that_editors_write_is_no_part_of_the_text(tmp_path: Path) -> None:
    (tmp_path / "campaign.toml").write_text(HEAD + CHANNELS + RUN, encoding="utf-8-sig")
    assert campaign_file.load(tmp_path) == campaign_file.parse(HEAD + CHANNELS + RUN)


def test_lines_are_right_behind_text_and_lists_over_several_lines() -> None:
    text = (
        HEAD
        + 'comment = """\n[[runs]]\nrol = 3\n"""\nphotos = [\n  "a=[",\n]\n'
        + CHANNELS.replace("role", "rolle")
        + RUN
    )
    with pytest.raises(InputError, match="line 14: unknown key 'rolle'"):
        campaign_file.parse(text)


def test_runs_and_joints_have_names_of_their_own() -> None:
    with pytest.raises(InputError, match="two runs are called bare"):
        campaign_file.parse(HEAD + CHANNELS + RUN + RUN)
    force = '[[runs.normal_force]]\njoint = "J2"\nvalue = "1 kN"\n'
    with pytest.raises(InputError, match="run bare has a normal force for joint J2, which is none of the joints J1"):
        campaign_file.parse(HEAD + CHANNELS + RUN + force + '[[joints]]\nname = "J1"\n')
