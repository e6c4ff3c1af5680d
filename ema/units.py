"""Quantities and the few constants of the project: inside it everything is SI and Hz."""

from typing import Literal, get_args

STANDARD_GRAVITY = 9.80665
"""One g in m/s^2 (exact by definition)."""

Quantity = Literal[
    "force",
    "acceleration",
    "velocity",
    "displacement",
    "strain",
    "pressure",
    "voltage",
    "temperature",
    "time",
    "torque",
    "angular acceleration",
    "angular velocity",
    "rotation",
    "unstated",
]
"""What a channel measures."""

FrfQuantity = Literal["receptance", "mobility", "accelerance", "unstated"]
"""Kind of a frequency response function (ISO 7626-1): displacement, velocity or acceleration over force."""

UNSTATED = "unstated"
"""The unit of a value whose unit nobody stated: usable for frequencies, damping and shapes, not for scaling."""

SI_UNIT: dict[str, str] = {
    "force": "N",
    "acceleration": "m/s^2",
    "velocity": "m/s",
    "displacement": "m",
    "strain": "1",
    "pressure": "Pa",
    "voltage": "V",
    "temperature": "K",
    "time": "s",
    "torque": "N m",
    "angular acceleration": "rad/s^2",
    "angular velocity": "rad/s",
    "rotation": "rad",
    "unstated": UNSTATED,
}
"""SI unit in which each quantity is held."""

FRF_UNIT: dict[str, str] = {
    "receptance": "m/N",
    "mobility": "(m/s)/N",
    "accelerance": "(m/s^2)/N",
    "unstated": UNSTATED,
}
"""SI unit of each kind of FRF."""

FRF_OF_RESPONSE: dict[str, FrfQuantity] = {
    "displacement": "receptance",
    "velocity": "mobility",
    "acceleration": "accelerance",
    "unstated": "unstated",
}
"""Kind of FRF that a response quantity over force gives."""

DERIVATIVE_ORDER: dict[str, int] = {"receptance": 0, "mobility": 1, "accelerance": 2, "unstated": 2}
"""Power of j*omega between receptance and each kind of FRF; an unstated response is treated as acceleration, which
changes residual terms only."""

QUANTITIES: tuple[str, ...] = get_args(Quantity)
