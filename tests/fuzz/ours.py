"""Matrices of finite element programs, campaign files, and our own store."""

import random
import re
import tempfile
import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from acquisition import campaign_file
from acquisition.files import matrices
from ema import store
from ema.data import Channel, Recording
from ema.errors import EmaError
from tests.fuzz.cases import Case, Reading, Signals
from tests.fuzz.mutations import damage, line_damage, noise


@dataclass
class Matrix:
    """A symmetric matrix as text, written from the description of the format."""

    name: str
    suffix: str

    def case(self, draw: random.Random) -> Case:
        """A mutated file."""
        rng = np.random.default_rng(draw.randrange(2**32))
        size = draw.randrange(3, 8)
        dense = np.tril(np.round(rng.normal(size=(size, size)), 6) * (rng.random((size, size)) < 0.6) + np.eye(size))
        kind = draw.choice(("edit", "damage", "noise"))
        if kind == "edit":
            dense[draw.randrange(size), 0] = draw.choice((3.0, -0.5, 1e12))
        lines = (_market if self.name == "market" else _boeing)(dense)
        truth = _as_signals(dense + np.tril(dense, -1).T)
        data = b"\n".join(lines) + b"\n"
        if kind == "edit":
            return Case(data, "edit", "a value", truth)
        if kind == "noise":
            changed, what = noise(draw, data)
            return Case(changed, "noise", what, truth)
        changed_lines, what, place, goal = line_damage(draw, lines, 0, len(lines))
        same = sorted(changed_lines) == sorted(lines)  # entries in another order, as far as the format allows
        blind = "entries or lines exchanged" if same else ""
        if what == "line shortened" and place > 1:
            blind = "digits of a number"
        if self.name == "boeing" and place == 0:
            blind = "a title"
        return Case(b"\n".join(changed_lines) + b"\n", "damage", f"{what} {place} to {goal}", truth, blind)

    def read(self, path: Path) -> Reading:
        """What our reader makes of it."""
        try:
            return Reading(_as_signals(matrices.read_matrix(path)))
        except EmaError as error:
            assert "\n" not in str(error), str(error)
            return Reading(refusal=str(error))

    def independent(self, path: Path) -> list[Signals]:
        """The lines taken apart at blanks (Matrix Market), of Harwell-Boeing the numbers in columns."""
        try:
            return [(_plain_market if self.name == "market" else _plain_boeing)(path.read_bytes().decode("latin-1"))]
        except (ValueError, IndexError):
            return []


def _as_signals(matrix: Any) -> Signals:
    return {"matrix": (np.array(matrix.shape, dtype=float), np.asarray(matrix, dtype=float).reshape(-1))}


def _market(lower: Any) -> list[bytes]:
    rows, columns = np.nonzero(lower)
    entries = [f"{row + 1} {column + 1} {lower[row, column]:.9g}" for row, column in zip(rows, columns)]
    head = ["%%MatrixMarket matrix coordinate real symmetric", f"{len(lower)} {len(lower)} {len(rows)}"]
    return [line.encode() for line in head + entries]


def _plain_market(text: str) -> Signals:
    lines = [line.split() for line in text.splitlines() if line.strip() and not line.startswith("%")]
    size, matrix = int(lines[0][0]), np.zeros((int(lines[0][0]), int(lines[0][1])))
    for row, column, value in lines[1:]:
        matrix[int(row) - 1, int(column) - 1] = float(value)
        if "symmetric" in text.splitlines()[0].lower():
            matrix[int(column) - 1, int(row) - 1] = float(value)
    if len(lines) - 1 != int(lines[0][2]) or size > 100:
        raise ValueError(text[:40])
    return _as_signals(matrix)


