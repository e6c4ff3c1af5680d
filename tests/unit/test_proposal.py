"""What a folder of measurements holds is found out from names, units, shapes of signals and positions."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

import acquisition
from ema import proposal, show, store
from ema.data import Channel, Geometry, Recording
from ema.dof import Dof
from ema.errors import InputError
from ema.examples import modal_model
from ema.proposal import positions
from ema.proposal.array_layouts import described
from ema.proposal.examination import facts_of
from ema.proposal.file_names import series_of, taken_apart
from ema.proposal.roles import judge, same_point
from ema.proposal.toml_text import table_text, value_text

RATE = 2048.0


@pytest.mark.parametrize(
    ("name", "series", "numbers", "directions"),
    [
        ("P-12-3.txt", "P-#-#.txt", (12, 3), ("", "")),
        ("Hxysv00007.txt.gz", "Hxysv#.txt.gz", (7,), ("",)),
        ("pt01_x.uff", "pt#.uff", (1,), ("+X",)),
        ("P12Z+.uff", "P#.uff", (12,), ("+Z",)),
        ("P12-Y.uff", "P#.uff", (12,), ("-Y",)),
        ("FRF_12Z_5Z.uff", "FRF_#_#.uff", (12, 5), ("+Z", "+Z")),
        ("beam_1kN_42.uff", "beam_1kN_#.uff", (42,), ("",)),
        ("beam_1p5kN_5Nm_3.h5", "beam_1p5kN_5Nm_#.h5", (3,), ("",)),
        ("1Hz36lbtension0.5amplitude.json.gz", "1Hz36lbtension0.5amplitude.json.gz", (), ()),
        ("mode1_FE15_FN0050.h5", "mode1_FE15_FN0050.h5", (), ()),
    ],
)
def test_a_name_is_taken_apart(name, series, numbers, directions) -> None:
    found = taken_apart(name)
    assert (found.series, found.numbers, found.directions) == (series, numbers, directions)


@pytest.mark.parametrize(
    ("names", "pattern", "counts"),
    [
        (["pt1.uff", "pt2.uff", "pt10.uff"], "pt{point}.uff", ("point",)),
        (["p1_hit1.h5", "p1_hit2.h5", "p2_hit1.h5"], "p{point}_hit{take}.h5", ("point", "take")),
        (
            ["plate3_1.csv", "plate3_2.csv", "plate4_1.csv", "plate5_1.csv"],
            "plate{point}_{take}.csv",
            ("point", "take"),
        ),
        (["FRF_12Z_5Z.uff", "FRF_13Z_5Z.uff"], None, ("point", "input")),
        (["Meas7.uff", "Meas8.uff"], "Meas{point}.uff", ("point",)),
        *[
            ([f"{word}{number}.mat" for number in ("01", "02", "10")], f"{word}{{point}}.mat", ("point",))
            for word in ("Punkt", "Point ", "Pos_", "position", "Stelle-", "Messstelle ", "Knoten", "node", "Pt")
        ],
        (["abc7.uff", "abc8.uff"], "abc{take}.uff", ("",)),
    ],
)
def test_series_know_what_their_numbers_count(names, pattern, counts) -> None:
    (series,) = series_of(names)
    assert series.counts == counts
    assert series.open == (counts == ("",))
    if pattern is not None:
        assert series.pattern == pattern


def ringing(frequency: float = 60.0, seed: int = 0) -> np.ndarray:
    """A hammer test of one degree of freedom: a half sine, and the response of an oscillator."""
    t = np.arange(4096) / RATE
    h = np.exp(-8 * t) * np.sin(2 * np.pi * frequency * t)
    noise = np.random.default_rng(seed).normal(size=len(t))
    return np.convolve(pulse(), h)[: len(t)] / 10 + 1e-3 * noise


def pulse() -> np.ndarray:
    force = np.zeros(4096)
    force[200:208] = 100 * np.sin(np.pi * np.arange(8) / 8)
    return force


def recording(*channels: tuple[str, np.ndarray, str]) -> Recording:
    quantities = {"N": "force", "m/s^2": "acceleration", "unstated": "unstated"}
    listed = tuple(Channel(name, quantity=quantities[unit], unit=unit) for name, _, unit in channels)
    return Recording(np.array([row for _, row, _ in channels]), RATE, channels=listed)


def test_the_force_is_found_by_its_shape_where_names_are_silent() -> None:
    found = judge(recording(("a", ringing(), "unstated"), ("b", pulse(), "unstated"), ("c", ringing(90), "unstated")))
    assert [one.role for one in found.channels] == ["response", "reference", "response"]
    assert found.kind == "hammer" and not found.warnings


def test_forces_of_shakers_are_white_and_responses_are_not() -> None:
    rng = np.random.default_rng(3)
    forces = rng.normal(size=(2, 16384))
    t = np.arange(4096) / RATE
    h = np.exp(-5 * t) * np.sin(2 * np.pi * 200 * t)
    response = np.convolve(forces.sum(axis=0), h)[:16384]
    rows = [("1", forces[0], "unstated"), ("2", response, "unstated"), ("3", forces[1], "unstated")]
    found = judge(recording(*rows))
    assert [one.role for one in found.channels] == ["reference", "response", "reference"]
    assert found.kind == "random"


@pytest.mark.parametrize(
    ("name", "role"), [("Source 1", "generator"), ("generator signal", "generator"), ("x", "response")]
)
def test_the_signal_of_the_generator_is_known_by_its_name_where_there_is_one_for_each_force(
    name: str, role: str
) -> None:
    rng = np.random.default_rng(5)
    drive = rng.normal(size=16384)
    h = np.exp(-5 * np.arange(4096) / RATE) * np.sin(2 * np.pi * 200 * np.arange(4096) / RATE)
    force = drive + 0.1 * rng.normal(size=16384)
    rows = [("force", force, "N"), ("acc", np.convolve(force, h)[:16384], "m/s^2"), (name, drive, "unstated")]
    assert [one.role for one in judge(recording(*rows)).channels] == ["reference", "response", role]
    two = judge(recording(*rows, ("generator 2", drive, "unstated")))
    assert two.channels[3].role == ("other" if role == "generator" else "generator")
    assert judge(recording(("source force", force, "unstated"), *rows[1:2])).channels[0].role == "reference"


def test_a_sweep_is_known_by_its_frequency() -> None:
    t = np.arange(4 * 2048) / RATE
    force = np.sin(2 * np.pi * (20 * t + 0.5 * 70 * t**2))
    found = judge(recording(("force", force, "N"), ("acc", np.gradient(force), "m/s^2")))
    # the first and the last of 24 parts run over 12 Hz each, seen in steps of 6 Hz
    assert found.kind == "sweep" and found.band == pytest.approx((20, 300), abs=18)


def test_a_force_that_presses_is_a_normal_force() -> None:
    ring = 1020 + 3 * np.random.default_rng(1).normal(size=4096)
    found = judge(recording(("hammer", pulse(), "N"), ("cell", ring, "N"), ("acc 12:+Z", ringing(), "m/s^2")))
    assert [one.role for one in found.channels] == ["reference", "normal force", "response"]
    assert found.channels[2].dof == Dof(12, "+Z")


def test_free_vibration_has_no_force_and_dies_away() -> None:
    t = np.arange(4096) / RATE
    decay = np.exp(-3 * t) * np.cos(2 * np.pi * 50 * t)
    assert judge(recording(("acc", decay, "m/s^2"))).kind == "snap-back"
    steady = np.cos(2 * np.pi * 50 * t)
    assert judge(recording(("acc", steady, "m/s^2"))).kind == "unknown"


def test_swapped_force_and_response_and_doubled_names_are_warned_of() -> None:
    found = judge(recording(("force", ringing(), "N"), ("acc", pulse(), "m/s^2"), ("acc", ringing(80), "m/s^2")))
    assert any("swapped" in sentence for sentence in found.warnings)
    assert any("2 channels are called acc" in sentence for sentence in found.warnings)


def test_takes_of_one_point_have_like_frfs_and_points_have_not() -> None:
    def frf(frequency: float, seed: int) -> np.ndarray | None:
        return judge(recording(("force", pulse(), "N"), ("acc", ringing(frequency, seed), "m/s^2"))).frf

    assert same_point([frf(60, 1), frf(60, 2), frf(60, 3)]) is True
    assert same_point([frf(60, 1), frf(400, 2), frf(150, 3)]) is False
    assert same_point([frf(60, 1), None]) is None


def layout_of(path: Path) -> dict:
    with pytest.raises(acquisition.UndescribedError) as raised:
        acquisition.read(path)
    found = described(raised.value)
    return {"kind": found.kind, "reader": dict(found.reader), "needs_rate": found.needs_rate}


def test_arrays_that_do_not_describe_themselves_are_understood(tmp_path: Path) -> None:
    from scipy.io import savemat

    t = np.arange(4096) / RATE
    np.save(tmp_path / "rows.npy", np.array([t, pulse(), ringing()]))
    assert layout_of(tmp_path / "rows.npy")["reader"] == {"axis": "rows", "time": "row 0"}
    savemat(tmp_path / "block.mat", {"data": np.random.default_rng(0).normal(size=(2000, 5))})
    assert layout_of(tmp_path / "block.mat") == {
        "kind": "records",
        "reader": {"signals": "data", "axis": "columns"},
        "needs_rate": True,
    }
    f = np.arange(401) * 0.5
    frf = 1 / (1 - (f / 60) ** 2 + 0.02j)
    savemat(tmp_path / "frf.mat", {"Freq": f, "H1": frf, "cross_spec": frf, "coherence": np.ones(401)})
    assert layout_of(tmp_path / "frf.mat")["reader"] == {"frequency": "Freq", "frf": "H1", "coherence": "coherence"}
    savemat(tmp_path / "shapes.mat", {"phi": np.ones((12, 4))})
    assert layout_of(tmp_path / "shapes.mat")["kind"] == "shapes"


@pytest.mark.parametrize(
    ("arrays", "units"),
    [
        (  # each unit beside its signal, in a group with the axis and the rate
            {
                "M": {
                    "t": "time",
                    "Kraft": {"data": "force", "unit": "N"},
                    "a": {"data": "acc", "unit": "g"},
                    "fs": RATE,
                }
            },
            {"M.Kraft.data": "N", "M.a.data": "g"},
        ),
        (
            {"t": "time", "t_unit": "s", "Kraft": "force", "Kraft_unit": "kN", "a": "acc", "a_Einheit": "g"},
            {"Kraft": "kN", "a": "g"},
        ),
        ({"t": "time", "a": {"data": "acc", "unit": "mm"}, "b": "other"}, {"a.data": "mm"}),
        (
            {"t": "time", "a": "acc", "b": "other", "info": {"units": "s, m/s^2", "fs": RATE}},
            dict.fromkeys("ab", "m/s^2"),
        ),
        ({"t": "time", "a": "acc", "b": "other", "unit": "g"}, dict.fromkeys("ab", "g")),
        # a unit of what is no signal, and units of nobody knows which, are those of no signal
        ({"t": "time", "a": "acc", "T": {"value": 21.5, "unit": "degC"}, "fs": {"value": RATE, "unit": "Hz"}}, {}),
        ({"t": "time", "a": "acc", "b": "other", "one": {"unit": "g"}, "two": {"unit": "N"}, "T_unit": "degC"}, {}),
    ],
)
def test_each_signal_has_the_unit_that_is_stated_beside_it(tmp_path: Path, arrays: dict, units: dict) -> None:
    """The first unit of a file had been given to all of its signals."""
    signals = {"time": np.arange(4096) / RATE, "force": pulse(), "acc": ringing(), "other": ringing(90)}

    def filled(value):
        if isinstance(value, dict):
            return {name: filled(one) for name, one in value.items()}
        return signals.get(value, value) if isinstance(value, str) else value

    savemat(tmp_path / "file.mat", filled(arrays))
    assert layout_of(tmp_path / "file.mat")["reader"].get("units", {}) == units


def test_data_sets_with_their_unit_and_rate_beside_them_are_signals(tmp_path: Path) -> None:
    """They had been refused, with the rate in the text of the refusal."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "take1.h5", "w") as file:
        for name, row, unit in (("force", pulse(), "N"), ("acc", ringing() / 9.80665, "g")):
            data = file.create_dataset(f"measurement/{name}", data=row)
            data.attrs["unit"], data.attrs["sampling_rate"] = unit, RATE
    (tmp_path / "campaign.toml").write_text(proposal.propose(tmp_path).text, encoding="utf-8")
    (record,) = acquisition.open_campaign(tmp_path).runs[0].recordings
    assert record.sampling_rate == RATE
    signals = {channel.name.split("/")[-1]: row for channel, row in zip(record.channels, record.signals, strict=True)}
    np.testing.assert_allclose(signals["force"], pulse())
    np.testing.assert_allclose(signals["acc"], ringing())
    with h5py.File(tmp_path / "take1.h5", "a") as file:
        file["measurement/acc"].attrs["sampling_rate"] = RATE / 2
    reason = facts_of(tmp_path / "take1.h5", "take1.h5").reason
    assert reason.startswith("nothing says what its arrays are: measurement/") and "sampling_rate = ... }" in reason


