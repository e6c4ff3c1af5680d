"""Masing springs that stand for a piecewise linear law, the four-parameter Iwan model among them."""

import numpy as np
from jaxtyping import Float

from ema.contact.rough import ROUGH, rough_springs
from ema.data import FrictionLaw


def springs_of(law: FrictionLaw) -> tuple[Float[np.ndarray, "spring"], Float[np.ndarray, "spring"]]:
    """Shares of stiffness and of slip force of the Masing springs that make a piecewise linear law."""
    values = dict(law.parameters)
    if law.name == "parallel masing":
        count = len(values) // 2
        return (
            np.array([values[f"stiffness share {n}"] for n in range(count)]),
            np.array([values[f"force share {n}"] for n in range(count)]),
        )
    if law.name in ROUGH:
        return rough_springs(int(values["springs"]), values.get("separation"))
    if law.name in ("iwan", "modified iwan"):
        return iwan_springs(values["chi"], values["beta"], int(values["springs"]))
    return np.ones(1), np.ones(1)


def iwan_springs(
    chi: float, beta: float, count: int
) -> tuple[Float[np.ndarray, "spring"], Float[np.ndarray, "spring"]]:
    """Shares of the Masing springs of an Iwan model: power-law density up to the largest slip, and a spring there.

    Every spring has the stiffness and the slip force of its stretch of the density (Segalman 2005, Eqs. 10-14).
    """
    scale = beta + (chi + 1) / (chi + 2)
    largest = (1 + beta) / scale
    density = (chi + 1) / (largest ** (chi + 2) * scale)
    edges = np.concatenate([[0.0], np.geomspace(3e-4, 1.0, count - 1 if beta > 0 else count)]) * largest
    stiffness = density * np.diff(edges ** (chi + 1)) / (chi + 1)
    force = density * np.diff(edges ** (chi + 2)) / (chi + 2)
    if beta > 0:
        last = beta / scale / largest
        stiffness, force = np.append(stiffness, last), np.append(force, last * largest)
    return stiffness / stiffness.sum(), force / force.sum()
