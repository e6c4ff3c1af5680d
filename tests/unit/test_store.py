"""Nouns to a file and back; old files, foreign files, damaged files."""

import dataclasses
import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ema import data, store
from ema.cli.browsing import maps_of
from ema.data import (
    Campaign,
    Channel,
    Condition,
    Excitation,
    Expectation,
    Finding,
    FrfSet,
    Geometry,
    Hit,
    HitGallery,
    JointForce,
    Lazy,
    ModalMap,
    ModalModel,
    ModeQuality,
    PoleTable,
    Provenance,
    Recording,
    Repair,
    Residuals,
    Run,
    RunResult,
    StudyResult,
)
from ema.dof import Dof
from ema.errors import FailureError, InputError
from ema.examples import modal_map
from ema.store.document import CONTAINERS
from ema.store.reading import containers

GOLDEN = Path(__file__).parent / "golden" / "store_v1.h5"
MOMENT = datetime(2026, 11, 21, 10, 15, 0, 250000, tzinfo=UTC)


def recording(samples: int = 300, name: str = "take ö") -> Recording:
    rng = np.random.default_rng(1)
    channels = (
        Channel("hammer", Dof(12, "-Z"), "force", "reference", "N", 0.00225, "123", "2026-01-10", 5000.0),
        Channel("acc 1", Dof(4, "+RX", "table"), "acceleration", "response", "m/s^2"),
        Channel("ring", None, "force", "normal force", "N", joint="J1"),
    )
    return Recording(
        rng.standard_normal((3, samples)),
        8192.0,
        channels,
        MOMENT,
        np.array([False, True, False]),
        name,
        "A",
        ((2, "double hit"),),
    )


def joint() -> JointForce:
    return JointForce("J1", 1020.0, 30.0, -4.5, np.arange(5.0), np.linspace(0, 2, 5), "cell 7", 12.0, "up", 20)


def frf_set() -> FrfSet:
    rng = np.random.default_rng(2)
    shape = (50, 2, 3)
    return FrfSet(
        np.arange(50.0),
        rng.standard_normal(shape) + 1j * rng.standard_normal(shape),
        (Dof(1, "+Z"), Dof(2, "-X")),
        (Dof(3), Dof(4, "+Y"), Dof(5, "+Z")),
        "accelerance",
        "(m/s^2)/N",
        rng.random(shape),
        rng.random(shape),
        "H1",
        np.full((2, 3), 5.0),
        3.5,
        Condition(Excitation("hammer", 250.0, 10.0, (0.0, 1500.0)), (joint(),), 294.15),
        provenance(),
        (Finding("warning", "low-coherence", "run a", "Low.", 0.4, 0.8, "Hit again."),),
        "a",
    )


def provenance() -> Provenance:
    return Provenance((("a.h5", "00ff"),), (("numpy", "2"),), (("window", "exponential"),), ("hammer",), MOMENT)


def modal_model() -> ModalModel:
    rng = np.random.default_rng(3)
    residuals = Residuals(
        np.ones((3, 1), complex), 2j * np.ones((3, 1), complex), np.array([-1 + 900j]), np.ones((1, 3, 1), complex)
    )
    return ModalModel(
        np.array([-1 + 100j, -2 + 300j]),
        rng.standard_normal((3, 2)) * (1 + 0.1j),
        (Dof(1, "+Z"), Dof(2, "+Z"), Dof(3, "+Z")),
        np.ones((1, 2), complex),
        (Dof(1, "+Z"),),
        residuals,
        "unit modal mass",
        np.zeros((2, 2, 2)),
        np.array([1.0, 0.9]),
        Condition(),
        provenance(),
        (),
        "modes",
    )


