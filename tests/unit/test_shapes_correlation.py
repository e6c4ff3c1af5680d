"""MAC family: values known in closed form, and what must hold for all shapes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ema.compare import pairing
from ema.data import ModalModel, poles_from
from ema.dof import Dof
from ema.errors import InputError
from ema.shapes import auto_mac, co_mac, compare, frac, mac


def random_shapes(seed: int, dofs: int = 7, modes: int = 3) -> np.ndarray:
    generator = np.random.default_rng(seed)
    return generator.normal(size=(dofs, modes)) + 1j * generator.normal(size=(dofs, modes))


def model(shapes: np.ndarray, dofs: list[str]) -> ModalModel:
    count = shapes.shape[1]
    return ModalModel(
        poles_from(100.0 * np.arange(1, count + 1), np.full(count, 0.01)),
        shapes.astype(complex),
        tuple(Dof.parse(dof) for dof in dofs),
        np.ones((1, count), complex),
        (Dof(1, "+Z"),),
    )


def test_mac_of_known_vectors():
    a = np.array([[1.0], [0.0]])
    b = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0]])
    np.testing.assert_allclose(mac(a, b), [[1.0, 0.0, 0.5]], atol=1e-15)


def test_mac_conjugates_complex_shapes():
    """(1, j) and its conjugate are orthogonal in the Hermitian product; without the conjugate they would be equal."""
    assert mac(np.array([[1], [1j]]), np.array([[1], [-1j]]))[0, 0] == pytest.approx(0, abs=1e-15)


@given(seed=st.integers(0, 2**32 - 1), exponent=st.floats(-250, 250), phase=st.floats(0, 2 * np.pi))
def test_mac_knows_no_scale_and_no_phase(seed, exponent, phase):
    shapes = random_shapes(seed)
    turned = shapes * 10**exponent * np.exp(1j * phase)
    np.testing.assert_allclose(mac(shapes, turned), auto_mac(shapes), atol=1e-12)


@given(seed=st.integers(0, 2**32 - 1))
def test_mac_is_bounded_symmetric_and_one_on_the_diagonal(seed):
    table = auto_mac(random_shapes(seed))
    assert np.all((table >= 0) & (table <= 1))
    np.testing.assert_allclose(table, table.T, atol=1e-12)
    np.testing.assert_allclose(np.diag(table), 1, atol=1e-12)


def test_mac_of_a_zero_shape_is_unknown_and_of_bad_input_an_error():
    assert np.isnan(mac(np.array([[0.0], [0.0]]), np.array([[1.0], [1.0]]))[0, 0])
    with pytest.raises(InputError, match="NaN"):
        mac(np.array([[np.nan], [0.0]]), np.array([[1.0], [1.0]]))
    with pytest.raises(InputError, match="different DOFs; got 2 and 3 rows"):
        mac(np.ones((2, 1)), np.ones((3, 1)))


def test_co_mac_points_at_the_bad_dof():
    shapes = random_shapes(1).real
    spoiled = shapes.copy()
    spoiled[4] *= [1.0, 0.1, 3.0]
    values = co_mac(shapes, spoiled)
    assert np.argmin(values) == 4
    assert values[4] < 0.92
    np.testing.assert_allclose(co_mac(shapes, -2 * shapes), 1, atol=1e-12)


@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(1e-6, 1e6))
def test_frac_knows_no_scale(seed, scale):
    h = random_shapes(seed, 50, 6).reshape(50, 3, 2)
    np.testing.assert_allclose(frac(h, scale * h), np.ones((3, 2)), atol=1e-12)


def test_frac_of_orthogonal_records_is_zero():
    h = np.zeros((2, 1, 1), complex)
    x = h.copy()
    h[0], x[1] = 1, 1
    assert frac(h, x)[0, 0] == 0


def test_compare_matches_dofs_whatever_their_order_and_sense():
    shapes = random_shapes(3, 4, 3)
    a = model(shapes, ["1Z", "2Z", "3Z", "4Z"])
    b = model(shapes[[2, 0, 1]][:, [1, 0, 2]] * [[1], [-1], [1]], ["3Z", "1-Z", "2Z"])
    found = compare(a, b)
    assert [str(dof) for dof in found.dofs] == ["1:+Z", "2:+Z", "3:+Z"]
    assert found.pairs == ((0, 1), (1, 0), (2, 2))
    assert [found.mac[pair] for pair in found.pairs] == pytest.approx([1, 1, 1])


def test_compare_leaves_unlike_modes_unpaired():
    a, b = model(np.eye(4)[:, :2], ["1Z", "2Z", "3Z", "4Z"]), model(np.eye(4)[:, 1:3], ["1Z", "2Z", "3Z", "4Z"])
    assert compare(a, b).pairs == ((1, 0),)


def test_compare_without_common_dofs_is_an_error():
    with pytest.raises(InputError, match="no DOF in common"):
        compare(model(np.ones((1, 1)), ["1X"]), model(np.ones((1, 1)), ["1Y"]))


def test_a_pair_names_the_modes_that_are_nearly_as_like():
    """Shapes made of the modes of a: 0 comes back once for sure, 1 in two parts that are about equally like."""
    a = model(np.eye(6)[:, :3], ["1Z", "2Z", "3Z", "4Z", "5Z", "6Z"])
    columns = np.array([[1.0, 0, 0], [0, 0.8, 0.75], [0, 0, 0], [0, 0.6, 0], [0, 0, 0.66], [0, 0, 0]])
    found = compare(a, model(columns, ["1Z", "2Z", "3Z", "4Z", "5Z", "6Z"]))
    assert found.pairs == ((0, 0), (1, 1))
    assert found.rivals == ((), (2,))


def retuned(shapes: np.ndarray, frequencies: np.ndarray) -> ModalModel:
    """A model whose responses are as many as the shapes have rows."""
    new = model(shapes, [f"{row}Z" for row in range(1, len(shapes) + 1)])
    return replace(new, poles=poles_from(frequencies, np.full(len(frequencies), 0.01)))


@pytest.mark.parametrize("seed", range(20))
def test_frequencies_decide_where_few_sensors_see_one_shape_in_several_modes(seed: int):
    """Modes at least 15 % apart that change by up to 3 %, of two shapes at two sensors with an error of 1e-3: the MAC
    alone had joined 142 with 298 Hz and reported a change of +110 %."""
    rng = np.random.default_rng(seed)
    frequencies = 50.0 * np.cumprod(rng.uniform(1.15, 1.6, 6))
    shapes = np.array([[1.0, 1.0], [1.0, -1.0]])[:, [0, 1, 0, 1, 0, 1]]
    before, after = (
        retuned(shapes + rng.normal(0, 1e-3, shapes.shape), frequencies * rng.uniform(*ends, 6))
        for ends in ((1, 1), (0.97, 1.03))
    )
    found = compare(before, after)
    assert found.pairs == tuple((mode, mode) for mode in range(6))
    assert not any(found.rivals)


@pytest.mark.parametrize("seed", range(20))
def test_modes_that_change_places_keep_to_their_shapes(seed: int):
    """Ten sensors, 5 % of error: two neighbours that are 10 % apart cross each other."""
    rng = np.random.default_rng(seed)
    shapes = np.linalg.qr(rng.normal(size=(10, 4)))[0]
    before = retuned(shapes, np.array([100.0, 110.0, 150.0, 200.0]))
    after = retuned(shapes[:, [1, 0, 2, 3]] + rng.normal(0, 0.05 / np.sqrt(10), (10, 4)), before.natural_frequencies)
    found = compare(before, after)
    assert found.pairs == ((0, 1), (1, 0), (2, 2), (3, 3)) and not any(found.rivals)


def test_neighbours_of_one_shape_are_rivals_of_each_other():
    shapes = np.array([[1.0, 1.0, 1.0], [1.0, 0.999, -1.0]])
    found = compare(retuned(shapes, np.array([100.0, 102.0, 300.0])), retuned(shapes, np.array([101.0, 104.0, 301.0])))
    assert found.pairs == ((0, 0), (1, 1), (2, 2))
    assert found.rivals == ((1,), (0,), ())


def test_rigid_body_modes_at_0_hz_are_paired():
    shapes = np.eye(3)[:, [0, 1, 2]]
    still, moving = (retuned(shapes, np.array([f, f, 300.0])) for f in (0.0, 2.0))
    for other in (still, moving):
        assert compare(still, other).pairs == ((0, 0), (1, 1), (2, 2))


def test_a_mode_that_is_another_ones_partner_is_no_rival():
    a = model(np.array([[1.0, 0.8], [0, 0.6], [0, 0]]), ["1Z", "2Z", "3Z"])
    b = model(np.array([[0.9, 0.8], [0, 0.6], [0.43, 0.0]]), ["1Z", "2Z", "3Z"])
    found = compare(a, b)
    assert found.pairs == ((0, 0), (1, 1))
    assert found.mac[0, 1] > found.mac[0, 0] - 0.2
    assert found.rivals == ((), ())


def test_the_verdict_on_a_model_names_pairs_that_are_not_certain():
    shapes = np.array([[1.0, 1.0, 1.0], [1.0, 0.999, -1.0]])
    measured, model_ = (retuned(shapes, np.array(f)) for f in ([100.0, 102.0, 300.0], [101.0, 104.0, 301.0]))
    (said,) = [one for one in pairing.modes(measured, model_).verdict.sentences if "for certain" in one]
    assert said.endswith("belongs to measured 1, 2.")
