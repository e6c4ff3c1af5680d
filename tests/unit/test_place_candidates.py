"""Where a beam may go on a measured surface: keep-out areas, edges, overhangs."""

import numpy as np
import pytest
from matplotlib.path import Path

from ema import place
from ema.data.placement import Candidates, FrictionBeam
from ema.errors import InputError
from ema.shapes import Surface

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
