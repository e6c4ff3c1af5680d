"""Texts in CSV files that a spreadsheet would run as formulas."""

import re

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_DIRECTION = re.compile(r"[-+](R?[XYZ])?")


def as_text(cell: str) -> str:
    """The cell with an apostrophe in front where a spreadsheet would take it for a formula.

    Numbers and directions (``-1.5e3``, ``+Z``) stay as they are.

    Source: OWASP, CSV Injection: cells that begin with ``=``, ``+``, ``-``, ``@``, tab or carriage return.
    """
    if cell[:1] not in ("=", "+", "-", "@", "\t", "\r", "\n") or not cell:
        return cell
    if _NUMBER.fullmatch(cell) or _DIRECTION.fullmatch(cell):
        return cell
    return "'" + cell
