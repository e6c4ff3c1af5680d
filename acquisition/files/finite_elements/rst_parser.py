"""Ansys results by ansys-mapdl-reader, in the process of the parsers."""

from pathlib import Path
from typing import Any

import numpy as np
from ansys.mapdl import reader

from acquisition.files.finite_elements.nodal import surface

_MODAL = 2
"""Number of a modal analysis in the header of a result file (ANTYPE)."""


def modes(path: Path) -> dict[str, Any]:
    """``analysis``, and of ``"modes"`` the ``nodes``, ``xyz``, ``faces``, ``frequencies`` in Hz and ``shapes``."""
    result = reader.read_binary(str(path))
    if type(result).__name__ != "Result":
        return {"analysis": f"a {type(result).__name__}"}
    kind = int(result._resultheader["kan"])
    if kind != _MODAL:
        return {"analysis": f"an analysis of type {kind}"}
    nodes, xyz = np.asarray(result.mesh.nnum), np.asarray(result.mesh.nodes, float)[:, :3]
    row = {int(node): index for index, node in enumerate(nodes)}
    shapes = np.zeros((result.n_results, len(nodes), 3))
    for mode in range(result.n_results):
        numbers, values = result.nodal_solution(mode)
        width = min(values.shape[1], 3)
        shapes[mode, [row[int(number)] for number in numbers], :width] = np.nan_to_num(values[:, :width])
    return {
        "analysis": "modes",
        "nodes": nodes,
        "at": nodes,
        "xyz": xyz,
        "faces": surface(result.grid),
        "frequencies": np.asarray(result.time_values, float),
        "shapes": shapes,
    }
