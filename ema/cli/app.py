"""The commands. Each parses, calls, prints; heavy modules are imported when a command needs them."""

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import ema
from ema.cli import (
    archiving,
    beginning,
    browsing,
    comparing,
    joining,
    mapping,
    placing,
    predicting,
    recording,
    simulating,
)
from ema.cli.common import Formats, Jobs, Json, LimitOfRecipe, split_formats, status
from ema.cli.ending import FINDINGS, FINE, ends_well
from ema.cli.option_groups import Reading, Reporting, Work, grouped
from ema.errors import InputError

if TYPE_CHECKING:
    from ema.data import Finding, Geometry, ModalModel
    from ema.fit.opinion import SecondOpinion
    from ema.study import Study
    from ema.study.recipe import FitTable

app = typer.Typer(
    name="ema",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    # markup of rich takes "[[map]]" for a style and prints nothing in its place
    rich_markup_mode=None,
    help="Experimental modal analysis where joints and friction matter.",
    context_settings={"help_option_names": ["-h", "--help"]},
)

app.add_typer(simulating.app)
app.add_typer(archiving.app)
app.add_typer(browsing.app)
app.add_typer(recording.app)
app.command()(beginning.init)
app.command()(comparing.compare)
app.command()(placing.place)
app.command("map")(mapping.make_map)
app.command()(predicting.predict)
app.command()(joining.joint)

Output = Annotated[Path | None, typer.Option("--output", "-o", help="Folder for what is written.")]
Measurement = Annotated[
    Path,
    typer.Argument(help="A campaign's folder or campaign.toml, a recipe, or a file with FRFs.", show_default=False),
]
AS_STORED, OF_STUDY = Reading(), Reporting(language="")
"""Defaults: files as they stand; a report in the language of the study."""
ANEW = Work()
"""Default: on this machine, nothing taken over."""


@dataclass(frozen=True)
class ModesWanted:
    """Which modes are fitted, in place of what the recipe says."""

    near: Annotated[list[float] | None, typer.Option(help="Take the mode near this frequency in Hz (repeat).")] = None
    order: Annotated[int | None, typer.Option(help="Highest model order.", min=2)] = None
    band: Annotated[tuple[float, float] | None, typer.Option(help="Lowest and highest frequency in Hz.")] = None

    def over(self, given: dict[str, Any]) -> dict[str, Any]:
        """Keys of a recipe's fit, with these in their place; modes by frequency replace those by number."""
        given = given | ({} if self.band is None else {"band": self.band})
        given |= {} if self.order is None else {"orders": (2, self.order, 2)}
        if self.near:
            given = {name: value for name, value in given.items() if name != "index"} | {"near": self.near}
        return given


OF_RECIPE = ModesWanted()
"""Default: as the recipe says."""


def _version(wanted: bool) -> bool:
    if wanted:
        print(f"friction-ema {ema.__version__}")
        raise typer.Exit
    return wanted


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


@app.command()
@ends_well
@grouped
def run(
    recipe: Measurement,
    output: Output = None,
    work: Work = ANEW,
    report: Reporting = OF_STUDY,
    limit: LimitOfRecipe = None,
    reading: Reading = AS_STORED,
    json: Json = False,
) -> int:
    """Do a whole study: signals to modes, expectations and a report."""
    from ema.messages import checked_language
    from ema.study import Study

    others = [name for name in split_formats(report.formats) if name != "html"]
    study = reading.of(Study.load(recipe, output))
    if report.language:
        spoken = study.recipe.model_copy(update={"language": checked_language(report.language)})
        study = replace(study, recipe=spoken)
    return _done(study, others, work, limit=limit, json=json)


@app.command()
@ends_well
def demo(
    folder: Annotated[
        Path | None, typer.Argument(help="Where the files are written; by default the user's cache folder.")
    ] = None,
    name: Annotated[str, typer.Option("--name", help="Which demonstration; see --list.")] = "table_placement",
    listing: Annotated[bool, typer.Option("--list", help="Print the demonstrations and end.")] = False,
    jobs: Jobs = None,
    json: Json = False,
) -> int:
    """Do the main job on a virtual work table: from a hammer test to the place of a friction beam and a report."""
    from ema import datasets
    from ema.cli import screen
    from ema.study import Study, recipe

    if listing:
        titles = {one: recipe.load(datasets.recipe_file(one)).title for one in datasets.recipes()}
        if json:
            screen.as_json(titles)
        else:
            for one, title in titles.items():
                print(f"{one:22}{title}")
        return FINE
    written = datasets.fetch_recipe(name, folder)
    study = Study.load(written)
    status = _done(study, [], Work(jobs, resume=study.kept.is_dir()), limit=None, json=json)
    if not json:
        print(f"Recipe: {written}\nCampaign: {study.campaign.resolve() / 'campaign.toml'}")
        print("Nothing here was measured on hardware: the signals are those of a virtual rig.")
        print(
            f"Next: `ema app {study.result}` opens the result in a browser; `ema init FOLDER` begins with your files."
        )
    return status


