"""What the residual has in the shape of a peak: resonances that are not those of one linear, time-invariant mode.

Near a mode with pole p = j w0 - d, and x = s - j w0, a fit leaves nothing but noise in the coordinates of the mode. Two
more functions distinguish two kinds of error:

    1 / (x - k d), k >= 1, the transform of a vibration that grows until t = 0 and ends there. No linear structure under
    a force that does not depend on its response has it (the causality that the Hilbert transform test of
    nonlinearity rests on; Simon and Tomlinson 1984, Worden and Tomlinson 2001). A peak that leans, w0
    depending on |q|^2 = |a / (x + d)|^2, has it with an imaginary factor; force noise where the structure pulls the
    force down, H / (1 + n / |F|^2), and a disturbance that comes back through the shaker have it with a real one; k
    is the ratio of the decay rates of force and response.

    1 / (x + d)^3, a spread of the poles: lines that were averaged, a resonance that moved between the records.

Factors are over the residue of the mode. What 1 / (x + d)^3 does to the pole of the fit follows from its projection on
1 / (x + d)^2; for averaged lines that is the error of the damping ratio to a tenth. What a growing vibration does to it
is about three times the part of the peak that it has at resonance (leaning peaks, force noise, shakers with feedback:
1 to 5 times).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.stats
from jaxtyping import Bool, Complex, Float

from ema.data import Finding
from ema.fit import estimator
from ema.fit.estimator import Fit, Observations
from ema.fit.policy import POLICY
from ema.fit.refinement import Refined
from ema.fit.uncertainty import PoleErrors
from ema.messages import mark
from ema.shapes import mac

REACH = 20.0
"""Half bandwidths on either side of a mode within which its residual is looked at: the flank of the widest function."""
RATIOS = (1.0, 4.0, 11.0)
"""Decay rates of the growing vibration over that of the mode: no drop of the force at resonance, 12 dB, 21 dB."""
CHANCE = 1e-8
"""Probability that noise alone has such a shape, for each mode and function: among a thousand modes with four functions
each, once in 25,000 times."""
HEIGHT = 3.0
"""Error of the damping ratio over the part of the peak that is not causal: of linear structures with 10 dB to 21 dB of
force drop, leaning by 0.1 to 3 half-power bandwidths, and with noise in the force, 1 to 5."""
MATTERS = 3.0
"""Error of the damping ratio that a residual amounts to, in stated standard deviations, from which on it is named.
Under independent noise whatever passes `CHANCE` is larger; FRFs of a local model have residuals of one deviation."""
SPREAD = 3.0
"""The same for a spread of poles, whose error is known better: it is the shift of the pole itself, without a factor
like `HEIGHT`."""
LEANS = 2.0
"""Imaginary over real part of the factor from which on the frequency depends on the amplitude: it decides between
`leaning` and `feedback`, not whether the peak is named."""
LOSS = 1.0
"""Spread of the poles over the part that is not causal from which on the damping depends on the amplitude: a slipping
joint has about 4, noise in the force 0.4 at most."""
FEWEST = 12
"""Lines around a mode from which on the shape of its residual is examined: twice the six complex functions that are
fitted to it."""
AVERAGED = 0.5
"""Energy of third differences of the residuals of neighbouring lines between the peaks, over that of lines three apart,
below which lines were averaged: 1 for independent lines, 0.2 for the mean of three, above 1 for windows."""

SAME_SHAPE = 0.8
"""MAC of the residues of a pole and a mode from which on they have one shape: of two random real shapes over three FRFs
11 % have as much, over six 0.7 % (beta distribution). Nearness of the poles is asked for as well, and `SCATTERS`."""
SCATTERS = 3.0
"""Distance of the MAC from 1, over what the uncertainty of both shapes makes it, beyond which they are two shapes.
A part of a peak has its shape but for noise: leaning peaks, friction and noise in the force leave 0.05 to 1.9. With six
degrees of freedom (errors of a few poles make most of the scatter of a shape) chance exceeds it once in 160 times."""
PART_REACH = 1.5
"""Distance of a pole from a mode, over the sum of their decay rates, up to which it can be a part of the peak. Poles
of the growing vibrations above lie at 1 whatever their ratio; poles that stand for parts of leaning peaks, of friction
and of noise in the force lie at 0.4 to 1.2."""
FEWEST_FRFS = 3
"""FRFs from which on a shape says something: of two random real shapes over two FRFs 30 % have the MAC of
`SAME_SHAPE`."""

Kind = Literal["leaning", "feedback", "spread", "averaged", "in parts"]


@dataclass(frozen=True)
class PeakShape:
    """Residual of a pole that has the shape of its peak.

    ``kind`` is ``leaning`` (frequency or damping depend on the amplitude), ``feedback`` (noise in the force where the
    structure pulls it down), ``spread`` (of poles), ``averaged`` (over lines) or ``in parts`` (a pole that is no mode
    has a part of the peak, of which nothing says what it is); ``error`` is what that amounts to in the pole, over its
    decay rate.
    """

    pole: int
    kind: Kind
    error: float


def examine(
    optimum: Refined, errors: PoleErrors, poles: Bool[np.ndarray, "pole"], accepted: Bool[np.ndarray, "pole"]
) -> tuple[PeakShape, ...]:
    """Look at the residual around some ``poles`` of an optimum, of which some are ``accepted`` as modes.

    A pole that is no mode, next to a mode and of the same shape, stands for what is left of the peak: it counts as
    residual. Where a pole is not seen as a peak, what is left around it is that of other ones.

    Returns
    -------
    tuple of PeakShape
        One for each pole whose residual has the shape of its peak beyond noise, and beyond what its interval covers.
    """
    fit, data = optimum.fit, optimum.data
    residual = estimator.residual(data, fit)[:, 0]
    seen = estimator.shares_of_energy(data, fit)[0] >= POLICY.visible
    peaks = []
    for pole in np.flatnonzero(poles & seen):
        decay, centre = -fit.poles[pole].real, fit.poles[pole].imag
        near = np.abs(data.s.imag - centre) < REACH * decay
        lines = int(np.count_nonzero(near))
        if lines < FEWEST:
            continue
        # Residual in the coordinate of the mode, by weighted least squares over all FRFs.
        shape = fit.shapes[:, 0, pole, None] * fit.participation[:, pole]
        weight = data.weights[..., near]
        known = np.einsum("oif,oi->f", weight, np.abs(shape) ** 2)
        parts = _of_parts(fit, int(pole), errors.scatter, accepted, s=data.s[near])
        modal, of_parts = (
            np.einsum("oif,oi,oif->f", weight, shape.conj(), own) / known
            for own in (residual[..., near] + parts, parts)
        )
        x, loss = data.s[near] - 1j * centre, float(optimum.loss[pole])
        tangent = [1 / (x + decay), decay / (x + decay) ** 2, np.ones(lines) / decay, x / decay**2]
        root = np.sqrt(known)
        taken = float(np.abs(np.linalg.lstsq(np.array(tangent).T * root[:, None], of_parts * root, rcond=None)[0][1]))
        cubed = decay**2 / (x + decay) ** 3
        growing = [1 / (x - ratio * decay) for ratio in RATIOS]
        shares = [_share([*tangent, cubed], function, modal, known, loss) for function in growing]
        causal = _share([*tangent, growing[0]], cubed, modal, known, loss)
        least = min(shares, key=lambda share: share.chance)
        ratio = RATIOS[shares.index(least)]
        relative = float(errors.damping[pole]) * abs(fit.poles[pole]) / decay
        height = HEIGHT * abs(least.factor) / ratio
        if least.chance < CHANCE and height > MATTERS * relative:
            turned = abs(least.factor.imag) > LEANS * abs(least.factor.real)
            slips = causal.chance < CHANCE and -causal.shift.real > LOSS * least.factor.real > 0
            leaning = turned or slips
            peaks.append(PeakShape(int(pole), "leaning" if leaning else "feedback", float(np.hypot(height, taken))))
        elif causal.chance < CHANCE and -causal.shift.real > SPREAD * relative:
            averaged = _between_peaks(data, fit, residual, poles) < AVERAGED
            peaks.append(
                PeakShape(int(pole), "averaged" if averaged else "spread", float(np.hypot(abs(causal.shift), taken)))
            )
        elif taken > 0:
            peaks.append(PeakShape(int(pole), "in parts", taken))
    return tuple(peaks)


def _of_parts(
    fit: Fit,
    mode: int,
    scatter: Float[np.ndarray, "pole"],
    accepted: Bool[np.ndarray, "pole"],
    *,
    s: Complex[np.ndarray, "line"],
) -> Complex[np.ndarray, "out in line"]:
    """What poles that are no modes give to the peak of a mode: those near it that have its shape, as far as the
    ``scatter`` of both shapes tells.
    """
    residues = fit.shapes[:, 0, None, :] * fit.participation
    outputs, inputs, poles = residues.shape
    as_shapes = residues.reshape(outputs * inputs, poles)
    agreement = mac(as_shapes[:, [mode]], as_shapes)[0]
    alike = (agreement >= SAME_SHAPE) & (1 - agreement < SCATTERS * (scatter + scatter[mode]))
    distance, decay = np.abs(fit.poles - fit.poles[mode]), -fit.poles.real
    # A pole of the background is as wide as the band, and near to everything by its own width.
    near = (distance < PART_REACH * (decay + decay[mode])) & (distance < REACH * decay[mode])
    parts = np.flatnonzero(alike & near & ~accepted & accepted[mode] & (len(as_shapes) >= FEWEST_FRFS))
    return np.asarray(np.einsum("oip,pf->oif", residues[..., parts], 1 / (s - fit.poles[parts, None])))


def variances(shapes: tuple[PeakShape, ...], poles: Complex[np.ndarray, "pole"]) -> Float[np.ndarray, "pole 2"]:
    """Variances of natural frequency [Hz^2] and damping ratio to add."""
    result = np.zeros((len(poles), 2))
    for shape in shapes:
        size = shape.error * -poles[shape.pole].real
        result[shape.pole] = (size / (2 * np.pi)) ** 2, (size / abs(poles[shape.pole])) ** 2
    return result


_WORDS: dict[str, tuple[str, str, str]] = {
    "leaning": (
        "leaning-peak",
        mark(
            "is not that of a linear mode: a part of it is not causal, as where frequency or damping depend "
            "on the amplitude"
        ),
        mark(
            "Measure at several levels, keep the response at resonance constant, or read the decay over the amplitude."
        ),
    ),
    "feedback": (
        "force-noise",
        mark(
            "has a part that is not causal, as where the force drops at resonance and contains noise of its "
            "channel or a disturbance fed back by the shaker"
        ),
        mark("Use the signal of the generator as reference, a stronger force at resonance, or repeated periods."),
    ),
    "spread": (
        "broadened-peak",
        mark(
            "is broader than that of one pole, as where a resonance moves between records, blocks are short "
            "or a joint slips and sticks within a record"
        ),
        mark("Compare single records and impacts of different strength."),
    ),
    "averaged": (
        "smoothed-lines",
        mark("is that of an average over frequency lines"),
        mark("Fit FRFs that were not smoothed."),
    ),
}


def findings(shapes: tuple[PeakShape, ...], frequencies: Float[np.ndarray, "pole"], where: str) -> tuple[Finding, ...]:
    """A finding for each peak, with natural ``frequencies`` of all poles in Hz."""
    notes = []
    for shape in shapes:
        # The pole that is no mode has a finding of its own, as a candidate.
        if shape.kind == "in parts":
            continue
        code, what, advice = _WORDS[shape.kind]
        notes.append(
            Finding.of(
                "warning",
                code,
                f"{where}, {frequencies[shape.pole]:.6g} Hz",
                "The peak of this mode {what}; its damping ratio may be wrong by {error}; its interval was widened "
                "accordingly.",
                shape.error,
                advice="{remedy}",
                what=what,
                error=f"{shape.error:.1%}",
                remedy=advice,
            )
        )
    return tuple(notes)


@dataclass(frozen=True)
class _Share:
    """A function beside known ones in a signal: its factor, the probability of one as large by noise, and what the
    known functions have taken of it for a shift of the pole, over its decay rate.
    """

    factor: complex
    chance: float
    shift: complex


def _share(
    known: list[np.ndarray],
    function: Complex[np.ndarray, "line"],
    signal: Complex[np.ndarray, "line"],
    weight: Float[np.ndarray, "line"],
    loss: float,
) -> _Share:
    """What a function has in a signal (F test; ``loss`` is the variance by errors that are correlated over lines, over
    that by independent ones: so many lines count as one). The second of the known functions is the change of the peak
    with its pole.
    """
    root = np.sqrt(weight)
    basis, triangle = np.linalg.qr(np.array(known).T * root[:, None])

    def beside(values: Complex[np.ndarray, "line"]) -> Complex[np.ndarray, "line"]:
        scaled = values * root
        return np.asarray(scaled - basis @ (basis.conj().T @ scaled))

    own, left = beside(function), beside(signal)
    energy = max(float(np.vdot(own, own).real), np.finfo(float).tiny)
    factor = complex(np.vdot(own, left)) / energy
    freedom = 2 * (len(signal) - len(known) - 1)
    variance = loss * float(np.sum(np.abs(left - factor * own) ** 2)) / freedom / energy
    ratio = abs(factor) ** 2 / (2 * max(variance, np.finfo(float).tiny))
    shift = complex(np.linalg.solve(triangle, basis.conj().T @ (function * root))[1]) * factor
    return _Share(factor, float(scipy.stats.f.sf(ratio, 2, max(freedom / loss, 2.0))), shift)


def _between_peaks(
    data: Observations, fit: Fit, residual: Complex[np.ndarray, "out in line"], poles: Bool[np.ndarray, "pole"]
) -> float:
    """Energy of third differences of the residual between neighbouring lines over that between lines three apart, where
    no peak is near: what is smooth over lines is in neither.
    """
    away = np.abs(data.s.imag - fit.poles[poles, None].imag) > 0.5 * REACH * -fit.poles[poles, None].real
    free = np.all(away, axis=0)
    scaled = (residual * np.sqrt(data.weights)).reshape(-1, len(free))
    typical = []
    for step in (1, 3):
        span = 3 * step
        inside = np.all([free[k : len(free) - span + k] for k in range(0, span + 1, step)], axis=0)
        if np.count_nonzero(inside) < FEWEST:
            return 1.0
        parts = [scaled[:, k * step : scaled.shape[1] - span + k * step][:, inside] for k in range(4)]
        third = parts[3] - 3 * parts[2] + 3 * parts[1] - parts[0]
        typical.append(float(np.median(np.abs(third) ** 2)))
    return typical[0] / max(typical[1], np.finfo(float).tiny)
