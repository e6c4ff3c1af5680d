"""From hysteresis loops to the joint: k_T(F_N), F_C(F_N), mu, the exponent m and play, with intervals.

The resonator experiment that Gaul, Roseira and Becker (2008) refer to: the slope of the loop while it sticks is the
contact stiffness, its height the slip force. Here the whole stabilised loop of Eq. (5) is fitted to all samples, with
play in series, an offset and a drift of the sensors; no resampling, so unequal steps in time do no harm.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from ema.data import Finding, Loop
from ema.errors import InputError
from ema.simulate.checks import positive
from ema.simulate.loops import stabilised

_SLIDES = 1.2
"""Force that a spring k_T would bear at full amplitude, over the slip force, from which on a loop slides far enough to
tell it."""
_MOST_SAMPLES = 20_000
"""Samples of a loop that are fitted: of more, every so many. A bound on the work."""
_HARMONICS = 8
"""Harmonics of a smoothed motion at most."""
_SURE = 5.0
"""Standard deviations at which play is believed."""


@dataclass(frozen=True)
class LoopFit:
    """One loop: k_T in N/m, F_C in N, exponent m; ``std`` of their logarithms (3,); ``misfit`` rms over F_C.

    ``play`` in m, 0 where none is seen; ``slides`` says whether the motion is large enough to know F_C and m.
    """

    normal_force: float
    contact_stiffness: float
    slip_force: float
    exponent: float
    std: Float[np.ndarray, "3"]
    misfit: float
    play: float = 0.0
    slides: bool = True


@dataclass(frozen=True)
class JointParameters:
    """What a set of loops says of a joint; every interval is the 95 % one.

    ``contact_stiffness`` N/m at ``reference_force`` N, growing with F_N to the ``stiffness_exponent``. What the loops
    cannot tell is NaN, its interval is open, and a finding says why.
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


def identify(loops: Sequence[Loop], reference_force: float = 1000.0) -> JointParameters:
    """Identify a joint from its hysteresis loops at several normal forces.

    The smooth evolution rule is fitted to every loop, and the laws k_T(F_N) = k (F_N/F_ref)^alpha and F_C = mu F_N to
    all of them. Loops that do not slide determine k_T only; then mu has a lower bound and m is unknown, and findings
    say so.

    Parameters
    ----------
    loops : sequence of Loop
        Loops with their normal force.
    reference_force : float, default 1000.0
        F_ref [N].

    Returns
    -------
    JointParameters
        Parameters of the joint with their 95 % intervals.

    Raises
    ------
    InputError
        If there is no loop, a normal force is unknown, the reference force is not positive, or a loop has too few
        samples or does not move.

    References
    ----------
    .. [1] Gaul, Roseira and Becker (2008), Eq. 5.

    Examples
    --------
    >>> from ema.simulate import RegularisedMasing, loop
    >>> truth = RegularisedMasing(0.3, 2e7)
    >>> found = identify([loop(truth, force, amplitude=5e-5, samples=512) for force in (500.0, 1000.0)])
    >>> round(found.friction_coefficient, 3)
    0.3
    """
    positive("identification of a joint", reference_force=reference_force)
    if not loops:
        raise InputError("no loop to identify a joint from", expected="one for each normal force")
    for loop in loops:
        if not (np.isfinite(loop.normal_force) and loop.normal_force > 0):
            raise InputError(
                "a loop without normal force",
                where=loop.name,
                got=loop.normal_force,
                expected="F_N > 0",
                advice="measure F_N with the loop",
            )
    fits, findings = [], []
    for number, loop in enumerate(loops):
        fit, found = _fit(replace(loop, name=loop.name or f"loop {number}"))
        fits.append(fit)
        findings += [*loop.findings, *(f for f in found if f.code not in {g.code for g in loop.findings})]
    return _combine(fits, findings, reference_force)