def everything() -> dict[str, object]:
    """One of each noun, every field away from its default where that is possible."""
    frfs, modes = frf_set(), modal_model()
    poles = PoleTable(
        np.array([2, 4, 4]),
        np.array([-1 + 100j, -1 + 100j, -2 + 300j]),
        np.array(["o", "s", "d"]),
        np.ones((3, 1), complex),
        (Dof(1, "+Z"),),
        (10.0, 500.0),
        (0.01, 0.05, 0.02),
        np.array([np.nan, 1j, -2 + 300j]),
    )
    hit = Hit("take 1", 0, Dof(12, "-Z"), 0.1, 250.0, 0.06, 5e-4, False, "double hit", np.hanning(9), 8192.0)
    gallery = HitGallery((hit,), np.arange(4.0), np.ones(4), (900.0, 1400.0))
    geometry = Geometry(
        np.array([1, 2, 7]), np.eye(3), ((1, 2), (2, 7)), ((1, 2, 7),), np.tile(np.eye(3), (3, 1, 1)), "table"
    )
    run = Run(
        "beam_1kN",
        frfs.condition,
        (recording(), recording(40)),
        (frfs,),
        (Repair("reverse sign", "acc 2", "me", "why"),),
        frfs.findings,
        "comment",
        "1kN",
    )
    campaign = Campaign(
        "table",
        (run,),
        geometry,
        "structure",
        "operator",
        "2026-11-21",
        "comment",
        ("a.jpg",),
        recording().channels,
        (("campaign.toml", "00ff"),),
        frfs.findings,
        "folder",
    )
    quality = ModeQuality(np.array([0.9, 1.0]), np.array([1.0, 2.0]), np.array([3.0, 4.0]))
    result = RunResult(run, frfs, poles, modes, quality, frfs, np.ones((2, 3)), np.eye(2), gallery, frfs.findings)
    chart = ModalMap(
        np.array([1.0, 2.0]),
        np.array([0.0, 95.0]),
        np.array([[1.0, np.nan], [2.0, 3.0]]),
        np.ones((2, 2)),
        joint_forces=np.ones((2, 2, 1)),
        joints=("J1",),
        method="frozen",
        name="Fig. 8",
        provenance=provenance(),
    )
    study = StudyResult(
        campaign,
        (result,),
        run.repairs,
        frfs.findings,
        (Expectation("f1", 500.0, 0.5, float("nan"), False),),
        provenance(),
        "title",
    )
    nouns: list[object] = [recording(), frfs, modes, poles, gallery, hit, geometry, campaign, run, chart, result, study]
    return {type(noun).__name__: noun for noun in nouns}


def assert_same(found: object, expected: object, path: str = "") -> None:
    """Deep equality of nouns, NaN equal to NaN, arrays equal in type and value."""
    if isinstance(expected, np.ndarray):
        assert isinstance(found, np.ndarray) and found.dtype == expected.dtype, path
        np.testing.assert_array_equal(found, expected, err_msg=path)
        assert not found.flags.writeable, path
    elif dataclasses.is_dataclass(expected):
        assert type(found) is type(expected), path
        for field in dataclasses.fields(expected):
            if field.init:
                assert_same(getattr(found, field.name), getattr(expected, field.name), f"{path}.{field.name}")
    elif isinstance(expected, tuple | list | Lazy):
        assert len(found) == len(expected), path  # type: ignore[arg-type]
        for place, (one, other) in enumerate(zip(found, expected, strict=True)):  # type: ignore[call-overload]
            assert_same(one, other, f"{path}[{place}]")
    elif isinstance(expected, float) and np.isnan(expected):
        assert isinstance(found, float) and np.isnan(found), path
    else:
        assert found == expected and type(found) is type(expected), path


def test_every_noun_is_registered() -> None:
    nouns = {name for name in data.__all__ if isinstance(getattr(data, name), type)}
    nouns = {name for name in nouns if dataclasses.is_dataclass(getattr(data, name))}
    assert nouns <= set(CONTAINERS)


@pytest.mark.parametrize("name", sorted(everything()))
def test_a_noun_comes_back_as_it_was(tmp_path: Path, name: str) -> None:
    path = tmp_path / "with blanks and ümlauts.h5"
    store.save(path, everything()[name])
    assert_same(store.load(path), everything()[name])


