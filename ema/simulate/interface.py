"""Kinematics of the interface, from the motion of the middle layers (Gaul, Roseira and Becker 2008, Eqs. 2-3)."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ema.data import Joint
from ema.dof import Dof
from ema.errors import InputError

_ROTATION = {"X": "-RY", "Y": "+RX"}
"""phi = slope of w along the direction, as a rotation of a right-handed frame."""


def _entry(
    row: np.ndarray, node: int, direction: str, dofs: Sequence[Dof], offset: int, value: float, joint: str
) -> None:
    for place, dof in enumerate(dofs):
        if dof.node == node and dof.axis == direction.lstrip("+-"):
            wanted = -1 if direction.startswith("-") else 1
            row[offset + place] += value * wanted * dof.sign
            return
    raise InputError(
        "a DOF that the joint needs is missing",
        where=f"joint {joint}",
        got=f"node {node} without {direction}",
        expected="translations and rotations at both nodes of every pair",
        advice="measured shapes: expand them to rotations first (ema.shapes.expand)",
    )


def tangential_rows(
    joint: Joint, direction: str, host: Sequence[Dof], beam: Sequence[Dof], offset: int, size: int
) -> Float[np.ndarray, "pair n"]:
    """Rows B of u = B x for one tangential direction: u = u2 + h2 phi2 - u1 + h1 phi1 (Eq. 2).

    With U = u - zeta phi on every layer, the interface is at +h1 of the host and at -h2 of the beam above it. A half
    height of zero needs no rotation.

    Raises
    ------
    InputError : the direction is neither X nor Y, a DOF is missing.
    """
    if direction not in _ROTATION:
        raise InputError("not a tangential direction", where=f"joint {joint.name}", got=direction, expected="X or Y")
    lower, upper = joint.half_heights
    rows = np.zeros((len(joint.pairs), size))
    for row, (node1, node2) in zip(rows, joint.pairs, strict=True):
        _entry(row, node2, direction, beam, offset, 1.0, joint.name)
        _entry(row, node1, direction, host, 0, -1.0, joint.name)
        if upper:
            _entry(row, node2, _ROTATION[direction], beam, offset, upper, joint.name)
        if lower:
            _entry(row, node1, _ROTATION[direction], host, 0, lower, joint.name)
    return rows


def normal_rows(
    joint: Joint, host: Sequence[Dof], beam: Sequence[Dof], offset: int, size: int
) -> Float[np.ndarray, "pair n"]:
    """Rows of the gap w2 - w1 of every pair."""
    rows = np.zeros((len(joint.pairs), size))
    for row, (node1, node2) in zip(rows, joint.pairs, strict=True):
        _entry(row, node2, "+Z", beam, offset, 1.0, joint.name)
        _entry(row, node1, "+Z", host, 0, -1.0, joint.name)
    return rows


def rocking_rows(
    joint: Joint, host: Sequence[Dof], beam: Sequence[Dof], offset: int, size: int
) -> Float[np.ndarray, "pair n"]:
    """Rows of the relative rotation of beam and host about the axis across the first tangential direction.

    Raises
    ------
    InputError : a DOF is missing.
    """
    turn = _ROTATION[joint.directions[0]]
    rows = np.zeros((len(joint.pairs), size))
    for row, (node1, node2) in zip(rows, joint.pairs, strict=True):
        _entry(row, node2, turn, beam, offset, 1.0, joint.name)
        _entry(row, node1, turn, host, 0, -1.0, joint.name)
    return rows
