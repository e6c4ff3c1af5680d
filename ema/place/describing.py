"""The secant stiffness of a friction law under harmonic motion, as a table."""

from functools import lru_cache

import numpy as np
from jaxtyping import Complex

from ema.contact.catalogue import knows_velocities
from ema.data import FrictionLaw
from ema.errors import InputError
from ema.simulate import loop

START, END, SIZE = np.log(1e-3), np.log(1e4), 641
STEP = (END - START) / (SIZE - 1)


@lru_cache(maxsize=16)
def secant_table(name: str, parameters: tuple[tuple[str, float], ...]) -> Complex[np.ndarray, "amplitude"]:
    """First harmonic of the force over that of the displacement, over k_T, for amplitudes A k_T / F_C from 1e-3 to 1e4.

    Real part elastic, imaginary part dissipative; evenly spaced in the logarithm.

    Raises
    ------
    InputError : the law depends on velocity, or is rigid.
    """
    if knows_velocities(name):
        raise InputError(
            "the predictor takes no law that depends on velocity",
            where=f"law {name}",
            got=name,
            expected="a law that depends on displacements alone, as all others do",
            advice="rank with Dahl, and check the shortlist with LuGre in ema.simulate",
        )
    amplitudes = np.exp(np.linspace(START, END, SIZE))
    from ema.contact.iwan import springs_of
    from ema.simulate.friction import PIECEWISE_LINEAR

    if name in PIECEWISE_LINEAR:
        stiffness, force = springs_of(FrictionLaw(name, 1.0, 1.0, parameters))
        ratios = amplitudes[:, None] * stiffness / np.maximum(force, 1e-300)
        return np.asarray(masing_secant(ratios) @ stiffness)
    law = FrictionLaw(name, 1.0, 1.0, parameters)
    coarse = np.arange(0, SIZE, 8)
    values = np.array([_first_harmonic(law, a) for a in amplitudes[coarse]])
    fine = np.arange(SIZE)
    from scipy.interpolate import PchipInterpolator

    return np.asarray(PchipInterpolator(coarse, values.real)(fine) + 1j * PchipInterpolator(coarse, values.imag)(fine))


def masing_secant(ratios: np.ndarray) -> np.ndarray:
    """Closed form for a Masing spring at amplitudes in units of its slip limit (describing function)."""
    y = np.minimum(1 / np.maximum(ratios, 1e-300), 1.0)
    theta = np.arccos(1 - 2 * y)
    return np.asarray((theta - np.sin(2 * theta) / 2) / np.pi + 4j * y * (1 - y) / np.pi)


def _first_harmonic(law: FrictionLaw, amplitude: float) -> complex:
    cycle = loop(law, 1.0, amplitude, 1024)
    angle = 2 * np.pi * np.arange(1024) / 1024
    return complex(2 / (1024 * amplitude) * np.sum(cycle.forces[:-1] * np.exp(-1j * angle)))
