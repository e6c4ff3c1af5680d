"""Frequency and damping of a mode at amplitudes that were not measured, from joint laws with their model error."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float

from ema.compare.modal_laws import LAWS, ModalLaw
from ema.compare.modal_posterior import FEWEST, Conditional, LawPosterior, Observations, posterior
from ema.data import AmplitudeDependentMode, AmplitudePrediction, Band, Finding
from ema.data.amplitude import LawParameter
from ema.errors import InputError

_LEAST_DAMPING = 0.002
"""Least relative standard uncertainty of a damping ratio that is believed: what a sensor's calibration allows."""
_LEAST_FREQUENCY = 1e-6
"""Least relative standard uncertainty of a frequency that is believed: what the clock of a converter allows."""
_FIRST = 3
"""Lowest levels from which on higher ones are predicted to score the laws: fewer leave every law free."""
_AHEAD = 2.2
"""Largest ratio of amplitudes over which a prediction is scored: to twice the highest level, which is promised."""
_PSEUDO = 1.0
"""Levels that count for equal weights of all laws, beside those scored."""
_COUNT = 4000
"""Draws of all laws together: 100 lie beyond either end of a 95 % band."""
_TOGETHER = 200
"""Parameter draws whose covariance at many amplitudes is in memory at once: 120 amplitudes take 50 MB."""
_DRAWN = 0.95
"""Share of the weight of the laws from which on the bands are theirs: what a 95 % band leaves out anyway."""
_FAR = 2.0
"""Amplitude over the highest measured one, or lowest measured one over it, beyond which bands were not calibrated."""
_MISMATCH = 3.0
"""Ratio of the model-form discrepancies of frequency and damping from which a law explains one and not the other."""
_PROBABILITY = 0.95
"""Probability from which on a law is said to explain one of frequency and damping and not the other."""
_WEIGHTY = 0.1
"""Weight of a law from which on its draws matter to the 95 % bands of all laws."""


def predict_amplitudes(
    mode: AmplitudeDependentMode,
    amplitudes: Sequence[float],
    *,
    laws: Sequence[ModalLaw] = LAWS,
    seed: int = 1,
) -> AmplitudePrediction:
    """Predict frequency and damping of a mode at other amplitudes, with 95 % bands.

    Every law is fitted to frequency and damping of all levels at once, with a model-form discrepancy whose variance
    grows with the distance in log amplitude. The laws are weighted by stacking of how well each predicts the highest
    levels from those below.

    Parameters
    ----------
    mode : AmplitudeDependentMode
        The measured levels, two or more.
    amplitudes : sequence of float
        Where to predict, in the SI unit of the mode's quantity.
    laws : sequence of ModalLaw, optional
        Joint laws that are fitted.
    seed : int, default 1
        Seed of the draws.

    Returns
    -------
    AmplitudePrediction
        Medians and 95 % bands, the weights of the laws, what is known of their parameters, and a statement how far
        outside the data the prediction lies.

    Raises
    ------
    InputError
        If there are fewer than two levels, an amplitude is not positive, or no law has a positive loss at one.

    References
    ----------
    .. [1] Stacking: Yao et al. (2018), Bayesian Analysis 13:917; leaving the future out: Bürkner, Gabry and Vehtari
       (2020), Journal of Statistical Computation and Simulation 90:2499.

    Examples
    --------
    >>> from ema.data import AmplitudeDependentMode, Band
    >>> level = np.array([5.0, 10.0, 20.0, 40.0])
    >>> f, zeta = 100 - 0.01 * level, 0.001 + 1e-4 * level
    >>> mode = AmplitudeDependentMode(
    ...     level, Band(f - 0.01, f, f + 0.01), Band(0.98 * zeta, zeta, 1.02 * zeta), quantity="acceleration"
    ... )
    >>> prediction = predict_amplitudes(mode, [60.0, 80.0])
    >>> prediction.statement
    '60 to 80 m/s^2 is 1.5 to 2 times the highest amplitude measured (40 m/s^2).'
    """
    at = np.asarray(amplitudes, np.float64)
    check_prediction(mode, at)
    mixture = LawMixture.of(mode, at, laws, seed)
    levels, weights, posteriors, fitted = len(mode.amplitude), mixture.weights, mixture.posteriors, mixture.fitted
    drawn, share = mixture.sample(_COUNT, np.random.default_rng(seed))
    if not len(drawn):
        raise InputError(
            "no law leaves a positive loss at these amplitudes",
            where=mode.name or "mode",
            got=amplitude_statement(mode.quantity, mode.amplitude, at),
            advice="predict nearer to the measured levels",
        )
    best = int(np.argmax(weights))
    return AmplitudePrediction(
        amplitude=at,
        frequency=_band(float(mode.frequency.value[0]) * np.sqrt(drawn[:, 0])),
        damping=_band(drawn[:, 1] / (2 * drawn[:, 0])),
        beyond=at / mode.amplitude[-1],
        laws=tuple(law.name for law in laws),
        weights=weights,
        quantity=mode.quantity,
        force=_force(mode, at, drawn),
        statement=amplitude_statement(mode.quantity, mode.amplitude, at),
        name=mode.name,
        parameters=identifiability(posteriors[best], levels),
        findings=(
            *_about(mode, at),
            *_explained(mode, fitted[best]),
            *few_draws(mode, fitted, weights),
            *laws_left_out(mode, share),
        ),
    )


