"""The port that a live rig and a virtual rig both implement."""

from collections.abc import Iterator
from typing import Protocol, runtime_checkable

from ema.data.recording import Channel, Recording


@runtime_checkable
class Source(Protocol):
    """Something that delivers records: hardware, or a model that is "measured"."""

    @property
    def channels(self) -> tuple[Channel, ...]:
        """What each row of a record will be."""
        ...

    @property
    def sampling_rate(self) -> float:
        """Hz."""
        ...

    def takes(self) -> Iterator[Recording]:
        """Records, one after the other, until the source is exhausted or closed."""
        ...

    def close(self) -> None:
        """Give the hardware back."""
        ...
