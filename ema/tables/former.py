"""Keys and choices of our TOML files that bear another name today: read as before, with a finding that says so."""

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ema.data.findings import Finding
from ema.errors import InputError
from ema.tables.lines import line_of


@dataclass(frozen=True, kw_only=True)
class FormerNames:
    """What the keys and choices of one kind of file were called before.

    Parameters
    ----------
    keys : mapping of str to str, optional
        Former key with the dotted names of its tables, to its present name: ``{"runs.force": "normal_force"}``.
    choices : mapping of str to mapping of str to str, optional
        Present key with the dotted names of its tables, to its former choices with their present names.

    Examples
    --------
    >>> FormerNames(keys={"runs.force": "normal_force"}).keys["runs.force"]
    'normal_force'
    """

    keys: Mapping[str, str] = field(default_factory=dict)
    choices: Mapping[str, Mapping[str, str]] = field(default_factory=dict)


NONE = FormerNames()
"""No key or choice was ever called otherwise."""


def renamed(document: dict[str, Any], text: str, where: str, former: FormerNames) -> tuple[Any, tuple[Finding, ...]]:
    """Return a document under present names, and a finding for every former name in it.

    Parameters
    ----------
    document : dict of str to object
        What was read from ``text``.
    text : str
        Text of the TOML file, for the lines of the findings.
    where : str
        The file.
    former : FormerNames
        What its keys and choices were called.

    Returns
    -------
    tuple of (object, tuple of Finding)
        The document, and what was renamed.

    Raises
    ------
    InputError
        If a key is there under its former and its present name.

    Examples
    --------
    >>> names = FormerNames(keys={"force": "normal_force"})
    >>> document, findings = renamed({"force": 5.0}, "force = 5.0", "run.toml", names)
    >>> document, findings[0].where
    ({'normal_force': 5.0}, 'run.toml, line 1')
    """
    if not (former.keys or former.choices):
        return document, ()
    findings: list[Finding] = []

    def noted(steps: tuple[str | int, ...], old: str, new: str) -> None:
        location = f"{where}, line {line_of(text, steps)}"
        message = f"{old!r} is called {new!r} now."
        findings.append(Finding("info", "former-name", location, message, advice="The file is read as before."))

    def visited(node: Any, steps: tuple[str | int, ...], table: str) -> Any:
        """``steps`` as they are in the text, ``table`` by its present name."""
        if isinstance(node, list):
            return [visited(item, (*steps, location), table) for location, item in enumerate(node)]
        if isinstance(node, dict):
            present: dict[str, Any] = {}
            for key, item in node.items():
                new = former.keys.get(f"{table}.{key}".removeprefix("."), key)
                if new != key:
                    noted((*steps, key), key, new)
                if new in present or (new != key and new in node):
                    raise InputError(
                        f"{key!r} and {new!r} are the same key",
                        where=f"{where}, line {line_of(text, (*steps, key))}",
                        advice=f"keep {new!r}",
                    )
                present[new] = visited(item, (*steps, key), f"{table}.{new}".removeprefix("."))
            return present
        choices = former.choices.get(table, {})
        if isinstance(node, str) and node in choices:
            noted(steps, node, choices[node])
            return choices[node]
        return node

    return visited(document, (), ""), tuple(findings)


def warn(findings: Iterable[Finding]) -> None:
    """Warn of findings where no result carries them: a file that describes a model or a rig.

    Parameters
    ----------
    findings : iterable of Finding
        Findings, each of which becomes a ``FutureWarning``.

    Examples
    --------
    >>> warn([])
    """
    for finding in findings:
        warnings.warn(str(finding), FutureWarning, stacklevel=3)
