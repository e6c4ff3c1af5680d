"""Bad input: one clear sentence, or a fit that goes on without what cannot be used."""

from dataclasses import replace

import numpy as np
import pytest

from ema.dof import Dof
from ema.errors import InputError
from ema.fit import modes, reconstruction_error, stabilise
from ema.fit.prepare import prepare
from tests.unit.fit_rig import frfs, model


@pytest.fixture(scope="module")
def good():
    return frfs(model([120.0, 150.0], [0.004, 0.006], dofs=8, drive=(0, 3)), 100, 180, 401, noise=0.005)


def fitted(measured):
    return modes(measured, stabilise(measured, range(4, 25, 2)))


def two_modes(found):
    np.testing.assert_allclose(found.natural_frequencies, [120.0, 150.0], rtol=1e-3)
    np.testing.assert_allclose(found.damping_ratios, [0.004, 0.006], rtol=0.05)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, complex(0, np.nan)])
def test_values_that_are_no_numbers(good, bad):
    values = np.array(good.values)
    values[17, 5, 1] = bad
    with pytest.raises(InputError, match=r"rig, 6:\+Z/4:\+Z: an FRF holds NaN or infinite values; got 1"):
        stabilise(replace(good, values=values))


def test_infinities_that_cancel_are_seen_too(good):
    values = np.array(good.values)
    values[17, 5, 1], values[18, 5, 1] = np.inf, -np.inf
    with pytest.raises(InputError, match="NaN or infinite"):
        stabilise(replace(good, values=values))


def test_nothing_but_zeros(good):
    with pytest.raises(InputError, match="all FRFs are zero"):
        stabilise(replace(good, values=0 * good.values))


@pytest.mark.parametrize("lines", [1, 2, 15])
def test_too_few_lines(good, lines):
    with pytest.raises(InputError, match=f"too few frequency lines to fit modes; got {lines}, expected at least 16"):
        stabilise(good.lines(slice(100, 100 + lines)))


def test_the_fewest_lines_that_are_taken(good):
    near_peak = good.band(118, 123).lines(slice(0, 16))
    assert len(near_peak.frequencies) == 16
    found = fitted_few(near_peak)
    assert np.all(np.isfinite(found.poles))


def fitted_few(measured):
    return modes(measured, stabilise(measured))


def test_an_axis_that_does_not_increase(good):
    with pytest.raises(InputError, match="does not increase"):
        stabilise(good.lines(slice(None, None, -1)))
    twice = np.array(good.frequencies)
    twice[100] = twice[99]
    with pytest.raises(InputError, match="does not increase"):
        stabilise(replace(good, frequencies=twice))
    for bad in (np.nan, np.inf):
        broken = np.array(good.frequencies)
        broken[-1] = bad
        with pytest.raises(InputError, match="does not increase"):
            stabilise(replace(good, frequencies=broken))


def test_a_line_at_zero_hertz_is_left_out():
    measured = frfs(model([20.0, 35.0], [0.004, 0.006], dofs=4), 0, 50, 401, quantity="accelerance")
    found = fitted(measured)
    np.testing.assert_allclose(found.natural_frequencies, [20.0, 35.0], rtol=1e-6)
    _, error = reconstruction_error(measured, found)
    assert np.all(error < 1e-4)


def test_a_set_without_frfs(good):
    empty = replace(good, values=np.zeros((401, 0, 2), complex), outputs=())
    with pytest.raises(InputError, match="no FRFs to fit"):
        stabilise(empty)


def test_a_band_outside(good):
    with pytest.raises(InputError, match=r"no frequency line in the band.*expected a band inside 100 to 180 Hz"):
        good.band(500, 600)
    table = stabilise(good, [8])
    with pytest.raises(InputError, match="no frequency line in the band"):
        modes(replace(good, frequencies=good.frequencies + 500), table)


def test_an_empty_pole_table(good):
    table = stabilise(good, [8])
    empty = replace(
        table,
        order=table.order[:0],
        poles=table.poles[:0],
        letter=table.letter[:0],
        participation=table.participation[:0],
    )
    two_modes(modes(good, empty))
    with pytest.raises(InputError, match=r"no pole near the wanted frequency.*the nearest are"):
        modes(good, empty, near=[137.0])