def fit_loop(loop: Loop) -> LoopFit:
    """k_T, F_C, m and play of Eq. (5) for one loop, by least squares on the force over the smoothed motion.

    Raises
    ------
    InputError : the loop has too few samples or does not move.
    """
    return _fit(loop)[0]


@dataclass(frozen=True)
class _Motion:
    """The smoothed motion at the samples of a loop: harmonic coefficients and what they were fitted with."""

    basis: Float[np.ndarray, "sample term"]
    fine: Float[np.ndarray, "phase term"]
    coefficients: Float[np.ndarray, "term"]
    noise: float
    phase: Float[np.ndarray, "sample"]

    def travel(self, coefficients: Float[np.ndarray, "term"]) -> tuple[np.ndarray, Bool[np.ndarray, "sample"], float]:
        """Way since the last reversal in m, whether the sample is on the falling branch, and half the range."""
        x, fine = self.basis @ coefficients, self.fine @ coefficients
        top, bottom = (_extreme(fine, sign) for sign in (1.0, -1.0))
        high, low = top[1], -bottom[1]
        falling = (self.phase - top[0]) % 1.0 < (bottom[0] - top[0]) % 1.0
        return np.maximum(np.where(falling, high - x, x - low), 0.0), falling, 0.5 * (high - low)


def _extreme(values: np.ndarray, sign: float) -> tuple[float, float]:
    """Phase and value of the largest of ``sign`` times a periodic curve, by a parabola through three samples."""
    count = len(values)
    k = int(np.argmax(sign * values))
    a, b, c = (sign * values[(k + step) % count] for step in (-1, 0, 1))
    bend = a - 2 * b + c
    shift = 0.5 * (a - c) / bend if bend < 0 else 0.0
    return float((k + shift) / count), float(b - 0.25 * (a - c) * shift)


