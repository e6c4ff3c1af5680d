"""What `ema predict` is asked for: options of stepped levels, and where its answer is written."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ema.cli.common import save_pictures

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class FromLevels:
    """What is predicted from stepped levels."""

    amplitude: Annotated[
        list[str] | None, typer.Option(help="Of stepped levels: amplitude with its unit, such as '60 m/s^2' (repeat).")
    ] = None
    run: Annotated[str, typer.Option("--run", help="The run of stepped levels, where there are several.")] = ""
    up_to: Annotated[
        str, typer.Option("--up-to", help="Fit levels up to this amplitude; higher ones confirm or refute.")
    ] = ""

    modal_mass: Annotated[
        str,
        typer.Option("--modal-mass", help="For forces: modal mass for a shape of 1 at the response, such as '2 kg'."),
    ] = ""

    def __bool__(self) -> bool:
        return bool(self.amplitude or self.run or self.up_to or self.modal_mass)


@dataclass(frozen=True)
class Wanted:
    """From what, where to, and how it is reported."""

    measured: Path
    folder: Path
    limit: str
    json: bool

    def written(self, stem: str, contents: "Mapping[str, object]", pictures: "Mapping[str, Figure]") -> list[Path]:
        """The files of a prediction."""
        from ema import store
        from ema.study.study import make_folder

        make_folder(self.folder)
        first = self.folder / f"{stem}_prediction.h5"
        store.save(first, contents)
        return [first, *save_pictures(self.folder, pictures)]
