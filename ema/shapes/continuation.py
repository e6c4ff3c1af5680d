"""Modes above the measured ones, as those of the plate that the measured modes imply."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ema.data import Finding, ModalModel, poles_from
from ema.errors import InputError
from ema.shapes.rigid import extended_covariance
from ema.shapes.surface import Surface, products

_AGREES = 0.15
"""Relative error of the plate's natural frequencies up to which it is believed."""
_FEWEST = 4
"""Measured elastic modes, at least: there are four bending stiffnesses."""


class Plate(NamedTuple):
    """An orthotropic plate over the measured rectangle: kg/m^2; bending stiffnesses along, across, coupled, of twist in
    N m; its natural frequencies in Hz (rigid-body motion first) and mass-normalised coefficients (term, mode)."""

    mass: float
    stiffness: Float[np.ndarray, "4"]
    frequencies: Float[np.ndarray, "mode"]
    coefficients: Float[np.ndarray, "term mode"]
    powers: Int[np.ndarray, "term 2"]


def with_plate(
    model: ModalModel, surface: Surface, degree: int = 14
) -> tuple[ModalModel, Surface, tuple[Finding, ...]]:
    """Continue the measured modes of a free plate-like structure by those of the plate that they imply.

    What is mounted on a structure also feels how the structure yields around the joints. That lives in modes above the
    measured band; leaving them out makes the structure too stiff there. Mass per area and the four bending stiffnesses
    of an orthotropic plate follow from the measured shapes, their curvatures and frequencies by least squares
    (Rayleigh's quotient of a Kirchhoff plate is linear in its stiffnesses); its modes above the measured ones are
    appended, with shapes on the surface alone (zero at the measured DOFs). Where such a plate does not have the
    measured frequencies within 15 %, nothing is appended and a finding says so.

    Parameters
    ----------
    model : ModalModel
        Modes, rigid-body ones included.
    surface : Surface
        Their smooth shapes, by :func:`smooth`.
    degree : int, default 14
        Total degree of the polynomials over a square, whose shortest half wave is about the side over two thirds of it;
        over a rectangle as short in both directions.

    Returns
    -------
    tuple of (ModalModel, Surface, tuple of Finding)
        Model and surface with the modes of the plate appended, or as they were; and what was done.

    Raises
    ------
    InputError
        If the surface has another number of modes.

    References
    ----------
    .. [1] Residual flexibility as modes above the band: Craig and Kurdila (2006), Fundamentals of Structural Dynamics,
       chapter 17.

    Examples
    --------
    >>> from ema.data import Geometry, ModalModel, poles_from
    >>> from ema.dof import Dof
    >>> from ema.shapes import smooth
    >>> x, y = (part.ravel() for part in np.meshgrid(np.linspace(0, 0.6, 7), np.linspace(0, 0.4, 5), indexing="ij"))
    >>> shapes = np.column_stack([np.cos(np.pi * x / 0.6), np.cos(np.pi * y / 0.4)]).astype(complex)
    >>> dofs = tuple(Dof(node, "+Z") for node in range(35))
    >>> model = ModalModel(poles_from(np.array([40.0, 60.0]), np.full(2, 0.01)), shapes, dofs, shapes[:1], dofs[:1])
    >>> grid = Geometry(np.arange(35), np.column_stack([x, y, np.zeros(35)]))
    >>> longer, _, findings = with_plate(model, smooth(model, grid))
    >>> len(longer.poles), findings[0].message
    (2, 'nothing is known above the measured modes: 2 elastic modes are too few to tell a plate by.')
    """
    where = model.name or "modal model"
    if surface.coefficients.shape[1] != len(model.poles):
        raise InputError(
            "the surface has other modes",
            where=where,
            got=f"{surface.coefficients.shape[1]} modes",
            expected=f"{len(model.poles)}",
        )
    omega = np.abs(model.poles)
    elastic = np.flatnonzero(omega > 0.1 * np.median(omega))
    if len(elastic) < _FEWEST:
        return model, surface, (_without(where, f"{len(elastic)} elastic modes are too few to tell a plate by."),)
    plate = _plate(surface, omega, elastic, degree)
    expected = plate.frequencies[3 : 3 + len(elastic)]
    error = float(np.max(np.abs(expected / (np.sort(omega[elastic]) / (2 * np.pi)) - 1)))
    if error > _AGREES:
        return model, surface, (_without(where, f"the nearest plate misses a measured frequency by {error:.0%}."),)
    finding = Finding.of(
        "info",
        "plate",
        where,
        "modes above the measured ones are those of a plate of {mass} kg/m^2, whose frequencies "
        "differ from the measured ones by at most {error}.",
        error,
        _AGREES,
        mass=f"{plate.mass:.3g}",
        error=f"{error:.1%}",
    )
    return *_continued(model, surface, plate, 3 + len(elastic)), (finding,)


