"""Joint laws behind a prediction in a report: their weights, and which parameters the levels identify."""

from ema.messages import mark, text, word
from ema.messages.lists import listed
from ema.report.blocks import Block, Book, Cell, Text
from ema.report.numbers import Value
from ema.report.prediction_source import FromLevels
from ema.report.prediction_words import banded

_LAWS = (
    mark("power law"),
    mark("masing"),
    mark("two masing springs"),
    mark("modified iwan"),
    mark("regularised masing"),
    mark("valanis"),
)
_PARAMETERS = {
    "chi": mark("exponent of the density of slip limits"),
    "last spring": mark("share of the stiffness that slips last"),
    "log exponent": mark("natural logarithm of the exponent of the law"),
    "kappa": mark("sharpness of the onset of slip; 0 is the law of Dahl"),
    "ln a_max/a_s": mark("natural logarithm of the highest level over the slip amplitude of the law"),
}
"""What the parameters of the laws are, by the names that data give them."""
_REASONS = (
    mark("its interval does not close within the prior"),
    mark("its standard deviation is above a third of the prior's"),
    mark("its estimates with levels left out disagree"),
    mark("too few draws describe it"),
)
"""Why levels do not identify a parameter, as data say it."""
_ALIKE = 1e-6
"""Relative distance from an equal weight that is rounding."""


def law_sentences(of: FromLevels) -> list[str]:
    """Which laws weigh most, and which of the parameters of the first are identifiable."""
    if not of.laws:
        return []
    equal = 1 / len(of.laws)
    named = [f"{word(name)} {_share(weight)} %" for name, weight in of.laws if weight > equal * (1 + _ALIKE)]
    lines = [
        text("Joint laws that weigh more than an equal share: {laws}.", laws=listed(named))
        if named
        else text("All joint laws weigh the same.")
    ]
    parameters = [one for each in of.at for one in each.parameters]
    if parameters:
        known = [f"{one.name} ({word(one.law)})" for one in parameters if one.identifiable]
        lines.append(
            text("Identifiable parameters: {names}.", names=listed(known))
            if known
            else text("No parameter of the law that weighs most is identifiable.")
        )
    return lines


def _share(weight: float) -> Value:
    """A weight in percent."""
    return Value(100 * weight, f"{100 * weight:.0f}")


def law_blocks(of: FromLevels, book: Book) -> list[Block]:
    """Weights of the laws, and the parameters of the one that weighs most."""
    if not of.laws:
        return []
    caption = text(
        "Joint laws whose mixture gives the bands, with their weights: by how well each predicts the highest levels "
        "from those below. With three levels or fewer all weigh the same. A weight is no probability that the law is "
        "true."
    )
    rows = [(word(name), _share(weight)) for name, weight in of.laws]
    blocks: list[Block] = [book.table("laws", caption, (text("Law"), text("Weight [%]")), rows)]
    parameters: list[tuple[Cell, ...]] = [
        (
            word(one.law),
            one.name,
            _meaning(one.name),
            *banded(one.low, one.value, one.high),
            text("yes") if one.identifiable else text("no"),
            "; ".join(word(reason) for reason in one.reason.split("; ")) if one.reason else "",
        )
        for each in of.at
        for one in each.parameters
    ]
    if parameters:
        columns = (
            text("Law"),
            text("Parameter"),
            text("Meaning"),
            text("Median"),
            text("95 % interval"),
            text("Identifiable"),
            text("Reason"),
        )
        caption = text("Parameters in which the law that weighs most is not linear.")
        blocks.append(book.table("law_parameters", caption, columns, parameters))
        blocks.append(
            Text(
                text(
                    "Identifiable: the 95 % interval, model-form discrepancy included, closes inside the prior, the "
                    "standard deviation is below a third of the prior's, and the estimates without the highest one and "
                    "two levels agree. That an identifiable parameter predicts does not follow."
                )
            )
        )
    return blocks


def _meaning(name: str) -> str:
    """What a parameter is; of a law with several springs, of which one."""
    bare, _, spring = name.partition(" of spring ")
    meaning = word(_PARAMETERS[bare]) if bare in _PARAMETERS else ""
    return text("{meaning}, spring {number}", meaning=meaning, number=spring) if spring else meaning
