"""Moving shapes: where the points are at every phase, read back by other programs."""

import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ema import examples, shapes, show
from ema.data import Geometry, ModalModel
from ema.errors import FailureError, InputError
from ema.show.renderer import renderer_works
from tests.architecture.test_without_vtk import without_vtk

FACES = tuple((5 * i + j, 5 * i + j + 1, 5 * i + j + 6, 5 * i + j + 5) for i in range(6) for j in range(1, 5))


def plate() -> tuple[ModalModel, Geometry]:
    model, points = examples.plate()
    return model, replace(points, faces=FACES)


def expected(model: ModalModel, points: Geometry, mode: int, phase: float, amplitude: float) -> np.ndarray:
    """Re(u exp(j phase)) for shapes along Z at all nodes, written out without the code that is tested."""
    u = model.shapes[:, mode]
    u = u * np.exp(-0.5j * np.angle(np.sum(u**2)))
    places = points.xyz.copy()
    diagonal = np.hypot(0.6, 0.4)
    places[:, 2] += amplitude * diagonal * np.real(u / np.abs(u).max() * np.exp(1j * phase))
    return places


READER = """
import sys
import numpy as np
from vtkmodules.vtkIOGeometry import vtkGLTFReader
from vtkmodules.util.numpy_support import vtk_to_numpy
reader = vtkGLTFReader()
reader.SetFileName(sys.argv[1])
reader.UpdateInformation()
reader.ApplyDeformationsToGeometryOn()
reader.EnableAnimation(0)
reader.SetFrameRate(60)
reader.UpdateInformation()
reader.UpdateTimeStep(float(sys.argv[2]))
block = reader.GetOutput()
while not block.IsA("vtkPolyData"):
    block = block.GetBlock(0)
np.save(sys.argv[3], vtk_to_numpy(block.GetPoints().GetData()))
"""


