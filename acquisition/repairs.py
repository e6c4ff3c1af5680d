"""Corrections of what was noted about a measurement; the files stay as they are."""

from collections.abc import Iterable
from dataclasses import replace

from acquisition.assignment import Item, matches
from acquisition.campaign_file import RepairTable
from acquisition.scaling import Line, rescaled
from ema.data import Repair
from ema.dof import Dof
from ema.errors import InputError


class Repairs:
    """The repairs of a campaign; remembers which of them found something to repair."""

    def __init__(self, tables: list[RepairTable], runs: list[str], where: str) -> None:
        self._tables, self._where = tables, where
        self._used: list[set[str]] = [set() for _ in tables]
        self._known: set[str] = set()
        for number, table in enumerate(tables, start=1):
            unknown = sorted(set(table.runs) - set(runs))
            if unknown:
                raise InputError(
                    "a repair of a run that does not exist",
                    where=f"{where}, repair {number}",
                    got=", ".join(unknown),
                    expected="one of " + ", ".join(runs),
                )

    def items(self, run: str, items: tuple[Item, ...]) -> tuple[Item, ...]:
        """The files of a run without the excluded records, and with swapped points set right."""
        self.note_records(item.label for item in items)
        for number, table in self._of(run, "exclude record"):
            kept = tuple(item for item in items if not self._means(table, item))
            if len(kept) < len(items):
                self._used[number].add(run)
            items = kept
        for number, table in self._of(run, "swap points"):
            if table.channel or table.role or not any("point" in item.fields for item in items):
                continue  # the DOFs of the channels themselves are swapped, see ``lines``
            first, second = (str(point) for point in table.points)
            present = {item.fields.get("point") for item in items}
            if {first, second} <= present:
                self._used[number].add(run)
                other = {first: second, second: first}
                items = tuple(
                    replace(item, fields=item.fields | {"point": other[item.fields["point"]]})
                    if item.fields.get("point") in other and self._in_files(table, item)
                    else item
                    for item in items
                )
        return items

    def lines(self, run: str, item: Item, lines: tuple[Line, ...]) -> tuple[Line, ...]:
        """The channels of one file, repaired."""
        for number, table in enumerate(self._tables):
            if table.what in ("exclude hit", "exclude record") or (table.runs and run not in table.runs):
                continue
            if not self._means(table, item, points=table.what != "swap points"):
                continue
            swapped_by_file = table.what == "swap points" and "point" in item.fields
            if swapped_by_file and not (table.channel or table.role):
                continue
            repaired = tuple(
                self._repaired(number, table, run, line) if _meant(table, line) else line for line in lines
            )
            lines = repaired
        return lines

    def excluded_hits(self, run: str, item: Item, record: str) -> tuple[tuple[int, str], ...]:
        """Numbers (from 0) and reasons of the impacts of one record that do not count.

        A repair names the record as the campaign does, or its file, whose records are then all meant.
        """
        excluded: list[tuple[int, str]] = []
        for number, table in self._of(run, "exclude hit"):
            if self._means_record(table, item, record):
                self._used[number].add(run)
                excluded += [(hit, f"excluded by {table.who}: {table.why}") for hit in table.hits]
        return tuple(sorted(excluded))

    def note_records(self, names: Iterable[str]) -> None:
        """Names of files and records of the campaign: a repair that bears one of them means no other."""
        self._known.update(names)

    def _means_record(self, table: RepairTable, item: Item, record: str) -> bool:
        if not table.files or not self._known.issuperset(table.files):
            return self._means(table, item)
        named = record in table.files or item.label in table.files
        return named and self._at_point(table, item)

    def of_run(self, run: str) -> tuple[Repair, ...]:
        """The repairs that changed something in ``run``."""
        return tuple(
            Repair(_words(table), _place(run, table), table.who, table.why)
            for table, used in zip(self._tables, self._used, strict=True)
            if run in used
        )

    def refuse_unused(self) -> None:
        """Every repair has to repair something.

        Raises
        ------
        InputError : one has matched nothing, or not every run that it names.
        """
        for number, (table, used) in enumerate(zip(self._tables, self._used, strict=True), start=1):
            missed = sorted(set(table.runs) - used)
            if not used or missed:
                raise InputError(
                    "a repair matches nothing" + (f" in run {', '.join(missed)}" if missed else ""),
                    where=f"{self._where}, repair {number} ({table.what})",
                    got=_selection(table),
                    advice="correct its files, points, channel or dof, or remove it",
                )

    def _of(self, run: str, what: str) -> list[tuple[int, RepairTable]]:
        return [
            (number, table)
            for number, table in enumerate(self._tables)
            if table.what == what and (not table.runs or run in table.runs)
        ]

    @staticmethod
    def _in_files(table: RepairTable, item: Item) -> bool:
        return not table.files or matches(item.label, table.files)

    def _means(self, table: RepairTable, item: Item, points: bool = True) -> bool:
        return (not points or self._at_point(table, item)) and self._in_files(table, item)

    @staticmethod
    def _at_point(table: RepairTable, item: Item) -> bool:
        return not table.points or item.fields.get("point") in {str(point) for point in table.points}

    def _repaired(self, number: int, table: RepairTable, run: str, line: Line) -> Line:
        where = f"{self._where}, repair {number + 1}, run {run}"
        dof = line.channel.dof
        new = line
        match table.what:
            case "reverse sign":
                new = replace(line, factor=-line.factor, offset=-line.offset)
            case "sensitivity":
                new = rescaled(line, str(table.sensitivity), table.was, where)
            case "unit":
                new = rescaled(line, str(table.unit), table.was, where)
            case "move dof" if dof is not None:
                new = replace(line, channel=replace(line.channel, dof=_moved(dof, table)))
            case "swap points" if dof is not None and dof.node in table.points:
                first, second = table.points
                node = second if dof.node == first else first
                new = replace(line, channel=replace(line.channel, dof=replace(dof, node=node)))
        if new is not line:
            self._used[number].add(run)
        return new


