"""Several beams that are chosen: against all sets of a small grid, and within what space and mass allow."""

import itertools
import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.polynomial.legendre import legval2d
from typer.testing import CliRunner

from ema import place, store
from ema.cli.app import app
from ema.errors import InputError
from ema.place import recipe as recipes
from ema.place.beams_choice import about_beams, chosen_beams
from ema.place.beams_forecast import beams_question, overlap
from ema.place.fundamental import fundamental, shares
from ema.place.objective import Objective
from ema.place.targets import target_task
from ema.place.task import only
from tests.golden_json import assert_keys
from tests.unit.test_place_beams import PLATE, bending, loaded, plate, stuck

SMALL = PLATE.replace('near = "200 Hz"', 'near = ["200 Hz", "260 Hz"]').replace('force = "20 N"', 'force = "5 N"', 1)
SEARCH = """
[search]
step = "200 mm"
angles = [0, 90]
shortlist = 3
keep = 5
draws = 5
"""


def drawn(seed: int):
    """A plate with three modes of random Legendre polynomials in both directions, none of them rigid."""
    rng = np.random.default_rng(seed)
    above = np.add.outer(np.arange(4), np.arange(3)) >= 2

    def shape(weights, x, y):
        return legval2d(x / 0.3, y / 0.2, weights * above)

    return plate([partial(shape, 0.5 * rng.standard_normal((4, 3))) for _ in range(3)], [200.0, 260.0, 410.0])


def asked(folder: Path, seed: int, step: float = 0.13, normal_forces=(80.0,)):
    """Task, candidates, and their ranks for one beam."""
    recipe = loaded(folder, SMALL)
    task, _ = target_task(recipe, *drawn(seed), "plate")
    task = task._replace(normal_forces=np.array(normal_forces))
    return task, place.grid(task.surface, recipe.catalogue()[:1], step=step, angles=[0.0, np.pi / 2])


def searched(task, spots, aim="damping", beams=2, **limits):
    ranked = place.rank(task, spots, Objective(aim), draws=0).places
    return place.search_together(task, spots, ranked, beams=beams, objective=Objective(aim), **limits)


def of_all_pairs(task, spots) -> dict[frozenset[int], np.ndarray]:
    """Damping ratios of both modes by the rows of all pairs that do not overlap."""
    values = {}
    for one, other in itertools.combinations(range(len(spots)), 2):
        pair = [only(spots, [one]), only(spots, [other])]
        if not overlap(pair[0], pair[1])[0]:
            asked = beams_question(task, pair, [80.0, 80.0])
            whole = shares(asked)[:, 0] >= 0.5  # of a mode spread over several resonances nothing is stated
            values[frozenset((one, other))] = np.where(
                whole, np.nan_to_num(fundamental(asked)[:, 1, 0, 0], nan=-1.0), -1.0
            )
    return values


def rows_of(choice, spots) -> list[int]:
    return [
        int(np.flatnonzero(np.all(spots.centres == one.centre, axis=1) & (spots.angles == one.angle))[0])
        for one in choice.locations
    ]


MORE = [(seed, 0.16) for seed in range(53, 63)] + [(seed, 0.13) for seed in range(63, 79)]
"""Further plates, and a finer grid of 22 locations."""


@pytest.mark.parametrize(
    ("seed", "step"),
    [*((seed, 0.16) for seed in range(47, 53)), *(pytest.param(*one, marks=pytest.mark.slow) for one in MORE)],
)
def test_the_choice_beside_all_pairs(tmp_path, seed, step):
    """No exchange of one beam is better, among all pairs of a small grid; and how near it comes to the best of them.

    Measured before: the best itself on 31 of 32, and 69 % of it at least.
    """
    task, spots = asked(tmp_path, seed, step)
    of_both = of_all_pairs(task, spots)
    for aim, of in (("least damping", np.min), ("damping", np.mean)):
        choice, pairs = searched(task, spots, aim), {rows: of(both) for rows, both in of_both.items()}
        chosen, best = frozenset(rows_of(choice, spots)), max(pairs.values())
        print(f"{aim}: {pairs[chosen] / best:.4f} of the best of {len(pairs)} pairs, {choice.cases} cases")
        assert choice.values[-1] == pytest.approx(pairs[chosen], rel=1e-4)
        assert pairs[chosen] >= max(value for rows, value in pairs.items() if rows & chosen) * (1 - 1e-4)
        assert choice.rounds <= 2 and np.all(np.diff(choice.values[1:]) > 0)
        assert pairs[chosen] >= 0.65 * best


