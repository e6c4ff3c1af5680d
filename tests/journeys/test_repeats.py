"""A beam that was taken off and put back: what a campaign with repeats says, and what one without may not say."""

import json
import re
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest

import acquisition
from ema import store
from ema.data import ModalModel, StudyResult, poles_from
from ema.study import summary
from ema.synthesis import frfs as synthesis
from tests.journeys.small_campaign import DOFS, FREQUENCIES, ema_command, truth

DAMPING = np.array([0.012, 0.009, 0.015])
SHIFTS = (-1.0, 0.0, 1.0)
BARE, BEAM = (0.0005, 0.002), (0.002, 0.04)
"""Scatter from one assembly to the next, relative, of frequency and damping."""
GAIN = np.array([1.3, 1.02, 1.0])
"""What the beam does to the damping of the three modes."""

RUN = """
[[runs]]
id = "{id}"
kind = "hammer"
files = "{id}.uff"
{more}
"""
FORCE = """repeat = "1 kN"
[[runs.normal_force]]
joint = "J1"
value = "{force:.3f} kN"
torque = "12 N m"
sequence = "{sequence}"
"""


def assembled(scatter: tuple[float, float], shift: float, gain: np.ndarray) -> ModalModel:
    """The structure after one assembly: all modes moved by as many standard deviations as ``shift`` says."""
    frequencies = np.array(FREQUENCIES) * (1 + scatter[0] * shift)
    return replace(truth(), poles=poles_from(frequencies, DAMPING * gain * (1 + scatter[1] * shift)))


def measured(path: Path, model: ModalModel, seed: int) -> None:
    frfs = synthesis(model, np.arange(80, 801) * 0.25, outputs=DOFS, inputs=DOFS[:2])
    noise = np.random.default_rng(seed).standard_normal((*frfs.values.shape, 2)).view(complex)[..., 0]
    level = 0.003 * np.sqrt(np.mean(np.abs(frfs.values) ** 2, axis=0))
    acquisition.write(path, replace(frfs, values=frfs.values + level * noise), binary=True)


def campaign(folder: Path, bare: str = 'repeat = "bare"') -> Path:
    """Three runs without the beam, three with it, and one whose label nothing shares."""
    data = folder / "data"
    data.mkdir(parents=True)
    text = '[campaign]\nname = "Beam on and off"\nfiles = "data"\n'
    for number, shift in enumerate(SHIFTS):
        measured(data / f"bare_{number}.uff", assembled(BARE, shift, np.ones(3)), number)
        measured(data / f"beam_{number}.uff", assembled(BEAM, shift, GAIN), 10 + number)
        text += RUN.format(id=f"bare_{number}", more=bare + "\nbeam = false")
        sequence = ("up", "up", "down")[number]
        text += RUN.format(id=f"beam_{number}", more=FORCE.format(force=1 + 0.02 * shift, sequence=sequence))
    measured(data / "light.uff", assembled(BEAM, 0.0, np.ones(3)), 20)
    text += RUN.format(id="light", more=FORCE.format(force=0.1, sequence="up").replace("1 kN", "100 N"))
    (folder / "campaign.toml").write_text(text)
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return campaign(tmp_path_factory.mktemp("repeats") / "Prüfling 2")


@pytest.fixture(scope="module")
def printed(folder: Path) -> str:
    """What `ema run` prints; its report has no chapters on the runs, whose pictures take most of the time."""
    from ema.cli.app import app

    text = StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(text), pytest.raises(SystemExit) as ended:
        for section in ("condition", "overview", "stabilisation", "reconstruction", "auto_mac", "shapes", "complexity"):
            patch.setattr(f"ema.report.runs.{section}", lambda *_: [])
        app(["run", str(folder)])
    assert not ended.value.code
    return text.getvalue()


@pytest.fixture(scope="module")
def result(folder: Path, printed: str) -> StudyResult:
    return store.load(folder / "_build" / f"{folder.name}.h5")


