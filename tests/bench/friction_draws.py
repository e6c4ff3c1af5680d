"""Random structures with friction contacts, as models of the simulator and as numbers for ``friction_truth``.

Hosts: masses in a row, dense matrices from random natural frequencies and shapes, cantilevers that lie on each other.
"""

from dataclasses import dataclass

import numpy as np

from ema.data import BeamModel, Damping, FrictionLaw, Joint, Matrices
from ema.dof import Dof
from ema.simulate import (
    BoucWen,
    Coulomb,
    Dahl,
    Iwan,
    LuGre,
    Masing,
    ModifiedIwan,
    ParallelMasing,
    RegularisedMasing,
    Valanis,
    register_law,
)
from tests.bench.friction_truth import BOUC_WEN, DAHL, FLOOR, LUGRE, SPRINGS, VALANIS, Rubbing

MU = 0.4
_DECADES = (0.7, 2.7)
"""Lowest natural frequency of a host in Hz, its logarithm: 5 to 500 Hz."""
LAWS = (
    "masing",
    "coulomb",
    "parallel masing",
    "iwan",
    "modified iwan",
    "regularised masing",
    "bouc wen",
    "dahl",
    "valanis",
    "lugre",
    "own",
    "mixture",
)


def _dahl_with_floor(force, du, k, limit, p0, p1, p2, p3):  # type: ignore[no-untyped-def]
    """The first-order rule of the page on laws of one's own."""
    if limit <= 0.0:
        return 0.0
    way = force / limit if du > 0.0 else -force / limit
    return min(max(force + k * max(1.0 - way, p0) * du, -limit), limit)


DahlWithFloor = register_law("dahl with floor", _dahl_with_floor)


@dataclass(frozen=True)
class Draw:
    """A model, the same in numbers, and what is done to it.

    ``at`` and ``output``: DOFs, with their rows (n,) in the numbers; ``force`` N; ``lowest`` Hz, first mode with stuck
    contacts; ``sliding`` Hz, with none.
    """

    law: str
    host: str
    model: BeamModel
    rubbing: Rubbing
    at: str
    output: str
    load_row: np.ndarray
    output_row: np.ndarray
    force: float
    lowest: float
    sliding: float


