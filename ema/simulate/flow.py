"""Exact motion of the modes over a step under a constant force, and the energy they lose to damping meanwhile.

Where damping couples no modes every one of them moves in closed form. Where a measured host or lossy joints couple
them, they move together: with r = force - w^2 q the motion p' = r - D p, r' = -w^2 p needs no force, and its solution
over a step is a matrix exponential.
"""

import numpy as np
from jaxtyping import Float
from scipy.linalg import expm

_NODES = 10
"""Gauss-Legendre nodes; exact to rounding over a step in which no mode turns by more than a radian."""


def own_coefficients(
    frequencies: Float[np.ndarray, "mode"], decay: Float[np.ndarray, "mode"], h: float
) -> tuple[Float[np.ndarray, "6 mode"], Float[np.ndarray, "form mode"]]:
    """End displacement and velocity from (q, p, force), and the loss as a form of these, of modes that move alone.

    ``frequencies`` rad/s, ``decay`` 1/s, ``h`` s. The second table is empty without damping.
    """
    tables, forms = long_coefficients(frequencies, decay, h, 0)
    return tables[0], forms[0]


def long_coefficients(
    frequencies: Float[np.ndarray, "mode"], decay: Float[np.ndarray, "mode"], h: float, doublings: int
) -> tuple[Float[np.ndarray, "length 6 mode"], Float[np.ndarray, "length form mode"]]:
    """The same for the lengths h, 2 h, 4 h ..."""
    lengths = h * 2.0 ** np.arange(doublings + 1)
    tables = [
        np.concatenate([flow[:, 0], flow[:, 1]], axis=1).T for flow in (_flow(frequencies, decay, t) for t in lengths)
    ]
    if not np.any(decay > 0):
        return np.array(tables), np.zeros((len(lengths), 0, len(decay)))
    halvings = max(int(np.ceil(np.log2(float(max(frequencies.max(), decay.max())) * h))), 0)
    forms = [_loss(frequencies, decay, h / 2**halvings)]
    for t in h * 2.0 ** np.arange(-halvings, doublings):
        forms.append(forms[-1] + _after(frequencies, decay, t, forms[-1]))
    pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
    kept = np.array(forms[halvings:])
    return np.array(tables), np.stack([kept[:, :, i, j] * (1 if i == j else 2) for i, j in pairs], axis=1)


def _loss(
    frequencies: Float[np.ndarray, "mode"], decay: Float[np.ndarray, "mode"], h: float
) -> Float[np.ndarray, "mode 3 3"]:
    """Loss to damping over a step in which no mode turns by more than a radian, as a form of (q, p, force)."""
    points, weights = np.polynomial.legendre.leggauss(_NODES)
    form = np.zeros((len(decay), 3, 3))
    for point, weight in zip((points + 1) / 2, weights / 2, strict=True):
        row = _flow(frequencies, decay, h * point)[:, 1]
        form += weight * h * decay[:, None, None] * row[:, :, None] * row[:, None, :]
    return form


def _after(
    frequencies: Float[np.ndarray, "mode"],
    decay: Float[np.ndarray, "mode"],
    h: float,
    form: Float[np.ndarray, "mode 3 3"],
) -> Float[np.ndarray, "mode 3 3"]:
    """A form of the state after ``h`` as one of the state before."""
    whole = np.zeros((len(decay), 3, 3))
    whole[:, :2], whole[:, 2, 2] = _flow(frequencies, decay, h), 1.0
    return np.asarray(whole.transpose(0, 2, 1) @ form @ whole)


def _flow(
    frequencies: Float[np.ndarray, "mode"], decay: Float[np.ndarray, "mode"], h: float
) -> Float[np.ndarray, "mode 2 3"]:
    """(q, p) after ``h`` from (q, p, force) in closed form."""
    half = decay / 2
    root = np.sqrt((frequencies**2 - half**2).astype(complex))
    fade, angle = np.exp(-half * h), root * h
    cosine, sine = np.real(np.cos(angle)), np.real(h * np.sinc(angle / np.pi))
    flow = np.empty((len(half), 2, 3))
    flow[:, 0, 0], flow[:, 0, 1] = fade * (cosine + half * sine), fade * sine
    flow[:, 1, 0], flow[:, 1, 1] = -(frequencies**2) * fade * sine, fade * (cosine - half * sine)
    small = frequencies * h < 1e-3
    square = np.where(small, 1.0, frequencies**2)
    series = 1 - decay * h / 3 - (frequencies**2 - decay**2) * h**2 / 12
    flow[:, 0, 2] = np.where(small, h**2 / 2 * series, (1 - flow[:, 0, 0]) / square)
    flow[:, 1, 2] = flow[:, 0, 1]
    return flow


def joint_coefficients(
    frequencies: Float[np.ndarray, "mode"], damping: Float[np.ndarray, "mode mode"], h: float
) -> tuple[Float[np.ndarray, "2 mode both"], Float[np.ndarray, "both both"]]:
    """Way and end velocity from x = (p, r), and the loss x.T @ form @ x, of modes that damping couples.

    ``frequencies`` rad/s, ``damping`` 1/s, ``h`` s. The step is halved until no mode turns by more than a radian, and
    put together again.
    """
    count = len(frequencies)
    # r over the frequency of its mode: all rates are then frequencies and decays
    scale = np.maximum(frequencies, 1 / h)
    rates = np.block([[-damping, np.diag(scale)], [-np.diag(frequencies**2 / scale), np.zeros((count, count))]])
    halvings = max(int(np.ceil(np.log2(max(float(np.linalg.norm(rates, 2)) * h, 1e-300)))), 0)
    short = h / 2**halvings
    points, weights = np.polynomial.legendre.leggauss(_NODES)
    flow, way, form = expm(rates * short), np.zeros((count, 2 * count)), np.zeros((2 * count, 2 * count))
    for point, weight in zip(points, weights, strict=True):
        velocity = expm(rates * (0.5 * short * (1 + point)))[:count]
        way += 0.5 * short * weight * velocity
        form += 0.5 * short * weight * (velocity.T @ damping @ velocity)
    for _ in range(halvings):
        way, form, flow = way + way @ flow, form + flow.T @ form @ flow, flow @ flow
    back = np.concatenate([np.ones(count), 1 / scale])
    return np.ascontiguousarray(np.stack([way, flow[:count]]) * back), np.ascontiguousarray(form * back * back[:, None])
