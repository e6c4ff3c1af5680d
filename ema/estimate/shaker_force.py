"""The force of a shaker test: its level at resonance, how far it dropped there, and what a mount mass took."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.ndimage
import scipy.signal
from jaxtyping import Complex, Float

from ema.data import Finding, FrfSet, Recording
from ema.dof import Dof, match
from ema.errors import InputError
from ema.progress import Progress, advance, silent
from ema.synthesis import convert

DROPOUT = 0.9
"""Force at resonance over that beside it, below which a finding tells the drop-out."""
SILENT = 0.05
"""Part of the largest amplitude of a sine below which it rests: what is left is noise, of any momentary frequency."""
_BANDWIDTHS = 3.0
"""Half-power bandwidths on either side of a resonance over which the scatter of the force is read."""
_BESIDE = 8.0
"""Half-power bandwidths from a resonance, up to three times as many, at which the force beside it is read."""


@dataclass(frozen=True)
class ForceLevel:
    """Amplitude of the exciting force while a sine passes a resonance.

    Parameters
    ----------
    level : float
        Force level [N].
    std : float
        Its standard deviation over the passage [N], within three half-power bandwidths to either side.
    dropout : float
        The level over that beside the resonance; 1 where the force did not drop.
    findings : tuple of Finding, optional
        What a reader of the level has to know.

    Examples
    --------
    >>> ForceLevel(level=4.8, std=0.1, dropout=0.96).dropout
    0.96
    """

    level: float
    std: float
    dropout: float
    findings: tuple[Finding, ...] = ()


def force_at_resonance(recording: Recording, frequency: float, damping: float, discard: float = 0.0) -> ForceLevel:
    """Compute the force level of a swept or stepped sine at a resonance: the label of a point of a damping map.

    Parameters
    ----------
    recording : Recording
        A sine that passes the mode, with one force channel.
    frequency : float
        Natural frequency of the mode [Hz].
    damping : float
        Damping ratio of the mode [-].
    discard : float, default 0.0
        Time [s] at the start of the record that is left out: the first period of a periodic sweep, the start-up.

    Returns
    -------
    ForceLevel
        Level, its scatter and the drop of the force at the resonance.

    Raises
    ------
    InputError
        If there is no force channel or several, the sine does not pass the mode, or the mode or the time is no positive
        number.

    Examples
    --------
    >>> from ema.examples import recording
    >>> t = np.arange(20480) / 1024.0
    >>> record = recording(5.0 * np.sin(2 * np.pi * (30.0 * t + 0.5 * t**2)))  # 30 to 50 Hz in 20 s
    >>> round(force_at_resonance(record, frequency=40.0, damping=0.01).level, 1)
    5.0
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
    driven = amplitude > SILENT * amplitude.max()
    inside = driven & (np.abs(at - frequency) <= _BANDWIDTHS * width)
    if inside.sum() < 16:
        raise InputError(
            "the sweep does not pass the mode",
            where=f"{where}, {frequency:g} Hz",
            got=f"{inside.sum()} samples near it",
            expected="a sine through the resonance",
        )
    core = driven & (np.abs(at - frequency) <= 0.5 * width)
    core = core if core.sum() >= 4 else inside
    # where a sine begins and ends, the amplitude is one of the sine and of its pause
    steady = scipy.ndimage.minimum_filter(driven, int(12 * recording.sampling_rate / frequency) | 1)
    beside = steady & (np.abs(at - frequency) > _BESIDE * width) & (np.abs(at - frequency) <= 3 * _BESIDE * width)
    level = float(np.mean(amplitude[core]))
    dropout = level / float(np.median(amplitude[beside])) if beside.sum() >= 16 else float("nan")
    findings: tuple[Finding, ...] = ()
    if dropout < DROPOUT:
        findings = (
            Finding.of(
                "info",
                "force-dropout",
                where,
                "the force falls to {share} at {frequency} Hz: {level} N at resonance.",
                dropout,
                DROPOUT,
                advice="Label the point with the force at resonance; control the level where the map needs it.",
                share=f"{dropout:.0%}",
                frequency=f"{frequency:.4g}",
                level=f"{level:.3g}",
            ),
        )
    return ForceLevel(level, float(np.std(amplitude[inside])), dropout, findings)


