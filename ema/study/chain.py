"""One run through the chain: records to FRFs to poles to modes, with everything a reader has to know."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from ema import shapes, synthesis
from ema.data import Finding, FrfSet, HitGallery, ModalModel, PoleTable, Run, RunResult, SingleMode
from ema.errors import InputError
from ema.progress import Progress, silent
from ema.study.measured import frfs_of
from ema.study.recipe import EstimateTable, FitTable

if TYPE_CHECKING:
    from ema.compare.linearity import Linearity

_FIRST_LINE = 20
"""Lines above 0 Hz left out when nobody states a band: suspension, drift and the windows live there."""


def analyse(
    run: Run, estimate: EstimateTable, fit: FitTable, progress: Progress = silent, *, others: Sequence[Run] = ()
) -> RunResult:
    """Estimate the FRFs of ``run``, fit its modes and judge both.

    ``others`` are runs of the same campaign: tests at other levels help to tell whether the structure is linear.

    Raises
    ------
    InputError : the run cannot be used, or a function refuses its input.
    """
    from ema.compare.linearity import level_effect, level_finding
    from ema.estimate import quality, without_dead
    from ema.fit.record_end import as_recorded

    frfs, hits = frfs_of(run, estimate, progress)
    band = fit.band or default_band(frfs, hits)
    inside = frfs.band(*band)
    tested = _tested(run, others, band, progress)
    alive = without_dead(inside)
    poles, modes = fitted(alive, fit, progress)
    equivalent: tuple[SingleMode, ...] = ()
    if tested is not None and tested.verdict == "not linear":
        modes = _of_the_decay(band, alive, modes, tested)
        equivalent = _equivalent(alive, modes)
    reconstruction = synthesis.frfs(
        as_recorded(modes, alive), alive.frequencies, alive.quantity, outputs=alive.outputs, inputs=alive.inputs
    )
    reconstruction = replace(reconstruction, name=f"{run.id}, synthesis", unit=alive.unit)
    level = _shaken(run, others, estimate, (inside, modes), progress)
    if tested is not None:
        level = (level_finding(tested, f"run {run.id}"),)
    findings = unique(level + run.findings + frfs.findings + modes.findings + quality(inside, modes, hits))
    return RunResult(
        run=run,
        frfs=_like(frfs, alive),
        poles=poles,
        modes=modes,
        quality=shapes.quality(modes.shapes),
        reconstruction=reconstruction,
        reconstruction_error=relative_error(alive, reconstruction),
        auto_mac=shapes.auto_mac(modes.shapes),
        hits=hits,
        findings=findings,
        level_effect=None if tested is None else level_effect(tested),
        equivalent=equivalent,
    )


def ring_down_finding(run: Run) -> Finding:
    """Why a run of free vibrations has no FRFs, and what makes a result of it."""
    return Finding.of(
        "info",
        "ring-down-without-band",
        f"run {run.id}",
        "a snap-back has no measured force: it gives frequency and damping over the amplitude, and no FRFs.",
        advice='Name its band in the recipe: [[ring_down]] run = "{run}", band = [low, high].',
        run=run.id,
    )


def excitation_finding(run: Run) -> Finding:
    """Why a run of records has no FRFs: nobody stated how the structure was driven."""
    return Finding.of(
        "warning",
        "excitation-unstated",
        f"run {run.id}",
        "nobody stated how the structure was driven: there are no FRFs, and no modes.",
        advice=(
            'State kind = "hammer" (or "random", "sweep", "stepped sine", "snap-back") of the '
            'run; [[loop]] run = "{run}" in a recipe makes a hysteresis loop of it.'
        ),
        run=run.id,
    )


def _tested(run: Run, others: Sequence[Run], band: tuple[float, float], progress: Progress) -> "Linearity | None":
    """Whether the structure is linear at the level of a hammer test; ``None`` for what else was measured."""
    from ema.compare.linearity import linearity_beside, other_levels

    if run.kind != "hammer" or not run.recordings or run.frfs:
        return None
    return linearity_beside(run, other_levels(run, others), band, progress)


def _shaken(
    run: Run,
    others: Sequence[Run],
    estimate: EstimateTable,
    made: tuple[FrfSet, ModalModel],
    progress: Progress,
) -> tuple[Finding, ...]:
    """Whether the structure is linear at the level of a shaker test; nothing for what else was measured."""
    from ema.compare.linearity import other_levels
    from ema.compare.shaker_linearity import SHAKEN, shaker_linearity

    if run.kind not in SHAKEN:
        return ()
    beside = []
    for other in other_levels(run, others):
        try:
            beside.append((other, frfs_of(other, estimate, progress)[0].band(*_ends(made[0]))))
        except InputError:  # that run is refused, with its reason, where it is analysed
            continue
    return shaker_linearity(run, *made, beside)


def _ends(frfs: FrfSet) -> tuple[float, float]:
    return float(frfs.frequencies[0]), float(frfs.frequencies[-1])


def _of_the_decay(band: tuple[float, float], frfs: FrfSet, fitted: ModalModel, tested: "Linearity") -> ModalModel:
    """Modes of the decay after sticking in place of those fitted to FRFs that no linear structure has."""
    from ema.compare.decay_modes import modes_after_sticking, sticking, withheld

    own = None if tested.beside else tested.decays
    assert tested.free is not None
    after_sticking = sticking(tested.free, band, {} if own is None else {tested.later: own})
    return withheld(fitted) if after_sticking is None else modes_after_sticking(after_sticking, frfs, fitted)


def _equivalent(frfs: FrfSet, modes: ModalModel) -> tuple[SingleMode, ...]:
    """What one linear mode fitted to the FRFs about every mode reads, where there is a peak."""
    from ema.fit import local_fit

    fits: list[SingleMode] = []
    for frequency in modes.natural_frequencies:
        try:
            fits.append(local_fit(frfs, float(frequency)))
        except InputError:
            continue
    return tuple(fits)


def _like(frfs: FrfSet, chosen: FrfSet) -> FrfSet:
    """The outputs and inputs of ``chosen``, on all lines."""
    if (frfs.outputs, frfs.inputs) == (chosen.outputs, chosen.inputs):
        return frfs
    return frfs.pick([frfs.outputs.index(dof) for dof in chosen.outputs], [frfs.inputs.index(d) for d in chosen.inputs])


def default_band(frfs: FrfSet, hits: HitGallery | None) -> tuple[float, float]:
    """Where to fit when nobody says: the band of the excitation, without the first few lines."""
    low, high = frfs.frequencies[0], frfs.frequencies[-1]
    left_out = _FIRST_LINE * frfs.frequency_step
    if low < left_out:
        low += left_out
    stated = frfs.condition.excitation.band
    if stated is not None:
        low, high = max(frfs.frequencies[0], stated[0]), min(high, stated[1])
    elif hits is not None:
        high = min(high, hits.usable_band[1])
    return (float(low), float(high)) if low < high else (float(frfs.frequencies[0]), float(frfs.frequencies[-1]))


def fitted(frfs: FrfSet, settings: FitTable, progress: Progress = silent) -> tuple[PoleTable, ModalModel]:
    """Poles of all orders, and the modes chosen among them, of FRFs that are already cut to the band."""
    from ema import fit

    orders = None if settings.orders is None else range(settings.orders[0], settings.orders[1] + 1, settings.orders[2])
    poles = fit.stabilise(frfs, orders=orders, progress=progress)
    return poles, fit.modes(frfs, poles, near=settings.near, index=settings.index, progress=progress)


def relative_error(measured: FrfSet, model: FrfSet) -> Float[np.ndarray, "out in"]:
    """Norm of the difference over the norm of the measured FRF, for each FRF."""
    difference = np.linalg.norm(measured.values - model.values, axis=0)
    size = np.linalg.norm(measured.values, axis=0)
    return np.asarray(np.divide(difference, size, out=np.full(size.shape, np.nan), where=size > 0))


def unique(findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """Each finding once, the grave ones first."""
    order = {"error": 0, "warning": 1, "info": 2}
    return tuple(sorted(dict.fromkeys(findings), key=lambda finding: order[finding.severity]))
