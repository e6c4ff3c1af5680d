"""A study does the whole chain, keeps what is finished, and refuses wrong recipes with a sentence."""

import hashlib
import shutil
from dataclasses import replace

import numpy as np
import pytest

import acquisition
from ema import store
from ema.data import StudyResult
from ema.datasets.builtin import ensure
from ema.errors import CancelledError, FailureError, InputError
from ema.study import Study, recipe, summary


def test_study_finds_the_truth_and_writes_report_and_result(small_study, undrawn):
    small_study.write_text(small_study.read_text().replace("near = [120, 210, 333]\n", ""))
    study = Study.load(small_study)
    told = []
    result = study.run(progress=lambda what, done, total: told.append(what))
    assert [one.run.id for one in result.runs] == ["first", "second"]
    for one in result.runs:
        assert one.modes.natural_frequencies == pytest.approx([120, 210, 333], abs=0.02)
        assert one.modes.damping_ratios == pytest.approx([0.012, 0.009, 0.015], rel=0.01)
        assert one.frfs.values.shape[1:] == (2, 5)
        assert one.reconstruction_error.max() < 0.02
        assert np.allclose(np.diag(one.auto_mac), 1)
        assert one.quality.modal_phase_collinearity.min() > 0.999
    assert len(result.expectations) == 7 and all(expectation.met for expectation in result.expectations)
    assert {"runs", "finding impacts", "writing the report"} <= set(told)
    assert study.report == small_study.parent / "_build" / "recipe.html"
    page = study.report.read_text(encoding="utf-8")
    assert "Five points, two runs" in page and "120.0" in page
    held = store.load(study.result)
    assert isinstance(held, StudyResult)
    assert np.array_equal(held.runs[0].modes.poles, result.runs[0].modes.poles)
    assert len(held.runs[0].run.recordings) == 0, "signals are not kept twice"


def test_provenance_names_every_input_by_its_hash(small_study, analysed_once, without_report):
    result = Study.load(small_study).run()
    inputs = dict(result.provenance.inputs)
    assert inputs["recipe.toml"] == hashlib.sha256(small_study.read_bytes()).hexdigest()
    data = sorted((small_study.parent / "campaign" / "data").glob("first_*.h5"))
    listed = "".join(f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in data)
    assert inputs["run first, 5 data files"] == hashlib.sha256(listed.encode()).hexdigest()
    assert dict(result.provenance.options)["fit.band"] == "(60.0, 450.0)"
    assert {"friction-ema", "Python", "numpy"} <= set(dict(result.provenance.versions))


def test_interruption_keeps_finished_runs_and_resume_takes_them(
    small_study, analysed_once, without_report, monkeypatch
):
    study = Study.load(small_study)

    def stop_in_the_second_run(what, done, total):
        return not (what == "runs" and done == 1)

    with pytest.raises(CancelledError, match=r"finished runs: first; they are kept in .*--resume"):
        study.run(progress=stop_in_the_second_run)
    kept = study.kept / "first.h5"
    assert kept.is_file() and not (study.kept / "second.h5").exists()

    from ema.study import chain

    analysed, analyse = [], chain.analyse
    monkeypatch.setattr(
        chain, "analyse", lambda run, *rest, **more: analysed.append(run.id) or analyse(run, *rest, **more)
    )
    result = study.run(resume=True)
    assert analysed == ["second"]
    assert [one.run.id for one in result.runs] == ["first", "second"]
    assert result.runs[0].modes.natural_frequencies == pytest.approx([120, 210, 333], abs=0.02)


def test_resume_computes_anew_what_was_made_otherwise(small_study, analysed_once, without_report, monkeypatch):
    from ema.study import chain

    Study.load(small_study).run()
    analysed, analyse = [], chain.analyse
    monkeypatch.setattr(
        chain, "analyse", lambda run, *rest, **more: analysed.append(run.id) or analyse(run, *rest, **more)
    )
    Study.load(small_study).run(resume=True)
    assert analysed == []
    data = small_study.parent / "campaign" / "data"
    shutil.copy(data / "second_1.h5", data / "first_1.h5")
    Study.load(small_study).run(resume=True)
    assert analysed == ["first"]
    small_study.write_text(small_study.read_text().replace("[60, 450]\norders", "[70, 450]\norders"))
    Study.load(small_study).run(resume=True)
    assert analysed == ["first", "first", "second"]
    (small_study.parent / "_build" / "recipe" / "first.h5").write_bytes(b"not what it was")
    Study.load(small_study).run(resume=True)
    assert analysed == ["first", "first", "second", "first"]


