"""From the tables of ``model.toml`` to a ``BeamModel``: matrices are built or read, joints get their node pairs."""

import hashlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from acquisition import model_file as tables
from acquisition.files import matrices as matrix_files
from ema import store
from ema.contact.catalogue import CATALOGUE
from ema.contact.rough import ROUGH, growth_exponent, rough_normal_contact, rough_stiffness
from ema.data import (
    BeamModel,
    Damping,
    FrictionLaw,
    Joint,
    Matrices,
    ModalModel,
    NormalContact,
    Provenance,
    StudyResult,
)
from ema.dof import Dof, match
from ema.elements import Plate, Section, double_beam, plate_matrices, stepped_beam
from ema.elements.double import REFERENCE
from ema.errors import EmaError, InputError
from ema.tables import line_of


@dataclass
class _Reader:
    """One file being understood: where it is and its text, for the lines of mistakes."""

    path: Path
    text: str

    @contextmanager
    def line(self, *steps: str | int) -> Iterator[None]:
        """Errors inside name the line of ``steps``."""
        try:
            yield
        except EmaError as error:
            where = f"{self.path}, line {line_of(self.text, steps)}"
            what = f"{error.where}: {error.what}" if error.where and str(self.path) not in error.where else error.what
            raise type(error)(what, where=where, got=error.got, expected=error.expected, advice=error.advice) from error

    def beside(self, name: str) -> Path:
        """A file named in the model, relative to it."""
        return self.path.parent / name


def build(model: tables.ModelFile, path: Path) -> BeamModel:
    """The model that the tables describe.

    Raises
    ------
    InputError : a file is missing or damaged, a node of a pair or the DOF of a run is not there; with its line.
    """
    reader = _Reader(path, tables.KIND.text(path))
    damping = Damping(model.damping.ratio, model.damping.mass_factor)
    if model.structure.kind == "double beam":
        built = _double_beam(model, reader, damping)
    else:
        with reader.line("structure"):
            host = _structure(model.structure, "", reader)
        beam: Matrices | None = None
        if model.beam is not None:
            with reader.line("beam"):
                matrices = _structure(model.beam, "beam", reader)
                assert isinstance(matrices, Matrices)
                beam = matrices
        joints = tuple(_joint(model, number, reader) for number in range(len(model.joints)))
        built = BeamModel(host, beam, joints, damping, model.model.name, _spacing(model))
    _check_places(model, built, reader)
    digest = hashlib.sha256(reader.text.encode()).hexdigest()
    return replace(
        built, name=model.model.name, provenance=Provenance(inputs=((path.name, digest),), steps=("open_model",))
    )


def _structure(table: tables.StructureTable, part: str, reader: _Reader) -> Matrices | ModalModel:
    part = part if table.part is None else table.part
    if table.kind == "measured":
        return _measured(reader.beside(table.file), table.run)
    if table.kind == "matrices":
        if isinstance(table.dofs, str):
            dofs = matrix_files.read_dofs(reader.beside(table.dofs), part)
        else:
            dofs = tuple(replace(dof, part=dof.part or part) for dof in map(Dof.parse, table.dofs))
        files = reader.beside(table.mass), reader.beside(table.stiffness)
        return matrix_files.structure(*files, dofs, table.length_unit, table.mass_unit)
    if table.kind == "plate":
        assert table.length and table.width and table.height and isinstance(table.elements, list)
        return plate_matrices(
            Plate(
                table.length,
                table.width,
                table.height,
                youngs_modulus=table.youngs_modulus,
                poisson=table.poisson,
                density=table.density,
                elements=(table.elements[0], table.elements[1]),
            ),
            clamped=table.held,
            part=part,
        )
    ends = table.ends or (["clamped", "free"] if part == "" else ["free", "free"])
    return stepped_beam(_sections(table), (ends[0] == "clamped", ends[1] == "clamped"), part)


def _sections(table: tables.StructureTable) -> list[Section]:
    if table.sections:
        return [Section(**section.model_dump()) for section in table.sections]
    assert table.length and table.width and table.height
    count = table.elements if isinstance(table.elements, int) else 20
    return [Section(table.length, table.width, table.height, table.youngs_modulus, table.density, count)]


