"""The command line as a shell sees it: output, error stream, exit status."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time

import pytest

from ema import store
from ema.cli import doctor, main
from ema.cli.ending import ends_well
from ema.errors import CancelledError, FailureError, InputError
from tests.unit.report_page import UNDRAWN

UNFITTED = "from ema.cli import checking\nchecking.QUICK = 0\n"
"""Checks without the fit by which they look for late channels, for tests of what else they say."""


def ema(*arguments, cwd=None, before="", **more):
    """Run the command in a process of its own, ``before`` it other code."""
    code = before + "import sys; sys.argv[0] = 'ema'; from ema.cli import main; main()"
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)], capture_output=True, text=True, timeout=300, cwd=cwd, **more
    )


@pytest.fixture
def ema_within(monkeypatch, capsys):
    """The command in this process, for what a shell sees of it alike: status, output, error stream."""

    def called(*arguments):
        monkeypatch.setattr(sys, "argv", ["ema", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        return subprocess.CompletedProcess(arguments, ended.value.code, *capsys.readouterr())

    return called


@pytest.fixture(scope="module")
def done(small_study_master, tmp_path_factory):
    """The small study, run once by the command."""
    folder = tmp_path_factory.mktemp("run") / "Prüfling 1"
    shutil.copytree(small_study_master, folder)
    return folder, ema("run", folder / "recipe.toml")


def test_run_ends_with_modes_and_the_path_of_the_report(done):
    folder, ended = done
    assert ended.returncode == 0, ended.stderr
    assert "120.0" in ended.stdout and "1.20" in ended.stdout
    assert "7 of 7 expected numbers met." in ended.stdout
    report = folder / "_build" / "recipe.html"
    assert ended.stdout.splitlines()[-1] == f"Report: {report}"
    assert report.stat().st_size > 10_000
    assert ended.stderr == "", "no progress bars where nobody watches"


def test_run_with_json_prints_json_and_nothing_else(done):
    folder, _ = done
    ended = ema("run", folder / "recipe.toml", "--resume", "--json", before=UNDRAWN)
    told = json.loads(ended.stdout)
    assert [run["run"] for run in told["runs"]] == ["first", "second"]
    assert told["runs"][0]["modes"][2]["natural_frequency"] == pytest.approx(333, abs=0.05)
    assert all(one["met"] for one in told["expectations"])


def test_a_missed_expectation_ends_with_status_1(done):
    folder, _ = done
    text = (folder / "recipe.toml").read_text()
    (folder / "other.toml").write_text(text.replace("[120, 210, 333]\ntol", "[120, 215, 333]\ntol"))
    ended = ema("run", folder / "other.toml", before=UNDRAWN)
    assert ended.returncode == 1
    assert "missed: first: natural frequency near 215 Hz [Hz]: found 21" in ended.stdout


def test_findings_above_the_limit_end_with_status_1(small_study):
    campaign = small_study.parent / "campaign" / "campaign.toml"
    campaign.write_text(campaign.read_text().replace('unit = "m/s^2"', 'quantity = "acceleration"\nunit = "unstated"'))
    assert ema("check", small_study, "--limit", "warning", before=UNFITTED).returncode == 1
    assert ema("check", small_study, "--limit", "never", before=UNFITTED).returncode == 0
    ended = ema("check", small_study, "--json", before=UNFITTED)
    assert ended.returncode == 0
    assert "unit-unstated" in {one["code"] for run in json.loads(ended.stdout)["runs"] for one in run["findings"]}


def test_check_lists_metadata_conditions_and_channels(small_study):
    campaign = small_study.parent / "campaign" / "campaign.toml"
    force = '\n[[runs.normal_force]]\njoint = "J1"\nvalue = "1.02 kN"\nstd = "0.03 kN"\n'
    campaign.write_text(campaign.read_text() + force)
    ended = ema("check", small_study.parent / "campaign", "--run", "second")
    assert ended.returncode == 0, ended.stderr
    for text in (
        "Five points",
        "acc 1",
        "hammer",
        "Run second",
        "J1 1020 +- 30 N",
        "15 of 15 used",
        "2 responses x 5 forces",
    ):
        assert text in ended.stdout
    assert "Run first" not in ended.stdout


def test_fit_prints_and_writes_the_modes_of_a_band(small_study, tmp_path):
    import acquisition

    for name in ("modes.uff", "modes.h5"):
        ended = ema(
            "fit",
            small_study.parent / "campaign",
            "--run",
            "first",
            "--band",
            80,
            260,
            "--near",
            120,
            "--near",
            210,
            "--order",
            20,
            "--output",
            tmp_path / name,
        )
        assert ended.returncode == 0, ended.stderr
        assert "first: 2 modes" in ended.stdout and "210.0" in ended.stdout
    (model,) = acquisition.read(tmp_path / "modes.uff").modes
    assert model.natural_frequencies == pytest.approx([120, 210], abs=0.05)
    held = store.load(tmp_path / "modes.h5")["first"]
    assert held.natural_frequencies == pytest.approx([120, 210], abs=0.05)
    ended = ema("fit", small_study, "--run", "first", "--json")
    assert [mode["natural_frequency"] for mode in json.loads(ended.stdout)["first"]] == pytest.approx(
        [120, 210, 333], abs=0.05
    )


def test_report_is_written_again_from_the_result(done, tmp_path):
    folder, _ = done
    ended = ema("report", folder / "_build" / "recipe.h5", "--output", tmp_path / "again.html", before=UNDRAWN)
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.strip() == f"Report: {tmp_path / 'again.html'}"
    assert "Five points, two runs" in (tmp_path / "again.html").read_text(encoding="utf-8")
    ended = ema("report", folder / "campaign" / "data" / "first_1.h5")
    assert ended.returncode == 2 and "nothing to report; got Recording" in ended.stderr


def test_formats_names_suffixes_and_extras():
    ended = ema("formats")
    assert ended.returncode == 0
    assert ".uff" in ended.stdout and "MATLAB" in ended.stdout
    listed = json.loads(ema("formats", "--json").stdout)
    assert {"uff", "matlab", "hdf5", "npy"} <= {one["name"] for one in listed}


def test_doctor_tries_things_out_and_names_one_command():
    ended = ema("doctor", "--json")
    told = json.loads(ended.stdout)
    works = {check["what"]: check["works"] for check in told["checks"]}
    assert ended.returncode == 0
    assert works["result files"] and works["numpy"] and "renderer" in works
    broken = doctor.Check("x", False, "absent", remedy="mend x")
    other = doctor.Check("y", False, "absent", remedy="mend y")
    assert doctor.repair([broken, other, broken, doctor.Check("z", True, "", remedy="mend z")]) == "mend x && mend y"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["run", "nothing.toml"], "ema: nothing.toml: there is no such file or folder"),
        (["run", "."], "there is no campaign here"),
        (["check", "nothing"], "there is no such file or folder"),
        (["fit", "nothing"], "there is no such file or folder"),
        (["report", "nothing.h5"], "nothing.h5"),
        (["run", "empty.uff"], "empty.uff"),
        (["run", "bad.toml"], "bad.toml, line 1: unknown key 'kampagne'; did you mean campaign?"),
    ],
)
def test_bad_input_is_one_sentence_and_status_2(tmp_path, monkeypatch, ema_within, arguments, sentence):
    (tmp_path / "empty.uff").touch()
    (tmp_path / "bad.toml").write_text('kampagne = "x"')
    monkeypatch.chdir(tmp_path)
    ended = ema_within(*arguments)
    assert ended.returncode == 2
    assert ended.stdout == ""
    assert sentence in ended.stderr and ended.stderr.count("\n") == 1
    assert "Traceback" not in ended.stderr


@pytest.mark.parametrize(
    "arguments", [["run"], ["run", "a", "b"], ["fly"], ["run", "--fast"], ["fit", "x", "--order", "x"]]
)
def test_wrong_use_ends_with_status_2(ema_within, arguments):
    ended = ema_within(*arguments)
    assert ended.returncode == 2
    assert "Traceback" not in ended.stderr


@pytest.mark.parametrize("arguments", [["run", "nothing.toml"], ["fly"]])
def test_a_shell_sees_the_same(tmp_path, monkeypatch, ema_within, arguments):
    monkeypatch.chdir(tmp_path)
    here, alone = ema_within(*arguments), ema(*arguments)
    assert here.returncode == alone.returncode == 2
    assert here.stdout == alone.stdout == ""
    # the usage before it names the program, which is another one here
    assert here.stderr.splitlines()[-1] == alone.stderr.splitlines()[-1]


def test_version():
    import ema as package

    ended = ema("--version")
    assert ended.returncode == 0 and ended.stdout.strip() == f"friction-ema {package.__version__}"


def test_the_package_runs_as_the_command():
    ended = subprocess.run([sys.executable, "-m", "ema", "--version"], capture_output=True, text=True, check=False)
    assert ended.returncode == 0 and ended.stdout == ema("--version").stdout


@pytest.mark.parametrize(
    ("raised", "status", "sentence"),
    [
        (InputError("wrong", where="here", advice="do that"), 2, "ema: here: wrong; do that\n"),
        (FailureError("disk full"), 3, "ema: disk full\n"),
        (CancelledError("stopped"), 130, "ema: stopped\n"),
        (KeyboardInterrupt(), 130, "ema: interrupted\n"),
    ],
)
def test_errors_become_statuses(raised, status, sentence, capsys):
    def command():
        raise raised

    with pytest.raises(SystemExit) as ended:
        ends_well(command)()
    assert ended.value.code == status
    assert capsys.readouterr().err == sentence


def test_an_interruption_within_a_compiled_library_ends_as_one(capsys, tmp_path, monkeypatch):
    """Ctrl-C in a slot of a compiled type that may not fail: the interpreter raises a SystemError from it."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))

    def command() -> int:
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as error:
            raise SystemError("<built-in method> returned a result with an exception set") from error

    with pytest.raises(SystemExit) as ended:
        ends_well(command)()
    assert ended.value.code == 130 and capsys.readouterr().err == "ema: interrupted\n"
    assert not list(tmp_path.iterdir())

    def broken() -> int:
        raise SystemError("bad argument to internal function")

    with pytest.raises(SystemExit) as ended:
        ends_well(broken)()
    assert ended.value.code == 3 and "a fault in ema itself" in capsys.readouterr().err


