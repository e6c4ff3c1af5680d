"""What makes the peaks of FRFs lower and broader: Hann blocks of a random test, and averages over frequency lines.

Over stationary white excitation the expected cross spectrum of blocks of length T under a window w is the transform of
h(t) r(t), with r(t) the correlation of the window with itself (Bendat and Piersol, Random Data;
Schmidt 1985), and the force spectrum is flat: H1 shows

    integral_0^T r(t) h(t) exp(-s t) dt   instead of   integral_0^inf h(t) exp(-s t) dt,

which is a peak that is lower and broader. For the Hann window, with u = t / T,

    r(u) = (1 - u) (2/3 + 1/3 cos(2 pi u)) + sin(2 pi u) / (2 pi),

and the transform of r(u) exp(p t) follows in closed form. An average over lines shows the mean of 1 / (s - p) over
these (`ema.fit.smoothing` tells from the FRFs whether they are one).

The difference is taken off the measured FRFs with the modes of a fit, which is repeated with Newton's steps until it
converges (`Feedback`). Where the force is not flat over a resonance, and for H2 and Hv, the window acts otherwise than
on H1: the intervals of these hold the values with and without the correction (`HannBlocks.known`).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.optimize
from jaxtyping import Complex, Float, Int
from scipy.sparse.csgraph import connected_components

from ema.data import FrfSet
from ema.fit import smoothing
from ema.shapes import mac
from ema.units import DERIVATIVE_ORDER

TURNS = 6
"""Corrections within which the fit has to converge. Blocks of six and of three decay times 1 / d of the slowest mode
needed three, of 1.5 to 0.7 decay times three or four.
"""
SETTLED = 0.2
"""Standard deviations by which a pole may still move from turn to turn. A 95 % interval that is off by as much holds
94.5 % (normal distribution); below it further turns change no interval that anyone reads."""
NEGLIGIBLE = 0.04
"""Energy of a correction, in units of the noise, up to which there is nothing to correct: no value would move by more
than ``SETTLED``, the root of it."""
RESOLVED = 1.5
"""Lines within which two peaks are one under a Hann window, whose half-power bandwidth is 1.44 lines (Harris 1978)."""
ALIKE = 0.9
"""MAC of residues from which on poles that close are taken as one peak, for the initial guess alone: one broadened peak
described by several poles above it, resonances of different shapes below."""
REACH = 4.0
"""Lines within which resonances take part in each other's correction: it falls with the third power of the distance, to
1/64 there of what it is one line away."""
RATES = (np.log(1e-3), np.log(1e3))
"""Logarithms of the decay rates, in block lengths, among which a first guess is looked for."""
FASTER = 3.0
"""Factor by which one step may change a decay rate: a safeguard that keeps it positive. A longer step ends there and
the next turn goes on."""
FARTHEST = 1.0
"""Lines by which Newton's step may move a pole beyond its fit: that of a peak without width, for which I - M is nearly
singular, would go anywhere."""
LARGEST = 0.5
"""Relative change of a size by Newton's step beyond its fit up to which it is taken: a safeguard. Beyond half of the
size a linear step says nothing, and the fit is taken as it is."""
LINEAR = ("H1", "Hc", "H1 less force noise")
"""Estimators that are cross-spectra over the spectrum of what drives the test: under a flat one the window acts on the
FRF alone. H2 and Hv contain the spectrum of the response, on which it acts otherwise."""
NOT_FLAT = "force-not-flat"
"""Code of the finding on FRFs whose force changes within the lines that a block averages."""
SEEN = 2.0
"""Change of a damping ratio by the correction, in its standard deviations, from which on a finding names it: smaller
ones lie within the 95 % interval. No value depends on it."""


@dataclass(frozen=True)
class HannBlocks:
    """Averaged Hann blocks of stationary excitation, each ``duration`` [s] long.

    ``known`` says that they are H1, or H1 with what stands for it, under a force that is flat over the lines that a
    block averages: only then is `resonance` what they show.
    """

    duration: float
    known: bool = True

    def resonance(
        self, s: Complex[np.ndarray, "freq one"], poles: Complex[np.ndarray, "mode"]
    ) -> Complex[np.ndarray, "freq mode"]:
        """Transform of the free vibration times the correlation of the window."""
        return self.duration * _transform((s - poles) * self.duration)


@dataclass(frozen=True)
class LineAverage:
    """Averages over neighbouring lines, ``step`` [rad/s] apart, with ``weights`` (line,), symmetric and of sum 1."""

    weights: tuple[float, ...]
    step: float

    @property
    def duration(self) -> float:
        """Time [s] of Hann blocks whose half-power bandwidth is that of a mean over lines with as large a variance."""
        lines = np.arange(len(self.weights)) - (len(self.weights) - 1) / 2
        count = float(np.sqrt(12 * (np.array(self.weights) @ lines**2) + 1))
        return RESOLVED * 2 * np.pi / (count * self.step)

    def resonance(
        self, s: Complex[np.ndarray, "freq one"], poles: Complex[np.ndarray, "mode"]
    ) -> Complex[np.ndarray, "freq mode"]:
        """Average of the resonance over lines."""
        middle = (len(self.weights) - 1) / 2
        return sum(
            (weight / (s + 1j * (line - middle) * self.step - poles) for line, weight in enumerate(self.weights)),
            start=np.zeros((len(s), len(poles)), complex),
        )


Broadening = HannBlocks | LineAverage
"""What a resonance looks like in FRFs; ``duration`` is that of Hann blocks that broaden peaks as much."""


def of(frfs: FrfSet) -> Broadening | None:
    """What has broadened the peaks of FRFs, where that is known of them or seen in them."""
    if frfs.window == "hann" and frfs.record_length is not None:
        flat = not any(finding.code == NOT_FLAT for finding in frfs.findings)
        return HannBlocks(frfs.record_length, known=flat and frfs.estimator in LINEAR)
    weights = smoothing.weights(frfs)
    return None if weights is None else LineAverage(weights, 2 * np.pi * frfs.frequency_step)


def excess(
    shown: Broadening, frfs: FrfSet, poles: Complex[np.ndarray, "mode"], residues: Complex[np.ndarray, "mode out in"]
) -> Complex[np.ndarray, "freq out in"]:
    """What is added to FRFs of modes (poles in rad/s, residues of the receptance), in their quantity."""
    s = 2j * np.pi * frfs.frequencies[:, None]
    order = DERIVATIVE_ORDER[frfs.quantity]
    result = np.zeros(frfs.values.shape, complex)
    # The n-th derivative of a free vibration has the residue p^n R; impulses at t = 0, polynomials in s, stay as they
    # are under a window and in a symmetric average.
    for p, r in ((poles, residues), (poles.conj(), residues.conj())):
        change = shown.resonance(s, p) - 1 / (s - p)
        result += np.tensordot(change, p[:, None, None] ** order * r, 1)
    return result


def initial_guess(
    shown: Broadening, frfs: FrfSet, poles: Complex[np.ndarray, "mode"], residues: Complex[np.ndarray, "mode out in"]
) -> tuple[Complex[np.ndarray, "left"], Complex[np.ndarray, "left out in"]]:
    """Poles and residues as they are, from those of broadened peaks: a first guess.

    A peak that was broadened is no resonance, and may be described by several poles next to each other. Those
    closer than such FRFs resolve and alike are taken as one: the resonance whose broadened peak is closest to the FRFs
    around it without the other poles, up to a constant.
    """
    duration, order = shown.duration, DERIVATIVE_ORDER[frfs.quantity]
    flat = residues.reshape(len(poles), -1)
    near = np.abs(poles.imag[:, None] - poles.imag) < RESOLVED * 2 * np.pi / duration
    count, group = connected_components(near & (mac(flat.T, flat.T) > ALIKE), directed=False)
    guess, total = np.empty(count, complex), np.empty((count, *residues.shape[1:]), complex)
    for number in range(count):
        members = np.flatnonzero(group == number)
        energy = np.sum(np.abs(flat[members]) ** 2, axis=1)
        frequency = float(energy @ poles.imag[members] / energy.sum())
        around = np.abs(2 * np.pi * frfs.frequencies - frequency) <= (REACH + 0.5) * 2 * np.pi / duration
        s, others = 2j * np.pi * frfs.frequencies[around], np.flatnonzero(group != number)
        curve = np.asarray(frfs.values[around]).reshape(len(s), -1)
        curve = curve - (poles[others] ** order / (s[:, None] - poles[others])) @ flat[others]
        if len(s) < 5:
            guess[number], total[number] = poles[members[0]], residues[members[0]]
            continue
        main = np.linalg.svd(curve, full_matrices=False)[0][:, 0]

        def basis(x: Float[np.ndarray, "2"], s: Complex[np.ndarray, "line"] = s, centre: float = frequency) -> Any:
            pole = (-np.exp(x[1]) + 1j * x[0]) / duration + 1j * centre
            return np.stack([shown.resonance(s[:, None], np.array([pole]))[:, 0], np.ones(len(s))], axis=1)

        def left(x: Float[np.ndarray, "2"], main: Complex[np.ndarray, "line"] = main, basis: Any = basis) -> Any:
            directions = np.linalg.qr(basis(x))[0]
            rest = main - directions @ (directions.conj().T @ main)
            return np.concatenate([rest.real, rest.imag])

        starts = [np.array([0.0, rate]) for rate in np.linspace(*RATES, 25)]
        start = min(starts, key=lambda x: float(np.linalg.norm(left(x))))
        best = scipy.optimize.least_squares(left, start, bounds=([-10, RATES[0] - 1], [10, RATES[1] + 1])).x
        guess[number] = (-np.exp(best[1]) + 1j * best[0]) / duration + 1j * frequency
        own = np.linalg.lstsq(basis(best), curve)[0][0] / guess[number] ** order
        total[number] = own.reshape(residues.shape[1:])
    return guess, total


Resonances = tuple[np.ndarray, np.ndarray]
"""Poles (mode,) in rad/s and residues (mode, out, in) of the receptance."""


def settled(before: Resonances, now: Resonances, std: Float[np.ndarray, "mode"]) -> bool:
    """Whether resonances are where they were ``before``, within their standard deviations [rad/s]."""
    partner = _partners(before, now)
    if len(before[0]) != len(now[0]) or np.any(partner < 0):
        return False
    return bool(np.all(np.abs(now[0] - before[0][partner]) <= SETTLED * std))


@dataclass(frozen=True)
class Feedback:
    """How far the poles and sizes of resonances, taken out of corrected FRFs, follow those of the correction itself.

    The correction E of a resonance changes with its pole p and size c as the resonance K does. Where the fit of
    corrected FRFs moves by M d(p, c) when the correction is that of a resonance d(p, c) away,

        M = -(K'^H W K')^-1 K'^H W E',

    the solution lies (I - M)^-1 times as far away as the fit says, and so do the errors of the fit: of a peak that the
    window has made little narrower than itself most of the width is the correction's.

    ``groups`` are resonances closer than ``REACH`` lines, ``gains`` their (I - M)^-1 (of poles, then of relative
    sizes), and ``variances`` (mode,) the factor on the variance of each pole; ``duration`` [s] is that of a block.
    """

    duration: float
    groups: tuple[Int[np.ndarray, "some"], ...]
    gains: tuple[Complex[np.ndarray, "twice twice"], ...]
    variances: Float[np.ndarray, "mode"]

    def solution(self, before: Resonances, fitted: Resonances) -> Resonances:
        """Where resonances are their own correction (Newton's step), from those ``before`` and those ``fitted`` then.

        A resonance that was not there before stays where it is.
        """
        poles, residues = fitted[0].copy(), fitted[1].copy()
        partner = _partners(before, fitted)
        for group, gain in zip(self.groups, self.gains, strict=True):
            if np.any(partner[group] < 0):
                continue
            former, pole = partner[group], fitted[0][group]
            flat = fitted[1][group].reshape(len(group), -1)
            size = np.sum(flat.conj() * before[1][former].reshape(len(group), -1), axis=1)
            size /= np.maximum(np.sum(np.abs(flat) ** 2, axis=1), np.finfo(float).tiny)
            moved = np.concatenate([pole - before[0][former], 1 - size])
            of_pole, of_size = np.split(gain @ moved - moved, 2)
            # Beyond these a linear step says nothing: there the fit is taken as it is.
            far = np.abs(of_pole) > FARTHEST * 2 * np.pi / self.duration
            if np.any(far) or np.any(np.abs(of_size) > LARGEST):
                continue
            rate = np.clip(-(pole + of_pole).real, -pole.real / FASTER, -pole.real * FASTER)
            poles[group] = -rate + 1j * (pole + of_pole).imag
            residues[group] *= (1 + of_size)[:, None, None]
        return poles, residues


def feedback(
    shown: Broadening,
    frfs: FrfSet,
    poles: Complex[np.ndarray, "mode"],
    residues: Complex[np.ndarray, "mode out in"],
    weights: Float[np.ndarray, "freq out in"],
) -> Feedback:
    """What the correction of resonances feeds back into their fit to receptances with ``weights``, on the last lines of
    ``frfs``.
    """
    duration, order = shown.duration, DERIVATIVE_ORDER[frfs.quantity]
    s = 2j * np.pi * frfs.frequencies[-len(weights) :, None]
    near = np.abs(poles.imag[:, None] - poles.imag) < REACH * 2 * np.pi / duration
    count, number = connected_components(near, directed=False)
    groups = tuple(np.flatnonzero(number == group) for group in range(count))

    def correction(p: Complex[np.ndarray, "mode"]) -> Complex[np.ndarray, "freq mode"]:
        return np.asarray((shown.resonance(s, p) - 1 / (s - p)) * (p / s) ** order)

    step = 1e-4 / duration
    resonance = np.concatenate([(s - poles) ** -2, 1 / (s - poles)], axis=1)
    change = (correction(poles + step) - correction(poles - step)) / (2 * step)
    change = np.concatenate([change, correction(poles)], axis=1)
    gains, variances = [], np.ones(len(poles))
    for group in groups:
        both = np.concatenate([group, len(poles) + group])
        flat = residues[group]
        shared = np.einsum("foi,aoi,boi->fab", weights, flat.conj(), flat, optimize=True)
        shared = np.tile(shared, (1, 2, 2))
        k, e = resonance[:, both], change[:, both]
        information = np.einsum("fa,fab,fb->ab", k.conj(), shared, k, optimize=True)
        other = np.einsum("fa,fab,fb->ab", k.conj(), shared, e, optimize=True)
        inverse = np.linalg.pinv(information, hermitian=True)
        gain = np.linalg.pinv(np.eye(len(both)) + inverse @ other)
        spread = np.einsum("ab,bc,ac->a", gain, inverse, gain.conj()).real / np.diag(inverse).real
        gains.append(gain)
        variances[group] = np.maximum(spread[: len(group)], 1)
    return Feedback(duration, groups, tuple(gains), variances)


def _partners(before: Resonances, fitted: Resonances) -> Int[np.ndarray, "mode"]:
    """Number of the former resonance that each resonance is, -1 where there is none or not one alone."""
    if not len(before[0]):
        return np.full(len(fitted[0]), -1)
    distance = np.abs(fitted[0][:, None] - before[0])
    nearest, back = np.argmin(distance, axis=1), np.argmin(distance, axis=0)
    alike = mac(fitted[1].reshape(len(fitted[0]), -1).T, before[1].reshape(len(before[0]), -1).T)
    rows = np.arange(len(nearest))
    return np.where((back[nearest] == rows) & (alike[rows, nearest] > ALIKE), nearest, -1)


def _transform(a: Complex[np.ndarray, "freq mode"]) -> Complex[np.ndarray, "freq mode"]:
    """Integral over u from 0 to 1 of r(u) exp(-a u)."""
    turn = 2j * np.pi
    falling = sum(weight * _ramp(a + shift) for weight, shift in ((2 / 3, 0), (1 / 6, turn), (1 / 6, -turn)))
    result: np.ndarray = falling + (1 - np.exp(-a)) / (a**2 + 4 * np.pi**2)
    return result


def _ramp(a: Complex[np.ndarray, "freq mode"]) -> Complex[np.ndarray, "freq mode"]:
    """Integral over u from 0 to 1 of (1 - u) exp(-a u)."""
    near = np.abs(a) < 1e-2
    safe = np.where(near, 1.0, a)
    series = 0.5 - a / 6 + a**2 / 24 - a**3 / 120
    return np.where(near, series, (safe - 1 + np.exp(-safe)) / safe**2)
