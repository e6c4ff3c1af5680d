"""The blocks of an ASAM MDF 4 file, counted against each other before a parser unpacks them.

Every block begins with four letters, its length and the number of its links; a link is the address of another block
(ASAM MDF 4.1.1, 2014: chapter 5). What stands there twice is compared: lengths and ends, kinds of linked blocks,
cycles times bytes of a record against the bytes of the data, and where each channel lies in a record.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from ema.errors import InputError

_HEAD = struct.Struct("<4s4xQQ")
_FIRST = 64
"""Bytes of the identification, behind which the header block stands."""
_TEXT, _DATA = ("TX", "MD"), ("DT", "DV", "DZ", "DL", "HL", "LD")
_COMPOSED = ("CA", "CL", "CV", "CU")
_LINKED: dict[str, tuple[tuple[str, ...], ...]] = {
    "HD": (("DG",), ("FH",), ("CH",), ("AT",), ("EV",), _TEXT),
    "DG": (("DG",), ("CG",), _DATA, _TEXT),
    "CG": (("CG",), ("CN",), _TEXT, ("SI",), ("SR",), _TEXT, ("CG",)),
    "CN": (("CN",), ("CN", *_COMPOSED), _TEXT, ("SI",), ("CC",), ("SD", "CG", "AT", "CN", *_DATA), _TEXT, _TEXT),
    "FH": (("FH",), _TEXT),
    "AT": (("AT",), _TEXT, _TEXT, _TEXT),
    "SI": (_TEXT, _TEXT, _TEXT),
    "CC": (_TEXT, _TEXT, _TEXT, ("CC",)),
    "HL": (("DL",),),
    "DL": (("DL",),),
    "LD": (("LD",),),
}
"""Kinds of blocks that the links of each kind may name; further links, and those of other kinds, may name any."""
_KINDS = {*_LINKED, *_TEXT, *_DATA, *_COMPOSED, "SD", "CH", "EV", "SR", "DI", "RD", "RV", "RI"}
_VIRTUAL, _VARIABLE = (3, 6), 1
"""Types of channels without bytes in the record; flag of a group whose records differ in length."""


@dataclass(frozen=True)
class _Block:
    kind: str
    begin: int
    length: int
    links: tuple[int, ...]

    @property
    def content(self) -> int:
        """Where the bytes behind the links begin."""
        return self.begin + _HEAD.size + 8 * len(self.links)

    @property
    def size(self) -> int:
        """Bytes behind the links."""
        return self.begin + self.length - self.content


@dataclass(frozen=True)
class Correction:
    """A number of eight bytes at ``place`` that contradicts the file: ``stated`` there, and what it must be."""

    place: int
    stated: int
    right: int


@dataclass
class Blocks:
    """All blocks of a file that its header leads to, by address; with ``salvage``, what has to be corrected in it."""

    file: BinaryIO
    where: str
    end: int
    salvage: bool = False
    found: dict[int, _Block] = field(default_factory=dict)
    corrections: list[Correction] = field(default_factory=list)

    def damaged(self, what: str, got: object = None, expected: object = None, more: str = "") -> InputError:
        """The sentence about damage."""
        advice = f"copy or export the file again{more}"
        return InputError(what, where=self.where, got=got, expected=expected, advice=advice)

    def correct(self, place: int, stated: int, right: int, refusal: InputError) -> None:
        """Note that a number has to be corrected.

        Raises
        ------
        InputError : ``refusal``, where salvage was not asked for.
        """
        if not self.salvage:
            raise refusal
        self.corrections.append(Correction(place, stated, right))

    def walk(self) -> None:
        """Find all blocks.

        Raises
        ------
        InputError : a link leads to something else, a block reaches beyond the file or into another.
        """
        self._add(_FIRST, ("HD",), "the identification")
        waiting = [self.found[_FIRST]]
        while waiting:
            block = waiting.pop()
            allowed = _LINKED.get(block.kind, ())
            for number, address in enumerate(block.links):
                kinds = allowed[number] if number < len(allowed) else tuple(_KINDS)
                # in an event or a channel hierarchy a link may be anything; 0 is none
                if address and self._add(address, kinds, f"block {block.kind} at byte {block.begin}"):
                    waiting.append(self.found[address])
        last, before = 0, "the identification"
        for begin in sorted(self.found):
            if begin < last:
                raise self.damaged("two blocks overlap", f"{self.found[begin].kind} at byte {begin} and {before}")
            last, before = begin + self.found[begin].length, f"{self.found[begin].kind} at byte {begin}"

    def _add(self, address: int, kinds: tuple[str, ...], source: str) -> bool:
        """Read the head of a block; whether it is a new one."""
        if address not in self.found:
            self.found[address] = self._block(address, source)
        elif self.found[address].kind in kinds:
            return False
        if self.found[address].kind not in kinds:
            expected = " or ".join(kinds) if len(kinds) < 9 else "another block"
            raise self.damaged("a link leads to the wrong block", f"{self.found[address].kind} from {source}", expected)
        return True

    def _block(self, address: int, source: str) -> _Block:
        if address % 8 or not _FIRST <= address <= self.end - _HEAD.size:
            raise self.damaged("a link leads nowhere", f"byte {address} from {source}", f"below {self.end}")
        self.file.seek(address)
        name, length, count = _HEAD.unpack(self.file.read(_HEAD.size))
        kind = name[2:].decode("latin-1")
        if name[:2] != b"##" or kind not in _KINDS:
            raise self.damaged("a link leads to no block", f"byte {address} from {source}")
        rest = self.end - address
        if not _HEAD.size + 8 * count <= length <= rest:
            what = f"{kind} at byte {address} with {length} bytes and {count} links"
            records = kind == "DT" and not count
            more = SALVAGE if records else ""
            refusal = self.damaged("a block does not fit into the file", what, f"at most {rest} bytes", more)
            if not records:
                raise refusal
            self.correct(address + 8, length, rest, refusal)  # records up to the end, where the logger stopped
            length = rest
        return _Block(kind, address, length, struct.unpack(f"<{count}Q", self.file.read(8 * count)))

    def chain(self, address: int) -> Iterator[_Block]:
        """A block and those that its first link leads to, one after the other.

        Raises
        ------
        InputError : they lead in a circle.
        """
        seen = set[int]()
        while address:
            if address in seen:
                raise self.damaged("blocks lead in a circle", f"{self.found[address].kind} at byte {address}")
            seen.add(address)
            yield self.found[address]
            address = self.found[address].links[0] if self.found[address].links else 0

    def fields(self, block: _Block, form: str) -> tuple[int, ...]:
        """Numbers at the beginning of a block's content.

        Raises
        ------
        InputError : the block is too short.
        """
        if struct.calcsize(f"<{form}") > block.size:
            raise self.damaged("a block is too short", f"{block.kind} at byte {block.begin}")
        self.file.seek(block.content)
        return struct.unpack(f"<{form}", self.file.read(struct.calcsize(f"<{form}")))


SALVAGE = ", or read it with salvage=true"


def check(path: Path, salvage: bool = False) -> tuple[list[int], list[Correction]]:
    """Compare what an MDF 4 file announces with what it holds.

    Parameters
    ----------
    path : the file.
    salvage : take the whole records that are there where it holds fewer than it announces, instead of an error.

    Returns
    -------
    list : cycles of every group of channels that holds records of one length, in the order of the file.
    list : what has to be corrected in the file before it is parsed; none without ``salvage``.

    Raises
    ------
    InputError : they differ.
    """
    with path.open("rb") as file:
        end = file.seek(0, 2)
        blocks = Blocks(file, path.name, end, salvage)
        blocks.walk()
        cycles = []
        for data in blocks.chain(blocks.found[_FIRST].links[0]):
            cycles += _group(blocks, data)
    return cycles, blocks.corrections


def _group(blocks: Blocks, data: _Block) -> list[int]:
    """Cycles of the groups of channels that share one block of data, which is as long as their records together."""
    (number,) = blocks.fields(data, "B")
    if number not in (0, 1, 2, 4, 8) or len(data.links) < 4:
        raise blocks.damaged("a block is damaged", f"DG at byte {data.begin}")
    announced, cycles, groups, filled = 0, [], list(blocks.chain(data.links[1])), False
    for group in groups:
        _, count, flags, _, size, invalid = blocks.fields(group, "QQHH4xII")
        if flags & _VARIABLE:  # the two lengths are one number: bytes of all records together
            announced += count * (number + 4) + (invalid << 32) + size
        else:
            announced += count * (number + size + invalid)
            cycles.append(count)
            filled = _channels(blocks, group, size) == size
    there = _length(blocks, data.links[2])
    if there is None or there == announced:
        return cycles
    # records of one kind, whose channels fill them: of any other length they would be told apart at the wrong places
    alone = len(groups) == 1 and len(cycles) == 1 and number == 0 and filled
    refusal = blocks.damaged(
        "other data than the header announces",
        f"{there} bytes at byte {data.links[2]}",
        f"{announced} bytes of {sum(cycles)} cycles",
        SALVAGE if alone else "",
    )
    width = size + invalid if groups else 0
    if not alone or not width:
        raise refusal
    blocks.correct(groups[0].content + 8, cycles[0], there // width, refusal)
    return [there // width]


def _channels(blocks: Blocks, group: _Block, size: int) -> int:
    """Bytes that the channels fill, each of which has to lie within the record."""
    if len(group.links) < 2:
        raise blocks.damaged("a block is damaged", f"CG at byte {group.begin}")
    last = 0
    for channel in blocks.chain(group.links[1]):
        kind, _, _, bit, byte, bits = blocks.fields(channel, "BBBBII")
        last = max(last, 0 if kind in _VIRTUAL else byte + (bit + bits + 7) // 8)
        if kind not in _VIRTUAL and byte + (bit + bits + 7) // 8 > size:
            raise blocks.damaged(
                "a channel lies outside of its record",
                f"{bits} bits from byte {byte}, CN at byte {channel.begin}",
                f"a record of {size} bytes",
            )
    return last


def _length(blocks: Blocks, address: int) -> int | None:
    """Bytes of records behind a link, unpacked; ``None`` where they are stored by columns."""
    if not address:
        return 0
    block = blocks.found[address]
    if block.kind == "DT":
        return block.size
    if block.kind == "DZ":
        first, second, _, _, length, packed = blocks.fields(block, "BBBxIQQ")
        if packed != block.size - struct.calcsize("<BBBxIQQ") or bytes((first, second)) != b"DT":
            raise blocks.damaged("packed data of another length", f"{packed} bytes, DZ at byte {address}")
        return length
    if block.kind == "HL":
        return _length(blocks, block.links[0]) if block.links else 0
    if block.kind != "DL":
        return None
    lengths = [_length(blocks, one) or 0 for part in blocks.chain(address) for one in part.links[1:]]
    for part in blocks.chain(address):
        (count,) = blocks.fields(part, "4xI")
        if count != len(part.links) - 1:
            raise blocks.damaged("a list of another length", f"{count} links, DL at byte {part.begin}")
    return sum(lengths)
