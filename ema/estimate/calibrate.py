"""Calibration of a hammer and an accelerometer together on a known free mass."""

from dataclasses import dataclass

import numpy as np

from ema.data import Finding, FrfSet
from ema.errors import InputError

SCATTER = 0.03
"""Relative scatter over the band above which the body is not rigid or the impact not central."""


@dataclass(frozen=True)
class Calibration:
    """What makes FRFs right: a factor from a measurement on a known mass.

    Parameters
    ----------
    factor : float
        Multiplies FRFs, or the sensitivity ratio of response over force.
    std : float
        Relative standard deviation over the lines.
    phase : float
        Mean phase [rad]: 0, or pi for a reversed sensor.
    band : tuple of (float, float)
        Lines used [Hz].
    findings : tuple of Finding, optional
        What a reader of the factor has to know.

    Examples
    --------
    >>> Calibration(factor=1.02, std=0.004, phase=0.0, band=(50.0, 400.0)).factor
    1.02
    """

    factor: float
    std: float
    phase: float
    band: tuple[float, float]
    findings: tuple[Finding, ...] = ()


def known_mass(frfs: FrfSet, mass: float, band: tuple[float, float], output: int = 0, input_: int = 0) -> Calibration:
    """Compare the accelerance of a freely suspended rigid body with 1 / mass (operational calibration).

    Parameters
    ----------
    frfs : FrfSet
        Accelerance, excited and measured on one line through the centre of mass.
    mass : float
        Mass [kg], sensor included.
    band : tuple of (float, float)
        Ends of the band [Hz]: well above the suspension and below the first resonance of the body.
    output, input_ : int, default 0
        Position of the FRF in the set, from 0.

    Returns
    -------
    Calibration
        Factor from the median over the lines, its scatter and its phase.

    Raises
    ------
    InputError
        If the FRFs are no accelerance, the mass is not positive, or the band holds no line.

    References
    ----------
    .. [1] ISO 7626-1, operational calibration.

    Examples
    --------
    >>> from ema.data import FrfSet
    >>> f = np.arange(10.0, 100.0)
    >>> body = FrfSet.from_arrays(f, np.full(90, 0.51), outputs=["1:+Z"], inputs=["1:+Z"], quantity="accelerance")
    >>> round(known_mass(body, mass=2.0, band=(20.0, 80.0)).factor, 4)  # reads 2 % too high
    0.9804
    """
    if frfs.quantity != "accelerance":
        raise InputError(
            "known-mass calibration needs accelerance",
            where=frfs.name,
            got=frfs.quantity,
            advice="state the unit of the response channel, or convert the FRFs by ema.synthesis.convert",
        )
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
            Finding.of(
                "warning",
                "calibration-scatter",
                where,
                "the accelerance times the mass scatters by {scatter} % over the band.",
                std,
                SCATTER,
                advice="Choose a band without suspension and body resonances, strike through the centre of mass.",
                scatter=f"{100 * std:.1f}",
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
