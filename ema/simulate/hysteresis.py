"""From measured hysteresis loops to the joint: k_T(F_N), F_C(F_N), mu and the exponent m, with intervals.

The resonator experiment that Gaul, Roseira and Becker (2008) refer to: the slope of the loop while it sticks is the
contact stiffness, its height the slip force. Here the whole loop of Eq. (5) is fitted.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from ema.data import Finding, Loop
from ema.errors import InputError
from ema.simulate.friction import RegularisedMasing
from ema.simulate.loops import drive, enclosed_area

_BACKLASH = 0.15
_SWING = 0.2
_SAMPLES = 512


@dataclass(frozen=True)
class LoopFit:
    """One loop: k_T in N/m, F_C in N, exponent m; ``std`` of their logarithms (3,); ``misfit`` rms over F_C."""

    normal_force: float
    contact_stiffness: float
    slip_force: float
    exponent: float
    std: Float[np.ndarray, "3"]
    misfit: float


@dataclass(frozen=True)
class JointParameters:
    """What a set of loops says of a joint; every interval is the 95 % one.

    ``contact_stiffness`` N/m at ``reference_force`` N, growing with F_N to the ``stiffness_exponent``.
    """

    friction_coefficient: float
    friction_interval: tuple[float, float]
    contact_stiffness: float
    stiffness_interval: tuple[float, float]
    stiffness_exponent: float
    stiffness_exponent_interval: tuple[float, float]
    exponent: float
    exponent_interval: tuple[float, float]
    reference_force: float
    loops: tuple[LoopFit, ...]
    findings: tuple[Finding, ...] = ()


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
    """Last whole cycles of a measured loop, with its energy per cycle and what is suspicious about it.

    Parameters
    ----------
    times : s; ``displacements`` m; ``forces`` N; ``frequency`` Hz of the imposed motion.
    normal_forces : N over time, or one number.
    cycles : how many cycles are averaged.
    steady : take the last cycles at full amplitude; otherwise the last ones of the record, with any run-down in them.
        The amplitude is that of the whole record in both cases.

    Raises
    ------
    InputError : the record is shorter than one cycle, a sample is not finite.
    """
    if not (np.all(np.isfinite(displacements)) and np.all(np.isfinite(forces)) and frequency > 0):
        raise InputError("not a loop", where=name, got="NaN, or a frequency that is not positive", expected="numbers")
    count = min(cycles, int((times[-1] - times[0]) * frequency * (1 + 1e-9)))
    if count < 1:
        raise InputError("less than one cycle", where=name, got=f"{times[-1] - times[0]:g} s at {frequency:g} Hz",
                         expected=f"{1 / frequency:g} s or more")  # fmt: skip
    findings = []
    amplitude = float(0.5 * np.ptp(displacements))
    end = _end_of_full_motion(times, displacements, frequency)
    if end < times[-1] - 0.25 / frequency:
        findings.append(Finding("info", "run-down", name, f"the motion is at full amplitude only until {end:.2f} s.",
                                float(end), float(times[-1]), "Later cycles are no steady loop."))  # fmt: skip
    if not steady:
        end = float(times[-1])
    part = (times > max(end - count / frequency, times[0] - 1e-12)) & (times <= end)
    x, f, t = displacements[part], forces[part], times[part]
    area = enclosed_area(x, f) / count
    if area < 0:
        area, f = -area, -f
        findings.append(Finding("warning", "force-sign", name, "the loop runs backwards: the force was reversed.",
                                None, None, "State the direction of the force sensor."))  # fmt: skip
    loose = _travel_without_force(x, f) / (4 * amplitude * count)
    if loose > _BACKLASH:
        findings.append(Finding("warning", "backlash", name, f"{loose:.0%} of the travel is almost without force.",
                                loose, _BACKLASH, "The loop has play: k_T read from it is too low."))  # fmt: skip
    normal = np.broadcast_to(np.asarray(normal_forces, dtype=float), times.shape)[part]
    swing = float(normal.std() / abs(normal.mean())) if np.all(np.isfinite(normal)) and normal.mean() != 0 else 0.0
    if swing > _SWING:
        findings.append(Finding("warning", "normal-force-swings", name, f"F_N swings by {swing:.0%} (rms) in a cycle.",
                                swing, _SWING, "mu and k_T here are not those of a constant F_N."))  # fmt: skip
    middle = 0.5 * (displacements.max() + displacements.min())
    return Loop(x - middle, f, float(area), amplitude, count, float(normal.mean()), t, tuple(findings), name)


def _end_of_full_motion(times: np.ndarray, x: np.ndarray, frequency: float) -> float:
    """End of the last period whose range is within 3 % of the largest."""
    period = max(round((len(times) - 1) / ((times[-1] - times[0]) * frequency)), 2)
    ends = np.arange(len(x), period - 1, -max(period // 16, 1))
    ranges = np.array([np.ptp(x[end - period : end]) for end in ends])
    return float(times[ends[np.argmax(ranges > 0.97 * ranges.max())] - 1])


def _travel_without_force(x: np.ndarray, f: np.ndarray) -> float:
    """Way over which the force stays below a tenth of its largest value."""
    small = np.abs(f) < 0.1 * np.abs(f).max()
    return float(np.abs(np.diff(x))[small[1:]].sum())


def equivalent_slip_force(loop: Loop) -> float:
    """Slip force in N of the rigid rectangle with the same energy and amplitude, W / 4A."""
    return loop.area / (4 * loop.amplitude)


def identify(loops: Sequence[Loop], reference_force: float = 1000.0) -> JointParameters:
    """Fit Eq. (5) to every loop and the laws k_T(F_N) = k (F_N/F_ref)^alpha and F_C = mu F_N to all of them.

    Raises
    ------
    InputError : there is no loop, a normal force is unknown.
    """
    if not loops:
        raise InputError("no loop to identify a joint from", expected="one for each normal force")
    for loop in loops:
        if not (np.isfinite(loop.normal_force) and loop.normal_force > 0):
            raise InputError("a loop without normal force", where=loop.name, got=loop.normal_force, expected="F_N > 0",
                             advice="measure F_N with the loop")  # fmt: skip
    fits, findings = [], []
    for number, loop in enumerate(loops):
        fit = fit_loop(loop)
        findings += list(loop.findings)
        if loop.amplitude < 1.2 * fit.slip_force / fit.contact_stiffness:
            findings.append(Finding("warning", "no-slip", loop.name or f"loop {number}", "the loop hardly slides.",
                                    loop.amplitude, 1.2 * fit.slip_force / fit.contact_stiffness,
                                    "Its slip force is not known: raise the amplitude."))  # fmt: skip
            continue
        fits.append(fit)
    if not fits:
        raise InputError("no loop slides", got=f"{len(loops)} loops", advice="raise the amplitude of the motion")
    return _combine(fits, findings, reference_force)


def _combine(fits: list[LoopFit], findings: list[Finding], reference: float) -> JointParameters:
    from scipy import stats

    normal = np.array([fit.normal_force for fit in fits])
    logs = np.log([[fit.contact_stiffness, fit.slip_force, fit.exponent] for fit in fits])
    std = np.maximum(np.array([fit.std for fit in fits]), 1e-9)
    one = np.ones(len(fits))
    friction, friction_std = _regression(one[:, None], logs[:, 1] - np.log(normal), std[:, 1])
    design = np.column_stack([one, np.log(normal / reference)])
    if len(set(normal)) == 1:
        design = one[:, None]
    stiffness, stiffness_std = _regression(design, logs[:, 0], std[:, 0])
    exponent, exponent_std = _regression(one[:, None], logs[:, 2], std[:, 2])
    alpha, alpha_std = (stiffness[1], stiffness_std[1]) if len(stiffness) == 2 else (float("nan"), float("nan"))

    wide = float(stats.t.ppf(0.975, max(len(fits) - 1, 1)))

    def interval(value: float, width: float) -> tuple[float, float]:
        return float(np.exp(value - wide * width)), float(np.exp(value + wide * width))

    return JointParameters(
        float(np.exp(friction[0])), interval(friction[0], friction_std[0]),
        float(np.exp(stiffness[0])), interval(stiffness[0], stiffness_std[0]),
        float(alpha), (float(alpha - wide * alpha_std), float(alpha + wide * alpha_std)),
        float(np.exp(exponent[0])), interval(exponent[0], exponent_std[0]), reference, tuple(fits), tuple(findings),
    )  # fmt: skip


def _regression(design: np.ndarray, values: np.ndarray, std: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weighted least squares; the scatter widens the standard deviations where it exceeds the stated ones."""
    weighted = design / std[:, None]
    solution, *_ = np.linalg.lstsq(weighted, values / std, rcond=None)
    rest = values / std - weighted @ solution
    freedom = len(values) - design.shape[1]
    scale = max(1.0, float(rest @ rest) / freedom) if freedom > 0 else 1.0
    covariance = np.linalg.inv(weighted.T @ weighted) * scale
    return solution, np.sqrt(np.diag(covariance))


