"""Pictures of free vibration: what they hold, legible size, bad input."""

from dataclasses import replace

import numpy as np
import pytest

from ema import show
from ema.elements import Section
from ema.errors import InputError
from ema.show.vibration import amplitude_spectrum
from ema.simulate import Masing, double_beam, snapback

TIP = "beam 2:4:+Z"


@pytest.fixture(scope="module")
def runs():
    return [
        snapback(double_beam(Masing(0.3, 1e9), f, Section(0.5, 0.04, 0.005, elements=4)), 20.0, TIP, 0.1)
        for f in (1000.0, 8000.0)
    ]


def test_free_vibration_shows_motion_energy_and_loops(runs):
    figure = show.free_vibration(runs, ["1 kN", "8 kN"])
    assert len(figure.axes) == 2 + 2 * 3
    np.testing.assert_allclose(figure.axes[0].lines[1].get_ydata(), 1e3 * runs[1].displacements[0])
    np.testing.assert_allclose(figure.axes[4].lines[0].get_ydata(), runs[0].forces[-1])
    assert len(show.free_vibration(runs[:1], ["1 kN"], dof=TIP, contacts=[2]).axes) == 3
    figure.savefig("/dev/null", format="png", dpi=40)


def test_velocity_comparison_and_spectrum(runs):
    figure = show.velocity_comparison(*runs, band=(10, 300))
    assert [len(axes.lines) for axes in figure.axes] == [2, 2, 2]
    t = np.arange(0, 2, 1e-3)
    frequencies, level = amplitude_spectrum(t, 3 * np.sin(2 * np.pi * 50 * t))
    assert level.max() == pytest.approx(3, rel=1e-3)
    assert frequencies[np.argmax(level)] == pytest.approx(50)


def test_bad_input_gets_a_sentence(runs):
    with pytest.raises(InputError, match="nothing to draw"):
        show.free_vibration([], [])
    with pytest.raises(InputError, match="no such contact"):
        show.free_vibration(runs, ["a", "b"], contacts=[4])
    with pytest.raises(InputError, match="no such DOF"):
        show.free_vibration(runs, ["a", "b"], dof="7:+Z")
    with pytest.raises(InputError, match="no such DOF"):
        show.velocity_comparison(runs[0], replace(runs[1], dofs=(runs[1].dofs[0].reversed(),)), (1, 2), dof="9:+X")
