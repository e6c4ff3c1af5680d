"""Pictures of simulated and measured vibration with friction: what is drawn, with which numbers, and empty cases."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from ema import show
from ema.data import Decay, HarmonicResponse
from ema.dof import Dof
from ema.elements import Section
from ema.simulate import Masing, double_beam, loop, snapback


@pytest.fixture(scope="module")
def released():
    return snapback(
        double_beam(Masing(0.3, 1e9), 400.0, Section(0.5, 0.04, 0.005, elements=4)), 20.0, "beam 2:4:+Z", 0.1
    )


def decay(knee: float = float("nan")) -> Decay:
    t = np.linspace(0, 1, 200)
    return Decay(t, np.exp(-3 * t), np.full(200, 20.0), np.full(200, 0.02), knee)


def steady() -> HarmonicResponse:
    lines = np.linspace(10, 20, 11)
    values = np.zeros((11, 1, 2), complex)
    values[:, 0, 0], values[:, 0, 1] = 2e-3, 1e-4
    dof = Dof(4, "+Z")
    power = np.ones(11)
    return HarmonicResponse(
        lines, np.array([1, 3]), values, (dof,), values, 2.0, dof, power, power, 0 * power, 0 * power, power > 0
    )


def drawn(figure: Figure) -> Figure:
    figure.canvas.draw()
    return figure


def test_motion_in_a_unit_that_reads_well(released):
    upper, lower = drawn(show.motion([released, released], ["one", "two"])).axes
    assert "[mm]" in upper.get_ylabel() and len(upper.lines) == 2
    assert upper.lines[0].get_ydata()[0] == pytest.approx(1e3 * released.displacements[0, 0])
    assert lower.lines[0].get_ydata()[0] == pytest.approx(100.0)
    assert [text.get_text() for text in upper.get_legend().get_texts()] == ["one", "two"]


def test_loops_of_contacts_and_their_energy(released):
    loops, shares = drawn(show.contact_loops(released)).axes
    assert len(loops.lines) == 4
    heights = sorted(bar.get_height() for bar in shares.patches)
    assert heights == pytest.approx(sorted(released.dissipated))


def test_steady_states_per_newton_with_harmonics():
    upper, lower = drawn(show.steady_states(steady())).axes
    assert upper.lines[0].get_ydata() == pytest.approx(1.0)
    assert lower.lines[0].get_ydata() == pytest.approx(5.0)
    assert "[mm/N]" in upper.get_ylabel()


def test_hysteresis_names_the_energy_per_cycle():
    (axes,) = drawn(show.hysteresis(loop(Masing(0.3, 1e9), 1000.0, 3e-6), ["3 µm"])).axes
    assert axes.get_legend().get_texts()[0].get_text() == "3 µm: 3.24 mJ"
    assert "[µm]" in axes.get_xlabel()


@pytest.mark.parametrize("knee", [float("nan"), 0.5])
def test_ring_down_over_amplitude(knee):
    first, second, third = drawn(show.ring_down(decay(knee))).axes
    assert len(first.lines) == (1 if np.isnan(knee) else 2)
    shown = np.flatnonzero(np.isfinite(second.lines[0].get_ydata()))
    assert len(shown) == 200 - (0 if np.isnan(knee) else np.sum(np.abs(decay().times - 0.5) <= 0.05))
    assert third.lines[0].get_ydata()[shown] == pytest.approx(2.0)
    assert first.get_ylabel() == third.get_xlabel() == "Amplitude"
    first, _, third = drawn(show.ring_down(decay(knee), unit="m")).axes
    assert first.get_ylabel() == third.get_xlabel() == "Amplitude [m]"


def test_beats_are_not_drawn_as_functions_of_the_amplitude():
    held = decay()
    beating = Decay(
        held.times, held.amplitudes * (1 + 0.5 * np.sin(60 * held.times)), held.frequencies, held.damping_ratios
    )
    (_, second, _) = drawn(show.ring_down(beating)).axes
    shown = second.lines[0].get_xdata()[np.isfinite(second.lines[0].get_ydata())]
    assert len(shown) < 150 and np.all(np.diff(shown) <= 0)


def test_nothing_is_said_to_be_nothing():
    for draw in (show.motion, show.steady_states, show.hysteresis, show.ring_down):
        (axes,) = drawn(draw([])).axes
        assert axes.texts[0].get_text().startswith("no ")
