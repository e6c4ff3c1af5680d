"""What a file that does not describe itself holds, and where: said by the user, never guessed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal

from ema.errors import InputError

Names = str | Sequence[str]


@dataclass(frozen=True)
class Layout:
    """Where things are in a table or a container of arrays (CSV, XLSX, MAT, HDF5, NPY, JSON).

    A *place* is the name of an array (``"HIdata.acc1"``, ``"InputTask/data"``), the title of a table column, ``"column
    2"`` or ``"row 0"`` of the file's main array, or both: ``"data column 2"``. Counting starts at 0.

    Time signals
        ``signals``: place or places of the signals; ``axis``: whether the channels are the ``"columns"`` or the
        ``"rows"`` of the array; ``time``: place of the time axis, or ``sampling_rate``: Hz or the place of the number;
        ``time_unit``.
    FRFs
        ``frequency``: place (with ``frequency_unit`` where the file states none and it is not Hz), or
        ``frequency_step`` in Hz; then ``frf`` (complex), ``real`` and ``imaginary``, or ``amplitude`` and ``phase``;
        ``axis``: whether frequency is the first axis of an array (``"columns"``) or the last (``"rows"``), where its
        length does not show it; ``coherence``; ``outputs`` and ``inputs``: DOFs; ``unit``. Where the file does not
        state it, an amplitude needs ``amplitude_unit``: ``"linear"``, a unit, or dB with its reference (``"dB re 1
        (m/s^2)/N"``, ``"dB re unstated"`` where nobody knows it), and a phase needs ``phase_unit``: ``"deg"`` or
        ``"rad"``, with ``"unwrapped"`` in front where it runs on beyond 2 pi.
    Geometry
        ``x``, ``y``, ``z``: places, or ``coordinates``: place of an array (n, 3); ``node``: place of the numbers, else
        1, 2, ...; ``lines``: place of an array (line, 2 or more) of node numbers; ``unit`` of length.
    Modes
        ``shapes``: place of an array with the axes named in ``shape_axes``, e.g. ``"direction node mode"``;
        ``natural_frequencies`` in Hz and ``damping_ratios``: values or places; ``nodes``: numbers, else 1, 2, ...

    ``names`` and ``units`` of the channels: values, a place of texts, or for units a table by channel name.
    ``salvage``: take what a damaged file still holds, with a finding that names it, instead of an error.
    ``sheet`` of a workbook, ``delimiter`` and ``decimal`` of a text table, ``sets``: numbers of the data sets of a
    universal file to read.
    """

    signals: Names | None = None
    axis: Literal["columns", "rows", ""] = ""
    time: str | None = None
    sampling_rate: float | str | None = None
    time_unit: str | None = None
    names: Names | None = None
    units: Names | Mapping[str, str] | None = None
    frequency: str | None = None
    frequency_unit: str | None = None
    frequency_step: float | None = None
    frf: str | None = None
    real: str | None = None
    imaginary: str | None = None
    amplitude: str | None = None
    phase: str | None = None
    amplitude_unit: str | None = None
    phase_unit: str | None = None
    coherence: str | None = None
    outputs: Names | None = None
    inputs: Names | None = None
    unit: str | None = None
    x: str | None = None
    y: str | None = None
    z: str | None = None
    coordinates: str | None = None
    node: str | None = None
    lines: str | None = None
    shapes: str | None = None
    shape_axes: str = "node mode"
    natural_frequencies: str | Sequence[float] | None = None
    damping_ratios: str | Sequence[float] | None = None
    nodes: Sequence[int] | None = None
    sheet: str | None = None
    delimiter: str = ""
    decimal: Literal[".", ",", ""] = ""
    sets: Sequence[int] | None = None
    salvage: bool = False

    @classmethod
    def of(cls, **options: Any) -> "Layout":
        """A layout from keyword arguments.

        Raises
        ------
        InputError : an unknown option, with the nearest known one, or an ``axis`` that is none.
        UnitError : an ``amplitude_unit`` or ``phase_unit`` that is none.
        """
        from difflib import get_close_matches

        from acquisition.files.scales import check_scales

        known = [field.name for field in fields(cls)]
        for name in options:
            if name not in known:
                close = get_close_matches(name, known, n=1)
                raise InputError(
                    "unknown option of a file's layout",
                    got=name,
                    expected="one of " + ", ".join(known),
                    advice=f"did you mean {close[0]}?" if close else "",
                )
        if options.get("axis", "") not in ("columns", "rows", ""):
            raise InputError("unknown axis of the signals", got=options["axis"], expected="columns or rows")
        check_scales(options.get("amplitude_unit"), options.get("phase_unit"))
        return cls(**options)

    @property
    def kind(self) -> str:
        """What the options describe: ``frf``, ``geometry``, ``modes``, ``signals``, or nothing."""
        if self.shapes is not None:
            return "modes"
        if any(place is not None for place in (self.frf, self.real, self.amplitude)):
            return "frf"
        if self.coordinates is not None or any(place is not None for place in (self.x, self.y, self.z)):
            return "geometry"
        if any(place is not None for place in (self.signals, self.time, self.sampling_rate)):
            return "signals"
        return ""
