"""Synthetic FRFs with known truth: viscous, non-proportional, reciprocal systems drawn from a seed."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ema.data import FrfSet, ModalModel
from ema.dof import Dof
from ema.synthesis import pole_basis

COUPLING = 0.3
"""Share of the modal damping matrix that couples the modes (what makes the damping non-proportional)."""


@dataclass(frozen=True)
class Case:
    """Noisy FRFs and the truth behind them.

    Parameters
    ----------
    frfs : accelerance with noise, (freq, out, in).
    clean : the same values without noise.
    noise_std : complex standard deviation of the noise, sqrt(E|n|^2), (freq, out, in).
    truth : the modes inside the band.
    outside : the modes outside the band; with ``truth`` they give ``clean`` exactly.
    """

    name: str
    seed: int
    noise: float
    frfs: FrfSet
    clean: np.ndarray
    noise_std: np.ndarray
    truth: ModalModel
    outside: ModalModel

    @property
    def band(self) -> tuple[float, float]:
        """First and last line in Hz."""
        return float(self.frfs.frequencies[0]), float(self.frfs.frequencies[-1])

    @cached_property
    def spacing(self) -> np.ndarray:
        """Distance in Hz of each mode of ``truth`` to its nearest neighbour, in or out of the band, (mode,)."""
        own = self.truth.natural_frequencies
        everything = np.concatenate([own, self.outside.natural_frequencies])
        distance = np.abs(own[:, None] - everything[None, :])
        distance[np.arange(len(own)), np.arange(len(own))] = np.inf
        return distance.min(axis=1)


def case_160(lines: int = 1601, noise: float = 0.01, seed: int = 0) -> Case:
    """80 outputs x 2 references, 20 modes in 100-900 Hz: a pair 0.4 % apart, one mode with 5 % damping, strong modes
    5 % outside the band on both sides.
    """
    rng = np.random.default_rng([160, seed])
    frequencies = np.linspace(100.0, 900.0, lines)
    inside = _spread(rng, 20, 100.0, 900.0)
    pair = int(rng.integers(2, 17))
    inside[pair + 1] = 1.004 * inside[pair]
    damping = _log_uniform(rng, 0.002, 0.015, 20)
    heavy = int(rng.choice([mode for mode in range(2, 18) if mode not in (pair, pair + 1)]))
    damping[heavy] = 0.05
    return _case("160 FRFs", seed, noise, frequencies, rng, inside, damping, outputs=80, references=2, beyond=0.05)


def case_small(lines: int = 401, noise: float = 0.01, seed: int = 0) -> Case:
    """8 outputs x 2 references, 5 modes in 100-500 Hz: a pair 1.5 % apart, one mode with 5 % damping, modes 5 % outside
    the band on both sides: small enough for thousands of draws.
    """
    rng = np.random.default_rng([16, seed])
    frequencies = np.linspace(100.0, 500.0, lines)
    inside = _spread(rng, 5, 100.0, 500.0)
    pair = int(rng.integers(1, 3))
    inside[pair + 1] = 1.015 * inside[pair]
    damping = _log_uniform(rng, 0.003, 0.008, 5)
    damping[int(rng.choice([mode for mode in range(1, 5) if mode not in (pair, pair + 1)]))] = 0.05
    return _case("16 FRFs", seed, noise, frequencies, rng, inside, damping, outputs=8, references=2, beyond=0.05)


def case_large(lines: int = 4096, noise: float = 0.01, seed: int = 0) -> Case:
    """300 outputs x 3 references, 60 modes in 200-2200 Hz: four pairs 0.3-0.6 % apart, two modes with 5 % damping,
    strong modes 5 % outside the band on both sides.
    """
    rng = np.random.default_rng([900, seed])
    frequencies = np.linspace(200.0, 2200.0, lines)
    inside = _spread(rng, 60, 200.0, 2200.0)
    pairs = 2 + 14 * np.arange(4) + rng.integers(0, 11, 4)
    inside[pairs + 1] = inside[pairs] * (1 + rng.uniform(0.003, 0.006, 4))
    damping = _log_uniform(rng, 0.002, 0.01, 60)
    alone = np.setdiff1d(np.arange(2, 58), np.concatenate([pairs, pairs + 1]))
    damping[rng.choice(alone, 2, replace=False)] = 0.05
    return _case("900 FRFs", seed, noise, frequencies, rng, inside, damping, outputs=300, references=3, beyond=0.05)


def random_system(
    seed: int,
    noise: float | None = None,
    modes: int | None = None,
    outputs: int | None = None,
    references: int | None = None,
    lines: int | None = None,
    largest: int = 2_000_000,
) -> Case:
    """One draw of the distribution on which the automatic selection is scored.

    5-60 modes; gaps uniform in 0.4-1.6 of the mean, every tenth 0.3-1 % of the frequency; damping log-uniform in
    0.05-10 %; one mode in ten local (seen in a tenth of the outputs); 8-500 outputs, 1-4 references; one to three modes
    on each side of the band, the nearest 2-20 % outside; noise of 0.1, 1 or 5 % unless given.

    Parameters
    ----------
    largest : most complex values in the block; fewer outputs are drawn again where it would be exceeded.
    """
    rng = np.random.default_rng([7, seed])
    modes = int(rng.integers(5, 61)) if modes is None else modes
    drawn_references, drawn_outputs = int(rng.integers(1, 5)), int(np.exp(rng.uniform(np.log(8), np.log(501))))
    references = drawn_references if references is None else references
    lines = int(rng.choice([801, 1601, 3201])) if lines is None else lines
    outputs = min(drawn_outputs, max(8, largest // (lines * references))) if outputs is None else outputs
    noise = float(rng.choice([0.001, 0.01, 0.05])) if noise is None else noise
    high = float(np.exp(rng.uniform(np.log(100), np.log(5000))))
    low = high * float(rng.uniform(0.03, 0.4))
    inside = _spread(rng, modes, low, high)
    for gap in range(int(rng.integers(10)), modes - 1, 10):
        inside[gap + 1] = inside[gap] * (1 + rng.uniform(0.003, 0.01))
    damping = _log_uniform(rng, 0.0005, 0.1, modes)
    return _case(
        "random",
        seed,
        noise,
        np.linspace(low, high, lines),
        rng,
        inside,
        damping,
        outputs,
        references,
        beyond=float(rng.uniform(0.02, 0.2)),
        neighbours=int(rng.integers(1, 4)),
        local=0.1,
        strength=1.0,
    )


def _case(
    name: str,
    seed: int,
    noise: float,
    frequencies: np.ndarray,
    rng: np.random.Generator,
    inside: np.ndarray,
    damping: np.ndarray,
    outputs: int,
    references: int,
    beyond: float,
    neighbours: int = 1,
    local: float = 0.0,
    strength: float = 3.0,
) -> Case:
    """The case of the given modes; ``neighbours`` modes of ``strength`` on each side, the nearest ``beyond`` outside."""
    low, high = frequencies[0], frequencies[-1]
    steps = beyond * (1 + np.arange(neighbours))
    outside = np.concatenate([low * (1 - beyond) ** (1 + np.arange(neighbours)), high * (1 + steps)])
    natural = np.concatenate([inside, outside])
    zeta = np.concatenate([damping, _log_uniform(rng, 0.005, 0.015, len(outside))])
    places = np.sort(rng.choice(outputs, min(references, outputs), replace=False))
    shapes = _plate_shapes(rng, outputs, natural, places, round(local * len(inside)), len(inside))
    shapes[:, len(inside) :] *= strength
    poles, complex_shapes = _complex_modes(rng, natural, zeta, shapes)
    within = (np.abs(poles) >= 2 * np.pi * low) & (np.abs(poles) <= 2 * np.pi * high)
    truth, rest = (_model(poles[keep], complex_shapes[:, keep], places, name) for keep in (within, ~within))
    clean = _accelerance(truth, frequencies) + _accelerance(rest, frequencies)
    std = noise_std(clean, noise)
    values = clean + std * unit_noise(rng, clean.shape)
    frfs = FrfSet(
        frequencies=frequencies,
        values=values,
        outputs=truth.dofs,
        inputs=truth.inputs,
        quantity="accelerance",
        unit="m/s^2/N",
        estimator="synthetic",
        name=f"{name}, seed {seed}",
    )
    return Case(name, seed, noise, frfs, clean, std, truth, rest)


def noise_std(clean: np.ndarray, noise: float) -> np.ndarray:
    """Complex standard deviation of ``noise``: of |H| at each line plus of that FRF's rms over the band."""
    magnitude = np.abs(clean)
    return noise * (magnitude + np.sqrt(np.mean(magnitude**2, axis=0, keepdims=True)))


