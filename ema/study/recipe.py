"""What a recipe may say: a TOML file in ``reports/``, every key checked before anything is computed."""

import difflib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, Discriminator, Field, Tag, ValidationError, model_validator

from ema import tables
from ema.data.results import Verdict
from ema.errors import InputError
from ema.messages import SOURCE, checked_language
from ema.place.recipe import KIND as PLACEMENT
from ema.place.recipe import PlaceRecipe

_FILE, _TABLE = "<file>", "<table>"
"""Marks of the two ways to give a placement; no key of a file looks like them."""
Band = Annotated[tuple[float, float], Field(description="Hz")]


class Table(tables.Table):
    """A table of a recipe: unknown keys are refused."""

    def given(self) -> dict[str, Any]:
        """Return the keys that were written, for a function that has its own defaults for the others.

        Returns
        -------
        dict
            Value of every key that stands in the table, by name.
        """
        return {name: getattr(self, name) for name in sorted(self.model_fields_set)}


def _rising(ends: tuple[float, float]) -> tuple[float, float]:
    if ends[0] >= ends[1]:
        raise ValueError(f"a range goes from a lower to a higher value, got {ends[0]:g} to {ends[1]:g}")
    return ends


class EstimateTable(Table):
    """``[estimate]``: settings of ``ema.estimate``; those of another kind of excitation do not disturb.

    ``keep`` and ``reject`` name impacts as :func:`ema.estimate.hammer_test` has it: ``"double-hit"``, ``"12:+Z#3"``.
    ``discard`` s at the start of every frequency of a stepped sine, ``mount_mass`` kg between load cell and structure.
    """

    estimator: Literal["H1", "H2", "Hv"] = "H1"
    block: int | None = Field(default=None, ge=8)
    trigger: float | None = Field(default=None, gt=0)
    level: Annotated[tuple[float, float], AfterValidator(_rising)] | None = None
    decay: float | None = Field(default=None, ge=0)
    window_force: bool = True
    less_noise: bool = True
    keep: list[str] = []
    reject: list[str] = []
    method: Literal["local", "welch"] = "local"
    overlap: float = Field(default=0.75, ge=0, lt=1)
    discard: float = Field(default=0.0, ge=0)
    mount_mass: float = Field(default=0.0, ge=0)


class FitTable(Table):
    """``[fit]``: band in Hz, model orders ``[lowest, highest, step]``, and modes chosen by hand."""

    band: Band | None = None
    orders: tuple[int, int, int] | None = None
    near: list[float] | None = None
    index: list[int] | None = None

    @model_validator(mode="after")
    def _sound(self) -> "FitTable":
        if self.band is not None and not 0 <= self.band[0] < self.band[1]:
            raise ValueError(
                f"a band goes from a lower to a higher frequency, got {self.band[0]:g} to {self.band[1]:g}"
            )
        if self.orders is not None and not (0 < self.orders[0] <= self.orders[1] and self.orders[2] > 0):
            raise ValueError("orders are [lowest, highest, step], such as [4, 60, 2]")
        if self.near is not None and self.index is not None:
            raise ValueError("modes are chosen near frequencies or by index, not both")
        return self


def _page(name: str) -> str:
    """A report replaces the file of its name, which is none of the inputs and not the result beside it."""
    if name and Path(name).suffix.lower() not in (".html", ".htm"):
        raise ValueError(f"a report is a page such as _build/{Path(name).stem or 'report'}.html")
    return name


def _spoken(name: str) -> str:
    """A language that exists."""
    try:
        return checked_language(name)
    except InputError as error:
        raise ValueError(str(error)) from error


