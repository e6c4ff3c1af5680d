"""Universal files that lost, doubled or moved bytes or lines: what is damaged is named, and every other channel is exact.

The truth is known from how the file was written here, by plain formatting, not by the reader.
"""

from pathlib import Path

import numpy as np
import pytest

import acquisition
from acquisition.contents import Contents
from ema.errors import InputError

POINTS = 100  # 6 to a line: 16 full lines and one of 4


def time_record(node: int, values: np.ndarray, binary: bool = False, points: int | None = None) -> bytes:
    """Data set 58 with a real even time record in single precision."""
    announced = len(values) if points is None else points
    first = f"{58:6d}b{1:6d}{2:6d}{11:12d}{4 * announced:12d}{0:6d}{0:6d}{0:12d}{0:12d}" if binary else f"{58:6d}"
    lines = [
        "    -1",
        first,
        f"channel {node}",
        "NONE",
        "NONE",
        "NONE",
        "NONE",
        f"{1:5d}{0:10d}{0:5d}{0:10d} {'NONE':<10}{node:10d}{3:4d} {'NONE':<10}{0:10d}{0:4d}",
        f"{2:10d}{announced:10d}{1:10d}{0.0:13.5e}{1e-3:13.5e}{0.0:13.5e}",
        f"{17:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {'s':<20}",
        f"{12:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {'m/s^2':<20}",
        f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {'NONE':<20}",
        f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {'NONE':<20}",
    ]
    head = "".join(line + "\n" for line in lines).encode()
    if binary:
        return head + values.astype("<f4").tobytes() + b"    -1\n"
    texts = [f"{value:13.5e}" for value in values]
    rows = ["".join(texts[start : start + 6]) for start in range(0, len(texts), 6)]
    return head + "".join(row + "\n" for row in rows).encode() + b"    -1\n"


def signals(seed: int) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    return [np.array([float(f"{v:.5e}") for v in rng.standard_normal(POINTS)]) for _ in range(3)]


def write(path: Path, truth: list[np.ndarray], binary: bool = False) -> list[bytes]:
    """The three data sets of the file; the caller damages the second and joins them."""
    return [time_record(node + 1, values, binary) for node, values in enumerate(truth)]


def others_are_exact_and_damage_is_named(contents: Contents, truth: list[np.ndarray], single: bool = False) -> None:
    found = {
        c.dof.node: row for r in contents.recordings for c, row in zip(r.channels, r.signals, strict=True) if c.dof
    }
    for node in (1, 3):
        np.testing.assert_array_equal(found[node], truth[node - 1].astype(np.float32) if single else truth[node - 1])
    assert any(f.code == "damaged-set" and f.severity == "error" for f in contents.findings), contents.findings
    if 2 in found:
        assert len(found[2]) < POINTS


def lines_of(part: bytes) -> list[bytes]:
    return part.splitlines(keepends=True)


@pytest.mark.parametrize(
    "damage",
    [
        "last line lost",
        "line lost",
        "line doubled",
        "blank line",
        "blank before the last",
        "end lost",
        "cut line",
        "character lost",
        "lines swapped in length",
    ],
)
def test_text(tmp_path: Path, damage: str) -> None:
    truth = signals(1)
    sets = write(tmp_path, truth)
    lines = lines_of(sets[1])
    first, last = 13, len(lines) - 2
    match damage:
        case "last line lost":
            del lines[last]
        case "line lost":
            del lines[first + 4]
        case "line doubled":
            lines.insert(first + 4, lines[first + 4])
        case "blank line":
            lines.insert(first + 4, b"\n")
        case "blank before the last":
            lines.insert(last, b"\n")
        case "end lost":
            del lines[-1]
        case "cut line":
            lines[first + 4] = lines[first + 4][:39] + b"\n"
        case "character lost":
            lines[first + 4] = lines[first + 4][:20] + lines[first + 4][21:]
        case "lines swapped in length":
            lines[first + 4], lines[last] = lines[last], lines[first + 4]
    (tmp_path / "a.uff").write_bytes(sets[0] + b"".join(lines) + sets[2])
    contents = acquisition.read(tmp_path / "a.uff")
    if damage == "end lost":
        # the end of the damaged set is then the beginning of the next one, which is named as well
        assert [f.code for f in contents.findings if f.severity == "error"]
        (first_record, *_) = contents.recordings
        np.testing.assert_array_equal(first_record.signals[0], truth[0])
        return
    others_are_exact_and_damage_is_named(contents, truth)


@pytest.mark.parametrize("lost", [1, 3, 4, 40])
@pytest.mark.parametrize("where", ["begin", "middle", "end"])
def test_binary_with_bytes_lost(tmp_path: Path, lost: int, where: str) -> None:
    truth = signals(2)
    sets = write(tmp_path, truth, binary=True)
    head = len(sets[1]) - 4 * POINTS - 7
    place = {"begin": head, "middle": head + 4 * 50, "end": head + 4 * POINTS - lost}[where]
    damaged = sets[1][:place] + sets[1][place + lost :]
    (tmp_path / "a.uff").write_bytes(sets[0] + damaged + sets[2])
    contents = acquisition.read(tmp_path / "a.uff")
    others_are_exact_and_damage_is_named(contents, truth, single=True)
    assert all(channel.dof is None or channel.dof.node != 2 for r in contents.recordings for channel in r.channels)


