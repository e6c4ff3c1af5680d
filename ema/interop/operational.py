"""Results of pyOMA-2: modes of operational modal analysis, without a force and so without scale."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ema.data import ModalModel, poles_from
from ema.dof import Dof
from ema.interop.attributes import dofs, read
from ema.shapes.complexity import realise


def from_pyoma(result: Any, *, outputs: Sequence[Dof | str] | None = None) -> ModalModel:
    """Return the modes of a result of pyOMA-2.

    Parameters
    ----------
    result : object
        The result of an algorithm after ``mpe`` (EFDD, SSI, pLSCF), or anything with ``Fn`` [Hz], ``Xi`` [-] and
        ``Phi`` of shape (channel, mode); ``Fn_std`` and ``Xi_std`` are taken where they are filled in.
    outputs : sequence of Dof or str, optional
        DOFs of the channels, which the result does not know; scalars 1, 2, ... by default.

    Returns
    -------
    ModalModel
        Unscaled, without inputs; with the covariance of frequency and damping where standard deviations are stated
        (their correlation is not).

    Raises
    ------
    InputError
        If the result has no modes, or its DOFs are more or fewer than its channels.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> result = SimpleNamespace(Fn=np.array([40.0]), Xi=np.array([0.01]), Phi=np.ones((3, 1)), Fn_std=np.array([0.1]))
    >>> from_pyoma(result).natural_frequencies.round(3)
    array([40.])
    """
    advice = "run its mpe first; plain FDD has no damping"
    frequencies, damping, shapes = read(result, ("Fn", "Xi", "Phi"), "a result of pyOMA-2 with modes", advice)
    frequencies, damping = np.ravel(frequencies).astype(float), np.ravel(damping).astype(float)
    order = np.argsort(frequencies)
    block = np.asarray(shapes, complex).reshape(-1, len(frequencies))[:, order]
    stds = [getattr(result, name, None) for name in ("Fn_std", "Xi_std")]
    covariance = None
    if all(std is not None and np.size(std) == len(order) for std in stds):
        variances = np.array([np.ravel(np.asarray(std, float))[order] ** 2 for std in stds])
        covariance = variances.T[:, :, None] * np.eye(2)
    return ModalModel(
        poles=poles_from(frequencies[order], damping[order]),
        shapes=block,
        dofs=dofs(outputs, len(block), "the channels of the result"),
        participation=np.zeros((0, len(order)), complex),
        inputs=(),
        covariance=covariance,
    )


def to_pyoma(model: ModalModel, *, real: bool = False) -> dict[str, Any]:
    """Return modes as the keyword arguments of the result classes of pyOMA-2.

    Parameters
    ----------
    model : ModalModel
        Modes.
    real : bool, default False
        Make the shapes real.

    Returns
    -------
    dict
        ``Fn`` [Hz], ``Xi`` [-] and ``Phi`` of shape (channel, mode), each shape with largest component 1:
        ``EFDDResult(**to_pyoma(model))``.

    Examples
    --------
    >>> from ema.examples import modal_model
    >>> to_pyoma(modal_model())["Phi"].shape
    (4, 3)
    """
    shapes = realise(model.shapes).astype(complex) if real else np.asarray(model.shapes)
    largest = shapes[np.argmax(np.abs(shapes), axis=0), np.arange(shapes.shape[1])]
    scaled = shapes / np.where(largest == 0, 1, largest)
    return {
        "Fn": model.natural_frequencies,
        "Xi": model.damping_ratios,
        "Phi": scaled.real if real else scaled,
    }
