"""How far the set-ups of a test lie apart, what explains that, and what it adds to the intervals of the modes."""

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
import scipy.optimize
from jaxtyping import Float, Int

from ema.data import Finding, ModalModel, SetUps, SetUpShifts
from ema.data.modal import COVERAGE_FACTOR
from ema.data.set_ups import ShiftCause
from ema.dof import match
from ema.fit.set_ups import AGREEMENT, Comparison, common_shift, means
from ema.fit.uncertainty import widened

_TURNS = 4
"""Turns of shapes and mass: each takes the error of the mass down by the relative shift of the frequencies,
which is 3 % at most (`set_ups.WIDEST`): four leave a millionth."""


@dataclass(frozen=True)
class _Loading:
    """Sensors of one mass on the structure: misfit in units of the noise, mass [kg], frequencies without them [Hz]."""

    misfit: float
    mass: float
    mass_std: float
    unloaded: Float[np.ndarray, "mode"]
    unloaded_std: Float[np.ndarray, "mode"]


def stated(model: ModalModel, comparison: Comparison, set_ups: SetUps) -> ModalModel:
    """The modes with the shifts of the set-ups; where these differ, the intervals hold the values of single set-ups."""
    own = shifts(comparison, set_ups, model)
    result = replace(model, set_ups=own, findings=(*model.findings, *_findings(own, model.name)))
    if not comparison.differ or not len(model.poles):
        return result
    nearest = np.argmin(np.abs(model.natural_frequencies[:, None] - comparison.frequency), axis=1)
    matched = np.abs(comparison.frequency[nearest] - model.natural_frequencies) < AGREEMENT * model.natural_frequencies
    between = np.where(matched[:, None], comparison.spread[nearest], 0.0)
    return widened(result, between, "the scatter between the set-ups")


def shifts(comparison: Comparison, set_ups: SetUps, model: ModalModel) -> SetUpShifts:
    """The shifts of the set-ups and what explains them; ``model`` are the modes of the aligned FRFs."""
    cause: ShiftCause = "none"
    loading = _mass(comparison, set_ups, model) if comparison.differ else None
    if comparison.differ:
        cause = _cause(comparison, loading)
    own = np.exp(comparison.logs) / comparison.frequency[:, None] - 1
    common, common_std = np.expm1(comparison.common), comparison.common_std
    if cause in ("mass loading", "unknown"):
        # Modes move by different amounts: the mean over the modes says what a set-up did on the whole.
        seen = np.maximum(np.count_nonzero(~np.isnan(own), axis=0), 1)
        common, common_std = np.nansum(own, axis=0) / seen, np.sqrt(np.nansum(comparison.std**2, axis=0)) / seen
    unknown = np.full(len(comparison.frequency), np.nan)
    if loading is None or cause != "mass loading":
        loading = _Loading(np.nan, np.nan, np.nan, unknown, unknown)
    return SetUpShifts(
        names=tuple(set_ups.names[k] for k in np.unique(set_ups.number)),
        frequencies=comparison.frequency,
        shifts=own.T,
        std=comparison.std.T,
        common=common,
        common_std=common_std,
        cause=cause,
        mass=loading.mass,
        mass_std=loading.mass_std,
        unloaded=loading.unloaded,
        unloaded_std=loading.unloaded_std,
    )


def _cause(comparison: Comparison, loading: _Loading | None) -> ShiftCause:
    """The simplest explanation of the shifts that is about as good as the best.

    Bayesian information criterion with a scale of the errors of its own (Schwarz 1978), that of the noise at least: of
    nothing in common, of one shift for each set-up, of one mass of all sensors.
    """
    modes, count = comparison.logs.shape
    cells = int(np.count_nonzero(~np.isnan(comparison.logs)))
    apart = float(
        np.nansum(((comparison.logs - means(comparison.logs, comparison.std)[:, None]) / comparison.std) ** 2)
    )
    ways: dict[ShiftCause, tuple[float, int]] = {
        "unknown": (apart, modes),
        "common shift": (common_shift(comparison.logs, comparison.std)[2], modes + count - 1),
    }
    if loading is not None:
        ways["mass loading"] = loading.misfit, modes + 1
    return min(
        ways,
        key=lambda way: cells * np.log(max(ways[way][0], cells - ways[way][1], 1.0)) + ways[way][1] * np.log(cells),
    )


