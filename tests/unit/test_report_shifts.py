"""The shifts of frequency that the answer of a placement states, read back from its sentence."""

import re
from dataclasses import replace

import numpy as np
import pytest

from ema.report.placement import answer
from tests.unit.friction_nouns import placement

NUMBER = r"([+-]?\d+\.\d)"


@pytest.mark.parametrize("seed", range(20))
def test_the_printed_shifts_add_up_to_the_printed_frequency(seed):
    rng = np.random.default_rng([20261122, seed])
    whole = placement()
    bare, shift = rng.uniform(50, 2000), rng.uniform(-30, 30)
    best = replace(
        whole.ranking.best, frequency=np.full((1, 2), bare + shift), mass_shift=rng.uniform(-40, 0, 1),
        stiffness_shift=rng.uniform(0, 40, 1),
    )  # fmt: skip
    prediction = replace(whole.ranking.prediction, bare_frequencies=np.array([bare]))
    sentence = answer(replace(whole, ranking=replace(whole.ranking, prediction=prediction, places=(best,))))
    found = re.search(rf"{NUMBER} -> {NUMBER} Hz \((.*?)\)", sentence)
    assert found is not None
    before, after = float(found[1]), float(found[2])
    parts = [float(part) for part in re.findall(rf"{NUMBER} Hz", found[3])]
    assert before == pytest.approx(bare, abs=0.051) and after == pytest.approx(bare + shift, abs=0.051)
    assert parts[:2] == pytest.approx([best.mass_shift[0], best.stiffness_shift[0]], abs=0.051)
    assert before + sum(parts) == pytest.approx(after, abs=1e-6)
