"""FRFs in the form in which they are fitted, which is the same however a measurement is stated.

Poles that the data hardly determine, such as those of resonances far outside the band, may end up anywhere along a
valley of the likelihood, and differences in the last digit of the FRFs decide where. They move the modes by a small
part of their standard deviation, but a unit, a factor next to one or an integration is no reason to move at all. FRFs
are therefore put in the order of their DOFs, divided by their largest value, rounded to a small part of their
noise, and, where their variance is known, turned into that of receptance, mobility and accelerance whose noise depends
least on the frequency.
"""

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import replace

import numpy as np
import scipy.ndimage
import threadpoolctl
from jaxtyping import Float

from ema.data import FrfSet, ModalModel, PoleTable
from ema.dof import Dof
from ema.fit import noise
from ema.units import DERIVATIVE_ORDER, FRF_UNIT, FrfQuantity

_PART_OF_NOISE = 1e-4
"""Grid of the values over the noise of the FRF that has least of it, at most: rounding moves modes by a few
hundred-thousandths of their standard deviations (the grid over the root of 12). The same values in other units differ
by the last digit, and are rounded the other way where they are as near to the middle between two values of the
grid."""
_FINEST = -50
"""Exponent of two of the finest grid, over the largest value: doubles have four binary digits more."""
_DIGITS = 24
"""Binary digits of variances, 6e-8 of each: far finer than any variance is known, and coarse enough that the same
variance stated in other units is rounded to the same number."""
_POOLED = 25
"""Lines over which the logarithm of the variance is averaged before its range is taken: one from five averages scatters
by 0.5, the mean of 25 by 0.1."""
_KINDS: tuple[FrfQuantity, ...] = ("receptance", "mobility", "accelerance")


def canonical(frfs: FrfSet) -> tuple[FrfSet, float]:
    """The FRFs of a set as they are fitted, and the factor that leads back from their receptance to that of the set.

    Sets that stay in a file are left as they are.
    """
    if frfs.in_file or not len(frfs.frequencies):
        return frfs, 1.0
    frfs = _with_flattest_noise(_sorted(frfs))
    # The order of sums depends on that of the memory; the largest part does not depend on any order.
    values = np.ascontiguousarray(frfs.values)
    scale = float(np.max(np.abs(values.view(float)), initial=0.0))
    if not (np.isfinite(scale) and scale > 0):
        return frfs, 1.0
    variance = frfs.variance
    if variance is not None:
        mantissa, exponent = np.frexp(variance / scale**2)
        variance = np.ascontiguousarray(np.ldexp(np.round(mantissa * 2.0**_DIGITS), exponent - _DIGITS))
    deviations = frfs.deviations
    if deviations is not None:
        deviations = replace(deviations, values=np.asarray(deviations.values) / scale)
    grid = _grid(values, frfs, scale)
    rounded = np.round(values / scale / grid) * grid
    return replace(frfs, values=rounded, variance=variance, deviations=deviations), scale


def one_thread() -> AbstractContextManager[object]:
    """Linear algebra with one thread, within which the order of sums does not depend on the number of processors."""
    limits: AbstractContextManager[object] = threadpoolctl.threadpool_limits(1, user_api="blas")
    return limits


def table_in_order(table: PoleTable, frfs: FrfSet) -> PoleTable:
    """The table with its references in the order of a set."""
    columns = _places(table.references, frfs.outputs if len(frfs.outputs) < len(frfs.inputs) else frfs.inputs)
    references = tuple(table.references[column] for column in columns)
    return replace(table, participation=table.participation[:, columns], references=references)


def model_in_order(model: ModalModel, frfs: FrfSet) -> ModalModel:
    """The model with its DOFs in the order of a set."""
    sides = (frfs.outputs, frfs.inputs)
    dofs, inputs = sides[::-1] if len(frfs.outputs) < len(frfs.inputs) else sides
    rows, columns = _places(model.dofs, dofs), _places(model.inputs, inputs)
    if rows == sorted(rows) and columns == sorted(columns):
        return model
    residuals, uncertainty = model.residuals, model.uncertainty
    if residuals is not None:
        residuals = replace(
            residuals,
            lower=residuals.lower[rows][:, columns],
            upper=residuals.upper[rows][:, columns],
            residues=None if residuals.residues is None else residuals.residues[:, rows][:, :, columns],
        )
    if uncertainty is not None:
        uncertainty = replace(
            uncertainty,
            shapes=uncertainty.shapes[:, rows],
            common=uncertainty.common[:, rows],
            participation=uncertainty.participation[:, columns],
            residues=uncertainty.residues[:, rows][:, :, columns],
        )
    return replace(
        model,
        shapes=model.shapes[rows],
        dofs=tuple(model.dofs[row] for row in rows),
        participation=model.participation[columns],
        inputs=tuple(model.inputs[column] for column in columns),
        residuals=residuals,
        uncertainty=uncertainty,
    )


