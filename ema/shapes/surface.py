"""Mode shapes of a plane structure as smooth surfaces: slopes and curvatures from noisy points, with their bounds."""

from dataclasses import dataclass
from math import comb
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ema.data import Geometry, ModalModel
from ema.data._arrays import freeze
from ema.errors import InputError

_HIGHEST = 20
"""Degree of the polynomials at most, where there are points enough: with 14 the bounds of 651 points with 0.3 % noise
held 84 % of the slopes of plates with lumped masses, with 20 93 %, as the lumps' own small waves need."""
_ALONG = 30
"""Degree at most in one direction: the third derivatives of higher ones lose digits."""
_APART = 0.1
"""Share of a product's values at the points that products of longer waves do not explain, from which on the points
resolve it. Halved or doubled, grids of 26 to 651 points have up to 12 % more or fewer terms."""
_LEFT = 6
"""Points beyond the free terms, at least: they determine the noise and the strength of the penalty."""
_PENALTY = 3
"""Order of the derivatives that are penalised: one above bending, so that curvatures are smooth as well."""
_SHARE = 0.85
"""Terms that the points resolve, over points, at most: the others determine the noise."""
_STRENGTHS = 41
"""Strengths of the penalty that are averaged over, evenly in the logarithm, 2e-15 to 7 times the largest squared
singular value of the data."""
FLAT = 0.02
"""Extent across a row of points, relative to the extent along it, below which they are taken as a line."""


