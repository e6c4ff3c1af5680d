"""One look for all figures, without touching the settings of the caller."""

from collections.abc import Callable, Sequence
from functools import wraps
from inspect import Signature, signature
from types import UnionType
from typing import Any, ParamSpec, TypeVar, get_args

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FuncFormatter

from ema.dof import Dof
from ema.errors import InputError
from ema.messages import mark, text, word
from ema.units import FRF_UNIT, SI_UNIT, UNSTATED

P = ParamSpec("P")
R = TypeVar("R")

BLACK, GREY, FAINT = "#1a1a1a", "#7a7a7a", "#c4c4c4"
BLUE, VERMILION, GREEN, ORANGE, PURPLE = "#0072b2", "#d55e00", "#009e73", "#e69f00", "#cc79a7"
SERIES = (
    (BLUE, "-", "o"),
    (VERMILION, "--", "s"),
    (GREEN, "-.", "^"),
    (PURPLE, ":", "D"),
    (ORANGE, "-", "v"),
    (BLACK, "--", "x"),
)
"""Colour, line style and marker of successive series: told apart without colour too."""
COLOUR_MAP = "cividis"

_STYLE: Any = {
    "font.family": ["DejaVu Sans"],
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": GREY,
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "grid.color": "#e3e3e3",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "lines.linewidth": 1.3,
    "figure.facecolor": "white",
    "axes.facecolor": "white",
    "axes.formatter.useoffset": False,
    "image.cmap": COLOUR_MAP,
    "savefig.facecolor": "white",
    "text.usetex": False,
}
_UNIT_TEXT = {"m/N": "m/N", "(m/s)/N": "(m/s)/N", "(m/s^2)/N": "(m/s²)/N", UNSTATED: mark("unit unstated")}
_NONE = type(None)
WIDTH = 9.0
"""Width of a figure in inches: the text width of a report."""


def styled(draw: Callable[P, R]) -> Callable[P, R]:
    """Run ``draw`` under the style of the project; settings outside are untouched.

    An argument that is none of the data types which the signature names is refused in one sentence.
    """
    form = signature(draw)

    @wraps(draw)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> R:
        """``draw`` with checked arguments, in the style, and with names of channels and runs as they are written."""
        check_arguments(draw.__name__, form, args, kwargs)
        with matplotlib.rc_context(_STYLE):
            drawn = draw(*args, **kwargs)
        if isinstance(drawn, Figure):
            _take_literally(drawn)
        return drawn

    return wrapper


def check_arguments(name: str, form: Signature, args: Sequence[Any], kwargs: dict[str, Any]) -> None:
    """Refuse an argument that is none of the classes which its annotation consists of.

    Raises
    ------
    InputError : an argument is of another type.
    """
    try:
        given = form.bind(*args, **kwargs).arguments
    except TypeError:  # Python names missing and unknown arguments itself
        return
    for parameter, value in given.items():
        annotation = form.parameters[parameter].annotation
        kinds = get_args(annotation) if isinstance(annotation, UnionType) else (annotation,)
        ours = all(isinstance(kind, type) and (kind.__module__.startswith("ema.") or kind is _NONE) for kind in kinds)
        if ours and not isinstance(value, kinds):
            raise InputError(
                f"the argument {parameter!r} is of a type that this picture does not show",
                where=f"ema.show.{name}",
                got=type(value).__name__,
                expected=" or ".join("None" if kind is _NONE else kind.__name__ for kind in kinds),
                advice="ema.show.plot draws every data type",
            )


def one_quantity(things: Sequence[Any]) -> str:
    """What all of them measure; empty for none.

    Raises
    ------
    InputError : two of them measure different quantities, which share no axis, or have different units.
    """
    kinds = list(dict.fromkeys((str(thing.quantity), str(getattr(thing, "unit", ""))) for thing in things))
    if len(kinds) > 1:
        raise InputError(
            "different quantities share no axis",
            got=" and ".join(f"{quantity} [{unit}]" if unit else quantity for quantity, unit in kinds),
            expected="one quantity in one unit",
            advice="draw them in figures of their own, or convert them first",
        )
    return kinds[0][0] if kinds else ""


