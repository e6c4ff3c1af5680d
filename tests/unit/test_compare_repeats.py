"""Variance components of known truth, and differences that only repeats can call significant."""

from dataclasses import replace

import numpy as np
import pytest

from ema import compare
from ema.compare.components import least_half_of_difference
from ema.compare.scatter import difference_sentences
from ema.data import Condition, Excitation, JointForce, ModalModel, Run, RunResult, poles_from
from ema.data.repeats import NOISE_ONLY
from ema.dof import Dof
from ema.errors import InputError
from ema.synthesis import frfs as synthesis

DOFS = tuple(Dof(node, "+Z") for node in range(1, 7))
DRAWS = 6000
MARGIN = 3 * np.sqrt(0.05 * 0.95 / DRAWS)
"""Three standard deviations of a share of 95 % over the draws."""


def condition(force: float | None, sequence: str = "unstated") -> Condition:
    joints = () if force is None else (JointForce("J1", force, sequence=sequence),)
    return Condition(Excitation("hammer"), joints)


def model(frequencies, damping, force: float | None = None, name: str = "", std=(0.01, 1e-5)) -> ModalModel:
    """Modes with sine shapes on six DOFs, and what their fit says of its noise."""
    poles = poles_from(np.array(frequencies, float), np.array(damping, float))
    shapes = np.sin(np.outer(np.arange(1, 7), np.arange(1, len(poles) + 1)) * np.pi / 7) + 0j
    covariance = np.tile(np.diag(np.square(std)), (len(poles), 1, 1))
    return ModalModel(
        poles,
        shapes,
        DOFS,
        shapes[:1] / (2j * poles.imag),
        DOFS[:1],
        scaling="unit modal mass",
        covariance=covariance,
        condition=condition(force),
        name=name,
    )


def result(found: ModalModel, run: str, repeat: str = "", assembly: str = "") -> RunResult:
    frfs = synthesis(found, np.linspace(50.0, 400.0, 20))
    return RunResult(Run(run, found.condition, repeat=repeat, assembly=assembly), frfs, None, found)


def seeded() -> tuple[np.random.Generator, int]:
    """A fixed seed: three standard deviations are exceeded by chance once in 370 fresh draws."""
    return np.random.default_rng(20261123), 20261123


@pytest.mark.parametrize("count", [2, 3, 4, 5])
@pytest.mark.parametrize("between", [0.0, 1.0, 10.0])
def test_the_interval_of_the_mean_holds_the_truth(count: int, between: float):
    rng, seed = seeded()
    stds = np.tile(np.array([1.0, 0.5, 2.0, 1.0, 1.5])[:count, None], DRAWS)
    values = 7.0 + stds * rng.normal(size=stds.shape) + between * rng.normal(size=stds.shape)
    found = compare.variance_components(values, stds)
    inside = np.mean(np.abs(found.mean - 7.0) <= found.half)
    # never narrower than the noise, so it holds more than it must where the noise is all there is
    assert inside >= 0.95 - MARGIN, f"seed {seed}"
    if between == 10.0:
        assert inside <= 0.95 + MARGIN + 0.005, f"seed {seed}"
    assert found.noise == pytest.approx(np.sqrt(np.mean(stds**2, axis=0)))


@pytest.mark.parametrize("count", [2, 3, 5])
@pytest.mark.parametrize("between", [0.7, 5.0])
def test_the_scatter_between_assemblies_is_found_with_its_interval(count: int, between: float):
    rng, seed = seeded()
    noise = rng.normal(size=(count, DRAWS))
    found = compare.variance_components(noise + between * rng.normal(size=noise.shape), np.ones(noise.shape))
    low, high = found.between_interval.T
    assert np.mean((low <= between) & (between <= high)) == pytest.approx(0.95, abs=MARGIN), f"seed {seed}"
    if between == 5.0:  # far from zero, where nothing is cut off, the moment estimator of the variance has no bias
        spread = np.sqrt(2 / (count - 1)) * (1 + between**2)
        assert np.mean(found.between**2) == pytest.approx(between**2, abs=4 * spread / np.sqrt(DRAWS) + 0.1), (
            f"seed {seed}"
        )


def test_takes_of_one_assembly_are_no_repeats():
    rng, seed = seeded()
    assemblies = ("A", "A", "A", "B", "B", "C")
    own = 3.0 * rng.normal(size=(3, DRAWS))[[0, 0, 0, 1, 1, 2]]
    values = own + 1.0 * rng.normal(size=own.shape)
    found = compare.variance_components(values, np.full(own.shape, 0.2), assemblies)
    assert set(found.assemblies) == {3}
    assert np.mean(np.abs(found.mean) <= found.half) == pytest.approx(0.95, abs=MARGIN + 0.01), f"seed {seed}"
    assert np.mean(found.takes**2) == pytest.approx(1.0, abs=0.1), f"seed {seed}"
    assert np.median(found.noise) == pytest.approx(0.2)
    blind = compare.variance_components(values, np.full(own.shape, 0.2))
    assert np.mean(np.abs(blind.mean) <= blind.half) < 0.85, "six takes of three assemblies are not six assemblies"


