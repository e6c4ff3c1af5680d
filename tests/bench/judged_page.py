"""Sections of the accuracy page on coverage, invariance, disturbances, double roots, set-ups and processor time."""

from collections.abc import Callable

from tests.bench.disturbed import ROWS as DISTURBANCES
from tests.bench.systems import FEWEST
from tests.bench.write_docs import number, table

SHARES = ("frequency", "damping", "residues")
HEAD = ["f [%]", "ζ [%]", "residues [%]"]


def sections(known: dict) -> list[str]:
    """What has been measured, in the order of the page."""
    writers: dict[str, Callable[[dict], str]] = {
        "systems": systems,
        "invariance": invariance,
        "disturbed": disturbed,
        "roots": roots,
        "setups": set_ups,
        "time": processor_time,
    }
    return [
        "\n\n".join([write(known[name]["found"]), stamp(known[name])])
        for name, write in writers.items()
        if name in known
    ]


def stamp(section: dict) -> str:
    """Date, commit, machine and seed."""
    machine = section["machine"]
    return (
        f"Measured {section['date']} at {section['commit']} on {machine['processor']} ({machine['cores']} cores), Python "
        f"{machine['python']}, numpy {machine['numpy']}, scipy {machine['scipy']}. Seed: {section['found']['seed']}."
    )


def percent(value: float | None) -> str:
    """Of a fraction, one digit behind the point; a dash where there is none."""
    return "-" if value is None else f"{100 * value:.1f}"


def least(found: dict, name: str) -> str:
    """A share of clean runs with its one-sided 95 % bound."""
    return f"{found[name]} (≥ {percent(found[f'{name}, least'])} %)"


def systems(found: dict) -> str:
    """Random systems."""
    text = (
        f"{found['systems']} systems drawn anew with 2 to 60 modes, 3 to 500 outputs, 1 to 4 references, 0.1, 1 or 5 % noise "
        f"and 1 to 10 averages, fitted automatically; {found['modes']} identifiable modes. A mode that is missed counts as "
        "not covered. Residues: joint ellipse of real and imaginary part. The bound of the last paragraph is that of the "
        "true modes, inside and outside the band, with an unknown lower and upper residual term of each FRF."
    )
    pooled = [
        [
            percent(found["recall"]),
            *(percent(found["coverage"][name]) for name in SHARES),
            f"{found['false']}",
            least(found, "systems without false"),
            f"{len(found['failed'])}",
        ]
    ]
    bins = [
        [
            one["what"],
            f"{one['from']:g} to {one['to']:g}",
            f"{one['modes']}",
            *(percent(one[name]) for name in SHARES),
            "too few"
            if one["modes"] < FEWEST
            else "inside"
            if all(0.91 <= one[n] <= 0.98 for n in SHARES)
            else "**outside**",
        ]
        for one in found["bins"]
    ]
    confidence = [
        [
            f"{one['from']:g} to {one['to']:g}",
            f"{one['modes']}",
            f"{one['false']}",
            f"{one['stated false']:.1f}",
            f"{sum(above['modes'] - above['false'] for above in found['confidence'][place:])}",
            f"{sum(above['false'] for above in found['confidence'][place:])}",
        ]
        for place, one in enumerate(found["confidence"])
    ]
    wide = " ".join(
        f"Stated standard deviation of {name} over the bound: median {number(own['median'])}, {100 * own['within two']:.2f} "
        f"% within 2, largest {number(own['largest'])}."
        for name, own in found["over bound"].items()
    )
    beyond = [
        f"- system {one['system']}, {one['hertz']:.5g} Hz ({100 * one['zeta']:.2g} %): f {number(one['frequency'])}, ζ "
        f"{number(one['damping'])}"
        for one in found["beyond twice the bound"][:100]
    ]
    more = len(found["beyond twice the bound"]) - len(beyond)
    return "\n\n".join(
        filter(
            None,
            [
                "## Coverage on random systems",
                text,
                table(["recall [%]", *HEAD, "false modes", "systems without", "failed"], pooled),
                f"In bins; one of {FEWEST} modes or more is to lie between 91 and 98 %:",
                table(["what", "range", "modes", *HEAD, ""], bins),
                "Accepted modes by the confidence stated of them (that the mode is one, is nearest to itself and shows its "
                "own shape); what is false is matched by no true mode, which must be the nearest and agree by a MAC of 0.8. The last "
                "columns are what who takes modes from this confidence on has, all above included:",
                table(["confidence", "modes", "false", "false, as stated", "true from here on", "false"], confidence),
                wide,
                "Beyond twice the bound:" if beyond else "",
                "\n".join(beyond),
                f"And {more} more." if more else "",
            ],
        )
    )


