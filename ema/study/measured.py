"""From a run to its FRFs, whatever it holds: FRFs, records of one kind of excitation, one or several set-ups."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from acquisition import Part, merge
from ema.data import FrfSet, HitGallery, Run
from ema.dof import Dof
from ema.errors import InputError
from ema.progress import Progress, silent
from ema.study.recipe import EstimateTable

_OPTIONS = {
    "hammer": ("estimator", "block", "trigger", "level", "decay", "window_force", "less_noise", "keep", "reject"),
    "random": ("estimator", "method", "block", "overlap"),
    "sweep": ("estimator", "block"),
    "stepped sine": ("discard",),
}
"""The settings of ``[estimate]`` that each kind of excitation has."""


def frfs_of(run: Run, settings: EstimateTable, progress: Progress = silent) -> tuple[FrfSet, HitGallery | None]:
    """FRFs of a run: those it brought along, or those of its records; and its impacts, if any.

    Set-ups of the sensors are estimated one by one and merged; the frequency shift between them is a finding.

    Raises
    ------
    InputError : the run holds neither, nothing is known about its excitation, or a function refuses its input.
    """
    from ema import estimate

    if run.frfs:
        sets = tuple(run.frfs)
        return sets[0] if len(sets) == 1 else merge([Part(one) for one in sets], name=run.id), None
    if run.levels:
        raise InputError(
            "the run holds stepped levels, and no FRFs",
            where=f"run {run.id}",
            got=f"{len(run.levels)} levels",
            expected="records or FRFs",
            advice="`ema map` reads frequency and damping over the amplitude from them",
        )
    if not run.recordings:
        raise InputError(
            "the run holds neither records nor FRFs",
            where=f"run {run.id}",
            advice="open the campaign's folder instead of a result file, or name the run's files in campaign.toml",
        )
    if run.kind not in _OPTIONS:
        raise InputError(
            "nothing is known to be done with this excitation",
            where=f"run {run.id}",
            got=run.kind,
            expected="hammer, random, sweep or stepped sine",
            advice='state kind = "hammer" (or another) of the run in campaign.toml',
        )
    frfs, hits = _of_records(run, settings, progress)
    if settings.mount_mass > 0 and run.kind != "hammer":
        for forces in _together(run):
            frfs = estimate.without_mount_mass(frfs, settings.mount_mass, forces)
    return frfs, hits


def _together(run: Run) -> list[tuple[Dof, ...]]:
    """Forces of the records that act at the same time."""
    forces = [[record.channels[row].dof for row in record.with_role("reference")] for record in run.recordings]
    return list(dict.fromkeys(tuple(dof for dof in dofs if dof is not None) for dofs in forces))


def _of_records(run: Run, settings: EstimateTable, progress: Progress) -> tuple[FrfSet, HitGallery | None]:
    """FRFs and impacts of the records, of all set-ups together."""
    given = settings.given()
    options = {name: given[name] for name in _OPTIONS[run.kind] if name in given}
    setups = _setups(run)
    if len(setups) == 1:
        return _estimated(run, options, progress)
    estimates = [_estimated(one, options, progress) for one in setups.values()]
    lengths = [_block(frfs, one) for (frfs, _), one in zip(estimates, setups.values(), strict=True)]
    if len(set(lengths)) > 1 and "block" not in options:
        estimates = [_estimated(one, options | {"block": min(lengths)}, progress) for one in setups.values()]
    decays = [frfs.added_decay for frfs, _ in estimates]
    if run.kind == "hammer" and len(set(decays)) > 1:
        # one window for all: the strongest that a set-up needs
        options |= {"block": min(lengths), "decay": max(decays)}
        estimates = [_estimated(one, options, progress) for one in setups.values()]
    together = _common_lines([frfs for frfs, _ in estimates])
    parts = [Part(frfs, setup, f"set-up {setup}") for frfs, setup in zip(together, setups, strict=True)]
    return replace(merge(parts, f"run {run.id}"), name=run.id), _joined([hits for _, hits in estimates])


def _estimated(run: Run, options: dict[str, Any], progress: Progress) -> tuple[FrfSet, HitGallery | None]:
    from ema import estimate

    if run.kind == "hammer":
        return estimate.hammer_test(run, estimate.HammerSettings(**options), progress)
    if run.kind == "stepped sine":
        return estimate.stepped(run, **options, progress=progress), None
    estimator = estimate.shaker if run.kind == "random" else estimate.sweep
    return estimator(run, **options, progress=progress), None


def _common_lines(sets: Sequence[FrfSet]) -> list[FrfSet]:
    """The lines that all set-ups excited: no two shaker tests excite exactly the same."""
    low = max(float(frfs.frequencies[0]) for frfs in sets)
    high = min(float(frfs.frequencies[-1]) for frfs in sets)
    cut = [frfs.band(low, high) if low < high else frfs for frfs in sets]
    axis = cut[0].frequencies
    alike = all(
        len(one.frequencies) == len(axis) and np.allclose(one.frequencies, axis, rtol=1e-9, atol=0) for one in cut
    )
    return cut if alike else list(sets)


def _setups(run: Run) -> dict[str, Run]:
    """The run by set-up; labels are given to all records or to none, so the first one tells."""
    records = run.recordings
    if not records[0].setup:
        return {"": run}
    labels = [record.setup for record in records]
    return {
        label: replace(run, recordings=_chosen(records, [place for place, one in enumerate(labels) if one == label]))
        for label in dict.fromkeys(labels)
    }


def _chosen(records: Sequence[Any], places: list[int]) -> Sequence[Any]:
    """Some of the records, still read only when they are needed."""
    from ema.data import Lazy

    return Lazy([partial(records.__getitem__, place) for place in places])


def _block(frfs: FrfSet, run: Run) -> int:
    """Samples of the blocks behind the FRFs."""
    return round(run.recordings[0].sampling_rate / frfs.frequency_step)


def _joined(galleries: Sequence[HitGallery | None]) -> HitGallery | None:
    """The impacts of all set-ups; the force spectrum is that of the first one, the usable band that of the worst."""
    present = [gallery for gallery in galleries if gallery is not None]
    if not present:
        return None
    bands = [gallery.usable_band for gallery in present]
    return replace(
        present[0],
        hits=tuple(hit for gallery in present for hit in gallery.hits),
        usable_band=(min(low for low, _ in bands), min(high for _, high in bands)),
    )
