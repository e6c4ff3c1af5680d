"""Matrices of finite element programs: what was written is read, whatever the storage, and damage is told."""

import re
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from scipy.sparse import csc_matrix, tril

from acquisition.files import matrices
from ema.dof import Dof
from ema.elements import Section, beam
from ema.errors import InputError

BEAM = beam(Section(0.5, 0.04, 0.005, elements=3), part="host")


def write_harwell_boeing(
    path: Path,
    matrix: np.ndarray,
    kind: str = "RSA",
    layout: tuple[str, str, str] = ("(1I10)", "(1I10)", "(1D25.15)"),
    right_hand_side: bool = True,
) -> None:
    """A Harwell-Boeing file as ANSYS writes it: one number per line, D exponents, one triangle, a right-hand side."""
    held = csc_matrix(tril(matrix)) if kind == "RSA" else csc_matrix(matrix)
    held.sort_indices()

    def lines(values, form):
        per_line, letter, width = re.match(r"\((\d+)([A-Z])(\d+)", form).groups()
        texts = [f"{v:{width}d}" if letter == "I" else f"{v:{width}.15E}".replace("E", letter) for v in values]
        return ["".join(texts[n : n + int(per_line)]) for n in range(0, len(texts), int(per_line))]

    blocks = [
        lines(list(map(int, held.indptr + 1)), layout[0]),
        lines(list(map(int, held.indices + 1)), layout[1]),
        lines(list(map(float, held.data)), layout[2]),
    ]
    counts = [len(block) for block in blocks]
    right = len(matrix) if right_hand_side else 0
    head = [
        f"{'written for a test':<72}{'KEY':<8}",
        f"{sum(counts) + right:14d}{counts[0]:14d}{counts[1]:14d}{counts[2]:14d}{right:14d}",
        f"{kind:<14}{len(matrix):14d}{len(matrix):14d}{held.nnz:14d}{0:14d}",
        f"{layout[0]:<16}{layout[1]:<16}{layout[2]:<20}{layout[2]:<20}",
    ]
    head += [f"{'F':<14}{1:14d}{0:14d}"] if right else []
    tail = [f"{0.0:25.15E}" for _ in range(right)]
    path.write_text("\n".join(head + [line for block in blocks for line in block] + tail) + "\n")


@pytest.mark.parametrize("kind", ["RSA", "RUA"])
@pytest.mark.parametrize("layout", [("(1I10)", "(1I10)", "(1D25.15)"), ("(8I10)", "(8I10)", "(3E26.15)")])
@pytest.mark.parametrize("right", [True, False])
def test_harwell_boeing_gives_the_full_matrix(tmp_path, kind, layout, right):
    write_harwell_boeing(tmp_path / "k.matrix", BEAM.stiffness, kind, layout, right)
    np.testing.assert_allclose(matrices.read_matrix(tmp_path / "k.matrix"), BEAM.stiffness, rtol=1e-14)


def test_a_file_that_announces_one_triangle_and_holds_both(tmp_path):
    write_harwell_boeing(tmp_path / "k.matrix", BEAM.stiffness, "RUA")
    path = tmp_path / "k.matrix"
    path.write_text(path.read_text().replace("RUA", "RSA"))
    np.testing.assert_allclose(matrices.read_matrix(path), BEAM.stiffness, rtol=1e-14)


@pytest.mark.parametrize("symmetry", ["symmetric", "general"])
def test_matrix_market_gives_the_full_matrix(tmp_path, symmetry):
    scipy.io.mmwrite(tmp_path / "k.mtx", csc_matrix(BEAM.stiffness), symmetry=symmetry)
    np.testing.assert_allclose(matrices.read_matrix(tmp_path / "k.mtx"), BEAM.stiffness, rtol=1e-14)


def test_mapping_of_ansys_and_plain_lists(tmp_path):
    (tmp_path / "k.mapping").write_text(
        "  Matrix Eqn     Node   DOF\n        1         7     UX\n        2         7   ROTY\n        3        12     UZ\n"
    )
    expected = (Dof(7, "+X", "table"), Dof(7, "+RY", "table"), Dof(12, "+Z", "table"))
    assert matrices.read_dofs(tmp_path / "k.mapping", "table") == expected
    (tmp_path / "dofs.txt").write_text("# rows in order\n7:+X\n7:RY\n\n12:+Z\n")
    assert matrices.read_dofs(tmp_path / "dofs.txt", "table") == expected


@pytest.mark.parametrize("code", ["utf-8-sig", "utf-16"])
def test_a_mapping_that_an_editor_saved_in_another_code(tmp_path, code):
    path = tmp_path / "map"
    path.write_text("1 12 UZ\n2 7 ROTX\n", encoding=code)
    assert [str(dof) for dof in matrices.read_dofs(path)] == ["12:+Z", "7:+RX"]


@pytest.mark.parametrize("code", ["utf-8-sig", "utf-16", "ascii"])
def test_a_matrix_market_file_with_another_banner_says_so(tmp_path, code):
    """It had been called a Harwell-Boeing file that is none."""
    banner = "%%matrixmarket" if code == "ascii" else "%%MatrixMarket"
    path = tmp_path / "k.mtx"
    path.write_text(f"{banner} matrix coordinate real general\n2 2 1\n1 1 1\n", encoding=code)
    with pytest.raises(
        InputError, match="the first line of a Matrix Market file is not written as the format wants it"
    ):
        matrices.read_matrix(path)


