"""Places at which the signals of a record break: samples that were lost, repeated or filled in, jumps and spikes.

What a vibration does next follows from its own past and from the force: over a few samples it is an autoregressive
process with the force as input (Ljung 1999, section 4.2). Where samples are missing the next one is another one, by
about the rms of the signal, while all others are predicted to within their noise. A force that jumps by itself, as
where a sweep begins, breaks nothing: the responses follow it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.ndimage
import scipy.signal
from jaxtyping import Bool, Float, Int

from ema.data import Finding, Recording, Run
from ema.data.stored_signals import StoredSignals
from ema.estimate import channels

ORDER = 16
"""Samples of response and force from which the next sample of a response is predicted: two for each of eight modes."""

NEAR, BESIDE = 24, 128
"""Samples on either side of one that a break changes (through the past of what follows), and up to which the scatter of
the prediction is taken."""

CLEAR = 10.0
"""Error of a prediction over its scatter in the neighbourhood from which on it is no noise: by chance once in 1e23."""

LARGE = 0.1
"""Error of a prediction over the rms of the channel from which on a break matters: the scatter of the prediction in
records whose noise is a hundredth of their vibration is a few hundredths.

Of 80 clean random and swept tests with noise of 0.01 to 10 %, and of 80 with noise of the force as well, none is named.
Where samples of all channels or of one are lost, errors are 0.1 to 4, and 154 of 160 tests are named; with 0.2 it is
152. The choice between 0.1, 0.2 and 0.3 was made on these tests. Of 100 others with lost samples 91 are named, of 50
clean ones none.
"""

SILENT = 0.3
"""Rms of the force over that on the other side of a sample, below which the force was switched there: what is left is
its noise, which may be as large as a fifth."""

LEARNT = 8, 4096
"""Stretches of a long record, and their samples, from which the prediction is learnt."""

FEWEST = 1024
"""Samples of a record below which the prediction is not learnt: thirty for each unknown."""

MOST = 2**26
"""Samples of a run that are looked at: of longer ones every second channel, every third and so on."""

_AT_ONCE = 2**20
"""Samples of all channels that are looked at together."""


@dataclass(frozen=True)
class Break:
    """Sample at which responses break, the rows of those that do, and the largest error over the rms of its channel."""

    sample: int
    rows: tuple[int, ...]
    size: float


def about_breaks(run: Run) -> tuple[Finding, ...]:
    """A finding for the record of a hammer, random or swept test that breaks most often."""
    worst: tuple[Recording, list[Break]] | None = None
    bent: tuple[Recording, list[int]] | None = None
    count = 0
    size = sum(record.signals.shape[0] * record.signals.shape[1] for record in run.recordings)
    for record in run.recordings:
        suspected = breaks(record, every=-(-size // MOST))
        found = _beyond_powers(record, suspected)
        if suspected and not found and bent is None:
            bent = record, sorted({row for one in suspected for row in one.rows})
        count += bool(found)
        if found and (worst is None or len(found) > len(worst[1])):
            worst = record, found
    if worst is not None:
        return (_finding(run, *worst, count),)
    return () if bent is None else (_about_powers(run, *bent),)


def _beyond_powers(record: Recording, found: Sequence[Break]) -> list[Break]:
    """Breaks that squares and cubes of the force and of the channel itself do not explain.

    A sensor that bends with its signal departs from a linear prediction at every peak, and breaks nowhere.
    """
    if not found:
        return []
    layout = channels.layout(record, record.name)
    left: dict[int, Int[np.ndarray, place]] = {}
    for row in {row for one in found for row in one.rows}:
        signals = np.array([record.signals[each] for each in (*layout.references, row)], dtype=np.float64)
        signals -= signals.mean(axis=1, keepdims=True)
        signals /= np.maximum(signals.std(axis=1, keepdims=True), 1e-300)
        signals = np.vstack([signals[:-1], signals**2, signals**3, signals[-1:]])
        means, sizes = signals.mean(axis=1, keepdims=True), signals.std(axis=1, keepdims=True)
        count, inputs = len(layout.references), len(signals) - 1
        filters = _learnt(signals, range(inputs + 1), means, np.maximum(sizes, 1e-300), inputs)
        broken, _ = _broken((signals - means) / np.maximum(sizes, 1e-300), filters, inputs, forces=count)
        left[row] = np.flatnonzero(broken[0])
    kept = (replace(one, rows=tuple(row for row in one.rows if _near(left[row], one.sample))) for one in found)
    return [one for one in kept if one.rows]


def _near(places: Int[np.ndarray, "place"], sample: int) -> bool:
    return bool(np.any(np.abs(places - sample) <= NEAR + ORDER))


def _about_powers(run: Run, record: Recording, rows: Sequence[int]) -> Finding:
    """What is to be said of signals that only their squares and cubes explain."""
    return Finding.of(
        "warning",
        "static-nonlinearity",
        channels.describe(run, record),
        "signals depart at their peaks from what a linear system leads to, and follow with their squares and cubes: "
        "{count} response channels, first {first}. A sensor bends with its signal, or the structure is not symmetric. "
        "FRFs are those of one level.",
        float(len(rows)),
        0.0,
        advice="Check range, mounting and calibration of the sensor; measure at half the level and compare.",
        count=len(rows),
        first=record.channels[rows[0]].name,
    )


def breaks(record: Recording, every: int = 1) -> list[Break]:
    """Places at which the responses of a record break.

    Parameters
    ----------
    record : forces as references, and responses.
    every : of the response channels only each ``every``-th is looked at.
    """
    layout = channels.layout(record, record.name)
    rows = list(layout.responses[::every])
    samples = record.signals.shape[1]
    if samples < FEWEST:
        return []
    every_row = [*layout.references, *rows]
    means = np.array([[record.signals[row].mean(dtype=np.float64)] for row in every_row])
    sizes = np.array([[record.signals[row].std(dtype=np.float64)] for row in every_row])
    alive, inputs = sizes[:, 0] > 0, len(layout.references)
    if not alive[:inputs].any():
        return []
    filters = _learnt(record.signals, every_row, means, np.maximum(sizes, 1e-300), inputs)
    found: list[Break] = []
    margin = 2 * BESIDE + ORDER
    together = max(_AT_ONCE // len(every_row), 8 * margin)
    for start in range(0, samples, together):
        first, last = max(start - margin, 0), min(start + together + margin, samples)
        part = (record.signals[every_row, first:last] - means) / np.maximum(sizes, 1e-300)
        broken, size = _broken(part, filters, inputs, forces=inputs)
        broken &= alive[inputs:, None]
        inside = slice(start - first, min(start + together, samples) - first)
        found += _places(broken[:, inside], size[:, inside], rows, start)
    return _joined(found)


def _learnt(
    signals: np.ndarray | StoredSignals, rows: Sequence[int], means: np.ndarray, sizes: np.ndarray, inputs: int
) -> list[Float[np.ndarray, "signal tap"]]:
    """For each response the filters of the forces and of the response itself that leave the error of its prediction."""
    samples = signals.shape[1]
    stretches, length = LEARNT
    starts, length = ([0], samples) if samples <= stretches * length else (_spaced(samples), length)
    stretch = [slice(start, start + length) for start in starts]
    kept, of_forces = len(starts) * (length - ORDER), inputs * (ORDER + 1)
    basis = np.empty((of_forces + ORDER, kept))

    def scaled(row: int) -> list[Float[np.ndarray, "sample"]]:
        return [(signals[rows[row], part] - means[row]) / sizes[row] for part in stretch]

    for row in range(inputs):
        parts = scaled(row)
        for lag in range(ORDER + 1):
            basis[row * (ORDER + 1) + lag] = _lagged(parts, lag)
    filters = []
    for row in range(inputs, len(rows)):
        parts = scaled(row)
        for lag in range(1, ORDER + 1):
            basis[of_forces + lag - 1] = _lagged(parts, lag)
        wanted = _lagged(parts, 0)
        square, right = basis @ basis.T, basis @ wanted
        solved = _solved(square, right)
        error = np.abs(wanted - solved @ basis)
        # Once more without what stands out.
        out = error >= 6 * max(float(np.median(error)), 1e-300) / 0.6745
        beside = basis[:, out]
        taps = -_solved(square - beside @ beside.T, right - beside @ wanted[out])
        own = np.concatenate([[1.0], taps[of_forces:]])
        filters.append(np.vstack([taps[:of_forces].reshape(inputs, ORDER + 1), own]))
    return filters


def _spaced(samples: int) -> list[int]:
    """First samples of the stretches of a long record."""
    stretches, length = LEARNT
    return [round(start) for start in np.linspace(0, samples - length, stretches)]


def _solved(square: Float[np.ndarray, "tap tap"], right: Float[np.ndarray, "tap"]) -> Float[np.ndarray, "tap"]:
    """Least squares, with a little added to the information so that silent channels have a solution."""
    ridge = 1e-10 * np.trace(square) / len(square) * np.eye(len(square))
    return np.asarray(np.linalg.solve(square + ridge, right))


def _lagged(parts: Sequence[Float[np.ndarray, "sample"]], lag: int) -> Float[np.ndarray, "kept"]:
    """The sample so many before each one from ``ORDER`` on, of all stretches."""
    return np.concatenate([part[ORDER - lag : len(part) - lag] for part in parts])


def _broken(
    part: Float[np.ndarray, "signal sample"],
    filters: Sequence[Float[np.ndarray, "input tap"]],
    inputs: int,
    *,
    forces: int,
) -> tuple[Bool[np.ndarray, "out sample"], Float[np.ndarray, "out sample"]]:
    """Where the responses of a stretch break, and the errors of their predictions over their rms."""
    size = np.empty((len(filters), part.shape[1]))
    for row, taps in enumerate(filters):
        error = scipy.signal.lfilter(taps[-1], 1.0, part[inputs + row])
        for force, tap in zip(part[:inputs], taps[:-1], strict=True):
            error += scipy.signal.lfilter(tap, 1.0, force)
        size[row] = np.abs(error)
    broken = (size > LARGE) & (size > CLEAR * _beside(size))
    broken[:, : NEAR + ORDER], broken[:, -NEAR:] = False, False
    switched = np.zeros(part.shape[1], bool)
    for force in part[:forces]:
        before, after = _sides(force)
        switched |= np.minimum(before, after) < SILENT * np.maximum(before, after)
    if switched.any():
        still = np.all(np.abs(np.diff(part[inputs:], axis=1, append=part[inputs:, -1:])) == 0, axis=0)
        # responses that stand still behind a force that ends were not measured
        lost = scipy.ndimage.minimum_filter1d(still.astype(np.int8), ORDER, origin=-(ORDER // 2)) > 0
        lost = scipy.ndimage.maximum_filter1d(lost.astype(np.int8), 5) > 0
        broken &= lost | ~(scipy.ndimage.maximum_filter1d(switched.astype(np.int8), 2 * NEAR + 1) > 0)
    return broken, size


def _beside(size: Float[np.ndarray, "out sample"]) -> Float[np.ndarray, "out sample"]:
    """Rms of the errors from ``NEAR`` to ``BESIDE`` samples away, on the side where it is smaller.

    Another break near by does not hide one.
    """
    width = BESIDE - NEAR
    power = np.pad(size**2, ((0, 0), (BESIDE, BESIDE)), mode="reflect")
    mean = scipy.ndimage.uniform_filter1d(power, width, axis=1, origin=-(width // 2))
    count = size.shape[1]
    before, behind = mean[:, :count], mean[:, BESIDE + NEAR + 1 : BESIDE + NEAR + 1 + count]
    return np.asarray(np.sqrt(np.maximum(np.minimum(before, behind), 0.0)))


def _sides(force: Float[np.ndarray, "sample"]) -> tuple[Float[np.ndarray, "sample"], Float[np.ndarray, "sample"]]:
    """Rms of a force over the ``BESIDE`` samples before and behind each sample, about its median."""
    power = (force - np.median(force)) ** 2
    before, behind = (
        scipy.ndimage.uniform_filter1d(power, BESIDE, mode="nearest", origin=origin)
        for origin in (BESIDE // 2 - 1, -BESIDE // 2)
    )
    return np.sqrt(np.maximum(before, 0)), np.sqrt(np.maximum(behind, 0))


def _places(
    broken: Bool[np.ndarray, "out sample"], size: Float[np.ndarray, "out sample"], rows: list[int], start: int
) -> Iterator[Break]:
    """Samples at which at least one response breaks."""
    for sample in np.flatnonzero(broken.any(axis=0)).tolist():
        own = np.flatnonzero(broken[:, sample])
        yield Break(start + sample, tuple(rows[row] for row in own), float(size[own, sample].max()))


def _joined(found: Sequence[Break]) -> list[Break]:
    """Breaks without those that follow from the one before."""
    result: list[Break] = []
    last = -NEAR - 1
    for one in found:
        if one.sample - last <= NEAR:
            former = result[-1]
            rows = tuple(sorted({*former.rows, *one.rows}))
            result[-1] = Break(former.sample, rows, max(former.size, one.size))
        else:
            result.append(one)
        last = one.sample
    return result


def _finding(run: Run, record: Recording, found: Sequence[Break], records: int) -> Finding:
    """What is to be said of a record that breaks."""
    rows = sorted({row for one in found for row in one.rows})
    times = ", ".join(f"{one.sample / record.sampling_rate:.4g}" for one in found[:4])
    size = max(one.size for one in found)
    return Finding.of(
        "warning",
        "signals-break",
        channels.describe(run, record),
        "signals break at {times} s, in {broken} of {responses} response channels, first in {first}; records that "
        "break: {records}. What follows is {size} times the rms away from what the force and the vibration before lead "
        "to, as where samples were lost or repeated, or a channel jumps. FRFs contain it, and intervals may not.",
        size,
        LARGE,
        advice="Look at the signals there: check buffers and cables, and leave out the record or the channel.",
        times=times + (" ..." if len(found) > 4 else ""),
        broken=len(rows),
        responses=len(record.with_role("response")),
        first=record.channels[rows[0]].name,
        records=records,
        size=f"{size:.2g}",
    )
