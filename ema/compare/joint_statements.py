"""What `joint.toml` may say: numbers and sentences about a structure with a friction beam, and what was known before.

Each number and each sentence is one likelihood, written down here before any value is computed. A number is a reading
with a standard deviation; a sentence says that a reading lies in an interval.
"""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from acquisition.quantities import Force, Forces, Frequency, Ratio, Tolerance
from ema.tables import FileKind, Table, warn

FILE_NAME = "joint.toml"
QUANTITIES = {
    "stuck frequency": "frequency at the highest normal force, Hz",
    "ridge": "normal force of most damping at one level, N",
    "peak level": "level of most damping at one normal force, N",
    "most damping": "highest damping over the levels at one normal force",
    "fall": "damping at the highest level over that at `level`, at one normal force",
    "drop": "frequency at the ridge less that at the highest normal force, at one level, Hz",
    "stuck damping": "damping at one normal force over that at the ridge, at one level",
}
"""Quantities that a sentence of a shaker test may be about."""
RELATIVE = ("ridge", "peak level")
"""Those whose standard deviation is relative."""
POSITIVE = (*RELATIVE, "stuck frequency", "most damping")
"""Those that are above 0 whatever the joint does."""


class PriorTable(Table):
    """``[prior]``: 95 % ranges of what nobody measured."""

    friction_coefficient: Annotated[list[float], Field(min_length=2, max_length=2)] = [0.075, 0.53]
    peak_force: Annotated[Forces, Field(min_length=2, max_length=2)] = [250.0, 4000.0]
    exponent: Annotated[list[float], Field(min_length=2, max_length=2)] = [0.0, 1.0]
    hammer_shape: Annotated[list[float], Field(min_length=2, max_length=2)] = [1.5, 7.6]
    shaker_shape: Annotated[list[float], Field(min_length=2, max_length=2)] = [0.3, 4.8]
    contact_time: float = Field(default=0.5e-3, gt=0)
    lift_off: Annotated[list[float], Field(min_length=2, max_length=2)] | None = None

    @model_validator(mode="after")
    def _rising(self) -> "PriorTable":
        for key in ("friction_coefficient", "peak_force", "exponent", "hammer_shape", "shaker_shape", "lift_off"):
            if getattr(self, key) is None:
                continue
            low, high = getattr(self, key)
            if not 0 <= low < high or (low == 0 and key != "exponent"):
                raise ValueError(f"{key} is a range of positive numbers, the smaller one first, not {[low, high]}")
        return self


class BareTable(Table):
    """``[bare]``: the mode without the beam."""

    frequency: Frequency
    damping: Ratio


class ModeTable(BareTable):
    """``[modes.3]``: another mode without the beam, and what was swept for it where that differs."""

    levels: Forces = []
    normal_forces: Forces = []


class ReadingTable(Table):
    """``[[hammer]]``: what a linear modal analysis of a hammer test read at one normal force."""

    sentence: str
    normal_force: Annotated[Force, Field(gt=0)]
    frequency: Frequency | None = None
    frequency_std: float = Field(default=1.0, gt=0)
    damping: Ratio | None = None
    damping_std: Tolerance = 5e-4

    @model_validator(mode="after")
    def _read(self) -> "ReadingTable":
        if self.frequency is None and self.damping is None:
            raise ValueError("a reading without a number; add frequency, damping or both")
        return self


