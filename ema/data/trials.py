"""Tests that would narrow a forecast, with what each draw of the forecast says that they will read."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import Float

from ema.data._arrays import check_axes, freeze
from ema.data._summary import Container
from ema.data.findings import Finding
from ema.data.forecast import Forecast
from ema.errors import InputError

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, repr=False)
class Trial(Container):
    """One test that would tell more about a forecast: the beam installed for one condition, or loops of one joint.

    Parameters
    ----------
    kind : {"beam", "loop"}
        ``beam``: frequency and damping ratio of the target modes with the beam in place; ``loop``: stiffness and energy
        per cycle of one joint alone.
    readings : tuple of str
        What is read, with its unit.
    values : array of shape (draw, reading)
        What every draw of the forecast would read; NaN where it reads nothing.
    std : array of shape (reading,)
        Relative standard uncertainty of each reading.
    hours : float
        What the test costs [h].
    force_level : float, optional
        F_E [N]; NaN for loops.
    normal_force : float, optional
        F_N per joint [N].
    centre : tuple of (float, float), optional
        Centre of the beam [m]; NaN for loops.
    angle : float, optional
        Angle of the beam [rad].
    frequency_width, damping_width : float, optional
        Half width that the bands of the forecast will have after it: relative, mean over modes and conditions.

    Raises
    ------
    InputError
        If a cost or an uncertainty is not positive.

    Examples
    --------
    >>> from ema.examples import trials
    >>> trial = trials().trials[0]
    >>> trial.kind, trial.hours, trial.readings
    ('beam', 1.5, ('mode 1: f [Hz]', 'mode 1: zeta [-]'))
    """

    kind: Literal["beam", "loop"]
    readings: tuple[str, ...]
    values: Float[np.ndarray, "draw reading"]
    std: Float[np.ndarray, "reading"]
    hours: float
    force_level: float = float("nan")
    normal_force: float = float("nan")
    centre: tuple[float, float] = (float("nan"), float("nan"))
    angle: float = float("nan")
    frequency_width: float = float("nan")
    damping_width: float = float("nan")

    def __post_init__(self) -> None:
        freeze(self, values=np.float64, std=np.float64)
        check_axes(self)
        if not (self.hours > 0 and np.all(self.std > 0)):
            raise InputError(
                "a test has a cost and an uncertainty",
                where="trial",
                got=f"{self.hours} h, {self.std.tolist()}",
                expected="numbers above 0",
            )

    @property
    def title(self) -> str:
        """The test in a few words."""
        if self.kind == "loop":
            return f"loops of one joint at F_N {self.normal_force:g} N"
        x, y = self.centre
        return (
            f"beam at ({x:.3f}, {y:.3f}) m, {np.degrees(self.angle):.0f} deg, F_E {self.force_level:g} N, "
            f"F_N {self.normal_force:g} N"
        )


@dataclass(frozen=True, repr=False)
class Trials(Container):
    """Tests that would narrow a forecast, and how far.

    Parameters
    ----------
    forecast : Forecast
        The forecast as it is known now.
    values : array of shape (draw, mode, 2, level, force)
        Frequency [Hz] and damping ratio [-] of its draws; NaN where a draw has none.
    trials : tuple of Trial
        The tests on offer.
    findings : tuple of Finding, optional
        What a reader of the tests has to know.

    Raises
    ------
    InputError
        If the draws are not those of the forecast's conditions, or a test has another number of draws.

    Examples
    --------
    >>> from ema.examples import trials
    >>> offered = trials()
    >>> offered.best, offered.trials[offered.best].kind
    (1, 'loop')
    """

    forecast: Forecast
    values: Float[np.ndarray, "draw mode 2 level force"]
    trials: tuple[Trial, ...] = ()
    findings: tuple[Finding, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        freeze(self, values=np.float64)
        check_axes(self)
        shape = (self.forecast.damping.shape[0], 2, *self.forecast.damping.shape[1:])
        if self.values.shape[1:] != shape:
            raise InputError(
                "the draws are not those of the forecast",
                where="values",
                got=self.values.shape[1:],
                expected=shape,
            )
        for number, trial in enumerate(self.trials):
            if len(trial.values) != len(self.values):
                raise InputError(
                    "a test has another number of draws than the forecast",
                    where=f"test {number}",
                    got=len(trial.values),
                    expected=len(self.values),
                )

    @property
    def frequency_width(self) -> float:
        """Half width of the bands of the frequency: relative, mean over modes and conditions; NaN without a band."""
        return _width(self.forecast.frequency_low, self.forecast.frequency_high)

    @property
    def damping_width(self) -> float:
        """That of the bands of the damping ratio."""
        return _width(self.forecast.damping_low, self.forecast.damping_high)

    @property
    def narrowing(self) -> Float[np.ndarray, "trial"]:
        """By what share of its width each test will narrow the band of the damping ratio, per hour."""
        return np.array([(1 - trial.damping_width / self.damping_width) / trial.hours for trial in self.trials])

    @property
    def best(self) -> int:
        """Number of the test that narrows the bands of the damping ratio most per hour, from 0.

        Raises
        ------
        InputError
            If no test tells anything of the forecast.
        """
        gain = self.narrowing
        if not np.any(gain > 0):
            raise InputError(
                "no test tells anything of this forecast", where="trials", expected="a forecast with bands"
            )
        return int(np.nanargmax(gain))

    def table(self) -> "pd.DataFrame":
        """Return the tests as a table of pandas, what narrows most per hour first.

        Returns
        -------
        pandas.DataFrame
            One row per test, its index the number of the test: what it is, hours, half widths [%] of the bands after
            it, and by how much it narrows those of the damping ratio, also per hour.

        Examples
        --------
        >>> from ema.examples import trials
        >>> trials().table()["half width of zeta [%]"].round(3).tolist()
        [8.0, 14.0]
        """
        import pandas as pd

        after = np.array([[trial.frequency_width, trial.damping_width] for trial in self.trials]).reshape(-1, 2)
        frame = pd.DataFrame(
            {
                "test": [trial.title for trial in self.trials],
                "hours": [trial.hours for trial in self.trials],
                "half width of f [%]": 100 * after[:, 0],
                "half width of zeta [%]": 100 * after[:, 1],
                "narrower [%]": 100 * (1 - after[:, 1] / self.damping_width),
                "per hour [%]": 100 * self.narrowing,
            }
        )
        return frame.sort_values("per hour [%]", ascending=False, kind="stable")


def _width(low: Float[np.ndarray, "mode level force"], high: Float[np.ndarray, "mode level force"]) -> float:
    """Half of the logarithm of the ratio of the bounds, mean over what has bounds."""
    half = 0.5 * np.log(high / low)
    return float(np.nanmean(half)) if np.isfinite(half).any() else float("nan")
