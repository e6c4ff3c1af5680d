"""The report on a joint: what the first screen says stands in a table, and the tables hold what the posterior says."""

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.container import ErrorbarContainer

import ema.report
from ema import show
from ema.compare.joint_experiments import JOINTS, of_laws
from ema.compare.joint_law import Datum, Experiment, Held, JointAssessment, JointModel, Posterior
from ema.compare.joint_result import joint_result
from ema.compare.joint_statements import JointFile
from ema.messages import speaking
from ema.messages.recognition import recognised
from ema.report.joint import answers
from ema.show import joint_result as joint_result_data
from ema.show import joint_words
from ema.show.joint_result import JointHypothesis, JointResult, JointStatement
from tests.unit.report_page import Page, blank

NUMBER = r"(?<![A-Za-z_\d.])\d+(?:\.\d+)?"
FILE = JointFile.model_validate(
    {
        "title": "table",
        "bare": {"frequency": "499 Hz", "damping": "0.6 %"},
        "levels": ["6 N", "30 N"],
        "normal_forces": ["5 N", "100 N", "1 kN"],
        "prior": {"friction_coefficient": [0.1, 0.4], "peak_force": ["990 N", "1010 N"]},
        "hammer": [{"sentence": "509 Hz", "normal_force": "10 kN", "frequency": "509 Hz"}],
        "shaker": [{"sentence": "most", "quantity": "ridge", "level": "30 N", "low": 25, "high": 200, "std": 0.25}],
    }
)


def assessment(weights: tuple[float, float] = (0.0, 0.2)) -> JointAssessment:
    """Draws of the prior in place of a posterior: two runs of 200, and verdicts that are known."""
    rng = np.random.default_rng(3)
    posteriors = []
    for two, evidence in zip((False, True), weights, strict=True):
        model = JointModel(FILE, two=two)
        draws = rng.standard_normal((400, len(model.parameters)))
        posteriors.append(Posterior(model, draws, evidence + np.array([-0.1, 0.1]), 0.3))
    held = (
        Held(posteriors[0].model.data[0], 520.0, 530.0, 0.01),
        Held(posteriors[0].model.data[1], float("nan"), float("nan"), float("nan")),
    )
    return JointAssessment(
        posteriors[0], posteriors[1], held, (Experiment("loops: ln", (-0.1, 0.1), (-1.0, 1.0), 0.4),)
    )


def page(result: JointResult, folder: Path, language: str = "en") -> Page:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("ema.report.pictures.drawn", blank)
        return Page(ema.report.write(result, folder / "joint.html", language=language))


def results() -> dict[str, JointResult]:
    example = joint_result_data.example()
    return {"example": example, "draws": joint_result(FILE, assessment())}


@pytest.mark.parametrize("name", sorted(results()))
def test_every_number_of_the_first_screen_stands_in_a_table(tmp_path: Path, name: str) -> None:
    shown = page(results()[name], tmp_path)
    cells = {number for table in shown.tables for row in table for cell in row for number in re.findall(NUMBER, cell)}
    front = shown.source.split('id="answer"')[1].split("</section>")[0]
    lines = [line for line in re.findall(r"<li>(.*?)</li>", front) if not line.startswith("Findings")]
    said = {number for line in lines for number in re.findall(NUMBER, line)}
    assert len(said) > 8 and said - cells == set()


def test_each_verdict_stands_beside_its_sentence_the_stated_and_the_predicted_number(tmp_path: Path) -> None:
    rows = {row[0]: row for table in page(joint_result_data.example(), tmp_path).tables[:1] for row in table[1:]}
    expected = {
        "1": [
            "“10 kN: 509 Hz”",
            "hammer, F_N 10 kN: frequency",
            "509 Hz, std 1 Hz",
            "506.3 to 511.2 Hz",
            "0.81",
            "holds",
        ],
        "3": [
            "“most at 25 to 200 N”",
            "shaker, F_E 30 N: normal force at which damping is highest",
            "25 to 200 N, std 25 %",
        ],
        "4": [
            "“it remains low”",
            "shaker, F_N 25 N: highest damping ratio over the excitation",
            "at most 0.8 %, std 0.05 %",
            "1.210 to 1.840 %",
            "0.004",
            "does not hold together with the others",
        ],
    }
    for number, cells in expected.items():
        assert [cell.replace("\u00a0", " ") for cell in rows[number][1 : 1 + len(cells)]] == cells
    assert rows["2"][4:7] == ["–", "–", "not known"]


