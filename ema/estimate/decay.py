"""Ring-down of one mode: frequency and damping over the amplitude, and where sliding gives way to sticking.

The signal is band-passed without phase, its analytic signal gives amplitude and phase, and both are read by straight
lines over a stretch that follows the decay: short where the amplitude falls fast, long where it hardly does.
"""

from dataclasses import dataclass

import numpy as np
import scipy.fft
from jaxtyping import Complex, Float, Int

from ema.data import Decay, Finding, Provenance, Recording, Response
from ema.data.findings import Severity
from ema.dof import Dof, match
from ema.errors import InputError

_ORDER = 4
"""Order of the band-pass, a Butterworth gain 1 / (1 + x^8) of x = (f^2 - f1 f2) / (f (f2 - f1)), without phase."""
_LONGEST = 8.0
"""Cycles of the longest half stretch over which slopes are read."""
_SHORTEST = 1.0
"""Cycles of the shortest half stretch."""
_FALL = 0.25
"""Change of the logarithm of the amplitude over half a stretch that its length aims at."""
_STEP = 1.03
"""Frequency after a knee over that before it, below which there is no knee: sticking stiffens."""
_EXPLAINED = 0.7
"""Share of the scatter of the frequency that two levels have to explain for a knee."""
_KNEE_CYCLES = 1.0
"""Cycles over which the frequency is read when a knee is searched."""
_SCATTER = 0.25
"""Standard deviation of the logarithm of the envelope about a line above which the end of a record is noise alone.

The envelope of Gaussian noise has 0.64 (Rayleigh distribution, pi / sqrt(24)), that of a decay next to none.
"""
_ABOVE_NOISE = 4.0
"""Where a decay ends, over the rms of what is behind it: there the amplitude is off by a quarter at most."""
_NEARLY = 1.5
"""Amplitudes up to this factor above the last one are looked at for whether a decay ends in a steady vibration."""
_FALLING = 3.0
"""Standard deviations from which on an amplitude falls."""
_FLAT = 0.002
"""Fall of the logarithm of an amplitude that is none: damping of 1e-5 over 30 cycles."""
_DECAYED = 8.0
"""How far above a steady vibration a record has to begin for that to be what its decay ends in."""
_MAINS, _OFF_MAINS = (50.0, 60.0), 0.5
"""Mains frequencies, of which a steady vibration is a multiple within this many Hz: grids keep theirs within 0.2 Hz and
leave 0.5 Hz in emergencies alone."""
_PURE, _ENOUGH = 0.1, 8.0
"""Standard deviation of the logarithm of its amplitude, and of its phase in rad, up to which an end is a steady
vibration and no noise, over this many independent values. The logarithm of Gaussian noise has 0.64 (`_SCATTER`); none
of 60 noisy records without hum is taken for one with it (tests)."""
_REMOVED = 0.25
"""Where a decay ends, over a steady vibration that was taken off. Damping and frequency hold down to there in six tests
with hum of 0.1 to 5 % of the first amplitude."""
_ENDS = 2.0
"""Filter lengths (one over the width of the band) that are left out at either end."""
_FEWEST = 2.0
"""Cycles below which a phase of a ring-down is left out."""
_MOST_IMPOSSIBLE = 0.5
"""Share of a ring-down in which the amplitude grows or the frequency leaves the band, above which it is no ring-down of
one mode: more of it contradicts than agrees. In 120 records of one mode with noise of 0.1 to 5 % it is at most 0.17, so
half the limit still passes these; twice the limit refuses nothing."""
_FEW_IMPOSSIBLE = 0.01
"""Share that does so beyond the 95 % intervals, up to which noise may be the reason: at most 0.003 in these records."""


@dataclass(frozen=True)
class Phase:
    """One stretch of a ring-down.

    Parameters
    ----------
    kind : str
        ``sliding``, ``sticking``, or ``one mode`` where there is no knee.
    start, stop : float
        Times of its ends [s].
    frequency : float
        Median frequency [Hz].
    damping : float
        Median damping ratio [-].
    cycles : float
        Number of cycles in it.
    slope : float
        Slope of the amplitude from a straight line [unit of the amplitude per s].
    misfit_ratio : float
        Misfit of an exponential envelope over that of the straight line: above 1 where friction, below 1 where viscous
        damping makes the decay.

    Examples
    --------
    >>> Phase("sticking", 0.5, 1.5, 40.0, 0.01, cycles=40.0, slope=-0.1, misfit_ratio=0.2).kind
    'sticking'
    """

    kind: str
    start: float
    stop: float
    frequency: float
    damping: float
    cycles: float
    slope: float
    misfit_ratio: float


