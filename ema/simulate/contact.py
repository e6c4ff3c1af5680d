"""Normal contact of the joints: its laws, and how a preload spreads over the node pairs.

The preload presses every pair from outside with its share of F_N, like a soft bolt. What the pairs then carry is the
state of rest: the structure bends a little, pairs may stay open, and supports may take a part of the force.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from ema.contact.rough import rough_normal_contact
from ema.data import BeamModel, ContactPressure, Finding, Joint, NormalContact
from ema.errors import FailureError, InputError
from ema.simulate.checks import positive

LINEAR = "linear"
_NAMES = (LINEAR, "power", "curve")
_LEAST_STIFFNESS = 0.02
"""Stiffness at rest that a normal contact counts with at least, over the largest: a safeguard for contacts that hardly
bear."""
_OPEN = 1e-9
"""Force over the largest, or over their sum, up to which a contact is open: rounding."""


def Unilateral() -> NormalContact:
    """Return the normal contact of a linear spring that carries no tension: the surfaces part.

    Returns
    -------
    NormalContact
        The normal contact.

    Examples
    --------
    >>> Unilateral().exponent
    1.0
    """
    return NormalContact("power")


def PowerContact(exponent: float, reference_force: float = 1000.0) -> NormalContact:
    """Return a normal contact by a power law without tension, N ~ penetration^exponent.

    A normal stiffness that grows with N^a belongs to the exponent 1 / (1 - a): 1.5 is Hertz's (a = 1/3), 2 has a = 0.5.

    Parameters
    ----------
    exponent : float
        Exponent, 1 or more.
    reference_force : float, default 1000.0
        Normal force [N] of the whole joint at which the joint's ``normal_stiffness`` is the slope.

    Returns
    -------
    NormalContact
        The normal contact.

    Raises
    ------
    InputError
        If the exponent is below 1, or the force is not positive.

    Examples
    --------
    >>> PowerContact(1.5).exponent
    1.5
    """
    contact = NormalContact("power", float(exponent), float(reference_force))
    check_normal_contact(contact, "normal contact")
    return contact


def ContactCurve(penetrations: Sequence[float], forces: Sequence[float]) -> NormalContact:
    """Return a normal contact by points of a curve.

    Parameters
    ----------
    penetrations : sequence of float
        Penetrations [m], ascending.
    forces : sequence of float
        Normal forces of the whole joint [N], ascending from 0.

    Returns
    -------
    NormalContact
        The normal contact.

    Raises
    ------
    InputError
        If there are fewer than two points, they do not ascend, or the first force is not 0.

    Examples
    --------
    >>> ContactCurve([0.0, 1e-6, 2e-6], [0.0, 100.0, 300.0]).name
    'curve'
    """
    if len(penetrations) != len(forces):
        raise InputError(
            "a curve needs pairs of numbers",
            where="normal contact",
            got=f"{len(penetrations)} and {len(forces)}",
            expected="equally many",
        )
    contact = NormalContact("curve", points=tuple((float(x), float(f)) for x, f in zip(penetrations, forces)))
    check_normal_contact(contact, "normal contact")
    return contact


def RoughNormalContact(
    summit_deviation: float, reference_force: float = 1000.0, separation: float | None = None
) -> NormalContact:
    """Return the normal contact of two rough surfaces, with the summits of :func:`ema.simulate.RoughContact`.

    With exponential heights k_N = F_N/s at any normal force. It parts at 1e-4 of the ``reference_force``, 9.2 s before
    that is reached: a structure that resists being pressed together so far takes its part of the preload. The joint's
    ``normal_stiffness`` is not used.

    Parameters
    ----------
    summit_deviation : float
        s, standard deviation of the heights of the summits of both surfaces [m].
    reference_force : float, default 1000.0
        Normal force [N] of the whole joint, about that of the preload: forces up to 100 times of it are followed;
        beyond them the stiffness stays.
    separation : float, optional
        With Gaussian heights: distance of their mean from the opposite plane at the ``reference_force``, over s, above
        0 up to 6. By default the heights are exponential.

    Returns
    -------
    NormalContact
        The normal contact, as a curve.

    Raises
    ------
    InputError
        If a number is outside these limits.

    References
    ----------
    .. [1] Greenwood and Williamson (1966), Contact of nominally flat surfaces, Proceedings of the Royal Society A
       295:300.

    Examples
    --------
    >>> contact = RoughNormalContact(1e-6)
    >>> depths, forces = np.array(contact.points).T
    >>> round(float(np.interp(1000.0, forces, np.gradient(forces, depths))) / 1e9, 2)  # F_N/s in N/nm
    1.0
    """
    where = "rough normal contact"
    positive(where, summit_deviation=summit_deviation, reference_force=reference_force)
    if separation is not None and not 0 < separation <= 6:
        raise InputError("not a separation", where=where, got=separation, expected="above 0 and up to 6")
    return rough_normal_contact(summit_deviation, reference_force, separation)


def own_contact(function: Callable[[float], float], deepest: float, points: int = 400) -> NormalContact:
    """Return a normal contact by a law of one's own.

    Parameters
    ----------
    function : callable
        Force of the whole joint [N] over the penetration [m].
    deepest : float
        Largest penetration [m].
    points : int, default 400
        Number of points at which the function is read, from 0 to ``deepest``, closer together near 0.

    Returns
    -------
    NormalContact
        The normal contact, as a curve.

    Raises
    ------
    InputError
        If the function does not rise from 0.

    Examples
    --------
    >>> rough = own_contact(lambda depth: 2e9 * depth + 1e15 * depth**2, deepest=1e-5)
    >>> len(rough.points)
    400
    """
    places = deepest * np.linspace(0, 1, points) ** 2
    return ContactCurve(places.tolist(), [float(function(float(place))) for place in places])


def check_normal_contact(contact: NormalContact, where: str) -> None:
    """Refuse a normal contact that is none.

    Raises
    ------
    InputError : as said.
    """
    if contact.name not in _NAMES:
        raise InputError(
            "unknown normal contact",
            where=where,
            got=contact.name,
            expected=", ".join(_NAMES),
            advice="a law of your own: ema.simulate.own_contact",
        )
    if contact.name == "power" and not (np.isfinite(contact.exponent) and contact.exponent >= 1):
        raise InputError(
            "not an exponent of the normal contact",
            where=where,
            got=contact.exponent,
            expected="1 (a spring) or more, e.g. 2",
        )
    if contact.name == "power" and not (np.isfinite(contact.reference_force) and contact.reference_force > 0):
        raise InputError("not a reference force", where=where, got=f"{contact.reference_force} N", expected="above 0 N")
    if contact.name == "curve":
        points = np.array(contact.points, dtype=np.float64).reshape(-1, 2)
        if len(points) < 2 or not np.all(np.isfinite(points)) or np.any(np.diff(points, axis=0) <= 0) or points[0, 1]:
            raise InputError(
                "not a curve of normal contact",
                where=where,
                got=f"{len(points)} points",
                expected="two or more, penetration and force ascending, the first force 0 N",
            )


@dataclass(frozen=True)
class NormalPairs:
    """The node pairs of all joints in the normal direction.

    ``rows`` (pair, n) give the opening of the gap; ``table`` (pair, 8) and ``curve`` (3, point) are what
    ``normal_kernels`` takes; ``preloads`` and ``forces`` N (pair,) press from outside and between the surfaces;
    ``stiffness`` N/m (pair,) is the slope at rest; ``elastic`` says which pairs are linear springs of the structure.
    """

    rows: Float[np.ndarray, "pair n"]
    table: Float[np.ndarray, "pair 8"]
    curve: Float[np.ndarray, "3 point"]
    preloads: Float[np.ndarray, "pair"]
    forces: Float[np.ndarray, "pair"]
    stiffness: Float[np.ndarray, "pair"]
    elastic: Bool[np.ndarray, "pair"]
    areas: Float[np.ndarray, "pair"]
    joints: tuple[str, ...]
    pairs: tuple[tuple[int, int], ...]

    @property
    def followed(self) -> Int[np.ndarray, "row"]:
        """Numbers of the pairs that part or stiffen: a solver has to follow their normal force."""
        return np.flatnonzero(~self.elastic)


def growth(joint: Joint, forces: float | Float[np.ndarray, "pair"]) -> Any:
    """Normal stiffness of a linear contact pressed with ``forces`` N over that at the law's reference force."""
    if joint.normal_exponent == 0:
        return 1.0
    return np.maximum(forces / joint.law.reference_force, 1e-6) ** joint.normal_exponent


