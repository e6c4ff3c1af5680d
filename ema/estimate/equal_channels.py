"""Channels that show one signal: a file or plug was taken twice, or a response channel records the force.

Two sensors never have the same noise. Vibration of one mode without any noise is the same in all channels, so two are
compared only beside a third that differs.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ema.data import Finding, Recording, Run
from ema.estimate import channels

ALIKE = 1e-5
"""What is left of a channel less a multiple of the other one, over its rms (-100 dB): single precision leaves 1e-7, the
noise of two sensors and their converters more than 1e-4."""

LENGTH = 2**12
"""Samples about the largest force that are compared."""


def about_channels(run: Run) -> tuple[Finding, ...]:
    """A finding for each group of channels of the first record that differ by no more than a factor."""
    record = run.recordings[0]
    layout = channels.layout(record, channels.describe(run, record))
    rows = [*layout.references, *layout.responses]
    signals = _stretch(record, rows)
    alike = _alike(signals)
    findings = []
    for place, row in enumerate(rows):
        same = np.flatnonzero(alike[place])
        responses = same[same >= len(layout.references)]
        if len(same) < 2 or same[0] != place or not len(responses):
            continue
        others = [k for k in range(len(layout.references), len(rows)) if k not in same and signals[k].any()]
        if others:
            findings.append(_finding(record, [rows[k] for k in same], row in layout.references, channels.describe(run)))
    return tuple(findings)


def _stretch(record: Recording, rows: Sequence[int]) -> Float[np.ndarray, "channel sample"]:
    """Signals about the largest force, less their means and over their norms; zeros where a channel is constant."""
    force = record.signals[rows[0]]
    start = max(min(int(np.abs(force).argmax()) - LENGTH // 4, len(force) - LENGTH), 0)
    signals = record.signals[list(rows), start : start + LENGTH].astype(np.float64)
    signals -= signals.mean(axis=1, keepdims=True)
    norm = np.linalg.norm(signals, axis=1, keepdims=True)
    return np.asarray(np.divide(signals, norm, out=np.zeros_like(signals), where=norm > 0))


def _alike(signals: Float[np.ndarray, "channel sample"]) -> np.ndarray:
    """Pairs of channels that are multiples of each other, a channel with itself included."""
    cosine = signals @ signals.T
    result = np.eye(len(signals), dtype=bool)
    for a, b in np.argwhere(np.triu(np.abs(cosine) > 1 - 1e-6, 1)):
        # the cosine rounds what is left
        result[a, b] = result[b, a] = np.linalg.norm(signals[a] - np.sign(cosine[a, b]) * signals[b]) < ALIKE
    return result


def _finding(record: Recording, rows: Sequence[int], force: bool, where: str) -> Finding:
    """What is to be said of channels that show one signal."""
    names = [record.channels[row].name for row in rows]
    return Finding.of(
        "error",
        "equal-channels",
        where,
        "channels {first} and {last} show one signal, the force, to the last digit of their noise, while others "
        "differ: shapes and residues at all of them but one are wrong."
        if force
        else "channels {first} and {last} show one signal to the last digit of their noise, while others differ: "
        "shapes and residues at all of them but one are wrong.",
        float(len(rows)),
        1.0,
        advice="Look for a plug, a file or a column that was taken twice; correct the channel table or leave the "
        "copies out.",
        first=", ".join(names[:-1]),
        last=names[-1],
    )
