"""What ``model.toml`` may say: structure, friction beam, joints, damping, and the runs of the simulator."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, model_validator

from acquisition.quantities import (
    Axis,
    Band,
    Damping,
    Density,
    Ends,
    Force,
    Forces,
    Frequency,
    HalfHeight,
    Length,
    Modulus,
    Nodes,
    NormalForce,
    NormalForces,
    Place,
    Places,
    Ratio,
    Seconds,
    Stiffness,
    Tolerance,
    Velocity,
    as_list,
    in_si,
)
from ema.contact.catalogue import CATALOGUE
from ema.contact.rough import ROUGH
from ema.tables import FileKind, Table, warn

FILE_NAME = "model.toml"


__all__ = [
    "FILE_NAME",
    "ControlTable",
    "FrfTable",
    "LawTable",
    "LoopTable",
    "MapTable",
    "ModelFile",
    "SnapbackTable",
    "load",
    "locate",
]


class ModelTable(Table):
    """``[model]``: what it is."""

    name: str
    comment: str = ""


class SectionTable(Table):
    """``[[structure.sections]]``, ``[[beam.sections]]``: a uniform stretch of a beam along +X."""

    length: Length
    width: Length
    height: Length
    youngs_modulus: Modulus = 210e9
    density: Density = 7850.0
    elements: int = Field(default=20, ge=1)


class StructureTable(Table):
    """``[structure]`` and ``[beam]``: by parameters, by matrices of a finite element program, or as measured."""

    kind: Literal["double beam", "beam", "plate", "matrices", "measured"]
    part: str | None = None
    length: Length | None = None
    width: Length | None = None
    height: Length | None = None
    youngs_modulus: Modulus = 210e9
    density: Density = 7850.0
    poisson: float = Field(default=0.3, gt=-1, lt=0.5)
    elements: int | Annotated[list[int], Field(min_length=2, max_length=2)] | None = None
    sections: list[SectionTable] = []
    ends: Ends | None = None
    held: bool = False
    mass: str = ""
    stiffness: str = ""
    dofs: str | list[str] = ""
    length_unit: Annotated[float, in_si("displacement"), Field(gt=0)] = 1.0
    mass_unit: Annotated[float, in_si("mass"), Field(gt=0)] = 1.0
    file: str = ""
    run: str = ""

    @model_validator(mode="after")
    def _complete(self) -> "StructureTable":
        allowed = _KEYS[self.kind]
        strange = sorted(self.model_fields_set - allowed - {"kind", "part"})
        if strange:
            raise ValueError(
                f"{strange[0]!r} says nothing about a {self.kind}; its keys are " + ", ".join(sorted(allowed))
            )
        if self.kind == "beam" and self.sections and self.length is not None:
            raise ValueError("a beam is uniform (length, width, height) or made of sections, not both")
        needed = () if self.sections else _NEEDED[self.kind]
        for key in needed:
            if getattr(self, key) in (None, "", []):
                raise ValueError(f"a {self.kind} needs {key!r}")
        if self.kind == "plate" and isinstance(self.elements, int):
            raise ValueError("a plate needs two numbers of elements, along x and y: elements = [9, 5]")
        if self.kind in ("beam", "double beam") and isinstance(self.elements, list):
            raise ValueError("a beam has one number of elements")
        counts = self.elements if isinstance(self.elements, list) else [self.elements or 1]
        if min(counts) < 1:
            raise ValueError("one element or more")
        return self


SIZE = {"length", "width", "height", "youngs_modulus", "density", "elements"}
_KEYS: dict[str, set[str]] = {
    "double beam": SIZE,
    "beam": SIZE | {"sections", "ends"},
    "plate": SIZE | {"poisson", "held"},
    "matrices": {"mass", "stiffness", "dofs", "length_unit", "mass_unit"},
    "measured": {"file", "run"},
}
_NEEDED: dict[str, tuple[str, ...]] = {
    "double beam": (),
    "beam": ("length", "width", "height"),
    "plate": ("length", "width", "height", "elements"),
    "matrices": ("mass", "stiffness", "dofs"),
    "measured": ("file",),
}


class LawTable(Table):
    """``[law]``, ``[joints.law]``: a friction law by name, with its parameters."""

    name: str
    friction_coefficient: float = Field(ge=0)
    contact_stiffness: Stiffness | None = None
    stiffness_exponent: float = Field(default=0.0, ge=0)
    reference_force: Annotated[float, in_si("force"), Field(gt=0)] = 1000.0
    stiffness_cap: Stiffness = float("inf")
    isotropic: bool = True
    exponent: float | None = Field(default=None, gt=0)
    shape: float | None = Field(default=None, gt=0)
    gamma: float | None = Field(default=None, ge=-1, le=0.5)
    kappa: float | None = Field(default=None, ge=0, le=0.999)
    chi: float | None = Field(default=None, gt=-1, le=1)
    beta: float | None = Field(default=None, ge=0)
    springs: int | None = Field(default=None, ge=2)
    stiffness_shares: list[Annotated[float, Field(gt=0)]] | None = None
    force_shares: list[Annotated[float, Field(ge=0)]] | None = None
    bristle_damping: Damping | None = None
    viscous: Damping | None = None
    summit_deviation: Length | None = None
    poisson: float | None = Field(default=None, gt=-1, le=0.5)
    separation: float | None = Field(default=None, gt=0, le=6)
    static_ratio: float | None = Field(default=None, ge=1)
    stribeck_velocity: Velocity | None = None
    parameters: list[float] | None = Field(default=None, max_length=4)

    @model_validator(mode="after")
    def _complete(self) -> "LawTable":
        own = LAW_PARAMETERS.get(self.name, ("parameters",)) + INSTEAD.get(self.name, ())
        every = {key for part in (LAW_PARAMETERS, INSTEAD) for keys in part.values() for key in keys} | {"parameters"}
        strange = sorted((self.model_fields_set & every) - set(own))
        if strange:
            known = ", ".join(own) or "none of its own"
            raise ValueError(f"{strange[0]!r} is no parameter of the law {self.name!r}; it has {known}")
        if self.name in ROUGH:
            self._rough()
        elif self.contact_stiffness is None and self.name != "coulomb":
            raise ValueError('a law needs a contact_stiffness such as "1e9 N/m"; only coulomb may go without')
        if self.name == "iwan" and (self.chi or 0.0) > 0:
            raise ValueError(f"chi = {self.chi:g} is above 0, where the law 'iwan' ends; take 'modified iwan'")
        if self.name == "parallel masing":
            for key in own:
                shares = getattr(self, key)
                if not shares or abs(sum(shares) - 1) > 1e-9:
                    raise ValueError(f"{key} is a list of numbers whose sum is 1")
            if len(self.stiffness_shares or ()) != len(self.force_shares or ()):
                raise ValueError("every spring has a stiffness share and a force share")
        return self

    def _rough(self) -> None:
        if (self.contact_stiffness is None) == (self.summit_deviation is None):
            raise ValueError(
                f'the law {self.name!r} needs a summit_deviation such as "1 um", or the contact_stiffness at its '
                "reference_force; one of them"
            )
        if self.poisson is not None and self.summit_deviation is None:
            raise ValueError("poisson goes with summit_deviation; a contact_stiffness has it in it")
        if "separation" in LAW_PARAMETERS[self.name] and self.separation is None:
            raise ValueError(f"the law {self.name!r} needs a separation such as 3; rough contact goes without")
        for key in sorted(self.model_fields_set & {"stiffness_exponent", "stiffness_cap"}):
            raise ValueError(f"{key!r} follows from the heights of the law {self.name!r}; leave it out")


LAW_PARAMETERS: dict[str, tuple[str, ...]] = {
    name: tuple(parameter.key for parameter in law.parameters) for name, law in CATALOGUE.items()
}
"""The parameters of the built-in laws; a law of the user's own has ``parameters``."""
INSTEAD: dict[str, tuple[str, ...]] = {
    name: tuple(parameter.key for parameter in law.instead) for name, law in CATALOGUE.items() if law.instead
}
"""What may be stated in the place of the contact stiffness."""


