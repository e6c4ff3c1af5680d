"""A page that follows a measurement: force, spectrum, FRF and coherence of every take as it is kept."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ema.app.views import curve, numbers, strongest
from ema.data import FrfSet, Recording
from ema.errors import InputError
from ema.messages import text
from ema.show.style import frf_label

if TYPE_CHECKING:
    from acquisition import Take

_BEFORE = 4e-3
"""Seconds before the peak of an impact that are shown: some contact times of a soft tip."""
_BEHIND = 8e-3
"""Seconds behind the peak of an impact that are shown: twice as many, for what comes after it."""
_MOST_POINTS = 2000
"""Most points of a curve over time; each of them holds the largest of what it stands for."""


@dataclass
class LivePage:
    """The takes of a session, the last one as curves.

    Parameters
    ----------
    title : name of the run and its folder.
    asked : what is to be done now, such as the point to strike.
    """

    title: str
    asked: str = ""
    name: str = "live"
    _revision: int = 0
    _last: dict[str, Any] = field(default_factory=dict)
    _peaks: list[dict[str, Any]] = field(default_factory=list)

    def add(self, take: "Take", average: FrfSet | None, asked: str) -> None:
        """Show a take, and the FRFs of all takes at its point that count.

        Parameters
        ----------
        average : FRFs from the point of the take; ``None`` where there are none.
        asked : what is to be done now.
        """
        self._last = {
            "take": _verdict(take),
            **_signals(take.record),
            "frf": None if average is None else _frf(average),
        }
        self._peaks.append({"point": take.point, "peak": numbers([take.peak], 5)[0], "accepted": take.accepted})
        self.asked = asked
        self._revision += 1

    def news(self) -> dict[str, Any]:
        """What the windows follow."""
        return {"revision": self._revision, "busy": ""}

    def view(self, name: str, query: dict[str, str]) -> dict[str, Any]:
        """The last take and all peaks.

        Raises
        ------
        InputError : there is no such view.
        """
        if name != "take":
            raise InputError("there is no such view", got=name, expected="take")
        return {
            "title": self.title,
            "asked": self.asked,
            "revision": self._revision,
            "peaks": list(self._peaks),
            **self._last,
        }

    def act(self, name: str, request: dict[str, Any], changed: Callable[[], None]) -> dict[str, Any]:
        """Refuse: a page only follows a measurement.

        Raises
        ------
        InputError : always.
        """
        raise InputError(
            "there is no such action",
            got=name,
            advice="control the measurement where it was started: this page only follows it",
        )

    def export(self, kind: str) -> tuple[str, bytes]:
        """Refuse: the takes are files already.

        Raises
        ------
        InputError : always.
        """
        raise InputError(
            "there is no such export", got=kind, advice="use the files of the takes in the folder of the campaign"
        )


def _verdict(take: "Take") -> dict[str, Any]:
    forces = (f"{joint} {mean:.0f} ± {std:.0f} N" for joint, (mean, std) in take.normal_forces.items())
    return {
        "point": take.point,
        "number": take.number,
        "accepted": take.accepted,
        "reasons": list(take.reasons),
        "remarks": list(take.remarks),
        "peak": f"{take.peak:.4g} N",
        "normal_force": ", ".join(forces) or text("no joint"),
    }


def _signals(record: Recording) -> dict[str, Any]:
    """Force about its peak, its spectrum below its highest value, and the first response."""
    roles = [channel.role for channel in record.channels]
    force = record.signals[roles.index("reference")]
    curves: dict[str, Any] = {"force": None, "spectrum": None, "response": None}
    peak = int(np.argmax(np.abs(force)))
    begin = max(0, peak - round(_BEFORE * record.sampling_rate))
    shown = force[begin : peak + round(_BEHIND * record.sampling_rate)]
    curves["force"] = {
        "time": numbers(1e3 * (begin + np.arange(len(shown)) - peak) / record.sampling_rate, 5),
        "value": numbers(shown, 5),
    }
    spectrum = np.abs(np.fft.rfft(force))
    lines = np.fft.rfftfreq(len(force), 1 / record.sampling_rate)
    if spectrum.max() > 0:
        below = 20 * np.log10(np.maximum(spectrum, 1e-6 * spectrum.max()) / spectrum.max())
        rows = strongest(spectrum, _MOST_POINTS)
        curves["spectrum"] = {"f": numbers(lines[rows]), "decibels": numbers(below[rows], 4)}
    if "response" in roles:
        row = roles.index("response")
        value, channel = record.signals[row], record.channels[row]
        rows = strongest(value, _MOST_POINTS)
        curves["response"] = {
            "time": numbers(rows / record.sampling_rate, 6),
            "value": numbers(value[rows], 5),
            "label": f"{channel.name} [{channel.unit}]",
        }
    return curves


def _frf(average: FrfSet) -> dict[str, Any]:
    curves = {
        "label": average.label(0, 0),
        "unit": frf_label(average.quantity, average.unit),
        "measured": curve(average.frequencies, average.values[:, 0, 0]),
        "coherence": None,
    }
    if average.coherence is not None:
        coherence = np.asarray(average.coherence).reshape(len(average.frequencies), -1)[:, 0]
        curves["coherence"] = {"f": numbers(average.frequencies), "value": numbers(coherence, 4)}
    return curves
