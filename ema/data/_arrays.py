"""Read-only arrays for frozen nouns."""

from typing import Any

import numpy as np


def read_only(values: Any, dtype: Any = None) -> Any:
    """Return ``values`` as an array that cannot be written through (a view where no conversion is needed)."""
    array = np.asarray(values, dtype=dtype)
    if array.flags.writeable:
        array = array.view()
        array.flags.writeable = False
    return array


def freeze(noun: Any, **dtypes: Any) -> None:
    """Turn the named fields of a frozen dataclass into read-only arrays of the given dtype; ``None`` stays ``None``."""
    for name, dtype in dtypes.items():
        value = getattr(noun, name)
        if value is not None:
            object.__setattr__(noun, name, read_only(value, dtype))
