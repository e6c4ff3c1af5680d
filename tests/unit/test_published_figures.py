"""A published figure belongs to the present code: each result carries the fingerprint of the code that made it."""

import pytest

from tests.bench import files, provenance
from tests.bench.accuracy import JUDGES, RESTS

WITHOUT = {"accuracy, peers"}
"""Measured before fingerprints were kept: an entry goes when its bench has run again."""
OLDER: set[str] = {
    "archive",
    "joint_maps",
    "large, 25000",
    "large, 50000",
    "machines, map of 60 conditions",
    "machines, campaign of 40 runs",
    "recordings, 40 runs, welch",
}
"""Measured with an earlier version of the code, and their pages say so: an entry goes when its bench has run again."""


def published() -> list:
    return [
        pytest.param(
            stored,
            id=name,
            marks=[pytest.mark.xfail(strict=True, reason="older than the code")] if name in WITHOUT | OLDER else [],
        )
        for name, stored in provenance.published().items()
    ]


@pytest.mark.parametrize("stored", published())
def test_a_published_figure_is_not_older_than_the_code_it_describes(stored: dict) -> None:
    old = provenance.outdated(stored)
    assert not old, f"measured at {stored.get('commit', 'an unknown commit')}; run its bench again: {', '.join(old)}"


def test_every_section_of_the_accuracy_bench_says_which_code_it_rests_on() -> None:
    for name, modules in RESTS.items():
        assert all(provenance.fingerprint(module) for module in modules), name
    assert set(JUDGES) <= set(RESTS)


def test_remarks_do_not_count_and_code_does() -> None:
    plain = 'def f(x):\n    """Twice."""\n    return 2 * x\n\nLIMIT = 3\n"""Most."""\n'
    remarked = '"""A module."""\n# remark\ndef f(x):\n    """Two times."""\n    return (2 * x)  # x\n\nLIMIT = 3\n'
    assert provenance.code(plain) == provenance.code(remarked)
    for other in (plain.replace("2 *", "3 *"), plain.replace("LIMIT = 3", "LIMIT = 4"), plain.replace("f(x)", "f(y)")):
        assert provenance.code(plain) != provenance.code(other)


def test_what_an_error_says_does_not_count_and_which_is_raised_when_does() -> None:
    plain = 'def f(x):\n    if x < 0:\n        raise InputError("negative", got=x)\n    return x\n'
    said = plain.replace('"negative", got=x', 'f"{x:.3g} is below zero", expected="0 or more"')
    assert provenance.code(plain) == provenance.code(said)
    for other in (
        plain.replace("InputError", "OSError"),
        plain.replace("< 0", "<= 0"),
        plain.replace("raise", "return"),
    ):
        assert provenance.code(plain) != provenance.code(other)


def test_a_bench_rests_on_what_its_imports_import() -> None:
    reached = provenance.closure("tests.bench.systems")
    assert {"tests.bench.systems", "tests.bench.scoring", "ema.synthesis", "ema.data.frf", "ema.errors"} <= reached
    assert any(name.startswith("ema.fit.") for name in reached)
    other = ("ema.simulate", "ema.report", "ema.app", "ema.data.results", "ema.data.placement", "ema.data.forecast")
    assert not any(name.startswith(other) for name in reached)


def test_a_stamp_of_other_code_or_of_a_module_that_is_gone_is_old(monkeypatch: pytest.MonkeyPatch) -> None:
    stamped = provenance.stamp("tests.bench.scoring")
    assert not provenance.outdated(stamped)
    assert provenance.outdated({}) == ["no fingerprint"]
    assert provenance.outdated({"fingerprint": {"tests.bench.gone": "0"}}) == ["tests.bench.gone"]
    monkeypatch.setattr(provenance, "_path", _with_one_file_changed(provenance._path))
    forget()
    assert provenance.outdated(stamped) == ["tests.bench.scoring"]
    forget()


def forget() -> None:
    provenance.fingerprint.cache_clear()
    provenance._digest.cache_clear()


def _with_one_file_changed(path):
    """``ema.synthesis`` answered by another module: what a change in an imported file looks like."""
    return lambda module: path("ema.units" if module == "ema.synthesis" else module)


def test_the_page_of_files_shows_what_is_stored_and_names_what_is_older_than_the_code() -> None:
    """After a change of a reader or the store: ``python -m tests.bench.write_docs``, and its command with --publish."""
    assert set(files.stored()) <= set(files.RESTS)
    assert (provenance.ROOT / "docs" / "files.md").read_text(encoding="utf-8") == files.page()


def test_runs_of_one_code_are_added_up_and_those_of_other_code_give_way(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(files, "RESULT", tmp_path / "files.json")
    for seed, outcomes in (("1", {"fine": 3, "blind: digits": 1}), ("2", {"refused": 4}), ("2", {"refused": 5})):
        files.publish("fuzz uff", seed, {"outcomes": outcomes})
    assert "| `uff` | 9 | 3 | 5 | 1 | 0 | 1, 2 |" in files.page() and "- `uff`: digits 1" in files.page()
    assert files.outdated() == [] and "Older" not in files.page()
    monkeypatch.setitem(files.RESTS, "fuzz uff", files.RESTS["fuzz lvm"])
    assert files.outdated() == ["fuzz uff"] and "**Older than the code:**" in files.page()
    files.publish("fuzz uff", "3", {"outcomes": {"fine": 7}})
    assert "| `uff` | 7 | 7 | 0 | 0 | 0 | 3 |" in files.page()
