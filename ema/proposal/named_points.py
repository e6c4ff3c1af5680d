"""Tables of positions in which the points have names with numbers, such as ``A1`` to ``A12``."""

import re
from pathlib import Path

import numpy as np

from acquisition.columns import bracketed, numbers, read_columns
from ema.data import Geometry
from ema.errors import EmaError
from ema.proposal.units import quantity_of
from ema.units import UNSTATED

_NAME = re.compile(r"(?P<word>[A-Za-z]+)[ _.-]?(?P<node>\d+)")


def read(path: Path) -> tuple[Geometry, str] | None:
    """Return the points with the numbers in their names as nodes, and the unit that the titles state.

    Parameters
    ----------
    path : Path
        A text table with the names in its first column and columns ``x``, ``y`` and ``z``, such as ``x [mm]``.

    Returns
    -------
    tuple of Geometry and str, optional
        As the table has them; ``None`` where it is no such table, or where two names have one number or unlike words.
    """
    try:
        columns = read_columns(path)
        titles = {bracketed(title)[0].lower(): title for title in columns}
        xyz = np.column_stack([numbers(columns[titles[axis]], str(path)) for axis in "xyz"])
    except (EmaError, KeyError):
        return None
    units = {bracketed(titles[axis])[1] or UNSTATED for axis in "xyz"}
    names = [_NAME.fullmatch(text) for text in next(iter(columns.values()))]
    words = {name["word"].lower() if name else "" for name in names}
    nodes = np.array([int(name["node"]) if name else 0 for name in names])
    unit = next(iter(units))
    sound = len(units) == len(words) == 1 and "" not in words and len(set(nodes.tolist())) == len(nodes)
    if not sound or not np.isfinite(xyz).all() or (unit != UNSTATED and quantity_of(unit) != "displacement"):
        return None
    return Geometry(nodes, xyz), unit
