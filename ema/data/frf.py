"""Frequency response functions."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Complex, Float

from ema.data._arrays import freeze
from ema.data._summary import Container, brief, count, phrase, span
from ema.data.condition import Condition
from ema.data.deviations import Deviations
from ema.data.findings import Finding
from ema.data.provenance import Provenance
from ema.data.set_ups import SetUps
from ema.dof import Dof
from ema.errors import InputError
from ema.units import UNSTATED, FrfQuantity


@dataclass(frozen=True, repr=False)
class FrfSet(Container):
    """A block of FRFs on one frequency axis, phasor exp(+j w t).

    Parameters
    ----------
    frequencies : Hz, increasing, shape (freq,).
    values : SI, shape (freq, out, in); bare numbers where ``unit`` is ``"unstated"``.
    outputs, inputs : DOFs of the responses and of the forces. A roving hammer with 2 accelerometers and 80 points is
        (freq, 2, 80).
    quantity : receptance, mobility or accelerance; never guessed.
    coherence : ordinary or multiple coherence, shape (freq, out, in), where there is one.
    variance : variance of the complex value E|H - E H|^2, shape (freq, out, in), where known.
    estimator : H1, H2, Hv, ..., or where the FRFs came from.
    averages : number of averages behind each FRF, shape (out, in); ``None`` where unknown.
    added_decay : decay rate in rad/s that an exponential window added to every pole (the fit takes it off again).
    deviations : what the single impacts or blocks changed in their average, where they were kept.
    record_length : s from the beginning of the free vibrations to the end of the record, where the record began with
        them and its end cut them off, or s of a block of random excitation; ``None`` where unknown or neither.
    window : ``rectangular``, ``exponential`` or ``hann`` (blocks of random excitation), or another one that the
        response was multiplied by; empty where unknown.
    set_ups : which set-up of roving sensors or forces each FRF was measured in; ``None`` where there is only one.
    """

    frequencies: Float[np.ndarray, "freq"]
    values: Complex[np.ndarray, "freq out in"]
    outputs: tuple[Dof, ...]
    inputs: tuple[Dof, ...]
    quantity: FrfQuantity
    unit: str = UNSTATED
    coherence: Float[np.ndarray, "freq out in"] | None = None
    variance: Float[np.ndarray, "freq out in"] | None = None
    estimator: str = ""
    averages: Float[np.ndarray, "out in"] | None = None
    added_decay: float = 0.0
    condition: Condition = Condition()
    provenance: Provenance = Provenance()
    findings: tuple[Finding, ...] = field(default=(), compare=False)
    name: str = ""
    deviations: Deviations | None = None
    record_length: float | None = None
    window: str = ""
    set_ups: SetUps | None = None

    def __post_init__(self) -> None:
        freeze(
            self,
            frequencies=np.float64,
            values=np.complex128,
            coherence=np.float64,
            variance=np.float64,
            averages=np.float64,
        )

    @property
    def frequency_step(self) -> float:
        """Mean spacing of the frequency lines in Hz."""
        return float((self.frequencies[-1] - self.frequencies[0]) / max(len(self.frequencies) - 1, 1))

    @property
    def scaled(self) -> bool:
        """Whether the values are in SI."""
        return self.unit != UNSTATED

    def lines(self, keep: "np.ndarray | slice") -> "FrfSet":
        """The set on a subset of its frequency lines."""
        return replace(
            self,
            frequencies=self.frequencies[keep],
            values=self.values[keep],
            coherence=None if self.coherence is None else self.coherence[keep],
            variance=None if self.variance is None else self.variance[keep],
            deviations=None if self.deviations is None else self.deviations.lines(keep),
        )

    def band(self, low: float, high: float) -> "FrfSet":
        """The lines from ``low`` to ``high`` Hz, both included.

        Raises
        ------
        InputError : there is no line in the band.
        """
        start, stop = np.searchsorted(self.frequencies, [low - 1e-9 * abs(low), high + 1e-9 * abs(high)])
        if stop - start < 1:
            raise InputError(
                "no frequency line in the band",
                where=self.name,
                got=f"{low:g} to {high:g} Hz",
                expected=f"a band inside {self.frequencies[0]:g} to {self.frequencies[-1]:g} Hz",
            )
        return self.lines(slice(int(start), int(stop)))

    def pick(self, outputs: Sequence[int] | None = None, inputs: Sequence[int] | None = None) -> "FrfSet":
        """The set on some of its output and input positions."""
        rows = list(range(len(self.outputs))) if outputs is None else list(outputs)
        columns = list(range(len(self.inputs))) if inputs is None else list(inputs)

        def cut(array: "np.ndarray | None") -> "np.ndarray | None":
            return None if array is None else array[:, rows][:, :, columns]

        return replace(
            self,
            values=self.values[:, rows][:, :, columns],
            outputs=tuple(self.outputs[row] for row in rows),
            inputs=tuple(self.inputs[column] for column in columns),
            coherence=cut(self.coherence),
            variance=cut(self.variance),
            averages=None if self.averages is None else self.averages[rows][:, columns],
            deviations=None if self.deviations is None else self.deviations.pick(rows, columns),
            set_ups=None if self.set_ups is None else self.set_ups.pick(rows, columns),
        )

    def label(self, output: int, input_: int) -> str:
        """``12:+Z/5:-Z``: response over force."""
        return f"{self.outputs[output]}/{self.inputs[input_]}"

    def _headline(self) -> str:
        return phrase(
            brief(self.name) if self.name else "",
            f"{count(len(self.frequencies), 'line')} {span(self.frequencies, 'Hz')}",
            f"{count(len(self.outputs), 'output')} x {count(len(self.inputs), 'input')}",
            f"{self.quantity} [{self.unit}]",
            self.estimator,
            count(len(self.findings), "finding") if self.findings else "",
        )
