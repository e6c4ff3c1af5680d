"""The impacts of a hammer test."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from ema.data import Hit, HitGallery
from ema.messages import text
from ema.show.style import BLUE, FAINT, GREY, SERIES, VERMILION, empty_note, new_figure, styled

_MOST_REASONS = 5
"""Reasons that have a colour of their own; the rarer ones share one."""


@styled
def hits(gallery: HitGallery, unit: str = "N") -> Figure:
    """Draw all impacts: pulses of the accepted and of the rejected ones, and the peak of each in order of measurement.

    Rejected impacts carry the colour, line and marker of their reason.

    Parameters
    ----------
    gallery : HitGallery
        Impacts of a run.
    unit : str, default "N"
        Unit of the force.

    Returns
    -------
    Figure
        The figure, with a note in it where there is no impact.

    Examples
    --------
    >>> from ema.data import Hit, HitGallery
    >>> hit = Hit("impact", 0, None, 0.25, 100.0, 0.25, 0.004, True, "", pulse=[0.0, 100.0, 0.0], sampling_rate=1024.0)
    >>> len(hits(HitGallery((hit,), [0.0, 100.0], [1.0, 0.5], usable_band=(300.0, 400.0))).axes)
    2
    """
    figure = new_figure(4.6)
    if not gallery.hits:
        empty_note(figure.subplots(), text("no impact in the record"))
        return figure
    accepted = [hit for hit in gallery.hits if hit.accepted]
    rejected = _by_reason(gallery)
    kinds = [kind for kind, some in (("accepted", accepted or not rejected), ("rejected", rejected)) if some]
    rows: list[Any] = [kinds, ["peaks"] * len(kinds)]
    panels = figure.subplot_mosaic(rows, height_ratios=[1.3, 1])
    if "accepted" in panels:
        faint = max(0.15, min(0.9, 15 / len(accepted)))
        pulses = LineCollection([np.column_stack(_pulse(hit)) for hit in accepted], colors=BLUE, lw=0.6, alpha=faint)
        pulses.set_rasterized(True)
        panels["accepted"].add_collection(pulses)
        panels["accepted"].autoscale()
        panels["accepted"].set_title(text("accepted: {number}", number=len(accepted)))
        _limit_time(panels["accepted"], gallery)
    for place, (reason, group) in enumerate(rejected.items()):
        colour, style, _ = SERIES[(place + 1) % len(SERIES)]
        for number, hit in enumerate(group):
            panels["rejected"].plot(*_pulse(hit), color=colour, ls=style, lw=1.0, label=reason if number == 0 else None)
    if "rejected" in panels:
        panels["rejected"].set_title(text("rejected: {number}", number=len(gallery.hits) - len(accepted)))
    for name in kinds:
        panels[name].set_xlabel(text("Time from the peak [ms]"))
        panels[name].set_ylabel(text("Force [{unit}]", unit=unit))
    order = {id(hit): number for number, hit in enumerate(gallery.hits, 1)}
    below = panels["peaks"]
    below.plot(
        [order[id(hit)] for hit in accepted],
        [hit.peak for hit in accepted],
        "o",
        ms=3,
        color=BLUE,
        label=text("accepted"),
    )
    for place, (reason, group) in enumerate(rejected.items()):
        colour, _, marker = SERIES[(place + 1) % len(SERIES)]
        below.plot(
            [order[id(hit)] for hit in group], [hit.peak for hit in group], marker, ms=6, color=colour, label=reason
        )
    below.set_xlabel(text("Impact, in order of measurement"))
    below.set_ylabel(text("Peak [{unit}]", unit=unit))
    below.set_ylim(0, 1.12 * max((hit.peak for hit in gallery.hits), default=0) or 1)
    below.set_xlim(0, len(gallery.hits) + 1)
    figure.legend(*below.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _by_reason(gallery: HitGallery) -> dict[str, list[Hit]]:
    """Rejected impacts by reason, most frequent first; rare reasons beyond the fifth are drawn together."""
    groups: dict[str, list[Hit]] = {}
    for hit in gallery.hits:
        if not hit.accepted:
            groups.setdefault(hit.reason or text("no reason given"), []).append(hit)
    ranked = sorted(groups.items(), key=lambda item: -len(item[1]))
    result = {_short(reason): group for reason, group in ranked[: _MOST_REASONS - 1]}
    rest = [hit for _, group in ranked[_MOST_REASONS - 1 :] for hit in group]
    return result | ({text("other reasons"): rest} if rest else {})


def _short(text: str, most: int = 48) -> str:
    return text if len(text) <= most else text[: most - 1] + "…"


def _pulse(hit: Hit) -> tuple[np.ndarray, np.ndarray]:
    """Time from the peak in ms, and force."""
    peak = int(np.argmax(np.abs(hit.pulse))) if len(hit.pulse) else 0
    return 1e3 * (np.arange(len(hit.pulse)) - peak) / hit.sampling_rate, np.asarray(hit.pulse)


def _limit_time(axes: Axes, gallery: HitGallery) -> None:
    """Show a few contact times around the peak."""
    contact = np.array([hit.contact_time for hit in gallery.hits if np.isfinite(hit.contact_time)])
    if not len(contact) or not contact.max() > 0:
        return
    width = 4e3 * float(np.median(contact))
    low, high = axes.get_xlim()
    axes.set_xlim(max(low, -width), min(high, 1.5 * width))


@styled
def force_spectrum(gallery: HitGallery) -> Figure:
    """Draw the force autospectrum of the accepted impacts in dB, and where it has fallen by 10 and 20 dB.

    Parameters
    ----------
    gallery : HitGallery
        Impacts of a run.

    Returns
    -------
    Figure
        The figure, with a note in it where no impact was accepted.

    Examples
    --------
    >>> from ema.data import HitGallery
    >>> gallery = HitGallery((), frequencies=[0.0, 100.0], force_spectrum=[1.0, 0.5], usable_band=(300.0, 400.0))
    >>> len(force_spectrum(gallery).axes)
    1
    """
    figure = new_figure(2.8)
    axes = figure.subplots()
    spectrum = np.asarray(gallery.force_spectrum)
    if not len(spectrum) or not np.nanmax(spectrum) > 0:
        empty_note(axes, text("no accepted impact, no force spectrum"))
        return figure
    level = 10 * np.log10(np.maximum(spectrum / np.nanmax(spectrum), 1e-12))
    ten, twenty = gallery.usable_band
    axes.axvspan(0, ten, color=BLUE, alpha=0.14, lw=0, label=text("-10 dB to {ten} Hz", ten=f"{ten:.4g}"))
    axes.axvspan(ten, twenty, color=FAINT, alpha=0.4, lw=0, label=text("-20 dB to {twenty} Hz", twenty=f"{twenty:.4g}"))
    axes.axhline(-10, color=GREY, lw=0.7, ls="--")
    axes.axhline(-20, color=GREY, lw=0.7, ls=":")
    axes.plot(gallery.frequencies, level, color=VERMILION, lw=1.3)
    axes.set_xlim(float(gallery.frequencies[0]), float(gallery.frequencies[-1]))
    axes.set_ylim(max(-70.0, float(np.nanmin(level)) - 3), 3)
    axes.set_xlabel(text("Frequency [Hz]"))
    axes.set_ylabel(text("Force autospectrum [dB re max]"))
    axes.legend(loc="lower left")
    return figure
