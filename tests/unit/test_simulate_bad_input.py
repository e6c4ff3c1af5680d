"""Whatever is wrong with a structure, a law, a loop, a waveform, a rig or a map is said in one sentence.

The time solvers have theirs in ``test_time_solver_inputs``, files of models in ``test_model_file``.
"""

import subprocess
import sys

import numpy as np
import pytest

from ema.data import Channel, Damping
from ema.dof import Dof
from ema.elements import Plate, Section
from ema.errors import InputError
from ema.simulate import (
    ContactCurve,
    Coulomb,
    Dahl,
    FrictionRig,
    HarmonicBalance,
    Iwan,
    LuGre,
    Masing,
    ParallelMasing,
    PowerContact,
    RandomShakers,
    RegularisedMasing,
    RingCell,
    RovingHammer,
    SnapBack,
    SteppedSine,
    SweptShaker,
    assemble,
    beam,
    damping_map,
    double_beam,
    frf,
    hammer_pulse,
    identify,
    loop,
    measured_loop,
    own_contact,
    plate_matrices,
    register_law,
    resonance,
    resonances,
    stepped_sine,
    swept_sine,
)
from ema.simulate.inputs import Shaker

TIP, NAN = "beam 2:2:+Z", float("nan")
POINT = Dof.parse(TIP)
LAW = Masing(0.3, 1e9)
TIMES = np.arange(200) / 1000.0
MOTION, FORCE = (1e-4 * f(2 * np.pi * 10 * TIMES) for f in (np.sin, np.cos))


def model(law=LAW, force=500.0, **more):
    return double_beam(law, force, Section(0.5, 0.04, 0.005, elements=2), **more)


def lines(*frequencies, level=2.0, at=TIP, outputs=(TIP,), **more):
    return frf(model(), np.array(frequencies), level, at, list(outputs), HarmonicBalance(**more))


def mapped(levels=(1.0,), normals=(100.0,), band=(10.0, 30.0), **more):
    return damping_map(model(), list(levels), list(normals), TIP, TIP, band, **more)


def rig(**more):
    sensor = Channel("acc", POINT, quantity="acceleration", unit="m/s^2")
    return FrictionRig(model(), RovingHammer((POINT,), hits=1), (sensor,), 1024.0, **more)


STRUCTURES = {
    "no elements": (
        lambda: double_beam(LAW, 1.0, Section(0.5, 0.04, 0.005, elements=0)),
        "a beam needs elements; got 0",
    ),
    "elements below zero": (lambda: beam(Section(0.5, 0.04, 0.01, elements=-2)), "elements; got -2"),
    "more elements than memory": (
        lambda: beam(Section(0.5, 0.04, 0.01, elements=10**6)),
        "do not fit the memory; got 3000003",
    ),
    "no length": (lambda: double_beam(LAW, 1.0, Section(0.0, 0.04, 0.005)), "length = 0.0"),
    "width NaN": (lambda: double_beam(LAW, 1.0, Section(0.5, NAN, 0.005)), "width = nan"),
    "density below zero": (lambda: double_beam(LAW, 1.0, Section(0.5, 0.04, 0.005, density=-1.0)), "density = -1.0"),
    "a plate without elements": (
        lambda: plate_matrices(Plate(0.5, 0.4, 0.01, elements=(0, 2))),
        r"not a plate; got .*\(0, 2\)",
    ),
    "a plate larger than memory": (
        lambda: plate_matrices(Plate(1.0, 1.0, 0.01, elements=(2000, 2000))),
        "fit the memory",
    ),
    "Poisson's ratio": (lambda: plate_matrices(Plate(0.5, 0.4, 0.01, poisson=0.7)), "nu 0.7"),
    "shares below zero": (lambda: assemble(model(force_shares=np.array([2.0, -1.0]))), "least -1"),
    "shares NaN": (lambda: assemble(model(force_shares=np.array([1.0, NAN]))), "not shares of the normal force"),
    "no normal stiffness": (lambda: assemble(model(normal_stiffness=0.0)), "not a normal stiffness; got 0.0 N/m"),
    "normal forces for other joints": (lambda: model().with_normal_force([1.0, 2.0, 3.0]), "got 3, expected one"),
    "damping above one": (lambda: frf_with(Damping(ratio=1.5)), "not a background damping"),
}


