"""Frequency axes printed with few digits: the axis that was rounded is known to the tests."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import acquisition
from acquisition.files.printed_axis import even_axis, restored
from ema.examples import frf_set
from tests.bench.cases import random_system
from tests.bench.scoring import cramer_rao
from tests.bench.stated import automatic, errors


@pytest.mark.parametrize("seed", range(40))
def test_lines_of_a_transform_are_put_back_from_what_is_printed(seed: int) -> None:
    rng = np.random.default_rng([1210, seed])
    spacing = float(rng.choice([0.3125, 0.390625, 0.78125, 100 / 1024, 51200 / 32768]))
    first, count = int(rng.integers(0, 400)), int(rng.integers(60, 4000))
    exact = spacing * np.arange(first, first + count)
    if seed % 2:  # lines that were left out, as by a band in two parts
        exact = np.delete(exact, slice(count // 3, count // 3 + 7))
    digits = int(np.ceil(-np.log10(0.4 * spacing))) + seed % 3
    printed = np.round(exact, digits)
    axis = even_axis(printed)
    if np.abs(printed - exact).max() < 1e-9:
        assert axis is None
        return
    if axis is None:  # off by less than matters to any FRF
        assert 0.5 * 10.0**-digits < 1e-4 * spacing
        return
    assert np.abs(axis - exact).max() < 1e-9  # the spacings are fractions of small denominators


@pytest.mark.parametrize("seed", range(20))
def test_an_axis_that_does_not_begin_at_a_multiple_keeps_its_beginning(seed: int) -> None:
    rng = np.random.default_rng([1211, seed])
    exact = rng.uniform(20, 900) + rng.uniform(0.11, 2.0) * np.arange(800)
    axis = even_axis(np.round(exact, 1))
    assert axis is not None
    # Of 800 lines with uniform errors, the extreme ones leave about digit / 800 open.
    assert np.abs(axis - exact).max() < 20 * 0.1 / 800


def test_uneven_axes_stay_as_they_are() -> None:
    rng = np.random.default_rng(1212)
    for _ in range(200):
        count = int(rng.integers(64, 400))
        uneven = np.cumsum(rng.integers(1, 4, count) * 0.1) + 30.0  # stepped sine: steps of 0.1 to 0.3 Hz
        assert even_axis(np.round(uneven, 1)) is None
        assert even_axis(np.round(np.geomspace(10, 2000, count), 2)) is None
    assert even_axis(np.linspace(10.0, 30.0, 81)) is None
    assert even_axis(np.array([1.0, 2.0, 3.3])) is None


@pytest.mark.parametrize("digits", [1, 2])
def test_a_file_with_rounded_frequencies_has_the_intervals_of_the_exact_one(tmp_path: Path, digits: int) -> None:
    """The mean square of the errors over the stated deviations is 1; rounding to 0.1 Hz had made it 7 and more."""
    ratios = []
    for seed in range(4):
        case = random_system(7100 + seed, 0.001, 6, 4, 1, 801)
        exact = case.frfs
        pieces = []
        for row in range(4):
            values = exact.values[:, row, 0]
            table = np.column_stack([np.round(exact.frequencies, digits), values.real, values.imag])
            path = tmp_path / f"{seed}_{row}.csv"
            form = [f"%.{digits}f", "%.10g", "%.10g"]
            np.savetxt(path, table, form, ",", header="Frequency [Hz],Real [m/s^2/N],Imag [m/s^2/N]", comments="")
            contents = acquisition.read(path)
            assert [note.code for note in contents.findings] == ["frequencies-rounded"]
            pieces.append(contents.frfs[0])
        read = replace(exact, frequencies=pieces[0].frequencies)
        assert np.allclose(np.stack([piece.values[:, 0, 0] for piece in pieces], 1), exact.values[:, :, 0], rtol=1e-8)
        found = errors(case, automatic(read))
        hit = (found.match >= 0) & cramer_rao(case).identifiable
        ratios += [*found.frequency[hit], *found.damping[hit]]
    # 99.9999 % of the mean of 30 squares and more lie below 2.6.
    assert len(ratios) >= 30
    assert np.mean(np.square(ratios)) < 2.6


def test_what_is_replaced_is_said_with_its_digit_and_spacing() -> None:
    frfs = frf_set()
    printed = replace(frfs, frequencies=np.round(frfs.frequencies * 0.997, 1))
    (_, (note,)) = restored([printed])
    assert "printed to 0.1 Hz" in note.message
    assert restored([frfs]) == ((frfs,), ())
