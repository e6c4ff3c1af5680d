"""What measured impacts never have in common: all their samples, and the largest force."""

from collections import defaultdict
from collections.abc import Sequence

from ema.data import Finding
from ema.estimate.judge import Judged

SATURATED = 3
"""Impacts with exactly the same largest force, the largest of all, from which on that is where the channel ends.

Two may agree by chance on a coarse converter; four would miss a test of three impacts that are all cut off.
"""


def with_saturation(judged: Sequence[Judged]) -> list[Judged]:
    """The impacts with the overload of a force channel that shows in their peaks alone.

    A pulse of a few samples that is cut off has no flat top that the signal itself would show.
    """
    distinct = {one.samples: one for one in judged}.values()
    most = max((abs(one.force) for one in judged), default=0.0)
    count = sum(abs(one.force) == most for one in distinct)
    if count < SATURATED:
        return list(judged)
    text = f"the force channel is overloaded at {most:.4g}, where {count} impacts end exactly"
    return [
        one.because("overload", text, 1.0)
        if abs(one.force) == most and not any(reason.code == "overload" for reason in one.reasons)
        else one
        for one in judged
    ]


def about_copies(judged: Sequence[Judged], where: str) -> list[Finding]:
    """A finding where impacts agree in every sample: one was counted several times."""
    alike = defaultdict(list)
    for one in judged:
        alike[one.samples].append(f"{one.record}, point {one.dof}, impact {one.index}")
    copied = [names for names in alike.values() if len(names) > 1]
    if not copied:
        return []
    return [
        Finding.of(
            "error",
            "copied-impact",
            where,
            "{count} of {total} impacts are copies of others: {copied} agree in every sample, with their noise.",
            float(sum(map(len, copied)) - len(copied)),
            0.0,
            advice=(
                "Coherence and intervals are too good, and points that were not measured have the FRFs of "
                "others: find the records that belong there, or exclude the copies by a repair."
            ),
            count=sum(map(len, copied)) - len(copied),
            total=len(judged),
            copied=" and ".join(copied[0][:3]),
        )
    ]
