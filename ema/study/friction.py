"""What a study says about friction beside its modes: ring-downs and hysteresis loops."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.stats
from jaxtyping import Float

from ema.data import (
    AmplitudeDependentMode,
    Campaign,
    Decay,
    Finding,
    Loop,
    Recording,
    Run,
    RunResult,
    SingleMode,
)
from ema.errors import InputError
from ema.progress import Progress
from ema.study.recipe import LoopTable, RingDownTable, StatementTable
from ema.units import SI_UNIT

if TYPE_CHECKING:
    from ema.compare.amplitude_resolved import RingDownMode

RING_DOWN = "ring_down_modes"
"""Step in the provenance of a mode over its amplitude that was read from the ring-downs of a hammer test."""
LEVEL = 0.95
"""Of the intervals of a mode over its amplitude: so many hold a number that is right at every amplitude. That more miss
it by chance than do has a probability; below one less the level, it is not called right at every amplitude."""
_SAME = 0.1
"""Relative distance of frequencies up to which a linear fit is about the same mode: it slips by a few percent."""


def ring_downs(campaign: Campaign, tables: Sequence[RingDownTable]) -> tuple[Decay, ...]:
    """The ring-down of every record of the runs named.

    Parameters
    ----------
    campaign : campaign that holds the runs.
    tables : tables of the recipe, each with a run, the band [Hz] of the mode, and optionally a channel, start and end
        [s].

    Returns
    -------
    One for each record, in the order of the tables, named by run and record.

    Raises
    ------
    InputError : no such run, a run without records, or what ``ema.estimate.ring_down`` refuses.
    """
    from ema.estimate import ring_down

    return tuple(
        replace(ring_down(record, table.band, table.channel or None, table.start, table.stop), name=name)
        for table in tables
        for name, record in _records(campaign[table.run])
    )


def over_amplitude(
    run: Run, result: RunResult, band: tuple[float, float], progress: Progress
) -> tuple[AmplitudeDependentMode, ...]:
    """Every mode of a hammer test over its amplitude, and the amplitudes to which a linear fit of its FRFs belongs.

    Raises
    ------
    InputError : a record cannot be used.
    """
    from ema.compare import ring_down_modes

    modes = ring_down_modes(run, band, progress)
    return tuple(
        replace(one.mode, findings=(*one.mode.findings, *_linear_reading(one, result.equivalent))) for one in modes
    )


def to_know(modes: Sequence[AmplitudeDependentMode]) -> tuple[Finding, ...]:
    """Findings about modes over their amplitude; those of ring-downs stand beside their values."""
    return tuple(finding for mode in modes if RING_DOWN not in mode.provenance.steps for finding in mode.findings)


def _linear_reading(ring_down: "RingDownMode", fits: Sequence[SingleMode]) -> tuple[Finding, ...]:
    """To which amplitudes belongs what one linear mode fitted to the FRFs reads, where the mode is seen to slip."""
    mode, onset = ring_down.mode, ring_down.onset
    middle = float(np.median(mode.frequency.value))
    near = [one for one in fits if abs(one.natural_frequency / middle - 1) < _SAME]
    if not near or not onset.seen:
        return ()
    fit = min(near, key=lambda one: abs(one.natural_frequency - middle))
    unit, slipping = SI_UNIT[mode.quantity].replace("^2", "²"), mode.amplitude >= onset.amplitude.low
    parts = []
    for what, curve, small, value in (
        ("frequency", mode.frequency, onset.frequency, fit.natural_frequency),
        ("damping", mode.damping, onset.damping, fit.damping_ratio),
    ):
        where = _crossings(mode.amplitude[slipping], curve.value[slipping], value)
        listed = f"at {' and '.join(f'{one:.3g}' for one in where)} {unit}" if where else "at no amplitude"
        parts.append(f"its {what} is that {'of small amplitudes' if small.low <= value <= small.high else listed}")
    text = (
        f"one linear mode fitted to the FRFs reads {fit.natural_frequency:.1f} Hz and {100 * fit.damping_ratio:.2f} %: "
        f"{', '.join(parts)}."
    )
    return (Finding("info", "linear-reading", mode.name, text, fit.natural_frequency, None),)


def with_stated(
    modes: Sequence[AmplitudeDependentMode], statements: Sequence[StatementTable]
) -> tuple[AmplitudeDependentMode, ...]:
    """Modes of ring-downs with the amplitudes to which belong the numbers that a publication states of their runs."""
    result = []
    for mode in modes:
        own = [
            one
            for one in statements
            if one.sentence and one.near is not None and mode.name.startswith(f"{one.run}, ") and not one.other
        ]
        near = [one for one in own if _nearest(modes, one) is mode]
        result.append(replace(mode, findings=(*mode.findings, *(said for one in near for said in _stated(mode, one)))))
    return tuple(result)


def _nearest(modes: Sequence[AmplitudeDependentMode], statement: StatementTable) -> AmplitudeDependentMode | None:
    assert statement.near is not None
    of_run = [
        mode for mode in modes if RING_DOWN in mode.provenance.steps and mode.name.startswith(f"{statement.run}, ")
    ]
    off = [abs(float(np.median(mode.frequency.value)) / statement.near - 1) for mode in of_run]
    return of_run[int(np.argmin(off))] if off and min(off) < _SAME else None


def _stated(mode: AmplitudeDependentMode, statement: StatementTable) -> tuple[Finding, ...]:
    """The middle of the limits of a statement, and where the curve has it."""
    kinds = {
        "run frequency": ("stated-frequency", "frequency", 1.0, "Hz"),
        "run damping": ("stated-damping", "damping", 100.0, "%"),
    }
    if statement.quantity not in kinds or not (np.isfinite(statement.low) and np.isfinite(statement.high)):
        return ()
    code, what, factor, sign = kinds[statement.quantity]
    number, band = (statement.low + statement.high) / 2, getattr(mode, what)
    # Within its interval of the number a flat curve crosses it by noise alone.
    apart = np.asarray((band.low > number / factor) | (band.high < number / factor))
    where = _crossings(mode.amplitude[apart], band.value[apart], number / factor) if apart.any() else ()
    curve, within = band.value, mode.amplitude[~apart]
    unit = SI_UNIT[mode.quantity].replace("^2", "²")
    if where:
        text = f"at {' and '.join(f'{one:.3g}' for one in where)} {unit}"
    elif not apart.any():
        text = "within its interval of it at every amplitude"
    elif scipy.stats.binom.sf(apart.sum() - 1, len(apart), 1 - LEVEL) > 1 - LEVEL:
        text = f"within its interval of it at every amplitude but {apart.sum()} of {len(apart)}, as 95 % intervals are"
    elif len(within):
        between = f"{within[0]:.3g} to {within[-1]:.3g}" if len(within) > 1 else f"{within[0]:.3g}"
        text = f"at no amplitude in particular: {len(within)} of {len(apart)} intervals contain it, at {between} {unit}"
    else:
        text = f"at no amplitude seen: {factor * curve.min():.4g} to {factor * curve.max():.4g} {sign}"
    message = f"{number:.4g} {sign} ({statement.source}): the {what} {text}."
    return (Finding("info", code, mode.name, message, number / factor, None),)


def _crossings(
    amplitude: Float[np.ndarray, "level"], curve: Float[np.ndarray, "level"], value: float
) -> tuple[float, ...]:
    """First and last amplitude at which a curve has a value."""
    off = curve - value
    rows = np.flatnonzero((off[:-1] < 0) != (off[1:] < 0))
    log = np.log(amplitude)
    where = [float(np.exp(log[k] + (log[k + 1] - log[k]) * off[k] / (off[k] - off[k + 1]))) for k in rows]
    return tuple(dict.fromkeys((where[0], where[-1]))) if where else ()


def hysteresis_loops(campaign: Campaign, tables: Sequence[LoopTable]) -> tuple[Loop, ...]:
    """The hysteresis loop of every record of the runs named; the normal force is the run's where the record has none.

    Raises
    ------
    InputError : no such run, a run without records, or what ``ema.estimate.measured_loop`` refuses.
    """
    from ema.estimate import measured_loop

    loops = []
    for table in tables:
        nominal = campaign[table.run].condition.normal_force
        for name, record in _records(campaign[table.run]):
            loop = measured_loop(record, table.displacement, table.force)
            normal_force = nominal if np.isnan(loop.normal_force) else loop.normal_force
            loops.append(replace(loop, name=name, normal_force=normal_force))
    return tuple(loops)


def _records(run: Run) -> list[tuple[str, Recording]]:
    if not len(run.recordings):
        raise InputError(
            "the run has no time records", where=f"run {run.id}", got="finished FRFs", expected="records of the motion"
        )
    several = len(run.recordings) > 1
    return [(f"{run.id}, record {n}" if several else run.id, record) for n, record in enumerate(run.recordings, 1)]