def fit_loop(loop: Loop) -> LoopFit:
    """k_T, F_C and m of Eq. (5) for one loop, by least squares on the force over the smoothed motion."""
    from scipy.optimize import least_squares

    motion, force = _mean_cycle(loop)
    height = 0.5 * (force.max() - force.min())
    amplitude = 0.5 * (motion.max() - motion.min())
    area = abs(enclosed_area(np.append(motion, motion[0]), np.append(force, force[0])))
    elastic = max(amplitude - area / (4 * height), 0.02 * amplitude)
    path = np.concatenate([[0.0], np.tile(motion, 3)])

    def model(p: Float[np.ndarray, "4"]) -> np.ndarray:
        law = RegularisedMasing(1.0, float(np.exp(p[0])), float(np.exp(np.clip(p[2], -2.3, 5.0))))
        return drive(law, path, float(np.exp(p[1])))[-len(motion) :] + p[3] * height

    def rest(p: np.ndarray) -> np.ndarray:
        return np.asarray((model(p) - force) / height)

    best: Any = None
    for exponent in (2.0, 8.0):
        start = np.array([np.log(height / elastic), np.log(height), np.log(exponent), 0.0])
        found = least_squares(rest, start, x_scale=[0.1, 0.1, 0.3, 0.1], diff_step=1e-5)
        if best is None or found.cost < best.cost:
            best = found
    freedom = max(len(force) - 4, 1)
    covariance = np.linalg.pinv(best.jac.T @ best.jac) * 2 * best.cost / freedom
    k, top, m = np.exp(best.x[:3])
    misfit = np.sqrt(2 * best.cost / len(force)) * height / top
    return LoopFit(loop.normal_force, float(k), float(top), float(m), np.sqrt(np.diag(covariance))[:3], float(misfit))


