"""FRFs that are larger than memory, as a few channels that hold what all outputs together show.

Every output is divided by the standard deviation of its noise, so that the noise of all of them is alike and
independent; then any orthonormal channels have noise of the same variance, again independent. The channels are the
main directions of the outputs (`ema.fit.range_finder`), real, so that the pairs of a pole and its conjugate stay pairs:
poles and participation are those of the full set. The noise that the channels keep is the mean over the outputs on each
line of each reference, or, where stated noise grows with the FRFs, that of the outputs that make each channel. What of
it the channels share is accounted for on the full set (`ema.fit.full_set`).
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from ema.data import FrfSet
from ema.data.window import Window
from ema.dof import Dof
from ema.errors import InputError
from ema.fit import noise
from ema.fit.range_finder import Range, growing
from ema.progress import Progress, advance, silent

_AT_ONCE = 48_000_000
"""Bytes of the values of a slab: half a dozen arrays of this size are in memory at a time, 0.3 GB. Memory alone, values
depend on it by rounding."""
_CHANNELS = 128
"""Directions that are looked for at first; two passes more for twice as many where all of these stand out of noise. It
costs passes where it is too small and memory where it is too large, and changes no result."""
_FEWEST = 24
"""Channels that are always kept, as in the search of modes (`ema.fit.estimator.FEWEST`, where it was varied)."""
_MARGIN = 1.1
"""Energy over the edge of that of noise from which on a direction is kept: the level of noise is known to a few per
cent. Below it, directions of noise would be kept, which cost work alone: their noise counts as large as they are. Above
it, a direction that is left out takes a tenth of the noise with it at most."""
_UNLIKE = 1.1
"""Noise of a channel at its own peaks over that of all outputs there, or the reverse, from which on each channel gets
its own: weights that differ by less than a factor of 1.1 raise a standard deviation by 0.1 % at most (Kantorovich's
inequality), at 1.2 by 0.4 %."""
_LINES_OF_BIN, _BINS = 25, 128
"""Lines over which stated variances are pooled, as in the weights (`ema.fit.noise.pooled`), and bins of them at most:
128 take 51 MB for 50 000 outputs and 2 references."""
SAMPLE = 60_000
"""Values of single outputs, evenly spread, from which the structure of the noise and its correlation are estimated: of
as many each level of the noise is known to a few per cent."""


@dataclass(frozen=True)
class Compressed:
    """A set of FRFs as a few channels.

    ``frfs`` has the channels as outputs and the shorter side of the set as inputs. ``directions`` (dof, channel) are
    orthonormal; an output is ``scale * directions`` times the channels, where ``scale`` (dof,) is the standard
    deviation of its noise and 0 where it is dead. ``stated`` says that the noise came with the FRFs; ``sample`` are
    some outputs as they are, ``rows`` their places. ``error`` is the energy that the channels leave out over that of
    the noise there: 1 where they leave out nothing else.
    """

    frfs: FrfSet
    directions: Float[np.ndarray, "dof channel"]
    scale: Float[np.ndarray, "dof"]
    stated: bool
    sample: FrfSet
    rows: Int[np.ndarray, "sample"]
    error: float

    @property
    def alive(self) -> Bool[np.ndarray, "dof"]:
        """DOFs whose FRFs are not all zero."""
        return np.asarray(self.scale > 0)


def turned(frfs: FrfSet) -> bool:
    """Whether the references are the outputs of the test: forces rove over more places than there are responses."""
    return len(frfs.outputs) < len(frfs.inputs)


def slabs(frfs: FrfSet, progress: Progress = silent, task: str = "") -> Iterator[tuple[slice, FrfSet]]:
    """The set in memory, some places of its longer side at a time, these as outputs; whole chunks of the file."""
    count, chunk = max(len(frfs.outputs), len(frfs.inputs)), 1
    values = frfs.values
    if isinstance(cast(object, values), Window):
        chunk = cast(Window, values).source.chunks[2 if turned(frfs) else 1]
    size = 16 * len(frfs.frequencies) * min(len(frfs.outputs), len(frfs.inputs))
    step = max(1, _AT_ONCE // (size * chunk)) * chunk
    for first in range(0, count, step):
        advance(progress, task, first, count)
        rows = slice(first, min(first + step, count))
        yield rows, _slab(frfs, rows)


def _slab(frfs: FrfSet, rows: slice) -> FrfSet:
    """Some places of the longer side in memory, as outputs."""
    swapped = turned(frfs)

    def cut(array: Any) -> Any:
        if array is None:
            return None
        part = np.asarray(array[:, :, rows] if swapped else array[:, rows])
        return part.transpose(0, 2, 1) if swapped else part

    averages = frfs.averages
    if averages is not None:
        averages = averages.T[rows] if swapped else averages[rows]
    return replace(
        frfs,
        values=cut(frfs.values),
        variance=cut(frfs.variance),
        coherence=cut(frfs.coherence),
        averages=averages,
        outputs=(frfs.inputs if swapped else frfs.outputs)[rows],
        inputs=frfs.outputs if swapped else frfs.inputs,
    )


def compressed(frfs: FrfSet, progress: Progress = silent) -> Compressed:
    """The channels of a set whose values stay in a file, from two passes over it; those of the last band are kept.

    Raises
    ------
    InputError : NaN or infinite values, nothing but zeros.
    """
    window = cast(Window, frfs.values)
    key = tuple((len(axis), int(axis[0]), int(axis[-1]), hash(axis.tobytes())) for axis in window.axes if len(axis))
    known = window.memory.get("compressed")
    if known is None or known[0] != key:
        known = window.memory["compressed"] = key, _compressed(frfs, progress)
    found: Compressed = known[1]
    return found


class _FirstPass:
    """What is collected on the way through the set beside its directions."""

    def __init__(self, frfs: FrfSet, count: int) -> None:
        lines, references = len(frfs.frequencies), min(len(frfs.outputs), len(frfs.inputs))
        self.where, self.swapped = frfs.name or "FRFs", turned(frfs)
        self.scale, self.stated, self.alive = np.zeros(count), True, 0
        self.variance = np.zeros((lines, references))
        self.bins = np.unique(
            np.linspace(0, lines, int(np.clip(lines // _LINES_OF_BIN, 1, _BINS)), endpoint=False, dtype=int)
        )
        self.means = np.zeros((count, references, len(self.bins)), np.float32)
        self.columns: Float[np.ndarray, "freq in"] | None = None
        self.rows = np.arange(0, count, max(1, count * lines * references // SAMPLE))
        self.sample: list[FrfSet] = []

    @property
    def per_direction(self) -> float:
        """Energy of noise in a direction of the whitened outputs."""
        assert self.columns is not None
        return float(np.sum(self.variance / self.alive * self.columns**2))

    def take(self, place: slice, slab: FrfSet) -> None:
        """Check a slab and note its noise."""
        values = np.asarray(slab.values)
        if not np.isfinite(np.vdot(values, values).real):
            bad = ~np.isfinite(values)
            output, input_ = np.argwhere(bad.any(axis=0))[0]
            pair = slab.outputs[output], slab.inputs[input_]
            raise InputError(
                "an FRF holds NaN or infinite values",
                where=f"{self.where}, {'/'.join(map(str, pair[::-1] if self.swapped else pair))}",
                got=f"{int(bad.sum())} such values among those read at once",
                advice="write the set again without the point that caused them, or fit a band without them",
            )
        alive = np.any(values != 0, axis=(0, 2))
        known = noise.measured(slab)
        self.stated &= known is not None
        if alive.any():
            values = values[:, alive]
            level = noise.from_differences(values) if known is None else noise.from_variance(known[:, alive])
            rows = np.flatnonzero(alive) + place.start
            self.scale[rows] = level.outputs
            if known is not None:
                widths = np.diff(self.bins, append=len(values))
                self.means[rows] = (np.add.reduceat(known[:, alive], self.bins, axis=0).T / widths).transpose(1, 0, 2)
            own = (np.clip(level.lines, 0.2, 5)[:, None] * level.references) ** 2
            variance = 2 * own[:, None] if known is None else known[:, alive] / level.outputs[:, None] ** 2
            self.variance += np.sum(np.broadcast_to(variance, values.shape), axis=1)
            self.alive += int(np.count_nonzero(alive))
            if self.columns is None:
                self.columns = 1 / np.sqrt(own)
        some = self.rows[(self.rows >= place.start) & (self.rows < place.stop)] - place.start
        self.sample.append(slab.pick(outputs=some.tolist()))

    def samples(self) -> tuple[FrfSet, Int[np.ndarray, "sample"]]:
        """Some outputs that are not dead, and their places."""

        def joined(name: str) -> np.ndarray | None:
            parts = [getattr(one, name) for one in self.sample]
            axis = 0 if name == "averages" else 1
            return None if parts[0] is None else np.concatenate(parts, axis=axis)

        arrays = {name: joined(name) for name in ("values", "variance", "coherence", "averages")}
        outputs = tuple(dof for one in self.sample for dof in one.outputs)
        whole = replace(self.sample[0], outputs=outputs, **arrays)  # type: ignore[arg-type]
        alive = np.flatnonzero(self.scale[self.rows] > 0)
        return whole.pick(outputs=alive.tolist()), self.rows[alive]


def _compressed(frfs: FrfSet, progress: Progress) -> Compressed:
    """`compressed`, from the file."""
    count = max(len(frfs.outputs), len(frfs.inputs))
    first = _FirstPass(frfs, count)
    passes = 0

    def whitened() -> Iterator[np.ndarray]:
        nonlocal passes
        passes += 1
        for place, slab in slabs(frfs, progress, f"compression, pass {passes}"):
            if passes == 1:
                first.take(place, slab)
            scale = first.scale[place]
            per_output = np.where(scale > 0, 1 / np.where(scale > 0, scale, 1), 0)
            columns = np.ones(1) if first.columns is None else first.columns
            part = np.asarray(slab.values).transpose(1, 0, 2) * (per_output[:, None, None] * columns)
            yield part.reshape(len(part), -1).view(float)

    found, above = growing(whitened, count, _CHANNELS, lambda some: some.above(_MARGIN))
    if first.columns is None:
        raise InputError("all FRFs are zero", where=first.where, advice="check the response channels and the scaling")
    least = max(_FEWEST, min(len(frfs.outputs), len(frfs.inputs)))
    found = found.leading(int(np.clip(above + 2, least, len(found.energies))))
    sample, rows = first.samples()
    channels = _channels(frfs, found, first)
    if first.stated and _unlike(channels, found, first, sample, rows):
        channels = replace(channels, variance=_own_variance(channels, found, first, sample, rows))
    if channels.variance is not None:
        # Directions of noise alone are those in which it happens to be largest: it is as large as they are.
        chosen = np.maximum(found.energies / first.per_direction, 1)
        chosen[:above] = 1
        channels = replace(channels, variance=channels.variance * chosen[:, None])
    return Compressed(
        frfs=channels,
        directions=np.ascontiguousarray(found.directions),
        scale=first.scale,
        stated=first.stated,
        sample=sample,
        rows=rows,
        error=_error(found, first),
    )


def _channels(frfs: FrfSet, found: Range, first: _FirstPass) -> FrfSet:
    """The compressed set: values over the noise of their outputs, with the variance of their noise."""
    assert first.columns is not None
    channels = len(found.compressed)
    values: Complex[np.ndarray, "channel freq in"] = np.ascontiguousarray(found.compressed).view(complex)
    values = values.reshape(channels, *first.columns.shape) / first.columns
    variance = np.repeat(first.variance[:, None] / first.alive, channels, axis=1) if first.stated else None
    inputs = frfs.outputs if turned(frfs) else frfs.inputs
    return replace(
        frfs,
        values=np.ascontiguousarray(values.transpose(1, 0, 2)),
        outputs=tuple(Dof(number + 1, "S") for number in range(channels)),
        inputs=inputs,
        variance=variance,
        coherence=None,
        averages=None,
    )


def _unlike(channels: FrfSet, found: Range, first: _FirstPass, sample: FrfSet, rows: Int[np.ndarray, "sample"]) -> bool:
    """Whether the noise of the outputs that make a channel differs at its peaks from that of all, by a sample."""
    known, shares = noise.measured(sample), found.directions[rows] ** 2
    total = np.sum(shares, axis=0)
    # A sample that shows nothing of a channel says nothing of its noise.
    if known is None or channels.variance is None or not np.all(total > 0):
        return True
    own = np.einsum("oc,foi->fci", shares / total, known / first.scale[rows, None] ** 2)
    energy = np.abs(channels.values) ** 2
    ratio = np.sum(energy * own, axis=(0, 2)) / np.sum(energy * channels.variance, axis=(0, 2))
    return bool(np.any(np.maximum(ratio, 1 / ratio) > _UNLIKE))


def _own_variance(
    channels: FrfSet, found: Range, first: _FirstPass, sample: FrfSet, rows: Int[np.ndarray, "sample"]
) -> Float[np.ndarray, "freq channel in"]:
    """Variance of each channel from that of its outputs, which are independent: ``sum_o d_oc^2 v_o / scale_o^2`` with
    the direction ``d`` of the channel.

    The variance ``v_o`` of an output is its mean over some lines, noted on the first pass, times what the structure of
    the sample (`ema.fit.noise.structure`) makes of its FRFs there, which the channels hold: the file is not read again.
    """
    known = noise.measured(sample)
    assert known is not None
    values = np.asarray(channels.values).transpose(1, 2, 0)

    def size(some: Int[np.ndarray, "some"]) -> Float[np.ndarray, "some in freq"]:
        """Squared FRFs over their noise."""
        fitted = np.tensordot(found.directions[some], values, 1)
        return np.asarray(fitted.real**2 + fitted.imag**2)

    shape = noise.structure(known.transpose(1, 2, 0), size(rows))
    total = np.zeros((found.directions.shape[1], *values.shape[1:]))
    alive = np.flatnonzero(first.scale > 0)
    step, widths = max(1, _AT_ONCE // (8 * values[0].size)), np.diff(first.bins, append=values.shape[-1])
    for some in (alive[begin : begin + step] for begin in range(0, len(alive), step)):
        relative = shape.relative(size(some))
        mean = first.means[some] * widths / np.add.reduceat(relative, first.bins, axis=-1)
        white = relative * np.repeat(mean, widths, axis=-1) / first.scale[some, None, None] ** 2
        total += np.tensordot(found.directions[some].T ** 2, white, 1)
    return np.ascontiguousarray(total.transpose(2, 0, 1))


def _error(found: Range, first: _FirstPass) -> float:
    """Energy that was left out over that of noise there."""
    others = first.alive - len(found.energies)
    return found.left_out / (first.per_direction * others) if others > 0 else 1.0