def draw(law: str, seed: int, lightest: float = 0.0) -> Draw:
    """A random model whose contacts follow ``law``, or a law each; ``lightest``: least damping ratio of its modes."""
    rng = np.random.default_rng([LAWS.index(law), seed])
    host = ("chain", "dense", "beams")[rng.integers(3)]
    lower, upper, pairs = {"chain": _chain, "dense": _dense, "beams": _beams}[host](rng)
    mass, elastic = _joined(lower[0], upper[0]), _joined(lower[1], upper[1])
    split, size = len(lower[0]), len(mass)
    slips, gaps = np.zeros((len(pairs), size)), np.zeros((len(pairs), size))
    for n, (one, other) in enumerate(pairs):
        slips[n, lower[2][one]], slips[n, split + upper[2][other]] = -1.0, 1.0
        if host == "beams":
            gaps[n, lower[3][one]], gaps[n, split + upper[3][other]] = -1.0, 1.0
    normal = float(10 ** rng.uniform(-1, 1)) * elastic.max()
    elastic = elastic + gaps.T @ gaps * (normal / len(pairs))
    own = 1 / np.diag(slips @ np.linalg.solve(elastic, slips.T))
    share_of_pairs = rng.dirichlet(np.full(len(pairs), 5.0))
    stiffness = float(np.median(own) * len(pairs) * 10 ** rng.uniform(-1, 1))
    names = [law] * len(pairs)
    if law == "mixture":
        names = list(rng.choice([name for name in LAWS if name not in ("mixture",)], len(pairs)))
    at = int(rng.choice(lower[2] if host != "beams" else np.concatenate([lower[2], lower[3]])))
    stuck = elastic + slips.T @ (stiffness / len(pairs) * slips)
    omega = np.sqrt(np.linalg.eigvals(np.linalg.solve(mass, stuck)).real)
    load = np.eye(size)[at]
    carried = np.abs(stiffness / len(pairs) * (slips @ np.linalg.solve(stuck, load))).max()
    force = float(10 ** rng.uniform(0, 2))
    # the whole joint slips at about this share of the load
    normal_force = float(force * carried * len(pairs) * 10 ** rng.uniform(-2, 0.5) / MU)
    speed = MU * normal_force / stiffness * omega.min()
    groups = [(name, [n for n in range(len(pairs)) if names[n] == name]) for name in sorted(set(names))]
    joints, rows = [], {}
    for name, members in groups:
        share = share_of_pairs[members].sum()
        made, kind, numbers, springs = _law(name, rng, stiffness * len(members) / len(pairs), speed, omega.min())
        forces = share_of_pairs[members] / share
        joints.append(
            Joint(
                name,
                tuple((1 + pairs[n][0], 1 + pairs[n][1]) for n in members),
                (0.0, 0.0),
                made,
                float(normal_force * share),
                normal * len(members) / len(pairs) if host == "beams" else 1.0,
                force_shares=forces,
            )
        )
        for n, part in zip(members, forces, strict=True):
            limit, k = MU * normal_force * share * part, made.contact_stiffness / len(members)
            own_numbers = numbers / np.array([len(members), len(members), 1, 1]) if kind == LUGRE else numbers
            rows[n] = kind, k, limit, own_numbers, springs * np.array([[k], [limit]])
    order = [n for _, members in groups for n in members]
    width = max(rows[n][4].shape[1] for n in order)
    tables = [np.array([rows[n][c] for n in order]) for c in range(4)]
    springs = np.zeros((len(order), 2, width))
    for place, n in enumerate(order):
        springs[place, :, : rows[n][4].shape[1]] = rows[n][4]
    slips = slips[order]
    whole = elastic + slips.T @ (tables[1][:, None] * slips)
    squares, shapes = _modes(whole, mass)
    ratio = float(10 ** rng.uniform(-3, -1.5))
    ratio = max(ratio, lightest)
    by_mass = bool(rng.integers(2))
    factor = 2 * ratio * np.sqrt(squares[0])
    damping = factor * mass if by_mass else mass @ shapes @ np.diag(2 * ratio * np.sqrt(squares)) @ shapes.T @ mass
    out = int(rng.choice(np.flatnonzero(np.arange(size) != at)))
    names_of = _names(lower, "", 0) | _names(upper, "beam", split)
    model = BeamModel(
        _matrices(lower, "", host),
        _matrices(upper, "beam", host),
        tuple(joints),
        Damping(mass_factor=factor) if by_mass else Damping(ratio=ratio),
        f"{law}, seed {seed}",
    )
    rubbing = Rubbing(mass, damping, elastic, slips, tables[0], tables[1], tables[2], tables[3], springs)
    free = np.sqrt(max(_modes(elastic, mass)[0][0], 0.0)) / (2 * np.pi)
    return Draw(
        law,
        host,
        model,
        rubbing,
        names_of[at],
        names_of[out],
        load,
        np.eye(size)[out],
        force,
        float(np.sqrt(squares[0]) / (2 * np.pi)),
        float(free),
    )


_Part = tuple[np.ndarray, np.ndarray, list[int], list[int]]
"""Mass, stiffness, rows of the displacements in X of the nodes, and in Z (none: these are apart from all others)."""


def _chain(rng: np.random.Generator) -> tuple[_Part, _Part, list[tuple[int, int]]]:
    """Masses in a row, both rows held at one end, in contact one by one."""
    counts = rng.integers(2, 9, 2)
    scale = (2 * np.pi * 10 ** rng.uniform(*_DECADES)) ** 2 * 10
    parts = []
    for count in counts:
        springs = rng.uniform(0.5, 2.0, count + 1) * scale
        stiffness = np.diag(springs[:-1] + springs[1:]) - np.diag(springs[1:-1], 1) - np.diag(springs[1:-1], -1)
        parts.append((np.diag(rng.uniform(0.5, 1.5, count)), stiffness, list(range(count)), []))
    return parts[0], parts[1], [(n, n) for n in range(min(counts))]