def _boeing(lower: Any) -> list[bytes]:
    """Record 1: title, key; 2: numbers of lines; 3: type and sizes; 4: formats (Duff, Grimes, Lewis 1992)."""
    size = len(lower)
    places = [np.flatnonzero(lower[:, column]) for column in range(size)]
    starts = np.cumsum([1, *map(len, places)])
    numbers = [lower[row, column] for column, rows in enumerate(places) for row in rows]

    def rows(items: list[str], per_line: int) -> list[str]:
        return ["".join(items[place : place + per_line]) for place in range(0, len(items), per_line)]

    pointers = rows([f"{start:8d}" for start in starts], 10)
    indices = rows([f"{row + 1:8d}" for part in places for row in part], 10)
    values = rows([f"{number:16.8E}" for number in numbers], 5)
    counts = (len(pointers) + len(indices) + len(values), len(pointers), len(indices), len(values), 0)
    head = [f"{'a matrix':72s}{'KEY':8s}", "".join(f"{count:14d}" for count in counts)]
    head += [
        f"{'RSA':14s}{size:14d}{size:14d}{len(numbers):14d}{0:14d}",
        f"{'(10I8)':16s}{'(10I8)':16s}{'(5E16.8)':20s}",
    ]
    return [line.encode() for line in head + pointers + indices + values]


def _plain_boeing(text: str) -> Signals:
    lines = text.splitlines()
    _, first, second, third, *_ = map(int, lines[1].split())
    size = int(lines[2].split()[1])

    def fields(begin: int, count: int, width: int) -> list[str]:
        body = lines[begin : begin + count]
        return [line[at : at + width] for line in body for at in range(0, len(line.rstrip()), width)]

    starts = [int(field) for field in fields(4, first, 8)]
    places = [int(field) for field in fields(4 + first, second, 8)]
    values = [float(field) for field in fields(4 + first + second, third, 16)]
    if size > 100 or starts[-1] - 1 != len(values) or len(places) != len(values):
        raise ValueError(text[:40])
    matrix = np.zeros((size, size))
    for column in range(size):
        for at in range(starts[column] - 1, starts[column + 1] - 1):
            matrix[places[at] - 1, column] = matrix[column, places[at] - 1] = values[at]
    return _as_signals(matrix)


@cache
def _stored(seed: int) -> tuple[bytes, Any]:
    values = np.random.default_rng(seed).normal(size=(2, 40 + seed))
    channels = (Channel("a", None, "force", "reference", "N"), Channel("b"))
    with tempfile.TemporaryDirectory() as folder:
        store.save(Path(folder) / "a.h5", Recording(values, 100.0, channels), compression="gzip" if seed % 2 else "")
        return (Path(folder) / "a.h5").read_bytes(), values


@dataclass
class Store:
    """Our own files, in which every array and document has a checksum."""

    name: str = "store"
    suffix: str = ".h5"

    def case(self, draw: random.Random) -> Case:
        """A mutated file."""
        data, values = _stored(draw.randrange(6))
        truth = {name: (np.arange(values.shape[1]) / 100.0, row) for name, row in zip("ab", values)}
        kind = draw.choice(("edit", "damage", "damage", "noise", "noise"))
        if kind == "edit":
            return Case(data, "edit", "nothing", truth)
        changed, what = (damage if kind == "damage" else noise)(draw, data)
        # no parser but ours knows the checksums: noise is refused or does no harm, as damage
        return Case(changed, "damage", what, truth)

    def read(self, path: Path) -> Reading:
        """What our store makes of it."""
        try:
            record = store.load(path)
            signals = np.asarray(record.signals)
            axis = np.arange(signals.shape[1]) / record.sampling_rate
            return Reading({channel.name: (axis, row) for channel, row in zip(record.channels, signals)})
        except EmaError as error:
            assert "\n" not in str(error), str(error)
            return Reading(refusal=str(error))

    def independent(self, path: Path) -> list[Signals]:
        """No other parser knows the checksums."""
        return []


