"""Resonances over force level and normal force: backbone and damping map, from harmonic balance alone."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ema.data import BeamModel, ModalMap, Provenance
from ema.dof import Dof
from ema.errors import InputError
from ema.progress import Progress, advance, silent
from ema.simulate.harmonic import Branch, Condensed, _Point, condense


@dataclass(frozen=True)
class Resonance:
    """The largest response in a band: frequency Hz, complex amplitude of the response in m, equivalent damping ratio.

    ``damping`` is the energy lost per cycle over 4 pi times the largest kinetic energy of the first harmonic;
    ``modal_amplitude`` is mass-normalised, m sqrt(kg); ``error_estimate`` that of the amplitude, relative.
    """

    frequency: float
    amplitude: complex
    damping: float
    modal_amplitude: float
    error_estimate: float


def resonance(
    model: BeamModel, force: float, at: Dof | str, output: Dof | str, band: tuple[float, float],
    tolerance: float = 5e-3, modes: int | None = None, coarse: int = 40,
) -> Resonance:  # fmt: skip
    """Frequency and height of the largest response of ``output`` in a band at one force level.

    Parameters
    ----------
    force : amplitude in N at DOF ``at``; ``band`` in Hz.
    coarse : number of frequencies of the first pass; the peak is then refined to 1e-4 of its frequency.

    Raises
    ------
    InputError : the band is empty, nothing was found in it.
    """
    if not 0 < band[0] < band[1]:
        raise InputError("not a band", where=model.name, got=f"{band[0]} to {band[1]} Hz", expected="0 < low < high")
    return _peak(condense(model, force, at, [output], tolerance, modes), band, coarse)


def _peak(condensed: Condensed, band: tuple[float, float], coarse: int) -> Resonance:
    rows = np.array([condensed.problem.base.row(condensed.problem.system, condensed.problem.outputs[0])])
    found: dict[float, tuple[float, _Point]] = {}

    def height(frequency: float, start: np.ndarray | None) -> float:
        point = condensed.solve(frequency, start)
        if point is None:
            return -np.inf
        value = float(np.abs(condensed.outputs(point, rows)[0, 0]))
        found[frequency] = (value, point)
        return value

    branch = Branch(condensed.tolerance)
    for frequency in np.geomspace(*band, coarse):
        if height(float(frequency), branch.start(float(frequency))) > -np.inf:
            branch.add(found[float(frequency)][1])
    if not found:
        raise InputError("no steady state in the band", where=condensed.problem.system.name, got=f"{band} Hz",
                         advice="use the time solver")  # fmt: skip
    for _ in range(30):
        places = sorted(found)
        best = max(places, key=lambda f: found[f][0])
        index = places.index(best)
        if index in (0, len(places) - 1):
            break
        low, high = places[index - 1], places[index + 1]
        if high - low < 2e-4 * best:
            break
        guess = _parabola(low, best, high, *(1 / found[f][0] ** 2 for f in (low, best, high)))
        closest = 5e-5 * best
        if abs(guess - best) < closest:
            guess = best + np.copysign(max(closest, 0.2 * max(high - best, best - low)), (high - best) - (best - low))
        height(float(np.clip(guess, low + 0.05 * (high - low), high - 0.05 * (high - low))), found[best][1].amplitudes)
    best = max(found, key=lambda f: found[f][0])
    return _resonance(condensed, best, found[best][1], rows)


def _parabola(a: float, b: float, c: float, fa: float, fb: float, fc: float) -> float:
    """Abscissa of the vertex through three points; the middle one where they are in line."""
    top = (b - a) ** 2 * (fb - fc) - (b - c) ** 2 * (fb - fa)
    bottom = (b - a) * (fb - fc) - (b - c) * (fb - fa)
    return b - 0.5 * top / bottom if bottom != 0 else b


def _resonance(condensed: Condensed, frequency: float, point: _Point, rows: np.ndarray) -> Resonance:
    omega = 2 * np.pi * frequency
    q = condensed.modal(point)[0]
    kinetic = 0.5 * omega**2 * float(np.sum(np.abs(q) ** 2))
    _, friction, damping = condensed.powers(point)
    lost = (friction + damping) * 2 * np.pi / omega
    amplitude = complex((rows @ q)[0])
    return Resonance(
        frequency, amplitude, lost / (4 * np.pi * kinetic), float(np.sqrt(np.sum(np.abs(q) ** 2))), point.error
    )


def backbone(
    model: BeamModel, forces: Sequence[float] | Float[np.ndarray, "level"], at: Dof | str, output: Dof | str,
    band: tuple[float, float],
    tolerance: float = 5e-3, modes: int | None = None, progress: Progress = silent,
) -> tuple[Resonance, ...]:  # fmt: skip
    """Resonance at every force level of ``forces`` (N): how frequency and damping depend on amplitude."""
    result = []
    for number, force in enumerate(forces):
        advance(progress, "backbone", number, len(forces))
        result.append(resonance(model, float(force), at, output, band, tolerance, modes))
    return tuple(result)


def homogeneous(model: BeamModel) -> bool:
    """Whether x(c F_E, c F_N) = c x(F_E, F_N): constant k_T and no velocity scale in any law."""
    return all(joint.law.stiffness_exponent == 0 and joint.law.name not in ("lugre",) for joint in model.joints)


def damping_map(
    model: BeamModel, force_levels: Sequence[float] | Float[np.ndarray, "level"],
    normal_forces: Sequence[float] | Float[np.ndarray, "normal"], at: Dof | str, output: Dof | str,
    band: tuple[float, float], tolerance: float = 5e-3, modes: int | None = None, progress: Progress = silent,
) -> ModalMap:  # fmt: skip
    """Resonance frequency and equivalent damping over (F_E, F_N): ``ModalMap`` of the kind ``frozen``.

    ``normal_forces`` N are given to every joint. Where the model is homogeneous, equal ratios F_N/F_E are computed
    once and scaled.
    """
    levels, normals = np.asarray(force_levels, dtype=float), np.asarray(normal_forces, dtype=float)
    shape = (len(levels), len(normals))
    frequency, damping, amplitude = np.full(shape, np.nan), np.full(shape, np.nan), np.full(shape, np.nan)
    scaled = homogeneous(model)
    known: dict[float, Resonance] = {}
    done = 0
    for column, normal in enumerate(normals):
        for row, level in enumerate(levels):
            advance(progress, "damping map", done, frequency.size)
            done += 1
            key = float(f"{normal / level:.9g}")
            if not (scaled and key in known):
                if not scaled:
                    known.clear()
                at_ratio = model.with_normal_force(normal)
                known[key] = resonance(at_ratio, level, at, output, band, tolerance, modes, 24)
                if scaled:
                    known[key] = _per_newton(known[key], level)
            point = known[key]
            frequency[row, column], damping[row, column] = point.frequency, point.damping
            amplitude[row, column] = point.modal_amplitude * (level if scaled else 1.0)
    joints = np.broadcast_to(normals[None, :, None], (*shape, len(model.joints)))
    return ModalMap(
        levels, normals, frequency, damping, force_at_resonance=np.broadcast_to(levels[:, None], shape),
        modal_amplitude=amplitude, joint_forces=joints, joints=tuple(joint.name for joint in model.joints),
        method="frozen", name=model.name,
        provenance=Provenance(
            options=(("tolerance", str(tolerance)), ("homogeneity", str(scaled))), steps=("damping_map",)
        ),
    )  # fmt: skip


def _per_newton(point: Resonance, level: float) -> Resonance:
    return Resonance(
        point.frequency, point.amplitude / level, point.damping, point.modal_amplitude / level, point.error_estimate
    )


def damping_rule(slip_stiffness: float, slip_shape: float, frequency: float) -> float:
    """Largest damping that a Masing contact adds to a mode, kappa / (2 pi (1 + kappa/2)), kappa = k psi^2 / w^2.

    ``slip_stiffness`` k N/m (contact and beam in series), ``slip_shape`` psi the mass-normalised modal relative
    displacement, ``frequency`` Hz of the mode. Power balance at the amplitude 2 F_C/k, Masing's describing function.
    """
    kappa = slip_stiffness * slip_shape**2 / (2 * np.pi * frequency) ** 2
    return float(kappa / (2 * np.pi * (1 + kappa / 2)))


def slip_force_rule(added: float, total: float, force: float, shape_at_force: float, slip_shape: float) -> float:
    """Slip force mu F_N in N of most damping under a harmonic force: (pi/2) (dzeta/zeta) F_E phi_e/psi."""
    return float(np.pi / 2 * added / total * force * shape_at_force / slip_shape)


def placement_index(
    stuck: Float[np.ndarray, "place"], sliding: Float[np.ndarray, "place"]
) -> Float[np.ndarray, "place"]:
    """Linear estimate of the damping a joint can add, from the natural frequencies with it stuck and sliding (Hz)."""
    return (stuck**2 - sliding**2) / (np.pi * (stuck**2 + sliding**2))
