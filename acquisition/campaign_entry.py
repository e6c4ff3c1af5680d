"""What a recorded run says about itself in ``campaign.toml``, which belongs to its owner once it is written."""

import json
from dataclasses import dataclass
from pathlib import Path

from acquisition import campaign_file, units
from acquisition.assignment import data_folder
from acquisition.live.take_files import RAW
from acquisition.rig_file import RigFile, wires
from ema.errors import InputError
from ema.store.atomic import replacing


def run_ids(folder: Path) -> tuple[str, ...]:
    """The runs of the campaign in a folder; none where there is no campaign yet.

    Raises
    ------
    InputError : there is one that cannot be understood, with its line.
    """
    path = folder / campaign_file.FILE_NAME
    return tuple(run.id for run in campaign_file.load(path).runs) if path.is_file() else ()


@dataclass(frozen=True)
class Levels:
    """Force level of a shaker and normal force of every joint in N at which a run is measured; ``None`` where open."""

    force: float | None = None
    normal_force: float | None = None


def refuse_other_levels(folder: Path, run: str, levels: Levels) -> None:
    """A run is measured at one force level and one normal force.

    Raises
    ------
    InputError : the campaign states another one, or cannot be understood.
    """
    path = folder / campaign_file.FILE_NAME
    begun = campaign_file.load(path).runs if path.is_file() and levels != Levels() else ()
    for one in begun:
        if one.id != run:
            continue
        stated = [("force level", one.level, levels.force)]
        stated += [("normal force", joint.nominal, levels.normal_force) for joint in one.normal_force]
        for name, text, level in stated:
            before = None if text is None else units.measure(text, "force")[0]
            if level is not None and before is not None and abs(before / level - 1) > 1e-9:
                raise InputError(
                    f"run {run} was begun at another {name}",
                    where=str(path),
                    got=f"{level:g} N",
                    expected=f"{before:g} N",
                    advice="give the run at this level another name",
                )


def add_run(folder: Path, rig: RigFile, run: str, levels: Levels) -> str:
    """Add a run that has takes to the campaign, or begin the campaign with it; what stands there stays.

    Parameters
    ----------
    levels : at which the run was measured.

    Returns
    -------
    What the owner has to know: the campaign has a run of this name, whose files are not all takes of it.

    Raises
    ------
    InputError : the campaign cannot be understood, or takes its files from elsewhere.
    FailureError : it cannot be written.
    """
    path = folder / campaign_file.FILE_NAME
    if not path.is_file():
        text = _head(folder, rig) + _channels(rig, "channels") + _joints(rig, set()) + _entry(rig, run, "", levels)
    else:
        text = path.read_text(encoding="utf-8")
        described = campaign_file.parse(text, str(path))
        # the pattern names the files of this run, whatever its owner has called it since
        prefix = _prefix(folder, described.campaign.files)
        if any(_pattern(run, prefix) == entry.file for one in described.runs for entry in one.files):
            return ""
        if any(one.id == run for one in described.runs):
            return f'run {run} of {path.name} takes other files than files = "{_pattern(run, prefix)}"'
        text += "" if text.endswith("\n") else "\n"
        text += _joints(rig, {joint.name for joint in described.joints}) + _entry(rig, run, prefix, levels)
        if described.channels and [one.name for one in described.channels] != [one.name for one in rig.channels]:
            text += "\n" + _channels(rig, "runs.channels")
    campaign_file.parse(text, str(path))
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return ""


def _prefix(folder: Path, files: str) -> str:
    """How the campaign reaches the takes from the folder of its files."""
    data, raw = data_folder(files, folder.resolve()), (folder / RAW).resolve()
    if not raw.is_relative_to(data):
        raise InputError(
            "the campaign takes its files from elsewhere",
            where=str(folder / campaign_file.FILE_NAME),
            got=str(data),
            expected=f"{RAW} or a folder around it",
            advice="record into a folder of its own",
        )
    inner = raw.relative_to(data).as_posix()
    return "" if inner == "." else f"{inner}/"


def _pattern(run: str, prefix: str) -> str:
    return f"{prefix}{run}_{{point}}_{{take}}.h5"


def _entry(rig: RigFile, run: str, prefix: str, levels: Levels) -> str:
    kind = {"kind": "hammer"}
    if rig.shaker is not None:
        level = "" if levels.force is None else f"{levels.force:.12g} N"
        kind = {"kind": "stepped sine", "period": rig.shaker.stay, "level": level}
    text = f"\n[[runs]]\nid = {_quoted(run)}\n{_lines(kind)}files = {_quoted(_pattern(run, prefix))}\n"
    if levels.normal_force is None:
        return text
    for channel in rig.channels:
        if channel.role == "normal force":
            nominal = f"{levels.normal_force:.12g} N"
            stated = {"joint": channel.joint, "channel": channel.name, "nominal": nominal}
            text += f"\n[[runs.normal_force]]\n{_lines(stated)}"
    return text


def _head(folder: Path, rig: RigFile) -> str:
    about = rig.campaign
    stated = {
        "name": about.name or folder.resolve().name or "campaign",
        "structure": about.structure,
        "operator": about.operator,
        "comment": about.comment,
        "files": RAW,
    }
    return "[campaign]\n" + _lines(stated) + "\n"


def _channels(rig: RigFile, table: str) -> str:
    text = ""
    for wire, channel in zip(wires(rig), rig.channels, strict=True):
        stated = {
            "name": wire.channel.name,
            "role": wire.channel.role,
            "quantity": wire.channel.quantity,
            "unit": wire.channel.unit,
            "dof": channel.dof,
            "serial": channel.serial,
            "range": channel.range or "",
            "calibrated_on": channel.calibrated_on,
            "joint": channel.joint,
        }
        text += f"[[{table}]]\n{_lines(stated)}\n"
    return text


def _joints(rig: RigFile, known: set[str]) -> str:
    text = ""
    for joint in rig.joints:
        if joint.name not in known:
            stated = {"name": joint.name, "load_cell": joint.load_cell, "calibrated_on": joint.calibrated_on}
            text += f"\n[[joints]]\n{_lines(stated)}"
    return text


def _lines(stated: dict[str, str]) -> str:
    return "".join(f"{name} = {_quoted(text)}\n" for name, text in stated.items() if text)


def _quoted(text: str) -> str:
    """As a TOML string: a JSON string but for the one control character that JSON leaves alone."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
