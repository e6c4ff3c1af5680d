"""Write what the pages take from the program: the file formats and the journeys: `python docs/write_pages.py`.

A test compares; a page that has gone stale fails it.
"""

import re
from pathlib import Path

import acquisition

ROOT = Path(__file__).resolve().parent.parent
PAGES = ("formats.md", "journeys.md")
_REGION = re.compile(r"(<!-- (?P<name>[\w ]+) -->\n).*?(<!-- end -->)", re.S)


def formats_table() -> str:
    """One row per format."""
    lines = ["| format | name | suffixes | reads | writes | needs |", "|---|---|---|---|---|---|"]
    for one in acquisition.formats():
        needs = f'`pip install "friction-ema[{one.extra}]"`' if one.extra else "nothing"
        cells = (one.title, f"`{one.name}`", " ".join(f"`{suffix}`" for suffix in one.suffixes),
                 ", ".join(one.reads), ", ".join(one.writes) or "–", needs)
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def journey(number: int) -> str:
    """The file of a journey, as it is."""
    text = (ROOT / "tests" / "journeys" / f"journey_{number}.py").read_text(encoding="utf-8")
    return f"```python\n{text}```\n"


def written(page: str) -> str:
    """The page as it should be."""

    def filled(found: re.Match[str]) -> str:
        what, _, number = found["name"].partition(" ")
        return found[1] + (formats_table() if what == "formats" else journey(int(number))) + found[3]

    return _REGION.sub(filled, (ROOT / "docs" / page).read_text(encoding="utf-8"))


def main() -> None:
    """Write the pages anew."""
    for page in PAGES:
        text = written(page)
        (ROOT / "docs" / page).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
