"""A structure with friction that is "measured": the same sensors and front end as a linear rig, before another truth.

Every record is one run of the time solver (or of harmonic balance, for a stepped sine) at twice the sampling rate or
more; force and response pass the same anti-alias filter of linear phase before they are sampled.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from ema.data import BeamModel, Finding, Joint
from ema.dof import Dof
from ema.errors import InputError
from ema.simulate.contact import growth
from ema.simulate.harmonic import Branch, Condensed, _Point, condensed_problem
from ema.simulate.inputs import SnapBack, SteppedSine
from ema.simulate.reduction import modal_base, with_armature
from ema.simulate.rig import DERIVATIVES, Rig, anti_alias
from ema.simulate.steady_states import jumped
from ema.simulate.structure import assemble, pair_areas
from ema.simulate.transient import prepare, respond, snapback

FINER = 2
"""Samples of the time solver per sample of the record."""

MARGIN = 256
"""Samples over which signals are led down to zero before and behind a record, so that filtering does not wrap round."""


@dataclass(frozen=True)
class FrictionRig(Rig):
    """Any structure with friction joints, measured virtually.

    Every impact, sweep, step, release or random force of ``drive`` starts from rest and unstressed contacts. A ring
    cell that states no mean shows the normal force of its joint in the model, and always its dynamic part.

    Parameters
    ----------
    model : BeamModel
        The structure.
    drive : Drive
        What excites it.
    responses : tuple of Channel
        Channels of the responses; ``range`` is the full scale in SI, ``None`` for no limit.
    sampling_rate : float
        Sampling rate [Hz].
    rings : tuple of RingCell, optional
        Ring load cells recorded with the signals, one channel each.
    force_range : float, optional
        Full scale of the force channels [N].
    noise : mapping of str to float, optional
        Rms of the noise of each quantity in SI, such as ``{"acceleration": 0.02}``.
    bits : int, optional
        Resolution of the converter over plus and minus full scale; ``None`` for none.
    reversed_sensors : tuple of str, optional
        Names of response channels that are mounted upside down without anybody knowing.
    seed : int, default 0
        The same seed gives the same records, whichever of them are used.
    start : datetime, optional
        Time of the first record.
    name : str, default "virtual"
        What the rig is called in messages.
    tolerance : float, default 0.001
        Error of the displacements of a time run over the largest one, or of a steady state.
    modes : int, optional
        Number of modes kept besides the static corrections; by default all below twice the sampling rate.

    Raises
    ------
    InputError
        If the model is not physical, has no such DOF or joint, or a response is no motion.

    Examples
    --------
    >>> from ema.data import Channel
    >>> from ema.dof import Dof
    >>> from ema.examples import beam_model
    >>> from ema.simulate import SnapBack
    >>> acc = Channel("acc", Dof(1, "+X"), "acceleration", unit="m/s^2")
    >>> rig = FrictionRig(beam_model(), SnapBack(Dof(1, "+X"), load=100.0, duration=0.2), (acc,), 1000.0)
    >>> [channel.name for channel in rig.channels]
    ['force 1', 'acc']
    """

    model: BeamModel
    tolerance: float = 1e-3
    modes: int | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        names = [joint.name for joint in self.model.joints]
        for ring in self.rings:
            if ring.joint not in names:
                raise InputError(
                    "no such joint",
                    where=f"{self.name}, ring {ring.joint}",
                    got=ring.joint,
                    expected="one of " + ", ".join(names),
                )

    def signals(self, number: int, rng: np.random.Generator) -> Float[np.ndarray, "channel sample"]:
        """Simulate one record.

        Parameters
        ----------
        number : int
            Record, from 0.
        rng : Generator
            Source of the random numbers.

        Returns
        -------
        array of shape (channel, sample)
            Forces, responses and ring cells in SI, before noise and conversion.

        Examples
        --------
        >>> from ema.data import Channel
        >>> from ema.dof import Dof
        >>> from ema.examples import beam_model
        >>> from ema.simulate import SnapBack
        >>> acc = Channel("acc", Dof(1, "+X"), "acceleration", unit="m/s^2")
        >>> rig = FrictionRig(beam_model(), SnapBack(Dof(1, "+X"), load=100.0, duration=0.2), (acc,), 1000.0)
        >>> bool(np.all(np.isfinite(rig.signals(0, np.random.default_rng(1)))))
        True
        """
        if isinstance(self.drive, SteppedSine) and self.drive.settle is None:
            return self._steady(number, rng)
        rate = FINER * self.sampling_rate
        lead = self._lead * FINER
        times = np.arange(lead + (self.samples + MARGIN) * FINER) / rate
        forces = self.drive.series(number, times, rng)
        moved, velocities = (motion[:, lead:] for motion in self._motion(number, forces, rate))
        rows = [forces[:, lead:]]
        for channel in self.responses:
            assert channel.dof is not None
            chosen = moved if channel.quantity == "displacement" else velocities
            rows.append(chosen[self._outputs.index(channel.dof)][None])
        powers = [0] * len(forces) + [int(channel.quantity == "acceleration") for channel in self.responses]
        rows += [(self._gap(ring.joint) @ moved)[None] for ring in self.rings]
        powers += [0] * len(self.rings)
        sampled = self._sampled(np.vstack(rows), powers, len(forces))
        return self._with_rings(sampled, len(forces) + len(self.responses), rng)

    def _motion(
        self, number: int, forces: Float[np.ndarray, "in fine"], rate: float
    ) -> tuple[Float[np.ndarray, "output fine"], Float[np.ndarray, "output fine"]]:
        """Displacements and velocities of the outputs."""
        dofs = self.drive.dofs(number)
        if not isinstance(self.drive, SnapBack):
            run = respond(self.model, forces, dofs, rate, self._outputs, tolerance=self.tolerance, modes=self._modes)
            return np.asarray(run.displacements), np.asarray(run.velocities)
        before, count = round(self.drive.pre_trigger * rate), forces.shape[1]
        free = snapback(
            self.model,
            self.drive.load,
            dofs[0],
            (count - before) / rate,
            self._outputs,
            rate,
            self.tolerance,
            self._modes,
        )
        still = np.repeat(free.displacements[:, :1], before, axis=1)
        both = (np.hstack([still, free.displacements]), np.hstack([0 * still, free.velocities]))
        return both[0][:, :count], both[1][:, :count]

    @property
    def _lead(self) -> int:
        """Samples of the record's rate before it begins: while a stepped sine settles."""
        settle = self.drive.settle if isinstance(self.drive, SteppedSine) else None
        return 0 if settle is None else round(settle * self.sampling_rate)

    def _sampled(
        self, fine: Float[np.ndarray, "row fine"], powers: list[int], forces: int
    ) -> Float[np.ndarray, "row sample"]:
        """Signals at the record's rate behind the anti-alias filter, differentiated where ``powers`` says so.

        Forces are straight lines between their fine samples, as the solver takes them.
        """
        from scipy.fft import irfft, next_fast_len, rfft

        margin = MARGIN * FINER
        fall = 0.5 + 0.5 * np.cos(np.pi * np.arange(1, margin + 1) / (margin + 1))
        body = fine.copy()
        body[:, -margin:] *= fall
        padded = np.hstack([body[:, :1] * fall[::-1], body])
        size = int(next_fast_len(padded.shape[1] + margin, real=True))
        size += -size % FINER
        rate = FINER * self.sampling_rate
        frequencies = np.fft.rfftfreq(size, 1 / rate)
        spectra = rfft(padded, size, axis=1) * anti_alias(frequencies, self.sampling_rate)
        spectra[:forces] *= np.sinc(frequencies / rate) ** 2
        spectra *= (2j * np.pi * frequencies) ** np.array(powers)[:, None]
        return np.asarray(irfft(spectra, size, axis=1)[:, margin::FINER][:, : self.samples])

    def _steady(self, number: int, rng: np.random.Generator) -> Float[np.ndarray, "channel sample"]:
        """A record of the steady state at one frequency."""
        assert isinstance(self.drive, SteppedSine)
        condensed, points = self._steady_states
        rows_of = np.array([condensed.problem.base.row(condensed.problem.system, dof) for dof in self._outputs])
        orders, values = condensed.orders(points[number].count), condensed.outputs(points[number], rows_of)
        frequency = self.drive.frequencies[number]
        times = np.arange(self.samples) / self.sampling_rate
        rates = 2j * np.pi * frequency * orders
        waves = np.exp(np.outer(rates, times))
        filtered = anti_alias(orders * frequency, self.sampling_rate)
        pushed = np.where(orders == 1, self.drive.level, 0.0) * filtered
        if self.drive.shaker is not None:
            moved, shaker = values[self._outputs.index(self.drive.point)], self.drive.shaker
            pushed = pushed - (shaker.damping * rates + shaker.moving_mass * rates**2) * moved * filtered
        rows = [np.real(pushed @ waves)]
        for channel in self.responses:
            assert channel.dof is not None
            power = DERIVATIVES[channel.quantity]
            amplitude = values[self._outputs.index(channel.dof)] * filtered
            rows.append(np.real((amplitude * rates**power) @ waves))
        for ring in self.rings:
            rows.append(np.real((self._gap(ring.joint) @ values * filtered) @ waves))
        return self._with_rings(np.array(rows), 1 + len(self.responses), rng)

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """Where neighbouring steps of a stepped sine are on different branches of steady states.

        Every step goes on from the one before, in the order of the frequencies, as a test does. Where its branch ends,
        the record jumps to another one.
        """
        if not isinstance(self.drive, SteppedSine) or self.drive.settle is not None:
            return ()
        condensed, points = self._steady_states
        jumps = [
            (before.omega / (2 * np.pi), point.omega / (2 * np.pi))
            for before, point in pairwise(points)
            if not condensed.joins(point, before)
        ]
        return tuple(jumped(self.name, jumps))

    @cached_property
    def _steady_states(self) -> tuple[Condensed, list[_Point]]:
        """The structure with the shaker's armature, seen from its contacts, and its states at all frequencies."""
        drive = self.drive
        assert isinstance(drive, SteppedSine)
        driven = drive.point
        problem = prepare(self.model, self._outputs, self._modes, [driven], plane=True, normal=True)
        if drive.shaker is not None:
            armature = drive.shaker.moving_mass + drive.shaker.mount_mass, drive.shaker.damping
            problem = replace(problem, base=with_armature(problem.system, problem.base, driven, armature, self._modes))
        condensed = condensed_problem(problem, driven, drive.level, max(self.tolerance, 1e-4))
        branch, points = Branch(condensed.tolerance), list[_Point]()
        for frequency in drive.frequencies:
            point = condensed.solve(frequency, branch.start(frequency))
            if point is None:
                raise InputError(
                    "no steady state was found",
                    where=self.name,
                    got=f"{frequency:g} Hz",
                    advice="give settle, to find it in time",
                )
            branch.add(point)
            points.append(point)
        return condensed, points

    @cached_property
    def _modes(self) -> int | None:
        """Modes that the time solver keeps."""
        if self.modes is not None:
            return self.modes
        base = modal_base(assemble(self.model))
        return int(np.sum(base.frequencies < 2 * np.pi * 2 * self.sampling_rate)) + 1

    @cached_property
    def _outputs(self) -> list[Dof]:
        """DOFs that are followed: those of the sensors, and the gaps under the ring cells."""
        wanted = [channel.dof for channel in self.responses if channel.dof is not None]
        for ring in self.rings:
            for pair in self._joint(ring.joint).pairs:
                wanted += list(self._ends(pair))
        if isinstance(self.drive, SteppedSine) and self.drive.shaker is not None:
            wanted.append(self.drive.point)
        return list(dict.fromkeys(wanted))

    def _joint(self, name: str) -> Joint:
        return next(joint for joint in self.model.joints if joint.name == name)

    def _ends(self, pair: tuple[int, int]) -> tuple[Dof, Dof]:
        """Normal DOFs of host and beam at a node pair."""
        beam = self.model.beam
        parts = (self.model.host.dofs, beam.dofs if beam is not None else self.model.host.dofs)
        found = []
        for node, dofs in zip(pair, parts, strict=True):
            part = next((dof.part for dof in dofs if dof.node == node), "")
            found.append(Dof(node, "+Z", part))
        return found[0], found[1]

    def _gap(self, name: str) -> Float[np.ndarray, "output"]:
        """Weights of the outputs that give the mean opening of a joint."""
        joint, weights = self._joint(name), np.zeros(len(self._outputs))
        for share, pair in zip(pair_areas(joint), joint.pairs, strict=True):
            host, beam = self._ends(pair)
            weights[self._outputs.index(beam)] += share
            weights[self._outputs.index(host)] -= share
        return weights

    def _with_rings(
        self, signals: Float[np.ndarray, "channel sample"], first: int, rng: np.random.Generator
    ) -> Float[np.ndarray, "channel sample"]:
        """The last rows, openings of joints in m, as readings of their ring cells."""
        for row, ring in enumerate(self.rings, first):
            joint = self._joint(ring.joint)
            mean = joint.normal_force if np.isnan(ring.mean) else ring.mean
            pressing = np.maximum(mean - _normal_stiffness(joint) * signals[row], 0.0)
            signals[row] = self._ring(ring, pressing, rng)
        return signals


def _normal_stiffness(joint: Joint) -> float:
    """Stiffness of a joint in N/m against small openings from its normal force."""
    contact = joint.normal_contact
    if contact.name == "power":
        return float(
            joint.normal_stiffness * (joint.normal_force / contact.reference_force) ** (1 - 1 / contact.exponent)
        )
    if contact.name == "curve":
        depths, forces = np.array(contact.points).T
        place = int(np.clip(np.searchsorted(forces, joint.normal_force), 1, len(forces) - 1))
        return float((forces[place] - forces[place - 1]) / (depths[place] - depths[place - 1]))
    return float(joint.normal_stiffness * growth(joint, joint.normal_force))
