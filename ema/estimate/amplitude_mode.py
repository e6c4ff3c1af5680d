"""Frequency and damping of a mode over its amplitude, from the levels of a stepped sine.

About one resonance the force over the displacement is F / x = m (w_r^2 - w^2) + j 2 zeta m w_r w, plus what the other
modes add, which is smooth: both parts are fitted by second-order polynomials in w^2 over the lines of a level. The real
part crosses zero at w_r, its slope there is the modal mass, the imaginary part the power: zeta = P / (w^3 q^2) with
P = w |F| |x| sin(phase) / 2 (Scheel et al. 2018, JSV 435:56). At constant response amplitude these polynomials hold for
all lines (Arslan, Aykan and Ozguven 2011); at constant force only for those about the resonance.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

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


@dataclass(frozen=True)
class _Resonance:
    """One level: natural frequency [Hz], modal mass [kg], loss 2 zeta m w_r^2 [N/m], std, amplitude, force [N].

    ``turned`` : the response was counted against the force.
    """

    frequency: float
    frequency_std: float
    mass: float
    mass_std: float
    loss: float
    loss_std: float
    amplitude: float
    force: float
    turned: bool


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
    read: list[_Resonance] = []
    for level in levels:
        findings += _not_constant(level)
        resonance = _resonance(level)
        if isinstance(resonance, Finding):
            findings.append(resonance)
        else:
            read.append(resonance)
            findings += _turned(level) if resonance.turned else []
    if not read:
        raise InputError(
            "no level holds a resonance",
            where=name,
            got="; ".join(finding.message for finding in findings),
            expected="lines to both sides of the frequency at which force and displacement are in quadrature",
        )
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


def _resonance(level: SteppedLevel) -> _Resonance | Finding:
    """The resonance of a level, or why it has none."""
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
    some = _about(level, int(crossings[0]))
    centre, scale = float(squared[crossings[0]]), float(np.ptp(squared[some]))
    x = (squared - centre) / scale
    real, real_covariance = _polynomial(x[some], stiffness.real[some])
    imaginary, imaginary_covariance = _polynomial(x[some], stiffness.imag[some])
    roots = np.roots(real[::-1])
    root = float(np.real(roots[np.argmin(np.abs(roots - x[crossings[0]]))]))
    row = root ** np.arange(3)
    slope = float(real[1] + 2 * real[2] * root)
    angular = float(np.sqrt(centre + scale * root))
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
        amplitude=float(np.interp(frequency, level.frequencies, np.abs(level.response))),
        force=float(np.interp(frequency, level.frequencies, level.force)),
        turned=turned,
    )


def _about(level: SteppedLevel, crossing: int) -> Bool[np.ndarray, "line"]:
    """The lines for which one amplitude stands: all of a response-controlled level, else those about the resonance."""
    height = np.abs(level.response)
    if level.control == "response" and height.max() / height.min() - 1 <= _HELD:
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
