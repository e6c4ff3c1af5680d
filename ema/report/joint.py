"""A friction joint by what was stated of a structure: verdicts, parameters, weights, the measurement that decides."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from ema import show
from ema.messages import mark, plural, text, word
from ema.messages.lists import listed
from ema.messages.recognition import recognised
from ema.report.blocks import Block, Book, Cell, Section, Table, Text
from ema.report.document import Chapter, Document
from ema.report.findings import counted, finding_table, grouped, language_note
from ema.report.numbers import MISSING, Value, fixed, plain, rounded
from ema.report.records import provenance_blocks
from ema.show import joint_words
from ema.show.joint_result import JointHypothesis, JointLimit, JointParameter, JointResult, JointStatement

_VERDICTS = (mark("holds"), mark("does not hold together with the others"), mark("not known"))
_EXPERIMENTS = (
    mark("hysteresis loops of both joints: ln of the ratio of their friction coefficients"),
    mark("hysteresis loops of both joints: difference of the exponents of k_T"),
    mark("hammer, 1 kN, half the impact: damping [%]"),
    mark("peak force of the impacts: ln of N"),
)
_LAW_EXPERIMENTS = (
    mark("hysteresis loops with slips of F_C/k_T and twice that: energy of the first over that of the second"),
    mark("hammer, 1 kN, a tenth of the impact: damping [%]"),
    mark("shaker, {force} N: damping at half the highest level over that at the highest"),
)
_HYPOTHESES = (mark("one joint"), mark("two joints"))
_APART = (mark("excluded"), mark("the others are excluded"), mark("cannot be told apart"))
"""Words of data."""


def joint_document(result: JointResult, book: Book) -> Document:
    """Compose the report of what statements say of a joint.

    Parameters
    ----------
    result : JointResult
        Parameters, statements and their verdicts.
    book : Book
        Numbers the pictures and tables.

    Returns
    -------
    Document
        Front page with the answer, tables of statements and parameters, limits of the model, provenance.
    """
    sections = [
        Section(text("Statements, and what all others predict"), "statements", _statements(result, book)),
        Section(text("Parameters"), "parameters", _parameters(result, book)),
        Section(text("Hypotheses, and what would decide"), "hypotheses", _hypotheses(result, book)),
        Section(text("What the model assumes"), "assumptions", [Text(line) for line in _assumptions()]),
    ]
    groups = grouped(list(result.findings))
    frequency, damping = result.bare
    numbers = sum(statement.is_number for statement in result.statements)
    return Document(
        title=result.title,
        facts=[
            (text("Without the beam"), f"{frequency:g} Hz, {100 * damping:.4g} %"),
            (
                text("Statements"),
                text("{numbers} numbers, {limits} limits", numbers=numbers, limits=len(result.statements) - numbers),
            ),
            *((text("File"), name) for name, _ in result.provenance.inputs),
        ],
        comment="",
        photos=[],
        summary=[*answers(result), counted(groups)],
        answers=[section for section in sections if section.blocks],
        finding_groups=groups,
        findings=finding_table(groups, book),
        expectations=None,
        chapters=[Chapter(text("Provenance"), "provenance", provenance_blocks(result.provenance, book))],
        language_note=language_note() if groups else "",
    )


def answers(result: JointResult) -> list[str]:
    """What is determined, one joint or two, what contradicts the others, and which measurement decides.

    Parameters
    ----------
    result : JointResult
        What statements say of a joint.

    Returns
    -------
    list of str
        A few sentences, in the language of the report; every number stands in a table of the report too.

    Examples
    --------
    >>> from ema.show.joint_result import example
    >>> print(answers(example())[0])
    Determined (95 % interval at most half as wide as before): stiffness ratio at 1 kN, hammer 0.083 to 0.35.
    """
    return [
        _determined(result),
        *_laws(result),
        *_one_or_two(result),
        *_contradictions(result),
        *_limit(result),
        *_decisive(result),
        text(WITHIN),
    ]


WITHIN = mark(
    "Intervals, probabilities and weights are those of the model; what the model leaves out is in none of them. How "
    "often they are right on tables of the model itself was counted under the conditions of one paper (docs/joint.md)."
)
"""What the numbers do not contain."""


def _determined(result: JointResult) -> str:
    known = [parameter for parameter in result.parameters if parameter.determined]
    if not known:
        return text("No parameter is determined: no 95 % interval is at most half as wide as before.")
    shown = [(joint_words.parameter(parameter.name), parameter.interval) for parameter in known]
    return text(
        "Determined (95 % interval at most half as wide as before): {parameters}.",
        parameters="; ".join(f"{one.name} {one.interval(ends)}" for one, ends in shown),
    )


def _laws(result: JointResult) -> list[str]:
    """Which friction laws explain the statements."""
    if len(result.laws) < 2:
        return []
    left = [one for one in result.laws if one.verdict != "excluded"]
    out = [one.name for one in result.laws if one.verdict == "excluded"]
    if len(left) == 1:
        sentence = text("Of the friction laws compared, the statements leave that of {law}.", law=left[0].name)
    else:
        weights = [f"{one.name} {100 * one.weight:.0f} %" for one in left]
        sentence = text("Friction laws that cannot be told apart, with their weights: {laws}.", laws=listed(weights))
    excluded = text("Excluded (a weight below 5 %): {laws}.", laws=listed(out)) if out else ""
    return [f"{sentence} {excluded}".rstrip()]


def _limit(result: JointResult) -> list[str]:
    """Where the frequency goes as the normal force goes to zero."""
    if result.lift_off is None:
        return []
    return [
        text(
            "As the normal force goes to zero, the frequency comes to {low} to {high} Hz (95 %); that it reaches the "
            "{bare} Hz without the beam has a probability of {probability}.",
            low=f"{result.lift_off.limit[0]:.1f}",
            high=f"{result.lift_off.limit[1]:.1f}",
            bare=f"{result.bare[0]:g}",
            probability=joint_words.probability(result.lift_off.reached),
        )
    ]


def _one_or_two(result: JointResult) -> list[str]:
    if result.weight is None:
        return []
    weight, low, high = (f"{100 * x:.0f}" for x in (result.weight.weight, result.weight.low, result.weight.high))
    if not result.decided:
        sentence = text(
            "One joint and two joints cannot be told apart: that both tests had one joint has a weight of {weight} % "
            "({low} to {high} % by independent runs); beforehand it was one half.",
            weight=weight,
            low=low,
            high=high,
        )
    elif result.weight.weight > 0.5:
        sentence = text(
            "Both tests had one joint: it has a weight of {weight} % ({low} to {high} % by independent runs).",
            weight=weight,
            low=low,
            high=high,
        )
    else:
        sentence = text(
            "The two tests had two joints: one joint has a weight of {weight} % ({low} to {high} % by independent "
            "runs).",
            weight=weight,
            low=low,
            high=high,
        )
    return [sentence]


def _contradictions(result: JointResult) -> list[str]:
    """Statements that contradict the others, or the one that comes nearest to it; and how many cannot be judged."""
    lines = [
        text(
            "Statement {number} does not hold together with the others: “{sentence}” (stated {stated}; predicted "
            "{predicted}, 95 %; probability {probability}).",
            **_facts(result, row),
        )
        for row, statement in enumerate(result.statements)
        if statement.contradicts
    ]
    judged = [row for row, statement in enumerate(result.statements) if np.isfinite(statement.probability)]
    if not lines and judged:
        least = min(judged, key=lambda row: result.statements[row].probability)
        lines.append(
            text(
                "No statement contradicts the others. The least probable is statement {number}: “{sentence}” (stated "
                "{stated}; predicted {predicted}, 95 %; probability {probability}).",
                **_facts(result, least),
            )
        )
    if unknown := [str(row + 1) for row in range(len(result.statements)) if row not in judged]:
        lines.append(
            plural(
                "Statement {numbers} cannot be judged: too few draws tell what the others predict in its place.",
                "Statements {numbers} cannot be judged: too few draws tell what the others predict in their place.",
                len(unknown),
                numbers=listed(unknown),
            )
        )
    return lines


def _facts(result: JointResult, row: int) -> dict[str, object]:
    statement = result.statements[row]
    return {
        "number": row + 1,
        "sentence": statement.sentence,
        "stated": _stated(statement),
        "predicted": _interval(statement, statement.predicted),
        "probability": joint_words.probability(statement.probability),
    }


def _decisive(result: JointResult) -> list[str]:
    sentences = []
    if result.experiments and not result.decided:
        best = result.experiments[0]
        sentences.append(
            text(
                "The next measurement to make: {name}. It decides between one joint and two in {share} % of cases.",
                name=_measurement(best.name),
                share=f"{100 * best.separates:.0f}",
            )
        )
    if result.law_experiments and any(one.verdict == "cannot be told apart" for one in result.laws):
        law_test = result.law_experiments[0]
        sentences.append(
            text(
                "To tell the laws {laws} apart: {name}. It decides in {share} % of cases.",
                laws=listed(list(law_test.laws)),
                name=_measurement(law_test.name),
                share=f"{100 * law_test.separates:.0f}",
            )
        )
    return sentences


def _statements(result: JointResult, book: Book) -> list[Block]:
    if not result.statements:
        return []
    blocks: list[Block] = [
        _statement_table(result, book),
        book.picture(
            partial(show.joint_statements, result),
            text("Each statement against the 95 % interval that all others predict in its place."),
            text(
                "Statements against what all others predict. Blue: predicted 95 % interval, scaled to -1 to 1. Dot "
                "with bar: a stated number with 95 % of its standard deviation; line between ticks: stated limits, "
                "with an arrow where it goes on. Red: does not hold together with the others. Numbers of the rows as "
                "in the table."
            ),
        ),
    ]
    if result.hammer is not None:
        blocks.append(
            book.picture(
                partial(show.hammer_readings, result),
                text("Frequency and damping that hammer tests read over the normal force, with the stated numbers."),
                text(
                    "What a hammer test reads over the normal force: median and 95 % band of the posterior of one "
                    "joint, all statements together and without the standard deviation of a reading; dots: stated "
                    "numbers with 95 % bars."
                ),
            )
        )
    return blocks


def _statement_table(result: JointResult, book: Book) -> Table:
    """Sentence, quantity, what is stated and what is predicted side by side; the file beside it has all numbers."""
    rows: list[tuple[Cell, ...]] = []
    for number, one in enumerate(result.statements, 1):
        shown = joint_words.quantity(one.quantity)
        known = np.isfinite(one.probability)
        rows.append(
            (
                number,
                text("“{sentence}”", sentence=one.sentence),
                shown.name,
                _stated(one),
                _interval(one, one.predicted) if known else MISSING,
                Value(one.probability, joint_words.probability(one.probability) if known else MISSING),
                word(one.verdict),
                _interval(one, one.together),
                *(plain(x, 6) for x in (one.value, *one.limits, one.std, *one.predicted, *one.together)),
            )
        )
    columns = (
        text("No."),
        text("Statement"),
        text("Quantity"),
        text("Stated"),
        text("Predicted by all others (95 %)"),
        text("Probability"),
        text("Verdict"),
        text("By all together (95 %)"),
        *(text("value (SI)"), text("lower limit (SI)"), text("upper limit (SI)"), text("standard deviation")),
        *(text("predicted from (SI)"), text("predicted to (SI)")),
        *(text("together from (SI)"), text("together to (SI)")),
    )
    caption = text(
        "Every statement beside what all others predict in its place. Probability: of a number, that one at least as "
        "far from the prediction is read; of a sentence, that it is true. Below 0.05 it does not hold together with "
        "the others. “Not known”: too few draws tell the prediction, as this statement says what no other does, or "
        "contradicts the model. The last column is what the posterior says of the quantity, this statement included."
    )
    return book.table("statements", caption, columns, rows, shown=8)


def _stated(statement: JointStatement) -> str:
    """``509.0 ± 1.0 Hz``, or the limits, with the standard deviation."""
    shown = joint_words.quantity(statement.quantity)

    def number(value: float) -> str:
        return f"{shown.factor * value:.6g}"

    spread = (
        text("std {std} %", std=f"{100 * statement.std:g}")
        if statement.relative
        else text("std {std}", std=joint_words.with_unit(f"{shown.factor * statement.std:.3g}", shown.unit))
    )
    low, high = statement.limits
    if statement.is_number:
        stated = number(statement.value)
    elif not np.isfinite(low):
        stated = text("at most {high}", high=number(high))
    elif not np.isfinite(high):
        stated = text("at least {low}", low=number(low))
    else:
        stated = text("{low} to {high}", low=number(low), high=number(high))
    return f"{joint_words.with_unit(stated, shown.unit)}, {spread}"


def _interval(statement: JointStatement, ends: tuple[float, float]) -> str:
    """An interval in the unit shown: to the second digit of the standard deviation, forces by their own size."""
    shown = joint_words.quantity(statement.quantity)
    if statement.relative:
        return shown.interval(ends)
    low, high = (rounded(shown.factor * end, shown.factor * statement.std) for end in ends)
    return joint_words.with_unit(text("{low} to {high}", low=low, high=high), shown.unit)


def _parameters(result: JointResult, book: Book) -> list[Block]:
    own = [parameter for parameter in result.parameters if not parameter.combination]
    combined = [parameter for parameter in result.parameters if parameter.combination]
    blocks: list[Block] = []
    for name, caption, rows in (
        (
            "parameters",
            text(
                "Parameters before and after: 95 % range of the prior, 95 % interval, and the width of the interval "
                "over that of the prior, of logarithms except where the prior is even. Determined: at most 0.5, with "
                "what independent runs differ by on top."
            ),
            own,
        ),
        ("combinations", text("Combinations that a test says more of than of their parts, likewise."), combined),
    ):
        if rows:
            blocks.append(book.table(name, caption, _columns(), [_parameter(one) for one in rows], shown=6))
    picture = book.picture(
        partial(show.joint_parameters, result),
        text("95 % interval of every parameter within its prior range."),
        text(
            "Prior (grey, 95 %) and posterior (blue, 95 %; filled where determined) of every parameter, each on its "
            "own axis from end to end of the prior, logarithmic except where the prior is even."
        ),
    )
    if result.lift_off is not None:
        blocks.append(_limit_table(result, result.lift_off, book))
    return [*blocks, picture] if blocks else []


def _limit_table(result: JointResult, known: JointLimit, book: Book) -> Table:
    """What follows where the contact cannot pull."""
    rows: list[tuple[Cell, ...]] = []
    for name, ends, digits, unit in (
        (text("Normal force below which the beam leaves the structure, at the highest level"), known.force, 2, "N"),
        (text("Frequency at the lowest normal force of the test, at its highest level"), known.lowest, 4, "Hz"),
        (text("Frequency as the normal force goes to zero"), known.limit, 4, "Hz"),
    ):
        if np.isfinite(ends[0]):
            rows.append((name, *(plain(end, digits) for end in ends), unit))
    chance = Value(known.reached, joint_words.probability(known.reached))
    rows += [
        (text("Frequency without the beam"), f"{result.bare[0]:g}", MISSING, "Hz"),
        (text("Probability that it is reached, within 0.2 %"), chance, MISSING, ""),
    ]
    caption = text(
        "Low normal forces, 95 % intervals: a contact that cannot pull, and where the frequency goes. That it reaches "
        "the frequency without the beam is a result and was not assumed."
    )
    return book.table("low_normal_forces", caption, (text("What"), text("from"), text("to"), text("Unit")), rows)


def _columns() -> tuple[str, ...]:
    return (
        text("Parameter"),
        text("Meaning"),
        text("Prior (95 %)"),
        text("95 % interval"),
        text("Width over prior"),
        text("Determined"),
        *(text("prior from (SI)"), text("prior to (SI)"), text("from (SI)"), text("to (SI)")),
    )


def _parameter(one: JointParameter) -> tuple[Cell, ...]:
    shown = joint_words.parameter(one.name)
    return (
        shown.name,
        shown.meaning,
        shown.interval(one.prior),
        shown.interval(one.interval),
        fixed(one.narrowing, 2),
        text("yes") if one.determined else text("no"),
        *(plain(x, 6) for x in (*one.prior, *one.interval)),
    )


def _hypotheses(result: JointResult, book: Book) -> list[Block]:
    blocks: list[Block] = []
    if result.weight is not None:
        caption = text("Weight of one joint for both tests, one half beforehand, against a joint for each test.")
        one = result.weight
        two = JointHypothesis("two joints", 1 - one.weight, 1 - one.high, 1 - one.low)
        blocks.append(_weights(book, "joints", caption, [one, two]))
    if result.laws:
        caption = text(
            "Weights of the friction laws, alike beforehand, over one joint and two. They rest on the priors of the "
            "parameters as well: a joint that is unusual for its law may be taken for one of another."
        )
        blocks.append(_weights(book, "laws", caption, result.laws))
    if result.law_experiments:
        blocks.append(_law_experiments(result, book))
    if result.experiments:
        rows: list[tuple[Cell, ...]] = [
            (
                _measurement(one.name),
                *(joint_words.Shown("").interval(ends) for ends in (one.one, one.two)),
                text("{share} %", share=f"{100 * one.separates:.0f}"),
                *(plain(x, 6) for x in (*one.one, *one.two, one.separates)),
            )
            for one in result.experiments
        ]
        columns = (
            text("Measurement"),
            text("With one joint (95 %)"),
            text("With two joints (95 %)"),
            text("Decides in"),
            *(text("one joint from"), text("one joint to"), text("two joints from"), text("two joints to")),
            text("share"),
        )
        caption = text(
            "Measurements that could tell one joint from two: what they would read, and the share of outcomes after "
            "which the right one has a weight of 0.95 or more."
        )
        blocks.append(book.table("experiments", caption, columns, rows, shown=4))
    return blocks


def _law_experiments(result: JointResult, book: Book) -> Table:
    """What measurements would read by law; the laws side by side in one row for each measurement and law."""
    rows: list[tuple[Cell, ...]] = [
        (
            _measurement(one.name),
            law,
            joint_words.Shown("").interval(ends),
            text("{share} %", share=f"{100 * one.separates:.0f}"),
            *(plain(x, 6) for x in (*ends, one.separates)),
        )
        for one in result.law_experiments
        for law, ends in zip(one.laws, one.outcomes, strict=True)
    ]
    columns = (
        text("Measurement"),
        text("Law"),
        text("Reads (95 %)"),
        text("Decides in"),
        *(text("from"), text("to"), text("share")),
    )
    caption = text(
        "Measurements that could tell the laws apart: what they would read by the laws that explain the statements, "
        "and the share of outcomes after which the right law has a weight of 0.95 or more."
    )
    return book.table("law_experiments", caption, columns, rows, shown=4)


def _measurement(name: str) -> str:
    """What is measured, and in brackets what is read of it."""
    head, _, reading = recognised(name).partition(": ")
    return f"{head} ({reading})" if reading else head


def _share(weight: float) -> str:
    """A weight in percent; no run of a sampler says that it is nothing or all."""
    percent = round(100 * weight)
    return "< 1 %" if percent < 1 else "> 99 %" if percent > 99 else f"{percent} %"


def _weights(book: Book, name: str, caption: str, hypotheses: Sequence[JointHypothesis]) -> Table:
    rows: list[tuple[Cell, ...]] = [
        (
            word(one.name),
            *(Value(x, _share(x)) for x in (one.weight, one.low, one.high)),
            word(one.verdict),
        )
        for one in hypotheses
    ]
    columns = (
        text("Hypothesis"),
        text("Weight"),
        text("from (95 % of runs)"),
        text("to (95 % of runs)"),
        text("Verdict"),
    )
    return book.table(name, caption, columns, rows)


def _assumptions() -> list[str]:
    return [
        text(
            "The joint is a friction law on every mode alone (Masing; Iwan 1966, with evenly spread yield forces; Dahl "
            "1976), whose stiffness grows with a power of the normal force and which is in series with the beam. Where "
            "lift-off is assumed, the contact cannot pull in the shaker test."
        ),
        text(
            "A hammer test reads one exponential fitted to the decays of all points, a "
            "shaker test the steady state at resonance. Every number and every sentence is one likelihood with the "
            "standard deviation that the file gives; the draws follow the prior to the posterior through powers of the "
            "likelihood."
        ),
        text(
            "What modes cannot show alone, it cannot explain: a beam that slides as an absorber, with two peaks, is "
            "outside. Standard deviations of the file have to hold what the model gets wrong; a "
            "verdict is no better than they are. A statement that holds agrees with the others under this model: that "
            "it is true does not follow."
        ),
    ]
