"""What an HDF5 file of unknown origin may make us read: its own bytes, and only what was written.

One policy for our own files, foreign HDF5 and MATLAB 7.3: no link and no array leads to another file, no filter is
loaded as code, no object is built, and values that were never written are not made up from the fill value. Each refusal
is one sentence.
"""

import contextlib
import mmap
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py

from ema.errors import InputError

_HEAP, _HEAP_HEADER, _OBJECT_HEADER, _ALIGNED = b"GCOL\x01\0\0\0", 16, 16, 8
"""Signature and version of a global heap collection; sizes of its header and of that of its objects, and their grid
(HDF5 File Format Specification, version 3.0, section III.E)."""
BUILT_IN_FILTERS = frozenset(range(1, 7)) | {h5py.h5z.FILTER_LZF}
"""Filters of the library itself: deflate, shuffle, fletcher32, szip, nbit, scaleoffset; and lzf, which h5py brings."""


@contextlib.contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """A foreign file, open for reading, whose heaps of texts and references are sound.

    Raises
    ------
    InputError : a damaged heap, at which the library would never end.
    """
    check_heaps(path)
    with h5py.File(path, "r", locking=False) as file:
        yield file


def check_heaps(path: Path) -> None:
    """Walk through every global heap collection of a file as the library does.

    The library steps from object to object by the size each states, and a free one of size zero keeps it on the spot
    for ever.

    Raises
    ------
    InputError : the objects of a collection do not fill it.
    """
    with path.open("rb") as file:
        if not os.fstat(file.fileno()).st_size:
            return
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            start = data.find(_HEAP)
            while start >= 0:
                _check_heap(data, start, path)
                start = data.find(_HEAP, start + 1)


