"""The channel tables of a proposed campaign: roles, units, and where every sensor sat."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

from ema.dof import SCALAR, Dof
from ema.errors import EmaError, InputError
from ema.proposal.examination import FileFacts
from ema.proposal.file_names import Series, plain_direction
from ema.proposal.geometry_table import Points
from ema.proposal.questions import Answers, Question
from ema.proposal.roles import Judged
from ema.proposal.toml_text import table_text
from ema.proposal.units import quantity_of
from ema.units import FRF_OF_RESPONSE, SI_UNIT, UNSTATED, Quantity

_MANY = 6
"""Channels from which equal neighbours share one entry with ``columns``."""

_NOWHERE = 900
"""Beyond it are the nodes of channels of which nobody stated where they sat, so that none is that of a point."""
_UNPLACED = "a node of its own; nobody stated where it sat"
"""Comment of such a DOF in the proposed file."""

_BY_NAME = "the number in its name"
"""Comment of a DOF that is a number behind a word that need not mean a point."""

_NUMBER = re.compile(r"\D*?(?P<word>[A-Za-z]+)[ _.-]?(?P<node>\d+)(?![A-Za-z])\D*")
"""A name with one whole number, and the word before it."""
_AXIS = re.compile(r"(?P<stem>.*?)(?:[ _.:]+(?P<apart>[XYZ][+-]|[+-]?[XYZ])|-?(?P<joined>[XYZ][+-]?))", re.IGNORECASE)
"""A name that ends in a direction; a hyphen behind a letter is no sign."""
_MEMBER = re.compile(r"[./](data|values?)$", re.IGNORECASE)
"""Behind the name of a signal where a file has it as a member of a group of that name."""

_UNNAMED = re.compile(r"^(.* )?(row|column) \d+$")
_COMMENT = "#"
"""Key of a table under which its comments are kept until the text is written."""


def text_of(header: str, channel: Mapping[str, Any]) -> str:
    """One channel table as text."""
    plain = {name: value for name, value in channel.items() if name != _COMMENT}
    return table_text(header, plain, channel.get(_COMMENT))


def count_of(channel: Mapping[str, Any]) -> int:
    """How many channels of the file an entry stands for."""
    first, _, last = str(channel.get("columns", "1-1")).partition("-")
    return int(last) - int(first) + 1


def tables_of(
    facts: Sequence[FileFacts], series: Series, counts: str, answers: Answers, known: Points
) -> tuple[list[dict[str, Any]], list[dict[str, str]]]:
    """Channel tables of a run, and for each file the DOFs that its name states by channel; empty where none does."""
    if facts[0].record is not None:
        channels = _of_records(facts, counts, answers, known.nodes)
    else:
        channels = _of_frfs(facts, series, counts, answers, known.sensor)
    dofs: list[dict[str, str]] = [{} for _ in facts]
    if series.directed and counts == "points":
        dofs = _from_names(series, channels, facts[0].record is not None and facts[0].record.kind == "hammer")
    return channels, dofs


def _of_records(
    facts: Sequence[FileFacts], counts: str, answers: Answers, nodes: frozenset[int] | None
) -> list[dict[str, Any]]:
    """Every channel with its role, its unit where the file has none, and its DOF."""
    record = facts[0].record
    assert record is not None
    judged = list(record.channels)
    unnamed = all(_UNNAMED.match(one.name) for one in judged)
    judged = _named_force(judged, answers, facts[0].path)
    stated = _units(judged, answers, facts[0].path)
    placed = judged if counts == "points" or unnamed else _numbered(judged, nodes)
    by_number = [before is not after for before, after in zip(judged, placed, strict=True)]
    judged = placed
    dofs = _dofs(judged, counts)
    seen: set[tuple[str, Dof]] = set()
    channels: list[dict[str, Any]] = []
    numbers: dict[str, int] = {}
    for index, (one, unit, (dof, why)) in enumerate(zip(judged, stated, dofs, strict=True)):
        comments: dict[str, str] = {}
        channel: dict[str, Any] = {}
        double = [other.name for other in judged].count(one.name) > 1
        if unnamed or double:
            word = {"reference": "force", "response": "response"}.get(one.role, one.role)
            numbers[word] = numbers.get(word, 0) + 1
            several = sum(other.role == one.role for other in judged) > 1
            own = f"{word} {numbers[word]}" if several else word
            channel["name"] = own if unnamed else f"{one.name} {index + 1}"
            channel["column"] = index + 1
        else:
            channel["name"] = one.name
        channel["role"] = one.role
        if one.evidence:
            comments["role"] = one.evidence
        channel |= unit
        if one.role == "normal force":
            channel["joint"] = f"J{1 + sum(other.get('role') == 'normal force' for other in channels)}"
        if dof:
            channel["dof"] = dof
        if why or by_number[index]:
            comments["dof"] = why or _BY_NAME
        if one.dof is not None and one.role in ("reference", "response"):
            key = (one.role, one.dof.positive)
            if key in seen:
                channel["role"] = "other"
                comments["role"] = f"TODO: a second channel at {one.dof}; correct its dof, then its role"
            seen.add(key)
        if comments:
            channel[_COMMENT] = comments
        channels.append(channel)
    return _shortened(channels) if unnamed and len(channels) >= _MANY else channels


def _named_force(judged: list[Judged], answers: Answers, path: str) -> list[Judged]:
    """Ask which channel is the force where neither unit, name nor shape tells, and some channel may be one."""
    open_ = [one for one in judged if one.role == "response" and not one.named and one.quantity == "unstated"]
    if any(one.role == "reference" for one in judged) or not open_:
        return judged
    names = "" if all(_UNNAMED.match(one.name) for one in judged) else ": " + ", ".join(one.name for one in judged)
    text = f"Which channel of {path} is the measured force (1 to {len(judged)}, or none{names})?"
    answer = answers.ask(Question("force", text, "none"))
    if answer.lower() == "none":
        return judged
    if not answer.isdigit() or not 1 <= int(answer) <= len(judged):
        raise InputError("no such channel", where="force", got=answer, expected=f"1 to {len(judged)}, or none")
    index = int(answer) - 1
    force = judged[index]
    judged = list(judged)
    judged[index] = replace(force, role="reference", quantity="force", evidence="answered", named=True)
    return judged


def _units(judged: Sequence[Judged], answers: Answers, path: str) -> list[dict[str, Any]]:
    """Quantity and unit of each channel where the file states none: as answered, else unstated."""
    lacking = [k for k, one in enumerate(judged) if one.unit in (UNSTATED, "V") and one.role in _MEASURES]
    roles = list(dict.fromkeys(judged[k].role for k in lacking))
    given: dict[int, str] = {}
    if lacking:
        names = "; ".join(f"{role} ({_listed(judged, lacking, role)})" for role in roles)
        volts = " The file holds volts: give sensitivities such as 2.25 mV/N." if judged[lacking[0]].unit == "V" else ""
        answer = answers.ask(
            Question(
                f"units {' '.join(roles)}" if roles != ["reference", "response"] else "units",
                f"Units of {names}, with commas: one for each kind, or one for each channel?{volts}",
                ", ".join([UNSTATED] * len(roles)),
                evidence="units are never guessed: without them there is no scaling to modal mass",
            )
        )
        given = _distributed(answer, lacking, [judged[k].role for k in lacking], path)
    keys: list[dict[str, Any]] = []
    for index, one in enumerate(judged):
        if index in given:
            keys.append(_unit_keys(given[index], one))
        elif one.unit == UNSTATED:
            keys.append(({"quantity": one.quantity} if one.quantity != "unstated" else {}) | {"unit": UNSTATED})
        else:
            keys.append({})
    return keys


def _listed(judged: Sequence[Judged], lacking: Sequence[int], role: str) -> str:
    """The names of the channels of one role; of many, the first and the last."""
    names = [_label(k, judged[k]) for k in lacking if judged[k].role == role]
    return ", ".join(names) if len(names) <= _MANY else f"{names[0]} to {names[-1]}"


def _label(index: int, one: Judged) -> str:
    """What a question calls a channel: its name, or its number from 1."""
    return f"channel {index + 1}" if _UNNAMED.match(one.name) else one.name


_MEASURES = ("reference", "response", "normal force")


def _distributed(answer: str, lacking: Sequence[int], roles: Sequence[str], path: str) -> dict[int, str]:
    """A unit for every channel, from one for each channel or one for each role."""
    parts = [part.strip() for part in answer.split(",")]
    kinds = list(dict.fromkeys(roles))
    if len(parts) == len(lacking):
        texts = parts
    elif len(parts) == len(kinds):
        texts = [parts[kinds.index(role)] for role in roles]
    elif len(parts) == 1:
        texts = parts * len(lacking)
    else:
        raise InputError(
            "another number of units than of channels",
            where=path,
            got=len(parts),
            expected=f"{len(kinds)} or {len(lacking)}",
        )
    for text in texts:
        if text != UNSTATED and not text[:1].isdigit() and not quantity_of(text):
            raise InputError("not a unit", where=path, got=repr(text), expected="N, m/s^2, g, mm, or unstated")
    return dict(zip(lacking, texts, strict=True))


def _unit_keys(text: str, one: Judged) -> dict[str, Any]:
    if text[:1].isdigit():
        return {"sensitivity": text}
    if text == UNSTATED:
        return ({"quantity": one.quantity} if one.quantity not in ("unstated", "voltage") else {}) | {"unit": UNSTATED}
    return {"unit": text}


def _numbered(judged: Sequence[Judged], nodes: frozenset[int] | None) -> list[Judged]:
    """The channels with nodes from names such as ``A1``, ``A4``, ``Force A4``: one word with the number of a point.

    All responses without a DOF have that word and numbers of their own, and the geometry, if there is one, those nodes.
    """
    matches = [_NUMBER.fullmatch(_MEMBER.sub("", one.name)) for one in judged]
    last = [(match["word"].lower(), int(match["node"])) if match else ("", 0) for match in matches]
    responses = [last[k] for k, one in enumerate(judged) if one.role == "response" and not _placed(one)]
    word = responses[0][0] if responses else ""
    own = {number for _, number in responses}
    several = len(own) == len(responses) > 1
    if not word or not several or any(other != word for other, _ in responses) or not min(own):
        return list(judged)
    if nodes is not None and not own <= nodes:
        return list(judged)
    return [
        replace(one, dof=Dof(number)) if label == word and not _placed(one) else one
        for one, (label, number) in zip(judged, last, strict=True)
    ]


def _dofs(judged: Sequence[Judged], counts: str) -> list[tuple[str, str]]:
    """DOFs as texts, and comments: of the file or the name, the ``{point}`` of the file name, or a node of its own."""
    axes = _axes(judged)
    moving = _moving(judged, axes) if counts == "points" else []
    numbered = counts == "points" or any(_placed(one) for one in judged)
    dofs: list[tuple[str, str]] = []
    own: dict[Any, int] = {}
    for index, one in enumerate(judged):
        if one.role not in ("reference", "response"):
            dofs.append(("", ""))
            continue
        sensor, direction = axes.get(index, (index, ""))
        node = own.setdefault(sensor, len(own) + 1)
        if one.dof is not None and one.dof.direction != SCALAR:
            direction = one.dof.direction
        suffix = f":{direction}" if direction else ""
        if index in moving:
            contrary = f"TODO: its name says {one.dof}, and the names of the files count points"
            dofs.append((f"{{point}}{suffix}", contrary if one.dof_in_name and _placed(one) else ""))
        elif one.dof is not None and (_stated(one.dof) or len(judged) == 1):
            dofs.append((f"{one.dof.node}{suffix}" if one.dof_in_name else "", ""))
        else:
            dofs.append((f"{_NOWHERE + node if numbered else node}{suffix}", _UNPLACED if numbered else ""))
    return dofs


def _moving(judged: Sequence[Judged], axes: Mapping[int, tuple[str, str]]) -> list[int]:
    """Which channels moved from file to file: the force, or what has no DOF in its name where the force has one."""
    forces = [k for k, one in enumerate(judged) if one.role == "reference"]
    responses = [k for k, one in enumerate(judged) if one.role == "response"]
    open_ = [k for k in responses if not (judged[k].dof_in_name and _placed(judged[k]))]
    if not forces:
        return open_ or responses
    still = all(judged[k].dof_in_name and _placed(judged[k]) for k in forces)
    sensors = {axes.get(k, (k, ""))[0] for k in open_}
    return open_ if still and len(sensors) == 1 else forces


def _axes(judged: Sequence[Judged]) -> dict[int, tuple[str, str]]:
    """Sensor and direction of the responses of triaxial sensors: names that differ in X, Y and Z at their ends."""
    sensors: dict[str, dict[int, str]] = {}
    for index, one in enumerate(judged):
        match = _AXIS.fullmatch(_MEMBER.sub("", one.name))
        if match and one.role == "response" and not _placed(one):
            sensors.setdefault(match["stem"].lower(), {})[index] = plain_direction(match["apart"] or match["joined"])
    return {
        index: (stem, direction)
        for stem, directions in sensors.items()
        for index, direction in directions.items()
        if len({text[-1] for text in directions.values()}) == len(directions) > 1
    }


def _placed(one: Judged) -> bool:
    return one.dof is not None and _stated(one.dof)


def _stated(dof: Dof) -> bool:
    return dof.node > 0


def _shortened(channels: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Equal neighbours as one entry with ``columns`` and ``dof = "{column}"``."""
    short: list[dict[str, Any]] = []
    for channel in channels:
        same = {key: value for key, value in channel.items() if key not in ("name", "column", "dof")}
        before = short[-1] if short else {}
        if {key: value for key, value in before.items() if key not in ("name", "columns", "dof")} == same:
            before["columns"] = f"{str(before['columns']).split('-')[0]}-{channel['column']}"
            continue
        word = re.sub(r" \d+$", "", str(channel["name"]))
        dof = {"dof": "{column}"} if "dof" in channel else {}
        short.append({"name": word, "columns": f"{channel['column']}-{channel['column']}"} | same | dof)
    return short


