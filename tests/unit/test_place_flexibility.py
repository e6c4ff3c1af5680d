"""What the modes above the measured ones give way: against finite elements that share no code and have them all."""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from scipy.linalg import eigh

from ema import place, shapes
from ema.data import FrictionLaw, Geometry, ModalModel, Residuals, poles_from
from ema.data.placement import BoltedJoint, Candidates, FrictionBeam
from ema.dof import Dof
from ema.place.flexibility import flexibility, flexibility_std
from ema.shapes import Surface
from ema.simulate.structure import assemble
from tests.bench.blind_hosts import hosts, truth

FORCE, MEASURED = 130.0, 11
"""N, and modes that were measured: eight elastic ones beside the rigid body's."""
HOSTS = range(12)
"""Of the bench, every third a slender one."""


class Built(NamedTuple):
    """A host with its lowest modes, a beam on it, the true parts; sums of what was left out at the joints."""

    bare: ModalModel
    surface: Surface
    points: np.ndarray
    joint: BoltedJoint
    candidates: Candidates
    parts: truth.Parts
    modes: tuple[int, ...]
    deflection: np.ndarray
    slope: np.ndarray


@cache
def build(number: int) -> Built:
    """Exact shapes of the lowest modes; the residual term of the driving point is the sum over all others."""
    case = hosts.case(29, number)
    host = replace(case.host, lumps=())
    omega, damping, vectors = host.modes(np.inf)
    x, y = (np.linspace(0, side, count) for side, count in zip(host.plate.size, (19, 13), strict=True))
    points = np.stack([part.ravel() for part in np.meshgrid(x, y, indexing="ij")], axis=1)
    moved = host.plate.rows(points) @ vectors
    dofs = tuple(Dof(1 + row, "+Z") for row in range(len(points)))
    poles = poles_from(omega[:MEASURED] / (2 * np.pi), damping[:MEASURED])
    values = moved[:, :MEASURED].astype(complex)
    upper = (moved[:, MEASURED:] @ (moved[:1, MEASURED:] / omega[MEASURED:] ** 2).T).astype(complex)
    bare = ModalModel(
        poles,
        values,
        dofs,
        values[:1] / (2j * poles.imag),
        dofs[:1],
        scaling="unit modal mass",
        residuals=Residuals(np.zeros_like(upper), upper),
    )
    surface = shapes.smooth(
        bare, Geometry(np.arange(1, len(points) + 1), np.column_stack([points, np.zeros(len(points))]))
    )
    bar = replace(case.sheet.bar, elements=48)
    spot = np.array([0.5 * host.plate.size[0], 0.4 * host.plate.size[1]])
    joints = spot + 0.5 * bar.spacing * np.array([[-1.0, 0.0], [1.0, 0.0]])
    left = [(host.plate.rows(joints, turn) @ vectors)[:, MEASURED:] / omega[MEASURED:] for turn in (0, 1)]
    joint = replace(case.joint, uneven=((1.0, 1.0), (1.0, 1.0)), exponent=0.0)
    length = float(np.sqrt(12 * np.mean((joint.half_length * np.linspace(-1, 1, truth.SLIDERS)) ** 2)))
    return Built(
        bare,
        surface,
        joints,
        BoltedJoint(FrictionLaw("masing", 0.2, joint.tangential), joint.normal, joint.height, contact_length=length),
        Candidates(
            spot[None],
            np.zeros(1),
            np.zeros(1, int),
            (FrictionBeam(bar.spacing, bar.width, bar.height, overhang=bar.overhang, rotary=True, shear=True),),
        ),
        truth.assembled(host, bar, joint, 0.0, points[0], (*spot, 0.0)),
        case.modes,
        *(np.sum(part**2, axis=1) for part in left),
    )


@pytest.fixture(params=(0, 2, 3, 5))
def built(request: pytest.FixtureRequest) -> Built:
    """Two plates and two slender ones."""
    return build(request.param)


