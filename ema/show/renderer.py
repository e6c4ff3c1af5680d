"""Off-screen pictures by VTK, where it works.

VTK ends the whole process where neither EGL nor OSMesa nor a display exists, so it is tried in a process of its own
first.
"""

import subprocess
import sys
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ema.data import Geometry, ModalModel
from ema.errors import FailureError, MissingExtraError
from ema.shapes import expand, realise
from ema.show.style import COLOUR_MAP, FAINT, new_figure, styled

_PROBE = """
import pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=(64, 64))
plotter.add_mesh(pyvista.Sphere())
picture = plotter.screenshot(return_img=True)
raise SystemExit(0 if picture.std() > 0 else 1)
"""


@cache
def renderer_works(timeout: float = 60.0) -> bool:
    """Return whether VTK draws off screen on this machine; tried once per process, in a process of its own.

    Parameters
    ----------
    timeout : float, default 60.0
        Time [s] after which the trial counts as failed.

    Returns
    -------
    bool
        Whether it does.

    Examples
    --------
    >>> renderer_works(timeout=0.0)
    False
    """
    try:
        return subprocess.run([sys.executable, "-c", _PROBE], capture_output=True, timeout=timeout).returncode == 0
    except (OSError, subprocess.TimeoutExpired):
        return False


def _pyvista() -> Any:
    """The package that draws; nothing but these pictures needs it.

    Raises
    ------
    MissingExtraError : it is not installed, or not whole.
    """
    try:
        return import_module("pyvista")
    except ImportError as error:
        raise MissingExtraError(
            f"pictures by VTK need the package pyvista, which cannot be imported ({error})",
            advice=f'install it with: "{sys.executable}" -m pip install pyvista; ema.show.mode_shapes draws without it',
        ) from error


@styled
def rendered_shape(model: ModalModel, geometry: Geometry, mode: int, amplitude: float = 0.16) -> Figure:
    """Draw one mode shape by VTK with hidden surfaces, as an image in a figure.

    Parameters
    ----------
    model : ModalModel
        Modes.
    geometry : Geometry
        Where the nodes are.
    mode : int
        Position from 0.
    amplitude : float, default 0.16
        Largest drawn displacement as a fraction of the size of the structure.

    Returns
    -------
    Figure
        The figure.

    Raises
    ------
    MissingExtraError
        If pyvista is not installed.
    FailureError
        If VTK cannot draw here; ``show.mode_shapes`` needs no VTK.

    Examples
    --------
    >>> from ema.examples import geometry, modal_model
    >>> figure = rendered_shape(modal_model(), geometry(), mode=0)  # doctest: +SKIP
    """
    pyvista = _pyvista()
    if not renderer_works():
        raise FailureError("VTK cannot draw off screen on this machine", advice="use ema.show.mode_shapes instead")
    motion = realise(expand(model, geometry, True).displacement[:, :, mode].reshape(-1, 1)).reshape(-1, 3)
    motion = motion / (np.max(np.linalg.norm(motion, axis=1), initial=0.0) or 1.0)
    size = float(np.linalg.norm(np.ptp(geometry.xyz, axis=0))) or 1.0
    cells = {
        name: np.hstack([[len(chain), *(geometry.place(node) for node in chain)] for chain in chains])
        for name, chains in (("lines", geometry.lines), ("faces", geometry.faces))
        if chains
    }
    plotter = pyvista.Plotter(off_screen=True, window_size=(1200, 900))
    plotter.set_background("white")
    plotter.add_mesh(pyvista.PolyData(geometry.xyz, **cells), color=FAINT, style="wireframe", line_width=1)
    moved = pyvista.PolyData(geometry.xyz + amplitude * size * motion, **cells)
    moved["displacement"] = np.linalg.norm(motion, axis=1)
    plotter.add_mesh(
        moved,
        scalars="displacement",
        cmap=COLOUR_MAP,
        clim=(0, 1),
        show_edges=True,
        line_width=3,
        point_size=9,
        render_points_as_spheres=True,
        show_scalar_bar=False,
    )
    plotter.camera_position = "iso"
    picture = plotter.screenshot(return_img=True)
    plotter.close()
    figure = new_figure(6.75)
    axes = figure.subplots()
    axes.imshow(picture)
    axes.set_axis_off()
    axes.set_title(f"{mode + 1}: {model.natural_frequencies[mode]:.5g} Hz, {100 * model.damping_ratios[mode]:.3g} %")
    return figure