def _smooth_motion(phase: np.ndarray, x: np.ndarray, cycles: int, limit: int = _HARMONICS) -> _Motion:
    """Fewest assumptions about the motion: harmonics, and a drift where there are cycles to see it."""
    turns = np.arange(1024) / 1024
    for most in range(min(limit, len(x) // (4 * cycles)), 0, -1):
        waves = 2 * np.pi * np.arange(1, most + 1)
        basis = np.column_stack([np.cos(phase[:, None] * waves), np.sin(phase[:, None] * waves)])
        fine = np.column_stack([np.cos(turns[:, None] * waves), np.sin(turns[:, None] * waves)])
        extra = np.column_stack([np.ones(len(x)), phase])[:, : 2 if cycles > 1 else 1]
        solution, *_ = np.linalg.lstsq(np.column_stack([basis, extra]), x, rcond=None)
        rest = x - np.column_stack([basis, extra]) @ solution
        coefficients = solution[: 2 * most]
        slope = np.diff(fine @ coefficients, append=(fine @ coefficients)[0])
        if np.count_nonzero(slope * np.roll(slope, 1) < 0) <= 2 or most == 1:
            break
    noise = float(np.sqrt(rest @ rest / max(len(x) - len(solution), 1)))
    return _Motion(basis, fine, coefficients, noise, phase % 1.0)


def _phases(loop: Loop) -> Float[np.ndarray, "sample"]:
    """Time in periods. A record of n cycles without a sample too many, unless the motion clearly says it has one."""
    x = np.asarray(loop.displacements, dtype=float)
    t = np.arange(len(x), dtype=float) if loop.times is None else np.asarray(loop.times)
    if np.any(np.diff(t) <= 0):
        raise InputError(
            "the times of a loop do not rise",
            where=loop.name,
            got=f"a step of {np.diff(t).min():g} s",
            expected="every sample later than the one before",
        )
    span = t[-1] - t[0]
    opened, closed = (loop.cycles * (t - t[0]) / length for length in (span + float(np.median(np.diff(t))), span))
    noise = [_smooth_motion(phase, x, loop.cycles, limit=2).noise for phase in (opened, closed)]
    return np.asarray(closed if noise[1] ** 2 < noise[0] ** 2 * (1 - 10 / len(x)) else opened)


class _Residual:
    """Model minus measured force, over half the range.

    Parameters: ln k_T, ln F_C, ln m, offset, drift (from two cycles on), and play where it is fitted.
    """

    def __init__(self, motion: _Motion, phase: np.ndarray, f: np.ndarray, cycles: int) -> None:
        self.motion, self.ramp = motion, phase - phase.mean()
        self.way = motion.travel(motion.coefficients)
        self.amplitude, falling = self.way[2], self.way[1]
        low, high = np.quantile(f, [0.005, 0.995])
        self.height, self.force = float(0.5 * (high - low)), f - 0.5 * (low + high)
        self.backwards = float(np.mean(np.where(falling, -1.0, 1.0) * self.force)) < -0.01 * self.height
        self.force = -self.force if self.backwards else self.force
        self.plain = 5 if cycles > 1 else 4
        slope = np.log(self.height / self.amplitude)
        low_force, high_force = np.log([0.3 * self.height, 50 * self.height])
        self.bounds = np.array(
            [
                (slope - 7, slope + 7),
                (low_force, high_force),
                (-2.3, 5.0),
                (-1, 1),
                *[(-1, 1)] * (self.plain - 4),
                (0.0, 1.9 * self.amplitude),
            ]
        ).T
        self.scale = np.array([0.1, 0.1, 0.3, *[0.1] * (self.plain - 3), 0.05 * self.amplitude])

    def __call__(self, p: np.ndarray, way: tuple[Any, Any, float] | None = None) -> np.ndarray:
        k, top, m = (float(v) for v in np.exp(p[:3]))
        play = float(p[self.plain]) if len(p) > self.plain else 0.0
        travel, falling, amplitude = way or self.way
        model = stabilised(travel, falling, amplitude, (k, top, m), play)
        drift = p[4] * self.ramp if self.plain == 5 else 0.0
        return np.asarray((model - self.force) / self.height + p[3] + drift)

    def cost(self, p: np.ndarray) -> float:
        return 0.5 * float(np.square(self(p)).sum())

    def starts(self) -> list[np.ndarray]:
        """For several shares of the amplitude that are elastic, the best of some exponents."""
        tail = np.zeros(self.plain - 3)
        return [
            min(
                (
                    np.concatenate([np.log([self.height / (elastic * self.amplitude), 1.001 * self.height, m]), tail])
                    for m in (1.0, 3.0, 8.0)
                ),
                key=self.cost,
            )
            for elastic in (0.1, 0.25, 0.5, 1.0)
        ]

    def solve(self, p: np.ndarray) -> Any:
        from scipy.optimize import least_squares

        size = len(p)
        return least_squares(self, p, bounds=self.bounds[:, :size], x_scale=self.scale[:size], diff_step=1e-6)


def _fit(loop: Loop) -> tuple[LoopFit, list[Finding]]:
    _check(loop)
    thin = -(-len(loop.forces) // _MOST_SAMPLES)
    phase, x, f = (np.asarray(a, dtype=float)[::thin] for a in (_phases(loop), loop.displacements, loop.forces))
    rest = _Residual(_smooth_motion(phase, x, loop.cycles), phase, f, loop.cycles)
    best, columns, play = _best(rest)
    std = np.sqrt(np.diag(_covariance(best, columns, rest.motion, len(f))))[:3]
    k, top, m = (float(v) for v in np.exp(best.x[:3]))
    findings = []
    if rest.backwards:
        findings.append(
            Finding(
                "warning",
                "force-sign",
                loop.name,
                "the loop runs backwards: the force was reversed.",
                None,
                None,
                "State the direction of the force sensor.",
            )
        )
    if play:
        findings.append(
            Finding(
                "warning",
                "backlash",
                loop.name,
                f"the joint has {play:.2g} m of play.",
                play / (2 * rest.amplitude),
                None,
                "k_T and F_C are those of the closed joint.",
            )
        )
    reach = (rest.amplitude - 0.5 * play) * k
    slides = reach >= _SLIDES * top and std[1] < 0.1
    if not slides:
        findings.append(
            Finding(
                "warning",
                "no-slip",
                loop.name,
                "the loop hardly slides.",
                reach / top,
                _SLIDES,
                "It tells k_T only: raise the amplitude.",
            )
        )
        top = rest.height
    misfit = float(np.sqrt(2 * best.cost / len(f))) * rest.height / top
    return LoopFit(loop.normal_force, k, top, m, std, misfit, play, bool(slides)), findings


def _best(rest: _Residual) -> tuple[Any, np.ndarray, float]:
    """The fit without play, or with it where the residual asks for it; what errors of the motion do; the play."""
    starts = rest.starts()
    best = rest.solve(min(starts, key=rest.cost))
    columns = _motion_columns(rest, best)
    trials = [np.append(best.x, share * rest.amplitude) for share in (0.02, 0.1)]
    trials += [np.append(p, share * rest.amplitude) for p in starts for share in (0.1, 0.3, 0.6, 1.0)]
    first = min(trials, key=rest.cost)
    if rest.cost(first) < best.cost or _score_of_play(rest, best, columns) > _SURE:
        other = rest.solve(first)
        play = float(other.x[rest.plain])
        if play > 1e-3 * rest.amplitude and other.cost < best.cost * (1 - _SURE**2 / len(rest.force)):
            return other, _motion_columns(rest, other), play
    return best, columns, 0.0


def _check(loop: Loop) -> None:
    samples = len(loop.forces)
    if samples != len(loop.displacements) or loop.cycles < 1 or samples < 24 * loop.cycles:
        raise InputError(
            "a loop has too few samples",
            where=loop.name,
            got=f"{samples} in {loop.cycles} cycles",
            expected="24 or more per cycle",
        )
    if not (np.all(np.isfinite(loop.displacements)) and np.all(np.isfinite(loop.forces))):
        raise InputError("a loop holds NaN", where=loop.name, got="NaN or infinite samples", expected="numbers")
    if np.ptp(loop.displacements) == 0 or np.ptp(loop.forces) == 0:
        raise InputError(
            "a loop does not move", where=loop.name, got="a constant displacement or force", expected="a motion"
        )


def _motion_columns(rest: _Residual, best: Any) -> Float[np.ndarray, "sample term"]:
    """What an error of each coefficient of the motion does to the residual."""
    motion = rest.motion
    small = 1e-5 * float(np.abs(motion.coefficients).max())
    moved = motion.coefficients + small * np.eye(len(motion.coefficients))
    return np.column_stack([(rest(best.x, motion.travel(row)) - best.fun) / small for row in moved])


def _score_of_play(rest: _Residual, best: Any, columns: np.ndarray) -> float:
    """Evidence for play in standard deviations: what the residual has in common with its effect and nothing else."""
    small = 1e-4 * rest.amplitude
    column = (rest(np.append(best.x, small)) - best.fun) / small
    known = np.column_stack([best.jac, columns])
    known = known / np.maximum(np.linalg.norm(known, axis=0), 1e-300)
    others, *_ = np.linalg.lstsq(known, column, rcond=1e-9)
    column = column - known @ others
    noise = np.sqrt(2 * best.cost / max(len(column) - 6, 1))
    return float(-(column @ best.fun) / (np.linalg.norm(column) * noise + 1e-300))


def _covariance(best: Any, columns: np.ndarray, motion: _Motion, count: int) -> np.ndarray:
    """Of the parameters, from the noise of the force and from that of the smoothed motion."""
    scale = np.maximum(np.linalg.norm(best.jac, axis=0), 1e-12 * np.linalg.norm(best.jac))
    inverse = np.linalg.pinv(best.jac / scale, rcond=1e-9) / scale[:, None]
    own = inverse @ inverse.T * 2 * best.cost / max(count - len(best.x), 1)
    spread = np.linalg.inv(motion.basis.T @ motion.basis) * motion.noise**2
    passed = inverse @ columns
    return np.asarray(own + passed @ spread @ passed.T)


def _combine(fits: list[LoopFit], findings: list[Finding], reference: float) -> JointParameters:
    nothing, open_interval = float("nan"), (float("-inf"), float("inf"))

    def unknown(what: str, why: str, advice: str) -> None:
        findings.append(
            Finding("warning", "not-identifiable", "joint", f"{what} is not identifiable: {why}.", None, None, advice)
        )

    normal = np.array([fit.normal_force for fit in fits])
    design = np.column_stack([np.ones(len(fits)), np.log(normal / reference)])
    single = float(np.ptp(np.log(normal))) < 0.05
    values, std = np.log([fit.contact_stiffness for fit in fits]), np.array([fit.std[0] for fit in fits])
    line = _regression(design[:, :1] if single else design, values, std)
    alpha, alpha_interval = (nothing, open_interval) if single else (line[1][0], (line[1][1], line[1][2]))
    if single:
        unknown("the growth of k_T with F_N", "all loops have one normal force", "measure at several normal forces")
    sliding = [fit for fit in fits if fit.slides]
    friction: tuple[float, float, float]
    smooth: tuple[float, float, float]
    if sliding:
        mu = np.log([fit.slip_force / fit.normal_force for fit in sliding])
        one = np.ones((len(sliding), 1))
        friction = _exp(_regression(one, mu, np.array([fit.std[1] for fit in sliding]))[0])
        m = np.log([fit.exponent for fit in sliding])
        row = _regression(one, m, np.array([fit.std[2] for fit in sliding]))[0]
        smooth = _exp(row)
        if row[2] - row[1] > 2:
            unknown("the exponent m", "the knee of the loops is too noisy or too sharp", "average more cycles")
    else:
        friction = (nothing, max(fit.slip_force / fit.normal_force for fit in fits), float("inf"))
        smooth = (nothing, 0.0, float("inf"))
        unknown("the friction coefficient", f"no loop slides; it is above {friction[1]:.3g}", "raise the amplitude")
        unknown("the exponent m", "no loop slides", "raise the amplitude")
    stiffness = _exp(line[0])
    return JointParameters(
        friction[0],
        friction[1:],
        stiffness[0],
        stiffness[1:],
        alpha,
        alpha_interval,
        smooth[0],
        smooth[1:],
        reference,
        tuple(fits),
        tuple(findings),
    )


def _exp(row: tuple[float, float, float]) -> tuple[float, float, float]:
    return float(np.exp(row[0])), float(np.exp(row[1])), float(np.exp(row[2]))


def _regression(design: np.ndarray, values: np.ndarray, std: np.ndarray) -> list[tuple[float, float, float]]:
    """Weighted least squares: each coefficient with its 95 % interval.

    Where the values agree within their standard deviations these make the interval; where they do not, their scatter.
    """
    from scipy import stats

    std = np.maximum(std, 1e-9)
    weighted = design / std[:, None]
    solution, *_ = np.linalg.lstsq(weighted, values / std, rcond=None)
    rest = values / std - weighted @ solution
    freedom = len(values) - design.shape[1]
    scatter = float(rest @ rest)
    width, scale = float(stats.norm.ppf(0.975)), 1.0
    if freedom > 0 and scatter > stats.chi2.ppf(0.99, freedom):
        width, scale = float(stats.t.ppf(0.975, freedom)), scatter / freedom
    half = width * np.sqrt(np.diag(np.linalg.inv(weighted.T @ weighted)) * scale)
    return [(float(v), float(v - h), float(v + h)) for v, h in zip(solution, half, strict=True)]
