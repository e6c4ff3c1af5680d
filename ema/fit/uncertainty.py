"""Uncertainty of a modal model by linearisation at the optimum of the fit.

Errors are followed from their causes: the shared unknowns (poles, participation) err together, each output adds errors
of its own. An error is held as a factor: one complex number for each of a set of independent causes of unit variance.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Complex, Float, Int

from ema.data import ModalModel, ModalUncertainty
from ema.dof import match
from ema.errors import InputError
from ema.fit import estimator
from ema.fit.estimator import Fit
from ema.fit.refinement import Refined


@dataclass(frozen=True)
class _Errors:
    """Factors of one mode: pole (cause,), participation (in, cause), shape by the shared causes (out, cause) and by
    those of each output alone (out, 2).
    """

    pole: Complex[np.ndarray, "cause"]
    participation: Complex[np.ndarray, "in cause"]
    shape: Complex[np.ndarray, "out cause"]
    own: Complex[np.ndarray, "out 2"]


@dataclass(frozen=True)
class PoleErrors:
    """Uncertainty of every pole of an optimum: errors of the poles by independent causes of unit variance (pole, cause)
    in rad/s, standard deviations of natural frequency [Hz] and damping ratio, and variance of each shape over its
    energy without what only rescales or turns it, each output in units of its noise.

    ``beyond`` are variances of natural frequency [Hz^2] and damping ratio that no noise makes: `stated` has them.
    """

    poles: Complex[np.ndarray, "pole cause"]
    frequency: Float[np.ndarray, "pole"]
    damping: Float[np.ndarray, "pole"]
    scatter: Float[np.ndarray, "pole"]
    root: Float[np.ndarray, "unknown cause"]
    modes: tuple[_Errors, ...]
    beyond: Float[np.ndarray, "pole 2"]

    @property
    def stated(self) -> "PoleErrors":
        """The errors with all that widens the intervals of frequency and damping."""
        frequency, damping = np.sqrt(np.stack([self.frequency, self.damping]) ** 2 + self.beyond.T)
        return replace(self, frequency=frequency, damping=damping, beyond=np.zeros_like(self.beyond))


def errors_of(optimum: Refined) -> PoleErrors:
    """Errors of all poles of an optimum."""
    fit = optimum.fit
    root = estimator.root(fit, optimum.inflation)
    modes = len(fit.poles)
    each = tuple(_errors(optimum, root, mode) for mode in range(modes))
    scatter = np.array([_scatter(fit.shapes[:, 0, mode], each[mode]) for mode in range(modes)])
    return _of_poles(fit, each, scatter.reshape(modes), root, np.zeros((modes, 2)))


def _of_poles(
    fit: Fit,
    each: tuple[_Errors, ...],
    scatter: Float[np.ndarray, "pole"],
    root: Float[np.ndarray, "unknown cause"],
    beyond: Float[np.ndarray, "pole 2"],
) -> PoleErrors:
    poles = np.array([mode.pole for mode in each], complex).reshape(len(each), root.shape[1])
    size = np.abs(fit.poles)[:, None]
    along = (fit.poles.conj()[:, None] * poles).real / size
    damping = -poles.real / size + fit.poles.real[:, None] * along / size**2
    return PoleErrors(
        poles=poles,
        frequency=np.linalg.norm(along, axis=1) / (2 * np.pi),
        damping=np.linalg.norm(damping, axis=1),
        scatter=scatter,
        root=root,
        modes=each,
        beyond=beyond,
    )


Gains = tuple[tuple[np.ndarray, np.ndarray], ...]
"""Poles (some,) of a group, and a linear map (2 some, 2 some) of the errors of these and of their relative sizes."""


def amplified(found: PoleErrors, fit: Fit, gains: Gains) -> PoleErrors:
    """Errors of resonances that go through linear maps: the ``gains`` act on the errors of the poles of a group, and
    behind them on their relative errors of size.

    Errors of size that each output makes by itself become two further causes for each resonance, of the variance that
    they have together, beside what they are in the shapes.
    """
    if not gains:
        return found
    modes = len(fit.poles)
    pole = np.zeros((modes, found.root.shape[1] + 2 * modes), complex)
    size = np.zeros_like(pole)
    for number, errors in enumerate(found.modes):
        # Errors of poles alone have no outputs.
        psi = fit.shapes[: len(errors.own), 0, number]
        psi = np.where(psi == 0, np.finfo(float).tiny, psi)
        own = np.sum(np.abs(errors.own / psi[:, None]) ** 2, axis=1)
        weight = 1 / np.maximum(own, np.finfo(float).tiny)
        weight /= max(weight.sum(), np.finfo(float).tiny)
        pole[number, : found.root.shape[1]] = errors.pole
        size[number, : found.root.shape[1]] = weight @ (errors.shape / psi[:, None])
        alone = np.sqrt(np.sum(weight**2 * own) / 2)
        size[number, found.root.shape[1] + 2 * number :][:2] = alone, 1j * alone
    new_pole, more = pole.copy(), np.zeros_like(size)
    for group, gain in gains:
        some = len(group)
        both = np.concatenate([pole[group], size[group]])
        moved = gain @ both
        new_pole[group] = moved[:some]
        more[group] = moved[some:] - size[group]
        # An error that is in the shapes already and one that is added to it count as independent.
        for row, number in enumerate(group):
            of_own = slice(found.root.shape[1] + 2 * number, found.root.shape[1] + 2 * number + 2)
            larger = np.sqrt(max(abs(gain[some + row, some + row]) ** 2 - 1, 0.0))
            more[number, of_own] = larger * size[number, of_own]
    each = tuple(
        _Errors(
            pole=new_pole[number],
            participation=np.pad(errors.participation, ((0, 0), (0, 2 * modes)))
            + fit.participation[:, number, None] * more[number],
            shape=np.pad(errors.shape, ((0, 0), (0, 2 * modes))),
            own=errors.own,
        )
        for number, errors in enumerate(found.modes)
    )
    return _of_poles(fit, each, found.scatter, np.pad(found.root, ((0, 0), (0, 2 * modes))), found.beyond)


def _scatter(psi: Complex[np.ndarray, "out"], errors: _Errors) -> float:
    """Variance of a shape over its energy, without what only rescales or turns it, each output in units of its noise.

    The MAC of the shape with the true one is expected near ``1 / (1 + scatter)``. Where all outputs are as noisy, it is
    that of the shape itself; an output that is noise alone adds its own share, whatever its unit or its size.
    """
    power = np.sum(np.abs(errors.own) ** 2, axis=1)
    rounding = np.finfo(float).eps ** 2 * np.max(power, initial=0.0)
    noise = np.sqrt(np.maximum(power, max(rounding, np.finfo(float).tiny)))
    psi, by_causes, by_itself = psi / noise, errors.shape / noise[:, None], errors.own / noise[:, None]
    energy = max(float(np.vdot(psi, psi).real), 1e-300)
    # The component along the shape itself rescales and turns it.
    shared = np.sum(np.abs(by_causes) ** 2) - np.sum(np.abs(psi.conj() @ by_causes) ** 2) / energy
    own = np.sum(np.abs(by_itself) ** 2) - np.sum(np.abs(psi.conj()[:, None] * by_itself) ** 2) / energy
    return float(max(shared, 0.0) + own) / energy


def attach(model: ModalModel, optimum: Refined, found: PoleErrors, order: Int[np.ndarray, "mode"]) -> ModalModel:
    """The model with its uncertainty; its modes are those of the optimum in the given order, scaled in whatever way."""
    fit = optimum.fit
    if not len(order):
        return replace(model, covariance=np.zeros((0, 2, 2)))
    root = found.root
    modes = [_Mode(model, place, fit, found.modes[mode], int(mode)) for place, mode in enumerate(order)]
    values = np.concatenate([mode.values() for mode in modes])
    covariance = values @ values.T
    statement = ModalUncertainty(
        values=covariance,
        shapes=np.array([mode.shapes() for mode in modes]),
        common=np.array([mode.common(root, 2 * len(model.inputs)) for mode in modes]),
        participation=np.array([mode.participation() for mode in modes]),
        residues=np.array([mode.residues() for mode in modes]),
        modal_mass=np.array([mode.modal_mass() for mode in modes]),
        basis=optimum.basis,
    )
    own = np.arange(len(modes))
    blocks = covariance.reshape(len(modes), 2, len(modes), 2)[own, :, own]
    return replace(model, covariance=blocks, uncertainty=statement)


def widened(model: ModalModel, variances: Float[np.ndarray, "mode 2"], why: str) -> ModalModel:
    """The model with variances of natural frequency [Hz^2] and damping ratio added to those of each mode."""
    if model.covariance is None or not np.any(variances):
        return model
    covariance = np.array(model.covariance)
    covariance[:, [0, 1], [0, 1]] += variances
    stated = model.uncertainty
    if stated is not None:
        values = stated.values + np.diag(variances.reshape(-1))
        stated = replace(stated, values=values, basis=f"{stated.basis}; with {why}")
    return replace(model, covariance=covariance, uncertainty=stated)


def _errors(optimum: Refined, root: Float[np.ndarray, "unknown cause"], mode: int) -> _Errors:
    """Errors of one mode of the optimum."""
    fit = optimum.fit
    modes, half, references = len(fit.poles), len(root) // 2, len(fit.participation)
    by_cause = root[:half] + 1j * root[half:]
    participation = np.zeros((references, root.shape[1]), complex)
    for place, entry in enumerate(fit.free):
        if entry % modes == mode:
            participation[entry // modes] = by_cause[modes + place]
    # What stands still since rounding alone tells of it (`estimator.ROUNDING`) moves no shape either: the prior that
    # keeps its own error finite is none of theirs.
    moving = np.where(np.diag(fit.information)[:, None] > 0, root, 0)
    change = estimator.changes_of_shape(fit, mode)[:, 0] @ moving
    rows = np.array([mode, modes + mode])
    block = optimum.inflation_of_shapes[mode] * fit.local[:, rows[:, None], rows]
    floor = np.finfo(float).tiny
    # Cholesky factor of the 2 x 2 blocks, written out.
    a = np.sqrt(np.maximum(block[:, 0, 0], floor))
    b = block[:, 1, 0] / a
    c = np.sqrt(np.maximum(block[:, 1, 1] - b**2, 0))
    own = np.stack([a + 1j * b, 1j * c], axis=1)
    return _Errors(by_cause[mode], participation, change[:, 0] + 1j * change[:, 1], own)


def _squares(factor: Complex[np.ndarray, "*shape cause"]) -> Float[np.ndarray, "*shape 2 2"]:
    """Variances of real and imaginary part."""
    x, y = factor.real, factor.imag
    cross = np.sum(x * y, axis=-1)
    rows = np.stack([np.sum(x * x, axis=-1), cross, cross, np.sum(y * y, axis=-1)], axis=-1)
    return rows.reshape(*rows.shape[:-1], 2, 2)


class _Mode:
    """What follows for one mode of the model."""

    def __init__(self, model: ModalModel, place: int, fit: Fit, errors: _Errors, mode: int) -> None:
        self.pole, self.mode, self.owners = fit.poles[mode], mode, np.tile(fit.owners, 2)
        self.psi, self.entries = fit.shapes[:, 0, mode], fit.participation[:, mode]
        self.errors, self.scaled = errors, model.scaling == "unit modal mass"
        self.final = model.shapes[:, place]
        self.largest = int(np.argmax(np.abs(self.psi)))
        # The scale of the shape is a function of these outputs: drive points, or the largest component.
        drive = match(model.inputs, model.dofs) if self.scaled else []
        self.drive = [np.array(column) for column in zip(*drive, strict=True)] if drive else []
        self.anchors = self.drive[1] if drive else np.array([self.largest])
        turn, turn_own = self._scale_errors()
        scale = self.final[self.largest] / (self.psi[self.largest] or 1.0)
        self.scale, self.turn = scale, np.concatenate([turn, turn_own.reshape(-1)])
        direct = np.zeros((len(self.psi), turn_own.size), complex)
        rest = errors.own.copy()
        for position, row in enumerate(self.anchors):
            direct[row, 2 * position : 2 * position + 2] = rest[row]
            rest[row] = 0
        shape = np.concatenate([errors.shape, direct], axis=1) + self.psi[:, None] * self.turn
        self.shape, self.rest = scale * shape, scale * rest

    def _scale_errors(self) -> tuple[np.ndarray, np.ndarray]:
        """Relative error of the factor between the shape of the model and that of the state: by the shared causes, and
        by those of each anchor (anchor, 2).
        """
        errors, rows = self.errors, self.anchors
        if not self.drive:
            largest = self.psi[self.largest] or 1.0
            return -errors.shape[self.largest] / largest, -errors.own[rows] / largest
        references, _, signs = self.drive
        omega = self.pole.imag
        s, t = signs * self.psi[rows], 2j * omega * self.entries[references]
        energy = float(np.sum(np.abs(s) ** 2)) or 1.0
        square = np.sum(s.conj() * t) / energy or 1.0
        ds, ds_own = signs[:, None] * errors.shape[rows], signs[:, None] * errors.own[rows]
        dt = 2j * (self.entries[references, None] * errors.pole.imag + omega * errors.participation[references])
        turn = np.sum(ds.conj() * t[:, None] + s.conj()[:, None] * dt, axis=0)
        turn -= 2 * square * np.sum((s.conj()[:, None] * ds).real, axis=0)
        own = ds_own.conj() * t[:, None] - 2 * square * (s.conj()[:, None] * ds_own).real
        return turn / (2 * square * energy), own / (2 * square * energy)

    def values(self) -> Float[np.ndarray, "2 cause"]:
        """Errors of natural frequency (Hz) and damping ratio by the shared causes."""
        size, change = abs(self.pole), self.errors.pole
        along = (self.pole.conjugate() * change).real / size
        return np.stack([along / (2 * np.pi), -change.real / size + self.pole.real * along / size**2])

    def shapes(self) -> Float[np.ndarray, "dof 2 2"]:
        return np.asarray(_squares(self.shape) + _squares(self.rest))

    def participation(self) -> Float[np.ndarray, "in 2 2"]:
        change = np.zeros((len(self.entries), len(self.turn)), complex)
        change[:, : self.errors.participation.shape[1]] = self.errors.participation
        return _squares(1 / (self.scale or 1.0) * (change - self.entries[:, None] * self.turn))

    def residues(self) -> Float[np.ndarray, "dof in 2 2"]:
        """Residues do not depend on the scale of the shapes."""
        errors = self.errors
        blocks = []
        for entry, change in zip(self.entries, errors.participation, strict=True):
            shared = entry * errors.shape + self.psi[:, None] * change
            blocks.append(_squares(shared) + _squares(entry * errors.own))
        return np.stack(blocks, axis=1)

    def modal_mass(self) -> float:
        """Relative standard uncertainty of ``1 / (largest component)^2``."""
        if not self.scaled or not self.final[self.largest]:
            return float("nan")
        relative = np.concatenate([self.shape[self.largest], self.rest[self.largest]]) / self.final[self.largest]
        return float(2 * np.linalg.norm(relative.real))

    def common(self, root: Float[np.ndarray, "unknown cause"], count: int) -> Complex[np.ndarray, "dof common"]:
        """Errors of the shape that go with those of its own pole and participation, and with those of the anchors."""
        own = root[self.owners == self.mode]
        _, strength, right = np.linalg.svd(own, full_matrices=False)
        kept = right[strength > 1e-12 * strength.max(initial=0)][:count]
        by_own = np.zeros((len(self.psi), count), complex)
        by_own[:, : len(kept)] = self.shape[:, : root.shape[1]] @ kept.T
        return np.concatenate([by_own, self.shape[:, root.shape[1] :]], axis=1)


def real(found: ModalUncertainty, turn: Complex[np.ndarray, "mode"]) -> ModalUncertainty:
    """Uncertainty of shapes that were turned by a factor of modulus 1 each and have lost their imaginary part."""
    c, s = turn.real, turn.imag
    rotation = np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1)
    shapes = np.einsum("mab,mdbc,mec->mdae", rotation, found.shapes, rotation)
    kept = np.zeros_like(shapes)
    kept[..., 0, 0] = shapes[..., 0, 0]
    return replace(
        found,
        shapes=kept,
        common=(found.common * turn[:, None, None]).real.astype(complex),
        participation=np.einsum("mba,mdbc,mce->mdae", rotation, found.participation, rotation),
    )


def residue_std(model: ModalModel) -> Complex[np.ndarray, "mode dof in"]:
    """Standard uncertainties of the residues: of the real parts, and of the imaginary parts as imaginary part.

    Raises
    ------
    InputError : the model has no uncertainty.
    """
    found = _known(model).residues
    return np.asarray(np.sqrt(found[..., 0, 0]) + 1j * np.sqrt(found[..., 1, 1]))


def shape_std(model: ModalModel) -> Complex[np.ndarray, "dof mode"]:
    """Standard uncertainties of the shapes: of the real parts, and of the imaginary parts as imaginary part.

    Raises
    ------
    InputError : the model has no uncertainty.
    """
    found = _known(model).shapes
    return np.asarray((np.sqrt(found[..., 0, 0]) + 1j * np.sqrt(found[..., 1, 1])).T)


def _known(model: ModalModel) -> ModalUncertainty:
    if model.uncertainty is None:
        raise InputError(
            "the modal model states no uncertainty",
            where=model.name,
            expected="a model of ema.fit.modes",
            advice="fit it again from its FRFs",
        )
    return model.uncertainty
