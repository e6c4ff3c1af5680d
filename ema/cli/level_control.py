"""`ema record --level`: a shaker whose force at resonance is controlled, on a device or on the virtual work table.

The generator is set to one command for all lines of a stepped sine. The level is the force on the structure at the
frequency of the largest response; a shaker gives less there than beside it, and how much less depends on the level
where joints slip. So the command is sought by measuring.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from ema.data import Channel, Condition, Excitation, Finding, Recording, Run
from ema.errors import InputError

if TYPE_CHECKING:
    from acquisition.rig_file import RigFile
    from ema.simulate.rig import Rig

TOLERANCE = 0.05
"""Relative difference of a level from the one asked for, up to which a take counts. On the virtual table it changes
damping by at most 5.0 % and frequency by at most 1.0 Hz (6 to 40 N, 50 to 200 N on the joints, two settings: 30
conditions); halved or doubled, so are these. The search asks for half of it, so that a take with other noise counts."""
MISSES = 3
"""Takes off their level one after the other, each after a control of its own, behind which the command ends."""
NORMAL_FORCE = 100.0
"""N on the joints of the virtual work table: there Gaul, Roseira and Becker (2008) saw damping rise up to 30 N of
excitation and fall beyond."""
DAMPING = 400.0
"""Back-EMF in N s/m, (B l)^2 / R of 28 N/A and 2 ohm: a modal exciter on an amplifier that keeps the voltage. With
`MOVING_MASS`, a fifth of its force does not reach the table at resonance at 6 N, a thirteenth at 30 N."""
MOVING_MASS = 0.5
"""Armature and stinger of that exciter, kg."""
_ROLES = ("reference", "response", "normal force")


def off_normal_force(record: Recording, wanted: float | None) -> tuple[Finding, ...]:
    """One finding for each joint whose mean normal force over a take is not the one asked for, in N."""
    if wanted is None:
        return ()
    means = {record.channels[row].joint: float(record.signals[row].mean()) for row in record.with_role("normal force")}
    return tuple(
        Finding.of(
            "error",
            "normal-force-level",
            record.name,
            "F_N of joint {joint} is {mean} N, {off} % off {wanted} N.",
            mean / wanted - 1,
            TOLERANCE,
            advice="Tighten or loosen the joint; the same point is asked for again.",
            joint=joint,
            mean=f"{mean:.4g}",
            off=f"{100 * (mean / wanted - 1):+.0f}",
            wanted=f"{wanted:g}",
        )
        for joint, mean in means.items()
        if not abs(mean / wanted - 1) <= TOLERANCE
    )


@runtime_checkable
class Shaker(Protocol):
    """What is driven: a front end with a generator, or a model."""

    @property
    def channels(self) -> tuple[Channel, ...]:
        """What each row of a record is."""
        ...

    @property
    def sampling_rate(self) -> float:
        """Hz."""
        ...

    def measure(self, command: float) -> Recording:
        """Run all stays of the stepped sine.

        Parameters
        ----------
        command : float
            Amplitude of the generator, in the unit of the device.

        Returns
        -------
        Recording
            All stays in one record.
        """
        ...

    def close(self) -> None:
        """Give the device back."""
        ...


def placed(record: Recording, rig: "RigFile", point: int) -> Recording:
    """A take whose channels have the DOFs that the rig.toml says."""
    from ema.dof import Dof

    places = {table.name: table.dof.replace("{point}", str(point)) for table in rig.channels}
    return replace(
        record,
        channels=tuple(
            replace(channel, dof=Dof.parse(places[channel.name])) if places.get(channel.name) else channel
            for channel in record.channels
        ),
    )


@dataclass(frozen=True)
class ShakerAtLevel:
    """Takes of a shaker at one force level, and one normal force if it is asked for; a `Source` once it is opened."""

    rig: "RigFile"
    target: float
    normal_force: float | None = None

    def opened(self) -> "LevelSource":
        """Open the device."""
        from acquisition import rig_file

        virtual = self.rig.rig.device == "virtual"
        shaker = (
            VirtualShaker(self.rig, self.normal_force or NORMAL_FORCE) if virtual else rig_file.open_shaker(self.rig)
        )
        return LevelSource(self, shaker)

    def level(self, record: Recording) -> tuple[float, float]:
        """Force on the structure at resonance in N, and the frequency of the resonance in Hz.

        Raises
        ------
        InputError : the record holds no stepped sine, or the response is largest at an end of the band.
        """
        import numpy as np

        from acquisition import rig_file
        from ema.estimate import stepped_test, without_mount_mass

        point, sine = self.rig.take.points[0], rig_file.steps(self.rig)
        condition = Condition(Excitation("stepped sine", period=sine.stay))
        run = Run("level", condition, (placed(record, self.rig, point),))
        measured, steps = stepped_test(run)
        frfs = measured
        if sine.mount_mass:
            frfs = without_mount_mass(measured, sine.mount_mass, measured.inputs[0])
        height = np.sum(np.abs(frfs.values[:, :, 0]) ** 2, axis=1)
        top = int(height.argmax())
        if top in (0, len(height) - 1):
            raise InputError(
                "no resonance in the band of the shaker",
                where="level control",
                got=f"the largest response at {frfs.frequencies[top]:g} Hz, where the band ends",
                expected="a resonance inside",
                advice="move or widen band of [shaker]",
            )
        # the force on the structure is F - m a, and every FRF of it is larger than the measured one by F / (F - m a)
        share = np.linalg.norm(measured.values[:, :, 0], axis=1) / np.linalg.norm(frfs.values[:, :, 0], axis=1)
        # vertex of the parabola through three lines, so that the level does not jump where the largest line changes
        left, middle, right = np.log(height[top - 1 : top + 2])
        offset = 0.5 * (left - right) / (left - 2 * middle + right) if left + right < 2 * middle else 0.0
        frequency = float(np.interp(top + offset, np.arange(len(height)), frfs.frequencies))
        return float(np.interp(frequency, frfs.frequencies, steps.force * share)), frequency

    def judge(self, record: Recording) -> tuple[Finding, ...]:
        """Say where a take is off the level, or has none."""
        try:
            level, frequency = self.level(record)
        except InputError as error:
            return (Finding("error", "force-level", record.name, f"The level cannot be read: {error.what}."),)
        off = level / self.target - 1
        if abs(off) <= TOLERANCE:
            return ()
        return (
            Finding(
                "error",
                "force-level",
                record.name,
                f"{level:.4g} N at the resonance of {frequency:.5g} Hz, {off:+.0%} off {self.target:g} N.",
                off,
                TOLERANCE,
                "The command is sought again.",
            ),
        )


@dataclass
class LevelSource:
    """A shaker whose command is sought before the first take, and again behind a take off its level; a `Source`."""

    test: ShakerAtLevel
    shaker: Shaker

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Those of the shaker."""
        return self.shaker.channels

    @property
    def sampling_rate(self) -> float:
        """Hz."""
        return self.shaker.sampling_rate

    def takes(self) -> Iterator[Recording]:
        """One stepped sine after the other, until `MISSES` in a row are off their level or normal force.

        Raises
        ------
        InputError : the level is not reached.
        """
        command, missed = self._command(), 0
        while missed < MISSES:
            record = self.shaker.measure(command)
            yield record
            off_level = bool(self.test.judge(record))
            missed = missed + 1 if off_level or off_normal_force(record, self.test.normal_force) else 0
            command = self._command() if off_level else command

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What a model says of its last record; a device says nothing."""
        return self.shaker.findings if isinstance(self.shaker, VirtualShaker) else ()

    def close(self) -> None:
        """Give the device back."""
        self.shaker.close()

    def _command(self) -> float:
        from ema.estimate import control_level

        table = self.test.rig.shaker
        assert table is not None

        def measured(command: float) -> float:
            level, frequency = self.test.level(self.shaker.measure(command))
            print(f"  command {command:.4g}: {level:.4g} N at {frequency:.5g} Hz", flush=True)
            return level

        print(f"Seeking {self.test.target:g} N at resonance ...", flush=True)
        return control_level(
            measured, self.test.target, tolerance=TOLERANCE / 2, most=8, first=table.first, largest=table.largest
        )[0]


@dataclass
class VirtualShaker:
    """The built-in work table with its friction beam under a shaker; steady states with dry friction."""

    rig: "RigFile"
    normal_force: float = NORMAL_FORCE
    count: int = 0
    findings: tuple[Finding, ...] = ()
    """What the model says of the last record."""

    @property
    def channels(self) -> tuple[Channel, ...]:
        """What each row of a record is; where the channels sit is for the rig.toml to say."""
        return tuple(channel for channel, _ in self._wired)

    @property
    def sampling_rate(self) -> float:
        """Hz."""
        return self.rig.rig.sampling_rate

    def measure(self, command: float) -> Recording:
        """The steady states at all lines, with the coil of the shaker at ``command`` N."""
        from datetime import UTC, datetime

        import numpy as np

        self.count += 1
        rig = self._built(command)
        takes, self.findings = list(rig.takes()), rig.findings
        # the model gives the force first, then the responses, then the ring cells
        rows = sorted(range(len(self.channels)), key=lambda row: _ROLES.index(self.channels[row].role))
        signals = np.empty((len(rows), sum(take.signals.shape[1] for take in takes)))
        signals[rows] = np.hstack([take.signals for take in takes])
        return replace(
            takes[0],
            signals=signals,
            channels=self.channels,
            start=datetime.now(UTC),
            name="take",
        )

    def close(self) -> None:
        """Nothing to give back."""

    @cached_property
    def _wired(self) -> tuple[tuple[Channel, str], ...]:
        """The channels of the rig.toml, and their DOFs."""
        from acquisition import rig_file

        point = str(self.rig.take.points[0])
        wired = tuple(
            (wire.channel, table.dof.replace("{point}", point))
            for wire, table in zip(rig_file.wires(self.rig), self.rig.channels, strict=True)
        )
        for channel, _ in wired:
            if channel.role not in _ROLES:
                raise InputError(
                    "the virtual table has no such channel", where=channel.name, got=channel.role, expected=_ROLES
                )
        return wired

    def _built(self, command: float) -> "Rig":
        from acquisition import rig_file
        from ema.datasets import work_table
        from ema.dof import Dof
        from ema.simulate import FrictionRig, SteppedSine
        from ema.simulate import Shaker as Coil
        from ema.simulate.rig import RingCell

        steps = rig_file.steps(self.rig)
        force = next(dof for channel, dof in self._wired if channel.role == "reference")
        coil = Coil(DAMPING, MOVING_MASS, steps.mount_mass)
        drive = SteppedSine(Dof.parse(force), command, steps.frequencies, steps.stay, shaker=coil)
        responses = tuple(
            replace(channel, dof=Dof.parse(dof)) for channel, dof in self._wired if channel.role == "response"
        )
        return FrictionRig(
            work_table.with_beam(work_table.ABSORBER, self.normal_force),
            drive,
            responses,
            self.sampling_rate,
            rings=tuple(RingCell(one.joint, rms=0.1) for one, _ in self._wired if one.role == "normal force"),
            noise={"acceleration": 0.02, "force": 0.02},
            seed=self.count,
            name="virtual",
        )
