"""Read every file of a folder, and keep of each what a campaign file has to say about it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import acquisition
from ema import store
from ema.data import Geometry
from ema.dof import Dof
from ema.errors import EmaError, InputError
from ema.progress import Progress, advance, silent
from ema.proposal import named_points
from ema.proposal.array_layouts import LevelColumns, described
from ema.proposal.roles import JudgedRecord, judge
from ema.store.reading import containers
from ema.units import UNSTATED

_PASSED_OVER = (
    ".toml",
    ".md",
    ".png",
    ".jpg",
    ".jpeg",
    ".pdf",
    ".html",
    ".docx",
    ".py",
    ".ipynb",
    ".m",
    ".zip",
    ".log",
)
"""Suffixes of files that are no measurements and are not mentioned."""

_SHOWN = 4
"""Arrays of a file that is left out which are named in the reason."""


@dataclass(frozen=True)
class FrfFacts:
    """What a campaign file has to know of the FRFs in a file."""

    outputs: tuple[Dof, ...]
    inputs: tuple[Dof, ...]
    quantity: str
    scaled: bool
    axis: tuple[int, float, float]
    """Lines, lowest and highest frequency in Hz."""


@dataclass(frozen=True)
class FileFacts:
    """What one file holds.

    ``kind`` is ``"records"``, ``"FRFs"``, ``"levels"``, ``"level"``, ``"geometry"``, ``"positions"``,
    ``"named points"``, ``"shapes"``, ``"modes"`` or ``""``; ``reader`` the options of :func:`acquisition.read` that it
    needs; ``reason`` why it is left out. ``length_unit`` is that of the geometry.
    """

    path: str
    kind: str
    reader: Mapping[str, Any] = field(default_factory=dict)
    evidence: str = ""
    record: JudgedRecord | None = None
    rate: float = float("nan")
    samples: int = 0
    frfs: tuple[FrfFacts, ...] = ()
    levels: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    level: LevelColumns | None = None
    positions: Mapping[str, tuple[str, str, str]] = field(default_factory=dict)
    geometry: Geometry | None = None
    length_unit: str = UNSTATED
    needs_rate: bool = False
    several: int = 1
    reason: str = ""


def examine(folder: Path, progress: Progress = silent) -> tuple[FileFacts, ...]:
    """Return what every file in a folder and below it holds; hidden files, texts and pictures are passed over.

    Parameters
    ----------
    folder : Path
        Folder of the measurements.
    progress : Progress, optional
        Called with how many files are read.

    Returns
    -------
    tuple of FileFacts
        In order of the names; files that cannot be read have a ``reason``.

    Raises
    ------
    InputError
        If there is no such folder, or no file in it.
    """
    if not folder.is_dir():
        raise InputError("there is no such folder", where=str(folder), expected="a folder with measurements")
    paths = [path for path in sorted(folder.rglob("*")) if path.is_file() and not _hidden(path.relative_to(folder))]
    paths = [path for path in paths if path.suffix.lower() not in _PASSED_OVER]
    if not paths:
        advice = "`ema formats` lists what can be read"
        raise InputError("no measurements in this folder", where=str(folder), advice=advice)
    facts = []
    for number, path in enumerate(paths):
        advance(progress, "reading the files", number, len(paths))
        facts.append(facts_of(path, path.relative_to(folder).as_posix()))
    advance(progress, "reading the files", len(paths), len(paths))
    return tuple(facts)


def _hidden(path: Path) -> bool:
    return any(part.startswith((".", "_build")) for part in path.parts)


def facts_of(path: Path, label: str) -> FileFacts:
    """Return what one file holds."""
    reader: dict[str, Any] = {}
    evidence, needs_rate = "", False
    try:
        try:
            contents = acquisition.Contents.of(containers(path)) if store.is_store(path) else acquisition.read(path)
        except acquisition.UndescribedError as error:
            if (points := named_points.read(path)) is not None:
                return FileFacts(label, "named points", geometry=points[0], length_unit=points[1])
            guess = described(error)
            if guess.kind in ("levels", "level", "positions", "shapes", ""):
                known = guess.kind in ("levels", "level", "positions")
                return FileFacts(
                    label,
                    guess.kind,
                    evidence=guess.evidence,
                    levels=guess.levels,
                    level=guess.level,
                    positions=guess.positions,
                    reason="" if known else _reason(guess.kind, guess.evidence),
                )
            reader, evidence, needs_rate = dict(guess.reader), guess.evidence, guess.needs_rate
            options = reader | ({"sampling_rate": 1.0} if needs_rate else {})
            contents = acquisition.read(path, **options)
    except EmaError as error:
        return FileFacts(label, "", reason=f"{error.what}{'' if error.got is None else f' ({str(error.got)[:80]})'}")
    damage = [one for one in contents.findings if one.severity == "error"]
    if damage:
        return FileFacts(label, "", reason=f"damaged: {damage[0].message}")
    return _of_contents(label, contents, reader, evidence, needs_rate)


def _reason(kind: str, evidence: str) -> str:
    if kind == "shapes":
        return "mode shapes or frequencies without a measurement; `ema compare` takes them"
    shown = evidence.split("), ")
    several = f"{'), '.join(shown[:_SHOWN])}) and {len(shown) - _SHOWN} more"
    names = several if len(shown) > _SHOWN else evidence
    return (
        f"nothing says what its arrays are: {names}; say it in a run: reader = {{ signals = ..., sampling_rate = ... }}"
    )


def _of_contents(
    label: str, contents: acquisition.Contents, reader: Mapping[str, Any], evidence: str, needs_rate: bool
) -> FileFacts:
    unit = UNSTATED if any(one.code == "unit-unstated" for one in contents.findings) else "m"
    shared: dict[str, Any] = {
        "reader": reader,
        "evidence": evidence,
        "geometry": contents.geometry,
        "length_unit": unit if contents.geometry is not None else UNSTATED,
        "needs_rate": needs_rate,
    }
    if contents.recordings:
        first = contents.recordings[0]
        return FileFacts(
            label,
            "records",
            record=judge(first),
            rate=first.sampling_rate,
            samples=first.signals.shape[1],
            several=len(contents.recordings),
            **shared,
        )
    if contents.frfs:
        frfs = tuple(
            FrfFacts(
                one.outputs,
                one.inputs,
                one.quantity,
                one.scaled,
                (len(one.frequencies), float(one.frequencies[0]), float(one.frequencies[-1])),
            )
            for one in contents.frfs
        )
        return FileFacts(label, "FRFs", frfs=frfs, several=len(frfs), **shared)
    if contents.modes:
        return FileFacts(label, "modes", reason="a modal model; `ema compare` takes it", **shared)
    if contents.geometry is not None:
        return FileFacts(label, "geometry", **shared)
    said = next((one.message for one in contents.findings), "neither records nor FRFs nor a geometry")
    return FileFacts(label, "", reason=said)
