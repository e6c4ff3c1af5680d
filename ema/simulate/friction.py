"""Friction laws: their constructors, and how they are handed to the compiled solvers.

Every law is elastic with k_T at first and limited by F_C = mu F_N; the time and the frequency solver use the same
compiled increment (``friction_kernels``).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from ema.data import FrictionLaw
from ema.errors import InputError

PIECEWISE_LINEAR = ("masing", "coulomb", "parallel masing", "iwan")
"""Laws that consist of Masing springs: the event-driven reference mode takes these."""

UserFunction = Callable[[float, float, float, float, float, float, float, float], float]
_USER: dict[str, tuple[UserFunction, Any]] = {}
_TABLE_SIZE = 2049


def Masing(friction_coefficient: float, contact_stiffness: float, **options: Any) -> FrictionLaw:
    """Elastic up to F_C, then sliding (Gaul, Roseira and Becker 2008, Eq. 4).

    ``friction_coefficient`` -, ``contact_stiffness`` N/m of the whole joint. ``options`` of every law:
    ``stiffness_exponent``, ``reference_force`` N, ``stiffness_cap`` N/m, ``isotropic`` (see ``FrictionLaw``).
    """
    return FrictionLaw("masing", friction_coefficient, contact_stiffness, **options)


def RegularisedMasing(
    friction_coefficient: float, contact_stiffness: float, exponent: float = 8.0, **options: Any
) -> FrictionLaw:
    """The smooth evolution rule (Gaul, Roseira and Becker 2008, Eq. 5) with ``exponent`` m > 0 on \\|F/F_C\\|.

    It dissipates below F_C, and a preload relaxes under small cycles, which no Masing spring does.

    Raises
    ------
    InputError : the exponent is not positive.
    """
    if not (np.isfinite(exponent) and exponent > 0):
        raise InputError("not an exponent", where="regularised Masing", got=exponent, expected="m > 0, e.g. 8")
    return FrictionLaw(
        "regularised masing", friction_coefficient, contact_stiffness, (("exponent", float(exponent)),), **options
    )


def Coulomb(friction_coefficient: float, stick_stiffness: float = float("inf"), **options: Any) -> FrictionLaw:
    """Rigid friction as the stiff limit of a Masing spring.

    ``stick_stiffness`` N/m of the whole joint; by default 1000 times the structure's own stiffness at the contacts,
    and a finding of every result tells the number.
    """
    return FrictionLaw("coulomb", friction_coefficient, stick_stiffness, **options)


def ParallelMasing(
    friction_coefficient: float,
    contact_stiffness: float,
    stiffness_shares: Sequence[float],
    force_shares: Sequence[float],
    **options: Any,
) -> FrictionLaw:
    """Masing springs in parallel; the shares (each list sums to 1) divide k_T and F_C among them.

    Raises
    ------
    InputError : the lists differ in length, hold a negative number, or do not sum to 1.
    """
    for name, shares in (("stiffness_shares", stiffness_shares), ("force_shares", force_shares)):
        if min(shares, default=-1) < 0 or abs(sum(shares) - 1) > 1e-9:
            raise InputError("not shares", where="parallel Masing", got=f"{name} = {list(shares)}",
                             expected="0 or more each, sum 1")  # fmt: skip
    if len(stiffness_shares) != len(force_shares) or min(stiffness_shares) == 0:
        raise InputError("every spring needs a share of stiffness and of force", where="parallel Masing",
                         got=f"{len(stiffness_shares)} and {len(force_shares)}",
                         expected="equal lengths, stiffness above 0")  # fmt: skip
    springs = [(f"stiffness share {n}", float(s)) for n, s in enumerate(stiffness_shares)]
    springs += [(f"force share {n}", float(s)) for n, s in enumerate(force_shares)]
    return FrictionLaw("parallel masing", friction_coefficient, contact_stiffness, tuple(springs), **options)


def Iwan(
    friction_coefficient: float, contact_stiffness: float, chi: float = -0.5, beta: float = 1.0, springs: int = 60,
    **options: Any,
) -> FrictionLaw:  # fmt: skip
    """Four-parameter Iwan model (Segalman 2005): F_S = mu F_N, K_T, chi, beta, in ``springs`` Masing springs.

    Raises
    ------
    InputError : chi outside (-1, 0], beta below 0, fewer than 2 springs.
    """
    if not -1 < chi <= 0 or not beta >= 0 or springs < 2:
        raise InputError("not an Iwan model", got=f"chi {chi}, beta {beta}, {springs} springs",
                         expected="-1 < chi <= 0, beta >= 0, 2 or more springs")  # fmt: skip
    parameters = (("chi", float(chi)), ("beta", float(beta)), ("springs", float(springs)))
    return FrictionLaw("iwan", friction_coefficient, contact_stiffness, parameters, **options)


def Dahl(friction_coefficient: float, contact_stiffness: float, shape: float = 1.0, **options: Any) -> FrictionLaw:
    """Dahl (1968): dF/du = k_T \\|1 - sgn(v) F/F_C\\|^shape.

    Raises
    ------
    InputError : the shape exponent is not positive.
    """
    if not (np.isfinite(shape) and shape > 0):
        raise InputError("not a shape exponent", where="Dahl", got=shape, expected="above 0, usually 1")
    return FrictionLaw("dahl", friction_coefficient, contact_stiffness, (("shape", float(shape)),), **options)


def LuGre(
    friction_coefficient: float, contact_stiffness: float, bristle_damping: float = 0.0, viscous: float = 0.0,
    static_ratio: float = 1.0, stribeck_velocity: float = 1e-3, **options: Any,
) -> FrictionLaw:  # fmt: skip
    """LuGre (Canudas de Wit et al. 1995) of the whole joint.

    ``bristle_damping`` and ``viscous`` in N s/m, ``static_ratio`` F_S/F_C, ``stribeck_velocity`` in m/s.

    Raises
    ------
    InputError : a negative damping, a static ratio below 1, a velocity that is not positive.
    """
    if min(bristle_damping, viscous) < 0 or static_ratio < 1 or not stribeck_velocity > 0:
        raise InputError("not a LuGre model",
                         got=f"{bristle_damping=}, {viscous=}, {static_ratio=}, {stribeck_velocity=}",
                         expected="dampings of 0 or more, F_S/F_C of 1 or more, a positive velocity")  # fmt: skip
    parameters = (("bristle damping", float(bristle_damping)), ("viscous", float(viscous)),
                  ("static ratio", float(static_ratio)), ("stribeck velocity", float(stribeck_velocity)))  # fmt: skip
    return FrictionLaw("lugre", friction_coefficient, contact_stiffness, parameters, **options)


def register_law(name: str, function: UserFunction) -> Callable[..., FrictionLaw]:
    """Make a law of one's own known to both solvers.

    ``function(force, slip_increment, contact_stiffness, slip_force, p0, p1, p2, p3)`` returns the new force; it is
    compiled. Up to four parameters are handed through. The result is used like every other law:

    >>> def jenkins(force, du, k, limit, p0, p1, p2, p3):
    ...     return min(max(force + k * du, -limit), limit)
    >>> mine = register_law("jenkins of mine", jenkins)
    >>> law = mine(friction_coefficient=0.3, contact_stiffness=1e9)

    Raises
    ------
    InputError : the name is taken by a built-in law, the function cannot be compiled or does not return a number.
    """
    import numba as nb

    if name in _CODES:
        raise InputError("the name of a built-in law", where="register_law", got=name, expected="a name of your own")
    try:
        compiled = nb.cfunc(nb.float64(*[nb.float64] * 8))(function)
        trial = compiled.ctypes(0.0, 1e-9, 1e6, 1.0, 0.0, 0.0, 0.0, 0.0)
    except Exception as error:
        raise InputError("the law cannot be compiled", where=f"law {name}", got=str(error).strip().splitlines()[0],
                         expected="a function of eight numbers that returns a number",
                         advice="use plain arithmetic, comparisons and the math module only") from error  # fmt: skip
    if not np.isfinite(trial):
        raise InputError("the law returns no number", where=f"law {name}", got=trial, expected="a finite force")
    _USER[name] = (function, compiled)

    def make(friction_coefficient: float, contact_stiffness: float, *parameters: float, **options: Any) -> FrictionLaw:
        named = tuple((f"p{n}", float(p)) for n, p in enumerate(parameters))
        return FrictionLaw(name, friction_coefficient, contact_stiffness, named, **options)

    return make


_CODES = {"masing": 0, "coulomb": 0, "parallel masing": 0, "iwan": 0, "regularised masing": 1, "dahl": 2, "lugre": 3}

_PARAMETERS = {
    "regularised masing": ("exponent",), "iwan": ("chi", "beta", "springs"), "dahl": ("shape",),
    "lugre": ("bristle damping", "viscous", "static ratio", "stribeck velocity"),
}  # fmt: skip
"""Parameters of the laws whose constructors check them, in the order in which the kernels take them."""


@dataclass(frozen=True)
class PackedLaws:
    """The laws of all contacts as arrays; ``arguments`` is what the kernels take."""

    codes: Int[np.ndarray, "contact"]
    parameters: Float[np.ndarray, "contact 8"]
    stiffness_shares: Float[np.ndarray, "contact spring"]
    force_shares: Float[np.ndarray, "contact spring"]
    counts: Int[np.ndarray, "contact"]
    tables: Float[np.ndarray, "table 3 size"]
    user: Any

    @property
    def single_springs(self) -> bool:
        """Whether every contact is one Masing spring, for which the solvers know closed forms."""
        return bool(np.all((self.codes == 0) & (self.counts == 1)))

    @property
    def arguments(self) -> tuple[Any, ...]:
        """Codes, parameters, shares of stiffness and force, counts, tables and the user's function."""
        return (
            self.codes, self.parameters, self.stiffness_shares, self.force_shares, self.counts, self.tables, self.user
        )  # fmt: skip


