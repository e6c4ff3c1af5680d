"""Files of earlier versions are read forever, and names on disk change only with the schema number.

``golden/containers_v1.h5`` holds one of every container as version 1 wrote it, ``containers_v1.json`` what is in it,
``names_v1.json`` the names and choices of version 1. Files of a version are never written again once the next one is
there. Run with ``EMA_WRITE_GOLDEN=1`` after a field or a container was *added* to list the names of the present
version anew; a name that is renamed or dropped needs a higher ``SCHEMA_VERSION`` and a ``Migration``.
"""

import dataclasses
import json
import os
import typing
from datetime import datetime
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import h5py
import numpy as np
import pytest

from ema import store
from ema.data import Campaign, Channel, Hit, Lazy, Recording, StudyResult
from ema.errors import InputError
from ema.store import layout, migrations
from ema.store.migrations import Migration, migrated
from ema.study import kept
from tests.containers import kinds, one_of_each

GOLDEN = Path(__file__).parent / "golden"
NAMES = sorted(GOLDEN.glob("names_v*.json"))


def names_on_disk() -> dict[str, dict[str, list[str]]]:
    """The fields of each container, with the choices of those that have any."""
    listed = {}
    for name, kind in kinds().items():
        hints = typing.get_type_hints(kind)
        listed[name] = {
            field.name: list(get_args(hints[field.name])) if get_origin(hints[field.name]) is Literal else []
            for field in dataclasses.fields(kind)
            if field.init
        }
    return listed


def version_of(path: Path) -> int:
    return int(path.stem.rsplit("_v", 1)[1])


def plain(value: Any) -> Any:
    """Containers as mappings, arrays as lists, numbers that are no JSON as texts."""
    if dataclasses.is_dataclass(value):
        fields = [field.name for field in dataclasses.fields(value) if field.init]
        return {"$noun": type(value).__name__} | {name: plain(getattr(value, name)) for name in fields}
    if isinstance(value, np.ndarray):
        return {"dtype": value.dtype.kind, "array": plain(value.tolist())}
    if isinstance(value, list | tuple | Lazy):
        return [plain(item) for item in value]
    if isinstance(value, complex):
        return [value.real, value.imag]
    return value.isoformat() if isinstance(value, datetime) else value


def contained(expected: Any, present: Any, path: str = "") -> None:
    """Every recorded value is there; fields that came later are nobody's concern."""
    if isinstance(expected, dict):
        for name, value in expected.items():
            contained(value, present[name], f"{path}.{name}")
    elif isinstance(expected, list):
        assert len(present) == len(expected), path
        for place, (one, other) in enumerate(zip(expected, present, strict=True)):
            contained(one, other, f"{path}[{place}]")
    else:
        assert present == expected, path


@pytest.mark.parametrize("path", NAMES, ids=lambda path: path.stem)
def test_every_container_of_every_version_is_read(path: Path) -> None:
    version = version_of(path)
    held = store.load(GOLDEN / f"containers_v{version}.h5")
    recorded = json.loads((GOLDEN / f"containers_v{version}.json").read_text(encoding="utf-8"))
    assert list(held) == list(recorded) and len(recorded) >= 60
    for name, expected in recorded.items():
        contained(migrated(expected, version), plain(held[name]), name)


@pytest.mark.parametrize("path", NAMES, ids=lambda path: path.stem)
def test_every_name_that_was_ever_written_is_known(path: Path) -> None:
    """Also those of fields that no golden file has: they may not be taken for names of a newer version."""
    now = names_on_disk()
    for name, fields in json.loads(path.read_text(encoding="utf-8")).items():
        trees = [{"$noun": name} | dict.fromkeys(fields)]
        trees += [{"$noun": name, field: choice} for field, choices in fields.items() for choice in choices]
        for tree in trees:
            renamed = migrated(tree, version_of(path))
            kind = renamed.pop("$noun")
            assert kind in now, f"{name} was renamed without a migration"
            assert set(renamed) <= set(now[kind]), f"fields of {name} were renamed without a migration"
            for field, choice in renamed.items():
                assert choice is None or choice in now[kind][field], f"{name}.{field}: {choice} is no choice any more"


def test_names_on_disk_are_those_listed_for_this_version() -> None:
    path = GOLDEN / f"names_v{layout.SCHEMA_VERSION}.json"
    now = names_on_disk()
    listed = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    for name, fields in listed.items():
        lost = [field for field in fields if field not in now.get(name, {})]
        assert name in now and not lost, f"{name} {lost}: raise SCHEMA_VERSION and add a Migration"
    if os.environ.get("EMA_WRITE_GOLDEN"):
        path.write_text(json.dumps(now, indent=1) + "\n", encoding="utf-8")
        if not (held := GOLDEN / f"containers_v{layout.SCHEMA_VERSION}.h5").exists():
            store.save(held, one_of_each())
            text = json.dumps(plain(list(one_of_each().values())), ensure_ascii=False, allow_nan=False)
            text = json.dumps(dict(zip(one_of_each(), json.loads(text), strict=True)), ensure_ascii=False)
            held.with_suffix(".json").write_text(text + "\n", encoding="utf-8")
        listed = now
    assert listed == now, "see the first lines of this file"