def ring_down(
    signal: Recording | Response,
    band: tuple[float, float],
    channel: str | Dof | None = None,
    start: float | None = None,
    stop: float | None = None,
    floor: float | None = None,
    cycles: float | None = None,
) -> Decay:
    """Compute frequency and damping of a freely decaying mode over its amplitude, by the analytic signal.

    Parameters
    ----------
    signal : Recording or Response
        A record (amplitudes come in the unit of its channel) or a response in time (displacement in m).
    band : tuple of (float, float)
        Ends of the band [Hz]; it holds the mode in all its phases and no other mode.
    channel : str or Dof, optional
        Name of the channel, or the DOF; the first response by default.
    start, stop : float, optional
        Times [s]; by default two filter lengths after the largest amplitude, and two before the end.
    floor : float, optional
        The decay ends where the amplitude has fallen to this part of its first value; by default where it reaches four
        times the noise at the end of the record, if there is nothing but noise.
    cycles : float, optional
        Half length of the stretch over which the slopes are read; by default as many cycles as the amplitude needs to
        change by a quarter, between 1 and 8.

    Returns
    -------
    Decay
        Frequency and damping over the amplitude; a part that grows or vibrates outside the band is a finding
        ``not-one-mode``, a warning where noise does not explain it.

    Raises
    ------
    InputError
        If there is no such channel, the band is outside the sampling, the signal does not decay in it, or it grows or
        vibrates outside the band for more than half of the time.

    References
    ----------
    .. [1] Feldman (1997), Non-linear free vibration identification via the Hilbert transform, Journal of Sound and
       Vibration 208:475.

    Examples
    --------
    >>> from ema.examples import recording
    >>> decay = ring_down(recording(), band=(25.0, 55.0))
    >>> round(float(np.median(decay.damping_ratios)), 3)
    0.01
    """
    values, rate, what = _samples(signal, channel)
    _check(values, rate, band, what)
    analytic = band_passed(values, rate, band)
    hum = _hum(analytic, rate, band) if stop is None and floor is None else None
    if hum is not None:
        analytic = analytic - hum
    amplitude, phase = np.abs(analytic), np.unwrap(np.angle(analytic))
    first, last = _window(amplitude, rate, band, start, stop, floor, what)
    if hum is not None:
        below = np.flatnonzero(amplitude[first:last] < _REMOVED * np.abs(hum[0]))
        last = first + int(below[0]) if len(below) else last
    log, phase = np.log(amplitude[first:last]), phase[first:last]
    if log[0] < log[-1] + 0.1:
        raise _steady(what, float(np.exp(log[0])), float(np.exp(log[-1])))
    knee = _knee(phase, rate, band)
    read = np.concatenate(
        [_read(log[part], phase[part], rate, band, cycles) for part in _parts(len(log), knee)], axis=1
    )
    times = np.arange(first, last) / rate
    return Decay(
        times,
        np.exp(log),
        read[0],
        read[1],
        float(times[knee]) if knee else float("nan"),
        what,
        Provenance(options=(("band", f"{band[0]:g} to {band[1]:g} Hz"),), steps=("ring_down",)),
        read[2],
        read[3],
        (*_judged(times, read, band, what), *(() if hum is None else (_of_hum(hum, rate, what),))),
    )


def _of_hum(hum: Complex[np.ndarray, "sample"], rate: float, what: str) -> Finding:
    """That there is hum in the band."""
    amplitude = float(np.abs(hum[0]))
    return Finding.of(
        "warning",
        "steady-vibration",
        what,
        "a vibration of {frequency} Hz in the band does not decay (amplitude {amplitude}), as hum; it is taken off.",
        amplitude,
        0.0,
        advice="Check grounding and cables, or choose a band without it.",
        frequency=f"{float(np.angle(hum[1] / hum[0])) * rate / (2 * np.pi):.4g}",
        amplitude=f"{amplitude:.2g}",
    )


