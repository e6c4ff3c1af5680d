"""A modal model that is "measured": the virtual rig delivers records as a front end would.

The response of every mode to the force is exact: products of closed-form spectra on a time axis so long that nothing
wraps round, cut by an anti-alias filter of linear phase before the signals are sampled. Force and response pass the
same filter. Then come what sensors and front ends add: noise, full scale, resolution, a sensor mounted upside down.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Complex, Float

from ema.data import ModalModel
from ema.dof import Dof, match
from ema.errors import InputError
from ema.simulate.inputs import RandomShakers, RovingHammer, SweptShaker
from ema.simulate.rig import DERIVATIVES, Rig, anti_alias


@dataclass(frozen=True)
class VirtualRig(Rig):
    """A linear structure with known modes, measured virtually.

    Parameters
    ----------
    model : ModalModel
        Modes of unit modal mass, or with residues in SI by their participation.
    drive : RovingHammer or RandomShakers or SweptShaker
        A roving hammer, random shakers or a swept shaker.
    responses : tuple of Channel
        Channels of the responses; ``range`` is the full scale in SI, ``None`` for no limit.
    sampling_rate : float
        Sampling rate [Hz].
    rings : tuple of RingCell, optional
        Ring load cells recorded with the signals, one channel each; every one states its mean.
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

    Raises
    ------
    InputError
        If the model does not hold a DOF, is free in space, or a response is no motion.

    Examples
    --------
    >>> from ema.data import Channel
    >>> from ema.dof import Dof
    >>> from ema.examples import modal_model
    >>> from ema.simulate import RovingHammer
    >>> acc = Channel("acc", Dof(1, "+Z"), "acceleration", unit="m/s^2")
    >>> rig = VirtualRig(modal_model(), RovingHammer((Dof(1, "+Z"),), hits=2), (acc,), 1024.0)
    >>> [record.signals.shape[0] for record in rig.takes()]
    [2]
    """

    model: ModalModel
    drive: RovingHammer | RandomShakers | SweptShaker

    def __post_init__(self) -> None:
        residuals = self.model.residuals
        if residuals is not None and np.any(residuals.lower):
            raise InputError(
                "a virtual rig cannot hold a body that is free in space",
                where=self.name,
                advice="give the suspension modes instead of a lower residual",
            )
        super().__post_init__()

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
        >>> from ema.examples import modal_model
        >>> from ema.simulate import RovingHammer
        >>> acc = Channel("acc", Dof(1, "+Z"), "acceleration", unit="m/s^2")
        >>> rig = VirtualRig(modal_model(), RovingHammer((Dof(1, "+Z"),), hits=2), (acc,), 1024.0)
        >>> len(rig.signals(0, np.random.default_rng(1)))
        2
        """
        from scipy.fft import irfft

        forces = self.drive.spectra(number, self._frequencies, self.sampling_rate, rng)
        dofs = self.drive.dofs(number)
        spectra = [*forces]
        for channel in self.responses:
            assert channel.dof is not None
            spectra.append(
                sum(
                    self._frf(channel.dof, dof, DERIVATIVES[channel.quantity]) * force
                    for dof, force in zip(dofs, forces, strict=True)
                )
            )
        scale = self.sampling_rate * self._filter
        signals = irfft(np.array(spectra) * scale, self._size, axis=1)[:, : self.samples]
        return np.vstack([signals, *(self._ring(ring, ring.mean, rng)[None] for ring in self.rings)])

    @cached_property
    def _size(self) -> int:
        """Length of the transforms: twice the record, so that no response wraps round into it."""
        from scipy.fft import next_fast_len

        return 2 * int(next_fast_len(self.samples + 1))

    @cached_property
    def _frequencies(self) -> Float[np.ndarray, "freq"]:
        return np.fft.rfftfreq(self._size, 1 / self.sampling_rate)

    @cached_property
    def _filter(self) -> Float[np.ndarray, "freq"]:
        return anti_alias(self._frequencies, self.sampling_rate)

    @cached_property
    def _all_poles(self) -> Complex[np.ndarray, "pole"]:
        """Poles of the modes and of the residual terms, and their conjugates."""
        rest = self.model.residuals
        poles = self.model.poles if rest is None else np.concatenate([self.model.poles, rest.poles])
        return np.concatenate([poles, poles.conj()])

    @cached_property
    def _basis(self) -> Complex[np.ndarray, "freq pole"]:
        """``1 / (j w - p)`` of decays that are cut off after half the transform, which makes the product of spectra an
        exact convolution instead of a circular one."""
        sign = 1 - 2.0 * (np.arange(len(self._frequencies)) % 2)
        cut = 1 - sign[:, None] * np.exp(self._all_poles * self._size / 2 / self.sampling_rate)
        return np.asarray(cut / (2j * np.pi * self._frequencies[:, None] - self._all_poles))

    def _frf(self, output: Dof, force: Dof, power: int) -> Complex[np.ndarray, "freq"]:
        """Receptance times ``(j w)**power``, with what the division by ``j w - p`` leaves over as a polynomial."""
        residues, upper = self._residues(output, force)
        poles, s = self._all_poles, 2j * np.pi * self._frequencies
        polynomial = upper * s**power
        for degree in range(power):
            polynomial = polynomial + np.sum(residues * poles ** (power - 1 - degree)) * s**degree
        return np.asarray(polynomial + self._basis @ (residues * poles**power))

    def _residues(self, output: Dof, force: Dof) -> tuple[Complex[np.ndarray, "pole"], complex]:
        """Residues for all poles, and the upper residual, between two DOFs; by reciprocity where necessary."""
        model, rest = self.model, self.model.residuals
        for row, column in ((output, force), (force, output)):
            rows, columns = match([row], model.dofs), match([column], model.inputs)
            if rows and columns:
                (_, k, sign), (_, i, other) = rows[0], columns[0]
                break
        else:
            raise InputError(
                "the virtual structure has no such pair of DOFs",
                where=self.name,
                got=f"{output}/{force}",
                expected=f"one of {', '.join(map(str, model.dofs[:20]))} "
                f"with one of {', '.join(map(str, model.inputs[:20]))}",
            )
        values = model.shapes[k] * model.participation[i]
        upper = 0j
        if rest is not None:
            upper = complex(rest.upper[k, i])
            if rest.residues is not None:
                values = np.concatenate([values, rest.residues[:, k, i]])
        values = sign * other * values
        return np.concatenate([values, values.conj()]), sign * other * upper
