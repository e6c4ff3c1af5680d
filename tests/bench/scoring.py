"""How a fit is scored against known truth: found, false, errors, and the Cramer-Rao bound they are measured by."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.linalg.blas import dsyrk

from ema.data import ModalModel
from ema.data.modal import damping_ratios, natural_frequencies
from ema.synthesis import pole_basis
from tests.bench.cases import Case

FREQUENCY_LIMIT = 0.01
MAC_LIMIT = 0.8


@dataclass(frozen=True)
class Bound:
    """Least standard deviations of an unbiased estimator, for each mode of the truth.

    Parameters
    ----------
    frequency_std : Hz, (mode,).
    damping_std : of the damping ratio, (mode,).
    identifiable : whether noise leaves the mode to be found: damping_std < 10 % of the damping ratio and frequency_std
        < 1/5 of the distance to the nearest mode, (mode,).
    """

    frequency_std: np.ndarray
    damping_std: np.ndarray
    identifiable: np.ndarray


def cramer_rao(case: Case, residual_terms: bool = False) -> Bound:
    """Cramer-Rao bound of frequencies and damping ratios.

    The model is the modal form that made the case: for every mode inside and outside the band an unknown pole, an unknown
    participation and unknown complex shape (rank-one residues), nothing else. The noise level is taken as known. The
    shapes are eliminated output by output (Schur complement), so the cost is linear in the outputs.

    Parameters
    ----------
    residual_terms : whether each FRF also has an unknown complex lower and upper residual term, as a fit has.
    """
    model = _everything(case)
    covariance = _covariance(model, residual_terms)
    count = len(case.truth.poles)
    frequency_std, damping_std = np.empty(count), np.empty(count)
    for mode, pole in enumerate(case.truth.poles):
        block = covariance[2 * mode : 2 * mode + 2, 2 * mode : 2 * mode + 2]
        radial = np.array([pole.real, pole.imag]) / abs(pole)
        along = np.array([-1.0, 0.0]) / abs(pole) + pole.real / abs(pole) ** 2 * radial
        frequency_std[mode] = np.sqrt(radial @ block @ radial) / (2 * np.pi)
        damping_std[mode] = np.sqrt(along @ block @ along)
    clear = (damping_std < 0.1 * case.truth.damping_ratios) & (frequency_std < 0.2 * case.spacing)
    return Bound(frequency_std, damping_std, clear)


def residue_bound(case: Case) -> np.ndarray:
    """Root mean square error that the bound allows, over the norm, of the residue matrix of each mode of the truth.

    The same model as ``cramer_rao``; shape (mode,).
    """
    model = _everything(case)
    covariance = _covariance(model)
    count, size = len(case.truth.poles), 2 * len(model.poles)
    variance = np.zeros(count)
    for shape, (local, cross, _) in zip(model.shapes, _blocks(model), strict=True):
        inverse = np.linalg.pinv(local, rcond=1e-14, hermitian=True)
        follows = inverse @ cross
        for mode in range(count):
            rows = slice(2 * mode, 2 * mode + 2)
            for reference, row in enumerate(model.participation):
                slope = -_rotations(row[[mode]]) @ follows[rows]
                own = size * (1 + reference) + 2 * mode
                slope[:, own : own + 2] += _rotations(shape[[mode]])
                variance[mode] += np.abs(row[mode]) ** 2 * np.trace(inverse[rows, rows])
                variance[mode] += np.sum((slope @ covariance) * slope)
    return np.sqrt(variance) / np.linalg.norm(case.truth.residues(), axis=(1, 2))


@dataclass(frozen=True)
class _Model:
    """All modes of a case, participation scaled to 1 at its largest entry ``fixed`` (mode,)."""

    frequencies: np.ndarray
    std: np.ndarray
    poles: np.ndarray
    shapes: np.ndarray
    participation: np.ndarray
    fixed: np.ndarray


def _everything(case: Case) -> _Model:
    poles = np.concatenate([case.truth.poles, case.outside.poles])
    shapes = np.concatenate([case.truth.shapes, case.outside.shapes], axis=1)
    participation = np.concatenate([case.truth.participation, case.outside.participation], axis=1)
    fixed = np.abs(participation).argmax(axis=0)
    largest = participation[fixed, np.arange(len(poles))]
    return _Model(case.frfs.frequencies, case.noise_std, poles, shapes * largest, participation / largest, fixed)


def _covariance(model: _Model, residual_terms: bool = False) -> np.ndarray:
    """Covariance of (Re p, Im p of all modes, then of all participations; zero where these are fixed)."""
    size = 2 * len(model.poles)
    information = sum(
        total - cross.T @ np.linalg.lstsq(local, cross, rcond=1e-14)[0]
        for local, cross, total in _blocks(model, residual_terms)
    )
    free = np.ones(len(information), bool)
    for mode, reference in enumerate(model.fixed):
        free[size * (1 + reference) + 2 * mode : size * (1 + reference) + 2 * mode + 2] = False
    kept = information[np.ix_(free, free)]
    scale = np.sqrt(np.diag(kept))
    inverse = np.linalg.inv(kept / np.outer(scale, scale) + 1e-14 * np.eye(len(scale))) / np.outer(scale, scale)
    covariance = np.zeros_like(information)
    covariance[np.ix_(free, free)] = inverse
    return covariance


def _blocks(model: _Model, residual_terms: bool = False) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Fisher information of each output: of its shapes, between these and the poles and participations, of the latter.

    A change dc of the factor of 1/(s - p) changes an FRF by s^2 (dc / (s - p) + conj), which is linear in the two real
    numbers of dc: everything follows from the Gram matrix of those real columns, for 1/(s - p) and 1/(s - p)^2. Residual
    terms belong to one FRF each: what of the columns lies in their span tells nothing.
    """
    columns = _real_columns(model.frequencies, model.poles)
    terms = _residual_columns(model.frequencies)
    size, references = 2 * len(model.poles), len(model.participation)
    through = [_rotations(row) for row in model.participation]
    for output, shape in enumerate(model.shapes):
        by_shape = _rotations(shape)
        unknowns = size * (1 + references)
        local, cross, total = np.zeros((size, size)), np.zeros((size, unknowns)), np.zeros((unknowns, unknowns))
        for reference in range(references):
            weight = np.sqrt(2) / model.std[:, output, reference]
            weighted = columns * np.concatenate([weight, weight])[:, None]
            gram = dsyrk(1.0, weighted.T)
            gram += np.triu(gram, 1).T
            if residual_terms:
                span = np.linalg.qr(terms * np.concatenate([weight, weight])[:, None])[0]
                within = span.T @ weighted
                gram -= within.T @ within
            by_pole = _rotations(shape * model.participation[reference])
            jacobian = np.zeros((2 * size, unknowns))
            jacobian[size:, :size] = by_pole
            jacobian[:size, size * (1 + reference) : size * (2 + reference)] = by_shape
            local += through[reference].T @ gram[:size, :size] @ through[reference]
            image = gram @ jacobian
            cross += through[reference].T @ image[:size]
            total += jacobian.T @ image
        yield local, cross, total


