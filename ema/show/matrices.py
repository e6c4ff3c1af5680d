"""Pictures of matrices: MAC, and the error of each FRF."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from ema.dof import Dof
from ema.messages import text, word
from ema.show.style import COLOUR_MAP, WIDTH, dof_labels, empty_note, new_figure, styled, thin_labels

_MOST_NUMBERED = 24
"""Modes up to which a matrix shows its numbers: beyond, they do not fit the cells."""


@styled
def mac_matrix(
    values: Float[np.ndarray, "row column"],
    rows: Sequence[str] = (),
    columns: Sequence[str] = (),
    title: str = "",
    row_label: str = "Mode",
    column_label: str = "Mode",
) -> Figure:
    """Draw a MAC matrix in colours, with its numbers for up to 24 modes (values below 0.05 are left to the colour).

    Parameters
    ----------
    values : array of shape (row, column)
        MAC, 0 ... 1.
    rows, columns : sequence of str, optional
        Labels; numbers from 1 where not given.
    title : str, optional
        Title of the figure.
    row_label, column_label : str, default "Mode"
        Titles of the axes.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> len(mac_matrix(np.eye(3)).axes)
    2
    """
    count = max(values.shape, default=0)
    size = float(np.clip(1.8 + 0.22 * count, 2.6, 6.0))
    longest = max((len(label) for label in rows), default=1)
    figure = new_figure(size, min(WIDTH, size + 1.3 + 0.075 * longest))
    axes = figure.subplots()
    if not values.size:
        empty_note(axes, text("no mode, no MAC"))
        return figure
    image = axes.imshow(values, vmin=0, vmax=1, cmap=COLOUR_MAP, aspect="equal", interpolation="nearest")
    axes.grid(visible=False)
    names = [
        list(labels) or [str(n + 1) for n in range(length)] for labels, length in zip((rows, columns), values.shape)
    ]
    places, texts = thin_labels(names[0], 30)
    axes.set_yticks(places, texts)
    places, texts = thin_labels(names[1], 30)
    axes.set_xticks(places, texts, rotation=90 if max(map(len, texts)) > 2 else 0)
    axes.set_ylabel(word(row_label))
    axes.set_xlabel(word(column_label))
    axes.set_title(title)
    if count <= _MOST_NUMBERED:
        font = 8 if count <= 10 else 6.5 if count <= 16 else 5
        for (row, column), value in np.ndenumerate(values):
            if value >= 0.05:
                axes.text(
                    column,
                    row,
                    f"{value:.2f}",
                    ha="center",
                    va="center",
                    fontsize=font,
                    color="black" if value > 0.5 else "white",
                )
    bar = figure.colorbar(image, ax=axes, shrink=0.8, label="MAC [-]")
    bar.outline.set_visible(False)
    return figure


@styled
def error_map(error: Float[np.ndarray, "out in"], outputs: Sequence[Dof], inputs: Sequence[Dof]) -> Figure:
    """Draw the error of each synthesised FRF in percent, the longer list of DOFs across.

    Parameters
    ----------
    error : array of shape (out, in)
        Relative error of every FRF.
    outputs, inputs : sequence of Dof
        DOFs of its rows and columns.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> from ema.dof import Dof
    >>> figure = error_map(np.array([[0.01], [0.02]]), [Dof(1, "+Z"), Dof(2, "+Z")], [Dof(1, "+Z")])
    >>> len(figure.axes)
    2
    """
    turned = len(outputs) > len(inputs)
    values = 100 * (error.T if turned else error)
    across, up = (outputs, inputs) if turned else (inputs, outputs)
    height = float(np.clip(1.5 + 0.16 * len(up), 1.9, 8.0))
    figure = new_figure(height)
    axes = figure.subplots()
    if not values.size:
        empty_note(axes, text("no FRF was synthesised"))
        return figure
    top = float(np.nanpercentile(values, 98)) if np.isfinite(values).any() else 1.0
    image = axes.imshow(values, vmin=0, vmax=top or 1.0, cmap=COLOUR_MAP, aspect="auto", interpolation="nearest")
    axes.grid(visible=False)
    places, texts = thin_labels(dof_labels(across), 54)
    axes.set_xticks(places, texts, rotation=90, fontsize=7)
    places, texts = thin_labels(dof_labels(up), max(2, int(height * 6)))
    axes.set_yticks(places, texts, fontsize=7)
    axes.set_xlabel(text("Response DOF") if turned else text("Force DOF"))
    axes.set_ylabel(text("Force DOF") if turned else text("Response DOF"))
    figure.colorbar(image, ax=axes, label=text("Error [%]"), extend="max", pad=0.01)
    return figure
