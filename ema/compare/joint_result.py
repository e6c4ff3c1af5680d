"""The result of a joint posterior as data: what is printed, drawn, reported and kept of it."""

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from ema import fingerprint
from ema.compare.joint_law import TOGETHER, Held, JointAssessment
from ema.compare.joint_statements import KIND, RELATIVE, JointFile
from ema.data import Band, Finding, Provenance
from ema.data.modal import COVERAGE_FACTOR
from ema.show.joint_result import (
    HammerPrediction,
    JointExperiment,
    JointHypothesis,
    JointLawExperiment,
    JointLimit,
    JointParameter,
    JointResult,
    JointStatement,
)

_PRIOR_DRAWS = 20000
"""Draws behind the 95 % prior ranges of combinations: their ends scatter by 1 % of the width."""
_CURVES = 600
"""Draws behind the bands over the normal force, evenly taken from all; their ends scatter by 5 % of the width."""
_FORCES = 25
"""Normal forces of the bands, evenly spaced in the logarithm."""
_MARGIN = 2.0
"""Factor by which the bands go beyond the lowest and the highest stated normal force."""
_ENDS = (0.025, 0.5, 0.975)
_TAILS = np.array([-COVERAGE_FACTOR, COVERAGE_FACTOR])
"""Ends of 95 % of a standard normal variable."""


def joint_result(file: JointFile, found: JointAssessment, path: str | Path | None = None, seed: int = 0) -> JointResult:
    """Collect what a joint posterior says, without its draws.

    Parameters
    ----------
    file : JointFile
        The statements.
    found : JointAssessment
        What ``joint_posterior`` made of them.
    path : str or Path, optional
        Where the statements were read, for the provenance.
    seed : int, default 0
        Seed of the draws, for the provenance.

    Returns
    -------
    JointResult
        Parameters with prior and interval, statements with verdicts, weights, experiments; all in SI.

    Examples
    --------
    >>> from ema.compare.joint_law import JointModel, posteriors
    >>> file = JointFile(title="table", bare={"frequency": "499 Hz", "damping": "0.6 %"},
    ...                  hammer=[{"sentence": "509 Hz", "normal_force": "10 kN", "frequency": "509 Hz"}])
    >>> one, two = posteriors(JointModel(file), runs=2, draws=60)
    >>> result = joint_result(file, JointAssessment(one, two, (), ()))
    >>> result.parameters[0].name, result.weight
    ('friction coefficient', None)
    """
    weight = None
    if found.two is not None:
        weight = JointHypothesis("one joint", found.weight, *found.weight_interval)
    return JointResult(
        title=file.title,
        bare=(float(file.bare.frequency), float(file.bare.damping)),
        parameters=_parameters(found),
        statements=_statements(found),
        weight=weight,
        laws=tuple(JointHypothesis(law.name, law.weight, law.low, law.high) for law in found.laws),
        law_experiments=tuple(
            JointLawExperiment(one.name, tuple(one.outcomes), tuple(one.outcomes.values()), one.separates)
            for one in found.law_experiments
            if len(one.outcomes) > 1
        ),
        lift_off=_limit(found),
        experiments=tuple(JointExperiment(one.name, one.one, one.two, one.separates) for one in found.experiments),
        hammer=_hammer(file, found) if file.hammer else None,
        findings=tuple(_findings(found)),
        provenance=_provenance(found, path, seed),
    )


def _limit(found: JointAssessment) -> JointLimit | None:
    known = found.lift_off
    return None if known is None else JointLimit(known.force, known.lowest, known.limit, known.reached)


def _findings(found: JointAssessment) -> Iterator[Finding]:
    """Statements that contradict the others, and those that cannot be judged."""
    for number, held in enumerate(found.held, 1):
        where = f"statement {number}: {held.datum.quantity}"
        if np.isnan(held.probability):
            yield Finding(
                "info",
                "statement-not-judged",
                where,
                "too few draws tell what the other statements predict in its place.",
                advice="Either no other statement is about the same, or it contradicts the model.",
            )
        elif held.probability < TOGETHER:
            yield Finding.of(
                "warning",
                "statement-contradicts",
                where,
                "what is stated has a probability of {probability} by all other statements.",
                held.probability,
                TOGETHER,
                advice="Read the sentence again where it stands, and see whether its standard deviation holds what the "
                "model gets wrong; else the statements have no joint in common.",
                probability=f"{held.probability:.1g}",
            )


