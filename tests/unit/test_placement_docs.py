"""The recipe in docs/placement.md is one."""

import re
from pathlib import Path

import pytest

from ema.place.recipe import KIND, PlaceRecipe
from ema.tables import validated

PAGE = Path(__file__).parents[2] / "docs" / "placement.md"


def test_the_recipe_of_the_page_is_understood():
    text = re.search(r"```toml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)[1]
    recipe = validated(PlaceRecipe, text, str(PAGE), KIND.tables)
    assert recipe.force == [15.0, 30.0, 60.0] and recipe.near == [499.0, 1000.0]
    assert recipe.bolted_joint().law.friction_coefficient == 0.2
    assert recipe.wanted().aim == "least damping" and recipe.catalogue()[0].length == pytest.approx(0.34)
