"""A placement recipe that may ask for several beams."""

from pathlib import Path

from pydantic import BaseModel, Field

from acquisition.quantities import Mass
from ema.place.recipe import KIND, PlaceRecipe, SearchTable
from ema.tables import FileKind


class BeamsSearchTable(SearchTable):
    """``[search]`` with the number of ``beams`` that act together, and the mass of all of them at most.

    Several beams go one after the other, and are then exchanged (``ema.place.search_together``).
    """

    beams: int = Field(default=1, ge=1)
    most_mass: Mass | None = None


class BeamsRecipe(PlaceRecipe):
    """A placement recipe whose ``[search]`` may ask for several beams."""

    search: BeamsSearchTable = BeamsSearchTable()


_TABLES: dict[str, type[BaseModel]] = {**KIND.tables, "": BeamsRecipe, "search": BeamsSearchTable}
_KIND = FileKind(
    table=BeamsRecipe, tables=_TABLES, name=KIND.name, absent=KIND.absent, guide=KIND.guide, former=KIND.former
)


def load(path: Path) -> BeamsRecipe:
    """Read a placement recipe.

    Parameters
    ----------
    path : Path
        The TOML file; paths in it are relative to its folder.

    Returns
    -------
    BeamsRecipe
        Content of the file, checked.

    Raises
    ------
    InputError
        There is no such file, it is no TOML, or a key is unknown, missing or wrong; the message names its line.
    """
    return _KIND.load(path)
