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


CONDA_NAMES = {"matplotlib": "matplotlib-base", "soundfile": "pysoundfile"}
"""Names on conda-forge where they differ: matplotlib without its graphical interfaces, and the binding of libsndfile."""

ONLY_BY_PIP = {"ansys-mapdl-reader", "opendaq"}
"""Packages of extras that the recipe leaves to pip."""

FOR_USERS = ("formats", "fe", "report", "office", "app", "daq", "cluster", "xarray")


def as_conda(requirements: list[str]) -> list[str]:
    """Requirements of pip as conda writes them."""
    pairs = [requirement.split(">=") for requirement in requirements]
    return [f"{CONDA_NAMES.get(name, name)} >={bound}" for name, bound in pairs if name not in ONLY_BY_PIP]


@pytest.fixture(scope="module")
def conda(root: Path) -> dict:
    yaml = pytest.importorskip("yaml", reason="PyYAML comes with the extra 'cluster'")
    return yaml.safe_load((root / ".ci" / "conda" / "recipe.yaml").read_text(encoding="utf-8"))


def test_the_conda_recipe_requires_what_the_project_requires(root: Path, project: dict, conda: dict) -> None:
    system = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]
    extras = [requirement for name in FOR_USERS for requirement in project["optional-dependencies"][name]]
    needs = conda["requirements"]
    assert set(FOR_USERS) == set(project["optional-dependencies"]) - {"dev", "docs"}
    assert {requirement.split(">=")[0] for requirement in extras} >= ONLY_BY_PIP
    assert needs["run"] == ["python >=${{ python_min }}", *as_conda(project["dependencies"])]
    assert needs["host"] == ["python ${{ python_min }}.*", "pip", *as_conda(system["requires"])]
    assert needs["run_constraints"] == as_conda(extras)
    assert project["requires-python"] == f">={conda['context']['python_min']}"


def test_the_conda_recipe_says_what_the_project_says(root: Path, project: dict, conda: dict) -> None:
    assert conda["schema_version"] == 1
    assert (conda["context"]["name"], conda["context"]["version"]) == (project["name"], ema.__version__)
    assert conda["package"] == {"name": "${{ name }}", "version": "${{ version }}"}
    commands = [f"{name} = {place}" for name, place in project["scripts"].items()]
    assert conda["build"]["noarch"] == "python" and conda["build"]["python"]["entry_points"] == commands
    about = conda["about"]
    assert (about["summary"], about["license"]) == (project["description"], project["license"])
    assert [about["license_file"]] == project["license-files"] and (root / about["license_file"]).is_file()


def test_the_conda_recipe_names_no_address_and_nobody(root: Path, conda: dict) -> None:
    folder = root / ".ci" / "conda"
    assert (folder / conda["source"]["path"] / "pyproject.toml").is_file()
    assert "://" not in (folder / "recipe.yaml").read_text(encoding="utf-8") and "extra" not in conda


@pytest.mark.parametrize("change", ["numpy>=9", "brotli>=1.0"])
def test_a_requirement_that_the_conda_recipe_lacks_is_noticed(project: dict, conda: dict, change: str) -> None:
    name = change.split(">=")[0]
    other = [one for one in project["dependencies"] if one.split(">=")[0] != name] + [change]
    assert set(as_conda(other)) - set(conda["requirements"]["run"]) == {change.replace(">=", " >=")}
