"""Ridge, peak, rise, fall and dip of measured maps, each with an interval, and the verdict that an interval allows.

A line is a map along one axis. What the grid does not resolve is part of every interval: the optimum of a line lies
between the neighbours of its highest point, and beyond the grid where that point is the last one. Between neighbours
the values are taken to have at most one optimum, and only beside a point that is higher, or lower, than both of its
neighbours. How far such a peak may go beyond the points follows from what the peaks of resonance and friction have in
common (:func:`_cells`): no step of the grid is taken to be fine enough. Noise enters by the standard deviations of the
map, at 95 %, with Bonferroni's correction where many points are compared (Miller, Simultaneous Statistical Inference,
1981).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

LEVEL = 0.95
"""Probability of the intervals against noise."""
REVERSAL = 0.25
"""Share of a rise that may be lost again on the way. With 3 % noise a step seen at ten points has an apparent reversal
of at most 0.12 in 95 of 100 draws; a real one of 0.5 is recognised in 499 of 500, one of 0.4 is never missed (a quarter
undecided), one of 0.3 passes as a rise in 14 of 100. Halved, noisy rises become undecided; doubled, a line that falls
by half of what it rose would pass."""
VERTEX = 0.2
"""Part of a step by which the vertex of the parabola through three points may miss that of a smooth peak. Gaussian and
resonance peaks with a step of up to 1.5 of their half width are missed by 0.17 at most. Halved, some frequencies at a
ridge between two points lie outside their interval; doubled, shallow dips become undecided."""
SETTLED = 0.02
"""Part of the height of a line above its last value that it may still be off where it counts as settled. One Masing
spring adds 4 y (1 - y) of its highest damping, y the amplitude that it bears without slip over that of the motion: 0.02
where the motion is 0.5 % larger. Twice or half the part moves that to 1.0 and 0.3 %."""
FEWEST = 3
"""Points below which a line has no optimum inside: two neighbours and the point itself."""

Decision = Literal["matched", "undecided", "not matched", "not testable here"]


@dataclass(frozen=True)
class Measure:
    """A measured value with the bounds of its interval; NaN where ``missing`` says what would be needed."""

    value: float
    lower: float
    upper: float
    missing: str = ""


@dataclass(frozen=True)
class Line:
    """Values (point,) of a map with their std along one increasing axis, holes left out.

    ``whole`` is the line of which this one is a part: what lies beyond the ends of a part says where it has no optimum.
    """

    axis: Float[np.ndarray, "point"]
    values: Float[np.ndarray, "point"]
    std: Float[np.ndarray, "point"]
    whole: "Line | None" = None

    @property
    def negative(self) -> "Line":
        """The line upside down: its dips are peaks."""
        return Line(self.axis, -self.values, self.std, None if self.whole is None else self.whole.negative)

    def reaches(self, low: float, high: float) -> bool:
        """Whether both places on the axis were measured."""
        return all(bool(np.isclose(self.axis, end, rtol=1e-6, atol=0).any()) for end in (low, high))

    def within(self, low: float, high: float) -> "Line":
        """The part between two places on the axis, both included."""
        inside = (self.axis >= low * (1 - 1e-9)) & (self.axis <= high * (1 + 1e-9))
        return Line(self.axis[inside], self.values[inside], self.std[inside], self.whole or self)


def line(
    axis: Float[np.ndarray, "point"],
    values: Float[np.ndarray, "point"],
    std: Float[np.ndarray, "point"] | None = None,
) -> Line:
    """A line from a row or a column of a map.

    Parameters
    ----------
    axis : (point,) force level or normal force in N, in any order.
    values : (point,) any unit; NaN marks a hole.
    std : (point,) in the unit of ``values``; without it the values count as free of noise.

    Examples
    --------
    >>> import numpy as np
    >>> top = ridge(line(np.array([1.0, 2.0, 4.0]), np.array([0.5, 1.0, 0.5])))
    >>> print(f"{top.value:.3g}, between {top.lower:.3g} and {top.upper:.3g}")
    2, between 1 and 4
    """
    known = np.isfinite(values) & np.isfinite(axis)
    order = np.flatnonzero(known)[np.argsort(axis[known])]
    spread = np.zeros(len(axis)) if std is None else np.nan_to_num(np.asarray(std, dtype=np.float64))
    return Line(np.asarray(axis, dtype=np.float64)[order], np.asarray(values, dtype=np.float64)[order], spread[order])


def decide(measures: Sequence[Measure], low: float, high: float, strict: bool = False) -> tuple[Decision, Measure]:
    """The verdict on a sentence that has to hold for every measure, and the measure that decides it.

    ``low`` and ``high`` bound the values with which the sentence holds. *Matched* where every interval lies inside,
    *not matched* where one lies outside, *undecided* where one lies across a limit, *not testable here* without values.
    ``strict``: a value on the limit does not count (no change is no rise).

    Examples
    --------
    >>> decide([Measure(30.0, 25.0, 35.0)], 20.0, 40.0)[0]
    'matched'
    >>> decide([Measure(30.0, 25.0, 35.0)], 28.0, 40.0)[0]
    'undecided'
    """
    known = [one for one in measures if not one.missing]
    if not known:
        missing = measures[0].missing if measures else "no values"
        return "not testable here", Measure(np.nan, np.nan, np.nan, missing)
    verdicts = [_one(measure, low, high, strict) for measure in known]
    for verdict in ("not matched", "undecided"):
        if verdict in verdicts:
            return verdict, known[verdicts.index(verdict)]
    if len(known) < len(measures):
        return "undecided", next(one for one in measures if one.missing)
    margins = [min(one.lower - low, high - one.upper) for one in known]
    return "matched", known[int(np.argmin(margins))]


def _one(measure: Measure, low: float, high: float, strict: bool) -> Decision:
    above = measure.lower > low if strict else measure.lower >= low
    below = measure.upper < high if strict else measure.upper <= high
    if (above or low == -np.inf) and (below or high == np.inf):
        return "matched"
    return "not matched" if measure.upper <= low or measure.lower >= high else "undecided"


def value(given: Line, at: float) -> Measure:
    """The value of a line at a point of its grid."""
    rows = np.flatnonzero(np.isclose(given.axis, at, rtol=1e-6, atol=0))
    if not len(rows):
        return missing(f"a measured point at {at:g} N")
    return estimate(float(given.values[rows[0]]), float(given.std[rows[0]]))


def estimate(value: float, std: float) -> Measure:
    """A value with the two-sided interval at ``LEVEL`` of a normal distribution.

    Parameters
    ----------
    value : the value, in any unit.
    std : its standard deviation in the same unit; one that is not known (NaN, infinite) counts as zero.

    Examples
    --------
    >>> measure = estimate(10.0, 1.0)
    >>> round(measure.lower, 2), round(measure.upper, 2)
    (8.04, 11.96)
    """
    half = _factor(1) * (std if np.isfinite(std) else 0.0)
    return Measure(float(value), float(value - half), float(value + half))


def highest(lines: Sequence[Line]) -> Measure:
    """The highest value of lines, between the points of their grids too."""
    known = [one for one in lines if len(one.values)]
    if not known:
        return missing("a measured point in this range")
    sure = _factor(1)
    wide = _factor(sum(len(one.values) for one in known))
    return Measure(
        max(float(one.values.max()) for one in known),
        max(float(np.max(one.values - sure * one.std)) for one in known),
        max(float(np.max(_heights(one) + wide * one.std)) for one in known),
    )


def ridge(given: Line) -> Measure:
    """Where a line is highest, on its axis: the parabola through three points, between their outer two.

    The interval joins the neighbourhoods of all points that may be the highest, without the outer points themselves:
    they are lower. It is open towards a side where the grid ends.
    """
    if len(given.values) < FEWEST:
        return missing(f"{FEWEST} points along the axis")
    return _between(given, _candidates(given))


def ridge_of(axis: Float[np.ndarray, "line"], lines: Sequence[Line]) -> Measure:
    """Where the line with the highest value lies on an axis across the lines, such as the level of most damping."""
    known = np.array([len(one.values) > 0 for one in lines], dtype=bool)
    if known.sum() < FEWEST:
        return missing(f"{FEWEST} points along the axis")
    rows = [one for one, seen in zip(lines, known, strict=True) if seen]
    tops = [int(np.argmax(one.values)) for one in rows]
    across = line(
        axis[known],
        np.array([one.values[top] for one, top in zip(rows, tops)]),
        np.array([one.std[top] for one, top in zip(rows, tops)]),
    )
    # what each line may reach between its points
    between = np.array([_heights(one).max() for one in rows])[np.argsort(axis[known])] - across.values
    return _between(across, _candidates(across, between))


def dip(given: Line, damping: Line | None = None) -> Measure:
    """By how much a line is lower at a place than beside it, on both sides.

    With ``damping`` the place is its ridge, and the sides begin where it has fallen half the way to its lowest value
    on that side: what the line does within the interval of high damping is no matter. The depth is the lower of the
    highest values on either side, minus the value. Without ``damping`` it is the deepest dip of the line. Negative
    where the line only rises, only falls, or has a maximum there; open downwards where the ridge lies at the end of
    the grid.
    """
    other = given.negative if damping is None else damping
    shared = np.intersect1d(given.axis, other.axis)
    if len(shared) < FEWEST:
        return missing(f"{FEWEST} points along the axis")
    given, other = _on(given, shared), _on(other, shared)
    if damping is None:
        depths = [_depth(given, other, place) for place in range(1, len(shared) - 1)]
        deepest = depths[int(np.argmax([one.value for one in depths]))]
        return Measure(deepest.value, max(one.lower for one in depths), max(one.upper for one in depths))
    depths = [_depth(given, other, int(place)) for place in _candidates(other)]
    here = _depth(given, other, int(np.argmax(other.values)))
    return Measure(here.value, min(one.lower for one in depths), max(one.upper for one in depths))


def peak(given: Line) -> Measure:
    """By how much the highest point of a line stands above both sides of it."""
    return dip(given.negative)


def rise(given: Line | Sequence[Measure]) -> Measure:
    """By how much a line is higher at its end than at its start, if it does not fall in between.

    Of measures with intervals, such as the ridge at every level, the same. Where a fall on the way is larger than
    ``REVERSAL`` of the rise, the value is minus that fall: the line does not rise. Where an optimum between the points
    may make the fall that large, the interval reaches down to minus what it may be.
    """
    return _climb(given, _between_points(given)) if isinstance(given, Line) else _climb_of(given)


def fall(given: Line | Sequence[Measure]) -> Measure:
    """By how much a line is lower at its end than at its start, if it does not rise in between."""
    if isinstance(given, Line):
        upper, lower = _between_points(given)
        return _climb(given.negative, (-lower, -upper))
    return _climb_of([Measure(-one.value, -one.upper, -one.lower, one.missing) for one in given])


def ratio(over: Measure, under: Measure) -> Measure:
    """A place on an axis over another one, with the bounds of both; places are not negative."""
    if over.missing or under.missing:
        return missing(over.missing or under.missing)
    with np.errstate(divide="ignore", invalid="ignore"):
        lower = max(over.lower, 0.0) / np.float64(under.upper)
        upper = over.upper / np.float64(max(under.lower, 0.0))
    return Measure(over.value / under.value, float(np.nan_to_num(lower)), float(upper))


def settled(given: Line) -> Measure:
    """From where on a line stays at its last value, within ``SETTLED`` of what its highest point stands above that.

    The place lies between the last point that is further off and the one behind it. It is open towards the end of the
    grid where the last two points still differ.
    """
    if len(given.values) < FEWEST:
        return missing(f"{FEWEST} points along the axis")
    last = float(given.values[-1])
    doubt = _factor(len(given.values)) * np.hypot(given.std, given.std[-1])
    off = np.abs(given.values - last) > SETTLED * (float(given.values.max()) - last) + doubt
    if not off.any():
        return missing("a line that changes")
    last_off = int(np.flatnonzero(off)[-1])
    begins = float(given.axis[last_off + 1])
    return Measure(begins, float(given.axis[last_off]), begins if last_off + 2 < len(given.axis) else np.inf)


def spread(given: Line) -> Measure:
    """Highest minus lowest value of the points of a line over their mean."""
    if len(given.values) < 2:
        return missing("two points along the axis")
    mean, several = float(given.values.mean()), _factor(len(given.values))
    top, bottom = int(np.argmax(given.values)), int(np.argmin(given.values))
    width = float(given.values[top] - given.values[bottom])
    half = several * float(np.hypot(given.std[top], given.std[bottom]))
    return Measure(width / mean, max(width - half, 0.0) / mean, (width + half) / mean)


def missing(needed: str) -> Measure:
    """No value, and what it would take to have one."""
    return Measure(np.nan, np.nan, np.nan, needed)


def _factor(count: int) -> float:
    """Standard deviations of a two-sided interval that holds for ``count`` points at once."""
    from scipy.stats import norm

    return float(norm.isf((1 - LEVEL) / 2 / max(count, 1)))


def _on(given: Line, axis: Float[np.ndarray, "point"]) -> Line:
    kept = np.isin(given.axis, axis)
    return Line(given.axis[kept], given.values[kept], given.std[kept])


def _scale(given: Line) -> Float[np.ndarray, "point"]:
    """The axis on which neighbours are equally far apart in a test: forces are stepped by factors."""
    return np.log(given.axis) if np.all(given.axis > 0) else given.axis


def _candidates(given: Line, more: Float[np.ndarray, "point"] | float = 0.0) -> np.ndarray:
    """Points that may be the highest, against noise and against what lies between the points; ``more`` is what each
    may be higher for another reason."""
    top = int(np.argmax(given.values))
    doubt = _factor(len(given.values)) * np.hypot(given.std, given.std[top])
    below = given.values[top] - given.values - more
    return np.flatnonzero((below <= doubt) | (_heights(given) + more >= given.values[top]))


def _between(given: Line, candidates: np.ndarray) -> Measure:
    """The optimum of a line between the neighbours of the points that may be the highest."""
    beyond = np.concatenate([[-np.inf], given.axis, [np.inf]])
    ends = beyond[candidates.min()], beyond[candidates.max() + 2]
    lower, upper = (np.nextafter(end, _vertex(given)) if np.isfinite(end) else end for end in ends)
    return Measure(_vertex(given), float(lower), float(upper))


def _vertex(given: Line) -> float:
    top = int(np.argmax(given.values))
    if top in (0, len(given.values) - 1):
        return float(given.axis[top])
    scale = _scale(given)
    x, y = scale[top - 1 : top + 2] - scale[top], given.values[top - 1 : top + 2]
    curvature, slope, _ = np.polyfit(x, y, 2)
    if not curvature < 0:
        return float(given.axis[top])
    shift = float(np.clip(-slope / curvature / 2, x[0], x[2]))
    return float(np.exp(scale[top] + shift)) if np.all(given.axis > 0) else float(scale[top] + shift)


def _heights(given: Line) -> Float[np.ndarray, "point"]:
    """Upper bounds of the optimum that each point stands for: its value, and more where it is a local maximum."""
    y, bounds, cells = given.values, given.values.copy(), _cells(given)
    for j in _local_maxima(y):
        bounds[j] = max([y[j], *cells[max(j - 1, 0) : j + 1]])
    return bounds


def _local_maxima(y: Float[np.ndarray, "point"]) -> np.ndarray:
    """Points that are not lower than any neighbour, those at the ends included."""
    padded = np.concatenate([[-np.inf], y, [-np.inf]])
    return np.flatnonzero((y >= padded[:-2]) & (y >= padded[2:]))


def _cells(given: Line, ends: bool = True) -> Float[np.ndarray, "cell"]:
    """Upper bounds of a line between its points: the higher of two neighbours, and more beside a local maximum.

    Of a peak on a floor one over the root of the height above the floor is convex over the axis, scaled as in
    :func:`_scale`. For a resonance, 1 / (1 + z^2), it is a hyperbola; the peaks of friction, Gaussian ones, and all
    whose height is concave or has a concave logarithm are among them, and stay so when more than the floor is taken
    off. A convex function lies above the extensions of its chords (Boyd and Vandenberghe, Convex Optimization, section
    3.1.3), so the chords on both sides of two points bound the peak between them, at any step of the grid. Where they
    do not, as on a peak that one point alone shows, the bound is infinite. The floor is taken to be the lowest point
    between the valleys beside the peak; a valley is where the line rises again, and a peak what stands above it, beyond
    the noise.

    Without ``ends`` an optimum at the end of the grid is taken to lie on its last point or beyond.
    """
    whole = given.whole or given
    x, y, n, several = _scale(whole), whole.values, len(whole.values), _factor(len(whole.values))
    bounds: np.ndarray = np.maximum(y[:-1], y[1:])
    tops = _local_maxima(y)
    chosen = tops if ends else tops[(tops > 0) & (tops < n - 1)]
    for k in np.unique(np.concatenate([chosen - 1, chosen])):
        if 0 <= k < n - 1:
            first, last = _foot(whole, int(k), -1), _foot(whole, int(k) + 1, 1)
            floor = first if y[first] <= y[last] else last
            if bounds[k] - y[floor] > several * np.hypot(whole.std[k : k + 2].max(), whole.std[floor]):
                rows = slice(first, last + 1)
                peak = _peak_between(Line(x[rows], y[rows], whole.std[rows]), int(k) - first)
                bounds[k] = max(bounds[k], peak)
    if not len(given.values):
        return bounds[:0]
    start = int(np.searchsorted(whole.axis, given.axis[0]))
    return bounds[start : start + len(given.values) - 1]


def _foot(given: Line, start: int, step: int) -> int:
    """The lowest point from ``start`` outwards, up to where the line rises again beyond the noise."""
    y, several = given.values, _factor(len(given.values))
    low = k = start
    while 0 <= k < len(y) and y[k] - y[low] <= several * np.hypot(given.std[k], given.std[low]):
        low = k if y[k] <= y[low] else low
        k += step
    return low


def _peak_between(flanks: Line, k: int) -> float:
    """Upper bound of a peak between the points ``k`` and ``k + 1`` of its flanks; see :func:`_cells`.

    The chords are as flat as the noise allows: what the noise may add is counted with the points. A point that does not
    stand above the floor beyond the noise has none.
    """
    x, y, sure = flanks.axis, flanks.values, _factor(1)
    floor = float(y.min())
    if floor >= max(y[k], y[k + 1]):
        return floor
    width, floor_std = float(x[k + 1] - x[k]), float(flanks.std[int(np.argmin(y))])
    # the extensions of the chords: on the point of their own and on the other one
    own, other = [-np.inf, -np.inf], [-np.inf, -np.inf]
    for side, (near, far) in enumerate(((k, k - 1), (k + 1, k + 2))):
        if 0 <= far < len(y) and y[far] > floor and y[near] - floor > sure * np.hypot(flanks.std[near], floor_std):
            own[side] = float(y[near] - floor) ** -0.5
            noise = sure * np.hypot(flanks.std[far], flanks.std[near])
            flat = float(min(y[far] + noise, max(y[near], y[far])) - floor) ** -0.5
            other[side] = own[side] - (flat - own[side]) / abs(float(x[far] - x[near])) * width
    lowest = min(max(own[0], other[1]), max(other[0], own[1]))
    falls = own[0] - other[1], own[1] - other[0]
    if np.all(np.isfinite(falls)) and min(falls) > 0:
        part = falls[0] / sum(falls)
        lowest = min(lowest, own[0] + part * (other[0] - own[0]))
    return floor + 1 / lowest**2 if lowest > 0 else np.inf


def _between_points(given: Line) -> tuple[Float[np.ndarray, "cell"], Float[np.ndarray, "cell"]]:
    """Upper and lower bounds of the damping between the points of a line.

    Joints add to the damping of a structure: it has peaks on a floor, which the lowest point at an end of the grid is
    taken to show. A dip counts where the points show one, with higher points on both sides.
    """
    return _cells(given), -_cells(given.negative, ends=False)


def _climb(given: Line, between: tuple[Float[np.ndarray, "cell"], Float[np.ndarray, "cell"]]) -> Measure:
    """What :func:`rise` says of a line with upper and lower bounds between its points."""
    values, half = given.values, _factor(len(given.values)) * given.std
    if len(values) < 2:
        return missing("two points along the axis")
    joint = np.hypot(half[:, None], half[None, :])
    single = _factor(1) / _factor(len(values)) * float(joint[0, -1])
    net = float(values[-1] - values[0])
    surely = values[:, None] - values[None, :] - joint
    highs, lows = np.empty(2 * len(values) - 1), np.empty(2 * len(values) - 1)
    highs[::2] = lows[::2] = values
    highs[1::2], lows[1::2] = between
    perhaps = float(np.max(np.maximum.accumulate(highs)[:-1] - lows[1:]))
    return _unless_reversed(net, (net - single, net + single), _fallen(values), (_largest(surely), perhaps))


def _climb_of(given: Sequence[Measure]) -> Measure:
    """What :func:`rise` says of measures with intervals."""
    known = [one for one in given if not one.missing]
    if len(known) < 2:
        return missing("two points along the axis")
    values = np.array([one.value for one in known])
    low, high = np.array([one.lower for one in known]), np.array([one.upper for one in known])
    bounds = float(low[-1] - high[0]), float(high[-1] - low[0])
    fallen = _fallen(values)
    return _unless_reversed(
        float(values[-1] - values[0]), bounds, fallen, (_largest(low[:, None] - high[None, :]), fallen)
    )


def _largest(differences: Float[np.ndarray, "point point"]) -> float:
    """The largest difference of an earlier value and a later one."""
    return float(np.max(differences[np.triu_indices(len(differences), 1)]))


def _fallen(values: Float[np.ndarray, "point"]) -> float:
    return _largest(values[:, None] - values[None, :])


def _unless_reversed(
    net: float, bounds: tuple[float, float], fallen: float, fall_bounds: tuple[float, float]
) -> Measure:
    """A rise with its bounds, or minus the fall on the way, as far as that is sure."""
    surely, perhaps = fall_bounds
    if max(fallen, perhaps) <= max(REVERSAL * net, 0.0) or net <= 0:
        return Measure(net, *bounds)
    if surely > REVERSAL * net:
        return Measure(-fallen, min(-perhaps, bounds[0]), -surely)
    return Measure(net, min(-perhaps, bounds[0]), bounds[1])


def _sides(damping: Line, place: int) -> list[np.ndarray]:
    """The points beside the interval of high damping about a point: below and above it, where there are any."""
    values, sides = damping.values, []
    for outwards in (np.arange(place - 1, -1, -1), np.arange(place + 1, len(values))):
        if len(outwards):
            half = 0.5 * (values[place] + values[outwards].min())
            sides.append(outwards[int(np.argmax(values[outwards] <= half)) :])
    return sides


def _depth(given: Line, damping: Line, place: int) -> Measure:
    """Depth at a point below the highest value on either side, as far as noise and grid determine it.

    A side begins somewhere between its first point and the one before it, which the upper bound counts in. Where a side
    rises to the end of the grid, how high it rises beyond is not known.
    """
    doubt = _factor(len(given.values)) * np.hypot(given.std, given.std[place])
    sides = _sides(damping, place)
    bottom = float(given.values[place])
    deepest, highest_there = _about_vertex(given, damping, place)
    deepest = min(deepest, -float(_heights(given.negative)[place]))
    beside = _heights(given)
    flank = min(float(given.values[side].max()) for side in sides)
    started = [np.append(side, side[0] + (1 if side[0] < place else -1)) for side in sides]
    tops = [
        np.inf if _still_rises(given, side) else float((beside + doubt)[side[side != place]].max()) for side in started
    ]
    upper = min(tops) - deepest
    if len(sides) < 2:
        return Measure(flank - bottom, -np.inf, upper)
    lower = min(float((given.values - doubt)[side].max()) for side in sides) - highest_there
    return Measure(flank - bottom, lower, upper)


def _still_rises(given: Line, side: np.ndarray) -> bool:
    """Whether a line is highest at the end of the grid on a side, and has not settled there: it may rise on beyond."""
    last, before = int(side.max()), int(side.max()) - 1
    if side.min() == 0:
        last, before = 0, 1
    doubt = _factor(len(given.values)) * np.hypot(given.std[last], given.std[before])
    off = given.values[last] - given.values[before]
    return bool(given.values[side].max() == given.values[last] and off > SETTLED * np.ptp(given.values) + doubt)


def _about_vertex(given: Line, damping: Line, place: int) -> tuple[float, float]:
    """Lowest and highest value of a line where the vertex of another one about a point may lie."""
    bottom = float(given.values[place])
    if place in (0, len(given.values) - 1):
        return bottom, bottom
    scale, rows = _scale(given), slice(place - 1, place + 2)
    x = scale[rows] - scale[place]
    along = np.polyfit(x, given.values[rows], 2)
    curvature, slope, _ = np.polyfit(x, damping.values[rows], 2)
    shift = float(np.clip(-slope / curvature / 2, x[0] / 2, x[2] / 2)) if curvature < 0 else 0.0
    reach = VERTEX * np.diff(x)
    values = np.polyval(along, np.linspace(max(shift - reach[0], x[0]), min(shift + reach[1], x[2]), 9))
    return float(min(values.min(), bottom)), float(max(values.max(), bottom))
