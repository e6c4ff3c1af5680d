"""Frequency and damping of the modes of an answer over the date, as a picture."""

from datetime import date

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter, date2num
from matplotlib.figure import Figure

from ema.archive.finding import Answer, Observation
from ema.show.style import GREY, SERIES, empty_note, new_figure, styled

_MOST_SERIES = 5
"""Structures with a colour of their own; the rest share a grey one. More colours cannot be distinguished."""


@styled
def trend(answer: Answer) -> Figure:
    """Draw damping ratio and natural frequency over the date of the campaign, with 95 % intervals.

    The intervals are those of each fit: scatter between assemblies and tests shows as the spread of the points.

    Parameters
    ----------
    answer : Answer
        What :func:`ema.archive.find` returned.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> from ema.archive import Query
    >>> trend(Answer(query=Query(), observations=(), campaigns=0, runs=0)).axes[0].get_ylabel()
    'Damping ratio [%]'
    """
    figure = new_figure(5.6)
    upper, lower = figure.subplots(2, 1, sharex=True)
    upper.set_ylabel("Damping ratio [%]")
    lower.set_ylabel("Natural frequency [Hz]")
    dated = [one for one in answer.observations if one.date]
    if not dated:
        for axes in (upper, lower):
            empty_note(axes, "no mode with a date")
        return figure
    for number, (name, rows) in enumerate(_by_structure(dated)):
        colour, _, marker = SERIES[number] if number < _MOST_SERIES else (GREY, "", "o")
        label = f"{name or 'structure not stated'} ({len(rows)})"
        _points(upper, rows, ("damping", 100.0), (colour, marker, label))
        _points(lower, rows, ("frequency", 1.0), (colour, marker, label))
    locator = AutoDateLocator(minticks=3, maxticks=9)
    lower.xaxis.set_major_locator(locator)
    lower.xaxis.set_major_formatter(ConciseDateFormatter(locator))
    lower.set_xlabel("Date of the campaign")
    upper.set_title(_title(answer, len(dated)))
    upper.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0, markerscale=1.4)
    return figure


_MANY = 300
"""Modes of a structure from which on points are small, without an edge, and pixels also in files of lines."""


def _by_structure(rows: list[Observation]) -> list[tuple[str, list[Observation]]]:
    """Structures by their number of modes; from a certain one on together."""
    groups: dict[str, list[Observation]] = {}
    for row in rows:
        groups.setdefault(row.structure, []).append(row)
    ordered = sorted(groups.items(), key=lambda item: (-len(item[1]), item[0]))
    if len(ordered) <= _MOST_SERIES:
        return ordered
    rest = [row for _, own in ordered[_MOST_SERIES:] for row in own]
    return [*ordered[:_MOST_SERIES], (f"{len(ordered) - _MOST_SERIES} other structures", rest)]


def _points(axes: Axes, rows: list[Observation], what: tuple[str, float], look: tuple[str, str, str]) -> None:
    """Values with their intervals; points of one day stand side by side."""
    name, factor = what
    colour, marker, label = look
    days = date2num([date.fromisoformat(row.date) for row in rows])
    value, low, high = (factor * np.array([getattr(row, name + end) for row in rows]) for end in ("", "_low", "_high"))
    known = np.isfinite(low) & np.isfinite(high)
    nothing = np.full(len(days), np.nan)
    # one line with gaps, which is drawn in a fraction of the time of a line for every interval
    across = np.column_stack([days, days, nothing])[known].ravel()
    along = np.column_stack([low, high, nothing])[known].ravel()
    many = len(rows) > _MANY
    order = 2.0 if colour == GREY else 3.0  # what is named lies on top
    axes.plot(across, along, "-", color=colour, lw=0.8, alpha=0.3 if many else 0.8, rasterized=many, zorder=order)
    size, edge = (1.8, 0.0) if many else (3.5, 0.4)
    axes.plot(
        days,
        value,
        marker,
        label=label,
        rasterized=many,
        ms=size,
        mew=edge,
        mec="white",
        color=colour,
        zorder=order + 0.5,
    )


def _title(answer: Answer, dated: int) -> str:
    query, words = answer.query, [f"{dated} modes"]
    for limits, symbol, unit, factor in (
        (query.frequency, "f", "Hz", 1.0),
        (query.damping, "ζ", "%", 100.0),
        (query.normal_force, "F_N", "N", 1.0),
        (query.force_level, "F_E", "N", 1.0),
    ):
        if limits is not None:
            words.append(f"{symbol} {factor * limits[0]:.4g} to {factor * limits[1]:.4g} {unit}")
    return ", ".join([*words, "95 % intervals of each fit"])
