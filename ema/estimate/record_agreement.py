"""Whether the records of a test, the blocks of one, or the impacts at a point, give each channel the same FRFs.

A sensor that comes loose, an amplifier that changes its range or a plug that is turned between two records changes one
channel against the others. The mean of the records is then the FRF of no structure, with small intervals.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Complex, Float

from ema.data import Finding, Run
from ema.estimate import channels as channel_roles
from ema.estimate.single_impacts import KEPT

LEVEL = 0.2
"""Difference of a channel's level between records, against the other channels, above which it is named.

As for FRFs that two set-ups measured (``setup-level``). Half of it would name channels whose modes change with the
level; twice as much would miss a gain that was changed by 3 dB.
"""

LEVEL_OF_IMPACTS = 1.0
"""The same for impacts, whose levels scatter: a mode whose damping ratio follows them changes the gain of its FRFs by
less than a factor of two, as long as their coherence is above ``ALIKE``.

Damping ratios that differ by a factor of r leave a coherence of 4 r / (1 + r)^2, 0.8 for r = 2.6, and a gain of
2 r / (1 + r) or its counterpart, 1.4 and 0.6.
"""

ALIKE = 0.8
"""Coherence of the FRFs of a record with those of the others from which on they differ in their level alone."""

LOST = 0.3
"""The same coherence below which a channel shows nothing of what it shows in the other records."""


FORCE = 1.3
"""Ratio of the force levels of the records of a run above which they are no repeats of one level.

