"""The work table without its beam as a measurement would give it, and a small placement recipe."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from ema import store
from ema.data import Geometry, ModalModel
from ema.datasets import work_table

RECIPE = """
title = "Beam on the work table"
modes = "bare.h5"
near = "499 Hz"
at = "91:+Z"
force = ["15 N", "30 N"]
normal_force = ["60 N", "120 N", "240 N"]

[[beams]]
name = "steel 60 x 50"
spacing = "300 mm"
overhang = "20 mm"
width = "60 mm"
height = "50 mm"

[joint]
surface_height = "45 mm"
normal_stiffness = "1e9 N/m"
friction_std = "10 %"
stiffness_std = "20 %"

[joint.law]
name = "masing"
friction_coefficient = 0.2
contact_stiffness = "2e8 N/m"

[search]
step = "150 mm"
angles = [0]
shortlist = 3
keep = 3
draws = 20
"""


def bare_table(noise: float = 0.0, seed: int = 0) -> tuple[ModalModel, Geometry]:
    """Elastic modes at 80 points, driver (91) and sensor (92); noise relative to the rms of each shape."""
    points = work_table.grid() | work_table.shaker_points(work_table.ABSORBER)
    whole = work_table.bare(points)
    kept = np.flatnonzero(whole.natural_frequencies > 100)
    shapes = whole.shapes[:, kept]
    rng = np.random.default_rng(seed)
    size = np.sqrt(np.mean(np.abs(shapes) ** 2, axis=0))
    shapes = shapes + noise * size * rng.standard_normal(shapes.shape)
    bare = replace(whole, poles=whole.poles[kept], shapes=shapes, participation=shapes / (2j * whole.poles[kept].imag))
    x, y = np.array(list(points.values())).T
    return bare, Geometry(np.array(list(points)), np.stack([x, y, 0 * x], axis=1))


def write_recipe(folder: Path, text: str = RECIPE, noise: float = 0.02) -> Path:
    """The recipe and the file with modes it names."""
    bare, geometry = bare_table(noise)
    folder.mkdir(parents=True, exist_ok=True)
    store.save(folder / "bare.h5", {"modes": bare, "geometry": geometry})
    path = folder / "place.toml"
    path.write_text(text, encoding="utf-8")
    return path
