"""Mutated files for one reader or all, judged against truths that no reader of ours made.

``python -m tests.fuzz --reader uff --n 100000 --seed 5``; ``--number 17`` shows one case of that seed, ``--keep`` stores
the files of wrong cases, ``--replay`` reads what was kept and a few cases of fixed seeds for every reader.
"""

import argparse
import random
import sys
import tempfile
import time
from pathlib import Path

from tests.bench import files
from tests.fuzz import batch
from tests.fuzz.cases import judged
from tests.fuzz.kept import replay
from tests.fuzz.subjects import SUBJECTS

FIXED = 20261122
"""Seed of the cases that belong to the gate."""


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--reader", choices=SUBJECTS, action="append", help="all by default")
    parser.add_argument("--n", type=int, default=1000, help="cases for each reader")
    parser.add_argument("--seed", type=int, default=None, help="drawn by default")
    parser.add_argument("--number", type=int, default=None, help="one case alone")
    parser.add_argument("--keep", type=Path, default=None, help="folder for the files of wrong cases")
    parser.add_argument("--replay", action="store_true", help="kept inputs, and --n cases of a fixed seed")
    parser.add_argument("--publish", action="store_true", help="store the counts for docs/files.md")
    given = parser.parse_args()
    names = given.reader or list(SUBJECTS)
    seed = random.SystemRandom().randrange(2**32) if given.seed is None else given.seed
    failed = 0
    if given.replay:
        seed = FIXED
        for name, why in replay():
            failed += bool(why)
            if why:
                print(f"kept {name}: {why}")
    for name in names:
        subject = SUBJECTS[name]()
        if given.number is not None:
            case = batch.case_of(subject, seed, given.number)
            path = (given.keep or Path(tempfile.mkdtemp())) / f"{name}-{seed}-{given.number}{subject.suffix}"
            print(case.kind, case.what, path)
            print(judged(subject, case, path))
            continue
        start = time.monotonic()
        made = batch.run(subject, seed, range(given.n))
        counts = ", ".join(f"{count} {outcome}" for outcome, count in sorted(made.outcomes.items()))
        print(f"{name}: {given.n} cases, seed {seed}: {counts}; {time.monotonic() - start:.0f} s", flush=True)
        for number, what, outcome in made.wrong[:40]:
            print(f"  {number} ({what}): {outcome}", flush=True)
            if given.keep:
                given.keep.mkdir(parents=True, exist_ok=True)
                data = batch.case_of(subject, seed, number).data
                (given.keep / f"{name}-{seed}-{number}{subject.suffix}").write_bytes(data)
        failed += len(made.wrong)
        if given.publish:
            files.publish(f"fuzz {name}", str(seed), {"outcomes": dict(made.outcomes)})
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
