"""How often the linearity gate is right: random tables with a friction joint, and linear ones with faulty records.

A table has 4 to 10 modes, all of its points are struck three times at one nominal level, and two accelerometers stay
where they are. The truth is the share of the work of the impacts that the simulator's energy balance puts down to slip;
a linear loss of the joint is not in it. The gate sees nothing but the records.

    python -m tests.bench.linearity --n 400 --seed 1
    python -m tests.bench.linearity --n 40 --misplaced 0.1    # linear ones, whose impacts miss their points
    python -m tests.bench.linearity --n 40 --misplaced 0.1 --complexity 0.3    # the same with complex modes
    python -m tests.bench.linearity --n 200 --linear    # linear ones, their kinds in turn
    python -m tests.bench.linearity --n 60 --shares 0.05 0.4 --quick    # a class of shares, drawn at a fifth of the time
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from ema.compare.linearity import linearity
from ema.data import BeamModel, Channel, Condition, Damping, FrictionLaw, Joint, Matrices, ModalModel, Recording, Run
from ema.data.modal import poles_from
from ema.dof import Dof
from ema.simulate import Fault, FrictionRig, RovingHammer, VirtualRig
from ema.simulate.transient import respond

LOW, HIGH, RATE = 200.0, 800.0, 4096.0
HITS, SPACING, SCATTER, NOISE = 3, 0.8, 0.1, 0.01
"""Impacts on a point, s between them, their relative standard deviation (95 % within 20 %), and the noise over the rms
response in the first 50 ms."""
LEAST, MOST = 0.001, 0.4
PEAK = 1000.0
QUICK = (2, 0.3)
"""Points struck and s after an impact that a quick search of the normal force looks at; all points and `SPACING` else.
The share of a table is that of its records all the same, but it is not as near to the one that was drawn."""


@dataclass(frozen=True)
class Drawn:
    """A table as measured: its run, the band of its modes in Hz, and the share of the work dissipated by slip."""

    kind: str
    run: Run
    band: tuple[float, float]
    share: float


@dataclass(frozen=True)
class MeteredRig(FrictionRig):
    """A friction rig that keeps the work and the loss by friction of every record, in J."""

    energies: dict[int, tuple[float, float]] = field(default_factory=dict)

    def _motion(self, number: int, forces: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
        run = respond(self.model, forces, self.drive.dofs(number), rate, self._outputs, tolerance=self.tolerance)
        self.energies[number] = float(run.energy.friction[-1]), float(run.energy.supplied[-1])
        return np.asarray(run.displacements), np.asarray(run.velocities)


def structure(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Natural frequencies in Hz (mode,) at least 4 % apart, and mass-normalised shapes (dof, mode) of 4 to 10 DOFs."""
    count = int(rng.integers(4, 11))
    while True:
        frequencies = np.sort(np.exp(rng.uniform(np.log(LOW), np.log(HIGH), count)))
        if np.min(np.diff(frequencies) / frequencies[1:]) > 0.04:
            break
    shapes = np.linalg.qr(rng.normal(size=(count, count)))[0] / np.sqrt(rng.uniform(5, 20))
    return frequencies, shapes


