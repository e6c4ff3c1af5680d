"""Wave audio; it knows no unit, so the numbers are fractions of full scale."""

from pathlib import Path
from typing import Any

import numpy as np

from acquisition.contents import Contents
from acquisition.files.arrays import Arrays, not_finite
from acquisition.files.layout import Layout
from acquisition.files.reconcile import differs
from acquisition.files.signals import channel_units, make_recording
from acquisition.isolated import call
from ema.data import Finding
from ema.errors import InputError, require
from ema.units import UNSTATED


def read(path: Path, layout: Layout) -> Contents:
    """Read all channels.

    Parameters
    ----------
    path : Path
        File that exists and whose format was recognised.
    layout : Layout
        ``names`` and ``units`` of the channels, which the format does not state; ``salvage``: read a file that ends too
        early.

    Returns
    -------
    Contents
        One recording with signals (channel, sample): fractions of full scale, or in SI where ``units`` are given.

    Raises
    ------
    MissingExtraError
        soundfile is not installed.
    InputError
        The file is damaged.
    """
    notes = _announced(path, layout)
    there = call("wav", path)
    signals, rate, frames, coding = (there[name] for name in ("signals", "rate", "frames", "coding"))
    if coding == "FLAC" and len(signals) != frames:
        notes += differs(
            "the file ends too early",
            where=path.name,
            layout=layout,
            got=f"{len(signals)} samples",
            expected=frames,
            recovered=f"{len(signals)} samples are read",
        )
    count, about_count = _counted(path, layout, len(signals), signals.shape[1])
    signals, notes = signals[:count], notes + about_count
    lossy = next((words for word, words in _LOSSY.items() if word in there["subtype"]), None)
    if lossy is not None:
        message = f"its samples are coded as {lossy}, which loses small changes beside large ones."
        advice = "Record as PCM or floating point; damping and weak peaks may be wrong."
        notes += (Finding("warning", "lossy-coding", path.name, message, advice=advice),)
    pool = Arrays(path.name, {"": signals})
    names = [f"channel {number + 1}" for number in range(signals.shape[1])]
    if layout.names is not None:
        names = pool.texts(layout.names)
    unit = channel_units(pool, layout, names, [UNSTATED] * len(names))
    record = make_recording(np.ascontiguousarray(signals.T), names, unit, float(rate), path.name)
    physical = any(word in there["subtype"].upper() for word in ("FLOAT", "DOUBLE"))
    note = Finding(
        "info" if physical else "warning",
        "full-scale",
        path.name,
        "the numbers of a wave file are fractions of full scale"
        + ("." if physical else ": full scale is taken as 1 V, or as 1 of the unit stated."),
        advice="Say units or sensitivities in the channel table; a sensitivity has to contain the volts of full scale, "
        "or forces and modal masses are wrong.",
    )
    if layout.units is None:
        notes += (note,)
    return Contents(recordings=(record,), findings=(*notes, *not_finite(record.signals, path.name)))


def samples(path: Path) -> dict[str, Any]:
    """The ``signals`` (sample, channel) with their ``rate`` in Hz, number of ``frames`` announced, and codings."""
    soundfile = require("soundfile", "formats")
    with soundfile.SoundFile(str(path)) as file:
        signals = file.read(dtype="float64", always_2d=True)
        kind = {"coding": file.format, "subtype": file.subtype}
        return {"rate": file.samplerate, "frames": file.frames, "signals": signals, **kind}


_LOSSY = {
    "ULAW": "mu-law (8 bits, logarithmic)",
    "ALAW": "A-law (8 bits, logarithmic)",
    "ADPCM": "ADPCM (4 bits of differences)",
    "GSM": "GSM speech",
    "G72": "G.72x speech",
    "MPEG": "MPEG audio",
}
"""Parts of the names that libsndfile gives to codings that do not keep their samples."""


_UNKNOWN = (0, 0xFFFFFFFF)
"""Sizes that a recorder writes that does not know them yet."""


