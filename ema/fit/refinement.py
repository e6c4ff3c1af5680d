"""From a selection of modes to the optimum for the noise of every FRF, and what the intervals rest on."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from ema.data import FrfSet
from ema.fit import likelihood, noise, scatter, search, weighted
from ema.fit.prepare import Prepared
from ema.fit.search import MISFIT
from ema.fit.select import Dropped, Selection
from ema.fit.weighted import Linearisation, State, Weighted

_ENOUGH = 60_000
"""Values from which the structure of the noise and its correlation are estimated."""
_BEYOND = 3.0
"""Energy of the residual over that of the known noise from which on the noise is not what limits the fit."""
_ROUNDS = 4
"""Optima at which the poles are judged again."""
_LONGEST = 60
"""Lines over which errors of FRFs are followed: local models and windows correlate a few tens of them."""


@dataclass(frozen=True)
class Refined:
    """The optimum in units of ``unit`` rad/s; ``kept`` (mode,) are the poles of the selection that it has,
    ``dropped`` the modes that it has not, and why.

    ``inflation`` (unknown,) is the variance of each shared unknown over what the weights say, ``inflation_of_shapes``
    (mode,) that of shapes: residual energy over that of the assumed noise, times the loss by errors that are correlated
    over lines, times that of a misfit at the peaks, and for poles at least what changes between lines, outputs and
    blows. ``basis`` says in words what the noise level rests on.
    """

    state: State
    normal: Linearisation
    kept: Int[np.ndarray, "mode"]
    dropped: tuple[Dropped, ...]
    unit: float
    inflation: Float[np.ndarray, "unknown"]
    inflation_of_shapes: Float[np.ndarray, "mode"]
    basis: str


def refined(band: FrfSet, data: Prepared, chosen: Selection) -> Refined:
    """Refine selected poles, participation, shapes and residual terms with a weight for every line of every FRF."""
    unit = float(np.abs(chosen.data.s).mean())
    s = 2j * np.pi * data.frequencies / unit
    signals = np.ascontiguousarray((data.values * ((s * unit) ** -data.derivative)[:, None, None]).transpose(1, 2, 0))
    flat = Weighted(s, unit, signals, np.broadcast_to(1.0, signals.shape))
    start = _start(data, chosen, unit)
    known, basis = _known(band, data)
    misfit = _misfit(flat, start, data.derivative, known)
    if misfit and known is not None:
        known, basis = None, f"scatter of the residuals over the lines, which is beyond the {basis.partition(',')[0]}"
    flat = replace(flat, weights=_weights(flat, start, data.derivative, known, misfit))
    # Few values: what the start was still off by shows in their noise.
    again = known is None and not misfit and signals.size <= _ENOUGH
    floor = likelihood.narrowest_decay(chosen.data) / unit
    state, kept = weighted.normalised(start), np.arange(len(start.poles))
    normal = weighted.linearise(flat, state)
    dropped: tuple[Dropped, ...] = ()
    for _ in range(_ROUNDS):
        # What is fitted badly asks for poles that noise would not: then all of them stay.
        if not misfit:
            state, normal, kept, gone = _pruned(flat, state, normal, chosen, kept)
            dropped = (*dropped, *gone)
        state, normal = weighted.refine(flat, state, floor, normal)
        if again:
            again = False
            flat = replace(flat, weights=_weights(flat, state, data.derivative, known, misfit))
            state = weighted.normalised(state)
            normal = weighted.linearise(flat, state)
            continue
        settled = replace(normal, offset=np.zeros_like(normal.offset))
        if misfit or not len(_needless(flat, state, settled, chosen, kept)[0]):
            break
        state = weighted.normalised(state)
        normal = weighted.linearise(flat, state)
    factor = weighted.cost(flat, state) / weighted.freedom(flat, state)
    of_poles, of_shapes = _loss(flat, state)
    between, of_what = _between(flat, state, normal, factor * of_poles, band, data, chosen.is_mode[kept])
    basis += of_what
    at_peaks = _at_peaks(flat, state) if misfit else np.ones(len(state.poles))
    inflation = np.tile((factor * of_poles * at_peaks)[state.owners], 2)
    half, modes = len(inflation) // 2, len(state.poles)
    inflation[:modes] *= np.maximum(between[0] / at_peaks, 1)
    inflation[half : half + modes] *= np.maximum(between[1] / at_peaks, 1)
    return Refined(state, normal, kept, dropped, unit, inflation, factor * of_shapes * at_peaks, basis)


def _between(
    flat: Weighted,
    state: State,
    normal: Linearisation,
    variance: Float[np.ndarray, "mode"],
    band: FrfSet,
    data: Prepared,
    is_mode: Bool[np.ndarray, "mode"],
) -> tuple[Float[np.ndarray, "2 mode"], str]:
    """Factors for what noise alone does not explain, and what it is in words."""
    found = {
        "noise that the FRFs share": scatter.between_lines(flat, state, normal, variance),
        "scatter between the FRFs": scatter.between_outputs(flat, state, normal, variance),
    }
    if band.deviations is not None:
        blows = _single_blows(band, data, flat)
        found["scatter between the blows"] = scatter.between_blows(flat, state, normal, variance, *blows)
    words = [name for name, factor in found.items() if np.any(factor[:, is_mode] > 1)]
    basis = f"; of some poles, {' and '.join(words)}, which is beyond that" if words else ""
    return np.max(list(found.values()), axis=0), basis


def _pruned(
    data: Weighted, state: State, normal: Linearisation, chosen: Selection, kept: Int[np.ndarray, "mode"]
) -> tuple[State, Linearisation, Int[np.ndarray, "left"], tuple[Dropped, ...]]:
    """The state without poles that noise explains, which poles of the selection stay, and the modes that do not."""
    dropped: tuple[Dropped, ...] = ()
    while True:
        gone, share = _needless(data, state, normal, chosen, kept)
        if not len(gone):
            return state, normal, kept, dropped
        dropped += tuple(
            Dropped(complex(state.poles[k] * data.unit), f"it explains {part:.2g} times what noise of its lines would")
            for k, part in zip(gone, share, strict=True)
            if chosen.is_mode[kept[k]]
        )
        state, kept = weighted.without_poles(state, gone), np.delete(kept, gone)
        normal = weighted.linearise(data, state)


def _needless(
    data: Weighted, state: State, normal: Linearisation, chosen: Selection, kept: Int[np.ndarray, "mode"]
) -> tuple[Int[np.ndarray, "gone"], Float[np.ndarray, "gone"]]:
    """Poles that noise explains, none of them near another one of them, and their energy over what noise explains.

    Here every line of every FRF has its own noise, which the selection knows on the average only. A mode has to exceed
    what noise does anywhere in the band; background stays as long as it does more than noise at its place.
    """
    gain, unknowns = weighted.gains(data, state, normal)
    lines = np.abs(data.s.imag)
    mode = search.passes_for_mode(unknowns, len(lines)) * search.caution(
        state.poles, state.poles, float(np.min(np.diff(lines)))
    )
    is_mode = chosen.is_mode[kept]
    share = gain / np.where(is_mode, mode, weighted.chance(unknowns))
    if chosen.named:
        share[is_mode] = np.inf
    gone: list[int] = []
    for k in np.argsort(share):
        if share[k] > 1:
            break
        reach = 4 * (np.abs(state.poles[gone].real) + abs(state.poles[k].real))
        if np.all(np.abs(state.poles[gone] - state.poles[k]) > reach):
            gone.append(int(k))
    return np.array(gone, int), share[gone]


def _start(data: Prepared, chosen: Selection, unit: float) -> State:
    """The selection with shapes and residual terms on all outputs."""
    fit, blocks = chosen.fit, []
    for first in range(0, len(data.dofs), 48):
        rows = slice(first, first + 48)
        part = replace(chosen.noise, outputs=chosen.noise.outputs[rows])
        observed = likelihood.observe(
            data.frequencies, data.values[:, rows], data.derivative, part, chosen.starts, rotate=False
        )
        blocks.append(likelihood.linear_unknowns(observed, fit) * chosen.noise.outputs[rows])
    coefficients = np.concatenate(blocks, axis=1)
    modes, references, unobserved = len(fit.poles), len(data.references), len(chosen.data.rest)
    pairs = (coefficients[0::2] + 1j * coefficients[1::2]).T
    rest = pairs[:, modes:].reshape(len(data.dofs), references, unobserved + 1)
    static = rest[:, :, -1]
    return State(
        poles=fit.poles / unit,
        participation=fit.participation,
        shapes=pairs[:, :modes] / unit,
        rest_poles=chosen.data.rest / unit,
        rest=np.concatenate([rest[:, :, :-1] / unit, np.stack([static.real, static.imag], axis=2)], axis=2),
        active=np.ones(unobserved + 2, bool),
    )


def _known(band: FrfSet, data: Prepared) -> tuple[Float[np.ndarray, "out in freq"] | None, str]:
    """Variance that came with the FRFs, arranged like the signals, and what the intervals rest on."""
    variance = noise.measured(band)
    if variance is None:
        single = band.averages is not None and np.max(band.averages, initial=0) <= 1
        why = "; with a single average the coherence is 1 and says nothing" if single else ""
        return None, f"scatter of the residuals over the lines{why}"
    if data.swapped:
        variance = variance.transpose(0, 2, 1)
    rows, columns = _places(band, data)
    variance = variance[len(variance) - len(data.frequencies) :][:, rows][:, :, columns]
    source = "variance of the FRFs" if band.variance is not None else "coherence of the FRFs"
    return np.ascontiguousarray(variance.transpose(1, 2, 0)), f"{source}, scaled to the residuals"


def _places(band: FrfSet, data: Prepared) -> tuple[list[int], list[int]]:
    """Where the DOFs and the references of the fit are among those of the FRFs."""
    dofs, references = (band.inputs, band.outputs) if data.swapped else (band.outputs, band.inputs)
    return [dofs.index(dof) for dof in data.dofs], [references.index(dof) for dof in data.references]


def _single_blows(
    band: FrfSet, data: Prepared, flat: Weighted
) -> tuple[Complex[np.ndarray, "blow out in freq"], Int[np.ndarray, "blow out in"]]:
    """Deviations by single blows, arranged like the signals, and the numbers of the blows."""
    assert band.deviations is not None
    values, blows = band.deviations.values, band.deviations.blows
    if data.swapped:
        values, blows = values.transpose(0, 1, 3, 2), blows.transpose(0, 2, 1)
    rows, columns = _places(band, data)
    values = values[:, values.shape[1] - len(data.frequencies) :][:, :, rows][:, :, :, columns]
    curve = (flat.s * flat.unit) ** -data.derivative
    return values.transpose(0, 2, 3, 1) * curve, blows[:, rows][:, :, columns]


def _misfit(data: Weighted, state: State, derivative: int, known: Float[np.ndarray, "out in freq"] | None) -> bool:
    """Whether the residual is no noise: correlated over lines, and beyond the known variance where there is one."""
    some = _some(data)
    residual = data.signals[some] - weighted.model(data, state, some)
    residual *= (np.abs(data.s) * data.unit) ** derivative
    residual /= np.sqrt(known[some]) if known is not None else 1
    energy = np.abs(residual) ** 2
    together = float(np.sum((residual[..., 1:] * residual[..., :-1].conj()).real))
    if together <= MISFIT * float(np.sum(energy)):
        return False
    # A window correlates noise over lines too, but does not make it larger than its variance.
    return known is None or float(np.mean(energy)) > _BEYOND


def _weights(
    data: Weighted, state: State, derivative: int, known: Float[np.ndarray, "out in freq"] | None, misfit: bool
) -> Float[np.ndarray, "out in freq"]:
    """Weights of all lines of all FRFs from their variances, or from the residual of a state.

    A ``misfit`` that is larger than the noise may shape them within narrow limits only.
    """
    curve = np.abs(data.s) ** (2 * derivative)

    def powers(rows: slice) -> tuple[np.ndarray, np.ndarray]:
        """Noise power (stated, or that of the residual) and squared size of the fitted FRF for some rows."""
        fitted = weighted.model(data, state, rows)
        size = (fitted.real**2 + fitted.imag**2) * curve
        if known is not None:
            return known[rows] * data.unit ** (-2 * derivative), size
        residual = data.signals[rows] - fitted
        return (residual.real**2 + residual.imag**2) * curve, size

    some = _some(data)
    power, size = powers(some)
    found = noise.structure(power, size, plain=misfit)
    if known is None and len(state.poles):
        left = 1 - _leverage(data, state, curve / found.variance(power, size))
        found = noise.structure(power, size, left, plain=misfit)
    typical = float(np.median(_relative(found.variance(power, size), size))) if misfit else 0.0
    weights = np.empty(data.signals.shape)
    for rows in data.blocks():
        power, size = powers(rows)
        variance = found.variance(power, size) if known is None else noise.pooled(power, found, size)
        # An FRF that is fitted well draws the poles to itself and is fitted better: none counts more than the typical.
        variance *= np.maximum(typical / _relative(variance, size), 1)
        weights[rows] = 2 * curve / variance
    return weights


def _relative(variance: Float[np.ndarray, "out in freq"], size: Float[np.ndarray, "out in freq"]) -> np.ndarray:
    """Mean variance of each FRF over its mean square, shape (out, in, 1)."""
    tiny = np.finfo(float).tiny
    found: np.ndarray = np.mean(variance, axis=-1, keepdims=True) / (np.mean(size, axis=-1, keepdims=True) + tiny)
    return found + tiny


def _leverage(data: Weighted, state: State, weights: Float[np.ndarray, "some in freq"]) -> Float[np.ndarray, "in freq"]:
    """Share of the noise of each line that the modes follow, typical of all outputs.

    Where a peak is a few lines wide this is a good part, and the residual alone would make those lines look quiet.
    """
    outputs, modes = len(data.signals), len(state.poles)
    typical = np.mean(weights / np.mean(weights, axis=-1, keepdims=True), axis=0)
    direct, mirrored = 1 / (data.s - state.poles[:, None]), 1 / (data.s - state.poles.conj()[:, None])
    columns = []
    for entries, weight in zip(state.participation[:, :, None], typical, strict=True):
        one, other = entries * direct, entries.conj() * mirrored
        columns.append(np.concatenate([one + other, 1j * (one - other)]) * np.sqrt(weight))
    information = np.zeros((2 * modes, 2 * modes))
    for block in columns:
        flat = block.view(float)
        information += flat @ flat.T
    spread = weighted.inverse(information)
    shares = [0.5 * np.sum((block.conj() * (spread @ block)).real, axis=0) for block in columns]
    # Poles and participation are shared by all outputs.
    return np.minimum(np.array(shares) * (1 + len(columns) / outputs), 0.8)


def _some(data: Weighted) -> slice:
    """Outputs that stand for all."""
    return slice(None, None, max(1, data.signals.size // _ENOUGH))


def _loss(data: Weighted, state: State) -> tuple[Float[np.ndarray, "mode"], Float[np.ndarray, "mode"]]:
    """Variance of poles and of shapes over that for errors independent from line to line, each mode.

    The errors correlate as the residual does; what counts is how far the sensitivity of a mode reaches over lines:
    ``sum_l rho(l) c(l)`` with the autocorrelations of residual and sensitivity, each 1 at lag 0.
    """
    some, lines = _some(data), len(data.s)
    residual = np.sqrt(data.weights[some]) * (data.signals[some] - weighted.model(data, state, some))
    chance = 2.5 / np.sqrt(residual.size)
    rho = _autocorrelation(residual.reshape(-1, lines), chance)
    telling = int(np.argmax(np.append(rho, 0.0) < chance))
    ones = np.ones(len(state.poles))
    if telling < 2:
        return ones, ones
    typical = np.sqrt(np.mean(data.weights[some], axis=(0, 1)))
    result = []
    for power in (2, 1):
        sensitivity = typical / (data.s - state.poles[:, None]) ** power
        reach = np.stack([_autocorrelation(row[None])[1:telling] for row in sensitivity])
        result.append(np.maximum(1, 1 + 2 * reach @ rho[1:telling]))
    return result[0], result[1]


def _at_peaks(data: Weighted, state: State) -> Float[np.ndarray, "mode"]:
    """Residual energy where it moves each pole over that of all lines, at least 1: what is fitted badly is worst there.

    It is made up for what the pole and the shapes have followed of these lines.
    """
    modes, outputs = len(state.poles), len(data.signals)
    found, total = np.zeros(modes), np.zeros(modes)
    near = np.abs(data.s - state.poles[:, None]) ** -4
    size = np.abs(state.participation) ** 2
    for rows in data.blocks():
        residual = data.signals[rows] - weighted.model(data, state, rows)
        energy = data.weights[rows] * np.abs(residual) ** 2
        for values, result in ((data.weights[rows] * energy, found), (data.weights[rows], total)):
            result += np.einsum("oif,mf,im,om->m", values, near, size, np.abs(state.shapes[rows]) ** 2, optimize=True)
    reach = np.mean(data.weights, axis=(0, 1)) * near
    lines = np.sum(reach, axis=1) ** 2 / np.sum(reach**2, axis=1)
    left = np.maximum(1 - (1 + 1 / outputs) / lines, 0.2)
    usual = weighted.cost(data, state) / data.signals.size
    return np.maximum(found / (total * usual * left), 1)


def _autocorrelation(signals: Complex[np.ndarray, "row line"], least: float = -np.inf) -> Float[np.ndarray, "lag"]:
    """Real part of the autocorrelation of rows, pooled, from lag 0 to where it falls below ``least``."""
    count = signals.shape[1]
    energy = max(float(np.vdot(signals, signals).real), np.finfo(float).tiny)
    found = [1.0]
    while len(found) < min(_LONGEST, count // 4) and found[-1] >= least:
        lag = len(found)
        found.append(float(np.vdot(signals[:, : count - lag], signals[:, lag:]).real) / energy)
    return np.array(found)
