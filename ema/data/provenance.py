"""Where a result came from."""

from dataclasses import dataclass, field
from datetime import datetime

from ema.data._summary import Container


@dataclass(frozen=True, repr=False)
class Provenance(Container):
    """Inputs with their hashes, versions and options behind a result.

    Parameters
    ----------
    inputs : tuple of tuple of (str, str), optional
        ``(name, sha256)`` of what was read.
    versions : tuple of tuple of (str, str), optional
        ``(package, version)``.
    options : tuple of tuple of (str, str), optional
        ``(name, value as text)`` of every setting used, defaults included.
    steps : tuple of str, optional
        Functions applied, oldest first.
    created : datetime, optional
        When the result was made.

    Examples
    --------
    >>> Provenance(steps=("fit.modes",))
    Provenance(steps=('fit.modes',))
    """

    inputs: tuple[tuple[str, str], ...] = ()
    versions: tuple[tuple[str, str], ...] = ()
    options: tuple[tuple[str, str], ...] = ()
    steps: tuple[str, ...] = ()
    created: datetime | None = field(default=None, compare=False)
