"""Responses that are stated in the unit of another derivative, on random structures."""

from dataclasses import replace

import numpy as np
import pytest

import ema
from ema.data import FrfSet
from tests.bench.cases import Case, random_system
from tests.bench.stated import automatic

NAME = "channel-quarter-turn"


def integrated(frfs: FrfSet, row: int, power: int = 1) -> FrfSet:
    """The FRFs with one response integrated over time ``power`` times, in the size of the others."""
    values = np.array(frfs.values)
    values[:, row] /= (1j * frfs.frequencies[:, None] / np.median(frfs.frequencies)) ** power
    return replace(frfs, values=values)


def drawn(seed: int, outputs: int = 8) -> Case:
    return random_system(seed, 0.01, 6, outputs, 2, 801)


def with_straight_modes(seed: int, rows: int) -> Case:
    """A system whose modes are nearly real, and whose first ``rows`` responses move in three of them and more."""
    for number in range(400):
        case = drawn(1000 * seed + number)
        shapes = case.truth.shapes
        strong = np.abs(shapes) ** 2 >= 0.2 * np.mean(np.abs(shapes) ** 2, axis=0)
        straight = ema.shapes.quality(shapes).modal_phase_collinearity
        if shapes.shape[1] >= 4 and straight.min() > 0.97 and np.all(strong[:rows].sum(axis=1) >= 4):
            return case
    raise AssertionError("no such system in 400 draws")


@pytest.mark.parametrize("seed", range(4))
def test_a_velocity_stated_as_an_acceleration_is_named_after_the_fit(seed: int) -> None:
    case = with_straight_modes(912 + seed, seed + 1)
    frfs = integrated(case.frfs, seed)
    notes = [note for note in ema.estimate.quality(frfs, automatic(frfs).model) if note.code == NAME]
    assert [note.where.split(", ")[-1] for note in notes] == [str(frfs.outputs[seed])]
    assert notes[0].severity == "error"


@pytest.mark.parametrize("seed", range(4))
def test_sound_responses_and_displacements_have_no_quarter_turn(seed: int) -> None:
    """Two derivatives apart, phases differ by half a turn, as between points that move against each other."""
    case = drawn(91300 + seed)
    for frfs in (case.frfs, integrated(case.frfs, 2, power=2)):
        assert NAME not in [note.code for note in ema.estimate.quality(frfs, automatic(frfs).model)]


def test_true_shapes_of_random_systems_are_never_named() -> None:
    rng = np.random.default_rng(9140)
    for _ in range(60):
        case = random_system(int(rng.integers(2**31)), 0.01, int(rng.integers(3, 17)), int(rng.integers(4, 40)), 2, 401)
        for modes in (case.truth, None):
            assert NAME not in [note.code for note in ema.estimate.quality(case.frfs, modes)]


def test_two_of_eight_are_both_named_and_half_of_them_is_undecided() -> None:
    case = with_straight_modes(918, 4)
    shapes = np.array(case.truth.shapes)
    for count, expected in ((2, 2), (4, 0)):
        turned = shapes.copy()
        turned[:count] *= 1j
        notes = ema.estimate.quality(case.frfs, replace(case.truth, shapes=turned))
        assert sum(note.code == NAME for note in notes) == expected