def _plate(surface: Surface, omega: np.ndarray, elastic: np.ndarray, degree: int) -> Plate:
    """The plate whose mass and stiffness matrices between the measured modes are nearest to unity and omega^2."""
    from scipy.linalg import eigh
    from scipy.optimize import nnls

    basis = products(surface.extent, degree)
    powers = np.unique(np.vstack([surface.powers, basis]), axis=0)
    count = len(powers)
    fine = replace(
        surface,
        powers=powers,
        coefficients=np.zeros((count, 0)),
        covariance=np.zeros((0, count, count)),
        noise=np.zeros(0),
    )
    inertia, bending = _energies(fine, int(powers.max()))
    measured = _embedded(surface, powers)[:, elastic]
    # modes of unit modal mass: m S = 1 with S = shapes^T inertia shapes, in the least-squares sense m = tr S / sum S^2
    seen = measured.T @ inertia @ measured
    mass = float(np.sum(np.diag(seen)) / np.sum(seen**2))
    scale = np.outer(omega[elastic], omega[elastic])
    # and sum_k D_k shapes^T bending_k shapes = omega^2, each entry over omega_i omega_j; no stiffness is negative
    columns = np.stack([(measured.T @ part @ measured / scale).ravel() for part in bending], axis=1)
    stiffness, _ = nnls(columns, np.eye(len(elastic)).ravel())
    rows = _rows(basis, powers)
    total = np.einsum("k,kij->ij", stiffness, bending)[np.ix_(rows, rows)]
    squares, vectors = eigh(total, mass * inertia[np.ix_(rows, rows)])
    coefficients = np.zeros((count, len(rows)))
    coefficients[rows] = vectors
    return Plate(mass, stiffness, np.sqrt(np.maximum(squares, 0)) / (2 * np.pi), coefficients, powers)


def _energies(surface: Surface, degree: int) -> tuple[Float[np.ndarray, "term term"], Float[np.ndarray, "4 term term"]]:
    """Integrals over the rectangle: of products of deflections, and of the four bending energies per stiffness."""
    points, weights = np.polynomial.legendre.leggauss(degree + 1)
    sides = surface.extent[:, 1] - surface.extent[:, 0]
    grid = np.stack([part.ravel() for part in np.meshgrid(points, points, indexing="ij")], axis=1)
    grid = surface.extent[:, 0] + 0.5 * (grid + 1) * sides
    weight = (np.outer(weights, weights).ravel() * sides.prod() / 4)[:, None]
    flat = surface.rows(grid)
    along, across, slanted = (surface.rows(grid, 2, angle) for angle in (0.0, np.pi / 2, np.pi / 4))
    twist = slanted - 0.5 * (along + across)
    coupled = along.T @ (weight * across)
    bending = [
        along.T @ (weight * along),
        across.T @ (weight * across),
        coupled + coupled.T,
        4 * twist.T @ (weight * twist),
    ]
    return flat.T @ (weight * flat), np.stack(bending)


def _embedded(surface: Surface, powers: Int[np.ndarray, "term 2"]) -> Float[np.ndarray, "term mode"]:
    """The coefficients of the surface among those of more polynomials."""
    result = np.zeros((len(powers), surface.coefficients.shape[1]))
    result[_rows(surface.powers, powers)] = surface.coefficients
    return result


def _rows(some: Int[np.ndarray, "part 2"], powers: Int[np.ndarray, "term 2"]) -> list[int]:
    """Where some products stand among all."""
    known = {(int(i), int(j)): row for row, (i, j) in enumerate(powers)}
    return [known[int(i), int(j)] for i, j in some]


def _continued(model: ModalModel, surface: Surface, plate: Plate, first: int) -> tuple[ModalModel, Surface]:
    """Model and surface with the modes of the plate from ``first`` on."""
    count, terms = len(plate.frequencies) - first, len(plate.powers)
    damping = float(np.median(model.damping_ratios))
    poles = np.concatenate([model.poles, poles_from(plate.frequencies[first:], np.full(count, damping))])
    still = [np.zeros((len(rows), count)) for rows in (model.shapes, model.participation)]
    longer = ModalModel(
        poles,
        np.hstack([model.shapes, still[0]]),
        model.dofs,
        np.hstack([model.participation, still[1]]),
        model.inputs,
        scaling=model.scaling,
        covariance=extended_covariance(model, count),
        condition=model.condition,
        provenance=model.provenance,
        findings=model.findings,
        name=model.name,
    )
    rows = _rows(surface.powers, plate.powers)
    covariance = np.zeros((len(poles), terms, terms))
    covariance[np.ix_(range(len(model.poles)), rows, rows)] = surface.covariance
    coefficients = np.hstack([_embedded(surface, plate.powers), plate.coefficients[:, first:]])
    noise = np.append(surface.noise, np.zeros(count))
    return longer, replace(surface, powers=plate.powers, coefficients=coefficients, covariance=covariance, noise=noise)


def _without(where: str, why: str) -> Finding:
    return Finding(
        "warning",
        "no-plate",
        where,
        f"nothing is known above the measured modes: {why}",
        None,
        None,
        "The structure yields more around the joints than is predicted.",
    )
