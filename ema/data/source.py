"""The port that a live rig and a virtual rig both implement."""

from collections.abc import Iterator
from typing import Protocol, runtime_checkable

from ema.data.recording import Channel, Recording


@runtime_checkable
class Source(Protocol):
    """Something that delivers records: hardware, or a model that is "measured".

    Both a live rig and a virtual rig implement it.

    Examples
    --------
    >>> from ema.dof import Dof
    >>> from ema.examples import modal_model
    >>> from ema.simulate import RovingHammer, VirtualRig
    >>> acc = Channel("acc", Dof(1, "+Z"), "acceleration", unit="m/s^2")
    >>> rig = VirtualRig(modal_model(), RovingHammer((Dof(1, "+Z"),), hits=1), (acc,), 1024.0)
    >>> isinstance(rig, Source)
    True
    """

    @property
    def channels(self) -> tuple[Channel, ...]:
        """What each row of a record will be."""
        ...

    @property
    def sampling_rate(self) -> float:
        """Hz."""
        ...

    def takes(self) -> Iterator[Recording]:
        """Deliver records one after the other, until the source is exhausted or closed.

        Yields
        ------
        Recording
            The next record; its rows are those of ``channels``.

        Examples
        --------
        >>> from ema.dof import Dof
        >>> from ema.examples import modal_model
        >>> from ema.simulate import RovingHammer, VirtualRig
        >>> acc = Channel("acc", Dof(1, "+Z"), "acceleration", unit="m/s^2")
        >>> rig = VirtualRig(modal_model(), RovingHammer((Dof(1, "+Z"),), hits=1), (acc,), 1024.0)
        >>> [len(record.channels) for record in rig.takes()]
        [2]
        """
        ...

    def close(self) -> None:
        """Release the hardware.

        Examples
        --------
        >>> from ema.dof import Dof
        >>> from ema.examples import modal_model
        >>> from ema.simulate import RovingHammer, VirtualRig
        >>> acc = Channel("acc", Dof(1, "+Z"), "acceleration", unit="m/s^2")
        >>> rig = VirtualRig(modal_model(), RovingHammer((Dof(1, "+Z"),), hits=1), (acc,), 1024.0)
        >>> rig.close()
        """
        ...
