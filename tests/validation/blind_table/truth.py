"""The blind table's truth: OpenSeesPy and the standard library, nothing of this project.

``python -P truth.py hammer QUESTION.json RESULT.json`` strikes the bare table; ``python -P truth.py swept QUESTION.json
RESULT.json`` bolts the beam on and drives it with sines whose frequency is stepped until the response is highest.

The table is a grillage of cast-iron beams on a raster of bolt holes, with four legs, on soft springs; the beam of
Timoshenko elements sits on it with rigid offsets. Each joint has elastic-perfectly-plastic springs in parallel along
the beam and across it, a normal and a tilting spring. The joints differ: mu and k_T scatter by a seed that is the
fingerprint of the stored prediction.
"""

import hashlib
import json
import math
import random
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from importlib.metadata import version
from itertools import pairwise, repeat
from operator import mul
from pathlib import Path

import openseespy.opensees as ops

STEP = 1 / 98304
"""s. The trapezoidal rule lowers a frequency by the share (2 pi f STEP)^2/12 (Hughes 2000, The Finite Element Method,
section 9.1): 0.07 % at 1450 Hz, where a mode of the table with its beam answers the third harmonic of the friction force.
With a step three times as long, 0.65 %, that internal resonance moves by 3 Hz of the first harmonic, and peaks with it."""
EVERY = 24
COLUMNS, ROWS = 12, 6
LENGTH, WIDTH = 0.9, 0.5
CAST_IRON, SHEAR = 110e9, 44e9
BEND_ALONG, BEND_ACROSS, TWIST = 3.22e6, 1.40e6, 5.0e6
"""Bending and twisting stiffness per unit width, N m."""
THICKNESS, PER_AREA = 0.055, 228.0
LEGS = {(2, 1): 9.0, (10, 1): 5.0, (2, 5): 6.0, (10, 5): 7.4}
"""kg under the bolt holes (column, row)."""
MASS_DAMPING = 40.0
STEEL, STEEL_SHEAR, STEEL_DENSITY = 210e9, 80.8e9, 7850.0
BEAM_PARTS = 18
"""Masses are at the nodes: with 6 parts the beam would turn 4 % harder than it does."""
SPRINGS = 6
SETTLED = 1e-3
"""Relative change of the extrapolated amplitude from one block of periods to the next. Peaks of joints that slip are flat:
0.3 % are up to 3 Hz of them."""


def node(column: int, row: int) -> int:
    return 100 * column + row + 1


def share(index: int, last: int) -> float:
    return 0.5 if index in (0, last) else 1.0


def table() -> int:
    """The bare table; returns the number of elements."""
    ops.wipe()
    ops.model("basic", "-ndm", 3, "-ndf", 6)
    dx, dy = LENGTH / COLUMNS, WIDTH / ROWS
    for i in range(COLUMNS + 1):
        for j in range(ROWS + 1):
            ops.node(node(i, j), i * dx, j * dy, 0.0)
            mass = PER_AREA * dx * dy * share(i, COLUMNS) * share(j, ROWS)
            mass += LEGS.get((i, j), 0.0)
            ops.mass(node(i, j), mass, mass, mass, 1e-4, 1e-4, 1e-4)
    ops.geomTransf("Linear", 1, 0, 0, 1)
    element = 0
    lines = [
        (node(i, j), node(i + 1, j), dy * share(j, ROWS), BEND_ALONG) for j in range(ROWS + 1) for i in range(COLUMNS)
    ]
    lines += [
        (node(i, j), node(i, j + 1), dx * share(i, COLUMNS), BEND_ACROSS)
        for i in range(COLUMNS + 1)
        for j in range(ROWS)
    ]
    for first, second, width, bend in lines:
        element += 1
        ops.element(
            "elasticBeamColumn",
            element,
            first,
            second,
            THICKNESS * width,
            CAST_IRON,
            SHEAR,
            TWIST / SHEAR * width,
            bend * width / CAST_IRON,
            THICKNESS * width**3,
            1,
        )
    ops.rayleigh(MASS_DAMPING, 0.0, 0.0, 0.0)
    ops.uniaxialMaterial("Elastic", 1, 2e4)
    for i, j in ((0, 0), (COLUMNS, 0), (0, ROWS), (COLUMNS, ROWS)):
        ground = 90000 + node(i, j)
        ops.node(ground, i * dx, j * dy, 0.0)
        ops.fix(ground, 1, 1, 1, 1, 1, 1)
        element += 1
        ops.element("zeroLength", element, ground, node(i, j), "-mat", 1, 1, 1, "-dir", 1, 2, 3)
    return element


