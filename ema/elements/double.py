"""The double beam of Gaul, Roseira and Becker (2008), Fig. 1."""

import numpy as np
from jaxtyping import Float

from ema.data import BeamModel, Damping, FrictionLaw, Joint
from ema.deprecation import fields_as_arguments
from ema.elements.beams import Section, beam

NO_DAMPING = Damping()
REFERENCE = Section(length=0.5, width=0.04, height=0.005)
"""One beam of the reference set: steel."""


@fields_as_arguments("section", Section)
def double_beam(
    law: FrictionLaw,
    normal_force: float,
    section: Section = REFERENCE,
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
    section : Section, optional
        Dimensions, material and elements of each beam; those of the reference set by default.
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
    lower, upper = (beam(section, part=f"beam {number}") for number in (1, 2))
    elements = int(section.elements)
    pairs = tuple((node, node) for node in range(1, elements + 1))
    areas = np.append(np.ones(elements - 1), 0.5)
    joint = Joint(
        "interface",
        pairs,
        (section.height / 2, section.height / 2),
        law,
        normal_force,
        normal_stiffness,
        force_shares,
        area_shares=areas / areas.sum(),
    )
    return BeamModel(lower, upper, (joint,), damping, "double beam", pair_spacing=section.length / elements)
