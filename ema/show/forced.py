"""A mode under a force: draws over the amplitude, force surface, resonances and responses swept up and down."""

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from ema.data import AmplitudeDraws, ForcedResonances, ForcedResponse, ForceSurface, SteppedLevel
from ema.errors import InputError
from ema.messages import text
from ema.show.style import (
    BLACK,
    COLOUR_MAP,
    SERIES,
    amplitude_label,
    empty_note,
    logarithmic,
    new_figure,
    one_quantity,
    styled,
)


@styled
def forced_responses(responses: Sequence[ForcedResponse], measured: Sequence[SteppedLevel] = ()) -> Figure:
    """Draw responses to forces over the frequency, swept up and down, with 95 % bands.

    A dotted line is the curve of all responses at constant force, folded ones too; where it lies above the dashed grey
    line it is beyond the highest measured level. Points are measured.

    Parameters
    ----------
    responses : sequence of ForcedResponse
        Predicted responses of one quantity.
    measured : sequence of SteppedLevel, optional
        Levels to compare with.

    Returns
    -------
    Figure
        The figure, with a note in it where there is no response.

    Raises
    ------
    InputError
        If the amplitudes are not of one quantity.

    Examples
    --------
    >>> from ema.data import Band
    >>> band, phase = Band([0.9, 1.9], [1.0, 2.0], [1.1, 2.1]), Band([0.0, 0.0], [0.0, 0.0], [0.0, 0.0])
    >>> response = ForcedResponse([39.0, 40.0], [2.0, 2.0], band, band, phase, phase, solutions=[1, 1])
    >>> len(forced_responses([response]).axes)
    1
    """
    quantity = one_quantity([*responses, *measured])
    figure = new_figure(3.6)
    axes = figure.subplots()
    if not responses:
        empty_note(axes, text("no response"))
        return figure
    for number, response in enumerate(responses):
        colour = SERIES[number % len(SERIES)][0]
        low, high = float(response.force.min()), float(response.force.max())
        force = f"{low:.3g}" if high <= 1.001 * low else f"{low:.3g} to {high:.3g}"
        for sweep, style, said in (
            (response.up, "-", text("{force} N, swept up", force=force)),
            (response.down, "--", text("{force} N, swept down", force=force)),
        ):
            top = np.where(np.isfinite(sweep.high), sweep.high, np.nanmax(sweep.value[np.isfinite(sweep.value)]) * 2)
            axes.fill_between(response.frequencies, sweep.low, top, color=colour, alpha=0.15, lw=0)
            value = np.where(np.isfinite(sweep.value), sweep.value, np.nan)
            axes.plot(response.frequencies, value, style, color=colour, lw=1.2, label=said)
        shown = response.solutions.max() > 1
        if shown and len(response.curve_frequencies):
            inside = np.where(
                (response.curve_frequencies >= response.frequencies[0])
                & (response.curve_frequencies <= response.frequencies[-1]),
                response.curve_amplitudes,
                np.nan,
            )
            axes.plot(response.curve_frequencies, inside, ":", color=BLACK, lw=1.0, label=text("all responses"))
    for number, level in enumerate(measured):
        axes.plot(
            level.frequencies, np.abs(level.response), "o", ms=3, color=BLACK, label=level.name if not number else None
        )
    highest = responses[0].highest_level
    if np.isfinite(highest):
        axes.axhline(highest, color="0.5", ls="--", lw=0.9, label=text("highest level fitted"))
    axes.set_xlabel(text("Frequency [Hz]"))
    axes.set_ylabel(amplitude_label(quantity))
    axes.legend(loc="best", fontsize="small")
    return figure


