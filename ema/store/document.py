"""Containers as plain trees of text and numbers, with their arrays set aside; knows nothing of HDF5."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from datetime import datetime
from typing import Any

import numpy as np

from ema import data
from ema.data import Lazy
from ema.data.window import Window
from ema.dof import Dof
from ema.errors import InputError
from ema.own_functions import LawName
from ema.store.meaning import Meaning, meaning

CONTAINERS: dict[str, type] = {
    name: container
    for name, container in (("Dof", Dof), *((name, getattr(data, name)) for name in data.__all__))
    if is_dataclass(container) and isinstance(container, type)
}
"""What a file may hold; nothing else is ever built from one."""

_LATE = (data.Recording, data.FrfSet)


@dataclass
class Parts:
    """What a tree leaves out: arrays by path, and sequences whose items are written and read one by one.

    ``nodes`` are the places of the arrays in the tree, where whoever writes them notes their checksums.
    """

    arrays: dict[str, tuple[np.ndarray | Window, Meaning]] = field(default_factory=dict)
    nodes: dict[str, dict[str, Any]] = field(default_factory=dict)
    sequences: dict[str, Sequence[Any]] = field(default_factory=dict)


def encode(value: Any, parts: Parts, path: str = "", what: Meaning | None = None) -> Any:
    """The tree of ``value``; its arrays and long sequences go to ``parts`` under their ``path``.

    Raises
    ------
    InputError : ``value`` holds something that is no container, array, number, text or tuple of them.
    """
    match value:
        case None | bool() | int():
            return value
        case str():
            return str(value)
        case np.ndarray() | Window():
            parts.arrays[path] = (value, what or Meaning())
            parts.nodes[path] = {"$array": path}
            return parts.nodes[path]
        case np.bool_() | np.integer():
            return value.item()
        case float() | np.floating():
            return float(value) if math.isfinite(value) else {"$float": repr(float(value))}
        case complex() | np.complexfloating():
            return {"$complex": [repr(float(value.real)), repr(float(value.imag))]}
        case datetime():
            return {"$time": value.isoformat()}
        case Lazy():
            return _set_aside(value, parts, path)
        case tuple() | list():
            if value and all(isinstance(item, _LATE) for item in value):
                return _set_aside(value, parts, path)
            return [encode(item, parts, _below(path, str(place))) for place, item in enumerate(value)]
    if is_dataclass(value) and CONTAINERS.get(type(value).__name__) is type(value):
        tree: dict[str, Any] = {"$noun": type(value).__name__}
        for member in fields(value):
            if member.init:
                part, about = getattr(value, member.name), meaning(value, member.name)
                if isinstance(part, LawName) and isinstance(value, data.FrictionLaw):
                    tree[member.name] = {"$law": str(part), "fingerprint": part.fingerprint, "module": part.module}
                else:
                    tree[member.name] = encode(part, parts, _below(path, member.name), about)
        return tree
    raise InputError(
        "cannot be stored",
        where=path,
        got=type(value).__name__,
        expected="one of " + ", ".join(CONTAINERS),
    )


def _set_aside(items: Sequence[Any], parts: Parts, path: str) -> dict[str, Any]:
    parts.sequences[path] = items
    return {"$items": path, "count": len(items)}


def _below(path: str, name: str) -> str:
    return f"{path}/{name}" if path else name


def decode(
    tree: Any,
    array: Callable[[str, int | None], np.ndarray],
    item: Callable[[str, int], Any],
    window: Callable[[str], Window] | None = None,
) -> Any:
    """The value of a ``tree``; ``array(path, checksum)`` delivers its arrays, ``item(path, place)`` items of sequences,
    ``window(path)`` arrays that were written in blocks, which are read whole without it.

    Raises
    ------
    InputError : the tree names an unknown container or field, or its values do not make one.
    """
    match tree:
        case None | bool() | int() | float() | str():
            return tree
        case list():
            return tuple(decode(member, array, item, window) for member in tree)
        case {"$array": str() as path, "in_blocks": True} if window is not None:
            return window(path)
        case {"$array": str() as path}:
            return array(path, tree.get("crc32"))
        case {"$float": str() as text}:
            return float(text)
        case {"$complex": [str() as real, str() as imaginary]}:
            return complex(float(real), float(imaginary))
        case {"$time": str() as text}:
            return datetime.fromisoformat(text)
        case {"$law": str() as name, "fingerprint": str() as text, "module": str() as home}:
            return LawName(name, text, home)
        case {"$items": str() as path, "count": int() as count}:
            return Lazy([lambda place=place: item(path, place) for place in range(count)])  # type: ignore[misc]
        case {"$noun": str() as name}:
            members = {key: decode(member, array, item, window) for key, member in tree.items() if key != "$noun"}
            return _build(name, members)
    raise InputError(
        "holds something that this version does not know",
        got=str(tree)[:60],
        advice="update with: pip install -U friction-ema; if that does not help, read the file from a backup",
    )


def _build(name: str, members: dict[str, Any]) -> Any:
    container = CONTAINERS.get(name)
    if container is None:
        raise InputError("holds an unknown container", got=name, expected="one of " + ", ".join(CONTAINERS))
    known = {member.name for member in fields(container) if member.init}
    strange = sorted(set(members) - known)
    if strange:
        raise InputError(
            f"{name} holds fields that this version does not know",
            got=", ".join(strange),
            advice="it was written by a newer friction-ema: update with pip install -U friction-ema",
        )
    try:
        return container(**members)
    except InputError as error:  # without its place, so that the file is named; the sentence says of which field it is
        what = f"{error.where}: {error.what}" if error.where else error.what
        raise InputError(what, got=error.got, expected=error.expected, advice=error.advice) from error
    except Exception as error:  # whatever a damaged file makes a constructor raise, the caller gets one sentence
        raise InputError(
            f"{name} in the file is damaged ({str(error).splitlines()[0][:120]})",
            advice="read the file from a backup, or measure or compute it again",
        ) from error
