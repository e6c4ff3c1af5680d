"""The report as a Word file, to be edited and handed on."""

from datetime import UTC, datetime
from io import BytesIO
from typing import Any

from ema.errors import require
from ema.messages import SOURCE, language, plural, text
from ema.report.blocks import Animation, Block, Picture, Section, Table
from ema.report.document import Document
from ema.report.findings import Group
from ema.report.html import printable

_TEXT_WIDTH = 17.0
"""Centimetres between the margins."""
_SOFT, _ACCENT = "5B6875", "0B5A93"
_COLOURS = {"error": "A4262C", "warning": "8A5A00", "info": _ACCENT}
_UNDATED = datetime(2000, 1, 1, tzinfo=UTC)


def word(document: Document, tables: str) -> bytes:
    """Write the report as a Word document.

    Parameters
    ----------
    document : Document
        Report with its chapters.
    tables : str
        Name of the folder with the CSV files, for the sentences that point to it.

    Returns
    -------
    bytes
        Content of a .docx file.

    Raises
    ------
    MissingExtraError
        python-docx is not installed.
    """
    require("docx", "office")
    writer = _Writer(document.title, tables)
    writer.front(document)
    for chapter in document.chapters:
        writer.heading(chapter.title, 1, new_page=bool(chapter.sections))
        writer.blocks(chapter.blocks)
        for section in chapter.sections:
            writer.section(section, 2)
    return writer.content()


def _widths(table: Table) -> list[int]:
    """Widths of the columns in the units of Word: as the longest text needs, so that long ones are broken first."""
    from docx.shared import Cm

    columns = list(zip(table.columns, *(row for row in table.rows), strict=False))[: table.shown]
    weights = []
    for head, *cells in columns:
        longest = max((len(word) + 5 for word in str(head).split()), default=0)
        weights.append(max(8, longest, min(40, max((len(str(cell)) + 3 for cell in cells), default=0))))
    return [int(Cm(_TEXT_WIDTH * weight / sum(weights))) for weight in weights]


