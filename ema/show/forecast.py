"""Predicted frequency and damping with a placed beam: 95 % bands, and measured values."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ema.data.forecast import Forecast, ForecastCheck
from ema.messages import mark, text
from ema.show.style import BLACK, SERIES, new_figure, styled

_OFFSET = 0.05
"""Distance of neighbouring normal forces on the logarithmic axis of the force level, in decades."""


@styled
def forecast_bands(prediction: Forecast | ForecastCheck) -> Figure:
    """Draw frequency and damping of every mode over F_E: 95 % bands, and measured points where there are some.

    Points within their band are filled, points outside are crosses.

    Parameters
    ----------
    prediction : Forecast or ForecastCheck
        A forecast, alone or compared with measured maps.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> from ema.examples import forecast
    >>> len(forecast_bands(forecast()).axes)
    2
    """
    forecast = prediction.forecast if isinstance(prediction, ForecastCheck) else prediction
    figure = new_figure(3.1 * len(forecast.modes) + 0.4)
    panels = figure.subplots(len(forecast.modes), 2, squeeze=False)
    for m, mode in enumerate(forecast.modes):
        for axes, what, scale in zip(panels[m], ("frequency", "damping"), (1.0, 100.0)):
            _panel(axes, forecast, what, m, scale)
            if isinstance(prediction, ForecastCheck):
                _points(axes, prediction, what, m, scale)
        left, right = panels[m]
        left.set_ylabel(text("Natural frequency [Hz]"))
        right.set_ylabel(text("Damping ratio [%]"))
        right.axhline(100 * forecast.bare_damping[m], color=BLACK, ls=":", lw=0.9)
        left.set_title(
            text("Mode {mode}: bare {frequency} Hz", mode=mode, frequency=f"{forecast.bare_frequencies[m]:.1f}")
        )
        right.set_title(
            text("Mode {mode}: bare {damping} % (dotted)", mode=mode, damping=f"{100 * forecast.bare_damping[m]:.3f}")
        )
    for axes in panels[-1]:
        axes.set_xlabel(text("Excitation force F_E [N]"))
    handles, labels = panels[0, 1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5)
    return figure


def _panel(axes: Axes, forecast: Forecast, what: str, mode: int, scale: float) -> None:
    """The bands of one mode, one colour per normal force."""
    levels = np.asarray(forecast.force_levels)
    # several beams together have no common centre, and may be pressed differently
    named = mark("F_N = {force} N") if np.isfinite(forecast.centre[0]) else mark("largest F_N = {force} N")
    for force, normal in enumerate(forecast.normal_forces):
        colour = SERIES[force % len(SERIES)][0]
        low, high, middle = (scale * getattr(forecast, what + end)[mode, :, force] for end in ("_low", "_high", ""))
        at = _shifted(levels, force, len(forecast.normal_forces))
        axes.vlines(at, low, high, color=colour, lw=5, alpha=0.35)
        axes.plot(at, middle, ls="none", marker="_", ms=9, color=colour, label=text(named, force=f"{normal:g}"))
    axes.set_xscale("log")
    axes.set_xticks(levels, [f"{level:g}" for level in levels])
    axes.minorticks_off()


def _points(axes: Axes, check: ForecastCheck, what: str, mode: int, scale: float) -> None:
    """Measured values."""
    count = len(check.forecast.normal_forces)
    for force in range(count):
        colour, _, marker = SERIES[force % len(SERIES)]
        value = scale * getattr(check, f"measured_{what}")[mode, :, force]
        inside = getattr(check, f"{what}_inside")[mode, :, force]
        at = _shifted(np.asarray(check.forecast.force_levels), force, count)
        axes.plot(at[inside], value[inside], ls="none", marker=marker, ms=5, color=colour, mec="white", mew=0.6)
        axes.plot(at[~inside], value[~inside], ls="none", marker="x", ms=7, mew=1.8, color=colour)


def _shifted(levels: np.ndarray, force: int, count: int) -> np.ndarray:
    """The levels, moved a little so that normal forces stand beside each other."""
    return np.asarray(levels * 10 ** (_OFFSET * (force - (count - 1) / 2)))
