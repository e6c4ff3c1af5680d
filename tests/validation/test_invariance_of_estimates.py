"""The same FRFs in another unit, order or form, or with other modes asked for, have the same modes and intervals.

None of these changes touches what the FRFs tell, so the maximum-likelihood estimate and the information at it are the
same by definition (Kay 1993, Fundamentals of Statistical Signal Processing I, 7.4: invariance of the estimator). Values
may move by 1e-6 of their standard deviation, standard deviations by 1e-3 of themselves; the accepted modes stay.
"""

from dataclasses import replace

import numpy as np
import pytest

from tests.bench.cases import Case, random_system
from tests.bench.draws import Knowledge, drawn
from tests.bench.invariance import Change, Said, case, compared, fitted, plain, sayings, scaled
from tests.bench.stated import Stated, automatic

SYSTEMS = {"a": (1, 6, 8, 2, 0.001, 1), "b": (2, 4, 5, 3, 0.01, 5), "c": (11, 10, 14, 2, 0.01, 1)}
"""Seed, modes, outputs, references, noise, averages."""
LOOSE = {"d": (2611521, 13)}
"""Seed and number of a system whose poles outside the band the data hardly determine: the last digit of the FRFs had
moved its modes by 1.5e-4 of their standard deviations, the order of the outputs by 4e-4, receptances by 1.1."""
WAYS = (
    "times 1 + 1e-12",
    "times 1 + 2e-12",
    "times 1e6",
    "times 1e-9",
    "in g",
    "outputs permuted",
    "references permuted",
    "near = the same frequencies",
    "one mode not asked for",
    "one mode asked for",
    "one mode asked for twice",
    "as receptance",
    "more orders",
)


def measured(name: str) -> Case:
    if name not in SYSTEMS:
        return case(*LOOSE[name])
    seed, modes, outputs, references, noise, averages = SYSTEMS[name]
    drawn_system = random_system(seed, noise, modes, outputs, references, 401)
    known = Knowledge("", averages, known=averages > 1)
    return replace(drawn_system, frfs=drawn(drawn_system, known, np.random.default_rng([seed, 1])))


@pytest.fixture(scope="module")
def original() -> dict[str, tuple[Case, Stated, dict[str, Said]]]:
    made = {}
    for name in (*SYSTEMS, *LOOSE):
        system = measured(name)
        stated = automatic(system.frfs)
        made[name] = system, stated, sayings(system.frfs, stated, np.random.default_rng(7))
    return made


def parameters() -> list:
    known = {name: SYSTEMS[name][-1] > 1 for name in SYSTEMS} | dict.fromkeys(LOOSE, True)
    return [
        pytest.param(name, way, id=f"{name}, {way}")
        for name in known
        for way in WAYS
        if way != "as receptance" or known[name]
    ]


@pytest.mark.parametrize(("name", "way"), parameters())
def test_the_same_measurement_said_in_another_way_has_the_same_modes(original, name: str, way: str) -> None:
    _, stated, ways = original[name]
    assert len(stated.model.poles) > 1, "a comparison of nothing would always succeed"
    change = compared(stated, fitted(ways[way]), ways[way])
    assert change.within, change


def test_no_decision_flips_over_rescaled_runs(original) -> None:
    system, stated, _ = original["b"]
    rng = np.random.default_rng(11)
    runs = [scaled(system.frfs, float(np.exp(rng.uniform(-20, 20)))) for _ in range(6)]
    changes = [compared(stated, fitted(run), run) for run in runs]
    assert not any(change.flipped or change.findings for change in changes), changes


def test_a_change_of_the_data_is_seen() -> None:
    """The comparison itself: noise drawn anew moves values by their standard deviations, not by a millionth of them."""
    system = measured("b")
    first = automatic(system.frfs)
    again = replace(system.frfs, values=system.clean + np.conj(system.frfs.values - system.clean))
    change: Change = compared(first, automatic(again), plain(again))
    assert not change.within
    assert change.flipped or change.value > 0.1
