"""Where a friction beam goes: places on the measured surface, recommended normal forces, controlled ring-downs."""

from itertools import pairwise
from string import ascii_uppercase

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from ema.data.placement import Candidates, ControlStudy, Placement
from ema.messages import text, word
from ema.show.selection import check_positions
from ema.show.style import BLACK, COLOUR_MAP, FAINT, GREY, PURPLE, SERIES, VERMILION, empty_note, new_figure, styled


@styled
def placement_map(placement: Placement, shown: int = 3, together: Candidates | None = None) -> Figure:
    """Draw all candidates on the geometry by their score, areas kept free, and the best locations with their joints.

    Parameters
    ----------
    placement : Placement
        A placement.
    shown : int, default 3
        Number of the best locations that are marked.
    together : Candidates, optional
        Beams that were chosen to act together: all of them are drawn, with letters, in the panel of every angle.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> from ema.examples import placement
    >>> len(placement_map(placement()).axes) > 0
    True
    """
    ranking, candidates = placement.ranking, placement.ranking.prediction.candidates
    (x0, x1), (y0, y1) = placement.extent
    angles = np.unique(np.round(candidates.angles, 6))[:4]
    rows = len(angles)
    height = min(3.2, 7.0 * (y1 - y0) / max(x1 - x0, 1e-9)) + 0.8
    figure = new_figure(height * rows)
    panels = figure.subplots(rows, 1, squeeze=False)[:, 0]
    finite = np.isfinite(ranking.scores)
    if not finite.any():
        empty_note(panels[0], text("no place was found"))
        return figure
    scale, unit = score_unit(placement)
    limits = scale * float(ranking.scores[finite].min()), scale * float(ranking.scores[finite].max())
    for axes, angle in zip(panels, angles):
        here = np.isclose(candidates.angles, angle, atol=1e-5)
        size = float(np.clip(3000 / max(int(here.sum()), 1), 22, 110))
        _ground(axes, placement)
        mesh = axes.scatter(
            *candidates.centres[here & finite].T,
            c=scale * ranking.scores[here & finite],
            cmap=COLOUR_MAP,
            s=size,
            vmin=limits[0],
            vmax=limits[1],
            edgecolors="none",
        )
        axes.scatter(*candidates.centres[here & ~finite].T, marker="x", color=GREY, s=16, lw=0.8)
        for number, place in enumerate(ranking.places[:shown], 1):
            if np.isclose(place.angle, angle, atol=1e-5):
                _beam(axes, candidates.joints(place.candidate), str(number), VERMILION if number == 1 else BLACK)
        if together is not None:
            for row in range(len(together)):
                _beam(axes, together.joints(row), ascii_uppercase[row % 26], PURPLE, thick=True)
        axes.set_title(text("Beam at {angle}° (dots: middle of the beam)", angle=f"{np.degrees(angle):.0f}"))
        axes.set_aspect("equal")
        axes.set_ylabel("y [m]")
        axes.grid(visible=False)
    panels[-1].set_xlabel("x [m]")
    figure.colorbar(
        mesh,
        ax=list(panels),
        label=text("Objective, one mode [dB]") if unit == "dB" else text("Objective, one mode [%]"),
    )
    return figure


def score_unit(placement: Placement) -> tuple[float, str]:
    """Factor from a score to what people see, and its unit: levels are in decibels, ratios become percent."""
    return (1.0, "dB") if placement.ranking.objective.startswith(("peak", "chatter")) else (100.0, "%")


def _ground(axes: Axes, placement: Placement) -> None:
    """The structure, edge of the measured rectangle, measured points, areas kept free."""
    edges = seen_edges(placement)
    if len(edges):
        axes.add_collection(LineCollection(list(edges), colors=FAINT, linewidths=0.6, zorder=0.5, rasterized=True))
        axes.autoscale()
    (x0, x1), (y0, y1) = placement.extent
    axes.plot([x0, x1, x1, x0, x0], [y0, y0, y1, y1, y0], color=GREY, lw=1.0)
    axes.plot(*placement.points.T, ls="none", marker="+", ms=4, color=FAINT, mew=0.8)
    for corners in placement.keep_out:
        axes.fill(*np.asarray(corners).T, facecolor="none", edgecolor=VERMILION, hatch="///", lw=0.8)


def seen_edges(placement: Placement) -> Float[np.ndarray, "edge 2 2"]:
    """Lines and edges of the faces of the structure, each once, in the plane of the places; m."""
    geometry = placement.geometry
    if geometry is None:
        return np.zeros((0, 2, 2))
    pairs = {
        (min(a, b), max(a, b))
        for chain in (*geometry.lines, *((*face, face[0]) for face in geometry.faces))
        for a, b in pairwise(chain)
        if a in geometry and b in geometry and a != b
    }
    flat = (geometry.xyz - placement.origin) @ placement.axes[:2].T
    rows = np.array([[geometry.place(a), geometry.place(b)] for a, b in sorted(pairs)], int).reshape(-1, 2)
    return np.asarray(flat[rows])


