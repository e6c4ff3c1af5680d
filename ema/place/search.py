"""Ranking of places: all by the predictor, the best few with intervals and what speaks against them."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ema.data import Finding, ModalModel
from ema.data.placement import BoltedJoint, Candidates, Place, Prediction, Ranking
from ema.dof import Dof
from ema.place.objective import Objective, best_forces, scores
from ema.place.predictor import beam_matrices, contact_stiffness, motions, normal_stiffness, predict
from ema.progress import Progress, advance, silent
from ema.shapes import Surface

NEAR = 0.3
"""A resonance of the beam or of its contact within this part of a target frequency is flagged."""
POINTS_PER_HALF_WAVE = 4.0


class Task(NamedTuple):
    """What a placement is asked: the measured structure, the joint, and the range of forces."""

    bare: ModalModel
    surface: Surface
    joint: BoltedJoint
    at: Dof | str
    force_levels: Float[np.ndarray, "level"]
    normal_forces: Float[np.ndarray, "force"]
    modes: tuple[int, ...]


def rank(
    task: Task,
    candidates: Candidates,
    objective: Objective | None = None,
    keep: int = 10,
    draws: int = 200,
    seed: int = 0,
    progress: Progress = silent,
) -> Ranking:
    """The best places for a friction beam, with recommended normal forces and 95 % intervals.

    The intervals carry the uncertainty of the smoothed shapes and of mu and k_T (``BoltedJoint``); they do not carry
    what the one-mode predictor leaves out.

    Parameters
    ----------
    keep : number of places to return.
    draws : samples for the intervals; 0 for none.

    Raises
    ------
    InputError : see ``ema.place.predict``; nothing was found at any place.
    """
    wanted = Objective() if objective is None else objective
    prediction = _predict(task, candidates)
    advance(progress, "places", len(candidates), len(candidates))
    by_force = scores(prediction, wanted)
    total = by_force.max(axis=1)
    order = np.argsort(-total, kind="stable")[:keep]
    order = order[np.isfinite(total[order])]
    samples = _draws(task, candidates, order, draws, np.random.default_rng(seed), progress) if draws else None
    places = tuple(
        _place(task, prediction, wanted, int(c), int(by_force[c].argmax()), None if samples is None else samples[:, n])
        for n, c in enumerate(order)
    )
    findings = (*_about_points(task), *_about_holes(prediction))
    return Ranking(str(wanted), prediction, total, places, findings)


def _predict(task: Task, candidates: Candidates) -> Prediction:
    return predict(
        task.bare, task.surface, candidates, task.joint, task.at, task.force_levels, task.normal_forces, task.modes
    )


def _only(candidates: Candidates, rows: Sequence[int] | np.ndarray) -> Candidates:
    return replace(
        candidates, centres=candidates.centres[rows], angles=candidates.angles[rows], beams=candidates.beams[rows]
    )


def _draws(
    task: Task, candidates: Candidates, order: np.ndarray, draws: int, rng: np.random.Generator, progress: Progress
) -> Float[np.ndarray, "draw place mode level force"]:
    """Damping of the shortlist for samples of the shapes and of the joint."""
    few = _only(candidates, order)
    surface, law = task.surface, task.joint.law
    roots = []
    for covariance in surface.covariance:
        size, turned = np.linalg.eigh(covariance)
        roots.append(turned * np.sqrt(np.maximum(size, 0)))
    results = []
    for number in range(draws):
        shift = np.stack([root @ rng.standard_normal(len(root)) for root in roots], axis=1)
        mu = law.friction_coefficient * np.exp(task.joint.friction_std * rng.standard_normal())
        factor = np.exp(task.joint.stiffness_std * rng.standard_normal())
        drawn = replace(
            law, friction_coefficient=mu, contact_stiffness=law.contact_stiffness * factor,
            stiffness_cap=law.stiffness_cap * factor,
        )  # fmt: skip
        sample = task._replace(
            surface=replace(surface, coefficients=surface.coefficients + shift), joint=replace(task.joint, law=drawn)
        )
        results.append(_predict(sample, few).damping)
        advance(progress, "intervals", number + 1, draws)
    return np.stack(results)


def _place(
    task: Task, prediction: Prediction, objective: Objective, candidate: int, force: int,
    samples: Float[np.ndarray, "draw mode level force"] | None,
) -> Place:  # fmt: skip
    candidates = prediction.candidates
    damping = prediction.damping[candidate, :, :, force]
    low, high, score_low, score_high = np.full_like(damping, np.nan), np.full_like(damping, np.nan), np.nan, np.nan
    if samples is not None:
        low, high = np.nanquantile(samples[..., force], [0.025, 0.975], axis=0)
        judged = scores(prediction, objective, samples)[:, force]
        score_low, score_high = (float(v) for v in np.quantile(judged[np.isfinite(judged)], [0.025, 0.975]))
    kind = int(candidates.beams[candidate])
    beam = candidates.catalogue[kind]
    mass, stiffness = _shifts(task, candidates, candidate, float(prediction.normal_forces[force]))
    return Place(
        candidate, (float(candidates.centres[candidate, 0]), float(candidates.centres[candidate, 1])),
        float(candidates.angles[candidate]), beam.name or f"beam {kind + 1}",
        float(scores(prediction, objective, prediction.damping[candidate][None])[0, force]), score_low, score_high,
        float(prediction.normal_forces[force]),
        prediction.normal_forces[best_forces(prediction, objective, candidate)],
        prediction.frequency[candidate, :, :, force], damping, low, high, mass, stiffness,
        _flags(task, prediction, candidate, force),
    )  # fmt: skip


def _shifts(
    task: Task, candidates: Candidates, candidate: int, normal_force: float
) -> tuple[Float[np.ndarray, "mode"], Float[np.ndarray, "mode"]]:
    """First-order frequency shift in Hz by the mass of the beam, and by its joints' stiffness with all stuck."""
    one = _only(candidates, [candidate])
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


