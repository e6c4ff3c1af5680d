"""Built-in campaigns: raw signals too large for version control, written by the virtual rig on first use."""

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import numpy as np

from ema import store
from ema.data import Channel, ModalModel
from ema.datasets import double_beam_release, table, work_table, work_table_hammer, work_table_placed, work_table_shaker
from ema.errors import FailureError, InputError
from ema.progress import Progress, advance, silent
from ema.simulate import Fault, RovingHammer, VirtualRig
from ema.store import atomic

VERSION = 3
"""Raised when a generator changes what it writes; files of an older version are written anew."""

RAW = "raw"
TRUTH = "truth.toml"

_START = datetime(2026, 3, 16, 8, 0, tzinfo=UTC)
_SAMPLING_RATE = 8192.0
"""Hz."""
_FULL_SCALES = (500.0, 200.0)
"""Ranges of the two accelerometers, m/s^2."""
_MEAN_FORCE, _SCATTER, _LOSS = 1020.0, 30.0, 25.0
"""Normal force of a joint in N: mean at the start, scatter of the readings, and what settling takes off by the end."""


def ensure(folder: Path, generator: str, progress: Progress = silent) -> bool:
    """Write the raw files of the built-in campaign in ``folder`` unless they are there; true when they were written.

    The files appear all at once: an interrupted run leaves the folder as it was.

    Raises
    ------
    InputError : there is no generator of that name.
    FailureError : the folder cannot be written.
    """
    if generator not in GENERATORS:
        raise InputError(
            "no such built-in campaign", where=str(folder), got=generator, expected="one of " + ", ".join(GENERATORS)
        )
    if is_generated(folder):
        return False
    atomic.remove_abandoned(folder, ".raw-", "")
    try:
        prefix = f".raw-{atomic.mark()}-"
        with tempfile.TemporaryDirectory(dir=folder, prefix=prefix, ignore_cleanup_errors=True) as scratch:
            target = Path(scratch) / RAW
            target.mkdir()
            GENERATORS[generator](target, progress)
            shutil.rmtree(folder / RAW, ignore_errors=True)
            os.replace(target, folder / RAW)
    except OSError as error:
        raise FailureError(
            "the signals of the built-in campaign cannot be written",
            where=str(folder),
            got=error.strerror or str(error),
            advice="copy the campaign's folder to a place with room and write access, and run it there",
        ) from error
    return True


def is_generated(folder: Path) -> bool:
    """Whether the raw files are there and of this version."""
    import tomllib

    truth = folder / RAW / TRUTH
    if not truth.is_file():
        return False
    try:
        return bool(tomllib.loads(truth.read_text(encoding="utf-8"))["version"] == VERSION)
    except (tomllib.TOMLDecodeError, KeyError):
        return False


def table_hammer(folder: Path, progress: Progress = silent) -> None:
    """Raw signals of the work table, without and with a friction beam: 80 points, 5 impacts each, 2 accelerometers."""
    runs = {
        "bare": (table.bare(), Fault(16, 2, "double hit", strength=0.35, delay=0.022), ("acc 2",)),
        "beam_1kN": (table.with_beam(), Fault(41, 1, "overload", strength=4.0), ()),
    }
    truth = [f'# What the signals were made from.\ngenerator = "virtual_table_hammer"\nversion = {VERSION}\n']
    done, total = 0, len(runs) * table.COLUMNS * table.ROWS
    for number, (run, (model, fault, reversed_sensors)) in enumerate(runs.items()):
        rig = _rig(run, model, fault, reversed_sensors, seed=number + 1)
        for _ in _in_threads(partial(_save, rig, folder / run), rig.drive.takes):
            done += 1
            advance(progress, "measuring the virtual table", done, total)
        truth.append(_truth(run, model, fault, reversed_sensors))
    _write_rings(folder / "rings_beam_1kN.csv", rig.drive.takes * (rig.drive.duration + 15))
    (folder / TRUTH).write_text("\n".join(truth), encoding="utf-8")


def _save(rig: VirtualRig, stem: Path, take: int) -> None:
    """Write one record; the file knows the names of its channels, not where the sensors sat."""
    record = rig.take(take)
    channels = tuple(replace(channel, dof=None) for channel in record.channels)
    record = replace(record, signals=record.signals.astype(np.float32), channels=channels)
    store.save(stem.with_name(f"{stem.name}_{take + 1:02d}.h5"), record)


def _in_threads(work: Callable[[int], None], count: int) -> Iterator[None]:
    """Do ``work(0) ... work(count - 1)`` on all cores, and report after each; nothing new is begun after a failure."""
    pool = ThreadPoolExecutor(os.cpu_count())
    try:
        yield from pool.map(work, range(count))
    finally:
        pool.shutdown(cancel_futures=True)


