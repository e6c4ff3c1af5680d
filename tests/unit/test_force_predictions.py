"""Force surface, resonances and responses of an amplitude-dependent mode, against closed forms."""

import json

import numpy as np
import pytest
from scipy.optimize import brentq

from ema import store
from ema.compare import (
    amplitude_draws,
    force_surface,
    forced_resonances,
    forced_response,
    predict_amplitudes,
    predict_from_draws,
    predictive_draws,
)
from ema.data import AmplitudeDependentMode, AmplitudeDraws, Band, ForcedResponse
from ema.errors import InputError
from tests.unit.test_amplitude_prediction import command, joint
from tests.unit.test_docs_python import executed

MASS, F0, ZETA = 2.0, 40.0, 0.03
POWER = {"displacement": 0, "velocity": 1, "acceleration": 2}


def linear(quantity="acceleration", draws=3):
    """A mode that does not depend on its amplitude: displacements of 1 to 100 mm at resonance, measured 2 to 40 mm."""
    amplitude = np.geomspace(1e-3, 0.1, 30) * (2 * np.pi * F0) ** POWER[quantity]
    same = np.ones((draws, 30))
    levels = np.array([2e-3, 0.04]) * (2 * np.pi * F0) ** POWER[quantity]
    return AmplitudeDraws(amplitude, F0 * same, ZETA * same, levels, MASS * np.ones(draws), quantity, name="plate")


def frf(quantity, f):
    """Displacement, velocity or acceleration over force of one mode (Ewins 2000, Eq. 2.11)."""
    w, w0 = 2 * np.pi * f, 2 * np.pi * F0
    return (1j * w) ** POWER[quantity] / (MASS * (w0**2 - w**2 + 2j * ZETA * w0 * w))


@pytest.mark.parametrize("quantity", POWER)
def test_a_linear_mode_has_the_frf_of_the_textbook(quantity):
    f, draws = np.linspace(30.0, 50.0, 81), linear(quantity)
    force = 2 * ZETA * MASS * (2 * np.pi * F0) ** 2 * 5e-3
    response = forced_response(draws, force, f)
    for sweep in ("up", "down"):
        assert response.frf(sweep) == pytest.approx(frf(quantity, f), rel=1e-9)
    assert response.folded == 0 and set(response.solutions) == {1}
    curve = response.curve_amplitudes / np.abs(frf(quantity, response.curve_frequencies))
    assert curve == pytest.approx(np.full(len(curve), force), rel=1e-9)
    resonance = forced_resonances(draws, [force])
    assert resonance.amplitude.value == pytest.approx([5e-3 * (2 * np.pi * F0) ** POWER[quantity]], rel=1e-9)
    assert resonance.frequency.value == pytest.approx([F0]) and resonance.damping.value == pytest.approx([ZETA])


@pytest.mark.parametrize("quantity", POWER)
def test_the_surface_of_a_linear_mode_is_amplitude_over_frf(quantity):
    f, draws = np.linspace(35.0, 45.0, 5), linear(quantity)
    at = draws.levels[0] * np.array([2.0, 4.0])
    surface = force_surface(draws, f.tolist(), at.tolist())
    assert surface.force.value == pytest.approx(at[:, None] / np.abs(frf(quantity, f)), rel=1e-9)
    assert surface.statement == "All lie between measured levels."


W0, C, HIGHEST = 2 * np.pi * 10, 2 * 0.01 * 2 * np.pi * 10, 0.05


def duffing(hardening, draws=1):
    """w_r^2 = w_0^2 + b x^2 with constant viscous damping: the first harmonic of a Duffing oscillator."""
    b = hardening * 0.3 * W0**2 / HIGHEST**2
    x = np.geomspace(1e-4, HIGHEST, 500)
    w = np.sqrt(W0**2 + b * x**2)
    return b, AmplitudeDraws(
        x,
        np.tile(w / (2 * np.pi), (draws, 1)),
        np.tile(C / (2 * w), (draws, 1)),
        x[[50, 440]],
        MASS * np.ones(draws),
        "displacement",
    )


def folds(b, force):
    """Where the amplitude has a vertical tangent: X [(s + b X)^2 + c^2 w^2] = (F / m)^2 and its derivative by X vanish,
    X = x^2 and s = w_0^2 - w^2 (Nayfeh and Mook 1979, section 4.1)."""

    def misfit(w, sign):
        s = W0**2 - w**2
        x2 = (-2 * s + sign * np.sqrt(s**2 - 3 * C**2 * w**2)) / (3 * b)
        return x2 * ((s + b * x2) ** 2 + C**2 * w**2) - (force / MASS) ** 2

    found = []
    for sign in (-1, 1):
        w = np.linspace(0.85, 1.2, 4001) * W0
        w = w[((W0**2 - w**2) ** 2 > 3 * C**2 * w**2) & ((W0**2 - w**2) * b < 0)]
        value = misfit(w, sign)
        for row in np.flatnonzero((value[:-1] < 0) != (value[1:] < 0)):
            found.append(brentq(misfit, w[row], w[row + 1], args=(sign,)) / (2 * np.pi))
    return sorted(found)