class PointTable(Table):
    """A point of a measured curve of the normal contact."""

    penetration: Annotated[float, in_si("displacement")]
    force: Force


class ContactTable(Table):
    """``[joints.normal_contact]``: how the surfaces resist being pressed together."""

    name: Literal["linear", "power", "curve", "rough"] = "linear"
    exponent: float = Field(default=1.0, ge=1)
    reference_force: Annotated[float, in_si("force"), Field(gt=0)] = 1000.0
    points: list[PointTable] = []
    summit_deviation: Length | None = None
    separation: float | None = Field(default=None, gt=0, le=6)

    @model_validator(mode="after")
    def _complete(self) -> "ContactTable":
        own = {
            "linear": set(),
            "power": {"exponent", "reference_force"},
            "curve": {"points"},
            "rough": {"summit_deviation", "reference_force", "separation"},
        }[self.name]
        strange = sorted(self.model_fields_set - own - {"name"})
        if strange:
            raise ValueError(f"{strange[0]!r} says nothing about a {self.name} contact")
        if self.name == "curve" and len(self.points) < 2:
            raise ValueError('a curve has two points or more: points = [{ penetration = "0 um", force = "0 N" }, ...]')
        if self.name == "rough" and self.summit_deviation is None:
            raise ValueError('a rough contact needs a summit_deviation such as "1 um"')
        return self


