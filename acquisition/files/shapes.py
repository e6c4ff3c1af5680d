"""Mode shapes in named arrays become a modal model."""

from typing import Any

import numpy as np

from acquisition import units
from acquisition.contents import Contents
from acquisition.files.arrays import Arrays, not_finite
from acquisition.files.layout import Layout
from ema.data import Finding, ModalModel, poles_from
from ema.dof import Dof
from ema.errors import InputError, UnitError


def modes(arrays: Arrays, layout: Layout) -> Contents:
    """Take mode shapes with their natural frequencies and damping ratios from arrays.

    Parameters
    ----------
    arrays : Arrays
        Arrays of the file.
    layout : Layout
        ``shapes`` with ``shape_axes``, ``natural_frequencies`` in Hz, ``damping_ratios`` and ``nodes``; an axis that is
        not named has length 1. One direction is a scalar DOF, several are +X, +Y, +Z and so on.

    Returns
    -------
    Contents
        One modal model with shapes (dof, mode), DOFs node by node, and no participation; values that are not finite
        have a finding.

    Raises
    ------
    InputError
        The axes are not those of the array, or the numbers of shapes, nodes and frequencies disagree.
    """
    array = np.asarray(arrays.numbers(str(layout.shapes), np.complex128))
    names = layout.shape_axes.split()
    if array.ndim != len(names) or not set(names) <= {"direction", "node", "mode"} or len(set(names)) < len(names):
        raise InputError(
            "the axes of the shapes",
            where=arrays.where,
            got=f"{layout.shape_axes!r} for an array of shape {array.shape}",
            expected="the words direction, node and mode in the order of the array, e.g. 'direction node mode'",
        )
    for missing in ("direction", "node", "mode"):
        if missing not in names:
            names, array = [*names, missing], array[..., None]
    array = array.transpose([names.index(name) for name in ("node", "direction", "mode")])
    nodes = list(range(1, array.shape[0] + 1)) if layout.nodes is None else [int(n) for n in layout.nodes]
    if len(nodes) != array.shape[0]:
        raise InputError("the number of nodes", where=arrays.where, got=len(nodes), expected=array.shape[0])
    codes = (0,) if array.shape[1] == 1 else range(1, array.shape[1] + 1)
    dofs = tuple(Dof.from_uff(node, code) for node in nodes for code in codes)
    count = array.shape[2]
    poles, findings = _poles(arrays, layout, count)
    shapes = array.reshape(-1, count)
    model = ModalModel(poles, shapes, dofs, np.zeros((0, count), complex), (), name=arrays.where)
    return Contents(modes=(model,), findings=findings + not_finite(shapes, arrays.where))


def _poles(arrays: Arrays, layout: Layout, count: int) -> tuple[Any, tuple[Finding, ...]]:
    """Poles of the shapes; NaN and a finding where no frequencies are given."""

    if layout.natural_frequencies is None:
        note = Finding(
            "warning", "frequencies-unstated", arrays.where, f"{count} mode shapes without natural frequencies."
        )
        return np.full(count, np.nan, dtype=np.complex128), (note,)
    frequencies = _given(arrays, layout.natural_frequencies, "Hz", ("frequency", "angular velocity"))
    damping = np.zeros(count)
    if layout.damping_ratios is not None:
        damping = _given(arrays, layout.damping_ratios, "1", ("ratio",))
    for name, given in (("natural frequencies", frequencies), ("damping ratios", damping)):
        if len(given) != count:
            raise InputError(
                f"mode shapes and {name} do not pair",
                where=arrays.where,
                got=f"{count} shapes, {len(given)} {name}",
                expected="as many of one as of the other",
                advice="find out which belong together; read the shapes alone meanwhile",
            )
    odd = np.flatnonzero(~((frequencies >= 0) & (frequencies < 1e12) & (damping >= 0) & (damping < 1)))
    if len(odd):
        raise InputError(
            "no mode of a structure",
            where=f"{arrays.where}, mode {odd[0] + 1}",
            got=f"{frequencies[odd[0]]:g} Hz with a damping ratio of {damping[odd[0]]:g}",
            expected="frequencies from 0 Hz on and damping ratios from 0 to 1",
            advice="divide damping in % by 100" if damping[odd[0]] >= 1 else "",
        )
    return poles_from(frequencies, damping), ()


def _given(arrays: Arrays, given: Any, usual: str, quantities: tuple[str, ...]) -> Any:
    """Frequencies in Hz or damping ratios: as they are, or at a place in the unit that the file states there.

    Raises
    ------
    UnitError : the file states a unit of something else.
    """
    if not isinstance(given, str):
        return np.asarray(given, dtype=np.float64)
    text = arrays.units.get(given, usual)
    unit = units.parse(text)
    if unit.quantity not in quantities:
        raise UnitError(
            "not the unit of " + quantities[0],
            where=f"{arrays.where}, {given}",
            got=repr(text),
            expected=f"a unit of {' or '.join(quantities)}",
            advice="correct the unit in the file, or give the numbers themselves",
        )
    return unit.factor / (2 * np.pi if unit.quantity == "angular velocity" else 1.0) * arrays.vector(given)
