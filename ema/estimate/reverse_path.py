"""Whether a mode depends on its amplitude within one random test: the reverse path, force as function of response.

Under random excitation the amplitude of a mode wanders between little and several times its mean, so that one test
holds a range of levels. The force that a joint with friction adds is a function of that amplitude.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.stats
from jaxtyping import Complex, Float

from ema.data import Finding, Recording, Run
from ema.estimate import channels

CHANCE = 1e-3
"""Probability, over all modes and responses together, up to which chance is no explanation."""
CHANGE = 0.03
"""Relative change of the dynamic stiffness at resonance from amplitude zero to the rms amplitude from which on a mode
counts as not linear: twice the force changes the peak by as much, which is the limit for impacts too."""
_REACH = 6.0
"""Half-widths at half power to either side of the resonance that are looked at."""
_GROUPS = 12
"""Stretches of time whose scatter tells the noise."""
_STEADY = 3.0
"""Decay times within a stretch, so that its neighbours say little about it."""
_MOST = 8
"""Responses that are looked at, evenly spread over those measured."""
_BLURRED = 4
"""Samples at either end, of the signals about 0 Hz, that the filter blurs."""
_UNEVEN = 0.05
"""Probability of as much scatter between stretches of time by chance, below which a test counts as uneven: its own
scatter is then the noise."""
_ATTENUATED = 3.0
"""Change over the share of the force that the response leaves unexplained, from which on it counts. Noise of the
channels hides the smallest amplitudes most where the level is not steady, as in bursts and ramps: that changes the
regression by up to 1.8 times this share (linear tables whose modes the force hardly reaches); slip by 4 and more."""
_SPECTRUM = 8
"""Parts of the band in which the spectrum of what is left of the force counts as flat."""
_AGAIN = 0.3
"""Correlation of a force with itself at a later time from which on it repeats. Chance makes 0.06 (30 s, 100 Hz)."""
_ORDERS = (4, 2)
"""Powers of the distance from the resonance for response and force: a mode, and its neighbours."""


@dataclass(frozen=True)
class AmplitudeDependence:
    """How the dynamic stiffness of a mode depends on its amplitude in a random test.

    Parameters
    ----------
    frequency : float
        Natural frequency [Hz].
    change : float
        Relative change of the dynamic stiffness at resonance from amplitude zero to the rms amplitude.
    chance : float
        Probability of as much by noise on a linear structure, over all responses.

    Examples
    --------
    >>> AmplitudeDependence(400.0, 0.2, 1e-9).change
    0.2
    """

    frequency: float
    change: float
    chance: float


def amplitude_dependence(
    run: Run, frequencies: Float[np.ndarray, "mode"], damping_ratios: Float[np.ndarray, "mode"]
) -> tuple[AmplitudeDependence, ...]:
    """Regress the force of a random test on a response near each mode, and on that response times its amplitude.

    Of a linear structure under Gaussian excitation all signals are jointly Gaussian, disturbances and noise of the
    channels included. What the response times its amplitude has beyond the response itself is then uncorrelated with
    the force, whatever is unknown. The probability is that of the scatter over stretches of time.

    Parameters
    ----------
    run : Run
        Records of random excitation with one force that does not repeat, for else there is nothing to compare.
    frequencies, damping_ratios : array of shape (mode,)
        Of the modes [Hz], [-].

    Returns
    -------
    tuple of AmplitudeDependence
        One for each mode whose decay is short enough for the records; the response that tells most.

    Raises
    ------
    InputError
        If a record cannot be used.

    References
    ----------
    .. [1] Reverse path: Bendat (1990), Nonlinear System Analysis and Identification from Random Data, Wiley; Richards
       and Singh (1998), Journal of Sound and Vibration 213, 673-708.

    Examples
    --------
    >>> from ema.data import Condition, Excitation
    >>> from ema.examples import recording
    >>> force = np.random.default_rng(1).normal(size=65536)
    >>> run = Run("random", Condition(Excitation("random")), (recording(force),))
    >>> [one.chance > 0.001 for one in amplitude_dependence(run, np.array([60.0]), np.array([0.01]))]
    [True]
    """
    records = channels.recordings_of(run)
    layouts = [channels.layout(record, channels.describe(run, record)) for record in records]
    if any(len(layout.references) != 1 for layout in layouts):
        return ()
    if any(_repeats(record.signals[layout.references[0]]) for record, layout in zip(records, layouts, strict=True)):
        return ()
    whole = sum(record.duration for record in records)
    groups = [max(round(_GROUPS * record.duration / whole), 1) for record in records]
    chosen = np.unique(np.linspace(0, len(layouts[0].responses) - 1, _MOST).astype(int))
    spectra = [
        np.fft.rfft(record.signals[[layout.references[0], *np.array(layout.responses)[chosen]]], axis=1)
        for record, layout in zip(records, layouts, strict=True)
    ]
    shortest = min(record.duration / count for record, count in zip(records, groups, strict=True))
    result = []
    for frequency, damping in zip(frequencies, damping_ratios, strict=True):
        width = float(damping * frequency)
        if not width > 0 or shortest < _STEADY / (2 * np.pi * width):
            continue
        parts = [
            _near(lines, record, float(frequency), _REACH * width)
            for lines, record in zip(spectra, records, strict=True)
        ]
        read = [_follows([part[[0, row]] for part in parts], groups) for row in range(1, len(parts[0]))]
        change, chance = min(read, key=lambda one: one[1])
        result.append(AmplitudeDependence(float(frequency), change, min(chance * len(read), 1.0)))
    return tuple(result)


def amplitude_finding(read: Sequence[AmplitudeDependence], where: str) -> Finding | None:
    """Say which modes depend on their amplitude; ``None`` where none is seen to.

    Parameters
    ----------
    read : sequence of AmplitudeDependence
        Of all modes.
    where : str
        What was measured.

    Returns
    -------
    Finding or None
        ``amplitude-dependence``.

    Examples
    --------
    >>> amplitude_finding([AmplitudeDependence(400.0, 0.2, 1e-9)], "run a").code
    'amplitude-dependence'
    >>> amplitude_finding([AmplitudeDependence(400.0, 0.2, 0.3)], "run a")
    """
    named = [one for one in read if one.chance * len(read) < CHANCE and one.change >= CHANGE]
    if not named:
        return None
    worst = max(named, key=lambda one: one.change)
    at = ", ".join(f"{one.frequency:.5g}" for one in named)
    return Finding.of(
        "warning",
        "amplitude-dependence",
        where,
        "The modes at {at} Hz depend on the vibration amplitude within this test: between small amplitudes and the "
        "rms amplitude the dynamic stiffness at {frequency} Hz changes by {change} %. The structure is not linear at "
        "this level.",
        worst.change,
        CHANGE,
        advice=(
            "Use the FRFs, natural frequencies and damping ratios for this excitation level only, and state the level "
            "with them. Repeat the test at half the level: if they change, test at the level of operation, or control "
            "the response amplitude with a stepped sine."
        ),
        at=at,
        frequency=f"{worst.frequency:.5g}",
        change=f"{100 * worst.change:.2g}",
    )


def _repeats(force: Float[np.ndarray, "sample"]) -> bool:
    """Whether a force comes again within a record: its stretches of time are then no independent samples."""
    spectrum = np.abs(np.fft.rfft(force - force.mean(), 2 * len(force))) ** 2
    correlation = np.fft.irfft(spectrum)[: len(force)] / max(float(spectrum.sum() / len(force)), np.finfo(float).tiny)
    later = correlation[len(force) // (2 * _GROUPS) : len(force) // 2]
    return bool(len(later) and np.max(later) > _AGAIN * correlation[0])


def _near(
    spectra: Complex[np.ndarray, "channel line"], record: Recording, frequency: float, reach: float
) -> Complex[np.ndarray, "channel order sample"]:
    """Analytic signals within ``reach`` Hz of a frequency, turned to 0 Hz, without the ends that the filter blurs.

    Order k is the signal filtered by the k-th power of the distance from the frequency, over ``reach``.
    """
    lines = np.fft.rfftfreq(record.signals.shape[1], 1 / record.sampling_rate)
    inside = np.flatnonzero(np.abs(lines - frequency) < reach)
    distance = (lines[inside] - frequency) / reach
    near = spectra[:, None, inside] * np.cos(0.5 * np.pi * distance) ** 2
    near = near * distance ** np.arange(max(_ORDERS[0], _ORDERS[1] + 1))[:, None]
    turned = np.fft.ifft(np.fft.ifftshift(near, axes=2), axis=2)
    return np.asarray(turned[:, :, _BLURRED:-_BLURRED])


def _follows(parts: Sequence[Complex[np.ndarray, "2 order sample"]], groups: Sequence[int]) -> tuple[float, float]:
    """Relative change of the dynamic stiffness up to the rms amplitude, and its probability by chance."""
    force, response = np.concatenate(parts, axis=2)
    rms = float(np.sqrt(np.mean(np.abs(response[0]) ** 2)))
    if not rms > 0:
        return 0.0, 1.0
    basis = np.concatenate([response[: _ORDERS[0]] / rms, force[1 : _ORDERS[1] + 1]]).T
    added = np.abs(response[0]) * response[0] / rms**2
    orthogonal = np.linalg.qr(basis)[0]
    beside, left = (one - orthogonal @ (orthogonal.conj().T @ one) for one in (added, force[0]))
    lengths = [len(one) for part, count in zip(parts, groups, strict=True) for one in np.array_split(part[0, 0], count)]
    starts = np.cumsum([0, *lengths[:-1]])
    cross = np.add.reduceat(beside.conj() * left, starts)
    power = np.add.reduceat(np.abs(beside) ** 2, starts)
    factor = cross.sum() / power.sum()
    # a complex number is two, and so many stretches tell its scatter
    count = len(starts)
    scatter = count / (count - 1) * float(np.sum(np.abs(cross - factor * power) ** 2))
    variance, freedom = _by_spectra(beside, left, basis.shape[1]), len(left) - 2 * basis.shape[1]
    if scatter > variance * scipy.stats.chi2.isf(_UNEVEN, 2 * (count - 1)) / (2 * (count - 1)):
        variance, freedom = scatter, 2 * (count - 1)
    ratio = abs(factor) ** 2 * power.sum() ** 2 / max(variance, np.finfo(float).tiny)
    chance = float(scipy.stats.f.sf(ratio, 2, max(freedom, 2)))
    whole = np.linalg.lstsq(np.column_stack([basis, added]), force[0], rcond=None)[0]
    change = float(abs(factor) / max(abs(whole[0]), np.finfo(float).tiny))
    unexplained = float(np.sum(np.abs(left) ** 2) / np.sum(np.abs(force[0]) ** 2))
    return change, chance if change > _ATTENUATED * unexplained else 1.0


def _by_spectra(
    regressor: Complex[np.ndarray, "sample"], residual: Complex[np.ndarray, "sample"], fitted: int
) -> float:
    """Variance of the product of two independent stationary signals, summed over time, by their spectra.

    The scatter of few stretches of time is too small by chance now and then; this one is not, but takes no notice of a
    structure or a level that changes during the test.
    """
    count = len(residual)
    spectrum = np.abs(np.fft.fft(residual)) ** 2 * count / max(count - fitted, 1)
    smooth = np.concatenate([np.full(len(part), part.mean()) for part in np.array_split(spectrum, _SPECTRUM)])
    return float(np.sum(np.abs(np.fft.fft(regressor)) ** 2 * smooth)) / count**2
