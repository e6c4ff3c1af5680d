"""The force of a shaker test: its level at resonance, how far it dropped there, and what a mount mass took."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.signal
from jaxtyping import Complex, Float

from ema.data import Finding, FrfSet, Recording
from ema.dof import Dof, match
from ema.errors import InputError
from ema.progress import Progress, advance, silent
from ema.synthesis import convert

DROPOUT = 0.9
"""Force at resonance over that beside it, below which a finding tells the drop-out."""
_BANDWIDTHS = 3.0
_BESIDE = 8.0


@dataclass(frozen=True)
class ForceLevel:
    """Amplitude of the exciting force while a sine passes a resonance.

    ``level`` N, its standard deviation ``std`` over the passage (within three half-power bandwidths to either side),
    and ``dropout``: the level over that beside the resonance, 1 where the force did not drop.
    """

    level: float
    std: float
    dropout: float
    findings: tuple[Finding, ...] = ()


def force_at_resonance(recording: Recording, frequency: float, damping: float, discard: float = 0.0) -> ForceLevel:
    """Force level of a swept or stepped sine at a resonance: the label of a point of a damping map.

    Parameters
    ----------
    frequency, damping : Hz and ratio of the mode.
    discard : s at the start of the record that are left out (the first period of a periodic sweep, the start-up).

    Raises
    ------
    InputError : no force channel or several, a mode that was not passed, a mode or time that is no positive number.
    """
    where = recording.name or "recording"
    rows = recording.with_role("reference")
    if len(rows) != 1:
        raise InputError("a sine test has one force channel", where=where, got=f"{len(rows)}", expected="1")
    if not (frequency > 0 and damping > 0 and discard >= 0):
        raise InputError(
            "not a mode",
            where=where,
            got=f"{frequency} Hz, damping {damping}, discard {discard} s",
            expected="positive numbers",
        )
    first = int(discard * recording.sampling_rate)
    force = np.asarray(recording.signals[rows[0], first:], dtype=np.float64)
    at, amplitude = _passage(force - force.mean(), recording.sampling_rate)
    width = 2 * damping * frequency
    inside = np.abs(at - frequency) <= _BANDWIDTHS * width
    if inside.sum() < 16:
        raise InputError(
            "the sweep does not pass the mode",
            where=f"{where}, {frequency:g} Hz",
            got=f"{inside.sum()} samples near it",
            expected="a sine through the resonance",
        )
    core = np.abs(at - frequency) <= 0.5 * width
    core = core if core.sum() >= 4 else inside
    beside = (np.abs(at - frequency) > _BESIDE * width) & (np.abs(at - frequency) <= 3 * _BESIDE * width)
    level = float(np.mean(amplitude[core]))
    dropout = level / float(np.median(amplitude[beside])) if beside.sum() >= 16 else float("nan")
    findings: tuple[Finding, ...] = ()
    if dropout < DROPOUT:
        findings = (
            Finding(
                "info",
                "force-dropout",
                where,
                f"the force falls to {dropout:.0%} at {frequency:.4g} Hz: {level:.3g} N at resonance.",
                dropout,
                DROPOUT,
                "Label the point with the force at resonance; control the level where the map needs it.",
            ),
        )
    return ForceLevel(level, float(np.std(amplitude[inside])), dropout, findings)


@dataclass(frozen=True)
class PhaseResonance:
    """Where a response lags its force by a quarter of a period: ``frequency`` Hz, ``ratio`` of the amplitudes of
    response and force there, and ``force`` N there (NaN where unknown)."""

    frequency: float
    ratio: float
    force: float
    findings: tuple[Finding, ...] = ()


def phase_resonance(
    frequencies: Float[np.ndarray, "freq"],
    values: Complex[np.ndarray, "freq"],
    force: Float[np.ndarray, "freq"] | None = None,
    where: str = "stepped sine",
) -> PhaseResonance:
    """Phase resonance of one displacement or acceleration over force: the zero of its real part nearest to its top.

    Parameters
    ----------
    frequencies : Hz, ascending.
    values : response over force; a phase of either sign.
    force : amplitude in N at every frequency; a finding tells where it was not constant.

    Raises
    ------
    InputError : lengths that differ, NaN, no quadrature within the lines.

    Source: Scheel, Peter, Leine, Krack (2018), phase-resonant testing of amplitude-dependent modes.
    """
    frequencies, values = np.asarray(frequencies, dtype=np.float64), np.asarray(values, dtype=np.complex128)
    if len(frequencies) != len(values) or len(values) < 3 or not np.all(np.isfinite(values)):
        raise InputError(
            "no response over frequency",
            where=where,
            got=f"{len(frequencies)} frequencies, {len(values)} values",
            expected="as many finite values, 3 or more",
        )
    top = int(np.abs(values).argmax())
    crossings = np.flatnonzero(np.diff(np.signbit(values.real)))
    if not len(crossings):
        raise InputError(
            "no phase resonance within the lines",
            where=where,
            got=f"{frequencies[0]:g} to {frequencies[-1]:g} Hz",
            expected="a quarter of a period between response and force",
            advice="step over the resonance on both sides",
        )
    k = int(crossings[np.abs(crossings + 0.5 - top).argmin()])
    angle = np.unwrap(np.angle(values[k : k + 2]))
    quarter = np.pi * (np.floor(angle.min() / np.pi) + 0.5)
    share = float((quarter - angle[0]) / (angle[1] - angle[0]))
    sizes = np.abs(values[k : k + 2])
    ratio, frequency = (float(pair[0] + share * (pair[1] - pair[0])) for pair in (sizes, frequencies[k : k + 2]))
    if force is None:
        return PhaseResonance(frequency, ratio, float("nan"))
    held = np.asarray(force, dtype=np.float64)
    spread = float(held.max() / held.min() - 1)
    findings: tuple[Finding, ...] = ()
    if spread > 1 / DROPOUT - 1:
        findings = (
            Finding(
                "warning",
                "force-not-constant",
                where,
                f"the force runs from {held.min():.3g} to {held.max():.3g} N over "
                "the lines: the FRF belongs to no one level.",
                spread,
                1 / DROPOUT - 1,
                "Label it with the force at resonance, or control the force.",
            ),
        )
    return PhaseResonance(frequency, ratio, float(np.interp(frequency, frequencies, held)), findings)


def sweep_rate(
    recording: Recording, frequency: float, damping: float, friction: bool, periodic: bool = False
) -> tuple[float, float, tuple[Finding, ...]]:
    """How fast a sweep passes a resonance, in Hz/s, and the fastest that keeps its response steady.

    A linear structure whose decay is recorded, or that is swept periodically, has no bias by the rate in its FRF; a
    response that is tracked has. A friction joint never reaches a steady amplitude in a fast sweep, whatever the
    analysis, and the error of the damping may have either sign.

    Parameters
    ----------
    frequency, damping : Hz and ratio of the mode.
    friction : whether there is a joint that may slip.
    periodic : whether the sweep repeats without a pause.

    Raises
    ------
    InputError : no force channel or several, a mode that was not passed.

    Source: limit of 216 f^2 zeta^2 Hz/min for linear sweeps (Ewins 2000, after ISO 7626-2).
    """
    where = recording.name or "recording"
    rows = recording.with_role("reference")
    if len(rows) != 1:
        raise InputError("a sine test has one force channel", where=where, got=f"{len(rows)}", expected="1")
    force = np.asarray(recording.signals[rows[0]], dtype=np.float64)
    at, _ = _passage(force - force.mean(), recording.sampling_rate)
    limit = 216 * (frequency * damping) ** 2 / 60
    reach = 2 * damping * frequency
    inside = np.flatnonzero(np.abs(at - frequency) <= reach)
    runs = np.split(inside, np.flatnonzero(np.diff(inside) > 1) + 1)
    longest = max(runs, key=len)
    if len(longest) < 8:
        raise InputError(
            "the sweep does not pass the mode",
            where=f"{where}, {frequency:g} Hz",
            got=f"{len(longest)} samples near it",
            expected="a sine through the resonance",
        )
    slope = np.polyfit(longest / recording.sampling_rate, at[longest], 1)[0]
    rate = float(abs(slope))
    if rate <= limit:
        return rate, limit, ()
    if friction:
        found = Finding(
            "warning",
            "sweep-rate",
            where,
            f"the sweep passes {frequency:.4g} Hz with {rate:.3g} Hz/s: the joint is "
            "not at a steady amplitude, and the sign of the error in the damping is unknown.",
            rate,
            limit,
            "Sweep slower, or step the sine.",
        )
    elif periodic:
        found = Finding(
            "info",
            "sweep-rate",
            where,
            f"the periodic sweep passes {frequency:.4g} Hz with {rate:.3g} Hz/s; FRFs of "
            "a linear structure have no error by it.",
            rate,
            limit,
        )
    else:
        found = Finding(
            "info",
            "sweep-rate",
            where,
            f"the sweep passes {frequency:.4g} Hz with {rate:.3g} Hz/s: a tracked "
            "response is too low there; FRFs are right where the whole decay is recorded.",
            rate,
            limit,
        )
    return rate, limit, (found,)


def _passage(force: Float[np.ndarray, "sample"], rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Momentary frequency in Hz and amplitude of a sine whose frequency moves, smoothed over a few periods."""
    analytic = scipy.signal.hilbert(force, scipy.fft.next_fast_len(len(force)))[: len(force)]
    turn = np.angle(analytic[1:] * np.conj(analytic[:-1]))
    crossings = max(int(np.sum(np.diff(np.signbit(force)))), 2)
    span = max(int(6 * len(force) / crossings) | 1, 3)
    weight = np.abs(analytic[1:] * analytic[:-1])
    kernel = np.ones(span) / span
    smooth = np.convolve(turn * weight, kernel, "same") / np.maximum(np.convolve(weight, kernel, "same"), 1e-300)
    amplitude = np.sqrt(2 * np.convolve(force[1:] ** 2, kernel, "same"))
    edge = slice(span, len(smooth) - span)
    return smooth[edge] * rate / (2 * np.pi), amplitude[edge]


