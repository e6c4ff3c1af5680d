"""What speaks for and against a place: shifts of frequency, resonances nearby, joints that never slide, few points."""

import numpy as np
from jaxtyping import Float

from ema.data import Finding
from ema.data.placement import Candidates, Prediction
from ema.place.predictor import beam_matrices, contact_stiffness, motions, normal_stiffness
from ema.place.task import Task, only

NEAR = 0.3
"""A resonance of the beam or of its contact within this part of a target frequency is flagged."""
POINTS_PER_HALF_WAVE = 4.0


def shifts(
    task: Task, candidates: Candidates, candidate: int, normal_force: float
) -> tuple[Float[np.ndarray, "mode"], Float[np.ndarray, "mode"]]:
    """First-order frequency shift in Hz by the mass of the beam, and by its joints' stiffness with all stuck."""
    one = only(candidates, [candidate])
    beam = candidates.catalogue[int(candidates.beams[candidate])]
    phi, lever = motions(task.surface, one, task.joint, task.modes)
    mass, stiffness, tangential, normal = beam_matrices(beam)
    force = np.array([normal_force])
    k_t, k_n = contact_stiffness(task.joint, force)[0], normal_stiffness(task.joint, force)[0]
    omega = np.abs(task.bare.poles[list(task.modes)])
    rows = np.concatenate([tangential, normal])
    springs = np.diag(np.concatenate([np.full(len(tangential), k_t), np.full(len(normal), k_n)]))
    by_mass, by_stiffness = np.zeros(len(omega)), np.zeros(len(omega))
    for m, w in enumerate(omega):
        moved = np.concatenate([-lever[0, :, m], phi[0, :, m]])
        x = np.linalg.solve(stiffness + rows.T @ springs @ rows - w**2 * mass, rows.T @ springs @ moved)
        apart = rows @ x - moved
        elastic = float(x @ stiffness @ x + apart @ springs @ apart)
        by_mass[m] = -w * float(x @ mass @ x) / 2 / (2 * np.pi)
        by_stiffness[m] = elastic / (2 * w) / (2 * np.pi)
    return by_mass, by_stiffness


def flags(task: Task, prediction: Prediction, candidate: int, force: int) -> tuple[Finding, ...]:
    """Resonances near a target mode, and joints that never slide, for one of the ranked places of ``prediction``."""
    from scipy.linalg import eigh

    candidates = prediction.candidates
    beam = candidates.catalogue[int(candidates.beams[candidate])]
    normal = prediction.normal_forces[force : force + 1]
    mass, stiffness, _, rows = beam_matrices(beam)
    where = f"rank {candidate + 1}"
    found = []
    k_t = float(contact_stiffness(task.joint, normal)[0])
    springs = float(normal_stiffness(task.joint, normal)[0]) * rows.T @ rows
    sliding = np.sqrt(np.maximum(eigh(stiffness + springs, mass, eigvals_only=True), 0)) / (2 * np.pi)
    contact = float(np.sqrt(beam.joints * k_t / beam.mass) / (2 * np.pi))
    for m, mode in enumerate(prediction.modes):
        target = float(prediction.bare_frequencies[m])
        for what, code, frequencies in (
            ("the contact springs under the beam's mass", "contact-resonance", np.array([contact])),
            ("the beam and its joints", "beam-resonance", sliding[sliding > 1.0]),
        ):
            nearest = float(frequencies[np.argmin(np.abs(frequencies - target))])
            if abs(nearest - target) <= NEAR * target:
                found.append(
                    Finding(
                        "warning",
                        code,
                        where,
                        f"{what} have a resonance at {nearest:.0f} Hz, within 30 % of mode {mode + 1} at "
                        f"{target:.0f} Hz.",
                        nearest,
                        target,
                        "Two peaks or an absorber effect: check with all modes together.",
                    )
                )
        if np.all(prediction.slip[candidate, m, :, force] < 1):
            found.append(
                Finding(
                    "info",
                    "no-slip",
                    where,
                    f"mode {mode + 1}: no joint slides at any force level.",
                    None,
                    None,
                    "The damping comes from the contact's loss factors alone; press less.",
                )
            )
    return tuple(found)


def about_points(task: Task) -> tuple[Finding, ...]:
    """Whether every target mode has enough points per half wave, told by its curvature energy."""
    surface = task.surface
    sides = surface.extent[:, 1] - surface.extent[:, 0]
    spacing = np.sqrt(sides.prod() / len(surface.points))
    grid = np.stack([p.ravel() for p in np.meshgrid(*(np.linspace(a, b, 15) for a, b in surface.extent))], axis=1)
    value, slope = surface.values(grid), [surface.values(grid, 1, angle) for angle in (0.0, np.pi / 2)]
    found = []
    for mode in task.modes:
        height = np.sqrt(np.mean(value[:, mode] ** 2))
        steepest = np.sqrt(max(float(np.mean(part[:, mode] ** 2)) for part in slope))
        half_wave = np.pi * height / max(steepest, 1e-300)
        points = float(half_wave / spacing)
        if points < POINTS_PER_HALF_WAVE:
            found.append(
                Finding(
                    "warning",
                    "few-points",
                    f"mode {mode + 1}",
                    f"{points:.1f} measured points per half wave of {half_wave:.2g} m.",
                    points,
                    POINTS_PER_HALF_WAVE,
                    "Measure a finer grid: slopes and curvatures of this mode are uncertain.",
                )
            )
    return tuple(found)


def about_holes(prediction: Prediction) -> tuple[Finding, ...]:
    """Points of the prediction without a resonance."""
    share = float(np.mean(np.isnan(prediction.damping)))
    if share == 0:
        return ()
    return (
        Finding(
            "warning",
            "holes",
            "placement",
            f"{share:.1%} of the points have no single resonance.",
            share,
            0.0,
            "They count as unsuitable; check such places with all modes together.",
        ),
    )
