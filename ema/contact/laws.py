"""Friction laws of many contacts as the compiled solvers take them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib import import_module
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ema.contact.catalogue import CATALOGUE, PROJECTED, KnownLaw
from ema.contact.contract import broken
from ema.contact.curves import bouc_wen_shape, tables
from ema.contact.iwan import springs_of
from ema.contact.rough import ROUGH, bed
from ema.data import FrictionLaw
from ema.errors import InputError
from ema.own_functions import LawName

UserFunction = Callable[[float, float, float, float, float, float, float, float], float]


class OwnLaw(NamedTuple):
    """A law of the user's own: the function, what it was compiled to, and its ``ema.own_functions.of_function``."""

    function: UserFunction
    compiled: Any
    fingerprint: str


REGISTERED: dict[str, OwnLaw] = {}
"""Laws of the user's own by name."""

_OWN = 4
"""Parameters that the function of such a law takes, p0 to p3."""

_MODULES = {"spring": "springs", "rough": "springs", "own_in_steps": "own"} | dict.fromkeys(
    (law.plane for law in CATALOGUE.values()), "plane"
)
_ELASTIC, _STATES = ("spring", "springs", "rough"), {"bouc_wen": 3, "normal": 2}
_ROUGH, _OF_VELOCITIES = ("rough", "plane_rough"), 3
_SPRINGS = ("springs", "plane_springs", *_ROUGH)
"""Elastic functions, and states of a function where it is not one; functions for rough contact, and states of a law
whose force depends on velocities; functions for many springs."""
_LEAST = 1e-3
"""Slip force over that at rest below which an open contact is taken as just closed, where derivatives are made."""


_STARTS, _WAYS = (-1.0, -0.97, -0.6, -0.2, 0.0, 0.1, 0.5, 0.9, 1.0), (-2.3, -0.7, -0.1, 0.03, 0.3, 1.1, 3.1)
"""Forces over F_C, and ways in F_C/k_T, at which increments of a user's law are tried in halves."""
_EXACT = 1e-9
"""Force over F_C by which two halves of an increment may differ from the whole: what Newton's method asks for. A rule
of first order differs by 1e-4 and more at these ways."""


@dataclass(frozen=True)
class Couplings:
    """What contacts share: the direction across, and the normal contacts, which are the last ones.

    ``partner`` (contact,): the contact of the same pair in the other direction, -1 where there is none; the first of
    two has the law. ``pressed_by`` (contact,): the normal contact that presses it, or -1. ``friction`` (contact,): the
    slip force over the momentary normal force. ``normals`` and ``curve``: the tables of ``normal_kernels``.
    """

    partner: Int[np.ndarray, "contact"]
    pressed_by: Int[np.ndarray, "contact"]
    friction: Float[np.ndarray, "contact"]
    normals: Float[np.ndarray, "normal 8"]
    curve: Float[np.ndarray, "3 point"]


