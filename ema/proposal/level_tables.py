"""Stepped sines as text tables, one file for each level: which of them are one run, and what is asked of them."""

import re
from collections.abc import Mapping, Sequence
from itertools import pairwise, zip_longest
from typing import Any

from ema.dof import Dof
from ema.errors import EmaError, InputError
from ema.proposal.array_layouts import LevelColumns
from ema.proposal.examination import FileFacts
from ema.proposal.questions import Answers, Question
from ema.units import UNSTATED

CONSTANT = 0.1
"""Standard deviation over mean of an amplitude within a level, above which nobody kept it constant. Controllers keep
amplitudes within 1 %; the force of a shaker without control drops by a multiple at a resonance."""

_SAME_LEVEL = 0.02
"""Relative difference of two amplitudes up to which they are one level: campaigns refuse two such levels in one run."""

_NUMBER = re.compile(r"\d+(?:[.,p]\d+)?")


def sets(facts: Sequence[FileFacts]) -> list[tuple[FileFacts, ...]]:
    """The files of each run: names that differ in one number, the last for which the levels differ as well.

    Files without such a number, such as repeats of one level, are runs of their own.
    """
    stems: dict[str, list[FileFacts]] = {}
    for one in facts:
        stems.setdefault(_NUMBER.sub("#", one.path), []).append(one)
    found: list[tuple[FileFacts, ...]] = []
    for members in stems.values():
        numbers = [_NUMBER.findall(one.path) for one in members]
        runs: list[list[FileFacts]] = [[one] for one in members]
        for column in reversed(range(len(numbers[0]))):
            parts: dict[tuple[str, ...], list[FileFacts]] = {}
            for one, row in zip(members, numbers, strict=True):
                parts.setdefault((*row[:column], *row[column + 1 :]), []).append(one)
            if len(parts) < len(members) and all(_differ(part) for part in parts.values()):
                runs = list(parts.values())
                break
        found += [tuple(run) for run in runs]
    return found


def _differ(facts: Sequence[FileFacts]) -> bool:
    """Whether no two files are of one level."""
    control = _kept(facts)
    heights = sorted((one.level or LevelColumns()).height(control) for one in facts)
    return all(after >= (1 + _SAME_LEVEL) * before for before, after in pairwise(heights))


def _kept(facts: Sequence[FileFacts]) -> str:
    """What was kept constant in all files: ``force``, ``response`` or ``none``."""
    spreads = {name: max(one.level.spread[name] for one in facts if one.level) for name in ("force", "response")}
    least = min(spreads, key=spreads.__getitem__)
    return least if spreads[least] < CONSTANT else "none"


def run_of(facts: Sequence[FileFacts], answers: Answers) -> tuple[dict[str, Any], dict[str, str]]:
    """The table of the run of some files, its ``levels`` included, and its comments."""
    level = facts[0].level
    assert level is not None
    files = _pattern([one.path for one in facts])
    stem = re.sub(r"(\.[A-Za-z]\w*)+$", "", files.replace("*", "_"))
    name = re.sub(r"[^A-Za-z0-9.]+", "_", stem).strip("_.") or "levels"
    kept = _kept(facts)
    spreads = ", ".join(f"{key} {value:.2g}" for key, value in level.spread.items())
    control = answers.ask(
        Question(
            f"control {name}",
            f"What was kept constant within each level of {files}: the force, the response, or none of them?",
            kept,
            ("force", "response", "none"),
            f"standard deviation over mean in {facts[0].path}: {spreads}",
        )
    )
    levels: dict[str, Any] = {"control": control, **level.columns}
    if level.unstated:
        levels["units"] = _units(level.unstated, facts[0].path, answers)
    levels |= _dofs(answers)
    evidence = "columns of frequency, force, response and phase"
    return {"id": name, "kind": "stepped sine", "files": files, "levels": levels}, {"kind": evidence}


def _pattern(paths: Sequence[str]) -> str:
    """The names with ``*`` in place of what differs."""
    numbers = zip(*(_NUMBER.findall(path) for path in paths), strict=True)
    marks = [row[0] if len(set(row)) == 1 else "*" for row in numbers]
    return "".join(text + mark for text, mark in zip_longest(_NUMBER.split(paths[0]), marks, fillvalue=""))


def _units(unstated: Sequence[str], path: str, answers: Answers) -> dict[str, str]:
    """Units of the columns for which the file states none."""
    question = Question(
        f"level units {' '.join(unstated)}", f"Units of {', '.join(unstated)} in {path}, with commas, such as Hz, N, g?"
    )
    answer = answers.ask(question)
    if not answer:
        return dict.fromkeys(unstated, "TODO")
    texts = [part.strip() for part in answer.split(",")]
    if len(texts) != len(unstated):
        raise InputError("another number of units than of columns", where=path, got=len(texts), expected=len(unstated))
    return dict(zip(unstated, texts, strict=True))


def _dofs(answers: Answers) -> Mapping[str, str]:
    """DOFs of response and force; none where nobody knows them."""
    text = "Where were response and force of the stepped sines measured, such as 3:+Y, 3:+Y?"
    answer = answers.ask(Question("level dofs", text, UNSTATED))
    if answer == UNSTATED:
        return {}
    parts = [part.strip() for part in answer.split(",")]
    try:
        output, force = (str(Dof.parse(part)) for part in (parts * 2 if len(parts) == 1 else parts))
    except (EmaError, ValueError):
        raise InputError("not two DOFs", where="level dofs", got=repr(answer), expected="such as 3:+Y, 3:+Y") from None
    return {"output": output, "input": force}
