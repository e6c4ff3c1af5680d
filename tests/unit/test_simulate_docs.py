"""The page on simulation: its model is a model, its tables list the keys there are, its Python runs."""

import os
import re
from pathlib import Path

import pytest

import acquisition
from acquisition import model_file

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "simulate.md").read_text(encoding="utf-8")


def test_the_example_is_a_model(tmp_path):
    (block,) = re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL)
    (tmp_path / "model.toml").write_text(block)
    model = acquisition.open_model(tmp_path)
    assert model.name == "beam on a beam" and len(model.joints[0].pairs) == 5


@pytest.mark.parametrize("name", [name for name in model_file.KIND.tables if name])
def test_every_key_is_described(name):
    for key in model_file.KIND.tables[name].model_fields:
        assert re.search(rf"\b{key}\b", TEXT), f"{key} of [{name}]"


@pytest.mark.parametrize("name", model_file.LAW_PARAMETERS)
def test_every_law_is_described(name):
    assert f"`{name}`" in TEXT


def test_the_python_runs(monkeypatch):
    monkeypatch.chdir(ROOT)
    names: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL):
        exec(compile(block, "docs/simulate.md", "exec"), names)
    assert len(names["records"]) == 2 and names["records"][0].signals.shape[0] == 4
    assert os.getcwd() == str(ROOT)


def test_commands_are_those_of_the_program():
    for job in ("snapback", "frf", "map", "loop"):
        assert f"ema simulate {job} " in TEXT
