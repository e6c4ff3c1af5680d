"""Open a campaign: a folder with ``campaign.toml`` and the files that it describes."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from acquisition import campaign_file, units
from acquisition.assignment import Item, data_folder, items_of, rest_of
from acquisition.axes import LocalAxes
from acquisition.campaign_file import CampaignFile, ChannelTable, LevelsTable, RunTable
from acquisition.copied_files import copied_repeats, copies
from acquisition.file_cache import Files, Take
from acquisition.force import Span, joint_forces, nominal_forces, span_of
from acquisition.force_levels import against_nominal_levels
from acquisition.force_units import against_other_runs
from acquisition.geometry_file import geometry_of
from acquisition.repairs import Repairs
from acquisition.scaling import (
    Line,
    lines_of_frf,
    lines_of_record,
    node_number,
    refuse_doubles,
    same_frf_units,
    same_units,
    scaled_frf,
    scaled_record,
)
from acquisition.setups import Part, merge
from ema.data import (
    Campaign,
    Channel,
    Condition,
    Excitation,
    Finding,
    FrfSet,
    Geometry,
    JointForce,
    Lazy,
    Recording,
    Run,
    SteppedLevel,
)
from ema.dof import SCALAR, Dof
from ema.errors import InputError
from ema.fingerprint import of_files
from ema.progress import Progress, advance, silent

_KEPT = 64 * 2**20
"""Bytes up to which the FRFs of a run stay in memory; larger ones are read when asked for."""


@dataclass(frozen=True)
class _Piece:
    """One record of a run: where it is, and the channels it will have."""

    item: Item
    name: str
    take: Take
    lines: tuple[Line, ...]
    excluded: tuple[tuple[int, str], ...]

    @property
    def header(self) -> Recording:
        """The record without its samples."""
        bare = replace(self.take.header, name=self.name, setup=self.item.setup or self.take.header.setup)
        return scaled_record(bare, self.lines)

    def read(self) -> Recording:
        """The record, in SI."""
        record = replace(
            self.take.read(),
            name=self.name,
            setup=self.item.setup or self.take.header.setup,
            excluded_hits=(*self.take.header.excluded_hits, *self.excluded),
        )
        return scaled_record(record, self.lines)


def open_campaign(path: str | Path, progress: Progress = silent, *, salvage: bool = False) -> Campaign:
    r"""Open the measurement campaign in a folder, by its ``campaign.toml``.

    Records of our own files stay on disk until they are used; files of other formats are read once here, to find out
    what is in them and whether it fits the campaign file. FRFs of all files of a run become one set.

    Parameters
    ----------
    path : str or Path
        The folder, or its ``campaign.toml``.
    progress : Progress, optional
        Called with the file that is being opened.
    salvage : bool, default False
        Read what damaged files still hold, with a finding that names it, instead of an error.

    Returns
    -------
    Campaign
        The campaign.

    Raises
    ------
    InputError
        If the campaign file is wrong, a file is missing or damaged, what it holds contradicts the campaign file, or the
        files of a built-in campaign have not been generated yet.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from ema.examples import frf_set
    >>> from ema.store import save
    >>> text = '[campaign]\nname = "A"\n[[runs]]\nid = "bare"\nfiles = "bare.h5"\n'
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save(Path(folder, "bare.h5"), frf_set())
    ...     _ = Path(folder, "campaign.toml").write_text(text)
    ...     open_campaign(folder)["bare"].frfs[0].quantity
    'accelerance'
    """
    path = Path(path)
    file = path / campaign_file.FILE_NAME if path.is_dir() else path
    described = campaign_file.load(path)
    folder, where = file.parent.resolve(), str(file)
    data = data_folder(described.campaign.files, folder)
    _refuse_absent(described, data, where)
    geometry = geometry_of(described.geometry, folder, data, where)
    repairs = Repairs(described.repairs, [run.id for run in described.runs], where)
    axes, items = LocalAxes(geometry), {}
    for run in described.runs:
        items[run.id] = repairs.items(run.id, items_of(run, data, folder, f"{where}, run {run.id}"))
        if not items[run.id]:
            raise InputError(
                "repairs exclude every file of the run",
                where=f"{where}, run {run.id}",
                advice="remove one of these repairs, or the run",
            )
        _note_skewed(described.channels_of(run), items[run.id], axes, f"{where}, run {run.id}")
    opening = _Opening(described, (folder, data), where, axes, repairs, Files(), progress, salvage)
    runs = tuple(opening.run(run, items[run.id]) for run in described.runs)
    nominal = nominal_forces(described.runs)
    runs, about_levels = against_nominal_levels(against_other_runs(runs, nominal), nominal)
    repairs.refuse_unused()
    if geometry is not None:
        geometry = replace(geometry, axes=axes.apply(geometry))
    else:
        axes.apply(None)
    header = described.campaign
    return Campaign(
        header.name,
        runs,
        geometry,
        header.structure,
        header.operator,
        header.date,
        header.comment,
        photos=tuple(str(_image(folder, photo, where, "photo")) for photo in header.photos),
        channels=opening.channels,
        inputs=_hashes(described, file, folder, data),
        findings=(
            *described.former_names,
            *_outside_geometry(geometry, opening.dofs),
            *_copied_repeats(described.runs, items),
            *about_levels,
        ),
        folder=str(folder),
        logo=str(_image(folder, header.logo, where, "logo")) if header.logo else "",
    )


@dataclass
class _Opening:
    """A campaign while it is being opened."""

    described: CampaignFile
    folders: tuple[Path, Path]
    where: str
    axes: LocalAxes
    repairs: Repairs
    files: Files
    progress: Progress
    salvage: bool = False

    def __post_init__(self) -> None:
        self.channels: tuple[Channel, ...] = ()
        self.dofs: set[Dof] = set()

    def run(self, run: RunTable, items: tuple[Item, ...]) -> Run:
        """One run, with its condition and findings."""
        where = f"{self.where}, run {run.id}"
        options = self.described.campaign.reader | run.reader | ({"salvage": True} if self.salvage else {})
        table = self.described.channels_of(run)
        if run.levels is not None:
            return self._stepped(run, items, run.levels)
        findings: list[Finding] = []
        pieces: list[_Piece] = []
        frfs: Sequence[FrfSet] = ()
        whole: FrfSet | None = None
        if self._holds_frfs(run, items[0], options, where):
            make = partial(self._frfs, run, items, table, options, where)
            whole = make()
            findings += whole.findings
            self._note([Channel("", dof) for dof in (*whole.outputs, *whole.inputs)])
            findings += _unit_findings([] if whole.scaled else [f"FRFs of {run.id}"], f"run {run.id}")
        else:
            pieces = self._pieces(run, items, table, options, where)
            unstated = [line.channel for line in pieces[0].lines if not line.channel.scaled]
            findings += _unit_findings([channel.name for channel in unstated if _measures(channel)], f"run {run.id}")
            self._note(line.channel for piece in pieces for line in piece.lines)
            self.channels = self.channels or tuple(line.channel for line in pieces[0].lines)
        findings += copies([item.path for item in items], f"run {run.id}")
        of_files = [finding for item in items for finding in self.files.findings(item.path, options)]
        # DOFs that occur twice are settled by ``refuse_doubles``
        findings += [finding for finding in of_files if finding.code != "duplicated-dof"]
        recordings = Lazy([piece.read for piece in pieces])
        measured = any(force.channel for force in run.normal_force) or any(
            line.channel.role == "normal force" for piece in pieces for line in piece.lines
        )
        span = (
            span_of([piece.header for piece in pieces], [piece.take.samples for piece in pieces]) if pieces else Span()
        )
        joints, about_force = joint_forces(
            run, self.described.joints, recordings if measured else (), span, self.folders, f"run {run.id}"
        )
        condition = _condition(run, joints)
        if whole is not None:
            small = whole.values.nbytes <= _KEPT
            frfs = (
                (replace(whole, condition=condition),)
                if small
                else Lazy([lambda: replace(make(), condition=condition)])
            )
        return Run(
            run.id,
            condition,
            recordings,
            frfs,
            self.repairs.of_run(run.id),
            (*findings, *about_force),
            run.comment,
            run.repeat,
            run.assembly,
            at_rest=self._at_rest(run, table, options, where),
        )

    def _at_rest(
        self, run: RunTable, table: list[ChannelTable], options: dict[str, Any], where: str
    ) -> Sequence[Recording]:
        """Records without excitation."""
        if not run.at_rest:
            return ()
        folder, data = self.folders
        here = f"{where}, at_rest"
        items = self.repairs.items(run.id, items_of(rest_of(run), data, folder, here))
        return Lazy([piece.read for piece in self._pieces(run, items, table, options, here)])

    def _stepped(self, run: RunTable, items: tuple[Item, ...], table: LevelsTable) -> Run:
        """A run of stepped levels, lowest first."""
        from acquisition.stepped_levels import LevelLayout, in_order, read_levels

        layout = LevelLayout(**table.model_dump() | {"harmonics": tuple(table.harmonics)})
        levels: list[SteppedLevel] = []
        for number, item in enumerate(items):
            advance(self.progress, f"reading run {run.id}", number, len(items))
            levels += read_levels(item.path, layout, item.label)
        self.dofs |= {dof for level in levels for dof in (level.output, level.input) if dof is not None}
        joints, about_force = joint_forces(run, self.described.joints, (), Span(), self.folders, f"run {run.id}")
        condition = _condition(run.model_copy(update={"kind": "stepped sine"}), joints)
        return Run(
            run.id,
            condition,
            repairs=self.repairs.of_run(run.id),
            findings=tuple(about_force),
            comment=run.comment,
            repeat=run.repeat,
            assembly=run.assembly,
            levels=in_order(levels, f"{self.where}, run {run.id}"),
        )

    def _holds_frfs(self, run: RunTable, item: Item, options: dict[str, Any], where: str) -> bool:
        if run.take is not None:
            return run.take == "FRFs"
        if (headers := self.files.headers(item.path)) is not None:
            kinds = {header.noun for header in headers}
            records, frfs = "Recording" in kinds, "FrfSet" in kinds
        else:
            contents = self.files.contents(item.path, options)
            records, frfs = bool(contents.recordings), bool(contents.frfs)
        if records and frfs:
            raise InputError(
                "the file holds both records and FRFs",
                where=f"{where}, {item.label}",
                advice='say which of them this run takes: take = "records" or take = "FRFs"',
            )
        if not records and not frfs:
            raise InputError(
                "the file holds neither records nor FRFs",
                where=f"{where}, {item.label}",
                advice="name files with records or FRFs, or say in reader what this one holds",
            )
        return frfs

    def _pieces(
        self, run: RunTable, items: tuple[Item, ...], table: list[ChannelTable], options: dict[str, Any], where: str
    ) -> list[_Piece]:
        pieces = []
        for number, item in enumerate(items):
            advance(self.progress, f"opening run {run.id}", number, len(items))
            takes = self.files.takes(item.path, options)
            if not takes:
                raise InputError(
                    "the file holds no records",
                    where=f"{where}, {item.label}",
                    advice="name only files with records, or exclude this one by a repair",
                )
            names = [_record_name(item, take, place, len(takes)) for place, take in enumerate(takes)]
            self.repairs.note_records(names)
            for take, name in zip(takes, names, strict=True):
                here = f"{where}, {name}"
                with _naming_damage(self.files.findings(item.path, options)):
                    same_units(take.header.channels, table, self.files.units(item.path, options), here)
                    lines = lines_of_record(take.header.channels, table, item, self.axes, here)
                lines = self.repairs.lines(run.id, item, lines)
                refuse_doubles(lines, here)
                excluded = self.repairs.excluded_hits(run.id, item, name)
                pieces.append(_Piece(item, name, take, lines, excluded))
        _refuse_copies(pieces, where)
        _refuse_odd_records(pieces, where)
        return pieces

    def _frfs(
        self, run: RunTable, items: tuple[Item, ...], table: list[ChannelTable], options: dict[str, Any], where: str
    ) -> FrfSet:
        parts = []
        for number, item in enumerate(items):
            advance(self.progress, f"reading run {run.id}", number, len(items))
            here = f"{where}, {item.label}"
            frfs = self.files.contents(item.path, options).frfs
            if not frfs:
                raise InputError(
                    "the file holds no FRFs",
                    where=here,
                    advice="name only files with FRFs, or exclude this one by a repair",
                )
            for frf in frfs:
                same_frf_units(table, self.files.contents(item.path, options).frf_units, here)
                outputs, inputs = lines_of_frf(frf, table, item, self.axes, here)
                outputs, inputs = (self.repairs.lines(run.id, item, lines) for lines in (outputs, inputs))
                refuse_doubles((*outputs, *inputs), here)
                self.channels = self.channels or tuple(line.channel for line in (*inputs, *outputs))
                parts.append(Part(scaled_frf(frf, outputs, inputs, here), item.setup, item.label))
        merged = merge(parts, f"run {run.id}")
        if run.estimator:
            merged = replace(merged, estimator=run.estimator)
        if run.averages is not None:
            merged = replace(merged, averages=np.full(merged.values.shape[1:], float(run.averages)))
        return replace(merged, name=run.id)

    def _note(self, channels: Any) -> None:
        self.dofs |= {channel.dof for channel in channels if channel.dof is not None}


@contextmanager
def _naming_damage(findings: Sequence[Finding]) -> Iterator[None]:
    """Where a damaged file does not fit the campaign, the damage is the reason to name."""
    try:
        yield
    except InputError as error:
        damage = [finding for finding in findings if finding.severity == "error"]
        if not damage:
            raise
        raise InputError(
            f"the file is damaged ({damage[0].message.rstrip('.')})",
            where=error.where,
            got=f"what is left does not fit: {error.what}" + ("" if error.got is None else f", {error.got}"),
            advice=damage[0].advice.rstrip(".") or "export it again, or exclude it by a repair",
        ) from error


def _condition(run: RunTable, joints: tuple[JointForce, ...]) -> Condition:
    def force(text: str | None) -> float:
        return float("nan") if text is None else units.measure(text, "force")[0]

    band = None if run.band is None else tuple(units.measure(text, "frequency")[0] for text in run.band)
    period = float("nan") if run.period is None else units.measure(run.period, "time")[0]
    return Condition(
        Excitation(run.kind, force(run.level), force(run.level_std), band, period),  # type: ignore[arg-type]
        joints,
        None if run.temperature is None else units.measure(run.temperature, "temperature")[0],
    )


def _refuse_absent(described: CampaignFile, data: Path, where: str) -> None:
    if data.is_dir() and any(data.iterdir()):
        return
    if described.campaign.generator:
        raise InputError(
            "the files of this built-in campaign have not been generated yet",
            where=where,
            advice=f"`{described.campaign.generating_command}` makes them",
        )
    external = "${EMA_DATASETS}" in described.campaign.files
    advice = "set EMA_DATASETS to the folder of the measurements" if external else 'correct files = "..."'
    raise InputError(
        "the folder of the data files is empty" if data.is_dir() else "there is no folder of data files",
        where=where,
        got=str(data),
        advice=advice,
    )


def _note_skewed(table: list[ChannelTable], items: tuple[Item, ...], axes: LocalAxes, where: str) -> None:
    """Collect the vectors given for each node over all files, before the first DOF is made."""
    vectors: dict[int, list[np.ndarray]] = {}
    for spec in table:
        directions = [each for each in (*spec.directions, spec.direction) if isinstance(each, list)]
        for item in items if directions else ():
            vectors.setdefault(node_number(spec, item, where), []).extend(np.array(each) for each in directions)
    for node, found in vectors.items():
        axes.add(node, found)


def _record_name(item: Item, take: Take, index: int, count: int) -> str:
    """What a record is called in messages and repairs: its file, and which of several in it."""
    return item.label if count == 1 else f"{item.label}, {take.header.name or f'record {index + 1}'}"


def _copied_repeats(runs: Sequence[RunTable], items: dict[str, tuple[Item, ...]]) -> list[Finding]:
    """Repeats that are read alike from the same files; one file may hold several that ``reader`` or channels part."""
    alike: dict[tuple[str, str], dict[str, list[Path]]] = {}
    for run in runs:
        if run.repeat:
            how = repr((run.reader, run.channels, run.take))
            alike.setdefault((run.repeat, how), {})[run.id] = [item.path for item in items[run.id]]
    return [finding for (label, _), files in alike.items() for finding in copied_repeats(files, label)]


def _refuse_copies(pieces: list[_Piece], where: str) -> None:
    """A recorded take counts once, under whatever names its copies lie beside it."""
    first: dict[str, str] = {}
    for piece in pieces:
        identity = piece.take.header.identity
        if identity is None or not identity.key:
            continue
        if identity.key in first:
            raise InputError(
                "one take twice in one run",
                where=where,
                got=f"{first[identity.key]} and {piece.name}",
                advice="remove the copy, or exclude it by a repair",
            )
        first[identity.key] = piece.name


def _refuse_odd_records(pieces: list[_Piece], where: str) -> None:
    """Records of one run share rate, channels and quantities, and have more than one sample."""
    first = pieces[0]
    kinds = {line.channel.name: line.channel for line in first.lines}
    for piece in pieces:
        here = f"{where}, {piece.name}"
        if piece.take.samples < 2:
            raise InputError(
                "a record without signals",
                where=here,
                got=f"{piece.take.samples} samples",
                advice="exclude it by a repair, or measure again",
            )
        if not np.isclose(piece.take.header.sampling_rate, first.take.header.sampling_rate, rtol=1e-6):
            raise InputError(
                "unequal sampling rates in one run",
                where=here,
                got=f"{piece.take.header.sampling_rate:g} Hz",
                expected=f"{first.take.header.sampling_rate:g} Hz as in {first.name}",
                advice="put it into a run of its own",
            )
        for line in piece.lines:
            same = kinds.get(line.channel.name)
            if same is not None and (same.quantity, same.unit) != (line.channel.quantity, line.channel.unit):
                raise InputError(
                    "mixed units in one run",
                    where=f"{here}, channel {same.name}",
                    got=f"{line.channel.quantity} in {line.channel.unit}",
                    expected=f"{same.quantity} in {same.unit} as in {first.name}",
                    advice="put it into a run of its own, or correct its unit by a repair",
                )


def _measures(channel: Channel) -> bool:
    return channel.role in ("reference", "response", "normal force")


def _unit_findings(unstated: list[str], where: str) -> list[Finding]:
    if not unstated:
        return []
    names = ", ".join(unstated[:5]) + (f" and {len(unstated) - 5} more" if len(unstated) > 5 else "")
    return [
        Finding.of(
            "warning",
            "unit-unstated",
            where,
            "Nobody stated the unit of {names}: frequencies, damping and shapes hold, scaling to modal "
            "mass is impossible.",
            advice="Find out the unit or the sensitivity and state it.",
            names=names,
        )
    ]


def _outside_geometry(geometry: Geometry | None, dofs: set[Dof]) -> list[Finding]:
    if geometry is None:
        return []
    absent = sorted({dof.node for dof in dofs if dof.node not in geometry})
    scalar = sorted({dof.node for dof in dofs if dof.node in geometry and dof.direction == SCALAR})
    findings = []
    for code, nodes, lacking, advice in (
        ("node-without-position", absent, "position", "Add them to the geometry; until then they are not drawn."),
        ("direction-unstated", scalar, "direction", 'State it in the channel table: dof = "{point}:+Z".'),
    ):
        if nodes:
            named = ", ".join(map(str, nodes[:8])) + (" ..." if len(nodes) > 8 else "")
            message = f"{len(nodes)} measured nodes have no {lacking}: {named}."
            findings.append(Finding("warning", code, "geometry", message, len(nodes), 0, advice))
    return findings


def _image(folder: Path, name: str, where: str, what: str) -> Path:
    if not (folder / name).is_file():
        raise InputError(
            f"there is no such {what}",
            where=where,
            got=name,
            expected=f"a file in {folder}",
            advice="correct its name, or put it there",
        )
    return folder / name


def _hashes(described: CampaignFile, file: Path, folder: Path, data: Path) -> tuple[tuple[str, str], ...]:
    """``(name, sha256)`` of the campaign file and of the tables beside it or among its data."""
    beside = {table.file for run in described.runs for table in run.normal_force if table.file}
    beside |= {run.file_table for run in described.runs if run.file_table}
    if described.geometry is not None and described.geometry.file:
        beside.add(described.geometry.file)
    paths = [file]
    for name in sorted(beside):
        paths += [path for path in (folder / name, data / name) if path.is_file()][:1]
    return tuple((path.name, of_files([path])) for path in paths if path.is_file())
