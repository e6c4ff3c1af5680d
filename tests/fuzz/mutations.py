"""Mutations that know nothing of a format: noise in bytes, and damage of bytes and lines."""

import random

_LIKELY = [
    b"-1",
    b"    -1\n",
    b"\n",
    b"\0",
    b" ",
    b",",
    b".",
    b"9",
    b"nan",
    b"1e999",
    b"\xff\xff\xff\xff",
    b"\r\n",
    b"-",
]


def noise(draw: random.Random, data: bytes) -> tuple[bytes, str]:
    """Some bytes changed, put in or taken out."""
    changed, hows = bytearray(data), []
    for _ in range(draw.choice((1, 1, 2, 4, 8))):
        place = draw.randrange(len(changed))
        how = draw.choice(("changed", "flipped", "put in", "lost"))
        if how == "changed":
            changed[place] = draw.randrange(256)
        elif how == "flipped":
            changed[place] ^= 1 << draw.randrange(8)
        elif how == "put in":
            changed[place:place] = draw.choice(_LIKELY)
        else:
            del changed[place : place + draw.choice((1, 1, 2, 5))]
        hows.append(f"{how} at {place}")
        if not changed:
            return b" ", "all bytes lost"
    return bytes(changed), "bytes " + ", ".join(hows)


def damage(draw: random.Random, data: bytes) -> tuple[bytes, str]:
    """Bytes lost, doubled or moved, the end cut off, or bytes behind it."""
    length = min(draw.choice((1, 2, 3, 4, 7, 8, 16, 64, 512)), len(data) - 1)
    place = draw.randrange(len(data) - length)
    piece = data[place : place + length]
    how = draw.choice(("lost", "doubled", "moved", "cut", "appended"))
    if how == "lost":
        return data[:place] + data[place + length :], f"bytes lost: {length} at {place}"
    if how == "doubled":
        return data[:place] + piece + data[place:], f"bytes doubled: {length} at {place}"
    if how == "moved":
        rest = data[:place] + data[place + length :]
        goal = draw.randrange(len(rest))
        return rest[:goal] + piece + rest[goal:], f"bytes moved: {length} from {place} to {goal}"
    if how == "cut":
        return data[: place + 1], f"cut at {place + 1}"
    return data + piece, f"bytes appended: {length}"


def line_damage(draw: random.Random, lines: list[bytes], first: int, last: int) -> tuple[list[bytes], str, int, int]:
    """One of the lines from ``first`` to before ``last`` lost, doubled, blanked or moved; also from where to where."""
    place = draw.randrange(first, last)
    changed, line, goal = list(lines), lines[place], place
    how = draw.choice(("lost", "doubled", "blanked", "moved", "shortened"))
    if how == "lost":
        del changed[place]
    elif how == "doubled":
        changed.insert(place, line)
    elif how == "blanked":
        changed[place] = b""
    elif how == "moved":
        del changed[place]
        goal = draw.randrange(first, last)
        changed.insert(goal, line)
    else:
        changed[place] = line[: draw.randrange(len(line))] if line else line
    return changed, f"line {how}", place, goal