@dataclass(frozen=True)
class Surface:
    """Deflection of every mode over a plane: polynomials with the covariance of their coefficients.

    Parameters
    ----------
    origin : array of shape (3,)
        A point of the plane [m].
    axes : array of shape (3, 3)
        Rows are the two directions in the plane (the first along global X where that is possible) and the normal. The
        second and the normal have a positive largest component: coordinates are the global ones in a plane that is
        parallel to two of the global axes. Of x, z and the normal y the three are left-handed.
    extent : array of shape (2, 2)
        Measured rectangle in the plane [m]: (low, high) of the first and of the second coordinate.
    powers : integer array of shape (term, 2)
        Degrees of every Legendre product in the two coordinates.
    coefficients : array of shape (term, mode)
        Coefficients of the products, in the unit of the shapes.
    covariance : array of shape (mode, term, term)
        Covariance of the coefficients of every mode.
    noise : array of shape (mode,)
        Standard deviation of the measured values about the surface.
    points : array of shape (point, 2)
        Measured points in the plane [m].

    Examples
    --------
    >>> surface = Surface(
    ...     origin=np.zeros(3), axes=np.eye(3), extent=[[0, 1], [0, 1]], powers=[[0, 0], [1, 0]],
    ...     coefficients=[[0.5], [0.5]], covariance=np.zeros((1, 2, 2)), noise=[0.0], points=np.zeros((0, 2)),
    ... )
    >>> surface.values(np.array([[0.25, 0.5]]))
    array([[0.25]])
    """

    origin: Float[np.ndarray, "3"]
    axes: Float[np.ndarray, "3 3"]
    extent: Float[np.ndarray, "2 2"]
    powers: Int[np.ndarray, "term 2"]
    coefficients: Float[np.ndarray, "term mode"]
    covariance: Float[np.ndarray, "mode term term"]
    noise: Float[np.ndarray, "mode"]
    points: Float[np.ndarray, "point 2"]

    def __post_init__(self) -> None:
        names = ("origin", "axes", "extent", "coefficients", "covariance", "noise", "points")
        freeze(self, powers=np.int64, **dict.fromkeys(names, np.float64))

    def rows(
        self, points: Float[np.ndarray, "p 2"], order: int = 0, angle: float | Float[np.ndarray, "p"] = 0.0
    ) -> Float[np.ndarray, "p term"]:
        """Return what the coefficients are multiplied by to get a derivative at points of the plane.

        Parameters
        ----------
        points : array of shape (p, 2)
            Points in the plane [m].
        order : int, default 0
            0 for the deflection, 1 for the slope, 2 for the curvature.
        angle : float or array of shape (p,), default 0.0
            Direction of the derivative [rad] from the first axis; one for all points, or one per point.

        Returns
        -------
        array of shape (p, term)
            Values of the (differentiated) polynomials.

        Examples
        --------
        >>> surface = Surface(
        ...     origin=np.zeros(3), axes=np.eye(3), extent=[[0, 1], [0, 1]], powers=[[0, 0], [1, 0]],
        ...     coefficients=[[0.5], [0.5]], covariance=np.zeros((1, 2, 2)), noise=[0.0], points=np.zeros((0, 2)),
        ... )
        >>> surface.rows(np.array([[0.25, 0.5]]), order=1)
        array([[0., 2.]])
        """
        scale = 2 / (self.extent[:, 1] - self.extent[:, 0])
        local = (points - self.extent[:, 0]) * scale - 1
        cosine, sine = np.cos(angle), np.sin(angle)
        total = np.zeros((len(points), len(self.powers)))
        for along in range(order + 1):
            across = order - along
            weight = comb(order, along) * cosine**along * sine**across
            rows = _products(local, self.powers, along, across) * scale[0] ** along * scale[1] ** across
            total += np.broadcast_to(weight, len(points))[:, None] * rows
        return total

    def values(
        self, points: Float[np.ndarray, "p 2"], order: int = 0, angle: float | Float[np.ndarray, "p"] = 0.0
    ) -> Float[np.ndarray, "p mode"]:
        """Return deflection, slope or curvature of every mode at points of the plane.

        Parameters
        ----------
        points : array of shape (p, 2)
            Points in the plane [m].
        order : int, default 0
            0 for the deflection, 1 for the slope, 2 for the curvature.
        angle : float or array of shape (p,), default 0.0
            Direction of the derivative [rad] from the first axis; one for all points, or one per point.

        Returns
        -------
        array of shape (p, mode)
            Values in the unit of the shapes, per m and per m^2.

        Examples
        --------
        >>> surface = Surface(
        ...     origin=np.zeros(3), axes=np.eye(3), extent=[[0, 1], [0, 1]], powers=[[0, 0], [1, 0]],
        ...     coefficients=[[0.5], [0.5]], covariance=np.zeros((1, 2, 2)), noise=[0.0], points=np.zeros((0, 2)),
        ... )
        >>> surface.values(np.array([[0.25, 0.5]]), order=1)
        array([[1.]])
        """
        return np.asarray(self.rows(points, order, angle) @ self.coefficients)

    def std(
        self, points: Float[np.ndarray, "p 2"], order: int = 0, angle: float | Float[np.ndarray, "p"] = 0.0
    ) -> Float[np.ndarray, "p mode"]:
        """Return the standard uncertainty of deflection, slope or curvature at points of the plane.

        Parameters
        ----------
        points : array of shape (p, 2)
            Points in the plane [m].
        order : int, default 0
            0 for the deflection, 1 for the slope, 2 for the curvature.
        angle : float or array of shape (p,), default 0.0
            Direction of the derivative [rad] from the first axis; one for all points, or one per point.

        Returns
        -------
        array of shape (p, mode)
            Standard uncertainty of :meth:`values`.

        Examples
        --------
        >>> surface = Surface(
        ...     origin=np.zeros(3), axes=np.eye(3), extent=[[0, 1], [0, 1]], powers=[[0, 0], [1, 0]],
        ...     coefficients=[[0.5], [0.5]], covariance=[np.diag([0.04, 0.0])], noise=[0.0], points=np.zeros((0, 2)),
        ... )
        >>> surface.std(np.array([[0.25, 0.5]]))
        array([[0.2]])
        """
        rows = self.rows(points, order, angle)
        return np.asarray(np.sqrt(np.maximum(np.einsum("pt,mtu,pu->pm", rows, self.covariance, rows), 0)))