def normal_pairs(
    joints: Sequence[Joint],
    gaps: Float[np.ndarray, "pair n"],
    areas: Float[np.ndarray, "pair"],
    preloads: Float[np.ndarray, "pair"],
) -> NormalPairs:
    """Tables of the normal contacts of all joints, not yet pressed; ``areas`` are shares of each joint."""
    from ema.contact import normal_kernels as columns

    count = len(gaps)
    table, elastic, sizes = np.zeros((count, 8)), np.zeros(count, bool), np.full(count, np.nan)
    stiffness, curves, place, row = np.zeros(count), [np.zeros((3, 0))], 0, 0
    names: list[str] = []
    for joint in joints:
        contact, part = joint.normal_contact, slice(row, row + len(joint.pairs))
        check_normal_contact(contact, f"joint {joint.name}")
        stiffness[part] = joint.normal_stiffness * areas[part]
        if contact.name == LINEAR:
            stiffness[part] *= growth(joint, preloads[part] / areas[part])
        elastic[part] = contact.name == LINEAR
        names += [joint.name] * len(joint.pairs)
        if joint.area is not None:
            sizes[part] = joint.area * areas[part]
        table[part, columns.KIND], table[part, columns.EXPONENT] = columns.POWER, contact.exponent
        if contact.name == "power":
            depth = contact.exponent * contact.reference_force / joint.normal_stiffness
            table[part, columns.SCALE] = areas[part] * contact.reference_force / depth**contact.exponent
        elif contact.name == "curve":
            x, force = np.array(contact.points).T
            energy = np.append(0.0, np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(x)))
            curves.append(np.array([x, force, energy]))
            table[part, columns.KIND], table[part, columns.SCALE] = columns.CURVE, areas[part]
            table[part, columns.FIRST], table[part, columns.LAST] = place, place + len(x) - 1
            place += len(x)
        row += len(joint.pairs)
    pairs = tuple(pair for joint in joints for pair in joint.pairs)
    return NormalPairs(
        gaps,
        table,
        np.ascontiguousarray(np.hstack(curves)),
        preloads,
        preloads.copy(),
        stiffness,
        elastic,
        sizes,
        tuple(names),
        pairs,
    )


