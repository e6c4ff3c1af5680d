"""Tables of pandas: names, units and values, from numbers that can be read off the arrays."""

import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ema import data, examples
from ema.dof import Dof
from ema.errors import InputError
from ema.interop import to_dataframe
from tests.containers import one_of_each

WITHOUT_TABLE = {
    *("Dof", "AmplitudeDraws", "Band", "BeamModel", "BoltedJoint", "Candidate", "Candidates", "Channel", "Condition"),
    *("ContactPressure", "ControlLine", "CuttingLimits", "Damping", "Deviations", "EnergyBalance", "Excitation"),
    *(
        "Expectation",
        "Finding",
        "FloquetMultipliers",
        "FrictionBeam",
        "FrictionLaw",
        "Hit",
        "HitGallery",
        "Joint",
        "JointForce",
    ),
    *("LawParameter", "LevelEffect", "Matrices", "ModalUncertainty", "ModeQuality", "NormalContact", "Place"),
    *("Prediction", "Provenance", "Repair", "Residuals", "Run", "SetUpShifts", "SetUps", "SignalComparison"),
    *("SingleMode", "Statement", "SteadyState", "TakeIdentity", "Trial", "VarianceComponents", "Verdict"),
}
"""Parts of other containers, and those that are no table."""


def test_every_container_has_a_table_with_units_or_says_that_it_has_none() -> None:
    containers = one_of_each()
    assert set(containers) > WITHOUT_TABLE
    for name, container in containers.items():
        if name in WITHOUT_TABLE:
            with pytest.raises(InputError, match=f"no table of such an object; got {name}, expected FRFs"):
                to_dataframe(container)
            continue
        table = to_dataframe(container)
        named = {str(column): str(column).rsplit("[")[-1][:-1] for column in table.columns if str(column)[-1] == "]"}
        assert len(table) and table.columns.is_unique, name
        assert named.items() <= table.attrs["units"].items(), name


def test_a_map_is_a_row_per_condition_with_its_holes() -> None:
    measured = replace(
        examples.modal_map(),
        frequency=np.array([[40.6, np.nan, 41.2], [40.2, 40.7, 41.0]]),
        joint_forces=np.arange(12.0).reshape(2, 3, 2),
        joints=("left", "right"),
    )
    table = to_dataframe(measured)
    assert table["F_E [N]"].tolist() == [5, 5, 5, 20, 20, 20]
    assert table["F_N [N]"].tolist() == [200, 500, 1000] * 2
    assert table["f [Hz]"].tolist() == pytest.approx([40.6, np.nan, 41.2, 40.2, 40.7, 41.0], nan_ok=True)
    assert table["zeta [%]"].tolist() == pytest.approx([1.2, 1.6, 0.9, 1.8, 2.4, 1.3])
    assert table["std zeta [%]"].tolist() == pytest.approx([0.05] * 6)
    assert table["F_N right [N]"].tolist() == [1, 3, 5, 7, 9, 11]
    assert "misfit" not in table  # the map has none
    assert table.attrs["units"]["F_N left [N]"] == "N"


def test_intervals_are_a_lower_and_an_upper_column() -> None:
    frequency = data.Band(*np.array([[39.9, 39.7], [40.0, 39.8], [40.1, 39.9]]))
    damping = data.Band(*np.array([[0.009, 0.011], [0.010, 0.012], [0.011, 0.013]]))
    mode = data.AmplitudeDependentMode(np.array([1.0, 5.0]), frequency, damping, quantity="velocity")
    table = to_dataframe(mode)
    assert table["amplitude [m/s]"].tolist() == [1, 5]
    assert table["f low [Hz]"].tolist() == [39.9, 39.7] and table["f high [Hz]"].tolist() == [40.1, 39.9]
    assert table["zeta low [%]"].tolist() == pytest.approx([0.9, 1.1])
    assert table["zeta high [%]"].tolist() == pytest.approx([1.1, 1.3])
    times, reach = np.array([0.0, 1.0]), np.array([0.002, 0.001])
    decay = data.Decay(times, 2 - times, 40 + times, 10 * reach, damping_reach=reach)
    table = to_dataframe(decay)
    assert table["zeta low [%]"].tolist() == pytest.approx([1.8, 0.9])
    assert table["zeta high [%]"].tolist() == pytest.approx([2.2, 1.1])
    assert "f low [Hz]" not in table and table["f [Hz]"].tolist() == [40, 41]


