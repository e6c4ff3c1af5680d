"""Our data types as tables of pandas, with units in the names of the columns and in the attributes."""

import re
from functools import singledispatch
from typing import TYPE_CHECKING, Any

import numpy as np

from ema.data import (
    AmplitudeDependentMode,
    AmplitudePrediction,
    Band,
    Campaign,
    Decay,
    ForcedResonances,
    ForcedResponse,
    ForceSurface,
    Forecast,
    ForecastCheck,
    FrfSet,
    Geometry,
    HarmonicResponse,
    Loop,
    MapComparison,
    MapPrediction,
    MapResult,
    ModalMap,
    NonlinearMode,
    Placement,
    PoleTable,
    Response,
    RunResult,
    SteppedLevel,
    StudyResult,
)
from ema.data.stability import CoexistingStates, SteadyStateCurve
from ema.dof import Dof
from ema.errors import InputError
from ema.units import SI_UNIT

if TYPE_CHECKING:
    import pandas as pd

_UNIT = re.compile(r" \[([^\]]+)\]$")
"""The unit at the end of the name of a column."""

Columns = dict[str, Any]


def to_dataframe(thing: Any) -> "pd.DataFrame":
    """Return one of the data types as a table of pandas.

    Columns are named as in the tables of reports and of ``table()``: ``f [Hz]``, ``zeta [%]``, ``F_N [N]``; a 95 %
    interval is two columns, ``f low [Hz]`` and ``f high [Hz]``. ``attrs["units"]`` holds the unit of each column that
    has one. DOFs are texts such as ``1:+Z``. Complex values stay complex, one column each. Conditions without a value
    stay in the table, as NaN.

    Parameters
    ----------
    thing : object
        FRFs and records (a column for each FRF or channel); modes, poles and their comparison; maps, their prediction
        and comparison; modes over their amplitude, their prediction and responses at forces; decays, loops and other
        motions; forecasts, rankings, placements; campaigns, studies, points, answers of an archive.

    Returns
    -------
    pandas.DataFrame
        A new table, with ``attrs["units"]``.

    Raises
    ------
    InputError
        If there is no table of such an object.

    Examples
    --------
    >>> from ema.examples import modal_map
    >>> table = to_dataframe(modal_map())
    >>> table.loc[4, ["F_E [N]", "F_N [N]", "zeta [%]"]].tolist()
    [20.0, 500.0, 2.4]
    >>> table.attrs["units"]["zeta [%]"]
    '%'
    """
    frame = _converted(thing)
    units = {
        name: match[1]
        for name in (*frame.index.names, *frame.columns)
        if isinstance(name, str) and (match := _UNIT.search(name))
    }
    frame.attrs["units"] = units | frame.attrs.get("units", {})
    return frame


@singledispatch
def _converted(thing: Any) -> "pd.DataFrame":
    """The table that an object makes of itself; a class has none."""
    for name in () if isinstance(thing, type) or not type(thing).__module__.startswith("ema.") else _OWN:
        if callable(method := getattr(thing, name, None)):
            return method()
    raise InputError(
        "no table of such an object",
        got=type(thing).__name__,
        expected="FRFs, a record, modes, a map, a decay, a forecast, a ranking, a campaign or a study",
        advice="save other objects by ema.store.save",
    )


_OWN = ("to_dataframe", "table")
"""Methods by which objects make a table of themselves."""


@_converted.register
def _(frfs: FrfSet) -> Any:
    frame = frfs.to_dataframe()
    if frfs.scaled:
        frame.attrs["units"] = dict.fromkeys(frame.columns, frfs.unit)
    return frame


@_converted.register
def _(campaign: Campaign) -> Any:
    return campaign.index()


@_converted.register
def _(forecast: Forecast) -> Any:
    bounds = {"f low": "Hz", "f high": "Hz", "zeta low": "%", "zeta high": "%"}
    return forecast.table().rename(columns={name: f"{name} [{unit}]" for name, unit in bounds.items()})


@_converted.register
def _(check: ForecastCheck) -> Any:
    frame = _converted(check.forecast)
    order = (0, 2, 1)  # the table of a forecast runs over modes, F_N and F_E
    for name, values in (
        ("f measured [Hz]", check.measured_frequency),
        ("zeta measured [%]", 100 * check.measured_damping),
    ):
        frame[name] = values.transpose(order).ravel()
    return frame


@_converted.register
def _(placement: Placement) -> Any:
    return placement.ranking.table()


@_converted.register
def _(result: RunResult) -> Any:
    return result.modes.table()


@_converted.register
def _(study: StudyResult) -> Any:
    import pandas as pd

    tables = {result.run.id: result.modes.table() for result in study.runs}
    return pd.concat(tables, names=["run"]) if tables else pd.DataFrame(columns=["f [Hz]", "zeta [%]"])