_CAMPAIGN = """[campaign]
name = "A table"
files = "data"

[[channels]]
name = "hammer"
role = "reference"
unit = "N"
sensitivity = "2.3 mV/N"
dof = "{point}:+Z"

[[channels]]
name = "acc 1"
unit = "m/s^2"
sensitivity = "100 mV/g"
dof = "1:+Z"

[[joints]]
name = "a"
load_cell = "ring 17"

[[runs]]
id = "bare"
kind = "hammer"
files = ["bare_1.uff", "bare_2.uff"]
temperature = "21.5 degC"

[[runs]]
id = "beam_1kN"
kind = "hammer"
files = "beam.uff"
averages = 5
normal_force = [{joint = "a", value = "1.0 kN", std = "20 N", run_in = 3}]
"""

_EDITS = (
    ('"2.3 mV/N"', ('"2.4 mV/N"', '"11.2 mV/lbf"', '"0.004 V/N"')),
    ('"21.5 degC"', ('"-3 degC"', '"300 K"')),
    ("averages = 5", ("averages = 1", "averages = 1_000", "averages = 0x10")),
    ('"1.0 kN"', ('"1250 N"', "'2 kN'", '"0.5\\u0020kN"')),
    ('"acc 1"', ('"acc 2"', '"Ger\u00e4t 1"')),
    ("[[joints]]", ("# a comment\n[[joints]]", "\r\n[[joints]]")),
)
"""Texts of the campaign, and what may stand there instead."""


@dataclass
class Toml:
    """Campaign files: every key as it stands there, or a sentence for each mistake; the other parser is that of the standard library."""

    name: str = "toml"
    suffix: str = ".toml"

    def case(self, draw: random.Random) -> Case:
        """A mutated campaign file."""
        text, kind = _CAMPAIGN, draw.choice(("edit", "lines", "noise"))
        for old, others in draw.sample(_EDITS, draw.randrange(3)):
            text = text.replace(old, draw.choice(others))
        truth = _keys(tomllib.loads(text))
        data = text.encode()
        if kind == "edit":
            return Case(data, "edit", "values", truth)
        if kind == "noise":
            data, what = noise(draw, data)
        else:
            lines, what, _, _ = line_damage(draw, data.split(b"\n"), 0, data.count(b"\n"))
            data = b"\n".join(lines)
        return Case(data, "noise", what, truth)

    def read(self, path: Path) -> Reading:
        """The keys that are set."""
        try:
            return Reading(_keys(campaign_file.load(path).model_dump(exclude_unset=True)))
        except EmaError as error:
            first, *others = str(error).split("\n")
            said = re.search(r": (\d+) mistakes$", first)
            assert len(others) == (int(said[1]) if said else 0), str(error)
            assert all(re.match(r"\s+line \d+: \S", line) for line in others), str(error)
            assert "Traceback" not in str(error), str(error)
            return Reading(refusal=str(error))

    def independent(self, path: Path) -> list[Signals]:
        """What the standard library reads."""
        try:
            return [_keys(tomllib.loads(path.read_bytes().decode()))]
        except (tomllib.TOMLDecodeError, UnicodeDecodeError):
            return []


def _keys(tree: Any, name: str = "") -> dict[str, tuple[Any, Any]]:
    """Every leaf of a tree as the codes of its text without blanks about it; one file is a list of one table."""
    found: dict[str, tuple[Any, Any]] = {}
    if isinstance(tree, dict):
        for key, value in tree.items():
            if key == "files" and name.startswith("runs"):
                value = value if isinstance(value, list) else [value]
                value = [{"file": item} if isinstance(item, str) else item for item in value]
            found |= _keys(value, f"{name}.{key}".lstrip("."))
        return found
    if isinstance(tree, list):
        for number, value in enumerate(tree):
            found |= _keys(value, f"{name}[{number}]")
        return found
    codes = np.array([ord(letter) for letter in str(tree).strip()], dtype=float)
    return {name: (np.arange(len(codes), dtype=float), codes)}
