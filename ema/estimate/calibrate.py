"""Calibration of a hammer and an accelerometer together on a known free mass."""

from dataclasses import dataclass

import numpy as np

from ema.data import Finding, FrfSet
from ema.errors import InputError

SCATTER = 0.03
"""Relative scatter over the band above which the body is not rigid or the blow not central."""


@dataclass(frozen=True)
class Calibration:
    """``factor`` multiplies FRFs (or the sensitivity ratio of response over force) to make them right.

    ``std`` is its relative standard deviation over the lines, ``phase`` the mean phase in rad (0, or pi for a reversed
    sensor), ``band`` the lines used in Hz.
    """

    factor: float
    std: float
    phase: float
    band: tuple[float, float]
    findings: tuple[Finding, ...] = ()


def known_mass(frfs: FrfSet, mass: float, band: tuple[float, float], output: int = 0, input_: int = 0) -> Calibration:
    """Compare the accelerance of a freely hung rigid body with 1 / mass (ISO 7626-1, operational calibration).

    Parameters
    ----------
    frfs : accelerance; struck and measured on one line through the centre of mass.
    mass : kg, sensor included.
    band : Hz; well above the suspension and below the first resonance of the body.

    Raises
    ------
    InputError : the FRFs are no accelerance, or the mass is not positive.
    """
    if frfs.quantity != "accelerance":
        raise InputError("known-mass calibration needs accelerance", where=frfs.name, got=frfs.quantity)
    if not mass > 0:
        raise InputError("not a mass", where=frfs.name, got=mass, expected="more than 0 kg")
    values = frfs.band(*band).values[:, output, input_] * mass
    mean = np.mean(values)
    factor = 1 / float(np.median(np.abs(values)))
    std = float(np.std(np.abs(values)) * factor)
    phase = float(np.angle(mean))
    findings = []
    where = f"{frfs.name}, {frfs.label(output, input_)}"
    if std > SCATTER:
        findings.append(
            Finding(
                "warning",
                "calibration-scatter",
                where,
                f"the accelerance times the mass scatters by {100 * std:.1f} % over the band.",
                std,
                SCATTER,
                "Choose a band without suspension and body resonances, strike through the centre of mass.",
            )
        )
    if abs(phase) > np.pi / 2:
        findings.append(
            Finding(
                "warning",
                "reversed-sensor",
                where,
                "force and acceleration have opposite signs.",
                phase,
                np.pi / 2,
                "Reverse the direction of one of the two in the channel table.",
            )
        )
    return Calibration(factor, std, phase, band, tuple(findings))
