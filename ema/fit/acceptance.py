"""Modes and candidates: what a pole has to show, on the final values and their intervals, to be accepted as a mode."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.special
from jaxtyping import Bool, Float, Int
from scipy.sparse.csgraph import connected_components

from ema.data import damping_ratios, natural_frequencies
from ema.fit import estimator
from ema.fit.estimator import Fit
from ema.fit.narrow import TONE
from ema.fit.narrow import tones as without_flanks
from ema.fit.policy import SelectionPolicy
from ema.fit.refinement import Refined
from ema.fit.search import evidence, macs
from ema.fit.uncertainty import PoleErrors
from ema.messages import mark

_SHAPE_FREEDOM = 6
"""Degrees of freedom of the scatter of a shape: errors of a few poles make most of it.

It shapes the probability that a shape is its own around the limit on its scatter. At 3 and at 12 the modes of 14 random
systems (3 to 10 modes, noise 0.1 to 5 %) stay the same.
"""


_PARTS_OF_TONE = 0.03
"""Reach over the mains frequency up to which a pole beside a multiple is a part of the tone: within it a mode lies by
chance once in 16, beyond it a mode would be taken for a part of the tone more often, and poles there stay modes."""


@dataclass(frozen=True)
class Verdict:
    """What is said of every pole of a fit: whether it can be a mode at all (in the band, oscillating), whether it is
    accepted as one, why not, how sure that is, and its group.

    ``group`` (pole,) numbers poles that belong together because the data do not tell them apart; ``energy`` (2, pole)
    is that of each over that of the FRFs around it, and over that of all FRFs. ``unresolved`` (pole,) are resonances
    narrower than the lines resolve: their damping is bounded from above and not determined; ``tones`` (pole,) are
    no resonances but tones at multiples of the mains frequency; ``heavy`` (pole,) are heavier than modes may be, and
    yet visible and well determined.
    """

    possible: Bool[np.ndarray, "pole"]
    accepted: Bool[np.ndarray, "pole"]
    reasons: tuple[str, ...]
    confidence: Float[np.ndarray, "pole"]
    group: Int[np.ndarray, "pole"]
    energy: Float[np.ndarray, "2 pole"]
    unresolved: Bool[np.ndarray, "pole"]
    tones: Bool[np.ndarray, "pole"]
    heavy: Bool[np.ndarray, "pole"]

    @property
    def listed(self) -> Bool[np.ndarray, "pole"]:
        """Poles that are modes or candidates, and can be named."""
        return np.asarray(self.possible | self.heavy)


def judge(
    optimum: Refined,
    errors: PoleErrors,
    possible: Bool[np.ndarray, "pole"],
    alone: Float[np.ndarray, "pole"],
    policy: SelectionPolicy,
    dropped: Float[np.ndarray, "dropped"],
    added_decay: float = 0.0,
) -> Verdict:
    """Judge every pole of a fit by what its values and their uncertainty say.

    Parameters
    ----------
    possible : poles that can be modes: in the band, oscillating.
    alone : probability that a pole is not several modes that overlap.
    dropped : Hz, poles that were left out of the fit.
    added_decay : 1/s, of the exponential window in the poles; what decays by it alone is no resonance.
    """
    fit = optimum.fit
    energy = estimator.shares_of_energy(optimum.data, fit)
    damping = damping_ratios(fit.poles + added_decay)
    visible = energy[0] >= policy.visible
    limit = np.where(visible, policy.visible_uncertainty, policy.damping_uncertainty)
    stated = errors.stated
    group = groups(fit, errors, possible, policy)
    members = np.bincount(group, minlength=len(group) + 1)[group] > 1
    # In a misfit, poles explain what is no noise: the search has judged them there.
    explained = np.full(len(fit.poles), np.inf) if optimum.misfit else evidence(optimum.data, fit)
    narrow = _narrow(
        optimum,
        errors.damping,
        possible,
        policy=policy,
        damping=damping,
        limit=limit,
        explained=explained,
        dropped=dropped,
    )
    unresolved = narrow.within_a_line & visible & ~narrow.tones & (errors.damping > limit * damping)
    steady = possible & (damping <= 0)
    # What cannot be a mode itself is no mode to be mistaken for: it stays in the fit, and in the interval of the other.
    resonant = possible & (explained >= 1) & ((errors.damping <= limit * damping) | unresolved)
    resonant &= ~(narrow.tones | steady | narrow.one_side | narrow.single_lines)
    # What is no noise leaves the damping open: a resonance that is seen as the one peak of its place is there still.
    undetermined = resonant & ~unresolved & (stated.damping > limit * damping)
    resonant &= ~undetermined | visible
    reach = stated.frequency / policy.frequency_uncertainty
    resonant &= ~_parts(fit, reach, group, resonant, undetermined, energy[1])
    spacing, apart = _distances(fit, group, resonant)
    confidence = _confidence(fit, stated, group, resonant, damping=damping, limit=policy.shape_scatter)
    certain = confidence * alone
    no_decay = (
        mark("it does not decay once the exponential window is taken off") if added_decay else mark("it does not decay")
    )

    def uncertain_frequency(pole: int, distance: float) -> str:
        return f"its frequency is uncertain by {stated.frequency[pole]:.2g} Hz, {distance:.2g} Hz from a neighbour"

    statements: tuple[tuple[np.ndarray, Callable[[int], str]], ...] = (
        (narrow.tones, lambda _: mark("its damping is not told from zero, at a multiple of the mains frequency")),
        (steady, lambda _: no_decay),
        (
            narrow.one_side,
            lambda _: mark(
                "it is narrower than a line and at the end of the band, where one side of a peak is no peak"
            ),
        ),
        (narrow.single_lines, lambda _: TONE),
        (explained < 1, lambda pole: f"it explains {explained[pole]:.2g} times what noise may"),
        (~resonant, lambda pole: f"its damping is uncertain by {stated.damping[pole] / damping[pole]:.0%}"),
        (
            stated.frequency > policy.frequency_uncertainty * spacing,
            lambda pole: uncertain_frequency(pole, spacing[pole]),
        ),
        (stated.frequency > 0.5 * apart, lambda pole: uncertain_frequency(pole, apart[pole])),
        ((errors.scatter > policy.shape_scatter) & ~members, lambda pole: _uncertain_shape(errors.scatter[pole])),
        (
            confidence < policy.confidence,
            lambda pole: f"the probability that it is a mode with this frequency and shape is {confidence[pole]:.0%}",
        ),
        (
            certain < policy.alone,
            lambda pole: (
                "the data do not tell it from modes that overlap; the probability that it is one is "
                f"{certain[pole]:.0%}"
            ),
        ),
    )
    reasons = [""] * len(fit.poles)
    for pole in np.flatnonzero(possible).tolist():
        reasons[pole] = next((reason(pole) for fails, reason in statements if fails[pole]), "")
    accepted = possible & np.array([not reason for reason in reasons], bool)
    # Poles that stand for the background or for a misfit are heavy too: these are no candidates.
    ends = optimum.data.s.imag[[0, -1]]
    heavy = ~possible & (damping > policy.heaviest) & visible & (energy[1] >= policy.large) & (explained >= 1)
    heavy &= (errors.damping <= policy.damping_uncertainty * damping) & (not optimum.misfit)
    heavy &= (fit.poles.imag >= ends[0]) & (fit.poles.imag <= ends[1])
    for pole in np.flatnonzero(heavy).tolist():
        reasons[pole] = f"its damping ratio is above {policy.heaviest:.0%}, the limit for modes"
    return Verdict(possible, accepted, tuple(reasons), certain, group, energy, unresolved, narrow.tones, heavy)


@dataclass(frozen=True)
class _Narrow:
    """Poles (pole,) narrower than the lines resolve: by their value and its uncertainty (``within_a_line``), tones at
    multiples of the mains frequency, those at an end of the band, and those that single lines show alone.
    """

    within_a_line: Bool[np.ndarray, "pole"]
    tones: Bool[np.ndarray, "pole"]
    one_side: Bool[np.ndarray, "pole"]
    single_lines: Bool[np.ndarray, "pole"]


def _narrow(
    optimum: Refined,
    std: Float[np.ndarray, "pole"],
    possible: Bool[np.ndarray, "pole"],
    *,
    policy: SelectionPolicy,
    damping: Float[np.ndarray, "pole"],
    limit: Float[np.ndarray, "pole"],
    explained: Float[np.ndarray, "pole"],
    dropped: Float[np.ndarray, "dropped"],
) -> _Narrow:
    """Poles that are narrow for the lines, with the standard deviation ``std`` of their ``damping``, which beyond
    ``limit`` of the value is not determined; ``explained`` is their energy over what noise may have.
    """
    fit, line = optimum.fit, optimum.data.line
    # Half-power bandwidths in lines.
    unit = 2 * np.abs(fit.poles) / max(line, 1e-300)
    narrow = damping * unit < policy.unresolved
    within_a_line = narrow & (std * unit < policy.unresolved)
    # A steady tone leaks into its neighbour lines as an undamped pole does: a pole known to decay is none.
    undamped = possible & narrow & (std > limit * damping)
    reach = 1.5 * line / (2 * np.pi)
    tones = _tones(natural_frequencies(fit.poles), undamped, dropped, policy=policy, reach=reach)
    # The first and the last lines show one side of a peak, which is none there: it may as well lie beside the band.
    ends = optimum.data.s.imag[[0, -1]]
    one_side = (np.min(np.abs(fit.poles.imag - ends[:, None]), axis=0) < 1.5 * line) & narrow
    # Of few averages single lines stand out: where the force is small by chance, errors are larger than any variance
    # pooled over lines says. A resonance shows in the lines beside as well.
    sharp = possible & (-2 * fit.poles.real < policy.unresolved * line) & (explained >= 1)
    single_lines = np.zeros(len(fit.poles), bool)
    single_lines[without_flanks(optimum.data, fit, np.flatnonzero(sharp))] = True
    return _Narrow(within_a_line, tones, one_side, single_lines)


def with_shapes(verdict: Verdict, scatter: Float[np.ndarray, "pole"], policy: SelectionPolicy) -> Verdict:
    """The verdict where the variance of shapes on all outputs is larger than that on some channels."""
    members = np.bincount(verdict.group, minlength=len(verdict.group) + 1)[verdict.group] > 1
    doubtful = verdict.accepted & (scatter > policy.shape_scatter) & ~members
    reasons = tuple(
        _uncertain_shape(value) if doubt else reason
        for value, doubt, reason in zip(scatter, doubtful, verdict.reasons, strict=True)
    )
    return replace(verdict, accepted=verdict.accepted & ~doubtful, reasons=reasons)


def _uncertain_shape(scatter: float) -> str:
    return f"its shape is uncertain: a MAC of {1 / (1 + scatter):.2f} with the true one is expected"


def _tones(
    frequencies: Float[np.ndarray, "pole"],
    undamped: Bool[np.ndarray, "pole"],
    dropped: Float[np.ndarray, "dropped"],
    *,
    policy: SelectionPolicy,
    reach: float,
) -> Bool[np.ndarray, "pole"]:
    """``undamped`` poles at multiples of a mains frequency [Hz]: one may be a mode by chance where multiples are close
    beside their deviation, two are not. Poles ``dropped`` within ``reach`` [Hz] of a multiple count too. Where there
    are such tones, undamped poles within ``reach`` of a multiple are parts of one: it may take several.
    """

    def apart(values: Float[np.ndarray, "value"], base: float) -> Float[np.ndarray, "value"]:
        return np.asarray(np.abs(values - np.maximum(np.rint(values / base), 1) * base))

    result = np.zeros(len(frequencies), bool)
    for base in policy.mains:
        near = undamped & (apart(frequencies, base) < policy.mains_deviation * frequencies)
        others = np.count_nonzero(apart(dropped, base) < np.maximum(policy.mains_deviation * dropped, reach))
        likely = 2 * policy.mains_deviation * frequencies / base > policy.mains_chance
        several = np.count_nonzero(near) + others > 1
        result |= near & (several | ~likely)
        if several and reach < _PARTS_OF_TONE * base:
            result |= undamped & (apart(frequencies, base) < reach)
    return result


def groups(
    fit: Fit, errors: PoleErrors, possible: Bool[np.ndarray, "pole"], policy: SelectionPolicy
) -> Int[np.ndarray, "pole"]:
    """Number of the group of each pole: poles whose difference is within its uncertainty belong together.

    Several references tell how many poles a group has, since each has to explain more than noise; but any other choice
    of shapes from the space that they span does as well.
    """
    count = len(fit.poles)
    linked = np.zeros((count, count), bool)
    rows = np.flatnonzero(possible)
    for place, a in enumerate(rows):
        for b in rows[place + 1 :]:
            distance = abs(fit.poles[a] - fit.poles[b])
            if distance < policy.coincident * (abs(fit.poles[a].real) + abs(fit.poles[b].real)):
                spread = float(np.linalg.norm(errors.poles[a] - errors.poles[b]))
                linked[a, b] = distance < policy.grouped * spread
    return np.asarray(connected_components(linked, directed=False)[1])


def surplus(
    optimum: Refined, errors: PoleErrors, possible: Bool[np.ndarray, "pole"], policy: SelectionPolicy
) -> Int[np.ndarray, "gone"]:
    """Poles of a fit that are too many: a group has as many modes as its joint residue has singular values above noise.

    A resonance that moved from one record to the next, or with amplitude, is fitted by two poles next to each other
    whose residues cancel; their sum is of rank one. A repeated root leaves a sum of as many ranks as it has modes. With
    one reference there is no more than one. The weakest poles of a group are named.
    """
    fit = optimum.fit
    group = groups(fit, errors, possible, policy)
    gone: list[int] = []
    for number in np.unique(group[possible]):
        members = np.flatnonzero((group == number) & possible)
        if len(members) < 2:
            continue
        residue = fit.shapes[:, 0, members] @ fit.participation[:, members].T
        outputs, references = residue.shape
        values = np.linalg.svd(residue, compute_uv=False)
        # Largest singular value of a noise matrix (Davidson and Szarek 2001), times a margin.
        noise = _residue_noise(optimum, errors, members) * (np.sqrt(outputs) + np.sqrt(references))
        rank = max(1, int(np.count_nonzero(values > policy.rank_margin * noise)))
        energy = np.linalg.norm(fit.shapes[:, 0, members], axis=0) * np.linalg.norm(
            fit.participation[:, members], axis=0
        )
        gone += members[np.argsort(energy)][: max(0, len(members) - rank)].tolist()
    return np.array(gone, int)


def _residue_noise(optimum: Refined, errors: PoleErrors, members: Int[np.ndarray, "member"]) -> float:
    """Root mean square error of the entries of the joint residue of some poles."""
    fit, modes = optimum.fit, len(optimum.fit.poles)
    rows = np.concatenate([members, modes + members])
    inflation = float(np.max(optimum.inflation_of_shapes[members]))
    own = inflation * fit.local[:, rows[:, None], rows]
    shared = 0.0
    total = 0.0
    # An entry of which the information tells nothing is one that the shapes make up for: it moves no joint residue.
    by_part = np.diag(fit.information).reshape(2, -1)[:, modes:] > 0
    informed = np.ones(fit.participation.shape)
    informed.reshape(-1)[fit.free] = by_part.all(axis=0)
    for i, entries in enumerate(fit.participation[:, members]):
        real = np.concatenate([entries.real, -entries.imag])
        imaginary = np.concatenate([entries.imag, entries.real])
        total += float(np.sum(np.einsum("a,oab,b->o", real, own, real)))
        total += float(np.sum(np.einsum("a,oab,b->o", imaginary, own, imaginary)))
        change = sum(
            entry * errors.modes[m].shape + informed[i, m] * fit.shapes[:, 0, [m]] * errors.modes[m].participation[i]
            for entry, m in zip(entries, members, strict=True)
        )
        shared += float(np.sum(np.abs(change) ** 2))
    return float(np.sqrt((total + shared) / fit.participation[:, 0].size / len(fit.shapes)))


def _distances(
    fit: Fit, group: Int[np.ndarray, "pole"], resonant: Bool[np.ndarray, "pole"]
) -> tuple[Float[np.ndarray, "pole"], Float[np.ndarray, "pole"]]:
    """Distance in Hz of each pole to the nearest ``resonant`` one of another group: of those with the same
    participation, in the complex plane; and of those with the same or with a damping three times as large or small, in
    frequency.
    """
    frequencies, damping = natural_frequencies(fit.poles), np.maximum(damping_ratios(fit.poles), 1e-9)
    alike = macs(fit.participation.T) > 0.9
    other = (group[:, None] != group) & resonant
    # A wide mode over a narrow one, or the reverse, is no repeated root.
    unlike = np.abs(np.log(damping[:, None] / damping)) > np.log(3)
    plane = np.where(other & alike, np.abs(fit.poles[:, None] - fit.poles) / (2 * np.pi), np.inf)
    along = np.where(other & (alike | unlike), np.abs(frequencies[:, None] - frequencies), np.inf)
    return plane.min(axis=1, initial=np.inf), along.min(axis=1, initial=np.inf)


def _parts(
    fit: Fit,
    reach: Float[np.ndarray, "pole"],
    group: Int[np.ndarray, "pole"],
    resonant: Bool[np.ndarray, "pole"],
    undetermined: Bool[np.ndarray, "pole"],
    energy: Float[np.ndarray, "pole"],
) -> Bool[np.ndarray, "pole"]:
    """Poles of ``undetermined`` damping within ``reach`` [Hz] of a resonance of the same participation, or it within
    theirs: parts of one peak, which a linear fit takes several of where the resonance changes with amplitude. What is
    determined is no part, nor is the pole with the most energy.
    """
    alike = (macs(fit.participation.T) > 0.9) & (group[:, None] != group)
    distance = np.abs(fit.poles[:, None] - fit.poles) / (2 * np.pi)
    one_place = alike & (distance < np.maximum(reach[:, None], reach))
    parts = np.zeros(len(undetermined), bool)
    candidates = np.flatnonzero(undetermined & resonant)
    for pole in candidates[np.argsort(energy[candidates], kind="stable")]:
        others = resonant & ~parts & one_place[pole]
        parts[pole] = bool(np.any(others & (~undetermined | (energy > energy[pole]))))
    return parts


def _confidence(
    fit: Fit,
    errors: PoleErrors,
    group: Int[np.ndarray, "pole"],
    resonant: Bool[np.ndarray, "pole"],
    *,
    damping: Float[np.ndarray, "pole"],
    limit: float,
) -> Float[np.ndarray, "pole"]:
    """Probability that a mode decays, is nearest to itself and has its own shape, with a scatter below ``limit``."""
    tiny = 1e-300
    frequencies = natural_frequencies(fit.poles)
    other = (macs(fit.participation.T) > 0.9) & (group[:, None] != group) & resonant
    apart = np.where(other, np.abs(frequencies[:, None] - frequencies), np.inf).min(axis=1, initial=np.inf)
    nearest = scipy.special.erf(apart / (2 * np.sqrt(2) * np.maximum(errors.frequency, tiny)))
    ratio = damping / (np.sqrt(2) * np.maximum(errors.damping, tiny))
    decaying = 0.5 * (1 + scipy.special.erf(ratio))
    # Errors of a few poles make most of the scatter of a shape: chi-square with few degrees of freedom.
    shape = scipy.special.gammainc(_SHAPE_FREEDOM / 2, _SHAPE_FREEDOM / 2 * limit / np.maximum(errors.scatter, tiny))
    single = np.bincount(group, minlength=len(group) + 1)[group] == 1
    return np.asarray(nearest * decaying * np.where(single, shape, 1.0))