def test_one_of_each_comes_back(tmp_path: Path) -> None:
    store.save(tmp_path / "all.h5", one_of_each())
    held = store.load(tmp_path / "all.h5")
    for name, expected in one_of_each().items():
        assert plain(held[name]) == plain(expected), name


# an invented rename ------------------------------------------------------------------------------------------------------

INVENTED = (
    Migration(version=2, classes={"Channel": "Line"}, fields={"Line": {"serial": "number", "joint": None}}),
    Migration(
        version=3,
        classes={"Line": "Sensor"},
        fields={"Recording": {"signals": "samples"}, "Sensor": {"number": "serial_number"}},
        values={("Sensor", "role"): {"reference": "force"}},
    ),
)
BACK = Migration(
    version=9,
    classes={"Sensor": "Channel"},
    fields={"Channel": {"serial_number": "serial"}, "Recording": {"samples": "signals"}},
    values={("Channel", "role"): {"force": "reference"}},
)
"""Back to the classes that there are, so that the reader has something to build."""


def record() -> Recording:
    channels = (Channel("hammer", serial="123", role="reference", joint="J1"),)
    return Recording(np.arange(40.0).reshape(1, 40), 100.0, channels, name="take")


def test_an_invented_rename_is_read_at_every_step(monkeypatch: pytest.MonkeyPatch) -> None:
    former = {"$noun": "Recording", "signals": {"$array": "signals"}, "channels": [{"$noun": "Channel", "serial": "1"}]}
    second = migrated(former, 1, INVENTED[:1])
    assert second["channels"] == [{"$noun": "Line", "number": "1"}] and second["signals"] == {"$array": "signals"}
    third = {
        "$noun": "Recording",
        "samples": {"$array": "signals"},
        "channels": [{"$noun": "Sensor", "serial_number": "1"}],
    }
    assert migrated(former, 1, INVENTED) == migrated(second, 2, INVENTED) == migrated(third, 3, INVENTED) == third
    assert migrated({"$noun": "Channel", "role": "reference"}, 1, INVENTED) == {"$noun": "Sensor", "role": "force"}


def test_files_with_renamed_classes_and_fields_are_read_described_and_read_in_blocks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An old file is read with every rename since; without the migrations it is refused, as it should be."""
    path = tmp_path / "a.h5"
    store.save(path, record())
    monkeypatch.setattr(migrations, "MIGRATIONS", INVENTED)
    with pytest.raises(InputError, match=r"unknown container; got Sensor|Recording holds fields"):
        store.load(path)
    monkeypatch.setattr(migrations, "MIGRATIONS", (*INVENTED, BACK))
    present = store.load(path)
    assert present.channels == (Channel("hammer", serial="123", role="reference"),)  # the joint was dropped
    np.testing.assert_array_equal(present.signals, record().signals)
    assert [block.signals.shape[1] for block in store.blocks(path, 30)] == [30, 10]
    assert store.describe(path)[0].samples == 40


def test_a_file_of_the_present_version_is_not_migrated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store.save(tmp_path / "a.h5", record())
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        file.attrs["schema_version"] = 3
    monkeypatch.setattr(migrations, "MIGRATIONS", (dataclasses.replace(BACK, version=3, values={}),))
    monkeypatch.setattr(layout, "SCHEMA_VERSION", 3)
    monkeypatch.setattr("ema.store.reading.SCHEMA_VERSION", 3)
    assert store.load(tmp_path / "a.h5").channels[0].joint == "J1"


# what a study keeps -------------------------------------------------------------------------------------------------------


def test_a_kept_run_of_the_first_version_is_taken() -> None:
    """A study resumes from it where inputs, settings, code and packages are those written in the file."""
    path = GOLDEN / "kept_run_v1.h5"
    sentences: list[str] = []

    class Listener:
        def __call__(self, what: str, done: int, total: int) -> None: ...

        def note(self, sentence: str) -> None:
            sentences.append(sentence)

    made = store.load(path)["made"]
    result = kept.known(path, made, "run bare", Listener())
    assert sentences == ["run bare: taken as it was computed"]
    np.testing.assert_allclose(result.modes.natural_frequencies, [60.0, 105.0, 170.0], atol=0.05)
    sentences.clear()
    other = dataclasses.replace(made, versions=(*made.versions, ("another package", "1")))
    assert kept.known(path, other, "run bare", Listener()) is None
    assert sentences == ["run bare: computed again: another package was not noted and is 1"]


def test_a_study_with_its_placement_of_the_first_version_is_read() -> None:
    result = store.load(GOLDEN / "containers_v1.h5")["StudyResult"]
    assert isinstance(result, StudyResult) and isinstance(result.campaign, Campaign)
    assert result.placement is not None and result.placement.forecast is not None
    assert result.placement.ranking.best.beam and result.placement.control is not None
    assert isinstance(result.runs[0].hits.hits[0], Hit)