def _mass(comparison: Comparison, set_ups: SetUps, model: ModalModel) -> _Loading | None:
    """Sensors of one mass on the DOFs of each set-up; ``None`` where shapes have no modal mass, or sensors do not rove.

    Shapes and mass follow from each other in turn (`_Sensors`). Modes outside the band are left out of that; what the
    coupling of those inside does to the mass says how much they may matter.
    """
    nearest = (
        np.argmin(np.abs(model.natural_frequencies[:, None] - comparison.frequency), axis=0) if len(model.poles) else []
    )
    sensor_rows = _sensor_rows(set_ups, model)
    if model.scaling != "unit modal mass" or sensor_rows is None or len(set(nearest)) < len(comparison.frequency):
        return None
    measured = model.shapes[:, nearest].real
    drive = np.array([row for _, row, _ in match(model.inputs, model.dofs)])
    sensors = _Sensors(comparison, sensor_rows, measured)
    for _ in range(_TURNS):
        mass, noise, left = sensors.best(coupled=True)
        sensors = _Sensors(comparison, sensor_rows, sensors.unloaded_shapes(measured, drive, mass))
    mass, noise, left = sensors.best(coupled=True)
    cells = int(np.count_nonzero(~np.isnan(comparison.logs)))
    level = max(left / max(cells - len(comparison.frequency) - 1, 1), 1.0)
    std = float(np.hypot(np.sqrt(level) * noise, mass - sensors.best(coupled=False)[0]))
    without = means(comparison.logs - sensors.change(mass), comparison.std)
    slope = (means(comparison.logs - sensors.change(mass + std), comparison.std) - without) / std
    own_variance = level / np.sum(np.nan_to_num(1 / comparison.std**2), axis=1)
    unloaded = np.exp(without)
    return _Loading(left, mass, std, unloaded, unloaded * np.sqrt(own_variance + (slope * std) ** 2))


@dataclass(frozen=True)
class _Sensors:
    """Sensors of one mass m on a structure with ``shapes`` Phi of unit modal mass, on ``sensor_rows`` in each set-up.

    The loaded structure has the eigenvalues and eigenvectors T of diag(w^2) over I + m Phi_k^T Phi_k, with the rows of
    the sensors of set-up k, and the shapes Phi T.
    """

    comparison: Comparison
    sensor_rows: list[np.ndarray]
    shapes: Float[np.ndarray, "dof mode"]

    def _grams(self) -> Float[np.ndarray, "set_up mode mode"]:
        return np.array([self.shapes[rows].T @ self.shapes[rows] for rows in self.sensor_rows])

    def change(self, mass: float, coupled: bool = True) -> Float[np.ndarray, "mode set_up"]:
        """Logarithms of the frequencies with sensors over those without; on request mode by mode."""
        if not coupled:
            return -0.5 * np.log1p(mass * np.diagonal(self._grams(), axis1=1, axis2=2).T)
        return np.array([own for own, _ in self._loaded(mass)]).T

    def _loaded(self, mass: float) -> list[tuple[np.ndarray, np.ndarray]]:
        """For each set-up the logarithms of the frequencies over those without sensors, and the transformation T."""
        frequency, result = self.comparison.frequency, []
        rank = np.argsort(np.argsort(frequency))
        for gram in self._grams():
            values, vectors = scipy.linalg.eigh(np.diag(frequency**2), np.eye(len(frequency)) + mass * gram)
            vectors = vectors[:, rank]
            result.append((0.5 * np.log(values[rank]) - np.log(frequency), vectors * np.sign(np.diagonal(vectors))))
        return result

    def best(self, coupled: bool) -> tuple[float, float, float]:
        """Mass by weighted least squares, its standard deviation by noise, and what is left."""
        comparison, seen = self.comparison, ~np.isnan(self.comparison.logs)

        def residual(mass: Float[np.ndarray, "1"]) -> Float[np.ndarray, "value"]:
            free = comparison.logs - self.change(float(mass[0]), coupled)
            return np.asarray(((free - means(free, comparison.std)[:, None]) / comparison.std)[seen])

        size = 1 / np.max(np.diagonal(self._grams(), axis1=1, axis2=2))
        solved = scipy.optimize.least_squares(residual, [1e-3 * size], bounds=([0.0], [size]), x_scale=[1e-3 * size])
        return float(solved.x[0]), 1 / max(float(np.linalg.norm(solved.jac)), 1e-300), float(2 * solved.cost)

    def unloaded_shapes(
        self, measured: Float[np.ndarray, "dof mode"], drive: Int[np.ndarray, "point"], mass: float
    ) -> Float[np.ndarray, "dof mode"]:
        """Shapes without sensors, from measured ones: those of each set-up are loaded there, and have the scale of the
        drive points in the set-up that these were measured in.
        """
        result = np.empty(measured.shape)
        loaded = [self.shapes @ turn for _, turn in self._loaded(mass)]
        set_up_of = np.array([next(k for k, rows in enumerate(self.sensor_rows) if point in rows) for point in drive])
        reference = np.array([loaded[k][point] for k, point in zip(set_up_of, drive, strict=True)])
        for (_, turn), own, rows in zip(self._loaded(mass), loaded, self.sensor_rows, strict=True):
            ratio = np.sum(own[drive] * reference, axis=0) / np.sum(reference**2, axis=0)
            result[rows] = np.linalg.solve(turn.T, (measured[rows] / ratio).T).T
        return result


