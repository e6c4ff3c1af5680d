"""Mode shapes that move, as a film, a three-dimensional model or a page."""

import shutil
import subprocess
from collections.abc import Iterable
from html import escape
from itertools import chain
from pathlib import Path

import numpy as np

from ema.data import Geometry, ModalModel
from ema.errors import FailureError, InputError
from ema.show.gltf import animated_gltf
from ema.show.moving import json_block, moving_scene, page_script, script_source
from ema.show.renderer import Scene, rendered_frames, scene
from ema.store.atomic import replacing, write_failure

PERIOD = 1.6
"""Time [s] of one oscillation, as in the pages that move: slow enough to follow one point with the eye."""
_WINDOW = (640, 480)
"""Width and height of a picture in pixels."""
_ROUNDS = 3
"""Oscillations in an MP4, whose players rarely repeat; a GIF holds one and repeats."""


def animate(
    model: ModalModel,
    mode: int,
    path: str | Path,
    *,
    geometry: Geometry,
    beside: tuple[ModalModel, Geometry, int] | None = None,
    amplitude: float = 0.1,
    frames: int = 24,
) -> Path:
    """Write a moving mode shape: ``.gif`` and ``.mp4`` drawn by VTK, ``.glb`` and ``.html`` without it.

    Nodes without a measurement follow their neighbours along lines and faces. Complex shapes keep their phases: points
    pass their places of rest one after the other.

    Parameters
    ----------
    model : ModalModel
        Modes.
    mode : int
        Position from 0.
    path : str or Path
        The file; its ending says what is written: a film that repeats (``.gif``), a film (``.mp4``, which needs the
        program ffmpeg), a model that moves in viewers of glTF 2.0 (``.glb``), or a page to turn and zoom (``.html``).
    geometry : Geometry
        Where the nodes are.
    beside : tuple of (ModalModel, Geometry, int), optional
        A second shape to stand beside the first, such as that of a finite element model: modes, points, position of the
        mode. Its sense is turned to that of the first where both share DOFs.
    amplitude : float, default 0.1
        Largest drawn displacement as a fraction of the size of the structure.
    frames : int, default 24
        Pictures, or key frames, of one oscillation.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        If the ending is another one, there is no such mode, no DOF of the modes is at a node of the geometry, or there
        are fewer than 4 frames.
    MissingExtraError
        If a film is asked for and pyvista is not installed.
    FailureError
        If VTK cannot draw here, ffmpeg is missing or fails, or the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from ema.examples import geometry, modal_model
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     animate(modal_model(), 1, f"{folder}/mode2.glb", geometry=geometry()).name
    'mode2.glb'
    """
    target = Path(path)
    writers = {".gif": _gif, ".mp4": _mp4, ".glb": _glb, ".html": _html}
    writer = writers.get(target.suffix.lower())
    if writer is None:
        raise InputError(
            "not an ending of a moving shape", where=str(target), got=repr(target.suffix), expected=", ".join(writers)
        )
    if frames < 4:
        raise InputError("too few frames to move", where=str(target), got=frames, expected="4 or more")
    scenes = [scene(model, geometry, mode, amplitude)]
    if beside is not None:
        second = scene(beside[0], beside[1], beside[2], amplitude)
        turned = _sense(model, mode, beside[0], beside[2])
        scenes.append(second._replace(motion=turned * second.motion))
        names = [name or word for name, word in ((model.name, "first"), (beside[0].name, "second"))]
        scenes = [each._replace(title=f"{name}, {each.title}") for each, name in zip(scenes, names, strict=True)]
    scenes = [each._replace(title=each.title + _followers(each)) for each in scenes]
    with replacing(target) as temporary:
        writer(temporary, scenes, frames)
    return target


def _followers(each: Scene) -> str:
    count = each.interpolated
    return f" ({count} of {len(each.geometry.nodes)} nodes interpolated)" if count else ""


