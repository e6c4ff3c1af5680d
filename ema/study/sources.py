"""What a study starts from: a campaign opened (a built-in one is written first), and fingerprints of its data."""

from pathlib import Path

import acquisition
from acquisition import campaign_file
from ema import store
from ema.data import Campaign, Condition, Excitation, Run
from ema.datasets import builtin
from ema.errors import InputError
from ema.fingerprint import of_files
from ema.progress import Progress, advance, silent
from ema.store.reading import containers


def opened(path: Path, progress: Progress = silent, *, salvage: bool = False) -> Campaign:
    """The campaign in a folder, behind a ``campaign.toml``, or made of a single file with FRFs.

    Raises
    ------
    InputError : it cannot be opened, or the file holds no FRFs.
    """
    if path.is_dir() or path.suffix.lower() == ".toml":
        described = campaign_file.load(path)
        if described.campaign.generator:
            builtin.ensure(_folder(path), described.campaign.generator, progress)
        return acquisition.open_campaign(path, progress, salvage=salvage)
    return _of_file(path, salvage)


def _of_file(path: Path, salvage: bool) -> Campaign:
    contents = (
        acquisition.Contents.of(containers(path)) if store.is_store(path) else acquisition.read(path, salvage=salvage)
    )
    if not contents.frfs:
        content, advice = "no measurements", "export FRFs (data set 58 of a universal file, or a table)"
        if contents.recordings:
            content = "records"
            advice = "describe records by a campaign.toml: which channel is the force, and where it acted"
        elif contents.modes:
            count = sum(len(model.poles) for model in contents.modes)
            content = f"a modal model ({count} modes)"
            advice = "compare it with another one (ema compare), or fit the FRFs that it was made from"
        raise InputError("the file holds no FRFs", where=str(path), got=content, advice=advice)
    run = Run(path.stem, Condition(Excitation()), frfs=contents.frfs)
    return Campaign(
        name=path.name,
        runs=(run,),
        geometry=contents.geometry,
        folder=str(path.parent),
        findings=contents.findings,
        inputs=((path.name, of_files([path])),),
    )


def data_of(path: Path, progress: Progress = silent) -> dict[str, tuple[tuple[str, str], ...]]:
    """For each run the fingerprint of its data files, as ``(what, sha256)``."""
    if path.is_file() and path.suffix.lower() != ".toml":
        return {path.stem: ((path.name, of_files([path])),)}
    files = acquisition.data_files(campaign_file.load(path), _folder(path))
    prints: dict[str, tuple[tuple[str, str], ...]] = {}
    for number, (run, paths) in enumerate(files.items()):
        advance(progress, "fingerprints of the data", number, len(files))
        what = paths[0].name if len(paths) == 1 else f"run {run}, {len(paths)} data files"
        prints[run] = ((what, of_files(paths)),)
    return prints


def _folder(path: Path) -> Path:
    return (path if path.is_dir() else path.parent).resolve()
