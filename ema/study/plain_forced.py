"""Resonances and responses at forces as plain numbers and texts, for machines and people."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ema.data import Finding, ForcedResonances, ForcedResponse
from ema.study.plain import finding, rows
from ema.units import SI_UNIT


def resonances(predicted: ForcedResonances, responses: Sequence[ForcedResponse]) -> dict[str, Any]:
    """Resonances at forces as what JSON can hold: SI and fractions; a bound that is not known is None."""
    points = zip(
        predicted.force,
        predicted.beyond,
        predicted.several,
        rows(predicted.amplitude),
        rows(predicted.frequency),
        rows(predicted.damping),
        responses,
        strict=True,
    )
    return {
        "quantity": predicted.quantity,
        "forces": [
            {
                "force": float(force),
                "beyond": float(beyond),
                "amplitude": _known(amplitude),
                "frequency": _known(frequency),
                "damping": _known(damping),
                "several_resonances": float(several),
                "folded": response.folded,
            }
            for force, beyond, several, amplitude, frequency, damping, response in points
        ],
        "statement": predicted.statement,
        "findings": [finding(one) for one in (*predicted.findings, *_said(responses, predicted))],
    }


def _said(responses: Sequence[ForcedResponse], predicted: ForcedResonances) -> list[Finding]:
    """What is said of responses and not of the resonances."""
    return [one for response in responses for one in response.findings if one not in predicted.findings]


def resonance_lines(predicted: ForcedResonances) -> list[str]:
    """One line for each force, for people."""
    unit = SI_UNIT[predicted.quantity]
    points = zip(
        predicted.force,
        predicted.beyond,
        rows(predicted.amplitude),
        rows(predicted.frequency),
        rows(predicted.damping),
        strict=True,
    )
    return [
        f"{force:.4g} N: resonance at {f[1]:.3f} Hz [{f[0]:.3f}, {f[2]:.3f}], {a[1]:.4g} {unit} "
        f"[{a[0]:.4g}, {a[2]:.4g}], damping {100 * z[1]:.3f} % [{100 * z[0]:.3f}, {100 * z[2]:.3f}]; "
        f"{beyond:.3g} times the highest level"
        for force, beyond, a, f, z in points
    ]


def _known(bounds: tuple[float, ...]) -> list[float | None]:
    """Bounds without those that are infinite."""
    return [bound if np.isfinite(bound) else None for bound in bounds]
