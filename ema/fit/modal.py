"""From poles to modes: selection, residues with what lies outside, scaling."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from jaxtyping import Complex, Float

from ema.data import Finding, FrfSet, ModalModel, PoleTable, Residuals, damping_ratios, natural_frequencies
from ema.errors import InputError
from ema.fit import uncertainty
from ema.fit.candidates import HEAVIEST
from ema.fit.companions import companions
from ema.fit.prepare import Prepared, prepare
from ema.fit.refinement import refined
from ema.fit.scaling import scale_to_unit_modal_mass
from ema.fit.select import Dropped, Selection, keep_picked, select
from ema.progress import Progress, advance, silent

_NAMED = 10
"""Dropped candidates that are told one by one."""


def modes(
    frfs: FrfSet,
    poles: PoleTable,
    near: Sequence[float] | None = None,
    index: Sequence[int] | None = None,
    shapes: Literal["complex", "real"] = "complex",
    progress: Progress = silent,
) -> ModalModel:
    """Modal model of FRFs: natural frequencies, damping, shapes, participation, residual terms and intervals.

    Told nothing, the modes are selected automatically. The poles are refined by maximum likelihood together with the
    background (poles outside the band, residual terms) that stays in the model.

    Parameters
    ----------
    frfs : the FRFs; the band is that of ``poles``.
    near : frequencies in Hz; the most persistent pole next to each is taken.
    index : rows of ``poles`` to take. With ``near`` or ``index`` nothing else is taken.
    shapes : complex shapes, or real ones (each mode rotated to its mean phase).

    Raises
    ------
    InputError : the FRFs cannot be fitted, or there is no pole near a wanted frequency.
    """
    if shapes not in ("complex", "real"):
        raise InputError("unknown kind of shapes", got=repr(shapes), expected="complex or real")
    band = frfs.band(*poles.band)
    data = prepare(band)
    advance(progress, "selection of modes", 0, 2)
    if near is None and index is None:
        chosen = select(data, poles, band.added_decay)
    else:
        chosen = keep_picked(data, poles, band.added_decay, _picked(poles, near, index, frfs.name))
    advance(progress, "residues", 1, 2)
    model = _model(band, data, chosen)
    return _real(model) if shapes == "real" else model


def _picked(table: PoleTable, near: Sequence[float] | None, index: Sequence[int] | None, where: str) -> list[int]:
    """Rows of the pole table that the user named."""
    rows = list(dict.fromkeys(index or ()))
    outside = [row for row in rows if not 0 <= row < len(table.poles)]
    if outside:
        raise InputError(
            "no such row in the pole table", where=where, got=outside, expected=f"0 to {len(table.poles) - 1}"
        )
    frequencies = table.natural_frequencies
    for wanted in near or ():
        distance = np.abs(frequencies - wanted)
        # Among the poles about as near as the nearest ones, the stable one of the highest order is the best start.
        close = np.flatnonzero(distance <= max(0.01 * wanted, 1e-12))
        if not len(close):
            raise InputError(
                "no pole near the wanted frequency",
                where=where,
                got=f"{wanted:g} Hz",
                expected=f"a frequency within 1 % of a pole; the nearest is {frequencies[np.argmin(distance)]:.6g} Hz"
                if len(frequencies)
                else "a pole table that is not empty",
            )
        merit = np.isin(table.letter[close], ["s", "d", "v"]) * 1.0 + table.order[close] / table.order.max()
        merit -= distance[close] / (0.01 * wanted)
        best = [int(row) for row in close[np.argsort(-merit)] if not _taken(table, int(row), rows)]
        rows += best[:1]
    return rows


def _taken(table: PoleTable, row: int, rows: list[int]) -> bool:
    """Whether a pole repeats one that is already chosen: a frequency named twice asks for a repeated root."""
    for other in rows:
        near = abs(table.poles[row] - table.poles[other]) < abs(table.poles[other].real)
        if near and abs(np.vdot(table.participation[row], table.participation[other])) ** 2 > 0.9:
            return True
    return False


def _model(band: FrfSet, data: Prepared, chosen: Selection) -> ModalModel:
    """Modes and background on all outputs, refined with the noise of every FRF."""
    optimum = refined(band, data, chosen)
    state, scale = optimum.state, optimum.unit
    poles, psi = state.poles * scale, state.shapes * scale
    is_mode = chosen.is_mode[optimum.kept]
    outside = np.flatnonzero(~is_mode)
    unobserved = len(state.rest_poles)
    background = np.einsum("kr,ir->rki", psi[:, outside], state.participation[:, outside])
    residuals = Residuals(
        lower=state.rest[:, :, unobserved] * scale**2,
        upper=state.rest[:, :, unobserved + 1],
        poles=np.concatenate([poles[outside], state.rest_poles[state.active[:unobserved]] * scale]),
        residues=np.concatenate(
            [background, scale * state.rest[:, :, :unobserved][:, :, state.active[:unobserved]].transpose(2, 0, 1)]
        ),
    )
    order = np.flatnonzero(is_mode)
    order = order[np.argsort(np.abs(poles[order]))]
    shapes, participation = _normalise(psi[:, order], state.participation[:, order])
    model = ModalModel(
        poles=poles[order] + band.added_decay,
        shapes=shapes,
        dofs=data.dofs,
        participation=participation,
        inputs=data.references,
        residuals=residuals,
        confidence=chosen.confidence[optimum.kept][order],
        condition=band.condition,
        provenance=band.provenance,
        findings=(
            *_findings(band, data, poles[order], (*chosen.dropped, *optimum.dropped)),
            *_beyond(band, data, poles[outside]),
        ),
        name=band.name,
    )
    model = scale_to_unit_modal_mass(model) if band.scaled else model
    model = replace(model, findings=(*model.findings, *companions(model)))
    return uncertainty.attach(model, optimum, order)


def _normalise(
    shapes: Complex[np.ndarray, "dof mode"], participation: Complex[np.ndarray, "in mode"]
) -> tuple[Complex[np.ndarray, "dof mode"], Complex[np.ndarray, "in mode"]]:
    """Largest component of each shape 1; the participation takes the rest, so that residues stay."""
    if shapes.shape[1] == 0:
        return shapes, participation
    largest = shapes[np.argmax(np.abs(shapes), axis=0), np.arange(shapes.shape[1])]
    largest = np.where(largest == 0, 1, largest)
    return shapes / largest, participation * largest


def _real(model: ModalModel) -> ModalModel:
    """Each shape rotated to its mean phase, its imaginary part dropped, and the participation turned back."""
    # The phase that maximises the real part is half the phase of the sum of squares.
    turn = np.exp(-0.5j * np.angle(np.sum(model.shapes**2, axis=0)))
    real = replace(model, shapes=(model.shapes * turn).real.astype(complex), participation=model.participation / turn)
    return replace(real, uncertainty=None if model.uncertainty is None else uncertainty.real(model.uncertainty, turn))


def _findings(
    band: FrfSet, data: Prepared, poles: Complex[np.ndarray, "mode"], dropped: Sequence[Dropped]
) -> tuple[Finding, ...]:
    """What was dropped, modes at the band edge, DOFs without a signal."""
    where = band.name or "fit"
    found: list[Finding] = []
    if data.dead:
        found.append(
            Finding(
                "warning",
                "dead-output",
                where,
                f"All FRFs of {', '.join(map(str, data.dead[:6]))} are zero; they were left out.",
                value=float(len(data.dead)),
                advice="Check the cable and the channel table.",
            )
        )
    for drop in dropped[-_NAMED:]:
        frequency, damping = natural_frequencies(np.array([drop.pole]))[0], damping_ratios(np.array([drop.pole]))[0]
        found.append(
            Finding(
                "info",
                "dropped-candidate",
                where,
                f"A pole at {frequency:.6g} Hz with {100 * damping:.3g} % damping was not taken: {drop.reason}.",
                value=float(frequency),
                advice="Name it with near=[...] if you know that it is a mode.",
            )
        )
    if len(dropped) > _NAMED:
        found.append(
            Finding(
                "info",
                "dropped-candidate",
                where,
                f"{len(dropped) - _NAMED} more candidates were not taken: noise or misfit explains them.",
                value=float(len(dropped) - _NAMED),
                advice="Look at the stabilisation diagram.",
            )
        )
    low, high = 2 * np.pi * data.frequencies[0], 2 * np.pi * data.frequencies[-1]
    for pole in poles:
        if min(abs(pole) - low, high - abs(pole)) < abs(pole.real):
            found.append(
                Finding(
                    "warning",
                    "band-edge",
                    f"{where}, {abs(pole) / 2 / np.pi:.6g} Hz",
                    "The band cuts through the peak of this mode.",
                    value=float(abs(pole) / 2 / np.pi),
                    advice="Widen the band by a few bandwidths for a trustworthy damping.",
                )
            )
    if not len(poles):
        found.append(
            Finding(
                "warning",
                "no-modes",
                where,
                "No mode stands out of the noise in this band.",
                advice="Look at the coherence, and name frequencies with near=[...] to insist.",
            )
        )
    return tuple(found)


def _beyond(band: FrfSet, data: Prepared, background: Complex[np.ndarray, "pole"]) -> tuple[Finding, ...]:
    """Resonances outside the band whose flank reaches into it: they stay in the background, by name."""
    low, high = 2 * np.pi * data.frequencies[0], 2 * np.pi * data.frequencies[-1]
    size = np.abs(background)
    near = np.where(size < low, low - size, size - high)
    cut = (near > 0) & (near < np.abs(background.real)) & (damping_ratios(background) <= HEAVIEST)
    return tuple(
        Finding(
            "info",
            "band-edge",
            f"{band.name or 'fit'}, {frequency:.6g} Hz",
            "The resonance of this mode lies just outside the band; it is in the background, not among the modes.",
            value=float(frequency),
            advice="Widen the band if the mode is wanted.",
        )
        for frequency in natural_frequencies(background[cut])
    )


def reconstruction_error(measured: FrfSet, model: ModalModel) -> tuple[FrfSet, Float[np.ndarray, "out in"]]:
    """FRFs of the model on the lines of ``measured`` and their relative error, norm over norm, for each FRF.

    The decay that a window added is put back, so that both hold the same window.
    """
    from ema import synthesis

    keep = measured.frequencies > 0
    measured = measured.lines(keep) if not keep.all() else measured
    windowed = replace(model, poles=model.poles - measured.added_decay)
    quantity = "accelerance" if measured.quantity == "unstated" else measured.quantity
    rebuilt = synthesis.frfs(windowed, np.asarray(measured.frequencies), quantity, measured.outputs, measured.inputs)
    rebuilt = replace(rebuilt, quantity=measured.quantity, unit=measured.unit, added_decay=measured.added_decay)
    norm = np.linalg.norm(measured.values, axis=0)
    error = np.linalg.norm(rebuilt.values - measured.values, axis=0) / np.where(norm > 0, norm, 1)
    return rebuilt, error