def _done(study: "Study", others: list[str], work: Work, *, limit: str | None, json: bool) -> int:
    """Do a study and show its result; the exit status."""
    from ema.cli import screen
    from ema.cli.cluster import workers
    from ema.study import summary

    processes = (work.jobs or os.cpu_count() or 1) if study.recipe.placement else 1
    with screen.Bars() as bars, workers(work.cluster, processes) as executor:
        result = study.run(progress=bars, resume=work.resume, executor=executor)
        if others:
            from ema.report import write

            write(result, study.report, others, study.recipe.language, executor=executor)
    if json:
        screen.as_json(summary(result) | {"report": str(study.report), "result": str(study.result)})
    else:
        screen.show_result(screen.console(), result, study.report)
    findings = [*result.findings, *(finding for one in result.runs for finding in one.findings)]
    missed = any(not expectation.met for expectation in result.expectations)
    return FINDINGS if missed else status(findings, limit or study.recipe.finding_limit)


@app.command()
@ends_well
@grouped
def check(
    campaign: Measurement,
    run: Annotated[list[str] | None, typer.Option("--run", help="Only this run (may be repeated).")] = None,
    limit: LimitOfRecipe = None,
    reading: Reading = AS_STORED,
    json: Json = False,
) -> int:
    """Say what was measured, under which conditions, and what is wrong with it; no modes."""
    from ema.cli import checking, screen
    from ema.compare import repeat_findings
    from ema.study import Study

    study = reading.of(Study.load(campaign))
    with screen.Bars() as bars:
        opened = study.open(bars)
        opened = replace(opened, findings=opened.findings + repeat_findings(opened.runs))
        runs = [opened[name] for name in run] if run else list(opened.runs)
        checked = [checking.checked(one, study.recipe.estimate, bars, study.recipe.fit) for one in runs]
    if json:
        screen.as_json(checking.as_mapping(opened, checked))
    else:
        checking.show(screen.console(), opened, checked)
    findings = [*opened.findings, *(finding for one in checked for finding in one.findings)]
    return status(findings, limit or study.recipe.finding_limit)


@app.command()
@ends_well
@grouped
def fit(
    measurement: Measurement,
    run: Annotated[list[str] | None, typer.Option("--run", help="Only this run (may be repeated).")] = None,
    wanted: ModesWanted = OF_RECIPE,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Write the modes to this file (.uff, .unv or .h5).")
    ] = None,
    second: Annotated[
        bool, typer.Option("--second-opinion", help="Compare with ERA, an estimator in the time domain.")
    ] = False,
    limit: LimitOfRecipe = None,
    reading: Reading = AS_STORED,
    json: Json = False,
) -> int:
    """Fit the modes of one run or file and print them."""
    from ema import fit as fitting
    from ema.cli import screen
    from ema.estimate import quality, without_dead
    from ema.study import Study, chain
    from ema.study.measured import frfs_of

    study = reading.of(Study.load(measurement))
    settings = _settings(wanted.over(study.recipe.fit.given()))
    models: dict[str, ModalModel] = {}
    measured: dict[str, tuple[Finding, ...]] = {}
    opinions: dict[str, SecondOpinion] = {}
    with screen.Bars() as bars:
        opened = study.open(bars)
        for one in [opened[name] for name in run] if run else opened.runs:
            frfs, hits = frfs_of(one, study.recipe.estimate, bars)
            inside = without_dead(frfs.band(*(settings.band or chain.default_band(frfs, hits))))
            models[one.id] = chain.fitted(inside, settings, bars)[1]
            measured[one.id] = chain.unique(one.findings + frfs.findings + quality(inside, models[one.id], hits))
            if second:
                opinions[one.id] = fitting.second_opinion(models[one.id], inside, bars)
                findings = models[one.id].findings + opinions[one.id].findings
                models[one.id] = replace(models[one.id], findings=findings)
    if output is not None:
        _write_modes(output, models, opened.geometry)
    if json:
        screen.as_json(_as_mapping(models, opinions))
    else:
        _print_modes(models, opinions, measured)
    return status([finding for model in models.values() for finding in model.findings], limit or "never")