@pytest.mark.parametrize("hardening", [1, -1])
def test_a_duffing_mode_folds_and_jumps_where_it_must(hardening):
    b, draws = duffing(hardening)
    force = MASS * C * W0 * 0.025
    low, high = folds(b, force)
    f = np.linspace(0.93, 1.07, 1401) * W0 / (2 * np.pi)
    response = forced_response(draws, force, f.tolist())
    step = 0.02 * C / (2 * np.pi)  # a fiftieth of the bandwidth: what amplitudes 1 % apart resolve
    (up,), (down,) = (
        np.flatnonzero(np.abs(np.diff(np.log(sweep.value))) > 0.1) for sweep in (response.up, response.down)
    )
    assert response.folded == 1 and "folded-response" in {one.code for one in response.findings}
    # rising, the jump is at the higher fold, falling at the lower one, whichever way the mode leans
    assert f[up] == pytest.approx(high, abs=step) and f[down] == pytest.approx(low, abs=step)
    three = f[response.solutions == 3]
    assert three[0] == pytest.approx(low, abs=step) and three[-1] == pytest.approx(high, abs=step)
    way = np.diff(response.curve_frequencies)
    turns = np.sort(response.curve_frequencies[1:-1][(way[:-1] > 0) != (way[1:] > 0)])
    assert turns == pytest.approx([low, high], rel=2e-4)
    w, x = 2 * np.pi * response.curve_frequencies, response.curve_amplitudes
    assert MASS * x * np.abs(W0**2 + b * x**2 - w**2 + 1j * C * w) == pytest.approx(np.full(len(x), force), rel=1e-3)


def test_a_duffing_mode_resonates_on_its_backbone():
    """c w_r(x) m x = F at phase resonance."""
    b, draws = duffing(1)
    force = MASS * C * W0 * 0.025
    x = brentq(lambda x: MASS * C * np.sqrt(W0**2 + b * x**2) * x - force, 1e-3, HIGHEST)
    found = forced_resonances(draws, [force])
    assert found.amplitude.value == pytest.approx([x], rel=1e-5)
    assert found.frequency.value == pytest.approx([np.sqrt(W0**2 + b * x**2) / (2 * np.pi)], rel=1e-6)


def test_a_force_that_falls_along_the_sweep_is_followed_line_by_line():
    f, draws = np.linspace(38.0, 42.0, 9), linear()
    force = np.linspace(3.0, 1.0, 9)
    response = forced_response(draws, force.tolist(), f.tolist())
    assert response.up.value == pytest.approx(force * np.abs(frf("acceleration", f)), rel=1e-9)
    assert not len(response.curve_frequencies)


def test_draws_are_those_of_the_prediction_and_their_bands_hold_the_truth():
    """A Masing spring that the laws can be (seed 0): bands of a force beyond the highest level hold its resonance."""
    mode, truth = joint(np.geomspace(2.0, 20.0, 9), slip=5.0)
    draws = amplitude_draws(mode)
    kept, direct = predict_from_draws(draws, [10.0, 25.0]), predict_amplitudes(mode, [10.0, 25.0])
    for one, other in ((kept.frequency, direct.frequency), (kept.damping, direct.damping), (kept.force, direct.force)):
        assert np.all(np.abs(one.value - other.value) < 0.3 * other.half_width)
        ratio = one.half_width / other.half_width  # of either 50 or 100 draws beyond an end: 15 % each, and the bridge
        assert np.all((ratio > 0.6) & (ratio < 1.6))
    f, zeta = truth(30.0)
    found = forced_resonances(draws, [float(2 * zeta * 2.0 * 30.0)])
    assert found.amplitude.low[0] <= 30.0 <= found.amplitude.high[0]
    assert found.frequency.low[0] <= f <= found.frequency.high[0]
    assert found.damping.low[0] <= zeta <= found.damping.high[0]
    assert "times the highest amplitude measured (20 m/s^2)" in found.statement


def test_a_force_out_of_reach_names_the_range():
    for force in (1e-4, 1e6):
        with pytest.raises(
            InputError, match=r"no amplitude within the range .* half the lowest level\) to .* twice the"
        ):
            forced_resonances(linear(), [force])


def test_a_band_without_an_end_says_so():
    """Of 40 draws 10 lose so much less that they leave the range at this force."""
    draws = linear(draws=40)
    damping = np.array(draws.damping)
    damping[:10] /= 20
    light = AmplitudeDraws(draws.amplitude, draws.frequency, damping, draws.levels, draws.modal_mass)
    force = 2 * ZETA * MASS * float(draws.amplitude[-1]) / 3
    found = forced_resonances(light, [force])
    assert found.amplitude.high[0] == np.inf and found.damping.low[0] == -np.inf
    assert "band-without-end" in {one.code for one in found.findings}


