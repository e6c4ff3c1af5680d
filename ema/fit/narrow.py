"""Peaks of few frequency lines: modes that bins have averaged away, and tones that are no modes."""

import numpy as np
from jaxtyping import Bool, Complex, Float

from ema.data import damping_ratios
from ema.fit import estimator, output_correlation
from ema.fit.candidates import inside
from ema.fit.estimator import Fit, Observations
from ema.fit.line_correlation import LineCorrelation
from ema.fit.policy import POLICY

_WIDTHS = (1, 3, 9, 27)
"""Lines over which the energy of the residual is added up; the bins of the selection resolve what is wider. In steps of
three, a peak is at most 1.7 times as wide, or as narrow, as one of them."""
_PROMINENT = 4.0
"""Energy of the residual within such a width, in standard deviations of what noise gives, from which on a peak is
fitted there. It only saves time: what a mode has to explain corresponds to more in a single FRF, and to as much in a
few hundred."""
_MOST = 16
"""Places that are tried in one turn, the most prominent first: a bound on the work."""
_AROUND = 4
"""Widths on each side of such a place whose lines are fitted: the flanks of the peak. More would cost work."""
_BESIDE = 3.0
"""Lines on each side of a pole narrower than a line whose residual is its own: a peak may be narrower than a pole."""
_NARROW, _CAUTION = 3.0, 2.0
"""Bandwidth in lines below which a pole on another one's peak must explain more, and how much more. There noise is
largest, and the few lines of the peak tell it badly."""
_FEW, _REACH = 10.0, 3.0
"""Lines within the bandwidth of a peak that are few, and decay rates from its pole that are on it: with noise in
proportion to the FRF, four fifths of what the peak makes of noise lie there (2/pi arctan 3)."""
_SAME = 0.9
"""MAC of two shapes, and of two participation vectors, from which on both poles may be of one mode, as elsewhere in the
search: of two random real shapes over six outputs 0.1 % have as much (beta distribution)."""
TONE = "it lives in one frequency line and its neighbours"
"""Why a tone is left out."""
_FLANK = 4.0
"""Evidence, in standard deviations, that the flanks of a narrow peak have to give for a resonance. Of tones 1 in 30,000
gives as much (normal distribution, one-sided)."""


def narrow_peaks(
    data: Observations, fit: Fit, band: tuple[float, float]
) -> tuple[Complex[np.ndarray, "new"], Complex[np.ndarray, "new in"]]:
    """Poles, and their participation, of narrow peaks that the residual of single lines still shows beyond noise.

    A mode of one residue matrix of rank one at a place where the energy of the residual is large; what else the model
    could do about it is not asked, for such peaks are narrower than everything else.
    """
    factor = max(fit.variance_factor(data), np.finfo(float).tiny)
    energy = estimator.profile(data, fit)[0].mean(axis=0) / (2 * factor)
    frfs, lines = data.outputs * data.references, LineCorrelation.of_noise(data, fit)
    limit = factor * output_correlation.limit_for_mode(data, fit)
    sharp = fit.poles[-2 * fit.poles.real <= data.line]
    found: list[tuple[float, complex, np.ndarray]] = []
    for line, width in _prominent(energy, frfs):
        trials = _trials(data, line, width)
        beside = np.all(np.abs(trials[:, None] - sharp) > _BESIDE * data.line, axis=1)
        trials = trials[beside & inside(trials, band) & (damping_ratios(trials) <= POLICY.heaviest)]
        if not len(trials):
            continue
        gain, vectors = _gains(data, fit, trials, slice(max(line - _AROUND * width - 4, 0), line + _AROUND * width + 5))
        merit = gain / (limit * lines.factor(trials) * caution(trials, fit.poles, data.line))
        best = int(np.argmax(merit))
        if merit[best] > 1:
            found.append((float(merit[best]), complex(trials[best]), vectors[best]))
    chosen: list[tuple[float, complex, np.ndarray]] = []
    for one in sorted(found, key=lambda each: -each[0]):
        if all(abs(one[1] - other[1]) > 4 * (abs(one[1].real) + abs(other[1].real)) for other in chosen):
            chosen.append(one)
    return (
        np.array([pole for _, pole, _ in chosen], complex),
        np.array([vector for *_, vector in chosen], complex).reshape(len(chosen), data.references),
    )


def _prominent(energy: Float[np.ndarray, "line"], frfs: int) -> list[tuple[int, int]]:
    """Lines, and widths, at which more energy is than noise gives; ``energy`` is 1 on average, over ``frfs`` FRFs."""
    found = []
    for width in _WIDTHS:
        if width > len(energy) // 4:
            break
        # The energy of a complex value of noise has a standard deviation as large as its mean.
        beyond = (np.convolve(energy, np.ones(width) / width, mode="same") - 1) * np.sqrt(frfs * width)
        peaks = 1 + np.flatnonzero((beyond[1:-1] >= beyond[:-2]) & (beyond[1:-1] > beyond[2:]))
        found += [(float(beyond[line]), int(line), width) for line in peaks if beyond[line] > _PROMINENT]
    chosen: list[tuple[int, int]] = []
    for _, line, width in sorted(found, reverse=True):
        if all(abs(line - other) > max(width, wide) for other, wide in chosen):
            chosen.append((line, width))
    return chosen[:_MOST]


