"""Frequency and damping of a mode over its amplitude, from the levels of a stepped sine.

About one resonance the force over the displacement is F / x = m (w_r^2 - w^2) + j 2 zeta m w_r w, plus what the other
modes add, which is smooth: both parts are fitted by second-order polynomials in w^2 over the lines of a level. The real
part crosses zero at w_r, its slope there is the modal mass, the imaginary part the power: zeta = P / (w^3 q^2) with
P = w |F| |x| sin(phase) / 2 (Scheel et al. 2018, JSV 435:56). At constant response amplitude these polynomials hold for
all lines (Arslan, Aykan and Ozguven 2011); at constant force only for those about the resonance.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from ema.data import AmplitudeDependentMode, Band, Condition, Finding, SteppedLevel
from ema.errors import InputError

_HELD = 0.1
"""Relative change of what was to be constant over the lines of a level, from which a finding names it. Controllers on
linear structures hold 1 to 2 %; at half of this limit every force-controlled test on a light structure is named."""
_FEWEST = 6
"""Lines about a resonance: three coefficients and as many to see how far off they are."""
_NEAR = 0.8
"""Share of the response at resonance above which a line of a level whose response was not constant is about the
resonance: the amplitude, on which the mode depends, changes by a fifth over them. At 0.5 a softening oscillator (test)
is read 2.5 % of its bandwidth too high."""
_JUMP = 0.3
"""Gap between two sides of a level, over the smaller of their stiffnesses, from which on its response jumps there: what
is read between two lines so far apart is as uncertain, also where the curve is steep and does not fold."""
_CLEAR = 5.0
"""Gap over its standard deviation by noise: complex noise of known variance exceeds it with probability exp(-25). No
level of a linear mode jumps in 90 draws of 9 to 41 lines with up to 10 % noise (tests)."""
_SIDE = 4
"""Lines on each side that are continued by a straight line. No sensitivity to it was measured."""
_ALIKE = 1.1
"""Ratio of amplitudes up to which levels are one for the slope of frequency and loss over the amplitude: between equal
levels it would be noise. Levels that are meant to differ do so by a fifth or more."""
_STEEP = 3.0
"""What levels of nearly one amplitude may differ by, over what the other levels tell of the change between them."""
_TOGETHER = 0.1
"""Difference of stiffness or loss over the loss below which two levels of nearly one amplitude are told for one: the
resonance is off by a twentieth of its bandwidth."""
_PASSES = 3
"""How often levels are read with what their neighbours tell of the amplitude: in 16 tests of modes that fall by 1 and
3 % the second pass moves values by up to 0.22 of their standard deviations, the third by up to 0.025."""


@dataclass(frozen=True)
class _Resonance:
    """One level: natural frequency [Hz], modal mass [kg], loss 2 zeta m w_r^2 [N/m], std, amplitude, force [N].

    ``amplitude_std`` is relative.
    """

    frequency: float
    frequency_std: float
    mass: float
    mass_std: float
    loss: float
    loss_std: float
    amplitude: float
    amplitude_std: float
    force: float


@dataclass(frozen=True)
class _Lines:
    """The lines about the resonance of a level: w^2, force over displacement [N/m], and amplitude.

    ``nearest`` is w^2 of the line below the resonance; ``turned``: the response was counted against the force.
    """

    level: SteppedLevel
    squared: np.ndarray
    stiffness: np.ndarray
    amplitude: np.ndarray
    nearest: float
    turned: bool


@dataclass(frozen=True)
class _Backbone:
    """How stiffness and loss of the modal oscillator [N/m] follow the logarithm of the amplitude, from all levels.

    Levels of nearly one amplitude are one. Between two the curve is monotone (Fritsch and Carlson 1980), beyond the
    last ones it goes on straight.
    """

    logarithms: np.ndarray
    values: np.ndarray
    std: np.ndarray

    @classmethod
    def of(cls, read: Sequence[_Resonance], mass: float) -> "_Backbone | None":
        """From what was read of the levels; ``None`` where these have one amplitude."""
        ordered = sorted(read, key=lambda one: one.amplitude)
        groups: list[list[_Resonance]] = []
        for one in ordered:
            if groups and one.amplitude < _ALIKE * groups[-1][0].amplitude:
                groups[-1].append(one)
            else:
                groups.append([one])
        if len(groups) < 2:
            return None
        rows = [[(np.log(one.amplitude), *_stiffness(one, mass)) for one in group] for group in groups]
        means = np.array([np.mean(row, axis=0) for row in rows])
        std = [max(mass * 8 * np.pi**2 * one.frequency * one.frequency_std for one in group) for group in groups]
        return cls(means[:, 0], means[:, 1] + 1j * means[:, 2], np.array(std))

    def change(
        self, amplitude: Float[np.ndarray, "line"], reference: float
    ) -> tuple[Complex[np.ndarray, "line"], Float[np.ndarray, "line"]]:
        """Stiffness at amplitudes, less that at the reference, and the part of it that the levels leave open."""
        from scipy.interpolate import PchipInterpolator

        x, around = np.log(amplitude), np.log(reference)
        curves = [PchipInterpolator(self.logarithms, part) for part in (self.values.real, self.values.imag)]

        def at(where: np.ndarray) -> np.ndarray:
            within = np.clip(where, self.logarithms[0], self.logarithms[-1])
            value, slope = (curves[0](within, nu) + 1j * curves[1](within, nu) for nu in (0, 1))
            return np.asarray(value + slope * (where - within))

        nearest = int(np.clip(np.searchsorted(self.logarithms, around), 1, len(self.logarithms) - 1))
        slope_std = np.hypot(*self.std[nearest - 1 : nearest + 1]) / np.diff(self.logarithms)[nearest - 1]
        return at(x) - at(np.array([around])), slope_std * (x - around)


def _stiffness(one: _Resonance, mass: float) -> tuple[float, float]:
    """Stiffness m w_r^2 and loss [N/m] of the modal oscillator."""
    return mass * (2 * np.pi * one.frequency) ** 2, one.loss


def amplitude_dependent_mode(
    levels: Sequence[SteppedLevel],
    *,
    modal_mass: float | None = None,
    name: str = "",
    condition: Condition | None = None,
) -> AmplitudeDependentMode:
    """Estimate a mode over its amplitude from stepped levels, each of which holds one resonance.

    Parameters
    ----------
    levels : sequence of SteppedLevel
        Stepped sines about the same resonance, of one quantity, in any order.
    modal_mass : float, optional
        Modal mass [kg] for a shape of 1 at the response, where it is known from elsewhere (levels at constant response,
        a low-level test); by default the median over the levels, which is uncertain where the force was controlled.
    name : str, optional
        What the mode is called.
    condition : Condition, optional
        Excitation and normal forces of the measurement.

    Returns
    -------
    AmplitudeDependentMode
        One point for each level. The intervals contain the scatter of the lines about the polynomials and, for the
        damping, the uncertainty of the modal mass: its scatter between the levels, or from the lines where that is
        larger. A level without a resonance, or with several, is left out with a finding.

    Raises
    ------
    InputError
        If there are no levels, their quantities differ, or none holds a resonance.

    References
    ----------
    .. [1] Damping by power: Scheel, Peter, Leine and Krack (2018), Journal of Sound and Vibration 435:56.
    .. [2] Control of the response: Arslan, Aykan and Ozguven (2011).

    Examples
    --------
    >>> f = np.linspace(98.0, 102.0, 41)
    >>> levels = []
    >>> for force, zeta in ((1.0, 0.002), (2.0, 0.003)):
    ...     receptance = 1 / ((2 * np.pi) ** 2 * (100.0**2 - f**2 + 2j * zeta * 100.0 * f))
    ...     levels.append(SteppedLevel(f, np.full(41, force), force * receptance, "displacement", "force"))
    >>> mode = amplitude_dependent_mode(levels, modal_mass=1.0)
    >>> mode.frequency.value.round(2), mode.damping.value.round(4)
    (array([100., 100.]), array([0.002, 0.003]))
    """
    if len({level.quantity for level in levels}) != 1:
        raise InputError(
            "not levels of one quantity",
            where=name,
            got=", ".join(sorted({level.quantity for level in levels})) or "no levels",
            expected="displacements, velocities or accelerations",
        )
    findings: list[Finding] = []
    located: list[_Lines] = []
    read: list[_Resonance] = []
    for level in levels:
        findings += _not_constant(level)
        lines = _located(level)
        resonance = lines if isinstance(lines, Finding) else _read(lines)
        if isinstance(resonance, Finding):
            findings.append(resonance)
        elif isinstance(lines, _Lines):
            located.append(lines)
            read.append(resonance)
            findings += _turned(level) if lines.turned else []
    for _ in range(_PASSES):
        read = _at_one_amplitude(located, read, modal_mass)
    if not read:
        raise InputError(
            "no level holds a resonance",
            where=name,
            got="; ".join(finding.message for finding in findings),
            expected="lines to both sides of the frequency at which force and displacement are in quadrature",
        )
    findings += _contradictions(located, read, modal_mass)
    read.sort(key=lambda one: one.amplitude)
    if len(read) == 1:
        findings.append(
            Finding(
                "warning",
                "one-level",
                name,
                "one level: how the mode depends on its amplitude is not known.",
                1.0,
                2.0,
                "Measure at more levels.",
            )
        )
    return _mode(read, levels[0], modal_mass, name, condition or Condition(), tuple(findings))


def _mode(
    read: Sequence[_Resonance],
    like: SteppedLevel,
    modal_mass: float | None,
    name: str,
    condition: Condition,
    findings: tuple[Finding, ...],
) -> AmplitudeDependentMode:
    from scipy.stats import norm

    mass = np.array([one.mass for one in read])
    common = float(np.median(mass)) if modal_mass is None else modal_mass
    uncertain = 0.0
    if modal_mass is None:
        # Few levels may agree by chance: the mass is not better known than the lines of a level tell it.
        between = float(np.std(mass, ddof=1)) if len(mass) > 1 else 0.0
        uncertain = max(between, float(np.median([one.mass_std for one in read]))) / common
    frequency, loss = np.array([one.frequency for one in read]), np.array([one.loss for one in read])
    damping = loss / (2 * common * (2 * np.pi * frequency) ** 2)
    reach = float(norm.ppf(0.975))
    damping_reach = reach * damping * np.hypot([one.loss_std for one in read] / loss, uncertain)
    frequency_reach = reach * np.array([one.frequency_std for one in read])
    if (backbone := _Backbone.of(read, common)) is not None:
        # an error of the amplitude is one of the values at it
        amplitude = np.array([one.amplitude for one in read])
        off = [
            backbone.change(a * np.exp([one.amplitude_std]), a)[0][0] for a, one in zip(amplitude, read, strict=True)
        ]
        frequency_off = np.abs(np.real(off)) / (common * 8 * np.pi**2 * frequency)
        damping_off = np.abs(np.imag(off)) / (2 * common * (2 * np.pi * frequency) ** 2)
        frequency_reach = np.hypot(frequency_reach, reach * frequency_off)
        damping_reach = np.hypot(damping_reach, reach * damping_off)
    contains = "scatter of the lines"
    return AmplitudeDependentMode(
        amplitude=np.array([one.amplitude for one in read]),
        frequency=Band(frequency - frequency_reach, frequency, frequency + frequency_reach, 0.95, contains),
        damping=Band(
            damping - damping_reach,
            damping,
            damping + damping_reach,
            0.95,
            f"{contains} and uncertainty of the modal mass" if modal_mass is None else contains,
        ),
        quantity=like.quantity,
        force=np.array([one.force for one in read]),
        modal_mass=common,
        control=like.control,
        condition=condition,
        name=name,
        findings=findings,
    )


def _contradictions(located: Sequence[_Lines], read: Sequence[_Resonance], modal_mass: float | None) -> list[Finding]:
    """Levels of one amplitude whose values differ by more than noise and what the amplitude changes."""
    if not read:
        return []
    mass = float(np.median([one.mass for one in read])) if modal_mass is None else modal_mass
    backbone = _Backbone.of(read, mass)
    order = np.argsort([one.amplitude for one in read])
    found = []
    for below, above in pairwise(order):
        a, b = read[below], read[above]
        if b.amplitude >= _ALIKE * a.amplitude:
            continue
        (stiffness, loss), (other, other_loss) = _stiffness(a, mass), _stiffness(b, mass)
        change = 0j if backbone is None else backbone.change(np.array([b.amplitude]), a.amplitude)[0][0]
        std = mass * 8 * np.pi**2 * a.frequency * np.hypot(a.frequency_std, b.frequency_std)
        loss_std = np.hypot(a.loss_std, b.loss_std)
        apart = abs(other - stiffness) > max(_CLEAR * std, _STEEP * abs(change.real), _TOGETHER * loss)
        apart |= abs(other_loss - loss) > max(_CLEAR * loss_std, _STEEP * abs(change.imag), _TOGETHER * loss)
        if apart:
            first, second = (located[one].level.name or f"level {one + 1}" for one in (below, above))
            found.append(
                Finding.of(
                    "warning",
                    "levels-disagree",
                    first,
                    "it has the amplitude of {other} within {amplitude} %, and differs from it by {frequency} Hz and "
                    "{damping} % of the damping: no one curve holds both.",
                    abs(b.frequency - a.frequency),
                    float(_CLEAR * np.hypot(a.frequency_std, b.frequency_std)),
                    advice="Read levels stepped up and down, or of other assemblies, apart.",
                    other=second,
                    amplitude=f"{100 * (b.amplitude / a.amplitude - 1):.2g}",
                    frequency=f"{b.frequency - a.frequency:+.3g}",
                    damping=f"{100 * (other_loss * stiffness / (loss * other) - 1):+.2g}",
                )
            )
    return found


def _turned(level: SteppedLevel) -> list[Finding]:
    """That the sign of the response was changed."""
    return [
        Finding(
            "info",
            "response-against-force",
            level.name,
            "the response is counted against the force, or its phase is that of a displacement; it was turned by 180°.",
            180.0,
            0.0,
            "Check the sign of the sensor where phases of several sensors are compared.",
        )
    ]


def _not_constant(level: SteppedLevel) -> list[Finding]:
    """What was to be constant, and was not."""
    values = {"force": level.force, "response": np.abs(level.response)}.get(level.control)
    if values is None:
        return []
    change = float(values.max() / values.min() - 1)
    if change <= _HELD:
        return []
    return [
        Finding.of(
            "warning",
            f"{level.control}-not-constant",
            level.name,
            "the {control} was to be constant and changes by {change} over the level.",
            change,
            _HELD,
            advice=("Every value belongs to the amplitude at resonance; the lines beside it were measured at others."),
            control=level.control,
            change=f"{change:.0%}",
        )
    ]


def _located(level: SteppedLevel) -> _Lines | Finding:
    """The lines about the resonance of a level, or why it has none."""
    if len(level.frequencies) < _FEWEST:
        return Finding.of(
            "warning",
            "few-lines",
            level.name,
            "the level has {count} lines, which leave nothing to see how far off it is; left out.",
            float(len(level.frequencies)),
            float(_FEWEST),
            advice="Step {fewest} frequencies or more about the resonance.",
            count=len(level.frequencies),
            fewest=_FEWEST,
        )
    # F / x = m (w_r^2 - w^2) + j 2 zeta m w_r w + what the other modes add; its real part falls with w^2 by m
    stiffness = level.force / level.displacement
    squared = (2 * np.pi * level.frequencies) ** 2
    turned = bool(np.polyfit(squared, stiffness.real, 1)[0] > 0)
    if turned:
        stiffness = -stiffness
    crossings = np.flatnonzero((stiffness.real[:-1] > 0) & (stiffness.real[1:] <= 0))
    if len(crossings) != 1:
        what = "no resonance" if not len(crossings) else f"{len(crossings)} resonances"
        return Finding(
            "warning",
            "no-single-resonance",
            level.name,
            f"force and displacement are in quadrature at {what} of the level, which is left out.",
            float(len(crossings)),
            1.0,
            "Step over a band with one resonance; several tell of modes that interact or of a noisy phase.",
        )
    crossing, jumps = int(crossings[0]), _jumps(squared, stiffness)
    first = int(max(jumps[jumps < crossing] + 1, default=0))
    last = int(min(jumps[jumps > crossing], default=len(squared) - 1))
    if crossing in jumps or last + 1 - first < _FEWEST:
        return _jumping(level, int(jumps[np.argmin(np.abs(jumps - crossing))]))
    some = np.arange(first, last + 1)
    some = some[_about(np.abs(level.response)[some], crossing - first, level.control)]
    return _Lines(level, squared[some], stiffness[some], np.abs(level.response)[some], float(squared[crossing]), turned)


def _jumping(level: SteppedLevel, jump: int) -> Finding:
    """That the response jumps where the resonance would be read."""
    low, high = np.abs(level.response[jump : jump + 2])
    return Finding.of(
        "warning",
        "jump-at-resonance",
        level.name,
        "the response jumps between {low} and {high} Hz, where the resonance would be read; the level is left out.",
        float(high / low),
        1.0,
        advice="The curve folds at this force: step the other way, hold the response constant, or excite less.",
        low=f"{level.frequencies[jump]:.6g}",
        high=f"{level.frequencies[jump + 1]:.6g}",
    )


def _jumps(squared: Float[np.ndarray, "line"], stiffness: Complex[np.ndarray, "line"]) -> Int[np.ndarray, "jump"]:
    """Lines behind which another branch begins: straight lines through a few on both sides do not meet there.

    The stiffness of one branch is smooth in w^2, however far its lines are apart: that of a linear mode is straight.
    """
    x = (squared - squared[0]) / np.ptp(squared)
    # of white noise with E |n|^2 = s^2, |n_1 - (n_0 + n_2) / 2| has the median s sqrt(1.5 ln 2)
    middle = 0.5 * (stiffness[:-2] + stiffness[2:])
    noise = float(np.median(np.abs(stiffness[1:-1] - middle) / np.abs(stiffness[1:-1]))) / np.sqrt(1.5 * np.log(2))
    return np.sort(_splits(x, stiffness, noise, 0))


def _splits(
    x: Float[np.ndarray, "line"], stiffness: Complex[np.ndarray, "line"], noise: float, before: int
) -> Int[np.ndarray, "jump"]:
    """The same of a part of the lines behind ``before`` others: the clearest jump, then those on both sides of it."""
    clearest, jump = 1.0, -1
    for n in range(1, len(x) - 2):
        sides, half = (slice(max(n + 1 - _SIDE, 0), n + 1), slice(n + 1, n + 1 + _SIDE)), 0.5 * (x[n] + x[n + 1])
        (left, a), (right, b) = (_continued(x[side], stiffness[side], half) for side in sides)
        least = max(_JUMP * min(abs(left), abs(right)), _CLEAR * noise * np.sqrt(a + b) * max(abs(left), abs(right)))
        if abs(right - left) > clearest * least:
            clearest, jump = abs(right - left) / least, n
    if jump < 0:
        return np.zeros(0, dtype=int)
    parts = (slice(0, jump + 1), before), (slice(jump + 1, None), before + jump + 1)
    return np.concatenate(
        [[before + jump], *(_splits(x[part], stiffness[part], noise, behind) for part, behind in parts)]
    )


def _continued(x: Float[np.ndarray, "line"], y: Complex[np.ndarray, "line"], there: float) -> tuple[complex, float]:
    """A straight line through points, at an abscissa, and its variance there over that of a point."""
    off = x - x.mean()
    power = float(off @ off)
    return complex(y.mean() + (off @ y) / power * (there - x.mean())), 1 / len(x) + (there - x.mean()) ** 2 / power


def _at_one_amplitude(
    located: Sequence[_Lines], read: Sequence[_Resonance], modal_mass: float | None
) -> list[_Resonance]:
    """The levels read again: lines at another amplitude than that at resonance are moved there.

    Where the force is held, F / x also follows the amplitude, which changes along the lines: without this, the slope of
    its real part is not the modal mass.
    """
    mass = modal_mass or float(np.median([one.mass for one in read] or [0.0]))
    backbone = _Backbone.of(read, mass)
    if backbone is None:
        return list(read)
    again = []
    for lines, one in zip(located, read, strict=True):
        if _steady(lines.amplitude):
            again.append(one)
            continue
        change, uncertain = backbone.change(_smooth(lines), one.amplitude)
        moved = _read(replace(lines, stiffness=lines.stiffness - change))
        other = _read(replace(lines, stiffness=lines.stiffness - change - uncertain))
        if isinstance(moved, Finding) or isinstance(other, Finding):
            again.append(one)
            continue
        wider = {
            name: float(np.hypot(getattr(moved, name), getattr(other, what) - getattr(moved, what)))
            for name, what in (("frequency_std", "frequency"), ("mass_std", "mass"), ("loss_std", "loss"))
        }
        again.append(replace(moved, **wider))
    return again


def _smooth(lines: _Lines) -> Float[np.ndarray, "line"]:
    """Amplitudes of the lines, by a polynomial of second order in w^2 through their logarithms."""
    x = (lines.squared - lines.nearest) / np.ptp(lines.squared)
    return np.asarray(np.exp(x[:, None] ** np.arange(3) @ _polynomial(x, np.log(lines.amplitude))[0]))


def _read(lines: _Lines) -> _Resonance | Finding:
    """The resonance that lines tell of."""
    level, scale = lines.level, float(np.ptp(lines.squared))
    x = (lines.squared - lines.nearest) / scale
    real, real_covariance = _polynomial(x, lines.stiffness.real)
    imaginary, imaginary_covariance = _polynomial(x, lines.stiffness.imag)
    height, height_covariance = _polynomial(x, np.log(lines.amplitude))
    roots = np.roots(real[::-1])
    root = float(np.real(roots[np.argmin(np.abs(roots))]))
    row = root ** np.arange(3)
    slope = float(real[1] + 2 * real[2] * root)
    angular = float(np.sqrt(lines.nearest + scale * root))
    frequency = angular / (2 * np.pi)
    loss = float(imaginary @ row)
    if not (loss > 0 and slope < 0):
        return Finding(
            "warning",
            "no-single-resonance",
            level.name,
            "the level takes no power at its resonance, and is left out.",
            loss,
            0.0,
            "Check the sign and the unit of the phase.",
        )
    along = np.array([0.0, 1.0, 2.0 * root])
    root_std = float(np.sqrt(row @ real_covariance @ row)) / -slope
    # d w = (d w^2) / (2 w) at the root; mass and loss are the slope and the imaginary part there
    return _Resonance(
        frequency=frequency,
        frequency_std=root_std * scale / (2 * angular) / (2 * np.pi),
        mass=-slope / scale,
        mass_std=float(np.sqrt(along @ real_covariance @ along)) / scale,
        loss=loss,
        loss_std=float(np.sqrt(row @ imaginary_covariance @ row)),
        amplitude=float(np.exp(height @ row)),
        amplitude_std=float(np.sqrt(row @ height_covariance @ row)),
        force=float(np.interp(frequency, level.frequencies, level.force)),
    )


def _steady(amplitude: Float[np.ndarray, "line"]) -> bool:
    """Whether one amplitude stands for all lines."""
    return bool(amplitude.max() / amplitude.min() - 1 <= _HELD)


def _about(height: Float[np.ndarray, "line"], crossing: int, control: str) -> Bool[np.ndarray, "line"]:
    """The lines for which one amplitude stands: all of a response-controlled level, else those about the resonance."""
    if control == "response" and _steady(height):
        return np.ones(len(height), np.bool_)
    near = height >= _NEAR * height[crossing : crossing + 2].max()
    if near.sum() < _FEWEST:
        near = np.zeros(len(height), np.bool_)
        near[np.argsort(np.abs(np.arange(len(height)) - crossing - 0.5))[:_FEWEST]] = True
    return np.asarray(near)


def _polynomial(
    x: Float[np.ndarray, "line"], y: Float[np.ndarray, "line"]
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
    """Coefficients 1, x, x^2 and their covariance, widened where neighbouring lines are off to one side.

    Lines with a correlation r from one to the next count as (1 - r) / (1 + r) lines (Bartlett 1946). What they leave
    over tells the scatter badly where they are few: the standard deviations are those of a normal distribution with the
    95 % interval of Student's t.
    """
    from scipy.stats import norm, t

    rows = x[:, None] ** np.arange(3)
    coefficients, *_ = np.linalg.lstsq(rows, y, rcond=None)
    off = y - rows @ coefficients
    power = float(off @ off)
    lag = float(np.clip(off[1:] @ off[:-1] / power, 0.0, 0.9)) if power > 0 else 0.0
    variance = power / (len(x) - 3) * (1 + lag) / (1 - lag)
    variance *= (t.ppf(0.975, max(len(x) * (1 - lag) / (1 + lag) - 3, 1)) / norm.ppf(0.975)) ** 2
    return coefficients, variance * np.linalg.inv(rows.T @ rows)
