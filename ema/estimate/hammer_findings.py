"""What a reader of a hammer test has to know."""

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence

import numpy as np

from ema.data import Finding
from ema.dof import Dof
from ema.estimate import impact_choice
from ema.estimate.block_end import LEFT_OVER, STRONGEST, RingDown
from ema.estimate.judge import ONE_LEVEL, Judged
from ema.estimate.levels import LevelEffect, pooled_effect
from ema.messages import mark

NONLINEAR = 0.05
"""Change of the FRFs over the range of levels above which the structure is called nonlinear."""

SIGNIFICANT = 4.0
"""Power that follows the level over power that does not, above which the change is not chance."""

SWEEP_LEFT_OVER = 0.2
"""Response at the end of a sweep's record relative to its rms that betrays leakage."""

_ADVICE = {
    "double-hit": mark("Repeat the impact if the point has too few left."),
    "overload": mark("Raise the range of the channel or strike more softly."),
    "pre-trigger": mark("Start the record earlier: at least 5 % of the block before the impact."),
    "next-impact": mark("Wait longer between the impacts."),
    "early-impact": mark("Wait longer between the impacts."),
    "level": "",
    "excluded-impact": "",
}
_REMARKS = {
    "under-range": (
        mark("{count} of {total} impacts below 10 % of the full scale of {channel} (worst {worst} %)."),
        mark("Lower the range of the channel or strike harder."),
    ),
    "not-at-rest": (
        mark("{count} of {total} impacts while still moving: {channel} (worst {worst} %)."),
        mark("Wait until the structure is at rest before the next impact."),
    ),
    "dc-shift": (
        mark("{count} of {total} impacts with a lasting shift of the mean of {channel} (worst {worst} %)."),
        mark("Check the sensor's mounting and range: it was overloaded."),
    ),
}


def about_impacts(judged: Sequence[Judged], where: str) -> list[Finding]:
    """One finding per impact with a fault, one for small further contacts, one per kind of remark and channel."""
    return [*_about_faults(judged, where), *_about_contacts(judged, where), *_about_remarks(judged, where)]


def _about_faults(judged: Sequence[Judged], where: str) -> Iterator[Finding]:
    """What each impact with a fault is used for."""
    for one in judged:
        if one.clean and one.used:
            continue
        for reason in sorted(one.reasons, key=lambda reason: -reason.error)[:1]:
            yield Finding.of(
                "info" if one.asked else "warning",
                reason.code,
                f"{where}, {one.record}, point {one.dof}, impact {one.index}",
                "used although it has a fault: {reason}." if one.used else "not used: {reason}.",
                abs(one.pulse.peak),
                advice="{remedy}" if one.used or one.asked else "{remedy} `keep` in the settings uses it all the same.",
                reason=reason.text,
                remedy=_ADVICE[reason.code],
            )


def _about_contacts(judged: Sequence[Judged], where: str) -> Iterator[Finding]:
    """Further contacts too small to count as faults."""
    small = [one.second.ratio for one in judged if one.clean and one.used and one.second is not None]
    if small:
        yield Finding.of(
            "info",
            "double-hit",
            where,
            "{count} of {total} impacts have further contacts of {least} to {most} % of the peak; they "
            "are part of the measured force.",
            max(small),
            ONE_LEVEL,
            advice="They do not bias the FRFs of a linear structure.",
            count=len(small),
            total=len(judged),
            least=f"{100 * min(small):.2g}",
            most=f"{100 * max(small):.2g}",
        )


def _about_remarks(judged: Sequence[Judged], where: str) -> Iterator[Finding]:
    """How many impacts each kind of remark is about, by channel."""
    counted: dict[tuple[str, str], list[tuple[float, float]]] = defaultdict(list)
    for one in judged:
        for remark in one.remarks:
            counted[remark.code, remark.channel].append((remark.value, remark.limit))
    for (code, channel), values in counted.items():
        text, advice = _REMARKS[code]
        low = code == "under-range"
        worst = min(values)[0] if low else max(values)[0]
        yield Finding.of(
            "info" if len(values) < 0.1 * len(judged) else "warning",
            code,
            f"{where}, channel {channel}",
            text,
            worst,
            values[0][1],
            advice=advice,
            count=len(values),
            total=len(judged),
            channel=channel,
            worst=f"{100 * worst:.1f}",
        )


