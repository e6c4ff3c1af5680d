"""Channels that are late or behind a high-pass filter: what they do to the phases of the residues.

The residues of a structure with damping proportional to mass and stiffness are imaginary. A channel that is late by t
turns them by -w t at the pole -d + j w, whatever the damping: the residue of H(s) exp(-s t) is that of H times
exp(d t) exp(-j w t). A high-pass filter of first order (an AC-coupled input, a charge amplifier) with its corner at w_c
turns them by arctan(w_c / w). Complex modes turn residues too, by angles that have nothing to do with the frequency.
Their scatter is found together with the turns of all channels, as that of Student's distribution, for few modes of a
structure are much more complex than the others (Lange, Little and Taylor, Journal of the American Statistical
Association 84, 1989).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy.stats
from jaxtyping import Bool, Complex, Float, Int

from ema.data import Finding, ModalModel
from ema.dof import Dof
from ema.messages import mark

EVIDENCE = 13.0
"""Twice the logarithm of the likelihood ratio from which on one channel that is asked alone is turned; of n channels
2 log n more, and for a delay that turns the highest mode by an angle a another 2 log(1 + a / 0.4): so many more angles
could have been found by chance. Of 500 random structures in time 4 were named; of 196 late ones 135 with the right
channels. With 17, before what most rows share was taken off, 121 instead of 130 were, and 4 instead of 6 in time."""

FREEDOM = 4.0
"""Degrees of freedom of the distribution of the complexity of residues, with tails as of two kinds of modes in one
structure. Not varied by itself: what half or twice as many change has not been counted."""

SCATTERS = np.geomspace(0.005, 0.6, 14)
"""Ratios of real to imaginary part of residues by complex modes that are tried. The least, 0.3 degrees, is that below
which nothing is claimed of a measured structure; at the largest one any phase may occur."""

USUAL, SPREAD = 0.05, 1.5
"""Median and logarithmic standard deviation of the scatter, the ratio of real to imaginary part of residues, before
anything is measured: 95 % of structures lie between 0.25 and 95 %, ``USUAL * exp(2 * SPREAD)`` and its reverse. A wide
prior, and not a calibration: several modes outweigh it."""

FURTHEST = 40.0
"""Turn of the highest mode [rad] up to which delays are looked for: 2 ms at 3 kHz. Longer ones are not found."""

ALIKE = 1.0
"""The same where there are two modes: both are turned to the imaginary axis by many a delay."""

EXCLUDED = float(scipy.stats.chi2.isf(0.05, 1))
"""Twice the logarithm of the likelihood ratio, over the scatter of a row's own, from which on 95 % exclude a value."""

_STEP = 0.25
"""Turn of the highest mode [rad] between the delays that are tried: none is farther than 0.125 rad (7 degrees) from a
start of Newton's steps."""
_STEPS_OF_NEWTON = 5
"""Steps from there to the best value near by: a bound on the work. A value that has not converged has a higher cost,
and counts with that."""
_STARTS = (0.03, 0.2)
"""Scatters for which the best of these are looked for: a small one for late channels among modes in phase, a large one
for those among complex modes."""
_AT_ONCE = 100_000
"""Values that are worked on at a time: memory alone, no value depends on it."""

Residues = Complex[np.ndarray, "mode row column"]
Kind = Literal["delay", "high-pass"]


@dataclass(frozen=True)
class Turn:
    """What turns the channel at a DOF, a ``force`` or a response, in ``row`` of the model's inputs or of its DOFs.

    ``value`` is its delay [s] or the corner of its filter [rad/s]; ``half`` that of the 95 % interval.
    """

    kind: Kind
    dof: Dof
    row: int
    of_inputs: bool
    force: bool
    value: float
    half: float


