"""Places for a friction beam: predictor, objectives, ranking."""

from dataclasses import replace

import numpy as np
import pytest

from ema import examples, place, shapes, simulate
from ema.data import Finding, FrictionLaw, Geometry, ModalModel
from ema.data.modal import poles_from
from ema.data.placement import BoltedJoint, Candidates, FrictionBeam, Placement, Ranking
from ema.datasets.free_plate import BendingStiffness, free_plate
from ema.dof import Dof
from ema.errors import InputError
from ema.place.describing import START, STEP, masing_secant, secant_table
from ema.place.predictor import beam_matrices
from ema.report.placement import answer

LENGTH, WIDTH = 0.9, 0.5
BEAM = FrictionBeam(0.3, 0.06, 0.05, overhang=0.02, name="steel 60 x 50")
JOINT = BoltedJoint(FrictionLaw("masing", 0.2, 2e8), 1e9, 0.045, friction_std=0.1, stiffness_std=0.2)


@pytest.fixture(scope="module")
def table():
    """A bare table measured exactly at 19 x 11 points and at the exciter."""
    plate = free_plate(LENGTH, WIDTH, 130.0, BendingStiffness(4.87e6, 1.5, 1.5, 0.26), modes=8)
    frequencies = plate.natural_frequencies.copy()
    frequencies[:4] = [499.0, 760.0, 1000.0, 1400.0]
    frequencies[4:] = np.maximum(frequencies[4:], 1600.0)
    x, y = (part.ravel() for part in np.meshgrid(np.linspace(0, LENGTH, 19), np.linspace(0, WIDTH, 11), indexing="ij"))
    x, y = np.append(x, 0.04), np.append(y, 0.06)
    shape = plate.shapes(x, y)
    dofs = tuple(Dof.parse(f"{node}:+Z") for node in range(1, len(x) + 1))
    poles = poles_from(frequencies, np.full(8, 0.00638))
    bare = ModalModel(
        poles, shape.astype(complex), dofs, (shape / (2j * poles.imag)).astype(complex), dofs, scaling="unit modal mass"
    )
    return bare, shapes.smooth(bare, Geometry(np.arange(1, len(x) + 1), np.stack([x, y, 0 * x], axis=1)))


def predict(table, centres=((0.3, 0.06),), joint=JOINT, levels=(15.0, 30.0), forces=(50.0, 100.0, 200.0), modes=(0,)):
    bare, surface = table
    count = len(centres)
    here = Candidates(np.array(centres), np.zeros(count), np.zeros(count, int), (BEAM,))
    return place.predict(
        place.Task(bare, surface, joint, bare.dofs[-1], np.array(levels), np.array(forces), modes), here
    )


def test_secant_stiffness_is_that_of_the_loops():
    table = secant_table("masing", ())
    for amplitude in (0.5, 2.0, 7.0):
        cycle = simulate.loop(FrictionLaw("masing", 1.0, 1.0), 1.0, amplitude)
        row = round((np.log(amplitude) - START) / STEP)
        near = np.exp(START + row * STEP)
        assert np.pi * near**2 * table[row].imag == pytest.approx(max(4 * (near - 1), 0), rel=1e-9, abs=1e-12)
        assert np.pi * amplitude**2 * masing_secant(np.array(amplitude)).imag == pytest.approx(
            cycle.area, rel=1e-5, abs=1e-9
        )


@pytest.mark.parametrize(
    "law",
    [
        ("regularised masing", (("exponent", 8.0),)),
        ("dahl", (("shape", 1.0),)),
        ("valanis", (("kappa", 0.5),)),
        ("bouc wen", (("exponent", 2.0), ("gamma", 0.3))),
        ("modified iwan", (("chi", 0.5), ("beta", 1.0), ("springs", 60.0))),
    ],
)
def test_secant_stiffness_of_smooth_laws_carries_the_area_of_their_loops(law):
    table = secant_table(*law)
    for amplitude in (0.5, 3.0, 30.0):
        row = round((np.log(amplitude) - START) / STEP)
        near = float(np.exp(START + row * STEP))
        area = simulate.loop(FrictionLaw(law[0], 1.0, 1.0, law[1]), 1.0, near).area
        assert np.pi * near**2 * table[row].imag == pytest.approx(area, rel=2e-3, abs=1e-4 * near**2)


def test_equal_ratios_of_force_and_normal_force_give_equal_damping(table):
    once, twice = predict(table, levels=(15.0,), forces=(60.0,)), predict(table, levels=(30.0,), forces=(120.0,))
    assert twice.damping[0, 0, 0, 0] == pytest.approx(once.damping[0, 0, 0, 0], rel=1e-6)
    assert twice.frequency[0, 0, 0, 0] == pytest.approx(once.frequency[0, 0, 0, 0], rel=1e-9)


