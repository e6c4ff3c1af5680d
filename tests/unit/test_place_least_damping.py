"""The least damping over the force levels: its interval holds the least value, whichever level it belongs to."""

from dataclasses import replace

import numpy as np
import pytest

from ema import examples
from ema.data.placement import Place
from ema.report.least_damping import least_damping

DRAWS = 20_000


def at_levels(place: Place, **rows: np.ndarray) -> Place:
    """The place with these values of its one mode at every level."""
    levels = len(rows["damping"])
    axes = {"normal_forces": np.full(levels, 500.0), "frequency": np.full((1, levels), 490.0)}
    return replace(place, **axes, **{name: row[None] for name, row in rows.items()})


def covered(middle: np.ndarray, std: np.ndarray, common: float, seed: int) -> tuple[float, float]:
    """Shares of tables whose least damping lies in the interval of the least, and in that of the least predicted level.

    What is true scatters about the predictions by ``std``, the share ``common`` of its variance alike at all levels.
    """
    rng = np.random.default_rng(seed)
    shared, own = rng.standard_normal((DRAWS, 1)), rng.standard_normal((DRAWS, len(middle)))
    true = middle + std * (np.sqrt(common) * shared + np.sqrt(1 - common) * own)
    rows = {"damping": middle, "damping_low": middle - 1.96 * std, "damping_high": middle + 1.96 * std}
    place = examples.ranking().best
    place = at_levels(place, **rows)
    least, low, high = true.min(axis=1), *least_damping(place, 0)[2:]
    row = int(middle.argmin())
    of_level = (rows["damping_low"][row] <= least) & (least <= rows["damping_high"][row])
    return float(np.mean((low <= least) & (least <= high))), float(np.mean(of_level))


@pytest.mark.parametrize("common", [0.0, 0.5, 0.9])
def test_a_level_that_is_less_certain_may_have_the_least_damping(common: float) -> None:
    """Three levels with 0.87, 0.89 and 1.03 %, the second one uncertain by two and a half times as much as the first."""
    of_least, of_level = covered(np.array([0.87, 0.89, 1.03]), np.array([0.025, 0.066, 0.03]), common, seed=3)
    assert of_least >= 0.94 and of_level <= 0.9


@pytest.mark.parametrize("common", [0.0, 0.9])
def test_levels_alike_in_value_and_certainty(common: float) -> None:
    """At worst every level falls below its bound in 2.5 % of tables: three levels of their own leave 92.7 %."""
    of_least, of_level = covered(np.full(3, 0.9), np.full(3, 0.03), common, seed=4)
    assert of_least >= 0.92 and of_least == pytest.approx(of_level, abs=0.005)


def test_levels_without_a_value_are_left_out() -> None:
    damping = np.array([0.012, np.nan, 0.010])
    place = at_levels(
        examples.ranking().best,
        damping=damping,
        damping_low=damping - np.array([0.004, 0.0, 0.001]),
        damping_high=damping + 0.003,
    )
    least = least_damping(place, 0)
    assert (least.level, least.value) == (2, 0.010)
    assert (least.low, least.high) == pytest.approx((0.008, 0.013))