def test_a_fault_of_ours_says_how_to_report_it(capsys):
    def command():
        return [][0]

    with pytest.raises(SystemExit) as ended:
        ends_well(command)()
    told = capsys.readouterr().err
    assert ended.value.code == 3
    assert "a fault in ema itself: IndexError: list index out of range; please report it" in told
    file = told.strip().rsplit(" ", 1)[-1]
    with open(file, encoding="utf-8") as details:
        assert "Traceback" in details.read()
    os.remove(file)


def test_a_reader_that_leaves_is_no_fault():
    code = "import sys; sys.argv[0] = 'ema'; from ema.cli import main; main()"
    with subprocess.Popen(
        [sys.executable, "-c", code, "formats", "--json"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        process.stdout.close()
        told = process.stderr.read().decode()
        assert process.wait(timeout=120) == 0 and told == ""


@pytest.mark.skipif(os.name == "nt", reason="signals of another kind")
def test_ctrl_c_in_the_middle_keeps_finished_runs(small_study):
    code = "import sys; sys.argv[0] = 'ema'; from ema.cli import main; main()"
    # the second run never ends by itself: its reader waits for an interruption
    slow = (
        "import ema.study.chain as chain, time; analyse = chain.analyse\n"
        "chain.analyse = lambda run, *rest, **more: analyse(run, *rest, **more) if run.id == 'first' else time.sleep(600)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", slow + code, "run", str(small_study)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        kept = small_study.parent / "_build" / "recipe" / "first.h5"
        for _ in range(1200):
            if kept.is_file() or process.poll() is not None:
                break
            time.sleep(0.1)
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        told = process.stderr.read().decode()
        assert process.wait(timeout=120) == 130
    assert "finished runs: first" in told and "--resume" in told and "Traceback" not in told
    assert kept.is_file()


def test_doctor_tries_reports_page_and_devices(monkeypatch: pytest.MonkeyPatch):
    told = {one["what"]: one for one in json.loads(ema("doctor", "--json").stdout)["checks"]}
    assert {"report as HTML", "report as PDF", "report as Word file", "ema app", "browser", "ema record"} <= set(told)
    assert told["report as HTML"]["works"] and not told["ema record"]["needed"]

    def absent(name: str) -> str:
        raise doctor.PackageNotFoundError(name)

    monkeypatch.setattr(doctor, "version", absent)
    (missing,) = doctor._daq()
    assert not missing.works and "-m pip install" in missing.remedy and "opendaq" in missing.remedy