def _of_frfs(
    facts: Sequence[FileFacts], series: Series, counts: str, answers: Answers, sensor: int | None
) -> list[dict[str, Any]]:
    """Channel tables of FRFs: only where the file lacks units or DOFs."""
    frfs = facts[0].frfs[0]
    response = next((quantity for quantity, kind in FRF_OF_RESPONSE.items() if kind == frfs.quantity), "unstated")
    known = (
        _stated(frfs.outputs[0])
        and _stated(frfs.inputs[0])
        and not (frfs.outputs[0] == frfs.inputs[0] and frfs.outputs[0].direction == SCALAR)
    )
    if frfs.scaled and known:
        return []
    force: dict[str, Any] = {"name": "force", "role": "reference"}
    motion: dict[str, Any] = {"name": "response", "role": "response"}
    if frfs.scaled:
        force["unit"], motion["unit"] = "N", SI_UNIT[response]
    else:
        judged = [
            Judged("force", "reference", "force", UNSTATED, None, "", True),
            Judged("response", "response", cast(Quantity, response), UNSTATED, None, "", True),
        ]
        first, second = _units(judged, answers, facts[0].path)
        force, motion = force | first, motion | second
    if not known:
        _place_frfs(force, motion, facts, series, (counts, answers, sensor))
    return [force, motion]