def test_the_unit_of_a_time_axis_is_taken_from_the_file(tmp_path: Path) -> None:
    time = {"data": np.arange(4096) / RATE * 1e3, "unit": "ms"}
    savemat(tmp_path / "file.mat", {"time": time, "a": {"data": ringing(), "unit": "g"}})
    facts = facts_of(tmp_path / "file.mat", "file.mat")
    assert facts.rate == pytest.approx(RATE) and facts.reader["units"] == {"a.data": "g"}


def plate() -> Geometry:
    x, y = np.meshgrid(np.linspace(0, 0.9, 7), np.linspace(0.1, 0.5, 5))
    xyz = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    return Geometry(np.arange(1, len(xyz) + 1), xyz)


def moved(node: int, xyz: tuple[float, float, float]) -> Geometry:
    points = plate().xyz.copy()
    points[node - 1] = xyz
    return Geometry(plate().nodes, points)


@pytest.mark.parametrize(
    ("geometry", "unit", "codes"),
    [
        (plate(), "m", []),
        (Geometry(plate().nodes, 1000 * plate().xyz), "m", ["extent-implausible"]),
        (Geometry(plate().nodes, plate().xyz / 1000), "mm", ["extent-implausible"]),
        (moved(9, (0.15, -0.2, 0.0)), "m", ["node-mirrored"]),
        (moved(9, (0.0, 0.1, 0.0)), "m", ["nodes-coincide"]),
    ],
)
def test_wrong_positions_are_warned_of(geometry: Geometry, unit: str, codes: list[str]) -> None:
    assert [one.code for one in positions.findings(geometry, "points.csv", unit)] == codes


