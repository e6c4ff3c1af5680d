"""Pictures of FRFs: overview, coherence, indicator functions, measured against synthesised."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from ema.data import FrfSet, ModalModel
from ema.messages import text
from ema.show.selection import check_frfs
from ema.show.style import (
    BLACK,
    BLUE,
    GREY,
    SERIES,
    VERMILION,
    dof_labels,
    empty_note,
    frf_label,
    mark_modes,
    new_figure,
    one_quantity,
    styled,
    thin_labels,
)

_MOST_COLUMNS = 1500
"""Points of a curve that is drawn; every peak is among them."""


def peaks(
    frequencies: Float[np.ndarray, "freq"], values: Float[np.ndarray, "freq curve"], most: int = _MOST_COLUMNS
) -> tuple[Float[np.ndarray, "line"], Float[np.ndarray, "line curve"]]:
    """At most so many lines that keep every peak: the largest value of each group of neighbours."""
    step = -(-len(frequencies) // most)
    starts = np.arange(0, len(frequencies), step)
    return frequencies[starts], np.maximum.reduceat(values, starts, axis=0)


def _positive(values: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Zeros as NaN, which a logarithmic axis leaves out."""
    return np.where(values > 0, values, np.nan)


@styled
def frf_overview(frfs: FrfSet, modes: ModalModel | None = None) -> Figure:
    """Draw the magnitude of all FRFs with their quadratic mean, and the natural frequencies of modes.

    Parameters
    ----------
    frfs : FrfSet
        FRFs.
    modes : ModalModel, optional
        Modes whose natural frequencies are marked.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> from ema.examples import frf_set, modal_model
    >>> len(frf_overview(frf_set(), modal_model()).axes)
    1
    """
    figure = new_figure(3.6)
    axes = figure.subplots()
    if not frfs.values.size:
        empty_note(axes, text("no FRF to draw"))
        return figure
    magnitudes = np.abs(frfs.values).reshape(len(frfs.frequencies), -1)
    lines, highest = peaks(frfs.frequencies, magnitudes)
    count = magnitudes.shape[1]
    faint = max(0.12, min(0.8, 12 / count))
    curves = [np.column_stack([lines, column]) for column in _positive(highest).T]
    axes.add_collection(LineCollection(curves, colors=GREY, linewidths=0.5, alpha=faint, rasterized=True))
    axes.set_yscale("log")
    axes.autoscale()
    mean = np.sqrt(np.mean(magnitudes**2, axis=1))
    axes.semilogy(
        frfs.frequencies, _positive(mean), color=BLUE, lw=1.4, label=text("quadratic mean of {count} FRFs", count=count)
    )
    _frequency_axis(axes, frfs.frequencies)
    axes.set_ylabel(frf_label(frfs.quantity, frfs.unit))
    if modes is not None:
        mark_modes(axes, modes.natural_frequencies)
    axes.legend(loc="lower right")
    return figure


@styled
def coherence(frfs: FrfSet, modes: ModalModel | None = None) -> Figure:
    """Draw the median coherence over all FRFs with the band of the middle 80 %, and every FRF as a row of colours.

    A line at which the coherence is undefined (no signal) is drawn as 0; FRFs without a coherence give a figure that
    says so.

    Parameters
    ----------
    frfs : FrfSet
        FRFs with their coherence.
    modes : ModalModel, optional
        Modes whose natural frequencies are marked.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> len(coherence(frf_set()).axes)  # these have none: a note
    1
    """
    if frfs.coherence is None:
        figure = new_figure(1.5)
        empty_note(figure.subplots(), text("these FRFs came without a coherence"))
        return figure
    values = np.nan_to_num(frfs.coherence).reshape(len(frfs.frequencies), -1)
    many = values.shape[1] > 1
    figure = new_figure(4.6 if many else 2.6)
    panels = figure.subplots(2 if many else 1, 1, squeeze=False, sharex=True)[:, 0]
    axes = panels[0]
    low, middle, high = np.percentile(values, [10, 50, 90], axis=1)
    axes.fill_between(
        frfs.frequencies, low, high, color=BLUE, alpha=0.25, lw=0, label=text("middle 80 %"), rasterized=True
    )
    axes.plot(frfs.frequencies, middle, color=BLUE, lw=1.2, label=text("median"))
    _frequency_axis(axes, frfs.frequencies, label=not many)
    axes.set_ylim(0, 1.02)
    axes.set_ylabel(text("Coherence [-]"))
    if modes is not None:
        mark_modes(axes, modes.natural_frequencies)
    axes.legend(loc="lower right", ncols=3)
    if many:
        _coherence_rows(figure, panels[1], frfs, values)
    return figure


