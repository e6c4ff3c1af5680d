"""The judge of the estimator judged: bounds, scores and generators against independent computations."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.stats import norm

from ema.data import ModalUncertainty
from ema.data.modal import damping_ratios, natural_frequencies
from tests.bench import disturbances, disturbances_nonlinear, disturbances_shaker, repeated_roots, set_ups, systems
from tests.bench.cases import Case, _accelerance, _case
from tests.bench.disturbed import nearest_truth, wrong
from tests.bench.scoring import cramer_rao
from tests.bench.stated import ELLIPSE, Errors, Stated, errors, mahalanobis, of_model


def tiny(outputs: int = 3, references: int = 2) -> Case:
    rng = np.random.default_rng(5)
    return _case(
        "tiny",
        5,
        0.02,
        np.linspace(20, 36, 61),
        rng,
        np.array([24.0, 31.0]),
        np.array([0.01, 0.02]),
        outputs=outputs,
        references=references,
        beyond=0.05,
        neighbours=0,
    )


def test_the_bound_with_residual_terms_is_that_of_the_jacobian_written_out() -> None:
    """Every parameter of every FRF as a column of one Jacobian, by finite differences; std from its singular values."""
    case = tiny()
    poles, shapes, rows = case.truth.poles, case.truth.shapes, case.truth.participation
    s = 2j * np.pi * case.frfs.frequencies
    sizes = [poles.shape, shapes.shape, rows.shape, (3, 2), (3, 2)]

    def response(x: np.ndarray) -> np.ndarray:
        parts, start = [], 0
        for size in sizes:
            count = int(np.prod(size))
            parts.append((x[start : start + count] + 1j * x[start + count : start + 2 * count]).reshape(size))
            start += 2 * count
        p, psi, g, lower, upper = parts
        residue = np.einsum("kr,ir->rki", psi, g)
        sums = sum(
            residue[r] / (s - p[r])[:, None, None] + residue[r].conj() / (s - p[r].conj())[:, None, None]
            for r in range(len(p))
        )
        value = (s**2)[:, None, None] * sums + lower + (s**2)[:, None, None] * 1e-5 * upper
        scaled = (value / case.noise_std).ravel() * np.sqrt(2)
        return np.concatenate([scaled.real, scaled.imag])

    zero = np.zeros((3, 2), complex)
    x = np.concatenate([f(part).ravel() for part in (poles, shapes, rows, zero, zero) for f in (np.real, np.imag)])
    sizes_of = [np.abs(poles).max() * 1e-3, np.abs(shapes).max(), np.abs(rows).max(), *[np.abs(case.clean).max()] * 2]
    scale = np.repeat(sizes_of, [2 * int(np.prod(size)) for size in sizes])
    jacobian = np.array([(response(x + 1e-5 * step) - response(x - 1e-5 * step)) / 2e-5 for step in np.diag(scale)]).T
    covariance = np.linalg.pinv(jacobian, rcond=1e-9)  # the scale between shape and participation is free
    covariance = (covariance @ covariance.T) * np.outer(scale, scale)
    for mode, pole in enumerate(poles):
        block = covariance[np.ix_([mode, 2 + mode], [mode, 2 + mode])]
        radial = np.array([pole.real, pole.imag]) / abs(pole)
        expected = np.sqrt(radial @ block @ radial) / (2 * np.pi)
        assert cramer_rao(case, residual_terms=True).frequency_std[mode] == pytest.approx(expected, rel=1e-4)
    assert np.all(cramer_rao(case, residual_terms=True).damping_std > cramer_rao(case).damping_std)


def test_an_estimator_that_states_its_errors_rightly_is_covered_at_95_percent() -> None:
    """Errors drawn from the stated covariances, no fit: coverage, ellipse and distance come out as they must."""
    case, rng = tiny(outputs=6), np.random.default_rng(3)
    inside, value, distance = [], [], []
    count = len(case.truth.poles)
    for _ in range(400):
        f, z = case.truth.natural_frequencies, case.truth.damping_ratios
        std = np.array([1e-4 * f, 1e-2 * z])
        drawn = np.array([f, z]) + std * rng.standard_normal((2, count))
        omega = 2 * np.pi * drawn[0]
        residues = np.einsum("kr,ir->rki", case.truth.shapes, case.truth.participation)
        root = np.abs(residues)[..., None, None] * np.array([[0.02, 0.0], [0.015, 0.01]])
        error = (root @ rng.standard_normal((*residues.shape, 2, 1)))[..., 0]
        model = replace(
            case.truth,
            poles=omega * (-drawn[1] + 1j * np.sqrt(1 - drawn[1] ** 2)),
            covariance=np.array([np.diag(one**2) for one in std.T]),
        )
        stated = replace(of_model(model), residue_variance=root @ root.swapaxes(-1, -2))
        # The residues of a model are products: the error is put where the score looks for it, into the truth.
        moved = _WithResidues(case, residues + error[..., 0] + 1j * error[..., 1])
        found = errors(moved, stated)
        inside.append(found.inside)
        distance.append(found.distance)
        value += [found.frequency, found.damping]
    assert np.mean(np.abs(value) < norm.ppf(0.975)) == pytest.approx(0.95, abs=0.025)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.015)
    assert np.mean(distance) == pytest.approx(1, abs=0.05)


class _WithResidues:
    """A case whose truth has the given residues."""

    def __init__(self, case: Case, residues: np.ndarray) -> None:
        self.outside = case.outside
        self.truth = _Truth(case.truth, residues)


class _Truth:
    def __init__(self, model, residues: np.ndarray) -> None:
        self.poles, self.shapes = model.poles, model.shapes
        self.natural_frequencies, self.damping_ratios = model.natural_frequencies, model.damping_ratios
        self.residues = lambda: residues


def test_the_distance_is_that_of_the_inverse_covariance() -> None:
    rng = np.random.default_rng(1)
    root = rng.standard_normal((5, 2, 2))
    covariance, error = root @ root.swapaxes(-1, -2), rng.standard_normal((5, 2))
    expected = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error)
    np.testing.assert_allclose(mahalanobis(error[:, 0] + 1j * error[:, 1], covariance), expected)
    assert np.isinf(mahalanobis(np.array([1j]), np.zeros((1, 2, 2)))).all()
    assert pytest.approx(-2 * np.log(0.05)) == ELLIPSE


def test_a_mode_without_a_stated_deviation_is_not_covered() -> None:
    case = tiny()
    found = errors(case, of_model(case.truth))
    assert np.isinf(found.frequency).all()
    assert not found.inside.any()
    columns = {"frequency": found.frequency, "damping": np.array([np.nan, 1.0]), "residues": np.array([np.nan, 1.0])}
    assert systems.coverage(columns) == {"frequency": 0.0, "damping": 0.5, "residues": 0.5}
    nothing = ModalUncertainty(
        np.zeros((4, 4)),
        np.zeros((2, 3, 2, 2)),
        np.zeros((2, 3, 0), complex),
        np.zeros((2, 2, 2, 2)),
        np.zeros((2, 3, 2, 2, 2)),
        np.zeros(2),
    )
    assert not errors(case, of_model(replace(case.truth, uncertainty=nothing))).inside.any()


def test_the_bound_of_a_share_is_that_of_clopper_and_pearson() -> None:
    assert systems.least_share(300, 300) == pytest.approx(0.05 ** (1 / 300))
    assert systems.least_share(0, 10) == 0
    assert systems.least_share(5, 10) == pytest.approx(0.2224, abs=1e-4)  # Clopper and Pearson 1934, 90 % two-sided


def test_random_systems_span_what_they_are_to_span() -> None:
    made = [systems.system(3, number, systems.SMALL) for number in range(45)]
    cases = [case for case, _ in made]
    assert {case.noise for case in cases} == set(systems.NOISES)
    assert {averages for _, averages in made} == set(systems.AVERAGES)
    assert {len(case.truth.inputs) for case in cases} == {1, 2, 3, 4}
    assert min(case.frfs.values.shape[1] for case in cases) == 3
    assert all((case.frfs.variance is None) == (averages == 1) for case, averages in made)
    assert len({case.seed for case in cases}) == len(cases)


@pytest.mark.parametrize(
    "row", [*disturbances.ROWS, *disturbances_nonlinear.ROWS, *disturbances_shaker.ROWS], ids=lambda row: row.key
)
def test_at_strength_none_the_truth_is_the_truth_and_severe_is_not(row) -> None:
    """Synthesised from the truth, the undisturbed FRFs deviate by their noise alone; severe ones deviate more."""

    def deviation(strength: float) -> tuple[float, bool]:
        drawn = row.make(np.random.default_rng([8, 1]), strength)
        case, frfs = drawn.case, drawn.case.frfs
        exact = _accelerance(case.truth, frfs.frequencies) + _accelerance(case.outside, frfs.frequencies)
        size = np.sqrt(np.mean(np.abs(exact) ** 2, axis=0))
        return float(np.sqrt(np.mean(np.abs((frfs.values - exact) / size) ** 2))), drawn.frequency is None

    none, compared = deviation(row.strengths[0])
    # Friction moves modes from inside to outside the truth; its FRFs are judged in a test of their own.
    if row.key != "friction":
        assert none < (0.03 if row in disturbances_shaker.ROWS else 0.008)
    if row.key not in ("friction", "band edge", "rigid bodies", "zero padding", "window", "overlap"):
        assert deviation(row.strengths[-1])[0] > 1.5 * none
    assert compared == (row.key not in ("friction", "amplitude dependence", "dependence, force drops"))


def test_a_truncated_record_is_that_of_its_integral() -> None:
    """Fourier integral from 0 to T of the acceleration after the impulse, by Simpson's rule, against the closed form."""
    strength, line = 0.2, 300
    drawn = disturbances.truncated(np.random.default_rng(2), strength).case
    duration = (disturbances.LINES - 1) / (disturbances.HIGH - disturbances.LOW)
    poles = np.concatenate([drawn.truth.poles, drawn.outside.poles])
    residues = np.concatenate([drawn.truth.residues(), drawn.outside.residues()])[:, 0, 0]
    s = 2j * np.pi * drawn.frfs.frequencies[line]

    t = np.linspace(duration, duration + 12 / np.min(-poles.real), 1_000_001)
    after = sum(2 * np.real(r * p**2 * np.exp(p * t)) for p, r in zip(poles, residues, strict=True))
    missing = simpson(after * np.exp(-s * t), x=t)
    full = _accelerance(drawn.truth, drawn.frfs.frequencies) + _accelerance(drawn.outside, drawn.frfs.frequencies)
    assert drawn.clean[line, 0, 0] == pytest.approx(full[line, 0, 0] - missing, rel=1e-4)
    assert np.exp(-np.min(-drawn.truth.poles.real) * duration) == pytest.approx(strength, rel=1e-6)


