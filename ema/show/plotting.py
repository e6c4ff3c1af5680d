"""One function that draws any data type by the picture that people expect of it."""

from collections.abc import Callable, Sequence
from typing import Any

from matplotlib.figure import Figure

from ema import data, shapes
from ema.data.stability import SteadyStateCurve
from ema.dof import Dof
from ema.errors import InputError
from ema.show import (
    amplitude_draws,
    amplitude_modes,
    contact_forces,
    control_gain,
    damping_curves,
    force_surface,
    forced_resonances,
    forced_responses,
    forecast_bands,
    frf_overview,
    geometry,
    hits,
    hysteresis,
    joint_parameters,
    mac_matrix,
    map_comparison,
    map_prediction,
    mode_changes,
    mode_shapes,
    motion,
    nonlinear_mode,
    normal_force,
    parameters,
    placement_map,
    ring_down,
    shapes_over_dofs,
    signals,
    stabilisation,
    steady_state_curves,
    steady_states,
    stepped_levels,
)
from ema.show.joint_result import JointResult
from ema.show.style import BLUE, new_figure, styled


def plot(thing: Any, **options: Any) -> Figure:
    """Draw any data type by the picture that shows most of it.

    Parameters
    ----------
    thing : object
        One of the data types of ``ema.data`` that hold curves, points or intervals, a comparison of ``ema.shapes``, or
        a sequence of one type where its picture takes several (responses, curves of steady states, loops, ring-downs,
        stepped levels, modes over the amplitude).
    **options
        Keyword arguments of the picture that is chosen, such as ``modes=[0, 2]``; for a ``ModalModel``,
        ``geometry=points`` draws its shapes in space.

    Returns
    -------
    Figure
        A figure of matplotlib; it is neither shown nor saved.

    Raises
    ------
    InputError
        If the thing has no picture (texts and single numbers), is none of our data types, or takes no such option.

    Examples
    --------
    >>> from ema.examples import frf_set, geometry, modal_model
    >>> figure = plot(frf_set())
    >>> figure = plot(modal_model(), geometry=geometry())
    >>> plot(modal_model().findings)
    Traceback (most recent call last):
        ...
    ema.errors.InputError: ema.show.plot: no picture of an empty sequence; got (), expected a data type of ema.data
    """
    if isinstance(thing, list | tuple):
        return _several(thing, options)
    draw = next((draw for kind, draw in PICTURES.items() if isinstance(thing, kind)), None)
    if draw is None:
        raise _no_picture(thing)
    try:
        return draw(thing, **options)
    except TypeError as error:
        if "unexpected keyword argument" not in str(error) or not options:
            raise
        raise InputError(
            f"the picture of a {type(thing).__name__} takes no such option",
            where="ema.show.plot",
            got=", ".join(options),
            advice="see the functions of ema.show",
        ) from error


def _several(things: Sequence[Any], options: dict[str, Any]) -> Figure:
    if not things:
        raise InputError(
            "no picture of an empty sequence", where="ema.show.plot", got=things, expected="a data type of ema.data"
        )
    kinds = {type(thing) for thing in things}
    drawn = [kind for kind in SEVERAL if kinds == {kind}]
    if not drawn:
        raise InputError(
            "no picture of several of these together",
            where="ema.show.plot",
            got=", ".join(sorted(kind.__name__ for kind in kinds)),
            expected="a sequence of one of " + ", ".join(sorted(kind.__name__ for kind in SEVERAL)),
        )
    return SEVERAL[drawn[0]](things, **options)


def _no_picture(thing: Any) -> InputError:
    if isinstance(thing, data.Finding) or type(thing).__module__.startswith("ema."):
        return InputError(
            f"a {type(thing).__name__} is text and single numbers, which have no picture",
            where="ema.show.plot",
            advice="print it",
        )
    return InputError(
        "no picture of such a thing",
        where="ema.show.plot",
        got=type(thing).__name__,
        expected="a data type of ema.data",
        advice="FrfSet.from_arrays and Recording.from_arrays take arrays",
    )


def _model(model: data.ModalModel, geometry: data.Geometry | None = None, **options: Any) -> Figure:
    return shapes_over_dofs(model, **options) if geometry is None else mode_shapes(model, geometry, **options)


def _geometry_of(campaign: data.Campaign, **options: Any) -> Figure:
    if campaign.geometry is None:
        raise InputError(
            "a campaign is drawn by its geometry, and this one has none",
            where=campaign.name,
            advice="draw a run: ema.show.plot(campaign['name'])",
        )
    by_role: dict[str, list[Dof]] = {"response": [], "reference": []}
    for channel in campaign.channels:
        if channel.role in by_role and channel.dof is not None and channel.dof.node in campaign.geometry:
            by_role[channel.role].append(channel.dof)
    return geometry(
        campaign.geometry,
        responses=by_role["response"],
        references=by_role["reference"],
        title=campaign.name,
        **options,
    )


