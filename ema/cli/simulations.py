"""The five jobs of `ema simulate`: they compose functions of the simulator, of the estimation and of the pictures."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from acquisition.model_file import ControlTable, FrfTable, LoopTable, MapTable, SnapbackTable
from ema import show, simulate
from ema.cli.simulation_job import Job
from ema.data import BeamModel, CuttingLimits, Decay, Finding, HarmonicResponse, Joint, Loop, ModalMap, Response
from ema.dof import Dof
from ema.errors import EmaError, InputError
from ema.estimate import ring_down
from ema.estimate.decay import band_passed
from ema.progress import Progress


def _pressed(model: BeamModel, forces: Sequence[float] | None) -> dict[str, BeamModel]:
    """The model at every normal force asked for, or as it is."""
    if not forces:
        own = [joint.normal_force for joint in model.joints]
        return {" / ".join(f"{force:g}" for force in dict.fromkeys(own)) + " N": model}
    return {f"{force:g} N": model.with_normal_force(force) for force in forces}


def snapback(
    table: SnapbackTable,
    model: BeamModel,
    load: float | None,
    forces: Sequence[float] | None,
    duration: float | None,
    reference: bool,
    progress: Progress,
) -> Job:
    """Simulate free vibrations at every normal force, with their ring-down.

    Parameters
    ----------
    table : SnapbackTable
        ``[snapback]`` of the model file.
    model : BeamModel
        The beam with its joints.
    load, duration : float or None
        Load [N] and time [s] in place of those of the table.
    forces : sequence of float or None
        Normal forces [N] of all joints; None for those of the model.
    reference : bool
        Whether to integrate from event to event (Masing-type laws), with an error estimate.
    progress : Progress
        Called while it is computed.

    Returns
    -------
    Job
        Responses, ring-downs, pictures, and one row for every normal force.
    """
    outputs = [table.at, *(dof for dof in table.outputs if dof != table.at)]
    release = (
        table.load if load is None else load,
        table.at,
        table.duration if duration is None else duration,
        outputs,
    )
    responses: dict[str, Response] = {}
    decays: dict[str, Decay] = {}
    rows: list[dict[str, Any]] = []
    for label, pressed in _pressed(model, forces).items():
        if reference:
            run = simulate.snapback_reference(pressed, *release, table.sampling_rate, check=True, progress=progress)
        else:
            run = simulate.snapback(pressed, *release, table.sampling_rate, table.tolerance, progress=progress)
        responses[label] = run
        modes = _first_mode(pressed)
        decay = _decay(run, _band(*modes))
        if decay is not None:
            decays[label] = decay
        rows.append({"F_N": label, **_of_motion(run), **_of_phases(run, modes, decay)})
    pictures = {"motion": show.motion(list(responses.values()), [f"F_N {label}" for label in responses])}
    for label, run in responses.items():
        suffix = "" if len(responses) == 1 else "_" + label.replace(" ", "").replace("/", "_")
        pictures[f"contacts{suffix}"] = show.contact_loops(run)
    if decays:
        unit = "rad" if Dof.parse(table.at).axis.startswith("R") else "m"
        pictures["ring_down"] = show.ring_down(list(decays.values()), [f"F_N {label}" for label in decays], unit)
    contents: dict[str, Any] = {f"response {label}": run for label, run in responses.items()}
    contents |= {f"decay {label}": decay for label, decay in decays.items()}
    return Job(contents, pictures, rows, [one for run in responses.values() for one in run.findings])


def _of_motion(run: Response) -> dict[str, Any]:
    left = float(run.energy.total[-1] / run.energy.total[0]) if run.energy.total[0] > 0 else float("nan")
    return {
        "x0 [mm]": float(1e3 * run.displacements[0, 0]),
        "energy left [%]": 100 * left,
        "energy balance": float(run.energy.error),
        "error estimate": float(run.error_estimate),
    }


def _of_phases(run: Response, modes: tuple[float, float, float], decay: Decay | None) -> dict[str, Any]:
    """Frequency and damping while contacts slip and while all stick; NaN for what there is not.

    Slip ends where the simulation books no more friction. ``modes``: sliding, stuck and following frequency in Hz.
    While the structure slides as a whole its half cycles are nearer to the sliding one, and they alone are read, if
    there are any. Their medians stand in the table: a stiff joint stops a structure within a cycle or two, which no
    filter follows.
    """
    end = _slip_end(run)
    nan = float("nan")
    row = dict.fromkeys(("f [Hz]", "zeta [%]", "cycles", "slip ends [s]", "f stuck [Hz]", "zeta stuck [%]"), nan)
    if end is not None:
        row["slip ends [s]"] = end
        turns, tops = _turning_points(run, _band(*modes))
        count = int(np.searchsorted(turns, end, side="right"))
        halves, falls = np.diff(turns[:count]), np.log(tops[: count - 1] / tops[1:count])
        slow = np.append(halves > 0.5 / np.sqrt(modes[0] * modes[1]), False)
        slid = int(np.argmin(slow)) or len(halves)
        if slid:
            fall = float(np.median(falls[:slid]))
            row["f [Hz]"], row["cycles"] = 0.5 / float(np.median(halves[:slid])), 0.5 * slid
            row["zeta [%]"] = 100 * fall / float(np.hypot(np.pi, fall))
    if decay is not None:
        times = np.asarray(decay.times)
        knee = float(decay.knee) + 1 / modes[1] if np.isfinite(decay.knee) else 0.0
        stuck = times >= max(knee, end or 0.0)
        if np.count_nonzero(stuck) * (times[1] - times[0]) * modes[1] >= _FEWEST_CYCLES:
            row["f stuck [Hz]"] = float(np.median(decay.frequencies[stuck]))
            row["zeta stuck [%]"] = 100 * float(np.median(decay.damping_ratios[stuck]))
    return row


_FEWEST_CYCLES = 2.0
"""Cycles of a stuck phase below which it is not shown: its slow decay cannot be read from fewer."""
_SLIPPING = 1e-6
"""Share of the energy that friction takes where contacts slip at all: the error that the balance of a run may have."""
_LOST = 0.999
"""Share of the friction loss after which slip counts as ended: 99 % is reached while single contacts still slip."""


def _slip_end(run: Response) -> float | None:
    """Time in s at which friction has taken all but a thousandth of what it takes; ``None`` where nothing slips."""
    lost = np.asarray(run.energy.friction) - run.energy.friction[0]
    if not lost[-1] > _SLIPPING * run.energy.total[0]:
        return None
    return float(run.times[np.argmax(lost >= _LOST * lost[-1])])


def _turning_points(
    run: Response, band: tuple[float, float]
) -> tuple[Float[np.ndarray, "turn"], Float[np.ndarray, "turn"]]:
    """Times in s of the release and of the turning points of the first mode, and the amplitudes there.

    A release from rest is the middle of a motion that is even in time, as the filter takes it to be.
    """
    motion = band_passed(np.asarray(run.displacements[0]), 1 / float(run.times[1] - run.times[0]), band).real
    ways = np.diff(motion)
    turns = np.concatenate([[0], 1 + np.flatnonzero(ways[1:] * ways[:-1] < 0)])
    return np.asarray(run.times[turns]), np.abs(motion[turns])


def _first_mode(model: BeamModel) -> tuple[float, float, float]:
    """Lowest mode that the joints change, sliding and stuck, and the mode that follows it, in Hz."""
    from ema.simulate.reduction import modal_base
    from ema.simulate.structure import assemble

    system = assemble(model)
    stuck = modal_base(system).frequencies / (2 * np.pi)
    sliding = modal_base(system, 1e-6 * np.asarray(system.contacts.stiffness)).frequencies / (2 * np.pi)
    # what moves freely once the joints slide has no ring-down
    first = int(np.argmax(sliding > 0.02 * stuck))
    low, high = float(sliding[first]), float(stuck[first])
    return low, high, min(float(f) for f in (*sliding, *stuck, 1e3 * high) if f > 1.05 * high)


def _band(sliding: float, stuck: float, following: float) -> tuple[float, float]:
    """Band in Hz that holds a mode, sliding and stuck, and not the ``following`` one."""
    return 0.5 * sliding, min(1.5 * stuck, float(np.sqrt(stuck * following)))


def _decay(run: Response, band: tuple[float, float]) -> Decay | None:
    """The ring-down of the first mode from the release on, where there is one to be read."""
    try:
        return ring_down(run, band, start=0.0)
    except EmaError:
        return None


def frf(
    table: FrfTable,
    model: BeamModel,
    force: Sequence[float] | None,
    normal: Sequence[float] | None,
    progress: Progress,
    *,
    stability: bool = False,
) -> Job:
    """Simulate steady states over the band at every force level and normal force.

    Parameters
    ----------
    table : FrfTable
        ``[frf]`` of the model file.
    model : BeamModel
        The beam with its joints.
    force : sequence of float or None
        Force amplitudes [N] in place of those of the table.
    normal : sequence of float or None
        Normal forces [N] of all joints; None for those of the model.
    progress : Progress
        Called while it is computed.
    stability : bool, default False
        Also follow the curves of steady states through their folds and say what is stable.

    Returns
    -------
    Job
        Steady states, their picture, and one row for every level and normal force: frequency, damping and amplitude of
        the peak, NaN where the band has none.
    """
    from ema.simulate.harmonic import condense
    from ema.simulate.maps import check_band, peak_in_band

    low, high = check_band(model, (table.band[0], table.band[1]))
    frequencies = np.linspace(low, high, table.lines)
    outputs = table.outputs or [table.at]
    runs: dict[str, HarmonicResponse] = {}
    rows: list[dict[str, Any]] = []
    for pressed, held in _pressed(model, normal).items():
        for level in force or table.force:
            settings = simulate.HarmonicBalance(table.tolerance)
            run = simulate.frf(held, frequencies, level, table.at, outputs, settings, progress=progress)
            runs[f"{level:g} N, F_N {pressed}"] = run
            top = peak_in_band(condense(held, level, table.at, outputs[:1], table.tolerance), (low, high))
            frequency, damping, amplitude = (
                (top.frequency, top.damping, abs(top.amplitude)) if top is not None else (float("nan"),) * 3
            )
            rows.append(
                {
                    "F_E [N]": float(level),
                    "F_N": pressed,
                    "f [Hz]": frequency,
                    "zeta [%]": 100 * damping,
                    "|X| [um]": 1e6 * amplitude,
                    "|X|/F [um/N]": 1e6 * amplitude / level,
                    "power balance": run.power_error,
                    "error estimate": float(np.nanmax(run.error_estimate)),
                    "solved": f"{int(run.converged.sum())} of {len(run.converged)}",
                }
            )
    job = Job(
        {f"steady states {label}": run for label, run in runs.items()},
        {"steady_states": show.steady_states(list(runs.values()), list(runs))},
        rows,
        [one for run in runs.values() for one in run.findings],
    )
    if not stability:
        return job
    from ema.cli.steady_state_curves import with_curves

    return with_curves(job, table, _pressed(model, normal), force or table.force, progress)


def damping_map(
    table: MapTable,
    model: BeamModel,
    force: Sequence[float] | None,
    normal: Sequence[float] | None,
    progress: Progress,
) -> Job:
    """Simulate the map of one resonance, with the best normal force of every level.

    Parameters
    ----------
    table : MapTable
        ``[map]`` of the model file.
    model : BeamModel
        The beam with its joints.
    force, normal : sequence of float or None
        Force amplitudes and normal forces [N] in place of those of the table.
    progress : Progress
        Called while it is computed.

    Returns
    -------
    Job
        The map, its two pictures, and one row for every level.
    """
    chart = simulate.damping_map(
        model,
        force or table.force,
        normal or table.normal_force,
        table.at,
        table.output or table.at,
        (table.band[0], table.band[1]),
        table.tolerance,
        progress=progress,
    )
    pictures = {"damping_map": show.damping_map(chart), "frequency_map": show.frequency_map(chart)}
    return Job({"map": chart}, pictures, _rows_of_map(chart), list(chart.findings))


def _rows_of_map(chart: ModalMap) -> list[dict[str, Any]]:
    """For every level the best normal force and, to compare, the damping at both ends; the store has the whole map."""
    rows = []
    for row, level in enumerate(chart.force_levels):
        damping = 100 * np.asarray(chart.damping[row])
        best = int(np.nanargmax(damping)) if np.isfinite(damping).any() else 0
        rows.append(
            {
                "F_E [N]": float(level),
                "best F_N [N]": float(chart.normal_forces[best]),
                "zeta there [%]": float(damping[best]),
                "f there [Hz]": float(chart.frequency[row, best]),
                **{f"zeta at {chart.normal_forces[place]:g} N [%]": float(damping[place]) for place in (0, -1)},
            }
        )
    return rows


def loops(table: LoopTable, model: BeamModel, amplitude: Sequence[float] | None, normal: Sequence[float] | None) -> Job:
    """Stabilised loops of one joint."""
    joint = next((one for one in model.joints if one.name == table.joint), model.joints[0])
    loops_by_label: dict[str, Loop] = {}
    rows: list[dict[str, Any]] = []
    for force in normal or table.normal_force or [joint.normal_force]:
        for reach in amplitude or table.amplitude:
            if not reach > 0:
                raise InputError("not an amplitude", got=f"{reach} m", expected="above 0 m")
            label = f"{1e6 * reach:g} µm, F_N {force:g} N"
            loops_by_label[label] = _loop(joint, float(force), float(reach), table.frequency)
            rows.append(
                {
                    "F_N [N]": float(force),
                    "amplitude [um]": 1e6 * reach,
                    "energy per cycle [J]": max(loops_by_label[label].area, 0.0),
                    "slip force [N]": joint.law.friction_coefficient * force,
                    "largest force [N]": float(np.abs(loops_by_label[label].forces).max()),
                    "loss factor": max(loops_by_label[label].area, 0.0)
                    / (np.pi * reach * float(np.abs(loops_by_label[label].forces).max())),
                }
            )
    pictures = {"hysteresis": show.hysteresis(list(loops_by_label.values()), list(loops_by_label))}
    return Job({f"loop {label}": one for label, one in loops_by_label.items()}, pictures, rows, [])


def _loop(joint: Joint, force: float, amplitude: float, frequency: float) -> Loop:
    return replace(simulate.loop(joint.law, force, amplitude, frequency=frequency), name=joint.name)


def control(
    table: ControlTable,
    model: BeamModel,
    force: Sequence[float] | None,
    normal: Sequence[float] | None,
    progress: Progress,
) -> Job:
    """Ring-downs under three laws of the normal force, and chatter and surface with one force or one for each level."""
    from ema.simulate.control_gain import release_statement, without_sway
    from ema.simulate.maps import check_band

    band = check_band(model, (table.band[0], table.band[1]))
    forces, levels = sorted(normal or table.normal_force), sorted(force or table.force or [])
    frequency = _mode_in_band(model, table.at, band)
    lines = simulate.ring_downs(
        without_sway(model, frequency),
        table.load,
        table.at,
        frequency,
        normal_forces=forces,
        lag=table.lag,
        progress=progress,
    )
    rows = [
        {
            "law": line.law,
            "F_N [N]": line.force,
            "integral of E/E0 [ms]": 1e3 * line.energy,
            "to 5 % [ms]": 1e3 * line.to_five,
            "to 2 % [ms]": 1e3 * line.to_two,
        }
        for line in lines
    ]
    contents: dict[str, Any] = {f"ring-down {line.law}": line for line in lines}
    if not levels:
        return Job(contents, {"control": show.tool_point(lines)}, rows, statement=f"{release_statement(lines)}.")
    limits = simulate.cutting_limits(
        model, table.at, levels, forces, band, specific_force=table.specific_force, progress=progress
    )
    return Job(
        {**contents, "limits": limits},
        {"control": show.tool_point(lines, limits)},
        rows,
        more={"tool": _rows_of_tool(limits)},
        findings=_limited_elsewhere(model.with_normal_force(forces[-1]), table, limits, band),
        statement=f"{release_statement(lines)}. Tool point {table.at}, {_said_of_tool(limits)} at a specific "
        f"cutting force of {table.specific_force / 1e6:g} N/mm2. Assumed: force and chip thickness along {table.at}, "
        f"one edge, the worst spindle speed, and the resonance within {band[0]:g} to {band[1]:g} Hz alone."
        f"{_ends_of_range(limits)}",
    )


def _limited_elsewhere(
    stuck: BeamModel, table: ControlTable, limits: CuttingLimits, band: tuple[float, float]
) -> list[Finding]:
    """Whether a resonance outside the band limits the cut more than the one inside with one force for each level."""
    from ema.simulate.control_gain import sticking_limit

    depth, frequency = sticking_limit(stuck, table.at, band[0], table.specific_force)
    inside = float(limits.depth.max(axis=1).min())
    if band[0] <= frequency <= band[1] or depth >= inside:
        return []
    return [
        Finding(
            "warning",
            "cut-limited-elsewhere",
            f"{stuck.name}, {table.at}",
            f"With sticking joints the resonance below {frequency:.4g} Hz, outside the band, lets chatter begin at "
            f"{1e3 * depth:.3g} mm of depth of cut; the one inside allows {1e3 * inside:.3g} mm under control.",
            1e3 * depth,
            1e3 * inside,
            "Damp that one first, or read the depths as those of the resonance in the band alone.",
        )
    ]


def _rows_of_tool(limits: CuttingLimits) -> list[dict[str, Any]]:
    """For every level what the best constant normal force leaves, and what one set for the level does."""
    one, each, forces = limits.constant, limits.controlled, limits.normal_forces
    return [
        {
            "F_E [N]": float(level),
            "constant F_N [N]": float(forces[one]),
            "depth [mm]": 1e3 * float(limits.depth[row, one]),
            "waves [um]": 2e6 * float(limits.amplitude[row, one]),
            "set F_N [N]": float(forces[each[row]]),
            "depth, set [mm]": 1e3 * float(limits.depth[row, each[row]]),
            "waves, set [um]": 2e6 * float(limits.amplitude[row, each[row]]),
            "chatter [Hz]": float(limits.frequency[row, each[row]]),
        }
        for row, level in enumerate(limits.force_levels)
    ]


def _said_of_tool(limits: CuttingLimits) -> str:
    kept, best = limits.depth[:, limits.constant].min(), limits.depth.max(axis=1).min()
    return (
        f"cutting force {limits.force_levels[0]:g} to {limits.force_levels[-1]:g} N: with the best constant normal "
        f"force of {limits.normal_forces[limits.constant]:g} N chatter of some level persists from {1e3 * kept:.3g} mm "
        f"of depth of cut on, with one set for each level from {1e3 * best:.3g} mm ({100 * (best / kept - 1):+.0f} %),"
    )


def _ends_of_range(limits: CuttingLimits) -> str:
    at_ends = sorted({0, len(limits.normal_forces) - 1} & {int(place) for place in limits.controlled})
    if not at_ends:
        return ""
    ends = " and ".join(f"{limits.normal_forces[place]:g} N" for place in at_ends)
    return f" Some levels ask for {ends}, an end of the range: more may lie beyond."


def _mode_in_band(model: BeamModel, at: Dof, band: tuple[float, float]) -> float:
    """Frequency in Hz of the mode with sticking joints within the band that moves ``at`` most."""
    from ema.simulate.reduction import modal_base
    from ema.simulate.structure import assemble

    system = assemble(model)
    base = modal_base(system)
    frequencies = np.asarray(base.frequencies) / (2 * np.pi)
    inside = np.flatnonzero((frequencies >= band[0]) & (frequencies <= band[1]))
    if not len(inside):
        raise InputError(
            "no mode with sticking joints in the band",
            where=model.name,
            got=f"{band[0]:g} to {band[1]:g} Hz",
            expected="the resonance that limits the cut",
            advice="widen band in [control]",
        )
    moved = np.abs(np.asarray(base.row(system, at)))[inside]
    return float(frequencies[inside[int(moved.argmax())]])