Control and drop-out leave a tenth or two; levels that are meant to differ do so by half as much again or more.
"""

OFTEN = 99.0
"""Percentile of the magnitude of a force that stands for its level, whether it is a sine or noise, with pauses."""


@dataclass(frozen=True)
class Block:
    """FRFs of one record or block, with the inverse of their variance (or its square of the force) as weight."""

    name: str
    values: Complex[np.ndarray, "freq out in"]
    weight: Float[np.ndarray, "freq out in"]


@dataclass
class SingleBlocks:
    """The FRFs of single records or blocks, as long as they are small, and the number of all."""

    blocks: list[Block] = field(default_factory=list)
    size: int = 0
    count: int = 0

    def keep(
        self, name: str, values: Complex[np.ndarray, "freq out in"], weight: Float[np.ndarray, "freq out in"]
    ) -> None:
        """Add a block."""
        self.count += 1
        self.size += values.nbytes + weight.nbytes
        self.blocks = [*self.blocks, Block(name, values, weight)] if self.size <= KEPT else []


def about_records(single: SingleBlocks, names: Sequence[str], where: str) -> tuple[Finding, ...]:
    """One finding for each response whose FRFs are of another level or sign in one of the blocks, or lost there.

    ``names`` are those of the response channels. Of one or two nobody knows which of them changed its level; a sign
    that is turned has no other cause.
    """
    return _about_blocks(single.blocks, names, where, limit=LEVEL, lost_below=LOST)


def about_impacts(single: SingleBlocks, names: Sequence[str], where: str) -> tuple[Finding, ...]:
    """The same of the impacts at a point, where a response near a node may show nothing but noise."""
    return _about_blocks(single.blocks, names, where, limit=LEVEL_OF_IMPACTS, lost_below=0.0)


def _about_blocks(
    blocks: Sequence[Block], names: Sequence[str], where: str, *, limit: float, lost_below: float
) -> tuple[Finding, ...]:
    if len(blocks) < 2:
        return ()
    known, total = _known(blocks[0]), _known(blocks[0]) * blocks[0].values
    for block in blocks[1:]:
        known, total = known + _known(block), total + _known(block) * block.values
    gains, alike = zip(*(_against_others(block, known, total) for block in blocks))
    gain, coherence = np.array(gains), np.array(alike)
    negative = (gain.real < 0) & (coherence > ALIKE)
    if (turned := np.flatnonzero(negative.all(axis=1))).size:
        return (_all_turned(blocks[int(turned[0])].name or f"record {turned[0] + 1}", where),)
    few = len(names) < 3
    usual = np.median(coherence, axis=1) > (-1.0 if few else ALIKE)
    size = np.abs(gain) / np.maximum(np.median(np.abs(gain), axis=1, keepdims=True), 1e-300)
    level = np.zeros_like(size) if few else np.abs(np.log(np.maximum(size, 1e-300)))
    level = np.where(negative, np.inf, np.where(coherence > ALIKE, level, 0.0))
    findings = []
    for row, name in enumerate(names):
        worst = int(np.argmax(np.where(usual, level[:, row], 0.0)))
        lost = np.flatnonzero(usual & (coherence[:, row] < lost_below) & (not few))
        reversed_there = bool(usual[worst] and np.isinf(level[worst, row]))
        if len(lost) == len(blocks):
            findings.append(_noise_only(f"{where}, channel {name}", float(coherence[:, row].max())))
            continue
        if len(lost) and not reversed_there:
            worst = int(lost[np.argmin(coherence[lost, row])])
            said, value = "have nothing in common with", float(coherence[worst, row])
        elif usual[worst] and level[worst, row] > np.log1p(limit):
            value = -1.0 if reversed_there else float(size[worst, row])
            said = "have the opposite sign of" if reversed_there else f"are {value:.3g} times as large as"
        else:
            continue
        findings.append(
            Finding(
                "error",
                "records-disagree",
                f"{where}, channel {name}",
                f"the FRFs of this channel from {blocks[worst].name or f'record {worst + 1}'} {said} those of the "
                "rest, and those of most other channels agree: their mean is the FRF of no structure.",
                value,
                limit,
                "Look for a loose sensor, a changed range or a turned plug; correct the channel by a repair, or leave "
                "out the record or the channel.",
            )
        )
    return tuple(findings)


def _all_turned(block: str, where: str) -> Finding:
    """What is to be said of a block whose FRFs all have the opposite sign."""
    return Finding.of(
        "error",
        "records-disagree",
        where,
        "all FRFs from {block} have the opposite sign of those of the rest: their mean is the FRF of no structure.",
        -1.0,
        0.0,
        advice="Look for a turned plug of the force channel, or of the only response; correct it by a repair.",
        block=block,
    )


def about_levels(run: Run) -> tuple[Finding, ...]:
    """A finding where the records of a random or swept test were not driven at one level."""
    levels: dict[str, list[float]] = {}
    for record in run.recordings:
        layout = channel_roles.layout(record, channel_roles.describe(run, record))
        for row, dof in zip(layout.references, layout.inputs, strict=True):
            force = record.signals[row]
            levels.setdefault(str(dof), []).append(float(np.percentile(np.abs(force - np.median(force)), OFTEN)))
    where = channel_roles.describe(run)
    return tuple(finding for dof, each in levels.items() for finding in about_level(each, f"{where}, force at {dof}"))


def about_level(levels: Sequence[float], where: str) -> tuple[Finding, ...]:
    """A finding where force levels that make one mean differ."""
    low, high = min(levels), max(levels)
    if high <= FORCE * low or low <= 0:
        return ()
    return (
        Finding.of(
            "warning",
            "levels-in-one-run",
            where,
            "the force of the records runs from {low} to {high}: where a joint moves, their mean is the "
            "FRF of no level, and intervals do not contain that.",
            high / low,
            FORCE,
            advice="Make a run of the records of each level; for a linear structure the mean is right.",
            low=f"{low:.3g}",
            high=f"{high:.3g}",
        ),
    )


def _noise_only(where: str, coherence: float) -> Finding:
    """What is to be said of a channel whose FRFs are others in every record."""
    return Finding(
        "error",
        "records-disagree",
        where,
        "the FRFs of this channel have nothing in common from record to record, while those of most other channels "
        "agree: it shows noise.",
        coherence,
        LOST,
        "Check the sensor and its cable, or leave the channel out.",
    )


def _known(block: Block) -> Float[np.ndarray, "freq out in"]:
    """Weights of a block, the largest of each FRF 1: every block counts once, also where its noise is that of a sensor
    which fell off."""
    return np.asarray(block.weight / np.maximum(block.weight.max(axis=0), 1e-300))


def _against_others(
    block: Block, known: Float[np.ndarray, "freq out in"], total: Complex[np.ndarray, "freq out in"]
) -> tuple[Complex[np.ndarray, "out"], Float[np.ndarray, "out"]]:
    """Gain and coherence of the FRFs of a block with the mean of those of the others, for each output.

    ``known`` and ``total`` are the sums of the weights of all blocks, and of their FRFs with these. Lines count where
    both have something to say: records may be driven in different bands.
    """
    own, own_known = block.values, _known(block)
    others = np.maximum(known - own_known, 0.0)
    others = np.where(others > 1e-9 * known, others, 0.0)  # what is left of a difference by rounding is nothing
    rest = total - own_known * own
    mean = np.divide(rest, others, out=np.zeros_like(rest), where=others > 0)
    both = own_known + others
    weight = np.divide(own_known * others, both, out=np.zeros_like(both), where=both > 0)
    cross = np.sum(weight * mean.conj() * own, axis=(0, 2))
    power = np.sum(weight * np.abs(mean) ** 2, axis=(0, 2))
    own_power = np.sum(weight * np.abs(own) ** 2, axis=(0, 2))
    gain = np.divide(cross, power, out=np.ones_like(cross), where=power > 0)
    size = power * own_power
    coherence = np.divide(np.abs(cross) ** 2, size, out=np.zeros_like(size), where=size > 0)
    return gain, coherence
