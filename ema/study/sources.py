"""What a study starts from: a campaign opened (a built-in one is written first), and fingerprints of its data."""

import hashlib
from pathlib import Path

import acquisition
from acquisition import campaign_file
from acquisition.assignment import data_folder, items_of
from ema.data import Campaign, Condition, Excitation, Run
from ema.errors import InputError
from ema.progress import Progress, advance, silent
from ema.study import builtin


def opened(path: Path, progress: Progress = silent) -> Campaign:
    """The campaign in a folder, behind a ``campaign.toml``, or made of a single file with FRFs.

    Raises
    ------
    InputError : it cannot be opened, or the file holds no FRFs.
    """
    if path.is_dir() or path.suffix.lower() == ".toml":
        described = campaign_file.load(path)
        if described.campaign.generator:
            builtin.ensure(_folder(path), described.campaign.generator, progress)
        return acquisition.open_campaign(path, progress)
    return _of_file(path)


def _of_file(path: Path) -> Campaign:
    contents = acquisition.read(path)
    if not contents.frfs:
        held = "records" if contents.recordings else "no measurements"
        raise InputError(
            "the file holds no FRFs", where=str(path), got=held,
            advice="describe records by a campaign.toml: which channel is the force, and where it acted",
        )  # fmt: skip
    run = Run(path.stem, Condition(Excitation()), frfs=contents.frfs)
    return Campaign(
        name=path.name, runs=(run,), geometry=contents.geometry, folder=str(path.parent), findings=contents.findings,
        inputs=((path.name, fingerprint([path])),),
    )  # fmt: skip


def data_of(path: Path, progress: Progress = silent) -> dict[str, tuple[tuple[str, str], ...]]:
    """For each run the fingerprint of its data files, as ``(what, sha256)``."""
    if path.is_file() and path.suffix.lower() != ".toml":
        return {path.stem: ((path.name, fingerprint([path])),)}
    described = campaign_file.load(path)
    folder = _folder(path)
    data = data_folder(described.campaign.files, folder)
    prints: dict[str, tuple[tuple[str, str], ...]] = {}
    for number, run in enumerate(described.runs):
        advance(progress, "fingerprints of the data", number, len(described.runs))
        files = [item.path for item in items_of(run, data, folder, f"run {run.id}")]
        unique = list(dict.fromkeys(files))
        what = unique[0].name if len(unique) == 1 else f"run {run.id}, {len(unique)} data files"
        prints[run.id] = ((what, fingerprint(unique)),)
    return prints


def fingerprint(paths: list[Path]) -> str:
    """SHA-256 of one file; of several files that of the list ``<sha256>  <name>``, one per line."""
    digests = []
    for path in paths:
        with path.open("rb") as file:
            digests.append(hashlib.file_digest(file, "sha256").hexdigest())
    if len(paths) == 1:
        return digests[0]
    lines = "".join(f"{digest}  {path.name}\n" for digest, path in zip(digests, paths, strict=True))
    return hashlib.sha256(lines.encode()).hexdigest()


def _folder(path: Path) -> Path:
    return (path if path.is_dir() else path.parent).resolve()
