"""Names that earlier files use, and what they are called today.

The names of classes and fields and the values of choices are part of the file format. Whoever renames one in Python
raises ``SCHEMA_VERSION``, adds a :class:`Migration` of that version to ``MIGRATIONS``, and has the names on disk listed
anew (``tests/unit/test_golden_store.py``). Files of every earlier version are then read as if they had been written
today; what earlier versions called something is never taken for the mark of a newer one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Migration:
    """What was renamed when the schema got a version; applied to files of lower versions, in the order of versions.

    Parameters
    ----------
    version : int
        Schema version that has the new names.
    classes : mapping
        Former name of a class to its new name.
    fields : mapping
        New name of a class to the former names of its fields with their new ones; ``None`` drops a field.
    values : mapping
        New names of class and field to the former values with their new ones: choices, codes of findings.

    Examples
    --------
    >>> renamed = Migration(version=2, classes={"Hit": "Impact"}, fields={"Impact": {"time": "start"}})
    >>> migrated({"$noun": "Hit", "time": 0.5}, 1, [renamed])
    {'$noun': 'Impact', 'start': 0.5}
    """

    version: int
    classes: Mapping[str, str] = field(default_factory=dict)
    fields: Mapping[str, Mapping[str, str | None]] = field(default_factory=dict)
    values: Mapping[tuple[str, str], Mapping[str, str]] = field(default_factory=dict)

    def apply(self, tree: dict[str, Any]) -> dict[str, Any]:
        """Return one object of a document under its new names."""
        name = self.classes.get(tree["$noun"], tree["$noun"])
        fields = self.fields.get(name, {})
        renamed: dict[str, Any] = {"$noun": name}
        for former, value in tree.items():
            new = fields.get(former, former)
            if former == "$noun" or new is None:
                continue
            choices = self.values.get((name, new), {})
            renamed[new] = choices.get(value, value) if isinstance(value, str) else value
        return renamed


MIGRATIONS: tuple[Migration, ...] = ()
"""Every rename since version 1, by ascending version."""


def migrated(tree: Any, version: int, migrations: Sequence[Migration] | None = None) -> Any:
    """Return a document under today's names.

    Parameters
    ----------
    tree : object
        A document as it is in a file; where its arrays are in the file stays as it is.
    version : int
        Schema version of the file.
    migrations : sequence of Migration, optional
        ``MIGRATIONS`` by default.
    """
    later = [one for one in (MIGRATIONS if migrations is None else migrations) if one.version > version]
    return _renamed(tree, later) if later else tree


def _renamed(tree: Any, migrations: Sequence[Migration]) -> Any:
    if isinstance(tree, list):
        return [_renamed(member, migrations) for member in tree]
    if not isinstance(tree, dict) or not isinstance(tree.get("$noun"), str):
        return tree
    for migration in migrations:
        tree = migration.apply(tree)
    return {name: _renamed(member, migrations) for name, member in tree.items()}
