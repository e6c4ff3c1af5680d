"""What the page draws of a placement: the places on the structure, and what is known about one of them."""

from typing import Any

import numpy as np

from ema.app.state import Workbench
from ema.app.views import numbers
from ema.data.placement import Place, Placement, Prediction
from ema.errors import InputError
from ema.messages import text
from ema.messages.recognition import in_words
from ema.place.objective import Objective, of_rows, scores
from ema.show.placement import score_unit, seen_edges


def placement_view(bench: Workbench, number: int) -> dict[str, Any]:
    """Structure, areas kept free and all places with their score; holes are ``None``.

    Raises
    ------
    InputError : there is no such placement.
    """
    placement = _placement(bench, number)
    ranking = placement.ranking
    candidates = ranking.prediction.candidates
    scale, unit = score_unit(placement)
    kinds = sorted({(round(float(angle), 6), int(beam)) for angle, beam in zip(candidates.angles, candidates.beams)})
    return {
        "title": placement.title,
        "warning": placement.warning,
        "unit": unit,
        "objective": ranking.objective,
        "extent": [numbers(axis) for axis in placement.extent],
        "edges": [[numbers(end, 6) for end in edge] for edge in seen_edges(placement)],
        "points": [numbers(point, 6) for point in placement.points],
        "keep_out": [[numbers(corner, 6) for corner in area] for area in placement.keep_out],
        "kinds": [_kind(placement, angle, beam) for angle, beam in kinds],
        "kind": [
            kinds.index((round(float(angle), 6), int(beam)))
            for angle, beam in zip(candidates.angles, candidates.beams, strict=True)
        ],
        "centres": [numbers(centre, 6) for centre in candidates.centres],
        "score": numbers(scale * ranking.scores, 4),
        "ranked": [place.candidate for place in ranking.places],
    }


def place_view(bench: Workbench, number: int, candidate: int) -> dict[str, Any]:
    """One place: its joints, normal force, and frequency and damping of every mode at every level, with 95 % intervals.

    A ranked place is given with all modes together where it was checked so; any other by the one-mode predictor, at the
    normal force that its objective prefers with equal weights of the modes.

    Raises
    ------
    InputError : there is no such placement or place.
    """
    placement = _placement(bench, number)
    ranking, prediction = placement.ranking, placement.ranking.prediction
    if not 0 <= candidate < len(ranking.scores):
        raise InputError("no such place", got=candidate, expected=f"0 to {len(ranking.scores) - 1}")
    rank = next((place for place, one in enumerate(ranking.places, 1) if one.candidate == candidate), 0)
    modes = [
        {"mode": mode + 1, "bare_f": numbers([f], 6)[0], "bare_zeta": numbers([100 * z], 4)[0]}
        for mode, f, z in zip(prediction.modes, prediction.bare_frequencies, prediction.bare_damping, strict=True)
    ]
    ranked = (placement.best, *ranking.places[1:])
    known = _of_rank(ranked[rank - 1]) if rank else _of_map(placement, candidate)
    return {
        "candidate": candidate,
        "rank": rank,
        "modes": modes,
        "levels": numbers(prediction.force_levels, 5),
        "joints": [numbers(joint, 4) for joint in prediction.candidates.joints(candidate)],
        **known,
    }


def _placement(bench: Workbench, number: int) -> Placement:
    if not 0 <= number < len(bench.placements):
        raise InputError("no such placement", got=number + 1, expected=f"one of {len(bench.placements)}")
    return bench.placements[number]


def _kind(placement: Placement, angle: float, beam: int) -> str:
    beam_type = placement.ranking.prediction.candidates.catalogue[beam]
    return text(
        "{beam} at {angle}°",
        beam=beam_type.name or text("beam {number}", number=beam + 1),
        angle=f"{np.degrees(angle):.0f}",
    )


def _of_rank(place: Place) -> dict[str, Any]:
    return {
        "method": place.method,
        "force": numbers([place.normal_force], 4)[0],
        "best_forces": numbers(place.normal_forces, 4),
        "f": [numbers(row, 6) for row in place.frequency],
        "zeta": [numbers(100 * row, 4) for row in place.damping],
        "low": [numbers(100 * row, 4) for row in place.damping_low],
        "high": [numbers(100 * row, 4) for row in place.damping_high],
        "flags": [str(in_words(finding)) for finding in place.findings],
    }


def _of_map(placement: Placement, candidate: int) -> dict[str, Any]:
    ranking = placement.ranking
    checked = ranking.checked is not None and candidate in ranking.shortlist
    row = ranking.shortlist.index(candidate) if checked else candidate
    prediction: Prediction = of_rows(ranking.checked if checked and ranking.checked else ranking.prediction, [row])
    aim, _, over = ranking.objective.partition(", ")
    worth = scores(prediction, Objective(aim, "mean" if over.startswith("mean") else "least"))[0]
    force = int(np.argmax(worth))
    unknown = [[None] * len(prediction.force_levels)] * len(prediction.modes)
    return {
        "method": prediction.method,
        "force": numbers([prediction.normal_forces[force]], 4)[0],
        "best_forces": [],
        "f": [numbers(row[:, force], 6) for row in prediction.frequency[0]],
        "zeta": [numbers(100 * row[:, force], 4) for row in prediction.damping[0]],
        "low": unknown,
        "high": unknown,
        "flags": [],
    }
