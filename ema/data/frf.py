"""Frequency response functions."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from jaxtyping import Complex, Float

from ema.data._arrays import check_axes, freeze
from ema.data._summary import Container, brief, count, phrase, span
from ema.data.condition import Condition
from ema.data.deviations import Deviations
from ema.data.findings import Finding
from ema.data.provenance import Provenance
from ema.data.set_ups import SetUps
from ema.data.window import Window
from ema.dof import Dof
from ema.errors import InputError
from ema.units import FRF_UNIT, UNSTATED, FrfQuantity

if TYPE_CHECKING:
    import pandas as pd

    # A window gives its values to numpy wherever an array does: to type checkers it is one.
    FrfValues = Complex[np.ndarray, "freq out in"]
    FrfWeights = Float[np.ndarray, "freq out in"]
else:
    FrfValues = Complex[np.ndarray, "freq out in"] | Complex[Window, "freq out in"]
    FrfWeights = Float[np.ndarray, "freq out in"] | Float[Window, "freq out in"]


@dataclass(frozen=True, repr=False)
class FrfSet(Container):
    """A block of frequency response functions on one frequency axis, phasor exp(+j w t).

    Parameters
    ----------
    frequencies : array of shape (freq,)
        Frequency lines [Hz], increasing.
    values : complex array of shape (freq, out, in)
        FRFs in SI; bare numbers where ``unit`` is ``"unstated"``. Those of a set that is larger than memory stay in
        their file (:meth:`ema.store.Writer.begin`): ``numpy.asarray(frfs.pick(...).values)`` reads a part of them.
    outputs, inputs : tuple of Dof
        DOFs of the responses and of the forces. A roving hammer with 2 accelerometers and 80 points is (freq, 2, 80).
    quantity : {"receptance", "mobility", "accelerance", "unstated"}
        Kind of the FRFs (ISO 7626-1); never guessed.
    unit : str, optional
        SI unit of the values, such as ``"m/N"``, or ``"unstated"``.
    coherence : array of shape (freq, out, in), optional
        Ordinary or multiple coherence, where there is one.
    variance : array of shape (freq, out, in), optional
        Variance of the complex value, E|H - E H|^2, where known.
    estimator : str, optional
        H1, H2, Hv ..., or where the FRFs came from.
    averages : array of shape (out, in), optional
        Number of averages behind each FRF; ``None`` where unknown.
    added_decay : float, default 0.0
        Decay rate [rad/s] that an exponential window added to every pole. The fit takes it off again.
    condition : Condition, optional
        Excitation and normal forces of the measurement.
    provenance : Provenance, optional
        Inputs, versions and options behind the set.
    findings : tuple of Finding, optional
        What a reader of the FRFs has to know.
    name : str, optional
        What the set is called in messages.
    deviations : Deviations, optional
        What the single impacts or blocks changed in their average, where they were kept.
    record_length : float, optional
        Time [s] from the beginning of the free vibrations to the end of the record, where the record began with them
        and its end cut them off, or length of a block of random excitation; ``None`` where unknown or neither.
    window : str, optional
        ``rectangular``, ``exponential`` or ``hann`` (blocks of random excitation), or another window that the response
        was multiplied by; empty where unknown.
    set_ups : SetUps, optional
        Which set-up of roving sensors or forces each FRF was measured in; ``None`` where there is only one.
    effective_lines : array of shape (freq,), optional
        Lines whose data each value rests on where neighbouring lines were smoothed together: the variance that a line
        by itself would have is as many times larger. ``None`` where each line is estimated by itself.
    output_correlation : array of shape (freq, in), optional
        Correlation of the errors of different outputs along the FRFs of an input: the variance of n outputs together is
        ``1 + (n - 1) r`` times that of outputs that err independently. ``None`` where it is not known.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> frfs = frf_set()
    >>> frfs.values.shape, frfs.unit, frfs.frequency_step
    ((201, 4, 2), '(m/s^2)/N', 0.5)
    """

    frequencies: Float[np.ndarray, "freq"]
    values: FrfValues
    outputs: tuple[Dof, ...]
    inputs: tuple[Dof, ...]
    quantity: FrfQuantity
    unit: str = UNSTATED
    coherence: FrfWeights | None = None
    variance: FrfWeights | None = None
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
    effective_lines: Float[np.ndarray, "freq"] | None = None
    output_correlation: Float[np.ndarray, "freq in"] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.values, Window):  # values computed from those of a set in a file
            for name in ("coherence", "variance"):
                if isinstance(getattr(self, name), Window):
                    object.__setattr__(self, name, np.asarray(getattr(self, name)))
            if self.deviations is not None and isinstance(self.deviations.values, Window):
                object.__setattr__(self, "deviations", self.deviations.in_memory())
        freeze(
            self,
            frequencies=np.float64,
            values=np.complex128,
            coherence=np.float64,
            variance=np.float64,
            averages=np.float64,
            effective_lines=np.float64,
            output_correlation=np.float64,
        )
        check_axes(self)

    @classmethod
    def from_arrays(
        cls,
        frequencies: "np.ndarray | Sequence[float]",
        values: "np.ndarray",
        *,
        outputs: "Sequence[Dof | str]",
        inputs: "Sequence[Dof | str]",
        quantity: str,
        name: str = "",
    ) -> "FrfSet":
        """Make a set of FRFs in SI from arrays of another program.

        Parameters
        ----------
        frequencies : array of shape (freq,)
            Hz, increasing.
        values : array of shape (freq,), (freq, out) or (freq, out, in)
            Complex FRFs in SI, phasor exp(+j w t): m/N, (m/s)/N or (m/s^2)/N.
        outputs, inputs : sequence of Dof or str
            DOFs of responses and forces, such as ``"12:+Z"``.
        quantity : {"receptance", "mobility", "accelerance", "unstated"}
            Kind of the FRFs.
        name : str
            What the set is called in messages.

        Returns
        -------
        FrfSet
            The set, with the SI unit of its quantity.

        Raises
        ------
        InputError
            If shapes and DOFs do not fit together, the frequencies do not increase, or the quantity is unknown.

        Examples
        --------
        >>> frequencies = np.arange(1.0, 5.0)
        >>> values = 1 / (1 - frequencies**2 + 0.1j)
        >>> FrfSet.from_arrays(frequencies, values, outputs=["1:+Z"], inputs=["1:+Z"], quantity="receptance")
        FrfSet(4 lines 1 to 4 Hz, 1 output x 1 input, receptance [m/N])
        """
        lines = np.asarray(frequencies, dtype=np.float64)
        block: Any = np.asarray(values, dtype=np.complex128)
        if quantity not in FRF_UNIT:
            raise InputError("unknown kind of FRF", where=name, got=repr(quantity), expected=", ".join(FRF_UNIT))
        if lines.ndim != 1 or not np.all(np.diff(lines) > 0):
            raise InputError("frequencies are not increasing", where=name, expected="an array (freq,) in Hz")
        block = block.reshape(block.shape + (1,) * max(0, 3 - block.ndim))
        wanted = (len(lines), len(outputs), len(inputs))
        if block.shape != wanted:
            raise InputError(
                "the FRFs and their axes disagree",
                where=name,
                got=f"values of shape {np.shape(values)}",
                expected=f"(freq, out, in) = {wanted}",
            )
        places = [tuple(Dof.parse(dof) if isinstance(dof, str) else dof for dof in dofs) for dofs in (outputs, inputs)]
        kind = cast(FrfQuantity, quantity)
        return cls(lines, block, places[0], places[1], kind, FRF_UNIT[quantity], name=name)

    def to_dataframe(self) -> "pd.DataFrame":
        """Return the FRFs as a table of pandas.

        Returns
        -------
        pandas.DataFrame
            One complex column per FRF, named response over force (``12:+Z/5:-Z``), over the frequencies in Hz;
            ``attrs`` holds quantity and unit.

        Examples
        --------
        >>> from ema.examples import frf_set
        >>> table = frf_set().to_dataframe()
        >>> table.shape, table.columns[0], table.attrs["quantity"]
        ((201, 8), '1:+Z/1:+Z', 'accelerance')
        """
        import pandas as pd

        labels = [
            self.label(output, input_) for output in range(len(self.outputs)) for input_ in range(len(self.inputs))
        ]
        index = pd.Index(self.frequencies, name="frequency [Hz]")
        values = np.asarray(self.values).reshape(len(self.frequencies), -1)
        table = pd.DataFrame(values, index=index, columns=labels)
        table.attrs |= {"quantity": self.quantity, "unit": self.unit}
        return table

    @property
    def frequency_step(self) -> float:
        """Mean spacing of the frequency lines in Hz."""
        return float((self.frequencies[-1] - self.frequencies[0]) / max(len(self.frequencies) - 1, 1))

    @property
    def lines_correlate(self) -> bool:
        """Whether errors of neighbouring lines correlate by the way they were estimated.

        So they do in averages of blocks under a Hann window, and where a local model smooths them.
        """
        return self.window == "hann" or self.effective_lines is not None

    @property
    def scaled(self) -> bool:
        """Whether the values are in SI."""
        return self.unit != UNSTATED

    @property
    def in_file(self) -> bool:
        """Whether the values stay in their file until they are used."""
        return isinstance(self.values, Window)

    def in_memory(self) -> "FrfSet":
        """Return the set with all its values read.

        Returns
        -------
        FrfSet
            The same set; itself where nothing stays in a file.

        Examples
        --------
        >>> from ema.examples import frf_set
        >>> frfs = frf_set()
        >>> frfs.in_memory() is frfs
        True
        """
        if not self.in_file:
            return self
        coherence, variance = (None if one is None else np.asarray(one) for one in (self.coherence, self.variance))
        deviations = None if self.deviations is None else self.deviations.in_memory()
        values = np.asarray(self.values)
        return replace(self, values=values, coherence=coherence, variance=variance, deviations=deviations)

    def lines(self, keep: "np.ndarray | slice") -> "FrfSet":
        """Return the set on a subset of its frequency lines.

        Parameters
        ----------
        keep : array or slice
            Index of numpy along the frequency axis: a slice, a mask of shape (freq,) or positions.

        Returns
        -------
        FrfSet
            Values, coherence, variance and deviations on those lines.

        Examples
        --------
        >>> from ema.examples import frf_set
        >>> frf_set().lines(slice(0, 3)).frequencies
        array([20. , 20.5, 21. ])
        """
        return replace(
            self,
            frequencies=self.frequencies[keep],
            values=self.values[keep],
            coherence=None if self.coherence is None else self.coherence[keep],
            variance=None if self.variance is None else self.variance[keep],
            deviations=None if self.deviations is None else self.deviations.lines(keep),
            effective_lines=None if self.effective_lines is None else self.effective_lines[keep],
            output_correlation=None if self.output_correlation is None else self.output_correlation[keep],
        )

    def band(self, low: float, high: float) -> "FrfSet":
        """Return the lines of a band, its ends included.

        Parameters
        ----------
        low, high : float
            Ends of the band [Hz].

        Returns
        -------
        FrfSet
            The set on the lines of the band.

        Raises
        ------
        InputError
            If there is no line in the band.

        Examples
        --------
        >>> from ema.examples import frf_set
        >>> frf_set().band(30, 31).frequencies
        array([30. , 30.5, 31. ])
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
        """Return the set with some of its outputs and inputs, in the order given.

        Parameters
        ----------
        outputs : sequence of int, optional
            Positions in ``outputs``, from 0; all by default.
        inputs : sequence of int, optional
            Positions in ``inputs``, from 0; all by default.

        Returns
        -------
        FrfSet
            The set with those rows and columns.

        Examples
        --------
        >>> from ema.examples import frf_set
        >>> frf_set().pick(outputs=[3], inputs=[0]).values.shape
        (201, 1, 1)
        """
        rows = list(range(len(self.outputs))) if outputs is None else list(outputs)
        columns = list(range(len(self.inputs))) if inputs is None else list(inputs)

        def cut(array: Any) -> Any:
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
            output_correlation=None if self.output_correlation is None else self.output_correlation[:, columns],
        )

    def label(self, output: int, input_: int) -> str:
        """Return the name of one FRF, response over force.

        Parameters
        ----------
        output : int
            Position in ``outputs``, from 0.
        input_ : int
            Position in ``inputs``, from 0.

        Returns
        -------
        str
            Such as ``12:+Z/5:-Z``.

        Examples
        --------
        >>> from ema.examples import frf_set
        >>> frf_set().label(3, 0)
        '4:+Z/1:+Z'
        """
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
