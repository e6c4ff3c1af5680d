"""Sentences of a report read back: shifts of frequency of a placement, ring-downs of more than one mode."""

import re
from dataclasses import replace

import numpy as np
import pytest

from ema import store
from ema.data import Finding
from ema.report.friction import ring_down_sentences
from ema.report.placement import answer
from tests.unit.friction_nouns import decay, placement

NUMBER = r"([+-]?\d+\.\d)"


@pytest.mark.parametrize("seed", range(20))
def test_the_printed_shifts_add_up_to_the_printed_frequency(seed):
    rng = np.random.default_rng([20261122, seed])
    whole = placement()
    bare, shift = rng.uniform(50, 2000), rng.uniform(-30, 30)
    best = replace(
        whole.ranking.best,
        frequency=np.full((1, 2), bare + shift),
        mass_shift=rng.uniform(-40, 0, 1),
        stiffness_shift=rng.uniform(0, 40, 1),
    )
    prediction = replace(whole.ranking.prediction, bare_frequencies=np.array([bare]))
    sentence = answer(replace(whole, ranking=replace(whole.ranking, prediction=prediction, places=(best,))))
    found = re.search(rf"{NUMBER} -> {NUMBER} Hz \((.*?)\)", sentence)
    assert found is not None
    before, after = float(found[1]), float(found[2])
    parts = [float(part) for part in re.findall(rf"{NUMBER} Hz", found[3])]
    assert before == pytest.approx(bare, abs=0.051) and after == pytest.approx(bare + shift, abs=0.051)
    assert parts[:2] == pytest.approx([best.mass_shift[0], best.stiffness_shift[0]], abs=0.051)
    assert before + sum(parts) == pytest.approx(after, abs=1e-6)


def test_a_ring_down_of_more_than_one_mode_says_so_in_its_sentence(tmp_path):
    finding = Finding("warning", "not-one-mode", "take", "for 30.0% of the ring-down the amplitude grows.", 0.3, 0.0)
    reach = np.full(len(decay().times), 0.01)
    doubtful = replace(decay(), findings=(finding,), frequency_reach=reach, damping_reach=reach)
    store.save(tmp_path / "decay.h5", doubtful)
    again = store.load(tmp_path / "decay.h5")
    assert again.findings == (finding,) and np.array_equal(again.damping_reach, reach)
    (sentence,) = ring_down_sentences([again])
    assert sentence.endswith("Not one mode: for 30.0% of the ring-down the amplitude grows.")
    assert "Not one mode" not in ring_down_sentences([decay()])[0]