def spring_shares(chi: float, beta: float, count: int) -> list[tuple[float, float]]:
    """Shares of stiffness and of slip force of springs that follow Segalman's density of slip limits."""
    # density R p^chi on (0, 1) and a spring S at 1, for F_C = K_T = 1 up to the scale of p
    density_stiffness = 1 / (chi + 1)
    density_force = 1 / (chi + 2)
    last = beta * density_stiffness
    edges = [(k / (count - 1)) ** 1.7 for k in range(count)]
    parts = []
    for low, high in pairwise(edges):
        parts.append(
            ((high ** (chi + 1) - low ** (chi + 1)) / (chi + 1), (high ** (chi + 2) - low ** (chi + 2)) / (chi + 2))
        )
    parts.append((last, last))
    stiffness, force = density_stiffness + last, density_force + last
    return [(k / stiffness, f / force) for k, f in parts]


def bolt_on(element: int, question: dict, column: int, row: int, normal_force: float, factors: list) -> list[int]:
    """The beam from one bolt hole to another along the table; returns its nodes, which carry its mass."""
    beam, joint = question["beam"], question["joint"]
    dx, y = LENGTH / COLUMNS, row * WIDTH / ROWS
    start, span = column * dx, beam["spacing"]
    width, height, overhang = beam["width"], beam["height"], beam["overhang"]
    at = [start - overhang, *(start + span * k / BEAM_PARTS for k in range(BEAM_PARTS + 1)), start + span + overhang]
    area, axis = width * height, joint["surface_height"] + height / 2
    for k, x in enumerate(at):
        ops.node(50000 + k, x, y, axis)
        length = ((at[k + 1] if k + 1 < len(at) else x) - (at[k - 1] if k else x)) / 2
        mass = STEEL_DENSITY * area * length
        ops.mass(
            50000 + k, mass, mass, mass, mass * (width**2 + height**2) / 12, mass * height**2 / 12, mass * width**2 / 12
        )
        if k:
            element += 1
            ops.element(
                "ElasticTimoshenkoBeam",
                element,
                50000 + k - 1,
                50000 + k,
                STEEL,
                STEEL_SHEAR,
                area,
                0.229 * width * height**3,
                width * height**3 / 12,
                height * width**3 / 12,
                5 / 6 * area,
                5 / 6 * area,
                1,
            )
    base = joint["contact_stiffness"] * (normal_force / joint["reference_force"]) ** joint["stiffness_exponent"]
    for number, (column_here, part) in enumerate(((column, 1), (column + question["holes"], BEAM_PARTS + 1))):
        friction, stiffness = factors[number]
        below, above = 60000 + number, 61000 + number
        for interface in (below, above):
            ops.node(interface, at[part], y, joint["surface_height"])
        ops.rigidLink("beam", node(column_here, row), below)
        ops.rigidLink("beam", 50000 + part, above)
        tag, members = 1000 * (number + 1), []
        for of_stiffness, of_force in spring_shares(joint["chi"], joint["beta"], SPRINGS):
            tag += 1
            k = base * stiffness * of_stiffness
            limit = joint["friction_coefficient"] * friction * normal_force * of_force
            ops.uniaxialMaterial("ElasticPP", tag, k, limit / k)
            members.append(tag)
        ops.uniaxialMaterial("Parallel", tag + 1, *members)
        ops.uniaxialMaterial("Elastic", tag + 2, joint["normal_stiffness"])
        ops.uniaxialMaterial("Elastic", tag + 3, joint["normal_stiffness"] * width**2 / 12)
        element += 1
        ops.element("zeroLength", element, below, above, "-mat", tag + 1, tag + 1, tag + 2, tag + 3, "-dir", 1, 2, 3, 4)
    return [50000 + k for k in range(len(at))]


def solver(*algorithm: object) -> None:
    ops.constraints("Transformation")
    ops.numberer("AMD")
    ops.system("SparseSYM")
    ops.test("NormDispIncr", 1e-13, 60)
    ops.algorithm(*algorithm)
    ops.integrator("Newmark", 0.5, 0.25)
    ops.analysis("Transient")


def low_pass(cut: float, half: int) -> list[float]:
    """A windowed sine cardinal with unit gain at rest: the filter of the front end."""
    taps = []
    for k in range(-half, half + 1):
        x = 2 * math.pi * cut * STEP * k
        window = 0.54 + 0.46 * math.cos(math.pi * k / half)
        taps.append((math.sin(x) / x if k else 1.0) * window)
    total = sum(taps)
    return [tap / total for tap in taps]


