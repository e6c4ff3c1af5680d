"""One friction law for all that was said of a structure: posterior, what it determines, and what cannot hold together.

Parameters are transforms of standard normal variables, so that the prior is the same for all of them. Draws follow a
path of densities from the prior to the posterior, of one joint and of two, through powers of the likelihood
(sequential Monte Carlo, Del Moral, Doucet and Jasra 2006, Journal of the Royal Statistical Society B 68:411); between
two steps emcee moves them (Foreman-Mackey et al. 2013) by differential evolution (ter Braak 2006, Statistics and
Computing 16:239). Independent runs say how far the result is one of chance.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.special import expit, log_ndtr, ndtr
from scipy.stats import t as student_t

from ema.compare.joint_readings import Beam, hammer, shaker
from ema.compare.joint_statements import RELATIVE, JointFile, SentenceTable
from ema.data.modal import COVERAGE_FACTOR
from ema.progress import Progress, advance, silent

Draws = Float[np.ndarray, "draw parameter"]
_RIDGE_POINTS = 14
"""Normal forces at which the highest damping of a level is looked for, evenly spaced in the logarithm."""
_DRAWS, _RUNS = 400, 4
"""Draws of a run, and independent runs."""
_MOVES, _LAST, _THIN = 30, 60, 20
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
        return np.asarray(middle * np.exp(half * z / COVERAGE_FACTOR))


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
    """Parameters, and the readings that they lead to, of one or of two joints.

    With ``two`` the hammer test and the shaker test have a joint each, of which neither says anything of the other.
    ``said`` are the numbers and sentences where they are not those of the file.
    """

    file: JointFile
    two: bool = False
    said: tuple[Datum, ...] | None = None

    @property
    def tests(self) -> tuple[str, ...]:
        """The tests that say something."""
        return tuple(one for one, said in (("hammer", self.file.hammer), ("shaker", self.file.shaker)) if said)

    @property
    def _joint(self) -> tuple[Parameter, ...]:
        prior = self.file.prior
        return (
            _ranged("friction coefficient", prior.friction_coefficient),
            _ranged("exponent of k_T", prior.exponent, uniform=True),
            Parameter("loss factor", 0.0, 0.1, True),
        )

    @property
    def _own(self) -> tuple[Parameter, ...]:
        prior, found = self.file.prior, []
        for part in self.tests:
            found += [
                Parameter(f"drop by the mass, {part}", 0.0, 0.06, True),
                Parameter(f"added damping, {part}", 0.0, 0.003, True),
                Parameter(f"stiffness ratio at 1 kN, {part}", 0.005, 0.5),
                Parameter(f"stiffness ratio in series, {part}", 0.01, 2.0),
            ]
        if self.file.hammer:
            found += [
                _ranged("shape over slip, hammer", prior.hammer_shape),
                _ranged("peak force", prior.peak_force),
            ]
        if self.file.shaker:
            found.append(_ranged("shape over slip, shaker", prior.shaker_shape))
        return tuple(found)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The joint's (of both tests, or of either), then those of the hammer test and of the shaker test."""
        joint = self._joint
        if self.two:
            joint = tuple(replace(one, name=self._named(one.name, part)) for part in self.tests for one in joint)
        return joint + self._own

    @property
    def data(self) -> tuple[Datum, ...]:
        """Numbers and sentences."""
        return tuple(_data(self.file)) if self.said is None else self.said

    def values(self, z: Draws) -> dict[str, np.ndarray]:
        """Parameters by name."""
        joint, own = self._joint, self._own
        parts = self.tests if self.two else ("",)
        values = {
            self._named(one.name, part): one.of(z[:, number * len(joint) + row])
            for number, part in enumerate(parts)
            for row, one in enumerate(joint)
        }
        first = len(parts) * len(joint)
        return values | {one.name: one.of(z[:, first + row]) for row, one in enumerate(own)}

    def combinations(self, z: Draws) -> dict[str, np.ndarray]:
        """What a test determines better than its parts."""
        p, found = self.values(z), {}
        if self.file.hammer:
            found["peak force over friction coefficient"] = (
                p["peak force"] / p[self._named("friction coefficient", "hammer")]
            )
        if self.file.shaker:
            ratio = p["shape over slip, shaker"] / p[self._named("friction coefficient", "shaker")]
            found["shape over slip over friction coefficient, shaker"] = ratio
        return found

    def _named(self, name: str, part: str) -> str:
        return f"{name}, {part}" if self.two else name

    def _beam(self, p: Mapping[str, np.ndarray], part: str) -> Beam:
        bare = self.file.bare
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
        impulse = p["shape over slip, hammer"] * 4 * self.file.prior.contact_time * self.file.bare.frequency
        impulse = scale * impulse * p["peak force"] / p[self._named("friction coefficient", "hammer")]
        return hammer(self._beam(p, "hammer"), forces, impulse)

    def readings(self, z: Draws) -> Float[np.ndarray, "draw datum"]:
        """What every number and sentence is about, in its own scale (logarithms for forces)."""
        columns: list[np.ndarray] = []
        if self.file.hammer:
            frequency, damping = self.hammer(z, np.array([one.normal_force for one in self.file.hammer]))
            for row, one in enumerate(self.file.hammer):
                columns += [frequency[:, row]] * (one.frequency is not None)
                columns += [damping[:, row]] * (one.damping is not None)
        if self.file.shaker:
            p = self.values(z)
            drive = p["shape over slip, shaker"] / p[self._named("friction coefficient", "shaker")]
            test = _Shaker(np.sort(self.file.levels), np.sort(self.file.normal_forces))
            conditions = [test.conditions(one) for one in self.file.shaker]
            ends = np.cumsum([each.shape[1] for each in conditions])[:-1]
            levels, forces = np.hstack(conditions)
            readings = shaker(self._beam(p, "shaker"), levels, forces, drive)
            curves = (np.split(each, ends, axis=1) for each in readings)
            columns += [test.reading(*one) for one in zip(self.file.shaker, *curves, strict=True)]
        return np.stack(columns, axis=1)

    def log_likelihoods(self, z: Draws) -> Float[np.ndarray, "draw datum"]:
        """Of every number and sentence."""
        readings = self.readings(z)
        return np.stack([datum.log_likelihood(readings[:, row]) for row, datum in enumerate(self.data)], axis=1)


