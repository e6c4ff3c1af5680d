"""Curves of steady states over frequency, with what of them is stable."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ema.data.stability import STABLE, UNDECIDED, UNSTABLE, SteadyStateCurve
from ema.messages import text
from ema.show.style import BLACK, SERIES, empty_note, new_figure, styled

_STYLES = {STABLE: "-", UNSTABLE: "--"}
"""Line of a verdict; dotted where it is undecided."""


@styled
def steady_state_curves(curves: Sequence[SteadyStateCurve], labels: Sequence[str] = ()) -> Figure:
    """Draw the first harmonic of the first DOF per newton along curves: solid where stable, dashed where unstable.

    Parts whose stability is undecided are dotted. Curves of one label have one colour. The legend has the verdicts that
    are drawn.

    Parameters
    ----------
    curves : sequence of SteadyStateCurve
        The curves.
    labels : sequence of str, optional
        One for each; their force by default.

    Returns
    -------
    Figure
        The figure, with a note in it where there is no curve.

    Examples
    --------
    >>> from ema.dof import Dof
    >>> curve = SteadyStateCurve(
    ...     frequencies=[40.0, 41.0, 40.5], values=[[1e-4], [2e-4], [3e-4]], dofs=(Dof(1, "+X"),), force=1.0,
    ...     largest=[0.9, 1.0, 1.1], verdicts=("stable", "undecided", "unstable"), losses=("", "", "fold"),
    ...     error_estimate=[4e-3, 4e-3, 4e-3], harmonics=[5, 7, 7],
    ... )
    >>> len(steady_state_curves([curve]).axes[0].lines)
    2
    """
    figure = new_figure(4.2)
    axes = figure.subplots()
    if not curves:
        empty_note(axes, text("no steady state"))
        return figure
    names = [labels[n] if n < len(labels) else f"{curve.force:g} N" for n, curve in enumerate(curves)]
    colours = {name: SERIES[n % len(SERIES)][0] for n, name in enumerate(dict.fromkeys(names))}
    for curve, name in zip(curves, names, strict=True):
        gain = 1e6 * np.abs(curve.values[:, 0]) / curve.force
        for first, last in _stretches(curve.verdicts):
            part = slice(first, last + 1)
            style = _STYLES.get(curve.verdicts[first], ":")
            axes.plot(curve.frequencies[part], gain[part], ls=style, color=colours[name], lw=1.2)
    axes.set_yscale("log")
    axes.set_xlabel(text("Frequency [Hz]"))
    axes.set_ylabel(f"|X({curves[0].dofs[0]})| / F [µm/N]")
    lines = [Line2D([], [], color=colour, label=name) for name, colour in colours.items()]
    drawn = {curve.verdicts[first] for curve in curves for first, _ in _stretches(curve.verdicts)}
    lines += [
        Line2D([], [], color=BLACK, ls=_STYLES.get(verdict, ":"), label=word)
        for verdict, word in ((STABLE, text("stable")), (UNSTABLE, text("unstable")), (UNDECIDED, text("undecided")))
        if verdict in drawn
    ]
    axes.legend(handles=lines, loc="best", fontsize="small")
    return figure


def _stretches(verdicts: Sequence[str]) -> list[tuple[int, int]]:
    """First point of every stretch of one verdict, and that at which the next one begins."""
    begins = [0, *(n for n in range(1, len(verdicts)) if verdicts[n] != verdicts[n - 1])]
    return [(first, last) for first, last in zip(begins, [*begins[1:], len(verdicts) - 1], strict=True) if last > first]
