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
"""Turns of shapes and mass: each takes the error of the mass down by the relative shift of the frequencies."""


@dataclass(frozen=True)
class _Loading:
    """Sensors of one mass on the structure: what they leave unexplained, mass [kg], frequencies without them [Hz]."""

    left: float
    mass: float
    mass_std: float
    unloaded: Float[np.ndarray, "mode"]
    unloaded_std: Float[np.ndarray, "mode"]


def stated(model: ModalModel, found: Comparison, set_ups: SetUps) -> ModalModel:
    """The modes with the shifts of the set-ups; where these differ, the intervals hold the values of single set-ups."""
    own = shifts(found, set_ups, model)
    result = replace(model, set_ups=own, findings=(*model.findings, *_findings(own, model.name)))
    if not found.differ or not len(model.poles):
        return result
    nearest = np.argmin(np.abs(model.natural_frequencies[:, None] - found.frequency), axis=1)
    matched = np.abs(found.frequency[nearest] - model.natural_frequencies) < AGREEMENT * model.natural_frequencies
    between = np.where(matched[:, None], found.spread[nearest], 0.0)
    return widened(result, between, "the scatter between the set-ups")


def shifts(found: Comparison, set_ups: SetUps, model: ModalModel) -> SetUpShifts:
    """The shifts of the set-ups and what explains them; ``model`` are the modes of the aligned FRFs."""
    cause: ShiftCause = "none"
    loading = _mass(found, set_ups, model) if found.differ else None
    if found.differ:
        cause = _cause(found, loading)
    own = np.exp(found.logs) / found.frequency[:, None] - 1
    common, common_std = np.expm1(found.common), found.common_std
    if cause in ("mass loading", "unknown"):
        # Modes move by different amounts: the mean over the modes says what a set-up did on the whole.
        seen = np.maximum(np.count_nonzero(~np.isnan(own), axis=0), 1)
        common, common_std = np.nansum(own, axis=0) / seen, np.sqrt(np.nansum(found.std**2, axis=0)) / seen
    unknown = np.full(len(found.frequency), np.nan)
    if loading is None or cause != "mass loading":
        loading = _Loading(np.nan, np.nan, np.nan, unknown, unknown)
    return SetUpShifts(
        names=tuple(set_ups.names[k] for k in np.unique(set_ups.number)),
        frequencies=found.frequency,
        shifts=own.T,
        std=found.std.T,
        common=common,
        common_std=common_std,
        cause=cause,
        mass=loading.mass,
        mass_std=loading.mass_std,
        unloaded=loading.unloaded,
        unloaded_std=loading.unloaded_std,
    )


def _cause(found: Comparison, loading: _Loading | None) -> ShiftCause:
    """The simplest explanation of the shifts that is about as good as the best.

    Bayesian information criterion with a scale of the errors of its own (Schwarz 1978), that of the noise at least: of
    nothing in common, of one shift for each set-up, of one mass of all sensors.
    """
    modes, count = found.logs.shape
    cells = int(np.count_nonzero(~np.isnan(found.logs)))
    apart = float(np.nansum(((found.logs - means(found.logs, found.std)[:, None]) / found.std) ** 2))
    ways: dict[ShiftCause, tuple[float, int]] = {
        "unknown": (apart, modes),
        "common shift": (common_shift(found.logs, found.std)[2], modes + count - 1),
    }
    if loading is not None:
        ways["mass loading"] = loading.left, modes + 1
    return min(
        ways,
        key=lambda way: cells * np.log(max(ways[way][0], cells - ways[way][1], 1.0)) + ways[way][1] * np.log(cells),
    )


def _mass(found: Comparison, set_ups: SetUps, model: ModalModel) -> _Loading | None:
    """Sensors of one mass on the DOFs of each set-up; ``None`` where shapes have no modal mass, or sensors do not rove.

    Shapes and mass follow from each other in turn (`_Sensors`). Modes outside the band are left out of that; what the
    coupling of those inside does to the mass says how much they may matter.
    """
    nearest = (
        np.argmin(np.abs(model.natural_frequencies[:, None] - found.frequency), axis=0) if len(model.poles) else []
    )
    seats = _seats(set_ups, model)
    if model.scaling != "unit modal mass" or seats is None or len(set(nearest)) < len(found.frequency):
        return None
    measured = model.shapes[:, nearest].real
    drive = np.array([row for _, row, _ in match(model.inputs, model.dofs)])
    sensors = _Sensors(found, seats, measured)
    for _ in range(_TURNS):
        mass, noise, left = sensors.best(coupled=True)
        sensors = _Sensors(found, seats, sensors.free_shapes(measured, drive, mass))
    mass, noise, left = sensors.best(coupled=True)
    cells = int(np.count_nonzero(~np.isnan(found.logs)))
    level = max(left / max(cells - len(found.frequency) - 1, 1), 1.0)
    std = float(np.hypot(np.sqrt(level) * noise, mass - sensors.best(coupled=False)[0]))
    without = means(found.logs - sensors.change(mass), found.std)
    slope = (means(found.logs - sensors.change(mass + std), found.std) - without) / std
    own_variance = level / np.sum(np.nan_to_num(1 / found.std**2), axis=1)
    unloaded = np.exp(without)
    return _Loading(left, mass, std, unloaded, unloaded * np.sqrt(own_variance + (slope * std) ** 2))


