"""What speaks for and against a place: shifts of frequency, resonances nearby, joints that never slide, few points."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ema.data import Finding
from ema.data.placement import Candidates, Prediction
from ema.place.candidates import ROUNDING
from ema.place.predictor import beam_matrices, contact_stiffness, motions, normal_stiffness
from ema.place.task import Task, only

NEAR = 0.3
"""A second resonance within this part of the first one's frequency is flagged; farther ones are peaks of their own."""
SECOND = 0.1
"""Share of a mode in a second resonance from which on it is flagged: with equal damping, a peak of a ninth of the first
one's height, which a mode shape or a fit of one mode no longer overlooks."""
POINTS_PER_HALF_WAVE = 4.0


class _Coupled(NamedTuple):
    """The beam at one place, its joints, and the motion of the structure under them."""

    mass: Float[np.ndarray, "n n"]
    stiffness: Float[np.ndarray, "n n"]
    rows: Float[np.ndarray, "spring n"]
    springs: Float[np.ndarray, "spring"]
    motion: Float[np.ndarray, "spring mode"]

    @classmethod
    def at(cls, task: Task, candidates: Candidates, candidate: int, normal_force: float) -> "_Coupled":
        """Springs and motions: those along the interface of all joints, then those across it."""
        phi, lever = motions(task.surface, only(candidates, [candidate]), task.joint, task.modes)
        beam = candidates.catalogue[int(candidates.beams[candidate])]
        mass, stiffness, tangential, normal = beam_matrices(beam)
        force = np.array([normal_force])
        k_t, k_n = contact_stiffness(task.joint, force)[0], normal_stiffness(task.joint, force)[0]
        springs = np.repeat([k_t, k_n], [len(tangential), len(normal)])
        return cls(mass, stiffness, np.concatenate([tangential, normal]), springs, np.concatenate([-lever[0], phi[0]]))


def shifts(
    task: Task, candidates: Candidates, candidate: int, normal_force: float
) -> tuple[Float[np.ndarray, "mode"], Float[np.ndarray, "mode"]]:
    """First-order frequency shift in Hz by the mass of the beam, and by its joints' stiffness with all stuck."""
    mass, stiffness, rows, springs, motion = _Coupled.at(task, candidates, candidate, normal_force)
    omega = np.abs(task.bare.poles[list(task.modes)])
    weighted = rows.T * springs
    by_mass, by_stiffness = np.zeros(len(omega)), np.zeros(len(omega))
    for m, w in enumerate(omega):
        moved = motion[:, m]
        x = np.linalg.solve(stiffness + weighted @ rows - w**2 * mass, weighted @ moved)
        apart = rows @ x - moved
        elastic = float(x @ stiffness @ x + apart @ (springs * apart))
        by_mass[m] = -w * float(x @ mass @ x) / 2 / (2 * np.pi)
        by_stiffness[m] = elastic / (2 * w) / (2 * np.pi)
    return by_mass, by_stiffness