def unit_noise(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Circular complex noise with E|n|^2 = 1."""
    return np.sqrt(0.5) * rng.standard_normal((*shape, 2)).view(np.complex128)[..., 0]


def _log_uniform(rng: np.random.Generator, low: float, high: float, count: int) -> np.ndarray:
    return np.exp(rng.uniform(np.log(low), np.log(high), count))


def _spread(rng: np.random.Generator, count: int, low: float, high: float) -> np.ndarray:
    """Frequencies inside the band with gaps uniform in 0.4-1.6 of their mean (half a gap at the band edges)."""
    gaps = rng.uniform(0.4, 1.6, count + 1)
    gaps[[0, -1]] *= 0.5
    return low + (high - low) * np.cumsum(gaps)[:-1] / gaps.sum()


def _plate_shapes(
    rng: np.random.Generator, outputs: int, natural: np.ndarray, places: np.ndarray, local: int, inside: int
) -> np.ndarray:
    """Real shapes (dof, mode) of a plate with a 10 % random part; ``local`` of the first ``inside`` modes live in the
    tenth of the outputs nearest to a reference.
    """
    columns = int(np.ceil(np.sqrt(1.25 * outputs)))
    y, x = np.divmod(np.arange(outputs), columns)
    x, y = (x + 0.5) / columns, (y + 0.5) / np.ceil(outputs / columns)
    waves = np.stack(np.meshgrid(np.arange(20), np.arange(20), indexing="ij"), -1).reshape(-1, 2)
    ascending = np.argsort(waves[:, 0] ** 2 + (rng.uniform(0.8, 1.6) * waves[:, 1]) ** 2)[3:]
    rank = np.argsort(np.argsort(natural))
    across, along = waves[ascending[rank]].T
    shapes = np.cos(np.pi * np.outer(x, across)) * np.cos(np.pi * np.outer(y, along))
    shapes /= np.sqrt(np.mean(shapes**2, axis=0)) + 1e-12
    shapes += 0.1 * rng.standard_normal(shapes.shape)
    for mode in rng.choice(inside, local, replace=False):
        centre = rng.choice(places)
        distance = np.hypot(x - x[centre], y - y[centre])
        shapes[np.argsort(distance)[max(1, round(outputs / 10)) :], mode] = 0.0
    return shapes


def _complex_modes(
    rng: np.random.Generator, natural: np.ndarray, zeta: np.ndarray, shapes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Poles (rad/s) and complex shapes, scaled to unit modal mass, of M = 1, K = diag(w^2) and a full damping matrix.

    The damping matrix D^(1/2) [(1 - c) 1 + c P] D^(1/2) with a random correlation matrix P keeps the modal damping
    2 zeta w on its diagonal and is positive definite, so the system is real, stable and reciprocal.
    """
    omega, count = 2 * np.pi * natural, len(natural)
    factors = rng.standard_normal((count, count))
    factors /= np.linalg.norm(factors, axis=1, keepdims=True)
    scale = np.sqrt(2 * zeta * omega)
    damping = ((1 - COUPLING) * np.eye(count) + COUPLING * factors @ factors.T) * np.outer(scale, scale)
    zero, one = np.zeros((count, count)), np.eye(count)
    poles, vectors = np.linalg.eig(np.block([[zero, one], [-np.diag(omega**2), -damping]]))
    keep = np.flatnonzero(poles.imag > 0)
    keep = keep[np.argsort(np.abs(poles[keep]))]
    poles, vectors = poles[keep], vectors[:count, keep]
    modal_a = np.einsum("mr,mr->r", vectors, 2 * poles * vectors + damping @ vectors)
    return poles, (shapes @ vectors) * np.sqrt(2j * poles.imag / modal_a)


def _model(poles: np.ndarray, shapes: np.ndarray, places: np.ndarray, name: str) -> ModalModel:
    dofs = tuple(Dof(node, "+Z") for node in range(1, len(shapes) + 1))
    return ModalModel(
        poles=poles,
        shapes=shapes,
        dofs=dofs,
        participation=shapes[places] / (2j * poles.imag),
        inputs=tuple(dofs[place] for place in places),
        scaling="unit modal mass",
        name=name,
    )


def _accelerance(model: ModalModel, frequencies: np.ndarray) -> np.ndarray:
    """Accelerance of all modes, (freq, out, in)."""
    direct, mirrored = pole_basis(frequencies, model.poles)
    residues = model.residues()
    flat = residues.reshape(len(residues), len(model.dofs) * len(model.inputs))
    factor = ((2j * np.pi * frequencies) ** 2)[:, None]
    return ((factor * direct) @ flat + (factor * mirrored) @ flat.conj()).reshape(-1, *residues.shape[1:])
