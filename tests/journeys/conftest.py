"""The built-in campaigns, written where a user would find them."""

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def table_hammer(root: Path) -> Path:
    """Folder of the work table's campaign, with its signals."""
    from ema.datasets.builtin import ensure

    folder = root / "datasets" / "virtual_table_hammer"
    ensure(folder, "virtual_table_hammer")
    return folder
