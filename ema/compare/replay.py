"""A model measured as a machine was: the same forces, the same fit, the same kind of result."""

from dataclasses import dataclass, replace
from typing import overload

import numpy as np
from jaxtyping import Float

from ema.data import BeamModel, Condition, Excitation, FrfSet, JointForce, Lazy, ModalMap, Recording, Run
from ema.dof import Dof
from ema.errors import InputError
from ema.progress import Progress, advance, silent

_WIDTH = 0.04
"""Part of its frequency by which a mode may leave the range of the measured map."""
_LINES, _BANDWIDTHS = 25, 4.0
"""Lines about a resonance, and its half-power bandwidths to either side that they span."""


@dataclass(frozen=True)
class MeasuredPoints:
    """The measured points of a map: ``row``, ``column`` (point,), ``level`` N (point,), ``forces`` N (point, joint)."""

    row: np.ndarray
    column: np.ndarray
    level: Float[np.ndarray, "point"]
    forces: Float[np.ndarray, "point joint"]


@overload
def measure(
    model: BeamModel,
    like: ModalMap,
    at: Dof | str,
    output: Dof | str,
    band: tuple[float, float] | None = None,
    tolerance: float = 5e-3,
    progress: Progress = silent,
) -> ModalMap: ...
@overload
def measure(model: BeamModel, like: Run, *, tolerance: float = 5e-3, progress: Progress = silent) -> Run: ...
def measure(
    model: BeamModel,
    like: ModalMap | Run,
    at: Dof | str | None = None,
    output: Dof | str | None = None,
    band: tuple[float, float] | None = None,
    tolerance: float = 5e-3,
    progress: Progress = silent,
) -> ModalMap | Run:
    """Simulate what a test of the model would give under the conditions of a measured one.

    Like a map: every measured point is repeated at its own force at resonance and its own normal force of every joint.
    A ``frozen`` map gives the equivalent damping of the steady state; a ``measured`` one the steady-state FRFs about
    the resonance, fitted as those of the structure (``ema.fit.track``), so that what a linear fit reads wrong at a
    friction peak is wrong in both.

    Points at which the model has no resonance in the band are holes (finding ``no-resonance``).

    Like a run: the very forces that were recorded act on the model, and its responses are recorded at the same DOFs and
    rate; windows and fit are then those of the structure because they are the same calls. A record is simulated when it
    is used.

    Parameters
    ----------
    model : BeamModel
        Model with as many joints as the map or the run, or a map without single joints.
    like : ModalMap or Run
        Measured map, or run with its records.
    at, output : Dof or str, optional
        Like a map: DOF of the model that is excited, and whose response is measured.
    band : tuple of (float, float), optional
        Like a map: band [Hz] in which the resonance is searched; by default that of the map and 4 % to either side.
    tolerance : float, default 0.005
        Relative error of the simulation that is aimed at.
    progress : Progress, optional
        Called after each point.

    Returns
    -------
    ModalMap or Run
        As ``like``, simulated.

    Raises
    ------
    InputError
        If the joints do not fit, a normal force is unknown, the band holds no resonance, or a run has no records.

    References
    ----------
    .. [1] Maps of damping over excitation and normal force: Gaul, Roseira and Becker (2008), Figs. 8 and 9.

    Examples
    --------
    >>> from ema.examples import beam_model, campaign
    >>> measure(beam_model(), like=campaign()["beam"]).kind
    'hammer'
    """
    if isinstance(like, Run):
        return _run(model, like, tolerance)
    if at is None or output is None:
        raise InputError(
            "where the model is excited and measured is missing",
            where=like.name or "map",
            got=f"at {at}, output {output}",
            expected="two DOFs of the model",
        )
    return _map(model, like, at, output, band, tolerance, progress)


def _run(model: BeamModel, like: Run, tolerance: float) -> Run:
    pressed = {joint.joint: joint.mean for joint in like.condition.joints}
    names = [joint.name for joint in model.joints]
    if set(pressed) != set(names):
        raise InputError(
            "the joints of the run and of the model differ",
            where=f"run {like.id}",
            got=f"{', '.join(pressed) or 'none'} and {', '.join(names)}",
            expected="the same joints",
            advice="name the joints of the model as those of the campaign",
        )
    forces = [pressed[name] for name in names]
    if not np.all(np.isfinite(forces)):
        raise InputError(
            "an unknown normal force",
            where=f"run {like.id}",
            got="NaN",
            expected="N for every joint",
            advice="measure the normal force: without it there is nothing to compare",
        )
    if not len(like.recordings):
        raise InputError(
            "a run without records",
            where=f"run {like.id}",
            got="0 recordings",
            expected="time signals",
            advice="compare its FRFs with those of the model (ema.simulate.frf)",
        )
    loaded = model.with_normal_force(forces)

    def again(number: int) -> Recording:
        """One record of the model under the forces of the measured one."""
        from ema.simulate.friction_rig import FrictionRig
        from ema.simulate.inputs import RecordedForces

        recorded = like.recordings[number]
        drive = RecordedForces([recorded], like.condition.excitation)
        responses = tuple(channel for channel in recorded.channels if channel.role == "response")
        rig = FrictionRig(loaded, drive, responses, recorded.sampling_rate, tolerance=tolerance, name=model.name)
        taken = rig.take(0)
        references = tuple(channel for channel in recorded.channels if channel.role == "reference")
        return replace(taken, channels=references + responses, start=recorded.start)

    makers = [lambda number=number: again(number) for number in range(len(like.recordings))]
    return replace(
        like, id=f"{like.id}, {model.name or 'model'}", recordings=Lazy(makers), frfs=(), findings=(), repairs=()
    )


