"""FRFs in named arrays become an FRF set."""

from typing import Any

import numpy as np

from acquisition import units
from acquisition.contents import Contents
from acquisition.files.arrays import Arrays, not_finite
from acquisition.files.layout import Layout
from ema.data import FrfSet
from ema.dof import Dof
from ema.errors import InputError
from ema.units import FRF_UNIT, UNSTATED


def frfs(arrays: Arrays, layout: Layout) -> Contents:
    """FRFs: complex, as real and imaginary part, or as amplitude and phase."""
    values = np.asarray(_complex(arrays, layout))
    if layout.frequency is not None:
        frequencies = arrays.vector(layout.frequency)
    elif layout.frequency_step is not None:
        frequencies = layout.frequency_step * np.arange(max(values.shape))
    else:
        raise InputError(
            "the file does not state its frequencies",
            where=arrays.where,
            advice="say frequency='...' or frequency_step=... [Hz]",
        )
    block = _freq_out_in(values, len(frequencies), layout, arrays.where)
    coherence = None
    if layout.coherence is not None:
        coherence = _freq_out_in(arrays.numbers(layout.coherence), len(frequencies), layout, arrays.where)
    outputs = _dofs(arrays, layout.outputs, block.shape[1])
    inputs = _dofs(arrays, layout.inputs, block.shape[2])
    frf_set = make_frfs(frequencies, block, outputs, inputs, layout.unit, arrays.where, coherence)
    return Contents(frfs=(frf_set,), findings=not_finite(frf_set.values, arrays.where))


def make_frfs(
    frequencies: Any, block: Any, outputs: tuple[Dof, ...], inputs: tuple[Dof, ...], unit: str | None, where: str,
    coherence: Any = None, estimator: str = "",
) -> FrfSet:  # fmt: skip
    """An FRF set in SI.

    Raises
    ------
    InputError : frequencies that do not increase.
    UnitError : a unit that is none of an FRF.
    """
    if len(frequencies) < 1 or not np.all(np.isfinite(frequencies)) or np.any(np.diff(frequencies) <= 0):
        raise InputError("the frequencies do not increase", where=where, got=f"{len(frequencies)} lines")
    parsed = units.parse(unit or UNSTATED)
    if parsed.stated and parsed.quantity not in FRF_UNIT:
        raise units.UnitError(
            "not the unit of an FRF", where=where, got=repr(unit), expected="response over force, e.g. (m/s^2)/N or g/N"
        )
    quantity: Any = parsed.quantity if parsed.stated else "unstated"
    return FrfSet(
        frequencies, parsed.to_si(block), outputs, inputs, quantity, parsed.si if parsed.stated else UNSTATED,
        coherence, estimator=estimator, name=where,
    )  # fmt: skip


def _complex(arrays: Arrays, layout: Layout) -> Any:
    if layout.frf is not None:
        return arrays.numbers(layout.frf, np.complex128)
    if layout.real is not None and layout.imaginary is not None:
        real, imaginary = arrays.numbers(layout.real), arrays.numbers(layout.imaginary)
        if real.shape != imaginary.shape:
            raise InputError(
                "real and imaginary part differ in length", where=arrays.where, got=f"{real.shape}, {imaginary.shape}"
            )
        return real + 1j * imaginary
    if layout.amplitude is not None and layout.phase is not None:
        turn = units.parse(layout.phase_unit)
        if turn.quantity != "rotation":
            raise units.UnitError("not a unit of phase", got=layout.phase_unit, expected="rad or deg")
        amplitude, phase = arrays.numbers(layout.amplitude), arrays.numbers(layout.phase)
        if amplitude.shape != phase.shape:
            raise InputError(
                "amplitude and phase differ in length", where=arrays.where, got=f"{amplitude.shape}, {phase.shape}"
            )
        return amplitude * np.exp(1j * turn.factor * phase)
    raise InputError(
        "half of an FRF", where=arrays.where, advice="say frf, or real and imaginary, or amplitude and phase"
    )


def _freq_out_in(values: Any, lines: int, layout: Layout, where: str) -> Any:
    """Any arrangement of the FRFs as (freq, out, in), frequency being the axis of the right length."""
    values = np.squeeze(values)
    places = [axis for axis, length in enumerate(values.shape) if length == lines]
    if values.ndim == 0 or values.ndim > 3 or not places:
        raise InputError(
            "FRFs and frequencies differ in length",
            where=where,
            got=f"values of shape {values.shape}",
            expected=f"{lines} lines",
        )
    values = np.moveaxis(values, places[0], 0)
    if values.ndim == 1:
        return values[:, None, None]
    if values.ndim == 3:
        return values
    one_input = layout.inputs is None or isinstance(layout.inputs, str) or len(layout.inputs) == 1
    return values[:, :, None] if one_input else values[:, None, :]


def _dofs(arrays: Arrays, given: Any, count: int) -> tuple[Dof, ...]:
    """DOFs as said, else scalar ones numbered from 1."""
    if given is None:
        return tuple(Dof(number) for number in range(1, count + 1))
    texts = arrays.texts(given)
    if len(texts) != count:
        raise InputError("the number of DOFs", where=arrays.where, got=len(texts), expected=count)
    dofs = tuple(Dof.parse(text) for text in texts)
    if len(set(dofs)) < count:
        raise InputError("a DOF is named twice", where=arrays.where, got=", ".join(map(str, dofs)))
    return dofs
