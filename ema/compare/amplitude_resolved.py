"""Amplitude-resolved hammer modal analysis: frequency, damping and shape of modes over amplitude, from ring-downs.

Every impact of a hammer test on a structure with a friction joint rings through a range of amplitudes. Its modal
coordinates (:mod:`ema.compare.modal_decays`) are pooled over impacts and points at stated amplitudes. A joint that
slips couples the modes; what the others do to one is kept out twice: values rest on the impacts in which the others are
weakest, and what still changes with the time since the impact, at one amplitude, is extrapolated to late times.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from ema.compare.modal_decays import HOP, ModalDecays, modal_decays
from ema.compare.modal_mass import Mass, modal_mass
from ema.compare.slip_onset import Onset, slip_onset
from ema.data import AmplitudeDependentMode, Band, Finding, Provenance, Run
from ema.data.modal import COVERAGE_FACTOR
from ema.progress import Progress, silent
from ema.units import SI_UNIT

BEYOND_NOISE = 15.0
"""Amplitude over its standard deviation by noise from which on a window is used."""
RATIO = 1.15
"""Ratio of neighbouring amplitudes at which a mode is stated, and width of the range that is pooled there."""
FEWEST = 6
"""Impacts below which a mode is not stated at an amplitude: twice the coefficients of the regression."""
PURE = 0.25
"""Share of the windows at an amplitude, those with the weakest other modes, that its values rest on."""
ENOUGH = 12
"""Impacts that they rest on where there are so many, though they be more than that share."""
CLEAR = 3.0
"""Change with the time since the impact, over its standard deviation, from which on it is extrapolated."""
AS_FAR = 2.0
"""Ratio of the latest to the first time from which on it is extrapolated: over 1/t no further than the times reach.
Where they do not, the interval contains all of it."""
OUTLIER = 4.0
"""Distance from a fit over its standard deviation, by the median, to which values farther away are drawn in."""
WEAKER = 1.0
"""Displacement of all other modes over that of the mode, squared, up to which an amplitude is the mode's own."""
_HEAVIEST = 0.2
"""Damping ratio, and distance from the late frequency, beyond which a window shows no mode of the structure."""
_CLIPS = 4
FILTER = 1.0
"""Part of what the high-pass may add to a free decay that intervals contain."""
_SPREAD = 20.0
"""Square of the length of a window over the variance of time under the weights that give its slope, 1 - u^2."""
CONTAINS = (
    "noise, scatter of single impacts, what other modes change, what changes with the time since the impact, the "
    "change of amplitude within a window, and what filters leave"
)


@dataclass(frozen=True)
class RingDownMode:
    """A mode over its amplitude, from the ring-downs of a hammer test.

    Parameters
    ----------
    mode : AmplitudeDependentMode
        Frequency and damping at the stated amplitudes; its modal mass is NaN where it is withheld.
    onset : Onset
        Limits of small amplitudes, and where slip begins, in the unit of ``mode``.
    reached : tuple of (float, float, float)
        Smallest, median and largest amplitude behind the impacts, in the unit of ``mode``.
    mass : Mass
        Modal mass for a shape of 1 at the response, or why it is withheld.

    Examples
    --------
    >>> "onset" in RingDownMode.__dataclass_fields__
    True
    """

    mode: AmplitudeDependentMode
    onset: Onset
    reached: tuple[float, float, float]
    mass: Mass


