"""Resonances over force level and normal force, and damping maps, from harmonic balance alone."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from ema.contact.catalogue import CATALOGUE
from ema.data import BeamModel, Finding, ModalMap, NormalContact, Provenance
from ema.dof import Dof
from ema.errors import InputError
from ema.progress import Progress, advance, silent
from ema.simulate.checks import is_number, positive
from ema.simulate.harmonic import Branch, Condensed, _Point, condense, with_harmonics

HOMOGENEOUS = tuple(name for name, known in CATALOGUE.items() if not known.rates)
"""Laws without a scale of their own: forces and displacements grow together."""
_SHARES = np.array([0.2, 1.0, 0.5])
"""Shares of the tolerance within which frequency, damping ratio and modal amplitude are interpolated."""
_FIRST_PASS = 40
"""Frequencies of the first pass over a band, with few harmonics; peaks are then placed with more."""
_ROUGH, _FINER, _COARSE, _NEAR_TOP, _RIVAL, _MOST_SUMMITS, _FLAT = 3, 5, 30, 0.8, 0.93, 6, 0.02
"""Search of the largest peak: harmonics of the first scan, and of the finer one near its top; frequencies of a scan
along a curve of a map; height, over the largest, from which the grid is made twice as fine, and from which another peak
may be the largest; peaks that are tried at most; rise of 1/height^2 beside a peak, relative, below which a parabola
places it (1 % of the height). They say where peaks are looked for; a peak is then solved with as many harmonics as it
needs. A search that is too coarse takes a lower peak for the highest."""
_FIRST, _FIRST_LEVELS, _BESIDE, _MOST_ORDERS = 24, 7, 1.12, 48
"""Places of a curve that are computed before others are interpolated between them: along force over slip force, and
along force levels; factor on the frequencies of both neighbours between which the next resonance is expected; harmonics
of a peak at most: a bound on the work."""
_RISE = 0.15
"""Rise of the motion of the contacts over a step of a scan, relative, from which on a fold is looked for. A smaller
jump leads to a branch that ends soon; at half of it a map takes 3 % longer."""
_BAND_END = 1e-4
"""Distance of a peak from an end of the band, relative, up to which the band cuts it off: a search that meets no peak
within the band ends there. Peaks are placed within half of it; twice as wide, the last 0.02 % are cut."""
_WALK, _MOST_WALKED = 0.04, 24
"""Steps down from a peak over its damping ratio, a tenth of the way to 0.93 of its height, and how many at most."""
_OF_WIDTH, _ROUNDING, _DROP = 0.005, 1e-9, 0.5
"""How closely a narrow peak is placed, over half its width: twice that takes 5e-5 off its height, which is stated; the
same at least, over its frequency. Rise of 1/height^2 on one side, where the other one is flat, from which on the flank
is halved: the branch may end there."""
_ASIDE = 1e-7
"""Distance from a natural frequency at which it is looked at: an undamped mode has no response there."""
_APART, _CLOSEST, _PLACING = 2e-3, 5e-5, 4.0
"""Distance of frequencies around a peak that is known from fewer harmonics, and steps towards it that no longer
matter, relative; the tolerance with which it is placed, over that of its height."""


@dataclass(frozen=True)
class Resonance:
    """A peak of the response: frequency Hz, complex amplitude of the response in m, equivalent damping ratio.

    ``damping`` is the energy lost per cycle over 4 pi times the largest kinetic energy of the first harmonic;
    ``modal_amplitude`` is mass-normalised, m sqrt(kg); ``error_estimate`` that of the amplitude, relative.
    ``frequency_error`` and ``damping_error``, relative, say how far the largest response may be elsewhere: within the
    error of the amplitude another frequency may be it. Only ``resonance`` looks for that, and for ``rivals``, other
    peaks that rise to 0.93 of this one; NaN elsewhere.
    """

    frequency: float
    amplitude: complex
    damping: float
    modal_amplitude: float
    error_estimate: float
    frequency_error: float = float("nan")
    damping_error: float = float("nan")
    rivals: tuple["Resonance", ...] = ()


def resonance(
    model: BeamModel,
    force: float,
    at: Dof | str,
    output: Dof | str,
    band: tuple[float, float],
    tolerance: float = 5e-3,
    modes: int | None = None,
) -> Resonance:
    """Find the largest response in a band at one force level.

    Parameters
    ----------
    model : BeamModel
        The model.
    force : float
        Amplitude of the force [N].
    at : Dof or str
        DOF of the force.
    output : Dof or str
        DOF of the response.
    band : tuple of (float, float)
        Band [Hz].
    tolerance : float, default 0.005
        Relative error that is aimed at.
    modes : int, optional
        Number of modes kept besides the static corrections; all by default.

    Returns
    -------
    Resonance
        Frequency, amplitude and damping, with its ``rivals``, and errors of frequency and damping that contain them
        where they may be the largest response. Where the curve folds, only a sweep from one side reaches it.

    Raises
    ------
    InputError
        If the band is empty, or no resonance is in it.

    Examples
    --------
    >>> from ema.data import Damping
    >>> from ema.simulate import Masing, Section, double_beam
    >>> section = Section(0.5, 0.04, 0.005, elements=2)
    >>> model = double_beam(Masing(0.3, 1e9), 1000.0, section, damping=Damping(ratio=0.003))
    >>> peak = resonance(model, 1e-3, at="beam 2:2:+Z", output="beam 2:2:+Z", band=(28.0, 36.0))
    >>> round(peak.damping, 4)  # the joint sticks: background damping alone
    0.003
    """
    condensed = condense(model, force, at, [output], tolerance, modes)
    found = peak_in_band(condensed, check_band(model, band))
    if found is None:
        raise _no_resonance(model, band, "the largest response at an end of it")
    return found


def peak_in_band(condensed: Condensed, band: tuple[float, float]) -> Resonance | None:
    """The largest response of a band with its rivals, as of ``resonance``; nothing where it lies at an end."""
    frequency, point = _peak(condensed, band, _FIRST_PASS)
    if not within_band(np.array([frequency]), band)[0]:
        return None
    return _with_rivals(condensed, frequency, point, band)


def within_band(frequency: Float[np.ndarray, "point"], band: tuple[float, float]) -> Bool[np.ndarray, "point"]:
    """Whether largest responses of a band are peaks within it; not where there is none (NaN)."""
    return (frequency > band[0] * (1 + _BAND_END)) & (frequency < band[1] * (1 - _BAND_END))


def no_resonance(where: str, cut: int, count: int, band: tuple[float, float]) -> Finding:
    """What is said of a map with holes where the band cuts off the resonance."""
    return Finding.of(
        "warning",
        "no-resonance",
        where,
        "the model has no resonance between {low} and {high} Hz at {cut} of {count} points.",
        float(cut),
        0.0,
        advice="Widen the band, or look for the mode of the map among those of the model.",
        low=f"{band[0]:.4g}",
        high=f"{band[1]:.4g}",
        cut=cut,
        count=count,
    )


def _no_resonance(model: BeamModel, band: tuple[float, float], got: str) -> InputError:
    return InputError(
        f"no resonance between {band[0]:.4g} and {band[1]:.4g} Hz",
        where=model.name,
        got=got,
        expected="a peak within the band",
        advice="widen the band to hold the mode with the joints stuck and with them slipping",
    )


def _with_rivals(condensed: Condensed, frequency: float, summit: _Point, band: tuple[float, float]) -> Resonance:
    """The largest of the peaks about one, with the others and what they leave open.

    Superharmonics of a lightly damped structure make ripples on a flat peak, which few harmonics do not show. So the
    peak is walked down on both sides with as many as placing a peak takes, and every rise is climbed.
    """
    top = _resonance(condensed, frequency, summit)
    points = _walked(condensed, top, summit, band)
    heights, places = _heights(condensed, points), sorted(points)
    peaks = [top]
    for low, middle, high in zip(places, places[1:], places[2:]):
        apart = min(abs(middle / peak.frequency - 1) for peak in peaks) > _APART
        if apart and heights[middle] > max(heights[low], heights[high], _RIVAL * abs(top.amplitude)):
            found = _summit(condensed, {f: points[f] for f in (low, middle, high)}, 0.0)
            if found is not None and min(abs(found[0] / peak.frequency - 1) for peak in peaks) > _APART:
                peaks.append(_resonance(condensed, *found))
    best, *rivals = sorted(peaks, key=lambda peak: -abs(peak.amplitude))
    least = (1 - best.error_estimate) * abs(best.amplitude)
    others = [_resonance(condensed, f, points[f]) for f in places]
    open_places = [one for one in (*others, *rivals) if (1 + one.error_estimate) * abs(one.amplitude) >= least]
    return replace(
        best,
        frequency_error=max((abs(one.frequency / best.frequency - 1) for one in open_places), default=_CLOSEST),
        damping_error=max((abs(one.damping / best.damping - 1) for one in open_places), default=0.0)
        + best.error_estimate,
        rivals=tuple(one for one in rivals if abs(one.amplitude) >= _RIVAL * abs(best.amplitude)),
    )


def _walked(condensed: Condensed, top: Resonance, summit: _Point, band: tuple[float, float]) -> dict[float, _Point]:
    """Solutions from a peak down to ``_RIVAL`` of its height on both sides, within the band."""
    placing, points, highest = condensed.with_tolerance(_PLACING * condensed.tolerance), {}, abs(top.amplitude)
    step = max(_WALK * top.damping, _APART)
    for way in (-step, step):
        start: np.ndarray | None = with_harmonics(summit.amplitudes, max(_ROUGH, summit.count // 2))
        for number in range(1, _MOST_WALKED + 1):
            frequency = top.frequency * (1 + way) ** number
            if not band[0] <= frequency <= band[1]:
                break
            point = placing.solve(frequency, start)
            if point is None:
                start = None
                continue
            points[frequency], start = point, with_harmonics(point.amplitudes, max(_ROUGH, point.count // 2))
            height = _height(condensed, point)
            highest = max(highest, height)
            if height < _RIVAL * highest:
                break
    return points


def check_band(model: BeamModel, band: tuple[float, float]) -> tuple[float, float]:
    """The band, when it is one.

    Raises
    ------
    InputError : it is empty, or not above 0 Hz.
    """
    if len(band) != 2 or not all(map(is_number, band)) or not 0 < band[0] < band[1]:
        got = f"{band[0]} to {band[1]} Hz" if len(band) == 2 else repr(band)
        raise InputError("not a band", where=model.name, got=got, expected="0 < low < high")
    return band


def check_levels(model: BeamModel, **counts: int) -> None:
    """Refuse empty lists of levels.

    Raises
    ------
    InputError : as said.
    """
    for name, count in counts.items():
        if not count:
            raise InputError("an empty list", where=model.name, got=f"{name} = []", expected="one level or more, in N")


def _peak(
    condensed: Condensed, band: tuple[float, float], coarse: int, around: tuple[float, float] | None = None
) -> tuple[float, _Point]:
    """Frequency in Hz and solution of the largest response.

    Places come from few harmonics on a grid that is finer near the top, then each peak is sought by itself.
    ``around``: frequencies between which it is expected; where the largest one there is at an end, all are looked at.
    """
    grid = _grid(condensed, band, coarse)
    part = grid if around is None else grid[slice(*_within(grid, around))]
    points = _scanned(condensed, part, _ROUGH, {})
    if len(part) < len(grid) and (not points or _highest(condensed, points) in (part[0], part[-1])):
        points = _scanned(condensed, grid, _ROUGH, points)
    heights = _heights(condensed, points)
    points |= _scanned(condensed, _near_the_top(heights, grid), _FINER, points)
    expected = _vertex_heights(_heights(condensed, points))
    places, top = sorted(points), max(_heights(condensed, points).values(), default=0.0)
    summits = [n for n, f in enumerate(places) if expected.get(f, 0.0) >= _RIVAL * top]
    best: tuple[float, _Point] | None = None
    highest = 0.0
    for n in sorted(summits, key=lambda n: -expected[places[n]])[:_MOST_SUMMITS]:
        near = {f: points[f] for f in places[max(n - 1, 0) : n + 2]}
        found = _summit(condensed, near, highest)
        if found is not None and _height(condensed, found[1]) > highest:
            best, highest = found, _height(condensed, found[1])
    if best is None:
        raise InputError(
            "no steady state in the band",
            where=condensed.problem.system.name,
            got=f"{band} Hz",
            advice="use the time solver",
        )
    return best


def _grid(condensed: Condensed, band: tuple[float, float], coarse: int) -> Float[np.ndarray, "place"]:
    """Frequencies evenly over the band, and natural ones, between which narrow peaks would not be seen."""
    natural = condensed.problem.natural_frequencies * (1 + _ASIDE)
    inside = natural[(natural > band[0]) & (natural < band[1])]
    return np.unique(np.concatenate([np.geomspace(*band, coarse), inside]))


def _vertex_heights(heights: dict[float, float]) -> dict[float, float]:
    """Heights of the peaks about points that are higher than both neighbours, by the parabola through 1/h^2."""
    places, expected = sorted(heights), {}
    for n, f in enumerate(places):
        near = places[max(n - 1, 0) : n + 2]
        if heights[f] < max(heights[g] for g in near):
            continue
        expected[f] = heights[f]
        if len(near) == 3:
            inverse = [1 / max(heights[g], 1e-300) ** 2 for g in near]
            vertex, width = _parabola(*near, *inverse)
            share = width**2 / (width**2 + (f - vertex) ** 2) if np.isfinite(width) else 1.0
            expected[f] = heights[f] / np.sqrt(share) if share > 0 else np.inf
    return expected


def _within(grid: np.ndarray, around: tuple[float, float]) -> tuple[int, int]:
    """Where in a grid a stretch begins, and ends, that holds ``around``."""
    return max(int(np.searchsorted(grid, around[0])) - 1, 0), int(np.searchsorted(grid, around[1])) + 1


def _near_the_top(heights: dict[float, float], grid: np.ndarray) -> np.ndarray:
    """Frequencies half as far apart as those of the grid, wherever it comes near the top."""
    top = max(heights.values(), default=0.0)
    high = [n for n, f in enumerate(grid) if heights.get(float(f), 0.0) >= _NEAR_TOP * max(top, 1e-300)]
    wanted = sorted({m for n in high for m in range(2 * n - 2, 2 * n + 3) if 0 <= m <= 2 * len(grid) - 2})
    return np.array([np.sqrt(grid[m // 2] * grid[(m + 1) // 2]) for m in wanted])


def _scanned(condensed: Condensed, grid: np.ndarray, count: int, known: dict[float, _Point]) -> dict[float, _Point]:
    """Solutions with ``count`` harmonics along a grid of frequencies, where there are any.

    They start from the higher one of the two nearest that are ``known``, or else from those before. From where the
    contacts move by more than ``_RISE`` more than one step below, the way back is tried: the curve may fold, and the
    motion have jumped there to a branch that goes on downward.
    """
    branch, points = Branch(condensed.tolerance), {}
    for frequency in map(float, grid):
        start = _higher_beside(condensed, known, frequency) if known else branch.start(frequency)
        point = condensed.rough(frequency, start, count)
        branch.add(point)
        if point is not None:
            points[frequency] = point
    for above, below in pairwise(sorted(points, reverse=True)):
        if _moved(points[above]) > (1 + _RISE) * _moved(points[below]):
            back = condensed.rough(below, points[above].amplitudes, count)
            if back is not None and _height(condensed, back) > _height(condensed, points[below]):
                points[below] = back
    return points


def _moved(point: _Point) -> float:
    """Size of the motion of the contacts in m."""
    return float(np.linalg.norm(point.amplitudes))


def _higher_beside(condensed: Condensed, known: dict[float, _Point], frequency: float) -> np.ndarray:
    """Amplitudes of the higher one of the two solutions nearest to a frequency: beyond a fold the lower one leads away
    from the branch of the peak, and Newton's method comes down from a higher one where there is no fold."""
    beside = sorted(known, key=lambda f: abs(np.log(f / frequency)))[:2]
    return known[max(beside, key=lambda f: _height(condensed, known[f]))].amplitudes


