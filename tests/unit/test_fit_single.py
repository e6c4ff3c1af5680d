"""Peak picking, circle fit and local fit against one mode in closed form, several modes, noise, and a published answer."""

from dataclasses import replace

import numpy as np
import pytest

from ema import synthesis
from ema.data import FrfSet
from ema.dof import Dof
from ema.errors import InputError
from ema.fit import circle_fit, local_fit, peak_picking
from ema.fit.peaks import find_peak
from tests.unit.fit_rig import frfs, model

POINT = (Dof(1, "+Z"),)


def one_mode(damping=0.01, natural=50.0, constant=1.0, step=0.02, quantity="receptance", low=20.0, high=90.0):
    """A / (w_r^2 - w^2 + 2j zeta w_r w): the closed form."""
    f = np.arange(low, high, step)
    w, r = 2 * np.pi * f, 2 * np.pi * natural
    values = constant / (r**2 - w**2 + 2j * damping * r * w)
    return synthesis.convert(FrfSet(f, values[:, None, None], POINT, POINT, "receptance", "m/N"), quantity)


def every_method(measured, near):
    return peak_picking(measured, [near])[0], circle_fit(measured, near), local_fit(measured, near)


def noisy(measured, level, seed):
    """Noise of ``level`` times the peak, complex."""
    rng = np.random.default_rng(seed)
    draw = np.sqrt(0.5) * (rng.standard_normal(measured.values.shape) + 1j * rng.standard_normal(measured.values.shape))
    return replace(measured, values=measured.values + level * np.abs(measured.values).max() * draw)


@pytest.mark.parametrize("quantity", ["receptance", "mobility", "accelerance"])
@pytest.mark.parametrize("damping", [0.001, 0.01, 0.1, 0.2])
def test_one_mode_is_read_exactly_at_any_damping(quantity, damping):
    for found in every_method(one_mode(damping, quantity=quantity), 50.0):
        assert found.natural_frequency == pytest.approx(50.0, rel=1e-10), found.method
        assert found.damping_ratio == pytest.approx(damping, rel=1e-9), found.method
        assert not found.findings


def test_modal_constant_and_pole():
    measured = one_mode(0.02, constant=-3.5)
    peak, circle, local = every_method(measured, 50.0)
    for found in (circle, local):
        assert found.modal_constants[0, 0] == pytest.approx(-3.5, rel=1e-9)
        assert found.residual < 1e-10
    # peak picking reads the residue at the line next to the top: quadrature, good to the damping ratio
    assert peak.modal_constants[0, 0] == pytest.approx(-3.5, rel=0.03)
    w = 2 * np.pi * 50.0
    assert local.pole == pytest.approx(complex(-0.02 * w, w * np.sqrt(1 - 0.02**2)), rel=1e-10)
    assert local.outputs == local.inputs == POINT


@pytest.mark.parametrize("turn", [1.0, np.exp(0.7j), -1j])
def test_constant_residual_and_complex_mode_leave_the_circle_exact(turn):
    """In mobility a constant moves the circle and a complex modal constant turns it; neither changes the sweep."""
    measured = one_mode(0.01, quantity="mobility")
    moved = replace(measured, values=measured.values * turn + 0.3 * np.abs(measured.values).max())
    found = circle_fit(moved, 50.0)
    assert found.natural_frequency == pytest.approx(50.0, rel=1e-9)
    assert found.damping_ratio == pytest.approx(0.01, rel=1e-8)
    assert found.modal_constants[0, 0] == pytest.approx(turn, rel=1e-6)
    assert found.damping_ratio_std < 1e-9


def test_far_modes_leave_little_bias():
    truth = model([100.0, 150.0, 210.0], [0.004, 0.006, 0.003], dofs=8)
    measured = frfs(truth, 60, 260, 8001)
    for mode, (f, zeta) in enumerate(zip(truth.natural_frequencies, truth.damping_ratios, strict=True)):
        peak, circle, local = peak_picking(measured, [f])[0], circle_fit(measured, f), local_fit(measured, f)
        assert peak.natural_frequency == pytest.approx(f, rel=1e-4)
        assert peak.damping_ratio == pytest.approx(zeta, rel=0.01)
        assert circle.natural_frequency == pytest.approx(f, rel=1e-4)
        assert circle.damping_ratio == pytest.approx(zeta, rel=0.015)
        assert local.natural_frequency == pytest.approx(f, rel=1e-6)
        assert local.damping_ratio == pytest.approx(zeta, rel=2e-4)
        assert np.linalg.norm(local.residues - truth.residues()[mode]) < 1e-3 * np.linalg.norm(truth.residues()[mode])


