"""Where the height of a peak tells its damping, and where it does not.

The height of a peak with the modal constant A' of its own condition and a share n of the neighbouring modes at its top
is |X/F| = A' |1 + n| / (2 omega^2 zeta). Damping by height takes the modal constant A of the reference instead, hence

    zeta_height = A / (2 omega^2 |X/F|) = zeta (A / A') / |1 + n|

It holds where the beam has not changed the shape (A' = A) and the neighbours are small. The local fit tells A' and, by
what it leaves to its residual terms at the top, n, where a linear mode explains the FRFs. At a peak that friction bends
it trades both for damping, and levels at which the joint sticks have another shape: nothing is known there that speaks
against the height.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ema.data import Finding, FrfSet, ModalMap, ModalModel
from ema.dof import match
from ema.errors import InputError

ALLOWED = 0.1
"""Relative error of damping by height up to which it is shown.

A linear fit reads friction peaks wrong by up to a quarter: a height twice as wrong as this would be no better.
"""
EXPLAINED = ALLOWED / 5
"""Misfit up to which a linear mode explains a condition.

Where damping falls with 1/amplitude, A'|1 + n| of the fit is off by 3.9 to 5.3 times its misfit (friction of a
third to 1.3 times the background damping): a larger misfit would let the nonlinearity pass for another shape.
"""


def with_valid_heights(
    chart: ModalMap,
    frfs: Sequence[FrfSet],
    order: Sequence[tuple[int, int]],
    reference: ModalModel | None,
    bandwidths: float = 1.5,
) -> tuple[ModalMap, tuple[Finding, ...]]:
    """The map with its damping by height where the conditions of that hold, and a finding about the rest.

    Parameters
    ----------
    frfs, order : FRFs of every condition and its row and column in the map.
    """
    if reference is None or chart.quadrature_damping is None or chart.misfit is None:
        return chart, ()
    heights = np.array(chart.quadrature_damping)
    raised = np.full(heights.shape, np.nan)
    for (row, column), one in zip(order, frfs, strict=True):
        if not np.isfinite(heights[row, column]) or not chart.misfit[row, column] <= EXPLAINED:
            continue
        try:
            raised[row, column] = _at_the_top(one, float(chart.frequency[row, column]), reference, bandwidths)
        except InputError:
            continue
    # what is not known does not speak against the height
    factor = 1 / np.where(np.isfinite(raised), raised, 1.0)
    wrong = np.isfinite(heights) & (np.abs(factor - 1) > ALLOWED)
    if not wrong.any():
        return chart, ()
    heights[wrong] = np.nan
    worst = float(factor[wrong][np.argmax(np.abs(factor[wrong] - 1))])
    finding = Finding.of(
        "info",
        "height",
        chart.name,
        "the height of the peak tells no damping in {count} of {total} conditions: the beam changes "
        "the modal constant of the reference, or neighbouring modes add to the peak; it would read "
        "{times} times the damping.",
        worst,
        ALLOWED,
        advice="Read the damping of the fit there.",
        count=int(wrong.sum()),
        total=wrong.size,
        times=f"{worst:.2f}",
    )
    return replace(chart, quadrature_damping=heights), (finding,)


def _at_the_top(frfs: FrfSet, near: float, reference: ModalModel, bandwidths: float) -> float:
    """A' |1 + n| / A: modal constant over that of the reference, times what neighbours add at the highest line."""
    from ema.fit import local_fit
    from ema.synthesis import convert

    fitted = local_fit(frfs, near, bandwidths)
    mode = int(np.abs(reference.natural_frequencies - near).argmin())
    shape = np.real(reference.shapes[:, mode])
    ends = []
    for dofs in (frfs.outputs, frfs.inputs):
        ends.append(np.array([sign * shape[j] for _, j, sign in sorted(match(dofs, reference.dofs))]))
    wanted = np.outer(*ends)
    if wanted.shape != frfs.values.shape[1:]:
        raise InputError(
            "the reference lacks a DOF of the FRFs",
            where=frfs.name,
            got=f"shape {wanted.shape}",
            expected=f"shape {frfs.values.shape[1:]}",
        )
    weights = wanted / np.sum(wanted**2)
    inside = np.abs(frfs.frequencies - fitted.natural_frequency) <= 2 * fitted.damping_ratio * fitted.natural_frequency
    inside[np.abs(frfs.frequencies - fitted.natural_frequency).argmin()] = True
    measured = np.einsum("koi,oi->k", convert(frfs, "receptance").values[inside], weights)
    top = int(np.abs(measured).argmax())
    s = 2j * np.pi * frfs.frequencies[inside][top]
    own = fitted.residues / (s - fitted.pole) + fitted.residues.conj() / (s - fitted.pole.conjugate())
    constant = float(np.real(np.sum(fitted.modal_constants * weights)))
    return constant * float(abs(measured[top] / np.sum(own * weights)))
