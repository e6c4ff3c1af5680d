"""What of the main job is simulated by what stands on the first screen of its report and in the README."""

import tomllib
from pathlib import Path

from ema.data import Campaign, StudyResult
from ema.datasets import work_table
from ema.report.blocks import Book
from ema.report.document import compose

ROOT = Path(__file__).parents[2]
SENTENCE = (
    "was measured on hardware: the hammer test, the forecast and the later measurement come from the same simulator and "
    "the same contact law"
)


def test_the_report_of_the_main_job_says_what_is_simulated_by_what():
    told = tomllib.loads((ROOT / "datasets/work_table_placed/campaign.toml").read_text(encoding="utf-8"))["campaign"]
    front = compose(StudyResult(Campaign(told["name"], (), comment=told["comment"]), ()), Book())
    assert SENTENCE in front.comment


def test_the_readme_says_so_beside_its_command():
    text = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    assert 0 < text.index("ema run reports/table_placement.toml") - text.index(SENTENCE) < 600


def test_the_sentence_is_true_of_the_law():
    recipe = tomllib.loads((ROOT / "reports/table_placement.toml").read_text(encoding="utf-8"))
    assumed, true = recipe["placement"]["joint"]["law"], work_table.PLACED.law
    assert assumed["name"] == true.name and assumed["friction_coefficient"] != true.friction_coefficient
