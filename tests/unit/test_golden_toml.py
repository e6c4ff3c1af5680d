"""Files that people wrote for earlier versions are read forever: campaigns, recipes, models and rigs.

``golden/toml_v1`` holds every such file of the first version, ``golden/toml_v1.json`` the values that were read from
them, ``golden/keys_v1.json`` every key that was allowed. A key or a choice that is renamed needs an entry in the
``FormerNames`` of its file. Run with ``EMA_WRITE_GOLDEN=1`` after keys were *added* to list them anew.
"""

import json
import os
import types
import typing
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import pytest
from pydantic import BaseModel

import acquisition
from acquisition import campaign_file, model_file, rig_file
from ema.dof import Dof
from ema.errors import InputError
from ema.place import recipe as place_recipe
from ema.study import Study
from ema.study import recipe as study_recipe
from ema.tables import FormerNames, Table, renamed
from tests.journeys.small_campaign import campaign

GOLDEN = Path(__file__).parent / "golden"
FILES = sorted((GOLDEN / "toml_v1").glob("*.toml"))
SCHEMAS: dict[str, tuple[type[Table], typing.Mapping[str, type[BaseModel]], FormerNames]] = {
    **{
        name: (module.KIND.table, module.KIND.tables, module.KIND.former)
        for name, module in (
            ("campaign", campaign_file),
            ("model", model_file),
            ("rig", rig_file),
            ("place", place_recipe),
        )
    },
    "recipe": (study_recipe.Recipe, study_recipe._TABLES, study_recipe._FORMER),
}


def loaded(path: Path) -> Table:
    match path.stem.rsplit("-", 1)[-1].removeprefix("journey_4_"):
        case "campaign":
            return campaign_file.load(path)
        case "model":
            return model_file.load(path)
        case "rig":
            return rig_file.load(path)
        case "place":
            return place_recipe.load(path)
    return study_recipe.load(path)


def leaves(value: Any) -> Iterator[str]:
    """Every text and number that is somewhere in a table, whatever the key."""
    if isinstance(value, dict):
        for item in value.values():
            yield from leaves(item)
    elif isinstance(value, list | tuple):
        for item in value:
            yield from leaves(item)
    else:
        yield str(value) if isinstance(value, Dof) else repr(value)


