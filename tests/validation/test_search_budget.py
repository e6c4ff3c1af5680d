"""What a search for a steady state may cost: counted, ended, and said, with an error that holds."""

import numpy as np
import pytest

from ema.elements import Section
from ema.errors import InputError
from ema.simulate import Coulomb, HarmonicBalance, Masing, double_beam, frf
from ema.simulate.factors import Factors

TIP = "beam 2:4:+Z"
FREQUENCIES = np.array([27.0, 28.0, 29.0])


def swept(budget=None):
    model = double_beam(Masing(0.3, 1e9), 1000.0, Section(0.5, 0.04, 0.005, elements=4))
    return frf(
        model, FREQUENCIES, 5.0, TIP, [TIP], HarmonicBalance(1e-4, **({} if budget is None else {"budget": budget}))
    )


def first(response):
    return response.values[:, 0, list(response.orders).index(1)]


def budget_findings(response):
    return [finding for finding in response.findings if finding.code == "budget-spent"]


def test_a_search_that_is_ended_gives_its_best_solution_with_an_error_that_holds():
    """Against the same points at a tenth of a thousandth; ends vary from nothing found to all but the last harmonics."""
    whole = swept()
    assert not budget_findings(whole) and whole.converged.all()
    ended = 0
    for budget in (1, 500, 1500, 4000, 12000):
        cut = swept(budget)
        away = np.abs(first(cut) / first(whole) - 1)
        good = cut.converged
        assert np.all(away[good] <= cut.error_estimate[good] + whole.error_estimate[good]), budget
        if (cut.error_estimate[good] > 1e-4).any() or not good.all():
            (finding,) = budget_findings(cut)
            assert finding.value > finding.limit == budget
            assert "Hz" in finding.message and "larger budget" in finding.advice
            ended += 1
    assert ended >= 3


def test_what_a_search_spends_is_counted_and_not_timed():
    one, two = swept(1500), swept(1500)
    assert budget_findings(one)[0].value == budget_findings(two)[0].value
    np.testing.assert_array_equal(one.values, two.values)


def test_a_budget_that_is_none_gets_a_sentence():
    with pytest.raises(InputError, match="budget"):
        swept(0)


def test_kept_factors_solve_the_matrices_that_follow():
    """Against elimination: matrices that differ by little rank, then one that has nothing to do with them."""
    draw, factors = np.random.default_rng(3), Factors()
    matrix = np.eye(450) + 0.02 * draw.normal(size=(450, 450))
    made = []
    for change in (0.0, 1.0, 1.0, 300.0):
        matrix = matrix + change * draw.normal(size=(450, 3)) @ draw.normal(size=(3, 450)) / 450
        if change > 100:
            matrix = draw.normal(size=matrix.shape)
        right = draw.normal(size=450)

        def whole(matrix=matrix):
            made.append(1)
            return matrix.copy()

        found = factors.solve((1, 2), lambda vector, matrix=matrix: matrix @ vector, whole, right, 1e-6)
        assert np.linalg.norm(matrix @ found - right) <= 2e-6 * np.linalg.norm(right)
    assert len(made) == 2


def test_rigid_friction_at_many_pairs_balances_its_power():
    """Hardly any step is found by the coarse inverse here: kept factors carry the search."""
    model = double_beam(Coulomb(0.3, 3e10), 138.0)
    response = frf(
        model, np.array([47.8]), 1.0, "beam 2:20:+Z", ["beam 2:20:+Z"], settings=HarmonicBalance(tolerance=2e-2)
    )
    assert response.converged.all() and response.power_error <= 1e-6
