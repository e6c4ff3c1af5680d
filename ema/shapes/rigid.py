"""Rigid-body motion of a freely hung plane structure, which a hammer test above it does not see as modes."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ema.data import Finding, Geometry, ModalModel
from ema.dof import Dof
from ema.errors import InputError
from ema.shapes.surface import FLAT, Plane, Surface, plane

_BELOW = 0.01
"""Frequency of the added modes over that of the first elastic one: any value far below serves."""
_GAP = 10.0
"""Ratio of neighbouring frequencies from which the lower one is of the suspension; bending beams stay below 6.3."""
_FLAT_SHARE = 0.9
"""Share of its shape that a plane then has to explain."""
_DAMPING = 0.05
"""Damping ratio of the added modes."""
_EXPLAINED = 0.8
"""Share of the mass lines that rigid motion has to explain before it is believed."""
_DOUBT = np.array([0.2, 0.2, 0.3, 0.3])
"""How far centre of mass (over the extents) and radii of gyration (relative) may stray from those of a plate."""


_CENTRE_STD = 0.02
"""Standard uncertainty of the centre of mass, over the extents. It was off by 0.013 on the plates by which these three
were calibrated: uniform ones with three lumps of 1 to 4 % of their mass."""
_GYRATION_STD = 0.04
"""Relative standard uncertainty of radii of gyration: they were off by 0.03 on those plates."""
_MASS_STD = 0.08
"""Relative standard uncertainty of a mass from mass lines: it was off by 0.08 on those plates."""


class Body(NamedTuple):
    """Mass in kg, centre of mass and radii of gyration along the two directions of the plane in m."""

    mass: float
    centre: Float[np.ndarray, "2"]
    gyration: Float[np.ndarray, "2"]

    def shapes(self, points: Float[np.ndarray, "p 2"]) -> Float[np.ndarray, "p 3"]:
        """Translation along the normal and two rotations, each with unit modal mass, at points of the plane."""
        turned = (points - self.centre) / self.gyration
        return np.asarray(np.hstack([np.ones((len(points), 1)), turned]) / np.sqrt(self.mass))


def with_rigid_body(
    model: ModalModel, geometry: Geometry, mass: float | None = None
) -> tuple[ModalModel, tuple[Finding, ...]]:
    """Add the rigid-body modes normal to the plane of the measured points, and say where they come from.

    What is attached to a free structure feels its rigid-body motion as well. A test that begins above the suspension
    frequencies leaves it in the lower residual terms ("mass lines"), known at the measured DOFs only; here they become
    modes, known everywhere. With ``mass`` the structure counts as a uniform plate over the measured extent. Without it,
    mass, centre and radii of gyration come from the mass lines, where rigid motion explains them; the priors that fill
    in what two references leave open are those of a uniform plate. A model whose lowest mode is one of the suspension
    already keeps its modes.

    Parameters
    ----------
    model : ModalModel
        Modes of a freely suspended structure, of unit modal mass.
    geometry : Geometry
        Where the nodes are.
    mass : float, optional
        Mass of the structure [kg], where known.

    Returns
    -------
    tuple of (ModalModel, tuple of Finding)
        Model with the rigid-body modes after the measured ones, or as it was; and what was done.

    Raises
    ------
    InputError
        If the mass is not positive, the shapes have no scale, or the points lie in no plane.

    References
    ----------
    .. [1] Mass lines: Ewins (2000), Modal Testing, 2nd edition, chapter 4.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from ema.data import Geometry
    >>> from ema.dof import Dof
    >>> from ema.examples import modal_model
    >>> nodes = np.arange(1, 7)
    >>> xyz = np.column_stack([0.1 * nodes, np.zeros(6), np.zeros(6)])
    >>> shapes = np.outer(np.cos(np.pi * np.arange(6) / 5), np.ones(3)).astype(complex)
    >>> model = replace(modal_model(), shapes=shapes, dofs=tuple(Dof(int(node), "+Z") for node in nodes))
    >>> longer, findings = with_rigid_body(model, Geometry(nodes, xyz), mass=2.0)
    >>> len(longer.poles), findings[0].message
    (5, 'rigid-body modes are those of a uniform plate of 2 kg.')
    """
    where = model.name or "modal model"
    if mass is not None and not (np.isfinite(mass) and mass > 0):
        raise InputError("not a mass", where=where, got=f"{mass} kg", expected="above 0 kg")
    if model.scaling != "unit modal mass":
        raise InputError(
            "rigid-body modes need scaled shapes", where=where, got=model.scaling, expected="unit modal mass"
        )
    face = plane(model, geometry)
    low, high = face.points.min(axis=0), face.points.max(axis=0)
    if _measured(model, face):
        return model, (Finding("info", "rigid-body", where, "rigid-body modes are among the measured ones."),)
    if mass is not None:
        body = Body(mass, 0.5 * (low + high), _gyration(high - low))
        finding = Finding.of(
            "info",
            "rigid-body",
            where,
            "rigid-body modes are those of a uniform plate of {mass} kg.",
            mass=f"{mass:.4g}",
        )
        return _extended(model, geometry, face, body), (finding,)
    identified = _from_mass_lines(model, geometry, face)
    if identified is None:
        return model, (
            Finding(
                "warning",
                "no-rigid-body",
                where,
                "rigid-body motion of the structure is unknown: its mass lines were not measured or are not those of a "
                "rigid body.",
                None,
                None,
                "Name the mass, if the structure hangs freely; leave it if the structure is fixed.",
            ),
        )
    body, explained = identified
    finding = Finding.of(
        "info",
        "rigid-body",
        where,
        "rigid-body modes come from the mass lines, {explained} of which are those of {mass} kg.",
        explained,
        _EXPLAINED,
        explained=f"{explained:.0%}",
        mass=f"{body.mass:.3g}",
    )
    return _extended(model, geometry, face, body), (finding,)


def extended_covariance(model: ModalModel, count: int) -> Float[np.ndarray, "mode 2 2"] | None:
    """Covariance of the poles of a model with ``count`` more modes, of which nothing was measured."""
    if model.covariance is None:
        return None
    return np.concatenate([model.covariance, np.zeros((count, 2, 2))])


def with_body_uncertainty(surface: Surface, count: int, mass_known: bool) -> Surface:
    """The surface of a model of :func:`with_rigid_body` with the uncertainty of its last ``count`` modes.

    A uniform plate, or mass lines under its priors, are off by what is mounted on the structure. Each shape is drawn on
    its own: the terms are those of (x - c) / r with the centre of mass c and the radius of gyration r.

    Parameters
    ----------
    surface : Surface
        Smooth shapes, the rigid-body modes last.
    count : int
        How many of them there are.
    mass_known : bool
        Whether the mass was stated.

    Returns
    -------
    Surface
        The same shapes, with a covariance of the rigid-body modes.

    Examples
    --------
    >>> surface = Surface(
    ...     origin=np.zeros(3), axes=np.eye(3), extent=[[0, 1], [0, 1]], powers=[[0, 0], [1, 0]],
    ...     coefficients=[[0.0], [2.0]], covariance=np.zeros((1, 2, 2)), noise=[0.0], points=np.zeros((0, 2)),
    ... )
    >>> with_body_uncertainty(surface, 1, mass_known=True).std(np.array([[0.5, 0.0], [1.0, 0.0]])).round(3).T
    array([[0.08 , 0.113]])
    """
    scale = 0.0 if mass_known else 0.5 * _MASS_STD
    covariance = surface.covariance.copy()
    linear = {tuple(pair): row for row, pair in enumerate(surface.powers.tolist()) if sum(pair) <= 1}
    for mode in range(covariance.shape[0] - count, covariance.shape[0]):
        slopes = [surface.coefficients[linear[pair], mode] if pair in linear else 0.0 for pair in ((1, 0), (0, 1))]
        # w = a + b u with u from -1 to 1 over the extent: a centre off by a share of it moves a by 2 b times that
        covariance[mode, linear[0, 0], linear[0, 0]] += (2 * _CENTRE_STD) ** 2 * float(np.sum(np.square(slopes)))
        for row in linear.values():
            turned = _GYRATION_STD if row != linear[0, 0] else 0.0
            covariance[mode, row, row] += (turned**2 + scale**2) * surface.coefficients[row, mode] ** 2
    return replace(surface, covariance=covariance)


def mass_of(model: ModalModel, surface: Surface) -> float | None:
    """Mass of a freely hung structure by the rigid-body modes normal to its surface.

    Parameters
    ----------
    model : ModalModel
        Modes of unit modal mass, those of the suspension or of :func:`with_rigid_body` included.
    surface : Surface
        Their smooth shapes, by :func:`smooth`.

    Returns
    -------
    float or None
        Mass [kg]; ``None`` where the modes below the gap do not move the surface as a rigid body in all its ways: the
        structure is fixed, or its rigid-body motion is unknown.

    Examples
    --------
    >>> from ema.examples import plate
    >>> from ema.shapes import smooth
    >>> bare, geometry = plate()
    >>> print(mass_of(bare, smooth(bare, geometry)))
    None
    >>> hung, _ = with_rigid_body(bare, geometry, mass=2.0)
    >>> round(mass_of(hung, smooth(hung, geometry)), 3)
    2.0
    """
    motion = _rigid_motion(model, surface)[1]
    # modes of unit modal mass: motion.T @ inertia @ motion = 1 over (w, w_x, w_y) at the origin, whatever the origin
    return None if motion is None else float(np.linalg.inv(motion @ motion.T)[0, 0])


def rigid_rows(model: ModalModel, surface: Surface) -> Int[np.ndarray, "rigid"]:
    """Rows of the rigid-body modes normal to the surface.

    Parameters
    ----------
    model : ModalModel
        Modes, those of the suspension or of :func:`with_rigid_body` included.
    surface : Surface
        Their smooth shapes, by :func:`smooth`.

    Returns
    -------
    integer array of shape (rigid,)
        Rows of ``model``; none where :func:`mass_of` knows no mass.

    Examples
    --------
    >>> from ema.examples import plate
    >>> from ema.shapes import smooth
    >>> bare, geometry = plate()
    >>> hung, _ = with_rigid_body(bare, geometry, mass=2.0)
    >>> len(rigid_rows(bare, smooth(bare, geometry))), len(rigid_rows(hung, smooth(hung, geometry)))
    (0, 3)
    """
    rows, motion = _rigid_motion(model, surface)
    return rows if motion is not None else rows[:0]


def _rigid_motion(model: ModalModel, surface: Surface) -> tuple[np.ndarray, np.ndarray | None]:
    """Modes below the gap, and their (w, w_x, w_y) at the origin where they move the surface as a rigid body."""
    omega = np.abs(model.poles)
    ordered = np.sort(omega)
    gaps = np.flatnonzero(ordered[1:] > _GAP * ordered[:-1])
    if not len(gaps):
        return np.zeros(0, int), None
    rows = np.flatnonzero(omega <= ordered[gaps[-1]])
    sides = surface.extent[:, 1] - surface.extent[:, 0]
    flat = np.column_stack([np.ones(len(surface.points)), surface.points[:, sides >= FLAT * sides.max()]])
    moved = surface.values(surface.points)[:, rows]
    motion, _, rank, _ = np.linalg.lstsq(flat, moved, rcond=None)
    left = np.sum((moved - flat @ motion) ** 2, axis=0)
    if rank < flat.shape[1] or np.any(left > (1 - _FLAT_SHARE) * np.sum(moved**2, axis=0)):
        return rows, None
    if np.linalg.matrix_rank(motion, tol=1e-6 * float(np.abs(motion).max())) < len(motion):
        return rows, None
    return rows, motion


def _measured(model: ModalModel, face: Plane) -> bool:
    """Whether the lowest mode lies far below others, beyond a gap, and moves the points as a plane."""
    omega = np.abs(model.poles)
    ordered, lowest = np.sort(omega), int(np.argmin(omega))
    if np.max(ordered[1:] / ordered[:-1], initial=1.0) < _GAP:
        return False
    shape = np.real(model.shapes[face.rows[:, 0].astype(int), lowest]) * face.rows[:, 1]
    flat = np.column_stack([np.ones(len(shape)), face.points])
    left = shape - flat @ np.linalg.lstsq(flat, shape, rcond=None)[0]
    return bool(np.sum(left**2) <= (1 - _FLAT_SHARE) * np.sum(shape**2))


def _gyration(sides: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
    """Of a uniform plate; infinite across a row of points, which shows no rotation about itself."""
    return np.asarray(np.where(sides < FLAT * sides.max(), np.inf, sides / np.sqrt(12)))


def _motion(dofs: tuple[Dof, ...], geometry: Geometry, face: Plane, body: Body) -> Float[np.ndarray, "dof 3"]:
    """The three shapes at DOFs; zero where a DOF does not move with them or its place is unknown."""
    result = np.zeros((len(dofs), 3))
    for row, dof in enumerate(dofs):
        if dof.axis in ("X", "Y", "Z") and dof.node in geometry:
            at = face.axes[:2] @ (geometry.xyz[geometry.place(dof.node)] - face.origin)
            result[row] = float(geometry.direction(dof) @ face.axes[2]) * body.shapes(at[None])[0]
    return result


def _from_mass_lines(model: ModalModel, geometry: Geometry, face: Plane) -> tuple[Body, float] | None:
    """The body whose mass lines are nearest to the measured ones, and the share of them that it explains."""
    from scipy.optimize import least_squares

    if model.residuals is None:
        return None
    lines = np.real(model.residuals.lower)
    low, high = face.points.min(axis=0), face.points.max(axis=0)
    plate = _gyration(high - low)
    usable = [dof.node in geometry and dof.axis in ("X", "Y", "Z") for dof in model.inputs]
    seen = np.flatnonzero(usable)
    rows = face.rows[:, 0].astype(int)
    if not len(seen) or not np.any(lines):
        return None
    measured = lines[np.ix_(rows, seen)]
    size = float(np.sqrt(np.mean(measured**2)))
    inputs = tuple(model.inputs[column] for column in seen)
    dofs = tuple(model.dofs[row] for row in rows)

    def body(parameters: np.ndarray) -> Body:
        centre = 0.5 * (low + high) + parameters[1:3] * (high - low)
        return Body(float(np.exp(parameters[0])), centre, plate * np.exp(np.clip(parameters[3:], -3, 3)))

    def lacking(parameters: np.ndarray, scatter: float) -> np.ndarray:
        """What a body leaves of the mass lines, over their scatter, and how far it is from the expected one."""
        candidate = body(parameters)
        made = _motion(dofs, geometry, face, candidate) @ _motion(inputs, geometry, face, candidate).T
        prior = scatter * np.sqrt(measured.size) * parameters[1:] / _DOUBT
        return np.concatenate([((made - measured) / size).ravel(), prior])

    parameters, scatter = np.array([-np.log(max(size, 1e-300)), 0.0, 0.0, 0.0, 0.0]), 0.1
    for _ in range(3):  # errors of mass lines have common causes: all of them together weigh as much as the prior
        parameters = least_squares(lacking, parameters, args=(scatter,)).x
        left = lacking(parameters, scatter)[: measured.size]
        scatter = max(float(np.sqrt(np.mean(left**2))), 1e-6)
    explained = 1 - float(np.sum(left**2)) / measured.size
    return (body(parameters), explained) if explained >= _EXPLAINED else None


def _extended(model: ModalModel, geometry: Geometry, face: Plane, body: Body) -> ModalModel:
    """The model with three modes far below the others, which take the place of the mass lines.

    They come last: the measured modes keep their numbers.
    """
    moved, driven = (_motion(dofs, geometry, face, body) for dofs in (model.dofs, model.inputs))
    keep = np.any(moved != 0, axis=0)
    moved, driven = moved[:, keep], driven[:, keep]
    omega = _BELOW * float(np.abs(model.poles).min()) * np.linspace(0.8, 1.0, int(keep.sum()))
    damped = omega * np.sqrt(1 - _DAMPING**2)
    residuals = model.residuals
    return replace(
        model,
        poles=np.concatenate([model.poles, -_DAMPING * omega + 1j * damped]),
        shapes=np.hstack([model.shapes, moved.astype(complex)]),
        participation=np.hstack([model.participation, driven / (2j * damped)]),
        residuals=None if residuals is None else replace(residuals, lower=np.zeros_like(residuals.lower)),
        covariance=extended_covariance(model, len(omega)),
        confidence=None,
        uncertainty=None,
        groups=(),
        candidates=(),
    )