@dataclass(frozen=True)
class PhaseResonance:
    """Where a response lags its force by a quarter of a period.

    Parameters
    ----------
    frequency : float
        Frequency [Hz].
    ratio : float
        Amplitude of the response over that of the force.
    force : float
        Amplitude of the force [N]; NaN where unknown.
    findings : tuple of Finding, optional
        What a reader of the frequency has to know.

    Examples
    --------
    >>> PhaseResonance(frequency=40.0, ratio=1e-3, force=5.0).frequency
    40.0
    """

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
    """Find the phase resonance of a response: the zero of the real part nearest to the peak.

    Parameters
    ----------
    frequencies : array of shape (freq,)
        Frequencies [Hz], ascending.
    values : complex array of shape (freq,)
        Displacement or acceleration over force; a phase of either sign.
    force : array of shape (freq,), optional
        Amplitude of the force [N] at every frequency; a finding says where it was not constant.
    where : str, default "stepped sine"
        What the measurement is called in messages.

    Returns
    -------
    PhaseResonance
        Frequency, ratio of the amplitudes and force there, interpolated in the phase between two lines.

    Raises
    ------
    InputError
        If the lengths differ, there are fewer than 3 lines, a value is not finite, or no quadrature lies within the
        lines.

    References
    ----------
    .. [1] Scheel, Peter, Leine and Krack (2018), Journal of Sound and Vibration 435:56.

    Examples
    --------
    >>> f = np.arange(38.0, 42.05, 0.1)
    >>> receptance = 1 / (40.0**2 - f**2 + 2j * 0.01 * 40.0 * f)
    >>> round(phase_resonance(f, receptance).frequency, 3)
    40.0
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
    amplitudes = np.asarray(force, dtype=np.float64)
    spread = float(amplitudes.max() / amplitudes.min() - 1)
    findings: tuple[Finding, ...] = ()
    if spread > 1 / DROPOUT - 1:
        findings = (
            Finding.of(
                "warning",
                "force-not-constant",
                where,
                "the force runs from {low} to {high} N over the lines: the FRF belongs to no one level.",
                spread,
                1 / DROPOUT - 1,
                advice="Label it with the force at resonance, or control the force.",
                low=f"{amplitudes.min():.3g}",
                high=f"{amplitudes.max():.3g}",
            ),
        )
    return PhaseResonance(frequency, ratio, float(np.interp(frequency, frequencies, amplitudes)), findings)


def sweep_rate(
    recording: Recording, frequency: float, damping: float, friction: bool, periodic: bool = False
) -> tuple[float, float, tuple[Finding, ...]]:
    """Compute how fast a sweep passes a resonance, and the fastest rate that keeps its response steady.

    A linear structure whose decay is recorded, or that is swept periodically, has no bias by the rate in its FRF; a
    response that is tracked has. A friction joint never reaches a steady amplitude in a fast sweep, whatever the
    analysis, and the error of the damping may have either sign.

    Parameters
    ----------
    recording : Recording
        A sine that passes the mode, with one force channel.
    frequency : float
        Natural frequency of the mode [Hz].
    damping : float
        Damping ratio of the mode [-].
    friction : bool
        Whether there is a joint that may slip.
    periodic : bool, default False
        Whether the sweep repeats without a pause.

    Returns
    -------
    tuple of (float, float, tuple of Finding)
        Rate [Hz/s], its limit [Hz/s], and what follows for the damping.

    Raises
    ------
    InputError
        If there is no force channel or several, or the sine does not pass the mode.

    References
    ----------
    .. [1] Limit of 216 f^2 zeta^2 Hz/min for linear sweeps: Ewins (2000), Modal Testing, after ISO 7626-2.

    Examples
    --------
    >>> from ema.examples import recording
    >>> t = np.arange(20480) / 1024.0
    >>> record = recording(5.0 * np.sin(2 * np.pi * (30.0 * t + 0.5 * t**2)))  # 1 Hz/s
    >>> rate, limit, _ = sweep_rate(record, frequency=40.0, damping=0.01, friction=False)
    >>> round(rate, 2), round(limit, 3)
    (1.0, 0.576)
    """
    where = recording.name or "recording"
    rows = recording.with_role("reference")
    if len(rows) != 1:
        raise InputError("a sine test has one force channel", where=where, got=f"{len(rows)}", expected="1")
    force = np.asarray(recording.signals[rows[0]], dtype=np.float64)
    at, _ = _passage(force - force.mean(), recording.sampling_rate)
    # 216 f^2 zeta^2 Hz/min (Ewins 2000, after ISO 7626-2), here in Hz/s
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
        finding = Finding.of(
            "warning",
            "sweep-rate",
            where,
            "the sweep passes {frequency} Hz with {rate} Hz/s: the joint is not at a steady amplitude, "
            "and the sign of the error in the damping is unknown.",
            rate,
            limit,
            advice="Sweep slower, or step the sine.",
            frequency=f"{frequency:.4g}",
            rate=f"{rate:.3g}",
        )
    elif periodic:
        finding = Finding.of(
            "info",
            "sweep-rate",
            where,
            "the periodic sweep passes {frequency} Hz with {rate} Hz/s; FRFs of a linear structure have "
            "no error by it.",
            rate,
            limit,
            frequency=f"{frequency:.4g}",
            rate=f"{rate:.3g}",
        )
    else:
        finding = Finding.of(
            "info",
            "sweep-rate",
            where,
            "the sweep passes {frequency} Hz with {rate} Hz/s: a tracked response is too low there; FRFs "
            "are right where the whole decay is recorded.",
            rate,
            limit,
            frequency=f"{frequency:.4g}",
            rate=f"{rate:.3g}",
        )
    return rate, limit, (finding,)


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


def without_mount_mass(frfs: FrfSet, mass: float, drive: Dof | str | Sequence[Dof | str]) -> FrfSet:
    """Remove from FRFs the mass between load cells and structure (cell, stud, pad), which takes a part of the force.

    The structure receives F - m a at each load cell. With the measured accelerances A_d of the drive points to the
    forces that act together, the FRFs H of these become H (I - m A_d)^-1; with one force, H / (1 - m A).

    Parameters
    ----------
    frfs : FrfSet
        FRFs; the responses at the drive points are among them.
    mass : float
        Mass below each sensing element [kg].
    drive : Dof, str or sequence of these
        DOFs of the forces that act together. Forces that were applied one after the other are corrected one by one.

    Returns
    -------
    FrfSet
        The corrected FRFs, with their variance; without the deviations of single blocks.

    Raises
    ------
    InputError
        If the mass is negative, or there is no such force or no response at a drive point.

    References
    ----------
    .. [1] Mass cancellation of drive-point measurements: Ewins (2000), Modal Testing.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> frfs = frf_set().pick(inputs=[0])
    >>> corrected = without_mount_mass(frfs, mass=0.01, drive="1:+Z")
    >>> share = 1 - 0.01 * frfs.values[:, 0, 0]
    >>> bool(np.allclose(corrected.values[:, 0, 0] * share, frfs.values[:, 0, 0]))
    True
    """
    where = frfs.name or "FRFs"
    if not (np.isfinite(mass) and mass >= 0):
        raise InputError("not a mass", where=where, got=f"{mass} kg", expected="0 or more")
    wanted = [Dof.parse(one) for one in ([drive] if isinstance(drive, Dof | str) else drive)]
    forces, responses = match(wanted, frfs.inputs), match(wanted, frfs.outputs)
    for number, dof in enumerate(wanted):
        if number not in {one[0] for one in forces} or number not in {one[0] for one in responses}:
            raise InputError(
                "the drive point was not measured",
                where=where,
                got=str(dof),
                expected="a force and a response at the same DOF",
                advice="put an accelerometer at the shaker, or leave the mass out of account",
            )
    columns, rows = [one[1] for one in forces], [one[1] for one in responses]
    # Acceleration of each load cell in the direction of its own force.
    signs = np.array([one[2] * other[2] for one, other in zip(forces, responses, strict=True)])
    accelerance = convert(frfs, "accelerance").values[:, :, columns]
    taken = mass * signs[:, None] * accelerance[:, rows]
    through = np.linalg.inv(np.eye(len(rows)) - taken)
    values, variance = frfs.values.copy(), frfs.variance
    values[:, :, columns] = values[:, :, columns] @ through
    if variance is not None:
        # dH' = (dH + m A' dA_d) (I - m A_d)^-1, of errors that are independent from FRF to FRF
        follow = np.zeros((*values.shape[:2], values.shape[1]), complex)
        follow[:, :, rows] = mass * signs * (accelerance @ through)
        follow += np.eye(values.shape[1])
        variance = variance.copy()
        variance[:, :, columns] = np.abs(follow) ** 2 @ variance[:, :, columns] @ np.abs(through) ** 2
    steps = (*frfs.provenance.steps, "estimate.without_mount_mass")
    provenance = replace(frfs.provenance, steps=steps)
    return replace(frfs, values=values, variance=variance, deviations=None, provenance=provenance)


def control_level(
    measure: Callable[[float], float],
    target: float,
    tolerance: float = 0.05,
    most: int = 6,
    progress: Progress = silent,
    *,
    first: float | None = None,
    largest: float = np.inf,
) -> tuple[float, tuple[float, ...]]:
    """Find the command that gives a force level at resonance, by few measurements.

    The first correction is in proportion, all others go along the secant through the last two measurements in
    logarithms; no command is above ``largest``.

    Parameters
    ----------
    measure : callable
        Takes a command (N, or V of the amplifier) and returns the force at resonance [N] that it led to.
    target : float
        Force at resonance [N].
    tolerance : float, default 0.05
        Accepted relative difference of the level.
    most : int, default 6
        Largest number of measurements.
    progress : Progress, optional
        Called after each measurement.
    first : float, optional
        Command to begin with; by default as many as the target has newtons.
    largest : float, optional
        Largest command that may be given: what amplifier and structure bear.

    Returns
    -------
    tuple of (float, tuple of float)
        The command, and the levels measured on the way.

    Raises
    ------
    InputError
        If the target, a limit or a measured level is no positive number, or the level is not reached within ``most``
        measurements or with the largest command.

    Examples
    --------
    >>> command, levels = control_level(lambda command: 0.8 * command, target=5.0)
    >>> round(0.8 * command, 2), len(levels)
    (5.0, 2)
    """
    if not (np.isfinite(target) and target > 0):
        raise InputError("not a force level", where="level control", got=f"{target} N", expected="above 0")
    if not largest > 0 or (first is not None and not 0 < first <= largest):
        raise InputError(
            "not a command to begin with",
            where="level control",
            got=f"{first}, with {largest:g} as the largest",
            expected="above 0, and no more than the largest",
        )
    commands, levels = [min(float(target) if first is None else float(first), largest)], []
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
        if commands[-1] >= largest and level < target:
            raise InputError(
                "the level needs more than the largest command",
                where="level control",
                got=f"{level:.3g} N with {largest:g}",
                expected=f"{target:g} N",
                advice="ask for a lower level, or raise the largest command if amplifier and structure bear it",
            )
        commands.append(min(_next_command(commands, levels, target), largest))
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
