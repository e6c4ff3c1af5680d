"""Every data type has a picture or says that it has none; what shares no axis is refused."""

from collections.abc import Iterator
from dataclasses import is_dataclass, replace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from ema import compare, data, examples, shapes, show
from ema.data.stability import SteadyStateCurve
from ema.dof import Dof
from ema.errors import InputError
from ema.show import joint_result as joint_result_data
from ema.show.plotting import PICTURES
from ema.store.steady_states import STEADY_STATES
from ema.units import FRF_UNIT

PARTS_AND_TEXTS = (
    "Band BeamModel BoltedJoint Candidate Candidates Channel CoexistingStates ControlLine CuttingLimits Damping Deviations EnergyBalance Excitation "
    "Expectation Finding FloquetMultipliers FrictionBeam FrictionLaw Hit Joint JointForce "
    "LawParameter LevelEffect Matrices "
    "ModalUncertainty ModeQuality NormalContact Place Prediction Provenance Repair Residuals SetUps SignalComparison "
    "SingleMode Statement SteadyState TakeIdentity Trial Trials VarianceComponents Verdict"
)
"""What is drawn as part of something larger, or holds words, settings and single numbers."""


def test_every_data_type_is_drawn_or_known_to_be_a_part_or_a_text() -> None:
    types = {name for name in data.__all__ if is_dataclass(getattr(data, name))} | set(STEADY_STATES)
    drawn = {kind.__name__ for kind in PICTURES if kind.__module__.startswith("ema.data")}
    known = set(PARTS_AND_TEXTS.split())
    assert types == drawn | known
    assert not drawn & known


def made(kind: Any, *values: Any, **fields: Any) -> Any:
    """The data type with lists of numbers as arrays."""

    def array(value: Any) -> Any:
        numbers = np.array(value) if isinstance(value, list) else value
        return numbers.astype(float) if isinstance(value, list) and numbers.dtype.kind == "i" else numbers

    return kind(*map(array, values), **{name: array(value) for name, value in fields.items()})


def things() -> Iterator[Any]:
    model, zero, dof = examples.modal_model(), np.zeros(2), Dof(1, "+X")
    band = made(data.Band, low=[0.009, 0.011], value=[0.010, 0.012], high=[0.011, 0.013])
    frequency = made(data.Band, low=[39.9, 39.7], value=[40.0, 39.8], high=[40.1, 39.9])
    group = compare.repeats([model, model], label="bare")
    placed = examples.placement()
    study = examples.study_result()
    yield made(data.AmplitudeDependentMode, [1.0, 5.0], frequency, band)
    yield made(
        data.AmplitudePrediction,
        [1.0, 5.0],
        frequency,
        band,
        beyond=[0.5, 2.5],
        laws=("masing",),
        weights=[1.0],
        quantity="displacement",
    )
    curves = [[40.0, 39.0], [40.1, 39.2]]
    yield made(data.AmplitudeDraws, [1.0, 5.0], curves, [[0.01, 0.02], [0.011, 0.022]], levels=[1.0, 2.0])
    square = made(data.Band, [[0.9, 1.9]] * 2, [[1.0, 2.0], [2.0, 3.0]], [[2.1, 3.1]] * 2)
    yield made(data.ForceSurface, [39.0, 40.0], [2.0, 3.0], square, beyond=[0.5, 1.1])
    open_above = made(data.Band, [9.0, 9.5], [10.0, 11.0], [11.0, np.inf])
    yield made(data.ForcedResonances, [0.5, 0.6], open_above, frequency, band, beyond=[2.0, 2.1], several=[0.0, 0.0])
    lines = np.array([1, 3])
    yield made(data.ForcedResponse, [39.0, 40.0], [2.0, 2.0], open_above, band, band, band, solutions=lines)
    yield examples.campaign()
    yield examples.campaign()["beam"].condition
    yield examples.campaign()["beam"]
    yield compare.difference(group, group)
    yield group
    yield made(data.ContactPressure, ("a",), ((1, 1),), [100.0], [100.0], [1e-4], [-5.0], [120.0], [0.1], [0.2], [1e-6])
    yield examples.decay()
    yield examples.forecast()
    forecast = examples.forecast()
    yield data.ForecastCheck(forecast, forecast.frequency, forecast.damping, maps=("mode 1",))
    yield examples.frf_set()
    yield examples.geometry()
    yield made(
        data.HarmonicResponse,
        frequencies=[39.0, 40.0],
        orders=np.array([1, 3]),
        values=[[[1e-4 + 0j, 1e-6]], [[1e-3, 2e-6]]],
        dofs=(dof,),
        slips=np.zeros((2, 0, 2), complex),
        force=1.0,
        driven=dof,
        input_power=[0.01, 0.12],
        friction_power=[0.0, 0.07],
        damping_power=[0.01, 0.05],
        error_estimate=[1e-6, 1e-6],
        converged=np.array([True, True]),
    )
    hit = made(
        data.Hit, "impact", 0, None, 0.25, 100.0, 0.25, 0.004, True, "", pulse=[0.0, 100.0, 0.0], sampling_rate=1024.0
    )
    yield made(data.HitGallery, (hit,), [0.0, 100.0], [1.0, 0.5], usable_band=(300.0, 400.0))
    yield joint_result_data.example()
    angle = np.linspace(0, 2 * np.pi, 50)
    yield data.Loop(1e-6 * np.cos(angle), 5 * np.cos(angle - 0.3), area=4.6e-6, amplitude=1e-6)
    yield compare.maps(examples.modal_map(), examples.modal_map())
    yield made(data.MapPrediction, [2.0], [500.0], [[39.5]], [[39.0]], [[40.0]], [[0.02]], [[0.01]], [[0.03]])
    yield made(data.MapResult, "mode 1", examples.modal_map(), np.zeros((0, 3)), [], [], dropout=np.ones((2, 3)))
    yield examples.modal_map()
    yield model
    yield compare.modes(model, model)
    yield made(
        data.ModelUpdate,
        examples.beam_model(),
        ("mu", "k"),
        [0.45, 1e6],
        [[0.4, 0.5], [1e3, 1e9]],
        (True, False),
        np.eye(2),
        1.01,
        1.1,
    )
    yield made(
        data.NonlinearMode, [1e-5, 1e-3], [40.0, 39.0], [0.01, 0.02], [[0.7 + 0j, 0.7]], (dof,), zero, zero, zero, zero
    )
    yield placed
    yield study.runs[0].poles
    yield placed.ranking
    yield examples.recording()
    yield SteadyStateCurve(
        frequencies=np.array([40.0, 41.0, 40.5]),
        values=np.array([[1e-4], [2e-4], [3e-4]], complex),
        dofs=(dof,),
        force=1.0,
        largest=np.array([0.9, 1.0, 1.1]),
        verdicts=("stable", "undecided", "unstable"),
        losses=("", "", "fold"),
        error_estimate=np.full(3, 4e-3),
        harmonics=np.array([5, 7, 7]),
    )
    yield made(
        data.Response,
        times=[0.0, 0.1],
        displacements=[[1e-3, 5e-4]],
        velocities=[zero],
        dofs=(dof,),
        slips=np.zeros((0, 2)),
        forces=np.zeros((0, 2)),
        dissipated=[],
        slip_time=[],
        energy=made(data.EnergyBalance, [1.0, 0.9], zero, zero, zero, zero, zero),
    )
    yield study.runs[0]
    yield made(
        data.SetUpShifts,
        names=("A", "B"),
        frequencies=[40.0],
        shifts=[[1e-3], [-1e-3]],
        std=[[1e-4], [1e-4]],
        common=[1e-3, -1e-3],
        common_std=[1e-4, 1e-4],
        cause="common shift",
        mass=np.nan,
        mass_std=np.nan,
        unloaded=[np.nan],
        unloaded_std=[np.nan],
    )
    yield made(data.SteppedLevel, [39.0, 40.0], [1, 1], [5 + 1j, 9j], quantity="acceleration")
    yield study
    yield shapes.compare(model, model)


