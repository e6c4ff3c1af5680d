"""Posterior of a joint law as one mode sees it, with a model-form discrepancy that grows beyond the data.

In relative terms (over the measured loss eta) the data of one channel are

    y_i / eta_i = (H_i b) / eta_i + delta(t_i) + noise,        t = ln(a / a_1)

H b is the law (``modal_laws``; linear in b = (lambda_0, eta_0, kappa_1, ..., c)) with a spring that hardens or softens
with the cube of the motion beside it (c a^2 in lambda alone: Krack and Gross 2019, Sec. 2.4), delta a Gaussian process
that is 0 at the lowest level and whose variance grows with the distance in log amplitude: a Wiener process, plus its
integral for what keeps a direction (Kennedy and O'Hagan 2001; Brynjarsdottir and O'Hagan 2014). b is integrated out
exactly; a_s, the shapes, the scales of delta and whether there is a cubic spring are quasi-random draws from their
priors with importance weights. Levels are ordered, so one Cholesky factor serves every number of lowest levels: leaving
the highest out costs nothing more (Buerkner, Gabry and Vehtari 2020).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from ema.compare.modal_laws import ModalLaw

DRAWS = 2048
"""Draws for a law, from its prior and about its posterior."""
DISCREPANCY = ((0.1, 0.05), 1.2)
"""Medians for lambda and eta, and spread of the logarithm, of the discrepancy after one unit of log amplitude, over the
loss. Set with 60 joints of ``tests/bench/synthetic_joints`` (seeds 1000 to 1059), measured with others."""
DIRECTION = 1.0
"""Weight of the integrated Wiener process in the discrepancy."""
_SLIP_RANGE = (-6.0, 5.0)
"""Logarithm of the highest amplitude over a_s: from hardly any slip to slip nearly everywhere."""
_LINEAR = (20.0, 1.0, 2.0)
"""Prior standard deviation of lambda_0, eta_0 and of the loss of a joint, over the loss at the highest level (the first
two), and up to ``_REACH`` times the highest amplitude."""
_REACH = 2.0
_CUBIC, _WITH_CUBIC = 0.5, 0.5
"""Prior standard deviation of what a conservative nonlinearity adds to lambda at the highest level, over the loss
there, and the probability that there is one: contact that closes or opens with the motion, or a structure that
stretches, which no friction law describes. With 1.0 in place of 0.5, bands of the frequency at twice the highest level
hold 93 % of the 60 joints that the discrepancy was set with; without the spring, 87 to 100 % of those with a gap."""
_NONE = 1e-6
"""The same standard deviation where there is none: far below what any frequency shows."""
_NUGGET = 1e-8
"""Variance that is added to the diagonal of a kernel, relative: a safeguard against rounding in its factors."""
_ENOUGH = 300
"""Effective draws below which another set is drawn about the last one."""
FEWEST = 50
"""Effective draws below which an interval of a parameter is not believed: its bounds rest on one or two draws."""
_ROUNDS, _TEMPERED = 10, 30
"""Most proposals after the prior, and the effective draws about which each of them is made."""
_LARGEST = 20.0
"""Logarithm up to which a discrepancy multiplies a loss: a factor beyond all bands, which no float ends at."""
_KERNELS, _WIDTH, _DEFENSIVE = 150, 0.5, 0.25
"""Kernels of a proposal, their width over the posterior's, and the share that stays with the prior."""


@dataclass(frozen=True)
class Observations:
    """Levels of one mode as the posterior takes them, sorted by amplitude.

    ``distance`` (level,) is ln(a / a_1); ``values`` and ``std`` (2, level) are lambda and eta.
    """

    distance: Float[np.ndarray, "level"]
    values: Float[np.ndarray, "2 level"]
    std: Float[np.ndarray, "2 level"]


