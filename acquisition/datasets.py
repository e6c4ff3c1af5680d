"""Where reference measurements outside the project are found."""

import os
from pathlib import Path

_DEFAULT = "../shared/datasets"


def dataset_folder() -> Path:
    """Return the folder of real measurements, named by ``EMA_DATASETS`` as seen from the working directory.

    Returns
    -------
    Path
        The folder; it need not exist.

    Examples
    --------
    >>> dataset_folder().is_absolute()
    True
    """
    return Path(os.environ.get("EMA_DATASETS", _DEFAULT)).resolve()