def invariance(found: dict) -> str:
    """Invariance."""
    lines = [
        [
            name,
            f"{own['within']} of {own['systems']}",
            *(
                "-" if own[part] is None else f"{own[part]:.1e}"
                for part in ("value median", "value largest", "std median", "std largest")
            ),
            f"{own['other modes']}",
            f"{own['other findings']}",
            f"{own['failed']}",
        ]
        for name, own in found["ways"].items()
    ]
    text = (
        f"{found['systems']} systems, each fitted as it is and as the left column says. Within: values move by less than "
        "1e-6 of their standard deviation, standard deviations by less than 1e-3 of themselves, the same modes and "
        f"findings. {found['flips']} of {found['rescaled']} runs rescaled at random flip a decision."
    )
    head = [
        "change",
        "within",
        "value / std, median",
        "largest",
        "std, median",
        "largest",
        "other modes",
        "other findings",
        "failed",
    ]
    return "\n\n".join(["## The same measurement said in another way", text, table(head, lines)])


def disturbed(found: dict) -> str:
    """Errors that are not noise."""
    meaning = {row.key: row.meaning for row in DISTURBANCES}
    lines = [
        [
            one["row"],
            f"{one['value']:g}",
            f"{one['draws']}",
            f"{one['accepted']} of {one['modes']}",
            *(percent(one[name]) for name in SHARES),
            f"{one['false']}",
            least(one, "runs without false"),
            f"{one['wrong']}",
            f"{one['wrong and named']}",
        ]
        for one in found["cells"]
    ]
    names = [[code, f"{one['named']} of {one['draws']}"] for code, one in found["names"].items()]
    text = (
        "Coverage is that of accepted values. A draw is wrong where the errors exceed what is stated: root mean square over "
        "the accepted values above two standard deviations, or one above four. Where the truth depends on the amplitude, "
        "an interval is right that meets the range of the truth over the amplitudes reached. Strengths: "
        + "; ".join(f"{key}: {value}" for key, value in meaning.items())
        + "."
    )
    head = ["disturbance", "strength", "draws", "accepted", *HEAD, "false", "runs without", "wrong", "of these named"]
    return "\n\n".join(
        [
            "## Errors that are not noise",
            text,
            table(head, lines),
            "Findings that name a cause, reported at strength zero or for another disturbance:",
            table(["finding", "draws"], names),
        ]
    )


def roots(found: dict) -> str:
    """Double roots."""
    lines = [
        [
            kind,
            f"{own['plates']}",
            f"{own['roots']}",
            f"{own['with 0']} / {own['with 1']} / {own['with 2']} / {own['with more']}",
            f"{own['sums inside']} of {own['sums']}",
            "-" if own["angle median"] is None else f"{own['angle median']:.2f} / {own['angle largest']:.1f}",
            f"{own['alone found']} of {own['alone']}",
            f"{own['false']}",
            f"{own['multiplicity']}",
        ]
        for kind, own in found["kinds"].items()
    ]
    head = [
        "references",
        "plates",
        "double roots",
        "with 0 / 1 / 2 / more modes",
        "sum of the poles inside",
        "principal angle [°], median / largest",
        "single modes found",
        "false",
        "multiplicity named",
    ]
    return "\n\n".join(["## Double roots of discs and square plates", table(head, lines)])


def set_ups(found: dict) -> str:
    """Set-ups."""
    lines = [
        [
            one["kind"],
            f"{100 * one['size']:g}",
            f"{one['structures']}",
            f"{one['found']} of {one['modes']}",
            f"{one['false']}",
            least(one, "without false"),
            percent(one["frequency"]),
            percent(one["damping"]),
            f"{percent(one['shifts inside'])} of {one['shifts']}",
            f"{one['named']}",
        ]
        for one in found["cells"]
    ]
    head = [
        "kind",
        "shift [%]",
        "structures",
        "modes found",
        "false",
        "without false",
        "f [%]",
        "ζ [%]",
        "intervals of shifts [%]",
        "named",
    ]
    return "\n\n".join(["## Set-ups that do not agree", table(head, lines)])


def processor_time(found: dict) -> str:
    """Processor time."""
    lines = [
        [
            one["title"],
            f"{one['ended']} of {one['runs']}",
            _said(one["median"]),
            _said(one["worst"]),
            _said(one["worst over median"]),
            _said(one["peer"]),
            _said(one["ratio"]),
            _said(one["goal ratio"]),
            percent(one["recall"]),
            f"{one['false']}",
        ]
        for one in found["sizes"].values()
    ]
    version = next((one["version"] for one in found["sizes"].values() if one["version"]), "")
    head = [
        "case",
        "ended",
        "median [s]",
        "worst [s]",
        "worst / median",
        f"poles of sdypy-EMA {version} [s]",
        "ratio",
        "goal",
        "recall [%]",
        "false",
    ]
    return "\n\n".join(["## Processor time, automatic and with everything included", table(head, lines)])


def _said(value: float | None) -> str:
    return "-" if value is None else number(value)