def without_mount_mass(frfs: FrfSet, mass: float, drive: Dof | str) -> FrfSet:
    """FRFs without the mass between load cell and structure (cell, stud, pad), which takes a part of the force.

    The structure gets F - m a: every FRF of the force at ``drive`` is divided by 1 - m A with the measured accelerance
    A of the drive point.

    Parameters
    ----------
    mass : kg below the sensing element.
    drive : DOF of the force; its own response must have been measured.

    Raises
    ------
    InputError : a negative mass, no such force, no response at the drive point.

    Source: Ewins (2000), mass cancellation of drive-point measurements.
    """
    where = frfs.name or "FRFs"
    if not (np.isfinite(mass) and mass >= 0):
        raise InputError("not a mass", where=where, got=f"{mass} kg", expected="0 or more")
    wanted = Dof.parse(drive)
    columns, rows = match([wanted], frfs.inputs), match([wanted], frfs.outputs)
    if not columns or not rows:
        raise InputError(
            "the drive point was not measured",
            where=where,
            got=str(wanted),
            expected="a force and a response at the same DOF",
            advice="put an accelerometer at the shaker, or leave the mass out of account",
        )
    column, row, sign = columns[0][1], rows[0][1], columns[0][2] * rows[0][2]
    accelerance = convert(frfs, "accelerance").values
    share = 1 - mass * sign * accelerance[:, row, column]
    values = frfs.values.copy()
    values[:, :, column] /= share[:, None]
    variance = frfs.variance
    if variance is not None:
        variance = variance.copy()
        variance[:, :, column] /= np.abs(share[:, None]) ** 4
    steps = (*frfs.provenance.steps, "estimate.without_mount_mass")
    provenance = replace(frfs.provenance, steps=steps)
    return replace(frfs, values=values, variance=variance, deviations=None, provenance=provenance)


