"""The work table of the paper as a truth: a cast-iron table with known modes, and friction beams bolted to it.

The paper (Gaul, Roseira and Becker 2008) gives no dimensions, no friction coefficient and no contact stiffness: all of
them are assumptions, chosen such that its statements come out. The table is a free orthotropic plate of 0.9 m x 0.5 m
and 130 kg whose first four natural frequencies are set. Three settings of the beam stand for three of the paper's
figures; a fourth shows what else they would need.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from jaxtyping import Float

from ema.data import BeamModel, Damping, FrictionLaw, Joint, ModalModel, poles_from
from ema.dof import Dof
from ema.elements import Section, stepped_beam

LENGTH, WIDTH, MASS = 0.9, 0.5, 130.0
"""Top of the table in m, and its mass in kg: assumed."""
COLUMNS, ROWS = 10, 8
"""Measured points along and across."""
FREQUENCIES = (499.0, 760.0, 1000.0, 1400.0)
"""First natural frequencies in Hz that the plate is set to."""
_MODES = 13
"""Elastic modes of the plate."""
DAMPING = 0.00638
"""Damping ratio of all elastic modes, but where a setting says otherwise."""
SUSPENSION, SUSPENSION_DAMPING = (2.8, 3.9, 4.6), 0.06
_BEAM_ELEMENTS = 4
"""Finite elements of the beam between its joints."""
BEAM = "beam"


@dataclass(frozen=True)
class Setting:
    """A friction beam along x on two joints of the table.

    ``middle`` (x, y) m between the joints, ``spacing``, ``overhang``, ``width``, ``height`` m of the beam; ``lever`` m
    from the middle layer of the table to the interface; ``law`` with k_T(F_N) per joint; ``normal_stiffness`` N/m at
    1 kN with its exponent; loss factors of the sticking joints; ``background`` damping ratio that the bolted beam adds;
    ``driver`` (x, y) m of the shaker; ``host_damping`` ratios of the elastic modes of the table.
    """

    name: str
    middle: tuple[float, float]
    spacing: float
    overhang: float
    width: float
    height: float
    lever: float
    law: FrictionLaw
    normal_stiffness: float
    normal_exponent: float
    tangential_loss: float = 0.0
    normal_loss: float = 0.0
    background: float = 0.0
    driver: tuple[float, float] = (0.04, 0.06)
    host_damping: tuple[float, ...] = (DAMPING,) * _MODES

    @property
    def mass(self) -> float:
        """Kg of the beam."""
        return 7850.0 * self.width * self.height * (self.spacing + 2 * self.overhang)

    @property
    def places(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Where the joints are, m."""
        x, y = self.middle
        return (x - self.spacing / 2, y), (x + self.spacing / 2, y)


CENTRE = Setting(
    "work table, beam at the centre",
    (0.45, 0.25),
    0.24,
    0.03,
    0.08,
    0.055,
    0.06,
    FrictionLaw("masing", 0.018, 7.1e8, (), 0.176, 1000.0),
    1e9,
    0.5,
    background=0.00133,
)
"""Table 1 of the paper. The friction coefficient belongs to impacts of 1 kN: only their ratio can be determined."""

ABSORBER = Setting(
    "work table, sliding beam",
    (0.6455, 0.442),
    0.220,
    0.03010,
    0.060,
    0.0344,
    0.0458,
    FrictionLaw("masing", 0.325, 1.16e8, (), 0.65, 1000.0, 1.36e9),
    3.83e9,
    0.587,
    0.030,
    0.018,
)
"""Fig. 8, first hypothesis: the beam slides as a rigid body on its contact springs, a damped absorber."""

ROUGH = replace(
    ABSORBER,
    name="work table, sliding beam on rough joints",
    tangential_loss=0.10,
    lever=0.056,
    law=replace(ABSORBER.law, friction_coefficient=0.31, contact_stiffness=6.6e7, stiffness_exponent=0.45),
)
"""Fig. 9: the same beam with the contact stiffness that puts the ridge of mode 3 at kN."""