@_converted.register
def _(curve: SteadyStateCurve) -> Any:
    columns: Columns = {"frequency [Hz]": curve.frequencies}
    columns |= {f"{dof} [{_length(dof)}]": curve.values[:, n] for n, dof in enumerate(curve.dofs)}
    about = {"error estimate": curve.error_estimate, "highest harmonic": curve.harmonics}
    verdicts = {"stability": list(curve.verdicts), "loss": list(curve.losses), "largest multiplier": curve.largest}
    reasons = {"undecided because": list(curve.undecided_because or [""] * len(curve.verdicts))}
    return _frame(columns | about | verdicts | reasons)


@_converted.register
def _(found: CoexistingStates) -> Any:
    columns: Columns = {"frequency [Hz]": [state.frequency for state in found.states]}
    columns |= {
        f"{dof} [{_length(dof)}]": [state.first[n] for state in found.states] for n, dof in enumerate(found.dofs)
    }
    verdicts = [state.stability for state in found.states]
    return _frame(
        columns
        | {
            "error estimate": [state.error_estimate for state in found.states],
            "stability": [one.verdict for one in verdicts],
            "loss": [one.loss for one in verdicts],
            "largest multiplier": [one.largest for one in verdicts],
            "undecided because": [one.reason for one in verdicts],
        }
    )


@_converted.register
def _(table: PoleTable) -> Any:
    return _frame(
        {
            "order": table.order,
            "f [Hz]": table.natural_frequencies,
            "zeta [%]": 100 * table.damping_ratios,
            "letter": table.letter,
        }
    )


@_converted.register
def _(measured: ModalMap) -> Any:
    columns = _axes(measured)
    for name, unit, scale, values, std in (
        ("f", "Hz", 1, measured.frequency, measured.frequency_std),
        ("zeta", "%", 100, measured.damping, measured.damping_std),
    ):
        columns[f"{name} [{unit}]"] = scale * values
        columns[f"std {name} [{unit}]"] = None if std is None else scale * std
    columns["force at resonance [N]"] = measured.force_at_resonance
    columns["modal amplitude [m kg^0.5]"] = measured.modal_amplitude
    columns["zeta by quadrature [%]"] = _percent(measured.quadrature_damping)
    columns["misfit"] = measured.misfit
    if measured.joint_forces is not None:
        forces = np.moveaxis(measured.joint_forces, 2, 0)
        names = measured.joints if len(measured.joints) == len(forces) else range(1, len(forces) + 1)
        columns |= {f"F_N {name} [N]": force for name, force in zip(names, forces, strict=True)}
    return _frame(columns)


@_converted.register
def _(result: MapResult) -> Any:
    frame = _converted(result.chart)
    frame["force at resonance over the force beside it"] = result.dropout.ravel()
    return frame


@_converted.register
def _(predicted: MapPrediction) -> Any:
    frequency = (predicted.frequency, predicted.frequency_low, predicted.frequency_high)
    damping = (predicted.damping, predicted.damping_low, predicted.damping_high)
    return _frame(
        _axes(predicted) | _interval("f", "Hz", *frequency) | _interval("zeta", "%", *(100 * one for one in damping))
    )


@_converted.register
def _(comparison: MapComparison) -> Any:
    measured, simulated = comparison.measured, comparison.simulated
    return _frame(
        _axes(measured)
        | {
            "f measured [Hz]": measured.frequency,
            "f model [Hz]": simulated.frequency,
            "df [%]": 100 * comparison.frequency_error,
            "zeta measured [%]": 100 * measured.damping,
            "zeta model [%]": 100 * simulated.damping,
            "zeta model / measured": comparison.damping_ratio,
        }
    )


@_converted.register
def _(mode: AmplitudeDependentMode) -> Any:
    columns = _mode_at(mode) | {"force [N]": mode.force}
    return _frame(columns)


@_converted.register
def _(predicted: AmplitudePrediction) -> Any:
    force = {} if predicted.force is None else _band("force", "N", predicted.force)
    return _frame(_mode_at(predicted) | force | {"amplitude / highest measured": predicted.beyond})


@_converted.register
def _(predicted: ForcedResonances) -> Any:
    return _frame(
        {"force [N]": predicted.force}
        | _band("amplitude", SI_UNIT[predicted.quantity], predicted.amplitude)
        | _frequency_and_damping(predicted)
        | {"amplitude / highest measured": predicted.beyond, "several resonances": predicted.several}
    )


@_converted.register
def _(response: ForcedResponse) -> Any:
    unit = SI_UNIT[response.quantity]
    columns: Columns = {"frequency [Hz]": response.frequencies, "force [N]": response.force}
    for sweep, size, phase in (("up", response.up, response.phase_up), ("down", response.down, response.phase_down)):
        columns |= _band(f"amplitude {sweep}", unit, size) | _band(f"phase {sweep}", "rad", phase)
    return _frame(columns | {"responses": response.solutions})


