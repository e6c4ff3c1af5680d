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
from scipy.special import gammaln

from ema.data import Finding, ModalModel
from ema.dof import Dof
from ema.messages import mark

EVIDENCE = 13.0
"""Twice the logarithm of the likelihood ratio from which on one channel that is asked alone is turned; of n channels
2 log n more, and for a delay that turns the highest mode by an angle a another 2 log(1 + a / 0.4): so many more angles
could have been found by chance. Rows that share a delay bring it once, and the price of their choice (`_Module`).
Calibrated on single channels. Of 200 other structures none is named in time, and 151 with all their late channels
and no other, or the force; with 17, 148 (`python -m tests.bench.late_channels --draws 200 --seed 26120177`)."""

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
_SHARED = 4
"""Delays that are tried as that of several rows: a bound on the work. A row whose delay cannot be seen in it alone may
begin far from it; of those that gain most, one begins near it."""
_COARSE = 3
"""Every how many-th of the scatters rows that share a delay are looked for with: these differ by a factor of 3."""
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
    """The best explanation of residues: cause (-1 for none) and value of each row, and what it costs."""

    cause: Int[np.ndarray, "row"]
    value: Float[np.ndarray, "row"]
    scatter: float
    cost: float


@dataclass(frozen=True)
class _Shared:
    """The delay of a group of rows, and the scatter for which it costs least."""

    group: Bool[np.ndarray, "row"]
    value: float
    scatter: float
    cost: float


def turns(model: ModalModel, roving_forces: bool = False) -> tuple[Turn, ...]:
    """What turns responses and forces of a model, whose DOFs are those of the forces where these rove.

    Rows that share a delay, half of all at most, are named together where that explains more than causes of their own.
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
    phases = _Phases(residues, noise, omega)
    best = phases.explained()
    for column, dof in enumerate(model.inputs if len(model.dofs) > 1 else ()):
        force = _common(residues[:, :, [column]], noise[:, :, [column]], omega)
        shared = force.explained()
        if shared.cause[0] != 0 or abs(shared.value[0]) <= force.halves(shared)[0]:
            continue
        turned = residues.copy()
        turned[:, :, column] *= np.exp(1j * omega * shared.value[0])[:, None]
        others = _Phases(turned, noise, omega)
        rest = others.explained()
        if rest.cost + EVIDENCE < best.cost:
            residues, phases, best = turned, others, rest
            delay, half = -sign * float(shared.value[0]), float(force.halves(shared)[0])
            found.append(Turn("delay", dof, column, True, not roving_forces, delay, half))
    still = best.cause < 0
    if len(still) > 2 and still.all() and not found:
        still = _beside(residues, noise, omega, still).explained().cause < 0
    if 2 < len(still) <= 2 * still.sum() < 2 * len(still):
        phases = _beside(residues, noise, omega, still)
        best = phases.explained()
    module = _Module(residues, noise, omega)
    group = module.found()
    if group.cost < module.one_by_one(best):
        half = module.interval(group)
        late = np.flatnonzero(group.group).tolist() if abs(group.value) > half else ()
        delay = sign * group.value
        return (*found, *(Turn("delay", model.dofs[row], row, False, roving_forces, delay, half) for row in late))
    halves = phases.halves(best)
    for number, cause in enumerate(_CAUSES):
        own = np.flatnonzero((best.cause == number) & (np.abs(best.value) > halves))
        filtered = cause.kind == "high-pass"
        most = 2 * len(own) > len(model.dofs) > 1  # what all responses do may be the structure
        if most and (filtered or _common(residues[:, own], noise[:, own], omega).explained().cause[0] != 0):
            continue
        for row in own.tolist() if not (filtered and roving_forces) else ():
            value = float(best.value[row]) * (1.0 if filtered else sign)
            found.append(Turn(cause.kind, model.dofs[row], row, False, roving_forces, value, float(halves[row])))
    return tuple(found)


def _shared_phase(residues: Residues, rows: Bool[np.ndarray, "row"]) -> Float[np.ndarray, "mode 1 column"]:
    """Angle from the imaginary axis that rows share in a mode, as by the complexity of a force's shape."""
    gain = np.sqrt(_product(np.abs(residues) ** 2)[1])
    square = np.sum((residues / gain)[:, rows] ** 2, axis=1, keepdims=True)
    return np.asarray(0.5 * np.angle(-square))