def frf_with(damping):
    return frf(model(damping=damping), np.array([15.0]), 1.0, TIP, [TIP])


LAWS = {
    "shares of springs": (lambda: ParallelMasing(0.3, 1e9, [0.5, 0.2], [0.5, 0.5]), r"not shares; got .*\[0.5, 0.2\]"),
    "springs without shares": (lambda: ParallelMasing(0.3, 1e9, [0.5, 0.5], [1.0]), "got 2 and 1"),
    "no Iwan springs": (lambda: Iwan(0.3, 1e9, springs=0), "not an Iwan model; got .* 0 springs"),
    "chi": (lambda: Iwan(0.3, 1e9, -1.5), "chi -1.5"),
    "viscous below zero": (lambda: LuGre(0.3, 1e9, viscous=-3.0), "viscous=-3.0"),
    "static below sliding friction": (lambda: LuGre(0.3, 1e9, static_ratio=0.5), "static_ratio=0.5"),
    "shape of Dahl": (lambda: Dahl(0.3, 1e9, -1.0), "got -1.0"),
    "exponent NaN": (lambda: RegularisedMasing(0.3, 1e9, NAN), "not an exponent; got nan"),
    "exponent of k_T": (lambda: assemble(model(Masing(0.3, 1e9, stiffness_exponent=NAN))), r"exponent of k_T\(F_N\)"),
    "no k_T": (lambda: assemble(model(Masing(0.3, 0.0))), "contact stiffness; got 0.0 N/m"),
    "k_T without end": (lambda: assemble(model(Masing(0.3, float("inf")))), "got inf N/m.*use ema.simulate.Coulomb"),
    "rigid friction below zero": (lambda: assemble(model(Coulomb(0.3, -1.0))), "got -1.0 N/m"),
    "mu without end": (lambda: assemble(model(Masing(float("inf"), 1e9))), "not a friction coefficient; got inf"),
    "F_N without end": (lambda: assemble(model(force=float("inf"))), "not a normal force; got inf N"),
    "the name of another law": (lambda: register_law("masing", lambda *a: 0.0), "name of a built-in law; got masing"),
    "a contact that pulls": (lambda: own_contact(lambda depth: -depth, 1e-5), "not a curve of normal contact"),
    "a contact without numbers": (lambda: own_contact(lambda depth: NAN, 1e-5), "not a curve of normal contact"),
    "a curve of unequal lengths": (lambda: ContactCurve([0, 1e-6], [0.0]), "got 2 and 1"),
    "exponent of the contact": (
        lambda: assemble(model().with_normal_contact(PowerContact(0.5))),
        "got 0.5, expected 1",
    ),
}

LOOPS = {
    "amplitude below zero": (lambda: loop(LAW, 100.0, -1e-6), "amplitude = -1e-06"),
    "amplitude NaN": (lambda: loop(LAW, 100.0, NAN), "amplitude = nan"),
    "F_N below zero": (lambda: loop(LAW, -100.0, 1e-6), "not a normal force; got -100.0 N"),
    "mu below zero": (lambda: loop(Masing(-0.3, 1e9), 100.0, 1e-6), "friction_coefficient = -0.3"),
    "k_T below zero": (lambda: loop(Masing(0.3, -1e9), 100.0, 1e-6), "contact_stiffness = -1000000000.0"),
    "a rigid law": (lambda: loop(Coulomb(0.3), 100.0, 1e-6), "a rigid law has no loop"),
    "no samples": (lambda: loop(LAW, 100.0, 1e-6, samples=0), "samples.*got 0"),
    "no frequency": (lambda: loop(LAW, 100.0, 1e-6, frequency=0.0), "frequency = 0.0"),
    "nothing to identify": (lambda: identify([]), "no loop to identify a joint from"),
    "reference force": (lambda: identify([loop(LAW, 100.0, 1e-6)], 0.0), "reference_force = 0.0"),
    "forces NaN": (lambda: measured_loop(TIMES, MOTION, NAN * FORCE, 10.0), "NaN or infinite samples"),
    "frequency NaN": (lambda: measured_loop(TIMES, MOTION, FORCE, NAN), "not a frequency; got nan Hz"),
    "no cycle": (lambda: measured_loop(TIMES, MOTION, FORCE, 10.0, cycles=0), "got 0 cycles"),
    "less than a cycle": (lambda: measured_loop(TIMES, MOTION, FORCE, 1.0), "less than one cycle"),
}

