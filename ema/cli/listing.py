"""Lists that people and machines read: file formats, and what the doctor found."""

from collections.abc import Sequence
from math import isfinite
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ema.cli.doctor import Check
from ema.cli.screen import table
from ema.contact.catalogue import KnownLaw, Parameter
from ema.messages import Kind


def formats_as_list(formats: list[Any]) -> list[dict[str, Any]]:
    """One entry per format."""
    return [
        {
            "name": one.name,
            "title": one.title,
            "suffixes": list(one.suffixes),
            "reads": list(one.reads),
            "writes": list(one.writes),
            "extra": one.extra or None,
            "available": one.available,
        }
        for one in formats
    ]


def formats_as_table(formats: list[Any]) -> Table:
    """One row per format."""
    names = ("format", "suffixes", "reads", "writes", "works here")
    rows = [
        (
            one.title,
            " ".join(one.suffixes),
            ", ".join(one.reads),
            ", ".join(one.writes),
            "yes" if one.available else f"needs friction-ema[{one.extra}]",
        )
        for one in formats
    ]
    return table(names, rows, left=names, whole=())


def kinds_as_table(kinds: Sequence[Kind]) -> Table:
    """One row per kind of finding."""
    names = ("code", "meaning", "page of the docs")
    return table(names, [(kind.code, kind.meaning, kind.page) for kind in kinds], left=names, whole=("code",))


def laws_as_list(laws: Sequence[KnownLaw]) -> list[dict[str, Any]]:
    """One entry per friction law."""
    return [
        {
            "name": law.name,
            "constructor": f"ema.simulate.{law.constructor}" if law.constructor else None,
            "meaning": law.meaning,
            "parameters": [_parameter(one) for one in law.parameters],
            "instead_of_contact_stiffness": [_parameter(one) for one in law.instead],
        }
        for law in laws
    ]


def _parameter(one: Parameter) -> dict[str, Any]:
    return {
        "name": one.key,
        "unit": one.unit,
        "default": one.default if isfinite(one.default) else None,
        "limits": one.limits,
        "meaning": one.meaning,
    }


def laws_as_table(laws: Sequence[KnownLaw]) -> Table:
    """One row per parameter; those of every law come first."""
    names = ("law", "parameter", "unit", "default", "limits", "meaning")
    rows = [
        ("every law", "friction_coefficient", "-", "", "0 or more", "mu, slip force over normal force"),
        ("", "contact_stiffness", "N/m", "", "above 0", "k_T of the whole joint; coulomb may go without"),
        ("", "stiffness_exponent", "-", "0", "0 or more", "k_T grows with F_N to this power"),
        ("", "reference_force", "N", "1000", "above 0", "normal force at which k_T is the contact_stiffness"),
        ("", "stiffness_cap", "N/m", "none", "above 0", "k_T never exceeds it"),
        ("", "isotropic", "", "true", "true, false", "two directions: the slip force is a circle, or a box"),
    ]
    for law in laws:
        rows.append((law.name, "", "", "", "", law.meaning))
        for one in law.parameters:
            default = "one per spring" if one.several else f"{one.default:g}" if isfinite(one.default) else ""
            rows.append(("", one.key, one.unit, default, one.limits, one.meaning))
        for one in law.instead:
            default = f"{one.default:g}" if isfinite(one.default) else ""
            rows.append(
                ("", one.key, one.unit, default, one.limits, f"{one.meaning}; in the place of contact_stiffness")
            )
    caption = "A law of your own: ema.simulate.register_law, docs/laws.md."
    return table(names, rows, left=names, whole=names[:3], caption=caption)


def show_checks(out: Console, checks: list[Check], repair: str) -> None:
    """One line per check, and the one command that fixes what does not work."""
    for one in checks:
        mark, style = ("ok", "green") if one.works else ("no", "bold red" if one.needed else "yellow")
        out.print(Text(f"{mark:3}", style=style), Text(f"{one.what}: {one.detail}"), soft_wrap=True)
    out.print(f"To fix it: {repair}" if repair else "Everything works.", style="bold", soft_wrap=True)
