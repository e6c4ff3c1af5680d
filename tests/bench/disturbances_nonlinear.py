"""A structure that is not linear, measured with stepped sine: a softening mode, and a joint that slips."""

from dataclasses import replace
from functools import partial

import numpy as np

from tests.bench.disturbances import HIGH, LINES, LOW, MODES, OUTPUTS, Disturbed, Row, _redamped, noisy, structure


def curved(rng: np.random.Generator, strength: float, drop: float = 0.0) -> Disturbed:
    """One mode softens with its amplitude: its frequency falls by ``strength`` half-power bandwidths up to the peak.

    Stepped sine of constant force, or of a shaker whose force the mode pulls down by 1 + ``drop`` at resonance. The
    fundamental of the modal coordinate obeys q (w0^2 - b |q|^2 - w^2 + 2j z w0 w) = p, so that x = |q|^2 is a root of
    x [(w0^2 - w^2 - b x)^2 + (2 z w0 w)^2] = |p|^2; the smallest real root is taken.
    """
    case = _redamped(structure(rng), 1.0)
    mode = int(rng.integers(MODES))
    omega, zeta = np.abs(case.truth.poles[mode]), case.truth.damping_ratios[mode]
    w = 2 * np.pi * case.frfs.frequencies
    # The shaker pulls its force F = V - Z j w q down, Z = drop * 2 zeta w0: the amplitude is that of 1 + drop times the loss.
    # Generator 1: |q|^2 at the peak is about 1 / (2 zeta (1 + drop) w0^2)^2; there w^2 has moved by 2 w0 times the shift.
    soft = 2 * omega**2 * (strength * 2 * zeta) * (2 * zeta * (1 + drop) * omega**2) ** 2
    size = np.empty(len(w))
    for line, (stiff, loss) in enumerate(zip(omega**2 - w**2, 2 * zeta * (1 + drop) * omega * w, strict=True)):
        flat = [1 / (stiff**2 + loss**2)]
        roots = np.roots([soft**2, -2 * soft * stiff, stiff**2 + loss**2, -1.0]) if soft else flat
        size[line] = min(float(np.real(x)) for x in roots if abs(np.imag(x)) <= 1e-6 * abs(x) and np.real(x) > 0)
    response = 1 / (omega**2 - soft * size - w**2 + 2j * zeta * omega * w)
    linear = 1 / (omega**2 - w**2 + 2j * zeta * omega * w)
    rows = [case.truth.dofs.index(dof) for dof in case.truth.inputs]
    shape = case.truth.shapes[:, mode]
    clean = case.clean + (-(w**2) * (response - linear))[:, None, None] * np.outer(shape, shape[rows])
    natural = case.truth.natural_frequencies
    low, high = natural.copy(), natural.copy()
    low[mode] = np.sqrt(max(omega**2 - soft * size.max(), 0)) / (2 * np.pi)
    damping = np.tile(case.truth.damping_ratios[:, None], 2)
    return Disturbed(noisy(rng, case, clean), np.array([low, high]).T, damping, residues=strength == 0)