@dataclass(frozen=True)
class ContactLaws:
    """Laws of all contacts, in groups of neighbours that share a compiled function.

    ``groups``: function, first contact, end, what is the function's own (number of springs, a user's function), how
    many rows further the contacts in the other direction are (0: none), and the law that such a law calls.
    ``flexibility`` (contact, state) in m/N of the spring whose force a state is, 0 for any other state: the energy that
    a contact can give back is the sum of flexibility * force^2 / 2. ``capacity`` (contact, state) is the share of the
    slip force that bounds a force when the slip force falls, infinite where it may stay above. ``rates`` (contact,):
    whether the force depends on velocities besides.
    """

    groups: tuple[tuple[str, int, int, Any, int, str], ...]
    stiffness: Float[np.ndarray, "contact"]
    parameters: Float[np.ndarray, "contact field"]
    curves: Float[np.ndarray, "curve 3 size"]
    flexibility: Float[np.ndarray, "contact state"]
    capacity: Float[np.ndarray, "contact state"]
    rates: Bool[np.ndarray, "contact"]
    couplings: Couplings | None = None

    @property
    def states(self) -> int:
        """Numbers that a contact remembers."""
        return int(self.flexibility.shape[1])

    @property
    def elastic_reach(self) -> bool:
        """Whether every contact is elastic up to a force of its own, below which it loses nothing."""
        return self.couplings is None and all(name in _ELASTIC and name not in _ROUGH for name, *_ in self.groups)

    def arguments(self) -> tuple[Any, ...]:
        """What the kernels take; the functions are compiled by now, or read from the cache."""
        table = [
            (_address(name), first, end, getattr(own, "address", own), across, _address(line) if line else 0)
            for name, first, end, own, across, line in self.groups
        ]
        laws = np.array(table, dtype=np.int64).reshape(-1, 6), self.parameters, self.curves
        if self.couplings is None:
            return laws
        from ema.contact.coupled_kernels import ROOM
        from ema.contact.normal_kernels import FORCE

        ties, count = self.couplings, len(self.stiffness)
        least, pressed = np.zeros(count), ties.pressed_by >= 0
        forces = ties.normals[ties.pressed_by[pressed] - count, FORCE]
        least[pressed] = np.maximum(_LEAST * ties.friction[pressed] * forces, 1e-12)
        room = np.zeros((ROOM, count)), np.zeros(count, np.int64), np.zeros_like(self.flexibility)
        return *laws, (ties.partner, ties.pressed_by, ties.friction, least, *room)

    def without_contacts(self) -> "ContactLaws":
        """The same with none of them: what modes see that no contact touches."""
        ties, none = self.couplings, np.zeros(0, np.int64)
        return ContactLaws(
            (),
            self.stiffness[:0],
            self.parameters[:0],
            self.curves,
            self.flexibility[:0],
            self.capacity[:0],
            self.rates[:0],
            None if ties is None else Couplings(none, none, np.zeros(0), ties.normals[:0], ties.curve),
        )

    def repeated(self, count: int) -> "ContactLaws":
        """The first contact ``count`` times."""
        stiffness, parameters, flexibility, capacity, rates = (
            np.repeat(part[:1], count, axis=0)
            for part in (self.stiffness, self.parameters, self.flexibility, self.capacity, self.rates)
        )
        (name, _, _, *rest), *_ = self.groups
        groups = ((name, 0, count, *rest),)
        return ContactLaws(groups, stiffness, parameters, self.curves, flexibility, capacity, rates)

    def one_by_one(self) -> tuple[np.ndarray, ...]:
        """What a kernel takes that follows the contacts one after the other: a row of ``groups`` for each of them,
        parameters, curves, the table of ``exchange``, and room for states (3, contact, state): before, after, spare."""
        groups, parameters, curves = self.arguments()[:3]
        rows = np.zeros((len(self.stiffness), groups.shape[1]), np.int64)
        for address, first, end, *rest in groups:
            for i in range(first, end):
                rows[i] = address, i, i + 1, *rest
        return rows, parameters, curves, self.exchange(), np.zeros((3, *self.flexibility.shape))

    def exchange(self) -> Float[np.ndarray, "row contact"]:
        """The table in which solver and laws exchange the numbers of a step, with the stiffnesses in it."""
        from ema.contact.call_kernels import ROWS, STIFFNESS

        table = np.zeros((ROWS, len(self.stiffness)))
        table[STIFFNESS] = self.stiffness
        return table

    def memory(self, compliance: Float[np.ndarray, "contact contact"]) -> tuple[np.ndarray, ...]:
        """What ``solve`` keeps from increment to increment, before the first one."""
        count = len(self.stiffness)
        return compliance.copy(), np.zeros(count), np.zeros(1, np.int64), np.zeros((3, count)), np.zeros(count)

    def springs(self) -> tuple[np.ndarray, ...]:
        """Number of Masing springs of every contact, 0 for other laws, their shares of stiffness and slip force, and
        the displacement over the slip force at which the first of them slides."""
        counts, width, least = np.zeros(len(self.stiffness), np.int64), self.states, np.zeros(len(self.stiffness))
        shares_k, shares_f = np.zeros((len(counts), width)), np.zeros((len(counts), width))
        for name, first, end, own, *_ in self.groups:
            if name in _ELASTIC:
                counts[first:end] = count = max(own, 1)
                whole = self.stiffness[first:end, None]
                if name in _ROUGH:
                    # those that touch at rest, and of these slip forces in N
                    counts[first:end] = count = int(self.parameters[first, 2 * count])
                    tops = self.parameters[first:end, own : own + count]
                    shares_f[first:end, :count] = tops / np.maximum(tops.sum(axis=1, keepdims=True), 1e-300)
                else:
                    shares_f[first:end, :count] = self.capacity[first:end, :count]
                shares_k[first:end, :count] = 1 / (self.flexibility[first:end, :count] * whole)
                least[first:end] = (self.flexibility[first:end, :count] * shares_f[first:end, :count]).min(axis=1)
        return counts, shares_k, shares_f, least

    def approach(self) -> Bool[np.ndarray, "contact"]:
        """Whether every contact approaches its slip force smoothly, as no spring does."""
        out = np.ones(len(self.stiffness), np.bool_)
        for name, first, end, *_ in self.groups:
            out[first:end] = name not in (*_ELASTIC, *_SPRINGS)
        return out

    def stored_energy(self, state: Float[np.ndarray, "contact state"]) -> float:
        """Energy in J that the contacts can give back."""
        return float(0.5 * (self.flexibility * state[:, : self.states] ** 2).sum())

    def drive(
        self, path: Float[np.ndarray, "lane sample"], slip_force: Float[np.ndarray, "sample"], interval: float
    ) -> Float[np.ndarray, "lane sample"]:
        """Forces in N of one contact in one or two directions along a path in m from the unstressed state.

        ``interval`` s between samples.
        """
        return self.followed(path, np.broadcast_to(slip_force, path.shape), interval)[0]

    def followed(
        self,
        path: Float[np.ndarray, "contact sample"],
        limits: Float[np.ndarray, "contact sample"],
        interval: float,
        start: Float[np.ndarray, "contact state"] | None = None,
    ) -> tuple[Float[np.ndarray, "contact sample"], Float[np.ndarray, "contact state"]]:
        """Forces in N of all contacts along paths in m from rest or the state ``start``, and the state at the end.

        ``limits`` N are their slip forces, ``interval`` s the time between samples.
        """
        from ema.contact import solve_kernels

        kernels: Any = solve_kernels
        states, forces = (np.zeros_like(self.flexibility), np.zeros_like(self.flexibility)), np.empty(path.shape)
        if start is not None:
            states[0][:] = start
        motion = np.ascontiguousarray(path), np.ascontiguousarray(limits)
        kernels.drive(self.arguments()[:3], motion, 1 / interval, self.exchange(), states, forces)
        return forces, states[path.shape[1] % 2]