class SentenceTable(Table):
    """``[[shaker]]``: a sentence about a shaker test, as a reading with ``std`` or within ``low`` to ``high``."""

    sentence: str
    quantity: Literal["stuck frequency", "ridge", "peak level", "most damping", "fall", "drop", "stuck damping"]
    std: float = Field(gt=0)
    value: float | None = None
    low: float | None = None
    high: float | None = None
    level: Annotated[Force, Field(gt=0)] | None = None
    normal_force: Annotated[Force, Field(gt=0)] | None = None
    mode: str | None = None

    @model_validator(mode="after")
    def _sound(self) -> "SentenceTable":
        if (self.value is None) == (self.low is None and self.high is None):
            raise ValueError("a sentence has a value, or low, high or both; not neither and not all")
        if self.quantity in ("ridge", "drop", "fall", "stuck damping") and self.level is None:
            raise ValueError(f"{self.quantity!r} needs a level")
        if self.quantity in ("peak level", "most damping", "fall", "stuck damping") and self.normal_force is None:
            raise ValueError(f"{self.quantity!r} needs a normal_force")
        if self.low is not None and self.high is not None and self.low >= self.high:
            raise ValueError(f"low = {self.low:g} and high = {self.high:g} are no interval; low is the smaller one")
        for key, number in (("value", self.value), ("low", self.low), ("high", self.high)):
            if number is not None and self.quantity in POSITIVE and number <= 0:
                raise ValueError(f"{key} = {number:g} is not above 0, as {self.quantity!r} is")
            if number is not None and self.quantity == "most damping" and number >= 1:
                raise ValueError(f"{key} = {number:g} is no damping ratio; 5 % is 0.05")
        return self


class JointFile(Table):
    """The whole file."""

    title: str
    bare: BareTable
    levels: Forces = []
    normal_forces: Forces = []
    prior: PriorTable = PriorTable()
    modes: dict[str, ModeTable] = {}
    hammer: list[ReadingTable] = []
    shaker: list[SentenceTable] = []

    @model_validator(mode="after")
    def _complete(self) -> "JointFile":
        if not self.hammer and not self.shaker:
            raise ValueError("no number and no sentence; add [[hammer]] or [[shaker]]")
        for mode in self.modes_of_shaker:
            if mode is not None and mode not in self.modes:
                raise ValueError(
                    f"a sentence is about mode {mode!r}; add [modes.{mode}] with its frequency and damping"
                )
            levels, normal_forces = self.swept(mode)
            if len(levels) < 2 or len(normal_forces) < 3:
                where = "" if mode is None else f" on mode {mode}"
                raise ValueError(
                    f"sentences about a shaker test{where} need its levels (2 or more) and normal_forces (3 or more)"
                )
        if unused := [mode for mode in self.modes if mode not in self.modes_of_shaker]:
            raise ValueError(f"no sentence is about [modes.{unused[0]}]; add mode = {unused[0]!r} to one, or remove it")
        return self

    @property
    def modes_of_shaker(self) -> tuple[str | None, ...]:
        """The modes that sentences of the shaker test are about, each once; None is that of ``[bare]``."""
        return tuple(dict.fromkeys(one.mode for one in self.shaker))

    def sentences(self, mode: str | None) -> list[SentenceTable]:
        """Sentences of the shaker test about a mode."""
        return [one for one in self.shaker if one.mode == mode]

    def bare_mode(self, mode: str | None) -> BareTable:
        """A mode without the beam."""
        return self.bare if mode is None else self.modes[mode]

    def swept(self, mode: str | None) -> tuple[list[float], list[float]]:
        """Levels and normal forces in N of the shaker test on a mode."""
        if mode is None:
            return self.levels, self.normal_forces
        return self.modes[mode].levels or self.levels, self.modes[mode].normal_forces or self.normal_forces


class _Tables(dict[str, type[Table]]):
    """The tables by name; those of modes are called as people like."""

    def get(self, name: str, default: Any = None) -> Any:
        """The class of a table."""
        return ModeTable if name.startswith("modes.") else super().get(name, default)


KIND = FileKind(
    table=JointFile,
    tables=_Tables(
        {
            "": JointFile,
            "bare": BareTable,
            "prior": PriorTable,
            "hammer": ReadingTable,
            "shaker": SentenceTable,
        }
    ),
    name=FILE_NAME,
    absent="there are no statements here",
    guide="docs/joint.md",
)


def load(path: str | Path) -> JointFile:
    """Read ``joint.toml``; a former name of a key is read, with a warning.

    Parameters
    ----------
    path : str or Path
        The file, or the folder that holds it.

    Returns
    -------
    JointFile
        Content of the file, checked.

    Raises
    ------
    InputError
        There is no such file, it is no TOML, or a key is unknown, missing or wrong; the message names its line.
    """
    statements = KIND.load(path)
    warn(statements.former_names)
    return statements
