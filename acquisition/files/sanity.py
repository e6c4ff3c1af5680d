"""What no measurement looks like, looked for in whatever a reader delivers."""

from typing import Any

import numpy as np

from acquisition.contents import Contents
from acquisition.files.arrays import CONSTANT_FROM
from acquisition.files.ratios import check_frequencies
from acquisition.files.signals import same_rate
from ema.data import Finding, FrfSet, Recording
from ema.errors import InputError

LARGEST = 1e30
"""Magnitude in SI that no measurement has: the power of a star in W is 1e27. At 1e15 or 1e60, bytes in the wrong order,
which make any exponent, are found as well."""
MIRRORED = 1e-3
"""Relative difference from which two lines are not each other's conjugates, and share of the imaginary part from which
an FRF is complex: numbers of four digits. No measured FRF comes near it on every line; halved or doubled, files of
three or five digits are judged otherwise."""
_PEEK = 4096
"""Samples that are compared first: a channel that is not constant mostly shows it here."""


def examine(contents: Contents, sampling_rate: float | str | None = None) -> tuple[Finding, ...]:
    """Findings about channels and FRFs that are one and the same number throughout, or beyond what can be measured.

    ``sampling_rate`` in Hz is what the layout says of all recordings; a text names a place and was used by the reader.

    Raises
    ------
    InputError : frequencies that do not increase, are negative or no numbers; FRFs whose upper half mirrors the lower;
        a recording of another sampling rate.
    """
    if isinstance(sampling_rate, (int, float)):
        for recording in contents.recordings:
            same_rate(recording.sampling_rate, sampling_rate, recording.signals.shape[1], recording.name)
    for frfs in contents.frfs:
        check_frequencies(frfs.frequencies, frfs.name)
        _check_one_sided(frfs)
    found = [_channels(recording) for recording in contents.recordings]
    found += [_frfs(frfs) for frfs in contents.frfs]
    found += [_beyond(one.signals, one.name) for one in contents.recordings]
    found += [_beyond(one.values, one.name) for one in contents.frfs]
    return tuple(note for notes in found for note in notes)


def _check_one_sided(frfs: FrfSet) -> None:
    """Refuse a two-sided spectrum: of a real record of N samples the line N - k is the complex conjugate of line k.

    Source: Oppenheim, Schafer, Discrete-Time Signal Processing, 3rd ed. (2010), section 8.6.4. With the line at 0 Hz
    the lines k and L - k of L lines belong together; without it, or with that of the sampling rate, k and L - 1 - k.

    Raises
    ------
    InputError : the upper half is the mirror of the lower one.
    """
    lines = len(frfs.frequencies)
    if lines < CONSTANT_FROM or not frfs.values[0].size:
        return
    values = np.asarray(frfs.values[:, 0, 0])
    with np.errstate(all="ignore"):
        size = np.abs(values)
        if not np.abs(values.imag).max() > MIRRORED * size.max():
            return  # without an imaginary part, or with numbers that are none, nothing is known
        for first in (1, 0):
            pair = values[first:][::-1]
            if np.all(np.abs(values[first:] - pair.conj()) <= MIRRORED * size[first:]):
                middle = float(frfs.frequencies[(lines + first) // 2])
                raise InputError(
                    "a two-sided spectrum: the upper half of the FRF is the mirror of the lower one",
                    where=frfs.name,
                    got=f"{lines} lines up to {frfs.frequencies[-1]:g} Hz",
                    expected=f"lines up to {middle:g} Hz, half of the sampling rate",
                    advice="export the one-sided FRF; above that frequency every resonance would be found again",
                )


def _constant(values: Any) -> bool:
    with np.errstate(invalid="ignore"):
        return bool((values[:_PEEK] == values[0]).all() and (values == values[0]).all())


def _channels(recording: Recording) -> tuple[Finding, ...]:
    if recording.signals.shape[1] < CONSTANT_FROM:
        return ()
    still = [k for k, signal in enumerate(recording.signals) if _constant(signal)]
    return tuple(
        Finding(
            "warning",
            "constant",
            f"{recording.name}, {recording.channels[k].name}",
            f"all {recording.signals.shape[1]} samples are {recording.signals[k, 0]:.6g}.",
            float(recording.signals[k, 0]),
            None,
            "The channel was dead or not used; leave it out.",
        )
        for k in still
    )


def _frfs(frfs: FrfSet) -> tuple[Finding, ...]:
    lines = len(frfs.frequencies)
    if lines < CONSTANT_FROM:
        return ()
    with np.errstate(invalid="ignore"):  # a NaN of a damaged file equals nothing, in whatever bits it is written
        still = np.argwhere((frfs.values == frfs.values[:1]).all(axis=0))
    if not len(still):
        return ()
    first = frfs.label(int(still[0, 0]), int(still[0, 1]))
    message = f"{len(still)} FRFs have the same value on all {lines} lines, first {first}."
    return (
        Finding(
            "warning",
            "constant",
            frfs.name,
            message,
            float(len(still)),
            0.0,
            "A channel was dead, or a column was filled in; leave it out.",
        ),
    )


def _beyond(values: Any, where: str) -> tuple[Finding, ...]:
    """A finding where a number is larger than any measured."""
    parts = (values.real, values.imag) if np.iscomplexobj(values) else (values,)
    with np.errstate(invalid="ignore"):
        # NaN is no larger; infinite numbers have a finding of their own
        ends = [max(float(np.fmax.reduce(part, axis=None)), -float(np.fmin.reduce(part, axis=None))) for part in parts]
    if not LARGEST < max(ends, default=0.0) < np.inf:
        return ()
    message = f"numbers up to {max(ends):.3g} are none that can be measured."
    advice = "The order of the bytes or the type of the numbers is wrong, or they are damaged; export the file again."
    return (Finding("error", "implausible", where, message, max(ends), LARGEST, advice),)