@app.command()
@ends_well
def report(
    result: Annotated[
        Path,
        typer.Argument(
            help="What `ema run`, `place`, `compare`, `map`, `predict` or `simulate` stored (.h5).", show_default=False
        ),
    ],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="The file to write.")] = None,
    formats: Formats = "",
    language: Annotated[
        str, typer.Option("--language", help="Of the report: en or de; by default that of the study.")
    ] = "",
    json: Json = False,
) -> int:
    """Write the report of a stored result: a study, a placement, a comparison, a map, a prediction, a simulation."""
    from ema import store
    from ema.cli import screen
    from ema.report import write

    wanted = split_formats(formats)
    path = write(store.load(result), output or result.with_suffix(".html"), wanted, language)
    if json:
        screen.as_json({"report": str(path)})
    else:
        print(f"Report: {path}")
    return FINE


@app.command()
@ends_well
def explain(
    code: Annotated[str, typer.Argument(help="Code of a finding, such as double-hit; all of them without one.")] = "",
    json: Json = False,
) -> int:
    """Say what a finding means, and which page of the docs tells more."""
    from dataclasses import asdict

    from ema.cli import listing, screen
    from ema.messages import explain as explained
    from ema.messages import kinds

    chosen = [explained(code)] if code else list(kinds().values())
    if json:
        screen.as_json([asdict(kind) for kind in chosen])
    elif code:
        print(f"{chosen[0].meaning}\nMore in docs/{chosen[0].page}.md.")
    else:
        screen.console().print(listing.kinds_as_table(chosen))
    return FINE


@app.command()
@ends_well
def formats(json: Json = False) -> int:
    """List the file formats that can be read and written."""
    import acquisition
    from ema.cli import listing, screen

    if json:
        screen.as_json(listing.formats_as_list(acquisition.formats()))
    else:
        screen.console().print(listing.formats_as_table(acquisition.formats()))
    return FINE


@app.command()
@ends_well
def doctor(json: Json = False) -> int:
    """Say what works on this machine, and the command that fixes what does not."""
    from ema.cli import doctor, listing, screen

    with screen.Bars() as bars:
        checks = doctor.examine(bars)
    if json:
        screen.as_json({"checks": [vars(one) for one in checks], "repair": doctor.repair(checks)})
    else:
        listing.show_checks(screen.console(), checks, doctor.repair(checks))
    return FINE if all(one.works or not one.needed for one in checks) else FINDINGS


def _settings(given: dict[str, Any]) -> "FitTable":
    """The options of the command line, checked like those of a recipe."""
    from pydantic import ValidationError

    from ema.study.recipe import FitTable

    try:
        return FitTable(**given)
    except ValidationError as error:
        detail = error.errors()[0]
        raise InputError(
            str(detail.get("ctx", {}).get("error", detail["msg"])),
            where="options of ema fit",
            advice="`ema fit --help` lists them",
        ) from error


def _as_mapping(models: "dict[str, ModalModel]", opinions: "dict[str, SecondOpinion]") -> dict[str, Any]:
    """The modes of each run as what JSON can hold, with the second opinion where there is one."""
    from ema.study.plain import modes, opinion

    if not opinions:
        return {name: modes(model) for name, model in models.items()}
    return {name: {"modes": modes(model), "second opinion": opinion(opinions[name])} for name, model in models.items()}


def _print_modes(
    models: "dict[str, ModalModel]",
    opinions: "dict[str, SecondOpinion]",
    measured: "dict[str, tuple[Finding, ...]]",
) -> None:
    """Tables of the modes of each run, of the second opinion where there is one, and the findings."""
    from ema.cli import screen

    out = screen.console()
    for name, model in models.items():
        out.print(screen.mode_table(model, name))
        if name in opinions:
            out.print(screen.opinion_table(opinions[name], name))
        screen.show_findings(out, model.findings)
        screen.show_findings(out, [finding for finding in measured[name] if finding.severity != "info"])


def _write_modes(path: Path, models: "dict[str, ModalModel]", geometry: "Geometry | None") -> None:
    """To our own format or to a foreign one, by the suffix."""
    if path.suffix.lower() == ".h5":
        from ema import store

        store.save(path, models)
    else:
        import acquisition

        acquisition.write(path, *models.values(), *([] if geometry is None else [geometry]))
