"""What was predicted of one mode from stepped levels, and how far it lies outside them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ema.compare import confirmed
from ema.data import (
    AmplitudeDependentMode,
    AmplitudeDraws,
    AmplitudePrediction,
    Band,
    ForcedResonances,
    ForcedResponse,
    ForceSurface,
)
from ema.messages import text
from ema.report.prediction_words import against
from ema.units import SI_UNIT


@dataclass(frozen=True)
class FromLevels:
    """What was predicted of one mode: everything that was stored of it."""

    modes: tuple[AmplitudeDependentMode, ...]
    draws: AmplitudeDraws | None
    at: tuple[AmplitudePrediction, ...]
    resonances: tuple[ForcedResonances, ...]
    responses: tuple[ForcedResponse, ...]
    surfaces: tuple[ForceSurface, ...]

    @classmethod
    def of(cls, results: Sequence[Any]) -> "FromLevels":
        """Sort the results of one mode by their kind."""

        def every(kind: type) -> tuple[Any, ...]:
            return tuple(one for one in results if isinstance(one, kind))

        modes = tuple(sorted(every(AmplitudeDependentMode), key=lambda mode: len(mode.amplitude)))
        return cls(
            modes,
            next(iter(every(AmplitudeDraws)), None),
            every(AmplitudePrediction),
            every(ForcedResonances),
            every(ForcedResponse),
            every(ForceSurface),
        )

    @property
    def fitted(self) -> AmplitudeDependentMode | None:
        """The levels that were fitted: the fewest, where all measured ones were stored too."""
        return self.modes[0] if self.modes else None

    @property
    def name(self) -> str:
        """What the mode is called."""
        return next((one.name for one in self._every if one.name), "") or text("mode")

    @property
    def unit(self) -> str:
        """SI unit of the amplitudes."""
        return SI_UNIT[self._every[0].quantity].replace("^2", "²")

    @property
    def levels(self) -> np.ndarray:
        """Amplitudes of the levels that were fitted; the highest alone where only the predicted values are known."""
        if self.draws is not None or self.fitted is not None:
            return np.asarray(self.fitted.amplitude if self.draws is None else self.draws.levels)  # type: ignore[union-attr]
        tops = [float(one.amplitude[0] / one.beyond[0]) for one in self.at]
        tops += [float(one.amplitude.value[0] / one.beyond[0]) for one in self.resonances]
        tops += [one.highest_level for one in self.responses]
        tops += [float(one.amplitude[0] / one.beyond[0]) for one in self.surfaces]
        return np.array(tops[:1])

    def against(self, amplitude: float) -> str:
        """How far an amplitude lies outside the levels that were fitted."""
        levels = self.levels
        return against(amplitude, float(levels[0]) if len(levels) > 1 else 0.0, float(levels[-1]))

    @property
    def tested(self) -> tuple[int, int]:
        """Held-out levels inside the bands, and those compared."""
        counts = [confirmed(one, self.modes[-1]) for one in self.at] if len(self.modes) > 1 else []
        return sum(inside for inside, _ in counts), sum(every for _, every in counts)

    @property
    def laws(self) -> list[tuple[str, float]]:
        """Names of the joint laws and their weights, the largest first."""
        sources = [*self.at, *(() if self.draws is None else (self.draws,))]
        for one in sources:
            if one.laws and one.weights is not None and len(one.weights):
                return sorted(zip(one.laws, map(float, one.weights), strict=True), key=lambda pair: -pair[1])
        return []

    @property
    def _every(self) -> tuple[Any, ...]:
        draws = () if self.draws is None else (self.draws,)
        return (*self.at, *self.resonances, *self.responses, *self.surfaces, *draws, *self.modes)


def points(band: Band) -> list[tuple[float, float, float]]:
    """Low, value and high of each point of a band."""
    return list(zip(band.low.tolist(), band.value.tolist(), band.high.tolist(), strict=True))


def in_si(name: str) -> tuple[str, str, str]:
    """Heads of the columns of a band beside a report."""
    return f"{name}_low", f"{name}_median", f"{name}_high"
