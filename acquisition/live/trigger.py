"""Takes cut out of a stream: a force that rises above a level, and what came before it."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ema.errors import InputError


@dataclass(frozen=True)
class Trigger:
    """A take begins ``before`` samples before the row ``row`` rises above ``level`` and is ``length`` samples long."""

    row: int
    level: float
    before: int
    length: int

    def __post_init__(self) -> None:
        if self.before < 0:
            raise InputError(
                "a take begins before its trigger or with it",
                got=f"{self.before} samples before it",
                expected="0 or more",
            )
        if self.before >= self.length:
            raise InputError(
                "the part of a take before its trigger is no shorter than the take",
                got=f"{self.before} of {self.length} samples",
                advice="shorten pre_trigger or lengthen duration in [take]",
            )

    def cut(self, blocks: Iterator[Float[np.ndarray, "channel sample"]]) -> Float[np.ndarray, "channel sample"]:
        """The next take; blocks are used up to its end, and what was before the call plays no part.

        Raises
        ------
        InputError : the stream ends before a whole take.
        """
        kept: list[Float[np.ndarray, "channel sample"]] = []
        begin = None
        for block in blocks:
            kept.append(block)
            signals = np.concatenate(kept, axis=1)
            if begin is None:
                begin = self._begin(signals[self.row])
            if begin is None:
                # one sample more than the pre-trigger tells whether the next block begins with a rise
                kept = [signals[:, -(self.before + 1) :]]
            elif signals.shape[1] >= begin + self.length:
                return signals[:, begin : begin + self.length]
            else:
                kept = [signals[:, begin:]]
                begin = 0
        raise InputError("the stream ended before a take was whole", expected=f"{self.length} samples")

    def _begin(self, force: Float[np.ndarray, "sample"]) -> int | None:
        """Where a take begins, if the force rises behind a whole pre-trigger."""
        rises = np.flatnonzero((force[1:] > self.level) & (force[:-1] <= self.level)) + 1
        rises = rises[rises >= self.before]
        return int(rises[0]) - self.before if len(rises) else None