@pytest.mark.parametrize("counts", [(2, 2), (2, 5), (3, 3), (5, 4)])
@pytest.mark.parametrize("ratio", [0.1, 1.0, 8.0])
def test_equal_conditions_are_called_different_in_at_most_one_of_twenty(counts: tuple[int, int], ratio: float):
    rng, seed = seeded()
    first, second = (
        compare.variance_components(scale * rng.normal(size=(count, DRAWS)), np.full((count, DRAWS), 1e-3))
        for count, scale in zip(counts, (1.0, ratio), strict=True)
    )
    half, noise = components_half(first, second)
    assert np.mean(np.abs(first.mean - second.mean) > half) <= 0.05 + MARGIN + 0.004, f"seed {seed}"
    assert np.mean(np.abs(first.mean - second.mean) > noise) > 0.9, (
        "intervals from noise alone call nearly all different"
    )


def components_half(first, second):
    from ema.compare.components import half_of_difference

    return half_of_difference(first, second, tuple((mode, mode) for mode in range(DRAWS)))


def test_a_change_beyond_the_scatter_is_significant_and_one_within_is_not():
    bare = [model([100, 210, 330], [0.006, 0.004, 0.005 + d], name=n) for n, d in (("a", 0), ("b", 4e-4), ("c", -3e-4))]
    beam = [
        model([100 * s, 212 * s, 331 * s], [0.0072, 0.0041, 0.0052 + d], 1000.0, n)
        for n, s, d in (("d", 1.0, 3e-4), ("e", 1.0005, -3e-4), ("f", 0.9995, 2e-4))
    ]
    first, second = compare.repeats(bare, "bare"), compare.repeats(beam, "1 kN")
    found = compare.difference(first, second)
    assert found.pairs == ((0, 0), (1, 1), (2, 2))
    assert list(found.words("damping")) == ["significant", "significant", "not significant"]
    assert list(found.words("frequency")) == ["not significant", "significant", "significant"]
    assert found.damping[0] == pytest.approx([0.006, 0.0072])
    assert any("damping is significantly higher in 2 of 3 modes; most clearly at 100 Hz" in s for s in found.sentences)
    assert found.table()["change of zeta"][2] == "not significant"
    table = second.table()
    # 0.5 permil of 100 Hz three times: standard deviation 0.05 Hz, less the noise of 0.01 Hz; t of two degrees is 4.30
    assert table["between f [Hz]"][1] == pytest.approx(np.sqrt(0.05**2 - 0.01**2), rel=1e-6)
    assert table["+- f [Hz]"][1] == pytest.approx(4.302653 * 0.05 / np.sqrt(3), rel=1e-6)


def test_without_repeats_nothing_is_significant():
    runs = [result(model([100, 210], [0.006, 0.004]), "bare"), result(model([90, 220], [0.02, 0.01], 1000.0), "beam")]
    groups, (found,) = compare.conditions(runs)
    assert [group.basis for group in groups] == ["noise only; assembly scatter unknown"] * 2
    assert not found.damping_differs.any() and not found.frequency_differs.any()
    assert found.words("damping") == ("noise only; assembly scatter unknown",) * 2
    assert found.sentences == (f"beam against bare: {NOISE_ONLY}. No change is called significant.",)
    assert np.isfinite(found.damping_noise).all()


def test_conditions_of_which_nothing_can_be_said_share_a_sentence():
    """One run each of four conditions: one sentence; what is known of a repeated one stays its own."""
    alone = [result(model([100, 210], [0.006, 0.004]), "bare")]
    alone += [result(model([90, 220], [0.02, 0.01], 1000.0), name) for name in ("10 kN", "5 kN", "1 kN")]
    _, found = compare.conditions(alone)
    assert len(found) == 3
    assert difference_sentences(found) == [
        f"10 kN, 5 kN and 1 kN against bare: {NOISE_ONLY}. No change is called significant."
    ]
    assert difference_sentences(found[:1]) == list(found[0].sentences)
    bare = [result(model([100, 210], [0.006, 0.004 + d]), f"b{n}", "bare") for n, d in enumerate((0, 1e-5, -2e-5))]
    beam = [result(model([90, 220], [0.02 + d, 0.01], 1e3), f"r{n}", "1 kN") for n, d in enumerate((0, 1e-4, 2e-4))]
    _, found = compare.conditions([*bare, *beam, *alone[1:3]])
    known, *rest = found
    assert known.known.any() and not any(one.known.any() for one in rest)
    assert difference_sentences(found) == [
        *known.sentences,
        f"10 kN and 5 kN against bare: {NOISE_ONLY}. No change is called significant.",
    ]