def compiled(name: str) -> Any:
    """The compiled function of a law."""
    return getattr(import_module(f"ema.contact.{_MODULES.get(name, name)}_kernels"), name)


@cache
def _address(name: str) -> int:
    from ema.contact.call_kernels import address

    return address(compiled(name))


def check_parameters(law: FrictionLaw) -> None:
    """Refuse a law that was not made by its constructor, or was changed since.

    Raises
    ------
    InputError : the law is unknown; a parameter is missing, too many, or no number.
    """
    names = tuple(name for name, _ in law.parameters)
    known = CATALOGUE.get(law.name)
    own = () if known is None else tuple(parameter.name for parameter in known.parameters if not parameter.several)
    if own and names != own:
        raise InputError(
            "not the parameters of this law",
            where=f"law {law.name}",
            got=", ".join(names) or "none",
            expected=", ".join(own),
            advice="make it by its constructor in ema.simulate",
        )
    if law.name in ROUGH and not (law.stiffness_exponent > 0 and law.stiffness_cap == np.inf):
        raise InputError(
            "the stiffness of a rough contact follows its normal force",
            where=f"law {law.name}",
            got=f"stiffness_exponent {law.stiffness_exponent:g}, stiffness_cap {law.stiffness_cap:g} N/m",
            expected="an exponent above 0 (1 for exponential heights) and no cap",
            advice="make it by ema.simulate.RoughContact",
        )
    if law.name in REGISTERED and len(names) > _OWN:
        raise InputError(
            "more parameters than a law of one's own is handed", where=f"law {law.name}", got=len(names), expected=_OWN
        )
    if not all(np.isfinite(value) for _, value in law.parameters):
        raise InputError(
            "a parameter is no number", where=f"law {law.name}", got=dict(law.parameters), expected="finite numbers"
        )
    if known is None:
        _check_function(law)
    if known is None and law.name not in REGISTERED:
        raise InputError(
            "unknown friction law",
            got=law.name,
            expected="one of " + ", ".join(sorted(CATALOGUE)),
            advice="a law of your own: ema.simulate.register_law",
        )