def about_force(judged: Sequence[Judged], where: str) -> list[Finding]:
    """Sign and pre-trigger of the force."""
    findings = []
    negative = sum(one.pulse.peak < 0 for one in judged)
    if negative:
        findings.append(
            Finding.of(
                "warning",
                "force-sign",
                where,
                "{negative} of {total} impacts are negative pulses.",
                float(negative),
                0.0,
                advice=(
                    "A hammer can only push: reverse the sign of the force channel by a repair, unless its DOF "
                    "points against the impact on purpose."
                ),
                negative=negative,
                total=len(judged),
            )
        )
    short = sum(one.before < 4 for one in judged)
    if short:
        findings.append(
            Finding.of(
                "warning",
                "pre-trigger",
                where,
                "{short} of {total} impacts have no pre-trigger.",
                float(short),
                0.0,
                advice="Start the record earlier: offset and noise of the channels are unknown.",
                short=short,
                total=len(judged),
            )
        )
    return findings


def about_points(judged: Sequence[Judged], where: str) -> list[Finding]:
    """Points without impacts, points whose impacts all have faults, and points with a single one."""
    used = {dof: [one for one in judged if one.dof == dof and one.used] for dof in dict.fromkeys(o.dof for o in judged)}
    findings = []
    lost = [dof for dof, own in used.items() if not own]
    if lost:
        findings.append(
            Finding.of(
                "error",
                "lost-point",
                where,
                "no impact is left at {points}.",
                float(len(lost)),
                0.0,
                advice="These points are missing in the FRFs: measure them again.",
                points=_list(lost),
            )
        )
    for biased in (True, False):
        doubtful = [
            dof
            for dof, own in used.items()
            if own and not any(one.clean for one in own) and any(one.biased for one in own) == biased
        ]
        if doubtful:
            faults = sorted({reason.code for dof in doubtful for one in used[dof] for reason in one.reasons})
            effect = "the FRFs there are biased" if biased else "the force is not that of a single contact"
            findings.append(
                Finding(
                    "error" if biased else "warning",
                    "best-effort",
                    where,
                    f"every impact at {_list(doubtful)} has a fault ({', '.join(faults)}): the best of them are used, "
                    f"{effect}.",
                    float(len(doubtful)),
                    0.0,
                    "Measure these points again before anything is concluded from them."
                    if biased
                    else "Look at the force signals; repeat the point if its joints slip.",
                )
            )
    single = [dof for dof, own in used.items() if len(own) == 1]
    if single:
        findings.append(
            Finding.of(
                "warning",
                "one-average",
                where,
                "one impact only at {points}: the coherence is 1 by definition.",
                1.0,
                3.0,
                advice="Strike each point three to five times.",
                points=_list(single),
            )
        )
    return findings


def about_selection(judged: Sequence[Judged], selection: Sequence[str], where: str) -> list[Finding]:
    """Entries of ``keep`` and ``reject`` that this run has no impact for."""
    return [
        Finding.of(
            "info",
            "selection",
            where,
            "no impact of this run is called {entry}.",
            advice="Impacts are called by record or point and their number from 0, such as '12:+Z#3'.",
            entry=f"{entry!r}",
        )
        for entry in impact_choice.unmatched(judged, selection)
    ]


def about_swap(swapped: Sequence[tuple[str, str]], records: int, where: str) -> list[Finding]:
    """Force and response channels that were probably exchanged, as (force, response) of each record that shows it."""
    if not len(swapped) > 0.5 * records:
        return []
    (force, response), count = Counter(swapped).most_common(1)[0]
    return [
        Finding.of(
            "error",
            "swapped-channels",
            where,
            "in {count} of {records} records the force channel {force} rings like a response and the "
            "response channel {response} is a pulse like a force: the two are probably exchanged.",
            float(count),
            0.5 * records,
            advice="Exchange the roles of {force} and {response} in campaign.toml.",
            count=count,
            records=records,
            force=force,
            response=response,
        )
    ]


