"""What a fit states, in the form in which every bench reads it: the one place that knows the estimator's interface."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2, norm

import ema.fit
from ema.data import FrfSet, ModalModel
from tests.bench.cases import Case
from tests.bench.scoring import assign

LEVEL = 0.95
"""Level of the intervals that are scored."""
REACH = float(norm.ppf(0.5 + LEVEL / 2))
"""Standard deviations on each side of such an interval."""
ELLIPSE = float(chi2.ppf(LEVEL, 2))
"""Squared Mahalanobis distance on the joint ellipse of the real and imaginary part of one residue."""


@dataclass(frozen=True)
class Stated:
    """Accepted modes with what is stated of them; NaN where nothing is stated.

    Parameters
    ----------
    model : the accepted modes.
    frequency_std, damping_std : standard deviations in Hz and as a fraction, (mode,).
    residue_variance : covariance of real and imaginary part of each residue, (mode, dof, in, 2, 2), or ``None``.
    candidates : number of modes that were not accepted but are listed apart.
    findings : codes of all findings of the fit and of its FRFs.
    warned : those of warnings and errors.
    seconds : processor time of poles and modes.
    """

    model: ModalModel
    frequency_std: np.ndarray
    damping_std: np.ndarray
    residue_variance: np.ndarray | None
    candidates: int
    findings: tuple[str, ...]
    warned: tuple[str, ...] = ()
    seconds: float = float("nan")

    @property
    def frequencies(self) -> np.ndarray:
        """Natural frequencies in Hz, (mode,)."""
        return np.asarray(self.model.natural_frequencies)

    @property
    def damping(self) -> np.ndarray:
        """Damping ratios, (mode,)."""
        return np.asarray(self.model.damping_ratios)


def of_model(model: ModalModel, frfs: FrfSet | None = None) -> Stated:
    """What a modal model states of its accepted modes."""
    count = len(model.poles)
    std = np.full((2, count), np.nan)
    if model.covariance is not None:
        variances = model.covariance[:, [0, 1], [0, 1]].T
        std = np.sqrt(np.where(variances > 0, variances, np.nan))
    candidates = getattr(model, "candidates", None)
    findings = (*model.findings, *(frfs.findings if frfs is not None else ()))
    codes, warned = (
        tuple(dict.fromkeys(one.code for one in findings if one.severity in wanted))
        for wanted in (("info", "warning", "error"), ("warning", "error"))
    )
    return Stated(
        model,
        std[0],
        std[1],
        None if model.uncertainty is None else np.asarray(model.uncertainty.residues),
        0 if candidates is None else len(getattr(candidates, "poles", candidates)),
        codes,
        warned,
    )


def automatic(
    frfs: FrfSet, near: Sequence[float] | None = None, orders: Sequence[int] | None = None, **request: object
) -> Stated:
    """Poles and modes with default settings; ``near``, ``orders`` and other requests are handed on."""
    start = time.process_time()
    model = ema.fit.modes(frfs, ema.fit.stabilise(frfs, orders), near=near, **request)
    return replace(of_model(model, frfs), seconds=time.process_time() - start)


@dataclass(frozen=True)
class Errors:
    """Errors of the accepted modes over what is stated of them, for each true mode; NaN where the mode is missed.

    Parameters
    ----------
    match : index of the accepted mode that found each true one, -1 where missed, (mode,).
    false : indices of accepted modes that match nothing.
    frequency, damping : signed error over the stated standard deviation, (mode,).
    inside : share of the residues that lie within their joint ellipse, (mode,).
    distance : root mean square Mahalanobis distance of the residues over sqrt(2), 1 where the statement is right, (mode,).
    """

    match: np.ndarray
    false: tuple[int, ...]
    frequency: np.ndarray
    damping: np.ndarray
    inside: np.ndarray
    distance: np.ndarray


def errors(case: Case, stated: Stated) -> Errors:
    """Errors over the stated standard deviations; a value stated without one, or with zero, counts as infinitely wrong."""
    match, false = assign(case, stated.model.poles, stated.model.shapes)
    count, hit = len(match), np.flatnonzero(match >= 0)
    frequency, damping, inside, distance = (np.full(count, np.nan) for _ in range(4))
    own = match[hit]
    frequency[hit] = over(stated.frequencies[own] - case.truth.natural_frequencies[hit], stated.frequency_std[own])
    damping[hit] = over(stated.damping[own] - case.truth.damping_ratios[hit], stated.damping_std[own])
    if stated.residue_variance is not None:
        true, given = case.truth.residues(), stated.model.residues()
        for mode in hit:
            square = mahalanobis(given[match[mode]] - true[mode], stated.residue_variance[match[mode]])
            inside[mode] = np.mean(square <= ELLIPSE)
            distance[mode] = np.sqrt(np.mean(square) / 2)
    else:
        inside[hit], distance[hit] = 0.0, np.inf
    return Errors(match, false, frequency, damping, inside, distance)


def over(error: np.ndarray, std: np.ndarray) -> np.ndarray:
    """``error / std``, infinite where no usable standard deviation is stated."""
    usable = np.isfinite(std) & (std > 0)
    return np.where(usable, error / np.where(usable, std, 1.0), np.inf)


def mahalanobis(error: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Squared distance of complex errors in the metric of their 2 x 2 covariances; infinite where these are singular."""
    x, y = error.real, error.imag
    a, b, c = variance[..., 0, 0], variance[..., 0, 1], variance[..., 1, 1]
    determinant = a * c - b * b
    usable = np.isfinite(determinant) & (determinant > 0)
    square = c * x**2 - 2 * b * x * y + a * y**2
    return np.where(usable, square / np.where(usable, determinant, 1.0), np.inf)


def finite(values: np.ndarray, digits: int = 4) -> list[float | None]:
    """As JSON: ``None`` for NaN, 1e9 for infinity."""
    return [None if np.isnan(v) else float(np.clip(round(float(v), digits), -1e9, 1e9)) for v in values]
