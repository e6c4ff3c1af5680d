"""What rings after every impact of a hammer test: the modes of the late decay, extrapolated back to the impact.

A joint that slips under the impact sticks again once the vibration has become small, and what follows is the decay of a
linear structure. It is fitted alone (zeroed early time) and extrapolated backwards, as Allen and Mayes do to find
when a response becomes nonlinear (Mechanical Systems and Signal Processing 24, 2010, 2096-2117). Poles are those of all
impacts together, by shift invariance of the signal subspace (Roy and Kailath 1989) and variable projection (Golub and
Pereyra 1973): residual terms of an FRF fit are not needed, since a free decay is a sum of exponentials and no more.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.signal
from jaxtyping import Bool, Complex, Float

from ema.data import Run, damping_ratios, natural_frequencies
from ema.dof import Dof
from ema.errors import InputError
from ema.estimate import channels
from ema.estimate.judge import TOLERATED, Judged, judge_record
from ema.progress import Progress, advance, silent

LATE = 0.4
"""Response, relative to that behind the impact, at which the late decay begins.

Later, noise is amplified by the way back; earlier, a slipping joint still slips. What seems to follow the level of
linear tables reaches 0.023 at 0.4 and 0.040 at 0.3 (:mod:`tests.bench.linearity`, 1 % noise).
"""
LATEST = 0.4
"""Part of a block behind which the late decay begins at the latest, so that enough of it is left."""
_SAMPLES_OF_HIGHEST = 4.0
"""Samples per period of the upper end of the band that are kept."""
_ORDER = 40
"""Poles, with their conjugates, that the subspace of late decays holds at most: twenty modes in a band."""
_COLUMNS = 60
"""Principal components of all decays that are kept: those of the modes and some of noise."""
_ROWS = 160
"""Samples of a window of the subspace: forty periods at the upper end of the band."""
_GAIN = 4.0
"""What a pole has to explain, over what a given pole explains of noise."""
_HEAVIEST = 0.2
"""Damping ratio above which a pole is no mode, as in a fit of FRFs."""
_CONDITION = 1e-3
"""Singular value, over the largest, below which modes are not told apart between the impact and the late decay."""
_FEWEST = 64
"""Samples of a late decay below which it is too short to hold a few modes."""
_ROUNDING = 1e-12
"""Least power of noise over that of the decays: signals without noise are fitted to rounding."""
_BEHIND = 3
"""Samples behind the last contact that still hold the foot of the force, smeared by the filters of the front end."""

_RINGING = 8
"""Samples on both sides of a contact over which the force is faded out, for what an anti-alias filter rings alternates.
Cut off three samples behind it, the transforms of pulses of one to three samples scatter by 2 % with where between the
samples they fall; faded out over 4 samples by 0.04 %, over 8 by 0.015 %. Twice as many only add noise."""
_SILENT = 16
"""Samples behind a drop of the force that are equal to the last bit where a force window has closed. Noise of half a
step of the converter leaves as many equal twice in a thousand times; less noise does so before the impact as well."""
_PRESSING = float(np.sqrt(1 - (1 - 2 * TOLERATED) ** 2))
"""Height over the peak at which a half sine is cut off that has lost what is tolerated of its impulse, 2 %: the loss is
(1 - cos(arcsin h)) / 2. Of a half sine that drops from less, less than a tenth of the contact is missing."""
_LEFT = 2
"""Length of a pulse that was cut off, as often as the hammer may press on behind it. A half sine is above half of its
peak from a sixth of its length on, which is where such windows close: up to twice what they leave is missing."""


@dataclass(frozen=True)
class ImpactDecays:
    """Late decays of all impacts of a run.

    Parameters
    ----------
    poles : of the late decay in the band, rad/s, shape (mode,).
    amplitudes : complex amplitude of every mode in every response at the beginning of the impact, extrapolated from the
        late decay, without what still rang from the impact before; in the unit of the responses, shape (impact, mode,
        out). The decay is ``Re amplitude exp(pole t)``.
    variance : of ``amplitudes`` by noise (real and imaginary part together), same shape.
    forces : Laplace transform of the force of each impact at the poles, N s, shape (impact, mode): a linear structure
        answers with amplitudes that are proportional to them.
    peaks : N, shape (impact,).
    cut : whether a force window closed while the hammer still pressed, shape (impact,): ``forces`` is not the force on
        the structure then.
    inputs : DOF of each impact; ``outputs`` those of the responses.
    behind : the same amplitudes read between the impact and the late decay, extrapolated back as well, with their
        ``behind_variance``. In a linear structure they differ from ``amplitudes`` by what other modes leave in them,
        and that in the same proportion for every impact on a point.
    gaps : s from the beginning of each impact to that of its free decay, shape (impact,).
    again : largest further contact of each impact over its first, shape (impact,): the impact gives its modes other
        proportions than one of a single contact.
    deviation : std of natural frequency [Hz] and damping ratio by noise, shape (mode, 2).
    begins : s after the impact at which the late decay begins (median).
    """

    poles: Complex[np.ndarray, "mode"]
    amplitudes: Complex[np.ndarray, "impact mode out"]
    variance: Float[np.ndarray, "impact mode out"]
    forces: Complex[np.ndarray, "impact mode"]
    peaks: Float[np.ndarray, "impact"]
    cut: Bool[np.ndarray, "impact"]
    inputs: tuple[Dof, ...]
    outputs: tuple[Dof, ...]
    behind: Complex[np.ndarray, "impact mode out"]
    behind_variance: Float[np.ndarray, "impact mode out"]
    gaps: Float[np.ndarray, "impact"]
    again: Float[np.ndarray, "impact"]
    deviation: Float[np.ndarray, "mode 2"]
    begins: float

    @property
    def natural_frequencies(self) -> Float[np.ndarray, "mode"]:
        """Hz."""
        return natural_frequencies(self.poles)

    @property
    def damping_ratios(self) -> Float[np.ndarray, "mode"]:
        """Fractions of critical damping."""
        return damping_ratios(self.poles)


@dataclass(frozen=True)
class ImpactBlock:
    """Responses behind one impact (out, sample) at the reduced rate, and the force of its contacts.

    ``record`` is the number of its record; ``start``, ``ring`` and ``first`` are the samples of the record at which the
    impact, the free decay and ``force`` begin. ``cut`` says whether a force window closed within a contact.
    """

    record: int
    impact: Judged
    outputs: tuple[Dof, ...]
    ring: int
    first: int
    force: Float[np.ndarray, "contact"]
    decay: Float[np.ndarray, "out sample"]
    cut: bool


@dataclass(frozen=True)
class FreeDecays:
    """The free decays behind the usable impacts of a run.

    Parameters
    ----------
    blocks : one for each impact; none where the records differ in responses or sampling rate.
    step : samples of the records between those that are kept.
    sampling_rate : of the records, Hz.
    """

    blocks: tuple[ImpactBlock, ...]
    step: int
    sampling_rate: float

    @property
    def rate(self) -> float:
        """Of the samples that are kept, Hz."""
        return self.sampling_rate / self.step


@dataclass(frozen=True)
class LatePart:
    """Early and late parts of all blocks (impact, out, sample) at ``rate`` Hz, and the rms noise of each response."""

    signals: Float[np.ndarray, "impact out sample"]
    early: Float[np.ndarray, "impact out before"]
    rate: float
    noise: Float[np.ndarray, "out"]

    @property
    def first(self) -> int:
        """Samples between the impact and the late part."""
        return int(self.early.shape[-1])


def impact_decays(
    run: Run, band: tuple[float, float], later: float = LATE, progress: Progress = silent
) -> ImpactDecays | None:
    """Fit the late decays of a hammer test.

    Parameters
    ----------
    run : a hammer test with its records, as for :func:`ema.estimate.hammer_test`.
    band : Hz, of the modes.
    later : response, relative to that behind the impact, at which the late decay begins.

    Returns
    -------
    ImpactDecays or None
        ``None`` where no decay is long enough, or the records differ in responses or sampling rate.

    Raises
    ------
    InputError : a record cannot be used.

    Examples
    --------
    >>> import numpy as np
    >>> from ema.data import Channel, Condition, Excitation, ModalModel, Run, poles_from
    >>> from ema.simulate import RovingHammer, VirtualRig
    >>> at, poles = Dof(1, "+Z"), poles_from(np.array([300.0]), np.array([0.01]))
    >>> model = ModalModel(poles, np.ones((1, 1)), (at,), 1 / (2j * poles.imag)[None], (at,), scaling="unit modal mass")
    >>> acceleration = Channel("acc", at, quantity="acceleration", unit="m/s^2")
    >>> rig = VirtualRig(model, RovingHammer((at,)), (acceleration,), 4096.0, noise={"acceleration": 0.01})
    >>> run = Run("beam", Condition(Excitation(kind="hammer")), tuple(rig.takes()))
    >>> decays = impact_decays(run, (200.0, 500.0))
    >>> [round(float(x), 1) for x in np.abs(decays.poles) / (2 * np.pi)]
    [300.0]
    """
    return late_decays(free_decays(run, band, progress), band, later)


def late_decays(free: FreeDecays, band: tuple[float, float], later: float) -> ImpactDecays | None:
    """As :func:`impact_decays`, of free decays that were cut from their records before."""
    if not free.blocks:
        return None
    late = late_part(free.blocks, free.rate, later)
    if late is None:
        return None
    poles = late_poles(late.signals, late.rate, late.noise)
    frequency = np.abs(poles) / (2 * np.pi)
    poles = poles[(frequency >= band[0]) & (frequency <= band[1]) & (-poles.real < _HEAVIEST * np.abs(poles))]
    if not len(poles):
        return None
    return _extrapolated(free.blocks, late, poles, free.step)


def free_decays(run: Run, band: tuple[float, float], progress: Progress = silent) -> FreeDecays:
    """Cut the free decay behind every impact from the records, at a rate that the band needs.

    Raises
    ------
    InputError : a record cannot be used, or there is no band within half the sampling rate.
    """
    records = channels.recordings_of(run)
    rate = records[0].sampling_rate
    low, high = band
    if not 0 <= low < min(high, 0.5 * rate):
        raise InputError(
            "no band within half the sampling rate",
            where=channels.describe(run),
            got=f"{low:g} to {high:g} Hz",
            expected=f"a band from 0 Hz up to {0.5 * rate:g} Hz",
        )
    reduced = 1.5 * high < 0.4 * rate
    step = max(int(rate // (_SAMPLES_OF_HIGHEST * high)), 1) if reduced else 1
    # Causal filters: they add poles of their own to a free decay, which die within a few periods, and nothing else.
    stages = [scipy.signal.butter(2, 0.5 * max(low, 1e-6 * rate), "high", fs=rate, output="sos")]
    if reduced:
        stages.append(scipy.signal.butter(4, 1.5 * high, "low", fs=rate, output="sos"))
    filters = np.vstack(stages)
    blocks: list[ImpactBlock] = []
    for number, record in enumerate(records):
        where = channels.describe(run, record)
        layout = channels.layout(record, where)
        channels.finite(record, layout, where)
        if record.sampling_rate != rate or (blocks and layout.outputs != blocks[0].outputs):
            return FreeDecays((), step, rate)
        impacts = judge_record(record, layout, number, None)
        signals = np.asarray(record.signals[list(layout.responses)], dtype=np.float64)
        rest = impacts[0].rest if impacts else signals.mean(axis=1)
        signals = scipy.signal.sosfilt(filters, signals - rest[:, None], axis=1)
        force = np.asarray(record.signals[layout.references[0]], dtype=np.float64)
        for impact in impacts:
            blocks.append(_block(number, impact, layout, force, signals, step))
        advance(progress, "late decays", number + 1, len(records))
    if not blocks:
        return FreeDecays((), step, rate)
    lengths = np.array([block.decay.shape[1] for block in blocks])
    usable = [block for block in blocks if not block.impact.asked and not _overloaded(block.impact)]
    long = tuple(block for block in usable if block.decay.shape[1] >= 0.5 * np.median(lengths))
    return FreeDecays(long, step, rate)


def _overloaded(impact: Judged) -> bool:
    return any(reason.code in ("overload", "pre-trigger") and impact.error > 0 for reason in impact.reasons)


def _block(
    record: int,
    impact: Judged,
    layout: channels.Layout,
    force: Float[np.ndarray, "sample"],
    signals: Float[np.ndarray, "out sample"],
    step: int,
) -> ImpactBlock:
    contacts = [(impact.pulse.start, impact.pulse.stop), *((one.first, one.last) for one in impact.contacts)]
    first, last = min(first for first, _ in contacts), max(last for _, last in contacts)
    part = slice(max(first - _RINGING, 0), min(last + _RINGING + 1, len(force)))
    samples = np.arange(part.start, part.stop)
    # samples between each sample and the nearest contact
    away = np.min([np.maximum(np.maximum(one - samples, samples - other), 0) for one, other in contacts], axis=0)
    touching = np.cos(0.5 * np.pi * np.clip((away - 1) / _RINGING, 0.0, 1.0)) ** 2
    cut = _cut_off(force, impact, first, last)
    ring = last + _BEHIND + (_LEFT * (impact.pulse.stop - impact.pulse.start) if cut else 0)
    return ImpactBlock(
        record,
        impact,
        layout.outputs,
        ring,
        part.start,
        touching * (force[part] - impact.offset),
        signals[:, ring : impact.start + impact.after : step],
        cut,
    )


def _cut_off(force: Float[np.ndarray, "sample"], impact: Judged, first: int, last: int) -> bool:
    """Whether a force window closes between the samples ``first`` and ``last`` while the hammer still presses.

    The force drops and is constant to the last bit behind, where noise or what a filter rings was before the impact.
    Short pulses drop as steeply: a force without any noise does not tell one from the other, and counts as whole.
    """
    begin = max(first - _SILENT, 0)
    if first == begin or not np.ptp(force[begin:first]):
        return False
    steps = np.diff(force[first : last + _BEHIND + _SILENT])
    if len(steps) < _SILENT:
        return False
    behind = np.lib.stride_tricks.sliding_window_view(steps == 0, _SILENT - 1)[1:]
    drops = -np.sign(impact.pulse.peak) * steps[: len(behind)] / abs(impact.pulse.peak)
    return bool(np.any(drops[behind.all(axis=1)] > _PRESSING))


def late_part(blocks: Sequence[ImpactBlock], rate: float, later: float) -> LatePart | None:
    """The late parts; ``None`` where they are too short for a few modes."""
    length = min(block.decay.shape[1] for block in blocks)
    if length < _FEWEST:
        return None
    decays = np.array([block.decay[:, :length] for block in blocks])
    first = _begin_of_late(decays, later)
    signals = decays[..., first:]
    count = signals.shape[-1]
    if count < _FEWEST or first < _FEWEST // 8:
        return None
    rich = _subspace_poles(signals, rate, _ORDER)
    freedom = count - 2 * len(rich)
    if freedom < count // 4:
        return None
    power = np.mean(signals**2, axis=(0, 2))
    if not power.max() > 0:
        return None
    noise = np.sqrt(
        np.mean(_residual(signals, rich, rate) ** 2, axis=(0, 2)) * count / freedom + _ROUNDING * power.max()
    )
    return LatePart(signals, decays[..., :first], rate, noise)


def _begin_of_late(decays: Float[np.ndarray, "impact out sample"], later: float) -> int:
    """Sample at which the rms over all responses has fallen to ``later`` of that behind the impacts."""
    count = decays.shape[-1]
    width = max(count // 40, 8)
    power = np.convolve(np.mean(decays**2, axis=(0, 1)), np.ones(width) / width, "same")
    below = np.flatnonzero(power[width:] < later**2 * power[width : 3 * width].max())
    return int(min(int(below[0]) + width if len(below) else count, int(LATEST * count)))


def late_poles(
    signals: Float[np.ndarray, "impact out sample"], rate: float, noise: Float[np.ndarray, "out"]
) -> Complex[np.ndarray, "mode"]:
    """Poles in rad/s, positive imaginary part, of free decays at ``rate`` Hz with white ``noise`` (rms).

    A pole stays where it explains more than four times what it would of noise.
    """
    compressed = _compressed(signals / noise[:, None], _COLUMNS)
    poles = _subspace_poles(signals / noise[:, None], rate, _ORDER)
    least = _GAIN * 2 * signals.shape[0] * signals.shape[1]
    while len(poles) > 1:
        gains = _gains(compressed, poles, rate)
        if gains.min() >= least:
            break
        poles = np.delete(poles, int(gains.argmin()))
    return _refined(compressed, poles, rate)


def _compressed(signals: Float[np.ndarray, "impact out sample"], columns: int) -> Float[np.ndarray, "sample column"]:
    """Leading principal components of all signals: linear decays of n modes span 2n of them."""
    table = signals.reshape(-1, signals.shape[-1]).T
    if table.shape[1] <= columns:
        return table
    _, vectors = np.linalg.eigh(table.T @ table)
    return np.asarray(table @ vectors[:, ::-1][:, :columns])


def _subspace_poles(
    signals: Float[np.ndarray, "impact out sample"], rate: float, order: int
) -> Complex[np.ndarray, "pole"]:
    """Decaying poles of the leading ``order`` directions of all windows of the signals, which a shift preserves."""
    compressed = _compressed(signals, _ORDER)
    rows = min(len(compressed) // 3, _ROWS)
    windows = np.lib.stride_tricks.sliding_window_view(compressed, rows, axis=0).reshape(-1, rows)
    vectors = np.linalg.eigh(windows.T @ windows)[1][:, ::-1][:, : min(order, rows - 1)]
    # V_up = V_down A: a shift by one sample multiplies every exponential by exp(p / rate) (Roy and Kailath 1989)
    values = np.linalg.eigvals(np.linalg.lstsq(vectors[:-1], vectors[1:], rcond=None)[0])
    poles = np.log(values.astype(complex)) * rate
    poles = poles[(poles.imag > 0) & (poles.imag < 0.98 * np.pi * rate) & (poles.real < 0)]
    return np.asarray(poles[np.argsort(poles.imag)])


def _basis(poles: Complex[np.ndarray, "mode"], samples: int, rate: float) -> Float[np.ndarray, "sample column"]:
    """Real and negative imaginary parts of the exponentials: Re a exp(p t) is a sum of both."""
    waves = np.exp(np.outer(np.arange(samples) / rate, poles))
    return np.hstack([waves.real, -waves.imag])


def _residual(
    signals: Float[np.ndarray, "impact out sample"], poles: Complex[np.ndarray, "pole"], rate: float
) -> Float[np.ndarray, "impact out sample"]:
    q = np.linalg.qr(_basis(poles, signals.shape[-1], rate))[0]
    return np.asarray(signals - (signals @ q) @ q.T)


def _explained(
    compressed: Float[np.ndarray, "sample column"], poles: Complex[np.ndarray, "pole"], rate: float
) -> float:
    q = np.linalg.qr(_basis(poles, len(compressed), rate))[0]
    return float(np.sum((q.T @ compressed) ** 2))


def _gains(
    compressed: Float[np.ndarray, "sample column"], poles: Complex[np.ndarray, "pole"], rate: float
) -> Float[np.ndarray, "pole"]:
    """What each pole alone explains: with its amplitudes x and the part C of the inverse normal matrix that belongs to
    them, leaving it out costs x^T C^-1 x."""
    q, triangle = np.linalg.qr(_basis(poles, len(compressed), rate))
    inverse = np.linalg.pinv(triangle)
    amplitudes, covariance = inverse @ (q.T @ compressed), inverse @ inverse.T
    count, found = len(poles), []
    for one in range(count):
        rows = [one, count + one]
        own = amplitudes[rows]
        found.append(float(np.sum(own * (np.linalg.pinv(covariance[np.ix_(rows, rows)]) @ own))))
    return np.array(found)


def _refined(
    compressed: Float[np.ndarray, "sample column"], poles: Complex[np.ndarray, "mode"], rate: float, steps: int = 10
) -> Complex[np.ndarray, "mode"]:
    """Least squares over the poles, the amplitudes eliminated (Golub and Pereyra 1973, Kaufman's approximation)."""
    damping, count = 1e-3, len(poles)
    for _ in range(steps):
        jacobian, left = _jacobian(compressed, poles, rate)
        cost = float(np.sum(left**2))
        normal, gradient = jacobian.T @ jacobian, jacobian.T @ left.ravel()
        moved, now = None, cost
        for _ in range(8):
            # Levenberg and Marquardt, damped by the diagonal of the normal matrix
            step = np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-300), gradient)
            trial = poles + step[:count] + 1j * step[count:]
            if np.all(trial.real < 0) and np.all(trial.imag > 0):
                now = float(np.sum(compressed**2)) - _explained(compressed, trial, rate)
                if now < cost:
                    moved = trial
                    break
            damping *= 10
        if moved is None:
            break
        poles, damping = moved, max(damping / 10, 1e-9)
        if cost - now < 1e-7 * cost:
            break
    return poles[np.argsort(np.abs(poles))]


