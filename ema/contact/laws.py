"""Friction laws of many contacts as the compiled solvers take them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from itertools import groupby
from typing import Any

import numpy as np
from jaxtyping import Float

from ema.contact.catalogue import CATALOGUE
from ema.contact.curves import bouc_wen_shape, tables
from ema.contact.iwan import springs_of
from ema.data import FrictionLaw
from ema.errors import InputError

UserFunction = Callable[[float, float, float, float, float, float, float, float], float]
REGISTERED: dict[str, tuple[UserFunction, Any]] = {}
"""Laws of the user's own by name: the function, and what it was compiled to."""

_MODULES = {"spring": "springs"}
_ELASTIC, _STATES = ("spring", "springs"), {"bouc_wen": 3, "lugre": 3}


@dataclass(frozen=True)
class ContactLaws:
    """Laws of all contacts, in groups of neighbours that share a compiled function.

    ``groups``: function, first contact, end, and what is the function's own (number of springs, a user's function).
    ``flexibility`` (contact, state) in m/N of the spring whose force a state is, 0 for any other state: the energy that
    a contact can give back is the sum of flexibility * force^2 / 2. ``capacity`` (contact, state) is the share of the
    slip force that bounds a force when the slip force falls, infinite where it may stay above.
    """

    groups: tuple[tuple[str, int, int, Any], ...]
    stiffness: Float[np.ndarray, "contact"]
    parameters: Float[np.ndarray, "contact field"]
    curves: Float[np.ndarray, "curve 3 size"]
    flexibility: Float[np.ndarray, "contact state"]
    capacity: Float[np.ndarray, "contact state"]

    @property
    def states(self) -> int:
        """Numbers that a contact remembers."""
        return self.flexibility.shape[1]

    @property
    def elastic_reach(self) -> bool:
        """Whether every contact is elastic up to a force of its own, below which it loses nothing."""
        return all(name in _ELASTIC for name, *_ in self.groups)

    def arguments(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What the kernels take; the functions are compiled by now, or read from the cache."""
        table = [(_address(name), first, end, getattr(own, "address", own)) for name, first, end, own in self.groups]
        return np.array(table, dtype=np.int64), self.parameters, self.curves

    def one_by_one(self) -> tuple[np.ndarray, ...]:
        """What a kernel takes that follows the contacts one after the other: a row of ``groups`` for each of them,
        parameters, curves, the table of ``exchange``, and room for the states before and after (2, contact, state)."""
        groups, parameters, curves = self.arguments()
        rows = [(address, i, i + 1, own) for address, first, end, own in groups for i in range(first, end)]
        states = np.zeros((2, *self.flexibility.shape))
        return np.array(rows, dtype=np.int64), parameters, curves, self.exchange(), states

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

    def stored_energy(self, state: Float[np.ndarray, "contact state"]) -> float:
        """Energy in J that the contacts can give back."""
        return float(0.5 * (self.flexibility * state[:, : self.states] ** 2).sum())

    def drive(
        self, path: Float[np.ndarray, "sample"], slip_force: Float[np.ndarray, "sample"], interval: float
    ) -> Float[np.ndarray, "sample"]:
        """Force in N of one contact along a path in m from the unstressed state, ``interval`` s between samples."""
        from ema.contact import solve_kernels

        kernels: Any = solve_kernels
        states, forces = (np.zeros_like(self.flexibility), np.zeros_like(self.flexibility)), np.empty(len(path))
        kernels.drive(self.arguments(), path, slip_force, 1 / interval, self.exchange(), states, forces)
        return forces


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
    if not all(np.isfinite(value) for _, value in law.parameters):
        raise InputError(
            "a parameter is no number", where=f"law {law.name}", got=dict(law.parameters), expected="finite numbers"
        )
    if known is None and law.name not in REGISTERED:
        raise InputError(
            "unknown friction law",
            got=law.name,
            expected="one of " + ", ".join(sorted(CATALOGUE)),
            advice="a law of your own: ema.simulate.register_law",
        )


def contact_laws(
    laws: Sequence[FrictionLaw], stiffness: Float[np.ndarray, "contact"], counts_of_joint: Sequence[int]
) -> ContactLaws:
    """Laws of all contacts of ``stiffness`` N/m; ``counts_of_joint``: number of pairs that share each contact's joint.

    Raises
    ------
    InputError : a law is unknown or lacks a parameter.
    """
    for law in {id(law): law for law in laws}.values():
        check_parameters(law)
    springs = {id(law): springs_of(law) for law in laws}
    curves: dict[tuple[float, float], int] = {}
    size, rows, keys = len(laws), [], []
    for law, k, pairs in zip(laws, stiffness, counts_of_joint, strict=True):
        name = CATALOGUE[law.name].kernel if law.name in CATALOGUE else "own"
        extra, values = 0, np.array([value for _, value in law.parameters])
        if name == "springs":
            shares, force_shares = springs[id(law)]
            extra, values = len(shares), np.concatenate([k * shares, force_shares])
        elif name == "bouc_wen":
            values = bouc_wen_shape(values[0], values[1] if len(values) > 1 else 0.5, curves)
        elif name == "lugre":
            values = values / np.array([pairs, pairs, 1.0, 1.0])
        elif name == "own":
            extra, values = REGISTERED[law.name][1], np.concatenate([values, np.zeros(4)])[:4]
        keys.append((name, extra))
        rows.append(values)
    states = max(_STATES.get(name, extra if name == "springs" else 1) for name, extra in keys)
    parameters = np.zeros((size, max(map(len, rows))))
    flexibility, capacity = np.zeros((size, states)), np.full((size, states), np.inf)
    for i, ((name, extra), values) in enumerate(zip(keys, rows, strict=True)):
        parameters[i, : len(values)] = values
        flexibility[i, 0], capacity[i, 0] = 1 / stiffness[i], np.inf if name == "lugre" else 1.0
        if name == "springs":
            flexibility[i, :extra], capacity[i, :extra] = 1 / values[:extra], values[extra:]
    groups, first = [], 0
    for (name, extra), members in groupby(keys):
        end = first + len(list(members))
        groups.append((name, first, end, extra))
        first = end
    stiffnesses = np.asarray(stiffness, np.float64)
    return ContactLaws(tuple(groups), stiffnesses, parameters, tables(curves), flexibility, capacity)
