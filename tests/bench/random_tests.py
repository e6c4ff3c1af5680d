"""Random shaker tests of random systems: do the intervals of modes from measured FRFs hold the truth?

Signals come from exact FRFs by the discrete Fourier transform of a period twice as long as the record: the record has
leakage at both ends, and nothing of it comes from the code that estimates FRFs.

    python -m tests.bench.random_tests --seed 5002 --systems 60 --method local
"""

import argparse
from dataclasses import dataclass, replace

import numpy as np

import ema.fit
from ema.data import Channel, Condition, Excitation, FrfSet, Recording, Run
from ema.estimate.random_excitation import shaker
from tests.bench.cases import Case, random_system
from tests.bench.scoring import cramer_rao
from tests.bench.stated import REACH, Stated, errors, of_model

LINES = 801
"""Lines of a block in the band."""
BLOCKS = 8
"""Such blocks in the record."""
NOISES = (0.001, 0.01, 0.05)
_AT_ONCE = 8192


@dataclass(frozen=True)
class Test:
    """A run, the samples of a block of ``LINES`` lines in the band, and the system with the noise that one FRF of the
    whole record has on the lines of such blocks, were they independent."""

    __test__ = False

    case: Case
    run: Run
    block: int


def exact(case: Case, frequencies: np.ndarray) -> np.ndarray:
    """Accelerance of the system at any frequencies, (freq, out, in)."""
    s = 2j * np.pi * frequencies
    total = 0.0
    for model in (case.truth, case.outside):
        basis = 1 / (s[:, None] - model.poles)
        mirrored = 1 / (s[:, None] - model.poles.conj())
        residues = model.residues()
        total = total + np.tensordot(basis, residues, 1) + np.tensordot(mirrored, residues.conj(), 1)
    return total * (s**2)[:, None, None]


def random_test(seed: int, number: int) -> Test:
    """A system of 2 to 12 modes, 3 to 12 responses and 1 or 2 shakers in a random test."""
    rng = np.random.default_rng([seed, number])
    modes = round(np.exp(rng.uniform(np.log(1.5), np.log(12.5))))
    shakers = int(rng.integers(1, 3))
    responses = round(np.exp(rng.uniform(np.log(2.5), np.log(12.5))))
    noise = NOISES[number % 3]
    case = random_system(int(rng.integers(1, 2**31)), noise, max(2, modes), max(3, responses), shakers, LINES)
    low, high = case.band
    step = (high - low) / (LINES - 1)
    block = int(2 ** np.ceil(np.log2(2.2 * high / step)))
    samples, rate = block * BLOCKS, block * step
    frequencies = np.arange(samples + 1) * rate / (2 * samples)

    def normal(count: int) -> np.ndarray:
        found = rng.standard_normal((count, len(frequencies))) + 1j * rng.standard_normal((count, len(frequencies)))
        found[:, [0, -1]] = 0
        return found

    force = normal(shakers)
    motion = np.zeros((len(case.frfs.outputs), len(frequencies)), complex)
    for first in range(0, len(frequencies), _AT_ONCE):
        some = slice(first, first + _AT_ONCE)
        motion[:, some] = np.einsum("foi,if->of", exact(case, frequencies[some]), force[:, some])
    level = np.sqrt(np.mean(np.broadcast_to(case.noise_std, case.clean.shape) ** 2, axis=(0, 2)))
    motion += np.sqrt(BLOCKS) * level[:, None] * normal(len(motion))
    signals = np.fft.irfft(np.vstack([force, motion]), 2 * samples)[:, :samples]
    channels = [
        Channel(f"force {dof}", dof, quantity="force", unit="N", role="reference") for dof in case.frfs.inputs
    ] + [Channel(f"motion {dof}", dof, quantity="acceleration", unit="m/s^2") for dof in case.frfs.outputs]
    record = Recording(signals, rate, tuple(channels))
    run = Run("random", Condition(Excitation("random")), (record,))
    white = replace(case, noise_std=np.broadcast_to(level[None, :, None], case.clean.shape))
    return Test(white, run, block)


def measured(made: Test, method: str) -> FrfSet:
    """FRFs of the test in the band of the system."""
    frfs = shaker(made.run, method=method, block=made.block if method == "welch" else None)
    return frfs.band(*made.case.band)


@dataclass(frozen=True)
class Score:
    """Identifiable modes: errors of frequency and damping over what is stated, share of residues inside, stated
    standard deviations over the bound, damping bandwidth in lines (mode, 6); how many there are, were missed, false.
    """

    rows: np.ndarray
    identifiable: int
    missed: int
    false: int

    @property
    def inside(self) -> np.ndarray:
        """Share of frequencies, damping ratios and residues inside their 95 % intervals, of the modes found."""
        return np.array([*np.mean(np.abs(self.rows[:, :2]) <= REACH, axis=0), np.mean(self.rows[:, 2])])


def score(made: Test, method: str = "local") -> Score:
    """What the fit of a test states against its truth."""
    frfs = measured(made, method)
    stated: Stated = of_model(ema.fit.modes(frfs, ema.fit.stabilise(frfs)), frfs)
    found, bound = errors(made.case, stated), cramer_rao(made.case, residual_terms=True)
    hit = bound.identifiable & (found.match >= 0)
    own, truth = found.match[hit], made.case.truth
    width = 2 * truth.damping_ratios * truth.natural_frequencies / frfs.frequency_step
    columns = [
        found.frequency[hit],
        found.damping[hit],
        found.inside[hit],
        stated.frequency_std[own] / bound.frequency_std[hit],
        stated.damping_std[own] / bound.damping_std[hit],
        width[hit],
    ]
    missed = int(np.sum(bound.identifiable & (found.match < 0)))
    return Score(np.column_stack(columns), int(np.sum(bound.identifiable)), missed, len(found.false))


def together(scores: list[Score]) -> Score:
    """Scores of several tests as one."""
    counts = np.array([[one.identifiable, one.missed, one.false] for one in scores]).sum(axis=0)
    return Score(np.concatenate([one.rows for one in scores]), *(int(count) for count in counts))


def main() -> None:
    """Score the tests and print what came out."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=5002)
    parser.add_argument("--systems", type=int, default=60)
    parser.add_argument("--method", choices=("local", "welch"), default="local")
    options = parser.parse_args()
    scores = []
    for number in range(options.systems):
        scores.append(score(random_test(options.seed, number), options.method))
        so_far = together(scores)
        print(
            f"{number + 1} systems, {so_far.identifiable} modes, {so_far.missed} missed, {so_far.false} false; "
            f"f / zeta / residues inside: {' / '.join(f'{100 * share:.1f}' for share in so_far.inside)} %; stated std "
            f"over the bound: {np.round(np.median(so_far.rows[:, 3:5], axis=0), 2)}",
            flush=True,
        )
    rows = together(scores).rows
    for low, high in ((0, 5), (5, 20), (20, 100), (100, np.inf)):
        some = rows[(rows[:, 5] >= low) & (rows[:, 5] < high)]
        if len(some):
            inside = [*np.mean(np.abs(some[:, :2]) <= REACH, axis=0), np.mean(some[:, 2])]
            print(f"bandwidth {low} to {high} lines: {len(some)} modes, {np.round(100 * np.array(inside), 1)} %")


if __name__ == "__main__":
    main()
