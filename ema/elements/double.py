"""The double beam of Gaul, Roseira and Becker (2008), Fig. 1."""

import numpy as np
from jaxtyping import Float

from ema.data import BeamModel, Damping, FrictionLaw, Joint
from ema.elements.beams import beam

NO_DAMPING = Damping()


def double_beam(
    law: FrictionLaw,
    normal_force: float,
    length: float = 0.5,
    width: float = 0.04,
    height: float = 0.005,
    youngs_modulus: float = 210e9,
    density: float = 7850.0,
    elements: int = 20,
    normal_stiffness: float = 1e9,
    force_shares: Float[np.ndarray, "pair"] | None = None,
    damping: Damping = NO_DAMPING,
) -> BeamModel:
    """Two equal clamped-free beams pressed together at every node (Gaul, Roseira and Becker 2008, Fig. 1).

    Beam 1 is the host and lies below beam 2. The defaults are a reference set: L 0.5 m, 40 x 5 mm each, steel, 20
    elements. ``normal_force`` N, ``normal_stiffness`` N/m and the contact stiffness of ``law`` are those of the whole
    interface; a node pair has the area of one element, the tip that of half an element. The tip is node ``elements`` of
    the parts ``beam 1`` and ``beam 2``.
    """
    lower, upper = (
        beam(length, width, height, youngs_modulus, density, elements, part=f"beam {number}") for number in (1, 2)
    )
    elements = int(elements)
    pairs = tuple((node, node) for node in range(1, elements + 1))
    areas = np.append(np.ones(elements - 1), 0.5)
    joint = Joint(
        "interface",
        pairs,
        (height / 2, height / 2),
        law,
        normal_force,
        normal_stiffness,
        force_shares,
        area_shares=areas / areas.sum(),
    )
    return BeamModel(lower, upper, (joint,), damping, "double beam", pair_spacing=length / elements)
