"""Channels whose phase is a quarter turn off: a velocity stated as an acceleration, or the other way round.

At the resonance of a lightly damped mode all FRFs have one phase, up to signs. That of one response which was stated in
the unit of a neighbouring derivative lies a right angle off at every resonance, for H / (j w) stands in place of H. The
poles are right, and every shape is wrong there. Delays and filters, whose angle follows the frequency, are looked for
in ``ema.fit.channel_phase``.

Of 355 random systems with four responses and three modes or more (2 to 16 complex modes, one response of each
integrated over time), the shapes name the right response in 304 and another one in none; of 800 without a fault none is
named. Where nothing is named, fewer than three modes move the response, or modes are too complex. FRFs at their peaks,
before a fit, name 30 of 89.
"""

import numpy as np
from jaxtyping import Complex, Float

from ema.data import Finding, FrfSet, ModalModel

FEWEST_PEAKS, FEWEST_OUTPUTS = 3, 4
"""Resonances at which a channel is turned, and responses of which it is one: three and more agree with each other."""
ONE_PHASE = 0.7
"""|sum H^2| / sum |H|^2 over the other responses from which a resonance has one phase; modes close to each other and
strongly complex ones have less."""
TURNED = -0.8
"""Mean cosine of twice the phase towards the others from which a channel is turned: -1 is a right angle, 1 none."""
STRAIGHT = 0.0
"""The same, which all others have at least."""
SEEN = 0.1
"""Share of the mean response at a resonance from which a channel counts there: near a node others' modes prevail."""


def turned_channels(
    frfs: FrfSet, peaks: Float[np.ndarray, "resonance"], modes: ModalModel | None = None
) -> list[Finding]:
    """A finding for each response that lies a right angle off the others in the shapes of ``modes``.

    Without modes, FRFs at the ``peaks`` in Hz stand for the shapes; other modes have a part in them, and less is seen.
    """
    if modes is not None:
        squares, names = modes.shapes.T**2, modes.dofs
        sizes = np.abs(squares)
    else:
        lines = np.unique(np.searchsorted(frfs.frequencies, peaks).clip(0, len(frfs.frequencies) - 1))
        values, names = np.asarray(frfs.values[lines]), frfs.outputs
        squares, sizes = np.sum(values**2, axis=2), np.sum(np.abs(values) ** 2, axis=2)
    if squares.shape[1] < FEWEST_OUTPUTS or len(squares) < FEWEST_PEAKS:
        return []
    # No response counts more than the mean one, lest one that is turned and large be the direction of all.
    least = np.maximum(sizes, np.maximum(sizes.mean(axis=1, keepdims=True), 1e-300))
    squares, sizes = squares / least, sizes / least
    return [
        Finding.of(
            "error",
            "channel-quarter-turn",
            f"{frfs.name}, {names[row]}" if frfs.name else str(names[row]),
            "its FRFs lie a right angle off those of the other responses at {count} resonances, so that its unit may "
            "be that of another derivative: the shapes are wrong there, frequencies and damping are not.",
            cosine,
            TURNED,
            advice="Check whether the channel is an acceleration, a velocity or a displacement, and correct its unit.",
            count=count,
        )
        for row, cosine, count in _turned(squares, sizes)
    ]


def _turned(
    squares: Complex[np.ndarray, "resonance output"], sizes: Float[np.ndarray, "resonance output"]
) -> list[tuple[int, float, int]]:
    """Outputs a right angle off all others: number, mean cosine of twice the phase, resonances that tell.

    The one farthest off is taken out until the others have one phase; fewer than half may be taken out. Then those
    taken out are judged by the resonances at which the others have one phase.
    """
    kept = list(range(squares.shape[1]))
    out: list[int] = []
    while len(kept) >= FEWEST_OUTPUTS - 1 and 2 * len(kept) > squares.shape[1]:
        cosines = [_towards(squares, sizes, row, [other for other in kept if other != row])[0] for row in kept]
        if min(cosines) >= STRAIGHT:
            judged = [(row, *_towards(squares, sizes, row, kept, ONE_PHASE)) for row in out]
            return judged if all(cosine <= TURNED for _, cosine, _ in judged) else []
        out.append(kept.pop(int(np.argmin(cosines))))
    return []


def _towards(
    squares: Complex[np.ndarray, "resonance output"],
    sizes: Float[np.ndarray, "resonance output"],
    row: int,
    others: list[int],
    one_phase: float = 0.0,
) -> tuple[float, int]:
    """Mean cosine of twice the phase of an output towards others, by its share of the response; resonances that tell.

    An output that fewer than ``FEWEST_PEAKS`` resonances show lies along the others for all that is known.
    """
    rest, whole = squares[:, others].sum(axis=1), sizes[:, others].sum(axis=1)
    share = sizes[:, row]
    tells = (np.abs(rest) >= one_phase * whole) & (share >= SEEN) & (np.abs(rest) > 0)
    if tells.sum() < FEWEST_PEAKS:
        return 1.0, 0
    cosines = np.real(squares[tells, row] * np.conj(rest[tells])) / (share[tells] * np.abs(rest[tells]))
    return float(np.average(cosines, weights=share[tells])), int(tells.sum())
