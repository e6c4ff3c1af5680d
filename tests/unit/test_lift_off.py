"""What a patch that can press but not pull keeps of its normal springs: against one period of its pieces in time."""

import numpy as np
import pytest
from scipy.optimize import brentq

from ema.data import FrictionLaw
from ema.data.placement import BoltedJoint, Candidates, FrictionBeam
from ema.dof import Dof
from ema.place import Task
from ema.place.describing import secant_table
from ema.place.fundamental import _peak, _structure
from ema.place.lift_off import Patches, softened
from ema.place.model import model_at
from ema.shapes import smooth, with_rigid_body
from tests.bench.blind_hosts.truth import run
from tests.unit.placement_rig import bare_table

STIFFNESS, PRESSED, LENGTH = np.array([4e8, 7e8]), np.array([120.0, 60.0]), np.array([0.016, 0.022])
FLEXIBILITY = np.concatenate([1 / STIFFNESS, 12 / (STIFFNESS * LENGTH**2)]).astype(complex)


def in_time(joint: int, exponent: float, gap: complex, turn: complex) -> tuple[float, float]:
    """Stiffness of gap and rocking left over a period: work against the motion over that of springs that also pull.

    A thousand pieces that hold k w up to their share of F_N; the mean opening is that at which F_N is carried.
    """
    cosines = np.exp(2j * np.pi * np.arange(720) / 720)
    along = LENGTH[joint] * ((np.arange(1000) + 0.5) / 1000 - 0.5)
    pressure = (1 - (2 * along / LENGTH[joint]) ** 2) ** exponent
    limit = (PRESSED[joint] * pressure / pressure.sum())[:, None]
    moved = np.real((gap + along[:, None] * turn) * cosines)

    def carried(opened: float) -> np.ndarray:
        return np.minimum(STIFFNESS[joint] / 1000 * (opened + moved), limit)

    opened = brentq(lambda value: carried(value).mean(), -1e-6, 1e-3, xtol=1e-14)
    first = 2 * np.mean(carried(opened) * cosines.conj(), axis=1)
    of_springs = STIFFNESS[joint] / 1000 * (gap + along * turn)
    in_phase = np.real(first * of_springs.conj()) / np.abs(of_springs) ** 2
    return float(in_phase.mean()), float(np.sum(in_phase * along**2) / np.sum(along**2))


@pytest.mark.parametrize("exponent", [0.0, 0.5, 2.0])
@pytest.mark.parametrize("size", [0.1, 0.6, 0.95, 2.0])
def test_what_is_left_of_the_springs_is_that_of_a_period_in_time(exponent: float, size: float) -> None:
    gap = size * PRESSED / STIFFNESS * np.exp([0.3j, -1.1j])
    turn = 1.5 * gap / LENGTH * np.exp([0.8j, 2.0j])
    left = FLEXIBILITY / softened(Patches(PRESSED, LENGTH, exponent), FLEXIBILITY, np.concatenate([gap, turn]))
    for joint in range(2):
        expected = in_time(joint, exponent, gap[joint], turn[joint])
        assert left[[joint, 2 + joint]].real == pytest.approx(expected, abs=0.01)


def test_a_patch_whose_pressure_is_nowhere_undone_keeps_its_springs() -> None:
    gap = 0.4 * PRESSED / STIFFNESS
    found = softened(Patches(PRESSED, LENGTH, 0.0), FLEXIBILITY, np.concatenate([gap, gap / LENGTH]).astype(complex))
    np.testing.assert_allclose(found, FLEXIBILITY, rtol=1e-12)


@pytest.fixture(scope="module")
def sliding() -> tuple[np.ndarray, ...]:
    """A table with a beam that slides on two patches without friction: both in modes of their own, up to 12 kHz."""
    bare, geometry = bare_table(0.0)
    bare, _ = with_rigid_body(bare, geometry, 130.0)
    beam = FrictionBeam(0.3, 0.06, 0.05, overhang=0.02)
    spot = Candidates(np.array([[0.3, 0.06]]), np.zeros(1), np.zeros(1, int), (beam,))
    joint = BoltedJoint(FrictionLaw("masing", 1e-9, 1e3), 2e7, 0.045, contact_length=0.016)
    task = Task(bare, smooth(bare, geometry), joint, "91:+Z", np.array([30.0]), np.array([60.0]), (0,))
    structure = _structure(model_at(task, spot, 0, 60.0), Dof.parse("91:+Z"), Dof.parse("91:+Z"))
    keep = structure[0] < (2 * np.pi * 12e3) ** 2
    return tuple(one[..., keep] if one.shape[-1:] == keep.shape else one for one in structure)


