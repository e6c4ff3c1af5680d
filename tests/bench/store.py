"""Speed of the store per second of processor time, with plain h5py of the same layout beside it.

``python -m tests.bench.store`` prints megabytes of array per second of processor time: the best of five. The checksums of
the store are included; h5py writes and reads the same chunks without sums, and once with its own Fletcher sums.
"""

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

from ema import store
from ema.data import Channel, FrfSet, Recording
from ema.dof import Dof
from tests.bench import files

REPEATS = 5
CHUNK = (1, 65536)


def rate(action: Callable[[], object], size: int) -> float:
    """Megabytes per second of processor time: the best of the repeats."""
    spent = []
    for _ in range(REPEATS):
        start = time.process_time()
        action()
        spent.append(time.process_time() - start)
    return size / 1e6 / min(spent)


def say(what: str, save: float, load: float, publish: bool) -> None:
    """Print the speeds, and store them where they are to be published."""
    print(f"{what:25} save {save:6.0f}  load {load:6.0f} MB per CPU s")
    if publish:
        files.publish("store", what, {"save": save, "load": load})


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.store", description=__doc__)
    parser.add_argument("--publish", action="store_true", help="store the figures for docs/files.md")
    publish = parser.parse_args().publish
    rng = np.random.default_rng(0)
    record = Recording(rng.standard_normal((8, 2_000_000)), 51200.0, tuple(Channel(str(k)) for k in range(8)))
    values = rng.standard_normal((4000, 20, 80)) + 1j
    dofs = [tuple(Dof(node, "+Z") for node in range(1, count + 1)) for count in (20, 80)]
    frfs = FrfSet(np.arange(4000.0), values, dofs[0], dofs[1], "accelerance", "(m/s^2)/N")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.h5"
        for name, noun, array in (("recording", record, record.signals), ("FRF set", frfs, frfs.values)):
            saved = rate(lambda noun=noun: store.save(path, noun), array.nbytes)  # type: ignore[misc]
            loaded = rate(lambda: store.load(path), array.nbytes)
            say(f"{name}, store", saved, loaded, publish)
            for title, options in (("h5py", {}), ("h5py with sums", {"fletcher32": True})):
                chunks = CHUNK if name == "recording" else (True if options else None)

                def write(array: np.ndarray = array, chunks: object = chunks, options: dict = options) -> None:  # type: ignore[type-arg]
                    with h5py.File(path, "w", libver="v110") as file:
                        file.create_dataset("a", data=array, chunks=chunks, **options)

                def read() -> None:
                    with h5py.File(path, "r") as file:
                        file["a"][()]

                say(f"{name}, {title}", rate(write, array.nbytes), rate(read, array.nbytes), publish)


if __name__ == "__main__":
    main()
