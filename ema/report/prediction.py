"""What `ema predict` stored, as parts of a report: predicted values, from what, with which bands, how far outside."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from ema.data import (
    AmplitudeDependentMode,
    AmplitudeDraws,
    AmplitudePrediction,
    Finding,
    ForcedResonances,
    ForcedResponse,
    ForceSurface,
    Forecast,
    MapPrediction,
    ModalMap,
    ModalModel,
    ModelUpdate,
    Provenance,
)
from ema.messages import text
from ema.report.blocks import Book, Section
from ema.report.prediction_conditions import FromMap, location_parts, map_parts
from ema.report.prediction_levels import level_parts
from ema.report.prediction_source import FromLevels
from ema.report.records import provenance_blocks

_OF_LEVELS = (
    AmplitudePrediction,
    AmplitudeDraws,
    ForcedResonances,
    ForcedResponse,
    ForceSurface,
    AmplitudeDependentMode,
)
"""What a prediction from stepped levels stores."""


@dataclass(frozen=True)
class Parts:
    """What a report says of predictions, and the results that are none."""

    title: str = ""
    summary: list[str] = field(default_factory=list)
    sections: list[Section] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    provenance: list[tuple[str, Provenance]] = field(default_factory=list)
    others: Mapping[str, Any] = field(default_factory=dict)

    def origin(self, book: Book) -> list[Section]:
        """Where the predictions came from, a section for each source."""
        return [
            Section(name, f"provenance-{number}", provenance_blocks(one, book, name))
            for number, (name, one) in enumerate(self.provenance, 1)
        ]


def predictions(results: Mapping[str, Any], book: Book) -> Parts:
    """Report the predictions among stored results.

    Parameters
    ----------
    results : mapping of str to result
        As `ema predict` stores them.
    book : Book
        Numbers the pictures and tables.

    Returns
    -------
    Parts
        Sentences of the first screen, sections, findings and provenance; nothing where no result is a prediction.
    """
    taken: set[str] = set()
    summary: list[str] = []
    sections: list[Section] = []
    sources: dict[str, Provenance] = {}
    names: list[str] = []
    selected = [one for select in (_from_levels, _from_maps, _from_placements) for one in select(results)]
    for number, (name, used, made) in enumerate(selected, 1):
        sentences, parts, provenance = made(book)
        names.append(name)
        summary += sentences
        if len(selected) > 1:
            parts = [Section(f"{one.title}: {name}", f"{one.anchor}-{number}", one.blocks) for one in parts]
        sections += parts
        sources |= {name: provenance}
        taken |= used
    if not taken:
        return Parts(others=results)
    listed = list(dict.fromkeys(name for name in names if name))
    return Parts(
        title=text("Prediction: {names}", names=", ".join(listed)) if listed else text("Prediction"),
        summary=summary,
        sections=sections,
        findings=[one for name in results if name in taken for one in getattr(results[name], "findings", ())],
        provenance=list(sources.items()),
        others={name: one for name, one in results.items() if name not in taken},
    )


Made = tuple[list[str], list[Section], Provenance]
Selected = list[tuple[str, set[str], Callable[[Book], Made]]]
"""Predictions of one kind: what each is called, the results that belong to it, and how it is reported."""


def _from_levels(results: Mapping[str, Any]) -> Selected:
    """Results from stepped levels, those of one mode together."""
    if not any(isinstance(one, _OF_LEVELS[:-1]) for one in results.values()):
        return []
    of_mode: dict[str, dict[str, Any]] = {}
    for name, one in results.items():
        if isinstance(one, _OF_LEVELS):
            of_mode.setdefault(one.name, {})[name] = one
    return [
        (name, set(those), partial(level_parts, FromLevels.of(list(those.values()))))
        for name, those in of_mode.items()
        if any(isinstance(one, _OF_LEVELS[:-1]) for one in those.values())
    ]


def _from_maps(results: Mapping[str, Any]) -> Selected:
    """Predictions of maps, each with its map and the update where they were stored with it."""
    predicted = {name: one for name, one in results.items() if isinstance(one, MapPrediction)}
    charts = {name: one for name, one in results.items() if isinstance(one, ModalMap)}
    updates = {name: one for name, one in results.items() if isinstance(one, ModelUpdate)}
    alone = len(predicted) == len(charts) == 1
    selected: Selected = []
    for name, one in predicted.items():
        chart = next((key for key in charts if alone or charts[key].name == one.name), None)
        update = next(iter(updates), None) if len(predicted) == len(updates) == 1 else None
        used = {key for key in (name, chart, update) if key is not None}
        source = FromMap(one, None if chart is None else charts[chart], None if update is None else updates[update])
        selected.append((one.name, used, partial(map_parts, source)))
    return selected


def _from_placements(results: Mapping[str, Any]) -> Selected:
    """Forecasts of beams at named locations, with the modes without a beam where those were stored."""
    forecasts = {name: one for name, one in results.items() if isinstance(one, Forecast)}
    if not forecasts:
        return []
    bare = next((name for name, one in results.items() if isinstance(one, ModalModel)), None)
    modes = None if bare is None else results[bare]
    used = {*forecasts, *(() if bare is None else (bare,))}
    beams = ", ".join(dict.fromkeys(one.beam or text("beam") for one in forecasts.values()))
    return [(beams, used, partial(location_parts, list(forecasts.values()), modes))]
