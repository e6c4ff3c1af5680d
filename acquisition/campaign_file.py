"""What ``campaign.toml`` may say: every table and key, checked before any data file is opened."""

import datetime
import re
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from acquisition import units
from acquisition.files.layout import Layout
from ema.data.condition import ExcitationKind
from ema.data.recording import Role
from ema.errors import EmaError, UnitError
from ema.tables import FileKind, Table
from ema.units import Quantity

__all__ = ["FILE_NAME", "CampaignFile", "load", "parse"]

FILE_NAME = "campaign.toml"

MOST_COLUMNS = 100_000
"""Columns that a range such as ``"3-30"`` may name: above the channels of any front end, and counted in no time."""


def _checked(understand: Callable[[str], Any]) -> AfterValidator:
    """Keep a text that ``understand`` takes; what it raises reaches the reader with the line of the text."""

    def check(text: str) -> str:
        try:
            understand(text)
        except EmaError as error:
            raise ValueError(str(error)) from error
        return text

    return AfterValidator(check)


def _with_unit(quantity: str) -> AfterValidator:
    return _checked(lambda text: units.measure(text, quantity))


def _positive(quantity: str) -> AfterValidator:
    def check(text: str) -> None:
        if units.measure(text, quantity)[0] <= 0:
            raise UnitError("not above 0", got=repr(text), expected="more than 0")

    return _checked(check)


def _not_negative(quantity: str) -> AfterValidator:
    def check(text: str) -> None:
        if units.measure(text, quantity)[0] < 0:
            raise UnitError("below 0", got=repr(text), expected="0 or more")

    return _checked(check)


def _full_scale(text: str) -> None:
    if units.measure(text)[0] <= 0:
        raise UnitError("not above 0", got=repr(text), expected="what the channel measures at most")


def _rising(quantity: str, ends: str) -> AfterValidator:
    """Two values, the lower one first."""

    def check(texts: list[str]) -> list[str]:
        low, high = (units.measure(text, quantity)[0] for text in texts)
        if low >= high:
            raise ValueError(f"{texts[0]!r} to {texts[1]!r} is no range; it goes from {ends}")
        return texts

    return AfterValidator(check)


def _above_zero(text: str) -> str:
    if units.measure(text, "temperature")[0] < 0:
        raise ValueError("below absolute zero")
    return text


def _as_text(value: Any) -> Any:
    return value.isoformat() if isinstance(value, datetime.date | datetime.datetime) else value


def _as_list(value: Any) -> Any:
    return [value] if isinstance(value, str | int | dict) else value


def _as_files(value: Any) -> Any:
    return [{"file": item} if isinstance(item, str) else item for item in value] if isinstance(value, list) else value


def _as_columns(value: Any) -> Any:
    if isinstance(value, str) and (found := re.fullmatch(r"\s*(\d+)\s*-\s*(\d+)\s*", value)):
        first, last = int(found[1]), int(found[2])
        if last < first:
            raise ValueError(f"{value!r} ends before it begins")
        if last - first >= MOST_COLUMNS:
            raise ValueError(f"{value!r} are more columns than any file has ({MOST_COLUMNS})")
        return list(range(first, last + 1))
    return value


def _as_reader(options: dict[str, Any]) -> dict[str, Any]:
    """Options of ``acquisition.read``, checked before any file is opened."""
    try:
        Layout.of(**{name: value for name, value in options.items() if name != "format"})
    except EmaError as error:
        raise ValueError(str(error)) from error
    return options


Unit = Annotated[
    str, _checked(units.parse), AfterValidator(lambda text: "unstated" if text.lower() == "unstated" else text)
]
Sensitivity = Annotated[str, _checked(units.sensitivity)]
Level = Annotated[str, _positive("force")]
ForceSpread = Annotated[str, _not_negative("force")]
NormalForce = Annotated[str, _not_negative("force")]
Frequency = Annotated[str, _not_negative("frequency")]
Range = Annotated[str, _checked(_full_scale)]
Torque = Annotated[str, _with_unit("torque")]
Temperature = Annotated[str, _with_unit("temperature"), AfterValidator(_above_zero)]
Seconds = Annotated[str, _with_unit("time")]
Duration = Annotated[str, _positive("time")]
Wait = Annotated[str, _not_negative("time")]
Mass = Annotated[str, _not_negative("mass")]
Identifier = Annotated[str, Field(min_length=1)]
Moment = Annotated[str, BeforeValidator(_as_text)]
Reader = Annotated[dict[str, Any], AfterValidator(_as_reader)]
Names = Annotated[list[str], BeforeValidator(_as_list)]
Numbers = Annotated[list[int], BeforeValidator(_as_list)]
Direction = str | Annotated[list[float], Field(min_length=3, max_length=3)]