def errors(built: Built, bare: ModalModel, surface: Surface) -> np.ndarray:
    """Relative errors of the frequencies of the target modes with joints that stick."""
    task = place.Task(bare, surface, built.joint, bare.dofs[0], np.array([1.0]), np.array([FORCE]), (0,))
    system = assemble(place.model_at(task, built.candidates, 0, FORCE))
    slip = system.contacts.slip
    stiffness = system.stiffness + slip.T @ (slip * system.contacts.stiffness[:, None])
    found = np.sqrt(np.maximum(eigh(stiffness, system.mass, eigvals_only=True), 0)) / (2 * np.pi)
    wanted, modes = truth.linear(built.parts, FORCE, True)
    wanted = wanted[[int(np.argmax(np.abs(modes[mode]))) for mode in built.modes]]
    return np.array([found[np.argmin(np.abs(found - one))] / one - 1 for one in wanted])


def test_frequencies_with_a_beam_are_nearer_than_without_the_modes_above() -> None:
    """Without them every frequency is too high; with them, the larger of two errors is a half or less in most hosts."""
    ratios = []
    for number in HOSTS:
        one = build(number)
        without = errors(one, replace(one.bare, residuals=None), one.surface)
        assert without.min() > 0
        ratios.append(float(np.abs(errors(one, one.bare, one.surface)).max() / without.max()))
    assert max(ratios) < 1 and np.median(ratios) < 0.5


def test_a_plate_that_continues_the_modes_is_completed() -> None:
    """Its polynomials have no waves as short as a contact."""
    completed = 0
    for number in HOSTS[:6]:
        one = build(number)
        plate, surface, _ = shapes.with_plate(one.bare, one.surface)
        if len(plate.poles) == len(one.bare.poles):
            continue  # no plate has these modes
        completed += 1
        added = np.argsort(np.abs(plate.poles))[MEASURED:]
        has = np.sum((surface.values(one.points, 1)[:, added] / np.abs(plate.poles[added])) ** 2, axis=1)
        rest = flexibility(plate, surface, one.points, 0.0, one.joint.contact_length)
        assert rest is not None
        assert np.all(np.abs(np.log((has + rest.slope) / one.slope)) < np.abs(np.log(has / one.slope)))
    assert completed >= 4


def test_the_estimate_is_as_certain_as_it_says() -> None:
    """Without bias and within the stated standard deviation, of deflection and of slope."""
    ratios = []
    for number in HOSTS:
        one = build(number)
        found = flexibility(one.bare, one.surface, one.points, 0.0, one.joint.contact_length)
        assert found is not None
        assert flexibility_std(one.bare, one.surface) == pytest.approx(np.sqrt(1 / 3))  # 8/(3 K), 8 elastic modes
        ratios.append(np.log([found.deflection[0] / one.deflection[0], found.slope[0] / one.slope[0]]))
    for own in np.transpose(ratios):
        assert abs(np.mean(own)) < 0.2 and np.sqrt(np.mean(own**2)) < np.sqrt(1 / 3)


def test_where_the_driving_point_shows_no_modes_above_there_are_none(built: Built) -> None:
    """A structure that has the measured modes and no others."""
    nothing = np.zeros((len(built.bare.dofs), 1), complex)
    silent = Residuals(nothing, nothing)
    for bare in (replace(built.bare, residuals=silent), replace(built.bare, residuals=None)):
        assert flexibility(bare, built.surface, built.points, 0.0, 0.01) is None


def test_half_the_flexibility_above_the_band_is_half_the_estimate(built: Built) -> None:
    """Whether it is an upper residual term or a pole above the band, with a residue for every DOF."""
    residuals, far = built.bare.residuals, 3 * np.abs(built.bare.poles).max()
    assert residuals is not None
    half = replace(built.bare, residuals=replace(residuals, upper=0.5 * residuals.upper))
    # phi^2/(2 j w) at the pole j w is phi^2/w^2 at rest
    residues = (0.5 * residuals.upper * far / 2j)[None]
    pole = replace(
        built.bare, residuals=Residuals(residuals.lower, 0 * residuals.upper, np.array([1j * far]), residues)
    )
    whole, *others = (flexibility(one, built.surface, built.points, 0.0, 0.01) for one in (built.bare, half, pole))
    for one in others:
        np.testing.assert_allclose(one.deflection, 0.5 * whole.deflection)
        np.testing.assert_allclose(one.slope, 0.5 * whole.slope)