def discrepancy_covariance(distance: Float[np.ndarray, "level"], direction: float) -> Float[np.ndarray, "level level"]:
    """Covariance of the discrepancy of unit scale: a Wiener process from the lowest level on, to either side, and
    ``direction`` times its integral."""
    size, same = np.abs(distance), np.sign(distance)[:, None] * np.sign(distance) >= 0
    low, high = np.minimum(size[:, None], size), np.maximum(size[:, None], size)
    return np.where(same, low + direction * low**2 * (3 * high - low) / 6, 0.0)


@dataclass(frozen=True)
class LawPosterior:
    """One law, the data, and the amplitudes ``targets`` (ln(a / a_1)) at which it is to be predicted."""

    law: ModalLaw
    data: Observations
    targets: Float[np.ndarray, "target"]
    unit: Float[np.ndarray, "draw parameter"]
    log_proposal: Float[np.ndarray, "draw"]
    discrepancy: tuple[tuple[float, float], float] = DISCREPANCY
    direction: float = DIRECTION

    @property
    def draws(self) -> int:
        """Number of draws of the parameters in which the law is not linear."""
        return len(self.unit)

    @cached_property
    def nonlinear(self) -> dict[str, np.ndarray]:
        """Parameters: ``scale`` (draw, spring) ln(a_max / a_s), ``shapes`` (draw, shape), ``sigma`` (draw, 2),
        and whether there is a cubic spring, ``cubic`` (draw,)."""
        from scipy.stats import norm

        law, springs, unit = self.law, self.law.springs if self.law.scaled else 0, self.unit
        low, high = _SLIP_RANGE
        scale = np.sort(low + (high - low) * unit[:, :springs], axis=1)
        ends = np.array([(shape.low, shape.high) for shape in law.shapes]).reshape(-1, 2)
        shapes = ends[:, 0] + (ends[:, 1] - ends[:, 0]) * unit[:, springs:-3]
        median, spread = self.discrepancy
        sigma = np.array(median) * np.exp(spread * norm.ppf(np.clip(unit[:, -3:-1], 1e-9, 1 - 1e-9)))
        return {"scale": scale, "shapes": shapes, "sigma": sigma, "cubic": unit[:, -1] < _WITH_CUBIC}

    def parameters(self) -> tuple[tuple[str, ...], Float[np.ndarray, "draw parameter"], list[tuple[float, float]]]:
        """Names, values and ranges of the parameters in which the law is not linear."""
        drawn, count = self.nonlinear, self.law.springs if self.law.scaled else 0
        several = [f" of spring {n + 1}" for n in range(count)] if count > 1 else [""] * count
        names = tuple(f"ln a_max/a_s{which}" for which in several) + tuple(shape.name for shape in self.law.shapes)
        ends = [_SLIP_RANGE] * count + [(shape.low, shape.high) for shape in self.law.shapes]
        return names, np.concatenate([drawn["scale"], drawn["shapes"]], axis=1), ends

    @cached_property
    def design(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows of lambda and eta (draw, 2, level, linear) at levels and targets, and the prior std (draw, linear)."""
        drawn, data = self.nonlinear, self.data
        distance = np.concatenate([data.distance, self.targets])
        top, loss = data.distance[-1], data.values[1].max()
        scale = drawn["scale"] if self.law.scaled else np.zeros((self.draws, 1))
        springs = scale.shape[1]
        rows = np.zeros((self.draws, 2, len(distance), 3 + springs))
        rows[:, 0, :, 0] = rows[:, 1, :, 1] = 1.0
        # a restoring force k3 x^3 adds 3/4 k3 a^2 to the stiffness and nothing to the loss
        rows[:, 0, :, -1] = np.exp(2 * (distance - top))
        std = np.empty((self.draws, 3 + springs))
        std[:, -1] = np.where(drawn["cubic"], _CUBIC, _NONE) * loss
        std[:, :2] = _LINEAR[0] * loss, _LINEAR[1] * data.values[1, 0]
        for n in range(springs):
            amplitude = np.exp(scale[:, n : n + 1] + distance - top)
            lost, d = self.law.curves(amplitude, drawn["shapes"])
            rows[:, 0, :, 2 + n], rows[:, 1, :, 2 + n] = -lost, d
            reach = self.law.curves(_REACH * np.exp(scale[:, n : n + 1]), drawn["shapes"])[1][:, 0]
            highest = np.maximum(d[:, : len(data.distance)].max(axis=1), reach)
            std[:, 2 + n] = _LINEAR[2] * loss / np.maximum(highest, 1e-6)
        return rows, std

    @cached_property
    def whitened(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Cholesky factors (draw, 2, n, n) of the relative covariance at levels and targets, and what whitens of
        the data (draw, 2, level) and of the design (draw, 2, level, linear)."""
        data, sigma = self.data, self.nonlinear["sigma"]
        levels = len(data.distance)
        kernel = discrepancy_covariance(np.concatenate([data.distance, self.targets]), self.direction)
        noise = np.full((2, len(kernel)), _NUGGET)
        noise[:, :levels] += (data.std / data.values[1]) ** 2
        covariance = sigma[:, :, None, None] ** 2 * kernel + noise[:, :, None] * np.eye(len(kernel))
        factor = np.linalg.cholesky(covariance)
        rows = self.design[0][:, :, :levels] / data.values[1][:, None]
        y = np.broadcast_to(data.values / data.values[1], (self.draws, 2, levels))
        both = np.concatenate([y[..., None], rows], axis=-1)
        solved = np.linalg.solve(factor[:, :, :levels, :levels], both)
        return factor, solved[..., 0], solved[..., 1:]

    def given(self, lowest: int) -> "Conditional":
        """The posterior given the ``lowest`` levels alone."""
        from scipy.stats import norm

        factor, y, rows = self.whitened
        y, rows = y[:, :, :lowest], rows[:, :, :lowest]
        std = self.design[1]
        precision = np.einsum("dcli,dclj->dij", rows, rows) + np.eye(std.shape[1]) / std[:, None] ** 2
        mean0 = np.zeros_like(std)
        mean0[:, 0], mean0[:, 1] = self.data.values[0, 0], 0.5 * self.data.values[1, 0]
        right = np.einsum("dcli,dcl->di", rows, y) + mean0 / std**2
        root = np.linalg.cholesky(precision)
        mean = np.linalg.solve(precision, right[..., None])[..., 0]
        misfit = np.sum(y**2, axis=(1, 2)) + np.sum((mean0 / std) ** 2, axis=1) - np.sum(right * mean, axis=1)
        logs = np.log(np.diagonal(factor, axis1=2, axis2=3)[:, :, :lowest]).sum(axis=(1, 2))
        spread = np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1) + np.log(std).sum(axis=1)
        covariance = np.linalg.inv(precision)
        sd = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        # losses and shares of stiffness are positive: what the Gaussian leaves below 0 does not count
        positive = norm.logcdf(mean[:, 1:-1] / sd[:, 1:-1]).sum(axis=1)
        weights = -0.5 * misfit - logs - spread + positive - self.log_proposal
        return Conditional(self, lowest, mean, covariance, weights)


