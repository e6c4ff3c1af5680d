"""What a simulation job leaves: for the store, the screen and the folder of results."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ema.data import Finding


@dataclass
class Job:
    """Contents for the store, pictures, rows of the table, findings; ``more`` are further tables by name, ``statement``
    is what follows."""

    contents: dict[str, Any]
    pictures: dict[str, "Figure"]
    rows: list[dict[str, Any]]
    findings: list["Finding"] = field(default_factory=list)
    more: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    statement: str = ""
