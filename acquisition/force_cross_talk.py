"""Cross-talk of the excitation force into the channel of a normal force.

What vibration does to a normal force changes its sign at the resonances of the structure; cross-talk between cables or
channels adds the same share of the force at all frequencies and all points. The share in phase with the force is read
in the middle between any two neighbouring resonances, as the median of the records, since a force near a joint does
reach its cell; and its mean over these bands is compared with what it scatters by from band to band. Vibration is noise
of this reading as that of the load cell is.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from ema.data import Finding, Recording

CHANCE = 0.01
"""Chance that a channel without cross-talk is named, were the bands independent and normal; its 95 % interval is
stated. Of 592 load cells on beams that vibrate on springs (hammer tests of 1 to 30 points, random and sweep tests) 3
were named, and 54 of 58 with cross-talk that were named lay in their intervals: where vibration adds to a small share
it is named more often (`python -m tests.bench.cross_talk --n 400 --seed 8200`)."""

LEAST = 0.002
"""Share of the force below which cross-talk is of no account: an impact of 1 kN shows as 2 N then, which is what load
cells have as noise."""

LEAST_BANDS = 4
"""Bands between resonances without which vibration and cross-talk are not told apart."""

_LEVEL = 0.1
"""Force spectrum, as a fraction of its largest, above which a line is excited (20 dB, as for the band of a hammer)."""

_PROMINENCE = 10.0
"""Ratio of the power of the responses at a resonance to that in the valleys beside it."""

_BINS = 4096
"""Of the axis from 0 Hz to half the sampling rate."""

_RECORDS = 64
"""Records of a run that are read; of more, as many spread evenly over the run."""

_KINDS = ("hammer", "random", "sweep")
"""Excitations of a band."""


def cross_talk_findings(
    records: Sequence[Recording], joints: dict[str, str], kind: str, where: str
) -> tuple[Finding, ...]:
    """One finding for each joint whose normal-force channel holds a share of the excitation force.

    Parameters
    ----------
    records : of a run.
    joints : channel of the normal force, by joint.
    kind : how the structure was driven.
    """
    if not joints or kind not in _KINDS or not len(records):
        return ()
    chosen = np.unique(np.linspace(0, len(records) - 1, min(len(records), _RECORDS)).astype(int))
    spectra = [one for one in (_Spectra.of(records[int(place)], joints) for place in chosen) if one is not None]
    if not spectra:
        return ()
    bands = _bands(spectra)
    if len(bands) < LEAST_BANDS:
        return ()
    findings = []
    for row, joint in enumerate(joints):
        shares = np.array([np.median([one.share(row, band) for one in spectra]) for band in bands])
        finding = _finding(shares, f"{where}, joint {joint}")
        findings += [finding] if finding else []
    return tuple(findings)


@dataclass(frozen=True)
class _Spectra:
    """Powers of force and responses of a record, and of each normal force in phase with the force, in bins."""

    force: Float[np.ndarray, "bin"]
    response: Float[np.ndarray, "bin"]
    in_phase: Float[np.ndarray, "joint bin"]

    @classmethod
    def of(cls, record: Recording, joints: dict[str, str]) -> "_Spectra | None":
        """``None`` where no force or several act, nothing responds, a force is none in N, or samples are no numbers."""
        forces, responses = record.with_role("reference"), record.with_role("response")
        rings = [row for name in joints.values() for row, one in enumerate(record.channels) if one.name == name]
        signals = np.asarray(record.signals, dtype=np.float64)[[*forces, *responses, *rings]]
        in_newtons = [
            one.scaled and one.quantity == "force" for one in (record.channels[row] for row in (*forces, *rings))
        ]
        sound = all(in_newtons) and np.all(np.isfinite(signals)) and np.any(signals[: len(forces)])
        if len(forces) != 1 or not len(responses) or len(rings) < len(joints) or not sound:
            return None
        # the line through a signal, which its mean and drift are, leaks into all lines
        position = np.linspace(-1.0, 1.0, signals.shape[1])
        signals -= signals.mean(axis=1, keepdims=True)
        signals -= (signals @ position / (position @ position))[:, None] * position
        spectra = np.fft.rfft(signals)
        edges = np.unique(np.linspace(0, spectra.shape[1], _BINS + 1).astype(int))[:-1]
        power = np.add.reduceat(np.abs(spectra[: 1 + len(responses)]) ** 2, edges, axis=1)
        crossed = np.add.reduceat((spectra[1 + len(responses) :] * np.conj(spectra[0])).real, edges, axis=1)
        # responses count alike, whatever their units
        total = power[1:].sum(axis=1, keepdims=True)
        relative = np.divide(power[1:], total, out=np.zeros_like(power[1:]), where=total > 0).sum(axis=0)
        return cls(power[0], relative, crossed)

    def share(self, row: int, band: slice) -> float:
        """The part of a normal force that is in phase with the force, over the force."""
        return float(self.in_phase[row, band].sum() / self.force[band].sum())


def _bands(spectra: Sequence[_Spectra]) -> list[slice]:
    """Bins in the middle halves between neighbouring resonances, within the lines that the force excites."""
    from scipy.signal import find_peaks

    if len({len(one.force) for one in spectra}) > 1:
        return []
    force = np.mean([one.force / one.force.max() for one in spectra], axis=0)
    height = np.sum([one.response / np.maximum(one.force, 1e-300) for one in spectra], axis=0)
    excited = force >= _LEVEL**2 * force.max()
    first, last = int(np.argmax(excited)), len(excited) - int(np.argmax(excited[::-1]))
    if last - first < 2 * LEAST_BANDS:
        return []
    with np.errstate(divide="ignore"):
        peaks, _ = find_peaks(np.log10(np.maximum(height[first:last], 1e-300)), prominence=np.log10(_PROMINENCE))
    ends = [first, *(first + peaks), last - 1]
    quarters = [(low, high, (high - low) // 4) for low, high in pairwise(ends)]
    return [slice(low + quarter, high - quarter) for low, high, quarter in quarters if high - low >= 4]


def _finding(shares: Float[np.ndarray, "band"], where: str) -> Finding | None:
    from scipy.stats import t

    freedom = len(shares) - 1
    share, std = float(shares.mean()), float(shares.std(ddof=1)) / np.sqrt(len(shares))
    if abs(share) < max(LEAST, float(t.isf(CHANCE / 2, freedom)) * std):
        return None
    half = float(t.isf(0.025, freedom)) * std
    return Finding.of(
        "warning",
        "normal-force-cross-talk",
        where,
        "In {bands} bands between resonances the normal force follows the excitation force at once, by {share} ± "
        "{half} % of it: as cross-talk between channels does, and vibration does not.",
        share,
        half,
        advice="Record an impact with the load cell off the joint: what it shows then is cross-talk. Part the cables "
        "and check their screens. A force that acts right at the joint reaches its cell as well.",
        bands=str(len(shares)),
        share=f"{100 * share:+.2g}",
        half=f"{100 * half:.2g}",
    )
