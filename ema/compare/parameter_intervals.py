"""Intervals of joint parameters that hold although the law is only nearly right, and which parameters they determine.

Near the optimum the data are y = J (theta - theta_0) + c + delta + noise: logarithms of damping ratio and frequency at
all points, c a common error of the frequencies, delta what the law gets wrong (Kennedy and O'Hagan 2001; Brynjarsdottir
and O'Hagan 2014). Three parts of delta:

- What other laws of the same mu and k_T give. Masing springs in parallel make every law without a rate (Iwan 1966);
  the model is simulated with twenty of them (``other_laws``), and delta is a combination of the differences. They are
  small where a joint sticks and where it slips altogether, as mu and k_T are defined there: a map that reaches these
  ends determines them whatever the law, one that does not, does not.
- What a friction coefficient does that changes with the normal force, as where the area of contact does not grow in
  proportion to it: mu ~ F_N^g about the middle of the forces, g normal with mean zero (``FRICTION_GROWTH``).
- A Gaussian process over the load, 0 at the lowest slip: a Wiener process and its integral in the logarithm of
  amplitude over normal force, and another in that of the normal force, with the prior that levels are predicted with
  (``modal_posterior.DISCREPANCY``).

Both scales are averaged over with the weights that the data give them: a law that fits far better than others of its
kind would is rewarded, one that leaves structure has wide intervals, and three numbers that fit four are not taken for
knowledge of the law.

A soft spring that slips at no load of the map is far from that Gaussian: it may carry most of the slip force, and no
map excludes one that is soft enough. So the law beside a soft spring (``hidden_springs``) is fitted to the map too, and
the profile of a parameter is taken over these laws: it holds what any of them makes of the map that explains it as
well.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from ema.compare.modal_posterior import DIRECTION, DISCREPANCY, discrepancy_covariance
from ema.data import FrictionLaw

_NODES = 5
"""Scales of the process over the load that are averaged over: quantiles of their prior."""
_SHARES = (0.0, 0.1, 0.2, 0.4, 0.8, 1.6)
"""Scales of the differences to other laws, of equal weight beforehand: 0 is a law that is right, 1 one as another."""
_COMMON = 0.05
"""Prior standard deviation of the logarithm of the common error of the frequencies: 5 % of a host's."""
_CHI_SQUARE = 3.841
"""Rise of chi-square at the end of a 95 % interval of one parameter."""
_OPEN = 0.5
"""Share of that rise below which the profile of a parameter counts as open at the end of its interval."""
PROFILE_DISTANCES = (1.0, 1.6, 2.5, 4.0)
"""Distances, over the half width of the interval, at which a profile is asked whether it has closed."""
_CHANCE = 0.01
"""Chance with which any parameter of a law that is right disagrees with the rest when one level is left out."""
FRICTION_GROWTH = 0.1
"""Standard deviation of the exponent of mu over F_N beforehand. Friction is as the area of contact (Bowden and Tabor
1950): 0 where that is proportional to the force (Archard 1957), -1/3 of a smooth sphere (Hertz). A map over several
normal forces tells it, one of a single one has no part of it."""
LOST = 5.0
"""Residual of a datum at which the model has no resonance, in standard deviations: beyond ``_ROBUST``, so that a search
that loses a point gains nothing by it. Whatever it is, no parameter is identifiable once a point is lost; with twice or
half of it, the misfit that is stated then is up to twice or half as large."""
_ROBUST = 3.0
"""Residual, in standard deviations, from which points lose weight (the scale of the loss of the search)."""

_LATE = ((0.1, 0.4), (0.1, 0.7), (0.25, 0.5), (0.25, 0.75))
"""Of a soft spring that slips late beside a stiff one: shares of the stiffness and of the slip force. Where no load of
a map makes it slip, mu is off by what it carries."""
_HIDDEN = ((0.05, 0.1, 0.2), (0.3, 0.5, 0.7))
"""Of a soft spring beside a law: shares of the stiffness, and of the slip force. A contact that carries half of the
slip force on less than a twentieth of the stiffness is taken for none: of springs whose shares are drawn alike
(Dirichlet, 2) it is one in a hundred. Of joints of two to four springs, five of 104 intervals called identifiable miss;
with 0.1 and 0.2 of the stiffness, 0.3 and 0.5 of the slip force alone, eight of 107."""
_STEPS, _BOLDEST, _LIKELY = 3, 0.7, 100.0
"""Steps at most with which another law is fitted, their greatest length, and the rise of chi-square after the first one
above which a law is dropped."""
_FINITE = 0.03
"""Step of its derivatives, as those of the fit."""
_POWERS, _FEW, _SPRINGS, _LAST = 8, 8, 12, 0.3
"""Laws of either family, springs of a power law, and the share of that which slips last."""