def test_ctrl_c_is_an_interruption_too(small_study, monkeypatch):
    from ema.study import chain

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(chain, "analyse", interrupted)
    with pytest.raises(CancelledError, match="finished runs: none"):
        Study.load(small_study).run()


def test_a_campaign_alone_is_a_study_with_defaults(small_study, analysed_once, without_report, tmp_path):
    folder = small_study.parent / "campaign"
    text = (folder / "campaign.toml").read_text()
    (folder / "campaign.toml").write_text(text[: text.rindex("[[runs]]")])
    for path in (folder, folder / "campaign.toml"):
        study = Study.load(path, output=tmp_path / "out")
        assert study.report == tmp_path / "out" / "campaign.html"
    result = study.run()
    for frequency in (120, 210, 333):
        assert np.abs(result.runs[0].modes.natural_frequencies - frequency).min() < 0.02
    assert study.report.is_file()


def test_a_file_with_frfs_alone_is_a_study(small_study, analysed_once, without_report, tmp_path):
    import acquisition

    frfs = Study.load(small_study).run().runs[0].frfs
    acquisition.write(tmp_path / "beam.uff", frfs.band(60, 450))
    result = Study.load(tmp_path / "beam.uff", output=tmp_path / "out").run()
    assert result.runs[0].run.id == "beam"
    for frequency in (120, 210, 333):
        assert np.abs(result.runs[0].modes.natural_frequencies - frequency).min() < 0.02


def test_files_that_differ_in_their_suffix_have_results_of_their_own(
    small_study, analysed_once, without_report, tmp_path
):
    frfs = Study.load(small_study).run().runs[0].frfs.band(60, 450)
    acquisition.write(tmp_path / "beam.uff", frfs)
    store.save(tmp_path / "beam.h5", {"frfs": replace(frfs, values=2 * frfs.values)})
    places = {suffix: Study.load(tmp_path / f"beam.{suffix}").result for suffix in ("uff", "h5")}
    results = {suffix: Study.load(tmp_path / f"beam.{suffix}").run() for suffix in places}
    assert len({place.resolve() for place in places.values()}) == 2
    for suffix, place in places.items():
        held = store.load(place).runs[0].frfs.values
        np.testing.assert_allclose(held, results[suffix].runs[0].frfs.values)
    np.testing.assert_allclose(
        results["h5"].runs[0].modes.natural_frequencies, results["uff"].runs[0].modes.natural_frequencies, rtol=1e-6
    )


def test_a_stored_file_without_frfs_says_what_it_holds(small_study, analysed_once, without_report, tmp_path):
    store.save(tmp_path / "modes.h5", Study.load(small_study).run().runs[0].modes)
    with pytest.raises(InputError, match="the file holds no FRFs; got a modal model"):
        Study.load(tmp_path / "modes.h5").open()


def test_a_result_is_current_until_inputs_settings_or_code_change(small_study, analysed_once, without_report):
    study = Study.load(small_study)
    result = study.run()
    assert study.is_current(result, study.open())
    old = replace(result.provenance, versions=tuple((name, "0.1") for name, _ in result.provenance.versions))
    assert not study.is_current(replace(result, provenance=old), study.open())
    assert study.is_current(replace(result, provenance=old), study.open(), picked=True)
    text = small_study.read_text()
    small_study.write_text(text + "\n# a remark\n")
    assert not Study.load(small_study).is_current(result, study.open())
    small_study.write_text(text)
    data = next(path for path in sorted((small_study.parent / "campaign").rglob("*")) if path.suffix in (".uff", ".h5"))
    data.write_bytes(data.read_bytes() + b"\n")
    for picked in (False, True):
        assert not study.is_current(result, study.open(), picked=picked)


def test_runs_can_be_chosen_and_absent_ones_are_named(small_study, analysed_once, without_report):
    text = small_study.read_text()
    small_study.write_text('runs = ["second"]\n' + text[: text.index("[[expect]]")])
    assert [one.run.id for one in Study.load(small_study).run().runs] == ["second"]
    small_study.write_text('runs = ["third"]\n' + text)
    with pytest.raises(InputError, match="no such run; got third, expected one of first, second"):
        Study.load(small_study).run()