@pytest.mark.parametrize("phase", [0.0, 0.25, 0.5, 0.625])
@pytest.mark.parametrize("turn", [1.0, 1 + 0.0j])
def test_a_viewer_of_gltf_sees_the_points_where_they_belong(phase: float, turn: complex, tmp_path: Path) -> None:
    """Read back by the glTF reader of VTK, at a fraction of the period; complex shapes pass rest one by one."""
    pytest.importorskip("vtkmodules")
    model, points = plate()
    if isinstance(turn, complex):
        late = np.exp(1j * np.linspace(0, 1, len(model.dofs)))[:, None]
        model = replace(model, shapes=model.shapes * late)
    path = show.animate(model, 1, tmp_path / "mode.glb", geometry=points, frames=48)
    done = subprocess.run(
        [sys.executable, "-c", READER, str(path), str(1.6 * phase), str(tmp_path / "points.npy")],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    seen = np.load(tmp_path / "points.npy")
    # glTF has Y up: the rotation of the root node is applied by the reader
    upright = np.column_stack([seen[:, 0], -seen[:, 2], seen[:, 1]])
    wanted = expected(model, points, 1, 2 * np.pi * phase, 0.1)
    assert np.max(np.abs(upright - wanted)) < 1e-5


def test_the_container_is_what_the_standard_says(tmp_path: Path) -> None:
    model, points = plate()
    data = show.animate(model, 0, tmp_path / "mode.glb", geometry=points).read_bytes()
    assert data[:4] == b"glTF" and int.from_bytes(data[4:8], "little") == 2
    assert int.from_bytes(data[8:12], "little") == len(data) and len(data) % 4 == 0
    length = int.from_bytes(data[12:16], "little")
    document = json.loads(data[20 : 20 + length])
    rest = len(data) - 28 - length
    assert data[20 + length + 4 : 20 + length + 8] == b"BIN\0" and document["buffers"][0]["byteLength"] <= rest
    triangles = document["accessors"][document["meshes"][0]["primitives"][0]["indices"]]["count"]
    assert triangles == 3 * 2 * len(FACES)


def test_the_second_shape_is_turned_to_the_sense_of_the_first(tmp_path: Path) -> None:
    model, points = plate()
    rows = list(range(0, 35, 4))
    test = replace(model, shapes=-model.shapes[rows], dofs=tuple(model.dofs[row] for row in rows), name="test")
    page = show.animate(test, 1, tmp_path / "two.html", geometry=points, beside=(model, points, 1)).read_text("utf-8")
    shown = [json.loads(text) for text in re.findall(r'<script type="application/json">(.*?)</script>', page, re.S)]
    titles = [content["modes"][0] for content in shown]
    assert titles[0].startswith("test, 2: 89") and "(26 of 35 nodes interpolated)" in titles[0]
    assert titles[1].startswith("plate, 2: 89")
    from base64 import b64decode

    first, second = (
        np.frombuffer(b64decode(content["shapes"][0]), "<i2")[: 3 * 35].reshape(35, 3) for content in shown
    )
    assert np.all(first[rows, 2].astype(float) * second[rows, 2] >= 0)
    assert "http" not in re.sub(r"http-equiv", "", page)  # nothing is fetched


@pytest.mark.skipif(not renderer_works(), reason="VTK cannot draw here")
def test_films_have_their_frames_and_move(tmp_path: Path) -> None:
    from PIL import Image

    model, points = plate()
    film = Image.open(show.animate(model, 0, tmp_path / "mode.gif", geometry=points, frames=8))
    assert film.n_frames == 8 and film.info["loop"] == 0 and abs(8 * film.info["duration"] - 1600) <= 80
    pictures = []
    for frame in range(8):
        film.seek(frame)
        pictures.append(np.asarray(film.convert("L"), float))
    opposite, near = np.abs(pictures[0] - pictures[4]).mean(), np.abs(pictures[0] - pictures[1]).mean()
    assert opposite > near > 0.1
    # cosine: frames k and 8 - k are the same picture
    assert np.abs(pictures[1] - pictures[7]).mean() < 0.05 * opposite
    if shutil.which("ffprobe") is None:
        pytest.skip("no ffprobe")
    path = show.animate(model, 0, tmp_path / "mode.mp4", geometry=points, frames=8)
    entries = "stream=codec_name,width,height,nb_frames,pix_fmt"
    told = subprocess.run(
        ["ffprobe", "-v", "error", "-show_entries", entries, "-of", "json", str(path)], capture_output=True, text=True
    )
    stream = json.loads(told.stdout)["streams"][0]
    assert stream == {"codec_name": "h264", "width": 640, "height": 480, "pix_fmt": "yuv420p", "nb_frames": "24"}


def test_what_is_wrong_is_one_sentence_and_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model, points = plate()
    with pytest.raises(InputError, match=r"got '.avi', expected .gif, .mp4, .glb, .html"):
        show.animate(model, 0, tmp_path / "mode.avi", geometry=points)
    with pytest.raises(InputError, match="no such mode; got 3, expected a position of 0 to 2"):
        show.animate(model, 3, tmp_path / "mode.glb", geometry=points)
    elsewhere = replace(points, nodes=points.nodes + 1000, faces=())
    with pytest.raises(
        InputError, match=r"at a node of the geometry; got 1:\+Z, 2:\+Z, 3:\+Z \.\.\., expected nodes such as 1001"
    ):
        show.animate(model, 0, tmp_path / "mode.html", geometry=elsewhere)
    monkeypatch.setenv("PATH", "")
    with pytest.raises(FailureError, match="MP4 need the program ffmpeg"):
        show.animate(model, 0, tmp_path / "mode.mp4", geometry=points)
    with pytest.raises(FailureError, match="no such folder"):
        show.animate(model, 0, tmp_path / "absent" / "mode.glb", geometry=points)
    assert not list(tmp_path.iterdir())


def test_without_vtk_pages_and_models_are_written_and_films_say_what_is_missing(tmp_path: Path) -> None:
    code = """
from ema.errors import MissingExtraError
from ema.examples import geometry, modal_model
from ema.show import animate
for ending in ("html", "glb", "gif"):
    try:
        print(animate(modal_model(), 0, f"mode.{ending}", geometry=geometry()))
    except MissingExtraError as error:
        print(error)
"""
    done = without_vtk(code, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[:2] == ["mode.html", "mode.glb"] and len(lines) == 3
    assert (
        "need the package pyvista" in lines[2] and "or ema.show.animate to .html or .glb, which need no VTK" in lines[2]
    )


def test_shapes_are_expanded_by_the_modes_of_a_model() -> None:
    """A measured combination of two modes of the model is continued as that combination, whatever the senses of DOFs."""
    model, _ = plate()
    rows = [0, 3, 4, 17, 30, 34]
    mixed = model.shapes[:, :2] @ np.array([[1.0, 0.2], [-0.3, 1.0]])
    dofs = tuple(model.dofs[row].reversed() if row % 2 else model.dofs[row] for row in rows)
    signs = np.array([-1.0 if row % 2 else 1.0 for row in rows])[:, None]
    part = {"poles": model.poles[:2], "participation": model.participation[:, :2]}
    test = replace(model, shapes=signs * mixed[rows], dofs=dofs, **part)
    full = shapes.expand_by_modes(test, model)
    assert full.dofs == model.dofs and np.allclose(full.shapes, mixed)
    with pytest.raises(InputError, match="2 shared DOFs, 3 modes"):
        shapes.expand_by_modes(replace(test, shapes=test.shapes[:2], dofs=dofs[:2]), model)
    twins = replace(model, shapes=model.shapes[:, [0, 1, 1]])
    with pytest.raises(InputError, match="look alike at the measured DOFs"):
        shapes.expand_by_modes(test, twins)