def _judged(
    times: Float[np.ndarray, "sample"], read: Float[np.ndarray, "4 sample"], band: tuple[float, float], what: str
) -> tuple[Finding, ...]:
    """What no ring-down of one mode within the band can do.

    Raises
    ------
    InputError : it is most of the record.
    """
    frequency, damping, reach, doubt = read
    outside, grows = (frequency < band[0]) | (frequency > band[1]), damping < 0
    share = float(np.mean(outside | grows))
    if share == 0:
        return ()
    rows = np.flatnonzero(outside | grows)
    beyond = (frequency + reach < band[0]) | (frequency - reach > band[1]) | (damping < -doubt)
    severity: Severity = "warning" if np.mean(beyond) > _FEW_IMPOSSIBLE else "info"
    finding = Finding.of(
        severity,
        "not-one-mode",
        what,
        "for {share} of the ring-down the frequency leaves the band ({outside}) or the amplitude grows ({grows}): "
        "{low} to {high} Hz, damping {least} to {most} %; between {begin} and {end} s.",
        share,
        0.0,
        advice="Choose a band with one mode, an earlier stop, or more cycles.",
        share=f"{share:.1%}",
        outside=f"{np.mean(outside):.1%}",
        grows=f"{np.mean(grows):.1%}",
        low=f"{frequency.min():.4g}",
        high=f"{frequency.max():.4g}",
        least=f"{100 * damping.min():.3g}",
        most=f"{100 * damping.max():.3g}",
        begin=f"{times[rows[0]]:.3g}",
        end=f"{times[rows[-1]]:.3g}",
    )
    if share > _MOST_IMPOSSIBLE:
        raise InputError(
            "not the ring-down of one mode",
            where=what,
            got=finding.message.rstrip("."),
            expected=f"a decay between {band[0]:g} and {band[1]:g} Hz",
            advice="choose a band with one mode, an earlier stop, or more cycles",
        )
    return (finding,)


def phases(decay: Decay) -> tuple[Phase, ...]:
    """Return the sliding and the sticking phase of a ring-down, or the whole of it where it has no knee.

    A period on either side of the knee belongs to neither: it is as long as the filter. A phase of less than two cycles
    is left out; five are needed for a damping ratio to rely on.

    Parameters
    ----------
    decay : Decay
        Ring-down of a mode.

    Returns
    -------
    tuple of Phase
        The phases in order of time.

    Examples
    --------
    >>> from ema.examples import decay
    >>> [(phase.kind, round(phase.damping, 3)) for phase in phases(decay())]
    [('one mode', 0.015)]
    """
    if not np.isfinite(decay.knee):
        return (_phase(decay, "one mode", float(decay.times[0]), float(decay.times[-1])),)
    knee = int(np.searchsorted(decay.times, decay.knee))
    before, after = (1 / float(decay.frequencies[np.clip(knee + step, 0, len(decay.times) - 1)]) for step in (-1, 1))
    spans = (
        ("sliding", decay.times[0], decay.knee - before),
        ("sticking", decay.knee + after, decay.times[-1]),
    )
    parts = [
        _phase(decay, kind, float(a), float(b))
        for kind, a, b in spans
        if np.count_nonzero((decay.times >= a) & (decay.times <= b)) > _FEWEST_SAMPLES
    ]
    return tuple(phase for phase in parts if phase.cycles >= _FEWEST)


_FEWEST_SAMPLES = 2
"""Samples from which a straight line has no misfit."""


def _phase(decay: Decay, kind: str, start: float, stop: float) -> Phase:
    inside = (decay.times >= start) & (decay.times <= stop)
    t, a = np.asarray(decay.times[inside]), np.asarray(decay.amplitudes[inside])
    frequency = float(np.median(decay.frequencies[inside]))
    line = np.polyfit(t - t[0], a, 1)
    curve = np.exp(np.polyval(np.polyfit(t - t[0], np.log(a), 1, w=a), t - t[0]))
    misfits = [float(np.linalg.norm(fit - a)) for fit in (np.polyval(line, t - t[0]), curve)]
    return Phase(
        kind,
        start,
        stop,
        frequency,
        float(np.median(decay.damping_ratios[inside])),
        (stop - start) * frequency,
        float(line[0]),
        misfits[1] / max(misfits[0], 1e-300),
    )