def press(
    pairs: NormalPairs, mass: Float[np.ndarray, "n n"], stiffness: Float[np.ndarray, "n n"], where: str
) -> NormalPairs:
    """State of rest of the pairs under their preloads, by Newton's method on the potential energy.

    ``stiffness`` is that of the structure with its linear normal springs. Friction does not act while the joint is
    tightened.

    Raises
    ------
    FailureError : no equilibrium was found.
    """
    from ema.contact import normal_kernels as kernels

    follow = pairs.followed
    if not len(follow):
        return pairs
    rows, table, preloads = pairs.rows[follow], pairs.table[follow].copy(), pairs.preloads[follow]
    depths = _pressed_depths(rows, table, pairs.curve, preloads, mass, stiffness, where)
    press_all: Any = kernels.press_all
    force, slope, energy = press_all(table, pairs.curve, depths)
    table[:, kernels.PENETRATION], table[:, kernels.FORCE], table[:, kernels.ENERGY] = depths, force, energy
    whole, forces, springs = pairs.table.copy(), pairs.forces.copy(), pairs.stiffness.copy()
    whole[follow], forces[follow] = table, force
    least = _LEAST_STIFFNESS * max(float(slope.max()), float(pairs.stiffness[follow].max()))
    springs[follow] = np.maximum(slope, least)
    return replace(pairs, table=whole, forces=forces, stiffness=springs)


