"""`ema predict` from stepped levels, or from draws that were kept: at amplitudes, and under forces."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ema.cli.common import status, write_csv
from ema.errors import InputError

if TYPE_CHECKING:
    from ema.cli.prediction_request import FromLevels, Wanted
    from ema.data import (
        AmplitudeDependentMode,
        AmplitudeDraws,
        AmplitudePrediction,
        Finding,
        ForcedResonances,
        ForcedResponse,
    )


def of_levels(wanted: "Wanted", asked: "FromLevels", force: Sequence[str]) -> int:
    """Predict at amplitudes, and under forces, from stepped levels or from draws that were kept."""
    from ema.cli import screen

    source = _source(wanted.measured, asked)
    amplitudes = sorted(_in_si(text, source.quantity) for text in asked.amplitude or ())
    forces = sorted(_force(text) for text in force)
    draws = source.draws(forces)
    at = source.predicted(draws, amplitudes) if amplitudes else None
    under = _under(draws, forces) if draws is not None and forces else None
    written = _written(wanted, source, draws, at, under)
    findings = [*(at.findings if at is not None else source.findings), *(under.findings if under is not None else ())]
    findings = list({(one.code, one.where, one.message): one for one in findings}.values())
    tested = source.tested(at)
    if wanted.json:
        screen.as_json(_plain(at, under, tested) | {"written": [str(path) for path in written]})
    else:
        _print(at, under, tested, findings)
        screen.show_written(screen.console(), written)
    return status(findings, wanted.limit)


@dataclass(frozen=True)
class _Source:
    """What is predicted from: levels (those fitted, and all of them), draws that were kept, or both."""

    mode: "AmplitudeDependentMode | None"
    fitted: "AmplitudeDependentMode | None"
    kept: "AmplitudeDraws | None"
    modal_mass: float | None
    up_to: bool

    @property
    def _first(self) -> "AmplitudeDependentMode | AmplitudeDraws":
        known = self.kept or self.mode
        assert known is not None
        return known

    @property
    def quantity(self) -> str:
        """What amplitudes measure."""
        return self._first.quantity

    @property
    def name(self) -> str:
        """What the mode is called."""
        return self._first.name or "mode"

    @property
    def findings(self) -> "tuple[Finding, ...]":
        """What is said of the levels."""
        return () if self.mode is None else self.mode.findings

    def draws(self, forces: list[float]) -> "AmplitudeDraws | None":
        """Draws over the amplitude: those kept, or new ones. None where no law reaches as far and no force is asked."""
        from ema.compare import amplitude_draws

        if self.kept is not None:
            if self.modal_mass is None:
                return self.kept
            return replace(self.kept, modal_mass=np.full(len(self.kept.frequency), self.modal_mass))
        assert self.fitted is not None
        if forces and self.modal_mass is None and not np.isfinite(self.fitted.modal_mass):
            raise InputError(
                "no force without a modal mass",
                where=self.name,
                expected="the modal mass for a shape of 1 at the response",
                advice="give --modal-mass '2 kg': 1 over the modal constant of the FRF from the force to the response",
            )
        try:
            return amplitude_draws(self.fitted, modal_mass=self.modal_mass)
        except InputError:
            if forces:
                raise
            return None

    def predicted(self, draws: "AmplitudeDraws | None", amplitudes: list[float]) -> "AmplitudePrediction":
        """Frequency and damping at amplitudes."""
        from ema.compare import predict_amplitudes, predict_from_draws

        if self.kept is not None and draws is not None:
            return predict_from_draws(draws, amplitudes)
        assert self.fitted is not None
        found = predict_amplitudes(self.fitted, amplitudes)
        return replace(found, findings=(*self.findings, *found.findings))

    def tested(self, at: "AmplitudePrediction | None") -> tuple[int, int] | None:
        """Levels held out that lie inside the bands, and how many there are; None where none was held out."""
        from ema.compare import confirmed

        if not self.up_to or self.mode is None:
            return None
        return (0, 0) if at is None else confirmed(at, self.mode)


@dataclass(frozen=True)
class _Under:
    """What forces do: resonances, and the response to each."""

    resonances: "ForcedResonances"
    responses: "tuple[ForcedResponse, ...]"

    @property
    def findings(self) -> "tuple[Finding, ...]":
        """What is said of both."""
        return (*self.resonances.findings, *(one for response in self.responses for one in response.findings))


def _under(draws: "AmplitudeDraws", forces: list[float]) -> _Under:
    """Resonances and responses at forces."""
    from ema.compare import forced_resonances, forced_response

    return _Under(forced_resonances(draws, forces), tuple(forced_response(draws, force) for force in forces))


def _written(
    wanted: "Wanted",
    source: _Source,
    draws: "AmplitudeDraws | None",
    at: "AmplitudePrediction | None",
    under: _Under | None,
) -> list[Path]:
    """The files of a prediction: all in one file, a picture of each kind, and a table of each response."""
    from ema import show
    from ema.compare import force_surface
    from ema.file_names import safe_name
    from ema.report.prediction_tables import RESPONSE_COLUMNS, response_rows

    contents: dict[str, Any] = {"mode": source.fitted, "draws": draws, "prediction": at}
    if source.up_to:
        contents["measured"] = source.mode
    figures = {}
    stem = safe_name(source.name)
    if at is not None:
        figures[f"{stem}_prediction"] = show.amplitude_modes([source.mode] if source.mode else [], [at])
    if draws is not None and under is not None:
        surface = force_surface(draws)
        contents |= {"resonances": under.resonances, "surface": surface}
        contents |= {f"response_{n + 1}": response for n, response in enumerate(under.responses)}
        figures[f"{stem}_responses"] = show.forced_responses(under.responses)
        figures[f"{stem}_force_surface"] = show.force_surface(surface)
    written = wanted.written(stem, {name: one for name, one in contents.items() if one is not None}, figures)
    for response in () if under is None else under.responses:
        written.append(wanted.folder / f"{stem}_response_{response.force[0]:.4g}_N.csv")
        write_csv(written[-1], RESPONSE_COLUMNS, response_rows(response))
    return written


def _plain(at: "AmplitudePrediction | None", under: _Under | None, tested: tuple[int, int] | None) -> dict[str, Any]:
    """The prediction as what JSON can hold."""
    from ema.study.plain import prediction
    from ema.study.plain_forced import resonances

    plain: dict[str, Any] = {} if at is None else prediction(at)
    if at is not None or tested is not None:
        plain["confirmed"] = None if tested is None else {"held_out": tested[1], "inside": tested[0]}
    return plain if under is None else plain | {"under_force": resonances(under.resonances, under.responses)}


def _source(path: Path, asked: "FromLevels") -> _Source:
    """What is predicted from.

    Raises
    ------
    InputError : the path holds neither levels nor draws, or draws are to be cut by --up-to.
    """
    from acquisition.quantities import measure

    mass = float(measure(asked.modal_mass, "mass")[0]) if asked.modal_mass else None
    kept = _kept(path)
    if kept is not None:
        if asked.up_to or asked.run:
            raise InputError(
                "draws that were kept belong to the levels they were fitted to",
                where=str(path),
                got="--up-to" if asked.up_to else "--run",
                advice="give the campaign or the mode that `ema map` wrote",
            )
        return _Source(kept[0], kept[0], kept[1], mass, up_to=False)
    mode = _mode(path, asked.run)
    return _Source(mode, _fitted(mode, asked.up_to) if asked.up_to else mode, None, mass, up_to=bool(asked.up_to))


def _kept(path: Path) -> "tuple[AmplitudeDependentMode | None, AmplitudeDraws] | None":
    """Levels and draws of an earlier prediction; None where the file is none."""
    from ema import store
    from ema.data import AmplitudeDependentMode, AmplitudeDraws
    from ema.store.reading import containers

    if not (path.is_file() and store.is_store(path)):
        return None
    items = containers(path)
    draws = [item for item in items if isinstance(item, AmplitudeDraws)]
    modes = [item for item in items if isinstance(item, AmplitudeDependentMode)]
    if not draws:
        return None
    # the file may hold all measured levels beside those that were fitted
    return next((mode for mode in modes if np.array_equal(mode.amplitude, draws[0].levels)), None), draws[0]


def _force(text: str) -> float:
    """A force with its unit in N.

    Raises
    ------
    UnitError : no unit, or that of another quantity.
    """
    from acquisition.quantities import measure

    return float(measure(text, "force")[0])


def _fitted(mode: "AmplitudeDependentMode", up_to: str) -> "AmplitudeDependentMode":
    """The levels up to an amplitude.

    Raises
    ------
    InputError : fewer than two of them, or all.
    """
    count = int((mode.amplitude <= _in_si(up_to, mode.quantity) * 1.01).sum())
    if 2 <= count < len(mode.amplitude):
        return mode.lowest(count)
    from ema.units import SI_UNIT

    raise InputError(
        "--up-to leaves fewer than two levels to fit" if count < 2 else "--up-to leaves no level out",
        where=mode.name,
        got=f"--up-to '{up_to}'",
        expected="an amplitude from the second level to below the highest one; there are "
        + ", ".join(f"{amplitude:.4g}" for amplitude in mode.amplitude)
        + f" {SI_UNIT[mode.quantity]}",
    )


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
    every = mapping.stepped_runs(Study.load(path).open(), [])
    runs = [one for one in every if not run or fnmatch(one.id, run)]
    if len(runs) != 1:
        raise InputError(
            "which run of stepped levels is to be predicted from?" if every else "no run of stepped levels",
            where=str(path),
            got=f"{f'--run {run}' if run else 'no --run'}; there are {', '.join(one.id for one in every) or 'none'}",
            expected="one run with [runs.levels]",
            advice="name it by --run" if every else "docs/campaign.md shows how levels enter a campaign",
        )
    return amplitude_dependent_mode(runs[0].levels, name=runs[0].id, condition=runs[0].condition)


def _print(
    at: "AmplitudePrediction | None",
    under: _Under | None,
    tested: tuple[int, int] | None,
    findings: "Sequence[Finding]",
) -> None:
    """What was predicted, for people."""
    from ema.cli import screen
    from ema.study.plain import amplitude_lines
    from ema.study.plain_forced import resonance_lines

    out = screen.console()

    def say(text: str) -> None:
        out.print(text, soft_wrap=True)

    if at is not None:
        say(f"{at.name or 'The mode'}: medians and 95 % bands, which contain {at.damping.contains}.")
        for line in amplitude_lines(at):
            say(f"  {line}")
        for line in (at.statement, *_laws(at)):
            say(line)
    if under is not None:
        found = under.resonances
        say(
            f"{found.name or 'The mode'}, under forces: medians and 95 % bands, which contain {found.damping.contains}."
        )
        for line in resonance_lines(found):
            say(f"  {line}")
        say(found.statement)
    if tested is not None and not tested[1]:
        say("No level that was held out has one of these amplitudes: nothing confirms the prediction.")
    elif tested is not None:
        say(f"Confirmed by held-out levels: {tested[0]} of {tested[1]} inside the bands of frequency and damping.")
    screen.show_findings(out, findings)


def _laws(at: "AmplitudePrediction") -> list[str]:
    """What is said of the laws and their parameters."""
    weights = sorted(zip(at.weights, at.laws, strict=True), reverse=True)
    if not weights:
        return []
    return [
        "Laws, weighted by how they predict the highest levels from those below: "
        + ", ".join(f"{name} {weight:.2f}" for weight, name in weights),
        *(
            f"  {one.law}, {one.name}: {one.value:.3g} [{one.low:.3g}, {one.high:.3g}], "
            + ("identifiable" if one.identifiable else f"not identifiable: {one.reason}")
            for one in at.parameters
        ),
    ]