def _sorted(frfs: FrfSet) -> FrfSet:
    """The set in the order of its DOFs."""
    rows, columns = _sorting(frfs.outputs), _sorting(frfs.inputs)
    return frfs if rows == sorted(rows) and columns == sorted(columns) else frfs.pick(rows, columns)


def _sorting(dofs: Sequence[Dof]) -> list[int]:
    """Places of DOFs in their order; as they are where one is there twice, for nothing tells its places apart then."""
    places = list(range(len(dofs)))
    if len(set(dofs)) < len(dofs):
        return places
    return sorted(places, key=lambda place: (dofs[place].part, dofs[place].node, dofs[place].direction))


def _places(dofs: Sequence[Dof], given: Sequence[Dof]) -> list[int]:
    """Places of DOFs, some of those ``given``, in the order in which they are given (`_sorting`)."""
    places = list(range(len(dofs)))
    return places if len(set(given)) < len(given) else sorted(places, key=lambda place: given.index(dofs[place]))


def _grid(values: np.ndarray, frfs: FrfSet, scale: float) -> float:
    """A power of two that is a small part of the noise of values over ``scale``."""
    known = noise.measured(frfs)
    level = noise.from_differences(values) if known is None else noise.from_variance(known)
    alive = np.any(values != 0, axis=0)
    typical = np.median(level.lines) * level.outputs[:, None] * level.references
    least = float(np.min(typical[alive], initial=scale))
    return float(2.0 ** max(_FINEST, np.floor(np.log2(max(_PART_OF_NOISE * least / scale, np.finfo(float).tiny)))))


def _with_flattest_noise(frfs: FrfSet) -> FrfSet:
    """The set as receptances, mobilities or accelerances, whichever have the flattest noise, where that is known.

    Under an exponential window the residues depend on which of them was measured (`ema.fit.record_end`), and in Hann
    blocks what the window does to the peaks (`ema.fit.broadening`).
    """
    given = DERIVATIVE_ORDER[frfs.quantity]
    kept = frfs.quantity not in _KINDS or frfs.added_decay or frfs.window == "hann"
    variance = None if kept or frfs.variance is None else noise.measured(frfs)
    if variance is None:
        return frfs
    frfs, variance = frfs.lines(frfs.frequencies > 0), variance[frfs.frequencies > 0]
    omega, profile = 2 * np.pi * frfs.frequencies, _profile(variance)
    ranges = [float(np.std(profile + 2 * (DERIVATIVE_ORDER[kind] - given) * np.log(omega))) for kind in _KINDS]
    flattest = _KINDS[int(np.argmin(ranges))]
    if flattest == frfs.quantity:
        return frfs
    factor = ((1j * omega) ** (DERIVATIVE_ORDER[flattest] - given))[:, None, None]
    deviations = frfs.deviations
    if deviations is not None:
        deviations = replace(deviations, values=np.asarray(deviations.values) * factor)
    return replace(
        frfs,
        values=frfs.values * factor,
        variance=variance * np.abs(factor) ** 2,
        deviations=deviations,
        quantity=flattest,
        unit=FRF_UNIT[flattest] if frfs.scaled else frfs.unit,
    )


def _profile(variance: Float[np.ndarray, "freq out in"]) -> Float[np.ndarray, "freq"]:
    """Logarithm of the variance over the lines, median of the FRFs about their own."""
    logarithm = np.log(np.maximum(variance, np.finfo(float).tiny))
    typical = np.median(logarithm - np.median(logarithm, axis=0), axis=(1, 2))
    return np.asarray(scipy.ndimage.uniform_filter1d(typical, _POOLED, mode="nearest"))
