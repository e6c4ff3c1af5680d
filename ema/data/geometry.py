"""Where the measured points are."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from ema.data._arrays import check_axes, freeze
from ema.data._summary import Container, brief, count, phrase
from ema.dof import SCALAR, Dof
from ema.errors import InputError


@dataclass(frozen=True, repr=False)
class Geometry(Container):
    """Points of the structure, and the lines and faces that draw it.

    Parameters
    ----------
    nodes : integer array of shape (n,)
        Node numbers.
    xyz : array of shape (n, 3)
        Coordinates [m].
    lines : tuple of tuple of int, optional
        Polylines as node numbers.
    faces : tuple of tuple of int, optional
        Polygons (three or more nodes each) as node numbers.
    axes : array of shape (n, 3, 3), optional
        Local axes: ``axes[k, 0]`` is the unit vector of +X at node k in global coordinates. ``None`` means global axes
        everywhere.
    name : str, optional
        What the geometry is called in messages.

    Examples
    --------
    >>> from ema.examples import geometry
    >>> 3 in geometry(), 9 in geometry()
    (True, False)
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
        check_axes(self)
        object.__setattr__(self, "_places", {int(node): place for place, node in enumerate(self.nodes)})

    def place(self, node: int) -> int:
        """Return the row of a node in ``nodes`` and ``xyz``.

        Parameters
        ----------
        node : int
            Node number.

        Returns
        -------
        int
            Row, from 0.

        Raises
        ------
        InputError
            If the geometry has no such node.

        Examples
        --------
        >>> from ema.examples import geometry
        >>> geometry().place(3)
        2
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
        """Return the unit vector of a translation or rotation DOF in global coordinates, its sign included.

        Parameters
        ----------
        dof : Dof
            DOF at a node of the geometry.

        Returns
        -------
        array of shape (3,)
            Unit vector.

        Raises
        ------
        InputError
            If the DOF is a scalar, or the geometry has no such node.

        Examples
        --------
        >>> from ema.examples import geometry
        >>> geometry().direction(Dof(1, "-Z"))
        array([-0., -0., -1.])
        """
        if dof.direction == SCALAR:
            raise InputError(
                "a scalar DOF has no direction in space",
                where=str(dof),
                expected=f"a translation or rotation such as {dof.node}:+Z or {dof.node}:+RX",
            )
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
