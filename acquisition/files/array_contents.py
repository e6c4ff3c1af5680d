"""Named arrays become recordings, FRFs, geometry or modes, as a layout says."""

from dataclasses import replace

from acquisition.contents import Contents
from acquisition.files.arrays import Arrays, UndescribedError
from acquisition.files.layout import Layout
from acquisition.files.points import geometry
from acquisition.files.ratios import frfs
from acquisition.files.shapes import modes
from acquisition.files.signals import recording


def contents_of(arrays: Arrays, layout: Layout) -> Contents:
    """The contents of a container of arrays, as its layout says.

    Raises
    ------
    UndescribedError : the layout does not say what the arrays are.
    InputError : it says too little, names what is not there, or lengths disagree.
    UnitError : an unknown unit.
    """
    verbs = {"signals": recording, "frf": frfs, "geometry": geometry, "modes": modes}
    if not layout.kind:
        raise UndescribedError(arrays)
    contents = verbs[layout.kind](arrays, layout)
    return replace(
        contents, metadata=(*arrays.metadata, *contents.metadata), findings=(*arrays.findings, *contents.findings)
    )