def test_missed_expectations_are_data(small_study, analysed_once, without_report):
    text = small_study.read_text()
    small_study.write_text(
        text.replace("natural_frequencies = [120, 210, 333]", "natural_frequencies = [120, 211, 333]")
    )
    missed = [one for one in Study.load(small_study).run().expectations if not one.met]
    assert len(missed) == 1
    assert missed[0].expected == 211 and missed[0].found == pytest.approx(210, abs=0.02)


def test_summary_is_plain_data(small_study, analysed_once, without_report):
    import json

    told = summary(Study.load(small_study).run())
    again = json.loads(json.dumps(told, allow_nan=False))
    assert again["runs"][0]["modes"][0]["natural_frequency"] == pytest.approx(120, abs=0.02)
    assert again["runs"][0]["modes"][0]["modal_phase_collinearity"] > 0.999
    assert again["expectations"][0]["met"] is True


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ('campagne = "x"', r"line 1: unknown key 'campagne'; did you mean campaign\?"),
        ('campaign = "x"\n[fit]\nbands = [1, 2]', r"line 3: unknown key 'bands' in \[fit\]; did you mean band\?"),
        ('campaign = "x"\n[[expect]]\nrun = "a"\nfreqs = [1]', r"unknown key 'freqs' in \[expect\]"),
        ('campaign = "x"\nreport = "campaign.toml"', r"line 2.*a report is a page such as _build/campaign.html"),
        ('campaign = "x"\nreport = "_build/x.h5"', r"line 2.*a report is a page such as _build/x.html"),
        ('campaign = "x"\nreport = "/"', r"line 2.*a report is a page"),
        ('campaign = "x"\n[estimate]\nlevel = [100, 50]', r"line 3.*a lower to a higher value, got 100 to 50"),
        ('campaign = "x"\n[[expect]]\nrun = "r"\nonly = [100, 20]', r"only goes from .* got 100 to 20"),
        ('campaign = "x"\n[fit]\nband = [2000, 200]', r"line 3?.*a band goes from .*2000 to 200"),
        ('campaign = "x"\n[fit]\nnear = [1]\nindex = [1]', "not both"),
        ('campaign = "x"\n[estimate]\nestimator = "H3"', r"estimate.estimator: .*'H1'"),
        ('campaign = "x"\n[fit]\norders = [60, 4, 2]', r"orders are \[lowest, highest, step\]"),
        (
            'campaign = "x"\n[[expect]]\nrun = "a"\nnatural_frequencies = [1, 2]\ndamping_percent = [1]',
            "1 damping values",
        ),
        ('campaign = "x"\n[[expect]]\nrun = "a"', "an expectation states"),
        ("title = 'no campaign'", "the recipe lacks 'campaign'"),
        ("campaign = [", "not TOML"),
    ],
)
def test_wrong_recipes_are_refused_with_a_sentence(text, sentence):
    with pytest.raises(InputError, match=sentence):
        recipe.parse(text)


def test_what_is_not_there_is_said(tmp_path):
    with pytest.raises(InputError, match="no such file or folder"):
        Study.load(tmp_path / "nothing.toml")
    with pytest.raises(InputError, match="no campaign here"):
        Study.load(tmp_path).run()
    (tmp_path / "latin.toml").write_bytes(b"title = '\xe9'")
    with pytest.raises(InputError, match=r"cannot be read as text .* expected UTF-8 text"):
        Study.load(tmp_path / "latin.toml")


def test_a_run_of_unknown_excitation_says_what_to_state(small_study):
    campaign = small_study.parent / "campaign" / "campaign.toml"
    campaign.write_text(campaign.read_text().replace('kind = "hammer"\n', ""))
    with pytest.raises(InputError, match='state kind = "hammer"'):
        Study.load(small_study).run()


def test_a_place_that_cannot_be_written_is_a_failure(small_study, tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(FailureError, match="--output"):
        Study.load(small_study, output=tmp_path / "file" / "below").run()


def test_unknown_generators_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"got virtual_moon, expected one of .*virtual_table"):
        ensure(tmp_path, "virtual_moon")


def test_an_interrupted_generator_leaves_nothing_behind(tmp_path):
    with pytest.raises(CancelledError):
        ensure(tmp_path, "virtual_table_hammer", progress=lambda what, done, total: done < 3)
    assert list(tmp_path.iterdir()) == []
