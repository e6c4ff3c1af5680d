"""What a release says about itself agrees with the project."""

import tomllib
from pathlib import Path

import pytest

import ema


@pytest.fixture(scope="module")
def project(root: Path) -> dict:
    return tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_the_citation_names_the_project_and_nobody_who_is_invented(root: Path, project: dict) -> None:
    text = (root / "CITATION.cff").read_text(encoding="utf-8")
    told = dict(line.split(": ", 1) for line in text.splitlines() if ": " in line and not line.startswith(" "))
    assert told["title"] == project["name"] and told["license"] == project["license"]
    assert told["version"] == ema.__version__ and told["cff-version"] == "1.2.0"
    names = [line.split(": ", 1)[1] for line in text.splitlines() if line.startswith("  - name:")]
    assert names == [author["name"] for author in project["authors"]]
    assert not {"doi", "url", "repository-code", "orcid", "email"} & {
        line.split(":")[0].strip(" -") for line in text.splitlines()
    }
    for keyword in project["keywords"]:
        assert f"  - {keyword}\n" in text


def test_what_only_the_tests_need_is_not_installed_by_users(project: dict) -> None:
    needed = {line.split(">")[0].split("[")[0] for line in project["dependencies"]}
    assert not needed & {"pyuff", "pytest", "hypothesis", "beartype", "mypy", "ruff"}
    assert {"pyvista", "numpy", "typer", "pint"} <= needed