def ring_down_modes(run: Run, band: tuple[float, float], progress: Progress = silent) -> tuple[RingDownMode, ...]:
    """Estimate every mode of a hammer test over its amplitude, by the free decays of all impacts and channels together.

    Parameters
    ----------
    run : Run
        A hammer test with its records; several impacts on many points, or of several levels.
    band : tuple of (float, float)
        Ends of the band of the modes [Hz].
    progress : Progress, optional
        Called as the records are read.

    Returns
    -------
    tuple of RingDownMode
        One for each mode of the late decay in the band, lowest first, that enough impacts show; empty where no decay is
        long enough. Shapes are those at the responses, each read by itself. Amplitudes are those at the response at
        which the mode is largest.

    Raises
    ------
    InputError
        If a record cannot be used.

    References
    ----------
    .. [1] Modal filter and analytic signal: Roettgen and Allen (2017), Mechanical Systems and Signal Processing 84:152.
    .. [2] Damping of a decaying nonlinear mode: Krack (2015), Computers & Structures 154:59.

    Examples
    --------
    >>> from ema.data import Channel, Condition, Excitation, ModalModel, poles_from
    >>> from ema.dof import Dof
    >>> from ema.simulate import RovingHammer, VirtualRig
    >>> at, poles = Dof(1, "+Z"), poles_from(np.array([300.0]), np.array([0.01]))
    >>> model = ModalModel(poles, np.ones((1, 1)), (at,), 1 / (2j * poles.imag)[None], (at,), scaling="unit modal mass")
    >>> acceleration = Channel("acc", at, quantity="acceleration", unit="m/s^2")
    >>> rig = VirtualRig(model, RovingHammer((at,) * 4), (acceleration,), 4096.0, noise={"acceleration": 0.01})
    >>> found = ring_down_modes(Run("beam", Condition(Excitation(kind="hammer")), tuple(rig.takes())), (200.0, 500.0))
    >>> [(round(float(one.onset.frequency.value), 1), one.onset.seen) for one in found]
    [(300.0, False)]
    """
    decays = modal_decays(run, band, progress)
    if decays is None:
        return ()
    record = run.recordings[0]
    kinds = {record.channels[row].quantity for row in record.with_role("response")}
    if len(kinds) != 1 or (kind := kinds.pop()) not in SI_UNIT:
        return ()
    frequencies = np.abs(decays.poles) / (2 * np.pi)
    inside = np.flatnonzero((frequencies >= band[0]) & (frequencies <= band[1]))
    modes: list[RingDownMode] = []
    for number, mode in enumerate(inside, 1):
        read = _mode(decays, int(mode), kind, band[0])
        if read is not None:
            named = replace(read.mode, name=f"{run.id}, mode {number}", condition=run.condition)
            modes.append(
                replace(read, mode=replace(named, findings=findings(replace(read, mode=named), decays, int(mode))))
            )
    return tuple(modes)


