"""Disturb saving, recording or a study at every operation, or at random moments, and count what was lost.

``python -m tests.faults record --operations`` stops it before, after and within every durable operation, fills the
disk at each, takes the permission away or sets the clock back; ``python -m tests.faults record --moments 1000 --signal KILL --seed 5`` stops it at random moments;
``--users 1000`` lets two work in one folder at once, half of the times with the first of them killed. Ends
with status 1 where anything was lost, left behind or not told in a sentence.
"""

import argparse
import random
import sys
import time

from tests.bench import files
from tests.faults import campaign
from tests.faults.operations import HOWS
from tests.faults.subjects import SUBJECTS

WORDS = {
    "before": "killed before",
    "after": "killed after",
    "half": "killed within a write",
    "full": "disk full from",
    "denied": "no permission from",
    "clock": "killed before, and the clock set back a day at",
}


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.faults", description=__doc__)
    parser.add_argument("subject", choices=SUBJECTS)
    parser.add_argument("--operations", action="store_true", help="at every durable operation")
    parser.add_argument("--how", choices=HOWS, action="append", help="only these disturbances")
    parser.add_argument("--all", action="store_true", help="at every single write, not three of each row")
    parser.add_argument("--every", type=int, default=1, help="only every so many operations")
    parser.add_argument("--moments", type=int, default=0, help="so many random moments")
    parser.add_argument("--signal", choices=campaign.SIGNALS, action="append", help="only these signals")
    parser.add_argument("--users", type=int, default=0, help="so many times two at once in one folder")
    parser.add_argument("--seed", type=int, default=None, help="of the moments; drawn by default")
    parser.add_argument("--publish", action="store_true", help="store the counts for docs/files.md")
    told = parser.parse_args()
    seed = random.SystemRandom().randrange(2**32) if told.seed is None else told.seed
    subject, start = SUBJECTS[told.subject](), time.monotonic()
    outcomes: list[campaign.Outcome] = []
    if told.operations:
        operations = campaign.operations_of(subject)
        print(f"{subject.name}: {len(operations)} durable operations")
        for how in told.how or HOWS:
            numbers = list(range(len(operations))) if told.all else campaign.representatives(operations)
            numbers = [n for n in numbers if how != "half" or operations[n].startswith("write")][:: told.every]
            there = [campaign.at_operation(subject, n, how) for n in numbers]
            outcomes += there
            _say(outcomes, f"{how} at {len(numbers)} operations")
            if told.publish:
                what = f"{WORDS[how]}, {len(numbers)} of {len(operations)} operations"
                _publish(told.subject, what, None, there)
    whole = campaign.duration(subject) if told.moments or told.users else 0.0
    for name in (told.signal or list(campaign.SIGNALS)) if told.moments else []:
        drawn = random.Random(f"{seed} {name}")
        there = [
            campaign.at_moment(subject, drawn.uniform(0, 1.05 * whole), name, drawn.randrange(2**32))
            for _ in range(told.moments)
        ]
        outcomes += there
        _say(outcomes, f"{name} at {told.moments} moments of {whole:.2f} s, seed {seed}")
        if told.publish:
            _publish(told.subject, f"SIG{name} at random moments", seed, there)
    drawn = random.Random(f"{seed} users")
    for killed in (False, True) if told.users else ():
        there = [
            campaign.beside(
                subject, drawn.uniform(0, whole), drawn.uniform(0, whole) if killed else None, drawn.randrange(2**31)
            )
            for _ in range(told.users // 2)
        ]
        outcomes += there
        what = "two at once in one folder" + (", one of them killed" if killed else "")
        _say(outcomes, f"{what}, {told.users // 2} times, seed {seed}")
        if told.publish:
            _publish(told.subject, what, seed, there)
    wrong = [one for one in outcomes if one.wrong]
    for one in wrong[:20]:
        print(f"  {one.what}: {one.wrong}")
    print(f"{subject.name}: {len(outcomes)} disturbances, {len(wrong)} wrong, {time.monotonic() - start:.0f} s")
    return 1 if wrong or not outcomes else 0


def _publish(name: str, what: str, seed: int | None, outcomes: list[campaign.Outcome]) -> None:
    figures = {"what": what, "seed": seed, "count": len(outcomes), "wrong": sum(bool(one.wrong) for one in outcomes)}
    files.publish(f"faults {name}", f"{what} {seed}", figures)


def _say(outcomes: list[campaign.Outcome], what: str) -> None:
    print(f"  {what}: {sum(bool(one.wrong) for one in outcomes)} wrong so far", flush=True)


if __name__ == "__main__":
    sys.exit(main())
