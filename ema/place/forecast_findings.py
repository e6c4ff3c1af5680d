"""What a reader of a forecast has to know: why there is no band, and what the upper harmonics of the friction do."""

import numpy as np
from jaxtyping import Float

from ema.data import Finding
from ema.messages import mark

_HARMONICS = 0.05
"""Change of a damping ratio by the upper harmonics from which on it is named."""


def about_holes(
    known: np.ndarray, spread_out: np.ndarray, parted: np.ndarray, solved: np.ndarray
) -> tuple[Finding, ...]:
    """Why conditions have no band: the mode is spread over several resonances, the joints part, no peak belongs to the
    mode, or too few draws have one."""
    findings = []
    for code, lost, why, advice in (
        (
            "mode-spread",
            spread_out,
            mark(
                "in {count} of {total} conditions the beam spreads the mode over several resonances, none of which "
                "holds half of it: no single frequency and damping ratio are those of the mode."
            ),
            mark("Look at the FRFs there, choose another place, or a beam whose own resonance is further away."),
        ),
        (
            "joint-parts",
            parted & ~spread_out,
            mark(
                "in {count} of {total} conditions the normal force of a joint varies by more than F_N in a fifth of "
                "the draws or more: it parts there unless it also pulls, and values are predicted only for joints "
                "that can."
            ),
            mark("Press more, or excite less."),
        ),
        (
            "no-peak",
            ~known & ~parted & ~spread_out & ~solved,
            mark(
                "in {count} of {total} conditions no peak of the response belongs to the mode: another mode moves more "
                "wherever there is one."
            ),
            mark("Choose another excited DOF, or ask for the neighbouring mode."),
        ),
        (
            "no-band",
            ~known & ~parted & ~spread_out & solved,
            mark(
                "in {count} of {total} conditions a fifth of the draws or more have no peak that belongs to the mode."
            ),
            mark("Their bands are left open."),
        ),
    ):
        if lost.any():
            count = int(lost.sum())
            findings.append(
                Finding.of(
                    "warning", code, "forecast", why, float(count), 0.0, advice=advice, count=count, total=known.size
                )
            )
    return tuple(findings)


def about_harmonics(damping: Float[np.ndarray, "mode level force"]) -> tuple[Finding, ...]:
    """Whether the upper harmonics of the friction force change a damping ratio, by its logarithm, by much."""
    count, most = int(np.sum(damping > _HARMONICS)), float(damping.max())
    if not count:
        return ()
    return (
        Finding.of(
            "warning",
            "upper-harmonics",
            "forecast",
            "in {count} of {total} conditions the upper harmonics of the friction force change the damping ratio by "
            "more than {limit_share}, at most {most}: as where a mode lies near three or five times the frequency.",
            most,
            _HARMONICS,
            advice="The bands hold as much to either side; what is true hangs on the frequency of that upper mode.",
            count=count,
            total=damping.size,
            limit_share=f"{_HARMONICS:.0%}",
            most=f"{most:.0%}",
        ),
    )
