"""FRFs of pyFBS: an array (freq, out, in) with tables of positions and directions of channels and impacts."""

from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Int

from ema.data import FrfSet, Geometry
from ema.dof import Dof
from ema.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

_POSITION = ["Position_1", "Position_2", "Position_3"]
_DIRECTION = ["Direction_1", "Direction_2", "Direction_3"]
_QUANTITY = {"acceleration": "accelerance", "velocity": "mobility", "displacement": "receptance"}
_WORD = {"accelerance": "Acceleration", "mobility": "Velocity", "receptance": "Displacement", "unstated": "Unstated"}
_SAME = 1e-6
"""Distance [m] and component of a direction below which two are the same: tables of pyFBS are written in millimetres or
metres with at least six digits."""


def from_pyfbs(
    frequencies: Any, values: Any, df_chn: "pd.DataFrame", df_imp: "pd.DataFrame", *, quantity: str = ""
) -> tuple[FrfSet, Geometry]:
    """Return FRFs of pyFBS and their points.

    Parameters
    ----------
    frequencies : array of shape (freq,)
        Hz.
    values : complex array of shape (freq, out, in)
        FRFs in SI.
    df_chn, df_imp : pandas.DataFrame
        Tables of channels and impacts with ``Position_1..3`` [m], ``Direction_1..3`` and, for channels, ``Quantity``.
    quantity : {"", "receptance", "mobility", "accelerance", "unstated"}
        Kind of the FRFs; by default what the channels measure.

    Returns
    -------
    tuple of (FrfSet, Geometry)
        Nodes are numbered from 1, one for each position; where directions are not along the global axes the node has
        local axes along them.

    Raises
    ------
    InputError
        If a column is missing, tables and FRFs disagree, the channels measure different quantities, or the directions
        at a point are neither along nor across each other.

    Examples
    --------
    >>> from ema.examples import frf_set, geometry
    >>> tables = to_pyfbs(frf_set(), geometry())
    >>> from_pyfbs(*tables)[0].outputs == frf_set().outputs
    True
    """
    tables = [_columns(table, name) for table, name in ((df_chn, "df_chn"), (df_imp, "df_imp"))]
    kind = quantity or _kind(df_chn)
    positions, directions = (np.concatenate([table[part] for table in tables]) for part in (0, 1))
    rows, xyz = _points(positions)
    axes = np.array([_axes(directions[rows == row], row + 1) for row in range(len(xyz))])
    dofs = []
    for row, direction in zip(rows, directions, strict=True):
        along = axes[row] @ direction
        axis = int(np.argmax(np.abs(along)))
        dofs.append(Dof(int(row) + 1, ("-" if along[axis] < 0 else "+") + "XYZ"[axis]))
    count = len(tables[0][0])
    frfs = FrfSet.from_arrays(frequencies, values, outputs=dofs[:count], inputs=dofs[count:], quantity=kind)
    plain = np.allclose(axes, np.eye(3), atol=_SAME)
    return frfs, Geometry(nodes=np.arange(1, len(xyz) + 1), xyz=xyz, axes=None if plain else axes)


def _kind(df_chn: "pd.DataFrame") -> str:
    words = {str(word).lower() for word in df_chn["Quantity"]} if "Quantity" in df_chn else {"unstated"}
    kinds = {_QUANTITY.get(word, "unstated") for word in words}
    if len(kinds) > 1:
        raise InputError(
            "the channels measure different quantities",
            got=", ".join(sorted(words)),
            expected="one",
            advice="choose the rows of one quantity first",
        )
    return kinds.pop()


