"""`ema run`, `ema map` and `ema archive add` on two worker processes of Dask: the results of one process."""

import json
import shutil
import subprocess
from collections import Counter
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from ema import fingerprint, store
from ema.cli import cluster
from ema.errors import FailureError, InputError
from ema.study import Study, remote
from tests.journeys.small_campaign import ema_command
from tests.unit.conftest import CAMPAIGN, RECIPE, small_study, small_study_master  # noqa: F401 (fixtures)
from tests.unit.test_map_campaign import campaign as map_campaign

pytest.importorskip("distributed")
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=None
    ) as local:
        yield local.scheduler_address


def numbers(path: Path) -> list[np.ndarray]:
    """Everything that `ema run` found of its runs."""
    found = []
    for run in store.load(path).runs:
        modes, frfs = run.modes, run.frfs
        found += [
            modes.poles,
            modes.shapes,
            modes.covariance,
            modes.participation,
            frfs.values,
            run.reconstruction.values,
        ]
    return found


def test_a_study_has_the_results_of_one_process(
    small_study: Path,  # noqa: F811
    without_report: None,
    tmp_path: Path,
    capsys,
    address: str,
) -> None:
    for name, more in (("one", ()), ("two", ("--cluster", address))):
        done = ema_command(capsys, "run", small_study, "--output", tmp_path / name, "--json", *more)
        assert done.status in (0, 1), done.err
    one, two = (numbers(tmp_path / name / "recipe.h5") for name in ("one", "two"))
    assert len(one) == len(two) == 12 and all(np.array_equal(a, b) for a, b in zip(one, two, strict=True))
    first, second = (store.load(tmp_path / name / "recipe.h5") for name in ("one", "two"))
    assert [run.findings for run in first.runs] == [run.findings for run in second.runs]
    assert [repr(run.run) for run in first.runs] == [repr(run.run) for run in second.runs]
    # what the workers did is kept, and taken up by one process
    again = ema_command(capsys, "run", small_study, "--output", tmp_path / "two", "--resume", "--json")
    assert again.status in (0, 1) and numbers(tmp_path / "two" / "recipe.h5")[0].tolist() == one[0].tolist()


def test_a_map_has_the_results_of_one_process(tmp_path: Path, capsys, address: str) -> None:
    folder = map_campaign(tmp_path / "campaign")
    told = {}
    for name, more in (("one", ()), ("two", ("--cluster", address))):
        done = ema_command(capsys, "map", folder, "--near", 497, "--output", tmp_path / name, "--json", *more)
        assert done.status in (0, 1), done.err
        told[name] = json.loads(done.out)["maps"]
    assert told["one"] == told["two"] and len(told["one"][0]["points"]) == 4


def test_draws_of_a_bench_are_those_of_one_process_and_a_killed_worker_costs_its_draw_alone(
    tmp_path: Path, address: str
) -> None:
    from tests.bench.workers import mapping

    def draw(log: str, number: int) -> float:
        import os
        from pathlib import Path

        import numpy as np

        path = Path(log)
        (path / f"{number} {len(list(path.iterdir()))} {os.getpid()}").touch()
        if number == 3 and len(list(path.glob("3 *"))) == 1:
            os.kill(os.getpid(), 9)
        return float(np.random.default_rng(number).standard_normal())

    logs = [tmp_path / name for name in ("here", "there")]
    for log in logs:
        log.mkdir()
    (logs[0] / "3 before").touch()  # in this process nothing is killed
    with mapping(None, 1) as each:
        here = list(each(partial(draw, str(logs[0])), range(12)))
    with mapping(address, 1) as each:
        there = list(each(partial(draw, str(logs[1])), range(12)))
    assert here == there and len(list(logs[1].glob("3 *"))) == 2
    # only what the killed process had computed is computed again: a worker that lives loses nothing
    ran = sorted(
        (int(order), number, process) for number, order, process in (p.name.split() for p in logs[1].iterdir())
    )
    first = {number: process for _, number, process in reversed(ran)}
    again = [number for number, times in Counter(number for _, number, _ in ran).items() if times > 1]
    assert "3" in again and {first[number] for number in again} == {first["3"]}


def test_a_worker_of_another_version_is_refused(small_study: Path, capsys, address: str, monkeypatch) -> None:  # noqa: F811
    versions = fingerprint.versions()
    monkeypatch.setattr(fingerprint, "versions", lambda: (("friction-ema", "0.0.9"), *versions[1:]))
    ema_command(capsys, "run", small_study, "--cluster", address).says(
        2, "worker tcp://127.0.0.1", "other versions", "got friction-ema 0.1.0, expected friction-ema 0.0.9"
    )


