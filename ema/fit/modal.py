"""From poles to modes: selection, residues with what lies outside, scaling."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from ema.data import Candidate, Finding, FrfSet, ModalModel, PoleTable, Residuals, damping_ratios, natural_frequencies
from ema.data.modal import COVERAGE_FACTOR
from ema.errors import InputError
from ema.fit import (
    broadening,
    channel_phase,
    noise,
    padding,
    peak_shape,
    set_up_shifts,
    set_ups,
    smoothing,
    uncertainty,
    unexplained,
)
from ema.fit.acceptance import Verdict, judge, surplus, with_shapes
from ema.fit.candidates import like_modes
from ema.fit.canonical import canonical, model_in_order, one_thread, table_in_order
from ema.fit.companions import companions
from ema.fit.compression import compressed
from ema.fit.estimator import Fit
from ema.fit.full_set import FullSet, full_set, needless
from ema.fit.narrow import narrow_peaks
from ema.fit.policy import POLICY
from ema.fit.prepare import Prepared, check_statements, prepare
from ema.fit.record_end import as_recorded, of_whole_vibration
from ema.fit.refinement import Refined, Start, known_variance, refined, with_weak, without_needless
from ema.fit.scaling import disagreements, scale_to_unit_modal_mass
from ema.fit.search import OPERATIONS
from ema.fit.selection import Dropped, Selection, extended, of_poles, reduced, select
from ema.fit.stabilisation import stabilise
from ema.fit.uncertainty import PoleErrors
from ema.fit.without_modes import without_modes
from ema.messages import mark
from ema.progress import Progress, advance, silent

_MORE_POLES = 1.5
"""Poles of corrected FRFs over those as they were from which on a correction is none. FRFs averaged over 3 to 9 lines
took 0.4 to 0.6 times as many, those of a local model over nine, whose noise is that of an average, 5 to 6 times."""
_SEARCHES = 6
"""How often the residual of an optimum is searched for further poles: a strong one may hide another one. A bound on the
work: it ends before where a search finds nothing."""
_NAMED = 10
"""Poles left out of the fit that are named one by one; the others are counted. No value depends on it."""


def modes(
    frfs: FrfSet,
    poles: PoleTable,
    near: float | Sequence[float] | None = None,
    index: int | Sequence[int] | None = None,
    shapes: Literal["complex", "real"] = "complex",
    progress: Progress = silent,
) -> ModalModel:
    """Fit a modal model to FRFs: natural frequencies, damping, shapes, participation, residual terms and intervals.

    All poles of the band are fitted together by maximum likelihood, with what lies outside it. A pole is accepted as a
    mode when noise cannot explain it and its values and shape are certain enough; otherwise it is listed among the
    ``candidates`` of the model, with the reason. Names choose what is reported, and change no value.

    Parameters
    ----------
    frfs : FrfSet
        The FRFs; the band is that of ``poles``. A set in a file that is larger than memory is read twice more, a few
        outputs at a time.
    poles : PoleTable
        Poles of all model orders (:func:`stabilise`).
    near : float or sequence of float, optional
        Frequencies [Hz]: the modes next to these are reported, accepted or not. A frequency named twice asks for both
        modes of a repeated root.
    index : int or sequence of int, optional
        Rows of ``poles``: the modes that these poles belong to are reported.
    shapes : {"complex", "real"}, default "complex"
        Complex shapes, or real ones (each mode rotated to its mean phase).
    progress : Progress, optional
        Called during the fit.

    Returns
    -------
    ModalModel
        The accepted modes by ascending frequency, or those named.

    Raises
    ------
    InputError
        If the FRFs cannot be fitted, or there is no pole near a named frequency.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> from ema.fit import stabilise
    >>> frfs = frf_set(0.001)
    >>> modes(frfs, stabilise(frfs)).natural_frequencies.round(1)
    array([40., 60., 90.])
    """
    if shapes not in ("complex", "real"):
        raise InputError("unknown kind of shapes", got=repr(shapes), expected="complex or real")
    _named_frequencies(near)
    _named_rows(index)
    model = estimated(frfs, poles, progress).model(near, index)
    return _real(model) if shapes == "real" else model


@dataclass(frozen=True)
class Estimate:
    """All poles of the band fitted and judged: what `modes` reports, for any choice of modes (`model`).

    ``shapes`` are residuals that have the shape of a peak, ``alone`` (pole,) the probability that a pole is not several
    modes that overlap; ``compared`` are the modes of the set-ups of a test; ``full_set`` has the outputs of a set that
    is larger than memory, ``dense`` says how much denser than the records resolve the lines of ``frfs`` are, of which
    ``band`` has those that they resolve, in the form in which they are fitted, and ``scale`` is the factor from its
    residues to those of ``frfs`` (`ema.fit.canonical`); ``shown`` is what makes peaks broader, ``uncorrected`` (mode,)
    are the poles that FRFs show before it is taken off, ``undecided`` says that nothing tells whether resonances were
    averaged as the noise was, ``solution`` (mode,) where the next step would take the poles that have not converged in
    this, ``feedback`` what it makes of errors; ``stopped`` says that the search for poles was ended
    (`ema.fit.search.OPERATIONS`).
    """

    frfs: FrfSet
    table: PoleTable
    band: FrfSet
    data: Prepared
    optimum: Refined
    errors: PoleErrors
    verdict: Verdict
    dropped: tuple[Dropped, ...]
    shapes: tuple[peak_shape.PeakShape, ...]
    alone: Float[np.ndarray, "pole"]
    compared: set_ups.Comparison | None = None
    shown: broadening.Broadening | None = None
    uncorrected: Complex[np.ndarray, "first"] | None = None
    solution: Complex[np.ndarray, "last"] | None = None
    undecided: bool = False
    feedback: uncertainty.Gains = ()
    full_set: FullSet | None = None
    dense: padding.Density | None = None
    scale: float = 1.0
    stopped: bool = False

    def model(
        self, near: float | Sequence[float] | None = None, index: int | Sequence[int] | None = None
    ) -> ModalModel:
        """The accepted modes, or those named (`modes`).

        Raises
        ------
        InputError : there is no pole near a wanted frequency.
        """
        fit, verdict = self.optimum.fit, self.verdict
        near, index = _named_frequencies(near), _named_rows(index)
        if near is None and index is None:
            order = np.flatnonzero(verdict.accepted)
        else:
            order = np.array(_named(fit, verdict, self.table, near, index, self.frfs), int)
        order = order[np.argsort(np.abs(fit.poles[order]), kind="stable")]

        def made(data: Prepared, optimum: Refined, errors: PoleErrors) -> ModalModel:
            errors = replace(errors, beyond=self.errors.beyond)
            return _model(
                self.band,
                data,
                *of_whole_vibration(optimum, errors, order, self.band, scale=self.scale),
                verdict,
                order,
            )

        def made_of_part(data: Prepared, optimum: Refined, errors: PoleErrors) -> ModalModel:
            return made(data, optimum, uncertainty.amplified(errors, optimum.fit, self.feedback))

        if self.full_set is None:
            model = model_in_order(made(self.data, self.optimum, self.errors), self.frfs)
        else:
            model = self.full_set.model(made_of_part)
            model = replace(model, findings=(*model.findings, self.full_set.finding))
        model = replace(model, findings=(*model.findings, *companions(model), *without_modes(model)))
        if self.compared is not None and self.frfs.set_ups is not None:
            model = set_up_shifts.stated(model, self.compared, self.frfs.set_ups)
        model = self._unsettled(model)
        added = self.errors.beyond[order]
        model = uncertainty.widened(model, added, "what the shape of the residual amounts to")
        reported = tuple(shape for shape in self.shapes if shape.pole in order)
        frequencies = natural_frequencies(fit.poles + self.band.added_decay)
        peaks = peak_shape.findings(reported, frequencies, self.band.name or "fit")
        notes = _findings(self.band, self.data, self.optimum, self.errors, verdict, order, self.dropped)
        turned = channel_phase.turns(model, self.data.swapped)
        model = channel_phase.widened(model, turned)
        peaks = (*peaks, *channel_phase.findings(turned, self.band.name or "fit"))
        return replace(
            model, findings=(*self._search(), *self._density(), *notes, *self._leakage(model), *peaks, *model.findings)
        )

    def _search(self) -> tuple[Finding, ...]:
        """That the search was ended, and what it left."""
        if not self.stopped:
            return ()
        left = self.optimum.fit.cost / max(self.optimum.data.energy, np.finfo(float).tiny)
        return (
            Finding.of(
                "warning",
                "search-ended",
                self.band.name or "fit",
                "The search for modes was ended after {operations} operations, and what it leaves "
                "({left} of the energy of the FRFs over their noise level) is no noise: the FRFs are hardly those of "
                "a linear structure with a few modes.",
                float(left),
                advice="Look at the FRFs and the channel table (is the force channel the force?), or choose a narrower "
                "band.",
                operations=f"{OPERATIONS:.0e}",
                left=f"{left:.2g}",
            ),
        )

    def _density(self) -> tuple[Finding, ...]:
        """That lines are denser than the records resolve."""
        if self.dense is None:
            return ()
        return (
            Finding.of(
                "info",
                "dependent-lines",
                self.band.name or "fit",
                "The frequency lines are {factor} times as dense as the records resolve, as zeros appended to them "
                "make them: errors of neighbouring lines are not independent. Lines {spacing} Hz apart were fitted, "
                "which hold what was measured.",
                self.dense.factor,
                advice="Nothing has to be done; FRFs without appended zeros are fitted faster.",
                factor=f"{self.dense.factor:.2g}",
                spacing=f"{self.band.frequency_step:.4g}",
            ),
        )

    def _unsettled(self, model: ModalModel) -> ModalModel:
        """The model with what is not known of the correction in its intervals: what its next turn would change, or all
        of it, where nothing tells whether the resonances were averaged as the noise was.
        """
        for others in (self.solution, self.uncorrected if self.undecided else None):
            if others is None or not len(others):
                continue
            other = others[np.argmin(np.abs(model.poles[:, None] - others), axis=1)]
            moved = np.stack(
                [model.natural_frequencies - natural_frequencies(other), model.damping_ratios - damping_ratios(other)],
                axis=1,
            )
            model = uncertainty.widened(model, moved**2, "what the correction of broadened peaks leaves open")
        return model

    def _leakage(self, model: ModalModel) -> tuple[Finding, ...]:
        """What the blocks of a random test, or an average over lines, had done to the damping of these modes."""
        if self.uncorrected is None or not len(self.uncorrected) or model.covariance is None or not len(model.poles):
            return ()
        nearest = np.argmin(np.abs(model.poles[:, None] - self.uncorrected), axis=1)
        change = damping_ratios(self.uncorrected[nearest]) - model.damping_ratios
        certain = np.abs(change) / np.sqrt(np.maximum(model.covariance[:, 1, 1], np.finfo(float).tiny))
        worst = int(np.argmax(certain))
        # Intervals that hold the correction are as wide as it is.
        if certain[worst] < (np.sin(np.arctan(broadening.SEEN)) if self.undecided else broadening.SEEN):
            return ()
        where = f"{self.band.name or 'fit'}, {model.natural_frequencies[worst]:.6g} Hz"
        limit = float(broadening.SEEN * np.sqrt(model.covariance[worst, 1, 1]))
        relative = f"{change[worst] / model.damping_ratios[worst]:+.1%}"
        if isinstance(self.shown, broadening.LineAverage):
            return (
                Finding.of(
                    "info" if self.solution is None and not self.undecided else "warning",
                    "smoothed-lines",
                    where,
                    "Each value is an average over {lines} frequency lines, as the noise shows: without a correction "
                    "the damping ratio of this vibration would be wrong by {change}. {outcome}",
                    float(change[worst]),
                    limit,
                    advice="Fit FRFs that were not smoothed.",
                    lines=len(self.shown.weights),
                    change=relative,
                    outcome=self._outcome(),
                ),
            )
        return (
            Finding.of(
                "info" if self.solution is None and not self.undecided else "warning",
                "leakage",
                where,
                "Hann blocks of {record_length} s are short for this vibration: without a correction its damping ratio "
                "would be wrong by {change}. {outcome}",
                float(change[worst]),
                limit,
                advice="Use longer blocks, or the local model of the estimation, which has no leakage.",
                record_length=f"{self.band.record_length:.4g}",
                change=relative,
                outcome=self._outcome(),
            ),
        )

    def _outcome(self) -> str:
        """What became of the correction of broadened peaks."""
        if isinstance(self.shown, broadening.HannBlocks):
            if self.undecided:
                return mark(
                    "It was taken off as for H1 under a flat force, and the intervals hold both values: the force is "
                    "not flat, or this is another estimator."
                )
            if self.solution is not None:
                return mark(
                    "What the blocks do to the peaks was taken off. The correction did not converge; the intervals "
                    "were widened for it."
                )
            return mark("What the blocks do to the peaks was taken off.")
        if self.undecided:
            return mark(
                "It was taken off, and the intervals hold both values: nothing tells whether the resonances were "
                "averaged as the noise was, or left as a local model over lines leaves them."
            )
        if self.solution is not None:
            return mark(
                "What the average does to the peaks was taken off. The correction did not converge; the intervals were "
                "widened for it."
            )
        return mark("What the average does to the peaks was taken off.")


def estimated(frfs: FrfSet, poles: PoleTable, progress: Progress = silent) -> Estimate:
    """Fit and judge all poles of the band of a pole table.

    Raises
    ------
    InputError : the FRFs cannot be fitted.
    """
    check_statements(frfs)
    _check_table(poles, frfs)
    dense = padding.density(frfs)
    band, scale = canonical((frfs if dense is None else padding.resolved(frfs, dense)).band(*poles.band))
    if band.in_file:
        return _of_file(frfs, band, poles, progress)
    with one_thread():
        table, compared = table_in_order(poles, band), None
        parts = set_ups.split(band)
        if parts:
            try:
                fits = [_part(band, *part) for part in parts]
            except InputError:  # as where all sensors of a set-up were dead: nothing to compare
                fits = []
            compared = set_ups.compare(fits) if fits else None
            if compared is not None and compared.differ:
                band = set_ups.aligned(band, fits, compared)
                table = stabilise(band, np.unique(poles.order).tolist())
        found = _fitted(band, table, progress)
    return replace(found, frfs=frfs, table=poles, compared=compared, dense=dense, scale=scale)


def _check_table(poles: PoleTable, frfs: FrfSet) -> None:
    """Check that a pole table has references of the FRFs.

    Raises
    ------
    InputError : it has others.
    """
    references = frfs.outputs if len(frfs.outputs) < len(frfs.inputs) else frfs.inputs
    unknown = [dof for dof in poles.references if dof not in references]
    if unknown or len(poles.references) > len(references):
        raise InputError(
            "the pole table is not that of these FRFs",
            where=frfs.name or "FRFs",
            got=f"a table with the references {', '.join(map(str, poles.references))}",
            expected=f"some of {', '.join(map(str, references))}",
            advice="compute it from these FRFs with ema.fit.stabilise",
        )


def _of_file(frfs: FrfSet, band: FrfSet, poles: PoleTable, progress: Progress) -> Estimate:
    """Fit and judge all poles of FRFs that stay in their file: on their channels, then on all outputs."""
    packed = compressed(band, progress)
    found = _fitted(packed.frfs, poles, progress, int(np.count_nonzero(packed.alive)))
    whole = full_set(band, packed, found.data, found.optimum, found.verdict.possible, progress=progress)
    return replace(
        found,
        frfs=frfs,
        band=band,
        data=whole.data,
        optimum=whole.optimum,
        errors=uncertainty.amplified(
            replace(whole.errors, beyond=found.errors.beyond), whole.optimum.fit, found.feedback
        ),
        verdict=with_shapes(found.verdict, whole.errors.scatter, POLICY),
        full_set=whole,
    )


def _part(whole: FrfSet, outputs: list[int], inputs: list[int]) -> set_ups.PartFit:
    """The poles of one set-up of a test, of some of its outputs and inputs."""
    frfs = whole.pick(outputs, inputs)
    found = _fitted(frfs, stabilise(frfs), silent)
    fit, residues = found.optimum.fit, _residues(found)
    sides = found.data.rows, found.data.columns
    rows, columns = sides[::-1] if found.data.swapped else sides
    # The side that the set-ups share: forces where sensors rove, sensors where forces do.
    across = len(outputs) == len(whole.outputs)
    vectors = [np.linalg.svd(one, full_matrices=False) for one in residues]
    return set_ups.PartFit(
        poles=fit.poles,
        residues=residues,
        rows=np.array(outputs)[rows],
        columns=np.array(inputs)[columns],
        vectors=np.array([left[:, 0] if across else right[0] for left, _, right in vectors]),
        accepted=found.verdict.accepted,
        frequency_std=found.errors.frequency,
        damping_std=found.errors.damping,
    )


def _fitted(band: FrfSet, poles: PoleTable, progress: Progress, outputs: int | None = None) -> Estimate:
    """Fit and judge all poles of FRFs that show each mode once, or of channels for so many ``outputs``; what Hann
    blocks, or an average over lines, do to these is taken off.

    What they leave looks like further resonances: they are searched for once it is gone, and then the correction has to
    stay what it is.
    """
    shown = broadening.of(band)
    if shown is None:
        return _once(band, poles, progress, outputs=outputs)
    if isinstance(shown, broadening.LineAverage):
        band = smoothing.marked(band, shown.weights)
    history, corrected, searches = [], band, 0
    guess: broadening.Resonances | None = None
    first, given = None, poles
    for turn in range(broadening.TURNS + 1):
        estimate = _once(corrected, poles, progress, searches, outputs=outputs)
        first = estimate if first is None else first
        if _may_be_local(shown) and _worse(estimate, first):
            # The noise is that of an average, the resonances are not: a local model leaves such FRFs.
            return _once(band, given, progress, outputs=outputs)
        verdict = estimate.verdict
        # Leakage makes several uncertain poles of a peak: what is there says more of it than nothing.
        modes = verdict.accepted if turn else verdict.possible
        if not np.any(modes):
            return estimate if searches else _once(corrected, poles, progress, outputs=outputs)
        fitted = estimate.optimum.fit.poles[modes], _residues(estimate)[modes]
        history.append(fitted[0])
        if guess is None:
            settled = _in_noise(estimate, broadening.excess(shown, band, *fitted)) < broadening.NEGLIGIBLE
            step = fitted if settled else broadening.initial_guess(shown, band, *fitted)
        else:
            feedback = _feedback(shown, band, estimate, np.flatnonzero(modes))
            std = np.sqrt(np.sum(np.abs(estimate.errors.poles[modes]) ** 2, axis=1) / 2 * feedback.variances)
            step = feedback.solution(guess, fitted)
            settled = broadening.settled(guess, step, std)
        if (settled and searches) or turn == broadening.TURNS:
            own = _gains(shown, band, estimate)
            errors = uncertainty.amplified(estimate.errors, estimate.optimum.fit, own)
            # A pole is a mode by what is known of it in the end.
            verdict = _verdict(
                band,
                estimate.optimum,
                errors,
                verdict.possible,
                alone=estimate.alone,
                dropped=estimate.dropped,
            )
            estimate = replace(
                estimate,
                errors=errors,
                verdict=verdict,
                shown=shown,
                uncorrected=history[0],
                # Without the correction there is nothing but noise left either: both are possible.
                undecided=_unlike_a_flat_force(shown) or (_may_be_local(shown) and not first.optimum.misfit),
                feedback=own,
            )
            return estimate if settled else replace(estimate, solution=step[0])
        if settled:
            searches, guess = _SEARCHES, step if guess is None else guess
        else:
            guess, corrected = step, replace(band, values=band.values - broadening.excess(shown, band, *step))
            poles = stabilise(corrected, np.unique(poles.order).tolist())
    raise AssertionError


def _may_be_local(shown: broadening.Broadening) -> bool:
    """Whether a local model may have left the noise that shows an average, and the resonances as they are.

    Over three lines none does: a polynomial of second degree goes through all, one of first degree is their mean.
    """
    return isinstance(shown, broadening.LineAverage) and len(shown.weights) > 3


def _unlike_a_flat_force(shown: broadening.Broadening) -> bool:
    """Whether Hann blocks act on the peaks otherwise than under a flat force, by how much nobody knows."""
    return isinstance(shown, broadening.HannBlocks) and not shown.known


def _worse(now: Estimate, before: Estimate) -> bool:
    """Whether FRFs that left nothing but noise as they were take many more poles once corrected."""
    poles, least = (len(one.optimum.fit.poles) for one in (now, before))
    return not before.optimum.misfit and poles > _MORE_POLES * least


def _feedback(
    shown: broadening.Broadening, band: FrfSet, found: Estimate, some: Int[np.ndarray, "some"]
) -> broadening.Feedback:
    """How the correction of some poles acts on their fit."""
    residues, weights = _residues(found)[some], found.optimum.data.weights.transpose(2, 0, 1)
    if found.data.swapped:
        weights = weights.transpose(0, 2, 1)
    return broadening.feedback(shown, band, found.optimum.fit.poles[some], residues, weights)


def _gains(shown: broadening.Broadening, band: FrfSet, found: Estimate) -> uncertainty.Gains:
    """What the correction makes of errors: of those of the modes together, of each other pole by itself."""
    accepted, gains = found.verdict.accepted, []
    for some in (np.flatnonzero(accepted), *np.flatnonzero(found.verdict.possible & ~accepted)[:, None]):
        if len(some):
            own = _feedback(shown, band, found, some)
            gains += [(some[group], gain) for group, gain in zip(own.groups, own.gains, strict=True)]
    return tuple(gains)


def _residues(found: Estimate) -> Complex[np.ndarray, "pole out in"]:
    """Residues of all poles on the outputs and inputs that were fitted."""
    fit = found.optimum.fit
    residues = np.einsum("or,ir->roi", fit.shapes[:, 0], fit.participation)
    return np.asarray(residues.transpose(0, 2, 1) if found.data.swapped else residues)


def _in_noise(found: Estimate, change: Complex[np.ndarray, "freq out in"]) -> float:
    """Energy of a change of the FRFs in units of their noise."""
    flat, data = found.optimum.data, found.data
    own = change.transpose(2, 1, 0) if data.swapped else change.transpose(1, 2, 0)
    energy = np.sum(flat.weights * np.abs(own[..., -len(flat.s) :] * flat.s**-data.derivative) ** 2)
    return float(energy) / max(found.optimum.fit.variance_factor(flat), np.finfo(float).tiny)


def _once(
    band: FrfSet, poles: PoleTable, progress: Progress, searches: int = _SEARCHES, *, outputs: int | None = None
) -> Estimate:
    """Fit and judge all poles of FRFs as they are, with so many ``searches`` for what the residual shows."""
    data = prepare(band)
    advance(progress, "selection of modes", 0, 2)
    # Of FRFs that do not say themselves that their noise correlates over lines, what does is a misfit.
    known = known_variance(band, data)[0] if band.lines_correlate else None
    chosen = select(data, poles, band.added_decay, known)
    advance(progress, "residues", 1, 2)
    start = None
    while True:
        optimum = refined(band, data, chosen, start)
        if searches and chosen.trusted and not optimum.misfit:
            searches -= 1
            chosen, start, changed = _changed(data, chosen, optimum, poles.band)
            if changed:
                continue
        start, searches = None, 0
        errors = uncertainty.errors_of(optimum)
        # A pole of the background may have taken the place of a mode on the way.
        possible, alone = like_modes(optimum.fit.poles, poles.band), chosen.alone[optimum.kept]
        gone, why = (
            surplus(optimum, errors, possible, POLICY),
            "its residue and that of a neighbour add up to those of one mode",
        )
        if not len(gone) and outputs is not None:
            gone, why = needless(optimum, possible, outputs), "noise of all outputs explains as much"
        if not len(gone):
            break
        chosen = reduced(chosen, optimum.kept[gone], why)
    dropped = (*chosen.dropped, *optimum.dropped)
    verdict = _verdict(band, optimum, errors, possible, alone=alone, dropped=dropped)
    shapes = peak_shape.examine(optimum, errors, verdict.possible, verdict.accepted)
    if shapes:
        # A pole is a mode by its intervals as they are stated.
        errors = replace(errors, beyond=peak_shape.variances(shapes, optimum.fit.poles))
        verdict = _verdict(band, optimum, errors, possible, alone=alone, dropped=dropped)
    return Estimate(band, poles, band, data, optimum, errors, verdict, dropped, shapes, alone, stopped=chosen.stopped)


def _verdict(
    band: FrfSet,
    optimum: Refined,
    errors: PoleErrors,
    possible: Bool[np.ndarray, "pole"],
    *,
    alone: Float[np.ndarray, "pole"],
    dropped: Sequence[Dropped],
) -> Verdict:
    """What is said of the poles with these errors."""
    left_out = natural_frequencies(np.array([one.pole for one in dropped if not one.beside], complex))
    return judge(optimum, errors, possible, alone, policy=POLICY, dropped=left_out, added_decay=band.added_decay)


def _changed(
    data: Prepared, chosen: Selection, optimum: Refined, band: tuple[float, float]
) -> tuple[Selection, Start | None, bool]:
    """The poles of an optimum with further ones that the residual shows (narrow peaks, or else resonances that are weak
    or hidden under others), or without one that is not needed; where to begin with these; and whether that changes what
    the optimum has.
    """
    peaks, vectors = narrow_peaks(optimum.data, optimum.fit, band)
    if len(peaks):
        larger = extended(data, chosen, optimum.kept, band, peaks, vectors)
        if len(larger.fit.poles) > len(optimum.kept):
            return larger, None, True
        chosen = replace(chosen, dropped=larger.dropped)
    start = with_weak(optimum, chosen, band)
    if start is not None:
        return of_poles(chosen, optimum.kept, start.fit, band), start, True
    fewer = without_needless(optimum, chosen.possible[optimum.kept])
    if fewer is None:
        return chosen, None, False
    left, start = fewer
    gone = np.setdiff1d(np.arange(len(optimum.kept)), left)
    dropped = tuple(Dropped(complex(optimum.at_optimum.poles[pole]), "the other poles do without it") for pole in gone)
    smaller = of_poles(chosen, optimum.kept[left], start.fit, band)
    return replace(smaller, dropped=(*chosen.dropped, *dropped)), start, True


def _named_frequencies(near: object) -> list[float] | None:
    """Wanted frequencies [Hz]; a single one is a number.

    Raises
    ------
    InputError : they are none, or no numbers.
    """
    if near is None:
        return None
    wanted = np.atleast_1d(np.asarray(near))
    if wanted.ndim > 1 or wanted.dtype.kind not in "iuf" or not wanted.size:
        raise InputError("near names no frequencies", got=repr(near), expected="one or more numbers in Hz")
    return [float(frequency) for frequency in wanted]


def _named_rows(index: object) -> list[int] | None:
    """Wanted rows of the pole table; a single one is a number.

    Raises
    ------
    InputError : they are none, or no whole numbers.
    """
    if index is None:
        return None
    wanted = np.atleast_1d(np.asarray(index))
    if wanted.ndim > 1 or wanted.dtype.kind not in "iu" or not wanted.size:
        raise InputError("index names no rows of the pole table", got=repr(index), expected="one or more whole numbers")
    return [int(row) for row in wanted]


def _named(
    fit: Fit,
    verdict: Verdict,
    table: PoleTable,
    near: Sequence[float] | None,
    index: Sequence[int] | None,
    frfs: FrfSet,
) -> list[int]:
    """Poles of the fit that the user named, by frequency or by rows of the pole table."""
    frequencies, listed = natural_frequencies(fit.poles), verdict.listed
    chosen: list[int] = []
    outside = [row for row in index or () if not 0 <= row < len(table.poles)]
    if outside:
        raise InputError(
            "no such row in the pole table",
            where=frfs.name,
            got=outside,
            expected=f"0 to {len(table.poles) - 1}",
        )
    for row in index or ():
        distance = np.where(listed, np.abs(fit.poles + frfs.added_decay - table.poles[row]), np.inf)
        reach = np.abs(fit.poles.real) + abs(table.poles[row].real)
        if not np.any(distance <= reach):
            raise _nothing_near(table.natural_frequencies[row], frequencies[listed], frfs.name, f"row {row}, ")
        chosen.append(int(np.argmin(distance / reach)))
    for wanted in near or ():
        distance = np.where(listed, np.abs(frequencies - wanted), np.inf)
        if not np.any(distance <= POLICY.near * wanted):
            raise _nothing_near(wanted, frequencies[listed], frfs.name)
        close = np.flatnonzero(distance <= POLICY.near * wanted)
        best = int(min(close, key=lambda pole: (not verdict.accepted[pole], distance[pole])))
        # A frequency that is named again asks for the next pole of its group.
        partners = [best, *np.flatnonzero((verdict.group == verdict.group[best]) & listed).tolist()]
        chosen += [pole for pole in partners if pole not in chosen][:1]
    return list(dict.fromkeys(chosen))


def _nothing_near(wanted: float, there: Float[np.ndarray, "pole"], where: str, prefix: str = "") -> InputError:
    nearest = np.sort(there[np.argsort(np.abs(there - wanted))[:3]])
    known = ", ".join(f"{frequency:.6g} Hz" for frequency in nearest)
    return InputError(
        "no pole near the wanted frequency",
        where=where,
        got=f"{prefix}{wanted:g} Hz",
        expected=f"a frequency within {POLICY.near:.0%} of a pole; the nearest are {known}"
        if len(there)
        else "a band with a pole that stands out of the noise",
    )


def _model(
    band: FrfSet,
    data: Prepared,
    optimum: Refined,
    errors: PoleErrors,
    verdict: Verdict,
    order: Int[np.ndarray, "mode"],
) -> ModalModel:
    """The poles in ``order`` as modes, all others as background."""
    fit = optimum.fit
    poles, psi = fit.poles, fit.shapes[:, 0]
    outside = np.setdiff1d(np.arange(len(poles)), order)
    rest, fixed = fit.terms.coefficients(fit.rest[:, 0]), len(fit.terms.poles)
    background = np.einsum("kr,ir->rki", psi[:, outside], fit.participation[:, outside])
    residuals = Residuals(
        lower=rest[:, :, fixed],
        upper=rest[:, :, fixed + 1],
        poles=np.concatenate([poles[outside], fit.terms.poles]),
        residues=np.concatenate([background, rest[:, :, :fixed].transpose(2, 0, 1)]),
    )
    shapes, participation = _normalise(psi[:, order], fit.participation[:, order])
    model = ModalModel(
        poles=poles[order] + band.added_decay,
        shapes=shapes,
        dofs=data.dofs,
        participation=participation,
        inputs=data.references,
        residuals=residuals,
        confidence=verdict.confidence[order],
        groups=_groups(verdict.group[order]),
        candidates=tuple(
            _candidate(fit, errors.stated, verdict, pole, band.added_decay)
            for pole in outside[np.argsort(np.abs(poles[outside]), kind="stable")].tolist()
            if verdict.listed[pole] and not verdict.accepted[pole]
        ),
        condition=band.condition,
        provenance=replace(band.provenance, options=(*band.provenance.options, *POLICY.options())),
        name=band.name,
    )
    model = scale_to_unit_modal_mass(model) if band.scaled else model
    model = uncertainty.attach(model, optimum, errors, order)
    return replace(model, findings=(*model.findings, *disagreements(model)))


def _groups(group: Int[np.ndarray, "mode"]) -> tuple[tuple[int, ...], ...]:
    """Positions of the modes of each group of two and more."""
    found = [np.flatnonzero(group == number) for number in np.unique(group)]
    return tuple(tuple(members.tolist()) for members in found if len(members) > 1)


def _candidate(fit: Fit, errors: PoleErrors, verdict: Verdict, pole: int, added_decay: float) -> Candidate:
    value = fit.poles[[pole]] + added_decay
    return Candidate(
        natural_frequency=float(natural_frequencies(value)[0]),
        damping_ratio=float(damping_ratios(value)[0]),
        frequency_std=float(errors.frequency[pole]),
        damping_std=float(errors.damping[pole]),
        confidence=float(verdict.confidence[pole]),
        reason=verdict.reasons[pole],
    )


def _normalise(
    shapes: Complex[np.ndarray, "dof mode"], participation: Complex[np.ndarray, "in mode"]
) -> tuple[Complex[np.ndarray, "dof mode"], Complex[np.ndarray, "in mode"]]:
    """Largest component of each shape 1; the participation takes the rest, so that residues stay."""
    if shapes.shape[1] == 0:
        return shapes, participation
    largest = shapes[np.argmax(np.abs(shapes), axis=0), np.arange(shapes.shape[1])]
    largest = np.where(largest == 0, 1, largest)
    return shapes / largest, participation * largest


def _real(model: ModalModel) -> ModalModel:
    """Each shape rotated to its mean phase, its imaginary part dropped, and the participation turned back."""
    # The phase that maximises the real part is half the phase of the sum of squares.
    turn = np.exp(-0.5j * np.angle(np.sum(model.shapes**2, axis=0)))
    real = replace(model, shapes=(model.shapes * turn).real.astype(complex), participation=model.participation / turn)
    return replace(real, uncertainty=None if model.uncertainty is None else uncertainty.real(model.uncertainty, turn))


def _findings(
    band: FrfSet,
    data: Prepared,
    optimum: Refined,
    errors: PoleErrors,
    verdict: Verdict,
    order: Int[np.ndarray, "mode"],
    dropped: Sequence[Dropped],
) -> tuple[Finding, ...]:
    """Candidates and what was dropped, modes at the band edge, groups, DOFs without a signal."""
    where = band.name or "fit"
    found: list[Finding] = []
    if data.dead:
        found.append(
            Finding.of(
                "warning",
                "dead-output",
                where,
                "All FRFs of {names} are zero; they were left out.",
                float(len(data.dead)),
                advice="Check the cable and the channel table.",
                names=", ".join(map(str, data.dead[:6])),
            )
        )
    found += _repeated(where, band)
    found += _coherence(where, band)
    found += unexplained.findings(unexplained.unexplained(optimum, data.derivative), where)
    found += _candidates(where, optimum, verdict, order, added_decay=band.added_decay)
    for drop in dropped[-_NAMED:]:
        value = np.array([drop.pole + band.added_decay])
        frequency, damping = natural_frequencies(value)[0], damping_ratios(value)[0]
        found.append(
            Finding.of(
                "info",
                "dropped-candidate",
                where,
                "A pole at {frequency} Hz with {damping} % damping was left out of the fit: {reason}.",
                float(frequency),
                advice="Look at the stabilisation diagram; measure with less noise if you expect a mode there.",
                frequency=f"{frequency:.6g}",
                damping=f"{100 * damping:.3g}",
                reason=drop.reason,
            )
        )
    if len(dropped) > _NAMED:
        found.append(
            Finding.of(
                "info",
                "dropped-candidate",
                where,
                "{count} more poles were left out of the fit: noise or misfit explains them.",
                float(len(dropped) - _NAMED),
                advice="Look at the stabilisation diagram.",
                count=len(dropped) - _NAMED,
            )
        )
    poles = optimum.fit.poles
    found += _unresolved(where, poles, errors.stated, order[verdict.unresolved[order]], band.added_decay)
    if verdict.tones.any():
        listed = ", ".join(f"{f:.6g} Hz" for f in np.sort(natural_frequencies(poles[verdict.tones]))[:_NAMED])
        found.append(
            Finding.of(
                "warning",
                "mains",
                where,
                "There are tones of the mains at {listed}; they are in the fit, and not among the modes.",
                float(np.count_nonzero(verdict.tones)),
                advice="Look for ground loops; a mode that is really there has a peak that the tone hides.",
                listed=listed,
            )
        )
    found += _window_not_applied(where, optimum.fit.poles, errors, verdict, band.added_decay)
    found += _at_the_edges(where, data, poles[order], poles[np.setdiff1d(np.arange(len(poles)), order)])
    found += _multiplicity(where, data, optimum.fit, errors, verdict, order)
    if not len(order):
        found.append(
            Finding(
                "warning",
                "no-modes",
                where,
                "No mode stands out of the noise in this band.",
                advice="Look at the coherence and at the candidates, and name frequencies with near=[...] to see one.",
            )
        )
    return tuple(found)


def _candidates(
    where: str, optimum: Refined, verdict: Verdict, order: Int[np.ndarray, "mode"], *, added_decay: float
) -> list[Finding]:
    """A finding for each pole of the fit that was not accepted, an error where it dominates the FRFs."""
    fit, found = optimum.fit, []
    poles = np.flatnonzero(verdict.listed & ~verdict.accepted)
    around, overall = verdict.energy
    for pole in poles:
        value = fit.poles[[pole]] + added_decay
        frequency, damping = natural_frequencies(value)[0], damping_ratios(value)[0]
        place = f"{where}, {frequency:.6g} Hz"
        if around[pole] >= POLICY.dominant and overall[pole] >= POLICY.large and pole not in order:
            found.append(
                Finding.of(
                    "error",
                    "dominant-candidate",
                    place,
                    "A pole with {damping} % damping was not accepted as a mode: {reason}. It carries {share} of the "
                    "energy of the FRFs around it.",
                    float(around[pole]),
                    POLICY.dominant,
                    advice="Do not use the modes next to it: look at the FRFs there, and measure with another "
                    "reference or a finer frequency resolution.",
                    damping=f"{100 * damping:.3g}",
                    reason=verdict.reasons[pole],
                    share=f"{min(around[pole], 1):.0%}",
                )
            )
            continue
        found.append(
            Finding.of(
                "info",
                "candidate",
                place,
                "A pole with {damping} % damping was reported because it was named, and {reason}."
                if pole in order
                else "A pole with {damping} % damping was not accepted as a mode: {reason}.",
                float(frequency),
                advice="Name it with near=[...] to report it all the same.",
                damping=f"{100 * damping:.3g}",
                reason=verdict.reasons[pole],
            )
        )
    return found


def _repeated(where: str, band: FrfSet) -> list[Finding]:
    """DOFs that occur twice; those of several set-ups were measured in each."""
    number = None if band.set_ups is None else band.set_ups.number
    names: list[str] = []
    for dofs, of_side in ((band.outputs, number), (band.inputs, None if number is None else number.T)):
        places = Counter((dof, () if of_side is None else tuple(of_side[row])) for row, dof in enumerate(dofs))
        names += dict.fromkeys(str(dof) for (dof, _), count in places.items() if count > 1)
    if not names:
        return []
    return [
        Finding.of(
            "warning",
            "duplicated-dof",
            where,
            "{names} occur more than once among the outputs, or among the inputs: each is fitted by itself.",
            float(len(names)),
            advice="Correct the names, or leave out all but one of each: what is looked up by name takes one of them.",
            names=", ".join(names[:_NAMED]),
        )
    ]


def _coherence(where: str, band: FrfSet) -> list[Finding]:
    """A coherence that no estimate has does not shape the weights."""
    if band.coherence is None or band.variance is not None or not np.all(np.isfinite(band.coherence)):
        return []
    same = noise.constant(np.asarray(band.coherence))
    if not same.any():
        return []
    output, reference = np.argwhere(same)[0]
    return [
        Finding.of(
            "warning",
            "coherence-constant",
            where,
            "The coherence of {count} FRFs is the same at all lines ({coherence} of {frf}): it was not "
            "estimated, and is not used.",
            float(np.count_nonzero(same)),
            advice="Leave it out, or export the one that was measured; the noise is estimated from the FRFs.",
            count=np.count_nonzero(same),
            coherence=f"{band.coherence[0, output, reference]:.4g}",
            frf=band.label(int(output), int(reference)),
        )
    ]


def _window_not_applied(
    where: str, poles: Complex[np.ndarray, "pole"], errors: PoleErrors, verdict: Verdict, added_decay: float
) -> list[Finding]:
    """Resonances that decay more slowly than the exponential window alone lets them: it is not in the FRFs."""
    damping = damping_ratios(poles + added_decay)
    seen = verdict.possible & ~verdict.tones & (verdict.energy[0] >= POLICY.dominant)
    growing = seen & (verdict.energy[1] >= POLICY.large) & (damping < -COVERAGE_FACTOR * errors.damping)
    if added_decay <= 0 or not growing.any():
        return []
    slowest = float(np.max(poles[growing].real))
    listed = ", ".join(f"{f:.6g} Hz" for f in np.sort(natural_frequencies(poles[growing]))[:_NAMED])
    return [
        Finding.of(
            "error",
            "window-not-applied",
            where,
            "The resonances at {listed} decay by {decay} 1/s at least, less than the exponential window "
            "that is stated ({stated} 1/s): it was not applied, or was weaker. The damping ratios of all "
            "modes are too low.",
            -slowest,
            added_decay,
            advice="Correct the decay that is stated with the FRFs (0 without a window).",
            listed=listed,
            decay=f"{-slowest:.3g}",
            stated=f"{added_decay:.3g}",
        )
    ]


def _unresolved(
    where: str, poles: Complex[np.ndarray, "pole"], errors: PoleErrors, order: Int[np.ndarray, "mode"], decay: float
) -> list[Finding]:
    """Modes whose peaks are too narrow for the frequency lines to state their damping."""
    found = []
    for pole in order:
        value = poles[[pole]] + decay
        most = damping_ratios(value)[0] + COVERAGE_FACTOR * errors.damping[pole]
        found.append(
            Finding.of(
                "warning",
                "damping-not-resolved",
                f"{where}, {natural_frequencies(value)[0]:.6g} Hz",
                "The half-power bandwidth of this mode is less than the distance of the frequency lines: its "
                "damping ratio is not determined, only that it is below {most} %.",
                float(damping_ratios(value)[0]),
                float(most),
                advice="Record longer, so that the frequency lines are closer.",
                most=f"{100 * most:.2g}",
            )
        )
    return found


def _at_the_edges(
    where: str, data: Prepared, poles: Complex[np.ndarray, "mode"], background: Complex[np.ndarray, "pole"]
) -> list[Finding]:
    """Modes that the band cuts through, and resonances outside the band whose flank reaches into it."""
    found = []
    low, high = 2 * np.pi * data.frequencies[0], 2 * np.pi * data.frequencies[-1]
    for pole in poles:
        if min(abs(pole) - low, high - abs(pole)) < abs(pole.real):
            found.append(
                Finding(
                    "warning",
                    "band-edge",
                    f"{where}, {abs(pole) / 2 / np.pi:.6g} Hz",
                    "The band cuts through the peak of this mode.",
                    value=float(abs(pole) / 2 / np.pi),
                    advice="Widen the band by a few bandwidths for a trustworthy damping.",
                )
            )
    size = np.abs(background)
    near = np.where(size < low, low - size, size - high)
    cut = (near > 0) & (near < np.abs(background.real)) & (damping_ratios(background) <= POLICY.heaviest)
    for frequency in natural_frequencies(background[cut]):
        found.append(
            Finding(
                "info",
                "band-edge",
                f"{where}, {frequency:.6g} Hz",
                "The resonance of this mode lies just outside the band; it is in the background, not among the modes.",
                value=float(frequency),
                advice="Widen the band if the mode is wanted.",
            )
        )
    return found


def _multiplicity(
    where: str, data: Prepared, fit: Fit, errors: PoleErrors, verdict: Verdict, order: Int[np.ndarray, "mode"]
) -> list[Finding]:
    """Groups of modes that the data do not tell apart; a single reference, which shows no multiplicity at all."""
    found = []
    if len(data.references) == 1 and len(order):
        found.append(
            Finding(
                "info",
                "multiplicity-not-observable",
                where,
                "With a single reference the modes of a repeated root look like one: a mode reported here may be "
                "several with the same frequency and damping.",
                value=1.0,
                limit=2.0,
                advice="Add a reference where symmetric or identical parts of the structure are expected to have such "
                "modes.",
            )
        )
    for group in np.unique(verdict.group[order]):
        members = order[verdict.group[order] == group]
        if len(members) < 2:
            continue
        mean = fit.poles[members].mean()
        cause = errors.poles[members].mean(axis=0)
        along = (np.conj(mean) * cause).real / abs(mean)
        frequency = abs(mean) / (2 * np.pi)
        half = COVERAGE_FACTOR * float(np.linalg.norm(along)) / (2 * np.pi)
        found.append(
            Finding.of(
                "info",
                "mode-group",
                f"{where}, {frequency:.6g} Hz",
                "{count} modes lie closer together than the data tell them apart: their mean frequency is "
                "{frequency} Hz +- {half} Hz; any shapes from the space that theirs span describe the FRFs "
                "as well.",
                float(len(members)),
                advice="Compare the space of the shapes (principal angles), not single shapes.",
                count=len(members),
                frequency=f"{frequency:.6g}",
                half=f"{half:.2g}",
            )
        )
    return found


def reconstruction_error(measured: FrfSet, model: ModalModel) -> tuple[FrfSet, Float[np.ndarray, "out in"]]:
    """Synthesise the FRFs of a model on the lines of measured ones, and compute their relative error.

    What the window, the end of the record and an average over lines do is put back, so that both contain the same. A
    line at 0 Hz is left out.

    Parameters
    ----------
    measured : FrfSet
        Measured FRFs.
    model : ModalModel
        Modes that were fitted to them.

    Returns
    -------
    tuple of (FrfSet, array of shape (out, in))
        Synthesised FRFs, and the norm of the difference over the norm of the measurement for each FRF.

    Examples
    --------
    >>> from ema.examples import frf_set, modal_model
    >>> _, error = reconstruction_error(frf_set(), modal_model())
    >>> bool(error.max() < 1e-12)
    True
    """
    from ema import synthesis

    keep = measured.frequencies > 0
    measured = measured.lines(keep) if not keep.all() else measured
    windowed = as_recorded(model, measured)
    quantity = "accelerance" if measured.quantity == "unstated" else measured.quantity
    rebuilt = synthesis.frfs(windowed, np.asarray(measured.frequencies), quantity, measured.outputs, measured.inputs)
    rebuilt = replace(rebuilt, quantity=measured.quantity, unit=measured.unit, added_decay=measured.added_decay)
    shown = broadening.of(measured)
    if shown is not None:
        own = synthesis.residues(model, measured.outputs, measured.inputs)
        broadened = rebuilt.values + broadening.excess(shown, measured, model.poles, own)
        # The noise of a local model over lines is that of an average, its resonances are not.
        far, near = (np.linalg.norm(values - measured.values) for values in (broadened, rebuilt.values))
        if not isinstance(shown, broadening.LineAverage) or far < near:
            rebuilt = replace(rebuilt, values=broadened)
    norm = np.linalg.norm(measured.values, axis=0)
    error = np.linalg.norm(rebuilt.values - measured.values, axis=0) / np.where(norm > 0, norm, 1)
    return rebuilt, error
