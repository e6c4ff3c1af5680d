"""Campaigns as ``ema run`` leaves them, with modes that are known: the ground of the tests and the bench of archives.

Each is a ``campaign.toml`` with the kept results of its runs; there are no signals. A structure has six modes; the damping
ratio of its mode near 500 Hz grows by ``GROWTH`` a year, for that is what is asked of ten years of tests.
"""

from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from ema import store
from ema.archive import Source
from ema.data import (
    Condition,
    Excitation,
    Finding,
    FrfSet,
    JointForce,
    ModalModel,
    Provenance,
    Run,
    RunResult,
    poles_from,
)
from ema.dof import Dof
from ema.fingerprint import of_files

FREQUENCIES = np.array([95.0, 180.0, 330.0, 500.0, 760.0, 1150.0])
DAMPING = np.array([0.004, 0.006, 0.009, 0.012, 0.008, 0.005])
GROWTH = 0.0005
"""By which the damping ratio of the mode near 500 Hz grows in a year."""
STD = np.array([0.02, 2e-5])
"""Standard uncertainties of frequency [Hz] and damping ratio."""
FORCES = (None, 50.0, 100.0, 200.0, 300.0, 500.0, 1000.0)
"""Normal forces [N] of successive runs; ``None`` is without a beam."""
FIRST, YEARS, STRUCTURES = 2016, 10, 20


@dataclass(frozen=True)
class Truth:
    """What a generated run holds."""

    campaign: str
    run: str
    structure: str
    date: str
    normal_force: float | None
    frequencies: np.ndarray
    damping: np.ndarray


def truth(campaign: int, run: int, seed: int) -> Truth:
    """Modes and condition of a run, drawn anew in the same way whenever asked for."""
    rng = np.random.default_rng((seed, campaign, run))
    own = np.random.default_rng((seed, campaign))
    year, month, day = FIRST + int(own.integers(YEARS)), 1 + int(own.integers(12)), 1 + int(own.integers(28))
    structure = int(own.integers(STRUCTURES))
    frequencies = FREQUENCIES * (1 + 0.01 * (structure / STRUCTURES - 0.5)) + STD[0] * rng.standard_normal(6)
    damping = DAMPING + STD[1] * rng.standard_normal(6)
    damping[3] += GROWTH * (year - FIRST + (month - 1) / 12)
    return Truth(
        f"campaign {campaign:05d}", f"run_{run:03d}", f"structure {structure:02d}",
        f"{year}-{month:02d}-{day:02d}", FORCES[run % len(FORCES)], frequencies, damping,
    )  # fmt: skip


@cache
def _shapes() -> tuple[FrfSet, ModalModel]:
    dofs = tuple(Dof(node, "+Z") for node in range(1, 5))
    rng = np.random.default_rng(7)
    values = rng.standard_normal((41, 4, 1)) + 1j * rng.standard_normal((41, 4, 1))
    frfs = FrfSet(np.arange(41.0), values, dofs, dofs[:1], "accelerance")
    model = ModalModel(
        poles_from(FREQUENCIES, DAMPING), rng.standard_normal((4, 6)).astype(complex), dofs,
        rng.standard_normal((1, 6)).astype(complex), dofs[:1],
    )  # fmt: skip
    return frfs, model


def text_of(campaign: int, runs: int, seed: int) -> str:
    """The ``campaign.toml``."""
    about = truth(campaign, 0, seed)
    lines = [
        "[campaign]",
        f'name = "{about.campaign}"',
        f'structure = "{about.structure}"',
        f"date = {about.date}",
        'files = "raw"',
    ]
    for run in range(runs):
        own = truth(campaign, run, seed)
        lines += ["", "[[runs]]", f'id = "{own.run}"', 'kind = "hammer"', f'files = "{own.run}.uff"']
        if own.normal_force is not None:
            lines.append(f'normal_force = [{{ joint = "J1", value = "{own.normal_force:g} N" }}]')
    return "\n".join(lines) + "\n"


def source_of(folder: Path) -> Source:
    """Where the study of a generated campaign keeps its results, as ``ema run`` has it."""
    result = folder / "_build" / f"{folder.name}.h5"
    return Source(study=folder, campaign=folder, kept=result.with_suffix(""), result=result)


def result_of(campaign: int, run: int, seed: int, print_: str) -> dict[str, object]:
    """What ``ema run`` keeps of a run."""
    own = truth(campaign, run, seed)
    joints = () if own.normal_force is None else (JointForce("J1", mean=own.normal_force, std=2.0, drift=-1.0),)
    condition = Condition(Excitation("hammer", level=100.0), joints)
    frfs, model = _shapes()
    model = replace(
        model,
        poles=poles_from(own.frequencies, own.damping),
        covariance=np.tile(np.diag(STD**2), (6, 1, 1)),
        confidence=np.full(6, 0.99),
        condition=condition,
    )
    findings = (Finding("warning", "double-hit", f"run {own.run}", "one impact hit twice."),) if run % 10 == 3 else ()
    result = RunResult(Run(own.run, condition), frfs, None, model, findings=findings)
    data = f"{seed:016x}{campaign:032x}{run:016x}"
    made = Provenance((("campaign.toml", print_), (f"{own.run}.uff", data)), (("friction-ema", "0.1.0"),))
    return {"made": made, "result": result}


def write(folder: Path, campaign: int, runs: int, seed: int, analysed: int | None = None) -> Source:
    """Write a campaign with the results of its runs, or of the first ``analysed`` of them."""
    folder.mkdir(parents=True)
    (folder / "campaign.toml").write_text(text_of(campaign, runs, seed), encoding="utf-8")
    source = source_of(folder)
    source.kept.mkdir(parents=True)
    print_ = of_files([folder / "campaign.toml"])
    for run in range(runs if analysed is None else analysed):
        own = truth(campaign, run, seed)
        store.save(source.kept / f"{own.run}.h5", result_of(campaign, run, seed, print_))
    return source


def _without_waiting(root: str, campaign: int, runs: int, seed: int) -> None:
    """``write`` without waiting for the disk after each file: what is generated need not outlive a power cut."""
    from ema.store import atomic

    atomic._to_disk = lambda path: None
    write(Path(root) / f"campaign_{campaign:05d}", campaign, runs, seed)


def generate(root: Path, campaigns: int, runs: int, seed: int, executor: Executor) -> None:
    """Write many campaigns below a folder."""
    waiting = [executor.submit(_without_waiting, str(root), number, runs, seed) for number in range(campaigns)]
    for future in waiting:
        future.result()
