"""Frequency axes with lines that are missing, and such that are uneven on purpose."""

import warnings
from pathlib import Path

import numpy as np
import pytest

import acquisition
from ema.errors import InputError


def codes(path: Path, frequencies: np.ndarray, exact: np.ndarray | None = None) -> dict[str, float]:
    """Findings about an FRF table with these frequencies in Hz, which ``exact`` ones were rounded to: code and value."""
    rng = np.random.default_rng(20261125)
    rows = np.column_stack([frequencies, rng.normal(size=(len(frequencies), 2))])
    np.savetxt(path, rows, delimiter=",", header="Frequency [Hz],Real,Imaginary", comments="", fmt="%.6g")
    contents = acquisition.read(path)
    read = contents.frfs[0].frequencies
    np.testing.assert_allclose(read, frequencies if exact is None else exact, rtol=1e-5)
    return {finding.code: finding.value for finding in contents.findings}


@pytest.mark.parametrize("lost", [[7], [7, 8, 31], [1, 20, 40, 59]])
def test_lost_lines_are_named_and_counted(tmp_path: Path, lost: list[int]) -> None:
    axis = np.delete(12.5 + 0.78125 * np.arange(80), lost)
    assert codes(tmp_path / "a.csv", axis)["lines-missing"] == len(lost)


@pytest.mark.parametrize(
    "axis",
    [
        12.5 + 0.78125 * np.arange(80),
        np.geomspace(5, 500, 60),
        np.setdiff1d(np.arange(1, 400, 2), np.arange(5, 400, 8)).astype(float),  # odd lines, one of four left out
        np.concatenate([np.arange(10, 40), 40 + 0.25 * np.arange(60)]),  # refined about a resonance
    ],
    ids=["even", "logarithmic", "odd multisine", "refined"],
)
def test_axes_that_are_meant_so_have_no_finding(tmp_path: Path, axis: np.ndarray) -> None:
    assert not {"lines-missing", "frequencies-rounded"} & set(codes(tmp_path / "a.csv", axis))


def test_lines_rounded_to_full_hertz_are_those_that_were_rounded(tmp_path: Path) -> None:
    exact = 3.7 * np.arange(1, 90)
    found = codes(tmp_path / "a.csv", np.round(exact), exact)
    assert "lines-missing" not in found
    assert found["frequencies-rounded"] == pytest.approx(0.5, abs=0.01)  # 3.7 * 5 = 18.5 Hz


@pytest.mark.parametrize("titles", ["Real,Imaginary", "Magnitude,Phase (deg)"])
def test_infinite_numbers_have_a_finding_and_no_warning_of_numpy(tmp_path: Path, titles: str) -> None:
    rows = "\n".join(f"{line},1e999,1e999" for line in range(20))
    (tmp_path / "a.csv").write_text(f"Frequency [Hz],{titles}\n{rows}\n")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        contents = acquisition.read(tmp_path / "a.csv", amplitude_unit="(m/s^2)/N" if "Phase" in titles else None)
    assert "not-finite" in {finding.code for finding in contents.findings}


@pytest.mark.parametrize(
    ("place", "cells", "rows", "side"), [(0, "x\t 1\t 2\t", 39, "behind"), (25, "50\t 1\t 2\t9", 25, "in front of")]
)
def test_signalcalc_rows_beside_a_damaged_one_are_salvaged(
    tmp_path: Path, place: int, cells: str, rows: int, side: str
) -> None:
    head = "Units: Ratio\t\nRef Chan:Resp Chan\t1+Z:2+Z\t\n\t\nFrequency\t Real\t Imaginary\t\nHz\t(m/s^2)(N)\t \t\n"
    lines = [f"{2 * k}\t {k % 7}.5\t -{k % 5}.25\t" for k in range(40)]
    lines[place] = cells
    path = tmp_path / "a.txt"
    path.write_text(head + "\n".join(lines) + "\n")
    with pytest.raises(InputError, match=f"line {place + 6}"):
        acquisition.read(path)
    contents = acquisition.read(path, salvage=True)
    first = 1 if side == "behind" else 0
    np.testing.assert_array_equal(contents.frfs[0].frequencies, 2.0 * np.arange(first, first + rows))
    (finding,) = [finding for finding in contents.findings if finding.code == "salvaged"]
    assert f"the {rows} rows {side} it are read" in finding.message
