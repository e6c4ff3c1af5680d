"""`ema joint`: one friction law for numbers and sentences about a structure, and what cannot hold together."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ema.cli.common import Json, Limit, jsonable, save_pictures, split_formats, status
from ema.cli.ending import ends_well
from ema.cli.option_groups import Reporting, grouped
from ema.messages import checked_language

if TYPE_CHECKING:
    from ema.show.joint_result import JointResult

IN_ENGLISH = Reporting()
"""Default: a report as a page in English."""


@ends_well
@grouped
def joint(
    file: Annotated[Path, typer.Argument(help="A joint.toml, or the folder that holds it.", show_default=False)],
    seed: Annotated[int, typer.Option("--seed", help="The same seed gives the same draws.", min=0)] = 0,
    out: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for what is written [joints/NAME].")
    ] = None,
    report: Reporting = IN_ENGLISH,
    limit: Limit = "error",
    json: Json = False,
) -> int:
    """Find one friction law for all that was measured or said, and name what it determines and what it contradicts."""
    from ema.cli import screen
    from ema.compare.joint_law import joint_posterior
    from ema.compare.joint_result import joint_result
    from ema.compare.joint_statements import KIND, load
    from ema.study.study import make_folder

    wanted, spoken = split_formats(report.formats), checked_language(report.language)
    statements = load(file)
    folder = out or Path("joints") / KIND.locate(file).resolve().parent.name
    make_folder(folder)
    with screen.Bars() as bars:
        result = joint_result(statements, joint_posterior(statements, seed, bars), file, seed)
    written = _write(result, folder, wanted, spoken)
    document = _document(result)
    if json:
        screen.as_json(jsonable(document | {"written": [str(path) for path in written]}))
    else:
        _print(document)
        screen.show_findings(screen.console(), result.findings)
        screen.show_written(screen.console(), written)
    return status(result.findings, limit)


def _write(result: "JointResult", folder: Path, formats: Sequence[str], language: str) -> list[Path]:
    """Pictures and report."""
    from ema import report, show

    pictures = {"joint_statements": show.joint_statements(result), "joint_parameters": show.joint_parameters(result)}
    if result.hammer is not None:
        pictures["hammer_readings"] = show.hammer_readings(result)
    written = save_pictures(folder, pictures)
    report.write(result, folder / "joint.html", formats, language)
    return [*written, *(folder / f"joint.{name}" for name in formats)]


def _document(result: "JointResult") -> dict[str, Any]:
    from ema.report.joint import answers
    from ema.study.plain import finding

    weight = result.weight
    return {
        "title": result.title,
        "parameters": [
            {
                "name": one.name,
                "low": one.interval[0],
                "high": one.interval[1],
                "prior": list(one.prior),
                "over_prior": one.narrowing,
                "determined": one.determined,
                "combination": one.combination,
            }
            for one in result.parameters
        ],
        "statements": [
            {
                "sentence": one.sentence,
                "quantity": one.quantity,
                **jsonable({"low": one.predicted[0], "high": one.predicted[1], "probability": one.probability}),
                "verdict": one.verdict,
            }
            for one in result.statements
        ],
        "weight_of_one_joint": None if weight is None else weight.weight,
        "weight_interval": [None, None] if weight is None else [weight.low, weight.high],
        "experiments": [
            {"name": one.name, "one": list(one.one), "two": list(one.two), "separates": one.separates}
            for one in result.experiments
        ],
        "laws": [
            {"name": one.name, "weight": one.weight, "low": one.low, "high": one.high, "verdict": one.verdict}
            for one in result.laws
        ],
        "law_experiments": [
            {
                "name": one.name,
                "outcomes": dict(zip(one.laws, map(list, one.outcomes), strict=True)),
                "separates": one.separates,
            }
            for one in result.law_experiments
        ],
        "lift_off": _limit(result),
        "sentence": " ".join(answers(result)),
        "findings": [finding(one) for one in result.findings],
    }


def _limit(result: "JointResult") -> dict[str, Any] | None:
    known = result.lift_off
    if known is None:
        return None
    ends = {"force": known.force, "lowest": known.lowest, "limit": known.limit}
    listed = {name: [None if end != end else end for end in values] for name, values in ends.items()}
    return listed | {"reached": known.reached}


def _print(document: dict[str, Any]) -> None:
    from ema.cli import screen

    out = screen.console()
    names = ("parameter", "95 % from", "to", "width / prior", "determined")
    rows: list[Any] = [
        (
            row["name"],
            *(f"{row[name]:.4g}" for name in ("low", "high")),
            f"{row['over_prior']:.2f}",
            "yes" if row["determined"] else "no",
        )
        for row in document["parameters"]
    ]
    out.print(screen.table(names, rows, document["title"], left=names, whole=()))
    names = ("quantity", "95 % from", "to", "probability", "verdict")
    rows = []
    for row in document["statements"]:
        chance = row["probability"]
        values = ("-",) * 3 if chance is None else (f"{row['low']:.4g}", f"{row['high']:.4g}", f"{chance:.2g}")
        rows.append((row["quantity"], *values, row["verdict"]))
    out.print(screen.table(names, rows, "What was said, and what all others predict", left=names, whole=()))
    if document["experiments"]:
        columns = ("measurement", "one joint", "two joints", "decides")
        rows = [
            (
                row["name"],
                *(f"{low:.3g} to {high:.3g}" for low, high in (row["one"], row["two"])),
                f"{row['separates']:.0%}",
            )
            for row in document["experiments"]
        ]
        title = "What would decide between one joint and two"
        out.print(screen.table(columns, rows, title, left=columns, whole=()))
    out.print(document["sentence"], soft_wrap=True)
