"""The friction laws there are: their parameters with units, limits and defaults, and where they come from."""

from dataclasses import dataclass
from math import isfinite

from ema.errors import InputError


@dataclass(frozen=True)
class Parameter:
    """A number of a law: name, unit, default, meaning; ``low`` and ``high`` are allowed unless ``open_below``.

    Of a list, one number per spring, as ``several`` says; it has no default. ``shared``: pairs of a joint share it, as
    it is that of the whole joint.
    """

    name: str
    unit: str
    default: float
    meaning: str
    low: float = 0.0
    high: float = float("inf")
    open_below: bool = True
    several: bool = False
    shared: bool = False

    @property
    def key(self) -> str:
        """The name as an argument and in a model file."""
        return self.name.replace(" ", "_")

    @property
    def limits(self) -> str:
        """What is allowed, in words."""
        below = f"above {self.low:g}" if self.open_below else f"{self.low:g} or more"
        return below if self.high == float("inf") else f"{below} and up to {self.high:g}"

    def allows(self, value: float) -> bool:
        """Whether a value is within the limits; NaN is not."""
        return isfinite(value) and (self.low < value if self.open_below else self.low <= value) and value <= self.high


PROJECTED = "plane_projected"
"""The compiled function for isotropic friction that takes any law of one internal force."""


@dataclass(frozen=True)
class KnownLaw:
    """A built-in law: its name, the compiled function that takes its increments, its parameters, its source.

    ``plane``: that for isotropic friction in two directions. ``above``: the parameter, if any, that states the largest
    friction force of slow motion over F_C. ``instead``: what a file may state in the place of k_T. ``rates``: whether
    the force depends on velocities besides displacements; its states are then those of ``call_kernels``.
    """

    name: str
    kernel: str
    constructor: str
    parameters: tuple[Parameter, ...]
    meaning: str
    plane: str = PROJECTED
    above: str = ""
    instead: tuple[Parameter, ...] = ()
    rates: bool = False


_BETA = Parameter("beta", "-", 1.0, "stiffness of the spring that slips last over that of the others", open_below=False)
_SPRINGS = Parameter("springs", "-", 60.0, "Masing springs that stand for the continuum", low=2.0, open_below=False)
_SEPARATION = Parameter(
    "separation",
    "-",
    float("nan"),
    "of the mean of the heights at the reference force, over their deviation; to be stated",
    high=6.0,
)
_SURFACE = (
    Parameter("summit deviation", "m", float("nan"), "standard deviation of the summit heights"),
    Parameter("poisson", "-", 0.3, "Poisson's ratio of both bodies", low=-1.0, high=0.5),
)
CATALOGUE: dict[str, KnownLaw] = {
    law.name: law
    for law in (
        KnownLaw(
            "masing",
            "spring",
            "Masing",
            (),
            "elastic up to F_C, then sliding (Gaul, Roseira and Becker 2008, Eq. 4)",
            "plane_springs",
        ),
        KnownLaw(
            "coulomb", "spring", "Coulomb", (), "rigid friction, as the stiff limit of a Masing spring", "plane_springs"
        ),
        KnownLaw(
            "parallel masing",
            "springs",
            "ParallelMasing",
            (
                Parameter("stiffness shares", "-", float("nan"), "of k_T, sum 1, one per spring", several=True),
                Parameter(
                    "force shares", "-", float("nan"), "of F_C, sum 1, one per spring", open_below=False, several=True
                ),
            ),
            "Masing springs in parallel",
            "plane_springs",
        ),
        KnownLaw(
            "iwan",
            "springs",
            "Iwan",
            (
                Parameter("chi", "-", -0.5, "loss in microslip ~ amplitude^(3 + chi)", low=-1.0, high=0.0),
                _BETA,
                _SPRINGS,
            ),
            "four-parameter model: power-law distribution of Masing springs (Segalman 2005)",
            "plane_springs",
        ),
        KnownLaw(
            "modified iwan",
            "springs",
            "ModifiedIwan",
            (
                Parameter("chi", "-", 0.5, "loss in microslip ~ amplitude^(3 + chi)", low=-1.0, high=1.0),
                _BETA,
                _SPRINGS,
            ),
            "the same with any power; the stiffness is finite for chi above -1",
            "plane_springs",
        ),
        KnownLaw(
            "rough contact",
            "rough",
            "RoughContact",
            (_SPRINGS,),
            "exponential heights of Hertzian summits (Greenwood and Williamson 1966) that slip each (Mindlin 1949)",
            "plane_rough",
            instead=_SURFACE,
        ),
        KnownLaw(
            "gaussian rough contact",
            "rough",
            "RoughContact",
            (_SEPARATION, _SPRINGS),
            "the same with Gaussian heights",
            "plane_rough",
            instead=_SURFACE,
        ),
        KnownLaw(
            "regularised masing",
            "bouc_wen",
            "RegularisedMasing",
            (Parameter("exponent", "-", 8.0, "m on |F/F_C|"),),
            "smooth rule (Gaul, Roseira and Becker 2008, Eq. 5)",
            "plane_regularised",
        ),
        KnownLaw(
            "bouc wen",
            "bouc_wen",
            "BoucWen",
            (
                Parameter("exponent", "-", 1.0, "n on |F/F_C|"),
                Parameter(
                    "gamma",
                    "-",
                    0.5,
                    "share of the loss that asks for no direction, beta = 1 - gamma",
                    low=-1.0,
                    high=0.5,
                    open_below=False,
                ),
            ),
            "Bouc (1967), Wen (1976), A = beta + gamma = 1; gamma up to 1/2 gains no energy (Erlicher and Point 2004)",
        ),
        KnownLaw(
            "dahl",
            "dahl",
            "Dahl",
            (Parameter("shape", "-", 1.0, "exponent on 1 - F/F_C"),),
            "Dahl (1968)",
            "plane_dahl",
        ),
        KnownLaw(
            "valanis",
            "valanis",
            "Valanis",
            (Parameter("kappa", "-", 0.9, "0: Dahl, towards 1: Masing", high=0.999, open_below=False),),
            "Valanis (1971) without hardening (Gaul and Nitsche 2001)",
        ),
        KnownLaw(
            "lugre",
            "lugre",
            "LuGre",
            (
                Parameter("bristle damping", "N s/m", 0.0, "sigma_1 of the whole joint", open_below=False, shared=True),
                Parameter("viscous", "N s/m", 0.0, "sigma_2 of the whole joint", open_below=False, shared=True),
                Parameter("static ratio", "-", 1.0, "F_S/F_C", low=1.0, open_below=False),
                Parameter("stribeck velocity", "m/s", 1e-3, "at which F_S - F_C has fallen to 1/e of itself"),
            ),
            "LuGre (Canudas de Wit et al. 1995)",
            "plane_lugre",
            above="static ratio",
            rates=True,
        ),
    )
}


def knows_velocities(name: str) -> bool:
    """Whether the force of a law depends on velocities besides; no law of the user's own does."""
    return name in CATALOGUE and CATALOGUE[name].rates


def checked(name: str, *values: float) -> tuple[tuple[str, float], ...]:
    """Names and values of the parameters of a law.

    Raises
    ------
    InputError : one is outside its limits, or no number.
    """
    pairs = list(zip(CATALOGUE[name].parameters, values, strict=True))
    for parameter, value in pairs:
        if not parameter.allows(value):
            raise InputError(
                "not a parameter of this law",
                where=f"law {name}",
                got=f"{parameter.name} {value:g}",
                expected=parameter.limits,
            )
    return tuple((parameter.name, float(value)) for parameter, value in pairs)
