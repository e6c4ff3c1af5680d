"""The words of reports in other languages: no sentence is missing, no number is lost, and English stays what it was."""

import ast
import html
import json
import re
import string
import threading
import urllib.request
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, get_args

import pytest
from typer.testing import CliRunner

import ema.report
from ema import examples, store
from ema.app.words import marked, said
from ema.data.condition import ExcitationKind, LoadingSequence
from ema.data.findings import Finding
from ema.data.results import Verdict
from ema.errors import InputError
from ema.messages import entries, kinds, language, languages, mark, plural, preferred, speaking, text, word
from ema.place.budget import HARMONICS, REST
from ema.report.modes import _in_words
from ema.study import recipe
from ema.study.recipe import Quantity
from tests.unit.report_corpus import results
from tests.unit.report_page import Page, blank

OTHERS = [name for name in languages() if name != "en"]
FUNCTIONS = {"text": 1, "mark": 1, "plural": 2}
NUMBER = r"(?<![A-Za-z_])[-+±]?\d+(?:\.\d+)?"
ROOT = Path(__file__).parents[2]
IN_ENGLISH: dict[str, int] = {
    "acquisition/files/arrays.py": 2,
    "acquisition/files/finite_elements/rst.py": 1,
    "acquisition/files/hdf5.py": 2,
    "acquisition/files/lvm.py": 2,
    "acquisition/files/mdf4.py": 2,
    "acquisition/files/points.py": 3,
    "acquisition/files/polar.py": 2,
    "acquisition/files/ratios.py": 3,
    "acquisition/files/reconcile.py": 1,
    "acquisition/files/sampled.py": 1,
    "acquisition/files/sanity.py": 3,
    "acquisition/files/shapes.py": 1,
    "acquisition/files/signals.py": 5,
    "acquisition/files/table/blocks.py": 1,
    "acquisition/files/table/damage.py": 2,
    "acquisition/files/table/reading.py": 2,
    "acquisition/files/tdms.py": 4,
    "acquisition/files/uff/functions.py": 9,
    "acquisition/files/uff/geometry_sets.py": 2,
    "acquisition/files/uff/mode_sets.py": 4,
    "acquisition/files/uff/reading.py": 4,
    "acquisition/files/wav.py": 3,
    "acquisition/files/xlsx.py": 4,
    "acquisition/folder.py": 1,
    "acquisition/registry.py": 1,
    "acquisition/setups.py": 1,
    "ema/archive/adding.py": 2,
    "ema/archive/cache.py": 1,
    "ema/archive/finding.py": 5,
    "ema/archive/record.py": 1,
    "ema/cli/level_control.py": 2,
    "ema/cli/simulations.py": 1,
    "ema/compare/amplitude_prediction.py": 3,
    "ema/compare/amplitude_resolved.py": 3,
    "ema/compare/fitting.py": 4,
    "ema/compare/linearity.py": 2,
    "ema/compare/map_prediction.py": 1,
    "ema/compare/scatter.py": 2,
    "ema/estimate/amplitude_mode.py": 1,
    "ema/estimate/clipping.py": 2,
    "ema/estimate/detection_lines.py": 3,
    "ema/estimate/drift.py": 1,
    "ema/estimate/frf_checks.py": 2,
    "ema/estimate/gain_changes.py": 1,
    "ema/estimate/hammer_findings.py": 1,
    "ema/estimate/live.py": 1,
    "ema/estimate/nonlinearity.py": 2,
    "ema/estimate/record_agreement.py": 1,
    "ema/fit/full_set.py": 1,
    "ema/fit/opinion.py": 1,
    "ema/fit/peaks.py": 1,
    "ema/fit/set_up_shifts.py": 2,
    "ema/place/conditioning.py": 1,
    "ema/place/flags.py": 1,
    "ema/place/shortlist.py": 1,
    "ema/proposal/positions.py": 3,
    "ema/proposal/proposal.py": 1,
    "ema/shapes/alignment.py": 1,
    "ema/shapes/continuation.py": 1,
    "ema/simulate/branches.py": 2,
    "ema/simulate/contact.py": 1,
    "ema/simulate/harmonic_joined.py": 1,
    "ema/simulate/hysteresis.py": 5,
    "ema/simulate/identification.py": 4,
    "ema/simulate/joined.py": 2,
    "ema/simulate/modal_host.py": 2,
    "ema/simulate/nonlinear_modes.py": 3,
    "ema/simulate/steady_states.py": 1,
    "ema/simulate/structure.py": 1,
    "ema/simulate/transient.py": 3,
    "ema/study/friction.py": 2,
    "ema/study/mapping.py": 2,
    "ema/tables/former.py": 1,
}
"""Findings of each file that reach every reader in English, as they are put together there; a new one is written out."""


