"""What the window and the end of the record do to the residues of modes.

The transform of a free vibration exp(p t) over T seconds from its beginning is, on the lines j w = 2 pi j k / T of the
record, (1 - exp(p T)) / (j w - p), because exp(-j w T) = 1 there: the pole stays, the residue of the measured quantity
is multiplied by 1 - exp(p T).

An exponential window of decay a moves a pole s to p = s - a and leaves the residue of the measured quantity. Of a
quantity that is the n-th derivative of displacement this residue is s^n R, R that of the receptance; who takes p for
the pole reads it as p^n R', so that R' = (s / p)^n R.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Complex, Int

from ema.data import FrfSet, ModalModel
from ema.fit.refinement import Refined
from ema.fit.uncertainty import PoleErrors
from ema.units import DERIVATIVE_ORDER

_WINDOWS = ("rectangular", "exponential")
"""Windows under which a free vibration stays a sum of exponentials."""


def record_factor(poles: Complex[np.ndarray, "mode"], frfs: FrfSet) -> Complex[np.ndarray, "mode"]:
    """Factor of the residues of the receptance at the ``poles`` [rad/s] that the data show, window included."""
    order = DERIVATIVE_ORDER[frfs.quantity]
    factor = np.asarray(((poles + frfs.added_decay) / poles) ** order)
    if frfs.record_length is None or frfs.window not in _WINDOWS:
        return factor
    return np.asarray(factor * (1 - np.exp(poles * frfs.record_length)))


def of_whole_vibration(
    optimum: Refined, errors: PoleErrors, modes: Int[np.ndarray, "mode"], frfs: FrfSet, *, scale: float = 1.0
) -> tuple[Refined, PoleErrors]:
    """The optimum and its errors with the participation that ``modes`` would have in a record without end, and all
    residues and residual terms times ``scale``.
    """
    factor = np.full(len(optimum.fit.poles), 1 / scale, complex)
    factor[modes] *= record_factor(optimum.fit.poles[modes], frfs)
    fit = optimum.fit
    fit = replace(fit, participation=fit.participation / factor, rest=fit.rest * scale)
    each = tuple(
        replace(own, participation=own.participation / one) for own, one in zip(errors.modes, factor, strict=True)
    )
    return replace(optimum, fit=fit), replace(errors, modes=each)


def as_recorded(model: ModalModel, frfs: FrfSet) -> ModalModel:
    """The model as the record and the window of ``frfs`` show it."""
    poles = model.poles - frfs.added_decay
    return replace(model, poles=poles, participation=model.participation * record_factor(poles, frfs))
