"""Write what the pages take from the program: formats, findings, errors and tutorials: `python docs/write_pages.py`.

A test compares; a page that has gone stale fails it.
"""

import ast
import re
from collections import defaultdict
from pathlib import Path

import acquisition
from ema.messages import kinds
from tests.unit.written_sentences import alternatives, assigned, enclosing, findings, skeleton, trees, written_calls

ROOT = Path(__file__).resolve().parent.parent
SEVERITIES = ("info", "warning", "error")
PAGES = ("errors.md", "findings.md", "formats.md", "tutorials.md")
AREAS = {
    "acquisition/files/": ("Files of measurements", "formats"),
    "acquisition/live/": ("Measuring", "record"),
    "acquisition/": ("Campaigns", "campaign"),
    "ema/estimate/": ("FRFs and decays", "theory/estimation"),
    "ema/fit/": ("Modes", "theory/estimation"),
    "ema/contact/": ("Friction laws", "laws"),
    "ema/simulate/": ("Models and simulation", "simulate"),
    "ema/compare/": ("Comparison and prediction", "compare"),
    "ema/place/": ("Places of friction beams", "placement"),
    "ema/study/": ("Recipes", "getting-started"),
    "ema/store/": ("Stored results", "api"),
    "ema/archive/": ("Archives", "archive"),
    "ema/report/": ("Reports", "report"),
    "ema/show/": ("Pictures", "api"),
    "ema/app/": ("The browser", "browser"),
    "ema/cli/": ("Commands", "getting-started"),
    "": ("Data in general", "api"),
}
"""What an error is about, by where it arises, and the page that explains it; the first that fits."""
ERRORS = ("InputError", "UnitError", "UndescribedError", "MissingExtraError", "FailureError", "CancelledError")
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


def _words(node: ast.expr | None) -> str:
    """The text of an expression, three dots for what is filled in; empty where it is no text."""
    if isinstance(node, ast.Constant):
        return str(node.value) if node.value else ""
    if isinstance(node, ast.JoinedStr):
        return "".join(str(part.value) if isinstance(part, ast.Constant) else "…" for part in node.values)
    return ""


def _texts(node: ast.expr | None, call: ast.Call) -> list[str]:
    """What an argument of a finding may say, three dots for what is filled in; none where that is not written there."""
    scope = enclosing()[call]
    if isinstance(node, ast.Name) and sum(_uses(other, node.id) for other in ast.walk(scope)) > 1:
        # a variable that serves several findings has for each what it was set to last
        before = [value for value in assigned(node.id, scope) or () if value.lineno <= call.lineno]
        node = max(before, key=lambda value: value.lineno, default=None)
    return [skeleton(text).replace("{}", "…") for text in alternatives(node, scope) or ()]


def _uses(node: ast.AST, name: str) -> bool:
    """Whether a node is the statement of a finding with a variable of this name."""
    return isinstance(node, ast.Call) and ast.unparse(node.func) in ("Finding", "Finding.of") and any(
        isinstance(one, ast.Name) and one.id == name for one in (*node.args, *(each.value for each in node.keywords))
    )


def _stated() -> tuple[dict[str, set[str]], dict[str, list[str]]]:
    """Severities and advice of each code, as the program states them."""
    severities: dict[str, set[str]] = defaultdict(set)
    advice: dict[str, list[str]] = defaultdict(list)
    fields = ("severity", "code", "where", "message", "value", "limit", "advice")
    elsewhere: list[tuple[str, ast.expr, list[str]]] = []
    for path, call in findings():
        # behind its message, Finding.of has numbers and no advice
        places = fields if ast.unparse(call.func) == "Finding" else fields[:4]
        given = dict(zip(places, call.args)) | {keyword.arg: keyword.value for keyword in call.keywords}
        codes, texts = _texts(given.get("code"), call), _texts(given.get("advice"), call)
        levels = [_words(part) for part in ast.walk(given["severity"]) if isinstance(part, ast.Constant)]
        levels = [level for level in levels or _texts(given["severity"], call) if level in SEVERITIES]
        if not any(code in kinds() for code in codes):
            elsewhere.append((path, given["code"], levels))
        # a loop over codes has an advice for each, in the same order
        looped = isinstance(given.get("advice"), ast.Name) and len(codes) == len(texts)
        for row, code in enumerate(codes):
            severities[code].update(levels)
            for text in texts[row : row + 1] if looped and len(codes) > 1 else texts:
                sentence = text if text.endswith((".", "?", "…")) else f"{text[:1].upper()}{text[1:]}."
                if text.strip("…") and sentence not in advice[code]:
                    advice[code].append(sentence)
    for code in set(kinds()) - set(severities):
        # a code that a variable holds is written elsewhere in the module, or has a text of the statement at its end
        for path, node, levels in elsewhere:
            parts = [part for part in map(_words, ast.walk(node)) if part and "…" not in part]
            if code in _constants(path) or any(code.startswith(part) or code.endswith(part) for part in parts):
                severities[code].update(levels)
    return severities, advice


