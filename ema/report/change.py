"""What the beam does to the structure: MAC between runs, and FRFs before and after."""

from functools import partial

import numpy as np

from ema import show
from ema.data import FrfSet, RunResult
from ema.errors import InputError
from ema.messages import plural, text
from ema.report.blocks import Block, Book, Section, Text
from ema.report.comparison import base_run
from ema.report.modes import condition_text
from ema.report.numbers import fixed, plain, short
from ema.shapes import compare

_MOST_OVERLAID = 5
"""Runs in one picture of FRFs, the first included."""


def change_sections(runs: list[RunResult], book: Book) -> list[Section]:
    """Pictures of every run against the one without a beam; nothing where a study has one run."""
    if len(runs) < 2:
        return []
    base = base_run(runs)
    others = [run for run in runs if run is not base]
    sections = [
        Section(text("MAC between runs"), "change-mac", [block for run in others for block in _mac(base, run, book)]),
        Section(text("FRFs before and after"), "change-frfs", _overlays(base, others, book)),
    ]
    return [section for section in sections if section.blocks]


def _mac(base: RunResult, other: RunResult, book: Book) -> list[Block]:
    if not (len(base.modes.poles) and len(other.modes.poles)):
        return []
    # docs/faults.md: of the work table MAC was 0.87 after sticking, and 1.00 where the impacts left the joints sticking
    slipped = [run.run.id for run in (base, other) if any(one.code == "modes-after-sticking" for one in run.findings)]
    if slipped:
        return [
            Text(
                text(
                    "The MAC between {base} and {run} is withheld: modes of {slipped} are those after sticking, and "
                    "what slip takes of their amplitudes differs from point to point.",
                    base=base.run.id,
                    run=other.run.id,
                    slipped=", ".join(slipped),
                ),
                missing=True,
            )
        ]
    try:
        comparison = compare(base.modes, other.modes)
    except InputError as error:
        return [
            Text(text("{base} against {run}: {error}.", base=base.run.id, run=other.run.id, error=error), missing=True)
        ]
    names = [_labels(run) for run in (base, other)]
    alike = [float(comparison.mac[pair]) for pair in comparison.pairs]
    summary = text("no two modes are alike")
    if alike:
        summary = plural(
            "{count} pair with a MAC from {low} to {high}",
            "{count} pairs with a MAC from {low} to {high}",
            len(alike),
            low=fixed(min(alike), 2),
            high=fixed(max(alike), 2),
        )
    make = partial(
        show.mac_matrix,
        np.asarray(comparison.mac),
        names[0],
        [label.split(":")[0] for label in names[1]],
        row_label=text("Mode of {base}", base=base.run.id),
        column_label=text("Mode of {run}", run=other.run.id),
    )
    return [
        book.picture(
            make,
            text(
                "MAC between modes of {base} and {run}: {summary}.", base=base.run.id, run=other.run.id, summary=summary
            ),
            text(
                "MAC of {base} (rows) against {run} (columns) over {number} DOFs: {summary}.",
                base=base.run.id,
                run=other.run.id,
                number=len(comparison.dofs),
                summary=summary,
            ),
        ),
        book.table(
            f"mac_{base.run.id}_{other.run.id}",
            text("MAC of {base} (rows) against {run} (columns).", base=base.run.id, run=other.run.id),
            (text("Mode of {base}", base=base.run.id), *(str(mode + 1) for mode in range(comparison.mac.shape[1]))),
            [(row + 1, *(plain(float(value), 4) for value in values)) for row, values in enumerate(comparison.mac)],
            0,
        ),
    ]


def _labels(run: RunResult) -> list[str]:
    return [f"{mode}: {short(float(f'{f:.4g}'))} Hz" for mode, f in enumerate(run.modes.natural_frequencies, 1)]


def _overlays(base: RunResult, others: list[RunResult], book: Book) -> list[Block]:
    """The drive point, or the strongest FRF that all runs have, in every run."""
    like = [run for run in others if (run.frfs.quantity, run.frfs.unit) == (base.frfs.quantity, base.frfs.unit)]
    blocks: list[Block] = []
    if unlike := [run.run.id for run in others if run not in like]:
        names = ", ".join(unlike)
        blocks.append(
            Text(
                text(
                    "FRFs of {names} are of another quantity or unit than those of {base}.",
                    names=names,
                    base=base.run.id,
                ),
                True,
            )
        )
    for start in range(0, len(like), _MOST_OVERLAID - 1):
        blocks += _overlay([base, *like[start : start + _MOST_OVERLAID - 1]], book)
    return blocks


def _overlay(runs: list[RunResult], book: Book) -> list[Block]:
    names = ", ".join(run.run.id for run in runs)
    common = _common([run.frfs for run in runs])
    if common is None:
        return [
            Text(
                text("{names} have no FRF in common, so none can be shown before and after.", names=names), missing=True
            )
        ]
    low = max(float(run.frfs.frequencies[0]) for run in runs)
    high = min(float(run.frfs.frequencies[-1]) for run in runs)
    if not low < high:
        return [Text(text("The FRFs of {names} have no frequency in common.", names=names), missing=True)]
    driven, places = common
    frfs = runs[0].frfs
    frf = f"{frfs.outputs[places[0][0]].positive}/{frfs.inputs[places[0][1]].positive}"
    which = (
        text("{frf}, the drive point", frf=frf)
        if driven
        else text("{frf}, the strongest FRF that all runs have, for want of a drive point", frf=frf)
    )
    make = partial(
        show.frf_overlay,
        [run.frfs for run in runs],
        places,
        [f"{run.run.id}: {condition_text(run)}" for run in runs],
        _band(runs),
    )
    return [
        book.picture(
            make,
            text("FRF {which}, in runs {names}.", which=which, names=names),
            text("FRF before and after: {which}.", which=which),
        )
    ]


def _band(runs: list[RunResult]) -> tuple[float, float] | None:
    """The band of the fits, where all runs were fitted through model orders."""
    bands = [run.poles.band for run in runs if run.poles is not None]
    if len(bands) < len(runs):
        return None
    low, high = max(band[0] for band in bands), min(band[1] for band in bands)
    return (low, high) if low < high else None


def _common(sets: list[FrfSet]) -> tuple[bool, list[tuple[int, int]]] | None:
    """Whether it is a drive point, and the position in each set, of the strongest FRF that all sets have."""
    known = [
        {
            (output.positive, input_.positive): (o, i)
            for o, output in enumerate(one.outputs)
            for i, input_ in enumerate(one.inputs)
        }
        for one in sets
    ]
    shared = [pair for pair in known[0] if all(pair in other for other in known[1:])]
    driven = [pair for pair in shared if pair[0] == pair[1]]
    if not shared:
        return None
    size = {pair: float(np.nanmax(np.abs(sets[0].values[:, *known[0][pair]]))) for pair in driven or shared}
    best = max(size, key=lambda pair: size[pair])
    return bool(driven), [places[best] for places in known]
