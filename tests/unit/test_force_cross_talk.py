"""Cross-talk of the excitation force into a normal-force channel, on beams on contact springs that vibrate."""

from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

import acquisition
from acquisition.force_cross_talk import cross_talk_findings
from ema import store
from ema.data import Channel
from tests.bench.cross_talk import _POINTS, DrawnTest, Structure

SEED = 7300041
JOINTS = {"J1": "ring J1", "J2": "ring J2"}


def points_of(number: int) -> int:
    """Points of a test that is drawn, by the same random numbers and without its records."""
    rng = np.random.default_rng([SEED, number])
    Structure.draw(rng)
    return int(rng.choice(_POINTS)) if number % 4 < 2 else 1


def drawn(kind: str, points: int, share: float, count: int) -> list[DrawnTest]:
    numbers = {"hammer": range(0, 4000, 4), "random": range(2, 4000, 4), "sweep": range(3, 4000, 4)}[kind]
    of_size = (number for number in numbers if points_of(number) == points)
    chosen = [DrawnTest.draw(SEED, number, share) for number in islice(of_size, count)]
    assert [(test.kind, test.points) for test in chosen] == [(kind, points)] * count
    return chosen


@pytest.mark.parametrize("share", [-0.1, 0.1])
def test_cross_talk_is_named_with_its_share_and_the_clean_cell_is_not(share: float) -> None:
    """In some of eight tests of ten points vibration hides a tenth of the force; the others name it."""
    named = [test.named() for test in drawn("hammer", 10, share, 8)]
    shares = [one["J1"] for one in named if "J1" in one]
    assert len(shares) >= 5 and not any("J2" in one for one in named)
    assert all(abs(value - share) <= 2 * half for value, half in shares)
    assert sum(abs(value - share) <= half for value, half in shares) >= len(shares) - 1


@pytest.mark.parametrize(("kind", "points", "count"), [("hammer", 1, 10), ("hammer", 10, 10), ("random", 1, 3)])
def test_a_structure_that_changes_its_normal_force_by_vibration_is_not_named(
    kind: str, points: int, count: int
) -> None:
    """Two joints each, no force in any of their channels."""
    tests = drawn(kind, points, 0.0, count)
    moved = [one.signals[-1].std() / one.signals[0].std() for test in tests for one in test.records]
    assert np.median(moved) > 0.05, "the normal force does follow the vibration"
    assert not any(test.named() for test in tests)


def test_without_the_joint_pressed_the_least_cross_talk_is_named(tmp_path: Path) -> None:
    """Runs without a beam whose records hold the load cell: it has nothing to follow but cross-talk."""
    test = drawn("hammer", 3, 0.0, 1)[0]
    rng = np.random.default_rng(SEED)
    for share in (0.0, 0.005):
        folder = tmp_path / str(share)
        (folder / "raw").mkdir(parents=True)
        for number, record in enumerate(test.records):
            signals = np.array(record.signals)
            noise = 1e-4 * np.abs(signals[0]).max() * rng.standard_normal(signals.shape[1])
            signals[-2:] = share * signals[0] + noise
            store.save(folder / "raw" / f"bare_{number + 1}.h5", replace(record, signals=signals))
        (folder / "campaign.toml").write_text(
            '[campaign]\nname = "bare"\nfiles = "raw"\n[[runs]]\nid = "bare"\nkind = "hammer"\nbeam = false\n'
            'files = "bare_*.h5"\n'
        )
        run = acquisition.open_campaign(folder)["bare"]
        assert run.condition.joints == ()
        found = [one for one in run.findings if one.code == "normal-force-cross-talk"]
        assert [one.where for one in found] == (["run bare, joint J1", "run bare, joint J2"] if share else [])
        assert all(abs(one.value - share) <= max(2 * one.limit, 5e-5) for one in found)


def test_what_cannot_be_told_apart_is_not_named() -> None:
    """One frequency, several shakers, no response, no numbers, a band without resonances."""
    test = drawn("hammer", 10, 0.1, 1)[0]
    records = test.records
    assert test.named()

    def named(changed: list) -> int:
        return len(cross_talk_findings(changed, JOINTS, "hammer", "run"))

    assert not cross_talk_findings(records, JOINTS, "stepped sine", "run")
    assert not cross_talk_findings(records, {}, "hammer", "run")
    second = Channel("force 2", role="reference", unit="N", quantity="force")
    several = [
        replace(one, signals=np.vstack([one.signals, one.signals[:1]]), channels=(*one.channels, second))
        for one in records
    ]
    assert not named(several)
    silent = [
        replace(one, channels=tuple(replace(c, role="other") if c.role == "response" else c for c in one.channels))
        for one in records
    ]
    assert not named(silent)
    for changed in ({"unit": "unstated"}, {"unit": "V", "quantity": "voltage"}, {"name": "another"}):
        cells = tuple(replace(one, **changed) if one.name == "ring J1" else one for one in records[0].channels)
        assert not named([replace(one, channels=cells) for one in records])
    broken = [
        replace(one, signals=np.where(np.arange(one.signals.shape[1]) == 5, np.nan, one.signals)) for one in records
    ]
    assert not named(broken)
    flat = [
        replace(one, signals=np.vstack([one.signals[:1]] * 3 + [1000 + 0.1 * one.signals[:1]] * 2)) for one in records
    ]
    assert not named(flat)