def test_repeats_of_one_condition_alone_are_not_enough():
    beams = [result(model([90, 220], [0.02 + d, 0.01], 1000.0), f"b{n}", "1 kN") for n, d in enumerate((0, 1e-4, 2e-4))]
    _, (found,) = compare.conditions([result(model([100, 210], [0.006, 0.004]), "bare"), *beams])
    assert found.words("damping") == (NOISE_ONLY,) * 2 and not found.damping_differs.any()


def veering(turn: float, name: str, repeat: float = 0.0) -> ModalModel:
    """Three modes; a stiffer joint turns the shapes of the first two into each other."""
    one = model([100 + repeat, 110 + repeat, 330], [0.006, 0.004, 0.005], 1e3 if name else None, name)
    orthogonal = np.linalg.qr(one.shapes.real)[0]
    c, s = np.cos(turn), np.sin(turn)
    return replace(one, shapes=orthogonal @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) + 0j)


def test_modes_whose_partner_is_not_certain_are_named_and_no_change_of_theirs():
    """Turned by 42 degrees, the MAC of the two with each of two others is 0.55 and 0.45."""
    bare = [veering(0.0, "", repeat) for repeat in (0.0, 0.02, 0.05)]
    beam = [veering(np.deg2rad(42), f"b{n}", repeat) for n, repeat in enumerate((3.0, 3.02, 3.05))]
    found = compare.difference(compare.repeats(bare, "bare", ["a", "b", "c"]), compare.repeats(beam, "1 kN"))
    assert found.pairs == ((2, 2),)
    named = [sentence for sentence in found.sentences if "resembles" in sentence]
    assert named == [
        "Mode 1 (100 Hz) resembles modes 1 and 2 of 1 kN: not counted.",
        "Mode 2 (110 Hz) resembles modes 1 and 2 of 1 kN: not counted.",
    ]


def test_where_no_partner_is_certain_the_sentence_says_so():
    bare, beam = replace_modes(veering(0.0, ""), 2), replace_modes(veering(np.deg2rad(42), "b0"), 2)
    found = compare.difference(compare.repeats([bare], "bare"), compare.repeats([beam], "1 kN"))
    assert found.pairs == () and found.sentences == ("1 kN against bare: no certain pair of modes.",)


def replace_modes(one: ModalModel, count: int) -> ModalModel:
    """The first modes alone."""
    return replace(
        one,
        poles=one.poles[:count],
        shapes=one.shapes[:, :count],
        participation=one.participation[:, :count],
        covariance=one.covariance[:count],
    )


def test_the_change_to_a_repeated_condition_is_as_uncertain_as_its_mean():
    """Of a bare structure measured once and a beam mounted three times: noise alone gives ± 0.02 Hz for the change to a
    mean that is known to ± 0.25 Hz."""
    bare = compare.repeats([model([100, 210], [0.006, 0.004])], "bare")
    shifts = (-0.1, 0.0, 0.1)
    beam = compare.repeats([model([102 + d, 214 + d], [0.006, 0.004], 1e3, f"b{n}") for n, d in enumerate(shifts)])
    half = least_half_of_difference(bare.frequency, beam.frequency, ((0, 0), (1, 1)))
    # t of two degrees of freedom is 4.303; the noise of the bare structure is 0.01 Hz
    assert half == pytest.approx(np.hypot(4.302653 * 0.1 / np.sqrt(3), 1.959964 * 0.01), rel=1e-6)
    # the other way round, and with repeats of neither
    assert half == pytest.approx(least_half_of_difference(beam.frequency, bare.frequency, ((0, 0), (1, 1))))
    alone = least_half_of_difference(bare.frequency, bare.frequency, ((0, 0),))
    assert alone == pytest.approx(np.sqrt(2) * 1.959964 * 0.01)


def test_two_takes_of_one_assembly_are_not_enough():
    runs = [result(model([100], [0.006]), "bare")]
    runs += [result(model([100], [0.01], 1e3), n, "1 kN", "first") for n in ("b1", "b2")]
    groups, (found,) = compare.conditions(runs)
    assert groups[1].basis == NOISE_ONLY and found.words("frequency") == (NOISE_ONLY,)
    (finding,) = compare.repeat_findings([one.run for one in runs])
    assert finding.code == "repeat-alone" and "takes of one assembly" in finding.message


def test_a_group_with_one_run_is_a_finding():
    (finding,) = compare.repeat_findings([Run("b1", condition(1e3), repeat="1 kN"), Run("bare", condition(None))])
    assert finding.code == "repeat-alone"
    assert "only b1 has this label; noise only; assembly scatter unknown" in finding.message