def _products(
    local: Float[np.ndarray, "p 2"], powers: Int[np.ndarray, "term 2"], along: int, across: int
) -> Float[np.ndarray, "p term"]:
    """Products of (differentiated) Legendre polynomials at points of the square [-1, 1] x [-1, 1]."""
    from numpy.polynomial import legendre

    parts = []
    for axis, order in enumerate((along, across)):
        count = int(powers[:, axis].max()) + 1
        derivative = legendre.legder(np.eye(count), order) if order else np.eye(count)
        parts.append((legendre.legvander(local[:, axis], len(derivative) - 1) @ derivative)[:, powers[:, axis]])
    return np.asarray(parts[0] * parts[1])


def smooth(model: ModalModel, geometry: Geometry, degree: int | None = None) -> Surface:
    """Return every mode of a model as a smooth surface over the plane of its measured points.

    The penalty on third derivatives is weighed against the misfit by the restricted likelihood, averaged over all
    strengths of the penalty (a sum over a grid) instead of taking one: at high noise no strength is certain, and the
    bounds say so.

    Parameters
    ----------
    model : ModalModel
        Shapes with translations normal to the plane; their real part is used.
    geometry : Geometry
        Where the nodes are.
    degree : int, optional
        Total degree of the polynomials over a square; over a rectangle as short waves in both directions. By default
        20, less where there are few points.

    Returns
    -------
    Surface
        Smooth shapes with their covariance.

    Raises
    ------
    InputError
        If there are fewer than 6 usable points, the points lie in no plane, or shapes are complex (more than half of
        their norm out of phase).

    References
    ----------
    .. [1] Smoothing as estimation with a prior: Wahba (1990), Spline Models for Observational Data.

    Examples
    --------
    >>> from ema.data import Geometry, ModalModel, poles_from
    >>> from ema.dof import Dof
    >>> x = np.linspace(0, 0.6, 13)
    >>> shapes = np.cos(np.pi * x / 0.6)[:, None].astype(complex)
    >>> dofs = tuple(Dof(node, "+Z") for node in range(13))
    >>> model = ModalModel(poles_from(np.array([40.0]), np.array([0.01])), shapes, dofs, shapes[:1], dofs[:1])
    >>> row = Geometry(np.arange(13), np.column_stack([x, np.zeros(13), np.zeros(13)]))
    >>> surface = smooth(model, row)
    >>> surface.values(np.array([[0.3, 0.0]]), order=1).round(2)  # slope of the cosine at 90 deg: -pi / 0.6
    array([[-5.24]])
    """
    where = model.name or "modal model"
    origin, axes, rows, points = plane(model, geometry)
    shapes = np.asarray(model.shapes)[rows[:, 0].astype(int)] * rows[:, 1:]
    lost = float(np.linalg.norm(shapes.imag) / max(float(np.linalg.norm(shapes)), 1e-300))
    if lost > 0.5:
        raise InputError(
            "complex shapes have no surface",
            where=where,
            got=f"{lost:.0%} out of phase",
            expected="nearly real shapes",
            advice="make them real first (ema.shapes.realise)",
        )
    low, high = points.min(axis=0), points.max(axis=0)
    if high[1] - low[1] < FLAT * (high[0] - low[0]):
        middle, half = 0.5 * (high[1] + low[1]), 0.5 * FLAT * (high[0] - low[0])
        low[1], high[1] = middle - half, middle + half
        line = True
    else:
        line = False
    extent = np.stack([low, high], axis=1)
    powers = _powers(points, extent, degree, line)
    count = shapes.shape[1]
    surface = Surface(
        origin,
        axes,
        extent,
        powers,
        np.zeros((len(powers), count)),
        np.zeros((count, len(powers), len(powers))),
        np.zeros(count),
        points,
    )
    order = _order(powers, len(points))
    fits = _fit(surface.rows(points), _roughness(powers, extent, order), powers.sum(axis=1) < order, shapes.real)
    return Surface(origin, axes, extent, powers, *fits, points)


