"""What is indexed of a campaign: its ``campaign.toml`` and the results that ``ema run`` kept; no signal is read."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from acquisition import campaign_file, quantities
from ema import store
from ema.data import Finding, JointForce
from ema.data.modal import COVERAGE_FACTOR, damping_ratios, natural_frequencies
from ema.errors import EmaError, InputError
from ema.file_names import safe_name
from ema.fingerprint import of_files

CURRENT, OLDER, NOT_ANALYSED = "current", "older", "not analysed"
"""State of a run: analysed with the present campaign file, with an earlier one, or not at all."""


@dataclass(frozen=True, kw_only=True)
class Source:
    """Where a campaign and the results of its study are.

    Parameters
    ----------
    study : Path
        The recipe, or the folder of the campaign where there is none.
    campaign : Path
        Folder of the campaign, or its ``campaign.toml``.
    kept : Path
        Folder of the finished runs.
    result : Path
        Result file of the whole study.

    Examples
    --------
    >>> source = Source(study=Path("a"), campaign=Path("a"), kept=Path("a/_build/a"), result=Path("a/_build/a.h5"))
    >>> source.file.name
    'campaign.toml'
    """

    study: Path
    campaign: Path
    kept: Path
    result: Path

    @property
    def file(self) -> Path:
        """The campaign file."""
        is_file = self.campaign.suffix.lower() == ".toml"
        return self.campaign if is_file else self.campaign / campaign_file.FILE_NAME


def seen(source: Source) -> dict[str, Any]:
    """Where a campaign is, and size and time of what was indexed of it."""
    return {
        "study": str(source.study.resolve()),
        "campaign": str(source.file.resolve()),
        "kept": str(source.kept.resolve()),
        "result": str(source.result.resolve()),
        "state": state(source.file, source.kept, source.result),
    }


def state(file: Path, kept: Path, result: Path) -> list[list[int] | None]:
    """Size and time of the campaign file and the result, and the time of the folder of finished runs."""
    return [_status(file), _status(kept, size=False), _status(result)]


def _status(path: Path, size: bool = True) -> list[int] | None:
    """Size in bytes (0 without ``size``) and time of a file or folder in ns; ``None`` where there is none."""
    try:
        status = path.stat()
    except OSError:
        return None
    return [status.st_size if size else 0, status.st_mtime_ns]


def record_of(source: Source) -> dict[str, Any]:
    """Return what is indexed of a campaign, as what JSON can hold; SI, fractions, bounds of 95 % intervals.

    Raises
    ------
    InputError : there is no campaign, or its file is wrong.
    """
    described = campaign_file.load(source.file)
    print_ = of_files([source.file])
    header = described.campaign
    results = dict(_kept_results(source))
    unreadable = [finding for result in results.values() for finding in result.get("unreadable", [])]
    whole = _whole_study(source.result)
    runs = [_run(run, results.get(safe_name(run.id)), print_) for run in described.runs]
    known = {safe_name(run.id) for run in described.runs}
    maps = [result for name, result in sorted(results.items()) if name not in known and "points" in result]
    mapped = {name for chart in maps for name in chart["runs"]}
    levels = {mode["name"]: mode for mode in whole["levels"]}
    for run in runs:
        if run["state"] == NOT_ANALYSED and (run["id"] in mapped or run["id"] in levels):
            run["state"] = CURRENT
    return {
        "name": header.name,
        "structure": header.structure,
        "operator": header.operator,
        "date": header.date,
        "comment": header.comment,
        "file": print_,
        "runs": runs,
        "maps": maps,
        "levels": [levels[name] for name in sorted(levels)],
        "findings": whole["findings"] + unreadable,
    }


def _run(run: campaign_file.RunTable, result: dict[str, Any] | None, print_: str) -> dict[str, Any]:
    """A run as the campaign file has it, or as it was analysed."""
    stated = {
        "id": run.id,
        "kind": run.kind,
        "level": None if run.level is None else _number(quantities.measure(run.level, "force")[0]),
        "joints": [_stated_joint(force) for force in run.normal_force],
        "repeat": run.repeat,
        "state": NOT_ANALYSED,
        "data": [],
        "version": "",
        "modes": [],
        "findings": [],
    }
    if run.beam and not stated["joints"]:
        stated["joints"] = [{"joint": "beam", "mean": None, "std": None, "drift": None}]
    if result is None or "modes" not in result:
        return stated
    current = result.pop("file") == print_
    return stated | result | {"state": CURRENT if current else OLDER}


def _stated_joint(force: campaign_file.NormalForceTable) -> dict[str, Any]:
    mean = None if force.value is None else _number(quantities.measure(force.value, "force")[0])
    std = None if force.std is None else _number(quantities.measure(force.std, "force")[0])
    return {"joint": force.joint, "mean": mean, "std": std, "drift": None}


def _kept_results(source: Source) -> Iterator[tuple[str, dict[str, Any]]]:
    """The finished runs and maps in the folder of a study, by the names of their files."""
    if not source.kept.is_dir():
        return
    for path in sorted(source.kept.glob("*.h5")):
        try:
            yield path.stem, _kept_result(path, source)
        except EmaError as error:
            yield path.stem, {"unreadable": [_unreadable(path, error)]}


def _unreadable(path: Path, error: EmaError) -> list[str]:
    message = f"a kept result cannot be read and was not indexed ({error.what})."
    return _finding(Finding("warning", "kept-unreadable", path.name, message, advice="Run `ema run` again."))


_OF_RUN = ("run.id", "run.condition", "modes.poles", "modes.covariance", "modes.confidence", "findings")
_OF_MAP = (
    "name",
    "runs",
    "findings",
    *(
        f"chart.{name}"
        for name in ("force_levels", "normal_forces", "frequency", "frequency_std", "damping", "damping_std")
    ),
)


def _kept_result(path: Path, source: Source) -> dict[str, Any]:
    """One finished run or map."""
    made = store.load_fields(path, "inputs", "versions", name="made")
    inputs, versions = dict(made["inputs"]), dict(made["versions"])
    try:
        result = store.load_fields(path, *_OF_RUN, name="result")
    except InputError:
        return _map(store.load_fields(path, *_OF_MAP, name="result"))
    condition = result["run.condition"]
    data = sorted(digest for what, digest in made["inputs"] if what not in (source.file.name, source.study.name))
    return {
        "kind": condition.excitation.kind,
        "level": _number(condition.excitation.level),
        "joints": [_joint(joint) for joint in condition.joints],
        "file": inputs.get(source.file.name, ""),
        "data": data,
        "version": versions.get("friction-ema", ""),
        "modes": _modes(result["modes.poles"], result["modes.covariance"], result["modes.confidence"]),
        "findings": [_finding(one) for one in result["findings"]],
    }


def _modes(poles: np.ndarray, covariance: np.ndarray | None, confidence: np.ndarray | None) -> list[list[Any]]:
    """Frequency with bounds, damping ratio with bounds, confidence of every mode."""
    values = np.stack([natural_frequencies(poles), damping_ratios(poles)], axis=1)
    half = np.full(values.shape, np.nan)
    if covariance is not None:
        half = COVERAGE_FACTOR * np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    sure = np.full(len(poles), np.nan) if confidence is None else confidence
    return [
        [*_bounds(value[0], own[0]), *_bounds(value[1], own[1]), _number(one)]
        for value, own, one in zip(values, half, sure, strict=True)
    ]


def _bounds(value: float, half: float) -> list[float | None]:
    return [_number(value), _number(value - half), _number(value + half)]


def _map(chart: dict[str, Any]) -> dict[str, Any]:
    """The conditions of a map in which there is a mode: F_E, F_N, frequency and damping with bounds."""
    frequency, damping = chart["chart.frequency"], chart["chart.damping"]
    stds = {
        name: np.full(frequency.shape, np.nan) if chart[f"chart.{name}"] is None else chart[f"chart.{name}"]
        for name in ("frequency_std", "damping_std")
    }
    points = [
        [
            _number(chart["chart.force_levels"][row]),
            _number(chart["chart.normal_forces"][column]),
            *_bounds(frequency[row, column], COVERAGE_FACTOR * stds["frequency_std"][row, column]),
            *_bounds(damping[row, column], COVERAGE_FACTOR * stds["damping_std"][row, column]),
        ]
        for row, column in np.argwhere(np.isfinite(frequency) & np.isfinite(damping))
    ]
    findings = [_finding(one) for one in chart["findings"]]
    return {"name": chart["name"], "runs": list(chart["runs"]), "points": points, "findings": findings}


def _whole_study(path: Path) -> dict[str, Any]:
    """Findings of a whole study and its modes over their amplitude; nothing where it has not ended."""
    nothing: dict[str, Any] = {"findings": [], "levels": []}
    if not path.is_file():
        return nothing
    try:
        study = store.load_fields(path, "findings", "amplitude_modes")
    except EmaError as error:
        return nothing | {"findings": [_unreadable(path, error)]}
    return {
        "findings": [_finding(one) for one in study["findings"]],
        "levels": [_levels(mode) for mode in study["amplitude_modes"]],
    }


def _levels(mode: Any) -> dict[str, Any]:
    """A mode over its amplitude."""
    bands = [array for band in (mode.frequency, mode.damping) for array in (band.value, band.low, band.high)]
    force = np.full(len(mode.amplitude), np.nan) if mode.force is None else mode.force
    points = [[_number(value) for value in row] for row in zip(mode.amplitude, force, *bands, strict=True)]
    joints = [_joint(joint) for joint in mode.condition.joints]
    return {"name": mode.name, "quantity": mode.quantity, "joints": joints, "points": points}


def _joint(joint: JointForce) -> dict[str, Any]:
    return {
        "joint": joint.joint,
        "mean": _number(joint.mean),
        "std": _number(joint.std),
        "drift": _number(joint.drift),
    }


def _finding(finding: Finding) -> list[str]:
    return [finding.severity, finding.code, finding.where, finding.message]


def _number(value: float | None) -> float | None:
    """A number for JSON, which knows no NaN."""
    return None if value is None or not math.isfinite(value) else float(value)