def _sensor_rows(set_ups: SetUps, model: ModalModel) -> list[np.ndarray] | None:
    """Rows of the shapes on which the sensors of each set-up sit; ``None`` where forces rove and not the sensors."""
    number = set_ups.number
    if not np.all(number == number[:, :1]) or len(number) != len(model.dofs):
        return None
    return [np.flatnonzero(number[:, 0] == one) for one in np.unique(number)]


def _findings(shifts: SetUpShifts, name: str) -> tuple[Finding, ...]:
    """What the set-ups say of each other."""
    where = name or "fit"
    largest = int(np.argmax(np.abs(shifts.common)))
    half = COVERAGE_FACTOR * shifts.common_std
    listed = "; ".join(
        f"{label} {_rounded(100 * value, 100 * own, '+')} %"
        for label, value, own in zip(shifts.names, shifts.common, half, strict=True)
    )
    if shifts.cause == "none":
        text = f"The natural frequencies of the set-ups agree within their noise; relative to their mean: {listed}."
        return (Finding("info", "setup-shift", where, text, float(shifts.common[largest]), float(half[largest])),)
    if shifts.cause == "mass loading":
        loaded, free = shifts.frequencies, shifts.unloaded
        mass = _rounded(1e3 * shifts.mass, 1e3 * COVERAGE_FACTOR * shifts.mass_std)
        worst = int(np.argmax(np.abs(loaded / free - 1)))
        return (
            Finding.of(
                "warning",
                "mass-loading",
                where,
                "The natural frequencies of the set-ups differ as sensors of {mass} g each make them: "
                "without them mode {mode} is at {free} Hz instead of {loaded} Hz. Frequencies are means over "
                "the set-ups.",
                shifts.mass,
                advice=(
                    "Use lighter sensors or dummy masses in the places of those that are moved; the frequencies "
                    "without sensors are in the statement on the set-ups."
                ),
                mass=mass,
                mode=worst + 1,
                free=f"{free[worst]:.6g}",
                loaded=f"{loaded[worst]:.6g}",
            ),
        )
    manner = (
        "by one factor for all modes, as by temperature" if shifts.cause == "common shift" else "without a common cause"
    )
    return (
        Finding(
            "warning",
            "setup-shift",
            where,
            f"The natural frequencies of the set-ups differ {manner}; relative to their mean: {listed}. The modes of "
            "each set-up were moved to the mean before they were fitted together; the intervals of the frequencies "
            "contain the scatter between the set-ups.",
            value=float(shifts.common[largest]),
            limit=float(half[largest]),
            advice="Keep the temperature and the boundary conditions, and leave all sensors or dummy masses in place.",
        ),
    )


def _rounded(value: float, half: float, sign: str = "") -> str:
    """A value with its interval, both rounded to two digits of the interval."""
    if not np.isfinite(half) or half <= 0:
        return f"{value:{sign}.4g} ± {half:.2g}"
    digits = max(0, 1 - int(np.floor(np.log10(half))))
    return f"{value:{sign}.{digits}f} ± {half:.{digits}f}"
