"""The archive on disk: one immutable part file for each state of a campaign, named by its content.

Below the folder of an archive there is ``parts/`` and nothing else. A part is written to the side, renamed, and never
changed again; when a campaign changes, a new part names those that it supersedes. So any number of programs may add and
read at once, on disks without locks too, and two archives are merged by having the parts of both. What a part holds is
JSON, packed by gzip; its name is the SHA-256 of the JSON.
"""

import gzip
import hashlib
import json
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ema import store
from ema.errors import FailureError, InputError

FORMAT = "friction-ema archive"
SCHEMA_VERSION = 1
"""Raised when a change makes earlier programs misread a part; parts of every version are read forever."""
MIGRATIONS: Mapping[int, Callable[[dict[str, Any]], dict[str, Any]]] = {}
"""What makes a part of one version one of the next, by the version that it has before."""
FOLDER = "parts"
SUFFIX = ".json.gz"
_LEVEL = 6
"""Of gzip: its own default. With 1 the parts of the bench are a fifth larger, with 9 they take twice as long."""


@dataclass(frozen=True)
class Part:
    """One state of a campaign.

    Parameters
    ----------
    name : str
        SHA-256 of the JSON, which names the file.
    record : dict
        What is indexed; see :func:`ema.archive.record.record_of`.
    digest : str
        SHA-256 of ``record``: equal for equal content, wherever the campaign lies.
    seen : dict
        Where the campaign was, with sizes and times of its files.
    supersedes : tuple of str
        Names of the parts of the same campaign in earlier states.
    """

    name: str
    record: dict[str, Any]
    digest: str
    seen: dict[str, Any]
    supersedes: tuple[str, ...] = ()


def names(archive: Path) -> set[str]:
    """Return the names of the parts of an archive.

    Parameters
    ----------
    archive : Path
        Its folder; one whose parts are all gone has no names, one without ``parts/`` is no archive.

    Returns
    -------
    set of str
        SHA-256 of the content of every part.

    Raises
    ------
    InputError
        The folder is no archive, or cannot be read.
    """
    folder = archive / FOLDER
    try:
        return {path.name.removesuffix(SUFFIX) for path in folder.iterdir() if _is_part(path.name)}
    except FileNotFoundError:
        pass
    except OSError as error:
        raise InputError(
            "the archive cannot be read",
            where=str(archive),
            got=error.strerror,
            advice="name the folder of the archive, and check that you may read it",
        ) from error
    raise InputError(
        "there is no archive here",
        where=str(archive),
        expected=f"a folder with `{FOLDER}`",
        advice=f"make one with `ema archive add {archive} CAMPAIGN`",
    )


def _is_part(name: str) -> bool:
    return name.endswith(SUFFIX) and not name.startswith(".")


def canonical(content: Any) -> bytes:
    """JSON of which there is one for every content."""
    return json.dumps(content, sort_keys=True, ensure_ascii=False, separators=(",", ":"), allow_nan=False).encode()


def digest_of(content: Any) -> str:
    """SHA-256 of the canonical JSON."""
    return hashlib.sha256(canonical(content)).hexdigest()


def write(archive: Path, record: dict[str, Any], seen: dict[str, Any], supersedes: tuple[str, ...] = ()) -> Part:
    """Write a part, whole or not at all; one that is there already stays as it is.

    Parameters
    ----------
    archive : folder of the archive; it is made where there is none.
    record : what is known of a campaign, as JSON can hold it.
    seen : where and when it was found; not part of the digest by which campaigns are compared.
    supersedes : names of the parts that this one replaces.

    Returns
    -------
    The part, with the name it got: the SHA-256 of its content.

    Raises
    ------
    FailureError : the folder cannot be written.
    """
    digest = digest_of(record)
    whole = {
        "format": FORMAT,
        "schema": SCHEMA_VERSION,
        "campaign": record,
        "seen": seen,
        "supersedes": sorted(supersedes),
    }
    text = canonical(whole)
    name = hashlib.sha256(text).hexdigest()
    _put(archive, name, gzip.compress(text, _LEVEL, mtime=0))
    return Part(name, record, digest, seen, tuple(sorted(supersedes)))


def make(archive: Path) -> Path:
    """Make the folder of the parts of an archive, where it is not there yet.

    Raises
    ------
    FailureError : it cannot be made.
    """
    folder = archive / FOLDER
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FailureError(
            "the archive cannot be made",
            where=str(archive),
            got=error.strerror,
            advice="choose a folder that can be written and has space",
        ) from error
    return folder


def _put(archive: Path, name: str, packed: bytes) -> None:
    folder = make(archive)
    path = folder / f"{name}{SUFFIX}"
    if path.is_file():
        return
    # never replaced, not even by its equal: a listing may miss a name that is being replaced
    try:
        with store.replacing(path, exclusive=True) as temporary:
            temporary.write_bytes(packed)
    except FailureError:
        if not path.is_file():  # written by another process meanwhile
            raise


def copy(source: Path, archive: Path, name: str) -> None:
    """Copy a part of another archive, as it is.

    Raises
    ------
    InputError : it is damaged.
    FailureError : the folder cannot be written.
    """
    read(source, name)
    _put(archive, name, (source / FOLDER / f"{name}{SUFFIX}").read_bytes())


def read(archive: Path, name: str) -> Part:
    """Read a part; parts of earlier versions as if they had been written today.

    Parameters
    ----------
    archive : Path
        Folder of the archive.
    name : str
        SHA-256 of the content, as :func:`names` gives it; the content is checked against it.

    Returns
    -------
    Part
        One state of a campaign, and the names of the earlier states that it replaces.

    Raises
    ------
    InputError
        It is damaged, or a newer version wrote it.
    """
    path = archive / FOLDER / f"{name}{SUFFIX}"
    try:
        text = gzip.decompress(path.read_bytes())
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(
            "a part of the archive cannot be read",
            where=str(path),
            got=str(error) or "its end",
            expected="a gzip file that is whole and may be read",
        ) from error
    if hashlib.sha256(text).hexdigest() != name:
        raise InputError(
            "a part of the archive is damaged",
            where=str(path),
            got="another content than its name says",
            expected="content whose SHA-256 is the name of the file",
        )
    whole = json.loads(text)
    if not isinstance(whole, dict) or whole.get("format") != FORMAT or not isinstance(whole.get("schema"), int):
        raise InputError(
            "not a part of an archive",
            where=str(path),
            expected=f'JSON with the format "{FORMAT}" and a schema version',
        )
    if whole["schema"] > SCHEMA_VERSION:
        raise InputError(
            "a part of the archive was written by a newer friction-ema",
            where=str(path),
            got=f"schema version {whole['schema']}",
            expected=f"at most {SCHEMA_VERSION}",
            advice="update with: pip install -U friction-ema",
        )
    for version in range(whole["schema"], SCHEMA_VERSION):
        whole = MIGRATIONS[version](whole)
    record = whole["campaign"]
    return Part(name, record, digest_of(record), whole["seen"], tuple(whole["supersedes"]))
