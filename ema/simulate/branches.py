"""Steady states of an upward and of a downward sweep, and where they differ.

Where contacts soften the structure and take little energy, the curve of steady states over frequency folds: from below
the motion stays small up to a jump, from above it grows beyond that frequency. Each sweep follows its own branch.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from ema.data import BeamModel, Finding, HarmonicResponse
from ema.dof import Dof
from ema.errors import InputError
from ema.simulate.steady_states import HarmonicBalance, frf

_STATES = ("values", "slips", "input_power", "friction_power", "damping_power", "error_estimate", "converged")
"""What a response has for every frequency."""


def frf_up_and_down(
    model: BeamModel,
    frequencies: Float[np.ndarray, "freq"],
    force: float,
    at: Dof | str,
    outputs: Sequence[Dof | str],
    tolerance: float = 5e-3,
    verify: bool = False,
) -> tuple[HarmonicResponse, HarmonicResponse]:
    """Compute the steady states of an upward and of a downward sweep, and name frequencies at which they differ.

    Every state begins from its neighbours in the direction of the sweep; where one sweep finds none, it jumps to that
    of the other. States that differ by more than their stated errors are several steady states of one test: which of
    them a structure takes depends on where it comes from. States on a branch that neither sweep reaches are not found.

    Parameters
    ----------
    model : BeamModel
        The model.
    frequencies : array of shape (freq,)
        Frequencies [Hz], ascending; as fine as the peaks of the response ask for, at least 2.
    force : float
        Amplitude of the force [N].
    at : Dof or str
        DOF of the force.
    outputs : sequence of Dof or str
        DOFs whose amplitudes are computed.
    tolerance : float, default 0.005
        Relative error of the first harmonic that is aimed at.
    verify : bool, default False
        Let the time solver go on from every state, as in ``frf``: it leaves unstable ones.

    Returns
    -------
    up, down : HarmonicResponse
        Steady states of both sweeps at ``frequencies``; where they differ, both have the finding
        ``several-steady-states``.

    Raises
    ------
    InputError
        If the frequencies do not ascend, and where ``frf`` raises it.

    Examples
    --------
    >>> from ema.examples import beam_model
    >>> up, down = frf_up_and_down(beam_model(), np.array([60.0, 65.0, 70.0]), force=1.0, at="1:+X", outputs=["1:+X"])
    >>> [finding.code for finding in up.findings if finding.code == "several-steady-states"]
    []
    """
    frequencies = np.asarray(frequencies, dtype=float)
    if frequencies.ndim != 1 or len(frequencies) < 2 or not np.all(np.diff(frequencies) > 0):
        raise InputError(
            "not frequencies of a sweep",
            where=model.name,
            got=f"{frequencies.size} values",
            expected="at least 2, one after the other, each above the one before",
        )
    settings = HarmonicBalance(tolerance, verify=verify)
    up = frf(model, frequencies, force, at, outputs, settings)
    down = _reversed(frf(model, frequencies[::-1], force, at, outputs, settings))
    up, down = _filled(up, down), _filled(down, up)
    findings = _differences(up, down)
    return replace(up, findings=(*up.findings, *findings)), replace(down, findings=(*down.findings, *findings))


def _reversed(response: HarmonicResponse) -> HarmonicResponse:
    """The same states in the opposite order."""
    return replace(response, **{name: getattr(response, name)[::-1] for name in ("frequencies", *_STATES)})


def _filled(response: HarmonicResponse, other: HarmonicResponse) -> HarmonicResponse:
    """The states of ``other`` where there is none: the end of a branch is a jump to the one that is left."""
    taken = ~response.converged & other.converged
    if not taken.any():
        return response
    orders = max(response.orders, other.orders, key=len)
    fields = {}
    for name in _STATES:
        own, its = getattr(response, name), getattr(other, name)
        if own.ndim == 3:
            own, its = (np.pad(part, ((0, 0), (0, 0), (0, len(orders) - part.shape[2]))) for part in (own, its))
        fields[name] = np.where(taken.reshape(-1, *[1] * (own.ndim - 1)), its, own)
    findings = [finding for finding in response.findings if finding.code != "no-steady-state"]
    lost = response.frequencies[~fields["converged"]]
    if len(lost):
        message = f"no steady state found at {len(lost)} frequencies, whichever way they are passed."
        advice = "Use the time solver, ema.simulate.respond, there."
        findings.append(Finding("error", "no-steady-state", response.name, message, float(lost[0]), None, advice))
    return replace(response, orders=orders, findings=tuple(findings), **fields)


def _several(up: HarmonicResponse, down: HarmonicResponse) -> Bool[np.ndarray, "freq"]:
    """Where the first harmonics of the outputs are farther apart than their errors reach."""
    one, other = (response.values[:, :, list(response.orders).index(1)] for response in (up, down))
    sizes = np.linalg.norm(one, axis=1), np.linalg.norm(other, axis=1)
    reach = up.error_estimate * sizes[0] + down.error_estimate * sizes[1]
    return np.asarray(np.linalg.norm(one - other, axis=1) > reach)


def _differences(up: HarmonicResponse, down: HarmonicResponse) -> tuple[Finding, ...]:
    """A finding where the sweeps differ."""
    places = np.flatnonzero(_several(up, down))
    if not len(places):
        return ()
    first, last = up.frequencies[places[[0, -1]]]
    return (
        Finding(
            "warning",
            "several-steady-states",
            up.name,
            f"the upward and the downward sweep differ at {len(places)} of {len(up.frequencies)} frequencies, "
            f"{first:.5g} to {last:.5g} Hz.",
            float(first),
            None,
            "Say in which direction a test sweeps; a slow sweep jumps at the ends of that range.",
        ),
    )