def _real_columns(frequencies: np.ndarray, poles: np.ndarray) -> np.ndarray:
    """Change of (Re H, Im H) with (Re c, Im c) of c/(s-p), all modes, then of c/(s-p)^2; shape (2 freq, 4 mode)."""
    factor = ((2j * np.pi * frequencies) ** 2)[:, None]
    direct, mirrored = pole_basis(frequencies, poles)
    blocks = []
    for power in (1, 2):
        plus, minus = factor * (direct**power + mirrored**power), 1j * factor * (direct**power - mirrored**power)
        blocks.append(np.stack([plus, minus], axis=2).reshape(len(frequencies), -1))
    together = np.concatenate(blocks, axis=1)
    return np.concatenate([together.real, together.imag])


def _residual_columns(frequencies: np.ndarray) -> np.ndarray:
    """Change of (Re H, Im H) of an accelerance with the real and imaginary parts of its lower and upper residual term."""
    zero, one = np.zeros(len(frequencies)), np.ones(len(frequencies))
    square = (frequencies / frequencies[-1]) ** 2
    parts = [(one, zero), (zero, one), (square, zero), (zero, square)]
    return np.array([np.concatenate(pair) for pair in parts]).T


def _rotations(values: np.ndarray) -> np.ndarray:
    """Block diagonal of the 2 x 2 matrices that multiply (Re, Im) by complex ``values``."""
    result = np.zeros((2 * len(values),) * 2)
    even = 2 * np.arange(len(values))
    result[even, even] = result[even + 1, even + 1] = values.real
    result[even + 1, even], result[even, even + 1] = values.imag, -values.imag
    return result


@dataclass(frozen=True)
class Score:
    """What a fit got right.

    Parameters
    ----------
    match : position in the fit of the mode that found each true mode, -1 where missed, (mode,).
    false : positions in the fit of modes that match nothing.
    identifiable : which true modes count, (mode,).
    frequency_error, damping_error : signed and relative, NaN where missed, (mode,).
    frequency_ratio, damping_ratio : error over the bound's standard deviation, NaN where missed, (mode,).
    residue_error : norm of the error over the norm, of the whole residue matrix; NaN where missed, (mode,).
    """

    match: np.ndarray
    false: tuple[int, ...]
    identifiable: np.ndarray
    frequency_error: np.ndarray
    damping_error: np.ndarray
    frequency_ratio: np.ndarray
    damping_ratio: np.ndarray
    residue_error: np.ndarray

    @property
    def found(self) -> int:
        """Number of true modes found."""
        return int(np.sum(self.match >= 0))

    @property
    def missed(self) -> np.ndarray:
        """Positions of the identifiable modes that were not found."""
        return np.flatnonzero((self.match < 0) & self.identifiable)

    @property
    def recall(self) -> float:
        """Share of the identifiable modes that was found."""
        return float(np.mean(self.match[self.identifiable] >= 0)) if self.identifiable.any() else 1.0

    @property
    def median_damping_error(self) -> float:
        """Median of the absolute relative error of the damping ratio over the modes found; NaN without any."""
        return _median(np.abs(self.damping_error))

    @property
    def median_frequency_error(self) -> float:
        """Median of the absolute relative error of the natural frequency over the modes found; NaN without any."""
        return _median(np.abs(self.frequency_error))