def _check_function(law: FrictionLaw) -> None:
    """Refuse a law of the user's own that is not registered in this process, or not with the function it was made with.

    Nothing can be told of a name that came without a fingerprint, as from files of earlier releases.
    """
    if not isinstance(law.name, LawName):
        return
    home = law.name.module
    where = "" if home in ("", "__main__") else f", its function is in {home}"
    if law.name not in REGISTERED:
        raise InputError(
            "a law of one's own that this process does not know",
            where=f"law {law.name}",
            advice=f"register it in every process that runs it{where}",
        )
    made, present = law.name.fingerprint, REGISTERED[law.name].fingerprint
    if made == present:
        return
    (kind, _, _), (other, _, _) = made.partition(":"), present.partition(":")
    raise InputError(
        "the function registered under this name is not the one that the law was made with"
        if kind == other
        else "whether the registered function is the one that the law was made with cannot be told",
        where=f"law {law.name}",
        got=present if kind == other else f"a fingerprint of {other}",
        expected=made if kind == other else kind,
        advice="register the former function, or take the present one: model.with_law(...) with the law made anew",
    )


@lru_cache(maxsize=1024)
def check_contract(law: FrictionLaw, stiffness: float, function: Any = None) -> None:
    """Refuse a law that breaks what the solvers rely on, at a contact of ``stiffness`` N/m; tried once for each.

    ``function``: to what a law of the user's own is compiled.

    Raises
    ------
    InputError : it breaks ``ema.contact.contract``; the message has the point and the numbers.
    """
    for what, got, expected in broken(law, stiffness, assembled([law], np.array([stiffness]), [1], as_it_is=True)):
        raise InputError(
            what, where=f"law {law.name}", got=got, expected=expected, advice="see docs/laws.md for what a law must do"
        )


def contact_laws(
    laws: Sequence[FrictionLaw],
    stiffness: Float[np.ndarray, "contact"],
    counts_of_joint: Sequence[int],
    couplings: Couplings | None = None,
) -> ContactLaws:
    """Laws of all contacts of ``stiffness`` N/m; ``counts_of_joint``: number of pairs that share each contact's joint.

    Normal contacts, the last ones of ``couplings``, have no law among ``laws``.

    Raises
    ------
    InputError : a law is unknown or lacks a parameter, or one of the user's own breaks what the solvers rely on.
    """
    own: dict[FrictionLaw, list[float]] = {}
    for law in {id(law): law for law in laws}.values():
        check_parameters(law)
    for law, k in zip(laws, stiffness):
        if law.name in REGISTERED:
            own.setdefault(law, []).append(float(k))
    for law, every in own.items():
        for k in {min(every), max(every)}:
            check_contract(law, k, REGISTERED[law.name][1])
    return assembled(laws, stiffness, counts_of_joint, couplings)


def assembled(
    laws: Sequence[FrictionLaw],
    stiffness: Float[np.ndarray, "contact"],
    counts_of_joint: Sequence[int],
    couplings: Couplings | None = None,
    *,
    as_it_is: bool = False,
) -> ContactLaws:
    """The same for laws that are checked; ``as_it_is``: a rule of short increments is taken in increments as given."""
    springs = {id(law): springs_of(law) for law in laws}
    partner = [-1] * len(laws) if couplings is None else couplings.partner[: len(laws)].tolist()
    curves: dict[tuple[float, float], int] = {}
    rows, keys = [], []
    for i, (law, k, pairs) in enumerate(zip(laws, stiffness, counts_of_joint)):
        line = CATALOGUE[law.name].kernel if law.name in CATALOGUE else _own_kernel(law, float(k), as_it_is)
        across, name, extra, values = 0, line, 0, np.array([value for _, value in law.parameters])
        if partner[i] >= 0:
            across = partner[i] - i
            name = CATALOGUE[law.name].plane if law.name in CATALOGUE else PROJECTED
        if name in _ROUGH:
            extra, values = bed(law, float(k))
        elif name in _SPRINGS:
            shares, force_shares = springs[id(law)]
            extra, values = len(shares), np.concatenate([k * shares, force_shares])
        elif line == "bouc_wen":
            values = bouc_wen_shape(values[0], values[1] if len(values) > 1 else 0.5, curves)
        elif line in ("own", "own_in_steps"):
            extra, values = REGISTERED[law.name][1], np.concatenate([values, np.zeros(_OWN)])[:_OWN]
        else:
            values = values / _sharing(law, pairs)
        keys.append((name, extra, across, line if name == PROJECTED else "") if across >= 0 else None)
        rows.append(values)
    table = tables(curves)
    if couplings is not None and len(couplings.normals):
        rows += list(couplings.normals)
        keys += [("normal", len(table), 0, "")] * len(couplings.normals)
        table = _with_curve(table, couplings.curve)
    groups, first = [], 0
    for key, members in groupby(keys):
        end = first + len(list(members))
        if key is not None:
            groups.append((key[0], first, end, *key[1:]))
        first = end
    parameters = np.zeros((len(rows), max(map(len, rows))))
    for i, values in enumerate(rows):
        parameters[i, : len(values)] = values
    stiffnesses = np.asarray(stiffness, np.float64)
    known = [CATALOGUE.get(law.name) for law in laws] + [None] * (len(rows) - len(laws))
    rates = np.array([one is not None and one.rates for one in known], np.bool_)
    bounds = _bounds(groups, stiffnesses, rows, known)
    return ContactLaws(tuple(groups), stiffnesses, parameters, table, *bounds, rates, couplings)


