"""Tables of a TOML file: every key is checked, and every mistake is one sentence with its line."""

import difflib
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

from pydantic import BaseModel, ConfigDict, PrivateAttr, ValidationError, field_validator
from pydantic_core import PydanticCustomError

from ema.data.findings import Finding
from ema.errors import EmaError, InputError
from ema.tables.former import NONE, FormerNames, renamed
from ema.tables.lines import line_of


class Table(BaseModel):
    """A table of one of our TOML files: unknown keys are refused.

    Examples
    --------
    >>> class Sensor(Table):
    ...     name: str
    >>> Sensor(name="acc 1").name
    'acc 1'
    """

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        str_strip_whitespace=True,
        arbitrary_types_allowed=True,
        allow_inf_nan=False,  # TOML has inf and nan, no measurement and no model does
    )

    @field_validator("*", mode="before")
    @classmethod
    def _no_bool_as_number(cls, value: Any, info: Any) -> Any:
        """TOML has true and false, which are no numbers."""
        kinds = _kinds(cls.model_fields[str(info.field_name)].annotation)
        if kinds & {int, float} and not kinds & {bool, Any, object} and (wrong := _bools(value)):
            kind = "number" if float in kinds else "integer"
            words = "Input should be a valid {kind}; got {wrong}"
            raise PydanticCustomError("bool_as_number", words, {"kind": kind, "wrong": wrong})
        return value

    _former_names: tuple[Finding, ...] = PrivateAttr(default=())

    @property
    def former_names(self) -> tuple[Finding, ...]:
        """For the whole file, one finding for every key or choice that is called otherwise today."""
        return self._former_names

    def noting(self: "T", findings: tuple[Finding, ...]) -> "T":
        """Attach findings about former names.

        Parameters
        ----------
        findings : tuple of Finding
            What was renamed.

        Returns
        -------
        Table
            The same table.

        Examples
        --------
        >>> Table().noting(()).former_names
        ()
        """
        self._former_names = findings
        return self


def _kinds(annotation: Any) -> set[Any]:
    """The types in an annotation."""
    if get_origin(annotation) is Literal:
        return {type(value) for value in get_args(annotation)}
    parts = get_args(annotation)[:1] if get_origin(annotation) is Annotated else get_args(annotation)
    return set().union(*map(_kinds, parts)) if parts else {annotation}


def _bools(value: Any) -> str:
    """``true`` or ``false`` where a value is that or a list has it, else nothing."""
    if isinstance(value, bool):
        return str(value).lower()
    return next(filter(None, map(_bools, value)), "") if isinstance(value, list) else ""


T = TypeVar("T", bound=Table)

Tables = Mapping[str, type[BaseModel]]
"""The tables of a file by their dotted names: the keys that may be offered instead of an unknown one."""


def document_of(text: str, where: str, former: FormerNames) -> tuple[dict[str, Any], tuple[Finding, ...]]:
    """Parse the text of a TOML file, under present names.

    Parameters
    ----------
    text : str
        Text of the file.
    where : str
        The file, for messages.
    former : FormerNames
        What its keys and choices were called.

    Returns
    -------
    tuple of (dict, tuple of Finding)
        The document, and what was renamed.

    Raises
    ------
    InputError
        If the text is no TOML, or a key is there under two names.

    Examples
    --------
    >>> document_of("force = 5.0", "run.toml", FormerNames())
    ({'force': 5.0}, ())
    """
    try:
        document = tomllib.loads(text.removeprefix("\ufeff"))  # the mark that some editors write
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"not TOML: {error}", where=where, advice="text values stand in quotation marks") from error
    return renamed(document, text, where, former)


def validated(kind: type[T], text: str, where: str, tables: Tables, *, former: FormerNames = NONE) -> T:
    """Read the text of a TOML file into its table.

    Parameters
    ----------
    kind : type
        Class of the table.
    text : str
        Text of the file.
    where : str
        The file, for messages.
    tables : Tables
        Tables of the file by their dotted names: the keys that may be offered instead of an unknown one.
    former : FormerNames, optional
        What its keys and choices were called.

    Returns
    -------
    Table
        The table.

    Raises
    ------
    InputError
        If the text is no TOML, or a key is unknown, missing or wrong; with its line.

    Examples
    --------
    >>> class Sensor(Table):
    ...     name: str
    >>> validated(Sensor, 'name = "acc 1"', "sensor.toml", {}).name
    'acc 1'
    """
    document, findings = document_of(text, where, former)
    try:
        return kind.model_validate(document).noting(findings)
    except ValidationError as error:
        raise _sentence(error, document, text, where, tables) from error


