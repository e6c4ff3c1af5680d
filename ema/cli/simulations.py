"""The four jobs of `ema simulate`: they compose verbs of the simulator, of the estimation and of the pictures."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from acquisition.model_file import FrfTable, LoopTable, MapTable, SnapbackTable
from ema import show, simulate
from ema.cli.simulating import Job
from ema.data import BeamModel, Decay, HarmonicResponse, Joint, Loop, ModalMap, Response
from ema.dof import Dof
from ema.errors import EmaError, InputError
from ema.estimate import phases, ring_down
from ema.progress import Progress


def _pressed(model: BeamModel, forces: Sequence[float] | None) -> dict[str, BeamModel]:
    """The model at every normal force asked for, or as it is."""
    if not forces:
        own = [joint.normal_force for joint in model.joints]
        return {" / ".join(f"{force:g}" for force in dict.fromkeys(own)) + " N": model}
    return {f"{force:g} N": model.with_normal_force(force) for force in forces}


def snapback(
    table: SnapbackTable, model: BeamModel, load: float | None, forces: Sequence[float] | None,
    duration: float | None, reference: bool, progress: Progress,
) -> Job:  # fmt: skip
    """Free vibrations at every normal force, with their ring-down."""
    outputs = [table.at, *(dof for dof in table.outputs if dof != table.at)]
    held = (table.load if load is None else load, table.at, table.duration if duration is None else duration, outputs)
    responses: dict[str, Response] = {}
    decays: dict[str, Decay] = {}
    rows: list[dict[str, Any]] = []
    for label, pressed in _pressed(model, forces).items():
        if reference:
            run = simulate.snapback_reference(pressed, *held, table.sampling_rate, check=True, progress=progress)
        else:
            run = simulate.snapback(pressed, *held, table.sampling_rate, table.tolerance, progress=progress)
        responses[label] = run
        decay = _decay(run, _first_mode(pressed))
        if decay is not None:
            decays[label] = decay
        rows.append({"F_N": label, **_of_motion(run), **_of_decay(decay)})
    pictures = {"motion": show.motion(list(responses.values()), [f"F_N {label}" for label in responses])}
    for label, run in responses.items():
        suffix = "" if len(responses) == 1 else "_" + label.replace(" ", "").replace("/", "_")
        pictures[f"contacts{suffix}"] = show.contact_loops(run)
    if decays:
        unit = "rad" if Dof.parse(table.at).axis.startswith("R") else "m"
        pictures["ring_down"] = show.ring_down(list(decays.values()), [f"F_N {label}" for label in decays], unit)
    nouns: dict[str, Any] = {f"response {label}": run for label, run in responses.items()}
    nouns |= {f"decay {label}": decay for label, decay in decays.items()}
    return Job(nouns, pictures, rows, [one for run in responses.values() for one in run.findings])


def _of_motion(run: Response) -> dict[str, Any]:
    left = float(run.energy.total[-1] / run.energy.total[0]) if run.energy.total[0] > 0 else float("nan")
    return {
        "x0 [mm]": float(1e3 * run.displacements[0, 0]), "energy left [%]": 100 * left,
        "energy balance": float(run.energy.error), "error estimate": float(run.error_estimate),
    }  # fmt: skip


def _of_decay(decay: Decay | None) -> dict[str, Any]:
    """Frequency and damping while sliding and while sticking; dashes for what there is not."""
    kinds = {} if decay is None else {phase.kind: phase for phase in phases(decay)}
    sliding, sticking = kinds.get("sliding", kinds.get("one mode")), kinds.get("sticking")
    nan = float("nan")
    return {
        "f [Hz]": sliding.frequency if sliding else nan, "zeta [%]": 100 * sliding.damping if sliding else nan,
        "knee [s]": decay.knee if decay else nan, "f stuck [Hz]": sticking.frequency if sticking else nan,
        "zeta stuck [%]": 100 * sticking.damping if sticking else nan,
    }  # fmt: skip


def _first_mode(model: BeamModel) -> tuple[float, float]:
    """Band in Hz that holds the lowest mode that the joints change, sliding and stuck."""
    from ema.simulate.reduction import modal_base
    from ema.simulate.structure import assemble

    system = assemble(model)
    stuck = modal_base(system).frequencies / (2 * np.pi)
    sliding = modal_base(system, 1e-6 * np.asarray(system.contacts.stiffness)).frequencies / (2 * np.pi)
    # what moves freely once the joints slide has no ring-down
    first = int(np.argmax(sliding > 0.02 * stuck))
    low, high = float(sliding[first]), float(stuck[first])
    following = min(f for f in (*sliding, *stuck, 1e3 * high) if f > 1.05 * high)
    return 0.5 * low, min(1.5 * high, float(np.sqrt(high * following)))


def _decay(run: Response, band: tuple[float, float]) -> Decay | None:
    """The ring-down of the first mode, where there is one to be read."""
    try:
        return ring_down(run, band)
    except EmaError:
        return None


def frf(
    table: FrfTable, model: BeamModel, force: Sequence[float] | None, normal: Sequence[float] | None,
    progress: Progress,
) -> Job:  # fmt: skip
    """Steady states over the band at every force level and normal force."""
    frequencies = np.linspace(table.band[0], table.band[1], table.lines)
    outputs = table.outputs or [table.at]
    runs: dict[str, HarmonicResponse] = {}
    rows: list[dict[str, Any]] = []
    for pressed, held in _pressed(model, normal).items():
        for level in force or table.force:
            run = simulate.frf(held, frequencies, level, table.at, outputs, table.tolerance, progress=progress)
            runs[f"{level:g} N, F_N {pressed}"] = run
            top = simulate.resonance(held, level, table.at, outputs[0], (table.band[0], table.band[1]), table.tolerance)
            rows.append({
                "F_E [N]": float(level), "F_N": pressed, "f [Hz]": top.frequency, "zeta [%]": 100 * top.damping,
                "|X| [um]": 1e6 * abs(top.amplitude), "|X|/F [um/N]": 1e6 * abs(top.amplitude) / level,
                "power balance": run.power_error, "error estimate": float(np.nanmax(run.error_estimate)),
                "solved": f"{int(run.converged.sum())} of {len(run.converged)}",
            })  # fmt: skip
    return Job(
        {f"steady states {label}": run for label, run in runs.items()},
        {"steady_states": show.steady_states(list(runs.values()), list(runs))}, rows,
        [one for run in runs.values() for one in run.findings],
    )  # fmt: skip


def damping_map(
    table: MapTable, model: BeamModel, force: Sequence[float] | None, normal: Sequence[float] | None,
    progress: Progress,
) -> Job:  # fmt: skip
    """Map of one resonance, with the best normal force of every level."""
    chart = simulate.damping_map(
        model, force or table.force, normal or table.normal_force, table.at, table.output or table.at,
        (table.band[0], table.band[1]), table.tolerance, progress=progress,
    )  # fmt: skip
    pictures = {"damping_map": show.damping_map(chart), "frequency_map": show.frequency_map(chart)}
    return Job({"map": chart}, pictures, _rows_of_map(chart), [])


def _rows_of_map(chart: ModalMap) -> list[dict[str, Any]]:
    """For every level the best normal force and, to compare, the damping at both ends; the store has the whole map."""
    rows = []
    for row, level in enumerate(chart.force_levels):
        damping = 100 * np.asarray(chart.damping[row])
        best = int(np.nanargmax(damping)) if np.isfinite(damping).any() else 0
        rows.append({
            "F_E [N]": float(level), "best F_N [N]": float(chart.normal_forces[best]),
            "zeta there [%]": float(damping[best]), "f there [Hz]": float(chart.frequency[row, best]),
            **{f"zeta at {chart.normal_forces[place]:g} N [%]": float(damping[place]) for place in (0, -1)},
        })  # fmt: skip
    return rows


def loops(table: LoopTable, model: BeamModel, amplitude: Sequence[float] | None, normal: Sequence[float] | None) -> Job:
    """Stabilised loops of one joint."""
    joint = next((one for one in model.joints if one.name == table.joint), model.joints[0])
    held: dict[str, Loop] = {}
    rows: list[dict[str, Any]] = []
    for force in normal or table.normal_force or [joint.normal_force]:
        for reach in amplitude or table.amplitude:
            if not reach > 0:
                raise InputError("not an amplitude", got=f"{reach} m", expected="above 0 m")
            label = f"{1e6 * reach:g} µm, F_N {force:g} N"
            held[label] = _loop(joint, float(force), float(reach), table.frequency)
            rows.append({
                "F_N [N]": float(force), "amplitude [um]": 1e6 * reach,
                "energy per cycle [J]": max(held[label].area, 0.0),
                "slip force [N]": joint.law.friction_coefficient * force,
                "largest force [N]": float(np.abs(held[label].forces).max()),
                "loss factor": max(held[label].area, 0.0) / (np.pi * reach * float(np.abs(held[label].forces).max())),
            })  # fmt: skip
    pictures = {"hysteresis": show.hysteresis(list(held.values()), list(held))}
    return Job({f"loop {label}": one for label, one in held.items()}, pictures, rows, [])


def _loop(joint: Joint, force: float, amplitude: float, frequency: float) -> Loop:
    return replace(simulate.loop(joint.law, force, amplitude, frequency=frequency), name=joint.name)
