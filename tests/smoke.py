"""What has to work with the lowest and with the newest versions of all dependencies: ``python -m tests.smoke``.

Every public name, units, a result file, modes fitted to synthesised FRFs, a picture, and the command line.
"""

import subprocess
import sys
import tempfile
from importlib import import_module
from pathlib import Path

import numpy as np

import acquisition
import ema

FREQUENCIES = np.array([31.0, 74.0, 118.0])
DAMPING = np.array([0.004, 0.006, 0.01])


def every_public_name() -> int:
    """Import all that the snapshot of public names lists."""
    listed = Path(__file__).parent / "architecture" / "public_names.txt"
    names = listed.read_text(encoding="utf-8").split()
    for name in names:
        package, _, public = name.rpartition(".")
        assert getattr(import_module(package), public) is not None, name
    return len(names)


def modes_come_back(folder: Path) -> None:
    """Three modes of four points, over a file, within 0.01 % and 1 %."""
    from ema.data import ModalModel, poles_from
    from ema.dof import Dof
    from ema.synthesis import frfs

    dofs = tuple(Dof(node, "+Z") for node in range(1, 5))
    shapes = np.sin(np.outer(np.arange(1, 5), np.arange(1, 4)) * np.pi / 5).astype(complex)
    poles = poles_from(FREQUENCIES, DAMPING)
    model = ModalModel(poles, shapes, dofs, shapes[:1] / (2j * poles.imag), dofs[:1], scaling="unit modal mass")
    clean = frfs(model, np.arange(10.0, 150.0, 0.25), "accelerance")
    noise = np.random.default_rng(1).standard_normal((2, *clean.values.shape))
    size = 1e-3 * np.abs(clean.values).mean()
    noisy = ema.FrfSet(
        clean.frequencies,
        clean.values + size * (noise[0] + 1j * noise[1]),
        clean.outputs,
        clean.inputs,
        "accelerance",
        "(m/s^2)/N",
    )
    ema.store.save(folder / "frfs.h5", noisy)
    held = ema.store.load(folder / "frfs.h5")
    fitted = ema.fit.modes(held, ema.fit.stabilise(held))
    np.testing.assert_allclose(fitted.natural_frequencies, FREQUENCIES, rtol=1e-4)
    np.testing.assert_allclose(fitted.damping_ratios, DAMPING, rtol=1e-2)
    ema.show.frf_overview(noisy).savefig(folder / "frfs.png")
    assert len(fitted.table()) == 3


def main() -> None:
    """Try it all."""
    names = every_public_name()
    from acquisition import units

    assert units.parse("mm").factor == 1e-3 and units.measure("1.02 kN", "force")[0] == 1020
    assert acquisition.formats()
    with tempfile.TemporaryDirectory() as folder:
        modes_come_back(Path(folder))
    done = subprocess.run([sys.executable, "-m", "ema", "--version"], capture_output=True, text=True, check=True)
    assert ema.__version__ in done.stdout, done.stdout
    print(f"{names} public names, units, a file, a fit, a picture and the command line work")


if __name__ == "__main__":
    main()
