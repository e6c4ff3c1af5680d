"""`ema map` and maps in recipes on small campaigns, and what is wrong with some of them."""

import json
from textwrap import dedent

import numpy as np
import pytest
from typer.testing import CliRunner

import acquisition
from ema import store
from ema.cli.app import app
from ema.data import Channel, FrfSet, MapResult, Recording
from ema.dof import Dof
from ema.errors import InputError
from ema.study import mapping, recipe
from tests.golden_json import assert_keys

RATE, LINES = 4096.0, np.arange(470.0, 530.0, 1.5)
HEAD = """
[campaign]
name = "small map"
files = "raw"

[[channels]]
name = "force"
role = "reference"
unit = "N"
dof = "1:+Z"

[[channels]]
name = "acc"
unit = "m/s^2"
dof = "1:+Z"
"""


def damped(level, force):
    return 495 + np.log10(force / level), 0.0065 + 0.008 * np.exp(-(np.log(force / level / 4) ** 2))


def campaign(folder, levels=(10, 20), forces=(50, 100), joints=("J1",), unit="N", known=True):
    """Stepped sines of one mode with the damping of a made-up joint."""
    (folder / "raw").mkdir(parents=True)
    text = [HEAD]
    for number, (level, force) in enumerate((a, b) for b in forces for a in levels):
        name = f"run_{level}_{force}"
        natural, zeta = damped(level, force)
        w, r = 2 * np.pi * LINES, 2 * np.pi * natural
        answer = level * -0.03 * w**2 / (r**2 - w**2 + 2j * zeta * r * w)
        t = np.arange(256) / RATE
        waves = np.exp(1j * np.outer(w, t))
        signals = np.array([level * waves.real.ravel(), (answer[:, None] * waves).real.ravel()])
        store.save(folder / "raw" / f"{name}.h5", Recording(signals, RATE, (Channel("force"), Channel("acc"))))
        joint = joints[number % len(joints)]
        stated = f'value = "{force} {unit}", ' if known else ""
        text.append(
            dedent(f"""
            [[runs]]
            id = "{name}"
            kind = "stepped sine"
            files = "{name}.h5"
            level = "{level} N"
            period = "0.0625 s"
            normal_force = [{{ joint = "{joint}", {stated}nominal = "{force} N" }}]
        """)
        )
    (folder / "campaign.toml").write_text("\n".join(text), encoding="utf-8")
    return folder


def test_command_writes_table_csv_pictures_and_store(tmp_path):
    folder = campaign(tmp_path / "small")
    done = CliRunner().invoke(app, ["map", str(folder), "--near", "495", "--output", str(tmp_path / "out"), "--json"])
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert_keys("map", told)
    (chart,) = told["maps"]
    for point in chart["points"]:
        natural, zeta = damped(point["force_level"], point["normal_force"])
        assert point["frequency"] == pytest.approx(natural, abs=0.01)
        assert point["damping"] == pytest.approx(zeta, rel=1e-3)
        assert point["force_at_resonance"] == pytest.approx(point["force_level"], rel=1e-3)
    names = {path.name for path in (tmp_path / "out").iterdir()}
    stem = "mode_near_495_Hz"
    assert {f"{stem}.h5", f"{stem}.csv", f"{stem}_damping.png", f"{stem}_frequency.svg", f"{stem}_curves.png"} <= names
    assert isinstance(store.load(tmp_path / "out" / f"{stem}.h5"), MapResult)
    lines = (tmp_path / "out" / f"{stem}.csv").read_text().splitlines()
    assert len(lines) == 5 and lines[0].startswith("force_level,normal_force,F_N J1")


def test_a_mode_has_to_be_named(tmp_path):
    done = CliRunner().invoke(app, ["map", str(campaign(tmp_path / "small"))])
    assert done.exit_code == 2 and "which mode is to be mapped?" in done.output and "--near 500" in done.output


def mapped(folder, **more):
    return mapping.mapped(acquisition.open_campaign(folder), recipe.MapTable(near=495, **more), recipe.EstimateTable())


@pytest.mark.parametrize(
    ("levels", "forces", "code"), [((10,), (50, 100), "map-with-one-level"), ((10, 20), (50,), "map-with-one-force")]
)
def test_a_map_with_one_level_says_what_it_cannot_tell(tmp_path, levels, forces, code):
    result = mapped(campaign(tmp_path / "one", levels, forces))
    assert code in {finding.code for finding in result.findings}
    assert np.isfinite(result.chart.damping).all()


def test_an_unknown_normal_force_is_refused_for_maps_but_the_run_is_read(tmp_path):
    folder = campaign(tmp_path / "unknown", known=False)
    with pytest.raises(InputError, match="unknown normal force"):
        mapped(folder)
    opened = acquisition.open_campaign(folder)
    assert {f.code for run in opened.runs for f in run.findings} == {"normal-force-unknown"}
    from ema import estimate, fit

    assert fit.local_fit(estimate.stepped(opened.runs[0]), 495).natural_frequency == pytest.approx(495.7, abs=0.1)