@dataclass(frozen=True)
class _Pool:
    """Windows of one mode: amplitude, frequency [Hz], damping ratio, time [s], number of the impact, and squared
    displacement of all other modes over that of the mode; shape at the responses (window, out), 1 at the reference."""

    amplitude: Float[np.ndarray, "window"]
    frequency: Float[np.ndarray, "window"]
    damping: Float[np.ndarray, "window"]
    time: Float[np.ndarray, "window"]
    impact: Int[np.ndarray, "window"]
    others: Float[np.ndarray, "window"]
    shape: Complex[np.ndarray, "window out"]

    def at(self, rows: Int[np.ndarray, "chosen"] | Bool[np.ndarray, "window"]) -> "_Pool":
        """The windows in ``rows``."""
        return _Pool(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


@dataclass(frozen=True)
class _Level:
    """Frequency and damping at an amplitude: values, std, half of the 95 % intervals, slopes over ln amplitude; squared
    displacement of other modes, and time of the first window [s]; the windows that the values rest on, and all."""

    amplitude: float
    value: Float[np.ndarray, "2"]
    std: Float[np.ndarray, "2"]
    half: Float[np.ndarray, "2"]
    slope: Float[np.ndarray, "2"]
    others: float
    first: float
    pure: _Pool
    near: _Pool


def _pool(decays: ModalDecays, mode: int) -> _Pool:
    """All usable windows behind the first one, in which the impact has not died away in modes above the band."""
    size, poles = np.abs(decays.amplitudes[:, 1:]), decays.local[:, 1:, mode]
    frequency = np.abs(poles) / (2 * np.pi)
    damping = -poles.real / np.abs(poles)
    late = np.abs(decays.poles[mode]) / (2 * np.pi)
    moved = size * np.linalg.norm(decays.shapes, axis=1) / np.abs(decays.poles) ** 2
    others = np.sum(np.delete(moved, mode, axis=2) ** 2, axis=2) / np.maximum(moved[:, :, mode], 1e-300) ** 2
    usable = size[:, :, mode] > BEYOND_NOISE * decays.deviation[mode]
    usable &= (np.abs(frequency / late - 1) < _HEAVIEST) & (np.abs(damping) < _HEAVIEST)
    impacts = np.broadcast_to(np.arange(len(size))[:, None], usable.shape)
    at = decays.channels[:, 1:, mode]
    reference = at[:, :, decays.reference[mode]]
    shapes = at / np.where(reference == 0, np.inf, reference)[:, :, None]
    values = (size[:, :, mode], frequency, damping, decays.times[:, 1:], impacts, others, shapes)
    return _Pool(*(one[usable] for one in values))


def _mode(decays: ModalDecays, mode: int, kind: str, low: float) -> RingDownMode | None:
    """One mode over its amplitude; ``None`` where no amplitude is passed by enough impacts."""
    pool = _pool(decays, mode)
    if not len(pool.amplitude):
        return None
    first, last = float(pool.amplitude.min()), float(pool.amplitude.max())
    grid = first * RATIO ** (0.5 + np.arange(int(np.log(last / first) / np.log(RATIO))))
    read = [level for amplitude in grid if (level := _level(pool, float(amplitude))) is not None]
    late = np.array([np.abs(decays.poles[mode]) / (2 * np.pi), -decays.poles[mode].real / np.abs(decays.poles[mode])])
    read = _own(read, late)
    if not read:
        return None
    read = [_filtered(one, low) for one in _smeared(read, _length(decays))]
    amplitude = np.array([one.amplitude for one in read])
    value, half = np.array([one.value for one in read]).T, np.array([one.half for one in read]).T
    # -a'/a = zeta w / (1 + (1/2) d ln w / d ln a): energy of a mode whose frequency follows its amplitude (Krack 2015)
    gain = 1 + 0.5 * np.array([one.slope[0] / one.value[0] for one in read])
    value[1], half[1] = value[1] * gain, half[1] * gain
    # the whole interval: where the others move a joint as well, it slips before the mode alone would make it
    onset = slip_onset(amplitude, value[0], half[0] / COVERAGE_FACTOR, value[1], half[1] / COVERAGE_FACTOR)
    bands = [Band(one - reach, one, one + reach, 0.95, CONTAINS) for one, reach in zip(value, half, strict=True)]
    start = np.abs(decays.amplitudes[:, 0, mode])
    mass = modal_mass(decays, mode, (amplitude, value[0], value[1]), onset, kind)
    shapes, reaches = (np.array(part).T for part in zip(*(_shape(one) for one in read), strict=True))
    resolved = AmplitudeDependentMode(
        amplitude=amplitude,
        frequency=bands[0],
        damping=bands[1],
        quantity=kind,  # type: ignore[arg-type]
        modal_mass=mass.value,
        provenance=Provenance(steps=("ring_down_modes",)),
        dofs=decays.outputs,
        shape=shapes,
        shape_half=reaches,
    )
    return RingDownMode(resolved, onset, (float(start.min()), float(np.median(start)), float(start.max())), mass)


def _length(decays: ModalDecays) -> float:
    """Length of a window in s."""
    return float((decays.times[0, 1] - decays.times[0, 0]) / HOP)


def _level(pool: _Pool, amplitude: float) -> _Level | None:
    """The mode at an amplitude; ``None`` where too few impacts pass it, or none of them twice."""
    near = pool.at(np.abs(np.log(pool.amplitude / amplitude)) <= 0.5 * np.log(RATIO))
    if len(np.unique(near.impact)) < FEWEST:
        return None
    order = np.argsort(near.others, kind="stable")
    new = np.zeros(len(order), np.bool_)
    new[np.unique(near.impact[order], return_index=True)[1]] = True
    impacts = np.cumsum(new)
    enough = int(np.searchsorted(impacts, min(ENOUGH, impacts[-1]))) + 1
    pure = near.at(order[: max(int(PURE * len(order)), enough)])
    if np.ptp(pure.time) == 0:
        return None
    read = [
        _read((pure, pure.frequency), (near, near.frequency), amplitude),
        _read((pure, pure.damping), (near, near.damping), amplitude),
    ]
    value, std, half, slope = (np.array(column) for column in zip(*read, strict=True))
    others, first = float(np.median(pure.others)), float(pure.time.min())
    return _Level(amplitude, value, std, half, slope, others, first, pure, near)


def _shape(level: _Level) -> tuple[Complex[np.ndarray, "out"], Float[np.ndarray, "out"]]:
    """Shape at an amplitude, and half widths of the 95 % intervals of real and imaginary part."""
    pure, near = level.pure, level.near
    value, half = np.empty(pure.shape.shape[1], complex), np.empty(pure.shape.shape[1])
    for out in range(len(value)):
        real, imaginary = (
            _read((pure, one), (near, other), level.amplitude)
            for one, other in (
                (pure.shape[:, out].real, near.shape[:, out].real),
                (pure.shape[:, out].imag, near.shape[:, out].imag),
            )
        )
        value[out], half[out] = real[0] + 1j * imaginary[0], max(real[2], imaginary[2])
    return value, half


def _read(
    pure_values: tuple[_Pool, Float[np.ndarray, "pure"]],
    near_values: tuple[_Pool, Float[np.ndarray, "near"]],
    amplitude: float,
) -> tuple[float, float, float, float]:
    """Value, its standard deviation, half width of the 95 % interval, and slope over the logarithm of the amplitude."""
    from scipy.stats import t as student

    (pure, y), (near, every) = pure_values, near_values
    log = np.log(pure.amplitude / amplitude)
    x = np.column_stack([np.ones(len(y)), log])
    value, covariance = clustered(x, y, pure.impact)
    scatter = 2 * 1.4826 * float(np.median(np.abs(y - x @ value - np.median(y - x @ value))))
    everything = np.column_stack([np.ones(len(near.impact)), np.log(near.amplitude / amplitude)])
    mixed = float(value[0] - clustered(everything, every, near.impact)[0][0])
    # what an impact leaves in modes above the band falls with time; the mode at one amplitude does not know the time
    middle = float(np.median(pure.time))
    timed, of_timed = clustered(np.column_stack([x, middle / pure.time]), y, pure.impact)
    change = float(timed[2])
    clear = abs(change) > CLEAR * np.sqrt(of_timed[2, 2])
    best, spread, slope = float(value[0]), float(covariance[0, 0]), float(value[1])
    in_time = abs(change) if clear else 0.5 * abs(change)
    if clear and pure.time.max() > AS_FAR * pure.time.min():
        best, spread, slope, in_time = float(timed[0]), float(of_timed[0, 0]), float(timed[1]), 0.5 * abs(change)
    freedom = max(len(np.unique(pure.impact)) - 3, 1)
    reach = float(student.ppf(0.975, freedom)) * np.sqrt(spread)
    std = 0.5 * float(np.sqrt(reach**2 + in_time**2 + mixed**2))
    return best, std, float(np.sqrt(reach**2 + scatter**2 + mixed**2 + in_time**2)), slope


def clustered(
    x: Float[np.ndarray, "row column"], y: Float[np.ndarray, "row"], cluster: Int[np.ndarray, "row"]
) -> tuple[Float[np.ndarray, "column"], Float[np.ndarray, "column column"]]:
    """Least squares with outliers drawn in (Huber 1981), and the covariance of its coefficients where rows of one
    cluster belong together (Liang and Zeger, Biometrika 73, 1986)."""
    inverse = np.linalg.pinv(x.T @ x)
    value = inverse @ (x.T @ y)
    for _ in range(_CLIPS):
        left = y - x @ value
        most = OUTLIER * 1.4826 * float(np.median(np.abs(left)))
        value = inverse @ (x.T @ (x @ value + np.clip(left, -most, most)))
    left = np.clip(y - x @ value, -most, most)
    names, rows = np.unique(cluster, return_inverse=True)
    scores = np.zeros((len(names), x.shape[1]))
    np.add.at(scores, rows, x * left[:, None])
    factor = len(names) / max(len(names) - x.shape[1], 1)
    return value, factor * inverse @ (scores.T @ scores) @ inverse


def _own(read: list[_Level], late: Float[np.ndarray, "2"]) -> list[_Level]:
    """The levels at which the mode is what moves the structure, or is what it is for small amplitudes; those whose
    damping could as well be zero say nothing."""
    return [
        one
        for one in read
        if one.half[1] < one.value[1]
        and (one.others <= WEAKER or np.all(np.abs(one.value - late) <= np.maximum(3 * one.std, 1e-3 * late)))
    ]


def _smeared(read: list[_Level], width: float) -> list[_Level]:
    """Levels whose intervals contain what the change of amplitude within a window does: half the curvature over
    ln a, times the variance of ln a under the weights with which a window reads its slope."""
    if len(read) < 3:
        return read
    log = np.log([one.amplitude for one in read])
    table = np.array([one.value for one in read])
    wider = list(read)
    for row in range(1, len(read) - 1):
        left, right = log[row] - log[row - 1], log[row + 1] - log[row]
        slopes = (table[row] - table[row - 1]) / left, (table[row + 1] - table[row]) / right
        curvature = (slopes[1] - slopes[0]) / (0.5 * (left + right))
        rate = 2 * np.pi * table[row, 0] * table[row, 1]
        off = 0.5 * np.abs(curvature) * (rate * width) ** 2 / _SPREAD
        wider[row] = replace(read[row], half=np.hypot(read[row].half, off))
    return wider


def _filtered(level: _Level, low: float) -> _Level:
    """The level with an interval that contains what the high-pass in front of the windows adds to a free decay.

    Its corner is half the lower end ``low`` of the band; its own decay, e^(-s t) with s = 2 pi f_c / sqrt(2), begins
    with about (f_c / f)^2 of the amplitude and changes its logarithm by as much times s.
    """
    corner = 0.5 * low
    decay = np.sqrt(2) * np.pi * corner
    rate = FILTER * (corner / level.value[0]) ** 2 * decay * np.exp(-decay * level.first)
    off = np.array([rate / (2 * np.pi), rate / (2 * np.pi * level.value[0])])
    return replace(level, half=np.hypot(level.half, off))


def findings(found: RingDownMode, decays: ModalDecays, mode: int) -> tuple[Finding, ...]:
    """What a reader of the mode has to know: limit of small amplitudes, onset of slip, impacts, modal mass."""
    unit, where, onset = SI_UNIT[found.mode.quantity].replace("^2", "²"), found.mode.name, found.onset
    at = decays.outputs[decays.reference[mode]]
    low, middle, high = found.reached
    frequency, damping = onset.frequency, onset.damping
    limit = (
        f"{frequency.value:.2f} Hz [{frequency.low:.2f}, {frequency.high:.2f}] and "
        f"{100 * damping.value:.3f} % [{100 * damping.low:.3f}, {100 * damping.high:.3f}] for small amplitudes"
    )
    begin = onset.amplitude
    if onset.seen:
        lowest = f"{begin.low:.3g}" if begin.low > 0 else "0 (a law that slips at every amplitude is not excluded)"
        text = f"{limit}; slip begins at {begin.value:.3g} {unit} [{lowest}, {begin.high:.3g}]."
        listed = [Finding("info", "slip-onset", where, text, float(begin.value), None)]
    else:
        top = float(found.mode.amplitude[-1])
        text = f"{limit}; no slip is seen up to {top:.3g} {unit}."
        listed = [Finding("info", "no-slip-seen", where, text, top, None)]
    listed.append(
        Finding.of(
            "info",
            "impact-amplitude",
            where,
            "amplitudes are those of the {quantity} at {at}; behind the impacts they are {low} to {high} "
            "{unit}, {median} in the median.",
            middle,
            high,
            quantity=found.mode.quantity,
            at=at,
            low=f"{low:.3g}",
            high=f"{high:.3g}",
            unit=unit,
            median=f"{middle:.3g}",
        )
    )
    if not np.isfinite(found.mass.value):
        listed.append(
            Finding(
                "info",
                "modal-mass-withheld",
                where,
                f"the modal mass is withheld: {found.mass.reason}.",
                advice="Let the force window close behind the contact."
                if found.mass.cut
                else "Strike a point that has an accelerometer at a level that leaves the joint sticking.",
            )
        )
    return tuple(listed)
