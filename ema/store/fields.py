"""Single fields of a stored data type: what an index needs, without the arrays that make its file large."""

from pathlib import Path
from typing import Any

from ema.data.invariants import as_stored
from ema.errors import InputError
from ema.store.document import decode
from ema.store.layout import ITEMS
from ema.store.reading import _array, _contents, _maker, _opened, _state, _tree


def load_fields(path: str | Path, *fields: str, name: str | None = None) -> dict[str, Any]:
    """Read some fields of a data type in a file; arrays of other fields are not touched.

    Parameters
    ----------
    path : str or Path
        The file.
    *fields : str
        Fields, such as ``"findings"``; those of a field of a field by dots, such as ``"modes.poles"``.
    name : str, optional
        Which item of a file that holds several; the first one by default.

    Returns
    -------
    dict of str to object
        The value of every field; ``None`` where a field in front of a dot is ``None``.

    Raises
    ------
    InputError
        As :func:`ema.store.load`; or if there is no such item or field.

    Examples
    --------
    >>> import tempfile
    >>> from ema.examples import modal_model
    >>> from ema.store import save
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save(f"{folder}/modes.h5", modal_model())
    ...     load_fields(f"{folder}/modes.h5", "scaling")
    {'scaling': 'unit modal mass'}
    """
    path = Path(path)
    with _opened(path) as file:
        _, names = _contents(file, path)
        if not names or (name is not None and name not in names):
            raise InputError("no such item in the file", where=str(path), got=name, expected=", ".join(names[:20]))
        group, state = f"{ITEMS}/{0 if name is None else names.index(name)}", _state(path)
        tree = _tree(file, group)

        def value(field: str) -> Any:
            part: Any = tree
            for step in field.split("."):
                if part is None:
                    return None
                if not isinstance(part, dict) or "$noun" not in part or step not in part or step.startswith("$"):
                    raise InputError(
                        "no such field in the file",
                        where=str(path),
                        got=field,
                        expected="one of "
                        + (
                            ", ".join(sorted(part.keys() - {"$noun"}))
                            if isinstance(part, dict) and "$noun" in part
                            else "no field"
                        ),
                    )
                part = part[step]
            return decode(
                part,
                lambda place, checksum: _array(file[group], place, checksum),
                lambda place, number: _maker(path, f"{group}/{place}/{number}", state)(),
            )

        with as_stored(str(path)):
            return {field: value(field) for field in fields}
