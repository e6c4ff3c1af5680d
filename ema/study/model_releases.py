"""Releases of a model that a recipe asks for: how far its contacts slip, where they dissipate, and what is left."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ema.compare.map_features import Measure, missing
from ema.data import BeamModel, Loop, Response
from ema.errors import InputError
from ema.progress import Progress, advance, silent
from ema.study.recipe import ReleaseTable, StatementTable

FINER = 4.0
"""The second of two integrations, whose difference is the interval of a quantity, aims at an error so much smaller. The
error of the trapezoidal rule falls with the square of the step, so that the difference is most of that of the first;
the value is that of the second. With 2 it would be less than the error of either."""
_REVERSAL = 0.5
"""Part of the span of a relative displacement that lies between two reversals of the motion: the waves that a release
excites, a tenth of it and less, make none."""


@dataclass(frozen=True)
class ModelRelease:
    """The motion of a model after its release, and the same with smaller steps; ``areas`` (contact,) are shares."""

    name: str
    coarse: Response
    fine: Response
    areas: Float[np.ndarray, "contact"]


def simulated(folder: Path, tables: Sequence[ReleaseTable], progress: Progress = silent) -> dict[str, ModelRelease]:
    """Release the models of a recipe, by the load and the place that the ``[snapback]`` of their files states.

    Raises
    ------
    InputError : no such file, one without ``[snapback]``, or two releases of one name.
    """
    import acquisition
    from acquisition import model_file
    from ema.simulate import snapback
    from ema.simulate.structure import pair_areas

    releases: dict[str, ModelRelease] = {}
    for number, table in enumerate(tables):
        advance(progress, "releasing models", number, len(tables))
        path = model_file.locate(folder / table.model)
        settings = model_file.load(path).snapback
        if settings is None:
            raise InputError("the model file has no [snapback]", where=str(path), expected="load, at and duration")
        if table.name in releases:
            raise InputError(
                "two releases of one name", where="[[release]]", got=table.name, expected="a name for each"
            )
        model = acquisition.open_model(folder / table.model).with_normal_force(table.normal_force)
        areas = np.concatenate([pair_areas(joint) for joint in model.joints])
        forces = None
        if table.raised_at is not None:
            forces = np.full(
                (len(model.joints), int(settings.duration * settings.sampling_rate) + 1), table.normal_force
            )
            forces[:, 0] = table.raised_at
        coarse, fine = (
            snapback(
                _pressed(model, table.pressure),
                settings.load,
                settings.at,
                settings.duration,
                sampling_rate=settings.sampling_rate,
                tolerance=settings.tolerance / finer,
                normal_forces=forces,
            )
            for finer in (1.0, FINER)
        )
        releases[table.name] = ModelRelease(table.name, coarse, fine, areas)
    return releases


def _pressed(model: BeamModel, pressure: str) -> BeamModel:
    """The model with the pressure of every joint even, or rising in proportion to the number of the node pair."""
    from ema.simulate.structure import pair_areas

    if pressure == "even":
        return model
    joints = []
    for joint in model.joints:
        shares = pair_areas(joint) * np.arange(1, len(joint.pairs) + 1)
        joints.append(replace(joint, force_shares=shares / shares.sum()))
    return replace(model, joints=tuple(joints))


def loops(releases: Mapping[str, ModelRelease], tables: Sequence[ReleaseTable]) -> tuple[Loop, ...]:
    """The first cycle of the contacts that the tables name, from one reversal of the slip to the next but one.

    Where a contact comes to rest before, it is the whole way there.

    Raises
    ------
    InputError : no such contact.
    """
    found = []
    for table in tables:
        motion = releases[table.name].fine
        for contact in table.loops:
            if contact > len(motion.slips):
                raise InputError(
                    "the model has no such contact",
                    where=f"[[release]] {table.name}",
                    got=str(contact),
                    expected=f"1 to {len(motion.slips)}",
                )
            slip, force = motion.slips[contact - 1], motion.forces[contact - 1]
            turns = _reversals(slip)
            cycle = slice(turns[0], turns[2] + 1 if len(turns) > 2 else None)
            x, f = slip[cycle], force[cycle]
            area = 0.5 * abs(float(np.sum(x * np.roll(f, -1) - np.roll(x, -1) * f)))  # closed polygon, shoelace formula
            times, amplitude = motion.times[cycle] - motion.times[turns[0]], 0.5 * float(np.ptp(x))
            name = f"{table.name}, contact {contact}"
            found.append(Loop(x, f, area, amplitude, 1, table.normal_force, times, name=name))
    return tuple(found)


def _reversals(slip: Float[np.ndarray, "sample"]) -> list[int]:
    """Samples of the turning points between which the motion goes by ``_REVERSAL`` of its span, the first included."""
    least = _REVERSAL * float(np.ptp(slip[: len(slip) // 4]))
    turns, extreme, up = [0], 0, False
    for sample, value in enumerate(slip):
        if extreme == turns[-1] and abs(value - slip[extreme]) >= least:
            up, extreme = bool(value > slip[extreme]), sample
        elif extreme != turns[-1] and (value > slip[extreme]) == up:
            extreme = sample
        elif extreme != turns[-1] and abs(value - slip[extreme]) >= least:
            turns.append(extreme)
            up, extreme = not up, sample
    return turns


def measured(table: StatementTable, releases: Mapping[str, ModelRelease]) -> Measure:
    """The quantity of a statement about a release of a model.

    Its interval is the difference of both integrations and the relative error of the displacements that they state.

    Raises
    ------
    InputError : the recipe has no such release.
    """
    release = _named(releases, table.release)
    motions = [release.coarse, release.fine]
    error = max(release.fine.error_estimate, 0.0)
    if table.quantity == "energy integral over release":
        other = _named(releases, table.other)
        coarse, fine = (_integral(a) / _integral(b) for a, b in zip(motions, (other.coarse, other.fine), strict=True))
        error += max(other.fine.error_estimate, 0.0)
    else:
        coarse, fine = (_value(table.quantity or "", one, release.areas) for one in motions)
    if not np.isfinite(fine):
        return missing("a release in which the contacts slip")
    half = abs(fine - coarse) + error * abs(fine)
    return Measure(fine, fine - half, fine + half)


def _value(quantity: str, motion: Response, areas: Float[np.ndarray, "contact"]) -> float:
    slips = np.abs(motion.slips).max(axis=1)
    match quantity:
        case "largest slip":
            return 1e6 * float(slips.max())
        case "slip of first over last contact":
            return float(slips[0] / slips[-1])
        case "dissipation of first over last contact":
            density = motion.dissipated / areas
            return float(density[0] / density[-1]) if density[-1] > 0 else np.nan
        case _:  # "loop areas over energy lost"
            means = 0.5 * (motion.forces[:, 1:] + motion.forces[:, :-1])
            work = float(np.sum(means * np.diff(motion.slips, axis=1)))
            stored = float(motion.energy.contact[-1] - motion.energy.contact[0])
            lost = float(motion.energy.total[0] - motion.energy.total[-1] - motion.energy.damping[-1])
            return (work - stored) / lost if lost > 0 else np.nan


def _integral(motion: Response) -> float:
    """Integral of the energy over its first value, s."""
    share = motion.energy.total / motion.energy.total[0]
    return float(np.sum(0.5 * (share[1:] + share[:-1]) * np.diff(motion.times)))


def _named(releases: Mapping[str, ModelRelease], name: str) -> ModelRelease:
    if name not in releases:
        raise InputError(
            "a statement is about a release that is not in the recipe",
            where="[[statements]]",
            got=name or "none",
            expected="one of " + (", ".join(releases) or "no release"),
        )
    return releases[name]
