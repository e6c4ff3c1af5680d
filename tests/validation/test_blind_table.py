"""The blind table: told from blows on the bare table alone, answered by OpenSeesPy.

``tests/validation/blind_table`` holds the signals, the prediction made from them, and the truth computed afterwards with
joints drawn by the fingerprint of the prediction. ``python -m tests.bench.blind_table`` makes all of it anew.
"""

import ast
import hashlib
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest

from tests.validation.blind_table import prediction as predictor
from tests.validation.blind_table.score import score


@pytest.fixture(scope="module")
def stored() -> dict:
    return json.loads(predictor.PREDICTION.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def told(tmp_path_factory) -> dict:
    """What the present predictor says, computed in another process, whose functions are not watched as a test's are."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        folder = tmp_path_factory.mktemp("blind")
        return predictor.as_mapping(*pool.submit(predictor.prediction, folder, draws=10).result())


def test_the_truth_shares_no_code_with_the_predictor():
    tree = ast.parse((predictor.HERE / "truth.py").read_text(encoding="utf-8"))
    roots = {name.name.split(".")[0] for node in ast.walk(tree) if isinstance(node, ast.Import) for name in node.names}
    roots |= {str(node.module).split(".")[0] for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert roots - set(sys.stdlib_module_names) == {"openseespy"}
    assert "truth" not in (predictor.HERE / "prediction.py").read_text(encoding="utf-8").split('"""', 2)[2].lower()


def test_signals_prediction_and_truth_belong_together(stored):
    """The joints were drawn by the fingerprint of the prediction, which holds that of the signals."""
    assert stored["signals"] == hashlib.sha256(predictor.BARE.read_bytes()).hexdigest()
    true = json.loads((predictor.HERE / "truth.json").read_text(encoding="utf-8"))
    assert true["prediction"] == hashlib.sha256(predictor.PREDICTION.read_bytes()).hexdigest()
    assert true["program"].startswith("OpenSeesPy")


@pytest.mark.xfail(
    strict=True,
    reason="a mode at 1686 Hz, next to the end of the band at 1700 Hz and with a damping uncertain by 16 %, is no longer "
    "accepted: places (7, 5) and (1, 2), 0.6 % apart in what was stored, change their order",
)
def test_the_present_predictor_says_what_was_stored(stored, told):
    assert told["bare"]["frequency"] == pytest.approx(stored["bare"]["frequency"], abs=0.02)
    assert told["bare"]["damping"] == pytest.approx(stored["bare"]["damping"], rel=0.01)
    assert [told["places"][0][key] for key in ("column", "row", "normal_force")] == [
        stored["places"][0][key] for key in ("column", "row", "normal_force")
    ]
    assert np.allclose(told["frequency"], stored["frequency"], atol=0.1)
    assert np.allclose(told["damping"], stored["damping"], rtol=0.02)


@pytest.mark.xfail(strict=True, reason="15 of 18 values are inside their 95 % bands, goal 17; see docs/placement.md")
def test_the_truth_falls_inside_the_bands():
    found = score(predictor.HERE)
    print("\n" + found.text())
    assert found.damping.size + found.frequency.size == 18
    assert found.inside >= 17


@pytest.mark.xfail(strict=True, reason="the widest band is +-28 % of the damping gained, goal 25 %")
def test_no_band_is_wider_than_a_quarter_of_the_damping_gained():
    assert score(predictor.HERE).width.max() <= 0.25


def test_no_other_place_damps_much_better():
    found = score(predictor.HERE)
    assert len(found.places) >= 5
    assert found.place >= 0.9