def _constants(path: str) -> set[object]:
    """The literals of a module."""
    return {node.value for node in ast.walk(trees()[ROOT / path]) if isinstance(node, ast.Constant)}


def findings_table() -> str:
    """One table per page of the docs, one row per kind."""
    severities, advice = _stated()
    lines: list[str] = []
    page = ""
    for kind in kinds().values():
        if kind.page != page:
            page = kind.page
            lines += ["", f"## See [{_title(page)}]({page}.md)", "", "| code | severity | what it says | what to do |",
                      "|---|---|---|---|"]
        grave = [name for name in SEVERITIES if name in severities[kind.code]]
        told = " ".join(advice[kind.code]).replace("|", "\\|")
        lines.append(f"| `{kind.code}` | {', '.join(grave) } | {kind.meaning} | {told or '–'} |")
    return "\n".join(lines).lstrip("\n") + "\n"


def _said_of(call: ast.Call) -> tuple[list[str], list[str], list[str]]:
    """What an error may say, what it expects and what it advises, three dots for what is filled in."""
    given = {keyword.arg: keyword.value for keyword in call.keywords}
    parts = (call.args[0] if call.args else given.get("what"), given.get("expected"), given.get("advice"))
    texts: list[list[str]] = []
    for node in parts:
        said = [skeleton(one).replace("{}", "…") for one in alternatives(node, enclosing()[call]) or ()]
        texts.append([one for one in dict.fromkeys(said) if re.search("[A-Za-z]", one)])
    # what the case alone knows, such as the names there are
    expected, advice = (text or ["…"] * (node is not None) for text, node in zip(texts[1:], parts[1:]))
    return texts[0], expected, advice


def errors_table() -> str:
    """One table per area, one row per sentence."""
    areas: dict[str, dict[str, tuple[dict[str, None], dict[str, None]]]] = {prefix: {} for prefix in AREAS}
    for path, calls in written_calls().items():
        place = path.relative_to(ROOT).as_posix()
        rows = areas[next(prefix for prefix in AREAS if place.startswith(prefix))]
        for call in calls:
            if ast.unparse(call.func) in ERRORS:
                whats, expected, advice = _said_of(call)
                for what in whats:
                    wanted, steps = rows.setdefault(what, ({}, {}))
                    wanted |= dict.fromkeys(expected)
                    steps |= dict.fromkeys(advice)
    lines: list[str] = []
    for prefix, (title, page) in AREAS.items():
        lines += ["", f"## {title}", "", f"See [{_title(page)}]({page}.md).", "",
                  "| what | expected | next step |", "|---|---|---|"]
        for what, told in sorted(areas[prefix].items(), key=lambda row: row[0].lower().lstrip("…'\"` ")):
            cells = (what, *("; ".join(each) or "–" for each in told))
            lines.append("| " + " | ".join(_escaped(cell) for cell in cells) + " |")
    return "\n".join(lines).lstrip("\n") + "\n"


def _title(page: str) -> str:
    return (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8").splitlines()[0].removeprefix("# ")


def _escaped(cell: str) -> str:
    """A cell as Markdown shows it literally, but for `what stands between accents`."""
    parts = " ".join(cell.split()).split("`")
    kept = len(parts) % 2 == 1
    for row in range(0, len(parts), 2 if kept else 1):
        parts[row] = re.sub(r"([\\|*_<>\[\]$#~])", r"\\\1", parts[row])
    return ("`" if kept else "\\`").join(parts)


def journey(number: int) -> str:
    """The file of a journey, as it is."""
    text = (ROOT / "tests" / "journeys" / f"journey_{number}.py").read_text(encoding="utf-8")
    return f"```python\n{text}```\n"


def written(page: str) -> str:
    """The page as it should be."""

    tables = {"errors": errors_table, "formats": formats_table, "findings": findings_table}

    def filled(found: re.Match[str]) -> str:
        what, _, number = found["name"].partition(" ")
        return found[1] + tables[what]() + found[3] if what in tables else found[1] + journey(int(number)) + found[3]

    return _REGION.sub(filled, (ROOT / "docs" / page).read_text(encoding="utf-8"))


def main() -> None:
    """Write the pages anew."""
    for page in PAGES:
        text = written(page)
        (ROOT / "docs" / page).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
