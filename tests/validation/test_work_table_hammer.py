"""Table 1 of Gaul, Roseira and Becker (2008) from raw hammer signals: modes that exist, and no others.

The truth is the structure that the signals were made from, with sticking joints. Impacts of 1 kN make the joints slip
first; modes of a linear model of the FRFs are then 478.2 Hz and 971.1 Hz (5 kN), 459.6 Hz, 524.9 Hz and 966.5 Hz
(10 kN) among others, with confidences up to 1.00, and none of these exists.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ema import estimate, fit
from ema.compare.linearity import linearity
from ema.data import Condition, Run
from ema.dof import Dof
from ema.shapes import mac
from ema.simulate.reduction import modal_base
from ema.simulate.structure import assemble
from ema.study import Study, chain, expectations, statements, work_table, work_table_hammer

BAND = (300.0, 1300.0)
RUNS = ("bare", "beam_1kN", "beam_5kN", "beam_10kN")


@pytest.fixture(scope="module")
def campaign(root):
    return Study.load(root / "reports" / "work_table_hammer.toml")


@pytest.fixture(scope="module")
def analysed(campaign):
    """The result of a run by its name, computed once."""
    opened = campaign.open()
    return cache(lambda run: chain.analyse(opened[run], campaign.recipe.estimate, campaign.recipe.fit))


def stuck(force):
    """Natural frequencies [Hz] and damping ratios with sticking joints that the hammer can see, from the matrices."""
    system = assemble(work_table.with_beam(work_table.CENTRE, force, work_table.grid()))
    base = modal_base(system)
    inside = (base.frequencies > 2 * np.pi * BAND[0]) & (base.frequencies < 2 * np.pi * BAND[1])
    return base.frequencies[inside] / (2 * np.pi), base.decay[inside] / (2 * base.frequencies[inside])


@pytest.mark.parametrize("force", [1000.0, 5000.0, 10000.0])
def test_accepted_modes_are_those_of_the_sticking_joint(analysed, force):
    result = analysed(f"beam_{force / 1000:.0f}kN")
    frequencies, damping = stuck(force)
    found = result.modes
    assert len(found.poles) == len(frequencies)
    assert found.natural_frequencies == pytest.approx(frequencies, abs=0.2)
    assert found.damping_ratios == pytest.approx(damping, rel=0.03)
    assert found.scaling == "unscaled" and found.uncertainty is None
    assert np.all(np.abs(found.natural_frequencies - frequencies) < 3 * np.sqrt(found.covariance[:, 0, 0]))
    assert {"slip-then-ring", "modes-after-sticking"} <= {one.code for one in result.findings}
    assert len(found.candidates) >= 3


def test_the_bare_table_is_linear_and_keeps_the_modes_of_its_frfs(analysed):
    result = analysed("bare")
    assert result.modes.natural_frequencies == pytest.approx([499.0, 760.0, 1000.0], abs=0.01)
    assert 100 * result.modes.damping_ratios[0] == pytest.approx(0.638, abs=0.007)
    assert [one.code for one in result.findings if one.code in ("level-tested", "slip-then-ring")] == ["level-tested"]
    assert result.level_effect.upper < 0.01 and not result.equivalent
    truth = work_table.bare(work_table.grid())
    rows = [truth.dofs.index(Dof(dof.node, "+Z")) for dof in result.modes.dofs]
    for frequency, shape in zip((499.0, 760.0, 1000.0), result.modes.shapes.T, strict=True):
        exact = truth.shapes[rows, int(np.argmin(np.abs(truth.natural_frequencies - frequency)))]
        assert mac(shape[:, None], exact[:, None])[0, 0] >= 0.999


def test_every_statement_gets_the_verdict_that_the_recipe_states(campaign, analysed):
    """Table 1 by one linear mode fitted to the FRFs, as the paper's analysis did."""
    recipe = campaign.recipe
    results = tuple(analysed(run) for run in RUNS)
    judged = statements.judge(recipe.statements, (), results, recipe.assumed)
    assert [f"{one.text}: {one.verdict}, {one.value:.4g}" for one in judged if not one.met] == []
    assert {one.verdict for one in judged if one.quoted} <= {
        "matched with an assumed parameter",
        "matched with an implausible parameter",
        "not matched",
    }, "what a model shows that was made for it is never simply matched"
    assert all(one.met for one in expectations.check(recipe.expect, results))
    assert {one.verdict for one in judged if not one.quoted} == {"not matched"}, "no run with a beam is linear"


def test_one_linear_mode_explains_the_frfs_where_the_joint_sticks_again(analysed):
    """Misfit at least 0.10 at 1 kN, at most 0.02 at 5 and 10 kN, though none of the three is linear."""
    misfits = [analysed(run).equivalent[0].residual for run in RUNS[1:]]
    assert misfits[0] >= 0.10 and max(misfits[1:]) <= 0.02
    assert min(analysed(run).level_effect.lower for run in RUNS[1:]) > 0.1


@pytest.mark.parametrize(("force", "near", "low", "high"), [(1000.0, 492.0, 0.3, 1.0), (5000.0, 507.0, 0.0, 0.05)])
def test_half_the_impact_changes_the_damping_where_the_joint_slips_and_not_where_it_sticks(force, near, low, high):
    """One linear mode fitted to the FRFs of eight points, impacts of 1 and of 0.5 kN: at least 30 % at 1 kN, at most 5 %
    at 5 kN (and less at 10 kN, which sticks sooner)."""
    points = tuple(range(1, 79, 11))
    damping = []
    for peak in (1000.0, 500.0):
        rig = work_table_hammer._rig("beam", force, peak, points)
        run = Run("beam", Condition(rig.drive.excitation), tuple(rig.takes()))
        frfs, _ = estimate.hammer_test(run)
        damping.append(fit.local_fit(frfs.band(*BAND), near).damping_ratio)
    assert low <= abs(damping[1] / damping[0] - 1) <= high


@pytest.mark.parametrize(("force", "peak"), [(10000.0, 330.0), (5000.0, 165.0)])
def test_impacts_at_a_third_of_what_slips_are_linear_and_give_shapes_and_masses(force, peak):
    """What the finding advises: the same test at a lower level, on eight points. The gate calls it linear, and together
    with impacts of 1 kN not; shapes agree with those of the sticking joint, and modal masses within 5 %."""
    points = tuple(range(1, 79, 11))
    light, hard = (
        Run("beam", Condition(rig.drive.excitation), tuple(rig.takes()))
        for rig in (work_table_hammer._rig("beam", force, level, points) for level in (peak, 1000.0))
    )
    assert linearity(light, BAND).verdict == "linear"
    assert linearity(replace(light, recordings=(*light.recordings, *hard.recordings)), BAND).verdict == "not linear"
    frfs, _ = estimate.hammer_test(light)
    system = assemble(work_table.with_beam(work_table.CENTRE, force, work_table.grid()))
    base = modal_base(system)
    exact = np.array([base.row(system, f"{point}:+Z") for point in points])
    for frequency in stuck(force)[0][[0, 2]]:
        mode = int(np.argmin(np.abs(base.frequencies - 2 * np.pi * frequency)))
        found = fit.local_fit(frfs.band(*BAND), frequency)
        shape = found.residues[0][:, None]
        assert mac(shape, exact[:, mode, None])[0, 0] >= 0.98
        # struck downwards where the accelerometer points upwards: the modal constant of the drive point is -phi^2
        constant = (2j * np.abs(found.pole.imag) * found.residues[0, 0]).real
        assert -1 / constant * exact[0, mode] ** 2 == pytest.approx(1.0, rel=0.05)