def _coherence_rows(figure: Figure, axes: Axes, frfs: FrfSet, values: Float[np.ndarray, "freq frf"]) -> None:
    """Every FRF as a row; groups of neighbouring lines show their lowest coherence, so that no dip is lost."""
    lines, highest = peaks(frfs.frequencies, -values)
    step = (lines[-1] - lines[0]) / max(len(lines) - 1, 1)
    extent = (float(lines[0] - step / 2), float(lines[-1] + step / 2), values.shape[1] - 0.5, -0.5)
    image = axes.imshow(-highest.T, vmin=0, vmax=1, extent=extent, aspect="auto", interpolation="nearest")
    labels = [frfs.label(o, i) for o in range(len(frfs.outputs)) for i in range(len(frfs.inputs))]
    places, texts = thin_labels(labels, 14)
    axes.set_yticks(places, texts, fontsize=6.5)
    axes.grid(visible=False)
    axes.set_ylabel("FRF")
    _frequency_axis(axes, frfs.frequencies)
    figure.colorbar(image, ax=axes, label=text("Coherence [-]"), pad=0.01)


@styled
def indicator(
    frequencies: Float[np.ndarray, "freq"],
    values: Float[np.ndarray, "freq k"],
    modes: ModalModel | None = None,
    label: str = "CMIF",
) -> Figure:
    """Draw mode indicator functions over frequency.

    Parameters
    ----------
    frequencies : array of shape (freq,)
        Frequency lines [Hz].
    values : array of shape (freq, k)
        One curve per column, such as the singular values of the FRFs, largest first.
    modes : ModalModel, optional
        Modes whose natural frequencies are marked.
    label : str, default "CMIF"
        What the curves are called.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> frfs = frf_set()
    >>> len(indicator(frfs.frequencies, np.linalg.svd(frfs.values, compute_uv=False)).axes)
    1
    """
    figure = new_figure(3.2)
    axes = figure.subplots()
    for place, column in enumerate(values.T):
        colour, style, _ = SERIES[place % len(SERIES)]
        axes.semilogy(frequencies, _positive(column), color=colour, ls=style, lw=1.2, label=f"{label} {place + 1}")
    _frequency_axis(axes, frequencies)
    axes.set_ylabel(label)
    if modes is not None:
        mark_modes(axes, modes.natural_frequencies)
    axes.legend(loc="upper right", ncols=min(4, values.shape[1]))
    return figure


