"""Small sound files of every kind, made once."""

import json
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture(scope="session")
def containers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Bytes of a file of each format that holds two signals of 200 samples at 100 Hz."""
    import h5py
    import nptdms
    import openpyxl
    import scipy.io
    import soundfile

    folder: Path = tmp_path_factory.mktemp("containers")
    signals = 0.5 * np.random.default_rng(0).uniform(-1, 1, size=(2, 200))
    np.save(folder / "a.npy", signals)
    scipy.io.savemat(folder / "a.mat", {"data": signals, "text": "words"})
    with h5py.File(folder / "a.h5", "w") as file:
        file["data"] = signals
    (folder / "a.json").write_text(json.dumps({"data": signals.tolist(), "unit": "N"}))
    book = openpyxl.Workbook()
    book.active.append(["t [s]", "a [N]", "b [g]"])
    for place in range(200):
        book.active.append([0.01 * place, *signals[:, place].tolist()])
    book.save(folder / "a.xlsx")
    soundfile.write(folder / "a.wav", signals.T, 100, subtype="PCM_24")
    with nptdms.TdmsWriter(folder / "a.tdms") as writer:
        properties = {"wf_increment": 0.01, "unit_string": "kN"}
        writer.write_segment([nptdms.ChannelObject("g", f"c{k}", row, properties) for k, row in enumerate(signals)])
    return {path.suffix[1:]: path.read_bytes() for path in sorted(folder.iterdir())}
