"""The built-in work table: a truth with known modes, without and with a friction beam.

A free cast-iron table top of 0.9 m x 0.5 m and 130 kg on soft springs. Its shapes are those of an orthotropic plate,
its natural frequencies and damping are set to what such tables show. The beam run is its linearised companion: the mass
of the beam at two joints, and between them a spring and a damper that act on their relative slip, chosen such that the
first mode meets the frequency and damping asked for. The second set of modes therefore follows from the first one, and
is slightly complex, as modes of structures with concentrated damping are.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Complex, Float

from ema.data import Geometry, ModalModel, poles_from
from ema.dof import Dof

LENGTH, WIDTH, MASS = 0.9, 0.5, 130.0
"""Top of the table in m, and its mass in kg."""
COLUMNS, ROWS = 10, 8
"""Measured points along and across."""
SKIRT_DEPTH, LEG_HEIGHT = 0.12, 0.42
"""Height of the edge around the top, and of the legs, in m; neither is measured."""

FREQUENCIES = np.array([499.0, 760.0, 1000.0, 1400.0, 1585.0, 1730.0, 1912.0, 2065.0, 2390.0, 2720.0, 3050.0, 3390.0])
DAMPING = np.array([0.638, 0.52, 0.47, 0.58, 0.41, 0.66, 0.44, 0.72, 0.50, 0.60, 0.55, 0.60]) / 100
SUSPENSION = np.array([2.8, 3.9, 4.6])
SUSPENSION_DAMPING = 0.06
"""Damping ratio of the rigid-body modes."""

BEAM_MASS, JOINT_OFFSET = 6.5, 0.045
"""Mass of the beam in kg, and height of its interface over the middle plane of the table in m."""
JOINTS = np.array([[0.10, 0.15], [0.60, 0.15]])
BEAM_FREQUENCY, BEAM_DAMPING = 492.0, 0.018
"""Natural frequency in Hz and damping ratio that the first mode has with the beam."""

ACCELEROMETERS = (Dof(1, "+Z"), Dof(67, "+Z"))


def points() -> Float[np.ndarray, "80 3"]:
    """Measured points in m: ten columns along the table, eight rows across, numbered along the table first."""
    y, x = np.meshgrid(np.linspace(0, WIDTH, ROWS), np.linspace(0, LENGTH, COLUMNS), indexing="ij")
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


def dofs() -> tuple[Dof, ...]:
    """The measured DOFs, upwards."""
    return tuple(Dof(node, "+Z") for node in range(1, COLUMNS * ROWS + 1))


def bare() -> ModalModel:
    """The table without a beam: real modes."""
    return _model("bare", 0.0, 0.0, beam=False)


def with_beam() -> ModalModel:
    """The table with the beam, linearised at a normal force of 1.02 kN per joint."""
    stiffness, damping = _joint()
    return _model("beam_1kN", stiffness, damping, beam=True)


@dataclass(frozen=True)
class _Host:
    """The table in modal coordinates: rad/s, damping ratios, shapes at the points, deflections and slopes at the
    joints."""

    omega: Float[np.ndarray, "mode"]
    damping_ratios: Float[np.ndarray, "mode"]
    shapes: Float[np.ndarray, "dof mode"]
    deflections: Float[np.ndarray, "joint mode"]
    slopes: Float[np.ndarray, "joint mode"]


@cache
def _host() -> _Host:
    from ema.datasets.free_plate import BendingStiffness, free_plate

    plate = free_plate(LENGTH, WIDTH, MASS, BendingStiffness(3.9e6, 1.5, 1.5, 0.26), modes=len(FREQUENCIES))
    places = np.vstack([points()[:, :2], JOINTS])
    x, y = places.T
    pitch, roll = (x - LENGTH / 2) * np.sqrt(12) / LENGTH, (y - WIDTH / 2) * np.sqrt(12) / WIDTH
    rigid = np.column_stack([np.ones(len(x)), pitch, roll]) / np.sqrt(MASS)
    shapes = np.hstack([rigid, plate.shapes(x, y)])
    slopes = np.hstack([np.zeros((len(x), 3)), plate.slopes(x, y)])
    slopes[:, 1] = np.sqrt(12 / MASS) / LENGTH
    omega = 2 * np.pi * np.concatenate([SUSPENSION, FREQUENCIES])
    zeta = np.concatenate([np.full(3, SUSPENSION_DAMPING), DAMPING])
    return _Host(omega, zeta, shapes[:-2], shapes[-2:], slopes[-2:])


def _modes(
    stiffness: float, damping: float, beam: bool
) -> tuple[Complex[np.ndarray, "mode"], Complex[np.ndarray, "n mode"]]:
    """Poles and shapes over the modal coordinates of the host, scaled such that residues are shape * shape / (2j w_d).

    Eigenproblem of the state (q, dq/dt) with symmetric matrices, so left and right vectors agree.
    """
    from scipy.linalg import eig

    host = _host()
    slip = JOINT_OFFSET * (host.slopes[0] - host.slopes[1])
    mass = np.eye(len(host.omega))
    if beam:
        mass += BEAM_MASS / 2 * host.deflections.T @ host.deflections
    damper = np.diag(2 * host.damping_ratios * host.omega) + damping * np.outer(slip, slip)
    spring = np.diag(host.omega**2) + stiffness * np.outer(slip, slip)
    zero = np.zeros_like(mass)
    poles, vectors = eig(np.block([[-spring, zero], [zero, mass]]), np.block([[damper, mass], [mass, zero]]))
    keep = np.flatnonzero(poles.imag > 0)
    keep = keep[np.argsort(np.abs(poles[keep]))]
    poles, vectors = poles[keep], vectors[: len(mass), keep]
    norm = np.einsum("nr,nm,mr->r", vectors, damper, vectors)
    norm = norm + 2 * poles * np.einsum("nr,nm,mr->r", vectors, mass, vectors)
    return poles, vectors * np.sqrt(2j * poles.imag / norm)


def _model(name: str, stiffness: float, damping: float, beam: bool) -> ModalModel:
    poles, vectors = _modes(stiffness, damping, beam)
    shapes = _host().shapes @ vectors
    references = [dofs().index(dof) for dof in ACCELEROMETERS]
    return ModalModel(
        poles=poles,
        shapes=shapes,
        dofs=dofs(),
        participation=shapes[references] / (2j * poles.imag),
        inputs=ACCELEROMETERS,
        scaling="unit modal mass",
        name=name,
    )


@cache
def _joint() -> tuple[float, float]:
    """Stiffness N/m and damping N s/m of the slip that put the first mode where the beam run has it."""
    from scipy.optimize import root

    target = poles_from(np.array([BEAM_FREQUENCY]), np.array([BEAM_DAMPING]))[0]

    def miss(logs: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
        pole = _modes(float(np.exp(logs[0])), float(np.exp(logs[1])), beam=True)[0][len(SUSPENSION)]
        return np.array([(pole - target).real, (pole - target).imag])

    solution = root(miss, np.log([2e7, 2e3]), tol=1e-12)
    stiffness, damping = np.exp(solution.x)
    return float(stiffness), float(damping)


def geometry() -> Geometry:
    """Return the table top with its measured points, its skirt and its four legs, which nobody measured.

    Returns
    -------
    Geometry
        Nodes 1 ... 80 are the measured points, 101 and on the lower edge of the skirt, 201 ... 204 the feet; in m.

    Examples
    --------
    >>> table = geometry()
    >>> len(table.nodes), float(table.xyz[:, 2].min())
    (116, -0.42)
    """
    top = points()
    grid = np.arange(1, COLUMNS * ROWS + 1).reshape(ROWS, COLUMNS)
    edge = [*grid[0], *grid[1:, -1], *grid[-1, -2::-1], *grid[-2:0:-1, 0]]
    below = {int(node): 101 + place for place, node in enumerate(edge)}
    skirt = top[[node - 1 for node in edge]] - [0, 0, SKIRT_DEPTH]
    inner = [int(grid[row, column]) for row in (1, -2) for column in (1, -2)]
    feet = {node: 201 + place for place, node in enumerate(inner)}
    floor = top[[node - 1 for node in inner]] - [0, 0, LEG_HEIGHT]
    faces = [
        (grid[i, j], grid[i, j + 1], grid[i + 1, j + 1], grid[i + 1, j])
        for i in range(ROWS - 1)
        for j in range(COLUMNS - 1)
    ]
    ring = [int(node) for node in edge]
    faces += [(a, b, below[b], below[a]) for a, b in zip(ring, ring[1:] + ring[:1], strict=True)]
    lower = [below[node] for node in ring]
    return Geometry(
        nodes=np.array([*range(1, len(top) + 1), *lower, *feet.values()]),
        xyz=np.vstack([top, skirt, floor]),
        lines=tuple(feet.items()),
        faces=tuple(tuple(int(node) for node in face) for face in faces),
        name="work table",
    )
