"""Fingerprints of what a result rests on: files, and the code that computed it."""

import hashlib
import platform
from collections.abc import Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_PACKAGES = ("numpy", "scipy", "h5py", "numba", "pandas", "pint")
"""Packages whose results are in ours."""

_SHOWN = ("cli", "app", "report", "show")
"""Parts of ``ema`` that show results and never make them: a kept result stays when they change."""


def of_files(paths: Sequence[Path]) -> str:
    """SHA-256 of one file; of several files that of the list ``<sha256>  <name>``, one per line."""
    digests = []
    for path in paths:
        with path.open("rb") as file:
            digests.append(hashlib.file_digest(file, "sha256").hexdigest())
    if len(paths) == 1:
        return digests[0]
    lines = "".join(f"{digest}  {path.name}\n" for digest, path in zip(digests, paths, strict=True))
    return hashlib.sha256(lines.encode()).hexdigest()


def of_sources(root: Path) -> str:
    """SHA-256 of the names and texts of all modules below ``root`` that compute."""
    whole = hashlib.sha256()
    for package in ("acquisition", "ema"):
        for path in sorted((root / package).rglob("*.py")):
            name = path.relative_to(root)
            if name.parts[:1] == ("ema",) and name.parts[1] in _SHOWN:
                continue
            whole.update(f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {name.as_posix()}\n".encode())
    return whole.hexdigest()


def compiled_modules(package: Path) -> list[Path]:
    """Modules below the folder of a package that hold compiled code, and the one that says how it is compiled."""
    return sorted([*package.rglob("*_kernels.py"), *package.glob("compiled.py")])


def of_compiled(package: Path) -> str:
    """SHA-256 of the names and texts of the ``compiled_modules`` of a package: they call each other."""
    whole = hashlib.sha256()
    for path in compiled_modules(package):
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        whole.update(f"{digest}  {path.relative_to(package).as_posix()}\n".encode())
    return whole.hexdigest()


@cache
def of_code() -> str:
    """``of_sources`` of this installation, as it was when first asked for."""
    return of_sources(Path(__file__).resolve().parents[1])


def versions() -> tuple[tuple[str, str], ...]:
    """``(what, version)`` of all that computes: this project with the fingerprint of its code, Python, packages."""
    from ema import __version__

    entries = [("friction-ema", __version__), (CODE, of_code()), ("Python", platform.python_version())]
    for package in _PACKAGES:
        try:
            entries.append((package, version(package)))
        except PackageNotFoundError:
            entries.append((package, "absent"))
    return tuple(entries)


CODE = "code of friction-ema"
"""Name of the fingerprint of our code among the versions."""
