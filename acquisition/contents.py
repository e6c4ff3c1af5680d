"""What a file held."""

from dataclasses import dataclass, field

from ema.data import Finding, FrfSet, Geometry, ModalModel, Recording


@dataclass(frozen=True)
class Contents:
    """Everything that one file held, in SI where the file states its units.

    Where a file states no unit, the channel's or set's unit is ``"unstated"`` and the numbers are those of the file.
    ``metadata`` holds ``(name, text)`` of what the file says about itself; ``findings`` what a reader has to know.
    """

    recordings: tuple[Recording, ...] = ()
    frfs: tuple[FrfSet, ...] = ()
    modes: tuple[ModalModel, ...] = ()
    geometry: Geometry | None = None
    findings: tuple[Finding, ...] = field(default=(), compare=False)
    metadata: tuple[tuple[str, str], ...] = ()

    def __bool__(self) -> bool:
        return bool(self.recordings or self.frfs or self.modes or self.geometry is not None)
