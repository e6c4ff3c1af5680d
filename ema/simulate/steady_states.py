"""Steady states over frequency at one force level: settings, the sweep, and what is said about it."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, TypedDict, Unpack
from warnings import warn

import numpy as np
from jaxtyping import Float

from ema.data import BeamModel, Finding, HarmonicResponse
from ema.dof import Dof
from ema.errors import InputError
from ema.progress import Progress, advance, silent
from ema.simulate.checks import is_number, positive
from ema.simulate.harmonic import BUDGET, Branch, Condensed, _Point, condense
from ema.simulate.turning_points import SMOOTH, hidden_turns, unexplained
from ema.simulate.verification import verified

_NAMED = 5
"""Jumps between branches whose frequencies a finding names."""


@dataclass(frozen=True)
class HarmonicBalance:
    """How steady states are computed.

    Parameters
    ----------
    tolerance : float, default 0.005
        Relative error of the first harmonic of the slips that is aimed at; harmonics are added until it is met.
    modes : int, optional
        Number of modes kept besides the static corrections; all by default.
    harmonics : int, optional
        Highest harmonic kept, instead of as many as the tolerance asks for.
    verify : bool, default False
        Let the time solver go on from every solution until it settles; the error is the distance from there. A state
        that it leaves is unstable, which a finding says, and has an error of 1.
    budget : int, default 4 000 000
        Unknowns and 200 more, summed over the evaluations of the contact forces, that the search at one frequency may
        take. Where it ends the search, the best solution is returned with its error, and the finding ``budget-spent``
        says so. The default is twice what the slowest of 379 cold starts took, which was 40 s on a busy core.

    Examples
    --------
    >>> HarmonicBalance(harmonics=5).tolerance
    0.005
    """

    tolerance: float = 5e-3
    modes: int | None = None
    harmonics: int | None = None
    verify: bool = False
    budget: int = BUDGET


class _Former(TypedDict, total=False):
    """The fields of ``HarmonicBalance`` as keywords."""

    tolerance: float
    modes: int | None
    harmonics: int | None
    verify: bool
    budget: int


def frf(
    model: BeamModel,
    frequencies: Float[np.ndarray, "freq"],
    force: float,
    at: Dof | str,
    outputs: Sequence[Dof | str],
    settings: HarmonicBalance | float | None = None,
    *,
    normal_forces: Float[np.ndarray, "joint phase"] | None = None,
    progress: Progress = silent,
    **former: Unpack[_Former],
) -> HarmonicResponse:
    """Compute steady states over frequency at one force level, each with its error estimate.

    Parameters
    ----------
    model : BeamModel
        The model.
    frequencies : array of shape (freq,)
        Frequencies [Hz].
    force : float
        Amplitude of the force [N].
    at : Dof or str
        DOF of the force.
    outputs : sequence of Dof or str
        DOFs whose amplitudes are computed.
    settings : HarmonicBalance, optional
        Tolerance, modes, harmonics, verification and budget.
    normal_forces : array of shape (joint, phase), optional
        Normal forces of every joint [N] at even phases of a period of the exciting force, which begins where it is
        largest, linear in between; those of the model by default. k_T stays that of the model.
    progress : Progress, optional
        Called during the computation.
    **former
        Fields of ``HarmonicBalance`` as keywords, and a number as ``settings`` for its tolerance: accepted for one
        release more, with a ``DeprecationWarning``.

    Returns
    -------
    HarmonicResponse
        Steady states.

    Raises
    ------
    InputError
        If the force, the budget or a frequency is not positive, or a normal force is negative.

    Examples
    --------
    >>> from ema.examples import beam_model
    >>> response = frf(beam_model(), np.array([60.0, 70.0]), force=1.0, at="1:+X", outputs=["1:+X"])
    >>> response.converged
    array([ True,  True])
    """
    chosen = _settings(settings, former)
    positive(model.name, budget=chosen.budget)
    condensed = condense(model, force, at, outputs, chosen.tolerance, chosen.modes, normal_forces)
    condensed.budget = chosen.budget
    condensed.keep(chosen.harmonics)
    frequencies = np.asarray(frequencies)
    if frequencies.ndim != 1 or not frequencies.size or not all(is_number(one) and one > 0 for one in frequencies):
        raise InputError(
            "not frequencies of excitation",
            where=model.name,
            got=f"{len(frequencies)} values" if frequencies.ndim == 1 else f"an array of shape {frequencies.shape}",
            expected="finite, above 0 Hz, one after the other",
        )
    points: list[_Point | None] = []
    unstable: list[float] = []
    ended: list[tuple[float, int, _Point | None]] = []
    jumps: list[tuple[float, float]] = []
    folds: list[tuple[float, float, list[float]]] = []
    branch, before = Branch(condensed.tolerance), None
    for number, frequency in enumerate(frequencies):
        advance(progress, "frequencies", number, len(frequencies))
        point = condensed.solve(float(frequency), branch.start(float(frequency)))
        branch.add(point)
        if condensed.left < 0:
            ended.append((float(frequency), chosen.budget - condensed.left, point))
        if point is not None:
            apart = before is not None and before.omega != point.omega
            if before is not None and apart and unexplained(condensed, before, point) > SMOOTH:
                pair = before.omega / (2 * np.pi), float(frequency)
                if not condensed.joins(point, before):
                    jumps.append(pair)
                elif turned := hidden_turns(condensed, before, point):
                    folds.append((*pair, turned))
            before = point
        if chosen.verify and point is not None:
            seen = verified(condensed, point)
            point = replace(point, error=seen.error)
            unstable += [] if seen.settles else [float(frequency)]
        points.append(point)
    response = _response(condensed, np.asarray(frequencies), points)
    findings = *response.findings, *_ended(condensed, ended), *_instability(condensed, unstable)
    findings = *findings, *jumped(response.name, jumps), *_folded(response.name, folds)
    return condensed.completed(replace(response, findings=findings), points)


def _settings(given: HarmonicBalance | float | None, former: _Former) -> HarmonicBalance:
    """The settings of a call, in their present or in their former form."""
    asked: dict[str, Any] = dict(former)
    if isinstance(given, float | int):
        asked["tolerance"] = float(given)
        given = None
    wrong = set(asked) - {own.name for own in fields(HarmonicBalance)}
    if wrong:
        raise TypeError(f"frf() got an unexpected keyword argument '{min(wrong)}'")
    if asked:
        told = ", ".join(f"{name}={value!r}" for name, value in asked.items())
        warn(f"frf takes settings=HarmonicBalance({told}) in the next release", DeprecationWarning, stacklevel=3)
    return replace(given or HarmonicBalance(), **asked)


def _ended(condensed: Condensed, searches: list[tuple[float, int, _Point | None]]) -> list[Finding]:
    """A finding where the budget ended the search: frequencies in Hz, what was spent, what there is."""
    if not searches:
        return []
    frequency, spent, point = max(searches, key=lambda search: np.inf if search[2] is None else search[2].error)
    return [
        Finding.of(
            "warning",
            "budget-spent",
            condensed.problem.system.name,
            "the budget ended the search at {count} frequencies; at {frequency} Hz no steady state was found after "
            "{spent}, counted in unknowns and 200 more for each evaluation of the contact forces."
            if point is None
            else "the budget ended the search at {count} frequencies; at {frequency} Hz the error estimate is {error} "
            "after {spent}, counted in unknowns and 200 more for each evaluation of the contact forces.",
            float(spent),
            float(condensed.budget),
            advice="Ask for fewer harmonics (harmonics), a looser tolerance, or a larger budget (budget).",
            count=len(searches),
            frequency=f"{frequency:.5g}",
            error=np.nan if point is None else f"{point.error:.1e}",
            spent=spent,
        )
    ]


def jumped(where: str, jumps: list[tuple[float, float]]) -> list[Finding]:
    """A finding where neighbouring steady states lie on different branches: pairs of frequencies in Hz."""
    if not jumps:
        return []
    named = ", ".join(f"{min(pair):.5g} and {max(pair):.5g}" for pair in jumps[:_NAMED])
    more = len(jumps) - _NAMED
    return [
        Finding.of(
            "warning",
            "branch-jump",
            where,
            "the steady states change to another branch between {named} Hz and at {more} more: there are several there."
            if more > 0
            else "the steady states change to another branch between {named} Hz: there are several there.",
            jumps[0][0],
            advice="Sweep up and down (ema.simulate.frf_up_and_down) to see both.",
            named=named,
            more=more,
        )
    ]


def _folded(where: str, folds: list[tuple[float, float, list[float]]]) -> list[Finding]:
    """A finding where the curve turns back between two lines: both in Hz, and where it turns."""
    if not folds:
        return []
    named = "; ".join(
        f"between {min(pair):.5g} and {max(pair):.5g} Hz, at " + " and ".join(f"{turn:.5g}" for turn in sorted(turned))
        for *pair, turned in folds[:_NAMED]
    )
    more = f", and between {2 * (len(folds) - _NAMED)} more lines" if len(folds) > _NAMED else ""
    return [
        Finding(
            "warning",
            "fold-between-lines",
            where,
            f"the curve of steady states turns back {named} Hz{more}: there are several states there.",
            min(folds[0][2]),
            None,
            "Compute lines between these, upward and downward (ema.simulate.frf_up_and_down).",
        )
    ]


def _instability(condensed: Condensed, frequencies: list[float]) -> list[Finding]:
    """A finding where the motion leaves its steady state."""
    if not frequencies:
        return []
    return [
        Finding.of(
            "warning",
            "unstable-state",
            condensed.problem.system.name,
            "the motion in time leaves the steady state at {count} frequencies.",
            frequencies[0],
            advice="Use the time solver, ema.simulate.respond, there.",
            count=len(frequencies),
        )
    ]


def _response(condensed: Condensed, frequencies: np.ndarray, points: list[_Point | None]) -> HarmonicResponse:
    """Responses, powers and errors of all points, and what is suspicious about them."""
    most = max((point.count for point in points if point is not None), default=1)
    count, contacts, rows = len(points), len(condensed.limits), condensed.rows
    values = np.full((count, len(rows), most), np.nan, complex)
    slips = np.full((count, contacts, most), np.nan, complex)
    powers, error, rounding = np.full((count, 3), np.nan), np.full(count, np.nan), np.zeros(count)
    for n, point in enumerate(points):
        if point is None:
            continue
        values[n], slips[n] = 0, 0
        values[n, :, : point.count] = condensed.outputs(point, rows)
        slips[n, :, : point.count] = point.amplitudes[:, ::2] - 1j * point.amplitudes[:, 1::2]
        powers[n], error[n], rounding[n] = condensed.powers(point), point.error, condensed.power_rounding(point)
    solved = np.isfinite(error)
    response = HarmonicResponse(
        frequencies,
        condensed.orders(most),
        values,
        condensed.problem.outputs,
        slips,
        condensed.force,
        condensed.driven,
        powers[:, 0],
        powers[:, 1],
        powers[:, 2],
        error,
        solved,
        (),
        condensed.problem.system.name,
    )
    return replace(response, findings=(*condensed.problem.findings, *_judged(condensed, response, rounding)))


def _judged(condensed: Condensed, response: HarmonicResponse, rounding: Float[np.ndarray, "freq"]) -> list[Finding]:
    """Findings where there is no state, where its error is above the tolerance, and where the powers do not balance.

    ``rounding``: imbalance in W that is none.
    """
    frequencies, error, solved = response.frequencies, response.error_estimate, response.converged
    where, findings = response.name, list[Finding]()
    if not solved.all():
        lost = frequencies[~solved]
        findings.append(
            Finding.of(
                "error",
                "no-steady-state",
                where,
                "no steady state found at {count} frequencies.",
                float(lost[0]),
                advice="Use the time solver, ema.simulate.respond, or a softer contact there.",
                count=len(lost),
            )
        )
    if solved.any() and np.nanmax(error) > condensed.tolerance:
        worst = int(np.nanargmax(error))
        findings.append(
            Finding.of(
                "warning",
                "harmonics",
                where,
                "error estimate {error} at {frequency} Hz.",
                float(error[worst]),
                condensed.tolerance,
                advice="Check it in time.",
                error=f"{error[worst]:.1e}",
                frequency=f"{frequencies[worst]:.5g}",
            )
        )
    lost = response.friction_power + response.damping_power
    open_power = np.maximum(np.abs(response.input_power - lost) - rounding, 0.0)
    imbalance = float(
        np.max(open_power[solved] / np.maximum(np.abs(response.input_power[solved]), 1e-300), initial=0.0)
    )
    if imbalance > 1e-4:
        findings.append(
            Finding.of(
                "warning",
                "power-balance",
                where,
                "the power balance is off by {imbalance}.",
                imbalance,
                1e-4,
                advice="Lower the tolerance.",
                imbalance=f"{imbalance:.1e}",
            )
        )
    return findings