def _median(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("nan")


def mac(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Modal assurance criterion between the columns of two sets of shapes; 0 for a zero shape."""
    cross = np.abs(one.conj().T @ other) ** 2
    norms = np.outer(np.sum(np.abs(one) ** 2, axis=0), np.sum(np.abs(other) ** 2, axis=0))
    return np.divide(cross, norms, out=np.zeros_like(cross), where=norms > 0)


def assign(case: Case, poles: np.ndarray, shapes: np.ndarray) -> tuple[np.ndarray, tuple[int, ...]]:
    """Match a fit to the truth, one to one: ``(match, false)`` as in :class:`Score`.

    A mode is found where |df|/f <= 1 %, the true mode is the nearest of all true modes and the MAC is at least 0.8; of
    several such the nearest counts and the others are false. One that finds a mode outside the band is neither.
    """
    true = np.concatenate([case.truth.poles, case.outside.poles])
    true_shapes = np.concatenate([case.truth.shapes, case.outside.shapes], axis=1)
    frequencies, own = natural_frequencies(true), natural_frequencies(poles)
    match = np.full(len(true), -1)
    order = np.argsort(np.abs(own[:, None] - frequencies[None, :]).min(axis=1)) if len(own) else []
    agreement = mac(true_shapes, shapes)
    for index in order:
        nearest = int(np.argmin(np.abs(frequencies - own[index])))
        close = abs(own[index] - frequencies[nearest]) <= FREQUENCY_LIMIT * frequencies[nearest]
        if close and match[nearest] < 0 and agreement[nearest, index] >= MAC_LIMIT:
            match[nearest] = index
    false = tuple(sorted(set(range(len(own))) - set(match.tolist())))
    return match[: len(case.truth.poles)], false


def score(case: Case, model: ModalModel, bound: Bound) -> Score:
    """Score modes with the truth of ``case``; the DOFs must be those of its outputs and inputs."""
    if model.dofs != case.truth.dofs or model.inputs != case.truth.inputs:
        raise ValueError("the modal model is on other DOFs than the case")
    match, false = assign(case, model.poles, model.shapes)
    hit = match >= 0
    nothing = np.full(len(match), np.nan)
    own_f, own_z = natural_frequencies(model.poles[match[hit]]), damping_ratios(model.poles[match[hit]])
    f, z = case.truth.natural_frequencies, case.truth.damping_ratios
    frequency_error, damping_error, residue_error = nothing.copy(), nothing.copy(), nothing.copy()
    frequency_error[hit] = own_f / f[hit] - 1
    damping_error[hit] = own_z / z[hit] - 1
    true, own = case.truth.residues()[hit], model.residues()[match[hit]]
    residue_error[hit] = np.linalg.norm(own - true, axis=(1, 2)) / np.linalg.norm(true, axis=(1, 2))
    return Score(
        match,
        false,
        bound.identifiable,
        frequency_error,
        damping_error,
        frequency_error * f / bound.frequency_std,
        damping_error * z / bound.damping_std,
        residue_error,
    )


def modes_of_poles(case: Case, poles: np.ndarray) -> ModalModel:
    """A modal model of bare poles: residues by least squares, each cut to rank one.

    Gives the poles of every peer shapes by the same means. The true poles outside the band take part, so that a mode is
    not lost through residual terms: peers are compared by their poles alone.
    """
    poles = np.asarray(poles, complex)
    count, everything = len(poles), np.concatenate([poles, case.outside.poles])
    columns = _real_columns(case.frfs.frequencies, everything)[:, : 2 * len(everything)]
    values = case.frfs.values.reshape(len(case.frfs.frequencies), -1)
    scale = np.linalg.norm(columns, axis=0)
    solution = np.linalg.lstsq(columns / scale, np.vstack([values.real, values.imag]), rcond=None)[0] / scale[:, None]
    residues = (solution[0 : 2 * count : 2] + 1j * solution[1 : 2 * count : 2]).reshape(-1, *case.frfs.values.shape[1:])
    left, strength, right = np.linalg.svd(residues, full_matrices=False)
    return ModalModel(
        poles=poles,
        shapes=(left[:, :, 0] * strength[:, :1]).T,
        dofs=case.truth.dofs,
        participation=right[:, 0, :].T,
        inputs=case.truth.inputs,
    )
