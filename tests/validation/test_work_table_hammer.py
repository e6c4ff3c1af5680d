"""Table 1 of Gaul, Roseira and Becker (2008) from raw hammer signals: modes that exist, and no others.

The truth is the structure that the signals were made from, with sticking joints. Impacts of 1 kN make the joints slip
first; modes of a linear model of the FRFs are then 478.2 Hz and 971.1 Hz (5 kN), 459.6 Hz, 524.9 Hz and 966.5 Hz
(10 kN) among others, with confidences up to 1.00, and none of these exists.
"""

import numpy as np
import pytest

from ema.simulate.reduction import modal_base
from ema.simulate.structure import assemble
from ema.study import Study, chain, work_table

BAND = (300.0, 1300.0)


@pytest.fixture(scope="module")
def campaign(root):
    return Study.load(root / "reports" / "work_table_hammer.toml")


def analysed(study, run):
    return chain.analyse(study.open()[run], study.recipe.estimate, study.recipe.fit)


def stuck(force):
    """Natural frequencies [Hz] and damping ratios with sticking joints that the hammer can see, from the matrices."""
    system = assemble(work_table.with_beam(work_table.CENTRE, force, work_table.grid()))
    base = modal_base(system)
    inside = (base.frequencies > 2 * np.pi * BAND[0]) & (base.frequencies < 2 * np.pi * BAND[1])
    return base.frequencies[inside] / (2 * np.pi), base.decay[inside] / (2 * base.frequencies[inside])


@pytest.mark.parametrize("force", [1000.0, 5000.0, 10000.0])
def test_accepted_modes_are_those_of_the_sticking_joint(campaign, force):
    result = analysed(campaign, f"beam_{force / 1000:.0f}kN")
    frequencies, damping = stuck(force)
    found = result.modes
    assert len(found.poles) == len(frequencies)
    assert found.natural_frequencies == pytest.approx(frequencies, abs=0.2)
    assert found.damping_ratios == pytest.approx(damping, rel=0.03)
    assert found.scaling == "unscaled" and found.uncertainty is None
    assert np.all(np.abs(found.natural_frequencies - frequencies) < 3 * np.sqrt(found.covariance[:, 0, 0]))
    assert {"slip-then-ring", "modes-after-sticking"} <= {one.code for one in result.findings}
    assert len(found.candidates) >= 3


def test_the_bare_table_is_linear_and_keeps_the_modes_of_its_frfs(campaign):
    result = analysed(campaign, "bare")
    assert result.modes.natural_frequencies == pytest.approx([499.0, 760.0, 1000.0], abs=0.01)
    assert [one.code for one in result.findings if one.code in ("level-tested", "slip-then-ring")] == ["level-tested"]