class JointTable(Table):
    """``[[joints]]``: nodes of host and beam that are pressed together."""

    name: str = ""
    pairs: list[Annotated[list[int], Field(min_length=2, max_length=2)]] = []
    host_nodes: Nodes | None = None
    beam_nodes: Nodes | None = None
    half_heights: Annotated[list[HalfHeight], Field(min_length=2, max_length=2)] | None = None
    normal_force: NormalForce
    normal_stiffness: Stiffness | None = None
    directions: Annotated[list[Axis], Field(min_length=1, max_length=2)] = ["X"]
    force_shares: list[Annotated[float, Field(ge=0)]] | None = None
    area_shares: list[Annotated[float, Field(ge=0)]] | None = None
    area: Annotated[float, in_si("area"), Field(gt=0)] | None = None
    normal_contact: ContactTable = ContactTable()
    tangential_loss: Ratio = 0.0
    normal_loss: Ratio = 0.0
    normal_exponent: float = Field(default=0.0, ge=0)
    law: LawTable | None = None

    @model_validator(mode="after")
    def _sound(self) -> "JointTable":
        ranges = (self.host_nodes, self.beam_nodes)
        if self.pairs and any(ranges):
            raise ValueError("the node pairs come as pairs, or as host_nodes and beam_nodes; not both")
        if (self.host_nodes is None) != (self.beam_nodes is None):
            raise ValueError("host_nodes and beam_nodes go together")
        if len(self.host_nodes or ()) != len(self.beam_nodes or ()):
            raise ValueError(
                f"{len(self.host_nodes or ())} host_nodes cannot be paired with {len(self.beam_nodes or ())} beam_nodes"
            )
        if len(set(self.directions)) < len(self.directions):
            raise ValueError("a direction named twice")
        return self


class DampingTable(Table):
    """``[damping]``: background damping, without the joints."""

    ratio: Ratio = 0.0
    mass_factor: Annotated[float, in_si("frequency"), Field(ge=0)] = 0.0


class SnapbackTable(Table):
    """``[snapback]``: a load raised slowly and let go."""

    load: Force
    at: Place
    duration: Seconds
    outputs: Places = []
    sampling_rate: Frequency = 5000.0
    tolerance: Tolerance = 1e-3


