"""Eigensystem realisation: modes from impulse responses, an opinion independent of the fit in the frequency domain.

The lines of the band, counted from its start, become complex impulse responses by an inverse FFT: a band that does not
begin at 0 Hz costs nothing, and only poles with positive frequency appear. Two things of the band need care:

- the axis is sampled, so responses wrap around in time; an exponential that wraps stays an exponential;
- the axis ends, so the tails of all modes beyond it are missing: an error that is smooth over frequency and lives near
  the start of the responses. A first realisation skips those samples and has a high order. Then its modes are fitted
  to the FRFs together with residual terms and poles just outside the band; what the band cut off is added, what lies
  outside is taken away, and the modes are read again from whole responses, with exponentials in place of singular
  vectors.

Sources: Juang and Pappa 1985; modal amplitude coherence: Pappa, Elliott, Schenk 1993.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.fft
import scipy.linalg
from jaxtyping import Bool, Complex, Float, Int

from ema.data import Finding, FrfSet, ModalModel, Residuals, damping_ratios
from ema.errors import InputError
from ema.fit import hankel
from ema.fit.hankel import Realisation, Responses
from ema.fit.prepare import Prepared, prepare
from ema.fit.scaling import disagreements, scale_to_unit_modal_mass
from ema.progress import Progress, advance, silent

HEAVIEST = 0.25
"""Damping ratio from which on a pole is no mode's but computational: above the largest of an accepted mode
(`SelectionPolicy.heaviest`), so that no mode of the fit lacks a partner for this reason. Its unit tests pass at
half."""
_SKIP = 4
"""Samples at the start of the impulse responses that are left out: the error by the ends of the band lives there. With
2 its unit tests pass; with 8 two opinions on clean data no longer agree."""
_ORDER = 60
"""Model order that is tried first; it is doubled while its smallest singular value stands clear of the noise, or six
tenths of its poles are modes. A smaller one costs decompositions, a larger one poles of noise that have to be sorted
out."""
_HIGHEST = 240
"""Model order beyond which it is not doubled: a bound on the work."""
_COHERENT = 0.8
"""Extended modal amplitude coherence (Pappa, Elliott and Schenk 1993) below which a pole is noise."""
_SUPPORT = 0.5
"""Share of the lower orders, five between half and all of the order, in which a pole has to come back: three of five.
Its unit tests pass where two are enough, and where all five are wanted."""
_CLEAR = 3.0
"""Smallest singular value over that of noise above which the order is raised. Its unit tests pass at 1.5 and at 6."""
_UNSURE = 0.2
"""Standard deviation over decay rate beyond which a pole is noise: five of them to zero damping. Its unit tests pass at
half and at twice the value."""
_ALIKE = 0.8
"""MAC of the shape in the realisation and of the residue in the FRFs, below which they are not of one mode: of two
random real shapes over six DOFs 0.7 % reach it (beta distribution)."""
_PASSES = 6
"""Passes over the residual at most: a bound on the work. Its unit tests pass with 3 or 12."""
_SETTLED = 1e-5
"""Relative progress of the cost by a pass below which it is the last one: the residual then changes by 5e-6 of its
norm. A safeguard against passes that gain nothing."""
_MEMORY = 20000
"""Rows of the Hankel matrix, and eight times its columns, at which it ends; but not below 120 samples each way: a bound
on memory and work. Longer responses tell more of a narrow peak, shorter ones less."""


@dataclass(frozen=True)
class _Axis:
    """Lines of the band: ``s`` (freq,) in rad/s, power of s in the data, start rad/s and sampling interval s."""

    s: Complex[np.ndarray, "freq"]
    derivative: int
    shift: float
    step: float

    def values(self, poles: Complex[np.ndarray, "mode"]) -> Complex[np.ndarray, "mode"]:
        """Eigenvalues of poles."""
        return np.exp((poles - 1j * self.shift) * self.step)

    def poles(self, values: Complex[np.ndarray, "mode"]) -> Complex[np.ndarray, "mode"]:
        """Poles of eigenvalues, counted upwards from the start of the band."""
        angle = np.angle(values) % (2 * np.pi)
        return np.asarray((np.log(np.abs(values)) + 1j * angle) / self.step + 1j * self.shift)


@dataclass(frozen=True)
class _State:
    """Modes so far: poles with standard deviations (of each part), residues of the receptance (mode, dof, in), those of
    the terms outside, the poles of these, and the residual (freq, dof, in). ``moved`` (mode,) is the farthest that a
    pass took a pole: the scatter of the method.
    """

    poles: Complex[np.ndarray, "mode"]
    spread: Float[np.ndarray, "mode"]
    moved: Float[np.ndarray, "mode"]
    residues: Complex[np.ndarray, "mode dof in"]
    rest: Complex[np.ndarray, "term dof in"]
    outside: Complex[np.ndarray, "extra"]
    residual: Complex[np.ndarray, "freq dof in"]

    @property
    def cost(self) -> float:
        return float(np.vdot(self.residual, self.residual).real)


def era(frfs: FrfSet, progress: Progress = silent) -> ModalModel:
    """Fit a modal model to FRFs by the eigensystem realisation algorithm, without any setting.

    The intervals contain the noise of the FRFs and the scatter over the passes of the method.

    Parameters
    ----------
    frfs : FrfSet
        FRFs, already cut to the band. Of an axis with holes the longest even part is used, with a finding.
    progress : Progress, optional
        Called after each pass.

    Returns
    -------
    ModalModel
        The modes.

    Raises
    ------
    InputError
        If the FRFs cannot be fitted.

    References
    ----------
    .. [1] Juang and Pappa (1985), An eigensystem realization algorithm for modal parameter identification and model
       reduction, Journal of Guidance, Control, and Dynamics 8:620.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> model = era(frf_set(0.001))
    >>> model.natural_frequencies.round(1)
    array([40., 60., 90.])
    """
    frfs, findings = _even(frfs)
    data = prepare(frfs)
    lines = len(data.frequencies)
    period = (lines - 1) / float(data.frequencies[-1] - data.frequencies[0])
    start_of_band = 2 * np.pi * float(data.frequencies[0])
    axis = _Axis(2j * np.pi * data.frequencies, data.derivative, start_of_band, period / lines)
    advance(progress, "second opinion", 0, _PASSES + 1)
    scale = np.sqrt(np.mean(np.abs(data.values) ** 2, axis=(0, 2)))
    weighted = data.values / scale[:, None]
    start, spread, shapes = _first(weighted, axis)
    state = replace(_fitted(data.values, axis, start, spread), moved=spread)
    state = state if not len(start) else _alike(data.values, axis, state, shapes, scale)
    for number in range(_PASSES if len(state.poles) else 0):
        advance(progress, "second opinion", number + 1, _PASSES + 1)
        before, state = state, _again(data.values, axis, state)
        if state.cost > (1 - _SETTLED) * before.cost:
            break
    advance(progress, "second opinion", _PASSES + 1, _PASSES + 1)
    return _model(frfs, data, axis, state, findings)


def _even(frfs: FrfSet) -> tuple[FrfSet, tuple[Finding, ...]]:
    """The longest part of the axis with even spacing."""
    frequencies = frfs.frequencies
    if len(frequencies) < 3:
        return frfs, ()
    steps = np.diff(frequencies)
    usual = float(np.median(steps))
    breaks = np.flatnonzero(np.abs(steps - usual) > 1e-3 * abs(usual)) + 1
    if not len(breaks):
        return frfs, ()
    edges = np.concatenate([[0], breaks, [len(frequencies)]])
    longest = int(np.argmax(np.diff(edges)))
    part = frfs.lines(slice(int(edges[longest]), int(edges[longest + 1])))
    if len(part.frequencies) < 16:
        raise InputError(
            "impulse responses need evenly spaced lines",
            where=frfs.name or "FRFs",
            got=f"at most {len(part.frequencies)} such lines in a row",
            expected="at least 16",
            advice="take the fit without a second opinion",
        )
    note = Finding.of(
        "warning",
        "uneven-axis",
        frfs.name or "FRFs",
        "The frequency axis has {count} holes or changes of spacing; the second opinion is from "
        "{low} to {high} Hz only.",
        float(len(breaks)),
        count=len(breaks),
        low=f"{part.frequencies[0]:.6g}",
        high=f"{part.frequencies[-1]:.6g}",
    )
    return part, (note,)


def _first(
    weighted: Complex[np.ndarray, "freq dof in"], axis: _Axis
) -> tuple[Complex[np.ndarray, "mode"], Float[np.ndarray, "mode"], Complex[np.ndarray, "dof mode"]]:
    """Poles, their spread and shapes, selected from a realisation; its order is doubled while that is too low."""
    _, outputs, references = weighted.shape
    order = _ORDER
    while True:
        compressed, directions = _compressed(weighted, min(outputs, max(24, order // 2)))
        responses = _responses(compressed, _SKIP)
        order = min(order, responses.rows * compressed.shape[1], responses.columns * references)
        found = hankel.realise(responses, order, passes=1)
        poles, spread, shapes = _selected(found, compressed, axis)
        full = found.singular[-1] < _CLEAR * _noise_level(compressed, responses) and len(poles) < 0.6 * order
        if full or 2 * order > min(_HIGHEST, responses.rows, responses.columns):
            return poles, spread, directions @ shapes
        order *= 2


def _compressed(
    weighted: Complex[np.ndarray, "freq dof in"], count: int
) -> tuple[Complex[np.ndarray, "freq q in"], Float[np.ndarray, "dof q"]]:
    """The outputs on their strongest directions in common."""
    flat = weighted.transpose(1, 0, 2).reshape(weighted.shape[1], -1)
    _, directions = np.linalg.eigh((flat @ flat.conj().T).real)
    kept = directions[:, -count:]
    return (kept.T @ flat).reshape(kept.shape[1], len(weighted), -1).transpose(1, 0, 2), kept


def _responses(values: Complex[np.ndarray, "freq q in"], skip: int, whole: bool = False) -> Responses:
    """Impulse responses and a Hankel matrix: a quarter of them each way, or a half, as far as memory allows."""
    lines, outputs, references = values.shape
    largest = lines // 2 if whole else lines // 4
    half = min(largest, max(120, _MEMORY // outputs))
    wide = min(largest, max(120, _MEMORY // (8 * references)))
    return Responses(scipy.fft.ifft(values, axis=0), skip, max(2, half - skip), max(2, wide))


def _selected(
    found: Realisation, compressed: Complex[np.ndarray, "freq q in"], axis: _Axis
) -> tuple[Complex[np.ndarray, "mode"], Float[np.ndarray, "mode"], Complex[np.ndarray, "q mode"]]:
    """Modes of the highest order that lie inside the band, follow an exponential, stand above their own noise and
    appear at lower orders too."""
    order = len(found.singular)
    noise, references = _noise(compressed)
    modes = hankel.eigenmodes(found, order, noise, references)
    poles = axis.poles(modes.values)
    spread = modes.spread / np.abs(modes.values) / axis.step
    keep = _inside(poles, axis) & (spread < _UNSURE * np.abs(poles.real)) & (modes.coherence > _COHERENT)
    lower = np.unique(np.linspace(order / 2, order, 6).astype(int))[:-1]
    reach = np.maximum(3 * spread, 0.15 * np.abs(poles.real))
    nearest = [axis.poles(np.linalg.eigvals(found.state[:one, :one])) for one in lower]
    distance = np.array([np.min(np.abs(poles[:, None] - others), axis=1) for others in nearest])
    keep &= np.sum(distance < reach, axis=0) >= _SUPPORT * len(lower)
    return poles[keep], np.hypot(spread, np.median(distance, axis=0))[keep], modes.shapes[:, keep]


def _inside(poles: Complex[np.ndarray, "mode"], axis: _Axis) -> Bool[np.ndarray, "mode"]:
    """Decaying poles whose peak the band holds."""
    low, high = axis.s[0].imag, axis.s[-1].imag
    edge = np.minimum(poles.imag - low, high - poles.imag)
    return np.asarray((poles.real < 0) & (edge > np.abs(poles.real)) & (damping_ratios(poles) < HEAVIEST))


def _noise(values: Complex[np.ndarray, "freq q in"]) -> tuple[Float[np.ndarray, "freq"], Float[np.ndarray, "in"]]:
    """Variance that third differences over the lines show, outputs pooled: the same at each line, by reference."""
    difference = np.abs(np.diff(values, 3, axis=0)) ** 2 / 20
    # the median of an exponential variable is ln 2 times its mean; peaks do not move it
    variance = np.median(difference, axis=0).mean(axis=0) / np.log(2) + 1e-300
    return np.full(len(values), variance.mean()), variance / variance.mean()


def _noise_level(values: Complex[np.ndarray, "freq q in"], data: Responses) -> float:
    """Largest singular value of the Hankel matrix of noise alone, were its entries independent."""
    size = np.sqrt(data.rows * values.shape[1]) + np.sqrt(data.columns * values.shape[2])
    return float(np.sqrt(_noise(values)[0].mean() / len(values)) * size)


def _outside(axis: _Axis) -> Complex[np.ndarray, "extra"]:
    """Poles beyond both ends, the nearer the denser: together they make whatever is smooth inside the band."""
    low, high = axis.s[0].imag, axis.s[-1].imag
    distance = 0.004 * (high - low) * 3.5 ** np.arange(5)
    below = distance[low - distance > 0]
    return np.concatenate([-below + 1j * (low - below), -distance + 1j * (high + distance)])


def _fitted(
    values: Complex[np.ndarray, "freq dof in"], axis: _Axis, poles: Complex[np.ndarray, "mode"], spread: np.ndarray
) -> _State:
    """Residues of the poles, of the poles outside, lower and upper residual, by least squares on every FRF."""
    lines, outputs, references = values.shape
    outside = _outside(axis)
    everything = np.concatenate([poles, outside])
    factor = axis.s[:, None] ** axis.derivative
    direct, mirrored = (factor / (axis.s[:, None] - every) for every in (everything, everything.conj()))
    constant = np.concatenate([factor / axis.s[:, None] ** 2, factor], axis=1)
    columns = np.concatenate([direct + mirrored, constant, 1j * (direct - mirrored), 1j * constant], axis=1)
    real = np.concatenate([columns.real, columns.imag])
    scale = np.linalg.norm(real, axis=0)
    real /= scale
    flat = values.reshape(lines, -1)
    data = np.concatenate([flat.real, flat.imag])
    gram = real.T @ real + 1e-12 * np.eye(len(scale))
    solution = scipy.linalg.cho_solve(scipy.linalg.cho_factor(gram), real.T @ data)
    left = data - real @ solution
    solution /= scale[:, None]
    half = len(everything) + 2
    found = (solution[:half] + 1j * solution[half:]).reshape(half, outputs, references)
    residual = (left[:lines] + 1j * left[lines:]).reshape(values.shape)
    return _State(poles, spread, np.zeros(len(poles)), found[: len(poles)], found[len(poles) :], outside, residual)


def _alike(
    values: Complex[np.ndarray, "freq dof in"],
    axis: _Axis,
    state: _State,
    shapes: Complex[np.ndarray, "dof mode"],
    scale: Float[np.ndarray, "dof"],
) -> _State:
    """Without the modes whose shape in the realisation is not that of their residue."""
    residues, _ = _rank_one(state.residues / scale[:, None])
    product = np.abs(np.sum(residues.conj() * shapes, axis=0)) ** 2
    alike = product / np.maximum(np.sum(np.abs(residues) ** 2, axis=0) * np.sum(np.abs(shapes) ** 2, axis=0), 1e-300)
    keep = alike >= _ALIKE
    if keep.all():
        return state
    return replace(_fitted(values, axis, state.poles[keep], state.spread[keep]), moved=state.moved[keep])


def _rank_one(
    residues: Complex[np.ndarray, "mode dof in"],
) -> tuple[Complex[np.ndarray, "dof mode"], Complex[np.ndarray, "in mode"]]:
    """Shapes and participation nearest to residue matrices."""
    left, strength, right = np.linalg.svd(residues, full_matrices=False)
    root = np.sqrt(strength[:, :1])
    return (left[:, :, 0] * root).T, (right[:, 0] * root).T


def _again(values: Complex[np.ndarray, "freq dof in"], axis: _Axis, state: _State) -> _State:
    """The modes read again from responses without what lies outside and with what the band cut off.

    Where that explains the FRFs less well the poles stay, but it counts as scatter of the method.
    """
    try:
        poles, spread = _read(axis, state)
    except np.linalg.LinAlgError:
        return state
    moved = np.maximum(state.moved, np.abs(poles - state.poles))
    if np.all(_inside(poles, axis)):
        trial = _fitted(values, axis, poles, spread)
        if trial.cost < state.cost:
            return replace(trial, moved=moved)
    return replace(state, moved=moved)


def _read(axis: _Axis, state: _State) -> tuple[Complex[np.ndarray, "mode"], Float[np.ndarray, "mode"]]:
    """Poles and their noise from the completed responses."""
    level = np.sqrt(np.mean(np.abs(state.residual) ** 2, axis=(0, 2))) + 1e-300
    residual = state.residual / level[:, None]
    amplitude = state.residues * (state.poles**axis.derivative)[:, None, None] / level[:, None]
    shapes, participation = _rank_one(amplitude)
    span = np.linalg.qr(shapes)[0]
    numbers = axis.values(state.poles)
    circle = np.exp(-2j * np.pi * np.arange(len(residual)) / len(residual))
    # what a mode is when its tails are whole and wrap around, instead of 1 / (s - p) on the lines of the band
    whole = axis.step / (1 - numbers * circle[:, None])
    parts = np.einsum("roi,oq->rqi", amplitude, span.conj())
    cleaned = np.einsum("koi,oq->kqi", residual, span.conj()) + np.einsum("kr,rqi->kqi", whole, parts)
    power = np.mean(np.abs(residual) ** 2, axis=1)
    noise, references = power.mean(axis=1), power.mean(axis=0) / max(power.mean(), 1e-300)
    found, spread = hankel.sharpened(
        _responses(cleaned, 0, whole=True), numbers, span.conj().T @ shapes, participation, noise, references
    )
    poles = axis.poles(found)
    places = _nearest(state.poles, poles)
    return poles[places], (spread / np.abs(found) / axis.step)[places]


def _nearest(wanted: Complex[np.ndarray, "mode"], found: Complex[np.ndarray, "mode"]) -> Int[np.ndarray, "mode"]:
    """Which found pole belongs to each wanted one, one to one."""
    from scipy.optimize import linear_sum_assignment

    return np.asarray(linear_sum_assignment(np.abs(wanted[:, None] - found))[1])


def _model(frfs: FrfSet, data: Prepared, axis: _Axis, state: _State, findings: tuple[Finding, ...]) -> ModalModel:
    """The modes as a modal model."""
    order = np.argsort(np.abs(state.poles))
    poles, spread = state.poles[order], np.hypot(state.spread, state.moved)[order]
    shapes, participation = (
        _rank_one(state.residues[order])
        if len(order)
        else (np.zeros((len(data.dofs), 0), complex), np.zeros((len(data.references), 0), complex))
    )
    true = poles + frfs.added_decay
    size = np.abs(true)
    slopes = np.stack(
        [
            np.stack([true.real, true.imag], 1) / (2 * np.pi * size)[:, None],
            np.stack([-(true.imag**2), true.real * true.imag], 1) / (size**3)[:, None],
        ],
        axis=1,
    )
    model = ModalModel(
        poles=true,
        shapes=shapes,
        dofs=data.dofs,
        participation=participation,
        inputs=data.references,
        residuals=Residuals(lower=state.rest[-2], upper=state.rest[-1], poles=state.outside, residues=state.rest[:-2]),
        covariance=np.einsum("mab,mcb->mac", slopes, slopes) * (spread**2)[:, None, None],
        condition=frfs.condition,
        provenance=frfs.provenance,
        findings=findings,
        name=frfs.name,
    )
    model = scale_to_unit_modal_mass(model) if frfs.scaled else model
    return replace(model, findings=(*model.findings, *disagreements(model)))
