"""pyYeti: ERA on impulse responses of the band (counted from its start), automatic selection, told nothing.

The square Hankel matrix of its default would need terabytes here. The size taken is where more rows or columns no longer
found more modes.
"""

import warnings
from importlib.metadata import version as installed

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
from pyyeti.era import ERA


def version() -> str:
    return installed("pyyeti")


def identify(case):
    frequencies = case.frequencies
    span = frequencies[-1] - frequencies[0]
    impulse = np.fft.irfft(case.values, axis=0)
    outputs, inputs = impulse.shape[1:]
    columns = 40 * int(case.order) // (3 * inputs)
    rows = max(10, 1600 // outputs)
    keep = min(len(impulse) // 2, rows + columns)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return ERA(
            impulse[:keep].transpose(1, 0, 2),
            2 * span,
            svd_tol=int(case.order) * 2,
            auto=True,
            alpha=rows,
            beta=columns,
            verbose=False,
            show_plot=False,
        )


def select(case, era):
    """What the automatic selection has left, moved back to the band."""
    poles = era.eigs_continuous[era.eigs_continuous.imag > 0] + 2j * np.pi * case.frequencies[0]
    return {"poles": poles}
