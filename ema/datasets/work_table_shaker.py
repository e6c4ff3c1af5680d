"""Shaker campaigns on the work table with a friction beam: stepped sines over (F_E, F_N), ring cells, baselines."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from ema import store
from ema.data import BeamModel, Channel, ModalModel, Recording
from ema.datasets import work_table as table
from ema.dof import Dof
from ema.progress import Progress, advance, silent
from ema.simulate import FrictionRig, Shaker, SteppedSine, SweptShaker, VirtualRig

SAMPLING_RATE = 4096.0
"""Hz."""
SHAKER = Shaker(damping=60.0, moving_mass=0.15, mount_mass=0.05)
START = datetime(2026, 3, 23, 8, 0, tzinfo=UTC)
MODE_1 = tuple(np.arange(462.0, 527.0, 1.0).tolist())
MODE_3 = tuple(np.arange(940.0, 1061.0, 2.0).tolist())
LEVELS_1, FORCES_1 = (6, 10, 15, 20, 25, 30, 35, 40), (5, 25, 60, 100, 150, 300, 1200)
LEVELS_3, FORCES_3 = (6, 20, 40), (100, 300, 600, 1000, 1500, 2000, 4000, 12000)
AGAIN = ((30, 300), (30, 100))
"""Conditions that are measured once more while the normal force comes down from its highest value."""
CHIRPS = ((1.0, 4), (16.0, 2))
"""Periods in s of the periodic sweeps from 200 to 850 Hz, and how often they are run through."""
CHIRP_LEVEL, CHIRP_FORCE = 30.0, 100.0
"""Force amplitude and normal force in N of the periodic sweeps."""
BAND = (200.0, 1350.0)
"""Hz, of the slow sweep, which goes 20 Hz beyond either end."""

STAY = 400 / SAMPLING_RATE
"""Time in s at each frequency."""
_PAUSE, _REFIT, _WAIT = 20.0, 300.0, 5.0
"""Seconds between two conditions, for another mounting of the beam, and before the end of that for the reading of the
normal force."""
_RING_STEP, _RING_NOISE = 0.5, 0.05
"""Seconds between readings of a load cell, and their scatter in N, to which 5e-4 of the force is added."""
_UNEVEN = (0.02, -0.02)
_WEAR = 1.1
"""Contact stiffness after the joints have seen their highest normal force, over that before."""


@dataclass(frozen=True)
class Condition:
    """One run with the beam: which ``mode``, nominal level and normal force in N, loading sequence, and its times."""

    mode: int
    level: float
    force: float
    sequence: str
    begins: float
    ends: float
    fitted: float

    @property
    def run(self) -> str:
        """Id of the run."""
        down = "_down" if self.sequence == "down" else ""
        return f"mode{self.mode}_FE{self.level:02.0f}_FN{self.force:05.0f}{down}"


def plan(modes: tuple[int, ...] = (1, 3)) -> tuple[Condition, ...]:
    """All runs with the beam in the order in which they are measured; times in s from the start of the campaign."""
    clock, listed = 600.0, []

    def measured(mode: int, level: float, force: float, sequence: str, fitted: float) -> None:
        """One condition, swept from now on."""
        nonlocal clock
        lines = MODE_1 if mode == 1 else MODE_3
        ends = clock + len(lines) * STAY
        listed.append(Condition(mode, level, force, sequence, clock, ends, fitted))
        clock = ends + _PAUSE

    for mode in modes:
        for force in FORCES_1 if mode == 1 else FORCES_3:
            clock += _REFIT
            fitted = clock - _WAIT
            for level in LEVELS_1 if mode == 1 else LEVELS_3:
                measured(mode, level, force, "up", fitted)
        if mode == 1:
            for level, force in AGAIN:
                clock += _REFIT
                measured(1, level, force, "down", clock - _WAIT)
    return tuple(listed)


def pressed(condition: Condition, times: "np.ndarray | float") -> np.ndarray:
    """What presses both joints at times in s: uneven by 2 %, and settling after the bolts were set; (joint, time).

    The lowest force settles by a quarter within a minute, the others by a fiftieth within minutes.
    """
    loss, time = (0.25, 15.0) if condition.force < 10 else (0.02, 120.0)
    settled = 1 + loss * (0.5 - (1 - np.exp(-(np.atleast_1d(times) - condition.fitted) / time)))
    return np.array([condition.force * (1 + part) * settled for part in _UNEVEN])


def generate(setting: table.Setting, modes: tuple[int, ...], chirps: bool) -> Callable[[Path, Progress], str]:
    """A generator of a campaign with ``setting``; it returns what is known about the answer, as TOML."""

    def write(folder: Path, progress: Progress = silent) -> str:
        """The files of all runs; the answer as TOML."""
        points = table.shaker_points(setting)
        _linear(folder / "bare.h5", table.bare(points), 1)
        _linear(folder / "dead_mass.h5", table.with_dead_mass(setting), 2)
        listed = plan(modes)
        for number, condition in enumerate(listed):
            advance(progress, "measuring the virtual table", number, len(listed))
            model = _model(setting, condition)
            store.save(folder / f"{condition.run}.h5", _stepped(model, condition, seed=100 + number))
        if chirps:
            model = table.with_beam(setting, CHIRP_FORCE)
            for place, (period, count) in enumerate(CHIRPS):
                store.save(folder / f"chirp_{period:.0f}s.h5", _chirp(model, period, count, 10 + place))
        write_rings(folder / "rings.csv", listed, pressed, seed=7)
        return (
            f'setting = "{setting.name}"\nbeam_mass = {setting.mass:.4f}  # kg\n'
            f"natural_frequencies = {list(table.FREQUENCIES)}  # Hz, of the bare table\ndamping = {table.DAMPING}\n"
            f"friction_coefficient = {setting.law.friction_coefficient}\n"
            f"contact_stiffness = {setting.law.contact_stiffness:g}  # N/m per joint at 1 kN\n"
        )

    return write


def _model(setting: table.Setting, condition: Condition) -> BeamModel:
    """The table as it is during a run."""
    middle = 0.5 * (condition.begins + condition.ends)
    model = table.with_beam(setting, condition.force).with_normal_force(pressed(condition, middle)[:, 0].tolist())
    if condition.sequence == "down":
        law = setting.law
        model = model.with_law(replace(law, contact_stiffness=_WEAR * law.contact_stiffness))
    return model


def _sensors() -> tuple[Channel, ...]:
    dofs = (Dof(table.DRIVE_NODE, "+Z"), Dof(table.SENSOR_NODE, "+Z"))
    return tuple(
        Channel(f"acc {number}", dof, quantity="acceleration", unit="m/s^2", range=200.0)
        for number, dof in enumerate(dofs, 1)
    )


_FRONT_END = {"noise": {"acceleration": 0.02, "force": 0.02}, "bits": 24, "force_range": 200.0}


def _stepped(model: BeamModel, condition: Condition, seed: int) -> Recording:
    """Steady states, one frequency after the other: the controller records when the structure has settled."""
    lines = MODE_1 if condition.mode == 1 else MODE_3
    drive = SteppedSine(Dof(table.DRIVE_NODE, "+Z"), condition.level, lines, STAY, shaker=SHAKER)
    rig = FrictionRig(model, drive, _sensors(), SAMPLING_RATE, seed=seed, name=condition.run, **_FRONT_END)  # type: ignore[arg-type]
    takes = list(rig.takes())
    whole = replace(takes[0], signals=np.hstack([take.signals for take in takes]))
    return _written(whole, START + timedelta(seconds=condition.begins), condition.run)


def _written(record: Recording, start: datetime, name: str) -> Recording:
    """As the front end stores it: single precision, and without knowing where the sensors sat."""
    channels = tuple(replace(channel, dof=None) for channel in record.channels)
    return replace(record, signals=record.signals.astype(np.float32), channels=channels, start=start, name=name)


def _linear(path: Path, model: ModalModel, seed: int) -> None:
    record = linear_sweep(model, seed, path.stem)
    store.save(path, _written(record, START + timedelta(seconds=100 * seed), path.stem))


def linear_sweep(model: ModalModel, seed: int, name: str, mount_mass: float = SHAKER.mount_mass) -> Recording:
    """A slow sweep over both modes of a table without friction; the load cell also drives the mass below it, kg."""
    drive = SweptShaker(Dof(table.DRIVE_NODE, "+Z"), 20.0, (BAND[0] - 20, BAND[1] + 20), 16.0, 20.0)
    rig = VirtualRig(model, drive, _sensors(), SAMPLING_RATE, seed=seed, name=name, **_FRONT_END)  # type: ignore[arg-type]
    record = rig.take(0)
    signals = np.array(record.signals)
    signals[0] += mount_mass * signals[1]
    return replace(record, signals=signals)


def _chirp(model: BeamModel, period: float, count: int, seed: int) -> Recording:
    """A periodic sweep, found in time."""
    drive = SweptShaker(Dof(table.DRIVE_NODE, "+Z"), CHIRP_LEVEL, (200.0, 850.0), period, period * count, sweeps=count)
    rig = FrictionRig(model, drive, _sensors(), SAMPLING_RATE, seed=seed, name=f"chirp {period:g} s", **_FRONT_END)  # type: ignore[arg-type]
    record = rig.take(0)
    signals = np.array(record.signals)
    signals[0] += SHAKER.mount_mass * signals[1]
    return _written(replace(record, signals=signals), START + timedelta(hours=8, seconds=60 * seed), rig.name)


def write_rings(
    path: Path, listed: Sequence[Any], pressing: Callable[[Any, np.ndarray], np.ndarray], seed: int
) -> None:
    """Both ring cells over the whole campaign, a line twice a second while a run was measured.

    ``pressing(condition, times)`` N (joint, time) presses the joints in a run that ``begins`` and ``ends``.
    """
    rng = np.random.default_rng(seed)
    rows = []
    for condition in listed:
        times = np.arange(condition.begins, condition.ends + 0.1, _RING_STEP)
        reading = pressing(condition, times)
        reading = reading + rng.normal(size=reading.shape) * (_RING_NOISE + 5e-4 * condition.force)
        rows += [f"{t:.1f},{j1:.3f},{j2:.3f}" for t, j1, j2 in zip(times, *reading, strict=True)]
    path.write_text("t [s],J1 [N],J2 [N]\n" + "\n".join(rows) + "\n", encoding="utf-8")
