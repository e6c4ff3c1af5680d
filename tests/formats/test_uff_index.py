"""A universal file is listed without reading the values of its functions."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import acquisition
from acquisition.files import uff
from acquisition.files.uff.index import index
from tests.formats import nouns


class Counting(io.BytesIO):
    """A file that counts the bytes read from it."""

    def __init__(self, data: bytes) -> None:
        super().__init__(data)
        self.count = 0

    def read(self, size: int | None = -1, /) -> bytes:
        data = super().read(size)
        self.count += len(data)
        return data


def _file(path: Path, lines: int, binary: bool) -> bytes:
    frfs = replace(nouns.frf_set(lines), coherence=None)
    acquisition.write(path, frfs, binary=binary)
    return path.read_bytes()


@pytest.mark.parametrize("line_end", [b"\n", b"\r\n"], ids=["LF", "CRLF"])
@pytest.mark.parametrize("lines", [6401, 6402, 6403])
def test_text_is_skipped_by_its_length(tmp_path: Path, lines: int, line_end: bytes) -> None:
    data = _file(tmp_path / "a.uff", lines, False).replace(b"\n", line_end)
    file = Counting(data)
    entries = index(file)
    assert [entry.type for entry in entries] == [151, 164] + [58] * 6
    assert all(not entry.problem for entry in entries)
    assert file.count < 0.02 * len(data)
    (tmp_path / "b.uff").write_bytes(data)
    ours = uff.functions(tmp_path / "b.uff")
    np.testing.assert_allclose(ours[0].y, nouns.frf_set(lines).values[:, 0, 0], rtol=1e-12)


@pytest.mark.parametrize("gap", [b"", b"\n", b"\r\n"], ids=["touching", "LF", "CRLF"])
def test_binary_values_are_skipped(tmp_path: Path, gap: bytes) -> None:
    data = _file(tmp_path / "a.uff", 12801, True)
    if gap:  # some systems put a line end behind the values
        entries = index(io.BytesIO(data))
        for entry in reversed([entry for entry in entries if entry.type == 58]):
            data = data[: entry.end] + gap + data[entry.end :]
    file = Counting(data)
    entries = index(file)
    assert [entry.type for entry in entries] == [151, 164] + [58] * 6
    assert all(not entry.problem for entry in entries)
    assert file.count < 0.02 * len(data)
    (tmp_path / "b.uff").write_bytes(data)
    (frfs,) = acquisition.read(tmp_path / "b.uff").frfs
    np.testing.assert_array_equal(frfs.values, nouns.frf_set(12801).values)


def test_values_that_look_like_a_delimiter_do_not_confuse(tmp_path: Path) -> None:
    frfs = nouns.frf_set(6401)
    values = frfs.values.copy()
    trap = np.frombuffer(b"    -1\n    -1\n    58\n   -1\n     ", dtype=np.complex128)
    values[100:102, 0, 0] = trap
    assert np.isfinite(values).all()
    acquisition.write(tmp_path / "a.uff", replace(frfs, values=values), binary=True)
    (read,) = acquisition.read(tmp_path / "a.uff").frfs
    np.testing.assert_array_equal(read.values, values)


def test_headers_say_what_the_sets_are(tmp_path: Path) -> None:
    acquisition.write(tmp_path / "a.uff", nouns.frf_set(), binary=True)
    headers = [entry.header for entry in uff.list_sets(tmp_path / "a.uff") if entry.type == 58]
    assert [header.function for header in headers if header] == [4, 6] * 6
    assert headers[0] is not None
    assert (headers[0].response.node, headers[0].reference.node, headers[0].points) == (1, 7, 101)


def test_some_sets_only(tmp_path: Path) -> None:
    acquisition.write(tmp_path / "a.uff", nouns.frf_set())
    numbers = [
        entry.number for entry in uff.list_sets(tmp_path / "a.uff") if entry.header and entry.header.function == 4
    ]
    (read,) = acquisition.read(tmp_path / "a.uff", sets=[numbers[0]]).frfs
    assert read.values.shape == (101, 1, 1)
    np.testing.assert_allclose(read.values[:, 0, 0], nouns.frf_set().values[:, 0, 0], rtol=1e-12)