def friction(rng: np.random.Generator, strength: float, lines: int = LINES) -> Disturbed:
    """A slider to ground (Jenkins element) that slips: ``strength`` is the largest joint amplitude over the slip limit.

    One harmonic: k = k_t [(t - sin(2t)/2) + j sin(t)^2] / pi with cos t = 1 - 2 a_s / a for amplitudes a above the slip
    limit a_s, k_t below (Griffin 1980). The joint displacement u = G F / (1 + G_dd k(|u|)) is one equation a line.
    """
    case = _redamped(structure(rng, lines), 1.0)
    poles = np.concatenate([case.truth.poles, case.outside.poles])
    shapes = np.concatenate([case.truth.shapes, case.outside.shapes], axis=1).real
    omega, zeta = np.abs(poles), -poles.real / np.abs(poles)
    row, joint = case.truth.dofs.index(case.truth.inputs[0]), int(rng.integers(OUTPUTS))
    phi = shapes[joint]
    stiffness = float(rng.uniform(0.3, 1.0)) * np.min(np.abs(np.diff(np.sort(omega**2)))) / np.max(phi**2)

    def poles_at(k: complex) -> np.ndarray:
        count = len(omega)
        upper = np.block(
            [
                [np.zeros((count, count)), np.eye(count)],
                [-np.diag(omega**2) - k * np.outer(phi, phi), -np.diag(2 * zeta * omega)],
            ]
        )
        found = np.linalg.eigvals(upper)
        found = found[np.argsort(-found.imag)][:count]
        return found[np.argsort(found.imag)]

    amplitude = np.concatenate([[0.5], np.geomspace(1.0, 200.0, 1500)])
    stiff = np.array([stiffness * jenkins(a) for a in amplitude])
    w = 2 * np.pi * case.frfs.frequencies
    modal = 1 / (omega**2 - w[:, None] ** 2 + 2j * zeta * omega * w[:, None])
    own, driven = modal @ phi**2, modal @ (phi * shapes[row])
    # Unit force makes the stuck joint move by `stuck`; the force is chosen so that the largest is `strength` slip limits.
    stuck = np.abs(driven / (1 + own * stiffness))
    level = strength / stuck.max()
    reached = np.empty(len(w))
    k = np.empty(len(w), complex)
    for line in range(len(w)):
        wanted = level * abs(driven[line])
        excess = amplitude * np.abs(1 + own[line] * stiff) - wanted
        above = np.flatnonzero(excess >= 0)
        first = int(above[0]) if len(above) else len(amplitude) - 1
        if first == 0:
            reached[line], k[line] = wanted / abs(1 + own[line] * stiffness), stiffness
            continue
        part = -excess[first - 1] / (excess[first] - excess[first - 1])
        reached[line] = amplitude[first - 1] + part * (amplitude[first] - amplitude[first - 1])
        k[line] = stiffness * jenkins(reached[line])
    force = -k * driven / (1 + own * k)
    receptance = modal @ (shapes * shapes[row]).T + force[:, None] * (modal @ (shapes * phi).T)
    clean = (-(w**2)[:, None] * receptance)[:, :, None]
    over = np.array([poles_at(stiffness * jenkins(a)) for a in np.linspace(0.5, max(reached.max(), 0.6), 60)])
    frequency = np.sort(np.abs(over), axis=1) / (2 * np.pi)
    ratio = -over.real / np.abs(over)
    order = np.argsort(np.abs(over[0]))
    inside = np.flatnonzero((frequency[0] >= LOW) & (frequency[0] <= HIGH))
    matched = ratio[:, order][:, inside]
    stuck_shapes = _shapes_at(omega, phi, shapes, stiffness)[:, inside]
    truth = replace(
        case.truth,
        poles=over[0][order][inside],
        shapes=stuck_shapes.astype(complex),
        participation=stuck_shapes[[row]] / (2j * over[0][order][inside].imag),
    )
    frequency = frequency[:, inside]
    made = replace(case, truth=truth)
    return Disturbed(
        noisy(rng, made, clean),
        np.array([frequency.min(axis=0), frequency.max(axis=0)]).T,
        np.array([matched.min(axis=0), matched.max(axis=0)]).T,
        residues=False,
    )


def jenkins(amplitude: float) -> complex:
    """Secant stiffness over k_t of a Jenkins element at ``amplitude`` slip limits, first harmonic."""
    if amplitude <= 1:
        return 1.0
    angle = np.arccos(1 - 2 / amplitude)
    return complex((angle - np.sin(2 * angle) / 2 + 1j * np.sin(angle) ** 2) / np.pi)


def _shapes_at(omega: np.ndarray, phi: np.ndarray, shapes: np.ndarray, stiffness: float) -> np.ndarray:
    """Undamped shapes with the joint stuck."""
    vectors = np.linalg.eigh(np.diag(omega**2) + stiffness * np.outer(phi, phi))[1]
    return shapes @ vectors


ROWS = (
    Row(
        "amplitude dependence",
        "fall of one frequency in half-power bandwidths",
        (0.0, 0.1, 0.3, 1.0, 3.0),
        curved,
        ("leaning-peak", "amplitude-dependence", "not-linear"),
    ),
    Row(
        "dependence, force drops",
        "the same, force 20 dB down at resonance",
        (0.0, 0.1, 0.3, 1.0, 3.0),
        partial(curved, drop=10.0),
        ("leaning-peak", "amplitude-dependence", "not-linear"),
    ),
    Row(
        "friction",
        "largest joint amplitude over the slip limit",
        (0.5, 1.3, 2.0, 4.0, 10.0),
        friction,
        ("leaning-peak", "amplitude-dependence", "not-linear"),
    ),
)
"""The disturbances by structures that are not linear. The first strength of each is none."""
