"""How often the bands of amplitude-resolved hammer modal analysis hold: random structures with a joint that slips.

Signals are integrated here, mode by mode and exactly but for the force of the joint, without the simulator: 3 to 5 modes,
one joint of the law of Masing or with distributed sliders (Iwan), 24 impacts of different levels on 8 points, three
accelerometers, 1 % noise. The truth is the complex mode with the stiffness that one harmonic gives the joint: Caughey's
closed form of a slider in series with a spring (Journal of Applied Mechanics 27, 1960), summed over the sliders.

    python -m tests.bench.amplitude_resolved --n 20 --seed 1
"""

import argparse
from dataclasses import dataclass

import numpy as np
import scipy.signal

from ema.compare.amplitude_resolved import RingDownMode, ring_down_modes
from ema.data import Channel, Condition, Excitation, Recording, Run
from ema.dof import Dof

RATE, FINER, LENGTH, BEFORE = 4096, 8, 0.8, 0.05
"""Sampling rate in Hz, steps of the integration per sample, s of a record, and s of it before the impact."""
POINTS, HITS, SENSORS, NOISE = 8, 3, 3, 0.01
PEAK, CONTACT = 1000.0, 1e-3
SLIDERS = 12


@dataclass(frozen=True)
class Joint:
    """Springs (slider,) in N/m that slide at their own displacement (slider,) in m."""

    stiffness: np.ndarray
    limits: np.ndarray

    def complex_stiffness(self, amplitude: float) -> complex:
        """Force over displacement of one harmonic of ``amplitude`` m (Caughey 1960): with u = amplitude over limit,
        cos theta = 1 - 2 / u, real part (theta - sin theta cos theta) / pi, imaginary part 4 (1 - 1 / u) / (pi u)."""
        u = np.maximum(amplitude / self.limits, 1.0)
        theta = np.arccos(np.clip(1 - 2 / u, -1, 1))
        real = (theta - np.sin(theta) * np.cos(theta)) / np.pi
        return complex(np.sum(self.stiffness * (real + 4j / np.pi * (1 - 1 / u) / u)))


@dataclass(frozen=True)
class Structure:
    """Stuck modes: natural frequencies [rad/s], damping ratios, shapes (dof, mode) of unit modal mass; the joint with its
    shape (mode,); sensors and points are rows of the shapes."""

    omega: np.ndarray
    damping: np.ndarray
    shapes: np.ndarray
    joint: Joint
    at_joint: np.ndarray
    sensors: np.ndarray
    law: str

    def mode(self, number: int, slip: float) -> tuple[float, float, np.ndarray]:
        """Frequency [Hz], damping ratio and shape over the stuck modes at ``slip`` m of the joint."""
        total = float(self.joint.stiffness.sum())
        change = self.joint.complex_stiffness(slip) - total
        square = self.omega[number] ** 2 + 0j
        vector = np.eye(len(self.omega))[number] + 0j
        for _ in range(50):
            # the loss of the stuck modes is viscous: 2 j zeta w_r w
            matrix = np.diag(self.omega**2 + 2j * self.damping * self.omega * np.sqrt(square.real))
            matrix = matrix + change * np.outer(self.at_joint, self.at_joint)
            values, vectors = np.linalg.eig(matrix)
            best = int(np.argmax(np.abs(vectors.conj().T @ vector)))
            square, vector = complex(values[best]), vectors[:, best]
        vector = vector / np.sqrt(np.sum(np.abs(vector) ** 2))
        # P = (1/2) Im(w_c^2) w q^2 and zeta = P / (w^3 q^2)
        return float(np.sqrt(square.real) / (2 * np.pi)), float(0.5 * square.imag / square.real), vector

    def curve(self, number: int, row: int) -> np.ndarray:
        """Amplitude of the acceleration at sensor ``row``, frequency and damping ratio of a mode, real and imaginary
        parts of its shape at the sensors, 1 at ``row``: (3 + 2 sensors, level)."""
        levels = np.geomspace(0.05 * self.joint.limits.min(), 300 * self.joint.limits.max(), 400)
        table = []
        for slip in levels:
            frequency, damping, vector = self.mode(number, float(slip))
            q = slip / max(abs(self.at_joint @ vector), 1e-300)
            at = self.shapes[self.sensors] @ vector
            moved, shape = q * abs(at[row]), at / at[row]
            table.append((moved * (2 * np.pi * frequency) ** 2, frequency, damping, *shape.real, *shape.imag))
        return np.array(table).T


