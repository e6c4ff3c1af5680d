"""How well places are ranked from shapes with 10 % noise: draws of the noise, against brute force with exact shapes.

Structure, places and figures of merit are those of `tests/validation/test_placement.py`. One mode at a time is what the
predictor does with all candidates; all modes together is what checks the best of them.

    python -m tests.bench.placement_ranking --draws 20 --seed 1 --write docs/placement.md
"""

import argparse
from pathlib import Path

import numpy as np

from ema import place
from ema.place import predict
from tests.bench import marked
from tests.validation.test_placement import NOISE, Table, figures, judged, spots

RANK, REGRET = 0.95, 0.05
"""What is hoped for of all modes together: rank correlation at least, damping given up by the first place at most."""
AIMS = ("mode 1", "mode 3", "the worse of both")


def ranked(seed: int, table: Table, truth: list[np.ndarray]) -> tuple[list[float], list[list[float]]]:
    """Rank correlation, regret and regret of the best of five: mode 1 by the predictor, and all aims by all modes."""
    here, task = spots(6, 3), table.measured((0, 2), NOISE, seed)
    predicted = predict(task, here)
    together = judged(place.verify(task, predicted, np.arange(len(here))))
    alone = figures(truth[0], judged(predicted)[0])
    return list(alone), [list(figures(left, right)) for left, right in zip(truth, together, strict=True)]


def lines(alone: np.ndarray, together: np.ndarray) -> list[str]:
    """The table of the page: median and worst of the draws (draw, figure) and (draw, aim, figure)."""
    text = [
        "| 10 % noise | draws | rank correlation: median, least | given up by the first place: median, most | "
        f"rank at least {RANK} | given up at most {100 * REGRET:g} % |",
        "|---|---|---|---|---|---|",
    ]
    rows = [("mode 1, one mode at a time", alone)]
    rows += [(f"{aim}, all modes together", together[:, row]) for row, aim in enumerate(AIMS)]
    for name, one in rows:
        rank, regret = one[:, 0], one[:, 1]
        text.append(
            f"| {name} | {len(one)} | {np.median(rank):.3f}, {rank.min():.3f} | "
            f"{100 * np.median(regret):.1f} %, {100 * regret.max():.1f} % | {np.sum(rank >= RANK)} | "
            f"{np.sum(regret <= REGRET)} |"
        )
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1, help="of the first draw; the others follow")
    parser.add_argument("--write", type=Path, help="page with a marked table")
    given = parser.parse_args()
    table, here = Table(), spots(6, 3)
    exact = table.truth((0, 2))
    truth = judged(place.verify(exact, predict(exact, here), np.arange(len(here))))
    alone, together = [], []
    for seed in range(given.seed, given.seed + given.draws):
        one, every = ranked(seed, table, truth)
        alone.append(one)
        together.append(every)
        print(seed, np.round(one, 3).tolist(), np.round(every, 3).tolist(), flush=True)
    text = "\n".join(lines(np.array(alone), np.array(together)))
    print(text)
    if given.write:
        marked.write(given.write, "ranking", text)


if __name__ == "__main__":
    main()