def _meant(table: RepairTable, line: Line) -> bool:
    channel = line.channel
    if table.channel and channel.name != table.channel:
        return False
    if table.role and channel.role != table.role:
        return False
    if table.dof:
        return channel.dof is not None and channel.dof.positive == Dof.parse(table.dof).positive
    return True


def _moved(dof: Dof, table: RepairTable) -> Dof:
    """The new DOF; a DOF held in the sense opposite to the repair's stays opposite to its target."""
    target = Dof.parse(table.to)
    return target if dof.sign == Dof.parse(table.dof).sign else target.reversed()


def _words(table: RepairTable) -> str:
    match table.what:
        case "swap points":
            return f"swap points {table.points[0]} and {table.points[1]}"
        case "sensitivity":
            return f"sensitivity {table.sensitivity}" + (f" instead of {table.was}" if table.was else "")
        case "unit":
            return f"unit {table.unit}" + (f" instead of {table.was}" if table.was else "")
        case "exclude hit":
            return "exclude hit " + ", ".join(str(hit) for hit in table.hits)
        case "move dof":
            return f"move DOF {table.dof} to {table.to}"
    return table.what


def _place(run: str, table: RepairTable) -> str:
    chosen = _selection(table)
    return f"run {run}" + (f", {chosen}" if chosen else "")


def _selection(table: RepairTable) -> str:
    words = []
    if table.files:
        words.append("files " + ", ".join(table.files))
    if table.points and table.what != "swap points":
        words.append("points " + ", ".join(str(point) for point in table.points))
    if table.channel:
        words.append(f"channel {table.channel}")
    if table.role:
        words.append(f"role {table.role}")
    if table.dof and table.what != "move dof":
        words.append(f"DOF {table.dof}")
    return ", ".join(words)
