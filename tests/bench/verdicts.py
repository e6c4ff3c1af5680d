"""How often verdicts on statements about maps are right: maps in closed form, their truth read on a dense grid.

Every family of rules gets maps of nine kinds: the statement is true, false, just true or just false; the map is
constant, has holes, its optimum at the edge of the grid or beyond, two peaks, or its optimum between two grid points.
Each is judged on two grids, rules along the normal force on that of the work table as well, with noise of 0, 1 and 3 % of what the map spans. The rules see the points of the grid and
their standard deviations; the truth is that of the closed form, by nothing but its largest and smallest values.

    python -m tests.bench.verdicts --n 6 --seed 1
    python -m tests.bench.verdicts --write docs/maps.md
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ema.data import MapResult, ModalMap
from ema.study import recipe, statements

Surface = Callable[[np.ndarray, np.ndarray], np.ndarray]
Grid = tuple[np.ndarray, np.ndarray]

GRIDS: tuple[Grid, Grid] = (
    (np.geomspace(5, 40, 8), np.geomspace(5, 1200, 12)),
    (np.geomspace(5, 40, 15), np.geomspace(5, 1200, 23)),
)
SQUARE: Grid = (np.geomspace(5, 40, 12), np.geomspace(5, 1200, 12))
"""The grid on which axes can be interchanged."""
WORK_TABLE: Grid = (np.array([6.0, 10, 15, 20, 25, 30, 35, 40]), np.array([5.0, 25, 60, 100, 150, 300, 1200]))
"""The grid of ``reports/work_table_absorber.toml``: its steps differ by a factor of four."""
NOISES = (0.0, 0.01, 0.03)
KINDS = ("true", "false", "just true", "just false", "constant", "hole", "edge", "two peaks", "between")
FAMILIES = (
    "ridge",
    "peak level",
    "level of the highest damping",
    "rise of ridge",
    "rise of damping",
    "fall of damping",
    "peak of damping",
    "dip of frequency",
    "highest damping",
    "ridge over that of map",
    "spread over levels",
    "rise along F_N",
    "fall along F_N",
    "damping over ridge",
    "ridge over sticking",
)
ALONG_FORCE = ("rise along F_N", "fall along F_N", "damping over ridge", "ridge over sticking")
"""Families whose peaks are those of resonance and friction too, on the grid of the work table too."""
QUANTITIES = {
    "level of the highest damping": "peak level",
    "rise along F_N": "rise of damping",
    "fall along F_N": "fall of damping",
}
"""What a recipe calls a family, where its name is another one."""
UNCHANGED = ("rise of damping", "fall of damping", "rise along F_N", "fall along F_N", "peak of damping")
"""Families of which a constant line is no instance: no change is no rise."""
PLACES = ("ridge", "peak level", "level of the highest damping", "ridge over that of map", "ridge over sticking")
"""Families whose value is a place on an axis: a constant map has none, and no verdict on it is right."""
SPAN_DAMPING, SPAN_FREQUENCY = 1.0, 5.0
"""What maps span, in percent and Hz: noise is relative to it."""
REVERSAL = 0.25
"""Share of a rise above which it is no rise, as docs/maps.md has it."""
MARKS = ("<!-- verdicts: begin -->", "<!-- verdicts: end -->")


@dataclass(frozen=True)
class Trial:
    """A map in closed form, the statement about it, and ``other`` where it is about two maps.

    ``holes`` are points of the grid that were not measured.
    """

    family: str
    kind: str
    damping: Surface
    frequency: Surface
    keys: dict
    other: Surface | None = None
    holes: int = 0


def bump(x: np.ndarray, at: np.ndarray | float, width: float) -> np.ndarray:
    """A peak of height one on a logarithmic axis."""
    return np.exp(-(np.log(x / at) ** 2) / (2 * width**2))


def resonance(x: np.ndarray, at: np.ndarray | float, width: float) -> np.ndarray:
    """A peak of height one with the flanks of a resonance, ``width`` its half width at half height."""
    return 1 / (1 + (np.log(x / at) / width) ** 2)


def friction(x: np.ndarray, at: np.ndarray | float, power: float) -> np.ndarray:
    """What a Masing spring adds, with height one: nothing from the force on from which it sticks."""
    part = x / at * power / (power + 1)
    best = power**power / (power + 1) ** (power + 1)
    return np.where(part < 1, part**power * np.clip(1 - part, 0, None), 0.0) / best


def flat(value: float) -> Surface:
    return lambda level, force: value + 0 * level * force


# ---- truth, on grids so dense that what lies between their points is no matter


def dense(ends: Sequence[float], beyond: float = 1.0) -> np.ndarray:
    """Points between the ends, or a factor further."""
    return np.geomspace(min(ends) / beyond, max(ends) * beyond, 6001)


def top_of(values: np.ndarray, axis: np.ndarray) -> float:
    return float(axis[int(np.argmax(values))])


def side_values(frequency: np.ndarray, damping: np.ndarray, top: int) -> list[float]:
    """Highest frequency on either side, from where the damping has fallen half the way to its lowest value there."""
    found = []
    for part in (slice(top - 1, None, -1) if top else slice(0, 0), slice(top + 1, None)):
        own, outside = damping[part], frequency[part]
        if len(own):
            below = np.flatnonzero(own <= 0.5 * (damping[top] + own.min()))
            found.append(float(outside[below[0] :].max()))
    return found


def prominence(values: np.ndarray) -> float:
    """How far any point stands above the lowest values on both of its sides."""
    left, right = np.minimum.accumulate(values), np.minimum.accumulate(values[::-1])[::-1]
    return float(np.max((values - np.maximum(left, right))[1:-1]))


def net_rise(values: np.ndarray) -> float:
    """End less start, or minus the largest fall on the way where that takes more than a quarter of it."""
    net = float(values[-1] - values[0])
    fallen = float(np.max(np.maximum.accumulate(values) - values))
    return -fallen if net > 0 and fallen > REVERSAL * net else net


def truths(trial: Trial, grid: Grid) -> list[float]:
    """The values of which the statement speaks, at the levels or normal forces of the grid where it names none."""
    levels, forces = grid
    keys, damping = trial.keys, trial.damping
    asked = [keys["level"]] if "level" in keys else list(levels)
    far, wide = dense(forces, 10.0), dense(forces)
    along = [np.array([level]) for level in asked]
    match trial.family:
        case "ridge":
            return [top_of(damping(level, wide), wide) for level in along]
        case "ridge over that of map":
            return [top_of(damping(one, wide), wide) / top_of(trial.other(one, wide), wide) for one in along]
        case "peak level":
            axis = dense(levels)
            return [top_of(damping(axis, np.array([keys["force"]])), axis)]
        case "level of the highest damping":
            axis = dense(levels)[::4]
            return [top_of(damping(axis[:, None], wide[::20]).max(axis=1), axis)]
        case "rise of ridge":
            return [net_rise(np.array([top_of(damping(level, wide), wide) for level in along]))]
        case "rise of damping" | "fall of damping":
            values = damping(dense(levels), np.array([keys["force"]]))
            return [net_rise(values if trial.family.startswith("rise") else -values)]
        case "peak of damping":
            return [prominence(damping(level, wide)) for level in along]
        case "dip of frequency":
            values = []
            for level in along:
                own, high = damping(level, far), trial.frequency(level, far)
                top = int(np.argmax(own))
                values.append(min(side_values(high, own, top)) - float(high[top]))
            return values
        case "highest damping":
            return [float(damping(dense(levels)[::60, None], wide[::4]).max())]
        case "rise along F_N" | "fall along F_N":
            part = dense(keys["forces"])
            return [net_rise((1 if trial.family.startswith("rise") else -1) * damping(one, part)) for one in along]
        case "damping over ridge":
            part = dense(keys["forces"])
            return [float(damping(one, part).max() / damping(one, wide).max()) for one in along]
        case "ridge over sticking":
            return [top_of(damping(one, wide), wide) / sticking(damping(one, far), far) for one in along]
        case "spread over levels":
            values = [damping(dense(levels), np.array([force])) for force in forces]
            points = [damping(levels, np.array([force])) for force in forces]
            return [float(np.ptp(one) / own.mean()) for one, own in zip(values, points)]
    raise AssertionError(trial.family)


def sticking(values: np.ndarray, axis: np.ndarray) -> float:
    """From where on a line does not change any more."""
    return float(axis[int(np.flatnonzero(values != values[-1])[-1]) + 1])


def unit(family: str, grid: Grid) -> float:
    """How far from its limit a value is called away from it: one and a half steps of the grid for a place, three for
    what two places make, a fifth to a third of what the map spans for values."""
    steps = [float(np.log(axis[-1] / axis[0])) / (len(axis) - 1) for axis in grid]
    return {
        "ridge": 1.5 * steps[1],
        "ridge over that of map": 3 * steps[1],
        "ridge over sticking": 3 * steps[1],
        "damping over ridge": 0.15,
        "peak level": 1.5 * steps[0],
        "level of the highest damping": 1.5 * steps[0],
        "peak of damping": 0.2 * SPAN_DAMPING,
        "dip of frequency": 0.3 * SPAN_FREQUENCY,
        "spread over levels": 0.2,
    }.get(family, 0.3 * SPAN_DAMPING)


def margin(trial: Trial, grid: Grid) -> float:
    """Distance of the truth from the limits in units of :func:`unit`, positive where the statement holds."""
    low, high = trial.keys.get("low", -np.inf), trial.keys.get("high", np.inf)
    found = []
    for value in truths(trial, grid):
        if trial.family in PLACES:
            found.append(min(np.log(value / low) if low > 0 else np.inf, np.log(high / value)))
        elif trial.family == "rise of ridge":
            wide = dense(grid[1])
            places = np.log([top_of(trial.damping(np.array([one]), wide), wide) for one in grid[0]])
            fallen = float(np.max(np.maximum.accumulate(places) - places))
            far = places[-1] - places[0] if value > 0 or places[-1] < places[0] else -fallen
            found.append(far / (3 * np.log(grid[1][1] / grid[1][0])) * unit(trial.family, grid))
        else:
            found.append(min(value - low, high - value))
    return float(min(found)) / unit(trial.family, grid)


# ---- maps


def drawn(family: str, kind: str, rng: np.random.Generator, grid: Grid) -> Trial:
    """A map of a kind, and a statement about it whose limit is as far from the truth as the kind wants it."""
    far = {"just true": rng.uniform(0.02, 0.3), "just false": -rng.uniform(0.02, 0.3)}
    sure = {"true": 1.0, "false": -1.0}.get(kind, float(rng.choice([-1.0, 1.0])))
    distance = far.get(kind, sure * rng.uniform(1.05, 2.67))
    if family in ALONG_FORCE:
        return _along_force(family, kind, rng, grid, distance)
    trial = _shape(family, kind, rng, grid, distance)
    if family in ("rise of ridge", "rise of damping", "fall of damping"):
        return replace(trial, keys={**trial.keys, "low": 0.0})
    if kind == "constant" and family in ("peak of damping", "dip of frequency"):
        return replace(trial, keys={**trial.keys, "low": 0.0})
    values = truths(trial, grid)
    apart = distance * unit(family, grid)
    if family == "spread over levels":
        return replace(trial, keys={**trial.keys, "high": max(values) + apart})
    if family in PLACES:
        return replace(trial, keys={**trial.keys, "low": min(values) * np.exp(-apart)})
    return replace(trial, keys={**trial.keys, "low": min(values) - apart})


def _shape(family: str, kind: str, rng: np.random.Generator, grid: Grid, distance: float) -> Trial:
    levels, forces = grid
    coarse = GRIDS[0]
    keys: dict = {}
    if family in ("ridge", "peak of damping", "dip of frequency"):
        keys["level"] = float(levels[int(rng.integers(len(levels)))])
    if family in ("peak level", "rise of damping", "fall of damping"):
        keys["force"] = float(forces[int(rng.integers(len(forces)))])
    holes = int(rng.integers(1, 3)) if kind == "hole" else 0
    made = {"family": family, "kind": kind, "keys": keys, "holes": holes}
    steady = flat(500.0)
    if kind == "constant":
        return Trial(damping=flat(0.8), frequency=steady, other=flat(0.8), **made)
    if family in ("rise of damping", "fall of damping"):
        return Trial(damping=_profile(kind, rng, levels, distance, family), frequency=steady, **made)
    if family == "spread over levels":
        slope, bend = rng.uniform(0.1, 0.8), rng.uniform(0.5, 2.0)
        part = lambda level: np.log(level / levels[0]) / np.log(levels[-1] / levels[0])  # noqa: E731
        return Trial(
            damping=lambda level, force: 1.2 + slope * np.clip(part(level), 0, None) ** bend + 0 * force,
            frequency=steady,
            **made,
        )
    along_levels = family in ("peak level", "level of the highest damping")
    axis, own = (levels, coarse[0]) if along_levels else (forces, coarse[1])
    width = rng.uniform(1.0, 1.8) * float(np.log(own[1] / own[0]))
    at = _place(kind, rng, axis)
    height = rng.uniform(0.7, 1.0) * SPAN_DAMPING
    second = (at * np.exp(np.sign(np.log(np.sqrt(axis[0] * axis[-1]) / at)) * rng.uniform(3.5, 4.5) * width), 0.0)
    if kind == "two peaks":
        second = (second[0], rng.uniform(0.3, 0.7))

    def peak(x: np.ndarray, moved: np.ndarray | float = 1.0) -> np.ndarray:
        return 0.6 + height * (bump(x, at * moved, width) + second[1] * bump(x, second[0], width))

    if family == "peak level":
        return Trial(damping=lambda level, force: peak(level) + 0 * force, frequency=steady, **made)
    if family == "level of the highest damping":
        ridge, slope = float(np.exp(rng.uniform(*np.log([10, 600])))), rng.uniform(-0.5, 0.5)
        return Trial(
            damping=lambda level, force: 0.6 + (peak(level) - 0.6) * bump(force, ridge * (level / 15) ** slope, 0.9),
            frequency=steady,
            **made,
        )
    if family == "rise of ridge":
        step = float(np.log(forces[1] / forces[0]))
        exponent = 3 * step * distance / float(np.log(levels[-1] / levels[0]))
        return Trial(
            damping=lambda level, force: peak(force, (level / np.sqrt(levels[0] * levels[-1])) ** exponent),
            frequency=steady,
            **made,
        )
    deep = rng.uniform(-1.0, 1.0) * SPAN_FREQUENCY
    beside = at * np.exp(rng.uniform(-0.3, 0.3) * width)
    return Trial(
        damping=lambda level, force: peak(force) + 0 * level,
        frequency=lambda level, force: 500 - deep * bump(force, beside, 1.3 * width) + 0 * level,
        other=_other(rng, forces),
        **made,
    )


def _along_force(family: str, kind: str, rng: np.random.Generator, grid: Grid, distance: float) -> Trial:
    """A map with a ridge that moves with the level, its peaks those of resonance, friction or Gaussian, and a part of a
    row. Of rises and falls that are to be (just) true or false, map and part are drawn until they are."""
    levels, forces = grid
    keys: dict = {"level": float(levels[int(rng.integers(len(levels)))])}
    made = {"family": family, "kind": kind, "holes": int(rng.integers(1, 3)) if kind == "hole" else 0}
    made["frequency"] = flat(500.0)
    constant = Trial(damping=flat(0.8), keys=keys | {"forces": [float(forces[1]), float(forces[-1])]}, **made)
    if kind == "constant":
        limit = {"ridge over sticking": {"low": 0.5}, "damping over ridge": {"high": 1.0}}.get(family, {"low": 0.0})
        keys = keys if family == "ridge over sticking" else constant.keys
        return replace(constant, keys=keys | limit)
    for _ in range(5000):
        damping = _moving(family, kind, rng, grid)
        if family == "ridge over sticking":
            trial = Trial(damping=damping, keys=keys, **made)
            low = truths(trial, grid)[0] * np.exp(-distance * unit(family, grid))
            return replace(trial, keys=keys | {"low": low})
        first, last = np.sort(rng.choice(len(forces), 2, replace=False))
        last = last if rng.random() < 0.5 else len(forces) - 1
        trial = Trial(damping=damping, keys=keys | {"forces": [float(forces[first]), float(forces[last])]}, **made)
        if family == "damping over ridge":
            return replace(trial, keys=trial.keys | {"high": truths(trial, grid)[0] + distance * unit(family, grid)})
        trial = replace(trial, keys=trial.keys | {"low": 0.0})
        far, near = margin(trial, grid), _nearness(trial)
        wanted = far * distance > 0 and (near < 0.3 if kind.startswith("just") else abs(far) > 1)
        if wanted or kind not in ("true", "false", "just true", "just false"):
            return trial
    raise AssertionError("no part of such a map")


def _nearness(trial: Trial) -> float:
    """How far a part of a row is from neither rising nor falling, or from a reversal that matters, in units."""
    values = trial.damping(np.array([trial.keys["level"]]), dense(trial.keys["forces"]))
    values = values if trial.family.startswith("rise") else -values
    net, fallen = float(values[-1] - values[0]), float(np.max(np.maximum.accumulate(values) - values))
    return min(abs(net), abs(fallen - REVERSAL * net)) / (0.3 * SPAN_DAMPING)


def _moving(family: str, kind: str, rng: np.random.Generator, grid: Grid) -> Surface:
    """Peaks over the normal force that move with the level."""
    levels, forces = grid
    at, height = _place(kind, rng, forces), rng.uniform(0.7, 1.0) * SPAN_DAMPING
    width, power, exponent = rng.uniform(0.5, 0.9), rng.uniform(0.6, 2.5), rng.uniform(-0.5, 0.8)
    if kind in ("edge", "between"):
        exponent = 0.0
    rubs = family == "ridge over sticking"
    form = friction if rubs else (bump, resonance, friction)[int(rng.integers(3))]
    size = power if form is friction else width
    lower = rng.uniform(0.3, 0.7) if kind == "two peaks" else 0.0
    apart = np.exp(-rng.uniform(3.5, 4.5) * 0.7)

    def damping(level: np.ndarray, force: np.ndarray) -> np.ndarray:
        centre = at * (level / np.sqrt(levels[0] * levels[-1])) ** exponent
        return 0.6 + height * (form(force, centre, size) + lower * form(force, centre * apart, size))

    return damping


def _other(rng: np.random.Generator, forces: np.ndarray) -> Surface:
    at, width = float(np.exp(rng.uniform(*np.log(forces[[2, -3]])))), rng.uniform(0.5, 0.9)
    return lambda level, force: 0.6 + bump(force, at, width) + 0 * level


def _place(kind: str, rng: np.random.Generator, axis: np.ndarray) -> float:
    """Where the optimum is: in the middle part of the axis, between two points, or at its end and beyond."""
    if kind == "edge":
        last = axis[-1] if rng.random() < 0.5 else axis[0]
        return float(last * np.exp(np.sign(np.log(last / axis[len(axis) // 2])) * rng.uniform(0, 0.4)))
    if kind == "between":
        k = int(rng.integers(len(axis) // 4, 3 * len(axis) // 4))
        return float(np.sqrt(axis[k] * axis[k + 1]))
    share = rng.uniform(0.15, 0.3) if kind == "two peaks" else rng.uniform(0.3, 0.7)
    return float(axis[0] * (axis[-1] / axis[0]) ** share)


def _profile(kind: str, rng: np.random.Generator, levels: np.ndarray, distance: float, family: str) -> Surface:
    """Damping along the level: a power of the way, at the edge only, or with a reversal."""
    slope = distance * 0.3 * SPAN_DAMPING
    bend = 6.0 if kind == "edge" else rng.uniform(0.5, 2.0)
    share = float(rng.choice([rng.uniform(0.0, 0.1), rng.uniform(0.5, 1.0)])) if kind == "two peaks" else 0.0
    sign = 1.0 if family.startswith("rise") else -1.0

    def values(level: np.ndarray, force: np.ndarray) -> np.ndarray:
        t = np.clip(np.log(level / levels[0]) / np.log(levels[-1] / levels[0]), 0, 1)
        way = t**bend
        if kind == "two peaks":  # up to 0.5 + share, down by ``share``, and up again
            way = np.interp(t, [0, 0.4, 0.6, 1.0], [0, 0.5 + share / 2, 0.5 - share / 2, 1.0])
        return 1.6 + sign * slope * way + 0 * force

    return values


# ---- verdicts


def as_map(name: str, damping: np.ndarray, frequency: np.ndarray, grid: Grid, noise: float, rng) -> MapResult:
    """A measured map with noise and its standard deviations."""
    spans = noise * SPAN_DAMPING / 100, noise * SPAN_FREQUENCY
    noisy = [one + span * rng.normal(size=one.shape) for one, span in zip((damping / 100, frequency), spans)]
    std = [np.full(damping.shape, span) for span in spans]
    made = ModalMap(*grid, noisy[1], noisy[0], frequency_std=std[1], damping_std=std[0], name=name)
    return MapResult(name, made, np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.full(damping.shape, np.nan))


def verdict(trial: Trial, grid: Grid, noise: float, rng: np.random.Generator) -> str:
    """What the rules say about the map at the points of a grid."""
    level, force = grid[0][:, None], grid[1][None, :]
    damping, frequency = (np.array(one(level, force)) for one in (trial.damping, trial.frequency))
    for _ in range(trial.holes):
        place = tuple(int(rng.integers(size)) for size in damping.shape)
        damping[place] = frequency[place] = np.nan
    maps = [as_map("map", damping, frequency, grid, noise, rng)]
    quantity = QUANTITIES.get(trial.family, trial.family)
    keys = dict(trial.keys)
    if trial.family == "ridge over that of map":
        maps.append(as_map("other", np.array(trial.other(level, force)), frequency, grid, noise, rng))
        keys["other"] = "other"
    table = recipe.StatementTable(text="t", source="s", quantity=quantity, verdict="matched", map="map", **keys)
    return statements.judge([table], tuple(maps), ())[0].verdict


@dataclass(frozen=True)
class Outcome:
    """One verdict: whether the statement ``holds`` (``None``: it has no answer), and how far from its limit.

    ``uneven``: on the grid of the work table, whose widest step is three half widths of the narrowest peaks.
    """

    family: str
    kind: str
    noise: float
    holds: bool | None
    margin: float
    verdict: str
    uneven: bool = False

    @property
    def wrong(self) -> bool:
        """Decided, and not as it is."""
        decided = self.verdict in ("matched", "not matched")
        return decided and (self.holds is None or (self.verdict == "matched") is not self.holds)

    @property
    def away(self) -> bool:
        """Whether the truth lies away from the limit, on a map that shows it."""
        return self.holds is not None and abs(self.margin) > 1 and self.kind not in ("hole", "edge", "constant")

    @property
    def undecided(self) -> bool:
        return self.verdict not in ("matched", "not matched")


def outcomes(family: str, count: int, seed: int) -> list[Outcome]:
    """Verdicts on ``count`` maps of every kind, on every grid and at every noise."""
    found = []
    for number in range(count):
        for kind in KINDS:
            for which, grid in enumerate((*GRIDS, WORK_TABLE) if family in ALONG_FORCE else GRIDS):
                rng = np.random.default_rng([seed, FAMILIES.index(family), KINDS.index(kind), number, which])
                trial = drawn(family, kind, rng, grid)
                nothing = kind == "constant" and family in PLACES
                far = 0.0 if nothing else margin(trial, grid)
                holds = None if nothing else bool(far > 0)
                for noise in NOISES:
                    says = verdict(trial, grid, noise, rng)
                    found.append(Outcome(family, kind, noise, holds, far, says, uneven=which == len(GRIDS)))
    return found


def interchanged(surface: Surface) -> Surface:
    """The surface with its axes interchanged on the square grid."""
    (first, last), (low, high) = SQUARE[0][[0, -1]], SQUARE[1][[0, -1]]

    def swapped(level: np.ndarray, force: np.ndarray) -> np.ndarray:
        other_force = low * (high / low) ** (np.log(level / first) / np.log(last / first))
        other_level = first * (last / first) ** (np.log(force / low) / np.log(high / low))
        return surface(other_level, other_force)

    return swapped


def turned(surface: Surface, about: float) -> Surface:
    """The surface upside down."""
    return lambda level, force: 2 * about - surface(level, force)


def answer(trial: Trial, grid: Grid) -> tuple[bool | None, bool]:
    """Whether the statement holds (``None``: a line that does not change has no optimum), and whether that is clear."""
    along, across = np.array([dense(grid[0])[::60]]).T, dense(grid[1])[::60]
    values = trial.damping(along, across)
    if trial.family == "peak level":
        values = trial.damping(along, np.array([trial.keys["force"]])).T
    elif "level" in trial.keys:
        values = trial.damping(np.array([[trial.keys["level"]]]), across)
    if trial.family in PLACES and np.all(np.ptp(values, axis=1) < 1e-9):
        return None, True
    far = margin(trial, grid)
    unchanged = trial.family in UNCHANGED and abs(far) < 1e-9
    return bool(far > 0) and not unchanged, abs(far) > 1 or unchanged


def changes(family: str, count: int, seed: int) -> dict[str, tuple[int, int, int]]:
    """By transformation: how many verdicts had to change, how many did, how many became wrong.

    A verdict has to change where the map decided the statement and the answer became clearly another one; one that was
    undecided and stays so is no wrong answer.
    """
    found = {}
    for name in ("axes interchanged", "sign changed"):
        due = done = wrong = 0
        for number in range(count):
            rng = np.random.default_rng([seed, FAMILIES.index(family), 99, number])
            trial = drawn(family, ("true", "false")[number % 2], rng, SQUARE)
            if name == "axes interchanged":
                other = replace(
                    trial,
                    damping=interchanged(trial.damping),
                    frequency=interchanged(trial.frequency),
                    other=trial.other and interchanged(trial.other),
                )
            else:
                other = replace(
                    trial,
                    damping=turned(trial.damping, 0.9) if family != "dip of frequency" else trial.damping,
                    frequency=turned(trial.frequency, 500.0),
                )
            (before, _), (after, clear) = answer(trial, SQUARE), answer(other, SQUARE)
            says = [verdict(one, SQUARE, 0.0, np.random.default_rng(0)) for one in (trial, other)]
            right = {True: "matched", False: "not matched", None: ""}
            wrong += clear and says[1] in {"matched", "not matched"} - {right[after]}
            if before is not after and clear and says[0] == right[before]:
                due += 1
                done += says[0] != says[1]
        found[name] = due, done, wrong
    return found


def table(results: Sequence[Outcome]) -> str:
    """Wrong verdicts and undecided ones away from the limit, for every family and noise."""
    head = "| rule | maps | " + " | ".join(f"wrong, {100 * noise:g} %" for noise in NOISES) + " | "
    head += " | ".join(f"undecided away from the limit, {100 * noise:g} %" for noise in NOISES) + " |"
    lines = [head, "|---" * (2 + 2 * len(NOISES)) + "|"]
    for family, uneven in dict.fromkeys(
        (one.family, one.uneven) for one in sorted(results, key=lambda one: one.uneven)
    ):
        rows = [one for one in results if (one.family, one.uneven) == (family, uneven)]
        own = [[one for one in rows if one.noise == noise] for noise in NOISES]
        wrong = [f"{sum(one.wrong for one in part)}" for part in own]
        away = [[one for one in part if one.away] for part in own]
        open_ = [f"{sum(one.undecided for one in part)} of {len(part)}" for part in away]
        name = f"{family}, uneven grid" if uneven else family
        lines.append(f"| {name} | {len(own[0])} | {' | '.join(wrong)} | {' | '.join(open_)} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=6, help="maps of every kind and grid")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="*", default=FAMILIES, choices=FAMILIES)
    parser.add_argument("--write", type=Path, help="page whose table is replaced")
    given = parser.parse_args()
    results = [one for family in given.only for one in outcomes(family, given.n, given.seed)]
    for one in results:
        if one.wrong:
            print(f"wrong: {one.family}, {one.kind}, {one.noise:g}: {one.verdict}, margin {one.margin:.2f}")
    page = table(results)
    rows = [
        "",
        "| rule | axes interchanged: due, changed, wrong | sign changed: due, changed, wrong |",
        "|---|---|---|",
    ]
    for family in given.only:
        counts = changes(family, 10 * given.n, given.seed)
        rows.append(f"| {family} | " + " | ".join(", ".join(map(str, one)) for one in counts.values()) + " |")
    page = "\n".join([page, *rows])
    print(page)
    if given.write:
        before, rest = given.write.read_text(encoding="utf-8").split(MARKS[0])
        after = rest.split(MARKS[1])[1]
        given.write.write_text(f"{before}{MARKS[0]}\n{page}\n{MARKS[1]}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