@dataclass(frozen=True)
class LawMixture:
    """Joint laws fitted to the levels of a mode, weighted by stacking, and to be predicted at some amplitudes."""

    posteriors: Sequence[LawPosterior]
    fitted: Sequence[Conditional]
    weights: Float[np.ndarray, "law"]

    @classmethod
    def of(
        cls, mode: AmplitudeDependentMode, at: Float[np.ndarray, "point"], laws: Sequence[ModalLaw], seed: int
    ) -> "LawMixture":
        """Fit every law and weigh it."""
        data = observations(mode)
        targets = np.log(at / mode.amplitude[0])
        posteriors = [posterior(law, data, targets, seed=seed) for law in laws]
        weights = stacking_weights(*leave_future_out(posteriors, data))
        return cls(posteriors, [drawn.given(len(mode.amplitude)) for drawn in posteriors], weights)

    def along(
        self, targets: Float[np.ndarray, "target"], count: int, generator: np.random.Generator
    ) -> tuple[Float[np.ndarray, "draw 2 target"], float]:
        """The same as ``sample`` at many ln(a / a_1): a few parameter draws at a time get the covariance there."""
        counts = np.round(count * self.weights).astype(int)
        index = len(self.posteriors[0].data.distance) + np.arange(len(targets))
        parts = []
        for fitted, total in zip(self.fitted, counts, strict=True):
            whole = fitted.posterior
            for size in np.diff([*range(0, total, _TOGETHER), total]):
                some = generator.choice(len(fitted.weights), size=size, p=fitted.weights)
                few = replace(whole, targets=targets, unit=whole.unit[some], log_proposal=whole.log_proposal[some])
                equal = Conditional(few, fitted.lowest, fitted.mean[some], fitted.covariance[some], np.zeros(size))
                parts.append(equal.sample(index, int(size), generator))
        drawn = np.concatenate(parts)
        return drawn, len(drawn) / float(counts.sum())

    def sample(self, count: int, generator: np.random.Generator) -> tuple[Float[np.ndarray, "draw 2 point"], float]:
        """About ``count`` draws of lambda and eta at the amplitudes, law by law, and the share of them that laws
        leave: a draw counts where loss and stiffness are positive at every amplitude."""
        first = self.posteriors[0]
        index = len(first.data.distance) + np.arange(len(first.targets))
        counts = np.round(count * self.weights).astype(int)
        parts = [one.sample(index, int(n), generator) for one, n in zip(self.fitted, counts, strict=True) if n]
        drawn = np.concatenate(parts)
        return drawn, len(drawn) / float(counts.sum())


