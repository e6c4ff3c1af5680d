"""Which channel of a record is the force, which are responses: by units, by names, by the shape of the signals."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy import signal as signals

from ema.data import Channel, Recording
from ema.data.condition import ExcitationKind
from ema.data.recording import Role
from ema.dof import SCALAR, Dof
from ema.errors import EmaError
from ema.estimate.channel_swap import PUSHES, RINGS, one_sided
from ema.proposal.file_names import NODE_WORDS, plain_direction
from ema.units import Quantity

_FORCE = re.compile(r"(force|hammer|shaker|load ?cell|impact|kraft|(^|[^a-z])(f|fz|fx|fy|ref)([^a-z]|$))", re.I)
_NORMAL = re.compile(r"(normal|clamp|preload|pre-load|bolt|ring|vorspann|(^|[^a-z])f_?n([^a-z]|$))", re.I)
_TRIGGER = re.compile(r"(trig|tacho|sync|gate)", re.I)
_GENERATOR = re.compile(
    r"(generator|signal ?source|source ?signal|drive ?(signal|volt)|(^|[^a-z])(source|dac|gen)([^a-z]|$))", re.I
)
_OTHER = re.compile(r"(temp|counter|^time$|humid|supply|speed|rpm)", re.I)
_QUANTITIES: tuple[tuple[str, Quantity], ...] = (
    (r"(acc|beschl)", "acceleration"),
    (r"(vel|laser|ldv|geschw)", "velocity"),
    (r"(disp|weg|position)", "displacement"),
    (r"(mic|press|sound)", "pressure"),
    (r"strain|dms", "strain"),
)

STEADY = 3.0
"""Mean over standard deviation from which a force is one that presses a joint: a hammer's is below 0.1, a shaker's
about 0, that of a joint 10 and more. Halved or doubled, no channel of those three kinds is judged otherwise."""

WHITE = 0.5
"""Spectral flatness (geometric over arithmetic mean of the smoothed power) above which a signal is white noise: of
white noise it is 0.9 and more after smoothing, of a response with resonances far below 0.3."""

DECAYS = 0.05
"""Rms of the last tenth over that of the first tenth behind the largest value, below which a record is free vibration
that has died away."""


@dataclass(frozen=True)
class Judged:
    """What a channel seems to be, and why."""

    name: str
    role: Role
    quantity: Quantity
    unit: str
    dof: Dof | None
    evidence: str
    named: bool
    """Whether its unit or name says its role; otherwise its shape does, or nothing."""
    dof_in_name: bool = False
    """Whether the DOF is from its name; otherwise it is that of the file."""


@dataclass(frozen=True)
class JudgedRecord:
    """The channels of one record, how the structure was driven, and what looks wrong."""

    channels: tuple[Judged, ...]
    kind: ExcitationKind
    kind_evidence: str
    band: tuple[float, float] | None
    warnings: tuple[str, ...]
    frf: Float[np.ndarray, "line"] | None
    """Magnitude in dB of first response over first force on a coarse grid; it tells takes of one point from points."""

    @property
    def references(self) -> tuple[int, ...]:
        """Indices of the forces."""
        return tuple(index for index, one in enumerate(self.channels) if one.role == "reference")


def judge(record: Recording) -> JudgedRecord:
    """Return what the channels of a record seem to be.

    A unit or a name of a channel decides before its shape does: forces are ``reference``, or ``normal force`` where
    they press steadily. Where neither speaks, the channel that is a pulse (or, of many, the white ones) is the force.

    Parameters
    ----------
    record : Recording
        As the file has it.

    Returns
    -------
    JudgedRecord
    """
    rows = np.asarray(record.signals, dtype=np.float64)
    judged = [_by_name(channel, row) for channel, row in zip(record.channels, rows, strict=True)]
    warnings: list[str] = []
    pulses = np.array([one_sided(row) for row in rows])
    forces = [index for index, one in enumerate(judged) if one.role == "reference"]
    open_ = [index for index, one in enumerate(judged) if one.role == "response" and not one.named]
    if not forces and open_:
        for index, why in _forces_by_shape(rows, pulses, open_):
            judged[index] = _as_force(judged[index], why)
        forces = [index for index, one in enumerate(judged) if one.role == "reference"]
    elif len(forces) == 1 and pulses[forces[0]] < RINGS:
        rival = max((k for k, one in enumerate(judged) if one.role == "response"), key=pulses.__getitem__, default=None)
        if rival is not None and pulses[rival] > PUSHES:
            warnings.append(
                f"{judged[forces[0]].name} is called the force and rings like a response, {judged[rival].name} is a "
                "pulse: force and response may be swapped"
            )
    generators = [index for index, one in enumerate(judged) if one.role == "generator"]
    if len(generators) != len(forces):
        # FRFs are referred to one for each force, or to none
        for index in generators:
            judged[index] = replace(judged[index], role="other")
    kind, evidence, band = _excitation(record, rows, forces, judged)
    names = [one.name for one in judged]
    for name in sorted({name for name in names if names.count(name) > 1}):
        warnings.append(f"{names.count(name)} channels are called {name}")
    return JudgedRecord(tuple(judged), kind, evidence, band, tuple(warnings), _ratio(rows, forces, judged))


def same_point(frfs: Sequence[Float[np.ndarray, "line"] | None]) -> bool | None:
    """Whether FRFs on a coarse grid are those of one point: repeated takes; ``None`` where there are none to compare.

    It is a hint, no proof: neighbouring points of a stiff structure differ as little as takes do.
    """
    there = [one for one in frfs if one is not None]
    if len(there) < 2 or len(there) < len(frfs):
        return None
    spread = np.quantile(np.ptp(np.array(there), axis=0) / 2, 0.9)
    return bool(spread < ONE_POINT)


ONE_POINT = 4.5
"""Half the range in dB of FRFs of several files, exceeded in a tenth of the bands, below which they look like takes of
one point. Five impacts at one point had 0.3 to 1.5, five sweeps at levels up to twofold 3.1, four and five points of a
beam and a plate 6.4 and more, two neighbours on a plate 2.5. Halved, the sweeps would look like points; doubled, the
points like takes. What is made of it is asked for."""


def _by_name(channel: Channel, row: Float[np.ndarray, "sample"]) -> Judged:
    """Role and quantity from unit and name."""
    name = channel.name
    quantity: Quantity = channel.quantity
    role: Role = channel.role if channel.role != "response" else "response"
    evidence, named = "", False
    if quantity in ("unstated", "voltage"):
        quantity = next((kind for words, kind in _QUANTITIES if re.search(words, name, re.I)), quantity)
        named = quantity != channel.quantity
    else:
        named, evidence = True, f"its unit, {channel.unit}"
    # readers of formats without roles take every force for a reference; one that presses steadily excites nothing
    presses = channel.role == "reference" and quantity == "force" and (_NORMAL.search(name) or _presses(row))
    if channel.role != "response" and not presses:
        role, evidence, named = channel.role, "the file says so", True
    elif _TRIGGER.search(name):
        role, named, evidence = "trigger", True, "its name"
    elif _OTHER.search(name) or quantity in ("temperature", "time"):
        role, named, evidence = "other", True, "its name"
    elif quantity in ("unstated", "voltage") and _GENERATOR.search(name) and not _FORCE.search(name):
        role, named, evidence = "generator", True, "its name"
    elif quantity == "force" or (quantity in ("unstated", "voltage") and _FORCE.search(name)):
        role, quantity, named = "reference", "force", True
        evidence = evidence or "its name"
        if _NORMAL.search(name) or _presses(row):
            role = "normal force"
            evidence = "its name" if _NORMAL.search(name) else "its mean is far above what varies"
    elif quantity in ("unstated", "voltage") and _NORMAL.search(name) and _presses(row):
        role, quantity, named, evidence = "normal force", "force", True, "its name and its mean"
    elif named:
        evidence = evidence or "its name"
    dof = _dof(channel)
    return Judged(name, role, quantity, channel.unit, dof, evidence, named, dof_in_name=channel.dof is None)


def _presses(row: Float[np.ndarray, "sample"]) -> bool:
    return bool(abs(np.mean(row)) > STEADY * np.std(row) > 0)


_DIRECTED = re.compile(r"(?<![\d.])(\d+)\s*[:_ ]?\s*([+-]?R?[XYZ]|R?[XYZ][+-])(?![A-Za-z])", re.I)
_DIRECTION = re.compile(r"(?<![A-Za-z0-9])([+-]?R?[XYZ]|R?[XYZ][+-])(?![A-Za-z0-9])", re.I)
_POINT = re.compile(rf"(?<![A-Za-z])(?:{'|'.join(NODE_WORDS)})[ _.:#-]{{0,2}}(\d+)(?![\d.]*\d)(?![A-Za-z])", re.I)


def _dof(channel: Channel) -> Dof | None:
    """The DOF of the file, or one that the name states: ``acc 12:+Z``, ``P12Z+``, ``Punkt 12``, ``X point 12``."""
    if channel.dof is not None:
        return channel.dof
    directed, point = _DIRECTED.search(channel.name), _POINT.search(channel.name)
    if directed is not None:
        node, direction = directed[1], directed[2]
    elif point is not None:
        beside = _DIRECTION.findall(channel.name)
        node, direction = point[1], beside[0] if len(beside) == 1 else ""
    else:
        return None
    try:
        return Dof(int(node), plain_direction(direction) or SCALAR)
    except EmaError:
        return None


def _as_force(one: Judged, why: str) -> Judged:
    return replace(one, role="reference", quantity="force", evidence=why, named=False)


def _forces_by_shape(
    rows: Float[np.ndarray, "channel sample"], pulses: Float[np.ndarray, "channel"], open_: list[int]
) -> list[tuple[int, str]]:
    """Which of the open channels are forces, with the reason."""
    best = max(open_, key=pulses.__getitem__)
    others = [pulses[index] for index in open_ if index != best]
    if others and pulses[best] > PUSHES and max(others) < RINGS:
        return [(best, "it is a pulse, the others ring")]
    flat = {index: _flatness(rows[index]) for index in open_}
    white = [index for index in open_ if flat[index] > WHITE]
    if white and len(white) < len(open_):
        return [(index, "white noise, the others have resonances") for index in white]
    return []


def _flatness(row: Float[np.ndarray, "sample"]) -> float:
    """Geometric over arithmetic mean of the power spectrum, its ends left out."""
    _, power = signals.welch(row - row.mean(), nperseg=min(256, len(row)))
    power = power[2 : int(0.9 * len(power))]
    if not len(power) or power.min() <= 0:
        return 0.0
    return float(np.exp(np.mean(np.log(power))) / np.mean(power))


def _excitation(
    record: Recording, rows: Float[np.ndarray, "channel sample"], forces: list[int], judged: Sequence[Judged]
) -> tuple[ExcitationKind, str, tuple[float, float] | None]:
    """How the structure was driven, by the shape of the force."""
    if not forces:
        vibrations = [k for k, one in enumerate(judged) if one.quantity in ("acceleration", "velocity", "displacement")]
        if vibrations and all(_decays(rows[k]) for k in vibrations):
            return "snap-back", "no force, and the responses die away", None
        return "unknown", "no channel looks like a force", None
    force = rows[forces[0]]
    if one_sided(force) > PUSHES:
        return "hammer", "the force is a pulse", None
    sweep = _swept(force, record.sampling_rate)
    if sweep is not None:
        return "sweep", f"the frequency of the force runs from about {sweep[0]:.0f} to {sweep[1]:.0f} Hz", sweep
    if _flatness(force) > WHITE / 5:
        return "random", "the force is noise", None
    return "unknown", "the force is neither a pulse nor a sweep nor broadband noise", None


def _decays(row: Float[np.ndarray, "sample"]) -> bool:
    row = row - np.median(row)
    behind = row[int(np.argmax(np.abs(row))) :]
    tenth = len(behind) // 10
    if tenth < 16:
        return False
    return bool(np.std(behind[-tenth:]) < DECAYS * np.std(behind[:tenth]))


_PARTS = 24
"""Parts of a force in which the frequency of a sweep is looked for."""
_MONOTONE = 0.9
"""Rank correlation of frequency with time above which a signal is a sweep; of noise it is below 0.5 with 24 parts."""


def _swept(force: Float[np.ndarray, "sample"], rate: float) -> tuple[float, float] | None:
    """Lowest and highest frequency of a sweep in Hz, ``None`` where the force is none."""
    from scipy.stats import spearmanr

    part = len(force) // _PARTS
    if part < 32:
        return None
    pieces = force[: part * _PARTS].reshape(_PARTS, part)
    loud = np.std(pieces, axis=1) > 0.2 * np.max(np.std(pieces, axis=1))
    spectra = np.abs(np.fft.rfft(pieces * np.hanning(part), axis=1))
    peaks = rate / part * np.argmax(spectra[:, 1:], axis=1) + rate / part
    narrow = np.max(spectra, axis=1) ** 2 > 0.1 * np.sum(spectra**2, axis=1)
    used = loud & narrow
    if np.count_nonzero(used) < _PARTS // 2 or np.count_nonzero(used) < 0.8 * np.count_nonzero(loud):
        return None
    order = abs(float(spearmanr(np.flatnonzero(used), peaks[used]).statistic))
    low, high = float(peaks[used].min()), float(peaks[used].max())
    return (low, high) if order > _MONOTONE and high > 1.2 * low else None


def _ratio(
    rows: Float[np.ndarray, "channel sample"], forces: list[int], judged: Sequence[Judged]
) -> Float[np.ndarray, "line"] | None:
    """Response over force in dB, averaged in 48 bands where the force has power."""
    responses = [index for index, one in enumerate(judged) if one.role == "response"]
    if not forces or not responses:
        return None
    count = min(rows.shape[1], 1 << 16)
    force = np.abs(np.fft.rfft(rows[forces[0]][:count] - rows[forces[0]].mean())) ** 2
    response = np.abs(np.fft.rfft(rows[responses[0]][:count] - rows[responses[0]].mean())) ** 2
    edges = np.unique(np.geomspace(8, len(force) // 4, 49).astype(int))
    power = np.add.reduceat(force, edges[:-1])
    answer = np.add.reduceat(response, edges[:-1])
    floor = 1e-30 + 1e-12 * float(power.max())
    return np.asarray(10 * np.log10(np.maximum(answer, floor) / np.maximum(power, floor)))