def test_a_worker_that_cannot_see_the_data_says_so(small_study: Path, tmp_path: Path, address: str) -> None:  # noqa: F811
    study = Study.load(small_study, output=tmp_path / "out")
    measured = remote.Measured.of(study.campaign, salvage=False)
    settings = (study.recipe.estimate, study.recipe.fit)
    (small_study.parent / "campaign" / "campaign.toml").write_text(CAMPAIGN + "\n# another one\n", encoding="utf-8")
    with cluster.workers(address, 1) as executor:
        with pytest.raises(InputError, match=r"worker on .*sees another campaign under the same path"):
            list(remote.in_order([executor.submit(remote.run_result, measured, "first", [], *settings)]))
        shutil.rmtree(small_study.parent / "campaign")
        with pytest.raises(InputError, match=r"worker on .*cannot see the data; got no .*campaign.toml"):
            list(remote.in_order([executor.submit(remote.run_result, measured, "first", [], *settings)]))


def test_workers_without_memory_say_so(address: str) -> None:
    """A task that asks for more than there is, and one that the system kills on every worker that tries it."""

    def too_large() -> float:
        import numpy as np

        return float(np.ones(2**58).sum())

    def killed() -> None:
        import os

        os.kill(os.getpid(), 9)

    for task, kind, words in (
        (too_large, FailureError, r"a task needs more memory than its worker has.*start workers with more memory"),
        (killed, InputError, r"a task ended its workers one after the other.*workers with enough memory"),
    ):
        with cluster.workers(address, 1) as executor, pytest.raises(kind, match=words):
            list(remote.in_order([executor.submit(task)]))


def test_campaigns_are_indexed_by_workers(tmp_path: Path, capsys, address: str, monkeypatch) -> None:
    from tests.bench import archive_campaigns as generated

    monkeypatch.setenv("EMA_CACHE", str(tmp_path / "cache"))
    for number in range(5):
        generated.write(tmp_path / "tests" / f"c{number}", number, 3, 5)
    for name, more in (("one", ()), ("two", ("--cluster", address))):
        assert ema_command(capsys, "archive", "add", tmp_path / name, tmp_path / "tests", *more).status == 0
    names = [sorted(path.name for path in (tmp_path / name / "parts").iterdir()) for name in ("one", "two")]
    assert names[0] == names[1] and len(names[0]) == 5


@pytest.mark.skipif(shutil.which("openssl") is None, reason="certificates are made by openssl")
def test_workers_behind_certificates_compute_and_others_are_not_let_in(tmp_path: Path, capsys) -> None:
    import dask
    from distributed import LocalCluster
    from distributed.security import Security

    key, certificate = tmp_path / "key.pem", tmp_path / "cert.pem"
    command = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=localhost"]
    subprocess.run([*command, "-keyout", key, "-out", certificate], check=True, capture_output=True)
    tls = "distributed.comm.tls"
    files = {
        f"{tls}.{who}.{kind}": str(path)
        for who in ("client", "scheduler", "worker")
        for kind, path in (("key", key), ("cert", certificate))
    } | {f"{tls}.ca-file": str(certificate)}
    with dask.config.set(files):
        local = LocalCluster(
            n_workers=1,
            processes=True,
            protocol="tls://",
            host="127.0.0.1",
            dashboard_address=None,
            security=Security(),
        )
        with local:
            with cluster.workers(local.scheduler_address, 1) as executor:
                assert local.scheduler_address.startswith("tls://") and executor is not None
                assert list(remote.in_order([executor.submit(abs, -3)])) == [3]
            assert capsys.readouterr().err == ""
            with (
                dask.config.set(dict.fromkeys(files)),
                pytest.raises(InputError, match="no cluster answers"),
                cluster.workers(local.scheduler_address, 1),
            ):
                pass


def test_a_plain_scheduler_that_others_reach_is_warned_of(capsys) -> None:
    for address, warned in (
        ("tcp://10.0.0.7:8786", True), ("10.0.0.7:8786", True), ("tcp://127.0.0.1:8786", False), ("tls://10.0.0.7:1", False),
    ):  # fmt: skip
        cluster._warn(address)
        assert ("runs code for whoever reaches it" in capsys.readouterr().err) is warned
    assert "campaign" in RECIPE