@dataclass(frozen=True)
class _Shaker:
    """The conditions of a shaker test that sentences are about: pairs of force amplitude and normal force in N."""

    levels: np.ndarray
    forces: np.ndarray

    def conditions(self, sentence: SentenceTable) -> Float[np.ndarray, "2 condition"]:
        """What a sentence needs: a sweep over normal forces or levels; last, the one condition that it compares."""
        alone = np.array([[sentence.level], [sentence.normal_force]], float)
        if sentence.quantity == "stuck frequency":
            return np.array([[self.levels[0]], [self.forces[-1]]])
        if sentence.quantity in ("ridge", "drop", "stuck damping"):
            sweep = np.stack([np.full(_RIDGE_POINTS, sentence.level), self.grid])
        else:
            sweep = np.stack([self.levels, np.full(len(self.levels), sentence.normal_force)])
        return np.hstack([sweep, alone]) if sentence.quantity in ("stuck damping", "fall") else sweep

    @property
    def grid(self) -> np.ndarray:
        """Normal forces in N among which a ridge is looked for."""
        return np.geomspace(max(self.forces[0], 1e-3 * self.forces[-1]), self.forces[-1], _RIDGE_POINTS)

    def reading(self, sentence: SentenceTable, frequency: np.ndarray, damping: np.ndarray) -> np.ndarray:
        """The quantity of a sentence, of frequency [Hz] and damping ratio at its conditions (draw, condition)."""
        kind, grid = sentence.quantity, self.grid
        if kind == "stuck frequency":
            return np.asarray(frequency[:, 0])
        if kind == "most damping":
            return np.asarray(damping.max(axis=1))
        if kind == "fall":
            return np.asarray(damping[:, -2] / damping[:, -1])
        if kind == "stuck damping":
            return np.asarray(damping[:, -1] / _vertex(damping[:, :-1])[1])
        vertex = _vertex(damping)[0]
        if kind == "ridge":
            return np.asarray(np.log(grid[0]) + vertex * np.log(grid[1] / grid[0]))
        if kind == "drop":
            row = np.clip(np.rint(vertex).astype(int), 0, len(grid) - 1)
            return np.asarray(frequency[np.arange(len(row)), row] - frequency[:, -1])
        return np.asarray(np.interp(vertex, np.arange(len(self.levels)), np.log(self.levels)))


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


