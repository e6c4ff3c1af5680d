"""A placement put to the test: hammer test of the bare work table, then the beam where it was said to go, by shaker."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from ema import store
from ema.data import Channel, FrictionLaw, ModalModel, Recording
from ema.datasets import work_table as table
from ema.datasets import work_table_shaker as shaker
from ema.dof import Dof
from ema.progress import Progress, advance
from ema.simulate import FrictionRig, RovingHammer, SteppedSine, VirtualRig

SETTING = table.PLACED
START = datetime(2026, 4, 13, 8, 0, tzinfo=UTC)
LEVELS, FORCES = (15, 30, 60), (50, 110, 240)
MODE_1 = tuple(np.arange(474.0, 512.0, 1.0).tolist())
MODE_3 = tuple(np.arange(966.0, 1051.0, 2.0).tolist())
HITS, PEAK, CONTACT_TIME, SPACING = 2, 500.0, 0.4e-3, 0.9
"""Impacts on a point, their peak force in N, contact time in s and spacing in s."""
SAMPLING_RATE = 8192.0
"""Of the hammer test, whose impacts reach beyond 2 kHz."""
_DAY, _PAUSE, _REFIT, _WAIT = 86400.0, 20.0, 300.0, 5.0
"""Seconds of a day, between two conditions, for another mounting of the beam, and before the end of that for the
reading of the normal force."""
_SETTLING, _TIME, _UNEVEN = 0.02, 120.0, (0.02, -0.02)
_BITS = 12
_SENSORS = {table.DRIVE_NODE: 0.01, table.SENSOR_NODE: 0.01}
"""Masses of the accelerometers in kg by node: they stay in place on both days."""
_MOUNT = 0.05
"""kg between load cell and table; the controller holds what the load cell reads."""
_OF_FRICTION, _OF_STIFFNESS = 0.03, 0.06
"""Scatter of the friction coefficient and of the contact stiffness between assemblies, relative."""


@dataclass(frozen=True)
class Condition:
    """One run with the beam: mode, nominal level and normal force in N, and its times in s from the start."""

    mode: int
    level: float
    force: int
    begins: float
    ends: float
    fitted: float

    @property
    def run(self) -> str:
        """Id of the run."""
        return f"mode{self.mode}_FE{self.level:02.0f}_FN{self.force:04.0f}"

    @property
    def lines(self) -> tuple[float, ...]:
        """Frequencies in Hz."""
        return MODE_1 if self.mode == 1 else MODE_3


def points() -> dict[int, tuple[float, float]]:
    """What the hammer strikes: the grid, and the places of the two accelerometers."""
    return table.grid() | table.shaker_points(SETTING)


def plan() -> tuple[Condition, ...]:
    """All runs with the beam, the day after the hammer test, in the order in which they are measured."""
    clock, listed = _DAY + 600.0, []
    for force in FORCES:
        clock += _REFIT
        fitted = clock - _WAIT
        for mode, lines in ((1, MODE_1), (3, MODE_3)):
            for level in LEVELS:
                ends = clock + len(lines) * shaker.STAY
                listed.append(Condition(mode, level, force, clock, ends, fitted))
                clock = ends + _PAUSE
    return tuple(listed)


def pressed(condition: Condition, times: "np.ndarray | float") -> np.ndarray:
    """What presses the joints at times in s, (joint, time): uneven by 2 %, settling by 2 % after the bolts were set."""
    settled = 1 + _SETTLING * (0.5 - (1 - np.exp(-(np.atleast_1d(times) - condition.fitted) / _TIME)))
    return np.array([condition.force * (1 + part) * settled for part in _UNEVEN])


def law_of(force: int) -> FrictionLaw:
    """Friction of the joints in the assembly with a nominal normal force in N."""
    law, draw = SETTING.law, np.random.default_rng([23, force]).standard_normal(2)
    return replace(
        law,
        friction_coefficient=law.friction_coefficient * (1 + _OF_FRICTION * draw[0]),
        contact_stiffness=law.contact_stiffness * (1 + _OF_STIFFNESS * draw[1]),
    )


def generate(
    folder: Path, progress: Progress, in_threads: Callable[[Callable[[int], None], int], Iterator[None]]
) -> str:
    """Write the records of all runs and the ring cells; returns what is known about the answer, as TOML."""
    rig, listed = _hammer(), plan()
    total = rig.drive.takes + len(listed)

    def struck(take: int) -> None:
        record = rig.take(take)
        _save(folder / f"bare_{take + 1:02d}.h5", record, START + timedelta(seconds=take * (rig.drive.duration + 15)))

    def swept(number: int) -> None:
        condition = listed[number]
        _save(
            folder / f"{condition.run}.h5",
            _stepped(condition, 300 + number),
            START + timedelta(seconds=condition.begins),
        )

    done = 0
    for work, count in ((struck, rig.drive.takes), (swept, len(listed))):
        for _ in in_threads(work, count):
            done += 1
            advance(progress, "measuring the virtual table", done, total)
    _bare_sweep(folder / "bare_sweep.h5")
    shaker.write_rings(folder / "rings.csv", listed, pressed, seed=17)
    model = rig.model
    return (
        f'setting = "{SETTING.name}"\nbeam_mass = {SETTING.mass:.4f}  # kg\nmiddle = {list(SETTING.middle)}  # m\n'
        f"natural_frequencies = {_rounded(model.natural_frequencies)}  # Hz, of the bare table with its sensors\n"
        f"damping = {_rounded(model.damping_ratios)}\n"
        f"friction_coefficient = {SETTING.law.friction_coefficient}\n"
        f"contact_stiffness = {SETTING.law.contact_stiffness:g}  # N/m per joint at 1 kN\n"
    )


def _rounded(values: np.ndarray) -> list[float]:
    """The four modes of the paper."""
    rigid = len(table.SUSPENSION)
    return [round(float(value), 6) for value in values[rigid : rigid + len(table.FREQUENCIES)]]


def _bare(mount: float = 0.0) -> ModalModel:
    """The bare table with its sensors, and with the mass below the load cell."""
    masses = _SENSORS | {table.DRIVE_NODE: _SENSORS[table.DRIVE_NODE] + mount}
    return table.with_masses(table.bare(points(), damping=SETTING.host_damping), masses)


def _hammer() -> VirtualRig:
    """The hammer test of the bare table."""
    drive = RovingHammer(
        tuple(Dof(node, "-Z") for node in points()),
        hits=HITS,
        peak=PEAK,
        scatter=0.1,
        contact_time=CONTACT_TIME,
        spacing=SPACING,
    )
    return VirtualRig(
        _bare(),
        drive,
        _sensors(100.0),
        SAMPLING_RATE,
        force_range=1000.0,
        noise={"acceleration": 0.05, "force": 0.2},
        bits=_BITS,
        seed=31,
        name="bare",
    )


def _sensors(full_scale: float) -> tuple[Channel, ...]:
    nodes = (table.DRIVE_NODE, table.SENSOR_NODE)
    return tuple(
        Channel(f"acc {number}", Dof(node, "+Z"), quantity="acceleration", unit="m/s^2", range=full_scale)
        for number, node in enumerate(nodes, 1)
    )


def _stepped(condition: Condition, seed: int) -> Recording:
    """Steady states of the table with the beam, one frequency after the other; the controller holds the force."""
    middle = 0.5 * (condition.begins + condition.ends)
    masses = _SENSORS | {table.DRIVE_NODE: _SENSORS[table.DRIVE_NODE] + _MOUNT}
    model = table.with_beam(SETTING, condition.force, masses=masses).with_law(law_of(condition.force))
    model = model.with_normal_force(pressed(condition, middle)[:, 0].tolist())
    drive = SteppedSine(Dof(table.DRIVE_NODE, "+Z"), condition.level, condition.lines, shaker.STAY)
    rig = FrictionRig(
        model,
        drive,
        _sensors(200.0),
        shaker.SAMPLING_RATE,
        force_range=200.0,
        noise={"acceleration": 0.05, "force": 0.05},
        bits=_BITS,
        seed=seed,
        name=condition.run,
    )
    takes = list(rig.takes())
    return replace(takes[0], signals=np.hstack([take.signals for take in takes]))


def _bare_sweep(path: Path) -> None:
    """The bare table by the same shaker: what a map of the beam is compared with."""
    record = shaker.linear_sweep(_bare(_MOUNT), 41, path.stem, mount_mass=0.0)
    _save(path, record, START + timedelta(seconds=_DAY))


def _save(path: Path, record: Recording, start: datetime) -> None:
    """As the front end stores it: single precision, and without knowing where the sensors sat."""
    channels = tuple(replace(channel, dof=None) for channel in record.channels)
    store.save(path, replace(record, signals=record.signals.astype(np.float32), channels=channels, start=start))