def test_the_local_fit_takes_all_frfs_and_any_orientation():
    truth = model([100.0, 160.0], [0.004, 0.006], dofs=8, drive=(0, 3))
    measured = frfs(truth, 60, 260, 4001)
    turned = replace(
        measured, values=measured.values.transpose(0, 2, 1), outputs=measured.inputs, inputs=measured.outputs
    )
    a, b = local_fit(measured, 100.0), local_fit(turned, 100.0)
    assert a.residues.shape == (8, 2)
    assert b.pole == pytest.approx(a.pole, rel=1e-12)
    np.testing.assert_allclose(b.residues, a.residues.T, rtol=1e-9)


def test_standard_deviations_of_the_local_fit_have_the_right_size():
    exact, scores = one_mode(0.01, step=0.05), []
    for seed in range(40):
        found = local_fit(noisy(exact, 0.01, seed), 50.0)
        scores.append(
            [
                (found.natural_frequency - 50) / found.natural_frequency_std,
                (found.damping_ratio - 0.01) / found.damping_ratio_std,
            ]
        )
    rms = np.sqrt(np.mean(np.square(scores), axis=0))
    assert np.all((rms > 0.7) & (rms < 1.35)), rms


@pytest.mark.parametrize(("level", "df", "dzeta"), [(0.003, 1e-4, 0.02), (0.02, 5e-4, 0.10)])
def test_noise(level, df, dzeta):
    exact = one_mode(0.01, step=0.05)
    for seed in range(10):
        for found in every_method(noisy(exact, level, seed), 50.0):
            assert found.natural_frequency == pytest.approx(50, rel=df), found.method
            assert found.damping_ratio == pytest.approx(0.01, rel=dzeta), found.method


def test_the_scatter_over_pairs_grows_with_noise():
    exact = one_mode(0.01, step=0.05)
    scatter = [circle_fit(noisy(exact, level, 1), 50.0).damping_ratio_std for level in (0.001, 0.01, 0.1)]
    assert scatter[0] < 0.3 * scatter[1] < 0.09 * scatter[2] * 3
    assert "damping-scatter" in [finding.code for finding in circle_fit(noisy(exact, 0.1, 1), 50.0).findings]


def test_exponential_window_is_taken_off():
    w, window = 2 * np.pi * 50.0, 1.5
    sigma = 0.005 * w
    wd = w * np.sqrt(1 - 0.005**2)
    f = np.arange(30, 70, 0.02)
    s = 2j * np.pi * f
    pole = complex(-sigma - window, wd)
    residue = 1 / (2j * wd)
    values = residue / (s - pole) + np.conj(residue) / (s - np.conj(pole))
    measured = FrfSet(f, values[:, None, None], POINT, POINT, "receptance", "m/N", added_decay=window)
    constants = np.ones((1, 1))
    for found in every_method(measured, 50.0):
        assert found.natural_frequency == pytest.approx(50.0, rel=1e-9), found.method
        assert found.damping_ratio == pytest.approx(0.005, rel=1e-7), found.method
    assert local_fit(measured, 50.0, modal_constants=constants).quadrature_damping == pytest.approx(0.005, rel=1e-6)


@pytest.mark.parametrize("damping", [0.002, 0.05])
def test_quadrature_damping_of_a_linear_mode_is_its_damping(damping):
    measured = one_mode(damping, constant=2.0)
    found = local_fit(measured, 50.0, modal_constants=np.array([[2.0]]))
    assert found.quadrature_damping == pytest.approx(damping, rel=1e-9)
    assert np.isnan(local_fit(measured, 50.0).quadrature_damping)


