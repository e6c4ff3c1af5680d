"""The one error family: every message says what, where, got, expected, and the next step."""

from typing import Any


class EmaError(Exception):
    """Something that the caller can act on, stated in one sentence.

    The message reads ``where: what; got ..., expected ...; advice``. ``exit_code`` is the status with which the command
    line ends.

    Parameters
    ----------
    what : str
        The fact, such as ``"the force channel never triggers"``.
    where : str, optional
        File, run, channel or FRF concerned, such as ``"run beam_1kN, point 12"``.
    got : object, optional
        The offending value.
    expected : object, optional
        What was wanted instead.
    advice : str, optional
        The next step, such as ``"lower trigger_level or check the sensor"``.

    Examples
    --------
    >>> print(EmaError("no such run", where="campaign beam", got="bare2", expected="one of bare, beam"))
    campaign beam: no such run; got bare2, expected one of bare, beam
    """

    exit_code = 2

    def __init__(self, what: str, *, where: str = "", got: Any = None, expected: Any = None, advice: str = "") -> None:
        self.what, self.where, self.got, self.expected, self.advice = what, where, got, expected, advice
        text = f"{where}: {what}" if where else what
        if got is not None:
            text += f"; got {got}"
        if expected is not None:
            text += f", expected {expected}" if got is not None else f"; expected {expected}"
        if advice:
            text += f"; {advice}"
        super().__init__(text)


class InputError(EmaError):
    """Wrong use or bad input (exit status 2)."""


class UnitError(InputError):
    """A unit is missing, unknown, or of the wrong quantity."""


class MissingExtraError(InputError):
    """An optional package is needed; the message names the extra that brings it."""


class FailureError(EmaError):
    """Disk full, a file that cannot be written, a fault of ours (exit status 3)."""

    exit_code = 3


class CancelledError(EmaError):
    """The caller asked for the work to stop; what was finished is kept (exit status 130)."""

    exit_code = 130


def require(module: str, extra: str) -> Any:
    """Import an optional package, or say which extra installs it.

    Parameters
    ----------
    module : str
        Name of the package.
    extra : str
        Extra of this distribution that brings it.

    Returns
    -------
    module
        The imported package.

    Raises
    ------
    MissingExtraError
        If the package is not installed.

    Examples
    --------
    >>> require("json", "formats").__name__
    'json'
    """
    from importlib import import_module

    try:
        return import_module(module)
    except ImportError as error:
        raise MissingExtraError(
            f"the optional package '{module}' is not installed",
            advice=f"install it with: pip install 'friction-ema[{extra}]'",
        ) from error
