"""One kind of our TOML files: where it is looked for, which tables it has, and how it is read."""

from dataclasses import dataclass
from pathlib import Path
from typing import Generic

from ema.tables.former import NONE, FormerNames
from ema.tables.schema import T, Tables, validated
from ema.tables.texts import read_text


@dataclass(frozen=True, kw_only=True)
class FileKind(Generic[T]):
    """A kind of TOML file.

    Parameters
    ----------
    table : type
        Class of the whole file.
    tables : mapping of str to type
        Its tables by their dotted names: the keys that may be offered instead of an unknown one.
    name : str
        Name of the file in a folder.
    absent : str
        What is said where there is no such file.
    guide : str
        The page that shows how to write one.
    former : FormerNames, optional
        What its keys and choices were called before.

    Examples
    --------
    >>> import tempfile
    >>> from ema.tables import Table
    >>> class Rig(Table):
    ...     rate: float
    >>> rigs = FileKind(table=Rig, tables={"": Rig}, name="rig.toml", absent="no rig here", guide="docs/record.md")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(folder, "rig.toml").write_text("rate = 1024")
    ...     rigs.load(folder).rate
    1024.0
    """

    table: type[T]
    tables: Tables
    name: str
    absent: str
    guide: str
    former: FormerNames = NONE

    def locate(self, path: str | Path) -> Path:
        """Return the file, named itself or by its folder.

        Parameters
        ----------
        path : str or Path
            File or folder.

        Returns
        -------
        Path
            The file.

        Examples
        --------
        >>> from ema.tables import Table
        >>> FileKind(table=Table, tables={}, name="a.toml", absent="", guide="").locate("b.toml").name
        'b.toml'
        """
        path = Path(path)
        return path / self.name if path.is_dir() else path

    def text(self, path: str | Path) -> str:
        """Return the text of the file.

        Parameters
        ----------
        path : str or Path
            The file, or its folder.

        Returns
        -------
        str
            The text.

        Raises
        ------
        InputError
            If there is no such file, it may not be read, or it is no UTF-8 text.

        Examples
        --------
        >>> from ema.tables import Table
        >>> FileKind(table=Table, tables={}, name="a.toml", absent="no rig here", guide="docs/a.md").text("none.toml")
        Traceback (most recent call last):
        ...
        ema.errors.InputError: none.toml: no rig here; expected a file such as a.toml; write one as docs/a.md shows, ...
        """
        found = self.locate(path)
        return read_text(
            found,
            self.absent,
            expected=f"a file {'' if found.name == self.name else 'such as '}{self.name}",
            advice=f"write one as {self.guide} shows, or correct the path",
        )

    def parse(self, text: str, where: str = "") -> T:
        """Return the table of a text.

        Parameters
        ----------
        text : str
            Text of the file.
        where : str, optional
            The file, for messages.

        Returns
        -------
        Table
            The table of the whole file.

        Raises
        ------
        InputError
            If the text is no TOML, or a key is unknown, missing or wrong; with its line.

        Examples
        --------
        >>> from ema.tables import Table
        >>> class Rig(Table):
        ...     rate: float
        >>> FileKind(table=Rig, tables={"": Rig}, name="rig.toml", absent="", guide="").parse("rate = 1").rate
        1.0
        """
        return validated(self.table, text, where or self.name, self.tables, former=self.former)

    def load(self, path: str | Path) -> T:
        """Return the table of a file.

        Parameters
        ----------
        path : str or Path
            The file, or its folder.

        Returns
        -------
        Table
            The table of the whole file; what bears a former name in it is in ``former_names``.

        Raises
        ------
        InputError
            As of ``text`` and ``parse``.

        Examples
        --------
        >>> from ema.tables import Table
        >>> FileKind(table=Table, tables={}, name="a.toml", absent="no rig here", guide="docs/a.md").load("none.toml")
        Traceback (most recent call last):
        ...
        ema.errors.InputError: none.toml: no rig here; expected a file such as a.toml; write one as docs/a.md shows, ...
        """
        path = self.locate(path)
        return self.parse(self.text(path), str(path))
