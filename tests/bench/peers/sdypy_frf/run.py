"""sdypy-FRF: H1 and coherence of every point, and its verdict on clean impacts; one JSON line on stdout."""

import json
import sys
import time
from importlib.metadata import version

import numpy as np
from pyFRF import FRF

signals, rate, repeats = np.load(sys.argv[1]), int(float(sys.argv[2])), int(sys.argv[3])
wall, cpu = [], []
for _ in range(repeats):
    start = time.perf_counter(), time.process_time()
    for point in signals:
        model = FRF(
            rate,
            exc=point[:, 0],
            resp=point[:, 1:],
            exc_type="f",
            resp_type="a",
            window="none",
            frf_estimator="H1",
            copy=False,
        )
        frfs, coherence = model.get_FRF(frf_form="accelerance"), model.get_coherence()
    wall.append(time.perf_counter() - start[0])
    cpu.append(time.process_time() - start[1])
flagged = np.mean([model._is_double_impact(point[:, 0]) for point in signals])
print(
    json.dumps({"version": version("sdypy-FRF"), "wall": min(wall), "cpu": min(cpu), "clean impacts flagged": flagged})
)
