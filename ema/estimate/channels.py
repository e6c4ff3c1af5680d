"""Which rows of a record are forces and which are responses, and whether they can be used."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ema.data import Channel, Recording, Run
from ema.dof import Dof
from ema.errors import InputError
from ema.units import FRF_OF_RESPONSE, FRF_UNIT, UNSTATED, FrfQuantity


@dataclass(frozen=True)
class Layout:
    """Rows and DOFs of one record; a channel without a DOF gets the scalar DOF of its place (1, 2, ...)."""

    references: tuple[int, ...]
    responses: tuple[int, ...]
    inputs: tuple[Dof, ...]
    outputs: tuple[Dof, ...]
    generators: tuple[int, ...] = ()


def describe(run: Run, recording: Recording | None = None) -> str:
    """Name of a run, and of a record in it, for messages.

    Parameters
    ----------
    run : the run.
    recording : one of its records; one without a name adds nothing.

    Examples
    --------
    >>> from ema.data import Condition
    >>> describe(Run("beam_1kN", Condition(), ()))
    'run beam_1kN'
    """
    return f"run {run.id}" + (f", {recording.name}" if recording is not None and recording.name else "")


def recordings_of(run: Run) -> Sequence[Recording]:
    """The raw records of a run.

    Raises
    ------
    InputError : there are none.
    """
    if len(run.recordings) == 0:
        advice = "its FRFs are ready: use run.frfs" if len(run.frfs) else "name its files in campaign.toml"
        raise InputError("the run has no raw records", where=describe(run), advice=advice)
    return run.recordings


def layout(recording: Recording, where: str) -> Layout:
    """Rows of the references and of the responses.

    Raises
    ------
    InputError : no reference, no response, too few samples, not as many channels as signals, or a DOF that appears
        twice among the responses.
    """
    rows, samples = recording.signals.shape
    if rows != len(recording.channels):
        raise InputError(
            "the channel table does not fit the signals",
            where=where,
            got=f"{rows} signals",
            expected=f"{len(recording.channels)} channels",
        )
    if samples < 16:
        raise InputError(
            "the record is too short",
            where=where,
            got=f"{samples} samples",
            expected="at least 16",
            advice="exclude it by a repair, or measure again",
        )
    if not recording.sampling_rate > 0:
        raise InputError("not a sampling rate", where=where, got=recording.sampling_rate, expected="more than 0 Hz")
    references, responses = recording.with_role("reference"), recording.with_role("response")
    names = ", ".join(channel.name for channel in recording.channels)
    for role, found in (("reference", references), ("response", responses)):
        if not found:
            raise InputError(
                f"no {role} channel",
                where=where,
                got=f"channels {names}",
                advice=f"give the role '{role}' to a channel in campaign.toml",
            )
    outputs = tuple(dof_of(recording.channels[row], place) for place, row in enumerate(responses))
    unique(outputs, where)
    return Layout(
        references,
        responses,
        tuple(dof_of(recording.channels[row], place) for place, row in enumerate(references)),
        outputs,
        recording.with_role("generator"),
    )


def dof_of(channel: Channel, place: int) -> Dof:
    """The channel's DOF, or the scalar DOF of its place."""
    return Dof(place + 1) if channel.dof is None else channel.dof


def unique(dofs: Sequence[Dof], where: str) -> None:
    """Refuse DOFs that appear twice.

    Raises
    ------
    InputError : one does.
    """
    twice = sorted({str(dof) for dof in dofs if dofs.count(dof) > 1})
    if twice:
        raise InputError(
            "two response channels have the same DOF",
            where=where,
            got=", ".join(twice),
            advice="correct the DOFs in campaign.toml",
        )


def finite(recording: Recording, layout: Layout, where: str) -> None:
    """Refuse a force or response that is not a number somewhere.

    Raises
    ------
    InputError : NaN or infinity.
    """
    for row in (*layout.references, *layout.generators, *layout.responses):
        signal = recording.signals[row]
        if np.isfinite(signal.sum()):  # one fast pass; the slow one only where something is wrong
            continue
        bad = np.flatnonzero(~np.isfinite(signal))
        if len(bad):
            raise InputError(
                "the signal holds values that are not numbers",
                where=f"{where}, channel {recording.channels[row].name}",
                got=f"{len(bad)} NaN or infinite samples, the first at sample {bad[0]}",
                advice="repair or leave out this record",
            )


def frf_quantity(channels: Sequence[Channel], forces: Sequence[Channel], where: str) -> tuple[FrfQuantity, str]:
    """Kind and unit of the FRFs that these responses over these forces give.

    Raises
    ------
    InputError : the responses are of different kinds, or a reference is no force.
    """
    for force in forces:
        if force.quantity not in ("force", "unstated"):
            raise InputError(
                "the reference channel is no force",
                where=f"{where}, channel {force.name}",
                got=force.quantity,
                expected="force",
                advice="correct the channel table",
            )
    kinds = sorted({channel.quantity for channel in channels})
    if len(kinds) > 1:
        raise InputError(
            "the responses are of different kinds",
            where=where,
            got=" and ".join(kinds),
            expected="one quantity",
            advice="set the role of the others to 'other'",
        )
    quantity = FRF_OF_RESPONSE.get(kinds[0], "unstated")
    stated = quantity != "unstated" and all(channel.scaled for channel in (*channels, *forces))
    return quantity, FRF_UNIT[quantity] if stated else UNSTATED