@styled
def force_surface(surface: ForceSurface) -> Figure:
    """Draw the force that keeps up an amplitude at a frequency: median, and the half width of its 95 % band.

    Parameters
    ----------
    surface : ForceSurface
        The surface; a dashed line marks the highest measured amplitude. Contours are response curves at constant force.

    Returns
    -------
    Figure
        The figure.

    Raises
    ------
    InputError
        If the surface has fewer than two amplitudes or frequencies, or no force at all.

    Examples
    --------
    >>> from ema.data import Band
    >>> force = Band(low=[[0.9, 1.9]] * 2, value=[[1.0, 2.0], [2.0, 3.0]], high=[[2.1, 3.1]] * 2)
    >>> len(force_surface(ForceSurface([39.0, 40.0], [2.0, 3.0], force, beyond=[0.5, 1.1])).axes)
    4
    """
    value = surface.force.value
    if min(value.shape) < 2 or not np.isfinite(value).any():
        raise InputError(
            "too little of a force surface to draw",
            where=surface.name or "force surface",
            got=f"{value.shape[0]} amplitudes and {value.shape[1]} frequencies",
            expected="two or more of both",
        )
    figure = new_figure(3.6)
    panels = figure.subplots(1, 2, sharey=True)
    known = value[np.isfinite(value)]
    norm = LogNorm(float(known.min()), float(known.max())) if known.max() > known.min() else None
    width = 100 * surface.force.half_width / value
    mesh = panels[0].pcolormesh(
        surface.frequencies, surface.amplitude, value, norm=norm, cmap=COLOUR_MAP, shading="auto"
    )
    figure.colorbar(mesh, ax=panels[0], label=text("Force [N]"))
    if norm is not None:
        steps = np.geomspace(float(known.min()), float(known.max()), 9)[1:-1]
        panels[0].contour(surface.frequencies, surface.amplitude, value, levels=steps, colors="white", linewidths=0.7)
    mesh = panels[1].pcolormesh(surface.frequencies, surface.amplitude, width, cmap=COLOUR_MAP, shading="auto")
    figure.colorbar(mesh, ax=panels[1], label=text("Half width of the 95 % band [%]"))
    highest = float(surface.amplitude[-1] / surface.beyond[-1])
    for axes in panels:
        axes.axhline(highest, color="white", ls="--", lw=1.0)
        axes.set_xlabel(text("Frequency [Hz]"))
        if logarithmic(surface.amplitude):
            axes.set_yscale("log")
    panels[0].set_ylabel(amplitude_label(surface.quantity))
    return figure


@styled
def forced_resonances(resonances: ForcedResonances) -> Figure:
    """Draw amplitude, frequency and damping ratio at resonance over the force, with 95 % bands.

    Parameters
    ----------
    resonances : ForcedResonances
        Predicted resonances; bars without an end leave the picture.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> from ema.data import Band
    >>> amplitude, frequency = Band([9.0], [10.0], [11.0]), Band([39.0], [39.5], [40.0])
    >>> found = ForcedResonances([0.5], amplitude, frequency, Band([0.01], [0.02], [0.03]), beyond=[2.0], several=[0.0])
    >>> len(forced_resonances(found).axes)
    3
    """
    figure = new_figure(5.0)
    panels = figure.subplots(3, 1, sharex=True)
    rows = (
        (resonances.amplitude, 1.0, amplitude_label(resonances.quantity)),
        (resonances.frequency, 1.0, text("Frequency [Hz]")),
        (resonances.damping, 100.0, text("Damping ratio [%]")),
    )
    for axes, (band, factor, label) in zip(panels, rows, strict=True):
        off = [factor * (band.value - band.low), factor * (band.high - band.value)]
        off = [np.where(np.isfinite(one), one, 0.0) for one in off]
        axes.errorbar(resonances.force, factor * band.value, off, fmt="o", ms=4, capsize=3, color=SERIES[0][0])
        axes.set_ylabel(label)
    panels[-1].set_xlabel(text("Force [N]"))
    return figure


@styled
def amplitude_draws(draws: AmplitudeDraws) -> Figure:
    """Draw median and 95 % band of frequency and damping ratio over the amplitude, as draws have them.

    Parameters
    ----------
    draws : AmplitudeDraws
        Draws of a mode; a dotted line marks the highest measured level.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> draws = AmplitudeDraws([1.0, 2.0], [[40.0, 39.0]], [[0.01, 0.02]], levels=[1.0, 1.5])
    >>> len(amplitude_draws(draws).axes)
    2
    """
    figure = new_figure(4.2)
    panels = figure.subplots(2, 1, sharex=True)
    rows = ((draws.frequency, 1.0, text("Frequency [Hz]")), (draws.damping, 100.0, text("Damping ratio [%]")))
    for axes, (values, factor, label) in zip(panels, rows, strict=True):
        low, value, high = factor * np.quantile(values, [0.025, 0.5, 0.975], axis=0)
        axes.fill_between(draws.amplitude, low, high, color=SERIES[0][0], alpha=0.2, lw=0)
        axes.plot(draws.amplitude, value, color=SERIES[0][0])
        axes.axvline(float(draws.levels[-1]), color=BLACK, ls=":", lw=0.9)
        axes.set_ylabel(label)
    panels[-1].set_xlabel(amplitude_label(draws.quantity))
    if logarithmic(draws.amplitude):
        panels[-1].set_xscale("log")
    return figure
