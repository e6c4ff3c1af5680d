"""A finished study as plain numbers and texts, for machines."""

import math
from typing import Any

import numpy as np

from ema.data import (
    AmplitudeDependentMode,
    AmplitudePrediction,
    Band,
    ConditionDifference,
    Finding,
    JointForce,
    MapPrediction,
    MapResult,
    ModalModel,
    RepeatGroup,
    RunResult,
    StudyResult,
)
from ema.fit.opinion import SecondOpinion
from ema.units import SI_UNIT


def summary(result: StudyResult) -> dict[str, Any]:
    """Return a study as what JSON can hold.

    Parameters
    ----------
    result : StudyResult
        A finished study.

    Returns
    -------
    dict of str to object
        Nested dicts and lists; a number that is not known is ``None``.

    Examples
    --------
    >>> from ema.examples import campaign
    >>> summary(StudyResult(campaign(), runs=(), title="bare and beam"))["title"]
    'bare and beam'
    """
    return {
        "title": result.title,
        "campaign": result.campaign.name,
        "runs": [_run(run) for run in result.runs],
        "levels": {mode.name: amplitude_mode(mode) for mode in result.amplitude_modes},
        "conditions": [_condition(one) for one in result.conditions],
        "differences": [_difference(one) for one in result.differences],
        "expectations": [
            {
                "what": one.what,
                "expected": one.expected,
                "tolerance": one.tolerance,
                "found": number(one.found),
                "met": one.met,
            }
            for one in result.expectations
        ],
        "maps": [chart(one) for one in result.maps],
        "statements": [
            {
                "sentence": one.sentence,
                "text": one.text,
                "source": one.source,
                "quantity": one.quantity,
                "low": number(one.low),
                "high": number(one.high),
                "value": number(one.value),
                "interval": [number(one.lower), number(one.upper)],
                "verdict": one.verdict,
                "reason": one.reason,
            }
            for one in result.statements
        ],
        "repairs": [vars(repair) for repair in result.repairs],
        "findings": [finding(one) for one in result.findings],
    }


def _run(result: RunResult) -> dict[str, Any]:
    return {
        "run": result.run.id,
        "modes": modes(result.modes, None if result.quality is None else result.quality.modal_phase_collinearity),
        "joints": [joint(one) for one in result.run.condition.joints],
        "findings": [finding(one) for one in result.findings],
    }


def _condition(group: RepeatGroup) -> dict[str, Any]:
    """A condition with its repeats; damping ratios as fractions, ``between`` without noise."""
    parts = {"natural_frequency": group.frequency, "damping_ratio": group.damping}
    names = ("mean", "half", "noise", "takes", "between")
    return {
        "condition": group.label,
        "runs": list(group.runs),
        "repeats": group.count,
        "basis": group.basis,
        "modes": [
            {
                name: {part: number(getattr(own, part)[mode]) for part in names}
                | {"between_interval": [number(limit) for limit in own.between_interval[mode]]}
                for name, own in parts.items()
            }
            | {"repeats": int(group.frequency.assemblies[mode])}
            for mode in range(len(group.frequency.mean))
        ],
    }


def _difference(difference: ConditionDifference) -> dict[str, Any]:
    """One condition against another: changes with half their 95 % interval, and what they mean."""
    parts = {
        "natural_frequency": (
            difference.frequency,
            difference.frequency_half,
            difference.frequency_noise,
            difference.words("frequency"),
        ),
        "damping_ratio": (
            difference.damping,
            difference.damping_half,
            difference.damping_noise,
            difference.words("damping"),
        ),
    }
    return {
        "first": difference.first,
        "second": difference.second,
        "verdict": list(difference.sentences),
        "modes": [
            {"mode": i + 1, "second_mode": j + 1, "mac": number(difference.mac[pair])}
            | {
                name: {
                    "first": number(values[pair, 0]),
                    "second": number(values[pair, 1]),
                    "half": number(half[pair]),
                    "half_by_noise": number(noise[pair]),
                    "verdict": words[pair],
                }
                for name, (values, half, noise, words) in parts.items()
            }
            for pair, (i, j) in enumerate(difference.pairs)
        ],
    }


def chart(result: MapResult) -> dict[str, Any]:
    """A map as one entry per condition, and its findings."""
    rows = [{name: number(value) for name, value in row.items()} for row in points(result)]
    return {"map": result.name, "points": rows, "findings": [finding(one) for one in result.findings]}


