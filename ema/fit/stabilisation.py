"""The stabilisation diagram: poles of all model orders."""

from collections.abc import Iterable

import numpy as np
from jaxtyping import Complex, Float

from ema.data import FrfSet, PoleTable, damping_ratios, natural_frequencies
from ema.data._summary import count
from ema.errors import InputError
from ema.fit import lscf
from ema.fit.canonical import canonical, one_thread, table_in_order
from ema.fit.compression import compressed
from ema.fit.prepare import Prepared, check_statements, prepare
from ema.progress import Progress, advance, silent

TOLERANCES = (0.01, 0.05, 0.02)
"""Relative change of frequency and damping, and 1 - MAC of the participation vector, that still count as stable: the
usual ones of stabilisation diagrams. They make the letters of the diagram; no mode is selected by them."""

_WORK = 1e10
"""Sum over the model orders of the cubed sizes of their eigenvalue problems beyond which they are refused: at ten
nanoseconds each, as measured for orders up to 800, a hundred seconds, and with steps of two less than 1 GB."""


def stabilise(
    frfs: FrfSet,
    orders: Iterable[int] | None = None,
    tolerances: tuple[float, float, float] = TOLERANCES,
    progress: Progress = silent,
) -> PoleTable:
    """Compute the poles of the poly-reference least-squares complex frequency estimator for a range of model orders.

    Parameters
    ----------
    frfs : FrfSet
        FRFs of the band to be analysed (``frfs.band(200, 1350)``); the shorter side serves as references. A set in a
        file that is larger than memory is read twice and compressed (`ema.fit.compression`).
    orders : iterable of int, optional
        Model orders, counted as usual: an order gives half as many modes per reference. Odd orders count as the next
        even one. Default: thirty orders up to 60 (up to 200 for a single reference), fewer where there are few lines.
    tolerances : tuple of (float, float, float), optional
        Tolerances of the letters: frequency, damping and vector, relative.
    progress : Progress, optional
        Called after each order.

    Returns
    -------
    PoleTable
        Poles of all orders with their letters.

    Raises
    ------
    InputError
        If the FRFs cannot be fitted, an order is out of range, or the orders together are too much work (for a single
        reference, more than orders up to about 900 in steps of two).

    References
    ----------
    .. [1] Guillaume, Verboven, Vanlanduit, Van der Auweraer and Peeters (2003), A poly-reference implementation of the
       least-squares complex frequency-domain estimator, IMAC XXI.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> poles = stabilise(frf_set(0.001), orders=[4, 6, 8])
    >>> sorted(set(poles.order.tolist()))
    [4, 6, 8]
    """
    check_statements(frfs)
    if frfs.in_file:
        frfs = compressed(frfs.lines(frfs.frequencies > 0), progress).frfs
    form, _ = canonical(frfs)
    with one_thread():
        table = stabilise_prepared(prepare(form), form, orders, tolerances, progress)
    return table_in_order(table, frfs)


def stabilise_prepared(
    data: Prepared,
    frfs: FrfSet,
    orders: Iterable[int] | None = None,
    tolerances: tuple[float, float, float] = TOLERANCES,
    progress: Progress = silent,
) -> PoleTable:
    """`stabilise` on FRFs that are already checked and oriented."""
    degrees = _degrees(orders, data)
    weights = 1 / np.clip(data.noise.lines, 0.2, 5.0)
    outputs = lscf.principal_outputs(data.values, weights, data.noise)
    polynomials = lscf.normal_matrices(data.frequencies, outputs, degrees, weights, noise=1.0)
    order, poles, letters, vectors = [], [], [], []
    previous: tuple[np.ndarray, np.ndarray] | None = None
    for done, degree in enumerate(degrees):
        advance(progress, "model orders", done, len(degrees))
        found, participation = lscf.poles(polynomials, degree)
        letters.append(_letters(found, participation, previous, tolerances))
        previous = (found, participation)
        order.append(np.full(len(found), 2 * degree))
        # An exponential window shifted every pole to the left by the same amount.
        poles.append(found + frfs.added_decay)
        vectors.append(participation * data.noise.references)
    participation = np.concatenate(vectors)
    norm = np.maximum(np.linalg.norm(participation, axis=1, keepdims=True), np.finfo(float).tiny)
    return PoleTable(
        order=np.concatenate(order),
        poles=np.concatenate(poles),
        letter=np.concatenate(letters),
        participation=participation / norm,
        references=data.references,
        band=(float(data.frequencies[0]), float(data.frequencies[-1])),
        tolerances=tolerances,
    )