def test_quadrature_damping_tells_the_damping_at_the_peak_of_a_nonlinear_mode():
    """Damping that rises with amplitude flattens the peak: its height tells the value there, the flanks another one."""
    f = np.arange(40, 60, 0.01)
    w, r, amplitude = 2 * np.pi * f, 2 * np.pi * 50.0, np.zeros(2000)
    zeta = np.full(len(f), 0.005)
    for _ in range(500):
        amplitude = 1 / np.abs(r**2 - w**2 + 2j * zeta * r * w)
        zeta = 0.5 * zeta + 0.5 * (0.005 + 0.01 * amplitude * r**2 * 0.02)
    values = 1 / (r**2 - w**2 + 2j * zeta * r * w)
    measured = FrfSet(f, values[:, None, None], POINT, POINT, "receptance", "m/N")
    found = local_fit(measured, 50.0, modal_constants=np.ones((1, 1)))
    top = zeta[np.argmax(np.abs(values))]
    assert top > 0.008
    assert found.quadrature_damping == pytest.approx(top, rel=0.002)
    assert abs(found.damping_ratio / top - 1) > 0.02
    assert found.residual > 0.001


def test_a_narrow_peak_says_that_its_damping_cannot_be_told():
    peak = peak_picking(one_mode(0.0005, step=0.1), [50.0])[0]
    assert peak.natural_frequency == pytest.approx(50.0, rel=1e-6)
    assert np.isnan(peak.damping_ratio) and np.all(np.isnan(peak.residues))
    assert [finding.code for finding in peak.findings] == ["unresolved-peak"]
    local = local_fit(one_mode(0.0005, step=0.1), 50.0)
    assert local.damping_ratio == pytest.approx(0.0005, rel=1e-6)
    assert [finding.code for finding in local.findings] == ["few-lines"] and local.lines == 7


def test_overlapping_peaks_have_no_half_power_damping():
    truth = model([100.0, 102.0], [0.008, 0.008], dofs=2, drive=(0, 1))
    truth = replace(truth, shapes=np.eye(2, dtype=complex), participation=np.eye(2) / (2j * truth.poles.imag))
    found = peak_picking(frfs(truth, 80, 120, 4001), [99.5])[0]
    assert np.isnan(found.damping_ratio)
    assert "rises again" in found.findings[0].message


def test_a_peak_cut_by_the_band_has_no_half_power_damping():
    found = peak_picking(one_mode(0.02, low=49.2), [50.0])[0]
    assert np.isnan(found.damping_ratio)
    assert "band ends" in found.findings[0].message


def test_a_conjugated_frf_is_noticed():
    measured = one_mode(0.01)
    found = circle_fit(replace(measured, values=measured.values.conj()), 50.0)
    assert [finding.code for finding in found.findings] == ["conjugate-frf"]
    assert np.isnan(found.damping_ratio)


def test_the_largest_singular_value_serves_as_well_as_the_sum():
    truth = model([100.0, 160.0], [0.004, 0.006], dofs=8, drive=(0, 3))
    measured = frfs(truth, 60, 260, 8001)
    by_sum, by_value = peak_picking(measured, [100, 160]), peak_picking(measured, [100, 160], indicator="cmif")
    for a, b, zeta in zip(by_sum, by_value, (0.004, 0.006), strict=True):
        assert b.natural_frequency == pytest.approx(a.natural_frequency, rel=1e-4)
        assert b.damping_ratio == pytest.approx(zeta, rel=0.02)


def test_each_of_a_pair_is_found_by_its_own_frequency():
    truth = model([100.0, 101.0], [0.001, 0.001], dofs=8)
    found = peak_picking(frfs(truth, 80, 120, 8001), [99.9, 101.1])
    assert [round(mode.natural_frequency) for mode in found] == [100, 101]


def test_scaling_a_unit_scales_the_modal_constant_only():
    measured = noisy(one_mode(0.01), 0.01, 3)
    for method in (lambda m: peak_picking(m, [50.0])[0], lambda m: circle_fit(m, 50.0), lambda m: local_fit(m, 50.0)):
        a, b = method(measured), method(replace(measured, values=1e-9 * measured.values))
        assert b.natural_frequency == pytest.approx(a.natural_frequency, rel=1e-9)
        assert b.damping_ratio == pytest.approx(a.damping_ratio, rel=1e-6)
        np.testing.assert_allclose(b.residues, 1e-9 * a.residues, rtol=1e-5)


