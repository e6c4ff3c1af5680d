"""Parameters of one friction joint, or of two, and the readings that they lead to.

Parameters are transforms of standard normal variables, so that the prior is the same for all of them. The law of the
joint is one of them: an even choice of ``ema.compare.joint_loops.LAWS``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy.special import log_ndtr, ndtr

from ema.compare.hammer_table import HammerTable
from ema.compare.joint_loops import LAWS
from ema.compare.joint_readings import Beam, shaker
from ema.compare.joint_statements import RELATIVE, BareTable, JointFile, SentenceTable
from ema.data.modal import COVERAGE_FACTOR

Draws = Float[np.ndarray, "draw parameter"]
_RIDGE_POINTS = 14
"""Normal forces at which the highest damping of a level is looked for, evenly spaced in the logarithm."""
_ADDED_DAMPING = 0.003
"""Highest damping ratio that a beam adds to a mode beside the friction of its joints."""


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
            return _log_density(reading, self.value, self.std)
        return _log_probability(reading, (self.low, self.high), self.std)

    def excess(self, reading: np.ndarray) -> np.ndarray:
        """How far the reading lies from what was said, in standard deviations; 0 within the interval of a sentence."""
        low, high = (self.value, self.value) if np.isfinite(self.value) else (self.low, self.high)
        return np.asarray((reading - np.clip(reading, low, high)) / self.std)


Scalar = float | np.ndarray


def _log_density(reading: np.ndarray, value: Scalar, std: Scalar) -> np.ndarray:
    """Logarithm of the normal density of values."""
    return np.asarray(-0.5 * ((value - reading) / std) ** 2 - np.log(std * np.sqrt(2 * np.pi)))


def _log_probability(reading: np.ndarray, ends: tuple[Scalar, Scalar], std: Scalar) -> np.ndarray:
    """Logarithm of the probability of intervals: Phi(b) - Phi(a), in the tail that is smaller."""
    lower, upper = ((end - reading) / std for end in ends)
    turn = lower > 0
    a, b = np.where(turn, -upper, lower), np.where(turn, -lower, upper)
    return np.asarray(log_ndtr(b) + np.log1p(-np.exp(np.minimum(log_ndtr(a) - log_ndtr(b), -1e-15))))


@dataclass(frozen=True)
class JointModel:
    """Parameters, and the readings that they lead to, of one or of two joints.

    With ``two`` the hammer test and the shaker test have a joint each, of which neither says anything of the other
    but that both follow the same law. ``law`` is one of ``LAWS``; without it all are possible, with the same prior
    weight. ``said`` are the numbers and sentences where they are not those of the file.
    """

    file: JointFile
    two: bool = False
    said: tuple[Datum, ...] | None = None
    law: str | None = None

    @property
    def tests(self) -> tuple[str, ...]:
        """The tests that say something."""
        return tuple(one for one, said in (("hammer", self.file.hammer), ("shaker", self.file.shaker)) if said)

    @property
    def _shakers(self) -> "dict[str, _Shaker]":
        """What was swept for every mode that a sentence of the shaker test is about, by the name of its parameters."""
        return {
            f"shaker, mode {one}" if one else "shaker": _Shaker.of(self.file, one) for one in self.file.modes_of_shaker
        }

    @cached_property
    def _joint(self) -> tuple[Parameter, ...]:
        prior = self.file.prior
        return (
            _ranged("friction coefficient", prior.friction_coefficient),
            _ranged("exponent of k_T", prior.exponent, uniform=True),
            Parameter("loss factor", 0.0, 0.1, True),
        )

    @cached_property
    def _own(self) -> tuple[Parameter, ...]:
        prior, found = self.file.prior, []
        for part in (*(("hammer",) if self.file.hammer else ()), *self._shakers):
            found += [
                Parameter(f"drop by the mass, {part}", 0.0, 0.06, True),
                Parameter(f"added damping, {part}", 0.0, _ADDED_DAMPING, True),
                Parameter(f"stiffness ratio at 1 kN, {part}", 0.005, 0.5),
                Parameter(f"stiffness ratio in series, {part}", 0.01, 2.0),
            ]
        if self.file.hammer:
            found += [
                _ranged("shape over slip, hammer", prior.hammer_shape),
                _ranged("peak force", prior.peak_force),
            ]
        found += [_ranged(f"shape over slip, {part}", prior.shaker_shape) for part in self._shakers]
        if self.lifts_off:
            assert prior.lift_off is not None
            found += [_ranged(_OPENS, prior.lift_off), Parameter(_CARRIED, 0.0, 1.0, True)]
        return tuple(found)

    @property
    def lifts_off(self) -> bool:
        """Whether the contact of the shaker test may open."""
        return bool(self.file.shaker) and self.file.prior.lift_off is not None

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The joint's (of both tests, or of either), then those of the hammer test, of the shaker test, and the law."""
        joint = self._joint
        if self.two:
            joint = tuple(replace(one, name=self.named(one.name, part)) for part in self.tests for one in joint)
        return joint + self._own + (() if self.law else (Parameter("law", 0.0, float(len(LAWS)), True),))

    @cached_property
    def data(self) -> tuple[Datum, ...]:
        """Numbers and sentences."""
        return tuple(_data(self.file)) if self.said is None else self.said

    def laws(self, z: Draws) -> Int[np.ndarray, "draw"]:
        """Rows of ``LAWS``."""
        if self.law:
            return np.full(len(z), LAWS.index(self.law))
        return np.minimum(self.parameters[-1].of(z[:, -1]).astype(np.int64), len(LAWS) - 1)

    def values(self, z: Draws) -> dict[str, np.ndarray]:
        """Parameters by name; the law is none of them."""
        joint, own = self._joint, self._own
        parts = self.tests if self.two else ("",)
        values = {
            self.named(one.name, part): one.of(z[:, number * len(joint) + row])
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
                p["peak force"] / p[self.named("friction coefficient", "hammer")]
            )
        for part in self._shakers:
            ratio = p[f"shape over slip, {part}"] / p[self.named("friction coefficient", "shaker")]
            found[f"shape over slip over friction coefficient, {part}"] = ratio
        return found

    def named(self, name: str, test: str) -> str:
        """Name of a parameter of the joint of a test."""
        return f"{name}, {test}" if self.two else name

    def beam(self, z: Draws, part: str) -> Beam:
        """The friction beam on the mode of the hammer test, or on one of the shaker test (``shaker, mode 3``)."""
        return self._beam(self._resolved(z), part)

    def _resolved(self, z: Draws) -> dict[str, np.ndarray]:
        """Parameters by name, and the law."""
        return self.values(z) | {"law": self.laws(z)}

    def _beam(self, p: Mapping[str, np.ndarray], part: str) -> Beam:
        test = part.split(",")[0]
        bare: BareTable = self._shakers[part].bare if test == "shaker" else self.file.bare
        lifts = self.lifts_off and test == "shaker"
        return Beam(
            bare.frequency,
            drop=p[f"drop by the mass, {part}"],
            damping=bare.damping + p[f"added damping, {part}"],
            stiffness=p[f"stiffness ratio at 1 kN, {part}"],
            rest=p[f"stiffness ratio in series, {part}"],
            exponent=p[self.named("exponent of k_T", test)],
            loss=p[self.named("loss factor", test)],
            law=p["law"],
            opens=p[_OPENS] if lifts else None,
            carried=p[_CARRIED] if lifts else None,
        )

    def hammer(self, z: Draws, forces: np.ndarray, scale: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """Frequency [Hz] and damping ratio that hammer tests read, the impacts ``scale`` times as hard."""
        return self._hammer(self._resolved(z), forces, scale)

    def _hammer(self, p: Mapping[str, np.ndarray], forces: np.ndarray, scale: float) -> tuple[np.ndarray, np.ndarray]:
        bare = self.file.bare
        # q = phi J / w with J = 2 T F / pi, over the slip mu F_N / (k psi): phi/psi (2 T w / pi) ratio F / (mu F_N)
        impulse = p["shape over slip, hammer"] * 4 * self.file.prior.contact_time * bare.frequency
        impulse = scale * impulse * p["peak force"] / p[self.named("friction coefficient", "hammer")]
        table = HammerTable.of(bare.damping, bare.damping + _ADDED_DAMPING)
        return table.hammer(self._beam(p, "hammer"), forces, impulse)

    def shaker(
        self, z: Draws, part: str, conditions: Float[np.ndarray, "2 condition"]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Frequency [Hz] and damping ratio of steady states under pairs of force amplitude and normal force in N."""
        return self._shaker(self._resolved(z), part, conditions)

    def _shaker(self, p: Mapping[str, np.ndarray], part: str, conditions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        drive = p[f"shape over slip, {part}"] / p[self.named("friction coefficient", "shaker")]
        force, normal = conditions
        return shaker(self._beam(p, part), force, normal, drive)

    def readings(self, z: Draws) -> Float[np.ndarray, "draw datum"]:
        """What every number and sentence is about, in its own scale (logarithms for forces)."""
        p, columns = self._resolved(z), []
        if self.file.hammer:
            frequency, damping = self._hammer(p, np.array([one.normal_force for one in self.file.hammer]), 1.0)
            for row, one in enumerate(self.file.hammer):
                columns += [frequency[:, row]] * (one.frequency is not None)
                columns += [damping[:, row]] * (one.damping is not None)
        of_modes = {}
        for mode, sweep in self._sweeps.items():
            curves = self._shaker(p, sweep.part, sweep.conditions)
            pieces = [tuple(each[:, rows] for each in curves) for rows in sweep.rows]
            said = self.file.sentences(mode)
            of_modes[mode] = iter(
                [sweep.shaker.reading(*one) for one in zip(said, *zip(*pieces, strict=True), strict=True)]
            )
        columns += [next(of_modes[one.mode]) for one in self.file.shaker]
        return np.stack(columns, axis=1)

    @cached_property
    def _sweeps(self) -> "dict[str | None, _Sweep]":
        """What is computed for every mode of the shaker test."""
        parts = zip(self.file.modes_of_shaker, self._shakers.items(), strict=True)
        return {mode: _Sweep.of(part, sweep, self.file.sentences(mode)) for mode, (part, sweep) in parts}

    def log_likelihoods(self, z: Draws) -> Float[np.ndarray, "draw datum"]:
        """Of every number and sentence."""
        readings, found = self.readings(z), np.empty((len(z), len(self.data)))
        value, low, high, std = self._arrays
        is_number = np.isfinite(value)
        found[:, is_number] = _log_density(readings[:, is_number], value[is_number], std[is_number])
        ends = (low[~is_number], high[~is_number])
        found[:, ~is_number] = _log_probability(readings[:, ~is_number], ends, std[~is_number])
        return found

    @cached_property
    def _arrays(self) -> Float[np.ndarray, "4 datum"]:
        """Value, low, high and standard deviation of all data."""
        return np.array([(one.value, one.low, one.high, one.std) for one in self.data]).T


_OPENS = "lift-off force over excitation, shaker"
_CARRIED = "share of the mass carried at F_N = 0, shaker"


@dataclass(frozen=True)
class _Shaker:
    """The conditions of a shaker test that sentences are about: pairs of force amplitude and normal force in N."""

    bare: BareTable
    levels: np.ndarray
    forces: np.ndarray

    @classmethod
    def of(cls, file: JointFile, mode: str | None) -> "_Shaker":
        """What was swept for a mode."""
        return cls(file.bare_mode(mode), *(np.sort(each) for each in file.swept(mode)))

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

    @cached_property
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
        parts = [f"mode {said.mode}"] if said.mode is not None else []
        parts += [f"{said.level:g} N excitation"] if said.level is not None else []
        parts += [f"F_N {said.normal_force:g} N"] if said.normal_force is not None else []
        data.append(Datum(said.sentence, f"shaker, {', '.join([*parts, said.quantity])}", said.std, **ends))
    return data


@dataclass(frozen=True)
class _Sweep:
    """All conditions (2, condition) of the sentences on a mode, each once, and ``rows`` of them for every sentence.

    ``part`` is the name of the parameters of the mode.
    """

    part: str
    shaker: _Shaker
    conditions: np.ndarray
    rows: tuple[np.ndarray, ...]

    @classmethod
    def of(cls, part: str, swept: _Shaker, sentences: Sequence[SentenceTable]) -> "_Sweep":
        """The conditions of these sentences."""
        each = [swept.conditions(one) for one in sentences]
        conditions, rows = np.unique(np.hstack(each), axis=1, return_inverse=True)
        ends = np.cumsum([one.shape[1] for one in each])[:-1]
        return cls(part, swept, conditions, tuple(np.split(rows.ravel(), ends)))
