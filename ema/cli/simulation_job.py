"""What a simulation job leaves: for the store, the screen and the folder of results."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ema.data import Finding


@dataclass
class Job:
    """What a job found: contents for the store, pictures, rows of the table, findings."""

    contents: dict[str, Any]
    pictures: dict[str, "Figure"]
    rows: list[dict[str, Any]]
    findings: list["Finding"] = field(default_factory=list)
