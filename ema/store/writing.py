"""Write containers to a file."""

import contextlib
import json
import zlib
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from types import TracebackType
from typing import Any, overload

import h5py
import numpy as np
from jaxtyping import Float

from ema import __version__
from ema.data import FrfSet, Lazy, Recording
from ema.data.window import Window
from ema.dof import Dof
from ema.errors import InputError
from ema.store.atomic import replacing, write_failure
from ema.store.document import Parts, encode
from ema.store.interrupts import deferred
from ema.store.layout import CONTENTS, DOCUMENT, FORMAT, ITEMS, SCHEMA_VERSION
from ema.store.meaning import Meaning
from ema.store.sink import Sink

_COMPRESS_FROM = 4096
"""Bytes from which arrays are compressed: below, it costs more than it saves."""
_COMPRESSIONS = ("", "gzip")
_SIGNAL_CHUNK = 65536
"""Samples of a signal that lie together in a file, half a megabyte of float64."""
_FRF_CHUNK = 256, 64, 4
"""Lines, outputs and inputs that lie together in the file of a set in blocks, a megabyte of complex128: a band of lines
of all outputs, and all lines of some outputs, are read without anything else.
"""
_IN_BLOCKS = ("values", "variance", "coherence")
"""Fields of a set of FRFs that are written in blocks."""


def save(path: str | Path, content: Any, exclusive: bool = False, *, compression: str = "") -> None:
    """Write data types to a file; atomically, replacing what was there.

    Parameters
    ----------
    path : str or Path
        The file, by custom ``*.h5``; its folder must exist.
    content : object
        A data type of ``ema.data``, a mapping of names to data types, or a list, tuple or ``Lazy`` of them (made one by
        one).
    exclusive : bool, default False
        Create the file, and never replace one.
    compression : str, optional
        ``"gzip"`` packs arrays from 4 kB on, which costs twenty times the time; empty for none.

    Raises
    ------
    InputError
        If ``content`` holds something that is no data type, or ``compression`` is unknown.
    FailureError
        If the file cannot be written, or exists and ``exclusive`` is set; the former file is untouched.

    Examples
    --------
    >>> import tempfile
    >>> from ema.examples import modal_model
    >>> from ema.store import load
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save(f"{folder}/modes.h5", modal_model())
    ...     load(f"{folder}/modes.h5")
    ModalModel('line', 3 modes 40 to 90 Hz, damping 0.5 to 1 %, 4 DOFs, unit modal mass)
    """
    if isinstance(content, Mapping):
        with Writer(path, kind="mapping", exclusive=exclusive, compression=compression) as writer:
            for name, container in content.items():
                writer.add(container, str(name))
    elif isinstance(content, (list, tuple, Lazy)):
        with Writer(path, kind="sequence", exclusive=exclusive, compression=compression) as writer:
            for container in content:
                writer.add(container)
    else:
        with Writer(path, kind="noun", exclusive=exclusive, compression=compression) as writer:
            writer.add(content)


