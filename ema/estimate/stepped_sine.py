"""FRFs of a stepped sine: frequency after frequency, read by least squares of a sine and its harmonics."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Complex, Float

from ema.data import Finding, FrfSet, Provenance, Recording, Run
from ema.errors import InputError
from ema.estimate import channels, hammer_findings
from ema.progress import Progress, advance, silent

HARMONICS = 5
"""Highest harmonic that is told apart from noise."""
UNSTEADY = 0.02
"""Change of a response between the halves of a record above which it was not settled."""
_FEWEST_CYCLES = 4.0
"""Cycles of the force below which its frequency and harmonics are not read."""
_CLEAR = 5.0
"""Standard deviations of noise that a change between the halves of a record has to exceed."""


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
    steps: list[tuple[float, np.ndarray, np.ndarray]] = []
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
            unsteady = max(unsteady, _change(signals, frequency, rate))
            steps.append((frequency, amplitudes, noise))
        advance(progress, "reading steps", place + 1, len(records))
    assert layout is not None and first is not None
    return _joined(run, first, layout, steps, unsteady)


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


def _change(signals: Float[np.ndarray, "channel sample"], frequency: float, rate: float) -> float:
    """Largest relative change of the amplitude of a response from the first to the second half of a record."""
    half = signals.shape[1] // 2
    if frequency * half / rate < _FEWEST_CYCLES / 2:
        return 0.0
    before, noise = _orders(signals[1:, :half], frequency, rate)
    after, more = _orders(signals[1:, half:], frequency, rate)
    size, change = np.abs(before[:, 0]), np.abs(np.abs(after[:, 0]) - np.abs(before[:, 0]))
    clear = change > _CLEAR * np.sqrt(noise + more)
    return float(np.max(change[clear] / size[clear])) if clear.any() else 0.0


def _joined(
    run: Run,
    first: Recording,
    layout: channels.Layout,
    steps: list[tuple[float, np.ndarray, np.ndarray]],
    unsteady: float,
) -> tuple[FrfSet, Steps]:
    """All steps in the order of their frequencies; those at one frequency averaged over the force."""
    where = channels.describe(run)
    steps = sorted(steps, key=lambda step: step[0])
    groups: list[list[tuple[float, np.ndarray, np.ndarray]]] = []
    for step in steps:
        if groups and abs(step[0] / groups[-1][0][0] - 1) < 1e-5:
            groups[-1].append(step)
        else:
            groups.append([step])
    frequencies = np.array([np.mean([step[0] for step in group]) for group in groups])
    values, variance, force, responses = [], [], [], []
    for group in groups:
        ratios = np.array([step[1][1:, 0] / step[1][0, 0] for step in group])
        powers = [
            (step[2][1:] + np.abs(ratio) ** 2 * step[2][0]) / np.abs(step[1][0, 0]) ** 2
            for step, ratio in zip(group, ratios, strict=True)
        ]
        values.append(ratios.mean(axis=0))
        variance.append(np.mean(powers, axis=0) / len(group))
        force.append(np.mean([np.abs(step[1][0, 0]) for step in group]))
        responses.append(group[0][1][1:])
    quantity, unit = channels.frf_quantity(
        [first.channels[row] for row in first.with_role("response")],
        [first.channels[row] for row in first.with_role("reference")],
        where,
    )
    findings = list(hammer_findings.about_units(unit, where))
    if unsteady > UNSTEADY:
        findings.append(
            Finding(
                "warning",
                "unsteady",
                where,
                f"a response changes by {100 * unsteady:.0f} % within a record: the "
                "structure had not settled, and a joint was not at a steady amplitude.",
                unsteady,
                UNSTEADY,
                "Wait longer before recording, or discard the start of the records.",
            )
        )
    frfs = FrfSet(
        frequencies=frequencies,
        values=np.array(values)[:, :, None],
        outputs=layout.outputs,
        inputs=layout.inputs,
        quantity=quantity,
        unit=unit,
        variance=np.array(variance)[:, :, None],
        estimator="sine fit",
        condition=run.condition,
        name=run.id,
        findings=tuple(findings),
        provenance=Provenance(steps=("estimate.stepped",)),
    )
    return frfs, Steps(frequencies, np.array(force), np.array(responses))
