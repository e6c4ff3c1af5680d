"""The blind table's prediction: from the raw blows on the bare table alone, by the whole chain.

Nothing here knows the truth; ``question.json`` holds what the drawing and the joint's data sheet say.
"""

import json
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np

from ema import store
from ema.data import Channel, ModalModel, Recording
from ema.data.forecast import Forecast
from ema.data.placement import Placement
from ema.dof import Dof
from ema.place import recipe as recipes
from ema.place.job import place as placed
from ema.study import Study, chain
from ema.study.measured import frfs_of
from ema.study.recipe import FitTable

HERE = Path(__file__).parent
QUESTION, BARE, RECIPE = HERE / "question.json", HERE / "bare.npz", HERE / "place.toml"
PREDICTION = HERE / "prediction.json"
PITCH = (0.9 / 12, 0.5 / 6)
"""m between bolt holes along and across."""
DIGITS = 6

CAMPAIGN = """
[campaign]
name = "Blind table, bare"
structure = "Cast-iron table of 130 kg on soft springs"
files = "raw"

[geometry]
file = "geometry.csv"
unit = "m"

[[channels]]
name = "hammer"
role = "reference"
quantity = "force"
unit = "N"
dof = "{point}:-Z"

[[channels]]
name = "acc 1"
role = "response"
quantity = "acceleration"
unit = "m/s^2"
dof = "1:+Z"

[[channels]]
name = "acc 2"
role = "response"
quantity = "acceleration"
unit = "m/s^2"
dof = "39:+Z"

[[runs]]
id = "bare"
kind = "hammer"
files = "bare_{point}.h5"
beam = false
"""


def question() -> dict[str, Any]:
    """What is known to everybody, with the points by (column, row) of the bolt holes."""
    told = json.loads(QUESTION.read_text(encoding="utf-8"))
    return told | {"points": [[column, row] for row in (0, 2, 4, 6) for column in range(13)]}


def campaign(folder: Path, signals: Path = BARE) -> Path:
    """The stored blows as a campaign: one file per point, geometry, campaign.toml."""
    held = np.load(signals, allow_pickle=False)
    asked, scale, rate = question(), held["scale"][:, None], float(held["sampling_rate"])
    (folder / "raw").mkdir(parents=True, exist_ok=True)
    (folder / "campaign.toml").write_text(CAMPAIGN, encoding="utf-8")
    rows = [f"{n},{c * PITCH[0]:.6f},{r * PITCH[1]:.6f},0" for n, (c, r) in enumerate(asked["points"], 1)]
    (folder / "geometry.csv").write_text("\n".join(["node,x,y,z", *rows]) + "\n", encoding="utf-8")
    sensors = [1 + asked["points"].index(place_) for place_ in asked["sensors"]]
    for number, counts in enumerate(held["counts"], 1):
        channels = (
            Channel("hammer", Dof(number, "-Z"), quantity="force", unit="N", role="reference"),
            *(
                Channel(f"acc {k}", Dof(node, "+Z"), quantity="acceleration", unit="m/s^2")
                for k, node in enumerate(sensors, 1)
            ),
        )
        record = Recording(counts * scale, rate, channels)
        store.save(folder / "raw" / f"bare_{number}.h5", record)
    return folder


def bare_modes(folder: Path) -> tuple[ModalModel, Any]:
    """Modes and geometry of the bare table from the campaign."""
    recipe, study = recipes.load(RECIPE), Study.load(folder)
    held = study.open()
    frfs, _ = frfs_of(held["bare"], study.recipe.estimate)
    assert recipe.band is not None and held.geometry is not None
    return chain.fitted(frfs.band(*recipe.band), FitTable())[1], held.geometry


def prediction(
    folder: Path, signals: Path = BARE, executor: Executor | None = None, draws: int | None = None
) -> tuple[Placement, Forecast]:
    """Where the beam goes, and what f and zeta will be there at 3 F_N x 3 F_E."""
    recipe = recipes.load(RECIPE)
    assert recipe.forecast is not None
    if draws is not None:
        recipe = recipe.model_copy(update={"forecast": recipe.forecast.model_copy(update={"draws": draws})})
    answer = placed(recipe, *bare_modes(campaign(folder, signals)), executor=executor)
    assert answer.forecast is not None
    return answer, answer.forecast


def as_mapping(answer: Placement, told: Forecast) -> dict[str, Any]:
    """What is stored: places in their order, and the forecast with its bands (level, force)."""
    ranking = answer.ranking
    return {
        "bare": {"frequency": _short(told.bare_frequencies[0]), "damping": _short(told.bare_damping[0])},
        "places": [
            {
                "column": hole(one.centre)[0],
                "row": hole(one.centre)[1],
                "score": _short(one.score),
                "normal_force": one.normal_force,
            }
            for one in ranking.places
        ],
        "force_levels": _short(told.force_levels),
        "normal_forces": _short(told.normal_forces),
        "draws": told.draws,
        **{
            name: _short(getattr(told, name)[0])
            for name in ("frequency", "frequency_low", "frequency_high", "damping", "damping_low", "damping_high")
        },
    }


def hole(centre: tuple[float, float]) -> tuple[int, int]:
    """Bolt hole (column, row) of the first joint of a beam along the table."""
    return round((centre[0] - 0.15) / PITCH[0]), round(centre[1] / PITCH[1])


def _short(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return [_short(one) for one in value]
    return float(f"{float(value):.{DIGITS}g}")
