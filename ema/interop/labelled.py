"""Our data types as labelled arrays of xarray, with units in their attributes."""

from functools import singledispatch
from typing import TYPE_CHECKING, Any

import numpy as np

from ema.data import FrfSet, ModalMap, ModalModel, Recording
from ema.errors import InputError, require

if TYPE_CHECKING:
    import xarray as xr


def to_xarray(thing: FrfSet | Recording | ModalModel | ModalMap) -> "xr.DataArray | xr.Dataset":
    """Return FRFs, a record, modes or a map as labelled arrays of xarray.

    Parameters
    ----------
    thing : FrfSet or Recording or ModalModel or ModalMap
        What to convert.

    Returns
    -------
    xarray.DataArray or xarray.Dataset
        FRFs: an array over ``frequency`` [Hz], ``output`` and ``input`` (DOFs as text); coherence and variance are
        coordinates where they are known. A record: an array over ``channel`` (names) and ``time`` [s]; unit, quantity,
        role and DOF are coordinates along ``channel``. Modes: a data set over ``mode`` (from 1), ``dof`` and
        ``input``. A map: a data set over ``force_level`` [N] and ``normal_force`` [N]. Units are in ``attrs``.

    Raises
    ------
    InputError
        If it is none of these.
    MissingExtraError
        If xarray is not installed.

    Examples
    --------
    >>> from ema.examples import frf_set, modal_map
    >>> array = to_xarray(frf_set())
    >>> array.dims, array.attrs["units"]
    (('frequency', 'output', 'input'), '(m/s^2)/N')
    >>> to_xarray(modal_map()).damping.sel(force_level=20.0, normal_force=500.0).item()
    0.024
    """
    labelled: xr.DataArray | xr.Dataset = _converted(thing)
    return labelled


@singledispatch
def _converted(thing: Any) -> Any:
    raise InputError(
        "no labelled array of such a thing",
        got=type(thing).__name__,
        expected="FrfSet, Recording, ModalModel or ModalMap",
        advice="to_dataframe and table() give tables of others",
    )


@_converted.register
def _(frfs: FrfSet) -> Any:
    dims = ("frequency", "output", "input")
    coordinates: dict[str, Any] = {
        "frequency": ("frequency", frfs.frequencies, {"units": "Hz"}),
        "output": [str(dof) for dof in frfs.outputs],
        "input": [str(dof) for dof in frfs.inputs],
    }
    squared = "" if not frfs.scaled else f"({frfs.unit})^2"
    for name, block, units in (("coherence", frfs.coherence, "1"), ("variance", frfs.variance, squared)):
        if block is not None:
            coordinates[name] = (dims, block, {"units": units})
    attrs = {
        "units": frfs.unit if frfs.scaled else "",
        "quantity": frfs.quantity,
        "phasor": "exp(+j w t)",
        "estimator": frfs.estimator,
    }
    return require("xarray", "xarray").DataArray(frfs.values, coordinates, dims, frfs.name or None, attrs)


@_converted.register
def _(recording: Recording) -> Any:
    along = {
        "units": [channel.unit for channel in recording.channels],
        "quantity": [channel.quantity for channel in recording.channels],
        "role": [channel.role for channel in recording.channels],
        "dof": ["" if channel.dof is None else str(channel.dof) for channel in recording.channels],
    }
    coordinates: dict[str, Any] = {
        "channel": [channel.name for channel in recording.channels],
        "time": ("time", recording.times, {"units": "s"}),
    } | {name: ("channel", values) for name, values in along.items()}
    attrs = {
        "sampling_rate": recording.sampling_rate,
        "start": "" if recording.start is None else recording.start.isoformat(),
    }
    dims = ("channel", "time")
    return require("xarray", "xarray").DataArray(recording.signals, coordinates, dims, recording.name or None, attrs)


@_converted.register
def _(model: ModalModel) -> Any:
    scaled = model.scaling == "unit modal mass"
    variables: dict[str, Any] = {
        "natural_frequency": ("mode", model.natural_frequencies, {"units": "Hz"}),
        "damping_ratio": ("mode", model.damping_ratios, {"units": "1"}),
        "pole": ("mode", model.poles, {"units": "rad/s"}),
        "shape": (("dof", "mode"), model.shapes, {"units": "kg^-0.5" if scaled else ""}),
        "participation": (("input", "mode"), model.participation, {"units": "kg^-0.5 s" if scaled else ""}),
    }
    if model.covariance is not None:
        for place, (name, unit) in enumerate((("natural_frequency_std", "Hz"), ("damping_ratio_std", "1"))):
            variables[name] = ("mode", np.sqrt(model.covariance[:, place, place]), {"units": unit})
    coordinates = {
        "mode": np.arange(1, len(model.poles) + 1),
        "dof": [str(dof) for dof in model.dofs],
        "input": [str(dof) for dof in model.inputs],
    }
    attrs = {"name": model.name, "scaling": model.scaling, "phasor": "exp(+j w t)"}
    return require("xarray", "xarray").Dataset(variables, coordinates, attrs)


@_converted.register
def _(chart: ModalMap) -> Any:
    dims = ("force_level", "normal_force")
    units = {
        "frequency": "Hz",
        "damping": "1",
        "frequency_std": "Hz",
        "damping_std": "1",
        "force_at_resonance": "N",
        "modal_amplitude": "m kg^0.5",
        "quadrature_damping": "1",
        "misfit": "1",
    }
    known: dict[str, Any] = {
        name: (dims, getattr(chart, name), {"units": unit})
        for name, unit in units.items()
        if getattr(chart, name) is not None
    }
    coordinates: dict[str, Any] = {
        "force_level": ("force_level", chart.force_levels, {"units": "N"}),
        "normal_force": ("normal_force", chart.normal_forces, {"units": "N"}),
    }
    if chart.joint_forces is not None:
        known["joint_forces"] = ((*dims, "joint"), chart.joint_forces, {"units": "N"})
        if len(chart.joints) == chart.joint_forces.shape[2]:
            coordinates["joint"] = list(chart.joints)
    attrs = {"name": chart.name, "method": chart.method}
    return require("xarray", "xarray").Dataset(known, coordinates, attrs)