def _mean_cycle(loop: Loop) -> tuple[np.ndarray, np.ndarray]:
    """Mean cycle, resampled; the motion keeps its lowest harmonics only, so that noise makes no reversals."""
    count = len(loop.displacements) - (1 if _closed(loop) else 0)
    x, f = loop.displacements[:count], loop.forces[:count]
    spectrum_x, spectrum_f = np.fft.rfft(x), np.fft.rfft(f)
    step = loop.cycles
    harmonics_x = spectrum_x[::step][:8]
    harmonics_f = spectrum_f[::step][: _SAMPLES // 2]
    scale = _SAMPLES / count
    return (
        np.fft.irfft(harmonics_x * scale, _SAMPLES) - float(np.real(harmonics_x[0])) / count,
        np.fft.irfft(harmonics_f * scale, _SAMPLES),
    )


def _closed(loop: Loop) -> bool:
    span = np.ptp(loop.displacements)
    return bool(abs(loop.displacements[0] - loop.displacements[-1]) < 1e-9 * span)


def with_area(loop: Loop) -> Loop:
    """The loop with its area and amplitude computed anew from its samples."""
    x = loop.displacements
    area = enclosed_area(np.append(x, x[0]), np.append(loop.forces, loop.forces[0])) / loop.cycles
    return replace(loop, area=float(area), amplitude=float(0.5 * np.ptp(x)))
