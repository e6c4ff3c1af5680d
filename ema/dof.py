"""Degrees of freedom as test engineers write them: ``12:+Z``."""

import re
from collections.abc import Iterable
from dataclasses import dataclass

from ema.errors import InputError

_AXES = ("X", "Y", "Z", "RX", "RY", "RZ")
SCALAR = "S"
DIRECTIONS: tuple[str, ...] = (SCALAR, *(sign + axis for axis in _AXES for sign in "+-"))
"""Allowed directions: the scalar ``S`` and ``+X -X ... +RZ -RZ``."""

_TEXT = re.compile(
    r"^\s*(?:(?P<part>[^:]*[^:\d\s][^:]*):)?\s*(?P<node>\d+)\s*:?\s*(?P<sign>[+-]?)(?P<axis>R?[XYZ]|S)?\s*$", re.I
)


@dataclass(frozen=True, order=True, slots=True)
class Dof:
    """One measured direction at one node of the structure.

    ``direction`` is ``+X -X ... +RZ -RZ`` in the node's local axes (``Geometry.axes``), or ``S`` for a scalar.
    """

    node: int
    direction: str = SCALAR
    part: str = ""

    def __post_init__(self) -> None:
        if self.direction not in DIRECTIONS:
            raise InputError(
                "unknown direction of a DOF", got=repr(self.direction), expected="one of " + " ".join(DIRECTIONS)
            )

    @classmethod
    def parse(cls, text: "str | Dof") -> "Dof":
        """Read ``12:+Z``, ``12Z``, ``12+Z``, ``12`` (scalar) or ``table:12:-RX``.

        Raises
        ------
        InputError : the text names no DOF.
        """
        if isinstance(text, Dof):
            return text
        found = _TEXT.match(text)
        if found is None:
            raise InputError("not a DOF", got=repr(text), expected="node:direction such as 12:+Z")
        axis = (found["axis"] or SCALAR).upper()
        direction = SCALAR if axis == SCALAR else (found["sign"] or "+") + axis
        return cls(int(found["node"]), direction, (found["part"] or "").strip())

    @classmethod
    def from_uff(cls, node: int, code: int, part: str = "") -> "Dof":
        """From the node and direction code of a universal file (0 scalar, +-1..3 translation, +-4..6 rotation)."""
        if not -6 <= code <= 6:
            raise InputError("unknown UFF direction code", got=code, expected="-6 ... 6")
        return cls(node, SCALAR if code == 0 else ("+" if code > 0 else "-") + _AXES[abs(code) - 1], part)

    @property
    def uff_direction(self) -> int:
        """Direction code of a universal file."""
        return 0 if self.direction == SCALAR else self.sign * (_AXES.index(self.direction[1:]) + 1)

    @property
    def sign(self) -> int:
        """+1 or -1."""
        return -1 if self.direction.startswith("-") else 1

    @property
    def axis(self) -> str:
        """``X`` ... ``RZ`` or ``S``: the direction without its sign."""
        return self.direction.lstrip("+-")

    @property
    def positive(self) -> "Dof":
        """The same DOF in its positive direction."""
        return Dof(self.node, self.direction.replace("-", "+"), self.part)

    def reversed(self) -> "Dof":
        """The same DOF in the opposite direction (a scalar stays itself)."""
        flipped = {"+": "-", "-": "+"}
        return Dof(self.node, flipped.get(self.direction[0], self.direction[0]) + self.direction[1:], self.part)

    def __str__(self) -> str:
        prefix = f"{self.part}:" if self.part else ""
        return f"{prefix}{self.node}:{self.direction}"


def match(wanted: Iterable[Dof], present: Iterable[Dof]) -> list[tuple[int, int, int]]:
    """Pair DOFs that measure the same direction, whatever their sign.

    Returns ``(index in wanted, index in present, sign)`` for every DOF of ``wanted`` found in ``present``; the sign is
    -1 where the two point in opposite directions.
    """
    places = {dof.positive: (index, dof.sign) for index, dof in enumerate(present)}
    pairs = []
    for index, dof in enumerate(wanted):
        if dof.positive in places:
            other, sign = places[dof.positive]
            pairs.append((index, other, sign * dof.sign))
    return pairs