def read(path: Path) -> list[str]:
    table = loaded(path)
    assert all(finding.code == "former-name" for finding in table.former_names)
    return sorted(leaves(table.model_dump(exclude_unset=True)))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_file_of_the_first_version_is_read(path: Path) -> None:
    """Every value comes out as it did, by whatever name it is called today."""
    recorded = json.loads((GOLDEN / "toml_v1.json").read_text(encoding="utf-8"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)
        assert read(path) == recorded[path.stem]


def keys(name: str) -> dict[str, dict[str, list[str]]]:
    """The keys of each table, with the choices of those that have any."""
    listed = {}
    for table, model in SCHEMAS[name][1].items():
        hints = typing.get_type_hints(model)
        listed[table] = {key: list(_choices(hints[key])) for key in model.model_fields}
    return listed


def _choices(hint: Any) -> Iterator[str]:
    if get_origin(hint) is Literal:
        yield from get_args(hint)
    elif get_origin(hint) in (typing.Union, types.UnionType):
        for one in get_args(hint):
            yield from _choices(one)


@pytest.mark.parametrize("name", SCHEMAS)
def test_every_key_and_choice_that_was_ever_allowed_is_known(name: str) -> None:
    now, path = keys(name), GOLDEN / "keys_v1.json"
    listed = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    for table, known in listed.get(name, {}).items():
        for key, choices in known.items():
            for choice in [None, *choices]:
                document = choice
                for step in reversed([*([table] if not table else table.split(".")), key]):
                    document = {step: document} if step else document
                found, _ = renamed(document, "", name, SCHEMAS[name][2])
                steps = []
                while isinstance(found, dict):
                    ((step, found),) = found.items()
                    steps.append(step)
                *tables, last = steps
                assert last in now.get(".".join(tables), {}), f"{table}.{key} needs an entry in FormerNames"
                assert found is None or found in now[".".join(tables)][last], f"{table}.{key} = {choice!r}"
    if os.environ.get("EMA_WRITE_GOLDEN"):
        path.write_text(json.dumps(listed | {name: now}, indent=1) + "\n", encoding="utf-8")
        written = {one.stem: read(one) for one in FILES}
        if not path.with_name("toml_v1.json").exists():
            path.with_name("toml_v1.json").write_text(json.dumps(written, indent=1) + "\n", encoding="utf-8")
        listed[name] = now
    assert listed[name] == now, "see the first lines of this file"


# an invented rename ------------------------------------------------------------------------------------------------------


INVENTED = FormerNames(
    keys={"runs.ident": "id", "runs.sort": "kind", "kampagne": "campaign"},
    choices={"runs.kind": {"impact hammer": "hammer"}},
)


@pytest.fixture
def with_former_names(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(campaign_file, "KIND", replace(campaign_file.KIND, former=INVENTED))
    monkeypatch.setattr(
        study_recipe, "_FORMER", FormerNames(keys={"fit.frequency_band": "band", "campagne": "campaign"})
    )
    preload = FormerNames(keys={"joints.preload": "normal_force"})
    monkeypatch.setattr(model_file, "KIND", replace(model_file.KIND, former=preload))


def test_a_former_name_is_read_as_before_and_reaches_the_result(
    tmp_path: Path, with_former_names: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = campaign(tmp_path / "four")
    file = folder / "campaign.toml"
    text = file.read_text(encoding="utf-8")
    present = campaign_file.parse(text)
    file.write_text(
        text.replace('id = "bare"', 'ident = "bare"').replace('kind = "hammer"', 'sort = "impact hammer"'), "utf-8"
    )
    opened = acquisition.open_campaign(folder)
    line = 1 + file.read_text(encoding="utf-8").splitlines().index('ident = "bare"')
    assert campaign_file.load(folder) == present.noting(campaign_file.load(folder).former_names)
    assert [(one.code, one.where.rsplit(", ", 1)[1], one.message) for one in opened.findings] == [
        ("former-name", f"line {line}", "'ident' is called 'id' now."),
        ("former-name", f"line {line + 1}", "'sort' is called 'kind' now."),
        ("former-name", f"line {line + 1}", "'impact hammer' is called 'hammer' now."),
    ]
    (tmp_path / "recipe.toml").write_text('campagne = "four"\n[fit]\nfrequency_band = [20, 400]\n', encoding="utf-8")
    monkeypatch.setattr("ema.report.write", lambda result, path, **more: path)
    result = Study.load(tmp_path / "recipe.toml").run()
    messages = [finding.message for finding in result.findings if finding.code == "former-name"]
    assert messages[:2] == ["'campagne' is called 'campaign' now.", "'frequency_band' is called 'band' now."]
    assert len(messages) == 5


def test_a_key_under_both_names_is_refused_with_its_line(with_former_names: None) -> None:
    with pytest.raises(InputError, match=r"line 4: 'frequency_band' and 'band' are the same key; keep 'band'"):
        study_recipe.parse('campaign = "x"\n[fit]\nband = [1, 2]\nfrequency_band = [1, 2]\n')


def test_a_model_with_a_former_name_is_a_warning(tmp_path: Path, with_former_names: None) -> None:
    text = (GOLDEN / "toml_v1" / "datasets-double_beam-model.toml").read_text(encoding="utf-8")
    assert "\nnormal_force =" in text
    (tmp_path / "model.toml").write_text(text.replace("\nnormal_force =", "\npreload =", 1), encoding="utf-8")
    with pytest.warns(FutureWarning, match="'preload' is called 'normal_force' now"):
        acquisition.open_model(tmp_path)
