"""What predictions were worth: coverage with a bootstrap over hosts, widths, interval score, ranks, regret."""

from typing import Any

import numpy as np
from scipy.stats import spearmanr

ACTIVE = 1.1
"""True damping over that of the bare mode from which a condition counts as active."""
BOOTSTRAP = 2000
LEVEL = 0.95


def rows(answer: dict[str, Any]) -> np.ndarray:
    """One row per condition of a host: active, f and zeta inside, relative errors, half widths, interval scores."""
    told, true, result = answer["prediction"], answer["truth"], []
    for m, bare in enumerate(answer["bare"]):
        for i, j in np.ndindex(np.shape(told["frequency"])[1:]):
            line: list[float] = []
            for name in ("frequency", "damping"):
                value, low, middle, high = (
                    true[name][m][i][j],
                    told[name + "_low"][m][i][j],
                    told[name][m][i][j],
                    told[name + "_high"][m][i][j],
                )
                if value is None or not np.isfinite([value, low, middle, high]).all():
                    line += [np.nan] * 4
                    continue
                missed = max(low - value, value - high, 0.0)
                line += [low <= value <= high, middle / value - 1, (high - low) / 2 / value]
                # Gneiting and Raftery (2007), Eq. (43), over the true value
                line += [((high - low) + 2 / (1 - LEVEL) * missed) / value]
            zeta = true["damping"][m][i][j]
            gain = np.nan if zeta is None or not zeta > bare else zeta - bare
            result.append([np.nan if zeta is None else float(zeta > ACTIVE * bare), *line, gain, zeta or np.nan])
    return np.array(result, dtype=float)


def ranks(answer: dict[str, Any]) -> np.ndarray:
    """Per mode, over the places: rank correlation, regret (of the damping gained), and regret against the best of all.

    The last counts places too for which nothing was predicted, such as those where a joint parts.
    """
    result = []
    for told, true, bare in zip(answer["prediction"]["ranked"], answer["truth"]["ranked"], answer["bare"]):
        told, true = np.array(told, float), np.array(true, float)
        known = np.isfinite(told) & np.isfinite(true)
        if known.sum() < 6 or np.ptp(true[known]) < 0.1 * bare:
            continue
        chosen = true[known][told[known].argmax()] - bare
        best, best_of_all = true[known].max() - bare, np.nanmax(true) - bare
        result.append([spearmanr(told[known], true[known]).statistic, 1 - chosen / best, 1 - chosen / best_of_all])
    return np.array(result).reshape(-1, 3)


def report(answers: list[dict[str, Any]], seed: int = 0) -> str:
    """All of it as text; hosts are drawn again with replacement for the intervals of the coverage."""
    rng = np.random.default_rng(seed)
    each = [rows(answer) for answer in answers]
    lines = [f"{len(answers)} hosts, {sum(len(one) for one in each)} conditions"]
    for active, title in ((1.0, "active"), (0.0, "inactive")):
        for first, name in ((1, "f"), (5, "zeta")):
            picked = [one[(one[:, 0] == active) & np.isfinite(one[:, first])] for one in each]
            together = np.concatenate(picked)
            if not len(together):
                continue
            counts = np.array([[one[:, first].sum(), len(one)] for one in picked])
            drawn = counts[rng.integers(0, len(counts), (BOOTSTRAP, len(counts)))].sum(axis=1)
            low, high = np.nanquantile(drawn[:, 0] / np.maximum(drawn[:, 1], 1), [0.025, 0.975])
            half = 100 * np.quantile(together[:, first + 2], [0.5, 0.9])
            shares = counts[counts[:, 1] > 0]
            worst = float((shares[:, 0] / shares[:, 1]).min())
            text = (
                f"{title:8s} {name:4s} inside {int(counts[:, 0].sum())} of {len(together)} = "
                f"{together[:, first].mean():.1%} [{low:.1%}, {high:.1%}], worst host {worst:.0%}; half width median "
                f"{half[0]:.2f} %, 90th percentile {half[1]:.2f} %; error: mean {100 * together[:, first + 1].mean():+.2f} "
                f"%, median size {100 * np.median(np.abs(together[:, first + 1])):.2f} %; mean interval score "
                f"{100 * together[:, first + 3].mean():.2f} %"
            )
            if name == "zeta" and active:
                over = together[:, 7] * together[:, 10] / together[:, 9]
                text += f"; half width over the gain median {np.nanmedian(over):.0%}"
            lines.append(text)
    holes = sum(int(np.isnan(one[:, 5]).sum()) for one in each)
    lines.append(f"conditions without a band or a truth: {holes}")
    order = np.concatenate([ranks(answer) for answer in answers])
    if len(order):
        regret, of_all = 100 * np.quantile(order[:, 1:], [0.5, 0.9], axis=0).T
        lines.append(
            f"places: {len(order)} rankings, rank correlation median {np.median(order[:, 0]):.3f}, 10th percentile "
            f"{np.quantile(order[:, 0], 0.1):.3f}; regret median {regret[0]:.1f} %, 90th percentile {regret[1]:.1f} %; "
            f"against places without a prediction too: {of_all[0]:.1f} %, {of_all[1]:.1f} %"
        )
    return "\n".join(lines)
