"""Residues of vibrations that the record cuts off and a window damps, against closed forms."""

import numpy as np
import pytest
import scipy.fft

from ema import fit
from ema.data import Channel, FrfSet, Recording
from ema.estimate import HammerSettings, hammer_test
from ema.fit.modal import reconstruction_error
from ema.fit.uncertainty import residue_std
from ema.units import FRF_UNIT
from tests.unit.estimate_rig import DOFS, accelerometers, run_of, structure

ORDER = {"receptance": 0, "mobility": 1, "accelerance": 2}


def light(damping=(0.001, 0.0005, 0.001, 0.0007)):
    return structure((103.2, 160.7, 231.3, 300.4), damping)


def residue_errors(found, model):
    """Error of each residue matrix relative to its norm."""
    errors = []
    for pole, residue in zip(found.poles, found.residues(), strict=True):
        true = model.residues()[np.argmin(np.abs(model.poles - pole))]
        errors.append(np.linalg.norm(residue - true) / np.linalg.norm(true))
    return np.array(errors)


def recorded(model, quantity, decay, duration=1.0, noise=1e-3):
    """FRFs of free vibrations recorded for ``duration`` s under an exponential window: with s^n R exp(s t) as impulse
    response behind t = 0, the integral of s^n R exp((s - decay - j w) t) from 0 to T at w T = 2 pi k, written out."""
    order, rng = ORDER[quantity], np.random.default_rng(8)
    frequencies = np.arange(round(20 * duration), round(400 * duration)) / duration
    line = 2j * np.pi * frequencies + decay
    values = np.zeros((len(line), 4, 2), complex)
    for pole, residue in zip(model.poles, model.residues(), strict=True):
        for s, r in ((pole, residue), (pole.conj(), residue.conj())):
            cut = s**order * np.exp((s - decay) * duration)
            values += ((line**order - cut) / (line - s))[:, None, None] * r
    rms = np.sqrt(np.mean(np.abs(values) ** 2, axis=0))
    values += noise * rms * np.sqrt(0.5) * (rng.standard_normal(values.shape) + 1j * rng.standard_normal(values.shape))
    return FrfSet(
        frequencies=frequencies,
        values=values,
        outputs=DOFS,
        inputs=DOFS[:2],
        quantity=quantity,
        unit=FRF_UNIT[quantity],
        added_decay=decay,
        variance=np.ones(values.shape) * (noise * rms) ** 2,
        record_length=duration,
        window="exponential" if decay else "rectangular",
    )


@pytest.mark.parametrize("quantity", ["mobility", "accelerance"])
@pytest.mark.parametrize("decay", [0.0, 1.5])
def test_residues_are_those_of_the_whole_vibration(quantity, decay):
    model = light()
    measured = recorded(model, quantity, decay)
    found = fit.modes(measured, fit.stabilise(measured))
    assert len(found.poles) == 4
    np.testing.assert_allclose(found.damping_ratios, model.damping_ratios, rtol=0.01)
    left = np.abs(np.exp((model.poles - decay) * 1.0))
    assert np.all(left > 0.05), "what the end cuts off is to be seen"
    errors = residue_errors(found, model)
    assert np.all(errors < 0.01)
    stated = np.linalg.norm(residue_std(found), axis=(1, 2)) / np.linalg.norm(found.residues(), axis=(1, 2))
    assert np.all(errors < 5 * stated)
    _, error = reconstruction_error(measured, found)
    assert error.max() < 0.01, "the model as it was recorded"


@pytest.mark.parametrize("lead", [0.0, 0.03])
@pytest.mark.parametrize("decay", [0.0, None])
def test_a_hammer_test_that_is_cut_off(lead, decay):
    """Half sines on lightly damped modes, one record of 1 s each, by transforms 64 times as long."""
    rate, contact, samples = 4096.0, 1.2e-3, 4096
    model, rng = light((0.001,) * 4), np.random.default_rng(9)
    time = np.arange(samples) / rate - lead
    size = scipy.fft.next_fast_len(64 * samples, real=True)
    s = 2j * np.pi * scipy.fft.rfftfreq(size, 1 / rate)
    records = []
    for point in range(4):
        hammer = Channel("hammer", DOFS[point], quantity="force", role="reference", unit="N")
        accelerance = np.zeros((2, len(s)), complex)
        for pole, residue in zip(model.poles, model.residues()[:, point], strict=True):
            pair = residue[:, None] / (s - pole) + residue.conj()[:, None] / (s - pole.conj())
            accelerance += s**2 * pair
        for _ in range(3):
            pulse = np.where((time >= 0) & (time < contact), np.sin(np.pi * time / contact), 0)
            force = 100 * rng.uniform(0.8, 1.2) * pulse
            response = scipy.fft.irfft(accelerance * scipy.fft.rfft(force, size), size, axis=1)[:, :samples]
            signals = np.vstack([force, response])
            level = np.array([0.02, *(2e-3 * response.std(axis=1))])[:, None]
            noisy = signals + level * rng.standard_normal(signals.shape)
            records.append(Recording(noisy, rate, (hammer, *accelerometers(2)), name=f"{point} {len(records)}"))
    frfs, _ = hammer_test(run_of(records), HammerSettings(decay=decay))
    band = frfs.band(40, 400)
    found = fit.modes(band, fit.stabilise(band))
    np.testing.assert_allclose(found.damping_ratios, 0.001, rtol=0.01)
    assert np.all(residue_errors(found, model) < 0.01)