class CampaignTable(Table):
    """``[campaign]``: what was measured, by whom, and where the files are."""

    name: Identifier
    structure: str = ""
    operator: str = ""
    date: Moment = ""
    comment: str = ""
    photos: Names = []
    logo: str = ""
    files: str = "."
    generator: str = ""
    command: str = ""
    reader: Reader = {}

    @property
    def generating_command(self) -> str:
        """The command that writes the data files of a built-in campaign."""
        return self.command or f"ema run reports/{self.generator.removeprefix('virtual_')}.toml"


class GeometryTable(Table):
    """``[geometry]``: a file, or nodes written here; lines, faces and local axes may be added to either."""

    file: str = ""
    unit: Unit | None = None
    node: str = "node"
    x: str = "x"
    y: str = "y"
    z: str = "z"
    names_in: Literal["first row", "first column"] = "first row"
    reader: Reader = {}
    nodes: dict[int, Annotated[list[float], Field(min_length=3, max_length=3)]] = {}
    lines: list[list[int]] = []
    faces: list[list[int]] = []
    axes: dict[int, Annotated[list[list[float]], Field(min_length=3, max_length=3)]] = {}

    @model_validator(mode="after")
    def _one_source(self) -> "GeometryTable":
        if bool(self.file) == bool(self.nodes):
            raise ValueError("a geometry comes from a file or from nodes written here; state one of the two")
        if self.nodes and self.unit is None:
            raise ValueError('the coordinates have no unit; add unit = "m" (or "mm", "in")')
        if self.unit is not None and units.parse(self.unit).quantity != "displacement":
            raise ValueError(f"coordinates in {self.unit!r} are no lengths; state a unit such as m or mm")
        return self


class ChannelTable(Table):
    """``[[channels]]``: one channel, a range of columns, or the three channels of a triaxial sensor."""

    name: str = ""
    names: list[str] = []
    column: int | None = Field(default=None, ge=1)
    columns: Annotated[list[int], BeforeValidator(_as_columns)] = []
    role: Role = "response"
    quantity: Quantity | None = None
    unit: Unit | None = None
    sensitivity: Sensitivity | None = None
    dof: str = ""
    node: Annotated[str, BeforeValidator(lambda value: str(value))] = ""
    direction: Direction | None = None
    directions: list[Direction] = []
    range: Range | None = None
    serial: str = ""
    calibrated_on: Moment = ""
    joint: str = ""

    @model_validator(mode="after")
    def _sound(self) -> "ChannelTable":
        if self.names and self.name:
            raise ValueError("a channel has a name or, for a sensor with several channels, names; not both")
        if self.column is not None and self.columns:
            raise ValueError("a channel has a column or columns, not both")
        if not (self.name or self.names or self.column or self.columns):
            raise ValueError('nothing says which channel of the file this is; add name = "..." or column = 1')
        if self.dof and (self.node or self.direction or self.directions):
            raise ValueError("a channel has a dof, or a node with a direction; not both")
        if (self.direction or self.directions) and not self.node:
            raise ValueError('a direction needs a node; add node = "{point}" or a number')
        if self.directions and len(self.directions) != max(len(self.names), len(self.columns)):
            raise ValueError("a sensor has as many directions as channels (names or columns)")
        if self.quantity and self.unit and self.unit != "unstated":
            found = units.parse(self.unit).quantity
            if found not in (self.quantity, "voltage"):
                raise ValueError(f"{self.unit!r} is a unit of {found}, not of {self.quantity}")
        if self.role == "normal force" and not self.joint:
            raise ValueError('a normal-force channel belongs to a joint; add joint = "J1"')
        return self


