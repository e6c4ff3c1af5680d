"""``Model`` of sdypy-EMA: FRFs of one force over locations, poles and modal constants."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ema.data import FrfSet, ModalModel, poles_from
from ema.dof import Dof
from ema.errors import InputError
from ema.interop.attributes import dofs, read


def from_sdypy(model: Any, *, outputs: Sequence[Dof | str] | None = None, force: Dof | str = "1") -> FrfSet:
    """Return the FRFs of a ``Model`` of sdypy-EMA.

    Parameters
    ----------
    model : object
        A ``Model``, or anything with ``frf`` of shape (location, freq), ``freq`` [Hz] and ``frf_form``.
    outputs : sequence of Dof or str, optional
        DOFs of the locations, which the model does not know; scalars 1, 2, ... by default.
    force : Dof or str, default "1"
        DOF of the force.

    Returns
    -------
    FrfSet
        In SI, as sdypy-EMA takes them to be.

    Raises
    ------
    InputError
        If the object has no FRFs, or its DOFs are more or fewer than its locations.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> model = SimpleNamespace(freq=np.arange(1.0, 4.0), frf=np.ones((2, 3)), frf_form="accelerance")
    >>> from_sdypy(model, outputs=["1:+Z", "2:+Z"], force="1:+Z")
    FrfSet(3 lines 1 to 3 Hz, 2 outputs x 1 input, accelerance [(m/s^2)/N])
    """
    frequencies, values, kind = read(model, ("freq", "frf", "frf_form"), "a Model of sdypy-EMA with FRFs")
    block = np.atleast_2d(values)
    places = dofs(outputs, len(block), "the locations of the model")
    return FrfSet.from_arrays(frequencies, block.T[:, :, None], outputs=places, inputs=[force], quantity=str(kind))


def to_sdypy(frfs: FrfSet, column: int = 0) -> dict[str, Any]:
    """Return the keyword arguments of ``sdypy.EMA.Model`` for the FRFs of one force.

    Parameters
    ----------
    frfs : FrfSet
        FRFs of a stated quantity.
    column : int, default 0
        Position of the force in ``frfs.inputs``.

    Returns
    -------
    dict
        ``frf`` of shape (location, freq), ``freq`` [Hz], ``frf_form``, and the ends of the band ``lower``, ``upper``:
        ``Model(**to_sdypy(frfs))``.

    Raises
    ------
    InputError
        If the quantity of the FRFs is unstated, which that package cannot say.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> to_sdypy(frf_set())["frf"].shape
    (4, 201)
    """
    if frfs.quantity == "unstated":
        raise InputError(
            "a Model of sdypy-EMA has to know what its FRFs are",
            where=frfs.name,
            got="FRFs of unstated quantity",
            expected="receptance, mobility or accelerance",
        )
    return {
        "frf": frfs.values[:, :, column].T.copy(),
        "freq": frfs.frequencies.copy(),
        "frf_form": frfs.quantity,
        "lower": float(frfs.frequencies[0]),
        "upper": float(frfs.frequencies[-1]),
    }


def modes_from_sdypy(model: Any, *, outputs: Sequence[Dof | str] | None = None, force: Dof | str = "1") -> ModalModel:
    """Return the chosen modes of a ``Model`` of sdypy-EMA.

    Parameters
    ----------
    model : object
        A ``Model`` after ``select_poles`` and ``get_constants``, or anything with ``nat_freq`` [Hz], ``nat_xi`` [-] and
        the modal constants ``A`` of shape (location, mode).
    outputs : sequence of Dof or str, optional
        DOFs of the locations; scalars 1, 2, ... by default.
    force : Dof or str, default "1"
        DOF of the force.

    Returns
    -------
    ModalModel
        Residues of the receptance are the modal constants; unscaled.

    Raises
    ------
    InputError
        If the model has no modes yet, or its DOFs are more or fewer than its locations.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> model = SimpleNamespace(nat_freq=[40.0], nat_xi=[0.01], A=np.array([[1.0 - 2.0j], [0.5 - 1.0j]]))
    >>> modes_from_sdypy(model, outputs=["1:+Z", "2:+Z"], force="1:+Z").natural_frequencies
    array([40.])
    """
    advice = "call its select_poles and get_constants first"
    frequencies, damping, constants = read(
        model, ("nat_freq", "nat_xi", "A"), "a Model of sdypy-EMA with modes", advice
    )
    order = np.argsort(frequencies)
    shapes = np.asarray(constants, complex)[:, order]
    return ModalModel(
        poles=poles_from(np.asarray(frequencies, float)[order], np.asarray(damping, float)[order]),
        shapes=shapes,
        dofs=dofs(outputs, len(shapes), "the locations of the model"),
        participation=np.ones((1, shapes.shape[1]), complex),
        inputs=(Dof.parse(force),),
    )