def _measured(path: Path, run: str) -> ModalModel:
    """The modes in a file of our store: a modal model, several by name, or those of a run of a study."""
    content = store.load(path)
    if isinstance(content, StudyResult):
        content = {item.run.id: item.modes for item in content.runs}
    if isinstance(content, ModalModel) and not run:
        return content
    named = content if isinstance(content, Mapping) else {}
    models = {name: item for name, item in named.items() if isinstance(item, ModalModel)}
    if not run and len(models) == 1:
        return next(iter(models.values()))
    if run not in models:
        raise InputError(
            "no such modal model in the file",
            where=str(path),
            got=run or type(content).__name__,
            expected="run = one of " + ", ".join(models) if models else "a modal model",
            advice="`ema fit ... --output modes.h5` writes one",
        )
    return models[run]


def law_of(table: tables.LawTable) -> FrictionLaw:
    """Return the friction law of a law table.

    Parameters that are not stated have the values of the simulator's constructors.

    Parameters
    ----------
    table : LawTable
        ``[law]`` of a model file.

    Returns
    -------
    FrictionLaw
        The law.

    Examples
    --------
    >>> law_of(tables.LawTable(name="masing", friction_coefficient=0.3, contact_stiffness="2e7 N/m")).contact_stiffness
    20000000.0
    """
    stiffness = float("inf") if table.contact_stiffness is None else table.contact_stiffness
    names = tables.LAW_PARAMETERS.get(table.name, ())
    if table.name == "parallel masing":
        parameters = [
            (f"{key[:-1].replace('_', ' ')} {n}", v) for key in names for n, v in enumerate(getattr(table, key))
        ]
    elif names or table.name in tables.LAW_PARAMETERS:
        parameters = [
            (known.name, known.default if getattr(table, known.key) is None else float(getattr(table, known.key)))
            for known in CATALOGUE[table.name].parameters
        ]
    else:
        parameters = [(f"p{n}", value) for n, value in enumerate(table.parameters or ())]
    exponent = table.stiffness_exponent
    if table.name in ROUGH:
        separation = dict(parameters).get("separation")
        exponent = growth_exponent(separation)
        if table.summit_deviation is not None:
            stated = () if table.poisson is None else (table.poisson,)
            stiffness = rough_stiffness(table.reference_force, table.summit_deviation, separation, *stated)
    return FrictionLaw(
        table.name,
        table.friction_coefficient,
        stiffness,
        tuple(parameters),
        exponent,
        table.reference_force,
        table.stiffness_cap,
        table.isotropic,
    )


def _double_beam(model: tables.ModelFile, reader: _Reader, damping: Damping) -> BeamModel:
    table, joint = model.structure, model.joints[0]
    section = replace(REFERENCE, **table.model_dump(include=table.model_fields_set & set(tables.SIZE)))
    with reader.line("structure"):
        built = double_beam(law_of(_law(model, joint)), joint.normal_force, section, damping=damping)
    (plain,) = built.joints
    stated = _joint(model, 0, reader, plain)
    return replace(built, joints=(stated,))


def _law(model: tables.ModelFile, joint: tables.JointTable) -> tables.LawTable:
    law = joint.law or model.law
    assert law is not None
    return law


def _joint(model: tables.ModelFile, number: int, reader: _Reader, plain: Joint | None = None) -> Joint:
    """A joint; what is not stated comes from ``plain`` or from the dimensions of host and beam."""
    table = model.joints[number]
    with reader.line("joints", number):
        pairs = tuple((host, beam) for host, beam in table.pairs)
        if table.host_nodes and table.beam_nodes:
            pairs = tuple(zip(table.host_nodes, table.beam_nodes, strict=True))
        heights = tuple(table.half_heights) if table.half_heights else _half_heights(model, plain)
        normal = table.normal_stiffness or (plain.normal_stiffness if plain else None)
        if normal is None and table.normal_contact.name in ("curve", "rough"):
            normal = 1.0  # the curve takes its place
        if normal is None:
            raise InputError("a joint lacks its normal_stiffness", expected='a stiffness such as "1e9 N/m"')
        areas = None if table.area_shares is None else np.array(table.area_shares)
        if plain and areas is None and not pairs:
            areas = plain.area_shares
        return Joint(
            table.name or (plain.name if plain else f"J{number + 1}"),
            pairs or (plain.pairs if plain else ()),
            (heights[0], heights[1]),
            law_of(_law(model, table)),
            table.normal_force,
            normal,
            None if table.force_shares is None else np.array(table.force_shares),
            tuple(table.directions),
            areas,
            _contact(table.normal_contact),
            table.area,
            table.tangential_loss,
            table.normal_loss,
            table.normal_exponent,
        )


