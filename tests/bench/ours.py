"""friction-ema on a case file, in the same harness as the peers; told nothing."""

import numpy as np

import ema.fit
from ema.data import FrfSet
from ema.dof import Dof


def version() -> str:
    return ema.__version__


def frf_set(case) -> FrfSet:
    """The FRFs of a case file; nothing else of the file is looked at."""
    outputs = tuple(Dof(node, "+Z") for node in range(1, case.values.shape[1] + 1))
    return FrfSet(
        frequencies=case.frequencies,
        values=case.values,
        outputs=outputs,
        inputs=tuple(outputs[place] for place in case.places),
        quantity="accelerance",
        unit="m/s^2/N",
    )


def identify(case):
    frfs = frf_set(case)
    return frfs, ema.fit.stabilise(frfs, orders=range(2, int(case.order) + 1, 2))


def select(case, identified):
    """Automatic selection and residues: more than the peers are timed for."""
    modes = ema.fit.modes(*identified)
    return {
        "poles": np.asarray(modes.poles),
        "shapes": np.asarray(modes.shapes),
        "participation": np.asarray(modes.participation),
    }
