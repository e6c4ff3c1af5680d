"""What `ema check` looks at: a run up to its FRFs, and what the phases of its modes say of its channels."""

from dataclasses import dataclass
from typing import Any

from rich.console import Console
from rich.table import Table

from ema.cli.screen import show_findings, table
from ema.data import AmplitudeDependentMode, Campaign, Finding, FrfSet, HitGallery, JointForce, Run
from ema.errors import EmaError
from ema.progress import Progress
from ema.study import chain
from ema.study.measured import frfs_of
from ema.study.plain import amplitude_lines, amplitude_mode, finding, joint, number
from ema.study.recipe import EstimateTable, FitTable


@dataclass(frozen=True)
class Checked:
    """A run, its FRFs, its impacts where it has some, the mode over its amplitude of stepped levels, all findings.

    A ring-down has neither FRFs nor levels.
    """

    run: Run
    frfs: FrfSet | None
    hits: HitGallery | None
    findings: tuple[Finding, ...]
    mode: AmplitudeDependentMode | None = None


QUICK = 100_000
"""Values (lines times FRFs) up to which FRFs are fitted for the delays of their channels. Tests of two to five points
take 0.7 s more (median of 50, at most 3 s); what larger ones take depends on their modes more than on their size.
A check with twice the limit names late channels of twice as many points."""


def checked(run: Run, settings: EstimateTable, progress: Progress, fit: FitTable | None = None) -> Checked:
    """Estimate the FRFs of a run and collect what a reader has to know."""
    from ema.estimate import amplitude_dependent_mode, quality

    if run.levels:
        mode = amplitude_dependent_mode(run.levels, name=run.id, condition=run.condition)
        return Checked(run, None, None, chain.unique(run.findings + mode.findings), mode)
    if run.kind == "snap-back" and not run.frfs:
        return Checked(run, None, None, chain.unique((*run.findings, chain.ring_down_finding(run))))
    if run.kind == "unknown" and not run.frfs:
        return Checked(run, None, None, chain.unique((*run.findings, chain.excitation_finding(run))))
    frfs, hits = frfs_of(run, settings, progress)
    turned = _turned(frfs, hits, fit or FitTable(), progress)
    return Checked(run, frfs, hits, chain.unique(run.findings + frfs.findings + quality(frfs, None, hits) + turned))


def _turned(frfs: FrfSet, hits: HitGallery | None, fit: FitTable, progress: Progress) -> tuple[Finding, ...]:
    """Channels that are late or filtered, by the modes of the band; none where FRFs are many or cannot be fitted."""
    from ema.estimate import without_dead

    inside = frfs.band(*(fit.band or chain.default_band(frfs, hits)))
    if inside.values.size > QUICK:
        return ()
    try:
        _, modes = chain.fitted(without_dead(inside), fit, progress)
    except EmaError:  # `ema run` says what hinders a fit; a check goes on with the next run
        return ()
    return tuple(one for one in modes.findings if one.code in ("channel-delay", "channel-high-pass"))


def as_mapping(campaign: Campaign, runs: list[Checked]) -> dict[str, Any]:
    """The check as what JSON can hold."""
    return {
        "campaign": campaign.name,
        "structure": campaign.structure,
        "operator": campaign.operator,
        "date": campaign.date,
        "comment": campaign.comment,
        "channels": [_channel(one) for one in campaign.channels],
        "findings": [finding(one) for one in campaign.findings],
        "runs": [
            {
                "run": one.run.id,
                "kind": one.run.kind,
                "records": len(one.run.recordings),
                **({} if one.frfs is None else _frfs(one.frfs)),
                **({} if one.mode is None else {"levels": amplitude_mode(one.mode)}),
                "temperature": number(one.run.condition.temperature),
                "joints": [joint(each) for each in one.run.condition.joints],
                "hits": None if one.hits is None else {"all": len(one.hits.hits), "used": len(one.hits.accepted)},
                "repairs": [vars(repair) for repair in one.run.repairs],
                "findings": [finding(each) for each in one.findings],
            }
            for one in runs
        ],
    }