def control_level(
    measure: Callable[[float], float],
    target: float,
    tolerance: float = 0.05,
    most: int = 6,
    progress: Progress = silent,
) -> tuple[float, tuple[float, ...]]:
    """Find the command that gives a force level at resonance, by at most ``most`` measurements.

    Parameters
    ----------
    measure : takes a command (N, or V of the amplifier) and returns the force at resonance it led to, in N.
    target : N; ``tolerance`` relative.

    Returns
    -------
    The command, and the levels measured on the way.

    Raises
    ------
    InputError : a target that is no positive number, a level that is none, or no success within the measurements.
    """
    if not (np.isfinite(target) and target > 0):
        raise InputError("not a force level", where="level control", got=f"{target} N", expected="above 0")
    commands, levels = [float(target)], []
    for number in range(most):
        level = float(measure(commands[-1]))
        if not (np.isfinite(level) and level > 0):
            raise InputError(
                "the measured force is no level",
                where="level control",
                got=f"{level} N",
                expected="above 0",
                advice="check the force channel and the amplifier",
            )
        levels.append(level)
        advance(progress, "level control", number + 1, most)
        if abs(level / target - 1) <= tolerance:
            return commands[-1], tuple(levels)
        commands.append(_next_command(commands, levels, target))
    raise InputError(
        "the level was not reached",
        where="level control",
        got=", ".join(f"{level:.3g} N" for level in levels),
        expected=f"{target:g} N +- {tolerance:.0%}",
        advice="the joint may jump between two amplitudes here: use another level",
    )


def _next_command(commands: list[float], levels: list[float], target: float) -> float:
    """Secant in logarithms once there are two measurements, else in proportion."""
    x, y = np.log(commands), np.log(levels)
    slope = 1.0
    if len(levels) > 1 and abs(x[-1] - x[-2]) > 1e-6:
        slope = float(np.clip((y[-1] - y[-2]) / (x[-1] - x[-2]), 0.4, 2.5))
    return float(np.exp(x[-1] + np.clip((np.log(target) - y[-1]) / slope, -1.5, 1.5)))
