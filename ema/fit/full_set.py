"""The optimum on all outputs of a set that is larger than memory, from that on its channels.

The channels (`ema.fit.compression`) give the poles and where the linear unknowns of every output begin. One pass over
the set collects the information, the gradient and the scatter of the shared unknowns, with the weights of every line
of every FRF, by the same equations as in memory (`ema.fit.estimator`); a Gauss-Newton step leads to the optimum of the
full set. Another pass gives shapes and their uncertainty, some outputs at a time.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from ema.data import Finding, FrfSet, ModalModel, ModalUncertainty, Residuals
from ema.dof import Dof, match
from ema.fit import estimator, model, noise, output_correlation, refinement, scatter, search, uncertainty
from ema.fit.compression import Compressed, slabs
from ema.fit.estimator import FewerTerms, Fit, Observations
from ema.fit.line_correlation import LineCorrelation
from ema.fit.narrow import caution
from ema.fit.prepare import Prepared
from ema.fit.refinement import NoiseShape, Refined
from ema.fit.uncertainty import PoleErrors
from ema.progress import Progress, silent

_LEFT = 0.01
"""What a step may leave of a pole, in its standard deviations, before another pass looks for the optimum from there: a
hundredth changes no interval that anyone reads; half of it would ask for a pass more where steps are 30 % shorter."""
_COMPLETE = 1.1
"""Energy that the channels leave out over that of noise, from which on it may be more than noise: the level of noise is
known to some per cent. Above it a warning says so; no value depends on it."""
_PASSES = 3
"""Such passes at most: a bound on the work, for each reads the whole set."""


@dataclass(frozen=True)
class FullSet:
    """The optimum of the shared unknowns on all outputs, and what is needed for shapes and their uncertainty.

    ``optimum`` and ``errors`` are those of the poles; ``shapes`` are where those of all outputs begin. ``anchors`` are
    the fits of the outputs that set the scale of shapes, ``anchored`` (anchor,) their rows; ``used`` are the residual
    terms that are fitted, which may be fewer than those that the intervals know of.
    """

    band: FrfSet
    packed: Compressed
    start: "_Start"
    data: Prepared
    optimum: Refined
    errors: PoleErrors
    used: int
    shapes: Complex[np.ndarray, "out mode"]
    anchors: Fit
    anchored: Int[np.ndarray, "anchor"]

    @property
    def finding(self) -> Finding:
        """How well the channels hold the set."""
        packed, where = self.packed, self.band.name or "fit"
        enough, (outputs, channels) = packed.error <= _COMPLETE, packed.directions[packed.alive].shape
        return Finding(
            "info" if enough else "warning",
            "compressed",
            where,
            f"Modes were searched for along {channels} main directions of the {outputs} outputs; what these leave out "
            f"has {packed.error:.3g} times the energy of the noise.",
            value=packed.error,
            limit=_COMPLETE,
            advice=""
            if enough
            else "Fit parts of the structure by themselves (pick): modes of single outputs may be missing.",
        )

    def model(
        self,
        make: Callable[[Prepared, Refined, PoleErrors], ModalModel],
        progress: Progress = silent,
    ) -> ModalModel:
        """The modal model of all outputs; ``make`` makes that of some of them."""
        parts: list[tuple[np.ndarray, ModalModel]] = []
        fit = self.optimum.fit
        for rows, flat, _ in self.start.observed(self.band, progress, "shapes"):
            new = ~np.isin(rows, self.anchored)
            if not new.any() and parts:
                continue
            begin = self.shapes[rows][:, None], np.zeros((len(rows), 1, fit.rest.shape[2], self.used))
            found = _evaluated(flat, fit, self.used, begin)[1]
            both = _joined(self.anchors, found, new)
            both = replace(both, information=fit.information, before=fit.before, gradient=fit.gradient, cost=fit.cost)
            places = np.concatenate([self.anchored, rows[new]])
            dofs = tuple(self.start.dofs[place] for place in places)
            optimum = replace(self.optimum, fit=replace(both, share=fit.share))
            part = make(replace(self.data, dofs=dofs, rows=places), optimum, uncertainty.errors_of(optimum))
            parts.append((places, part))
        return _whole(parts, len(self.anchored), self.start.dofs, self.packed.alive)


@dataclass(frozen=True)
class _Start:
    """How the outputs of a set become observations, with weights, and where their linear unknowns begin.

    ``columns`` are the references of the fit among those of the set; ``correction`` (channel, in, freq) is what was
    taken off the channels.
    """

    packed: Compressed
    optimum: Refined
    dofs: tuple[Dof, ...]
    columns: list[int]
    derivative: int
    correction: Complex[np.ndarray, "channel in freq"] | None
    noise: NoiseShape | None = None

    @cached_property
    def _references(self) -> Float[np.ndarray, "in"]:
        """Noise of each reference over that of all, by the sample."""
        values, known = np.asarray(self.packed.sample.values), noise.measured(self.packed.sample)
        level = noise.from_differences(values) if known is None else noise.from_variance(known)
        return level.references[self.columns]

    def _one_row(self, signals: Complex[np.ndarray, "out in line"]) -> Observations:
        """Observations in which all lines count the same."""
        s = self.optimum.data.s
        return Observations(s, signals[None], np.abs(s) ** (2 * self.derivative) / self._references[None, :, None] ** 2)

    @cached_property
    def _equal_lines(self) -> Fit:
        """The optimum on the channels where all lines count the same."""
        fit, data = self.optimum.fit, self._one_row(self.optimum.data.signals[:, 0])
        linear = fit.shapes.transpose(1, 0, 2), fit.rest.transpose(1, 0, 2, 3)
        start = estimator.evaluate(data, fit.poles, fit.participation, fit.terms, linear)
        return estimator.refine(data, start, tolerance=1e-6, prior=refinement.LOOSE, free_outside=True)

    def observed(self, frfs: FrfSet, progress: Progress, task: str) -> Iterator[tuple[np.ndarray, Observations, Fit]]:
        """Places of the outputs that are not dead, their observations, and the fit where they begin, slab by slab."""
        for place, slab in slabs(frfs, progress, task):
            rows = np.flatnonzero(self.packed.alive[place]) + place.start
            if len(rows):
                yield rows, *self.of(slab, rows, rows - place.start)

    def of(
        self, slab: FrfSet, rows: Int[np.ndarray, "out"], places: Int[np.ndarray, "out"]
    ) -> tuple[Observations, Fit]:
        """Observations of outputs ``places`` of a slab, which are ``rows`` of the set, and the fit where they begin."""
        assert self.noise is not None
        flat, own = self._alone(slab, rows, places)
        weights = self.noise.weights(flat, own, slice(None), self._known(slab, places))
        return replace(flat, weights=weights), _bare(self.optimum.fit, own.shapes, own.rest)

    def _alone(
        self, slab: FrfSet, rows: Int[np.ndarray, "out"], places: Int[np.ndarray, "out"]
    ) -> tuple[Observations, Fit]:
        """The same before there are weights: fits of each output in which all lines count the same, as in memory."""
        weight = self.packed.scale[rows, None] * self.packed.directions[rows]
        values = np.asarray(slab.values)[:, places][:, :, self.columns].transpose(1, 2, 0)
        if self.correction is not None:
            values = values - np.tensordot(weight, self.correction, 1)
        s = 2j * np.pi * np.asarray(slab.frequencies)
        signals, equal = values * s**-self.derivative, self._equal_lines
        linear = (weight @ equal.shapes[0])[None], np.tensordot(weight, equal.rest[0], 1)[None]
        observed = self._one_row(signals)
        found = estimator.evaluate(observed, equal.poles, equal.participation, equal.terms, linear, held=True)
        own = _bare(equal, found.shapes.transpose(1, 0, 2), found.rest.transpose(1, 0, 2, 3))
        return Observations(s, signals[:, None], np.ones(signals.shape)), own

    def with_noise(self) -> "_Start":
        """The same with the structure of the noise that the sample shows."""
        packed = self.packed
        every = np.arange(len(packed.rows))
        flat, own = self._alone(packed.sample, packed.rows, every)
        known = self._known(packed.sample, every)
        return replace(self, noise=refinement.noise_shape(flat, own, self.derivative, known, self.optimum.misfit))

    @property
    def stated(self) -> bool:
        """Whether the noise is what was stated with the FRFs."""
        tones = estimator.undamped(self.optimum.data, self.optimum.fit.poles)
        return self.packed.stated and not self.optimum.misfit and not tones.any()

    def _known(self, slab: FrfSet, places: Int[np.ndarray, "out"]) -> Float[np.ndarray, "out in freq"] | None:
        """Variance that came with the FRFs; ``None`` where it is not what limits the fit."""
        if not self.stated:
            return None
        found = noise.measured(slab)
        assert found is not None
        return np.ascontiguousarray(found[:, places][:, :, self.columns].transpose(1, 2, 0))


class _Sums:
    """What a pass over the set collects of the shared unknowns at given poles and participation.

    What scatters is looked at in a fit with the ``likely`` residual terms, those that the channels need.
    """

    def __init__(self, fit: Fit, likely: int, count: int, drives: Int[np.ndarray, "drive"]) -> None:
        modes, unknowns = len(fit.poles), len(fit.gradient)
        self.fit, self.likely, self.drives, self.columns = fit, likely, drives, fit.terms.mixing.shape[1]
        self.information, self.gradient, self.before = (
            np.zeros(shape) for shape in ((unknowns, unknowns), (unknowns,), (unknowns,))
        )
        self.of_likely, self.before_likely = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
        self.fewer: dict[int, FewerTerms] = {}
        self.share, self.cost, self.equations, self.outputs = np.ones(modes), 0.0, 0, 0
        self.above_noise, self.shapes = np.zeros(modes), np.zeros((count, modes), complex)
        self.told, self.pull = np.zeros((count, modes)), np.zeros((count, unknowns))
        self.pull_of_lines: Float[np.ndarray, "group unknown"] | float = 0.0
        self.largest: dict[int, tuple[float, int]] = {}
        self.kept: dict[int, Observations] = {}

    def take(self, rows: Int[np.ndarray, "out"], flat: Observations, begin: Fit) -> None:
        """Add some outputs."""
        fit = self.fit
        # What the channels ask for (`estimator.with_orthogonal_matrices`) the outputs need as well.
        orthogonal = fit.rounding == estimator.ORTHOGONAL
        start = begin.shapes, begin.rest
        found = estimator.evaluate(flat, fit.poles, fit.participation, fit.terms, start, orthogonal=orthogonal)
        at_likely = _evaluated(flat, found, self.likely, start)[0] if self.likely < self.columns else found
        self.information += found.information
        self.gradient += found.gradient
        self.before += found.before
        self.share = np.minimum(self.share, found.share)
        self.cost += found.cost
        self.of_likely += at_likely.information
        self.before_likely += at_likely.before
        self.equations += flat.equations
        self.outputs += len(rows)
        modes = len(fit.poles)
        diagonal = np.diagonal(found.local, axis1=1, axis2=2)
        noise = np.maximum(diagonal[:, :modes] + diagonal[:, modes:], np.finfo(float).tiny)
        self.above_noise += np.sum(np.abs(found.shapes[:, 0]) ** 2 / noise, axis=0)
        self.shapes[rows] = found.shapes[:, 0]
        of_unit = replace(found, shapes=np.ones_like(found.shapes))
        per_unit = np.zeros((len(rows), 1, len(found.gradient) // 2), complex)
        for block in flat.row_blocks(flat.signals[0].size, estimator.VALUES):
            pull = scatter.pulls_of_lines(flat, at_likely, block)
            self.pull[rows[block]] = pull.sum(axis=0)
            self.pull_of_lines = self.pull_of_lines + pull.sum(axis=1)
            self.told[rows[block]] = scatter.told_by_outputs(flat, at_likely, block)
            left = estimator.pulls(flat, of_unit, estimator.residual(flat, found, block), block)
            per_unit[block] = left[..., : per_unit.shape[-1]] + 1j * left[..., per_unit.shape[-1] :]
        for columns in range(self.columns - 2, -1, -2):
            own = FewerTerms.of(found, columns, per_unit)
            self.fewer[columns] = self.fewer[columns] + own if columns in self.fewer else own
        self._keep(rows, flat)

    def _keep(self, rows: Int[np.ndarray, "out"], flat: Observations) -> None:
        """Keep the outputs that set the scale of shapes: references, and the largest component of each mode."""
        size = np.abs(self.shapes[rows])
        for mode, place in enumerate(np.argmax(size, axis=0)):
            if size[place, mode] > self.largest.get(mode, (-1.0, 0))[0]:
                self.largest[mode] = float(size[place, mode]), int(rows[place])
        wanted = {row for _, row in self.largest.values()} | set(self.drives.tolist())
        for place in np.flatnonzero(np.isin(rows, list(wanted))):
            own = slice(place, place + 1)
            self.kept[int(rows[place])] = replace(
                flat, signals=flat.signals[own].copy(), weights=flat.weights[own].copy()
            )
        self.kept = {row: one for row, one in self.kept.items() if row in wanted}

    @property
    def all_terms(self) -> Fit:
        """The shared unknowns of this pass with what all outputs say of them."""
        return replace(
            self.fit,
            information=self.information,
            gradient=self.gradient,
            before=self.before,
            cost=self.cost,
            share=self.share,
        )

    @cached_property
    def used(self) -> int:
        """Residual terms that noise does not explain (`ema.fit.refinement`)."""
        columns, lost = self.columns, 0.0
        per_column, factor = self.outputs * len(self.fit.participation), self.factor(self.columns)
        for fewer in sorted(self.fewer, reverse=True):
            without = self.fewer[fewer].increase(self.all_terms)
            if not refinement.within_noise(without - lost, per_column * (columns - fewer), factor):
                break
            lost, columns = without, fewer
        return int(columns)

    def factor(self, columns: int) -> float:
        """Residual energy per real equation left over at the optimum with the first residual terms."""
        fit, at = self.fit, self.all_terms
        step = self._step(self.gradient, self.information)
        cost = self.cost - float(step @ (2 * self.gradient - self.information @ step))
        cost += self.fewer[columns].increase(at) if columns in self.fewer else 0.0
        unknowns = self.outputs * (2 * len(fit.poles) + len(fit.participation) * columns) + len(fit.gradient)
        return max(cost, 0.0) / max(self.equations - unknowns, 1)

    def step(self) -> Float[np.ndarray, "unknown"]:
        """Gauss-Newton step to the optimum of the full set with the residual terms that are used."""
        fewer = self.fewer.get(self.used)
        if fewer is None:
            return self._step(self.gradient, self.information)
        return self._step(self.gradient - fewer.gradient, self.information + fewer.information)

    def _step(
        self, gradient: Float[np.ndarray, "unknown"], information: Float[np.ndarray, "unknown unknown"]
    ) -> Float[np.ndarray, "unknown"]:
        # The prior of a step is loose: with a variance factor of that size the root has both.
        root = estimator.root(replace(self.all_terms, information=information), refinement.LOOSE)
        return np.asarray(root @ (root.T @ gradient) / refinement.LOOSE)

    def left(self) -> float:
        """What the step leaves of a pole at most, in its standard deviations: its square over the decay rate, since the
        function of a pole changes in proportion over as much.
        """
        step, half = self.step(), len(self.gradient) // 2
        modes = np.arange(len(self.fit.poles))
        std = np.linalg.norm(estimator.root(self.all_terms, max(self.factor(self.used), 1e-300)), axis=1)
        moved = step[modes] ** 2 + step[half + modes] ** 2
        least = np.maximum(np.minimum(std[modes], std[half + modes]), 1e-300)
        return float(np.max(moved / (least * np.abs(self.fit.poles.real)), initial=0.0))

    def at_optimum(self) -> Fit:
        """The shared unknowns after the step, with the information of the full set where all terms are free."""
        rest = np.broadcast_to(0.0, (len(self.shapes), 1, *self.fit.rest.shape[2:]))
        known = replace(self.all_terms, gradient=np.zeros(len(self.gradient)))
        return _bare(_moved(known, self.step()), self.shapes[:, None], rest)


def full_set(
    band: FrfSet,
    packed: Compressed,
    data: Prepared,
    optimum: Refined,
    possible: Bool[np.ndarray, "pole"],
    *,
    progress: Progress = silent,
) -> FullSet:
    """The optimum on all outputs next to that on the channels; ``data`` are the channels that were fitted."""
    fit, references = optimum.fit, packed.frfs.inputs
    every = band.outputs if references == band.inputs else band.inputs
    columns = data.columns.tolist()
    own = np.asarray(packed.frfs.values)[-len(data.frequencies) :, :, columns]
    taken_off = own - data.values if own.shape == data.values.shape else np.zeros(0)
    correction = taken_off.transpose(1, 2, 0) if np.any(taken_off != 0) else None
    start = _Start(packed, optimum, every, columns, data.derivative, correction).with_noise()
    drives = np.array([row for _, row, _ in match(data.references, every)], int)
    at = fit
    for _ in range(_PASSES):
        sums = _Sums(at, optimum.at_optimum.rest.shape[-1], len(every), drives[packed.alive[drives]])
        for rows, observed, begin in start.observed(band, progress, "information"):
            sums.take(rows, observed, begin)
        final = sums.at_optimum()
        if sums.left() <= _LEFT:
            break
        at = final
    used = sums.used
    refined, flat = _with_scatter(sums, final, start, possible, band=band)
    errors = replace(
        uncertainty.errors_of(replace(refined, fit=_bare(final, final.shapes[:0], final.rest[:0]))),
        scatter=_scatter(sums, refined),
    )
    anchored = np.array(sorted(sums.kept), int)
    anchors = Observations(
        flat.s,
        np.concatenate([sums.kept[row].signals for row in anchored]),
        np.concatenate([sums.kept[row].weights for row in anchored]),
    )
    at_anchors = sums.shapes[anchored][:, None], np.zeros((len(anchored), 1, len(data.references), used))
    alive = tuple(dof for dof, one in zip(every, packed.alive, strict=True) if one)
    dead = tuple(dof for dof, one in zip(every, packed.alive, strict=True) if not one)
    return FullSet(
        band=band,
        packed=packed,
        start=start,
        data=replace(
            data,
            dofs=alive,
            rows=np.flatnonzero(packed.alive),
            dead=(*dead, *data.dead),
            swapped=references != band.inputs,
        ),
        optimum=refined,
        errors=errors,
        used=used,
        shapes=sums.shapes,
        anchors=_evaluated(anchors, final, used, at_anchors)[1],
        anchored=anchored,
    )


def needless(optimum: Refined, possible: Bool[np.ndarray, "pole"], outputs: int) -> Int[np.ndarray, "gone"]:
    """Poles of the optimum on channels that noise explains on so many ``outputs``, as in memory (`ema.fit.refinement`).

    A pole that follows noise finds it in the channels, which are the directions where there is most of it. On the
    outputs it explains what it does on the channels, and what noise of mean energy gives to the shapes of the others.
    """
    fit, data = optimum.at_optimum, optimum.data
    if optimum.misfit or not len(fit.poles):
        return np.zeros(0, int)
    others = max(outputs - data.outputs, 0)
    gain = estimator.gains(data, fit) / max(fit.variance_factor(data), 1e-300)
    gain /= LineCorrelation.of_noise(data, fit).factor(fit.poles)
    freedom = 2.0 * (outputs + data.references)
    in_band = search.passes_for_weak(freedom) * caution(fit.poles, fit.poles, data.line)
    share = (gain + 2 * others) / np.where(possible, in_band, freedom + estimator.DOUBT * np.sqrt(2 * freedom))
    gone: list[int] = []
    for pole in np.argsort(share):
        # Without one of them its neighbour may be needed.
        reach = 4 * (np.abs(fit.poles[gone].real) + abs(fit.poles[pole].real))
        if share[pole] <= 1 and np.all(np.abs(fit.poles[gone] - fit.poles[pole]) > reach):
            gone.append(int(pole))
    return np.array(gone, int)


def _with_scatter(
    sums: _Sums,
    final: Fit,
    start: _Start,
    possible: Bool[np.ndarray, "pole"],
    *,
    band: FrfSet,
) -> tuple[Refined, Observations]:
    """The optimum with what its intervals rest on, and the observations of the sample."""
    packed, optimum = start.packed, start.optimum
    flat, begin = start.of(packed.sample, packed.rows, np.arange(len(packed.rows)))
    at_sample = _evaluated(flat, final, sums.used, (begin.shapes, begin.rest[..., : sums.used]))[0]
    effective_lines = band.effective_lines
    by_themselves = None if effective_lines is None else flat.weights / effective_lines[-len(flat.s) :]
    of_poles, of_shapes, shared = refinement.loss(flat, at_sample, by_themselves)
    if band.output_correlation is not None and band.inputs == packed.frfs.inputs:
        correlation = band.output_correlation[-len(flat.s) :, start.columns].T
        of_poles = of_poles * output_correlation.factor(
            flat, at_sample, correlation, int(np.count_nonzero(packed.alive))
        )
    at_peaks = refinement.misfit_at_peaks(flat, at_sample) if optimum.misfit else np.ones(len(final.poles))
    factor = sums.factor(sums.used)
    likely = replace(sums.all_terms, information=sums.of_likely, before=sums.before_likely)
    change = scatter.Changes.of(flat, likely, factor, factor * of_poles)
    found = {
        "noise that the FRFs share": scatter.of_lines(
            likely, change, np.asarray(sums.pull_of_lines), lines=len(flat.s), shared=shared
        ),
        "scatter between the FRFs": scatter.of_outputs(
            likely, change, sums.told[packed.alive], sums.pull[packed.alive]
        ),
    }
    between, of_what = refinement.largest(found, possible)
    if start.stated:
        basis = "variance of the FRFs, scaled to the residuals"
    else:
        basis = optimum.basis.partition(";")[0]
    inflation = refinement.inflation_of(flat, final, factor * of_poles, at_peaks, between)
    refined = replace(
        optimum,
        fit=final,
        data=flat,
        inflation=inflation,
        inflation_of_shapes=factor * of_shapes * at_peaks,
        loss=of_poles,
        basis=basis + of_what,
    )
    return refined, flat


def _scatter(sums: _Sums, refined: Refined) -> Float[np.ndarray, "pole"]:
    """Variance of each shape over its energy, by the errors of each output and in units of these."""
    return np.asarray(refined.inflation_of_shapes * sums.outputs / np.maximum(sums.above_noise, 1e-300))


def _moved(fit: Fit, step: Float[np.ndarray, "unknown"]) -> Fit:
    """The poles and the participation after a step.

    Where another reference has the largest entry of a mode afterwards, that one becomes 1: with j in its place each
    entry is ``L_k / L_j``, and the information is that of the new unknowns.
    """
    modes, half = len(fit.poles), len(step) // 2
    change = step[:half] + 1j * step[half:]
    participation = fit.participation.copy()
    participation.reshape(-1)[fit.free] += change[modes:]
    moved = replace(fit, poles=fit.poles + change[:modes], participation=participation)
    free = estimator.free_entries(participation)
    if np.array_equal(free, fit.free):
        return moved
    largest = participation[np.argmax(np.abs(participation), axis=0), np.arange(modes)]
    normal = participation / largest
    # Old unknowns by the new ones: L_k = L'_k / L'_i, i the entry that was 1.
    by_new = np.zeros((half, half), complex)
    by_new[np.arange(modes), np.arange(modes)] = 1
    for row, old in enumerate(fit.free):
        mode = old % modes
        was_one = next(e for e in range(mode, participation.size, modes) if e not in fit.free)
        base = normal.reshape(-1)[was_one]
        for column, new in enumerate(free):
            if new == old:
                by_new[modes + row, modes + column] += 1 / base
            if new == was_one:
                by_new[modes + row, modes + column] -= normal.reshape(-1)[old] / base**2
    real = np.block([[by_new.real, -by_new.imag], [by_new.imag, by_new.real]])
    return replace(
        moved,
        participation=normal,
        free=free,
        information=real.T @ fit.information @ real,
        before=(real**2).T @ fit.before,
        gradient=real.T @ fit.gradient,
    )


def _evaluated(flat: Observations, fit: Fit, used: int, begin: tuple[np.ndarray, np.ndarray]) -> tuple[Fit, Fit]:
    """Fits of some outputs at given poles: with the residual terms that are used, and the same with what would be known
    of it with all of them.
    """
    terms: model.Background = fit.terms
    columns, orthogonal = terms.mixing.shape[1], fit.rounding == estimator.ORTHOGONAL
    start = begin[0], begin[1][..., :used]
    narrow = estimator.evaluate(flat, fit.poles, fit.participation, terms.fewer(used), start, orthogonal=orthogonal)
    if used == columns:
        return narrow, narrow
    rest = np.concatenate([narrow.rest, np.zeros((*narrow.rest.shape[:-1], columns - used))], axis=-1)
    start = narrow.shapes, rest
    wide = estimator.evaluate(flat, fit.poles, fit.participation, terms, start, orthogonal=orthogonal)
    return narrow, replace(wide, shapes=narrow.shapes, rest=rest)


def _joined(anchors: Fit, found: Fit, new: Bool[np.ndarray, "row"]) -> Fit:
    """The rows of the anchors, then those of a fit that are ``new``."""

    def both(name: str) -> np.ndarray:
        return np.concatenate([getattr(anchors, name), getattr(found, name)[new]])

    return replace(
        anchors,
        shapes=both("shapes"),
        rest=both("rest"),
        local=both("local"),
        slope=both("slope"),
        lean=both("lean"),
        of_rest=both("of_rest"),
    )


def _bare(fit: Fit, shapes: Complex[np.ndarray, "row 1 mode"], rest: Float[np.ndarray, "row 1 in column"]) -> Fit:
    """The shared unknowns of a fit with the linear ones of other outputs, not eliminated."""

    def no(name: str) -> np.ndarray:
        return np.broadcast_to(0.0, (len(shapes), *getattr(fit, name).shape[1:]))

    return replace(
        fit, shapes=shapes, rest=rest, local=no("local"), slope=no("slope"), lean=no("lean"), of_rest=no("of_rest")
    )


def _whole(
    parts: list[tuple[np.ndarray, ModalModel]], anchors: int, dofs: tuple[Dof, ...], alive: Bool[np.ndarray, "out"]
) -> ModalModel:
    """The model of all outputs from those of some, each with the anchors first."""
    first = parts[0][1]
    places = np.concatenate([parts[0][0], *(rows[anchors:] for rows, _ in parts[1:])])
    order = np.argsort(places)
    assert np.array_equal(places[order], np.flatnonzero(alive))
    # Of two components that are equal but for rounding each part may take another one as the largest.
    turns = [_turn(first, part, anchors) for _, part in parts]

    def rows(name: str, axis: int, source: str = "", turned: bool = False) -> np.ndarray:
        arrays = []
        for number, (_, part) in enumerate(parts):
            array = np.asarray(getattr(getattr(part, source) if source else part, name))
            if turned:
                array = array * (turns[number] if axis == 0 else turns[number][:, None, None])
            arrays.append(array if not number else np.delete(array, np.s_[:anchors], axis=axis))
        return np.take(np.concatenate(arrays, axis=axis), order, axis=axis)

    stated: ModalUncertainty | None = first.uncertainty
    if stated is not None:
        stated = replace(
            stated,
            shapes=rows("shapes", 1, "uncertainty"),
            common=rows("common", 1, "uncertainty", turned=True),
            residues=rows("residues", 1, "uncertainty"),
        )
    return replace(
        first,
        shapes=rows("shapes", 0, turned=True),
        dofs=tuple(dofs[place] for place in places[order]),
        residuals=Residuals(
            lower=rows("lower", 0, "residuals"),
            upper=rows("upper", 0, "residuals"),
            poles=first.residuals.poles if first.residuals is not None else np.zeros(0, complex),
            residues=rows("residues", 1, "residuals"),
        ),
        uncertainty=stated,
    )


def _turn(first: ModalModel, part: ModalModel, anchors: int) -> Complex[np.ndarray, "mode"]:
    """Factor of the shapes of a part that makes those of the anchors the same as in the first."""
    a, b = first.shapes[:anchors], part.shapes[:anchors]
    energy = np.sum(np.abs(b) ** 2, axis=0)
    return np.asarray(np.sum(b.conj() * a, axis=0) / np.where(energy > 0, energy, 1))
