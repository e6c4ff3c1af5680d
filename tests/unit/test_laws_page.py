"""The examples of docs/laws.md run as they stand, and do what the page says."""

import re

import numpy as np
import pytest


@pytest.fixture(scope="module")
def page(root):
    text = (root / "docs" / "laws.md").read_text(encoding="utf-8")
    return re.findall(r"```python\n(.*?)```", text, re.DOTALL)


def test_examples_run(page, capsys):
    space = {}
    results = []
    for block in page:
        exec(compile(block, "docs/laws.md", "exec"), space)
        results.append(space.get("run"))
    printed = capsys.readouterr().out
    assert len(page) == 5
    assert "cannot be compiled" in printed
    first, controlled, stepped = results[1], results[3], results[4]
    assert first.energy.error <= 1e-6 and first.energy.friction[-1] > 0.1 * first.energy.total[0]
    assert space["frf"].power_error <= 1e-3 and space["frf"].converged.all()
    assert controlled.energy.error <= 1e-6
    assert controlled.normal_forces.min() >= 50.0 and controlled.normal_forces.max() <= 3000.0
    assert stepped.energy.error <= 1e-6
    assert np.unique(stepped.normal_forces).size >= 3