def points(result: MapResult) -> list[dict[str, float]]:
    """One row per condition: nominal and measured forces in N, frequency in Hz, damping ratios and their deviations."""
    chart = result.chart
    names = {
        "force_at_resonance": chart.force_at_resonance,
        "frequency": chart.frequency,
        "frequency_std": chart.frequency_std,
        "damping": chart.damping,
        "damping_std": chart.damping_std,
        "quadrature_damping": chart.quadrature_damping,
        "misfit": chart.misfit,
        "modal_amplitude": chart.modal_amplitude,
        "dropout": result.dropout,
    }
    rows = []
    for i, level in enumerate(chart.force_levels):
        for j, force in enumerate(chart.normal_forces):
            row = {"force_level": float(level), "normal_force": float(force)}
            if chart.joint_forces is not None:
                row |= {f"F_N {name}": float(chart.joint_forces[i, j, k]) for k, name in enumerate(chart.joints)}
            row |= {name: float("nan") if values is None else float(values[i, j]) for name, values in names.items()}
            rows.append(row)
    return rows


def modes(model: ModalModel, collinearity: "np.ndarray | None" = None) -> list[dict[str, Any]]:
    """One entry per mode, as what JSON can hold.

    Parameters
    ----------
    model : the modes.
    collinearity : modal phase collinearity (mode,), between 0 and 1.

    Returns
    -------
    For each mode ``natural_frequency`` in Hz and ``damping_ratio`` as a fraction; their standard deviations, the
    confidence and the collinearity where they are known. A number that is not finite is None.

    Examples
    --------
    >>> from ema.examples import modal_model
    >>> first = modes(modal_model())[0]
    >>> first["damping_ratio"] < 0.1 < first["natural_frequency"]
    True
    """
    rows = []
    for mode, (frequency, damping) in enumerate(zip(model.natural_frequencies, model.damping_ratios, strict=True)):
        row: dict[str, Any] = {"natural_frequency": float(frequency), "damping_ratio": float(damping)}
        if model.covariance is not None:
            row |= {
                "natural_frequency_std": number(np.sqrt(model.covariance[mode, 0, 0])),
                "damping_ratio_std": number(np.sqrt(model.covariance[mode, 1, 1])),
            }
        if model.confidence is not None:
            row["confidence"] = number(model.confidence[mode])
        if collinearity is not None:
            row["modal_phase_collinearity"] = number(collinearity[mode])
        rows.append(row)
    return rows


def opinion(second: SecondOpinion) -> dict[str, Any]:
    """Two estimators side by side: differences in combined standard deviations, and what these cannot explain."""
    table = second.table()
    rows = [
        {
            "natural_frequency": number(row["f [Hz]"]),
            "second_natural_frequency": number(row["f second [Hz]"]),
            "frequency_difference": number(row["df / s"]),
            "damping_ratio": number(row["zeta [%]"] / 100),
            "second_damping_ratio": number(row["zeta second [%]"] / 100),
            "damping_difference": number(row["dzeta / s"]),
            "mac": number(row["MAC"]),
            "agrees": bool(row["agrees"]),
        }
        for _, row in table.iterrows()
    ]
    return {"limit": second.limit, "modes": rows, "findings": [finding(one) for one in second.findings]}


def joint(one: JointForce) -> dict[str, Any]:
    """The normal force of a joint in N."""
    return {"joint": one.joint, "mean": number(one.mean), "std": number(one.std), "drift": number(one.drift)}


def finding(one: Finding) -> dict[str, Any]:
    """A finding as a mapping."""
    return {
        "severity": one.severity,
        "code": one.code,
        "where": one.where,
        "message": one.message,
        "value": number(one.value),
        "limit": number(one.limit),
        "advice": one.advice,
    }


def number(value: "float | None") -> "float | None":
    """The number, or ``None`` for one that is missing or not finite."""
    return None if value is None or not math.isfinite(value) else float(value)


def amplitude_mode(mode: AmplitudeDependentMode) -> dict[str, Any]:
    """A mode over its amplitude as what JSON can hold: SI and fractions, bounds of the 95 % intervals."""
    return {
        "quantity": mode.quantity,
        "control": mode.control,
        "modal_mass": number(mode.modal_mass),
        "dofs": [str(dof) for dof in mode.dofs],
        "points": [
            {
                "amplitude": float(amplitude),
                "frequency": [float(value) for value in frequency],
                "damping": [float(value) for value in damping],
                **_shape_at(mode, level),
            }
            for level, (amplitude, frequency, damping) in enumerate(
                zip(mode.amplitude, rows(mode.frequency), rows(mode.damping), strict=True)
            )
        ],
        "findings": [finding(one) for one in mode.findings],
    }