def _take_literally(figure: Figure) -> None:
    """Titles, labels and legends mean what they say: a name with ``$`` is no formula.

    Numbers at the ticks stay formulas, since powers of ten on logarithmic axes are written so.
    """
    texts = [*figure.texts]
    for axes in figure.axes:
        legend = axes.get_legend()
        texts += [axes.title, axes._left_title, axes._right_title, axes.xaxis.label, axes.yaxis.label, *axes.texts]  # type: ignore[attr-defined]
        texts += [] if legend is None else [legend.get_title(), *legend.get_texts()]
        for axis in (axes.xaxis, axes.yaxis):
            if isinstance(axis.get_major_formatter(), (FixedFormatter, FuncFormatter)):  # names given one by one
                texts += axis.get_majorticklabels()
    for one in texts:
        if "$" in one.get_text() and "mathdefault" not in one.get_text():
            one.set_parse_math(False)


def new_figure(height: float, width: float = WIDTH) -> Figure:
    """An empty figure of that size in inches."""
    return Figure(figsize=(width, height), layout="constrained")


def frf_label(quantity: str, unit: str) -> str:
    """Axis label of an FRF magnitude, e.g. ``Accelerance [(m/s²)/N]``."""
    name = "FRF" if quantity == UNSTATED else word(quantity).capitalize()
    known = FRF_UNIT.get(quantity, unit) if unit != UNSTATED else UNSTATED
    return f"{name} [{unit_text(known)}]"


def amplitude_label(quantity: str) -> str:
    """Axis label of an amplitude: "Amplitude of the displacement [m]"."""
    unit = SI_UNIT[quantity].replace("^2", "²")
    return text("Amplitude of the {quantity} [{unit}]", quantity=word(quantity), unit=unit)


def logarithmic(amplitudes: np.ndarray) -> bool:
    """Whether amplitudes are drawn on a logarithmic axis: they span more than a decade."""
    return bool(amplitudes.max() > 10.0 * amplitudes.min() > 0)


def unit_text(unit: str) -> str:
    """The unit of an FRF as people write it."""
    return word(_UNIT_TEXT.get(unit, unit))


def thin_labels(labels: Sequence[str], most: int) -> tuple[list[int], list[str]]:
    """Positions and texts of at most ``most`` evenly spaced labels."""
    step = max(1, -(-len(labels) // most))
    places = list(range(0, len(labels), step))
    return places, [labels[place] for place in places]


def dof_labels(dofs: Sequence[Dof]) -> list[str]:
    """The DOFs as text."""
    return [str(dof) for dof in dofs]


def mark_modes(axes: Axes, frequencies: np.ndarray, rows: int = 3) -> None:
    """Lines at the natural frequencies (Hz) inside the view, numbered from 1 above the axes where the numbers fit."""
    low, high = axes.get_xlim()
    # room for one number, as a fraction of the width: seven points a digit on a figure of the report's width
    room = 0.011 * (1 + len(str(len(frequencies))))
    ends = [-1.0] * rows
    for number, frequency in enumerate(frequencies, 1):
        if not low <= frequency <= high:
            continue
        axes.axvline(frequency, color=VERMILION, lw=0.7, ls=(0, (4, 2)), zorder=1.5, alpha=0.8)
        position = (frequency - low) / (high - low)
        row = next((row for row in range(rows) if position - ends[row] >= room), None)
        if row is not None:
            ends[row] = position
            axes.annotate(
                str(number),
                (frequency, 1),
                xycoords=("data", "axes fraction"),
                xytext=(0, 2 + 8 * row),
                textcoords="offset points",
                ha="center",
                va="bottom",
                fontsize=7,
                color=VERMILION,
            )


def empty_note(axes: Axes, note: str) -> None:
    """Say in the middle of empty axes why they are empty."""
    axes.set_axis_off()
    axes.text(0.5, 0.5, note, ha="center", va="center", color=GREY, transform=axes.transAxes)


def label_last_rows(panels: np.ndarray, count: int) -> None:
    """Tick labels under the last used panel of each column, where panels share their axis across."""
    rows, columns = panels.shape
    for column in range(columns):
        used = [row for row in range(rows) if row * columns + column < count]
        if used:
            panels[used[-1], column].tick_params(labelbottom=True)