def _frfs(frfs: FrfSet) -> dict[str, Any]:
    return {
        "outputs": [str(dof) for dof in frfs.outputs],
        "inputs": [str(dof) for dof in frfs.inputs],
        "frequencies": [float(frfs.frequencies[0]), float(frfs.frequencies[-1])],
        "frequency_step": frfs.frequency_step,
        "quantity": frfs.quantity,
        "unit": frfs.unit,
    }


def show(out: Console, campaign: Campaign, runs: list[Checked]) -> None:
    """Print the check for people.

    Parameters
    ----------
    out : Console
        Console that prints.
    campaign : Campaign
        The campaign: its head, its channels and its findings come first.
    runs : list of Checked
        The checked runs, printed one below the other.
    """
    out.print(campaign.name, style="bold")
    for what in ("structure", "operator", "date", "comment"):
        if text := getattr(campaign, what):
            out.print(f"{what}: {text}")
    if campaign.channels:
        out.print(_channel_table(campaign))
    show_findings(out, campaign.findings)
    for one in runs:
        out.print()
        out.print(f"Run {one.run.id}", style="bold")
        for line in _lines(one):
            out.print(line, soft_wrap=True)
        show_findings(out, one.findings)


def _lines(one: Checked) -> list[str]:
    frfs, condition = one.frfs, one.run.condition
    joints = "; ".join(_force(joint) for joint in condition.joints) or "no beam"
    lines = [f"excitation: {one.run.kind}", f"normal force: {joints}"]
    if condition.temperature is not None:
        lines.append(f"temperature: {condition.temperature - 273.15:.1f} degC")
    if one.hits is not None:
        low, high = one.hits.usable_band
        lines.append(
            f"impacts: {len(one.hits.accepted)} of {len(one.hits.hits)} used; force spectrum down 10 dB at {low:.0f} "
            f"Hz, 20 dB at {high:.0f} Hz"
        )
    if one.mode is not None:
        lines += [f"levels: {len(one.run.levels)}, controlled: {one.mode.control}", *amplitude_lines(one.mode)]
    if frfs is None:
        return lines
    lines.append(
        f"FRFs: {len(frfs.outputs)} responses x {len(frfs.inputs)} forces, {frfs.quantity} in {frfs.unit}, "
        f"{frfs.frequencies[0]:g} to {frfs.frequencies[-1]:g} Hz in steps of {frfs.frequency_step:.4g} Hz"
    )
    lines += [f"repair: {each.what}, {each.where}: {each.why} ({each.who})" for each in one.run.repairs]
    return lines


def _force(joint: JointForce) -> str:
    if not joint.known:
        return f"{joint.joint} unknown"
    spread = "" if joint.std != joint.std else f" +- {joint.std:.0f}"
    drift = "" if joint.drift != joint.drift else f", drift {joint.drift:+.0f} N"
    return f"{joint.joint} {joint.mean:.0f}{spread} N{drift}"


def _channel(channel: Any) -> dict[str, Any]:
    return {
        "name": channel.name,
        "role": channel.role,
        "quantity": channel.quantity,
        "unit": channel.unit,
        "dof": None if channel.dof is None else str(channel.dof),
        "range": number(channel.range),
        "serial": channel.serial,
        "calibrated_on": channel.calibrated_on,
    }


def _channel_table(campaign: Campaign) -> Table:
    names = ("name", "role", "quantity", "unit", "DOF", "range", "serial", "calibrated")
    rows = [
        (
            one.name,
            one.role,
            one.quantity,
            one.unit,
            "" if one.dof is None else one.dof,
            "" if one.range is None else f"{one.range:g}",
            one.serial,
            one.calibrated_on,
        )
        for one in campaign.channels
    ]
    return table(names, rows, "Channels (of the first record)", left=names, whole=())