class ExpectTable(Table):
    """``[[expect]]``: numbers that the study has to reproduce.

    ``tolerance`` in Hz; ``damping_percent`` with ``damping_tolerance`` relative to the value. ``only`` is a band in Hz
    that holds no other modes. ``findings`` are codes that have to be among the findings.
    """

    run: str
    natural_frequencies: list[float] = []
    tolerance: float = Field(default=0.1, gt=0)
    damping_percent: list[float] = []
    damping_tolerance: float = Field(default=0.05, gt=0)
    only: Band | None = None
    findings: list[str] = []

    @model_validator(mode="after")
    def _sound(self) -> "ExpectTable":
        if self.damping_percent and len(self.damping_percent) != len(self.natural_frequencies):
            raise ValueError(
                f"{len(self.damping_percent)} damping values for {len(self.natural_frequencies)} natural frequencies"
            )
        if not (self.natural_frequencies or self.only or self.findings):
            raise ValueError("an expectation states natural_frequencies, only or findings")
        if self.only is not None and self.only[0] >= self.only[1]:
            raise ValueError(f"only goes from a lower to a higher frequency, got {self.only[0]:g} to {self.only[1]:g}")
        return self


class MapTable(Table):
    """``[[map]]``: one mode over (F_E, F_N).

    ``near`` Hz; ``runs`` ids or patterns such as ``mode1_*`` (all stepped sines and sweeps with a beam by default);
    ``reference`` the run without a beam that gives the modal constants; ``force_levels`` and ``normal_forces`` the
    nominal axes in N; ``bandwidths`` of the local fit. With ``model``, the path of a model file with a ``[map]``
    relative to the recipe, the map is that of the model, by harmonic balance; ``runs`` and ``reference`` say nothing.
    """

    near: float = Field(gt=0)
    name: str = ""
    model: str = ""
    runs: list[str] = []
    reference: str = ""
    force_levels: list[float] | None = None
    normal_forces: list[float] | None = None
    bandwidths: float = Field(default=1.5, gt=0)

    @property
    def title(self) -> str:
        """Its name, or the frequency."""
        return self.name or f"mode near {self.near:g} Hz"


class RingDownTable(Table):
    """``[[ring_down]]``: frequency and damping over the amplitude, for every record of a run.

    ``band`` Hz holds the mode in all its phases and no other; ``channel`` is a name or a DOF, the first response by
    default; ``start``, ``stop`` s.
    """

    run: str
    band: Band
    channel: str = ""
    start: float | None = None
    stop: float | None = None


class LoopTable(Table):
    """``[[loop]]``: hysteresis of a joint, for every record of a run; ``displacement`` and ``force`` name channels."""

    run: str
    displacement: str = ""
    force: str = ""


class ReleaseTable(Table):
    """``[[release]]``: a model after a load raised slowly was let go, as the ``[snapback]`` of its file says.

    ``model`` is the path of a model file relative to the recipe; ``normal_force`` N of every joint. With ``raised_at``
    N the load is raised under that normal force, so that releases under different ones begin alike. ``pressure`` is
    spread over the node pairs of a joint as the file says (``even``), or in proportion to their numbers (``rising``).
    ``loops`` numbers contacts, from 1, whose first cycle is shown.
    """

    name: str
    model: str
    normal_force: float = Field(gt=0)
    raised_at: float | None = Field(default=None, gt=0)
    pressure: Literal["even", "rising"] = "even"
    loops: list[Annotated[int, Field(ge=1)]] = []


Quantity = Literal[
    "damping",
    "frequency",
    "highest damping",
    "ridge",
    "peak level",
    "rise of ridge",
    "rise of damping",
    "fall of damping",
    "peak of damping",
    "dip of frequency",
    "ridge over that of map",
    "spread over levels",
    "ridge over sticking",
    "damping over ridge",
    "release deflection",
    "release deflection over run",
    "sliding frequency",
    "sticking frequency",
    "sticking damping",
    "missing damping",
    "difference of envelopes",
    "difference of frequencies",
    "largest slip",
    "slip of first over last contact",
    "dissipation of first over last contact",
    "loop areas over energy lost",
    "energy integral over release",
    "run frequency",
    "run damping",
    "run misfit",
    "run damping over run",
    "run level effect",
]


RELEASE_QUANTITIES = (
    "release deflection",
    "release deflection over run",
    "sliding frequency",
    "sticking frequency",
    "sticking damping",
    "missing damping",
    "difference of envelopes",
    "difference of frequencies",
)
"""Quantities that are read from the records of a release."""
MODEL_RELEASE_QUANTITIES = (
    "largest slip",
    "slip of first over last contact",
    "dissipation of first over last contact",
    "loop areas over energy lost",
    "energy integral over release",
)
"""Quantities of the release of a model."""