class Plane(NamedTuple):
    """Origin and axes of a plane; ``(row of the shapes, 1 / cosine)`` and place in the plane of every usable DOF."""

    origin: Float[np.ndarray, "3"]
    axes: Float[np.ndarray, "3 3"]
    rows: Float[np.ndarray, "point 2"]
    points: Float[np.ndarray, "point 2"]


def plane(model: ModalModel, geometry: Geometry) -> Plane:
    """The plane of the measured points of a model.

    Raises
    ------
    InputError : fewer than 6 usable points, points that lie in no plane.
    """
    where = model.name or "modal model"
    usable = [(row, dof) for row, dof in enumerate(model.dofs) if dof.axis in ("X", "Y", "Z") and dof.node in geometry]
    if len(usable) < 6:
        raise InputError(
            "too few points for a surface",
            where=where,
            got=f"{len(usable)} translations on the geometry",
            expected="6 or more",
            advice="measure more points, or give the geometry",
        )
    xyz = np.array([geometry.xyz[geometry.place(dof.node)] for _, dof in usable])
    directions = np.array([geometry.direction(dof) for _, dof in usable])
    mean = xyz.mean(axis=0)
    _, spread, turned = np.linalg.svd(xyz - mean, full_matrices=False)
    if spread[2] > 0.05 * spread[0]:
        raise InputError(
            "the measured points lie in no plane",
            where=where,
            got=f"{spread[2] / np.sqrt(len(xyz)):.3g} m rms off the best plane",
            expected="points of one plane face",
            advice="select the points of the face",
        )
    normal = turned[2] if spread[1] > FLAT * spread[0] else _common(directions, turned[0], where)
    normal = _positive(normal)
    first = np.eye(3)[0] - normal[0] * normal
    first = first if np.linalg.norm(first) > 0.5 else np.eye(3)[1] - normal[1] * normal
    if spread[1] <= FLAT * spread[0]:
        first = _positive(turned[0])
    first /= np.linalg.norm(first)
    axes = np.stack([first, _positive(np.cross(normal, first)), normal])
    cosines = directions @ normal
    keep = np.abs(cosines) > 0.9
    if keep.sum() < 6:
        raise InputError(
            "too few measurements normal to the surface", where=where, got=int(keep.sum()), expected="6 or more"
        )
    origin = mean - axes[:2].T @ (axes[:2] @ mean)
    rows = np.array([[row, 1 / cosine] for (row, _), cosine in zip(usable, cosines, strict=True)])
    return Plane(origin, axes, rows[keep], ((xyz - origin) @ axes[:2].T)[keep])


def _positive(direction: np.ndarray) -> np.ndarray:
    """The direction with a positive largest component; of equal ones, as at 45 deg, the first."""
    return np.asarray(direction * np.sign(direction[np.round(np.abs(direction), 6).argmax()]))


def _common(directions: np.ndarray, along: np.ndarray, where: str) -> np.ndarray:
    """The direction most measurements of a row of points share, square to the row."""
    square = directions - np.outer(directions @ along, along)
    _, strength, turned = np.linalg.svd(square, full_matrices=False)
    if strength[0] < 1e-6:
        raise InputError(
            "no measurement across the row of points",
            where=where,
            got="motion along the row only",
            advice="measure the points across the row as well",
        )
    return np.asarray(turned[0])


def products(extent: Float[np.ndarray, "2 2"], degree: float, line: bool = False) -> Int[np.ndarray, "term 2"]:
    """Degrees of the products whose waves are not shorter than those of a total degree over a square of the same area.

    A longer side has as many more half waves as it is longer. They begin with the longest waves.
    """
    pairs = np.array([(i, j) for i in range(_ALONG + 1) for j in range(1 if line else _ALONG + 1)], dtype=np.int64)
    grades = _grades(extent, pairs)
    order = np.argsort(grades, kind="stable")
    return pairs[order[grades[order] <= degree]]


