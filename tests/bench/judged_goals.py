"""Goals of the sections on coverage, invariance, disturbances, double roots, set-ups and processor time."""

from collections.abc import Callable

from tests.bench.accuracy_goals import Row
from tests.bench.systems import FEWEST

SHARES = ("frequency", "damping", "residues")


def rows(known: dict) -> list[Row]:
    """One row for each goal that has been measured."""
    makers: dict[str, Callable[[dict], list[Row]]] = {
        "systems": systems,
        "invariance": invariance,
        "disturbed": disturbed,
        "roots": roots,
        "setups": set_ups,
        "time": processor_time,
    }
    return [row for name, make in makers.items() if name in known for row in make(known[name]["found"])]


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.1f} %"


def _shares(one: dict) -> str:
    return " / ".join(_percent(one[name]) for name in SHARES)


def systems(found: dict) -> list[Row]:
    """Random systems."""
    start = f"{found['systems']} random systems, {found['modes']} identifiable modes"
    large = [one for one in found["bins"] if one["modes"] >= FEWEST]
    outside = [one for one in large if not all(0.91 <= one[name] <= 0.98 for name in SHARES)]
    chance = 2 * (0.05 * 0.95 / max(found["modes"], 1)) ** 0.5
    off = max(abs(found["coverage"][name] - 0.95) for name in SHARES) - 0.01
    median = max(own["median"] for own in found["over bound"].values())
    within = min(own["within two"] for own in found["over bound"].values())
    clean = found["systems without false"] / max(found["systems"], 1)
    return [
        Row(
            "systems modes",
            f"{start}: size of the run",
            "≥ 4000 modes, ≥ 30 systems",
            start,
            found["modes"] >= 4000 and found["systems"] >= 30,
        ),
        Row(
            "systems coverage",
            f"{start}: coverage of f, ζ and residues; missed modes are not covered",
            "94 to 96 %",
            _shares(found["coverage"]),
            off <= 0,
            off <= chance,
        ),
        Row(
            "systems bins",
            f"{start}: bins of at least {FEWEST} modes with 91 to 98 %",
            "all",
            f"{len(large) - len(outside)} of {len(large)}",
            bool(large) and not outside,
        ),
        Row(
            "systems recall",
            f"{start}: recall as accepted modes",
            "≥ 99.5 %",
            _percent(found["recall"]),
            found["recall"] >= 0.995,
        ),
        Row(
            "systems false",
            f"{start}: systems without a false mode",
            "≥ 99 %",
            f"{found['systems without false']} of {found['systems']}",
            clean >= 0.99,
        ),
        Row(
            "systems median",
            f"{start}: stated standard deviation over the bound, median",
            "≤ 1.1",
            f"{median:.3f}",
            median <= 1.1,
        ),
        Row(
            "systems two",
            f"{start}: stated standard deviation at most twice the bound",
            "≥ 99.9 %",
            f"{100 * within:.2f} %",
            within >= 0.999,
        ),
    ]


def invariance(found: dict) -> list[Row]:
    """The same measurement said in another way."""
    ways = found["ways"].values()
    count, within = sum(own["systems"] for own in ways), sum(own["within"] for own in ways)
    return [
        Row(
            "invariance",
            f"{found['systems']} systems, said in {len(found['ways'])} other ways: values within 1e-6 of their "
            "standard deviation, standard deviations within 1e-3",
            "all",
            f"{within} of {count}",
            within == count,
        ),
        Row(
            "invariance flips",
            "rescaled runs that flip a decision",
            "0 of 10 000",
            f"{found['flips']} of {found['rescaled']}",
            not found["flips"] and found["rescaled"] >= 10_000,
        ),
    ]


