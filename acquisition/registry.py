"""Which file formats there are, and which one a file is in."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from importlib.util import find_spec
from os import PathLike
from pathlib import Path
from typing import Any

from acquisition.contents import Contents
from acquisition.files import sniff
from acquisition.files.layout import Layout
from acquisition.files.printed_axis import restored
from acquisition.files.sanity import examine
from ema.data import Finding
from ema.errors import EmaError, FailureError, InputError, MissingExtraError


@dataclass(frozen=True)
class Format:
    """A file format.

    ``reads`` and ``writes`` name what it carries. ``extra`` is the optional dependency group it needs, ``packages`` the
    packages of that group; ``sniff`` recognises the format by the first bytes of a file.

    ``module`` is where ``read(path, layout)`` stands, and ``write(path, containers)`` of a format that is written. All
    readers have this signature: ``path`` is a file that is there and was recognised, ``layout`` says what the file does
    not (`Layout`), and its ``salvage`` whether a damaged file gives what it still holds. What comes back is `Contents`,
    in SI where units are stated, with findings for everything that was not taken as it stands; a file that cannot be
    used raises `InputError`, a package that is not installed `MissingExtraError`.
    """

    name: str
    title: str
    suffixes: tuple[str, ...]
    module: str
    sniff: Callable[[bytes], bool]
    reads: tuple[str, ...]
    writes: tuple[str, ...] = ()
    extra: str = ""
    packages: tuple[str, ...] = ()

    @property
    def available(self) -> bool:
        """Whether the packages it needs are installed."""
        return all(_installed(package) for package in self.packages)


_TIME = ("recordings",)
_ANY = ("recordings", "frfs", "geometry", "modes")
_FORMATS = (
    Format(
        "uff",
        "Universal file (15, 18, 55, 58, 58b, 82, 151, 164, 2411, 2412, 2414, 2420)",
        (".uff", ".unv", ".uf", ".uf58", ".bunv", ".asc"),
        "acquisition.files.uff",
        sniff.uff,
        _ANY,
        _ANY,
    ),
    Format("hdf5", "HDF5", (".h5", ".hdf5", ".hdf"), "acquisition.files.hdf5", sniff.hdf5, _ANY),
    Format("matlab", "MATLAB v5 to v7.3", (".mat",), "acquisition.files.matlab", sniff.matlab, _ANY),
    Format("npy", "NumPy arrays (npy, npz)", (".npy", ".npz"), "acquisition.files.npy", sniff.npy, _ANY),
    Format("tdms", "LabVIEW TDMS", (".tdms",), "acquisition.files.tdms", sniff.tdms, _TIME, (), "formats", ("nptdms",)),
    Format(
        "mdf4",
        "ASAM MDF 3 and 4",
        (".mf4", ".mdf", ".dat"),
        "acquisition.files.mdf4",
        sniff.mdf4,
        _TIME,
        (),
        "formats",
        ("asammdf",),
    ),
    Format(
        "wav",
        "Wave audio (WAV, RF64, W64, FLAC)",
        (".wav", ".rf64", ".w64", ".flac"),
        "acquisition.files.wav",
        sniff.wav,
        _TIME,
        (),
        "formats",
        ("soundfile",),
    ),
    Format(
        "xlsx",
        "Excel table",
        (".xlsx", ".xlsm"),
        "acquisition.files.xlsx",
        sniff.xlsx,
        _ANY,
        (),
        "formats",
        ("openpyxl",),
    ),
    Format(
        "frd",
        "CalculiX results: modes",
        (".frd",),
        "acquisition.files.finite_elements.frd",
        sniff.frd,
        ("modes", "geometry"),
    ),
    Format(
        "rst",
        "Ansys results: modes",
        (".rst",),
        "acquisition.files.finite_elements.rst",
        sniff.rst,
        ("modes", "geometry"),
        (),
        "fe",
        ("ansys.mapdl.reader",),
    ),
    Format("lvm", "LabVIEW measurement text", (".lvm",), "acquisition.files.lvm", sniff.lvm, _TIME),
    Format("signalcalc", "SignalCalc FRF text", (".txt",), "acquisition.files.signalcalc", sniff.signalcalc, ("frfs",)),
    Format("json", "JSON arrays", (".json",), "acquisition.files.json_arrays", sniff.json, _ANY),
    Format(
        "table",
        "Text table (CSV, TXT, TSV)",
        (".csv", ".txt", ".tsv", ".tab", ".asc", ".dat", ".prn"),
        "acquisition.files.table",
        sniff.text,
        _ANY,
    ),
)


def formats() -> list[Format]:
    """Return the file formats that can be read or written, with what each needs.

    Returns
    -------
    list of Format
        One entry per format.

    Examples
    --------
    >>> "uff" in {kind.name for kind in formats()}
    True
    """
    return list(_FORMATS)


def _named(name: str) -> Format:
    for candidate in _FORMATS:
        if candidate.name == name:
            return candidate
    raise InputError("no such file format", got=name, expected="one of " + ", ".join(f.name for f in _FORMATS))


def _suffixes(path: Path) -> str:
    """Last suffix that names a format: ``a.json.gz`` -> ``.json``."""
    return next((suffix for suffix in map(str.lower, reversed(path.suffixes)) if suffix != ".gz"), "")


def detect(path: "str | PathLike[str]") -> Format:
    """The format of a file, by its content first and its suffix second.

    Raises
    ------
    InputError : there is no such file, it is a folder or empty, or its format is unknown.
    """
    path = Path(path)
    head = sniff.head(path)
    suffix = _suffixes(path)
    fitting = [candidate for candidate in _FORMATS if candidate.sniff(head)]
    by_suffix = [candidate for candidate in fitting if suffix in candidate.suffixes]
    if fitting:
        special = [candidate for candidate in fitting if candidate.name != "table"]
        return (special or by_suffix or fitting)[0]
    wanted = next((candidate for candidate in _FORMATS if suffix in candidate.suffixes), None)
    raise InputError(
        f"not a {wanted.title} file in spite of its name" if wanted else "the format of the file is not known",
        where=str(path),
        got=f"first bytes {head[:16]!r}",
        advice="`ema formats` lists what can be read",
    )


def read(path: "str | PathLike[str]", format: str = "", **layout: Any) -> Contents:
    """Read a foreign file.

    Parameters
    ----------
    path : str or PathLike
        The file; ``.gz`` is unpacked on the way.
    format : str, optional
        Name of the format where the content of the file does not show it.
    **layout : object
        What a file that does not describe itself holds where; see :class:`acquisition.files.layout.Layout`.

    Returns
    -------
    Contents
        What the file held, in SI where it states its units.

    Raises
    ------
    InputError
        If there is no such file, it is damaged or of an unknown format, or the ``layout`` has to say what it holds.
    UnitError
        If the ``layout`` names an unknown unit.
    MissingExtraError
        If the format needs an optional package.

    Examples
    --------
    >>> import tempfile
    >>> from ema.examples import frf_set
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write(f"{folder}/line.uff", frf_set())
    ...     read(f"{folder}/line.uff").frfs[0].values.shape
    (201, 4, 2)
    """
    path = Path(path)
    kind = _named(format) if format else detect(path)
    sniff.head(path)
    _require(kind)
    options = Layout.of(**layout)
    adapter = import_module(kind.module)
    try:
        contents: Contents = adapter.read(path, options)
        found = examine(contents, options.sampling_rate)
        frfs, notes = restored(contents.frfs)
        contents = replace(contents, frfs=frfs, findings=(*contents.findings, *found, *notes))
    except EmaError:
        raise
    except OSError as error:
        raise InputError(
            f"the file cannot be read: {error.strerror or error}",
            where=str(path),
            advice="check that you may read it, or copy or export it again",
        ) from error
    except Exception as error:  # readers of foreign formats fail in ways of their own; the cause is kept
        raise InputError(
            f"damaged, or not a {kind.title} file: {(str(error) or type(error).__name__).splitlines()[0]}",
            where=str(path),
            advice="copy or export it again" + (", or leave format out" if format else ""),
        ) from error
    suffix = _suffixes(path)
    owners = [candidate for candidate in _FORMATS if suffix in candidate.suffixes]
    if owners and kind not in owners and not (kind.name == "lvm" or format):
        note = Finding("info", "wrong-suffix", path.name, f"the name says {owners[0].title}, the content {kind.title}.")
        contents = replace(contents, findings=(note, *contents.findings))
    return contents


def _installed(package: str) -> bool:
    try:
        return find_spec(package) is not None
    except ModuleNotFoundError:  # the package above it is not there
        return False


def _require(kind: Format) -> None:
    for package in kind.packages:
        if not _installed(package):
            raise MissingExtraError(
                f"the optional package '{package}' is not installed",
                advice=f"install it with: pip install 'friction-ema[{kind.extra}]'",
            )


def write(path: "str | PathLike[str]", *nouns: Any, format: str = "", **options: Any) -> None:
    """Write FRF sets, recordings, geometry, modes, or the contents of a file in a foreign format.

    The file appears whole or not at all; an old one stays intact if writing fails.

    Parameters
    ----------
    path : str or PathLike
        The file; its suffix chooses the format.
    *nouns : object
        What to write.
    format : str, optional
        Name of the format, instead of the suffix.
    **options : object
        Options of the format, such as ``binary=True`` for universal files.

    Raises
    ------
    InputError
        If the format cannot hold what is written or is only read, or values are not finite.
    FailureError
        If the folder is read-only or the disk is full.

    Examples
    --------
    >>> import tempfile
    >>> from ema.examples import geometry
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write(f"{folder}/line.uff", geometry())
    ...     read(f"{folder}/line.uff").geometry.nodes
    array([1, 2, 3, 4])
    """
    path = Path(path)
    suffix = _suffixes(path)
    choices = [_named(format)] if format else [candidate for candidate in _FORMATS if suffix in candidate.suffixes]
    choices = [candidate for candidate in choices if candidate.writes]
    if not choices:
        raise InputError(
            "this format is not written",
            where=str(path),
            got=suffix or format or "no suffix",
            expected="one of " + ", ".join(s for f in _FORMATS if f.writes for s in f.suffixes),
        )
    adapter = import_module(choices[0].module)
    try:
        adapter.write(path, nouns, **options)
    except OSError as error:
        raise FailureError(
            f"the file cannot be written: {error.strerror or error}",
            where=str(path),
            advice="choose a folder that you may write to, on a disk with room",
        ) from error
