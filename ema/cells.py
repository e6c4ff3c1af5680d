"""Texts in CSV files that a spreadsheet would run as formulas."""

import re

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_STARTS = ("=", "+", "-", "@", "\t", "\r", "\n", "\uff1d", "\uff0b", "\uff0d", "\uff20")
_DIRECTION = re.compile(r"[-+](R?[XYZ])?")


def as_text(cell: str) -> str:
    """The cell with an apostrophe in front where a spreadsheet would take it for a formula.

    Numbers and directions (``-1.5e3``, ``+Z``) stay as they are.

    Source: OWASP, CSV Injection: cells that begin with ``=``, ``+``, ``-``, ``@``, their full-width
    forms, tab or a line end.
    """
    if not cell.startswith(_STARTS):
        return cell
    if _NUMBER.fullmatch(cell) or _DIRECTION.fullmatch(cell):
        return cell
    return "'" + cell
