"""Random hosts, beams, data sheets and true joints, and what a test of the bare host measures."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eigh

from tests.bench.blind_hosts.elements import Bar, Plate
from tests.bench.blind_hosts.truth import FAMILIES, SLIDERS, Host, Joint

STATED = {
    "friction": 0.20,
    "tangential": 0.30,
    "normal": 0.30,
    "force": 0.03,
    "height": 1e-3,
    "exponent": 0.2,
    "length": 0.4,
}
"""Half widths of 95 % of the sheet's values: relative, height in m, exponent absolute."""
SCATTER, CALIBRATION, LOSS, LOSS_STD = 0.04, 0.01, (0.002, 0.010), 0.4
"""Standard deviations from joint to joint and of acceleration over force; range of the beam's loss factor, and the
relative uncertainty of that of the sheet."""
NOISE = 0.005
"""Standard deviation of the noise of an FRF over its root mean square in the band."""
LEVELS, FORCES = np.array([8.0, 30.0]), np.array([50.0, 130.0, 340.0])
SEARCHED = np.geomspace(40, 500, 4)
ELASTIC = 8
"""Elastic modes within the measured band."""


@dataclass(frozen=True)
class Sheet:
    """What the engineer knows of beam and joint besides the test, with the half widths ``STATED``."""

    bar: Bar
    friction: float
    tangential: float
    normal: float
    height: float
    exponent: float
    reference: float = 100.0
    length: float = 0.0
    loss: float = 0.0
    normal_contact: str = "linear"


@dataclass(frozen=True)
class Measured:
    """The test of the bare host: points (point, 2) m, rows of the sensors, row of the drive, mass in kg, FRFs.

    ``values`` (freq, sensor, point) m/s^2 per N with noise of ``variance``; ``targets`` are rough frequencies in Hz.
    """

    points: np.ndarray
    sensors: tuple[int, ...]
    drive: int
    mass: float
    frequencies: np.ndarray
    values: np.ndarray
    variance: np.ndarray
    targets: tuple[float, ...]
    kind: str


@dataclass(frozen=True)
class Case:
    """One draw: the two things the prediction may see, and the truth."""

    measured: Measured
    sheet: Sheet
    host: Host
    joint: Joint
    loss: float
    modes: tuple[int, ...]


def host_of(rng: np.random.Generator, slender: bool) -> Host:
    """A free orthotropic plate, or a slender one that bends like a beam, with lumped masses."""
    length = rng.uniform(1.0, 1.4) if slender else rng.uniform(0.6, 1.0)
    width = rng.uniform(0.16, 0.22) if slender else length * rng.uniform(0.45, 0.7)
    cells = (18, 3) if slender else (12, 8)
    per_area = rng.uniform(100, 200) if slender else rng.uniform(80, 220)
    ratios = 1.0, rng.uniform(0.7, 1.3), 0.3 * rng.uniform(0.8, 1.2), 0.35 * rng.uniform(0.8, 1.25)
    first = rng.uniform(110, 220) if slender else rng.uniform(180, 420)
    plate = Plate((length, width), cells, per_area, ratios)
    count = (cells[0] + 1) * (cells[1] + 1)
    lumps = tuple(
        (int(node), float(per_area * length * width * rng.uniform(0.01, 0.04)))
        for node in rng.choice(count, 3, replace=False)
    )
    damping = rng.uniform(0.003, 0.009, 12)
    rough = Host(plate, lumps, 1.0, damping)
    mass, stiffness = plate.matrices()
    for node, lump in lumps:
        mass[3 * node, 3 * node] += lump
    value = eigh(stiffness, mass, eigvals_only=True, subset_by_index=(3, 3))[0]
    factor = (2 * np.pi * first) ** 2 / value
    stiff = replace(plate, stiffness=tuple(factor * one for one in ratios))
    spring = rough.mass * (2 * np.pi * 3.0) ** 2 / 4
    return Host(stiff, lumps, spring, damping)


def sheet_of(rng: np.random.Generator, host: Host) -> Sheet:
    """A steel beam of 4 to 12 % of the host's mass, and its joints."""
    spacing = rng.uniform(0.22, 0.32)
    height, overhang = rng.uniform(0.03, 0.05), 0.02
    area = rng.uniform(0.04, 0.12) * host.mass / 7850 / (spacing + 2 * overhang)
    width = float(np.clip(area / height, 0.02, 0.08))
    return Sheet(
        Bar(spacing, overhang, width, height),
        float(rng.uniform(0.15, 0.3)),
        float(np.exp(rng.uniform(np.log(6e7), np.log(3e8)))),
        float(np.exp(rng.uniform(np.log(3e8), np.log(1e9)))),
        float(rng.uniform(0.02, 0.05)),
        0.3,
    )