def _sharing(law: FrictionLaw, pairs: int) -> Float[np.ndarray, "parameter"]:
    """How many pairs share every parameter of a law."""
    parameters = CATALOGUE[law.name].parameters if law.name in CATALOGUE else ()
    return np.array([pairs if parameter.shared else 1.0 for parameter in parameters])


def _own_kernel(law: FrictionLaw, k: float, as_it_is: bool) -> str:
    """The compiled function for a law of the user's own at a contact of ``k`` N/m."""
    return "own" if as_it_is or _of_any_length(law, k, REGISTERED[law.name].compiled) else "own_in_steps"


@lru_cache(maxsize=1024)
def _of_any_length(law: FrictionLaw, k: float, function: Any) -> bool:
    """Whether increments of any length are exact, as those of a clip or of a closed form: two of them do what one does.

    A rule of short increments, dF = h(F) du, differs by the square of the increment. Tried at slip forces as they are
    and a hundred times smaller.
    """
    top = (law.friction_coefficient * law.reference_force or 1.0) * k / law.contact_stiffness
    values = [*(value for _, value in law.parameters), 0.0, 0.0, 0.0, 0.0][:_OWN]
    for limit in (top, 0.01 * top):
        for start in _STARTS:
            for way in _WAYS:
                du, force = way * limit / k, start * limit
                whole = function.ctypes(force, du, k, limit, *values)
                half = function.ctypes(force, 0.5 * du, k, limit, *values)
                if not abs(function.ctypes(half, 0.5 * du, k, limit, *values) - whole) <= _EXACT * limit:
                    return False
    return True


def _with_curve(table: np.ndarray, curve: np.ndarray) -> Float[np.ndarray, "curve 3 size"]:
    """One more curve, at the end of a table for all of them."""
    whole = np.zeros((len(table) + 1, 3, max(table.shape[2], curve.shape[1])))
    whole[:-1, :, : table.shape[2]], whole[-1, :, : curve.shape[1]] = table, curve
    return whole


def _bounds(
    groups: Sequence[tuple[str, int, int, Any, int, str]],
    stiffness: np.ndarray,
    rows: Sequence[np.ndarray],
    known: Sequence[KnownLaw | None],
) -> tuple[Float[np.ndarray, "contact state"], Float[np.ndarray, "contact state"]]:
    """Flexibility and capacity of the springs of all contacts."""
    states = max(_STATES.get(line or name, own if name in _SPRINGS else 1) for name, _, _, own, _, line in groups)
    above = [one is not None and bool(one.above) for one in known]
    if any(one is not None and one.rates for one in known):
        states = max(states, _OF_VELOCITIES)
    flexibility, capacity = np.zeros((len(rows), states)), np.full((len(rows), states), np.inf)
    for name, first, end, own, across, _ in groups:
        for i in [*range(first, end), *(range(first + across, end + across) if across else ())]:
            flexibility[i, 0], capacity[i, 0] = 1 / stiffness[i], np.inf if above[i] else 1.0
            if name in _ROUGH:
                # what its springs bear falls otherwise than in proportion: the law itself brings their forces down
                flexibility[i, :own], capacity[i] = 1 / rows[i][:own], np.inf
            elif name in _SPRINGS:
                flexibility[i, :own], capacity[i, :own] = 1 / rows[i][:own], rows[i][own:]
            elif name == "normal":
                flexibility[i], capacity[i] = 0.0, np.inf
                flexibility[i, 1] = 1.0
    return flexibility, capacity