def _sense(a: ModalModel, mode_a: int, b: ModalModel, mode_b: int) -> float:
    """-1 where the shapes point against each other over the DOFs that they share."""
    from ema.dof import match

    pairs = match(a.dofs, b.dofs)
    one, other = ([dof for dof, *_ in pairs], [dof for _, dof, _ in pairs])
    sign = np.array([sign for *_, sign in pairs])
    shapes = []
    for shape in (a.shapes[one, mode_a], sign * b.shapes[other, mode_b]):
        squares = np.sum(shape**2)
        shapes.append(np.real(shape * np.exp(-0.5j * np.angle(squares))) if squares else np.real(shape))
    return -1.0 if len(pairs) and float(shapes[0] @ shapes[1]) < 0 else 1.0


def _gif(path: Path, scenes: list[Scene], frames: int) -> None:
    from PIL import Image

    phases = 2 * np.pi * np.arange(frames) / frames
    pictures = [Image.fromarray(picture) for picture in rendered_frames(scenes, list(phases), _WINDOW)]
    # one palette for all frames, or colours would flicker
    palette = pictures[0].quantize(256)
    first, *rest = (picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures)
    step = round(1e3 * PERIOD / frames)
    first.save(path, format="GIF", save_all=True, append_images=rest, duration=step, loop=0, optimize=False)


def _mp4(path: Path, scenes: list[Scene], frames: int) -> None:
    program = shutil.which("ffmpeg")
    if program is None:
        raise FailureError(
            "films in MP4 need the program ffmpeg, which is not on the path",
            where=path.name,
            advice="install it (apt-get install ffmpeg, brew install ffmpeg, winget install ffmpeg), or write a .gif",
        )
    phases = list(2 * np.pi * np.arange(frames) / frames)
    pictures = list(rendered_frames(scenes, phases, _WINDOW))
    height, width = pictures[0].shape[:2]
    stream = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{frames / PERIOD:.6g}"]
    # yuv420p and an even size are what every player shows
    coded = ["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p", "-movflags", "+faststart", "-f", "mp4"]
    command = [program, "-loglevel", "error", "-y", *stream, "-i", "-", "-an", *coded, str(path)]
    done = subprocess.run(command, input=_bytes(pictures), capture_output=True)
    if done.returncode:
        last = done.stderr.decode(errors="replace").strip().splitlines()
        raise FailureError(
            "ffmpeg failed",
            where=str(path),
            got=last[-1] if last else f"status {done.returncode}",
            advice="write a .gif, which needs no ffmpeg",
        )


def _bytes(pictures: Iterable[np.ndarray]) -> bytes:
    return b"".join(picture.tobytes() for picture in chain.from_iterable([list(pictures)] * _ROUNDS))


def _glb(path: Path, scenes: list[Scene], frames: int) -> None:
    _write(path, animated_gltf(scenes, PERIOD, frames))


def _html(path: Path, scenes: list[Scene], frames: int) -> None:
    """A page that fetches nothing and runs no script but its own."""
    code = page_script()
    policy = f"default-src 'none'; style-src 'unsafe-inline'; script-src {script_source(code)}"
    style = (
        "body{font:15px sans-serif;margin:0;display:flex;flex-wrap:wrap}.motion{flex:1 1 480px;padding:12px}"
        "canvas{width:100%;height:70vh;border:1px solid #c4c4c4;touch-action:none;cursor:grab}select{display:none}"
        "h1{font-size:16px}.tools{margin:6px 0}"
    )
    panels = []
    for each in scenes:
        title = escape(each.title)
        panels.append(
            f'<section class="motion"><h1>{title}</h1><div class="tools"><select aria-label="mode"></select>'
            '<button type="button">Stop</button> <label>amplitude <input type="range" min="10" max="300" value="100">'
            f'</label></div><canvas tabindex="0" role="img" aria-label="{title}"></canvas>'
            f'<script type="application/json">{json_block(moving_scene(each))}</script></section>'
        )
    head = f'<meta charset="utf-8"><meta http-equiv="Content-Security-Policy" content="{policy}">'
    title = escape("; ".join(each.title for each in scenes))
    text = f"<!doctype html><html lang=en>{head}<title>{title}</title><style>{style}</style><body>"
    _write(path, (text + "".join(panels) + f"<script>{code}</script></body></html>\n").encode())


def _write(path: Path, data: bytes) -> None:
    try:
        path.write_bytes(data)
    except OSError as error:
        raise write_failure(error, path) from error
