"""Real measurements, told nothing but what their recipes say: the numbers expected stand in ``reports/*.toml``."""

import numpy as np
import pytest
from scipy.optimize import brentq

from ema.dof import Dof
from ema.shapes import mac
from ema.study import Study
from tests.validation.recipes import run_recipe


def missed(result) -> list[str]:
    assert len(result.expectations) > 0
    return [f"{one.what}: found {one.found:.4f}" for one in result.expectations if not one.met]


def free_free_beam(places: np.ndarray, modes: int) -> np.ndarray:
    """Bending shapes of a free-free Euler-Bernoulli beam at fractions of its length; mode r has r + 1 nodes."""
    shapes = []
    for mode in range(1, modes + 1):
        beta = brentq(lambda x: np.cos(x) - 1 / np.cosh(x), (mode + 0.25) * np.pi, (mode + 0.75) * np.pi)
        ratio = (np.cosh(beta) - np.cos(beta)) / (np.sinh(beta) - np.sin(beta))
        x = beta * places
        shapes.append(np.cosh(x) + np.cos(x) - ratio * (np.sinh(x) + np.sin(x)))
    return np.array(shapes).T


def test_free_free_beam(root, datasets, tmp_path):
    """02: four modes from 50 to 1000 Hz and no other; shapes with 2, 3, 4 and 5 nodes; the drive point is reversed."""
    result = run_recipe(root / "reports" / "freefree_beam.toml", tmp_path, datasets, drawn=False)
    assert missed(result) == []
    modes = result.runs[0].modes
    rows = {dof.node: (row, dof.sign) for row, dof in enumerate(modes.dofs)}
    order = [rows[node] for node in range(1, 10)]
    shapes = np.array([sign * modes.shapes[row] for row, sign in order])
    shapes = np.real(shapes * np.exp(-1j * np.angle(shapes[np.abs(shapes).argmax(0), range(4)])))
    reference = np.array(
        [
            [0.90, 0.21, -0.30, -0.58, -0.88, -0.74, -0.35, 0.21, 1.00],
            [-0.65, 0.51, 1.00, 0.65, 0.06, -0.74, -0.93, -0.54, 0.53],
        ]
    )
    for mode in range(2):
        shape = shapes[:, mode] / np.abs(shapes[:, mode]).max()
        shape = shape * np.sign(shape @ reference[mode])
        assert np.abs(shape - reference[mode]).max() < 0.1
    # the outermost nodes of the fourth mode lie beyond the outermost points: nodes are told apart by the whole shape
    positions = np.array([0.1, 0.25, 0.375, 0.5, 0.65, 0.8, 0.925, 1.05, 1.2])
    likeness = mac(shapes, free_free_beam(positions / 1.3, 6))
    assert list(likeness.argmax(axis=1)) == [0, 1, 2, 3], "2, 3, 4 and 5 nodes"
    assert likeness.max(axis=1).min() > 0.97
    drive = result.runs[0].frfs
    assert drive.outputs == (Dof(4, "-X"),) and Dof(4, "+X") in drive.inputs


def test_hammer_blows(root, datasets, tmp_path):
    """03: eight modes with a close pair from five raw blows; the missing unit is reported."""
    assert missed(run_recipe(root / "reports" / "hammer_blows.toml", tmp_path, datasets, drawn=False)) == []


def test_steel_subframe(root, datasets, tmp_path):
    """05: two shakers, raw time to modes, with those that only the second singular value shows."""
    assert missed(run_recipe(root / "reports" / "steel_subframe.toml", tmp_path, datasets)) == []


def test_sdof(root, datasets, tmp_path):
    """08: published natural frequencies, one of them from FRFs of poor coherence, which is a finding."""
    assert missed(run_recipe(root / "reports" / "sdof.toml", tmp_path, datasets, drawn=False)) == []


@pytest.mark.parametrize("name", ["freefree_beam", "hammer_blows", "steel_subframe", "sdof"])
def test_absent_measurements_are_named(name, root, tmp_path, monkeypatch):
    from ema.errors import InputError

    monkeypatch.setenv("EMA_DATASETS", str(tmp_path / "nowhere"))
    with pytest.raises(InputError, match="set EMA_DATASETS"):
        Study.load(root / "reports" / f"{name}.toml", output=tmp_path).run()
