"""What the names of measurement files say: points, directions, pairs of DOFs, takes, and which belong together."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from ema.dof import Dof
from ema.file_names import natural

_DIRECTION = r"R?[XYZxyz][+-]|[+-]?R?[XYZxyz](?![A-Za-z])"
_NUMBER = re.compile(
    rf"(?<![\d.])(?P<number>\d+)(?![\d.]*\d)(?P<direction>_?(?:{_DIRECTION}))?(?P<unit>\s?[A-Za-z]*)(?![A-Za-z])"
)
"""A whole number, with a direction or letters behind it; numbers with a decimal point are levels, not points."""

NODE_WORDS = (
    *("point", "pt", "p", "node", "pos", "position"),
    *("punkt", "messpunkt", "mp", "messstelle", "stelle", "knoten"),
)
"""Words, English and German, behind which a number is that of a point wherever they stand."""
POINT_WORDS = (*NODE_WORDS, "n", "dof", "meas", "hxy", "frf", "h")
"""Words behind which a number in the name of a file is that of a point."""
TAKE_WORDS = ("take", "hit", "blow", "impact", "rep", "repeat", "avg", "record", "rec")
CONDITION_WORDS = ("fe", "fn", "level", "force", "torque", "mode", "set", "setup", "case", "speed", "temp", "mass")
"""Words behind which a number says under which condition was measured: such files are runs of their own."""


@dataclass(frozen=True)
class FileName:
    """One name taken apart.

    ``series`` is the name with ``#`` in place of the numbers that may count something; ``numbers`` are these, with the
    letters before each in ``words`` and the directions behind them in ``directions`` (``"+Z"``, empty without one).
    ``conditions`` are the numbers that say under which condition was measured, as they stand there (``1kN``, ``0.5``).
    """

    path: str
    series: str
    numbers: tuple[int, ...] = ()
    words: tuple[str, ...] = ()
    directions: tuple[str, ...] = ()
    conditions: tuple[str, ...] = ()
    spans: tuple[tuple[int, int], ...] = field(default=(), repr=False)
    """Where the numbers stand in ``path``, directions left out."""


def taken_apart(path: str) -> FileName:
    """Return what the name of one file says.

    Numbers with a unit behind them (``1kN``, ``5Nm``, ``36lb``) or a decimal point are conditions: they stay in the
    series, so that files measured under other conditions are another series.

    Parameters
    ----------
    path : str
        Path below the folder of the campaign, with ``/``.

    Returns
    -------
    FileName

    Examples
    --------
    >>> name = taken_apart("beam_1kN_42.uff")
    >>> name.series, name.numbers
    ('beam_1kN_#.uff', (42,))
    >>> taken_apart("P12Z+.uff").directions
    ('+Z',)
    """
    start = path.rfind("/") + 1
    # in "0.5amplitude.json.gz" the first point belongs to a number
    known = re.search(r"(?<!\d)(\.[A-Za-z][A-Za-z0-9]*)+$|(\.[A-Za-z][A-Za-z0-9]*)+$", path[start:])
    end = len(path) - (len(known[0]) if known else 0)
    pieces, last = [], 0
    numbers: list[int] = []
    words: list[str] = []
    directions: list[str] = []
    spans: list[tuple[int, int]] = []
    conditions = re.findall(r"\d+\.\d+\s?[A-Za-z]*", path[start:end])
    for found in _NUMBER.finditer(path, start, end):
        letters = re.search(r"([A-Za-z]+)[^A-Za-z0-9]*$", path[start : found.start("number")])
        if found["unit"].strip() or (letters and letters[1].lower() in CONDITION_WORDS):
            conditions.append(path[found.start("number") : found.end()])
            continue
        numbers.append(int(found["number"]))
        words.append(letters[1].lower() if letters else "")
        directions.append(plain_direction(found["direction"] or ""))
        spans.append(found.span("number"))
        pieces += [path[last : found.start("number")], "#"]
        last = found.end("direction") if found["direction"] else found.end("number")
    pieces.append(path[last:])
    return FileName(
        path, "".join(pieces), tuple(numbers), tuple(words), tuple(directions), tuple(conditions), tuple(spans)
    )


def plain_direction(text: str) -> str:
    """Return ``z``, ``_x``, ``Z+`` and ``+Z`` as a direction of a DOF; empty for an empty text."""
    text = text.strip("_").upper()
    sign = "-" if "-" in text else "+"
    axis = text.strip("+-")
    return sign + axis if axis else ""


@dataclass(frozen=True)
class Series:
    """Files whose names differ in numbers and directions only, in natural order.

    ``counts`` says what each number counts: ``"point"``, ``"take"``, ``"input"`` (of a pair of DOFs), or ``""`` where
    it is the same in all names or nobody knows.
    """

    names: tuple[FileName, ...]
    counts: tuple[str, ...]

    @property
    def varies(self) -> tuple[bool, ...]:
        """Whether each number differs between the names."""
        return tuple(len({name.numbers[place] for name in self.names}) > 1 for place in range(len(self.counts)))

    @property
    def open(self) -> bool:
        """Whether some number varies of which nobody knows what it counts."""
        return any(varies and not counts for varies, counts in zip(self.varies, self.counts, strict=True))

    @property
    def directed(self) -> bool:
        """Whether the names state directions."""
        return any(any(name.directions) for name in self.names)

    def dofs(self, name: FileName) -> dict[str, Dof]:
        """DOFs that a name states, by what its numbers count (``point``, ``input``)."""
        return {
            counts: Dof(number, direction) if direction else Dof(number)
            for number, direction, counts in zip(name.numbers, name.directions, self.counts, strict=True)
            if counts in ("point", "input")
        }

    @property
    def pattern(self) -> str:
        """The pattern for ``campaign.toml``: ``{point}`` and ``{take}`` for the numbers that vary."""
        first, text, last = self.names[0], "", 0
        for place, (begin, end) in enumerate(first.spans):
            field_name = self.counts[place] or ("take" if self.varies[place] else "")
            if not self.varies[place] and self.counts[place] != "point":
                continue
            text += first.path[last:begin] + "{" + field_name + "}"
            last = end
        return text + first.path[last:]


def series_of(paths: Sequence[str]) -> tuple[Series, ...]:
    """Return the series that some files form, each with what its numbers seem to count.

    Where one number varies, the word before it says whether it counts points (``pt01``, ``point_3``, ``H12``) or takes
    (``hit2``); a number with a direction behind it is a point; two numbers with directions are a pair, response first
    (``FRF_12Z_5Z``). Of two numbers without words, the one with fewer values counts takes.

    Parameters
    ----------
    paths : sequence of str
        Paths below the folder of the campaign.

    Returns
    -------
    tuple of Series
        In natural order of the names.

    Examples
    --------
    >>> [one.pattern for one in series_of(["p1_hit1.h5", "p1_hit2.h5", "p2_hit1.h5", "setup.csv"])]
    ['p{point}_hit{take}.h5', 'setup.csv']
    """
    groups: dict[tuple[str, int], list[FileName]] = {}
    for path in sorted(paths, key=natural):
        name = taken_apart(path)
        groups.setdefault((name.series, len(name.numbers)), []).append(name)
    return tuple(Series(tuple(names), _counts(names)) for names in groups.values())


def _counts(names: Sequence[FileName]) -> tuple[str, ...]:
    first = names[0]
    places = range(len(first.numbers))
    values = {place: {name.numbers[place] for name in names} for place in places}
    counts = dict.fromkeys(places, "")
    directed = [place for place in places if all(name.directions[place] for name in names)]
    if len(directed) >= 2:
        counts[directed[-2]], counts[directed[-1]] = "point", "input"
    elif directed:
        counts[directed[0]] = "point"
    for place in places:
        if counts[place] or len(values[place]) < 2:
            continue
        word = first.words[place]
        if word in TAKE_WORDS:
            counts[place] = "take"
        elif word.startswith(("point", "pt", "hxy")) or word in POINT_WORDS:
            counts[place] = "point" if "point" not in counts.values() else "take"
    unknown = [place for place in places if not counts[place] and len(values[place]) > 1]
    if len(unknown) == 2 and not any(counts.values()):
        more, fewer = sorted(unknown, key=lambda place: -len(values[place]))
        counts[more], counts[fewer] = "point", "take"
    elif len(unknown) == 1 and "point" in counts.values():
        counts[unknown[0]] = "take"
    return tuple(counts[place] for place in places)
