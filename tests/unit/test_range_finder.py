"""Main directions of a matrix: they end where the matrix has no more, whichever of its sides is longer."""

from dataclasses import replace

import numpy as np
import pytest

from ema import synthesis
from ema.fit import modes, stabilise
from ema.fit.range_finder import growing
from tests.unit.fit_rig import model


def matrix(rows: int, columns: int, signals: int, seed: int) -> np.ndarray:
    """Directions of energy 1e4 times that of noise of unit variance, real."""
    rng = np.random.default_rng([71, seed])
    strong = rng.standard_normal((rows, signals)) @ rng.standard_normal((signals, columns))
    return 100 * strong + rng.standard_normal((rows, columns))


@pytest.mark.parametrize(
    ("rows", "columns", "signals"), [(365, 66, 66), (365, 66, 9), (365, 128, 128), (900, 4000, 5), (4000, 900, 5)]
)
def test_search_for_directions_ends_and_counts_those_above_noise(rows: int, columns: int, signals: int) -> None:
    drawn, calls = matrix(rows, columns, signals, 1), []

    def slabs():
        calls.append(1)
        assert len(calls) < 20, "the search does not end"
        yield drawn

    found, above = growing(slabs, rows, 128, lambda some: some.above(1.1))
    assert len(found.energies) <= min(rows, columns)
    # where noise has directions of its own, the directions of the signal stand out, and those alone
    assert above == (signals if signals < min(rows, columns) else pytest.approx(above))


@pytest.mark.timeout(120)
@pytest.mark.parametrize("outputs", [300, 700])
def test_more_outputs_than_lines_end_and_keep_the_modes(outputs: int) -> None:
    """A scan of many points over few lines: no direction is without signal, and all of them are kept once."""
    truth = model([120.0, 150.0, 190.0], [0.02, 0.015, 0.02], dofs=outputs, drive=(0,), phase=0.1, seed=outputs)
    exact = synthesis.frfs(truth, np.linspace(100.0, 220.0, 49), "accelerance")
    rng = np.random.default_rng([72, outputs])
    size = 1e-4 * np.sqrt(np.mean(np.abs(exact.values) ** 2))
    scatter = np.sqrt(0.5) * rng.standard_normal((*exact.values.shape, 2)).view(complex)[..., 0]
    measured = replace(exact, values=exact.values + size * scatter, name="scan")
    found = modes(measured, stabilise(measured, range(2, 13, 2)))
    np.testing.assert_allclose(found.natural_frequencies, truth.natural_frequencies, rtol=1e-4)
