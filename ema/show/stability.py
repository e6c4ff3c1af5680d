"""The stabilisation diagram."""

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from ema.data import ModalModel, PoleTable
from ema.messages import mark, text
from ema.show.style import BLUE, FAINT, GREEN, GREY, ORANGE, empty_note, mark_modes, new_figure, styled

LETTERS = {
    "o": (mark("new"), FAINT, 10),
    "f": (mark("frequency"), GREY, 14),
    "d": (mark("frequency and damping"), ORANGE, 18),
    "v": (mark("frequency and vector"), GREEN, 18),
    "s": (mark("stable"), BLUE, 20),
}
"""Meaning, colour and size of the letters, least stable first."""


@styled
def stabilisation(
    poles: PoleTable,
    modes: ModalModel | None = None,
    frequencies: Float[np.ndarray, "freq"] | None = None,
    indicator: Float[np.ndarray, "freq k"] | None = None,
    indicator_label: str = "CMIF",
) -> Figure:
    """Draw the poles of all model orders by their letter, frequency across and order up.

    Parameters
    ----------
    poles : PoleTable
        Poles of all model orders.
    modes : ModalModel, optional
        Selected modes, marked by numbered lines.
    frequencies : array of shape (freq,), optional
        Lines of the indicator [Hz].
    indicator : array of shape (freq, k), optional
        Curves behind the poles, such as the CMIF.
    indicator_label : str, default "CMIF"
        What the curves are called.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> from ema.data import PoleTable, poles_from
    >>> from ema.dof import Dof
    >>> poles = poles_from(np.array([40.0, 40.0]), np.array([0.01, 0.01]))
    >>> table = PoleTable([2, 4], poles, ["o", "s"], [[1.0], [1.0]], (Dof(1, "+Z"),), band=(20.0, 60.0))
    >>> stabilisation(table).axes[0].get_ylabel()
    'Model order'
    """
    figure = new_figure(5.2)
    axes = figure.subplots()
    low, high = poles.band
    axes.set_xlim(low, high)
    axes.set_xlabel(text("Frequency [Hz]"))
    axes.set_ylabel(text("Model order"))
    if not len(poles.poles):
        empty_note(axes, text("no pole was found"))
        return figure
    if indicator is not None and frequencies is not None:
        behind = axes.twinx()
        inside = (frequencies >= low) & (frequencies <= high)
        for column in indicator[inside].T:
            behind.semilogy(frequencies[inside], np.where(column > 0, column, np.nan), color=FAINT, lw=0.9)
        behind.set_ylabel(indicator_label, color=GREY)
        behind.tick_params(axis="y", colors=GREY)
        behind.grid(visible=False)
        axes.set_zorder(behind.get_zorder() + 1)
        axes.patch.set_visible(False)
    for letter, (meaning, colour, size) in LETTERS.items():
        chosen = poles.letter == letter
        if np.any(chosen):
            axes.scatter(
                poles.natural_frequencies[chosen],
                poles.order[chosen],
                marker=f"${letter}$",
                s=size,
                color=colour,
                linewidths=0.2,
                label=text(meaning),
                zorder=2.5,
            )
    top = int(poles.order.max())
    axes.set_ylim(int(poles.order.min()) - 0.04 * top - 0.5, 1.03 * top + 0.5)
    if modes is not None:
        mark_modes(axes, modes.natural_frequencies)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=5, markerscale=1.6)
    return figure