def _dense(rng: np.random.Generator) -> tuple[_Part, _Part, list[tuple[int, int]]]:
    """Matrices from natural frequencies over one and a half decades and random shapes; up to 20 contacts."""
    lowest, parts = 10 ** rng.uniform(*_DECADES), []
    for count in rng.integers(2, 21, 2):
        omega = 2 * np.pi * lowest * np.sort(10 ** rng.uniform(0.0, 1.5, count))
        turned = np.linalg.qr(rng.standard_normal((count, count)))[0]
        root = np.diag(np.sqrt(rng.uniform(0.3, 3.0, count)))
        stiffness = root @ turned @ np.diag(omega**2) @ turned.T @ root
        parts.append((root @ root, 0.5 * (stiffness + stiffness.T), list(range(count)), []))
    most = min(len(parts[0][0]), len(parts[1][0]))
    chosen = [rng.permutation(len(part[0]))[: rng.integers(1, most + 1)] for part in parts]
    return parts[0], parts[1], [(int(a), int(b)) for a, b in zip(*chosen, strict=False)]


def _beams(rng: np.random.Generator) -> tuple[_Part, _Part, list[tuple[int, int]]]:
    """Two Bernoulli cantilevers of equal length: w and the interface's displacement (h/2) w' at every node.

    Inertia in proportion to the stiffness bounds their frequencies at 20 to 60 times the lowest: the truth is explicit.
    """
    count, length = int(rng.integers(2, 11)), float(10 ** rng.uniform(-0.8, 0.0))
    parts = []
    for _ in range(2):
        height, width, span = float(rng.uniform(4e-3, 8e-3)), 0.04, length / count
        bending, inertia = 210e9 * width * height**3 / 12 / span**3, 7850 * width * height * span / 420
        lever = np.array([1.0, span, 1.0, span])
        own = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]])
        heavy = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]])
        size = 2 * (count + 1)
        stiffness, mass = np.zeros((size, size)), np.zeros((size, size))
        for e in range(count):
            part = slice(2 * e, 2 * e + 4)
            stiffness[part, part] += bending * own * np.outer(lever, lever)
            mass[part, part] += inertia * heavy * np.outer(lever, lever)
        scale = np.tile([1.0, 2 / height], count)
        held = [matrix[2:, 2:] * np.outer(scale, scale) for matrix in (mass, stiffness)]
        held[0] += held[1] / (_modes(held[1], held[0])[0][0] * rng.uniform(20.0, 60.0) ** 2)
        parts.append((held[0], held[1], list(range(1, 2 * count, 2)), list(range(0, 2 * count, 2))))
    # the interface moves by -(h/2) w' above the lower middle layer and by +(h/2) w' below the upper one
    for matrix in parts[0][:2]:
        turn = np.tile([1.0, -1.0], count)
        matrix *= np.outer(turn, turn)
    return parts[0], parts[1], [(n, n) for n in range(count)]


