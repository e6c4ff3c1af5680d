"""Which modes, FRFs and other parts of a thing are drawn: by position, and only those that it has."""

from collections.abc import Sequence

import numpy as np

from ema.data import FrfSet, Geometry, ModalModel
from ema.errors import InputError


def chosen_modes(model: ModalModel, modes: Sequence[int] | None, most: int) -> list[int]:
    """Positions of the modes to draw; the first ones by default.

    Raises
    ------
    InputError : the model has no mode at a position.
    """
    count = len(model.poles)
    chosen = list(range(min(most, count))) if modes is None else list(modes)
    check_positions("mode", chosen, count, where=model.name)
    return chosen


def check_frfs(sets: Sequence[FrfSet], places: Sequence[tuple[int, int]]) -> None:
    """Compare positions (output, input) with the FRFs that each set has.

    Raises
    ------
    InputError : a set has no FRF at a position.
    """
    for frfs, place in zip(sets, places, strict=True):
        for what, position, dofs in zip(("output", "input"), place, (frfs.outputs, frfs.inputs), strict=True):
            check_positions(what, [position], len(dofs), where=frfs.name)


def check_located(geometry: Geometry) -> None:
    """Refuse a geometry with nodes that lie nowhere.

    Raises
    ------
    InputError : coordinates are not finite.
    """
    known = np.isfinite(geometry.xyz).all(axis=1)
    if not known.all():
        raise InputError(
            "nodes without finite coordinates cannot be drawn",
            where=geometry.name,
            got=", ".join(map(str, geometry.nodes[~known][:5])),
            expected="three finite coordinates [m] for every node",
        )


def check_positions(what: str, positions: Sequence[int], count: int, *, where: str, first: int = 0) -> None:
    """Compare positions with the number of things there are; the first of them may be 0 or 1.

    Raises
    ------
    InputError : there is nothing at a position.
    """
    if any(not first <= position < first + count for position in positions):
        raise InputError(
            f"there is no such {what}",
            where=where,
            got=", ".join(map(str, positions)),
            expected=f"{first} to {first + count - 1}" if count else f"nothing, since there is no {what}",
        )