class Writer(AbstractContextManager["Writer"]):
    """Writes data types one after the other into one file.

    The file appears under its name when the ``with`` block ends without an error.

    Parameters
    ----------
    path : str or Path
        The file, by custom ``*.h5``; its folder must exist.
    kind : str, default "mapping"
        What ``load`` returns: ``mapping`` of the names, ``sequence``, or the single ``noun``.
    exclusive : bool, default False
        Create the file, and never replace one.
    compression : str, optional
        ``"gzip"`` packs arrays from 4 kB on; empty for none.

    Raises
    ------
    InputError
        If ``kind`` or ``compression`` is unknown.

    Examples
    --------
    >>> import tempfile
    >>> from ema.examples import frf_set, modal_model
    >>> from ema.store import describe
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with Writer(f"{folder}/results.h5") as writer:
    ...         writer.add(frf_set(), "frfs")
    ...         writer.add(modal_model(), "modes")
    ...     [header.name for header in describe(f"{folder}/results.h5")]
    ['frfs', 'modes']
    """

    def __init__(
        self, path: str | Path, kind: str = "mapping", exclusive: bool = False, *, compression: str = ""
    ) -> None:
        if kind not in ("mapping", "sequence", "noun"):
            raise InputError("unknown kind of collection", got=kind, expected="mapping, sequence or noun")
        if compression not in _COMPRESSIONS:
            raise InputError("unknown compression", got=compression, expected='"gzip", or "" for none')
        self.path, self.kind, self.compression, self._exclusive = Path(path), kind, compression, exclusive
        self._names: list[str] = []
        self._started: list[FrfBlockWriter] = []

    def __enter__(self) -> "Writer":
        with contextlib.ExitStack() as exits:
            temporary = exits.enter_context(replacing(self.path, self._exclusive))
            with deferred():
                self._sink = Sink(temporary)
                self._file = h5py.File(self._sink, "w", libver="v110")
                exits.push(self._finish)  # runs before the renaming, which its failure prevents
            self._exits = exits.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        return self._exits.__exit__(kind, error, trace)

    def _finish(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with deferred():
            unfinished = [one for one in self._started if not one.complete] if error is None else []
            if error is None and not unfinished:
                # texts of fixed length lie beside their names, others in a heap of their own
                self._file.attrs.update(
                    format=np.bytes_(FORMAT),
                    schema_version=SCHEMA_VERSION,
                    written_by=np.bytes_(f"friction-ema {__version__}"),
                )
                _write_text(self._file, CONTENTS, json.dumps({"kind": self.kind, "names": self._names}))
            self._file.close()
            self._sink.close()
        if error is None:
            self.check()
        if unfinished:
            raise unfinished[0].missing()

    def add(self, container: Any, name: str = "") -> None:
        """Write one item; its arrays may be dropped by the caller afterwards.

        Parameters
        ----------
        container : object
            Any data type of ``ema.data``.
        name : str, optional
            Name of the item in a mapping.

        Raises
        ------
        InputError
            If it is no data type, or the name is taken.
        FailureError
            If the disk is full.

        Examples
        --------
        >>> import tempfile
        >>> from ema.examples import modal_model
        >>> with tempfile.TemporaryDirectory() as folder, Writer(f"{folder}/modes.h5", kind="noun") as writer:
        ...     writer.add(modal_model())
        """
        self._new_item(container, name)

    @overload
    def begin(self, header: Recording, name: str = "") -> "BlockWriter": ...

    @overload
    def begin(self, header: FrfSet, name: str = "") -> "FrfBlockWriter": ...

    def begin(self, header: Recording | FrfSet, name: str = "") -> "BlockWriter | FrfBlockWriter":
        """Start a record, or a set of FRFs, that arrives in blocks.

        Parameters
        ----------
        header : Recording or FrfSet
            The record with no samples yet, shape (channel, 0); its ``signals.dtype`` (float32 or float64) is the one
            stored. Or the set with all its ``outputs`` and no values yet, shape (freq, 0, in); likewise its
            ``variance`` or ``coherence``, if they will come with the values.
        name : str, optional
            Name of the item in a mapping.

        Returns
        -------
        BlockWriter or FrfBlockWriter
            What the blocks are appended to, by ``append`` or ``extend``: samples of a record, outputs of a set.

        Raises
        ------
        InputError
            If the header has samples or values, or the name is taken.

        Examples
        --------
        >>> import tempfile
        >>> from dataclasses import replace
        >>> from ema.examples import recording
        >>> from ema.store import describe
        >>> record = recording()
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     with Writer(f"{folder}/record.h5", kind="noun") as writer:
        ...         growing = writer.begin(replace(record, signals=record.signals[:, :0]))
        ...         for start in range(0, 2048, 512):
        ...             growing.append(record.signals[:, start : start + 512])
        ...     describe(f"{folder}/record.h5")[0].samples
        2048
        """
        if isinstance(header, FrfSet):
            if header.values.shape[1] != 0:
                raise InputError(
                    "the header of a set of FRFs in blocks has values",
                    got=f"{header.values.shape[1]} outputs",
                    expected="shape (freq, 0, in)",
                )
            if header.deviations is not None or header.set_ups is not None:
                raise InputError(
                    "deviations of impacts and set-ups are not written in blocks",
                    where=header.name,
                    advice="write a set of FRFs for each set-up, with the variance of its values",
                )
            started = FrfBlockWriter(self, self._new_item(header, name, growing=True), header)
            self._started.append(started)
            return started
        if header.signals.shape[1] != 0:
            raise InputError("the header of a record in blocks has samples", got=header.signals.shape[1], expected=0)
        return BlockWriter(self, self._new_item(header, name, growing=True)["signals"])

    def _new_item(self, container: Any, name: str, growing: bool = False) -> h5py.Group:
        if self.kind == "mapping" and name in self._names:
            raise InputError(
                "two containers of one name", where=str(self.path), got=name, advice="give each a name of its own"
            )
        with deferred():
            group = self._file.create_group(f"{ITEMS}/{len(self._names)}")
            _write(group, container, self.compression, growing=growing)
        self._names.append(name)
        self.check()
        return group

    def check(self) -> None:
        """Raise what has kept bytes from reaching the disk.

        Raises
        ------
        FailureError
            If a write has failed.

        Examples
        --------
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder, Writer(f"{folder}/empty.h5") as writer:
        ...     writer.check()
        """
        if self._sink.failure is not None:
            raise write_failure(self._sink.failure, self.path) from self._sink.failure


class BlockWriter:
    """Appends blocks of samples to one record."""

    def __init__(self, writer: Writer, signals: h5py.Dataset) -> None:
        self._writer, self._signals = writer, signals

    def append(self, block: Float[np.ndarray, "channel sample"]) -> None:
        """Add ``block`` (channel, sample) at the end of the record.

        Raises
        ------
        InputError : the number of channels differs.
        FailureError : the disk is full.
        """
        channels, before = self._signals.shape
        if block.shape[0] != channels:
            raise InputError(
                "a block with another number of channels",
                where=str(self._writer.path),
                got=block.shape[0],
                expected=channels,
            )
        with deferred():
            self._signals.resize(before + block.shape[1], axis=1)
            self._signals[:, before:] = block
        self._writer.check()


class FrfBlockWriter:
    """Appends outputs to one set of FRFs."""

    def __init__(self, writer: Writer, group: h5py.Group, header: FrfSet) -> None:
        self._writer, self._group, self._header, self._done = writer, group, header, 0

    @property
    def complete(self) -> bool:
        """Whether all outputs were appended."""
        return self._done == len(self._header.outputs)

    def missing(self) -> InputError:
        """What to say of a set that ends early."""
        return InputError(
            "a set of FRFs ended before its last output",
            where=str(self._writer.path),
            got=f"{self._done} outputs",
            expected=f"{len(self._header.outputs)}, as its header says",
            advice="no file was written; append the FRFs of all outputs",
        )

    def append(self, block: FrfSet) -> None:
        """Add the next outputs, with their variance or coherence where the header has one.

        Raises
        ------
        InputError : the outputs are not the next ones, or lines, inputs, quantity or unit differ.
        FailureError : the disk is full.
        """
        header, first = self._header, self._done
        last = first + len(block.outputs)
        for what, got, expected in (
            ("units", f"{block.quantity} [{block.unit}]", f"{header.quantity} [{header.unit}]"),
            ("outputs", _few(block.outputs), _few(header.outputs[first:last])),
            ("inputs", _few(block.inputs), _few(header.inputs)),
            ("frequency lines", block.frequencies, header.frequencies),
            ("number of values", block.values.shape[1], len(block.outputs)),
        ):
            if not np.array_equal(np.asarray(got), np.asarray(expected)):
                raise InputError(
                    f"a block of FRFs has other {what} than its set",
                    where=f"{self._writer.path}, outputs {first + 1} to {last}",
                    got=str(got)[:80],
                    expected=str(expected)[:80],
                )
        for name in _IN_BLOCKS:
            own = getattr(block, name)
            if (own is None) != (getattr(header, name) is None):
                raise InputError(
                    f"the {name} of a block of FRFs is {'missing' if own is None else 'unexpected'}",
                    where=f"{self._writer.path}, outputs {first + 1} to {last}",
                    expected="as in the header of the set",
                )
            if own is not None:
                with deferred():
                    self._group[name][:, first:last] = np.asarray(own)
                self._writer.check()
        self._done = last

    def extend(self, blocks: Iterable[FrfSet]) -> None:
        """Add blocks one after the other, as a generator makes them (`append`)."""
        for block in blocks:
            self.append(block)


def _few(dofs: Sequence[Dof]) -> str:
    """DOFs as a text that tells different ones apart, and begins with the first ones."""
    return " ".join(map(str, dofs))


def _write(group: h5py.Group, container: Any, compression: str, *, growing: bool = False) -> None:
    parts = Parts()
    tree = encode(container, parts)
    if not isinstance(tree, dict) or "$noun" not in tree:
        raise InputError("cannot be stored", got=type(container).__name__, expected="a container of ema.data")
    for path, (array, what) in parts.arrays.items():
        in_blocks = growing and isinstance(container, FrfSet) and path in _IN_BLOCKS
        if in_blocks or isinstance(array, Window):
            outputs = len(container.outputs) if in_blocks else array.shape[-2]
            parts.nodes[path]["in_blocks"] = True
            _write_in_blocks(group, path, array, what, outputs)
            continue
        stored = np.asarray(np.char.encode(array, "utf-8") if array.dtype.kind == "U" else array, order="C")
        grows = growing and path == "signals"
        if not grows:  # a record that grows has a sum in each of its chunks
            parts.nodes[path]["crc32"] = zlib.crc32(stored.data)
        chunks = (1, _SIGNAL_CHUNK) if isinstance(container, Recording) and path == "signals" else None
        _write_array(group, path, stored, what, {"chunks": chunks, "growing": grows, "compression": compression})
    _write_text(group, DOCUMENT, json.dumps(tree, allow_nan=False, ensure_ascii=False))
    for path, items in parts.sequences.items():
        for place, item in enumerate(items):
            _write(group.create_group(f"{path}/{place}"), item, compression)


def _write_text(group: h5py.Group, name: str, text: str) -> None:
    """As one fixed-length string in a chunk of its own: the checksum then covers it."""
    data = np.array([text.encode("utf-8")])
    kind = h5py.string_dtype("utf-8", data.dtype.itemsize)
    group.create_dataset(
        name, data=data.astype(kind), dtype=kind, chunks=(1,), compression="gzip", compression_opts=1, fletcher32=True
    )


def _write_array(group: h5py.Group, path: str, array: np.ndarray, what: Meaning, layout: dict[str, Any]) -> None:
    """In one piece, signals in chunks, since they are read in blocks; what grows or is packed has sums in its chunks.

    ``layout`` holds ``chunks``, whether it is ``growing``, and the ``compression``.
    """
    options: dict[str, Any] = {}
    chunks, packed = layout["chunks"], layout["compression"] and (layout["growing"] or array.nbytes >= _COMPRESS_FROM)
    if layout["growing"]:
        options = {"chunks": chunks, "maxshape": (array.shape[0], None), "fletcher32": True}
    elif chunks is not None and array.size:
        options = {"chunks": tuple(min(size, chunk) for size, chunk in zip(array.shape, chunks, strict=True))}
    if packed:
        options |= {"compression": layout["compression"], "compression_opts": 1, "shuffle": True, "fletcher32": True}
    _describe(group.create_dataset(path, data=array, **options), what)


def _write_in_blocks(group: h5py.Group, path: str, array: np.ndarray | Window, what: Meaning, outputs: int) -> None:
    """Values (..., freq, out, in) larger than memory: room for all outputs; of a window, the values as well."""
    *before, lines, _, inputs = array.shape
    sizes = (*(1 for _ in before), *map(min, (lines, outputs, inputs), _FRF_CHUNK))
    chunks = tuple(max(size, 1) for size in sizes)
    shape = (*before, lines, outputs, inputs)
    dataset = group.create_dataset(path, shape, array.dtype, chunks=chunks, fletcher32=True)
    _describe(dataset, what)
    for first in range(0, outputs if isinstance(array, Window) else 0, _FRF_CHUNK[1]):
        part = (*(slice(None) for _ in (*before, lines)), slice(first, first + _FRF_CHUNK[1]))
        dataset[part] = np.asarray(array[part])


def _describe(dataset: h5py.Dataset, what: Meaning) -> None:
    """What the values mean, beside them."""
    for name, value in (("quantity", what.quantity), ("unit", what.unit), ("long_name", what.long_name)):
        if value:
            dataset.attrs[name] = value if isinstance(value, str) else list(value)
