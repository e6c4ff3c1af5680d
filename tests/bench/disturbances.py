"""Errors that are not noise, put into FRFs of a known structure: one generator each, from none to severe.

A generator takes a random generator and a strength and gives FRFs with their truth. What a shaker test adds to its
signals is in :mod:`tests.bench.disturbances_shaker`, structures that are not linear in
:mod:`tests.bench.disturbances_nonlinear`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ema.data import FrfSet, ModalModel
from tests.bench.cases import (
    Case,
    _accelerance,
    _complex_modes,
    _log_uniform,
    _model,
    _spread,
    noise_std,
    unit_noise,
)

LOW, HIGH, LINES = 100.0, 500.0, 801
OUTPUTS, MODES = 6, 4
NOISE = 0.003
"""Noise of the undisturbed FRFs, as in :func:`tests.bench.cases.noise_std`."""
AVERAGES = 10


@dataclass(frozen=True)
class Disturbed:
    """Disturbed FRFs (in ``case``) and their truth.

    Parameters
    ----------
    frequency, damping : lowest and highest true value of each mode, (mode, 2), where these depend on the amplitude. An
        interval that meets the range is right. ``None`` where the truth of the case is exact.
    residues : whether the residues of the truth can be compared.
    """

    case: Case
    frequency: np.ndarray | None = None
    damping: np.ndarray | None = None
    residues: bool = True


@dataclass(frozen=True)
class Row:
    """One disturbance: strengths from none to severe, what they mean, and the findings that name it."""

    key: str
    meaning: str
    strengths: tuple[float, float, float, float, float]
    make: Callable[[np.random.Generator, float], Disturbed]
    causes: tuple[str, ...]


def structure(rng: np.random.Generator, lines: int = LINES, references: int = 1) -> Case:
    """Four separate modes in 100-500 Hz with 0.3 to 1.5 % damping, one mode outside on each side; noise on the lines.

    No output lies near a node: every component of a shape is 0.4 to 1 in size, so that every mode is seen everywhere.
    """
    frequencies = np.linspace(LOW, HIGH, lines)
    natural = np.concatenate([_spread(rng, MODES, LOW, HIGH), [0.7 * LOW, 1.3 * HIGH]])
    zeta = _log_uniform(rng, 0.003, 0.015, len(natural))
    shapes = rng.uniform(0.4, 1, (OUTPUTS, len(natural))) * rng.choice([-1, 1], (OUTPUTS, len(natural)))
    poles, complex_shapes = _complex_modes(rng, natural, zeta, shapes)
    within = (np.abs(poles) >= 2 * np.pi * LOW) & (np.abs(poles) <= 2 * np.pi * HIGH)
    places = np.arange(references)
    truth, rest = (_model(poles[keep], complex_shapes[:, keep], places, "disturbed") for keep in (within, ~within))
    clean = _accelerance(truth, frequencies) + _accelerance(rest, frequencies)
    std = noise_std(clean, NOISE)
    frfs = FrfSet(
        frequencies=frequencies,
        values=clean,
        outputs=truth.dofs,
        inputs=truth.inputs,
        quantity="accelerance",
        unit="m/s^2/N",
        estimator="synthetic",
        name="disturbed",
    )
    return Case("disturbed", 0, NOISE, frfs, clean, std, truth, rest)


def measured(rng: np.random.Generator, case: Case, clean: np.ndarray, std: np.ndarray, error: np.ndarray) -> Case:
    """The case with FRFs ``clean + error``, whose lines have the standard deviation ``std``.

    In half of the draws the FRFs come with coherence, variance and number of averages, in the other half bare.
    """
    frfs = replace(case.frfs, values=clean + error)
    if rng.random() < 0.5:
        freedom = 2 * (AVERAGES - 1)
        variance = std**2 * rng.chisquare(freedom, std.shape) / freedom
        power = np.abs(frfs.values) ** 2
        frfs = replace(
            frfs,
            variance=variance,
            coherence=power / (power + AVERAGES * variance),
            averages=np.full(std.shape[1:], float(AVERAGES)),
        )
    return replace(case, frfs=frfs, clean=clean, noise_std=std)


def noisy(rng: np.random.Generator, case: Case, clean: np.ndarray) -> Case:
    """The case with FRFs ``clean`` and independent noise on every line."""
    std = noise_std(clean, NOISE)
    return measured(rng, case, clean, std, std * unit_noise(rng, clean.shape))


def truncated(rng: np.random.Generator, strength: float) -> Disturbed:
    """One impact, and a rectangular record that ends before the response has.

    The acceleration after the impact is sum R p^2 exp(p t) + conj; what lies beyond T is missing in the FRF, and on the
    lines of the record, where exp(-j w T) = 1, that is R p^2 exp(p T) / (j w - p) + conj: poles stay, residues lose.
    Record length and window come with the FRFs, as from `ema.estimate`.
    """
    duration = (LINES - 1) / (HIGH - LOW)
    drawn = structure(rng)
    slowest = np.min(-drawn.truth.poles.real)
    factor = -np.log(max(strength, 1e-8)) / (slowest * duration)
    case = _redamped(drawn, factor)
    lost = np.zeros_like(drawn.clean)
    s = 2j * np.pi * case.frfs.frequencies
    for model in (case.truth, case.outside):
        for pole, residue in zip(model.poles, model.residues(), strict=True):
            part = residue * pole**2 * np.exp(pole * duration)
            lost += part / (s - pole)[:, None, None] + part.conj() / (s - pole.conj())[:, None, None]
    case = replace(case, frfs=replace(case.frfs, record_length=duration, window="rectangular"))
    return Disturbed(noisy(rng, case, case.clean - lost))


def _redamped(case: Case, factor: float) -> Case:
    """The case with all decay rates times ``factor``, its frequencies kept and its shapes made real."""

    def changed(model: ModalModel) -> ModalModel:
        omega = np.abs(model.poles)
        zeta = np.clip(-model.poles.real / omega * factor, 0, 0.5)
        poles = omega * (-zeta + 1j * np.sqrt(1 - zeta**2))
        shapes = model.shapes.real.astype(complex)
        rows = [model.dofs.index(dof) for dof in model.inputs]
        return replace(model, poles=poles, shapes=shapes, participation=shapes[rows] / (2j * poles.imag))

    truth, outside = changed(case.truth), changed(case.outside)
    frequencies = case.frfs.frequencies
    return replace(
        case, truth=truth, outside=outside, clean=_accelerance(truth, frequencies) + _accelerance(outside, frequencies)
    )


def delay(rng: np.random.Generator, strength: float) -> Disturbed:
    """Half of the response channels are late by ``strength`` microseconds."""
    case = structure(rng)
    late = rng.choice(OUTPUTS, OUTPUTS // 2, replace=False)
    clean = case.clean.copy()
    clean[:, late] *= np.exp(-2j * np.pi * case.frfs.frequencies * strength * 1e-6)[:, None, None]
    return Disturbed(noisy(rng, case, clean))


def common(rng: np.random.Generator, strength: float) -> Disturbed:
    """All FRFs of an excitation share a relative error of their lines: noise of the force channel."""
    case = structure(rng)
    shared = strength * unit_noise(rng, (len(case.frfs.frequencies), 1, len(case.frfs.inputs))) * case.clean
    own = noise_std(case.clean, NOISE)
    std = np.sqrt(own**2 + (strength * np.abs(case.clean)) ** 2)
    return Disturbed(measured(rng, case, case.clean, std, own * unit_noise(rng, own.shape) + shared))


def edge(rng: np.random.Generator, strength: float) -> Disturbed:
    """The band ends at a resonance: ``strength`` is 1 / (1 + distance in half-power bandwidths), 1 on the resonance."""
    case = structure(rng)
    distance = np.inf if strength == 0 else 1 / strength - 1
    frequency, zeta = case.truth.natural_frequencies[-1], case.truth.damping_ratios[-1]
    last = min(frequency * (1 + 2 * zeta * distance), HIGH) if np.isfinite(distance) else HIGH
    keep = case.frfs.frequencies <= last + 0.5 * case.frfs.frequency_step
    cut = replace(case, frfs=case.frfs.lines(keep), clean=case.clean[keep], noise_std=case.noise_std[keep])
    return Disturbed(noisy(rng, cut, cut.clean))


def rigid(rng: np.random.Generator, strength: float) -> Disturbed:
    """A structure on soft springs: rigid-body modes at 2 to 8 Hz, below a band from 10 Hz; their share of the rms."""
    case = structure(rng)
    frequencies = np.linspace(10.0, HIGH, 981)
    rows = [case.truth.dofs.index(dof) for dof in case.truth.inputs]
    x = np.linspace(-1, 1, OUTPUTS)
    shapes = np.array([np.ones(OUTPUTS), x]).T.astype(complex)
    omega, zeta = 2 * np.pi * rng.uniform(2, 8, 2), rng.uniform(0.02, 0.1, 2)
    poles = omega * (-zeta + 1j * np.sqrt(1 - zeta**2))
    body = replace(case.truth, poles=poles, shapes=shapes, participation=shapes[rows] / (2j * poles.imag))
    elastic = _accelerance(case.truth, frequencies) + _accelerance(case.outside, frequencies)
    size = strength * np.sqrt(np.mean(np.abs(elastic) ** 2) / np.mean(np.abs(_accelerance(body, frequencies)) ** 2))
    body = replace(body, shapes=shapes * size)
    clean = elastic + _accelerance(body, frequencies)
    inside = (case.outside.natural_frequencies > 10.0) & (case.outside.natural_frequencies < HIGH)
    truth, outside = _moved(case, body, inside)
    std = noise_std(clean, NOISE)
    made = replace(
        case,
        frfs=replace(case.frfs, frequencies=frequencies, values=clean),
        clean=clean,
        noise_std=std,
        truth=truth,
        outside=outside,
    )
    return Disturbed(noisy(rng, made, clean))


def _moved(case: Case, body: ModalModel, inside: np.ndarray) -> tuple[ModalModel, ModalModel]:
    """Truth and outside, with those of the outside that are ``inside`` the wider band, and with the rigid-body modes."""

    def joined(models: list[tuple[ModalModel, np.ndarray]]) -> ModalModel:
        poles = np.concatenate([model.poles[keep] for model, keep in models])
        order = np.argsort(np.abs(poles))
        return replace(
            case.truth,
            poles=poles[order],
            shapes=np.concatenate([model.shapes[:, keep] for model, keep in models], axis=1)[:, order],
            participation=np.concatenate([model.participation[:, keep] for model, keep in models], axis=1)[:, order],
        )

    every = np.ones(len(case.truth.poles), bool)
    return (
        joined([(case.truth, every), (case.outside, inside)]),
        joined([(case.outside, ~inside), (body, np.any(body.shapes != 0, axis=0))]),
    )


def mains(rng: np.random.Generator, strength: float) -> Disturbed:
    """Tones at the multiples of 50 Hz, ``strength`` times the rms of each FRF, of Hann or of rectangular records.

    A tone d lines beside a line leaks into it as the spectrum of the window: sinc(d) of a rectangular record, which falls
    as slowly as the flank of an undamped mode, and sinc(d) / (1 - d^2) of a Hann window (ISO 18431-2).
    """
    case = structure(rng)
    frequencies = case.frfs.frequencies
    std = noise_std(case.clean, NOISE)
    error = std * unit_noise(rng, std.shape)
    rms = np.sqrt(np.mean(np.abs(case.clean) ** 2, axis=0))
    variance, hann = std**2, rng.random() < 0.5
    for tone in np.arange(50.0, HIGH + 1, 50.0) * rng.uniform(0.9995, 1.0005):
        distance = (frequencies - tone) / case.frfs.frequency_step
        distance += 1e-6 * (np.abs(np.abs(distance) - 1) < 1e-6)
        leaked = np.sinc(distance) * np.exp(-1j * np.pi * distance) / (1 - distance**2 if hann else 1)
        size = strength * rms * unit_noise(rng, rms.shape) * np.exp(rng.uniform(-1, 0))
        error += leaked[:, None, None] * size
        variance += (np.abs(leaked)[:, None, None] * strength * rms) ** 2
    return Disturbed(measured(rng, case, case.clean, np.sqrt(variance), error))


def zero_padding(rng: np.random.Generator, strength: float) -> Disturbed:
    """Records with zeros after them, so that lines are ``strength`` times as dense as the records resolve.

    Vibration and noise of the record end with it. The acceleration after an impact, sum R p^2 exp(p t) + conj., lacks
    exp((p - j w) T) R p^2 / (j w - p) + conj. then; the decay rates are such that 0.0001 is left of the slowest one.
    """
    drawn, duration = structure(rng, round((LINES - 1) / 2 * strength) + 1), (LINES - 1) / 2 / (HIGH - LOW)
    case = _redamped(drawn, max(1.0, np.log(1e4) / float(np.min(-drawn.truth.poles.real) * duration)))
    s = 2j * np.pi * case.frfs.frequencies
    lost = np.zeros_like(case.clean)
    for model in (case.truth, case.outside):
        for pole, residue in zip(model.poles, model.residues(), strict=True):
            part = residue * pole**2
            for p, r in ((pole, part), (pole.conj(), part.conj())):
                lost += r * (np.exp((p - s) * duration) / (s - p))[:, None, None]
    clean = case.clean - lost
    std = np.broadcast_to(np.sqrt(np.mean(noise_std(clean, NOISE) ** 2, axis=0)), clean.shape)
    samples = LINES - 1
    time = np.zeros((round(samples * strength), *std.shape[1:]), complex)
    time[:samples] = unit_noise(rng, (samples, *std.shape[1:]))
    dense = np.fft.fft(time, axis=0)[: len(s)] / np.sqrt(samples)
    return Disturbed(measured(rng, case, clean, std, std * dense))


WINDOWS = (
    (1.0,),
    (-0.23, 0.54, -0.23),
    (-0.25, 0.5, -0.25),
    (0.04, -0.25, 0.42, -0.25, 0.04),
    (0.0032, -0.0403, 0.139, -0.2078, 0.1079 * 2, -0.2078, 0.139, -0.0403, 0.0032),
)
"""Spectral lines of the rectangular, Hamming, Hann, Blackman and flat-top window (ISO 18431-2, rounded)."""


def window(rng: np.random.Generator, strength: float) -> Disturbed:
    """The noise of neighbouring lines depends through the window of the blocks; resonances are resolved."""
    case = structure(rng)
    kernel = np.array(WINDOWS[int(strength)])
    std = noise_std(case.clean, NOISE)
    return Disturbed(measured(rng, case, case.clean, std, std * _convolved(rng, kernel, std.shape)))


def _convolved(rng: np.random.Generator, kernel: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    white = unit_noise(rng, (shape[0] + len(kernel) - 1, *shape[1:]))
    parts = [weight * white[start : start + shape[0]] for start, weight in enumerate(kernel)]
    return np.sum(parts, axis=0) / np.linalg.norm(kernel)


def smoothing(rng: np.random.Generator, strength: float) -> Disturbed:
    """FRFs averaged over ``strength`` neighbouring lines, resonances and noise alike."""
    width = int(strength)
    step = (HIGH - LOW) / (LINES - 1)
    case = structure(rng)
    around = np.arange(-(width // 2), width // 2 + 1)
    frequencies = LOW + step * np.arange(around[0], LINES + around[-1])
    wide = _accelerance(case.truth, frequencies) + _accelerance(case.outside, frequencies)
    std = noise_std(wide, NOISE)
    raw = wide + std * unit_noise(rng, std.shape)
    values = np.mean([raw[start : start + LINES] for start in range(width)], axis=0)
    smoothed = np.sqrt(np.mean([std[start : start + LINES] ** 2 for start in range(width)], axis=0) / width)
    return Disturbed(measured(rng, case, case.clean, smoothed, values - case.clean))


def roll_off(rng: np.random.Generator, strength: float) -> Disturbed:
    """The force falls by ``strength`` dB towards the upper end of the band and by half of it towards the lower end.

    The noise of the responses is the same on all lines, so that of the FRFs rises as the force falls: the outer parts of
    the band hold nothing but noise, as behind a soft hammer tip.
    """
    case = structure(rng)
    place = (case.frfs.frequencies - LOW) / (HIGH - LOW)
    fall = strength * np.clip((place - 0.6) / 0.4, 0, 1) ** 2 + 0.5 * strength * np.clip((0.2 - place) / 0.2, 0, 1) ** 2
    std = noise_std(case.clean, NOISE) * 10 ** (fall[:, None, None] / 20)
    return Disturbed(measured(rng, case, case.clean, std, std * unit_noise(rng, std.shape)))


ROWS = (
    Row(
        "truncated records",
        "exp(-s T) of the slowest mode at the end of the record",
        (0.0, 0.003, 0.03, 0.1, 0.3),
        truncated,
        ("truncated-record", "leakage"),
    ),
    Row("delay", "microseconds on half of the channels", (0.0, 3.0, 10.0, 40.0, 120.0), delay, ("channel-delay",)),
    Row("common noise", "relative noise that all FRFs share", (0.0, 0.003, 0.01, 0.03, 0.1), common, ("common-noise",)),
    Row("band edge", "1 / (1 + distance of the edge in bandwidths)", (0.0, 0.2, 0.33, 0.5, 1.0), edge, ("band-edge",)),
    Row(
        "rigid bodies",
        "rms over that of the elastic modes",
        (0.0, 0.3, 1.0, 3.0, 10.0),
        rigid,
        ("rigid-body", "band-edge"),
    ),
    Row(
        "mains",
        "amplitude of the tones over the rms of an FRF",
        (0.0, 0.1, 0.5, 2.0, 10.0),
        mains,
        ("mains", "tones", "harmonics"),
    ),
    Row(
        "zero padding",
        "density of the lines over the resolution",
        (1.0, 1.5, 2.0, 4.0, 8.0),
        zero_padding,
        ("dependent-lines",),
    ),
    Row(
        "window",
        "rectangular, Hamming, Hann, Blackman, flat-top",
        (0.0, 1.0, 2.0, 3.0, 4.0),
        window,
        ("dependent-lines",),
    ),
    Row("smoothing", "lines averaged", (1.0, 3.0, 5.0, 9.0, 15.0), smoothing, ("dependent-lines", "smoothed-lines")),
    Row(
        "force roll-off",
        "fall of the force towards the end of the band in dB",
        (0.0, 15.0, 30.0, 45.0, 60.0),
        roll_off,
        ("usable-band", "low-coherence", "noisy-frfs"),
    ),
)
"""The disturbances of FRFs. The first strength of each is none."""
