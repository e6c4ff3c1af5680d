"""The blind table: predicted from blows on the bare table first, then answered by another program.

``python -m tests.bench.blind_table`` makes everything anew in a temporary folder with a seed of today and prints the score;
``--stored`` renews the files of ``tests/validation/blind_table``; ``--part hammer|predict|truth`` does one step. The
joints of the truth are drawn by the fingerprint of the stored prediction, so none of it can be known before.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import hashlib
import json
import random
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from tests.bench.environments import interpreter
from tests.validation.blind_table import prediction as predictor
from tests.validation.blind_table import score as scoring

HERE = predictor.HERE
FULL_SCALE = 32000
COMPETITORS = 4


def by_opensees(task: str, question: dict[str, Any]) -> dict[str, Any]:
    """An answer of the program that knows nothing of this project."""
    with tempfile.TemporaryDirectory() as folder:
        asked, told = Path(folder, "asked.json"), Path(folder, "told.json")
        asked.write_text(json.dumps(question), encoding="utf-8")
        subprocess.run([interpreter("opensees"), "-P", HERE / "truth.py", task, asked, told], check=True)
        return dict(json.loads(told.read_text(encoding="utf-8")))


def hammer(folder: Path, seed: int | None) -> None:
    """Blows on the bare table as 16 bit counts."""
    question = predictor.question() | ({} if seed is None else {"seed": seed})
    told = by_opensees("hammer", question)
    signals = np.array(told["records"])
    scale = np.abs(signals).max(axis=(0, 2)) / FULL_SCALE
    counts = np.round(signals / scale[:, None]).astype(np.int16)
    np.savez_compressed(folder / "bare.npz", counts=counts, scale=scale, sampling_rate=told["sampling_rate"])


def predict(folder: Path) -> None:
    """The prediction, with the fingerprint of the signals it comes from."""
    with tempfile.TemporaryDirectory() as measured:
        answer, told = predictor.prediction(Path(measured), folder / "bare.npz")
    mapping = {"signals": fingerprint(folder / "bare.npz"), **predictor.as_mapping(answer, told)}
    (folder / "prediction.json").write_text(json.dumps(mapping, indent=1) + "\n", encoding="utf-8")


def truth(folder: Path) -> None:
    """The placed beam at all conditions, and the competing places at the normal force that suits each."""
    stored = json.loads((folder / "prediction.json").read_text(encoding="utf-8"))
    question, mark = predictor.question(), fingerprint(folder / "prediction.json")
    started = time.process_time()
    best, *others = rivals(stored["places"], int(mark[:8], 16))
    asked = [dict(best, normal_forces=stored["normal_forces"])]
    asked += [dict(one, normal_forces=[one["normal_force"]]) for one in others]
    question |= {
        "prediction": mark,
        "guess": float(np.mean(stored["frequency"])),
        "asked": [one | {"levels": stored["force_levels"]} for one in asked],
    }
    told = by_opensees("swept", question)
    used = os.times()
    told |= {"prediction": mark, "cpu [s]": round(used.children_user + time.process_time() - started)}
    (folder / "truth.json").write_text(json.dumps(_rounded(told), indent=None) + "\n", encoding="utf-8")


def rivals(places: list[dict[str, Any]], seed: int) -> list[dict[str, Any]]:
    """The predicted place, two of the next that are no mirror image of one before, and two drawn from all others."""
    chosen, seen = [], set()
    for one in places:
        if _image(one["column"], one["row"]) not in seen and len(chosen) < COMPETITORS - 1:
            seen.add(_image(one["column"], one["row"]))
            chosen.append({key: one[key] for key in ("column", "row", "normal_force")})
    rest = [(c, r) for c in range(1, 8) for r in range(1, 6)]
    random.Random(seed).shuffle(rest)
    for column, row in rest:
        if _image(column, row) not in seen and len(chosen) <= COMPETITORS:
            seen.add(_image(column, row))
            chosen.append({"column": column, "row": row, "normal_force": places[0]["normal_force"]})
    return chosen


def _image(column: int, row: int) -> tuple[int, int]:
    """The same place of a table that looks the same from all four corners."""
    return min(column, 8 - column), min(row, 6 - row)


def fingerprint(path: Path) -> str:
    """SHA-256."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_rounded(one) for one in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value


def main() -> None:
    """Signals, prediction, truth, score."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--stored", action="store_true")
    options.add_argument("--part", choices=["hammer", "predict", "truth", "score"])
    options.add_argument("--seed", type=int)
    chosen = options.parse_args()
    with tempfile.TemporaryDirectory() as fresh:
        folder = HERE if chosen.stored else Path(fresh)
        seed = chosen.seed if chosen.seed is not None or chosen.stored else int(time.time())
        if not chosen.stored and chosen.part not in (None, "hammer"):
            shutil.copytree(HERE, folder, dirs_exist_ok=True)
        steps = {
            "hammer": lambda: hammer(folder, seed),
            "predict": lambda: predict(folder),
            "truth": lambda: truth(folder),
        }
        for name, step in steps.items():
            if chosen.part in (None, name):
                step()
        if chosen.part in (None, "truth", "score"):
            print(scoring.score(folder).text())


if __name__ == "__main__":
    main()
