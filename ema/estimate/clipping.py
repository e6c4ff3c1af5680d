"""Channels of a test that were overloaded: cut off at a level that many samples share."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ema.data import Channel, Finding, Recording, Run
from ema.estimate import channels
from ema.estimate.judge import FULL_SCALE, TOLERATED

EQUAL = 5
"""Samples on the extreme of a signal, and how many times as often it occurs as values just below, that show a limit.

Two or three samples of a coarse converter may agree by chance; a signal that repeats has each of its values as often.
"""

BELOW = 8
"""Values just below the extreme that are counted for comparison."""

NEAR = 0.02
"""Part of the height of an extreme below it where an unlimited signal has more samples than on the extreme itself.

A sine has 6 % of its samples there, random noise fewer than one in a thousand; of a sine that is cut off by 1 %, 4.5 %
are on its limit and 3.3 % just below.
"""


def about_records(run: Run) -> tuple[Finding, ...]:
    """One finding for each channel that was overloaded in records of ``run``."""
    return (*_of_vibration(run), *about_normal_forces(run))


def about_normal_forces(run: Run) -> tuple[Finding, ...]:
    """One finding for each normal force that was cut off in a record of ``run``: its mean is too low."""
    findings: dict[str, Finding] = {}
    if not (len(run.recordings) and run.recordings[0].with_role("normal force")):
        return ()
    for record in run.recordings:
        for row in record.with_role("normal force"):
            found, channel = overloaded(record, row), record.channels[row]
            if found is None or channel.name in findings:
                continue
            limit = "" if np.isnan(found[1]) else f" at {found[1]:.4g} N in {100 * found[0]:.2g} % of its samples"
            findings[channel.name] = Finding(
                "error" if found[0] > TOLERATED else "warning",
                "overload",
                f"{channels.describe(run, record)}, channel {channel.name}",
                f"the normal force is cut off{limit}: its mean, with which the modes are stated, is wrong.",
                found[0],
                TOLERATED,
                "Raise the range of the load cell's amplifier, and measure again.",
            )
    return tuple(findings.values())


def _of_vibration(run: Run) -> tuple[Finding, ...]:
    worst: dict[int, tuple[float, float, str]] = {}
    count: dict[int, int] = {}
    first: Sequence[Channel] = ()
    for record in run.recordings:
        layout = channels.layout(record, channels.describe(run, record))
        first = first or record.channels
        for row in (*layout.references, *layout.responses):
            overload = overloaded(record, row)
            if overload is not None:
                count[row] = count.get(row, 0) + 1
                worst[row] = max(worst.get(row, (-1.0, 0.0, "")), (*overload, record.name))
    return tuple(
        _finding(first[row], share, level, count[row], f"{channels.describe(run)}, {name}".rstrip(", "))
        for row, (share, level, name) in sorted(worst.items())
    )


def overloaded(record: Recording, row: int) -> tuple[float, float] | None:
    """Share of the samples of a channel on its limit, and that limit; ``None`` where it has none.

    A limit is 98 % of the range of the channel, or an extreme that occurs much more often than the values below it. The
    share is 0, and the limit NaN, where only the front end says that there was an overload.
    """
    signal, channel = record.signals[row], record.channels[row]
    high, low = float(signal.max()), float(signal.min())
    limit = FULL_SCALE * channel.range if channel.range else np.inf
    share = sum(_share(signal, level, limit) for level in (high, low))
    if share > 0:
        return share, max(high, low, key=abs)
    if record.overloads is not None and record.overloads[row]:
        return 0.0, float("nan")
    return None


def _share(signal: Float[np.ndarray, "sample"], extreme: float, limit: float) -> float:
    """Share of the samples on one of the two extremes, 0 where that is no limit."""
    if abs(extreme) >= limit:
        return float(np.mean(signal * np.sign(extreme) >= limit))
    equal = int(np.count_nonzero(signal == extreme))
    if equal < EQUAL:
        return 0.0
    distinct, counts = np.unique(signal, return_counts=True)
    if len(distinct) <= 2 * BELOW:
        return 0.0
    beside = counts[1 : BELOW + 1] if extreme == distinct[0] else counts[-BELOW - 1 : -1]
    height = np.abs(distinct - extreme) / max(abs(extreme - float(np.median(signal))), 1e-300)
    near = int(counts[(height > 0) & (height <= NEAR)].sum())
    return equal / len(signal) if equal > near and equal >= EQUAL * int(beside.max()) else 0.0


def _finding(channel: Channel, share: float, level: float, records: int, where: str) -> Finding:
    """What is to be said of an overloaded channel."""
    if share == 0:
        said = f"channel {channel.name} was overloaded at some time in the record, says the front end"
    else:
        said = f"channel {channel.name} is cut off at {level:.4g} in {100 * share:.2g} % of its samples"
    more = f", and in {records - 1} further records" if records > 1 else ""
    return Finding(
        "error" if share > TOLERATED else "warning",
        "overload",
        where,
        f"{said}{more}: its FRFs are wrong by about as much, and intervals do not contain that.",
        share,
        TOLERATED,
        "Raise the range of the channel or drive less hard, and measure again.",
    )
