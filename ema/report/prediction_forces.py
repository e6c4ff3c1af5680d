"""A mode under forces that were predicted, in a report: resonances, responses and the force surface."""

from functools import partial

import numpy as np

from ema import show
from ema.data import ForcedResponse
from ema.messages import text
from ema.report.blocks import Block, Book, Cell, Table, Text
from ema.report.numbers import Value, plain
from ema.report.prediction_source import FromLevels, in_si, points
from ema.report.prediction_tables import RESPONSE_COLUMNS, response_rows
from ema.report.prediction_words import banded, stated


def under_forces(of: FromLevels, book: Book) -> tuple[list[str], list[Block]]:
    """Resonances, responses over the frequency, and the force surface."""
    lines: list[str] = []
    blocks: list[Block] = []
    if of.resonances:
        lines, table = _resonances(of, book)
        blocks.append(table)
    if of.responses:
        blocks.append(
            book.picture(
                partial(show.forced_responses, of.responses),
                text("Response of {mode} to the forces over the frequency, swept up and down.", mode=of.name),
                text(
                    "Response to the forces over the frequency, swept up and down: medians and 95 % bands; dashed "
                    "grey: the highest level fitted."
                ),
            )
        )
        peaks, table = _peaks(of, book)
        lines = lines or peaks
        blocks.append(table)
        blocks += [_response(one, book) for one in of.responses]
    for surface in of.surfaces:
        if min(surface.force.value.shape) < 2 or not np.isfinite(surface.force.value).any():
            blocks.append(Text(text("The force surface has too few amplitudes to be drawn."), missing=True))
            continue
        blocks.append(
            book.picture(
                partial(show.force_surface, surface),
                text("Force that keeps up an amplitude of {mode} at a frequency.", mode=of.name),
                text(
                    "Force surface: the force that keeps up an amplitude at a frequency (left; white lines: response "
                    "curves at constant force) and the half width of its 95 % band (right). Dashed: the highest level "
                    "fitted."
                ),
            )
        )
    return lines, blocks


def _resonances(of: FromLevels, book: Book) -> tuple[list[str], Table]:
    """Amplitude, frequency and damping at phase resonance under each force."""
    lines: list[str] = []
    rows: list[tuple[Cell, ...]] = []
    for one in of.resonances:
        amplitudes, frequencies, damping = (points(each) for each in (one.amplitude, one.frequency, one.damping))
        shares = one.several.tolist()
        for force, several, a, f, z in zip(one.force.tolist(), shares, amplitudes, frequencies, damping, strict=True):
            cells: tuple[Cell, ...] = (
                stated(force),
                *banded(*a),
                of.against(a[1]),
                *banded(*f),
                *banded(*z, 100),
            )
            names = ("force", "amplitude", "a_band", "where", "f", "f_band", "zeta", "zeta_band")
            lines.append(
                text(
                    "Under {force} N: resonance with {amplitude} {unit} ({a_band}; {where}) at {f} Hz ({f_band}), "
                    "damping {zeta} % ({zeta_band}).",
                    **dict(zip(names, cells, strict=True)),
                    unit=of.unit,
                )
            )
            share = Value(100 * several, f"{100 * several:.0f}")
            rows.append((*cells, share, *(plain(x, 6) for x in (force, *a, *f, *z))))
    columns = (
        text("Force [N]"),
        text("Amplitude [{unit}]", unit=of.unit),
        text("95 % band"),
        text("Against the data"),
        "f [Hz]",
        text("95 % band"),
        "ζ [%]",
        text("95 % band"),
        text("Several resonances [%]"),
        *("force_N", *in_si("amplitude"), *in_si("frequency_Hz"), *in_si("damping")),
    )
    caption = text(
        "At phase resonance under each force: amplitude, frequency f and damping ratio ζ, medians with their 95 % "
        "bands. “Open”: a draw ends below that bound. Last: the share of the draws with several resonances at the "
        "force, of which the lowest counts."
    )
    return lines, book.table("resonances", caption, columns, rows, 9)


def _peaks(of: FromLevels, book: Book) -> tuple[list[str], Table]:
    """The largest response to each force, swept up and down."""
    lines: list[str] = []
    rows: list[tuple[Cell, ...]] = []
    for one in of.responses:
        force = stated(float(one.force.max()))
        cells: list[Cell] = [force]
        for sweep in (one.up, one.down):
            known = np.where(np.isfinite(sweep.value), sweep.value, -np.inf)
            top = int(np.argmax(known))
            peak = banded(float(sweep.low[top]), float(sweep.value[top]), float(sweep.high[top]))
            cells += [*peak, plain(float(one.frequencies[top]), 5)]
        rows.append((*cells, Value(100 * one.folded, f"{100 * one.folded:.0f}")))
        lines.append(
            text(
                "Under {force} N, swept up: largest response {amplitude} {unit} ({band}) at {f} Hz.",
                **dict(zip(("force", "amplitude", "band", "f"), cells[:4], strict=True)),
                unit=of.unit,
            )
        )
    columns = (
        text("Force [N]"),
        text("Peak, swept up [{unit}]", unit=of.unit),
        text("95 % band"),
        text("at f [Hz]"),
        text("Peak, swept down [{unit}]", unit=of.unit),
        text("95 % band"),
        text("at f [Hz]"),
        text("Folded [%]"),
    )
    caption = text(
        "Largest median response to each force, with the band at its frequency, which is not that of the resonance. "
        "Last: the share of the draws with several stable responses at a frequency."
    )
    return lines, book.table("peaks", caption, columns, rows)


def _response(one: ForcedResponse, book: Book) -> Table:
    """A response over the frequency, for the file beside the report."""
    force = f"{float(one.force[0]):.4g}"
    rows = [tuple(cell if isinstance(cell, int) else plain(cell, 6) for cell in row) for row in response_rows(one)]
    caption = text("Response to {force} N over the frequency, in SI units.", force=force)
    return book.table(f"response_{force}_N", caption, RESPONSE_COLUMNS, rows, 0)
