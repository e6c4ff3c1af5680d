"""A forecast of a placed beam in a report, with what was measured afterwards."""

from functools import partial

import numpy as np
from scipy.stats import binom

from ema import show
from ema.data.forecast import Forecast, ForecastCheck
from ema.messages import mark, text, word
from ema.report.blocks import Block, Book, Cell, Text
from ema.report.numbers import plain

_SOURCES = (
    mark("friction coefficient"),
    mark("tangential contact stiffness"),
    mark("exponent of the contact stiffness"),
    mark("form of the friction law"),
    mark("normal contact stiffness"),
    mark("contact length"),
    mark("pressure over the contact"),
    mark("normal force"),
    mark("height of the interface"),
    mark("scatter from joint to joint"),
    mark("loss factor of the beam"),
    mark("modes above those known"),
    mark("frequency and damping without the beam"),
    mark("mode shape at joints and exciter"),
    mark("upper harmonics of the friction"),
    mark("all else, and what acts together"),
)
"""What bands come from, as data say it."""
_LEVEL = 0.95
"""Level of the bands."""
_RARE = 0.01
"""Probability with which fewer values than the stated number lie inside their bands by chance."""


def verdict(check: ForecastCheck) -> str:
    """One sentence: how many measured values fell inside their bands, and how many bands of 95 % hold by chance."""
    least = int(binom.ppf(_RARE, check.values, _LEVEL))
    counts = {"inside": check.inside, "values": check.values, "least": least}
    if check.inside >= least:
        return text(
            "{inside} of {values} measured values lie inside the 95 % bands predicted before the measurement, as "
            "many as such bands hold ({least} or more in 99 of 100 cases, if the values err independently).",
            **counts,
        )
    return text(
        "{inside} of {values} measured values lie inside the 95 % bands predicted before the measurement, fewer than "
        "such bands hold ({least} or more in 99 of 100 cases, if the values err independently).",
        **counts,
    )


def forecast_blocks(prediction: Forecast | ForecastCheck, book: Book) -> list[Block]:
    """Bands as a picture and as a table; measured values beside them where there are some."""
    check = prediction if isinstance(prediction, ForecastCheck) else None
    forecast = prediction.forecast if isinstance(prediction, ForecastCheck) else prediction
    x, y = forecast.centre
    where = text("{beam} at ({x}, {y}) m", beam=forecast.beam or text("beam"), x=f"{x:.3f}", y=f"{y:.3f}")
    lead = [] if check is None else [Text(verdict(check))]
    note = "" if check is None else " " + text("Points: measured; a cross lies outside its band.")
    return [
        *lead,
        book.picture(
            partial(show.forecast_bands, prediction),
            text("Predicted frequency and damping with {where}, with 95 % bands.", where=where) + note,
            text(
                "Frequency and damping with {where}: prediction (dash) and 95 % band from {draws} draws of shapes, "
                "friction and contact stiffness.",
                where=where,
                draws=forecast.draws,
            )
            + note,
        ),
        book.table(
            "forecast",
            text("Predicted values with their 95 % bands.")
            if check is None
            else text("Predicted values with their 95 % bands, and measured ones."),
            _columns(check),
            _rows(forecast, check),
        ),
        *budget_blocks(forecast, book),
    ]


def budget_blocks(forecast: Forecast, book: Book) -> list[Block]:
    """What the bands come from, what widens those of the damping most first."""
    table = forecast.budget()
    if table.empty:
        return []
    most = []
    for name in table.columns[2::2]:
        first = table.loc[table[name].idxmax()]
        most.append(
            text(
                "{source} ({mode}, {share} % of their variance)",
                source=word(first["source"]),
                mode=_of_mode(name.split(":")[0]),
                share=f"{first[name]:.0f}",
            )
        )
    rows: list[list[Cell]] = [
        [word(row[0]), *(f"{value:.0f}" for value in row[1:])] for row in table.itertuples(index=False)
    ]
    return [
        Text(text("What widens the bands of the damping ratio most: {sources}.", sources="; ".join(most))),
        book.table(
            "budget",
            text(
                "What the bands come from: shares of the variance of the logarithm, mean over the "
                "conditions. Were a source of the share s known, a band would keep √(1 − s) of its "
                "width."
            ),
            [text("Source"), *(_of_mode(name.replace("zeta", "ζ")) for name in table.columns[1:])],
            rows,
        ),
    ]


def _of_mode(name: str) -> str:
    """``mode 1: f [%]`` in the reader's language."""
    return text("mode {mode}", mode=name.removeprefix("mode "))


def _columns(check: ForecastCheck | None) -> list[str]:
    names = [text("Mode"), "F_N [N]", "F_E [N]"]
    for quantity in ("f [Hz]", "ζ [%]"):
        names += [quantity, text("low"), text("high"), *([] if check is None else [text("measured"), text("inside")])]
    return names


def _rows(forecast: Forecast, check: ForecastCheck | None) -> list[list[Cell]]:
    rows: list[list[Cell]] = []
    for m, mode in enumerate(forecast.modes):
        for force, normal in enumerate(forecast.normal_forces):
            for level, drive in enumerate(forecast.force_levels):
                at = (m, level, force)
                row: list[Cell] = [str(mode), plain(float(normal), 4), plain(float(drive), 3)]
                for what, scale, digits in (("frequency", 1.0, 6), ("damping", 100.0, 3)):
                    values = [getattr(forecast, what + end)[at] for end in ("", "_low", "_high")]
                    row += [plain(scale * float(value), digits) for value in values]
                    if check is not None:
                        row += _measured(check, what, at, scale, digits)
                rows.append(row)
    return rows


def _measured(check: ForecastCheck, what: str, at: tuple[int, int, int], scale: float, digits: int) -> list[Cell]:
    value = float(getattr(check, f"measured_{what}")[at])
    if not np.isfinite(value):
        return [text("not measured"), ""]
    return [plain(scale * value, digits), text("yes") if getattr(check, f"{what}_inside")[at] else text("no")]
