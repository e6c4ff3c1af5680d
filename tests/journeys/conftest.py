"""The built-in campaigns, written where a user would find them."""

from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def table_hammer(demonstration: Callable[[str], Path]) -> Path:
    """Folder of the work table's campaign, with its signals."""
    return demonstration("virtual_table_hammer")
