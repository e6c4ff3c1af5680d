"""Named arrays become recordings, FRFs, geometry or modes, as a layout says."""

from dataclasses import replace

from acquisition.contents import Contents
from acquisition.files.arrays import Arrays
from acquisition.files.layout import Layout
from acquisition.files.points import geometry
from acquisition.files.ratios import frfs
from acquisition.files.shapes import modes
from acquisition.files.signals import recording
from ema.errors import InputError


def arrange(arrays: Arrays, layout: Layout) -> Contents:
    """The contents of a container of arrays, as its layout says.

    Raises
    ------
    InputError : the layout says too little, names what is not there, or lengths disagree.
    UnitError : an unknown unit.
    """
    verbs = {"signals": recording, "frf": frfs, "geometry": geometry, "modes": modes}
    if not layout.kind:
        raise InputError(
            "the file does not say what its arrays are",
            where=arrays.where,
            got=arrays.listing(),
            advice="say it, e.g. signals='...' with time='...' or sampling_rate=..., frequency='...' with real='...' "
            "and imaginary='...', or x, y, z",
        )
    contents = verbs[layout.kind](arrays, layout)
    return replace(
        contents, metadata=(*arrays.metadata, *contents.metadata), findings=(*arrays.findings, *contents.findings)
    )
