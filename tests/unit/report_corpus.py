"""Results for reports: studies of made-up runs, and small ones that between them fill every part of a report."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ema import data, examples
from ema.data import (
    Campaign,
    Condition,
    Excitation,
    Expectation,
    Finding,
    Geometry,
    Hit,
    HitGallery,
    JointForce,
    LevelEffect,
    ModalModel,
    PoleTable,
    Provenance,
    Repair,
    Run,
    RunResult,
    SetUpShifts,
    SingleMode,
    Statement,
    StudyResult,
    poles_from,
)
from ema.dof import Dof
from ema.show import joint_result as joint_result_data
from ema.synthesis import frfs as synthesise
from tests.unit import predicted_results
from tests.unit.friction_nouns import decay, loop, placement
from tests.unit.test_show_plot import things

EVIL = "<script>alert('x')</script> & <b>"
JOINTS = (
    JointForce(
        "J1", 1018.3, 27.0, -12.0, np.linspace(1020, 1008, 50), np.linspace(0, 60, 50), "cell 17", 12.0, "up", 20
    ),
    JointForce("J2", 995.0, 31.0),
)
REPAIRS = (Repair("reverse sign", "acc 2", "A. Tester", EVIL),)
EXPECTATIONS = (
    Expectation("f of mode 1 [Hz]", 240.0, 0.5, 240.0, True),
    Expectation("zeta", 0.1, 0.05, 0.71, False),
)
SMALL: dict[str, Any] = {"count": 2, "lines": 60}


def plate(across: int = 5, up: int = 4) -> Geometry:
    x, y = np.meshgrid(np.linspace(0, 1.2, across), np.linspace(0, 0.8, up), indexing="ij")
    grid = np.arange(1, across * up + 1).reshape(across, up)
    faces = tuple(
        (int(grid[i, j]), int(grid[i + 1, j]), int(grid[i + 1, j + 1]), int(grid[i, j + 1]))
        for i in range(across - 1)
        for j in range(up - 1)
    )
    return Geometry(grid.ravel(), np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()]), faces=faces)


def modal(geometry: Geometry, count: int, shift: float, factor: float, joints: tuple[JointForce, ...]) -> ModalModel:
    frequencies = shift * np.linspace(240, 1300, count)
    damping = factor * np.linspace(0.001, 0.01, count)
    x, y = geometry.xyz[:, 0] / 1.2, geometry.xyz[:, 1] / 0.8
    orders = sorted(((i, j) for i in range(8) for j in range(8)), key=sum)[1 : count + 1]
    shapes = (
        np.array([np.cos(np.pi * i * x) * np.cos(np.pi * j * y) for i, j in orders], complex).reshape(count, len(x)).T
    )
    poles = poles_from(frequencies, damping)
    covariance = np.zeros((count, 2, 2))
    covariance[:, 0, 0], covariance[:, 1, 1] = 0.005**2, (0.01 * damping) ** 2
    return ModalModel(
        poles,
        shapes,
        tuple(Dof(int(node), "+Z") for node in geometry.nodes),
        shapes[[0, 7]] / (2j * poles.imag),
        (Dof(1, "+Z"), Dof(8, "+Z")),
        scaling="unit modal mass",
        covariance=covariance,
        confidence=np.full(count, 0.97),
        condition=Condition(Excitation("hammer", 800.0, 60.0), joints, 294.15),
    )


def gallery() -> HitGallery:
    pulse = 800 * np.sin(np.pi * np.linspace(0, 1, 60)) ** 2
    reasons = ["", "", "double hit", ""]
    blows = tuple(
        Hit("take", n, Dof(3, "-Z"), 0.1 * n, 800.0 + n, 0.4, 1e-3, not reason, reason, pulse, 51200.0)
        for n, reason in enumerate(reasons)
    )
    frequencies = np.linspace(0, 4000, 100)
    return HitGallery(blows, frequencies, np.exp(-((frequencies / 1500) ** 2)), (2276.0, 3219.0))


def run_result(
    name: str,
    geometry: Geometry,
    count: int = 4,
    shift: float = 1.0,
    factor: float = 1.0,
    joints: tuple[JointForce, ...] = (),
    lines: int = 300,
    repeat: str = "",
) -> RunResult:
    modes = modal(geometry, count, shift, factor, joints)
    clean = synthesise(modes, np.linspace(200, 1350, lines), "accelerance", outputs=modes.inputs, inputs=modes.dofs)
    generator = np.random.default_rng(len(name))
    noise = 0.01 * np.abs(clean.values) * generator.normal(size=clean.values.shape)
    frfs = replace(
        clean,
        values=clean.values + noise,
        coherence=np.full(clean.values.shape, 0.99),
        estimator="H1",
        provenance=Provenance(inputs=((f"{name}.h5", "ab" * 32),), options=(("estimator", "H1"),)),
    )
    error = np.linspace(0.001, 0.2, noise[0].size).reshape(noise[0].shape)
    orders = np.repeat(np.arange(4, 41, 2), count)
    poles = np.tile(modes.poles, 19)
    table = PoleTable(
        orders, poles, np.full(len(poles), "s"), np.ones((len(poles), 2), complex), modes.inputs, (200.0, 1350.0)
    )
    findings = (
        Finding("info", "frequency-shift", f"run {name}", "set-ups differ by 0.02 Hz.", 0.02, 0.1, "Nothing to do."),
        Finding(
            "warning", "low-coherence", f"run {name}, FRF 1", "coherence 0.61 at 499 Hz.", 0.61, 0.8, "Hit harder."
        ),
        Finding(
            "warning", "low-coherence", f"run {name}, FRF 2", "coherence 0.52 at 499 Hz.", 0.52, 0.8, "Hit harder."
        ),
        Finding("error", "reversed-sensor", f"run {name}, {EVIL}", "the phase is reversed.", advice="Turn the sign."),
    )
    run = Run(name, modes.condition, repeat=repeat)
    return RunResult(run, frfs, table, modes, None, clean, error, None, gallery(), findings)


def study(runs: tuple[RunResult, ...], geometry: Geometry | None, **fields) -> StudyResult:
    campaign = Campaign(
        "Table, hammer",
        tuple(run.run for run in runs),
        geometry,
        "Cast iron table",
        "A. Tester",
        "2026-11-21",
        EVIL,
        inputs=(("campaign.toml", "cd" * 32),),
    )
    return StudyResult(campaign, runs, title="Table with a friction beam", **fields)


def set_up_shifts(modes: ModalModel) -> SetUpShifts:
    """What the first two modes differ by between two set-ups, whose sensors load them."""
    frequencies = modes.natural_frequencies[:2]
    return SetUpShifts(
        names=("A", "B"),
        frequencies=frequencies,
        shifts=np.array([[0.0021, 0.0019], [-0.0021, np.nan]]),
        std=np.full((2, 2), 1e-5),
        common=np.array([0.002, -0.002]),
        common_std=np.array([7e-6, 7e-6]),
        cause="mass loading",
        mass=0.0052,
        mass_std=0.0001,
        unloaded=frequencies * 1.01,
        unloaded_std=np.array([0.01, 0.02]),
    )


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
        repairs=REPAIRS,
        expectations=EXPECTATIONS,
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
    ranked = replace(bare, modes=replace(bare.modes, set_ups=set_up_shifts(bare.modes)))
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
        "joint": joint_result_data.example(),
        **predicted_results.results(),
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
