"""Text tables, LabVIEW text and JSON, with the line or cell that was damaged."""

import json
import random
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.cases import Case, Reading, Signals, channels, reading
from tests.fuzz.mutations import damage, line_damage, noise

STEP = 0.01


def signals(draw: random.Random) -> Any:
    """Two channels of some samples, as a text with six digits holds them."""
    rng = np.random.default_rng(draw.randrange(2**32))
    values = rng.normal(size=(2, draw.randrange(20, 60))) * 10.0 ** rng.integers(-3, 4)
    return np.array([[float(f"{x:.6g}") for x in row] for row in values])


def truth(values: Any, names: tuple[str, str] = ("a", "b")) -> Signals:
    """Channels at a hundred samples per second."""
    axis = STEP * np.arange(values.shape[1])
    return dict(zip(names, ((axis, row) for row in values), strict=True))


@dataclass
class Table:
    """Text tables with a time column, in three dialects."""

    name: str = "table"
    suffix: str = ".csv"

    def case(self, draw: random.Random) -> Case:
        """A mutated table."""
        values = signals(draw)
        mark, point = draw.choice(((",", "."), (";", ","), ("\t", ".")))

        def lines(values: Any) -> list[bytes]:
            head = [mark.join(("t [s]", "a [N]", "b [m/s^2]"))]
            rows = [
                mark.join((f"{STEP * k:.2f}", *(f"{x:.6g}" for x in column))).replace(".", point)
                for k, column in enumerate(values.T)
            ]
            return [text.encode() for text in head + rows]

        kind = draw.choice(("edit", "damage", "damage", "noise"))
        whole = lines(values)
        if kind == "edit":
            edited = values.copy()
            edited[draw.randrange(2), draw.randrange(values.shape[1])] = draw.choice((0.0, -3.25, 1e-12, 7.5e8))
            end = draw.choice((b"\n", b"\r\n"))
            return Case(end.join(lines(edited)) + draw.choice((end, b"")), "edit", "a value", truth(edited))
        if kind == "noise":
            data, what = noise(draw, b"\n".join(whole) + b"\n")
            return Case(data, "noise", what, truth(values), "" if data.startswith(whole[0] + b"\n") else "titles")
        if draw.random() < 0.3:
            return self._cells(draw, whole, mark, values)
        changed, what, place, goal = line_damage(draw, whole, 0, len(whole))
        blind = ""
        last = len(whole) - 1
        if place == last and what in ("line lost", "line blanked"):
            blind = "rows lost at the end"
        elif place == 1 and what in ("line lost", "line blanked"):
            blind = "rows lost in front of the first"
        elif place == 0:
            blind = "titles lost"
        elif what == "line shortened" and changed[place].count(mark.encode()) == 2:
            blind = "a number cut at the end of its row"
        elif what == "line shortened" and place in (1, last) and not changed[place]:
            blind = "rows lost at the end" if place == last else "rows lost in front of the first"
        elif what == "line moved" and goal == place:
            return Case(b"\n".join(whole) + b"\n", "edit", "nothing", truth(values))
        return Case(b"\n".join(changed) + b"\n", "damage", f"{what} {place} to {goal}", truth(values), blind)

    def _cells(self, draw: random.Random, lines: list[bytes], mark: str, values: Any) -> Case:
        """A cell lost or doubled in a row."""
        place = draw.randrange(1, len(lines))
        cells = lines[place].split(mark.encode())
        column = draw.randrange(3)
        how = draw.choice(("lost", "doubled", "emptied", "text"))
        if how == "lost":
            del cells[column]
        elif how == "doubled":
            cells.insert(column, cells[column])
        else:
            cells[column] = b"" if how == "emptied" else b"overload"
        changed = [*lines[:place], mark.encode().join(cells), *lines[place + 1 :]]
        what = f"cell {column} of row {place} {how}"
        expected = values.copy()
        if how == "emptied" and column:
            expected[column - 1, place - 1] = np.nan  # which is named
        return Case(b"\n".join(changed) + b"\n", "damage", what, truth(expected))

    def read(self, path: Path) -> Reading:
        """What our reader makes of it."""
        return reading(path, channels)

    def independent(self, path: Path) -> list[Signals]:
        """What pandas makes of it in each dialect; lines end where Unicode has them end, as at a vertical tabulator."""
        import pandas

        text, found = "\n".join(path.read_bytes().decode("latin-1").splitlines()), []
        for mark, point in ((",", "."), (";", ","), ("\t", ".")):
            try:
                table = pandas.read_csv(StringIO(text), sep=mark, decimal=point, dtype=np.float64)
                values = table.to_numpy()
                if values.shape[1] < 2:
                    continue
                step = (values[-1, 0] - values[0, 0]) / (len(values) - 1)
                names = [str(name).partition(" [")[0] for name in table.columns[1:]]
                axis = step * np.arange(len(values))
                found.append({name: (axis, values[:, column + 1]) for column, name in enumerate(names)})
            except Exception:
                continue
        return found


