"""Parameters of a friction model that data may determine: names, limits, and the scale on which they are searched."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from ema.contact.catalogue import CATALOGUE, Parameter
from ema.data import BeamModel, FrictionLaw
from ema.errors import InputError

_HOST = ("friction_coefficient", "contact_stiffness", "stiffness_exponent", "background_damping")
FORCE_SCALE = "force_scale"
SHARED = (*_HOST, FORCE_SCALE)
"""What every law has."""
_FACTOR = 2.3
"""Half width of the search on a logarithmic scale: a factor of 10 to either side of what the model says."""
_SHAPE = 1.5
"""The same for a parameter between two limits, on the logistic scale: 18 to 82 % of the way if it begins at half."""
_MIDDLE, _HALF = 0.5, 0.5
"""Where the growth of k_T with F_N is searched: 0 (a spring) to 1 (proportional)."""
_INSIDE = 1e-3
"""Share of the way between two limits that stays free at either end, where the logistic scale ends."""
_UNDAMPED = 1e-4
"""Damping ratio from which a search begins where the model has none."""


@dataclass(frozen=True)
class FreeParameter:
    """One parameter: ``low`` and ``high`` bound it; the scale is logarithmic with one limit, logistic with two."""

    name: str
    low: float = 0.0
    high: float = float("inf")

    @property
    def linear(self) -> bool:
        """Whether it is searched as it is."""
        return self.low == -float("inf")

    @property
    def logarithmic(self) -> bool:
        """Whether its uncertainty is a factor."""
        return not self.linear and self.high == float("inf")

    @property
    def width(self) -> float:
        """Half width of the search on its scale."""
        return _HALF if self.linear else _FACTOR if self.logarithmic else _SHAPE

    def scaled(self, value: float) -> float:
        """The parameter on its scale."""
        if self.linear:
            return value
        if self.logarithmic:
            return float(np.log(max(value - self.low, 1e-6)))
        share = min(max((value - self.low) / (self.high - self.low), _INSIDE), 1 - _INSIDE)
        return float(np.log(share / (1 - share)))

    def plain(self, value: float) -> float:
        """The parameter in its own unit."""
        if self.linear:
            return value
        if self.logarithmic:
            return self.low + float(np.exp(min(value, 700.0)))
        share = 1 / (1 + np.exp(-np.clip(value, -40.0, 40.0)))
        return float(self.low + (self.high - self.low) * share)


def _of_law(law: FrictionLaw) -> dict[str, Parameter]:
    """Numbers of a law that may be free, by key: not lists, not those that only say how finely it is divided."""
    known = CATALOGUE.get(law.name)
    if known is None:  # a law of the user's own: of its numbers, those above 0 stay above 0
        return {name: Parameter(name, "", value, "") for name, value in law.parameters if value > 0}
    return {one.key: one for one in known.parameters if not one.several and one.name != "springs"}


def free_parameters(model: BeamModel, free: Sequence[str]) -> tuple[FreeParameter, ...]:
    """Return the parameters of a list, checked against the laws of the joints.

    Raises
    ------
    InputError : no joints, an unknown or repeated name, or a parameter that the law of a joint does not have.
    """
    where = model.name or "model"
    if not model.joints:
        raise InputError("a model without joints", where=where, got="0 joints", expected="one or more")
    laws = {joint.law.name: _of_law(joint.law) for joint in model.joints}
    shared = set.intersection(*(set(numbers) for numbers in laws.values()))
    everywhere = {one.key for law in CATALOGUE.values() for one in law.parameters if not one.several} - {"springs"}
    for name in free:
        if name in _HOST or name in shared:
            continue
        raise InputError(
            f"the law has no {name}" if name in everywhere else "an unknown parameter",
            where=where,
            got=", ".join(sorted(laws)) if name in everywhere else name,
            expected="some of " + ", ".join((*_HOST, *sorted(shared))),
        )
    if not free or len(set(free)) != len(free):
        raise InputError("not a list of free parameters", where=where, got=list(free), expected="each name once")
    numbers = next(iter(laws.values()))
    return tuple(
        FreeParameter(name, numbers[name].low, numbers[name].high)
        if name in shared
        else FreeParameter(name, -float("inf") if name == "stiffness_exponent" else 0.0)
        for name in free
    )


def initial_values(model: BeamModel, parameters: Sequence[FreeParameter]) -> Float[np.ndarray, "parameter"]:
    """What the model says of the parameters, on their scales."""
    law = model.joints[0].law
    have = {
        "friction_coefficient": law.friction_coefficient,
        "contact_stiffness": law.contact_stiffness,
        "stiffness_exponent": law.stiffness_exponent,
        "background_damping": max(model.damping.ratio, _UNDAMPED),
        FORCE_SCALE: 1.0,
    } | {key: dict(law.parameters).get(one.name, one.default) for key, one in _of_law(law).items()}
    return np.array([one.scaled(have[one.name]) for one in parameters])


def search_centres(
    parameters: Sequence[FreeParameter], initial: Float[np.ndarray, "parameter"]
) -> Float[np.ndarray, "parameter"]:
    """Middles of the search: what the model says, but for the growth of k_T, of which models often say nothing."""
    return np.array([_MIDDLE if one.linear else value for one, value in zip(parameters, initial, strict=True)])


def with_parameters(model: BeamModel, values: Mapping[str, float]) -> BeamModel:
    """The model with other values of its parameters, in their own units; the same in all joints."""
    joints = []
    for joint in model.joints:
        law = joint.law
        own = {one.name: values[key] for key, one in _of_law(law).items() if key in values}
        law = replace(
            law,
            friction_coefficient=values.get("friction_coefficient", law.friction_coefficient),
            contact_stiffness=values.get("contact_stiffness", law.contact_stiffness),
            stiffness_exponent=values.get("stiffness_exponent", law.stiffness_exponent),
            parameters=tuple((dict(law.parameters) | own).items()),
        )
        joints.append(replace(joint, law=law))
    ratio = values.get("background_damping", model.damping.ratio)
    return replace(model, joints=tuple(joints), damping=replace(model.damping, ratio=min(ratio, 0.5)))


def with_law(model: BeamModel, law: FrictionLaw) -> BeamModel:
    """The model with the form of another law in all joints, whose mu and k_T stay."""
    joints = (
        replace(joint, law=replace(joint.law, name=law.name, parameters=law.parameters)) for joint in model.joints
    )
    return replace(model, joints=tuple(joints))
