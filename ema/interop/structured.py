"""Arrays of SDynPy: structured arrays of numpy, in memory or from its ``.npz`` and ``.npy`` files."""

from typing import Any

import numpy as np

from ema.data import FrfSet, ModalModel, poles_from
from ema.dof import Dof
from ema.errors import InputError

_COORDINATE = [("node", "<u8"), ("direction", "i1")]
_COMMENTS = [(f"comment{number}", "<U80") for number in range(1, 6)]
_FRF = 4
"""Function type of a frequency response function, as in universal files (58)."""


def from_sdynpy(array: Any, *, quantity: str = "unstated") -> FrfSet | ModalModel:
    """Return the FRFs or shapes of an array of SDynPy.

    Parameters
    ----------
    array : structured array
        A ``TransferFunctionArray`` or ``ShapeArray``, or what ``numpy.load`` gives for their files.
    quantity : {"receptance", "mobility", "accelerance", "unstated"}, default "unstated"
        Kind of the FRFs, which the array does not know.

    Returns
    -------
    FrfSet or ModalModel
        FRFs, every pair of response and reference once; or unscaled modes without inputs.

    Raises
    ------
    InputError
        If it is no such array, its functions have no common frequency lines, or a pair is missing or there twice.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> back = from_sdynpy(to_sdynpy(frf_set()), quantity="accelerance")
    >>> bool(np.all(back.values == frf_set().values))
    True
    """
    if hasattr(array, "files"):  # an open .npz file
        if int(array["function_type"]) != _FRF:
            raise InputError("not FRFs", got=f"function type {int(array['function_type'])}", expected=f"{_FRF}")
        array = array["data"]
    plain = np.asarray(array)
    names = plain.dtype.names or ()
    if "shape_matrix" in names:
        return _modes(plain.ravel())
    if "ordinate" not in names or plain.dtype["coordinate"].shape != (2,):
        raise InputError(
            "not FRFs or shapes of SDynPy",
            got=f"{type(array).__name__} with the fields {', '.join(names) or 'none'}",
            expected="a TransferFunctionArray or a ShapeArray",
        )
    return _frfs(plain.ravel(), quantity)


def _dofs(coordinates: np.ndarray) -> list[Dof]:
    return [Dof.from_uff(int(each["node"]), int(each["direction"])) for each in coordinates]


def _frfs(functions: np.ndarray, quantity: str) -> FrfSet:
    lines = functions["abscissa"][0]
    if not np.allclose(functions["abscissa"], lines, rtol=1e-9, atol=0):
        raise InputError("the functions have no common frequency lines", advice="interpolate or separate them first")
    rows, columns = (_dofs(functions["coordinate"][:, side]) for side in (0, 1))
    outputs, inputs = list(dict.fromkeys(rows)), list(dict.fromkeys(columns))
    pairs = set(zip(rows, columns, strict=True))
    if not len(functions) == len(pairs) == len(outputs) * len(inputs):
        raise InputError(
            "not every pair of response and reference is there once",
            got=f"{len(functions)} functions of {len(pairs)} pairs",
            expected=f"{len(outputs)} responses x {len(inputs)} references",
        )
    values = np.zeros((len(lines), len(outputs), len(inputs)), complex)
    for function, row, column in zip(functions, rows, columns, strict=True):
        values[:, outputs.index(row), inputs.index(column)] = function["ordinate"]
    return FrfSet.from_arrays(lines, values, outputs=outputs, inputs=inputs, quantity=quantity)


def _modes(shapes: np.ndarray) -> ModalModel:
    coordinates = shapes["coordinate"]
    if not np.all(coordinates == coordinates[0]):
        raise InputError(
            "the shapes do not share their coordinates",
            advice="give all shapes the same coordinates in the same order, or convert them one by one",
        )
    shapes = shapes[np.argsort(shapes["frequency"], kind="stable")]
    return ModalModel(
        poles=poles_from(shapes["frequency"], shapes["damping"]),
        shapes=shapes["shape_matrix"].T.astype(complex),
        dofs=tuple(_dofs(coordinates[0])),
        participation=np.zeros((0, len(shapes)), complex),
        inputs=(),
    )


def to_sdynpy(thing: FrfSet | ModalModel) -> np.ndarray:
    """Return FRFs or modes as the structured array under a ``TransferFunctionArray`` or ``ShapeArray`` of SDynPy.

    Parameters
    ----------
    thing : FrfSet or ModalModel
        What to convert.

    Returns
    -------
    structured array
        Of shape (out, in) or (mode,): ``to_sdynpy(frfs).view(sdynpy.data.TransferFunctionArray)``. Modal masses are 1
        where the model is scaled, NaN elsewhere; parts of structures have no place in it.

    Raises
    ------
    InputError
        If it is neither, or a DOF belongs to a part.

    Examples
    --------
    >>> from ema.examples import modal_model
    >>> to_sdynpy(modal_model())["frequency"].round(3)
    array([40., 60., 90.])
    """
    if isinstance(thing, FrfSet):
        lines = len(thing.frequencies)
        kind = [("abscissa", "<f8", (lines,)), ("ordinate", "<c16", (lines,)), *_COMMENTS]
        array: np.ndarray = np.zeros(
            (len(thing.outputs), len(thing.inputs)), [*kind, ("coordinate", _COORDINATE, (2,))]
        )
        array["abscissa"] = thing.frequencies
        array["ordinate"] = np.moveaxis(thing.values, 0, -1)
        array["comment1"] = thing.name
        array["coordinate"][..., 0] = _coordinates(thing.outputs)[:, None]
        array["coordinate"][..., 1] = _coordinates(thing.inputs)[None]
        return array
    if not isinstance(thing, ModalModel):
        raise InputError("not what SDynPy has an array for", got=type(thing).__name__, expected="FrfSet or ModalModel")
    real = not np.any(thing.shapes.imag)
    count = len(thing.dofs)
    head = [("frequency", "<f8"), ("damping", "<f8"), ("coordinate", _COORDINATE, (count,))]
    body = [("shape_matrix", "<f8" if real else "<c16", (count,)), ("modal_mass", "<f8" if real else "<c16")]
    array = np.zeros(len(thing.poles), [*head, *body, *_COMMENTS])
    array["frequency"], array["damping"] = thing.natural_frequencies, thing.damping_ratios
    array["coordinate"] = _coordinates(thing.dofs)
    array["shape_matrix"] = thing.shapes.T.real if real else thing.shapes.T
    array["modal_mass"] = 1.0 if thing.scaling == "unit modal mass" else np.nan
    array["comment1"] = thing.name
    return array


def _coordinates(dofs: tuple[Dof, ...]) -> np.ndarray:
    parts = [str(dof) for dof in dofs if dof.part]
    if parts:
        raise InputError("SDynPy has no parts of structures", got=parts[0], expected="DOFs without a part")
    return np.array([(dof.node, dof.uff_direction) for dof in dofs], _COORDINATE)
