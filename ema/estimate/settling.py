"""Steady vibration within the stays of a stepped sine, without the free vibration that each new frequency begins.

Where the frequency of the force changes, a structure begins to vibrate freely at its own poles s_r, which are the same
in every stay. Of a stay at w,

    y(t) = sum_o Re(Y_o exp(j o w t)) + c + sum_r Re(A_r exp(s_r t)),

Y_o, c and A_r are linear for each channel and stay, w is common to the channels of a stay, and s_r are common to all
(variable projection, Golub and Pereyra 1973, with the derivative of Kaufman 1975). The force has the same free
vibration where the structure acts back on the shaker, so it is a channel like the others. Nothing is assumed of what
came before a stay, nor that the poles are those of the FRFs: of a joint that slides they are those by which it returns
to its steady amplitude.

A stay is worked on as sums of y exp(-j w t) over blocks: sums of exponentials are known in closed form, so this
compresses without approximation.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.stats
from jaxtyping import Bool, Complex, Float, Int

BLOCKS = 16
"""Blocks of a stay: free vibration up to 8 turns of a stay away from the force is seen."""
FEWEST_BLOCKS = 8
"""Blocks below which the steady vibration cannot be distinguished from the free one."""
FEWEST_STAYS = 4
"""Stays below which a common pole is not looked for: of a single one, a drift would do as well."""
CHANCE = 1e-8
"""Probability of a gain by noise below which another pole is believed: 100 places are looked at, so once in a million
tests."""
STATIONARY = (0.2, 0.01)
"""Probability that vibration which something keeps up fades in as many stays, below which it may be free; and the same
where it hardly fades. Of 42 poles of free vibration in stays of half a decay time the largest was 0.14; of 40 that
fitted a disturbance 26 hardly faded, all above 0.1, and 6 of the others had more than 0.2."""
SLOWEST = 0.1
"""Least decay in a stay (decay rate times its length): slower ones are steady."""
_DECAYS = (0.2, 0.8, 3.0)
"""Decays in a stay from which a pole is looked for, at frequencies half of a main lobe apart."""
_ROUNDING = 1e-20
"""Share of the power of a channel below which what is left of it is rounding."""
_CONSTANT = 1e-6
"""Change of an exponential over a stay below which its derivative is that of a constant: closer to it, rounding exceeds
the difference."""
_STEPS = 20
"""Steps of a fit; four to eight are enough from where a pole is looked for."""
_DAMPED = 8
"""Tries of a step, each damped five times as much."""
_CONVERGED = 1e-9
"""Gain of the logarithm of the likelihood at which a fit ends: standard deviations are at gains of a half."""
_LARGEST = 50.0
"""Growth in a stay up to which an exponential is computed."""
_AT_ONCE = 4_000_000
"""Values that are worked on at once."""


@dataclass(frozen=True)
class Stay:
    """What is kept of a stay: turn of the force [rad/sample], time of a sample [s], edges of the blocks [samples]; sums
    over blocks, without the other orders, rows real parts and then imaginary ones; amplitudes of cosines and sines of
    all orders and the constant by plain least squares; the inverse of their products, and what the orders other than
    the first leave in the sums, over the products of a signal with all functions.
    """

    turn: float
    step: float
    edges: Int[np.ndarray, "edge"]
    sums: Float[np.ndarray, "row channel"]
    plain: Float[np.ndarray, "function channel"]
    inverse: Float[np.ndarray, "function function"]
    leak: Float[np.ndarray, "row function"]


@dataclass(frozen=True)
class Settled:
    """Steady vibration of all stays.

    Parameters
    ----------
    poles : of the free vibration that was taken off [rad/s].
    frequency : of the force by all channels, shape (stay,) [Hz].
    amplitudes : complex array of shape (stay, channel, order) of the steady vibration.
    variance : of the first order, shape (stay, channel).
    changes : what each block changes in the first order, in every fourth stay at a time: with them left out one after
        the other (the jackknife), shape (block, stay, channel); the sum of their squares is a variance.
    left : difference of the first order between the halves of a stay beyond noise, in what the free vibration does not
        explain, shape (stay, channel); 0 within noise.
    """

    poles: Complex[np.ndarray, "pole"]
    frequency: Float[np.ndarray, "stay"]
    amplitudes: Complex[np.ndarray, "stay channel order"]
    variance: Float[np.ndarray, "stay channel"]
    changes: Complex[np.ndarray, "block stay channel"]
    left: Float[np.ndarray, "stay channel"]


def compress(signals: Float[np.ndarray, "channel sample"], turn: float, step: float, orders: int) -> Stay | None:
    """Keep of a stay what :func:`settled` needs; ``None`` where it is too short.

    Parameters
    ----------
    signals : the force first, without their means.
    turn : of the force [rad/sample].
    step : time of a sample [s].
    orders : highest order of the force that is told apart from noise; beyond 0.45 of the sampling rate there is none.
    """
    length = signals.shape[1]
    blocks = min(BLOCKS, int(length * turn / np.pi), length // 4)  # half a cycle: cosine and sine are orthogonal there
    if blocks < FEWEST_BLOCKS:
        return None
    edges = np.round(np.linspace(0, length, blocks + 1)).astype(int)
    reached = max(min(orders, int(0.45 * 2 * np.pi / turn)), 1)
    angle = turn * np.arange(length)
    multiples = np.arange(1, reached + 1)[:, None] * angle
    functions = np.concatenate([np.cos(multiples), np.sin(multiples), np.ones((1, length))])
    products = np.linalg.inv(functions @ functions.T)
    found = products @ (functions @ signals.T)
    other = np.ones(len(functions), bool)
    other[[0, reached]] = False
    place = np.concatenate([np.arange(reached), orders + np.arange(reached), [2 * orders]])
    rotated = np.exp(-1j * angle)
    plain, inverse = np.zeros((2 * orders + 1, len(signals))), np.zeros((2 * orders + 1, 2 * orders + 1))
    leak = np.zeros((2 * blocks, 2 * orders + 1))
    plain[place], inverse[np.ix_(place, place)] = found, products
    leak[:, place[other]] = _rows(np.add.reduceat(functions[other] * rotated, edges[:-1], axis=1)).T
    sums = _rows(np.add.reduceat(signals * rotated, edges[:-1], axis=1)).T - leak @ plain
    return Stay(turn, step, edges, sums, plain, inverse, leak @ inverse)


def settled(stays: Sequence[Stay | None], orders: int) -> Settled | None:
    """Return the steady vibration of stays in which free vibration is seen; ``None`` where none is, beyond noise.

    Parameters
    ----------
    stays : of one test, with the same channels.
    orders : as in :func:`compress`.
    """
    known = [stay for stay in stays if stay is not None]
    if len(known) < max(len(stays), FEWEST_STAYS):
        return None
    blocks = min(len(stay.edges) for stay in known) - 1
    if any(len(stay.edges) != blocks + 1 for stay in known):
        known = [_fewer(stay, blocks) for stay in known]
    data = _Data.of(known, orders)
    fit = _optimum(data, _Fit.of(data, np.zeros(0, complex), data.turn))
    while len(fit.poles) < blocks // 2:
        further = _optimum(data, _Fit.of(data, np.append(fit.poles, _start(data, fit)), fit.turn))
        if not _beyond_noise(data, fit, further):
            break
        fit = further
    return _steady(data, fit, orders) if len(fit.poles) else None


def _rows(sums: Complex[np.ndarray, "any block"]) -> Float[np.ndarray, "any row"]:
    return np.concatenate([sums.real, sums.imag], axis=-1)


def _fewer(stay: Stay, blocks: int) -> Stay:
    """A stay in fewer blocks, for tests whose frequencies differ much."""
    now = len(stay.edges) - 1
    first = np.round(np.linspace(0, now, blocks + 1)).astype(int)[:-1]
    both = np.concatenate([first, now + first])
    edges = np.append(stay.edges[first], stay.edges[-1])
    return replace(stay, edges=edges, sums=np.add.reduceat(stay.sums, both), leak=np.add.reduceat(stay.leak, both))


def _exponential(
    rate: Complex[np.ndarray, "stay"], edges: Int[np.ndarray, "stay edge"]
) -> tuple[Complex[np.ndarray, "stay block"], Complex[np.ndarray, "stay block"]]:
    """Sum of exp(a n) over the samples n of each block, and its derivative by a: a geometric sum."""
    length = np.diff(edges, axis=1)
    constant = (np.abs(rate) * edges[:, -1] < _CONSTANT)[:, None]
    some = np.where(rate == 0, _CONSTANT, rate)[:, None]
    less, power = np.expm1(some), np.exp(some * edges)
    sums = np.where(rate[:, None] == 0, length, power[:, :-1] * np.expm1(some * length) / less)
    by = np.diff(edges * power, axis=1) / less - sums * np.exp(some) / less
    return sums, np.where(constant, length * (edges[:, :-1] + 0.5 * (length - 1)), by)


@dataclass(frozen=True)
class _Data:
    """All stays: as :class:`Stay`, with the rows of the blocks that are used; ``turn`` is the one of the sums."""

    turn: Float[np.ndarray, "stay"]
    step: Float[np.ndarray, "stay"]
    edges: Int[np.ndarray, "stay edge"]
    sums: Float[np.ndarray, "stay row channel"]
    plain: Float[np.ndarray, "stay function channel"]
    inverse: Float[np.ndarray, "stay function function"]
    leak: Float[np.ndarray, "stay row function"]
    orders: int
    rows: Bool[np.ndarray, "every_row"]

    @classmethod
    def of(cls, stays: Sequence[Stay], orders: int) -> "_Data":
        """The data of stays with equally many blocks."""
        turn, step = np.array([stay.turn for stay in stays]), np.array([stay.step for stay in stays])
        edges, sums = np.array([stay.edges for stay in stays]), np.array([stay.sums for stay in stays])
        plain, inverse = np.array([stay.plain for stay in stays]), np.array([stay.inverse for stay in stays])
        leak = np.array([stay.leak for stay in stays])
        return cls(turn, step, edges, sums, plain, inverse, leak, orders, np.ones(sums.shape[1], bool))

    @property
    def blocks(self) -> int:
        return int(self.edges.shape[1]) - 1

    @property
    def time(self) -> Float[np.ndarray, "stay"]:
        """Length of the stays [s]."""
        return np.asarray(self.edges[:, -1] * self.step)

    def some(self, keep: Bool[np.ndarray, "stay"] | slice) -> "_Data":
        """The data of some stays."""
        names = ("turn", "step", "edges", "sums", "plain", "inverse", "leak")
        return replace(self, **{name: getattr(self, name)[keep] for name in names})

    def without(self, block: int) -> "_Data":
        """The data without a block of every stay."""
        rows = np.arange(2 * self.blocks) % self.blocks != block
        return replace(self, sums=self.sums[:, rows], leak=self.leak[:, rows], rows=rows)

    def near(self, pole: complex) -> Bool[np.ndarray, "stay"]:
        """Stays in whose sums a pole is seen: up to as many turns of a stay away as half of its blocks."""
        return np.asarray(np.abs(self.turn / self.step - pole.imag) * self.time <= np.pi * self.blocks)

    def vibration(self, rate: complex | Complex[np.ndarray, "stay"]) -> Float[np.ndarray, "kind stay row part"]:
        """Sums of the real and of the imaginary part of exp(rate t), without what the other orders take of it, and
        their derivatives by the real and by the imaginary part of ``rate`` [rad/s].
        """
        raw = np.stack([_rows(part) for part in _parts(rate * self.step, -self.turn, self.edges, self.step)])
        sums = raw.reshape(3, 2, *raw.shape[1:]).transpose(0, 2, 3, 1)[:, :, self.rows]
        return np.asarray(sums - self.leak @ self.products(rate))

    def products(self, rate: complex | Complex[np.ndarray, "stay"]) -> Float[np.ndarray, "kind stay function part"]:
        """Products of the same with the cosines and sines of all orders and with the constant."""
        whole = self.edges[:, [0, -1]]
        found = []
        for order in (*range(1, self.orders + 1), 0):
            parts = np.stack(_parts(rate * self.step, -order * self.turn, whole, self.step))[..., 0]
            found.append(parts.reshape(3, 2, -1).transpose(0, 2, 1))
        each = np.array(found).transpose(1, 2, 0, 3)  # kind, stay, order, part
        orders = each[:, :, :-1]
        return np.concatenate([orders.real, -orders.imag, each[:, :, -1:].real], axis=2)


def _parts(
    rate: Complex[np.ndarray, "stay"],
    turn: Float[np.ndarray, "stay"],
    edges: Int[np.ndarray, "stay edge"],
    step: Float[np.ndarray, "stay"],
) -> list[Complex[np.ndarray, "stay block"]]:
    """Sums of Re(A exp(s t)) exp(j turn n) for A = 1 and j, and their derivatives by Re(s) and by Im(s)."""
    up, up_by = _exponential(rate + 1j * turn, edges)
    down, down_by = _exponential(rate.conj() + 1j * turn, edges)
    # d/ds of the first acts on s, of the second on its conjugate: by Im(s) with j and -j
    both, apart = 0.5 * (up_by + down_by) * step[:, None], 0.5j * (up_by - down_by) * step[:, None]
    return [0.5 * (up + down), 0.5j * (up - down), both, apart, apart, -both]


@dataclass(frozen=True)
class _Fit:
    """A fit with given poles [rad/s] and turns of the force [rad/sample]: an orthogonal basis of its functions for each
    stay and their triangle, unknowns (stay, function, channel), and what is left of the sums.
    """

    poles: Complex[np.ndarray, "pole"]
    turn: Float[np.ndarray, "stay"]
    basis: Float[np.ndarray, "stay row function"]
    triangle: Float[np.ndarray, "stay function function"]
    unknowns: Float[np.ndarray, "stay function channel"]
    left: Float[np.ndarray, "stay row channel"]
    rounding: Float[np.ndarray, "channel"]

    @classmethod
    def of(cls, data: _Data, poles: Complex[np.ndarray, "pole"], turn: Float[np.ndarray, "stay"]) -> "_Fit":
        """The fit by linear least squares, each stay and channel by itself."""
        rates = (1j * turn / data.step, *(complex(pole) for pole in poles))
        basis, triangle = np.linalg.qr(np.concatenate([data.vibration(rate)[0] for rate in rates], axis=-1))
        within = basis.transpose(0, 2, 1) @ data.sums
        left = data.sums - basis @ within
        diagonal = np.einsum("kii->ki", triangle)  # a view: functions that are alike to rounding have no part each
        least = np.finfo(float).eps * np.abs(diagonal).max(axis=1, keepdims=True)
        diagonal[:] = np.where(np.abs(diagonal) < least, least, diagonal)
        rounding = np.maximum(_ROUNDING * np.sum(data.sums**2, axis=(0, 1)), np.finfo(float).tiny)
        return cls(poles, turn, basis, triangle, np.linalg.solve(triangle, within), left, rounding)

    @property
    def energy(self) -> Float[np.ndarray, "channel"]:
        """Sum of the squares of what is left, rounding at least."""
        return np.asarray(np.maximum(np.sum(self.left**2, axis=(0, 1)), self.rounding))

    @property
    def likelihood(self) -> float:
        """Logarithm of the likelihood but for a factor and a constant, with the noise of each channel unknown."""
        return -float(np.sum(np.log(self.energy)))

    @property
    def freedom(self) -> int:
        """Degrees of freedom that are left in a stay, of a channel."""
        return int(self.basis.shape[1] - self.basis.shape[2])

    @property
    def first_order(self) -> Complex[np.ndarray, "stay channel"]:
        return np.asarray(self.unknowns[:, 0] + 1j * self.unknowns[:, 1])


def _start(data: _Data, fit: _Fit) -> complex:
    """Where another pole explains most of what is left."""
    length, force = float(np.median(data.time)), data.turn / data.step
    reach = 0.5 * np.pi * data.blocks / length
    weights = 1 / fit.energy
    places = np.arange(max(float(force.min()) - reach, 0) + 1 / length, float(force.max()) + reach, np.pi / length)
    ends = [np.searchsorted(np.sort(force + sign * reach), places) for sign in (-1, 1)]
    best, found = np.inf, complex(-1 / length, float(force[0]))
    for frequency in places[ends[0] - ends[1] >= FEWEST_STAYS]:
        for decay in _DECAYS:
            pole = complex(-decay / length, frequency)
            near = data.near(pole)
            functions = data.some(near).vibration(pole)[0]
            basis = fit.basis[near]
            functions = functions - basis @ (basis.transpose(0, 2, 1) @ functions)
            turned = np.linalg.qr(functions)[0].transpose(0, 2, 1) @ fit.left[near]
            share = np.minimum(np.sum(turned**2, axis=(0, 1)) * weights, 1 - 1e-15)
            gain = float(np.sum(np.log1p(-share)))
            if gain < best:
                best, found = gain, pole
    return found


def _optimum(data: _Data, fit: _Fit) -> _Fit:
    """The fit of greatest likelihood from a given one, by damped Gauss-Newton steps (Levenberg, Marquardt)."""
    slowest = SLOWEST / float(np.median(data.time))
    damping = 1e-3
    for _ in range(_STEPS):
        equations = _Equations.of(data, fit, 1 / np.sqrt(fit.energy))
        before = fit.likelihood
        for _ in range(_DAMPED):
            poles, turn = equations.step(damping)
            moved = fit.poles + poles
            moved = np.minimum(moved.real, -slowest) + 1j * moved.imag
            trial = _Fit.of(data, moved, fit.turn + turn * data.step)
            if trial.likelihood > before:
                break
            damping *= 5
        else:
            return fit
        fit, damping = trial, max(damping / 5, 1e-9)
        if fit.likelihood - before < _CONVERGED:
            break
    return fit


@dataclass(frozen=True)
class _Equations:
    """Normal equations of a step, stay by stay: products and gradient for the poles, real and imaginary parts in turn;
    the same for the frequency of the force; and the products of these with those.
    """

    poles: Float[np.ndarray, "stay unknown unknown"]
    poles_gradient: Float[np.ndarray, "stay unknown"]
    force: Float[np.ndarray, "stay"]
    force_gradient: Float[np.ndarray, "stay"]
    both: Float[np.ndarray, "stay unknown"]

    @classmethod
    def of(cls, data: _Data, fit: _Fit, weights: Float[np.ndarray, "channel"]) -> "_Equations":
        """The equations at a fit, for the weights of the channels."""
        count, size = 2 * len(fit.poles), data.sums[0].size
        parts = []
        at_once = max(_AT_ONCE // ((count + 1) * size), 1)
        for begin in range(0, len(data.turn), at_once):
            part = slice(begin, begin + at_once)
            changes = _changes(data, fit, part, weights).transpose(1, 0, 2)
            left = (fit.left[part] * weights).reshape(-1, size, 1)
            parts.append((changes @ changes.transpose(0, 2, 1), (changes @ left)[..., 0]))
        products, gradient = (np.concatenate(part) for part in zip(*parts, strict=True))
        force = np.maximum(products[:, 0, 0], np.finfo(float).tiny)
        return cls(products[:, 1:, 1:], gradient[:, 1:], force, gradient[:, 0], products[:, 0, 1:])

    def reduced(
        self, damping: float = 0.0
    ) -> tuple[Float[np.ndarray, "stay unknown unknown"], Float[np.ndarray, "stay unknown"]]:
        """Products and gradient for the poles, with the best frequency of the force in each stay."""
        share = self.both / (self.force * (1 + damping))[:, None]
        products = self.poles - share[:, :, None] * self.both[:, None]
        return products, self.poles_gradient - share * self.force_gradient[:, None]

    def step(self, damping: float) -> tuple[Complex[np.ndarray, "pole"], Float[np.ndarray, "stay"]]:
        """Changes of the poles and of the frequencies of the force [rad/s]."""
        products, gradient = (part.sum(axis=0) for part in self.reduced(damping))
        damped = products + damping * np.diag(np.diag(self.poles.sum(axis=0)))
        change = np.linalg.lstsq(damped, gradient)[0]
        return change[::2] + 1j * change[1::2], self.force_step(change, damping)

    def force_step(self, change: Float[np.ndarray, "unknown"], damping: float = 0.0) -> Float[np.ndarray, "stay"]:
        """Change of the frequency of the force [rad/s] that goes with one of the poles."""
        return np.asarray((self.force_gradient - self.both @ change) / (self.force * (1 + damping)))


def _changes(
    data: _Data, fit: _Fit, part: slice, weights: Float[np.ndarray, "channel"]
) -> Float[np.ndarray, "unknown stay value"]:
    """What the frequency of the force [rad/s], and then the real and the imaginary part of each pole, change in the
    sums of some stays beyond what the linear unknowns make good.
    """
    some, basis = data.some(part), fit.basis[part]
    by = [(0, some.vibration(1j * fit.turn[part] / some.step)[2])]
    for place, pole in enumerate(fit.poles):
        by += [(2 + 2 * place, functions) for functions in some.vibration(complex(pole))[1:]]
    found = []
    for place, functions in by:
        change = functions @ fit.unknowns[part, place : place + 2]
        found.append((change - basis @ (basis.transpose(0, 2, 1) @ change)) * weights)
    return np.array(found).reshape(len(found), len(basis), -1)


def _beyond_noise(data: _Data, fit: _Fit, further: _Fit) -> bool:
    """Whether the last pole of a fit gains more than noise would give to as many unknowns, in the stays around it."""
    near = data.near(complex(further.poles[-1]))
    count = int(near.sum())
    if count < FEWEST_STAYS:
        return False
    before, after = (np.sum(fitted.left[near] ** 2, axis=(0, 1)) for fitted in (fit, further))
    noisy = after > further.rounding
    channels = int(noisy.sum())
    if not channels:
        return bool(np.any(before > 100 * fit.rounding))
    noise = after[noisy] / (count * further.freedom)
    ratio = float(np.mean((before - after)[noisy] / (2 * count * noise)))
    chance = scipy.stats.f.sf(ratio, 2 * count * channels, count * channels * further.freedom)
    return bool(chance < CHANCE) and _fades(data, further, near)


def _fades(data: _Data, fit: _Fit, near: Bool[np.ndarray, "stay"]) -> bool:
    """Whether the vibration of the last pole fades within the stays rather than grows.

    What a disturbance keeps up at a resonance is narrow-banded too, but the same backwards in time: a pole that grows
    as fast would explain it as well. It explains free vibration less well in nearly every stay (signed ranks, Wilcoxon
    1945: common to all channels, and of any strength).
    """
    last = fit.poles[-1]
    growth = min(-last.real, _LARGEST / float(data.time.max()))
    growing = _Fit.of(data, np.append(fit.poles[:-1], complex(growth, last.imag)), fit.turn)
    better = np.sum((growing.left**2 - fit.left**2) / fit.energy, axis=(1, 2))[near]
    chance = float(scipy.stats.wilcoxon(better, alternative="greater").pvalue)
    hardly = -last.real * float(np.median(data.time)) < 2 * SLOWEST
    return bool(chance <= max(STATIONARY[1] if hardly else STATIONARY[0], 0.5 ** len(better)))


def _steady(data: _Data, fit: _Fit, orders: int) -> Settled:
    """Amplitudes without the free vibration, and their variances."""
    inverse = np.linalg.inv(fit.triangle)[:, :2]
    noise = np.sum(fit.left**2, axis=1) / fit.freedom
    plain = data.plain.copy()
    for place, pole in enumerate(fit.poles):
        taken = data.inverse @ data.products(complex(pole))[0]
        plain -= taken @ fit.unknowns[:, 2 + 2 * place : 4 + 2 * place]
    amplitudes = (plain[:, :orders] - 1j * plain[:, orders : 2 * orders]).transpose(0, 2, 1)
    amplitudes[:, :, 0] = fit.first_order
    return Settled(
        poles=fit.poles,
        frequency=fit.turn / (2 * np.pi * data.step),
        amplitudes=amplitudes,
        variance=np.sum(inverse**2, axis=(1, 2))[:, None] * noise,
        changes=_left_out(data, fit),
        left=_left(data, fit, noise),
    )


def _left_out(data: _Data, fit: _Fit) -> Complex[np.ndarray, "block stay channel"]:
    """What leaving out each block in every fourth stay changes in the amplitudes: by a step of the poles and of the
    frequencies of the force, and by the linear unknowns of these stays. The poles change those of all stays.
    """
    weights = 1 / np.sqrt(fit.energy)
    equations = _Equations.of(data, fit, weights)
    products, gradient = equations.reduced()
    freedom = len(data.turn) * fit.freedom
    inverse = np.linalg.pinv(products.sum(axis=0), hermitian=True)
    by = []
    for unknown, size in enumerate(np.sqrt(np.diag(inverse) / freedom)):
        unit = size * np.eye(len(inverse))[unknown]
        turn = -(equations.both @ unit) / equations.force * data.step
        ends = [
            _Fit.of(data, fit.poles + sign * (unit[::2] + 1j * unit[1::2]), fit.turn + sign * turn).first_order
            for sign in (1, -1)
        ]
        by.append((ends[0] - ends[1]) / (2 * max(size, np.finfo(float).tiny)))
    found = []
    for group in range(FEWEST_STAYS):
        own = np.arange(len(data.turn)) % FEWEST_STAYS == group
        own_data, turn = data.some(own), fit.turn[own]
        others = [part[~own].sum(axis=0) for part in (products, gradient)]
        for block in range(data.blocks):
            rest = own_data.without(block)
            rest_equations = _Equations.of(rest, _Fit.of(rest, fit.poles, turn), weights)
            of_rest = [part.sum(axis=0) for part in rest_equations.reduced()]
            change = np.linalg.lstsq(others[0] + of_rest[0], others[1] + of_rest[1])[0]
            moved = turn + rest_equations.force_step(change) * rest.step
            amplitudes = np.einsum("u,usc->sc", change, np.array(by))
            again = _Fit.of(rest, fit.poles + change[::2] + 1j * change[1::2], moved).first_order
            amplitudes[own] = again - fit.first_order[own]
            found.append(amplitudes)
    apart = np.array(found) - np.mean(found, axis=0)
    return np.asarray(np.sqrt((len(found) - 1) / len(found)) * apart)


def _left(data: _Data, fit: _Fit, noise: Float[np.ndarray, "stay channel"]) -> Float[np.ndarray, "stay channel"]:
    """Difference between the halves of the stays in what a fit leaves, where it is beyond five standard deviations."""
    half = data.blocks // 2
    complex_sums = fit.left[:, : data.blocks] + 1j * fit.left[:, data.blocks :]
    halves = (complex_sums[:, :half].sum(axis=1), complex_sums[:, half : 2 * half].sum(axis=1))
    per_sum = 4 / data.edges[:, -1:]  # an amplitude is twice the mean of y exp(-j w t), here over half of the samples
    difference = np.abs(halves[1] - halves[0]) * per_sum
    return np.where(difference > 5 * per_sum * np.sqrt(4 * half * noise), difference, 0.0)