@cache
def written_calls() -> dict[Path, list[ast.Call]]:
    """All calls in the sources of both packages, read once."""
    paths = (path for package in ("ema", "acquisition") for path in sorted((ROOT / package).rglob("*.py")))
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in paths}
    return {path: [node for node in ast.walk(tree) if isinstance(node, ast.Call)] for path, tree in trees.items()}


def calls() -> Iterator[tuple[str, ast.Call]]:
    """Calls of the functions that take messages, in modules that import them."""
    for path, nodes in written_calls().items():
        if "from ema.messages import" in path.read_text(encoding="utf-8"):
            for node in nodes:
                if getattr(node.func, "id", "") in FUNCTIONS:
                    yield f"{path.relative_to(ROOT)}:{node.lineno}", node


def findings() -> Iterator[tuple[str, ast.Call]]:
    """Calls that state a finding."""
    for path, nodes in written_calls().items():
        for node in nodes:
            if ast.unparse(node.func) in ("Finding", "Finding.of"):
                yield path.relative_to(ROOT).as_posix(), node


def alternatives(node: ast.expr | None) -> list[str] | None:
    """The sentences that an argument may be, written out; ``None`` for one that is put together."""
    if node is None:
        return [""]
    if isinstance(node, ast.IfExp):
        either, other = alternatives(node.body), alternatives(node.orelse)
        return None if either is None or other is None else either + other
    return [node.value] if isinstance(node, ast.Constant) and isinstance(node.value, str) else None


def sentences(call: ast.Call) -> list[str] | None:
    """Messages and advice of a finding; ``None`` where they are put together, and reach every reader in English."""
    named = {keyword.arg: keyword.value for keyword in call.keywords}
    place = 6 if ast.unparse(call.func) == "Finding" else 99
    given = (
        named.get("message") or (call.args[3] if len(call.args) > 3 else None),
        named.get("advice") or (call.args[place] if len(call.args) > place else None),
    )
    if ast.unparse(call.func) == "Finding.of" and all(isinstance(one, ast.Name) for one in given):
        return []  # sentences of a table, each of which is marked
    parts = [alternatives(one) for one in given]
    return None if None in parts else [one for part in parts for one in part or () if one]


def written_out(call: ast.Call) -> list[Any]:
    """The messages of a call; what is none is a name."""
    return [getattr(each, "value", None) for each in call.args[: FUNCTIONS[call.func.id]]]  # type: ignore[attr-defined]


@cache
def messages() -> frozenset[tuple[str, ...]]:
    """Every message of the sources, of the template of a report, and of the catalogue of findings."""
    every = (tuple(written_out(call)) for _, call in calls())
    found = {one for one in every if all(isinstance(part, str) for part in one)}
    template = (ROOT / "ema/report/templates/report.html").read_text(encoding="utf-8")
    found |= {(one,) for one in re.findall(r'\btext\("([^"]+)"', template)}
    found |= set(re.findall(r'\bplural\("([^"]+)", "([^"]+)"', template))
    for path in sorted((ROOT / "ema/app/page").glob("*.html")):
        found |= {(one,) for one in marked(path.read_text(encoding="utf-8"))}
    for path in sorted((ROOT / "ema/app/page").glob("*.js")):
        found |= {(one,) for one in said(path.read_text(encoding="utf-8"))}
    known = set(entries("de"))
    for path, call in findings():
        written = {(one,) for one in sentences(call) or ()}
        found |= written & known if path in IN_ENGLISH else written
    return frozenset(found | {(kind.meaning,) for kind in kinds().values()})


def placeholders(message: str) -> list[str]:
    return [name for _, name, _, _ in string.Formatter().parse(message) if name is not None]


