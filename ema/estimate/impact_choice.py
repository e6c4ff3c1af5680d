"""Which impacts enter the averages: those that do not bias the FRF, or the best there are where all have faults."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ema.estimate.block_end import RingDown
from ema.estimate.judge import Judged, Reason, with_contacts

ENOUGH = 3
"""Impacts on a point from which on those that have a fault, though they hardly bias the FRF, are left out.

Three tell a variance with two degrees of freedom. Of four, leaving out one raises the standard deviation of the average
by 15 % and keeps the level uniform; set to two, it would raise it by 22 %.
"""
KINDS = frozenset({"all", "double-hit", "overload", "pre-trigger", "next-impact", "early-impact"})
"""What `keep` and `reject` may name besides single impacts, records and points."""


def with_room(
    judged: Sequence[Judged], length: int, before: int, rate: float, level: tuple[float, float] | None
) -> list[Judged]:
    """The impacts judged by the block: too little room, response left of an earlier one, level, contacts behind it."""
    verdicts: list[Judged] = []
    for number, impact in enumerate(judged):
        earlier = judged[number - 1] if number and judged[number - 1].place == impact.place else None
        inside = tuple(c for c in impact.contacts if c.first < impact.start - min(impact.before, before) + length)
        impact = with_contacts(impact, inside, rate)  # what follows the block has no effect in it
        if room_of(impact, before) < length:
            impact = impact.because(
                "next-impact", f"the next impact or the end of the record comes after {impact.after} samples"
            )
        if earlier is not None and impact.start - earlier.start < 0.5 * length:
            gap = impact.start - earlier.start
            impact = impact.because("early-impact", f"it follows the impact before within {gap} of {length} samples")
        if level is not None and not level[0] <= abs(impact.pulse.peak) <= level[1]:
            text = f"its peak of {abs(impact.pulse.peak):.4g} is not in {level[0]:g} ... {level[1]:g}"
            impact = impact.because("level", text)
        verdicts.append(impact)
    return verdicts


def room_of(one: Judged, before: int) -> int:
    """Samples of the record from the beginning of an impact's block to the next impact."""
    return min(one.before, before) + one.after


def with_errors(
    judged: Sequence[Judged], length: int, before: int, rate: float, ring: RingDown, added: float
) -> list[Judged]:
    """The impacts with the error that each reason causes, as far as the decay of the response states it.

    A block that ends T s behind a contact cuts off exp(-sigma T) of the response to it, whose rate of decay sigma is
    that of the structure and of the window together.
    """
    decay = ring.structural + added

    def priced(one: Judged, reason: Reason) -> Reason:
        """The reason with the relative error of the FRF that it causes."""
        if reason.code == "next-impact":
            return replace(reason, error=float(np.exp(-decay * one.after / rate)))
        if reason.code == "early-impact" and one.quiet.any():
            return replace(reason, error=one.unrest)
        if reason.code == "double-hit":
            end = one.start - min(one.before, before) + length
            left = [(contact.ratio, max(end - contact.sample, 0) / rate) for contact in one.contacts]
            return replace(reason, error=max(ratio * float(np.exp(-decay * seconds)) for ratio, seconds in left))
        return reason

    return [replace(one, reasons=tuple(priced(one, reason) for reason in one.reasons)) for one in judged]


def chosen(judged: Sequence[Judged], keep: Sequence[str] = (), reject: Sequence[str] = ()) -> list[Judged]:
    """The impacts with ``used`` set.

    An impact without fault is used, and so is what ``keep`` names. One with a fault that hardly biases the FRF is used
    where its point has fewer than ``ENOUGH`` others, a biased one only where its point has nothing else. What somebody
    excludes is never used.
    """
    judged = [
        one.because("excluded-impact", "excluded by the settings") if not names(one).isdisjoint(reject) else one
        for one in judged
    ]
    kept = [not one.asked and not names(one).isdisjoint(keep) for one in judged]
    used = [not one.asked and (one.clean or by_name) for one, by_name in zip(judged, kept, strict=True)]
    for point in dict.fromkeys(one.dof for one in judged):
        own = [place for place, one in enumerate(judged) if one.dof == point and not one.asked]
        if sum(used[place] for place in own) < ENOUGH:
            for place in own:
                used[place] |= not judged[place].biased
        if own and not any(used[place] for place in own):
            least = min(judged[place].error for place in own)
            for place in own:
                used[place] = judged[place].error <= 1.5 * least
    return [replace(one, used=each) for one, each in zip(judged, used, strict=True)]


def names(one: Judged) -> set[str]:
    """What ``keep`` and ``reject`` may call an impact.

    Parameters
    ----------
    one : the impact; its record or its DOF may be unknown (an empty text).

    Returns
    -------
    ``"all"``, the codes of its reasons, its record and its DOF, and these with its number in the record
    (``"take_07#2"``).
    """
    places = {one.record, str(one.dof)} - {""}
    return {"all", *(reason.code for reason in one.reasons), *places, *(f"{place}#{one.index}" for place in places)}


def unmatched(judged: Sequence[Judged], selection: Sequence[str]) -> list[str]:
    """Entries of ``keep`` or ``reject`` that name neither an impact nor a kind of fault."""
    known = set().union(*(names(one) for one in judged))
    return [entry for entry in selection if entry not in known and entry not in KINDS]
