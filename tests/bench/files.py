"""What was measured of files: mutated ones, faults while writing, many of everything, the speed of the store.

``--publish`` of ``python -m tests.fuzz``, ``tests.faults``, ``tests.bench.many`` and ``tests.bench.store`` adds figures to
``results/files.json``; ``python -m tests.bench.write_docs`` writes docs/files.md from it. Runs of one code are added up;
those of other code give way. The code of a figure is that of the modules which read or write its files, by their syntax.
"""

import ast
import json
import os
import time
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path
from typing import Any

from tests.bench import provenance
from tests.bench.machine import description

RESULT = Path(__file__).parent / "results" / "files.json"
_MODEL = tuple(
    f"acquisition/files/uff/{name}.py"
    for name in ("reading", "index", "records", "geometry_sets", "mode_sets", "unit_system", "header58")
)
_ISOLATED = ("acquisition/isolated", "acquisition/files/reconcile.py")
_READ = ("acquisition/registry.py", "acquisition/files/sanity.py", "tests/fuzz/cases.py", "tests/fuzz/mutations.py")
_ARRANGED = tuple(f"acquisition/files/table/{name}.py" for name in ("reading", "titles", "segment", "announced"))
_TEXT = (*_READ, *_ARRANGED, "acquisition/files/signals.py", "tests/fuzz/tables.py")
_TABLE = (*_TEXT, *(f"acquisition/files/table/{name}.py" for name in ("blocks", "damage", "numbers")))
_FRF_TEXT = (
    *_READ,
    *(f"acquisition/files/table/{name}.py" for name in ("blocks", "damage", "numbers", "segment")),
    *(f"acquisition/files/{name}.py" for name in ("ratios", "polar")),
    "tests/fuzz/frf_text.py",
)
_CONTAINER = (*_READ, *_ISOLATED, "acquisition/files/signals.py", "tests/fuzz/containers.py")
_MATRIX = ("acquisition/files/matrices.py", "acquisition/files/harwell_boeing.py", "tests/fuzz/ours.py")
_ELEMENTS = (
    *_READ,
    "acquisition/files/reconcile.py",
    "acquisition/files/finite_elements/nodal.py",
    "tests/fuzz/frd.py",
)
_STORE = ("ema/store",)
_STUDY = (*_STORE, "ema/study/study.py", "ema/study/kept.py")
RESTS: dict[str, tuple[str, ...]] = {
    "fuzz uff": (*_READ, "acquisition/files/uff", "tests/fuzz/uff.py"),
    "fuzz uff-model": (*_READ, *_MODEL, "tests/fuzz/uff_model.py"),
    "fuzz table": _TABLE,
    "fuzz lvm": (*_TEXT, "acquisition/files/lvm.py"),
    "fuzz frf-table": (*_FRF_TEXT, *_ARRANGED),
    "fuzz signalcalc": (*_FRF_TEXT, "acquisition/files/signalcalc.py"),
    "fuzz json": (*_TEXT, "acquisition/files/json_arrays.py"),
    "fuzz npy": (*_CONTAINER, "acquisition/files/npy.py"),
    "fuzz npz": (*_CONTAINER, "acquisition/files/npy.py"),
    "fuzz hdf5": (*_CONTAINER, "acquisition/files/hdf5.py", "ema/store/untrusted.py"),
    "fuzz matlab": (*_CONTAINER, "acquisition/files/matlab.py", "ema/store/untrusted.py"),
    "fuzz wav": (*_CONTAINER, "acquisition/files/wav.py"),
    "fuzz tdms": (*_CONTAINER, "acquisition/files/tdms.py", "acquisition/files/sampled.py"),
    "fuzz mdf4": (
        *_CONTAINER,
        "acquisition/files/mdf4.py",
        "acquisition/files/mdf4_blocks.py",
        "acquisition/files/sampled.py",
    ),
    "fuzz xlsx": (*_CONTAINER, "acquisition/files/xlsx.py", *_ARRANGED),
    "fuzz frd": (
        *_ELEMENTS,
        "acquisition/files/finite_elements/frd.py",
        "acquisition/files/finite_elements/elements.py",
    ),
    "fuzz rst": (
        *_ELEMENTS,
        *_ISOLATED,
        "acquisition/files/finite_elements/rst.py",
        "acquisition/files/finite_elements/rst_parser.py",
        "tests/fuzz/rst.py",
    ),
    "fuzz market": (*_MATRIX, *_ISOLATED),
    "fuzz boeing": _MATRIX,
    "fuzz store": (*_STORE, "tests/fuzz/ours.py"),
    "fuzz toml": ("acquisition/campaign_file.py", "ema/tables", "tests/fuzz/ours.py"),
    "faults save": _STORE,
    "faults record": (*_STORE, "acquisition/live", "acquisition/session.py", "acquisition/recording.py"),
    "faults run": _STUDY,
    "faults map": (*_STUDY, "ema/cli/mapping.py"),
    "faults place": (*_STORE, "ema/place/shortlist.py", "ema/cli/placing.py"),
    "many files": ("acquisition/files/uff", "acquisition/registry.py", "tests/bench/many.py"),
    "many folders": (
        "acquisition/folder.py",
        "acquisition/file_cache.py",
        "acquisition/files/uff",
        "acquisition/files/table",
        "acquisition/files/wav.py",
        "acquisition/isolated",
        "ema/store",
        "tests/bench/many.py",
    ),
    "many connections": ("ema/app/connections.py", "tests/bench/many.py"),
    "store": ("ema/store", "tests/bench/store.py"),
}
"""Files and folders whose code a figure describes; what they import counts where it is named here."""
LISTS = {"acquisition/registry.py": "_FORMATS", "acquisition/isolated/worker.py": "TASKS"}
"""Lists of all readers, by the file that holds them: one that joins or leaves changes nothing of what others do."""