class FrfTable(Table):
    """``[frf]``: steady states over frequency, at one or several force levels."""

    force: Forces
    at: Place
    band: Band
    outputs: Places = []
    lines: int = Field(default=200, ge=2)
    tolerance: Tolerance = 5e-3


class MapTable(Table):
    """``[map]``: resonance over excitation and normal force."""

    force: Forces
    normal_force: NormalForces
    at: Place
    band: Band
    output: Place | None = None
    tolerance: Tolerance = 5e-3


class LoopTable(Table):
    """``[loop]``: hysteresis of one joint under prescribed motion."""

    amplitude: Annotated[list[Length], BeforeValidator(as_list), Field(min_length=1)]
    normal_force: NormalForces | None = None
    joint: str = ""
    frequency: Frequency = 1.0


class ControlTable(Table):
    """``[control]``: what a controlled normal force brings at a tool point, after a release and, with ``force``, in the
    cut."""

    at: Place
    load: Force
    normal_force: NormalForces
    band: Band
    force: Forces | None = None
    lag: Seconds | None = None
    specific_force: Modulus = 2e9


class ModelFile(Table):
    """The whole of ``model.toml``."""

    model: ModelTable
    structure: StructureTable
    beam: StructureTable | None = None
    joints: Annotated[list[JointTable], Field(min_length=1)]
    law: LawTable | None = None
    damping: DampingTable = DampingTable()
    snapback: SnapbackTable | None = None
    frf: FrfTable | None = None
    map: MapTable | None = None
    loop: LoopTable | None = None
    control: ControlTable | None = None

    @model_validator(mode="after")
    def _sound(self) -> "ModelFile":
        names = [joint.name for joint in self.joints if joint.name]
        if len(set(names)) < len(names):
            raise ValueError("two joints of one name")
        if self.structure.kind == "double beam":
            if self.beam is not None or len(self.joints) != 1:
                raise ValueError("a double beam brings its second beam along and has one joint")
        elif self.beam is not None and self.beam.kind not in ("beam", "plate", "matrices"):
            raise ValueError(
                f"a friction beam cannot be a {self.beam.kind}; it is a beam, a plate or given by matrices"
            )
        for number, joint in enumerate(self.joints, 1):
            if joint.law is None and self.law is None:
                raise ValueError(f"joint {joint.name or number} has no friction law; add [law] or [joints.law]")
            if not joint.pairs and joint.host_nodes is None and self.structure.kind != "double beam":
                raise ValueError(f"joint {joint.name or number} has no node pairs; add pairs = [[host, beam], ...]")
        return self


KIND = FileKind(
    table=ModelFile,
    tables={
        "": ModelFile,
        "model": ModelTable,
        "structure": StructureTable,
        "structure.sections": SectionTable,
        "beam": StructureTable,
        "beam.sections": SectionTable,
        "joints": JointTable,
        "joints.law": LawTable,
        "joints.normal_contact": ContactTable,
        "joints.normal_contact.points": PointTable,
        "law": LawTable,
        "damping": DampingTable,
        "snapback": SnapbackTable,
        "frf": FrfTable,
        "map": MapTable,
        "loop": LoopTable,
        "control": ControlTable,
    },
    name=FILE_NAME,
    absent="there is no model here",
    guide="docs/simulate.md",
)


def locate(path: str | Path) -> Path:
    """The file of a model, named itself or by its folder."""
    return KIND.locate(path)


def load(path: str | Path) -> ModelFile:
    """Read ``model.toml``; a former name of a key is read, with a warning.

    Parameters
    ----------
    path : str or Path
        The file, or the folder that holds it.

    Returns
    -------
    ModelFile
        Content of the file, checked.

    Raises
    ------
    InputError
        There is no such file, it is no TOML, or a key is unknown, missing or wrong; the message names its line.
    """
    model = KIND.load(path)
    warn(model.former_names)
    return model