def _jacobian(
    compressed: Float[np.ndarray, "sample column"], poles: Complex[np.ndarray, "mode"], rate: float
) -> tuple[Float[np.ndarray, "equation unknown"], Float[np.ndarray, "sample column"]]:
    """Change of the model with the real, then the imaginary parts of the poles; and the residual."""
    count, times = len(poles), np.arange(len(compressed)) / rate
    basis = _basis(poles, len(compressed), rate)
    q, triangle = np.linalg.qr(basis)
    solved = np.linalg.lstsq(triangle, q.T @ compressed, rcond=None)[0]
    amplitudes = solved[:count] + 1j * solved[count:]
    columns = []
    for factor in (1.0, 1j):
        for pole, amplitude in zip(poles, amplitudes):
            # d/dp of Re a exp(p t) is Re a t exp(p t); Kaufman: of it only what the amplitudes cannot take up
            change = np.real(factor * np.outer(times * np.exp(pole * times), amplitude))
            columns.append((change - q @ (q.T @ change)).ravel())
    return np.array(columns).T, compressed - basis @ solved


def _extrapolated(
    blocks: Sequence[ImpactBlock], late: LatePart, poles: Complex[np.ndarray, "mode"], step: int
) -> ImpactDecays:
    """Amplitudes of the late decays, taken back to the beginning of the impacts."""
    rate = late.rate
    original = rate * step
    seen, spread = _amplitudes(late.signals, poles, late)
    early, early_spread = _amplitudes(late.early, poles, late, _CONDITION)
    gaps = np.array([(block.ring - block.impact.start) / original for block in blocks])
    begins = gaps + late.first / rate
    back, shorter = (np.exp(-np.outer(delay, poles))[:, :, None] for delay in (begins, gaps))
    amplitudes = seen * back
    forces = np.empty((len(blocks), len(poles)), complex)
    ringing = np.zeros_like(amplitudes)
    for number, block in enumerate(blocks):
        times = (np.arange(len(block.force)) + block.first - block.impact.start) / original
        forces[number] = np.exp(-np.outer(poles, times)) @ block.force / original
        before = blocks[number - 1]
        if number and before.record == block.record:
            since = (block.impact.start - before.impact.start) / original
            ringing[number] = amplitudes[number - 1] * np.exp(poles * since)[:, None]
    return ImpactDecays(
        poles=poles,
        amplitudes=amplitudes - ringing,
        variance=np.abs(back) ** 2 * spread,
        forces=forces,
        peaks=np.array([_peak(block.force) for block in blocks]),
        cut=np.array([block.cut for block in blocks]),
        inputs=tuple(block.impact.dof for block in blocks),
        outputs=blocks[0].outputs,
        behind=early * shorter - ringing,
        behind_variance=np.abs(shorter) ** 2 * early_spread,
        gaps=gaps,
        again=np.array([max((one.ratio for one in block.impact.contacts), default=0.0) for block in blocks]),
        deviation=_deviation(late, poles),
        begins=float(np.median(begins)),
    )