@pytest.mark.parametrize("name", OTHERS)
def test_no_sentence_is_missing_and_none_is_left_over(name: str) -> None:
    known = {given: own for given, own in entries(name).items() if given != ("",)}
    assert messages() - set(known) == set(), f"these have no entry in ema/messages/{name}.po"
    assert set(known) - messages() == set(), "nothing says these"
    (head,) = entries(name)[("",)]
    forms = int(re.search(r"nplurals=(\d+)", head)[1])  # type: ignore[index]
    for given, translated in known.items():
        assert len(translated) == (1 if len(given) == 1 else forms), given
        for message in translated:
            original = given[0] if message == translated[0] else given[-1]
            assert message.strip() == message and message, given
            # the same values and numbers, in the order in which the reader of the other language meets them
            pattern = r"\{\w+\}|\d+(?:\.\d+)?"
            assert re.findall(pattern, message) == re.findall(pattern, original), given
            assert placeholders(message) == placeholders(original), given
            assert (message[-1] == ".") == (original[-1] == "."), given


def test_findings_that_stay_english_become_fewer() -> None:
    known, counted = set(entries("de")), Counter[str]()
    for path, call in findings():
        said = sentences(call)
        if path != "ema/data/findings.py" and (said is None or {(one,) for one in said} - known):
            counted[path] += 1
    assert dict(counted) == IN_ENGLISH


def test_values_of_sentences_are_those_of_their_placeholders() -> None:
    for path, call in findings():
        if ast.unparse(call.func) == "Finding.of" and path != "ema/data/findings.py" and sentences(call):
            values = {keyword.arg for keyword in call.keywords} - {"message", "advice", "severity", "code", "where"}
            assert values == {name for one in sentences(call) or () for name in placeholders(one)}, (path, call.lineno)


def test_messages_are_written_out_with_named_placeholders() -> None:
    for where, call in calls():
        parts = written_out(call)
        if call.func.id != "text":  # type: ignore[attr-defined]
            assert all(isinstance(one, str) for one in parts), f"{where}: a message is written out, not put together"
        assert not any(isinstance(each, ast.JoinedStr | ast.BinOp) for each in call.args), f"{where}: an f-string"
    for given in messages():
        for message in given:
            assert all(name.isidentifier() for name in placeholders(message)), message


@pytest.mark.parametrize("kind", [ExcitationKind, LoadingSequence, Verdict, Quantity])
def test_words_of_data_are_in_the_list(kind: Any) -> None:
    assert {(name,) for name in get_args(kind)} <= messages()


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Page]]:
    """Reports that between them show every part, by language and name."""
    folder, made = tmp_path_factory.mktemp("languages"), results()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("ema.report.pictures.drawn", blank)
        return {
            name: {
                kind: Page(ema.report.write(result, folder / name / f"{kind}.html", language=name))
                for kind, result in made.items()
            }
            for name in languages()
        }


def shown(page: Page) -> str:
    """The words of a page and of its pictures, cells apart from each other."""
    body = re.sub(r"<(style|script)\b.*?</\1>", " ", page.source.split("<body>")[1], flags=re.DOTALL)
    alternatives = " ".join(image["alt"] for image in page.images)
    return " ".join(f"{html.unescape(re.sub(r'<[^>]*>', ' ', body))} {alternatives}".split())


def literal(message: str) -> re.Pattern[str]:
    """A message with anything in its placeholders."""
    parts = [re.escape(part) for part, *_ in string.Formatter().parse(message)]
    return re.compile(r"(?<!\w)" + r".{1,80}?".join(parts) + r"(?!\w)")


@pytest.mark.parametrize("name", OTHERS)
def test_a_report_in_another_language_has_the_same_numbers_and_no_english_sentence(
    name: str, pages: dict[str, dict[str, Page]]
) -> None:
    english = [one for given, own in entries(name).items() for one in given if one and one not in own]
    sentences = [literal(one) for one in english if len(re.findall(r"[A-Za-z]{2,}", re.sub(r"\{.*?\}", "", one))) > 2]
    for kind, page in pages[name].items():
        before, after = (shown(each) for each in (pages["en"][kind], page))
        assert re.findall(NUMBER, after) == re.findall(NUMBER, before), kind
        assert [found[0] for one in sentences if (found := one.search(after))] == [], kind
        heads = {cell for table in page.tables for cell in table[0]} | set(re.findall(r"<h[23]>(.*?)</h", page.source))
        assert heads & set(english) == set(), kind
        assert f'<html lang="{name}">' in page.source and "hyphens: auto" in page.source


def test_an_english_report_says_what_it_always_said(pages: dict[str, dict[str, Page]]) -> None:
    golden = (Path(__file__).parent / "golden" / "report_en.txt").read_text(encoding="utf-8").splitlines()
    found = [f"{kind}: {re.sub(NUMBER, '#', shown(page))}" for kind, page in pages["en"].items()]
    assert found == golden