@styled
def reconstruction(
    measured: FrfSet,
    synthesised: FrfSet,
    places: Sequence[tuple[int, int]],
    titles: Sequence[str] = (),
    modes: ModalModel | None = None,
) -> Figure:
    """Draw measured FRFs and those of the modal model in its band: magnitude and phase, two FRFs side by side.

    Parameters
    ----------
    measured : FrfSet
        Measured FRFs.
    synthesised : FrfSet
        FRFs of the modal model, same DOFs and quantity.
    places : sequence of tuple of (int, int)
        (output, input) positions of the FRFs to draw.
    titles : sequence of str, optional
        One text per place, after the name of the FRF.
    modes : ModalModel, optional
        Modes whose natural frequencies are marked.

    Returns
    -------
    Figure
        The figure.

    Raises
    ------
    InputError
        If the two are not of one quantity in one unit, or have no FRF at a position.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> len(reconstruction(frf_set(0.01), frf_set(), [(0, 0)]).axes)
    2
    """
    one_quantity([measured, synthesised])
    for frfs in (measured, synthesised):
        check_frfs([frfs] * len(places), places)
    rows = max(1, -(-len(places) // 2))
    figure = new_figure(3.4 * rows)
    if not places or not len(synthesised.frequencies):
        empty_note(figure.subplots(), text("no FRF to draw"))
        return figure
    panels = figure.subplots(
        2 * rows, min(2, len(places)), squeeze=False, sharex=True, gridspec_kw={"height_ratios": [3, 1.1] * rows}
    )
    for panel, (output, input_) in enumerate(places):
        row, column = 2 * (panel // 2), panel % 2
        title = measured.label(output, input_) + (f"  ({titles[panel]})" if panel < len(titles) else "")
        _one_reconstruction(panels[row, column], panels[row + 1, column], measured, synthesised, output, input_)
        panels[row, column].set_title(title)
        if modes is not None:
            for frequency in modes.natural_frequencies:
                panels[row, column].axvline(frequency, color=GREY, lw=0.5, ls=":", zorder=0.5)
        if panel == 0:
            panels[row, column].legend(loc="best")
    for panel in range(len(places), 2 * rows if len(places) > 1 else 1):
        panels[2 * (panel // 2), panel % 2].set_axis_off()
        panels[2 * (panel // 2) + 1, panel % 2].set_axis_off()
    for column in range(panels.shape[1]):
        panels[-1 if column < len(places) - 2 * (rows - 1) else -3, column].tick_params(labelbottom=True)
        panels[-1 if column < len(places) - 2 * (rows - 1) else -3, column].set_xlabel(text("Frequency [Hz]"))
    return figure


def _one_reconstruction(
    magnitude: Axes, phase: Axes, measured: FrfSet, synthesised: FrfSet, output: int, input_: int
) -> None:
    """Draw one FRF over the band of the synthesised one; a phase that jumps over 360 degrees starts a new line."""
    styles = ((text("measured"), measured, BLACK, "-", 1.1), (text("modal model"), synthesised, VERMILION, "--", 1.3))
    low, high = synthesised.frequencies[0], synthesised.frequencies[-1]
    for label, whole, colour, style, width in styles:
        frfs = whole.lines((whole.frequencies >= low) & (whole.frequencies <= high))
        values = frfs.values[:, output, input_]
        magnitude.semilogy(frfs.frequencies, _positive(np.abs(values)), color=colour, ls=style, lw=width, label=label)
        angles = np.degrees(np.angle(values))
        jumps = np.abs(np.diff(angles, prepend=angles[:1])) > 180
        phase.plot(frfs.frequencies, np.where(jumps, np.nan, angles), color=colour, ls=style, lw=0.9)
    magnitude.set_ylabel(frf_label(measured.quantity, measured.unit))
    phase.set_ylabel(text("Phase [°]"))
    phase.set_yticks([-180, 0, 180])
    phase.set_ylim(-190, 190)
    _frequency_axis(magnitude, synthesised.frequencies, label=False)


def _frequency_axis(axes: Axes, frequencies: Float[np.ndarray, "freq"], label: bool = True) -> None:
    """Frequency across, over all lines."""
    low, high = float(frequencies[0]), float(frequencies[-1])
    axes.set_xlim(low, high if high > low else low + 1)
    if label:
        axes.set_xlabel(text("Frequency [Hz]"))


def drive_points(frfs: FrfSet) -> list[tuple[int, int]]:
    """Positions (output, input) of the FRFs whose response is measured where the force acts, in either sense."""
    outputs, inputs = (dof_labels([dof.positive for dof in dofs]) for dofs in (frfs.outputs, frfs.inputs))
    return [(o, i) for o, output in enumerate(outputs) for i, input_ in enumerate(inputs) if output == input_]
