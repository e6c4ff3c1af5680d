"""Frequency and damping of a mode over its amplitude, measured and predicted."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from ema.data import AmplitudeDependentMode, AmplitudePrediction
from ema.show.style import SERIES, empty_note, new_figure
from ema.units import SI_UNIT


def amplitude_modes(modes: Sequence[AmplitudeDependentMode], predictions: Sequence[AmplitudePrediction] = ()) -> Figure:
    """Frequency [Hz] and damping ratio [%] over the amplitude; bars and shaded bands are 95 % intervals.

    Predictions are drawn as bands with their medians, measured levels as points; a dotted line marks the highest level
    that a prediction was fitted to.
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
    quantity = modes[0].quantity if modes else predictions[0].quantity
    damping.set_xlabel(f"Amplitude of the {quantity} [{SI_UNIT[quantity].replace('^2', '²')}]")
    frequency.set_ylabel("Frequency [Hz]")
    damping.set_ylabel("Damping ratio [%]")
    frequency.legend(loc="best")
    return figure
