"""Modes of a measurement against those of a model."""

import numpy as np
from jaxtyping import Float

from ema.data import ModalModel
from ema.data.comparison import ModeComparison, Verdict
from ema.dof import match
from ema.shapes import co_mac, compare, mac_uncertainty

CLOSE = 0.05
"""Relative difference in frequency up to which a pair counts as close."""
ALIKE = 0.8
"""MAC from which on two shapes count as the same mode."""


def modes(measured: ModalModel, model: ModalModel, threshold: float = 0.5) -> ModeComparison:
    """Pair the modes of a measurement with those of a model by their shapes, in whatever order they come.

    Parameters
    ----------
    measured : ModalModel
        Measured modes.
    model : ModalModel
        Modes of the model.
    threshold : float, default 0.5
        Smallest MAC of a pair.

    Returns
    -------
    ModeComparison
        Frequencies, damping and MAC of the pairs, what is left unpaired, and whether the model agrees.

    Raises
    ------
    InputError
        If the two have no DOF in common.

    Examples
    --------
    >>> from ema.examples import modal_model
    >>> modes(modal_model(), modal_model()).verdict.agrees
    True
    """
    paired = compare(measured, model, threshold)
    left, right = [i for i, _ in paired.pairs], [j for _, j in paired.pairs]
    both = ((measured, left), (model, right))
    frequency = np.stack([one.natural_frequencies[rows] for one, rows in both], axis=1)
    damping = np.stack([one.damping_ratios[rows] for one, rows in both], axis=1)
    common = match(measured.dofs, model.dofs)
    rows, places = [i for i, _, _ in common], [j for _, j, _ in common]
    signs = np.array([sign for *_, sign in common])
    shared = (measured.shapes[rows][:, left], model.shapes[places][:, right] * signs[:, None])
    by_dof = co_mac(*shared) if left else np.full(len(rows), np.nan)
    values = paired.mac[left, right] if left else np.zeros(0)
    unpaired = tuple(tuple(mode for mode in range(len(one.poles)) if mode not in used) for one, used in both)
    known = measured.uncertainty is not None or model.uncertainty is not None
    return ModeComparison(
        paired.pairs,
        frequency,
        damping,
        values,
        _significance(measured, model, left, right, frequency, damping),
        by_dof,
        paired.dofs,
        (unpaired[0], unpaired[1]),
        _verdict(
            frequency, values, (unpaired[0], unpaired[1]), [i for (i, _), k in zip(paired.pairs, paired.rivals) if k]
        ),
        mac_uncertainty(measured, model, paired.pairs).std if known else None,
    )


def _significance(
    measured: ModalModel,
    model: ModalModel,
    left: list[int],
    right: list[int],
    frequency: np.ndarray,
    damping: np.ndarray,
) -> Float[np.ndarray, "pair 2"]:
    variance = np.zeros((len(left), 2))
    known = False
    for one, rows in ((measured, left), (model, right)):
        if one.covariance is not None:
            variance += np.stack([one.covariance[rows, 0, 0], one.covariance[rows, 1, 1]], axis=1)
            known = True
    difference = np.stack([np.diff(frequency, axis=1)[:, 0], np.diff(damping, axis=1)[:, 0]], axis=1)
    if not known:
        return np.full(difference.shape, np.nan)
    return np.asarray(
        np.divide(difference, np.sqrt(variance), out=np.full(difference.shape, np.nan), where=variance > 0)
    )


def _verdict(
    frequency: np.ndarray, values: np.ndarray, unpaired: tuple[tuple[int, ...], tuple[int, ...]], doubtful: list[int]
) -> Verdict:
    said = [
        f"{len(values)} modes are paired"
        + (f", MAC from {values.min():.2f} to {values.max():.2f}." if len(values) else ".")
    ]
    far = [n for n, (a, b) in enumerate(frequency) if abs(b / a - 1) > CLOSE]
    unlike = [n for n, value in enumerate(values) if value < ALIKE]
    if len(values):
        worst = int(np.abs(frequency[:, 1] / frequency[:, 0] - 1).argmax())
        shift = 100 * (frequency[worst, 1] / frequency[worst, 0] - 1)
        said.append(f"The largest difference in frequency is {shift:+.1f} % at {frequency[worst, 0]:.4g} Hz.")
    if unlike:
        said.append(f"{len(unlike)} of the pairs have a MAC below {ALIKE}.")
    if doubtful:
        said.append(
            "The shapes at the common DOFs do not tell for certain which simulated mode belongs to measured "
            f"{', '.join(str(mode + 1) for mode in doubtful)}."
        )
    for whose, rest in zip(("measured", "simulated"), unpaired, strict=True):
        if rest:
            said.append(f"{len(rest)} {whose} modes have no partner: {', '.join(str(mode + 1) for mode in rest)}.")
    return Verdict(bool(len(values)) and not far and not unlike and not unpaired[0], tuple(said))
