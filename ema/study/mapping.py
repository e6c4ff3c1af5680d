"""From the runs of a shaker campaign to the map of one mode over excitation and normal force."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ema.data import Campaign, Finding, FrfSet, MapResult, ModalMap, ModalModel, Run, SingleMode, poles_from
from ema.errors import InputError
from ema.estimate import Steps
from ema.messages import mark
from ema.progress import Progress, advance, silent
from ema.study.damping_by_height import with_valid_heights
from ema.study.measured import frfs_of
from ema.study.recipe import EstimateTable, MapTable

KINDS = ("stepped sine", "sweep")
_DOUBLING = (1.5, 3.2)
"""Ratios of two force levels between which they are compared like a doubling."""
_EDGES = 0.2
"""Share of the lines of a stepped sine, at both ends together, whose median force is that beside the resonance."""
_GATE = 0.05
"""Residual of the fit of one mode, over the norm of the FRFs, above which a finding says that its damping is biased."""
_ABOUT = 0.1
"""Half width of the band about a mode that is looked at, relative."""


@dataclass(frozen=True)
class Point:
    """One run of a map: its FRFs with the force at resonance as level, the nominal level in N, and the drop-out."""

    frfs: FrfSet
    nominal: float
    dropout: float
    sequence: str
    findings: tuple[Finding, ...] = ()


def mapped(
    campaign: Campaign,
    table: MapTable,
    estimate: EstimateTable,
    progress: Progress = silent,
    computed: Callable[[Sequence[Run]], Iterable[Point]] | None = None,
) -> MapResult:
    """Follow one mode through the runs of ``table``: FRFs, force at resonance, homogeneity, and the map.

    Runs on the way down of the normal force are compared with those on the way up, which make the map. ``computed``
    delivers the conditions of runs in their order; in this process by default.

    Raises
    ------
    InputError : no such runs, a normal force or level that is not known, joints named differently, no mode near.
    """
    runs = chosen(campaign, table)
    reference = _reference(campaign, table, estimate)
    points, delivered = [], iter((point(run, table, estimate) for run in runs) if computed is None else computed(runs))
    for number in range(len(runs)):
        advance(progress, f"runs of {table.title}", number, len(runs))
        points.append(next(delivered))
    down = [point for point in points if point.sequence == "down"]
    up = [point for point in points if point.sequence != "down"]
    if not up:
        up, down = down, []
    chart = _tracked(up, table, reference)
    order = _places(chart, up)
    chart, doubtful = with_valid_heights(chart, [point.frfs for point in up], order, reference, table.bandwidths)
    pairs, index, ratio = _gate(up, order, chart)
    findings = [finding for point in points for finding in point.findings]
    findings += _about_map(chart, table.title)
    findings += [replace(finding, where=table.title) for finding in doubtful]
    findings += _about_levels(pairs, index, ratio, table.title)
    findings += _about_sequence(chart, down, table, reference)
    findings += [finding for run in runs for finding in run.findings]
    dropout = np.full(chart.damping.shape, np.nan)
    for place, condition in zip(order, up, strict=True):
        dropout[place] = condition.dropout
    return MapResult(
        table.title,
        replace(chart, name=table.title, findings=()),
        pairs,
        index,
        ratio,
        dropout,
        tuple(run.id for run in runs),
        tuple(dict.fromkeys(findings)),
    )


def simulated(path: Path, table: MapTable, progress: Progress = silent) -> MapResult:
    """The map of a model file by harmonic balance, over the forces of its ``[map]`` or those of ``table``.

    Raises
    ------
    InputError : no such file, or one without ``[map]``.
    """
    import acquisition
    from acquisition import model_file
    from ema import simulate

    settings = model_file.load(path).map
    if settings is None:
        raise InputError("the model file has no [map]", where=str(path), expected="at, output and band")
    chart = simulate.damping_map(
        acquisition.open_model(path),
        table.force_levels or settings.force,
        table.normal_forces or settings.normal_force,
        settings.at,
        settings.output or settings.at,
        (settings.band[0], settings.band[1]),
        settings.tolerance,
        progress=progress,
    )
    nothing = np.zeros(0)
    dropout = np.full(chart.damping.shape, np.nan)
    return MapResult(
        table.title,
        replace(chart, name=table.title, findings=()),
        nothing.reshape(0, 3),
        nothing,
        nothing,
        dropout,
        findings=(*_about_map(chart, table.title), *(replace(one, where=table.title) for one in chart.findings)),
    )


def chosen(campaign: Campaign, table: MapTable) -> tuple[Run, ...]:
    """The runs of a map: those named, or all sine tests with a beam.

    Raises
    ------
    InputError : there are none.
    """
    patterns = table.runs or ["*"]
    runs = tuple(
        run
        for run in campaign.runs
        if run.kind in KINDS
        and not run.levels
        and run.condition.joints
        and any(fnmatch(run.id, one) for one in patterns)
    )
    if not runs:
        raise InputError(
            "no run to make a map of",
            where=f"campaign {campaign.name}, {table.title}",
            got=", ".join(patterns),
            expected="stepped sines or sweeps with a normal force",
            advice="hammer tests have no force level of their own: see `ema run`",
        )
    return runs


def stepped_runs(campaign: Campaign, patterns: Sequence[str]) -> tuple[Run, ...]:
    """The runs of stepped levels among those named, or all of them."""
    return tuple(run for run in campaign.runs if run.levels and any(fnmatch(run.id, one) for one in patterns or ["*"]))


def reference_run(campaign: Campaign, table: MapTable) -> Run | None:
    """The run without the beam that scales a map: the one named, or the first one without joints.

    Raises
    ------
    InputError : there is no run of the name given.
    """
    if table.reference:
        return campaign[table.reference]
    known = (*KINDS, "random")
    bare = [run for run in campaign.runs if not (run.condition.joints or run.levels) and run.kind in known]
    return bare[0] if bare else None


def _reference(campaign: Campaign, table: MapTable, estimate: EstimateTable) -> ModalModel | None:
    """Modal constants of the mode without the beam."""
    run = reference_run(campaign, table)
    if run is None:
        return None
    return _one_mode(frfs_of(run, estimate)[0], table.near)


def _one_mode(frfs: FrfSet, near: float) -> ModalModel | None:
    """One mode scaled by its drive point, or ``None`` where there is no drive point."""
    from ema.dof import match
    from ema.fit import local_fit

    fitted = local_fit(frfs.band(near * (1 - 2 * _ABOUT), near * (1 + 2 * _ABOUT)), near)
    driven = match(frfs.inputs, frfs.outputs)
    if not driven or not frfs.scaled:
        return None
    column, row, sign = driven[0]
    constants = np.real(fitted.modal_constants[:, column])
    drive = constants[row] * sign
    if not drive > 0:
        return None
    shape = (constants / np.sqrt(drive)).astype(complex)[:, None]
    pole = poles_from(np.array([fitted.natural_frequency]), np.array([fitted.damping_ratio]))
    dofs = frfs.outputs
    return ModalModel(pole, shape, dofs, shape / (2j * pole.imag), dofs, scaling="unit modal mass", name=frfs.name)


def point(run: Run, table: MapTable, estimate: EstimateTable) -> Point:
    """FRFs about the mode, with the force at resonance as their level."""
    from ema.fit import local_fit

    frfs, steps = _estimated(run, estimate)
    frfs = frfs.band(table.near * (1 - _ABOUT), table.near * (1 + _ABOUT))
    nominal = run.condition.excitation.level
    findings: tuple[Finding, ...] = ()
    try:
        fitted = local_fit(frfs, table.near, table.bandwidths)
    except InputError as error:
        level, dropout, findings = nominal, float("nan"), (_without_mode(run, table, frfs, error),)
    else:
        level, dropout, findings = _level(run, frfs, steps, fitted, estimate.mount_mass)
        findings += _against_stated(run, frfs, level, dropout)
    excitation = replace(frfs.condition.excitation, level=level)
    frfs = replace(frfs, condition=replace(frfs.condition, excitation=excitation))
    sequence = run.condition.joints[0].sequence
    return Point(frfs, nominal if np.isfinite(nominal) else level, dropout, sequence, findings + frfs.findings)


def _without_mode(run: Run, table: MapTable, frfs: FrfSet, error: InputError) -> Finding:
    """Why a run is a hole of the map."""
    top = float(frfs.frequencies[np.sum(np.abs(frfs.values) ** 2, axis=(1, 2)).argmax()])
    return Finding(
        "warning",
        "no-mode-near",
        f"run {run.id}",
        f"no mode was found near {table.near:g} Hz: {error} The FRFs are largest at {top:.5g} Hz.",
        top,
        table.near,
        "Name the frequency at which the mode is (near), or measure further to both sides of it.",
    )


def _against_stated(run: Run, frfs: FrfSet, level: float, dropout: float) -> tuple[Finding, ...]:
    """A finding where the level that the campaign states is neither that at resonance nor that beside it."""
    from ema.estimate.record_agreement import FORCE

    stated = run.condition.excitation.level
    measured = [level, level / dropout if np.isfinite(dropout) and dropout > 0 else level]
    if not (np.isfinite(stated) and len(run.recordings) and frfs.scaled):
        return ()
    if any(1 / FORCE <= one / stated <= FORCE for one in measured) or min(measured) <= stated <= max(measured):
        return ()
    return (
        Finding.of(
            "warning",
            "level-not-as-stated",
            f"run {run.id}",
            "the campaign states a force level of {stated} N, and {level} N were measured at resonance "
            "({beside} N beside it): the map takes what was measured.",
            level / stated,
            FORCE,
            advice=(
                "Correct the level in campaign.toml (it is an amplitude, no rms), or the sensitivity of the force."
            ),
            stated=f"{stated:.4g}",
            level=f"{level:.4g}",
            beside=f"{measured[1]:.4g}",
        ),
    )


def _estimated(run: Run, estimate: EstimateTable) -> tuple[FrfSet, Steps | None]:
    """FRFs of a run, and the forces at the frequencies of a stepped sine."""
    from ema import estimate as estimation

    if run.kind != "stepped sine" or not len(run.recordings):
        return frfs_of(run, estimate)[0], None
    frfs, steps = estimation.stepped_test(run, estimate.discard)
    if estimate.mount_mass:
        frfs = estimation.without_mount_mass(frfs, estimate.mount_mass, frfs.inputs)
    return frfs, steps


def _level(
    run: Run, frfs: FrfSet, steps: Steps | None, fitted: SingleMode, mount_mass: float
) -> tuple[float, float, tuple[Finding, ...]]:
    """Force on the structure in N at resonance, and over that beside it."""
    from ema import estimate as estimation

    if not len(run.recordings):
        return _stated_level(run)
    share = _share(frfs, fitted.natural_frequency, mount_mass)
    if steps is not None:
        outer = max(int(_EDGES / 2 * len(steps.force)), 1)
        beside = float(np.median(np.concatenate([steps.force[:outer], steps.force[-outer:]])))
        level = steps.force_at(fitted.natural_frequency)
        return level * share, level / beside, ()
    period, record = run.condition.excitation.period, run.recordings[0]
    periodic = bool(np.isfinite(period))
    mode = fitted.natural_frequency, fitted.damping_ratio
    resonance_force = estimation.force_at_resonance(record, *mode, period if periodic else 0.0)
    _, _, findings = estimation.sweep_rate(record, *mode, bool(run.condition.joints), periodic)
    return resonance_force.level * share, resonance_force.dropout, resonance_force.findings + findings


def _stated_level(run: Run) -> tuple[float, float, tuple[Finding, ...]]:
    """The level of a run of which there are FRFs alone: the one stated in the campaign.

    Raises
    ------
    InputError : none is stated.
    """
    level = run.condition.excitation.level
    if not np.isfinite(level):
        raise InputError(
            "the force level of a run of FRFs is not known",
            where=f"run {run.id}",
            got="FRFs without time signals, and no level",
            expected="the amplitude of the force in N",
            advice='state it in the table of the run in campaign.toml: level = "20 N"',
        )
    return (
        level,
        float("nan"),
        (
            Finding.of(
                "info",
                "stated-level",
                f"run {run.id}",
                "the run holds FRFs and no time signals: its force at resonance is taken as the {level} N stated.",
                level,
                advice="Add the time signals where the force drops at resonance.",
                level=f"{level:.4g}",
            ),
        ),
    )


def _share(frfs: FrfSet, frequency: float, mass: float) -> float:
    """Force behind the mass below the load cell over that before it: F = F_cell / (1 + m A) with the true A."""
    from ema.dof import match
    from ema.synthesis import convert

    if not mass:
        return 1.0
    column, row, sign = match(frfs.inputs, frfs.outputs)[0]
    values = sign * convert(frfs, "accelerance").values[:, row, column]
    near = complex(
        np.interp(frequency, frfs.frequencies, values.real), np.interp(frequency, frfs.frequencies, values.imag)
    )
    return float(1 / abs(1 + mass * near))


def _tracked(points: Sequence[Point], table: MapTable, reference: ModalModel | None) -> ModalMap:
    from ema import fit

    levels = table.force_levels
    if levels is None:
        levels = sorted({round(point.nominal, 6) for point in points})
    return fit.track(
        [point.frfs for point in points], table.near, reference, levels, table.normal_forces, table.bandwidths
    )


def _places(chart: ModalMap, points: Sequence[Point]) -> list[tuple[int, int]]:
    """Row and column of every run in the map."""
    placed = []
    for point in points:
        row = int(np.abs(chart.force_levels - point.frfs.condition.excitation.level).argmin())
        column = int(np.abs(chart.normal_forces - point.frfs.condition.normal_force).argmin())
        placed.append((row, column))
    return placed


def _gate(
    points: Sequence[Point], order: list[tuple[int, int]], chart: ModalMap
) -> tuple[Float[np.ndarray, "pair 3"], Float[np.ndarray, "pair"], Float[np.ndarray, "pair"]]:
    """Homogeneity between every level and the one nearest to its double, at each normal force."""
    from ema.estimate import homogeneity

    at = dict(zip(order, points, strict=True))
    rows = []
    for column, force in enumerate(chart.normal_forces):
        for row, level in enumerate(chart.force_levels):
            ratios = chart.force_levels / level
            high = int(np.abs(np.log(ratios / 2)).argmin())
            if not _DOUBLING[0] <= ratios[high] <= _DOUBLING[1] or (row, column) not in at or (high, column) not in at:
                continue
            near = chart.frequency[row, column]
            if not np.isfinite(near):
                continue
            try:
                comparison = homogeneity(at[row, column].frfs, at[high, column].frfs, float(near))
            except InputError:
                continue
            rows.append((force, level, chart.force_levels[high], comparison.index, comparison.peak_ratio))
    pairs = np.array(rows, dtype=np.float64).reshape(-1, 5)
    return pairs[:, :3], pairs[:, 3], pairs[:, 4]


def _about_map(chart: ModalMap, where: str) -> list[Finding]:
    findings = []
    for values, what, other in (
        (chart.force_levels, mark("force level"), mark("the force")),
        (chart.normal_forces, mark("normal force"), mark("the normal force")),
    ):
        if len(values) == 1:
            findings.append(
                Finding.of(
                    "warning",
                    "map-with-one-" + what.split()[-1],
                    where,
                    "the map has one {what}, {values} N: how the mode depends on {other} cannot be determined.",
                    1.0,
                    2.0,
                    advice="Measure at more than one {what}.",
                    what=what,
                    values=f"{values[0]:.4g}",
                    other=other,
                )
            )
    holes = int(np.sum(~np.isfinite(chart.damping)))
    if holes:
        findings.append(
            Finding.of(
                "info",
                "holes",
                where,
                "{count} of {total} conditions show no mode or were not measured.",
                holes,
                0.0,
                count=holes,
                total=chart.damping.size,
            )
        )
    misfit = np.zeros(0) if chart.misfit is None else np.asarray(chart.misfit)
    bent = misfit[np.isfinite(misfit)]
    if len(bent) and bent.max() > _GATE:
        findings.append(
            Finding.of(
                "warning",
                "misfit",
                where,
                "a linear mode leaves up to {share} % of the FRFs unexplained, more than {limit_share} % in "
                "{count} of {total} conditions: damping by the fit is biased there.",
                float(bent.max()),
                _GATE,
                advice="Read the damping by height beside it, where it is shown.",
                share=f"{100 * bent.max():.0f}",
                limit_share=f"{100 * _GATE:.0f}",
                count=int(np.sum(bent > _GATE)),
                total=len(bent),
            )
        )
    return findings


def _about_levels(pairs: np.ndarray, index: np.ndarray, ratio: np.ndarray, where: str) -> list[Finding]:
    """One finding for a map that is not homogeneous, with the side of every normal force."""
    from ema.estimate.nonlinearity import NEITHER, NONLINEAR

    if not len(index) or index.max() <= NONLINEAR:
        return []
    sides = []
    for force in np.unique(pairs[:, 0]):
        here = (pairs[:, 0] == force) & (index > NONLINEAR)
        if here.any():
            change = ratio[here] - 1
            if np.all(change > NEITHER):
                sides.append(f"{force:.4g} N slips (press more)")
            elif np.all(change < -NEITHER):
                sides.append(f"{force:.4g} N sticks at the lower levels (press less)")
            else:
                sides.append(f"{force:.4g} N lies about the most damping")
    worst = int(index.argmax())
    return [
        Finding(
            "warning",
            "not-homogeneous",
            where,
            f"FRFs differ by up to {index[worst]:.0%} between levels (at "
            f"F_N {pairs[worst, 0]:.4g} N from {pairs[worst, 1]:.3g} to {pairs[worst, 2]:.3g} N): every condition is "
            f"fitted on its own, and its values hold for its amplitude. {'; '.join(sides)}.",
            float(index[worst]),
            NONLINEAR,
            "Compare conditions at equal modal amplitude.",
        )
    ]


def _about_sequence(
    chart: ModalMap, down: Sequence[Point], table: MapTable, reference: ModalModel | None
) -> list[Finding]:
    """What the order of the normal forces does: the same condition on the way up and on the way down."""
    if not down:
        return []
    again = _tracked(down, table, reference)
    findings = []
    for point, (row, column) in zip(down, _places(again, down), strict=True):
        r = int(np.abs(chart.force_levels - again.force_levels[row]).argmin())
        c = int(np.abs(chart.normal_forces - again.normal_forces[column]).argmin())
        up, after = float(chart.damping[r, c]), float(again.damping[row, column])
        rise = float(again.frequency[row, column] - chart.frequency[r, c])
        findings.append(
            Finding.of(
                "info",
                "sequence",
                f"{table.title}, {point.frfs.name}",
                "on the way down of the normal force the damping is {down} % and was {up} % on the way up, "
                "at F_E {level} N and F_N {normal_force} N; the frequency changed by {change} Hz.",
                after - up,
                advice="State the sequence with every result.",
                down=f"{100 * after:.2f}",
                up=f"{100 * up:.2f}",
                level=f"{again.force_levels[row]:.3g}",
                normal_force=f"{again.normal_forces[column]:.4g}",
                change=f"{rise:+.1f}",
            )
        )
    return findings
