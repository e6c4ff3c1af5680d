"""Time stamps in front of the rows of a table become seconds after the first of them."""

import re
from datetime import date

from acquisition.files.table.titles import TITLES
from ema.errors import InputError

_STAMP = re.compile(
    r"^\s*\"?(?:(?P<date>\d{4}[-/.]\d\d?[-/.]\d\d?|\d\d?[-/.]\d\d?[-/.]\d{4})(?P<between>T| +|\"?[;,\t]\s*\"?))?"
    r"(?P<hour>[01]?\d|2[0-3]):(?P<minute>[0-5]\d):(?P<second>[0-5]\d(?:\.\d+|,\d+(?=\"?\s*[;\t]))?)"
    r"(?P<zone>Z|[-+]\d\d:?\d\d)?\"?(?=\s*(?:[;,\t]|$))"
)
"""Date and time of day as ISO 8601 and most loggers write them, in one column or two. A comma in the seconds is a
decimal mark only where another delimiter follows."""
_FORM = re.compile(r"\W*(?:[hH]+\W+[mM]+\W+[sS]+\W*[sSfF0-9]*|[dDyYtTmMjJ]{1,4}\W+[dDmMyYtTjJ]{1,4}\W.*)\W*")
"""What stands in a line of units above stamps: ``hh:mm:ss``, ``dd.mm.yyyy hh:mm:ss``."""
_DAY = 86400.0


def in_seconds(lines: list[str], where: str) -> list[str]:
    """The lines with seconds after the first row instead of time stamps; as they are where most rows have none.

    The title above becomes one of times in s; a date in a column of its own becomes an empty cell. A time of day that
    falls by more than half a day has passed midnight.

    Raises
    ------
    InputError : the dates change and do not show which of their numbers is the day.

    Examples
    --------
    >>> in_seconds(["Time,F", "23:59:59.75,1.5", "00:00:00.25,2.5"], "a.csv")
    ['Time (s),F', '0.000000000,1.5', '0.500000000,2.5']
    """
    found = {number: stamp for number, line in enumerate(lines) if (stamp := _STAMP.match(line))}
    stamps = list(found.values())
    written = sum(bool(line.strip()) for line in lines)
    if len(stamps) < 2 or 2 * len(stamps) < written or len({(bool(s["date"]), s["zone"]) for s in stamps}) > 1:
        return lines
    seconds, before, passed = [], 0.0, 0.0
    for stamp, day in zip(stamps, _days([s["date"] or "" for s in stamps], where), strict=True):
        clock = 3600.0 * int(stamp["hour"]) + 60.0 * int(stamp["minute"]) + float(stamp["second"].replace(",", "."))
        if not stamp["date"] and before - clock > _DAY / 2:
            passed += _DAY
        before = clock
        seconds.append(_DAY * day + passed + clock)
    rest = [stamp.string[stamp.end() :] for stamp in stamps]
    comma = any("," in text for text in rest) and not any(text.lstrip(" ")[:1] == "," or "." in text for text in rest)
    changed = list(lines)
    for (number, stamp), text, time in zip(found.items(), rest, seconds, strict=True):
        cell = f"{time - seconds[0]:.9f}"
        changed[number] = _front(stamp) + (cell.replace(".", ",") if comma else cell) + text
    _retitle(changed, min(found), rest[0].lstrip(" ")[:1], bool(_front(stamps[0])))
    return changed


def _front(stamp: "re.Match[str]") -> str:
    """The delimiter behind a date in a column of its own."""
    return (stamp["between"] or "").strip('" T')


def _days(dates: list[str], where: str) -> list[int]:
    """The number of each date's day; 0 for all where they do not change."""
    if len(set(dates)) == 1:
        return [0] * len(dates)
    parts = [[int(part) for part in re.split(r"[-/.]", text)] for text in dates]
    if all(part[0] > 31 for part in parts):
        order = (0, 1, 2)
    elif "." in dates[0] or any(part[0] > 12 for part in parts):
        order = (2, 1, 0)
    elif any(part[1] > 12 for part in parts):
        order = (2, 0, 1)
    else:
        raise InputError(
            "the dates of the time stamps do not show which number is the day",
            where=where,
            got=", ".join(dict.fromkeys(dates)),
            expected="dates such as 2024-03-01 where they change within a file",
            advice="export with ISO dates or with seconds",
        )
    try:
        return [date(*(part[place] for place in order)).toordinal() for part in parts]
    except ValueError as error:
        raise InputError(
            f"a time stamp with a date that is none: {error}",
            where=where,
            expected="dates such as 2024-03-01",
            advice="export with ISO dates or with seconds",
        ) from error


def _retitle(lines: list[str], first: int, delimiter: str, apart: bool) -> None:
    """Name the column of times in the lines above the row ``first``, and its unit where there is a line of units."""
    if not delimiter:
        return
    above = [number for number in range(max(first - 3, 0), first) if lines[number].strip()]
    for number in reversed(above):
        cells = lines[number].split(delimiter)
        place = 1 if apart else 0
        if len(cells) <= place:
            return
        form = _FORM.fullmatch(cells[place].strip().strip('"'))
        title = re.sub(r"[\[(].*", "", cells[place]).strip(' "')
        cells[place] = "s" if form else f"{title if title.lower() in TITLES['time'] else 'Time'} (s)"
        cells[0] = "" if apart else cells[0]
        lines[number] = delimiter.join(cells)
        if not form:
            return
