"""What a law of a user's own costs beside the built-in law of the same form: ``python -m tests.bench.own_laws``.

CPU seconds of one thread, the least of three runs, compiled before. Steady states at 7 frequencies, and a release of
0.2 s, of the double beam of ``docs/laws.md``; then registering in processes of their own, with nothing kept compiled
and with what the first one kept.
"""

import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ema.data import BeamModel, FrictionLaw
from ema.simulate import Dahl, Masing, Section, double_beam, frf, register_law, snapback

TIP = "beam 2:4:+Z"
_REGISTER = """
import time
from ema.simulate import Masing, loop, register_law
def law(force, du, k, limit, p0, p1, p2, p3):
    return min(max(force + k * du, -limit), limit)
if __name__ == "__main__":
    loop(Masing(0.3, 1e6), 100.0, 1e-3)
    start = time.process_time()
    register_law("clip", law)
    print(time.process_time() - start)
"""


def _clip(force, du, k, limit, p0, p1, p2, p3):  # type: ignore[no-untyped-def]
    return min(max(force + k * du, -limit), limit)


def _closed_form(force, du, k, limit, p0, p1, p2, p3):  # type: ignore[no-untyped-def]
    if limit <= 0.0:
        return 0.0
    sign = 1.0 if du >= 0.0 else -1.0
    return force - sign * (limit - sign * force) * math.expm1(-k * abs(du) / limit)


def _with_floor(force, du, k, limit, p0, p1, p2, p3):  # type: ignore[no-untyped-def]
    if limit <= 0.0:
        return 0.0
    way = force / limit if du > 0.0 else -force / limit
    return min(max(force + k * max(1.0 - way, p0) * du, -limit), limit)


LAWS: dict[str, FrictionLaw] = {
    "Masing": Masing(0.3, 1e9),
    "clip of one's own": register_law("bench clip", _clip)(0.3, 1e9),
    "Dahl": Dahl(0.3, 1e9),
    "Dahl of one's own, closed form": register_law("bench closed form", _closed_form)(0.3, 1e9),
    "Dahl with a floor, in steps": register_law("bench floor", _with_floor)(0.3, 1e9, 0.05),
}


def least(run: Callable[[], object]) -> float:
    """Least CPU time in s of three runs, after one that compiles."""
    run()
    times = []
    for _ in range(3):
        start = time.process_time()
        run()
        times.append(time.process_time() - start)
    return min(times)


def registered() -> tuple[float, float]:
    """CPU s of registering a law of a file, in a first and in a second process."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "law_of_mine.py")
        path.write_text(_REGISTER, encoding="utf-8")
        first, second = (
            float(subprocess.run([sys.executable, path], capture_output=True, text=True, check=True).stdout)
            for _ in range(2)
        )
    return first, second


def main() -> None:
    """Measure and print."""
    for name, law in LAWS.items():
        model: BeamModel = double_beam(law, 1000.0, Section(0.5, 0.04, 0.005, elements=4))
        lines = np.linspace(10, 40, 7)
        steady = least(lambda model=model, lines=lines: frf(model, lines, 1.0, TIP, [TIP]))  # type: ignore[misc]
        free = least(lambda model=model: snapback(model, 20.0, TIP, 0.2))  # type: ignore[misc]
        print(f"{name:32} {1e3 * steady / len(lines):6.0f} ms a steady state, {free:5.2f} s a release", flush=True)
    first, second = registered()
    print(f"registering a law of a file: {first:.3f} s, then {second:.3f} s")


if __name__ == "__main__":
    main()