def _heights(condensed: Condensed, points: dict[float, _Point]) -> dict[float, float]:
    return {frequency: _height(condensed, point) for frequency, point in points.items()}


def _summit(condensed: Condensed, near: dict[float, _Point], least: float) -> tuple[float, _Point] | None:
    """The peak between neighbouring frequencies: its place with fewer harmonics than its height.

    An error e of the whole curve moves a peak of damping ratio zeta by about e zeta, which lowers it by e^2. So it is
    placed with harmonics enough for a larger error, unless these turn out to be too few. ``None`` where there is no
    solution, or where it stays below ``least``.
    """
    limits, placing = (min(near), max(near)), _PLACING * condensed.tolerance
    near = _climbed(condensed, near, sorted(near), limits, {}, _FINER, 10 * _CLOSEST)
    best = _highest(condensed, near)
    point = condensed.with_tolerance(placing).solve(best, near[best].amplitudes)
    count = 0 if point is None else point.count
    while point is not None:
        around = sorted({float(np.clip(best * (1 + step), *limits)) for step in (-_APART, 0, _APART)})
        known = {best: point} if point.count == count else {}
        near = _climbed(condensed, known, around, limits, {**near, best: point}, count)
        if not near:
            return None
        best = _highest(condensed, near)
        placed = _height(condensed, near[best])
        if placed < (1 - placing) * least:
            return None
        if near[best] is not point or point.error > condensed.tolerance:
            point = condensed.solve(best, near[best].amplitudes)
        if point is None or abs(placed / _height(condensed, point) - 1) <= 0.5 * placing:
            break
        if count == point.count:
            break
        count = min(2 * count, point.count)
    return None if point is None else (best, point)