@dataclass(frozen=True)
class _Sensors:
    """Sensors of one mass m on a structure with ``shapes`` Phi of unit modal mass, on rows ``seats`` in each set-up.

    The loaded structure has the eigenvalues and eigenvectors T of diag(w^2) over I + m Phi_k^T Phi_k, with the rows of
    the sensors of set-up k, and the shapes Phi T.
    """

    found: Comparison
    seats: list[np.ndarray]
    shapes: Float[np.ndarray, "dof mode"]

    def _grams(self) -> Float[np.ndarray, "set_up mode mode"]:
        return np.array([self.shapes[rows].T @ self.shapes[rows] for rows in self.seats])

    def change(self, mass: float, coupled: bool = True) -> Float[np.ndarray, "mode set_up"]:
        """Logarithms of the frequencies with sensors over those without; on request mode by mode."""
        if not coupled:
            return -0.5 * np.log1p(mass * np.diagonal(self._grams(), axis1=1, axis2=2).T)
        return np.array([own for own, _ in self._loaded(mass)]).T

    def _loaded(self, mass: float) -> list[tuple[np.ndarray, np.ndarray]]:
        """For each set-up the logarithms of the frequencies over those without sensors, and the transformation T."""
        frequency, result = self.found.frequency, []
        rank = np.argsort(np.argsort(frequency))
        for gram in self._grams():
            values, vectors = scipy.linalg.eigh(np.diag(frequency**2), np.eye(len(frequency)) + mass * gram)
            vectors = vectors[:, rank]
            result.append((0.5 * np.log(values[rank]) - np.log(frequency), vectors * np.sign(np.diagonal(vectors))))
        return result

    def best(self, coupled: bool) -> tuple[float, float, float]:
        """Mass by weighted least squares, its standard deviation by noise, and what is left."""
        found, seen = self.found, ~np.isnan(self.found.logs)

        def residual(mass: Float[np.ndarray, "1"]) -> Float[np.ndarray, "value"]:
            free = found.logs - self.change(float(mass[0]), coupled)
            return np.asarray(((free - means(free, found.std)[:, None]) / found.std)[seen])

        size = 1 / np.max(np.diagonal(self._grams(), axis1=1, axis2=2))
        solved = scipy.optimize.least_squares(residual, [1e-3 * size], bounds=([0.0], [size]), x_scale=[1e-3 * size])
        return float(solved.x[0]), 1 / max(float(np.linalg.norm(solved.jac)), 1e-300), float(2 * solved.cost)

    def free_shapes(
        self, measured: Float[np.ndarray, "dof mode"], drive: Int[np.ndarray, "point"], mass: float
    ) -> Float[np.ndarray, "dof mode"]:
        """Shapes without sensors, from measured ones: those of each set-up are loaded there, and have the scale of the
        drive points in the set-up that these were measured in.
        """
        result = np.empty(measured.shape)
        loaded = [self.shapes @ turn for _, turn in self._loaded(mass)]
        home = np.array([next(k for k, rows in enumerate(self.seats) if point in rows) for point in drive])
        at_home = np.array([loaded[k][point] for k, point in zip(home, drive, strict=True)])
        for (_, turn), own, rows in zip(self._loaded(mass), loaded, self.seats, strict=True):
            ratio = np.sum(own[drive] * at_home, axis=0) / np.sum(at_home**2, axis=0)
            result[rows] = np.linalg.solve(turn.T, (measured[rows] / ratio).T).T
        return result


def _seats(set_ups: SetUps, model: ModalModel) -> list[np.ndarray] | None:
    """Rows of the shapes on which the sensors of each set-up sit; ``None`` where forces rove and not the sensors."""
    number = set_ups.number
    if not np.all(number == number[:, :1]) or len(number) != len(model.dofs):
        return None
    return [np.flatnonzero(number[:, 0] == one) for one in np.unique(number)]


def _findings(found: SetUpShifts, name: str) -> tuple[Finding, ...]:
    """What the set-ups say of each other."""
    where = name or "fit"
    largest = int(np.argmax(np.abs(found.common)))
    half = COVERAGE_FACTOR * found.common_std
    listed = "; ".join(
        f"{label} {100 * value:+.4f} ± {100 * own:.2g} %"
        for label, value, own in zip(found.names, found.common, half, strict=True)
    )
    if found.cause == "none":
        text = f"The natural frequencies of the set-ups agree within their noise; relative to their mean: {listed}."
        return (Finding("info", "setup-shift", where, text, float(found.common[largest]), float(half[largest])),)
    if found.cause == "mass loading":
        loaded, free = found.frequencies, found.unloaded
        worst = int(np.argmax(np.abs(loaded / free - 1)))
        return (
            Finding(
                "warning",
                "mass-loading",
                where,
                f"The natural frequencies of the set-ups differ as sensors of {1e3 * found.mass:.3g} ± "
                f"{1e3 * COVERAGE_FACTOR * found.mass_std:.2g} g each make them: without them mode {worst + 1} is at "
                f"{free[worst]:.6g} Hz instead of {loaded[worst]:.6g} Hz. Frequencies are means over the set-ups.",
                value=found.mass,
                advice="Use lighter sensors or dummy masses in the places of those that are moved; the frequencies "
                "without sensors are in the statement on the set-ups.",
            ),
        )
    why = (
        "by one factor for all modes, as by temperature"
        if found.cause == "common shift"
        else "in a way of its own each"
    )
    return (
        Finding(
            "warning",
            "setup-shift",
            where,
            f"The natural frequencies of the set-ups differ {why}; relative to their mean: {listed}. The modes of each "
            "set-up were moved to the mean before they were fitted together; intervals of frequencies hold the scatter "
            "between the set-ups.",
            value=float(found.common[largest]),
            limit=float(half[largest]),
            advice="Keep the temperature and the boundary conditions, and leave all sensors or dummy masses in place.",
        ),
    )
