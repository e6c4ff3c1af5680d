"""How a stored prediction fares against the stored truth."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class Score:
    """Arrays (level, force): values of both sides, what lies inside its band, half width of the bands over the gain."""

    levels: np.ndarray
    forces: np.ndarray
    frequency: np.ndarray
    damping: np.ndarray
    frequency_bands: np.ndarray
    damping_bands: np.ndarray
    predicted_frequency: np.ndarray
    predicted_damping: np.ndarray
    bare_damping: float
    places: tuple[tuple[int, int, float], ...]
    """Column, row and least damping over the force levels by the truth, the predicted place first."""

    @property
    def inside(self) -> int:
        """Of 18 values, those inside their bands."""
        return sum(
            int(np.sum((bands[0] <= value) & (value <= bands[1])))
            for value, bands in ((self.frequency, self.frequency_bands), (self.damping, self.damping_bands))
        )

    @property
    def width(self) -> np.ndarray:
        """Half width of the bands of the damping over the damping gained."""
        return (self.damping_bands[1] - self.damping_bands[0]) / 2 / (self.predicted_damping - self.bare_damping)

    @property
    def place(self) -> float:
        """Damping of the predicted place over that of the best one."""
        return self.places[0][2] / max(one[2] for one in self.places)

    def text(self) -> str:
        """Both sides as a table."""
        rows = ["F_E  F_N   f told [Hz]                 f true    zeta told [%]           zeta true"]
        for i, level in enumerate(self.levels):
            for j, force in enumerate(self.forces):
                (f0, f1), (z0, z1) = self.frequency_bands[:, i, j], 100 * self.damping_bands[:, i, j]
                f, z = self.frequency[i, j], 100 * self.damping[i, j]
                rows.append(
                    f"{level:3.0f} {force:4.0f}   {self.predicted_frequency[i, j]:.2f} [{f0:.2f}, {f1:.2f}]"
                    f"  {f:.2f}{' ' if f0 <= f <= f1 else '*'}   {100 * self.predicted_damping[i, j]:.3f} "
                    f"[{z0:.3f}, {z1:.3f}]   {z:.3f}{' ' if z0 <= z <= z1 else '*'}"
                )
        rows += [
            f"inside: {self.inside} of 18; widest band +-{self.width.max():.0%} of the damping gained, mean "
            f"+-{self.width.mean():.0%}"
        ]
        rows += [
            "places (column, row: least damping): "
            + ", ".join(f"{column} {row}: {100 * damping:.3f} %" for column, row, damping in self.places)
        ]
        return "\n".join([*rows, f"predicted place over best: {self.place:.3f}"])


def score(folder: Path) -> Score:
    """The score of the files in a folder."""
    told = json.loads((folder / "prediction.json").read_text(encoding="utf-8"))
    true = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    first = told["places"][0]
    here = [one for one in true["answers"] if (one["column"], one["row"]) == (first["column"], first["row"])]
    by_force = {one["normal_force"]: one["resonances"] for one in here}
    frequency, damping = (
        np.array(
            [[by_force[force][i][name] for force in told["normal_forces"]] for i in range(len(told["force_levels"]))]
        )
        for name in ("frequency", "damping")
    )
    places = [
        (first["column"], first["row"], float(damping.min(axis=0)[told["normal_forces"].index(first["normal_force"])]))
    ]
    places += [
        (one["column"], one["row"], min(part["damping"] for part in one["resonances"]))
        for one in true["answers"]
        if one not in here
    ]
    return Score(
        np.array(told["force_levels"]),
        np.array(told["normal_forces"]),
        frequency,
        damping,
        np.array([told["frequency_low"], told["frequency_high"]]),
        np.array([told["damping_low"], told["damping_high"]]),
        np.array(told["frequency"]),
        np.array(told["damping"]),
        told["bare"]["damping"],
        tuple(places),
    )
