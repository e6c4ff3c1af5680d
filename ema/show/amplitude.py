"""Frequency and damping of a mode over its amplitude, measured and predicted."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ema.data import AmplitudeDependentMode, AmplitudePrediction, NonlinearMode, SteppedLevel
from ema.errors import InputError
from ema.messages import mark, text, word
from ema.show.style import BLUE, SERIES, amplitude_label, empty_note, logarithmic, new_figure, one_quantity, styled
from ema.units import SI_UNIT

_MARKS = (("slip-onset", "--", mark("slip begins")), ("impact-amplitude", "-.", mark("behind the impacts")))
"""Findings of a mode whose value is an amplitude, and how they are drawn."""
_STATED = ("stated-frequency", "stated-damping")
"""Findings whose value is a frequency [Hz] or a damping ratio that a publication states of the mode."""
_QUANTITIES = (mark("displacement"), mark("velocity"), mark("acceleration"))
"""What an amplitude measures, as data say it."""


@styled
def amplitude_modes(modes: Sequence[AmplitudeDependentMode], predictions: Sequence[AmplitudePrediction] = ()) -> Figure:
    """Draw frequency and damping ratio of modes over their amplitude, with 95 % intervals.

    Predictions are drawn as bands with their medians, one amplitude alone as a diamond with its bar, measured levels as
    points with bars; a dotted line marks the highest level that a prediction was fitted to. Where the findings of a
    mode state it, a dashed line marks the onset of slip and a dash-dotted one the median amplitude behind the impacts;
    a dotted level is what a publication states, with a diamond at every amplitude to which it belongs. Amplitudes that
    span more than a decade are on a logarithmic axis.

    Parameters
    ----------
    modes : sequence of AmplitudeDependentMode
        Measured modes; frequency [Hz], damping drawn in percent.
    predictions : sequence of AmplitudePrediction, optional
        Predictions at amplitudes that were not measured.

    Returns
    -------
    Figure
        The figure, with a note in it where there is nothing to draw.

    Raises
    ------
    InputError
        If the amplitudes are not of one quantity.

    Examples
    --------
    >>> from ema.data import AmplitudeDependentMode, Band
    >>> band = Band(low=[0.009, 0.011], value=[0.010, 0.012], high=[0.011, 0.013])
    >>> frequency = Band(low=[39.9, 39.7], value=[40.0, 39.8], high=[40.1, 39.9])
    >>> figure = amplitude_modes([AmplitudeDependentMode([1.0, 5.0], frequency, band)])
    >>> len(figure.axes)
    2
    """
    quantity = one_quantity([*modes, *predictions])
    figure = new_figure(4.2)
    if not modes and not predictions:
        empty_note(figure.subplots(), text("no mode over its amplitude"))
        return figure
    frequency, damping = figure.subplots(2, 1, sharex=True)
    for number, mode in enumerate(modes):
        colour, _, marker = SERIES[number % len(SERIES)]
        look = {
            "color": colour,
            "fmt": marker,
            "ms": 4,
            "lw": 0.9,
            "label": text("{mode}, measured", mode=mode.name or text("mode")),
        }
        for axes, band, factor in ((frequency, mode.frequency, 1.0), (damping, mode.damping, 100.0)):
            off = [factor * (band.value - band.low), factor * (band.high - band.value)]
            axes.errorbar(mode.amplitude, factor * band.value, off, **look)
            for code, style, what in _MARKS:
                for finding in mode.findings:
                    if finding.code == code and finding.value is not None:
                        axes.axvline(finding.value, color=colour, ls=style, lw=0.9, label=text(what))
        _mark_stated(mode, frequency, damping, colour)
    for number, prediction in enumerate(predictions):
        colour, style, _ = SERIES[(number + len(modes)) % len(SERIES)]
        for axes, band, factor in ((frequency, prediction.frequency, 1.0), (damping, prediction.damping, 100.0)):
            label = text("{mode}, predicted", mode=prediction.name or text("mode"))
            if len(prediction.amplitude) > 1:
                axes.fill_between(
                    prediction.amplitude, factor * band.low, factor * band.high, color=colour, alpha=0.2, lw=0
                )
                axes.plot(prediction.amplitude, factor * band.value, color=colour, ls=style, label=label)
            else:
                off = [factor * (band.value - band.low), factor * (band.high - band.value)]
                axes.errorbar(
                    prediction.amplitude, factor * band.value, off, fmt="D", ms=4, capsize=3, color=colour, label=label
                )
            fitted = float(prediction.amplitude[0] / prediction.beyond[0])
            axes.axvline(fitted, color=colour, ls=":", lw=0.9, label=text("highest level fitted"))
    measured = np.concatenate([mode.amplitude for mode in modes]) if modes else np.ones(1)
    if logarithmic(measured):
        damping.set_xscale("log")
    damping.set_xlabel(amplitude_label(quantity))
    frequency.set_ylabel(text("Frequency [Hz]"))
    damping.set_ylabel(text("Damping ratio [%]"))
    marked = {code for code, *_ in _MARKS} | set(_STATED)
    if any(finding.code in marked for mode in modes for finding in mode.findings):
        both = [axes.get_legend_handles_labels() for axes in (damping, frequency)]
        named = {label: handle for handles, labels in both for handle, label in zip(handles, labels, strict=True)}
        figure.legend(named.values(), named.keys(), loc="outside upper center", ncols=3)
    else:
        frequency.legend(loc="best")
    return figure


@styled
def amplitude_shapes(mode: AmplitudeDependentMode) -> Figure:
    """Draw the shape of a mode at its responses over the amplitude, with 95 % intervals.

    Parameters
    ----------
    mode : AmplitudeDependentMode
        A mode with shapes; real parts are drawn above imaginary parts.

    Returns
    -------
    Figure
        The figure, with a note in it where the mode has no shapes.

    Examples
    --------
    >>> from ema.data import AmplitudeDependentMode, Band
    >>> from ema.dof import Dof
    >>> band = Band(low=[0.009, 0.011], value=[0.010, 0.012], high=[0.011, 0.013])
    >>> frequency = Band(low=[39.9, 39.7], value=[40.0, 39.8], high=[40.1, 39.9])
    >>> dofs = (Dof(1, "+Z"), Dof(2, "+Z"))
    >>> shape, half = [[1, 1], [0.5, 0.4j]], [[0, 0], [0.01, 0.01]]
    >>> mode = AmplitudeDependentMode([1.0, 5.0], frequency, band, dofs=dofs, shape=shape, shape_half=half)
    >>> len(amplitude_shapes(mode).axes)
    2
    """
    figure = new_figure(4.2)
    if mode.shape is None:
        empty_note(figure.subplots(), text("no shape over the amplitude"))
        return figure
    half = np.zeros(mode.shape.shape) if mode.shape_half is None else mode.shape_half
    real, imaginary = figure.subplots(2, 1, sharex=True)
    for row, dof in enumerate(mode.dofs):
        colour, _, marker = SERIES[row % len(SERIES)]
        for axes, values in ((real, mode.shape[row].real), (imaginary, mode.shape[row].imag)):
            axes.errorbar(mode.amplitude, values, half[row], color=colour, fmt=marker, ms=4, lw=0.9, label=str(dof))
    real.set_ylabel(text("Real part"))
    imaginary.set_ylabel(text("Imaginary part"))
    imaginary.set_xlabel(amplitude_label(mode.quantity))
    if logarithmic(mode.amplitude):
        imaginary.set_xscale("log")
    real.legend(fontsize="small")
    return figure


def _mark_stated(mode: AmplitudeDependentMode, frequency: Axes, damping: Axes, colour: str) -> None:
    """What a publication states of a mode, as a level, and the amplitudes at which the curve crosses it by more than
    its intervals."""
    for code, axes, band, factor in zip(_STATED, (frequency, damping), (mode.frequency, mode.damping), (1.0, 100.0)):
        for finding in mode.findings:
            if finding.code != code or finding.value is None:
                continue
            axes.axhline(factor * finding.value, color=colour, ls=":", lw=0.9, label=text("stated"))
            apart = (band.low > finding.value) | (band.high < finding.value)
            log, off = np.log(mode.amplitude[apart]), band.value[apart] - finding.value
            rows = np.flatnonzero((off[:-1] < 0) != (off[1:] < 0))
            where = np.exp(log[rows] + (log[rows + 1] - log[rows]) * off[rows] / (off[rows] - off[rows + 1]))
            axes.plot(
                where, np.full(len(where), factor * finding.value), "D", color=colour, mfc="white", ms=6, zorder=5
            )


@styled
def stepped_levels(levels: Sequence[SteppedLevel] | SteppedLevel) -> Figure:
    """Draw response over force, and the phase, of the levels of a stepped sine.

    Parameters
    ----------
    levels : sequence of SteppedLevel or SteppedLevel
        Levels of one quantity.

    Returns
    -------
    Figure
        The figure, with a note in it where there is no level.

    Raises
    ------
    InputError
        If the responses are not of one quantity.

    Examples
    --------
    >>> from ema.data import SteppedLevel
    >>> level = SteppedLevel(frequencies=[39.0, 40.0], force=[1, 1], response=[5 + 1j, 9j], quantity="acceleration")
    >>> len(stepped_levels(level).axes)
    2
    """
    some = [levels] if isinstance(levels, SteppedLevel) else list(levels)
    quantity = one_quantity(some)
    figure = new_figure(4.2)
    if not some:
        empty_note(figure.subplots(), text("no level"))
        return figure
    size, phase = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1.2])
    for number, level in enumerate(some):
        colour, style, marker = SERIES[number % len(SERIES)]
        look = {"color": colour, "ls": style, "marker": marker, "ms": 3, "lw": 1.0}
        ratio = level.response / level.force
        size.semilogy(
            level.frequencies, np.abs(ratio), label=level.name or text("level {number}", number=number + 1), **look
        )
        phase.plot(level.frequencies, np.degrees(np.angle(ratio)), **look)
    size.set_ylabel(
        text(
            "{quantity} over force [({unit})/N]",
            quantity=word(quantity).capitalize(),
            unit=SI_UNIT[quantity].replace("^2", "²"),
        )
    )
    size.legend(loc="best")
    phase.set_ylabel(text("Phase [°]"))
    phase.set_ylim(-190, 190)
    phase.set_yticks([-180, 0, 180])
    phase.set_xlabel(text("Frequency [Hz]"))
    return figure


@styled
def nonlinear_mode(mode: NonlinearMode) -> Figure:
    """Draw frequency and damping ratio of a simulated nonlinear mode over its modal amplitude.

    Parameters
    ----------
    mode : NonlinearMode
        A mode; levels without a solution leave gaps.

    Returns
    -------
    Figure
        The figure.

    Raises
    ------
    InputError
        If no level has a solution.

    Examples
    --------
    >>> from ema.data import NonlinearMode
    >>> from ema.dof import Dof
    >>> mode = NonlinearMode(
    ...     amplitudes=[1e-4], frequencies=[40.0], damping_ratios=[0.01], shapes=[[0.7]], dofs=(Dof(1, "+X"),),
    ...     friction_power=[1e-3], damping_power=[2e-3], frequency_error=[1e-6], damping_error=[1e-5],
    ... )
    >>> len(nonlinear_mode(mode).axes)
    2
    """
    if not np.isfinite(mode.frequencies).any():
        raise InputError(
            "no level has a solution",
            where=mode.name or text("nonlinear mode"),
            advice="ask for amplitudes closer together, or use resonances at force levels",
        )
    figure = new_figure(4.2)
    frequency, damping = figure.subplots(2, 1, sharex=True)
    for axes, values in ((frequency, mode.frequencies), (damping, 100 * mode.damping_ratios)):
        axes.plot(mode.amplitudes, values, "o-", ms=3.5, color=BLUE)
    if logarithmic(mode.amplitudes):
        damping.set_xscale("log")
    frequency.set_ylabel(text("Frequency [Hz]"))
    damping.set_ylabel(text("Damping ratio [%]"))
    damping.set_xlabel(text("Modal amplitude [m √kg]"))
    return figure
