"""Mass and stiffness matrices of finite element programs, and the table that says which row is which DOF."""

import re
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from acquisition.files import harwell_boeing, sniff
from acquisition.isolated import ParserError, call
from ema.data import Matrices
from ema.dof import Dof
from ema.errors import EmaError, InputError

_LABELS = {"UX": "+X", "UY": "+Y", "UZ": "+Z", "ROTX": "+RX", "ROTY": "+RY", "ROTZ": "+RZ"}
_BANNER = "%%MatrixMarket"


def read_matrix(path: Path) -> Float[np.ndarray, "n n"]:
    """The square matrix in a Matrix Market or Harwell-Boeing file, both triangles filled.

    Raises
    ------
    InputError : no such file, damaged, not square, complex or binary.
    """
    try:
        with open(path, "rb") as file:
            head = file.read(64)
    except OSError as error:
        raise InputError(
            f"the file cannot be read: {error.strerror or error}",
            where=str(path),
            advice="check the name, and that it is a file that you may read",
        ) from error
    if not head.startswith(_BANNER.encode()) and sniff.as_ascii(head).lower().startswith(_BANNER.lower().encode()):
        raise InputError(
            "the first line of a Matrix Market file is not written as the format wants it",
            where=str(path),
            got=f"first bytes {head[:16]!r}",
            expected=f"{_BANNER} in ASCII, without a byte order mark",
            advice="save it as plain text",
        )
    if b"\0" in head:
        raise InputError(
            "a binary file",
            where=str(path),
            expected="Harwell-Boeing or Matrix Market text",
            advice="export it as text (HBMAT with the form ASCII)",
        )
    return _market(path) if head.startswith(_BANNER.encode()) else harwell_boeing.read(path)


def _market(path: Path) -> Float[np.ndarray, "n n"]:
    try:
        there = call("market", path)
    except (ParserError, OSError) as error:
        raise InputError(f"damaged Matrix Market file: {error}", where=str(path), advice="export it again") from error
    values, shape = there["values"], there["shape"]
    if len(shape) != 2 or shape[0] != shape[1] or np.iscomplexobj(values):
        raise InputError(
            "not a matrix that a structure can have",
            where=str(path),
            got=f"{values.dtype}, {' x '.join(map(str, shape))}",
            expected="real and square",
        )
    if not np.isfinite(values).all():
        raise InputError("a number that is not finite", where=str(path), advice="export it again")
    if "rows" not in there:
        return np.asarray(values, dtype=np.float64)
    rows, columns = there["rows"], there["columns"]
    if len(np.unique(rows * shape[0] + columns)) < len(rows):
        raise InputError("an entry of the matrix occurs twice", where=str(path), advice="export it again")
    matrix = np.zeros(shape)
    matrix[rows, columns] = values
    return matrix


def entries(path: Path) -> dict[str, Any]:
    """Read the entries of a Matrix Market file.

    Parameters
    ----------
    path : Path
        File that begins with the banner of the format.

    Returns
    -------
    dict
        ``shape``: rows and columns of the matrix; ``values`` (n, n) of a dense matrix, or ``rows``, ``columns`` and
        ``values`` (entry,) of a sparse one, counted from 0.

    Raises
    ------
    InputError
        The matrix is too large to be kept in full, or has a pattern without values.
    """
    from scipy.io import mminfo, mmread

    height, width, _, layout, field, _ = mminfo(path)
    if field == "pattern":
        raise InputError(
            "a pattern without values", where=str(path), expected="real entries", advice="export it with its values"
        )
    shape = [int(height), int(width)]
    harwell_boeing.check_size(max(shape), path)
    _check_lines(path, layout == "coordinate", field)
    matrix = mmread(path)
    if isinstance(matrix, np.ndarray):
        return {"shape": list(matrix.shape), "values": matrix}
    rows, columns = (np.asarray(place, dtype=np.int64) for place in (matrix.row, matrix.col))
    return {"shape": shape, "rows": rows, "columns": columns, "values": matrix.data}


_WHOLE = rb"[-+]?\d++"
_NUMBER = rb"[-+]?(?>\d++\.?+\d*+|\.\d++|nan|inf(?:inity)?)(?>[eE][-+]?\d++)?"


