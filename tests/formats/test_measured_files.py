"""Real measurements in other formats, read with the options that their files need."""

import gzip
import json
from pathlib import Path

import numpy as np
import pytest

import acquisition
from ema.dof import Dof
from ema.errors import InputError


def test_ring_down_of_a_jointed_beam(datasets: Path) -> None:
    path = datasets / "01_brake_reuss_beam/HammerImpact.mat"
    (record,) = acquisition.read(path, time="HIdata.time", units="m/s^2").recordings
    assert record.signals.shape == (3, 65536)
    assert record.sampling_rate == pytest.approx(12800, rel=1e-9)
    assert [c.name for c in record.channels] == ["HIdata.acc1", "HIdata.acc2", "HIdata.acc3"]


def test_controlled_stepped_sine(datasets: Path) -> None:
    path = datasets / "01_brake_reuss_beam/ForcedFrequencyResponses.mat"
    level = "FRdata.ResponseControl.1."
    (frfs,) = acquisition.read(
        path, frequency=level + "frequency", amplitude=level + "amplitude", phase=level + "phase"
    ).frfs
    assert frfs.values.shape == (41, 1, 1)
    assert abs(frfs.values[10, 0, 0]) == pytest.approx(20.1, abs=0.1)


def test_roving_hammer_frfs(datasets: Path) -> None:
    folder = datasets / "02_freefree_beam_roving_hammer"
    contents = acquisition.read(folder / "Hxysv00004.txt.gz", inputs="4:+X", outputs="4:-X")
    (frfs,) = contents.frfs
    assert (frfs.quantity, frfs.unit) == ("accelerance", "(m/s^2)/N")
    assert (frfs.inputs, frfs.outputs) == ((Dof(4, "+X"),), (Dof(4, "-X"),))
    assert frfs.values.shape == (51201, 1, 1)
    band = frfs.band(108, 116)
    assert band.frequencies[np.argmax(abs(band.values[:, 0, 0]))] == pytest.approx(111.994, abs=0.02)
    (bare,) = acquisition.read(folder / "Hxysv00001.txt.gz").frfs
    assert bare.values[1, 0, 0] == pytest.approx(-0.1366724 + 0.007331555j)


def test_positions_of_the_roving_hammer(datasets: Path) -> None:
    path = datasets / "02_freefree_beam_roving_hammer/setup.csv"
    geometry = acquisition.read(path, x="xHammer", y="yHammer", z="zHammer", unit="m").geometry
    assert geometry is not None
    np.testing.assert_array_equal(geometry.xyz[:, 2], [0.1, 0.25, 0.375, 0.5, 0.65, 0.8, 0.925, 1.05, 1.2])


@pytest.mark.parametrize("number", range(1, 6))
def test_raw_blows(datasets: Path, number: int) -> None:
    path = datasets / f"03_raw_hammer_blows/measurements_{number}.npy"
    (record,) = acquisition.read(path, time="row 0", names=["hammer", "acc"], units=["N", "unstated"]).recordings
    assert record.sampling_rate == 25600.0
    assert record.signals.shape == (2, 25600)
    assert 68 <= record.signal("hammer").max() <= 89.5
    assert [channel.unit for channel in record.channels] == ["N", "unstated"]


@pytest.mark.parametrize("name", ["view_0", "view_0_02", "view_0_03", "view_0_04", "view_1"])
def test_swept_sine_describes_itself(datasets: Path, name: str) -> None:
    path = datasets / f"04_plate_swept_sine/{name}.hdf5"
    (record,) = acquisition.read(path, units={"force": "N", "acc": "m/s^2"}).recordings
    assert [(c.name, c.unit) for c in record.channels] == [("force", "N"), ("acc", "m/s^2"), ("trigger", "unstated")]
    assert (record.sampling_rate, record.signals.shape) == (25600.0, (3, 51200))
    assert 2.4 < record.signal("force").max() < 5.1


def test_two_shakers(datasets: Path) -> None:
    path = datasets / "05_steel_subframe_mimo/flexible_structure_dat.mat"
    (record,) = acquisition.read(path, axis="columns", sampling_rate=1024).recordings
    assert record.signals.shape == (30, 8523)
    assert not any(channel.scaled for channel in record.channels)