def posterior(
    law: ModalLaw,
    data: Observations,
    targets: Float[np.ndarray, "target"],
    *,
    seed: int = 1,
    draws: int = DRAWS,
    **prior: Any,
) -> LawPosterior:
    """Draws for a law: from the prior, and where these are few about the posterior, from a mixture about those.

    The mixture keeps a part of the prior (defensive importance sampling, Hesterberg 1995), so that the weights are
    bounded also for the posteriors given the lowest levels alone.
    """
    from scipy.stats import qmc

    count = (law.springs if law.scaled else 0) + len(law.shapes) + 3
    prior_draws = qmc.Sobol(count, seed=seed).random(draws)
    near, generator = int((1 - _DEFENSIVE) * draws), np.random.default_rng(seed)
    drawn = LawPosterior(law, data, targets, prior_draws, np.zeros(draws), **prior)
    for _ in range(_ROUNDS):
        fitted = drawn.given(len(data.distance))
        if fitted.effective_draws >= _ENOUGH:
            break
        weights = _tempered(fitted.log_weights)
        centres = drawn.unit[generator.choice(drawn.draws, size=_KERNELS, p=weights)]
        spread = np.sqrt(weights @ (drawn.unit - weights @ drawn.unit) ** 2)
        width = np.clip(_WIDTH * spread, 1e-5, 0.3)
        local = centres[generator.integers(0, _KERNELS, near)] + width * generator.standard_normal((near, count))
        # what falls outside the prior is no draw of the posterior
        unit = np.concatenate([prior_draws[: draws - near], local[((local > 0) & (local < 1)).all(axis=1)]])
        off = np.sum(((unit[:, None] - centres[None]) / width) ** 2, axis=-1)
        kernel = np.exp(-0.5 * off).mean(axis=1) / np.prod(np.sqrt(2 * np.pi) * width)
        drawn = LawPosterior(law, data, targets, unit, np.log(_DEFENSIVE + (1 - _DEFENSIVE) * kernel), **prior)
    return drawn