def band_passed(
    values: Float[np.ndarray, "sample"], rate: float, band: tuple[float, float]
) -> Complex[np.ndarray, "sample"]:
    """Analytic signal of what lies in ``band`` Hz, without phase: the gain is that of a Butterworth filter of order 4
    run forwards and backwards; beyond its ends the signal is mirrored."""
    samples = len(values)
    mirrored = np.concatenate([values, values[::-1]])
    frequencies = scipy.fft.fftfreq(len(mirrored), 1 / rate)
    low, high = band
    with np.errstate(divide="ignore", over="ignore"):
        off = (frequencies**2 - low * high) / (frequencies * (high - low))
        gain = np.where(frequencies > 0, 2 / (1 + off ** (2 * _ORDER)), 0.0)
    return np.asarray(scipy.fft.ifft(scipy.fft.fft(mirrored) * gain)[:samples])


def _samples(signal: Recording | Response, channel: str | Dof | None) -> tuple[np.ndarray, float, str]:
    """Values, sampling rate and name of what is asked for."""
    if isinstance(signal, Response):
        if len(signal.times) < 2:
            raise InputError(
                "the response has no length",
                where=signal.name,
                got=f"{len(signal.times)} samples",
                expected="2 or more",
                advice="simulate a longer time",
            )
        rate = 1 / float(signal.times[1] - signal.times[0])
        wanted = signal.dofs[0] if channel is None else Dof.parse(channel)
        matches = match([wanted], signal.dofs)
        if not matches:
            raise InputError(
                "the response has no such DOF",
                where=signal.name,
                got=str(wanted),
                expected="one of " + ", ".join(map(str, signal.dofs)),
            )
        return matches[0][2] * np.asarray(signal.displacements[matches[0][1]]), rate, f"{signal.name} {wanted}".strip()
    for row, one in enumerate(signal.channels):
        chosen = one.role == "response" if channel is None else channel in (one.name, one.dof, str(one.dof))
        if chosen:
            return (
                np.asarray(signal.signals[row], dtype=np.float64),
                signal.sampling_rate,
                f"{signal.name} {one.name}".strip(),
            )
    raise InputError(
        "the record has no such channel",
        where=signal.name,
        got=str(channel or "no response"),
        expected="one of " + ", ".join(one.name for one in signal.channels),
    )


def _check(values: np.ndarray, rate: float, band: tuple[float, float], what: str) -> None:
    if not 0 < band[0] < band[1] < rate / 2:
        raise InputError(
            "not a band",
            where=what,
            got=f"{band[0]:g} to {band[1]:g} Hz",
            expected=f"0 < low < high < {rate / 2:g} Hz, half the sampling rate",
        )
    if not np.all(np.isfinite(values)):
        raise InputError("the signal holds NaN or infinity", where=what, advice="cut the record or repair the channel")
    if len(values) < 6 * rate / band[0]:
        raise InputError(
            "the signal is too short",
            where=what,
            got=f"{len(values) / rate:.3g} s",
            expected=f"at least 6 periods of {band[0]:g} Hz",
        )


def _window(
    amplitude: np.ndarray,
    rate: float,
    band: tuple[float, float],
    start: float | None,
    stop: float | None,
    floor: float | None,
    what: str,
) -> tuple[int, int]:
    """First and last sample of the decay."""
    ends = round(_ENDS * rate / (band[1] - band[0]))
    first = int(np.argmax(amplitude[: len(amplitude) - ends])) + ends if start is None else round(start * rate)
    last = len(amplitude) - ends if stop is None else round(stop * rate)
    if start is None and first >= last:
        raise _steady(what, float(amplitude[ends]), float(amplitude[-ends]))
    if not 0 <= first < last <= len(amplitude):
        raise InputError(
            "nothing between start and stop",
            where=what,
            got=f"{first / rate:.3g} to {last / rate:.3g} s",
            expected=f"inside 0 to {len(amplitude) / rate:.3g} s",
        )
    least = _ABOVE_NOISE * _noise(amplitude, ends) if floor is None else floor * amplitude[first]
    low = np.flatnonzero(amplitude[first:last] < least)
    last = first + int(low[0]) if len(low) else last
    if last - first < 3 * rate / band[0]:
        raise InputError(
            "the decay is too short",
            where=what,
            got=f"{(last - first) / rate:.3g} s",
            expected=f"at least 3 periods of {band[0]:g} Hz",
            advice="lower floor, or widen the band",
        )
    return first, last


