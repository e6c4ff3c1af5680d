"""A problem in a measurement is data, and reaches the report."""

from dataclasses import dataclass
from typing import Literal

from ema.data._summary import Container

Severity = Literal["info", "warning", "error"]


@dataclass(frozen=True, repr=False, slots=True)
class Finding(Container):
    """One thing that a reader of the results has to know.

    Parameters
    ----------
    severity : {"info", "warning", "error"}
        ``info`` (good to know), ``warning`` (look at it), ``error`` (do not use without a repair).
    code : str
        Short stable name, such as ``"double-hit"`` or ``"low-coherence"``; one for each kind of finding.
    where : str
        What it concerns, such as ``"run beam_1kN, point 12:+Z, hit 3"``.
    message : str
        One sentence that states the fact with its numbers.
    value : float, optional
        The measured number, SI; ``None`` where there is none.
    limit : float, optional
        The number that it was compared with, SI; ``None`` where there is none.
    advice : str, optional
        One sentence that a test engineer can act on.

    Examples
    --------
    >>> print(Finding("warning", "low-coherence", "run bare", "Coherence 0.41 at 499 Hz.", value=0.41, limit=0.8))
    run bare: Coherence 0.41 at 499 Hz.
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