def _check_lines(path: Path, coordinate: bool, field: str) -> None:
    """Refuse a Matrix Market file with a line that is not row, column and value; the library reads what it can of one.

    Source: Boisvert, Pozo, Remington, The Matrix Market exchange formats (1996), sections 2 and 3.

    Raises
    ------
    ValueError : there is one.
    """
    values = 2 if field == "complex" else 1
    number = _WHOLE if field in ("integer", "unsigned-integer") else _NUMBER
    words = [rb"\d++"] * (2 if coordinate else 0) + [number] * values
    line = rb"[ \t]*+" + rb"[ \t]++".join(words) + rb"[ \t\r]*+(?:\n|\Z)"
    banner, _, body = path.read_bytes().partition(b"\n")
    foreign = re.search(rb"[^ -~\r\t]|\r(?!\Z)", banner)
    if foreign:
        raise ValueError(f"the first line holds a character that the format does not allow: {foreign[0]!r}")
    # comments, and the line of sizes; not all programs take other characters than these for the blanks in it
    head = re.match(rb"(?>%[^\n]*+\n|[ \t\r]*+\n)*+[ \t]*+\d++(?:[ \t]++\d++)*+[ \t]*+\r*+(?:\n|\Z)", body)
    begin = head.end() if head else 0
    good = re.compile(rb"(?>" + line + rb"|[ \t\r]*+\n)*+\s*+", re.IGNORECASE).match(body, begin)
    end = good.end() if good else begin
    if end < len(body):
        where = body.count(b"\n", 0, end) + 2
        text = body[end : end + 40].partition(b"\n")[0].decode("latin-1")
        raise ValueError(f"line {where} is no entry: {text!r}")


def read_dofs(path: Path, part: str = "") -> tuple[Dof, ...]:
    """The DOFs of the rows: a mapping file of ANSYS (equation, node, label), or lines such as ``12:+Z``.

    Raises
    ------
    InputError : no such file, a line that names no DOF, a DOF named twice or a row left out.
    """
    try:
        lines = sniff.as_ascii(path.read_bytes()).decode("latin-1").splitlines()
    except OSError as error:
        raise InputError(
            f"the file cannot be read: {error.strerror or error}",
            where=str(path),
            advice="check the name, and that it is a file that you may read",
        ) from error
    found: dict[int, Dof] = {}
    for number, line in enumerate(lines, 1):
        text = line.split("#")[0].replace(",", " ").strip()
        if not text:
            continue
        entry = _entry(text, part, len(found) + 1)
        if entry is None:
            if found or not re.search(r"[A-Za-z]{3}", text):
                raise InputError(
                    "a line that names no DOF",
                    where=f"{path}, line {number}",
                    got=repr(text[:40]),
                    expected="equation, node and label such as '7 12 UZ', or 12:+Z",
                )
            continue  # a title
        row, dof = entry
        if row in found or dof in found.values():
            raise InputError(
                "a row or DOF named twice",
                where=f"{path}, line {number}",
                got=repr(text[:40]),
                expected="each row and each DOF once",
                advice="correct the line, or export the mapping again",
            )
        found[row] = dof
    if sorted(found) != list(range(1, len(found) + 1)) or not found:
        raise InputError(
            "rows are left out",
            where=str(path),
            got=f"{len(found)} rows up to {max(found, default=0)}",
            expected="every row from 1 on",
        )
    return tuple(found[row] for row in sorted(found))


def _entry(text: str, part: str, following: int) -> tuple[int, Dof] | None:
    """Row and DOF of one line; ``None`` where the line is something else."""
    words = text.split()
    if len(words) == 3 and words[0].isdigit() and words[1].isdigit():
        label = words[2].upper()
        direction = _LABELS.get(label)
        return None if direction is None else (int(words[0]), Dof(int(words[1]), direction, part))
    try:
        dof = Dof.parse(text.replace(" ", ""))
    except EmaError:
        return None
    return following, Dof(dof.node, dof.direction, dof.part or part)


def structure(
    mass: Path, stiffness: Path, dofs: tuple[Dof, ...], length: float = 1.0, mass_unit: float = 1.0
) -> Matrices:
    """A structure from its two files, in SI.

    ``length`` m and ``mass_unit`` kg are the units the program worked in (mm and t: 0.001 and 1000), with seconds.

    Raises
    ------
    InputError : the matrices and the table of DOFs differ in size.
    """
    matrices = {path: read_matrix(path) for path in (mass, stiffness)}
    for path, matrix in matrices.items():
        if len(matrix) != len(dofs):
            raise InputError(
                "the matrix and its table of DOFs differ in size",
                where=str(path),
                got=f"{len(matrix)} rows, {len(dofs)} DOFs",
                advice="export both matrices and the mapping from one solution",
            )
    # generalised displacements of the file per SI unit, and its unit of energy
    per_si = np.array([1.0 if dof.axis.startswith("R") else 1 / length for dof in dofs])
    energy = mass_unit * length**2
    scale = energy * np.outer(per_si, per_si)
    return Matrices(matrices[mass] * scale, matrices[stiffness] * scale, dofs)