def test_modes_that_do_not_pair_are_findings_and_rest_on_fewer_repeats():
    whole = [model([100, 210, 330], [0.006, 0.004, 0.005], 1e3, name) for name in ("a", "b")]
    fewer = model([100, 210], [0.006, 0.004], 1e3, "c")
    moved = model([100, 210, 390], [0.006, 0.004, 0.005], 1e3, "d")
    group = compare.repeats([fewer, *whole, moved], "1 kN")
    assert list(group.frequency.assemblies) == [4, 4, 2]
    assert group.places.tolist() == [[0, 1, -1], [0, 1, 2], [0, 1, 2], [0, 1, -1]]
    told = [str(finding) for finding in group.findings]
    assert {finding.code for finding in group.findings} == {"repeat-mode-unpaired"}
    assert len(told) == 3 and "The mode of d at 390 Hz has no partner in a." in told[2]


def test_where_shapes_cannot_tell_modes_apart_the_frequencies_do():
    def single(frequencies, name):
        one = model(frequencies, [0.006, 0.004, 0.005], 1e3, name)
        return replace(one, dofs=DOFS[:1], shapes=one.shapes[:1])

    group = compare.repeats([single([100, 102, 330], "a"), single([100.4, 102.4, 331], "b")], "1 kN")
    assert group.places.tolist() == [[0, 1, 2], [0, 1, 2]]


@pytest.mark.parametrize(
    ("forces", "code", "words"),
    [
        ((1000.0, 1180.0), "repeat-forces-differ", "spreads over 17% of its mean (b0 1000 N, b1 1180 N)"),
        ((1000.0, 2000.0), "repeat-conditions-differ", "too far apart to be one condition"),
        ((1000.0, None), "repeat-conditions-differ", "with and without a beam"),
    ],
)
def test_runs_of_a_group_under_other_conditions(forces, code, words):
    results = [
        result(model([100, 210], [0.006, 0.004], force), f"b{number}", "1 kN") for number, force in enumerate(forces)
    ]
    (finding,) = compare.repeat_findings([one.run for one in results])
    assert finding.code == code and words in finding.message
    groups, _ = compare.conditions(results)
    assert len(groups) == (1 if code == "repeat-forces-differ" else 2), "what is no condition is not taken as one"
    if code == "repeat-conditions-differ":
        with pytest.raises(InputError, match=words):
            compare.repeats([one.modes for one in results], "1 kN")


def test_other_excitation_within_a_group_is_a_finding():
    shaken = Run("b1", replace(condition(1e3), excitation=Excitation("random")), repeat="1 kN")
    (finding,) = compare.repeat_findings([Run("b0", condition(1e3), repeat="1 kN"), shaken])
    assert finding.code == "repeat-kinds-differ" and "hammer, random" in finding.message


def test_bad_input_is_refused_with_a_sentence():
    one = model([100], [0.006])
    with pytest.raises(InputError, match="do not fit each other"):
        compare.repeats([])
    with pytest.raises(InputError, match="do not fit each other"):
        compare.repeats([one, one], names=["a"])
    with pytest.raises(InputError, match="no DOF in common"):
        compare.repeats([one, replace(one, dofs=tuple(Dof(d.node + 50, "+Z") for d in DOFS))])
    with pytest.raises(InputError, match="do not fit each other"):
        compare.variance_components(np.zeros((2, 3)), np.zeros((2, 3)), ("a",))


def test_unknown_noise_and_missing_modes_are_told_as_unknown():
    found = compare.variance_components(np.array([[1.0, np.nan, 3.0], [1.2, np.nan, np.nan]]), np.full((2, 3), np.nan))
    assert list(found.assemblies) == [2, 0, 1]
    assert found.half[0] == pytest.approx(12.7062 * 0.1, rel=1e-4)
    assert np.isnan(found.half[1:]).all() and np.isnan(found.mean[1]) and found.mean[2] == 3.0


def test_conditions_survive_the_store(tmp_path):
    from ema import store
    from ema.data import Campaign, StudyResult

    runs = tuple(result(model([100, 210], [0.006 + d, 0.004], 1e3), n, "1 kN") for n, d in (("a", 0), ("b", 1e-4)))
    groups, differences = compare.conditions([result(model([101, 212], [0.005, 0.004]), "bare"), *runs])
    store.save(tmp_path / "r.h5", StudyResult(Campaign("c", ()), runs, conditions=groups, differences=differences))
    held = store.load(tmp_path / "r.h5")
    assert held.conditions[1].label == "1 kN" and held.conditions[1].places.tolist() == [[0, 1], [0, 1]]
    assert np.array_equal(held.conditions[1].damping.half, groups[1].damping.half)
    assert held.differences[0].sentences == differences[0].sentences