def test_a_mapping_comes_back_in_its_order(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    store.save(path, everything())
    found = store.load(path)
    assert list(found) == list(everything())
    assert_same(tuple(found.values()), tuple(everything().values()))


def test_a_sequence_comes_back_lazy(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    store.save(path, [recording(10, "a"), recording(20, "b")])
    found = store.load(path)
    assert isinstance(found, Lazy) and [each.name for each in found] == ["a", "b"]


@settings(deadline=None, max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(arrays(np.float64, st.tuples(st.just(1), st.integers(0, 40))), st.floats(1e-3, 1e9), st.text(max_size=20))
def test_any_numbers_and_names_come_back(tmp_path: Path, signals: np.ndarray, rate: float, name: str) -> None:
    try:
        name.encode("utf-8")
    except UnicodeEncodeError:
        return
    original = Recording(signals, rate, (Channel(name),), name=name)
    store.save(tmp_path / "a.h5", {name: original})
    assert_same(store.load(tmp_path / "a.h5")[name], original)


def test_single_precision_stays_single(tmp_path: Path) -> None:
    original = dataclasses.replace(recording(), signals=recording().signals.astype(np.float32))
    store.save(tmp_path / "a.h5", original)
    assert store.load(tmp_path / "a.h5").signals.dtype == np.float32


@pytest.mark.parametrize("compression", ["", "gzip"])
def test_large_arrays_are_compressed_on_request_and_carry_their_unit(tmp_path: Path, compression: str) -> None:
    """Noise does not shrink: packing by default costs the time of twenty plain writes and saves a tenth of the bytes."""
    original = {"x": frf_set(), "r": recording(5000)}
    store.save(tmp_path / "a.h5", original, compression=compression)
    assert_same(tuple(store.load(tmp_path / "a.h5").values()), tuple(original.values()))
    with h5py.File(tmp_path / "a.h5") as file:
        values, signals = file["items/0/values"], file["items/1/signals"]
        for dataset in (values, signals):
            found = (dataset.compression, dataset.compression_opts, dataset.shuffle, dataset.fletcher32)
            assert found == (("gzip", 1, True, True) if compression else (None, None, False, False))
        assert values.attrs["unit"] == "(m/s^2)/N" and values.attrs["quantity"] == "accelerance"
        assert file["items/0/frequencies"].attrs["unit"] == "Hz"
        assert list(signals.attrs["unit"]) == ["N", "m/s^2", "N"]
        assert file.attrs["schema_version"] == 1


def test_records_in_blocks_equal_the_whole(tmp_path: Path) -> None:
    whole = recording(200_000)
    header = dataclasses.replace(whole, signals=whole.signals[:, :0])
    with store.Writer(tmp_path / "a.h5") as writer:
        long = writer.begin(header, "long")
        for start in range(0, 200_000, 70_001):
            long.append(np.asarray(whole.signals[:, start : start + 70_001]))
        writer.add(recording(10), "short")
    assert_same(store.load(tmp_path / "a.h5")["long"], whole)
    parts = list(store.blocks(tmp_path / "a.h5", 65_536, "long"))
    np.testing.assert_array_equal(np.concatenate([part.signals for part in parts], axis=1), whole.signals)
    assert parts[1].start == MOMENT + timedelta(seconds=8)


def test_a_block_with_other_channels_is_refused(tmp_path: Path) -> None:
    header = recording(0)
    with pytest.raises(InputError, match="another number of channels"), store.Writer(tmp_path / "a.h5") as writer:
        writer.begin(header).append(np.zeros((2, 5)))
    assert list(tmp_path.iterdir()) == []


def test_describing_reads_no_signals(tmp_path: Path) -> None:
    store.save(tmp_path / "a.h5", {"r": recording(5000), "f": frf_set()})
    with h5py.File(tmp_path / "a.h5", "r+") as file:  # a signal that cannot be read does not matter here
        offset = file["items/0/signals"].id.get_chunk_info(0).byte_offset
    with (tmp_path / "a.h5").open("r+b") as raw:
        raw.seek(offset)
        raw.write(b"\xff" * 64)
    headers = store.describe(tmp_path / "a.h5")
    assert [(header.name, header.noun, header.samples) for header in headers] == [
        ("r", "Recording", 5000),
        ("f", "FrfSet", 0),
    ]
    assert headers[0].record is not None and headers[0].record.channels == recording().channels
    with pytest.raises(InputError, match="damaged"):
        store.load(tmp_path / "a.h5")["r"]


def test_every_array_is_summed_and_a_changed_one_is_refused(tmp_path: Path) -> None:
    """The checksum is that of zlib over the bytes as h5py reads them."""
    import zlib

    path = tmp_path / "a.h5"
    store.save(path, {"x": frf_set(), "r": recording(5000)})
    with h5py.File(path) as file:
        for place in (0, 1):
            tree = json.loads(bytes(file[f"items/{place}/document"][0]))
            nodes = [node for node in tree.values() if isinstance(node, dict) and "$array" in node]
            assert nodes
            for node in nodes:
                assert zlib.crc32(file[f"items/{place}/{node['$array']}"][()].tobytes()) == node["crc32"]
    for name, part in (("x", "items/0/values"), ("x", "items/0/frequencies"), ("r", "items/1/signals")):
        store.save(path, {"x": frf_set(), "r": recording(5000)})
        with h5py.File(path, "r+") as file:
            whole = file[part][()]
            whole.flat[-1] = np.nextafter(whole.flat[-1].real, np.inf)
            file[part][...] = whole
        with pytest.raises(InputError, match="does not match its checksum"):
            store.load(path)[name]
        if name == "r":
            with pytest.raises(InputError, match="does not match its checksum"):
                list(store.blocks(path, 1000, "r"))
    with pytest.raises(InputError, match="unknown compression"):
        store.save(path, recording(), compression="blosc")


def test_a_run_loads_without_its_signals(tmp_path: Path) -> None:
    store.save(tmp_path / "a.h5", everything()["Campaign"])
    run = store.load(tmp_path / "a.h5")["beam_1kN"]
    assert isinstance(run.recordings, Lazy) and len(run.recordings) == 2
    assert_same(run.recordings[1], recording(40))


def test_a_file_that_changed_since_it_was_opened_is_noticed(tmp_path: Path) -> None:
    store.save(tmp_path / "a.h5", {"r": recording()})
    opened = store.load(tmp_path / "a.h5")
    store.save(tmp_path / "a.h5", {"r": recording(10)})
    with pytest.raises(InputError, match="changed since it was opened"):
        opened["r"]


def test_what_is_no_noun_is_refused_and_nothing_is_left(tmp_path: Path) -> None:
    store.save(tmp_path / "a.h5", recording())
    before = (tmp_path / "a.h5").read_bytes()
    for wrong in (object(), 3.0, {"a": {"b": recording()}}, {"a": Path("x")}):
        with pytest.raises(InputError, match="cannot be stored"):
            store.save(tmp_path / "a.h5", wrong)
    assert (tmp_path / "a.h5").read_bytes() == before and len(list(tmp_path.iterdir())) == 1


def test_two_nouns_of_one_name_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="one name"), store.Writer(tmp_path / "a.h5") as writer:
        writer.add(recording(), "a")
        writer.add(recording(), "a")


# what others may hand us -----------------------------------------------------------------------------------------------


def test_the_golden_file_of_version_1_is_read() -> None:
    found = store.load(GOLDEN)
    with h5py.File(GOLDEN) as file:
        assert file.attrs["schema_version"] == 1
    assert_same(tuple(found.values()), tuple(everything()[name] for name in found))
    assert list(found) == ["Recording", "StudyResult", "ModalMap"]  # the study holds one of every other noun


def test_a_newer_version_is_refused(tmp_path: Path) -> None:
    store.save(tmp_path / "a.h5", recording())
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        file.attrs["schema_version"] = 2
    with pytest.raises(InputError, match=r"newer friction-ema; got schema version 2, expected at most 1; update"):
        store.load(tmp_path / "a.h5")


def _rewrite(path: Path, change: dict[str, object]) -> None:
    with h5py.File(path, "r+") as file:
        tree = json.loads(bytes(file["items/0/document"][0])) | change
        text = json.dumps(tree).encode()
        del file["items/0/document"]
        file["items/0"].create_dataset("document", data=np.array([text]))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"$noun": "Popen"}, "unknown container; got Popen"),
        ({"colour": "red"}, "fields that this version does not know; got colour"),
        ({"start": {"$pickle": "x"}}, "does not know"),
        ({"sampling_rate": {"$noun": "Lazy"}}, "unknown container; got Lazy"),
        ({"start": {"$time": "yesterday"}}, "cannot be read"),
        ({"signals": {"$array": "../../contents"}}, "no such data"),
        ({"signals": {"$array": "nowhere"}}, "no such data"),
    ],
)
def test_a_tampered_document_is_refused(tmp_path: Path, change: dict[str, object], message: str) -> None:
    store.save(tmp_path / "a.h5", recording())
    _rewrite(tmp_path / "a.h5", change)
    with pytest.raises(InputError, match=message):
        store.load(tmp_path / "a.h5")


