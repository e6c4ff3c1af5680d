"""The mode's own resonance, against the eigenvalues of the structure with its joints stuck and with them free."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag

from ema import compare, place, shapes, simulate
from ema.data import FrictionLaw, ModalMap
from ema.data.placement import BoltedJoint, Candidates, FrictionBeam
from ema.errors import InputError
from ema.place import shortlist
from ema.place.predictor import beam_matrices
from ema.place.task import predicted
from tests.unit.placement_rig import bare_table

BEAM = FrictionBeam(0.3, 0.06, 0.05, overhang=0.02)
JOINT = BoltedJoint(FrictionLaw("masing", 0.2, 2e8), 1e9, 0.045)
rng = np.random.default_rng(20261122)
SPOTS = Candidates(
    np.column_stack([rng.uniform(0.2, 0.7, 4), rng.uniform(0.17, 0.33, 4)]), rng.uniform(0, np.pi, 4),
    np.zeros(4, int), (BEAM,),
)  # fmt: skip


@pytest.fixture(scope="module")
def task() -> place.Task:
    """The work table whose modes have damping ratios of their own, as measured ones have."""
    bare, geometry = bare_table()
    omega, ratios = np.abs(bare.poles), np.random.default_rng(3).uniform(0.003, 0.012, len(bare.poles))
    bare = replace(bare, poles=omega * (-ratios + 1j * np.sqrt(1 - ratios**2)))
    return place.Task(bare, shapes.smooth(bare, geometry), JOINT, "91:+Z", np.array([1.0]), np.array([1e4]), (0,))


def eigenvalue(task: place.Task, spot: int, contact_stiffness: float, near: float) -> tuple[float, float]:
    """Natural frequency in Hz and damping ratio of host and beam on springs, assembled here: the mode nearest."""
    surface, angle, points = task.surface, float(SPOTS.angles[spot]), SPOTS.joints(spot)
    host = np.abs(task.bare.poles)
    mass, stiffness, tangential, normal = beam_matrices(BEAM)
    slope, deflection = surface.values(points, 1, angle), surface.values(points)
    across = np.hstack([-deflection, normal])
    along = np.hstack([JOINT.surface_height * slope, tangential])
    m = block_diag(np.eye(len(host)), mass)
    k = block_diag(np.diag(host**2), stiffness) + JOINT.normal_stiffness * across.T @ across
    k += contact_stiffness * along.T @ along
    c = block_diag(np.diag(-2 * task.bare.poles.real), 0 * mass)
    inverse = np.linalg.inv(m)
    whole = np.block([[np.zeros_like(m), np.eye(len(m))], [-inverse @ k, -inverse @ c]])
    poles = np.linalg.eigvals(whole)
    pole = poles[np.argmin(np.abs(poles.imag / (2 * np.pi) - near))]
    return float(np.abs(pole) / (2 * np.pi)), float(-pole.real / np.abs(pole))


@pytest.mark.parametrize("mode", [0, 2])
@pytest.mark.parametrize("spot", range(len(SPOTS)))
@pytest.mark.parametrize(("normal_force", "stiffness"), [(1e5, 2e8), (1e-4, 0.0)], ids=["sticking", "sliding"])
def test_a_linear_limit_has_the_frequency_of_the_eigenvalue(task, mode, spot, normal_force, stiffness):
    """Not that of the largest response at the driver, which the other modes move by up to tenths of a hertz."""
    bare = float(task.bare.natural_frequencies[mode])
    model = place.model_at(task.bare, task.surface, SPOTS, spot, JOINT, normal_force)
    chart = simulate.damping_map(model, [1.0], [normal_force], "91:+Z", None, (0.93 * bare, 1.07 * bare))
    frequency, ratio = eigenvalue(task, spot, stiffness, float(chart.frequency[0, 0]))
    assert chart.frequency[0, 0] == pytest.approx(frequency, rel=1e-5)
    assert chart.damping[0, 0] == pytest.approx(ratio, rel=2e-3)


def test_the_modal_balance_of_power_holds_where_the_joint_slides(task):
    """zeta = P/(w^3 q^2) with P the mean power of the force on the mode alone; other modes supply a few per cent."""
    model = place.model_at(task.bare, task.surface, SPOTS, 0, JOINT, 60.0)
    bare = float(task.bare.natural_frequencies[0])
    band = (0.95 * bare, 1.06 * bare)
    own, peak = (simulate.damping_map(model, [30.0], [60.0], "91:+Z", seen, band) for seen in (None, "91:+Z"))
    assert own.damping[0, 0] == pytest.approx(peak.damping[0, 0], rel=0.05)
    assert own.frequency[0, 0] == pytest.approx(peak.frequency[0, 0], rel=1e-3)


def test_the_forecast_of_the_energy_balance_is_that_of_the_mode(task):
    sticking = task._replace(normal_forces=np.array([1e5]))
    question = shortlist.question(sticking, predicted(sticking, SPOTS), 1)
    found = shortlist.answer(question)[0, :, 0, 0]
    frequency, ratio = eigenvalue(task, 1, 2e8, found[0])
    assert found[0] == pytest.approx(frequency, rel=1e-5) and found[1] == pytest.approx(ratio, rel=2e-3)


def test_a_fitted_forecast_is_that_of_the_output(task):
    """What a fit of the response of the output reads, measured on the same model: here 0.26 Hz from the driver's."""
    here = task._replace(
        modes=(2,), force_levels=np.array([30.0]), normal_forces=np.array([60.0]), output="92:+Z"
    )  # fmt: skip
    question = shortlist.question(here, predicted(here, SPOTS), 1, fitted=True)
    found = shortlist.answer(question)[0, :2, 0, 0]
    model = place.model_at(task.bare, task.surface, SPOTS, 1, JOINT, 60.0)
    wanted = ModalMap(np.array([30.0]), np.array([60.0]), np.full((1, 1), found[0]), np.full((1, 1), 0.01),
                      method="measured")  # fmt: skip
    driver, output = (compare.measure(model, wanted, "91:+Z", seen, tolerance=1e-3) for seen in ("91:+Z", "92:+Z"))
    assert abs(output.frequency[0, 0] - driver.frequency[0, 0]) > 0.2
    assert found[0] == pytest.approx(output.frequency[0, 0], abs=0.03)
    assert found[1] == pytest.approx(output.damping[0, 0], rel=0.01)


def test_an_output_that_was_not_measured_is_refused(task):
    here = task._replace(output="4711:+Z")
    with pytest.raises(InputError, match="not measured"):
        predicted(here, SPOTS)
