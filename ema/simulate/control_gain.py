"""What a controlled normal force brings: ring-downs after a release, and what is left of vibration at a tool point."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ema.data import BeamModel, ControlLine, CuttingLimits, ModalModel, Response
from ema.dof import Dof
from ema.errors import InputError
from ema.progress import Progress, advance, silent
from ema.simulate.checks import positive
from ema.simulate.control import (
    Actuator,
    AmplitudeScheduled,
    ControlLaw,
    ReleasePulse,
    constant,
    controlled_snapback,
)
from ema.simulate.reduction import modal_base
from ema.simulate.steady_states import frf
from ema.simulate.structure import assemble

PERIODS = 60.0
"""Length of a ring-down in periods of the mode."""
SAMPLES_PER_PERIOD = 16
"""Samples of the controller within a period of the mode."""
WORTH = 0.1
"""Share of the energy integral of the best constant force that control has to save to be said to bring something."""
_STEPS_PER_PERIOD = 320
"""Time steps within a period of the mode."""
_SWAY = 0.1
"""Frequency of a mode over that of the mode in question below which it is a sway on the suspension."""
_REFINED = 11
"""Lines over two steps of the grid, about the one with the least real part."""
_BEYOND = 4
"""Half-power half-widths above a mode up to which its least real part is sought: of a mode alone it is at one."""


def without_sway(model: BeamModel, frequency: float) -> BeamModel:
    """The model without the modes of a measured host far below a frequency in Hz.

    A freely hung structure sways long after a static load is let go; that energy says nothing about the joints.
    """
    host = model.host
    if not isinstance(host, ModalModel):
        return model
    keep = np.flatnonzero(np.abs(host.poles) >= 2 * np.pi * _SWAY * frequency)
    left = replace(
        host,
        poles=host.poles[keep],
        shapes=host.shapes[:, keep],
        participation=host.participation[:, keep],
        covariance=None if host.covariance is None else host.covariance[keep],
        confidence=None,
        uncertainty=None,
        groups=(),
        candidates=(),
    )
    return replace(model, host=left)


def ring_downs(
    model: BeamModel,
    load: float,
    at: Dof | str,
    frequency: float,
    *,
    normal_forces: Sequence[float],
    lag: float | None = None,
    progress: Progress = silent,
) -> tuple[ControlLine, ...]:
    """Simulate ring-downs under constant, scheduled and pulsed normal force; of each law the best.

    The structure is bent by a static load and released. Every law is tried at every normal force and shown with the one
    whose energy is gone first (least integral of E/E0). The scheduled force follows the amplitude at the last turning
    point, so that the slip force stays just below the one that sticks; the pulse releases the joints for a twelfth of a
    period at the turning points, so that what the joints store is not given back.

    Parameters
    ----------
    model : BeamModel
        The structure; the normal force of its first joint is that of every run while the load is raised.
    load : float
        Static load [N].
    at : Dof or str
        DOF of the load and of the sensor.
    frequency : float
        Natural frequency [Hz] that sets the time scale: 60 periods, 16 samples of the controller in each.
    normal_forces : sequence of float
        Normal forces of every joint [N] that are tried.
    lag : float, optional
        Time [s] from measuring to acting; a twentieth of the period by default.
    progress : Progress, optional
        Called before each ring-down.

    Returns
    -------
    tuple of ControlLine
        The best constant force first, then the best of every law.

    Raises
    ------
    InputError
        If the load, the frequency or a force is not positive.

    References
    ----------
    .. [1] Schedule "just before sticking": after Gaul, Roseira and Becker (2008), Shock and Vibration 15:291.
    .. [2] Release pulse: Dupont, Kasturi and Stokes (1997), Journal of Sound and Vibration 202:203.

    Examples
    --------
    >>> from ema.examples import beam_model
    >>> lines = ring_downs(beam_model(), 60.0, "1:+X", 65.0, normal_forces=[50.0, 100.0])
    >>> [line.law for line in lines]
    ['constant', 'scheduled with the amplitude', 'released at turning points']
    """
    positive(model.name, load=load, frequency=frequency)
    if not len(normal_forces):
        raise InputError("no normal force to try", where=model.name, got="none", expected="one or more, in N")
    for force in normal_forces:
        positive(model.name, normal_force=force)
    period = 1 / frequency
    actuator = Actuator(period / SAMPLES_PER_PERIOD, period / 20 if lag is None else lag)
    release = _Release(load, Dof.parse(at), period, actuator)
    start = release.amplitude(model)
    kinds: dict[str, Callable[[float], ControlLaw]] = {
        "constant": constant,
        "scheduled with the amplitude": lambda force: AmplitudeScheduled(force, start, shortest=period / 4),
        "released at turning points": lambda force: ReleasePulse(force, period / 12, shortest=period / 4),
    }
    lines, total = [], len(kinds) * len(normal_forces)
    for number, (name, law) in enumerate(kinds.items()):
        found = []
        for count, force in enumerate(normal_forces):
            advance(progress, "control study", number * len(normal_forces) + count, total)
            found.append(_line(name, float(force), release.ring_down(model, law(float(force))), period))
        lines.append(min(found, key=lambda line: line.energy))
    return tuple(lines)


def release_statement(lines: Sequence[ControlLine]) -> str:
    """Say in one sentence what the best controlled normal force leaves after a release, over the best constant one.

    Parameters
    ----------
    lines : sequence of ControlLine
        As :func:`ring_downs` returns them, the constant force first.

    Returns
    -------
    str
        The sentence, without its full stop.

    Examples
    --------
    >>> line = ControlLine("constant", 50.0, 0.02, 0.1, 0.2, np.zeros(1), np.ones(1))
    >>> release_statement([line, replace(line, law="released at turning points", energy=0.01)])[:60]
    'After a release, a normal force released at turning points ('
    """
    best = min(lines[1:], key=lambda line: line.energy)
    gain = 1 - best.energy / lines[0].energy
    if gain > WORTH:
        statement = (
            f"After a release, a normal force {best.law} (up to {best.force:.3g} N) removes the vibration energy with "
            f"{gain:.0%} less of its integral over time than the best constant force of {lines[0].force:.3g} N"
        )
    else:
        statement = (
            f"After a release, no controlled force removes the energy by more than {WORTH:.0%} sooner than the best "
            f"constant one of {lines[0].force:.3g} N"
        )
    if np.isfinite(best.to_two):
        constant = f"{1e3 * lines[0].to_two:.3g} ms" if np.isfinite(lines[0].to_two) else "longer than the run"
        statement += f"; to 2 % of the amplitude it takes {1e3 * best.to_two:.3g} ms instead of {constant}"
    return statement


@dataclass(frozen=True)
class _Release:
    """A snap-back test: a static load [N] at a DOF is let go, while an actuator sets the normal force.

    ``period`` is that of the mode [s].
    """

    load: float
    at: Dof
    period: float
    actuator: Actuator

    def ring_down(self, model: BeamModel, law: ControlLaw, *, periods: float = PERIODS) -> Response:
        """The motion after the release under a control law, from the normal force of the model's first joint."""
        return controlled_snapback(
            model,
            law,
            self.load,
            self.at,
            periods * self.period,
            self.actuator,
            step=self.period / _STEPS_PER_PERIOD,
            start_force=model.joints[0].normal_force,
            check=False,
        )

    def amplitude(self, model: BeamModel) -> float:
        """Displacement of the DOF half a period after the release: the static part of other modes is gone."""
        run = self.ring_down(model, constant(model.joints[0].normal_force), periods=2.0)
        return float(np.abs(run.displacements[0, SAMPLES_PER_PERIOD // 4 :]).max())


def _line(name: str, force: float, run: Response, period: float) -> ControlLine:
    """Energy integral and times of a ring-down; the amplitude is the root of the largest energy still to come."""
    times, energy = np.asarray(run.times), np.asarray(run.energy.total / run.energy.total[0])
    ahead = np.sqrt(np.maximum.accumulate(energy[::-1])[::-1])

    def below(share: float) -> float:
        under = np.flatnonzero(ahead < share)
        return float(times[under[0]]) if len(under) else float("nan")

    thin = slice(None, None, SAMPLES_PER_PERIOD // 4)
    return ControlLine(
        name, force, float(np.trapezoid(energy, times)), below(0.05), below(0.02), times[thin], energy[thin]
    )


def cutting_limits(
    model: BeamModel,
    at: Dof | str,
    force_levels: Sequence[float],
    normal_forces: Sequence[float],
    band: tuple[float, float],
    *,
    specific_force: float = 2e9,
    progress: Progress = silent,
) -> CuttingLimits:
    """Compute the depth of cut at which chatter persists at a tool point, and the amplitude of forced vibration there.

    Regenerative chatter in one direction, one cutting edge: a vibration X persists where the force that the waves of
    two passes make, K_s b X (1 - exp(-i w T)), is the one that moves the structure by X = G F. At the worst spindle
    speed that is b = -1 / (2 K_s min Re G). With friction joints G is the describing function at the amplitude of the
    force: the depth is that at which chatter of this amplitude persists. At the lowest level all joints stick, and it
    is the depth at which chatter begins; where it is larger at a higher level, the chatter stays small.

    Parameters
    ----------
    model : BeamModel
        The structure.
    at : Dof or str
        Tool point and direction of the cutting force.
    force_levels : sequence of float
        Amplitudes of the cutting force [N].
    normal_forces : sequence of float
        Normal forces of every joint [N].
    band : (float, float)
        Frequencies [Hz] of the resonance that limits the cut.
    specific_force : float, default 2e9
        Cutting force over the area of the chip, K_s [Pa]; 2000 N/mm2 is a common value for steel. Ratios of depths do
        not depend on it.
    progress : Progress, optional
        Called during the computation.

    Returns
    -------
    CuttingLimits
        Depths, amplitudes and frequencies.

    Raises
    ------
    InputError
        If a force, the specific force or the band is not positive, or the receptance is most negative at an end of it.

    References
    ----------
    .. [1] Altintas (2012), Manufacturing Automation, 2nd ed., Cambridge University Press, chapter 4 (chatter in
       orthogonal cutting, after Tobias and Tlusty).

    Examples
    --------
    >>> from ema.examples import beam_model
    >>> limits = cutting_limits(beam_model(), "1:+X", [1.0], [100.0, 1e4], (40.0, 120.0))
    >>> limits.depth.shape
    (1, 2)
    """
    low, high = band
    positive(model.name, specific_force=specific_force, band=low, width=high - low)
    shape = len(force_levels), len(normal_forces)
    depth, amplitude, frequency = (np.full(shape, np.nan) for _ in range(3))
    lines = np.linspace(low, high, _lines(band))
    for column, force in enumerate(normal_forces):
        pressed = model.with_normal_force(float(force))
        for row, level in enumerate(force_levels):
            advance(progress, "tool point", column * shape[0] + row, shape[0] * shape[1])
            coarse = _receptance(pressed, lines, float(level), at)
            top, least = int(np.argmax(np.abs(coarse))), int(np.argmin(coarse.real))
            step = lines[1] - lines[0]
            near = [np.linspace(lines[k] - step, lines[k] + step, _REFINED) for k in (top, least)]
            highest, lowest = (_receptance(pressed, fine, float(level), at) for fine in near)
            if least in (0, len(lines) - 1):
                raise InputError(
                    "the receptance is most negative at an end of the band",
                    where=f"{model.name}, F_E {level:g} N, F_N {force:g} N",
                    got=f"{lines[least]:.4g} Hz",
                    expected="a resonance that limits the cut, inside the band",
                    advice="move or widen the band; below a resonance the one before it may limit the cut",
                )
            real = float(lowest.real.min())
            amplitude[row, column] = level * float(np.abs(highest).max())
            depth[row, column] = -1 / (2 * specific_force * real) if real < 0 else np.inf
            frequency[row, column] = near[1][int(lowest.real.argmin())]
    return CuttingLimits(np.array(force_levels), np.array(normal_forces), depth, amplitude, frequency)


def sticking_limit(
    model: BeamModel, at: Dof | str, frequency: float, specific_force: float = 2e9
) -> tuple[float, float]:
    """Compute the depth of cut at which chatter begins with sticking joints, whatever resonance it is of.

    Chatter below a tenth of ``frequency``, in the sway of a freely hung structure, is left out.

    Parameters
    ----------
    model : BeamModel
        The structure.
    at : Dof or str
        Tool point and direction of the cutting force.
    frequency : float
        Frequency [Hz] of the resonance in question.
    specific_force : float, default 2e9
        Cutting force over the area of the chip, K_s [Pa].

    Returns
    -------
    tuple of (float, float)
        Depth [m], -1 / (2 K_s min Re G) over all modes, and the frequency [Hz] of the chatter; 0 at a mode without
        damping, infinity where nothing moves.

    Raises
    ------
    InputError
        If the frequency or the specific force is not positive.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from ema.data import Damping
    >>> from ema.examples import beam_model
    >>> depth, frequency = sticking_limit(replace(beam_model(), damping=Damping(0.01)), "1:+X", 65.0)
    >>> depth > 0
    True
    """
    positive(model.name, frequency=frequency, specific_force=specific_force)
    system = assemble(model)
    base = modal_base(system)
    row, damping = base.row(system, at), np.diag(base.decay) if base.damping is None else base.damping
    seen = (base.frequencies > 2 * np.pi * _SWAY * frequency) & (np.abs(row) > 0)
    if not seen.any():
        return np.inf, np.nan
    undamped = seen & ~(base.decay > 0)
    if undamped.any():
        return 0.0, float(base.frequencies[undamped].min() / (2 * np.pi))
    # Re G of one mode is least at 1 + zeta times its frequency
    near = np.linspace(0.0, _BEYOND, _BEYOND * _REFINED)
    omega = np.sort((base.frequencies[seen, None] + np.outer(0.5 * base.decay[seen], near)).ravel())
    real = np.array([_modal_receptance(base.frequencies, damping, row, one).real for one in omega])
    least = int(real.argmin())
    depth = -1 / (2 * specific_force * real[least]) if real[least] < 0 else np.inf
    return float(depth), float(omega[least] / (2 * np.pi))


def _modal_receptance(frequencies: np.ndarray, damping: np.ndarray, row: np.ndarray, omega: float) -> complex:
    """Drive-point receptance [m/N] at ``omega`` rad/s of mass-normalised modes that damping may couple."""
    matrix = np.diag(frequencies**2 - omega**2) + 1j * omega * damping
    return complex(row @ np.linalg.solve(matrix, row))


def _lines(band: tuple[float, float]) -> int:
    """Lines of the coarse grid: 0.2 % apart, so that a resonance of 0.3 % damping has three within its width."""
    return int(np.ceil(np.log(band[1] / band[0]) / 0.002)) + 2


def _receptance(model: BeamModel, lines: np.ndarray, level: float, at: Dof | str) -> np.ndarray:
    """Drive-point receptance [m/N], first harmonic."""
    run = frf(model, lines, level, at, [at])
    return np.asarray(run.values[:, 0, list(run.orders).index(1)]) / level
