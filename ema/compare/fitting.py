"""Joint parameters from a measured map: nonlinear least squares on damping and frequency, with intervals."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from ema.compare.replay import Places, measure, places, search_band
from ema.data import BeamModel, Finding, FrictionLaw, ModalMap
from ema.data.comparison import ModelUpdate
from ema.dof import Dof
from ema.errors import InputError
from ema.progress import Progress, advance, silent

_LOGARITHMIC = ("friction_coefficient", "contact_stiffness", "exponent", "background_damping", "force_scale")
FREE = ("friction_coefficient", "contact_stiffness", "stiffness_exponent", "exponent", "background_damping")
"""What can be identified: mu, k_T, its growth with F_N, m of Eq. (5), and damping that is not the joints'."""

_UNSTATED = 0.03
"""Relative standard uncertainty of a damping ratio whose own is not stated."""
_LEAST_DAMPING, _LEAST_FREQUENCY = 0.005, 1e-4
"""Least relative standard uncertainty that is believed."""
_PEAK = 0.05
"""Standard uncertainty of the place of a simulated maximum, in half bandwidths: peaks are flat."""
_PRIOR = 3.0
"""Standard deviation of the logarithms beforehand: a factor of 20 is no surprise."""
_VAGUE = 0.5
"""Standard uncertainty of a logarithm from which a parameter counts as not told by the map."""
_MISFIT = 2.0
_RANGE = {"friction_coefficient": 2.3, "contact_stiffness": 2.3, "stiffness_exponent": 0.5}
"""Half width of the search: logarithms about what the model says (a factor of 10), and an exponent about 0.5."""
_STARTS = (1, 16, 64, 128)
"""Places compared at first, by the number of parameters that are searched."""
_ROUGH = 2e-2
"""Tolerance of the simulated map in that search."""
_CONTESTANTS, _ROUND = 4, 6
"""Starts that are followed, and for how many iterations, before one is chosen."""
_THIN = 8
"""Points of the map with which starts are compared."""
_PASSES, _ITERATIONS, _STEP = 3, 15, 0.03
_SOFT = (1.0, 0.3, 0.0)
_SOFT_DAMPING, _SOFT_FREQUENCY = 0.15, 2e-3
"""The search begins with uncertainties widened by this much and narrows them in steps: precise frequencies make a long
bent valley, which is only followed from nearby."""
_JUMP = 20.0
"""Difference of the derivatives to either side, in standard uncertainties per unit, from which it may be a jump."""
_LOST = 5.0
"""Residual of a point at which the model has no resonance, in standard uncertainties."""


def update(
    model: BeamModel,
    chart: ModalMap,
    free: Sequence[str],
    at: Dof | str,
    output: Dof | str,
    band: tuple[float, float] | None = None,
    known_level: bool = True,
    tolerance: float = 5e-3,
    progress: Progress = silent,
) -> ModelUpdate:
    """Identify joint parameters from a measured map of one mode.

    Damping ratios and frequencies of all points are fitted at once, weighted by their uncertainties; a common ratio of
    the frequencies is left free, since it is a fault of the host and not of the joints. The law is the same in all
    joints. No guess is needed: starts over two decades of mu are compared first. A map that was fitted from FRFs
    (``measured``) is compared with the model fitted in the same way.

    Parameters
    ----------
    free : names out of ``FREE``.
    at, output, band : as in ``ema.compare.measure``.
    known_level : false where the force levels are known only relative to each other (hammer without a force scale, the
        steps of an amplifier): a factor on them is identified too, and only mu over that factor can be told.

    Raises
    ------
    InputError : a parameter that is not known or that the law does not have, too few points, joints that do not fit.
    """
    names = (*_checked(model, free), *(() if known_level else ("force_scale",)))
    points = places(model, chart)
    if 2 * len(points.level) <= len(names) + 1:
        raise InputError(
            "too few points",
            where=chart.name or "map",
            got=f"{len(points.level)} points",
            expected=f"more than {(len(names) + 1) // 2} for {len(names)} parameters",
        )
    problem = _Problem(_centred(model, points), chart, points, names, at, output, band or search_band(chart), tolerance)
    values = problem.start(progress)
    bias = np.zeros(len(points.level))
    for number in range(_PASSES):
        advance(progress, "updating the model", number, _PASSES)
        before = values
        values = problem.optimum(values, bias)
        if chart.method == "frozen" or np.max(np.abs(values - before)) < 0.01:
            break
        bias = problem.bias(values)
    return _result(problem, values, bias, [joint.law.reference_force for joint in model.joints])