def structure(rng: np.random.Generator, law: str) -> Structure:
    """Draw a structure; the joint begins to slip between 1/12 and 2/3 of what the impacts give it."""
    count = int(rng.integers(3, 6))
    while True:
        frequencies = np.sort(np.exp(rng.uniform(np.log(200.0), np.log(800.0), count)))
        if np.min(np.diff(frequencies) / frequencies[1:]) > 0.1:
            break
    shapes = rng.normal(size=(POINTS, count)) / np.sqrt(rng.uniform(5, 20))
    omega, damping = 2 * np.pi * frequencies, np.exp(rng.uniform(np.log(0.003), np.log(0.01), count))
    at_joint = rng.normal(size=count) / np.sqrt(10.0)
    total = rng.uniform(0.03, 0.15) * float(np.median(omega)) ** 2 / float(np.max(at_joint**2))
    if law == "masing":
        joint = Joint(np.array([total]), np.array([1.0]))
    else:  # limits of equal share up to the largest: frequency falls in proportion to the amplitude at first
        joint = Joint(np.full(SLIDERS, total / SLIDERS), (np.arange(SLIDERS) + 0.5) / SLIDERS)
    drawn = Structure(omega, damping, shapes, joint, at_joint, rng.choice(POINTS, SENSORS, replace=False), law)
    stuck = Structure(omega, damping, shapes, Joint(joint.stiffness, joint.limits * 1e9), at_joint, drawn.sensors, law)
    largest = float(np.median([np.abs(_slips(stuck, point)).max() for point in range(POINTS)]))
    limit = largest / np.exp(rng.uniform(np.log(1.5), np.log(12.0)))
    return Structure(omega, damping, shapes, Joint(joint.stiffness, joint.limits * limit), at_joint, drawn.sensors, law)


def _slips(drawn: Structure, point: int) -> np.ndarray:
    return integrated(drawn, drawn.shapes[[point]], np.array([PEAK]), BEFORE + 0.05)[1][0]


