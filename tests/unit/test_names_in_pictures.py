"""Names with characters that matplotlib would read as a formula."""

import io

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

from ema.show.style import new_figure, styled

NAMES = ("a $x_{$ b", "$", "5 $ and $ 6", r"$\frac{$", "run_1")


@styled
def drawn(name: str) -> Figure:
    figure = new_figure(3.0)
    axes = figure.subplots()
    axes.loglog([1, 10, 100], [1, 2, 3000.0], label=name)
    axes.set_title(name)
    axes.set_xlabel(name)
    axes.legend(title=name)
    bars = figure.add_axes((0.6, 0.6, 0.3, 0.3))
    bars.bar(np.arange(2), [1.0, 2.0])
    bars.set_xticks(range(2), labels=[name, "b"])
    figure.suptitle(name)
    return figure


@pytest.mark.parametrize("name", NAMES)
def test_names_are_shown_as_they_are(name: str) -> None:
    figure = drawn(name)
    figure.savefig(io.BytesIO(), format="png", dpi=40)
    figure.savefig(io.BytesIO(), format="svg")
    texts = [text for text in figure.findobj(Text) if text.get_text() == name]
    assert len(texts) >= 6
    assert not any(text.get_parse_math() for text in texts if text.get_visible() and "$" in name)


def test_powers_of_ten_stay_powers() -> None:
    figure = drawn("run_1")
    figure.savefig(io.BytesIO(), format="png", dpi=40)
    labels = [label for label in figure.axes[0].get_xticklabels() if label.get_text()]
    assert labels and all("mathdefault" in label.get_text() and label.get_parse_math() for label in labels)
