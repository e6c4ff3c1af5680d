"""A campaign of four points that is written in a moment, to be spoiled by the tests of bad input."""

import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import acquisition
from ema.data import Channel, FrfSet, ModalModel, Recording, poles_from
from ema.dof import Dof
from ema.simulate import RovingHammer, VirtualRig
from ema.synthesis import frfs as synthesis

FREQUENCIES = (60.0, 105.0, 170.0)
DOFS = tuple(Dof(node, "+Z") for node in range(1, 5))

HAMMER = """
[[channels]]
name = "hammer"
role = "reference"
unit = "N"
dof = "{point}:+Z"

[[channels]]
name = "acc 1"
role = "response"
unit = "m/s^2"
dof = "1:+Z"

[[channels]]
name = "acc 2"
role = "response"
unit = "m/s^2"
dof = "2:+Z"
"""

RUN = """
[[runs]]
id = "bare"
kind = "hammer"
files = "bare_{point}.uff"
"""

COMMAND = (sys.executable, "-c", "import sys; sys.argv[0] = 'ema'; from ema.cli import main; main()")
"""The command as a process of its own."""


@dataclass(frozen=True)
class Ended:
    """How a command ended."""

    status: int
    out: str
    err: str

    def says(self, status: int, *parts: str) -> None:
        """It ended with this status and one sentence that holds all ``parts``."""
        assert self.status == status, self.err or self.out
        assert self.err.startswith("ema: ") and self.err.endswith("\n") and self.err.count("\n") == 1, self.err
        assert "Traceback" not in self.err and "a fault in ema itself" not in self.err
        assert self.out == ""
        for part in parts:
            assert part in self.err, f"{part!r} is not in {self.err!r}"


def ema_command(capsys: pytest.CaptureFixture[str], *arguments: object) -> Ended:
    """The command in this process: quick, and with shapes and types checked."""
    from ema.cli.app import app

    capsys.readouterr()
    with pytest.raises(SystemExit) as ended:
        app([str(argument) for argument in arguments])
    told = capsys.readouterr()
    return Ended(int(ended.value.code or 0), told.out, told.err)


def ema_process(*arguments: object, before: str = "", **options: Any) -> Ended:
    """The command in a process of its own, ``before`` it other code."""
    interpreter, option, code = COMMAND
    ended = subprocess.run(
        [interpreter, option, before + code, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=120,
        **options,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
    )
    return Ended(ended.returncode, ended.stdout, ended.stderr)


@cache
def truth(shift: float = 0.0) -> ModalModel:
    """Three modes at four points; all natural frequencies raised by ``shift`` (relative)."""
    poles = poles_from(np.array(FREQUENCIES) * (1 + shift), np.array([0.012, 0.009, 0.015]))
    shapes = 0.1 * np.array([[1.0, 0.8, 0.6], [0.5, -0.6, -0.9], [-0.2, -1.0, 0.7], [-0.9, 0.9, -0.6]], complex)
    return ModalModel(
        poles=poles,
        shapes=shapes,
        dofs=DOFS,
        participation=shapes[:2] / (2j * poles.imag),
        inputs=DOFS[:2],
        scaling="unit modal mass",
    )


@cache
def records() -> tuple[Recording, ...]:
    """One record per point: the hammer and two accelerometers, three blows."""
    sensors = tuple(Channel(f"acc {n}", DOFS[n - 1], quantity="acceleration", unit="m/s^2") for n in (1, 2))
    drive = RovingHammer(DOFS, hits=3, contact_time=2.5e-3, spacing=1.1, jitter=0.002)
    noise = {"acceleration": 0.001, "force": 0.01}
    return tuple(VirtualRig(truth(), drive, sensors, 1024.0, noise=noise, force_range=2000.0).takes())


def frfs(lines: int = 801, step: float = 0.25) -> FrfSet:
    """The FRFs that a perfect measurement of the same structure gives."""
    return synthesis(truth(), np.arange(lines) * step, outputs=DOFS, inputs=DOFS[:2])


def campaign(folder: Path, measured: Sequence[Recording] | None = None, channels: str = HAMMER, run: str = RUN) -> Path:
    """Write the campaign with a universal file for each record; returns its folder."""
    data = folder / "data"
    data.mkdir(parents=True)
    (folder / "campaign.toml").write_text('[campaign]\nname = "Four points"\nfiles = "data"\n' + channels + run)
    for point, record in enumerate(records() if measured is None else measured, 1):
        acquisition.write(data / f"bare_{point}.uff", record, binary=True)
    return folder


def with_signal(record: Recording, channel: int, signal: Any) -> Recording:
    """The record with other numbers in one channel."""
    from dataclasses import replace

    signals = record.signals.copy()
    signals[channel] = signal
    return replace(record, signals=signals)
