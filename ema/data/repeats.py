"""Repeats of a condition: what scatters within a take, between takes, and from one assembly to the next."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

from ema.data._arrays import freeze
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
    """One quantity of every mode over the repeats of a condition; NaN where it cannot be told.

    ``mean`` over the assemblies. Standard deviations: ``noise`` within one take (stated by the fit), ``takes`` between
    takes of one assembly (noise included), ``between`` assemblies (noise and takes taken off) with the 95 % interval
    ``between_interval``. ``std`` of the mean and its degrees of freedom ``assemblies`` - 1; ``half`` is half the 95 %
    interval of the mean from the repeats, ``noise_half`` from the noise alone.
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


@dataclass(frozen=True, repr=False)
class RepeatGroup(Container):
    """The runs that repeat one condition, with their modes paired.

    ``assemblies`` (one text per run): runs with the same text were taken without anything being loosened in between.
    ``reference`` is the run with the most modes, whose modes are the columns; ``places`` (run, mode) tells the mode of
    each run, from 0, or -1 where it has none. ``frequency`` in Hz, ``damping`` as fraction.
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

    @property
    def count(self) -> int:
        """Number of assemblies."""
        return len(set(self.assemblies))

    @property
    def basis(self) -> str:
        """What the intervals of this condition rest on."""
        return f"{self.count} repeats" if self.count > 1 else NOISE_ONLY

    def table(self) -> "pd.DataFrame":
        """One row per mode: mean, half 95 % interval, and standard deviations within and between, in Hz and %."""
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

    ``pairs`` (mode of the first, mode of the second), from 0; ``frequency`` (pair, 2) Hz and ``damping`` (pair, 2) are
    the means of both. ``frequency_half``, ``damping_half`` (pair,): half the 95 % interval of the difference, from the
    repeats of both conditions, NaN where one of them has none; ``frequency_noise``, ``damping_noise`` (pair,): the same
    from the noise alone. ``frequency_differs``, ``damping_differs`` (pair,): significant; false where unknown.
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

    @property
    def known(self) -> Bool[np.ndarray, "pair"]:
        """Where repeats of both conditions tell the scatter."""
        return np.isfinite(self.damping_half)

    def words(self, what: str) -> tuple[str, ...]:
        """For each pair what is known of the change of ``frequency`` or ``damping``."""
        differs = self.frequency_differs if what == "frequency" else self.damping_differs
        return tuple(
            ("significant" if one else "not significant") if known else NOISE_ONLY
            for one, known in zip(differs, self.known, strict=True)
        )

    def table(self) -> "pd.DataFrame":
        """One row per pair: values, change, half 95 % interval and what it means, in Hz and %."""
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
