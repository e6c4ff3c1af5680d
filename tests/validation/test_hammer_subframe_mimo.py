"""Steel sub-frame with two shakers (De Moor (ed.), DaISy, ESAT/STADIUS, KU Leuven, 96-013; not part of this project)."""

import numpy as np
import pytest

from ema.data import Channel, Condition, Recording, Run
from ema.dof import Dof
from ema.estimate import shaker

FIRST = (62.5, 119, 154.5, 192.5, 214.5, 229.5, 239.5, 287, 321, 334, 352, 398, 417.5)
SECOND = (156.5, 234)


@pytest.fixture(scope="module")
def run(datasets):
    from scipy.io import loadmat

    content = loadmat(datasets / "05_steel_subframe_mimo" / "flexible_structure_dat.mat")
    table = next(value for name, value in content.items() if not name.startswith("__"))
    channels = tuple(
        Channel(f"u{n}", Dof(100 + n), quantity="force", role="reference") if n < 2 else Channel(f"y{n}", Dof(n))
        for n in range(30)
    )
    return Run("subframe", Condition(), (Recording(np.ascontiguousarray(table.T), 1024.0, channels),))


@pytest.mark.parametrize("options", [{}, {"method": "welch", "block": 2048}], ids=["local", "welch"])
def test_multiple_coherence_and_inputs(run, options):
    frfs = shaker(run, **options)
    assert 0.98 < np.median(frfs.band(10, 500).coherence) <= 1.0
    correlation = [f for f in frfs.findings if f.code == "input-correlation"]
    assert len(correlation) == 1
    assert correlation[0].severity == "info"
    assert correlation[0].value < 0.15


def test_all_modes_show_in_the_singular_values(run):
    from scipy.signal import find_peaks

    frfs = shaker(run).band(40, 500)
    singular = np.log(np.linalg.svd(frfs.values, compute_uv=False))
    for row, wanted in ((0, FIRST), (1, SECOND)):
        places, _ = find_peaks(singular[:, row], prominence=0.3)
        for frequency in wanted:
            assert np.min(np.abs(frfs.frequencies[places] - frequency)) <= 0.6, frequency