def test_the_tables_beside_the_report_hold_the_numbers_in_full(tmp_path: Path) -> None:
    result = joint_result(FILE, assessment())
    page(result, tmp_path)
    with (tmp_path / "joint_tables" / "parameters.csv").open(encoding="utf-8") as file:
        rows = {row["Parameter"]: row for row in csv.DictReader(file)}
    for parameter in result.parameters:
        if not parameter.combination:
            row = rows[joint_words.parameter(parameter.name).name]
            found = [float(row[name]) for name in ("prior from (SI)", "prior to (SI)", "from (SI)", "to (SI)")]
            assert found == pytest.approx([*parameter.prior, *parameter.interval], rel=1e-12)
    assert float(rows["friction coefficient"]["prior from (SI)"]) == pytest.approx(0.1, rel=1e-4)
    assert float(rows["exponent of k_T"]["prior to (SI)"]) == pytest.approx(0.975, rel=1e-4)


def test_a_result_says_what_the_posterior_says() -> None:
    found = assessment()
    result = joint_result(FILE, found)
    assert [one.name for one in result.parameters] == list(found.one.interval)
    assert [one.name for one in result.parameters if one.combination] == list(
        found.one.model.combinations(found.one.draws)
    )
    # draws of the prior leave every width as it was
    assert all(0.7 < one.narrowing < 1.3 and not one.determined for one in result.parameters)
    first, second = result.statements
    assert first.contradicts and first.is_number and first.value == 509.0 and first.predicted == (520.0, 530.0)
    assert not second.is_number and second.limits == pytest.approx((25.0, 200.0)) and second.relative
    assert second.together[0] > 1.0, "a force, not its logarithm"
    assert [one.code for one in result.findings] == ["statement-contradicts", "statement-not-judged"]
    assert result.findings[0].where == "statement 1: hammer, 10000 N: frequency [Hz]"
    # odds of the evidences: exp(0.2), the same distance between the runs
    assert result.weight is not None and result.weight.weight == pytest.approx(1 / (1 + np.exp(0.2)))
    assert not result.decided and len(result.experiments) == 1
    # the bands go through the readings of the same draws at the stated force
    assert result.hammer is not None
    at = float(np.interp(np.log(1e4), np.log(result.hammer.normal_forces), result.hammer.frequency.value))
    assert at == pytest.approx(np.median(found.one.model.readings(found.one.draws)[:, 0]), rel=2e-3)


@pytest.mark.parametrize(
    ("weights", "words"),
    [((9.0, 0.0), "Both tests had one joint"), ((0.0, 9.0), "two tests had two joints"), ((0.0, 0.0), "told apart")],
)
def test_one_joint_or_two(weights: tuple[float, float], words: str) -> None:
    result = joint_result(FILE, assessment(weights))
    lines = answers(result)
    assert any(words in line for line in lines)
    assert result.decided == (weights != (0.0, 0.0)) == (not any("next measurement" in line for line in lines))


def test_where_nothing_contradicts_the_least_probable_is_named() -> None:
    example = joint_result_data.example()
    kept = tuple(one for one in example.statements if not one.contradicts)
    lines = answers(replace(example, statements=kept))
    assert any("The least probable is statement 4: “it falls”" in line for line in lines)


def test_one_test_has_no_second_joint_and_no_experiment(tmp_path: Path) -> None:
    example = joint_result_data.example()
    lonely = replace(example, weight=None, laws=(), law_experiments=(), lift_off=None, experiments=(), hammer=None)
    assert "what would decide" in page(example, tmp_path).source
    assert "what would decide" not in page(lonely, tmp_path).source
    assert not any("joints" in line for line in answers(lonely))


def test_weights_of_laws_have_a_table(tmp_path: Path) -> None:
    laws = (JointHypothesis("masing", 0.7, 0.6, 0.8), JointHypothesis("iwan", 0.3, 0.2, 0.4))
    shown = page(replace(joint_result_data.example(), laws=laws), tmp_path)
    assert ["iwan", "30 %", "20 %", "40 %", "cannot be told apart"] in [row for table in shown.tables for row in table]


def test_no_weight_is_nothing_or_all(tmp_path: Path) -> None:
    sure = (JointHypothesis("Masing", 0.9995, 0.998, 1.0), JointHypothesis("Iwan", 0.0005, 0.0, 0.0125))
    rows = [row for table in page(replace(joint_result_data.example(), laws=sure), tmp_path).tables for row in table]
    assert ["Masing", "> 99 %", "> 99 %", "> 99 %", "the others are excluded"] in rows
    assert ["Iwan", "< 1 %", "< 1 %", "1 %", "excluded"] in rows


def test_laws_that_are_left_and_what_would_tell_them_apart(tmp_path: Path) -> None:
    example = joint_result_data.example()
    lines = answers(example)
    assert any("cannot be told apart, with their weights: Masing 80 % and Iwan 19 %. Excluded" in one for one in lines)
    assert any(one.startswith("To tell the laws Masing and Iwan apart: hysteresis loops") for one in lines)
    sure = replace(example, laws=(JointHypothesis("Masing", 1.0, 0.99, 1.0), JointHypothesis("Iwan", 0.0, 0.0, 0.01)))
    lines = answers(sure)
    assert any("the statements leave that of Masing. Excluded (a weight below 5 %): Iwan." in one for one in lines)
    assert not any("To tell the laws" in one for one in lines)