def check_isotropic(law: FrictionLaw, where: str) -> None:
    """Refuse an isotropic law in two directions that has no vector form.

    Raises
    ------
    InputError : the law is a user's own.
    """
    if law.isotropic and law.name in _USER:
        raise InputError("a law of the user's own has no isotropic form", where=where, got=f"{law.name}",
                         expected="isotropic=False, or one of " + ", ".join(sorted(_CODES)))  # fmt: skip


def check_parameters(law: FrictionLaw) -> None:
    """Refuse a law that was not made by its constructor, or was changed since.

    Raises
    ------
    InputError : a parameter is missing, too many, or no number.
    """
    names = tuple(name for name, _ in law.parameters)
    if law.name in _PARAMETERS and names != _PARAMETERS[law.name]:
        raise InputError("not the parameters of this law", where=f"law {law.name}", got=", ".join(names) or "none",
                         expected=", ".join(_PARAMETERS[law.name]),
                         advice="make it by its constructor in ema.simulate")  # fmt: skip
    if not all(np.isfinite(value) for _, value in law.parameters):
        raise InputError("a parameter is no number", where=f"law {law.name}", got=dict(law.parameters),
                         expected="finite numbers")  # fmt: skip


def springs_of(law: FrictionLaw) -> tuple[Float[np.ndarray, "spring"], Float[np.ndarray, "spring"]]:
    """Shares of stiffness and of slip force of the Masing springs that make a piecewise linear law."""
    values = dict(law.parameters)
    if law.name == "parallel masing":
        count = len(values) // 2
        return (
            np.array([values[f"stiffness share {n}"] for n in range(count)]),
            np.array([values[f"force share {n}"] for n in range(count)]),
        )
    if law.name == "iwan":
        return iwan_springs(values["chi"], values["beta"], int(values["springs"]))
    return np.ones(1), np.ones(1)


