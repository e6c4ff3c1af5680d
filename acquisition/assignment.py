"""Which files belong to a run, and what their names or a table say about them."""

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from acquisition.campaign_file import CampaignFile, FileTable, RunTable
from acquisition.columns import column, read_columns
from acquisition.datasets import dataset_folder
from acquisition.live.take_files import file_name, from_name
from ema import store
from ema.data import TakeIdentity
from ema.errors import InputError
from ema.file_names import natural

_FIELD = re.compile(r"\{([A-Za-z_]\w*)\}")
_VARIABLE = re.compile(r"\$\{(\w+)\}")
_PROJECT = Path(__file__).resolve().parent.parent


@dataclass(frozen=True)
class Item:
    """One file of a run: ``fields`` fill the ``{...}`` of the channel table, ``dofs`` replace DOFs by channel name."""

    path: Path
    label: str
    fields: dict[str, str] = field(default_factory=dict)
    dofs: dict[str, str] = field(default_factory=dict)

    @property
    def setup(self) -> str:
        """Label of the sensor set-up."""
        return self.fields.get("setup", "")

    def fill(self, text: str, where: str, **more: str) -> str:
        """``text`` with its ``{...}`` replaced.

        Raises
        ------
        InputError : the files of the run do not say what stands in the braces.
        """
        fields = self.fields | more

        def value(found: re.Match[str]) -> str:
            """What stands for a field in braces."""
            if found[1] not in fields:
                raise InputError(
                    f"nothing says what {found[0]} is",
                    where=where,
                    got=repr(text),
                    advice=f"put {found[0]} into the file pattern of the run, or state it in its list of files",
                )
            return fields[found[1]]

        return _FIELD.sub(value, text)


def data_folder(text: str, campaign: Path) -> Path:
    """The folder of the data files: relative to the campaign, ``${...}`` replaced from the environment.

    ``${EMA_DATASETS}`` has the default of ``acquisition.datasets``.

    Raises
    ------
    InputError : an environment variable is not set.
    """

    def value(found: re.Match[str]) -> str:
        """What stands for an environment variable."""
        name = found[1]
        if name in os.environ and name != "EMA_DATASETS":
            return os.environ[name]
        if name != "EMA_DATASETS":
            raise InputError(
                "an environment variable is not set",
                where=str(campaign),
                got=found[0],
                advice=f'set {name} to a folder, or correct files = "..." of [campaign]',
            )
        folder = dataset_folder()
        # a relative default is meant from the checkout, wherever the caller stands
        return str(folder if folder.is_dir() else _PROJECT / folder)

    return (campaign / Path(_VARIABLE.sub(value, text)).expanduser()).resolve()


def items_of(run: RunTable, folder: Path, campaign: Path, where: str) -> tuple[Item, ...]:
    """The files of a run in natural order of their names.

    Raises
    ------
    InputError : a pattern matches no file, a file is named twice, or a table is wrong.
    """
    entries = run.files or list(_from_table(campaign / run.file_table, where))
    items: list[Item] = []
    for entry in entries:
        items.extend(_matching(entry, folder, where))
    paths = [item.path for item in items]
    double = {path.name for path in paths if paths.count(path) > 1} if len(set(paths)) < len(paths) else set()
    if double:
        raise InputError(
            "a file is named twice",
            where=where,
            got=", ".join(sorted(double)),
            expected="each file of a run once",
            advice="remove one of the entries, or narrow a pattern that takes the file as well",
        )
    return tuple(items)


def rest_of(run: RunTable) -> RunTable:
    """The run with the files of its records at rest in place of its own."""
    return run.model_copy(update={"files": [FileTable(file=run.at_rest)], "file_table": ""})


def _from_table(path: Path, where: str) -> Iterator[FileTable]:
    """Rows ``file, point, setup``; every other column is the DOF of the channel that it is named after."""
    table = read_columns(path)
    files = column(table, "file", str(path))
    for row, name in enumerate(files):
        values = {title: texts[row] for title, texts in table.items() if texts[row]}
        point = values.get("point", "")
        if point and not point.isdigit():
            raise InputError(
                "a point is a number",
                where=f"{path}, row {row + 2}",
                got=repr(point),
                expected="digits alone, such as 12, or an empty cell",
            )
        dofs = {title: text for title, text in values.items() if title not in ("file", "point", "setup")}
        yield FileTable(file=name, point=int(point) if point else None, setup=values.get("setup", ""), dofs=dofs)


