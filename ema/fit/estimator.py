"""Maximum likelihood estimation of modes: one engine for the search of modes and for the final values.

Poles and participation are shared by all FRFs; shapes and residual terms are linear and belong to one output. For given
poles and participation the linear unknowns are eliminated output by output (variable projection, Golub and Pereyra
1973, in Kaufman's approximation), and Gauss-Newton steps move the shared ones (modal form: El-Kafafy, De Troyer,
Guillaume 2014).

Outputs with the same weights share one elimination: FRFs form rows of members, each row with a weight for every line of
every reference. In the search all outputs are members of one row; for the final values every output is a row.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import scipy.linalg
from jaxtyping import Bool, Complex, Float, Int

from ema.fit import model
from ema.fit.model import Background, Functions
from ema.fit.noise import NoiseLevel
from ema.fit.range_finder import DIRECTIONS, Range, growing

EDGE = 2.0
"""Fixed poles of the residual terms lie at the band edges divided and multiplied by this.

They stand for all that is farther away; what lies nearer is found as poles outside the band. At 1.5 and at 3 the modes
of 14 random systems stay the same, and values move by up to 0.9 and 0.1 of their stated standard deviations.
"""
FIXED = complex(-0.05, 1.0)
"""These poles, over their angular frequency."""
FEWEST = 24
"""Directions of outputs that are always kept in the search: more cost next to nothing against the functions. With 12
values of 14 random systems move by 0.4 standard deviations at most, with 48 not at all."""
NARROWEST = 0.3
"""Half-power bandwidth in frequency lines below which no pole is followed: the lines no longer tell its damping. A pole
at the bound keeps it, unless the lines do tell (`NARROWER`)."""
SPIKE = 0.01
"""The same for poles that are narrower than that from the start, and for those that the lines do tell (`NARROWER`):
lines without noise determine even these.
"""
NARROWER = 25.0
"""What a pole at `NARROWEST` has to take off the cost by a smaller decay rate, in units of the noise, to be followed
beyond: five standard deviations, which noise exceeds once in 3 million poles.
"""
PRIOR = 1.0
"""Information that every shared unknown has before the data are looked at, in units of the noise: a pole is known to
its own decay rate, an entry of a participation vector to its largest one.

Where the data tell nothing of a pole of the background, this keeps its uncertainty, and what of it reaches the modes,
finite. A mode whose decay rate is known to 10 % has 100 times as much from the data: the prior narrows its interval by
half a per cent; doubled, by one.
"""
ROUNDING = 1e-9
"""Part of the information of an unknown that elimination leaves by rounding alone: it is added as uncertainty.

The residual terms are eliminated first, with a condition of 1e6 at most (`ema.fit.model.RESIDUAL_RANK`), in doubles of
1e-16. At twice the value the standard deviation of a pole that keeps 1e-6 of its information changes by 5e-4.
"""
ORTHOGONAL = 1e-22
"""The same where orthogonal transformations eliminate (`with_orthogonal_matrices`): nothing is squared, and of a column
that an elimination leaves 1e-11 of, in amplitude, 1e-5 of what is left is rounding.
"""
CLOSE = 1e-8
"""Part of the energy of a pole's function that nothing else in the model describes (`Fit.share`), below which an
interval asks for orthogonal transformations.

Of two to eight poles in a row above a band, errors of the products change the standard deviations of other poles by
nothing where the share is 1e-7, and widen them up to 200 times where it is 1e-10.
"""
NARROWED = 0.1
"""What `ROUNDING` adds to the information of a pole, over that of the prior, from which on an interval asks for
orthogonal transformations where the share of the pole is below `ALIKE`: it narrows the interval of a mode whose damping
is known to 30 % by one in a hundred.
"""
ALIKE = 1e-4
"""Share of a pole below which `NARROWED` is looked at.

Of two to eight poles in a row above a band, without noise, `ROUNDING` narrows the standard deviation of the one that is
known worst to 0.9999, 0.6 and 0.03 of what it is where the share is 4e-4, 1e-5 and 1e-6.
"""
RANK = 1e-8
"""Part of the energy of a pole's function that nothing else in the model describes, below which it is taken out
unless the data need it, as they may need the last of a row of resonances just outside the band.

Its residue is then uncertain by 10,000 times what noise does to a single one. Below `ROUNDING` its place is not
determined, and it stands still.
"""
DOUBT = 2.0
"""Standard deviations above the mean of what noise gives to as many unknowns, within which these are left out: one in
44 is kept by chance (normal approximation of chi-square), and what is left out gains no more than noise may.

