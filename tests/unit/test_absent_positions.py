"""Pictures and placements of things that are not there: a sentence, or a picture that says so."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ema import data, examples, place, show
from ema.data import BoltedJoint, FrictionBeam, FrictionLaw
from ema.dof import Dof
from ema.errors import InputError
from ema.shapes import smooth


def motion() -> data.Response:
    """Two samples of one contact."""
    zero, one = np.zeros(2), np.ones(2)
    return data.Response(
        times=np.array([0.0, 0.1]),
        displacements=np.zeros((1, 2)),
        velocities=np.zeros((1, 2)),
        dofs=(Dof(1, "+X"),),
        slips=np.array([[1e-6, -1e-6]]),
        forces=np.array([[5.0, -5.0]]),
        dissipated=np.array([1e-5]),
        slip_time=np.array([0.5]),
        energy=data.EnergyBalance(one, zero, zero, zero, zero, zero),
    )


def second_harmonic() -> data.HarmonicResponse:
    """A steady state of which only the second harmonic was kept."""
    return data.HarmonicResponse(
        frequencies=np.array([39.0]),
        orders=np.array([2]),
        values=np.full((1, 1, 1), 1e-4 + 0j),
        dofs=(Dof(1, "+X"),),
        slips=np.zeros((1, 0, 1), complex),
        force=1.0,
        driven=Dof(1, "+X"),
        input_power=np.array([0.01]),
        friction_power=np.array([0.0]),
        damping_power=np.array([0.01]),
        error_estimate=np.array([1e-6]),
        converged=np.array([True]),
    )


def nowhere() -> data.Geometry:
    """The line of examples with one node that lies nowhere."""
    line = examples.geometry()
    return replace(line, xyz=np.where(np.arange(len(line.nodes))[:, None] == 2, np.nan, line.xyz))


MODEL, FRFS = examples.modal_model(), examples.frf_set()
CALLS: list[tuple[Callable[[], Any], str]] = [
    *(
        (lambda mode=mode, draw=draw: draw(MODEL, modes=[0, mode]), f"no such mode; got 0, {mode}, expected 0 to 2")
        for mode in (-1, 3)
        for draw in (show.complexity, show.shapes_over_dofs)
    ),
    (lambda: show.mode_shapes(MODEL, examples.geometry(), modes=[3]), "no such mode; got 3, expected 0 to 2"),
    (lambda: show.mode_shapes(MODEL, nowhere()), "without finite coordinates .*got 3, expected three finite"),
    (lambda: show.geometry(nowhere()), "without finite coordinates cannot be drawn"),
    (lambda: show.frf_overlay([FRFS], [(0, 2)], ["a"]), "no such input; got 2, expected 0 to 1"),
    (lambda: show.frf_overlay([FRFS], [(-1, 0)], ["a"]), "no such output; got -1, expected 0 to 3"),
    (lambda: show.frf_overlay([FRFS], [(0, 0)], []), "got 1 sets, 1 positions, 0 labels, expected one position and"),
    (lambda: show.reconstruction(FRFS, FRFS, [(0, 0), (4, 0)]), "no such output; got 4, expected 0 to 3"),
    (lambda: show.recommended_force(examples.placement(), rank=0), "no such rank; got 0, expected 1 to"),
    (lambda: show.recommended_force(examples.placement(), rank=99), "no such rank; got 99, expected 1 to"),
    (lambda: show.contact_loops(motion(), most=0), "no contact to draw; got 0, expected 1 or more"),
    (
        lambda: show.free_vibration([motion()], ["a"], contacts=[]),
        r"no such contact; got \[\], expected numbers from 0",
    ),
    (lambda: show.steady_states(second_harmonic()), "lacks a harmonic that is drawn; got 2, expected order 1"),
]


@pytest.mark.parametrize(("call", "said"), CALLS)
def test_what_is_not_there_is_not_drawn(call: Callable[[], Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        call()


def test_sets_without_lines_or_inputs_are_drawn_as_a_note() -> None:
    no_line = data.FrfSet(FRFS.frequencies[:0], FRFS.values[:0], FRFS.outputs, FRFS.inputs, "accelerance")
    no_input = data.FrfSet(FRFS.frequencies, FRFS.values[:, :, :0], FRFS.outputs, (), "accelerance")
    for figure in (
        show.frf_overview(no_line),
        show.frf_overview(no_input),
        show.frf_overlay([no_line], [(0, 0)], ["empty"]),
        show.reconstruction(no_line, no_line, [(0, 0)]),
    ):
        assert [text.get_text() for axes in figure.axes for text in axes.texts] == ["no FRF to draw"]


def test_conditions_of_unknown_force_are_left_out_of_a_map() -> None:
    whole = examples.modal_map()
    part = replace(whole, normal_forces=np.where(np.arange(len(whole.normal_forces)) == 1, np.nan, whole.normal_forces))
    count = whole.damping.size
    assert len(show.damping_map(whole).axes[0].texts) == count
    assert len(show.damping_map(part).axes[0].texts) == count - len(whole.force_levels)


def test_a_candidate_that_does_not_exist_gets_no_forces() -> None:
    bare, geometry = examples.plate()
    surface = smooth(bare, geometry)
    joint = BoltedJoint(FrictionLaw("masing", 0.4, 2e7), 1e8, surface_height=0.003)
    task = place.Task(bare, surface, joint, "1:+Z", np.array([10.0]), np.array([50.0]), modes=(0,))
    beams = [FrictionBeam(0.2, 0.02, 0.01)]
    spots = place.grid(surface, beams, step=0.2)
    for index in (-1, len(spots)):
        with pytest.raises(InputError, match=rf"no such candidate; got {index}, expected 0 to {len(spots) - 1}"):
            place.distribute(task, spots, index, total=100.0)
    with pytest.raises(InputError, match="no evaluation of the model; got 0, expected 1 or more"):
        place.distribute(task, spots, 0, total=100.0, evaluations=0)
    with pytest.raises(
        InputError, match=r"got 1 beams, 0 angles, step 0\.2 m, expected one or more beams, one or more"
    ):
        place.grid(surface, beams, step=0.2, angles=[])