@dataclass
class Spent:
    """Seconds of a block by the clock and of the processor."""

    clock: float = 0.0
    cpu: float = 0.0

    def __enter__(self) -> "Spent":
        self._begin = time.monotonic(), sum(os.times()[:4])
        return self

    def __exit__(self, *error: object) -> None:
        self.clock, self.cpu = time.monotonic() - self._begin[0], sum(os.times()[:4]) - self._begin[1]


def code(name: str) -> str:
    """Fingerprint of the code that a figure describes.

    Raises
    ------
    FileNotFoundError : a file of :data:`RESTS` is gone.
    """
    digest = sha256()
    for part in RESTS[name]:
        path = provenance.ROOT / part
        if not path.exists():
            raise FileNotFoundError(path)
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            place = file.relative_to(provenance.ROOT).as_posix()
            text = provenance.code(_without(file.read_text(encoding="utf-8"), LISTS.get(place)))
            digest.update(f"{place} {text}\n".encode())
    return digest.hexdigest()[:16]


def _without(source: str, name: str | None) -> str:
    """The source of a module without what it assigns to a name.

    Raises
    ------
    ValueError : it assigns nothing to it.
    """
    if name is None:
        return source
    tree = ast.parse(source)
    kept = [one for one in tree.body if not (isinstance(one, ast.Assign) and ast.unparse(one.targets[0]) == name)]
    if len(kept) == len(tree.body):
        raise ValueError(name)
    tree.body = kept
    return ast.unparse(tree)


def stored() -> dict[str, Any]:
    """All figures by name: date, machine, commit, code, and ``runs`` by what distinguishes them."""
    return json.loads(RESULT.read_text(encoding="utf-8")) if RESULT.exists() else {}


def publish(name: str, run: str, figures: Any) -> None:
    """Store the figures of a run beside those of other runs of the same code."""
    whole, now = stored(), code(name)
    former = whole.get(name, {})
    runs = former["runs"] if former.get("code") == now else {}
    whole[name] = {
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "machine": description(),
        "commit": provenance.commit(),
        "code": now,
        "runs": {**runs, run: figures},
    }
    RESULT.write_text(json.dumps(whole, indent=1, sort_keys=True) + "\n", encoding="utf-8")


def outdated() -> list[str]:
    """Names of figures whose code has changed since."""
    return [name for name, there in stored().items() if name not in RESTS or there["code"] != code(name)]


HEAD = """# Files: what was measured

How readers, store, sessions and the browser's server behave under damage, faults and load; what it means stands in
[formats.md](formats.md), [record.md](record.md) and [browser.md](browser.md). Every figure is that of a command, which
stands beside it; `--publish` stores it and `python -m tests.bench.write_docs` writes this page. Processor times are those
of this process and of the process of the parsers; the clock beside them includes other work of the machine."""

FUZZ = """## Mutated files

`python -m tests.fuzz --reader uff --n 100000 --seed 5 --publish`. *Right*: read as it was written or, with noise in its
bytes, as another parser reads it. *Named*: refused, or every channel that is not exact has a finding. *Not to be seen*:
wrong, and the format has no means to show it. *Wrong*: wrong in silence, a crash, more than 5 s of processor time or 1 GB
of memory."""