def _beside(
    residues: Residues,
    noise: Float[np.ndarray, "mode row column"],
    omega: Float[np.ndarray, "mode"],
    still: Bool[np.ndarray, "row"],
) -> "_Phases":
    """The phases beside those that the rows ``still`` share."""
    return _Phases(residues * np.exp(-1j * _shared_phase(residues, still)), noise, omega)


def _common(
    residues: Residues, noise: Float[np.ndarray, "mode row column"], omega: Float[np.ndarray, "mode"]
) -> "_Phases":
    """The phases that the residues of all rows have in common, as one row."""
    gain = np.sqrt(_product(np.abs(residues) ** 2)[1])
    mean = np.sqrt(np.mean((residues / gain) ** 2, axis=1, keepdims=True))
    return _Phases(mean, np.mean(noise / gain**2, axis=1, keepdims=True) / len(gain), omega)


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


class _Phases:
    """Residues of one mean column, and what turns of their rows cost: twice the negative logarithm of a likelihood."""

    def __init__(
        self, residues: Residues, noise: Float[np.ndarray, "mode row column"], omega: Float[np.ndarray, "mode"]
    ) -> None:
        self.residues, self.noise = _over_columns(residues, noise)
        self.power = np.maximum(_product(np.abs(self.residues) ** 2)[0], 1e-300)
        self.omega = omega[:, None]
        self.modes, self.rows = self.residues.shape

    def variance(self, scatter: float) -> Float[np.ndarray, "mode row"]:
        """Of the real parts, by complex modes and noise."""
        return np.asarray(scatter**2 * self.power + self.noise)

    def level(self, scatter: float) -> Float[np.ndarray, "mode row"]:
        """Reverse of the variance times the degrees of freedom."""
        return 1 / (FREEDOM * self.variance(scatter))

    def common(self, scatter: float) -> float:
        """Cost of a scatter: the part of the likelihood that no turn changes, and the prior."""
        width = np.sum(np.log(self.variance(scatter) / self.power))
        return float(width + (np.log(scatter / USUAL) / SPREAD) ** 2)

    def turned(self, cause: _Cause, value: Float[np.ndarray, "*start row"]) -> tuple[np.ndarray, np.ndarray]:
        """Real and imaginary parts of the residues with the turn taken back."""
        angle = cause.angle(self.omega, value[..., None, :])
        cos, sin = np.cos(angle), np.sin(angle)
        return self.residues.real * cos + self.residues.imag * sin, self.residues.imag * cos - self.residues.real * sin

    def misfit(self, real: np.ndarray, level: np.ndarray) -> Float[np.ndarray, "*start row"]:
        """Cost of real parts."""
        return np.asarray((FREEDOM + 1) * np.sum(np.log1p(real**2 * level), axis=-2))

    def cost(self, cause: _Cause, value: Float[np.ndarray, "*start row"], level: np.ndarray) -> np.ndarray:
        """Cost of values, without the evidence that a cause has to bring."""
        return np.asarray(self.misfit(self.turned(cause, value)[0], level) + cause.surprise(self.omega, value))

    def in_parts(self, grid: Float[np.ndarray, "start 1"]) -> list[np.ndarray]:
        """Starts that are worked on at a time, one at least."""
        return np.array_split(grid, min(len(grid), -(-len(grid) * self.residues.size // _AT_ONCE)))

    def starts(self, cause: _Cause) -> Float[np.ndarray, "start row"]:
        """Values of the grid that explain a row best, for each scatter to start with."""
        grid, levels = cause.grid(self.omega)[:, None], [self.level(scatter) for scatter in _STARTS]
        cost = []
        for part in self.in_parts(grid):
            real, _ = self.turned(cause, part)
            cost.append([self.misfit(real, level) + cause.surprise(self.omega, part) for level in levels])
        return np.asarray(grid[np.argmin(np.concatenate(cost, axis=1), axis=1), 0])

    def stepped(
        self, cause: _Cause, value: Float[np.ndarray, "start row"], level: np.ndarray
    ) -> Float[np.ndarray, "start row"]:
        """Values after a step of Gauss and Newton."""
        (real, imaginary), slope = self.turned(cause, value), cause.slope(self.omega, value[..., None, :])
        weight, along = level / (1 + level * real**2), slope * imaginary
        change = np.sum(weight * real * along, axis=-2)
        return np.asarray(value - change / np.maximum(np.sum(weight * along**2, axis=-2), 1e-300))

    def refined(
        self, cause: _Cause, value: Float[np.ndarray, "start row"], level: np.ndarray
    ) -> tuple[Float[np.ndarray, "start row"], Float[np.ndarray, "start row"]]:
        """Values after steps of Gauss and Newton, and their cost."""
        for _ in range(_STEPS_OF_NEWTON):
            value = self.stepped(cause, value, level)
        return value, self.cost(cause, value, level) + EVIDENCE + 2 * np.log(self.rows)

    def explained(self) -> "_Explained":
        """Causes and values of all rows, with that scatter of the phases by complex modes for which they cost least."""
        first = [self.starts(cause) for cause in _CAUSES]
        tried = []
        for scatter in SCATTERS:
            level = self.level(scatter)
            cause, value = np.full(self.rows, -1), np.zeros(self.rows)
            cost = self.misfit(self.residues.real, level)
            for number, begin in enumerate(first):
                for own, price in zip(*self.refined(_CAUSES[number], begin, level), strict=True):
                    better = price < cost
                    cause, value = np.where(better, number, cause), np.where(better, own, value)
                    cost = np.where(better, price, cost)
            tried.append(_Explained(cause, value, scatter, float(cost.sum() + self.common(scatter))))
        return min(tried, key=lambda one: one.cost)

    def halves(self, of: "_Explained") -> Float[np.ndarray, "row"]:
        """Halves of the 95 % intervals of values."""
        variance, every = self.variance(of.scatter), np.arange(self.rows)
        slopes = np.array([one.slope(self.omega, of.value) for one in _CAUSES])[of.cause, :, every].T
        # Fisher's information of Student's distribution; a row that scatters more than the others is less certain
        known = np.sum(slopes**2 * np.abs(self.residues) ** 2 / variance, axis=0) * (FREEDOM + 1) / (FREEDOM + 3)
        left = np.array([self.turned(one, of.value)[0] ** 2 for one in _CAUSES])[of.cause, :, every].T
        own = np.maximum(np.sum(left / variance, axis=0) / max(self.modes - 1, 1), 1.0)
        freedom = max(self.rows * (self.modes - 1), 1)
        half = scipy.stats.t.isf(0.025, freedom) * np.sqrt(own / np.maximum(known, 1e-300))
        for number, one in enumerate(_CAUSES):
            near = of.cause == number
            if near.any():
                half[near] = np.maximum(half, self.rivals(one, of, own))[near]
        return np.asarray(half)

    def rivals(self, cause: _Cause, of: _Explained, own: np.ndarray) -> Float[np.ndarray, "row"]:
        """How far values lie off that explain a row as well, for the scatter of its own: a likelihood has many tops."""
        level, grid = self.level(of.scatter), cause.grid(self.omega)[:, None]
        least = self.cost(cause, of.value, level)
        furthest = np.zeros(self.rows)
        for begin in self.in_parts(grid):
            part = np.broadcast_to(begin, (len(begin), self.rows))
            for _ in range(_STEPS_OF_NEWTON):
                part = self.stepped(cause, part, level)
            price = self.cost(cause, part, level)
            with np.errstate(invalid="ignore"):
                alike = price - least <= EXCLUDED * own
            furthest = np.maximum(furthest, np.max(np.where(alike, np.abs(part - of.value), 0.0), axis=0))
        return furthest


class _Module:
    """Rows that are late by the same time, as the channels of one module, beside the phases that all rows share.

    What all rows of a mode share is free, for the complexity of the shape at the force turns them alike. Where k of n
    rows are late by t it is best at k / n of their turn, so that these are seen late by t (1 - k / n), the others early
    by t k / n. Of n rows any number k up to half is as likely, and any choice of k of them: log n + log (n over k) is
    the price of the choice. The evidence is paid once, where rows with a delay of their own pay it each.
    """

    def __init__(
        self, residues: Residues, noise: Float[np.ndarray, "mode row column"], omega: Float[np.ndarray, "mode"]
    ) -> None:
        self.given = residues, noise, omega
        self.phases = _beside(residues, noise, omega, np.ones(residues.shape[1], bool))
        self.half = self.phases.rows // 2
        self.price = EVIDENCE + 2 * (np.log(self.phases.rows) + _choices(self.phases.rows))

    def row_costs(
        self, parts: Float[np.ndarray, "*#start #row"], value: Float[np.ndarray, "*#start 1"], level: np.ndarray
    ) -> Float[np.ndarray, "*start row"]:
        """Cost of each row that shows a part of the delay."""
        return self.phases.misfit(self.phases.turned(_CAUSES[0], value * parts)[0], level)

    def stepped(
        self, group: Bool[np.ndarray, "*start row"], value: Float[np.ndarray, "*start 1"], level: np.ndarray
    ) -> Float[np.ndarray, "*start 1"]:
        """Values after a step of Gauss and Newton."""
        parts = group - group.mean(axis=-1, keepdims=True)
        real, imaginary = self.phases.turned(_CAUSES[0], value * parts)
        weight, along = level / (1 + level * real**2), -self.phases.omega * imaginary * parts[..., None, :]
        change, known = (np.sum(weight * one, axis=(-2, -1)) for one in (real * along, along**2))
        return np.asarray(value - (change / np.maximum(known, 1e-300))[..., None])

    def sought(self, begin: Float[np.ndarray, "start row"], scatter: float) -> tuple[np.ndarray, float]:
        """The group and its delay that cost least, from the delays of those rows which gain most by their own."""
        delay, level = _CAUSES[0], self.phases.level(scatter)
        own, cost = self.phases.refined(delay, begin, level)
        least = np.argmin(cost, axis=0)[None]
        own, cost = (np.take_along_axis(one, least, axis=0)[0] for one in (own, cost))
        still = self.phases.misfit(self.phases.residues.real, level)
        value = own[np.argsort(cost - still)[:_SHARED], None]
        share = np.full((len(value), 1), 0.5 * self.half / self.phases.rows)
        for _ in range(_STEPS_OF_NEWTON):
            gain = self.row_costs(-share, value, level) - self.row_costs(1 - share, value, level)
            order = np.argsort(-gain, axis=1)
            won = np.cumsum(np.take_along_axis(gain, order, axis=1), axis=1)[:, : self.half]
            group = np.argsort(order, axis=1) <= np.argmax(won - self.price[1 : self.half + 1], axis=1)[:, None]
            value, share = self.stepped(group, value, level), group.mean(axis=1, keepdims=True)
        parts, paid = group - share, self.price[group.sum(axis=1)]
        paid = paid + delay.surprise(self.phases.omega, value)[:, 0]
        best = int(np.argmin(self.row_costs(parts, value, level).sum(axis=1) + paid))
        return group[best], float(value[best, 0])

    def found(self) -> _Shared:
        """The group and its delay that cost least."""
        delay, rows = _CAUSES[0], self.phases.rows
        best = _Shared(np.zeros(rows, bool), 0.0, 0.0, np.inf)
        if not self.half:
            return best
        begin = self.phases.starts(delay)
        tried = [self.sought(begin, scatter) for scatter in SCATTERS[::_COARSE]]
        tried += [(~group, -value) for group, value in tried if 2 * group.sum() == rows]
        for group, value in tried:
            angle = delay.angle(self.phases.omega, np.array(value)) * group
            paid = self.price[group.sum()] + float(delay.surprise(self.phases.omega, np.array(value)))
            cost, scatter = self.judged(angle, paid)
            if cost < best.cost:
                best = _Shared(group, value, scatter, cost)
        return best

    def judged(self, angle: Float[np.ndarray, "mode row"], paid: float) -> tuple[float, float]:
        """What turns cost beside the phases that all rows then share, and the scatter for which they cost least.

        The shared ones are the phases of the shape at the force, with the scatter of the others: they tell whether half
        of the rows are late or the other half early.
        """
        residues, noise, omega = self.given
        residues = residues * np.exp(-1j * angle)[..., None]
        every = np.ones(residues.shape[1], bool)
        phases, shared = _beside(residues, noise, omega, every), np.tan(_shared_phase(residues, every)) ** 2
        costs = []
        for scatter in SCATTERS:
            rows = float(phases.misfit(phases.residues.real, phases.level(scatter)).sum())
            force = (FREEDOM + 1) * float(np.log1p(shared / (FREEDOM * scatter**2)).sum())
            costs.append(rows + force + phases.common(scatter) + 2 * shared.size * float(np.log(scatter)) + paid)
        return min(costs), float(SCATTERS[int(np.argmin(costs))])

    def one_by_one(self, of: _Explained) -> float:
        """What the causes of single rows cost, judged as those of groups are."""
        angle, paid = np.zeros(self.phases.residues.shape), 0.0
        for number, cause in enumerate(_CAUSES):
            own = of.cause == number
            angle += np.where(own, cause.angle(self.phases.omega, of.value), 0.0)
            paid += float(np.sum(cause.surprise(self.phases.omega, of.value), where=own))
        return self.judged(angle, paid + (EVIDENCE + 2 * np.log(self.phases.rows)) * float(np.sum(of.cause >= 0)))[0]

    def interval(self, of: _Shared) -> float:
        """Half of the 95 % interval of the delay; it holds the rivals that explain the rows as well."""
        delay, phases, level = _CAUSES[0], self.phases, self.phases.level(of.scatter)
        group, value, scatter = of.group, of.value, of.scatter
        parts, at = group - group.mean(), np.array([value])
        left = phases.turned(delay, at * parts)[0] ** 2 / phases.variance(scatter)
        own = max(float(left[:, group].sum()) / max(phases.modes * int(group.sum()) - 1, 1), 1.0)
        slopes = (phases.omega * parts) ** 2 * np.abs(phases.residues) ** 2 / phases.variance(scatter)
        known = float(slopes.sum()) * (FREEDOM + 1) / (FREEDOM + 3)
        reach = scipy.stats.t.isf(0.025, phases.rows * (phases.modes - 1)) * np.sqrt(own / known)
        least = float(self.row_costs(parts, at, level).sum() + delay.surprise(phases.omega, at)[0])
        for begin in phases.in_parts(delay.grid(phases.omega)[:, None]):
            part, many = begin, np.repeat(group[None], len(begin), axis=0)
            for _ in range(_STEPS_OF_NEWTON):
                part = self.stepped(many, part, level)
            price = self.row_costs(parts, part, level).sum(axis=1) + delay.surprise(phases.omega, part)[:, 0]
            reach = max(
                reach, float(np.max(np.abs(part[:, 0] - value), where=price - least <= EXCLUDED * own, initial=0))
            )
        return float(reach)


def _choices(rows: int) -> Float[np.ndarray, "count"]:
    """Logarithm of the number of choices of 0 to all of the rows."""
    count = np.arange(rows + 1)
    return np.asarray(gammaln(rows + 1) - gammaln(count + 1) - gammaln(rows - count + 1))


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