@pytest.mark.parametrize("aim", ["peak reduction", "chatter"])
def test_levels_in_decibels_are_those_of_the_receptance(tmp_path, aim):
    """Of beams that stick: receptances of host, beams and springs by numpy, against those of the bare mode in closed form.

    |phi^2/(2 zeta omega^2)| is the peak of a mode alone, and the least real part is that over 2 (1 + zeta) (Tlusty).
    """
    recipe = loaded(tmp_path)
    task, _ = target_task(recipe, *bending(), "plate")
    task = task._replace(normal_forces=np.array([1e5]))
    spots = place.grid(task.surface, recipe.catalogue()[:1], step=0.2, angles=[0.0])
    choice = searched(task, spots, aim)
    mass, stiffness, losses, damping = stuck([(one, 0.02) for one in choice.locations])
    row = np.zeros(len(mass))
    row[:2] = 16.0 * (0.3**2 - 0.03), 30.0 * (0.3**2 - 0.05) * -0.2
    lines = np.arange(150.0, 260.0, 0.02)
    receptance = np.array(
        [
            row @ np.linalg.solve(stiffness + 1j * losses - w**2 * mass + 1j * w * damping, row)
            for w in 2 * np.pi * lines
        ]
    )
    with_beams = abs(receptance).max()
    zeta = (lines[np.flatnonzero(abs(receptance) > with_beams / np.sqrt(2))[[0, -1]]] @ [-1, 1]) / 2
    zeta /= lines[abs(receptance).argmax()]
    bare = row[0] ** 2 / (2 * 0.004 * (2 * np.pi * 200.0) ** 2)
    expected = 20 * np.log10(bare / with_beams)
    if aim == "chatter":
        expected += 20 * np.log10((1 + zeta) / (1 + 0.004))
    assert abs(expected) > 0.3
    assert choice.values[-1] == pytest.approx(expected, abs=0.02)
    assert choice.in_decibels and f"is {choice.values[-1]:.4g} dB" in about_beams(choice).message


def test_the_beams_keep_apart_and_within_their_mass(tmp_path):
    """Three beams of 0.314 kg: a limit of three of them allows them, one of 2.9 of them refuses the third."""
    task, spots = asked(tmp_path, 11, 0.16)
    heavy = spots.catalogue[0].mass
    assert heavy == pytest.approx(0.314)
    choice = searched(task, spots, beams=3, most_mass=3 * heavy)
    for one, other in itertools.combinations(rows_of(choice, spots), 2):
        apart = np.abs(spots.centres[one] - spots.centres[other])
        along = np.array([[np.cos(a), np.sin(a)] for a in spots.angles[[one, other]]])
        half = 0.5 * (np.abs(along) * 0.2 + np.abs(along[:, ::-1]) * 0.02)  # beams lie along x or y
        assert np.any(apart > half.sum(axis=0)), (one, other)
    with pytest.raises(InputError, match="no further beam fits") as refused:
        searched(task, spots, beams=3, most_mass=2.9 * heavy)
    assert "weigh at most" in str(refused.value)


def test_the_lighter_beam_is_taken_where_mass_is_scarce(tmp_path):
    recipe = loaded(tmp_path, SMALL)
    task, _ = target_task(recipe, *drawn(11), "plate")
    spots = place.grid(task.surface, recipe.catalogue(), step=0.2, angles=[0.0])
    light, wide = (beam.mass for beam in recipe.catalogue())
    choice = searched(task._replace(normal_forces=np.array([80.0])), spots, most_mass=light + wide)
    assert sorted(one.beam for one in choice.locations) in (["slim", "slim"], ["slim", "twice as wide"])
    only_light = searched(task._replace(normal_forces=np.array([80.0])), spots, most_mass=2 * light)
    assert [one.beam for one in only_light.locations] == ["slim", "slim"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"beams": 1}, "expected 2 or more"),
        ({"beams": 40}, "no further beam fits"),
    ],
)
def test_what_cannot_be_chosen_is_refused(tmp_path, arguments, words):
    task, spots = asked(tmp_path, 11, 0.2)
    with pytest.raises(InputError, match=words):
        searched(task, spots, **arguments)


