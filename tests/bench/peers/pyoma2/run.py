"""pyOMA2: its pLSCF functions on FRFs in place of half spectra, then the stable pole nearest to each frequency it is told.

An operational tool: its classes take time signals only, so the functions behind them are called as the class calls them
for half spectra, which have the poles of FRFs. Frequencies are counted from the start of the band.
"""

import contextlib
import io
import logging
import os
from importlib.metadata import version as installed

import numpy as np

os.environ["TQDM_DISABLE"] = "1"
from pyoma2.functions import gen, plscf

logging.disable(logging.CRITICAL)


def version() -> str:
    return installed("pyOMA_2")


def identify(case):
    order = int(case.order)
    step = 1 / (2 * (case.frequencies[-1] - case.frequencies[0]))
    with contextlib.redirect_stderr(io.StringIO()):
        denominators, numerators = plscf.pLSCF(case.values.transpose(1, 2, 0), step, order, sgn_basf=1)
        natural, damping, shapes, poles = plscf.pLSCF_poles(denominators, numerators, step, "per", 1024)
        stable = gen.SC_apply(natural, damping, shapes, 0, order - 1, 1, 0.01, 0.05, 0.05)
    return poles, stable


def select(case, identified):
    poles, stable = identified
    poles = poles[(stable == 1) & (poles.imag > 0)] + 2j * np.pi * case.frequencies[0]
    chosen = []
    for frequency in case.told:
        distance = np.abs(np.abs(poles) / (2 * np.pi) - frequency) / frequency
        if len(poles) and distance.min() < 0.01:
            chosen.append(poles[np.argmin(distance)])
    return {"poles": np.unique(chosen)}
