"""The site holds every page of ``docs/`` and every package that has public names."""

import re
from pathlib import Path


def test_every_page_is_in_a_table_of_contents(root: Path) -> None:
    text = (root / "docs" / "index.md").read_text(encoding="utf-8")
    listed = {line for block in re.findall(r"```{toctree}\n(.*?)```", text, re.S) for line in block.split()}
    pages = {path.stem for path in (root / "docs").glob("*.md")} - {"index"}
    assert not pages - listed


def test_the_reference_lists_every_package_with_public_names(root: Path) -> None:
    names = (root / "tests" / "architecture" / "public_names.txt").read_text(encoding="utf-8").split()
    packages = {name.rpartition(".")[0] for name in names} - {"ema", "ema.app"}
    text = (root / "docs" / "api.md").read_text(encoding="utf-8")
    assert packages <= set(re.findall(r"^   ([a-z.]+)$", text, re.M))
