"""Numbers that a recipe expects, against those that were measured."""

import numpy as np

from ema.data import Expectation, ForecastCheck, Placement, RunResult, Statement
from ema.errors import InputError
from ema.place.recipe import PlaceRecipe
from ema.study.recipe import ExpectTable


def check(tables: list[ExpectTable], runs: tuple[RunResult, ...]) -> tuple[Expectation, ...]:
    """Compare every expectation of a recipe with the results.

    Parameters
    ----------
    tables : tables ``[[expect]]``, each about one run: frequencies, other values, findings.
    runs : results of the study.

    Returns
    -------
    One entry for each value or finding that was expected, met or not, in the order of the tables.

    Raises
    ------
    InputError : an expectation is about a run that the study does not have.
    """
    results = {result.run.id: result for result in runs}
    compared: list[Expectation] = []
    for table in tables:
        if table.run not in results:
            raise InputError(
                "an expectation is about a run that is not in the study",
                where="[[expect]]",
                got=table.run,
                expected="one of " + ", ".join(results),
            )
        compared += _frequencies(table, results[table.run])
        compared += _others(table, results[table.run])
        compared += _findings(table, results[table.run])
    return tuple(compared)


def of_verdicts(statements: tuple[Statement, ...]) -> tuple[Expectation, ...]:
    """Whether every statement got the verdict that the recipe states: 1 where it did."""
    return tuple(one.expectation for one in statements)


def _frequencies(table: ExpectTable, result: RunResult) -> list[Expectation]:
    found, damping = result.modes.natural_frequencies, 100 * result.modes.damping_ratios
    compared = []
    for number, expected in enumerate(table.natural_frequencies):
        nearest = int(np.argmin(np.abs(found - expected))) if len(found) else None
        what = f"{table.run}: natural frequency near {expected:g} Hz [Hz]"
        compared.append(_compare(what, expected, table.tolerance, np.nan if nearest is None else found[nearest]))
        if table.damping_percent:
            value = table.damping_percent[number]
            what = f"{table.run}: damping ratio near {expected:g} Hz [%]"
            tolerance = table.damping_tolerance * value
            compared.append(_compare(what, value, tolerance, np.nan if nearest is None else damping[nearest]))
    return compared


def _others(table: ExpectTable, result: RunResult) -> list[Expectation]:
    """The number of modes in a band, where the expected ones are to be the only ones."""
    if table.only is None:
        return []
    low, high = table.only
    frequencies = result.modes.natural_frequencies
    inside = float(np.sum((frequencies >= low) & (frequencies <= high)))
    expected = float(sum(low <= frequency <= high for frequency in table.natural_frequencies))
    return [_compare(f"{table.run}: number of modes from {low:g} to {high:g} Hz", expected, 0.0, inside)]


def _findings(table: ExpectTable, result: RunResult) -> list[Expectation]:
    compared = []
    for code in table.findings:
        count = sum(finding.code == code for finding in result.findings)
        compared.append(Expectation(f"{table.run}: finding {code} (at least one)", 1.0, 0.0, float(count), count >= 1))
    return compared


def of_placement(
    recipe: str | PlaceRecipe, placement: Placement | None, checked: ForecastCheck | None
) -> tuple[Expectation, ...]:
    """The best place, its normal force, and how many measured values lie in their bands, where the recipe says."""
    if isinstance(recipe, str) or recipe.expect is None or placement is None:
        return ()
    expected, best, result = recipe.expect, placement.ranking.best, []
    if expected.centre is not None:
        pairs = zip("xy", expected.centre, best.centre, strict=True)
        result += [
            _compare(f"best place: {axis} of the middle [m]", one, expected.within, at) for axis, one, at in pairs
        ]
    if expected.normal_force is not None:
        tolerance = 0.01 * expected.normal_force
        result.append(_compare("best place: F_N [N]", expected.normal_force, tolerance, best.normal_force))
    if expected.inside is not None:
        inside = 0 if checked is None else checked.inside
        result.append(
            Expectation(
                "measured values inside their bands (at least)",
                float(expected.inside),
                0.0,
                float(inside),
                inside >= expected.inside,
            )
        )
    return tuple(result)


def _compare(what: str, expected: float, tolerance: float, measured: float) -> Expectation:
    measured = float(measured)
    return Expectation(what, expected, tolerance, measured, bool(abs(measured - expected) <= tolerance))
