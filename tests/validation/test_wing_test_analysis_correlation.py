"""Measured wing against its finite element model: a pairing with two swapped pairs.

Data: set 07 (Vibration-Testing/vibrationtesting): six measured shapes at 18 points, and a beam model of the wing.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from ema.data import ModalModel, poles_from
from ema.dof import Dof
from ema.shapes import auto_mac, compare, modal_phase_collinearity

ORDINALS = ("1st", "2nd", "3rd", "4rth", "5th", "6th")
MEASURED_FREQUENCIES = np.array([13.54, 51.81, 125.19, 167.76, 228.05, 328.41])


@pytest.fixture(scope="module")
def folder(datasets: Path) -> Path:
    return datasets / "07_wing_test_analysis_correlation"


@pytest.fixture(scope="module")
def measured(folder: Path) -> ModalModel:
    shapes = [
        loadmat(folder / f"{ordinal}NaturalFreq18.mat")[f"U{mode}"][:, 0] for mode, ordinal in enumerate(ORDINALS, 1)
    ]
    return _model(MEASURED_FREQUENCIES, np.column_stack(shapes))


@pytest.fixture(scope="module")
def computed(folder: Path) -> ModalModel:
    wing = loadmat(folder / "WingBeamforMAC.mat")
    heave = wing["fms"][2::6][:18]
    frequencies = wing["fs"][:, 0]
    lowest = np.argsort(frequencies)[:6]
    return _model(frequencies[lowest], heave[:, lowest])


def _model(frequencies: np.ndarray, shapes: np.ndarray) -> ModalModel:
    count = len(frequencies)
    return ModalModel(
        poles_from(frequencies, np.zeros(count)),
        shapes.astype(complex),
        tuple(Dof(node, "+Z") for node in range(1, len(shapes) + 1)),
        np.ones((1, count), complex),
        (Dof(1, "+Z"),),
    )


def test_pairing_and_mac(measured: ModalModel, computed: ModalModel):
    found = compare(measured, computed)
    assert found.pairs == ((0, 0), (1, 1), (2, 3), (3, 2), (4, 5), (5, 4))
    assert [found.mac[pair] for pair in found.pairs] == pytest.approx([0.83, 0.87, 0.87, 0.92, 0.82, 0.86], abs=0.005)
    np.testing.assert_array_equal(np.argmax(found.mac, axis=1), [0, 1, 3, 2, 5, 4])


def test_measured_shapes_are_distinct(measured: ModalModel):
    table = auto_mac(measured.shapes)
    assert np.max(table - np.eye(6)) == pytest.approx(0.12, abs=0.005)


def test_measured_shapes_are_practically_real(measured: ModalModel):
    assert modal_phase_collinearity(measured.shapes).min() > 0.99
