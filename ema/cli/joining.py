"""`ema joint`: one friction law for numbers and sentences about a structure, and what cannot hold together."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ema.cli.common import Json, jsonable
from ema.cli.ending import FINE, ends_well

if TYPE_CHECKING:
    from ema.compare.joint_law import JointAssessment


@ends_well
def joint(
    file: Annotated[Path, typer.Argument(help="A joint.toml, or the folder that holds it.", show_default=False)],
    seed: Annotated[int, typer.Option("--seed", help="The same seed gives the same draws.", min=0)] = 0,
    json: Json = False,
) -> int:
    """Find one friction law for all that was measured or said, and name what it determines and what it contradicts."""
    from ema.cli import screen
    from ema.compare.joint_law import joint_posterior
    from ema.compare.joint_statements import load

    statements = load(file)
    with screen.Bars() as bars:
        posterior = joint_posterior(statements, seed, bars)
    document = _document(statements.title, posterior)
    if json:
        screen.as_json(jsonable(document))
    else:
        _print(document)
    return FINE


WITHIN_THE_MODEL = (
    "On 80 tables drawn from this model under the conditions of the paper 95 % intervals hold 91 to 94 %; under other "
    "conditions this was not counted, and what the model leaves out is not in them."
)
"""Counted (docs/joint.md: simulation-based calibration, Talts et al. 2018)."""


def _document(title: str, found: "JointAssessment") -> dict[str, Any]:
    model = found.one.model
    names = {one.name for one in model.parameters}
    return {
        "title": title,
        "parameters": [
            {
                "name": name,
                "low": low,
                "high": high,
                "over_prior": found.narrowing(name),
                "determined": found.determined(name),
                "combination": name not in names,
            }
            for name, (low, high) in found.one.interval.items()
        ],
        "statements": [
            {
                "sentence": one.datum.text,
                "quantity": one.datum.quantity,
                **jsonable({"low": one.low, "high": one.high, "probability": one.probability}),
                "verdict": one.verdict,
            }
            for one in found.held
        ],
        "weight_of_one_joint": found.weight,
        "weight_interval": list(found.weight_interval),
        "experiments": [
            {"name": one.name, "one": list(one.one), "two": list(one.two), "separates": one.separates}
            for one in found.experiments
        ],
        "sentence": sentence(found),
    }


def sentence(found: "JointAssessment") -> str:
    """What follows, in a few sentences."""
    names = [name for name in found.one.interval if found.determined(name)]
    parts = [f"Determined: {'; '.join(names)}." if names else "No parameter is determined."]
    against = [one.datum.quantity for one in found.held if one.verdict.startswith("does not")]
    if against:
        parts.append(f"These do not hold together with the others: {'; '.join(against)}.")
    if found.two is not None:
        low, high = found.weight_interval
        decided = high < 0.05 or low > 0.95
        words = (
            f"Both tests had {'one joint' if low > 0.95 else 'two joints'}"
            if decided
            else "One joint and two joints cannot be told apart"
        )
        parts.append(
            f"{words}: one joint has {found.weight:.0%} of the weight ({low:.0%} to {high:.0%} by independent runs)."
        )
        if found.experiments and not decided:
            best = found.experiments[0]
            parts.append(f"The next measurement to make is: {best.name}; it decides in {best.separates:.0%} of cases.")
    return " ".join((*parts, WITHIN_THE_MODEL))


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