def disturbed(found: dict) -> list[Row]:
    """Errors that are not noise."""
    cells = found["cells"]
    low = [one for one in cells if any(one[name] is not None and one[name] < 0.9 for name in SHARES)]
    wrong, named = sum(one["wrong"] for one in cells), sum(one["wrong and named"] for one in cells)
    dirty = [one for one in cells if one["runs without false, least"] < 0.99]
    worst = max((one["named"] / one["draws"] for one in found["names"].values() if one["draws"]), default=0.0)
    start = f"errors that are not noise, {len(cells)} disturbances and strengths, {found['draws']} fits"
    return [
        Row(
            "disturbed coverage",
            f"{start}: coverage of accepted values at least 90 %",
            "all",
            f"{len(cells) - len(low)} of {len(cells)}",
            not low,
        ),
        Row(
            "disturbed named",
            f"{start}: wrong draws with a finding that names the cause",
            "≥ 95 %",
            f"{named} of {wrong}",
            named >= 0.95 * wrong,
        ),
        Row(
            "disturbed alarms",
            f"{start}: a cause named at strength zero or for another disturbance, most of any",
            "≤ 2 %",
            _percent(worst),
            worst <= 0.02,
        ),
        Row(
            "disturbed false",
            f"{start}: runs without a false mode at least 99 %, one-sided 95 % bound",
            "all",
            f"{len(cells) - len(dirty)} of {len(cells)}",
            not dirty,
        ),
    ]


def roots(found: dict) -> list[Row]:
    """Double roots."""
    many = [own for kind, own in found["kinds"].items() if kind != "one reference"]
    single = found["kinds"]["one reference"]
    count, two = sum(own["roots"] for own in many), sum(own["with 2"] for own in many)
    sums, inside = sum(own["sums"] for own in many), sum(own["sums inside"] for own in many)
    return [
        Row(
            "roots found",
            f"{count} double roots of plates, two or three references: both modes found",
            "all",
            f"{two} of {count}",
            two == count,
        ),
        Row(
            "roots sum",
            "sum of the two poles inside its 95 % interval",
            "93 to 97 %",
            f"{inside} of {sums}",
            bool(sums) and abs(inside / sums - 0.95) <= 0.02,
        ),
        Row(
            "roots single",
            "one reference: plates whose findings say that the multiplicity is not observable",
            "all",
            f"{single['multiplicity']} of {single['plates']}",
            single["multiplicity"] == single["plates"],
        ),
    ]


def set_ups(found: dict) -> list[Row]:
    """Set-ups that do not agree."""
    cells = found["cells"]
    modes, hit = sum(one["modes"] for one in cells), sum(one["found"] for one in cells)
    shifts = sum(one["shifts"] for one in cells)
    inside = sum(one["shifts inside"] * one["shifts"] for one in cells if one["shifts inside"] is not None)
    return [
        Row(
            "setups found",
            f"set-ups shifted by up to 1 %: modes further apart than twice the shift, of {modes}",
            "all",
            f"{hit}, {sum(one['false'] for one in cells)} false",
            hit == modes,
        ),
        Row(
            "setups shifts",
            "95 % intervals of the shifts that hold them",
            "92 to 98 %",
            f"{inside:.0f} of {shifts}",
            bool(shifts) and 0.92 <= inside / shifts <= 0.98,
        ),
    ]


def processor_time(found: dict) -> list[Row]:
    """Processor time."""
    made = []
    for key, one in found["sizes"].items():
        # One seed alone has no worst.
        steady = one["runs"] > 1 and one["worst over median"] is not None and one["worst over median"] <= 2
        if one["goal ratio"] is not None:
            good = one["ratio"] is not None and one["ratio"] <= one["goal ratio"]
            goal, reached = f"≤ {one['goal ratio']:g} x poles of sdypy-EMA", f"{one['ratio'] or float('inf'):.3g}"
        else:
            good = one["worst"] is not None and one["worst"] <= one["goal seconds"]
            goal, reached = f"≤ {one['goal seconds']:g} s", f"{one['worst'] or float('inf'):.3g} s"
        made += [
            Row(f"time {key}", f"{one['title']}: processor time, automatic, everything included", goal, reached, good),
            Row(
                f"time {key} worst",
                f"{one['title']}: worst of {one['runs']} seeds over the median",
                "≤ 2",
                f"{one['worst over median'] or float('inf'):.3g}",
                steady,
            ),
        ]
    return made
