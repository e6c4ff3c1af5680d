"""Curves of steady states over frequency, isolated ones too, with the stability along them."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from ema.data import BeamModel
from ema.data.stability import UNDECIDED, FloquetMultipliers, SteadyStateCurve
from ema.dof import Dof
from ema.errors import InputError
from ema.progress import Progress, advance, silent
from ema.simulate.checks import is_number
from ema.simulate.coexistence import DISTINCT, Search, condensed_model, refined, search_at, whole
from ema.simulate.curve_following import AT_EDGE, Followed, follow
from ema.simulate.harmonic import Condensed, _Point, with_harmonics
from ema.simulate.stability import multipliers_of
from ema.simulate.steady_states import HarmonicBalance

_SAMPLED = 24
"""Points of a curve whose multipliers are computed at first, besides those at its folds."""
_BEGUN = (0.0, 1.0, 0.5)
"""Shares of the band at which the first curve is begun, the next one where there is no state with an error below 1."""
_NOT_COMPUTED = "its multipliers were not computed"
_SAME = 0.05
"""Distance of the motion from a curve, relative, within which it lies on it between two of its points."""


def frf_curves(
    model: BeamModel,
    band: tuple[float, float],
    force: float,
    at: Dof | str,
    outputs: Sequence[Dof | str],
    settings: HarmonicBalance | None = None,
    *,
    searched: int = 5,
    starts: int = 20,
    seed: int = 0,
    stability: bool = True,
    progress: Progress = silent,
) -> tuple[SteadyStateCurve, ...]:
    """Follow the curves of steady states over frequency through their folds, with the stability along them.

    The first curve begins at the lower edge of the band, or at a frequency within where no state is reached there. At
    ``searched`` frequencies coexisting states are searched; each that lies on no curve that is known begins another
    one. Curves that no search came to are missing. Every point is solved with the harmonics that the tolerance asks
    for. The budget of a curve is twenty times that of the search at one frequency; where it ends, or no further point
    is reached, ``ends`` and ``reasons`` of the curve say so, and its last point says where.

    Parameters
    ----------
    model : BeamModel
        The model.
    band : tuple of (float, float)
        Frequencies [Hz] between which curves are followed.
    force : float
        Amplitude of the force [N].
    at : Dof or str
        DOF of the force.
    outputs : sequence of Dof or str
        DOFs whose amplitudes are computed.
    settings : HarmonicBalance, optional
        Tolerance, modes, harmonics and budget.
    searched : int, default 5
        Number of frequencies, even in the band, at which coexisting states are searched; 0 follows the first curve
        alone.
    starts : int, default 20
        Random starts at each of them.
    seed : int, default 0
        Seed of the random starts.
    stability : bool, default True
        Whether to compute Floquet multipliers: at up to a few dozen points of a curve, at its folds and where the
        verdict changes; between two points with one verdict, that verdict.
    progress : Progress, optional
        Called while the band is searched.

    Returns
    -------
    tuple of SteadyStateCurve
        The curve from the lower edge first; none where no state was reached.

    Raises
    ------
    InputError
        If the band does not ascend from above 0 Hz, or a number is not positive.

    Examples
    --------
    >>> from ema.examples import beam_model
    >>> curves = frf_curves(beam_model(), (50.0, 60.0), 1.0, "1:+X", ["1:+X"], searched=0, stability=False)
    >>> len(curves), curves[0].isolated
    (1, False)
    """
    chosen = settings or HarmonicBalance()
    if not (all(is_number(edge) for edge in band) and 0 < band[0] < band[1]):
        raise InputError("not a band", where=model.name, got=band, expected="two frequencies above 0 Hz, ascending")
    whole(model.name, searched=searched, starts=starts)
    condensed = condensed_model(model, force, at, outputs, chosen)
    edges = 2 * np.pi * band[0], 2 * np.pi * band[1]
    curves = _first(condensed, band, edges)
    for number, frequency in enumerate(np.linspace(*band, searched + 2)[1:-1]):
        advance(progress, "frequencies searched", number, searched)
        search, _, _ = search_at(condensed, float(frequency), (starts, seed + number, 10.0))
        for point in search.points:
            if not any(_on(search, curve, point) for curve in curves):
                curve = _curve(condensed, refined(condensed, float(frequency), point), edges)
                # one that could not be followed any farther from the edge may be this one
                parts = [n for n, one in enumerate(curves) if "lost" in one.ends and _contains(condensed, curve, one)]
                curves = [one for n, one in enumerate(curves) if n not in parts]
                curves.insert(min(parts, default=len(curves)), replace(curve, detached=0 not in parts))
    # where the first curve was lost, one that begins elsewhere may be the rest of it
    lost = any("lost" in curve.ends for curve in curves[:1])
    curves = [replace(one, detached=one.detached and not lost and "lost" not in one.ends) for one in curves]
    return tuple(_with_stability(condensed, curve, band, stability) for curve in curves)


def _contains(condensed: Condensed, curve: Followed, part: Followed) -> bool:
    """Whether a curve passes through the middle point of another one."""
    middle = len(part.omegas) // 2
    for there in curve.near(float(part.omegas[middle])):
        here = with_harmonics(part.amplitudes[middle], there.shape[1] // 2)
        if np.linalg.norm(here - there) < _SAME * np.linalg.norm(here):
            return True
    return False


def _on(search: Search, curve: Followed, point: _Point) -> bool:
    """Whether a solution lies on a curve: it is what Newton's method makes of a passage of its frequency."""
    for start in curve.near(search.omega):
        search.condensed.left = search.condensed.budget
        begun = _Point(search.omega, start, start, start[:, 0], 1.0)
        again = search.condensed._again(begun, search.gains)
        if again is not None and search.condensed._change(again, point) < DISTINCT:
            return True
    return False


