"""Trial poles: what one more mode would explain of the residual of a fit, everything else adapted."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from ema.data import damping_ratios
from ema.fit import estimator, model
from ema.fit.candidates import inside
from ema.fit.estimator import Fit, Observations
from ema.fit.policy import POLICY

DAMPING = np.array([0.001, 0.005, 0.02, 0.06])
"""Damping ratios of trial poles over the band."""
_ADAPT = 6
"""Modes whose poles and participation adapt to a trial pole: those whose peaks overlap most with it. With 3 and with 12
the modes of 14 random systems stay the same."""
_RIDGE = 1e-9
"""Part of the information of a residue that is added to what is left of it when everything else adapts: what rounding
leaves there, as in `estimator.ROUNDING`. At half and at twice the value no mode of 14 random systems moves."""
_ROW_VALUES = 4_000_000
"""Values of normal equations that are worked on at a time."""


@dataclass(frozen=True)
class TrialEquations:
    """Normal equations of a free residue matrix at each of some trial poles, the linear unknowns of a fit eliminated.

    Its rows are the real parts for each reference, then the imaginary parts: ``schur`` is their information,
    ``remaining`` what the residual says of them, and ``coupling`` their products with the functions of the shared
    unknowns. The first axis are the rows of the observations.
    """

    schur: Float[np.ndarray, "row trial a a"]
    remaining: Float[np.ndarray, "row trial a member"]
    coupling: Float[np.ndarray, "row trial a unknown"]

    def of_rank_one(self, vectors: Complex[np.ndarray, "trial in"]) -> "TrialEquations":
        """Those of the real and the imaginary part of a shape, at given participation."""
        references = vectors.shape[1]
        turn = np.zeros((len(vectors), 2 * references, 2))
        turn[:, :references, 0] = turn[:, references:, 1] = vectors.real
        turn[:, references:, 0], turn[:, :references, 1] = vectors.imag, -vectors.imag
        through = turn.transpose(0, 2, 1)
        return TrialEquations(through @ self.schur @ turn, through @ self.remaining, through @ self.coupling)


def equations(
    data: Observations, fit: Fit, trials: Complex[np.ndarray, "trial"], rows: slice = slice(None)
) -> TrialEquations:
    """Normal equations of further residues for some rows of the observations."""
    references, modes, count = data.references, len(fit.poles), len(trials)
    weights, every = data.weights[rows], np.concatenate([fit.poles, fit.terms.poles])
    trial = model.functions(data.s, trials[:0], trials)
    of_trials = model.sums_over_lines(trial, weights)[..., :count]
    found = data.recent.functions(data.s, fit.poles, fit.terms.poles)
    sums = model.sums_over_lines(found, weights)
    mixing, width = fit.terms.mixing, fit.lean.shape[-1] // 2
    h = model.projections(trial, weights[:, None] * estimator.residual(data, fit, rows))[..., :count]
    remaining = np.concatenate([h.real, h.imag], axis=2).transpose(0, 3, 2, 1)
    block, overlap, coupling = (
        np.zeros((len(weights), count, 2 * references, 2 * n)) for n in (references, modes, width - modes)
    )
    of_shapes = np.concatenate([np.arange(modes), width + np.arange(modes)])
    of_unknowns = np.concatenate([np.arange(modes, width), np.arange(width + modes, 2 * width)])
    for i, entries in enumerate(fit.participation):
        place = np.array([i, references + i])
        products = model.trial_products(trials, of_trials[:, i], every, modes, sums[:, i])
        (p, q), (p_squares, q_squares) = products.first, products.squares
        block[:, :, place[:, None], place] = model.real_form(*(form[..., None, None] for form in products.own))
        with_shapes = model.real_form(p[..., None, :modes] * entries, q[..., None, :modes] * entries)
        with_terms = model.real_form(p[..., None, modes:], q[..., None, modes:]) @ mixing
        with_shared = model.real_form(
            _of_shared(p_squares * entries, p[..., :modes], i, fit)[..., None, :],
            _of_shared(q_squares * entries, q[..., :modes], i, fit)[..., None, :],
        )
        lean, own = fit.lean[rows, i][:, None], fit.of_rest[rows, i][:, None]
        block[:, :, place[:, None], place] -= with_terms @ own @ np.swapaxes(with_terms, -1, -2)
        overlap[:, :, place] = with_shapes - with_terms @ lean[..., of_shapes]
        coupling[:, :, place] = with_shared - with_terms @ lean[..., of_unknowns]
    schur = block - overlap @ fit.local[rows][:, None] @ np.swapaxes(overlap, -1, -2)
    ridge = _RIDGE * np.einsum("rtaa->rta", block)
    return TrialEquations(
        schur=schur + ridge[..., None] * np.eye(2 * references),
        remaining=remaining,
        coupling=coupling - overlap @ fit.slope[rows][:, None],
    )


def _of_shared(
    of_poles: Complex[np.ndarray, "row trial mode"],
    of_shapes: Complex[np.ndarray, "row trial mode"],
    reference: int,
    fit: Fit,
) -> Complex[np.ndarray, "row trial unknown"]:
    """Products with the functions of poles and of the free entries of the participation, in one reference."""
    of_entries = np.zeros((*of_shapes.shape[:2], *fit.participation.shape), complex)
    of_entries[:, :, reference] = of_shapes
    flat = of_entries.reshape(*of_shapes.shape[:2], -1)[..., fit.free]
    return np.concatenate([of_poles, flat], axis=-1)


def residue_gains(
    data: Observations, fit: Fit, trials: Complex[np.ndarray, "trial"]
) -> tuple[Float[np.ndarray, "trial"], Complex[np.ndarray, "trial in"]]:
    """Cost that each trial pole alone, with a free residue matrix, would take off with the poles of the fit where they
    are; and its leading participation. For observations of one row.
    """
    found = equations(data, fit, trials)
    solution = np.linalg.solve(found.schur[0], found.remaining[0])
    return np.einsum("tio,tio->t", found.remaining[0], solution), _leading(solution)


def mode_gains(
    data: Observations, fit: Fit, trials: Complex[np.ndarray, "trial"]
) -> tuple[Float[np.ndarray, "trial"], Complex[np.ndarray, "trial in"]]:
    """Cost that a mode at each trial pole would take off, the poles and participation of those next to it adapted; and
    its participation. For observations of one row.
    """
    found = equations(data, fit, trials)
    schur, remaining = found.schur[0], found.remaining[0]
    vectors = _leading(np.linalg.solve(schur, remaining))
    if data.references > 1:
        own = found.of_rank_one(vectors)
        shape = np.linalg.solve(own.schur[0], own.remaining[0])
        vectors = _participation(schur, remaining, shape)
    return _score([found.of_rank_one(vectors)], [slice(None)], fit, trials), vectors


def gains_at(
    data: Observations, fit: Fit, trials: Complex[np.ndarray, "trial"], vectors: Complex[np.ndarray, "trial in"]
) -> Float[np.ndarray, "trial"]:
    """The same at given participation, for observations of any rows."""
    size = len(trials) * 2 * data.references * (len(fit.gradient) + 4 * len(fit.poles))
    blocks = data.row_blocks(size, _ROW_VALUES)
    return _score([equations(data, fit, trials, rows).of_rank_one(vectors) for rows in blocks], blocks, fit, trials)


def _score(
    found: list[TrialEquations], blocks: list[slice], fit: Fit, trials: Complex[np.ndarray, "trial"]
) -> Float[np.ndarray, "trial"]:
    """Gain of a further mode of given participation when shapes, residual terms, and the poles and participation of the
    modes next to it adapt.

    With the score r and the information D of the further shape, I that of the shared unknowns and B their products, the
    joint Gauss-Newton step gains ``r' D^-1 r + c' (I - B' D^-1 B)^-1 c`` with ``c = B' D^-1 r``: the score test (Rao
    1948) with all of these unknown. At an optimum their own score is zero. Without the second part a mode that its
    neighbours have moved to describe goes unseen, and these stay where they should not be.
    """
    half, modes = len(fit.owners), len(fit.poles)
    gain = np.zeros(len(trials))
    if not modes:
        for one in found:
            gain += np.einsum("rtao,rtao->t", one.remaining, np.linalg.solve(one.schur, one.remaining))
        return gain
    distance = np.abs(trials[:, None] - fit.poles) / (np.abs(trials.real)[:, None] + np.abs(fit.poles.real))
    adapts = np.argsort(distance, axis=1, kind="stable")[:, :_ADAPT]
    # Each mode has its pole and as many free entries as every other one.
    of_mode = np.argsort(fit.owners, kind="stable").reshape(modes, -1)
    chosen = of_mode[adapts].reshape(len(trials), -1)
    both = np.concatenate([chosen, half + chosen], axis=1)
    width = chosen.shape[1]
    pull = np.zeros(chosen.shape, complex)
    p, q = (np.zeros((*chosen.shape, width), complex) for _ in range(2))
    for one, rows in zip(found, blocks, strict=True):
        shape = np.linalg.solve(one.schur, one.remaining)
        gain += np.einsum("rtao,rtao->t", one.remaining, shape)
        along = np.take_along_axis(one.coupling, both[None, :, None, :], axis=-1)
        solved = np.linalg.solve(one.schur, along)
        psi = fit.shapes[rows][..., fit.owners][..., chosen]
        moved = np.swapaxes(along, -1, -2) @ shape
        pull += np.einsum("rmtu,rtum->tu", psi.conj(), moved[:, :, :width] + 1j * moved[:, :, width:])
        own_p, own_q = model.complex_form(np.swapaxes(along, -1, -2) @ solved)
        p += np.einsum("rtuw,rmtu,rmtw->tuw", own_p, psi.conj(), psi, optimize=True)
        q += np.einsum("rtuw,rmtu,rmtw->tuw", own_q, psi, psi, optimize=True)
    scale = fit.scale[both]
    left = fit.information[both[:, :, None], both[:, None, :]] - model.real_form(p, q)
    left *= scale[:, :, None] * scale[:, None, :]
    ends = np.arange(both.shape[1])
    left[:, ends, ends] += estimator.PRIOR + fit.rounding * fit.before[both] * scale**2
    turned = scale * np.concatenate([pull.real, pull.imag], axis=1)
    return np.asarray(gain + np.einsum("tu,tu->t", turned, np.linalg.solve(left, turned[..., None])[..., 0]))


def _leading(solution: Float[np.ndarray, "trial a out"]) -> Complex[np.ndarray, "trial in"]:
    """Leading participation of residue matrices."""
    half = solution.shape[1] // 2
    residue = solution[:, :half] + 1j * solution[:, half:]
    return np.asarray(np.linalg.eigh(residue @ residue.conj().transpose(0, 2, 1))[1][:, :, -1])


def _participation(
    schur: Float[np.ndarray, "trial row row"],
    remaining: Float[np.ndarray, "trial row out"],
    shape: Float[np.ndarray, "trial 2 out"],
) -> Complex[np.ndarray, "trial in"]:
    """Best participation ``a + jb`` at given shapes ``x + jy``: rows are the real, then the imaginary parts."""
    x, y = shape[:, 0], shape[:, 1]
    half = schur.shape[1] // 2
    (rr, ri), (ir, ii) = (
        (schur[:, :half, :half], schur[:, :half, half:]),
        (schur[:, half:, :half], schur[:, half:, half:]),
    )
    xx, xy, yy = (np.einsum("to,to->t", a, b)[:, None, None] for a, b in ((x, x), (x, y), (y, y)))
    # Rows of the residue: real part a x - b y, imaginary part a y + b x.
    aa = xx * rr + xy * (ri + ir) + yy * ii
    ab = -xy * rr + xx * ri - yy * ir + xy * ii
    bb = yy * rr - xy * (ri + ir) + xx * ii
    matrix = np.concatenate(
        [np.concatenate([aa, ab], axis=2), np.concatenate([ab.transpose(0, 2, 1), bb], axis=2)], axis=1
    )
    real, imaginary = remaining[:, :half], remaining[:, half:]
    right = np.concatenate(
        [
            np.einsum("tio,to->ti", real, x) + np.einsum("tio,to->ti", imaginary, y),
            np.einsum("tio,to->ti", imaginary, x) - np.einsum("tio,to->ti", real, y),
        ],
        axis=1,
    )
    ridge = 1e-12 * np.einsum("tii->t", matrix)[:, None, None] * np.eye(2 * half)
    solved = np.linalg.solve(matrix + ridge, right[:, :, None])[:, :, 0]
    vectors = solved[:, :half] + 1j * solved[:, half:]
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300))


def apart(
    trials: Complex[np.ndarray, "trial"], merit: Float[np.ndarray, "trial"], most: int, reach: float = 4.0
) -> list[int]:
    """The best trials with a merit above 1 that are ``reach`` times the sum of their decay rates apart."""
    chosen: list[int] = []
    for k in np.argsort(-merit):
        if merit[k] <= 1 or len(chosen) == most:
            break
        sums = np.abs(trials[chosen].real) + abs(trials[k].real)
        if np.all(np.abs(trials[chosen] - trials[k]) > reach * sums):
            chosen.append(int(k))
    return chosen


def peaks(data: Observations, power: Float[np.ndarray, "bin"]) -> Float[np.ndarray, "peak"]:
    """Frequencies (Hz) of the sixteen largest maxima of the residual energy."""
    power = np.convolve(power, np.ones(3), mode="same")
    inner = power[1:-1]
    maxima = 1 + np.flatnonzero((inner >= power[:-2]) & (inner > power[2:]))
    return data.s.imag[maxima[np.argsort(-power[maxima])][:16]] / (2 * np.pi)


def over_band(band: tuple[float, float], at: Float[np.ndarray, "peak"] | None = None) -> Complex[np.ndarray, "trial"]:
    """Trial poles: 32 places over the band and the given ones, each with four damping ratios."""
    step = (band[1] - band[0]) / 32
    places = np.linspace(band[0] + 0.5 * step, band[1] - 0.5 * step, 32)
    places = places if at is None else np.concatenate([places, at])
    return (2 * np.pi * places[:, None] * (-DAMPING + 1j)[None, :]).reshape(-1)


def around(fit: Fit, band: tuple[float, float]) -> Complex[np.ndarray, "trial"]:
    """Trial poles around every mode, in units of its decay rate: narrower and wider, lower and higher."""
    own = fit.poles[inside(fit.poles, band) & (damping_ratios(fit.poles) <= POLICY.heaviest)]
    offsets = [width + place * 1j for place in (-1.5, -0.5, 0.5, 1.5) for width in (0.3, 1.0, 2.5)]
    trials = np.concatenate([1j * own.imag + own.real * (o.real + 1j * o.imag) for o in offsets])
    return trials[inside(trials, band) & (damping_ratios(trials) <= POLICY.heaviest)]


def beside(fit: Fit, band: tuple[float, float]) -> Complex[np.ndarray, "trial"]:
    """Trial poles on both sides of every mode: the second of a pair that one pole has been fitted to."""
    own = fit.poles[inside(fit.poles, band) & (damping_ratios(fit.poles) <= POLICY.heaviest)]
    return np.concatenate([own + 0.4j * own.real, own - 0.4j * own.real])
