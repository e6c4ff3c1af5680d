"""Increments of the friction laws, and their solution against a compliance.

The truth is written here: rate forms of the laws (Gaul, Roseira and Becker 2008, Eqs. 4 and 5; Dahl 1968; Canudas de Wit
et al. 1995) integrated by DOP853, closed forms of the energy per cycle, and equations solved by scipy.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import ema
from ema.contact import solve_kernels
from ema.contact.call_kernels import EXCESS, FORCE, LIMIT, SLOPE, WAY
from ema.contact.laws import compiled, contact_laws
from ema.dof import Dof
from ema.elements import Section
from ema.simulate import (
    BoucWen,
    Coulomb,
    Dahl,
    Iwan,
    LuGre,
    Masing,
    ParallelMasing,
    RegularisedMasing,
    Valanis,
    double_beam,
    register_law,
)
from ema.simulate.transient import Drive, integrate, prepare, released

K, FC, STEP = 2e6, 30.0, 1e-4
DAMPING, FLUID, RATIO, STRIBECK = 40.0, 3.0, 1.4, 0.05


def soft_clip(force, du, k, limit, p0, p1, p2, p3):
    return min(max(force + p0 * k * du, -limit), limit)


SMOOTH = {
    "dahl, 0.5": Dahl(1.0, K, 0.5),
    "dahl, 1": Dahl(1.0, K),
    "dahl, 2": Dahl(1.0, K, 2.0),
    "Eq. (5), m = 0.7": RegularisedMasing(1.0, K, 0.7),
    "Eq. (5), m = 8": RegularisedMasing(1.0, K, 8.0),
    "bouc wen, n = 1, gamma = -1": BoucWen(1.0, K, 1.0, -1.0),
    "bouc wen, n = 0.6, gamma = 0.1": BoucWen(1.0, K, 0.6, 0.1),
    "bouc wen, n = 6, gamma = 0": BoucWen(1.0, K, 6.0, 0.0),
    "bouc wen, gamma = 1/2": BoucWen(1.0, K, 2.0, 0.5),
    "valanis, 0": Valanis(1.0, K, 0.0),
    "valanis, 0.6": Valanis(1.0, K, 0.6),
    "valanis, 0.99": Valanis(1.0, K, 0.99),
    "lugre": LuGre(1.0, K, DAMPING, FLUID, RATIO, STRIBECK),
}
SPRINGS = {
    "masing": Masing(1.0, K),
    "coulomb": Coulomb(1.0, 100 * K),
    "iwan": Iwan(1.0, K, springs=20),
    "parallel masing": ParallelMasing(1.0, K, [0.5, 0.3, 0.2], [0.2, 0.3, 0.5]),
}
MONOTONE = [law for name, law in (SMOOTH | SPRINGS).items() if name != "lugre"]


def rate_form(law, sign, velocity):
    """dF/d|u| for one direction of motion: the published rate form."""
    values = [value for _, value in law.parameters]
    if law.name == "dahl":
        return lambda f: sign * K * abs(1 - sign * f / FC) ** values[0] if sign * f < FC else 0.0
    if law.name == "regularised masing":
        return lambda f: sign * K * (1 - abs(f / FC) ** values[0] * (sign * f > 0))
    if law.name == "bouc wen":
        n, gamma = values
        return lambda f: sign * K * (1 - abs(f / FC) ** n * (gamma + (1 - gamma) * np.sign(sign * f)))
    if law.name == "valanis":
        return lambda f: sign * K * max(1 - sign * f / FC, 0.0) / (1 - values[0] * min(sign * f / FC, 1.0))
    top = FC * (1 + (RATIO - 1) * np.exp(-((velocity / STRIBECK) ** 2)))
    return lambda f: sign * K * (1 - sign * f / top)


def group(law, count=1):
    """A law on ``count`` contacts, and its tables as the kernels take them."""
    stiffness = np.full(count, law.contact_stiffness)
    laws = contact_laws([law] * count, stiffness, [1] * count)
    exchange = laws.exchange()
    exchange[LIMIT] = FC
    return laws, exchange


def increment(laws, exchange, before, way, rate=1 / STEP):
    """Numbers of the contacts after a step, and the state."""
    after, (rows, parameters, curves) = np.zeros_like(before), laws.arguments()
    exchange[WAY] = way
    for row, (name, *_) in zip(rows, laws.groups, strict=True):
        compiled(name)(row, rate, (parameters, curves), exchange, (before, after))
    return exchange[:, 0].copy(), after


@pytest.mark.parametrize("name", SMOOTH)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_smooth_laws_follow_their_rate_forms(name, seed):
    law, draw = SMOOTH[name], np.random.default_rng(seed)
    path = np.concatenate([[0.0], np.cumsum(draw.normal(size=12) * 1.5 * FC / K)])
    laws, _ = group(law)
    force, forces = 0.0, [0.0]
    for way in np.diff(path):
        sign, velocity = np.sign(way), way / STEP
        rate = rate_form(law, sign, velocity)
        force = solve_ivp(
            lambda _, f, rate=rate: [rate(f[0])],
            (0.0, abs(way)),
            [force],
            "DOP853",
            rtol=1e-11,
            atol=1e-9,
            max_step=abs(way) / 50,
        ).y[0, -1]
        forces.append(force)
    state = np.zeros((1, laws.states))
    exchange, found, before = group(law)[1], [0.0], 0.0
    for way in np.diff(path):
        numbers, state = increment(laws, exchange, state, way)
        found.append(state[0, 0])
        # the velocity at the end, to second order
        v, before = (3 * way - before) / (2 * STEP), way
        top = FC * (1 + (RATIO - 1) * np.exp(-((v / STRIBECK) ** 2)))
        added = DAMPING * (v - abs(v) * state[0, 0] / top) + FLUID * v if name == "lugre" else 0.0
        assert numbers[FORCE] == pytest.approx(state[0, 0] + added, rel=1e-12)
    # the corner of Eq. (5) at F = 0 and an exponent below 1 cost DOP853 digits, not the increment
    np.testing.assert_allclose(found, forces, atol=3e-6 * FC)


@pytest.mark.parametrize("name", [*SMOOTH, *SPRINGS])
@pytest.mark.parametrize("rate", [0.0, 1 / STEP])
def test_tangents_against_differences(name, rate):
    law, draw = (SMOOTH | SPRINGS)[name], np.random.default_rng(7)
    if name == "lugre":
        # Newton's method leaves the fall of F_S with the velocity out, which may turn the slope round
        law = LuGre(1.0, K, DAMPING, FLUID)
    laws, exchange = group(law)
    state, scale, force = np.zeros((1, laws.states)), FC / law.contact_stiffness, 0.0
    for _ in range(40):
        way = draw.normal() * scale
        numbers, after = increment(laws, exchange, state, way, rate)
        more, less = (increment(laws, exchange, state, way + d, rate)[0] for d in (1e-5 * scale, -1e-5 * scale))
        slopes = (more - less) / (2e-5 * scale)
        rises = not np.isclose(numbers[SLOPE], -law.contact_stiffness)
        slipped = numbers[FORCE] - force - law.contact_stiffness * way
        assert numbers[EXCESS] == pytest.approx(slipped, abs=1e-9 * FC)
        # a spring that comes to its limit inside the difference has no slope there
        kinks = law.name in ("masing", "coulomb", "parallel masing", "iwan") and not np.isclose(
            (more - 2 * numbers + less)[EXCESS], 0.0, atol=1e-9 * FC
        )
        if rises and not kinks:
            assert slopes[EXCESS] == pytest.approx(numbers[SLOPE], abs=2e-4 * law.contact_stiffness)
        state, force = after, numbers[FORCE]


def booked(laws, exchange, path):
    """Loss along a path as the time solver books it, F . d less what the springs store."""
    state, force, loss, memory = np.zeros((1, laws.states)), 0.0, [], laws.flexibility
    for way in np.diff(path):
        numbers, after = increment(laws, exchange, state, way, 0.0)
        loss.append(0.5 * (force + numbers[FORCE]) * way - 0.5 * (memory * (after**2 - state**2)).sum())
        state, force = after, numbers[FORCE]
    return np.array(loss)


@pytest.mark.parametrize("ratio", [0.5, 1.5, 4.0])
def test_loss_per_cycle_against_closed_forms(ratio):
    """Masing 4 F_C (A - F_C/k), its parallel springs, and Dahl 4 F_C (A - F_C/k tanh(k A/F_C)), sixth cycle."""
    amplitude, count = ratio * FC / K, 2000
    path = amplitude * np.sin(np.linspace(0, 12 * np.pi, 6 * count + 1))

    def masing(k, top):
        return max(4 * top * (amplitude - top / k), 0.0)

    cases = (
        (SPRINGS["masing"], masing(K, FC)),
        (SPRINGS["parallel masing"], sum(masing(K * k, FC * f) for k, f in ((0.5, 0.2), (0.3, 0.3), (0.2, 0.5)))),
        (SMOOTH["dahl, 1"], 4 * FC * (amplitude - FC / K * np.tanh(ratio))),
    )
    for law, exact in cases:
        loss = booked(*group(law), path)
        assert loss[-count:].sum() == pytest.approx(exact, rel=1e-3, abs=1e-12 * FC * amplitude)
        assert loss.min() >= -1e-9 * FC * amplitude


def solution(laws, free, compliance, rate=0.0):
    """Displacements, forces x and state from the kernel."""
    count = len(free)
    exchange, memory = laws.exchange(), laws.memory(compliance)
    exchange[LIMIT] = FC
    u0, u1 = np.zeros(count), np.zeros(count)
    states = np.zeros_like(laws.flexibility), np.zeros_like(laws.flexibility)
    problem = compliance, float(np.abs(compliance).sum(axis=1).max()), rate, 1e-13
    iterations, residual = solve_kernels.solve(laws.arguments(), problem, (free, u0, u1), exchange, states, memory)
    return u1, exchange, iterations, residual


@pytest.mark.parametrize("law", MONOTONE, ids=lambda law: law.name)
def test_one_contact_against_a_bracketed_root(law):
    draw, k = np.random.default_rng(3), law.contact_stiffness
    for _ in range(20):
        softness = draw.uniform(0.05, 0.95) / k
        free = draw.normal() * 5 * FC / k
        laws, exchange = group(law)

        def missing(u, laws=laws, exchange=exchange, softness=softness, free=free):
            force = increment(laws, exchange, np.zeros((1, laws.states)), u, 0.0)[0][FORCE]
            return u + softness * (force - k * u) - free

        root = brentq(missing, -1e3 * abs(free), 1e3 * abs(free), xtol=1e-15 * abs(free), rtol=1e-13)
        u1, _, _, residual = solution(laws, np.array([free]), np.array([[softness]]))
        assert residual <= 1e-13 and u1[0] == pytest.approx(root, rel=1e-9)


@pytest.mark.parametrize("law", MONOTONE, ids=lambda law: law.name)
def test_contacts_that_hang_together_through_a_compliance(law):
    """Twelve contacts on random positive compliances, stiff and soft: x = e(u1 - u0) and u1 = free - W x."""
    draw, count, k = np.random.default_rng(5), 12, law.contact_stiffness
    for stiff in (0.5, 0.99, 0.999999):
        for _ in range(10):
            basis = np.linalg.qr(draw.normal(size=(count, count)))[0]
            compliance = (basis * draw.uniform(0.01, stiff, count)) @ basis.T / k
            compliance = np.ascontiguousarray(0.5 * (compliance + compliance.T))
            free = draw.normal(size=count) * 10 * FC / k
            laws = group(law, count)[0]
            u1, exchange, iterations, residual = solution(laws, free, compliance)
            assert residual <= 1e-13 and iterations < 40
            np.testing.assert_allclose(u1, free - compliance @ exchange[EXCESS], atol=1e-11 * np.abs(free).max())
            forces = [increment(*group(law), np.zeros((1, laws.states)), u, 0.0)[0][FORCE] for u in u1]
            np.testing.assert_allclose(exchange[FORCE], forces, atol=1e-12 * FC)
            np.testing.assert_array_equal(exchange[WAY], u1)


def test_laws_of_several_kinds_side_by_side():
    """A joint with each law: groups of neighbours give what each law gives alone."""
    own = register_law("soft clip of the increments", soft_clip)(1.0, K, 0.5)
    mixed = [SMOOTH["dahl, 1"], own, SPRINGS["iwan"], SPRINGS["iwan"], SMOOTH["Eq. (5), m = 8"], SPRINGS["masing"]]
    free = np.linspace(0.5, 3.0, len(mixed)) * FC / K
    compliance = np.diag(np.linspace(0.2, 0.8, len(mixed)) / K)
    together = solution(contact_laws(mixed, np.full(len(mixed), K), [1] * len(mixed)), free, compliance)
    for i, law in enumerate(mixed):
        alone = solution(
            contact_laws([law], np.array([K]), [1]), free[i : i + 1], compliance[i : i + 1, i : i + 1].copy()
        )
        assert together[0][i] == pytest.approx(alone[0][0], rel=1e-11)
        assert together[1][FORCE, i] == pytest.approx(alone[1][FORCE, 0], rel=1e-10)


@pytest.mark.parametrize("stick_stiffness", [1e9, 1e12])
def test_no_step_of_stiff_contacts_is_left_unsolved(stick_stiffness):
    """1000 steps of a release that sets all contacts sliding."""
    tip = "beam 2:10:+Z"
    problem = prepare(double_beam(Coulomb(0.3, stick_stiffness), 1000.0, Section(0.5, 0.04, 0.005, elements=10)), [tip])
    state = released(problem, 20.0, Dof.parse(tip))
    run, stepper = integrate(problem, state, 1e-5, 10, 100, Drive(np.zeros(1)))
    assert stepper.residual <= 1e-12 and stepper.sweeps < 40
    total = run["energy"].sum(axis=1) - 2 * run["energy"][:, 3]
    np.testing.assert_allclose(total, total[0], rtol=1e-9)


SCRIPT = """
import numpy as np
from ema.contact import call_kernels, springs_kernels
law = springs_kernels.spring
compiler, compiled = law._compiler.compile, []
law._compiler.compile = lambda *signature: compiled.append(signature) or compiler(*signature)
call_kernels.address(law)
exchange, after = np.ones((call_kernels.ROWS, 1)), np.zeros((1, 1))
exchange[call_kernels.WAY] = 5.0
tables = np.zeros((1, 1)), np.zeros((1, 3, 2))
law(np.array([0, 0, 1, 1]), 1.0, tables, exchange, (np.zeros((1, 1)), after))
print(after[0, 0], "compiled" if compiled else "kept")
"""


def test_compiled_laws_are_kept_on_disk_until_their_file_changes(tmp_path):
    source = Path(ema.__file__).parent
    shutil.copytree(source, tmp_path / "ema", ignore=shutil.ignore_patterns("__pycache__"))
    environment = os.environ | {"PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "kept")}

    def run():
        call = [sys.executable, "-c", SCRIPT]
        done = subprocess.run(call, capture_output=True, text=True, check=True, env=environment, cwd=tmp_path)
        force, how = done.stdout.split()
        return float(force), how

    assert run() == (1.0, "compiled")
    assert run() == (1.0, "kept")
    law = tmp_path / "ema" / "contact" / "springs_kernels.py"
    law.write_text(
        law.read_text().replace("top = exchange[STIFFNESS, i], exchange[LIMIT, i]", "top = exchange[STIFFNESS, i], 2.0")
    )
    assert run() == (2.0, "compiled")
    assert run() == (2.0, "kept")