def _check_heap(data: mmap.mmap, start: int, path: Path) -> None:
    end = start + int.from_bytes(data[start + 8 : start + 16], "little")
    place = start + _HEAP_HEADER
    sound = end <= len(data)
    while sound and place + _OBJECT_HEADER <= end:
        number = int.from_bytes(data[place : place + 2], "little")
        size = int.from_bytes(data[place + 8 : place + 16], "little")
        # the size of free space counts its header, that of an object does not
        step = size if number == 0 else _OBJECT_HEADER + -(-size // _ALIGNED) * _ALIGNED
        sound = step >= _OBJECT_HEADER and place + step <= end
        place += step
    if not sound:
        raise InputError("the store of its texts is damaged", where=str(path), advice="read it from a backup")


def member(group: h5py.Group, path: str) -> Any:
    """The group or dataset at ``path`` below ``group``, reached by hard links alone.

    Raises
    ------
    InputError : there is none, or a link on the way leads elsewhere.
    """
    place: Any = group
    for step in path.strip("/").split("/"):
        link = place.get(step, getlink=True) if isinstance(place, h5py.Group) and step not in ("", ".", "..") else None
        if link is None:
            raise InputError("holds no such data", got=path, advice="the file is damaged: read it from a backup")
        if not isinstance(link, h5py.HardLink):
            raise InputError(
                "holds a link to somewhere else, which is not followed",
                got=path,
                advice="write the file again with all its data inside",
            )
        place = place[step]
    return place


def refuse_link(link: Any, path: str) -> None:
    """Refuse a link to another file, or of a kind that the library leaves to plug-ins.

    Raises
    ------
    InputError : it is one.
    """
    if not isinstance(link, (h5py.HardLink, h5py.SoftLink)):
        raise InputError(
            "holds a link to another file, which is not followed",
            got=path,
            advice="write the file again with all its data inside",
        )


def check(dataset: h5py.Dataset, path: str, filters: frozenset[int] = BUILT_IN_FILTERS) -> None:
    """Refuse an array that lies outside its file, needs foreign code, or was never written in full.

    Parameters
    ----------
    dataset : the array; a virtual one is followed to its sources in the same file.
    path : name of the file and of the array, for the message.
    filters : numbers of the HDF5 filters that may have packed it; by default those that come with HDF5.

    Raises
    ------
    InputError : external storage, values from another file, an unknown filter, or values that are not there.
    """
    _check(dataset, path, filters, ())


def _check(dataset: h5py.Dataset, path: str, filters: frozenset[int], users: tuple[int, ...]) -> None:
    if dataset.is_virtual:
        _check_virtual(dataset, path, filters, users)
        return
    if dataset.external:
        raise InputError(
            "holds an array whose values lie in another file, which is not read",
            got=path,
            advice="write the file again with all its data inside",
        )
    settings = dataset.id.get_create_plist()
    used = [settings.get_filter(number)[0] for number in range(settings.get_nfilters())]
    strange = [number for number in used if number not in filters]
    if strange:
        raise InputError(
            "holds an array packed by a filter that is not read",
            got=f"{path}, filter {strange[0]}",
            advice="write the file again with gzip or without compression",
        )
    if not dataset.size:
        return
    if dataset.chunks is None:
        if dataset.id.get_space_status() != h5py.h5d.SPACE_STATUS_ALLOCATED:
            raise InputError(
                "holds an array whose values were never written", got=path, advice="measure or export again"
            )
        return
    _check_chunks(dataset, path, used)


def _check_chunks(dataset: h5py.Dataset, path: str, used: list[int]) -> None:
    """Refuse an array some of whose chunks are missing, doubled, or exempt from their checksum."""
    wanted = 1
    for length, chunk in zip(dataset.shape, dataset.chunks, strict=True):
        wanted *= -(-length // chunk)
    sums = [place for place, number in enumerate(used) if number == h5py.h5z.FILTER_FLETCHER32]
    places: set[int] = set()
    unchecked = False

    def count(chunk: Any) -> None:
        """Note where the bytes of a chunk lie; where it belongs is not reported reliably for arrays that can grow."""
        nonlocal unchecked
        places.add(chunk.byte_offset)
        unchecked |= any(chunk.filter_mask >> place & 1 for place in sums)

    dataset.id.chunk_iter(count)
    if len(places) != wanted:
        raise InputError(
            "holds an array of which a part was never written",
            got=f"{path}: {len(places)} of {wanted} chunks",
            advice="measure or export again",
        )
    if unchecked:
        raise InputError(
            "holds an array whose checksum is switched off in places",
            got=path,
            advice="read the file from a backup, or export it again",
        )


def _check_virtual(dataset: h5py.Dataset, path: str, filters: frozenset[int], users: tuple[int, ...]) -> None:
    """Refuse a virtual array unless arrays of the same file fill it."""
    address = h5py.h5o.get_info(dataset.id).addr
    covered = 0
    for source in dataset.virtual_sources():
        if source.file_name != ".":
            raise InputError(
                "holds an array whose values lie in another file, which is not read",
                got=path,
                advice="write the file again with all its data inside",
            )
        inner = member(dataset.file, source.dset_name)
        if not isinstance(inner, h5py.Dataset) or address in users:
            raise InputError(
                "holds an array that is made of itself or of a group",
                got=path,
                advice="write the file again with all its data inside",
            )
        _check(inner, source.dset_name, filters, (*users, address))
        points = source.vspace.get_select_npoints()
        if not _holds(inner, source.src_space, points):
            raise InputError(
                "holds an array whose values are not all there", got=path, advice="measure or export again"
            )
        covered += points
    if covered != dataset.size:
        raise InputError("holds an array whose values are not all there", got=path, advice="measure or export again")


def _holds(inner: h5py.Dataset, selection: Any, points: int) -> bool:
    """Whether an array has all the points that a selection takes from it."""
    if selection.get_select_type() == h5py.h5s.SEL_ALL:
        return bool(inner.size == points)
    last = selection.get_select_bounds()[1]
    inside = len(last) == inner.ndim and all(end < length for end, length in zip(last, inner.shape, strict=True))
    return inside and bool(selection.get_select_npoints() == points)
