"""Counting in the accuracy bench: what is missed is not covered, what is wrong and unnamed is counted, and the page shows it."""

import pytest

from tests.bench import cpu_time, disturbed, judged_goals, judged_page, set_ups, systems

MACHINE = {"processor": "x", "cores": 2, "system": "y", "python": "3", "numpy": "2", "scipy": "1", "numba": "0"}


def system(number: int, rows: list[list], false: list[float], noise: float = 0.01) -> dict:
    return {
        "number": number,
        "noise": noise,
        "averages": 5,
        "outputs": 20,
        "references": 2,
        "lines": 801,
        "modes": 9,
        "false": false,
        "seconds": 1.0,
        "rows": rows,
    }


def mode(t: float | None, over: float | None = 1.0) -> list:
    """One identifiable mode: errors over the stated standard deviation, share of residues inside, over the bound."""
    inside = None if t is None else float(abs(t) < 1.96)
    return [t, t, inside, over, over, 0.005, 0.2, 0.5, 20.0, 123.0]


def test_missed_modes_are_not_covered_and_wide_intervals_are_listed() -> None:
    found = systems.summary(
        [
            system(0, [mode(0.1), mode(1.9), mode(None, None), mode(2.1)], []),
            system(1, [mode(-1.0, 7.0)], [55.5], 0.05),
        ]
    )
    assert (found["systems"], found["modes"], found["found"], found["false"]) == (2, 5, 4, 1)
    assert found["coverage"] == {"frequency": 0.6, "damping": 0.6, "residues": 0.6}
    assert found["recall"] == pytest.approx(0.8)
    assert found["systems without false"] == 1
    assert found["over bound"]["frequency"]["within two"] == pytest.approx(0.75)
    (wide,) = found["beyond twice the bound"]
    assert (wide["system"], wide["damping"]) == (1, 7.0)
    quiet = next(one for one in found["bins"] if one["what"] == "noise" and one["from"] == 0.003)
    assert (quiet["modes"], quiet["found"], quiet["frequency"]) == (4, 3, 0.5)
    failed = systems.summary([system(0, [mode(None, None)], []) | {"error": "it broke"}])
    assert failed["coverage"]["frequency"] == 0.0
    assert failed["failed"] == ["it broke"]


def draw(row: str, strength: int, wrong: bool, codes: list[str], false: int = 0) -> dict:
    return {
        "row": row,
        "strength": strength,
        "modes": 4,
        "found": 4,
        "false": false,
        "false hertz": [],
        "frequency": [0.5, 3.0],
        "damping": [1.0],
        "residues": [0.5, 1.0],
        "wrong": wrong,
        "codes": codes,
        "candidates": 0,
        "seconds": 1.0,
    }


def test_wrong_draws_are_named_by_their_own_cause_alone() -> None:
    found = disturbed.summary(
        [
            draw("delay", 0, False, ["channel-delay"]),
            draw("delay", 3, True, ["channel-delay"]),
            draw("delay", 3, True, ["mains"]),
            draw("mains", 3, True, ["channel-delay"], false=2),
        ]
    )
    cells = {(one["row"], one["strength"]): one for one in found["cells"]}
    assert cells["delay", 3]["wrong"] == 2
    assert cells["delay", 3]["wrong and named"] == 1
    assert cells["delay", 3]["frequency"] == 0.5
    assert cells["delay", 3]["residues"] == 0.75
    assert (cells["mains", 3]["wrong and named"], cells["mains", 3]["runs without false"]) == (0, 0)
    assert found["names"]["channel-delay"] == {"draws": 2, "named": 2}, "at strength zero, and for the mains"
    assert found["names"]["mains"] == {"draws": 3, "named": 1}


def test_the_page_and_the_goals_show_every_section() -> None:
    stored = {
        "systems": systems.summary([system(0, [mode(0.1)], [])]),
        "disturbed": disturbed.summary([draw("delay", 3, True, [])]),
        "setups": set_ups.summary(
            [
                {
                    "number": 0,
                    "kind": "common shift",
                    "size": 0.01,
                    "set-ups": 2,
                    "modes": 5,
                    "found": 3,
                    "false": 1,
                    "frequency": [0.1],
                    "damping": [9.0],
                    "shifts": [0.5, 2.5],
                    "named": True,
                    "seconds": 1.0,
                }
            ]
        ),
        "time": cpu_time.summary(
            [
                {
                    "row": "160x1601",
                    "seed": 1,
                    "ours": {"time_poles": 0.1, "time_selection": 0.2, "found": 19, "identifiable": 20, "false": []},
                    "peer": {
                        "time_poles": 1.0,
                        "time_selection": 0.0,
                        "found": 9,
                        "identifiable": 20,
                        "false": [],
                        "version": "1",
                    },
                }
            ]
        ),
    }
    known = {
        name: {"found": found | {"seed": 4}, "date": "2000-01-01", "commit": "abc", "machine": MACHINE}
        for name, found in stored.items()
    }
    text = "\n".join(judged_page.sections(known))
    assert text.count("## ") == text.count("abc") == len(stored)
    for part in ("50.0 of 2", "| 0.3 |", "95.0", "3 of 5"):
        assert part in text
    rows = {row.key: row for row in judged_goals.rows(known)}
    assert rows["time 160x1601"].met
    assert rows["disturbed named"].reached == "0 of 1"
    assert not rows["disturbed named"].met
    assert not rows["systems modes"].met
    assert not rows["setups found"].met
