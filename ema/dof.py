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
    """A measured direction at one node of the structure, printed as ``12:+Z``.

    Parameters
    ----------
    node : int
        Number of the node in the geometry.
    direction : str, optional
        ``+X -X ... +RZ -RZ`` in the node's local axes (``Geometry.axes``), or ``S`` for a scalar.
    part : str, optional
        Component that the node belongs to, where node numbers are not unique without it.

    Raises
    ------
    InputError
        If the direction is none of ``DIRECTIONS``.

    Examples
    --------
    >>> Dof(12, "+Z"), str(Dof(3, "-RX", part="table"))
    (Dof(node=12, direction='+Z', part=''), 'table:3:-RX')
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

        Parameters
        ----------
        text : str or Dof
            What to read; a DOF is returned as it is. A direction without a sign is positive.

        Returns
        -------
        Dof
            The DOF.

        Raises
        ------
        InputError
            If the text names no DOF.

        Examples
        --------
        >>> Dof.parse("12Z") == Dof.parse("12:+Z")
        True
        """
        if isinstance(text, Dof):
            return text
        parsed = _TEXT.match(text)
        if parsed is None:
            raise InputError("not a DOF", got=repr(text), expected="node:direction such as 12:+Z")
        axis = (parsed["axis"] or SCALAR).upper()
        direction = SCALAR if axis == SCALAR else (parsed["sign"] or "+") + axis
        return cls(int(parsed["node"]), direction, (parsed["part"] or "").strip())

    @classmethod
    def from_uff(cls, node: int, code: int, part: str = "") -> "Dof":
        """Return the DOF of a node number and a direction code of a universal file.

        Parameters
        ----------
        node : int
            Number of the node.
        code : int
            0 for a scalar, +-1 to +-3 for translations, +-4 to +-6 for rotations along and about X, Y and Z.
        part : str, optional
            Component that the node belongs to.

        Returns
        -------
        Dof
            The DOF.

        Raises
        ------
        InputError
            If the code is not within -6 ... 6.

        Examples
        --------
        >>> str(Dof.from_uff(12, -3)), str(Dof.from_uff(12, 4))
        ('12:-Z', '12:+RX')
        """
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
        """Return the same DOF in the opposite direction.

        Returns
        -------
        Dof
            A scalar is returned as it is.

        Examples
        --------
        >>> str(Dof(12, "+Z").reversed())
        '12:-Z'
        """
        flipped = {"+": "-", "-": "+"}
        return Dof(self.node, flipped.get(self.direction[0], self.direction[0]) + self.direction[1:], self.part)

    def __str__(self) -> str:
        prefix = f"{self.part}:" if self.part else ""
        return f"{prefix}{self.node}:{self.direction}"


def match(wanted: Iterable[Dof], present: Iterable[Dof]) -> list[tuple[int, int, int]]:
    """Pair DOFs that measure along the same line, whatever their sign.

    Parameters
    ----------
    wanted : iterable of Dof
        DOFs to look for.
    present : iterable of Dof
        DOFs to look in.

    Returns
    -------
    list of tuple of (int, int, int)
        ``(index in wanted, index in present, sign)`` for every wanted DOF that is present; the sign is -1 where the two
        point in opposite directions.

    Examples
    --------
    >>> match([Dof(1, "+X"), Dof(2, "+X")], [Dof(2, "-X")])
    [(1, 0, -1)]
    """
    rows = {dof.positive: (index, dof.sign) for index, dof in enumerate(present)}
    pairs = []
    for index, dof in enumerate(wanted):
        if dof.positive in rows:
            other, sign = rows[dof.positive]
            pairs.append((index, other, sign * dof.sign))
    return pairs
