"""pydvma: one mode at a time near frequencies it is told, then its joint refinement of all modes.

A mode is fitted between the points half way to its neighbours, on the eight FRFs that are strongest there, and all modes
together on the two strongest FRFs: the joint refinement with its numerical derivatives did not end within ten minutes
on sixteen.
"""

import contextlib
import io
import itertools
from importlib.metadata import version as installed

import numpy as np
from pydvma import datastructure, modal


def version() -> str:
    return installed("pydvma")


def _transfer_functions(frequencies, columns):
    return datastructure.TfDataList([datastructure.TfData(frequencies, columns, None, None)])


def identify(case):
    frequencies, columns = case.frequencies, case.values.reshape(len(case.frequencies), -1)
    told = np.sort(case.told)
    edges = np.concatenate([[frequencies[0]], (told[1:] + told[:-1]) / 2, [frequencies[-1]]])
    starts = []
    for low, high in itertools.pairwise(edges):
        near = (frequencies > low) & (frequencies < high)
        if near.sum() < 6:
            continue
        strong = np.argsort(np.abs(columns[near]).max(axis=0))[-8:]
        with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(Exception):
            fitted = modal.modal_fit_all_channels(_transfer_functions(frequencies, columns[:, strong]), [low, high])
            starts.append(np.atleast_2d(fitted.M)[0, :2])
    return np.array(starts)


def select(case, starts):
    columns = case.values.reshape(len(case.frequencies), -1)
    columns = columns[:, np.argsort(np.linalg.norm(columns, axis=0))[-2:]]
    rows = np.zeros((len(starts), 2 + 4 * columns.shape[1]))
    rows[:, :2] = starts
    fitted = datastructure.ModalData(rows[0], settings=None, id_link=None, test_name=None)
    fitted.M = rows
    with contextlib.redirect_stdout(io.StringIO()):
        refined, _ = modal.modal_refine(fitted, _transfer_functions(case.frequencies, columns))
    frequency, zeta = np.atleast_2d(refined.M)[:, :2].T
    omega = 2 * np.pi * frequency
    return {"poles": np.unique(-zeta * omega + 1j * omega * np.sqrt(1 - zeta**2))}
