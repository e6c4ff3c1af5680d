"""Joint parameters from a measured map: nonlinear least squares on damping and frequency, with intervals."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from jaxtyping import Bool, Float, Int

from ema.compare.free_parameters import (
    FORCE_SCALE,
    SHARED,
    FreeParameter,
    free_parameters,
    initial_values,
    search_centres,
    with_law,
    with_parameters,
)
from ema.compare.parameter_intervals import (
    FRICTION_GROWTH,
    LOST,
    PROFILE_DISTANCES,
    LinearData,
    ParameterPosterior,
    ProfileLikelihood,
    Residuals,
    hidden_springs,
    levels_agree,
    other_laws,
    posterior,
    robust_std,
)
from ema.compare.replay import MeasuredPoints, measure, measured_points, search_band
from ema.data import BeamModel, Finding, ModalMap
from ema.data.comparison import ModelUpdate
from ema.data.modal import COVERAGE_FACTOR
from ema.dof import Dof
from ema.errors import InputError
from ema.progress import Progress, advance, silent

_UNSTATED = 0.03
"""Relative standard uncertainty of a damping ratio whose own is not stated."""
_LEAST_DAMPING, _LEAST_FREQUENCY = 0.005, 1e-4
"""Least relative standard uncertainty that is believed."""
_PEAK = 0.05
"""Standard uncertainty of the frequency of a simulated maximum, in half bandwidths: peaks are flat."""
_PRIOR = 3.0
"""Standard deviation of the logarithms beforehand: a factor of 20 is no surprise."""
_VAGUE = 1 / (3 * 3**0.5)
"""Standard deviation of a parameter, over the half width of its search, from which it counts as not determined: a third
of that of a uniform distribution over the search."""
_MISFIT = 2.0
"""Rms of what remains, in standard uncertainties, from which the data contradict the model: 24 residuals of a right one
reach 1.6 once in 10 000."""
_EXCESS = 3.3
"""Scale of what is in no law of the kind, over that of joints in general, that is named: one standard deviation of its
logarithm above the median."""
_PAIRED = 0.98
"""Correlation of two parameters from which only their ratio or product is said to be determined: the uncertainty of
that is at most a fifth of theirs. Twice as far from 1, it is at most two sevenths."""
_REFINED = 6
"""Steps at most from the optimum without a discrepancy to the one with it."""
_CLOSE = 0.3
"""Distance of the mean, in standard deviations, from where the derivatives were taken, up to which they are not taken
again."""
_NOT_SEARCHED = ("background_damping", FORCE_SCALE)
"""What is followed from the model's value: both move the whole map."""
_STARTS = (1, 16, 64, 128)
"""Starts compared at first, by the number of parameters that are searched."""
_ROUGH = 2e-2
"""Tolerance of the simulated map in that search."""
_CONTESTANTS, _ROUND = 4, 6
"""Starts that are followed, and for how many iterations, before one is chosen."""
_THIN = 8
"""Points of the map with which starts are compared."""
_PASSES, _ITERATIONS, _STEP = 3, 15, 0.03
"""Passes of a map that was fitted from FRFs, each with what the fit reads wrong at the parameters of the one before;
iterations of a pass: both bounds on the work; and the step of derivatives, on the scales of the parameters."""
TOLERANCE = 5e-3
"""Relative error of the simulation that is aimed at."""
_SAME = 0.01
"""Change of the parameters, on their scales, below which the fit of FRFs reads the same of the model."""
_SOFT = (1.0, 0.3, 0.0)
"""Share of the widened uncertainties with which the search begins, goes on and ends: see `_SOFT_DAMPING`."""
_SOFT_DAMPING, _SOFT_FREQUENCY = 0.15, 2e-3
"""The search begins with uncertainties widened by this much and narrows them in steps: precise frequencies make a long
bent valley, which is only followed from nearby."""
_CUT_OFF = 50.0
"""Residual, in standard uncertainties, of a point whose resonance the band cuts off, in the search: more than a law of
another form misses a damping ratio by, 65 % of one that is known to 1 %. With five, a place with all points cut off was
cheaper than the best fit of a law that is wrong by some per cent. Twice or half of it moves no optimum in the band."""
_EVIDENT = 3.0
"""Exponent of mu over F_N, over its standard deviation, that is named: chance gives it once in 370 maps."""
_STEEPEST = 0.5
"""Exponent of mu over F_N up to which it is followed: five standard deviations of its prior."""
_JUMP = 20.0
"""Difference of the derivatives to either side, in standard uncertainties per unit, from which it may be a jump."""