def about_window(ring: RingDown, used: float, asked: bool, where: str) -> list[Finding]:
    """Leakage and the exponential window."""
    findings = []
    if used > 0 and not asked:
        findings.append(
            Finding.of(
                "info",
                "exponential-window",
                where,
                "{left} % of the response is left at the end of the block; an exponential window adds a "
                "decay of {decay} 1/s, which the fit takes off exactly.",
                ring.left_over,
                LEFT_OVER,
                advice="Longer blocks need no window.",
                left=f"{100 * ring.left_over:.0f}",
                decay=f"{used:.3g}",
            )
        )
    if used > STRONGEST * 1.001 * ring.structural and ring.left_over > LEFT_OVER:
        findings.append(
            Finding.of(
                "warning",
                "exponential-window",
                where,
                "the window's decay of {decay} 1/s is {times} times that of the structure.",
                used / ring.structural,
                STRONGEST,
                advice="Damping is mostly the window's: use longer blocks or a weaker window.",
                decay=f"{used:.3g}",
                times=f"{used / ring.structural:.1f}",
            )
        )
    remaining = ring.left_over * float(np.exp(-used * ring_duration(ring)))
    if remaining > LEFT_OVER:
        findings.append(
            Finding.of(
                "warning",
                "leakage",
                where,
                "{remaining} % of the response is left at the end of the block in spite of the window."
                if used > 0
                else "{remaining} % of the response is left at the end of the block.",
                remaining,
                LEFT_OVER,
                advice="Measure longer blocks, or the damping is biased.",
                remaining=f"{100 * remaining:.1f}",
            )
        )
    return findings


def ring_duration(ring: RingDown) -> float:
    """Time in s over which the response decayed to what is left."""
    return float(-np.log(min(max(ring.left_over, 1e-12), 0.999)) / ring.structural)


def about_levels(effects: list[LevelEffect], bins: Sequence[tuple[float, float]], where: str) -> list[Finding]:
    """Whether the level of the impacts matters."""
    if not effects:
        return []
    effect = pooled_effect(effects)
    if effect.change < NONLINEAR or effect.ratio < SIGNIFICANT:
        return []
    levels = ", ".join(f"{low:.4g}-{high:.4g}" for low, high in bins[:4])
    return [
        Finding.of(
            "warning",
            "level-dependence",
            where,
            "the FRFs change by {change} % with the level of the impacts: the structure is not linear.",
            effect.change,
            NONLINEAR,
            advice="Use impacts of one level at a time (level = one of {levels}).",
            change=f"{100 * effect.change:.0f}",
            levels=levels,
        )
    ]


def about_band(band: tuple[float, float], highest: float, where: str) -> list[Finding]:
    """Where the force spectrum ends."""
    if band[1] >= highest:
        return []
    return [
        Finding.of(
            "info",
            "usable-band",
            where,
            "the force spectrum has fallen by 10 dB at {at_10_dB} Hz and by 20 dB at {at_20_dB} Hz; the "
            "FRFs reach to {highest} Hz.",
            band[1],
            highest,
            advice="Use the FRFs up to the -20 dB frequency, or a harder tip.",
            at_10_dB=f"{band[0]:.0f}",
            at_20_dB=f"{band[1]:.0f}",
            highest=f"{highest:.0f}",
        )
    ]


def about_units(unit: str, where: str) -> list[Finding]:
    """Units that nobody stated."""
    if unit != "unstated":
        return []
    return [
        Finding(
            "warning",
            "unit-unstated",
            where,
            "the unit of a force or response channel is not stated.",
            None,
            None,
            "Frequencies, damping and shapes are right, scaling is not: state the units in campaign.toml.",
        )
    ]


def _list(dofs: Sequence[Dof]) -> str:
    return ", ".join(map(str, dofs[:6])) + (f" and {len(dofs) - 6} more" if len(dofs) > 6 else "")