def test_without_friction_a_mode_carries_the_mass_of_the_beam_only(table):
    bare, surface = table
    tight = predict(table, joint=replace(JOINT, law=FrictionLaw("masing", 1e-9, 2e8), normal_stiffness=1e13))
    points = tight.candidates.joints(0)
    mass, stiffness, _, normal = beam_matrices(BEAM)
    omega = 2 * np.pi * tight.frequency[0, 0, 0, 0]
    # the beam follows the plate at its two joints: its dynamic stiffness there, by constraint
    followed = np.linalg.inv(normal @ np.linalg.inv(stiffness - omega**2 * mass) @ normal.T)
    phi = surface.values(points)[:, 0]
    expected = np.sqrt(np.abs(bare.poles[0]) ** 2 + phi @ followed @ phi)
    assert omega == pytest.approx(expected, rel=2e-4)
    assert tight.damping[0, 0, 0, 0] == pytest.approx(0.00638 * tight.frequency[0, 0, 0, 0] / 499, rel=3e-3)


def test_damping_has_its_maximum_inside_the_range_of_normal_forces(table):
    forces = np.geomspace(5, 20000, 14)
    damping = predict(table, levels=(30.0,), forces=forces).damping[0, 0, 0]
    assert 0 < np.argmax(damping) < 13
    assert damping.max() > 1.8 * 0.00638
    assert max(damping[0], damping[-1]) < 0.00638 + 0.3 * (damping.max() - 0.00638)


def test_a_best_normal_force_at_the_end_of_those_asked_is_named(table):
    """The optimum of a wide range lies inside; of its lower and its upper half it is at an end."""
    bare, surface = table
    here = Candidates(np.array([[0.3, 0.06]]), np.zeros(1), np.zeros(1, int), (BEAM,))
    wide = np.geomspace(5, 20000, 14)

    def named(forces: np.ndarray) -> list[str]:
        task = place.Task(bare, surface, JOINT, bare.dofs[-1], np.array([30.0]), forces, (0,))
        ranked = place.rank(task, here, draws=0)
        searched = place.search(task, here, settings=place.SearchSettings(shortlist=1, draws=0))
        found = [
            [one.message for one in ranking.findings if one.code == "edge-of-range"] for ranking in (ranked, searched)
        ]
        assert found[0] == found[1]
        return found[0]

    best = int(np.argmax(predict(table, levels=(30.0,), forces=wide).damping[0, 0, 0]))
    assert named(wide[best - 2 : best + 3]) == []
    (below,), (above,) = named(wide[: best - 1]), named(wide[best + 2 :])
    assert f"{wide[best - 2]:g} N, is the largest" in below and "a larger one" in below
    assert f"{wide[best + 2]:g} N, is the smallest" in above and "a smaller one" in above
    assert named(wide[best : best + 1]) == []


@pytest.mark.parametrize(
    ("aim", "modes", "words"),
    [
        ("damping", (0,), "raises the damping of mode 1"),
        ("damping", (0, 1), "raises the mean damping of mode 1 and mode 2"),
        ("least damping", (1,), "raises the damping of mode 2"),
        ("least damping", (0, 1), "raises the least damping of mode 1 and mode 2"),
        ("geometric mean", (0, 1), "raises the geometric mean of the damping of mode 1 and mode 2"),
        ("peak reduction", (0,), "lowers the highest peak of mode 1"),
    ],
)
def test_an_aim_that_no_place_reaches_is_named(table, aim, modes, words):
    """Joints pressed with next to nothing slide without loss: the mass of the beam alone lowers the damping. With the
    normal forces of the other tests every aim is reached."""
    bare, surface = table
    here = Candidates(np.array([[0.3, 0.06], [0.45, 0.25]]), np.zeros(2), np.zeros(2, int), (BEAM,))
    wanted = place.Objective(aim)

    def named(forces: list[float]) -> tuple[Ranking, list[Finding]]:
        task = place.Task(bare, surface, JOINT, bare.dofs[-1], np.array([15.0, 30.0]), np.array(forces), modes)
        ranked = place.rank(task, here, wanted, draws=0)
        return ranked, [one for one in ranked.findings if one.code == "no-gain"]

    ranked, (finding,) = named([0.01, 0.02])
    expected = 0.0 if aim == "peak reduction" else 0.00638
    assert finding.severity == "warning" and finding.limit == pytest.approx(expected, rel=1e-6)
    assert finding.value == ranked.best.score <= finding.limit
    said = answer(Placement("t", ranked, np.zeros(3), np.eye(3), surface.extent, surface.points))
    assert said.startswith(f"No place {words}: the best is steel 60 x 50 at (")
    ranked, none = named([60.0, 120.0, 240.0])
    assert none == [] and ranked.best.score > expected
    said = answer(Placement("t", ranked, np.zeros(3), np.eye(3), surface.extent, surface.points))
    assert said.startswith("Bolt ")


