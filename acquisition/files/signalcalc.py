"""FRFs that SignalCalc exports as text: frequency, real and imaginary part, with the channels' DOFs in the header."""

import re
from pathlib import Path

from acquisition import units
from acquisition.contents import Contents
from acquisition.files import sniff, table
from acquisition.files.arrays import not_finite
from acquisition.files.layout import Layout
from acquisition.files.ratios import make_frfs
from ema.dof import Dof
from ema.errors import InputError


def read(path: Path, layout: Layout) -> Contents:
    """Read one FRF; ``outputs`` and ``inputs`` of the layout overrule the DOFs of the header.

    Raises
    ------
    InputError : the columns are not frequency, real and imaginary part.
    """
    text = table.decode(sniff.whole(path))
    segment = table.parse(text, layout, path.name)[0]
    if segment.values.shape[1] != 3:
        raise InputError(
            "not frequency, real and imaginary part", where=path.name, got=f"{segment.values.shape[1]} columns"
        )
    reference, response = _dofs(segment.header, path.name)
    if layout.inputs is not None:
        reference = Dof.parse(layout.inputs if isinstance(layout.inputs, str) else layout.inputs[0])
    if layout.outputs is not None:
        response = Dof.parse(layout.outputs if isinstance(layout.outputs, str) else layout.outputs[0])
    values = (segment.values[:, 1] + 1j * segment.values[:, 2])[:, None, None]
    unit = layout.unit or _unit(segment.header)
    frfs = make_frfs(segment.values[:, 0], values, (response,), (reference,), unit, path.name)
    header = tuple(
        (line.split("\t", 1)[0].strip(), line.split("\t", 1)[1].strip()) for line in segment.header[:4] if "\t" in line
    )
    return Contents(frfs=(frfs,), findings=not_finite(frfs.values, path.name), metadata=header)


def _dofs(header: tuple[str, ...], where: str) -> tuple[Dof, Dof]:
    """DOFs of the reference and of the response channel."""
    for line in header:
        found = re.match(r"^Ref Chan:Resp Chan\s+(\S+):(\S+)", line)
        if found:
            return Dof.parse(found[1]), Dof.parse(found[2])
    raise InputError("the header names no channels", where=where, expected="a line 'Ref Chan:Resp Chan  1+Z:2+Z'")


def _unit(header: tuple[str, ...]) -> str:
    """Unit of the ratio: ``(m/s²)(N)`` means the first over the second."""
    for line in header:
        found = re.match(r"^Hz\s+\((.+)\)\((.+)\)\s*$", line)
        if found and units.known(f"({found[1]})/({found[2]})"):
            return f"({found[1]})/({found[2]})"
    return units.UNSTATED