def observations(mode: AmplitudeDependentMode) -> Observations:
    """Frequency and damping of a mode as lambda = (f / f_1)^2 and eta = 2 zeta lambda, with standard uncertainties."""
    ratio = mode.frequency.value / mode.frequency.value[0]
    frequency = np.hypot(mode.frequency.std / mode.frequency.value, _LEAST_FREQUENCY)
    damping = np.hypot(mode.damping.std / mode.damping.value, _LEAST_DAMPING)
    stiffness = ratio**2
    loss = 2 * mode.damping.value * stiffness
    return Observations(
        np.log(mode.amplitude / mode.amplitude[0]),
        np.stack([stiffness, loss]),
        np.stack([2 * stiffness * frequency, loss * damping]),
    )


def leave_future_out(
    posteriors: Sequence[LawPosterior], data: Observations
) -> tuple[Float[np.ndarray, "case law"], Float[np.ndarray, "case"]]:
    """Log predictive densities of levels given those below, and the weights of the cases (one for each cut)."""
    levels = len(data.distance)
    scores: list[list[float]] = []
    weights: list[float] = []
    for lowest in range(_FIRST, levels):
        ahead = [i for i in range(lowest, levels) if data.distance[i] - data.distance[lowest - 1] <= np.log(_AHEAD)]
        fitted = [drawn.given(lowest) for drawn in posteriors]
        for index in ahead or [lowest]:
            scores.append([one.log_density(index) for one in fitted])
            weights.append(1 / max(len(ahead), 1))
    return np.array(scores).reshape(-1, len(posteriors)), np.array(weights)


def stacking_weights(
    scores: Float[np.ndarray, "case law"], cases: Float[np.ndarray, "case"]
) -> Float[np.ndarray, "law"]:
    """Weights of the laws whose mixture has the highest predictive density (Yao et al. 2018, Eq. 4).

    With ``_PSEUDO`` cases for equal weights: a Dirichlet prior, without which few levels would choose one law alone.
    """
    count = scores.shape[1]
    weights = np.full(count, 1 / count)
    if not len(scores):
        return weights
    density = np.exp(scores - scores.max(axis=1, keepdims=True))
    for _ in range(500):
        share = density * weights
        share /= share.sum(axis=1, keepdims=True)
        weights = cases @ share + _PSEUDO / count
        weights /= weights.sum()
    return weights


def identifiability(drawn: LawPosterior, levels: int) -> tuple[LawParameter, ...]:
    """Of each parameter in which a law is not linear: value, 95 % interval, and whether the data identify it.

    They do where the interval, model-form discrepancy included, closes inside the range of the prior, the standard
    deviation is below a third of the prior's, and the estimates without the highest level and without the highest two
    agree within their intervals. That says nothing of levels that were not measured: see ``confirmed``.
    """
    names, values, ends = drawn.parameters()
    cuts = [drawn.given(count) for count in range(max(levels - 2, 2), levels + 1)]
    out = []
    for n, name in enumerate(names):
        column, (low, high) = values[:, n], ends[n]
        quantile = partial(_quantiles, column)
        intervals = np.array([quantile(one.weights) for one in cuts])
        whole, weights = intervals[-1], cuts[-1].weights
        std = float(np.sqrt(weights @ (column - weights @ column) ** 2))
        margin = 0.02 * (high - low)
        reasons = []
        if whole[0] < low + margin or whole[2] > high - margin:
            reasons.append("its interval does not close within the prior")
        if std > (high - low) / np.sqrt(12) / 3:
            reasons.append("its standard deviation is above a third of the prior's")
        if np.any(intervals[:, 0] > intervals[:, 2].min()) or len(cuts) < 2:
            reasons.append("its estimates with levels left out disagree")
        if cuts[-1].effective_draws < FEWEST:
            reasons.append("too few draws describe it")
        bounds = float(whole[0]), float(whole[1]), float(whole[2])
        out.append(LawParameter(drawn.law.name, name, *bounds, not reasons, "; ".join(reasons)))
    return tuple(out)