class JointTable(Table):
    """``[[joints]]``: a joint whose normal force is measured or known."""

    name: Identifier
    load_cell: str = ""
    calibrated_on: Moment = ""
    comment: str = ""


class FileTable(Table):
    """An entry of ``files`` in a run: one file or pattern, with what its name does not say."""

    file: str
    point: int | None = None
    setup: str = ""
    dofs: dict[str, str] = {}


class NormalForceTable(Table):
    """``[[runs.normal_force]]``: the normal force of one joint, from a channel, from side data, or stated.

    Without any of the three the force is admitted as unknown.
    """

    joint: Identifier
    channel: str = ""
    file: str = ""
    column: str = ""
    unit: Unit | None = None
    time: str = ""
    time_unit: Unit | None = None
    start: Moment = ""
    between: (
        Annotated[list[Seconds], Field(min_length=2, max_length=2), _rising("time", "the first to the last moment")]
        | None
    ) = None
    value: NormalForce | None = None
    std: ForceSpread | None = None
    nominal: Level | None = None
    torque: Torque | None = None
    sequence: Literal["up", "down", "unstated"] = "unstated"
    run_in: int | None = Field(default=None, ge=0)

    @model_validator(mode="after")
    def _one_source(self) -> "NormalForceTable":
        if sum(map(bool, (self.channel, self.file, self.value))) > 1:
            raise ValueError("the normal force of a joint comes from a channel, a file, or a value; state one")
        if self.file and not self.column:
            raise ValueError('side data need the column of the joint; add column = "J1"')
        if self.file and self.unit is None:
            raise ValueError('side data have no unit; add unit = "N" (or "kN", "lbf")')
        if self.unit is not None and units.parse(self.unit).quantity != "force":
            raise ValueError(f"a normal force in {self.unit!r} is no force; state a unit such as N or kN")
        return self


class LevelsTable(Table):
    """``[runs.levels]``: columns of the tables of a stepped sine, one file for each level, and what was held.

    ``frequency``, ``force``, ``response``, ``phase`` and ``harmonics`` are titles of columns, or in a MATLAB file names
    with ``*`` for the levels; ``units`` by name of the first four, where the files do not state them.
    """

    control: Literal["response", "force", "none"]
    frequency: str = "frequency"
    force: str = "force"
    response: str = "response"
    phase: str = "phase"
    harmonics: Names = []
    units: dict[Literal["frequency", "force", "response", "phase"], Unit] = {}
    output: str = ""
    input: str = ""


class RunTable(Table):
    """``[[runs]]``: files measured under one condition."""

    id: Identifier
    kind: ExcitationKind = "unknown"
    files: Annotated[list[FileTable], BeforeValidator(lambda value: _as_files(_as_list(value)))] = []
    file_table: str = ""
    take: Literal["records", "FRFs"] | None = None
    channels: list[ChannelTable] | None = None
    level: Level | None = None
    level_std: ForceSpread | None = None
    band: (
        Annotated[
            list[Frequency],
            Field(min_length=2, max_length=2),
            _rising("frequency", "the lowest to the highest frequency"),
        ]
        | None
    ) = None
    period: Duration | None = None
    at_rest: str = ""
    estimator: str = ""
    averages: int | None = Field(default=None, ge=1, strict=True)
    temperature: Temperature | None = None
    beam: bool | None = None
    normal_force: list[NormalForceTable] = []
    levels: LevelsTable | None = None
    repeat: str = ""
    assembly: str = ""
    comment: str = ""
    reader: Reader = {}

    @model_validator(mode="after")
    def _sound(self) -> "RunTable":
        if bool(self.files) == bool(self.file_table):
            raise ValueError('a run names its files, by files = "..." or by file_table = "..."')
        if self.beam is False and self.normal_force:
            raise ValueError("a run without a beam has no normal force; drop one of the two statements")
        if self.levels is not None and self.kind not in ("unknown", "stepped sine"):
            raise ValueError(f'levels are those of a stepped sine, not of a {self.kind}; state kind = "stepped sine"')
        if self.at_rest and self.kind not in ("unknown", "random"):
            raise ValueError(f"a record at rest corrects the force of random tests, not of a {self.kind}; drop at_rest")
        if len({force.joint for force in self.normal_force}) != len(self.normal_force):
            raise ValueError("two normal forces for one joint")
        return self


