"""Skewed sensors: directions given as vectors become DOFs in local axes of their node."""

from collections.abc import Iterable

import numpy as np
from jaxtyping import Float

from ema.data import Geometry
from ema.dof import Dof
from ema.errors import InputError

_ALIGNED = 1e-3
"""Sine of the angle (0.06 degrees) within which two directions are the same: vectors are noted with three digits."""


class LocalAxes:
    """The local axes of every node that has any, ``axes[0]`` being the unit vector of its +X."""

    def __init__(self, geometry: Geometry | None) -> None:
        self._axes: dict[int, Float[np.ndarray, "3 3"]] = {}
        self._fixed: set[int] = set()
        if geometry is not None and geometry.axes is not None:
            self._axes = {int(node): geometry.axes[place] for place, node in enumerate(geometry.nodes)}
            self._fixed = set(self._axes)
        self._new: set[int] = set()

    def add(self, node: int, vectors: Iterable[Float[np.ndarray, "3"]]) -> None:
        """Give ``node`` axes along ``vectors``, unless the geometry has already given it some.

        Raises
        ------
        InputError : the directions are not at right angles to each other.
        """
        if node not in self._fixed:
            axes = _frame(node, list(vectors))
            if not np.allclose(axes, np.eye(3), atol=_ALIGNED):
                self._axes[node] = axes
                self._new.add(node)

    def dof(self, node: int, direction: "str | Float[np.ndarray, '3']") -> Dof:
        """The DOF at ``node`` along a direction such as ``"+Z"`` or a vector in global coordinates.

        Raises
        ------
        InputError : the vector lies along none of the axes of the node.
        """
        if isinstance(direction, str):
            if node in self._new:
                raise InputError(
                    "a node with a skewed sensor has directions in local axes only",
                    where=f"node {node}",
                    got=direction,
                    advice="give its other directions as vectors, or the skewed sensor a node of its own",
                )
            return Dof.parse(f"{node}:{direction}")
        cosines = self._axes.get(node, np.eye(3)) @ unit_vector(direction, node)
        axis = int(np.argmax(np.abs(cosines)))
        if abs(cosines[axis]) < np.sqrt(1 - _ALIGNED**2):
            raise InputError(
                "a direction along none of the axes of its node",
                where=f"node {node}",
                got=list(direction),
                advice="two directions at one node are at right angles; give one of them a node of its own",
            )
        return Dof(node, ("+" if cosines[axis] > 0 else "-") + "XYZ"[axis])

    def apply(self, geometry: Geometry | None) -> "Float[np.ndarray, 'n 3 3'] | None":
        """Axes of all nodes of ``geometry``, or ``None`` where all are global.

        Raises
        ------
        InputError : there is a skewed sensor, but no geometry, or not its node.
        """
        if not self._new:
            return None if geometry is None else geometry.axes
        if geometry is None:
            raise InputError(
                "a sensor in a skewed direction needs a geometry",
                got=f"node {min(self._new)}",
                advice="add a table [geometry] with this node",
            )
        axes = np.tile(np.eye(3), (len(geometry.nodes), 1, 1))
        for node, own in self._axes.items():
            axes[geometry.place(node)] = own
        return axes


def unit_vector(direction: "Float[np.ndarray, '3'] | list[float]", node: int) -> Float[np.ndarray, "3"]:
    """``direction`` with length 1.

    Raises
    ------
    InputError : it has no length.
    """
    vector = np.asarray(direction, dtype=np.float64)
    length = float(np.linalg.norm(vector))
    if not np.isfinite(length) or length == 0:
        raise InputError(
            "a direction without length",
            where=f"node {node}",
            got=list(direction),
            expected="finite numbers that are not all 0",
            advice="correct the direction in the channel table",
        )
    return vector / length


def _frame(node: int, vectors: list[Float[np.ndarray, "3"]]) -> Float[np.ndarray, "3 3"]:
    """Right-handed axes of which the given vectors are some: each becomes the axis that it is nearest to."""
    axes: dict[int, np.ndarray] = {}
    for vector in (unit_vector(vector, node) for vector in vectors):
        if any(abs(abs(vector @ known) - 1) < _ALIGNED**2 for known in axes.values()):
            continue
        if any(abs(vector @ known) > _ALIGNED for known in axes.values()):
            raise InputError(
                "two directions at one node are not at right angles",
                where=f"node {node}",
                got=[[round(float(value), 4) for value in row] for row in (*axes.values(), vector)],
                advice="give one of the sensors a node of its own at the same place",
            )
        axis = max((axis for axis in range(3) if axis not in axes), key=lambda axis: abs(vector[axis]))
        axes[axis] = vector if vector[axis] >= 0 else -vector
    if len(axes) == 1:
        ((axis, first),) = axes.items()
        second = int(np.argmin(np.abs(first)))
        if second == axis:
            second = (axis + 1) % 3
        rest = np.eye(3)[second] - first[second] * first
        axes[second] = rest / np.linalg.norm(rest)
    if len(axes) == 2:
        missing = ({0, 1, 2} - set(axes)).pop()
        axes[missing] = np.cross(axes[(missing + 1) % 3], axes[(missing + 2) % 3])
    frame = np.array([axes[0], axes[1], axes[2]])
    if np.linalg.det(frame) < 0:
        frame[2] = -frame[2]
    return frame
