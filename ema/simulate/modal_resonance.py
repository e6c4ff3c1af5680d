"""The mode's own resonance under a force: where its modal force is in quadrature with its modal coordinate."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex

from ema.errors import InputError
from ema.simulate.harmonic import Condensed, _Point

STEP = 1e-6
"""Relative step of the frequency below which it counts as that of quadrature: a hundredth of the least standard
deviation that a fit of clean FRFs states (1e-4). Twice as large it saves no solution; the secant ends far below."""
REACH = 12.0
"""Half-power half bandwidths on either side of the largest response within which quadrature is expected. Where modes
one bandwidth apart overlap it lies within three of them; with half the reach strongly softening joints are lost."""
_MOST_STEPS = 25


@dataclass(frozen=True)
class EquivalentMode:
    """A mode of the structure whose contacts are replaced by their first harmonic at one steady state.

    ``square`` rad^2/s^2: eigenvalue, whose real part is the squared frequency of quadrature and whose imaginary part is
    twice the damping ratio times the squared angular frequency; ``amplitude`` m sqrt(kg): modal coordinate; ``shape``
    (mode,): in the modes of the stuck structure, with shape @ shape = 1.
    """

    square: complex
    amplitude: float
    shape: Complex[np.ndarray, "mode"]


def equivalent_mode(
    condensed: Condensed, point: _Point, like: Complex[np.ndarray, "mode"] | None = None
) -> EquivalentMode:
    """The mode that answers most at a steady state, or the one with a shape most ``like`` another.

    With contact forces -f against relative displacements u, the first harmonic obeys (A - w^2) q = p, where
    A = diag(w_r^2) + i w C + S^T diag(f/u) S is complex symmetric. Its eigenvectors, psi^T psi = 1, take the other
    modes' share off: (psi^T A psi - w^2) psi^T q = psi^T p, so psi^T p and psi^T q are in quadrature where
    Re(psi^T A psi) = w^2, and the mean power supplied, w Im(psi^T A psi) |psi^T q|^2 / 2, is that of the damping ratio
    Im(psi^T A psi) / (2 w^2).

    Source: power as in Scheel, Peter, Leine and Krack (2018), J. Sound Vib. 435, 66-84; first harmonics of friction as
    in any describing function.
    """
    base, at = condensed.problem.base, condensed.excited
    moved = point.amplitudes[:, 2 * at] - 1j * point.amplitudes[:, 2 * at + 1]
    force = point.forces[:, 2 * at] - 1j * point.forces[:, 2 * at + 1]
    rests = np.abs(moved) <= 1e-12 * max(float(np.abs(moved).max(initial=0.0)), 1e-300)
    secant = np.where(rests, 0.0, force / np.where(rests, 1.0, moved))
    damping = np.diag(base.decay) if base.damping is None else base.damping
    matrix = np.diag(base.frequencies**2) + 1j * point.omega * damping + (base.slip.T * secant) @ base.slip
    squares, shapes = np.linalg.eig(matrix)
    shapes = shapes / np.sqrt(np.sum(shapes**2, axis=0))
    answer = condensed.modal(point)[at]
    share = np.abs(shapes.T @ answer) if like is None else np.abs(shapes.T @ like)
    row = int(np.argmax(share))
    return EquivalentMode(complex(squares[row]), float(np.abs(shapes[:, row] @ answer)), shapes[:, row])


def quadrature(condensed: Condensed, near: float, point: _Point) -> tuple[float, _Point, EquivalentMode]:
    """Frequency in Hz, steady state and mode where the mode that answers most at ``near`` Hz is in quadrature.

    Parameters
    ----------
    point : steady state at ``near``.

    Raises
    ------
    InputError : no steady state, or no quadrature near the largest response.
    """
    mode = equivalent_mode(condensed, point)
    reach = REACH * near * max(mode.square.imag / (2 * mode.square.real), STEP)

    def off(frequency: float) -> float:
        """Distance in Hz between the mode's frequency at a steady state and that of the force."""
        return float(np.sqrt(max(mode.square.real, 0.0))) / (2 * np.pi) - frequency

    before, frequency = (near, off(near)), near + off(near)
    for _ in range(_MOST_STEPS):
        if not abs(frequency - near) <= reach:
            break
        found = condensed.solve(frequency, point.amplitudes)
        if found is None:
            break
        point, mode = found, equivalent_mode(condensed, found, mode.shape)
        rest = off(frequency)
        if abs(rest) <= STEP * near:
            return frequency, point, mode
        slope = (rest - before[1]) / (frequency - before[0]) if frequency != before[0] else -1.0
        before, frequency = (frequency, rest), frequency - rest / min(slope, -0.1)
    raise InputError(
        "no resonance of the mode", where=condensed.problem.system.name,
        got=f"no quadrature of modal force and modal coordinate within {reach:.3g} Hz of {near:.6g} Hz",
        expected="one", advice="look at the FRF at this force: modes interact there, or the response jumps",
    )  # fmt: skip