BENDING = Setting(
    "work table, bending slip",
    (0.68, 0.45),
    0.30,
    0.016,
    0.030,
    0.055,
    0.080,
    FrictionLaw("masing", 0.36, 4.0e8, (), 0.3, 1000.0),
    2.0e9,
    0.3,
    0.0,
    0.02,
    driver=(0.06, 0.06),
)
"""Fig. 8, second hypothesis: a stiff beam across the curvature of the table slips at its joints."""

PLACED = Setting(
    "work table, placed beam",
    (0.69, 0.47),
    0.30,
    0.02,
    0.040,
    0.045,
    0.045,
    FrictionLaw("masing", 0.193, 4.3e8, (), 0.3, 1000.0),
    2.0e9,
    0.3,
    0.02,
    0.01,
    host_damping=tuple(
        percent / 100 for percent in (0.638, 0.52, 0.47, 0.58, 0.41, 0.66, 0.44, 0.72, 0.5, 0.6, 0.55, 0.62, 0.57)
    ),
)
"""Where `reports/table_placement.toml` puts a beam; friction and stiffness are not quite those that it assumes."""

SENSOR = (0.10, 0.44)
"""Where the accelerometer of the shaker tests sits, in m."""
DRIVE_NODE, SENSOR_NODE = 91, 92
"""Numbers of the points of the shaker and of that accelerometer."""
JOINT_NODES = (101, 102)
"""Numbers of the points of the joints."""


def grid() -> dict[int, tuple[float, float]]:
    """Return the measured points: ten columns along the table, eight rows across, numbered along the table first.

    Returns
    -------
    dict of int to tuple of (float, float)
        Coordinates (x, y) [m] of the points 1 ... 80.

    Examples
    --------
    >>> grid()[1], len(grid())
    ((0.0, 0.0), 80)
    """
    y, x = np.meshgrid(np.linspace(0, WIDTH, ROWS), np.linspace(0, LENGTH, COLUMNS), indexing="ij")
    return {k + 1: (float(a), float(b)) for k, (a, b) in enumerate(zip(x.ravel(), y.ravel(), strict=True))}


def shaker_points(setting: Setting) -> dict[int, tuple[float, float]]:
    """Where the shaker drives and where the second accelerometer sits, m."""
    return {DRIVE_NODE: setting.driver, SENSOR_NODE: SENSOR}


@cache
def _plate() -> "tuple[object, Float[np.ndarray, 'mode']]":
    from ema.datasets.free_plate import BendingStiffness, free_plate

    plate = free_plate(LENGTH, WIDTH, MASS, BendingStiffness(4.87e6, 1.5, 1.5, 0.26), modes=_MODES)
    frequencies = plate.natural_frequencies * FREQUENCIES[0] / plate.natural_frequencies[0]
    frequencies[: len(FREQUENCIES)] = FREQUENCIES
    return plate, frequencies


def bare(
    points: Mapping[int, tuple[float, float]],
    joints: Mapping[int, tuple[float, float]] | None = None,
    damping: Sequence[float] = (DAMPING,) * _MODES,
) -> ModalModel:
    """The table without a beam at ``points`` (+Z) and at nodes for joints (+X, +Z, -RY), unit modal mass.

    Its middle layer does not move along X. ``damping``: ratios of its elastic modes.
    """
    from ema.datasets.free_plate import PlateModes

    plate, elastic = _plate()
    assert isinstance(plate, PlateModes)
    joints = joints or {}
    x, y = np.array([*points.values(), *joints.values()]).T
    pitch, roll = (x - LENGTH / 2) * np.sqrt(12) / LENGTH, (y - WIDTH / 2) * np.sqrt(12) / WIDTH
    shapes = np.hstack([np.column_stack([np.ones(len(x)), pitch, roll]) / np.sqrt(MASS), plate.shapes(x, y)])
    slopes = np.hstack([np.zeros((len(x), 3)), plate.slopes(x, y)])
    slopes[:, 1] = np.sqrt(12 / MASS) / LENGTH
    rows, dofs = [shapes[: len(points)]], [Dof(node, "+Z") for node in points]
    for place, node in enumerate(joints, len(points)):
        rows += [0 * shapes[:1], shapes[place : place + 1], slopes[place : place + 1]]
        dofs += [Dof(node, "+X"), Dof(node, "+Z"), Dof(node, "-RY")]
    frequencies = np.concatenate([SUSPENSION, elastic])
    ratios = np.concatenate([np.full(len(SUSPENSION), SUSPENSION_DAMPING), damping])
    poles, moved = poles_from(frequencies, ratios), np.concatenate(rows).astype(complex)
    return ModalModel(
        poles, moved, tuple(dofs), moved / (2j * poles.imag), tuple(dofs), scaling="unit modal mass", name="work table"
    )


