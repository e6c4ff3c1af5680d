"""No data type takes values that contradict each other or what they stand for; files of earlier versions are still read."""

import dataclasses
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ema import data, examples, store
from ema.data.invariants import as_stored, check
from ema.errors import InputError
from tests.containers import Draw, kinds

KINDS = kinds()


def drawn(name: str) -> Any:
    return Draw().container(KINDS[name])


def fields_named(*endings: str) -> list[tuple[str, str]]:
    """Fields of all data types whose names are one of some words, or end with it."""
    return [
        (name, field.name)
        for name, kind in KINDS.items()
        for field in dataclasses.fields(kind)
        if field.init and any(field.name == one or field.name.endswith(f"_{one}") for one in endings)
    ]


def is_number(name: str, field: str) -> bool:
    return isinstance(getattr(drawn(name), field), float | np.ndarray)


SPREADS = [pair for pair in fields_named("std") if is_number(*pair)]
PAIRS = [
    (name, low, low[: -len("low")] + "high")
    for name, low in fields_named("low")
    if not isinstance(getattr(drawn(name), low), data.Band)
]
SHARES = [
    *fields_named("confidence"),
    ("ModeComparison", "mac"),
    ("ModeComparison", "co_mac"),
    ("ModeQuality", "modal_phase_collinearity"),
]
BANDS = [pair for pair in fields_named("band") if isinstance(getattr(drawn(pair[0]), pair[1]), tuple)]
INCREASING = [
    ("FrfSet", "frequencies"),
    ("HitGallery", "frequencies"),
    ("ForceSurface", "frequencies"),
    ("ForcedResponse", "frequencies"),
    ("Response", "times"),
    ("Decay", "times"),
    ("AmplitudeDependentMode", "amplitude"),
    ("AmplitudeDraws", "amplitude"),
]


def refused(name: str, **wrong: Any) -> InputError:
    whole = drawn(name)
    with pytest.raises(InputError) as error:
        replace(whole, **wrong)
    assert error.value.what and (error.value.expected or error.value.advice)
    return error.value


def test_the_names_reach_what_they_are_meant_to_reach() -> None:
    assert len(SPREADS) > 20 and len(PAIRS) == 9 and len(SHARES) >= 5 and len(BANDS) >= 4


@pytest.mark.parametrize(("name", "field"), SPREADS)
def test_no_standard_deviation_is_negative(name: str, field: str) -> None:
    refused(name, **{field: -np.abs(getattr(drawn(name), field))})


@pytest.mark.parametrize(("name", "low", "high"), PAIRS)
def test_no_interval_is_upside_down(name: str, low: str, high: str) -> None:
    one = drawn(name)
    refused(name, **{low: getattr(one, high), high: getattr(one, low)})


@pytest.mark.parametrize(("name", "field"), SHARES)
def test_no_share_lies_outside_nothing_and_all(name: str, field: str) -> None:
    for beyond in (-0.1, 1.1):
        assert f"{name}.{field}" in refused(name, **{field: 0 * getattr(drawn(name), field) + beyond}).where


@pytest.mark.parametrize(("name", "field"), BANDS)
def test_no_band_ends_below_its_beginning(name: str, field: str) -> None:
    error = refused(name, **{field: (100.0, 20.0)})
    assert (error.got, error.what) == ("100 to 20", "a band whose ends are not in order")


@pytest.mark.parametrize(("name", "field"), INCREASING)
def test_axes_increase(name: str, field: str) -> None:
    values = getattr(drawn(name), field)
    for wrong in (values[::-1], np.full(len(values), values[0])):
        refused(name, **{field: wrong})


COUNTS = [
    ("FrfSet", "outputs"),
    ("FrfSet", "inputs"),
    ("ModalModel", "dofs"),
    ("PoleTable", "references"),
    ("PoleTable", "letter"),
    ("Response", "dofs"),
    ("HarmonicResponse", "dofs"),
    ("NonlinearMode", "dofs"),
    ("ModeComparison", "pairs"),
    ("ModelUpdate", "names"),
    ("RepeatGroup", "runs"),
    ("SingleMode", "outputs"),
    ("SetUpShifts", "names"),
    ("AmplitudePrediction", "laws"),
]


