"""Modes over their amplitude: a picture and a table of the levels."""

from collections.abc import Sequence

from ema import show
from ema.data import AmplitudeDependentMode
from ema.report.blocks import Block, Book, Cell
from ema.report.numbers import fixed, plain
from ema.units import SI_UNIT


def amplitude_sentences(modes: Sequence[AmplitudeDependentMode]) -> list[str]:
    """What each mode does from its lowest to its highest level."""
    return [
        f"Levels of {mode.name}: from {plain(float(mode.amplitude[0]), 3)} to {plain(float(mode.amplitude[-1]), 3)} "
        f"{SI_UNIT[mode.quantity]} the frequency goes from {fixed(float(mode.frequency.value[0]), 2)} to "
        f"{fixed(float(mode.frequency.value[-1]), 2)} Hz and the damping from "
        f"{plain(100 * float(mode.damping.value[0]), 3)} to {plain(100 * float(mode.damping.value[-1]), 3)} %."
        for mode in modes
    ]


def amplitude_modes(modes: Sequence[AmplitudeDependentMode], book: Book) -> list[Block]:
    """Frequency and damping over the amplitude, with what the intervals contain."""
    names = ", ".join(mode.name for mode in modes)
    contains = "; ".join(dict.fromkeys(mode.damping.contains for mode in modes))
    caption = f"Frequency and damping over the amplitude; 95 % intervals contain {contains}."
    rows: list[tuple[Cell, ...]] = [
        (
            mode.name,
            mode.control,
            plain(float(amplitude), 4),
            *(fixed(float(band[n]), 3) for band in (mode.frequency.value, mode.frequency.low, mode.frequency.high)),
            *(plain(100 * float(band[n]), 4) for band in (mode.damping.value, mode.damping.low, mode.damping.high)),
        )
        for mode in modes
        for n, amplitude in enumerate(mode.amplitude)
    ]
    columns = ("Run", "Controlled", "Amplitude", "f [Hz]", "f low", "f high", "ζ [%]", "ζ low", "ζ high")
    return [
        book.picture(show.amplitude_modes(modes), f"Frequency and damping over the amplitude: {names}.", caption),
        book.table("amplitude_modes", f"{caption} Amplitudes in SI units of the response.", columns, rows),
    ]