@dataclass
class Lvm(Table):
    """LabVIEW measurement text: the header announces the samples."""

    name: str = "lvm"
    suffix: str = ".lvm"

    def case(self, draw: random.Random) -> Case:
        """A mutated file."""
        values = signals(draw)
        whole = self._lines(values)
        kind = draw.choice(("edit", "damage", "damage", "noise"))
        if kind == "edit":
            edited = values.copy()
            edited[draw.randrange(2), draw.randrange(values.shape[1])] = draw.choice((0.0, -3.25, 1e-12, 7.5e8))
            return Case(b"\r\n".join(self._lines(edited)) + b"\r\n", "edit", "a value", truth(edited))
        if kind == "noise":
            data, what = noise(draw, b"\n".join(whole) + b"\n")
            head = b"\n".join(whole[: whole.index(b"X_Value\ta\tb\tComment")])
            return Case(data, "noise", what, truth(values), "" if head in data else "the header of a text")
        first = whole.index(b"X_Value\ta\tb\tComment") + 1
        changed, what, place, goal = line_damage(draw, whole, first, len(whole))
        blind = ""
        if what == "line shortened" and changed[place].count(b"\t") == 2:
            blind = "a number cut at the end of its row"
        if what == "line moved" and goal == place:
            return Case(b"\n".join(whole) + b"\n", "edit", "nothing", truth(values))
        return Case(
            b"\n".join(changed) + b"\n", "damage", f"{what} {place - first} to {goal - first}", truth(values), blind
        )

    def _lines(self, values: Any) -> list[bytes]:
        count = values.shape[1]
        head = [
            "LabVIEW Measurement\t",
            "Writer_Version\t2",
            "Reader_Version\t2",
            "Separator\tTab",
            "Decimal_Separator\t.",
            "Multi_Headings\tNo",
            "X_Columns\tOne",
            "Time_Pref\tAbsolute",
            "***End_of_Header***\t",
            "\t",
            "Channels\t2\t",
            f"Samples\t{count}\t{count}\t",
            "Y_Unit_Label\tN\tm/s^2\t",
            "X_Dimension\tTime\tTime\t",
            "X0\t0.0\t0.0\t",
            f"Delta_X\t{STEP}\t{STEP}\t",
            "***End_of_Header***\t\t",
            "X_Value\ta\tb\tComment",
        ]
        rows = ["\t".join((f"{STEP * k:.2f}", *(f"{x:.6g}" for x in column))) for k, column in enumerate(values.T)]
        return [text.encode() for text in head + rows]

    def independent(self, path: Path) -> list[Signals]:
        """The rows behind the titles, taken apart at the tabs, at the stated step."""
        try:
            lines = path.read_bytes().decode("latin-1").splitlines()
            at = next(k for k, line in enumerate(lines) if line.startswith("X_Value"))
            step = float(next(line for line in lines if line.startswith("Delta_X")).split("\t")[1])
            rows = np.array([[float(cell) for cell in line.split("\t")[:3]] for line in lines[at + 1 :]])
            names = lines[at].split("\t")[1:3]
        except (ValueError, StopIteration, IndexError):
            return []
        axis = step * np.arange(len(rows))
        return [{name: (axis, rows[:, column + 1]) for column, name in enumerate(names)}]


@dataclass
class Json:
    """JSON with two arrays."""

    name: str = "json"
    suffix: str = ".json"
    options: dict[str, Any] = field(default_factory=lambda: {"signals": ["a", "b"], "sampling_rate": 1 / STEP})

    def case(self, draw: random.Random) -> Case:
        """A mutated file."""
        values = signals(draw)
        kind = draw.choice(("edit", "damage", "noise"))
        if kind == "edit":
            values[draw.randrange(2), draw.randrange(values.shape[1])] = draw.choice((0.0, -3.25, 1e-12, 7.5e8))
            indent = draw.choice((None, 1))
            return Case(
                json.dumps(dict(zip("ab", values.tolist())), indent=indent).encode(), "edit", "value", truth(values)
            )
        data, what = (damage if kind == "damage" else noise)(
            draw, json.dumps(dict(zip("ab", values.tolist()))).encode()
        )
        blind = "digits of a number" if kind == "damage" else ""
        return Case(data, kind, what, truth(values), blind)

    def read(self, path: Path) -> Reading:
        """What our reader makes of it."""
        return reading(path, channels, **self.options)

    def independent(self, path: Path) -> list[Signals]:
        """What the standard library makes of it."""
        try:
            tree = json.loads(path.read_bytes().decode("utf-8", "replace"))
            return [{name: (STEP * np.arange(len(tree[name])), np.array(tree[name], dtype=float)) for name in "ab"}]
        except (ValueError, TypeError, KeyError):
            return []
