"""The report as HTML, PDF and Word, read back: the same words, numbers, tables and pictures in each."""

import base64
import csv
import json
import re
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ema.report
from ema.data import Campaign, Expectation, Geometry, Repair, StudyResult
from ema.errors import FailureError, InputError, MissingExtraError
from tests.unit.report_corpus import EVIL, JOINTS, plate, run_result, study
from tests.unit.report_page import Page

docx = pytest.importorskip("docx")
pypdf = pytest.importorskip("pypdf")
pytest.importorskip("weasyprint")


@pytest.fixture(scope="module")
def result() -> StudyResult:
    geometry = plate(5, 4)
    runs = (run_result("bare", geometry), run_result("beam_1kN", geometry, shift=1.013, factor=1.9, joints=JOINTS))
    return study(
        runs,
        geometry,
        repairs=(Repair("reverse sign", "acc 2", "A. Tester", EVIL),),
        expectations=(Expectation("f of mode 1 [Hz]", 240.0, 0.5, 240.0, True),),
    )


@pytest.fixture(scope="module")
def reports(result: StudyResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with ``r.html``, ``r.pdf`` and ``r.docx`` of one study."""
    folder = tmp_path_factory.mktemp("reports")
    assert ema.report.write(result, folder / "r.html", ("html", "pdf", "docx")) == folder / "r.html"
    return folder


def word_tables(path: Path) -> list[list[list[str]]]:
    """Tables of a Word file without that of the front page's facts."""
    return [[[cell.text for cell in row.cells] for row in table.rows] for table in docx.Document(str(path)).tables[1:]]


def pdf_words(path: Path) -> str:
    """The text of a PDF without blanks: where lines break is a matter of looks."""
    return re.sub(r"\s+", "", "".join(page.extract_text() for page in pypdf.PdfReader(path).pages))


def test_word_holds_every_table_of_the_page(reports: Path):
    in_page = Page(reports / "r.html").tables
    assert word_tables(reports / "r.docx") == in_page
    assert len(in_page) > 10


def test_pdf_holds_every_number_of_the_page(reports: Path):
    words = pdf_words(reports / "r.pdf")
    cells = {cell for table in Page(reports / "r.html").tables for row in table for cell in row}
    assert "243.1200 ± 0.0098" in cells and "1018 ± 27" in cells
    missing = [cell for cell in cells if re.sub(r"\s+", "", cell) not in words]
    assert missing == []


def test_the_answer_is_the_same_in_all_formats(reports: Path):
    page = Page(reports / "r.html").source
    answers = re.findall(r"<li>(.*?)</li>", page.split('id="answer"')[1].split("</section>")[0])
    assert len(answers) >= 4
    told = docx.Document(str(reports / "r.docx"))
    listed = [paragraph.text for paragraph in told.paragraphs if paragraph.style.name == "List Bullet"]
    assert listed[: len(answers)] == answers
    words = pdf_words(reports / "r.pdf")
    for answer in answers:
        assert re.sub(r"\s+", "", answer) in words


def test_the_tables_beside_the_report_hold_the_same_numbers_in_full(reports: Path):
    with (reports / "r_tables" / "modes_beam_1kN.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    shown = next(table for table in word_tables(reports / "r.docx") if "F_N J1 [N]" in table[0])
    for row, cells in zip(rows, shown[1:], strict=True):
        for name in ("f [Hz]", "ζ [%]"):
            middle, half = map(float, cells[shown[0].index(name)].split(" ± "))
            assert float(row[name]) == pytest.approx(middle, abs=half)


def test_every_figure_is_in_every_format_with_its_words(reports: Path):
    images = Page(reports / "r.html").images
    told = docx.Document(str(reports / "r.docx"))
    descriptions = [shape._inline.docPr.get("descr") for shape in told.inline_shapes]
    assert descriptions == [image["alt"] for image in images]
    reader = pypdf.PdfReader(reports / "r.pdf")
    assert reader.trailer["/Root"]["/MarkInfo"]["/Marked"] == True  # noqa: E712 - an object of the PDF
    words = pdf_words(reports / "r.pdf")
    for number in range(1, len(images) + 1):
        assert f"Figure{number}." in words
        assert any(paragraph.text.startswith(f"Figure {number}. ") for paragraph in told.paragraphs)


def test_text_from_files_stays_text_in_every_format(reports: Path):
    told = docx.Document(str(reports / "r.docx"))
    assert any(EVIL in paragraph.text for paragraph in told.paragraphs)
    assert re.sub(r"\s+", "", EVIL) in pdf_words(reports / "r.pdf")
    assert b"/JavaScript" not in (reports / "r.pdf").read_bytes()


def test_pages_fit_their_content(reports: Path):
    done = subprocess.run(["pdftotext", "-bbox", reports / "r.pdf", "-"], capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip("pdftotext is absent")
    width = float(re.search(r'<page width="([\d.]+)"', done.stdout)[1])
    edges = [float(x) for x in re.findall(r'xMax="([\d.]+)"', done.stdout)]
    assert max(edges) < width - 20


def test_letters_that_no_file_format_can_hold(tmp_path: Path):
    odd = StudyResult(Campaign("a\x00b\x0b\ud800", (), comment="tab\tand\x1b[31m"), ())
    for name in ("pdf", "docx", "html"):
        assert ema.report.write(odd, tmp_path / f"r.{name}").stat().st_size > 1000
    assert "a\ufffdb\ufffd\ufffd" in docx.Document(str(tmp_path / "r.docx")).paragraphs[1].text


def test_the_suffix_chooses_the_format_and_an_unknown_one_is_refused(tmp_path: Path):
    empty = study((), None)
    assert ema.report.write(empty, tmp_path / "a.pdf").read_bytes().startswith(b"%PDF")
    assert ema.report.write(empty, tmp_path / "a.docx").read_bytes().startswith(b"PK")
    with pytest.raises(InputError, match="no such format of a report; got odt, expected html, pdf, docx"):
        ema.report.write(empty, tmp_path / "a", ("odt",))
    assert not (tmp_path / "a.html").exists()


def test_a_missing_package_is_told_with_its_extra(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setitem(__import__("sys").modules, "docx", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'friction-ema\[office\]'"):
        ema.report.write(study((), None), tmp_path / "r.docx")


def _picture(kind: str) -> bytes:
    import io

    import PIL.Image

    held = io.BytesIO()
    PIL.Image.new("RGB", (40, 30), "red").save(held, kind)
    return held.getvalue()


_DAMAGED = {
    "no segments": b"\xff\xd8\xff" + bytes(50),
    "cut JPEG": _picture("JPEG")[:25],
    "cut PNG": _picture("PNG")[:20],
    "signature": b"\x89PNG\r\n\x1a\n",
    "odd marker": _picture("JPEG")[:4] + b"\xff\xff" + _picture("JPEG")[9:30],
    "cut GIF": b"GIF89a",
}


@pytest.mark.parametrize("content", _DAMAGED.values(), ids=_DAMAGED.keys())
def test_a_damaged_photograph_does_not_cost_the_word_file(tmp_path: Path, content: bytes):
    (tmp_path / "table.jpg").write_bytes(content)
    base = study((), None)
    shown = replace(base, campaign=replace(base.campaign, folder=str(tmp_path), photos=("table.jpg",)))
    told = docx.Document(str(ema.report.write(shown, tmp_path / "r.docx")))
    assert any("table.jpg: this image cannot be shown" in paragraph.text for paragraph in told.paragraphs)


def test_equal_results_give_equal_word_files(tmp_path: Path):
    first, second = (ema.report.write(study((), None), tmp_path / name / "r.docx") for name in "ab")
    texts = [[p.text for p in docx.Document(str(path)).paragraphs] for path in (first, second)]
    assert texts[0] == texts[1]


def test_moving_shapes_are_those_of_the_model(result: StudyResult, reports: Path):
    told = json.loads(Page(reports / "r.html").scripts[0])
    model = result.runs[0].modes
    assert told["modes"][0].startswith("1: 240 Hz, 0.1 %")
    numbers = np.frombuffer(base64.b64decode(told["shapes"][1]), "<i2").reshape(2, -1, 3) / 32000
    expected = model.shapes[:, 1].real / np.abs(model.shapes[:, 1]).max()
    sign = np.sign(numbers[0, 0, 2] * expected[0])
    np.testing.assert_allclose(sign * numbers[0, :, 2], expected, atol=1e-4)
    assert np.abs(numbers[1]).max() < 1e-4 and np.abs(numbers[0, :, :2]).max() == 0


def test_5000_points_and_200_modes_stay_below_15_megabytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from ema.report.motion import animation
    from tests.unit.report_corpus import modal

    geometry = plate(100, 50)
    few = modal(geometry, 20, 1.0, 1.0, ())
    many = replace(
        few,
        poles=np.repeat(few.poles, 10),
        shapes=np.repeat(few.shapes, 10, axis=1),
        covariance=None,
        participation=np.repeat(few.participation, 10, axis=1),
        confidence=None,
    )
    moving = animation(many, geometry, "many")
    assert moving is not None and len(moving.data) < 5e6
    assert "The first 33 modes; 167 more are drawn at rest below." in moving.caption


def test_no_point_no_motion():
    from ema.report.motion import animation

    nothing = Geometry(np.zeros(0, int), np.zeros((0, 3)))
    run = run_result("one", plate(5, 4), count=1)
    assert animation(run.modes, nothing, "one") is None


def test_a_place_that_cannot_be_written_is_said(tmp_path: Path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FailureError, match="cannot be written"):
        ema.report.write(study((), None), tmp_path / "file" / "r.docx")


def test_moving_shapes_hide_no_picture():
    """A module of a room must not take the name of one of its functions."""
    import ema.show
    import ema.show.moving

    for name in ema.show.__all__:
        assert callable(getattr(ema.show, name)), name