def _shape_at(mode: AmplitudeDependentMode, level: int) -> dict[str, Any]:
    """Real and imaginary part of the shape at an amplitude, and half widths of their intervals."""
    if mode.shape is None or mode.shape_half is None:
        return {}
    return {
        "shape": [[float(value.real), float(value.imag)] for value in mode.shape[:, level]],
        "shape_half": [float(value) for value in mode.shape_half[:, level]],
    }


def prediction(predicted: AmplitudePrediction) -> dict[str, Any]:
    """A prediction over the amplitude as what JSON can hold: SI and fractions, bounds of the 95 % bands."""
    points = zip(predicted.amplitude, predicted.beyond, rows(predicted.frequency), rows(predicted.damping), strict=True)
    return {
        "quantity": predicted.quantity,
        "points": [
            {"amplitude": float(amplitude), "beyond": float(beyond), "frequency": list(f), "damping": list(zeta)}
            for amplitude, beyond, f, zeta in points
        ],
        "force": None if predicted.force is None else [list(row) for row in rows(predicted.force)],
        "laws": dict(zip(predicted.laws, predicted.weights.tolist(), strict=True)),
        "parameters": [vars(parameter) for parameter in predicted.parameters],
        "statement": predicted.statement,
        "findings": [finding(one) for one in predicted.findings],
    }


def rows(band: Band) -> list[tuple[float, float, float]]:
    """Low, value and high of each point of a band."""
    return list(zip(band.low.tolist(), band.value.tolist(), band.high.tolist(), strict=True))


def amplitude_lines(mode: AmplitudeDependentMode | AmplitudePrediction) -> list[str]:
    """One line for each amplitude, for people."""
    unit = SI_UNIT[mode.quantity]
    return [
        f"{amplitude:.4g} {unit}: {f[1]:.3f} Hz [{f[0]:.3f}, {f[2]:.3f}], damping {100 * z[1]:.3f} % "
        f"[{100 * z[0]:.3f}, {100 * z[2]:.3f}]"
        for amplitude, f, z in zip(mode.amplitude, rows(mode.frequency), rows(mode.damping), strict=True)
    ]


def map_prediction(predicted: MapPrediction) -> dict[str, Any]:
    """A prediction at forces, as what JSON can hold.

    Parameters
    ----------
    predicted : frequency [Hz] and damping ratio at pairs of force level and normal force.

    Returns
    -------
    ``method``, ``points`` with F_E and F_N in N and the bounds of the 95 % bands (fractions; None where there is no
    resonance), ``statement`` and ``findings``.
    """
    return {
        "method": predicted.method,
        "points": [
            {"force_level": level, "normal_force": force, "frequency": f, "damping": zeta}
            for level, force, f, zeta in _conditions(predicted)
        ],
        "statement": predicted.statement,
        "findings": [finding(one) for one in predicted.findings],
    }


def map_lines(predicted: MapPrediction) -> list[str]:
    """One line for each condition, for people."""
    lines = []
    for level, force, f, z in _conditions(predicted):
        said = "no resonance in the band"
        if f is not None and z is not None:
            said = (
                f"{f[1]:.3f} Hz [{f[0]:.3f}, {f[2]:.3f}], damping {100 * z[1]:.3f} % "
                f"[{100 * z[0]:.3f}, {100 * z[2]:.3f}]"
            )
        lines.append(f"F_E {level:.4g} N, F_N {force:.4g} N: {said}")
    return lines


Bounds = tuple[float, float, float] | None


def _conditions(predicted: MapPrediction) -> list[tuple[float, float, Bounds, Bounds]]:
    """Force level, normal force, and low, value and high of frequency and damping; ``None`` without a resonance."""
    out = []
    for row, level in enumerate(predicted.force_levels.tolist()):
        for column, force in enumerate(predicted.normal_forces.tolist()):
            each: list[tuple[float, float, float]] = []
            for name in ("frequency", "damping"):
                low, value, high = (getattr(predicted, f"{name}{end}")[row, column] for end in ("_low", "", "_high"))
                each.append((float(low), float(value), float(high)))
            known = all(np.isfinite(bounds).all() for bounds in each)
            out.append((level, force, each[0] if known else None, each[1] if known else None))
    return out