def update(
    model: BeamModel,
    chart: ModalMap,
    free: Sequence[str],
    at: Dof | str,
    output: Dof | str,
    band: tuple[float, float] | None = None,
    known_level: bool = True,
    tolerance: float = TOLERANCE,
    progress: Progress = silent,
) -> ModelUpdate:
    """Identify joint parameters from a measured map of one mode.

    Damping ratios and frequencies of all points are fitted at once, weighted by their uncertainties; a common ratio of
    the frequencies is left free, since it is an error of the host and not of the joints. The law is the same in all
    joints. No initial values are needed: starts over two decades of mu are compared first. A map that was fitted from
    FRFs (``measured``) is compared with the model fitted in the same way. Intervals hold although the law is only
    nearly right (``parameter_intervals``).

    Parameters
    ----------
    model : BeamModel
        Model with joints of one law.
    chart : ModalMap
        Measured map.
    free : sequence of str
        Names of the parameters to identify: ``friction_coefficient``, ``contact_stiffness``, ``stiffness_exponent``,
        ``background_damping``, or a number of the joints' law (``exponent``, ``chi``, ...).
    at, output : Dof or str
        DOF of the model that is excited, and whose response is measured; as in :func:`measure`.
    band : tuple of (float, float), optional
        Band [Hz] in which the resonance is searched; as in :func:`measure`.
    known_level : bool, default True
        False where the force levels are known only relative to each other (hammer without a force scale, the steps of
        an amplifier): a factor on them is identified too, and only mu over that factor can be determined.
    tolerance : float, default 0.005
        Relative error of the simulation that is aimed at.
    progress : Progress, optional
        Called during the search.

    Returns
    -------
    ModelUpdate
        Updated model, the parameters with their 95 % intervals, and which of them the map determines.

    Raises
    ------
    InputError
        If a parameter is unknown or the law does not have it, there are too few points, or the joints do not fit.

    References
    ----------
    .. [1] Discrepancy of a model: Kennedy and O'Hagan (2001); Brynjarsdottir and O'Hagan (2014).
    .. [2] Identifiable by profile likelihood: Raue et al. (2009).

    Examples
    --------
    >>> from ema.examples import beam_model, modal_map
    >>> from ema.errors import InputError
    >>> try:
    ...     update(beam_model(), modal_map(), ["colour"], at="1:+X", output="1:+X")
    ... except InputError as error:
    ...     "colour" in str(error)
    True
    """
    parameters = free_parameters(model, free)
    if not known_level:
        parameters = (*parameters, FreeParameter(FORCE_SCALE))
    names = tuple(one.name for one in parameters)
    points = measured_points(model, chart)
    if 2 * len(points.level) <= len(names) + 1:
        raise InputError(
            "too few points",
            where=chart.name or "map",
            got=f"{len(points.level)} points",
            expected=f"more than {(len(names) + 1) // 2} for {len(names)} parameters",
        )
    limits, middle = band or search_band(chart), middle_force(points)
    problem = MapProblem(centred(model, points), chart, points, parameters, at, output, limits, tolerance, middle)
    values = problem.start(progress)
    bias, moved = np.zeros(len(points.level)), np.zeros(len(values))
    for number in range(_PASSES):
        advance(progress, "updating the model", number, _PASSES)
        before = values
        values = problem.optimum(values, bias)
        if chart.method == "frozen":
            break
        moved = np.abs(values - before)
        if np.max(moved) < _SAME:
            break
        bias = problem.bias(values)
    return _result(problem, values, bias, moved, [joint.law.reference_force for joint in model.joints])


def middle_force(points: MeasuredPoints) -> float:
    """ln F_N half way between the lowest and the highest normal force."""
    forces = np.log(points.forces.mean(axis=1))
    return 0.5 * float(forces.min() + forces.max())


def centred(model: BeamModel, points: MeasuredPoints) -> BeamModel:
    """The same model with k_T stated at the middle of the map's normal forces, where the map tells it best."""
    middle = float(np.exp(np.mean(np.log(np.maximum(points.forces, 1e-9)))))
    return _stated_at(model, [middle] * len(model.joints))


def _stated_at(model: BeamModel, forces: Sequence[float]) -> BeamModel:
    joints = []
    for joint, force in zip(model.joints, forces, strict=True):
        growth = (force / joint.law.reference_force) ** joint.law.stiffness_exponent
        law = replace(joint.law, contact_stiffness=joint.law.contact_stiffness * growth, reference_force=float(force))
        joints.append(replace(joint, law=law))
    return replace(model, joints=tuple(joints))


