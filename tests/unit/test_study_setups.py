"""Roving accelerometers in several set-ups, from raw records: merged, with the frequency shift between them."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ema import estimate, synthesis
from ema.data import Channel, Condition, Excitation, ModalModel, Recording, Run, poles_from
from ema.dof import Dof
from ema.errors import InputError
from ema.simulate import RandomShakers, RovingHammer, VirtualRig
from ema.study.measured import frfs_of
from ema.study.recipe import EstimateTable

DOFS = tuple(Dof(node, "+Z") for node in range(1, 7))
SHAPES = 0.1 * np.array([[1, 0.8], [0.5, -0.6], [-0.2, -1], [-0.7, 0.1], [-0.9, 0.9], [0.3, 0.4]], complex)


def model(shift: float = 0.0) -> ModalModel:
    poles = poles_from((1 + shift) * np.array([120.0, 210.0]), np.array([0.02, 0.02]))
    return ModalModel(
        poles=poles,
        shapes=SHAPES,
        dofs=DOFS,
        participation=SHAPES / (2j * poles.imag),
        inputs=DOFS,
        scaling="unit modal mass",
    )


def records(drive, nodes, setup, shift=0.0, rate=2048.0) -> list[Recording]:
    sensors = tuple(Channel(f"acc {n}", DOFS[n - 1], quantity="acceleration", unit="m/s^2") for n in nodes)
    rig = VirtualRig(model(shift), drive, sensors, rate, noise={"acceleration": 1e-4}, seed=len(nodes) + ord(setup))
    return [replace(record, setup=setup) for record in rig.takes()]


def hammer_run(shift: float = 0.0, spacing: float = 1.1) -> Run:
    drive = RovingHammer(DOFS[:1], hits=4, contact_time=1.5e-3, spacing=1.1, jitter=0.001)
    other = replace(drive, spacing=spacing)
    taken = [*records(drive, (1, 2, 3), "A"), *records(other, (1, 4, 5, 6), "B", shift)]
    return Run("roving", Condition(Excitation("hammer")), tuple(taken))


def test_set_ups_are_merged_to_the_truth():
    frfs, hits = frfs_of(hammer_run(), EstimateTable())
    assert set(frfs.outputs) == set(DOFS) and frfs.inputs == DOFS[:1]
    inside = frfs.band(60, 400)
    exact = synthesis.frfs(model(), inside.frequencies, "accelerance", outputs=inside.outputs, inputs=inside.inputs)
    assert np.abs(inside.values - exact.values).max() < 2e-3 * np.abs(exact.values).max()
    assert len(hits.accepted) == 8
    assert "setup-shift" not in {finding.code for finding in frfs.findings if finding.severity == "warning"}


def test_the_shift_between_set_ups_is_a_finding():
    frfs, _ = frfs_of(hammer_run(shift=0.01), EstimateTable())
    # one common FRF with lines 0.9 Hz apart tells a shift of 1.2 to 2.1 Hz to about a quarter
    (shift,) = [finding for finding in frfs.findings if finding.code == "setup-shift"]
    assert shift.severity == "warning" and abs(shift.value) == pytest.approx(0.01, rel=0.25)


def test_set_ups_with_other_pauses_between_the_blows_get_the_same_block():
    """The shorter pause, 0.8 s, less the 50 ms before the next impact that belong to that one."""
    frfs, _ = frfs_of(hammer_run(spacing=0.8), EstimateTable())
    assert set(frfs.outputs) == set(DOFS)
    assert frfs.frequency_step == pytest.approx(1 / 0.75, rel=0.05)


@cache
def random_run(shakers: int) -> Run:
    """Random forces at the first points, beyond the band that is compared, 60 to 400 Hz; two set-ups."""
    drive = RandomShakers(DOFS[:shakers], 10.0, (20.0, 450.0), duration=20.0)
    taken = [*records(drive, (1, 2, 3), "A", rate=1024.0), *records(drive, (1, 4, 5, 6), "B", rate=1024.0)]
    return Run("random", Condition(Excitation("random")), tuple(taken))


@pytest.fixture(scope="module")
def estimated_once() -> Iterator[None]:
    """A set-up of random excitation is estimated once, for tests of what is done with its FRFs."""
    shaker, known = estimate.shaker, {}

    def once(run: Run, **more: object):
        settings = {name: value for name, value in more.items() if name != "progress"}
        key = (*map(id, run.recordings), repr(settings))
        if key not in known:
            known[key] = shaker(run, **more)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(estimate, "shaker", once)
        yield


def test_random_excitation_in_set_ups(estimated_once):
    frfs, hits = frfs_of(random_run(2), EstimateTable())
    assert hits is None and frfs.values.shape[1:] == (6, 2)
    inside = frfs.band(60, 400)
    exact = synthesis.frfs(model(), inside.frequencies, "accelerance", outputs=inside.outputs, inputs=inside.inputs)
    assert np.abs(inside.values - exact.values).max() < 2e-2 * np.abs(exact.values).max()


@pytest.mark.parametrize(("shakers", "mass"), [(1, 1.0), (2, 0.5)])
def test_masses_of_the_mounts_are_taken_off_in_set_ups_as_well(estimated_once, shakers, mass):
    """Cells read the force F on structure and mount; the FRFs between these are A, those behind the masses
    A (I - m A_dd)^-1, with the accelerances A_dd between the drive points."""
    frfs, _ = frfs_of(random_run(shakers), EstimateTable(mount_mass=mass))
    assert frfs.values.shape[1:] == (6, shakers)
    inside = frfs.band(60, 400)
    read = synthesis.frfs(model(), inside.frequencies, "accelerance", outputs=inside.outputs, inputs=inside.inputs)
    points = read.values[:, [read.outputs.index(dof) for dof in inside.inputs]]
    exact = read.values @ np.linalg.inv(np.eye(shakers) - mass * points)
    assert np.abs(inside.values - exact).max() < 2e-2 * np.abs(exact).max()


def test_nothing_to_work_with_is_said():
    with pytest.raises(InputError, match="neither records nor FRFs"):
        frfs_of(Run("empty", Condition()), EstimateTable())
