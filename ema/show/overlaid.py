"""One FRF in several states on top of each other: before and after."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float
from matplotlib.figure import Figure

from ema.data import FrfSet
from ema.errors import InputError
from ema.messages import text
from ema.show.selection import check_frfs
from ema.show.style import SERIES, empty_note, frf_label, new_figure, one_quantity, styled

_BARE = "#1a1a1a"


@styled
def frf_overlay(
    sets: Sequence[FrfSet],
    places: Sequence[tuple[int, int]],
    labels: Sequence[str],
    band: tuple[float, float] | None = None,
) -> Figure:
    """Draw magnitude and phase of one FRF in several states, the first of them in black.

    Parameters
    ----------
    sets : sequence of FrfSet
        FRFs of the same quantity.
    places : sequence of tuple of (int, int)
        (output, input) position of the FRF in each set; opposite senses are turned.
    labels : sequence of str
        What each state is called.
    band : tuple of (float, float), optional
        Ends of the band [Hz]; by default where all sets have lines.

    Returns
    -------
    Figure
        The figure.

    Raises
    ------
    InputError
        If the FRFs are not of one quantity in one unit, a set has no FRF at its position, or sets, positions and
        labels differ in number.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> len(frf_overlay([frf_set(), frf_set(0.01)], [(0, 0), (0, 0)], ["exact", "with noise"]).axes)
    2
    """
    one_quantity(sets)
    if not len(sets) == len(places) == len(labels):
        raise InputError(
            "states, FRFs and labels differ in number",
            got=f"{len(sets)} sets, {len(places)} positions, {len(labels)} labels",
            expected="one position and one label for each set",
        )
    check_frfs(sets, places)
    figure = new_figure(4.4)
    if not sets or not all(len(one.frequencies) for one in sets):
        empty_note(figure.subplots(), text("no FRF to draw"))
        return figure
    low, high = band or (max(one.frequencies[0] for one in sets), min(one.frequencies[-1] for one in sets))
    magnitude, phase = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1.2])
    styles = [(_BARE, "-"), *((colour, style) for colour, style, _ in (SERIES[1], SERIES[0], *SERIES[2:]))]
    for number, (one, place, label) in enumerate(zip(sets, places, labels, strict=True)):
        colour, style = styles[number % len(styles)]
        inside = (one.frequencies >= low) & (one.frequencies <= high)
        values = _turned(one, place)[inside]
        size = np.abs(values)
        magnitude.semilogy(
            one.frequencies[inside], np.where(size > 0, size, np.nan), color=colour, ls=style, lw=1.2, label=label
        )
        phase.plot(one.frequencies[inside], _broken(np.degrees(np.angle(values))), color=colour, ls=style, lw=0.9)
    magnitude.set_ylabel(frf_label(sets[0].quantity, sets[0].unit))
    magnitude.set_xlim(low, high if high > low else low + 1)
    magnitude.legend(loc="best")
    phase.set_ylabel(text("Phase [°]"))
    phase.set_yticks([-180, 0, 180])
    phase.set_ylim(-190, 190)
    phase.set_xlabel(text("Frequency [Hz]"))
    return figure


def _turned(one: FrfSet, place: tuple[int, int]) -> Complex[np.ndarray, "freq"]:
    """The FRF between positive senses."""
    output, input_ = place
    return np.asarray(one.values[:, output, input_] * (one.outputs[output].sign * one.inputs[input_].sign))


def _broken(angles: Float[np.ndarray, "freq"]) -> Float[np.ndarray, "freq"]:
    """Angles in degrees without the strokes of jumps over 360."""
    return np.where(np.abs(np.diff(angles, prepend=angles[:1])) > 180, np.nan, angles)
