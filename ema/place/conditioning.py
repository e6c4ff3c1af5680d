"""A forecast once a test has been read, and what is left of its bands before anybody has read it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import brentq
from scipy.stats import chi2

from ema.data import Finding
from ema.data.trials import Trial, Trials
from ema.errors import InputError
from ema.place.bands import ENOUGH

FEWEST = 4
"""Draws for each reading, at least, that a regression takes."""
RARE = 1e-3
"""Probability with which readings lie beyond what the draws expect of them before that is said."""
BEAM = {"f": 5e-4, "zeta": 0.08}
"""Standard deviation, relative, of what a joint does otherwise than its law says at another F_E or F_N, per unit of the
logarithm of their ratio; the variance grows with the distance. Calibrated on 24 hosts of ``tests.bench.blind`` (seed
261126; joints that no law here reproduces), whose bands held 91 % (f) and 95 % (zeta) of the active truths: after a
reading they hold 93 and 94 %, without this 91 and 91 %; twice as much changes them by 1 %."""
LOOP, LOOP_AMPLITUDE = {"stiffness": 0.3, "energy": 0.2}, 0.3
"""The same of loops of a joint in a rig, where it neither rocks nor vibrates as fast as under the beam: of all
stiffnesses, of all energies, and of each on its own. There 90 and 93 % after a reading, 88 and 89 % without, and 90 and
91 % with half as much; most of what is missed has friction that falls with the speed."""


def updated(tests: Trials, number: int, readings: Sequence[float] | Float[np.ndarray, "reading"]) -> Trials:
    """Return the forecast, and the tests that are left, once a test has been read.

    Every draw is moved by what its own reading, with an error drawn for it, lacks of the real one, times the slope of
    the regression of the forecast on the readings over all draws, in logarithms: exact for normal distributions, and
    the update of an ensemble Kalman filter (Evensen 2003, Ocean Dynamics 53:343, section 3). A joint is no law of any
    family: what a reading tells of another condition is known no better than ``discrepancy``. Readings that lie
    beyond what the draws expect are named, and widen that until they do not.

    Parameters
    ----------
    tests : Trials
        The forecast with its draws, and the tests.
    number : int
        Number of the test that was done.
    readings : sequence of float or array of shape (reading,)
        What was read, in the units of ``Trial.readings``; NaN for what was not.

    Returns
    -------
    Trials
        The bands are the 2.5 and 97.5 % points of the moved draws, the values their medians.

    Raises
    ------
    InputError
        If there is no such test, the readings are not those of the test or not positive, or the forecast has too few
        draws for them.

    Examples
    --------
    >>> from ema.examples import trials
    >>> before = trials()
    >>> after = updated(before, 0, [40.2, 0.016])
    >>> after.damping_width < before.damping_width, len(after.trials)
    (True, 1)
    """
    if not 0 <= number < len(tests.trials):
        raise InputError("no such test", where="test", got=number, expected=f"0 to {len(tests.trials) - 1}")
    trial = tests.trials[number]
    measured = _checked(trial, readings)
    known = np.isfinite(measured)
    expected, measured = np.log(trial.values[:, known]), np.log(measured[known])
    seen = int(np.isfinite(expected).all(axis=1).sum())
    if seen <= FEWEST * len(measured):
        raise InputError(
            "too few draws for these readings",
            where=trial.title,
            got=f"{seen} draws that read all of them",
            expected=f"more than {FEWEST * len(measured)}",
            advice="forecast with more draws",
        )
    widened, unexpected = _unexpected(expected, measured, trial.std[known], discrepancy(trial, 0.0)[known])
    forecast, error = tests.forecast, _Errors(trial, len(expected), number)

    def moved(logs: Float[np.ndarray, "draw value"], apart: float) -> Float[np.ndarray, "draw value"]:
        return _conditioned(logs, expected + error(widened, apart)[:, known], measured)

    values = np.full(tests.values.shape, np.nan)
    for i, j in np.ndindex(values.shape[3:]):
        apart = _distance(trial, float(forecast.force_levels[i]), float(forecast.normal_forces[j]))
        flat = np.log(tests.values[..., i, j].reshape(len(values), -1))
        values[..., i, j] = np.exp(moved(flat, apart)).reshape(values.shape[:3])
    rest = tuple(
        replace(
            other, values=np.exp(moved(np.log(other.values), _distance(trial, other.force_level, other.normal_force)))
        )
        for row, other in enumerate(tests.trials)
        if row != number
    )
    low, middle, high = _band(values, np.isfinite(forecast.damping_low))
    forecast = replace(
        forecast,
        frequency=middle[:, 0],
        frequency_low=low[:, 0],
        frequency_high=high[:, 0],
        damping=middle[:, 1],
        damping_low=low[:, 1],
        damping_high=high[:, 1],
        sources=(),
        frequency_shares=None,
        damping_shares=None,
        findings=(*forecast.findings, *unexpected),
        provenance=replace(forecast.provenance, steps=(*forecast.provenance.steps, f"place.updated: {trial.title}")),
    )
    return with_expected_widths(Trials(forecast, values, tuple(rest), (*tests.findings, *unexpected)))


def _band(
    values: Float[np.ndarray, "draw mode 2 level force"], forecast: Bool[np.ndarray, "mode level force"]
) -> Float[np.ndarray, "3 mode 2 level force"]:
    """The 2.5, 50 and 97.5 % points of the draws; NaN where nothing was forecast, or too few draws have a value."""
    known = forecast[:, None] & (np.mean(np.isfinite(values), axis=0) >= ENOUGH)
    points = np.nanquantile(np.where(known, values, 1.0), [0.025, 0.5, 0.975], axis=0, method="weibull")
    return np.where(known, points, np.nan)


def with_expected_widths(tests: Trials) -> Trials:
    """The tests with the half widths that the bands will have after each: what a regression on it leaves of them."""
    forecast = tests.forecast
    halves = np.stack(
        [
            0.5 * np.log(forecast.frequency_high / forecast.frequency_low),
            0.5 * np.log(forecast.damping_high / forecast.damping_low),
        ],
        axis=1,
    )
    trials = []
    for number, trial in enumerate(tests.trials):
        expected, error = np.log(trial.values), _Errors(trial, len(trial.values), number)
        left = np.full(halves.shape, np.nan)
        for m, q, i, j in np.argwhere(np.isfinite(halves)):
            apart = _distance(trial, float(forecast.force_levels[i]), float(forecast.normal_forces[j]))
            left[m, q, i, j] = _unexplained(np.log(tests.values[:, m, q, i, j]), expected + error(1.0, apart))
        after = np.nanmean(halves * left, axis=(0, 2, 3)) if np.isfinite(left).any() else np.full(2, np.nan)
        trials.append(replace(trial, frequency_width=float(after[0]), damping_width=float(after[1])))
    return replace(tests, trials=tuple(trials))


def discrepancy(trial: Trial, apart: float) -> Float[np.ndarray, "reading factor"]:
    """By how much joints that follow no law of the family mislead a reading: loadings on factors of unit variance.

    The frequencies of all modes are wrong together, and so are the damping ratios, the stiffnesses of a loop and its
    energies; loops also at each amplitude on its own.

    Parameters
    ----------
    trial : Trial
        The test.
    apart : float
        Distance of the conditions, as the sum of the logarithms of the ratios of F_E and of F_N.
    """
    kinds = np.array([name.split(":")[-1].split()[0] for name in trial.readings])
    sizes = LOOP if trial.kind == "loop" else BEAM
    common = np.column_stack([np.where(kinds == kind, size, 0.0) for kind, size in sizes.items()])
    if trial.kind == "loop":
        return np.hstack([common, LOOP_AMPLITUDE * np.eye(len(kinds))])
    return np.asarray(np.sqrt(apart) * common)


def _distance(trial: Trial, force_level: float, normal_force: float) -> float:
    """Sum of the logarithms of the ratios of F_E and of F_N."""
    if trial.kind == "loop" or not np.isfinite(force_level):
        return 1.0
    return abs(float(np.log(force_level / trial.force_level))) + abs(float(np.log(normal_force / trial.normal_force)))


class _Errors:
    """Errors of the readings of a test, for every draw: of the reading itself, and of what it says elsewhere."""

    def __init__(self, trial: Trial, draws: int, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.trial = trial
        self.own = rng.standard_normal((draws, len(trial.std)))
        self.common = rng.standard_normal((draws, discrepancy(trial, 1.0).shape[1]))

    def __call__(self, factor: float, apart: float) -> Float[np.ndarray, "draw reading"]:
        """Logarithmic errors under standard uncertainties ``factor`` times those stated."""
        return np.asarray(factor * self.trial.std * self.own + self.common @ discrepancy(self.trial, apart).T)


def _conditioned(
    logs: Float[np.ndarray, "draw value"],
    read: Float[np.ndarray, "draw reading"],
    measured: Float[np.ndarray, "reading"],
) -> Float[np.ndarray, "draw value"]:
    """The values with what their readings lack of those measured, times the slope of the regression on the readings."""
    result = np.full(logs.shape, np.nan)
    for column, values in enumerate(logs.T):
        rows = np.isfinite(values) & np.isfinite(read).all(axis=1)
        if rows.sum() > FEWEST * read.shape[1]:
            result[rows, column] = values[rows] + (measured - read[rows]) @ _slope(values[rows], read[rows])
    return result


def _slope(values: Float[np.ndarray, "draw"], read: Float[np.ndarray, "draw reading"]) -> Float[np.ndarray, "reading"]:
    centred = read - read.mean(axis=0)
    return np.asarray(np.linalg.lstsq(centred, values - values.mean(), rcond=None)[0])


def _unexplained(values: Float[np.ndarray, "draw"], read: Float[np.ndarray, "draw reading"]) -> float:
    """Share of the standard deviation of the values that a regression on the readings does not explain."""
    rows = np.isfinite(values) & np.isfinite(read).all(axis=1)
    freedom = int(rows.sum()) - 1 - read.shape[1]
    if rows.sum() <= FEWEST * read.shape[1] or not np.ptp(values[rows]) > 0:
        return 1.0
    values, read = values[rows] - values[rows].mean(), read[rows] - read[rows].mean(axis=0)
    rest = values - read @ np.linalg.lstsq(read, values, rcond=None)[0]
    return float(min(np.sqrt(rest @ rest / freedom / values.var(ddof=1)), 1.0))


def _unexpected(
    expected: Float[np.ndarray, "draw reading"],
    measured: Float[np.ndarray, "reading"],
    std: Float[np.ndarray, "reading"],
    loadings: Float[np.ndarray, "reading factor"],
) -> tuple[float, tuple[Finding, ...]]:
    """The factor on the uncertainty of the readings under which the draws expect them, and a finding if it is not 1."""
    seen = expected[np.isfinite(expected).all(axis=1)]
    off, scatter = measured - seen.mean(axis=0), np.atleast_2d(np.cov(seen.T)) + loadings @ loadings.T
    limit = float(chi2.isf(RARE, len(measured)))

    def distance(factor: float) -> float:
        return float(off @ np.linalg.solve(scatter + np.diag((factor * std) ** 2), off))

    found = distance(1.0)
    if found <= limit:
        return 1.0, ()
    # the distance falls to nothing as the factor grows
    end = float(np.linalg.norm(off / std))
    factor = float(brentq(lambda one: distance(one) - limit, 1.0, max(end, 2.0)))
    message = (
        f"the readings lie {np.sqrt(found):.1f} standard deviations from what the forecast expected of them (beyond "
        f"{np.sqrt(limit):.1f} once in {1 / RARE:.0f} tests): the bands are narrowed as if the readings were "
        f"{factor:.0f} times as uncertain."
    )
    advice = "Something is not as the recipe states it: look at the beam, the joints, F_N and the driven point."
    return factor, (
        Finding("warning", "trial-unexpected", "trial", message, float(np.sqrt(found)), limit**0.5, advice),
    )


def _checked(trial: Trial, readings: Sequence[float] | Float[np.ndarray, "reading"]) -> Float[np.ndarray, "reading"]:
    measured = np.asarray(readings, np.float64)
    if measured.shape != (len(trial.readings),):
        raise InputError(
            "not the readings of this test",
            where=trial.title,
            got=f"{measured.size} values",
            expected=f"{len(trial.readings)}: {', '.join(trial.readings)}",
        )
    if not np.isfinite(measured).any() or np.any(measured <= 0):
        raise InputError(
            "readings are numbers above 0",
            where=trial.title,
            got=measured.tolist(),
            expected=", ".join(trial.readings),
            advice="give NaN for what was not read",
        )
    return measured
