"""How fast this machine is, so that bounds on processor time mean the same on all of them."""

import time

import numpy as np

_USUAL = 0.088
"""Processor time in s of ``_work`` on the machine that the bounds were taken on, when it had nothing else to do."""


def _work() -> float:
    """Processor time in s of a mixture of interpreted and of linear-algebra work."""
    start = time.process_time()
    rng = np.random.default_rng(0)
    table: dict[int, float] = {}
    for number in range(200_000):
        table[number % 1000] = table.get(number % 1000, 0.0) + 0.5 * number
    for _ in range(4):
        np.linalg.eigvals(rng.normal(size=(120, 120)))
    return time.process_time() - start


def slowness() -> float:
    """How many times longer than usual this machine takes at this moment (never below 1)."""
    return max(1.0, min(_work() for _ in range(3)) / _USUAL)