@pytest.mark.parametrize("amplitude", [1.001, 1.5, 3.0, 20.0])
def test_the_slider_has_the_first_harmonic_of_its_loop(amplitude: float) -> None:
    """The loop of a slider of unit stiffness and unit slip limit, stepped through two periods of a cosine."""
    t = np.linspace(0, 4 * np.pi, 40001)
    u, force = amplitude * np.cos(t), np.zeros(len(t))
    for step in range(1, len(t)):
        force[step] = np.clip(force[step - 1] + u[step] - u[step - 1], -1, 1)
    last = slice(20000, 40000)
    harmonic = 2 * np.mean(force[last] * np.exp(-1j * t[last])) / amplitude
    assert disturbances_nonlinear.jenkins(amplitude) == pytest.approx(harmonic, abs=2e-3)


def test_a_stuck_friction_structure_is_linear_and_rings_at_its_stated_poles() -> None:
    drawn = disturbances_nonlinear.friction(np.random.default_rng(4), 0.5)
    assert drawn.frequency is not None
    np.testing.assert_allclose(drawn.frequency[:, 0], drawn.frequency[:, 1])
    np.testing.assert_allclose(natural_frequencies(drawn.case.truth.poles), drawn.frequency[:, 0], rtol=1e-9)
    size = np.linalg.norm(drawn.case.clean[:, :, 0], axis=1)
    lines = drawn.case.frfs.frequencies
    for hertz in drawn.frequency[:, 0]:
        near = np.abs(lines - hertz) < 8
        assert abs(lines[near][np.argmax(size[near])] - hertz) < 1.5


