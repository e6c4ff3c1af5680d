"""Scatter that is not noise: repeats of one condition, and differences between conditions."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from ema.compare.components import half_of_difference, variance_components
from ema.data import Condition, Finding, ModalModel, Run, RunResult
from ema.data.repeats import NOISE_ONLY, ConditionDifference, RepeatGroup
from ema.dof import match
from ema.errors import InputError
from ema.messages import mark, text, word
from ema.messages.lists import listed
from ema.shapes import compare, mac

ALIKE = 0.5
"""Smallest MAC of a pair."""
NEAR = 0.05
"""Largest relative difference in frequency of a pair between repeats."""
SHIFTED = 0.25
"""Largest relative difference in frequency of a pair between conditions, which a joint may shift far."""
UNEVEN = 0.1
"""Relative spread of the normal force within a group that is worth a warning."""
ANOTHER = 0.5
"""Relative spread of the normal force within a group from which on it is another condition, and refused."""

_NOTHING_SAID = mark(
    "{conditions} against {base}: noise only; assembly scatter unknown. No change is called significant."
)


def repeats(
    models: Sequence[ModalModel], label: str = "", names: Sequence[str] = (), assemblies: Sequence[str] = ()
) -> RepeatGroup:
    """Pair the modes of runs that repeat one condition, and separate noise from the scatter between assemblies.

    Parameters
    ----------
    models : sequence of ModalModel
        Modes of each run; frequencies, damping ratios and their covariance by the noise.
    label : str, optional
        Name of the condition; by default that of the run with the most modes.
    names : sequence of str, optional
        Names of the runs; by default those of the models. Runs of one name count as takes of one assembly.
    assemblies : sequence of str, optional
        One text per run; runs with the same text are takes between which nothing was loosened. By default, and where
        the text is empty, every run is an assembly of its own.

    Returns
    -------
    RepeatGroup
        The paired modes, and what scatters within and between assemblies.

    Raises
    ------
    InputError
        If there is no model, runs have no common DOF, some have a beam and others not, or their normal forces are not
        one condition.

    Examples
    --------
    >>> from ema.examples import modal_model
    >>> repeats([modal_model(), modal_model()], names=["run 1", "run 2"]).count
    2
    """
    names = tuple(names) or tuple(model.name or f"take {number}" for number, model in enumerate(models, 1))
    given = tuple(assemblies) or ("",) * len(models)
    where = f"repeats of {label or 'one condition'}"
    if not models or len(names) != len(models) or len(given) != len(models):
        raise InputError(
            "models, names and assemblies of repeats do not fit each other",
            where=where,
            got=f"{len(models)}, {len(names)} and {len(given)}",
            expected="one of each per run",
        )
    _refuse_mixed([model.condition for model in models], names, where)
    own = tuple(assembly or f"{name} alone" for assembly, name in zip(given, names, strict=True))
    first = max(range(len(models)), key=lambda place: (len(models[place].poles), -place))
    reference = models[first]
    places = np.full((len(models), len(reference.poles)), -1, dtype=np.int64)
    findings: list[Finding] = []
    for row, model in enumerate(models):
        pairs = _pairs(reference, model, where) if row != first else tuple((i, i) for i in range(places.shape[1]))
        places[row, [i for i, _ in pairs]] = [j for _, j in pairs]
        findings += _unpaired(reference, model, names[first], names[row], pairs, where)
    values, stds = _table(models, places)
    return RepeatGroup(
        label or names[first],
        names,
        own,
        replace(reference, uncertainty=None, findings=()),
        places,
        variance_components(values[..., 0], stds[..., 0], own),
        variance_components(values[..., 1], stds[..., 1], own),
        reference.condition,
        tuple(findings),
    )


def difference(first: RepeatGroup, second: RepeatGroup) -> ConditionDifference:
    """Return what changed from one condition to another, and whether the repeats of both explain it.

    A change is significant where its 95 % interval, from the scatter between the assemblies of both conditions, does
    not contain zero. Each statement stands by itself: of twenty modes that did not change, one is called significant.

    Parameters
    ----------
    first, second : RepeatGroup
        The conditions.

    Returns
    -------
    ConditionDifference
        Changes of the paired modes, with their intervals.

    Raises
    ------
    InputError
        If the conditions have no DOF in common.

    Examples
    --------
    >>> from ema.examples import modal_model
    >>> bare = repeats([modal_model()], label="bare")
    >>> difference(bare, bare).frequency[0].round(3)
    array([40., 40.])
    """
    pairs, values, doubts = _changed(first, second)
    left, right = [i for i, _ in pairs], [j for _, j in pairs]
    frequency = np.stack([first.frequency.mean[left], second.frequency.mean[right]], axis=1)
    damping = np.stack([first.damping.mean[left], second.damping.mean[right]], axis=1)
    halves = [
        half_of_difference(*both, pairs)
        for both in ((first.frequency, second.frequency), (first.damping, second.damping))
    ]
    differs = [
        np.isfinite(half) & (np.abs(own[:, 1] - own[:, 0]) > half)
        for (half, _), own in zip(halves, (frequency, damping), strict=True)
    ]
    difference = ConditionDifference(
        first.label,
        second.label,
        pairs,
        frequency,
        damping,
        halves[0][0],
        halves[1][0],
        halves[0][1],
        halves[1][1],
        differs[0],
        differs[1],
        values,
        (),
    )
    return replace(difference, sentences=_sentences(first, second, difference, doubts))


def conditions(results: Sequence[RunResult]) -> tuple[tuple[RepeatGroup, ...], tuple[ConditionDifference, ...]]:
    """Group the runs of a study by their ``repeat``, and compare every condition with the first one without a beam.

    Runs without that label are conditions of their own. Groups that cannot be one condition are not taken as one; the
    finding of :func:`repeat_findings` says so. Without a run without a beam, the first condition is compared with.

    Parameters
    ----------
    results : sequence of RunResult
        Results of the runs; those without a mode are left out.

    Returns
    -------
    tuple of (tuple of RepeatGroup, tuple of ConditionDifference)
        The conditions, and their differences from the first one; conditions without a common DOF have none.

    Examples
    --------
    >>> from ema.data import RunResult
    >>> from ema.examples import campaign, frf_set, modal_model
    >>> results = [RunResult(run, frf_set(), None, modal_model()) for run in campaign().runs]
    >>> groups, differences = conditions(results)
    >>> [group.label for group in groups], len(differences)
    (['bare', 'beam'], 1)
    """
    fitted = [result for result in results if len(result.modes.poles)]
    grouped: dict[str, list[RunResult]] = {}
    for result in fitted:
        grouped.setdefault(f"repeat {result.run.repeat}" if result.run.repeat else f"run {result.run.id}", []).append(
            result
        )
    groups: list[RepeatGroup] = []
    for members in grouped.values():
        try:
            groups.append(_group(members))
        except InputError:
            groups += [_group([member]) for member in members]
    base = next((group for group in groups if not group.condition.joints), groups[0]) if groups else None
    differences: list[ConditionDifference] = []
    for group in groups:
        if group is base or base is None:
            continue
        try:
            differences.append(difference(base, group))
        except InputError:  # no common DOF: nothing to compare, and the report's comparison says so
            continue
    return tuple(groups), tuple(differences)


def repeat_findings(runs: Sequence[Run]) -> tuple[Finding, ...]:
    """Check the repeat groups of a campaign.

    Parameters
    ----------
    runs : sequence of Run
        Runs of the campaign.

    Returns
    -------
    tuple of Finding
        What is wrong with the groups: a run alone, or runs under other conditions.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from ema.examples import campaign
    >>> alone = replace(campaign().runs[0], repeat="bare")
    >>> [finding.code for finding in repeat_findings([alone])]
    ['repeat-alone']
    """
    labelled: dict[str, list[Run]] = {}
    for run in runs:
        if run.repeat:
            labelled.setdefault(run.repeat, []).append(run)
    findings: list[Finding] = []
    for label, group in labelled.items():
        where = f"repeats of {label}"
        if len({run.assembly or f"{run.id} alone" for run in group}) < 2:
            what = f"only {group[0].id} has this label" if len(group) == 1 else "all runs are takes of one assembly"
            findings.append(
                Finding(
                    "warning",
                    "repeat-alone",
                    where,
                    f"Nothing is repeated: {what}; {NOISE_ONLY}.",
                    advice=(
                        "Loosen and assemble again at least once, better four times, and give each run the same label."
                    ),
                )
            )
        findings += _uneven(group, where)
    return tuple(findings)


def _group(members: Sequence[RunResult]) -> RepeatGroup:
    models, runs = [one.modes for one in members], [one.run for one in members]
    models = [replace(model, condition=run.condition) for model, run in zip(models, runs, strict=True)]
    label = runs[0].repeat if len(runs) > 1 else runs[0].id
    return repeats(models, label, [run.id for run in runs], [run.assembly for run in runs])


def _refuse_mixed(found: Sequence[Condition], names: Sequence[str], where: str) -> None:
    beams = {bool(condition.joints) for condition in found}
    if len(beams) > 1:
        without = next(name for name, condition in zip(names, found, strict=True) if not condition.joints)
        raise InputError(
            "runs with and without a beam are no repeats of one condition",
            where=where,
            got=f"{without} has none",
            advice="give them other labels",
        )
    forces = np.array([condition.normal_force for condition in found])
    if np.isfinite(forces).sum() > 1 and _spread(forces) > ANOTHER:
        raise InputError(
            "the normal forces are too far apart to be one condition",
            where=where,
            got=_listed(forces, names),
            expected=f"a spread below {ANOTHER:.0%} of the mean",
            advice="give runs at another normal force another label",
        )


def _uneven(group: Sequence[Run], where: str) -> list[Finding]:
    names, found = [run.id for run in group], [run.condition for run in group]
    try:
        _refuse_mixed(found, names, where)
    except InputError as error:
        return [
            Finding(
                "error",
                "repeat-conditions-differ",
                where,
                f"Not taken as repeats: {error}.",
                advice="The runs are treated as conditions of their own; correct the label.",
            )
        ]
    findings = []
    forces = np.array([condition.normal_force for condition in found])
    if np.isfinite(forces).sum() > 1 and (spread := _spread(forces)) > UNEVEN:
        findings.append(
            Finding.of(
                "warning",
                "repeat-forces-differ",
                where,
                "The normal force of the repeats spreads over {spread} of its mean ({listed}).",
                spread,
                UNEVEN,
                advice=(
                    "Part of the scatter is the normal force: tighten by the load cell, or label the forces apart."
                ),
                spread=f"{spread:.0%}",
                listed=_listed(forces, names),
            )
        )
    kinds = dict.fromkeys(run.kind for run in group)
    if len(kinds) > 1:
        findings.append(
            Finding.of(
                "warning",
                "repeat-kinds-differ",
                where,
                "The repeats were excited in different ways: {kinds}.",
                advice="Friction depends on the amplitude: part of the scatter is the excitation.",
                kinds=", ".join(kinds),
            )
        )
    return findings


def _spread(forces: Float[np.ndarray, "run"]) -> float:
    return float((np.nanmax(forces) - np.nanmin(forces)) / max(abs(float(np.nanmean(forces))), 1e-300))


def _listed(forces: Float[np.ndarray, "run"], names: Sequence[str]) -> str:
    return ", ".join(f"{name} {force:.4g} N" for name, force in zip(names, forces, strict=True))


def _changed(
    first: RepeatGroup, second: RepeatGroup
) -> tuple[tuple[tuple[int, int], ...], Float[np.ndarray, "pair"], tuple[str, ...]]:
    """Modes of two conditions that are the same for certain, their MAC, and sentences on those that may be several."""
    both = compare(first.reference, second.reference, ALIKE)
    left, right = (group.reference.natural_frequencies for group in (first, second))
    pairs, doubts = [], []
    for (i, j), rivals in zip(both.pairs, both.rivals, strict=True):
        if rivals:
            doubts.append(doubt(i, (j, *rivals), left[i], second.label))
        elif abs(np.log(right[j] / left[i])) <= SHIFTED:
            pairs.append((i, j))
    return tuple(pairs), np.array([both.mac[pair] for pair in pairs], dtype=np.float64), tuple(doubts)


def doubt(mode: int, like: Sequence[int], frequency: float, other: str) -> str:
    """The sentence on a mode that resembles several of another run or condition; modes from 0."""
    return text(
        "Mode {mode} ({frequency} Hz) resembles modes {rivals} of {run}: not counted.",
        mode=mode + 1,
        frequency=f"{frequency:.4g}",
        rivals=listed([str(k + 1) for k in sorted(like)]),
        run=other,
    )


def _pairs(first: ModalModel, second: ModalModel, where: str) -> tuple[tuple[int, int], ...]:
    """Modes of one condition with like shapes and near frequencies, the best assignment of all."""
    from scipy.optimize import linear_sum_assignment

    common = match(first.dofs, second.dofs)
    if not common:
        raise InputError(
            "the runs have no DOF in common",
            where=where,
            got=f"{len(first.dofs)} and {len(second.dofs)} DOFs",
            advice="compare runs measured on the same points",
        )
    rows, places, signs = (np.array(column) for column in zip(*common, strict=True))
    alike = np.nan_to_num(mac(first.shapes[rows], second.shapes[places] * signs[:, None]))
    shift = np.abs(np.log(second.natural_frequencies[None, :] / first.natural_frequencies[:, None]))
    possible = (alike >= ALIKE) & (shift <= NEAR)
    # with few DOFs the shapes cannot tell the modes apart, and the frequencies decide
    left, right = linear_sum_assignment(np.where(possible, 1 - alike + shift / NEAR, 1e3))
    return tuple((int(i), int(j)) for i, j in zip(left, right, strict=True) if possible[i, j])


def _unpaired(
    reference: ModalModel, model: ModalModel, first: str, second: str, pairs: tuple[tuple[int, int], ...], where: str
) -> list[Finding]:
    findings = []
    for one, own, other, taken in (
        (reference, first, second, {i for i, _ in pairs}),
        (model, second, first, {j for _, j in pairs}),
    ):
        for mode in sorted(set(range(len(one.poles))) - taken):
            frequency = float(one.natural_frequencies[mode])
            findings.append(
                Finding.of(
                    "warning",
                    "repeat-mode-unpaired",
                    f"{where}, {frequency:.6g} Hz",
                    "The mode of {own} at {frequency} Hz has no partner in {other}.",
                    frequency,
                    advice=(
                        "Look at both stabilisation diagrams: without the partner its scatter rests on fewer repeats."
                    ),
                    own=own,
                    frequency=f"{frequency:.6g}",
                    other=other,
                )
            )
    return findings


def _table(
    models: Sequence[ModalModel], places: np.ndarray
) -> tuple[Float[np.ndarray, "run mode 2"], Float[np.ndarray, "run mode 2"]]:
    """Natural frequencies and damping ratios of the paired modes, and their standard deviations; NaN where none."""
    values, stds = np.full((2, *places.shape, 2), np.nan)
    for row, (model, own) in enumerate(zip(models, places, strict=True)):
        there = own >= 0
        values[row, there] = np.stack([model.natural_frequencies, model.damping_ratios], axis=1)[own[there]]
        if model.covariance is not None:
            stds[row, there] = np.sqrt(np.maximum(model.covariance[own[there]][:, [0, 1], [0, 1]], 0))
    return values, stds


def _sentences(
    first: RepeatGroup, second: RepeatGroup, found: ConditionDifference, doubts: tuple[str, ...]
) -> tuple[str, ...]:
    names = {"condition": second.label, "base": first.label}
    also = doubts if len(second.runs) > 1 else ()  # of a single run, its comparison says so
    if not found.pairs and doubts:
        head = text("{run} against {base}", run=second.label, base=first.label)
        return (text("{head}: no certain pair of modes.", head=head), *also)
    if not found.pairs:
        return (text("{condition} against {base}: no two modes are alike.", **names),)
    known = found.known
    if not known.any():
        return (text(_NOTHING_SAID, conditions=second.label, base=first.label), *also)
    said = [
        text(
            "{condition} against {base}, {first} and {second} repeats: {change}",
            **names,
            first=first.count,
            second=second.count,
            change=change,
        )
        for change in (
            _change(word("damping"), "%", found, found.damping_differs, 100 * found.damping, 100 * found.damping_half),
            _change(word("frequency"), "Hz", found, found.frequency_differs, found.frequency, found.frequency_half),
        )
    ]
    if not known.all():
        said.append(
            text(
                "{condition} against {base}: for {number} further modes, noise only; assembly scatter unknown.",
                **names,
                number=int(np.sum(~known)),
            )
        )
    return (*said, *also)


def _change(
    name: str,
    unit: str,
    found: ConditionDifference,
    differs: Bool[np.ndarray, "pair"],
    values: Float[np.ndarray, "pair 2"],
    half: Float[np.ndarray, "pair"],
) -> str:
    """One sentence on damping or frequency: how many modes changed significantly, and the clearest of them."""
    number = int(found.known.sum())
    if not differs.any():
        return text("{quantity} shows no significant change in any of {number} modes.", quantity=name, number=number)
    change = values[:, 1] - values[:, 0]
    higher, lower = int(np.sum(differs & (change > 0))), int(np.sum(differs & (change < 0)))
    if not lower:
        counted = text("higher in {higher}", higher=higher)
    elif not higher:
        counted = text("lower in {lower}", lower=lower)
    else:
        counted = text("higher in {higher} and lower in {lower}", higher=higher, lower=lower)
    best = int(np.argmax(np.where(differs, np.abs(change) / np.maximum(half, 1e-300), -1.0)))
    return text(
        "{quantity} is significantly {counted} of {number} modes; most clearly at {frequency} Hz: {before} to {after} "
        "{unit}, {change} ± {half} {unit} (95 %).",
        quantity=name,
        counted=counted,
        number=number,
        frequency=f"{found.frequency[best, 0]:.4g}",
        before=f"{values[best, 0]:.5g}",
        after=f"{values[best, 1]:.5g}",
        unit=unit,
        change=f"{change[best]:+.2g}",
        half=f"{half[best]:.2g}",
    )


def difference_sentences(differences: Sequence[ConditionDifference]) -> list[str]:
    """What changed between conditions, in words: one sentence for all conditions of which nothing can be said.

    Parameters
    ----------
    differences : sequence of ConditionDifference
        Changes from one condition to others.

    Returns
    -------
    list of str
        Sentences, in the order of the differences; those that say the same are joined where the first of them stands.

    Examples
    --------
    >>> from ema.compare import difference, repeats
    >>> from ema.examples import modal_model
    >>> bare, soft, hard = (repeats([modal_model()], label=name) for name in ("bare", "1 kN", "5 kN"))
    >>> difference_sentences([difference(bare, soft), difference(bare, hard)])
    ['1 kN and 5 kN against bare: noise only; assembly scatter unknown. No change is called significant.']
    """
    silent: dict[str, list[str]] = {}
    for one in differences:
        if one.sentences[0] == text(_NOTHING_SAID, conditions=one.second, base=one.first):
            silent.setdefault(one.first, []).append(one.second)
    sentences: list[str] = []
    for one in differences:
        seconds = silent.get(one.first, [])
        if one.second not in seconds:
            sentences += one.sentences
        elif one.second == seconds[0]:
            sentences.append(text(_NOTHING_SAID, conditions=listed(seconds), base=one.first))
            alike = [other for other in differences if other.first == one.first and other.second in seconds]
            sentences += [sentence for other in alike for sentence in other.sentences[1:]]
    return sentences