def _columns(table: "pd.DataFrame", name: str) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Positions and directions, the latter of length 1."""
    known = getattr(table, "columns", None)
    missing = [column for column in (*_POSITION, *_DIRECTION) if known is None or column not in known]
    if missing:
        raise InputError(
            "not a table of pyFBS",
            where=name,
            got=type(table).__name__ if known is None else "no column " + ", ".join(missing),
            expected="Position_1 to Position_3 and Direction_1 to Direction_3",
        )
    positions = table[_POSITION].to_numpy(float)
    directions = table[_DIRECTION].to_numpy(float)
    length = np.linalg.norm(directions, axis=1)
    if np.any(length < _SAME):
        raise InputError(
            "a direction of length zero",
            where=f"{name}, row {int(np.argmin(length))}",
            advice="state Direction_1 to Direction_3 of this row",
        )
    return positions, directions / length[:, None]


def _points(positions: Float[np.ndarray, "n 3"]) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "point 3"]]:
    """Row of the point of each position, and the points in the order in which they come first."""
    rows = np.zeros(len(positions), int)
    points: list[np.ndarray] = []
    for number, position in enumerate(positions):
        apart = [float(np.max(np.abs(point - position))) for point in points]
        if not apart or min(apart) > _SAME:
            points.append(position)
            apart.append(0.0)
        rows[number] = int(np.argmin(apart))
    return rows, np.array(points)


def _axes(directions: Float[np.ndarray, "k 3"], node: int) -> Float[np.ndarray, "3 3"]:
    """Right-handed axes of a point along its directions: the global ones where those fit."""
    if np.all(np.max(np.abs(directions), axis=1) > 1 - _SAME):
        return np.eye(3)
    kept: list[np.ndarray] = []
    for direction in directions:
        along = [abs(float(axis @ direction)) for axis in kept]
        if all(each < 1e-3 for each in along):
            kept.append(direction - sum((axis @ direction) * axis for axis in kept))
        elif not any(each > 1 - _SAME for each in along):
            raise InputError(
                "directions at a point that are neither along nor across each other have no common axes",
                where=f"point {node}",
                advice="give the skewed channels points of their own",
            )
    for spare in np.eye(3):
        rest = spare - sum((axis @ spare) * axis for axis in kept)
        if len(kept) < 3 and np.linalg.norm(rest) > 0.5:
            kept.append(rest / np.linalg.norm(rest))
    axes = np.array([axis / np.linalg.norm(axis) for axis in kept])
    return axes if np.linalg.det(axes) > 0 else axes * np.array([[1.0], [1.0], [-1.0]])


def to_pyfbs(
    frfs: FrfSet, geometry: Geometry
) -> "tuple[Float[np.ndarray, 'freq'], np.ndarray, pd.DataFrame, pd.DataFrame]":
    """Return FRFs as pyFBS takes them.

    Parameters
    ----------
    frfs : FrfSet
        FRFs at translations.
    geometry : Geometry
        Where the nodes are.

    Returns
    -------
    tuple of (array, array, pandas.DataFrame, pandas.DataFrame)
        Frequencies [Hz], values of shape (freq, out, in), and the tables of channels and impacts (``Name``,
        ``Quantity``, ``Grouping``, ``Position_1..3`` [m], ``Direction_1..3``).

    Raises
    ------
    InputError
        If a DOF is no translation at a node of the geometry.

    Examples
    --------
    >>> from ema.examples import frf_set, geometry
    >>> channels = to_pyfbs(frf_set(), geometry())[2]
    >>> channels[["Name", "Position_1", "Direction_3"]].values.tolist()[1]
    ['2:+Z', 0.1, 1.0]
    """
    import pandas as pd

    def table(dofs: tuple[Dof, ...], quantity: str) -> "pd.DataFrame":
        """Rows of DOFs with the places [m] and directions of their nodes, as pyFBS names its columns."""
        wrong = [dof for dof in dofs if dof.axis not in ("X", "Y", "Z")]
        if wrong:
            raise InputError(
                "pyFBS knows translations only in these tables",
                got=str(wrong[0]),
                advice="leave the other DOFs out by FrfSet.pick",
            )
        head = {"Name": [str(dof) for dof in dofs], "Quantity": quantity, "Grouping": [dof.node for dof in dofs]}
        places = np.array([geometry.xyz[geometry.place(dof.node)] for dof in dofs]).reshape(-1, 3)
        senses = np.array([geometry.direction(dof) for dof in dofs]).reshape(-1, 3)
        columns = {
            name: values
            for names, block in ((_POSITION, places), (_DIRECTION, senses))
            for name, values in zip(names, block.T, strict=True)
        }
        return pd.DataFrame(head | columns)

    return frfs.frequencies, frfs.values, table(frfs.outputs, _WORD[frfs.quantity]), table(frfs.inputs, "Force")
