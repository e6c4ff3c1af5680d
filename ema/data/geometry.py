"""Where the measured points are."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from ema.data._arrays import freeze
from ema.data._summary import Container, brief, count, phrase
from ema.dof import SCALAR, Dof
from ema.errors import InputError


@dataclass(frozen=True, repr=False)
class Geometry(Container):
    """Points of the structure, and the lines and faces that draw it.

    Parameters
    ----------
    nodes : node numbers, shape (n,).
    xyz : coordinates in m, shape (n, 3).
    lines : polylines as node numbers.
    faces : polygons (three or more nodes each) as node numbers.
    axes : local axes, shape (n, 3, 3): ``axes[k, 0]`` is the unit vector of +X at node k in global coordinates.
        ``None`` means global axes everywhere.
    """

    nodes: Int[np.ndarray, "n"]
    xyz: Float[np.ndarray, "n 3"]
    lines: tuple[tuple[int, ...], ...] = ()
    faces: tuple[tuple[int, ...], ...] = ()
    axes: Float[np.ndarray, "n 3 3"] | None = None
    name: str = ""
    _places: dict[int, int] = field(init=False, repr=False, compare=False, default_factory=dict)

    def __post_init__(self) -> None:
        freeze(self, nodes=np.int64, xyz=np.float64, axes=np.float64)
        object.__setattr__(self, "_places", {int(node): place for place, node in enumerate(self.nodes)})

    def place(self, node: int) -> int:
        """Row of ``node`` in ``nodes`` and ``xyz``.

        Raises
        ------
        InputError : the geometry has no such node.
        """
        try:
            return self._places[node]
        except KeyError:
            raise InputError(
                "the geometry has no such node", got=node, expected=f"one of its {len(self.nodes)} nodes"
            ) from None

    def __contains__(self, node: object) -> bool:
        return node in self._places

    def direction(self, dof: Dof) -> Float[np.ndarray, "3"]:
        """Unit vector of a translation or rotation DOF in global coordinates, sign included."""
        if dof.direction == SCALAR:
            raise InputError("a scalar DOF has no direction in space", where=str(dof))
        axis = "XYZ".index(dof.axis[-1])
        basis = np.eye(3) if self.axes is None else self.axes[self.place(dof.node)]
        return dof.sign * np.asarray(basis[axis], dtype=np.float64)

    def _headline(self) -> str:
        sides = np.ptp(self.xyz, axis=0) if len(self.nodes) else np.zeros(3)
        return phrase(
            brief(self.name) if self.name else "",
            count(len(self.nodes), "node"),
            count(len(self.lines), "line"),
            count(len(self.faces), "face"),
            " x ".join(f"{side:.4g}" for side in sides) + " m",
        )