def _run(run: data.Run, **options: Any) -> Figure:
    if len(run.frfs):
        return frf_overview(run.frfs[0], **options)
    if len(run.recordings):
        return signals(run.recordings[0], **options)
    if run.levels:
        return stepped_levels(run.levels, **options)
    raise InputError("the run holds no measurement", where=run.id, expected="FRFs, records or stepped levels")


def _study(study: data.StudyResult, **options: Any) -> Figure:
    """What the study was made for: the check of its forecast, the placement, the first map, mode, run, ring-down."""
    first = [study.forecast_check, study.placement, *study.maps, *study.runs, *study.decays, *study.loops]
    chosen = next((one for one in first if one is not None), None)
    if chosen is None and study.amplitude_modes:
        return amplitude_modes(study.amplitude_modes, **options)
    return plot(study.campaign if chosen is None else chosen, **options)


@styled
def _ranking(ranking: data.Ranking) -> Figure:
    """Scores of the best locations with their 95 % intervals."""
    figure = new_figure(3.2)
    axes = figure.subplots()
    places = ranking.places[:20]
    low, value, high = (
        [100 * getattr(place, name) for place in places] for name in ("score_low", "score", "score_high")
    )
    numbers = list(range(1, len(places) + 1))
    off = [[max(0.0, v - a) for a, v in zip(low, value)], [max(0.0, b - v) for v, b in zip(value, high)]]
    axes.errorbar(numbers, value, off, fmt="o", ms=4, capsize=3, color=BLUE)
    axes.set_xticks(numbers)
    axes.set_xlabel("Rank of the location")
    axes.set_ylabel("Objective [%]")
    axes.set_title(ranking.objective)
    return figure


def _shape_comparison(comparison: shapes.Comparison, **options: Any) -> Figure:
    return mac_matrix(comparison.mac, **options)


PICTURES: dict[type, Callable[..., Figure]] = {
    data.AmplitudeDependentMode: lambda mode, **options: amplitude_modes([mode], **options),
    data.AmplitudeDraws: amplitude_draws,
    data.AmplitudePrediction: lambda prediction: amplitude_modes([], [prediction]),
    data.Campaign: _geometry_of,
    data.Condition: normal_force,
    data.ConditionDifference: mode_changes,
    data.ContactPressure: contact_forces,
    data.ControlStudy: control_gain,
    data.Decay: ring_down,
    data.ForceSurface: force_surface,
    data.ForcedResonances: forced_resonances,
    data.ForcedResponse: lambda response, **options: forced_responses([response], **options),
    data.Forecast: forecast_bands,
    data.ForecastCheck: forecast_bands,
    data.FrfSet: frf_overview,
    data.Geometry: geometry,
    data.HarmonicResponse: steady_states,
    data.HitGallery: hits,
    JointResult: joint_parameters,
    data.Loop: hysteresis,
    data.MapComparison: map_comparison,
    data.MapPrediction: map_prediction,
    data.MapResult: lambda result, **options: damping_curves(result.chart, **options),
    data.ModalMap: damping_curves,
    data.ModalModel: _model,
    data.ModeComparison: mode_changes,
    data.ModelUpdate: parameters,
    data.NonlinearMode: nonlinear_mode,
    data.Placement: placement_map,
    data.PoleTable: stabilisation,
    data.Ranking: _ranking,
    data.Recording: signals,
    data.RepeatGroup: mode_changes,
    data.Response: motion,
    data.Run: _run,
    data.RunResult: lambda result, **options: frf_overview(result.frfs, result.modes, **options),
    data.SetUpShifts: mode_changes,
    SteadyStateCurve: lambda curve, **options: steady_state_curves([curve], **options),
    data.SteppedLevel: stepped_levels,
    data.StudyResult: _study,
    shapes.Comparison: _shape_comparison,
}
"""The picture of each data type."""

SEVERAL: dict[type, Callable[..., Figure]] = {
    data.AmplitudeDependentMode: amplitude_modes,
    data.Decay: ring_down,
    data.ForcedResponse: forced_responses,
    data.HarmonicResponse: steady_states,
    data.Loop: hysteresis,
    data.Response: motion,
    SteadyStateCurve: steady_state_curves,
    data.SteppedLevel: stepped_levels,
}
"""The pictures that take several of a type."""