class RepairTable(Table):
    """``[[repairs]]``: a correction of what was noted, by whom and why; the files stay as they are."""

    what: Literal["swap points", "reverse sign", "sensitivity", "unit", "exclude hit", "exclude record", "move dof"]
    who: Annotated[str, Field(min_length=1)]
    why: Annotated[str, Field(min_length=1)]
    runs: Names = []
    files: Names = []
    channel: str = ""
    role: Role | None = None
    points: Numbers = []
    hits: Numbers = []
    dof: str = ""
    to: str = ""
    sensitivity: Sensitivity | None = None
    unit: Unit | None = None
    was: str = ""

    @model_validator(mode="after")
    def _complete(self) -> "RepairTable":
        needed = {
            "swap points": len(self.points) == 2,
            "reverse sign": bool(self.channel or self.role or self.dof),
            "sensitivity": bool(self.sensitivity and (self.channel or self.role or self.dof)),
            "unit": bool(self.unit and (self.channel or self.role or self.dof)),
            "exclude hit": bool(self.hits and (self.files or self.points)),
            "exclude record": bool(self.files or self.points),
            "move dof": bool(self.dof and self.to),
        }
        wanted = {
            "swap points": "points = [5, 6]",
            "reverse sign": "a channel, role or dof",
            "sensitivity": "a channel, role or dof, and the right sensitivity",
            "unit": "a channel, role or dof, and the right unit",
            "exclude hit": "hits = [2] (the first blow is 0) and files or points",
            "exclude record": "files or points",
            "move dof": "dof and to",
        }
        if not needed[self.what]:
            raise ValueError(f"a repair {self.what!r} needs {wanted[self.what]}")
        return self


class CampaignFile(Table):
    """The whole of ``campaign.toml``."""

    campaign: CampaignTable
    runs: Annotated[list[RunTable], Field(min_length=1)]
    geometry: GeometryTable | None = None
    channels: list[ChannelTable] = []
    joints: list[JointTable] = []
    repairs: list[RepairTable] = []

    def channels_of(self, run: RunTable) -> list[ChannelTable]:
        """The channel table of a run: its own, even an empty one, or that of the campaign."""
        return self.channels if run.channels is None else run.channels

    @model_validator(mode="after")
    def _sound(self) -> "CampaignFile":
        for what, names in (("runs", [run.id for run in self.runs]), ("joints", [joint.name for joint in self.joints])):
            double = {name for name in names if names.count(name) > 1}
            if double:
                raise ValueError(f"two {what} are called {', '.join(sorted(double))}")
        if self.joints:
            known = [joint.name for joint in self.joints]
            for run in self.runs:
                for force in run.normal_force:
                    if force.joint not in known:
                        raise ValueError(
                            f"run {run.id} has a normal force for joint {force.joint}, which is none of the joints "
                            + ", ".join(known)
                        )
        return self


KIND = FileKind(
    table=CampaignFile,
    tables={
        "": CampaignFile,
        "campaign": CampaignTable,
        "geometry": GeometryTable,
        "channels": ChannelTable,
        "joints": JointTable,
        "runs": RunTable,
        "runs.files": FileTable,
        "runs.channels": ChannelTable,
        "runs.normal_force": NormalForceTable,
        "runs.levels": LevelsTable,
        "repairs": RepairTable,
    },
    name=FILE_NAME,
    absent="there is no campaign here",
    guide="docs/campaign.md",
)


def load(path: str | Path) -> CampaignFile:
    """Read ``campaign.toml``.

    Parameters
    ----------
    path : str or Path
        The file, or the folder that holds it.

    Returns
    -------
    CampaignFile
        Content of the file, checked.

    Raises
    ------
    InputError
        There is no such file, it is no TOML, or a key is unknown, missing or wrong; the message names its line.
    """
    return KIND.load(path)


def parse(text: str, where: str = FILE_NAME) -> CampaignFile:
    """Understand the text of a ``campaign.toml``.

    Raises
    ------
    InputError : as ``load``.
    """
    return KIND.parse(text, where)