@pytest.mark.parametrize("friction_std", [0.02, 0.3])
def test_a_robust_choice_takes_the_normal_force_with_the_largest_lower_bound(table, friction_std):
    """Only mu is uncertain: mu e^x at F_N does what mu does at F_N e^x, so the quantiles at every F_N are those of the
    damping over a normal distribution about log F_N. It falls steeper to one side, from
    which the choice moves away."""
    bare, surface = table
    sure = replace(surface, covariance=0 * surface.covariance, noise=0 * surface.noise)
    here = Candidates(np.array([[0.3, 0.06]]), np.zeros(1), np.zeros(1, int), (BEAM,))
    joint = replace(JOINT, friction_std=friction_std, stiffness_std=0.0)
    asked, fine = np.geomspace(30, 3000, 31), np.geomspace(5, 20000, 800)
    task = place.Task(bare, sure, joint, bare.dofs[-1], np.array([30.0]), asked, (0,))
    damping = predict((bare, sure), joint=joint, levels=(30.0,), forces=fine).damping[0, 0, 0]
    spread = np.exp(friction_std * np.random.default_rng(1).standard_normal(200_000))
    lower = np.array([np.quantile(np.interp(force * spread, fine, damping), 0.025) for force in asked])
    usual = place.rank(task, here, draws=500).best
    robust = place.rank(task, here, place.Objective(robust=True), draws=500).best
    best = int(np.flatnonzero(asked == robust.normal_force)[0])
    # the quantile of 500 draws scatters by a tenth of its distance from the median
    assert robust.score_low == pytest.approx(lower[best], rel=0.03)
    assert lower[best] > 0.98 * lower.max()
    assert robust.score_low >= usual.score_low and robust.score <= usual.score
    # asked normal forces are 17 % apart
    moved = np.log(robust.normal_force / usual.normal_force)
    assert abs(moved) < 0.2 if friction_std == 0.02 else moved * np.log(asked[lower.argmax()] / usual.normal_force) > 0


def test_a_robust_choice_prefers_the_place_whose_least_value_is_larger(table):
    """With all modes together too; and it needs draws."""
    bare, surface = table
    here = Candidates(np.array([[0.3, 0.06], [0.45, 0.25]]), np.zeros(2), np.zeros(2, int), (BEAM,))
    task = place.Task(bare, surface, JOINT, bare.dofs[-1], np.array([30.0]), np.array([100.0, 200.0]), (0,))

    def searched(*asked, draws):
        return place.search(*asked, settings=place.SearchSettings(draws=draws))

    for ask in (place.rank, searched):
        usual = ask(task, here, draws=100)
        robust = ask(task, here, place.Objective(robust=True), draws=100)
        bounds = [max(one.score_low for one in found.places) for found in (usual, robust)]
        assert robust.best.score_low == bounds[1] >= bounds[0]
        with pytest.raises(InputError, match="robust choice needs intervals; got draws = 0"):
            ask(task, here, place.Objective(robust=True), draws=0)
    assert str(place.Objective(robust=True)).endswith("lower end of its 95 % interval")


def test_best_normal_force_grows_in_proportion_to_the_excitation(table):
    forces = np.geomspace(20, 2000, 41)
    damping = predict(table, levels=(10.0, 20.0, 40.0), forces=forces).damping[0, 0]
    best = forces[np.argmax(damping, axis=1)]
    assert best[1] / best[0] == pytest.approx(2, rel=0.13)
    assert best[2] / best[0] == pytest.approx(4, rel=0.13)


def test_slopes_not_deflections_make_a_place_good(table):
    bare, surface = table
    here = place.grid(surface, [BEAM], 0.07, margin=0.02)
    task = place.Task(bare, surface, JOINT, bare.dofs[-1], np.array([30.0]), np.geomspace(30, 600, 6), (0,))
    ranking = place.rank(task, here, keep=5, draws=0)
    deflection = np.array([np.mean(np.abs(surface.values(here.joints(c))[:, 0])) for c in range(len(here))])
    from scipy.stats import spearmanr

    assert abs(spearmanr(ranking.scores, deflection).statistic) < 0.4
    assert ranking.best.score == ranking.scores.max()
    assert np.all(np.diff([spot.score for spot in ranking.places]) <= 0)


