"""One mode over many conditions: frequency and damping over excitation and normal force."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from ema.data import FrfSet, ModalMap, ModalModel, Provenance, SingleMode
from ema.dof import match
from ema.errors import InputError
from ema.fit.single import local_fit
from ema.progress import Progress, advance, silent

_SAME = 0.1
"""Relative difference up to which measured levels, or normal forces, count as one nominal value, where no nominal
values are given. Its unit tests pass at 5 % and at 20 %; steps of less than that need ``force_levels`` and
``normal_forces``."""


def track(
    frfs: Sequence[FrfSet],
    near: float,
    reference: ModalModel | None = None,
    force_levels: Sequence[float] | None = None,
    normal_forces: Sequence[float] | None = None,
    bandwidths: float = 1.5,
    progress: Progress = silent,
) -> ModalMap:
    """Follow one mode through FRFs measured at several force levels and normal forces.

    Every set is fitted on its own with one mode about its peak, since one linear model does not hold over levels. The
    damping by the height of the peak stands beside that of the fit, because a linear fit of a friction peak is biased.
    What could not be identified, or was not measured, is NaN.

    Parameters
    ----------
    frfs : sequence of FrfSet
        FRF sets, each with the force level at resonance and the normal force of its joints in ``condition``.
    near : float
        Frequency of the mode [Hz]; the peak is searched within 5 % of it, then of that of the neighbouring condition.
    reference : ModalModel, optional
        Modes of the structure without a beam, or of a test at a low level, of unit modal mass: gives the damping by
        height and the modal amplitude.
    force_levels, normal_forces : sequence of float, optional
        Nominal axes [N]; by default the measured values, those within 10 % taken as one.
    bandwidths : float, default 1.5
        Half width of the fitted band; see :func:`local_fit`.
    progress : Progress, optional
        Called after each set.

    Returns
    -------
    ModalMap
        The map.

    Raises
    ------
    InputError
        If there are no FRFs, a level or normal force is unknown, a set has other joints, or the reference has no scale
        or lacks DOFs.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from ema.data import Condition, Excitation, JointForce
    >>> from ema.examples import frf_set
    >>> condition = Condition(Excitation("sweep", level=5.0), (JointForce("joint", mean=500.0),))
    >>> result = track([replace(frf_set(), condition=condition)], near=40.0)
    >>> result.damping.round(4)
    array([[0.01]])
    """
    if not len(frfs):
        raise InputError("no FRFs to follow a mode through", where="track", got="0 sets", expected="one or more")
    names, levels, forces, joints = _conditions(frfs)
    rows, row_axis = _axis(levels, force_levels, "force levels")
    columns, column_axis = _axis(forces, normal_forces, "normal forces")
    shape = (len(row_axis), len(column_axis))
    names_of = ("frequency", "damping", "f_std", "z_std", "level", "amplitude", "quadrature", "misfit")
    table = {name: np.full(shape, np.nan) for name in names_of}
    joint_table = np.full((*shape, len(names)), np.nan)
    findings = []
    started: dict[int, float] = {}
    for done, place in enumerate(np.lexsort((levels, forces))):
        advance(progress, "tracking", done, len(frfs))
        row, column = int(rows[place]), int(columns[place])
        if not np.isnan(table["level"][row, column]):
            raise InputError(
                "two sets of FRFs at one condition",
                where=f"track, {frfs[place].name}",
                got=f"{levels[place]:g} N at F_N {forces[place]:g} N twice",
                expected="one set for each point",
                advice="average the takes, or give the nominal axes",
            )
        table["level"][row, column], joint_table[row, column] = levels[place], joints[place]
        constants, drive = _constants(frfs[place], reference, near) if reference is not None else (None, None)
        found = _find(frfs[place], (started.get(column, near), near), bandwidths, constants)
        if found is None:
            continue
        started[column] = found.natural_frequency
        point = (found.natural_frequency, found.damping_ratio, found.natural_frequency_std, found.damping_ratio_std)
        for name, value in zip(names_of, point, strict=False):
            table[name][row, column] = value
        table["misfit"][row, column], table["quadrature"][row, column] = found.residual, found.quadrature_damping
        if drive is not None:
            table["amplitude"][row, column] = levels[place] * _height(frfs[place], found, drive)
        findings += [replace(finding, where=f"{frfs[place].name}: {finding.where}") for finding in found.findings]
    return ModalMap(
        row_axis,
        column_axis,
        table["frequency"],
        table["damping"],
        table["f_std"],
        table["z_std"],
        table["level"],
        table["amplitude"] if reference is not None else None,
        joint_table if names else None,
        names,
        "measured",
        frfs[0].name,
        Provenance(steps=("fit.track",), options=(("near", f"{near:g}"),)),
        quadrature_damping=table["quadrature"] if reference is not None else None,
        misfit=table["misfit"],
        findings=tuple(findings),
    )


def _conditions(frfs: Sequence[FrfSet]) -> tuple[tuple[str, ...], np.ndarray, np.ndarray, np.ndarray]:
    """Names of the joints; level, mean normal force and force of every joint of every set."""
    names = tuple(joint.joint for joint in frfs[0].condition.joints)
    levels, forces, joints = [], [], []
    for one in frfs:
        level = one.condition.excitation.level
        if not np.isfinite(level):
            raise InputError(
                "an unknown force level",
                where=f"track, {one.name}",
                got="no level",
                expected="the force at resonance in N",
                advice="give it in the run",
            )
        there = {joint.joint: joint.mean for joint in one.condition.joints}
        if set(there) != set(names):
            raise InputError(
                "joints that differ from those of the first set",
                where=f"track, {one.name}",
                got=", ".join(there) or "no joint",
                expected=", ".join(names) or "no joint",
                advice="name the joints alike in all runs",
            )
        values = [there[name] for name in names]
        if names and not np.all(np.isfinite(values)):
            raise InputError(
                "an unknown normal force",
                where=f"track, {one.name}",
                got=values,
                expected="N for every joint",
                advice="add the ring cell or a statement",
            )
        levels.append(level)
        forces.append(float(np.mean(values)) if names else 0.0)
        joints.append(values)
    return names, np.array(levels), np.array(forces), np.array(joints).reshape(len(frfs), len(names))


def _axis(
    values: Float[np.ndarray, "set"], nominal: Sequence[float] | None, what: str
) -> tuple[np.ndarray, Float[np.ndarray, "nominal"]]:
    """For every value its place on the nominal axis, and the axis."""
    if nominal is None:
        order = np.argsort(values)
        ordered = values[order]
        starts = np.concatenate([[True], np.diff(ordered) > _SAME * np.abs(ordered[:-1]) + 1e-12])
        groups = np.cumsum(starts) - 1
        axis = np.array([ordered[groups == g].mean() for g in range(groups[-1] + 1)])
        places = np.empty(len(values), dtype=np.int64)
        places[order] = groups
        return places, axis
    axis = np.unique(np.asarray(nominal, dtype=np.float64))
    places = np.abs(values[:, None] - axis).argmin(axis=1)
    far = np.abs(values - axis[places]) > 0.5 * np.maximum(np.abs(axis[places]), 1e-12)
    if far.any():
        raise InputError(
            f"measured values far from the nominal {what}",
            where="track",
            got=f"{values[far][0]:g} N",
            expected=f"near one of {axis.tolist()}",
            advice="check the unit (kN for N?) and the nominal axis",
        )
    return places, axis


def _constants(
    frfs: FrfSet, reference: ModalModel, near: float
) -> tuple[Float[np.ndarray, "out in"], Float[np.ndarray, "out"]]:
    """Modal constants of the reference's mode at the DOFs of the FRFs, and its shape at the outputs."""
    where = f"track, reference {reference.name}".strip()
    if reference.scaling != "unit modal mass":
        raise InputError("the reference has no scale", where=where, got=reference.scaling, expected="unit modal mass")
    mode = int(np.abs(reference.natural_frequencies - near).argmin())
    shape = np.real(reference.shapes[:, mode])
    values = []
    for dofs in (frfs.outputs, frfs.inputs):
        found = {i: sign * shape[j] for i, j, sign in match(dofs, reference.dofs)}
        if len(found) < len(dofs):
            missing = next(dof for i, dof in enumerate(dofs) if i not in found)
            raise InputError(
                "the reference lacks a DOF of the FRFs",
                where=where,
                got=str(missing),
                expected="the DOFs that were excited and measured",
            )
        values.append(np.array([found[i] for i in range(len(dofs))]))
    return np.outer(values[0], values[1]), values[0]


def _find(
    frfs: FrfSet, starts: tuple[float, ...], bandwidths: float, constants: Float[np.ndarray, "out in"] | None
) -> SingleMode | None:
    for start in starts:
        try:
            return local_fit(frfs, start, bandwidths, constants)
        except InputError:
            continue
    return None


def _height(frfs: FrfSet, found: SingleMode, shape: Float[np.ndarray, "out"]) -> float:
    """Modal amplitude per N at the top of the peak, seen through the shape at the outputs: m sqrt(kg) / N."""
    from ema.synthesis import convert

    values = convert(frfs, "receptance").values
    rows = np.abs(frfs.frequencies - found.natural_frequency) <= max(
        2 * found.damping_ratio * found.natural_frequency, float(np.median(np.diff(frfs.frequencies)))
    )
    modal = np.einsum("o,foi->fi", shape, values[rows]) / np.sum(shape**2)
    return float(np.abs(modal).max())
