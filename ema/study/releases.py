"""What the records of a release say of a statement: deflection, phases, and what a computation lacks."""

import numpy as np
from jaxtyping import Float

from ema.compare.map_features import Measure, estimate, missing
from ema.data import Campaign, Recording
from ema.errors import InputError
from ema.study.recipe import StatementTable

_GUARD = 0.05
"""Part of the time before the release that is not read, so that the anti-alias filter does not reach into it."""


def measured(table: StatementTable, campaign: Campaign) -> Measure:
    """The quantity of a statement about releases: mm, Hz, and damping and differences in percent.

    Raises
    ------
    InputError : no such run, or a run without one record of the motion.
    """
    record = _record(campaign, table.run)
    if table.quantity == "release deflection":
        value, std = _deflection(record, table)
        return estimate(1e3 * value, 1e3 * std)
    if table.quantity == "release deflection over run":
        (a, da), (b, db) = (_deflection(one, table) for one in (record, _record(campaign, table.other)))
        return estimate(a / b, abs(a / b) * float(np.hypot(da / a, db / b)))
    if table.quantity in ("missing damping", "difference of envelopes", "difference of frequencies"):
        return _compared(table, record, _record(campaign, table.other))
    kind, _, what = (table.quantity or "").partition(" ")
    return _of_phase(table, record, kind, what)


def _record(campaign: Campaign, name: str) -> Recording:
    run = campaign[name]
    if len(run.recordings) != 1 or len(run.recordings[0].with_role("response")) != 1:
        raise InputError(
            "a statement about a release needs one record of one motion",
            where=f"run {name}",
            got=f"{len(run.recordings)} records",
            expected="one, with one response",
        )
    return run.recordings[0]


def _motion(record: Recording) -> Float[np.ndarray, "sample"]:
    return np.asarray(record.signals[record.with_role("response")[0]], dtype=np.float64)


def _rest(record: Recording, table: StatementTable) -> int:
    """Samples of the rest before the release."""
    return int((1 - _GUARD) * (table.start or 0.0) * record.sampling_rate)


def _deflection(record: Recording, table: StatementTable) -> tuple[float, float]:
    """Displacement in m before the release, with the standard deviation of its mean."""
    quantity = record.channels[record.with_role("response")[0]].quantity
    rest = _motion(record)[: _rest(record, table)]
    if quantity != "displacement" or len(rest) < 2:
        raise InputError(
            "the deflection before the release was not recorded",
            where=f"run {table.run}",
            got=f"{quantity}, {len(rest)} samples at rest",
            expected="displacement, and start in s of the release",
        )
    return float(rest.mean()), float(rest.std(ddof=1) / np.sqrt(len(rest)))


def _of_phase(table: StatementTable, record: Recording, kind: str, what: str) -> Measure:
    """Frequency or damping of a phase: the median, between those of its halves."""
    from ema.estimate import phases, ring_down

    assert table.band is not None
    decay = ring_down(record, table.band, start=table.start)
    chosen = next((phase for phase in phases(decay) if phase.kind == kind), None)
    if chosen is None:
        return missing(f"a {kind} phase of two cycles or more")
    times = np.asarray(decay.times)
    values = np.asarray(decay.frequencies) if what == "frequency" else 100 * np.asarray(decay.damping_ratios)
    middle = 0.5 * (chosen.start + chosen.stop)
    spans = ((chosen.start, chosen.stop), (chosen.start, middle), (middle, chosen.stop))
    parts = [float(np.median(values[(times >= a) & (times <= b)])) for a, b in spans]
    return Measure(parts[0], min(parts), max(parts))


def _compared(table: StatementTable, record: Recording, computed: Recording) -> Measure:
    """A measured against a computed velocity from the release on."""
    from ema.compare import releases
    from ema.estimate import to_quantity

    assert table.band is not None and table.start is not None
    comparison = releases(record, computed, table.band, table.start)
    if table.quantity == "missing damping":
        return estimate(100 * comparison.missing_damping, 100 * comparison.missing_std)
    if table.quantity == "difference of frequencies":
        over, under = comparison.peak_frequencies
        off = 100 * (under / over - 1)
        # of spectra with lines at a quarter of the inverse length: a peak lies within half a step of its highest line
        step = 100 * 0.5 * 0.25 / (record.duration - table.start) / over
        return Measure(off, off - step, off + step)
    rest = max(_rest(record, table), 2)
    velocity = _motion(to_quantity(record, "velocity", table.band[0] / 15, rest))
    noise = velocity[:rest].std() / velocity[rest:].std()
    return estimate(100 * comparison.envelope_error, 100 * float(noise))
