"""The part of a page that a bench writes: what stands between two comments that name it."""

from pathlib import Path


def write(page: Path, mark: str, text: str) -> None:
    """Put ``text`` between ``<!-- mark: begin -->`` and ``<!-- mark: end -->`` of a page, which has each once."""
    begin, end = f"<!-- {mark}: begin -->", f"<!-- {mark}: end -->"
    before, rest = page.read_text(encoding="utf-8").split(begin)
    _, after = rest.split(end)
    page.write_text(f"{before}{begin}\n{text}\n{end}{after}", encoding="utf-8")
