"""Frequency and damping of a mode over its amplitude, measured and predicted."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ema.data import AmplitudeDependentMode, AmplitudePrediction
from ema.show.style import SERIES, empty_note, new_figure
from ema.units import SI_UNIT

_MARKS = (("slip-onset", "--", "slip begins"), ("impact-amplitude", "-.", "behind the impacts"))
"""Findings of a mode whose value is an amplitude, and how they are drawn."""
_STATED = ("stated-frequency", "stated-damping")
"""Findings whose value is a frequency [Hz] or a damping ratio that a publication states of the mode."""
_DECADE = 10.0


def amplitude_modes(modes: Sequence[AmplitudeDependentMode], predictions: Sequence[AmplitudePrediction] = ()) -> Figure:
    """Draw frequency and damping ratio of modes over their amplitude, with 95 % intervals.

    Predictions are drawn as bands with their medians, measured levels as points with bars; a dotted line marks the
    highest level that a prediction was fitted to. Where the findings of a mode state it, a dashed line marks the onset
    of slip and a dash-dotted one the median amplitude behind the impacts; a dotted level is what a publication states,
    with a diamond at every amplitude to which it belongs. Amplitudes that span more than a decade are
    on a logarithmic axis.

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

    Examples
    --------
    >>> from ema.data import AmplitudeDependentMode, Band
    >>> band = Band(low=[0.009, 0.011], value=[0.010, 0.012], high=[0.011, 0.013])
    >>> frequency = Band(low=[39.9, 39.7], value=[40.0, 39.8], high=[40.1, 39.9])
    >>> figure = amplitude_modes([AmplitudeDependentMode([1.0, 5.0], frequency, band)])
    >>> len(figure.axes)
    2
    """
    figure = new_figure(4.2)
    if not modes and not predictions:
        empty_note(figure.subplots(), "no mode over its amplitude")
        return figure
    frequency, damping = figure.subplots(2, 1, sharex=True)
    for number, mode in enumerate(modes):
        colour, _, marker = SERIES[number % len(SERIES)]
        look = {"color": colour, "fmt": marker, "ms": 4, "lw": 0.9, "label": f"{mode.name or 'mode'}, measured"}
        for axes, band, factor in ((frequency, mode.frequency, 1.0), (damping, mode.damping, 100.0)):
            off = [factor * (band.value - band.low), factor * (band.high - band.value)]
            axes.errorbar(mode.amplitude, factor * band.value, off, **look)
            for code, style, what in _MARKS:
                for finding in mode.findings:
                    if finding.code == code and finding.value is not None:
                        axes.axvline(finding.value, color=colour, ls=style, lw=0.9, label=what)
        _mark_stated(mode, frequency, damping, colour)
    for number, prediction in enumerate(predictions):
        colour, style, _ = SERIES[(number + len(modes)) % len(SERIES)]
        for axes, band, factor in ((frequency, prediction.frequency, 1.0), (damping, prediction.damping, 100.0)):
            axes.fill_between(
                prediction.amplitude, factor * band.low, factor * band.high, color=colour, alpha=0.2, lw=0
            )
            label = f"{prediction.name or 'mode'}, predicted"
            axes.plot(prediction.amplitude, factor * band.value, color=colour, ls=style, label=label)
            fitted = float(prediction.amplitude[0] / prediction.beyond[0])
            axes.axvline(fitted, color=colour, ls=":", lw=0.9, label="highest level fitted")
    measured = np.concatenate([mode.amplitude for mode in modes]) if modes else np.ones(1)
    if measured.max() > _DECADE * measured.min():
        damping.set_xscale("log")
    quantity = modes[0].quantity if modes else predictions[0].quantity
    damping.set_xlabel(f"Amplitude of the {quantity} [{SI_UNIT[quantity].replace('^2', '²')}]")
    frequency.set_ylabel("Frequency [Hz]")
    damping.set_ylabel("Damping ratio [%]")
    marked = {code for code, *_ in _MARKS} | set(_STATED)
    if any(finding.code in marked for mode in modes for finding in mode.findings):
        both = [axes.get_legend_handles_labels() for axes in (damping, frequency)]
        named = {label: handle for handles, labels in both for handle, label in zip(handles, labels, strict=True)}
        figure.legend(named.values(), named.keys(), loc="outside upper center", ncols=3)
    else:
        frequency.legend(loc="best")
    return figure


def _mark_stated(mode: AmplitudeDependentMode, frequency: Axes, damping: Axes, colour: str) -> None:
    """What a publication states of a mode, as a level, and the amplitudes at which the curve crosses it."""
    log = np.log(mode.amplitude)
    for code, axes, band, factor in zip(_STATED, (frequency, damping), (mode.frequency, mode.damping), (1.0, 100.0)):
        for finding in mode.findings:
            if finding.code != code or finding.value is None:
                continue
            axes.axhline(factor * finding.value, color=colour, ls=":", lw=0.9, label="stated")
            off = band.value - finding.value
            rows = np.flatnonzero((off[:-1] < 0) != (off[1:] < 0))
            where = np.exp(log[rows] + (log[rows + 1] - log[rows]) * off[rows] / (off[rows] - off[rows + 1]))
            axes.plot(
                where, np.full(len(where), factor * finding.value), "D", color=colour, mfc="white", ms=6, zorder=5
            )
