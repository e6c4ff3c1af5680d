"""Several beams that act at the same time: against closed forms, and an eigenvalue solution of their own matrices."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import block_diag, eig
from typer.testing import CliRunner

from ema import place, store
from ema.cli.app import app
from ema.data import Geometry, ModalModel, poles_from
from ema.data.placement import Candidates
from ema.dof import Dof
from ema.errors import InputError
from ema.place import recipe as recipes
from ema.place.beams_forecast import beams_question
from ema.place.fundamental import fundamental
from ema.place.fundamental_kernels import LEFT
from ema.place.targets import target_task
from tests.golden_json import assert_keys

BANDS = tuple(what + end for what in ("frequency", "damping") for end in ("", "_low", "_high"))
PLATE = """
near = "200 Hz"
at = "1:+Z"
in_plane = "held"
force = "20 N"
normal_force = "80 N"
[[beams]]
name = "slim"
spacing = "200 mm"
width = "20 mm"
height = "10 mm"
[[beams]]
name = "twice as wide"
spacing = "200 mm"
width = "40 mm"
height = "10 mm"
[joint]
surface_height = "20 mm"
normal_stiffness = "1e7 N/m"
friction_std = "10 %"
stiffness_std = "20 %"
height_std = "1 mm"
tangential_loss = "2 %"
normal_loss = "1 %"
[joint.law]
name = "masing"
friction_coefficient = 0.2
contact_stiffness = "5e6 N/m"
reference_force = "80 N"
[forecast]
normal_force = "80 N"
draws = 20
method = "frozen"
"""


def loaded(folder: Path, text: str = PLATE) -> recipes.PlaceRecipe:
    path = folder / "place.toml"
    path.write_text(text, encoding="utf-8")
    return recipes.load(path)


def plate(shapes, frequencies) -> tuple[ModalModel, Geometry]:
    """A plate of 0.6 m x 0.4 m about the origin, whose shapes [1/sqrt(kg)] are functions of x and y."""
    x, y = (part.ravel() for part in np.meshgrid(np.linspace(-0.3, 0.3, 7), np.linspace(-0.2, 0.2, 5)))
    values = np.stack([shape(x, y) for shape in shapes], axis=1).astype(complex)
    dofs = tuple(Dof(node, "+Z") for node in range(1, len(x) + 1))
    poles = poles_from(np.array(frequencies), 0.004 + 0.001 * np.arange(len(frequencies)))
    model = ModalModel(poles, values, dofs, values / (2j * poles.imag), dofs, scaling="unit modal mass", name="plate")
    return model, Geometry(np.arange(1, len(x) + 1), np.stack([x, y, 0 * x], axis=1))


def twisting() -> tuple[ModalModel, Geometry]:
    """Twist alone, with node lines at y = 0 and x = 0."""
    return plate([lambda x, y: 8.0 * x * y], [200.0])


def bending() -> tuple[ModalModel, Geometry]:
    """Two modes that are even in x."""
    return plate([lambda x, y: 16.0 * (x**2 - 0.03), lambda x, y: 30.0 * (x**2 - 0.05) * y], [200.0, 340.0])


def at(x: float, y: float, degrees: float = 0.0, beam: str = "slim") -> place.Location:
    return place.Location(centre=(x, y), angle=np.radians(degrees), beam=beam)


def together(recipe, structure, beams, **forces):
    return place.forecast_together(recipe, *structure, beams, **forces)


def same(first, second, tolerance=1e-9):
    for name in BANDS:
        assert getattr(first, name) == pytest.approx(getattr(second, name), rel=tolerance), name


def test_a_beam_on_a_node_line_changes_nothing(tmp_path):
    """Twist 8 x y has neither deflection nor slope along y = 0."""
    recipe, beam = loaded(tmp_path), at(0.0, 0.1, 30.0)
    alone = together(recipe, twisting(), [beam], force_levels=[2.0, 20.0]).forecast
    with_another = together(recipe, twisting(), [beam, at(0.0, 0.0)], force_levels=[2.0, 20.0]).forecast
    assert (alone.damping / alone.bare_damping).max() > 1.05
    same(with_another, alone)


def test_a_beam_that_is_hardly_pressed_changes_nothing(tmp_path):
    """k_N and k_T with the cube of F_N: at a thousandth of a newton they are 2e-15 of those at 80 N."""
    text = PLATE.replace("[joint]", "[joint]\nnormal_exponent = 3.0").replace(
        "[joint.law]", "[joint.law]\nstiffness_exponent = 3.0"
    )
    recipe, beam = loaded(tmp_path, text), at(0.15, -0.1)
    alone = together(recipe, bending(), [beam], force_levels=[5.0]).forecast
    with_another = together(recipe, bending(), [at(-0.15, 0.1), beam], force_levels=[5.0], normal_forces=[1e-3, 80.0])
    assert with_another.forecast.normal_forces.tolist() == [80.0]
    assert with_another.normal_forces.tolist() == [[1e-3, 80.0]]
    same(with_another.forecast, alone)


@pytest.mark.parametrize("method", ["frozen", "measured"])
def test_mirrored_beams_are_a_single_beam_of_twice_everything(tmp_path, method):
    """In modes that are even in x both beams move alike: their masses, springs and slip forces add up."""
    text = PLATE.replace('method = "frozen"', f'method = "{method}"')
    double = text.replace('"1e7 N/m"', '"2e7 N/m"').replace('"5e6 N/m"', '"10e6 N/m"')
    both = together(loaded(tmp_path, text), bending(), [at(0.15, -0.1), at(-0.15, -0.1)], force_levels=[5.0])
    doubled, wide = loaded(tmp_path, double), at(0.15, -0.1, beam="twice as wide")
    single = together(doubled, bending(), [wide], force_levels=[5.0], normal_forces=[160.0]).forecast
    assert single.damping[0, 0, 0] > 1.5 * single.bare_damping[0]
    for name in ("frequency", "damping"):
        assert getattr(both.forecast, name) == pytest.approx(getattr(single, name), rel=1e-6), name
    # the draws solve their contact equation within that
    same(both.forecast, single, LEFT)
    if method == "measured":
        return  # the fit of a kinked peak depends on the band that the peak is sought in
    (searched,) = place.forecast_at(doubled, *bending(), [wide], force_levels=[5.0], normal_forces=[160.0])
    same(both.forecast, searched, 1e-3)


@pytest.mark.parametrize("forces", [[80.0], [80.0, 30.0, 120.0]])
def test_the_order_of_the_beams_does_not_matter(tmp_path, forces):
    recipe = loaded(tmp_path, PLATE.replace("[joint.law]", 'scatter = "10 %"\n[joint.law]'))
    beams = [at(0.15, -0.1), at(-0.1, 0.1, 20.0, "twice as wide"), at(0.15, 0.0)]
    first = together(recipe, bending(), beams, force_levels=[5.0], normal_forces=forces)
    for order in ([2, 0, 1], [1, 2, 0]):
        turned = [forces[row] for row in order] if len(forces) > 1 else forces
        other = together(recipe, bending(), [beams[row] for row in order], force_levels=[5.0], normal_forces=turned)
        same(other.forecast, first.forecast)
        assert other.locations == tuple(first.locations[row] for row in order)


def friction_beam(width: float, height=0.01, span=0.2, elements=4, modulus=210e9, density=7850.0):
    """Mass and stiffness (u, w, w' at every node), and rows of lower face and deflection at both ends."""
    length, area, inertia = span / elements, width * height, width * height**3 / 12
    size = 3 * (elements + 1)
    mass, stiffness = np.zeros((size, size)), np.zeros((size, size))
    a = length
    bent = np.array([[12, 6 * a, -12, 6 * a], [6 * a, 4 * a**2, -6 * a, 2 * a**2], [-12, -6 * a, 12, -6 * a], [6 * a, 2 * a**2, -6 * a, 4 * a**2]])  # fmt: skip
    heavy = np.array([[156, 22 * a, 54, -13 * a], [22 * a, 4 * a**2, 13 * a, -3 * a**2], [54, 13 * a, 156, -22 * a], [-13 * a, -3 * a**2, -22 * a, 4 * a**2]])  # fmt: skip
    for number in range(elements):
        along, across = [3 * number, 3 * number + 3], [3 * number + k for k in (1, 2, 4, 5)]
        stiffness[np.ix_(along, along)] += modulus * area / a * np.array([[1, -1], [-1, 1]])
        stiffness[np.ix_(across, across)] += modulus * inertia / a**3 * bent
        mass[np.ix_(along, along)] += density * area * a / 6 * np.array([[2, 1], [1, 2]])
        mass[np.ix_(across, across)] += density * area * a / 420 * heavy
    face, deflection = np.zeros((2, size)), np.zeros((2, size))
    for row, node in enumerate((0, elements)):
        face[row, 3 * node], face[row, 3 * node + 2], deflection[row, 3 * node + 1] = 1.0, 0.5 * height, 1.0
    return mass, stiffness, face, deflection


def stuck(places) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Mass, stiffness, its losses and damping of two host modes and two beams, with springs k (1 + j eta) at their joints.

    ``places``: location and width of each beam; the host is that of ``bending`` and comes first.
    """
    omega, zeta = 2 * np.pi * np.array([200.0, 340.0]), np.array([0.004, 0.005])
    mass, stiffness, losses = np.eye(2), np.diag(omega**2), np.zeros((2, 2))
    rows = []
    for here, width in places:
        direction = np.array([np.cos(here.angle), np.sin(here.angle)])
        parts = friction_beam(width)
        mass, stiffness, losses = (
            block_diag(one, two) for one, two in zip((mass, stiffness, losses), (*parts[:2], 0 * parts[0]))
        )
        for end, offset in enumerate((-0.1, 0.1)):
            x, y = np.array(here.centre) + offset * direction
            shape = np.array([16.0 * (x**2 - 0.03), 30.0 * (x**2 - 0.05) * y])
            slope = np.array([[32.0 * x, 0.0], [60.0 * x * y, 30.0 * (x**2 - 0.05)]]) @ direction
            rows += [(5e6, 0.02, 0.02 * slope, parts[2][end], len(mass)), (1e7, 0.01, -shape, parts[3][end], len(mass))]
    size = len(mass)
    for spring, loss, host, beam, end in rows:
        row = np.zeros(size)
        row[:2], row[end - len(beam) : end] = host, beam
        stiffness += spring * np.outer(row, row)
        losses += loss * spring * np.outer(row, row)
    damping = np.zeros((size, size))
    damping[[0, 1], [0, 1]] = 2 * zeta * omega
    return mass, stiffness, losses, damping


def test_sticking_beams_are_the_eigenvalues_of_host_springs_and_beams(tmp_path):
    """Complex eigenvalues of two host modes, two beams, and springs k (1 + j eta) at their joints, by scipy."""
    places = [(at(0.15, -0.1), 0.02), (at(-0.1, 0.1, 20.0, "twice as wide"), 0.04)]
    mass, stiffness, losses, damping = stuck(places)
    size = len(mass)
    whole = np.block([[np.zeros((size, size)), np.eye(size)], [-np.linalg.solve(mass, stiffness + 1j * losses), -np.linalg.solve(mass, damping)]])  # fmt: skip
    values, vectors = eig(whole)
    share = np.where(values.imag > 0, np.abs(vectors[0]), 0)
    pole = values[share.argmax()]
    text = PLATE.replace("draws = 20", "draws = 10")
    result = together(
        loaded(tmp_path, text), bending(), [here for here, _ in places], normal_forces=[1e5, 2e5]
    ).forecast
    assert abs(pole) / (2 * np.pi) < 199.0 or abs(pole) / (2 * np.pi) > 201.0
    assert result.frequency[0, 0, 0] == pytest.approx(abs(pole) / (2 * np.pi), rel=1e-4)
    assert result.damping[0, 0, 0] == pytest.approx(-pole.real / abs(pole), rel=1e-2)


@pytest.mark.parametrize("hang", ['in_plane = "held"', 'mass = "6 kg"'])
def test_a_single_beam_is_the_model_of_a_single_beam(tmp_path, hang):
    """Also where the host moves in its own plane against a beam that lies askew."""
    recipe = loaded(tmp_path, PLATE.replace('in_plane = "held"', hang))
    task, _ = target_task(recipe, *bending(), "plate")
    here = Candidates(np.array([[-0.1, 0.1]]), np.array([0.3]), np.array([0]), recipe.catalogue())
    asked = beams_question(task._replace(force_levels=np.array([5.0])), [here], [80.0])
    alone = asked._replace(model=place.model_at(task, here, 0, 80.0))
    assert fundamental(asked) == pytest.approx(fundamental(alone), rel=1e-9)


@pytest.mark.parametrize(
    ("beams", "forces", "words"),
    [
        ([at(0.1, 0.1), at(0.1, 0.115)], [], "two beams overlap"),
        ([at(0.1, 0.1), at(0.1, 0.1, 90.0)], [], "two beams overlap"),
        ([at(0.1, 0.1), at(0.1, -0.1)], [80.0, 80.0, 80.0], "3 for 2 beams, expected one for all, or one for each"),
        ([at(0.1, 0.1), at(0.1, -0.1)], [80.0, 0.0], "not normal forces"),
        ([], [], "no location for a beam"),
        ([at(0.1, 0.1), at(0.1, -0.1, beam="oak")], [], "no such beam"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path, beams, forces, words):
    with pytest.raises(InputError, match=words):
        together(loaded(tmp_path), bending(), beams, normal_forces=forces)


def test_beams_of_different_materials_are_refused(tmp_path):
    recipe = loaded(tmp_path, PLATE.replace('width = "40 mm"', 'width = "40 mm"\nloss = "1 %"'))
    with pytest.raises(InputError, match="one loss factor"):
        together(recipe, bending(), [at(0.1, 0.1), at(0.1, -0.1, beam="twice as wide")])


def test_beams_side_by_side_are_not_refused(tmp_path):
    """Their edges are 1 mm apart: 21 mm between the middles of two beams of 20 mm."""
    result = together(loaded(tmp_path), bending(), [at(0.1, 0.1), at(0.1, 0.121)], force_levels=[5.0])
    assert np.isfinite(result.forecast.damping).all()


def run(folder: Path, *arguments: object):
    model, geometry = bending()
    store.save(folder / "plate.h5", {"modes": model, "geometry": geometry})
    loaded(folder)
    words = (folder / "plate.h5", "--recipe", folder / "place.toml", *arguments, "--output", folder / "out")
    return CliRunner().invoke(app, ["predict", *map(str, words)])


PLACES = ("--place", "150 mm, -100 mm, 0 deg", "--place", "-0.1 m, 0.1 m, 20 deg", "--together")
BOTH = (
    "--beam",
    "slim",
    "--beam",
    "twice as wide",
    "--normal-force",
    "30 N",
    "--normal-force",
    "80 N",
    "--force",
    "5 N",
)


def test_the_command_predicts_beams_together(tmp_path):
    result = run(tmp_path, *PLACES, *BOTH, "--json")
    assert result.exit_code == 0, result.output
    spoken = json.loads(result.stdout)
    assert_keys("predict together", spoken)
    (mode,) = spoken["together"]["modes"]
    (condition,) = mode["conditions"]
    assert condition["normal_forces"] == [30.0, 80.0]
    beams = [at(0.15, -0.1), at(-0.1, 0.1, 20.0, "twice as wide")]
    expected = together(loaded(tmp_path), bending(), beams, force_levels=[5.0], normal_forces=[30.0, 80.0]).forecast
    assert condition["damping"][1] == pytest.approx(expected.damping[0, 0, 0], rel=1e-7)
    same(store.load(tmp_path / "out" / "plate_prediction.h5")["forecast_together"], expected, 1e-7)
    (row,) = csv.DictReader((tmp_path / "out" / "plate_prediction.csv").read_text(encoding="utf-8").splitlines())
    assert (row["beam_1"], row["beam_2"], float(row["x_2_m"])) == ("slim", "twice as wide", -0.1)
    assert (float(row["normal_force_1_N"]), float(row["normal_force_2_N"])) == (30.0, 80.0)
    assert float(row["frequency_Hz_high"]) == pytest.approx(expected.frequency_high[0, 0, 0], rel=1e-7)
    assert (tmp_path / "out" / "plate_forecast_together.png").stat().st_size > 1000


def test_the_command_says_it_in_words(tmp_path):
    result = run(tmp_path, *PLACES, *BOTH)
    lines = result.stdout.splitlines()
    assert lines[0].startswith(
        "2 beams together: slim at (0.15, -0.1) m, 0 deg, F_N 30 N; twice as wide at (-0.1, 0.1) m, 20 deg, F_N 80 N: 95 % bands"
    )
    assert any(line.startswith("  mode 1, F_E 5 N, F_N 30, 80 N: ") for line in lines)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((*PLACES, "--beam", "slim", "--beam", "slim", "--beam", "slim"), "3 for 2 locations"),
        ((*PLACES, "--beam", "slim", *("--normal-force", "80 N") * 3), "3 for 2 beams"),
        (("--together", "--force", "5 N"), "what is to be predicted?"),
    ],
)
def test_what_cannot_be_asked_is_one_sentence(tmp_path, arguments, words):
    result = run(tmp_path, *arguments)
    assert result.exit_code == 2 and words in result.stderr, result.output
    assert len(result.stderr.strip().splitlines()) == 1