Estimate = tuple[np.ndarray, np.ndarray, float]
"""Parameters relative to the optimum, their covariance, and twice the logarithm of the marginal likelihood."""
Residuals = Callable[[np.ndarray], np.ndarray]
"""Residuals (2 point) of damping and frequency, logarithms, at given parameters; NaN without a resonance."""


@dataclass(frozen=True)
class LinearData:
    """The data near the optimum, without points at which the model has no resonance.

    Parameters
    ----------
    residuals : array of shape (2 point,)
        Measured less simulated ln zeta, then ln f without the common error.
    sensitivity : array of shape (2 point, parameter)
        Derivatives of the simulated values by the parameters, on their scales.
    std : array of shape (2 point,)
        Standard uncertainties of the residuals.
    log_load : array of shape (point,)
        ln(amplitude / F_N): how far the joint slips.
    log_normal_force : array of shape (point,)
        ln F_N.
    damping : array of shape (point,)
        Damping ratios [-].
    law_differences : array of shape (2 point, law)
        What other laws of the same mu and k_T add to ln zeta and ln f.
    friction_growth : array of shape (2 point,)
        What mu adds to ln zeta and ln f when it is as F_N^g, g = ``FRICTION_GROWTH``, and the same at the middle force.
    prior_mean : array of shape (parameter,)
        Mean of the prior, relative to the optimum.
    prior_std : float
        Its standard deviation.
    growth_offset : float
        The exponent g about which the data are, over ``FRICTION_GROWTH``.
    origin : tuple of (float, float)
        ``log_load`` and ``log_normal_force`` at which the law is taken for right: least slip, middle of the forces.
    """

    residuals: Float[np.ndarray, "datum"]
    sensitivity: Float[np.ndarray, "datum parameter"]
    std: Float[np.ndarray, "datum"]
    log_load: Float[np.ndarray, "point"]
    log_normal_force: Float[np.ndarray, "point"]
    damping: Float[np.ndarray, "point"]
    law_differences: Float[np.ndarray, "datum law"]
    friction_growth: Float[np.ndarray, "datum"]
    prior_mean: Float[np.ndarray, "parameter"]
    prior_std: float
    growth_offset: float
    origin: tuple[float, float]

    @property
    def innovations(self) -> Float[np.ndarray, "datum"]:
        """The residuals of a mu that does not change, to first order: the prior of the exponent g has its mean at 0."""
        return self.residuals + self.growth_offset * self.friction_growth

    def subset(self, kept: Bool[np.ndarray, "point"]) -> "LinearData":
        """Some of the points."""
        both = np.concatenate([kept, kept])
        return replace(
            self,
            residuals=self.residuals[both],
            sensitivity=self.sensitivity[both],
            std=self.std[both],
            log_load=self.log_load[kept],
            log_normal_force=self.log_normal_force[kept],
            damping=self.damping[kept],
            law_differences=self.law_differences[both],
            friction_growth=self.friction_growth[both],
        )

    def about(self, step: Float[np.ndarray, "parameter"]) -> "LinearData":
        """The same about parameters that lie a step from these."""
        return replace(self, residuals=self.residuals - self.sensitivity @ step, prior_mean=self.prior_mean - step)

    @cached_property
    def process_covariance(self) -> Float[np.ndarray, "point point"]:
        """Covariance of the process over load and normal force, of unit scale."""
        lowest, middle = self.origin
        over_load = discrepancy_covariance(self.log_load - lowest, DIRECTION)
        return np.asarray(over_load + discrepancy_covariance(self.log_normal_force - middle, DIRECTION))

    def covariance(self, law_share: float, process_scale: float) -> Float[np.ndarray, "datum datum"]:
        """Of the data, with the scale of the differences to other laws and that of the process."""
        return np.asarray(np.diag(self.std**2) + self.law_covariance(law_share, process_scale))

    def law_covariance(self, law_share: float, process_scale: float) -> Float[np.ndarray, "datum datum"]:
        """Of what the law gets wrong, and of the common error of the frequencies."""
        count, (of_stiffness, of_loss) = len(self.damping), DISCREPANCY[0]
        laws = self.law_differences
        total: np.ndarray = law_share**2 / max(laws.shape[1], 1) * laws @ laws.T
        total += np.outer(self.friction_growth, self.friction_growth)
        total[:count, :count] += (process_scale * of_loss) ** 2 * self.process_covariance
        # ln f = ln(lambda) / 2 for a change lambda of the stiffness over that of the mode, and the scale of lambda is
        # stated over the loss factor 2 zeta: of_stiffness is that of ln f over zeta
        per_damping = process_scale * of_stiffness * self.damping
        total[count:, count:] += np.outer(per_damping, per_damping) * self.process_covariance + _COMMON**2
        return total

    def growth(self, covariance: Float[np.ndarray, "datum datum"], estimate: Estimate) -> tuple[float, float]:
        """Mean and variance of the exponent g over ``FRICTION_GROWTH``, given the data with a covariance."""
        mean, spread, _ = estimate
        weights = np.linalg.solve(covariance, self.friction_growth)
        slopes = weights @ self.sensitivity
        variance = 1 - weights @ self.friction_growth + slopes @ spread @ slopes
        return float(weights @ (self.innovations - self.sensitivity @ mean)), float(max(variance, 0.0))

    def estimate(self, covariance: Float[np.ndarray, "datum datum"]) -> Estimate:
        """The parameters with a covariance of the data."""
        factor = np.linalg.cholesky(covariance)
        white = np.linalg.solve(factor, np.column_stack([self.innovations, self.sensitivity]))
        y, sensitivity = white[:, 0], white[:, 1:]
        information = sensitivity.T @ sensitivity + np.eye(sensitivity.shape[1]) / self.prior_std**2
        spread = np.linalg.inv(information)
        mean = spread @ (sensitivity.T @ y + self.prior_mean / self.prior_std**2)
        off = np.sum((y - sensitivity @ mean) ** 2) + np.sum((mean - self.prior_mean) ** 2) / self.prior_std**2
        sizes = 2 * np.sum(np.log(np.diag(factor))) + np.linalg.slogdet(information)[1]
        return mean, spread, float(-off - sizes)