def test_a_wanted_frequency_that_is_no_number(good):
    table = stabilise(good, [8])
    with pytest.raises(InputError, match="no pole near"):
        modes(good, table, near=[float("nan")])


def test_one_frf(good):
    two_modes(fitted(good.pick([0], [0])))
    two_modes(fitted(good.pick([4], [0])))


def test_one_output_and_several_references(good):
    found = fitted(good.pick([0], None))
    two_modes(found)
    assert found.dofs == good.inputs and found.inputs == good.outputs[:1]


def test_identical_columns(good):
    """Two references that measured the same: one of them is superfluous, not harmful."""
    same = replace(good, values=np.repeat(good.values[:, :, :1], 2, axis=2))
    two_modes(fitted(same))


def test_identical_rows(good):
    rows = [0, 0, 0, 1, 2]
    two_modes(fitted(replace(good.pick(rows), outputs=tuple(Dof(node, "+Z") for node in range(1, 6)))))


def test_duplicated_dofs(good):
    rows = [0, 1, 2, 3, 4, 5, 2, 1]
    found = fitted(good.pick(rows))
    two_modes(found)
    assert len(found.dofs) == 8


def test_a_dead_reference_is_left_out(good):
    values = np.array(good.values)
    values[:, :, 1] = 0
    found = fitted(replace(good, values=values))
    two_modes(found)
    assert found.inputs == good.inputs[:1]
    assert "dead-output" in [finding.code for finding in found.findings]


def test_a_constant_frf_among_good_ones(good):
    values = np.array(good.values)
    values[:, 5] = 1.0
    two_modes(fitted(replace(good, values=values)))


@pytest.mark.parametrize("scale", [1e-30, 1e30])
def test_tiny_and_huge_numbers(good, scale):
    two_modes(fitted(replace(good, values=scale * good.values)))


@pytest.mark.parametrize("bad", [0.0, np.nan, np.inf, -1.0])
def test_variances_that_say_nothing_are_not_used(good, bad):
    variance = np.full(good.values.shape, bad)
    two_modes(fitted(replace(good, variance=variance)))


def test_a_single_bad_variance_does_not_stop_the_fit(good):
    variance = np.full(good.values.shape, 1e-6)
    for bad in (0.0, np.nan, np.inf):
        variance[10, 2, 1] = bad
        two_modes(fitted(replace(good, variance=variance)))


@pytest.mark.parametrize("bad", [1.0, 1.5, -0.2, 0.0, np.nan])
def test_coherences_that_say_nothing_are_not_used(good, bad):
    two_modes(fitted(replace(good, coherence=np.full(good.values.shape, bad))))


def test_a_coherence_of_one_in_a_few_lines(good):
    coherence = np.full(good.values.shape, 0.98)
    coherence[50:60] = 1.0
    coherence[200:203] = 0.0
    two_modes(fitted(replace(good, coherence=coherence)))


def test_holes_in_the_axis(good):
    f = np.asarray(good.frequencies)
    two_modes(fitted(good.lines(np.flatnonzero((f < 130) | (f > 140)))))
    two_modes(fitted(good.lines(np.flatnonzero(np.arange(401) % 10 != 0))))
    two_modes(fitted(good.lines(np.flatnonzero(np.abs(f - 135.0) > 0.3))))


def test_a_very_uneven_axis():
    from ema import synthesis

    truth = model([120.0, 150.0], [0.004, 0.006], dofs=8, drive=(0, 3))
    f = 100.0 * 1.8 ** np.linspace(0, 1, 401)  # logarithmic
    found = fitted(synthesis.frfs(truth, f, "accelerance"))
    np.testing.assert_allclose(found.poles, truth.poles, rtol=1e-6)


def test_what_was_prepared_says_what_was_left_out(good):
    values = np.array(good.values)
    values[:, 2] = 0
    data = prepare(replace(good, values=values))
    assert data.dead == (good.outputs[2],)
    assert len(data.dofs) == 7 and not data.swapped
    assert data.values.shape == (401, 7, 2)


def test_nothing_is_changed_in_place(good):
    before = np.array(good.values)
    fitted(good)
    np.testing.assert_array_equal(good.values, before)
    with pytest.raises(ValueError, match="read-only"):
        np.asarray(good.values)[0] = 0
