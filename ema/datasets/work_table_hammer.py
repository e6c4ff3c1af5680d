"""Hammer campaign on the work table: without a beam, and with a friction beam at three normal forces."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from ema import store
from ema.data import Channel
from ema.datasets import work_table as table
from ema.dof import Dof
from ema.progress import Progress, advance
from ema.simulate import FrictionRig, RovingHammer, VirtualRig
from ema.simulate.rig import Rig

SAMPLING_RATE = 4096.0
"""Hz."""
START = datetime(2026, 3, 20, 8, 0, tzinfo=UTC)
ACCELEROMETERS = (Dof(1, "+Z"), Dof(67, "+Z"))
FORCES = (1000.0, 5000.0, 10000.0)
"""Normal forces of the joints in N."""
PEAK, CONTACT_TIME, HITS, SPACING = 1000.0, 0.8e-3, 2, 0.9
"""Peak force in N and contact time in s of the impacts, how many on a point, and their spacing in s."""
_HOUR = 7200.0
"""Seconds from run to run."""
_SETTLING, _NOISE = 0.012, 2.0
"""Share that settling takes off a normal force within a run, and scatter of its readings in N."""


def run_name(force: float) -> str:
    """Id of the run at a normal force in N."""
    return f"beam_{force / 1000:.0f}kN"


def generate(
    folder: Path, progress: Progress, in_threads: Callable[[Callable[[int], None], int], Iterator[None]]
) -> str:
    """Write the records of all runs and the ring cells; returns what is known about the answer, as TOML."""
    rigs: dict[str, Rig] = {"bare": _rig("bare", None)}
    rigs |= {run_name(force): _rig(run_name(force), force) for force in FORCES}
    done, points = 0, len(table.grid())
    duration = RovingHammer((Dof(1, "-Z"),), hits=HITS, spacing=SPACING).duration
    for number, (name, rig) in enumerate(rigs.items()):
        stem, begins = folder / name, START + timedelta(seconds=number * _HOUR)

        def save(take: int, rig: Rig = rig, stem: Path = stem, begins: datetime = begins) -> None:
            """Measure one take and write it."""
            record = rig.take(take)
            channels = tuple(replace(channel, dof=None) for channel in record.channels)
            start = begins + timedelta(seconds=take * (duration + 15))
            record = replace(record, signals=record.signals.astype(np.float32), channels=channels, start=start)
            store.save(stem.with_name(f"{stem.name}_{take + 1:02d}.h5"), record)

        for _ in in_threads(save, points):
            done += 1
            advance(progress, "measuring the virtual table", done, len(rigs) * points)
    _rings(folder / "rings.csv", points * (duration + 15))
    return (
        f'setting = "{table.CENTRE.name}"\nbeam_mass = {table.CENTRE.mass:.4f}  # kg\n'
        f"natural_frequencies = {list(table.FREQUENCIES)}  # Hz, of the bare table\ndamping = {table.DAMPING}\n"
        f"friction_coefficient = {table.CENTRE.law.friction_coefficient}\n"
        f"peak_force = {PEAK}  # N, mean of the impacts\n"
    )


def _rig(name: str, force: float | None, peak: float = PEAK, points: tuple[int, ...] | None = None) -> Rig:
    """The hammer test at one normal force, or of the bare table."""
    nodes = points or tuple(table.grid())
    drive = RovingHammer(
        tuple(Dof(node, "-Z") for node in nodes),
        hits=HITS,
        peak=peak,
        scatter=0.1,
        contact_time=CONTACT_TIME,
        spacing=SPACING,
    )
    sensors = tuple(
        Channel(f"acc {number}", dof, quantity="acceleration", unit="m/s^2", range=500.0)
        for number, dof in enumerate(ACCELEROMETERS, 1)
    )
    seed = 1 if force is None else 1 + int(force)
    noise = {"acceleration": 0.02, "force": 0.05}
    if force is None:
        model = table.bare(table.grid())
        return VirtualRig(
            model, drive, sensors, SAMPLING_RATE, force_range=5000.0, noise=noise, bits=24, seed=seed, name=name
        )
    truth = table.with_beam(table.CENTRE, force, table.grid())
    return FrictionRig(
        truth, drive, sensors, SAMPLING_RATE, force_range=5000.0, noise=noise, bits=24, seed=seed, name=name
    )


def _rings(path: Path, duration: float) -> None:
    """Ring load cells of both joints over the whole day, in kN: uneven by 1 %, settling by 1.2 % within a run."""
    rng = np.random.default_rng(11)
    rows = []
    for number, force in enumerate(FORCES, 1):
        t = np.arange(0.0, duration, 20.0)
        settled = force * (1 + _SETTLING * (np.exp(-3 * t / duration) - 0.32))
        both = [settled * uneven + rng.normal(size=len(t)) * _NOISE for uneven in (1.01, 0.99)]
        rows += [f"{number * _HOUR + a:.0f},{b / 1e3:.5f},{c / 1e3:.5f}" for a, b, c in zip(t, *both, strict=True)]
    path.write_text("t [s],J1 [kN],J2 [kN]\n" + "\n".join(rows) + "\n", encoding="utf-8")
