"""Tables of a TOML file: every key is checked, and every mistake is one sentence with its line."""

import difflib
import tomllib
from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, PrivateAttr, ValidationError

from ema.data.findings import Finding
from ema.errors import EmaError, InputError
from ema.tables.former import NONE, FormerNames, renamed
from ema.tables.lines import line_of


class Table(BaseModel):
    """A table of one of our TOML files: unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, str_strip_whitespace=True, arbitrary_types_allowed=True)
    _former_names: tuple[Finding, ...] = PrivateAttr(default=())

    @property
    def former_names(self) -> tuple[Finding, ...]:
        """For the whole file, one finding for every key or choice that is called otherwise today."""
        return self._former_names

    def noting(self: "T", findings: tuple[Finding, ...]) -> "T":
        """The same with findings about former names."""
        self._former_names = findings
        return self


T = TypeVar("T", bound=Table)

Tables = Mapping[str, type[BaseModel]]
"""The tables of a file by their dotted names: the keys that may be offered instead of an unknown one."""


def document_of(text: str, where: str, former: FormerNames) -> tuple[dict[str, Any], tuple[Finding, ...]]:
    """What is in the text of a TOML file under present names, with findings about former ones.

    Raises
    ------
    InputError : no TOML, or a key under two names.
    """
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"not TOML: {error}", where=where, advice="text values stand in quotation marks") from error
    return renamed(document, text, where, former)


def validated(kind: type[T], text: str, where: str, tables: Tables, *, former: FormerNames = NONE) -> T:
    """Understand the text of a TOML file.

    Raises
    ------
    InputError : no TOML, or a key that is unknown, missing or wrong, with its line.
    """
    document, findings = document_of(text, where, former)
    try:
        return kind.model_validate(document).noting(findings)
    except ValidationError as error:
        raise _sentence(error, document, text, where, tables) from error


def _sentence(error: ValidationError, document: dict[str, Any], text: str, where: str, tables: Tables) -> InputError:
    """The first problem of the file as one error."""
    # an unknown key is usually the cause of a missing one
    troubles = sorted(
        _troubles(error, document, text, tables), key=lambda trouble: ("unknown key" not in trouble[1], trouble[0])
    )
    line, what, got, advice = troubles[0]
    others = f" (and {len(troubles) - 1} more)" if len(troubles) > 1 else ""
    return InputError(what + others, where=f"{where}, line {line}", got=got, advice=advice)


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
            case _:
                got = repr(detail["input"])
                yield line, f"{_name_of(steps)}: {detail['msg'].lower()}", got if len(got) < 80 else None, ""


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
