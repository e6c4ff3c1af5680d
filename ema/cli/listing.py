"""Lists that people and machines read: file formats, and what the doctor found."""

from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ema.cli.doctor import Check


def formats_as_list(formats: list[Any]) -> list[dict[str, Any]]:
    """One entry per format."""
    return [
        {
            "name": one.name, "title": one.title, "suffixes": list(one.suffixes), "reads": list(one.reads),
            "writes": list(one.writes), "extra": one.extra or None, "available": one.available,
        } for one in formats
    ]  # fmt: skip


def formats_as_table(formats: list[Any]) -> Table:
    """One row per format."""
    table = Table()
    for name in ("format", "suffixes", "reads", "writes", "works here"):
        table.add_column(name)
    for one in formats:
        works = "yes" if one.available else f"needs friction-ema[{one.extra}]"
        # Text, because square brackets are markup elsewhere
        cells = (one.title, " ".join(one.suffixes), ", ".join(one.reads), ", ".join(one.writes), works)
        table.add_row(*(Text(cell) for cell in cells))
    return table


def show_checks(out: Console, checks: list[Check], repair: str) -> None:
    """One line per check, and the one command that mends what does not work."""
    for one in checks:
        mark, style = ("ok", "green") if one.works else ("no", "bold red" if one.needed else "yellow")
        out.print(Text(f"{mark:3}", style=style), Text(f"{one.what}: {one.detail}"), soft_wrap=True)
    out.print(Text(f"To mend it: {repair}" if repair else "Everything works.", style="bold"), soft_wrap=True)
