"""Where the free decay behind an impact begins: behind the contact, and later behind a force window that cuts it off."""

from dataclasses import replace

import numpy as np
import pytest

from ema.compare import ring_down_modes
from ema.data import Channel, Condition, Excitation, ModalModel, Recording, Run, poles_from
from ema.dof import Dof
from ema.estimate.impact_decays import free_decays, impact_decays
from ema.simulate import Fault, RovingHammer, VirtualRig

RATE, BAND = 4096.0, (200.0, 800.0)
AT = Dof(1, "+Z")


def oscillator(contact: float, seed: int = 0, faults: tuple[Fault, ...] = (), force_noise: float = 0.5) -> Run:
    """Twelve impacts on an oscillator of 400 Hz, 1 % and 1 kg, with an accelerometer on it."""
    poles = poles_from(np.array([400.0]), np.array([0.01]))
    model = ModalModel(
        poles, np.ones((1, 1), complex), (AT,), 1 / (2j * poles.imag)[None], (AT,), scaling="unit modal mass"
    )
    sensor = Channel("acc", AT, quantity="acceleration", unit="m/s^2")
    drive = RovingHammer((AT,) * 4, 3, contact_time=contact, faults=faults)
    rig = VirtualRig(model, drive, (sensor,), RATE, noise={"acceleration": 0.01, "force": force_noise}, seed=seed)
    return Run("oscillator", Condition(Excitation(kind="hammer")), tuple(rig.takes()))


def windowed(record: Recording, samples: int) -> Recording:
    """The force behind a window of the front end that silences it ``samples`` after it has passed half of its peak."""
    signals = record.signals.copy()
    force = signals[0]
    top = 0.5 * force.max()
    for start in np.flatnonzero((force[1:] > top) & (force[:-1] <= top)) + 1:
        force[start + samples : start + samples + round(0.1 * RATE)] = 0.0
    return replace(record, signals=signals)


def behind(run: Run, samples: int) -> Run:
    return replace(run, recordings=tuple(windowed(one, samples) for one in run.recordings))


def masses(run: Run) -> list[float]:
    return [one.mode.modal_mass for one in ring_down_modes(run, BAND)]


@pytest.mark.parametrize("force_noise", [0.0, 0.5])
@pytest.mark.parametrize("contact", [0.3e-3, 0.6e-3, 1e-3])
def test_short_impacts_keep_their_beginning_and_their_modal_mass(contact, force_noise):
    """Two samples long, a pulse reaches half the sampling rate as one does that was cut off."""
    run = oscillator(contact, 7, force_noise=force_noise)
    blocks = free_decays(run, BAND).blocks
    assert len(blocks) == 12
    assert {block.ring - block.impact.pulse.stop for block in blocks if not block.impact.contacts} == {3}
    assert masses(run) == [pytest.approx(1.0, rel=0.05)]


@pytest.mark.parametrize("contact", [0.6e-3, 1e-3])
def test_a_window_that_closes_behind_the_contact_changes_nothing(contact):
    run = oscillator(contact, 8)
    sound = behind(run, 16)
    assert [one.ring for one in free_decays(sound, BAND).blocks] == [one.ring for one in free_decays(run, BAND).blocks]
    assert masses(sound) == [pytest.approx(1.0, rel=0.05)]


@pytest.mark.parametrize("samples", [1, 2])
@pytest.mark.parametrize("contact", [1e-3, 2e-3])
def test_behind_a_window_that_closes_within_the_contact_the_decay_begins_when_the_hammer_has_left(contact, samples):
    """The record without the window shows when that is. The force is not all of the force: it gives no modal mass."""
    run = oscillator(contact, 9)
    cut = behind(run, samples)
    left = {(block.record, block.impact.index): block.impact.pulse.stop for block in free_decays(run, BAND).blocks}
    blocks = free_decays(cut, BAND).blocks
    assert len(blocks) == 12
    assert all(block.ring >= left[block.record, block.impact.index] for block in blocks)
    found = ring_down_modes(cut, BAND)
    assert len(found) == 1 and np.isnan(found[0].mode.modal_mass)
    assert "force window" in found[0].mass.reason
    withheld = next(one for one in found[0].mode.findings if one.code == "modal-mass-withheld")
    assert "force window" in withheld.advice


def test_whole_impacts_give_the_modal_mass_beside_others_that_a_window_cuts_off():
    run = oscillator(1e-3, 10)
    records = (*(windowed(one, 1) for one in run.recordings[:2]), *run.recordings[2:])
    assert masses(replace(run, recordings=records)) == [pytest.approx(1.0, rel=0.05)]


def test_impacts_whose_decay_begins_later_have_the_modal_mass_of_the_others():
    """Every other impact has a second contact after 12 ms: a decay of 1 % at 400 Hz falls by a quarter until it begins."""
    faults = tuple(Fault(take, 1, "double hit", 0.3, 0.012) for take in range(4))
    run = oscillator(0.8e-3, 11, faults)
    blocks = free_decays(run, BAND).blocks
    gaps = [(block.ring - block.impact.start) / RATE for block in blocks]
    assert max(gaps) > 0.011 > 0.005 > min(gaps)
    assert masses(run) == [pytest.approx(1.0, rel=0.05)]


@pytest.mark.parametrize("contact", [0.2e-3, 0.6e-3, 2e-3])
def test_the_force_of_a_short_impact_does_not_depend_on_where_between_the_samples_it_falls(contact):
    """Amplitude over force is one number for all impacts; the force is band-limited and rings around its pulse. Cut off
    behind three samples it scattered by 2 %, and linear structures under short impacts were called not linear."""
    decays = impact_decays(oscillator(contact, 12, force_noise=0.0), BAND)
    constants = decays.amplitudes[:, 0, 0] / decays.forces[:, 0]
    assert np.std(constants) < 1e-3 * np.abs(constants.mean())
