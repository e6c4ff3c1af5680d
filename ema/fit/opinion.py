"""Two estimators side by side: the modes of a fit against those of the realisation of impulse responses."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import scipy.stats
from jaxtyping import Bool, Float

from ema.data import Finding, FrfSet, ModalModel
from ema.dof import match
from ema.fit.eigensystem import era
from ema.progress import Progress, silent

if TYPE_CHECKING:
    import pandas as pd

CONFIDENCE = 0.95
"""Probability with which no mode is called different when two sound estimators see the same noise: the usual 95 %, for
all modes and both values together (Bonferroni)."""
_ALIKE = 0.5
"""MAC below which modes of the two estimators are not paired. Both see the same FRFs, so that shapes of one mode differ
by noise alone; its unit tests pass at 0.25."""
_NEAR = 2.0
"""Distance of poles over the sum of their decay rates beyond which they are not the same mode: at 1 their half-power
bands just touch. Its unit tests pass at 1 and at 4, where the shapes decide."""


@dataclass(frozen=True)
class SecondOpinion:
    """The modes of a fit beside those of a second estimator.

    ``pairs`` (mode of ``first``, mode of ``second``); ``frequency`` and ``damping`` (pair,) are differences, second
    minus first, over their combined standard deviation; ``mac`` (pair,); ``limit`` is what all of them stay below with
    a probability of 95 %; ``differs`` (pair,).
    """

    first: ModalModel
    second: ModalModel
    pairs: tuple[tuple[int, int], ...]
    frequency: Float[np.ndarray, "pair"]
    damping: Float[np.ndarray, "pair"]
    mac: Float[np.ndarray, "pair"]
    limit: float
    differs: Bool[np.ndarray, "pair"]
    findings: tuple[Finding, ...] = field(default=(), compare=False)

    def table(self) -> "pd.DataFrame":
        """One row for each mode of either estimator; NaN where the other one has none."""
        import pandas as pd

        partner = dict(self.pairs)
        rows = [self._row(i, j, place) for place, (i, j) in enumerate(self.pairs)]
        rows += [self._row(i, None, None) for i in range(len(self.first.poles)) if i not in partner]
        taken = set(partner.values())
        rows += [self._row(None, j, None) for j in range(len(self.second.poles)) if j not in taken]
        columns = ["f [Hz]", "f second [Hz]", "df / s", "zeta [%]", "zeta second [%]", "dzeta / s", "MAC", "agrees"]
        table = pd.DataFrame(rows, columns=columns)
        table = table.iloc[np.argsort(table["f [Hz]"].fillna(table["f second [Hz]"]), kind="stable")]
        return table.set_index(pd.RangeIndex(1, len(table) + 1, name="mode"))

    def _row(self, i: int | None, j: int | None, place: int | None) -> list[float | bool]:
        nothing = float("nan")
        own = (nothing, nothing) if i is None else _values(self.first, i)
        other = (nothing, nothing) if j is None else _values(self.second, j)
        if place is None:
            return [own[0], other[0], nothing, own[1], other[1], nothing, nothing, False]
        return [
            own[0],
            other[0],
            float(self.frequency[place]),
            own[1],
            other[1],
            float(self.damping[place]),
            float(self.mac[place]),
            not bool(self.differs[place]),
        ]


def _values(model: ModalModel, mode: int) -> tuple[float, float]:
    return float(model.natural_frequencies[mode]), 100 * float(model.damping_ratios[mode])


def second_opinion(modes: ModalModel, frfs: FrfSet, progress: Progress = silent) -> SecondOpinion:
    """Compare the modes of a fit with those of the eigensystem realisation algorithm on the same FRFs.

    Both contain the same noise, so the combined interval, sqrt(s1^2 + s2^2), is a little wide: what lies beyond it is a
    disagreement of methods. The limit holds for all modes at once (Bonferroni).

    Parameters
    ----------
    modes : ModalModel
        Modes that were fitted to ``frfs``.
    frfs : FrfSet
        The FRFs, cut to the band of the fit.
    progress : Progress, optional
        Called during the second fit.

    Returns
    -------
    SecondOpinion
        Both models, their pairs, and where they differ.

    Raises
    ------
    InputError
        If the second estimator cannot use the FRFs.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> from ema.fit import modes, stabilise
    >>> frfs = frf_set(0.001)
    >>> len(second_opinion(modes(frfs, stabilise(frfs)), frfs).pairs)
    3
    """
    other = era(frfs, progress)
    mac = _mac(modes, other)
    pairs = _pairs(modes, other, mac)
    rows, columns = [i for i, _ in pairs], [j for _, j in pairs]
    frequency = (other.natural_frequencies[columns] - modes.natural_frequencies[rows]) / _combined(
        modes, other, pairs, 0
    )
    damping = (other.damping_ratios[columns] - modes.damping_ratios[rows]) / _combined(modes, other, pairs, 1)
    limit = float(scipy.stats.norm.isf((1 - CONFIDENCE) / 2 / max(2 * len(pairs), 1)))
    differs = (np.abs(frequency) > limit) | (np.abs(damping) > limit)
    opinion = SecondOpinion(modes, other, pairs, frequency, damping, mac[rows, columns], limit, differs)
    low, high = float(frfs.frequencies[0]), float(frfs.frequencies[-1])
    found = (*other.findings, *_differences(opinion), *_unpaired(opinion, low, high))
    return SecondOpinion(modes, other, pairs, frequency, damping, mac[rows, columns], limit, differs, found)


def _mac(first: ModalModel, second: ModalModel) -> Float[np.ndarray, "mode other"]:
    """MAC over the DOFs that both have; 1 where they have too few to tell."""
    places = match(first.dofs, second.dofs)
    if len(places) < 2:
        return np.ones((len(first.poles), len(second.poles)))
    rows, columns, signs = (np.array(column) for column in zip(*places, strict=True))
    a, b = first.shapes[rows], signs[:, None] * second.shapes[columns]
    size = np.sum(np.abs(a) ** 2, axis=0)[:, None] * np.sum(np.abs(b) ** 2, axis=0)
    return np.asarray(np.abs(a.conj().T @ b) ** 2 / np.maximum(size, 1e-300))


def _pairs(first: ModalModel, second: ModalModel, mac: Float[np.ndarray, "mode other"]) -> tuple[tuple[int, int], ...]:
    """Modes that are the same in both: near poles with like shapes, the best assignment of all."""
    from scipy.optimize import linear_sum_assignment

    if not mac.size:
        return ()
    reach = np.abs(first.poles.real)[:, None] + np.abs(second.poles.real)
    distance = np.abs(first.poles[:, None] - second.poles) / np.maximum(reach, 1e-300)
    possible = (distance < _NEAR) & (mac > _ALIKE)
    cost = np.where(possible, distance + 1 - mac, 1e3)
    return tuple((int(i), int(j)) for i, j in zip(*linear_sum_assignment(cost), strict=True) if possible[i, j])


def _combined(
    first: ModalModel, second: ModalModel, pairs: tuple[tuple[int, int], ...], which: int
) -> Float[np.ndarray, "pair"]:
    """Combined standard deviation of the natural frequencies (0) or damping ratios (1) of the pairs."""
    total = np.zeros(len(pairs))
    for model, places in ((first, [i for i, _ in pairs]), (second, [j for _, j in pairs])):
        if model.covariance is not None:
            total += model.covariance[places, which, which]
    return np.sqrt(np.maximum(total, 1e-300))


def _differences(opinion: SecondOpinion) -> list[Finding]:
    where = opinion.first.name or "fit"
    findings = []
    for place, (i, j) in enumerate(opinion.pairs):
        if not opinion.differs[place]:
            continue
        (f, zeta), (other_f, other_zeta) = _values(opinion.first, i), _values(opinion.second, j)
        worst = max(abs(float(opinion.frequency[place])), abs(float(opinion.damping[place])))
        findings.append(
            Finding.of(
                "warning",
                "second-opinion-differs",
                f"{where}, {f:.6g} Hz",
                "The second estimator reads {other_frequency} Hz and {other_damping} % instead of "
                "{frequency} Hz and {damping} %: {deviations} combined standard deviations apart.",
                worst,
                opinion.limit,
                advice=(
                    "The intervals do not hold what separates the methods: look at the fit near this mode, and "
                    "at leakage, windows and modes close by."
                ),
                other_frequency=f"{other_f:.6g}",
                other_damping=f"{other_zeta:.4g}",
                frequency=f"{f:.6g}",
                damping=f"{zeta:.4g}",
                deviations=f"{worst:.1f}",
            )
        )
    return findings


def _split(where: str, extra: float, own: float) -> Finding:
    return Finding.of(
        "warning",
        "second-opinion-splits",
        f"{where}, {own:.6g} Hz",
        "The second estimator makes two modes of the peak at {own} Hz, the other one at {extra} Hz.",
        extra,
        advice=("Either there are two modes, or the resonance moved between records: look at the FRFs one by one."),
        own=f"{own:.6g}",
        extra=f"{extra:.6g}",
    )


def _unpaired(opinion: SecondOpinion, low: float, high: float) -> list[Finding]:
    """Modes that one of the two has alone; at the edges of the band only one of them tries."""
    where = opinion.first.name or "fit"
    findings = []
    for model, taken, code, message in (
        (
            opinion.first,
            {i for i, _ in opinion.pairs},
            "second-opinion-missing",
            "was not found by the second estimator",
        ),
        (
            opinion.second,
            {j for _, j in opinion.pairs},
            "second-opinion-extra",
            "was found by the second estimator alone",
        ),
    ):
        for mode in sorted(set(range(len(model.poles))) - taken):
            f, zeta = _values(model, mode)
            reach = 2 * zeta / 100 * f
            edge = f - reach < low or f + reach > high
            near = np.abs(opinion.first.natural_frequencies - f) < reach
            if code == "second-opinion-extra" and near.any():
                findings.append(_split(where, f, float(opinion.first.natural_frequencies[near][0])))
                continue
            findings.append(
                Finding(
                    "info" if edge else "warning",
                    code,
                    f"{where}, {f:.6g} Hz",
                    f"The mode at {f:.6g} Hz with {zeta:.3g} % damping {message}"
                    + (", and the band ends within its peak." if edge else "."),
                    value=f,
                    advice="Look at the shape, and at the FRFs near this frequency.",
                )
            )
    return findings
