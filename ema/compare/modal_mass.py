"""Modal mass from impacts on points with an accelerometer: initial velocity, decay integrated back to the impact."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ema.compare.modal_decays import ModalDecays
from ema.compare.slip_onset import Onset

AGREE = 0.05
"""Half width of the interval, relative, up to which a modal mass is stated: what is asked of it. Halved, that of the
bare work table is still stated; doubled, two that slip has spoilt by 8 % would be."""
LEAST = 0.01
"""Half width that a modal mass has at least: calibration and the foot of the force."""
_POWER = {"displacement": 0, "velocity": 1, "acceleration": 2}
_STEPS = 200
"""Steps of the integration of an amplitude over time."""
_WINDOW = 1
"""The window that is taken back: in the first one filters and the foot of the force still ring."""


@dataclass(frozen=True)
class Mass:
    """A modal mass for a shape of 1 at the response at which the mode is largest.

    Parameters
    ----------
    value, half : float
        Modal mass and half width of its 95 % interval [kg]; NaN where it is withheld.
    reason : str
        Why it is withheld.
    cut : bool
        Whether it is withheld because a force window closed within the contacts.

    Examples
    --------
    >>> Mass(30.0, 0.5).reason
    ''
    """

    value: float = float("nan")
    half: float = float("nan")
    reason: str = ""
    cut: bool = False


def modal_mass(
    decays: ModalDecays,
    mode: int,
    curve: tuple[Float[np.ndarray, "level"], Float[np.ndarray, "level"], Float[np.ndarray, "level"]],
    onset: Onset,
    kind: str,
) -> Mass:
    """Modal mass by impulse over initial velocity at every impact on a response.

    m = |J| |phi_o| / (w x0) with the Laplace transform J of the force at the pole, the shape phi_o at the response
    over that at the reference, and the amplitude x0 at the reference right behind the impact: that of the second
    window, taken back with -a' / a = zeta(a) w(a).

    Parameters
    ----------
    decays : ModalDecays
        Modal coordinates of the hammer test.
    mode : int
        The mode.
    curve : tuple of (array, array, array)
        Amplitudes, lowest first, with frequency [Hz] and damping ratio.
    onset : Onset
        Whether the mode depends on its amplitude.
    kind : {"displacement", "velocity", "acceleration"}
        Quantity of the responses.

    Returns
    -------
    Mass
        The modal mass, or why it is withheld. Where slip is seen, two responses that were struck have to agree: slip
        within the contact and the first cycles leaves no trace in a single one.

    Examples
    --------
    >>> from ema.compare.amplitude_resolved import ring_down_modes  # states it as the modal mass of every mode
    """
    omega = abs(decays.poles[mode].imag)
    struck = [(dof.node, dof.axis) for dof in decays.inputs]
    sensors = [(dof.node, dof.axis) for dof in decays.outputs]
    values: dict[int, list[float]] = {}
    for row in np.flatnonzero(decays.at_rest & ~decays.cut):
        for column, sensor in enumerate(sensors):
            if struck[row] == sensor:
                start = _back(
                    float(np.abs(decays.amplitudes[row, _WINDOW, mode])), float(decays.times[row, _WINDOW]), curve
                )
                moved = start / omega ** _POWER[kind]
                shape = float(np.abs(decays.shapes[mode, column]))
                mass = float(np.abs(decays.forces[row, mode])) * shape / (omega * moved)
                values.setdefault(column, []).append(mass)
    if not values and any(cut and place in sensors for cut, place in zip(decays.cut, struck, strict=True)):
        return Mass(reason="the force window closes while the hammer still presses", cut=True)
    if not values:
        return Mass(reason="no point with an accelerometer was struck")
    means = np.array([np.mean(part) for part in values.values()])
    every = np.concatenate([np.array(part) for part in values.values()])
    half = max(float(np.ptp(means)), 2 * float(np.std(every)), LEAST * float(every.mean()))
    if half > AGREE * every.mean():
        return Mass(
            reason=f"impacts on {len(means)} of the responses give {every.min():.4g} to {every.max():.4g} kg: slip "
            "within the contact takes what it leaves no trace of"
        )
    if onset.seen and len(means) < 2:
        return Mass(reason="one response was struck, which does not show what slip within the contact takes")
    return Mass(float(every.mean()), half)


def _back(
    amplitude: float,
    time: float,
    curve: tuple[Float[np.ndarray, "level"], Float[np.ndarray, "level"], Float[np.ndarray, "level"]],
) -> float:
    """Amplitude ``time`` s before it was ``amplitude``."""
    log, step = float(np.log(amplitude)), time / _STEPS
    levels = np.log(curve[0])
    for _ in range(_STEPS):
        log += step * 2 * np.pi * float(np.interp(log, levels, curve[1]) * np.interp(log, levels, curve[2]))
    return float(np.exp(log))
