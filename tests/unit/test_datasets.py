"""Demonstrations: in the wheel, written into the folder named or the user's cache, never into the package."""

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import acquisition
from ema import Study, datasets
from ema.datasets import builtin, folders
from ema.errors import FailureError, InputError


@pytest.fixture(scope="module")
def packaged(root: Path) -> dict[str, str]:
    """What the wheel holds beside the modules: path in the checkout, path in the wheel."""
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    return project["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]


def test_the_wheel_holds_every_file_of_every_demonstration(root: Path, packaged: dict[str, str]) -> None:
    wanted = {f"reports/{name}.toml" for name in datasets.recipes()}
    for name in datasets.names():
        wanted |= {f"datasets/{name}/{path.name}" for path in (root / "datasets" / name).iterdir() if path.is_file()}
    assert set(packaged) == wanted
    assert all((root / source).is_file() for source in packaged)
    home = folders._PACKAGED.relative_to(root).as_posix()
    assert all(target == f"{home}/{source}" for source, target in packaged.items())


def test_an_installed_package_uses_its_own_files(root: Path, packaged: dict[str, str], tmp_path, monkeypatch) -> None:
    installed = tmp_path / "installed"
    for source in packaged:
        (installed / source).parent.mkdir(parents=True, exist_ok=True)
        (installed / source).write_bytes((root / source).read_bytes())
    monkeypatch.setattr(folders, "_PACKAGED", installed)
    monkeypatch.setattr(folders, "_CHECKOUT", tmp_path / "nowhere")
    recipe = datasets.fetch_recipe("table_placement", tmp_path / "home")
    assert recipe == tmp_path / "home" / "reports" / "table_placement.toml"
    campaign = Study.load(recipe).campaign.resolve()
    assert campaign == tmp_path / "home" / "datasets" / "work_table_placed"
    assert acquisition.campaign_file.load(campaign).campaign.generator == "work_table_placed"
    assert not list(installed.rglob("raw"))


def test_a_recipe_brings_the_models_that_it_is_computed_from(tmp_path) -> None:
    """Every model that a table of the recipe names is there, at the path that it names."""
    recipe = datasets.fetch_recipe("double_beam_before_sticking", tmp_path)
    settings = Study.load(recipe).recipe
    named = [one.model for one in (*settings.map, *settings.release)]
    assert len(named) == 3 and all((recipe.parent / name / "model.toml").is_file() for name in named)


@pytest.fixture
def quick(monkeypatch) -> str:
    """A built-in campaign whose signals take no time."""

    def generate(folder: Path, progress) -> None:
        (folder / builtin.TRUTH).write_text(f"version = {builtin.VERSION}\n")

    monkeypatch.setitem(builtin.GENERATORS, "work_table_placed", generate)
    return "work_table_placed"


def test_signals_appear_in_the_cache_unless_a_folder_is_named(quick: str, tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("EMA_CACHE", str(tmp_path / "cache"))
    found = datasets.fetch(quick)
    assert found.is_relative_to(tmp_path / "cache") and (found / "raw" / builtin.TRUTH).is_file()
    other = datasets.fetch(quick, tmp_path / "named")
    assert other == tmp_path / "named" / "datasets" / quick and (other / "raw" / builtin.TRUTH).is_file()


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="the variable of other systems")
def test_the_cache_is_where_the_system_keeps_caches(tmp_path, monkeypatch) -> None:
    monkeypatch.delenv("EMA_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert datasets.cache_folder().parent == tmp_path / "friction-ema"


def test_files_of_the_user_stay_as_they_are(quick: str, tmp_path) -> None:
    folder = datasets.fetch(quick, tmp_path)
    (folder / "campaign.toml").write_text("mine")
    datasets.fetch(quick, tmp_path)
    assert (folder / "campaign.toml").read_text() == "mine"


def test_bad_names_and_folders_are_refused_with_a_sentence(quick: str, tmp_path) -> None:
    with pytest.raises(InputError, match=r"built-in campaign; got moon, expected one of .*virtual_table_hammer"):
        datasets.fetch("moon")
    with pytest.raises(InputError, match="no such demonstration; got moon"):
        datasets.fetch_recipe("moon")
    (tmp_path / "file").touch()
    with pytest.raises(FailureError, match="EMA_CACHE"):
        datasets.fetch(quick, tmp_path / "file")


def test_the_command_lists_the_demonstrations() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "ema", "demo", "--list", "--json"], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert set(json.loads(done.stdout)) == set(datasets.recipes())
