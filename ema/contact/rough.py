"""Springs that stand for two rough surfaces: Greenwood and Williamson's summits, each slipping as Mindlin has it.

A summit pressed by delta carries f(delta) = 4/3 E* sqrt(R) delta^(3/2) (Hertz 1882) and sticks with kappa times its
normal stiffness, kappa = 2 (1 - nu) / (2 - nu) for like materials. Moved by u under a constant force it carries

    q = mu (f(delta) - f(delta - kappa u / mu)),

the friction of one that slips everywhere, less that of one that is less deep (Cattaneo 1938; Mindlin 1949; Ciavarella
1998; Jaeger 1998). Summed over all summits, at the depth D,

    F_T(u) = mu (F_N(D) - F_N(D - kappa u / mu)),

so that the normal law gives the tangential one. Its second derivative is a density of springs: those that touch at the
depths g to g + dg have the stiffness F_N''(g) dg, kappa times that along the surface, and slip at mu times the force
F_N''(g) (D - g) dg that presses them. Such a bed carries any history of D and u as the summits do (Popov and Hess
2015); where D falls below g its springs let go. With y the yield displacement over u_c = mu F_N / k_T, y = (D - g) / l
and l = F_N / F_N', the stiffness of all springs beyond y is k_T K(y), and T(y) is the integral of K from y on:

    exponential heights    K = T = exp(-y)
    Gaussian heights       K = H_1/2(t) / H_1/2(t0), T = H_3/2(t) / H_3/2(t0), t = t0 + y l / s

with the standard deviation s, the separation t0 over s, and H_n(t) the mean of (x - t)^n of the heights x above t.
"""

import numpy as np
from jaxtyping import Float

from ema.data import FrictionLaw, NormalContact

ROUGH = ("rough contact", "gaussian rough contact")
"""The laws of rough surfaces."""

DEEPEST, LEAST, GROWTH = 16.0, 1e-3, 20.0
"""Yield displacements of the last and the first stretch over u_c: beyond the last one are 2e-6 of the force. Normal
force over that at rest up to which springs stand for summits that are yet to touch; beyond it the stiffnesses stay."""
LIGHTEST, HEAVIEST, POINTS = 1e-4, 100.0, 401
"""Normal forces over the stated one between which a curve stands for the normal law, and its points: each is 3.5 %
above the one before, and a straight line between them errs by 0.02 %."""
_FURTHEST, _CLOSEST = 4.5, 30.0
"""Separations about the stated one, over the deviation, between which Gaussian heights have these forces."""


def mindlin(poisson: float) -> float:
    """Tangential over normal stiffness of a contact of like materials that sticks (Mindlin 1949)."""
    return 2 * (1 - poisson) / (2 - poisson)


def partial_moment(power: float, separation: Float[np.ndarray, "*shape"] | float) -> Float[np.ndarray, "*shape"]:
    """H_n(t), integral of (x - t)^n over standard Gaussian heights x above t (Greenwood and Williamson 1966).

    Gamma(n + 1) / sqrt(2 pi) exp(-t^2 / 4) D_(-n-1)(t), with the parabolic cylinder function D.
    """
    from scipy.special import gamma, pbdv

    t = np.asarray(separation, np.float64)
    return np.asarray(gamma(power + 1) / np.sqrt(2 * np.pi) * np.exp(-(t**2) / 4) * pbdv(-power - 1, t)[0])


def growth_exponent(separation: float | None) -> float:
    """Exponent p of k_N ~ F_N^p: 1 for exponential heights; of Gaussian ones that at the separation.

    It is d ln H_1/2 / d ln H_3/2, as dH_n/dt = -n H_(n-1).
    """
    if separation is None:
        return 1.0
    rough, force, slope = (float(partial_moment(n, separation)) for n in (-0.5, 1.5, 0.5))
    return 0.5 * rough * force / (1.5 * slope**2)


def depth_scale(separation: float | None) -> float:
    """F_N / F_N' of the normal law, over the standard deviation of the heights: 1 for exponential heights."""
    if separation is None:
        return 1.0
    return float(partial_moment(1.5, separation) / (1.5 * partial_moment(0.5, separation)))