def _degrees(orders: Iterable[int] | None, data: Prepared) -> list[int]:
    """Degrees of the complex polynomials behind the model orders."""
    lines, _, references = data.values.shape
    limit = max(1, lines // (2 * (references + 1)))
    # Few references need high orders for as many modes; thirty orders make a diagram.
    top = min(max(30, 100 // references), limit)
    usual = list(range(top, 0, -max(1, top // 30)))[::-1]
    if orders is None:
        return usual
    try:
        orders = list(orders)
        degrees = sorted({(int(order) + 1) // 2 for order in orders})
    except (TypeError, ValueError) as error:
        raise InputError(
            "model orders are a sequence of whole numbers", got=repr(orders), expected="e.g. range(2, 61, 2)"
        ) from error
    if not degrees or degrees[0] < 1:
        raise InputError("no usable model order", got=orders[:5], expected="orders of 2 and more, e.g. range(2, 61, 2)")
    if degrees[-1] > limit:
        raise InputError(
            "a model order is too high for the number of frequency lines",
            got=f"order {2 * degrees[-1]}, {lines} lines",
            expected=f"orders up to {2 * limit}",
        )
    most = max(_WORK, float(_work(usual, references)[-1]))
    work = _work(degrees, references)
    if work[-1] > most:
        done = np.count_nonzero(work <= most)
        highest = degrees[done - 1] if done else int(np.cbrt(most)) // references
        raise InputError(
            "these model orders are too much work",
            got=f"{count(len(degrees), 'order')} up to {2 * degrees[-1]}",
            expected=f"orders up to {2 * highest}" + (" of these" if done else ""),
            advice="take a narrower band, where lower orders find as many modes, or fewer orders (thirty do)",
        )
    return degrees


def _work(degrees: list[int], references: int) -> Float[np.ndarray, "degree"]:
    """Cubed sizes of the eigenvalue problems of all degrees, summed up from the lowest."""
    return np.cumsum((references * np.array(degrees, float)) ** 3)


def _letters(
    poles: Complex[np.ndarray, "pole"],
    vectors: Complex[np.ndarray, "pole in"],
    previous: tuple[np.ndarray, np.ndarray] | None,
    tolerances: tuple[float, float, float],
) -> np.ndarray:
    """o new, f stable in frequency, d also in damping, v in frequency and vector, s in all, against the last order."""
    letters = np.full(len(poles), "o", dtype="<U1")
    if previous is None or not len(previous[0]) or not len(poles):
        return letters
    before, vectors_before = previous
    nearest = np.argmin(np.abs(poles[:, None] - before[None, :]), axis=1)
    frequency, damping = natural_frequencies(poles), damping_ratios(poles)
    same_f = np.abs(frequency - natural_frequencies(before)[nearest]) <= tolerances[0] * frequency
    same_d = np.abs(damping - damping_ratios(before)[nearest]) <= tolerances[1] * np.abs(damping)
    overlap = np.abs(np.einsum("pi,pi->p", vectors.conj(), vectors_before[nearest])) ** 2
    same_v = overlap >= 1 - tolerances[2]
    letters[same_f] = "f"
    letters[same_f & same_d] = "d"
    letters[same_f & same_v] = "v"
    letters[same_f & same_d & same_v] = "s"
    return letters
