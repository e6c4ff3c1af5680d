"""One steady state where there can be but one: friction springs under a constant normal force, and damping."""

from pathlib import Path

import numpy as np
import pytest

import acquisition
from ema.simulate import coexisting_states

TIP = "beam 2:20:+Z"


@pytest.mark.parametrize("draw", range(4))
def test_masing_springs_have_one_steady_state(draw: int) -> None:
    """Two motions under one force draw near: the springs' forces are monotone in slip and dissipate what differs.

    So neither harmonics that are cut off nor random starts may make a second state of it (Visintin 1994, chapter III).
    """
    rng = np.random.default_rng([30, draw])
    pressed, force = np.exp(rng.uniform(np.log([50.0, 0.2]), np.log([1000.0, 3.0])))
    beams = acquisition.open_model(Path(__file__).parents[2] / "datasets" / "double_beam").with_normal_force(pressed)
    states = coexisting_states(beams, float(rng.uniform(18, 34)), float(force), TIP, [TIP], starts=2)
    assert len(states.states) == 1 and states.states[0].stability.verdict != "unstable" and not states.findings
