"""A hysteresis loop from a record of relative displacement and force."""

import numpy as np
from jaxtyping import Float

from ema.data import Channel, Loop, Recording
from ema.errors import InputError

_FEWEST = 2
"""Whole cycles below which there is no loop: a period is the distance of two of them."""


def measured_loop(record: Recording, displacement: str = "", force: str = "") -> Loop:
    """Compute the hysteresis loop of a joint in periodic motion, and the energy that it dissipates per cycle.

    The loop holds the whole cycles of the record, both signals about their mean; their enclosed area over their number
    is the energy per cycle. The normal force is the mean of the record's normal-force channel, where there is one.

    Parameters
    ----------
    record : Recording
        Relative displacement and tangential force of the joint.
    displacement, force : str, optional
        Names of the channels; by default the first displacement, and the first force that is neither the excitation nor
        a normal force.

    Returns
    -------
    Loop
        The loop.

    Raises
    ------
    InputError
        If there is no such channel, a channel has no unit or holds NaN, or there are less than two cycles of a motion.

    Examples
    --------
    >>> from ema.data import Channel
    >>> angle = 2 * np.pi * 10.0 * np.arange(1024) / 1024.0
    >>> channels = (Channel("x", quantity="displacement", unit="m"), Channel("f", quantity="force", unit="N"))
    >>> record = Recording(np.array([1e-6 * np.cos(angle), 5.0 * np.cos(angle + np.pi / 6)]), 1024.0, channels)
    >>> round(1e6 * measured_loop(record).area, 2)  # pi * 1e-6 m * 5 N * sin(30 deg)
    7.85
    """
    where = record.name or "record"
    x, f = (_channel(record, *choice) for choice in ((displacement, "displacement"), (force, "force")))
    period = _period(x, where)
    cycles = int((len(x) - 1) / period)
    if cycles < _FEWEST:
        raise InputError(
            "the record is too short for a loop",
            where=where,
            got=f"{len(x) / period:.2g} cycles",
            expected=f"at least {_FEWEST}",
        )
    whole = slice(0, round(cycles * period))
    x, f = x[whole] - x[whole].mean(), f[whole] - f[whole].mean()
    # the closed polygon of all samples, by the shoelace formula
    area = 0.5 * abs(float(np.sum(x * np.roll(f, -1) - np.roll(x, -1) * f))) / cycles
    pressed = [row for row, one in enumerate(record.channels) if one.role == "normal force"]
    normal = float(np.mean(record.signals[pressed[0]])) if len(pressed) == 1 else float("nan")
    times = np.arange(len(x)) / record.sampling_rate
    return Loop(x, f, area, 0.5 * float(np.ptp(x)), cycles, normal, times, name=where)


def _channel(record: Recording, name: str, quantity: str) -> Float[np.ndarray, "sample"]:
    def fits(one: Channel) -> bool:
        if name:
            return one.name == name
        return one.quantity == quantity and one.role not in ("reference", "normal force")

    where = record.name or "record"
    row = next((row for row, one in enumerate(record.channels) if fits(one)), None)
    if row is None:
        raise InputError(
            f"the record has no such {quantity}",
            where=where,
            got=name or f"no channel of {quantity}",
            expected="one of " + ", ".join(one.name for one in record.channels),
        )
    if record.channels[row].quantity != quantity:
        raise InputError(
            f"this channel is no {quantity}",
            where=f"{where}, {record.channels[row].name}",
            got=record.channels[row].quantity,
            advice="state its unit in the channel table",
        )
    values = np.asarray(record.signals[row], dtype=np.float64)
    if not np.all(np.isfinite(values)):
        raise InputError(
            "the signal holds NaN or infinity",
            where=f"{where}, {record.channels[row].name}",
            advice="cut the record or repair the channel",
        )
    return values


def _period(x: Float[np.ndarray, "sample"], where: str) -> float:
    """Samples per cycle: the highest line of the spectrum, refined by a parabola through its logarithm."""
    power = np.abs(np.fft.rfft((x - x.mean()) * np.hanning(len(x)), 4 * len(x)))
    top = int(np.argmax(power[1:-1])) + 1
    if not power[top] > 0:
        raise InputError(
            "the joint does not move",
            where=where,
            got="a constant displacement",
            expected="a periodic one",
            advice="check the displacement channel",
        )
    a, b, c = np.log(np.maximum(power[top - 1 : top + 2], 1e-300))
    return float(4 * len(x) / (top + 0.5 * (a - c) / (a - 2 * b + c)))
