"""Candidates for modes: poles that persist over model orders, of the whole band and of narrow parts of it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from ema.data import PoleTable, damping_ratios, natural_frequencies
from ema.fit import estimator, lscf
from ema.fit.estimator import Fit, Observations
from ema.fit.policy import POLICY
from ema.fit.prepare import Prepared

_AROUND = 16
"""Lines on each side whose median is what is usual at a line, and in which the flank of a tone is looked for."""
_STANDS_OUT = 16.6
"""Power over the usual one from which on a line stands out by itself: one in 100,000 by noise, also where FRFs share
it (chi-square with two degrees of freedom over its median)."""
_FLANK = 12.0
"""Energy of a flank over that of noise, mean of all FRFs, from which on it is one: noise that all FRFs share has as
much once in 160,000 (exponential distribution)."""
_ON_PEAK = 3.0
"""Decay rates from a pole within which a line is on its peak: the peak has fallen by 10 dB there."""


@dataclass(frozen=True)
class Candidates:
    """Clusters of poles over the model orders: representative, participation, share of orders in which it shows."""

    poles: Complex[np.ndarray, "cluster"]
    participation: Complex[np.ndarray, "in cluster"]
    persistence: Float[np.ndarray, "cluster"]

    def keep(self, rows: Bool[np.ndarray, "cluster"]) -> "Candidates":
        """Return some of the clusters, in their order.

        Parameters
        ----------
        rows : boolean array of shape (cluster,)
            Which clusters are kept.

        Returns
        -------
        Candidates
            Those of the clusters where ``rows`` is true.
        """
        return Candidates(self.poles[rows], self.participation[:, rows], self.persistence[rows])

    def joined(self, other: "Candidates") -> "Candidates":
        """Return both sets, without those of ``other`` that lie near one of these.

        Near is half a decay rate, the larger of the two: a quarter of the half-power bandwidth.

        Parameters
        ----------
        other : Candidates
            Clusters to be appended, of the same references.

        Returns
        -------
        Candidates
            These clusters, then the new ones of ``other``.
        """
        distance = np.abs(other.poles[:, None] - self.poles[None, :])
        reach = np.maximum(np.abs(other.poles.real)[:, None], np.abs(self.poles.real)[None, :])
        new = other.keep(~np.any(distance < 0.5 * reach, axis=1))
        return Candidates(
            np.concatenate([self.poles, new.poles]),
            np.concatenate([self.participation, new.participation], axis=1),
            np.concatenate([self.persistence, new.persistence]),
        )


def cluster(
    order: Int[np.ndarray, "pole"], poles: Complex[np.ndarray, "pole"], participation: Complex[np.ndarray, "pole in"]
) -> Candidates:
    """Follow poles from the highest order down to a third of it; each order gives a cluster one pole at most.

    A pole joins the nearest cluster closer than half the sum of the two decay rates.
    """
    orders = np.unique(order)[::-1]
    orders = orders[orders >= orders.max(initial=0) / 3]
    members: list[list[int]] = []
    for current in orders:
        rows = np.flatnonzero((order == current) & (poles.real < 0))
        if not members:
            members = [[int(row)] for row in rows]
            continue
        centres = poles[[cluster[-1] for cluster in members]]
        distance = np.abs(poles[rows][:, None] - centres[None, :])
        reach = 0.5 * (np.abs(poles[rows].real)[:, None] + np.abs(centres.real)[None, :])
        distance = np.where(distance <= reach, distance / reach, np.inf)
        taken: set[int] = set()
        for place in np.argsort(distance, axis=None):
            row, centre = np.unravel_index(place, distance.shape)
            if not np.isfinite(distance[row, centre]):
                break
            members[centre].append(int(rows[row]))
            taken.add(int(row))
            distance[row, :] = distance[:, centre] = np.inf
        members += [[int(row)] for position, row in enumerate(rows) if position not in taken]
    # The member of median damping speaks for the cluster: high orders split peaks, low orders widen them.
    heads = [sorted(cluster, key=lambda row: -poles[row].real)[len(cluster) // 2] for cluster in members]
    vectors = participation[heads].T
    largest = vectors[np.argmax(np.abs(vectors), axis=0), np.arange(len(heads))] if len(heads) else 1
    return Candidates(poles[heads], vectors / largest, np.array([len(c) / len(orders) for c in members], dtype=float))


def of_table(table: PoleTable, added_decay: float) -> Candidates:
    """Clusters of a pole table, moved to where an exponential window put the data."""
    return cluster(table.order, table.poles - added_decay, table.participation)


def of_single_lines(prepared: Prepared, band: tuple[float, float], others: Complex[np.ndarray, "other"]) -> Candidates:
    """Undamped poles at lines that are noisier than those around, or stand out from their neighbours in the FRFs, and
    have a flank: a tone leaks into all lines of a record without a window, as a pole without damping does.

    On the peaks of ``others``, lines stand out by the shape of the peak.
    """
    values, lines = prepared.values / prepared.noise.outputs[:, None], len(prepared.frequencies)
    single = np.zeros_like(values)
    # fourth differences: of a peak of n lines they leave a share of (2 / n)^4, of a single line all
    inner = slice(2, -2)
    single[inner] = values[inner] - (4 * (values[1:-3] + values[3:-1]) - (values[:-4] + values[4:])) / 6
    power = np.mean(np.abs(single) ** 2, axis=(1, 2))
    places = np.flatnonzero(_stands_out(prepared.noise.lines**2) | _stands_out(power))
    places = places[(places >= _AROUND) & (places < lines - _AROUND)]
    places = places[[_has_flank(values[place - _AROUND : place + _AROUND + 1]) for place in places.tolist()]]
    poles = 2j * np.pi * prepared.frequencies[places]
    poles -= np.pi * estimator.NARROWEST * float(np.median(np.diff(prepared.frequencies)))
    vectors = np.linalg.svd(single[places], full_matrices=False)[2][:, 0]
    beside = np.all(np.abs(poles[:, None] - others) > _ON_PEAK * np.abs(others.real), axis=1)
    return Candidates(poles, vectors.T, np.ones(len(places))).keep(inside(poles, band) & beside)


def _stands_out(power: Float[np.ndarray, "freq"]) -> Bool[np.ndarray, "freq"]:
    """Lines with more than both neighbours, and far more than what is usual around."""
    beside = np.clip(np.arange(len(power))[:, None] + np.arange(-_AROUND, _AROUND + 1), 0, len(power) - 1)
    higher = (power >= np.append(power[1:], 0)) & (power > np.append(0, power[:-1]))
    return np.asarray(higher & (power > _STANDS_OUT * np.median(power[beside], axis=1)))


def _has_flank(values: Complex[np.ndarray, "freq dof in"]) -> bool:
    """Whether FRFs around a line, without it and its neighbours, hold a share of 1 / x beside a cubic over x."""
    x = np.arange(-_AROUND, _AROUND + 1) / _AROUND
    some = np.abs(x) > 1.5 / _AROUND
    axes, _ = np.linalg.qr(np.stack([x[some] ** power for power in (0, 1, 2, 3, -1)], axis=1))
    shares = np.tensordot(axes.T, values[some], 1)
    total = np.sum(np.abs(values[some]) ** 2, axis=0)
    noise = (total - np.sum(np.abs(shares) ** 2, axis=0)) / (np.count_nonzero(some) - len(shares))
    return bool(np.mean(np.abs(shares[-1]) ** 2 / np.maximum(noise, np.finfo(float).tiny)) > _FLANK)


def zoom(prepared: Prepared, data: Observations, fit: Fit, share: int) -> Candidates:
    """Persistent poles of narrow bands (``1/share`` of the whole, overlapping by half) that hold more than noise."""
    by_reference, together = estimator.profile(data, fit)
    power = by_reference.mean(axis=0)
    lines, references = len(prepared.frequencies), prepared.values.shape[2]
    width = max(lines // share, 24 * (references + 1))
    found = Candidates(np.zeros(0, complex), np.zeros((references, 0), complex), np.zeros(0))
    centres = data.s.imag / (2 * np.pi)
    for first in range(0, max(lines - width // 2, 1), max(width // 2, 1)):
        rows = slice(first, min(first + width, lines))
        f = prepared.frequencies[rows]
        within = (centres >= f[0]) & (centres <= f[-1])
        # Products of independent residuals scatter around 0; four of their standard deviations are no accident.
        doubt = 4 / np.sqrt(max(1, within.sum() * data.outputs * data.references))
        misfit = together[within].sum() / max(power[within].sum(), 1e-300) if within.any() else 0.0
        if len(f) < 16 or misfit < max(0.05, doubt):
            continue
        top = int(np.clip(len(f) // (2 * (references + 1)), 2, 24))
        degrees = range(max(1, top // 3), top + 1, max(1, top // 8))
        weights = 1 / np.clip(prepared.noise.lines[rows], 0.2, 5.0)
        outputs = lscf.principal_outputs(prepared.values[rows], weights, prepared.noise)
        polynomials = lscf.normal_matrices(f, outputs, degrees, weights, noise=1.0)
        tables = [(degree, *lscf.poles(polynomials, degree)) for degree in degrees]
        own = cluster(
            np.concatenate([np.full(len(p), degree) for degree, p, _ in tables]),
            np.concatenate([p for _, p, _ in tables]),
            np.concatenate([v for _, _, v in tables]) * prepared.noise.references,
        )
        plausible = inside(own.poles, (float(f[0]), float(f[-1]))) & (damping_ratios(own.poles) <= POLICY.heaviest)
        found = found.joined(own.keep(plausible & (own.persistence >= 0.5)))
    return found


def like_modes(poles: Complex[np.ndarray, "pole"], band: tuple[float, float]) -> Bool[np.ndarray, "pole"]:
    """Which poles can be modes at all: decaying, in the band (Hz), and no heavier than modes are."""
    decaying = (poles.real < 0) & (damping_ratios(poles) <= POLICY.heaviest)
    return np.asarray(inside(poles, band) & decaying)


def inside(poles: Complex[np.ndarray, "pole"], band: tuple[float, float]) -> Bool[np.ndarray, "pole"]:
    """Which natural frequencies lie in a band (Hz)."""
    frequencies = natural_frequencies(poles)
    return (frequencies >= band[0]) & (frequencies <= band[1])