def _data(file: JointFile) -> list[Datum]:
    data = []
    for one in file.hammer:
        where = f"hammer, {one.normal_force:g} N"
        if one.frequency is not None:
            data.append(Datum(one.sentence, f"{where}: frequency [Hz]", one.frequency_std, one.frequency))
        if one.damping is not None:
            data.append(Datum(one.sentence, f"{where}: damping ratio", one.damping_std, one.damping))
    for said in file.shaker:
        scale = np.log if said.quantity in RELATIVE else float
        ends = {
            key: float(scale(number))
            for key, number in (("value", said.value), ("low", said.low), ("high", said.high))
            if number is not None
        }
        parts = [f"{said.level:g} N excitation"] if said.level is not None else []
        parts += [f"F_N {said.normal_force:g} N"] if said.normal_force is not None else []
        data.append(Datum(said.sentence, f"shaker, {', '.join([*parts, said.quantity])}", said.std, **ends))
    return data


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

    The law is a Masing spring whose stiffness grows with the normal force; place, beam, hammer and shaker are nuisance
    parameters with stated priors. Where there is a hammer and a shaker test, one joint is compared with two. On tables
    of this model under the conditions of the paper 95 % intervals hold 91 to 94 % (simulation-based calibration,
    docs/joint.md); its own error is not in them.

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
        Posterior of one joint and of two, how each sentence stands to the others, and what experiments would decide.

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
        return Held(datum, float("nan"), float("nan"), float("nan"))
    if np.isfinite(datum.value):
        below = float(np.sum(weights * ndtr((datum.value - reading) / datum.std)))
        chance = 2 * min(below, 1 - below)
    else:
        chance = float(np.sum(weights * np.exp(datum.log_likelihood(reading))))
    low, high = np.exp(ends) if log else ends
    return Held(datum, float(low), float(high), chance)


def _experiments(one: Posterior, two: Posterior) -> tuple[Experiment, ...]:
    """Outcomes of single measurements under either hypothesis, with the noise that they would have."""
    weight = -_log_ratio(one, two)
    experiments: list[Experiment] = []
    for name, (outcome, std) in _OUTCOMES.items():
        rng = np.random.default_rng(len(experiments))
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
        experiments.append(Experiment(name, ends[0], ends[1], float(np.mean(right))))
    return tuple(sorted(experiments, key=lambda each: -each.separates))


def _of_loop(model: JointModel, z: Draws) -> np.ndarray:
    """Logarithm of the ratio of the friction coefficients of both joints."""
    p = model.values(z)
    return np.asarray(
        np.log(p[model._named("friction coefficient", "hammer")] / p[model._named("friction coefficient", "shaker")])
    )


def _of_growth(model: JointModel, z: Draws) -> np.ndarray:
    """Difference of the exponents of k_T."""
    p = model.values(z)
    return np.asarray(p[model._named("exponent of k_T", "hammer")] - p[model._named("exponent of k_T", "shaker")])


def _half(model: JointModel, z: Draws) -> np.ndarray:
    """Damping [%] that impacts of half the force read at 1 kN."""
    return 100 * model.hammer(z, np.array([1000.0]), 0.5)[1][:, 0]


def _force(model: JointModel, z: Draws) -> np.ndarray:
    """Logarithm of the peak force [N]."""
    return np.asarray(np.log(model.values(z)["peak force"]))


_OUTCOMES = {
    "hysteresis loops of both joints: ln of the ratio of their friction coefficients": (_of_loop, 0.05),
    "hysteresis loops of both joints: difference of the exponents of k_T": (_of_growth, 0.05),
    "hammer, 1 kN, half the impact: damping [%]": (_half, 0.05),
    "peak force of the impacts: ln of N": (_force, 0.05),
}
"""Measurements that could decide, and the standard deviation of what they read."""