def confirmed(prediction: AmplitudePrediction, mode: AmplitudeDependentMode) -> tuple[int, int]:
    """Count the levels left out of a prediction that lie inside its bands, with frequency and damping.

    Parameters
    ----------
    prediction : AmplitudePrediction
        Predicted frequency and damping.
    mode : AmplitudeDependentMode
        Levels at the amplitudes of the prediction (within 1 %). Others do not count, and neither do those within the
        amplitudes that were fitted: they are no test.

    Returns
    -------
    tuple of (int, int)
        Levels inside the bands, and levels compared.

    Examples
    --------
    >>> from ema.data import Band
    >>> frequency, damping = Band([39.0], [39.5], [40.0]), Band([0.01], [0.02], [0.03])
    >>> prediction = AmplitudePrediction([10.0], frequency, damping, beyond=[2.0], laws=("iwan",), weights=[1.0])
    >>> confirmed(prediction, AmplitudeDependentMode([10.0], frequency, damping))
    (1, 1)
    """
    inside = total = 0
    for n, amplitude in enumerate(prediction.amplitude):
        level = int(np.argmin(np.abs(mode.amplitude / amplitude - 1)))
        if abs(mode.amplitude[level] / amplitude - 1) > 0.01 or prediction.beyond[n] <= 1.01:
            continue
        total += 1
        inside += all(
            band.low[n] <= measured.value[level] <= band.high[n]
            for band, measured in ((prediction.frequency, mode.frequency), (prediction.damping, mode.damping))
        )
    return inside, total


def _quantiles(values: Float[np.ndarray, "draw"], weights: Float[np.ndarray, "draw"]) -> Float[np.ndarray, "3"]:
    order = np.argsort(values)
    return np.asarray(np.interp([0.025, 0.5, 0.975], np.cumsum(weights[order]), values[order]))


def check_prediction(mode: AmplitudeDependentMode, at: Float[np.ndarray, "point"]) -> None:
    """Refuse fewer than two levels, and what is no amplitude."""
    where = mode.name or "mode"
    if len(mode.amplitude) < 2:
        raise InputError(
            "one level says nothing of other amplitudes",
            where=where,
            got=f"{len(mode.amplitude)} level",
            expected="two or more; five for bands that are of use",
            advice="measure at more levels",
        )
    if not len(at) or not np.all(np.isfinite(at) & (at > 0)):
        raise InputError("not an amplitude to predict at", where=where, got=at.tolist(), expected="amplitudes above 0")


def _band(values: Float[np.ndarray, "draw point"]) -> Band:
    low, value, high = np.quantile(values, [0.025, 0.5, 0.975], axis=0)
    return Band(low, value, high, 0.95, "noise of the levels, parameters and form of the law")


def _force(mode: AmplitudeDependentMode, at: np.ndarray, drawn: np.ndarray) -> Band | None:
    """Force at resonance, F = 2 zeta m w^2 x."""
    if not np.isfinite(mode.modal_mass):
        return None
    angular = 2 * np.pi * float(mode.frequency.value[0])
    power = {"displacement": 2, "velocity": 1, "acceleration": 0}[mode.quantity]
    # eta (w_1)^2 x, with x = a / w^2: the ratio of both frequencies is lambda
    return _band(mode.modal_mass * drawn[:, 1] * at * angular**power / drawn[:, 0] ** (1 - power / 2))


