"""One friction joint for all that was said of a structure: posterior, what it determines, what cannot hold together.

Draws follow a path of densities from the prior to the posterior, of one joint and of two, through powers of the
likelihood (sequential Monte Carlo, Del Moral, Doucet and Jasra 2006, Journal of the Royal Statistical Society B
68:411); between two steps emcee moves them (Foreman-Mackey et al. 2013) by differential evolution (ter Braak 2006,
Statistics and Computing 16:239). The law of the joint is one of the parameters, so that the share of the draws with a
law is its weight. Independent runs say how far the result is one of chance.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.special import expit, ndtr
from scipy.stats import t as student_t

from ema.compare.joint_experiments import Experiment, LawExperiment, Weighted, between_joints, between_laws
from ema.compare.joint_loops import LAWS
from ema.compare.joint_model import Datum, Draws, JointModel
from ema.compare.joint_statements import RELATIVE, JointFile
from ema.data.modal import COVERAGE_FACTOR
from ema.progress import Progress, advance, silent

_DRAWS, _RUNS = 600, 4
"""Draws of a run, and independent runs."""
_MOVES, _LAST, _THIN = 40, 60, 20
"""Moves of every draw after a step of the path, and at its ends, where every so many are kept."""
_APART = 1e-3
"""Distance at which draws of one origin begin, over the standard deviation of the prior."""
_KEPT = 0.5
"""Effective share of the draws that a step of the path leaves; with one half a step costs little of their number."""
DETERMINED = 0.5
"""Width of a 95 % interval over that of the prior up to which a parameter is called determined."""
TOGETHER = 0.05
"""Probability of a number or sentence, given all others, below which they do not hold together."""
_EFFECTIVE = 100.0
"""Effective draws below which what the others predict is not known."""
DECIDED = 0.05
"""Weight below which a hypothesis is excluded, and distance from 1 above which it is the only one."""
SAME_FREQUENCY = 0.002
"""Relative distance of two natural frequencies that readings do not tell apart: 1 Hz of 499 Hz, as readings have."""


@dataclass(frozen=True)
class Posterior:
    """Draws of a posterior in standard normal variables, from several independent runs of the same number of draws.

    ``log_evidences`` (run,) are logarithms of the evidence; ``acceptance`` is the share of moves that were taken.
    """

    model: JointModel
    draws: Draws
    log_evidences: Float[np.ndarray, "run"]
    acceptance: float
    interval: dict[str, tuple[float, float]] = field(init=False)

    def __post_init__(self) -> None:
        both = self.model.values(self.draws) | self.model.combinations(self.draws)
        object.__setattr__(self, "interval", {name: _interval(values) for name, values in both.items()})

    @property
    def log_evidence(self) -> float:
        """Logarithm of the mean evidence."""
        return float(np.logaddexp.reduce(self.log_evidences) - np.log(len(self.log_evidences)))

    @property
    def law_shares(self) -> Float[np.ndarray, "run law"]:
        """Weight of every law in every run of the sampler, one over the number of laws beforehand."""
        laws = self.model.laws(self.draws).reshape(len(self.log_evidences), -1)
        return np.asarray((laws[..., None] == np.arange(len(LAWS))).mean(axis=1))

    @property
    def chance(self) -> float:
        """Largest standard error of a mean of all draws over their standard deviation, from what the runs differ by."""
        runs = self.draws.reshape(len(self.log_evidences), -1, self.draws.shape[1])
        error = runs.mean(axis=1).std(axis=0, ddof=1) / np.sqrt(len(runs))
        return float(np.max(error / self.draws.std(axis=0)))


def _interval(values: np.ndarray) -> tuple[float, float]:
    """95 % of draws."""
    low, high = np.quantile(values, [0.025, 0.975])
    return float(low), float(high)


def posteriors(
    model: JointModel, seed: int = 0, progress: Progress = silent, *, runs: int = _RUNS, draws: int = _DRAWS
) -> tuple[Posterior, Posterior | None]:
    """Draw from the posterior of one joint and, where there are two tests, of two joints."""
    one: list[_Particles] = []
    two: list[_Particles] = []
    models = [(model, one)] + [(replace(model, two=True), two)] * (len(model.tests) == 2)
    for number in range(runs):
        advance(progress, "posterior", number + 1, runs)
        rng = np.random.default_rng([seed, number])
        for each, found in models:
            found.append(_to_the_data(_Particles.of_the_prior(each, draws, rng), rng).moved(rng, _LAST))
    return _posterior(one), _posterior(two) if two else None


def _posterior(parts: "Sequence[_Particles]") -> Posterior:
    evidences = np.array([each.log_evidence for each in parts])
    acceptance = float(np.mean([each.acceptance for each in parts]))
    draws = np.concatenate([each.kept for each in parts])
    return Posterior(parts[0].model, draws, evidences, acceptance)


@dataclass(frozen=True)
class _Particles:
    """Draws of the density prior times likelihood to a ``power``, at one place of the path.

    ``draws`` is where each stands, ``kept`` what it passed through on the last moves.
    """

    model: JointModel
    power: float
    draws: Draws
    likelihood: Float[np.ndarray, "draw"]
    log_evidence: float
    kept: Float[np.ndarray, "kept parameter"]
    acceptance: float = 1.0

    @classmethod
    def of_the_prior(cls, model: JointModel, count: int, rng: np.random.Generator) -> "_Particles":
        """Independent draws of the prior."""
        z = rng.standard_normal((count, len(model.parameters)))
        return cls(model, 0.0, z, _total(model, z), 0.0, z)

    def at(self, power: float, rng: np.random.Generator) -> "_Particles":
        """The next place of the path: draws by their weights (systematic resampling), and moved."""
        log_weights = (power - self.power) * self.likelihood
        evidence = self.log_evidence + float(np.logaddexp.reduce(log_weights) - np.log(len(log_weights)))
        weights = np.cumsum(np.exp(log_weights - np.logaddexp.reduce(log_weights)))
        grid = (rng.random() + np.arange(len(weights))) / len(weights)
        rows = np.minimum(np.searchsorted(weights, grid), len(weights) - 1)
        # identical draws have no difference to move by
        z = self.draws[rng.permutation(rows)] + _APART * rng.standard_normal(self.draws.shape)
        return _Particles(self.model, power, z, _total(self.model, z), evidence, z).moved(rng, _MOVES)

    def moved(self, rng: np.random.Generator, steps: int) -> "_Particles":
        """The same density after moves of every draw (differential evolution)."""
        import emcee

        # half the usual reach (ter Braak 2006, eq. 2) beside it, where the density is curved; emcee's snooker move is
        # not used: its factor of the Metropolis ratio has half the exponent of ter Braak and Vrugt (2008), eq. 3
        usual = 2.38 / np.sqrt(2 * self.draws.shape[1])
        moves = [(emcee.moves.DEMove(gamma0=reach * usual), 0.5) for reach in (1.0, 0.5)]
        target = _tempered(self.model, self.power)
        sampler = emcee.EnsembleSampler(*self.draws.shape, target, vectorize=True, moves=moves)
        sampler.random_state = np.random.RandomState(int(rng.integers(2**31))).get_state()
        sampler.run_mcmc(self.draws, steps, progress=False, skip_initial_state_check=True)
        chain, blobs = sampler.get_chain(), sampler.get_blobs()
        kept = chain[_THIN - 1 :: _THIN].reshape(-1, chain.shape[-1])
        acceptance = float(sampler.acceptance_fraction.mean())
        return replace(self, draws=chain[-1], likelihood=blobs[-1].astype(float), kept=kept, acceptance=acceptance)


def _to_the_data(particles: _Particles, rng: np.random.Generator) -> _Particles:
    """From the prior to the posterior through powers of the likelihood."""
    while particles.power < 1:
        particles = particles.at(_next_power(particles), rng)
    return particles


def _next_power(particles: _Particles) -> float:
    """How far along the path the draws carry: the effective share of their weights is ``_KEPT``."""

    def share(power: float) -> float:
        logs = (power - particles.power) * particles.likelihood
        weights = np.exp(logs - logs.max())
        return float(np.sum(weights) ** 2 / np.sum(weights**2) / len(weights))

    if share(1.0) >= _KEPT:
        return 1.0
    low, high = particles.power, 1.0
    for _ in range(20):
        middle = (low + high) / 2
        low, high = (middle, high) if share(middle) >= _KEPT else (low, middle)
    return high


def _total(model: JointModel, z: Draws) -> np.ndarray:
    total = model.log_likelihoods(z).sum(axis=1)
    return np.where(np.isfinite(total), np.maximum(total, -1e6), -1e6)


def _tempered(model: JointModel, power: float) -> Any:
    def density(z: Draws) -> np.ndarray:
        likelihood = _total(model, z)
        return np.column_stack([power * likelihood - 0.5 * np.sum(z**2, axis=1), likelihood])

    return density


@dataclass(frozen=True)
class Held:
    """How a number or sentence stands to all others.

    Parameters
    ----------
    datum : what was said.
    low, high : 95 % interval of the reading that the others predict; forces in N.
    probability : of what was said or of something further off, by the others.

    All are NaN where too few draws tell: this number says what the others leave open, or contradicts the model.
    """

    datum: Datum
    low: float
    high: float
    probability: float

    @property
    def verdict(self) -> str:
        """Whether it holds together with the others."""
        if np.isnan(self.probability):
            return "not known"
        return "does not hold together with the others" if self.probability < TOGETHER else "holds"


@dataclass(frozen=True)
class LawWeight:
    """Posterior weight of a law of the joint, one over the number of laws beforehand.

    ``low`` and ``high`` are its 95 % interval, from what independent runs of the sampler differ by.
    """

    name: str
    weight: float
    low: float
    high: float

    @property
    def verdict(self) -> str:
        """Whether it can be told apart from the others."""
        if self.high < DECIDED:
            return "excluded"
        return "the others are excluded" if self.low > 1 - DECIDED else "cannot be told apart"


@dataclass(frozen=True)
class LiftOff:
    """What follows where the contact cannot pull, from draws of one joint; 95 % intervals.

    Parameters
    ----------
    force : normal force [N] at which the beam begins to leave the structure, at the highest level; NaN where lift-off
        was not assumed.
    lowest : frequency [Hz] at the lowest normal force of the test and the highest level.
    limit : frequency [Hz] as F_N goes to 0, at any level.
    bare : frequency [Hz] without the beam.
    reached : probability that ``limit`` is within 0.2 % of it.
    """

    force: tuple[float, float]
    lowest: tuple[float, float]
    limit: tuple[float, float]
    bare: float
    reached: float


@dataclass(frozen=True)
class JointAssessment:
    """What the numbers and sentences say of one joint: see :func:`joint_posterior`.

    ``one`` and ``two`` are averaged over the laws of the joint, each with its posterior weight, and so is what follows
    for parameters, sentences, the weight of one joint, and experiments.
    """

    one: Posterior
    two: Posterior | None
    held: tuple[Held, ...]
    experiments: tuple[Experiment, ...]
    law_experiments: tuple[LawExperiment, ...] = ()

    @property
    def weight(self) -> float:
        """Posterior probability that both tests had the same joint, one half beforehand; NaN for one test."""
        return self._weight(0.0)

    @property
    def weight_interval(self) -> tuple[float, float]:
        """95 % interval of the weight, from what independent runs of the sampler differ by."""
        if self.two is None:
            return float("nan"), float("nan")
        ratios = self.two.log_evidences - self.one.log_evidences
        reach = float(student_t.ppf(0.975, len(ratios) - 1) * ratios.std(ddof=1) / np.sqrt(len(ratios)))
        return self._weight(reach), self._weight(-reach)

    def _weight(self, shift: float) -> float:
        if self.two is None:
            return float("nan")
        return float(expit(-_log_ratio(self.one, self.two) - shift))

    @property
    def laws(self) -> tuple[LawWeight, ...]:
        """Weight of every law, over one joint and two by their weights; one law alone where the model has that only."""
        if self.one.model.law:
            return (LawWeight(self.one.model.law, 1.0, 1.0, 1.0),)
        runs, mean = self.one.law_shares, self.one.law_shares.mean(axis=0)
        if self.two is not None:
            weight = expit(self.one.log_evidences - self.two.log_evidences)[:, None]
            runs = weight * runs + (1 - weight) * self.two.law_shares
            mean = self.weight * mean + (1 - self.weight) * self.two.law_shares.mean(axis=0)
        reach = student_t.ppf(0.975, len(runs) - 1) * runs.std(axis=0, ddof=1) / np.sqrt(len(runs))
        # none of n draws: a share of 3/n, the 95 % limit of a binomial count of 0; the draws of a walk count once
        floor = 3 * (_LAST // _THIN) / len(self.one.draws)
        low, high = np.clip(mean - reach, 0, 1 - floor), np.clip(mean + reach, floor, 1)
        return tuple(LawWeight(name, *map(float, row)) for name, *row in zip(LAWS, mean, low, high, strict=True))

    @property
    def lift_off(self) -> LiftOff | None:
        """Lift-off in the shaker test and the frequency as F_N goes to 0; None without a shaker test of ``[bare]``."""
        model, z = self.one.model, self.one.draws
        if None not in model.file.modes_of_shaker:
            return None
        levels, forces = (np.sort(each) for each in model.file.swept(None))
        beam = model.beam(z, "shaker")
        lowest = model.shaker(z, "shaker", np.array([[levels[-1]], [forces[0]]]))[0][:, 0]
        # no contact stiffness is left, nor the mass but for what is carried otherwise
        limit = beam.bare * (1 - beam.drop * (1.0 if beam.carried is None else beam.carried))
        opens = (float("nan"),) * 2 if beam.opens is None else _interval(beam.opens * levels[-1])
        reached = float(np.mean(np.abs(limit / beam.bare - 1) < SAME_FREQUENCY))
        return LiftOff(opens, _interval(lowest), _interval(limit), beam.bare, reached)

    def determined(self, name: str) -> bool:
        """Whether the 95 % interval is at most half as wide as before, whatever the runs of the sampler differ by."""
        runs = np.split(self.one.draws, len(self.one.log_evidences))
        apart = np.std([self._narrowing(name, draws) for draws in runs], ddof=1) / np.sqrt(len(runs))
        return self.narrowing(name) + COVERAGE_FACTOR * float(apart) <= DETERMINED

    def narrowing(self, name: str) -> float:
        """Width of the 95 % interval over that of the prior, of logarithms except where the prior is even."""
        return self._narrowing(name, self.one.draws)

    def _narrowing(self, name: str, draws: Draws) -> float:
        model = self.one.model
        prior = np.random.default_rng(0).standard_normal((20000, draws.shape[1]))
        even = any(one.uniform for one in model.parameters if one.name == name)
        widths = []
        for z in (draws, prior):
            values = (model.values(z) | model.combinations(z))[name]
            widths.append(np.ptp(np.array(_interval(values if even else np.log(values)))))
        return float(widths[0] / widths[1])


def _log_ratio(one: Posterior, two: Posterior) -> float:
    """Logarithm of the evidence of two joints over that of one, each the mean over its runs."""
    return float(np.logaddexp.reduce(two.log_evidences) - np.logaddexp.reduce(one.log_evidences))


def joint_posterior(file: JointFile, seed: int = 0, progress: Progress = silent) -> JointAssessment:
    """Find one friction law for all numbers and sentences: what they determine, and which cannot hold together.

    The joint is a spring whose stiffness grows with the normal force and which yields by one of three laws (Masing,
    Iwan, Dahl), as probable as each other beforehand; place, beam, hammer and shaker are nuisance parameters with
    stated priors. Where there is a hammer and a shaker test, one joint is compared with two. How often intervals and
    weights are right on tables of this model is counted in docs/joint.md (simulation-based calibration); the error of
    the model is not in them.

    Parameters
    ----------
    file : JointFile
        Numbers and sentences, each a likelihood (``compare.joint_statements.load``).
    seed : int, default 0
        The same seed gives the same draws.
    progress : Progress, optional
        Called after each stage.

    Returns
    -------
    JointAssessment
        Posterior of one joint and of two, weights of the laws, how each sentence stands to the others, lift-off, and
        what experiments would decide.

    Examples
    --------
    >>> from ema.compare.joint_statements import JointFile
    >>> file = JointFile(title="table", bare={"frequency": "499 Hz", "damping": "0.6 %"},
    ...                  hammer=[{"sentence": "509 Hz", "normal_force": "10 kN", "frequency": "509 Hz"}])
    >>> found = joint_posterior(file)
    >>> found.determined("friction coefficient")
    False
    """
    one, two = posteriors(JointModel(file), seed, progress)
    held = tuple(_held(one, row) for row in range(len(one.model.data)))
    parts = weighted(one, two)
    return JointAssessment(one, two, held, between_joints(*parts) if two is not None else (), between_laws(parts))


def weighted(one: Posterior, two: Posterior | None) -> tuple[Weighted, ...]:
    """Draws of one joint and of two, each with its weight."""
    if two is None:
        return (Weighted(one.model, one.draws, np.full(len(one.draws), 1 / len(one.draws))),)
    weight = float(expit(-_log_ratio(one, two)))
    shares = zip((one, two), (weight, 1 - weight), strict=True)
    return tuple(Weighted(each.model, each.draws, np.full(len(each.draws), w / len(each.draws))) for each, w in shares)


def _held(found: Posterior, row: int) -> Held:
    """A datum as all others predict it: draws weighted by one over its likelihood."""
    datum = found.model.data[row]
    reading = found.model.readings(found.draws)[:, row]
    logs = -datum.log_likelihood(reading)
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    log = datum.quantity.endswith(RELATIVE)
    noise = datum.std * np.random.default_rng(row).standard_normal(len(reading))
    order = np.argsort(reading + noise)
    share = np.cumsum(weights[order])
    ends = [
        float((reading + noise)[order][min(int(np.searchsorted(share, q)), len(share) - 1)]) for q in (0.025, 0.975)
    ]
    if 1 / np.sum(weights**2) < _EFFECTIVE:
        return Held(datum, float("nan"), float("nan"), float("nan"))
    if np.isfinite(datum.value):
        below = float(np.sum(weights * ndtr((datum.value - reading) / datum.std)))
        chance = 2 * min(below, 1 - below)
    else:
        chance = float(np.sum(weights * np.exp(datum.log_likelihood(reading))))
    low, high = np.exp(ends) if log else ends
    return Held(datum, float(low), float(high), chance)
