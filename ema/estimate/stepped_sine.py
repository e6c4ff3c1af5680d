"""FRFs of a stepped sine: frequency after frequency, read by least squares of a sine and its harmonics."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Complex, Float

from ema.data import Deviations, Finding, FrfSet, Provenance, Recording, Run
from ema.errors import InputError
from ema.estimate import channels, clipping, equal_channels, gain_changes, hammer_findings, settling
from ema.estimate.record_agreement import LEVEL, about_level
from ema.progress import Progress, advance, silent

HARMONICS = 5
"""Highest harmonic that is told apart from noise."""
UNSTEADY = 0.02
"""Change of a response between the halves of a record above which it was not settled."""
UNUSABLE = 0.2
"""The same change above which the FRFs are not those of steady vibration anywhere near a resonance."""
_FEWEST_CYCLES = 4.0
"""Cycles of the force below which its frequency and harmonics are not read."""
_CLEAR = 5.0
"""Standard deviations of noise that a change between the halves of a record has to exceed."""
_NAMED = 3
"""Frequencies of free vibration that a finding names: those that were found first explain most."""


GLIDES = 0.25
"""Rise of the frequency from the first to the second half of a stay, over the distance of the stays, above which the
force is a sweep: 0 for steps, 0.1 where a generator glides for the first tenth of a stay, 0.5 for a sweep."""


@dataclass(frozen=True)
class Step:
    """One stay at a frequency [Hz]: amplitudes (channel, order) with the force first, the variance of those of order 1,
    by how much each response over the force changed while it lasted (0 within noise), the rise of the frequency of the
    force from the first to the second half [Hz], and what each block of the stays changes in the amplitudes of order 1
    (none where no free vibration was taken off)."""

    frequency: float
    amplitudes: Complex[np.ndarray, "channel order"]
    noise: Float[np.ndarray, "channel"]
    moved: Float[np.ndarray, "out"]
    rise: float = 0.0
    changes: Complex[np.ndarray, "block channel"] | None = None


@dataclass(frozen=True)
class Steps:
    """What a stepped sine shows beside its FRFs.

    Parameters
    ----------
    frequencies : array of shape (freq,)
        Frequencies [Hz].
    force : array of shape (freq,)
        Amplitude of the first harmonic of the force [N].
    responses : complex array of shape (freq, out, order)
        Amplitudes of the orders 1, 2, ... of every response, in SI.

    Examples
    --------
    >>> steps = Steps(np.array([39.0, 41.0]), np.array([5.0, 4.0]), np.ones((2, 1, 3), dtype=complex))
    >>> steps.force_at(40.0)
    4.5
    """

    frequencies: Float[np.ndarray, "freq"]
    force: Float[np.ndarray, "freq"]
    responses: Complex[np.ndarray, "freq out order"]

    @property
    def distortion(self) -> Float[np.ndarray, "freq out"]:
        """Rms of the higher orders over the first."""
        power = np.sum(np.abs(self.responses[..., 1:]) ** 2, axis=-1)
        return np.asarray(np.sqrt(power) / np.maximum(np.abs(self.responses[..., 0]), 1e-300))

    def force_at(self, frequency: float) -> float:
        """Return the amplitude of the force at a frequency, interpolated between the lines.

        Parameters
        ----------
        frequency : float
            Frequency [Hz].

        Returns
        -------
        float
            Amplitude [N]; outside the lines that of the nearest one.

        Examples
        --------
        >>> Steps(np.array([39.0, 41.0]), np.array([5.0, 4.0]), np.ones((2, 1, 1), dtype=complex)).force_at(45.0)
        4.0
        """
        return float(np.interp(frequency, self.frequencies, self.force))


def stepped(run: Run, discard: float = 0.0, progress: Progress = silent) -> FrfSet:
    """Estimate the FRFs of a stepped sine at its own frequencies.

    Parameters
    ----------
    run : Run
        As :func:`stepped_test`.
    discard : float, default 0.0
        Time [s] at the start of every frequency that is left out, while the structure settles.
    progress : Progress, optional
        Called after each record.

    Returns
    -------
    FrfSet
        FRFs on the frequencies that were measured.

    Raises
    ------
    InputError
        As :func:`stepped_test`.

    Examples
    --------
    >>> from ema.data import Condition, Excitation
    >>> from ema.examples import recording
    >>> t = np.arange(8192) / 1024.0
    >>> records = tuple(recording(5.0 * np.sin(2 * np.pi * f * t)) for f in (30.0, 50.0))
    >>> frfs = stepped(Run("steps", Condition(Excitation("stepped sine")), records), discard=6.0)
    >>> frfs.frequencies.round(3)
    array([30., 50.])
    """
    return stepped_test(run, discard, progress)[0]


def stepped_test(run: Run, discard: float = 0.0, progress: Progress = silent) -> tuple[FrfSet, Steps]:
    """Estimate the FRFs of a stepped sine, its force at every frequency and the harmonics of the responses.

    Each record holds one frequency, or one after the other where the condition states the ``period`` that it stays at
    each; the frequency is read from the force. What was measured twice at one frequency is averaged.

    Parameters
    ----------
    run : Run
        Records with one force and the same responses.
    discard : float, default 0.0
        Time [s] at the start of every frequency that is left out, while the structure settles.
    progress : Progress, optional
        Called after each record.

    Returns
    -------
    tuple of (FrfSet, Steps)
        FRFs on the frequencies that were measured, and force and harmonics there.

    Raises
    ------
    InputError
        If a record has no sine, is too short, has other responses, or several forces.

    Examples
    --------
    >>> from ema.data import Condition, Excitation
    >>> from ema.examples import recording
    >>> t = np.arange(8192) / 1024.0
    >>> records = tuple(recording(5.0 * np.sin(2 * np.pi * f * t)) for f in (30.0, 50.0))
    >>> _, steps = stepped_test(Run("steps", Condition(Excitation("stepped sine")), records), discard=6.0)
    >>> steps.force.round(3)
    array([5., 5.])
    """
    records = channels.recordings_of(run)
    steps: list[Step] = []
    stays: list[settling.Stay | None] = []
    layout, first, unsteady = None, None, 0.0
    for place, record in enumerate(records):
        where = channels.describe(run, record)
        this = channels.layout(record, where)
        channels.finite(record, this, where)
        if layout is None:
            layout, first = this, record
        if this.outputs != layout.outputs or this.inputs != layout.inputs or len(this.inputs) != 1:
            raise InputError(
                "the records of a stepped sine differ in their channels",
                where=where,
                got=", ".join(map(str, (*this.inputs, *this.outputs))),
                expected="one force, and the responses of the first record",
            )
        rate = record.sampling_rate
        for signals in _stays(record, [*this.references, *this.responses], run.condition.excitation.period, where):
            signals = _settled(signals, round(discard * rate), where)
            frequency = _frequency(signals[0], rate, where)
            amplitudes, noise = _orders(signals, frequency, rate)
            change, moved = _change(signals, frequency, rate)
            unsteady = max(unsteady, change)
            steps.append(Step(frequency, amplitudes, noise, moved, _rise(signals[0], frequency, rate)))
            stays.append(settling.compress(signals, 2 * np.pi * frequency / rate, 1 / rate, HARMONICS))
        advance(progress, "reading steps", place + 1, len(records))
    assert layout is not None and first is not None
    _staying(steps, channels.describe(run))
    steady = settling.settled(stays, HARMONICS)
    if steady is not None:
        steps = [_without_free_vibration(step, steady, place) for place, step in enumerate(steps)]
    return _joined(run, first, layout, steps, _about_settling(run, unsteady, steady))


def _stays(record: Recording, rows: list[int], period: float, where: str) -> list[Float[np.ndarray, "channel sample"]]:
    """The stretches of one frequency each."""
    signals = np.asarray(record.signals[rows], dtype=np.float64)
    if not np.isfinite(period):
        return [signals]
    length = period * record.sampling_rate
    count = int(signals.shape[1] / length + 1e-6)
    if count < 1:
        raise InputError(
            "the record is shorter than the stay at one frequency",
            where=where,
            got=f"{record.duration:g} s",
            expected=f"{period:g} s or more",
        )
    edges = np.round(np.arange(count + 1) * length).astype(int)
    return [signals[:, a:b] for a, b in pairwise(edges)]


def _settled(signals: Float[np.ndarray, "channel sample"], start: int, where: str) -> Float[np.ndarray, "channel kept"]:
    kept = signals[:, start:]
    if kept.shape[1] < 16:
        raise InputError(
            "nothing is left of the record",
            where=where,
            got=f"{kept.shape[1]} samples behind the first {start}",
            expected="16 or more",
            advice="discard less",
        )
    return np.asarray(kept - kept.mean(axis=1, keepdims=True))


def _frequency(force: Float[np.ndarray, "sample"], rate: float, where: str) -> float:
    """Frequency of a sine in Hz: the peak of its spectrum, refined by least squares."""
    if not force.any():
        raise InputError("the force is zero or constant", where=where, advice="check the force channel")
    size = 4 * len(force)
    window = np.hanning(len(force))
    spectrum = np.abs(np.fft.rfft(force * window, size))
    top = int(spectrum[1:].argmax()) + 1
    frequency = top * rate / size
    time = (np.arange(len(force)) - 0.5 * len(force)) / rate
    constant = np.ones(len(force))
    for _ in range(4):
        angle = 2 * np.pi * frequency * time
        cosine, sine = np.cos(angle), np.sin(angle)
        # Gauss-Newton on F = a cos wt + b sin wt: dF/dw = -a t sin wt + b t cos wt, so c = a dw and d = b dw
        basis = np.stack([cosine, sine, -time * sine, time * cosine, constant], axis=1)
        a, b, c, d, _ = np.linalg.solve(basis.T @ basis, basis.T @ force)
        frequency += float((a * c + b * d) / (a**2 + b**2)) / (2 * np.pi)
    angle = 2 * np.pi * frequency * time
    basis = np.stack([np.cos(angle), np.sin(angle), constant], axis=1)
    rest = force - basis @ np.linalg.lstsq(basis, force, rcond=None)[0]
    if not 0 < frequency < rate / 2 or rest @ rest > 0.25 * force @ force:
        raise InputError(
            "the force is no sine",
            where=where,
            got=f"{100 * (rest @ rest) / (force @ force):.0f} % of its power lie elsewhere",
            expected="one frequency for each record",
            advice='a sweep is kind = "sweep"',
        )
    if frequency * len(force) / rate < _FEWEST_CYCLES:
        raise InputError(
            "too few cycles in the record",
            where=where,
            got=f"{frequency * len(force) / rate:.1f}",
            expected=f"{_FEWEST_CYCLES:g} or more",
        )
    return frequency


def _rise(force: Float[np.ndarray, "sample"], frequency: float, rate: float) -> float:
    """Frequency of a sine in the second half of a record less that in the first [Hz], by its phase in four quarters."""
    quarter = len(force) // 4
    time = np.arange(quarter) / rate
    basis = np.stack([np.cos(2 * np.pi * frequency * time), np.sin(2 * np.pi * frequency * time), np.ones(quarter)]).T
    cosine, sine, _ = np.linalg.lstsq(basis, force[: 4 * quarter].reshape(4, quarter).T, rcond=None)[0]
    turns = np.angle((cosine - 1j * sine) * np.exp(-2j * np.pi * frequency * np.arange(4) * quarter / rate))
    first, second = (np.angle(np.exp(1j * (turns[k + 1] - turns[k]))) for k in (0, 2))
    return float((second - first) * rate / (2 * np.pi * quarter))


def _staying(steps: Sequence[Step], where: str) -> None:
    """Refuse a force whose frequency rises within its stays as it does from stay to stay.

    Raises
    ------
    InputError : it does.
    """
    if len(steps) < 4:
        return
    rises, apart = np.array([step.rise for step in steps[1:]]), np.diff([step.frequency for step in steps])
    share = np.divide(rises, apart, out=np.zeros_like(rises), where=np.abs(apart) > 1e-5 * steps[0].frequency)
    middle = float(np.median(share))
    noise = 1.5 * float(np.median(np.abs(share - middle))) / np.sqrt(len(share))
    if middle > GLIDES + _CLEAR * noise:
        raise InputError(
            "the frequency of the force does not stay",
            where=where,
            got=f"a change by {2 * abs(float(np.median(rises))):.3g} Hz within a stay, and by "
            f"{abs(float(np.median(apart))):.3g} Hz from one to the next",
            expected="steps of one frequency each",
            advice='a sweep is kind = "sweep"; steps that begin elsewhere have another period',
        )


def _orders(
    signals: Float[np.ndarray, "channel sample"], frequency: float, rate: float
) -> tuple[Complex[np.ndarray, "channel order"], Float[np.ndarray, "channel"]]:
    """Complex amplitudes of the first orders, and the variance of the first of them by what is left over."""
    count = max(min(HARMONICS, int(0.45 * rate / frequency)), 1)
    angle = 2 * np.pi * frequency * np.arange(signals.shape[1]) / rate
    orders = np.arange(1, count + 1)[:, None]
    basis = np.concatenate([np.cos(orders * angle), np.sin(orders * angle), np.ones((1, len(angle)))]).T
    solved, *_ = np.linalg.lstsq(basis, signals.T, rcond=None)
    rest = signals.T - basis @ solved
    noise = np.sum(rest**2, axis=0) / max(len(angle) - 2 * count - 1, 1)
    amplitudes = np.zeros((len(signals), HARMONICS), complex)
    amplitudes[:, :count] = (solved[:count] - 1j * solved[count : 2 * count]).T
    return amplitudes, 4 * noise / len(angle)


def _change(
    signals: Float[np.ndarray, "channel sample"], frequency: float, rate: float
) -> tuple[float, Float[np.ndarray, "out"]]:
    """What changes from the first to the second half of a record, beyond noise.

    The largest relative change of the amplitude of a response, and the change of each response over the force.
    """
    half = signals.shape[1] // 2
    if frequency * half / rate < _FEWEST_CYCLES / 2:
        return 0.0, np.zeros(len(signals) - 1)
    (before, noise), (after, more) = (_orders(part, frequency, rate) for part in (signals[:, :half], signals[:, half:]))
    size, change = np.abs(before[1:, 0]), np.abs(np.abs(after[1:, 0]) - np.abs(before[1:, 0]))
    clear = change > _CLEAR * np.sqrt(noise[1:] + more[1:])
    ratios, variances = zip(*(_over_force(part[:, 0], spread) for part, spread in ((before, noise), (after, more))))
    moved = np.abs(ratios[1] - ratios[0])
    moved = np.where(moved > _CLEAR * np.sqrt(variances[0] + variances[1]), moved, 0.0)
    return (float(np.max(change[clear] / size[clear])) if clear.any() else 0.0), moved


def _without_free_vibration(step: Step, steady: settling.Settled, place: int) -> Step:
    """A stay with the steady amplitudes alone."""
    amplitudes, left = steady.amplitudes[place], steady.left[place]
    force = max(abs(amplitudes[0, 0]), 1e-300)
    moved = (left[1:] + np.abs(amplitudes[1:, 0]) * left[0] / force) / force
    return replace(
        step,
        frequency=float(steady.frequency[place]),
        amplitudes=amplitudes,
        noise=steady.variance[place],
        moved=moved,
        changes=steady.changes[:, place],
    )


def _over_force(
    amplitudes: Complex[np.ndarray, "channel"], noise: Float[np.ndarray, "channel"]
) -> tuple[Complex[np.ndarray, "out"], Float[np.ndarray, "out"]]:
    """Responses over the force, and their variance."""
    force = amplitudes[0] if amplitudes[0] != 0 else 1e-300
    ratio = amplitudes[1:] / force
    return ratio, (noise[1:] + np.abs(ratio) ** 2 * noise[0]) / np.abs(force) ** 2


def _repeated(group: list[Step], ratios: Complex[np.ndarray, "step out"]) -> tuple[Float[np.ndarray, "out"], float]:
    """Variance of the mean of what was measured at one frequency, and the largest relative difference beyond noise.

    It contains the noise within a step and, of several steps, their scatter.
    """
    each = np.array([_over_force(step.amplitudes[:, 0], step.noise)[1] for step in group])
    variance = np.mean(each, axis=0) / len(group)
    if len(group) < 2:
        return variance, 0.0
    mean = ratios.mean(axis=0)
    apart = np.abs(ratios - mean).max(axis=0)
    clear = apart > _CLEAR * np.sqrt(each.max(axis=0))
    scatter = np.sum(np.abs(ratios - mean) ** 2, axis=0) / (len(group) - 1) / len(group)
    return np.maximum(variance, scatter), float(np.max(np.where(clear, apart / np.maximum(np.abs(mean), 1e-300), 0.0)))


def _deviations(group: list[Step]) -> Complex[np.ndarray, "block out"]:
    """What the blocks of the stays change in the mean FRFs of those at one frequency: d(Y/F) = (dY - Y/F dF)/F."""
    found = []
    for step in group:
        assert step.changes is not None
        force = step.amplitudes[0, 0]
        ratio = step.amplitudes[1:, 0] / force
        found.append((step.changes[:, 1:] - ratio * step.changes[:, :1]) / force)
    return np.asarray(np.mean(found, axis=0))


def _joined(
    run: Run, first: Recording, layout: channels.Layout, steps: list[Step], settling_findings: list[Finding]
) -> tuple[FrfSet, Steps]:
    """All steps in the order of their frequencies; those at one frequency averaged over the force."""
    where = channels.describe(run)
    groups = _by_frequency(steps)
    frequencies = np.array([np.mean([step.frequency for step in group]) for group in groups])
    values, variance, force, responses = [], [], [], []
    apart = (0.0, 0.0)
    repeats: list[Finding] = []
    for group, frequency in zip(groups, frequencies, strict=True):
        ratios = np.array([step.amplitudes[1:, 0] / step.amplitudes[0, 0] for step in group])
        spread, differ = _repeated(group, ratios)
        apart = max(apart, (differ, float(frequency)))
        amplitudes = [float(np.abs(step.amplitudes[0, 0])) for step in group]
        repeats.extend(about_level(amplitudes, f"{where}, {frequency:.5g} Hz"))
        values.append(ratios.mean(axis=0))
        variance.append(spread)
        force.append(np.mean([np.abs(step.amplitudes[0, 0]) for step in group]))
        responses.append(group[0].amplitudes[1:])
    quantity, unit = channels.frf_quantity(
        [first.channels[row] for row in first.with_role("response")],
        [first.channels[row] for row in first.with_role("reference")],
        where,
    )
    mixed = sorted(repeats, key=lambda finding: finding.value or 0.0)[-1:]
    names = [first.channels[row].name for row in (*layout.references, *layout.responses)]
    # the mean of steps that differ is no gain
    gains = (
        ()
        if apart[0] > LEVEL
        else gain_changes.about_gains(frequencies, np.array(values), np.array(variance), names=names, where=where)
    )
    findings = [
        *clipping.about_records(run),
        *equal_channels.about_channels(run),
        *gains,
        *mixed,
        *hammer_findings.about_units(unit, where),
    ]
    findings += [*_about_steps(apart, where), *settling_findings]
    deviations = None
    if steps[0].changes is not None:
        # what the poles of the free vibration err by is common to all responses
        each = np.array([_deviations(group) for group in groups]).transpose(1, 0, 2)[..., None]
        numbers = np.arange(len(each))[:, None, None]
        deviations = Deviations(each, np.broadcast_to(numbers, (len(each), *each.shape[2:])))
        power = np.sum(np.abs(each[..., 0]) ** 2, axis=0)
        common = np.mean(power / np.maximum(variance, np.finfo(float).tiny), axis=1, keepdims=True)
        variance = list(np.array(variance) * np.maximum(common, 1))
    moved = np.array([np.max([step.moved for step in group], axis=0) for group in groups])
    # a response beats about its steady amplitude: what a line is off shows at its neighbours too
    around = np.lib.stride_tricks.sliding_window_view(np.pad(moved, ((2, 2), (0, 0)), mode="edge"), 5, axis=0)
    spread_with_start = np.array(variance) + around.max(axis=2) ** 2
    frfs = FrfSet(
        frequencies=frequencies,
        values=np.array(values)[:, :, None],
        outputs=layout.outputs,
        inputs=layout.inputs,
        quantity=quantity,
        unit=unit,
        variance=spread_with_start[:, :, None],
        deviations=deviations,
        estimator="sine fit",
        condition=run.condition,
        name=run.id,
        findings=tuple(findings),
        provenance=Provenance(steps=("estimate.stepped",)),
    )
    return frfs, Steps(frequencies, np.array(force), np.array(responses))


def _by_frequency(steps: list[Step]) -> list[list[Step]]:
    """Steps in the order of their frequencies, those at one frequency together."""
    groups: list[list[Step]] = []
    for step in sorted(steps, key=lambda step: step.frequency):
        if groups and abs(step.frequency / groups[-1][0].frequency - 1) < 1e-5:
            groups[-1].append(step)
        else:
            groups.append([step])
    return groups


def _about_steps(apart: tuple[float, float], where: str) -> list[Finding]:
    """A finding on steps of one frequency that differ: by how much, at which frequency in Hz."""
    if not apart[0] > LEVEL:
        return []
    return [
        Finding.of(
            "error",
            "records-disagree",
            where,
            "what was measured more than once at {frequency} Hz differs by {difference} % from its mean.",
            apart[0],
            LEVEL,
            advice="Leave out the records that are wrong; steps at another level are a run of their own.",
            frequency=f"{apart[1]:.5g}",
            difference=f"{100 * apart[0]:.0f}",
        )
    ]


def _about_settling(run: Run, change: float, steady: settling.Settled | None) -> list[Finding]:
    """Findings on stays in which a response changed relatively: that free vibration was taken off, or that they had not
    settled.
    """
    where = channels.describe(run)
    if steady is not None:
        size = np.abs(steady.amplitudes[:, 1:, 0])
        left = float(np.max(np.divide(steady.left[:, 1:], size, out=np.zeros_like(size), where=size > 0)))
        if left <= UNSTEADY:
            return _about_free_vibration(where, change, steady)
        change = left
    if change <= UNSTEADY:
        return []
    return [
        Finding.of(
            "warning" if change < UNUSABLE else "error",
            "unsteady",
            where,
            "a response changes by {change} % while the force stays at a frequency: the structure had not settled, and "
            "a joint was not at a steady amplitude.",
            change,
            UNSTEADY,
            advice="Wait longer before recording, or discard the start of the records.",
            change=f"{100 * change:.0f}",
        )
    ]


def _about_free_vibration(where: str, change: float, steady: settling.Settled) -> list[Finding]:
    """A finding where free vibration changed a response clearly, and was taken off."""
    if change <= UNSTEADY:
        return []
    return [
        Finding.of(
            "info",
            "unsteady",
            where,
            "a response changes by {change} % while the force stays at a frequency. Free vibration, most of it at "
            "{frequencies} Hz, was taken off: the FRFs are those of the steady vibration.",
            change,
            UNSTEADY,
            advice="Wait longer before recording where the vibration of a joint has to be steady.",
            change=f"{100 * change:.0f}",
            frequencies=", ".join(f"{frequency:.4g}" for frequency in sorted(steady.poles[:_NAMED].imag / (2 * np.pi))),
        )
    ]
