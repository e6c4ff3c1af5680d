"""The campaign folders of the project, opened: real measurements, and the built-in one's description."""

from pathlib import Path

import numpy as np
import pytest

import acquisition
from acquisition import campaign_file
from ema.dof import SCALAR, Dof

REAL = {
    "freefree_beam": "02_freefree_beam_roving_hammer",
    "hammer_blows": "03_raw_hammer_blows",
    "plate_sweep": "04_plate_swept_sine",
    "steel_subframe": "05_steel_subframe_mimo",
    "sdof": "08_sdof_frfs_with_published_answer",
    "sdof_raw": "08_sdof_frfs_with_published_answer",
    "friction_damper": "09_friction_damper_band_tension",
}


@pytest.fixture
def opened(root: Path, datasets: Path, monkeypatch: pytest.MonkeyPatch):  # type: ignore[no-untyped-def]
    monkeypatch.setenv("EMA_DATASETS", str(datasets))
    return lambda name: acquisition.open_campaign(root / "datasets" / name)


FOLDERS = sorted(path.parent.name for path in (Path(__file__).parents[2] / "datasets").glob("*/campaign.toml"))


@pytest.mark.parametrize("name", FOLDERS)
def test_every_folder_has_a_sound_campaign_file_and_tells_its_source(root: Path, name: str) -> None:
    described = campaign_file.load(root / "datasets" / name)
    assert described.campaign.name
    source = (root / "datasets" / name / "SOURCE.md").read_text(encoding="utf-8")
    if name in REAL:
        assert described.campaign.files == "${EMA_DATASETS}/" + REAL[name]
        assert "EMA_DATASETS" in source and "icence" in source and REAL[name] in source


def test_all_sets_have_a_folder() -> None:
    assert set(REAL) <= set(FOLDERS)


def test_no_real_measurement_lives_in_the_project(root: Path) -> None:
    for name in REAL:
        assert {path.name for path in (root / "datasets" / name).iterdir()} <= {"campaign.toml", "SOURCE.md"}


def test_freefree_beam(opened) -> None:  # type: ignore[no-untyped-def]
    campaign = opened("freefree_beam")
    frfs = campaign["beam"].frfs[0]
    assert frfs.values.shape == (51201, 1, 9) and frfs.frequency_step == pytest.approx(0.01953125)
    assert frfs.outputs == (Dof(4, "-X"),) and frfs.inputs == tuple(Dof(point, "+X") for point in range(1, 10))
    assert (frfs.quantity, frfs.unit) == ("accelerance", "(m/s^2)/N")
    assert campaign.geometry is not None and campaign.geometry.nodes.tolist() == list(range(1, 10))
    np.testing.assert_allclose(campaign.geometry.xyz[:, 2], [0.1, 0.25, 0.375, 0.5, 0.65, 0.8, 0.925, 1.05, 1.2])
    assert (campaign.geometry.xyz[:, :2] == 0).all() and campaign.findings == () and campaign["beam"].findings == ()
    line = int(np.argmax(np.abs(frfs.band(105, 120).values[:, 0, 0]))) + int(np.searchsorted(frfs.frequencies, 105))
    assert frfs.frequencies[line] == pytest.approx(111.994, abs=0.02)
    shape = frfs.values[line, 0].imag / np.abs(frfs.values[line, 0].imag).max()
    reference = np.array([0.90, 0.21, -0.30, -0.58, -0.88, -0.74, -0.35, 0.21, 1.00])
    np.testing.assert_allclose(shape * np.sign(shape[-1]), reference, atol=0.1)
    assert frfs.values[line, 0, 3].imag < 0, "force and acceleration of the drive point have opposite senses"


def test_hammer_blows(opened) -> None:  # type: ignore[no-untyped-def]
    run = opened("hammer_blows")["blows"]
    assert len(run.recordings) == 5 and [finding.code for finding in run.findings] == ["unit-unstated"]
    for take in run.recordings:
        assert take.signals.shape == (2, 25600) and take.sampling_rate == pytest.approx(25600)
        assert [(channel.role, channel.quantity, channel.unit) for channel in take.channels] == [
            ("reference", "force", "unstated"),
            ("response", "acceleration", "unstated"),
        ]
        assert 60 < take.signals[0].max() < 100 and int(np.argmax(take.signals[0])) / 25600 < 0.002


def test_plate_sweep(opened) -> None:  # type: ignore[no-untyped-def]
    run = opened("plate_sweep")["sweeps"]
    assert run.kind == "sweep" and run.condition.excitation.band == (60.0, 500.0)
    assert [take.name for take in run.recordings] == [
        "view_0.hdf5",
        "view_0_02.hdf5",
        "view_0_03.hdf5",
        "view_0_04.hdf5",
        "view_1.hdf5",
    ]
    peaks = [float(np.abs(take.signals[0]).max()) for take in run.recordings]
    assert sorted(round(peak, 1) for peak in peaks) == [2.5, 3.3, 3.3, 3.4, 5.0]
    take = run.recordings[0]
    assert take.signals.shape == (3, 51200) and take.sampling_rate == 25600
    assert [(channel.role, channel.unit) for channel in take.channels] == [
        ("reference", "N"),
        ("response", "m/s^2"),
        ("trigger", "V"),
    ]


def test_steel_subframe(opened) -> None:  # type: ignore[no-untyped-def]
    run = opened("steel_subframe")["random"]
    (take,) = run.recordings
    assert take.signals.shape == (30, 8523) and take.sampling_rate == 1024
    assert take.with_role("reference") == (0, 1) and len(take.with_role("response")) == 28
    assert [channel.dof for channel in take.channels] == [Dof(node, SCALAR) for node in range(1, 31)]
    assert [finding.code for finding in run.findings] == ["unit-unstated"]


def test_sdof(opened) -> None:  # type: ignore[no-untyped-def]
    campaign = opened("sdof")
    for name, peak, tolerance in (("case1", 212.09, 0.4), ("case2", 192.59, 0.4)):
        frfs = campaign[name].frfs[0]
        assert frfs.values.shape == (1601, 1, 1) and frfs.frequency_step == pytest.approx(0.3125)
        assert frfs.coherence is not None and not frfs.scaled and frfs.quantity == "accelerance"
        band = frfs.band(150, 250)
        assert band.frequencies[np.argmax(np.abs(band.values[:, 0, 0]))] == pytest.approx(peak, abs=tolerance)
    for run in opened("sdof_raw").runs:
        assert run.recordings[0].signals.shape == (2, 4096) and run.recordings[0].sampling_rate == 1280