@pytest.mark.parametrize("kind", ["reference", "external link", "soft link", "external storage", "virtual", "compound"])
def test_what_reaches_outside_the_file_is_refused(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "a.h5"
    store.save(path, recording())
    other = tmp_path / "other.h5"
    with h5py.File(other, "w") as file:
        file["x"] = np.zeros((3, 5))
    with h5py.File(path, "r+") as file:
        group = file["items/0"]
        del group["signals"]
        match kind:
            case "reference":
                group.create_dataset("signals", data=np.array([group.ref], dtype=h5py.ref_dtype))
            case "external link":
                group["signals"] = h5py.ExternalLink(str(other), "x")
            case "soft link":
                group["signals"] = h5py.SoftLink("/contents")
            case "external storage":
                group.create_dataset("signals", (3, 5), "f8", external=[(str(other), 0, 120)])
            case "virtual":
                layout = h5py.VirtualLayout((3, 5), "f8")
                layout[:] = h5py.VirtualSource(str(other), "x", (3, 5))
                group.create_virtual_dataset("signals", layout)
            case "compound":
                group.create_dataset("signals", data=np.zeros(3, [("a", "f8")]))
    with pytest.raises(InputError, match=r"not followed|not read"):
        store.load(path)


def test_foreign_damaged_and_absent_files_get_one_sentence(tmp_path: Path) -> None:
    good = tmp_path / "good.h5"
    store.save(good, recording(20_000))
    whole = good.read_bytes()
    cases = {"empty.h5": (b"", "not an HDF5 file"), "text.h5": (b"hello " * 99, "not an HDF5 file")}
    cases |= {f"cut{part}.h5": (whole[: len(whole) * part // 100], "cut short|cannot be read") for part in (1, 50, 99)}
    for name, (content, message) in cases.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=message) as caught:
            store.load(tmp_path / name)
        assert name in str(caught.value) and len(str(caught.value).splitlines()) == 1
    with h5py.File(tmp_path / "foreign.h5", "w") as file:
        file["x"] = np.zeros(3)
    with pytest.raises(InputError, match="not one of ours"):
        store.load(tmp_path / "foreign.h5")
    with pytest.raises(InputError, match="no such file"):
        store.load(tmp_path / "absent.h5")
    with pytest.raises(InputError, match="a folder"):
        store.load(tmp_path)
    assert (
        not store.is_store(tmp_path / "text.h5") and not store.is_store(tmp_path / "absent.h5") and store.is_store(good)
    )


def test_no_damaged_byte_goes_unnoticed_as_wrong_numbers(tmp_path: Path) -> None:
    """Whatever byte flips, the file is refused or the nouns are what they were."""
    path = tmp_path / "a.h5"
    original = recording(4000)
    store.save(path, original)
    whole = bytearray(path.read_bytes())
    rng = np.random.default_rng(5)
    refused = 0
    for place in rng.integers(0, len(whole), 150):
        damaged = bytearray(whole)
        damaged[place] ^= 0x5A
        path.write_bytes(damaged)
        try:
            found = store.load(path)
        except InputError:
            refused += 1
            continue
        assert_same(found, original)
    assert refused > 75


def test_a_folder_that_is_absent_or_a_file_is_a_failure(tmp_path: Path) -> None:
    with pytest.raises(FailureError, match="no such folder") as caught:
        store.save(tmp_path / "absent" / "a.h5", recording())
    assert caught.value.exit_code == 3
    (tmp_path / "folder.h5").mkdir()
    with pytest.raises(FailureError, match="folder of this name"):
        store.save(tmp_path / "folder.h5", recording())


@pytest.mark.parametrize(
    "content",
    [modal_model(), [modal_model()] * 2, {"a": modal_model(), "b": modal_model()}],
    ids=["one", "list", "names"],
)
def test_all_containers_of_a_file_are_read(tmp_path: Path, content: object) -> None:
    store.save(tmp_path / "modes.h5", content)
    poles = [one.poles.tolist() for one in containers(tmp_path / "modes.h5")]
    assert poles == [modal_model().poles.tolist()] * (2 if isinstance(content, list | dict) else 1)


def test_maps_that_were_saved_as_a_list_are_maps_of_the_file(tmp_path: Path) -> None:
    store.save(tmp_path / "maps.h5", [modal_map(), modal_map()])
    assert [one.name for one in maps_of(tmp_path / "maps.h5")] == [modal_map().name] * 2
