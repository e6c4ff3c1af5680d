"""FRFs in text: a row of three cells for each frequency line, as SignalCalc exports them and under titles of a table."""

import random
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.cases import Case, Reading, Signals, channels, reading
from tests.fuzz.mutations import line_damage, noise


@dataclass
class SignalCalc:
    """An accelerance, as real and imaginary part or in decibels and degrees; every row ends in a tab."""

    name: str = "signalcalc"
    suffix: str = ".txt"
    dofs: str = "2:+Z/1:+Z"
    closed: bool = True

    def head(self, polar: bool) -> list[str]:
        """Units, DOFs, titles."""
        titles = "Magnitude (dB)\t Phase (deg)" if polar else "Real\t Imaginary"
        units = "dB re 1 (m/s^2)/N\tdeg" if polar else "(m/s\u00b2)(N)\t "
        head = ["Units: Ratio\t", "Ref Chan:Resp Chan\t1+Z:2+Z\t", "Channel Name\t : \t", "Channel Comment\t : \t"]
        return [*head, "\t", f"Frequency\t {titles}\t", "\t", "Units:\t", f"Hz\t{units}\t", "\t"]

    def lines(self, pairs: Any, first: float, step: float, polar: bool) -> list[bytes]:
        """The whole file."""
        end = "\t" if self.closed else ""
        rows = [f"{first + k * step:.6f}\t {a:.9g}\t {b:.9g}{end}" for k, (a, b) in enumerate(pairs)]
        return [text.encode() for text in self.head(polar) + rows]

    def case(self, draw: random.Random) -> Case:
        """A mutated file."""
        rng = np.random.default_rng(draw.randrange(2**32))
        count, step, polar = draw.randrange(20, 60), draw.choice((0.25, 1.0, 3.125)), draw.random() < 0.3
        pairs = rng.normal(size=(count, 2))
        if polar:
            pairs = np.stack([rng.uniform(-60, 20, count), rng.uniform(-180, 180, count)], axis=1)
        pairs = np.array([[float(f"{x:.9g}") for x in row] for row in pairs])
        first = draw.choice((0, 5)) * step
        kind = draw.choice(("edit", "damage", "damage", "noise"))
        if kind == "edit":
            pairs[draw.randrange(count), draw.randrange(2)] = draw.choice((0.0, -3.25, 17.5))
        truth = {self.dofs: (first + step * np.arange(count), _complex(pairs, polar))}
        whole, head = self.lines(pairs, first, step, polar), len(self.head(polar))
        if kind == "edit":
            end = draw.choice((b"\n", b"\r\n"))
            return Case(end.join(whole) + draw.choice((end, b"")), "edit", "a value", truth)
        if kind == "noise":
            data, what = noise(draw, b"\n".join(whole) + b"\n")
            return Case(data, "noise", what, truth, "" if data.startswith(b"\n".join(whole[:head])) else "the header")
        changed, what, place, goal = line_damage(draw, whole, head, len(whole))
        if what == "line moved" and goal == place:
            return Case(b"\n".join(whole) + b"\n", "edit", "nothing", truth)
        last, blind = len(whole) - 1, ""
        if what in ("line lost", "line blanked") or (what == "line shortened" and not changed[place].strip()):
            blind = {head: "rows lost in front of the first", last: "rows lost at the end"}.get(place, "")
        elif what == "line shortened" and changed[place].count(b"\t") == 2 and not self.closed:
            blind = "a number cut at the end of its row"
        return Case(b"\n".join(changed) + b"\n", "damage", f"{what} {place - head} to {goal - head}", truth, blind)

    def read(self, path: Path) -> Reading:
        """What our reader makes of it."""
        return reading(path, channels)

    def independent(self, path: Path) -> list[Signals]:
        """The rows behind the header, taken apart at the tabs, and at any blank."""
        lines = [line.strip() for line in path.read_bytes().decode("latin-1").splitlines()]
        polar, found = any("Magnitude (dB)" in line for line in lines), []
        for mark in ("\t", None):
            try:
                rows = [[float(cell) for cell in line.split(mark)] for line in lines[len(self.head(polar)) :] if line]
                frequencies, pairs = np.array(rows)[:, 0], np.array(rows)[:, 1:3]
                found.append({self.dofs: (frequencies, _complex(pairs, polar))})
            except (ValueError, IndexError):
                continue
        return found


@dataclass
class FrfTable(SignalCalc):
    """The same as a table under titles."""

    name: str = "frf-table"
    suffix: str = ".csv"
    dofs: str = "1:S/1:S"
    closed: bool = False

    def head(self, polar: bool) -> list[str]:
        """Titles."""
        return ["Frequency [Hz]\tMagnitude (dB)\tPhase (deg)" if polar else "Frequency [Hz]\tReal\tImaginary"]

    def read(self, path: Path) -> Reading:
        """What our reader makes of it."""
        return reading(path, channels, amplitude_unit="dB re 1 (m/s^2)/N")


def _complex(pairs: Any, polar: bool) -> Any:
    with np.errstate(all="ignore"):
        return (
            10 ** (pairs[:, 0] / 20) * np.exp(1j * np.radians(pairs[:, 1])) if polar else pairs[:, 0] + 1j * pairs[:, 1]
        )
