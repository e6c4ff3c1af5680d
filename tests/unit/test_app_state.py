"""The workbench without a page: picking, dropping, excluding, undo, saving, maps; and its server by plain requests."""

import io
import json
import socket
import threading
import tomllib
import urllib.error
import urllib.request
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import acquisition
from ema import store
from ema.app import Workbench, serve
from ema.app.live_page import _signals
from ema.app.state import Exclusion, nearest
from ema.app.views import chart, curve, export, frf, hits, matrix, motion, overview, point, poles, pulse
from ema.cli.browsing import Keeper, workbench
from ema.data import Channel, Condition, Excitation, JointForce, ModalMap, Recording, StudyResult
from ema.errors import FailureError, InputError
from ema.study import Study


@pytest.fixture(scope="module")
def finished(small_study_master: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small study with its result; to be copied, not used."""
    import shutil

    import ema.report

    folder = tmp_path_factory.mktemp("finished") / "study"
    shutil.copytree(small_study_master, folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ema.report, "write", lambda result, path, **more: path, raising=False)
        Study.load(folder / "recipe.toml").run()
    return folder


@pytest.fixture
def study_folder(finished: Path, tmp_path: Path) -> Path:
    import shutil

    shutil.copytree(finished, tmp_path / "study")
    return tmp_path / "study"


@pytest.fixture
def bench(study_folder: Path) -> Workbench:
    return workbench(study_folder / "recipe.toml")


def frequencies(bench: Workbench) -> list[float]:
    return [round(float(f)) for f in bench.work.result.modes.natural_frequencies]


def test_it_opens_with_the_modes_of_the_study(bench: Workbench):
    assert frequencies(bench) == [120, 210, 333]
    assert len(bench.work.picked) == 3 and bench.saved and bench.undoable == ""
    picked = bench.work.result.poles.natural_frequencies[list(bench.work.picked)]
    np.testing.assert_allclose(sorted(picked), [120, 210, 333], rtol=2e-3)


def test_dropping_and_picking_moves_everything_that_follows(bench: Workbench):
    whole = bench.work.result
    bench.drop(1)
    assert frequencies(bench) == [120, 333] and not bench.saved and bench.undoable == "drop 210 Hz"
    assert bench.work.result.auto_mac.shape == (2, 2)
    assert bench.work.result.reconstruction_error.mean() > 5 * whole.reconstruction_error.mean()
    bench.pick_near(210)
    assert frequencies(bench) == [120, 210, 333]
    np.testing.assert_allclose(bench.work.result.modes.poles, whole.modes.poles, rtol=1e-4)
    np.testing.assert_allclose(bench.work.result.modes.damping_ratios, [0.012, 0.009, 0.015], rtol=0.02)


def test_a_second_click_drops_the_pole_and_undo_brings_it_back(bench: Workbench):
    row = bench.work.picked[0]
    before = bench.work
    bench.pick(row)
    assert row not in bench.work.picked and len(frequencies(bench)) == 2
    bench.undo()
    assert bench.work is before
    with pytest.raises(InputError, match="nothing to undo"):
        bench.undo()


def test_a_second_pick_in_a_column_swaps_the_pole(bench: Workbench):
    poles = bench.work.result.poles
    (former,) = [row for row in bench.work.picked if round(poles.natural_frequencies[row]) == 120]
    column = np.flatnonzero((np.abs(poles.natural_frequencies - 120) < 0.5) & (poles.order != poles.order[former]))
    other = int(column[np.argmin(poles.order[column])])
    bench.pick(other)
    assert frequencies(bench) == [120, 210, 333]
    assert len(bench.work.picked) == 3 and other in bench.work.picked and former not in bench.work.picked
    assert bench.undoable.startswith("swap 120")
    bench.drop(0)
    assert frequencies(bench) == [210, 333]
    bench.undo()
    bench.undo()
    assert former in bench.work.picked and other not in bench.work.picked


def test_every_mode_can_be_dropped(bench: Workbench):
    for _ in range(3):
        bench.drop(0)
    assert frequencies(bench) == [] and matrix(bench) == {"mac": []}
    assert "No mode is picked" in motion(bench)["missing"] or "no geometry" in motion(bench)["missing"]
    assert overview(bench)["modes"] == []
    bench.pick_near(333)
    assert frequencies(bench) == [333]


def test_wrong_picks_are_refused_and_change_nothing(bench: Workbench):
    for wrong in (
        lambda: bench.pick(10**6),
        lambda: bench.pick(-1),
        lambda: bench.drop(7),
        lambda: bench.pick_near(4000.0),
        lambda: bench.choose("third"),
        lambda: bench.exclude(999, "a", "b"),
        lambda: bench.exclude(0, " ", "b"),
        lambda: bench.exclude(0, "a", ""),
    ):
        with pytest.raises(InputError):
            wrong()
    assert bench.revision == 0 and bench.saved


def test_an_excluded_blow_leaves_the_averages_and_becomes_a_repair(bench: Workbench, study_folder: Path):
    before = bench.work.result
    place = next(place for place, hit in enumerate(before.hits.hits) if hit.recording.startswith("first_2"))
    bench.exclude(place, 'a truck "passed"', "A. Tester")
    after = bench.work.result
    assert len(after.hits.accepted) == len(before.hits.accepted) - 1
    assert after.hits.hits[place].reason == 'excluded: excluded by A. Tester: a truck "passed"'
    assert after.frfs.averages.sum() < before.frfs.averages.sum()
    assert frequencies(bench) == [120, 210, 333]
    assert not np.array_equal(after.frfs.values, before.frfs.values)
    bench.save()
    (repair,) = tomllib.loads((study_folder / "campaign" / "campaign.toml").read_text())["repairs"]
    assert repair == {
        "what": "exclude hit",
        "runs": ["first"],
        "files": ["first_2.h5"],
        "hits": [0],
        "who": "A. Tester",
        "why": 'a truck "passed"',
    }
    campaign = acquisition.open_campaign(study_folder / "campaign")
    assert any(record.excluded_hits for record in campaign["first"].recordings)
    bench.undo()
    np.testing.assert_array_equal(bench.work.result.frfs.values, before.frfs.values)
    bench.save()
    assert "repairs" not in tomllib.loads((study_folder / "campaign" / "campaign.toml").read_text())


def test_what_was_saved_is_there_after_opening_again(bench: Workbench, study_folder: Path):
    bench.choose("second")
    bench.drop(2)
    path = bench.save()
    assert path.name == "recipe_picked.h5" and bench.saved
    bench.drop(0)
    again = workbench(study_folder / "recipe.toml")
    again.choose("second")
    assert frequencies(again) == [120, 210]
    assert again.work.picked == tuple(row for row in again.work.picked) and len(again.work.picked) == 2
    assert isinstance(store.load(path), StudyResult)
    by_file = workbench(path)
    assert by_file.result.runs[1].modes.poles.shape == (2,)
    # the recipe stands one folder up and is unchanged: its signals are found (see test_app_result for when not)
    by_file.exclude(0, "a", "b")
    assert by_file.work.excluded[0].why == "a"


def test_a_newer_result_is_taken_and_the_picks_stay_in_their_file(bench: Workbench, study_folder: Path):
    bench.drop(2)
    saved = bench.save()
    result = study_folder / "_build" / "recipe.h5"
    later = saved.stat().st_mtime + 10
    __import__("os").utime(result, (later, later))
    assert frequencies(workbench(study_folder / "recipe.toml")) == [120, 210, 333]
    assert saved.is_file()


def test_a_campaign_changed_by_somebody_else_is_not_overwritten(tmp_path: Path):
    path = tmp_path / "campaign.toml"
    path.write_text('[campaign]\nname = "a"\n[[runs]]\nid = "r"\nfiles = "x.h5"\n[[channels]]\nname = "h"\n')
    keeper = Keeper(path)
    path.write_text(path.read_text() + "# a note\n")
    with pytest.raises(InputError, match="changed by somebody else"):
        keeper.keep({"r": [Exclusion("x.h5", 0, "me", "why")]})
    assert path.read_text().endswith("# a note\n")


def test_exports_can_be_read_again(bench: Workbench, tmp_path: Path):
    name, content = export(bench, "uff55")
    (tmp_path / "m.uff").write_bytes(content)
    (modes,) = acquisition.read(tmp_path / "m.uff").modes
    assert name == "first_modes.uff"
    np.testing.assert_allclose(modes.natural_frequencies, bench.work.result.modes.natural_frequencies, rtol=1e-5)
    (tmp_path / "f.uff").write_bytes(export(bench, "uff58")[1])
    (frfs,) = acquisition.read(tmp_path / "f.uff").frfs
    np.testing.assert_allclose(frfs.values, bench.work.result.frfs.values, rtol=1e-5)
    lines = export(bench, "csv")[1].decode().splitlines()
    assert lines[0].startswith("mode,f [Hz],zeta [%]") and len(lines) == 4
    with pytest.raises(InputError, match="no such export"):
        export(bench, "pdf")


def some_map(**fields) -> ModalMap:
    damping = np.array([[0.01, 0.02, np.nan], [0.012, 0.03, 0.02]])
    return ModalMap(np.array([1.0, 10.0]), np.array([50.0, 100.0, 200.0]), 500 - 100 * damping, damping, **fields)


def test_a_point_of_a_map_leads_to_the_run_behind_it(bench: Workbench):
    runs = [
        replace(run, run=replace(run.run, condition=Condition(Excitation("sweep", level), (JointForce("J", force),))))
        for run, level, force in zip(bench.result.runs, (1.1, 9.0), (52.0, 190.0), strict=True)
    ]
    told = Workbench(replace(bench.result, runs=tuple(runs)), Path("x.h5"), maps=(some_map(name="mode 1"),))
    assert told.behind(0, 0, 0) == "first" and told.behind(0, 1, 2) == "second"
    assert chart(told, 0)["damping"][0] == [1.0, 2.0, None]
    for wrong in ((1, 0, 0), (0, 5, 0)):
        with pytest.raises(InputError):
            told.behind(*wrong)
    bench.maps = (some_map(),)
    with pytest.raises(InputError, match="no run lies behind"):
        bench.behind(0, 0, 0)


def test_a_point_of_a_map_shows_an_frf_of_a_run_that_was_not_fitted(bench: Workbench):
    (first, second) = bench.result.runs
    placed = [
        replace(one.run, condition=Condition(Excitation("sweep", level), (JointForce("J", 100.0),)))
        for one, level in ((first, 1.0), (second, 10.0))
    ]
    campaign = replace(bench.result.campaign, runs=tuple(placed))
    told = replace(bench.result, campaign=campaign, runs=(replace(first, run=placed[0]),))
    told = Workbench(told, Path("x.h5"), maps=(some_map(name="mode 1"),), look=lambda name: second.frfs)
    assert point(told, 0, 0, 1)["run"] == "first"
    seen = point(told, 0, 1, 1)
    assert seen["run"] == "second" and seen["zeta"] == 3.0 and seen["label"] == "1:+Z/1:+Z"
    told.look = None
    with pytest.raises(InputError, match="signals are not available"):
        point(told, 0, 1, 1)


def workbench_of_a_plate(across: int, along: int, *, candidates: int) -> Workbench:
    """A plate of ``across`` by ``along`` points with a placement of three times ``candidates`` beams."""
    from tests.unit.friction_nouns import placement
    from tests.unit.report_corpus import plate, run_result, study

    geometry = plate(across, along)
    run = run_result("table", geometry, 6, lines=12)
    return Workbench(study((run,), geometry), Path("x.h5"), placements=(placement(geometry, across=candidates),))


def test_views_of_5000_points_and_3000_candidates_stay_below_3_mb():
    from ema.app.places import place_view, placement_view

    bench = workbench_of_a_plate(100, 50, candidates=1000)
    moving, placed = motion(bench), placement_view(bench, 0)
    assert len(moving["points"]) == 5000 and moving["modes"]
    assert len(placed["centres"]) == 3000 and place_view(bench, 0, 1500)["candidate"] == 1500
    assert len(json.dumps(moving)) < 3_000_000 and len(json.dumps(placed)) < 3_000_000


def test_views_can_be_written_as_json(bench: Workbench):
    views = [
        overview(bench),
        poles(bench),
        frf(bench, 1, 3),
        matrix(bench),
        motion(bench),
        hits(bench),
        pulse(bench, 0),
    ]
    assert len(json.dumps(views, allow_nan=False)) > 1000
    assert frf(bench, 1, 3)["label"] == bench.work.result.frfs.label(1, 3)
    for wrong in (lambda: frf(bench, 9, 0), lambda: pulse(bench, 999)):
        with pytest.raises(InputError):
            wrong()


def test_the_nearest_stable_pole_of_the_highest_order_is_taken(bench: Workbench):
    table = bench.work.result.poles
    row = nearest(table, 210.3)
    assert table.letter[row] in "sdv" and abs(table.natural_frequencies[row] - 210) < 0.1
    assert table.order[row] > 0.5 * table.order.max()


@pytest.fixture
def served(bench: Workbench):
    pytest.importorskip("plotly")
    app = serve(bench, port=0)
    threading.Thread(target=app.run, daemon=True).start()
    yield app
    app.stop()


def ask(address: str, content: object = None, **headers: str) -> tuple[int, dict]:
    body = None if content is None else json.dumps(content).encode()
    try:
        with urllib.request.urlopen(urllib.request.Request(address, body, headers), timeout=30) as answer:
            return answer.status, json.load(answer)
    except urllib.error.HTTPError as error:
        return error.code, json.load(io.BytesIO(error.read()))


def test_the_server_answers_this_machine_alone_and_only_our_page(served):
    assert served.address.startswith("http://127.0.0.1:") and "token" not in served.address
    assert ask(served.address + "api/overview")[1]["runs"] == ["first", "second"]
    assert ask(served.address + "api/overview", Host="evil.example:80")[0] == 403
    status, told = ask(served.address + "api/drop", {"mode": 0})
    assert (status, told["error"]) == (403, "this request did not come from our page")
    assert frequencies(served.page.bench) == [120, 210, 333]
    status, told = ask(served.address + "api/drop", {"mode": 0}, **{"X-Ema": "1"})
    assert status == 200 and [round(mode["f"]) for mode in told["modes"]] == [210, 333]


def test_every_window_hears_of_a_change_and_the_server_stops_while_they_listen(served):
    windows = [socket.create_connection(served.server.server_address, timeout=20) for _ in range(3)]
    for one in windows:
        one.sendall(b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n")
    assert ask(served.address + "api/drop", {"mode": 0}, **{"X-Ema": "1"})[0] == 200
    wanted = b'"revision": %d, "busy": ""' % served.page.bench.revision
    for one in windows:
        data = b""
        while wanted not in data:
            data += one.recv(4096)
        assert data.startswith(b"HTTP/1.1 200") and b"text/event-stream" in data
    served.stop()
    assert all(one.recv(65536) is not None and one.recv(4096) == b"" for one in windows)


def test_the_server_says_what_is_wrong(served):
    headers = {"X-Ema": "1"}
    assert ask(served.address + "api/drop", {"mode": 99}, **headers) == (
        400,
        {"error": "no such mode; got 100, expected 1 to 3"},
    )
    assert "not understood" in ask(served.address + "api/pick", {}, **headers)[1]["error"]
    assert ask(served.address + "api/format_disk", {}, **headers)[0] == 400
    assert ask(served.address + "api/nothing")[0] == 400 and ask(served.address + "../../etc/passwd")[0] == 404


def raw(app, data: bytes) -> tuple[int, dict]:
    with socket.create_connection(app.server.server_address, timeout=20) as one:
        one.sendall(data)
        answer = b""
        while block := one.recv(65536):
            answer += block
    head, _, body = answer.partition(b"\r\n\r\n")
    return int(head.split()[1]), json.loads(body)


def action(body: bytes, path: bytes = b"/api/near", host: bytes = b"127.0.0.1") -> bytes:
    head = b"POST %s HTTP/1.1\r\nHost: %s\r\nX-Ema: 1\r\nConnection: close\r\n" % (path, host)
    return head + b"Content-Length: %d\r\n\r\n" % len(body) + body


@pytest.mark.parametrize(
    ("data", "status", "words"),
    [
        (action(b"{}", host=b"[::1"), 400, "not understood"),
        (action(b"{}", host=b"evil.example"), 403, "token"),
        (action(b"{}", host=b"127.0.0.1\r\nHost: evil.example"), 403, "token"),
        (action(b"{}", host=b"evil.example@127.0.0.1"), 403, "token"),
        (action(b"{}", host=b"127.0.0.1/evil.example"), 403, "token"),
        (action(b"{}", host=b"127.0.0.1:99999999"), 400, "not understood"),
        (action(b"{}", host=b"127.0.0.1:x"), 400, "not understood"),
        (action(b"[" * 30_000), 400, "more than 16 levels"),
        (action(b'{"frequency":' * 4_000), 400, "more than 16 levels"),
        (action(b'{"frequency": 1e999}'), 400, "too large a number"),
        (action(b'{"frequency": -1e999}'), 400, "too large a number"),
        (action(b'{"frequency": NaN}'), 400, "NaN is no number"),
        (action(b'{"row": ' + b"9" * 9000 + b"}", b"/api/pick"), 400, "not understood"),
        (action(b'{"row": 1e300}', b"/api/pick"), 400, "no such pole"),
        (action(b'{"run": "\\ud800"}', b"/api/run"), 400, "no such run"),
        (action(b"[1, 2]"), 400, "a table is expected"),
        (action(b"\xff\xfe{"), 400, "not understood"),
        (action(b"{}", b"http://[/api/near"), 400, "not understood"),
        (b"GET http://[::1 HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n", 400, "not understood"),
        (b"GET /api/frf?output=" + b"9" * 6000 + b" HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n", 400, ""),
        (b"GET /api/frf?" + b"a=1&" * 100 + b" HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n", 400, ""),
        (b"GET /export?kind=x HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n", 400, ""),
        (b"BREW /pot HTTP/1.1\r\nHost: localhost\r\n\r\n", 501, "BREW"),
        (b"hello\r\n\r\n", 400, ""),
        (b"GET / HTTP/9.9\r\n\r\n", 505, ""),
        (b"GET / HTTP/1.1\r\n" + b"a: b\r\n" * 200 + b"\r\n", 431, ""),
    ],
)
def test_every_refusal_has_a_status_and_a_sentence(shared, capfd, data: bytes, status: int, words: str):
    found, told = raw(shared, data)
    assert found == status and words in told["error"] and "Traceback" not in told["error"]
    assert frequencies(shared.page.bench) == [120, 210, 333]
    assert capfd.readouterr().err == ""


@pytest.fixture(scope="module")
def shared(finished: Path, tmp_path_factory: pytest.TempPathFactory):
    """One server for requests that change nothing."""
    import shutil

    pytest.importorskip("plotly")
    folder = tmp_path_factory.mktemp("shared") / "study"
    shutil.copytree(finished, folder)
    app = serve(workbench(folder / "recipe.toml"), port=0)
    threading.Thread(target=app.run, daemon=True).start()
    yield app
    app.stop()


def test_other_machines_need_the_token(bench: Workbench):
    pytest.importorskip("plotly")
    app = serve(bench, "0.0.0.0", 0)
    threading.Thread(target=app.run, daemon=True).start()
    try:
        port = app.server.server_address[1]
        assert len(app.token) >= 32 and app.address.endswith(f":{port}/?token={app.token}")
        for name in ("", "api/overview", "api/overview?token=wrong", "export?kind=csv", "events"):
            assert ask(f"http://127.0.0.1:{port}/{name}")[0] == 403
        assert ask(f"http://127.0.0.1:{port}/api/overview?token={app.token}")[0] == 200
    finally:
        app.stop()


def test_a_port_in_use_is_told(served):
    with pytest.raises(FailureError, match=r"in use.*choose another port with --port"):
        serve(served.page.bench, port=served.server.server_address[1])


def test_places_of_a_placement(bench: Workbench):
    from ema.app.places import place_view, placement_view
    from tests.unit.friction_nouns import placement
    from tests.unit.report_corpus import plate

    bench.placements = (placement(plate(5, 4)),)
    told = placement_view(bench, 0)
    assert told["ranked"] == [13, 0, 3] and told["unit"] == "%" and len(told["edges"]) == 31
    assert told["score"][2] == pytest.approx(1.1) and told["kinds"] == ["steel 60 x 50 at 0°"]
    best = place_view(bench, 0, 13)
    assert best["rank"] == 1 and best["force"] == 123.0 and best["high"] == [[2.3, 2.0]]
    other = place_view(bench, 0, 7)
    assert other["rank"] == 0 and other["zeta"] == [[1.35, 1.35]] and other["low"] == [[None, None]]
    json.dumps([told, best, other], allow_nan=False)
    with pytest.raises(InputError, match="no such place; got 15"):
        place_view(bench, 0, 15)
    with pytest.raises(InputError, match="no such placement; got 2"):
        placement_view(bench, 1)


@pytest.mark.parametrize("seed", range(3))
def test_a_long_curve_is_thinned_without_losing_a_peak(seed: int):
    """Every so many lines alone would pass over a peak that is narrower than that."""
    rng = np.random.default_rng(seed)
    frequencies, values = np.arange(20_000) * 0.1, np.exp(1j * rng.uniform(-3, 3, 20_000))
    lines = rng.choice(20_000, 5, replace=False)
    values[lines] *= 1e3
    shown = curve(frequencies, values)
    assert len(shown["f"]) == len(shown["magnitude"]) == len(shown["phase"]) <= 3000
    for line in lines:
        place = shown["f"].index(pytest.approx(frequencies[line]))
        assert shown["magnitude"][place] == pytest.approx(1e3, rel=1e-4)
        assert shown["phase"][place] == pytest.approx(np.degrees(np.angle(values[line])), rel=1e-3)


def test_the_live_page_keeps_the_peak_of_a_force_spectrum():
    """Lines of a long record are thinned by the largest of their neighbours: the tone is among them, at 0 dB."""
    rate, line = 10_000.0, 1234
    times = np.arange(20_000) / rate
    force = np.sin(2 * np.pi * line * rate / 20_000 * times)
    shown = _signals(Recording(signals=force[None], sampling_rate=rate, channels=(Channel("force", role="reference"),)))
    spectrum = dict(zip(shown["spectrum"]["f"], shown["spectrum"]["decibels"], strict=True))
    assert len(spectrum) <= 2000 and spectrum[line * rate / 20_000] == 0