def _peak(force: Float[np.ndarray, "sample"]) -> float:
    """Largest force between the samples, band-limited.

    The highest of a contact of three samples misses up to a tenth, by when it fell: that would pass for a level.
    """
    size = 4 * len(force)
    fine = np.fft.irfft(np.fft.rfft(force, size), _FINER * size) * _FINER
    return float(np.abs(fine).max())


_FINER = 16
"""Points per sample at which a pulse is read between its samples: half a point off, the peak of a half sine of two
samples is missed by 0.1 %."""


def _amplitudes(
    signals: Float[np.ndarray, "impact out sample"],
    poles: Complex[np.ndarray, "mode"],
    late: LatePart,
    condition: float = 1e-12,
) -> tuple[Complex[np.ndarray, "impact mode out"], Float[np.ndarray, "mode out"]]:
    """Amplitudes of known poles at the first sample by least squares, and their variance by noise."""
    count = len(poles)
    inverse = np.linalg.pinv(_basis(poles, signals.shape[-1], late.rate), rcond=condition)
    solved = signals @ inverse.T
    power = np.sum(inverse**2, axis=1)
    seen = np.swapaxes(solved[..., :count] + 1j * solved[..., count:], 1, 2)
    return seen, (power[:count] + power[count:])[:, None] * late.noise**2


def _deviation(late: LatePart, poles: Complex[np.ndarray, "mode"]) -> Float[np.ndarray, "mode 2"]:
    """Std of natural frequency [Hz] and damping ratio: the inverse of the normal matrix of the poles, noise being 1."""
    jacobian, _ = _jacobian(_compressed(late.signals / late.noise[:, None], _COLUMNS), poles, late.rate)
    covariance = np.linalg.pinv(jacobian.T @ jacobian)
    variance = np.diag(covariance)
    real, imaginary = variance[: len(poles)], variance[len(poles) :]
    size = np.abs(poles)
    # |p| follows the imaginary part, zeta = -Re p / |p| the real part, up to zeta^2.
    return np.asarray(np.sqrt(np.maximum(np.column_stack([imaginary / (2 * np.pi) ** 2, real / size**2]), 0.0)))
