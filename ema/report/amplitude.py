"""Modes over their amplitude: a picture and a table of the levels."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from ema import show
from ema.data import AmplitudeDependentMode, Finding
from ema.messages import mark, text, word
from ema.messages.recognition import in_words
from ema.report.blocks import Block, Book, Cell, Table
from ema.report.numbers import MISSING, fixed, plain
from ema.units import SI_UNIT

_WORDS = (
    mark("response"),
    mark("force"),
    mark("none"),
    mark("scatter of the lines"),
    mark("scatter of the lines and uncertainty of the modal mass"),
)
"""What is controlled, and what intervals contain, as data say it."""
_SAME = 0.1
"""Relative distance of frequencies up to which modes of several runs are drawn in one picture."""


def amplitude_sentences(modes: Sequence[AmplitudeDependentMode]) -> list[str]:
    """What each mode does from its lowest to its highest level, or where a ring-down says that it begins to slip."""
    stepped = [mode for mode in modes if not _small(mode)]
    slipping = [(mode, one) for mode in modes if (one := _small(mode)) is not None and one.code == "slip-onset"]
    return [
        *(
            text(
                "Levels of {mode}: from {least} to {most} {unit} the frequency goes from {f_first} to {f_last} Hz "
                "and the damping from {zeta_first} to {zeta_last} %.",
                mode=mode.name,
                least=plain(float(mode.amplitude[0]), 3),
                most=plain(float(mode.amplitude[-1]), 3),
                unit=SI_UNIT[mode.quantity],
                f_first=fixed(float(mode.frequency.value[0]), 2),
                f_last=fixed(float(mode.frequency.value[-1]), 2),
                zeta_first=plain(100 * float(mode.damping.value[0]), 3),
                zeta_last=plain(100 * float(mode.damping.value[-1]), 3),
            )
            for mode in stepped
        ),
        *(
            text("Ring-downs of {mode}: {message}", mode=mode.name, message=in_words(one).message)
            for mode, one in slipping
        ),
    ]


def amplitude_modes(modes: Sequence[AmplitudeDependentMode], book: Book) -> list[Block]:
    """Report frequency and damping over the amplitude, with what the intervals contain.

    Parameters
    ----------
    modes : sequence of AmplitudeDependentMode
        Modes of ring-downs and of stepped levels, in any order.
    book : Book
        Numbers the pictures and tables.

    Returns
    -------
    list of Block
        Those of the ring-downs, then those of the stepped levels; none without modes.
    """
    stepped = [mode for mode in modes if not _small(mode)]
    ringing = [mode for mode in modes if _small(mode)]
    blocks: list[Block] = []
    if ringing:
        blocks += [_limits(ringing, book), *_pictures(ringing, book)]
        blocks.append(level_table(ringing, book, "ring_down_modes", text("Levels read from the ring-downs"), shown=0))
        blocks += _shapes(ringing, book)
    if stepped:
        names = ", ".join(mode.name for mode in stepped)
        alt = text("Frequency and damping over the amplitude: {names}.", names=names)
        blocks.append(book.picture(partial(show.amplitude_modes, stepped), alt, _caption(stepped)))
        blocks.append(level_table(stepped, book, "amplitude_modes", _caption(stepped)))
    return blocks


def _small(mode: AmplitudeDependentMode) -> Finding | None:
    """What the ring-downs of a hammer test say about small amplitudes; ``None`` for a mode of stepped levels."""
    return _said(mode, "slip-onset") or _said(mode, "no-slip-seen")


def _said(mode: AmplitudeDependentMode, code: str) -> Finding | None:
    return next((in_words(finding) for finding in mode.findings if finding.code == code), None)


def _caption(modes: Sequence[AmplitudeDependentMode]) -> str:
    contains = "; ".join(dict.fromkeys(word(mode.damping.contains) for mode in modes))
    return text(
        "Frequency and damping over the amplitude; 95 % intervals contain {contains}.",
        contains=contains,
    )


def _pictures(modes: Sequence[AmplitudeDependentMode], book: Book) -> list[Block]:
    """One picture for the modes of all runs that have about the same frequency and of which one is seen to slip."""
    groups: list[list[AmplitudeDependentMode]] = []
    for mode in modes:
        middle = float(np.median(mode.frequency.value))
        for group in groups:
            if abs(float(np.median(group[0].frequency.value)) / middle - 1) < _SAME:
                group.append(mode)
                break
        else:
            groups.append([mode])
    return [
        book.picture(
            partial(show.amplitude_modes, group),
            text(
                "Frequency and damping over the amplitude, from ring-downs: {modes}.",
                modes=", ".join(mode.name for mode in group),
            ),
            f"{_caption(group)} "
            + text(
                "Dashed: slip begins; dash-dotted: median amplitude behind the impacts; dotted, with diamonds: what "
                "the publication states, and the amplitudes to which it belongs."
            ),
        )
        for group in groups
        if any(_said(mode, "slip-onset") for mode in group)
    ]


def _limits(modes: Sequence[AmplitudeDependentMode], book: Book) -> Table:
    """Small amplitudes, onset of slip, values behind the impacts, what a linear fit reads, and modal mass."""
    rows: list[tuple[Cell, ...]] = []
    for mode in modes:
        small, behind, linear = (_small(mode), _said(mode, "impact-amplitude"), _said(mode, "linear-reading"))
        mass = _said(mode, "modal-mass-withheld")
        rows.append(
            (
                mode.name,
                "" if small is None else small.message,
                "" if behind is None else _at(mode, behind),
                "" if linear is None else linear.message,
                plain(mode.modal_mass, 4) if mass is None else mass.message,
                " ".join(in_words(one).message for one in mode.findings if one.code.startswith("stated-")),
            )
        )
    columns = (
        text("Mode"),
        text("Small amplitudes"),
        text("Behind the impacts, median"),
        text("FRFs"),
        text("Modal mass [kg]"),
        text("Stated"),
    )
    caption = text(
        "Modes over their amplitude, from the ring-downs of all impacts. Amplitudes are "
        "those of the response at which the mode is largest, to whose shape of 1 the modal "
        "mass belongs. Stated: the numbers of the publication, and the amplitudes at which "
        "the mode has them."
    )
    return book.table("ring_down_limits", caption, columns, rows)


def _at(mode: AmplitudeDependentMode, behind: Finding) -> str:
    """Frequency and damping at the median amplitude behind the impacts, where it was reached by enough of them."""
    level, unit = float(behind.value or 0.0), SI_UNIT[mode.quantity].replace("^2", "²")
    if not mode.amplitude[0] <= level <= mode.amplitude[-1]:
        return text("{missing} at {level} {unit}", missing=MISSING, level=f"{level:.3g}", unit=unit)
    log, levels = np.log(level), np.log(mode.amplitude)
    frequency, damping = (float(np.interp(log, levels, band.value)) for band in (mode.frequency, mode.damping))
    return text(
        "{frequency} Hz and {damping} % at {level} {unit}",
        frequency=f"{frequency:.2f}",
        damping=f"{100 * damping:.3f}",
        level=f"{level:.3g}",
        unit=unit,
    )


def _shapes(modes: Sequence[AmplitudeDependentMode], book: Book) -> list[Block]:
    """Pictures and a table of the shapes at the responses over the amplitude, where there are any."""
    shaped = [mode for mode in modes if mode.shape is not None and len(mode.dofs) > 1]
    blocks: list[Block] = [
        book.picture(
            partial(show.amplitude_shapes, mode),
            text("Shape of {mode} over the amplitude.", mode=mode.name),
            text(
                "Shape of {mode} at the responses over the amplitude, 1 at the response to which the amplitudes "
                "belong; 95 % intervals contain {contains}.",
                mode=mode.name,
                contains=word(mode.damping.contains),
            ),
        )
        for mode in shaped
        if _said(mode, "slip-onset")
    ]
    if not shaped:
        return blocks
    rows: list[tuple[Cell, ...]] = [
        (
            mode.name,
            plain(float(amplitude), 4),
            str(dof),
            fixed(float(shape[row, level].real), 4),
            fixed(float(shape[row, level].imag), 4),
            fixed(float(half[row, level]), 4),
            fixed(float(mac), 4),
        )
        for mode in shaped
        for shape, half in [(np.asarray(mode.shape), np.asarray(mode.shape_half))]
        for level, (amplitude, mac) in enumerate(zip(mode.amplitude, mode.mac(), strict=True))
        for row, dof in enumerate(mode.dofs)
    ]
    columns = (
        text("Mode"),
        text("Amplitude"),
        text("DOF"),
        text("Re"),
        text("Im"),
        text("± (95 %)"),
        text("MAC with the lowest"),
    )
    caption = text("Shapes at the responses over the amplitude, 1 at the response to which the amplitudes belong.")
    blocks.append(book.table("ring_down_shapes", caption, columns, rows, 0))
    return blocks


def level_table(
    modes: Sequence[AmplitudeDependentMode], book: Book, name: str, caption: str, shown: int | None = None
) -> Table:
    """Every level of the modes: amplitude, frequency and damping with their 95 % intervals."""
    rows: list[tuple[Cell, ...]] = [
        (
            mode.name,
            word(mode.control),
            plain(float(amplitude), 4),
            *(fixed(float(band[n]), 3) for band in (mode.frequency.value, mode.frequency.low, mode.frequency.high)),
            *(plain(100 * float(band[n]), 4) for band in (mode.damping.value, mode.damping.low, mode.damping.high)),
        )
        for mode in modes
        for n, amplitude in enumerate(mode.amplitude)
    ]
    columns = (
        text("Run"),
        text("Controlled"),
        text("Amplitude"),
        "f [Hz]",
        text("f low"),
        text("f high"),
        "ζ [%]",
        text("ζ low"),
        text("ζ high"),
    )
    caption = f"{caption.rstrip('.')}. {text('Amplitudes in SI units of the response.')}"
    return book.table(name, caption, columns, rows, shown)
