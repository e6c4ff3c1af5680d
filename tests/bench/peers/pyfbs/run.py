"""pyFBS: pLSCF, then the stable pole nearest to each frequency it is told (its own way is a click in the diagram).

Its basis is not shifted to the start of the band, so the top of a band from f0 would fold back: it is given the axis
counted from the start of the band, and the start is added to the poles.
"""

import contextlib
import io
from importlib.metadata import version as installed

import numpy as np

with contextlib.redirect_stdout(io.StringIO()):
    from pyfbs.modal_id import ModalID


def version() -> str:
    return installed("pyFBS")


def identify(case):
    with contextlib.redirect_stdout(io.StringIO()):
        model = ModalID(case.frequencies - case.frequencies[0], case.values)
        model.p_lscf(max_order=int(case.order), step_order=2)
    return model


def select(case, model):
    """Of the poles stable in frequency, damping and participation; else in frequency and damping."""
    start = 2j * np.pi * case.frequencies[0]
    poles = np.concatenate([group[0] for group in model.poles]) + start
    kind = model.stab_plot[:, -1]
    assert len(poles) == len(kind)
    chosen = []
    for frequency in case.told:
        distance = np.abs(np.abs(poles) / (2 * np.pi) - frequency) / frequency
        for level in (3, 2):
            near = np.flatnonzero((kind == level) & (distance < 0.01))
            if len(near):
                chosen.append(poles[near[np.argmin(distance[near])]])
                break
    return {"poles": np.unique(chosen)}