def test_word_knows_the_language(tmp_path: Path) -> None:
    docx = pytest.importorskip("docx")
    written = ema.report.write(examples.placement(), tmp_path / "r.docx", language="de")
    file = docx.Document(str(written))
    assert "Einbauort des Reibbalkens" in [paragraph.text for paragraph in file.paragraphs]
    assert 'w:lang w:val="de"' in file.styles["Normal"].element.xml


def test_every_language_says_once_that_messages_of_findings_are_english(pages: dict[str, dict[str, Page]]) -> None:
    german = shown(pages["de"]["full"])
    assert german.count("sind englisch") == 1
    assert german.index("Die Kohärenz ist niedrig.") < german.index("coherence 0.61 at 499 Hz.")


def test_a_finding_is_said_in_the_language_of_its_reader(tmp_path: Path) -> None:
    """Late, from its code's sentence and values; one of an earlier file, or of an unknown sentence, as it was stored."""
    first = Finding.of(
        "warning",
        "low-coherence",
        "run a",
        "the median coherence is {median}.",
        0.41,
        0.8,
        advice="Repeat.",
        median="0.41",
    )
    reason = mark("it does not decay")
    pole = Finding.of(
        "info",
        "candidate",
        "run a",
        "A pole with {damping} % damping was not accepted as a mode: {reason}.",
        damping="0.3",
        reason=reason,
    )
    former = Finding("warning", "low-coherence", "run a", "the median coherence is 0.41.")
    constant = Finding("info", "one-average", "run a", "one sweep only: the coherence is 1 by definition.")
    path = tmp_path / "findings.h5"
    store.save(path, replace(examples.study_result(), findings=(first, pole, former, constant)))
    read = store.load(path).findings
    assert [one.message for one in read] == [
        "the median coherence is 0.41.",
        "A pole with 0.3 % damping was not accepted as a mode: it does not decay.",
        "the median coherence is 0.41.",
        "one sweep only: the coherence is 1 by definition.",
    ]
    with speaking("de"):
        assert [one.in_words().message for one in read] == [
            "die mittlere Kohärenz (Median) ist 0.41.",
            "Ein Pol mit 0.3 % Dämpfung wurde nicht als Mode angenommen: er klingt nicht ab.",
            "the median coherence is 0.41.",
            "nur ein Sweep: die Kohärenz ist definitionsgemäß 1.",
        ]
        assert read[0].in_words().advice == "Repeat." and read[0].in_words().value == 0.41
    assert [one.in_words() for one in read] == list(read)


def test_the_report_of_a_study_speaks_the_language_of_the_study(tmp_path: Path) -> None:
    from ema.cli.app import app

    stored = tmp_path / "study.h5"
    store.save(stored, replace(examples.study_result(), language="de"))
    for asked, spoken in (([], "de"), (["--language", "en"], "en")):
        assert CliRunner().invoke(app, ["report", str(stored), *asked]).exit_code == 0
        assert f'<html lang="{spoken}">' in (tmp_path / "study.html").read_text(encoding="utf-8")