def iwan_springs(
    chi: float, beta: float, count: int
) -> tuple[Float[np.ndarray, "spring"], Float[np.ndarray, "spring"]]:
    """Shares of the Masing springs of an Iwan model: power-law density up to the largest slip, and a spring there.

    Every spring has the stiffness and the slip force of its stretch of the density (Segalman 2005, Eqs. 10-14).
    """
    scale = beta + (chi + 1) / (chi + 2)
    largest = (1 + beta) / scale
    density = (chi + 1) / (largest ** (chi + 2) * scale)
    edges = np.concatenate([[0.0], np.geomspace(3e-4, 1.0, count - 1 if beta > 0 else count)]) * largest
    stiffness = density * np.diff(edges ** (chi + 1)) / (chi + 1)
    force = density * np.diff(edges ** (chi + 2)) / (chi + 2)
    if beta > 0:
        last = beta / scale / largest
        stiffness, force = np.append(stiffness, last), np.append(force, last * largest)
    return stiffness / stiffness.sum(), force / force.sum()


def virgin_rate(y: Float[np.ndarray, "*shape"], exponent: float) -> Float[np.ndarray, "*shape"]:
    """dx/dy of the virgin curve of Eq. (5), dphi/dx = 1 - phi^m, with phi = 1 - exp(-y): smooth up to full slip."""
    rest = np.maximum(np.exp(-y), 1e-300)
    with np.errstate(divide="ignore"):
        return np.asarray(rest / -np.expm1(exponent * np.log1p(-rest)))