def _flags(task: Task, prediction: Prediction, candidate: int, force: int) -> tuple[Finding, ...]:
    """Resonances near a target mode, joints that never slide or always do, places beyond the measured points."""
    from scipy.linalg import eigh

    candidates = prediction.candidates
    beam = candidates.catalogue[int(candidates.beams[candidate])]
    normal = prediction.normal_forces[force : force + 1]
    mass, stiffness, _, rows = beam_matrices(beam)
    where = f"place {candidate}"
    found = []
    k_t = float(contact_stiffness(task.joint, normal)[0])
    springs = float(normal_stiffness(task.joint, normal)[0]) * rows.T @ rows
    sliding = np.sqrt(np.maximum(eigh(stiffness + springs, mass, eigvals_only=True), 0)) / (2 * np.pi)
    contact = float(np.sqrt(beam.joints * k_t / beam.mass) / (2 * np.pi))
    for m, mode in enumerate(prediction.modes):
        target = float(prediction.bare_frequencies[m])
        for what, code, frequencies in (
            ("the contact springs under the beam's mass", "contact-resonance", np.array([contact])),
            ("the beam on its joints", "beam-resonance", sliding[sliding > 1.0]),
        ):
            nearest = float(frequencies[np.argmin(np.abs(frequencies - target))])
            if abs(nearest - target) <= NEAR * target:
                found.append(Finding(
                    "warning", code, where,
                    f"{what} resonate at {nearest:.0f} Hz, within 30 % of mode {mode + 1} at {target:.0f} Hz.",
                    nearest, target, "Two peaks or an absorber effect: check with all modes together.",
                ))  # fmt: skip
        if np.all(prediction.slip[candidate, m, :, force] < 1):
            found.append(Finding(
                "info", "no-slip", where, f"mode {mode + 1}: no joint slides at any force level.", None, None,
                "The damping comes from the contact's loss factors alone; press less.",
            ))  # fmt: skip
    return tuple(found)


def _about_points(task: Task) -> tuple[Finding, ...]:
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
            found.append(Finding(
                "warning", "few-points", f"mode {mode + 1}",
                f"{points:.1f} measured points per half wave of {half_wave:.2g} m.", points, POINTS_PER_HALF_WAVE,
                "Measure a finer grid: slopes and curvatures of this mode are uncertain.",
            ))  # fmt: skip
    return tuple(found)


def _about_holes(prediction: Prediction) -> tuple[Finding, ...]:
    share = float(np.mean(np.isnan(prediction.damping)))
    if share == 0:
        return ()
    return (Finding("warning", "holes", "placement", f"{share:.1%} of the points have no single resonance.", share, 0.0,
                    "They count as unsuitable; check such places with all modes together."),)  # fmt: skip