@dataclass(frozen=True)
class _Cause:
    """Angles by which a cause of some value turns poles, their slope over the value, the values to begin with, and how
    surprising a value is (`EVIDENCE`), infinitely where it is none.
    """

    kind: Kind
    angle: Callable[[np.ndarray, np.ndarray], np.ndarray]
    slope: Callable[[np.ndarray, np.ndarray], np.ndarray]
    grid: Callable[[np.ndarray], np.ndarray]
    surprise: Callable[[np.ndarray, np.ndarray], np.ndarray]


def _furthest(omega: Float[np.ndarray, "mode ..."]) -> float:
    return FURTHEST if len(omega) > 2 else ALIKE


def _delays(omega: Float[np.ndarray, "mode ..."]) -> Float[np.ndarray, "value"]:
    turns = np.arange(_STEP, _furthest(omega) + _STEP, _STEP)
    return np.asarray(np.concatenate([-turns[::-1], [0.0], turns]) / omega.max())


def _surprise(omega: Float[np.ndarray, "mode ..."], delay: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    turn = np.abs(delay) * omega.max()
    return np.asarray(np.where(turn < _furthest(omega), 2 * np.log1p(turn / 0.4), np.inf))


_CAUSES = (
    _Cause(
        "delay",
        angle=lambda omega, value: -omega * value,
        slope=lambda omega, value: -omega + 0 * value,
        grid=_delays,
        surprise=_surprise,
    ),
    _Cause(
        "high-pass",
        angle=lambda omega, value: np.arctan(value / omega),
        slope=lambda omega, value: omega / (omega**2 + value**2),
        grid=lambda omega: np.geomspace(0.02 * omega.min(), omega.max(), 30),
        surprise=lambda omega, value: np.where(value > 0, 0.0, np.inf),
    ),
)


@dataclass(frozen=True)
class _Explained:
    """The best explanation of residues: cause (-1 for none), value and half of the interval of each row, its cost."""

    cause: Int[np.ndarray, "row"]
    value: Float[np.ndarray, "row"]
    half: Float[np.ndarray, "row"]
    cost: float


def turns(model: ModalModel, roving_forces: bool = False) -> tuple[Turn, ...]:
    """What turns responses and forces of a model, whose DOFs are those of the forces where these rove.

    All rows that share a delay are turned by the force (the sensor). What most rows share has to be beyond the scatter
    of the modes, for the complexity of the shape at the force turns all rows alike. A value within its half interval
    is none.
    """
    residues, omega = model.residues(), model.poles.imag
    if len(omega) < 2 or not residues.size:
        return ()
    noise = np.zeros(residues.shape)
    if model.uncertainty is not None:
        noise = 0.5 * np.trace(model.uncertainty.residues, axis1=-2, axis2=-1)
    found = []
    sign = -1.0 if roving_forces else 1.0  # of the delay of a row in that of an FRF
    best = _explained(residues, noise, omega)
    for column, dof in enumerate(model.inputs if len(model.dofs) > 1 else ()):
        shared = _together(residues[:, :, [column]], noise[:, :, [column]], omega)
        if shared.cause[0] != 0 or abs(shared.value[0]) <= shared.half[0]:
            continue
        turned = residues.copy()
        turned[:, :, column] *= np.exp(1j * omega * shared.value[0])[:, None]
        rest = _explained(turned, noise, omega)
        if rest.cost + EVIDENCE < best.cost:
            residues, best = turned, rest
            delay, half = -sign * float(shared.value[0]), float(shared.half[0])
            found.append(Turn("delay", dof, column, True, not roving_forces, delay, half))
    still = best.cause < 0
    if len(still) > 2 and still.all() and not found:
        still = _beside(residues, noise, omega, still).cause < 0
    if 2 < len(still) < 2 * still.sum() < 2 * len(still):
        best = _beside(residues, noise, omega, still)
    for number, cause in enumerate(_CAUSES):
        own = np.flatnonzero((best.cause == number) & (np.abs(best.value) > best.half))
        filtered = cause.kind == "high-pass"
        most = 2 * len(own) > len(model.dofs) > 1  # what all responses do may be the structure
        if most and (filtered or _together(residues[:, own], noise[:, own], omega).cause[0] != 0):
            continue
        for row in own.tolist() if not (filtered and roving_forces) else ():
            value = float(best.value[row]) * (1.0 if filtered else sign)
            found.append(Turn(cause.kind, model.dofs[row], row, False, roving_forces, value, float(best.half[row])))
    return tuple(found)


def _beside(
    residues: Residues,
    noise: Float[np.ndarray, "mode row column"],
    omega: Float[np.ndarray, "mode"],
    still: Bool[np.ndarray, "row"],
) -> _Explained:
    """What explains the phases beside those that the rows ``still`` share, as by the complexity of a force's shape."""
    gain = np.sqrt(_product(np.abs(residues) ** 2)[1])
    square = np.sum((residues / gain)[:, still] ** 2, axis=1, keepdims=True)
    return _explained(residues * np.exp(-0.5j * np.angle(-square)), noise, omega)


def _together(
    residues: Residues, noise: Float[np.ndarray, "mode row column"], omega: Float[np.ndarray, "mode"]
) -> _Explained:
    """What explains the phases that the residues of all rows have in common."""
    gain = np.sqrt(_product(np.abs(residues) ** 2)[1])
    mean = np.sqrt(np.mean((residues / gain) ** 2, axis=1, keepdims=True))
    return _explained(mean, np.mean(noise / gain**2, axis=1, keepdims=True) / len(gain), omega)


def _over_columns(
    residues: Residues, noise: Float[np.ndarray, "mode row column"]
) -> tuple[Complex[np.ndarray, "mode row"], Float[np.ndarray, "mode row"]]:
    """Residues, and their noise, with the mean phase of all columns: a shape turns all of them by the same angle, so
    that they are one observation of it, whatever their number. The weights are those of the usual scatter and noise.
    """
    if residues.shape[2] == 1:
        return residues[..., 0], noise[..., 0]
    power = np.abs(residues) ** 2
    weight = 1 / np.maximum(USUAL**2 * power.mean(axis=0) + noise.mean(axis=0), 1e-300)
    error = np.sum(weight**2 * power * noise, axis=2) / np.maximum(np.sum(weight * power, axis=2), 1e-300)
    return np.sqrt(np.sum(weight * residues**2, axis=2)), error


def _product(
    power: Float[np.ndarray, "mode *channel"],
) -> tuple[Float[np.ndarray, "mode *channel"], Float[np.ndarray, "*channel"]]:
    """Power as a product of mode and channel, and the factor of the channel: sensitivities change no phase."""
    gain = np.ones(power.shape[1:])
    for _ in range(10):
        mode = np.mean(power / gain, axis=1, keepdims=True)
        gain = np.maximum(np.mean(power / np.maximum(mode, 1e-300), axis=0), 1e-300)
    return np.asarray(mode * gain), gain


def _explained(
    residues: Residues, noise: Float[np.ndarray, "mode row column"], omega: Float[np.ndarray, "mode"]
) -> _Explained:
    """Causes and values of all rows, with that scatter of the phases by complex modes for which they cost least."""
    residues, noise = _over_columns(residues, noise)
    power = np.maximum(_product(np.abs(residues) ** 2)[0], 1e-300)
    modes, rows = residues.shape
    omega = omega[:, None]
    evidence = EVIDENCE + 2 * np.log(rows)

    def variance(scatter: float) -> Float[np.ndarray, "mode row"]:
        return np.asarray(scatter**2 * power + noise)

    levels = [1 / (FREEDOM * variance(scatter)) for scatter in _STARTS]

    def turned(cause: _Cause, value: Float[np.ndarray, "*start row"]) -> tuple[np.ndarray, np.ndarray]:
        """Real and imaginary parts of the residues with the turn taken back."""
        angle = cause.angle(omega, value[..., None, :])
        cos, sin = np.cos(angle), np.sin(angle)
        return residues.real * cos + residues.imag * sin, residues.imag * cos - residues.real * sin

    def misfit(real: np.ndarray, level: np.ndarray) -> Float[np.ndarray, "*start row"]:
        return np.asarray((FREEDOM + 1) * np.sum(np.log1p(real**2 * level), axis=-2))

    def in_parts(grid: Float[np.ndarray, "start 1"]) -> list[np.ndarray]:
        """Starts that are worked on at a time, one at least."""
        return np.array_split(grid, min(len(grid), -(-len(grid) * residues.size // _AT_ONCE)))

    def starts(cause: _Cause) -> Float[np.ndarray, "start row"]:
        grid, cost = cause.grid(omega)[:, None], []
        for part in in_parts(grid):
            real, _ = turned(cause, part)
            cost.append([misfit(real, level) + cause.surprise(omega, part) for level in levels])
        return np.asarray(grid[np.argmin(np.concatenate(cost, axis=1), axis=1), 0])

    def stepped(
        cause: _Cause, value: Float[np.ndarray, "start row"], level: np.ndarray
    ) -> Float[np.ndarray, "start row"]:
        """Values after a step of Gauss and Newton."""
        (real, imaginary), slope = turned(cause, value), cause.slope(omega, value[..., None, :])
        weight, along = level / (1 + level * real**2), slope * imaginary
        change = np.sum(weight * real * along, axis=-2)
        return np.asarray(value - change / np.maximum(np.sum(weight * along**2, axis=-2), 1e-300))

    def refined(
        cause: _Cause, value: Float[np.ndarray, "start row"], level: np.ndarray
    ) -> tuple[Float[np.ndarray, "start row"], Float[np.ndarray, "start row"]]:
        """Values after steps of Gauss and Newton, and their cost."""
        for _ in range(_STEPS_OF_NEWTON):
            value = stepped(cause, value, level)
        return value, misfit(turned(cause, value)[0], level) + evidence + cause.surprise(omega, value)

    def rivals(cause: _Cause, value: Float[np.ndarray, "row"], scatter: float, own: np.ndarray) -> np.ndarray:
        """How far values lie off that explain a row as well, for the scatter of its own: a likelihood has many tops."""
        level, grid = 1 / (FREEDOM * variance(scatter)), cause.grid(omega)[:, None]
        least = misfit(turned(cause, value)[0], level) + cause.surprise(omega, value)
        furthest = np.zeros(rows)
        for begin in in_parts(grid):
            part = np.broadcast_to(begin, (len(begin), rows))
            for _ in range(_STEPS_OF_NEWTON):
                part = stepped(cause, part, level)
            price = misfit(turned(cause, part)[0], level) + cause.surprise(omega, part)
            with np.errstate(invalid="ignore"):
                alike = price - least <= EXCLUDED * own
            furthest = np.maximum(furthest, np.max(np.where(alike, np.abs(part - value), 0.0), axis=0))
        return furthest

    first = [starts(cause) for cause in _CAUSES]
    tried = []
    for scatter in SCATTERS:
        level = 1 / (FREEDOM * variance(scatter))
        common = -np.sum(np.log(FREEDOM * level * power)) + (np.log(scatter / USUAL) / SPREAD) ** 2
        cause, value, cost = np.full(rows, -1), np.zeros(rows), misfit(residues.real, level)
        for number, begin in enumerate(first):
            for own, price in zip(*refined(_CAUSES[number], begin, level), strict=True):
                better = price < cost
                cause, value = np.where(better, number, cause), np.where(better, own, value)
                cost = np.where(better, price, cost)
        tried.append((float(cost.sum() + common), cause, value, scatter))
    total, cause, value, scatter = min(tried, key=lambda one: one[0])
    freedom = max(rows * (modes - 1), 1)
    every = np.arange(rows)
    slopes = np.array([one.slope(omega, value) for one in _CAUSES])[cause, :, every].T
    # Fisher's information of Student's distribution; a row that scatters more than the others is less certain
    known = np.sum(slopes**2 * np.abs(residues) ** 2 / variance(scatter), axis=0)
    known *= (FREEDOM + 1) / (FREEDOM + 3)
    left = np.array([turned(one, value)[0] ** 2 for one in _CAUSES])[cause, :, every].T
    own = np.sum(left / variance(scatter), axis=0) / max(modes - 1, 1)
    own = np.maximum(own, 1.0)
    half = scipy.stats.t.isf(0.025, freedom) * np.sqrt(own / np.maximum(known, 1e-300))
    for number, one in enumerate(_CAUSES):
        near = np.flatnonzero(cause == number)
        if len(near):
            half[near] = np.maximum(half[near], rivals(one, value, scatter, own)[near])
    return _Explained(cause, value, half, total)


def widened(model: ModalModel, found: tuple[Turn, ...]) -> ModalModel:
    """The model with the turn of each channel in the intervals of its residues and shapes."""
    stated = model.uncertainty
    if not found or stated is None:
        return model
    residues, shapes, participation = (np.array(one) for one in (stated.residues, stated.shapes, stated.participation))
    for one in found:
        angle = next(cause for cause in _CAUSES if cause.kind == one.kind).angle(model.poles.imag, np.array(one.value))
        if one.of_inputs:
            residues[:, :, one.row] += _turned(model.residues()[:, :, one.row], angle[:, None])
            participation[:, one.row] += _turned(model.participation[one.row], angle)
        else:
            residues[:, one.row] += _turned(model.residues()[:, one.row], angle[:, None])
            shapes[:, one.row] += _turned(model.shapes[one.row], angle)
    return replace(model, uncertainty=replace(stated, residues=residues, shapes=shapes, participation=participation))


def _turned(
    values: Complex[np.ndarray, "*shape"], angle: Float[np.ndarray, "*angle"]
) -> Float[np.ndarray, "*shape 2 2"]:
    """Covariance of real and imaginary part of values that may as well be turned by an angle."""
    result = 0.0
    for size, direction in ((np.sin(angle), 1j), (1 - np.cos(angle), 1.0)):
        error = values * size * direction
        parts = np.stack([error.real, error.imag], axis=-1)
        result = result + parts[..., :, None] * parts[..., None, :]
    return np.asarray(result)


def findings(found: tuple[Turn, ...], where: str) -> tuple[Finding, ...]:
    """A finding for each channel that is turned."""
    return tuple(_late(one, where) if one.kind == "delay" else _filtered(one, where) for one in found)


def _late(one: Turn, where: str) -> Finding:
    return Finding.of(
        "warning",
        "channel-delay",
        f"{where}, {one.dof}",
        "From the phases of the modes this channel is {delay} ± {half} us {sense} relative to {against}.",
        one.value,
        one.half,
        advice="Check the filters and the sampling of the channel; shapes and residues there are turned by it.",
        delay=f"{1e6 * abs(one.value):.3g}",
        half=f"{1e6 * one.half:.2g}",
        sense=mark("late") if one.value > 0 else mark("early"),
        against=mark("all responses to it") if one.force else mark("the force"),
    )


def _filtered(one: Turn, where: str) -> Finding:
    corner = one.value / (2 * np.pi)
    return Finding.of(
        "warning",
        "channel-high-pass",
        f"{where}, {one.dof}",
        "the phase rises towards low frequencies as by a high-pass filter at {corner} Hz that the force does not have: "
        "shapes and residues are turned there.",
        corner,
        one.half / (2 * np.pi),
        advice="Couple the channel directly, or give force and responses the same filter.",
        corner=f"{corner:.2g}",
    )