@pytest.mark.parametrize(("name", "field"), COUNTS)
def test_there_are_as_many_labels_as_values(name: str, field: str) -> None:
    refused(name, **{field: getattr(drawn(name), field)[:1]})


WRONG: list[tuple[str, dict[str, Any], str]] = [
    ("Recording", {"sampling_rate": 0.0}, "Recording.sampling_rate: a value is out of range; got 0, expected above 0"),
    ("Recording", {"sampling_rate": float("nan")}, "sampling_rate: a value is not finite; got nan"),
    (
        "FrfSet",
        {"frequencies": np.array([-1.0, 0, 1, 2, 3])},
        "frequencies: a value is out of range; got -1, expected 0 or",
    ),
    (
        "FrfSet",
        {"frequencies": np.array([1.0, 2, np.nan, 4, 5])},
        "frequencies: an axis that does not increase; got nan after 2",
    ),
    ("Geometry", {"nodes": np.array([1, 2, 2])}, "nodes: a node is there twice; got 2"),
    ("Excitation", {"level": -5.0}, "Excitation.level: a value is out of range; got -5, expected 0 or more"),
    ("Condition", {"temperature": -3.0}, "Condition.temperature: a value is out of range; got -3, expected 0 or more"),
    (
        "SetUps",
        {"number": np.array([[0, 2], [1, 0]])},
        "number: a position that is in no names; got 2, expected 0 to 1",
    ),
    ("Candidates", {"beams": np.array([0, -1])}, "beams: a position that is in no catalogue; got -1, expected 0 to 1"),
    ("Band", {"level": 95.0}, "Band.level: a value is out of range; got 95, expected within 0 and 1"),
    ("AmplitudePrediction", {"damping": data.Band(*np.ones((3, 5)))}, "a band of another shape than its axis"),
    (
        "Placement",
        {"extent": np.array([[0.0, 1.0], [2.0, 1.0]])},
        "extent: a band whose ends are not in order; got 2 to 1",
    ),
]


@pytest.mark.parametrize(
    ("name", "wrong", "sentence"), WRONG, ids=lambda value: value if isinstance(value, str) else ""
)
def test_a_wrong_value_is_named(name: str, wrong: dict[str, Any], sentence: str) -> None:
    assert sentence in str(refused(name, **wrong))


def test_bounds_and_values_have_one_shape() -> None:
    band = data.Band(*np.ones((3, 2)))
    object.__setattr__(band, "low", np.zeros(3))
    with pytest.raises(InputError, match=r"Band\.low: bounds and values differ in shape"):
        check(band)


def test_what_is_unknown_breaks_nothing() -> None:
    data.Excitation("sweep", level=float("nan"), std=float("nan"), band=(20.0, 20.0))
    data.Band(*np.full((3, 4), np.nan))
    chart = examples.modal_map()
    replace(chart, damping_std=np.full(chart.damping.shape, np.nan))


def test_an_array_that_was_checked_is_not_taken_for_another() -> None:
    chart = examples.modal_map()
    assert chart.damping_std is not None
    for _ in range(50):  # memory of arrays that are gone is used again
        replace(chart, damping_std=chart.damping_std + 0.0)
        with pytest.raises(InputError, match=r"ModalMap\.damping_std: a value is out of range"):
            replace(chart, damping_std=-chart.damping_std)


def test_a_file_of_an_earlier_version_is_read_and_named(tmp_path: Path) -> None:
    model = examples.modal_model()
    with pytest.warns(UserWarning, match=r"made by hand: .*ModalModel\.confidence"), as_stored("made by hand"):
        old = replace(model, confidence=np.array([0.5, 1.5, 0.9]))
    store.save(tmp_path / "old.h5", old)
    with pytest.warns(UserWarning) as said:
        loaded = store.load(tmp_path / "old.h5")
    assert loaded.confidence.tolist() == [0.5, 1.5, 0.9]
    assert str(said[0].message) == (
        f"{tmp_path / 'old.h5'}: line, ModalModel.confidence: a value is out of range; got 1.5, expected within 0 and 1; "
        "the values are those of the file"
    )
    with pytest.raises(InputError, match="confidence: a value is out of range"):
        replace(loaded, name="new")  # outside of reading it is refused
    store.save(tmp_path / "new.h5", model)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        store.load(tmp_path / "new.h5")