def test_intervals_hold_the_exact_answer_of_noisy_shapes(table):
    bare, surface = table
    rng = np.random.default_rng(4)
    noisy = replace(
        bare,
        shapes=bare.shapes
        + 0.1 * np.sqrt(np.mean(np.abs(bare.shapes) ** 2, axis=0)) * rng.standard_normal(bare.shapes.shape),
    )
    # the exciter's shape is taken as measured: give it exactly, the interval is about the place
    values = noisy.shapes.copy()
    values[-1] = bare.shapes[-1]
    noisy = replace(noisy, shapes=values)
    geometry = Geometry(np.arange(1, len(bare.dofs) + 1), np.column_stack([surface.points, np.zeros(len(bare.dofs))]))
    there = shapes.smooth(noisy, geometry)
    here = Candidates(np.array([[0.3, 0.1], [0.45, 0.2], [0.6, 0.3]]), np.zeros(3), np.zeros(3, int), (BEAM,))
    forces = np.geomspace(30, 600, 5)
    task = place.Task(
        noisy, there, replace(JOINT, friction_std=0.0, stiffness_std=0.0), bare.dofs[-1], np.array([30.0]), forces, (0,)
    )
    exact = place.predict(task._replace(bare=bare, surface=surface), here)
    inside = []
    for spot in place.rank(task, here, draws=60).places:
        column = int(np.argmin(np.abs(forces - spot.normal_force)))
        true = exact.damping[spot.candidate, 0, 0, column]
        inside.append(spot.damping_low[0, 0] <= true <= spot.damping_high[0, 0])
        assert spot.damping_high[0, 0] - spot.damping_low[0, 0] < 0.5 * spot.damping[0, 0]
    assert sum(inside) >= 2


def test_shift_is_split_into_mass_and_stiffness(table):
    bare, surface = table
    here = Candidates(np.array([[0.45, 0.25]]), np.zeros(1), np.zeros(1, int), (BEAM,))
    task = place.Task(bare, surface, JOINT, bare.dofs[-1], np.array([1.0]), np.array([20000.0]), (0,))
    spot = place.rank(task, here, draws=0).best
    assert spot.mass_shift[0] < 0 < spot.stiffness_shift[0]
    stuck = spot.frequency[0, 0] - 499.0
    assert spot.mass_shift[0] + spot.stiffness_shift[0] == pytest.approx(stuck, rel=0.3, abs=1.0)


def test_keep_out_areas_and_margin_hold(table):
    _, surface = table
    area = np.array([[0.2, 0.1], [0.5, 0.1], [0.5, 0.4], [0.2, 0.4]])
    here = place.grid(surface, [BEAM], 0.05, keep_out=[area], margin=0.03)
    for candidate in range(len(here)):
        joints = here.joints(candidate)
        along = joints[0] + np.linspace(0, 1, 20)[:, None] * (joints[-1] - joints[0])
        assert not np.any(np.all((along > [0.21, 0.11]) & (along < [0.49, 0.39]), axis=1))
        assert joints.min() >= 0.03 - 1e-9
    assert len(here) < len(place.grid(surface, [BEAM], 0.05, margin=0.03))


def test_bad_questions_get_one_sentence(table):
    bare, surface = table
    here = Candidates(np.array([[0.3, 0.06]]), np.zeros(1), np.zeros(1, int), (BEAM,))

    def ask(**changes):
        task = place.Task(bare, surface, JOINT, bare.dofs[-1], np.array([15.0]), np.array([50.0]), (0,))
        place.predict(task._replace(**changes), here)

    with pytest.raises(InputError, match="scaled shapes"):
        ask(bare=replace(bare, scaling="unscaled"))
    with pytest.raises(InputError, match="force levels"):
        ask(force_levels=[0.0])
    with pytest.raises(InputError, match="no such mode"):
        ask(modes=[17])
    with pytest.raises(InputError, match="not measured"):
        ask(at="9999:+Z")
    with pytest.raises(InputError, match="velocity"):
        ask(joint=replace(JOINT, law=FrictionLaw("lugre", 0.2, 2e8)))
    with pytest.raises(InputError, match="no place"):
        place.grid(surface, [replace(BEAM, spacing=2.0)], 0.05)
    with pytest.raises(InputError, match="not an aim"):
        place.rank(
            place.Task(bare, surface, JOINT, bare.dofs[-1], np.array([15.0]), np.array([50.0]), (0,)),
            here,
            place.Objective(aim="beauty"),
            draws=0,
        )


def test_the_answer_says_that_a_linear_fit_reads_its_damping_and_what_steady_states_have():
    given = examples.placement()
    forecast = given.forecast
    fitted = replace(
        forecast,
        damping=1.3 * forecast.damping,
        damping_low=1.2 * forecast.damping_low,
        damping_high=forecast.damping * 2,
    )
    steady = 100 * given.ranking.best.damping[0].min()
    words = answer(replace(given, forecast=fitted))
    assert f"N as a linear fit of the test reads it ({steady:.2f} % by the power of steady states)," in words
    for other in (given, replace(given, forecast=None), replace(given, forecast=replace(fitted, method="frozen"))):
        assert "linear fit" not in answer(other)
