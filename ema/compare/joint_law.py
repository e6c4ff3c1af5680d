"""One friction law for all that was said of a structure: posterior, what it determines, and what cannot hold together.

Parameters are transforms of standard normal variables, so that the prior is the same for all of them. The sampler is
emcee (Foreman-Mackey et al. 2013); the evidence comes from powers of the likelihood (stepping stones, Xie et al. 2011,
Systematic Biology 60:150).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.special import log_ndtr, ndtr

from ema.compare.joint_readings import Beam, hammer, shaker
from ema.compare.joint_statements import RELATIVE, JointFile, SentenceTable
from ema.progress import Progress, advance, silent

Draws = Float[np.ndarray, "draw parameter"]
_RIDGE_POINTS = 14
_WALKERS, _POWERS, _STEPS, _LAST = 64, 9, 60, 400
DETERMINED = 0.5
"""Width of a 95 % interval over that of the prior up to which a parameter is called determined."""
TOGETHER = 0.05
"""Probability of a number or sentence, given all others, below which they do not hold together."""
_EFFECTIVE = 100.0
"""Effective draws below which what the others predict is not known."""
_Z = 1.959964


@dataclass(frozen=True)
class Parameter:
    """A parameter as a transform of a standard normal variable: lognormal with a 95 % range, or uniform."""

    name: str
    low: float
    high: float
    uniform: bool = False

    def of(self, z: np.ndarray) -> np.ndarray:
        """Values at standard normal variables."""
        if self.uniform:
            return np.asarray(self.low + (self.high - self.low) * ndtr(z))
        middle, half = np.sqrt(self.low * self.high), np.log(self.high / self.low) / 2
        return np.asarray(middle * np.exp(half * z / _Z))


def _ranged(name: str, ends: Sequence[float], *, uniform: bool = False) -> Parameter:
    low, high = ends
    return Parameter(name, low, high, uniform)


@dataclass(frozen=True)
class Datum:
    """A number or a sentence: a reading in its own scale, with its standard deviation.

    ``value`` is NaN for a sentence, which says that the reading lies between ``low`` and ``high``.
    """

    text: str
    quantity: str
    std: float
    value: float = float("nan")
    low: float = -np.inf
    high: float = np.inf

    def log_likelihood(self, reading: np.ndarray) -> np.ndarray:
        """Logarithm of the density of the value, or of the probability of the sentence."""
        if np.isfinite(self.value):
            z = (self.value - reading) / self.std
            return np.asarray(-0.5 * z**2 - np.log(self.std * np.sqrt(2 * np.pi)))
        upper, lower = (self.high - reading) / self.std, (self.low - reading) / self.std
        # Phi(b) - Phi(a), in the tail that is smaller
        turn = lower > 0
        a, b = np.where(turn, -upper, lower), np.where(turn, -lower, upper)
        return np.asarray(log_ndtr(b) + np.log1p(-np.exp(np.minimum(log_ndtr(a) - log_ndtr(b), -1e-15))))


@dataclass(frozen=True)
class JointModel:
    """Parameters, and the readings that they lead to, of one or of two joints."""

    told: JointFile
    two: bool = False

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The joint's (of both tests, or of either), then those of the hammer test and of the shaker test."""
        prior = self.told.prior
        joint = [
            _ranged("friction coefficient", prior.friction_coefficient),
            _ranged("exponent of k_T", prior.exponent, uniform=True),
            Parameter("loss factor", 0.0, 0.1, True),
        ]
        parts = [one for one, said in (("hammer", self.told.hammer), ("shaker", self.told.shaker)) if said]
        found = [replace(one, name=f"{one.name}, {part}") for part in parts for one in joint] if self.two else joint
        for part in parts:
            found += [
                Parameter(f"drop by the mass, {part}", 0.0, 0.06, True),
                Parameter(f"added damping, {part}", 0.0, 0.003, True),
                Parameter(f"stiffness ratio at 1 kN, {part}", 0.005, 0.5),
                Parameter(f"stiffness ratio in series, {part}", 0.01, 2.0),
            ]
        if self.told.hammer:
            found += [
                _ranged("shape over slip, hammer", prior.hammer_shape),
                _ranged("peak force", prior.peak_force),
            ]
        if self.told.shaker:
            found.append(_ranged("shape over slip, shaker", prior.shaker_shape))
        return tuple(found)

    @property
    def data(self) -> tuple[Datum, ...]:
        """Numbers and sentences."""
        return tuple(_data(self.told))

    def values(self, z: Draws) -> dict[str, np.ndarray]:
        """Parameters by name."""
        return {one.name: one.of(z[:, row]) for row, one in enumerate(self.parameters)}

    def combinations(self, z: Draws) -> dict[str, np.ndarray]:
        """What a test determines better than its parts."""
        p, found = self.values(z), {}
        if self.told.hammer:
            found["peak force over friction coefficient"] = (
                p["peak force"] / p[self._named("friction coefficient", "hammer")]
            )
        if self.told.shaker:
            ratio = p["shape over slip, shaker"] / p[self._named("friction coefficient", "shaker")]
            found["shape over slip over friction coefficient, shaker"] = ratio
        return found

    def _named(self, name: str, part: str) -> str:
        return f"{name}, {part}" if self.two else name

    def _beam(self, p: Mapping[str, np.ndarray], part: str) -> Beam:
        bare = self.told.bare
        return Beam(
            bare.frequency,
            drop=p[f"drop by the mass, {part}"],
            damping=bare.damping + p[f"added damping, {part}"],
            stiffness=p[f"stiffness ratio at 1 kN, {part}"],
            rest=p[f"stiffness ratio in series, {part}"],
            exponent=p[self._named("exponent of k_T", part)],
            loss=p[self._named("loss factor", part)],
        )

    def hammer(self, z: Draws, forces: np.ndarray, scale: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """Frequency and damping that hammer tests read, the impacts ``scale`` times as hard."""
        p = self.values(z)
        # q = phi J / w with J = 2 T F / pi, over the slip mu F_N / (k psi): phi/psi (2 T w / pi) ratio F / (mu F_N)
        impulse = p["shape over slip, hammer"] * 4 * self.told.prior.contact_time * self.told.bare.frequency
        impulse = scale * impulse * p["peak force"] / p[self._named("friction coefficient", "hammer")]
        return hammer(self._beam(p, "hammer"), forces, impulse)

    def readings(self, z: Draws) -> Float[np.ndarray, "draw datum"]:
        """What every number and sentence is about, in its own scale (logarithms for forces)."""
        columns: list[np.ndarray] = []
        if self.told.hammer:
            frequency, damping = self.hammer(z, np.array([one.normal_force for one in self.told.hammer]))
            for row, one in enumerate(self.told.hammer):
                columns += [frequency[:, row]] * (one.frequency is not None)
                columns += [damping[:, row]] * (one.damping is not None)
        if self.told.shaker:
            p = self.values(z)
            drive = p["shape over slip, shaker"] / p[self._named("friction coefficient", "shaker")]
            test = _Shaker(self._beam(p, "shaker"), drive, np.sort(self.told.levels), np.sort(self.told.normal_forces))
            columns += [test.reading(one) for one in self.told.shaker]
        return np.stack(columns, axis=1)

    def log_likelihoods(self, z: Draws) -> Float[np.ndarray, "draw datum"]:
        """Of every number and sentence."""
        found = self.readings(z)
        return np.stack([one.log_likelihood(found[:, row]) for row, one in enumerate(self.data)], axis=1)


@dataclass(frozen=True)
class _Shaker:
    beam: Beam
    drive: np.ndarray
    levels: np.ndarray
    forces: np.ndarray

    def reading(self, told: SentenceTable) -> np.ndarray:
        """The quantity of a sentence."""
        last = self.forces[-1]
        kind = told.quantity
        if kind == "stuck frequency":
            return self._at([self.levels[0]], [last])[0][:, 0]
        if kind in ("ridge", "drop", "stuck damping"):
            grid = np.geomspace(max(self.forces[0], 1e-3 * last), last, _RIDGE_POINTS)
            frequency, damping = self._at(np.full(len(grid), told.level), grid)
            place, top = _vertex(damping)
            if kind == "ridge":
                return np.asarray(np.log(grid[0]) + place * np.log(grid[1] / grid[0]))
            if kind == "drop":
                row = np.clip(np.rint(place).astype(int), 0, len(grid) - 1)
                return np.asarray(frequency[np.arange(len(row)), row] - frequency[:, -1])
            return np.asarray(self._at([told.level], [told.normal_force])[1][:, 0] / top)
        damping = self._at(self.levels, np.full(len(self.levels), told.normal_force))[1]
        if kind == "most damping":
            return np.asarray(damping.max(axis=1))
        if kind == "fall":
            return np.asarray(damping[:, -1] / self._at([told.level], [told.normal_force])[1][:, 0])
        place = _vertex(damping)[0]
        return np.asarray(np.interp(place, np.arange(len(self.levels)), np.log(self.levels)))

    def _at(self, levels: Any, forces: Any) -> tuple[np.ndarray, np.ndarray]:
        return shaker(self.beam, np.asarray(levels, float), np.asarray(forces, float), self.drive)


def _vertex(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Place and height of the highest value of every row, by a parabola through it and its neighbours."""
    count = values.shape[1]
    top = values.argmax(axis=1)
    inner = np.clip(top, 1, count - 2)
    left, middle, right = (values[np.arange(len(values)), inner + step] for step in (-1, 0, 1))
    bend = left - 2 * middle + right
    shift = np.where(bend < 0, 0.5 * (left - right) / np.where(bend < 0, bend, -1.0), 0.0)
    at_end = inner != top
    shift = np.where(at_end, top - inner, np.clip(shift, -0.5, 0.5))
    height = np.where(at_end, values.max(axis=1), middle - 0.25 * (left - right) * shift)
    return inner + shift, height


def _data(told: JointFile) -> list[Datum]:
    found = []
    for one in told.hammer:
        where = f"hammer, {one.normal_force:g} N"
        if one.frequency is not None:
            found.append(Datum(one.sentence, f"{where}: frequency [Hz]", one.frequency_std, one.frequency))
        if one.damping is not None:
            found.append(Datum(one.sentence, f"{where}: damping ratio", one.damping_std, one.damping))
    for said in told.shaker:
        scale = np.log if said.quantity in RELATIVE else float
        ends = {
            key: float(scale(number))
            for key, number in (("value", said.value), ("low", said.low), ("high", said.high))
            if number is not None
        }
        place = [f"{said.level:g} N excitation"] if said.level is not None else []
        place += [f"F_N {said.normal_force:g} N"] if said.normal_force is not None else []
        found.append(Datum(said.sentence, f"shaker, {', '.join([*place, said.quantity])}", said.std, **ends))
    return found


@dataclass(frozen=True)
class Posterior:
    """Draws of a posterior in standard normal variables, and the logarithm of the evidence."""

    model: JointModel
    draws: Draws
    log_evidence: float
    acceptance: float
    interval: dict[str, tuple[float, float]] = field(init=False)

    def __post_init__(self) -> None:
        both = self.model.values(self.draws) | self.model.combinations(self.draws)
        object.__setattr__(self, "interval", {name: _interval(values) for name, values in both.items()})


def _interval(values: np.ndarray) -> tuple[float, float]:
    """95 % of draws."""
    low, high = np.quantile(values, [0.025, 0.975])
    return float(low), float(high)


def sample(model: JointModel, seed: int = 0, progress: Progress = silent, *, steps: int = _LAST) -> Posterior:
    """Draw from the posterior of a joint, through powers of its likelihood from the prior on."""
    import emcee

    size = len(model.parameters)
    rng = np.random.default_rng(seed)
    powers = np.append((np.arange(_POWERS) / _POWERS) ** 4, 1.0)
    # the first stage is exact: draws of the prior
    z = rng.standard_normal((20 * _WALKERS, size))
    likelihood = _total(model, z)
    evidence, kept, accepted = 0.0, z, np.ones(1)
    for stage in range(1, len(powers)):
        advance(progress, "posterior", stage, len(powers))
        more = (powers[stage] - powers[stage - 1]) * likelihood
        evidence += float(np.logaddexp.reduce(more) - np.log(len(more)))
        weights = np.exp(more - more.max())
        start = _spread(kept[rng.choice(len(kept), _WALKERS, p=weights / weights.sum())], rng)
        state = np.random.RandomState(int(rng.integers(2**31)))
        sampler = emcee.EnsembleSampler(_WALKERS, size, _tempered(model, float(powers[stage])), vectorize=True)
        sampler.random_state = state.get_state()
        last = stage == len(powers) - 1
        sampler.run_mcmc(start, steps if last else _STEPS, progress=False)
        burn = steps // 3 if last else _STEPS // 2
        kept = sampler.get_chain(discard=burn, thin=3, flat=True)
        likelihood = sampler.get_blobs(discard=burn, thin=3, flat=True).astype(float)
        accepted = sampler.acceptance_fraction
    return Posterior(model, kept, evidence, float(accepted.mean()))


def _spread(start: Draws, rng: np.random.Generator) -> Draws:
    """Walkers that stand on one place cannot move apart."""
    return np.asarray(start + 1e-3 * rng.standard_normal(start.shape))


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
    probability : of what was said or of something further off, by the others; NaN where too few draws tell.
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
class Experiment:
    """A measurement that is yet to be made, as one joint and two joints predict it.

    ``separates`` is the share of outcomes, drawn from either, after which the right one has a weight of 0.95.
    """

    name: str
    one: tuple[float, float]
    two: tuple[float, float]
    separates: float


@dataclass(frozen=True)
class JointAssessment:
    """What the numbers and sentences say of one joint: see :func:`joint_posterior`."""

    one: Posterior
    two: Posterior | None
    held: tuple[Held, ...]
    experiments: tuple[Experiment, ...]

    @property
    def weight(self) -> float:
        """Posterior probability that both tests had the same joint, one half beforehand; NaN for one test."""
        if self.two is None:
            return float("nan")
        return float(1 / (1 + np.exp(self.two.log_evidence - self.one.log_evidence)))

    def determined(self, name: str) -> bool:
        """Whether the 95 % interval is at most half as wide as before, in logarithms except where the prior is even."""
        return self.narrowing(name) <= DETERMINED

    def narrowing(self, name: str) -> float:
        """Width of the 95 % interval over that of the prior."""
        model = self.one.model
        z = np.random.default_rng(0).standard_normal((20000, len(model.parameters)))
        values = (model.values(z) | model.combinations(z))[name]
        even = any(one.uniform for one in model.parameters if one.name == name)
        scale = (lambda x: np.asarray(x)) if even else np.log
        before = np.ptp(scale(np.quantile(values, [0.025, 0.975])))
        return float(np.ptp(scale(np.array(self.one.interval[name]))) / before)


def joint_posterior(told: JointFile, seed: int = 0, progress: Progress = silent) -> JointAssessment:
    """Find one friction law for all numbers and sentences: what they determine, and which cannot hold together.

    The law is a Masing spring whose stiffness grows with the normal force; place, beam, hammer and shaker are nuisance
    parameters with stated priors. Where there is a hammer and a shaker test, one joint is compared with two. The
    coverage of the intervals and the weights have not been calibrated yet.

    Parameters
    ----------
    told : JointFile
        Numbers and sentences, each a likelihood (``compare.joint_statements.load``).
    seed : int, default 0
        The same seed gives the same draws.
    progress : Progress, optional
        Called after each stage.

    Returns
    -------
    JointAssessment
        Posterior of one joint and of two, how each sentence stands to the others, and what experiments would decide.

    Examples
    --------
    >>> from ema.compare.joint_statements import JointFile
    >>> told = JointFile(title="table", bare={"frequency": "499 Hz", "damping": "0.6 %"},
    ...                  hammer=[{"sentence": "509 Hz", "normal_force": "10 kN", "frequency": "509 Hz"}])
    >>> found = joint_posterior(told)
    >>> found.determined("friction coefficient")
    False
    """
    one = sample(JointModel(told), seed, progress)
    two = sample(JointModel(told, two=True), seed + 1, progress) if told.hammer and told.shaker else None
    experiments = _experiments(one, two) if two is not None else ()
    return JointAssessment(one, two, tuple(_held(one, row) for row in range(len(one.model.data))), experiments)


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
        chance = float("nan")
    elif np.isfinite(datum.value):
        below = float(np.sum(weights * ndtr((datum.value - reading) / datum.std)))
        chance = 2 * min(below, 1 - below)
    else:
        chance = float(np.sum(weights * np.exp(datum.log_likelihood(reading))))
    low, high = np.exp(ends) if log else ends
    return Held(datum, float(low), float(high), chance)


def _experiments(one: Posterior, two: Posterior) -> tuple[Experiment, ...]:
    """Outcomes of single measurements under either hypothesis, with the noise that they would have."""
    weight = one.log_evidence - two.log_evidence
    found: list[Experiment] = []
    for name, (outcome, std) in _OUTCOMES.items():
        rng = np.random.default_rng(len(found))
        draws = []
        for part in (one, two):
            values = np.asarray(outcome(part.model, part.draws))
            draws.append(values + std * rng.standard_normal(len(values)))
        right = []
        lowest, highest = (float(end) for end in np.quantile(np.concatenate(draws), [0.0005, 0.9995]))
        grid = np.linspace(lowest, highest, 200)
        densities = [np.histogram(part, bins=grid, density=True)[0] + 1e-6 / np.ptp(grid) for part in draws]
        for truth, sign in ((0, 1.0), (1, -1.0)):
            cell = np.clip(np.searchsorted(grid, draws[truth]) - 1, 0, len(grid) - 2)
            odds = sign * (np.log(densities[0][cell] / densities[1][cell]) + weight)
            right.append(np.mean(odds > np.log(19.0)))
        ends = [_interval(part) for part in draws]
        found.append(Experiment(name, ends[0], ends[1], float(np.mean(right))))
    return tuple(sorted(found, key=lambda each: -each.separates))


def _of_loop(model: JointModel, z: Draws) -> np.ndarray:
    """Logarithm of the ratio of the friction coefficients of both joints."""
    p = model.values(z)
    return np.log(p[model._named("friction coefficient", "hammer")] / p[model._named("friction coefficient", "shaker")])


def _of_growth(model: JointModel, z: Draws) -> np.ndarray:
    """Difference of the exponents of k_T."""
    p = model.values(z)
    return np.asarray(p[model._named("exponent of k_T", "hammer")] - p[model._named("exponent of k_T", "shaker")])


def _half(model: JointModel, z: Draws) -> np.ndarray:
    """Damping [%] that impacts of half the force read at 1 kN."""
    return 100 * model.hammer(z, np.array([1000.0]), 0.5)[1][:, 0]


def _force(model: JointModel, z: Draws) -> np.ndarray:
    """Logarithm of the peak force [N]."""
    return np.log(model.values(z)["peak force"])


_OUTCOMES = {
    "hysteresis loops of both joints: ln of the ratio of their friction coefficients": (_of_loop, 0.05),
    "hysteresis loops of both joints: difference of the exponents of k_T": (_of_growth, 0.05),
    "hammer, 1 kN, half the impact: damping [%]": (_half, 0.05),
    "peak force of the impacts: ln of N": (_force, 0.05),
}
"""Measurements that could decide, and the standard deviation of what they read."""
