"""The virtual rig against closed forms: what it delivers must be the truth, or every other test rests on sand."""

import numpy as np
import pytest

from ema import synthesis
from ema.data import Channel, ModalModel, Residuals, Source, poles_from
from ema.dof import Dof
from ema.errors import InputError
from ema.simulate import Fault, RandomShakers, RingCell, RovingHammer, SweptShaker, VirtualRig
from ema.simulate.waveforms import half_sine


def structure(frequencies=(100.0, 160.0, 431.0), damping=(0.02, 0.015, 0.01), complex_part=0.0) -> ModalModel:
    rng = np.random.default_rng(3)
    poles = poles_from(np.array(frequencies), np.array(damping))
    dofs = tuple(Dof(node, "+Z") for node in range(1, 6))
    shapes = rng.normal(size=(5, len(poles))) * (1 + complex_part * 1j * rng.normal(size=(5, len(poles)))) * 0.1
    return ModalModel(
        poles=poles,
        shapes=shapes,
        dofs=dofs,
        participation=shapes[:2] / (2j * poles.imag),
        inputs=dofs[:2],
        scaling="unit modal mass",
    )


def accelerometer(node=1, direction="+Z", quantity="acceleration", **more) -> Channel:
    return Channel(f"acc {node}", Dof(node, direction), quantity=quantity, unit="m/s^2", **more)


def half_sine_response(model: ModalModel, output: int, point: int, blow: tuple[float, float, float], t: np.ndarray):
    """Displacement by Duhamel's integral in closed form: convolution of exp(p t) with sin(pi t / T) on [0, T]."""
    start, peak, contact = blow
    w, tau = np.pi / contact, t - start
    end = np.clip(tau, 0, contact)
    total = np.zeros(len(t))
    for pole, residue in zip(model.poles, model.shapes[point] * model.participation[output], strict=True):
        at_end = (-(pole * np.sin(w * end) + w * np.cos(w * end)) + w * np.exp(pole * end)) / (pole**2 + w**2)
        total += 2 * np.real(residue * peak * at_end * np.exp(pole * (tau - end)))
    return np.where(tau > 0, total, 0)


def test_half_sine_transform_is_that_of_a_finely_sampled_pulse():
    t, step = np.linspace(0, 2e-3, 200_001, retstep=True)
    pulse = np.sin(np.pi * t / 2e-3)
    for f in (0.0, 130.0, 250.0, 750.0):
        direct = np.sum(pulse * np.exp(-2j * np.pi * f * t)) * step
        assert half_sine(np.array([f]), 2e-3)[0] == pytest.approx(direct, abs=1e-12)


@pytest.mark.parametrize("complex_part", [0.0, 0.1])
def test_displacement_is_duhamels_integral(complex_part):
    model = structure(complex_part=complex_part)
    drive = RovingHammer((Dof(4, "+Z"),), hits=3, contact_time=4e-3, spacing=0.3, scatter=0.2)
    rig = VirtualRig(model, drive, (accelerometer(1, quantity="displacement"),), sampling_rate=32768.0)
    record = rig.take(0)
    blows = drive.blows(0, np.random.default_rng([0, 0]))
    truth = sum(
        half_sine_response(model, 0, 3, (blow.time, blow.peak, blow.contact_time), record.times) for blow in blows
    )
    assert np.abs(record.signals[1] - truth).max() < 1e-6 * np.abs(truth).max()
    force = sum(
        np.where(
            (record.times >= blow.time) & (record.times <= blow.time + blow.contact_time),
            blow.peak * np.sin(np.pi * (record.times - blow.time) / blow.contact_time),
            0,
        )
        for blow in blows
    )
    # the kinks of a half sine hold content above the anti-alias filter, so the force itself agrees less closely
    assert np.abs(record.signals[0] - force).max() < 5e-3 * force.max()