def test_structures_about_the_origin_are_not_suspected() -> None:
    centred = Geometry(plate().nodes, plate().xyz - plate().xyz.mean(axis=0))
    assert positions.findings(centred, "points.csv") == ()


def test_the_picture_has_numbers_arrows_and_the_extent() -> None:
    figure = show.geometry(plate(), [Dof(1, "+Z")], [Dof(3, "-Z"), Dof(99, "+X"), Dof(4)])
    labels = {text.get_text().strip() for text in figure.axes[0].texts}
    assert {"1", "35", "x", "y", "z"} <= labels
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == ["force", "response"]
    assert "extent: 0.9 m x 0.4 m x 0 m" in {text.get_text() for text in figure.texts}
    with pytest.raises(InputError, match="without points"):
        show.geometry(Geometry(np.zeros(0, int), np.zeros((0, 3))))


def test_text_is_toml(tmp_path: Path) -> None:
    import tomllib

    table = {
        "name": 'a "b" \\ c',
        "n": 3,
        "x": 0.5,
        "yes": True,
        "files": [{"file": "a b.uff", "dofs": {"acc 1": "1:+Z"}}],
    }
    assert tomllib.loads(table_text("[run]", table, {"n": "why"}))["run"] == table
    with pytest.raises(TypeError):
        value_text(object())