def struck(point: list[int], sensors: list[list[int]], samples: int, rng: random.Random) -> list[list[float]]:
    """Force and accelerations after one impact downwards, every step."""
    table()
    peak, contact, before = rng.uniform(800, 1200), rng.uniform(0.9e-3, 1.2e-3), 0.006
    count = round(contact / STEP)
    blow = [peak * math.sin(math.pi * k / count) ** 2 for k in range(count + 1)]
    quiet = round(before / STEP)
    force = [0.0] * quiet + blow + [0.0] * (samples * EVERY - quiet - len(blow))
    ops.timeSeries("Path", 1, "-dt", STEP, "-values", *force)
    ops.pattern("Plain", 1, 1)
    ops.load(node(*point), 0.0, 0.0, -1.0, 0.0, 0.0, 0.0)
    solver("Linear", "-factorOnce")
    signals = [force] + [[0.0] for _ in sensors]
    places = [node(*sensor) for sensor in sensors]
    for _ in range(len(force) - 1):
        ops.analyze(1, STEP)
        for signal, place in zip(signals[1:], places):
            signal.append(ops.nodeAccel(place, 3))
    return signals


def measured(question: dict, number: int) -> list[list[float]]:
    """Force and accelerations of the impact at one of the points: filtered, sampled, with noise."""
    rng = random.Random(f"{question['seed']} {number}")
    samples, half = question["samples"], round(15 * EVERY / 2)
    taps, rows = low_pass(1750.0, half), []
    for row, signal in enumerate(struck(question["points"][number], question["sensors"], samples, rng)):
        padded = [signal[0]] * half + signal + [signal[-1]] * half
        level = question["noise"]["force" if row == 0 else "acceleration"]
        rows.append(
            [
                sum(map(mul, taps, padded[k : k + len(taps)])) + rng.gauss(0.0, level)
                for k in range(0, samples * EVERY, EVERY)
            ]
        )
    return rows


def hammer(question: dict) -> dict:
    """Every point struck once, two accelerometers."""
    with ProcessPoolExecutor() as pool:
        records = list(pool.map(measured, repeat(question), range(len(question["points"]))))
    return {"sampling_rate": 1 / (STEP * EVERY), "records": records}


