"""Modes of the structure with stuck joints, and how the contacts and forces see them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.linalg import eigh

from ema.dof import Dof
from ema.errors import InputError
from ema.simulate.structure import System

_UNCOUPLED, _NO_COUPLING = 1e-9, 1e-10
"""Share of the largest slip below which no contact sees a mode; coupling by damping, relative, that is rounding."""

_LOW = 1e-6
"""Share of the largest square of a natural frequency below which modes are found a second time among themselves: the
low ones then err by 1e-22 of it. With 1e-4 or 1e-8 the lowest modes of a plate with a beam move by 3e-9 at most."""


@dataclass(frozen=True)
class ModalBase:
    """Mass-normalised modes of the stuck structure.

    ``frequencies`` rad/s and ``decay`` 2 zeta w in 1/s (mode,); ``slip`` (contact, mode) u = slip @ q; ``shapes``
    (dof, mode).
    ``coupled`` says which modes the contacts see at all: the others stay linear. ``damping`` (mode, mode) in 1/s is
    the whole damping matrix where a measured host or lossy joints couple the modes by it; ``decay`` is its diagonal.
    """

    frequencies: Float[np.ndarray, "mode"]
    decay: Float[np.ndarray, "mode"]
    slip: Float[np.ndarray, "contact mode"]
    shapes: Float[np.ndarray, "dof mode"]
    coupled: np.ndarray
    damping: Float[np.ndarray, "mode mode"] | None = None

    def row(self, system: System, dof: Dof | str) -> Float[np.ndarray, "mode"]:
        """Modal row of a DOF."""
        return np.asarray(system.row(dof) @ self.shapes)


def stuck_stiffness(system: System, stiffness: Float[np.ndarray, "contact"]) -> Float[np.ndarray, "n n"]:
    """Stiffness matrix with the given contact springs in place."""
    return np.asarray(system.stiffness + system.contacts.slip.T @ (stiffness[:, None] * system.contacts.slip))


def natural_modes(
    stiffness: Float[np.ndarray, "n n"], mass: Float[np.ndarray, "n n"]
) -> tuple[Float[np.ndarray, "mode"], Float[np.ndarray, "n mode"]]:
    """Squares of the natural angular frequencies in ascending order, and mass-normalised shapes.

    The algorithm errs by rounding of the largest square, which rotary inertias and contact springs make 1e14 times the
    lowest. A second Rayleigh-Ritz step among the low modes errs by rounding of their own largest one (Parlett, The
    Symmetric Eigenvalue Problem, section 11.4).
    """
    squares, shapes = eigh(stiffness, mass)
    low = squares < _LOW * squares[-1]
    if low.any():
        part = shapes[:, low]
        squares[low], turned = eigh(part.T @ stiffness @ part, part.T @ mass @ part)
        shapes[:, low] = part @ turned
    return squares, shapes


def modal_base(
    system: System,
    stiffness: Float[np.ndarray, "contact"] | None = None,
    modes: int | None = None,
    loads: Sequence[Dof | str] = (),
) -> ModalBase:
    """Modes with contact springs ``stiffness`` (N/m; those of the laws by default).

    ``modes`` keeps that many of the lowest and adds one static correction for every contact and every load, so that
    the flexibility at the contacts stays exact; by default all modes are kept.

    Raises
    ------
    InputError : there are rigid-body modes whose frequency comes out imaginary, or damping is not physical.
    """
    springs = system.contacts.stiffness if stiffness is None else stiffness
    matrix, mass = stuck_stiffness(system, springs), system.mass
    transform = None
    if modes is not None and not (isinstance(modes, int | np.integer) and modes >= 0):
        raise InputError("not a number of modes", where=system.name, got=modes, expected="0 or more, a whole number")
    if modes is not None and modes + len(springs) + len(loads) < len(mass):
        transform = _with_static_correction(system, matrix, modes, loads)
        matrix, mass = transform.T @ matrix @ transform, transform.T @ mass @ transform
    squares, shapes = natural_modes(matrix, mass)
    if squares[0] < -1e-6 * squares[-1] or not np.all(np.isfinite(squares)):
        raise InputError(
            "the structure is unstable",
            where=system.name,
            got=f"lowest eigenvalue {squares[0]:g}",
            expected="no negative stiffness",
            advice="check the stiffness matrix",
        )
    rigid = squares < 1e-12 * squares[-1]
    frequencies = np.sqrt(np.where(rigid, 0.0, np.maximum(squares, 0.0)))
    shapes = shapes if transform is None else transform @ shapes
    slip = system.contacts.slip @ shapes
    seen = np.abs(slip).max(axis=0)
    settings = system.damping
    if not (0 <= settings.ratio < 1 and 0 <= settings.mass_factor < np.inf):
        raise InputError(
            "not a background damping", where=system.name, got=settings, expected="0 <= ratio < 1, factor >= 0"
        )
    damping = np.diag(2 * settings.ratio * frequencies + settings.mass_factor)
    if system.decay is not None:
        damping += shapes.T @ ((system.decay * np.diag(system.mass))[:, None] * shapes)
    if system.loss is not None:
        # 2 zeta w of a mode that loses the share eta of the energy stored in its contacts, and alike between modes
        root = np.sqrt(np.divide(1.0, frequencies, out=np.zeros_like(frequencies), where=frequencies > 0))
        damping += root[:, None] * (shapes.T @ system.loss @ shapes) * root
    decay = np.diag(damping).copy()
    rounding = _NO_COUPLING * (np.sqrt(np.outer(decay, decay)) + 1e-3 * decay.max())
    whole = damping if np.any(np.abs(damping - np.diag(decay)) > rounding) else None
    return ModalBase(frequencies, decay, slip, shapes, seen > _UNCOUPLED * seen.max(), whole)


def with_armature(
    system: System, base: ModalBase, at: Dof, armature: tuple[float, float], modes: int | None
) -> ModalBase:
    """Modes of a structure that carries a mass in kg and a damper in N s/m at a DOF; its own damping stays."""
    mass, damper = armature
    row = system.row(at)
    loaded = modal_base(replace(system, mass=system.mass + mass * np.outer(row, row)), modes=modes, loads=[at])
    own = np.diag(base.decay) if base.damping is None else base.damping
    seen, moved = base.shapes.T @ system.mass @ loaded.shapes, row @ loaded.shapes
    damping = seen.T @ own @ seen + damper * np.outer(moved, moved)
    return replace(loaded, decay=np.diag(damping).copy(), damping=damping)


def _with_static_correction(system: System, matrix: np.ndarray, modes: int, loads: Sequence[Dof | str]) -> np.ndarray:
    """Lowest modes and the static deflections under contact and load forces, orthonormal in the mass matrix."""
    low = eigh(matrix, system.mass, subset_by_index=(0, modes - 1))[1] if modes else np.zeros((len(matrix), 0))
    forces = np.vstack([system.contacts.slip, *[system.row(dof) for dof in loads]]).T
    shift = matrix + 1e-3 * np.trace(matrix) / np.trace(system.mass) * system.mass * 1e-6
    static = np.linalg.solve(shift, forces)
    for _ in range(2):
        static -= low @ (low.T @ (system.mass @ static))
    gram = static.T @ system.mass @ static
    scale = 1 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
    values, vectors = np.linalg.eigh(gram * np.outer(scale, scale))
    keep = values > 1e-10 * values[-1]
    return np.hstack([low, (static * scale) @ vectors[:, keep] / np.sqrt(values[keep])])