def _steady(what: str, first: float, last: float) -> InputError:
    return InputError(
        "the signal does not decay",
        where=what,
        got=f"amplitude {first:.3g} at the start and {last:.3g} at the end",
        expected="a free vibration",
        advice="give start and stop, or another band",
    )


def _noise(amplitude: np.ndarray, ends: int) -> float:
    """The rms at the end of the record where it is noise (it scatters, and falls no more), else 0."""
    count = max(len(amplitude) // 10, 4 * ends)
    tail = np.log(np.maximum(amplitude[-ends - count : -ends], 1e-300))
    if len(tail) < count:
        return 0.0
    early, late = (float(np.sqrt(np.mean(np.exp(2 * half)))) for half in np.array_split(tail, 2))
    return float(np.hypot(early, late) / np.sqrt(2)) if _line(tail)[1] > _SCATTER and early < 2 * late else 0.0


def _line(values: Float[np.ndarray, "sample"]) -> tuple[float, float]:
    """Change over all values by a straight line, and the standard deviation about it."""
    sample = np.arange(len(values))
    line = np.polyfit(sample, values, 1)
    return float(line[0] * len(values)), float(np.std(values - np.polyval(line, sample)))


def _hum(
    analytic: Complex[np.ndarray, "sample"], rate: float, band: tuple[float, float]
) -> Complex[np.ndarray, "sample"] | None:
    """Hum, a vibration of constant amplitude that a decay ends in, over the whole record; ``None`` without it.

    The end of the record is one where its amplitude does not fall, though so little noise would let that be seen.
    """
    ends = round(_ENDS * rate / (band[1] - band[0]))
    count = max(len(analytic) // 10, 4 * ends)
    amplitude = np.abs(analytic[ends:-ends])
    if len(amplitude) < 2 * count:
        return None
    level = float(np.sqrt(np.mean(amplitude[-count:] ** 2)))
    # a slow decay is seen over the whole stretch of nearly that amplitude; how it came down to there is not
    above = np.flatnonzero(amplitude > _NEARLY * level)
    begins = max(len(amplitude) - max((len(amplitude) - above[-1]) // 2, count), 0) if len(above) else 0
    tail = np.log(np.maximum(amplitude[begins:], 1e-300))
    change, scatter = _line(tail)
    # a straight line through n independent values tells its fall over all of them to s sqrt(12 / n)
    independent = len(tail) * (band[1] - band[0]) / rate
    falls = -change > max(_FALLING * scatter * np.sqrt(12 / max(independent, 3.0)), _FLAT)
    turns = _line(np.unwrap(np.angle(analytic[ends + begins : -ends])))[1]
    if falls or independent < _ENOUGH or max(scatter, turns) > _PURE or amplitude.max() < _DECAYED * level:
        return None
    sample = np.arange(len(analytic)) - (ends + begins)
    part = slice(ends + begins, len(analytic) - ends)
    turn = np.polyfit(sample[part], np.unwrap(np.angle(analytic[part])), 1)[0]
    frequency = turn * rate / (2 * np.pi)
    if not any(abs(frequency - max(round(frequency / one), 1) * one) <= _OFF_MAINS for one in _MAINS):
        return None  # a joint that sticks without any damping may vibrate for ever
    return np.asarray(np.mean(analytic[part] * np.exp(-1j * turn * sample[part])) * np.exp(1j * turn * sample))


def _knee(phase: np.ndarray, rate: float, band: tuple[float, float]) -> int:
    """Sample at which the frequency steps up from its lower to its upper level, 0 where it does not.

    The step is where two levels explain the frequency best; the knee is where it passes half way between them.
    """
    half = max(round(_KNEE_CYCLES * _period(phase, rate, band) / 2), 1)
    if len(phase) < 2 * half + 3:
        return 0
    rates = (phase[2 * half :] - phase[: -2 * half]) / (2 * half)
    count = np.arange(1, len(rates))
    sums = np.cumsum(rates)[:-1]
    left, right = sums / count, (rates.sum() - sums) / (len(rates) - count)
    # variance between two levels split at every sample, n1 n2 / n^2 (m2 - m1)^2 (Otsu 1979, there for grey levels)
    explained = count * (len(rates) - count) / len(rates) ** 2 * (right - left) ** 2
    best = int(np.argmax(explained))
    spread = float(np.var(rates))
    before, after = float(np.median(rates[: best + 1])), float(np.median(rates[best + 1 :]))
    if after < _STEP * before or explained[best] < _EXPLAINED * spread:
        return 0
    above = rates > (before + after) / 2
    crossings = np.flatnonzero(above[1:] & ~above[:-1])
    return half + int(crossings[np.argmin(np.abs(crossings - best))]) + 1 if len(crossings) else 0


def _parts(count: int, knee: int) -> list[slice]:
    return [slice(0, knee), slice(knee, count)] if knee else [slice(0, count)]


def _period(phase: np.ndarray, rate: float, band: tuple[float, float]) -> float:
    """Samples of a mean period; of an end of the band where the phase runs outside."""
    mean = (phase[-1] - phase[0]) / max(len(phase) - 1, 1) * rate / (2 * np.pi)
    return rate / float(np.clip(mean, *band))


def _read(
    log: np.ndarray, phase: np.ndarray, rate: float, band: tuple[float, float], cycles: float | None
) -> Float[np.ndarray, "4 sample"]:
    """Frequency in Hz and damping ratio from straight lines around every sample, one-sided towards the ends, and the
    half widths of their 95 % intervals."""
    period = _period(phase, rate, band)
    if cycles is None:
        step = max(round(period), 1)
        falls = np.abs(_lines(log, np.full(len(log), step))[0]) * period
        half = np.clip(_FALL / np.maximum(falls, 1e-12), _SHORTEST, _LONGEST) * period
    else:
        half = np.full(len(log), cycles * period)
    reach = np.maximum(np.round(half).astype(int), 1)
    independent = (band[1] - band[0]) / rate
    (turn, turn_reach), (fall, fall_reach) = (_lines(values, reach, independent) for values in (phase, log))
    # a exp(-d t) cos(w t): the phase turns with w, the logarithm of the envelope falls with d
    omega, decay = turn * rate, -fall * rate
    size = np.hypot(decay, omega)
    # zeta = d / sqrt(d^2 + w^2):  d zeta = w (w dd - d dw) / (d^2 + w^2)^(3/2)
    doubt = (
        np.abs(omega) * np.hypot(omega * fall_reach * rate, decay * turn_reach * rate) / np.maximum(size, 1e-300) ** 3
    )
    return np.stack([omega / (2 * np.pi), decay / np.maximum(size, 1e-300), turn_reach * rate / (2 * np.pi), doubt])


def _lines(
    values: np.ndarray, reach: Int[np.ndarray, "sample"], independent: float = 1.0
) -> tuple[Float[np.ndarray, "sample"], Float[np.ndarray, "sample"]]:
    """Slope per sample of the least-squares line over ``reach`` samples to both sides, as far as there are any, and the
    half width of its 95 % interval.

    ``independent``: values per sample that are independent of each other. Of what is left after a filter of width B
    these are B per second, so a line over T s has B T - 2 degrees of freedom, and at least one.
    """
    from scipy.stats import t as student

    n = len(values)
    k = np.arange(n)
    low, high = np.maximum(k - reach, 0), np.minimum(k + reach, n - 1) + 1
    # sums over any stretch from running sums, about a line through the record to keep the digits
    x = k - (n - 1) / 2
    whole = float(x @ (values - values.mean()) / max(float(x @ x), 1e-300))
    rest = values - values.mean() - whole * x
    sums = [np.concatenate([[0.0], np.cumsum(part)]) for part in (rest, x * rest, rest**2)]
    first, second, squares = (part[high] - part[low] for part in sums)
    count, centre = high - low, (low + high - 1 - (n - 1)) / 2
    moment, width = second - centre * first, np.maximum(count * (count**2 - 1) / 12, 1e-300)
    slope = moment / width
    left = np.maximum(squares - first**2 / count - slope * moment, 0.0)
    freedom = np.maximum(count * independent - 2, 1.0)
    # var(slope) = s^2 / S_xx with s^2 = rest / degrees of freedom, all sums per independent value
    reach_of_slope = student.ppf(0.975, freedom) * np.sqrt(left / freedom / width)
    return np.asarray(whole + slope), np.asarray(reach_of_slope)