def test_ratio_of_spectra_is_the_exact_accelerance():
    model = structure(damping=(0.05, 0.05, 0.05), complex_part=0.05)
    drive = RovingHammer((Dof(3, "-Z"), Dof(5, "-Z")), hits=1, contact_time=0.5e-3, spacing=1.5)
    rig = VirtualRig(model, drive, (accelerometer(1), accelerometer(2, "-Z")), sampling_rate=4096.0)
    for record in rig.takes():
        spectra = np.fft.rfft(record.signals, axis=1)
        frequencies = np.fft.rfftfreq(record.signals.shape[1], 1 / 4096)
        lines = (frequencies > 20) & (frequencies < 0.35 * 4096)
        measured = (spectra[1:] / spectra[0])[:, lines]
        exact = synthesis.frfs(
            model,
            frequencies[lines],
            "accelerance",
            outputs=[c.dof for c in record.channels[1:]],
            inputs=[record.channels[0].dof],
        )
        error = np.abs(measured - exact.values[:, :, 0].T).max() / np.abs(exact.values).max()
        assert error < 1e-6


def test_upper_residual_and_extra_poles_are_part_of_the_response():
    model = structure(damping=(0.05, 0.05, 0.05))
    residuals = Residuals(
        np.zeros((5, 2), complex),
        np.full((5, 2), 3e-9 + 0j),
        poles_from(np.array([700.0]), np.array([0.1])),
        np.full((1, 5, 2), -2e-6j),
    )
    model = ModalModel(**{**vars(model), "residuals": residuals})
    rig = VirtualRig(model, RovingHammer((Dof(3, "+Z"),), hits=1, spacing=1.5), (accelerometer(1),), 4096.0)
    spectra = np.fft.rfft(rig.take(0).signals, axis=1)
    frequencies = np.fft.rfftfreq(rig.samples, 1 / 4096)
    exact = synthesis.frfs(model, frequencies[100:1500], "accelerance", outputs=[Dof(1, "+Z")], inputs=[Dof(3, "+Z")])
    measured = (spectra[1] / spectra[0])[100:1500]
    assert np.abs(measured - exact.values[:, 0, 0]).max() < 1e-6 * np.abs(exact.values).max()


def test_a_slow_mode_does_not_wrap_round():
    """Before the first blow there is nothing, even where the last response has not died away at the end."""
    model = structure(frequencies=(3.0, 160.0, 431.0), damping=(0.01, 0.02, 0.01))
    rig = VirtualRig(
        model, RovingHammer((Dof(3, "+Z"),), hits=3, pre_trigger=0.2, contact_time=2e-3), (accelerometer(1),), 4096.0
    )
    response = rig.take(0).signals[1]
    assert np.abs(response[-400:]).max() > 1e-3 * np.abs(response).max()
    assert np.abs(response[:700]).max() < 1e-6 * np.abs(response).max()


def test_random_and_swept_shakers_give_the_frf():
    model = structure(damping=(0.05, 0.05, 0.05))
    points = (Dof(1, "+Z"), Dof(2, "+Z"))
    for drive in (
        RandomShakers(points, 5.0, (20.0, 600.0), duration=2.0, takes=2),
        SweptShaker(points[1], 10.0, (30.0, 550.0), sweep_time=2.0, duration=3.0),
    ):
        rig = VirtualRig(model, drive, (accelerometer(3),), 2048.0)
        record = next(iter(rig.takes()))
        # against an independent integration of the modal equations with the recorded forces held linearly
        from scipy.signal import lsim

        fine = 16 * record.signals.shape[1]
        from scipy.signal import resample

        total = 0
        for force, dof in zip(record.signals[: len(drive.dofs(0))], drive.dofs(0), strict=True):
            signal = resample(np.concatenate([force, np.zeros_like(force)]), 2 * fine)[:fine]
            t = np.arange(fine) / (16 * 2048)
            for r, pole in enumerate(model.poles):
                gain = model.shapes[2, r].real * model.shapes[dof.node - 1, r].real
                _, y, _ = lsim(([gain, 0, 0], [1, -2 * pole.real, abs(pole) ** 2]), signal, t)
                total = total + y[::16]
        # the first instants differ: a force that begins abruptly is band-limited by the front end
        error = (record.signals[-1] - total)[800:]
        assert np.abs(error).max() < 2e-3 * np.abs(total).max()
        assert rig.channels[0].role == "reference"


