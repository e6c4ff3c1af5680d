"""OpenSeesPy: snap-back of the double beam with Newmark's trapezoidal rule and accelerated Newton steps.

``python -P run.py CASE.json RESULT.json``. Frame elements with consistent mass; at every pair two interface nodes on rigid
links of half a height, joined by an elastic normal spring and an elastic-perfectly-plastic tangential one.
"""

import json
import sys
import time
from importlib.metadata import version
from pathlib import Path

import openseespy.opensees as ops


def build(case: dict) -> int:
    """The model; returns the node at the tip of the upper beam."""
    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 3)
    ops.geomTransf("Linear", 1)
    count, length, height = case["elements"], case["length"], case["height"]
    area, inertia = case["width"] * height, case["width"] * height**3 / 12
    element = 0
    for part in (1, 2):
        middle = (part - 1.5) * height
        for n in range(count + 1):
            ops.node(1000 * part + n, length * n / count, middle)
        ops.fix(1000 * part, 1, 1, 1)
        for n in range(count):
            element += 1
            ops.element(
                "elasticBeamColumn",
                element,
                1000 * part + n,
                1000 * part + n + 1,
                area,
                case["youngs_modulus"],
                inertia,
                1,
                "-mass",
                case["density"] * area,
                "-cMass",
            )
    for n in range(1, count + 1):
        for part in (1, 2):
            ops.node(1000 * part + 500 + n, length * n / count, 0.0)
            ops.rigidLink("beam", 1000 * part + n, 1000 * part + 500 + n)
        share = case["shares"][n - 1]
        stiffness = case["contact_stiffness"] * share
        ops.uniaxialMaterial("ElasticPP", 2 * n, stiffness, case["slip_force"] * share / stiffness)
        ops.uniaxialMaterial("Elastic", 2 * n + 1, case["normal_stiffness"] * share)
        element += 1
        ops.element("zeroLength", element, 1500 + n, 2500 + n, "-mat", 2 * n, 2 * n + 1, "-dir", 1, 2)
    return 2000 + count


def settings() -> None:
    """Solver settings of the ramp and the motion: the fastest of those tried on this model that converge."""
    ops.constraints("Transformation")
    ops.numberer("RCM")
    ops.system("BandSPD")
    ops.test("NormDispIncr", 1e-8, 50)
    ops.algorithm("KrylovNewton")


def snapback(case: dict) -> dict:
    """Raise the load slowly, let it go, follow the tip."""
    tip = build(case)
    ops.timeSeries("Linear", 1)
    ops.pattern("Plain", 1, 1)
    ops.load(tip, 0.0, case["load"], 0.0)
    settings()
    ops.integrator("LoadControl", 1 / 40)
    ops.analysis("Static")
    if ops.analyze(40) != 0:
        raise RuntimeError("no static equilibrium")
    ops.remove("loadPattern", 1)
    ops.wipeAnalysis()
    ops.setTime(0.0)
    settings()
    ops.integrator("Newmark", 0.5, 0.25)
    ops.analysis("Transient")
    every = round(1 / (case["sampling_rate"] * case["step"]))
    samples = round(case["duration"] * case["sampling_rate"])
    motion = [ops.nodeDisp(tip, 2)]
    start = time.process_time()
    for _ in range(samples):
        if ops.analyze(every, 1 / (case["sampling_rate"] * every)) != 0:
            raise RuntimeError("a step did not converge")
        motion.append(ops.nodeDisp(tip, 2))
    return {"cpu": time.process_time() - start, "displacements": motion, "version": version("openseespy")}


if __name__ == "__main__":
    case = json.loads(Path(sys.argv[1]).read_text())
    Path(sys.argv[2]).write_text(json.dumps(snapback(case)))
