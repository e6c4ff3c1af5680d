"""The stabilisation diagram: its letters by constructed cases, its orders, its window correction."""

from dataclasses import replace

import numpy as np
import pytest

from ema.data import poles_from
from ema.errors import CancelledError, InputError
from ema.fit import stabilise
from ema.fit.prepare import prepare
from ema.fit.stabilisation import TOLERANCES, _degrees, _letters
from tests.unit.fit_rig import frfs, model


def one(frequency, damping):
    return poles_from(np.array([frequency]), np.array([damping]))


CASES = [
    (1.0, 1.0, 0.0, "s"),
    (1.0099, 1.0, 0.0, "s"),
    (1.0102, 1.0, 0.0, "o"),
    (1.009, 1.049, 0.0, "s"),
    (1.009, 1.06, 0.0, "v"),
    (1.009, 0.94, 0.3, "f"),
    (1.0, 1.0, 0.13, "s"),
    (1.0, 1.0, 0.16, "d"),
    (1.05, 1.0, 0.0, "o"),
]


@pytest.mark.parametrize(("frequency", "damping", "angle", "letter"), CASES)
def test_letters_as_defined(frequency, damping, angle, letter):
    """f 1 %, d 5 % of the damping, v 1 - MAC of 2 % (an angle of 0.1415 rad), each against the pole of the order before."""
    before = one(100.0, 0.01), np.array([[1.0, 0.0]], complex)
    vector = np.array([[np.cos(angle), 1j * np.sin(angle)]])
    after = one(100.0 / frequency, 0.01 / damping)
    assert "".join(_letters(after, vector, before, TOLERANCES)) == letter


def test_letters_follow_the_tolerances_and_the_first_order_is_new():
    vector = np.ones((1, 1), complex)
    assert _letters(one(100.0, 0.01), vector, None, TOLERANCES)[0] == "o"
    assert _letters(one(100.0, 0.01), vector, (np.zeros(0, complex), np.zeros((0, 1), complex)), TOLERANCES)[0] == "o"
    assert _letters(one(100.0, 0.01), vector, (one(103.0, 0.01), vector), (0.05, 0.05, 0.02))[0] == "s"


def test_true_modes_are_stable_in_all_orders_above_the_lowest():
    truth = model([110.0, 131.0, 160.0, 205.0], [0.004, 0.01, 0.003, 0.02], drive=(0, 7))
    table = stabilise(frfs(truth, 90, 230, 801, noise=0.001), range(8, 33, 2))
    for pole in truth.poles:
        near = np.abs(table.poles - pole) < 0.02 * abs(pole.real)
        assert set(table.order[near]) >= set(range(16, 33, 2))
        assert set(table.letter[near & (table.order > 16)]) == {"s"}


def test_orders_are_counted_as_usual():
    truth = model([110.0, 160.0], [0.004, 0.003])
    measured = frfs(truth, 90, 230, 401)
    table = stabilise(measured, range(2, 11, 2))
    # low orders may give growing poles only, which are left out
    assert {8, 10} <= set(table.order) <= {2, 4, 6, 8, 10}
    assert all(np.count_nonzero(table.order == order) <= order // 2 for order in set(table.order))
    odd = stabilise(measured, [3, 4, 7])
    assert 8 in set(odd.order) <= {4, 8}
    assert table.band == (90.0, 230.0)
    assert table.tolerances == TOLERANCES


def test_default_orders_go_up_to_sixty_and_further_for_one_reference():
    truth = model([110.0, 160.0], [0.004, 0.003], dofs=4, drive=(0, 1, 2, 3))
    measured = frfs(truth, 90, 230, 801, noise=0.01)
    assert stabilise(measured).order.max() == 60
    assert stabilise(measured.pick(inputs=[0])).order.max() == 200
    assert stabilise(measured.lines(slice(0, 60)).pick(inputs=[0])).order.max() <= 30


@pytest.mark.parametrize("orders", [[], [0], [-4, 2], range(0)])
def test_no_usable_order_is_refused(orders):
    measured = frfs(model([110.0], [0.004]), 90, 130, 201)
    with pytest.raises(InputError, match="no usable model order"):
        stabilise(measured, orders)


def test_an_order_too_high_for_the_lines_is_refused():
    measured = frfs(model([110.0], [0.004]), 90, 130, 40)
    with pytest.raises(InputError, match=r"too high for the number of frequency lines.*orders up to 20"):
        stabilise(measured, [22])


@pytest.mark.parametrize(
    ("orders", "expected"),
    [
        (range(2, 5001, 2), "got 2500 orders up to 5000, expected orders up to 892 of these"),
        ([4800], "got 1 order up to 4800, expected orders up to 4308"),
    ],
)
def test_orders_that_would_take_hours_are_refused_at_once(orders, expected):
    """One FRF of 16 385 lines, which would allow orders up to 8192: the eigenvalue problems grow with their cube."""
    measured = frfs(model([110.0], [0.004], dofs=1), 90, 130, 16385)
    with pytest.raises(InputError, match=f"too much work.*{expected}.*narrower band"):
        stabilise(measured, orders)


def test_the_usual_orders_may_be_named_for_any_number_of_references():
    truth = model([110.0], [0.004], dofs=48, drive=tuple(range(48)))
    prepared = prepare(frfs(truth, 90, 130, 3201, noise=0.01))
    assert _degrees(None, prepared) == _degrees([2 * degree for degree in _degrees(None, prepared)], prepared)


def test_added_decay_is_taken_off_every_pole_exactly():
    truth = model([110.0, 160.0], [0.004, 0.003])
    measured = frfs(truth, 90, 230, 401, noise=0.001)
    plain, windowed = stabilise(measured, [8, 12]), stabilise(replace(measured, added_decay=1.7), [8, 12])
    np.testing.assert_allclose(windowed.poles, plain.poles + 1.7, rtol=1e-14)


def test_participation_vectors_have_unit_length():
    truth = model([110.0, 160.0], [0.004, 0.003], drive=(0, 3, 5))
    table = stabilise(frfs(truth, 90, 230, 401, noise=0.01), [8, 12])
    np.testing.assert_allclose(np.linalg.norm(table.participation, axis=1), 1, rtol=1e-12)
    assert table.participation.shape[1] == 3


def test_cancelling():
    measured = frfs(model([110.0, 160.0], [0.004, 0.003]), 90, 230, 401)
    seen = []

    def progress(what, done, total):
        seen.append((what, done, total))
        return done < 2

    with pytest.raises(CancelledError, match="model orders"):
        stabilise(measured, range(4, 21, 2), progress=progress)
    assert [done for _, done, _ in seen] == [0, 1, 2]
    assert {total for *_, total in seen} == {9}


def test_scaling_leaves_the_table():
    truth = model([110.0, 160.0], [0.004, 0.003], drive=(0, 3))
    measured = frfs(truth, 90, 230, 401, noise=0.01)
    table, scaled = stabilise(measured, [8, 12]), stabilise(replace(measured, values=1e6 * measured.values), [8, 12])
    np.testing.assert_allclose(scaled.poles, table.poles, rtol=1e-9)
    np.testing.assert_array_equal(scaled.letter, table.letter)


def test_references_of_unequal_units_give_the_poles_of_equal_ones():
    truth = model([110.0, 160.0], [0.004, 0.003], drive=(0, 3))
    measured = frfs(truth, 90, 230, 401, noise=0.01)
    unequal = replace(measured, values=measured.values * np.array([1.0, 1e4]))
    table, scaled = stabilise(measured, [8, 12]), stabilise(unequal, [8, 12])
    np.testing.assert_allclose(scaled.poles, table.poles, rtol=1e-6)
