"""Measured hysteresis: the last whole cycles of a record, their energy, and what is suspicious about them."""

from itertools import pairwise

import numpy as np
from jaxtyping import Float

from ema.data import Finding, Loop
from ema.errors import InputError
from ema.simulate.loops import enclosed_area

_PLAY = 0.02
"""Travel at constant force over the whole travel from which on a joint has play."""
_SWING = 0.2
"""Scatter of the normal force over its mean (rms) from which on a finding names it."""
_IN_STEP = 0.7
"""Correlation of the normal force with the size of the friction force from which on it follows from friction."""
_FULL = 0.97
"""Swing over the largest from which on a cycle counts as one of full amplitude."""


def measured_loop(
    times: Float[np.ndarray, "sample"],
    displacements: Float[np.ndarray, "sample"],
    forces: Float[np.ndarray, "sample"],
    frequency: float,
    normal_forces: Float[np.ndarray, "sample"] | float = float("nan"),
    cycles: int = 3,
    steady: bool = True,
    name: str = "",
) -> Loop:
    """Return the last whole cycles of a measured loop, with its energy per cycle and what is suspicious about it.

    A force that was recorded with the wrong sign is reversed; the loop lies about the middle of its motion.

    Parameters
    ----------
    times : array of shape (sample,)
        Times [s], rising.
    displacements : array of shape (sample,)
        Relative displacement [m].
    forces : array of shape (sample,)
        Tangential force [N].
    frequency : float
        Frequency of the imposed motion [Hz].
    normal_forces : array of shape (sample,) or float, optional
        Normal force [N] over time, or one number.
    cycles : int, default 3
        How many cycles are averaged, where there are so many.
    steady : bool, default True
        Take the last cycles at full amplitude; otherwise the last periods of the record, with any run-down.
    name : str, optional
        What the loop is called in messages.

    Returns
    -------
    Loop
        The loop.

    Raises
    ------
    InputError
        If the record is shorter than one cycle, a sample is not finite, the times do not rise, or nothing moves.

    Examples
    --------
    >>> times = np.arange(1025) / 1024.0
    >>> angle = 2 * np.pi * 10.0 * times
    >>> cycle = measured_loop(times, 1e-6 * np.cos(angle), 5.0 * np.cos(angle + np.pi / 6), frequency=10.0)
    >>> round(1e6 * cycle.area, 1)  # pi * 1e-6 m * 5 N * sin(30 deg) = 7.85e-6 J
    7.8
    """
    _check(times, displacements, forces, frequency, name)
    if cycles < 1 or np.shape(normal_forces) not in ((), times.shape):
        raise InputError(
            "not a loop",
            where=name,
            got=f"{cycles} cycles, normal forces {np.shape(normal_forces)}",
            expected=f"one cycle or more; one normal force, or {len(times)} of them",
        )
    findings = []
    end, begin = float(times[-1]), float(times[0])
    if steady:
        begin, end = _full_motion(times, displacements)
        if end < times[-1] - 0.25 / frequency:
            findings.append(
                Finding(
                    "info",
                    "run-down",
                    name,
                    f"the motion has full amplitude only until {end:.2f} s.",
                    end,
                    float(times[-1]),
                    "Later cycles are no steady loop.",
                )
            )
    step = float(np.median(np.diff(times)))
    count = max(min(cycles, int((end - begin + step) * frequency * (1 + 1e-9) + 1e-6)), 1)
    part = (times > end - count / frequency + 1e-6 * step) & (times <= end)
    x, f, t = displacements[part], forces[part], times[part]
    area = enclosed_area(x, f) / count
    if area < 0:
        area, f = -area, -f
        findings.append(
            Finding(
                "warning",
                "force-sign",
                name,
                "the loop runs backwards: the force was reversed.",
                None,
                None,
                "State the direction of the force sensor.",
            )
        )
    amplitude = float(0.5 * np.ptp(x))
    play = free_travel(x, f)
    if play > _PLAY * 2 * amplitude:
        findings.append(
            Finding(
                "warning",
                "backlash",
                name,
                f"{play:.2g} m of travel at constant force between the directions: the joint has play.",
                play / (2 * amplitude),
                _PLAY,
                "Fit it (identify), or k_T is too low.",
            )
        )
    normal = np.broadcast_to(np.asarray(normal_forces, dtype=float), times.shape)[part]
    findings += _normal_force_findings(normal, f, name)
    middle = 0.5 * (x.max() + x.min())
    return Loop(x - middle, f, float(area), amplitude, count, float(normal.mean()), t, tuple(findings), name)