WAVEFORMS = {
    "contact time": (lambda: hammer_pulse(TIMES, 1.0, -1.0), "contact_time = -1.0"),
    "peak": (lambda: hammer_pulse(TIMES, NAN, 1e-3), "peak = nan"),
    "sweep frequency": (lambda: swept_sine(TIMES, 1.0, (NAN, 10.0), 1.0), "start_frequency = nan"),
    "sweep time": (lambda: swept_sine(TIMES, 1.0, (5.0, 10.0), 0.0), "sweep_time = 0.0"),
    "sweeps": (lambda: swept_sine(TIMES, 1.0, (5.0, 10.0), 1.0, 0), "sweeps = 0"),
    "no steps": (lambda: stepped_sine(TIMES, 1.0, [], 0.1), "no frequency to stay at"),
    "a step below zero": (lambda: stepped_sine(TIMES, 1.0, [5.0, -5.0], 0.1), "frequencies = -5.0"),
    "dwell": (lambda: stepped_sine(TIMES, 1.0, [5.0], 0.0), "dwell = 0.0"),
    "level": (lambda: stepped_sine(TIMES, NAN, [5.0], 0.1), "level = nan"),
}

RIGS = {
    "a hammer without points": (lambda: RovingHammer(()), "no point to drive"),
    "a hammer without hits": (lambda: RovingHammer((POINT,), hits=0), "hits = 0"),
    "a scatter below zero": (lambda: RovingHammer((POINT,), scatter=-0.1), "scatter = -0.1"),
    "a band without width": (
        lambda: RandomShakers((POINT,), 1.0, (20.0, 20.0), 1.0),
        "not a band; got 20.0 to 20.0 Hz",
    ),
    "a shaker without level": (lambda: SweptShaker(POINT, NAN, (20.0, 30.0), 1.0, 1.0), "level = nan"),
    "a sweep from 0 Hz": (lambda: SweptShaker(POINT, 1.0, (0.0, 30.0), 1.0, 1.0), "start_frequency = 0.0"),
    "no stepped frequency": (lambda: SteppedSine(POINT, 1.0, ()), "no frequency to stay at"),
    "a stepped frequency below zero": (lambda: SteppedSine(POINT, 1.0, (5.0, -5.0)), "frequency = -5.0"),
    "a coil below zero": (lambda: Shaker(damping=-1.0), "damping = -1.0"),
    "a load NaN": (lambda: SnapBack(POINT, NAN, 1.0), "load = nan"),
    "a release of no time": (lambda: SnapBack(POINT, 20.0, 0.0), "duration = 0.0"),
    "a ring that pulls": (lambda: RingCell("J1", mean=-5.0), "ring J1: .*mean = -5.0"),
    "a ring without gain": (lambda: RingCell("J1", gain=0.0), "gain = 0.0"),
    "noise below zero": (lambda: rig(noise={"acceleration": -0.1}), "noise of acceleration = -0.1"),
    "no bits": (lambda: rig(bits=0), "bits = 0"),
    "no full scale": (lambda: rig(force_range=0.0), "force_range = 0.0"),
    "no tolerance": (lambda: rig(tolerance=NAN).take(0), "tolerance = nan"),
    "a joint that is not there": (
        lambda: rig(rings=(RingCell("J9"),)),
        "no such joint; got J9, expected one of interface",
    ),
}

