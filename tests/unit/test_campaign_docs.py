"""The examples in docs/campaign.md are campaign files, and its tables list the keys that there are."""

import re
from pathlib import Path

import pytest

from acquisition import campaign_file

TEXT = (Path(__file__).parents[2] / "docs" / "campaign.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL)


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.split('name = "')[1].split('"')[0])
def test_every_example_is_a_campaign_file(block: str) -> None:
    assert campaign_file.parse(block).runs


def test_there_are_examples() -> None:
    assert len(BLOCKS) >= 4


@pytest.mark.parametrize(
    "name", [name for name in campaign_file.KIND.tables if name not in ("", "runs.files", "runs.channels")]
)
def test_every_key_is_described(name: str) -> None:
    title = f"## [[{name}]]" if f"## [[{name}]]" in TEXT else f"## [{name}]"
    section = TEXT.split(title, 1)[1].split("\n## ")[0] if title in TEXT else TEXT
    for key in campaign_file.KIND.tables[name].model_fields:
        assert re.search(rf"\b{key}\b", section), f"{key} of {title}"
