"""Frequency and damping at force levels and normal forces that were not measured, from a map and an updated model.

The updated model is right up to what ``parameter_intervals`` says of it: parameters that are not known exactly, a law
that is only nearly right, a host whose frequency is off by a common factor. About the updated parameters all three are
Gaussian and known at every condition, measured (A) or not (B):

    y_A - s_A = J_A theta + delta_A + noise,    y_B = s_B + J_B theta + delta_B,

with y the logarithms of damping ratio and frequency, s what the model says, J its derivatives by the parameters theta,
and delta the discrepancy with the common error of the frequencies in it. The prediction is y_B given y_A, averaged over
the scales of the discrepancy: a mixture of normal distributions.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from ema.compare.fitting import TOLERANCE, MapProblem, centred, middle_force
from ema.compare.free_parameters import FORCE_SCALE, FreeParameter, free_parameters, initial_values
from ema.compare.parameter_intervals import FRICTION_GROWTH, LinearData, posterior, scale_weights
from ema.compare.replay import MeasuredPoints, measured_points, search_band
from ema.data import Finding, MapPrediction, ModalMap, ModelUpdate
from ema.dof import Dof
from ema.errors import InputError

_FAR = 2.0
"""Force level or normal force over the highest measured one, or lowest measured one over it, beyond which bands were
not calibrated."""
_RELINEARISED, _CLOSE = 4, 0.3
"""How often derivatives are taken anew about the exponent of mu that the data tell, and the change of it, in standard
deviations, that is small enough."""
_CONTAINS = "noise of the map, parameters, form of the law, frequency of the host"


def predict_map(
    update: ModelUpdate,
    chart: ModalMap,
    force_levels: Sequence[float],
    normal_forces: Sequence[float],
    *,
    at: Dof | str,
    output: Dof | str,
    band: tuple[float, float] | None = None,
) -> MapPrediction:
    """Predict frequency and damping at other force levels and normal forces, with 95 % bands.

    The bands contain what the map leaves open of the parameters, what laws of joints get wrong, carried on from the
    measured conditions, and the common error of the host's frequency.

    Parameters
    ----------
    update : ModelUpdate
        What :func:`update` found from the map.
    chart : ModalMap
        The same measured map.
    force_levels, normal_forces : sequence of float
        Where to predict [N]: each level at each normal force, which all joints have. Levels are on the scale of the
        map's.
    at, output : Dof or str
        DOF of the model that is excited, and whose response is measured; as in :func:`measure`.
    band : tuple of (float, float), optional
        Band [Hz] in which the resonance is searched; by default that of the map and 4 % to either side.

    Returns
    -------
    MapPrediction
        Medians and 95 % bands, NaN where the model has no resonance in the band.

    Raises
    ------
    InputError
        If a level or normal force is not positive, or the map and the model do not fit each other.

    References
    ----------
    .. [1] Discrepancy of a model: Kennedy and O'Hagan (2001); Brynjarsdottir and O'Hagan (2014).

    Examples
    --------
    >>> from ema.examples import beam_model, modal_map
    >>> from ema.errors import InputError
    >>> found = ModelUpdate(beam_model(), ("friction_coefficient",), [0.45], [[0.4, 0.5]], (True,), [[1.0]], 1.0, 1.1)
    >>> try:
    ...     predict_map(found, modal_map(), [-1.0], [100.0], at="1:+X", output="1:+X")
    ... except InputError as error:
    ...     "force level" in str(error)
    True
    """
    from ema.simulate.maps import no_resonance

    levels, forces = _checked(force_levels, "a force level"), _checked(normal_forces, "a normal force")
    problem, values = _problem(update, chart, at, output, band or search_band(chart))
    problem, measured, common = _measured(problem, values)
    elsewhere, resonant, said = _elsewhere(problem, values, levels, forces)
    shape, quantiles = (len(levels), len(forces)), np.full((3, 2, resonant.size), np.nan)
    if resonant.any():
        conditional = _conditional(measured, _unmeasured(elsewhere, values, resonant, measured.origin))
        shift = np.concatenate([said[0][resonant], said[1][resonant] + common])
        for row, share in zip(quantiles, (0.025, 0.5, 0.975), strict=True):
            row[:, resonant] = (shift + conditional.quantile(share)).reshape(2, -1)
    low, value, high = np.exp(quantiles).reshape(3, 2, *shape)
    name = update.model.name or "model"
    holes = int(np.sum(~resonant))
    lost = (no_resonance(name, holes, resonant.size, problem.band),) if holes else ()
    return MapPrediction(
        force_levels=levels,
        normal_forces=forces,
        frequency=value[1],
        frequency_low=low[1],
        frequency_high=high[1],
        damping=value[0],
        damping_low=low[0],
        damping_high=high[0],
        method=chart.method,
        contains=_CONTAINS,
        statement=_statement(chart, levels, forces),
        name=chart.name,
        findings=(*update.findings, *_far(chart, levels, forces), *lost),
    )


@dataclass(frozen=True)
class _Mixture:
    """Normal distributions of ln zeta, then of ln f, at some conditions, and their weights."""

    weights: Float[np.ndarray, "node"]
    means: Float[np.ndarray, "node datum"]
    stds: Float[np.ndarray, "node datum"]

    def quantile(self, share: float) -> Float[np.ndarray, "datum"]:
        """Where the distribution function of each has this value, by bisection between the quantiles of its parts."""
        from scipy.stats import norm

        each = self.means + norm.ppf(share) * self.stds
        low, high = each.min(axis=0), each.max(axis=0)
        for _ in range(60):
            middle = 0.5 * (low + high)
            below = self.weights @ norm.cdf((middle - self.means) / self.stds) < share
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return np.asarray(0.5 * (low + high))


def _problem(
    update: ModelUpdate,
    chart: ModalMap,
    at: Dof | str,
    output: Dof | str,
    band: tuple[float, float],
) -> tuple[MapProblem, Float[np.ndarray, "parameter"]]:
    """The updated model with its map, and the values of the parameters on their scales."""
    points = measured_points(update.model, chart)
    model = centred(update.model, points)
    named = [name for name in update.names if name != FORCE_SCALE]
    parameters = free_parameters(model, named) if named else ()
    values = initial_values(model, parameters)
    if FORCE_SCALE in update.names:
        scale = FreeParameter(FORCE_SCALE)
        parameters = (*parameters, scale)
        values = np.append(values, scale.scaled(float(update.values[update.names.index(FORCE_SCALE)])))
    return MapProblem(model, chart, points, parameters, at, output, band, TOLERANCE, middle_force(points)), values


def _measured(problem: MapProblem, values: Float[np.ndarray, "parameter"]) -> tuple[MapProblem, LinearData, float]:
    """The measured conditions about the parameters and the exponent of mu that they tell, the problem with that
    exponent, and the common error of the frequencies (logarithm) taken off.

    Raises
    ------
    InputError : the model has no resonance at any of them.
    """
    bias = np.zeros(len(problem.points.level)) if problem.chart.method == "frozen" else problem.bias(values)
    for _ in range(_RELINEARISED):
        differences, _, counted = problem.differences(values, bias)
        if not counted.any():
            raise InputError(
                "the updated model has no resonance at any point of the map",
                where=problem.chart.name or "map",
                got=f"a search from {problem.band[0]:.4g} to {problem.band[1]:.4g} Hz",
                expected="the mode of the map",
                advice="predict from the map and the band that the model was updated with",
            )
        data = problem.linear(values, bias, differences.ravel(), counted)
        growth, spread = posterior(data).growth
        if abs(growth - problem.growth) < _CLOSE * spread:
            break
        problem = replace(problem, growth=growth)
    else:
        problem = replace(problem, growth=data.growth_offset * FRICTION_GROWTH)
    shift = problem.measured[1] - problem.simulated(values, np.arange(len(counted)))[1]
    sensitivity = _slopes(problem, values)[np.tile(counted, 2)]
    return problem, replace(data, sensitivity=sensitivity), float(np.mean((shift - differences[1])[counted]))


def _slopes(problem: MapProblem, values: Float[np.ndarray, "parameter"]) -> Float[np.ndarray, "datum parameter"]:
    """Derivatives of ln zeta, then of ln f, by the parameters; of the frequencies as they are, common error and all."""
    every = np.arange(len(problem.points.level))

    def less(step: Float[np.ndarray, "parameter"]) -> Float[np.ndarray, "datum"]:
        return -problem.simulated(values + step, every).ravel()

    return problem.sensitivity(less(np.zeros_like(values)), less)


def _elsewhere(
    problem: MapProblem,
    values: Float[np.ndarray, "parameter"],
    levels: Float[np.ndarray, "level"],
    forces: Float[np.ndarray, "force"],
) -> tuple[MapProblem, Bool[np.ndarray, "point"], Float[np.ndarray, "2 point"]]:
    """The model at other conditions, where it has a resonance there, and ln zeta and ln f that it gives there."""
    from ema.simulate.maps import within_band

    row, column = (each.ravel() for each in np.indices((len(levels), len(forces))))
    pressed = np.repeat(forces[column][:, None], len(problem.model.joints), axis=1)
    other = replace(problem, points=MeasuredPoints(row, column, levels[row], pressed))
    said = other.simulated(values, np.arange(len(row)))
    resonant = within_band(np.exp(said[1]), problem.band) & np.isfinite(said[0])
    plain = np.exp(np.where(resonant, said, 0.0)).reshape(2, len(levels), len(forces))
    chart = ModalMap(levels, forces, frequency=plain[1], damping=plain[0], method=problem.chart.method)
    other = replace(other, chart=chart)
    if problem.chart.method == "measured" and resonant.any():
        said[0] += other.bias(values)
        resonant &= np.isfinite(said[0])
    return other, resonant, said


def _unmeasured(
    elsewhere: MapProblem,
    values: Float[np.ndarray, "parameter"],
    resonant: Bool[np.ndarray, "point"],
    origin: tuple[float, float],
) -> LinearData:
    """Conditions that were not measured: derivatives and loads, without data."""
    known = np.tile(resonant, 2)
    log_load, log_normal_force = (each[resonant] for each in elsewhere.loads())
    return LinearData(
        residuals=np.zeros(np.count_nonzero(known)),
        sensitivity=_slopes(elsewhere, values)[known],
        std=np.zeros(np.count_nonzero(known)),
        log_load=log_load,
        log_normal_force=log_normal_force,
        damping=np.exp(elsewhere.measured[0])[resonant],
        law_differences=elsewhere.law_differences(values)[known],
        friction_growth=elsewhere.friction_growth(values)[known],
        prior_mean=elsewhere.initial - values,
        prior_std=1.0,
        growth_offset=0.0,
        origin=origin,
    )


def _conditional(measured: LinearData, other: LinearData) -> _Mixture:
    """ln zeta and ln f at the other conditions, less what the model gives, given the measured ones."""
    joint, known = _joined(measured, other)
    nodes, weights, estimates = scale_weights(measured)
    widened = max(1.0, posterior(measured).misfit)
    # the model at the other conditions has the exponent about which the data are
    about = measured.growth_offset * other.friction_growth
    means, stds = [], []
    for node, (mean, spread, _) in zip(nodes, estimates, strict=True):
        of_both = joint.law_covariance(*node)
        across, own = of_both[np.ix_(known, ~known)], np.diag(of_both)[~known]
        carried = np.linalg.solve(of_both[np.ix_(known, known)] + np.diag(measured.std**2), across).T
        slopes = other.sensitivity - carried @ measured.sensitivity
        means.append(slopes @ mean + carried @ measured.innovations - about)
        variance = own - np.sum(carried * across.T, axis=1) + np.sum((slopes @ spread) * slopes, axis=1)
        stds.append(widened * np.sqrt(np.maximum(variance, 1e-16)))
    return _Mixture(weights, np.array(means), np.array(stds))


def _joined(first: LinearData, second: LinearData) -> tuple[LinearData, Bool[np.ndarray, "datum"]]:
    """Both as one, ln zeta before ln f, and which data are the first's."""

    def both(one: np.ndarray, two: np.ndarray) -> np.ndarray:
        halves = zip(np.split(one, 2), np.split(two, 2), strict=True)
        return np.concatenate([part for pair in halves for part in pair])

    joint = replace(
        first,
        residuals=both(first.residuals, second.residuals),
        sensitivity=both(first.sensitivity, second.sensitivity),
        std=both(first.std, second.std),
        log_load=np.append(first.log_load, second.log_load),
        log_normal_force=np.append(first.log_normal_force, second.log_normal_force),
        damping=np.append(first.damping, second.damping),
        law_differences=both(first.law_differences, second.law_differences),
        friction_growth=both(first.friction_growth, second.friction_growth),
    )
    return joint, both(np.ones(len(first.std), bool), np.zeros(len(second.std), bool))


