"""Where reference measurements outside the project are found."""

import os
from pathlib import Path

_DEFAULT = "../shared/datasets"


def dataset_folder() -> Path:
    """The folder named by ``EMA_DATASETS``, seen from the working directory; it need not exist."""
    return Path(os.environ.get("EMA_DATASETS", _DEFAULT)).resolve()