def in_steps_down(
    structure: tuple[np.ndarray, ...], level: float, frequencies: np.ndarray, lifts: bool, afresh: bool = False
) -> np.ndarray:
    """Heights of the steady motion of the driven point in time, each from that of the frequency before or ``afresh``."""
    squares, decay, _, slips, ends, springs, flexibility, _ = structure
    sliders = np.zeros((5, 2, 60))
    for joint in range(2):
        sliders[0, joint] = 0.016 * ((np.arange(60) + 0.5) / 60 - 0.5)
        sliders[2, joint] = 1 / flexibility[joint].real / 60
        pressure = 0.25 - (sliders[0, joint] / 0.016) ** 2
        sliders[3, joint] = 60.0 * pressure / pressure.sum()
    rows = np.vstack([[slips[n], springs[n], springs[2 + n]] for n in range(2)])
    heights, settings = [], np.array([float(lifts), 0.0, 1.0, 1.0])
    q, v, slid, phase = np.zeros(len(squares)), np.zeros(len(squares)), np.zeros((2, 60)), 0.0
    for frequency in frequencies:
        if afresh:
            q, v, slid, phase = np.zeros(len(squares)), np.zeros(len(squares)), np.zeros((2, 60)), 0.0
        for periods in (400, 10):
            phasors, _, phase = run(
                q, v, slid, squares, decay, rows, ends[0], sliders, settings, phase % (2 * np.pi), level,
                2 * np.pi * frequency, 2e-6, round(periods / frequency / 2e-6),
            )  # fmt: skip
        heights.append(abs(ends[0] @ phasors))
    return np.array(heights)


def peak_in_time(structure: tuple[np.ndarray, ...], level: float, near: float, lifts: bool) -> float:
    """Frequency of the largest steady motion of the driven point, in time, by a parabola through five sines."""
    frequencies = near * (1 + 0.0007 * np.arange(-2, 3))
    heights = in_steps_down(structure, level, frequencies, lifts, afresh=True)
    bend, slope, _ = np.polyfit(frequencies - near, heights**-2.0, 2)
    return float(near - slope / (2 * bend))


def test_the_peak_of_a_resonance_that_folds_is_where_a_sweep_downwards_finds_it(
    sliding: tuple[np.ndarray, ...],
) -> None:
    """At twice the level of the test below the flank is steep, and the way to the motion of the peak long."""
    none = (np.zeros(2), np.full(2, 1e-12), 0.0, secant_table("masing", ()), np.full(2, 60.0))
    patch = Patches(np.full(2, 60.0), np.full(2, 0.016), 1.0)
    (frequency, _, opening, _), _ = _peak(0, (400.0, 530.0), 6.0, sliding, none, patch)
    assert opening < 1
    frequencies = 475.5 - 0.2 * np.arange(9)
    heights = in_steps_down(sliding, 6.0, frequencies, True)
    assert 0 < heights.argmax() < 8
    assert frequencies[heights.argmax()] == pytest.approx(frequency, abs=0.2)


def test_a_motion_that_does_not_settle_is_no_resonance(sliding: tuple[np.ndarray, ...]) -> None:
    """From 7.5 N on the way leads from one motion to another and back: a fold without a peak in between."""
    none = (np.zeros(2), np.full(2, 1e-12), 0.0, secant_table("masing", ()), np.full(2, 60.0))
    patch = Patches(np.full(2, 60.0), np.full(2, 0.016), 1.0)
    (frequency, damping, _, _), _ = _peak(0, (400.0, 530.0), 7.5, sliding, none, patch)
    assert np.isnan(frequency) and np.isnan(damping)


def test_a_structure_whose_patches_lift_off_at_their_edges_has_the_peak_that_it_has_in_time(
    sliding: tuple[np.ndarray, ...],
) -> None:
    none = (np.zeros(2), np.full(2, 1e-12), 0.0, secant_table("masing", ()), np.full(2, 60.0))
    band, level = (450.0, 530.0), 3.0
    patch = Patches(np.full(2, 60.0), np.full(2, 0.016), 1.0)
    (linear, _, opening, _), _ = _peak(0, band, level, sliding, none, None)
    (lifted, _, again, _), _ = _peak(0, band, level, sliding, none, patch)
    assert again == opening < 1
    assert peak_in_time(sliding, level, linear, False) == pytest.approx(linear, rel=1e-4)
    assert peak_in_time(sliding, level, lifted, True) == pytest.approx(lifted, abs=0.2 * (linear - lifted))
