"""What single blows change in their average: kept by the estimators, carried by the nouns, told by the fit."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition.setups import Part, merge
from ema import store, synthesis
from ema.data import Deviations
from ema.dof import Dof
from ema.estimate.single_impacts import MOST, SingleImpacts
from ema.estimate.single_input import estimate, over_h1, summed
from tests.unit.fit_rig import frfs, model

FORCE, DOFS = Dof(1, "+Z"), (Dof(1, "+Z"), Dof(2, "+Z"))


def blows(count, rng, lines=4000):
    """Spectra of blows of different strength with noise of one level on two responses; the true FRFs are 1 and 2."""
    for _ in range(count):
        force = rng.uniform(0.5, 2) * np.ones(lines, complex)
        noise = 0.1 * np.sqrt(0.5) * (rng.standard_normal((2, lines)) + 1j * rng.standard_normal((2, lines)))
        yield summed(force, np.array([[1.0], [2.0]]) * force + noise)


def kept(parts, estimator="H1"):
    singles, key = SingleImpacts(), (FORCE, DOFS)
    singles.keep(key, parts)
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    values, coherence, variance = (each[None] for each in estimate(total, estimator))
    factor = over_h1(coherence, estimator)
    return singles.deviations(values, {key: total}, DOFS, (FORCE,), factor), variance


@pytest.mark.parametrize("estimator", ["H1", "H2", "Hv"])
@pytest.mark.parametrize("count", [2, 3, 5, 3 * MOST + 1])
def test_the_squares_of_the_deviations_are_the_variance_of_the_average(estimator, count):
    found, variance = kept(list(blows(count, np.random.default_rng(5))), estimator)
    assert found.values.shape == (min(count, MOST), 4000, 2, 1)
    energy = np.mean(np.sum(np.abs(found.values) ** 2, axis=0)[:, :, 0], axis=0)
    np.testing.assert_allclose(energy, np.mean(variance[0], axis=1), rtol=0.08)


def test_both_responses_saw_the_same_blows():
    found, _ = kept(list(blows(3, np.random.default_rng(1))))
    np.testing.assert_array_equal(found.blows[:, :, 0], [[0, 0], [1, 1], [2, 2]])


def test_one_blow_has_nothing_to_deviate_from():
    assert kept(list(blows(1, np.random.default_rng(1))))[0] is None


def measured():
    whole = frfs(model([120.0, 150.0], [0.004, 0.006], dofs=3), 100, 180, 60)
    rng = np.random.default_rng(2)
    values = rng.standard_normal((2, *whole.values.shape)) + 0j
    return replace(whole, deviations=Deviations(values, np.arange(2)[:, None, None] + np.zeros((2, 3, 1), int)))


def test_a_part_of_the_set_keeps_its_part():
    whole = measured()
    part = whole.lines(slice(3, 20)).pick([2, 0], [0])
    np.testing.assert_array_equal(part.deviations.values, whole.deviations.values[:, 3:20][:, :, [2, 0]])
    assert part.deviations.blows.shape == (2, 2, 1)


def test_another_quantity_changes_them_as_it_changes_the_values():
    whole = measured()
    assert whole.quantity == "accelerance"
    found = synthesis.convert(whole, "receptance")
    ratio = np.array([found.values / whole.values] * 2)
    np.testing.assert_allclose(found.deviations.values / whole.deviations.values, ratio, rtol=1e-5)


def test_merged_set_ups_have_blows_of_their_own():
    whole = measured()
    parts = [Part(whole.pick([0, 1]), "a", "a"), Part(whole.pick([2]), "b", "b")]
    merged = merge(parts)
    np.testing.assert_array_equal(merged.deviations.blows[:, :, 0], [[0, 0, 2], [1, 1, 3]])
    np.testing.assert_array_equal(merged.deviations.values, whole.deviations.values)
    without = merge([parts[0], Part(replace(parts[1].frfs, deviations=None), "b", "b")])
    np.testing.assert_array_equal(without.deviations.blows[:, :, 0], [[0, 0, -1], [1, 1, -1]])
    assert not without.deviations.values[:, :, 2].any()
    assert merge([replace(one, frfs=replace(one.frfs, deviations=None)) for one in parts]).deviations is None


def test_they_are_stored(tmp_path):
    whole = measured()
    store.save(tmp_path / "x.h5", whole)
    found = store.load(tmp_path / "x.h5").deviations
    np.testing.assert_array_equal(found.values, whole.deviations.values)
    np.testing.assert_array_equal(found.blows, whole.deviations.blows)
