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
from ema.estimate import NonlinearDistortion
from ema.estimate.detection_lines import distortion_finding
from ema.messages import entries, kinds, language, languages, mark, plural, preferred, speaking, text, word
from ema.messages.recognition import LEAST_WORDS, in_words, recognised
from ema.place.budget import HARMONICS, REST
from ema.report.modes import _in_words
from ema.study import recipe
from ema.study.recipe import Quantity
from tests.unit.report_corpus import results
from tests.unit.report_page import Page, blank
from tests.unit.written_sentences import (
    alternatives,
    arguments,
    enclosing,
    findings,
    sentences,
    skeleton,
    written_calls,
)

OTHERS = [name for name in languages() if name != "en"]
FUNCTIONS = {"text": 1, "mark": 1, "plural": 2}
NUMBER = r"(?<![A-Za-z_])[-+±]?\d+(?:\.\d+)?"
ROOT = Path(__file__).parents[2]
IN_ENGLISH: dict[str, int] = {
    "acquisition/files/signals.py": 1,
    "acquisition/files/uff/functions.py": 2,
    "acquisition/files/uff/mode_sets.py": 1,
    "acquisition/files/uff/reading.py": 2,
    "ema/archive/adding.py": 1,
    "ema/archive/cache.py": 1,
    "ema/simulate/steady_states.py": 1,
    "ema/study/mapping.py": 2,
}
"""Findings of each file of which a reader of another language gets a part in English, or all: the words that another
program, an error or a list adds are not written where the finding is stated."""

IMPOSSIBLE = {
    "{} explains the damping over the amplitude and not the damping.",
    "{} explains the frequency over the amplitude and not the frequency.",
    "{} all FRFs are {} times as large as a resonance makes them: the channel changed the gain.",
    "{} the FRFs of channel {} are {} times as large as a resonance makes them: the force, channel {}, or all responses "
    "changed the gain.",
}
"""Combinations of words that never occur: both words follow from one condition."""


def calls() -> Iterator[tuple[str, ast.Call]]:
    """Calls of the functions that take messages, in modules that import them."""
    for path, nodes in written_calls().items():
        if "from ema.messages import" in path.read_text(encoding="utf-8"):
            for node in nodes:
                if getattr(node.func, "id", "") in FUNCTIONS:
                    yield f"{path.relative_to(ROOT)}:{node.lineno}", node


@cache
def in_the_list() -> dict[str, re.Pattern[str]]:
    """Messages of the list, each with a pattern in which every placeholder is one word or is filled in later."""
    given = [one[0] for one in entries(OTHERS[0]) if len(one) == 1]
    return {one: re.compile(r"\S+".join(map(re.escape, skeleton(one).split("{}")))) for one in given}


@cache
def listed_as(sentence: str) -> frozenset[str]:
    """Entries that translate a sentence: as it is, or several that write out the words of its placeholders."""
    bare, every = skeleton(sentence), in_the_list()
    if found := [one for one in every if skeleton(one) == bare]:
        return frozenset(found)
    if len(re.findall(r"[A-Za-z]{2,}", bare)) < LEAST_WORDS:
        return frozenset()
    if found := [one for one, pattern in every.items() if "{" in one and pattern.fullmatch(bare)]:
        return frozenset(found)
    wide = re.compile(".+".join(map(re.escape, bare.split("{}"))))
    return frozenset(one for one in every if "{}" in bare and wide.fullmatch(one))


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
    for path, call in findings():
        if path == "ema/data/findings.py":
            continue
        if ast.unparse(call.func) == "Finding.of" and path not in IN_ENGLISH:
            found |= {(one,) for one in sentences(call) or ()}
        every = [one for argument in arguments(call) for one in alternatives(argument, enclosing()[call]) or () if one]
        found |= {(entry,) for one in every for entry in listed_as(one)}
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
    counted = Counter[str]()
    for path, call in findings():
        said = sentences(call)
        if path != "ema/data/findings.py" and (said is None or not all(map(listed_as, set(said) - IMPOSSIBLE))):
            counted[path] += 1
    assert dict(counted) == IN_ENGLISH


def test_a_finding_without_a_translation_is_noticed() -> None:
    """Whether its sentence is written at once, chosen, or put together from variables."""
    source = """
def check(name, share, where):
    what = "one impact" if share < 2 else f"{share} impacts"
    for side, advice in (("left", "Turn it."), ("right", "Lower the trigger.")):
        text = f"the hammer of {name} bounced on the {side} after {what}."
        Finding("warning", "bounce", where, text, share, 0.0, advice)
"""
    (scope,) = ast.parse(source).body
    (call,) = [node for node in ast.walk(scope) if isinstance(node, ast.Call)]
    said = [one for argument in arguments(call) for one in alternatives(argument, scope) or ()]
    assert set(said) == {
        "the hammer of {} bounced on the left after one impact.",
        "the hammer of {} bounced on the left after {} impacts.",
        "the hammer of {} bounced on the right after one impact.",
        "the hammer of {} bounced on the right after {} impacts.",
        "Turn it.",
        "Lower the trigger.",
    }
    assert not any(map(listed_as, said))
    assert listed_as("the joint has {} m of play.") == {"the joint has {play} m of play."}


@pytest.mark.parametrize("name", OTHERS)
def test_a_sentence_with_its_numbers_is_recognised_as_the_one_it_is(name: str) -> None:
    """Every sentence of the list, with values of one and of several words: none is taken for another."""
    for given, own in entries(name).items():
        fields = list(dict.fromkeys(placeholders(given[0])))
        words = re.findall(r"[A-Za-z]{2,}", re.sub(r"\{.*?\}", " ", given[0]))
        if len(given) == 1 and fields and len(words) >= LEAST_WORDS:
            for value in ("12.5-{}", "x {}/y"):
                values = {field: value.format(number) for number, field in enumerate(fields)}
                with speaking(name):
                    assert recognised(given[0].format(**values)) == own[0].format(**values)
                assert recognised(given[0].format(**values)) == given[0].format(**values)


def test_findings_of_the_computation_are_said_in_the_language_of_their_reader() -> None:
    """As they are made: with numbers, with several sentences of one kind, and one that the list does not have."""
    distorted = distortion_finding(NonlinearDistortion(0.05, 0.02, 0.001, 0.001), "run a")
    open_loop = Finding("info", "run-down", "loop 1", "the motion has full amplitude only until 2.50 s.", 2.5, 9.0, "?")
    with speaking("de"):
        said = in_words(distorted)
        assert said.message == (
            "wo die Anregung Linien auslässt, antwortet die Struktur mit 5 % an ungeraden Linien und 2 % an geraden "
            "Linien, bezogen auf die Antwort daneben: sie ist bei dieser Stufe nicht linear."
        )
        assert said.advice.startswith("Die FRF gelten nur für diese Stufe") and said.value == distorted.value
        assert in_words(open_loop).message == "die Bewegung hat nur bis 2.50 s die volle Amplitude."
        assert in_words(open_loop).advice == "?"
        unknown = replace(open_loop, message="a sentence that no list has, with 3 words more.")
        assert in_words(unknown) == unknown
    assert in_words(distorted) == distorted


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
