"""pyHarm: forced response of the double beam, friction elements on the slips, the linear part condensed.

``python -P run.py CASE.npz RESULT.json``. The case holds mass, stiffness and damping matrices whose first coordinates are
the slips of the node pairs, so that every friction element acts between one coordinate and the ground.
"""

import contextlib
import json
import logging
import sys
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np
from pyHarm.Maestro import Maestro


def study(case: dict, harmonics: object, last: float) -> Maestro:
    """Friction elements, force and a sweep at constant steps from the first frequency to ``last`` Hz.

    Steps that fail are halved twice at most: pyHarm gives up where they fail still.
    """
    pairs, size = len(case["stiffness"]), len(case["mass_matrix"])
    step = 2 * np.pi * (case["frequencies"][1] - case["frequencies"][0])
    start = 2 * np.pi * case["frequencies"][0]
    elements = {
        f"friction {n}": {
            "type": "Jenkins",
            "connect": {"beams": [n]},
            "dirs": [0],
            "mu": 1.0,
            "N0": float(case["limits"][n]),
            "k": float(case["stiffness"][n]),
        }
        for n in range(pairs)
    }
    elements["force"] = {
        "type": "CosinusForcing",
        "connect": {"beams": [int(case["driven"])]},
        "dirs": [0],
        "amp": float(case["force"]),
    }
    matrices = {
        "M": case["mass_matrix"],
        "C": case["damping_matrix"],
        "K": case["stiffness_matrix"],
        "G": np.zeros((size, size)),
    }
    return Maestro(
        {
            "system": {"type": "Base", "nh": harmonics, "nti": 128},
            "substructures": {
                "beams": {"type": "substructure", "reader": "generic", "matrix": matrices, "ndofs": 1, "nnodes": size}
            },
            "connectors": elements,
            "kinematics": {},
            "analysis": {
                "sweep": {
                    "study": "frf",
                    "solver": "NewtonRaphson",
                    "predictor": "secant",
                    "corrector": "nocontinuation",
                    "reductors": [{"type": "NLdofs"}],
                    "stepsizer": "constant",
                    "ds0": step,
                    "ds_max": step,
                    "ds_min": step / 4,
                    "puls_inf": start,
                    "puls_sup": 2 * np.pi * last + 0.5 * step,
                    "sign_ds": 1,
                    "verbose": False,
                }
            },
        }
    )


def sweep(case: dict, harmonics: object, last: float) -> tuple[float, Maestro]:
    """Processor time in s of the sweep, without that of building the model, and its results."""
    with contextlib.redirect_stdout(sys.stderr):
        maestro = study(case, harmonics, last)
        start = time.process_time()
        maestro.operate()
        return time.process_time() - start, maestro


def main(path: str, result: str) -> None:
    """Warm up on the first frequencies, then sweep with all harmonics and with the odd ones alone."""
    logging.disable(logging.CRITICAL)
    with np.load(path) as file:
        case = {name: file[name] for name in file.files}
    out: dict = {"version": version("pyHarm-os")}
    highest = int(case["harmonics"])
    for name, harmonics in (("odd", list(range(1, highest + 1, 2))), ("all", highest)):
        sweep(case, harmonics, float(case["frequencies"][1]))
        cpu, maestro = sweep(case, harmonics, float(case["frequencies"][-1]))
        points = maestro.nls["sweep"].SolList
        solved = [point for point in points if point.flag_accepted]
        grid = maestro.system.expl_dofs
        place = grid.index[(grid["node_num"] == int(case["driven"])) & (grid["harm"] == 1)].to_numpy()
        out[name] = {
            "cpu": cpu / len(solved),
            "points": len(points),
            "accepted": len(solved),
            "frequencies": [float(point.x[-1] / 2 / np.pi) for point in solved],
            "amplitudes": [float(np.hypot(*point.x[place])) for point in solved],
        }
        Path(result).write_text(json.dumps(out))


if __name__ == "__main__":
    main(*sys.argv[1:])
