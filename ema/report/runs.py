"""The sections of one run, in the order of the measurement chain."""

from ema.data import Geometry, RunResult
from ema.messages import text
from ema.report.blocks import Book, Section
from ema.report.measured import condition, impacts, overview
from ema.report.modal import auto_mac, complexity, reconstruction, shapes, stabilisation


def run_sections(run: RunResult, geometry: Geometry | None, number: int, book: Book) -> list[Section]:
    """All sections of the run with that number; sections without content are left out."""
    anchor = f"run-{number}"
    sections = [
        Section(text("Condition and normal force"), f"{anchor}-condition", condition(run, book)),
        Section(text("Impacts and usable band"), f"{anchor}-impacts", impacts(run, book)),
        Section(text("Frequency response functions"), f"{anchor}-frfs", overview(run, book)),
        Section(text("Stabilisation diagram"), f"{anchor}-stabilisation", stabilisation(run, book)),
        Section(text("Measured and synthesised FRFs"), f"{anchor}-reconstruction", reconstruction(run, book)),
        Section(text("AutoMAC"), f"{anchor}-automac", auto_mac(run, book)),
        Section(text("Mode shapes"), f"{anchor}-shapes", shapes(run, geometry, book)),
        Section(text("Complexity"), f"{anchor}-complexity", complexity(run, book)),
    ]
    return [section for section in sections if section.blocks]