@dataclass(frozen=True)
class ParameterPosterior:
    """Parameters relative to the optimum, and what the data may be off by.

    Parameters
    ----------
    mean : array of shape (parameter,)
        Means, on the scales of the parameters.
    covariance : array of shape (parameter, parameter)
        Covariance of the parameters.
    data_covariance : array of shape (2 point, 2 point)
        Covariance of the data: noise, common error, and what the law gets wrong.
    law_share, process_scale : float
        Rms over the posterior of the two scales of what the law gets wrong.
    misfit : float
        Rms of the whitened residuals.
    growth : tuple of (float, float)
        Mean and standard deviation of the exponent g of mu over F_N.
    """

    mean: Float[np.ndarray, "parameter"]
    covariance: Float[np.ndarray, "parameter parameter"]
    data_covariance: Float[np.ndarray, "datum datum"]
    law_share: float
    process_scale: float
    misfit: float
    growth: tuple[float, float]


def scale_weights(data: LinearData) -> tuple[Float[np.ndarray, "node 2"], Float[np.ndarray, "node"], list[Estimate]]:
    """Scales of what the law gets wrong, how much the data speak for each pair, and the estimates with each."""
    from scipy.stats import norm

    scales = np.exp(DISCREPANCY[1] * norm.ppf((np.arange(_NODES) + 0.5) / _NODES))
    nodes = np.array([(share, scale) for share in _SHARES for scale in scales])
    estimates = [data.estimate(data.covariance(*node)) for node in nodes]
    logs = 0.5 * np.array([likelihood for _, _, likelihood in estimates])
    weights = np.exp(logs - logs.max())
    return nodes, weights / weights.sum(), estimates


def posterior(data: LinearData) -> ParameterPosterior:
    """The parameters, averaged over the scales of what the law gets wrong."""
    nodes, weights, estimates = scale_weights(data)
    means = np.array([mean for mean, _, _ in estimates])
    mean = weights @ means
    off = means - mean
    covariance = np.einsum("n,nij->ij", weights, np.array([spread for _, spread, _ in estimates]))
    covariance += np.einsum("n,ni,nj->ij", weights, off, off)
    law_share, process_scale = np.sqrt(weights @ nodes**2)
    of_data = data.covariance(law_share, process_scale)
    white = np.linalg.solve(np.linalg.cholesky(of_data), data.innovations - data.sensitivity @ mean)
    misfit = float(np.sqrt(np.sum(white**2) / max(len(white) - len(mean), 1)))
    pairs = zip(nodes, estimates, strict=True)
    each = np.array([data.growth(data.covariance(*node), estimate) for node, estimate in pairs])
    growth = float(weights @ each[:, 0])
    spread = float(np.sqrt(weights @ (each[:, 1] + (each[:, 0] - growth) ** 2)))
    return ParameterPosterior(
        mean,
        covariance,
        of_data,
        float(law_share),
        float(process_scale),
        misfit,
        (FRICTION_GROWTH * growth, FRICTION_GROWTH * spread),
    )


