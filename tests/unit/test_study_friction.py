"""A study with ring-downs, loops and a placement: what its recipe may ask for, and what it refuses."""

from pathlib import Path

import numpy as np
import pytest

import ema
from ema import store
from ema.data import Channel, Geometry, ModalModel, Recording
from ema.dof import Dof
from ema.errors import InputError
from tests.journeys import small_campaign
from tests.unit.placement_rig import RECIPE, bare_table

RATE = 2000.0

CAMPAIGN = """
[campaign]
name = "Release"
files = "data"
logo = "logo.png"

[[runs]]
id = "release"
kind = "snap-back"
files = "release.h5"

[[runs]]
id = "cycles"
kind = "unknown"
files = "cycles.h5"
"""

STUDY = """
campaign = "campaign"

[[ring_down]]
run = "release"
band = [50, 120]
channel = "acc"

[[loop]]
run = "cycles"
"""


@pytest.fixture
def released(tmp_path: Path) -> Path:
    data = tmp_path / "campaign" / "data"
    data.mkdir(parents=True)
    t = np.arange(4000) / RATE
    ringing = np.exp(-0.01 * 2 * np.pi * 80 * t) * np.cos(2 * np.pi * 80 * t)
    acc = Channel("acc", Dof(1, "+Z"), "acceleration", unit="m/s^2")
    store.save(data / "release.h5", Recording(ringing[None], RATE, (acc,), name="release"))
    slip, force = 1e-5 * np.sin(2 * np.pi * 10 * t), 3.0 * np.cos(2 * np.pi * 10 * t)
    channels = (Channel("slip", quantity="displacement", unit="m"), Channel("cell", quantity="force", unit="N"))
    store.save(data / "cycles.h5", Recording(np.stack([slip, force]), RATE, channels, name="cycles"))
    (tmp_path / "campaign" / "campaign.toml").write_text(CAMPAIGN, encoding="utf-8")
    (tmp_path / "campaign" / "logo.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    return tmp_path / "study.toml"


def test_ring_downs_and_loops_of_a_recipe(released: Path, without_report: None):
    result = ema.Study.load(released).run()
    (decay,), (loop,) = result.decays, result.loops
    assert result.runs == () and decay.name == "release"
    assert np.median(decay.damping_ratios) == pytest.approx(0.01, rel=0.02)
    assert (loop.area == pytest.approx(np.pi * 1e-5 * 3.0, rel=1e-3) and loop.cycles == 20 - 1) or loop.cycles == 20
    assert result.campaign.logo.endswith("logo.png")
    held = store.load(released.parent / "_build" / "study.h5")
    assert held.decays[0].name == "release" and held.loops[0].area == loop.area
    assert {"release.h5", "cycles.h5"} <= {Path(name).name for name, _ in result.provenance.inputs}
    study = ema.Study.load(released)
    assert study.is_current(held, study.open())
    cycles = released.parent / "campaign" / "data" / "cycles.h5"
    cycles.write_bytes(cycles.with_name("release.h5").read_bytes())
    assert not study.is_current(held, study.open()), "the record of the loop was replaced"


def test_what_the_recipe_cannot_mean(released: Path, without_report: None):
    released.write_text(STUDY + 'force = "cel"\n', encoding="utf-8")
    with pytest.raises(InputError, match="no such force; got cel, expected one of slip, cell"):
        ema.Study.load(released).run()
    released.write_text(STUDY + 'placement = "p.toml"\n', encoding="utf-8")
    with pytest.raises(InputError, match=r"unknown key 'placement' in \[loop\]"):
        ema.Study.load(released)
    (released.parent / "campaign" / "logo.png").unlink()
    released.write_text(STUDY, encoding="utf-8")
    with pytest.raises(InputError, match=r"there is no such logo; got logo.png"):
        ema.Study.load(released).run()


def table_study(folder: Path) -> Path:
    """Two modes of the work table as a hammer test of FRFs, and a recipe that asks where a beam goes."""
    from ema.synthesis import frfs

    bare, geometry = bare_table()
    kept = bare.natural_frequencies < 1000
    modes = ModalModel(
        bare.poles[kept],
        bare.shapes[:, kept],
        bare.dofs,
        bare.participation[:, kept],
        bare.inputs,
        scaling=bare.scaling,
    )
    measured = frfs(modes, np.arange(300, 1000, 0.5), "accelerance", outputs=bare.dofs, inputs=[Dof(91, "+Z")])
    folder.mkdir(parents=True)
    return store_frfs(folder, measured, geometry)


def store_frfs(folder: Path, measured, geometry: Geometry) -> Path:
    from dataclasses import replace

    import acquisition

    acquisition.write(folder / "bare.uff", replace(measured, unit="(m/s^2)/N"), geometry, binary=True)
    (folder / "place.toml").write_text(RECIPE.replace('modes = "bare.h5"\n', ""), encoding="utf-8")
    (folder / "study.toml").write_text(
        'campaign = "bare.uff"\nplacement = "place.toml"\n[fit]\nband = [400, 900]\norders = [2, 16, 2]\n',
        encoding="utf-8",
    )
    return folder / "study.toml"


def test_a_study_answers_where_the_beam_goes(tmp_path: Path, without_report: None):
    recipe = table_study(tmp_path / "table")
    result = ema.Study.load(recipe).run()
    found = result.placement
    assert found is not None and found.geometry is not None
    best = found.ranking.best
    assert best.damping.min() > 1.3 * 0.00638 and best.normal_force in (60.0, 120.0, 240.0)
    assert any(finding.code == "not-compared" for finding in result.findings)
    held = store.load(tmp_path / "table" / "_build" / "study.h5")
    assert held.placement.ranking.best.normal_force == best.normal_force

    with pytest.MonkeyPatch.context() as patched:  # resumed, nothing is placed again
        patched.setattr("ema.place.job.place", _refused)
        again = ema.Study.load(recipe).run(resume=True).placement
    assert again is not None and [one.candidate for one in again.ranking.places] == [
        one.candidate for one in found.ranking.places
    ]
    assert np.array_equal(again.ranking.best.damping, best.damping)
    other = (recipe.parent / "place.toml").read_text(encoding="utf-8").replace("120 N", "130 N")
    (recipe.parent / "place.toml").write_text(other, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patched, pytest.raises(AssertionError, match="placed again"):
        patched.setattr("ema.place.job.place", _refused)  # another recipe is another placement
        ema.Study.load(recipe).run(resume=True)

    (recipe.parent / "place.toml").write_text(RECIPE, encoding="utf-8")
    with pytest.raises(InputError, match=r"names a structure of its own; got bare.h5"):
        ema.Study.load(recipe).run(resume=True)


def test_a_study_chooses_several_beams(tmp_path: Path, without_report: None):
    """The set stands in the stored result, its forecast beside it, and the picture of the map draws it."""
    from ema import place, show
    from ema.place.beams_choice import chosen_beams, chosen_candidates

    recipe = table_study(tmp_path / "table")
    asked = recipe.parent / "place.toml"
    text = asked.read_text(encoding="utf-8").replace("[search]", "[search]\nbeams = 2", 1)
    asked.write_text(text + '[forecast]\nnormal_force = "120 N"\ndraws = 10\n', encoding="utf-8")
    result = ema.Study.load(recipe).run()
    stored = store.load(tmp_path / "table" / "_build" / "study.h5").placement
    choice, its = chosen_beams(stored), result.placement
    assert choice is not None and len(choice.locations) == 2 and choice.gain > 1.05
    assert [one.code for one in its.findings].count("several-beams") == 1
    assert {"several-beams", "beams-forecast"} <= {finding.code for finding in result.findings}
    task = ema.study.read_placement(recipe)
    expected = place.forecast_together(
        task.recipe, task.modes, task.geometry, choice.locations, normal_forces=choice.normal_forces
    ).forecast
    kept = store.load(tmp_path / "table" / "_build" / "study" / "placement_together.h5")["forecast_together"]
    assert kept.damping_low == pytest.approx(expected.damping_low, rel=1e-6, nan_ok=True)
    axes = show.placement_map(stored, together=chosen_candidates(stored)).axes[0]
    lines = [np.round(line.get_xydata(), 9).tolist() for line in axes.lines]
    beams = chosen_candidates(stored)
    assert all(np.round(beams.joints(row), 9).tolist() in lines for row in range(2))
    assert {"A", "B"} <= {one.get_text() for one in axes.texts}


def _refused(*_: object, **__: object) -> None:
    raise AssertionError("placed again")


STATED = """
campaign = "four"
[fit]
band = [30, 250]

[[statements]]
sentence = "{sentence}"
text = "second mode: 105 Hz"
source = "Table 1"
run = "bare"
near = 105
quantity = "run frequency"
low = 104.5
high = 105.5
verdict = "matched"
"""


@pytest.mark.parametrize("sentence", ["105 Hz", ""])
def test_a_linear_hammer_test_has_curves_over_the_amplitude_where_a_publication_states_its_numbers(
    sentence: str, tmp_path: Path, without_report: None
):
    """Three linear modes: each once, at its frequency and damping; the number stands on the second; readings of ours
    ask for no curves."""
    small_campaign.campaign(tmp_path / "four")
    (tmp_path / "study.toml").write_text(STATED.format(sentence=sentence), encoding="utf-8")
    modes = ema.Study.load(tmp_path / "study.toml").run().amplitude_modes
    assert len(modes) == (3 if sentence else 0)
    for mode, frequency, damping in zip(modes, small_campaign.FREQUENCIES, (0.012, 0.009, 0.015), strict=False):
        assert np.median(mode.frequency.value) == pytest.approx(frequency, rel=1e-3)
        assert np.median(mode.damping.value) == pytest.approx(damping, rel=0.05)
        stated = [one.message for one in mode.findings if one.code == "stated-frequency"]
        assert len(stated) == (frequency == 105.0) and all("105 Hz (Table 1)" in one for one in stated)