def hammer_folder(folder: Path, names: list[str]) -> Path:
    folder.mkdir(exist_ok=True)
    for number, name in enumerate(names):
        rows = np.array([np.arange(4096) / RATE, pulse(), ringing(60 + 90 * number, number)])
        np.savetxt(folder / name, rows.T, delimiter=",", header="t [s],hammer [N],acc [m/s^2]", comments="")
    return folder


def test_units_and_points_of_the_files_need_no_question(tmp_path: Path) -> None:
    found = proposal.propose(hammer_folder(tmp_path / "beam", ["pt1.csv", "pt2.csv", "pt3.csv"]))
    assert found.questions == () and found.findings == ()
    described_ = acquisition.campaign_file.parse(found.text)
    (run,) = described_.runs
    assert (run.id, run.kind, run.files[0].file) == ("pt", "hammer", "pt{point}.csv")
    assert [(one.name, one.role, one.dof) for one in described_.channels] == [
        ("hammer", "reference", "{point}"),
        ("acc", "response", "902"),
    ]


def test_directions_in_names_become_dofs(tmp_path: Path) -> None:
    found = proposal.propose(hammer_folder(tmp_path / "beam", ["FRF_12Z_5X-.csv", "FRF_13Y_5X-.csv"]))
    files = acquisition.campaign_file.parse(found.text).runs[0].files
    assert [one.dofs for one in files] == [{"hammer": "5:-X", "acc": "12:+Z"}, {"hammer": "5:-X", "acc": "13:+Y"}]
    assert found.references == (Dof(5, "-X"),) and found.responses == (Dof(12, "+Z"), Dof(13, "+Y"))


def test_a_campaign_of_a_roving_hammer_beside_a_load_cell_passes_its_check(tmp_path: Path) -> None:
    """As a logger writes it: German decimals, lines of metadata, a load cell in kN beside the hammer, positions in mm.

    The load cell had become a second hammer, the hammer a ``{point}`` that no pattern states, and the positions were
    refused by the check of what had been proposed."""
    rng = np.random.default_rng(3)
    for point, take in ((1, 1), (1, 2), (2, 1), (2, 2)):
        pressed = 5.0 + 0.003 * rng.normal(size=4096)
        rows = np.array([np.arange(4096) / RATE, pulse(), ringing(60 + 90 * point, take), pressed])
        lines = ["Operator;A. Müller", "", "Time (s);Hammer (N);Acc 1 (m/s²);Load cell (kN)"]
        lines += [";".join(f"{value:.6f}" for value in row).replace(".", ",") for row in rows.T]
        (tmp_path / f"P{point:02d}Z+_take{take}.csv").write_text("\n".join(lines), encoding="latin-1")
    (tmp_path / "geometry.csv").write_text("node;x [mm];y [mm];z [mm]\n1;100;0;0\n2;200;0;0\n")
    found = proposal.propose(tmp_path)
    described_ = acquisition.campaign_file.parse(found.text)
    assert [(one.name, one.role, one.dof) for one in described_.channels] == [
        ("Hammer", "reference", ""),
        ("Acc 1", "response", "902"),
        ("Load cell", "normal force", ""),
    ]
    assert [one.dofs["Hammer"] for one in described_.runs[0].files] == ["1:+Z", "1:+Z", "2:+Z", "2:+Z"]
    (tmp_path / "campaign.toml").write_text(found.text, encoding="utf-8")
    opened = acquisition.open_campaign(tmp_path)
    np.testing.assert_allclose(opened.geometry.xyz, [[0.1, 0, 0], [0.2, 0, 0]])
    assert {str(one.channels[0].dof) for one in opened.runs[0].recordings} == {"1:+Z", "2:+Z"}