def _highest(condensed: Condensed, points: dict[float, _Point]) -> float:
    return max(points, key=lambda f: _height(condensed, points[f]))


def _height(condensed: Condensed, point: _Point) -> float:
    if point.height[0] != condensed.force:
        point.height = condensed.force, float(np.abs(condensed.first(point)[0]))
    return point.height[1]


def _climbed(
    condensed: Condensed,
    known: dict[float, _Point],
    around: list[float],
    limits: tuple[float, float],
    hints: dict[float, _Point],
    count: int,
    closest: float = _CLOSEST,
) -> dict[float, _Point]:
    """Solutions with ``count`` harmonics up to the peak, by parabolas through 1/height^2, nearly one there.

    ``known`` are those made before, ``around`` the frequencies to begin with; each solution starts from one
    beside it, be it one of the ``hints``, which have other numbers of harmonics. ``closest``: steps that matter,
    relative.
    """
    points, heights = dict(known), {f: _height(condensed, point) for f, point in known.items()}

    def look(frequency: float) -> None:
        """Solve there, unless it is known."""
        if frequency in points:
            return
        point = condensed.rough(frequency, _higher_beside(condensed, {**hints, **points}, frequency), count)
        if point is not None:
            points[frequency], heights[frequency] = point, _height(condensed, point)

    middle = around[len(around) // 2]
    for frequency in sorted(around, key=lambda f: abs(f - middle)):
        look(frequency)
    for _ in range(25):
        places = sorted(points)
        if len(places) < 2:
            break
        best = max(places, key=heights.__getitem__)
        guess = _next(places, heights, best, limits, closest * best)
        if guess is None:
            break
        look(guess)
    return points


def _next(
    places: list[float], heights: dict[float, float], best: float, limits: tuple[float, float], closest: float
) -> float | None:
    """Where to look for the peak next; ``None`` when it is found, or beyond the ``limits``.

    It is found within ``closest`` Hz, or within ``_OF_WIDTH`` of half its width between the half-power points, where
    that is less.
    """
    index = places.index(best)
    if index in (0, len(places) - 1):
        beyond = best + (best - places[1 if index == 0 else -2])
        return beyond if limits[0] <= beyond <= limits[1] else None
    low, high = places[index - 1], places[index + 1]
    inverse = [1 / heights[f] ** 2 for f in (low, best, high)]
    guess, width = _parabola(low, best, high, *inverse)
    (sharp, _), (steep, beyond) = sorted(((inverse[0] / inverse[1] - 1, low), (inverse[2] / inverse[1] - 1, high)))
    if sharp < _FLAT and steep > _DROP and abs(beyond - best) > closest:
        return 0.5 * (best + beyond)  # a peak at a fold is no vertex
    closest = min(closest, max(_OF_WIDTH * width, _ROUNDING * best))
    if high - low < 4 * closest or (abs(guess - best) < 2 * closest and sharp < _FLAT):
        return None
    if abs(guess - best) < closest:
        guess = best + np.copysign(max(closest, 0.1 * max(high - best, best - low)), (high - best) - (best - low))
    return float(np.clip(guess, low + 0.05 * (high - low), high - 0.05 * (high - low)))


def _parabola(a: float, b: float, c: float, fa: float, fb: float, fc: float) -> tuple[float, float]:
    """Abscissa of the vertex through three points, and how far from it the parabola is twice as high.

    The middle point and infinity where they are in line or bent the other way.
    """
    bend = ((fc - fb) / (c - b) - (fb - fa) / (b - a)) / (c - a)
    if not bend > 0:
        return b, np.inf
    vertex = 0.5 * (a + b) - 0.5 * (fb - fa) / (b - a) / bend
    return vertex, float(np.sqrt(max(fb / bend - (b - vertex) ** 2, 0.0)))


def _resonance(condensed: Condensed, frequency: float, point: _Point) -> Resonance:
    omega = 2 * np.pi * frequency
    q = condensed.modal(point)[0 if condensed.odd else 1]
    kinetic = 0.5 * omega**2 * float(np.sum(np.abs(q) ** 2))
    _, friction, damping = condensed.powers(point)
    lost = (friction + damping) * 2 * np.pi / omega
    amplitude = complex(condensed.first(point)[0])
    return Resonance(
        frequency,
        amplitude,
        lost / (4 * np.pi * kinetic),
        float(np.sqrt(np.sum(np.abs(q) ** 2))),
        max(point.error, 2 * _OF_WIDTH**2),
    )


def resonances(
    model: BeamModel,
    forces: Sequence[float] | Float[np.ndarray, "level"],
    at: Dof | str,
    output: Dof | str,
    band: tuple[float, float],
    tolerance: float = 5e-3,
    progress: Progress = silent,
) -> tuple[Resonance, ...]:
    """Find the resonance at every force level: how frequency and damping depend on amplitude.

    Parameters
    ----------
    model : BeamModel
        The model.
    forces : sequence of float or array of shape (level,)
        Amplitudes of the force [N].
    at : Dof or str
        DOF of the force.
    output : Dof or str
        DOF of the response.
    band : tuple of (float, float)
        Band [Hz].
    tolerance : float, default 0.005
        Relative error that is aimed at.
    progress : Progress, optional
        Called after each level.

    Returns
    -------
    tuple of Resonance
        The largest response of the band at each level. Where no peak is in the band, that is one of its ends.

    Raises
    ------
    InputError
        If the band is empty, or there is no force or one that is not positive.

    Examples
    --------
    >>> from ema.data import Damping
    >>> from ema.simulate import Masing, Section, double_beam
    >>> section = Section(0.5, 0.04, 0.005, elements=2)
    >>> model = double_beam(Masing(0.3, 1e9), 1000.0, section, damping=Damping(ratio=0.003))
    >>> len(resonances(model, [1e-3, 2e-3], at="beam 2:2:+Z", output="beam 2:2:+Z", band=(28.0, 36.0)))
    2
    """
    check_levels(model, forces=len(forces))
    result: list[Resonance] = []
    condensed: Condensed | None = None
    for number, force in enumerate(forces):
        advance(progress, "resonances", number, len(forces))
        positive(model.name, force=float(force))
        condensed = condensed or condense(model, float(force), at, [output], tolerance)
        here = condensed.at(float(force), condensed.limits)
        result.append(_resonance(here, *_peak(here, check_band(model, band), _FIRST_PASS)))
    return tuple(result)


def homogeneous(model: BeamModel) -> bool:
    """Whether x(c F_E, c F_N) = c x(F_E, F_N): constant k_T and no velocity scale in any law."""
    return all(
        joint.law.stiffness_exponent == 0
        and joint.normal_exponent == 0
        and joint.law.name in HOMOGENEOUS
        and joint.normal_contact == NormalContact()
        for joint in model.joints
    )


def damping_map(
    model: BeamModel,
    force_levels: Sequence[float] | Float[np.ndarray, "level"],
    normal_forces: Sequence[float] | Float[np.ndarray, "normal"],
    at: Dof | str,
    output: Dof | str,
    band: tuple[float, float],
    tolerance: float = 1e-2,
    progress: Progress = silent,
) -> ModalMap:
    """Compute resonance frequency and equivalent damping over (F_E, F_N).

    Where the model is homogeneous the map is one curve over F_N/F_E, else one over F_E at each F_N. A curve is computed
    at as many points as it takes to interpolate between them within a fifth of ``tolerance`` in frequency, half of it
    in amplitude and all of it in damping. Peaks that are computed state an error: the largest one is among the options
    of the provenance, and a finding where it exceeds ``tolerance``.

    Parameters
    ----------
    model : BeamModel
        The model.
    force_levels : sequence of float or array of shape (level,)
        F_E [N].
    normal_forces : sequence of float or array of shape (normal,)
        F_N of every joint [N].
    at : Dof or str
        DOF of the force.
    output : Dof or str
        DOF of the response.
    band : tuple of (float, float)
        Band [Hz] in which the resonance is searched.
    tolerance : float, default 0.01
        Relative error that is aimed at.
    progress : Progress, optional
        Called after each point.

    Returns
    -------
    ModalMap
        A map of the method ``frozen``; NaN where no resonance is in the band.

    Raises
    ------
    InputError
        If the band or a list is empty, a force is not positive, or no resonance is in the band at any point.

    Examples
    --------
    >>> from ema.data import Damping
    >>> from ema.simulate import Masing, Section, double_beam
    >>> section = Section(0.5, 0.04, 0.005, elements=2)
    >>> model = double_beam(Masing(0.3, 1e9), 1000.0, section, damping=Damping(ratio=0.003))
    >>> tip = "beam 2:2:+Z"
    >>> result = damping_map(model, [0.1], [1e5], tip, tip, band=(28.0, 36.0))  # sticks: background damping alone
    >>> result.method, result.damping.shape
    ('frozen', (1, 1))
    """
    levels, normals = np.asarray(force_levels, dtype=float), np.asarray(normal_forces, dtype=float)
    check_levels(model, force_levels=len(levels), normal_forces=len(normals))
    for level in levels:
        positive(model.name, force=float(level))
    if not (np.all(np.isfinite(normals)) and np.all(normals >= 0)):
        raise InputError("not a normal force", where=model.name, got=f"{normals.tolist()} N", expected="0 N or more")
    check_band(model, band)

    def prepared(normal: float, level: float) -> Condensed:
        """The model under a normal force on every joint."""
        condensed = condense(model.with_normal_force(normal), level, at, [output], tolerance)
        condensed.most_orders = _MOST_ORDERS
        return condensed

    over = _over_ratio if homogeneous(model) else _over_levels
    table, error = over(prepared, levels, normals, band, tolerance, progress)
    findings = []
    if error > tolerance:
        findings.append(
            Finding.of(
                "warning",
                "harmonics",
                model.name,
                "error estimate of a peak {error}.",
                error,
                tolerance,
                advice="Check it in time.",
                error=f"{error:.1e}",
            )
        )
    shape = table.shape[1:]
    cut = ~within_band(table[0].ravel(), band).reshape(shape)
    if cut.all():
        raise _no_resonance(model, band, "the largest response at its ends everywhere")
    if cut.any():
        table[:, cut] = np.nan
        findings.append(no_resonance(model.name or "model", int(cut.sum()), cut.size, band))
    joints = np.broadcast_to(normals[None, :, None], (*shape, len(model.joints)))
    return ModalMap(
        levels,
        normals,
        table[0],
        table[1],
        force_at_resonance=np.broadcast_to(levels[:, None], shape),
        modal_amplitude=table[2],
        joint_forces=joints,
        joints=tuple(joint.name for joint in model.joints),
        method="frozen",
        name=model.name,
        provenance=Provenance(
            options=(
                ("tolerance", str(tolerance)),
                ("homogeneity", str(homogeneous(model))),
                ("largest error estimate of a peak", f"{error:.2g}"),
            ),
            steps=("damping_map",),
        ),
        findings=tuple(findings),
    )


def _over_ratio(
    prepared: Callable[[float, float], Condensed],
    levels: Float[np.ndarray, "level"],
    normals: Float[np.ndarray, "normal"],
    band: tuple[float, float],
    tolerance: float,
    progress: Progress,
) -> tuple[Float[np.ndarray, "3 level normal"], float]:
    """Frequency, damping ratio and modal amplitude of a homogeneous model, a curve over F_N/F_E; the largest error."""
    condensed = prepared(1.0, 1.0)
    curve = _Curve(lambda ratio: condensed.at(1.0, condensed.limits * ratio), band)
    ratios = normals / levels[:, None]
    keys = np.array([float(f"{ratio:.9g}") for ratio in ratios.ravel()])
    wanted, back = np.unique(keys, return_inverse=True)
    table = interpolated(wanted, curve.at, tolerance * _SHARES, progress)[back].T.reshape(3, *ratios.shape).copy()
    table[2] *= levels[:, None]
    return table, curve.error


def _over_levels(
    prepared: Callable[[float, float], Condensed],
    levels: Float[np.ndarray, "level"],
    normals: Float[np.ndarray, "normal"],
    band: tuple[float, float],
    tolerance: float,
    progress: Progress,
) -> tuple[Float[np.ndarray, "3 level normal"], float]:
    """The same of any model: a curve over F_E at each F_N."""
    table, error = np.empty((3, len(levels), len(normals))), 0.0
    wanted, back = np.unique(levels, return_inverse=True)
    for column, normal in enumerate(normals):
        advance(progress, "damping map", column, len(normals))
        here = prepared(float(normal), float(levels[0]))
        curve = _Curve(partial(here.at, limits=here.limits), band)
        table[:, :, column] = interpolated(wanted, curve.at, tolerance * _SHARES, first=_FIRST_LEVELS)[back].T
        error = max(error, curve.error)
    return table, error


@dataclass
class _Curve:
    """Resonances along a curve of a map: between two that are known, the next one is sought near them first."""

    system: Callable[[float], Condensed]
    band: tuple[float, float]
    known: dict[float, Resonance] = field(default_factory=dict)

    @property
    def error(self) -> float:
        """The largest error estimate of its peaks."""
        return max(found.error_estimate for found in self.known.values())

    def at(self, place: float) -> Float[np.ndarray, "3"]:
        """Frequency, damping ratio and modal amplitude at a place of the curve."""
        below, above = [p for p in self.known if p < place], [p for p in self.known if p > place]
        around = None
        if below and above:
            sides = self.known[max(below)].frequency, self.known[min(above)].frequency
            around = min(sides) / _BESIDE, max(sides) * _BESIDE
        condensed = self.system(place)
        found = self.known[place] = _resonance(condensed, *_peak(condensed, self.band, _COARSE, around))
        return np.array([found.frequency, found.damping, found.modal_amplitude])


def interpolated(
    wanted: Float[np.ndarray, "place"],
    compute: Callable[[float], np.ndarray],
    tolerance: Float[np.ndarray, "number"],
    progress: Progress = silent,
    first: int = _FIRST,
) -> Float[np.ndarray, "place number"]:
    """Positive numbers at ascending places of 0 or more, computed at some and interpolated at the others.

    ``first`` places are computed whatever the tolerance. A stretch is interpolated when the place in its middle was
    predicted within the relative ``tolerance``; else that place is kept and both halves are looked at.
    """
    from scipy.interpolate import PchipInterpolator

    count = len(wanted)
    steps = min(count, first)
    chosen = np.unique(np.round(np.linspace(0, count - 1, steps)).astype(int))
    known = {int(n): compute(float(wanted[n])) for n in chosen}
    axis = np.log(np.maximum(wanted, 1e-12))
    stretches = [(int(a), int(b)) for a, b in pairwise(chosen) if b - a > 1]
    while stretches:
        advance(progress, "damping map", len(known), count)
        places = sorted(known)
        curve = PchipInterpolator(axis[places], np.log([known[n] for n in places])) if len(places) > 2 else None
        nexts: list[tuple[int, int]] = []
        for low, high in stretches:
            middle = int(np.argmin(np.abs(axis[low + 1 : high] - (axis[low] + axis[high]) / 2))) + low + 1
            known[middle] = compute(float(wanted[middle]))
            predicted = np.full(len(tolerance), np.inf) if curve is None else np.exp(curve(axis[middle]))
            if np.any(np.abs(predicted / known[middle] - 1) > tolerance):
                nexts += [(a, b) for a, b in ((low, middle), (middle, high)) if b - a > 1]
        stretches = nexts
    places = sorted(known)
    if len(places) == count:
        return np.array([known[n] for n in places])
    result = np.exp(PchipInterpolator(axis[places], np.log([known[n] for n in places]))(axis))
    result[places] = [known[n] for n in places]
    return np.asarray(result)
