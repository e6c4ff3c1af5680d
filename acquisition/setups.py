"""FRFs measured file by file or set-up by set-up, joined into one set."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.ndimage
from jaxtyping import Bool, Complex, Float

from ema.data import Deviations, Finding, FrfSet, SetUps
from ema.dof import Dof
from ema.errors import InputError
from ema.units import STANDARD_GRAVITY

SHIFT_LIMIT = 1e-3
"""Relative frequency shift between set-ups from which it is a warning: merged shapes suffer from about there on."""

GAIN_LIMIT = 0.2
"""Relative difference of the level of an FRF measured in two set-ups from which it is a warning.

Calibrated sensors and hammers agree to a few percent. A limit of 0.1 would name sensors at the end of their tolerance,
one of 0.4 still names g taken for m/s^2 and a wrong range of an amplifier.
"""

_OUT = 0
"""Side of the responses."""
_IN = 1
"""Side of the forces."""
_WIDEST = 0.05
"""Relative shift of resonances between set-ups up to which it is looked for: 5 % to either side."""
_RESEMBLANCE = 0.5
"""Correlation of the levels of two set-ups below which their shift is not trusted, and a finding says so."""
_COHERENT = 0.8
"""Coherence beyond whose last line, smoothed, FRFs contain noise alone."""
_SMOOTHED = 31
"""Lines over which the median of the coherence is taken, so that single lines do not count."""
_REVERSED = 0.2
"""Share of lines with one sign in both set-ups below which one of them is turned round; noise alone gives a half."""


@dataclass(frozen=True)
class Part:
    """FRFs of one file, and the sensor set-up that they belong to.

    Parameters
    ----------
    frfs : FrfSet
        The FRFs.
    setup : str, optional
        Name of the set-up; empty where the run has only one.
    file : str, optional
        Name of the file.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> Part(frf_set(), setup="A").setup
    'A'
    """

    frfs: FrfSet
    setup: str = ""
    file: str = ""


def merge(parts: Sequence[Part], name: str = "") -> FrfSet:
    """Join FRFs of several files into one set with every output for every input.

    A roving hammer brings inputs, roving accelerometers bring outputs. A DOF measured in opposite senses by two files
    keeps the sense in which it came first. FRFs that several set-ups have in common are taken from the first of them.
    What differs between set-ups is a finding (see ``set_up_findings``).

    Parameters
    ----------
    parts : sequence of Part
        FRFs of the files.
    name : str, optional
        What the set is called.

    Returns
    -------
    FrfSet
        One set.

    Raises
    ------
    InputError
        If there are no FRFs, frequency axes differ, units are mixed, an FRF was measured twice in one set-up, or one is
        missing.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> frfs = frf_set()
    >>> len(merge([Part(frfs.pick(outputs=[0, 1])), Part(frfs.pick(outputs=[2, 3]))]).outputs)
    4
    """
    if not parts:
        raise InputError("no FRFs to merge", where=name, expected="those of one file or more")
    first = parts[0]
    for part in parts[1:]:
        _refuse_other_kind(first, part, name)
    senses = _senses(parts)
    outputs, inputs = ([dof for dof, side in senses if side == wanted] for wanted in (_OUT, _IN))
    signed_outputs = tuple(dof if senses[dof, _OUT] > 0 else dof.reversed() for dof in outputs)
    signed_inputs = tuple(dof if senses[dof, _IN] > 0 else dof.reversed() for dof in inputs)
    owners = _owners(parts, outputs, inputs, senses, name)
    shape = (len(first.frfs.frequencies), len(outputs), len(inputs))
    values = np.zeros(shape, complex)
    coherence = _blank(shape, any(part.frfs.coherence is not None for part in parts))
    variance = _blank(shape, any(part.frfs.variance is not None for part in parts))
    averages = _blank(shape[1:], any(part.frfs.averages is not None for part in parts))
    for row, column in np.ndindex(shape[1:]):
        if (row, column) not in owners:
            raise InputError(
                "an FRF is missing",
                where=name,
                got=f"no {signed_outputs[row]}/{signed_inputs[column]}",
                expected=f"all of {len(outputs)} outputs x {len(inputs)} inputs",
                advice="measure it, or put the files with other outputs and inputs into a run of their own",
            )
        part, place, sign = owners[row, column]
        values[:, row, column] = sign * part.frfs.values[:, *place]
        _copy(coherence, part.frfs.coherence, (row, column), place)
        _copy(variance, part.frfs.variance, (row, column), place)
        if averages is not None and part.frfs.averages is not None:
            averages[row, column] = part.frfs.averages[place]
    findings = (
        *(finding for part in parts for finding in part.frfs.findings),
        *set_up_findings(parts, name),
    )
    return replace(
        first.frfs,
        values=values,
        outputs=signed_outputs,
        inputs=signed_inputs,
        coherence=coherence,
        variance=variance,
        averages=averages,
        findings=findings,
        name=name or first.frfs.name,
        deviations=_deviations(parts, owners, shape),
        set_ups=_set_ups(owners, shape[1:]),
    )


def _set_ups(
    owners: Mapping[tuple[int, int], tuple[Part, tuple[int, int], int]], shape: tuple[int, ...]
) -> SetUps | None:
    """Which set-up each FRF of the joined set is from; ``None`` where there is one."""
    names = tuple(dict.fromkeys(part.setup for part, _, _ in owners.values()))
    if len(names) < 2:
        return None
    number = np.zeros(shape, int)
    for cell, (part, _, _) in owners.items():
        number[cell] = names.index(part.setup)
    return SetUps(names, number)


def _deviations(
    parts: Sequence[Part], owners: Mapping[tuple[int, int], tuple[Part, tuple[int, int], int]], shape: tuple[int, ...]
) -> Deviations | None:
    """What single impacts changed; those of two parts are never the same impact."""
    deviations = [part.frfs.deviations for part in parts]
    most = max((len(each.blows) for each in deviations if each is not None), default=0)
    if not most:
        return None
    counts = [0 if each is None else int(each.blows.max(initial=-1)) + 1 for each in deviations]
    first = {id(part): sum(counts[:place]) for place, part in enumerate(parts)}
    values, impacts = np.zeros((most, *shape), np.complex64), np.full((most, *shape[1:]), -1)
    for cell, (part, place, sign) in owners.items():
        own = part.frfs.deviations
        if own is not None:
            some = slice(0, len(own.blows))
            values[some, :, *cell] = sign * own.values[:, :, *place]
            number = own.blows[:, *place]
            impacts[some, *cell] = np.where(number < 0, -1, number + first[id(part)])
    return Deviations(values, impacts)


def _owners(
    parts: Sequence[Part], outputs: list[Dof], inputs: list[Dof], senses: dict[tuple[Dof, int], int], name: str
) -> dict[tuple[int, int], tuple[Part, tuple[int, int], int]]:
    """For each cell of the joined set: the part it comes from, the place there, and the sign by which it changes."""
    rows, columns = ({dof: place for place, dof in enumerate(dofs)} for dofs in (outputs, inputs))
    owners: dict[tuple[int, int], tuple[Part, tuple[int, int], int]] = {}
    for part in parts:
        for place in np.ndindex(len(part.frfs.outputs), len(part.frfs.inputs)):
            output, input_ = part.frfs.outputs[place[0]], part.frfs.inputs[place[1]]
            cell = rows[output.positive], columns[input_.positive]
            if cell in owners:
                _refuse_double(owners[cell][0], part, part.frfs.label(*place), name)
                continue
            sign = output.sign * senses[output.positive, _OUT] * input_.sign * senses[input_.positive, _IN]
            owners[cell] = part, (place[0], place[1]), sign
    return owners


def set_up_findings(parts: Sequence[Part], name: str = "") -> tuple[Finding, ...]:
    """How far the resonances of each set-up lie from those of the first, as moved sensors load the structure elsewhere;
    and in which level and sign the FRFs differ that both have measured."""
    labels = list(dict.fromkeys(part.setup for part in parts))
    findings = []
    for label in labels[1:]:
        shift, resemblance = relative_shift(
            [part.frfs for part in parts if part.setup == labels[0]],
            [part.frfs for part in parts if part.setup == label],
        )
        where = f"{name}, set-up {label}"
        if resemblance < _RESEMBLANCE:
            findings.append(
                Finding.of(
                    "warning",
                    "setup-shift",
                    where,
                    "The FRFs of set-up {label} resemble those of {other} too little to compare their resonances "
                    "(correlation {correlation}).",
                    resemblance,
                    _RESEMBLANCE,
                    advice="Check that both were measured on the same structure.",
                    label=label,
                    other=labels[0],
                    correlation=f"{resemblance:.2f}",
                )
            )
            continue
        large = abs(shift) > SHIFT_LIMIT
        findings.append(
            Finding(
                "warning" if large else "info",
                "setup-shift",
                where,
                f"The resonances of set-up {label} lie {100 * abs(shift):.3f} % "
                f"{'above' if shift > 0 else 'below'} those "
                f"of set-up {labels[0]}.",
                shift,
                SHIFT_LIMIT,
                "Leave the sensors of all set-ups on the structure (or dummy masses in their places), or "
                "fit each set-up "
                "by itself."
                if large
                else "",
            )
        )
        findings += _level_findings(parts, (labels[0], label), where)
    return tuple(findings)


def _level_findings(parts: Sequence[Part], setups: tuple[str, str], where: str) -> list[Finding]:
    """Level and sign of the FRFs that two set-ups have in common: a unit, a sensitivity or a sense may be wrong."""
    former, latter = (_positive_frfs([part.frfs for part in parts if part.setup == label]) for label in setups)
    return [
        finding
        for cell, values in former.items()
        if cell in latter
        for finding in _level_finding(values, latter[cell], f"{where}, {cell[0]}/{cell[1]}", setups)
    ]


def _positive_frfs(frfs: Sequence[FrfSet]) -> dict[tuple[Dof, Dof], Complex[np.ndarray, " freq"]]:
    """FRFs by their DOFs, all in positive directions."""
    return {
        (output.positive, input_.positive): output.sign * input_.sign * frf.values[:, row, column]
        for frf in frfs
        for row, output in enumerate(frf.outputs)
        for column, input_ in enumerate(frf.inputs)
    }


def _level_finding(
    former: Complex[np.ndarray, " freq"], latter: Complex[np.ndarray, " freq"], where: str, setups: tuple[str, str]
) -> list[Finding]:
    """The median over the lines is the level: resonances that moved a little or are damped otherwise do not count."""
    both = (np.abs(former) > 0) & (np.abs(latter) > 0)
    if not both.any():
        return []
    ratio = latter[both] / former[both]
    gain, same = float(np.median(np.abs(ratio))), float(np.mean(ratio.real > 0))
    findings = []
    if max(gain, 1 / gain) > 1 + GAIN_LIMIT:
        gravity = abs(max(gain, 1 / gain) / STANDARD_GRAVITY - 1) < GAIN_LIMIT
        findings.append(
            Finding.of(
                "error",
                "setup-level",
                where,
                "The FRF is {times} times as large in set-up {other} as in {setup}, as if g had been taken for m/s^2."
                if gravity
                else "The FRF is {times} times as large in set-up {other} as in {setup}.",
                gain,
                1 + GAIN_LIMIT,
                advice=(
                    "Correct the unit or the sensitivity of one of the set-ups by a repair; shapes hold within "
                    "each set-up only."
                ),
                times=f"{gain:.3g}",
                other=setups[1],
                setup=setups[0],
            )
        )
    if same < _REVERSED:
        findings.append(
            Finding.of(
                "error",
                "setup-sign",
                where,
                "The FRF has opposite signs in set-ups {setup} and {other} ({share} % of the lines): a "
                "sensor or the force was turned round.",
                same,
                _REVERSED,
                advice='Turn it back by a repair: what = "reverse sign".',
                setup=setups[0],
                other=setups[1],
                share=f"{100 * (1 - same):.0f}",
            )
        )
    return findings


def relative_shift(former: Sequence[FrfSet], latter: Sequence[FrfSet]) -> tuple[float, float]:
    """Relative frequency shift of the resonances of ``latter`` against ``former``, and the correlation it leaves.

    On a logarithmic frequency axis a relative shift is a translation. The level of each set-up is
    ``log(1 + P / G)`` with the power P of its FRFs (each scaled to unit mean square, then summed) and the geometric
    mean G of P over the surroundings (+-20 % of the frequency): resonances count by their height in log |H|,
    antiresonances and the noise between hardly at all. Where both set-ups measure the same FRFs, only those enter.
    The shift maximises the correlation of the two levels within +-5 %, refined by a parabola through the three points
    at the maximum.
    """
    frequencies = former[0].frequencies
    used = (frequencies > 0.02 * frequencies[-1]) & (frequencies <= _heard(former, latter))
    axis = np.log(frequencies[used])
    points = min(int(4 * (axis[-1] - axis[0]) / (axis[-1] - axis[-2])), 2**17)
    grid = np.linspace(axis[0], axis[-1], points)
    step = grid[1] - grid[0]
    common = _cells(former) & _cells(latter)
    reach = max(int(_WIDEST / step), 1)
    levels = [_level(group, common, used, axis, grid, 4 * reach) for group in (former, latter)]
    correlation = _correlation(levels[0], levels[1], reach)
    best = int(np.argmax(correlation))
    peak = float(correlation[best])
    offset = 0.0
    if 0 < best < len(correlation) - 1:
        before, after = correlation[best - 1], correlation[best + 1]
        offset = float((before - after) / (2 * (before - 2 * peak + after)))
    return float(np.expm1((best - reach + offset) * step)), peak


def _heard(former: Sequence[FrfSet], latter: Sequence[FrfSet]) -> float:
    """The highest frequency in Hz with a sound coherence in both set-ups; what the force does not reach is noise."""
    frequencies = former[0].frequencies
    sound = np.ones(len(frequencies), bool)
    for group in (former, latter):
        known = [frf.coherence.reshape(len(frequencies), -1) for frf in group if frf.coherence is not None]
        if known:
            middle = np.median(np.nan_to_num(np.hstack(known), nan=1.0), axis=1)
            sound &= scipy.ndimage.median_filter(middle, _SMOOTHED, mode="nearest") >= _COHERENT
    return float(frequencies[sound][-1]) if np.count_nonzero(sound) > len(sound) // 8 else float(frequencies[-1])


def _cells(group: Sequence[FrfSet]) -> set[tuple[Dof, Dof]]:
    return {(output.positive, input_.positive) for frf in group for output in frf.outputs for input_ in frf.inputs}


def _level(
    group: Sequence[FrfSet],
    common: set[tuple[Dof, Dof]],
    used: Bool[np.ndarray, "freq"],
    axis: Float[np.ndarray, "line"],
    grid: Float[np.ndarray, "point"],
    width: int,
) -> Float[np.ndarray, "point"]:
    """Height of the FRFs of a set-up above their surroundings, on the logarithmic ``grid``."""
    power = np.zeros(len(axis))
    for frf in group:
        for row, output in enumerate(frf.outputs):
            for column, input_ in enumerate(frf.inputs):
                if not common or (output.positive, input_.positive) in common:
                    magnitude = np.abs(frf.values[used, row, column])
                    power += (magnitude / (np.sqrt(np.mean(magnitude**2)) or 1.0)) ** 2
    logs = np.interp(grid, axis, np.log(np.maximum(power, np.finfo(float).tiny)))
    total = np.concatenate([[0.0], np.cumsum(logs)])
    index = np.arange(len(logs))
    low, high = np.maximum(index - width, 0), np.minimum(index + width + 1, len(logs))
    above = np.logaddexp(0.0, logs - (total[high] - total[low]) / (high - low))
    return np.asarray(above - above.mean())


def _correlation(
    former: Float[np.ndarray, "point"], latter: Float[np.ndarray, "point"], reach: int
) -> Float[np.ndarray, "lag"]:
    """Correlation coefficient of ``former[k]`` and ``latter[k + lag]`` for lags from -reach to reach."""
    length = len(former) + reach
    spectrum = np.conj(np.fft.rfft(former, 2 * length)) * np.fft.rfft(latter, 2 * length)
    lags = np.fft.irfft(spectrum, 2 * length)
    chosen = np.concatenate([lags[-reach:], lags[: reach + 1]])
    norm = np.linalg.norm(former) * np.linalg.norm(latter)
    return chosen / norm if norm > 0 else np.zeros_like(chosen)


def _refuse_other_kind(first: Part, part: Part, name: str) -> None:
    axis, other = first.frfs.frequencies, part.frfs.frequencies
    if len(axis) != len(other) or not np.allclose(axis, other, rtol=1e-7, atol=1e-3 * first.frfs.frequency_step):
        raise InputError(
            "unequal frequency axes",
            where=f"{name}, {part.file}",
            got=_axis(part.frfs),
            expected=_axis(first.frfs),
            advice=f"put it into a run of its own ({first.file or 'the first file'} has the other axis)",
        )
    if (first.frfs.quantity, first.frfs.unit) != (part.frfs.quantity, part.frfs.unit):
        raise InputError(
            "mixed units",
            where=f"{name}, {part.file}",
            got=f"{part.frfs.quantity} in {part.frfs.unit}",
            expected=f"{first.frfs.quantity} in {first.frfs.unit} as in {first.file or 'the first file'}",
            advice="put it into a run of its own, or correct its unit by a repair",
        )
    if first.frfs.added_decay != part.frfs.added_decay:
        raise InputError(
            "files with different exponential windows",
            where=f"{name}, {part.file}",
            got=f"{part.frfs.added_decay:g} rad/s of added decay",
            expected=f"{first.frfs.added_decay:g} rad/s as in {first.file or 'the first file'}",
            advice="put it into a run of its own",
        )


def _axis(frf: FrfSet) -> str:
    return (
        f"{len(frf.frequencies)} lines, {frf.frequencies[0]:g} to {frf.frequencies[-1]:g} Hz "
        f"in steps of {frf.frequency_step:.6g} Hz"
    )


def _refuse_double(former: Part, latter: Part, label: str, name: str) -> None:
    if former.setup == latter.setup:
        raise InputError(
            "an FRF was measured twice in one set-up",
            where=name,
            got=f"{label} in {former.file} and {latter.file}",
            advice='state the point of each file (dof = "{point}:+Z"), its set-up, or exclude one by a repair',
        )


def _senses(parts: Sequence[Part]) -> dict[tuple[Dof, int], int]:
    """The sense in which each DOF came first, as output and as input, in that order."""
    senses: dict[tuple[Dof, int], int] = {}
    for part in parts:
        for side, dofs in ((_OUT, part.frfs.outputs), (_IN, part.frfs.inputs)):
            for dof in dofs:
                senses.setdefault((dof.positive, side), dof.sign)
    return senses


def _blank(shape: tuple[int, ...], wanted: bool) -> "np.ndarray | None":
    return np.full(shape, np.nan) if wanted else None


def _copy(
    target: "np.ndarray | None", source: "np.ndarray | None", cell: tuple[int, int], place: tuple[int, int]
) -> None:
    if target is not None and source is not None:
        target[:, *cell] = source[:, *place]