def _parameters(found: JointAssessment) -> tuple[JointParameter, ...]:
    model = found.one.model
    own = {parameter.name: parameter for parameter in model.parameters}
    z = np.random.default_rng(0).standard_normal((_PRIOR_DRAWS, len(own)))
    before = model.combinations(z)
    return tuple(
        JointParameter(
            name,
            _pair(own[name].of(_TAILS) if name in own else np.quantile(before[name], (_ENDS[0], _ENDS[-1]))),
            interval,
            found.narrowing(name),
            found.determined(name),
            combination=name not in own,
            logarithmic=name not in own or not own[name].uniform,
        )
        for name, interval in found.one.interval.items()
    )


def _statements(found: JointAssessment) -> tuple[JointStatement, ...]:
    if not found.held:
        return ()
    readings = np.quantile(found.one.model.readings(found.one.draws), (_ENDS[0], _ENDS[-1]), axis=0)
    return tuple(_statement(held, readings[:, row]) for row, held in enumerate(found.held))


def _statement(held: Held, together: np.ndarray) -> JointStatement:
    datum = held.datum
    relative = datum.quantity.endswith(RELATIVE)
    value, *limits = (float(np.exp(x)) if relative else x for x in (datum.value, datum.low, datum.high))
    if relative and limits[0] == 0:
        limits[0] = float("-inf")
    return JointStatement(
        datum.text,
        datum.quantity,
        value,
        _pair(limits),
        datum.std,
        (held.low, held.high),
        held.probability,
        held.verdict,
        _pair(np.exp(together) if relative else together),
        relative,
    )


def _hammer(file: JointFile, found: JointAssessment) -> HammerPrediction:
    stated = np.array([reading.normal_force for reading in file.hammer], float)
    forces = np.geomspace(stated.min() / _MARGIN, stated.max() * _MARGIN, _FORCES)
    draws = found.one.draws[:: max(1, len(found.one.draws) // _CURVES)]
    frequency, damping = (_band(values) for values in found.one.model.hammer(draws, forces))
    return HammerPrediction(
        forces,
        frequency,
        damping,
        stated,
        np.array([_stated(reading.frequency, reading.frequency_std) for reading in file.hammer]),
        np.array([_stated(reading.damping, reading.damping_std) for reading in file.hammer]),
    )


def _band(values: np.ndarray) -> Band:
    """Median and 95 % of draws (draw, force)."""
    low, middle, high = np.quantile(values, _ENDS, axis=0)
    return Band(low, middle, high, contains="the posterior of one joint, without the standard deviation of a reading")


def _stated(value: float | None, std: float) -> tuple[float, float]:
    return (float("nan"),) * 2 if value is None else (float(value), float(std))


def _provenance(found: JointAssessment, path: str | Path | None, seed: int) -> Provenance:
    runs = len(found.one.log_evidences)
    options = {
        "seed": str(seed),
        "independent runs": str(runs),
        "draws of a run": str(len(found.one.draws) // runs),
        "moves accepted": f"{found.one.acceptance:.2f}",
        "standard error of a mean over the standard deviation, at most": f"{found.one.chance:.2f}",
    }
    read = () if path is None else ((KIND.locate(path).name, fingerprint.of_files([KIND.locate(path)])),)
    return Provenance(
        inputs=read,
        versions=fingerprint.versions(),
        options=tuple(options.items()),
        steps=("ema.compare.joint_posterior",),
        created=datetime.now(UTC),
    )


def _pair(values: Sequence[float] | np.ndarray) -> tuple[float, float]:
    low, high = values
    return float(low), float(high)