@pytest.mark.parametrize("binary", [False, True])
def test_a_file_that_ends_inside_its_last_set(tmp_path: Path, binary: bool) -> None:
    truth = signals(3)
    sets = write(tmp_path, truth, binary)
    (tmp_path / "a.uff").write_bytes(sets[0] + sets[1] + sets[2][: -len(sets[2]) // 8])
    contents = acquisition.read(tmp_path / "a.uff")
    (damaged,) = [f for f in contents.findings if f.severity == "error"]
    assert "data set 3" in damaged.where and "of 100" in damaged.message
    whole = next(r for r in contents.recordings if r.signals.shape[1] == POINTS)
    expected = truth[:2] if not binary else [row.astype(np.float32) for row in truth[:2]]
    np.testing.assert_array_equal(whole.signals, expected)
    (cut,) = [r for r in contents.recordings if r.signals.shape[1] < POINTS]
    np.testing.assert_array_equal(cut.signals[0], truth[2][: cut.signals.shape[1]].astype(cut.signals.dtype))


def test_lines_outside_of_any_set_are_named(tmp_path: Path) -> None:
    truth = signals(4)
    sets = write(tmp_path, truth)
    (tmp_path / "a.uff").write_bytes(sets[0] + b"  1.0  2.0\n" + sets[1] + b"\n \n" + sets[2])
    contents = acquisition.read(tmp_path / "a.uff")
    np.testing.assert_array_equal(contents.recordings[0].signals, truth)
    (finding,) = contents.findings
    assert "1 line stands outside" in finding.message


@pytest.mark.parametrize("in_front", [b"", b"  1.00000e+00  2.00000e+00\n"], ids=["first", "second"])
def test_a_line_of_values_without_end_is_named_before_it_is_taken_apart(tmp_path: Path, in_front: bytes) -> None:
    truth = signals(6)
    sets = write(tmp_path, truth)
    lines = lines_of(sets[1])
    head = b"".join(lines[: -1 - -(-POINTS // 6)])
    (tmp_path / "a.uff").write_bytes(sets[0] + head + in_front + 20_000 * b"  1.00000e+00" + b"\n    -1\n" + sets[2])
    contents = acquisition.read(tmp_path / "a.uff")
    others_are_exact_and_damage_is_named(contents, truth)
    assert any("a line of more than 65536 characters" in finding.message for finding in contents.findings)


def test_zeros_that_fill_the_last_line_are_not_values(tmp_path: Path) -> None:
    truth = signals(5)
    sets = write(tmp_path, truth)
    lines = lines_of(sets[1])
    lines[-2] = lines[-2][:-1] + b"  0.00000e+00  0.00000e+00\n"
    (tmp_path / "a.uff").write_bytes(sets[0] + b"".join(lines) + sets[2])
    contents = acquisition.read(tmp_path / "a.uff")
    assert contents.findings == ()
    np.testing.assert_array_equal(contents.recordings[0].signals, truth)


def test_the_list_of_functions_refuses_damage(tmp_path: Path) -> None:
    from acquisition.files import uff

    sets = write(tmp_path, signals(6))
    lines = lines_of(sets[1])
    (tmp_path / "a.uff").write_bytes(sets[0] + b"".join(lines[:20] + lines[21:]) + sets[2])
    with pytest.raises(InputError, match="data set 2"):
        uff.functions(tmp_path / "a.uff")


@pytest.mark.parametrize("record", [6, 7])
def test_a_record_of_the_header_cut_short_anywhere(tmp_path: Path, record: int) -> None:
    """Of the DOFs, a node would become another one; of the axis, a step of 1.0E-03 would become 1."""
    truth = signals(11)
    parts = write(tmp_path, truth)
    lines = lines_of(parts[1])
    whole = lines[record + 1].rstrip()
    enough = {6: 51, 7: 56}[record]  # the reference and the value on the third axis do not belong to a time record
    for length in range(len(whole)):
        cut = [*lines[: record + 1], whole[:length] + b"\n", *lines[record + 2 :]]
        (tmp_path / "a.uff").write_bytes(parts[0] + b"".join(cut) + parts[2])
        contents = acquisition.read(tmp_path / "a.uff")
        count = sum(len(r.channels) for r in contents.recordings)
        assert count == 2 if length < enough else count in (2, 3)
        if count == 2:
            others_are_exact_and_damage_is_named(contents, truth)
        elif (record, length) < (6, 55):  # the direction alone is missing
            assert any(finding.severity != "info" for finding in contents.findings)
        else:
            found = [row for record in contents.recordings for row in record.signals]
            np.testing.assert_array_equal(found, truth)