def other_laws(law: FrictionLaw) -> list[FrictionLaw]:
    """Masing springs in parallel with the mu and the k_T of a law, which slip in other ways.

    Eight of them have a stiffness whose density over the slip force is a power from 0.1 to 1.9 (Segalman 2005, Eq. 10,
    there -1 to 0), with and without a share that slips last; the others have few springs of any size, and a soft spring
    that slips late.
    """
    from ema.simulate.friction import ParallelMasing

    shares = []
    for number, power in enumerate(np.linspace(0.1, 1.9, _POWERS)):
        phi, last = (np.arange(_SPRINGS) + 0.5) / _SPRINGS, _LAST * (number % 2)
        stiffness = phi**power / np.sum(phi**power)
        slip = np.append((1 - last) * stiffness * phi, last)
        shares.append((np.append((1 - last) * stiffness, last)[slip > 0], (slip / slip.sum())[slip > 0]))
    rng = np.random.default_rng(0)
    for number in range(_FEW):
        count = 2 + number % 3
        shares.append((rng.dirichlet(np.full(count, 2.0)), rng.dirichlet(np.full(count, 2.0))))
    shares += [(np.array([1 - soft, soft]), np.array([1 - late, late])) for soft, late in _LATE]
    others = []
    for stiffness, slip in shares:
        springs = ParallelMasing(law.friction_coefficient, law.contact_stiffness, stiffness.tolist(), slip.tolist())
        others.append(replace(law, name=springs.name, parameters=springs.parameters))
    return others


def hidden_springs(law: FrictionLaw) -> list[tuple[FrictionLaw, float]]:
    """The springs of a law beside a soft one of the same mu and k_T in all, and what is to be added to ln mu for the
    others to slip as before. A law that is none of springs counts as one.
    """
    from ema.contact.iwan import springs_of
    from ema.simulate.friction import ParallelMasing

    stiffness, slip = springs_of(law)
    out = []
    for soft in _HIDDEN[0]:
        for late in _HIDDEN[1]:
            shares = np.append((1 - soft) * stiffness, soft), np.append((1 - late) * slip, late)
            springs = ParallelMasing(
                law.friction_coefficient, law.contact_stiffness, shares[0].tolist(), shares[1].tolist()
            )
            out.append((replace(law, name=springs.name, parameters=springs.parameters), -float(np.log(1 - late))))
    return out


def levels_agree(
    data: LinearData, groups: np.ndarray, whole: ParameterPosterior, limits: Float[np.ndarray, "parameter"]
) -> Bool[np.ndarray, "parameter"]:
    """Whether estimates with one group of points left out confirm that of all points.

    Of nested data, var(part - whole) = var(part) - var(whole) (Hausman 1978). They confirm a parameter where all of
    them agree with that of all points and at least one of them says something of it, which is where its standard
    deviation is below ``limits``: what agrees because it says nothing is no confirmation, and one group has no others.
    """
    from scipy.stats import norm

    mean, spread, _ = data.estimate(whole.data_covariance)
    names = np.unique(groups)
    agreed, informed = np.ones(len(mean), bool), np.zeros(len(mean), bool)
    bound = norm.ppf(1 - _CHANCE / (2 * len(names) * len(mean))) * max(1.0, whole.misfit)
    for name in names if len(names) > 1 else ():
        kept = groups != name
        both = np.concatenate([kept, kept])
        part, wider, _ = data.subset(kept).estimate(whole.data_covariance[np.ix_(both, both)])
        room = np.maximum(np.diag(wider) - np.diag(spread), 1e-6 * np.diag(spread))
        agreed &= np.abs(part - mean) <= bound * np.sqrt(room)
        informed |= np.sqrt(np.diag(wider)) <= limits
    return agreed & informed


