"""Tables as the text of a TOML file, with comments where something is assumed."""

import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

_BARE = re.compile(r"^[A-Za-z0-9_-]+$")
_WIDE = 110
"""Characters of a line beyond which a list is written over several."""


def value_text(value: Any) -> str:
    """A value in TOML.

    Examples
    --------
    >>> value_text({"time": "row 0", "units": ["N", "g"]})
    '{ time = "row 0", units = ["N", "g"] }'
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # a JSON string but for the one control character that JSON leaves alone
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, Mapping):
        inner = ", ".join(f"{key_text(name)} = {value_text(one)}" for name, one in value.items())
        return f"{{ {inner} }}" if inner else "{}"
    if isinstance(value, Sequence):
        return "[" + ", ".join(map(value_text, value)) + "]"
    raise TypeError(f"no TOML for {type(value).__name__}")


def key_text(name: str) -> str:
    """A key, in quotation marks where it needs them."""
    return name if _BARE.match(name) else value_text(name)


def table_text(header: str, table: Mapping[str, Any], comments: Mapping[str, str] | None = None) -> str:
    """A table with its header; ``comments`` by key stand behind the value, that of ``""`` above the header."""
    comments = comments or {}
    text = "".join(f"# {line}\n" for line in comments.get("", "").splitlines())
    text += f"{header}\n"
    for name, value in table.items():
        line = f"{key_text(name)} = {value_text(value)}"
        if isinstance(value, Sequence) and not isinstance(value, str) and len(line) > _WIDE:
            line = f"{key_text(name)} = [\n" + "".join(f"    {value_text(one)},\n" for one in value) + "]"
        comment = comments.get(name, "")
        text += f"{line}{'  # ' + comment if comment else ''}\n"
    return text