def test_conditions_in_names_are_runs_and_points_in_names_of_channels_their_dofs(tmp_path: Path) -> None:
    """Six files of three normal forces with FRFs that are alike had become takes of one run, and the sensors, whose names
    state their points, had no DOF."""
    rng = np.random.default_rng(4)
    for pressed, take in product((1, 5, 10), (1, 2)):
        force = rng.normal(size=4096)
        rows = np.array([np.arange(4096) / RATE, force, *(np.convolve(force, ringing(60, k))[:4096] for k in (1, 2))])
        rows = np.vstack([rows, 1000 * pressed + rng.normal(size=4096)])
        head = "time [s],shaker [N],Acc 1:+Z [m/s^2],Acc 2:-X [m/s^2],F_N [N]"
        np.savetxt(tmp_path / f"table_{pressed}kN_{take}.csv", rows.T, "%.6g", ",", header=head, comments="")
    found = acquisition.campaign_file.parse(proposal.propose(tmp_path).text)
    assert [run.files[0].file for run in found.runs] == [f"table_{pressed}kN_{{take}}.csv" for pressed in (1, 5, 10)]
    assert [(one.role, one.dof) for one in found.channels] == [
        ("reference", "901"),
        ("response", "1:+Z"),
        ("response", "2:-X"),
        ("normal force", ""),
    ]


def shaker_table(folder: Path, names: list[str], nodes: int = 0) -> list[str]:
    """DOFs that are proposed for a record with these channels, the first one the force, beside so many points."""
    force = np.random.default_rng(4).normal(size=4096)
    rows = [np.convolve(force, ringing(60 + 7 * k, k))[:4096] for k in range(len(names) - 1)]
    head = ",".join(["time [s]", f"{names[0]} [N]", *(f"{name} [m/s^2]" for name in names[1:])])
    columns = np.array([np.arange(4096) / RATE, force, *rows]).T
    np.savetxt(folder / "shaker.csv", columns, "%.6g", ",", header=head, comments="")
    if nodes:
        lines = [f"{node},{50 * node},0,0" for node in range(1, nodes + 1)]
        (folder / "geometry.csv").write_text("\n".join(["node,x [mm],y [mm],z [mm]", *lines]))
    return [one.dof for one in acquisition.campaign_file.parse(proposal.propose(folder).text).channels]


@pytest.mark.parametrize(
    ("names", "nodes", "dofs"),
    [
        (["Force A2", "A1", "A2", "A4", "A11"], 12, ["2", "1", "2", "4", "11"]),
        (["Force A2", "A1", "A2", "A4", "A11"], 0, ["2", "1", "2", "4", "11"]),
        (["Force", "acc_3", "acc_5"], 6, ["901", "3", "5"]),
        (["Force 1", "Punkt 3", "acc point 7"], 0, ["901", "3", "7"]),
        (["Hammer P2 -Z", "Punkt 6 oben", "Z Knoten-7", "P8"], 0, ["2:-Z", "6", "7:+Z", "8"]),
        # numbers that are none of points of the geometry, of a series, or not the only ones
        (["Force", "A1", "A14"], 12, ["1", "2", "3"]),
        (["Force", "A1", "B1"], 12, ["1", "2", "3"]),
        (["Force", "Acc 352C33", "Acc 352C65"], 0, ["1", "2", "3"]),
        (["Force", "A0", "A1"], 0, ["1", "2", "3"]),
        (["Force", "top", "bottom"], 0, ["1", "2", "3"]),
        # three directions of one sensor
        (["Force", "Tri X", "Tri Y", "Tri Z"], 0, ["1", "2:+X", "2:+Y", "2:+Z"]),
        (
            ["Force P4", "ax", "ay", "top", "b-x", "b-Y", "B -Z"],
            0,
            ["4", *["902:+X", "902:+Y", "903", "904:+X", "904:+Y", "904:-Z"]],
        ),
    ],
)
def test_points_and_directions_in_names_of_channels_are_their_dofs(tmp_path: Path, names, nodes, dofs) -> None:
    """Channels with the numbers of their points had been counted from 1, and a triaxial sensor had sat at three points."""
    assert shaker_table(tmp_path, names, nodes) == dofs


