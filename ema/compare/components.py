"""Within and between: one quantity over the repeats of a condition."""

import numpy as np
import scipy.stats
from jaxtyping import Float

from ema.data.repeats import VarianceComponents
from ema.errors import InputError

COVERAGE = 0.95
"""Probability that an interval contains."""
_TAIL = (1 - COVERAGE) / 2
_NORMAL = float(scipy.stats.norm.isf(_TAIL))


def variance_components(
    values: Float[np.ndarray, "run mode"],
    stds: Float[np.ndarray, "run mode"],
    assemblies: tuple[str, ...] | None = None,
) -> VarianceComponents:
    """Separate the noise within a take from the scatter between assemblies (one-way random effects, nested takes).

    Takes of one assembly are averaged first, so that measuring one assembly three times does not count as three
    assemblies. The interval of the mean is that of Student over the plain mean of the assemblies: exact where all are
    equally precise, and at the 95 % level never too narrow where they are not, which weights from two to five repeats
    cannot promise. It is never narrower than the noise alone. The variance between is that of the assemblies less what
    noise and takes explain (the moment estimator, for equal precision that of REML); its interval is that of the
    chi-square distribution.

    Parameters
    ----------
    values : array of shape (run, mode)
        The quantity; NaN where a mode was not identified.
    stds : array of shape (run, mode)
        Standard deviation that the fit states; NaN where none is known.
    assemblies : tuple of str, optional
        One text per run; by default every run is an assembly of its own.

    Returns
    -------
    VarianceComponents
        Mean and standard deviations within takes, between takes and between assemblies.

    Raises
    ------
    InputError
        If there is no run, or the arrays do not fit each other.

    References
    ----------
    .. [1] Bakirov and Székely (2005), Student's t-test for Gaussian scale mixtures.

    Examples
    --------
    >>> spread = variance_components(np.array([[40.0], [40.2], [39.8]]), np.full((3, 1), 0.01))
    >>> spread.between.round(2)
    array([0.2])
    """
    names = tuple(map(str, range(len(values)))) if assemblies is None else assemblies
    if not len(values) or values.shape != stds.shape or len(names) != len(values):
        raise InputError(
            "values, standard deviations and assemblies of repeats do not fit each other",
            where="variance_components",
            got=f"{values.shape}, {stds.shape} and {len(names)}",
            expected="(run, mode) twice, and one text per run",
        )
    labels = np.array(names)
    groups = [labels == name for name in dict.fromkeys(names)]
    finite = np.isfinite(values)
    sizes = np.array([finite[group].sum(axis=0) for group in groups], dtype=np.float64)
    present = sizes > 0
    means = _means(np.array([np.where(finite, values, 0)[group].sum(axis=0) for group in groups]), sizes)
    noise = np.where(finite, np.nan_to_num(stds**2), 0)
    own = _means(np.array([noise[group].sum(axis=0) for group in groups]), sizes)
    count = present.sum(axis=0)
    known = (finite & np.isfinite(stds)).any(axis=0)
    takes = _takes(values, means, groups, sizes)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.nansum(means, axis=0) / count
        total = np.where(count > 1, np.nansum((means - mean) ** 2, axis=0) / (count - 1), np.nan)
        within = np.nansum(np.fmax(own, takes) / sizes, axis=0) / count
        noise_half = np.where(known, _NORMAL * np.sqrt(np.nansum(own / sizes, axis=0)) / count, np.nan)
        limits = total * (count - 1) / scipy.stats.chi2.isf([[_TAIL], [1 - _TAIL]], count - 1)
        std = np.sqrt(total / count)
        half = np.where(count > 1, np.fmax(scipy.stats.t.isf(_TAIL, count - 1) * std, noise_half), np.nan)
        noise_std = np.where(known, np.sqrt(noise.sum(axis=0) / sizes.sum(axis=0)), np.nan)
    between, low, high = np.sqrt(np.maximum([total - within, *(limits - within)], 0))
    return VarianceComponents(
        np.where(count > 0, mean, np.nan),
        noise_std,
        np.sqrt(takes),
        between,
        np.stack([low, high], axis=1),
        std,
        half,
        noise_half,
        count,
    )


def _means(sums: Float[np.ndarray, "assembly mode"], sizes: Float[np.ndarray, "assembly mode"]) -> np.ndarray:
    return np.asarray(np.divide(sums, sizes, out=np.full(sums.shape, np.nan), where=sizes > 0))


def _takes(
    values: Float[np.ndarray, "run mode"],
    means: np.ndarray,
    groups: list[np.ndarray],
    sizes: Float[np.ndarray, "assembly mode"],
) -> Float[np.ndarray, "mode"]:
    """Variance between takes of one assembly, pooled over the assemblies; NaN where no assembly has two."""
    freedom = np.maximum(sizes - 1, 0).sum(axis=0)
    squares = [np.nansum((values[group] - mean) ** 2, axis=0) for group, mean in zip(groups, means, strict=True)]
    return np.asarray(np.divide(sum(squares), freedom, out=np.full(len(freedom), np.nan), where=freedom > 0))


def half_of_difference(
    first: VarianceComponents, second: VarianceComponents, pairs: tuple[tuple[int, int], ...]
) -> tuple[Float[np.ndarray, "pair"], Float[np.ndarray, "pair"]]:
    """Half the 95 % interval of the difference of two means, from the repeats (NaN without) and from the noise alone.

    The quantile is that of Cochran and Cox (1950), between those of both conditions, which holds its level for two to
    five repeats with unequal scatter, where Welch's falls to 90 %.
    """
    left, right = [i for i, _ in pairs], [j for _, j in pairs]
    noise = np.sqrt(first.noise_half[left] ** 2 + second.noise_half[right] ** 2)
    variances = np.stack([first.std[left], second.std[right]]) ** 2
    freedom = np.stack([first.assemblies[left], second.assemblies[right]]) - 1.0
    with np.errstate(divide="ignore", invalid="ignore"):
        quantiles = scipy.stats.t.isf(_TAIL, freedom)
        total = variances.sum(axis=0)
        half = np.where(total > 0, (variances * quantiles).sum(axis=0) / np.sqrt(total), 0 * total)
    return np.where(np.isfinite(half), np.fmax(half, noise), np.nan), noise


def least_half_of_difference(
    first: VarianceComponents, second: VarianceComponents, pairs: tuple[tuple[int, int], ...]
) -> Float[np.ndarray, "pair"]:
    """Half the 95 % interval of the difference of two means where one of the conditions was not repeated: the interval
    of the mean that the repeats of the other one give, and the noise of this one. It is wider by the scatter of
    assemblies of this one, which nobody knows.
    """
    left, right = [i for i, _ in pairs], [j for _, j in pairs]
    halves = (np.fmax(one.half, one.noise_half)[modes] for one, modes in ((first, left), (second, right)))
    return np.asarray(np.hypot(*halves))
