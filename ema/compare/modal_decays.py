"""Modal coordinates of the free decays behind the impacts of a hammer test, with frequency and damping in time.

All responses of a short window are fitted together by the modes of the late decay, each with its shape over the
responses (a modal filter of all channels: Roettgen and Allen, Mechanical Systems and Signal Processing 84, 2017) and
with an amplitude whose logarithm follows a parabola in time: in the middle of the window its value is the modal
coordinate, its slope the pole at that amplitude. Without a band-pass the first window begins right behind the impact.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from ema.data import Run
from ema.dof import Dof
from ema.estimate.impact_decays import ImpactBlock, free_decays, late_part, late_poles
from ema.progress import Progress, silent

LATEST = 0.15
"""Response, relative to that behind the impact, at which the decay begins that tells number, shapes and first poles of
the modes. The poles are corrected in every window, so that slip before or after it does no harm."""
RESOLVED = 2.4
"""Length of a window in s times the distance of neighbouring modes in Hz. The work table amplifies noise 2.2 times
then, and 25 times at 1.5; twice as long a window smears what 2 % of damping do over 60 % of the amplitude."""
SHORTEST = 4.0
"""Cycles of the lowest mode that a window has at least, however far apart modes are."""
LONGEST = 12.0
"""Cycles of the lowest mode that a window has at most: modes that are closer are left to their shapes."""
HOP = 0.3
"""Step from window to window, over its length."""
ROUNDS = 3
"""Corrections of the poles of a window."""
STILL = 0.01
"""Share of the amplitude behind an impact that may still ring from the impact before it, for that impact to count as
one on a structure at rest."""
_SIZE = 125_000
"""Numbers of a batch of windows that are solved at once: 1 MB, which stays in the cache of a core. With sixteen times
as many the windows of 160 impacts took an eighth longer; results are the same, bit for bit."""
_REGULAR = 1e-9
"""Part of the mean diagonal of the normal matrix that is added to it: modes without amplitude stay finite."""
_MOST = 3.0
"""Natural logarithm by which an amplitude may change within half a window."""


@dataclass(frozen=True)
class ModalDecays:
    """Modal coordinates behind every impact, in windows.

    Parameters
    ----------
    poles : complex array of shape (mode,)
        Poles of the late decay [rad/s], those outside the band included.
    shapes : complex array of shape (mode, out)
        Shapes of the late decay, 1 at the response in row ``reference``.
    reference : int array of shape (mode,)
        Row of ``outputs`` at which each mode is largest.
    times : array of shape (impact, window)
        Middle of the windows after the beginning of each impact [s]: its free decay begins behind its last contact.
    amplitudes : complex array of shape (impact, window, mode)
        Amplitude at the reference, in the unit of the responses.
    local : complex array of shape (impact, window, mode)
        Poles [rad/s] in the middle of the windows.
    deviation : array of shape (mode,)
        Standard deviation of the amplitudes by noise.
    channels : complex array of shape (impact, window, mode, out)
        Amplitude of each mode at each response, in its unit, without a shape assumed; phases as in ``amplitudes``.
    inputs, outputs : tuple of Dof
        DOF of each impact, and of each response.
    forces : complex array of shape (impact, mode)
        Laplace transform of the force of each impact at the poles [N s].
    at_rest : bool array of shape (impact,)
        Whether next to nothing rang from the impact before.
    cut : bool array of shape (impact,)
        Whether a force window closed while the hammer still pressed: ``forces`` is not the force on the structure then.

    Examples
    --------
    >>> "local" in ModalDecays.__dataclass_fields__
    True
    """

    poles: Complex[np.ndarray, "mode"]
    shapes: Complex[np.ndarray, "mode out"]
    reference: Int[np.ndarray, "mode"]
    times: Float[np.ndarray, "impact window"]
    amplitudes: Complex[np.ndarray, "impact window mode"]
    local: Complex[np.ndarray, "impact window mode"]
    deviation: Float[np.ndarray, "mode"]
    channels: Complex[np.ndarray, "impact window mode out"]
    inputs: tuple[Dof, ...]
    outputs: tuple[Dof, ...]
    forces: Complex[np.ndarray, "impact mode"]
    at_rest: Bool[np.ndarray, "impact"]
    cut: Bool[np.ndarray, "impact"]


def modal_decays(run: Run, band: tuple[float, float], progress: Progress = silent) -> ModalDecays | None:
    """Split the free decay behind every impact of a hammer test into modal coordinates.

    Parameters
    ----------
    run : Run
        A hammer test with its records.
    band : tuple of (float, float)
        Ends of the band of the modes [Hz].
    progress : Progress, optional
        Called as the records are read.

    Returns
    -------
    ModalDecays or None
        ``None`` where no decay is long enough.

    Raises
    ------
    InputError
        If a record cannot be used.

    Examples
    --------
    >>> from ema.data import Channel, Condition, Excitation, ModalModel, Run, poles_from
    >>> from ema.simulate import RovingHammer, VirtualRig
    >>> at, poles = Dof(1, "+Z"), poles_from(np.array([300.0]), np.array([0.01]))
    >>> model = ModalModel(poles, np.ones((1, 1)), (at,), 1 / (2j * poles.imag)[None], (at,), scaling="unit modal mass")
    >>> acceleration = Channel("acc", at, quantity="acceleration", unit="m/s^2")
    >>> rig = VirtualRig(model, RovingHammer((at,)), (acceleration,), 4096.0, noise={"acceleration": 0.01})
    >>> run = Run("beam", Condition(Excitation(kind="hammer")), tuple(rig.takes()))
    >>> decays = modal_decays(run, (200.0, 500.0))
    >>> round(float(np.median(np.abs(decays.local[:, :5, 0]) / (2 * np.pi))), 1)
    300.0
    """
    free = free_decays(run, band, progress)
    blocks, original, rate = free.blocks, free.sampling_rate, free.rate
    if not blocks:
        return None
    late = late_part(blocks, rate, LATEST)
    if late is None:
        return None
    poles = late_poles(late.signals, rate, late.noise)
    shapes = _shapes(late.signals, poles, rate)
    length = min(block.decay.shape[1] for block in blocks)
    width = window(poles, band, rate)
    if width > length // 2:
        return None
    signals = np.array([block.decay[:, :length] for block in blocks])
    starts = np.arange(0, length - width, max(int(HOP * width), 1))
    fitted = _Windows(signals / late.noise[:, None], poles, shapes / late.noise, starts, width, rate)
    amplitudes, local, deviation, channels = fitted.solved()
    gaps = np.array([(block.ring - block.impact.start) / original for block in blocks])
    return ModalDecays(
        poles,
        shapes,
        np.argmax(np.abs(shapes), axis=1),
        gaps[:, None] + (starts + (width - 1) / 2) / rate,
        amplitudes,
        local,
        deviation,
        channels * late.noise,
        tuple(block.impact.dof for block in blocks),
        blocks[0].outputs,
        np.array([_force(block, poles, original) for block in blocks]),
        _at_rest(blocks, amplitudes, poles, original),
        np.array([block.cut for block in blocks]),
    )


def window(poles: Complex[np.ndarray, "mode"], band: tuple[float, float], rate: float) -> int:
    """Samples of a window, an even number, from the distance of neighbouring modes."""
    frequencies = np.sort(np.abs(poles)) / (2 * np.pi)
    lowest = float(frequencies[frequencies >= band[0]].min(initial=band[1]))
    apart = float(np.diff(frequencies).min(initial=lowest))
    cycles = float(np.clip(RESOLVED / max(apart, 1e-9) * lowest, SHORTEST, LONGEST))
    return 2 * round(0.5 * cycles / lowest * rate)


def _force(block: ImpactBlock, poles: Complex[np.ndarray, "mode"], rate: float) -> Complex[np.ndarray, "mode"]:
    times = (np.arange(len(block.force)) + block.first - block.impact.start) / rate
    return np.asarray(np.exp(-np.outer(poles, times)) @ block.force / rate)


def _at_rest(
    blocks: Sequence[ImpactBlock],
    amplitudes: Complex[np.ndarray, "impact window mode"],
    poles: Complex[np.ndarray, "mode"],
    rate: float,
) -> Bool[np.ndarray, "impact"]:
    still = np.ones(len(blocks), np.bool_)
    for number in range(1, len(blocks)):
        before, now = blocks[number - 1], blocks[number]
        if before.record == now.record:
            since = (now.impact.start - before.impact.start) / rate
            left = np.abs(amplitudes[number - 1, 0]) * np.exp(poles.real * since)
            still[number] = bool(np.all(left < STILL * np.abs(amplitudes[number, 0]).max()))
    return still


def _shapes(
    signals: Float[np.ndarray, "impact out sample"], poles: Complex[np.ndarray, "mode"], rate: float
) -> Complex[np.ndarray, "mode out"]:
    """Shapes over the responses: the leading direction of the amplitudes of all impacts, 1 where it is largest."""
    waves = np.exp(np.outer(np.arange(signals.shape[-1]) / rate, poles))
    solved = signals @ np.linalg.pinv(np.hstack([waves.real, -waves.imag])).T
    count = len(poles)
    amplitudes = solved[..., :count] + 1j * solved[..., count:]
    shapes = np.array([np.linalg.svd(amplitudes[:, :, mode], full_matrices=False)[2][0] for mode in range(count)])
    return np.asarray(shapes / shapes[np.arange(count), np.argmax(np.abs(shapes), axis=1)][:, None])


@dataclass(frozen=True)
class _Windows:
    """Signals over their noise, modes with shapes over the noise, and the windows to be fitted."""

    signals: Float[np.ndarray, "impact out sample"]
    poles: Complex[np.ndarray, "mode"]
    shapes: Complex[np.ndarray, "mode out"]
    starts: Int[np.ndarray, "window"]
    width: int
    rate: float

    def solved(
        self,
    ) -> tuple[
        Complex[np.ndarray, "impact window mode"],
        Complex[np.ndarray, "impact window mode"],
        Float[np.ndarray, "mode"],
        Complex[np.ndarray, "impact window mode out"],
    ]:
        """Amplitudes and poles in the middle of all windows, and the std of the amplitudes, by Gauss and Newton; then
        the amplitudes at every response by itself, with these poles."""
        impacts, outs = self.signals.shape[:2]
        count, windows = len(self.poles), len(self.starts)
        view = np.lib.stride_tricks.sliding_window_view(self.signals, self.width, axis=2)[:, :, self.starts]
        data = view.transpose(0, 2, 3, 1).reshape(impacts * windows, self.width * outs)
        local = np.broadcast_to(self.poles, (len(data), count)).copy()
        bend, values = np.zeros_like(local), np.empty_like(local)
        deviation = np.ones(count)
        size = max(_SIZE // (self.width * outs * 4 * count), 1)
        for turn in range(ROUNDS):
            for first in range(0, len(data), size):
                part = slice(first, first + size)
                values[part], step, spread = self._step(data[part], local[part], bend[part])
                local[part] += step
                deviation = spread if first == 0 else deviation
            if turn + 1 < ROUNDS:
                bend = self._bend(local.reshape(impacts, windows, count)).reshape(-1, count)
        channels = np.empty((len(data), count, outs), complex)
        for first in range(0, len(data), size):
            part = slice(first, first + size)
            channels[part] = self._by_channel(data[part], local[part], bend[part])
        shape = (impacts, windows, count)
        return values.reshape(shape), local.reshape(shape), deviation, channels.reshape(*shape, outs)

    def _waves(
        self, local: Complex[np.ndarray, "batch mode"], bend: Complex[np.ndarray, "batch mode"]
    ) -> Complex[np.ndarray, "batch time mode"]:
        """exp(p t + p' t^2 / 2) about the middle of each window."""
        times = self._times
        phase = local[:, None] * times[:, None] + 0.5 * bend[:, None] * times[:, None] ** 2
        return np.asarray(np.exp(np.clip(phase.real, -_MOST, _MOST) + 1j * phase.imag))

    @property
    def _times(self) -> Float[np.ndarray, "time"]:
        return (np.arange(self.width) - (self.width - 1) / 2) / self.rate

    def _by_channel(
        self,
        data: Float[np.ndarray, "batch row"],
        local: Complex[np.ndarray, "batch mode"],
        bend: Complex[np.ndarray, "batch mode"],
    ) -> Complex[np.ndarray, "batch mode out"]:
        """Least squares for the modes' amplitudes at every response, the poles given."""
        count, waves = local.shape[1], self._waves(local, bend)
        basis = np.concatenate([waves.real, -waves.imag], axis=2)
        turned = basis.transpose(0, 2, 1)
        normal = turned @ basis
        normal += _REGULAR * np.trace(normal, axis1=1, axis2=2)[:, None, None] / (2 * count) * np.eye(2 * count)
        solved = np.linalg.solve(normal, turned @ data.reshape(len(data), self.width, -1))
        return np.asarray(solved[:, :count] + 1j * solved[:, count:])

    def _step(
        self,
        data: Float[np.ndarray, "batch row"],
        local: Complex[np.ndarray, "batch mode"],
        bend: Complex[np.ndarray, "batch mode"],
    ) -> tuple[Complex[np.ndarray, "batch mode"], Complex[np.ndarray, "batch mode"], Float[np.ndarray, "mode"]]:
        """Amplitudes, corrections of the poles, and the std of the amplitudes in the first window.

        y = Re sum phi (c + c' t) exp(p t + p' t^2 / 2): least squares for c and c', then p -> p + c' / c.
        """
        count, times = local.shape[1], self._times
        waves = self._waves(local, bend)[:, :, None] * self.shapes.T
        columns = np.concatenate([waves, waves * (times / times[-1])[:, None, None]], axis=3)
        columns = columns.reshape(len(data), -1, 2 * count)
        basis = np.concatenate([columns.real, -columns.imag], axis=2)
        turned = basis.transpose(0, 2, 1)
        normal = turned @ basis
        normal += _REGULAR * np.trace(normal, axis1=1, axis2=2)[:, None, None] / (4 * count) * np.eye(4 * count)
        solved = np.linalg.solve(normal, turned @ data[:, :, None])[:, :, 0]
        both = solved[:, : 2 * count] + 1j * solved[:, 2 * count :]
        amplitudes = both[:, :count]
        step = both[:, count:] / np.where(amplitudes == 0, np.inf, amplitudes) / times[-1]
        # half a radian, or a factor exp(1/2), at the ends of the window: the next round goes on from there
        step = step * np.minimum(1.0, 0.5 / times[-1] / np.maximum(np.abs(step), 1e-300))
        power = np.diag(np.linalg.inv(normal[0]))
        return amplitudes, step, np.sqrt(power[:count] + power[2 * count : 3 * count])

    def _bend(self, local: Complex[np.ndarray, "impact window mode"]) -> Complex[np.ndarray, "impact window mode"]:
        """How the poles change in time, bounded where single windows are lost in noise or beats."""
        if local.shape[1] < 4:
            return np.zeros_like(local)
        # without the first window, in which the foot of the impact and modes above the band still ring
        slope = np.gradient(local[:, 1:], (self.starts[1] - self.starts[0]) / self.rate, axis=1)
        slope = np.concatenate([slope[:, :1], slope], axis=1)
        # a pole may not turn by more than 2 % of its frequency within a window
        most = 0.02 * np.abs(self.poles) * self.rate / self.width
        return np.asarray(slope * np.minimum(1.0, most / np.maximum(np.abs(slope), 1e-300)))
