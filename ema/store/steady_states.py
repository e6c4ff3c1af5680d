"""Steady states and their curves among what a file may hold; :mod:`ema.data` names the other containers."""

from ema.data import stability
from ema.store.document import CONTAINERS

STEADY_STATES: dict[str, type] = {
    name: getattr(stability, name)
    for name in ("FloquetMultipliers", "SteadyState", "CoexistingStates", "SteadyStateCurve")
}
"""Containers of :mod:`ema.data.stability` by their name in files."""

CONTAINERS.update(STEADY_STATES)