def friction_table(rng: np.random.Generator, shares: tuple[float, float] = (LEAST, MOST), quick: bool = False) -> Drawn:
    """A table that rubs on one or two joints; the normal force is such that slip takes the share that was drawn."""
    frequencies, shapes = structure(rng)
    count, omega = len(frequencies), 2 * np.pi * frequencies
    law = _law(rng)
    joints = rng.choice(count, int(rng.integers(1, 3)), replace=False)
    ratio = np.exp(rng.uniform(np.log(0.003), np.log(0.015)))
    # Stiffness of the joints over that of the modes: the stuck frequencies lie 1 to 20 % above the sliding ones.
    kappa = np.exp(rng.uniform(np.log(0.02), np.log(0.4)))
    stiffness = kappa / len(joints) * np.median(omega) ** 2 / np.max(np.sum(shapes[joints] ** 2, axis=0))
    mass, spring = np.linalg.inv(shapes @ shapes.T), np.linalg.inv((shapes / omega**2) @ shapes.T)
    size = count + len(joints)
    padded = [np.zeros((size, size)), np.zeros((size, size))]
    padded[0][:count, :count], padded[1][:count, :count] = mass, spring
    for extra in range(count, size):
        padded[0][extra, extra], padded[1][extra, extra] = 1e-3, 1e9
    dofs = tuple(Dof(node + 1, "+X") for node in range(count)) + tuple(Dof(int(node) + 1, "+Z") for node in joints)
    host = Matrices((padded[0] + padded[0].T) / 2, (padded[1] + padded[1].T) / 2, dofs)
    walls = tuple(Dof(int(node) + 1, axis, "wall") for node in joints for axis in ("+X", "+Z"))
    wall = Matrices(1e3 * np.eye(len(walls)), 1e16 * np.eye(len(walls)), walls)

    def model(force: float) -> BeamModel:
        made = tuple(
            Joint(
                f"J{node}",
                ((int(node) + 1, int(node) + 1),),
                (0.0, 0.0),
                replace(law, contact_stiffness=stiffness),
                force,
                1.0,
            )
            for node in joints
        )
        return BeamModel(host, wall, made, Damping(ratio=ratio), "friction table")

    wanted = float(np.exp(rng.uniform(*np.log(shares))))
    places = tuple(Dof(node + 1, "+X") for node in range(count))
    sensors = _sensors(rng, count)

    def rig(force: float, hits: int = HITS, spacing: float = SPACING) -> MeteredRig:
        return MeteredRig(
            model(force),
            RovingHammer(places, hits, PEAK, SCATTER, _contact(frequencies), 0.05, 0.05, spacing),
            sensors,
            RATE,
            seed=int(seed),
        )

    seed = rng.integers(2**31)
    points, spacing = QUICK if quick else (count, SPACING)
    limit = _normal_force(lambda force: _share(rig(force, 1, spacing), points), PEAK, wanted)
    made = rig(limit)
    run = _measured(rng, made, count)
    return Drawn(f"friction, {law.name}", run, _band(frequencies, kappa), _total(made))


def _total(rig: MeteredRig) -> float:
    lost, supplied = np.sum(list(rig.energies.values()), axis=0)
    return float(lost / supplied)


def _share(rig: MeteredRig, takes: int) -> float:
    for number in range(takes):
        rig.signals(number, np.random.default_rng([rig.seed, number]))
    return _total(rig)


def _normal_force(share: Callable[[float], float], peak: float, wanted: float) -> float:
    """The largest normal force in N at which slip takes ``wanted``; that of the most slip where it never takes so much."""
    forces = peak * np.geomspace(100.0, 0.01, 13)
    before, best = (forces[0], share(forces[0])), (0.0, forces[0])
    for force in forces[1:]:
        now = share(force)
        best = max(best, (now, force))
        if now > wanted:
            high, low = before, (force, now)
            for _ in range(4):
                middle = float(np.sqrt(high[0] * low[0]))
                value = share(middle)
                high, low = ((middle, value), low) if value < wanted else (high, (middle, value))
            return float(np.sqrt(high[0] * low[0]))
        before = (force, now)
    return float(best[1])


def _law(rng: np.random.Generator) -> FrictionLaw:
    """A Masing spring, or one of two laws that slip a little from the first motion on."""
    kind = rng.choice(["masing", "iwan", "regularised masing"], p=[0.5, 0.3, 0.2])
    if kind == "iwan":
        return FrictionLaw(
            "iwan",
            1.0,
            1.0,
            (("chi", float(rng.uniform(-0.7, 0.0))), ("beta", float(rng.uniform(0, 2))), ("springs", 40.0)),
        )
    if kind == "masing":
        return FrictionLaw("masing", 1.0, 1.0)
    return FrictionLaw(str(kind), 1.0, 1.0, (("exponent", float(rng.uniform(2, 8))),))


def _contact(frequencies: np.ndarray) -> float:
    """Contact time in s of an impact that reaches the highest mode."""
    return 0.7 / float(frequencies[-1])


def _sensors(rng: np.random.Generator, count: int) -> tuple[Channel, ...]:
    nodes = rng.choice(count, 2, replace=False)
    return tuple(
        Channel(f"acc {number}", Dof(int(node) + 1, "+X"), quantity="acceleration", unit="m/s^2")
        for number, node in enumerate(nodes, 1)
    )


def _band(frequencies: np.ndarray, kappa: float = 0.0) -> tuple[float, float]:
    return 0.8 * float(frequencies[0]), 1.25 * float(frequencies[-1]) * np.sqrt(1 + kappa)