@pytest.mark.parametrize(
    ("names", "files", "dofs"),
    [
        (
            ["Hammer 2:-Z", "Tri X", "Tri Y", "Tri Z"],
            "plate_{point}.csv",
            ["2:-Z", "{point}:+X", "{point}:+Y", "{point}:+Z"],
        ),
        (["Hammer 2:-Z", "acc"], "plate_{point}.csv", ["2:-Z", "{point}"]),
        (["Hammer", "Tri X", "Tri Y", "Tri Z"], "plate_{point}.csv", ["{point}", "902:+X", "902:+Y", "902:+Z"]),
        (["Hammer", "acc 5:+Z"], "plate_{point}.csv", ["{point}", "5:+Z"]),
        # which of two moved, nobody says
        (["Hammer 2:-Z", "top", "bottom"], "plate_{point}.csv", ["{point}:-Z", "902", "903"]),
    ],
)
def test_a_force_with_a_dof_in_its_name_does_not_move(tmp_path: Path, names, files, dofs) -> None:
    for point in (1, 2, 3):
        rows = [ringing(60 + 90 * point + 7 * k, point) for k in range(len(names) - 1)]
        head = ",".join(["t [s]", f"{names[0]} [N]", *(f"{name} [m/s^2]" for name in names[1:])])
        columns = np.array([np.arange(4096) / RATE, pulse(), *rows]).T
        np.savetxt(tmp_path / f"plate_{point}.csv", columns, delimiter=",", header=head, comments="")
    found = proposal.propose(tmp_path)
    parsed = acquisition.campaign_file.parse(found.answered(found.questions[0].key, "points").text)
    assert [one.dof for one in parsed.channels] == dofs and parsed.runs[0].files[0].file == files
    assert ("TODO: its name says 2:-Z" in found.text) == (dofs[0] == "{point}:-Z")


def test_a_sensor_that_moved_has_the_points_of_the_names_where_they_state_directions(tmp_path: Path) -> None:
    names = ["P3Z+.csv", "P4Z+.csv"]
    for number, name in enumerate(names):
        rows = np.array([np.arange(4096) / RATE, pulse(), *(ringing(60 + 90 * number, k) for k in range(3))])
        head = "t [s],Hammer 2:-Z [N],ax [m/s^2],ay [m/s^2],az [m/s^2]"
        np.savetxt(tmp_path / name, rows.T, delimiter=",", header=head, comments="")
    parsed = acquisition.campaign_file.parse(proposal.propose(tmp_path).text)
    assert [one.dof for one in parsed.channels] == ["2:-Z", "", "", ""]
    assert parsed.runs[0].files[1].dofs == {"ax": "4:+X", "ay": "4:+Y", "az": "4:+Z"}


@pytest.mark.parametrize("unit", ["mm", ""])
@pytest.mark.parametrize("title", ["point", "node", "Messpunkt"])
def test_points_with_numbers_in_their_names_are_the_geometry(tmp_path: Path, title: str, unit: str) -> None:
    """A table with the points A1 to A12 had been left out, as arrays of which nothing says what they are."""
    shaker_table(tmp_path, ["Force A4", "A12", "A4", "A7"])
    rows = [f"A{node};{50 * node},5;{node % 2};0" for node in (12, 4, 7, 1)]
    titles = ";".join(f"{axis} ({unit})" if unit else axis for axis in "xyz")
    (tmp_path / "geometry.csv").write_text("\n".join([f"{title};{titles}", *rows]))
    found = proposal.propose(tmp_path)
    if not unit:
        found = found.answered("coordinates", "mm")
    assert found.questions == () and found.left_out == ()
    (tmp_path / "campaign.toml").write_text(found.text, encoding="utf-8")
    opened = acquisition.open_campaign(tmp_path)
    assert opened.geometry.nodes.tolist() == [12, 4, 7, 1]
    np.testing.assert_allclose(
        opened.geometry.xyz, [[0.6005, 0, 0], [0.2005, 0, 0], [0.3505, 1e-3, 0], [0.0505, 1e-3, 0]]
    )
    np.testing.assert_allclose(found.geometry.xyz, opened.geometry.xyz)
    assert [one.dof.node for one in opened.runs[0].recordings[0].channels] == [4, 12, 4, 7]