FAULTS = """## Faults while writing

`python -m tests.faults record --moments 1000 --signal KILL --publish`, `--operations` and `--users 200`. *Wrong*:
something finished is lost or computed again, the next start does not come to its end, something is left behind, or a
refusal is not one sentence. Where fewer operations were disturbed than there are, they stand for the others: of a row of
writes to one file the first, the middle and the last."""


def _rows(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    lines = [list(head), ["---"] * len(list(head)), *map(list, rows)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _count(number: int) -> str:
    return f"{number:,}".replace(",", " ")


def _fuzz(there: dict[str, Any]) -> str:
    rows, blind = [], []
    for name in (name for name in RESTS if name in there and name.startswith("fuzz ")):
        runs = there[name]["runs"]
        total: Counter[str] = Counter()
        for run in runs.values():
            total.update(run["outcomes"])
        unseen = {what[7:]: count for what, count in total.items() if what.startswith("blind: ")}
        reader = name.removeprefix("fuzz ")
        right, named = total["fine"] + total["independent"], total["named"] + total["refused"]
        numbers = (total.total(), right, named, sum(unseen.values()), total["wrong"])
        rows.append([f"`{reader}`", *map(_count, numbers), ", ".join(runs)])
        if unseen:
            blind.append(f"- `{reader}`: " + ", ".join(f"{what} {_count(n)}" for what, n in sorted(unseen.items())))
    whole = _rows(("reader", "files", "right", "named", "not to be seen", "wrong", "seeds"), rows)
    return "\n\n".join([FUZZ, whole, "What cannot be seen, by class:\n\n" + "\n".join(blind)])


def _faults(there: dict[str, Any]) -> str:
    rows = []
    for name in (name for name in RESTS if name in there and name.startswith("faults ")):
        kinds: dict[str, list[dict[str, Any]]] = {}
        for run in there[name]["runs"].values():
            kinds.setdefault(run["what"], []).append(run)
        for what, runs in sorted(kinds.items()):
            counts = [_count(sum(run[key] for run in runs)) for key in ("count", "wrong")]
            seeds = ", ".join(str(run["seed"]) for run in runs if run["seed"] is not None)
            rows.append([f"`{name.removeprefix('faults ')}`", what, *counts, seeds])
    return "\n\n".join([FAULTS, _rows(("work", "disturbed by", "disturbances", "wrong", "seeds"), rows)])


def _many(there: dict[str, Any]) -> str:
    rows = [
        [what, f"{run['cpu']:.1f}", f"{run['clock']:.1f}"]
        for name in ("many files", "many folders")
        for what, run in there.get(name, {"runs": {}})["runs"].items()
    ]
    parts = ["## Many\n\n`python -m tests.bench.many --publish`, seconds of one reading:"]
    parts.append(_rows(("what", "processor time [s]", "clock [s]"), rows))
    for run in there.get("many connections", {"runs": {}})["runs"].values():
        parts.append(
            f"Of {run['idle']} idle and {run['active']} active connections to the browser's server all "
            f"{run['answered']} active ones were answered, the last after {run['slowest']:.2f} s by the clock, with "
            f"{run['threads']} more threads and {run['grown']:.0f} MB more memory."
        )
    return "\n\n".join(parts)


def _store(there: dict[str, Any]) -> str:
    rows = [
        [what, f"{run['save']:.0f}", f"{run['load']:.0f}"]
        for what, run in there.get("store", {"runs": {}})["runs"].items()
    ]
    text = """## Speed of the store

`python -m tests.bench.store --publish`, megabytes of array per second of processor time, the best of five; recording of
128 MB, FRFs of 102 MB. The store compares a sum of every array; h5py writes and reads the same chunks without sums, and
with sums of its own."""
    return "\n\n".join([text, _rows(("what", "save", "load"), rows)])


def page() -> str:
    """The page of docs/files.md."""
    there, old = stored(), outdated()
    parts = [HEAD]
    if old:
        parts.append(
            "**Older than the code:** what these figures describe has changed since: "
            f"{', '.join(f'`{name}`' for name in sorted(old))}. They are replaced when their command runs again."
        )
    parts += [_fuzz(there), _faults(there), _many(there), _store(there)]
    stamps = sorted({(one["date"], one["machine"]["processor"], one["machine"]["cores"]) for one in there.values()})
    parts.append(
        "Measured " + "; ".join(f"{date} on {processor} ({cores} cores)" for date, processor, cores in stamps) + "."
    )
    return "\n\n".join(parts) + "\n"