def _grades(extent: Float[np.ndarray, "2 2"], powers: Int[np.ndarray, "term 2"]) -> Float[np.ndarray, "term"]:
    """Total degree over a square of the same area of the products whose waves are as short."""
    sides = extent[:, 1] - extent[:, 0]
    longer = float(np.sqrt(sides[0] / sides[1]))
    return np.asarray(np.round(powers @ [1 / longer, longer], 9))


def _powers(
    points: Float[np.ndarray, "point 2"], extent: Float[np.ndarray, "2 2"], degree: int | None, line: bool
) -> Int[np.ndarray, "term 2"]:
    """Degrees of the products: from the longest waves on, so many that the points also determine the noise.

    Products that the points do not resolve have the penalty as their prior; where it does not act on them they are left
    out, as the curvature across two rows of points.
    """
    ordered = products(extent, _HIGHEST if degree is None else degree, line)
    grades = _grades(extent, ordered)
    values = _products(2 * (points - extent[:, 0]) / (extent[:, 1] - extent[:, 0]) - 1, ordered, 0, 0)
    most = int(_SHARE * len(points)) if degree is None else len(points)
    kept, known = list[int](), np.zeros((len(points), 0))
    for grade in np.unique(grades):
        alike, wider = np.flatnonzero(grades == grade), known
        for row in alike:
            rest = values[:, row] - wider @ (wider.T @ values[:, row])
            resolved = np.linalg.norm(rest) > _APART * np.linalg.norm(values[:, row])
            if resolved:
                wider = np.column_stack([wider, rest / np.linalg.norm(rest)])
            if resolved or ordered[row].sum() >= _PENALTY:
                kept.append(int(row))
        if wider.shape[1] > most and degree is None:
            kept = [row for row in kept if grades[row] < grade]
            break
        known = wider
    if len(kept) < 2 or (degree is not None and len(kept) > len(points)):
        raise InputError(
            "the degree does not suit the points",
            where="smoothing of shapes",
            got=degree,
            expected=f"at least 1 and at most {len(points)} terms",
        )
    return ordered[kept]


def _order(powers: Int[np.ndarray, "term 2"], points: int) -> int:
    """Order of the derivatives that are penalised; products of a lower total degree are free.

    Few points have a lower order: some have to be left to determine the noise and the strength of the penalty.
    """
    degrees = powers.sum(axis=1)
    fitting = [order for order in range(1, _PENALTY + 1) if np.sum(degrees < order) <= points - _LEFT]
    return min(max(fitting, default=1), int(degrees.max()))


def _roughness(
    powers: Int[np.ndarray, "term 2"], extent: Float[np.ndarray, "2 2"], order: int
) -> Float[np.ndarray, "term term"]:
    """Integral over the rectangle of all squared derivatives of an order (exact)."""
    points, weights = np.polynomial.legendre.leggauss(int(powers.max()) + 2)
    grid = np.stack([part.ravel() for part in np.meshgrid(points, points, indexing="ij")], axis=1)
    scale = 2 / (extent[:, 1] - extent[:, 0])
    total = np.zeros((len(powers), len(powers)))
    # integral of sum_k binom(n, k) (d^n w / dx^k dy^(n-k))^2, the same in all directions of the plane (Wahba 1990)
    for along in range(order + 1):
        rows = _products(grid, powers, along, order - along) * scale[0] ** along * scale[1] ** (order - along)
        total += comb(order, along) * (rows.T * np.outer(weights, weights).ravel()) @ rows
    return np.asarray(total / scale.prod())