At 1 and at 4 the modes of 14 random systems stay the same, and values move by up to one stated standard deviation.
"""
FARTHEST = 0.7
"""Step of a pole, over its decay rate or its distance from the lines, beyond which the linearisation says nothing: a
safeguard. A longer step is shortened to it, and at 1 a decay rate could reach zero in one step."""
SLOWEST = 0.1
"""Imaginary part of a pole over its modulus below which none is followed: on the real axis the functions of a pole and
of its conjugate are one. Damping ratios end at 0.995."""
NEARBY = 0.02
"""Step of a pole over its natural unit, or of an entry of the participation, up to which the matrices of the fit before
serve for the one after. The error that a step leaves is then the fiftieth part of the one before it."""
_ROUNDED = 1e-12
"""Rounding of the cost, over its value: a step that raises it by less counts as one that does not. Far above what
doubles make of such sums, and far below what any step of interest gains."""
_CANCELLED = 1e-6
"""Part of the cost at the start below which the cost at the optimum, a difference, is computed again from there: ten
digits of the difference are left at this part, fewer below it."""
_BLOCK = 2_000_000
"""Products of functions that are worked on at a time: memory alone, values depend on it by rounding."""
VALUES = 400_000
"""Values of the FRFs that are worked on at a time: memory alone, values depend on it by rounding."""


@dataclass
class Work:
    """Operations spent on evaluations of the model, as estimated from its size, and how many end a search."""

    spent: float = 0.0
    limit: float = np.inf

    @property
    def over(self) -> bool:
        """Whether the search has to end."""
        return self.spent > self.limit

    def allow(self, operations: float) -> None:
        """So many more from here."""
        self.limit = self.spent + operations


@dataclass(frozen=True)
class Observations:
    """Receptances and their weights ``2 / E|n|^2``: the residual energy of the true model is one per real equation.

    ``s`` (line,) are lines, or centres of bins, in rad/s. The mean of a receptance over a bin is not its value at the
    centre: ``means`` are what was measured, ``signals`` the same less the difference by a model (`centred`), and
    ``spread`` (line,) is the variance of the angular frequencies of a bin. ``correlated``: the noise is known to
    correlate over lines, so that this says nothing against a model. ``work`` counts what is spent on these data,
    ``recent`` keeps the functions of the last fit to them.
    """

    s: Complex[np.ndarray, "line"]
    signals: Complex[np.ndarray, "row member in line"]
    weights: Float[np.ndarray, "row in line"]
    spread: Float[np.ndarray, "line"] | None = None
    means: Complex[np.ndarray, "row member in line"] | None = None
    correlated: bool = False
    work: Work = field(default_factory=Work, compare=False)
    recent: model.Recent = field(default_factory=model.Recent, compare=False, repr=False)

    @property
    def outputs(self) -> int:
        """Outputs, or directions of outputs."""
        return int(self.signals.shape[0] * self.signals.shape[1])

    @property
    def references(self) -> int:
        """References."""
        return int(self.signals.shape[2])

    @property
    def equations(self) -> int:
        """Real equations."""
        return 2 * self.signals.size

    @property
    def line(self) -> float:
        """Least distance of lines or bins in rad/s."""
        return float(np.min(np.diff(self.s.imag))) if len(self.s) > 1 else 0.0

    @property
    def narrowest_decay(self) -> float:
        """Decay rate in rad/s of the narrowest pole that is followed."""
        return 0.5 * NARROWEST * self.line

    @property
    def energy(self) -> float:
        """Weighted energy of the data."""
        return float(sum(np.sum(weights * _power(signals)) for signals, weights in self.blocks()))

    def blocks(self) -> Iterator[tuple[Complex[np.ndarray, "r m in k"], Float[np.ndarray, "r 1 in k"]]]:
        """Signals and weights of some rows at a time."""
        for rows in self.row_blocks(self.signals[0].size, VALUES):
            yield self.signals[rows], self.weights[rows, None]

    def row_blocks(self, size: int, most: int) -> list[slice]:
        """Rows in blocks of at most so many values, ``size`` of them in a row."""
        step = max(1, most // max(size, 1))
        return [slice(first, first + step) for first in range(0, len(self.signals), step)]

    def reweighted(self, factor: np.ndarray) -> "Observations":
        """The same observations with weights multiplied by a factor that broadcasts."""
        return replace(self, weights=self.weights * factor)

    def lines(self, keep: slice) -> "Observations":
        """Some of the lines."""
        return Observations(self.s[keep], self.signals[..., keep], self.weights[..., keep])

    def without_lines(self, frequency: float) -> "Observations":
        """The observations without the line next to an angular frequency (rad/s) and its two neighbours."""
        nearest = int(np.argmin(np.abs(self.s.imag - frequency)))
        weights = self.weights.copy()
        weights[..., max(nearest - 1, 0) : nearest + 2] = 0
        return replace(self, weights=weights)


@dataclass(frozen=True)
class Fit:
    """Unknowns at which the linear ones are optimal, and the linearisation there.

    ``poles`` (mode,) rad/s, ``participation`` (in, mode) with a largest entry of 1, ``shapes`` (row, member, mode),
    ``rest`` (row, member, in, column) coefficients of the residual terms ``terms``. ``information`` and ``gradient``
    belong to the real parts, then the imaginary parts of the shared unknowns: poles, then the entries ``free`` of the
    flattened participation; ``before`` is the diagonal of the information before the elimination.

    Elimination, in real parts, then imaginary parts: ``local`` (row, 2 mode, 2 mode) inverts the information of the
    shapes, ``slope`` (row, 2 mode, 2 unknown) is minus their change with the functions of the shared unknowns,
    ``of_rest`` (row, in, column, column) inverts the information of the residual terms and ``lean``
    (row, in, column, 2 (mode + unknown)) is minus their change with all of these. ``share`` (mode,) is the part of the
    energy of each mode's function that neither the others nor the residual terms can describe. ``rounding`` is the part
    of the information that the elimination leaves by rounding alone (`ROUNDING`, or `ORTHOGONAL`). ``borrowed``: these
    are of a fit nearby (`_Evaluation.nearby`).
    """

    poles: Complex[np.ndarray, "mode"]
    participation: Complex[np.ndarray, "in mode"]
    terms: Background
    shapes: Complex[np.ndarray, "row member mode"]
    rest: Float[np.ndarray, "row member in column"]
    cost: float
    information: Float[np.ndarray, "unknown unknown"]
    gradient: Float[np.ndarray, "unknown"]
    before: Float[np.ndarray, "unknown"]
    free: Int[np.ndarray, "entry"]
    local: Float[np.ndarray, "row l l"]
    slope: Float[np.ndarray, "row l unknown"]
    lean: Float[np.ndarray, "row in column shared"]
    of_rest: Float[np.ndarray, "row in column column"]
    share: Float[np.ndarray, "mode"]
    rounding: float = ROUNDING
    borrowed: bool = False

    @property
    def owners(self) -> Int[np.ndarray, "complex_unknown"]:
        """Mode to which each complex shared unknown belongs."""
        modes = len(self.poles)
        return np.concatenate([np.arange(modes), self.free % max(modes, 1)])

    @property
    def held(self) -> bool:
        """Whether poles and participation are no unknowns (`evaluate`)."""
        return len(self.poles) > 0 and not len(self.gradient)

    @property
    def psi(self) -> Complex[np.ndarray, "mode out"]:
        """Shapes on the outputs or their directions."""
        return self.shapes.reshape(-1, len(self.poles)).T

    @property
    def scale(self) -> Float[np.ndarray, "unknown"]:
        """Natural unit of each shared unknown: decay rate of a pole, 1 for an entry of the participation."""
        own = np.concatenate([np.maximum(np.abs(self.poles.real), 1e-12 * np.abs(self.poles)), np.ones(len(self.free))])
        return np.tile(own, 2)

    def unknowns(self) -> int:
        """Real unknowns: shapes, residual terms, poles and participation."""
        return 2 * self.shapes.size + self.rest.size + len(self.gradient)

    def variance_factor(self, data: Observations) -> float:
        """Residual energy per real equation left over: 1 when the noise levels are right and the model holds."""
        return self.cost / max(data.equations - self.unknowns(), 1)


def evaluate(
    data: Observations,
    poles: Complex[np.ndarray, "mode"],
    participation: Complex[np.ndarray, "in mode"],
    terms: Background,
    start: tuple[np.ndarray, np.ndarray] | None = None,
    *,
    orthogonal: bool = False,
    held: bool = False,
) -> Fit:
    """Optimal linear unknowns at given poles and participation, and the linearisation there.

    Parameters
    ----------
    participation : with a largest entry of 1 for each mode.
    start : shapes and coefficients of the residual terms near the optimum, which keeps rounding out of the cost.
    orthogonal : eliminate by orthogonal transformations of the functions on the lines, which takes much longer.
    held : poles and participation are no unknowns, which takes a third of the time where each output has its weights.
    """
    if start is None:
        rows, members = data.signals.shape[:2]
        nothing = (
            np.zeros((rows, members, len(poles)), complex),
            np.zeros((rows, members, data.references, terms.mixing.shape[1])),
        )
        first = evaluate(data, poles, participation, terms, nothing, held=held)
        start = first.shapes, first.rest
    found = data.recent.functions(data.s, poles, terms.poles)
    return _Evaluation(data, poles, participation, terms, found, orthogonal, held=held).at(*start)


def with_orthogonal_matrices(data: Observations, fit: Fit) -> Fit:
    """The fit with matrices that hold where poles describe each other (`CLOSE`, `NARROWED`); itself where none do."""
    modes = len(fit.poles)
    added = ROUNDING * fit.before[:modes] * fit.scale[:modes] ** 2 / PRIOR
    if fit.rounding == ORTHOGONAL or not np.any((fit.share < CLOSE) | ((fit.share < ALIKE) & (added > NARROWED))):
        return fit
    start = fit.shapes, fit.rest
    exact = evaluate(data, fit.poles, fit.participation, fit.terms, start, orthogonal=True)
    return replace(exact, shapes=fit.shapes, rest=fit.rest, cost=fit.cost)


@dataclass(frozen=True)
class _Elimination:
    """What eliminates the linear unknowns, as in a `Fit`."""

    local: Float[np.ndarray, "row l l"]
    slope: Float[np.ndarray, "row l unknown"]
    lean: Float[np.ndarray, "row in column shared"]
    of_rest: Float[np.ndarray, "row in column column"]


@dataclass(frozen=True)
class _Reduction(_Elimination):
    """Elimination of some rows: the diagonal of the information of the shapes before that of anything else (row, l),
    and of that of the functions of the shared unknowns before that of the shapes (row, complex unknown); that
    information, as ``P`` and ``Q`` of `ema.fit.model`, less what the shapes take off it, or, with the ``coupling`` of
    the shapes with these functions, before that.
    """

    bare: Float[np.ndarray, "row l"]
    own: Float[np.ndarray, "row complex_unknown"]
    shared: tuple[Complex[np.ndarray, "row u u"], Complex[np.ndarray, "row u u"]]
    coupling: Float[np.ndarray, "row l unknown"] | None = None

    def information(self, psi: Complex[np.ndarray, "row member u"]) -> Float[np.ndarray, "unknown unknown"]:
        """Information of the shared unknowns, of whose functions ``psi`` are the factors."""
        turned, (p, q) = psi.transpose(0, 2, 1), self.shared
        # With one member a row, one product over all rows.
        coupling = self.coupling if psi.shape[1] == 1 else None
        if coupling is None and self.coupling is not None:
            taken = model.complex_form(self.coupling.transpose(0, 2, 1) @ self.slope)
            p, q = p - taken[0], q - taken[1]
        result = model.real_form(
            np.einsum("rab,rab->ab", p, turned.conj() @ psi), np.einsum("rab,rab->ab", q, turned @ psi)
        )
        if coupling is not None:
            result -= _times(coupling, psi).T @ _times(self.slope, psi)
        return result


def _times(matrix: Float[np.ndarray, "row l unknown"], psi: Complex[np.ndarray, "row 1 u"]) -> np.ndarray:
    """Matrices that act on the real, then the imaginary parts of ``psi`` times unknowns as those that act on these, all
    rows below each other."""
    real, imaginary = np.split(matrix, 2, axis=-1)
    found = [real * psi.real + imaginary * psi.imag, imaginary * psi.real - real * psi.imag]
    return (
        np.concatenate(found, axis=-1).reshape(-1, matrix.shape[-1]) if matrix.size else np.zeros((0, matrix.shape[-1]))
    )


@dataclass(frozen=True)
class _Equations:
    """Normal equations of some rows, the residual terms eliminated, as ``P`` and ``Q`` (form, row, a, b) of
    `ema.fit.model` per unit of the shapes: of the ``shapes`` with each other, their ``coupling`` with the functions of
    the shared unknowns (poles, then free entries of the participation), and of these, ``shared``.

    ``bare`` (row, l) is the diagonal of that of the shapes before the elimination; ``lean`` and ``of_rest`` are as in a
    `Fit`.
    """

    shapes: Complex[np.ndarray, "2 row mode mode"]
    coupling: Complex[np.ndarray, "2 row mode u"]
    shared: Complex[np.ndarray, "2 row u u"]
    bare: Float[np.ndarray, "row l"]
    lean: Float[np.ndarray, "row in column shared"]
    of_rest: Float[np.ndarray, "row in column column"]


@dataclass
class _Linear:
    """Linear unknowns on the way to their optimum: weighted energy of the residual before, what the step takes off it,
    and the gradient of the shared unknowns.
    """

    shapes: Complex[np.ndarray, "row member mode"]
    rest: Float[np.ndarray, "row member in column"]
    gradient: Complex[np.ndarray, "unknown"]
    energy: float = 0.0
    gain: float = 0.0

    @classmethod
    def at_start(cls, shapes: np.ndarray, rest: np.ndarray, unknowns: int) -> "_Linear":
        """Before the first step."""
        return cls(shapes.astype(complex), rest.copy(), np.zeros(unknowns, complex))


class _Evaluation:
    """Normal equations of a model at given poles and participation."""

    def __init__(
        self,
        data: Observations,
        poles: Complex[np.ndarray, "mode"],
        participation: Complex[np.ndarray, "in mode"],
        terms: Background,
        found: Functions,
        orthogonal: bool = False,
        *,
        held: bool = False,
    ) -> None:
        self.orthogonal, self.rounding = orthogonal, ORTHOGONAL if orthogonal else ROUNDING
        self.data, self.poles, self.participation, self.terms, self.found = data, poles, participation, terms, found
        self.modes, self.references = len(poles), len(participation)
        self.every = np.concatenate([poles, terms.poles])
        self.moving = 0 if held else self.modes
        self.free = np.zeros(0, int) if held else free_entries(participation)
        # Positions among shapes, poles and all entries of the participation.
        self.keep = np.concatenate([np.arange(self.modes + self.moving), 2 * self.modes + self.free])
        self.shared = len(self.keep)
        half = np.arange(self.modes)
        self.of_shapes = np.concatenate([half, self.shared + half])
        rest = np.arange(self.modes, self.shared)
        self.of_unknowns = np.concatenate([rest, self.shared + rest])
        self.owners = np.concatenate([half[: self.moving], self.free % max(self.modes, 1)])
        # Modes whose entry is unknown, for each reference, and the places of these entries behind the poles.
        of_reference = np.searchsorted(self.free, self.modes * np.arange(self.references + 1))
        self.free_modes = [self.free[a:b] % max(self.modes, 1) for a, b in pairwise(of_reference)]
        self.places = [slice(self.moving + a, self.moving + b) for a, b in pairwise(of_reference)]
        # Functions on the lines, products for each row, factorisation of the information.
        functions = 2 * self.modes + len(terms.poles) + 2
        of_rows = (
            len(data.signals) * self.references * functions * (len(data.s) * (4 + data.signals.shape[1]) + functions)
        )
        data.work.spent += 2.0 * of_rows + (2.0 * self.shared) ** 3

    def at(self, shapes: np.ndarray, rest: np.ndarray, again: bool = False) -> Fit:
        """The fit whose linear unknowns are best, reached from a start; ``again`` where that was such a fit itself."""
        data, modes, unknowns = self.data, self.modes, self.shared - self.modes
        rows, columns = len(data.signals), rest.shape[-1]
        information = np.zeros((2 * unknowns, 2 * unknowns))
        before, lost = np.zeros(unknowns), np.zeros(2 * unknowns)
        share = np.ones(modes)
        by = _Elimination(
            local=np.empty((rows, 2 * modes, 2 * modes)),
            slope=np.empty((rows, 2 * modes, 2 * unknowns)),
            lean=np.empty((rows, self.references, columns, 2 * self.shared)),
            of_rest=np.empty((rows, self.references, columns, columns)),
        )
        optimum = _Linear.at_start(shapes, rest, unknowns)
        size = self.references * (2 * modes + len(self.terms.poles) + 2) ** 2 + 4 * self.shared**2
        for some in data.row_blocks(max(size, data.signals[0].size), _BLOCK):
            reduced = (self.orthogonal_reduction if self.orthogonal else self.reduction)(data.weights[some])
            bare, by.local[some], by.slope[some] = reduced.bare, reduced.local, reduced.slope
            by.lean[some], by.of_rest[some] = reduced.lean, reduced.of_rest
            left_over = 1 / np.maximum(np.diagonal(by.local[some], axis1=1, axis2=2) * bare, 1.0)
            share = np.minimum(share, left_over.reshape(len(bare), 2, modes).min(axis=(0, 1), initial=1.0))
            size_of_shapes = np.sum(np.abs(shapes[some][..., self.owners]) ** 2, axis=1)
            before += np.sum(reduced.own * size_of_shapes, axis=0)
            lost += np.einsum("rlu,rl,ru->u", by.slope[some] ** 2, bare, np.tile(size_of_shapes, 2), optimize=True)
            self.adapt(optimum, by, some)
            information += reduced.information(optimum.shapes[some][..., self.owners])
        cancelled = optimum.energy - optimum.gain < _CANCELLED * optimum.energy
        if cancelled and not again:
            return self.at(optimum.shapes, optimum.rest, again=True)
        # An error of the eliminated shapes' matrix M returns as slope^T dM slope in the information.
        rounding = 0.1 * self.rounding * (np.tile(before, 2) + lost)
        idle = np.tile(share[self.owners] < self.rounding, 2) | (np.diag(information) <= rounding)
        information[idle], information[:, idle] = 0, 0
        return Fit(
            poles=self.poles,
            participation=self.participation,
            terms=self.terms,
            shapes=optimum.shapes,
            rest=optimum.rest,
            # At an optimum there is nothing left to gain: what still cancels there has no digits.
            cost=optimum.energy if cancelled else optimum.energy - optimum.gain,
            information=0.5 * (information + information.T),
            gradient=np.where(idle, 0, np.concatenate([optimum.gradient.real, optimum.gradient.imag])),
            before=np.tile(before, 2),
            free=self.free,
            local=by.local,
            slope=by.slope,
            lean=by.lean,
            of_rest=by.of_rest,
            share=share,
            rounding=self.rounding,
        )

    def nearby(self, fit: Fit, shapes: np.ndarray, rest: np.ndarray) -> Fit:
        """The fit with the elimination and the information of one nearby: the optimum is where its gradient vanishes,
        whatever matrix led there, and the matrices are most of the work where every output has weights of its own.
        """
        by = _Elimination(fit.local, fit.slope, fit.lean, fit.of_rest)
        optimum = _Linear.at_start(shapes, rest, self.shared - self.modes)
        # Once would leave in the gradient the share of the linear step that these matrices have wrong.
        for _ in range(2):
            optimum = _Linear.at_start(optimum.shapes, optimum.rest, self.shared - self.modes)
            for some in self.data.row_blocks(self.data.signals[0].size, VALUES):
                self.adapt(optimum, by, some)
        gradient = np.concatenate([optimum.gradient.real, optimum.gradient.imag])
        return replace(
            fit,
            poles=self.poles,
            participation=self.participation,
            shapes=optimum.shapes,
            rest=optimum.rest,
            # What the matrices of another place promise is not counted.
            cost=optimum.energy,
            gradient=np.where(np.diag(fit.information) > 0, gradient, 0),
            borrowed=True,
        )

    def adapt(self, optimum: "_Linear", by: "_Elimination", some: slice) -> None:
        """A Newton step of the linear unknowns of some rows, what it gains, and the gradient of the shared unknowns."""
        weights, local, slope, lean = self.data.weights[some], by.local[some], by.slope[some], by.lean[some]
        modes, half = self.modes, self.shared - self.modes
        members = self.data.signals.shape[1]
        count = max(1, VALUES // max(self.data.signals[some, :1].size, 1))
        for part in (slice(first, first + count) for first in range(0, members, count)):
            shapes, rest = optimum.shapes[some, part], optimum.rest[some, part]
            residual = self.data.signals[some, part] - self.synthesised(shapes, rest)
            of_shapes, right, of_terms = self.reduced(weights, residual, lean)
            step = np.einsum("rab,rmb->rma", local, of_shapes)
            free_step = np.einsum("ritu,rmit->rmiu", by.of_rest[some], of_terms)
            optimum.shapes[some, part] = shapes + step[..., :modes] + 1j * step[..., modes:]
            moved = np.einsum("rits,rms->rmit", lean[..., self.of_shapes], step)
            optimum.rest[some, part] = rest + free_step - moved
            optimum.energy += float(np.sum(weights[:, None] * _power(residual)))
            optimum.gain += float(np.sum(of_shapes * step) + np.sum(of_terms * free_step))
            left = right - np.einsum("rab,rma->rmb", slope, of_shapes)
            psi = optimum.shapes[some, part][..., self.owners]
            optimum.gradient += np.sum(psi.conj() * (left[..., :half] + 1j * left[..., half:]), axis=(0, 1))

    def synthesised(
        self, shapes: Complex[np.ndarray, "r m mode"], rest: Float[np.ndarray, "r m in column"]
    ) -> Complex[np.ndarray, "r m in line"]:
        """FRFs of some rows."""
        modes = shapes[:, :, None] * self.participation
        return model.synthesise(self.found, np.concatenate([modes, self.terms.coefficients(rest)], axis=-1))

    def reduction(self, weights: Float[np.ndarray, "r in line"]) -> "_Reduction":
        """Elimination of the linear unknowns of some rows from the normal equations."""
        equations = self.equations(weights)
        coupling = model.real_form(*equations.coupling)
        local = inverse(model.real_form(*equations.shapes), 0.1 * self.rounding * equations.bare)
        return _Reduction(
            local=local,
            slope=local @ coupling,
            lean=equations.lean,
            of_rest=equations.of_rest,
            bare=equations.bare,
            own=np.diagonal(equations.shared[0], axis1=1, axis2=2).real,
            shared=(equations.shared[0], equations.shared[1]),
            coupling=coupling,
        )

    def orthogonal_reduction(self, weights: Float[np.ndarray, "r in line"]) -> "_Reduction":
        """The same by Householder transformations of the functions on the lines (Golub and Pereyra 1973)."""
        columns = self.terms.on_lines(self.found)
        functions = [self.on_lines(reference) for reference in range(self.references)]
        shapes = 2 * self.modes
        order = np.concatenate([self.of_shapes, self.of_unknowns])
        rows: list[tuple[np.ndarray, ...]] = []
        for of_row in weights:
            lean, of_rest, left, bare = [], [], [], np.zeros(shapes)
            for of_reference, weight in zip(functions, of_row, strict=True):
                root = np.sqrt(np.repeat(weight, 2))
                basis, triangle = np.linalg.qr((columns * root).T)
                back = scipy.linalg.solve_triangular(triangle, np.eye(len(triangle)))
                values = (of_reference * root).T
                bare += np.sum(values[:, self.of_shapes] ** 2, axis=0)
                along = np.zeros((len(triangle), values.shape[1]))
                # Twice: what is left is orthogonal to the terms to rounding, whatever part of the function it is.
                for _ in range(2):
                    share = basis.T @ values
                    values, along = values - basis @ share, along + share
                lean.append(back @ along)
                of_rest.append(back @ back.T)
                left.append(values[:, order])
            stacked = np.concatenate(left)
            # What rounding leaves of a shape is added, as to normal equations.
            floor = np.zeros((shapes, stacked.shape[1]))
            floor[np.arange(shapes), np.arange(shapes)] = np.sqrt(0.1 * self.rounding * bare)
            reduced = np.asarray(np.linalg.qr(np.concatenate([stacked, floor]), mode="r"))
            back = scipy.linalg.solve_triangular(reduced[:shapes, :shapes], np.eye(shapes))
            rest = reduced[shapes:, shapes:]
            own = np.sum(stacked[:, shapes:].reshape(len(stacked), 2, -1) ** 2, axis=(0, 1)) / 2
            slope = back @ reduced[:shapes, shapes:]
            rows.append((back @ back.T, slope, np.array(lean), np.array(of_rest), bare, own, rest.T @ rest))
        found = [np.stack(column) for column in zip(*rows, strict=True)]
        return _Reduction(found[0], found[1], found[2], found[3], found[4], found[5], model.complex_form(found[6]))

    def on_lines(self, reference: int) -> Float[np.ndarray, "s line_part"]:
        """Functions of shapes, poles and participation on every line of one reference: those of their real parts, then
        those of their imaginary parts, per unit of the shapes.
        """
        values, count, modes = self.found.values, self.found.count, self.modes
        of_shapes = values[:modes], values[count : count + modes]
        of_poles = values[2 * count : 2 * count + modes], values[2 * count + modes :]
        entries = self.participation[reference][:, None]

        def times(
            both: tuple[np.ndarray, np.ndarray], factor: Complex[np.ndarray, "mode 1"]
        ) -> tuple[np.ndarray, np.ndarray]:
            real, imaginary = both
            return (
                factor.real * real + factor.imag * imaginary,
                factor.real * imaginary - factor.imag * real,
            )

        parts = [times(of_shapes, entries), times(of_poles, entries)]
        parts += [times(of_shapes, np.full_like(entries, other == reference)) for other in range(self.references)]
        return np.concatenate([np.concatenate(half)[self.keep] for half in zip(*parts, strict=True)])

    def equations(self, weights: Float[np.ndarray, "r in line"]) -> "_Equations":
        """Normal equations of some rows, reference by reference."""
        modes, moving, rows, unknowns = self.modes, self.moving, len(weights), self.shared - self.modes
        sums = model.sums_over_lines(self.found, weights)
        found = model.products(self.every, modes, sums.reshape(-1, sums.shape[-1]), moving)
        first = found.first.reshape(2, rows, self.references, len(self.every) + 2, modes + moving)
        squares = found.squares.reshape(2, rows, self.references, moving, moving)
        # Residual terms have real coefficients: their products with functions z are Re(across z).
        real, imaginary = np.split(self.terms.mixing.T, 2, axis=1)
        of_terms = first[:, :, :, modes:]
        across = real @ (of_terms[0] + of_terms[1]) - 1j * (imaginary @ (of_terms[0] - of_terms[1]))
        of_rest = inverse(self.terms.products(self.found, weights))
        follow = of_rest @ across
        shapes = np.zeros((2, rows, modes, modes), complex)
        coupling = np.zeros((2, rows, modes, unknowns), complex)
        shared = np.zeros((2, rows, unknowns, unknowns), complex)
        lean = np.zeros((*follow.shape[:3], self.shared), complex)
        bare = np.zeros((rows, 2, modes))
        for i, (entries, free) in enumerate(zip(self.participation, self.free_modes, strict=True)):
            own = self.places[i]
            direct, turned = (np.diagonal(form[:, i, :modes], axis1=1, axis2=2) for form in first)
            direct, turned = np.abs(entries) ** 2 * direct.real, (entries**2 * turned).real
            bare += np.stack([direct + turned, direct - turned], axis=1)
            lean[:, i, :, : modes + moving] = follow[:, i] * np.concatenate([entries, entries[:moving]])
            lean[:, i, :, modes:][..., own] = follow[:, i][..., free]
            for form in (0, 1):
                left = (entries if form else entries.conj())[:, None]
                back = across[:, i] if form else across[:, i].conj()
                # They take (across z)^T of_rest (across z) off z^H P z + Re(z^T Q z), half of it off either form.
                lost = 0.5 * (back.transpose(0, 2, 1) @ follow[:, i])
                of_poles = left[:moving] * (squares[form, :, i] - lost[:, modes:, modes:])
                shared[form, :, :moving, :moving] += of_poles * entries[:moving]
                of_shapes = first[form, :, i, :modes] - lost[:, :modes]
                if len(free):
                    shared[form, :, own, own] = of_shapes[:, free[:, None], free]
                    mixed = of_shapes[:, free, modes:] * entries
                    shared[form, :, own, :modes] = mixed
                    shared[form, :, :modes, own] = (mixed if form else mixed.conj()).transpose(0, 2, 1)
                of_shapes *= left
                shapes[form] += of_shapes[..., :modes] * entries
                coupling[form, ..., :moving] += of_shapes[..., modes:] * entries[:moving]
                coupling[form, ..., own] = of_shapes[..., free]
        lean = np.concatenate([lean.real, -lean.imag], axis=-1)
        return _Equations(shapes, coupling, shared, bare.reshape(rows, -1), lean, of_rest)

    def reduced(
        self,
        weights: Float[np.ndarray, "r in line"],
        residual: Complex[np.ndarray, "r m in line"],
        lean: Float[np.ndarray, "r in column s"],
    ) -> tuple[Float[np.ndarray, "r m l"], Float[np.ndarray, "r m unknown"], Float[np.ndarray, "r m in column"]]:
        """Right-hand sides of shapes and of the functions of the shared unknowns, the residual terms eliminated, and of
        these.
        """
        h, modes = model.projections(self.found, weights[:, None] * residual), self.modes
        rest = len(self.terms.poles) + 2
        f, g = h[..., :modes], h[..., modes + rest :]
        conjugate = self.participation.conj()
        parts = [np.sum(conjugate * f, axis=2), np.sum(conjugate * g, axis=2)]
        if self.references > 1:
            parts.append(f.reshape(*f.shape[:2], -1))
        shared = np.concatenate(parts, axis=-1)[..., self.keep]
        own = h[..., modes : modes + rest]
        of_terms = np.concatenate([own.real, own.imag], axis=-1) @ self.terms.mixing
        right = np.concatenate([shared.real, shared.imag], axis=-1) - np.einsum("rits,rmit->rms", lean, of_terms)
        return right[..., self.of_shapes], right[..., self.of_unknowns], of_terms


def centred(data: Observations, fit: Fit) -> Observations:
    """The observations with the means over bins turned into values at the centres, by the model of a fit."""
    if data.means is None or data.spread is None or not data.spread.any():
        return data
    poles = np.concatenate([fit.poles, fit.terms.poles])
    rest = fit.terms.coefficients(fit.rest)[..., : len(fit.terms.poles)]
    coefficients = np.concatenate([fit.shapes[:, :, None] * fit.participation, rest], axis=-1)
    return replace(data, signals=data.means - model.bin_excess(data.s, data.spread, poles, coefficients))


def free_entries(participation: Complex[np.ndarray, "in mode"]) -> Int[np.ndarray, "entry"]:
    """Entries of the participation that are unknown, as positions in its flattened array: all but the largest ones."""
    keep = np.ones(participation.shape, bool)
    keep[np.argmax(np.abs(participation), axis=0), np.arange(participation.shape[1])] = False
    return np.flatnonzero(keep)


def inverse(
    matrix: Float[np.ndarray, "*row n n"], rounding: Float[np.ndarray, "*row n"] | float = 0.0
) -> Float[np.ndarray, "*row n n"]:
    """Inverse of positive definite matrices, scaled to unit diagonal; ``rounding`` is added to the diagonal."""
    diagonal = np.maximum(np.einsum("...ii->...i", matrix), 0) + rounding
    scale = 1 / np.sqrt(np.maximum(diagonal, np.finfo(float).tiny))
    # Beside a diagonal of nothing rounding is beyond what a positive matrix can have.
    with np.errstate(over="ignore"):
        scaled = np.clip(matrix * scale[..., :, None] * scale[..., None, :], -1, 1)
    scaled[..., np.arange(matrix.shape[-1]), np.arange(matrix.shape[-1])] = 1 + 1e-12
    result: np.ndarray = np.linalg.inv(scaled) * scale[..., :, None] * scale[..., None, :]
    return result


def _power(values: np.ndarray) -> np.ndarray:
    """Squared modulus."""
    result: np.ndarray = values.real**2 + values.imag**2
    return result


def root(fit: Fit, factor: np.ndarray | float = 1.0) -> Float[np.ndarray, "unknown cause"]:
    """Square root of the covariance of the shared unknowns, with the prior of `PRIOR`.

    Parameters
    ----------
    factor : variance of each real unknown over what the weights say.

    Notes
    -----
    The information is scaled to the natural unit of each unknown; with the prior its smallest eigenvalue is 1, so that
    no direction is inverted that the data leave open.
    """
    spread = np.sqrt(np.broadcast_to(factor, fit.gradient.shape)) if len(fit.gradient) else np.zeros(0)
    scale = fit.scale / np.maximum(spread, np.finfo(float).tiny)
    matrix = fit.information * np.outer(scale, scale)
    matrix[np.diag_indices(len(matrix))] += PRIOR + fit.rounding * fit.before * scale**2
    result: np.ndarray = fit.scale[:, None] * _root_of_inverse(matrix)
    return result


def _root_of_inverse(matrix: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n cause"]:
    """A factor R with ``R R^T`` the inverse of a symmetric matrix that is positive definite but for rounding.

    Scaled to unit diagonal. Where Cholesky finds a negative pivot, rounding is all that some direction holds: its
    eigenvalue is taken as `ROUNDING`.
    """
    own = 1 / np.sqrt(np.diag(matrix))
    scaled = matrix * np.outer(own, own)
    try:
        factored = scipy.linalg.cholesky(scaled, lower=True, check_finite=False)
    except scipy.linalg.LinAlgError:
        values, vectors = scipy.linalg.eigh(scaled, check_finite=False)
        return np.asarray(own[:, None] * vectors / np.sqrt(np.maximum(values, ROUNDING)))
    back = scipy.linalg.solve_triangular(factored, np.eye(len(matrix)), lower=True, check_finite=False)
    return np.asarray(own[:, None] * back.T)


def _step(
    data: Observations, fit: Fit, damping: float, prior: float, free_outside: bool
) -> Float[np.ndarray, "unknown"]:
    """Gauss-Newton step, damped in the natural units; poles move by no more than `FARTHEST` of their decay rate (or, if
    ``free_outside``, of their distance from the band where that is more), get no narrower than the lines can tell, and
    keep oscillating (`SLOWEST`). The others follow where one is held.
    """
    scale, modes, half = fit.scale, len(fit.poles), len(fit.gradient) // 2
    matrix = fit.information * np.outer(scale, scale)
    matrix[np.diag_indices(len(matrix))] += prior + fit.rounding * fit.before * scale**2
    diagonal = (1 + damping) * np.diag(matrix)
    np.fill_diagonal(matrix, diagonal)
    gradient = fit.gradient * scale
    step, held = np.zeros(2 * half), np.zeros(2 * half, bool)
    # What is narrower from the start has a bound of its own: pushed away, it would raise the cost of every step.
    room = np.maximum(-narrowest(data, fit.poles) - fit.poles.real, 0) / scale[:modes]
    outside = np.maximum(np.maximum(data.s[0].imag - fit.poles.imag, fit.poles.imag - data.s[-1].imag), 0)
    reach = np.hypot(scale[:modes], outside if free_outside else 0)
    fall = np.maximum(fit.poles.imag - SLOWEST * np.abs(fit.poles), 0) / scale[:modes]
    for _ in range(3 * modes + 1):
        pull = gradient[~held] - matrix[np.ix_(~held, held)] @ step[held]
        inverted = _root_of_inverse(matrix[np.ix_(~held, ~held)])
        step[~held] = inverted @ (inverted.T @ pull)
        narrow = np.flatnonzero((step[:modes] > room) & ~held[:modes])
        step[narrow], held[narrow] = room[narrow], True
        slow = np.flatnonzero((-step[half : half + modes] > fall) & ~held[half : half + modes])
        step[half + slow], held[half + slow] = -fall[slow], True
        if len(narrow) or len(slow):
            continue
        move = np.hypot(step[:modes], step[half : half + modes]) * scale[:modes] / reach
        far = np.flatnonzero((move > FARTHEST) & ~(held[:modes] & held[half : half + modes]))
        if not len(far):
            break
        both = np.concatenate([far, half + far])
        step[both] *= np.tile(FARTHEST / move[far], 2)
        held[both] = True
    return np.asarray(step * scale)


def undamped(data: Observations, poles: Complex[np.ndarray, "mode"]) -> Bool[np.ndarray, "mode"]:
    """Poles narrower than `NARROWEST` lines, as of tones."""
    return np.asarray(-poles.real < (1 - 1e-9) * data.narrowest_decay)


def narrowest(data: Observations, poles: Complex[np.ndarray, "mode"]) -> Float[np.ndarray, "mode"]:
    """Least decay rate (rad/s) of each pole: `NARROWEST` lines, or `SPIKE` lines for what is narrower than that."""
    return np.asarray(data.narrowest_decay * np.where(undamped(data, poles), SPIKE / NARROWEST, 1))


def refine(
    data: Observations,
    start: Fit,
    iterations: int = 12,
    *,
    tolerance: float = 1e-3,
    prior: float = PRIOR,
    free_outside: bool = False,
) -> Fit:
    """Gauss-Newton steps with Levenberg-Marquardt damping; never returns a larger cost than that of ``start``.

    There are none where the work on these data is done (`Work`).

    Parameters
    ----------
    tolerance : stop when a step promises to take less than this off the cost, in units of the noise and for each
        unknown: 1e-3 is a thirtieth of a standard deviation.
    prior : information that holds each unknown in its place for a step, in its natural unit. What the data tell with as
        much information converges by half in each step.
    free_outside : poles outside the band may go as far as their distance from it allows. In steps of their decay rate
        they creep; a search that is not near an optimum is steadier so.
    """
    fit, damping = start, 0.0
    for _ in range(iterations if len(start.poles) else 0):
        if data.work.over:
            break
        step = _step(data, fit, damping, prior, free_outside)
        promised = float(step @ (2 * fit.gradient - fit.information @ step))
        ends = damping == 0 and promised < tolerance * len(step) * fit.variance_factor(data)
        if not ends:
            trial = _moved(data, fit, step, True)
            if trial.borrowed and not fit.borrowed and not trial.cost <= fit.cost:
                trial = _moved(data, fit, step, False)
            if trial.cost <= (1 + _ROUNDED) * fit.cost:
                damping = damping / 10 if damping > 1e-2 else 0.0
                ends = fit.cost - trial.cost < 1e-6 * tolerance * trial.cost
                fit = trial
            elif not fit.borrowed:
                damping = max(10 * damping, 1e-2)
                ends = damping > 1e6
            else:
                fit = _with_own_matrices(data, fit)
        # That there is nothing left to gain is said by the matrices of the place itself.
        if ends and not fit.borrowed:
            break
        if ends:
            fit = _with_own_matrices(data, fit)
    fit = _with_own_matrices(data, fit)
    narrower = _told_to_be_narrower(data, fit)
    if not np.any(narrower):
        return fit
    released = np.where(narrower, fit.poles + 0.1 * data.narrowest_decay, fit.poles)
    trial = evaluate(data, released, fit.participation, fit.terms, (fit.shapes, fit.rest))
    trial = refine(data, trial, iterations, tolerance=tolerance, prior=prior, free_outside=free_outside)
    return trial if trial.cost < fit.cost else fit


def _told_to_be_narrower(data: Observations, fit: Fit) -> Bool[np.ndarray, "mode"]:
    """Which poles at the bound `NARROWEST` would take `NARROWER` off the cost beyond it."""
    modes = len(fit.poles)
    bounded = (
        np.abs(-fit.poles.real / data.narrowest_decay - 1) < 1e-6 if modes and data.line else np.zeros(modes, bool)
    )
    if not np.any(bounded):
        return np.asarray(bounded)
    root = _root_of_inverse(fit.information + np.diag(1 / fit.scale**2 + fit.rounding * fit.before))
    variance = np.sum(root[:modes] ** 2, axis=1)
    pull = (root @ (root.T @ fit.gradient))[:modes]
    gain = np.maximum(pull, 0) ** 2 / variance
    return np.asarray(bounded & (gain > NARROWER * fit.variance_factor(data)))


def _with_own_matrices(data: Observations, fit: Fit) -> Fit:
    """The fit with its own matrices."""
    if not fit.borrowed:
        return fit
    return evaluate(data, fit.poles, fit.participation, fit.terms, (fit.shapes, fit.rest))


def _moved(data: Observations, fit: Fit, step: Float[np.ndarray, "unknown"], borrow: bool) -> Fit:
    """The fit after a step of the shared unknowns; the linear ones start where the linearisation says. A small step may
    ``borrow`` the matrices that there are.
    """
    modes, half = len(fit.poles), len(step) // 2
    change = step[:half] + 1j * step[half:]
    participation = fit.participation.copy()
    participation.reshape(-1)[fit.free] += change[modes:]
    largest = participation[np.argmax(np.abs(participation), axis=0), np.arange(modes)]
    poles = fit.poles + change[:modes]
    functions = fit.shapes[..., fit.owners] * change
    real = np.concatenate([functions.real, functions.imag], axis=-1)
    adapted = np.einsum("rls,rms->rml", fit.slope, real)
    shapes = fit.shapes - adapted[..., :modes] - 1j * adapted[..., modes:]
    participation, start = participation / largest, (shapes * largest, fit.rest)
    small = np.max(np.abs(step) / fit.scale, initial=0.0) < NEARBY
    if not (borrow and small and len(data.signals) > 1 and np.array_equal(free_entries(participation), fit.free)):
        return evaluate(data, poles, participation, fit.terms, start)
    found = data.recent.functions(data.s, poles, fit.terms.poles)
    return _Evaluation(data, poles, participation, fit.terms, found).nearby(fit, *start)


def pulls(
    data: Observations, fit: Fit, change: Complex[np.ndarray, "row member in line"], rows: slice = slice(None)
) -> Float[np.ndarray, "r m unknown"]:
    """What a change of the FRFs of some rows adds to the gradient of the shared unknowns, the linear ones adapted."""
    found = data.recent.functions(data.s, fit.poles, fit.terms.poles)
    engine = _Evaluation(data, fit.poles, fit.participation, fit.terms, found)
    of_shapes, right, _ = engine.reduced(data.weights[rows], change, fit.lean[rows])
    left = right - np.einsum("rab,rma->rmb", fit.slope[rows], of_shapes)
    half = left.shape[-1] // 2
    complex_pull = fit.shapes[rows][..., fit.owners].conj() * (left[..., :half] + 1j * left[..., half:])
    return np.concatenate([complex_pull.real, complex_pull.imag], axis=-1)


def residual(data: Observations, fit: Fit, rows: slice = slice(None)) -> Complex[np.ndarray, "r m in line"]:
    """Residual of some rows."""
    return np.asarray(data.signals[rows] - fitted(data, fit, rows))


def fitted(data: Observations, fit: Fit, rows: slice = slice(None)) -> Complex[np.ndarray, "r m in line"]:
    """Receptances of the fit for some rows."""
    found = data.recent.functions(data.s, fit.poles, fit.terms.poles)
    coefficients = fit.shapes[rows][:, :, None] * fit.participation
    rest = fit.terms.coefficients(fit.rest[rows])
    return model.synthesise(found, np.concatenate([coefficients, rest], axis=-1))


def changes_of_shape(fit: Fit, mode: int) -> Float[np.ndarray, "row member 2 unknown"]:
    """Change of the real and the imaginary part of a shape with the shared unknowns."""
    rows = np.array([mode, len(fit.poles) + mode])
    half = fit.slope.shape[-1] // 2
    real, imaginary = fit.slope[:, None, rows, :half], fit.slope[:, None, rows, half:]
    psi = fit.shapes[..., None, fit.owners]
    return -np.concatenate([real * psi.real + imaginary * psi.imag, imaginary * psi.real - real * psi.imag], axis=-1)


def gains(data: Observations, fit: Fit) -> Float[np.ndarray, "mode"]:
    """Increase of the cost when one mode is left out and the other linear unknowns adapt, each mode in turn."""
    modes = len(fit.poles)
    result = np.empty(modes)
    variance = np.einsum("rii->ri", fit.local)
    for mode in range(modes):
        rows = np.array([mode, modes + mode])
        if variance[:, rows].min() > 0:
            own = np.stack([fit.shapes[..., mode].real, fit.shapes[..., mode].imag], axis=-1)
            block = inverse(fit.local[:, rows[:, None], rows])
            result[mode] = np.einsum("rma,rab,rmb->", own, block, own)
        else:
            # The rest of the model describes this mode, and rounding is all that its variance holds.
            result[mode] = max(drop(data, fit, np.arange(modes) != mode).cost - fit.cost, 0.0)
    return result


def drop(data: Observations, fit: Fit, keep: np.ndarray) -> Fit:
    """The fit with some of its modes only."""
    start = fit.shapes[..., keep], fit.rest
    return evaluate(data, fit.poles[keep], fit.participation[:, keep], fit.terms, start, held=fit.held)


def determined(data: Observations, fit: Fit) -> tuple[Fit, Int[np.ndarray, "kept"]]:
    """The fit without poles that do not oscillate, and without those that the rest of the model describes (`RANK`)
    where it describes the data as well without them, once what stays has adapted; and which poles stay. Where the work
    is done (`Work`), those that are described go without being asked.
    """
    needed, kept = np.zeros(len(fit.poles), bool), np.arange(len(fit.poles))
    while True:
        oscillates = fit.poles.imag > 0
        known = oscillates & ((fit.share >= RANK) | needed)
        if known.all():
            return fit, kept
        # Of several that describe each other all but one may have to stay.
        known |= oscillates & (fit.share > np.min(fit.share, where=~known, initial=np.inf))
        fewer = drop(data, fit, known)
        if data.work.over:
            return fewer, kept[known]
        fewer = refine(data, fewer)
        unknowns = fit.unknowns() - fewer.unknowns()
        of_noise = fit.variance_factor(data) * (unknowns + DOUBT * np.sqrt(2 * unknowns))
        if oscillates[~known].all() and fewer.cost - fit.cost > of_noise:
            needed |= ~known
        else:
            fit, needed, kept = fewer, needed[known], kept[known]


def with_modes(
    data: Observations, fit: Fit, poles: Complex[np.ndarray, "new"], vectors: Complex[np.ndarray, "new in"]
) -> Fit:
    """The fit with further modes."""
    largest = np.take_along_axis(vectors, np.argmax(np.abs(vectors), axis=1)[:, None], axis=1)
    shapes = np.concatenate([fit.shapes, np.zeros((*fit.shapes.shape[:2], len(poles)), complex)], axis=-1)
    participation = np.concatenate([fit.participation, (vectors / largest).T], axis=1)
    return evaluate(data, np.concatenate([fit.poles, poles]), participation, fit.terms, (shapes, fit.rest))


def with_terms(data: Observations, fit: Fit, columns: int) -> Fit:
    """The fit with the first residual terms only."""
    terms = fit.terms.fewer(columns)
    return evaluate(data, fit.poles, fit.participation, terms, (fit.shapes, fit.rest[..., :columns]))


@dataclass(frozen=True)
class FewerTerms:
    """What it costs to keep the first residual terms only, as a function of a change d of the shared unknowns:
    ``cost + 2 d gradient + d information d``. Those of some outputs add up to that of all.
    """

    cost: float
    gradient: Float[np.ndarray, "unknown"]
    information: Float[np.ndarray, "unknown unknown"]

    @classmethod
    def of(cls, fit: Fit, columns: int, pull: Complex[np.ndarray, "row member unknown"] | None = None) -> "FewerTerms":
        """For the first ``columns`` of a fit.

        With the values c of the others at the optimum and their covariance D while the shared unknowns are held it is
        ``(c + J d)^T D^-1 (c + J d)``, J how the terms follow the shared unknowns. They belong to one output each.

        Without the others the shapes are those next to the optimum with fewer terms. Noise that these changes share
        with the residual pulls all outputs in one direction: with the ``pull`` of each output on the shared unknowns
        per unit of its shape the gradient is exact, as it has to be where an optimum is looked for.
        """
        modes, outer = len(fit.poles), fit.lean.shape[-1] // 2
        of_shapes = np.r_[:modes, outer : outer + modes]
        lean = fit.lean[:, :, columns:]
        rows, references, count = lean.shape[:3]
        flat = lean.reshape(rows, references * count, -1)
        by_shape = flat[..., of_shapes]
        held = by_shape @ fit.local @ by_shape.transpose(0, 2, 1)
        for i in range(references):
            own = slice(i * count, (i + 1) * count)
            held[:, own, own] += fit.of_rest[:, i, columns:, columns:]
        follow = by_shape @ fit.slope - np.delete(flat, of_shapes, axis=-1)
        values = fit.rest[..., columns:].reshape(*fit.shapes.shape[:2], -1)
        inverted = inverse(held)[:, None]
        weighted = (inverted @ values[..., None])[..., 0]
        shapes, beside = fit.shapes, np.zeros(len(fit.gradient))
        if pull is not None:
            change = np.einsum("rab,rcb,rmc->rma", fit.local, by_shape, weighted)
            change = change[..., :modes] + 1j * change[..., modes:]
            missed = np.sum(change[..., fit.owners].conj() * pull, axis=(0, 1))
            shapes, beside = shapes + change, np.concatenate([missed.real, missed.imag])
        real, imaginary = (part[:, None] for part in np.split(follow, 2, axis=-1))
        psi = shapes[:, :, None, fit.owners]
        jacobian = np.concatenate(
            [real * psi.real + imaginary * psi.imag, imaginary * psi.real - real * psi.imag], axis=-1
        )
        along = jacobian.reshape(values.size, jacobian.shape[-1])
        return cls(
            float(np.sum(values * weighted)),
            along.T @ weighted.reshape(-1) - beside,
            along.T @ (inverted @ jacobian).reshape(along.shape),
        )

    def __add__(self, other: "FewerTerms") -> "FewerTerms":
        return FewerTerms(self.cost + other.cost, self.gradient + other.gradient, self.information + other.information)

    def increase(self, fit: Fit) -> float:
        """Increase of the cost from the optimum next to ``fit`` to that with fewer terms (Woodbury's identity)."""
        by_cause = root(fit)
        step = by_cause @ (by_cause.T @ fit.gradient)
        cost = self.cost + float(step @ (2 * self.gradient + self.information @ step))
        pulled = by_cause.T @ (self.gradient + self.information @ step)
        inner = by_cause.T @ self.information @ by_cause + np.eye(len(pulled))
        return float(cost - pulled @ np.linalg.solve(inner, pulled))


def cost_of_fewer_terms(fit: Fit, columns: int) -> float:
    """Increase of the cost when the first residual terms only are kept and everything else adapts, linearised."""
    return FewerTerms.of(fit, columns).increase(fit)


def covariance(fit: Fit, factor: float) -> Float[np.ndarray, "mode 2 2"]:
    """Covariance of natural frequency (Hz) and damping ratio of each mode."""
    by_cause = root(fit, factor)
    modes, half = len(fit.poles), len(fit.gradient) // 2
    size = np.abs(fit.poles)[:, None]
    real, imaginary = by_cause[:modes], by_cause[half : half + modes]
    along = (fit.poles.real[:, None] * real + fit.poles.imag[:, None] * imaginary) / size
    both = np.stack([along / (2 * np.pi), -real / size + fit.poles.real[:, None] * along / size**2], axis=1)
    result: np.ndarray = both @ both.transpose(0, 2, 1)
    return result


def profile(data: Observations, fit: Fit) -> tuple[Float[np.ndarray, "in line"], Float[np.ndarray, "line"]]:
    """Mean square of the weighted residual for each reference and line; and its product with that of the next line,
    which noise leaves near 0 and a misfit near the square, over all FRFs.
    """
    power, together = np.zeros(data.weights.shape[1:]), np.zeros(len(data.s))
    for rows in data.row_blocks(data.signals[0].size, VALUES):
        weighted = residual(data, fit, rows) * np.sqrt(data.weights[rows, None])
        power += np.sum(_power(weighted), axis=(0, 1))
        together[:-1] += np.sum((weighted[..., 1:] * weighted[..., :-1].conj()).real, axis=(0, 1, 2))
    return power / (2 * data.outputs), together / (2 * data.outputs * data.references)


def correlation(data: Observations, fit: Fit) -> float:
    """Correlation of neighbouring residuals: 0 for noise, up to 1 for what a better model would explain."""
    if data.correlated:
        return 0.0
    power, together = profile(data, fit)
    return float(together.sum() / max(float(power.mean(axis=0).sum()), 1e-300))


def dominance(data: Observations, fit: Fit) -> Float[np.ndarray, "mode"]:
    """Energy of each mode over that of the data within its half-power bandwidth (three lines at least)."""
    return np.asarray(shares_of_energy(data, fit)[0])


def shares_of_energy(data: Observations, fit: Fit) -> Float[np.ndarray, "2 mode"]:
    """Energy of each mode within its half-power bandwidth (three lines at least), over that of the data there, and over
    that of all data.
    """
    result = np.empty((2, len(fit.poles)))
    energy = np.sum([np.sum(w * _power(x), axis=(0, 1, 2)) for x, w in data.blocks()], axis=0)
    for mode, pole in enumerate(fit.poles):
        distance = np.abs(data.s.imag - pole.imag)
        least = min(2, len(distance) - 1)
        near = np.flatnonzero(distance <= max(abs(pole.real), float(np.partition(distance, least)[least])))
        lines = slice(int(near[0]), int(near[-1]) + 1)
        found = model.functions(data.s[lines], fit.poles[[mode]], fit.terms.poles[:0])
        own = model.synthesise(found, (fit.shapes[:, :, None] * fit.participation)[..., [mode]])
        total = float(np.sum(data.weights[:, None, :, lines] * _power(own)))
        result[:, mode] = total / max(float(energy[lines].sum()), 1e-300), total / max(float(energy.sum()), 1e-300)
    return result


def bins(
    frequencies: Float[np.ndarray, "freq"], poles: Complex[np.ndarray, "pole"], fineness: float = 0.1
) -> Int[np.ndarray, "bin"]:
    """First lines of bins, none wider than ``fineness`` times the distance to the nearest pole or 1/400 of the band.

    There the model is so smooth that the mean over the bin holds all that its lines hold. The lower residual has a pole
    at zero, and the fixed pole below the band lies between that and the first line.
    """
    omega = 2 * np.pi * frequencies
    distance = omega.copy()
    for pole in poles:
        np.minimum(distance, np.abs(1j * omega - pole), out=distance)
    step = 2 * np.pi * (frequencies[-1] - frequencies[0]) / (len(frequencies) - 1)
    widest = np.clip(fineness * distance / step, 1, max(1, len(omega) / 400)).astype(int)
    starts, line = [], 0
    while line < len(omega):
        starts.append(line)
        width = int(widest[line])
        line += max(1, min(width, int(widest[min(line + width, len(omega)) - 1])))
    return np.array(starts)


def observe(
    frequencies: Float[np.ndarray, "freq"],
    values: Complex[np.ndarray, "freq out in"],
    derivative: int,
    noise: NoiseLevel,
    starts: Int[np.ndarray, "bin"] | None = None,
    rotate: bool = True,
) -> Observations:
    """FRFs as one row: outputs over their noise, lines averaged in bins, outputs rotated onto their main directions.

    Parameters
    ----------
    frequencies : Hz, above 0.
    derivative : power q of ``s`` that turns a receptance into the data.
    noise : standard deviations of lines (those of a single line, one for each bin), outputs and references.
    starts : first line of each bin; by default every line is its own.
    """
    lines, outputs, references = values.shape
    omega = 2 * np.pi * frequencies
    starts = np.arange(lines) if starts is None else starts
    counts = np.diff(np.append(starts, lines))
    centre = np.add.reduceat(omega, starts) / counts
    spread = np.maximum(np.add.reduceat(omega**2, starts) / counts - centre**2, 0) * (counts > 1)
    signals = np.empty((outputs, references, len(starts)), complex)
    receptance = (1j * omega) ** -derivative
    for first in range(0, outputs, 16):
        block = values[:, first : first + 16].transpose(1, 2, 0) * receptance
        signals[first : first + 16] = np.add.reduceat(block, starts, axis=-1) if len(starts) < lines else block
    signals /= counts * noise.outputs[:, None, None]
    by_line = counts * centre ** (2 * derivative) / noise.lines**2
    weights = by_line / noise.references[:, None] ** 2
    if rotate and outputs > FEWEST:
        signals = _rotated(signals, weights)
    return Observations(1j * centre, signals[None], weights[None], spread, signals[None])


def _rotated(
    signals: Complex[np.ndarray, "out in line"], weights: Float[np.ndarray, "in line"]
) -> Complex[np.ndarray, "q in line"]:
    """Project the outputs on the leading eigenvectors of their correlation (real, so that conjugate terms stay so).

    Directions of noise alone have the energy of the known noise; the smallest and the median energy bound it where it
    is known badly. With more modes than outputs every direction holds signal, and the median says nothing.
    """
    outputs = len(signals)
    flat = (signals * np.sqrt(weights)).reshape(outputs, -1).view(float)
    few, many = sorted(flat.shape)

    def loud(found: Range) -> int:
        """How many directions stand out of noise."""
        # Edges of the eigenvalues of a noise matrix (Marchenko and Pastur 1967); noise of unit variance has the energy
        # of the longer side in every direction.
        ratio = np.sqrt(min(few / many, 0.25))
        least = float(found.energies[-1]) / (1 - ratio) ** 2 if not found.others else 0.0
        floor = min(found.floor, max(float(many), least)) * (1 + ratio) ** 2
        return int(np.count_nonzero(found.energies > 1.05 * floor))

    found, above = growing(lambda: [flat], outputs, DIRECTIONS, loud)
    kept = int(np.clip(above + 2, FEWEST, len(found.energies)))
    leading = np.ascontiguousarray(found.directions[:, :kept].T[::-1])
    rotated = leading @ np.ascontiguousarray(signals).reshape(outputs, -1).view(float)
    return np.asarray(rotated.view(complex).reshape(kept, *signals.shape[1:]))


def fixed_poles(frequencies: Float[np.ndarray, "freq"]) -> Complex[np.ndarray, "term"]:
    """Fixed poles of the residual terms: one below the band and one above it stand for all that is farther away."""
    return 2 * np.pi * np.array([frequencies[0] / EDGE, frequencies[-1] * EDGE]) * FIXED


def residual_terms(data: Observations, poles: Complex[np.ndarray, "term"]) -> Background:
    """Residual terms that are orthonormal under the mean weights of the observations."""
    return model.background(data.s, np.mean(data.weights, axis=(0, 1)), poles)