def with_beam(
    setting: Setting,
    normal_force: float,
    points: Mapping[int, tuple[float, float]] | None = None,
    masses: Mapping[int, float] | None = None,
) -> BeamModel:
    """The table with the friction beam, every joint pressed with ``normal_force`` N.

    ``points`` are those of the shaker test by default; ``masses`` [kg] sit on some of them.
    """
    joints_at = dict(zip(JOINT_NODES, setting.places, strict=True))
    host = with_masses(bare(points or shaker_points(setting), joints_at, setting.host_damping), masses or {})
    size = {"width": setting.width, "height": setting.height}
    ends = Section(setting.overhang, elements=1, **size)
    middle = Section(setting.spacing, elements=_BEAM_ELEMENTS, **size)
    beam = stepped_beam([ends, middle, ends], (False, False), BEAM)
    joints = tuple(
        Joint(
            f"J{number + 1}",
            ((node, 1 + number * _BEAM_ELEMENTS),),
            (setting.lever, setting.height / 2),
            setting.law,
            normal_force,
            setting.normal_stiffness,
            tangential_loss=setting.tangential_loss,
            normal_loss=setting.normal_loss,
            normal_exponent=setting.normal_exponent,
        )
        for number, node in enumerate(JOINT_NODES)
    )
    return BeamModel(host, beam, joints, Damping(setting.background), setting.name)


def with_masses(model: ModalModel, masses: Mapping[int, float]) -> ModalModel:
    """A model with masses [kg] at nodes, which move along +Z: sensors, load cells. The modes stay real."""
    from scipy.linalg import eigh

    if not masses:
        return model
    at = np.real(np.array([model.shapes[model.dofs.index(Dof(node, "+Z"))] for node in masses]))
    mass = np.eye(len(model.poles)) + (at.T * list(masses.values())) @ at
    squares, vectors = eigh(np.diag(np.abs(model.poles) ** 2), mass)
    frequencies = np.sqrt(squares)
    decay = np.einsum("nr,n,nr->r", vectors, -2 * model.poles.real, vectors)
    poles, shapes = poles_from(frequencies / (2 * np.pi), decay / (2 * frequencies)), model.shapes @ vectors
    return replace(model, poles=poles, shapes=shapes, participation=shapes / (2j * poles.imag))


def with_dead_mass(setting: Setting) -> ModalModel:
    """The table with half the mass of the beam fixed at either joint, and no friction: what the mass alone does."""
    joints = dict(zip(JOINT_NODES, setting.places, strict=True))
    plain = bare(shaker_points(setting), joints, setting.host_damping)
    heavy = with_masses(plain, dict.fromkeys(JOINT_NODES, setting.mass / 2))
    keep = [row for row, dof in enumerate(heavy.dofs) if dof.node not in JOINT_NODES]
    dofs = tuple(heavy.dofs[row] for row in keep)
    shapes = heavy.shapes[keep]
    return ModalModel(
        heavy.poles,
        shapes,
        dofs,
        heavy.participation[keep],
        dofs,
        scaling="unit modal mass",
        name="work table, dead mass",
    )