def test_the_frequency_at_no_normal_force_is_a_result(tmp_path: Path) -> None:
    example = joint_result_data.example()
    (line,) = (one for one in answers(example) if one.startswith("As the normal force goes to zero"))
    assert "484.0 to 498.7 Hz" in line and "499 Hz" in line
    rows = [row for table in page(example, tmp_path).tables for row in table]
    assert ["Frequency as the normal force goes to zero", "484.0", "498.7", "Hz"] in rows
    unknown = replace(example, lift_off=replace(example.lift_off, force=(float("nan"),) * 2))
    rows = [row for table in page(unknown, tmp_path).tables for row in table]
    assert not any("leaves the structure" in cell for row in rows for cell in row)


def test_parameters_of_a_further_mode_have_their_words() -> None:
    shown = joint_words.parameter("drop by the mass, shaker, mode 3")
    assert (shown.name, shown.unit) == ("drop by the mass, shaker, mode 3", "%") and shown.meaning
    assert joint_words.parameter("lift-off force over excitation, shaker").meaning
    assert joint_words.quantity("shaker, mode 3, stuck frequency").name.startswith("shaker, mode 3: frequency")


def test_names_that_nobody_knows_yet_are_shown_as_they_are() -> None:
    assert joint_words.parameter("gap at rest, shaker").name == "gap at rest, shaker"
    shown = joint_words.quantity("hammer, mode 2, 10000 N: depth").name
    assert shown.replace("\u00a0", " ") == "hammer, mode 2, F_N 10 kN: depth"


@pytest.mark.parametrize(
    ("name", "ends", "shown"),
    [
        ("friction coefficient", (0.0568, 0.2541), "0.057 to 0.25"),
        ("peak force", (989.9, 1010.2), "990 to 1010 N"),
        ("peak force over friction coefficient", (7912.0, 45871.0), "7900 to 46000 N"),
        ("drop by the mass, shaker", (0.01031, 0.0336), "1.0 to 3.4 %"),
        ("exponent of k_T", (0.0, 0.84), "0.00 to 0.84"),
    ],
)
def test_an_interval_has_two_digits_of_its_ends_and_of_its_width(name, ends, shown) -> None:
    assert joint_words.parameter(name).interval(ends).replace("\u00a0", " ") == shown


def statement(value: float, predicted: tuple[float, float], **fields: object) -> JointResult:
    limits = (-np.inf, np.inf)
    given = {"probability": 0.5, "verdict": "holds", "together": predicted} | fields
    one = JointStatement("s", "hammer, 1000 N: frequency [Hz]", value, limits, 1.0, predicted, **given)  # type: ignore[arg-type]
    return replace(joint_result_data.example(), statements=(one,))


def dot(result: JointResult) -> float:
    """Where the dot of the only statement stands."""
    (bar,) = (one for one in show.joint_statements(result).axes[0].containers if isinstance(one, ErrorbarContainer))
    return float(bar.lines[0].get_xdata()[0])  # type: ignore[union-attr]


def test_a_stated_number_at_the_end_of_the_prediction_stands_at_its_end() -> None:
    assert dot(statement(510.0, (500.0, 510.0))) == pytest.approx(1.0)
    assert dot(statement(502.5, (500.0, 510.0))) == pytest.approx(-0.5)
    assert dot(statement(100.0, (10.0, 1000.0), relative=True)) == pytest.approx(0.0), "forces by their logarithm"


def test_a_number_far_off_is_an_arrow_at_the_side_where_it_lies() -> None:
    for value, marker in ((900.0, ">"), (100.0, "<")):
        axes = show.joint_statements(statement(value, (500.0, 510.0))).axes[0]
        assert marker in [line.get_marker() for line in axes.lines]


def test_german_has_the_same_numbers(tmp_path: Path) -> None:
    english = page(joint_result_data.example(), tmp_path / "en")
    german = page(joint_result_data.example(), tmp_path / "de", "de")
    numbers = [
        [re.findall(NUMBER, cell) for table in each.tables for row in table for cell in row]
        for each in (english, german)
    ]
    assert numbers[0] == numbers[1]
    with speaking("de"):
        assert answers(joint_result_data.example())[0].startswith("Bestimmt")


def test_every_measurement_on_offer_is_named_in_german() -> None:
    model = JointModel(FILE)
    with speaking("de"):
        names = {name: recognised(name) for name in (*JOINTS, *of_laws(model))}
    assert [name for name, german in names.items() if german == name] == []
    assert any("Shaker, 100 N: D" in german for german in names.values())


def test_a_datum_beyond_all_limits_is_a_sentence() -> None:
    found = replace(
        assessment(),
        held=(Held(Datum("low", "shaker, 30 N excitation, ridge", 0.2, high=np.log(50.0)), 20.0, 90.0, 0.4),),
    )
    (one,) = joint_result(FILE, found).statements
    assert one.limits == (-np.inf, pytest.approx(50.0)) and not one.is_number