def test_every_picture_is_drawn_and_has_ink(tmp_path: Any) -> None:
    from PIL import Image

    seen = set()
    for number, thing in enumerate(things()):
        figure = show.plot(thing)
        assert isinstance(figure, Figure)
        path = tmp_path / f"{number}.png"
        figure.savefig(path, dpi=40)
        assert np.asarray(Image.open(path).convert("L")).std() > 5, type(thing)
        seen |= {kind for kind in PICTURES if isinstance(thing, kind)}
    missed = {kind.__name__ for kind in PICTURES} - {kind.__name__ for kind in seen} - {"ControlStudy"}
    assert not missed  # a control study needs a simulation; its picture has a test of its own


def test_options_reach_the_picture_and_unknown_ones_are_named() -> None:
    model = examples.modal_model()
    assert len(show.plot(model, modes=[1]).axes) == 1
    assert show.plot(model, geometry=examples.geometry(), modes=[0]).axes[0].get_title(loc="left").startswith("1: 40")
    with pytest.raises(InputError, match="takes no such option; got colour"):
        show.plot(examples.modal_map(), colour="red")


@pytest.mark.parametrize("thing", [3, "frf.uff", None, np.zeros(3), [1, 2]])
def test_what_is_no_data_type_is_refused_in_a_sentence(thing: Any) -> None:
    with pytest.raises(InputError, match="no picture of"):
        show.plot(thing)


def test_a_wrong_argument_is_refused_in_our_words() -> None:
    with pytest.raises(InputError, match=r"ema\.show\.frf_overview, frfs: .* got a ModalModel, expected FrfSet"):
        show.frf_overview(examples.modal_model())  # type: ignore[arg-type]
    with pytest.raises(InputError, match="expected Forecast or ForecastCheck"):
        show.forecast_bands("forecast.h5")  # type: ignore[arg-type]
    with pytest.raises(
        InputError, match=r"ema\.show\.shapes_over_dofs, modes: .* got 1 \(int\), expected a sequence of"
    ):
        show.plot(examples.modal_model(), modes=1)


def test_two_quantities_share_no_axis() -> None:
    accelerance = examples.frf_set()
    line = 2j * np.pi * accelerance.frequencies[:, None, None]
    mobility = replace(accelerance, values=accelerance.values / line, quantity="mobility", unit=FRF_UNIT["mobility"])
    with pytest.raises(InputError, match="different quantities share no axis"):
        show.frf_overlay([accelerance, mobility], [(0, 0), (0, 0)], ["a", "b"])
    with pytest.raises(InputError, match="different quantities share no axis"):
        show.reconstruction(accelerance, mobility, [(0, 0)])
    unscaled = replace(accelerance, unit="unstated")
    with pytest.raises(InputError, match="accelerance"):
        show.frf_overlay([accelerance, unscaled], [(0, 0), (0, 0)], ["a", "b"])
    level = made(data.SteppedLevel, [39.0, 40.0], [1, 1], [5 + 1j, 9j], quantity="acceleration")
    with pytest.raises(InputError, match="acceleration and velocity"):
        show.plot([level, replace(level, quantity="velocity")])