def _place_frfs(
    force: dict[str, Any],
    motion: dict[str, Any],
    facts: Sequence[FileFacts],
    series: Series,
    about: tuple[str, Answers, int | None],
) -> None:
    """DOFs of FRFs whose files state none: the number in the name is the point of one side, the other stays."""
    counts, answers, sensor = about
    frfs = facts[0].frfs[0]
    if counts != "points":
        force["dof"], motion["dof"] = "1", "2"
        return
    if series.directed:
        return
    moved = answers.ask(
        Question(
            "moved",
            f"Which moved from file to file of {series.names[0].series}: the force (roving hammer) or the response?",
            "force",
            ("force", "response"),
        )
    )
    still, moving = (motion, force) if moved == "force" else (force, motion)
    direction = frfs.inputs[0].direction
    suffix = "" if direction == SCALAR else f":{direction}"
    moving["dof"] = f"{{point}}{suffix}"
    other = "response" if moved == "force" else "force"
    text = answers.ask(
        Question(
            "fixed",
            f"Where was the {other}, point and direction, such as 4:-X?",
            f"{sensor or 1}{suffix}",
            evidence="the table of positions has it there" if sensor else "",
        )
    )
    try:
        still["dof"] = str(Dof.parse(text))
    except EmaError as error:
        raise InputError(
            error.what, where="fixed", got=error.got, expected=error.expected, advice=error.advice
        ) from error