def amplitude_statement(
    quantity: str, levels: Float[np.ndarray, "level"], at: Float[np.ndarray, "point"], what: str = "amplitudes"
) -> str:
    """Say how far outside the measured levels amplitudes lie."""
    from ema.units import SI_UNIT

    unit, top, bottom = SI_UNIT[quantity], float(levels[-1]), float(levels[0])
    above, below = at[at > top], at[at < bottom]
    inside = len(at) - len(above) - len(below)

    def span(values: np.ndarray) -> str:
        low, high = f"{values.min():.3g}", f"{values.max():.3g}"
        return low if low == high else f"{low} to {high}"

    parts = []
    if len(above):
        parts.append(
            f"{span(above)} {unit} is {span(above / top)} times the highest amplitude measured ({top:.3g} {unit})"
        )
    if len(below):
        parts.append(f"{span(below)} {unit} is {span(bottom / below)} times below the lowest one ({bottom:.3g} {unit})")
    if inside == len(at):
        parts.append(f"{'All' if inside > 1 else 'It'} {'lie' if inside > 1 else 'lies'} between measured levels")
    elif inside:
        parts.append(f"{inside} of {len(at)} {what} lie between measured levels")
    return "; ".join(parts) + "."


def _about(mode: AmplitudeDependentMode, at: np.ndarray) -> list[Finding]:
    """Amplitudes further from the measured levels than the bands were calibrated for."""
    above, below = float(at.max() / mode.amplitude[-1]), float(mode.amplitude[0] / at.min())
    findings = []
    for far, text in (
        (above, f"the highest amplitude is {above:.3g} times the highest measured one."),
        (below, f"the lowest measured amplitude is {below:.3g} times the lowest one predicted."),
    ):
        if far > _FAR * (1 + 1e-9):
            advice = "The bands are calibrated up to twice the highest level; measure nearer to these amplitudes."
            findings.append(Finding("warning", "far-outside-the-data", mode.name, text, far, _FAR, advice))
    return findings


def laws_left_out(mode: AmplitudeDependentMode, share: float) -> list[Finding]:
    """Laws that leave a positive loss and stiffness at these amplitudes so rarely that others stand for them."""
    if share >= _DRAWN:
        return []
    text = f"{1 - share:.0%} of the weight of the laws has no part in the bands: they leave no positive loss there."
    advice = "The bands are those of the other laws; predict nearer to the measured levels."
    return [Finding("warning", "laws-left-out", mode.name, text, share, _DRAWN, advice)]


def few_draws(mode: AmplitudeDependentMode, fitted: Sequence[Conditional], weights: np.ndarray) -> list[Finding]:
    """Laws of weight whose posterior few draws describe: the ends of the bands rest on these."""
    few = [
        one for one, weight in zip(fitted, weights, strict=True) if weight >= _WEIGHTY and one.effective_draws < FEWEST
    ]
    if not few:
        return []
    least = min(one.effective_draws for one in few)
    return [
        Finding.of(
            "warning",
            "few-draws",
            mode.name,
            "{few}: {least} effective draws describe the parameters.",
            least,
            float(FEWEST),
            advice="The ends of the bands are rough; another seed shows how rough.",
            few=", ".join(one.posterior.law.name for one in few),
            least=f"{least:.0f}",
        )
    ]


def _explained(mode: AmplitudeDependentMode, fitted: Conditional) -> list[Finding]:
    """A law whose discrepancy in one of frequency and damping is much larger than in the other."""
    sigma = fitted.posterior.nonlinear["sigma"]
    for one, other, more, less in ((0, 1, "frequency", "damping"), (1, 0, "damping", "frequency")):
        share = float(fitted.weights @ (sigma[:, one] > _MISMATCH * sigma[:, other]))
        if share > _PROBABILITY:
            return [
                Finding(
                    "warning",
                    "law-explains-half",
                    mode.name,
                    f"{fitted.posterior.law.name} explains the {less} over the amplitude and not the {more}.",
                    share,
                    _PROBABILITY,
                    "Something beside the joint's friction changes with the amplitude: geometry, contact area, "
                    "temperature, or the control of the test.",
                )
            ]
    return []
