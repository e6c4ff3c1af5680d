"""A freely hung host moves in its own plane against the beam; frequencies against finite elements that share no code."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

from ema import place, shapes
from ema.data import FrictionLaw, Geometry, ModalModel, poles_from
from ema.data.placement import BoltedJoint, Candidates, FrictionBeam
from ema.dof import Dof
from ema.place import predict
from ema.place.fundamental import shares
from ema.place.shortlist import question
from ema.simulate.structure import assemble
from tests.bench.blind_hosts import hosts, truth

FORCE = 130.0
KEPT = 18
"""Modes of the host that both sides have, so that nothing above them differs."""


def stuck(parts: truth.Parts, sways: bool) -> np.ndarray:
    """Natural frequencies in Hz of the two parts on joints that stick, without modes of the host above ``KEPT``."""
    joint, stiffness = parts.joint, np.diag(parts.squares)
    offsets = joint.half_length * np.linspace(-1, 1, truth.SLIDERS)
    for n in range(2):
        shear, gap, turn = parts.rows[3 * n : 3 * n + 3]
        stiffness = stiffness + joint.tangential * np.outer(shear, shear) + joint.normal * np.outer(gap, gap)
        stiffness += joint.normal * np.mean(offsets**2) * np.outer(turn, turn)
    dropped = np.arange(KEPT, parts.sway + (0 if sways else 1))
    keep = np.setdiff1d(np.arange(len(stiffness)), dropped)
    squares = eigh(stiffness[np.ix_(keep, keep)], eigvals_only=True)
    return np.sqrt(np.maximum(squares, 0)) / (2 * np.pi)


@pytest.fixture(scope="module")
def built() -> tuple[place.Task, Candidates, truth.Parts, truth.Host]:
    """Exact shapes of a random plate of the bench, a beam at a place where its ends drag it along, true values."""
    case = hosts.case(7, 3)
    # smooth shapes: concentrated masses would leave errors of the surface in the comparison
    case = replace(case, host=replace(case.host, lumps=()))
    omega, damping, vectors = case.host.modes()
    x, y = (np.linspace(0, side, count) for side, count in zip(case.host.plate.size, (19, 13)))
    points = np.stack([part.ravel() for part in np.meshgrid(x, y, indexing="ij")], axis=1)
    values = (case.host.plate.rows(points) @ vectors[:, :KEPT]).astype(complex)
    dofs = tuple(Dof(1 + row, "+Z") for row in range(len(points)))
    poles = poles_from(omega[:KEPT] / (2 * np.pi), damping[:KEPT])
    bare = ModalModel(poles, values, dofs, values[:1] / (2j * poles.imag), dofs[:1], scaling="unit modal mass")
    geometry = Geometry(np.arange(1, len(points) + 1), np.column_stack([points, np.zeros(len(points))]))
    bar = replace(case.sheet.bar, elements=48)
    beam = FrictionBeam(bar.spacing, bar.width, bar.height, overhang=bar.overhang, rotary=True, shear=True)
    joint = replace(case.joint, uneven=((1.0, 1.0), (1.0, 1.0)), exponent=0.0)
    # nine sliders over 2 l resist rocking by k_N times the mean of their squared offsets, a line of length L by L^2/12
    length = float(np.sqrt(12 * np.mean((joint.half_length * np.linspace(-1, 1, truth.SLIDERS)) ** 2)))
    bolted = BoltedJoint(
        FrictionLaw("masing", 0.2, joint.tangential), joint.normal, joint.height, contact_length=length
    )
    spot = np.array([0.5 * bar.spacing + 0.06, 0.5 * case.host.plate.size[1]])
    with pytest.MonkeyPatch.context() as patch:
        # all modes of both parts, of which those of the host are chosen above
        patch.setattr(truth, "HIGHEST", 1e6)
        parts = truth.assembled(case.host, bar, joint, 0.0, points[0], (*spot, 0.0))
    task = place.Task(bare, shapes.smooth(bare, geometry), bolted, "1:+Z", np.ones(1), np.array([FORCE]), case.modes)
    return task, Candidates(spot[None], np.zeros(1), np.zeros(1, int), (beam,)), parts, case.host


def natural(task: place.Task, candidates: Candidates) -> np.ndarray:
    """Natural frequencies in Hz of the predictor's model with joints that stick."""
    system = assemble(place.model_at(task, candidates, 0, FORCE))
    slip = system.contacts.slip
    stiffness = system.stiffness + slip.T @ (slip * system.contacts.stiffness[:, None])
    return np.sqrt(np.maximum(eigh(stiffness, system.mass, eigvals_only=True), 0)) / (2 * np.pi)


def test_frequencies_with_the_beam_are_those_of_a_host_that_moves_in_its_plane(built):
    """Elastic modes of the lower half of the band, where shapes are smooth: ten times nearer than to a host held."""
    task, candidates, parts, _ = built
    found = natural(task, candidates)
    free, held = (stuck(parts, sways) for sways in (True, False))
    low, high = task.bare.natural_frequencies[[3, 7]]
    off, apart = (
        max(np.min(np.abs(found / one - 1)) for one in wanted if 0.9 * low < one < high) for wanted in (free, held)
    )
    assert off < 0.1 * apart and off < 1e-3


def test_the_share_of_a_mode_that_one_resonance_holds_is_that_of_the_finite_elements(built):
    """Of all elastic modes of the lower half of the band, joints sliding and sticking."""
    task, candidates, parts, _ = built
    modes = tuple(range(3, 8))
    asked = task._replace(modes=modes)
    found = shares(question(asked, predict(asked, candidates), 0, False))
    wanted = [truth.share(parts, FORCE, mode) for mode in modes]
    assert found[:, 0] == pytest.approx(wanted, abs=0.02) and min(wanted) < 0.9


def test_a_host_held_in_its_plane_is_asked_for(built):
    """As the one that the finite elements hold: the recipe's ``in_plane``."""
    task, candidates, parts, _ = built
    model = place.model_at(task._replace(in_plane="held"), candidates, 0, FORCE)
    system = assemble(model)
    slip = system.contacts.slip
    stiffness = system.stiffness + slip.T @ (slip * system.contacts.stiffness[:, None])
    found = np.sqrt(np.maximum(eigh(stiffness, system.mass, eigvals_only=True), 0)) / (2 * np.pi)
    wanted, high = stuck(parts, False), task.bare.natural_frequencies[7]
    assert max(np.min(np.abs(found / one - 1)) for one in wanted if 100 < one < high) < 1e-3


def test_the_mass_that_moves_is_that_of_the_rigid_body_modes(built):
    """Of the finite elements with their lumps, from shapes alone; none where the structure does not hang freely."""
    task, _, _, host = built
    assert shapes.mass_of(task.bare, task.surface) == pytest.approx(host.mass, rel=1e-3)
    fixed = replace(
        task.bare,
        poles=task.bare.poles[3:],
        shapes=task.bare.shapes[:, 3:],
        participation=task.bare.participation[:, 3:],
    )
    surface = replace(
        task.surface,
        coefficients=task.surface.coefficients[:, 3:],
        covariance=task.surface.covariance[3:],
        noise=task.surface.noise[3:],
    )
    assert shapes.mass_of(fixed, surface) is None