def _sentence(error: ValidationError, document: dict[str, Any], text: str, where: str, tables: Tables) -> InputError:
    """All problems of the file as one error."""
    return all_at_once(list(_troubles(error, document, text, tables)), where)


Trouble = tuple[int, str, str | None, str]
"""A mistake in a file: its line, what is wrong, what stands there, advice."""


def all_at_once(troubles: Sequence[Trouble], where: str) -> InputError:
    """Return the mistakes of a file as one error: a sentence for one, a line for each of several, in their order.

    Parameters
    ----------
    troubles : sequence of Trouble
        Line, fact, offending value and advice of each mistake.
    where : str
        The file, for messages.

    Returns
    -------
    InputError
        The error, to be raised by the caller.

    Examples
    --------
    >>> print(all_at_once([(3, "unknown key 'forse'", None, "did you mean force?")], "campaign.toml"))
    campaign.toml, line 3: unknown key 'forse'; did you mean force?
    """
    # a key that is misspelt is not missing besides
    misspelt = {advice.removeprefix("did you mean ").rstrip("?") for _, _, _, advice in troubles}
    told = [trouble for trouble in troubles if not any(trouble[1].endswith(f" lacks {key!r}") for key in misspelt)]
    ordered = sorted(dict.fromkeys(told), key=lambda trouble: trouble[0])
    if len(ordered) == 1:
        line, what, got, advice = ordered[0]
        return InputError(what, where=f"{where}, line {line}", got=got, advice=advice)
    lines = [str(InputError(what, where=f"line {line}", got=got, advice=advice)) for line, what, got, advice in ordered]
    return InputError(f"{len(ordered)} mistakes\n  " + "\n  ".join(lines), where=where)


def _troubles(
    error: ValidationError, document: dict[str, Any], text: str, tables: Tables
) -> Iterator[tuple[int, str, str | None, str]]:
    for detail in error.errors():
        steps = _steps(detail["loc"], document)
        line = line_of(text, steps)
        names = [step for step in steps if isinstance(step, str)]
        key = str(steps[-1]) if steps else ""
        table = _name_of(steps[:-1])
        match detail["type"]:
            case "extra_forbidden":
                model = tables.get(".".join(names[:-1]))
                known = list(model.model_fields) if model else []
                close = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
                advice = f"did you mean {close[0]}?" if close else "known keys: " + ", ".join(known)
                yield line, f"unknown key {key!r} in {table}", None, advice
            case "missing":
                yield line, f"{table} lacks {key!r}", None, ""
            case "value_error":
                yield line, f"{_name_of(steps)}: {_reason(detail)}", None, ""
            case kind:
                got = repr(detail["input"])
                said = detail["msg"][:1].lower() + detail["msg"][1:]
                if kind == "model_type" and (model := tables.get(".".join(names))):
                    said = "a table with the keys " + ", ".join(model.model_fields)
                    said += " is meant, { key = value, ... }"
                shown = len(got) < 80 and kind != "bool_as_number"
                yield line, f"{_name_of(steps)}: {said}", got if shown else None, ""


def _reason(detail: Any) -> str:
    cause = detail.get("ctx", {}).get("error")
    return str(cause) if isinstance(cause, ValueError | EmaError) else str(detail["msg"])


def _steps(location: tuple[Any, ...], document: Any) -> list[str | int]:
    """The place of a problem in the file, without the marks that the checker adds for alternatives."""
    steps: list[str | int] = []
    node = document
    for number, part in enumerate(location):
        if (isinstance(node, dict) and part in node) or (isinstance(node, list) and isinstance(part, int)):
            steps.append(part)
            node = node[part] if not isinstance(node, list) or part < len(node) else None
        elif number == len(location) - 1 and isinstance(node, dict):
            steps.append(part)
    return steps


def _name_of(steps: list[str | int]) -> str:
    """``[[runs]] number 2, files``: a place as people find it in the file."""
    words: list[str] = []
    for place, step in enumerate(steps):
        if isinstance(step, int):
            words[-1] = f"{words[-1]} number {step + 1}"
        elif place == 0:
            listed = len(steps) > 1 and isinstance(steps[1], int)
            words.append(f"[[{step}]]" if listed else f"[{step}]")
        else:
            words.append(str(step))
    return ", ".join(words) or "the file"