@pytest.mark.parametrize("names", [("A1", "A1", "A2"), ("A1", "B1", "B2"), ("left", "A1", "A2")])
def test_points_whose_names_are_no_nodes_are_left_out(tmp_path: Path, names: tuple[str, ...]) -> None:
    shaker_table(tmp_path, ["Force", "A1", "A2"])
    rows = [f"{name},{number},0,0" for number, name in enumerate(names)]
    (tmp_path / "geometry.csv").write_text("\n".join(["point,x (mm),y (mm),z (mm)", *rows]))
    found = proposal.propose(tmp_path)
    assert [path for path, _ in found.left_out] == ["geometry.csv"] and found.geometry is None


TITLES = "Frequency [Hz],Force [N],Acceleration [g],Phase [deg]"


def level_table(path: Path, force: float, *, titles: str = TITLES, lines: int = 61, control: str = "force") -> None:
    """One level of a stepped sine about the resonance of an oscillator at 60 Hz with 1 % of damping."""
    f = np.linspace(55, 65, lines)
    receptance = 1 / (1 - (f / 60) ** 2 + 0.02j * f / 60)
    amplitude = force * np.abs(receptance)
    kept = {"force": np.ones(lines), "response": 1 / amplitude, "none": 1 / np.sqrt(amplitude)}[control]
    columns = np.column_stack([f, force * kept, amplitude * kept, np.degrees(np.angle(-receptance))])
    path.parent.mkdir(exist_ok=True)
    np.savetxt(path, columns, "%.9g", ",", header=titles, comments="")


