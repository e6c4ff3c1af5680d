"""Recorded signals over time."""

import numpy as np
from matplotlib.figure import Figure

from ema.data import Recording
from ema.show.style import BLUE, GREY, VERMILION, empty_note, new_figure, styled
from ema.units import UNSTATED

MOST_ROWS = 12
"""Channels in one figure: as many as fit a page with legible axes."""
_MOST_COLUMNS = 2000
"""Groups of samples of a drawn signal; the extremes of each are drawn, so no peak is lost."""


@styled
def signals(recording: Recording) -> Figure:
    """Draw the signals of a record over time, one below the other; channels with an overload stand out.

    Parameters
    ----------
    recording : Recording
        The record; of more than twelve channels the first twelve are drawn, which the title says.

    Returns
    -------
    Figure
        The figure, with a note in it where there is no sample.

    Examples
    --------
    >>> from ema.examples import recording
    >>> len(signals(recording()).axes)
    2
    """
    shown = recording.channels[:MOST_ROWS]
    if not shown or not recording.signals.shape[1]:
        figure = new_figure(1.5)
        empty_note(figure.subplots(), "the record is empty")
        return figure
    figure = new_figure(0.6 + 1.15 * len(shown))
    panels = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
    for row, (axes, channel) in enumerate(zip(panels, shown, strict=True)):
        over = recording.overloads is not None and bool(recording.overloads[row])
        times, values = _extremes(recording.signals[row], recording.sampling_rate)
        axes.axhline(0, color=GREY, lw=0.6)
        axes.plot(times, values, color=VERMILION if over else BLUE, lw=0.8)
        at = f" at {channel.dof}" if channel.dof else ""
        axes.set_title(f"{channel.name}{at}" + (": overload" if over else ""))
        axes.set_ylabel(f"[{'unit unstated' if channel.unit == UNSTATED else channel.unit.replace('^2', '²')}]")
    panels[-1].set_xlabel("Time [s]")
    panels[-1].set_xlim(0, recording.duration)
    if len(recording.channels) > len(shown):
        figure.suptitle(f"the first {len(shown)} of {len(recording.channels)} channels", fontsize=9)
    return figure


def _extremes(values: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Times and values of a signal; of a long one, least and largest value of each group of samples."""
    step = -(-len(values) // _MOST_COLUMNS)
    if step <= 2:
        return np.arange(len(values)) / rate, np.asarray(values)
    starts = np.arange(0, len(values), step)
    ends = np.column_stack([np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)])
    return np.repeat((starts + step / 2) / rate, 2), ends.ravel()
