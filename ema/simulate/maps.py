"""Resonances over force level and normal force: backbone and damping map, from harmonic balance alone."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from ema.data import BeamModel, ModalMap, NormalContact, Provenance
from ema.dof import Dof
from ema.errors import InputError
from ema.progress import Progress, advance, silent
from ema.simulate.harmonic import Branch, Condensed, _Point, check_positive, condense

HOMOGENEOUS = ("masing", "parallel masing", "iwan", "regularised masing", "dahl", "coulomb")
_ROUGH, _COARSE, _RIVAL, _MOST_SUMMITS, _FLAT, _FIRST = 3, 30, 0.8, 2, 0.02, 24
_APART = 2e-3
"""Distance of frequencies around a summit that is known from fewer harmonics, relative."""


@dataclass(frozen=True)
class Resonance:
    """The largest response in a band: frequency Hz, complex amplitude of the response in m, equivalent damping ratio.

    ``damping`` is the energy lost per cycle over 4 pi times the largest kinetic energy of the first harmonic;
    ``modal_amplitude`` is mass-normalised, m sqrt(kg); ``error_estimate`` that of the amplitude, relative.
    """

    frequency: float
    amplitude: complex
    damping: float
    modal_amplitude: float
    error_estimate: float


def resonance(
    model: BeamModel, force: float, at: Dof | str, output: Dof | str, band: tuple[float, float],
    tolerance: float = 5e-3, modes: int | None = None, coarse: int = 40,
) -> Resonance:  # fmt: skip
    """Frequency and height of the largest response of ``output`` in a band at one force level.

    Parameters
    ----------
    force : amplitude in N at DOF ``at``; ``band`` in Hz.
    coarse : number of frequencies of the first pass, which uses few harmonics; the summits are then refined with as
        many as it takes, to 1e-4 of their frequency.

    Raises
    ------
    InputError : the band is empty, nothing was found in it.
    """
    return _peak(condense(model, force, at, [output], tolerance, modes), check_band(model, band), coarse)


def check_band(model: BeamModel, band: tuple[float, float]) -> tuple[float, float]:
    """The band, when it is one.

    Raises
    ------
    InputError : it is empty, or not above 0 Hz.
    """
    if not 0 < band[0] < band[1]:
        raise InputError("not a band", where=model.name, got=f"{band[0]} to {band[1]} Hz", expected="0 < low < high")
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


def _peak(condensed: Condensed, band: tuple[float, float], coarse: int) -> Resonance:
    """The largest response: places from few harmonics on a coarse grid, then each summit with all it needs."""
    rows = np.array([condensed.problem.base.row(condensed.problem.system, condensed.problem.outputs[0])])
    grid = np.geomspace(*band, coarse)
    branch = Branch(condensed.tolerance)
    rough: list[_Point | None] = []
    for frequency in grid:
        point = condensed.rough(float(frequency), branch.start(float(frequency)), _ROUGH)
        branch.add(point)
        rough.append(point)
    heights = np.array([-np.inf if p is None else abs(condensed.outputs(p, rows)[0, 0]) for p in rough])
    if not np.isfinite(heights).any():
        raise InputError("no steady state in the band", where=condensed.problem.system.name, got=f"{band} Hz",
                         advice="use the time solver")  # fmt: skip
    beside = np.maximum(np.append(heights[1:], -np.inf), np.append(-np.inf, heights[:-1]))
    summits = np.flatnonzero((heights >= beside) & (heights >= _RIVAL * heights.max()))
    best: Resonance | None = None
    for place in summits[np.argsort(-heights[summits])][:_MOST_SUMMITS]:
        near = [int(np.clip(place + step, 0, coarse - 1)) for step in (-1, 0, 1)]
        found = _summit(condensed, rows, [float(grid[n]) for n in sorted(set(near))], rough[place])
        if found is not None and (best is None or abs(found.amplitude) > abs(best.amplitude)):
            best = found
    if best is None:
        raise InputError("no steady state in the band", where=condensed.problem.system.name, got=f"{band} Hz",
                         advice="use the time solver")  # fmt: skip
    return best


def _summit(condensed: Condensed, rows: np.ndarray, around: list[float], first: _Point | None) -> Resonance | None:
    """The summit between neighbouring frequencies: found with a third of its harmonics, then with all."""
    middle, limits = around[len(around) // 2], (around[0], around[-1])
    start, settled = None if first is None else first.amplitudes, None
    for frequency in sorted(around, key=lambda f: abs(f - middle)):
        settled = condensed.solve(frequency, start)
        if settled is not None:
            break
    if settled is None:
        return None
    known, fewer = {frequency: settled}, {}
    if settled.count // 3 >= _ROUGH:
        fewer = _climbed(condensed, rows, {}, around, limits, {frequency: settled}, settled.count // 3)
        if fewer:
            best = max(fewer, key=lambda f: _height(condensed, rows, fewer[f]))
            around = [float(np.clip(best * (1 + step), *limits)) for step in (-_APART, 0, _APART)]
    found = _climbed(condensed, rows, known, sorted(set(around)), limits, {**fewer, **known}, settled.count)
    best = max(found, key=lambda f: _height(condensed, rows, found[f]))
    point = found[best]
    if np.isnan(point.error):
        point.error = condensed.judged(point)
        if point.error > condensed.tolerance and point.count < condensed.most_orders:
            point = condensed.solve(best, point.amplitudes) or point
    return _resonance(condensed, best, point, rows)


def _height(condensed: Condensed, rows: np.ndarray, point: _Point) -> float:
    return float(np.abs(condensed.outputs(point, rows)[0, 0]))


def _climbed(
    condensed: Condensed, rows: np.ndarray, known: dict[float, _Point], around: list[float],
    limits: tuple[float, float], hints: dict[float, _Point], count: int,
) -> dict[float, _Point]:  # fmt: skip
    """Solutions with ``count`` harmonics up to the summit, by parabolas through 1/height^2, nearly one there.

    ``known`` are those made before, ``around`` the frequencies to begin with; each solution starts from the nearest
    one, be it one of the ``hints``, which have other numbers of harmonics.
    """
    points, heights = dict(known), {f: _height(condensed, rows, point) for f, point in known.items()}

    def look(frequency: float) -> None:
        if frequency in points:
            return
        starts = {**hints, **points}
        start = starts[min(starts, key=lambda f: abs(f - frequency))].amplitudes
        point = condensed.rough(frequency, start, count)
        if point is not None:
            points[frequency], heights[frequency] = point, _height(condensed, rows, point)

    middle = around[len(around) // 2]
    for frequency in sorted(around, key=lambda f: abs(f - middle)):
        look(frequency)
    for _ in range(25):
        places = sorted(points)
        if len(places) < 2:
            break
        best = max(places, key=heights.__getitem__)
        guess = _next(places, heights, best, limits)
        if guess is None:
            break
        look(guess)
    return points


def _next(places: list[float], heights: dict[float, float], best: float, limits: tuple[float, float]) -> float | None:
    """Where to look for the summit next; ``None`` when it is found, or beyond the ``limits``."""
    index = places.index(best)
    if index in (0, len(places) - 1):
        beyond = best + (best - places[1 if index == 0 else -2])
        return beyond if limits[0] <= beyond <= limits[1] else None
    low, high = places[index - 1], places[index + 1]
    inverse = [1 / heights[f] ** 2 for f in (low, best, high)]
    guess = _parabola(low, best, high, *inverse)
    closest = 5e-5 * best
    sharp = min(inverse[0], inverse[2]) / inverse[1] - 1
    if high - low < 4 * closest or (abs(guess - best) < 2 * closest and sharp < _FLAT):
        return None
    if abs(guess - best) < closest:
        guess = best + np.copysign(max(closest, 0.1 * max(high - best, best - low)), (high - best) - (best - low))
    return float(np.clip(guess, low + 0.05 * (high - low), high - 0.05 * (high - low)))


def _parabola(a: float, b: float, c: float, fa: float, fb: float, fc: float) -> float:
    """Abscissa of the vertex through three points; the middle one where they are in line."""
    top = (b - a) ** 2 * (fb - fc) - (b - c) ** 2 * (fb - fa)
    bottom = (b - a) * (fb - fc) - (b - c) * (fb - fa)
    return b - 0.5 * top / bottom if bottom != 0 else b


def _resonance(condensed: Condensed, frequency: float, point: _Point, rows: np.ndarray) -> Resonance:
    omega = 2 * np.pi * frequency
    q = condensed.modal(point)[0]
    kinetic = 0.5 * omega**2 * float(np.sum(np.abs(q) ** 2))
    _, friction, damping = condensed.powers(point)
    lost = (friction + damping) * 2 * np.pi / omega
    amplitude = complex((rows @ q)[0])
    return Resonance(
        frequency, amplitude, lost / (4 * np.pi * kinetic), float(np.sqrt(np.sum(np.abs(q) ** 2))), point.error
    )


def backbone(
    model: BeamModel, forces: Sequence[float] | Float[np.ndarray, "level"], at: Dof | str, output: Dof | str,
    band: tuple[float, float],
    tolerance: float = 5e-3, modes: int | None = None, progress: Progress = silent,
) -> tuple[Resonance, ...]:  # fmt: skip
    """Resonance at every force level of ``forces`` (N): how frequency and damping depend on amplitude.

    Raises
    ------
    InputError : the band is empty, there is no force or one that is not positive.
    """
    check_levels(model, forces=len(forces))
    result: list[Resonance] = []
    condensed: Condensed | None = None
    for number, force in enumerate(forces):
        advance(progress, "backbone", number, len(forces))
        check_positive(model.name, "force", float(force))
        condensed = condensed or condense(model, float(force), at, [output], tolerance, modes)
        result.append(_peak(condensed.at(float(force), condensed.limits), check_band(model, band), 40))
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
    model: BeamModel, force_levels: Sequence[float] | Float[np.ndarray, "level"],
    normal_forces: Sequence[float] | Float[np.ndarray, "normal"], at: Dof | str, output: Dof | str,
    band: tuple[float, float], tolerance: float = 5e-3, modes: int | None = None, progress: Progress = silent,
) -> ModalMap:  # fmt: skip
    """Resonance frequency and equivalent damping over (F_E, F_N): ``ModalMap`` of the kind ``frozen``.

    ``normal_forces`` N are given to every joint. Where the model is homogeneous the map is one curve over F_N/F_E: it
    is computed at as many ratios as it takes to interpolate between them within 0.4 ``tolerance`` in frequency,
    ``tolerance`` in amplitude and twice that in damping.

    Raises
    ------
    InputError : the band is empty, a list is empty, a force is not positive, nothing was found.
    """
    levels, normals = np.asarray(force_levels, dtype=float), np.asarray(normal_forces, dtype=float)
    check_levels(model, force_levels=len(levels), normal_forces=len(normals))
    for level in levels:
        check_positive(model.name, "force", float(level))
    if not (np.all(np.isfinite(normals)) and np.all(normals >= 0)):
        raise InputError("not a normal force", where=model.name, got=f"{normals.tolist()} N", expected="0 N or more")
    check_band(model, band)
    if homogeneous(model):
        table = _map_of_one_curve(model, levels, normals, at, output, band, tolerance, modes, progress)
    else:
        table = np.empty((3, len(levels), len(normals)))
        for column, normal in enumerate(normals):
            condensed = condense(model.with_normal_force(normal), float(levels[0]), at, [output], tolerance, modes)
            for row, level in enumerate(levels):
                advance(progress, "damping map", column * len(levels) + row, len(levels) * len(normals))
                point = _peak(condensed.at(float(level), condensed.limits), band, _COARSE)
                table[:, row, column] = point.frequency, point.damping, point.modal_amplitude
    shape = table.shape[1:]
    joints = np.broadcast_to(normals[None, :, None], (*shape, len(model.joints)))
    return ModalMap(
        levels, normals, table[0], table[1], force_at_resonance=np.broadcast_to(levels[:, None], shape),
        modal_amplitude=table[2], joint_forces=joints, joints=tuple(joint.name for joint in model.joints),
        method="frozen", name=model.name,
        provenance=Provenance(
            options=(("tolerance", str(tolerance)), ("homogeneity", str(homogeneous(model)))), steps=("damping_map",)
        ),
    )  # fmt: skip


def _map_of_one_curve(
    model: BeamModel, levels: np.ndarray, normals: np.ndarray, at: Dof | str, output: Dof | str,
    band: tuple[float, float], tolerance: float, modes: int | None, progress: Progress,
) -> Float[np.ndarray, "3 level normal"]:  # fmt: skip
    """Frequency, damping and modal amplitude over (F_E, F_N) from their curve over F_N/F_E."""
    condensed = condense(model.with_normal_force(1.0), 1.0, at, [output], tolerance, modes)
    ratios = normals / levels[:, None]
    keys = np.array([float(f"{ratio:.9g}") for ratio in ratios.ravel()])
    wanted, back = np.unique(keys, return_inverse=True)

    def compute(ratio: float) -> np.ndarray:
        point = _peak(condensed.at(1.0, condensed.limits * ratio), band, _COARSE)
        return np.array([point.frequency, point.damping, point.modal_amplitude])

    curve = interpolated(wanted, compute, np.array([0.4, 2.0, 1.0]) * tolerance, progress)
    table = curve[back].T.reshape(3, *ratios.shape).copy()
    table[2] *= levels[:, None]
    return table


def interpolated(
    wanted: Float[np.ndarray, "place"], compute: Callable[[float], np.ndarray],
    tolerance: Float[np.ndarray, "number"], progress: Progress = silent,
) -> Float[np.ndarray, "place number"]:  # fmt: skip
    """Positive numbers at ascending places of 0 or more, computed at some and interpolated at the others.

    A stretch is interpolated when the place in its middle was predicted within the relative ``tolerance``; else that
    place is kept and both halves are looked at.
    """
    from scipy.interpolate import PchipInterpolator

    count = len(wanted)
    steps = min(count, _FIRST)
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


def damping_rule(slip_stiffness: float, slip_shape: float, frequency: float) -> float:
    """Largest damping that a Masing contact adds to a mode, kappa / (2 pi (1 + kappa/2)), kappa = k psi^2 / w^2.

    ``slip_stiffness`` k N/m (contact and beam in series), ``slip_shape`` psi the mass-normalised modal relative
    displacement, ``frequency`` Hz of the mode. Power balance at the amplitude 2 F_C/k, Masing's describing function.
    """
    kappa = slip_stiffness * slip_shape**2 / (2 * np.pi * frequency) ** 2
    return float(kappa / (2 * np.pi * (1 + kappa / 2)))


def slip_force_rule(added: float, total: float, force: float, shape_at_force: float, slip_shape: float) -> float:
    """Slip force mu F_N in N of most damping under a harmonic force: (pi/2) (dzeta/zeta) F_E phi_e/psi."""
    return float(np.pi / 2 * added / total * force * shape_at_force / slip_shape)


def placement_index(
    stuck: Float[np.ndarray, "place"], sliding: Float[np.ndarray, "place"]
) -> Float[np.ndarray, "place"]:
    """Linear estimate of the damping a joint can add, from the natural frequencies with it stuck and sliding (Hz)."""
    return (stuck**2 - sliding**2) / (np.pi * (stuck**2 + sliding**2))