@pytest.mark.parametrize("control", ["force", "response", "none"])
@pytest.mark.parametrize("lines", [12, 200])
def test_tables_of_a_stepped_sine_are_levels_of_one_run(tmp_path: Path, control: str, lines: int) -> None:
    """They had been called mode shapes or frequencies, and the folder refused."""
    for level in (1, 10, 2.5):
        # a controller of the response keeps another one in each file
        level_table(
            tmp_path / f"stepped_{level}N.csv",
            level,
            lines=lines,
            control="force" if control == "response" else control,
        )
        if control == "response":
            path = tmp_path / f"stepped_{level}N.csv"
            rows = np.loadtxt(path, delimiter=",", skiprows=1)
            rows[:, 1:3] *= (level / rows[:, 2])[:, None]
            np.savetxt(path, rows, "%.9g", ",", header=TITLES, comments="")
    found = proposal.propose(tmp_path)
    assert [(one.key, one.default) for one in found.questions] == [
        ("control stepped_N", control),
        ("level dofs", "unstated"),
    ]
    text = found.answered("level dofs", "3:+Y, 4:-X").text
    (run,) = acquisition.campaign_file.parse(text).runs
    assert (run.kind, run.files[0].file, run.levels.control) == ("stepped sine", "stepped_*N.csv", control)
    (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
    (opened,) = acquisition.open_campaign(tmp_path).runs
    assert len(opened.levels) == 3
    assert {(str(one.output), str(one.input)) for one in opened.levels} == {("3:+Y", "4:-X")}


def test_levels_under_other_conditions_or_of_one_amplitude_are_runs_of_their_own(tmp_path: Path) -> None:
    for pressed, way, level in product((1, 5), ("up", "down"), (1, 2)):
        level_table(tmp_path / f"{pressed}kN" / f"{way}_{level}.csv", level)
    for repeat in (1, 2):
        level_table(tmp_path / f"again_{repeat}.csv", 3)
    found = acquisition.campaign_file.parse(proposal.propose(tmp_path).text)
    assert {run.files[0].file for run in found.runs} == {
        *(f"{pressed}kN/{way}_*.csv" for pressed in (1, 5) for way in ("up", "down")),
        "again_1.csv",
        "again_2.csv",
    }


def test_units_that_tables_of_levels_do_not_state_are_asked_for(tmp_path: Path) -> None:
    level_table(tmp_path / "level.csv", 1, titles="Frequenz,Kraft [N],Beschleunigung,Phase")
    found = proposal.propose(tmp_path)
    (units,) = [one.key for one in found.questions if one.required]
    assert 'units = { frequency = "TODO", response = "TODO", phase = "TODO" }' in found.text
    with pytest.raises(InputError, match="another number of units"):
        found.answered(units, "Hz, g")
    with pytest.raises(InputError, match="not two DOFs; got 'top'"):
        found.answered("level dofs", "top")
    (run,) = acquisition.campaign_file.parse(found.answered(units, "Hz, m/s^2, rad").text).runs
    assert run.levels.units == {"frequency": "Hz", "response": "m/s^2", "phase": "rad"}
    assert (run.levels.force, run.levels.response) == ("Kraft", "Beschleunigung")


def test_signals_of_their_own_beside_a_block_are_channels_too(tmp_path: Path) -> None:
    """The force and the normal force of a MATLAB file with a block of accelerations had been left out without a word."""
    time, steady = np.arange(4096) / RATE, 5 + 1e-3 * np.random.default_rng(1).normal(size=4096)
    block = np.array([ringing(50), ringing(80)]).T
    for take in (1, 2):
        arrays = {"t": time, "Force": pulse(), "Acc": block, "Fn": steady, "fs": RATE}
        savemat(tmp_path / f"impact_{take}.mat", arrays)
    found = proposal.propose(tmp_path)
    found = found.answered(found.questions[0].key, "N, g, kN")
    (tmp_path / "campaign.toml").write_text(found.text, encoding="utf-8")
    (run,) = acquisition.open_campaign(tmp_path).runs
    assert run.kind == "hammer" and len(run.recordings) == 2
    record = run.recordings[1]
    assert [one.role for one in record.channels] == ["reference", "response", "response", "normal force"]
    np.testing.assert_allclose(record.signals[0], pulse(), atol=1e-9)
    np.testing.assert_allclose(record.signals[3], 1000 * steady)


def test_a_pattern_does_not_take_files_that_were_left_out_or_are_of_another_run(tmp_path: Path) -> None:
    """An empty file and one of another sampling rate had been matched by the pattern of the others, and refused."""
    hammer_folder(tmp_path, ["pt1.csv", "pt2.csv", "pt12.csv", "pt3.csv"])
    rows = np.loadtxt(tmp_path / "pt3.csv", delimiter=",", skiprows=1)[::2]
    np.savetxt(tmp_path / "pt3.csv", rows, delimiter=",", header="t [s],hammer [N],acc [m/s^2]", comments="")
    (tmp_path / "pt4.csv").write_text("")
    (tmp_path / "campaign.toml").write_text(proposal.propose(tmp_path).text, encoding="utf-8")
    campaign = acquisition.open_campaign(tmp_path)
    (whole,) = [run for run in campaign.runs if len(run.recordings) > 1]
    assert [str(one.channels[0].dof) for one in whole.recordings] == ["1:S", "2:S", "12:S"]
    assert [len(run.recordings) for run in campaign.runs if run is not whole] == [1]


def test_a_number_of_which_nobody_knows_what_it_counts_is_asked_for(tmp_path: Path) -> None:
    found = proposal.propose(hammer_folder(tmp_path / "beam", ["abc1.csv", "abc2.csv"]))
    (question,) = found.questions
    assert question.default == "points" and question.choices == ("points", "takes", "runs")
    assert "# TODO: What does the number" in found.text
    answered = found.answered(question.key, "takes")
    assert answered.questions == () and "TODO" not in answered.text
    assert acquisition.campaign_file.parse(answered.text).runs[0].files[0].file == "abc{take}.csv"
    assert [run.id for run in acquisition.campaign_file.parse(found.answered(question.key, "runs").text).runs] == [
        "abc1",
        "abc2",
    ]
    with pytest.raises(InputError, match="not one of the answers; got hits, expected points or takes or runs"):
        found.answered(question.key, "hits")
    with pytest.raises(InputError, match="no such question"):
        found.answered("colour", "red")


def test_wrong_units_are_refused_and_right_ones_written(tmp_path: Path) -> None:
    np.save(tmp_path / "take1.npy", np.array([np.arange(4096) / RATE, pulse(), ringing()]))
    found = proposal.propose(tmp_path)
    with pytest.raises(InputError, match="not a unit; got 'moons'"):
        found.answered("units", "N, moons")
    with pytest.raises(InputError, match="another number of units"):
        found.answered("units", "N, g, g")
    text = found.answered("units", "N, g").text
    assert [one.unit for one in acquisition.campaign_file.parse(text).channels] == ["N", "g"]
    volts = found.answered("units", "2.25 mV/N, 100 mV/g").text
    assert [one.sensitivity for one in acquisition.campaign_file.parse(volts).channels] == ["2.25 mV/N", "100 mV/g"]


def test_folders_without_measurements_say_what_they_hold(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no measurements in this folder"):
        proposal.propose(tmp_path)
    np.save(tmp_path / "shapes.npy", np.ones((3, 12, 4)))
    with pytest.raises(InputError, match=r"neither records nor FRFs.*mode shapes"):
        proposal.propose(tmp_path)
    with pytest.raises(InputError, match="there is no such folder"):
        proposal.propose(tmp_path / "nowhere")


def test_a_file_of_ours_with_modes_is_named_as_one_of_another_program_is(tmp_path: Path) -> None:
    store.save(tmp_path / "ours.h5", modal_model())
    acquisition.write(tmp_path / "foreign.uff", modal_model())
    reasons = {facts_of(path, path.name).reason for path in (tmp_path / "ours.h5", tmp_path / "foreign.uff")}
    assert reasons == {"a modal model; `ema compare` takes it"}