@pytest.mark.parametrize("drop", [0.0, 10.0])
def test_a_softening_peak_falls_by_the_stated_share_of_its_bandwidth(drop: float) -> None:
    strength = 0.3
    for seed in range(4):
        drawn = disturbances_nonlinear.curved(np.random.default_rng(seed), strength, drop)
        assert drawn.frequency is not None
        truth = drawn.case.truth
        mode = int(np.argmax(drawn.frequency[:, 1] - drawn.frequency[:, 0]))
        width = 2 * truth.damping_ratios[mode] * truth.natural_frequencies[mode]
        fall = (drawn.frequency[mode, 1] - drawn.frequency[mode, 0]) / width
        assert fall == pytest.approx(strength, rel=0.35)


def test_the_force_of_a_shaker_drops_at_resonance_and_the_frf_does_not() -> None:
    test = disturbances_shaker.shaken(np.random.default_rng(6), shaker=10.0)
    f = np.fft.rfftfreq(disturbances_shaker.PERIOD, 1 / disturbances_shaker.RATE)
    inside = (f > 110) & (f < 490)
    exact = _accelerance(test.case.truth, f[inside]) + _accelerance(test.case.outside, f[inside])
    np.testing.assert_allclose(test.responses[inside] / test.force[inside][:, None], exact[:, :, 0], rtol=1e-9)
    ratio = np.abs(test.force[inside] / test.generator[inside])
    assert ratio.min() < 0.12
    assert ratio.max() > 0.8


