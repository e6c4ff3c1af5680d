"""The page of the workbench: its parts, and what it can ask for."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ema.app import places, views
from ema.app.state import Workbench
from ema.errors import InputError


@dataclass
class WorkbenchPage:
    """The study that is worked on; ``busy`` is the action that runs."""

    bench: Workbench
    name: str = "app"
    busy: str = ""

    def news(self) -> dict[str, Any]:
        """What the windows follow."""
        return {"revision": self.bench.revision, "busy": self.busy, "saved": self.bench.saved}

    def export(self, kind: str) -> tuple[str, bytes]:
        """A file for other programs: its name and content."""
        return views.export(self.bench, kind)

    def view(self, name: str, query: dict[str, str]) -> dict[str, Any]:
        """Part of the page as numbers and texts.

        Raises
        ------
        InputError : there is no such view.
        """
        bench = self.bench
        match name:
            case "overview":
                return views.overview(bench) | {"busy": self.busy}
            case "poles":
                return views.poles(bench)
            case "frf":
                return views.frf(bench, int(query.get("output", 0)), int(query.get("input", 0)))
            case "matrix":
                return views.matrix(bench)
            case "motion":
                return views.motion(bench)
            case "hits":
                return views.hits(bench)
            case "pulse":
                return views.pulse(bench, int(query.get("hit", 0)))
            case "chart":
                return views.chart(bench, int(query.get("map", 0)))
            case "point":
                return views.point(bench, *(int(query.get(name, 0)) for name in ("map", "level", "force")))
            case "placement":
                return places.placement_view(bench, int(query.get("number", 0)))
            case "place":
                return places.place_view(bench, int(query.get("number", 0)), int(query.get("candidate", 0)))
        raise InputError(
            "there is no such view",
            got=name,
            expected="one of overview, poles, frf, matrix, motion, hits, pulse, chart, point, placement, place",
        )

    def act(self, name: str, request: dict[str, Any], changed: Callable[[], None]) -> dict[str, Any]:
        """Do what the page asks for, and answer with the overview.

        Raises
        ------
        InputError : there is no such action.
        """
        bench = self.bench
        actions: dict[str, Callable[[], Any]] = {
            "run": lambda: bench.choose(str(request["run"])),
            "pick": lambda: bench.pick(int(request["row"])),
            "near": lambda: bench.pick_near(float(request["frequency"])),
            "drop": lambda: bench.drop(int(request["mode"])),
            "undo": bench.undo,
            "save": bench.save,
            "exclude": lambda: bench.exclude(int(request["hit"]), str(request["why"]), str(request["who"])),
            "behind": lambda: bench.choose(
                bench.behind(int(request["map"]), int(request["level"]), int(request["force"]))
            ),
        }
        if name not in actions:
            raise InputError("there is no such action", got=name, expected="one of " + ", ".join(actions))
        self.busy = name
        changed()
        try:
            done = actions[name]()
        finally:
            self.busy = ""
            changed()
        return views.overview(bench) | {"busy": "", "done": str(done or "")}