def test_several_resonances_are_said_and_the_lowest_is_stated():
    """A loss that falls behind gross slip as x^-1.5 and then stays: the force at resonance rises, falls and rises."""
    draws = linear("displacement")
    x = draws.amplitude
    zeta = ZETA * np.where(x < 0.01, 1.0, np.maximum((x / 0.01) ** -1.5, 0.1))
    several = AmplitudeDraws(
        x, draws.frequency, np.tile(zeta, (3, 1)), draws.levels, draws.modal_mass, quantity="displacement"
    )
    force = 2 * ZETA * MASS * (2 * np.pi * F0) ** 2 * 8e-3
    found = forced_resonances(several, [force])
    assert found.amplitude.value == pytest.approx([8e-3], rel=1e-3)
    assert found.several[0] == 1 and "several-resonances" in {one.code for one in found.findings}
    curve = forced_response(several, force).curve_frequencies
    assert np.isnan(curve).sum() == 1  # a curve apart from the one that begins at rest


@pytest.mark.parametrize("force", [0.0, -1.0, np.nan])
def test_what_is_no_force_is_refused(force):
    with pytest.raises(InputError, match="not a force"):
        forced_resonances(linear(), [force])


def test_without_a_modal_mass_it_is_said_what_to_give():
    whole = linear()
    draws = AmplitudeDraws(whole.amplitude, whole.frequency, whole.damping, whole.levels)
    for ask in (force_surface, lambda some: forced_resonances(some, [1.0]), lambda some: forced_response(some, 1.0)):
        with pytest.raises(InputError, match="--modal-mass"):
            ask(draws)


def test_amplitudes_beyond_the_draws_are_refused():
    with pytest.raises(InputError, match="outside the draws that were kept"):
        predict_from_draws(linear(), [1e9])


@pytest.fixture
def written(tmp_path, monkeypatch):
    monkeypatch.setattr(predictive_draws, "COUNT", 200)
    mode, _ = joint(np.geomspace(2.0, 20.0, 9), slip=5.0)
    store.save(tmp_path / "mode.h5", mode)
    return tmp_path / "mode.h5"


def test_the_verb_predicts_a_response_and_answers_again_from_its_file(written, tmp_path):
    done = command("predict", written, "--force", "0.3 N", "--json", "--output", tmp_path / "out")
    assert done.exit_code in (0, 1), done.output
    (told,) = json.loads(done.stdout)["under_force"]["forces"]
    assert told["amplitude"][0] < told["amplitude"][1] < told["amplitude"][2]
    (table,) = (tmp_path / "out").glob("*.csv")
    head, *rows = table.read_text().splitlines()
    assert head.startswith("frequency_Hz,force_N,up_low") and len(rows) == 201
    (first,) = (tmp_path / "out").glob("*.h5")
    loaded = store.load(first)
    assert isinstance(loaded["response_1"], ForcedResponse) and loaded["draws"].name == loaded["mode"].name
    again = command("predict", first, "--force", "0.3 N", "--amplitude", "15 m/s^2", "--json", "-o", tmp_path / "again")
    assert json.loads(again.stdout)["under_force"]["forces"] == [told]
    assert "resonance at" in command("predict", first, "--force", "0.3 N", "-o", tmp_path / "again").stdout


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--force", "0.3"), "unit"),
        (("--force", "0.3 kg"), "force"),
        (("--force", "0.3 m/s^2"), "not a force"),
        (("--force", "1 MN"), "no amplitude within the range"),
        (("--force", "0.3 N", "--modal-mass", "2 m"), "not a mass"),
    ],
)
def test_the_verb_refuses_bad_forces(written, words, said):
    done = command("predict", written, *words)
    assert done.exit_code == 2 and said in done.stderr, done.output


def test_the_verb_takes_the_modal_mass_that_a_ring_down_does_not_tell(tmp_path, monkeypatch):
    monkeypatch.setattr(predictive_draws, "COUNT", 200)
    mode, _ = joint(np.geomspace(2.0, 20.0, 9), slip=5.0)
    bare = AmplitudeDependentMode(mode.amplitude, mode.frequency, mode.damping)
    store.save(tmp_path / "mode.h5", bare)
    done = command("predict", tmp_path / "mode.h5", "--force", "0.3 N")
    assert done.exit_code == 2 and "--modal-mass" in done.stderr
    done = command("predict", tmp_path / "mode.h5", "--force", "0.3 N", "--modal-mass", "2 kg", "-o", tmp_path / "out")
    assert done.exit_code in (0, 1) and "resonance at" in done.stdout


def test_bands_of_a_stored_prediction_keep_their_open_end(tmp_path):
    band = Band(np.array([1.0]), np.array([2.0]), np.array([np.inf]))
    store.save(tmp_path / "band.h5", band)
    assert store.load(tmp_path / "band.h5").high[0] == np.inf


def test_python_of_the_page_runs_as_it_stands(root, capsys, monkeypatch):
    monkeypatch.setattr(predictive_draws, "COUNT", 200)
    mode, _ = joint(np.geomspace(2.0, 20.0, 9), slip=5.0)
    names = executed(root, "prediction.md", 0, mode=mode)
    assert "value" in capsys.readouterr().out and names["response"].force[0] == 0.5
