"""What a file held."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from acquisition.units import Unit
from ema.data import Finding, FrfSet, Geometry, ModalModel, Recording


@dataclass(frozen=True)
class Contents:
    """Everything that one file held, in SI where the file states its units.

    Where a file states no unit, the unit of the channel or set is ``"unstated"`` and the numbers are those of the file.

    Parameters
    ----------
    recordings : tuple of Recording, optional
        Time records.
    frfs : tuple of FrfSet, optional
        FRF sets.
    modes : tuple of ModalModel, optional
        Modal models.
    geometry : Geometry, optional
        Points of the structure, where the file has some.
    findings : tuple of Finding, optional
        What a reader of the file has to know.
    metadata : tuple of tuple of (str, str), optional
        ``(name, text)`` of what the file says about itself.
    units : tuple of tuple of (str, Unit), optional
        ``(channel, unit)`` that the numbers of a record had before they became SI, where a unit was stated.
    frf_units : tuple of tuple of (Unit, Unit), optional
        Units of response and force that the numbers of the FRFs had before they became SI, each pair once.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> len(Contents(frfs=(frf_set(),)).frfs)
    1
    """

    recordings: tuple[Recording, ...] = ()
    frfs: tuple[FrfSet, ...] = ()
    modes: tuple[ModalModel, ...] = ()
    geometry: Geometry | None = None
    findings: tuple[Finding, ...] = field(default=(), compare=False)
    metadata: tuple[tuple[str, str], ...] = ()
    units: tuple[tuple[str, Unit], ...] = ()
    frf_units: tuple[tuple[Unit, Unit], ...] = ()

    @classmethod
    def of(cls, containers: Iterable[Any]) -> "Contents":
        """Return what a file of ours held; containers of other kinds are left out, and so are further geometries.

        Parameters
        ----------
        containers : iterable of object
            FRF sets, recordings, modal models, geometries, and others.

        Returns
        -------
        Contents
            Those that foreign files hold as well.

        Examples
        --------
        >>> from ema.examples import frf_set, geometry, modal_map
        >>> held = Contents.of([modal_map(), frf_set(), geometry()])
        >>> len(held.frfs), len(held.modes), held.geometry is None
        (1, 0, False)
        """
        items = list(containers)
        kinds: tuple[type[Any], ...] = (Recording, FrfSet, ModalModel, Geometry)
        recordings, frfs, modes, geometries = ([one for one in items if isinstance(one, kind)] for kind in kinds)
        return cls(tuple(recordings), tuple(frfs), tuple(modes), next(iter(geometries), None))

    def __bool__(self) -> bool:
        return bool(self.recordings or self.frfs or self.modes or self.geometry is not None)