def work_table_hammer_campaign(folder: Path, progress: Progress = silent) -> None:
    """Raw signals of the work table of the paper: bare, and with a friction beam at 1, 5 and 10 kN."""
    _told(folder, "work_table_hammer", work_table_hammer.generate(folder, progress, _in_threads))


def work_table_placed_campaign(folder: Path, progress: Progress = silent) -> None:
    """Raw signals of the bare work table by hammer, and of the table with the beam where it was said to go."""
    _told(folder, "work_table_placed", work_table_placed.generate(folder, progress, _in_threads))


def double_beam_release_campaign(folder: Path, progress: Progress = silent) -> None:
    """Raw signals of the double beam of the paper, released at its tip under several normal forces."""
    _told(folder, "double_beam_release", double_beam_release.generate(folder, progress))


def _shaker_campaign(
    name: str, setting: work_table.Setting, modes: tuple[int, ...]
) -> Callable[[Path, Progress], None]:
    """Generator of a shaker campaign of the work table."""
    write = work_table_shaker.generate(setting, modes, chirps=1 in modes)

    def campaign(folder: Path, progress: Progress = silent) -> None:
        _told(folder, name, write(folder, progress))

    return campaign


def _told(folder: Path, name: str, truth: str) -> None:
    head = f'# What the signals were made from.\ngenerator = "{name}"\nversion = {VERSION}\n'
    (folder / TRUTH).write_text(head + truth, encoding="utf-8")


GENERATORS: dict[str, Callable[[Path, Progress], None]] = {
    "double_beam_release": double_beam_release_campaign,
    "virtual_table_hammer": table_hammer,
    "work_table_hammer": work_table_hammer_campaign,
    "work_table_placed": work_table_placed_campaign,
    "work_table_absorber": _shaker_campaign("work_table_absorber", work_table.ABSORBER, (1, 3)),
    "work_table_bending": _shaker_campaign("work_table_bending", work_table.BENDING, (1, 3)),
    "work_table_rough": _shaker_campaign("work_table_rough", work_table.ROUGH, (3,)),
}


def _rig(run: str, model: ModalModel, fault: Fault, reversed_sensors: tuple[str, ...], seed: int) -> VirtualRig:
    drive = RovingHammer(
        tuple(dof.reversed() for dof in table.dofs()), contact_time=0.4e-3, faults=(fault,), spacing=1.1
    )
    sensors = tuple(
        Channel(f"acc {number}", dof, quantity="acceleration", unit="m/s^2", range=full_scale)
        for number, (dof, full_scale) in enumerate(zip(table.ACCELEROMETERS, _FULL_SCALES, strict=True), 1)
    )
    return VirtualRig(
        model,
        drive,
        sensors,
        _SAMPLING_RATE,
        force_range=2500.0,
        noise={"acceleration": 0.05, "force": 0.05},
        bits=24,
        reversed_sensors=reversed_sensors,
        seed=seed,
        start=_START.replace(hour=8 + 2 * seed),
        name=run,
    )


def _write_rings(path: Path, duration: float) -> None:
    """Ring load cells of both joints over the run, one line every ten seconds: mean 1.02 kN, scatter 0.03 kN, and the
    slow loss of a bolted joint that settles."""
    rng = np.random.default_rng(9)
    t = np.arange(0, duration, 10.0)
    columns = []
    for _ in range(2):
        settling = -_LOSS * (1 - np.exp(-3 * t / duration))
        trace = settling + rng.normal(size=len(t)) * _SCATTER
        trace = (trace - trace.mean()) / trace.std(ddof=1)
        columns.append(_MEAN_FORCE + _SCATTER * trace)
    rows = [f"{time:.1f},{j1 / 1000:.5f},{j2 / 1000:.5f}" for time, j1, j2 in zip(t, *columns, strict=True)]
    path.write_text("t [s],J1 [kN],J2 [kN]\n" + "\n".join(rows) + "\n", encoding="utf-8")


def _truth(run: str, model: ModalModel, fault: Fault, reversed_sensors: tuple[str, ...]) -> str:
    """The known answers of one run as TOML."""
    frequencies = ", ".join(f"{f:.4f}" for f in model.natural_frequencies)
    damping = ", ".join(f"{zeta:.6f}" for zeta in model.damping_ratios)
    names = ", ".join(f'"{name}"' for name in reversed_sensors)
    return (
        f"[runs.{run}]\nnatural_frequencies = [{frequencies}]  # Hz\ndamping_ratios = [{damping}]\n"
        f'fault = {{ kind = "{fault.kind}", point = {fault.take + 1}, hit = {fault.hit + 1} }}\n'
        f"reversed_sensors = [{names}]\n"
    )
