"""Universal files against pyuff: 160 sets of 6401 complex lines, text and binary, and the list of a file of 1 GB.

Run as ``python -m tests.bench.uff`` (``--quick`` leaves the large file out); writes ``tests/bench/results/uff.json``.
One BLAS thread, all figures from one run on warm files, processor times, best of a few repeats.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import shutil
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

import acquisition
from acquisition.files import uff
from ema.data import FrfSet
from ema.dof import Dof
from tests.bench import machine, provenance

RESULT = Path(__file__).parent / "results" / "uff.json"
LINES = 6401
LARGE = 1_000_000_000


def frfs(lines: int = LINES, inputs: int = 80) -> FrfSet:
    """Two responses over 80 forces."""
    random = np.random.default_rng(0)
    values = random.normal(size=(lines, 2, inputs)) + 1j * random.normal(size=(lines, 2, inputs))
    forces = tuple(Dof(number + 1, "+Z") for number in range(inputs))
    return FrfSet(0.25 * np.arange(lines), values, (Dof(1, "+X"), Dof(2, "+Y")), forces, "accelerance", "(m/s^2)/N")


def best(action: Callable[[], Any], repeats: int = 4) -> float:
    """Shortest processor time in s."""
    times = []
    for _ in range(repeats):
        start = process_time()
        action()
        times.append(process_time() - start)
    return min(times)


def _pyuff_write(pyuff: Any, path: Path, source: FrfSet, binary: bool) -> None:
    path.unlink(missing_ok=True)
    file = pyuff.UFF(str(path))
    sets = [
        {
            "type": 58,
            "binary": int(binary),
            "func_type": 4,
            "rsp_node": output.node,
            "rsp_dir": output.uff_direction,
            "ref_node": input_.node,
            "ref_dir": input_.uff_direction,
            "x": source.frequencies,
            "abscissa_spacing": 1,
            "data": source.values[:, row, column],
            "abscissa_spec_data_type": 18,
            "ordinate_spec_data_type": 12,
            "orddenom_spec_data_type": 13,
        }
        for column, input_ in enumerate(source.inputs)
        for row, output in enumerate(source.outputs)
    ]
    file.write_sets(sets, "add")


def compare(folder: Path, binary: bool) -> dict[str, float]:
    """Rates in MB/s of reading and writing one file, ours and theirs, and their ratios."""
    with warnings.catch_warnings():
        import pyuff
    source = frfs()
    path = folder / f"ours-{binary}.uff"
    ours_write = best(lambda: acquisition.write(path, source, binary=binary), 3)
    theirs_write = best(lambda: _pyuff_write(pyuff, folder / "theirs.uff", source, binary), 1)
    size = path.stat().st_size / 1e6
    ours_sets = best(lambda: uff.functions(path))
    ours_nouns = best(lambda: acquisition.read(path))
    theirs = best(lambda: pyuff.UFF(str(path)).read_sets())
    listing = best(lambda: uff.list_sets(path))
    read = acquisition.read(path).frfs[0]
    np.testing.assert_allclose(read.values, source.values, rtol=1e-12)
    for mine, other in zip(uff.functions(path)[-3:], pyuff.UFF(str(path)).read_sets()[-3:], strict=True):
        np.testing.assert_array_equal(mine.y, other["data"])
    return {
        "size [MB]": size,
        "read sets [MB/s]": size / ours_sets,
        "read to an FRF set [MB/s]": size / ours_nouns,
        "pyuff read [MB/s]": size / theirs,
        "read sets: pyuff time / ours": theirs / ours_sets,
        "read to an FRF set: pyuff time / ours": theirs / ours_nouns,
        "write [MB/s]": size / ours_write,
        "pyuff write [MB/s]": (folder / "theirs.uff").stat().st_size / 1e6 / theirs_write,
        "write: pyuff time / ours": theirs_write / ours_write,
        "list [ms]": 1e3 * listing,
        "list: time to read the sets / time to list": ours_sets / listing,
    }


def large(folder: Path, binary: bool, lines: int) -> dict[str, float]:
    """Time to list a file of 1 GB against the times to read its sets, and to read it to one FRF set."""
    path = folder / "large.uff"
    per_function = lines * (16 if binary else 40.5)
    few = frfs(lines, 5)
    inputs = tuple(Dof(number + 1, "+Z") for number in range(int(LARGE / per_function / 2)))
    values = np.tile(few.values, (1, 1, len(inputs) // 5 + 1))[:, :, : len(inputs)]
    acquisition.write(path, replace(few, values=values, inputs=inputs), binary=binary)
    del values
    listing = best(lambda: uff.list_sets(path), 3)
    reading = best(lambda: uff.functions(path), 1)
    to_nouns = best(lambda: acquisition.read(path), 1)
    result = {
        "size [MB]": path.stat().st_size / 1e6,
        "sets": 2.0 * len(inputs),
        "lines per set": float(lines),
        "list [ms]": 1e3 * listing,
        "read sets [s]": reading,
        "read to an FRF set [s]": to_nouns,
        "time to read sets / time to list": reading / listing,
        "time to read to an FRF set / time to list": to_nouns / listing,
    }
    path.unlink()
    return result


def main() -> None:
    """Measure and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="leave the file of 1 GB out")
    quick = parser.parse_args().quick
    folder = Path(tempfile.mkdtemp())
    try:
        result: dict[str, Any] = provenance.stamp("tests.bench.uff")
        result["machine"]["pyuff"] = machine._version("pyuff")
        for binary, name in ((True, "58b"), (False, "58")):
            result[name] = compare(folder, binary)
        if not quick:
            result["1 GB of 58b"] = large(folder, True, LINES)
            result["1 GB of 58b, long sets"] = large(folder, True, 102401)
            result["1 GB of 58"] = large(folder, False, LINES)
        RESULT.parent.mkdir(exist_ok=True)
        RESULT.write_text(json.dumps(result, indent=2) + "\n")
    finally:
        shutil.rmtree(folder)
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