class StatementTable(Table):
    """``[[statements]]``: what a publication says, as a number between ``low`` and ``high``, and the verdict expected.

    ``sentence`` quotes the publication, with its page in ``source`` where it is known; without it the statement is
    a reading of ours. Of a ``map``: ``level`` and ``force`` in N name a point, row or column, ``levels`` and
    ``forces`` a range of either, and ``other`` another map; without ``level`` it has to hold at every level. Of a
    ``run``: ``near`` Hz, and ``other`` another run. Of a run that is a release: ``start`` s of the release,
    ``band`` Hz that holds the mode, and ``other`` the release that it is compared with. Of the ``release`` of a
    model: ``other`` another one. Damping and level effect in percent, misfit and ratios as they are, the largest
    slip in µm. ``implausible`` says which parameter of a match cannot be believed, ``assumed`` which one was
    assumed or chosen for it (that of the recipe by default). A sentence that nothing here measures names no
    quantity, map or run, but in ``missing`` what it would take. The quantities are defined in
    :mod:`ema.compare.map_features`.
    """

    text: str
    source: str
    quantity: Quantity | None = None
    verdict: Verdict
    sentence: str = ""
    missing: str = ""
    map: str = ""
    run: str = ""
    release: str = ""
    other: str = ""
    near: float | None = None
    level: float | None = None
    force: float | None = None
    forces: tuple[float, float] | None = None
    levels: tuple[float, float] | None = None
    band: Band | None = None
    start: float | None = Field(default=None, ge=0)
    low: float = float("-inf")
    high: float = float("inf")
    implausible: str = ""
    assumed: str = ""
    reason: str = ""

    @model_validator(mode="after")
    def _sound(self) -> "StatementTable":
        if self.quantity is None or self.missing:
            return self._unmeasured()
        if sum(map(bool, (self.map, self.run, self.release))) != 1:
            raise ValueError("a statement is about a map, a run or the release of a model; name one of them")
        if bool(self.release) != (self.quantity in MODEL_RELEASE_QUANTITIES):
            kinds = ", ".join(MODEL_RELEASE_QUANTITIES)
            raise ValueError(f"of the release of a model, and of nothing else, there are: {kinds}")
        if self.quantity in RELEASE_QUANTITIES:
            if not self.run or self.start is None or (self.band is None and "deflection" not in self.quantity):
                raise ValueError("a statement about a release needs run, start and, but for deflections, band")
        elif self.run and self.near is None and self.quantity != "run level effect":
            raise ValueError("a statement about a run needs near, the frequency of the mode in Hz")
        if self.low == float("-inf") and self.high == float("inf"):
            raise ValueError("a statement that holds for every number says nothing; give low, high or both")
        if self.low > self.high:
            raise ValueError(f"no number lies between the bounds, got low = {self.low:g}, high = {self.high:g}")
        for name in ("forces", "levels", "band"):
            ends = getattr(self, name)
            if ends is not None and ends[0] > ends[1]:
                raise ValueError(f"{name} goes from a lower to a higher value, got {ends[0]:g} to {ends[1]:g}")
        return self

    def _unmeasured(self) -> "StatementTable":
        """A sentence of the publication that nothing here measures."""
        if self.quantity is not None or self.map or self.run or self.release:
            raise ValueError(
                "missing is for a sentence that nothing measures; leave out quantity, map, run and release, or it"
            )
        if not self.missing:
            raise ValueError("a statement needs a quantity, or in missing what it would take to measure it")
        if self.verdict != "not testable here" or not self.sentence:
            raise ValueError("with missing, a statement has its sentence and the verdict 'not testable here'")
        return self


