"""What a placed beam will do at chosen conditions, with 95 % bands, told before it is bolted on."""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from ema.data import Finding, ModalMap, Provenance
from ema.data.forecast import Forecast, ForecastCheck
from ema.data.placement import Candidates
from ema.errors import InputError
from ema.place.intervals import drawn
from ema.place.shortlist import Question, question, verify_all
from ema.place.task import Task, only, predicted
from ema.progress import Progress, advance, silent

Method = Literal["measured", "frozen"]
_ENOUGH = 0.8
"""Share of the draws that have to have a steady state for a band to be told."""
_NEAR = 0.05


def forecast(
    task: Task,
    candidates: Candidates,
    place: int,
    force_levels: Sequence[float] | Float[np.ndarray, "level"],
    normal_forces: Sequence[float] | Float[np.ndarray, "force"],
    draws: int = 60,
    seed: int = 0,
    method: Method = "measured",
    executor: Executor | None = None,
    progress: Progress = silent,
) -> Forecast:
    """Frequency and damping of the target modes with the beam at one place, all modes together, with 95 % bands.

    Every draw of what is uncertain (smoothed shapes, shape at the exciter, mu and k_T of all joints and their scatter
    from joint to joint) is computed by harmonic balance of the full model. The band of the damping is that of its
    logarithm. Errors of the joint law itself, and what a new assembly changes beyond the stated scatter, are not
    contained.

    Parameters
    ----------
    place : row in ``candidates``.
    force_levels, normal_forces : conditions in N; F_N per joint.
    draws : samples for the bands, at least 10.
    method : "measured" tells what a one-mode fit of a stepped sine about the resonance will read, which at a friction
        peak differs from "frozen", the equivalent damping of the steady state at resonance.
    executor : where they are computed; here and now by default.

    Raises
    ------
    InputError : fewer than 10 draws, no such place, and what ``ema.place.predict`` raises.
    """
    from scipy.stats import t as student

    if draws < 10:
        raise InputError("too few draws for a band", where=f"place {place}", got=draws, expected="10 or more")
    if not 0 <= place < len(candidates):
        raise InputError("no such place", where="forecast", got=place, expected=f"0 to {len(candidates) - 1}")
    here = only(candidates, [place])
    asked = task._replace(
        force_levels=np.asarray(force_levels, dtype=np.float64), normal_forces=np.asarray(normal_forces, np.float64)
    )
    rng = np.random.default_rng(seed)
    tasks = [asked, *drawn(asked, draws, rng)]
    questions = [question(one, predicted(one, here), 0, method == "measured") for one in tasks]
    questions[1:] = [_uneven(one, task.joint.scatter, rng) for one in questions[1:]]
    values = np.empty((len(tasks), len(task.modes), 2, len(asked.force_levels), len(asked.normal_forces)))
    for count, (number, found) in enumerate(verify_all(questions, executor), 1):
        values[number] = found[:, :2]
        advance(progress, "bands of the forecast", count, len(tasks))
    middle, spread = values[0], values[1:]
    known = np.mean(np.isfinite(spread), axis=0) >= _ENOUGH
    reach = float(student.ppf(0.975, draws - 1)) * np.sqrt(1 + 1 / draws)
    width = np.where(known, reach * np.nanstd(spread, axis=0, ddof=1), np.nan)[:, 0]
    scale = np.where(known, reach * np.nanstd(np.log(spread), axis=0, ddof=1), np.nan)[:, 1]
    beam = here.catalogue[int(here.beams[0])]
    holes = int(np.sum(~known[:, 1]))
    findings = (
        ()
        if not holes
        else (
            Finding(
                "warning",
                "no-band",
                f"place {place}",
                f"{holes} of {known[:, 1].size} conditions have no single resonance in a fifth of the draws.",
                float(holes),
                0.0,
                "Their bands are left open.",
            ),
        )
    )
    bare = task.bare.poles[list(task.modes)]
    return Forecast(
        (float(here.centres[0, 0]), float(here.centres[0, 1])),
        float(here.angles[0]),
        beam.name,
        tuple(mode + 1 for mode in task.modes),
        np.abs(bare) / (2 * np.pi),
        -bare.real / np.abs(bare),
        asked.force_levels,
        asked.normal_forces,
        middle[:, 0],
        middle[:, 0] - width,
        middle[:, 0] + width,
        middle[:, 1],
        middle[:, 1] * np.exp(-scale),
        middle[:, 1] * np.exp(scale),
        draws,
        method,
        findings,
        Provenance(steps=("place.forecast",), options=(("draws", str(draws)), ("seed", str(seed)))),
    )


def _uneven(asked: Question, scatter: float, rng: np.random.Generator) -> Question:
    """The question with mu and k_T of every joint drawn on their own."""
    if scatter == 0:
        return asked
    joints = []
    for joint in asked.model.joints:
        mu, stiffness = np.exp(scatter * rng.standard_normal(2))
        law = replace(
            joint.law,
            friction_coefficient=float(mu * joint.law.friction_coefficient),
            contact_stiffness=float(stiffness * joint.law.contact_stiffness),
            stiffness_cap=float(stiffness * joint.law.stiffness_cap),
        )
        joints.append(replace(joint, law=law))
    return asked._replace(model=replace(asked.model, joints=tuple(joints)))


def check(told: Forecast, charts: Sequence[ModalMap]) -> ForecastCheck:
    """Hold a forecast against measured maps: each goes to the mode whose bare frequency is nearest.

    Raises
    ------
    InputError : a map of no target mode, two maps of one mode, or none of the conditions of the forecast in a map.
    """
    measured = np.full((2, *told.damping.shape), np.nan)
    used: dict[int, str] = {}
    for chart in charts:
        where = chart.name or "map"
        middle = float(np.nanmedian(chart.frequency))
        mode = int(np.argmin(np.abs(told.bare_frequencies - middle)))
        if abs(told.bare_frequencies[mode] / middle - 1) > 2 * _NEAR:
            raise InputError(
                "the map is about no mode of the forecast",
                where=where,
                got=f"{middle:.1f} Hz",
                expected=", ".join(f"{one:.1f} Hz" for one in told.bare_frequencies),
            )
        if mode in used:
            raise InputError("two maps of one mode", where=where, got=used[mode], expected="one map per mode")
        used[mode] = where
        levels = _rows(told.force_levels, chart.force_levels)
        forces = _rows(told.normal_forces, chart.normal_forces)
        pairs = [(i, j, a, b) for i, a in enumerate(levels) for j, b in enumerate(forces) if a >= 0 and b >= 0]
        if not pairs:
            raise InputError(
                "the map holds none of the conditions of the forecast",
                where=where,
                got=f"F_E {chart.force_levels.tolist()} N, F_N {chart.normal_forces.tolist()} N",
                expected=f"F_E {told.force_levels.tolist()} N, F_N {told.normal_forces.tolist()} N",
            )
        for i, j, a, b in pairs:
            measured[:, mode, i, j] = chart.frequency[a, b], chart.damping[a, b]
    return ForecastCheck(told, measured[0], measured[1], tuple(used[mode] for mode in sorted(used)))


def _rows(wanted: np.ndarray, known: np.ndarray) -> list[int]:
    """Row of ``known`` within 5 % of each wanted value, -1 where there is none."""
    result = []
    for value in wanted:
        row = int(np.argmin(np.abs(known - value)))
        result.append(row if abs(known[row] - value) <= _NEAR * value else -1)
    return result
