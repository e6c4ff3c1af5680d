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
    """Return two equal clamped-free beams pressed together at every node.

    Beam 1 is the host and lies below beam 2. The defaults are a reference set: L 0.5 m, 40 x 5 mm each, steel, 20
    elements. A node pair has the area of one element, the tip that of half an element. The tip is node ``elements`` of
    the parts ``beam 1`` and ``beam 2``.

    Parameters
    ----------
    law : FrictionLaw
        Tangential contact law; its contact stiffness is that of the whole interface.
    normal_force : float
        Normal force of the whole interface [N].
    length, width, height : float, default 0.5
        Dimensions of each beam [m].
    youngs_modulus : float, default 210000000000.0
        Young's modulus [Pa].
    density : float, default 7850.0
        Density [kg/m^3].
    elements : int, default 20
        Number of elements of each beam.
    normal_stiffness : float, default 1000000000.0
        Normal stiffness of the whole interface [N/m].
    force_shares : array of shape (pair,), optional
        Share of each node pair in the normal force; that of the area by default.
    damping : Damping, optional
        Background damping.

    Returns
    -------
    BeamModel
        The model, with one joint called ``interface``.

    References
    ----------
    .. [1] Gaul, Roseira and Becker (2008), Fig. 1.

    Examples
    --------
    >>> model = double_beam(FrictionLaw("masing", friction_coefficient=0.5, contact_stiffness=1e8), normal_force=1000.0)
    >>> len(model.joints[0].pairs), float(model.joints[0].area_shares.sum().round(12))
    (20, 1.0)
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