def test_faults_noise_range_and_resolution_are_as_ordered():
    model = structure()
    faults = (Fault(0, 1, "double hit", strength=0.4, delay=0.02), Fault(1, 2, "overload", strength=5.0))
    drive = RovingHammer(tuple(Dof(node, "-Z") for node in (3, 4, 5)), hits=3, scatter=0.05, faults=faults)
    rig = VirtualRig(
        model,
        drive,
        (accelerometer(1, range=500.0), accelerometer(2, range=500.0)),
        8192.0,
        force_range=2000.0,
        noise={"acceleration": 0.1, "force": 0.3},
        bits=16,
        reversed_sensors=("acc 2",),
        rings=(RingCell("J1", 1020.0, rms=2.0, drift=-10.0),),
        seed=11,
    )
    double, overload, clean = rig.takes()
    step = 4000 / 2**16
    assert np.allclose(double.signals[0] / step, np.round(double.signals[0] / step))
    assert np.std(clean.signals[1, :700]) == pytest.approx(np.hypot(0.1, 1e3 / 2**16 / 12**0.5), rel=0.1)
    force = double.signals[0]
    first = int(np.argmax(force[: int(1.3 * 8192)] * (double.times[: int(1.3 * 8192)] > 0.9)))
    second = first + int(0.02 * 8192)
    assert force[second - 20 : second + 20].max() == pytest.approx(0.4 * force[first], rel=0.05)
    assert overload.overloads is not None and bool(overload.overloads[0]) and overload.signals[0].max() == 2000.0
    assert clean.overloads is not None and not clean.overloads.any()
    plain = VirtualRig(model, drive, (accelerometer(1), accelerometer(2)), 8192.0, seed=11).take(2)
    assert np.corrcoef(plain.signals[1], clean.signals[1])[0, 1] > 0.99
    assert np.corrcoef(plain.signals[2], clean.signals[2])[0, 1] < -0.8
    ring = clean.signal("ring J1")
    assert ring.mean() == pytest.approx(1020, abs=0.2)
    assert ring[-4000:].mean() - ring[:4000].mean() == pytest.approx(-10, rel=0.15)
    assert clean.channels[3].joint == "J1" and clean.channels[3].role == "normal force"


def test_the_seed_alone_decides():
    rig = VirtualRig(
        structure(),
        RovingHammer((Dof(3, "+Z"), Dof(4, "+Z"))),
        (accelerometer(1),),
        4096.0,
        noise={"acceleration": 0.1},
        seed=5,
    )
    assert isinstance(rig, Source)
    assert np.array_equal(rig.take(1).signals, list(rig.takes())[1].signals)
    assert not np.array_equal(rig.take(0).signals[0], rig.take(1).signals[0])


def test_wrong_orders_are_refused_with_a_sentence():
    model = structure()
    drive = RovingHammer((Dof(9, "+Z"),))
    with pytest.raises(InputError, match="no such pair of DOFs"):
        VirtualRig(model, drive, (accelerometer(1),), 4096.0).take(0)
    with pytest.raises(InputError, match="needs a DOF and a motion"):
        VirtualRig(model, drive, (Channel("x"),), 4096.0)
    with pytest.raises(InputError, match="no such response channel"):
        VirtualRig(model, drive, (accelerometer(1),), 4096.0, reversed_sensors=("acc 7",))
    free = ModalModel(**{**vars(model), "residuals": Residuals(np.ones((5, 2), complex), np.zeros((5, 2), complex))})
    with pytest.raises(InputError, match="suspension modes"):
        VirtualRig(free, drive, (accelerometer(1),), 4096.0)
    with pytest.raises(InputError, match="no such fault"):
        Fault(0, 0, "tripple hit")