def _resonances(coupled: _Coupled, mode: int, omega: float, stuck: bool) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz] of one mode of the structure with the beam on it, and its share in each of them.

    The mode of unit modal mass has the coordinate q, the beam x: with the springs K between R x and u q, the kinetic
    energy is (q'^2 + x' M x') / 2 and the potential one (w^2 q^2 + x K_b x + (R x - u q) K (R x - u q)) / 2. Of
    mass-normalised shapes the squares of q add up to 1; each is the modal constant of a resonance in the receptance of
    q, the height of its peak times twice its damping ratio and w^2.
    """
    from scipy.linalg import block_diag

    from ema.simulate.reduction import natural_modes

    springs = coupled.springs.copy()
    if not stuck:
        springs[: len(springs) // 2] = 0.0
    apart = np.column_stack([-coupled.motion[:, mode], coupled.rows])
    stiffness = block_diag([[omega**2]], coupled.stiffness) + (apart.T * springs) @ apart
    squares, vectors = natural_modes(stiffness, block_diag([[1.0]], coupled.mass))
    return np.sqrt(np.maximum(squares, 0)) / (2 * np.pi), vectors[0] ** 2


def flags(task: Task, prediction: Prediction, candidate: int, force: int) -> tuple[Finding, ...]:
    """What speaks against one of the ranked places of ``prediction``, or is to be known about it.

    Modes that become two resonances, joints that never slide, and a beam that sticks out.
    """
    coupled = _Coupled.at(task, prediction.candidates, candidate, float(prediction.normal_forces[force]))
    where = f"rank {candidate + 1}"
    findings = list(about_overhang(task, prediction.candidates, candidate))
    for m, mode in enumerate(prediction.modes):
        omega = float(np.abs(task.bare.poles[mode]))
        for stuck in (True, False):
            frequencies, shares = _resonances(coupled, m, omega, stuck)
            near = np.abs(frequencies / frequencies[shares.argmax()] - 1) <= NEAR
            first, second = np.argsort(np.where(near, shares, 0))[:-3:-1]
            if shares[second] * near[second] >= SECOND:
                state = "stick" if stuck else "slide"
                message = (
                    f"where all joints {state}, mode {mode + 1} is two resonances: {frequencies[first]:.0f} and "
                    f"{frequencies[second]:.0f} Hz, the second with {shares[second]:.0%} of its motion."
                )
                advice = "Two peaks or an absorber effect: check with all modes together."
                value = float(shares[second])
                findings.append(Finding("warning", "second-resonance", where, message, value, SECOND, advice))
                break
        if np.all(prediction.slip[candidate, m, :, force] < 1):
            findings.append(
                Finding.of(
                    "info",
                    "no-slip",
                    where,
                    "mode {mode}: no joint slides at any force level.",
                    advice="The damping comes from the contact's loss factors alone; press less.",
                    mode=mode + 1,
                )
            )
    return tuple(findings)


def about_overhang(task: Task, candidates: Candidates, candidate: int) -> tuple[Finding, ...]:
    """Whether an end of the beam lies beyond the measured rectangle."""
    angle = float(candidates.angles[candidate])
    half = 0.5 * candidates.catalogue[int(candidates.beams[candidate])].length
    ends = candidates.centres[candidate] + np.outer([-half, half], [np.cos(angle), np.sin(angle)])
    low, high = task.surface.extent.T
    beyond = float(np.maximum(low - ends, ends - high).max())
    if beyond <= ROUNDING:
        return ()
    return (
        Finding.of(
            "info",
            "beam-sticks-out",
            f"rank {candidate + 1}",
            "the beam reaches {beyond} m beyond the measured points.",
            beyond,
            0.0,
            advice="Check that it has room there; a margin as long as its overhang keeps it on the measured surface.",
            beyond=f"{beyond:.3g}",
        ),
    )


def about_points(task: Task) -> tuple[Finding, ...]:
    """Whether every target mode has enough points per half wave, judged by its curvature energy."""
    surface = task.surface
    sides = surface.extent[:, 1] - surface.extent[:, 0]
    spacing = np.sqrt(sides.prod() / len(surface.points))
    grid = np.stack([p.ravel() for p in np.meshgrid(*(np.linspace(a, b, 15) for a, b in surface.extent))], axis=1)
    value, slope = surface.values(grid), [surface.values(grid, 1, angle) for angle in (0.0, np.pi / 2)]
    findings = []
    for mode in task.modes:
        height = np.sqrt(np.mean(value[:, mode] ** 2))
        steepest = np.sqrt(max(float(np.mean(part[:, mode] ** 2)) for part in slope))
        half_wave = np.pi * height / max(steepest, 1e-300)
        points = float(half_wave / spacing)
        if points < POINTS_PER_HALF_WAVE:
            findings.append(
                Finding.of(
                    "warning",
                    "few-points",
                    f"mode {mode + 1}",
                    "{count} measured points per half wave of {half_wave} m.",
                    points,
                    POINTS_PER_HALF_WAVE,
                    advice="Measure a finer grid: slopes and curvatures of this mode are uncertain.",
                    count=f"{points:.1f}",
                    half_wave=f"{half_wave:.2g}",
                )
            )
    return tuple(findings)


def about_holes(prediction: Prediction) -> tuple[Finding, ...]:
    """Points of the prediction without a resonance."""
    share = float(np.mean(np.isnan(prediction.damping)))
    if share == 0:
        return ()
    return (
        Finding.of(
            "warning",
            "holes",
            "placement",
            "{share} of the points have no single resonance.",
            share,
            0.0,
            advice="They count as unsuitable; check such places with all modes together.",
            share=f"{share:.1%}",
        ),
    )
