"""Normal force of the joints during a run."""

import numpy as np
from matplotlib.figure import Figure

from ema.data import Condition
from ema.messages import text
from ema.show.style import BLUE, GREY, SERIES, empty_note, new_figure, styled


@styled
def normal_force(condition: Condition) -> Figure:
    """Draw the mean normal force of each joint with its standard deviation, and its trace where one was recorded.

    Parameters
    ----------
    condition : Condition
        Condition of a measurement.

    Returns
    -------
    Figure
        The figure, with a note in it where there is no joint.

    Examples
    --------
    >>> from ema.examples import campaign
    >>> len(normal_force(campaign()["beam"].condition).axes)
    1
    """
    joints = condition.joints
    traced = [joint for joint in joints if joint.trace is not None and len(joint.trace)]
    figure = new_figure(2.9)
    if not joints:
        empty_note(figure.subplots(), text("no friction beam, no joint"))
        return figure
    panels = figure.subplots(1, 2 if traced else 1, squeeze=False, width_ratios=[1, 2] if traced else [1])[0]
    places = np.arange(len(joints))
    means, spreads = (np.array([getattr(joint, name) for joint in joints]) for name in ("mean", "std"))
    panels[0].errorbar(places, means, np.nan_to_num(spreads), fmt="o", color=BLUE, capsize=4, ms=5)
    for place, joint in zip(places, joints, strict=True):
        if not joint.known:
            panels[0].annotate(
                text("unknown"),
                (place, 0.5),
                xycoords=("data", "axes fraction"),
                rotation=90,
                ha="center",
                va="center",
                color=GREY,
            )
    panels[0].set_xticks(places, [joint.joint for joint in joints], rotation=90 if len(joints) > 5 else 0)
    panels[0].set_xlim(-0.6, len(joints) - 0.4)
    panels[0].set_ylabel(text("Normal force [N]"))
    panels[0].set_title(text("mean ± standard deviation"))
    for number, joint in enumerate(traced):
        colour, style, _ = SERIES[number % len(SERIES)]
        trace = np.asarray(joint.trace)
        times = np.arange(len(trace)) if joint.trace_times is None else np.asarray(joint.trace_times)
        panels[1].plot(times, trace, color=colour, ls=style, lw=1.0, label=joint.joint, rasterized=len(trace) > 5000)
    if traced:
        panels[1].set_xlabel(text("Sample") if traced[0].trace_times is None else text("Time [s]"))
        panels[1].set_ylabel(text("Normal force [N]"))
        panels[1].set_title(text("during the run"))
        panels[1].legend(loc="best", ncols=3)
    return figure