def _tempered(log_weights: Float[np.ndarray, "draw"]) -> Float[np.ndarray, "draw"]:
    """Weights to the largest power up to 1 that leaves ``_TEMPERED`` effective draws."""
    relative = log_weights - log_weights.max()
    power = 1.0
    while True:
        weights = np.exp(power * relative)
        weights /= weights.sum()
        if 1 / np.sum(weights**2) >= _TEMPERED or power < 1e-3:
            return np.asarray(weights)
        power *= 0.8


@dataclass(frozen=True)
class Conditional:
    """A law given the lowest levels: ``mean`` (draw, linear) and ``covariance`` of its linear parameters, and the
    logarithms of the weights of its draws."""

    posterior: LawPosterior
    lowest: int
    mean: Float[np.ndarray, "draw linear"]
    covariance: Float[np.ndarray, "draw linear linear"]
    log_weights: Float[np.ndarray, "draw"]

    @cached_property
    def weights(self) -> Float[np.ndarray, "draw"]:
        """Weights of the draws, sum 1."""
        weights = np.exp(self.log_weights - self.log_weights.max())
        return np.asarray(weights / weights.sum())

    @property
    def effective_draws(self) -> float:
        """Kish's effective number of draws."""
        return float(1 / np.sum(self.weights**2))

    def _loss(self, index: np.ndarray, law: np.ndarray, fitted: np.ndarray) -> np.ndarray:
        """Loss (draw, index) that the discrepancy is relative to: that of the law there (draw, index), times measured
        loss over that of the law at the levels (``fitted``, draw, level), interpolated in log amplitude.

        At a level it is the measured loss, as in the fit. Beyond, a law that gives half of what was measured is not
        taken for one that doubles: its discrepancy is carried on over what was measured, not over the half.
        """
        data, k = self.posterior.data, self.lowest
        known = data.distance[:k]
        every = np.concatenate([data.distance, self.posterior.targets])[index]
        between = np.stack([np.interp(every, known, row) for row in np.eye(k)])
        off = np.log(data.values[1, :k] / np.maximum(fitted, 1e-12))
        return np.asarray(np.maximum(law, 1e-12) * np.exp(off @ between))

    def _ahead(self, index: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Of a level or target: mean (draw, 2) without the linear parameters, their rows (draw, 2, linear), the
        variance left (draw, 2), all over the loss there, and this loss (draw,)."""
        factor, y, rows = self.posterior.whitened
        k, line = self.lowest, factor[:, :, index]
        design = self.posterior.design[0][:, :, index]
        losses = np.einsum("dli,di->dl", self.posterior.design[0][:, 1, [*range(k), index]], self.mean)
        scale = self._loss(np.array([index]), losses[:, k:], losses[:, :k])[:, 0]
        left = np.sum(line[:, :, k:] ** 2, axis=-1)
        base = np.einsum("dcl,dcl->dc", line[:, :, :k], y[:, :, :k])
        ahead = design / scale[:, None, None] - np.einsum("dcl,dcli->dci", line[:, :, :k], rows[:, :, :k])
        return base, ahead, left, scale

    def log_density(self, index: int) -> float:
        """Logarithm of the predictive density of the measured level ``index``, both channels."""
        base, ahead, left, scale = self._ahead(index)
        spread = np.einsum("dci,dij,dkj->dck", ahead, self.covariance, ahead)
        spread[:, 0, 0] += left[:, 0]
        spread[:, 1, 1] += left[:, 1]
        off = self.posterior.data.values[:, index] / scale[:, None] - base - np.einsum("dci,di->dc", ahead, self.mean)
        determinant = spread[:, 0, 0] * spread[:, 1, 1] - spread[:, 0, 1] ** 2
        square = (
            spread[:, 1, 1] * off[:, 0] ** 2
            - 2 * spread[:, 0, 1] * off[:, 0] * off[:, 1]
            + spread[:, 0, 0] * off[:, 1] ** 2
        ) / determinant
        log = -0.5 * square - 0.5 * np.log(determinant) - np.log(2 * np.pi) - 2 * np.log(scale) + self.log_weights
        top = log.max()
        return float(top + np.log(np.exp(log - top).sum()) - np.log(np.exp(self.log_weights - top).sum()))

    def sample(self, index: np.ndarray, count: int, generator: np.random.Generator, *, form: bool = True) -> np.ndarray:
        """Draws of lambda and eta (count, 2, index) at levels or targets given by ``index``.

        ``form`` : with the model-form discrepancy; without it, the law and its parameters alone.
        """
        out = np.empty((0, 2, len(index)))
        factor, y, rows = self.posterior.whitened
        k = self.lowest
        root = _root(self.covariance)
        for _ in range(20):
            some = generator.choice(len(self.weights), size=2 * count, p=self.weights)
            b = self.mean[some] + np.einsum(
                "dij,dj->di", root[some], generator.standard_normal((len(some), root.shape[1]))
            )
            design = self.posterior.design[0][some][:, :, index]
            law = np.einsum("dcti,di->dct", design, b)
            good = (b[:, 1:-1] >= 0).all(axis=1) & (law > 0).all(axis=(1, 2))
            if form:
                white = generator.standard_normal((len(some), 2, factor.shape[-1]))
                line = factor[some][:, :, index]
                known = y[some][:, :, :k] - np.einsum("dcli,di->dcl", rows[some][:, :, :k], b)
                loss = self._loss(
                    index, law[:, 1], np.einsum("dli,di->dl", self.posterior.design[0][some][:, 1, :k], b)
                )
                conditional = law + loss[:, None] * np.einsum("dctl,dcl->dct", line[..., :k], known)
                good &= (conditional > 0).all(axis=(1, 2))
                new = np.einsum("dctl,dcl->dct", line[..., k:], white[:, :, k:])
                # a loss stays positive
                eta = conditional[:, 1] * np.exp(np.clip(new[:, 1], -_LARGEST, _LARGEST))
                law = np.stack([conditional[:, 0] + loss * new[:, 0], eta], axis=1)
                good &= (law > 0).all(axis=(1, 2))
            out = np.concatenate([out, law[good]])
            if len(out) >= count:
                break
        return out[:count]


_LEAST = 1e-12
"""Least eigenvalue of a correlation matrix: what digits are left of smaller ones where levels hold next to no noise."""


def _root(covariance: np.ndarray) -> np.ndarray:
    """Lower roots (draw, n, n) of covariance matrices (draw, n, n) that rounding may have left indefinite."""
    scale = np.sqrt(np.maximum(np.einsum("dii->di", covariance), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(covariance / (scale[:, :, None] * scale[:, None, :]))
    definite = np.einsum("dij,dj,dkj->dik", vectors, np.maximum(values, _LEAST), vectors)
    return np.asarray(scale[:, :, None] * np.linalg.cholesky(definite))