def test_a_force_surface_is_a_row_per_amplitude_and_frequency() -> None:
    force = np.array([[1.0, 2.0, 3.0], [4.0, np.nan, 6.0]])
    band = data.Band(0.9 * force, force, 1.1 * force)
    surface = data.ForceSurface(np.arange(39.0, 42.0), np.array([0.5, 1.0]), band, beyond=np.array([1.0, 2.0]))
    table = to_dataframe(surface)
    assert table["amplitude [m/s^2]"].tolist() == [0.5, 0.5, 0.5, 1, 1, 1]
    assert table["frequency [Hz]"].tolist() == [39, 40, 41] * 2
    assert table["force high [N]"].tolist() == pytest.approx([1.1, 2.2, 3.3, 4.4, np.nan, 6.6], nan_ok=True)
    assert table["amplitude / highest measured"].tolist() == [1, 1, 1, 2, 2, 2]


def test_frfs_stay_complex_under_readable_dofs() -> None:
    frfs = examples.frf_set()
    table = to_dataframe(frfs)
    assert table.index.name == "frequency [Hz]" and table.attrs["units"]["frequency [Hz]"] == "Hz"
    assert np.array_equal(table["3:+Z/2:+Z"], frfs.values[:, 2, 1]) and table["3:+Z/2:+Z"].dtype == complex
    assert table.attrs["units"]["3:+Z/2:+Z"] == "(m/s^2)/N"
    assert list(to_dataframe(replace(frfs, unit="unstated")).attrs["units"]) == ["frequency [Hz]"]


def test_motions_have_a_column_per_dof_with_its_unit() -> None:
    zero = np.zeros(2)
    motion = data.Response(
        times=np.array([0.0, 0.1]),
        displacements=np.array([[1.0, 0.5], [0.2, 0.1]]),
        velocities=np.array([[0.0, -3.0], [0.0, -1.0]]),
        dofs=(Dof(1, "+X"), Dof(1, "-RY")),
        slips=np.zeros((0, 2)),
        forces=np.zeros((0, 2)),
        dissipated=np.zeros(0),
        slip_time=np.zeros(0),
        energy=data.EnergyBalance(np.ones(2), zero, zero, zero, zero, zero),
    )
    table = to_dataframe(motion)
    assert list(table) == ["time [s]", "1:+X [m]", "1:-RY [rad]", "1:+X [m/s]", "1:-RY [rad/s]"]
    assert table["1:-RY [rad/s]"].tolist() == [0, -1]


def test_a_forecast_and_its_check_keep_the_order_of_their_conditions() -> None:
    forecast = examples.forecast()
    measured = np.arange(6.0).reshape(1, 2, 3)
    table = to_dataframe(data.ForecastCheck(forecast, 100 + measured, measured))
    levels, forces = forecast.force_levels.tolist(), forecast.normal_forces.tolist()
    for _, row in table.iterrows():
        at = 3 * levels.index(row["F_E [N]"]) + forces.index(row["F_N [N]"])
        assert (row["f measured [Hz]"], row["zeta measured [%]"]) == (100 + at, 100 * at)
    assert table.attrs["units"]["f low [Hz]"] == "Hz"


def test_modes_of_a_study_are_listed_by_run() -> None:
    runs = [data.RunResult(run, examples.frf_set(), None, examples.modal_model()) for run in examples.campaign().runs]
    study = data.StudyResult(examples.campaign(), runs=tuple(runs))
    table = to_dataframe(study)
    assert table.index.names == ["run", "mode"] and len(table) == 3 * len(runs)
    assert table.loc[("beam", 2), "f [Hz]"] == pytest.approx(60)
    assert to_dataframe(replace(study, runs=())).shape == (0, 2)


@pytest.mark.parametrize("other", [1.0, "modes.h5", None, data.ModalMap, SimpleNamespace(table=lambda: None)])
def test_what_is_none_of_ours_is_refused(other: Any) -> None:
    with pytest.raises(InputError, match="no table of such an object"):
        to_dataframe(other)


def test_pandas_is_imported_when_a_table_is_made() -> None:
    code = "import sys, ema.interop; ema.interop.to_dataframe; print('pandas' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "False"