def _matching(entry: FileTable, folder: Path, where: str) -> Iterator[Item]:
    stated = {"setup": entry.setup} if entry.setup else {}
    if entry.point is not None:
        stated["point"] = str(entry.point)
    if not any(mark in entry.file for mark in "{*?"):
        path = folder / entry.file
        if path.is_dir():
            raise InputError(
                "a folder where a file is expected",
                where=where,
                got=entry.file,
                advice='name the files inside it, by a pattern such as "folder/*.uff"',
            )
        if not path.is_file():
            raise InputError(
                "there is no such file",
                where=where,
                got=str(path),
                advice="correct its name, or the folder of the data files in [campaign]",
            )
        yield Item(path, entry.file, stated, entry.dofs)
        return
    pattern, names = _pattern(entry.file)
    fitting = [path for path in _below(folder) if pattern.fullmatch(path.relative_to(folder).as_posix())]
    files = [path for path in fitting if path.is_file()]
    # a pattern without a suffix, such as "*", may well match folders
    if len(files) < len(fitting) and "." in entry.file.rpartition("/")[2]:
        other = next(path for path in fitting if not path.is_file())
        raise InputError(
            "a folder where a file is expected" if other.is_dir() else "a link to a file that is not there",
            where=where,
            got=str(other),
            advice=f"remove it, or narrow the pattern {entry.file}",
        )
    if not files:
        near = [path.relative_to(folder).as_posix() for path in _below(folder) if path.is_file()][:5]
        raise InputError(
            "no file matches the pattern",
            where=where,
            got=entry.file,
            expected=f"files in {folder}",
            advice="there are " + ", ".join(near) if near else "the folder is empty",
        )
    for path in sorted(files, key=lambda path: natural(path.relative_to(folder).as_posix())):
        label = path.relative_to(folder).as_posix()
        values = pattern.fullmatch(label)
        assert values is not None
        fields = {name: _plain(values[name]) for name in names}
        if _misread(path, fields):
            continue
        yield Item(path, label, fields | stated, entry.dofs)


def _misread(path: Path, fields: dict[str, str]) -> bool:
    """Whether a pattern takes the name of a recorded take apart wrongly, as ``beam_{point}_{take}.h5`` does with a take
    of run ``beam_1``: the file itself says which take it is, and its name is the one that it was given."""
    named = from_name(path.name)
    if named is None or all(fields.get(name, value) == value for name, value in _fields_of(named).items()):
        return False
    if not store.is_store(path):
        return False
    headers = store.describe(path)
    identity = headers[0].record.identity if len(headers) == 1 and headers[0].record is not None else None
    return identity is not None and file_name(identity) == file_name(named)


def _fields_of(identity: TakeIdentity) -> dict[str, str]:
    return {"point": str(identity.point), "take": str(identity.number)}


def _pattern(text: str) -> tuple[re.Pattern[str], list[str]]:
    """``{point}`` stands for digits, any other ``{name}`` and ``*`` for text within one file or folder name."""
    names: list[str] = []
    expression = ""
    for part in re.split(r"(\{[A-Za-z_]\w*\}|\*|\?)", text):
        if part == "*":
            expression += "[^/]*"
        elif part == "?":
            expression += "[^/]"
        elif field := _FIELD.fullmatch(part):
            if field[1] in names:
                expression += f"(?P={field[1]})"
            else:
                names.append(field[1])
                expression += f"(?P<{field[1]}>{'[0-9]+' if field[1] == 'point' else '[^/]+?'})"
        else:
            expression += re.escape(part)
    return re.compile(expression), names


def _below(folder: Path) -> list[Path]:
    """Everything in a folder and below it, hidden files and folders left out."""
    below = sorted(folder.rglob("*"))
    hidden = [any(part.startswith(".") for part in path.relative_to(folder).parts) for path in below]
    return [path for path, out in zip(below, hidden, strict=True) if not out]


def _plain(text: str) -> str:
    return str(int(text)) if text.isdigit() else text


def matches(label: str, patterns: list[str]) -> bool:
    """Whether a file of a run is meant by one of the ``patterns`` of a repair (its name is enough)."""
    return any(
        _pattern(pattern)[0].fullmatch(name) is not None for pattern in patterns for name in (label, Path(label).name)
    )


def data_files(campaign: CampaignFile, folder: Path) -> dict[str, tuple[Path, ...]]:
    r"""Return the data files of every run, each once, in the order in which they are read.

    Parameters
    ----------
    campaign : CampaignFile
        What ``campaign.toml`` says.
    folder : Path
        Folder of the ``campaign.toml``.

    Returns
    -------
    dict of str to tuple of Path
        Id of each run with its files.

    Raises
    ------
    InputError
        If a run names no file that exists.

    Examples
    --------
    >>> import tempfile
    >>> from acquisition import campaign_file
    >>> text = '[campaign]\nname = "A"\n[[runs]]\nid = "bare"\nfiles = "bare.uff"\n'
    >>> with tempfile.TemporaryDirectory() as name:
    ...     folder = Path(name)
    ...     _ = (folder / "bare.uff").write_text("")
    ...     _ = (folder / "campaign.toml").write_text(text)
    ...     [path.name for path in data_files(campaign_file.load(folder / "campaign.toml"), folder)["bare"]]
    ['bare.uff']
    """
    data = data_folder(campaign.campaign.files, folder)
    return {run.id: _paths(run, data, folder) for run in campaign.runs}


def _paths(run: RunTable, data: Path, folder: Path) -> tuple[Path, ...]:
    """Files of the records or FRFs of a run, and of its records at rest."""
    items = items_of(run, data, folder, f"run {run.id}")
    if run.at_rest:
        items += items_of(rest_of(run), data, folder, f"run {run.id}, at_rest")
    return tuple(dict.fromkeys(item.path for item in items))