def _map(
    model: BeamModel,
    like: ModalMap,
    at: Dof | str,
    output: Dof | str,
    band: tuple[float, float] | None,
    tolerance: float,
    progress: Progress,
) -> ModalMap:
    from ema.simulate.maps import check_band, no_resonance

    points = measured_points(model, like)
    limits = check_band(model, band or search_band(like))
    values = np.full((4, *like.damping.shape), np.nan)
    for index in np.lexsort((points.level, points.forces.sum(axis=1))):
        advance(progress, "measuring the model", int(index), len(points.level))
        pressed, level = model.with_normal_force(points.forces[index].tolist()), float(points.level[index])
        values[:, points.row[index], points.column[index]] = _point(pressed, level, at, output, limits, tolerance, like)
    count, cut = len(points.level), int(np.isnan(values[2, points.row, points.column]).sum())
    findings = (no_resonance(model.name or "model", cut, count, limits),) if cut else ()
    return replace(
        like,
        frequency=values[0],
        damping=values[1],
        modal_amplitude=values[2],
        misfit=values[3],
        frequency_std=None,
        damping_std=None,
        quadrature_damping=None,
        name=model.name or "model",
        findings=findings,
    )


def search_band(chart: ModalMap) -> tuple[float, float]:
    """Where the mode of a map may be: its range and 4 % to either side, Hz.

    Raises
    ------
    InputError : a map without a point.
    """
    known = chart.frequency[np.isfinite(chart.frequency)]
    if not known.size:
        raise InputError(
            "a map without a point", where=chart.name or "map", got="holes only", expected="frequencies and damping"
        )
    return float(known.min() * (1 - _WIDTH)), float(known.max() * (1 + _WIDTH))


def measured_points(model: BeamModel, chart: ModalMap) -> MeasuredPoints:
    """The measured points of a map, with the normal force of every joint of the model.

    Raises
    ------
    InputError : the joints do not fit, or a normal force is unknown.
    """
    where, count = chart.name or "measured map", len(model.joints)
    row, column = np.nonzero(np.isfinite(chart.damping) & np.isfinite(chart.frequency))
    level = np.broadcast_to(chart.force_levels[:, None], chart.damping.shape)[row, column]
    if chart.force_at_resonance is not None:
        measured = chart.force_at_resonance[row, column]
        level = np.where(np.isfinite(measured), measured, level)
    forces = np.repeat(chart.normal_forces[column][:, None], count, axis=1)
    if chart.joint_forces is not None and chart.joints:
        names = [joint.name for joint in model.joints]
        if len(chart.joints) != count:
            raise InputError(
                "the joints of the map and of the model differ",
                where=where,
                got=f"{', '.join(chart.joints)} and {', '.join(names)}",
                expected="the same joints",
                advice="name the joints of the model as those of the campaign",
            )
        same = set(names) == set(chart.joints)
        order = [chart.joints.index(name) for name in names] if same else list(range(count))
        each = chart.joint_forces[row, column][:, order]
        forces = np.where(np.isfinite(each), each, forces)
    if not np.all(np.isfinite(forces)) or not np.all(np.isfinite(level)):
        raise InputError(
            "a point without normal force or force level",
            where=where,
            got="NaN",
            expected="N",
            advice="measure the normal force: without it there is nothing to compare",
        )
    return MeasuredPoints(row, column, level, forces)


def _point(
    model: BeamModel,
    level: float,
    at: Dof | str,
    output: Dof | str,
    band: tuple[float, float],
    tolerance: float,
    like: ModalMap,
) -> tuple[float, float, float, float]:
    """Frequency, damping, modal amplitude and misfit of one condition; NaN without a resonance in the band."""
    from ema.fit.tracking import track
    from ema.simulate.harmonic import condense
    from ema.simulate.maps import peak_in_band
    from ema.simulate.steady_states import HarmonicBalance, frf

    peak = peak_in_band(condense(model, level, at, [output], tolerance), band)
    if peak is None:
        return (float("nan"),) * 4
    if like.method == "frozen":
        return peak.frequency, peak.damping, peak.modal_amplitude, float("nan")
    width = _BANDWIDTHS * peak.damping * peak.frequency
    lines = np.linspace(peak.frequency - width, peak.frequency + width, _LINES)
    steady = frf(model, lines, level, at, [output], HarmonicBalance(tolerance))
    first = steady.values[:, :1, int(np.flatnonzero(steady.orders == 1)[0])]
    good = np.isfinite(first[:, 0])
    values = first[good][:, :, None] / level
    joints = tuple(JointForce(joint.name, joint.normal_force) for joint in model.joints)
    frfs = FrfSet(
        lines[good],
        values,
        steady.dofs[:1],
        (steady.driven,),
        "receptance",
        "m/N",
        condition=Condition(Excitation("stepped sine", level), joints),
        name=f"{level:g} N",
    )
    chart = track([frfs], near=peak.frequency)
    damping, misfit = chart.damping[0, 0], chart.misfit
    if not np.isfinite(damping):
        return float("nan"), float("nan"), peak.modal_amplitude, float("nan")
    return float(chart.frequency[0, 0]), float(damping), peak.modal_amplitude, float(np.asarray(misfit)[0, 0])
