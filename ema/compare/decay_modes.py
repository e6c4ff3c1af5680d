"""Modes of the decay after sticking: what is left of a hammer test whose FRFs are not those of a linear structure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from jaxtyping import Bool, Complex, Float

from ema.data import Candidate, Finding, FrfSet, ModalModel
from ema.dof import Dof, match
from ema.estimate.impact_decays import FreeDecays, ImpactDecays, late_decays

BEGINNINGS = (0.4, 0.2, 0.1, 0.05, 0.025)
"""Responses, relative to that behind the impact, at which the late decay begins, tried one after the other."""
SAME = 0.1
"""Change of a pole from one beginning to the next, over its decay rate, up to which it belongs to a linear decay.

On the work table (1, 5 and 10 kN) poles of the sticking structure move by less than 0.02; those that slip adds to the
late decay at 1 kN vanish when it begins later.
"""
MOST_OF_IT = 0.9
"""Share of the energy of a late decay that modes which stay have, from which on it is that of a linear structure."""
_POWER = {"accelerance": 2, "mobility": 1}


@dataclass(frozen=True)
class Sticking:
    """Decays of a structure whose joints stick: ``decays``, which of their poles stay (``keep``), how far these move
    when the decay begins later (``moved``, rad/s), and the response at their beginning relative to that behind the
    impact.
    """

    decays: ImpactDecays
    keep: Bool[np.ndarray, "mode"]
    moved: Float[np.ndarray, "mode"]
    response: float


def sticking(
    free: FreeDecays, band: tuple[float, float], known: Mapping[float, ImpactDecays] = MappingProxyType({})
) -> Sticking | None:
    """The earliest beginning from which on the decays of a run are linear; ``None`` where there is none.

    ``known`` holds late decays that were fitted before, by the response at their beginning.
    """
    earlier: ImpactDecays | None = None
    for number, beginning in enumerate(BEGINNINGS):
        later = known.get(beginning) or late_decays(free, band, beginning)
        if later is None:
            return None
        if earlier is not None:
            distance = np.min(np.abs(earlier.poles[:, None] - later.poles), axis=1)
            keep = distance < SAME * -earlier.poles.real
            energy = _energy_at_the_beginning(earlier)
            if keep.any() and energy[keep].sum() > MOST_OF_IT * energy.sum():
                return Sticking(earlier, keep, distance, BEGINNINGS[number - 1])
        earlier = later
    return None


def _energy_at_the_beginning(decays: ImpactDecays) -> Float[np.ndarray, "mode"]:
    seen = np.abs(decays.amplitudes) * np.exp(decays.poles.real * decays.begins)[:, None]
    return np.asarray(np.sum(seen**2, axis=(0, 2)) / np.abs(decays.poles) ** 2)


def modes_after_sticking(found: Sticking, frfs: FrfSet, rejected: ModalModel) -> ModalModel:
    """Modes of the linear decay, in place of modes fitted to FRFs that are not those of a linear structure.

    Frequencies and damping ratios are those of small amplitudes, their covariance contains noise and what changes with
    the beginning of the decay. The shapes are amplitudes right behind the impacts over their forces: slip has begun to
    change them by what depends on the point, so that the model is unscaled and has no modal mass. The modes of
    ``rejected`` become candidates, what was found about them is dropped.
    """
    decays, keep = found.decays, found.keep
    poles = decays.poles[keep]
    inputs, residues = _residues(decays, keep, _POWER.get(frfs.quantity, 0))
    dofs, outputs = inputs, decays.outputs
    if len(inputs) < len(outputs):
        dofs, outputs, residues = outputs, dofs, residues.transpose(0, 2, 1)
    dofs, residues = _like(dofs, rejected.dofs, residues)
    left, singular, right = np.linalg.svd(residues, full_matrices=False)
    shapes, participation = left[:, :, 0].T, (singular[:, 0, None] * right[:, 0]).T
    largest = shapes[np.argmax(np.abs(shapes), axis=0), np.arange(len(poles))]
    shapes, participation = shapes / largest, participation * largest
    where = rejected.name or frfs.name or _name_of(decays)
    return ModalModel(
        poles=poles,
        shapes=shapes,
        dofs=dofs,
        participation=participation,
        inputs=outputs,
        scaling="unscaled",
        covariance=_covariance(decays, keep, found.moved),
        condition=rejected.condition,
        provenance=replace(rejected.provenance, steps=(*rejected.provenance.steps, "modes after sticking")),
        findings=(_finding(found, where),),
        name=rejected.name,
        candidates=_candidates(rejected),
    )


def withheld(rejected: ModalModel) -> ModalModel:
    """No modes, where no part of the decays is that of a linear structure either: those of the FRFs are candidates."""
    return ModalModel(
        poles=np.zeros(0, complex),
        shapes=np.zeros((len(rejected.dofs), 0)),
        dofs=rejected.dofs,
        participation=np.zeros((len(rejected.inputs), 0)),
        inputs=rejected.inputs,
        covariance=np.zeros((0, 2, 2)),
        condition=rejected.condition,
        provenance=rejected.provenance,
        name=rejected.name,
        candidates=_candidates(rejected),
    )


def _name_of(decays: ImpactDecays) -> str:
    """How messages call decays without a name."""
    return f"{len(decays.peaks)} impacts"


def _residues(
    decays: ImpactDecays, keep: Bool[np.ndarray, "mode"], power: int
) -> tuple[tuple[Dof, ...], Complex[np.ndarray, "kept point out"]]:
    """Receptance residues by least squares over the impacts on each point."""
    points = tuple(dict.fromkeys(decays.inputs))
    amplitudes, forces = decays.behind[:, keep], decays.forces[:, keep]
    result = np.empty((len(decays.poles[keep]), len(points), len(decays.outputs)), complex)
    for number, point in enumerate(points):
        rows = [row for row, one in enumerate(decays.inputs) if one == point]
        cross = np.einsum("im,imo->mo", forces[rows].conj(), amplitudes[rows])
        result[:, number] = cross / np.sum(np.abs(forces[rows]) ** 2, axis=0)[:, None]
    return points, result / decays.poles[keep][:, None, None] ** power


def _like(
    dofs: Sequence[Dof], wanted: Sequence[Dof], residues: Complex[np.ndarray, "mode dof out"]
) -> tuple[tuple[Dof, ...], Complex[np.ndarray, "mode dof out"]]:
    """Rows in the order and the directions of ``wanted``, where these are the same DOFs."""
    pairs = match(wanted, dofs)
    if len(pairs) != len(dofs) or len(wanted) != len(dofs):
        return tuple(dofs), residues
    rows = np.array([row for _, row, _ in pairs])
    signs = np.array([sign for _, _, sign in pairs])
    return tuple(wanted[place] for place, _, _ in pairs), residues[:, rows] * signs[:, None]


def _covariance(
    decays: ImpactDecays, keep: Bool[np.ndarray, "mode"], moved: Float[np.ndarray, "mode"]
) -> Float[np.ndarray, "kept 2 2"]:
    size = np.abs(decays.poles[keep])
    variance = decays.deviation[keep] ** 2
    change = np.column_stack([moved[keep] / (2 * np.pi), moved[keep] / size]) ** 2
    return np.asarray(np.einsum("mi,ij->mij", variance + change, np.eye(2)))


def _candidates(rejected: ModalModel) -> tuple[Candidate, ...]:
    """The modes that were fitted to the FRFs, and the candidates beside them."""
    std = np.full((len(rejected.poles), 2), np.nan)
    if rejected.covariance is not None:
        std = np.sqrt(np.maximum(np.einsum("mii->mi", rejected.covariance), 0.0))
    own = [
        Candidate(
            natural_frequency=float(frequency),
            damping_ratio=float(damping),
            frequency_std=float(deviation[0]),
            damping_std=float(deviation[1]),
            confidence=0.0,
            reason="it was fitted to FRFs that are not those of a linear structure",
        )
        for frequency, damping, deviation in zip(rejected.natural_frequencies, rejected.damping_ratios, std)
    ]
    return tuple(sorted((*own, *rejected.candidates), key=lambda one: one.natural_frequency))


def _finding(found: Sticking, where: str) -> Finding:
    decays = found.decays
    fitted = ", ".join(f"{frequency:.4g}" for frequency in decays.natural_frequencies[found.keep])
    return Finding.of(
        "info",
        "modes-after-sticking",
        where,
        "The modes ({frequencies} Hz) are those of the decay from {begin} ms behind the impact on, "
        "where the response has fallen to {share} of that right behind it: from there it is that of "
        "a linear structure. Modal masses and FRF residues are withheld, and shapes are not compared: what slip "
        "takes of their amplitudes differs from point to point. Poles fitted to the FRFs are candidates.",
        decays.begins,
        advice="They hold for small amplitudes, with sticking joints.",
        frequencies=fitted,
        begin=f"{1000.0 * decays.begins:.0f}",
        share=f"{found.response:.3g}",
    )
