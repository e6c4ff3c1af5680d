"""Matrices in Harwell-Boeing files, as ANSYS writes them with HBMAT: symmetric ones hold one triangle."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ema.errors import InputError

_MOST = 20_000
"""Rows of the largest matrix that is read: in full it takes 3.2 GB. A larger one is refused with a sentence."""
_CONTROL = re.compile(r"[\0-\x08\v\f\x0e-\x1f\x85\xa0]")
"""What no text of numbers holds; a conversion to numbers takes some of them for blanks."""
_FORMAT = re.compile(r"(\d*)\s*([IFEDG])\s*(\d+)", re.IGNORECASE)
# An edit descriptor with an exponent writes a digit other than 0 before the point of all numbers (scale factor 1P) or
# of none (0P, where the 0 is optional): ISO/IEC 1539-1, "E and D editing". Both in one file: a digit was lost.
_FIRST_DIGIT = re.compile(r"[+-]?[1-9]\.\d*[ED]", re.IGNORECASE)
_WITHOUT_FIRST_DIGIT = re.compile(r"[+-]?\.\d+[ED][+-]?\d+", re.IGNORECASE)


def check_size(size: int, path: Path) -> None:
    """Refuse matrices that are too large to be held in full.

    Raises
    ------
    InputError : more rows than the simulator can take.
    """
    if size > _MOST:
        raise InputError(
            "the matrix is too large",
            where=str(path),
            got=f"{size} rows",
            expected=f"at most {_MOST}",
            advice="reduce the model to its contact and measured DOFs",
        )


def read(path: Path) -> Float[np.ndarray, "n n"]:
    """The square matrix of an assembled, real Harwell-Boeing file, both triangles filled.

    Source: Duff, Grimes, Lewis, Users' guide for the Harwell-Boeing sparse matrix collection (1992).

    Parameters
    ----------
    path : text file of type RSA (one triangle) or RUA.

    Returns
    -------
    The matrix (n, n), dense, in the units of the model it was written from.

    Raises
    ------
    InputError : binary, cut short, complex, unassembled or not square.
    """
    try:
        text = path.read_text(encoding="latin-1")
    except OSError as error:
        raise InputError(
            f"the file cannot be read: {error.strerror or error}",
            where=str(path),
            advice="check the name, and that it is a file that you may read",
        ) from error

    def wrong(what: str, got: object = None, advice: str = "") -> InputError:
        return InputError(
            what,
            where=str(path),
            got=got,
            expected="an assembled real matrix (RSA or RUA) as text",
            advice=advice or "HBMAT,name,matrix,,ASCII,STIFF writes one",
        )

    lines = text.splitlines()
    try:
        counts = [int(word) for word in lines[1].split()[1:4]]
        kind, rows, columns, entries = lines[2][:3].upper(), *(int(word) for word in lines[2][3:].split()[:3])
        formats = [_layout(text) for text in _formats(lines[3])]
    except (IndexError, ValueError, TypeError) as error:
        raise wrong("not a Harwell-Boeing file", repr(lines[0][:40]) if lines else "an empty file") from error
    if kind not in ("RSA", "RUA") or rows != columns:
        raise wrong("not a matrix that a structure can have", f"{kind}, {rows} x {columns}")
    check_size(rows, path)
    try:
        parts = _parts(lines, counts, formats, (columns + 1, entries, entries), wrong)
    except (ValueError, IndexError, ArithmeticError) as error:
        raise wrong("the header is damaged", str(error)[:60]) from error
    matrix, control = _filled(parts, rows, kind == "RSA", wrong), _CONTROL.search(text)
    if control:
        raise wrong("a control character, which may stand in the place of a sign or a digit", repr(control[0]))
    return matrix


def _parts(
    lines: list[str], counts: list[int], formats: list[tuple[int, int]], wanted: tuple[int, int, int], wrong: Any
) -> list[list[str]]:
    """Pointers, row indices and values as texts, as many lines and numbers of each as the header announces.

    Raises
    ------
    InputError : there are more, fewer, or some that do not end where their field does.
    ValueError : the counts of the header cannot be read.
    """
    total = [int(word) for word in lines[1].split()]
    # a fifth header line stands there when right-hand sides follow the matrix
    first = 5 if len(total) > 4 and total[4] > 0 else 4
    parts = []
    for count, layout, number in zip(counts, formats, wanted, strict=True):
        body = lines[first : first + count]
        if _narrower(body, layout, number):
            layout = (layout[0], layout[1] - 1)
        values = list(_numbers(body, *layout))
        if len(values) < number:
            raise wrong("the file ends too early", f"{len(values)} of {number} numbers", "copy or export it again")
        if len(values) > number or len(body) != -(-number // layout[0]):
            raise wrong(
                "more numbers or lines than the header announces",
                f"{len(values)} of {number} numbers",
                "copy or export it again",
            )
        odd = next((text for line in body for text in _fields(line, *layout) if text[-1:].isspace()), None)
        odd = next((line for line in body if len(line.rstrip()) % layout[1]), odd)
        if odd is not None:
            raise wrong("a number that does not end where its field does", repr(odd[-30:]), "copy or export it again")
        parts.append(values)
        first += count
    right_hand_sides = total[4] if len(total) > 4 else 0
    if any(line.strip() for line in lines[first + right_hand_sides :]) or total[0] != sum(total[1:5]):
        raise wrong(
            "lines behind the matrix that the header does not announce",
            f"{len(lines) - first} lines",
            "copy or export it again",
        )
    return parts


def _narrower(body: list[str], layout: tuple[int, int], number: int) -> bool:
    """Whether every line is as long as fields one character narrower than announced make it.

    ``scipy.io.hb_write`` announces ``3E25.16`` and writes ``%24.16E`` without a blank between.
    """
    per_line, width = layout
    wanted = [per_line] * (number // per_line) + [number % per_line] * (number % per_line > 0)
    lengths = [len(line.rstrip()) for line in body]
    return number > 1 and width > 20 and lengths == [count * (width - 1) for count in wanted]


def _filled(parts: list[list[str]], size: int, symmetric: bool, wrong: Any) -> Float[np.ndarray, "n n"]:
    try:
        starts, places = (np.array(part, dtype=np.int64) - 1 for part in parts[:2])
        values = np.array([text.replace("D", "E").replace("d", "e") for text in parts[2]], dtype=np.float64)
    except ValueError as error:
        raise wrong("a number cannot be read", str(error)) from error
    if np.any(np.diff(starts) < 0) or starts[0] != 0 or starts[-1] != len(values):
        raise wrong("the columns of the matrix do not add up", f"{starts[-1]} entries announced, {len(values)} there")
    if len(places) and not 0 <= places.min() <= places.max() < size:
        raise wrong("an entry outside the matrix", f"row {places.max() + 1} of {size}")
    if len({text[place].upper() for text in parts[2] if (place := _exponent(text))}) > 1:
        raise wrong("exponents with E and with D, though one format wrote them all", None, "copy or export it again")
    bare = next((text for text in parts[2] if _WITHOUT_FIRST_DIGIT.fullmatch(text)), None)
    if bare is not None and any(_FIRST_DIGIT.match(text) for text in parts[2]):
        raise wrong("a number that has lost its first digit", repr(bare), "copy or export it again")
    if not np.isfinite(values).all():
        raise wrong("a number that is not finite", str(values[~np.isfinite(values)][0]), "export it again")
    column = np.repeat(np.arange(size), np.diff(starts))
    matrix = np.zeros((size, size))
    if len(np.unique(column * size + places)) < len(places):
        raise wrong("an entry of the matrix occurs twice", None, "export it again")
    matrix[places, column] = values
    if not symmetric:
        return matrix
    if np.any(np.triu(matrix, 1)) and np.any(np.tril(matrix, -1)):
        if not np.allclose(matrix, matrix.T, rtol=1e-6, atol=0):
            raise wrong(
                "an entry on the wrong side of the diagonal: announced as symmetric, and is not",
                None,
                "export it again",
            )
        return matrix  # some writers announce RSA and hold both triangles
    return np.asarray(matrix + matrix.T - np.diag(np.diag(matrix)))


def _exponent(text: str) -> int:
    """Place of the letter of an exponent, 0 without one."""
    return max(text.upper().find("E"), text.upper().find("D"), 0)


def _formats(line: str) -> list[str]:
    found = re.findall(r"\(([^()]*)\)", line)
    if len(found) < 3:
        raise ValueError(line)
    return found[:3]


def _layout(text: str) -> tuple[int, int]:
    """Numbers per line and width of each of a Fortran format such as ``8I10`` or ``1P,4D25.15``."""
    found = _FORMAT.search(re.sub(r"\d+\s*P\s*,?", "", text, flags=re.IGNORECASE))
    if found is None:
        raise ValueError(text)
    return int(found[1] or 1), int(found[3])


def _numbers(lines: list[str], per_line: int, width: int) -> Iterator[str]:
    return (text.strip() for line in lines for text in _fields(line, per_line, width))


def _fields(line: str, per_line: int, width: int) -> list[str]:
    """The fields of a line that are not blank; Fortran puts a number at the end of its field."""
    fields = [line[place * width : (place + 1) * width] for place in range(per_line)]
    return [text for text in fields if text.strip()]