@lru_cache(maxsize=32)
def _virgin_table(exponent: float) -> tuple[np.ndarray, float, float]:
    """Virgin curve of Eq. (5) for one exponent: (value, slope, curvature) over a graded grid, its span and grading."""
    points, weights = np.polynomial.legendre.leggauss(12)
    points, weights = (points + 1) / 2, weights / 2

    def climb(start: np.ndarray, end: np.ndarray) -> np.ndarray:
        y = start[:, None] + (end - start)[:, None] * points
        return np.asarray((virgin_rate(y, exponent) @ weights) * (end - start))

    nodes = 36.0 * np.linspace(0, 1, 1200) ** 5
    places = np.concatenate([[0.0], np.cumsum(climb(nodes[:-1], nodes[1:]))])
    span = float(places[-1])
    power = 1.0 if exponent >= 5 or exponent == round(exponent) else 5.0
    t = np.linspace(0, 1, _TABLE_SIZE)
    x = span * t**power
    cell = np.clip(np.searchsorted(places, x, side="right") - 1, 0, len(nodes) - 2)
    y = np.interp(x, places, nodes)
    for _ in range(8):
        rate = virgin_rate(np.maximum(y, 1e-300), exponent)
        y = np.clip(y - (places[cell] + climb(nodes[cell], y) - x) / rate, nodes[cell], nodes[cell + 1])
    phi = -np.expm1(-y)
    slope = -np.expm1(exponent * np.log(np.maximum(phi, 1e-300)))
    curvature = -exponent * np.maximum(phi, 1e-60) ** (exponent - 1) * slope
    curvature[0] = -1.0 if exponent == 1 else 0.0
    stretch = span * power * t ** (power - 1)
    bend = span * power * (power - 1) * t ** max(power - 2, 0)
    return np.array([phi, slope * stretch, curvature * stretch**2 + slope * bend]), span, power


def pack(laws: Sequence[FrictionLaw], counts_of_joint: Sequence[int]) -> PackedLaws:
    """Arrays of the laws of all contacts; ``counts_of_joint`` is the number of pairs that share each contact's joint.

    Raises
    ------
    InputError : a law is unknown or lacks a parameter, or more than one law of the user's own is present.
    """
    from ema.simulate.friction_kernels import no_user_law

    size = len(laws)
    for law in {id(law): law for law in laws}.values():
        check_parameters(law)
    springs = {id(law): springs_of(law) for law in laws}
    width = max(3, *(len(shares[0]) for shares in springs.values()))
    codes, counts = np.zeros(size, np.int64), np.ones(size, np.int64)
    parameters, shares_k, shares_f = np.zeros((size, 8)), np.zeros((size, width)), np.zeros((size, width))
    shares_f[:, 0] = shares_k[:, 0] = 1.0
    tables: dict[float, int] = {}
    user, user_name = no_user_law, ""
    for row, law in enumerate(laws):
        values = [value for _, value in law.parameters]
        if law.name in _USER:
            if user_name not in ("", law.name):
                raise InputError("two laws of the user's own in one model", got=f"{user_name} and {law.name}",
                                 expected="one")  # fmt: skip
            codes[row], user, user_name = 4, _USER[law.name][1], law.name
            parameters[row, : len(values)] = values
            continue
        if law.name not in _CODES:
            raise InputError("unknown friction law", got=law.name, expected="one of " + ", ".join(sorted(_CODES)),
                             advice="a law of your own: ema.simulate.register_law")  # fmt: skip
        codes[row] = _CODES[law.name]
        if codes[row] == 0:
            stiffness, force = springs[id(law)]
            counts[row] = len(stiffness)
            shares_k[row, : len(stiffness)], shares_f[row, : len(force)] = stiffness, force
        elif codes[row] == 1:
            exponent = values[0]
            place = tables.setdefault(exponent, len(tables))
            _, span, power = _virgin_table(exponent)
            parameters[row, :5] = exponent, place, _TABLE_SIZE, span, power
        elif codes[row] == 3:
            share = counts_of_joint[row]
            parameters[row, :4] = values[0] / share, values[1] / share, values[2], values[3]
        else:
            parameters[row, : len(values)] = values
    stack = np.array([_virgin_table(m)[0] for m in tables]) if tables else np.zeros((1, 3, 2))
    return PackedLaws(codes, parameters, shares_k, shares_f, counts, stack, user)