def test_scatter_between_assemblies_is_separated_from_noise(result: StudyResult):
    bare, beam, light = result.conditions
    assert (bare.label, beam.label, light.label) == ("bare", "1 kN", "light")
    assert beam.runs == ("beam_0", "beam_1", "beam_2") and beam.basis == "3 repeats"
    assert light.basis == "noise only; assembly scatter unknown"
    for group, (frequency, damping), gain in ((bare, BARE, np.ones(3)), (beam, BEAM, GAIN)):
        # -1, 0 and 1 standard deviations have a sample variance of one
        assert group.frequency.mean == pytest.approx(FREQUENCIES, rel=1e-4)
        assert group.frequency.between == pytest.approx(frequency * np.array(FREQUENCIES), rel=0.1)
        assert group.damping.mean == pytest.approx(DAMPING * gain, rel=0.003)
        if group is beam:
            assert group.damping.between == pytest.approx(damping * DAMPING * gain, rel=0.1)
        assert (group.frequency.noise < 0.2 * group.frequency.between).all()
        assert group.damping.half == pytest.approx(4.303 * group.damping.std, rel=1e-3)


def test_only_what_exceeds_the_scatter_is_significant(result: StudyResult):
    beam, light = result.differences
    assert beam.words("damping") == ("significant", "not significant", "not significant")
    assert beam.words("frequency") == ("not significant",) * 3
    noisy = np.abs(np.diff(beam.damping, axis=1)[:, 0]) > beam.damping_noise
    assert noisy[1], "by the noise alone the second mode would have been called different"
    assert light.words("damping") == ("noise only; assembly scatter unknown",) * 3
    codes = [finding.code for finding in result.findings]
    assert codes.count("repeat-alone") == 1


def test_the_command_prints_repeats_changes_and_verdict(printed: str):
    assert "1 kN: beam_0, beam_1, beam_2: 3 repeats" in printed
    assert "1 kN against bare: 95 % intervals from repeats" in printed
    sentence = re.escape("1 kN against bare, 3 and 3 repeats: damping is significantly higher in 1 of 3 modes; most ")
    sentence += r"clearly at 60 Hz: 1\.\d+ to 1\.\d+ %, \+0\.36 ± 0\.16 % \(95 %\)\."
    assert re.search(sentence, printed), printed
    assert "1 kN against bare, 3 and 3 repeats: frequency shows no significant change in any of 3 modes." in printed
    assert "light against bare: noise only; assembly scatter unknown. No change is called significant." in printed


def test_machines_get_the_same(result: StudyResult):
    told = json.loads(json.dumps(summary(result), allow_nan=False))
    mode = told["differences"][0]["modes"][0]["damping_ratio"]
    assert mode["verdict"] == "significant" and mode["half"] == pytest.approx(0.0016, rel=0.1)
    assert told["conditions"][1]["modes"][0]["damping_ratio"]["between"] == pytest.approx(0.04 * 0.012 * 1.3, rel=0.1)
    assert told["differences"][1]["modes"][0]["damping_ratio"]["half"] is None


def test_the_report_has_repeats_and_changes(folder: Path, result: StudyResult):
    page = (folder / "_build" / f"{folder.name}.html").read_text(encoding="utf-8")
    for text in (
        "Repeats of 1 kN (beam_0, beam_1, beam_2): 3 repeats.",
        "Change from bare (3 repeats) to 1 kN (3 repeats)",
        "Change from bare (3 repeats) to light (noise only; assembly scatter unknown)",
        "damping is significantly higher in 1 of 3 modes",
    ):
        assert text in page
    table = (folder / "_build" / f"{folder.name}_tables" / "change_bare_1_kN.csv").read_text().splitlines()
    assert table[0].startswith("Mode,Mode in 1 kN,f [Hz]") and ",significant," in table[1]


def test_check_names_the_label_that_nothing_shares(folder: Path, unfitted: None, capsys: pytest.CaptureFixture[str]):
    told = json.loads(ema_command(capsys, "check", folder, "--json").out)
    (finding,) = [one for one in told["findings"] if one["code"] == "repeat-alone"]
    assert finding["where"] == "repeats of 100 N"
    assert finding["message"].endswith("only light has this label; noise only; assembly scatter unknown.")


def test_takes_of_one_assembly_claim_nothing(tmp_path: Path, unfitted: None, capsys: pytest.CaptureFixture[str]):
    folder = campaign(tmp_path / "takes", 'repeat = "bare"\nassembly = "Monday"')
    opened = acquisition.open_campaign(folder)
    assert [run.assembly for run in opened.where(repeat="bare")] == ["Monday"] * 3
    told = json.loads(ema_command(capsys, "check", folder, "--json").out)
    assert [one["where"] for one in told["findings"]] == ["repeats of bare", "repeats of 100 N"]