@_converted.register
def _(surface: ForceSurface) -> Any:
    amplitude, frequency = np.meshgrid(surface.amplitude, surface.frequencies, indexing="ij")
    axes = {f"amplitude [{SI_UNIT[surface.quantity]}]": amplitude, "frequency [Hz]": frequency}
    beyond = np.broadcast_to(surface.beyond[:, None], amplitude.shape)
    return _frame(axes | _band("force", "N", surface.force) | {"amplitude / highest measured": beyond})


@_converted.register
def _(level: SteppedLevel) -> Any:
    unit = SI_UNIT[level.quantity]
    columns: Columns = {
        "frequency [Hz]": level.frequencies,
        "force [N]": level.force,
        f"response [{unit}]": level.response,
    }
    for order, values in enumerate(() if level.harmonics is None else level.harmonics, start=2):
        columns[f"harmonic {order} [{unit}]"] = values
    return _frame(columns)


@_converted.register
def _(decay: Decay) -> Any:
    columns: Columns = {"time [s]": decay.times, "amplitude": decay.amplitudes}
    for name, unit, scale, values, reach in (
        ("f", "Hz", 1, decay.frequencies, decay.frequency_reach),
        ("zeta", "%", 100, decay.damping_ratios, decay.damping_reach),
    ):
        half = np.nan if reach is None else reach
        interval = _interval(name, unit, scale * values, scale * (values - half), scale * (values + half))
        columns |= {f"{name} [{unit}]": scale * values} if reach is None else interval
    return _frame(columns)


@_converted.register
def _(loop: Loop) -> Any:
    return _frame({"time [s]": loop.times, "displacement [m]": loop.displacements, "force [N]": loop.forces})


@_converted.register
def _(motion: Response) -> Any:
    columns: Columns = {"time [s]": motion.times}
    for values, per in ((motion.displacements, ""), (motion.velocities, "/s")):
        columns |= {f"{dof} [{_length(dof)}{per}]": row for dof, row in zip(motion.dofs, values, strict=True)}
    return _frame(columns)


@_converted.register
def _(response: HarmonicResponse) -> Any:
    columns: Columns = {"frequency [Hz]": response.frequencies}
    for row, dof in enumerate(response.dofs):
        for column, order in enumerate(response.orders):
            columns[f"{dof} harmonic {order} [{_length(dof)}]"] = response.values[:, row, column]
    return _frame(columns | {"converged": response.converged})


@_converted.register
def _(mode: NonlinearMode) -> Any:
    return _frame(
        {
            "modal amplitude [m kg^0.5]": mode.amplitudes,
            "f [Hz]": mode.frequencies,
            "zeta [%]": 100 * mode.damping_ratios,
            "friction power [W]": mode.friction_power,
            "damping power [W]": mode.damping_power,
        }
    )


@_converted.register
def _(geometry: Geometry) -> Any:
    return _frame(
        {"node": geometry.nodes} | {f"{axis} [m]": geometry.xyz[:, column] for column, axis in enumerate("xyz")}
    ).set_index("node")


def _frame(columns: Columns) -> "pd.DataFrame":
    """A table of the columns that are known, each of them laid out in one row after the other."""
    import pandas as pd

    return pd.DataFrame({name: np.ravel(values) for name, values in columns.items() if values is not None})


def _axes(over: ModalMap | MapPrediction) -> Columns:
    """Force levels and normal forces of every condition."""
    level, force = np.meshgrid(over.force_levels, over.normal_forces, indexing="ij")
    return {"F_E [N]": level, "F_N [N]": force}


def _interval(name: str, unit: str, value: np.ndarray, low: np.ndarray, high: np.ndarray) -> Columns:
    return {f"{name} [{unit}]": value, f"{name} low [{unit}]": low, f"{name} high [{unit}]": high}


def _band(name: str, unit: str, band: Band, scale: float = 1.0) -> Columns:
    return _interval(name, unit, scale * band.value, scale * band.low, scale * band.high)


def _mode_at(mode: AmplitudeDependentMode | AmplitudePrediction) -> Columns:
    return {f"amplitude [{SI_UNIT[mode.quantity]}]": mode.amplitude} | _frequency_and_damping(mode)


def _frequency_and_damping(mode: AmplitudeDependentMode | AmplitudePrediction | ForcedResonances) -> Columns:
    return _band("f", "Hz", mode.frequency) | _band("zeta", "%", mode.damping, 100)


def _percent(values: "np.ndarray | None") -> "np.ndarray | None":
    return None if values is None else 100 * values


def _length(dof: Dof) -> str:
    """Unit of a displacement: of a rotation rad."""
    return "rad" if "R" in dof.direction else "m"
