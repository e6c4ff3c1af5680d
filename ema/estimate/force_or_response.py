"""The interval from H1 to H2: what FRFs say where nothing tells noise of the force from noise of the responses."""

from typing import Any

import numpy as np
from jaxtyping import Float

from ema.data import Finding, FrfSet
from ema.errors import InputError

BOUNDED = ("H1", "H2", "Hv")
"""Estimators whose coherence is that of each line by itself, and in which no noise has been taken off."""

_POWERS: dict[str, tuple[float, float]] = {"H1": (0.0, -1.0), "H2": (1.0, 0.0), "Hv": (0.5, -0.5)}
"""Powers of the coherence by which an estimate is multiplied to give H1 and H2."""


def h1_h2_bounds(frfs: FrfSet) -> tuple[Float[np.ndarray, "freq out in"], Float[np.ndarray, "freq out in"]]:
    """Compute the interval in which the magnitudes of FRFs lie, whichever share of the noise is of the force.

    Noise of the force channel makes H1 too low, noise of a response H2 too high, and the coherence is H1 / H2: between
    them lies the magnitude, for noise that is independent of the force. The ends are moved apart by the error of the
    averages, 1.96 standard deviations. The interval does not hold what acts on the structure beside a shaker and comes
    back into its force, nor leakage.

    Parameters
    ----------
    frfs : FrfSet
        FRFs by H1, H2 or Hv of one force at a time, with coherence; those of several forces that act together have a
        multiple coherence, which bounds nothing.

    Returns
    -------
    tuple of arrays of shape (freq, out, in)
        Lowest and highest magnitude, in the unit of the FRFs; infinite where the coherence is 0.

    Raises
    ------
    InputError
        If there is no coherence, the estimator is another one, or the forces acted together.

    References
    ----------
    .. [1] Bendat and Piersol (2010), Random Data, 4th edition, section 9.1.4 and eq. 9.90.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from ema.examples import frf_set
    >>> frfs = frf_set().pick(inputs=[0])
    >>> frfs = replace(frfs, estimator="H1", coherence=np.full(frfs.values.shape, 0.8), variance=None)
    >>> low, high = h1_h2_bounds(frfs)
    >>> round(float(high[50, 0, 0] / low[50, 0, 0]), 2)
    1.25
    """
    where = f"run {frfs.name}" if frfs.name else "FRFs"
    if frfs.coherence is None:
        raise InputError("the FRFs have no coherence", where=where, advice="estimate them from records")
    if frfs.estimator not in BOUNDED:
        raise InputError(
            "the FRFs are not bounded by their coherence",
            where=where,
            got=frfs.estimator or "an unknown estimator",
            expected="H1, H2 or Hv",
            advice="estimate them with method='welch' and without generator or record at rest",
        )
    coherence = np.asarray(frfs.coherence)
    if coherence.shape[2] > 1 and np.all(coherence == coherence[:, :, :1]):
        raise InputError(
            "the forces acted together: their multiple coherence bounds no FRF",
            where=where,
            got=f"{coherence.shape[2]} forces of one coherence",
            expected="one force at a time",
            advice="record the signals of the generators",
        )
    size: Any = np.abs(np.asarray(frfs.values))
    error: Any = 0.0
    if frfs.variance is not None:
        # the magnitude has half of the complex variance, relative to the estimate
        known = np.where(np.isfinite(frfs.variance), np.asarray(frfs.variance), 0.0)
        error = 1.96 * np.sqrt(np.divide(known / 2, size**2, out=np.zeros_like(size), where=size > 0))
    to_h1, to_h2 = (np.power(np.maximum(coherence, 1e-300), power) for power in _POWERS[frfs.estimator])
    low = size * to_h1 * np.maximum(1 - error, 0.0)
    return low, np.where(coherence > 0, size * to_h2 * (1 + error), np.inf)


def about_noise(frfs: FrfSet, lines: list[tuple[float, float]], where: str) -> list[Finding]:
    """A finding on resonances, pairs of frequency [Hz] and coherence, whose noise may be of force or response."""
    if not lines or frfs.estimator not in (*BOUNDED, "H1 (local model)") or frfs.condition.excitation.kind == "hammer":
        return []
    if len(frfs.inputs) > 1 or any(finding.code == "force-noise" for finding in frfs.findings):
        return []
    frequency, coherence = min(lines, key=lambda line: line[1])
    return [
        Finding.of(
            "warning",
            "force-or-response-noise",
            where,
            "at the resonances at {frequencies} Hz nothing tells noise of the force from noise of the responses: H2 is "
            "{ratio} times H1 at {frequency} Hz, and all between them agrees with the data.",
            1 / max(coherence, 1e-3),
            advice='Record the signal of the generator (role = "generator") or the channels at rest (at_rest), or '
            "repeat a periodic force; until then take the interval (ema.estimate.h1_h2_bounds) as the result.",
            frequencies=", ".join(f"{one:.4g}" for one, _ in lines[:6]) + (", ..." if len(lines) > 6 else ""),
            ratio=f"{1 / max(coherence, 1e-3):.3g}",
            frequency=f"{frequency:.4g}",
        )
    ]