def _fit(
    design: Float[np.ndarray, "point term"],
    roughness: Float[np.ndarray, "term term"],
    free: Bool[np.ndarray, "term"],
    values: Float[np.ndarray, "point mode"],
) -> tuple[Float[np.ndarray, "term mode"], Float[np.ndarray, "mode term term"], Float[np.ndarray, "mode"]]:
    """Coefficients, their covariance and the noise of every mode."""
    # coefficients in which the penalty is the identity on the rough ones and zero on the free ones; it is scaled, since
    # it grows with the eleventh power of the degree
    lowest, held = np.flatnonzero(free), np.flatnonzero(~free)
    penalty = roughness[np.ix_(held, held)]
    size = np.sqrt(np.diag(penalty))
    basis = np.zeros(roughness.shape)
    basis[lowest, np.arange(len(lowest))] = 1.0
    basis[held, len(lowest) :] = np.linalg.inv(np.linalg.cholesky(penalty / np.outer(size, size))).T / size[:, None]
    plain, rough = design @ basis[:, : len(lowest)], design @ basis[:, len(lowest) :]
    reached, upper = np.linalg.qr(plain)
    beyond = rough - reached @ (reached.T @ rough)
    parts = _Parts(rough, reached, np.linalg.solve(upper, reached.T), *np.linalg.svd(beyond, full_matrices=False))
    fits = [_posterior(parts, column) for column in values.T]
    return (
        np.stack([basis @ mean for mean, _, _ in fits], axis=1),
        np.stack([basis @ covariance @ basis.T for _, covariance, _ in fits]),
        np.array([noise for *_, noise in fits]),
    )


@dataclass(frozen=True)
class _Parts:
    """What all modes share: penalised columns, the directions of the data that free columns reach, the solution for
    the free columns, and the singular value decomposition of what is left of the penalised columns beyond them."""

    rough: np.ndarray
    reached: np.ndarray
    solve: np.ndarray
    left: np.ndarray
    stretch: np.ndarray
    right: np.ndarray


def _posterior(parts: _Parts, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Mean and covariance of the (free, penalised) coefficients and the noise, averaged over the strengths."""
    rough, solve, stretch, right = parts.rough, parts.solve, parts.stretch, parts.right
    data = values - parts.reached @ (parts.reached.T @ values)
    seen, count = parts.left.T @ data, max(len(data) - parts.reached.shape[1], 1)
    rest = max(float(data @ data - seen @ seen), 0.0)
    top = float(stretch.max(initial=0)) ** 2
    strengths = top * np.exp(np.linspace(-34.0, 2.0, _STRENGTHS)) if top > 0 else np.ones(1)
    # values = free + rough r + e with r ~ N(0, v / strength), e ~ N(0, v): in the directions that no free column
    # reaches their covariance is v (1 + s^2 / strength) with the singular values s
    power = 1 + stretch[:, None] ** 2 / strengths
    variances = (np.sum(seen[:, None] ** 2 / power, axis=0) + rest) / count
    variances = np.maximum(variances, 1e-30 * max(float(np.max(values**2, initial=0)), 1e-300))
    # restricted log-likelihood of each strength, with the variance v that maximises it
    score = -0.5 * (count * np.log(variances) + np.log(power).sum(axis=0))
    weights = np.exp(score - score.max()) / np.exp(score - score.max()).sum()
    terms = len(solve) + rough.shape[1]
    mean, square, noise = np.zeros(terms), np.zeros((terms, terms)), 0.0
    for strength, weight, variance in zip(strengths, weights, variances, strict=True):
        if weight < 1e-6:
            continue
        gain = stretch / (stretch**2 + strength)
        inside = right.T @ (gain * seen)
        part = np.concatenate([solve @ (values - rough @ inside), inside])
        prior = variance / strength * (np.eye(rough.shape[1]) - (right.T * (stretch * gain)) @ right)
        carried = solve @ rough @ prior
        corner = variance * solve @ solve.T + carried @ (solve @ rough).T
        covariance = np.block([[corner, -carried], [-carried.T, prior]])
        mean, square = mean + weight * part, square + weight * (covariance + np.outer(part, part))
        noise += weight * variance
    # law of total variance over the strengths: E(C + m m^T) - E(m) E(m)^T
    return mean, square - np.outer(mean, mean), float(np.sqrt(noise))
