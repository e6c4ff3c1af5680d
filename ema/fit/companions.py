"""Modes that may be parts of one resonance: what a linear fit makes of a joint that slips under the impact."""

from itertools import combinations

import numpy as np
from jaxtyping import Bool, Int
from scipy.sparse.csgraph import connected_components

from ema.data import Finding, ModalModel
from ema.shapes import auto_mac, modal_phase_collinearity

_LIKE = 0.4
"""MAC from which on the shapes of overlapping modes count as alike. The parts of one resonance share a shape with other
weights over the points: halved, its unit tests pass, doubled, the parts of a slipping joint are missed."""
_COLLINEAR = 0.8
"""Modal phase collinearity (1 for a real shape, Pappa et al. 1993) below which a shape is no real mode's."""
_FEWEST = 6
"""DOFs from which on like shapes say something: of two random real shapes over six, 13 % have a MAC of `_LIKE`, over
three, 37 % (beta distribution)."""
_TWO_MODES = 0.04
"""Second over first singular value of the joint residue of two modes from which on they are two. The parts of one
resonance share the participation, and their joint residue has rank one: of slipping joints on a table, struck at twenty
points with two accelerometers, 18 pairs had 0.022 at most, of double roots of plates 19 pairs had 0.066 at least."""


def companions(model: ModalModel) -> tuple[Finding, ...]:
    """A finding for each group of modes that overlap in frequency and look alike, where shapes are not real.

    A joint that slips at first and sticks in the late ring-down answers with a frequency and damping that change on the
    way; a linear model takes several poles for that one resonance, with shares of one shape and phases between them.
    Two true modes that are near each other, as those of an absorber, have shapes that stay real. The modes of a group
    have any shapes of the space that they span, complex ones too: they are not judged by these, nor are two modes whose
    joint residue has rank two.
    """
    if len(model.dofs) < _FEWEST or len(model.poles) < 2:
        return ()
    complex_shape = modal_phase_collinearity(model.shapes) < _COLLINEAR
    linked = _overlapping(model) & (np.nan_to_num(auto_mac(model.shapes)) >= _LIKE)
    for group in model.groups:
        linked[list(group)] = linked[:, list(group)] = False
    for pair in combinations(range(len(model.poles)), 2):
        if linked[pair] and _two_modes(model, list(pair)):
            linked[pair] = linked[pair[::-1]] = False
    groups, group = connected_components(linked, directed=False)
    found = []
    for number in range(groups):
        modes = np.flatnonzero(group == number)
        if len(modes) > 1 and complex_shape[modes].any():
            found.append(_finding(model, modes))
    return tuple(found)


def _overlapping(model: ModalModel) -> Bool[np.ndarray, "mode mode"]:
    """Whether the half-power bands of two modes touch."""
    decay = -model.poles.real
    frequency = model.poles.imag
    return np.asarray(np.abs(frequency[:, None] - frequency) <= decay[:, None] + decay)


def _two_modes(model: ModalModel, pair: list[int]) -> bool:
    """Whether the joint residue of two modes has rank two."""
    values = np.linalg.svd(model.shapes[:, pair] @ model.participation[:, pair].T, compute_uv=False)
    return len(values) > 1 and bool(values[1] > _TWO_MODES * values[0])


def _finding(model: ModalModel, modes: Int[np.ndarray, "part"]) -> Finding:
    frequencies, damping = model.natural_frequencies[modes], 100 * model.damping_ratios[modes]
    least = int(np.argmin(damping))
    listed = ", ".join(f"{f:.1f} Hz {z:.2g} %" for f, z in zip(frequencies, damping, strict=True))
    numbers = ", ".join(str(mode + 1) for mode in modes)
    where = f"{model.name or 'fit'}, modes {numbers}"
    return Finding.of(
        "warning",
        "one-resonance-in-parts",
        where,
        "These modes overlap and share a shape that is not real ({listed}): they may be one resonance whose frequency "
        "and damping change with amplitude, as where a joint slips under the impact. The least damped one, {least} Hz, "
        "is then that of small amplitudes.",
        float(len(modes)),
        1.0,
        advice="Compare soft and hard impacts, read the ring-down over amplitude, or sweep at constant force.",
        listed=listed,
        least=f"{frequencies[least]:.1f}",
    )