def _contact(table: tables.ContactTable) -> NormalContact:
    if table.name == "rough" and table.summit_deviation is not None:
        return rough_normal_contact(table.summit_deviation, table.reference_force, table.separation)
    points = tuple((point.penetration, point.force) for point in table.points)
    return NormalContact(table.name, table.exponent, table.reference_force, points)


def _half_heights(model: tables.ModelFile, plain: Joint | None) -> tuple[float, ...]:
    if plain is not None:
        return plain.half_heights
    halves = [_height(model.structure), _height(model.beam or model.structure)]
    if None in halves:
        raise InputError(
            "a joint lacks its half_heights",
            expected="the distances from the middle layers of host and "
            'beam to the interface, such as ["40 mm", "12 mm"]',
            advice="they follow by themselves only from beams and plates of one height",
        )
    return tuple(half / 2 for half in halves if half is not None)


def _height(table: tables.StructureTable) -> float | None:
    heights = {section.height for section in table.sections}
    return table.height if not heights else heights.pop() if len(heights) == 1 else None


def _spacing(model: tables.ModelFile) -> float | None:
    """Distance of neighbouring nodes of the friction beam in m, where it is known."""
    table = model.beam or model.structure
    if table.kind != "beam":
        return None
    return min(section.length / section.elements for section in _sections(table))


def _check_places(model: tables.ModelFile, built: BeamModel, reader: _Reader) -> None:
    """Whether the DOFs of the runs and the joint of the loops exist."""
    dofs = (*built.host.dofs, *(built.beam.dofs if built.beam is not None else ()))
    for name in ("snapback", "frf", "map"):
        table: Any = getattr(model, name)
        if table is None:
            continue
        named = {"at": [table.at], "outputs": getattr(table, "outputs", []), "output": [getattr(table, "output", None)]}
        for key, places in named.items():
            for dof in places:
                with reader.line(name, key):
                    if dof is not None and not match([dof], dofs):
                        raise InputError(
                            "the structure has no such DOF",
                            got=str(dof),
                            expected=f"one such as {dofs[0]} or {dofs[-1]}",
                        )
    if model.loop is not None and model.loop.joint:
        with reader.line("loop", "joint"):
            known = [joint.name for joint in built.joints]
            if model.loop.joint not in known:
                raise InputError("no such joint", got=model.loop.joint, expected=", ".join(known))


def open_model(path: str | Path) -> BeamModel:
    """Build the structure with friction that a ``model.toml`` describes, in SI.

    Parameters
    ----------
    path : str or Path
        The file, or the folder that holds it; the files it names are relative to it.

    Returns
    -------
    BeamModel
        The model.

    Raises
    ------
    InputError
        If there is a mistake in the file (with its line), or a file it names is missing or damaged.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> text = '''
    ... [model]
    ... name = "two beams"
    ... [structure]
    ... kind = "double beam"
    ... length = "0.5 m"
    ... width = "40 mm"
    ... height = "5 mm"
    ... [[joints]]
    ... name = "interface"
    ... normal_force = "1 kN"
    ... normal_stiffness = "1e9 N/m"
    ... [law]
    ... name = "masing"
    ... friction_coefficient = 0.3
    ... contact_stiffness = "1e9 N/m"
    ... '''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(folder, "model.toml").write_text(text)
    ...     open_model(folder).joints[0].normal_force
    1000.0
    """
    return build(tables.load(path), tables.locate(path))
