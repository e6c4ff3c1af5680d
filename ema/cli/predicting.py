"""`ema predict`: frequency and damping at amplitudes that were not measured, from the levels that were."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ema.cli.common import Json, Limit, save_pictures, status
from ema.cli.ending import ends_well
from ema.errors import InputError

if TYPE_CHECKING:
    from ema.data import AmplitudeDependentMode, AmplitudePrediction


@ends_well
def predict(
    measured: Annotated[Path, typer.Argument(help="A campaign with stepped levels, or a mode that `ema map` wrote.")],
    amplitude: Annotated[list[str], typer.Option(help="Amplitude with its unit, such as '60 m/s^2' (repeat).")],
    run: Annotated[str, typer.Option("--run", help="The run of stepped levels, where there are several.")] = "",
    up_to: Annotated[
        str, typer.Option("--up-to", help="Fit levels up to this amplitude; higher ones confirm or refute.")
    ] = "",
    out: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for what is written [predicted/NAME].")
    ] = None,
    limit: Limit = "error",
    json: Json = False,
) -> int:
    """Predict frequency and damping over the amplitude, with 95 % bands and how far outside the data they lie."""
    from ema import show, store
    from ema.cli import screen
    from ema.compare import confirmed, predict_amplitudes
    from ema.file_names import safe_name
    from ema.study.plain import amplitude_lines, prediction
    from ema.study.study import make_folder

    mode = _mode(measured, run)
    fitted = mode
    if up_to:
        fitted = mode.lowest(int((mode.amplitude <= _in_si(up_to, mode.quantity) * 1.01).sum()))
    found = predict_amplitudes(fitted, sorted(_in_si(text, mode.quantity) for text in amplitude))
    inside, held = confirmed(found, mode) if up_to else (0, 0)
    folder = out or Path("predicted") / measured.resolve().stem
    make_folder(folder)
    stem = safe_name(mode.name or "mode")
    written = [folder / f"{stem}_prediction.h5"]
    store.save(written[0], {"mode": fitted, "prediction": found})
    written += save_pictures(folder, {f"{stem}_prediction": show.amplitude_modes([mode], [found])})
    if json:
        tested = {"held_out": held, "inside": inside} if up_to else None
        screen.as_json(prediction(found) | {"confirmed": tested, "written": [str(path) for path in written]})
    else:
        _print(found, [*amplitude_lines(found)], (inside, held) if up_to else None)
        screen.console().print("Written: " + ", ".join(str(path) for path in written), soft_wrap=True)
    return status(list(found.findings), limit)


def _in_si(text: str, quantity: str) -> float:
    """An amplitude with its unit, in SI.

    Raises
    ------
    InputError : no unit, or that of another quantity.
    """
    from acquisition.quantities import measure

    try:
        float(text)
    except ValueError:
        return float(measure(text, quantity)[0])
    raise InputError(
        "an amplitude without a unit",
        got=text,
        expected=f"a unit of {quantity}",
        advice=f"write --amplitude '{text} m/s^2', or whichever unit it is in",
    )


def _mode(path: Path, run: str) -> "AmplitudeDependentMode":
    """The mode over its amplitude of a file, or of a run of stepped levels in a campaign.

    Raises
    ------
    InputError : there is none, or several and none is named.
    """
    from ema import store
    from ema.data import AmplitudeDependentMode
    from ema.estimate import amplitude_dependent_mode
    from ema.study import Study, mapping

    if path.is_file() and store.is_store(path):
        loaded = store.load(path)
        if isinstance(loaded, AmplitudeDependentMode):
            return loaded
        raise InputError(
            "not a mode over its amplitude",
            where=str(path),
            got=type(loaded).__name__,
            expected="what `ema map` writes for stepped levels",
        )
    runs = mapping.stepped_runs(Study.load(path).open(), [run] if run else [])
    if len(runs) != 1:
        raise InputError(
            "which run of stepped levels is to be predicted from?" if runs else "no run of stepped levels",
            where=str(path),
            got=", ".join(one.id for one in runs) or run or "none",
            expected="one run with [runs.levels]",
            advice="name it by --run" if runs else "docs/campaign.md shows how levels enter a campaign",
        )
    return amplitude_dependent_mode(runs[0].levels, name=runs[0].id, condition=runs[0].condition)


def _print(found: "AmplitudePrediction", lines: list[str], tested: tuple[int, int] | None) -> None:
    from ema.cli import screen

    out = screen.console()

    def say(text: str) -> None:
        out.print(text, highlight=False, markup=False, soft_wrap=True)

    say(f"{found.name}: medians and 95 % bands, which contain {found.damping.contains}.")
    for line in lines:
        say(f"  {line}")
    say(found.statement)
    weights = sorted(zip(found.weights, found.laws, strict=True), reverse=True)
    say(
        "Laws, weighted by how they predict the highest levels from those below: "
        + ", ".join(f"{name} {weight:.2f}" for weight, name in weights)
    )
    for one in found.parameters:
        judged = "identifiable" if one.identifiable else f"not identifiable: {one.reason}"
        say(f"  {one.law}, {one.name}: {one.value:.3g} [{one.low:.3g}, {one.high:.3g}], {judged}")
    if tested is not None:
        say(f"Confirmed by held-out levels: {tested[0]} of {tested[1]} inside the bands of frequency and damping.")
    screen.show_findings(out, found.findings)