def test_units_of_the_program_become_si(tmp_path):
    """In mm, t and s: a length of 1 m is 1000, 1 kg is 0.001, and rotations stay."""
    per_si = np.array([1.0 if dof.axis.startswith("R") else 1000.0 for dof in BEAM.dofs])
    # energy in t mm^2/s^2 is 1e-3 J; q in the file = per_si * q in SI
    energy = 1e-3
    files = {}
    for name in ("mass", "stiffness"):
        files[name] = tmp_path / f"{name}.mtx"
        scipy.io.mmwrite(files[name], csc_matrix(getattr(BEAM, name) / np.outer(per_si, per_si) / energy))
    found = matrices.structure(files["mass"], files["stiffness"], BEAM.dofs, 1e-3, 1000.0)
    np.testing.assert_allclose(found.mass, BEAM.mass, rtol=1e-12)
    np.testing.assert_allclose(found.stiffness, BEAM.stiffness, rtol=1e-12, atol=1e-3)


def test_damage_is_told_in_one_sentence(tmp_path):
    path = tmp_path / "k.matrix"
    with pytest.raises(InputError, match="cannot be read: No such file"):
        matrices.read_matrix(path)
    write_harwell_boeing(path, BEAM.stiffness)
    whole = path.read_text()
    for text, words in (
        ("", "not a Harwell-Boeing file"),
        ("just words\n" * 8, "not a Harwell-Boeing file"),
        (whole[: len(whole) // 2], "ends too early"),
        (whole.replace("RSA", "CSA"), "CSA, 9 x 9"),
        (whole.replace("RSA", "RRA"), "RRA, 9 x 9"),
        (whole.replace("         1\n", "         x\n", 1), "cannot be read"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=words):
            matrices.read_matrix(path)
    path.write_bytes(b"\0\1\2" * 100)
    with pytest.raises(InputError, match="binary file"):
        matrices.read_matrix(path)
    path.write_text("%%MatrixMarket matrix coordinate real general\n3 3 2\n1 1 5\n")
    with pytest.raises(InputError, match="damaged Matrix Market"):
        matrices.read_matrix(path)
    path.write_text("%%MatrixMarket matrix coordinate real general\n3 2 1\n1 1 5\n")
    with pytest.raises(InputError, match="real and square"):
        matrices.read_matrix(path)
    path.write_text("%%MatrixMarket matrix coordinate real symmetric\n900000 900000 1\n1 1 5\n")
    with pytest.raises(InputError, match="too large"):
        matrices.read_matrix(path)
    for kind, lines in (("general", "1 1 5\n1 1 5\n"), ("symmetric", "2 1 5\n1 2 5\n")):
        path.write_text(f"%%MatrixMarket matrix coordinate real {kind}\n3 3 2\n{lines}")
        with pytest.raises(InputError, match="occurs twice"):
            matrices.read_matrix(path)


def test_wrong_tables_of_dofs_are_told_with_their_line(tmp_path):
    path = tmp_path / "k.mapping"
    for text, words in (
        ("1 7 UX\n2 7 TEMP\n", "line 2: a line that names no DOF"),
        ("1 7 UX\n2 7 UX\n", "line 2: a row or DOF named twice"),
        ("1 7 UX\n3 7 UY\n", "rows are left out"),
        ("", "rows are left out"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=words):
            matrices.read_dofs(path)
    scipy.io.mmwrite(tmp_path / "k.mtx", csc_matrix(BEAM.stiffness))
    with pytest.raises(InputError, match="differ in size; got 9 rows, 2 DOFs"):
        matrices.structure(tmp_path / "k.mtx", tmp_path / "k.mtx", (Dof(1, "+X"), Dof(1, "+Z")))


@pytest.mark.parametrize("head", ["\n", "% a comment\n\n", "\n% caf\u00e9\n \t\n", "%a\r\n\r\n"])
def test_blank_lines_and_comments_may_stand_before_the_sizes(tmp_path: Path, head: str) -> None:
    """Blank lines may stand anywhere behind the first line (Boisvert, Pozo, Remington 1996, section 2)."""
    text = f"%%MatrixMarket matrix coordinate real symmetric\n{head}  2 2 2 \n1 1 1.5\n\n2 2 3.5\n"
    (tmp_path / "a.mtx").write_bytes(text.encode("latin-1"))
    np.testing.assert_array_equal(matrices.read_matrix(tmp_path / "a.mtx"), [[1.5, 0.0], [0.0, 3.5]])


@pytest.mark.parametrize(("at", "byte"), [(32, b"\f"), (32, b"\r"), (50, b"\r"), (50, b"\v"), (32, b"\0")])
def test_a_foreign_character_for_a_blank_in_the_head_is_refused(tmp_path: Path, at: int, byte: bytes) -> None:
    text = b"%%MatrixMarket matrix coordinate real symmetric \n2 2 2\n1 1 1.5\n2 2 3.5\n"
    assert text[at : at + 1] == b" "
    (tmp_path / "a.mtx").write_bytes(text[:at] + byte + text[at + 1 :])
    with pytest.raises(InputError):
        matrices.read_matrix(tmp_path / "a.mtx")
