"""A forecast against maps that were measured afterwards."""

from collections.abc import Sequence

import numpy as np

from ema.data import ModalMap
from ema.data.forecast import Forecast, ForecastCheck
from ema.errors import InputError

_MODE_TOLERANCE = 0.1
"""Largest relative distance between the median frequency of a map and that of a target mode without the beam.

The beam moves a mode by some per cent; of several target modes within reach the nearest one counts. Half of it would
refuse maps of modes that the beam moves by more than 5 %.
"""
_SAME_CONDITION = 0.05
"""Largest relative difference between a force of a map and one of the forecast that count as the same condition."""


def check(forecast: Forecast, maps: Sequence[ModalMap]) -> ForecastCheck:
    """Compare a forecast with measured maps; each map belongs to the mode whose frequency without the beam is nearest.

    Parameters
    ----------
    forecast : Forecast
        Predicted frequency [Hz] and damping ratio (mode, level, force).
    maps : sequence of ModalMap
        Measured maps, one per mode.

    Returns
    -------
    ForecastCheck
        Measured values on the grid of the forecast; NaN for conditions that no map contains.

    Raises
    ------
    InputError
        If a map belongs to no target mode, two maps to one mode, or a map has no condition of the forecast.

    Examples
    --------
    >>> from ema.examples import forecast, modal_map
    >>> comparison = check(forecast(), [modal_map()])
    >>> comparison.inside, comparison.values
    (12, 12)
    """
    measured = np.full((2, *forecast.damping.shape), np.nan)
    used: dict[int, str] = {}
    for measured_map in maps:
        where = measured_map.name or "map"
        frequency = float(np.nanmedian(measured_map.frequency))
        mode = int(np.argmin(np.abs(forecast.bare_frequencies - frequency)))
        if abs(forecast.bare_frequencies[mode] / frequency - 1) > _MODE_TOLERANCE:
            raise InputError(
                "the map belongs to none of the forecast's target modes",
                where=where,
                got=f"median frequency {frequency:.1f} Hz",
                expected=f"within {_MODE_TOLERANCE:.0%} of "
                + ", ".join(f"{f:.1f} Hz" for f in forecast.bare_frequencies),
                advice="leave this map out, or add its mode to the target modes of the placement",
            )
        if mode in used:
            raise InputError("two maps of one mode", where=where, got=used[mode], expected="one map per mode")
        used[mode] = where
        levels = _rows(forecast.force_levels, measured_map.force_levels)
        forces = _rows(forecast.normal_forces, measured_map.normal_forces)
        pairs = [(i, j, a, b) for i, a in enumerate(levels) for j, b in enumerate(forces) if a >= 0 and b >= 0]
        if not pairs:
            raise InputError(
                "the map holds none of the conditions of the forecast",
                where=where,
                got=f"F_E {measured_map.force_levels.tolist()} N, F_N {measured_map.normal_forces.tolist()} N",
                expected=f"F_E {forecast.force_levels.tolist()} N, F_N {forecast.normal_forces.tolist()} N",
            )
        for i, j, a, b in pairs:
            measured[:, mode, i, j] = measured_map.frequency[a, b], measured_map.damping[a, b]
    return ForecastCheck(forecast, measured[0], measured[1], tuple(used[mode] for mode in sorted(used)))


def _rows(wanted: np.ndarray, known: np.ndarray) -> list[int]:
    """Row of ``known`` within 5 % of each wanted value, -1 where there is none."""
    result = []
    for value in wanted:
        row = int(np.argmin(np.abs(known - value)))
        result.append(row if abs(known[row] - value) <= _SAME_CONDITION * value else -1)
    return result
