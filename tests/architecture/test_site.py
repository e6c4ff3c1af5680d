"""The site holds every page of ``docs/`` and every package that has public names."""

import ast
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


def test_every_example_of_the_gallery_asserts_what_it_states(root: Path) -> None:
    """The build of the site runs them and ends at the first assertion that fails."""
    examples = sorted((root / "docs" / "gallery").glob("*.py"))
    assert len(examples) >= 7
    for path in examples:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        assert path.name.startswith("plot_"), path
        assert any(isinstance(node, ast.Assert) for node in ast.walk(tree)), path
        assert (ast.get_docstring(tree) or "").strip(), path


def test_every_page_of_the_theory_is_listed_and_names_its_sources(root: Path) -> None:
    folder = root / "docs" / "theory"
    listed = re.findall(r"^([a-z-]+)$", (folder / "index.md").read_text(encoding="utf-8"), re.M)
    pages = {path.stem for path in folder.glob("*.md")} - {"index"}
    assert pages == set(listed)
    for page in pages - {"placing"}:  # which is our own
        assert "## Sources" in (folder / f"{page}.md").read_text(encoding="utf-8"), page
