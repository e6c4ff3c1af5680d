"""Python of the pages on comparing, large sets, placing, predicting, recording and tables runs as it stands.

The names that a page speaks of (a run, a map, a model) are given as its text introduces them.
"""

import re
import subprocess
import sys
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ema
from ema import examples, shapes, store
from ema.data import Candidates, Channel, Condition, Excitation, ModalModel, Recording, Run, poles_from
from ema.dof import Dof
from ema.place.recipe import load
from ema.simulate import RovingHammer, VirtualRig
from ema.synthesis import frfs as synthesis
from tests.unit.placement_rig import RECIPE, bare_table, write_recipe
from tests.unit.test_place_answers import BEAM, JOINT
from tests.unit.test_record import rig_of


def blocks_of(root: Path, page: str) -> list[str]:
    """Blocks of Python of a page."""
    return re.findall(r"```python\n(.*?)```", (root / "docs" / page).read_text(encoding="utf-8"), re.DOTALL)


def executed(root: Path, page: str, number: int, **names: Any) -> dict[str, Any]:
    """Names after block ``number`` of the Python of a page has run with ``names``."""
    space: dict[str, Any] = {"ema": ema, **names}
    exec(compile(blocks_of(root, page)[number], f"docs/{page}", "exec"), space)
    return space


