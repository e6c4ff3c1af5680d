"""Hysteresis loops: of a law under prescribed motion, and the energy of any loop."""

import numpy as np
from jaxtyping import Bool, Float

from ema.contact.catalogue import knows_velocities
from ema.contact.curves import virgin_rate
from ema.contact.laws import contact_laws
from ema.data import FrictionLaw, Loop
from ema.errors import FailureError, InputError
from ema.simulate.checks import not_negative, positive

_FEWEST = 8
"""Samples of a cycle from which on it is a loop."""
_NODES = 36.0 * np.linspace(0, 1, 161) ** 4
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_POINTS, _WEIGHTS = (_POINTS + 1) / 2, _WEIGHTS / 2


def drive(
    law: FrictionLaw,
    displacements: Float[np.ndarray, "sample"],
    normal_force: float | Float[np.ndarray, "sample"],
    interval: float = 1e-3,
) -> Float[np.ndarray, "sample"]:
    """Friction force in N of one contact that is moved through ``displacements`` (m), from the unstressed state.

    ``normal_force`` N, constant or per sample; ``interval`` s between samples matters to LuGre only.

    Raises
    ------
    InputError : the normal force or mu is negative or not finite, k_T is not positive, or the law is rigid.
    """
    path = np.asarray(displacements, dtype=np.float64)[None]
    force = np.broadcast_to(np.asarray(normal_force, dtype=np.float64), path.shape[1:])
    if not np.all(np.isfinite(force)) or force.min() < 0:
        raise InputError("not a normal force", where=f"law {law.name}", got=f"{force.min()} N", expected="0 N or more")
    if not np.isfinite(law.contact_stiffness):
        raise InputError(
            "a rigid law has no loop of its own",
            where=f"law {law.name}",
            got="infinite stick stiffness",
            expected="a stiffness",
            advice="Coulomb(mu, stick_stiffness=...)",
        )
    where = f"law {law.name}"
    not_negative(where, friction_coefficient=law.friction_coefficient)
    positive(where, contact_stiffness=law.contact_stiffness)
    stiffness = law.contact_stiffness
    if law.stiffness_exponent:
        stiffness *= (float(force[0]) / law.reference_force) ** law.stiffness_exponent
    laws = contact_laws([law], np.array([min(stiffness, law.stiffness_cap)]), [1])
    return np.asarray(laws.drive(path, law.friction_coefficient * force, interval)[0])


def loop(law: FrictionLaw, normal_force: float, amplitude: float, samples: int = 4096, frequency: float = 1.0) -> Loop:
    """Compute the stabilised loop of a law under a harmonic displacement: one cycle after very many.

    Parameters
    ----------
    law : FrictionLaw
        The law.
    normal_force : float
        Normal force [N].
    amplitude : float
        Amplitude of the displacement [m].
    samples : int, default 4096
        Samples per cycle.
    frequency : float, default 1.0
        Frequency [Hz]; it matters to LuGre only.

    Returns
    -------
    Loop
        The loop.

    Raises
    ------
    InputError
        If a number is not positive, or there are fewer than eight samples.
    FailureError
        If the law gives forces that are not finite.

    Examples
    --------
    >>> from ema.simulate import Masing
    >>> cycle = loop(Masing(0.3, 1e8), normal_force=1000.0, amplitude=1e-5)
    >>> round(cycle.area / (4 * 300.0 * (1e-5 - 300.0 / 1e8)), 3)  # 4 F_C (U - F_C / k_T)
    1.0
    """
    where = f"loop of the law {law.name}"
    positive(where, amplitude=amplitude, frequency=frequency)
    if samples < _FEWEST:
        raise InputError(
            "too few samples for a loop", where=where, got=samples, expected=f"{_FEWEST} or more per cycle"
        )
    fine = amplitude * np.sin(np.linspace(0, 2 * np.pi, samples + 1) + np.pi / 2)
    turns = np.tile(fine[:-1], 20) if knows_velocities(law.name) else amplitude * np.resize([1.0, -1.0], 100_000)
    forces = drive(law, np.concatenate([[0.0], turns, fine]), normal_force, 1 / (frequency * samples))[-len(fine) :]
    if not np.all(np.isfinite(forces)):
        raise FailureError(
            "the law gives forces that are not finite",
            where=where,
            got=f"NaN or infinity at {np.sum(~np.isfinite(forces))} of {len(forces)} samples",
            expected="finite forces",
            advice="check the law and its parameters",
        )
    return Loop(
        fine,
        forces,
        enclosed_area(fine, forces),
        amplitude,
        1,
        normal_force,
        np.arange(samples + 1) / (frequency * samples),
        name=law.name,
    )


def enclosed_area(displacements: Float[np.ndarray, "sample"], forces: Float[np.ndarray, "sample"]) -> float:
    """Work in J done on the contact along the path, integral of F du by the trapezoidal rule."""
    return float(np.sum(0.5 * (forces[1:] + forces[:-1]) * np.diff(displacements)))


def stabilised(
    travel: Float[np.ndarray, "sample"],
    falling: Bool[np.ndarray, "sample"],
    amplitude: float,
    parameters: tuple[float, float, float],
    play: float = 0.0,
) -> Float[np.ndarray, "sample"]:
    """Force in N of the stabilised loop of Eq. (5) at ``travel`` m after the last reversal.

    ``parameters``: k_T in N/m, F_C in N and the exponent; ``play`` in m. Elastic to zero, across the play, then along
    the virgin curve, of which one quadrature gives the way at its nodes.
    """
    from scipy.interpolate import CubicHermiteSpline
    from scipy.optimize import brentq

    stiffness, slip_force, exponent = parameters
    unit, steps = slip_force / stiffness, np.diff(_NODES)
    inside = virgin_rate(np.maximum(_NODES[:-1, None] + steps[:, None] * _POINTS, 1e-12), exponent) @ _WEIGHTS
    places = np.concatenate([[0.0], np.cumsum(inside * steps)])
    # in -ln(1 - F/F_C), which is smooth up to full slip
    curve = CubicHermiteSpline(places, _NODES, 1 / virgin_rate(np.maximum(_NODES, 1e-12), exponent))

    def virgin(x: np.ndarray) -> np.ndarray:
        """Force over F_C at way x in F_C/k_T."""
        return np.asarray(np.where(x >= places[-1], 1.0, -np.expm1(-curve(np.minimum(x, places[-1])))))

    whole = max(2 * amplitude - play, 1e-9 * amplitude) / unit
    turn = brentq(lambda way: float(virgin(np.array(way))) + way - whole, 0.0, whole, xtol=1e-16)
    top = float(virgin(np.array(turn)))
    e = travel / unit
    value = np.where(e < top, top - e, -virgin(np.maximum(e - top - play / unit, 0.0)))
    return np.where(falling, slip_force, -slip_force) * value
