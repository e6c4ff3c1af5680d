"""Which blows of a hammer test can be used, and why the others cannot."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ema.data import Finding, Recording
from ema.dof import Dof
from ema.estimate.blows import Blow, find_blows
from ema.estimate.channels import Layout

FULL_SCALE = 0.98
"""Part of a channel's range that counts as an overload."""


@dataclass(frozen=True)
class Judged:
    """A blow with all that is known about it; ``reasons`` says why it is not used, empty where it is.

    ``place`` is the record's place in the run; ``before`` and ``after`` are the samples of the record that belong to
    this blow alone, seen from its trigger; ``rest`` (out,) is the response before the blow.
    """

    place: int
    record: str
    index: int
    dof: Dof
    blow: Blow
    offset: float
    noise: float
    before: int
    after: int
    after_time: float
    impulse: float
    rest: Float[np.ndarray, "out"]
    pulse: Float[np.ndarray, "sample"]
    reasons: tuple[str, ...]

    @property
    def accepted(self) -> bool:
        """Whether the blow is used."""
        return not self.reasons


def judge_record(
    record: Recording, layout: Layout, place: int, where: str, trigger: float | None
) -> tuple[list[Judged], list[Finding]]:
    """All blows of a record, each judged by itself, and what there is to say about the record."""
    force = record.signals[layout.references[0]]
    rate = record.sampling_rate
    blows, offset, noise = find_blows(force, rate, trigger)
    excluded = dict(record.excluded_hits)
    judged = []
    for index, blow in enumerate(blows):
        earlier = blows[index - 1].stop if index else 0
        following = blows[index + 1].start if index + 1 < len(blows) else len(force)
        before = (blow.start - earlier) if index == 0 else min(blow.start - earlier, int(0.05 * rate))
        contact = blow.stop - blow.start + 1
        quiet = record.signals[list(layout.responses), max(blow.start - before, 0) : max(blow.start - 2, 1)]
        window = slice(max(blow.start - contact, 0), blow.stop + 4 * contact)
        reasons = [f"excluded: {excluded[index]}"] if index in excluded else []
        judged.append(
            Judged(
                place, record.name, index, layout.inputs[0], blow, offset, noise, before, following - blow.start,
                (following - blow.start) / rate, float((force[blow.start : blow.stop + 1] - offset).sum() / rate),
                quiet.mean(axis=1).astype(np.float64), force[window] - offset, tuple(reasons),
            )
        )  # fmt: skip
    return judged, []
