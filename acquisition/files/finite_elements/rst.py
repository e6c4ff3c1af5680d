"""Result files of Ansys Mechanical APDL (.rst): the modes of a modal analysis and their mesh."""

from dataclasses import replace
from pathlib import Path

from acquisition.contents import Contents
from acquisition.files.finite_elements.nodal import contents
from acquisition.files.layout import Layout
from acquisition.files.reconcile import differs
from acquisition.isolated import call
from ema.data import Finding
from ema.errors import InputError


def read(path: Path, layout: Layout) -> Contents:
    """Read all modes above 0 Hz.

    Parameters
    ----------
    path : Path
        File that exists and whose format was recognised.
    layout : Layout
        ``unit``: length unit of the coordinates, which the format does not state; ``salvage``: leave damaged modes out.

    Returns
    -------
    Contents
        One modal model with its mesh, and findings for everything that was left out.

    Raises
    ------
    MissingExtraError
        ansys-mapdl-reader is not installed.
    InputError
        The file is damaged, compressed, or without modes.
    UnitError
        ``unit`` is no unit of length.
    """
    parsed = call("rst", path)
    if parsed["analysis"] != "modes":
        raise InputError(
            "the results are no modes of a whole structure",
            where=path.name,
            got=parsed["analysis"],
            expected="a modal analysis (ANTYPE,MODAL) of all sectors",
        )
    notes: tuple[Finding, ...] = ()
    for mode, what, got, expected in parsed["damaged"]:
        where = f"{path.name}: {mode}"
        notes += differs(what, where=where, layout=layout, got=got, expected=expected, recovered="it is left out")
    if parsed["undrawn"]:
        notes += (Finding("warning", "not-read", path.name, f"{parsed['undrawn']}; the mesh is read without faces."),)
    found = contents(parsed, layout, path.name)
    return replace(found, findings=(*notes, *found.findings))
