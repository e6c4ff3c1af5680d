"""Data at nodes (55, 2414) that hold mode shapes become modal models, and the reverse (55)."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from acquisition.files.uff import records
from acquisition.files.uff.geometry_sets import block
from acquisition.files.uff.header58 import mended, text_of
from acquisition.files.uff.unit_system import UnitSystem
from ema.data import Finding, ModalModel
from ema.dof import Dof
from ema.errors import InputError

NORMAL, COMPLEX, COMPLEX_2 = 2, 3, 7
"""Analysis types of data sets 55 and 2414 (universal file format): normal mode, complex eigenvalue of first order and
of second order."""
ANALYSES = {
    0: "unknown analysis",
    1: "static result",
    2: "normal mode",
    3: "complex mode",
    4: "transient result",
    5: "frequency response",
    6: "buckling mode",
    7: "complex mode",
    9: "non-linear static result",
}


@dataclass(frozen=True)
class Shape:
    """One mode of a file: pole in rad/s, modal mass or modal A (0 where unknown), values (node, direction)."""

    pole: complex
    modal_mass: float
    modal_a: complex
    nodes: tuple[int, ...]
    values: Any
    title: str
    system: UnitSystem
    case: tuple[int, int] = (0, 0)
    """Kind of analysis and load case: modes of one model share them."""


class NotAMode(Exception):
    """The data set holds something else; the text says what."""


def _words(line: bytes) -> list[str]:
    """Numbers of a line as texts: in columns of 13, or by blanks where the columns do not fit."""
    apart = records.words(line)
    text = text_of(line).rstrip()
    columns = [text[a : a + 13].strip() for a in range(0, len(text), 13)]
    try:
        for word in columns:
            records.real(word)
    except ValueError:
        return apart
    if len(columns) != len(apart) and len(text) % 13:
        raise ValueError(f"{text.strip()[-30:]!r} is no row of numbers")  # they touch, and do not end where columns do
    return columns


def _data(lines: list[bytes], per_node: int) -> tuple[tuple[int, ...], Any]:
    """Nodes and their numbers: a line with the node, then lines with ``per_node`` numbers."""
    nodes, rows, values = [], list[list[str]](), []
    step = -(-per_node // 6)
    there = records.inside(lines)
    for place in range(0, len(there), 1 + step):
        node, *more = records.integers(there[place])
        if more:
            raise ValueError(f"node {node} does not stand alone in its line")
        own = [_words(line) for line in there[place + 1 : place + 1 + step]]
        row = [records.real(word) for words in own for word in words]
        if len(row) != per_node:
            raise ValueError(f"node {node} has {len(row)} of {per_node} values")
        nodes.append(node)
        rows += own
        values.append(row)
    if not nodes:
        raise ValueError("no data at any node")
    records.whole(rows)
    if not np.isfinite(values).all():
        raise ValueError("values that are NaN or infinite")
    return tuple(nodes), np.array(values)


def _values(lines: list[bytes], kind: int, count: int) -> tuple[tuple[int, ...], Any]:
    if kind not in (2, 4, 5, 6):
        raise ValueError(f"data type {kind} is neither real nor complex")
    if kind in (5, 6):
        nodes, values = _data(lines, 2 * count)
        return nodes, values[:, 0::2] + 1j * values[:, 1::2]
    nodes, values = _data(lines, count)
    return nodes, values.astype(complex)


def _check(analysis: int, characteristic: int, count: int) -> None:
    if analysis not in (NORMAL, COMPLEX, COMPLEX_2):
        raise NotAMode(ANALYSES.get(analysis, f"analysis of type {analysis}"))
    if characteristic not in (0, 1, 2, 3) or count not in (1, 2, 3, 6):
        raise NotAMode(f"{ANALYSES[analysis]} with {count} values per node that are no displacements")


def shape55(lines: list[bytes], system: UnitSystem) -> Shape:
    """The mode of a data set 55.

    Raises
    ------
    NotAMode : it holds a static result, a frequency response and the like.
    ValueError : a field is no number, or lines are missing.
    """
    if len(lines) < 10:
        raise ValueError("the data set is cut short")
    analysis, characteristic, _, kind, count = records.integers(lines[5])[1:6]
    _check(analysis, characteristic, count)
    about, texts = records.integers(lines[6]), _words(lines[7])
    records.whole([texts])
    stated = [records.real(word) for word in texts]
    if len(about) > 1 and len(stated) < min(about[1], 6):
        raise ValueError(f"{len(stated)} of {about[1]} announced real values")
    real = [*stated, *[0.0] * 6]
    title = mended(text_of(lines[0]))
    nodes, values = _values(lines[8:], kind, count)
    case = (analysis, about[2] if len(about) > 2 else 0)
    if analysis == NORMAL:
        shape = _normal(real[0], real[1], real[2] or real[3] / 2, nodes, values, title, system)
    else:
        shape = _complex(complex(real[0], real[1]), complex(real[2], real[3]), nodes, values, title, system)
    return replace(shape, case=case)


def shape2414(lines: list[bytes], system: UnitSystem) -> Shape:
    """The mode of a data set 2414.

    Raises
    ------
    NotAMode : it holds something else, or data on elements.
    ValueError : a field is no number, or lines are missing.
    """
    if len(lines) < 15:
        raise ValueError("the data set is cut short")
    if records.integers(lines[2])[0] != 1:
        raise NotAMode("result on elements")
    analysis, characteristic, _, kind, count = records.integers(lines[8])[1:6]
    _check(analysis, characteristic, count)
    texts = [_words(line) for line in lines[11:13]]
    records.whole(texts)
    first, second = ([records.real(word) for word in row] for row in texts)
    real = [*[*first, *[0.0] * 6][:6], *second, *[0.0] * 6]
    title = mended(text_of(lines[1]))
    nodes, values = _values(lines[13:], kind, count)
    if analysis == NORMAL:
        shape = _normal(real[1], real[3], real[4] or real[5] / 2, nodes, values, title, system)
    else:
        shape = _complex(complex(real[6], real[7]), complex(real[8], real[9]), nodes, values, title, system)
    return replace(shape, case=(analysis, 0))


def _normal(
    frequency: float,
    mass: float,
    damping: float,
    nodes: tuple[int, ...],
    values: Any,
    title: str,
    system: UnitSystem,
) -> Shape:
    """A real mode; ``damping`` is the viscous ratio, or half the hysteretic one where that is stated instead."""
    if not (0 <= frequency < 1e12 and 0 <= damping < 1):
        raise ValueError(f"a mode at {frequency:g} Hz with a damping ratio of {damping:g}")
    omega = 2 * np.pi * frequency
    pole = complex(-damping * omega, omega * np.sqrt(1 - damping**2))
    return Shape(pole, mass, 0j, nodes, values, title, system)


def _complex(
    pole: complex, modal_a: complex, nodes: tuple[int, ...], values: Any, title: str, system: UnitSystem
) -> Shape:
    if not (0 < abs(pole) < 1e13 and abs(modal_a) < float("inf")):
        raise ValueError(f"an eigenvalue of {pole}")
    if pole.imag < 0:  # the conjugate partner says the same
        pole, modal_a, values = pole.conjugate(), modal_a.conjugate(), values.conj()
    return Shape(pole, 0.0, modal_a, nodes, values, title, system)


def models(shapes: Iterable[Shape], where: str) -> tuple[list[ModalModel], list[Finding]]:
    """Modal models of the shapes; those on the same nodes and directions belong together."""
    groups: dict[Any, list[Shape]] = {}
    for shape in shapes:
        groups.setdefault((shape.nodes, shape.values.shape[1], shape.case), []).append(shape)
    found = []
    findings: list[Finding] = []
    for number, group in enumerate(groups.values()):
        name = where if len(groups) == 1 else f"{where}, modes {number + 1}"
        if len(set(group[0].nodes)) < len(group[0].nodes):
            findings.append(
                Finding("error", "duplicated-dof", name, "a node occurs twice in a mode shape; the modes are left out.")
            )
            continue
        found.append(_model(group, name, findings))
    return found, findings


def _model(group: list[Shape], name: str, findings: list[Finding]) -> ModalModel:
    group = sorted(group, key=lambda shape: abs(shape.pole))
    array = np.stack([shape.values for shape in group], axis=2)  # node, direction, mode
    directions = array.shape[1]
    codes = [0] if directions == 1 else list(range(1, directions + 1))
    moving = np.any(array != 0, axis=2)
    # a value that is zero in all modes was not measured, unless the whole node stands still
    used = moving | (~moving.any(axis=1, keepdims=True) & (np.arange(directions) < 3))
    dofs = tuple(Dof.from_uff(group[0].nodes[n], codes[d]) for n, d in np.argwhere(used))
    shapes = array[used]
    poles = np.array([shape.pole for shape in group])
    if not np.isfinite(shapes).all() or not np.isfinite(poles).all():
        findings.append(Finding("error", "not-finite", name, "some mode shapes are NaN or infinite."))
    unit_a = [_modal_a(shape) for shape in group]
    scaled = all(value is not None for value in unit_a)
    participation = np.zeros((0, len(group)), dtype=complex)
    if scaled:  # scale so that modal A is 2 j w_d: unit modal mass
        target = 2j * poles.imag
        shapes = shapes * np.sqrt(target / np.array(unit_a))
        participation = shapes / target
    elif any(value is not None for value in unit_a):
        without = [abs(pole.imag) / (2 * np.pi) for pole, value in zip(poles, unit_a, strict=True) if value is None]
        message = (
            f"{len(without)} of {len(group)} modes, first at {without[0]:.4g} Hz, state no modal A or modal mass; "
        )
        message += "all are unscaled."
        findings.append(Finding("warning", "scaling-missing", name, message))
    elif not any(shape.system.stated for shape in group):
        findings.append(Finding("info", "unit-unstated", name, "no data set 164: the mode shapes are unscaled."))
    return ModalModel(
        poles,
        shapes,
        dofs,
        participation,
        dofs if scaled else (),
        None,
        "unit modal mass" if scaled else "unscaled",
        name=name,
    )


def _modal_a(shape: Shape) -> complex | None:
    """Modal A in SI of a shape, where modal A or modal mass and the units are stated."""
    system = shape.system
    if not system.stated or not shape.pole.imag:
        return None
    # shape^2 / A is a receptance times rad/s: length over force in the units of the file
    factor = system.length / system.force
    if shape.modal_a:
        return shape.modal_a * factor
    return 2j * shape.pole.imag * shape.modal_mass * factor if shape.modal_mass > 0 else None


def write_modes(model: ModalModel, case: int = 1) -> bytes:
    """One data set 55 for each mode; complex shapes as complex eigenvalues with modal A.

    Raises
    ------
    InputError : poles or shapes that are not finite, or a model without a translation or rotation.
    """
    if not (np.isfinite(model.shapes).all() and np.isfinite(model.poles).all()):
        raise InputError(
            "mode shapes and poles that are not finite cannot be written",
            where=model.name,
            advice="leave the bad modes or DOFs out first",
        )
    nodes = list(dict.fromkeys(dof.node for dof in model.dofs))
    rows = {node: place for place, node in enumerate(nodes)}
    codes = [abs(dof.uff_direction) for dof in model.dofs]
    if 0 in codes and max(codes) > 0:
        raise InputError(
            "scalar and directed DOFs together cannot be written in data set 55",
            where=model.name,
            advice="give every DOF a direction, such as 12:+Z",
        )
    places = [(rows[dof.node], code) for dof, code in zip(model.dofs, codes, strict=True)]
    if len(set(places)) < len(places):
        where = next(place for place in places if places.count(place) > 1)
        same = [str(dof) for dof, place in zip(model.dofs, places, strict=True) if place == where]
        raise InputError(
            "two DOFs are one in data set 55, which states neither parts of a structure nor senses",
            where=model.name,
            got=" and ".join(same),
            advice="keep one of them, or give the nodes of every part numbers of their own",
        )
    count = 1 if max(codes) == 0 else 3 if max(codes) <= 3 else 6
    real = not np.any(model.shapes.imag) and model.scaling != "unscaled"
    scale = _modal_scale(model)
    blocks = []
    for mode, pole in enumerate(model.poles):
        values = np.zeros((len(nodes), count), dtype=complex)
        for (row, code), value, dof in zip(places, model.shapes[:, mode], model.dofs, strict=True):
            values[row, max(code - 1, 0)] = dof.sign * value
        blocks.append(_write55(model.name or "mode", (case, mode + 1), pole, scale[mode], nodes, values, real))
    return b"".join(blocks)


def _modal_scale(model: ModalModel) -> Any:
    """Modal A of each mode, 0 where the participation is not proportional to the shapes."""
    target = 2j * model.poles.imag
    if model.scaling == "unit modal mass":
        return target
    rows = {dof: place for place, dof in enumerate(model.dofs)}
    common = [(rows[dof], place) for place, dof in enumerate(model.inputs) if dof in rows]
    found = np.zeros(len(model.poles), dtype=complex)
    for mode in range(len(model.poles)):
        shape = np.array([model.shapes[row, mode] for row, _ in common])
        share = np.array([model.participation[place, mode] for _, place in common])
        if len(shape) and np.any(share):
            ratio = np.vdot(share, shape) / np.vdot(share, share)
            if np.linalg.norm(shape - ratio * share) <= 0.01 * np.linalg.norm(shape):
                found[mode] = ratio
    return found


def _write55(
    title: str, number: tuple[int, int], pole: complex, modal_a: complex, nodes: list[int], values: Any, real: bool
) -> bytes:
    count = values.shape[1]
    frequency, damping = abs(pole) / (2 * np.pi), -pole.real / abs(pole)
    analysis = NORMAL if real else COMPLEX
    ids = [title[:80], "NONE", "NONE", f"mode {number[1]}", f"f = {frequency:.8g} Hz, damping ratio = {damping:.6g}"]
    characteristic = {1: 1, 3: 2, 6: 3}[count]
    lines = [f"{text:<80}" for text in ids]
    lines.append("".join(f"{value:10d}" for value in (1, analysis, characteristic, 8, 2 if real else 5, count)))
    lines.append("".join(f"{value:10d}" for value in (2, 4 if real else 6, *number)))
    if real:
        mass = (modal_a / (2j * pole.imag)).real if pole.imag else 0.0
        lines.append(_e13(frequency, mass, damping, 0.0, digits=6))
    else:
        lines.append(_e13(pole.real, pole.imag, modal_a.real, modal_a.imag, 0.0, 0.0, digits=6))
    for node, row in zip(nodes, values, strict=True):
        numbers = row.real if real else np.stack([row.real, row.imag], axis=1).reshape(-1)
        lines.append(f"{node:10d}")
        lines += [_e13(*numbers[a : a + 6]) for a in range(0, len(numbers), 6)]
    return block(55, lines)


def _e13(*values: float, digits: int = 5) -> str:
    return "".join(f"{value:13.{digits}e}" for value in values)
