"""A small campaign with known modes, written once: the ground of the tests of studies and commands."""

import hashlib
import pickle
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ema import store
from ema.data import Channel, ModalModel, Run, RunResult, poles_from
from ema.dof import Dof
from ema.simulate import RovingHammer, VirtualRig
from ema.study import chain
from ema.study.recipe import EstimateTable, FitTable

FREQUENCIES = np.array([120.0, 210.0, 333.0])
DAMPING = np.array([0.012, 0.009, 0.015])

CAMPAIGN = """
[campaign]
name = "Five points"
files = "data"

[[channels]]
name = "hammer"
role = "reference"
unit = "N"
dof = "{point}:+Z"

[[channels]]
name = "acc 1"
role = "response"
unit = "m/s^2"
dof = "1:+Z"

[[channels]]
name = "acc 2"
role = "response"
unit = "m/s^2"
dof = "2:+Z"

[[runs]]
id = "first"
kind = "hammer"
files = "first_{point}.h5"

[[runs]]
id = "second"
kind = "hammer"
files = "second_{point}.h5"
"""

RECIPE = """
title = "Five points, two runs"
campaign = "campaign"

[estimate]
block = 2048

[fit]
band = [60, 450]
orders = [2, 24, 2]
near = [120, 210, 333]

[[expect]]
run = "first"
natural_frequencies = [120, 210, 333]
tolerance = 0.05
damping_percent = [1.2, 0.9, 1.5]
damping_tolerance = 0.01
only = [60, 450]
"""


def truth() -> ModalModel:
    """Three modes at five points."""
    poles = poles_from(FREQUENCIES, DAMPING)
    dofs = tuple(Dof(node, "+Z") for node in range(1, 6))
    shapes = np.array(
        [[1.0, 0.8, 0.6], [0.5, -0.6, -0.9], [-0.2, -1.0, 0.7], [-0.7, 0.1, 0.8], [-0.9, 0.9, -0.6]], complex
    )
    return ModalModel(
        poles=poles,
        shapes=0.1 * shapes,
        dofs=dofs,
        participation=0.1 * shapes[:2] / (2j * poles.imag),
        inputs=dofs[:2],
        scaling="unit modal mass",
    )


@pytest.fixture(scope="session")
def small_study_master(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with a campaign of two runs and its recipe; to be copied, not used."""
    folder = tmp_path_factory.mktemp("master")
    data = folder / "campaign" / "data"
    data.mkdir(parents=True)
    (folder / "campaign" / "campaign.toml").write_text(CAMPAIGN, encoding="utf-8")
    (folder / "recipe.toml").write_text(RECIPE, encoding="utf-8")
    model = truth()
    sensors = tuple(Channel(f"acc {n}", Dof(n, "+Z"), quantity="acceleration", unit="m/s^2") for n in (1, 2))
    drive = RovingHammer(model.dofs, hits=3, contact_time=1.5e-3, spacing=1.1, jitter=0.002)
    for number, run in enumerate(("first", "second")):
        rig = VirtualRig(
            model, drive, sensors, 2048.0, noise={"acceleration": 0.001, "force": 0.01}, seed=number, force_range=2000.0
        )
        for take, record in enumerate(rig.takes()):
            store.save(data / f"{run}_{take + 1}.h5", record)
    return folder


@pytest.fixture
def small_study(small_study_master: Path, tmp_path: Path) -> Path:
    """The recipe of a small study in a folder of its own, with a blank and a non-ASCII letter in its name."""
    folder = tmp_path / "Prüfling 1"
    shutil.copytree(small_study_master, folder)
    return folder / "recipe.toml"


_ANALYSED: dict[str, RunResult] = {}


def _in_memory(run: Run) -> Run:
    """With the content of its files."""
    records = tuple(replace(one, signals=np.array(one.signals)) for one in run.recordings)
    return replace(run, recordings=records, frfs=tuple(run.frfs))


@pytest.fixture
def analysed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """What was analysed in this process before, with equal records and settings, is taken: for tests of what a study does
    with its results.
    """
    analyse = chain.analyse

    def known(run: Run, estimate: EstimateTable, fit: FitTable, *rest: Any, others: Sequence[Run] = ()) -> RunResult:
        key = hashlib.sha256(pickle.dumps(([_in_memory(one) for one in (run, *others)], estimate, fit))).hexdigest()
        if key not in _ANALYSED:
            _ANALYSED[key] = analyse(run, estimate, fit, *rest, others=others)
        return replace(_ANALYSED[key], run=run)

    monkeypatch.setattr(chain, "analyse", known)
