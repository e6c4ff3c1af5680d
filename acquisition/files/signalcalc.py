"""FRFs that SignalCalc exports as text, as real and imaginary part or as magnitude and phase; DOFs in the header."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from acquisition import units
from acquisition.contents import Contents
from acquisition.files import sniff, table
from acquisition.files.arrays import Arrays, not_finite
from acquisition.files.layout import Layout
from acquisition.files.polar import Polar, to_complex
from acquisition.files.ratios import make_frfs, missing_lines, unit_of, units_before_si
from acquisition.files.reconcile import differs
from acquisition.files.scales import bare_title
from ema.data import Finding
from ema.dof import Dof
from ema.errors import InputError
from ema.units import UNSTATED


def read(path: Path, layout: Layout) -> Contents:
    """Read one FRF.

    Parameters
    ----------
    path : Path
        File that exists and whose format was recognised.
    layout : Layout
        ``outputs`` and ``inputs`` replace the DOFs of the header; ``amplitude_unit`` and ``phase_unit`` state what the
        titles leave open; ``salvage``: read an interrupted table up to its end.

    Returns
    -------
    Contents
        One FRF set with values (freq, 1, 1), in SI where the header states the unit.

    Raises
    ------
    InputError
        The columns are not frequency, real and imaginary part, or frequency, magnitude and phase; or the table is
        interrupted.
    UnitError
        The scale of the magnitude or the unit of the phase is stated nowhere.
    """
    text = table.decode(sniff.whole(path))
    segment, *others = table.parse(text, layout, path.name)
    lost = _reconciled(segment, others, layout, path.name)
    if segment.values.shape[1] != 3:
        raise InputError(
            "not frequency, real and imaginary part",
            where=path.name,
            got=f"{segment.values.shape[1]} columns",
            expected="3: frequency and two of one FRF",
            advice="export each FRF into a file of its own",
        )
    if np.iscomplexobj(segment.values):
        raise InputError(
            "a complex number in a column of real ones",
            where=path.name,
            got=f"row {1 + int(np.argmax(np.any(np.imag(segment.values), axis=1)))} of the table",
            advice="a mark between two columns was damaged; export the file again",
        )
    reference, response = _dofs(segment.header, path.name)
    if layout.inputs is not None:
        reference = Dof.parse(layout.inputs if isinstance(layout.inputs, str) else layout.inputs[0])
    if layout.outputs is not None:
        response = Dof.parse(layout.outputs if isinstance(layout.outputs, str) else layout.outputs[0])
    raw = _complex(segment, layout, path.name)
    raw = raw if raw.in_decibels else replace(raw, unit=_unit(segment.header))
    unit, overruled = unit_of(raw, layout, path.name)
    frfs = make_frfs(segment.values[:, 0], raw.values[:, None, None], (response,), (reference,), unit, path.name)
    header = tuple(
        (line.split("\t", 1)[0].strip(), line.split("\t", 1)[1].strip()) for line in segment.header[:4] if "\t" in line
    )
    damage = (*segment.notes, *lost, *missing_lines(frfs.frequencies, path.name), *not_finite(frfs.values, path.name))
    return Contents(
        frfs=(frfs,), findings=(*raw.findings, *overruled, *damage), metadata=header, frf_units=units_before_si(unit)
    )


def _reconciled(segment: table.Segment, others: list[table.Segment], layout: Layout, where: str) -> tuple[Finding, ...]:
    """Findings about rows that are damaged: the header begins with words, and one table stands below it.

    Raises
    ------
    InputError : there are some, and salvage was not asked for.
    """
    number = re.compile(r"\s*[-+]?\.?\d")
    last = segment.header[-1] if segment.header else ""
    # the last line of a header holds units; a row whose numbers are damaged still begins like one
    if any(number.match(cell) for cell in last.split("\t")):
        what, line, side = "a row that holds no numbers", segment.line - 1, "behind"
    elif others:
        what, line, side = "rows of another number of cells inside the table", others[0].line, "in front of"
    else:
        return ()
    recovered = f"the {len(segment.values)} rows {side} it are read"
    return differs(what, where=f"{where}, line {line}", layout=layout, recovered=recovered)


def _complex(segment: table.Segment, layout: Layout, where: str) -> Polar:
    """The values, by what the header calls the second and third column.

    Raises
    ------
    InputError : neither real and imaginary part nor magnitude and phase.
    """
    lines = [[cell.strip() for cell in line.split("\t")] for line in segment.header]
    titles = next((cells for cells in lines if cells[0].lower() == "frequency"), [])
    kinds = [bare_title(title) for title in titles[1:3]]
    first, second = segment.values[:, 1], segment.values[:, 2]
    if kinds == ["real", "imaginary"]:
        with np.errstate(invalid="ignore"):  # infinite numbers have a finding
            return Polar(first + 1j * second, UNSTATED)
    if len(kinds) != 2 or not (kinds[0].startswith(("mag", "amp")) and kinds[1].startswith("phase")):
        raise InputError(
            "neither real and imaginary part nor magnitude and phase",
            where=where,
            got=", ".join(titles) or "no titles of the columns",
            expected="the titles Frequency, Real, Imaginary or Frequency, Magnitude, Phase",
            advice="export the FRF in one of these forms",
        )
    stated = next((cells for cells in lines if cells[0] == "Hz"), [])
    labels = dict(zip(titles, stated, strict=True)) if len(stated) == len(titles) else {}
    pool = Arrays(where, {titles[1]: first, titles[2]: second}, labels=labels)
    return to_complex(pool, replace(layout, amplitude=titles[1], phase=titles[2]), first, second)


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