class Drive:
    """The table with its beam under a sine whose frequency and amplitude are changed without a jump of phase."""

    def __init__(self, question: dict, column: int, row: int, normal_force: float, factors: list) -> None:
        self.element = table()
        self.beam = bolt_on(self.element, question, column, row, normal_force, factors)
        self.place = node(*question["drive"])
        self.phase, self.patterns, self.frequency, self.level = 0.0, 0, 0.0, 0.0
        self.moving = [tag for tag in ops.getNodeTags() if tag < 60000]
        self.masses = {tag: [ops.nodeMass(tag, k) for k in (1, 2, 3)] for tag in self.moving}
        solver("ExpressNewton", 4, 1.0, "-initialTangent", "-factorOnce")

    def set(self, frequency: float, level: float) -> None:
        now = ops.getTime()
        if self.patterns:
            self.phase += 2 * math.pi * self.frequency * (now - self.since)
            ops.remove("loadPattern", self.patterns)
            ops.remove("timeSeries", self.patterns)
        self.patterns += 1
        self.frequency, self.level, self.since = frequency, level, now
        ops.timeSeries(
            "Trig", self.patterns, now, 1e9, 1 / frequency, "-shift", self.phase % (2 * math.pi), "-factor", level
        )
        ops.pattern("Plain", self.patterns, self.patterns)
        ops.load(self.place, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)

    def run(self, steps: int) -> None:
        if ops.analyze(steps, STEP) != 0:
            raise RuntimeError("a step did not converge")

    def block(self, periods: int, energies: bool = False) -> tuple[complex, float, float]:
        """Complex displacement under the force (phase of the force zero), work per period, largest kinetic energy."""
        steps = round(periods / (self.frequency * STEP))
        cosine = sine = work = 0.0
        sums = {tag: [0j, 0j, 0j] for tag in self.moving}
        for _ in range(steps):
            self.run(1)
            angle = self.phase + 2 * math.pi * self.frequency * (ops.getTime() - self.since)
            turn = complex(math.cos(angle), -math.sin(angle))
            moved, speed = ops.nodeDisp(self.place, 3), ops.nodeVel(self.place, 3)
            cosine += moved * turn.real
            sine += moved * turn.imag
            work += self.level * math.sin(angle) * speed * STEP
            if energies:
                for tag, total in sums.items():
                    v = ops.nodeVel(tag)
                    total[0] += v[0] * turn
                    total[1] += v[1] * turn
                    total[2] += v[2] * turn
        # the force is a sine: its phasor is -j
        amplitude = 2 * complex(cosine, sine) / steps * 1j
        even = odd = 0.0
        for tag, total in sums.items():
            for mass, one in zip(self.masses[tag], total):
                speed = 2 * one / steps
                even += mass * abs(speed) ** 2 / 4
                odd += mass * speed**2 / 4
        return amplitude, work * steps and work / periods, even + abs(odd)

    def steady(self, frequency: float, level: float, settled: float, most: int = 40) -> complex:
        """Displacement when it no longer changes by more than ``settled``; its limit is extrapolated (Aitken)."""
        self.set(frequency, level)
        self.run(round(8 / (frequency * STEP)))
        seen, limit = [self.block(4)[0], self.block(4)[0]], 0j
        for _ in range(most):
            seen.append(self.block(4)[0])
            first, second = seen[-2] - seen[-3], seen[-1] - seen[-2]
            before, limit = limit, seen[-1] - second**2 / (second - first)
            if abs(limit - before) < settled * abs(limit) and abs(second) < 10 * settled * abs(limit):
                break
        return limit

    def resonance(self, guess: float, level: float, apart: float = 3.0) -> dict:
        """Frequency of the highest response under the force, and the damping there: work over 4 pi times energy."""
        known: dict[float, complex] = {}
        frequency, tried = guess, 0
        for frequency in (guess + k * apart for k in range(-2, 3)):
            known[frequency] = self.steady(frequency, level, SETTLED)
        while tried < 12:
            tried += 1
            order = sorted(known)
            best = max(order, key=lambda f: abs(known[f]))
            index = order.index(best)
            if index in (0, len(order) - 1):
                frequency = best + (apart if index else -apart)
            else:
                a, b, c = order[index - 1], best, order[index + 1]
                ya, yb, yc = (1 / abs(known[f]) ** 2 for f in (a, b, c))
                top = (b - a) ** 2 * (yb - yc) - (b - c) ** 2 * (yb - ya)
                bottom = (b - a) * (yb - yc) - (b - c) * (yb - ya)
                frequency = b - 0.5 * top / bottom
                if abs(frequency - b) < 0.15 or c - a < 0.6:
                    break
                frequency = min(max(frequency, a + 0.1 * (b - a)), c - 0.1 * (c - b))
            known[frequency] = self.steady(frequency, level, SETTLED)
        self.steady(frequency, level, SETTLED / 30)
        amplitude, work, energy = self.block(12, True)
        return {
            "frequency": frequency,
            "damping": work / (4 * math.pi * energy),
            "amplitude": abs(amplitude),
            "curve": [[f, known[f].real, known[f].imag] for f in sorted(known)],
        }


def scatter(seed: int, std: float) -> list[tuple[float, float]]:
    """Factors of mu and of k_T of the two joints."""
    rng = random.Random(seed)
    return [(math.exp(rng.gauss(0, std)), math.exp(rng.gauss(0, std))) for _ in range(2)]


def driven(question: dict, asked: dict, normal_force: float) -> dict:
    """Resonances of one place and normal force over the force levels."""
    started = time.process_time()
    drive = Drive(question, asked["column"], asked["row"], normal_force, question["factors"])
    guess, found = question["guess"], []
    for level in asked["levels"]:
        one = drive.resonance(guess, level)
        guess = one["frequency"]
        found.append(one)
    place = {key: asked[key] for key in ("column", "row")} | {"normal_force": normal_force, "levels": asked["levels"]}
    return place | {"resonances": found, "s": round(time.process_time() - started, 1)}


def swept(question: dict) -> dict:
    """Resonances of every asked place, normal force and force level."""
    asked = [(place, force) for place in question["asked"] for force in place["normal_forces"]]
    with ProcessPoolExecutor() as pool:
        answers = list(pool.map(driven, repeat(question), *zip(*asked)))
    return {"answers": answers, "factors": question["factors"]}


if __name__ == "__main__":
    task, asked_in, told_in = sys.argv[1:4]
    text = Path(asked_in).read_bytes()
    what = json.loads(text)
    if task == "hammer":
        told = hammer(what)
    else:
        if "factors" not in what:
            seed = int(hashlib.sha256(what["prediction"].encode()).hexdigest()[:12], 16)
            what["factors"] = scatter(seed, what["scatter"])
        told = swept(what)
    told["program"] = "OpenSeesPy " + version("openseespy")
    Path(told_in).write_text(json.dumps(told))
