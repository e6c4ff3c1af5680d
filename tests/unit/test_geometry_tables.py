"""Positions in a table beside a campaign: by the units of its titles, or by what ``[geometry]`` says of its columns."""

from pathlib import Path

import numpy as np
import pytest

from acquisition.campaign_file import GeometryTable
from acquisition.geometry_file import geometry_of
from ema.errors import InputError

ROWS = "7,250,0,-40\n3,0,500,0\n"
METRES = [[0.25, 0.0, -0.04], [0.0, 0.5, 0.0]]


def read(folder: Path, titles: str, **keys: str):
    (folder / "points.csv").write_text(f"{titles}\n{ROWS}")
    return geometry_of(GeometryTable(file="points.csv", **keys), folder, folder, "campaign.toml")


@pytest.mark.parametrize(
    ("titles", "keys"),
    [
        ("node,x [mm],y [mm],z [mm]", {}),
        ("node,x,y,z", {"unit": "mm"}),
        ("node,x [mm],y [mm],z [mm]", {"unit": "mm", "x": "x [mm]", "y": "y [mm]", "z": "z [mm]"}),
    ],
)
def test_positions_are_in_metres_whoever_states_the_unit(tmp_path: Path, titles: str, keys: dict[str, str]) -> None:
    found = read(tmp_path, titles, **keys)
    assert found.nodes.tolist() == [7, 3]
    np.testing.assert_allclose(found.xyz, METRES, rtol=1e-12)


@pytest.mark.parametrize("titles", ["node,x,y,z", "number,east,north,up"])
def test_positions_in_a_unit_that_nobody_states_are_refused(tmp_path: Path, titles: str) -> None:
    with pytest.raises(InputError, match=r"points\.csv: the coordinates have no unit; add unit"):
        read(tmp_path, titles)
