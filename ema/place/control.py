"""What a controlled normal force adds to the best constant one, for one placed beam."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ema.data.placement import Candidates, ControlLine, ControlStudy, Place
from ema.errors import InputError
from ema.place.model import model_at
from ema.place.objective import Objective, at_level, scores
from ema.place.predictor import predict
from ema.place.task import Task, only, without_suspension
from ema.progress import Progress, silent
from ema.simulate.control_gain import release_statement, ring_downs

FACTORS = (0.125, 0.25, 0.5, 1.0, 2.0, 4.0)
"""Forces that are tried, over the given one."""


def control_study(
    task: Task,
    candidates: Candidates,
    best: Place,
    load: float,
    lag: float | None = None,
    objective: Objective | None = None,
    progress: Progress = silent,
) -> ControlStudy:
    """Simulate ring-downs at a ranked location under constant, scheduled and pulsed normal force, and steady states.

    The structure is bent by ``load`` at the excited DOF and released. Every law is tried at six forces about
    that of the ranking and shown with the one whose energy is gone first (least integral of E/E0). The scheduled force
    follows the amplitude at the last turning point; the pulse releases the joints for a twelfth of a period there.

    Parameters
    ----------
    task : Task
        Structure, joint and target modes.
    candidates : Candidates
        Locations of the beam.
    best : Place
        Location, and the normal force about which forces are tried.
    load : float
        Static load at the excited DOF [N].
    lag : float, optional
        Time [s] from measuring to acting; a twentieth of the period of the first target mode by default.
    objective : Objective, optional
        How the steady states are judged.
    progress : Progress, optional
        Called before each ring-down.

    Returns
    -------
    ControlStudy
        The best ring-down of every law, and the steady damping with one and with scheduled normal forces.

    Raises
    ------
    InputError
        If the load, the force or the lag is not positive.

    References
    ----------
    .. [1] Schedule "just below sticking" over the amplitude: after Gaul, Roseira and Becker (2008).
    .. [2] Release pulse: Dupont, Kasturi and Stokes (1997), Journal of Sound and Vibration 202:203.

    Examples
    --------
    >>> from ema.data import BoltedJoint, FrictionBeam, FrictionLaw
    >>> from ema.errors import InputError
    >>> from ema.examples import plate
    >>> from ema.place import Task, grid, rank
    >>> from ema.shapes import smooth
    >>> bare, geometry = plate()
    >>> surface = smooth(bare, geometry)
    >>> joint = BoltedJoint(FrictionLaw("masing", 0.4, 2e7), 1e8, surface_height=0.003)
    >>> task = Task(bare, surface, joint, "1:+Z", np.array([10.0]), np.array([50.0]), modes=(0,))
    >>> spots = grid(surface, [FrictionBeam(0.2, 0.02, 0.01)], step=0.2)
    >>> best = rank(task, spots, draws=0).best
    >>> control_study(task, spots, best, load=100.0).lines[0].law  # doctest: +SKIP
    'constant'
    >>> try:
    ...     control_study(task, spots, best, load=0.0)
    ... except InputError as error:
    ...     print(error)
    place 1: not a load; got 0.0 N, expected above 0 N
    """
    place, normal_force = best.candidate, best.normal_force
    for name, value in (("load", load), ("normal force", normal_force)):
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"not a {name}", where=f"place {place}", got=f"{value} N", expected="above 0 N")
    chosen = task.modes[0]
    frequency = float(np.abs(task.bare.poles[chosen]) / (2 * np.pi))
    # the energy of a structure that sways on its suspension says nothing about the joints
    elastic = without_suspension(task)
    model = model_at(elastic, candidates, place, normal_force)
    forces = [factor * normal_force for factor in FACTORS]
    lines = ring_downs(model, load, task.at, frequency, normal_forces=forces, lag=lag, progress=progress)
    levels, steady, scheduled = _steady(task, candidates, place, objective or Objective())
    return ControlStudy(
        place, chosen, load, lines, levels, steady, scheduled, _verdict(lines, levels, steady, scheduled)
    )


def _steady(
    task: Task, candidates: Candidates, place: int, objective: Objective
) -> tuple[Float[np.ndarray, "level"], Float[np.ndarray, "level"], Float[np.ndarray, "level"]]:
    """Least damping of the target modes at every level, with one normal force for all and with the best of each."""
    prediction = predict(task, only(candidates, [place]))
    least = prediction.damping[0].min(axis=0)
    common = int(scores(prediction, objective)[0].argmax())
    each = [
        int(scores(at_level(prediction, row), objective)[0].argmax()) for row in range(len(prediction.force_levels))
    ]
    return np.asarray(prediction.force_levels), least[:, common], least[np.arange(len(each)), each]


def _verdict(lines: Sequence[ControlLine], levels: np.ndarray, steady: np.ndarray, scheduled: np.ndarray) -> str:
    mean, least = np.nanmean(scheduled) / np.nanmean(steady) - 1, np.nanmin(scheduled) / np.nanmin(steady) - 1
    return (
        f"{release_statement(lines)}. In steady vibration at {levels.min():.3g} to {levels.max():.3g} N, a normal "
        f"force set for each level changes the mean damping by {100 * mean:+.0f} % and the least by {100 * least:+.0f} "
        "% against one force for all levels."
    )
