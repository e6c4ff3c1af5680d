"""The glossary of the docs names what is public, and no word of a public name is a private one."""

import inspect
import re
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

SNAPSHOT = Path(__file__).with_name("public_names.txt")

VERBS_AND_FILES = """
add align animate assemble cache checked confirmed curve describe difference distribute document entries error expand
explain fetch field file find findings folder format identify language load mark measure merge name next open overlay
overview own plot plural predict preferred propose rank realise recommended register renamed rendered renderer
replacing respond save serve smooth speaking summary text updated validated warn word works write
"""
ORDINARY = frozenset(VERBS_AND_FILES.split())
"""English words that are no terms: verbs, and nouns of files and programs, with their ordinary meaning."""

PROJECTS = frozenset({"dataframe", "pyfbs", "pyoma", "sdynpy", "sdypy", "xarray"})
"""Names of other packages and of their objects, in the functions that exchange objects with them."""


@pytest.fixture(scope="module")
def glossary(root: Path) -> str:
    return (root / "docs" / "glossary.md").read_text(encoding="utf-8")


def public() -> dict[str, object]:
    """Every public name without its package, and what it stands for; packages are left out."""
    names = [name.rpartition(".") for name in SNAPSHOT.read_text(encoding="utf-8").split()]
    things = {name: getattr(import_module(package), name) for package, _, name in names}
    return {name: thing for name, thing in things.items() if not isinstance(thing, ModuleType)}


def quoted(glossary: str) -> set[str]:
    """Identifiers between backticks."""
    return set(re.findall(r"[A-Za-z_]\w*", " ".join(re.findall(r"`([^`\n]+)`", glossary))))


def is_class_name(name: str) -> bool:
    """Whether a name is written as that of a class; so are the functions that make a friction law."""
    return re.fullmatch(r"[A-Z][A-Za-z]*[a-z][A-Za-z]*", name) is not None


def unknown_words(name: str, glossary: str) -> list[str]:
    """Words of a name that are in no row of the glossary, in the singular or the plural, and are not ordinary English."""
    known = set(re.findall(r"[a-z0-9]+", glossary.lower())) | ORDINARY | PROJECTS
    words = [word for word in name.split("_") if word]
    return [word for word in words if not {word, word.removesuffix("s"), f"{word}s"} & known]


def test_every_public_class_is_in_the_glossary(glossary: str) -> None:
    classes = {name for name, thing in public().items() if inspect.isclass(thing) or is_class_name(name)}
    assert len(classes) > 100
    assert sorted(classes - quoted(glossary)) == [], "each needs a row: name, symbol, unit, one sentence"


def test_every_word_of_a_public_function_is_a_term_or_ordinary_english(glossary: str) -> None:
    functions = [name for name, thing in public().items() if inspect.isroutine(thing) and not is_class_name(name)]
    assert len(functions) > 150
    strange = {name: words for name in functions if (words := unknown_words(name, glossary))}
    assert strange == {}, "a private word: use the word of ISO 2041, 7626 or 18431, and give it a row"


def test_every_class_that_the_glossary_names_is_public(glossary: str) -> None:
    words = {name for name in quoted(glossary) if is_class_name(name)}
    assert sorted(words - set(public())) == []


def test_a_private_word_and_an_unlisted_class_are_noticed(glossary: str) -> None:
    assert unknown_words("summit_frequencies", glossary) == ["summit"]
    assert unknown_words("told_damping", glossary) == ["told"]
    assert unknown_words("damping_ratios", glossary) == []
    assert "Summit" not in quoted(glossary) and "Summit" in quoted(glossary + "| top (`Summit`) | | | |\n")
    assert is_class_name("Summit") and not is_class_name("RX") and not is_class_name("shapes")


def test_ordinary_words_are_needed_and_are_no_terms(glossary: str) -> None:
    parts = {part for name in public() for word in name.split("_") for part in (word, word.removesuffix("s"))}
    assert sorted((ORDINARY | PROJECTS) - parts) == [], "no public name has these"
    assert {word for word in ORDINARY if f"`{word}`" in glossary} == set()
    assert VERBS_AND_FILES.split() == sorted(ORDINARY)


def test_rows_have_as_many_cells_as_their_heads(glossary: str) -> None:
    for table in re.findall(r"(?:^\|.*\n)+", glossary, re.M):
        head, _, *rows = [re.split(r"(?<!\\)\|", row)[1:-1] for row in table.splitlines()]
        assert [row for row in rows if len(row) != len(head)] == []
        assert all(row[0].strip() and "".join(row[1:]).strip() for row in rows)