def _check(times: np.ndarray, x: np.ndarray, f: np.ndarray, frequency: float, name: str) -> None:
    if not (np.isfinite(frequency) and frequency > 0):
        raise InputError("not a frequency", where=name, got=f"{frequency} Hz", expected="above 0")
    if len(times) < 8 or not len(times) == len(x) == len(f):
        raise InputError(
            "not a loop",
            where=name,
            got=f"{len(times)}, {len(x)} and {len(f)} samples",
            expected="equal numbers of times, displacements and forces, 8 or more",
        )
    if not (np.all(np.isfinite(times)) and np.all(np.isfinite(x)) and np.all(np.isfinite(f))):
        raise InputError("not a loop", where=name, got="NaN or infinite samples", expected="numbers")
    if np.any(np.diff(times) <= 0):
        raise InputError(
            "the times do not rise",
            where=name,
            got=f"a step of {np.diff(times).min():g} s",
            expected="every sample later than the one before",
        )
    if (times[-1] - times[0]) * frequency * (1 + 1e-9) + 1e-3 < 1 - frequency * float(np.median(np.diff(times))):
        raise InputError(
            "less than one cycle",
            where=name,
            got=f"{times[-1] - times[0]:g} s at {frequency:g} Hz",
            expected=f"{1 / frequency:g} s or more",
        )
    if np.ptp(x) == 0 or np.ptp(f) == 0:
        raise InputError("not a loop", where=name, got="a constant displacement or force", expected="a motion")


def turning_points(x: Float[np.ndarray, "sample"]) -> np.ndarray:
    """Indices at which the motion turns back by more than a tenth of its range."""
    from scipy.signal import find_peaks

    limit = 0.1 * float(np.ptp(x))
    return np.sort(np.concatenate([find_peaks(sign * x, prominence=limit)[0] for sign in (1.0, -1.0)]))


def _full_motion(times: np.ndarray, x: np.ndarray) -> tuple[float, float]:
    """First and last time at full amplitude: turning points, or the ends of a record that is filled by it."""
    turns = turning_points(x)
    swings = np.abs(np.diff(x[turns]))
    full = np.flatnonzero(swings >= _FULL * swings.max()) if len(swings) else np.zeros(0, int)
    if not len(full):
        return float(times[0]), float(times[-1])
    half = float(np.median(np.diff(times[turns])))
    first, last = turns[full[0]], turns[full[-1] + 1]
    whole_start = full[0] == 0 and times[first] - times[0] < half
    whole_end = full[-1] == len(swings) - 1 and times[-1] - times[last] < half
    return float(times[0] if whole_start else times[first]), float(times[-1] if whole_end else times[last])


def free_travel(x: Float[np.ndarray, "sample"], f: Float[np.ndarray, "sample"], bins: int = 20) -> float:
    """Travel in m, mean of the branches of whole cycles, at which the force stands still between its two directions.

    Counted is the travel per step of force, between a quarter and three quarters of the range, until the force gets
    further than ever since the reversal: a contact without play passes all of it alike, play is a peak over the median.
    """
    turns = turning_points(np.concatenate([x, x, x]))
    turns = turns[(turns >= len(x)) & (turns <= 2 * len(x))]
    low, high = np.quantile(f, [0.01, 0.99])
    edges = 0.25 + 0.5 * np.arange(bins + 1) / bins
    spectrum = np.fft.rfft(x)
    spectrum[4 * max(len(turns) - 1, 1) + 1 :] = 0  # eight harmonics: noise must not look like travel
    x = np.fft.irfft(spectrum, len(x))
    found = []
    for a, b in pairwise(turns):
        way, force = np.take(x, range(a, b + 1), mode="wrap"), np.take(f, range(a, b + 1), mode="wrap")
        share = (force - low) / (high - low)
        passed = np.maximum.accumulate(share if way[-1] > way[0] else 1 - share)
        travel, _ = np.histogram(
            0.5 * (passed[1:] + passed[:-1]), edges, weights=np.diff(way) * np.sign(way[-1] - way[0])
        )
        excess = travel - 2 * np.median(travel)
        found.append(float(excess[excess > 0].sum()))
    return float(np.mean(found)) if found else 0.0


def _normal_force_findings(normal: np.ndarray, f: np.ndarray, name: str) -> list[Finding]:
    """Whether the normal force swings, and whether the friction force makes it swing."""
    if not np.all(np.isfinite(normal)) or normal.mean() == 0:
        return []
    swing = float(normal.std() / abs(normal.mean()))
    if swing <= _SWING:
        return []
    findings = [
        Finding(
            "warning",
            "normal-force-swings",
            name,
            f"F_N swings by {swing:.0%} (rms) in a cycle.",
            swing,
            _SWING,
            "mu and k_T here are not those of a constant F_N.",
        )
    ]
    together = float(np.corrcoef(normal, np.abs(f))[0, 1])
    if together > _IN_STEP:
        findings.append(
            Finding(
                "warning",
                "no-normal-force",
                name,
                f"F_N follows the size of the friction force (correlation "
                f"{together:.2f}): it is a consequence of friction, such as the tension of a band, and no "
                "normal force.",
                together,
                _IN_STEP,
                "Do not divide the friction force by it: measure the force that presses the faces.",
            )
        )
    return findings
