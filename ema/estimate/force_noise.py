"""H1 less the noise of the force channel, which a record at rest shows.

The measured force x = f + n has the power ``S_xx = S_ff + S_nn``, by which H1 is too low. With ``S_nn`` of a record at
rest, n0 averages of the same blocks,

    H = S_yx / (S_xx - S_nn) = H1 S_xx / (S_xx - S_nn).

With e = y - H x the numerator of its error is what ``S_ex`` and ``S_nn`` differ from their means by,

    var H = (S_ee S_xx / n + |H|^2 S_nn^2 / n0) / (S_xx - S_nn)^2,

for circular normal spectra, of which E |mean(e x*) - S_ex|^2 is S_ee S_xx / n also where e and x are correlated, as
they are by n (Bendat and Piersol 2010, chapter 9; Fuller 1987, Measurement Error Models).

The local model (:mod:`ema.estimate.local_model`) has forces as regressors, with coefficients common to lines of
different power. With the best linear prediction of the acting force in their place, line by line,

    u = x S_ff / (S_ff + S_nn),

what is left of the force, f - u, is not correlated with u, and the responses to it are one more noise that passes
through the structure (regression calibration: Carroll, Ruppert, Stefanski and Crainiceanu 2006, Measurement Error in
Nonlinear Models, chapter 4).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.signal
from jaxtyping import Bool, Complex, Float

from ema.data import Deviations, Finding
from ema.errors import InputError
from ema.estimate import spectra, spectra_parts
from ema.estimate.generator import bands_of, pooled
from ema.estimate.local_model import WEAKEST
from ema.estimate.spectra import Spectra

MATTERS = 0.01
"""Share of noise in the force's power on a line from which on it is named: H1 is too low by as much. As for repeated
sweeps; half of it is less than the scatter of few averages, twice as much leaves damping 2 % too high."""

LESS_NOISE = "H1 less force noise"
"""What FRFs are called from which the noise of the force was taken off."""

NORMAL_95 = 3.84
"""Square of a real error over its variance that is exceeded with a probability of 5 %."""


SMOOTHED = 19
"""Lines (odd) over which the power of the force is smoothed by a parabola for the local model: those of the model of a
line with one force. With 5 to 19 lines bias and coverage are alike, and those of the true power."""

SMOOTHING = 9 / 4
"""Variance of a parabola's middle over that of the mean of the same lines (Savitzky and Golay 1964)."""