def integrated(
    drawn: Structure, at: np.ndarray, peaks: np.ndarray, length: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Accelerations (impact, sensor, fine), displacements of the joint (impact, fine) and forces (impact, fine).

    The stuck modes are propagated exactly under a force that is a straight line within a step; the force of the joint
    beyond k x follows its sliders and is extrapolated over the step from the last two.
    """
    step, count = 1 / (RATE * FINER), round(length * RATE * FINER)
    decay, damped = drawn.damping * drawn.omega, drawn.omega * np.sqrt(1 - drawn.damping**2)
    free = np.array([_matrix(o, d, step) for o, d in zip(drawn.omega, drawn.damping, strict=True)])
    begin = round(BEFORE * RATE * FINER)
    pulse = np.zeros(count + 2)
    contact = round(CONTACT * RATE * FINER)
    pulse[begin : begin + contact] = np.sin(np.pi * np.arange(contact) / contact)[: max(count + 2 - begin, 0)]
    assert np.all(damped > decay)
    state = np.zeros((2, len(at), len(drawn.omega)))
    stress = np.zeros((len(at), len(drawn.joint.limits)))
    x = np.zeros(len(at))
    before = np.zeros(len(at))
    moved, slip = np.empty((count, len(at), len(drawn.sensors))), np.empty((count, len(at)))
    rows = drawn.shapes[drawn.sensors]
    for number in range(count):
        new = state[0] @ drawn.at_joint
        stress = np.clip(stress + (new - x)[:, None], -drawn.joint.limits, drawn.joint.limits)
        x = new
        extra = x * drawn.joint.stiffness.sum() - stress @ drawn.joint.stiffness
        now = extra[:, None] * drawn.at_joint + (peaks * pulse[number])[:, None] * at
        later = (2 * extra - before)[:, None] * drawn.at_joint + (peaks * pulse[number + 1])[:, None] * at
        before = extra
        acceleration = now - drawn.omega**2 * state[0] - 2 * decay * state[1]
        moved[number], slip[number] = acceleration @ rows.T, x
        inputs = np.stack([state[0], state[1], now, later])
        state = np.einsum("mij,jpm->ipm", free, inputs)
    return moved.transpose(1, 2, 0), slip.T, np.outer(peaks, pulse[:count])


def _matrix(omega: float, damping: float, step: float) -> np.ndarray:
    """(2, 4): displacement and velocity after a step from those before it and the force at either end."""
    from scipy.linalg import expm

    system = np.zeros((4, 4))
    system[0, 1] = 1.0
    system[1, :3] = -(omega**2), -2 * damping * omega, 1.0
    system[2, 3] = 1 / step  # the force, and its rise over the step
    whole = expm(system * step)[:2]
    return np.column_stack([whole[:, 0], whole[:, 1], whole[:, 2] - whole[:, 3], whole[:, 3]])


def measured(rng: np.random.Generator, drawn: Structure) -> Run:
    """A hammer test with noise: one record for each impact, impacts between a third of the largest and the largest."""
    points = np.repeat(np.arange(POINTS), HITS)
    peaks = PEAK * np.exp(rng.uniform(np.log(1 / 3), 0.0, len(points)))
    moved, _, forces = integrated(drawn, drawn.shapes[points], peaks, LENGTH)
    signals = np.concatenate([forces[:, None], moved], axis=1)
    signals = scipy.signal.resample_poly(signals, 1, FINER, axis=2)
    first = slice(round((BEFORE + 2 * CONTACT) * RATE), round((BEFORE + 0.05) * RATE))
    std = NOISE * np.median(np.sqrt(np.mean(signals[:, :, first] ** 2, axis=2)), axis=0)
    std[0] = 0.001 * PEAK
    signals = signals + rng.normal(size=signals.shape) * std[:, None]
    sensors = tuple(
        Channel(f"acc {n}", Dof(int(row) + 1, "+X"), quantity="acceleration", unit="m/s^2", role="response")
        for n, row in enumerate(drawn.sensors, 1)
    )
    records = tuple(
        Recording(
            one,
            float(RATE),
            (Channel("force", Dof(int(point) + 1, "+X"), quantity="force", unit="N", role="reference"), *sensors),
        )
        for point, one in zip(points, signals, strict=True)
    )
    return Run("drawn", Condition(Excitation(kind="hammer")), records)


@dataclass(frozen=True)
class Outcome:
    """Of one mode: whether the truth is inside at every amplitude (of the shape: at every response and amplitude, without
    the reference), relative errors of the limits of small amplitudes, whether their intervals and that of the onset hold,
    and MAC of the shapes with the true ones at the same amplitudes and with the true one of small amplitudes."""

    law: str
    frequency: np.ndarray
    damping: np.ndarray
    errors: tuple[float, float]
    limits: tuple[bool, bool]
    onset: bool
    seen: bool
    shape: np.ndarray
    mac: np.ndarray
    stuck_mac: np.ndarray


def _mac(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """MAC of each column."""
    return (
        np.abs(np.sum(one.conj() * other, axis=0)) ** 2
        / np.sum(np.abs(one) ** 2, axis=0)
        / np.sum(np.abs(other) ** 2, axis=0)
    )


def judged(drawn: Structure, found: RingDownMode) -> Outcome:
    """A mode against the truth."""
    number = int(np.argmin(np.abs(drawn.omega / (2 * np.pi) / found.onset.frequency.value - 1)))
    stuck = drawn.omega[number] / (2 * np.pi), drawn.damping[number]
    # the sensor at which the mode is largest
    row = int(np.argmax(np.abs(drawn.shapes[drawn.sensors, number])))
    curve = drawn.curve(number, row)
    log = np.log(found.mode.amplitude)
    inside = []
    for band, values in ((found.mode.frequency, curve[1]), (found.mode.damping, curve[2])):
        true = np.interp(log, np.log(curve[0]), values)
        inside.append((band.low <= true) & (true <= band.high))
    parts = np.array([np.interp(log, np.log(curve[0]), one) for one in curve[3:]])
    true = parts[:SENSORS] + 1j * parts[SENSORS:]
    off = np.delete(found.mode.shape - true, row, axis=0)
    reach = np.delete(found.mode.shape_half, row, axis=0)
    stuck_shape = np.repeat((curve[3 : 3 + SENSORS, :1] + 1j * curve[3 + SENSORS :, :1]), len(log), axis=1)
    small = (found.onset.frequency, found.onset.damping)
    onset = found.onset.amplitude
    first = drawn.joint.limits.min() / abs(drawn.at_joint[number]) * abs(drawn.shapes[drawn.sensors[row], number])
    first = first * drawn.omega[number] ** 2
    return Outcome(
        drawn.law,
        inside[0],
        inside[1],
        (float(small[0].value / stuck[0] - 1), float(small[1].value / stuck[1] - 1)),
        tuple(bool(one.low <= true <= one.high) for one, true in zip(small, stuck, strict=True)),
        bool(onset.low <= first <= onset.high),
        found.onset.seen,
        np.concatenate([np.abs(off.real) <= reach, np.abs(off.imag) <= reach]),
        _mac(found.mode.shape, true),
        _mac(true, stuck_shape),
    )


def outcomes(seed: int, number: int) -> list[Outcome]:
    """All modes of draw ``number``; the laws take turns."""
    rng = np.random.default_rng([seed, number])
    drawn = structure(rng, ("masing", "iwan")[number % 2])
    band = 0.8 * drawn.omega[0] / (2 * np.pi), 1.2 * drawn.omega[-1] / (2 * np.pi)
    return [judged(drawn, one) for one in ring_down_modes(measured(rng, drawn), band)]


def summary(found: list[Outcome]) -> str:
    """Coverage by law."""
    lines = [
        f"{'':8s}{'modes':>7s}{'points':>8s}{'f inside':>10s}{'zeta':>8s}{'f(0)':>8s}{'zeta(0)':>9s}{'onset':>8s}{'seen':>6s}"
        f"{'|df| Hz/Hz':>12s}{'|dzeta|':>9s}{'shape':>8s}{'least MAC':>11s}{'of stuck':>10s}"
    ]
    for law in ("masing", "iwan", "all"):
        some = [one for one in found if law in (one.law, "all")]
        if some:
            points = np.concatenate([one.frequency for one in some]), np.concatenate([one.damping for one in some])
            limits, errors = np.array([one.limits for one in some]), np.abs([one.errors for one in some])
            lines.append(
                f"{law:8s}{len(some):7d}{len(points[0]):8d}{points[0].mean():10.1%}{points[1].mean():8.1%}"
                f"{limits[:, 0].mean():8.0%}{limits[:, 1].mean():9.0%}{np.mean([one.onset for one in some]):8.0%}"
                f"{sum(one.seen for one in some):6d}{np.median(errors[:, 0]):12.1e}{np.median(errors[:, 1]):9.3f}"
                f"{np.concatenate([one.shape.ravel() for one in some]).mean():8.1%}"
                f"{min(one.mac.min() for one in some):11.5f}{min(one.stuck_mac.min() for one in some):10.5f}"
            )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=20, help="structures to draw")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    found: list[Outcome] = []
    for number in range(given.n):
        for one in outcomes(given.seed, number):
            found.append(one)
            print(
                f"{number:4d}  {one.law:8s} {len(one.frequency):3d} points, f {one.frequency.mean():5.0%}, zeta "
                f"{one.damping.mean():5.0%}, limits {one.errors[0]:+.1e} {one.errors[1]:+.3f} {one.limits}, onset "
                f"{one.onset} {'seen' if one.seen else ''}, shape {one.shape.mean():5.0%}, MAC {one.mac.min():.5f}, of "
                f"stuck {one.stuck_mac.min():.5f}",
                flush=True,
            )
    print(summary(found))


if __name__ == "__main__":
    main()
