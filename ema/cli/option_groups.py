"""Options that belong together: a command takes them as one object, and its help lists them one by one."""

import functools
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass, replace
from inspect import Parameter, Signature, signature
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from ema.cli.cluster import Cluster
from ema.cli.common import Formats, Jobs, Language

if TYPE_CHECKING:
    from ema.study import Study


def grouped(command: Callable[..., int]) -> Callable[..., int]:
    """Let ``command`` take groups of options: parameters whose type is a dataclass, its fields annotated as options.

    Parameters
    ----------
    command : callable
        Function with groups among its parameters. The default of such a parameter gives the defaults of its options.

    Returns
    -------
    callable
        The command as its parser sees it: with the fields of every group in the place of the group.

    Examples
    --------
    >>> @dataclass(frozen=True)
    ... class Band:
    ...     low: float = 0.0
    ...     high: float = 100.0
    >>> @grouped
    ... def width(name: str, band: Band = Band(high=50.0)) -> int:
    ...     return int(band.high - band.low)
    >>> list(signature(width).parameters), width(name="a", low=10.0, high=30.0)
    (['name', 'low', 'high'], 20)
    """
    hints = get_type_hints(command, include_extras=True)
    groups = {name: kind for name, kind in hints.items() if is_dataclass(kind) and isinstance(kind, type)}
    options: list[Parameter] = []
    for parameter in signature(command).parameters.values():
        if parameter.name in groups:
            options += _options(groups[parameter.name], parameter.default)
        else:
            options.append(parameter.replace(annotation=hints[parameter.name], kind=Parameter.KEYWORD_ONLY))

    @functools.wraps(command)
    def called(**given: Any) -> int:
        """Call the command with the objects that its options make."""
        objects = {
            name: kind(**{field.name: given.pop(field.name) for field in fields(kind)}) for name, kind in groups.items()
        }
        return command(**given, **objects)

    called.__dict__["__signature__"] = Signature(options, return_annotation=int)
    called.__annotations__ = {option.name: option.annotation for option in options} | {"return": int}
    return called


def _options(kind: type[Any], default: Any) -> list[Parameter]:
    """The fields of a group as parameters, with the values of ``default`` as theirs."""
    hints = get_type_hints(kind, include_extras=True)
    values = kind() if default is Parameter.empty else default
    return [
        Parameter(field.name, Parameter.KEYWORD_ONLY, default=getattr(values, field.name), annotation=hints[field.name])
        for field in fields(kind)
    ]


@dataclass(frozen=True)
class Reporting:
    """In which formats and language a report is written."""

    formats: Formats = "html"
    language: Language = "en"


@dataclass(frozen=True)
class Work:
    """Where a command computes, and what it takes over from an earlier call."""

    jobs: Jobs = None
    cluster: Cluster = None
    resume: Annotated[
        bool,
        typer.Option("--resume", help="Keep what was finished before by the same code from the same inputs."),
    ] = False


@dataclass(frozen=True)
class Reading:
    """What is made of damaged files and of impacts with faults."""

    salvage: Annotated[
        bool, typer.Option("--salvage", help="Read what damaged files still hold; what was lost becomes a finding.")
    ] = False
    keep: Annotated[
        list[str] | None,
        typer.Option(
            "--keep",
            help="Use impacts in spite of their faults (may be repeated): all, a fault such as double-hit or overload, "
            "a record or point such as 12:+Z, or an impact by its number from 0, such as 12:+Z#3.",
        ),
    ] = None

    def of(self, study: "Study") -> "Study":
        """The study with its files read in this way."""
        return replace(study, salvage=self.salvage).keeping(self.keep or [])