def _first(condensed: Condensed, band: tuple[float, float], edges: tuple[float, float]) -> list[Followed]:
    """The curve from the lower edge, or through the first frequency that shows a state, if there is any."""
    for share in _BEGUN:
        point = condensed.solve(band[0] + share * (band[1] - band[0]))
        if point is not None and point.error < 1.0:
            return [_curve(condensed, point, edges) if share else follow(condensed, point, edges, 1.0)]
    return []


def _curve(condensed: Condensed, point: _Point, edges: tuple[float, float]) -> Followed:
    """The curve through a solution: upward from there until it closes or leaves the band, then the other way."""
    ahead = follow(condensed, point, edges, 1.0)
    if ahead.ends[1] == "closed":
        return ahead
    back = follow(condensed, point, edges, -1.0).reversed()
    return Followed(
        amplitudes=[*back.amplitudes[:-1], *ahead.amplitudes],
        omegas=np.concatenate([back.omegas[:-1], ahead.omegas]),
        errors=np.concatenate([back.errors[:-1], ahead.errors]),
        fines=[*back.fines[:-1], *ahead.fines],
        ends=(back.ends[0], ahead.ends[1]),
        reasons=(back.reasons[0], ahead.reasons[1]),
    )


def _in_hertz(omegas: Float[np.ndarray, "point"], band: tuple[float, float]) -> Float[np.ndarray, "point"]:
    """Frequencies of points; one that rounding alone keeps from an edge of the band is at this edge."""
    frequencies = omegas / (2 * np.pi)
    for edge in band:
        frequencies[np.abs(frequencies - edge) <= AT_EDGE * (band[1] - band[0])] = edge
    return frequencies


def _with_stability(
    condensed: Condensed, curve: Followed, band: tuple[float, float], stability: bool
) -> SteadyStateCurve:
    """The curve with multipliers at some of its points, and the verdicts between those that agree."""
    points = [
        _point(condensed, float(omega), amplitudes, (float(error), fine))
        for omega, amplitudes, error, fine in zip(
            curve.omegas, curve.amplitudes, curve.errors, curve.fines, strict=True
        )
    ]
    known: dict[int, FloquetMultipliers] = {}
    if stability:
        turns = 1 + np.flatnonzero(np.diff(np.sign(np.diff(curve.omegas))) != 0)
        spread = np.linspace(0, len(points) - 1, min(_SAMPLED, len(points))).round()
        wanted = sorted({*map(int, spread), *(int(n) for turn in turns for n in (turn - 1, turn, turn + 1))})
        while wanted:
            known |= {n: multipliers_of(condensed, points[n]) for n in wanted}
            order = sorted(known)
            wanted = [
                (low + high) // 2
                for low, high in pairwise(order)
                if high - low > 1 and known[low].verdict != known[high].verdict
            ]
    verdicts, losses, undecided = _between(known, len(points))
    return SteadyStateCurve(
        frequencies=_in_hertz(curve.omegas, band),
        values=np.array([condensed.first(point) for point in points]),
        dofs=condensed.problem.outputs,
        force=condensed.force,
        largest=np.array([known[n].largest if n in known else np.nan for n in range(len(points))]),
        verdicts=verdicts,
        losses=losses,
        error_estimate=curve.errors,
        harmonics=np.array([condensed.orders(point.count)[-1] for point in points]),
        ends=curve.ends,
        reasons=curve.reasons,
        detached=curve.detached,
        name=condensed.problem.system.name,
        undecided_because=undecided,
    )


def _between(known: dict[int, FloquetMultipliers], count: int) -> tuple[tuple[str, ...], ...]:
    """Verdict, loss and why it is undecided of every point: its own, or those of its neighbours, which agree."""
    verdicts, losses, undecided, nearest = [UNDECIDED] * count, [""] * count, [_NOT_COMPUTED] * count, sorted(known)
    for n in range(count):
        if nearest:
            before = known[nearest[max(int(np.searchsorted(nearest, n, side="right")) - 1, 0)]]
            verdicts[n], losses[n], undecided[n] = before.verdict, before.loss, before.reason
    return tuple(verdicts), tuple(losses), tuple(undecided)


def _point(condensed: Condensed, omega: float, amplitudes: np.ndarray, judged: tuple[float, int]) -> _Point:
    """A point of a curve as a solution; ``judged``: its error and the factor on the nodes with which it was solved."""
    error, fine = judged
    forces, _, lost, _ = condensed.contact_forces(amplitudes, omega, fine, derive=False)
    return _Point(omega, amplitudes, forces, lost, error, fine=fine)