class _Writer:
    """Puts the parts of a document into a Word file."""

    def __init__(self, title: str, tables: str) -> None:
        from docx import Document as new_file
        from docx.shared import Cm, Pt

        self._file: Any = new_file()
        self._tables = tables
        section = self._file.sections[0]
        section.page_width, section.page_height = Cm(21.0), Cm(29.7)
        section.left_margin = section.right_margin = Cm(2.0)
        section.top_margin = section.bottom_margin = Cm(2.0)
        style = self._file.styles["Normal"]
        style.font.name, style.font.size = "Calibri", Pt(10)
        style.paragraph_format.space_after = Pt(4)
        if language() != SOURCE:  # for the spelling checker
            self._spoken(style)
        about = self._file.core_properties
        # without a date of its own, equal results give equal files
        about.title, about.author, about.created, about.modified = (
            printable(title)[:255],
            "friction-ema",
            _UNDATED,
            _UNDATED,
        )
        about.comments = ""
        self._page_numbers(section.footer.paragraphs[0], title)

    @staticmethod
    def _spoken(style: Any) -> None:
        """The language of the text."""
        from docx.oxml import OxmlElement
        from docx.oxml.ns import qn

        mark = OxmlElement("w:lang")
        mark.set(qn("w:val"), language())
        style.element.get_or_add_rPr().append(mark)

    def content(self) -> bytes:
        """Bytes of the finished file."""
        target = BytesIO()
        self._file.save(target)
        return target.getvalue()

    def front(self, document: Document) -> None:
        """The front page: title, answers, findings and expected values."""
        if document.logo is not None:
            self._logo(document.logo)
        self.paragraph(text("Experimental modal analysis").upper(), size=8, colour=_ACCENT, bold=True)
        self._file.add_heading(printable(document.title), 0)
        self._facts(document.facts)
        if document.comment:
            self.paragraph(document.comment, colour=_SOFT)
        self.blocks(document.photos)
        self.heading(text("In short"), 1)
        for line in document.summary:
            self._file.add_paragraph(printable(line), style="List Bullet")
        for section in document.answers:
            self.section(section, 1)
        self.heading(text("Findings"), 1)
        if document.language_note:
            self.paragraph(document.language_note, colour=_SOFT)
        for group in document.finding_groups:
            self._finding_group(group)
        if not document.finding_groups:
            self.paragraph(text("None."))
        if document.findings:
            self._table(document.findings)
        if document.expectations:
            self.heading(text("Expected and found"), 1)
            self._table(document.expectations)

    def heading(self, text: str, level: int, new_page: bool = False) -> None:
        """Append a heading, on a new page where that is wanted."""
        heading = self._file.add_heading(printable(text), level)
        heading.paragraph_format.page_break_before = new_page

    def section(self, section: Section, level: int) -> None:
        """Append a section under a heading of this level."""
        self.heading(section.title, level)
        self.blocks(section.blocks)

    def blocks(self, blocks: list[Block]) -> None:
        """Append texts, pictures and tables; animations have no place on paper and are left out."""
        for block in blocks:
            if isinstance(block, Table):
                self._table(block)
            elif isinstance(block, Picture):
                self._picture(block)
            elif not isinstance(block, Animation):
                self.paragraph(block.text, italic=block.missing, colour=_SOFT if block.missing else "")

    def paragraph(self, text: str, size: float = 0, colour: str = "", bold: bool = False, italic: bool = False) -> Any:
        """Append a paragraph, with size in pt and colour as six hexadecimal digits, and return it."""
        paragraph = self._file.add_paragraph()
        self._run(paragraph, text, size, colour, bold, italic)
        return paragraph

    @staticmethod
    def _run(
        paragraph: Any, text: str, size: float = 0, colour: str = "", bold: bool = False, italic: bool = False
    ) -> None:
        from docx.shared import Pt, RGBColor

        run = paragraph.add_run(printable(text))
        run.bold, run.italic = bold or None, italic or None
        if size:
            run.font.size = Pt(size)
        if colour:
            run.font.color.rgb = RGBColor.from_string(colour)

    def _facts(self, facts: list[tuple[str, str]]) -> None:
        from docx.shared import Cm

        table = self._file.add_table(0, 2)
        table.autofit = False
        table.columns[0].width, table.columns[1].width = Cm(3.0), Cm(_TEXT_WIDTH - 3.0)
        for label, value in facts:
            cells = table.add_row().cells
            cells[0].width, cells[1].width = Cm(3.0), Cm(_TEXT_WIDTH - 3.0)
            self._run(cells[0].paragraphs[0], label, colour=_SOFT)
            self._run(cells[1].paragraphs[0], value, bold=True)
        self._file.add_paragraph()

    def _finding_group(self, group: Group) -> None:
        paragraph = self.paragraph(f"{group.name.upper()}  ", bold=True, colour=_COLOURS[group.severity])
        times = f"  {plural('{count} time', '{count} times', len(group.findings))}" if len(group.findings) > 1 else ""
        self._run(paragraph, group.code, bold=True)
        self._run(paragraph, times, colour=_SOFT)
        paragraph.paragraph_format.keep_with_next = True
        if group.meaning:
            self.paragraph(group.meaning)
        for place, finding in enumerate(group.listed):
            line = self._file.add_paragraph(style=None if place == 0 else "List Bullet")
            self._run(line, f"{finding.where}: ", colour=_SOFT)
            self._run(line, finding.message)
            if place == 0 and group.advice:
                self.paragraph(f"→ {group.advice}", colour=_ACCENT)
        if len(group.findings) > len(group.listed):
            more = len(group.findings) - len(group.listed)
            self.paragraph(text("{more} more in the table beside this report", more=more), colour=_SOFT)

    def _logo(self, logo: Block) -> None:
        """The logo at the right, no wider than a quarter of the text and no higher than 1.6 cm."""
        from docx.enum.text import WD_ALIGN_PARAGRAPH
        from docx.shared import Cm

        if not isinstance(logo, Picture):
            self.blocks([logo])
        elif (shape := self._placed(logo)) is not None:
            width, height = shape.width, shape.height
            scale = min(Cm(_TEXT_WIDTH / 4) / width, Cm(1.6) / height)
            shape.width, shape.height = int(width * scale), int(height * scale)
            self._file.paragraphs[-1].alignment = WD_ALIGN_PARAGRAPH.RIGHT

    def _placed(self, picture: Picture) -> Any:
        """The image in a paragraph of its own; a sentence where Word cannot show it."""
        from docx.shared import Cm

        image = picture.png or picture.image
        try:
            shape = self._file.add_picture(BytesIO(image.content), width=Cm(_TEXT_WIDTH * picture.width / 100))
        except Exception:  # readers of images fail in ways of their own
            self.paragraph(
                text("{picture}: this image cannot be shown in a Word file.", picture=picture.alt),
                italic=True,
                colour=_SOFT,
            )
            return None
        shape._inline.docPr.set("descr", printable(picture.alt))
        return shape

    def _picture(self, picture: Picture) -> None:
        from docx.enum.text import WD_ALIGN_PARAGRAPH

        if self._placed(picture) is None:
            return
        paragraph = self._file.paragraphs[-1]
        paragraph.paragraph_format.keep_with_next = True
        paragraph.alignment = WD_ALIGN_PARAGRAPH.LEFT
        self._caption(
            "" if picture.number is None else text("Figure {number}.", number=picture.number), picture.caption
        )

    def _caption(self, number: str, text: str) -> Any:
        paragraph = self._file.add_paragraph()
        self._run(paragraph, f"{number} " if number else "", bold=True, size=9)
        self._run(paragraph, text, colour=_SOFT, size=9)
        return paragraph

    def _table(self, table: Table) -> None:
        caption = self._caption(
            text("Table {number}.", number=table.number), f"{table.caption} ({self._tables}/{table.name}.csv)"
        )
        if not table.shown:
            return
        caption.paragraph_format.keep_with_next = True
        columns = table.columns[: table.shown]
        size = 9.0 if len(columns) <= 6 else 8.0 if len(columns) <= 8 else 6.5
        grid = self._file.add_table(1, len(columns), style="Light List Accent 1")
        grid.autofit = False
        self._row(grid.rows[0], columns, size, bold=True)
        self._repeated(grid.rows[0])
        for row in table.rows:
            self._row(grid.add_row(), row[: table.shown], size)
        for column, width in zip(grid.columns, _widths(table), strict=True):
            column.width = width
            for cell in column.cells:
                cell.width = width
        self._file.add_paragraph().paragraph_format.space_after = 0

    def _row(self, row: Any, cells: Any, size: float, bold: bool = False) -> None:
        from docx.shared import Pt

        for place, (target, cell) in enumerate(zip(row.cells, cells, strict=True)):
            paragraph = target.paragraphs[0]
            paragraph.paragraph_format.space_after = Pt(0)
            paragraph.add_run(printable(cell)).font.size = Pt(size)
            # the style of the table prints its first column in bold
            paragraph.runs[0].bold = bold or (False if place == 0 else None)
        self._whole(row)

    @staticmethod
    def _repeated(row: Any) -> None:
        """The row comes again on every page."""
        from docx.oxml import OxmlElement

        row._tr.get_or_add_trPr().append(OxmlElement("w:tblHeader"))

    @staticmethod
    def _whole(row: Any) -> None:
        """The row is not broken over pages."""
        from docx.oxml import OxmlElement

        row._tr.get_or_add_trPr().append(OxmlElement("w:cantSplit"))

    def _page_numbers(self, paragraph: Any, title: str) -> None:
        from docx.oxml import OxmlElement
        from docx.oxml.ns import qn
        from docx.shared import Pt

        self._run(paragraph, f"{title[:90]}   ", size=8, colour=_SOFT)
        for kind, code in (("begin", ""), ("", "PAGE"), ("end", "")):
            run = paragraph.add_run()
            run.font.size = Pt(8)
            if kind:
                mark = OxmlElement("w:fldChar")
                mark.set(qn("w:fldCharType"), kind)
            else:
                mark = OxmlElement("w:instrText")
                mark.text = code
            run._r.append(mark)
