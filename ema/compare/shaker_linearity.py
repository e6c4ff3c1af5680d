"""Whether a shaker test sees a linear structure: what one level tells, and other levels of the same condition.

One level tells where the excitation leaves lines out (`ema.estimate.detection_lines`), where a mode follows its
amplitude under random excitation (`ema.estimate.reverse_path`), and where a peak leans (`ema.fit`). None of these says
that a structure is linear but the first; without it that takes a second level.
"""

from collections.abc import Sequence

import numpy as np

from ema.compare.linearity import OTHER_LEVEL
from ema.data import Finding, FrfSet, ModalModel, Run
from ema.errors import InputError
from ema.estimate.nonlinearity import NONLINEAR, Homogeneity, homogeneity
from ema.estimate.reverse_path import amplitude_dependence, amplitude_finding
from ema.messages import mark

SHAKEN = ("random", "sweep", "stepped sine")
"""Kinds of excitation by a shaker."""
NAMED = ("nonlinear-distortion", "leaning-peak")
"""Findings of the estimation and of the fit that name a nonlinear structure."""


def shaker_linearity(
    run: Run, frfs: FrfSet, modes: ModalModel, others: Sequence[tuple[Run, FrfSet]] = ()
) -> tuple[Finding, ...]:
    """Say whether the structure of a shaker test is linear at its level, or that this cannot be decided.

    Parameters
    ----------
    run : Run
        Random excitation, a sweep or a stepped sine.
    frfs, modes : FrfSet, ModalModel
        What was made of it.
    others : sequence of tuple of (Run, FrfSet), optional
        Tests of the same condition at other levels.

    Returns
    -------
    tuple of Finding
        One of ``amplitude-dependence``, ``not-homogeneous``, ``level-tested`` and ``linearity-not-testable``, or none
        where the findings of ``frfs`` and ``modes`` say it already.

    Examples
    --------
    >>> from ema.data import Condition, Excitation
    >>> from ema.examples import frf_set, modal_model
    >>> run = Run("steps", Condition(Excitation("stepped sine")), frfs=(frf_set(),))
    >>> [one.code for one in shaker_linearity(run, frf_set(), modal_model())]
    ['linearity-not-testable']
    """
    where = f"run {run.id}"
    codes = {finding.code for finding in (*frfs.findings, *modes.findings)}
    if codes & {"nonlinear-distortion", "level-tested"}:  # of a multisine
        return ()
    levels = _levels(run, frfs, modes, others, where)
    if levels is not None:
        return (levels,)
    within = None
    if run.kind == "random" and len(run.recordings):
        read = amplitude_dependence(run, modes.natural_frequencies, modes.damping_ratios)
        within = amplitude_finding(read, where)
    if within is not None:
        return (within,)
    return () if codes & {*NAMED, "linearity-not-testable"} else (_open(run, where),)


def _open(run: Run, where: str) -> Finding:
    return Finding.of(
        "info",
        "linearity-not-testable",
        where,
        "Whether the structure is linear is not testable: one level of {kind} does not tell.",
        advice=(
            "Repeat at half the level under the same condition and assembly, or with a multisine of odd "
            "lines with some left out."
        ),
        kind=_NAMES[run.kind],
    )


_NAMES = {"random": mark("random excitation"), "sweep": mark("a sweep"), "stepped sine": mark("a stepped sine")}


def _levels(
    run: Run, frfs: FrfSet, modes: ModalModel, others: Sequence[tuple[Run, FrfSet]], where: str
) -> Finding | None:
    """What other levels say: against the harder of two that differ, and for the run where two agree.

    Where noise alone would make an index beyond its limit, nothing is said.
    """
    agreed = None
    for other, beside in others:
        ratio = _force(run) / _force(other)
        if not max(ratio, 1 / ratio) > OTHER_LEVEL:
            continue
        harder = ratio > 1
        sets = (beside, frfs) if harder else (frfs, beside)
        read = [one for one in (_compared(*sets, near) for near in modes.natural_frequencies) if one is not None]
        if not read:
            continue
        worst = max(read, key=lambda one: one.index)
        forces = f"{min(_force(run), _force(other)):.3g} and {max(_force(run), _force(other)):.3g} N rms"
        if worst.index > NONLINEAR and harder:
            return Finding.of(
                "warning",
                "not-homogeneous",
                where,
                "The FRFs about {frequency} Hz differ by {difference} from those of run {run} ({forces}): "
                "the structure is not linear at this level.",
                worst.index,
                NONLINEAR,
                advice="FRFs hold for this level only; repeat at half of it, and state modes with the level.",
                frequency=f"{0.5 * sum(worst.band):.5g}",
                difference=f"{worst.index:.0%}",
                run=other.id,
                forces=forces,
            )
        if worst.index <= NONLINEAR and all(one.noise < NONLINEAR for one in read):
            agreed = Finding.of(
                "info",
                "level-tested",
                where,
                "The FRFs about no mode differ by more than {limit_share} from those of run {run} "
                "({forces}): no sign of a nonlinear structure.",
                worst.index,
                NONLINEAR,
                limit_share=f"{NONLINEAR:.0%}",
                run=other.id,
                forces=forces,
            )
    return agreed


def _compared(low: FrfSet, high: FrfSet, near: float) -> Homogeneity | None:
    try:
        return homogeneity(low, high, float(near))
    except InputError:
        return None


def _force(run: Run) -> float:
    """Rms of the forces of a run over its records [N]."""
    power = [float(np.mean(np.square(one.signals[one.with_role("reference")]))) for one in run.recordings]
    return float(np.sqrt(np.mean(power))) if power else float("nan")