def test_the_nearest_truth_of_a_range_is_in_it() -> None:
    drawn = disturbances_nonlinear.curved(np.random.default_rng(1), 1.0)
    model = replace(drawn.case.truth, poles=drawn.case.truth.poles * 0.9985)
    truth = nearest_truth(drawn, of_model(model))
    assert drawn.frequency is not None
    assert np.all(truth.natural_frequencies >= drawn.frequency[:, 0] * (1 - 1e-12))
    assert np.all(truth.natural_frequencies <= drawn.frequency[:, 1] * (1 + 1e-12))
    stiff = int(np.argmin(drawn.frequency[:, 1] - drawn.frequency[:, 0]))
    assert truth.natural_frequencies[stiff] == pytest.approx(drawn.case.truth.natural_frequencies[stiff])


@pytest.mark.parametrize(("worst", "expected"), [(1.0, False), (3.5, False), (4.5, True), (np.inf, True)])
def test_a_draw_is_wrong_where_one_value_is_far_off(worst: float, expected: bool) -> None:
    four = np.array([0.1, -0.5, 1.0, 0.3])
    found = Errors(np.arange(4), (), np.array([0.2, worst, 0.1, -0.4]), four, four, np.ones(4))
    assert wrong(found, residues=True) is expected
    assert wrong(replace(found, frequency=np.full(4, 3.4), damping=np.full(4, -3.4)), residues=False)


def test_the_roots_of_discs_and_squares_are_those_of_the_tables() -> None:
    """Leissa 1969, Vibration of plates: table 2.1 (clamped disc, wa^2 sqrt(rho/D)); m^2 + n^2 for the square."""
    point = np.array([0.3]), np.array([0.1])
    natural = repeated_roots.disc(*point, large=True)[0]
    table = [10.2158, 21.26, 21.26, 34.88, 34.88, 39.771, 51.04, 51.04, 60.82, 60.82, 69.666, 69.666, 84.58, 84.58]
    np.testing.assert_allclose(natural[: len(table)], table, rtol=6e-4)
    assert repeated_roots.square(*point)[0].tolist() == [2, 5, 5, 8, 10, 10, 13, 13, 17, 17, 18]


@pytest.mark.parametrize("number", range(8))
def test_a_poor_reference_is_as_poor_as_stated(number: int) -> None:
    made = repeated_roots.symmetric(2, number)
    natural = made.case.truth.natural_frequencies
    rows = made.case.truth.participation.imag * made.case.truth.poles.imag
    condition = [np.linalg.cond(rows[:, list(pair)]) for pair in made.pairs] if len(rows) > 1 else [np.inf]
    if made.kind == "two references, one poor":
        assert max(condition) > 10
        assert max(condition) < 40
    elif len(rows) > 1:
        assert max(condition) < 10
    for a, b in made.pairs:
        split = (natural[b] - natural[a]) / (2 * made.case.truth.damping_ratios[a] * natural[a])
        assert abs(split) < 1e-9 if made.exact else 5e-4 < split < 0.31


def test_a_light_sensor_lowers_a_mode_by_half_its_mass_times_the_square_of_the_shape() -> None:
    drawn = next(
        one
        for one in (set_ups.made(1, number) for number in range(30))
        if one.kind == "mass loading" and one.size == 0.0003
    )
    shapes = {str(dof): row for dof, row in zip(drawn.case.truth.dofs, drawn.case.truth.shapes.real, strict=True)}
    squares = np.array([np.sum([shapes[str(dof)] ** 2 for dof in part.outputs], axis=0) for part in drawn.parts])
    mass = -2 * drawn.shifts[0, 0] / squares[0, 0]
    np.testing.assert_allclose(drawn.shifts, -mass * squares / 2, rtol=0.02)
    assert np.abs(drawn.shifts).max() == pytest.approx(0.0003, rel=0.02)


def test_set_ups_without_shift_are_one_structure() -> None:
    drawn = set_ups.made(1, 0)
    assert drawn.size == 0
    truth = drawn.case.truth
    for part in drawn.parts:
        rows = [truth.dofs.index(dof) for dof in part.outputs]
        exact = (_accelerance(truth, part.frequencies) + _accelerance(drawn.case.outside, part.frequencies))[:, rows]
        assert np.linalg.norm(part.values - exact) < 0.02 * np.linalg.norm(exact)


def test_stated_values_are_those_of_the_model() -> None:
    case = tiny()
    covariance = np.array([[[4e-6, 0], [0, 9e-10]], [[1e-6, 0], [0, -1.0]]])
    stated: Stated = of_model(replace(case.truth, covariance=covariance))
    np.testing.assert_allclose(stated.frequencies, natural_frequencies(case.truth.poles))
    np.testing.assert_allclose(stated.damping, damping_ratios(case.truth.poles))
    np.testing.assert_allclose(stated.frequency_std, [2e-3, 1e-3])
    assert stated.damping_std[0] == pytest.approx(3e-5)
    assert np.isnan(stated.damping_std[1])