def _trials(data: Observations, line: int, width: int) -> Complex[np.ndarray, "trial"]:
    """Trial poles at a line: half-power bandwidths of a third to all of the width, places over its middle half."""
    offsets = np.linspace(-0.5, 0.5, 5) * max(width / 2, 1)
    decays = 0.5 * np.array([0.3, 1.0]) * width
    return np.asarray((data.s[line] + data.line * (1j * offsets[:, None] - decays[None, :])).reshape(-1))


def _gains(
    data: Observations, fit: Fit, trials: Complex[np.ndarray, "trial"], lines: slice
) -> tuple[Float[np.ndarray, "trial"], Complex[np.ndarray, "trial in"]]:
    """Energy of the residual that a mode at each trial pole alone takes off, and its participation."""
    there = data.lines(lines)
    shape = 1 / (there.s - trials[:, None])
    matched, norm = [], []
    for rows in there.row_blocks(there.signals[0].size * len(trials), estimator.VALUES):
        weights = there.weights[rows]
        left = estimator.residual(there, fit, rows)[:, 0]
        matched.append(np.einsum("oil,tl->toi", weights * left, shape.conj()))
        norm.append(np.einsum("oil,tl->toi", weights, np.abs(shape) ** 2))
    size = np.maximum(np.concatenate(norm, axis=1), np.finfo(float).tiny)
    _, singular, right = np.linalg.svd(np.concatenate(matched, axis=1) / np.sqrt(size), full_matrices=False)
    return singular[:, 0] ** 2, right[:, 0]


def caution(
    poles: Complex[np.ndarray, "pole"], others: Complex[np.ndarray, "other"], line: float
) -> Float[np.ndarray, "pole"]:
    """How much more than usual poles have to explain: narrow ones that sit on the narrow peak of another one.

    There noise is largest, and the few lines of the peak tell it badly. ``line`` is the distance of lines in the unit
    of the poles.
    """
    return np.where(on_narrow_peak(poles, others, line) & (-2 * poles.real < _NARROW * line), _CAUTION, 1.0)


def on_narrow_peak(
    poles: Complex[np.ndarray, "pole"], others: Complex[np.ndarray, "other"], line: float
) -> Bool[np.ndarray, "pole"]:
    """Which poles lie on a peak of another one that few lines tell."""
    peaks = others[-2 * others.real < _FEW * line]
    distance = np.abs(poles[:, None] - peaks[None, :])
    distance[distance == 0] = np.inf
    return np.asarray(np.any(distance < _REACH * np.abs(peaks.real), axis=1))


def tones(data: Observations, fit: Fit, narrow: np.ndarray) -> list[int]:
    """Which of the ``narrow`` poles are tones: nothing beside the three lines of their peaks speaks for a resonance.

    So is the weaker of two within a line of each other with the same shape and participation: it makes up for what one
    pole does not describe.

    The other lines alone give a shape psi with the information M, all else adapted; the peak alone gives, from the
    information that is missing then, a shape q that does not know of these lines. Where there is nothing but a peak,
    q M psi / sqrt(q M q) is normal with unit variance and a mean of zero; a resonance shows its shape there again.
    """
    factor = max(fit.variance_factor(data), np.finfo(float).tiny)
    gain, found = estimator.gains(data, fit) if len(narrow) else np.zeros(0), []
    for pole in map(int, narrow):
        stronger = np.flatnonzero((np.abs(fit.poles - fit.poles[pole]) < data.line) & (gain > gain[pole]))
        if any(_alike(fit, pole, int(other)) for other in stronger):
            found.append(pole)
            continue
        masked = data.without_lines(float(fit.poles[pole].imag))
        beside = estimator.evaluate(masked, fit.poles, fit.participation, fit.terms, (fit.shapes, fit.rest))
        (of_all, shape), (of_flanks, again) = _shape(fit, pole), _shape(beside, pole)
        if not np.isfinite(of_all).all() or not np.isfinite(of_flanks).all():
            continue  # the rest of the model describes the pole, which `determined` takes out
        at_peak = np.linalg.solve(
            of_all - of_flanks, np.einsum("rab,rbm->ram", of_all, shape) - np.einsum("rab,rbm->ram", of_flanks, again)
        )
        evidence = float(np.einsum("ram,rab,rbm->", at_peak, of_flanks, again))
        energy = float(np.einsum("ram,rab,rbm->", at_peak, of_flanks, at_peak))
        if evidence <= _FLANK * np.sqrt(factor * max(energy, 0.0)):
            found.append(pole)
    return found


def _alike(fit: Fit, one: int, other: int) -> bool:
    """Whether two poles have the same shape and the same participation."""
    pairs = ((fit.psi[one], fit.psi[other]), (fit.participation[:, one], fit.participation[:, other]))
    size = [float(np.vdot(a, a).real * np.vdot(b, b).real) for a, b in pairs]
    return all(abs(np.vdot(a, b)) ** 2 >= _SAME * total for (a, b), total in zip(pairs, size, strict=True))


def _shape(fit: Fit, pole: int) -> tuple[Float[np.ndarray, "row 2 2"], Float[np.ndarray, "row 2 member"]]:
    """Information of a shape with all other linear unknowns adapted, and the shape, in real and imaginary parts."""
    rows = np.array([pole, len(fit.poles) + pole])
    own = np.stack([fit.shapes[..., pole].real, fit.shapes[..., pole].imag], axis=1)
    return estimator.inverse(fit.local[:, rows[:, None], rows]), own