STEADY = {
    "no frequency": (lambda: lines(), "not frequencies of excitation; got 0 values"),
    "a frequency below zero": (lambda: lines(-1.0, 15.0), "expected finite, above 0 Hz"),
    "0 Hz": (lambda: lines(0.0, 15.0), "expected finite, above 0 Hz"),
    "a frequency NaN": (lambda: lines(NAN, 15.0), "expected finite, above 0 Hz"),
    "force below zero": (lambda: lines(15.0, level=-1.0), "force = -1.0"),
    "force NaN": (lambda: lines(15.0, level=NAN), "force = nan"),
    "tolerance NaN": (lambda: lines(15.0, tolerance=NAN), "tolerance = nan"),
    "no output": (lambda: lines(15.0, outputs=()), "no motion to keep"),
    "no such DOF": (lambda: lines(15.0, at="beam 9:2:+Z"), "no such DOF; got beam 9:2:.Z"),
    "no levels": (lambda: mapped(levels=()), r"force_levels = \[\], expected one level or more"),
    "no normal forces": (lambda: mapped(normals=()), r"normal_forces = \[\]"),
    "a level below zero": (lambda: mapped(levels=(1.0, -1.0)), "force = -1.0"),
    "a normal force below zero": (lambda: mapped(normals=(-3.0,)), "not a normal force"),
    "a normal force NaN": (lambda: mapped(normals=(NAN,)), "not a normal force"),
    "a band the wrong way round": (lambda: mapped(band=(30.0, 10.0)), "not a band; got 30.0 to 10.0 Hz"),
    "a band NaN": (lambda: resonance(model(), 1.0, TIP, TIP, (NAN, 30.0)), "not a band"),
    "resonances of nothing": (lambda: resonances(model(), [], TIP, TIP, (10.0, 30.0)), r"forces = \[\]"),
}

ALL = {
    f"{topic}: {name}": order
    for topic, orders in {
        "structure": STRUCTURES,
        "law": LAWS,
        "loop": LOOPS,
        "waveform": WAVEFORMS,
        "rig": RIGS,
        "steady": STEADY,
    }.items()
    for name, order in orders.items()
}


@pytest.mark.parametrize("name", ALL)
def test_bad_input_is_one_sentence(name):
    order, words = ALL[name]
    with pytest.raises(InputError, match=words) as caught:
        order()
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 300
    assert caught.value.expected or caught.value.advice


def test_frequencies_in_any_order_are_answered_in_that_order():
    there, back = (lines(*f).values[:, 0, 0] for f in ((15.0, 16.5, 18.0), (18.0, 15.0, 16.5)))
    np.testing.assert_allclose(back, there[[2, 0, 1]], rtol=2e-2)


_OF_ANOTHER_KIND = """
import numpy as np
from ema.errors import InputError
from ema.simulate import HarmonicBalance, Masing, Section, double_beam, frf, resonance
model, tip, line = double_beam(Masing(0.3, 1e9), 60.0, Section(0.5, 0.04, 0.005, elements=1)), "beam 2:1:+Z", np.array([17.0])
for call in (
    lambda: frf(model, 17.0, 1.0, tip, [tip]),
    lambda: frf(model, np.full((2, 2), 17.0), 1.0, tip, [tip]),
    lambda: frf(model, np.array(["17 Hz"]), 1.0, tip, [tip]),
    lambda: frf(model, np.array([17.0 + 1j]), 1.0, tip, [tip]),
    lambda: frf(model, line, 1.0, tip, [tip], HarmonicBalance(harmonics=2.5)),
    lambda: frf(model, line, 1.0, tip, [tip], normal_forces=np.zeros((1, 0))),
    lambda: frf(model, line, 1.0, tip, [tip], normal_forces=5.0),
    lambda: resonance(model, 1.0, tip, tip, "10-50"),
    lambda: resonance(model, 1.0, tip, tip, (10.0,)),
):
    try:
        call()
    except InputError as error:
        print(error)
"""


def test_inputs_of_another_kind_to_steady_states():
    """In a process of its own: the types that the test run checks would be refused before."""
    done = subprocess.run([sys.executable, "-W", "error", "-c", _OF_ANOTHER_KIND], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == 9 and all("expected" in line for line in done.stdout.splitlines())


def test_static_corrections_alone_carry_a_slow_motion():
    """No mode kept, at a tenth of the first natural frequency: the response of all modes."""
    model, tip = double_beam(Masing(0.3, 1e9), 60.0, Section(0.5, 0.04, 0.005, elements=2)), "beam 2:2:+Z"
    few, all_modes = (
        frf(model, np.array([1.6]), 20.0, tip, [tip], HarmonicBalance(modes=kept)).values[0, 0, 0] for kept in (0, None)
    )
    assert few == pytest.approx(all_modes, rel=1e-3)