def _measured(rng: np.random.Generator, rig: FrictionRig | VirtualRig, takes: int) -> Run:
    """All records of a rig with noise."""
    records = [rig.take(number) for number in range(takes)]
    first = slice(round(0.05 * RATE), round(0.1 * RATE))
    level = np.median([np.sqrt(np.mean(record.signals[1:, first] ** 2, axis=1)) for record in records], axis=0)
    std = NOISE * np.array([0.1 * PEAK, *level])
    noisy = tuple(
        replace(record, signals=record.signals + rng.normal(size=record.signals.shape) * std[:, None])
        for record in records
    )
    return Run("table", Condition(rig.drive.excitation), noisy)


def linear_table(rng: np.random.Generator, kind: str) -> Drawn:
    """A linear table whose records are sound (``plain``) or have one of the faults of hammer tests."""
    frequencies, shapes = structure(rng)
    count = len(frequencies)
    damping = np.exp(rng.uniform(np.log(0.003), np.log(0.015), count))
    if kind == "heavy damping":
        heavy = rng.choice(count, int(rng.integers(1, count // 2 + 1)), replace=False)
        damping[heavy] = rng.uniform(0.03, 0.1, len(heavy))
    poles = poles_from(frequencies, damping)
    dofs = tuple(Dof(node + 1, "+X") for node in range(count))
    model = ModalModel(poles, shapes.astype(complex), dofs, shapes / (2j * poles.imag), dofs, scaling="unit modal mass")
    faults: tuple[Fault, ...] = ()
    if kind == "second impacts":
        faults = tuple(
            Fault(
                take,
                int(rng.integers(HITS)),
                "double hit",
                float(rng.uniform(0.05, 0.8)),
                float(rng.uniform(0.005, 0.05)),
            )
            for take in range(count)
            if rng.random() < 0.5
        )
    points, hits, spacing = dofs, HITS, SPACING
    if kind == "truncated records":  # a record for every impact, which ends while the table still rings
        points, hits, spacing = tuple(dof for dof in dofs for _ in range(HITS)), 1, float(rng.uniform(0.1, 0.25))
    drive = RovingHammer(points, hits, PEAK, SCATTER, _contact(frequencies), 0.05, 0.05, spacing, 0.002, faults)
    rig = VirtualRig(model, drive, _sensors(rng, count), RATE, seed=int(rng.integers(2**31)))
    run = _measured(rng, rig, len(points))
    if kind == "bad force window":
        run = replace(run, recordings=tuple(_windowed(rng, one) for one in run.recordings))
    return Drawn(f"linear, {kind}", run, _band(frequencies), 0.0)


def misplaced_table(rng: np.random.Generator, error: float, complexity: float = 0.0) -> Drawn:
    """A linear table, no impact on which is where it should be: shapes differ by ``error`` times their rms value.

    Half of the tables have three modes above the band, which every impact excites as its place has it. ``complexity``
    is the rms imaginary part of the shapes over their rms real part, as dampers at single places make it.
    """
    frequencies, shapes = structure(rng)
    count, band = len(frequencies), _band(frequencies)
    contact, size = _contact(frequencies), float(np.sqrt(np.mean(shapes**2)))
    if rng.random() < 0.5:
        frequencies = np.append(frequencies, np.sort(frequencies[-1] * rng.uniform(1.3, 2.2, 3)))
        shapes = np.column_stack([shapes, size * rng.normal(size=(count, 3))])
    damping = np.exp(rng.uniform(np.log(0.003), np.log(0.015), len(frequencies)))
    poles = poles_from(frequencies, damping)
    nodes = np.repeat(np.arange(count), HITS)
    struck = shapes[nodes] + error * size * rng.normal(size=(len(nodes), len(frequencies)))
    if complexity:
        shapes = shapes + 1j * complexity * size * rng.normal(size=shapes.shape)
        missed = rng.normal(size=(2, *struck.shape))
        struck = shapes[nodes] + error * size * (missed[0] + 1j * complexity * missed[1])
    places = tuple(Dof(1000 + row, "+X") for row in range(len(nodes)))
    dofs = (*(Dof(node + 1, "+X") for node in range(count)), *places)
    everywhere = np.vstack([shapes, struck])
    model = ModalModel(
        poles, everywhere.astype(complex), dofs, everywhere / (2j * poles.imag), dofs, scaling="unit modal mass"
    )
    drive = RovingHammer(places, 1, PEAK, SCATTER, contact, 0.05, 0.05, SPACING, 0.002)
    run = _measured(
        rng, VirtualRig(model, drive, _sensors(rng, count), RATE, seed=int(rng.integers(2**31))), len(nodes)
    )
    records = tuple(_said_to_be_at(record, int(node) + 1) for record, node in zip(run.recordings, nodes, strict=True))
    return Drawn("linear, misplaced", replace(run, recordings=records), band, 0.0)


def _said_to_be_at(record: Recording, node: int) -> Recording:
    """The record with the impact on ``node``."""
    channels = (replace(record.channels[0], dof=Dof(node, "+X")), *record.channels[1:])
    return replace(record, channels=channels)


def _windowed(rng: np.random.Generator, record: Recording) -> Recording:
    """The force of a record behind the window of a front end that closes within the contacts."""
    signals = record.signals.copy()
    force = signals[0]
    top = 0.5 * force.max()
    for start in np.flatnonzero((force[1:] > top) & (force[:-1] <= top)):
        stop = start + int(rng.integers(1, 4))
        force[stop : stop + round(0.02 * RATE)] = 0.0
    return replace(record, signals=signals)


LINEAR = ("plain", "heavy damping", "second impacts", "truncated records", "bad force window")


SHARES = (0.0, 0.005, 0.02, 0.05, 1.0)
"""Edges of the classes of shares: what must not be named, the curve between, and what must be."""


@dataclass(frozen=True)
class Outcome:
    """What the gate said about one table."""

    kind: str
    share: float
    verdict: str


def drawn(seed: int, number: int, shares: tuple[float, float] = (LEAST, MOST), quick: bool = False) -> Drawn:
    """Draw ``number`` of a seed: two friction tables, then a linear one, its kinds in turn."""
    rng = np.random.default_rng([seed, number])
    return (
        friction_table(rng, shares, quick) if number % 3 < 2 else linear_table(rng, LINEAR[number // 3 % len(LINEAR)])
    )


def outcome(table: Drawn) -> Outcome:
    """The verdict of the gate on a table."""
    return Outcome(table.kind, table.share, linearity(table.run, table.band).verdict)


def summary(outcomes: list[Outcome]) -> str:
    """Verdicts by class of share, and by kind of the linear tables."""
    classes = {f"{100 * low:g} to {100 * high:g} % by slip": [] for low, high in pairwise(SHARES)}
    for one in outcomes:
        if one.kind.startswith("friction"):
            name = list(classes)[int(np.searchsorted(SHARES, one.share, side="right")) - 1]
            classes[name].append(one)
    classes |= {f"linear, {kind}": [one for one in outcomes if one.kind == f"linear, {kind}"] for kind in LINEAR}
    lines = [f"{'':32s}{'tables':>8s}{'named':>8s}{'suspect':>9s}{'not testable':>14s}"]
    for name, members in {**classes, "all": outcomes}.items():
        verdicts = ("not linear", "suspect", "not testable")
        counts = [sum(one.verdict == verdict for one in members) for verdict in verdicts]
        lines.append(f"{name:32s}{len(members):8d}{counts[0]:8d}{counts[1]:9d}{counts[2]:14d}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=60, help="tables to draw")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first table, to go on where a run ended")
    parser.add_argument("--misplaced", type=float, help="linear tables alone, whose impacts miss their points by this")
    parser.add_argument("--complexity", type=float, default=0.0, help="of their modes: imaginary over real parts, rms")
    parser.add_argument("--linear", action="store_true", help="linear tables alone, their kinds in turn")
    parser.add_argument("--shares", type=float, nargs=2, default=(LEAST, MOST), help="range to draw the shares from")
    parser.add_argument("--quick", action="store_true", help="search the normal force on few points")
    given = parser.parse_args()
    outcomes = []
    for number in range(given.first, given.first + given.n):
        rng = np.random.default_rng([given.seed, number])
        if given.misplaced is not None:
            table = misplaced_table(rng, given.misplaced, given.complexity)
        elif given.linear:
            table = linear_table(rng, LINEAR[number % len(LINEAR)])
        else:
            table = drawn(given.seed, number, tuple(given.shares), given.quick)
        outcomes.append(outcome(table))
        one = outcomes[-1]
        print(f"{number:4d}  {one.kind:28s} {one.share:8.2%}  {one.verdict}", flush=True)
    print(summary(outcomes))


if __name__ == "__main__":
    main()