def _compliance(rows: np.ndarray, springs: np.ndarray, mass: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """Openings of the gaps (pair, pair) per force that opens them, with springs that shut them.

    Motions that neither the structure nor the springs resist are not excited by pressing: they are left out.
    """
    from scipy.linalg import eigh

    matrix = stiffness + rows.T @ (springs[:, None] * rows)
    squares, shapes = eigh(matrix, mass)
    modal = rows @ shapes[:, squares > 1e-12 * squares[-1]]
    return np.asarray((modal / squares[squares > 1e-12 * squares[-1]]) @ modal.T)


def _pressed_depths(
    rows: np.ndarray,
    table: np.ndarray,
    curve: np.ndarray,
    preloads: np.ndarray,
    mass: np.ndarray,
    stiffness: np.ndarray,
    where: str,
) -> Float[np.ndarray, "pair"]:
    """Penetrations in m; negative where a pair is open."""
    from ema.contact import normal_kernels as kernels

    press_all: Any = kernels.press_all
    if not preloads.any():
        return np.zeros(len(rows))
    # springs as if every pair carried its own preload; ``load`` is what goes beyond them
    springs = _secant(table, curve, preloads)
    compliance = _compliance(rows, springs, mass, stiffness)

    def energy(load: np.ndarray) -> float:
        opening = compliance @ load
        stored = press_all(table, curve, -opening)[2]
        return float(0.5 * (load - springs * opening) @ opening + stored.sum() + preloads @ opening)

    load = -preloads
    level = energy(load)
    for _ in range(200):
        opening = compliance @ load
        force, slope, _ = press_all(table, curve, -opening)
        missing = force - preloads + springs * opening - load
        if np.abs(missing).max() <= 1e-12 * preloads.sum():
            break
        step = np.linalg.solve(np.eye(len(rows)) + (slope - springs)[:, None] * compliance, missing)
        length, trial = 1.0, level
        while length > 1e-6:
            trial = energy(load + length * step)
            if trial <= level + 1e-13 * abs(level):
                break
            length *= 0.5
        load, level = load + length * step, trial
    if np.abs(missing).max() <= 1e-9 * preloads.sum():
        return np.asarray(-opening)
    raise FailureError(
        "the preload finds no equilibrium",
        where=where,
        got=f"{np.abs(missing).max():.1e} N missing after 200 steps",
        advice="lower the normal stiffness or the exponent",
    )


def _secant(table: np.ndarray, curve: np.ndarray, preloads: np.ndarray) -> Float[np.ndarray, "pair"]:
    """Normal force over penetration of every pair when it carries its own preload, or the mean one if it has none."""
    from ema.contact import normal_kernels as kernels

    load = np.where(preloads > 0, preloads, preloads.mean())
    spring = np.empty(len(table))
    for i, (pair, force) in enumerate(zip(table, load, strict=True)):
        if pair[kernels.KIND] == kernels.POWER:
            spring[i] = force / (force / pair[kernels.SCALE]) ** (1 / pair[kernels.EXPONENT])
        else:
            part = slice(int(pair[kernels.FIRST]), int(pair[kernels.LAST]) + 1)
            x, f = curve[0, part], pair[kernels.SCALE] * curve[1, part]
            depth = np.interp(force, f, x) if force <= f[-1] else x[-1] * force / f[-1]
            spring[i] = force / depth
    return spring


def resting(pairs: NormalPairs, where: str) -> ContactPressure:
    """Pressure at rest, with a finding where pairs are open."""
    closed = pairs.forces > _OPEN * float(pairs.forces.max())
    return ContactPressure(
        pairs.joints,
        pairs.pairs,
        pairs.forces,
        pairs.preloads,
        pairs.areas,
        pairs.forces,
        pairs.forces,
        np.where(closed, 0.0, 1.0),
        np.where(closed, np.nan, 0.0),
        _rest_gaps(pairs),
        tuple(_open_at_rest(pairs, where)),
    )


def _rest_gaps(pairs: NormalPairs) -> Float[np.ndarray, "pair"]:
    from ema.contact import normal_kernels as kernels

    return np.where(pairs.elastic, 0.0, np.maximum(-pairs.table[:, kernels.PENETRATION], 0.0))


def _open_at_rest(pairs: NormalPairs, where: str) -> list[Finding]:
    total = float(pairs.preloads.sum())
    out = np.flatnonzero(~pairs.elastic & (pairs.forces <= _OPEN * max(total, 1e-300)))
    if not len(out) or total == 0:
        return []
    gap = float(_rest_gaps(pairs).max())
    names = ", ".join(f"{pairs.joints[i]} {pairs.pairs[i]}" for i in out[:5]) + (" ..." if len(out) > 5 else "")
    return [
        Finding(
            "warning",
            "lift-off",
            where,
            f"{len(out)} of {len(pairs.forces)} pairs are open under the preload, up to {gap:.1e} m: {names}.",
            gap,
            0.0,
            "Spread the normal force, or leave these pairs out.",
        )
    ]


def preload(model: BeamModel) -> ContactPressure:
    """Compute how the normal forces of a model spread over its node pairs at rest, before anything moves.

    Parameters
    ----------
    model : BeamModel
        The model.

    Returns
    -------
    ContactPressure
        Normal forces and pressures at rest.

    Raises
    ------
    InputError
        If the model is not physical.
    FailureError
        If no equilibrium is reached.

    Examples
    --------
    >>> from ema.simulate import Masing, Section, double_beam
    >>> model = double_beam(Masing(0.3, 1e9), 1000.0, Section(0.5, 0.04, 0.005, elements=4))
    >>> round(float(preload(model).forces.sum()), 3)
    1000.0
    """
    from ema.simulate.structure import assemble

    system = assemble(model)
    return resting(system.normals, system.name)
