"""Where a beam may go on a measured surface: keep-out areas, edges, overhangs."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.path import Path

from ema import place
from ema.data import FrictionLaw, Geometry, ModalModel
from ema.data.placement import BoltedJoint, Candidates, FrictionBeam
from ema.dof import Dof
from ema.errors import InputError
from ema.examples import plate
from ema.place.candidates import about_keep_out
from ema.place.recipe import load
from ema.shapes import Surface, smooth, with_rigid_body
from tests.unit.placement_rig import RECIPE

BEAM = FrictionBeam(0.3, 0.06, 0.05, overhang=0.02)
ALL_AROUND = np.radians([0.0, 30.0, 90.0, 135.0]).tolist()


@pytest.fixture(scope="module")
def surface() -> Surface:
    """A measured rectangle of 0.6 m x 0.4 m; the shapes do not matter."""
    return Surface(
        origin=np.zeros(3),
        axes=np.eye(3),
        extent=np.array([[0, 0.6], [0, 0.4]]),
        powers=np.array([[0, 0], [1, 0]]),
        coefficients=np.array([[0.5], [0.5]]),
        covariance=np.zeros((1, 2, 2)),
        noise=np.zeros(1),
        points=np.zeros((0, 2)),
    )


def rows(candidates: Candidates) -> set[tuple[float, ...]]:
    return {(*centre, angle) for centre, angle in zip(candidates.centres.tolist(), candidates.angles.tolist())}


def overlap(corners: np.ndarray, centre: np.ndarray, angle: float, beam: FrictionBeam = BEAM) -> bool:
    """By many points of the beam in the polygon, and many points of the outline of the polygon in the beam."""
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    along, across = np.linspace(-0.5, 0.5, 171) * beam.length, np.linspace(-0.5, 0.5, 31) * beam.width
    own = np.stack([part.ravel() for part in np.meshgrid(along, across)], axis=1) @ turn + centre
    share = np.linspace(0, 1, 400)[:, None, None]
    outline = ((1 - share) * corners + share * np.roll(corners, -1, axis=0)).reshape(-1, 2)
    local = (outline - centre) @ turn.T
    within = np.all(np.abs(local) <= [0.5 * beam.length, 0.5 * beam.width], axis=1)
    return bool(Path(corners).contains_points(own).any() or within.any())


@pytest.mark.parametrize("seed", range(6))
def test_no_part_of_a_beam_lies_in_a_keep_out_area_and_no_other_place_is_lost(surface, seed):
    """Areas from the size of a bolt head to that of the plate, star-shaped, half of them not convex."""
    rng = np.random.default_rng(seed)
    turned = np.sort(rng.uniform(0, 2 * np.pi, 7))
    radius = np.geomspace(0.005, 0.2, 6)[seed] * rng.uniform(0.4, 1.0, 7)
    corners = rng.uniform([0.1, 0.1], [0.5, 0.3]) + radius[:, None] * np.stack([np.cos(turned), np.sin(turned)], axis=1)
    everywhere = place.grid(surface, [BEAM], 0.025, ALL_AROUND)
    left = rows(place.grid(surface, [BEAM], 0.025, ALL_AROUND, keep_out=[corners]))
    assert left <= rows(everywhere)
    for centre, angle in zip(everywhere.centres, everywhere.angles):
        if (*centre.tolist(), float(angle)) in left:
            assert not overlap(corners, centre, angle)
        else:
            # the points of the check lie 2 mm apart
            assert overlap(corners, centre, angle, FrictionBeam(0.304, 0.064, 0.05, overhang=0.02))


@pytest.mark.parametrize("number", [0, 1, 2, 3])
def test_no_joint_lies_in_a_keep_out_area_as_small_as_a_bolt_head(surface, number):
    """Joints lie between evenly spread points of the beam as well."""
    beam = FrictionBeam(0.3, 0.001, 0.05, overhang=0.02, joints=4)
    before = place.grid(surface, [beam], 0.05, [0.0])
    joint = before.joints(len(before) // 2)[number]
    area = joint + 0.001 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    after = place.grid(surface, [beam], 0.05, [0.0], keep_out=[area])
    assert len(after) < len(before)
    assert all(np.abs(after.joints(row) - joint).max(axis=1).min() > 0.001 for row in range(len(after)))


def test_a_beam_beside_a_keep_out_area_is_as_far_from_it_as_it_is_wide(surface):
    """A wall at x from 0.4 to 0.41 m: beams along y have their middle 30 mm before it, or beyond."""
    wall = np.array([[0.4, -1.0], [0.41, -1.0], [0.41, 1.0], [0.4, 1.0]])
    left = place.grid(surface, [BEAM], 0.005, [np.pi / 2], keep_out=[wall]).centres[:, 0]
    assert 0.364 < left[left < 0.4].max() < 0.37 and 0.44 < left[left > 0.4].min() < 0.446


@pytest.mark.parametrize("area", [np.zeros((2, 2)), np.full((3, 2), np.nan)])
def test_what_is_no_polygon_is_refused(surface, area):
    with pytest.raises(InputError, match="not a keep-out area"):
        place.grid(surface, [BEAM], 0.05, keep_out=[area])


def stood(axis: str, order: list[int]) -> tuple[ModalModel, Geometry]:
    """The plate of the examples with its x, y, z along other global axes, measured along ``axis``; it hangs freely."""
    bare, geometry = plate()
    dofs, inputs = (tuple(Dof(dof.node, axis) for dof in group) for group in (bare.dofs, bare.inputs))
    turned = Geometry(geometry.nodes, geometry.xyz[:, order])
    return with_rigid_body(replace(bare, dofs=dofs, inputs=inputs), turned, mass=2.0)[0], turned


@pytest.mark.parametrize(("axis", "order"), [("+Y", [0, 2, 1]), ("+X", [2, 0, 1])])
def test_an_upright_plate_has_the_surface_and_the_places_of_a_flat_one(axis, order):
    """With the same area kept free, in the same two coordinates: all that is predicted comes from these."""
    area = np.array([[0.0, 0.0], [0.6, 0.0], [0.6, 0.1], [0.2, 0.15]])
    beam = FrictionBeam(0.2, 0.02, 0.01, overhang=0.01)
    flat, upright = (smooth(*one) for one in (stood("+Z", [0, 1, 2]), stood(axis, order)))
    assert upright.extent == pytest.approx(flat.extent) and upright.points == pytest.approx(flat.points)
    assert upright.coefficients == pytest.approx(flat.coefficients, rel=1e-6, abs=1e-9)
    here, there = (place.grid(one, [beam], 0.05, ALL_AROUND, keep_out=[area]) for one in (flat, upright))
    assert there.centres == pytest.approx(here.centres) and there.angles.tolist() == here.angles.tolist()
    assert 0 < len(here) < len(place.grid(flat, [beam], 0.05, ALL_AROUND))


def test_an_area_beside_the_measured_points_is_named(surface):
    """One that touches them from the outside keeps beams off, and so does one that contains them all."""
    square = np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]])
    beside, touching, around = square - np.array([0.3, 0.0]), square + np.array([0.6, 0.4]), 20 * (square - 0.05)
    assert about_keep_out(surface, [square, touching, around]) == ()
    (finding,) = about_keep_out(surface, [square, beside])
    assert (finding.severity, finding.code, finding.where) == ("warning", "keep-out-beside", "keep_out 2")
    assert "from (0, 0) to (0.6, 0.4) m" in finding.message


def test_coordinates_of_a_plate_about_the_origin_are_read(tmp_path):
    """Lengths with a sign: corners of areas, where a test was done, where the best place is expected."""
    text = (
        RECIPE
        + 'keep_out = [[["-0.3 m", "-0.2 m"], ["0 m", "-0.2 m"], ["0 m", "0 mm"]]]\n'
        + '[forecast]\nnormal_force = ["60 N"]\n[expect]\ncentre = ["-100 mm", "0.1 m"]\n'
        + '[[trials.done]]\nforce = "15 N"\nnormal_force = "60 N"\nfrequency = ["490 Hz"]\ncentre = ["0.1 m", "-0.1 m"]\n'
    )
    (tmp_path / "place.toml").write_text(text, encoding="utf-8")
    recipe = load(tmp_path / "place.toml")
    assert recipe.keep_out()[0].tolist() == [[-0.3, -0.2], [0.0, -0.2], [0.0, 0.0]]
    assert recipe.trials.done[0].centre == [0.1, -0.1] and recipe.expect.centre == [-0.1, 0.1]
    (tmp_path / "place.toml").write_text(RECIPE.replace('"20 mm"', '"-20 mm"'), encoding="utf-8")
    with pytest.raises(InputError, match="overhang: input should be greater than or equal to 0"):
        load(tmp_path / "place.toml")


@pytest.mark.parametrize(
    ("spacing", "overhang", "centre", "angle", "beyond"),
    [
        (0.2, 0.02, (0.3, 0.2), 0.0, 0.0),
        (0.2, 0.02, (0.12, 0.2), 0.0, 0.0),
        (0.2, 0.02, (0.1, 0.2), 0.0, 0.02),
        (0.2, 0.02, (0.1, 0.0), 90.0, 0.12),
        (0.2, 3.0, (0.3, 0.2), 0.0, 2.8),
        (0.2, 0.3, (0.5, 0.2), 30.0, 0.5 + 0.4 * np.sqrt(0.75) - 0.6),
    ],
)
def test_a_beam_that_sticks_out_is_named(spacing, overhang, centre, angle, beyond):
    bare, geometry = plate()
    beam = FrictionBeam(spacing, 0.02, 0.01, overhang=overhang)
    joint = BoltedJoint(FrictionLaw("masing", 0.4, 2e7), 1e8, surface_height=0.003)
    task = place.Task(bare, smooth(bare, geometry), joint, "1:+Z", np.array([10.0]), np.array([50.0]), modes=(0,))
    here = Candidates(np.array([centre]), np.radians([angle]), np.zeros(1, int), (beam,))
    findings = [one for one in place.rank(task, here, draws=0).best.findings if one.code == "beam-sticks-out"]
    assert len(findings) == (beyond > 0)
    for finding in findings:
        assert finding.severity == "info" and finding.where == "rank 1"
        assert finding.value == pytest.approx(beyond) and f"reaches {beyond:.3g} m beyond" in finding.message


def test_joints_keep_their_margin_and_the_overhang_may_stick_out(surface):
    beam = FrictionBeam(0.2, 0.02, 0.01, overhang=3.0)
    candidates = place.grid(surface, [beam], 0.02, ALL_AROUND, margin=0.03)
    joints = np.array([candidates.joints(row) for row in range(len(candidates))])
    assert len(candidates) > 100
    assert np.all((joints >= 0.03 - 1e-9) & (joints <= np.array([0.57, 0.37]) + 1e-9))
