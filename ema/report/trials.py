"""Tests that would narrow a forecast, in a report: which one tells most per hour, and what each leaves of the bands."""

import numpy as np

from ema.data.trials import Trials
from ema.messages import text
from ema.report.blocks import Block, Book, Cell, Text
from ema.report.numbers import plain


def proposal(offered: Trials) -> str:
    """Name the test that narrows the bands of the damping ratio most per hour.

    Parameters
    ----------
    offered : Trials
        Tests on offer, with the widths of the bands that each would leave.

    Returns
    -------
    str
        One sentence, in the language of the report; another one where no test narrows the bands.

    Examples
    --------
    >>> from ema.examples import trials
    >>> proposal(trials()).startswith("Next best test:")
    True
    """
    gain = offered.narrowing
    if not np.any(gain > 0):
        return text("No test on offer narrows the bands of the damping ratio.")
    best = offered.trials[offered.best]
    return text(
        "Next best test: {test} ({hours} h); it is expected to narrow the bands of the "
        "damping ratio from ±{damping} to ±{damping_after} % and those of the frequency from "
        "±{frequency} to ±{frequency_after} %.",
        test=best.title,
        hours=plain(best.hours, 3),
        damping=f"{100 * offered.damping_width:.1f}",
        damping_after=f"{100 * best.damping_width:.1f}",
        frequency=f"{100 * offered.frequency_width:.2f}",
        frequency_after=f"{100 * best.frequency_width:.2f}",
    )


def trial_blocks(offered: Trials, book: Book) -> list[Block]:
    """The proposal, and every test with its cost and what it will leave of the bands."""
    rows: list[list[Cell]] = [
        [str(row[0]), plain(row[1], 3), f"{row[2]:.2f}", f"{row[3]:.1f}", f"{row[4]:.0f}", f"{row[5]:.1f}"]
        for row in offered.table().itertuples(index=False)
    ]
    return [
        Text(proposal(offered)),
        book.table(
            "trials",
            text(
                "Tests and what they are expected to leave of the bands, now ±{frequency} % of the "
                "frequency and ±{damping} % of the damping ratio (half widths, mean over modes and "
                "conditions). A beam at its recommended place stays installed; elsewhere it is "
                "another assembly.",
                frequency=f"{100 * offered.frequency_width:.2f}",
                damping=f"{100 * offered.damping_width:.1f}",
            ),
            [
                text("Test"),
                text("Hours"),
                text("f after [± %]"),
                text("ζ after [± %]"),
                text("Narrower [%]"),
                text("Per hour [%]"),
            ],
            rows,
        ),
    ]