def _beam(axes: Axes, joints: Float[np.ndarray, "joint 2"], name: str, colour: str, *, thick: bool = False) -> None:
    """Axis of a beam with its joints, and its rank or letter; the best one and those that act together stand out."""
    first = thick or colour != BLACK
    axes.plot(
        *joints.T,
        color=colour,
        lw=3 if first else 1.2,
        marker="s" if thick else "o",
        ms=6 if first else 4,
        mfc="white",
        zorder=5 if first else 4,
    )
    axes.annotate(
        name,
        joints[0] if thick else joints[-1],  # a letter beside a rank stays legible
        xytext=(-5, -13) if thick else (5, 4),
        textcoords="offset points",
        fontsize=8,
        zorder=6,
        color=colour,
        fontweight="bold" if first else "normal",
    )


@styled
def recommended_force(placement: Placement, rank: int = 1) -> Figure:
    """Draw the recommended normal force over the excitation, and the damping with the common normal force.

    Parameters
    ----------
    placement : Placement
        A placement.
    rank : int, default 1
        Rank of the location, from 1.

    Returns
    -------
    Figure
        The figure.

    Raises
    ------
    InputError
        If no location has this rank.

    Examples
    --------
    >>> from ema.examples import placement
    >>> len(recommended_force(placement()).axes)
    2
    """
    ranked = placement.ranking.places
    if rank != 1:  # the first one has the forces that were recommended after the search
        check_positions("rank", [rank], len(ranked), where="placement", first=1)
    place = placement.best if rank == 1 else ranked[rank - 1]
    prediction = placement.ranking.prediction
    levels = np.asarray(prediction.force_levels)
    order = np.argsort(levels)
    figure = new_figure(3.4)
    left, right = figure.subplots(1, 2)
    left.plot(
        levels[order], place.normal_forces[order], marker="o", color=SERIES[0][0], label=text("best for each level")
    )
    left.axhline(place.normal_force, color=GREY, ls="--", lw=1.0, label=text("common to all levels"))
    left.set(
        xlabel=text("Excitation force F_E [N]"),
        ylabel=text("Normal force per joint F_N [N]"),
        xlim=(0, None),
        ylim=(0, None),
    )
    left.legend()
    left.set_title(text("Recommended normal force"))
    for m, mode in enumerate(prediction.modes):
        colour, line, marker = SERIES[m % len(SERIES)]
        right.plot(
            levels[order],
            100 * place.damping[m, order],
            color=colour,
            ls=line,
            marker=marker,
            label=text("mode {mode}", mode=mode + 1),
        )
        if np.isfinite(place.damping_low[m]).all():
            right.fill_between(
                levels[order],
                100 * place.damping_low[m, order],
                100 * place.damping_high[m, order],
                color=colour,
                alpha=0.2,
                lw=0,
            )
        right.axhline(100 * prediction.bare_damping[m], color=colour, ls=":", lw=0.9)
    right.set(xlabel=text("Excitation force F_E [N]"), ylabel=text("Damping ratio [%]"), xlim=(0, None), ylim=(0, None))
    right.set_title(text("Damping at F_N = {force} N (dotted: bare; band: 95 %)", force=f"{place.normal_force:.3g}"))
    right.legend()
    return figure


@styled
def control_gain(study: ControlStudy) -> Figure:
    """Draw the energy after a release under every law, and the steady damping with and without a schedule.

    Parameters
    ----------
    study : ControlStudy
        Ring-downs and steady damping of one location.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> from ema.data import ControlLine, ControlStudy
    >>> line = ControlLine("constant", 500.0, 0.08, 0.3, 0.4, times=[0.0, 0.1], energies=[1.0, 0.3])
    >>> study = ControlStudy(0, 0, 100.0, (line,), [5.0], [0.02], [0.02], verdict="")
    >>> len(control_gain(study).axes)
    2
    """
    figure = new_figure(3.6)
    left, right = figure.subplots(1, 2, width_ratios=(1.4, 1))
    for number, line in enumerate(study.lines):
        colour, style, _ = SERIES[number % len(SERIES)]
        left.semilogy(
            1e3 * line.times,
            np.maximum(line.energies, 1e-12),
            color=colour,
            ls=style,
            label=f"{word(line.law)}, {line.force:.3g} N",
        )
    left.set(
        xlabel=text("Time after the release [ms]"), ylabel=text("Energy over that at the start [-]"), ylim=(1e-5, 1.5)
    )
    left.legend(loc="lower left")
    left.set_title(text("Free vibration"))
    order = np.argsort(study.force_levels)
    for values, label, (colour, style, marker) in (
        (study.constant_damping, text("one for all levels"), SERIES[0]),
        (study.scheduled_damping, text("one for each"), SERIES[1]),
    ):
        right.plot(study.force_levels[order], 100 * values[order], color=colour, ls=style, marker=marker, label=label)
    right.set(
        xlabel=text("Excitation force F_E [N]"),
        ylabel=text("Least damping of the modes [%]"),
        xlim=(0, None),
        ylim=(0, None),
    )
    right.legend()
    right.set_title(text("Steady vibration"))
    return figure
