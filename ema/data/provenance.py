"""Where a result came from."""

from dataclasses import dataclass, field
from datetime import datetime

from ema.data._summary import Container


@dataclass(frozen=True, repr=False)
class Provenance(Container):
    """Inputs with their hashes, versions and options behind a result.

    ``inputs`` holds ``(name, sha256)``; ``versions`` holds ``(package, version)``; ``options`` holds ``(name, value as
    text)`` of every setting used, defaults included; ``steps`` the verbs applied, oldest first.
    """

    inputs: tuple[tuple[str, str], ...] = ()
    versions: tuple[tuple[str, str], ...] = ()
    options: tuple[tuple[str, str], ...] = ()
    steps: tuple[str, ...] = ()
    created: datetime | None = field(default=None, compare=False)
