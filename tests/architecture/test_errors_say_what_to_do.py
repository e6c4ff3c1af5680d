"""Every error says what was expected or what to do next, beside what is wrong."""

import ast

from tests.unit.written_sentences import ROOT, written_calls

ERRORS = {"InputError", "UnitError", "MissingExtraError", "FailureError", "CancelledError"}
SAY_ALL = {("ema/app/state.py", "there is nothing to undo"), ("ema/progress.py", "cancelled")}
"""Errors after which nothing remains to be done."""


def test_every_error_says_what_was_expected_or_what_to_do_next() -> None:
    """The sources say it; whether a case leaves it empty is not seen here.

    Mistakes of a recipe are listed in one error, each with a next step of its own (`ema/tables/schema.py`).
    """
    silent, all_of_them = set(), 0
    for path, calls in written_calls().items():
        for call in calls:
            if ast.unparse(call.func) not in ERRORS:
                continue
            all_of_them += 1
            if not {"expected", "advice"} & {keyword.arg for keyword in call.keywords}:
                what = call.args[0].value if isinstance(call.args[0], ast.Constant) else ast.unparse(call.args[0])
                silent.add((path.relative_to(ROOT).as_posix(), what))
    (listed,) = [one for one in silent if "mistakes" in one[1]]
    assert all_of_them > 900 and silent - {listed} == SAY_ALL
