"""`ema simulate`: a model file, one of five jobs, the result in a store, its pictures, and a table."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ema.cli.common import Json, Limit, jsonable, save_pictures, status
from ema.cli.ending import ends_well
from ema.cli.simulation_job import Job
from ema.errors import InputError

if TYPE_CHECKING:
    from acquisition.model_file import ModelFile
    from ema.data import BeamModel
    from ema.progress import Progress

app = typer.Typer(name="simulate", no_args_is_help=True, help="Simulate a structure with friction joints.")


def _laws(as_json: bool) -> Callable[[bool], bool]:
    """What prints the list of friction laws and ends the command, as text or as JSON."""

    def show(wanted: bool) -> bool:
        if wanted:
            from ema.cli import listing, screen
            from ema.contact.catalogue import CATALOGUE

            laws = list(CATALOGUE.values())
            if as_json:
                screen.as_json(listing.laws_as_list(laws))
            else:
                screen.console().print(listing.laws_as_table(laws))
            raise typer.Exit
        return wanted

    return show


@app.callback()
def _options(
    laws: Annotated[
        bool, typer.Option("--laws", is_eager=True, callback=_laws(False), help="List the friction laws.")
    ] = False,
    laws_json: Annotated[
        bool, typer.Option("--laws-json", is_eager=True, callback=_laws(True), help="The same list as JSON.")
    ] = False,
) -> None:
    """Simulate a structure with friction joints."""


ModelPath = Annotated[Path, typer.Argument(help="A model.toml, or the folder that holds it.", show_default=False)]
Out = Annotated[Path | None, typer.Option("--output", "-o", help="Folder for result and pictures [simulated/NAME].")]
NormalForce = Annotated[
    list[float] | None, typer.Option("--normal-force", help="Normal force of every joint in N (may be repeated).")
]
ForceLevels = Annotated[list[float] | None, typer.Option("--force", help="Force amplitude in N (may be repeated).")]


def _ended(
    name: str,
    path: Path,
    out: Path | None,
    json: bool,
    limit: str,
    work: "Callable[[ModelFile, BeamModel, Progress], Job]",
) -> int:
    """Read the model, do the job, write, print; the status of the command."""
    import acquisition
    from acquisition import model_file
    from ema.cli import screen
    from ema.study.study import make_folder

    tables, model = model_file.load(path), acquisition.open_model(path)
    folder = out or Path("simulated") / "".join(c if c.isalnum() else "_" for c in model.name)
    make_folder(folder)
    with screen.Bars() as bars:
        job = work(tables, model, bars)
    written = _write(folder, name, model, job)
    job.findings = list(dict.fromkeys(job.findings))
    if json:
        from ema.study.plain import finding

        screen.as_json(
            {
                "model": model.name,
                "job": name,
                "rows": [jsonable(row) for row in job.rows],
                **{key: [jsonable(row) for row in rows] for key, rows in job.more.items()},
                **({"statement": job.statement} if job.statement else {}),
                "findings": [finding(one) for one in job.findings],
                "written": [str(one) for one in written],
            }
        )
    else:
        _print(f"{model.name}: {name}", job, written)
    return status(job.findings, limit)


def _write(folder: Path, name: str, model: "BeamModel", job: Job) -> list[Path]:
    """The store and the pictures."""
    from ema import store

    written = [folder / f"{name}.h5"]
    store.save(written[0], {"model": model, **job.contents})
    return [*written, *save_pictures(folder, job.pictures)]


def _print(title: str, job: Job, written: Sequence[Path]) -> None:

    from ema.cli import screen

    out = screen.console()
    for name, rows in {title: job.rows, **job.more}.items():
        out.print(screen.table(rows[0] if rows else (), (row.values() for row in rows), name))
    if job.statement:
        out.print(job.statement, soft_wrap=True)
    screen.show_findings(out, job.findings)
    screen.show_written(out, written)


def _chosen(name: str, table: Any) -> Any:
    if table is None:
        raise InputError(f"the model file has no [{name}]", advice="docs/simulate.md shows what stands there")
    return table


@app.command()
@ends_well
def snapback(
    model: ModelPath,
    load: Annotated[float | None, typer.Option("--load", help="Load in N instead of that of the file.")] = None,
    normal_force: NormalForce = None,
    duration: Annotated[float | None, typer.Option("--duration", help="s instead of that of the file.")] = None,
    reference: Annotated[
        bool, typer.Option("--reference", help="Exact from event to event (Masing-type laws), with its error.")
    ] = False,
    out: Out = None,
    json: Json = False,
    limit: Limit = "error",
) -> int:
    """Raise a load slowly, let go, and follow the free vibration."""
    from ema.cli import simulations

    return _ended(
        "snapback",
        model,
        out,
        json,
        limit,
        lambda tables, held, bars: simulations.snapback(
            _chosen("snapback", tables.snapback), held, load, normal_force, duration, reference, bars
        ),
    )


@app.command()
@ends_well
def frf(
    model: ModelPath,
    force: ForceLevels = None,
    normal_force: NormalForce = None,
    stability: Annotated[
        bool, typer.Option("--stability", help="Follow curves through their folds, and say which states are stable.")
    ] = False,
    out: Out = None,
    json: Json = False,
    limit: Limit = "error",
) -> int:
    """Steady states over frequency by harmonic balance, at one or several force levels."""
    from ema.cli import simulations

    return _ended(
        "frf",
        model,
        out,
        json,
        limit,
        lambda tables, held, bars: simulations.frf(
            _chosen("frf", tables.frf), held, force, normal_force, bars, stability=stability
        ),
    )


@app.command("map")
@ends_well
def damping_map(
    model: ModelPath,
    force: ForceLevels = None,
    normal_force: NormalForce = None,
    out: Out = None,
    json: Json = False,
    limit: Limit = "error",
) -> int:
    """Frequency and damping of a resonance over excitation and normal force."""
    from ema.cli import simulations

    return _ended(
        "map",
        model,
        out,
        json,
        limit,
        lambda tables, held, bars: simulations.damping_map(_chosen("map", tables.map), held, force, normal_force, bars),
    )


@app.command()
@ends_well
def loop(
    model: ModelPath,
    amplitude: Annotated[
        list[float] | None, typer.Option("--amplitude", help="Relative displacement in m (may be repeated).")
    ] = None,
    normal_force: NormalForce = None,
    out: Out = None,
    json: Json = False,
    limit: Limit = "error",
) -> int:
    """Hysteresis loops of a joint under prescribed motion."""
    from ema.cli import simulations

    return _ended(
        "loop",
        model,
        out,
        json,
        limit,
        lambda tables, held, bars: simulations.loops(_chosen("loop", tables.loop), held, amplitude, normal_force),
    )


@app.command()
@ends_well
def control(
    model: ModelPath,
    force: ForceLevels = None,
    normal_force: Annotated[
        list[float] | None, typer.Option("--normal-force", help="Normal force in N that is tried (may be repeated).")
    ] = None,
    out: Out = None,
    json: Json = False,
    limit: Limit = "error",
) -> int:
    """What a controlled normal force brings at a tool point: ring-down, limit of chatter, surface."""
    from ema.cli import simulations

    return _ended(
        "control",
        model,
        out,
        json,
        limit,
        lambda tables, held, bars: simulations.control(
            _chosen("control", tables.control), held, force, normal_force, bars
        ),
    )