def test_a_noisy_frf_with_known_variance_does_not_spoil_the_good_ones():
    truth = model([100.0], [0.005], dofs=2)
    exact = frfs(truth, 90, 110, 801)
    rng = np.random.default_rng(0)
    std = np.array([1e-4, 0.3])[None, :, None] * np.abs(exact.values).max()
    draw = np.sqrt(0.5) * (rng.standard_normal(exact.values.shape) + 1j * rng.standard_normal(exact.values.shape))
    measured = replace(exact, values=exact.values + std * draw)
    weighted = local_fit(replace(measured, variance=np.broadcast_to(std**2, measured.values.shape)), 100.0)
    assert weighted.damping_ratio == pytest.approx(0.005, rel=1e-3)
    assert abs(local_fit(measured, 100.0).damping_ratio / 0.005 - 1) > 1e-2


def test_the_published_answer_of_two_noisy_frfs(datasets):
    from scipy.io import loadmat

    file = loadmat(datasets / "08_sdof_frfs_with_published_answer" / "case1.mat")
    measured = FrfSet(
        file["Freq_domain"].ravel().astype(float),
        file["Hf_chan_2"].astype(complex)[:, :, None],
        (Dof(2),),
        POINT,
        "unstated",
        name="case 1",
    )
    circle, local = circle_fit(measured, 212.0), local_fit(measured, 212.0)
    assert circle.natural_frequency == pytest.approx(212.0925, abs=0.05)
    assert local.natural_frequency == pytest.approx(212.0925, abs=0.05)
    assert circle.damping_ratio == pytest.approx(0.00087, rel=0.05)
    peak = peak_picking(measured, [212.0])[0]
    assert peak.natural_frequency == pytest.approx(212.0925, abs=0.05)
    assert np.isnan(peak.damping_ratio), "the half-power bandwidth is one line wide"


BAD = {
    "nan": lambda m: replace(m, values=np.where(m.frequencies[:, None, None] > 60, np.nan, m.values)),
    "zero": lambda m: replace(m, values=0 * m.values),
    "short": lambda m: m.lines(slice(0, 5)),
    "descending": lambda m: m.lines(slice(None, None, -1)),
    "constant": lambda m: replace(m, values=np.ones_like(m.values)),
}


@pytest.mark.parametrize("what", list(BAD))
@pytest.mark.parametrize(
    "method", [lambda m: peak_picking(m, [50.0]), lambda m: circle_fit(m, 50.0), lambda m: local_fit(m, 50.0)]
)
def test_bad_frfs_are_refused(what, method):
    with pytest.raises(InputError):
        method(BAD[what](one_mode(0.01)))


def test_wrong_wishes_are_refused():
    measured = one_mode(0.01)
    with pytest.raises(InputError, match="outside the FRFs"):
        peak_picking(measured, [500.0])
    with pytest.raises(InputError, match=r"no peak near .* nearest is at 50 Hz"):
        peak_picking(measured, [80.0])
    with pytest.raises(InputError, match="no such FRF"):
        circle_fit(measured, 50.0, output=1)
    with pytest.raises(InputError, match="modal constants do not fit"):
        local_fit(measured, 50.0, modal_constants=np.ones((2, 1)))
    with pytest.raises(InputError, match="no band to fit"):
        local_fit(measured, 50.0, bandwidths=0.0)


def test_a_line_at_zero_hertz_is_left_out():
    measured = one_mode(0.01, low=0.0, quantity="accelerance")
    assert local_fit(measured, 50.0).damping_ratio == pytest.approx(0.01, rel=1e-9)


@pytest.mark.parametrize(("side", "line"), [(1, 2.1), (1, 0.7), (-1, 2.1)])
def test_a_peak_within_reach_is_found_though_its_highest_line_is_not(side: int, line: float):
    """A resonance within 5 % of the wanted frequency, its highest line 0.1 Hz beyond."""
    highest = 1000 + 50.1 * side
    natural = highest - 0.45 * side * line
    frequencies = highest + line * np.arange(-90, 91)
    response = 1 / (natural**2 - frequencies**2 + 2j * 0.002 * natural * frequencies)
    power = np.abs(response) ** 2
    assert power.argmax() == 90 and abs(natural - 1000) < 50
    assert find_peak(frequencies, power, 1000.0, "drawn").line == 90
    with pytest.raises(InputError, match="no peak near"):
        find_peak(frequencies + side * line, power, 1000.0, "drawn")
