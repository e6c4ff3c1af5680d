"""Small results that between them fill every part of a report."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ema import data, examples
from ema.data import Expectation, Finding, LevelEffect, Provenance, Repair, SetUpShifts, SingleMode, Statement
from ema.dof import Dof
from tests.unit.friction_nouns import decay, loop, placement
from tests.unit.test_report import EVIL, JOINTS, plate, run_result, study
from tests.unit.test_show_plot import things

SMALL: dict[str, Any] = {"count": 2, "lines": 60}


def results() -> dict[str, Any]:
    """Results by name: studies with every section, and results of no study."""
    geometry = plate(4, 3)
    bare = run_result("bare", geometry, **SMALL)
    beam = run_result("beam_1kN", geometry, shift=1.013, factor=1.9, joints=JOINTS, **SMALL)
    kinds: dict[type, Any] = {type(thing): thing for thing in things()}
    amplitude = kinds[data.AmplitudeDependentMode]
    chart = kinds[data.MapResult]
    pairs = np.array([[500.0, 2.0, 5.0], [500.0, 5.0, 9.0], [900.0, 2.0, 5.0], [900.0, 5.0, 9.0]])
    chart = replace(
        chart,
        pairs=pairs,
        homogeneity=np.array([0.01, 0.2, 0.2, 0.4]),
        peak_ratio=np.array([1.0, 1.1, 0.9, 1.001]),
    )
    bounds = {"low": 1.0, "high": 10.0, "value": 1.5, "lower": 1.2, "upper": 1.9}
    statements = tuple(
        Statement(
            "damping rises", "Fig. 8", "rise of damping", verdict=verdict, stated="matched", sentence=quote, **bounds
        )
        for verdict, quote in (("matched", "It rises."), ("not matched", ""))
    )
    full = study(
        (bare, beam),
        geometry,
        repairs=(Repair("reverse sign", "acc 2", "A. Tester", EVIL),),
        expectations=(
            Expectation("f of mode 1 [Hz]", 240.0, 0.5, 240.0, True),
            Expectation("zeta", 0.1, 0.05, 0.71, False),
        ),
        provenance=Provenance(
            versions=(("numpy", "2.4.6"),),
            steps=("open", "fit"),
            options=(("band", "0 to 100"),),
            inputs=(("a.h5", "ab"),),
        ),
        placement=placement(geometry),
        forecast_check=kinds[data.ForecastCheck],
        maps=(chart,),
        statements=statements,
        decays=(decay(), decay("b"), *(decay(f"release {n}") for n in range(3, 6))),
        loops=(loop(500.0, "J1"), loop(200.0)),
        amplitude_modes=(amplitude, _ringing(amplitude)),
    )
    offered = replace(placement(geometry), forecast=examples.forecast(), trials=examples.trials())
    shifts = SetUpShifts(
        names=("A", "B"),
        frequencies=bare.modes.natural_frequencies,
        shifts=np.array([[0.0021, 0.0019], [-0.0021, np.nan]]),
        std=np.full((2, 2), 1e-5),
        common=np.array([0.002, -0.002]),
        common_std=np.array([7e-6, 7e-6]),
        cause="mass loading",
        mass=0.0052,
        mass_std=0.0001,
        unloaded=bare.modes.natural_frequencies * 1.01,
        unloaded_std=np.array([0.01, 0.02]),
    )
    repeated = tuple(
        _bones(run_result(name, geometry, joints=joints, shift=shift, repeat=repeat, **SMALL))
        for name, joints, shift, repeat in (
            ("free 1", (), 1.0, "free"),
            ("free 2", (), 1.0001, "free"),
            ("first", JOINTS, 1.02, "1kN"),
            ("second", JOINTS, 1.022, "1kN"),
        )
    )
    at = (Dof(1, "+Z"),)
    single = SingleMode(
        "local fit", 489.43, 0.0176, np.zeros((1, 1), complex), at, at, (480.0, 498.0), 37, 0.04, 1e-4, 0.17
    )
    slipping = replace(
        run_result("slip", geometry, **SMALL),
        findings=(Finding("warning", "slip-then-ring", "run slip", "It slips."),),
        level_effect=LevelEffect(0.35, 0.33, 0.37, 682.4, 1203.6),
        equivalent=(single,),
    )
    plain = run_result("plain", geometry, **SMALL)
    bones = replace(
        run_result("bones", geometry, count=1, lines=60),
        hits=None,
        poles=None,
        reconstruction=None,
        frfs=replace(plain.frfs, coherence=None),
        findings=(Finding("info", "level-tested", "run bones", "Tested."),),
    )
    ranked = replace(bare, modes=replace(bare.modes, set_ups=shifts))
    drawn = {
        kind: kinds[kind]
        for kind in (
            data.ModeComparison,
            data.MapComparison,
            data.ModelUpdate,
            data.ModalMap,
            data.Response,
            data.HarmonicResponse,
        )
    }
    return {
        "full": full,
        "placement": offered,
        "repeats": study(repeated, geometry),
        "set-ups": study((ranked, slipping), geometry),
        "bones": study((bones,), None),
        "unlike": study((_bones(plain), _bones(run_result("other", plate(4, 2), **SMALL))), geometry),
        "alone": _named(drawn) | {"decay 200 N": decay(), "loop 20 µm": loop(500.0)},
    }


def _bones(run: Any) -> Any:
    """A run without what makes most pictures."""
    return replace(run, hits=None, poles=None, reconstruction=None, frfs=replace(run.frfs, coherence=None))


def _named(drawn: Mapping[type, Any]) -> dict[str, Any]:
    return {kind.__name__: thing for kind, thing in drawn.items()}


def _ringing(mode: Any) -> Any:
    """A mode over its amplitude, as from ring-downs."""
    said = (
        Finding("info", "slip-onset", "mode", "It slips from 2 m/s².", 2.0),
        Finding("info", "impact-amplitude", "mode", "The impacts reach 3 m/s².", 3.0),
        Finding("info", "linear-reading", "mode", "A linear fit reads 40 Hz.", 40.0),
        Finding("info", "stated-damping", "mode", "The paper states 1 %.", 0.01),
    )
    return replace(mode, name="ringing", control="none", findings=said)
