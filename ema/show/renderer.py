"""Off-screen pictures by VTK, where it works.

VTK ends the whole process where neither EGL nor OSMesa nor a display exists, so it is tried in a process of its own
first.
"""

import subprocess
import sys
from collections.abc import Iterator, Sequence
from functools import cache
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Complex, Float, UInt8
from matplotlib.figure import Figure

from ema.data import Geometry, ModalModel
from ema.errors import FailureError, InputError, MissingExtraError
from ema.shapes import expand
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


WITHOUT_VTK = "use ema.show.mode_shapes, or ema.show.animate to .html or .glb, which need no VTK"


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
            advice=f'install it with: "{sys.executable}" -m pip install pyvista; {WITHOUT_VTK}',
        ) from error


class Scene(NamedTuple):
    """One shape on its geometry, ready to be drawn at any phase."""

    geometry: Geometry
    motion: Complex[np.ndarray, "n 3"]
    """Drawn displacements [m]; those at phase 0 are the largest, being the real part."""
    amount: Float[np.ndarray, "n"]
    """Amplitude of each node over the largest, 0 ... 1: what the colours show."""
    title: str
    interpolated: int
    """Nodes that were not measured and move with their neighbours."""

    def at(self, phase: float) -> Float[np.ndarray, "n 3"]:
        """Where the nodes are at a phase [rad]: Re(motion exp(j phase)) from their places at rest."""
        return np.asarray(self.geometry.xyz + np.real(self.motion * np.exp(1j * phase)))


def scene(model: ModalModel, geometry: Geometry, mode: int, amplitude: float) -> Scene:
    """Put one mode on its geometry; nodes without a measurement follow their neighbours.

    Parameters
    ----------
    model : ModalModel
        Modes; a complex shape keeps its phases, turned so that its motion is largest at phase 0.
    geometry : Geometry
        Where the nodes are.
    mode : int
        Position from 0.
    amplitude : float
        Largest drawn displacement as a fraction of the size of the structure.

    Returns
    -------
    Scene
        The shape.

    Raises
    ------
    InputError : there is no such mode, or no measured translation at a node of the geometry.
    """
    if not 0 <= mode < len(model.poles):
        raise InputError(
            "there is no such mode", where=model.name, got=mode, expected=f"a position of 0 to {len(model.poles) - 1}"
        )
    expansion = expand(model, geometry, True)
    if not expansion.measured.any():
        raise InputError(
            "no DOF of the modes is a translation at a node of the geometry",
            where=model.name,
            got=", ".join(str(dof) for dof in model.dofs[:3]) + (" ..." if len(model.dofs) > 3 else ""),
            expected=f"nodes such as {', '.join(str(node) for node in geometry.nodes[:3])}",
        )
    shape = expansion.displacement[:, :, mode]
    squares = np.sum(shape**2)
    # exp(-j phi/2) with phi = arg sum(u^2) makes the real part as large as it can be
    shape = shape * np.exp(-0.5j * np.angle(squares)) if squares else shape
    size = np.linalg.norm(shape, axis=1)
    largest = float(size.max()) or 1.0
    extent = float(np.linalg.norm(np.ptp(geometry.xyz, axis=0))) or 1.0
    title = f"{mode + 1}: {model.natural_frequencies[mode]:.5g} Hz, {100 * model.damping_ratios[mode]:.3g} %"
    return Scene(
        geometry, amplitude * extent / largest * shape, size / largest, title, int(expansion.interpolated.sum())
    )


def rendered_frames(
    scenes: Sequence[Scene], phases: Sequence[float], window: tuple[int, int]
) -> Iterator[UInt8[np.ndarray, "height width 3"]]:
    """Draw shapes side by side by VTK, once for each phase.

    Parameters
    ----------
    scenes : sequence of Scene
        One for each panel.
    phases : sequence of float
        Phases [rad].
    window : tuple of (int, int)
        Width and height of one panel in pixels.

    Yields
    ------
    array of shape (height, width, 3)
        Picture, red, green and blue.

    Raises
    ------
    MissingExtraError : pyvista is not installed.
    FailureError : VTK cannot draw here.
    """
    pyvista = _pyvista()
    if not renderer_works():
        raise FailureError("VTK cannot draw off screen on this machine", advice=WITHOUT_VTK)
    size = (window[0] * len(scenes), window[1])
    plotter = pyvista.Plotter(off_screen=True, window_size=size, shape=(1, len(scenes)), border=False)
    plotter.set_background("white")
    moved = []
    for column, each in enumerate(scenes):
        plotter.subplot(0, column)
        moved.append(_add(plotter, pyvista, each))
        if len(scenes) > 1:
            plotter.add_text(each.title, font_size=9, color="black", position="upper_left")
        plotter.camera_position = "iso"
        plotter.camera.zoom(1.15)
    try:
        for phase in phases:
            for mesh, each in zip(moved, scenes, strict=True):
                mesh.points = each.at(phase)
            plotter.render()
            yield np.asarray(plotter.screenshot(return_img=True))
    finally:
        plotter.close()


def _add(plotter: Any, pyvista: Any, each: Scene) -> Any:
    """Add the structure at rest and the mesh that moves; return the latter."""
    geometry = each.geometry
    chains = (("lines", geometry.lines), ("faces", geometry.faces))
    known = {
        name: [[geometry.place(node) for node in nodes if node in geometry] for nodes in all_] for name, all_ in chains
    }
    cells = {name: np.hstack([[len(rows), *rows] for rows in all_]) for name, all_ in known.items() if all_}
    look = {"line_width": 1, "point_size": 3, "color": FAINT}
    plotter.add_mesh(pyvista.PolyData(geometry.xyz, **cells), style="wireframe", **look)
    reach = pyvista.PolyData(np.concatenate([each.at(0), each.at(np.pi)]))
    plotter.add_mesh(reach, opacity=0.0)  # the view holds the whole motion
    mesh = pyvista.PolyData(each.at(0), **cells)
    mesh["displacement"] = each.amount
    plotter.add_mesh(
        mesh,
        scalars="displacement",
        cmap=COLOUR_MAP,
        clim=(0, 1),
        show_edges=True,
        line_width=1.2 if geometry.faces else 3,
        ambient=0.35,
        point_size=9,
        render_points_as_spheres=True,
        show_scalar_bar=False,
    )
    return mesh


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
    InputError
        If there is no such mode, or no DOF of the modes is at a node of the geometry.
    MissingExtraError
        If pyvista is not installed.
    FailureError
        If VTK cannot draw here; ``show.mode_shapes`` needs no VTK.

    Examples
    --------
    >>> from ema.examples import geometry, modal_model
    >>> figure = rendered_shape(modal_model(), geometry(), mode=0)  # doctest: +SKIP
    """
    drawn = scene(model, geometry, mode, amplitude)
    (picture,) = rendered_frames([drawn], [0.0], (1200, 900))
    figure = new_figure(6.75)
    axes = figure.subplots()
    axes.imshow(picture)
    axes.set_axis_off()
    axes.set_title(drawn.title)
    return figure