def _centred(model: BeamModel, points: Places) -> BeamModel:
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


def _checked(model: BeamModel, free: Sequence[str]) -> tuple[str, ...]:
    where = model.name or "model"
    if not model.joints:
        raise InputError("a model without joints", where=where, got="0 joints", expected="one or more")
    laws = {joint.law.name for joint in model.joints}
    for name in free:
        if name not in FREE:
            raise InputError("an unknown parameter", where=where, got=name, expected="some of " + ", ".join(FREE))
        if name == "exponent" and laws != {"regularised masing"}:
            raise InputError(
                "the law has no exponent m",
                where=where,
                got=", ".join(sorted(laws)),
                expected="regularised masing",
                advice="leave `exponent` out",
            )
    if not free or len(set(free)) != len(free):
        raise InputError("not a list of free parameters", where=where, got=list(free), expected="each name once")
    return tuple(free)


def _with_parameters(law: FrictionLaw, values: Mapping[str, float]) -> FrictionLaw:
    return replace(
        law,
        friction_coefficient=values.get("friction_coefficient", law.friction_coefficient),
        contact_stiffness=values.get("contact_stiffness", law.contact_stiffness),
        stiffness_exponent=values.get("stiffness_exponent", law.stiffness_exponent),
    )


@dataclass(frozen=True)
class _Problem:
    model: BeamModel
    chart: ModalMap
    points: Places
    names: tuple[str, ...]
    at: Dof | str
    output: Dof | str
    band: tuple[float, float]
    tolerance: float

    @cached_property
    def measured(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Logarithms of damping and frequency of the points, and their standard uncertainties."""
        place = (self.points.row, self.points.column)
        damping, frequency = self.chart.damping[place], self.chart.frequency[place]
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
            stated = self.chart.damping_std[place] / damping
            of_damping = np.where(np.isfinite(stated), stated, _UNSTATED)
        if self.chart.frequency_std is not None:
            stated = self.chart.frequency_std[place] / frequency
            of_frequency = np.where(np.isfinite(stated), stated, of_frequency)
        return (
            np.log(damping),
            np.log(frequency),
            np.hypot(of_damping, _LEAST_DAMPING),
            np.sqrt(of_frequency**2 + _LEAST_FREQUENCY**2 + (_PEAK * damping) ** 2),
        )

    def initial(self) -> np.ndarray:
        law = self.model.joints[0].law
        have = {
            "friction_coefficient": law.friction_coefficient,
            "contact_stiffness": law.contact_stiffness,
            "stiffness_exponent": law.stiffness_exponent,
            "exponent": dict(law.parameters).get("exponent", 1.0),
            "background_damping": max(self.model.damping.ratio, 1e-4),
            "force_scale": 1.0,
        }
        return np.array([np.log(have[name]) if name in _LOGARITHMIC else have[name] for name in self.names])

    def with_values(self, values: np.ndarray) -> tuple[BeamModel, float]:
        """The model with other parameters, and the factor on the force levels."""
        plain = {
            name: float(np.exp(value)) if name in _LOGARITHMIC else float(value)
            for name, value in zip(self.names, values, strict=True)
        }
        scale = plain.pop("force_scale", 1.0)
        ratio = plain.pop("background_damping", self.model.damping.ratio)
        exponent = plain.pop("exponent", None)
        joints = []
        for joint in self.model.joints:
            law = _with_parameters(joint.law, plain)
            if exponent is not None:
                law = replace(law, parameters=(("exponent", exponent),))
            joints.append(replace(joint, law=law))
        damping = replace(self.model.damping, ratio=min(ratio, 0.5))
        return replace(self.model, joints=tuple(joints), damping=damping), scale

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
            result[:, some] = self._resonances(model.with_normal_force(forces.mean(axis=0).tolist()), level)
        return result

    def _resonances(self, model: BeamModel, levels: np.ndarray) -> Float[np.ndarray, "2 point"]:
        from ema.simulate.maps import resonances

        try:
            found = resonances(model, levels, self.at, self.output, self.band, self.tolerance)
            return np.log([[peak.damping for peak in found], [peak.frequency for peak in found]])
        except InputError:
            if len(levels) == 1:
                return np.full((2, 1), np.nan)
            return np.hstack([self._resonances(model, levels[n : n + 1]) for n in range(len(levels))])

    def residuals(
        self, values: np.ndarray, bias: np.ndarray, soft: float = 0.0, chosen: np.ndarray | None = None
    ) -> Float[np.ndarray, "residual"]:
        """Of damping, frequency and the prior, in standard uncertainties, which are widened where ``soft``."""
        some = np.arange(len(self.points.level)) if chosen is None else chosen
        damping, frequency, of_damping, of_frequency = (part[some] for part in self.measured)
        of_damping = np.hypot(of_damping, soft * _SOFT_DAMPING)
        of_frequency = np.hypot(of_frequency, soft * _SOFT_FREQUENCY)
        simulated = self.simulated(values, some)
        off = (damping - simulated[0] - bias[some]) / of_damping
        shift = frequency - simulated[1]
        known = np.isfinite(shift)
        weights = known / of_frequency**2
        common = np.nansum(weights * np.where(known, shift, 0)) / max(weights.sum(), 1e-300)
        parts = np.concatenate([off, (shift - common) / of_frequency])
        return np.concatenate([np.where(np.isfinite(parts), parts, _LOST), (values - self.initial()) / _PRIOR])

    def start(self, progress: Progress) -> np.ndarray:
        """The best of many starts on a few points of the map: the valleys are narrow where a beam resonates."""
        from scipy.stats import qmc

        initial, none = self.initial(), np.zeros(len(self.points.level))
        order = np.argsort(np.log(self.points.forces.mean(axis=1) / self.points.level))
        chosen = np.unique(order[np.linspace(0, len(order) - 1, min(_THIN, len(order))).astype(int)])
        searched = [name for name in _RANGE if name in self.names]
        if not searched:
            return initial
        spread = 2 * qmc.Sobol(len(searched), seed=1).random(_STARTS[len(searched)]) - 1
        trials = np.tile(initial, (len(spread) + 1, 1))
        for name, part in zip(searched, spread.T, strict=True):
            place = self.names.index(name)
            middle = initial[place] if name in _LOGARITHMIC else _RANGE[name]
            trials[1:, place] = middle + _RANGE[name] * part
        rough = replace(self, tolerance=_ROUGH)
        costs = []
        for number, trial in enumerate(trials):
            advance(progress, "comparing starts", number, len(trials))
            off = rough.residuals(trial, none, _SOFT[0], chosen)
            # far from the optimum a few points are far off: they must not decide alone
            costs.append(float(np.sum(np.log1p((off / _LOST) ** 2))))
        ended = [rough._descend(trials[n], none, _SOFT[0], _ROUND, chosen) for n in np.argsort(costs)[:_CONTESTANTS]]
        return min(ended, key=lambda pair: pair[1])[0]

    def optimum(self, values: np.ndarray, bias: np.ndarray) -> np.ndarray:
        """From a place near the optimum to the optimum."""
        for soft in _SOFT[1:] if not bias.any() else _SOFT[-1:]:
            values = self._descend(values, bias, soft, _ITERATIONS)[0]
        return values

    def _descend(
        self, values: np.ndarray, bias: np.ndarray, soft: float, iterations: int, chosen: np.ndarray | None = None
    ) -> tuple[np.ndarray, float]:
        from scipy.optimize import least_squares

        found = least_squares(
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
        return np.asarray(found.x), float(found.cost)

    def slopes(
        self, values: np.ndarray, bias: np.ndarray, soft: float = 0.0, chosen: np.ndarray | None = None
    ) -> Float[np.ndarray, "residual parameter"]:
        """Derivatives of the residuals, over steps above the tolerance of the simulated map."""
        here = self.residuals(values, bias, soft, chosen)
        steps = _STEP * np.eye(len(values))
        return np.stack([self.residuals(values + h, bias, soft, chosen) - here for h in steps], axis=1) / _STEP

    def bias(self, values: np.ndarray) -> np.ndarray:
        """What the fit of FRFs reads of the model's damping over its equivalent damping, logarithm; 0 at holes."""
        model, scale = self.with_values(values)
        levels = None if self.chart.force_at_resonance is None else scale * self.chart.force_at_resonance
        scaled = replace(self.chart, force_levels=scale * self.chart.force_levels, force_at_resonance=levels)
        fitted = measure(model, scaled, self.at, self.output, self.band, self.tolerance)
        equivalent = self.simulated(values, np.arange(len(self.points.level)))[0]
        with np.errstate(invalid="ignore"):
            ratio = np.log(fitted.damping[self.points.row, self.points.column]) - equivalent
        return np.where(np.isfinite(ratio), ratio, 0.0)


def _result(problem: _Problem, values: np.ndarray, bias: np.ndarray, reference: Sequence[float]) -> ModelUpdate:
    from scipy.stats import t

    off = problem.residuals(values, bias)
    steps = _STEP * np.eye(len(values))
    above = np.stack([problem.residuals(values + h, bias) - off for h in steps], axis=1) / _STEP
    below = np.stack([off - problem.residuals(values - h, bias) for h in steps], axis=1) / _STEP
    slopes = sound_slopes(above, below)
    count = len(values)
    data = off[:-count]
    freedom = max(len(data) - count - 1, 1)
    misfit = float(np.sqrt(np.sum(data**2) / freedom))
    covariance = np.linalg.inv(slopes.T @ slopes) * max(1.0, misfit**2)
    model, _ = problem.with_values(values)
    shift = problem.measured[1] - problem.simulated(values, np.arange(len(problem.points.level)))[1]
    values, covariance = _restated(problem, values, covariance, reference[0])
    std = np.sqrt(np.diag(covariance))
    reach = float(t.ppf(0.975, freedom)) * std
    logarithmic = np.array([name in _LOGARITHMIC for name in problem.names])
    bounds = np.stack([values - reach, values + reach], axis=1)
    with np.errstate(over="ignore"):
        intervals = np.where(logarithmic[:, None], np.exp(bounds), bounds)
    correlation = covariance / np.outer(std, std)
    told = tuple(bool(s < _VAGUE) for s in std)
    plain = np.where(logarithmic, np.exp(np.where(logarithmic, values, 0.0)), values)
    findings = _findings(problem, std, told, correlation, covariance, misfit)
    return ModelUpdate(
        _stated_at(model, reference),
        problem.names,
        plain,
        intervals,
        told,
        correlation,
        float(np.exp(np.nanmedian(shift))),
        misfit,
        findings,
    )


def sound_slopes(
    above: Float[np.ndarray, "residual parameter"], below: Float[np.ndarray, "residual parameter"]
) -> Float[np.ndarray, "residual parameter"]:
    """Derivatives from differences to either side: their mean, or the smaller where a simulated peak jumped.

    A resonance that changes to a neighbouring summit, or is lost, within the step would pass for precise knowledge.
    """
    smaller = np.where(np.abs(above) < np.abs(below), above, below)
    jumped = np.abs(above - below) > np.maximum(_JUMP, 2 * np.abs(smaller))
    return np.where(jumped, smaller, 0.5 * (above + below))


def _restated(
    problem: _Problem, values: np.ndarray, covariance: np.ndarray, reference: float
) -> tuple[np.ndarray, np.ndarray]:
    """Estimate and covariance with k_T at the reference force of the law."""
    if "contact_stiffness" not in problem.names:
        return values, covariance
    law = problem.model.joints[0].law
    way = float(np.log(reference / law.reference_force))
    change, moved = np.eye(len(values)), values.copy()
    place = problem.names.index("contact_stiffness")
    if "stiffness_exponent" in problem.names:
        change[place, problem.names.index("stiffness_exponent")] = way
        moved = change @ values
    else:
        moved[place] += law.stiffness_exponent * way
    return moved, change @ covariance @ change.T


def _findings(
    problem: _Problem,
    std: np.ndarray,
    told: tuple[bool, ...],
    correlation: np.ndarray,
    covariance: np.ndarray,
    misfit: float,
) -> tuple[Finding, ...]:
    where = problem.chart.name or "map"
    findings = []
    seen: set[int] = set()
    for n, name in enumerate(problem.names):
        if told[n] or n in seen:
            continue
        others = np.abs(correlation[n]) * (np.arange(len(told)) != n)
        partner = int(np.argmax(others)) if len(told) > 1 else n
        if partner != n and others[partner] > 0.98:
            seen.add(partner)
            ratio = correlation[n, partner] > 0
            sign = -1 if ratio else 1
            spread = covariance[n, n] + covariance[partner, partner] + 2 * sign * covariance[n, partner]
            text = (
                f"the map tells only the {'ratio' if ratio else 'product'} of {name} and {problem.names[partner]} "
                f"(standard uncertainty {100 * np.sqrt(max(spread, 0)):.2g} %), neither by itself."
            )
        else:
            text = (
                f"the map does not tell {name}: its standard uncertainty is a factor of {np.exp(min(std[n], 20)):.2g}."
            )
        advice = "add levels or normal forces on the other side of the ridge, or hold it fixed"
        findings.append(Finding("warning", "not-identifiable", where, text, float(std[n]), _VAGUE, advice))
    if misfit > _MISFIT:
        text = f"the model leaves {misfit:.1f} times what the uncertainties of the map explain."
        advice = "look at the residuals over the map: another law, another mode, or bounds that are too narrow"
        findings.append(Finding("warning", "model-misfit", where, text, misfit, _MISFIT, advice))
    return tuple(findings)
