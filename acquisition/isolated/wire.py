"""Messages between two processes: a tree of JSON and the bytes of its arrays; nothing in a message is executed.

A message is the length of the JSON text (8 bytes, little-endian), the text, and the arrays one behind the other in C
order. In the tree an array is ``{"$array": number}``; the text lists type and shape of each.
"""

import json
import math
import re
from typing import IO, Any

import numpy as np

_NUMBERS = re.compile(r"[<>|=]?[biufcS]\d+")
_MOST_TEXT = 1 << 30
"""Bytes of JSON that are taken: a thousand million, which is more than any table of texts needs."""


class Broken(Exception):
    """The stream ends inside a message, or holds none."""


def send(file: IO[bytes], tree: Any) -> None:
    """Write a tree of dicts with text keys, lists, texts, numbers and arrays of numbers, bytes or texts."""
    arrays: list[Any] = []
    text = json.dumps(_without_arrays(tree, arrays))
    about = [{"dtype": array.dtype.str, "shape": list(array.shape)} for array in arrays]
    head = json.dumps({"tree": text, "arrays": about}).encode("ascii")
    file.write(len(head).to_bytes(8, "little") + head)
    for array in arrays:
        if array.size:
            file.write(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)
    file.flush()


def receive(file: IO[bytes]) -> Any:
    """Read a tree.

    Raises
    ------
    Broken : the stream ends, or does not hold what it announces.
    """
    size = int.from_bytes(_bytes(file, 8), "little")
    if size > _MOST_TEXT:
        raise Broken("a message of impossible length")
    try:
        head = json.loads(_bytes(file, size))
        arrays = [_array(file, str(about["dtype"]), tuple(map(int, about["shape"]))) for about in head["arrays"]]
        return _with_arrays(json.loads(head["tree"]), arrays)
    except (ValueError, KeyError, TypeError, IndexError, RecursionError) as error:
        raise Broken(str(error)) from error


def _bytes(file: IO[bytes], size: int) -> bytes:
    data = file.read(size)
    if len(data) != size:
        raise Broken("the stream ends")
    return data


def _array(file: IO[bytes], kind: str, shape: tuple[int, ...]) -> Any:
    if not _NUMBERS.fullmatch(kind) or min(shape, default=0) < 0:
        raise ValueError(f"an array of type {kind}, shape {shape}")
    raw = np.empty(math.prod(shape) * np.dtype(kind).itemsize, np.uint8)
    view, done = raw.data, 0
    while done < len(raw):
        count = file.readinto(view[done:])  # type: ignore[attr-defined]
        if not count:
            raise Broken("the stream ends")
        done += count
    return raw.view(kind).reshape(shape)


def _without_arrays(node: Any, arrays: list[Any]) -> Any:
    if isinstance(node, dict):
        return {str(key): _without_arrays(value, arrays) for key, value in node.items()}
    if isinstance(node, (list, tuple)):
        return [_without_arrays(value, arrays) for value in node]
    if isinstance(node, np.generic):
        node = np.asarray(node)
    if isinstance(node, np.ndarray):
        if node.dtype.kind == "U":
            return {"$texts": node.reshape(-1).tolist(), "shape": list(node.shape)}
        if not _NUMBERS.fullmatch(node.dtype.str):
            raise TypeError(f"an array of type {node.dtype} cannot be sent")
        arrays.append(node)
        return {"$array": len(arrays) - 1}
    if isinstance(node, complex):
        return _without_arrays(np.asarray(node), arrays)
    return node


def _with_arrays(node: Any, arrays: list[Any]) -> Any:
    if isinstance(node, dict):
        if "$array" in node:
            return arrays[node["$array"]]
        if "$texts" in node:
            return np.array(node["$texts"], dtype=np.str_).reshape(node["shape"])
        return {key: _with_arrays(value, arrays) for key, value in node.items()}
    if isinstance(node, list):
        return [_with_arrays(value, arrays) for value in node]
    return node
