"""What decides about modes: every threshold of the selection with its meaning and where it comes from."""

from dataclasses import dataclass, fields

import scipy.stats


@dataclass(frozen=True, kw_only=True)
class SelectionPolicy:
    """Thresholds by which poles are accepted as modes; the others stay candidates, with the reason.

    Parameters
    ----------
    heaviest : damping ratio above which a pole describes the background and not a mode. Structures with joints reach
        10 %; poles that stand for residual terms begin at 30 %. One that is visible and well determined is a candidate.
    false_alarm : probability that noise alone passes for a mode somewhere in the band. It sets the energy that a mode
        has to explain (chi-square over all its unknowns, divided by the lines).
    persistence : share of the model orders that have to show a pole for it to be tried from the start. The search of
        the residual finds what is missing, so that the value matters little.
    damping_uncertainty : standard deviation of the damping ratio over its value beyond which the data do not tell that
        there is a resonance. A mode counts as identifiable when the Cramer-Rao bound is below 0.1; the excess leaves
        room for the scatter of that estimate.
    visible_uncertainty : the same for a mode that is seen as a peak: such a resonance is there, and its interval says
        how badly its damping is known. Beyond a third the damping hardly differs from zero.
    visible : share of the energy within its half-power bandwidth from which on a mode is seen as a peak.
    unresolved : half-power bandwidth, and its standard deviation, in frequency lines within which a resonance that is
        seen as a peak is a mode whatever the relative uncertainty of its damping: its frequency is determined,
        and its damping is bounded from above. With one line between the half-power points nothing tells more.
    mains : Hz, frequencies of the mains, at whose multiples poles are tones that are narrower than a line
        and whose damping the data do not tell from zero. One narrow mode in seven is there by chance at 2 kHz, but
        of these the data tell the damping.
    mains_deviation : relative deviation of the mains frequency within which that is so: grids keep theirs to 0.1 %
        (EN 50160 allows 1 % for 99.5 % of a year).
    mains_chance : probability with which a mode lies at a multiple by chance, up to which one such pole is a tone too:
        within ``mains_deviation`` of the fifth multiple it is 0.01. Twice of that would take in the tenth.
    frequency_uncertainty : standard deviation of the natural frequency over the distance to the nearest mode with the
        same participation beyond which the two cannot be told apart. Identifiable modes have 0.2 at most.
    shape_scatter : variance of a shape over its energy beyond which a MAC of 0.8 with the true shape is not expected:
        the MAC is near 1 / (1 + scatter).
    confidence : probability that a mode is one, is nearest to itself and shows its own shape, below which it stays a
        candidate. It is calibrated: of 3,067 modes accepted from 0.67 on (two seeds of random systems) 10 were
        false, and 10 is what their confidences add up to. Between 0.67 and 0.8 lie 4 of the false ones and 3 of
        2,986 identifiable modes; to 0.9 another false one and 12 identifiable ones.
    alone : the same with the probability that it is not several modes that overlap. Of 3,340 modes of 240 random
        systems with 0.5 or more, ten lie below two thirds: three are false, and one is identifiable.
    grouped : distance of two poles, in standard deviations of their difference, within which they are a group: their
        sum and the space of their shapes are determined, each for itself is not. Modes count as identifiable when the
        standard deviation of each is a fifth of their distance at most, which is 2.5 times that of a difference whose
        errors add up. A double root is farther apart in the estimates once in 500 draws (two-dimensional normal).
    coincident : distance of two poles over the sum of their decay rates within which they can be a group. A resonance
        that moves within a test moves by a few hundredths of its bandwidth; two modes that are farther apart and not
        told apart stay candidates.
    rank_margin : singular value of the joint residue of a group, over the largest one that noise has, from which on it
        counts as a mode.
    near : part of a wanted frequency within which a mode has to lie.
    dominant : share of the energy within the half-power bandwidth from which on a candidate is reported as an error:
        what dominates the FRFs there has to be explained.
    large : share of the energy of all FRFs that such a candidate carries at least.
    """

    heaviest: float = 0.20
    false_alarm: float = 1e-6
    persistence: float = 0.3
    damping_uncertainty: float = 0.12
    visible_uncertainty: float = 1 / 3
    visible: float = 0.25
    unresolved: float = 1.0
    mains: tuple[float, ...] = (50.0, 60.0)
    mains_deviation: float = 1e-3
    mains_chance: float = 0.0101
    frequency_uncertainty: float = 1 / 3
    shape_scatter: float = 0.25
    confidence: float = 0.8
    alone: float = 2 / 3
    grouped: float = 2.5
    coincident: float = 0.1
    rank_margin: float = 2.0
    near: float = 0.01
    dominant: float = 0.5
    large: float = 0.01

    def options(self) -> tuple[tuple[str, str], ...]:
        """Every threshold as name and value, for the provenance of a result."""
        return tuple(
            (f"selection: {each.name.replace('_', ' ')}", str(getattr(self, each.name))) for each in fields(self)
        )


POLICY = SelectionPolicy()
"""The policy of this version."""


def passes_for_mode(freedom: float, lines: int) -> float:
    """Energy that a mode of so many unknowns fitted to noise exceeds somewhere in the band with the false-alarm
    probability.
    """
    return float(scipy.stats.chi2.isf(POLICY.false_alarm / lines, freedom))
