"""Repeats of a condition: what scatters within a take, between takes, and from one assembly to the next."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

from ema.data._arrays import check_axes, freeze
from ema.data._summary import Container
from ema.data.condition import Condition
from ema.data.findings import Finding
from ema.data.modal import ModalModel

if TYPE_CHECKING:
    import pandas as pd

NOISE_ONLY = "noise only; assembly scatter unknown"
"""What is said of every interval and every difference that no repeats stand behind."""


@dataclass(frozen=True, repr=False)
class VarianceComponents(Container):
    """One quantity of every mode over the repeats of a condition; NaN where it cannot be determined.

    Parameters
    ----------
    mean : array of shape (mode,)
        Mean over the assemblies.
    noise : array of shape (mode,)
        Standard deviation within one take, stated by the fit.
    takes : array of shape (mode,)
        Standard deviation between takes of one assembly, noise included.
    between : array of shape (mode,)
        Standard deviation between assemblies, noise and takes taken off.
    between_interval : array of shape (mode, 2)
        95 % interval of ``between``.
    std : array of shape (mode,)
        Standard uncertainty of the mean.
    half : array of shape (mode,)
        Half the 95 % interval of the mean, from the repeats.
    noise_half : array of shape (mode,)
        Half the 95 % interval of the mean, from the noise alone.
    assemblies : integer array of shape (mode,)
        Number of assemblies; the degrees of freedom of ``std`` are one fewer.

    Examples
    --------
    >>> from ema.compare import variance_components
    >>> spread = variance_components(np.array([[40.0], [40.2], [39.8]]), np.full((3, 1), 0.01))
    >>> spread.mean.round(2), spread.between.round(2), spread.assemblies
    (array([40.]), array([0.2]), array([3]))
    """

    mean: Float[np.ndarray, "mode"]
    noise: Float[np.ndarray, "mode"]
    takes: Float[np.ndarray, "mode"]
    between: Float[np.ndarray, "mode"]
    between_interval: Float[np.ndarray, "mode 2"]
    std: Float[np.ndarray, "mode"]
    half: Float[np.ndarray, "mode"]
    noise_half: Float[np.ndarray, "mode"]
    assemblies: Int[np.ndarray, "mode"]

    def __post_init__(self) -> None:
        names = ("mean", "noise", "takes", "between", "between_interval", "std", "half", "noise_half")
        freeze(self, **dict.fromkeys(names, np.float64), assemblies=np.int64)
        check_axes(self)


@dataclass(frozen=True, repr=False)
class RepeatGroup(Container):
    """The runs that repeat one condition, with their modes paired.

    Parameters
    ----------
    label : str
        Name of the condition.
    runs : tuple of str
        Names of the runs.
    assemblies : tuple of str
        One text per run: runs with the same text were taken without anything being loosened in between.
    reference : ModalModel
        Modes of the run with the most modes; they are the columns.
    places : integer array of shape (run, mode)
        Mode of each run, from 0, or -1 where it has none.
    frequency : VarianceComponents
        Natural frequencies [Hz] over the repeats.
    damping : VarianceComponents
        Damping ratios [-] over the repeats.
    condition : Condition, optional
        Excitation and normal forces.
    findings : tuple of Finding, optional
        What a reader of the repeats has to know.

    Examples
    --------
    >>> from ema.compare import repeats
    >>> from ema.examples import modal_model
    >>> group = repeats([modal_model(), modal_model()], label="bare", names=["run 1", "run 2"])
    >>> group.count, group.basis
    (2, '2 repeats')
    """

    label: str
    runs: tuple[str, ...]
    assemblies: tuple[str, ...]
    reference: ModalModel
    places: Int[np.ndarray, "run mode"]
    frequency: VarianceComponents
    damping: VarianceComponents
    condition: Condition = Condition()
    findings: tuple[Finding, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        freeze(self, places=np.int64)
        check_axes(self)

    @property
    def count(self) -> int:
        """Number of assemblies."""
        return len(set(self.assemblies))

    @property
    def basis(self) -> str:
        """What the intervals of this condition rest on."""
        return f"{self.count} repeats" if self.count > 1 else NOISE_ONLY

    def table(self) -> "pd.DataFrame":
        """Return the repeats as a table of pandas.

        Returns
        -------
        pandas.DataFrame
            One row per mode, from 1: mean, half 95 % interval, and standard deviations within and between assemblies,
            in Hz and %.

        Examples
        --------
        >>> from ema.compare import repeats
        >>> from ema.examples import modal_model
        >>> repeats([modal_model(), modal_model()]).table()["f [Hz]"].round(3).tolist()
        [40.0, 60.0, 90.0]
        """
        import pandas as pd

        columns: dict[str, object] = {"repeats": self.frequency.assemblies}
        for name, unit, scale, own in (("f", "Hz", 1, self.frequency), ("zeta", "%", 100, self.damping)):
            columns |= {
                f"{name} [{unit}]": scale * own.mean,
                f"+- {name} [{unit}]": scale * own.half,
                f"noise {name} [{unit}]": scale * own.noise,
                f"takes {name} [{unit}]": scale * own.takes,
                f"between {name} [{unit}]": scale * own.between,
                f"between {name} from [{unit}]": scale * own.between_interval[:, 0],
                f"between {name} to [{unit}]": scale * own.between_interval[:, 1],
            }
        return pd.DataFrame(columns, index=pd.RangeIndex(1, len(self.frequency.mean) + 1, name="mode"))


@dataclass(frozen=True, repr=False)
class ConditionDifference(Container):
    """What changed from one condition to another, mode by mode.

    Parameters
    ----------
    first, second : str
        Names of the conditions.
    pairs : tuple of tuple of (int, int)
        (mode of the first, mode of the second), from 0.
    frequency : array of shape (pair, 2)
        Mean natural frequencies [Hz] of both.
    damping : array of shape (pair, 2)
        Mean damping ratios [-] of both.
    frequency_half, damping_half : array of shape (pair,)
        Half the 95 % interval of the difference, from the repeats of both conditions; NaN where one of them has none.
    frequency_noise, damping_noise : array of shape (pair,)
        The same from the noise alone.
    frequency_differs, damping_differs : boolean array of shape (pair,)
        Whether the difference is significant; false where unknown.
    mac : array of shape (pair,)
        MAC of each pair.
    sentences : tuple of str
        What changed, in words.
    findings : tuple of Finding, optional
        What a reader of the difference has to know.

    Examples
    --------
    >>> from ema.compare import difference, repeats
    >>> from ema.examples import modal_model
    >>> group = repeats([modal_model(), modal_model()], label="bare")
    >>> difference(group, group).pairs
    ((0, 0), (1, 1), (2, 2))
    """

    first: str
    second: str
    pairs: tuple[tuple[int, int], ...]
    frequency: Float[np.ndarray, "pair 2"]
    damping: Float[np.ndarray, "pair 2"]
    frequency_half: Float[np.ndarray, "pair"]
    damping_half: Float[np.ndarray, "pair"]
    frequency_noise: Float[np.ndarray, "pair"]
    damping_noise: Float[np.ndarray, "pair"]
    frequency_differs: Bool[np.ndarray, "pair"]
    damping_differs: Bool[np.ndarray, "pair"]
    mac: Float[np.ndarray, "pair"]
    sentences: tuple[str, ...]
    findings: tuple[Finding, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        names = (
            "frequency",
            "damping",
            "frequency_half",
            "damping_half",
            "frequency_noise",
            "damping_noise",
            "mac",
        )
        freeze(self, **dict.fromkeys(names, np.float64), frequency_differs=np.bool_, damping_differs=np.bool_)
        check_axes(self)

    @property
    def known(self) -> Bool[np.ndarray, "pair"]:
        """Where repeats of both conditions tell the scatter."""
        return np.asarray(np.isfinite(self.damping_half))

    def words(self, what: str) -> tuple[str, ...]:
        """Return what is known of the change of every pair, in words.

        Parameters
        ----------
        what : str
            ``"frequency"``; anything else stands for the damping.

        Returns
        -------
        tuple of str
            ``"significant"``, ``"not significant"``, or that the scatter of assemblies is unknown.

        Examples
        --------
        >>> from ema.compare import difference, repeats
        >>> from ema.examples import modal_model
        >>> group = repeats([modal_model()], label="bare")
        >>> difference(group, group).words("frequency")[0]
        'noise only; assembly scatter unknown'
        """
        differs = self.frequency_differs if what == "frequency" else self.damping_differs
        return tuple(
            ("significant" if one else "not significant") if known else NOISE_ONLY
            for one, known in zip(differs, self.known, strict=True)
        )

    def table(self) -> "pd.DataFrame":
        """Return the difference as a table of pandas.

        Returns
        -------
        pandas.DataFrame
            One row per pair: values, change, half 95 % intervals and what the change means, in Hz and %.

        Examples
        --------
        >>> from ema.compare import difference, repeats
        >>> from ema.examples import modal_model
        >>> group = repeats([modal_model()], label="bare")
        >>> difference(group, group).table()["change of f [Hz]"].tolist()
        [0.0, 0.0, 0.0]
        """
        import pandas as pd

        columns: dict[str, object] = {
            f"mode in {self.first}": [i + 1 for i, _ in self.pairs],
            f"mode in {self.second}": [j + 1 for _, j in self.pairs],
        }
        for name, unit, scale, values, half, noise, what in (
            ("f", "Hz", 1, self.frequency, self.frequency_half, self.frequency_noise, "frequency"),
            ("zeta", "%", 100, self.damping, self.damping_half, self.damping_noise, "damping"),
        ):
            columns |= {
                f"{name} in {self.first} [{unit}]": scale * values[:, 0],
                f"{name} in {self.second} [{unit}]": scale * values[:, 1],
                f"change of {name} [{unit}]": scale * (values[:, 1] - values[:, 0]),
                f"+- [{unit}]": scale * half,
                f"+- by noise [{unit}]": scale * noise,
                f"change of {name}": self.words(what),
            }
        return pd.DataFrame(columns | {"MAC": self.mac})