def _announced(path: Path, layout: Layout) -> tuple[Finding, ...]:
    """Compare the sizes of the chunks of a RIFF, RF64 or W64 file with the bytes that are there.

    Source: Multimedia Programming Interface and Data Specifications 1.0 (1991), chapter 2; EBU Tech 3306 (RF64); Sony
    Wave64.

    Raises
    ------
    InputError : the data chunk is cut short or no whole number of samples, and salvage was not asked for.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        start = file.read(40)
        wide = start[:4] == b"riff"
        if start[:4] not in (b"RIFF", b"RF64", b"riff"):
            return ()  # FLAC counts its samples itself
        place, tag, align, long_size = 40 if wide else 12, 16 if wide else 4, 0, 0
        while place + tag + (8 if wide else 4) <= size:
            file.seek(place)
            head = file.read(tag + (8 if wide else 4))
            length = int.from_bytes(head[tag:], "little") - (24 if wide else 0)
            body = file.read(28)
            if head[:4] == b"ds64":
                long_size = int.from_bytes(body[8:16], "little")
            if head[:4] == b"fmt ":
                align = int.from_bytes(body[12:14], "little")
                _check_format(body, path)
            begin = place + len(head)
            if head[:4] == b"data":
                announced = long_size if start[:4] == b"RF64" and length == 0xFFFFFFFF else length
                notes = _compare(announced, size - begin, align, path, layout)
                whole = int.from_bytes(start[4:8], "little")
                # a byte that fills up an odd chunk, which some writers do not count or leave out
                odd = 0 if announced in _UNKNOWN else length % 2
                if (
                    start[:4] == b"RIFF"
                    and whole not in _UNKNOWN
                    and not _salvaged(notes)
                    and abs(whole + 8 - size) > odd
                ):
                    notes += differs(
                        "the file is not as long as it announces",
                        where=path.name,
                        layout=layout,
                        got=f"{size} bytes",
                        expected=whole + 8,
                        recovered="the samples that are announced are read",
                    )
                return notes
            step = 8 if wide else 2
            place = begin + -(-max(length, 0) // step) * step
    raise InputError("no data in the file", where=path.name, advice="copy or export it again")


def _counted(path: Path, layout: Layout, there: int, channels: int) -> tuple[int, tuple[Finding, ...]]:
    """Samples of each channel by the fact chunk of a RIFF file, which blocks of packed samples are filled up behind.

    Raises
    ------
    InputError : it announces another number than there are, and salvage was not asked for.
    """
    chunks = _chunks(path)
    form, fact = chunks.get(b"fmt ", b""), int.from_bytes(chunks.get(b"fact", b"")[:4], "little")
    block = int.from_bytes(form[18:20], "little") if form[:2] in (b"\x02\0", b"\x11\0") else 1  # of ADPCM
    # some writers count the samples of all channels, libsndfile those of IMA ADPCM divided by them
    divided = channels > 1 and 0 <= there - fact * channels < block
    if form[:2] == b"\x01\0" or fact in (*_UNKNOWN, there, there * channels) or divided:
        return there, ()
    if fact < there < fact + block:
        return fact, ()
    count = min(fact, there)
    return count, differs(
        "another number of samples than the fact chunk announces",
        where=path.name,
        layout=layout,
        got=there,
        expected=fact,
        recovered=f"{count} samples are read" if count > 1 else "",
    )


def _chunks(path: Path) -> dict[bytes, bytes]:
    """The first bytes of the chunks of a RIFF file by name, up to that of the samples."""
    found: dict[bytes, bytes] = {}
    with path.open("rb") as file:
        if file.read(12)[:4] not in (b"RIFF", b"RF64"):
            return found
        while len(head := file.read(8)) == 8 and head[:4] != b"data":
            length = int.from_bytes(head[4:], "little")
            begin = file.tell()
            found.setdefault(head[:4], file.read(min(length, 40)))
            file.seek(begin + length + length % 2)
    return found


def _salvaged(notes: tuple[Finding, ...]) -> bool:
    return any(note.severity == "error" for note in notes)


def _check_format(body: bytes, path: Path) -> None:
    """Compare what the format chunk of uncompressed samples says twice.

    Raises
    ------
    InputError : bytes of a sample of all channels, or of a second, contradict channels, bits and sampling rate.
    """
    code, count = int.from_bytes(body[:2], "little"), int.from_bytes(body[2:4], "little")
    rate, second = int.from_bytes(body[4:8], "little"), int.from_bytes(body[8:12], "little")
    align, bits = int.from_bytes(body[12:14], "little"), int.from_bytes(body[14:16], "little")
    if code in (1, 3) and (align != count * -(-bits // 8) or second != rate * align):
        raise InputError(
            "the format of the samples contradicts itself",
            where=path.name,
            got=f"{align} bytes, {second} in a second",
            expected=f"{count} channels of {bits} bits at {rate} Hz",
            advice="copy or export it again",
        )


def _compare(announced: int, there: int, align: int, path: Path, layout: Layout) -> tuple[Finding, ...]:
    if announced in _UNKNOWN:
        message = "the header does not say how many samples there are; all that follow are read."
        return (Finding("warning", "length-unstated", path.name, message),)
    samples = there // align if align else 0
    if announced > there:
        return differs(
            "the file ends too early",
            where=path.name,
            layout=layout,
            got=f"{there} bytes of samples",
            expected=announced,
            recovered=f"{samples} samples are read" if samples > 1 else "",
        )
    if align and announced % align:
        return differs(
            "the samples are not whole",
            where=path.name,
            layout=layout,
            got=f"{announced} bytes",
            expected=f"a multiple of {align}",
            recovered=f"{announced // align} samples are read",
        )
    return ()