def test_modes_over_their_amplitude(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A linear structure, whose mode is what was put in: 400 Hz, 1 %, 1 kg; no amplitude at which slip begins."""
    at, poles = Dof(1, "+Z"), poles_from(np.array([400.0]), np.array([0.01]))
    model = ModalModel(
        poles, np.ones((1, 1), complex), (at,), 1 / (2j * poles.imag)[None], (at,), scaling="unit modal mass"
    )
    sensor = Channel("acc", at, quantity="acceleration", unit="m/s^2")
    rig = VirtualRig(model, RovingHammer((at,) * 4), (sensor,), 4096.0, noise={"acceleration": 0.01})
    executed(root, "compare.md", 0, run=Run("beam", Condition(Excitation(kind="hammer")), tuple(rig.takes())))
    name, frequency, damping, amplitude, mass = capsys.readouterr().out.rsplit(maxsplit=4)
    assert name and float(frequency) == pytest.approx(400, rel=1e-3) and float(damping) == pytest.approx(0.01, rel=0.02)
    assert amplitude == "nan" and float(mass) == pytest.approx(1.0, rel=0.02)


BEFORE = """
from dataclasses import replace
import numpy as np, ema
from ema.data import Damping
from ema.elements import Section
from ema.simulate import Masing, damping_map, double_beam

def beam(law):
    return double_beam(law, 300.0, Section(0.5, 0.04, 0.005, elements=2), damping=Damping(ratio=0.006))

at, output, band = "beam 2:2:+Z", "beam 1:2:+Z", (14.0, 60.0)
true = beam(Masing(0.3, 2e7, stiffness_exponent=0.4))
chart = damping_map(true, [1.0, 2.0], [30.0, 60.0, 120.0], at, output, band)
chart = replace(chart, damping_std=0.03 * chart.damping, frequency_std=5e-4 * chart.frequency)
model = beam(Masing(0.5, 1e7, stiffness_exponent=0.5))
"""
AFTER = """
truth = damping_map(true, [4.0], [300.0, 600.0], at, output, band)
assert predicted.damping.shape == truth.damping.shape == (1, 2)
assert np.all((predicted.damping_low <= truth.damping) & (truth.damping <= predicted.damping_high))
law = found.model.joints[0].law
print(law.friction_coefficient)
"""


def test_a_model_is_updated_and_predicts(root: Path) -> None:
    """The joint that made the map comes back, and its damping at other forces lies in the bands that are predicted.

    In a process of its own, without the shape checker of the tests, which a search calls a hundred thousand times. Both
    pages begin with the same update, which is made once.
    """
    (_, updating), (_, predicting, _) = blocks_of(root, "compare.md"), blocks_of(root, "prediction.md")
    update, _, rest = predicting.partition("\n")
    assert updating.startswith(update + "\n") and rest
    done = subprocess.run(
        [sys.executable, "-c", BEFORE + updating + rest + AFTER], capture_output=True, text=True, check=True
    )
    assert float(done.stdout.splitlines()[-1]) == pytest.approx(0.3, rel=0.05)
    assert "friction_coefficient" in done.stdout and "identifiable" in done.stdout


def test_a_set_larger_than_memory(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(7)
    monkeypatch.chdir(tmp_path)
    poles = poles_from(np.array([220.0, 310.0]), np.array([0.004, 0.006]))
    dofs, inputs = tuple(Dof(node, "+Z") for node in range(1, 121)), (Dof(1, "+Z"), Dof(7, "+Z"))
    values = rng.normal(size=(120, 2))
    model = ModalModel(poles, values + 0j, dofs, values[[0, 6]] / (2j * poles.imag), inputs, scaling="unit modal mass")
    whole = synthesis(model, np.arange(150.0, 450.0, 0.25), outputs=dofs, inputs=inputs)
    level = 0.01 * float(np.sqrt(np.mean(np.abs(whole.values) ** 2)))
    noise = rng.normal(size=(*whole.values.shape, 2)) @ (level * np.array([1, 1j]))
    whole = replace(whole, values=whole.values + noise)
    blocks = [whole.pick(outputs=range(first, first + 40)) for first in range(0, 120, 40)]
    space = executed(root, "large.md", 0, header=replace(whole, values=whole.values[:, :0]), blocks=iter(blocks))
    assert space["model"].natural_frequencies == pytest.approx([220.0, 310.0], rel=1e-4)
    assert space["part"].values.shape == (801, 100, 2) and not isinstance(space["frfs"].values, np.ndarray)


def test_a_recording_larger_than_memory(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A force and three responses that repeat it, twice as large each: their FRFs are 2, 4 and 8 at every line."""
    folder = tmp_path / "campaign"
    (folder / "data").mkdir(parents=True)
    force = np.random.default_rng(3).normal(size=2**15)
    sensors = [Channel(f"acc {n}", Dof(n, "+Z"), quantity="acceleration", unit="m/s^2") for n in (1, 2, 3)]
    channels = (Channel("force", Dof(1, "+Z"), quantity="force", role="reference", unit="N"), *sensors)
    record = Recording(force * np.array([[1.0], [2.0], [4.0], [8.0]]), 1024.0, channels)
    store.save(folder / "data" / "random.h5", record)
    (folder / "campaign.toml").write_text(
        '[campaign]\nname = "Random"\nfiles = "data"\n[[runs]]\nid = "random"\nkind = "random"\nfiles = "random.h5"\n'
    )
    monkeypatch.chdir(tmp_path)
    frfs = executed(root, "large.md", 1)["frfs"]
    inner = slice(10, -10)
    assert np.abs(frfs.values[inner, :, 0]).mean(axis=0) == pytest.approx([2.0, 4.0, 8.0], rel=1e-6)


DRAWS = '\n[forecast]\nnormal_force = "60 N"\ndraws = 10\nmethod = "frozen"\n'
"""A short forecast at the end of a placement recipe."""


def test_a_location_of_ones_own(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The recipe that the page names stands in for its study; the beam damps, and the bands hold what is predicted."""
    path = write_recipe(tmp_path / "reports", RECIPE.replace("steel 60 x 50", "steel 40 x 45") + DRAWS)
    path.rename(path.with_name("table_placement.toml"))
    monkeypatch.chdir(tmp_path)
    forecast = executed(root, "prediction.md", 2)["forecast"]
    assert forecast.centre == (0.45, 0.44) and forecast.damping.shape == (1, 1, 1)
    assert forecast.damping_low <= forecast.damping <= forecast.damping_high
    assert forecast.damping_low > forecast.bare_damping == pytest.approx(0.00638)


def test_a_placement(root: Path, tmp_path: Path) -> None:
    from concurrent.futures import ThreadPoolExecutor

    bare, geometry = bare_table()
    spots = Candidates(np.array([[0.3, 0.06], [0.25, 0.06]]), np.zeros(2), np.zeros(2, int), (BEAM,))
    with ThreadPoolExecutor(1) as pool:
        names = {"levels": np.array([30.0]), "forces": np.array([100.0, 200.0]), "candidates": spots, "pool": pool}
        names |= {"recipe": load(write_recipe(tmp_path, RECIPE + DRAWS)), "geometry": geometry, "np": np}
        space = executed(
            root, "placement.md", 0, bare=bare, surface=shapes.smooth(bare, geometry), joint=JOINT, **names
        )
    assert space["ranking"].best.candidate in (0, 1)


def test_a_recording_session(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    """Five takes of a rig whose device is a model of the work table; ``virtual`` is a device of `ema record` alone."""
    (tmp_path / "today").mkdir()
    (tmp_path / "today" / "rig.toml").write_bytes((files("ema.datasets") / "virtual_rig.toml").read_bytes())
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ema.errors.InputError, match="no such kind of device"):
        executed(root, "record.md", 0)
    monkeypatch.setattr("acquisition.recording.open_rig", lambda rig: rig_of((1, 1, 5, 5, 34)))
    executed(root, "record.md", 0)
    lines = capsys.readouterr().out.splitlines()
    accepted = sum(line.endswith("accepted") for line in lines)
    assert len(lines) == 5 and accepted >= 4
    assert len(list((tmp_path / "today" / "raw").glob("beam_1kN_*.h5"))) == accepted


def test_tables_of_pandas(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The condition whose lower bound is highest, read from the arrays of the forecast."""
    executed(root, "coming-from.md", 0)
    forecast = examples.forecast()
    _, level, force = np.unravel_index(np.argmax(forecast.damping_low), forecast.damping_low.shape)
    assert capsys.readouterr().out == (
        f"F_E {forecast.force_levels[level]:g} N, F_N {forecast.normal_forces[force]:g} N: "
        f"zeta at least {100 * forecast.damping_low.max():.2f} %\n"
    )