class Recipe(Table):
    """The whole recipe. ``campaign`` is a folder or file, ``report`` and ``result`` are written; all relative to the
    recipe. ``finding_limit`` is the severity from which a finding makes the command end with status 1.
    ``placement`` is a placement recipe, or the path of one, answered for the first run without a friction beam;
    ``logo`` an image for the report, ``language`` the code of the report's language, such as ``de``. ``assumed``
    says what the campaign assumes that a publication does not state: no statement is matched without it, where it
    is a model that was measured."""

    campaign: str
    title: str = ""
    runs: list[str] = []
    report: Annotated[str, AfterValidator(_page)] = ""
    finding_limit: Literal["warning", "error", "never"] = "error"
    estimate: EstimateTable = EstimateTable()
    fit: FitTable = FitTable()
    expect: list[ExpectTable] = []
    map: list[MapTable] = []
    statements: list[StatementTable] = []
    assumed: str = ""
    ring_down: list[RingDownTable] = []
    loop: list[LoopTable] = []
    release: list[ReleaseTable] = []
    placement: Annotated[
        Annotated[str, Tag(_FILE)] | Annotated[PlaceRecipe, Tag(_TABLE)],
        Discriminator(lambda value: _FILE if isinstance(value, str) else _TABLE),
    ] = ""
    logo: str = ""
    language: Annotated[str, AfterValidator(_spoken)] = SOURCE


_TABLES: dict[str, type[BaseModel]] = {
    "": Recipe,
    "estimate": EstimateTable,
    "fit": FitTable,
    "expect": ExpectTable,
    "map": MapTable,
    "statements": StatementTable,
    "ring_down": RingDownTable,
    "loop": LoopTable,
    "release": ReleaseTable,
    **{f"placement.{name}".rstrip("."): table for name, table in PLACEMENT.tables.items()},
}
_FORMER = tables.FormerNames(
    keys={f"placement.{name}": new for name, new in PLACEMENT.former.keys.items()},
    choices={f"placement.{name}": new for name, new in PLACEMENT.former.choices.items()},
)
"""What keys of a recipe were called before."""


_MARKS = ("tuple[", "list[", _FILE, _TABLE)


def load(path: Path) -> Recipe:
    """Read a recipe.

    Parameters
    ----------
    path : Path
        The TOML file; paths in it are relative to its folder.

    Returns
    -------
    Recipe
        Content of the file, checked.

    Raises
    ------
    InputError
        There is no such file, it is no TOML, or a key is unknown, missing or wrong; the message names its line.
    """
    return parse(tables.read_text(path, "there is no such recipe", expected="a TOML file"), str(path))


def parse(text: str, where: str = "recipe") -> Recipe:
    """Understand the text of a recipe; raises as :func:`load`."""
    document, findings = tables.document_of(text, where, _FORMER)
    try:
        return Recipe.model_validate(document).noting(findings)
    except ValidationError as error:
        raise _sentence(error, text, where) from error


def _sentence(error: ValidationError, text: str, where: str) -> InputError:
    """All problems as one error."""
    return tables.all_at_once([_trouble(detail, text) for detail in error.errors()], where)


def _trouble(detail: Any, text: str) -> tables.Trouble:
    """One problem: its line, what is wrong, and advice."""
    # a mark that the checker adds for the parts of an alternative is no place in the file
    steps = [step for step in detail["loc"] if isinstance(step, int) or not step.startswith(_MARKS)]
    line = tables.line_of(text, steps)
    name = ".".join(str(step) for step in steps) or "the recipe"
    if detail["type"] == "extra_forbidden":
        table = ".".join(step for step in steps[:-1] if isinstance(step, str))
        known = list(_TABLES[table].model_fields)
        close = difflib.get_close_matches(str(steps[-1]), known, n=1, cutoff=0.5)
        advice = f"did you mean {close[0]}?" if close else "known keys: " + ", ".join(known)
        return line, f"unknown key {steps[-1]!r}" + (f" in [{table}]" if table else ""), None, advice
    if detail["type"] == "missing":
        return line, f"the recipe lacks {name!r}", None, ""
    cause = detail.get("ctx", {}).get("error")
    message = str(cause) if isinstance(cause, ValueError) else detail["msg"][:1].lower() + detail["msg"][1:]
    return line, f"{name}: {message}", None, ""