@dataclass(frozen=True)
class ProfileLikelihood:
    """Chi-square with one combination of the parameters held and the others at their best.

    Parameters
    ----------
    residuals : callable
        Residuals (2 point) at parameters relative to the optimum.
    known : array of shape (2 point,)
        Which of them are used.
    data : LinearData
        The data about the optimum.
    posterior : ParameterPosterior
        Its covariance of the parameters gives the distances, that of the data the weights.
    """

    residuals: Residuals
    known: Bool[np.ndarray, "datum"]
    data: LinearData
    posterior: ParameterPosterior

    def chi_square(self, offset: Float[np.ndarray, "parameter"]) -> tuple[float, np.ndarray]:
        """Chi-square at an offset from the optimum, and the residuals there; ``LOST`` without a resonance."""
        residuals = self.residuals(offset)[self.known]
        residuals = np.where(np.isfinite(residuals), residuals, LOST * self.data.std)
        residuals = residuals + self.data.growth_offset * self.data.friction_growth
        white = np.linalg.solve(np.linalg.cholesky(self.posterior.data_covariance), residuals)
        prior = np.sum((offset - self.data.prior_mean) ** 2) / self.data.prior_std**2
        return float(white @ white + prior) / max(1.0, self.posterior.misfit**2), residuals

    def damped(self, step: Float[np.ndarray, "parameter"]) -> Float[np.ndarray, "parameter"]:
        """The step, or so much of it that chi-square falls; nothing where it never does."""
        at_rest = self.chi_square(np.zeros_like(step))[0]
        for part in (1.0, 0.5, 0.25, 0.1):
            if self.chi_square(part * step)[0] <= at_rest:
                return part * step
        return np.zeros_like(step)

    def increase(self, combination: Float[np.ndarray, "parameter"], distance: float, least: float) -> float:
        """Of chi-square over ``least``, ``distance`` half widths along a combination, after one step of the others."""
        spread = self.posterior.covariance @ combination
        variance = float(combination @ spread)
        reach = np.sqrt(_CHI_SQUARE * max(1.0, self.posterior.misfit**2) / variance)
        offset = self.posterior.mean + distance * reach * spread
        here, residuals = self.chi_square(offset)
        data = self.data
        weighted = np.linalg.solve(self.posterior.data_covariance, data.sensitivity)
        information = data.sensitivity.T @ weighted + np.eye(len(offset)) / data.prior_std**2
        gradient = weighted.T @ residuals - (offset - data.prior_mean) / data.prior_std**2
        step = np.linalg.solve(information, gradient)
        along = np.linalg.solve(information, combination)
        step -= along * (combination @ step) / (combination @ along)
        if np.sqrt(step @ information @ step) < 0.1:
            return here - least
        return min(here, self.chi_square(offset + step)[0]) - least

    def descended(
        self, start: Float[np.ndarray, "parameter"], enough: float
    ) -> tuple[np.ndarray, np.ndarray, float] | None:
        """Where chi-square is least from a start, by Gauss-Newton: offset, covariance, chi-square.

        None where it stays above ``enough`` by more than ``_LIKELY`` after the first step.
        """
        prior, offset = np.eye(len(start)) / self.data.prior_std**2, start
        here, residuals = self.chi_square(offset)
        factor = np.linalg.cholesky(self.posterior.data_covariance)
        for number in range(_STEPS):
            ahead = np.stack([self.chi_square(offset + h)[1] for h in _FINITE * np.eye(len(start))], axis=1)
            slopes = np.linalg.solve(factor, (residuals[:, None] - ahead) / _FINITE)
            spread = np.linalg.inv(slopes.T @ slopes + prior)
            pull = (offset - self.data.prior_mean) / self.data.prior_std**2
            step = spread @ (slopes.T @ np.linalg.solve(factor, residuals) - pull)
            tried = offset + np.clip(step, -_BOLDEST, _BOLDEST)
            there, residuals_there = self.chi_square(tried)
            if there >= here:
                break
            gained, here, offset, residuals = here - there, there, tried, residuals_there
            if number == 0 and here > enough + _LIKELY:
                return None
            if gained < 0.1:
                break
        return offset, spread * max(1.0, self.posterior.misfit**2), here

    def bounds(self, combination: Float[np.ndarray, "parameter"]) -> tuple[float, float]:
        """Distances below and above, over the half width, at which the profile has closed; infinite where not."""
        least = self.chi_square(self.posterior.mean)[0]

        def closed(distance: float) -> bool:
            """Whether chi-square has risen enough there."""
            enough = _OPEN * _CHI_SQUARE if abs(distance) == 1 else _CHI_SQUARE
            return self.increase(combination, distance, least) >= enough

        below, above = (
            sign * next((d for d in PROFILE_DISTANCES if closed(sign * d)), float("inf")) for sign in (-1.0, 1.0)
        )
        return below, above


def robust_std(residuals: Float[np.ndarray, "datum"], std: Float[np.ndarray, "datum"]) -> Float[np.ndarray, "datum"]:
    """Standard deviations with those of outliers widened, as the loss of the search weighs them."""
    return np.asarray(std * (1 + (residuals / std / _ROBUST) ** 2) ** 0.25)
