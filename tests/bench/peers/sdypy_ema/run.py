"""sdypy-EMA: LSCF over all FRFs, then its own choice of stable poles near frequencies it is told."""

from importlib.metadata import version as installed

import numpy as np
from sdypy import EMA


def version() -> str:
    return installed("sdypy-EMA")


def identify(case):
    frequencies = case.frequencies
    model = EMA.Model(
        frf=case.values.reshape(len(frequencies), -1).T,
        freq=frequencies,
        lower=frequencies[0],
        upper=frequencies[-1],
        pol_order_high=int(case.order),
        frf_form="accelerance",
    )
    model.get_poles(method="lscf", show_progress=False)
    return model


def select(case, model):
    """Its automatic choice takes the nearest of its stable poles; one that drops a mode repeats a neighbour's pole."""
    model.select_closest_poles(list(case.told))
    omega, zeta = 2 * np.pi * np.asarray(model.nat_freq), np.asarray(model.nat_xi)
    return {"poles": np.unique(-zeta * omega + 1j * omega * np.sqrt(1 - zeta**2))}
