"""Write containers as a universal file: 151 and 164, then 2411, 82, 55 and 58 or 58b."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from acquisition.contents import Contents
from acquisition.files.uff import geometry_sets, header58, values58
from acquisition.files.uff.header58 import Axis, Header, Point
from acquisition.files.uff.mode_sets import write_modes
from ema.data import FrfSet, Geometry, ModalModel, Recording
from ema.dof import Dof
from ema.errors import InputError
from ema.store.atomic import replacing
from ema.units import SI_UNIT, UNSTATED

_CODES = {
    "displacement": 8,
    "velocity": 11,
    "acceleration": 12,
    "force": 13,
    "strain": 3,
    "pressure": 15,
    "temperature": 5,
    "torque": 13,
    "rotation": 8,
    "angular velocity": 11,
    "angular acceleration": 12,
}
_RESPONSE = {
    "receptance": ("displacement", "rotation"),
    "mobility": ("velocity", "angular velocity"),
    "accelerance": ("acceleration", "angular acceleration"),
    "unstated": ("unstated", "unstated"),
}
"""Response of each kind of FRF, in translation and rotation."""


def write(path: Path, nouns: Sequence[Any], binary: bool = False, created: datetime | None = None) -> None:
    """Write FRF sets, recordings, geometries and modal models.

    Parameters
    ----------
    path : the file; an older one is replaced when the new one is complete.
    nouns : containers, nested in lists or not, in the order in which they are written.
    binary : functions as data set 58b; text is understood by more systems, and keeps 13 digits.
    created : date of the header; by default now.

    Raises
    ------
    InputError : a container of another kind, or values that are NaN or infinite.
    FailureError : the folder is read-only or the disk is full; an older file stays intact.
    """
    flat = list(_flat(nouns))
    for noun in flat:
        _check(noun, path)
    if path.is_dir():
        raise InputError("a folder, not a file", where=str(path), advice="name a file inside it")
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.write(_preamble(path.stem, created or datetime.now()))
        for number, noun in enumerate(flat):
            for block in _blocks(noun, binary, number):
                file.write(block)


def _flat(nouns: Iterable[Any]) -> Iterator[Any]:
    for noun in nouns:
        if isinstance(noun, Contents):
            yield from ([] if noun.geometry is None else [noun.geometry])
            yield from (*noun.modes, *noun.frfs, *noun.recordings)
        elif isinstance(noun, (list, tuple)):
            yield from _flat(noun)
        else:
            yield noun


def _check(noun: Any, path: Path) -> None:
    """Refuse what the format cannot hold, before anything is written."""
    arrays: tuple[Any, ...]
    if isinstance(noun, FrfSet):
        arrays = (noun.values, noun.frequencies)
    elif isinstance(noun, Recording):
        arrays = (noun.signals,)
    elif isinstance(noun, Geometry):
        arrays = (noun.xyz,)
    elif isinstance(noun, ModalModel):
        arrays = (noun.shapes, noun.poles)
    else:
        raise InputError(
            "a universal file cannot hold this",
            where=str(path),
            got=type(noun).__name__,
            expected="FRF sets, recordings, a geometry or modal models",
        )
    for array in arrays:
        bad = int(array.size - np.count_nonzero(np.isfinite(array)))
        if bad:
            raise InputError(
                "NaN or infinite values are not written",
                where=f"{path.name}, {noun.name}",
                got=f"{bad} of {array.size}",
                advice="leave the bad lines or channels out first",
            )


def _preamble(name: str, created: datetime) -> bytes:
    """Data sets 151 (header) and 164 (units: SI)."""
    from ema import __version__

    day = created.strftime("%d-%b-%y").upper()
    clock = created.strftime("%H:%M:%S")
    header = [
        name[:80],
        "NONE",
        f"friction-ema {__version__}",
        f"{day:<10}{clock:<10}{0:10d}{0:10d}{0:10d}",
        f"{day:<10}{clock:<10}",
        f"friction-ema {__version__}",
        f"{day:<10}{clock:<10}",
    ]
    si = [f"{1:10d}{'SI: Meter (newton)':<20}{2:10d}", "".join(_d25(1.0) for _ in range(3)), _d25(273.15)]
    return geometry_sets.block(151, [f"{line:<80}" for line in header]) + geometry_sets.block(164, si)


def _d25(value: float) -> str:
    return f"{value:25.17E}".replace("E", "D")


def _blocks(noun: Any, binary: bool, number: int) -> Iterator[bytes]:
    if isinstance(noun, Geometry):
        yield geometry_sets.write_geometry(noun)
    elif isinstance(noun, ModalModel):
        yield write_modes(noun, number + 1)
    elif isinstance(noun, Recording):
        yield from _recording(noun, binary, number)
    else:
        yield from _frfs(noun, binary)


def function(header: Header, x: Any, y: Any) -> bytes:
    """One data set 58 or 58b."""
    render: Callable[..., bytes] = values58.to_binary if header.binary else values58.to_text
    values = render(header, x, y)
    return header58.render(header, len(values)) + values + f"{-1:6d}\n".encode()


def _point(dof: Dof | None) -> Point:
    if dof is None:
        return Point()
    return Point(dof.part or "NONE", dof.node, dof.uff_direction)


def _spacing(axis: Any) -> tuple[bool, float, float]:
    """Whether an axis is even, its start and its step."""
    if len(axis) < 2:
        return True, float(axis[0]), 1.0
    step = float((axis[-1] - axis[0]) / (len(axis) - 1))
    step = next(
        (nice for digits in range(3, 15) if np.isclose(nice := float(f"{step:.{digits}g}"), step, 1e-14, 0)), step
    )
    even = bool(np.abs(axis - axis[0] - step * np.arange(len(axis))).max() <= 1e-6 * step)
    return even, float(axis[0]), step


def _turns(dof: Dof) -> bool:
    return dof.axis.startswith("R")


def _ordinate(quantity: str, scaled: bool) -> Axis:
    """Axis of a quantity in SI, or of bare numbers."""
    return Axis(_CODES.get(quantity, 0), label=quantity, unit=SI_UNIT[quantity] if scaled else UNSTATED)


def _frfs(frfs: FrfSet, binary: bool) -> Iterator[bytes]:
    even, start, step = _spacing(frfs.frequencies)
    base = Header(
        ids=(frfs.name or "NONE", frfs.estimator or "NONE", "NONE", "NONE", "NONE"),
        function=header58.FRF,
        kind=6,
        points=len(frfs.frequencies),
        even=even,
        start=start,
        step=step,
        abscissa=Axis(18, label="Frequency", unit="Hz"),
        binary=binary,
    )
    coherence = frfs.coherence
    for column, input_ in enumerate(frfs.inputs):
        for row, output in enumerate(frfs.outputs):
            response = _RESPONSE[frfs.quantity][_turns(output)]
            header = replace(
                base,
                response=_point(output),
                reference=_point(input_),
                ordinate=_ordinate(response, frfs.scaled),
                denominator=_ordinate(("force", "torque")[_turns(input_)], frfs.scaled),
            )
            yield function(header, frfs.frequencies, frfs.values[:, row, column])
            if coherence is not None and np.isfinite(coherence[:, row, column]).all():
                header = replace(
                    header,
                    function=header58.COHERENCE,
                    kind=4,
                    ordinate=Axis(0, label="coherence", unit="NONE"),
                    denominator=Axis(),
                )
                yield function(header, frfs.frequencies, coherence[:, row, column])


def _recording(recording: Recording, binary: bool, number: int) -> Iterator[bytes]:
    double = recording.signals.dtype == np.float64
    date = "NONE" if recording.start is None else recording.start.strftime("%d-%b-%y %H:%M:%S")
    for channel, signal in zip(recording.channels, recording.signals, strict=True):
        header = Header(
            ids=(channel.name or "NONE", recording.name or "NONE", date, channel.serial or "NONE", "NONE"),
            function=header58.TIME,
            version=number,
            response=_point(channel.dof),
            kind=4 if double else 2,
            points=len(signal),
            even=True,
            start=0.0,
            step=1.0 / recording.sampling_rate,
            abscissa=Axis(17, label="Time", unit="s"),
            ordinate=_ordinate(channel.quantity, channel.scaled),
            binary=binary,
        )
        yield function(header, None, signal)
