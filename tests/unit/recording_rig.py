"""A rig for tests of recording: impacts drawn at random, three channels, a few hundred samples, no model behind it."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from acquisition import rig_file
from acquisition.session import Session
from ema.data import Channel, Finding, Recording

RIG = """
[rig]
device = "virtual"
sampling_rate = 1000

[take]
trigger = "hammer > 20 N"
points = [{points}]
takes = {takes}

[[channels]]
name = "hammer"
role = "reference"
unit = "N"
dof = "{{point}}:-Z"

[[channels]]
name = "acc"
role = "response"
unit = "m/s^2"
dof = "1:+Z"
{ring}
"""
RING = """
[[channels]]
name = "ring J1"
role = "normal force"
unit = "N"
joint = "J1"
"""


def rig_folder(folder: Path, points: tuple[int, ...] = (1, 2), takes: int = 3, ring: bool = True) -> Path:
    """A folder with a rig.toml."""
    folder.mkdir(parents=True, exist_ok=True)
    text = RIG.format(points=", ".join(map(str, points)), takes=takes, ring=RING if ring else "")
    (folder / "rig.toml").write_text(text, encoding="utf-8")
    return folder


@dataclass
class DrawnImpacts:
    """A source of impacts whose peaks are drawn, so that every take can be told from every other."""

    seed: int = 0
    ring: bool = True
    most: int = 10_000
    peaks: list[float] = field(default_factory=list)
    closed: bool = False

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Hammer, accelerometer, ring."""
        rows = [Channel("hammer", None, "force", "reference", "N"), Channel("acc", None, "acceleration", unit="m/s^2")]
        ring = Channel("ring J1", None, "force", "normal force", "N", joint="J1")
        return (*rows, ring) if self.ring else tuple(rows)

    @property
    def sampling_rate(self) -> float:
        """Hz."""
        return 1000.0

    def takes(self) -> Iterator[Recording]:
        """One impact after the other."""
        drawn = np.random.default_rng(self.seed)
        for _ in range(self.most):
            peak = float(drawn.uniform(100, 1000))
            signals = 0.01 * drawn.standard_normal((len(self.channels), 300))
            signals[0, 50] = peak
            if self.ring:
                signals[2] += 1000
            self.peaks.append(peak)
            yield Recording(signals, 1000.0, self.channels, start=datetime.now(UTC), name="take")

    def close(self) -> None:
        """Remember it."""
        self.closed = True


def everything(record: Recording) -> tuple[Finding, ...]:
    """Every take counts."""
    return ()


def nothing(record: Recording) -> tuple[Finding, ...]:
    """No take counts."""
    return (Finding("error", "double-hit", "take", "the hammer struck twice."),)


def session(folder: Path, run: str = "beam", judge=everything) -> Session:
    """A session in a folder with a rig.toml."""
    return Session(folder, rig_file.load(folder), run, judge)


def fingerprints(folder: Path) -> dict[str, bytes]:
    """What every take on disk holds, by its path."""
    paths = (path for place in ("raw", "rejected") for path in (folder / place).glob("*.h5"))
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}
