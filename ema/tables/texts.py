"""The text of a TOML file, or one sentence that says why there is none."""

from pathlib import Path

from ema.errors import InputError


def read_text(path: Path, absent: str, *, expected: str, advice: str = "") -> str:
    r"""Return the text of a TOML file.

    Parameters
    ----------
    path : Path
        The file.
    absent : str
        What is said where there is no such file.
    expected : str
        What was expected instead.
    advice : str, optional
        The next step where there is no such file.

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
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "rig.toml")
    ...     _ = path.write_text("rate = 1024\n")
    ...     read_text(path, "there is no rig here", expected="a rig.toml")
    'rate = 1024\n'
    """
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError(absent, where=str(path), expected=expected, advice=advice) from None
    except UnicodeDecodeError as error:
        raise InputError(f"cannot be read as text ({error})", where=str(path), expected="UTF-8 text") from error
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", where=str(path), expected=expected) from error
