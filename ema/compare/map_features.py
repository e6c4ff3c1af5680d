"""Ridge, peak, rise, fall and dip of measured maps, each with an interval, and the verdict that an interval allows.

A line is a map along one axis. What the grid does not resolve is part of every interval: the optimum of a line lies
between the neighbours of its highest point, and beyond the grid where that point is the last one. Between neighbours
the values are taken to have at most one optimum. Noise enters by the standard deviations of the map, at 95 %, with
Bonferroni's correction where many points are compared (Miller, Simultaneous Statistical Inference, 1981).
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
    """Values (point,) of a map with their std along one increasing axis, holes left out."""

    axis: Float[np.ndarray, "point"]
    values: Float[np.ndarray, "point"]
    std: Float[np.ndarray, "point"]

    @property
    def negative(self) -> "Line":
        """The line upside down: its dips are peaks."""
        return Line(self.axis, -self.values, self.std)

    def within(self, low: float, high: float) -> "Line":
        """The part between two places on the axis, both included."""
        inside = (self.axis >= low * (1 - 1e-9)) & (self.axis <= high * (1 + 1e-9))
        return Line(self.axis[inside], self.values[inside], self.std[inside])


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
    ``REVERSAL`` of the rise, the value is minus that fall: the line does not rise.
    """
    if isinstance(given, Line):
        several = _factor(len(given.values))
        values, half = given.values, several * given.std
        joint = np.hypot(half[:, None], half[None, :])
        single = _factor(1) / several * joint[0, -1] if len(values) else 0.0
        lower = values[:, None] - values[None, :] - joint
        net_bounds = (-single, single)
    else:
        known = [one for one in given if not one.missing]
        values = np.array([one.value for one in known])
        low, high = np.array([one.lower for one in known]), np.array([one.upper for one in known])
        lower = low[:, None] - high[None, :]
        net_bounds = (low[-1] - high[0], high[-1] - low[0]) if known else (0.0, 0.0)
    if len(values) < 2:
        return missing("two points along the axis")
    net = float(values[-1] - values[0])
    bounds = (net + net_bounds[0], net + net_bounds[1]) if isinstance(given, Line) else net_bounds
    pairs = np.triu_indices(len(values), 1)
    fallen = float(np.max((values[:, None] - values[None, :])[pairs]))
    surely = float(np.max(lower[pairs]))
    if fallen <= max(REVERSAL * net, 0.0) or net <= 0:
        return Measure(net, float(bounds[0]), float(bounds[1]))
    if surely > REVERSAL * net:
        return Measure(-fallen, min(-fallen, float(bounds[0])), -surely)
    return Measure(net, min(-fallen, float(bounds[0])), float(bounds[1]))


def fall(given: Line | Sequence[Measure]) -> Measure:
    """By how much a line is lower at its end than at its start, if it does not rise in between."""
    if isinstance(given, Line):
        return rise(given.negative)
    return rise([Measure(-one.value, -one.upper, -one.lower, one.missing) for one in given])


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
    """Highest minus lowest value of a line over their mean."""
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
    """Upper bounds of the optimum that each point stands for: its value, and more where it is a local maximum.

    A concave line lies below the extension of every chord (Boyd and Vandenberghe, Convex Optimization, section 3.1.3).
    Where the chords further out say beyond the noise that it is not concave, the grid does not resolve it, and the
    chords beside the point count up to the next point. Smooth peaks (Gaussian, resonance) stay below it up to a
    step of 1.6 of their half width at 1/sqrt(e) or at half height, and of 1.0 within the first and the last step. A
    cusp, or a peak narrower than that, may be higher.
    """
    x, y = _scale(given), given.values
    bounds = y.copy()
    step, slope = np.diff(x), np.diff(y) / np.diff(x)
    noise = np.zeros(len(y))
    weights = (1 / step[:-1], 1 / step[:-1] + 1 / step[1:], 1 / step[1:])
    parts = [weight * given.std[k : len(y) - 2 + k] for k, weight in enumerate(weights)]
    noise[1:-1] = _factor(1) * np.sqrt(np.sum(np.square(parts), axis=0))
    bends = -np.diff(slope)
    for end, inner, cell in ((0, 1, 0), (-1, -2, -1)):
        # the chord behind the neighbour, extended to the end of the line: y_0 + (slope_0 - slope_1) (x_1 - x_0)
        if len(y) >= FEWEST and y[end] >= y[inner] and bends[end] > noise[inner]:
            bounds[end] = y[end] + bends[end] * step[cell]
    for j in range(1, len(y) - 1):
        if y[j] < y[j - 1] or y[j] < y[j + 1]:
            continue
        left, right, up, down = step[j - 1], step[j], slope[j - 1], -slope[j]
        before = slope[j - 2] if j >= 2 else np.inf
        after = -slope[j + 1] if j + 2 < len(y) else np.inf
        if before < up - noise[j - 1] or after < down - noise[j + 1]:
            bounds[j] = y[j] + max(up * right, down * left)
            continue
        before, after = max(before, up), max(after, down)
        # chords meet at distance t from the point: y_j + down t = y_j + (before - up) left - before t
        t = min((before - up) * left / (before + down), left) if np.isfinite(before) and before + down > 0 else left
        s = min((after - down) * right / (after + up), right) if np.isfinite(after) and after + up > 0 else right
        bounds[j] = y[j] + max(down * t, up * s)
    return bounds


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

    A side begins somewhere between its first point and the one before it, which the upper bound counts in.
    """
    doubt = _factor(len(given.values)) * np.hypot(given.std, given.std[place])
    sides = _sides(damping, place)
    bottom = float(given.values[place])
    deepest, highest_there = _about_vertex(given, damping, place)
    deepest = min(deepest, -float(_heights(given.negative)[place]))
    beside = _heights(given)
    flank = min(float(given.values[side].max()) for side in sides)
    started = [np.append(side, side[0] + (1 if side[0] < place else -1)) for side in sides]
    upper = min(float((beside + doubt)[side[side != place]].max()) for side in started) - deepest
    if len(sides) < 2:
        return Measure(flank - bottom, -np.inf, upper)
    lower = min(float((given.values - doubt)[side].max()) for side in sides) - highest_there
    return Measure(flank - bottom, lower, upper)


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
