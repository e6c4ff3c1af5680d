"""The catalogue of findings holds every code that the program can state, and no other."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from ema.messages import explain, kinds

OPEN: dict[str, set[str]] = {
    "acquisition/files/uff/geometry_sets.py": {"coordinate-system", "unit-unstated", "not-finite", "unknown-node"},
    "acquisition/folder.py": {"node-without-position", "direction-unstated"},
    "ema/archive/adding.py": {"not-analysed", "analysed-before"},
    "ema/estimate/amplitude_mode.py": {"force-not-constant", "response-not-constant"},
    "ema/estimate/frf_checks.py": {"not-a-number", "dead-channel"},
    "ema/estimate/hammer_findings.py": {
        "excluded-impact", "double-hit", "pre-trigger", "overload", "next-impact", "early-impact", "level", "leakage",
        "under-range", "not-at-rest", "dc-shift",
    },
    "ema/estimate/live.py": {"no-trigger", "no-impact"},
    "ema/fit/opinion.py": {"second-opinion-missing", "second-opinion-extra"},
    "ema/fit/peak_shape.py": {"leaning-peak", "force-noise", "broadened-peak", "smoothed-lines"},
    "ema/place/forecast_findings.py": {"mode-spread", "joint-parts", "no-peak", "no-band"},
    "ema/place/shortlist.py": {"unsolved", "joint-parts"},
    "ema/proposal/proposal.py": {"force-response-swapped", "names-doubled"},
    "ema/study/friction.py": {"stated-frequency", "stated-damping"},
    "ema/study/mapping.py": {"map-with-one-level", "map-with-one-force"},
}  # fmt: skip
"""Where a code is put together or chosen: the codes that come out of it."""


def calls(root: Path) -> Iterator[tuple[str, ast.Call]]:
    for package in ("ema", "acquisition"):
        for path in sorted((root / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Call) and ast.unparse(node.func) in ("Finding", "Finding.of"):
                    yield path.relative_to(root).as_posix(), node


def code_of(call: ast.Call) -> ast.expr:
    named = {keyword.arg: keyword.value for keyword in call.keywords}
    return named["code"] if "code" in named else call.args[1]


def test_every_code_is_in_the_catalogue_and_every_entry_is_stated_somewhere(root: Path) -> None:
    stated, chosen = set(), set()
    for path, call in calls(root):
        code = code_of(call)
        if isinstance(code, ast.Constant):
            stated.add(code.value)
        else:
            chosen.add(path)
    assert chosen == set(OPEN), "a code that is chosen or put together needs its codes in OPEN above"
    used = stated | set().union(*OPEN.values())
    assert used - set(kinds()) == set(), "these have no entry in ema/messages/findings.toml"
    assert set(kinds()) - used == set(), "nothing states these"


def literals(folder: Path) -> tuple[set[str], set[tuple[str, str]]]:
    """Texts of the modules of a folder: those written out, and what those put together begin and end with."""
    whole, ends = set(), set()
    for path in folder.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            parts: list[ast.expr] = []
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                whole.add(node.value)
            elif isinstance(node, ast.JoinedStr):
                parts = [node.values[0], node.values[-1]]
            elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
                parts = [node.left, node.right]
            texts = [str(part.value) if isinstance(part, ast.Constant) else "" for part in parts]
            if any("-" in text for text in texts):
                ends.add((texts[0], texts[1]))
    return whole, ends


@pytest.mark.parametrize("path", OPEN)
def test_codes_that_are_chosen_stand_in_their_file_or_beside_it(path: str, root: Path) -> None:
    whole, ends = literals((root / path).parent)
    for code in OPEN[path]:
        assert code in whole or any(code.startswith(first) and code.endswith(last) for first, last in ends), code


def test_meanings_are_sentences_and_pages_exist(root: Path) -> None:
    for kind in kinds().values():
        assert re.fullmatch(r"[A-Z].*\.", kind.meaning), kind
        assert (root / "docs" / f"{kind.page}.md").is_file(), kind
        assert re.fullmatch(r"[a-z]+(-[a-z]+)*", kind.code), kind


def test_the_command_explains_a_code_and_names_the_nearest() -> None:
    from ema.cli.app import app

    runner = CliRunner()
    told = runner.invoke(app, ["explain", "double-hit"])
    assert told.exit_code == 0 and explain("double-hit").meaning in told.output
    wrong = runner.invoke(app, ["explain", "dubble-hit"])
    assert wrong.exit_code == 2 and "double-hit" in wrong.output
    everything = runner.invoke(app, ["explain", "--json"])
    assert everything.exit_code == 0 and '"code": "overload"' in everything.output


def test_the_page_gives_each_code_the_severity_and_the_advice_that_it_is_stated_with(root: Path) -> None:
    """Codes chosen in a loop or beside others: read from the sources by hand."""
    page = (root / "docs" / "findings.md").read_text(encoding="utf-8")
    table = [line.removesuffix(" |").split(" | ") for line in page.splitlines() if line.startswith("| `")]
    rows = {code.strip("|` "): (severity, advice) for code, severity, _, advice in table}
    assert set(rows) == set(kinds())
    assert rows["dead-channel"] == ("error", "Check sensor and cable.")
    assert rows["not-a-number"] == ("error", "It was not measured, or its record is damaged.")
    assert rows["campaign-changed"][1] == "Add it again: `ema archive add` with the archive alone does so for all."
    assert rows["joint-parts"] == ("warning", "Such conditions count as unsuitable; press more, or excite less.")
    assert rows["dc-shift"][0] == rows["not-one-mode"][0] == "info, warning"
    assert rows["response-not-constant"][0] == rows["map-with-one-force"][0] == "warning"
    unstated = [code for code, (severity, _) in rows.items() if not severity]
    assert unstated == [], "a code whose severity the page cannot read: state it where the finding is made"
