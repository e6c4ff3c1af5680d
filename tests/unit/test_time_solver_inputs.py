"""Whatever is wrong with an order to the time solvers is said in one sentence: what, where, got, expected."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from ema.data import Damping
from ema.data.beam import Matrices
from ema.elements import Section
from ema.errors import InputError
from ema.simulate import (
    Dahl,
    Masing,
    RegularisedMasing,
    Unilateral,
    controlled_snapback,
    double_beam,
    respond,
    snapback,
    snapback_reference,
)
from ema.simulate.control import Actuator, AmplitudeScheduled, BangBang, ReleasePulse, constant

TIP = "beam 2:2:+Z"
NAN = float("nan")


def model(law=None, force=500.0, **more):
    return double_beam(law or Masing(0.3, 1e9), force, Section(0.5, 0.04, 0.005, elements=2), **more)


def joint(**changes):
    plain = model()
    return replace(plain, joints=(replace(plain.joints[0], **changes),))


def host(change):
    plain = model()
    stiffness = np.array(plain.host.stiffness)
    change(stiffness)
    return replace(plain, host=Matrices(plain.host.mass, stiffness, plain.host.dofs))


def asymmetric(stiffness):
    stiffness[0, 1] += 0.1 * abs(stiffness).max()


def indefinite(stiffness):
    stiffness[0, 0] -= 10 * abs(stiffness).max()


def unheld(stiffness):
    stiffness[:] = 0.0


MODELS = {
    "k_T below zero": lambda: model(Masing(0.3, -1.0)),
    "k_T NaN": lambda: model(Masing(0.3, NAN)),
    "mu below zero": lambda: model(Masing(-0.1, 1e9)),
    "mu NaN": lambda: model(Masing(NAN, 1e9)),
    "exponent": lambda: model(RegularisedMasing(0.3, 1e9, -1.0)),
    "F_N below zero": lambda: model(force=-1.0),
    "F_N NaN": lambda: model(force=NAN),
    "k_N below zero": lambda: joint(normal_stiffness=-1.0),
    "k_N NaN": lambda: joint(normal_stiffness=NAN),
    "no pairs": lambda: joint(pairs=()),
    "no joints": lambda: replace(model(), joints=()),
    "a node that is not there": lambda: joint(pairs=((1, 1), (2, 77))),
    "a law that is not there": lambda: joint(law=replace(model().joints[0].law, name="glue")),
    "asymmetric stiffness": lambda: host(asymmetric),
    "indefinite stiffness": lambda: host(indefinite),
    "a host that is not held": lambda: replace(host(unheld), beam=None),
    "damping below zero": lambda: model(damping=Damping(ratio=-0.1)),
}


@pytest.mark.parametrize("solver", [snapback, snapback_reference])
@pytest.mark.parametrize("wrong", list(MODELS))
def test_models_that_are_not_physical(solver, wrong):
    check(lambda: solver(MODELS[wrong](), 20.0, TIP, 0.001))


def control(law=lambda seen: 100.0, load=20.0, duration=0.001, **more):
    return controlled_snapback(model(), law, load, TIP, duration, **more)


def forced(values=None, rate=5000.0, at=(TIP,), **more):
    return respond(model(), np.zeros((1, 4)) if values is None else values, list(at), rate, [TIP], **more)


ORDERS = {
    "load NaN": lambda: snapback(model(), NAN, TIP, 0.001),
    "load NaN, reference": lambda: snapback_reference(model(), NAN, TIP, 0.001),
    "load NaN, control": lambda: control(load=NAN),
    "duration": lambda: snapback(model(), 20.0, TIP, -1.0),
    "duration, reference": lambda: snapback_reference(model(), 20.0, TIP, NAN),
    "duration, control": lambda: control(duration=0.0),
    "rate": lambda: snapback(model(), 20.0, TIP, 0.001, sampling_rate=0.0),
    "rate, reference": lambda: snapback_reference(model(), 20.0, TIP, 0.001, sampling_rate=NAN),
    "rate, forces": lambda: forced(rate=-5.0),
    "tolerance": lambda: snapback(model(), 20.0, TIP, 0.001, tolerance=NAN),
    "tolerance, forces": lambda: forced(tolerance=0.0),
    "spacing": lambda: snapback_reference(model(), 20.0, TIP, 0.001, spacing=-1e-6),
    "spacing NaN": lambda: snapback_reference(model(), 20.0, TIP, 0.001, spacing=NAN),
    "modes": lambda: snapback(model(), 20.0, TIP, 0.001, modes=-1),
    "DOF": lambda: snapback(model(), 20.0, "beam 2:77:+Z", 0.001),
    "DOF, reference": lambda: snapback_reference(model(), 20.0, "beam 7:2:+Z", 0.001),
    "output": lambda: snapback(model(), 20.0, TIP, 0.001, outputs=["beam 2:77:+Z"]),
    "sensor": lambda: control(sensor="beam 2:77:+Z"),
    "forces without a DOF": lambda: forced(at=()),
    "one sample": lambda: forced(np.zeros((1, 1))),
    "forces NaN": lambda: forced(np.full((1, 4), NAN)),
    "normal forces of another length": lambda: forced(normal_forces=np.ones((1, 3))),
    "normal forces below zero": lambda: forced(normal_forces=lambda t: -1.0),
    "normal forces over time where surfaces part": lambda: snapback(
        model().with_normal_contact(Unilateral()), 20.0, TIP, 0.001, normal_forces=lambda t: 100.0
    ),
    "a smooth law in the reference mode": lambda: snapback_reference(model(Dahl(0.3, 1e9)), 20.0, TIP, 0.001),
    "damping ratios in the reference mode": lambda: snapback_reference(
        model(damping=Damping(ratio=0.01)), 20.0, TIP, 0.001
    ),
    "surfaces that part in the reference mode": lambda: snapback_reference(
        model().with_normal_contact(Unilateral()), 20.0, TIP, 0.001
    ),
    "a duration for which no memory is enough": lambda: snapback(model(), 20.0, TIP, 1e9),
    "a duration for which no memory is enough, reference": lambda: snapback_reference(model(), 20.0, TIP, 1e9),
    "a duration for which no memory is enough, control": lambda: control(duration=1e9),
    "a rate for which no memory is enough": lambda: snapback(model(), 20.0, TIP, 1.0, sampling_rate=1e14),
    "spacing too wide": lambda: snapback_reference(model(), 20.0, TIP, 0.001, spacing=0.01),
    "no output": lambda: respond(model(), np.zeros((1, 4)), [TIP], 5000.0, []),
    "normal forces in words": lambda: forced(normal_forces=lambda t: "much"),
    "normal forces of nothing": lambda: forced(normal_forces=lambda t: None),
    "normal forces that become negative": lambda: forced(np.zeros((1, 100)), normal_forces=lambda t: 100 - 1e4 * t),
    "step, control": lambda: control(step=NAN),
    "a step longer than the sampling time": lambda: control(step=1.0),
    "a controller that answers a word": lambda: control(lambda seen: "much"),
    "a constant force below zero": lambda: constant(-5.0),
    "a schedule without amplitude": lambda: AmplitudeScheduled(100.0, 0.0),
    "a pulse of no width": lambda: ReleasePulse(100.0, 0.0),
    "a bang below zero": lambda: BangBang(-1.0),
    "an actuator without time": lambda: Actuator(0.0),
    "an actuator that is early": lambda: Actuator(lag=-1e-3),
    "limits the wrong way round": lambda: Actuator(limits=(5.0, 1.0)),
    "a controller that answers NaN": lambda: control(lambda seen: NAN),
    "a controller that answers too much": lambda: control(lambda seen: [1.0, 2.0]),
    "a controller that answers nothing": lambda: control(lambda seen: None),
    "a controller before surfaces that part": lambda: controlled_snapback(
        model().with_normal_contact(Unilateral()), lambda seen: 100.0, 20.0, TIP, 0.001
    ),
}


@pytest.mark.parametrize("wrong", list(ORDERS))
def test_orders_that_make_no_sense(wrong):
    check(ORDERS[wrong])


def check(order):
    with pytest.raises(InputError) as caught:
        order()
    sentence = str(caught.value)
    assert "\n" not in sentence and 10 < len(sentence) < 300
    assert "got" in sentence or "expected" in sentence


_LOAD_IN_WORDS = """
from ema.errors import InputError
from ema.simulate import Masing, Section, double_beam, snapback
try:
    snapback(double_beam(Masing(0.3, 1e9), 60.0, Section(0.5, 0.04, 0.005, elements=1)), "60 N", "beam 2:1:+Z", 0.01)
except InputError as error:
    print(error)
"""


def test_a_load_in_words_is_repeated_as_it_stands():
    """In a process of its own: the types that the test run checks would be refused before."""
    done = subprocess.run([sys.executable, "-W", "error", "-c", _LOAD_IN_WORDS], capture_output=True, text=True)
    assert "load: not what this argument takes; got '60 N', expected a number" in done.stdout, done.stderr


def test_a_load_beyond_small_displacements_is_a_finding():
    run = snapback(
        double_beam(Masing(0.3, 1e9), 100.0, Section(0.5, 0.04, 0.005, elements=10)),
        4e3,
        "beam 2:10:+Z",
        0.001,
        tolerance=0.1,
    )
    (finding,) = [finding for finding in run.findings if finding.code == "large-slip"]
    assert finding.value > finding.limit and finding.advice
