"""Curves of steady states over frequency, followed along their arc with the harmonics that every point needs.

Each point is solved a second time with half as many harmonics more and twice as many nodes, in the same plane across
the curve; what that changes is its error. Where it is above the tolerance the wider solution is the point. Contacts
that begin to stick or to part within the period bend the curve over a length far below any step: such a corner is
passed where half a step leads the same way as the whole one does.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from ema.simulate.continuation import Plane, Solution, bordered_newton
from ema.simulate.harmonic import FINEST, LEAST_ERROR, SAFETY, Condensed, _Point, with_harmonics
from ema.simulate.turning_points import ForcedCurve, slope

_FIRST, _LONGEST, _SHORTEST = 0.01, 0.05, 1e-6
"""First, longest and shortest step, over the size of the motion and the width of the band."""
_BEND = 0.9
"""Cosine of the angle between two steps below which the second is halved."""
_HALVED = 0.25, 0.75
"""Length of half a step over that of the whole one, where both end on one curve."""
_MOST_POINTS = 3000
"""Points of a curve at most: a bound on what is kept."""
_BUDGETS = 20
"""Budget of a curve over that of the search at one frequency."""
_FEWEST, _FEWER, _SPARE = 9, 0.8, 0.1
"""Harmonics at least; the share of them that the next point begins with where the error is below that part of the
tolerance."""
AT_EDGE = 1e-9
"""Share of the band within which a point is at its edge: rounding."""
_CLOSED = 0.75
"""Distance of a point from the first one, over the length of a step, at which a curve is closed."""
NO_POINT = "no steady state was found at the shortest step"
BUDGET_ENDED = "the budget ended it"
POINTS_ENDED = f"it has {_MOST_POINTS} points"


@dataclass(frozen=True)
class Followed:
    """Points of a curve: amplitudes in m, angular frequencies in rad/s, relative errors; how it begins and ends.

    ``fines``: factors on the number of nodes with which each was solved.
    """

    amplitudes: Sequence[Float[np.ndarray, "contact size"]]
    omegas: Float[np.ndarray, "point"]
    errors: Float[np.ndarray, "point"]
    fines: Sequence[int]
    ends: tuple[str, str]
    reasons: tuple[str, str] = ("", "")
    detached: bool = False

    def near(self, omega: float) -> Iterator[Float[np.ndarray, "contact size"]]:
        """Amplitudes where the curve passes a frequency, linear between its points."""
        away = self.omegas - omega
        for n in map(int, np.flatnonzero(away[1:] * away[:-1] <= 0)):
            way = away[n] - away[n + 1]
            share = away[n] / way if way else 0.0
            count = max(part.shape[1] // 2 for part in self.amplitudes[n : n + 2])
            here, there = (with_harmonics(part, count) for part in self.amplitudes[n : n + 2])
            yield here + share * (there - here)

    def reversed(self) -> "Followed":
        """The same from its end to its beginning."""
        return Followed(
            self.amplitudes[::-1],
            self.omegas[::-1],
            self.errors[::-1],
            self.fines[::-1],
            self.ends[::-1],
            self.reasons[::-1],
        )


@dataclass
class _Walk:
    """The way along a curve: what has been passed, in amplitudes over ``size`` m and shares of the band."""

    condensed: Condensed
    edges: tuple[float, float]
    size: float
    place: np.ndarray
    tangent: np.ndarray
    points: list[np.ndarray] = field(default_factory=list)
    errors: list[float] = field(default_factory=list)
    fines: list[int] = field(default_factory=list)

    @property
    def count(self) -> int:
        """Harmonics of the present point."""
        return (len(self.place) - 1) // (2 * len(self.condensed.limits))

    def resized(self, vector: Float[np.ndarray, "coordinate"], count: int) -> Float[np.ndarray, "other"]:
        """Coordinates with another number of harmonics."""
        parts = vector[:-1].reshape(len(self.condensed.limits), -1)
        return np.append(with_harmonics(parts, count).ravel(), vector[-1])

    def across(
        self, ahead: Float[np.ndarray, "coordinate"], tangent: Float[np.ndarray, "coordinate"], count: int
    ) -> tuple[Solution, Float[np.ndarray, "other"]] | None:
        """The solution with ``count`` harmonics in the plane across a tangent through a point, and its coordinates."""
        ahead, tangent = self.resized(ahead, count), self.resized(tangent, count)
        length = float(np.linalg.norm(tangent))
        if not length:
            return None
        plane = Plane(ahead, tangent / length, self.size)
        start = ahead[:-1].reshape(len(self.condensed.limits), -1) * self.size
        found = bordered_newton(ForcedCurve(self.condensed, plane, self.edges), start, ahead[-1:])
        return None if found is None else (found, plane.coordinates(found.amplitudes, found.unknowns))

    def omega(self, vector: Float[np.ndarray, "coordinate"]) -> float:
        """Angular frequency in rad/s."""
        return float(self.edges[0] + vector[-1] * (self.edges[1] - self.edges[0]))

    def point(self, found: Solution, vector: Float[np.ndarray, "coordinate"]) -> _Point:
        """A solution as those of the harmonic balance."""
        return _Point(self.omega(vector), found.amplitudes, found.forces, found.lost, 1.0)

    def judged(
        self, found: Solution, reached: Float[np.ndarray, "coordinate"]
    ) -> tuple[Solution, Float[np.ndarray, "other"], float]:
        """The point with the harmonics and nodes that the tolerance asks for, and its error.

        The error is what half as many more harmonics and twice as many nodes change of the first harmonic and of the
        frequency across the curve, relative, times ``SAFETY``; 1 where they have no solution there.
        """
        condensed = self.condensed
        while True:
            count, fine, raw = found.count, condensed.fine, 1.0
            condensed.fine = fine if condensed.exact else min(2 * fine, FINEST)
            more = count + max(6 if condensed.harmonics else 1, count // 2)
            wider = self.across(reached, self.resized(self.tangent, count), more)
            if wider is not None:
                moved = abs(self.omega(wider[1]) / self.omega(reached) - 1)
                raw = SAFETY * max(condensed._change(self.point(*wider), self.point(found, reached)), moved)
            if raw <= condensed.tolerance or wider is None or condensed.harmonics or count >= condensed.most_orders:
                condensed.fine = fine
                return found, reached, raw
            found, reached = wider

    def step_to(self, found: Solution, reached: Float[np.ndarray, "coordinate"]) -> None:
        """Go on from a solution ahead."""
        way = reached - self.place
        self.tangent = way / np.linalg.norm(way)
        found, reached, raw = self.judged(found, reached)
        error = max(raw, LEAST_ERROR * self.condensed.tolerance) if found.slips.any() else 0.0
        self.points.append(reached)
        self.errors.append(min(error, 1.0))
        self.fines.append(self.condensed.fine)
        self.go_on(reached)
        if raw < _SPARE * self.condensed.tolerance and not self.condensed.harmonics:
            self.narrowed(self.point(found, reached))

    def go_on(self, place: Float[np.ndarray, "coordinate"]) -> None:
        """Go on from a point, with its harmonics, in the present direction."""
        count = (len(place) - 1) // (2 * len(self.condensed.limits))
        self.place, self.tangent = place, self.resized(self.tangent, count)
        self.tangent /= np.linalg.norm(self.tangent)

    def narrowed(self, point: _Point) -> None:
        """Go on with fewer harmonics and nodes, where the point with these is close by."""
        condensed, fine = self.condensed, self.condensed.fine
        fewer = min(point.count, max(_FEWEST, int(_FEWER * point.count)))
        condensed.fine = max(1, fine // 2)
        if (fewer, condensed.fine) == (point.count, fine):
            return
        narrow = self.across(self.place, self.tangent, fewer)
        if narrow is None or SAFETY * condensed._change(point, self.point(*narrow)) > condensed.tolerance:
            condensed.fine = fine
        else:
            self.go_on(narrow[1])

    def end_at_edge(self, before: np.ndarray) -> None:
        """The last point, which is beyond an edge of the band, at the edge itself: from the straight line to it.

        Where there is no solution at that frequency, as behind a corner of the curve, the point beyond stays.
        """
        last = self.points[-1]
        count = (len(last) - 1) // (2 * len(self.condensed.limits))
        begin, edge = self.resized(before, count), float(last[-1] > 0.5)
        if abs(last[-1] - edge) <= AT_EDGE or last[-1] == begin[-1]:
            return
        ahead = begin + (edge - begin[-1]) / (last[-1] - begin[-1]) * (last - begin)
        kept, self.tangent = self.tangent, np.append(np.zeros(len(last) - 1), 1.0)
        ahead[-1] = edge
        found = self.across(ahead, self.tangent, count)
        if found is None:
            self.tangent = kept
            return
        solution, reached, raw = self.judged(*found)
        error = max(raw, LEAST_ERROR * self.condensed.tolerance) if solution.slips.any() else 0.0
        self.points[-1], self.errors[-1], self.fines[-1] = reached, min(error, 1.0), self.condensed.fine

    def widened(self) -> bool:
        """Go on with more harmonics than the point has; whether there is one."""
        if self.condensed.harmonics or self.count >= self.condensed.most_orders:
            return False
        wide = self.across(self.place, self.tangent, self.count + self.count // 2)
        if wide is not None:
            self.go_on(wide[1])
        return wide is not None


def follow(condensed: Condensed, point: _Point, edges: tuple[float, float], sign: float) -> Followed:
    """The curve from a solution on, with ``sign`` upward or downward at first; it ends at an edge or closed.

    ``edges``: of the band, in rad/s. ``reasons`` say why it was lost, where it was.
    """
    size, width = max(float(np.linalg.norm(point.amplitudes)), 1e-300), edges[1] - edges[0]
    here = np.append(point.amplitudes.ravel() / size, (point.omega - edges[0]) / width)
    tangent = sign * np.append(slope(condensed, point).ravel() * width / size, 1.0)
    walk = _Walk(condensed, edges, size, here, tangent / np.linalg.norm(tangent), [here], [point.error], [point.fine])
    condensed.left, condensed.fine = _BUDGETS * condensed.budget, point.fine
    end, reason = _walked(walk, here, walk.tangent)
    shape = len(condensed.limits), -1
    return Followed(
        [part[:-1].reshape(shape) * size for part in walk.points],
        np.array([walk.omega(part) for part in walk.points]),
        np.array(walk.errors),
        walk.fines,
        ("closed" if end == "closed" else "edge", end),
        ("", reason),
    )


def _walked(walk: _Walk, first: np.ndarray, direction: np.ndarray) -> tuple[str, str]:
    """Go along the curve; how it ends, and why it was lost."""
    step, turned = _FIRST, None
    while len(walk.points) < _MOST_POINTS:
        if walk.condensed.left < 0:
            return "lost", BUDGET_ENDED
        found = walk.across(walk.place + step * walk.tangent, walk.tangent, walk.count)
        way = None if found is None else found[1] - walk.place
        if found is None or way is None or not (_ahead(way, walk.tangent) or _corner(way, turned)):
            step, turned = 0.5 * step, way
            if step < _SHORTEST:
                if not walk.widened():
                    return "lost", NO_POINT
                step, turned = _FIRST, None
            continue
        before, turned = walk.points[-1], None
        walk.step_to(*found)
        count = (len(walk.points[-1]) - 1) // (2 * len(walk.condensed.limits))
        if not -AT_EDGE <= walk.points[-1][-1] <= 1 + AT_EDGE:
            walk.end_at_edge(before)
            return "edge", ""
        begin, start, heading = (walk.resized(part, count) for part in (before, first, direction))
        if len(walk.points) > 5 and _passes(begin, walk.points[-1] - begin, start, heading):
            walk.points[-1], walk.errors[-1], walk.fines[-1] = first, walk.errors[0], walk.fines[0]
            return "closed", ""
        step = min(1.5 * step, _LONGEST * max(1.0, float(np.linalg.norm(walk.place[:-1]))))
    return "lost", POINTS_ENDED


def _ahead(way: np.ndarray, tangent: np.ndarray) -> bool:
    """Whether a step goes on in the direction of the last one."""
    return bool(way @ tangent >= _BEND * np.linalg.norm(way))


def _corner(way: np.ndarray, whole: np.ndarray | None) -> bool:
    """Whether half a step leads where the ``whole`` one did, behind a corner of the curve."""
    if whole is None:
        return False
    lengths = float(np.linalg.norm(way)), float(np.linalg.norm(whole))
    low, high = _HALVED
    return bool(low * lengths[1] <= lengths[0] <= high * lengths[1] and way @ whole >= _BEND * lengths[0] * lengths[1])


def _passes(begin: np.ndarray, way: np.ndarray, first: np.ndarray, direction: np.ndarray) -> bool:
    """Whether a step along a curve passes its first point, in the direction in which it left that."""
    length = float(np.linalg.norm(way))
    along_it = float((first - begin) @ way) / length**2
    aside = float(np.linalg.norm(begin + along_it * way - first))
    return 0 <= along_it <= 1 and aside < _CLOSED * length and float(way @ direction) > 0
