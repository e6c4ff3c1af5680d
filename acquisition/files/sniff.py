"""Recognise a format by the first bytes of a file."""

import gzip
import re
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from acquisition.isolated import call
from acquisition.isolated.limits import too_large
from acquisition.isolated.limits import unpacked as most_unpacked
from ema.errors import InputError

HEAD = 4096
"""Bytes at the start of a file by which its format is recognised."""
_PIECE = 1 << 20


def head(path: Path) -> bytes:
    """The first bytes of a file, unpacked where it is gzipped.

    Raises
    ------
    InputError : no such file, a folder, an empty file, or one that may not be read.
    """
    if path.is_dir():
        raise InputError("a folder, not a file", where=str(path), advice="name a file inside it")
    try:
        with path.open("rb") as file:
            start = file.read(HEAD)
        if start[:2] == b"\x1f\x8b":
            with gzip.open(path) as unpacked:
                start = unpacked.read(HEAD)
    except FileNotFoundError:
        raise InputError("no such file", where=str(path), advice="check the name and the folder") from None
    except (OSError, EOFError, zlib.error, ValueError) as error:
        raise InputError(
            f"the file cannot be read: {error}",
            where=str(path),
            advice="check that you may read it, or copy it again",
        ) from error
    if not start:
        raise InputError("the file is empty", where=str(path), advice="measure or export it again")
    return start


def whole(path: Path) -> bytes:
    """All bytes of a file, unpacked where it is gzipped.

    Raises
    ------
    InputError : the packed file is damaged, or grows beyond measure.
    """
    with path.open("rb") as file:
        if file.read(2) != b"\x1f\x8b":
            file.seek(0)
            return file.read()
    return bytes(call("gzip", path)["bytes"])


def unpacked(path: Path) -> dict[str, Any]:
    """The bytes of a gzipped file, no more than such a file should hold.

    Raises
    ------
    InputError : damaged, or larger.
    """
    packed = path.stat().st_size
    most = most_unpacked(packed)
    pieces, total = [], 0
    try:
        with gzip.open(path) as file:
            while total <= most and (piece := file.read(_PIECE)):
                pieces.append(piece)
                total += len(piece)
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(
            f"the packed file is damaged: {error}", where=str(path), advice="copy or pack it again"
        ) from error
    if total > most:
        raise too_large(path, "more", packed)
    return {"bytes": np.frombuffer(b"".join(pieces), np.uint8)}


def uff(start: bytes) -> bool:
    """A line ``-1`` and then the number of a data set, in any code."""
    return re.match(rb"^\s*-1[ ]*(\r\n|\n|\r)[ ]*\d{1,6}b?(\s|$)", as_ascii(start)) is not None


def as_ascii(data: bytes) -> bytes:
    """Text that is ASCII but for its code: without the mark of UTF-8, and from UTF-16 with or without one."""
    marks = ((b"\xef\xbb\xbf", ""), (b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be"))
    mark, code = next(((mark, code) for mark, code in marks if data.startswith(mark)), (b"", ""))
    if not mark and 0 in data[:2] and data[:2] != b"\0\0":
        code = "utf-16-be" if data[0] == 0 else "utf-16-le"
    data = data[len(mark) :]
    return data.decode(code, errors="ignore").encode() if code else data


def hdf5(start: bytes) -> bool:
    """The HDF5 signature, also behind a block of the user's own; MATLAB v7.3 carries it behind a text of its own."""
    places = (0, 512, 1024, 2048)
    return start[:6] != b"MATLAB" and any(start[at : at + 8] == b"\x89HDF\r\n\x1a\n" for at in places)


def matlab(start: bytes) -> bool:
    """The text header of v5 to v7.3, or the four integers of v4."""
    return start[:6] == b"MATLAB" and len(start) >= 128


def npy(start: bytes) -> bool:
    """The NumPy signature, or a ZIP archive of such arrays."""
    return start[:6] == b"\x93NUMPY" or (start[:4] == b"PK\x03\x04" and b".npy" in start[:512])


def tdms(start: bytes) -> bool:
    """The tag of a TDMS segment."""
    return start[:4] in (b"TDSm", b"TDSh")


def mdf4(start: bytes) -> bool:
    """The identification block of MDF, of a finished file or of one that its logger left."""
    return start[:3] == b"MDF" or start[:8] == b"UnFinMF "


def wav(start: bytes) -> bool:
    """RIFF, RF64, W64 and FLAC."""
    return (start[:4] in (b"RIFF", b"RF64") and start[8:12] == b"WAVE") or start[:4] in (b"fLaC", b"riff")


def frd(start: bytes) -> bool:
    """The first records of a CalculiX result file: the case, then lines of the user."""
    return re.match(rb"\s{4}1C[^\n]*\n\s{4}1U", start) is not None


def rst(start: bytes) -> bool:
    """The standard header of a binary file of Ansys: record of 100 integers, file number 12 of results."""
    return start[:4] == (100).to_bytes(4, "little") and start[8:12] == (12).to_bytes(4, "little")


def xlsx(start: bytes) -> bool:
    """A ZIP archive that is no NumPy archive."""
    return start[:4] == b"PK\x03\x04" and b".npy" not in start[:512]


def lvm(start: bytes) -> bool:
    """The first line of a LabVIEW measurement file."""
    return start.lstrip(b"\xef\xbb\xbf").startswith(b"LabVIEW Measurement")


def signalcalc(start: bytes) -> bool:
    """The channel line of a SignalCalc export."""
    return b"Ref Chan:Resp Chan" in start[:400]


def json(start: bytes) -> bool:
    """A JSON object or array of arrays."""
    return re.match(rb'^(\xef\xbb\xbf)?\s*(\{\s*["}]|\[\s*[\[{])', start) is not None


def text(start: bytes) -> bool:
    """Tell whether a file begins as text in some one-byte code, UTF-8 or UTF-16.

    Parameters
    ----------
    start : bytes
        First bytes of the file.

    Returns
    -------
    bool
        False where they contain a control character that no text uses, unless a UTF-16 byte order mark comes first.

    Examples
    --------
    >>> text(b"time [s];force [N]"), text(bytes([0, 1, 2]))
    (True, False)
    """
    if start[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return True
    return not re.search(rb"[\x00-\x08\x0e-\x1a\x1c-\x1f]", start)
