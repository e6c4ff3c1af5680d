"""Kinematics of the interface, from the motion of the middle layers (Gaul, Roseira and Becker 2008, Eqs. 2-3)."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ema.data import Joint
from ema.dof import Dof
from ema.errors import InputError

_ROTATION = {"X": "-RY", "Y": "+RX"}
"""phi = slope of w along the direction, as a rotation of a right-handed frame."""


Parts = tuple[Sequence[Dof], Sequence[Dof], int, int]
"""DOFs of host and beam, place of the beam's first DOF, number of all DOFs."""


def _rows(joint: Joint, parts: Parts, *terms: tuple[str, float, float]) -> Float[np.ndarray, "pair n"]:
    """Rows of every pair: multiples of the motion in each direction, at the node of the host and that of the beam."""
    host, beam, offset, size = parts
    rows = np.zeros((len(joint.pairs), size))
    for row, pair in zip(rows, joint.pairs, strict=True):
        for direction, *values in terms:
            for node, dofs, first, value in zip(pair, (host, beam), (0, offset), values, strict=True):
                if value:
                    place, sign = _place(joint, node, direction, dofs)
                    row[first + place] += value * sign
    return rows


def _place(joint: Joint, node: int, direction: str, dofs: Sequence[Dof]) -> tuple[int, int]:
    """Place of a DOF of a node, and whether it points in a direction (1) or against it (-1)."""
    for place, dof in enumerate(dofs):
        if dof.node == node and dof.axis == direction.lstrip("+-"):
            return place, dof.sign * (-1 if direction.startswith("-") else 1)
    raise InputError(
        "a DOF that the joint needs is missing",
        where=f"joint {joint.name}",
        got=f"node {node} without {direction}",
        expected="translations and rotations at both nodes of every pair",
        advice="measured shapes: expand them to rotations first (ema.shapes.expand)",
    )


def tangential_rows(joint: Joint, direction: str, parts: Parts) -> Float[np.ndarray, "pair n"]:
    """Rows B of u = B x for one tangential direction: u = u2 + h2 phi2 - u1 + h1 phi1 (Eq. 2).

    With U = u - zeta phi on every layer, the interface is at +h1 of the host and at -h2 of the beam above it. A half
    height of zero needs no rotation.

    Raises
    ------
    InputError : the direction is neither X nor Y, a DOF is missing.
    """
    if direction not in _ROTATION:
        raise InputError("not a tangential direction", where=f"joint {joint.name}", got=direction, expected="X or Y")
    return _rows(joint, parts, (direction, -1.0, 1.0), (_ROTATION[direction], *joint.half_heights))


def normal_rows(joint: Joint, parts: Parts) -> Float[np.ndarray, "pair n"]:
    """Rows of the gap w2 - w1 of every pair."""
    return _rows(joint, parts, ("+Z", -1.0, 1.0))


def rocking_rows(joint: Joint, parts: Parts) -> Float[np.ndarray, "pair n"]:
    """Rows of the relative rotation of beam and host about the axis across the first tangential direction.

    Raises
    ------
    InputError : a DOF is missing.
    """
    return _rows(joint, parts, (_ROTATION[joint.directions[0]], -1.0, 1.0))