def test_two_threads_speak_two_languages_at_once() -> None:
    both, heard = threading.Barrier(2), {}

    def say(name: str) -> None:
        with speaking(name):
            for _ in range(50):
                both.wait(10)
                heard.setdefault(name, set()).add(
                    (language(), text("Mode shapes"), plural("{count} mode", "{count} modes", 2))
                )

    threads = [threading.Thread(target=say, args=(name,)) for name in ("en", "de")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert heard == {"en": {("en", "Mode shapes", "2 modes")}, "de": {("de", "Schwingformen", "2 Moden")}}
    assert language() == "en"


def test_an_error_ends_the_language() -> None:
    with pytest.raises(RuntimeError), speaking("de"):
        assert word("hammer") == "Impulshammer"
        raise RuntimeError
    assert word("hammer") == "hammer"


def test_what_intervals_rest_on_is_said_in_the_language_of_the_report() -> None:
    basis = (
        "coherence of the FRFs, scaled to the residuals; of some poles, noise that the FRFs share and scatter between the "
        "FRFs and scatter between the averages, which is beyond that"
    )
    assert _in_words(basis) == basis
    with speaking("de"):
        assert _in_words(basis) == (
            "Kohärenz der FRF, skaliert auf die Residuen; bei einigen Polen gemeinsames Rauschen der FRF und Streuung "
            "zwischen den FRF und Streuung zwischen den Mittelungen, was darüber hinausgeht"
        )


def test_sources_of_bands_are_in_the_list() -> None:
    """Every key of the table of sources, and the two that are left over."""
    tree = ast.parse((ROOT / "ema/place/budget.py").read_text(encoding="utf-8"))
    keys = [key for node in ast.walk(tree) if isinstance(node, ast.Dict) for key in node.keys]
    named = {key.value for key in keys if isinstance(key, ast.Constant)}
    assert len(named) > 12
    assert {(name,) for name in (*named, HARMONICS, REST)} <= messages()


def test_names_of_users_are_not_translated() -> None:
    with speaking("de"):
        assert word("my {odd} name") == "my {odd} name" and word("") == ""
        assert text("Run {run}", run="{damping}") == "Messung {damping}"


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        ("de-AT,de;q=0.9,en;q=0.8", "de"),
        ("en-GB,en;q=0.9,de;q=0.8", "en"),
        ("fr,nl;q=0.5", "en"),
        ("de;q=0, en;q=0.1", "en"),
        ("*", "en"),
        ("de;q=much", "en"),
        ("", "en"),
    ],
)
def test_the_browser_names_the_language(header: str, expected: str) -> None:
    assert preferred(header) == expected


def test_a_language_that_does_not_exist_is_refused_with_those_that_do(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such language; got 'tlh', expected one of en, de"):
        ema.report.write(examples.placement(), tmp_path / "r.html", language="tlh")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match=r"line 2: language: no such language; got 'tlh', expected one of en, de"):
        recipe.parse('campaign = "raw"\nlanguage = "tlh"\n')
    assert recipe.parse('campaign = "raw"\nlanguage = "de"\n').language == "de"
    assert recipe.parse('campaign = "raw"\n').language == "en"


def test_the_command_line_chooses_the_language(tmp_path: Path) -> None:
    from ema.cli.app import app

    stored = tmp_path / "placement.h5"
    store.save(stored, examples.placement())
    runner = CliRunner()
    done = runner.invoke(app, ["report", str(stored), "--language", "de"])
    assert done.exit_code == 0, done.output
    assert "Einbauort des Reibbalkens" in (tmp_path / "placement.html").read_text(encoding="utf-8")
    wrong = runner.invoke(app, ["report", str(stored), "--language", "tlh"])
    assert wrong.exit_code == 2 and "expected one of en, de" in " ".join(wrong.output.split())


@pytest.mark.parametrize(
    ("language_", "accepted", "undo"),
    [("", "de-DE,de;q=0.9", "Rückgängig"), ("", "en-GB", "Undo"), ("", "", "Undo"), ("de", "en", "Rückgängig")],
)
def test_the_page_in_the_browser_speaks_the_language_that_is_asked_for(
    language_: str, accepted: str, undo: str
) -> None:
    from ema.app.server import serve
    from ema.app.state import Workbench

    app = serve(Workbench(examples.study_result(), Path("study.h5")), port=0, language=language_)
    thread = threading.Thread(target=app.run)
    thread.start()
    try:

        def answer(path: str) -> str:
            request = urllib.request.Request(app.address + path, headers={"Accept-Language": accepted})
            with urllib.request.urlopen(request, timeout=10) as reply:
                return reply.read().decode()

        page, words, overview = answer(""), answer("words.js"), json.loads(answer("api/overview"))
    finally:
        app.stop()
        thread.join()
    german = undo != "Undo"
    assert f'title="u">{undo}<' in page and f'<html lang="{"de" if german else "en"}">' in page
    assert "[[" not in page and "]]" not in page
    assert json.loads(words.split("const words = ")[1].rstrip(";\n"))["Undo: {what}"] == f"{undo}: {{what}}"
    assert overview["force"] == ("ohne Reibbalken" if german else "no friction beam")


def test_every_word_of_a_script_is_said() -> None:
    """A text of a script that a reader sees is one of the list: no template holds words beside its values."""
    for path in sorted((ROOT / "ema/app/page").glob("*.js")):
        for line in path.read_text(encoding="utf-8").splitlines():
            for template in re.findall(r"textContent = `([^`]*)`", line):
                assert not re.search(r"[a-z]{3}", re.sub(r"\$\{[^}]*\}", "", template)), f"{path.name}: {line.strip()}"