def test_kilonewtons_for_newtons_are_an_error_of_the_map(tmp_path):
    result = mapped(campaign(tmp_path / "kilo", unit="kN"))
    wrong = [finding for finding in result.findings if finding.code == "normal-force-unit"]
    assert wrong and wrong[0].severity == "error" and wrong[0].value == pytest.approx(1000)
    with pytest.raises(InputError, match="kN for N"):
        mapped(tmp_path / "kilo", normal_forces=[50, 100])


def test_joints_named_differently_are_refused(tmp_path):
    with pytest.raises(InputError, match="name the joints alike"):
        mapped(campaign(tmp_path / "names", joints=("J1", "joint 1")))


def test_runs_that_are_not_there_are_named(tmp_path):
    with pytest.raises(InputError, match="no run to make a map of"):
        mapped(campaign(tmp_path / "none"), runs=["mode7_*"])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('quantity = "damping"\nlow = 1', "about a map, a run or the release of a model"),
        ('quantity = "damping"\nmap = "m"', "says nothing"),
        ('quantity = "height"\nmap = "m"\nlow = 1', "quantity"),
        ('quantity = "run damping"\nrun = "r"\nlow = 1', "needs near"),
        ('quantity = "run damping"\nrun = "r"\nnear = 249\nlow = 0.7\nhigh = 0.5', "low = 0.7, high = 0.5"),
        ('quantity = "ridge"\nmap = "m"\nlow = 1\nforces = [200, 25]', "forces goes from .* 200 to 25"),
        ('quantity = "ridge"\nmap = "m"\nlow = 1\nlevels = [40, 6]', "levels goes from .* 40 to 6"),
    ],
)
def test_statements_that_say_nothing_are_refused(text, words):
    head = 'campaign = "x"\n[[statements]]\ntext = "t"\nsource = "s"\nverdict = "matched"\n'
    with pytest.raises(InputError, match=words):
        recipe.parse(head + text)


def campaign_of_frfs(folder, kind, level=True):
    """The same conditions, of which there are FRFs in universal files and no time signals."""
    campaign(folder)
    text = (folder / "campaign.toml").read_text(encoding="utf-8").replace('"stepped sine"', f'"{kind}"')
    if not level:
        text = "\n".join(line for line in text.splitlines() if not line.startswith("level"))
    for path in (folder / "raw").glob("run_*.h5"):
        _, drive, force = path.stem.split("_")
        natural, zeta = damped(float(drive), float(force))
        w, r = 2 * np.pi * LINES, 2 * np.pi * natural
        values = (-0.03 * w**2 / (r**2 - w**2 + 2j * zeta * r * w))[:, None, None]
        dof = Dof.parse("1:+Z")
        acquisition.write(path.with_suffix(".uff"), FrfSet(LINES, values, (dof,), (dof,), "accelerance", "m/s^2/N"))
        path.unlink()
    (folder / "campaign.toml").write_text(text.replace(".h5", ".uff"), encoding="utf-8")
    return folder


@pytest.mark.parametrize("kind", ["sweep", "stepped sine"])
def test_runs_of_frfs_make_a_map_at_their_stated_levels(tmp_path, kind):
    result = mapped(campaign_of_frfs(tmp_path / "frfs", kind))
    for row, level in enumerate(result.chart.force_levels):
        for column, force in enumerate(result.chart.normal_forces):
            natural, zeta = damped(level, force)
            assert result.chart.frequency[row, column] == pytest.approx(natural, abs=0.01)
            assert result.chart.damping[row, column] == pytest.approx(zeta, rel=1e-3)
    assert list(result.chart.force_levels) == pytest.approx([10, 20])
    assert sum(finding.code == "stated-level" for finding in result.findings) == 4
    assert np.isnan(result.dropout).all()


def test_runs_of_frfs_without_a_level_say_what_is_missing(tmp_path):
    folder = campaign_of_frfs(tmp_path / "frfs", "sweep", level=False)
    done = CliRunner().invoke(app, ["map", str(folder), "--near", "495"])
    assert done.exit_code == 2 and "the force level of a run of FRFs is not known" in done.output


def test_a_run_without_a_mode_says_why_and_where_the_frfs_are_large(tmp_path):
    """A map of holes alone had come with an info that conditions show no mode."""
    result = mapping.mapped(
        acquisition.open_campaign(campaign(tmp_path / "far")), recipe.MapTable(near=526), recipe.EstimateTable()
    )
    holes = ~np.isfinite(result.chart.damping)
    named = [finding for finding in result.findings if finding.code == "no-mode-near"]
    assert holes.all() and len(named) == 4 and {finding.severity for finding in named} == {"warning"}
    assert all(abs(finding.value - 495) < 2 for finding in named)


def test_a_stated_level_that_is_not_the_measured_one_is_named(tmp_path):
    folder = campaign(tmp_path / "rms")
    text = (folder / "campaign.toml").read_text(encoding="utf-8")
    (folder / "campaign.toml").write_text(text.replace('level = "10 N"', 'level = "7.07 N"'), encoding="utf-8")
    named = {finding.where for finding in mapped(folder).findings if finding.code == "level-not-as-stated"}
    assert named == {"run run_10_50", "run run_10_100"}
    assert "level-not-as-stated" not in {finding.code for finding in mapped(campaign(tmp_path / "right")).findings}
