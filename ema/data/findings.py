"""A problem in a measurement is data, and reaches the report."""

from dataclasses import dataclass
from typing import Literal

from ema.data._summary import Container

Severity = Literal["info", "warning", "error"]


@dataclass(frozen=True, repr=False, slots=True)
class Finding(Container):
    """One thing a reader of the results has to know.

    Parameters
    ----------
    severity : ``info`` (good to know), ``warning`` (look at it), ``error`` (do not use without a repair).
    code : short stable name, e.g. ``"double-hit"``, ``"low-coherence"``; one word for each kind of finding.
    where : what it concerns, e.g. ``"run beam_1kN, point 12:+Z, hit 3"``.
    message : one sentence that states the fact with its numbers.
    value, limit : the number found and the number it was held against, SI; ``None`` where there is none.
    advice : one sentence a test engineer can act on.
    """

    severity: Severity
    code: str
    where: str
    message: str
    value: float | None = None
    limit: float | None = None
    advice: str = ""

    def __str__(self) -> str:
        return f"{self.where}: {self.message}" + (f" {self.advice}" if self.advice else "")
