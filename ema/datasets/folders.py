"""Where the demonstrations are kept: their files in the package, their copies in a folder of the user."""

import os
import shutil
import sys
from pathlib import Path

from ema.datasets import builtin
from ema.errors import FailureError, InputError
from ema.progress import Progress, silent

CACHE_VARIABLE = "EMA_CACHE"
"""Environment variable that names another folder than the user's cache folder."""

_PACKAGED = Path(__file__).resolve().parent / "files"
"""Campaign files and recipes of an installed package."""
_CHECKOUT = Path(__file__).resolve().parents[2]
"""Where the same files are in a checkout."""


def names() -> tuple[str, ...]:
    """Names of the built-in campaigns, in alphabetical order.

    Returns
    -------
    tuple of str
        Names that :func:`fetch` takes.

    Examples
    --------
    >>> "virtual_table_hammer" in names()
    True
    """
    return tuple(sorted(builtin.GENERATORS))


def recipes() -> tuple[str, ...]:
    """Names of the recipes of the built-in campaigns, in alphabetical order.

    Returns
    -------
    tuple of str
        Names that :func:`fetch_recipe` takes.

    Examples
    --------
    >>> "table_placement" in recipes()
    True
    """
    return tuple(path.stem for path in sorted((_source() / "reports").glob("*.toml")) if _campaign_of(path) in names())


def recipe_file(name: str) -> Path:
    """Return the recipe of a demonstration as it was delivered, to be read and not to be run.

    Parameters
    ----------
    name : str
        One of :func:`recipes`.

    Returns
    -------
    Path
        File in the package.

    Raises
    ------
    InputError
        If there is no recipe of that name.

    Examples
    --------
    >>> recipe_file(recipes()[0]).suffix
    '.toml'
    """
    if name not in recipes():
        raise InputError("no such demonstration", got=name, expected="one of " + ", ".join(recipes()))
    return _source() / "reports" / f"{name}.toml"


def cache_folder() -> Path:
    """Return the folder in which demonstrations are kept unless another one is named; it need not exist.

    It is the folder in the environment variable ``EMA_CACHE``, or ``friction-ema`` in the cache folder of the user. It
    has a part for each version of the program, so that a new version never meets the files of an old one.

    Returns
    -------
    Path
        The folder, absolute.

    Examples
    --------
    >>> cache_folder().is_absolute()
    True
    """
    from ema import __version__

    return _user_cache().expanduser().resolve() / f"demonstrations-{__version__}"


def fetch(name: str, folder: str | Path | None = None, progress: Progress = silent) -> Path:
    """Return the folder of a built-in campaign with its signals, written there when they are missing.

    Parameters
    ----------
    name : str
        One of :func:`names`.
    folder : str or Path, optional
        Where the demonstrations are kept: ``datasets/NAME`` appears in it. By default :func:`cache_folder`. Files that
        are there already stay as they are.
    progress : Progress, optional
        Called with how far the signals are.

    Returns
    -------
    Path
        Folder with ``campaign.toml`` and the signals; :func:`acquisition.open_campaign` opens it.

    Raises
    ------
    InputError
        If there is no campaign of that name.
    FailureError
        If the folder cannot be written.

    Examples
    --------
    >>> import acquisition
    >>> campaign = acquisition.open_campaign(fetch("virtual_table_hammer"))  # doctest: +SKIP
    """
    if name not in builtin.GENERATORS:
        raise InputError("no such built-in campaign", got=name, expected="one of " + ", ".join(names()))
    target = _home(folder) / "datasets" / name
    _copied(_source() / "datasets" / name, target)
    builtin.ensure(target, name, progress)
    return target


def fetch_recipe(name: str, folder: str | Path | None = None) -> Path:
    """Return a recipe with its campaign beside it; the signals are written when the recipe is run.

    Parameters
    ----------
    name : str
        One of :func:`recipes`.
    folder : str or Path, optional
        Where the demonstrations are kept: ``reports/NAME.toml`` and the campaign in ``datasets`` appear in it. By
        default :func:`cache_folder`. Files that are there already stay as they are.

    Returns
    -------
    Path
        The recipe; :class:`ema.Study` loads it.

    Raises
    ------
    InputError
        If there is no recipe of that name.
    FailureError
        If the folder cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     fetch_recipe(recipes()[0], folder).parent.name
    'reports'
    """
    source, home = recipe_file(name), _home(folder)
    campaign = _campaign_of(source)
    _copied(_source() / "datasets" / campaign, home / "datasets" / campaign)
    target = home / "reports" / source.name
    _copy(source, target)
    return target


def _home(folder: str | Path | None) -> Path:
    return cache_folder() if folder is None else Path(folder).expanduser().resolve()


def _user_cache() -> Path:
    """The folder of the user for what can be made again, as each operating system has it."""
    if stated := os.environ.get(CACHE_VARIABLE):
        return Path(stated)
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or "~/AppData/Local"
    elif sys.platform == "darwin":
        base = "~/Library/Caches"
    else:
        base = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(base) / "friction-ema"


def _source() -> Path:
    return _PACKAGED if _PACKAGED.is_dir() else _CHECKOUT


def _campaign_of(recipe: Path) -> str:
    """Name of the campaign that a recipe is about."""
    import tomllib

    return Path(tomllib.loads(recipe.read_text(encoding="utf-8"))["campaign"]).name


def _copied(source: Path, target: Path) -> None:
    """Copy the files beside the signals that are not there yet."""
    for path in sorted(source.iterdir()):
        if path.is_file():
            _copy(path, target / path.name)


def _copy(source: Path, target: Path) -> None:
    if target.is_file():
        return
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, target)
    except OSError as error:
        raise FailureError(
            "the demonstration cannot be written",
            where=str(target),
            got=error.strerror or str(error),
            advice=f"name another folder, or set {CACHE_VARIABLE} to one that can be written",
        ) from error