def _law(
    name: str, rng: np.random.Generator, stiffness: float, speed: float, pace: float
) -> tuple[FrictionLaw, int, np.ndarray, np.ndarray]:
    """A law of a joint of ``stiffness`` N/m, its kind and numbers, and shares of its springs (2, spring).

    ``speed`` m/s and ``pace`` rad/s: of the way to full slip at the lowest mode, and of that mode.
    """
    none, single = np.zeros(4), np.ones((2, 1))
    if name == "masing":
        return Masing(MU, stiffness), SPRINGS, none, single
    if name == "coulomb":
        return Coulomb(MU, stiffness * 30), SPRINGS, none, single
    if name == "parallel masing":
        count = int(rng.integers(2, 6))
        shares = rng.dirichlet(np.full(count, 2.0)), rng.dirichlet(np.full(count, 2.0))
        return ParallelMasing(MU, stiffness, list(shares[0]), list(shares[1])), SPRINGS, none, np.array(shares)
    if name in ("iwan", "modified iwan"):
        chi = float(rng.uniform(-0.9, 0.0 if name == "iwan" else 1.0))
        beta, count = float(rng.uniform(0, 1.5)), int(rng.integers(10, 61))
        made = Iwan if name == "iwan" else ModifiedIwan
        return made(MU, stiffness, chi, beta, count), SPRINGS, none, _iwan(chi, beta, count)
    if name == "regularised masing":
        m = float(10 ** rng.uniform(-0.3, 1.5))
        return RegularisedMasing(MU, stiffness, m), BOUC_WEN, np.array([m, 0.5, 0, 0]), single
    if name == "bouc wen":
        n, gamma = float(10 ** rng.uniform(-0.3, 0.9)), float(rng.uniform(-1.0, 0.5))
        return BoucWen(MU, stiffness, n, gamma), BOUC_WEN, np.array([n, gamma, 0, 0]), single
    if name == "dahl":
        shape = float(rng.uniform(0.5, 2.0))
        return Dahl(MU, stiffness, shape), DAHL, np.array([shape, 0, 0, 0]), single
    if name == "valanis":
        kappa = float(rng.uniform(0.0, 0.98))
        return Valanis(MU, stiffness, kappa), VALANIS, np.array([kappa, 0, 0, 0]), single
    if name == "lugre":
        bristle, viscous = stiffness / pace * 10 ** rng.uniform(-3.0, -1.5, 2) * (1.0, 0.1)
        ratio, stribeck = float(rng.uniform(1.0, 1.5)), float(speed * 10 ** rng.uniform(-0.5, 1.5))
        law = LuGre(MU, stiffness, float(bristle), float(viscous), ratio, stribeck)
        return law, LUGRE, np.array([bristle, viscous, ratio, stribeck]), single
    floor = float(rng.uniform(0.05, 0.5))
    return DahlWithFloor(MU, stiffness, floor), FLOOR, np.array([floor, 0, 0, 0]), single


def _iwan(chi: float, beta: float, count: int) -> np.ndarray:
    """Segalman's density (2005, Eq. 10) up to the largest slip in stretches, and its last spring.

    The stretches are those of the documentation: in equal ratios from 3e-4 of the largest slip, the first from zero.
    """
    scale = beta + (chi + 1) / (chi + 2)
    top = (1 + beta) / scale
    r = (chi + 1) / (scale * top ** (chi + 2))
    ends = top * 3e-4 ** (1 - np.arange(count - (beta > 0)) / (count - (beta > 0) - 1))
    begins = np.append(0.0, ends[:-1])
    k = r * (ends ** (chi + 1) - begins ** (chi + 1)) / (chi + 1)
    f = r * (ends ** (chi + 2) - begins ** (chi + 2)) / (chi + 2)
    if beta > 0:
        k, f = np.append(k, beta / (scale * top)), np.append(f, beta / scale)
    return np.array([k / k.sum(), f / f.sum()])


def _modes(stiffness: np.ndarray, mass: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Squares of natural frequencies, ascending, and mass-normalised shapes."""
    root = np.linalg.inv(np.linalg.cholesky(mass))
    squares, vectors = np.linalg.eigh(root @ stiffness @ root.T)
    return squares, root.T @ vectors


def _joined(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Block diagonal."""
    whole = np.zeros((len(one) + len(other),) * 2)
    whole[: len(one), : len(one)], whole[len(one) :, len(one) :] = one, other
    return whole


def _names(part: _Part, name: str, first: int) -> dict[int, str]:
    """DOFs of the rows of a part."""
    before = f"{name}:" if name else ""
    names = {first + row: f"{before}{1 + node}:+X" for node, row in enumerate(part[2])}
    return names | {first + row: f"{before}{1 + node}:+Z" for node, row in enumerate(part[3])}


def _matrices(part: _Part, name: str, host: str) -> Matrices:
    """Matrices of a part; without rows in Z its nodes get masses of their own there, which nothing moves."""
    mass, stiffness, along, _ = part
    if host == "beams":
        names = _names(part, name, 0)
        return Matrices(mass, stiffness, tuple(Dof.parse(names[row]) for row in range(len(mass))))
    count = len(along)
    dofs = tuple(Dof(1 + node, axis, name) for axis in ("+X", "+Z") for node in range(count))
    return Matrices(_joined(mass, np.eye(count)), _joined(stiffness, np.diag(np.full(count, stiffness.max()))), dofs)
