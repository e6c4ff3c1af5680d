"""What parameters of a joint and quantities of statements are called in front of people, with the unit shown."""

import re
from dataclasses import dataclass
from math import floor, isfinite, log10

from ema.messages import mark, text, word


@dataclass(frozen=True)
class Shown:
    """How a number is shown: its name and meaning, its unit, and the factor from SI to that unit."""

    name: str
    unit: str = ""
    factor: float = 1.0
    meaning: str = ""

    def interval(self, ends: tuple[float, float]) -> str:
        """``0.057 to 0.25`` with its unit."""
        low, high = self.ends(ends)
        return with_unit(text("{low} to {high}", low=low, high=high), self.unit)

    def ends(self, ends: tuple[float, float]) -> tuple[str, str]:
        """Both ends of an interval in the unit shown, each with two digits of itself and of the width at least.

        Further digits are of the random numbers: the ends of a 95 % interval of 1000 draws scatter by 5 % of its width.
        """
        low, high = (self.factor * end for end in ends)
        first, last = (_digits(end, high - low) for end in (low, high))
        return first, last


def _digits(value: float, width: float) -> str:
    sizes = [abs(x) for x in (value, width) if x != 0 and isfinite(x)]
    decimals = max((1 - floor(log10(size)) for size in sizes), default=0)
    return f"{round(value, decimals):.{max(0, decimals)}f}"


def with_unit(number: str, unit: str) -> str:
    """A number and its unit, which no line breaks apart."""
    return f"{number}\u00a0{unit}" if unit else number


def probability(value: float) -> str:
    """A probability with two decimals, a small one with one digit."""
    return f"{value:.2f}" if value >= 0.01 else f"{value:.1g}"


_PARAMETERS = {
    "friction coefficient": (mark("friction coefficient"), "", 1.0, mark("µ of the contacts")),
    "exponent of k_T": (mark("exponent of k_T"), "", 1.0, mark("of the contact stiffness over the normal force")),
    "loss factor": (mark("loss factor"), "", 1.0, mark("of the sticking contacts")),
    "drop by the mass": (
        mark("drop by the mass"),
        "%",
        100.0,
        mark("of the frequency with sliding joints, by the mass of the beam"),
    ),
    "added damping": (mark("added damping"), "%", 100.0, mark("damping ratio that the beam adds without friction")),
    "stiffness ratio at 1 kN": (
        mark("stiffness ratio at 1 kN"),
        "",
        1.0,
        mark("of the contacts, over the stiffness of the mode with sliding joints"),
    ),
    "stiffness ratio in series": (
        mark("stiffness ratio in series"),
        "",
        1.0,
        mark("of the beam in series with the contacts, over the stiffness of the mode with sliding joints"),
    ),
    "shape over slip": (
        mark("shape over slip"),
        "",
        1.0,
        mark("mode shape where it is excited over slip of the joint"),
    ),
    "lift-off force over excitation": (
        mark("lift-off force over excitation"),
        "",
        1.0,
        mark("normal force below which the beam leaves the structure, over the force of the shaker"),
    ),
    "share of the mass carried at F_N = 0": (
        mark("share of the mass carried at F_N = 0"),
        "",
        1.0,
        mark("of the beam, by other means than the joints"),
    ),
    "peak force": (mark("peak force"), "N", 1.0, mark("of the impacts")),
    "peak force over friction coefficient": (
        mark("peak force over friction coefficient"),
        "N",
        1.0,
        mark("what a hammer test of unknown level says of both"),
    ),
    "shape over slip over friction coefficient": (
        mark("shape over slip over friction coefficient"),
        "",
        1.0,
        mark("what a shaker test at an unknown place says of both"),
    ),
}
_QUANTITIES = {
    "frequency [Hz]": (mark("frequency"), "Hz", 1.0),
    "damping ratio": (mark("damping ratio"), "%", 100.0),
    "stuck frequency": (mark("frequency at the highest normal force"), "Hz", 1.0),
    "ridge": (mark("normal force at which damping is highest"), "N", 1.0),
    "peak level": (mark("excitation at which damping is highest"), "N", 1.0),
    "most damping": (mark("highest damping ratio over the excitation"), "%", 100.0),
    "fall": (mark("damping at the highest excitation over that at this one"), "", 1.0),
    "drop": (mark("frequency at most damping less that at the highest normal force"), "Hz", 1.0),
    "stuck damping": (mark("damping over the highest at any normal force"), "", 1.0),
}
_TESTS = {"hammer": mark("hammer"), "shaker": mark("shaker")}
_NORMAL_FORCE = re.compile(r"(?:F_N )?([\d.e+]+) N")
_MODE = re.compile(r"mode (.+)")
_EXCITATION = re.compile(r"([\d.e+]+) N excitation")


def parameter(name: str) -> Shown:
    """How a parameter is shown, with its test and mode; one that has no entry keeps its name, without a unit."""
    base, *where = name.split(", ")
    label, unit, factor, meaning = _PARAMETERS.get(base, (base, "", 1.0, ""))
    ending = "".join(f", {_of_mode(part)}" for part in where)
    return Shown(word(label) + ending, unit, factor, word(meaning) if meaning else "")


def _of_mode(part: str) -> str:
    """A test, or a mode of it, in the language of the reader."""
    mode = _MODE.fullmatch(part)
    return text("mode {mode}", mode=mode[1]) if mode else word(part)


def quantity(name: str) -> Shown:
    """How the quantity of a statement is shown: test, conditions and what is read; unknown parts stay as they are."""
    *conditions, last = re.split(r", |: ", name)
    label, unit, factor = _QUANTITIES.get(last, (last, "", 1.0))
    where = ", ".join(_condition(part) for part in conditions)
    return Shown(f"{where}: {word(label)}" if where else word(label), unit, factor)


def _condition(part: str) -> str:
    if excitation := _EXCITATION.fullmatch(part):
        return with_unit(f"F_E\u00a0{excitation[1]}", "N")
    if force := _NORMAL_FORCE.fullmatch(part):
        newtons = float(force[1])
        number, unit = (newtons / 1000, "kN") if newtons >= 1000 else (newtons, "N")
        return with_unit(f"F_N\u00a0{number:g}", unit)
    return _of_mode(part)
