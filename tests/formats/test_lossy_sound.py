"""Wave files whose samples are not kept as they were: named, and as many as the file announces."""

from pathlib import Path

import numpy as np
import pytest

import acquisition
from ema.errors import InputError

soundfile = pytest.importorskip("soundfile")
SIGNAL = 0.5 * np.sin(np.arange(5000) / 20)


@pytest.mark.parametrize("subtype", ["ULAW", "ALAW", "IMA_ADPCM", "MS_ADPCM", "PCM_16", "PCM_24", "FLOAT", "DOUBLE"])
@pytest.mark.parametrize("channels", [1, 2])
def test_a_coding_with_loss_is_named(tmp_path: Path, subtype: str, channels: int) -> None:
    soundfile.write(tmp_path / "a.wav", np.stack([SIGNAL] * channels, 1), 16000, subtype=subtype)
    contents = acquisition.read(tmp_path / "a.wav")
    lossy = subtype.endswith(("LAW", "ADPCM"))
    assert [note.code for note in contents.findings if note.code != "full-scale"] == ["lossy-coding"] * lossy
    # integers are fractions of full scale, floating-point numbers may be values: modal masses had been as certain
    (scale,) = [note for note in contents.findings if note.code == "full-scale"]
    assert scale.severity == ("info" if subtype in ("FLOAT", "DOUBLE") else "warning")
    found = contents.recordings[0].signals
    if subtype != "IMA_ADPCM":  # whose writer counts what fills up the last block
        assert found.shape == (channels, 5000)
    np.testing.assert_allclose(found[:, :5000], [SIGNAL] * channels, atol=0.12 if lossy else 1e-4)


def _with_fact(path: Path, count: int) -> None:
    data = bytearray(path.read_bytes())
    place = data.index(b"fact") + 8
    data[place : place + 4] = count.to_bytes(4, "little")
    path.write_bytes(data)


@pytest.mark.parametrize("subtype", ["ULAW", "MS_ADPCM", "FLOAT"])
@pytest.mark.parametrize("count", [400, 9000])
def test_another_number_of_samples_than_the_fact_chunk_announces(tmp_path: Path, subtype: str, count: int) -> None:
    soundfile.write(tmp_path / "a.wav", SIGNAL, 16000, subtype=subtype)
    _with_fact(tmp_path / "a.wav", count)
    with pytest.raises(InputError, match=r"than the fact chunk announces"):
        acquisition.read(tmp_path / "a.wav")
    contents = acquisition.read(tmp_path / "a.wav", salvage=True)
    assert "salvaged" in [note.code for note in contents.findings]
    assert contents.recordings[0].signals.shape[1] == min(count, 5060 if subtype == "MS_ADPCM" else 5000)


@pytest.mark.parametrize("count", [0, 0xFFFFFFFF, 10000])
def test_a_fact_chunk_that_knows_nothing_or_counts_all_channels(tmp_path: Path, count: int) -> None:
    soundfile.write(tmp_path / "a.wav", np.stack([SIGNAL, -SIGNAL], 1), 16000, subtype="FLOAT")
    _with_fact(tmp_path / "a.wav", count)
    assert acquisition.read(tmp_path / "a.wav").recordings[0].signals.shape == (2, 5000)


@pytest.mark.parametrize("lost", [0, 1, 4])
def test_a_file_whose_data_have_no_length_is_as_long_as_the_whole_announces(tmp_path: Path, lost: int) -> None:
    """A recorder that was cut off: an unknown length is odd, and a byte too few had passed for the one that fills up."""
    soundfile.write(tmp_path / "a.wav", np.stack([SIGNAL[:63]] * 2, 1), 100, subtype="PCM_16")
    data = bytearray((tmp_path / "a.wav").read_bytes())
    place = data.index(b"data") + 4
    data[place : place + 4] = b"\xff" * 4
    (tmp_path / "a.wav").write_bytes(data[: len(data) - lost])
    if not lost:
        contents = acquisition.read(tmp_path / "a.wav")
        assert "length-unstated" in [note.code for note in contents.findings]
        assert contents.recordings[0].signals.shape == (2, 63)
        return
    with pytest.raises(InputError, match="not as long as it announces"):
        acquisition.read(tmp_path / "a.wav")
    assert acquisition.read(tmp_path / "a.wav", salvage=True).recordings[0].signals.shape == (2, 62)
