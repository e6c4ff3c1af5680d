"""Result files of CalculiX (.frd): the modes of a frequency analysis and their mesh."""

from dataclasses import replace
from pathlib import Path

from acquisition.contents import Contents
from acquisition.files.finite_elements.nodal import contents
from acquisition.files.layout import Layout
from acquisition.files.reconcile import differs
from acquisition.isolated import call
from ema.errors import InputError


def read(path: Path, layout: Layout) -> Contents:
    """Read all modes above 0 Hz.

    Raises
    ------
    MissingExtraError : pyvista-frd-reader is not installed.
    InputError : damaged, or without modes.
    """
    parsed = call("frd", path)
    if parsed["frequencies"] is None:
        raise InputError(
            "the results are no modes",
            where=path.name,
            got="no step of a frequency analysis",
            expected="*FREQUENCY with *NODE FILE and U",
        )
    count = len(parsed["frequencies"])
    notes = (
        differs(
            "the file ends too early",
            where=path.name,
            layout=layout,
            got="no record 9999 at its end",
            expected="one",
            recovered=f"{count} modes are read, the last of which may be incomplete",
        )
        if not parsed["whole"]
        else ()
    )
    found = contents(parsed, layout, path.name)
    return replace(found, findings=(*notes, *found.findings))