def test_measured_wing_shapes_and_model(datasets: Path) -> None:
    folder = datasets / "07_wing_test_analysis_correlation"
    for place, name in enumerate(("1st", "2nd", "3rd", "4rth", "5th", "6th")):
        (modes,) = acquisition.read(
            folder / f"{name}NaturalFreq18.mat", shapes=f"U{place + 1}", shape_axes="node", natural_frequencies=[13.54]
        ).modes
        assert modes.shapes.shape == (18, 1)
    geometry = acquisition.read(folder / "WingBeamforMAC.mat", coordinates="nodes", lines="lines", unit="mm").geometry
    assert geometry is not None
    assert (len(geometry.nodes), len(geometry.lines)) == (18, 27)
    (model,) = acquisition.read(
        folder / "WingBeamforMAC.mat", shapes="fms", shape_axes="node mode", natural_frequencies="fs"
    ).modes
    assert model.natural_frequencies[:6] == pytest.approx([22.43, 97.45, 189.92, 238.74, 404.58, 446.01], abs=0.01)


@pytest.mark.parametrize(("name", "frequency"), [("case1", 212.1875), ("case2", 192.5)])
def test_frf_with_coherence_and_raw_channels(datasets: Path, name: str, frequency: float) -> None:
    path = datasets / f"08_sdof_frfs_with_published_answer/{name}.mat"
    (frfs,) = acquisition.read(path, frequency="Freq_domain", frf="Hf_chan_2", coherence="Hf_coh_chan_2").frfs
    assert frfs.values.shape == (1601, 1, 1)
    assert frfs.frequency_step == pytest.approx(0.3125)
    assert frfs.coherence is not None
    band = frfs.band(150, 250)
    assert band.frequencies[np.argmax(abs(band.values[:, 0, 0]))] == pytest.approx(frequency, abs=0.32)
    (record,) = acquisition.read(
        path, signals=["Time_chan_1", "Time_chan_2"], sampling_rate="Time_Sample_Rate"
    ).recordings
    assert (record.sampling_rate, record.signals.shape) == (1280.0, (2, 4096))


def test_band_tension_in_us_units(datasets: Path) -> None:
    path = datasets / "09_friction_damper_band_tension/dataset-2_1Hz36lbtension1amplitude.json.gz"
    (record,) = acquisition.read(
        path,
        signals="data",
        time="data column 0",
        names=["x", "friction", "velocity", "band 1", "band 2"],
        units=["in", "kip", "in/s", "lbf", "lbf"],
    ).recordings
    assert record.sampling_rate == pytest.approx(1024, rel=1e-6)
    raw = np.array(json.loads(gzip.decompress(path.read_bytes()))["data"])
    factors = [[0.0254], [4448.2216152605], [0.0254], [4.4482216152605], [4.4482216152605]]
    np.testing.assert_allclose(record.signals, raw[:, 1:].T * factors, rtol=1e-12)
    amplitude = np.ptp(record.signals[0]) / 2
    assert amplitude == pytest.approx(0.0254, rel=0.02)


def test_points_and_shapes_of_a_tree(datasets: Path) -> None:
    folder = datasets / "10_tree_structure_shapes"
    geometry = acquisition.read(folder / "points.xlsx", unit="mm").geometry
    assert geometry is not None
    np.testing.assert_allclose(geometry.xyz[0], [0.0395, 0.0195, 0.079])
    assert len(geometry.nodes) == 44
    contents = acquisition.read(folder / "shapes.npy", shapes="", shape_axes="direction node mode")
    (modes,) = contents.modes
    assert modes.shapes.shape == (3 * 43, 26)
    assert [finding.code for finding in contents.findings] == ["frequencies-unstated"]
    raw = np.load(folder / "shapes.npy", allow_pickle=False)
    row = modes.dofs.index(Dof(7, "+Y"))
    np.testing.assert_array_equal(modes.shapes[row], raw[1, 6])


def test_26_shapes_do_not_pair_with_24_frequencies(datasets: Path) -> None:
    folder = datasets / "10_tree_structure_shapes"
    frequencies = np.load(folder / "nat-freq.npy", allow_pickle=False).tolist()
    with pytest.raises(InputError, match="26 shapes, 24 natural frequencies"):
        acquisition.read(
            folder / "shapes.npy", shapes="", shape_axes="direction node mode", natural_frequencies=frequencies
        )