def rough_stiffness(force: float, deviation: float, separation: float | None, poisson: float = 0.3) -> float:
    """k_T in N/m under a normal force in N, of heights with a standard ``deviation`` in m: kappa F_N'."""
    return mindlin(poisson) * force / (deviation * depth_scale(separation))


def beyond(
    y: Float[np.ndarray, "edge"], separation: float | None
) -> tuple[Float[np.ndarray, "edge"], Float[np.ndarray, "edge"]]:
    """K(y) and T(y): stiffness over k_T, and force over mu F_N, of what yields beyond y u_c; y < 0 is yet to touch."""
    if separation is None:
        return np.exp(-y), np.exp(-y)
    force, slope = (float(partial_moment(n, separation)) for n in (1.5, 0.5))
    t = separation + y * depth_scale(separation)
    return partial_moment(0.5, t) / slope, partial_moment(1.5, t) / force


def rough_springs(
    count: int, separation: float | None = None, *, growing: bool = False
) -> tuple[Float[np.ndarray, "spring"], Float[np.ndarray, "spring"]]:
    """Shares of the springs in k_T, and in mu F_N at rest; with ``growing`` those too that touch when F_N has grown.

    Each stands for a stretch of yield displacements with its stiffness and its force, so that force and stiffness are
    exact where a stretch ends. The last ones, which do not touch at rest, have negative forces: the force at which they
    yield once the surfaces are u deeper, in yield displacements, is that and u times their stiffness.
    """
    inside = np.concatenate([[0.0], np.geomspace(LEAST, DEEPEST, count - 1)])
    stiff, force = beyond(inside, separation)
    # the last stretch goes on for ever
    stiff, force, edges = np.append(stiff, 0.0), np.append(force, 0.0), np.append(inside, 0.0)
    shares = -np.diff(stiff), -np.diff(edges * stiff + force)
    if not growing:
        return shares[0] / shares[0].sum(), shares[1] / shares[1].sum()
    # even stretches, finer where the normal force has hardly grown
    even = np.linspace(0.0, np.log(GROWTH), max(count // 4, 1) + 1)[1:]
    outside = -np.concatenate([[0.0], np.geomspace(LEAST, even[0], max(count // 5, 1), endpoint=False), even])
    stiff, force = beyond(outside, separation)
    more = np.diff(stiff), np.diff(outside * stiff + force)
    return np.append(shares[0], more[0]), np.append(shares[1], more[1])


def bed(law: FrictionLaw, stiffness: float) -> tuple[int, Float[np.ndarray, "field"]]:
    """Number of all springs of a contact of ``stiffness`` N/m, and what ``springs_kernels.rough`` takes of them.

    The slip force at rest is that at which k_T(F_N) has this stiffness.
    """
    values = dict(law.parameters)
    shares, force_shares = rough_springs(int(values["springs"]), values.get("separation"), growing=True)
    pressed = law.reference_force * (stiffness / law.contact_stiffness) ** (1 / law.stiffness_exponent)
    tops = law.friction_coefficient * pressed * force_shares
    return len(shares), np.concatenate([stiffness * shares, tops, [values["springs"]]])


def rough_normal_contact(deviation: float, force: float, separation: float | None = None) -> NormalContact:
    """Return the normal law of heights with a standard ``deviation`` in m as a curve; ``force`` N at the separation.

    Exponential heights have no end, and Gaussian ones none that matters: surfaces let go at LIGHTEST.
    """
    depths = np.linspace(np.log(LIGHTEST), np.log(HEAVIEST), POINTS)
    forces = force * np.exp(depths)
    if separation is not None:
        # (t0 - t) from the share of the force at t0, which falls with t
        t = np.linspace(separation + _FURTHEST, separation - _CLOSEST, 4001)
        shares = np.log(partial_moment(1.5, t) / partial_moment(1.5, separation))
        depths = separation - np.interp(depths, shares, t)
    return NormalContact(
        "curve", points=tuple(zip((deviation * (depths - depths[0])).tolist(), (forces - forces[0]).tolist()))
    )
