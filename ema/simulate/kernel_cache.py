"""Compiled kernels on disk, kept only as long as every kernel is the one that was compiled.

Numba looks at the source file of the function it has compiled, not at those of the functions called in it, so that a
change in one file would leave old machine code in the others.
"""

from pathlib import Path


def drop_stale(*folders: Path) -> bool:
    """Remove the compiled kernels of packages that call each other, if a source has changed; says whether one had.

    A folder that cannot be written is left as it is: there numba does not keep compiled kernels either.
    """
    kept = [folder / "__pycache__" for folder in folders]
    mark = kept[0] / "kernels.stamp"
    try:
        states = [(path.name, path.stat()) for folder in folders for path in sorted(folder.glob("*_kernels.py"))]
        stamp = "\n".join(f"{name} {state.st_mtime_ns} {state.st_size}" for name, state in states)
        if mark.is_file() and mark.read_text(encoding="utf-8") == stamp:
            return False
        for folder in kept:
            for pattern in ("*.nbi", "*.nbc"):
                for path in folder.glob(pattern):
                    path.unlink(missing_ok=True)
        kept[0].mkdir(exist_ok=True)
        mark.write_text(stamp, encoding="utf-8")
    except OSError:
        return False
    return True