@dataclass(frozen=True)
class AtRest:
    """Power of the noise of one force (freq,), in the unit of the spectra, and the averages behind it."""

    power: Float[np.ndarray, "freq"]
    averages: float

    def in_blocks(self, length: int) -> "AtRest":
        """The noise on the lines, without that of 0 Hz and the last, of blocks of ``length`` samples."""
        own = 2 * (len(self.power) - 1)
        lines = np.arange(1, length // 2) * own / length
        return AtRest(np.interp(lines, np.arange(len(self.power)), self.power) * length / own, self.averages)


def share(found: Spectra, rest: AtRest) -> Float[np.ndarray, "freq"]:
    """Share of noise in the power of the force, at most 1."""
    power = spectra.input_power(found)[:, 0]
    return np.asarray(np.minimum(np.divide(rest.power, power, out=np.ones_like(power), where=power > 0), 1.0))


def weakness(power: Float[np.ndarray, "freq"], rest: AtRest, averages: float) -> Float[np.ndarray, "freq"]:
    """Square of the share of ``S_xx - S_nn`` that its error may have with a probability of 95 %; from 1 on there may be
    no force.

    The error, of n averages of the ``power`` of the measured force, is that of noise and its product with the force,
    ``2 S_ff S_nn / n + S_nn^2 (1 / n + 1 / n0)``.
    """
    left = np.maximum(power - rest.power, 1e-9 * np.maximum(power, rest.power))
    variance = 2 * left * rest.power / averages + rest.power**2 * (1 / averages + 1 / rest.averages)
    return np.asarray(NORMAL_95 * np.divide(variance, left**2, out=np.full_like(left, np.inf), where=left > 0))


def welch_frfs(found: Spectra, rest: AtRest, kept: Bool[np.ndarray, "freq"]) -> dict[str, Any]:
    """FRFs without the bias by noise of the force, coherence, variance and averages on the ``kept`` lines."""
    tiny = np.finfo(float).tiny
    alone = rest.power * np.sqrt(1 / found.averages + 1 / rest.averages)
    # What is left of the force is known to no less than that: a standard deviation of 100 % where it is all there is.
    left = np.maximum(np.maximum(spectra.input_power(found)[:, 0] - rest.power, alone), tiny)[:, None]
    weak = weakness(spectra.input_power(found)[:, 0], rest, found.averages)
    values = found.cross / left[:, :, None]
    coherence = spectra.multiple_coherence(found)
    result = {
        "values": values[kept],
        "coherence": coherence[kept, :, None],
        "variance": None,
        "averages": np.full(values.shape[1:], found.averages),
    }
    if found.averages <= 1:
        return result
    size = np.abs(values[:, :, 0]) ** 2
    power = spectra.input_power(found)
    # S_ee = S_yy - 2 Re(H* S_yx) + |H|^2 S_xx
    error = found.outputs - 2 * np.real(values[:, :, 0].conj() * found.cross[:, :, 0]) + size * power
    error = pooled(np.maximum(error, 0.0), values, spectra_parts.pooled_lines(found.averages))
    variance = error * power / (found.averages - 1) + size * rest.power[:, None] ** 2 / rest.averages
    variance = (variance / left**2)[kept, :, None]
    result["variance"] = widened(values[kept], variance, weak[kept])
    changes = _deviations(found, rest)
    if changes is None:
        return result
    return result | {
        "deviations": replace(changes, values=np.asarray(changes.values)[:, kept]),
        "output_correlation": spectra_parts.output_correlation(values, changes)[kept],
    }


def _deviations(found: Spectra, rest: AtRest) -> Deviations | None:
    """Deviations of H1 over the power without noise, of which every part has its share."""
    blocks = sum(part.averages for part in found.parts)

    def less(one: Spectra, part: float) -> Spectra:
        power = spectra.input_power(one)[:, 0]
        left = np.maximum(power - part * rest.power, 0.05 * power)
        return replace(one, inputs=left[:, None, None].astype(complex))

    parts = tuple(less(part, part.averages / blocks) for part in found.parts)
    return spectra_parts.deviations(replace(less(found, 1.0), parts=parts))


@dataclass(frozen=True)
class Predicted:
    """Acting forces of blocks as predicted from the measured ones, the relative variance of the prediction by that of
    the powers (freq,), and the weakness of the force (freq,)."""

    forces: list[Complex[np.ndarray, "freq 1"]]
    uncertain: Float[np.ndarray, "freq"]
    weak: Float[np.ndarray, "freq"]


def predicted(forces: Sequence[Complex[np.ndarray, "freq 1"]], rest: AtRest) -> Predicted:
    """Best linear prediction of the acting force, line by line, from the spectra of the measured one in blocks.

    The power of the force is that of all blocks, smoothed over the lines; blocks differ in its level.

    Examples
    --------
    As much noise as force in the channel: half of it is force.

    >>> x = np.sqrt(2) * np.exp(1j * np.arange(200))[:, None]
    >>> found = predicted([x, x], AtRest(np.ones(200), 1e6))
    >>> round(float(abs(found.forces[0][100, 0] / x[100, 0])), 3)
    0.5
    """
    powers = np.array([np.abs(one[:, 0]) ** 2 for one in forces])
    mean = np.mean(powers, axis=0)
    span = min(SMOOTHED, (len(mean) - 1) // 2 * 2 + 1)
    smooth = scipy.signal.savgol_filter(mean, span, 2) if span > 2 else mean
    averages = max(len(forces) * span / SMOOTHING, 1.0)
    alone = rest.power * np.sqrt(1 / averages + 1 / rest.averages)
    left = np.maximum(smooth - rest.power, alone)
    level = np.maximum(np.sum(powers - rest.power, axis=1) / max(float(np.sum(left)), np.finfo(float).tiny), 0.0)
    acting = [part * left for part in level]
    known = [np.divide(part, part + rest.power, out=np.ones_like(part), where=part + rest.power > 0) for part in acting]
    share = np.divide(rest.power, left, out=np.zeros_like(left), where=left > 0)
    return Predicted(
        [one * factor[:, None] for one, factor in zip(forces, known, strict=True)],
        share**2 * (1 / averages + 1 / rest.averages),
        weakness(left + rest.power, rest, averages),
    )


def widened(
    values: Complex[np.ndarray, "freq out in"],
    variance: Float[np.ndarray, "freq out in"],
    weak: Float[np.ndarray, "freq"],
) -> Float[np.ndarray, "freq out in"]:
    """Variance of FRFs over a weak force: that of Fieller's interval, and where there may be no force no less than the
    square of the largest FRF elsewhere, for nothing is known of it.
    """
    weak = weak[:, None, None]
    size = np.abs(values) ** 2
    elsewhere = np.max(np.where(weak < 1, size, 0.0), axis=0)
    variance = variance / (1 - np.minimum(weak, WEAKEST)) ** 2
    return np.asarray(np.where(weak < 1, variance, np.maximum(variance, elsewhere)))


def about_force(
    found: Spectra,
    rest: AtRest,
    frequencies: Float[np.ndarray, "freq"],
    kept: Bool[np.ndarray, "freq"],
    where: str,
) -> tuple[Finding, ...]:
    """Findings on noise that matters where the structure answers, and on lines where the force is not above it.

    Raises
    ------
    InputError : the force at rest is as large as in the test.
    """
    findings = []
    noise = np.where(kept, share(found, rest), 0.0)
    answer = np.mean(found.outputs / np.maximum(found.outputs[kept].max(axis=0), 1e-300), axis=1)
    at_peaks = np.where(answer >= np.median(answer[kept]), noise, 0.0)
    line = int(np.argmax(at_peaks))
    lost = kept & (weakness(spectra.input_power(found)[:, 0], rest, found.averages) >= 1)
    if np.mean(lost[kept]) > 0.5:
        raise InputError(
            "the force in the record at rest is as large as in the test",
            where=where,
            got=f"no significant difference at {100 * np.mean(lost[kept]):.0f} % of the lines",
            expected="a record without excitation",
            advice="correct at_rest in campaign.toml",
        )
    if at_peaks[line] >= MATTERS:
        findings.append(
            Finding.of(
                "info",
                "force-noise",
                where,
                "noise of the force channel, by the record at rest, is {share} % of the power of the force at "
                "{frequency} Hz, by which H1 would be too low: it was taken off.",
                float(at_peaks[line]),
                MATTERS,
                advice="Use a load cell of less range, or more force at the resonances.",
                share=f"{100 * at_peaks[line]:.2g}",
                frequency=f"{frequencies[line]:.4g}",
            )
        )
    if lost.any():
        findings.append(
            Finding.of(
                "warning",
                "force-below-noise",
                where,
                "at {share} % of the lines ({bands}) the force is not significantly above the noise of its channel: "
                "the FRFs there are not determined, and their variance is large.",
                float(np.mean(lost[kept])),
                0.0,
                advice="Raise the force there, average more, or record the signal of the generator.",
                share=f"{100 * np.mean(lost[kept]):.2g}",
                bands=bands_of(frequencies, lost),
            )
        )
    return tuple(findings)