def _checked(values: Sequence[float], what: str) -> Float[np.ndarray, "value"]:
    """Numbers above 0.

    Raises
    ------
    InputError : none, or one that is not above 0.
    """
    numbers = np.asarray(values, np.float64)
    if numbers.ndim != 1 or not len(numbers) or not np.all(np.isfinite(numbers) & (numbers > 0)):
        raise InputError(f"not {what} to predict at", got=numbers.tolist(), expected="numbers above 0, in N")
    return numbers


def _outside(chart: ModalMap, levels: np.ndarray, forces: np.ndarray) -> list[tuple[str, float, float]]:
    """Of level and normal force: the furthest factor above the highest measured one, and below the lowest."""
    known = np.isfinite(chart.damping) & np.isfinite(chart.frequency)
    rows, columns = known.any(axis=1), known.any(axis=0)
    pairs = ("force level", levels, chart.force_levels[rows]), ("normal force", forces, chart.normal_forces[columns])
    return [(name, float(at.max() / had.max()), float(had.min() / at.min())) for name, at, had in pairs]


def _statement(chart: ModalMap, levels: np.ndarray, forces: np.ndarray) -> str:
    """How far outside the data the prediction lies."""
    parts = []
    for name, above, below in _outside(chart, levels, forces):
        if above > 1:
            parts.append(f"the highest {name} is {above:.3g} times the highest measured one")
        if below > 1:
            parts.append(f"the lowest {name} is the lowest measured one over {below:.3g}")
    if not parts:
        return "All conditions lie within the range of the map."
    text = "; ".join(parts)
    return f"{text[0].upper()}{text[1:]}."


def _far(chart: ModalMap, levels: np.ndarray, forces: np.ndarray) -> list[Finding]:
    """Conditions further from the measured ones than the bands were calibrated for."""
    findings = []
    for name, above, below in _outside(chart, levels, forces):
        for far, text in (
            (above, f"the highest {name} is {above:.3g} times the highest measured one."),
            (below, f"the lowest measured {name} is {below:.3g} times the lowest one predicted."),
        ):
            if far > _FAR * (1 + 1e-9):
                advice = f"The bands are calibrated up to a factor of {_FAR:g}; measure nearer to these conditions."
                where = chart.name or "map"
                findings.append(Finding("warning", "far-outside-the-data", where, text, far, _FAR, advice))
    return findings