def _from_names(series: Series, channels: list[dict[str, Any]], hammer: bool) -> list[dict[str, str]]:
    """DOFs by channel name that the names of the files state."""
    responses = [channel for channel in channels if channel["role"] == "response"]
    forces = [channel for channel in channels if channel["role"] == "reference"]
    by_file: list[dict[str, str]] = []
    for name in series.names:
        stated = series.dofs(name)
        dofs: dict[str, str] = {}
        if "input" in stated and len(forces) == 1:
            dofs[forces[0]["name"]] = str(stated["input"])
        # a pair states the response first; a single DOF is that of what moved: the hammer, or the one response
        still = len(forces) == 1 and not forces[0].get("dof", "{point}").startswith("{point}")
        roving_hammer = len(forces) == 1 and not still and (hammer or len(responses) != 1) and "input" not in stated
        mover = forces if roving_hammer else responses
        if still:
            mover = [channel for channel in responses if channel.get("dof", "").startswith("{point}")]
        if "point" in stated and len(mover) == 1:
            dofs[mover[0]["name"]] = str(stated["point"])
        elif "point" in stated and still:
            node = str(stated["point"].node)
            dofs |= {channel["name"]: channel["dof"].replace("{point}", node) for channel in mover}
        by_file.append(dofs)
    for channel in (*responses, *forces):
        if any(channel["name"] in dofs for dofs in by_file):
            channel.pop("dof", None)
        elif channel.get("dof", "").startswith("{point}"):
            channel["dof"] = str(_NOWHERE + 1 + channels.index(channel))
            channel[_COMMENT] = {**channel.get(_COMMENT, {}), "dof": _UNPLACED}
    return by_file