@dataclass(frozen=True)
class MapProblem:
    """A model, a measured map and the parameters that are free: what is simulated, and how far off it is.

    mu is as F_N^``growth``, and as the parameters say where ln F_N is ``middle``.
    """

    model: BeamModel
    chart: ModalMap
    points: MeasuredPoints
    parameters: tuple[FreeParameter, ...]
    at: Dof | str
    output: Dof | str
    band: tuple[float, float]
    tolerance: float
    middle: float
    growth: float = 0.0

    @cached_property
    def measured(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Logarithms of damping and frequency of the points, and their standard uncertainties."""
        index = (self.points.row, self.points.column)
        damping, frequency = self.chart.damping[index], self.chart.frequency[index]
        if np.any(damping <= 0):
            raise InputError(
                "a damping ratio that is not positive",
                where=self.chart.name or "map",
                got=float(damping.min()),
                expected="above 0",
                advice="make it a hole (NaN)",
            )
        of_damping = np.full(len(damping), _UNSTATED)
        of_frequency = 0.1 * of_damping * damping
        if self.chart.damping_std is not None:
            stated = self.chart.damping_std[index] / damping
            of_damping = np.where(np.isfinite(stated), stated, _UNSTATED)
        if self.chart.frequency_std is not None:
            stated = self.chart.frequency_std[index] / frequency
            of_frequency = np.where(np.isfinite(stated), stated, of_frequency)
        return (
            np.log(damping),
            np.log(frequency),
            np.hypot(of_damping, _LEAST_DAMPING),
            np.sqrt(of_frequency**2 + _LEAST_FREQUENCY**2 + (_PEAK * damping) ** 2),
        )

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of the parameters."""
        return tuple(one.name for one in self.parameters)

    @cached_property
    def initial(self) -> np.ndarray:
        """Parameters of the model, on their scales."""
        return initial_values(self.model, self.parameters)

    def with_values(self, values: np.ndarray) -> tuple[BeamModel, float]:
        """The model with other parameters, and the factor on the force levels."""
        plain = {one.name: one.plain(value) for one, value in zip(self.parameters, values, strict=True)}
        scale = plain.pop(FORCE_SCALE, 1.0)
        return with_parameters(self.model, plain), scale

    def simulated(self, values: np.ndarray, chosen: np.ndarray) -> Float[np.ndarray, "2 point"]:
        """Logarithms of the equivalent damping and frequency of some points; NaN without a resonance."""
        model, scale = self.with_values(values)
        levels, columns = scale * self.points.level[chosen], self.points.column[chosen]
        result = np.full((2, len(chosen)), np.nan)
        for column in np.unique(columns):
            some = np.flatnonzero(columns == column)
            forces = self.points.forces[chosen[some]]
            # Joints near one nominal force stand for it: response, level and normal force scale together.
            level = levels[some] * forces.mean() / forces.mean(axis=1)
            factor = float(np.exp(self.growth * (np.log(forces.mean()) - self.middle)))
            friction = factor * model.joints[0].law.friction_coefficient
            pressed = with_parameters(model, {"friction_coefficient": friction}) if self.growth else model
            result[:, some] = self._resonances(pressed.with_normal_force(forces.mean(axis=0).tolist()), level)
        return result

    def _resonances(self, model: BeamModel, levels: np.ndarray) -> Float[np.ndarray, "2 point"]:
        from ema.simulate.maps import resonances

        try:
            peaks = resonances(model, levels, self.at, self.output, self.band, self.tolerance)
            return np.log([[peak.damping for peak in peaks], [peak.frequency for peak in peaks]])
        except InputError:
            if len(levels) == 1:
                return np.full((2, 1), np.nan)
            return np.hstack([self._resonances(model, levels[n : n + 1]) for n in range(len(levels))])

    @cached_property
    def std(self) -> Float[np.ndarray, "datum"]:
        """Standard uncertainties of ln zeta, then of ln f."""
        return np.concatenate(self.measured[2:])

    @cached_property
    def groups(self) -> Int[np.ndarray, "point"]:
        """Level of each point, or its normal force where the map has one level."""
        return self.points.row if len(np.unique(self.points.row)) > 1 else self.points.column

    def differences(
        self, values: np.ndarray, bias: np.ndarray, chosen: np.ndarray | None = None, soft: float = 0.0
    ) -> tuple[Float[np.ndarray, "2 point"], Float[np.ndarray, "2 point"], Bool[np.ndarray, "point"]]:
        """Measured less simulated ln zeta, and ln f without a common error, their standard uncertainties, and where the
        model has a resonance within the band.

        Elsewhere stands what is read at the end of the band, or NaN; it has no part in the common error, unless there
        is nothing else.
        """
        from ema.simulate.maps import within_band

        some = np.arange(len(self.points.level)) if chosen is None else chosen
        damping, frequency, of_damping, of_frequency = (part[some] for part in self.measured)
        std = np.stack([np.hypot(of_damping, soft * _SOFT_DAMPING), np.hypot(of_frequency, soft * _SOFT_FREQUENCY)])
        simulated = self.simulated(values, some)
        resonant = np.isfinite(bias[some]) & within_band(np.exp(simulated[1]), self.band)
        shift = frequency - simulated[1]
        counted = resonant if resonant.any() else np.isfinite(shift)
        weights = counted / std[1] ** 2
        common = np.sum(weights * np.where(counted, shift, 0)) / max(weights.sum(), 1e-300)
        return np.stack([damping - simulated[0] - bias[some], shift - common]), std, resonant

    def profile(self, values: np.ndarray, bias: np.ndarray, step: np.ndarray) -> Float[np.ndarray, "datum"]:
        """Differences of ln zeta, then of ln f, a step from the values; the least ones where the band cuts off."""
        return self.differences(values + step, bias)[0].ravel()

    def law_differences(self, values: np.ndarray) -> Float[np.ndarray, "datum law"]:
        """What other laws of the same mu and k_T add to ln zeta and ln f; ``LOST`` where they have no resonance."""
        every = np.arange(len(self.points.level))
        model, scale = self.with_values(values)
        fitted = self.simulated(values, every).ravel()
        scaled = replace(self.points, level=scale * self.points.level)
        added = []
        for law in other_laws(model.joints[0].law):
            other = replace(self, model=with_law(model, law), parameters=(), tolerance=_ROUGH, points=scaled)
            added.append(other.simulated(np.empty(0), every).ravel() - fitted)
        differences = np.array(added).T
        return np.where(np.isfinite(differences), differences, LOST * self.std[:, None])

    def law_profiles(
        self, values: np.ndarray, bias: np.ndarray, whole: ProfileLikelihood
    ) -> list[tuple[np.ndarray, np.ndarray, float]]:
        """What the law beside a soft spring makes of the map: offset of the parameters, covariance, rise of chi-square.

        Numbers of the fitted law, which springs do not have, stay at 0 without variance.
        """
        named = [n for n, one in enumerate(self.parameters) if one.name in SHARED]
        model, _ = self.with_values(values)
        law, least = model.joints[0].law, whole.chi_square(whole.posterior.mean)[0]
        data = replace(
            whole.data, sensitivity=whole.data.sensitivity[:, named], prior_mean=whole.data.prior_mean[named]
        )
        out = []
        for other, more in hidden_springs(law):
            problem = replace(self, model=with_law(model, other), parameters=tuple(self.parameters[n] for n in named))
            start = np.array([more if self.names[n] == "friction_coefficient" else 0.0 for n in named])
            found = replace(whole, residuals=partial(problem.profile, values[named], bias), data=data).descended(
                start, least
            )
            if found is None:
                continue
            offset, covariance = np.zeros(len(values)), np.zeros((len(values), len(values)))
            offset[named], covariance[np.ix_(named, named)] = found[:2]
            out.append((offset, covariance, found[2] - least))
        return out

    def friction_growth(self, values: np.ndarray) -> Float[np.ndarray, "datum"]:
        """What ``FRICTION_GROWTH`` more in the exponent of mu adds to ln zeta and ln f; 0 where a resonance is lost."""
        every = np.arange(len(self.points.level))
        ends = [replace(self, growth=self.growth + sign * FRICTION_GROWTH) for sign in (1, -1)]
        above, below = (end.simulated(values, every).ravel() for end in ends)
        return np.asarray(np.nan_to_num(0.5 * (above - below)))

    def linear(self, values: np.ndarray, bias: np.ndarray, differences: np.ndarray, resonant: np.ndarray) -> LinearData:
        """The data about given values where there is a resonance, with central differences for derivatives."""
        known = np.tile(resonant, 2)
        sensitivity = self.sensitivity(differences, partial(self.profile, values, bias))
        log_load, log_normal_force = (each[resonant] for each in self.loads())
        return LinearData(
            residuals=differences[known],
            sensitivity=sensitivity[known],
            std=robust_std(differences[known], self.std[known]),
            log_load=log_load,
            log_normal_force=log_normal_force,
            damping=np.exp(self.measured[0])[resonant],
            law_differences=self.law_differences(values)[known],
            friction_growth=self.friction_growth(values)[known],
            prior_mean=self.initial - values,
            prior_std=_PRIOR,
            growth_offset=self.growth / FRICTION_GROWTH,
            origin=(float(log_load.min()), self.middle),
        )

    def sensitivity(self, here: Float[np.ndarray, "datum"], profile: Residuals) -> Float[np.ndarray, "datum parameter"]:
        """Derivatives of what is simulated, from the differences ``here`` and those a step away."""
        steps, per_std = _STEP * np.eye(len(self.parameters)), _STEP * self.std[:, None]
        above = np.stack([here - profile(h) for h in steps], axis=1)
        below = np.stack([profile(-h) - here for h in steps], axis=1)
        above, below = (np.nan_to_num(each / per_std) for each in (above, below))
        return np.asarray(sound_slopes(above, below) * self.std[:, None])

    def loads(self) -> tuple[Float[np.ndarray, "point"], Float[np.ndarray, "point"]]:
        """ln(amplitude / F_N) and ln F_N of the points: how far the joint slips, amplitude at quadrature."""
        # F_E = 2 zeta w^2 q
        log_normal_force = np.log(self.points.forces.mean(axis=1))
        return np.log(self.points.level) - self.measured[0] - 2 * self.measured[1] - log_normal_force, log_normal_force

    def residuals(
        self, values: np.ndarray, bias: np.ndarray, soft: float = 0.0, chosen: np.ndarray | None = None
    ) -> Float[np.ndarray, "residual"]:
        """Of damping, frequency and the prior, in standard uncertainties, which are widened where ``soft``.

        Without a resonance in the band they are at least ``_CUT_OFF``: damping read at its end is none of the mode, and
        it must not pay to leave the band with all points.
        """
        differences, std, resonant = self.differences(values, bias, chosen, soft)
        off = np.nan_to_num(differences / std, nan=LOST)
        cut_off = ~resonant & np.isfinite(differences).all(axis=0)
        off = np.where(cut_off, np.copysign(np.maximum(np.abs(off), _CUT_OFF), off), off)
        return np.concatenate([off.ravel(), (values - self.initial) / _PRIOR])

    def start(self, progress: Progress) -> np.ndarray:
        """The best of many starts on a few points of the map: the valleys are narrow where a beam resonates."""
        from scipy.stats import qmc

        initial, none = self.initial, np.zeros(len(self.points.level))
        order = np.argsort(np.log(self.points.forces.mean(axis=1) / self.points.level))
        chosen = np.unique(order[np.linspace(0, len(order) - 1, min(_THIN, len(order))).astype(int)])
        searched = [n for n, one in enumerate(self.parameters) if one.name not in _NOT_SEARCHED]
        if not searched:
            return initial
        count = _STARTS[min(len(searched), len(_STARTS) - 1)]
        spread = 2 * qmc.Sobol(len(searched), seed=1).random(count) - 1
        trials = np.tile(initial, (len(spread) + 1, 1))
        widths = np.array([self.parameters[n].width for n in searched])
        trials[1:, searched] = search_centres(self.parameters, initial)[searched] + widths * spread
        rough = replace(self, tolerance=_ROUGH)
        costs = []
        for number, trial in enumerate(trials):
            advance(progress, "comparing starts", number, len(trials))
            off = rough.residuals(trial, none, _SOFT[0], chosen)
            # far from the optimum a few points are far off: they must not decide alone
            costs.append(float(np.sum(np.log1p((off / LOST) ** 2))))
        ended = [rough._descend(trials[n], none, _SOFT[0], _ROUND, chosen) for n in np.argsort(costs)[:_CONTESTANTS]]
        return min(ended, key=lambda pair: pair[1])[0]

    def optimum(self, values: np.ndarray, bias: np.ndarray) -> np.ndarray:
        """From values near the optimum to the optimum."""
        for soft in _SOFT[1:] if not bias.any() else _SOFT[-1:]:
            values = self._descend(values, bias, soft, _ITERATIONS)[0]
        return values

    def _descend(
        self, values: np.ndarray, bias: np.ndarray, soft: float, iterations: int, chosen: np.ndarray | None = None
    ) -> tuple[np.ndarray, float]:
        from scipy.optimize import least_squares

        solution = least_squares(
            self.residuals,
            values,
            self.slopes,
            args=(bias, soft, chosen),
            xtol=2e-5,
            ftol=1e-3,
            gtol=1e-8,
            max_nfev=iterations,
            loss="soft_l1",
            f_scale=3.0,
        )
        return np.asarray(solution.x), float(solution.cost)

    def slopes(
        self, values: np.ndarray, bias: np.ndarray, soft: float = 0.0, chosen: np.ndarray | None = None
    ) -> Float[np.ndarray, "residual parameter"]:
        """Derivatives of the residuals, over steps above the tolerance of the simulated map."""
        here = self.residuals(values, bias, soft, chosen)
        steps = _STEP * np.eye(len(values))
        return np.stack([self.residuals(values + h, bias, soft, chosen) - here for h in steps], axis=1) / _STEP

    def bias(self, values: np.ndarray) -> np.ndarray:
        """What the fit of FRFs reads of the model's damping over its equivalent damping, logarithm; NaN for nothing."""
        model, scale = self.with_values(values)
        levels = None if self.chart.force_at_resonance is None else scale * self.chart.force_at_resonance
        scaled = replace(self.chart, force_levels=scale * self.chart.force_levels, force_at_resonance=levels)
        fitted = measure(model, scaled, self.at, self.output, self.band, self.tolerance)
        equivalent = self.simulated(values, np.arange(len(self.points.level)))[0]
        return np.asarray(np.log(fitted.damping[self.points.row, self.points.column]) - equivalent)


@dataclass(frozen=True)
class _Optimum:
    """Where the search ended: parameters, the data about them, and the posterior relative to them.

    ``problem`` has the exponent of mu about which the data are; ``differences`` (datum) of measured and simulated
    values; ``counted`` (point) what is in the data, ``resonant`` (point) where the model has a resonance at the
    parameters too; ``settled`` whether another step would change little.
    """

    problem: MapProblem
    values: Float[np.ndarray, "parameter"]
    differences: Float[np.ndarray, "datum"]
    counted: Bool[np.ndarray, "point"]
    resonant: Bool[np.ndarray, "point"]
    data: LinearData
    posterior: ParameterPosterior
    settled: bool


def _result(
    problem: MapProblem, values: np.ndarray, bias: np.ndarray, change: np.ndarray, reference: Sequence[float]
) -> ModelUpdate:
    optimum = _with_discrepancy(problem, values, bias, change)
    problem = optimum.problem
    misfit, quantile = _misfits(optimum, bias)
    combinations, estimates = _restated(problem, optimum.values, reference[0])
    covariance = combinations @ optimum.posterior.covariance @ combinations.T
    covariance *= max(1.0, optimum.posterior.misfit**2)
    std = np.sqrt(np.diag(covariance))
    profile = ProfileLikelihood(
        partial(problem.profile, optimum.values, bias), np.tile(optimum.counted, 2), optimum.data, optimum.posterior
    )
    bounds = np.array([profile.bounds(each) for each in combinations])
    others = [] if _common_doubt(optimum) else problem.law_profiles(optimum.values, bias, profile)
    spans = np.array([_span(each, others, quantile**2) for each in combinations])
    reasons = _undetermined(problem, optimum, bounds, std, spans)
    distances = np.where(np.isfinite(bounds), bounds, np.sign(bounds) * PROFILE_DISTANCES[-1])
    # what is not determined is at least not known within the range that was searched: spreads are those of one optimum
    widths = np.array([each.width if reason else 0.0 for each, reason in zip(problem.parameters, reasons, strict=True)])
    reach = np.maximum(np.abs(quantile * std[:, None] * distances), widths[:, None])
    intervals = estimates[:, None] + np.sign(bounds) * np.maximum(reach, np.sign(bounds) * spans)
    model, _ = problem.with_values(optimum.values)
    shift = problem.measured[1] - problem.simulated(optimum.values, np.arange(len(problem.points.level)))[1]
    parameters = problem.parameters
    return ModelUpdate(
        _stated_at(model, reference),
        problem.names,
        np.array([each.plain(value) for each, value in zip(parameters, estimates, strict=True)]),
        np.array([[each.plain(end) for end in pair] for each, pair in zip(parameters, intervals, strict=True)]),
        tuple(not reason for reason in reasons),
        covariance / np.outer(std, std),
        float(np.exp(np.median(shift[optimum.resonant]))),
        misfit,
        _findings(problem, optimum, reasons, covariance, misfit),
    )


def _span(
    combination: np.ndarray, others: Sequence[tuple[np.ndarray, np.ndarray, float]], rise: float
) -> tuple[float, float]:
    """Least and greatest offset of a combination of the parameters that another law gives within a rise of chi-square:
    the profile over the laws, each of them a parabola."""
    ends = [0.0]
    for offset, covariance, higher in others:
        if higher < rise:
            half = np.sqrt(combination @ covariance @ combination * (1 - max(higher, 0.0) / rise) * rise)
            ends += [float(combination @ offset - half), float(combination @ offset + half)]
    return min(ends), max(ends)


def _misfits(optimum: _Optimum, bias: np.ndarray) -> tuple[float, float]:
    """Rms of what the model that is returned leaves, in standard uncertainties, ``LOST`` without a resonance, and the
    quantile of Student's t for 95 % intervals from the data with one.
    """
    from scipy.stats import t

    fitted, problem, left = len(optimum.values) + 1, optimum.problem, optimum.differences
    if problem.growth:  # no law has a mu that changes
        left = np.nan_to_num(replace(problem, growth=0.0).profile(optimum.values, bias, np.zeros_like(optimum.values)))
    off = np.where(np.tile(optimum.resonant, 2), left / problem.std, LOST)
    misfit = np.sqrt(np.sum(off**2) / max(len(off) - fitted, 1))
    return float(misfit), float(t.ppf(0.975, max(len(optimum.data.residuals) - fitted, 1)))


def _with_discrepancy(problem: MapProblem, values: np.ndarray, bias: np.ndarray, change: np.ndarray) -> _Optimum:
    """The optimum that knows that the law is only nearly right; ``change`` is the last one of the search before it.

    It has settled where that change is small, and the mean of the last posterior lies within ``_CLOSE`` standard
    deviations of the values about which the derivatives were taken; so does that of the exponent of mu over F_N.
    """
    growth = problem.growth
    for _ in range(_REFINED):
        problem = replace(problem, growth=growth)
        differences, _, counted = problem.differences(values, bias)
        if not counted.any():
            raise InputError(
                "the model has no resonance at any point of the map",
                where=problem.chart.name or "map",
                got=f"a search from {problem.band[0]:.4g} to {problem.band[1]:.4g} Hz",
                expected="the mode of the map",
                advice="compare the band of the map with the model's own frequencies, stuck and without the joint",
            )
        data = problem.linear(values, bias, differences.ravel(), counted)
        whole = posterior(data)
        profile = ProfileLikelihood(partial(problem.profile, values, bias), np.tile(counted, 2), data, whole)
        step = profile.damped(np.clip(whole.mean, -1, 1))
        values = values + step
        close = _CLOSE * np.sqrt(np.diag(whole.covariance))
        moved = whole.growth[0] - problem.growth
        arrived = bool(np.all(np.abs(whole.mean) < close)) and abs(moved) < _CLOSE * whole.growth[1]
        # a step that was shortened is none that led there
        if arrived or not (step.any() or moved):
            break
        growth = float(np.clip(whole.growth[0], -_STEEPEST, _STEEPEST))
    settled = arrived and bool(np.all(change < np.maximum(_SAME, close)))
    # what the optimum could not follow counts as uncertainty
    rest = whole.mean - step
    covariance = whole.covariance + np.outer(rest, rest)
    whole = replace(whole, mean=np.zeros_like(step), covariance=covariance)
    differences, _, resonant = problem.differences(values, bias)
    return _Optimum(problem, values, differences.ravel(), counted, counted & resonant, data.about(step), whole, settled)


def sound_slopes(
    above: Float[np.ndarray, "residual parameter"], below: Float[np.ndarray, "residual parameter"]
) -> Float[np.ndarray, "residual parameter"]:
    """Derivatives from differences to either side: their mean, or the smaller where a simulated peak jumped.

    A resonance that changes to a neighbouring peak, or is lost, within the step would pass for precise knowledge.
    """
    smaller = np.where(np.abs(above) < np.abs(below), above, below)
    jumped = np.abs(above - below) > np.maximum(_JUMP, 2 * np.abs(smaller))
    return np.where(jumped, smaller, 0.5 * (above + below))


def _restated(problem: MapProblem, values: np.ndarray, reference: float) -> tuple[np.ndarray, np.ndarray]:
    """Combinations of the parameters that are reported, and their values: k_T at the reference force of the law."""
    combinations, restated = np.eye(len(values)), values.copy()
    if "contact_stiffness" not in problem.names:
        return combinations, restated
    law = problem.model.joints[0].law
    distance = float(np.log(reference / law.reference_force))
    stiffness = problem.names.index("contact_stiffness")
    if "stiffness_exponent" in problem.names:
        combinations[stiffness, problem.names.index("stiffness_exponent")] = distance
        restated = combinations @ values
    else:
        restated[stiffness] += law.stiffness_exponent * distance
    return combinations, restated


def _common_doubt(optimum: _Optimum) -> str:
    """Why no parameter is to be believed; empty where there is no reason."""
    whole, resonant = optimum.posterior, optimum.resonant
    if not resonant.all():
        return f"the model has no resonance at {int(np.sum(~resonant))} of {len(resonant)} points"
    if not optimum.settled:
        return "the search has not settled"
    if whole.process_scale > _EXCESS:
        return "no law of the kind explains it, and what the parameters mean rests on the law"
    if whole.misfit > _MISFIT:
        return f"law and discrepancy leave {whole.misfit:.1f} times what they explain"
    return ""


def _undetermined(
    problem: MapProblem,
    optimum: _Optimum,
    bounds: Float[np.ndarray, "parameter 2"],
    std: Float[np.ndarray, "parameter"],
    spans: Float[np.ndarray, "parameter 2"],
) -> tuple[str, ...]:
    """Why each parameter is not identifiable; empty where it is.

    ``bounds`` of the profiles, ``std`` and the ``spans`` of other laws are those of what is reported.
    """
    parameters = problem.parameters
    if _common_doubt(optimum):
        return (_common_doubt(optimum),) * len(parameters)
    # the standard deviation of a uniform distribution over the search: an estimate above it says nothing
    limits = np.array([each.width / 3**0.5 for each in parameters])
    confirmed = levels_agree(optimum.data, problem.groups, optimum.posterior, limits)
    reasons = []
    # the standard deviation of a normal distribution with an interval as wide as what other laws span
    spread_of_laws = np.ptp(spans, axis=1) / (2 * COVERAGE_FACTOR)
    each = zip(parameters, bounds, confirmed, std, spread_of_laws, strict=True)
    for parameter, (below, above), same, spread, of_laws in each:
        if not np.isfinite([below, above]).all():
            reasons.append(f"values far {'above' if np.isfinite(below) else 'below'} explain the map as well")
        elif not same:
            reasons.append("not confirmed by estimates with one level left out")
        elif _vague(parameter, of_laws) and not _vague(parameter, spread):
            reasons.append(
                f"laws with a soft spring explain the map as well, and with them {_vague(parameter, of_laws)}"
            )
        else:
            reasons.append(_vague(parameter, spread))
    return tuple(reasons)


def _vague(parameter: FreeParameter, std: float) -> str:
    """Why a parameter is not determined although its spread is believed; empty where it is."""
    if std <= _VAGUE * parameter.width:
        return ""
    if parameter.logarithmic:
        return f"its standard uncertainty is a factor of {np.exp(min(std, 20)):.2g}"
    return f"its standard uncertainty is {std:.2g}" + ("" if parameter.linear else " on the logistic scale")


def _findings(
    problem: MapProblem, optimum: _Optimum, reasons: tuple[str, ...], covariance: np.ndarray, misfit: float
) -> tuple[Finding, ...]:
    where, scale = problem.chart.name or "map", optimum.posterior.process_scale
    findings = _not_identifiable(problem, reasons, covariance, pairs=not _common_doubt(optimum))
    growth, spread = optimum.posterior.growth
    if abs(growth) > _EVIDENT * spread:
        way, reach = "falls" if growth < 0 else "grows", COVERAGE_FACTOR * spread
        text = (
            f"mu {way} with the normal force, as F_N^({growth:.2f} ± {reach:.2f}); what is stated is mu at "
            f"{np.exp(problem.middle):.4g} N, and no law here lets it change."
        )
        advice = "predictions (compare.predict_map) follow it; a model that is simulated does not"
        findings.append(Finding("warning", "friction-changes", where, text, growth, _EVIDENT * spread, advice))
    if misfit > _MISFIT:
        text = f"the model leaves {misfit:.1f} times what the uncertainties of the map explain."
        advice = "look at the residuals over the map: another law, another mode, or bounds that are too narrow"
        findings.append(Finding("warning", "model-misfit", where, text, misfit, _MISFIT, advice))
    if scale > _EXCESS:
        text = (
            f"what the law leaves follows the load {scale:.1f} times as strongly as what laws of joints leave in "
            "general: its form is wrong, and the intervals are wide for that."
        )
        advice = "try another law, free the numbers of this one, or look for another mode in the map"
        findings.append(Finding("warning", "law-form", where, text, scale, _EXCESS, advice))
    return tuple(findings)


def _not_identifiable(
    problem: MapProblem, reasons: tuple[str, ...], covariance: np.ndarray, *, pairs: bool
) -> list[Finding]:
    """Findings on parameters with a reason; ``pairs``: one for two of which only ratio or product is determined."""
    std = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(std, std)
    findings, paired = [], set[int]()
    for n, name in enumerate(problem.names):
        if not reasons[n] or n in paired:
            continue
        others = np.abs(correlation[n]) * [bool(reason) and m != n for m, reason in enumerate(reasons)]
        partner = int(np.argmax(others))
        if pairs and others[partner] > _PAIRED:
            paired.add(partner)
            sign = np.sign(correlation[n, partner])
            variance = covariance[n, n] + covariance[partner, partner] - 2 * sign * covariance[n, partner]
            text = (
                f"the map determines only the {'ratio' if sign > 0 else 'product'} of {name} and "
                f"{problem.names[partner]} (standard uncertainty {100 * np.sqrt(max(variance, 0)):.2g} %), neither by "
                "itself."
            )
        else:
            text = f"the map does not determine {name}: {reasons[n]}."
        advice = "add levels or normal forces on the other side of the ridge, hold it fixed, or try another law"
        if not pairs:
            advice = "widen the band, begin at other values, or try another law"
        limit = _VAGUE * problem.parameters[n].width
        where = problem.chart.name or "map"
        findings.append(Finding("warning", "not-identifiable", where, text, float(std[n]), limit, advice))
    return findings
