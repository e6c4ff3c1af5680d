"""A sensor that is turned round between the points of a roving test is named, and nothing is where none was."""

from dataclasses import replace

import numpy as np
import pytest

from ema.data import FrfSet
from ema.estimate import hammer_test, quality
from tests.bench.cases import random_system
from tests.unit.closed_form_impacts import hammer_run


def named(frfs: FrfSet) -> list[tuple[str, str]]:
    return [(one.where, one.message.split(" the sign")[0]) for one in quality(frfs) if one.code == "sensor-turned"]


@pytest.mark.parametrize("points", [(3,), (2, 5)])
@pytest.mark.parametrize("channel", [1, 3])
def test_the_channel_and_its_points_are_named(points: tuple[int, ...], channel: int) -> None:
    """Three accelerometers, so that the odd one can be told; each mode had been found twice with a confidence of 1."""

    def turned(point: int, number: int, times: np.ndarray, signals: np.ndarray) -> np.ndarray:
        signs = np.ones((len(signals), 1))
        signs[channel] = -1 if point in points else 1
        return signs * signals

    frfs, _ = hammer_test(hammer_run(turned, outputs=(1, 4, 5)))
    output = {1: "1:+Z", 3: "5:+Z"}[channel]
    assert named(frfs.band(10, 200)) == [(f"run bare, {output}", f"at {', '.join(f'{one}:+Z' for one in points)}")]


def test_of_two_channels_both_are_named() -> None:
    def turned(point: int, number: int, times: np.ndarray, signals: np.ndarray) -> np.ndarray:
        return signals * np.array([[1.0], [-1.0 if point == 2 else 1.0], [1.0]])

    frfs, _ = hammer_test(hammer_run(turned))
    assert named(frfs.band(10, 200)) == [("run bare, 1:+Z or 4:+Z", "at 2:+Z")]
    frfs, _ = hammer_test(hammer_run())
    assert not named(frfs.band(10, 200))


def test_modes_that_overlap_and_noise_have_no_turned_sensor() -> None:
    """40 random systems of 3 to 24 modes, noise up to 20 %; of 300 more none was accused. Where well separated modes
    stand, a turned channel is found."""
    rng, found = np.random.default_rng(40), 0
    for seed in range(40):
        noise, modes = float(rng.choice([0.001, 0.01, 0.05, 0.2])), int(rng.integers(3, 25))
        frfs = random_system(500 + seed, noise, modes, int(rng.integers(3, 30)), int(rng.integers(2, 5)), 801).frfs
        assert not named(frfs)
        values = np.array(frfs.values)
        values[:, ::4, 1] *= -1
        found += bool(named(replace(frfs, values=values)))
    assert found >= 10
