"""The modal side of a run: stabilisation, synthesised FRFs, AutoMAC, shapes, complexity."""

from collections.abc import Callable
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from ema import show
from ema.data import FrfSet, Geometry, ModalModel, PoleTable, RunResult
from ema.fit import cmif
from ema.messages import text
from ema.report.blocks import Block, Book, Text
from ema.report.motion import animation
from ema.report.numbers import plain, short
from ema.shapes import auto_mac as auto_mac_of
from ema.shapes import expand
from ema.show.frf import drive_points
from ema.show.polar import PER_FIGURE as _COMPLEXITY_PANELS
from ema.show.shapes import PER_FIGURE as _SHAPE_PANELS

_MOST_DRIVE_POINTS = 3
"""Drive points whose FRFs are drawn."""
_MOST_NAMED = 12
"""Natural frequencies that the words beside a picture name; of the others they say how many there are."""


def _missing(sentence: str) -> list[Block]:
    return [Text(sentence, missing=True)]


def stabilisation(run: RunResult, book: Book) -> list[Block]:
    """Report the stabilisation diagram over the complex mode indicator functions.

    Parameters
    ----------
    run : RunResult
        Run with its modes, poles and FRFs.
    book : Book
        Numbers the pictures and tables.

    Returns
    -------
    list of Block
        The picture; a sentence where the modes were not found through model orders.
    """
    poles, name = run.poles, run.run.id
    if poles is None:
        return _missing(text("There is no stabilisation diagram: the modes were not found through model orders."))
    named = [short(frequency) for frequency in run.modes.natural_frequencies[:_MOST_NAMED]]
    more = len(run.modes.poles) - len(named)
    marked = text("no mode was selected")
    frequencies = ", ".join(named)
    if more:
        marked = text("selected modes at {frequencies} and {more} more Hz", frequencies=frequencies, more=more)
    elif named:
        marked = text("selected modes at {frequencies} Hz", frequencies=frequencies)
    f, d, v = (short(100 * tolerance) for tolerance in poles.tolerances)
    caption = text(
        "Stabilisation diagram over the CMIF (tolerances {f} % in frequency, {d} % in "
        "damping, {v} % in vector); numbered lines are the selected modes.",
        f=f,
        d=d,
        v=v,
    )
    alt = text(
        "Stabilisation diagram of run {run}: {number} poles; {marked}.",
        run=name,
        number=len(poles.poles),
        marked=marked,
    )
    return [book.picture(partial(_over_cmif, poles, run.modes, run.frfs), alt, caption)]


def _over_cmif(poles: PoleTable, modes: ModalModel, frfs: FrfSet) -> Figure:
    return show.stabilisation(poles, modes, frfs.frequencies, cmif(frfs))


def reconstruction(run: RunResult, book: Book) -> list[Block]:
    """Compare measured FRFs with those of the modal model, and report the error of each.

    Parameters
    ----------
    run : RunResult
        Run with its modes, measured and synthesised FRFs.
    book : Book
        Numbers the pictures and tables.

    Returns
    -------
    list of Block
        Two pictures and the table of errors; a sentence where nothing was synthesised.
    """
    error = None if run.reconstruction_error is None else np.asarray(run.reconstruction_error)
    if run.reconstruction is None or error is None or not np.isfinite(error).any():
        return _missing(text("No FRFs of the modal model were computed that could be compared with the measured ones."))
    name, frfs = run.run.id, run.frfs
    places, titles = _chosen_frfs(run, error)
    errors = text(
        "median {median} %, largest {largest} %",
        median=short(_percent(np.nanmedian(error))),
        largest=short(_percent(np.nanmax(error))),
    )
    drawn = ", ".join(f"{frfs.label(*place)} ({title})" for place, title in zip(places, titles))
    columns = (text("Response"), text("Force"), text("Error [%]"))
    rows = [
        (str(output), str(input_), plain(100 * float(error[o, i]), 3))
        for o, output in enumerate(frfs.outputs)
        for i, input_ in enumerate(frfs.inputs)
    ]
    return [
        book.picture(
            partial(show.reconstruction, frfs, run.reconstruction, places, titles, run.modes),
            text("Measured and synthesised FRFs of run {run}: {drawn}.", run=name, drawn=drawn),
            text(
                "Measured and synthesised: best, median and worst by error, and drive points; dotted "
                "lines mark the modes."
            ),
        ),
        book.picture(
            partial(show.error_map, error, frfs.outputs, frfs.inputs),
            text("Error of each synthesised FRF of run {run}: {errors}.", run=name, errors=errors),
            text(
                "Error of each synthesised FRF, norm of the difference over norm of the measured FRF ({errors}).",
                errors=errors,
            ),
        ),
        book.table(
            f"frf_errors_{name}", text("Error of each synthesised FRF of run {run}.", run=name), columns, rows, shown=0
        ),
    ]


def _percent(fraction: float) -> float:
    """In percent, to three significant digits."""
    return float(f"{100 * fraction:.3g}")