def written(folder: Path, text: str) -> Path:
    model, geometry = drawn(12)
    store.save(folder / "plate.h5", {"modes": model, "geometry": geometry})
    (folder / "place.toml").write_text('modes = "plate.h5"\n' + text, encoding="utf-8")
    return folder / "place.toml"


def run(command: str, *arguments: object):
    return CliRunner().invoke(app, [command, *map(str, arguments)])


def test_the_command_places_two_beams(tmp_path):
    path = written(tmp_path, (SMALL + SEARCH + "beams = 2\n").replace("draws = 20", "draws = 10"))
    result = run("place", path, "--output", tmp_path / "out", "--json")
    assert result.exit_code == 0, result.output
    spoken = json.loads(result.stdout)
    assert_keys("place together", spoken)
    together = spoken["together"]
    assert together["searched"] == "one after the other, then exchanged" and len(together["beams"]) == 2
    (finding,) = (one for one in spoken["findings"] if one["code"] == "several-beams")
    assert "need not be the best set" in finding["message"]
    warned = [one["code"] for one in together["forecast"]["findings"] if one["severity"] == "warning"]
    assert {one["code"] for one in spoken["findings"]} >= set(warned)
    chosen = [
        place.Location(centre=tuple(one["centre"]), angle=one["angle"], beam=one["beam"]) for one in together["beams"]
    ]
    forces = [one["normal_force"] for one in together["beams"]]
    its = place.forecast_together(recipes.load(path), *drawn(12), chosen, normal_forces=forces).forecast
    mine = [mode["conditions"][0]["damping"] for mode in together["forecast"]["modes"]]
    same = np.stack([its.damping_low, its.damping, its.damping_high], axis=-1)[:, 0, 0]
    assert np.array(mine, dtype=float) == pytest.approx(same, rel=1e-6, nan_ok=True)
    assert np.isfinite(same[:, 1]).all()
    page = (tmp_path / "out" / "placement.html").read_text(encoding="utf-8")
    assert "2 beams that act together" in page
    assert store.load(tmp_path / "out" / "placement_together.h5")["forecast_together"].draws == 10
    kept = chosen_beams(store.load(tmp_path / "out" / "placement.h5"))
    assert kept is not None and list(kept.locations) == chosen and kept.normal_forces.tolist() == forces
    said = [one["message"] for one in spoken["findings"] if one["code"] == "beams-forecast"]
    assert len(said) == 2 and f"damping ratio of {100 * same[0, 1]:.3f} %" in said[0]


def test_nothing_is_chosen_again_when_a_placement_is_resumed(tmp_path, monkeypatch):
    path = written(tmp_path, (SMALL + SEARCH + "beams = 2\n").replace("draws = 20", "draws = 10"))
    arguments = ("place", path, "--output", tmp_path / "out", "--json")
    first = json.loads(run(*arguments).stdout)
    for name in ("ema.place.job.search_together", "ema.place.beams_forecast.forecast_together"):
        monkeypatch.setattr(name, None)
    again = run(*arguments, "--resume")
    assert again.exit_code == 0, again.output
    assert json.loads(again.stdout)["together"] == first["together"]


def test_a_single_beam_is_placed_as_before(tmp_path):
    path = written(tmp_path, SMALL + SEARCH)
    result = run("place", path, "--output", tmp_path / "out", "--json")
    spoken = json.loads(result.stdout)
    assert spoken["together"] is None and "several-beams" not in {one["code"] for one in spoken["findings"]}
    assert not (tmp_path / "out" / "placement_together.h5").exists()


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("beams = 0", "[search], beams"),
        ('most_mass = "0 kg"', "most_mass"),
        ('most_mass = "5 kg"', "most_mass limits several beams together"),
        ("beams = 2\n[objective]\nrobust = true", "robust = true is for a single beam"),
        ("beam = 2", "beam"),
    ],
)
def test_a_wrong_key_of_the_recipe_is_named(tmp_path, line, words):
    result = run("place", written(tmp_path, SMALL + SEARCH + line + "\n"), "--output", tmp_path / "out")
    assert result.exit_code == 2 and words in result.stderr, result.output