def joint_of(rng: np.random.Generator, sheet: Sheet, family: str) -> Joint:
    """The true joint of a sheet: every value within its stated uncertainty, the law of a family of its own."""
    half = {name: value / 1.96 for name, value in STATED.items()}
    shape, offsets = rng.uniform(0.5, 2.5), np.linspace(-1, 1, SLIDERS + 2)[1:-1]
    pressure = []
    for _ in range(2):
        uneven = (1 - offsets**2) ** shape * np.exp(rng.normal(0, 0.3, SLIDERS) + rng.normal(0, 0.3) * offsets)
        pressure.append(tuple(map(float, uneven / uneven.sum())))
    falling = float(rng.uniform(0.6, 0.85)) if family == "weakening" else 1.0
    friction = sheet.friction * np.exp(half["friction"] * rng.standard_normal())
    return Joint(
        family,
        # a friction that falls from mu_s to k mu_s has the sheet's as its mean
        float(friction * 2 / (1 + falling)),
        float(sheet.tangential * np.exp(half["tangential"] * rng.standard_normal())),
        float(sheet.normal * np.exp(half["normal"] * rng.standard_normal())),
        float(max(sheet.exponent + half["exponent"] * rng.standard_normal(), 0.0)),
        float(sheet.height + half["height"] * rng.standard_normal()),
        float(1 + half["force"] * rng.standard_normal()),
        float(rng.uniform(0.004, 0.012)),
        (pressure[0], pressure[1]),
        tuple((float(a), float(b)) for a, b in np.exp(SCATTER * rng.standard_normal((2, 2)))),
        falling,
        float(np.exp(rng.uniform(np.log(3e-4), np.log(3e-3)))),
        sheet.reference,
    )


def measured_of(rng: np.random.Generator, host: Host, slender: bool) -> tuple[Measured, tuple[int, ...]]:
    """Noisy FRFs between all points and two sensors; the target modes and the drive point that shakes both."""
    omega, damping, shapes = host.modes(np.inf)
    x = np.linspace(0, host.plate.size[0], 17 if slender else 11)
    y = np.linspace(0, host.plate.size[1], 3 if slender else 6)
    points = np.stack([part.ravel() for part in np.meshgrid(x, y, indexing="ij")], axis=1)
    seen = host.plate.rows(points) @ shapes
    frequency = omega / (2 * np.pi)
    apart = [
        min(abs(frequency[m] / frequency[m - 1] - 1), abs(frequency[m + 1] / frequency[m] - 1)) for m in range(3, 8)
    ]
    targets = sorted(3 + n for n in sorted(range(5), key=lambda n: -apart[n])[:2])
    strength = np.min(np.abs(seen[:, targets]) / np.abs(seen[:, targets]).max(axis=0), axis=1)
    drive = int(rng.choice(np.flatnonzero(strength >= 0.8 * strength.max())))
    sensors = (0, len(points) - 1 - int(rng.integers(1, len(y))))
    last = frequency[3 + ELASTIC - 1]
    lines = np.arange(0.6 * frequency[3], 0.5 * (last + frequency[3 + ELASTIC]), (last - frequency[3]) / 1500)
    w = 2 * np.pi * lines[:, None]
    gains = -(w**2) / (omega**2 - w**2 + 2j * damping * omega * w)
    values = np.einsum("fm,sm,pm->fsp", gains, seen[list(sensors)], seen)
    values *= 1 + CALIBRATION * rng.standard_normal()
    sigma = NOISE * np.sqrt(np.mean(np.abs(values) ** 2, axis=0))
    noise = rng.standard_normal(values.shape) + 1j * rng.standard_normal(values.shape)
    variance = np.broadcast_to(sigma**2, values.shape)
    rough = tuple(float(round(frequency[m])) for m in targets)
    return (
        Measured(
            points,
            sensors,
            drive,
            host.mass,
            lines,
            values + sigma * noise / np.sqrt(2),
            variance,
            rough,
            "slender" if slender else "plate",
        ),
        tuple(int(m) for m in targets),
    )


def case(seed: int, number: int) -> Case:
    """The host of a number: every third is slender, families in turn, the rest at random."""
    rng = np.random.default_rng([seed, number])
    slender = number % 3 == 2
    host = host_of(rng, slender)
    sheet = sheet_of(rng, host)
    measured, modes = measured_of(rng, host, slender)
    joint = joint_of(rng, sheet, FAMILIES[number // 3 % len(FAMILIES)] if slender else FAMILIES[number % len(FAMILIES)])
    loss = float(rng.uniform(*LOSS))
    sheet = replace(
        sheet,
        # each slider stands for a part of the patch about it
        length=float(
            2 * joint.half_length * SLIDERS / (SLIDERS - 1) * np.exp(STATED["length"] / 1.96 * rng.standard_normal())
        ),
        loss=float(loss * np.exp(LOSS_STD * rng.standard_normal())),
        # whether a joint can pull is known from how it is made
        normal_contact="unilateral" if joint.family == "normal" else "linear",
    )
    return Case(measured, sheet, host, joint, loss, modes)