def _chosen_frfs(run: RunResult, error: np.ndarray) -> tuple[list[tuple[int, int]], list[str]]:
    """Best, median and worst FRF by error, and drive points; each once."""
    ranked = [int(place) for place in np.argsort(error, axis=None, kind="stable") if np.isfinite(error.flat[place])]
    chosen: dict[tuple[int, int], str] = {}
    for place, title in (
        (ranked[0], text("best")),
        (ranked[-1], text("worst")),
        (ranked[len(ranked) // 2], text("median")),
    ):
        output, input_ = np.unravel_index(place, error.shape)
        chosen.setdefault((int(output), int(input_)), title)
    for point in drive_points(run.frfs)[:_MOST_DRIVE_POINTS]:
        chosen[point] = text("{title}, drive point", title=chosen[point]) if point in chosen else text("drive point")
    return list(chosen), [
        text("{title}, error {error} %", title=title, error=plain(100 * float(error[place]), 2))
        for place, title in chosen.items()
    ]


def auto_mac(run: RunResult, book: Book) -> list[Block]:
    """Report the MAC of the modes among themselves.

    Parameters
    ----------
    run : RunResult
        Run with its modes.
    book : Book
        Numbers the pictures and tables.

    Returns
    -------
    list of Block
        The picture; none with fewer than two modes.
    """
    modes, name = run.modes, run.run.id
    if len(modes.poles) < 2:
        return []
    table = auto_mac_of(modes.shapes) if run.auto_mac is None else np.asarray(run.auto_mac)
    off = np.where(np.tri(len(table), dtype=bool), -1.0, np.nan_to_num(table))
    row, column = np.unravel_index(np.argmax(off), off.shape)
    largest = text(
        "largest off the diagonal {mac}, modes {first} and {second}",
        mac=plain(float(off[row, column]), 2),
        first=row + 1,
        second=column + 1,
    )
    labels = [f"{mode}: {short(float(f'{f:.4g}'))} Hz" for mode, f in enumerate(modes.natural_frequencies, 1)]
    make = partial(show.mac_matrix, table, labels, [str(mode) for mode in range(1, len(table) + 1)])
    caption = text("AutoMAC over {number} DOFs ({largest}).", number=len(modes.dofs), largest=largest)
    return [book.picture(make, text("AutoMAC of run {run}: {largest}.", run=name, largest=largest), caption)]


def _pages(number: int, size: int) -> list[range]:
    """Positions in pages of at most ``size``."""
    return [range(start, min(start + size, number)) for start in range(0, number, size)]


def _named(page: range) -> str:
    return (
        text("mode {first}", first=page.start + 1)
        if len(page) == 1
        else text("modes {first} to {last}", first=page.start + 1, last=page.stop)
    )


def shapes(run: RunResult, geometry: Geometry | None, book: Book) -> list[Block]:
    """Draw the mode shapes in space, or over the DOFs where there is no geometry.

    Parameters
    ----------
    run : RunResult
        Run with its modes.
    geometry : Geometry or None
        Points of the structure.
    book : Book
        Numbers the pictures and tables.

    Returns
    -------
    list of Block
        Animation and pictures; sentences that say what could not be drawn.
    """
    modes, name = run.modes, run.run.id
    if not len(modes.poles):
        return _missing(text("No mode was found, so there is no shape to draw."))
    blocks: list[Block] = []
    if geometry is not None and not any(dof.node in geometry and dof.axis in ("X", "Y", "Z") for dof in modes.dofs):
        blocks += _missing(
            text("No measured DOF is a direction at a point of the geometry; shapes are shown over the DOFs.")
        )
        geometry = None
    elif geometry is None:
        blocks += _missing(
            text("The campaign has no geometry, so shapes cannot be drawn in space; they stand over the DOFs.")
        )
    if geometry is not None and (moving := animation(modes, geometry, name)):
        blocks.append(moving)
    unmeasured = ""
    if geometry is not None and not expand(modes, geometry).measured.all():
        unmeasured = " " + text("Points that were not measured follow their neighbours.")
    make: Callable[[], Figure]
    for page in _pages(len(modes.poles), _SHAPE_PANELS):
        listed = ", ".join(
            text("{mode} at {frequency} Hz", mode=mode + 1, frequency=short(modes.natural_frequencies[mode]))
            for mode in page
        )
        if geometry is None:
            make = partial(show.shapes_over_dofs, modes, page)
            caption = text("Shapes of {modes} over the DOFs.", modes=_named(page))
        else:
            make = partial(show.mode_shapes, modes, geometry, page)
            caption = text("Shapes of {modes} with natural frequency and damping; at rest in grey.", modes=_named(page))
            caption += unmeasured
        blocks.append(book.picture(make, text("Mode shapes of run {run}: {listed}.", run=name, listed=listed), caption))
    return blocks


def complexity(run: RunResult, book: Book) -> list[Block]:
    """Draw how far the shapes are from moving in phase.

    Parameters
    ----------
    run : RunResult
        Run with its modes.
    book : Book
        Numbers the pictures and tables.

    Returns
    -------
    list of Block
        Pictures with some modes each; none without modes.
    """
    return [
        book.picture(
            partial(show.complexity, run.modes, page),
            text("Complexity plots of run {run}, {modes}.", run=run.run.id, modes=_named(page)),
            text(
                "Complexity of {modes}: every DOF is a line from the origin; a real mode lies on one "
                "line, whose direction the dots mark.",
                modes=_named(page),
            ),
        )
        for page in _pages(len(run.modes.poles), _COMPLEXITY_PANELS)
    ]
