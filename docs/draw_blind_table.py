"""Draw the picture of the blind table in docs/placement.md: `python -m docs.draw_blind_table` from the checkout."""

from pathlib import Path

import numpy as np

from ema.show.style import BLACK, SERIES, new_figure, styled
from tests.validation.blind_table.prediction import HERE
from tests.validation.blind_table.score import score

PICTURE = Path(__file__).resolve().parent / "pictures" / "blind_table.png"


@styled
def blind_table():
    """Bands of the prediction and the truth, over the excitation force, one colour per normal force."""
    found = score(HERE)
    figure = new_figure(3.6)
    left, right = figure.subplots(1, 2)
    places = np.arange(len(found.levels))
    for axes, told, bands, true, factor in (
        (left, found.predicted_frequency, found.frequency_bands, found.frequency, 1.0),
        (right, found.predicted_damping, found.damping_bands, found.damping, 100.0),
    ):
        for column, force in enumerate(found.forces):
            colour = SERIES[column][0]
            at = places + 0.24 * (column - 1)
            low, high = factor * bands[:, :, column]
            axes.bar(at, high - low, 0.18, low, color=colour, alpha=0.35, lw=0, label=f"predicted, F_N {force:g} N")
            axes.hlines(factor * told[:, column], at - 0.09, at + 0.09, color=colour, lw=1.6)
            axes.plot(at, factor * true[:, column], ls="", marker="D", ms=4.5, color=BLACK, mec="white", mew=0.5,
                      zorder=5, label="true" if column == len(found.forces) - 1 else None)
        axes.set_xticks(places, [f"{level:g}" for level in found.levels])
        axes.set_xlabel("Excitation force F_E [N]")
    left.set_ylabel("Natural frequency [Hz]")
    right.set_ylabel("Damping ratio [%]")
    right.axhline(100 * found.bare_damping, color="0.4", ls=":", lw=1.0)
    right.annotate("bare table", (places[-1] + 0.4, 100 * found.bare_damping), xytext=(0, 3), ha="right",
                   textcoords="offset points", fontsize=8, color="0.35")
    right.set_ylim(0, None)
    left.set_ylim(found.frequency_bands.min() - 0.4, found.frequency_bands.max() + 0.4)
    left.set_title("Predicted before, true afterwards: frequency")
    right.set_title("Damping")
    right.legend(fontsize=8, loc="lower center", ncol=2)
    return figure


if __name__ == "__main__":
    blind_table().savefig(PICTURE, dpi=110)
