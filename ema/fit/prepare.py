"""FRFs as the estimators want them: checked, short side as references, free of lines that cannot be used."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float, Int

from ema.data import FrfSet
from ema.dof import Dof
from ema.errors import InputError
from ema.fit import noise
from ema.units import DERIVATIVE_ORDER


@dataclass(frozen=True)
class Prepared:
    """FRFs (freq, dof, reference) with their noise level; ``swapped`` says that references are the outputs of the test
    (roving hammer: by reciprocity the shapes live on the hammer's DOFs). ``dead`` lists DOFs whose FRFs are all zero;
    ``rows`` (dof,) and ``columns`` (in,) are the positions of the others among those of the set.
    """

    frequencies: Float[np.ndarray, "freq"]
    values: Complex[np.ndarray, "freq dof in"]
    dofs: tuple[Dof, ...]
    references: tuple[Dof, ...]
    derivative: int
    noise: noise.NoiseLevel
    swapped: bool
    dead: tuple[Dof, ...]
    rows: Int[np.ndarray, "row"]
    columns: Int[np.ndarray, "column"]


def check_statements(frfs: FrfSet) -> None:
    """Check what is stated with FRFs of their window, their record and their lines.

    Raises
    ------
    InputError : a length, a decay or a number of lines that there is not.
    """
    where = frfs.name or "FRFs"
    if not (np.isfinite(frfs.added_decay) and frfs.added_decay >= 0):
        raise InputError(
            "the decay that the exponential window added is no decay",
            where=where,
            got=f"{frfs.added_decay:g} 1/s",
            expected="0 (no window) or more",
        )
    if frfs.record_length is not None and not (np.isfinite(frfs.record_length) and frfs.record_length > 0):
        raise InputError(
            "the record length is no length", where=where, got=f"{frfs.record_length:g} s", expected="more than 0 s"
        )
    effective = frfs.effective_lines
    if effective is not None and not np.all(np.isfinite(effective) & (effective > 0)):
        raise InputError(
            "the number of lines that each line was averaged over is not positive",
            where=where,
            got=f"{np.min(effective):g}",
            expected="effective_lines above 0",
        )


def prepare(frfs: FrfSet, fewest: int = 16) -> Prepared:
    """Check and orient FRFs for a fit.

    Raises
    ------
    InputError : too few lines, a frequency axis that does not increase, NaN or infinite values, nothing but zeros.
    """
    where = frfs.name or "FRFs"
    frequencies, values = np.asarray(frfs.frequencies), np.asarray(frfs.values)
    variance = frfs.variance
    if len(frequencies) and frequencies[0] <= 0:
        keep = frequencies > 0
        frequencies, values = frequencies[keep], values[keep]
        variance = None if variance is None else variance[keep]
    if len(frequencies) < fewest:
        raise InputError(
            "too few frequency lines to fit modes",
            where=where,
            got=len(frequencies),
            expected=f"at least {fewest}",
            advice="widen the band or measure longer records",
        )
    if not np.all(np.diff(frequencies) > 0) or not np.isfinite(frequencies[-1]):
        raise InputError(
            "the frequency axis does not increase", where=where, advice="sort the lines and drop repeated ones"
        )
    if values.size == 0:
        raise InputError(
            "there are no FRFs to fit",
            where=where,
            got=f"shape {values.shape}",
            expected="at least one response and one force",
        )
    if not np.isfinite(np.vdot(values, values).real):
        bad = ~np.isfinite(values)
        output, input_ = np.argwhere(bad.any(axis=0))[0]
        raise InputError(
            "an FRF holds NaN or infinite values",
            where=f"{where}, {frfs.label(int(output), int(input_))}",
            got=f"{int(bad.sum())} such values",
            advice="exclude the record that caused them, or fit a band without them",
        )
    swapped = values.shape[1] < values.shape[2]
    dofs, references = (frfs.inputs, frfs.outputs) if swapped else (frfs.outputs, frfs.inputs)
    if swapped:
        values = values.transpose(0, 2, 1)
        variance = None if variance is None else variance.transpose(0, 2, 1)
    alive = np.asarray(np.count_nonzero(values, axis=(0, 2))) > 0
    if not alive.any():
        raise InputError("all FRFs are zero", where=where, advice="check the response channels and the scaling")
    driven = np.asarray(np.count_nonzero(values, axis=(0, 1))) > 0
    if not (alive.all() and driven.all()):
        values = values[:, alive][:, :, driven]
        variance = None if variance is None else variance[:, alive][:, :, driven]
    level = None
    if (
        variance is not None
        and np.all(np.isfinite(variance) & (variance >= 0))
        and np.all(np.median(variance, axis=0) > 0)
    ):
        level = noise.from_variance(np.asarray(variance))
    coherence = None if frfs.coherence is None else np.asarray(frfs.coherence)[frfs.frequencies > 0]
    if level is None and coherence is not None:
        coherence = (coherence.transpose(0, 2, 1) if swapped else coherence)[:, alive][:, :, driven]
        level = noise.from_coherence(values, coherence)
    if level is None:
        level = noise.from_differences(values)
    return Prepared(
        frequencies,
        values,
        tuple(d for d, a in zip(dofs, alive.tolist(), strict=True) if a),
        tuple(r for r, d in zip(references, driven.tolist(), strict=True) if d),
        DERIVATIVE_ORDER[frfs.quantity],
        level,
        swapped,
        tuple(d for d, a in zip(dofs, alive.tolist(), strict=True) if not a)
        + tuple(r for r, d in zip(references, driven.tolist(), strict=True) if not d),
        np.flatnonzero(alive),
        np.flatnonzero(driven),
    )
