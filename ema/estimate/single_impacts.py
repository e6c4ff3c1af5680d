"""What the single impacts (or sweeps) change in the average of an FRF."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from itertools import pairwise
from operator import add

import numpy as np
from jaxtyping import Complex, Float

from ema.data import Deviations
from ema.dof import Dof
from ema.estimate.single_input import Sums, reciprocal

MOST = 8
"""Deviations that are kept of a force DOF: of more impacts, those that follow each other are taken together."""

KEPT = 256 * 2**20
"""Bytes of single impacts from which on none are kept."""

Key = tuple[Dof, tuple[Dof, ...]]


@dataclass
class SingleImpacts:
    """Sums of the single impacts of a test, as long as they are small."""

    sums: dict[Key, list[Sums]] = field(default_factory=dict)
    size: int = 0

    def keep(self, key: Key, parts: Sequence[Sums]) -> None:
        """Add the impacts of a record."""
        self.size += sum(part.cross.nbytes + part.force.nbytes for part in parts)
        if self.size > KEPT:
            self.sums.clear()
        else:
            self.sums.setdefault(key, []).extend(parts)

    def deviations(
        self,
        values: Complex[np.ndarray, "in out freq"],
        sums: Mapping[Key, Sums],
        outputs: Sequence[Dof],
        inputs: Sequence[Dof],
        factor: Float[np.ndarray, "in out freq"] | None = None,
    ) -> Deviations | None:
        """Deviations from the averages; ``None`` where nothing was kept or nothing was repeated.

        Parameters
        ----------
        values : the FRFs of all impacts; ``sums`` are what they are made of.
        factor : by which H2 or Hv exceed H1.
        """
        total = {(force, dof): part.force for (force, dofs), part in sums.items() for dof in dofs}
        groups = [(key, _few(parts)) for key, parts in self.sums.items()]
        counts = np.zeros(values.shape[:2], int)
        places = []
        for (force, dofs), parts in groups:
            column, rows = inputs.index(force), np.array([outputs.index(dof) for dof in dofs])
            for part in parts:
                places.append((column, rows, part, counts[column, rows].copy()))
                counts[column, rows] += 1
        most = int(counts.max(initial=0))
        if self.size > KEPT or most < 2:
            return None
        changes = np.zeros((most, *values.shape), np.complex64)
        numbers = np.full((most, *values.shape[:2]), -1)
        for number, (column, rows, part, slot) in enumerate(places):
            inverse = reciprocal(np.stack([total[inputs[column], outputs[row]] for row in rows]))
            share = np.minimum(part.force * inverse, 1 - 1e-9)
            cross = part.cross if factor is None else part.cross * factor[column, rows]
            # d = a (H_i - H) / sqrt(1 - a) with the share a = |F_i|^2 / sum |F|^2 and a H_i = Y_i F_i* / sum |F|^2
            change = (cross - values[column, rows] * part.force) * (inverse / np.sqrt(1 - share))
            changes[slot, column, rows] = change
            numbers[slot, column, rows] = number
        # A single impact is its own average: it has nothing to deviate from.
        alone = counts < 2
        changes[:, alone], numbers[:, alone] = 0, -1
        return Deviations(changes.transpose(0, 3, 2, 1), numbers.transpose(0, 2, 1))


def _few(parts: Sequence[Sums]) -> list[Sums]:
    """At most ``MOST`` groups of impacts that follow each other."""
    if len(parts) <= MOST:
        return list(parts)
    edges = np.linspace(0, len(parts), MOST + 1).round().astype(int)
    return [reduce(add, parts[a:b]) for a, b in pairwise(edges)]
