"""Compiled kernels on disk: never those of other sources, nothing written at import, no failure where none can be kept."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import acquisition
import ema
from ema.fingerprint import compiled_modules, of_compiled

INNER = """
from ema.compiled import compiled

@compiled()
def number(x):
    return x + {value}
"""
OUTER = """
from ema.compiled import compiled
from ema.inner_kernels import number

@compiled()
def doubled(x):
    return 2.0 * number(x)
"""
CALL = """
from ema.outer_kernels import doubled
compiler, compiled = doubled._compiler.compile, []
doubled._compiler.compile = lambda *signature: compiled.append(signature) or compiler(*signature)
print(doubled(1.0), "compiled" if compiled else "kept")
"""
THREADS = """
from threading import Thread
from ema.outer_kernels import doubled
seen = []
threads = [Thread(target=lambda n=n: seen.append(doubled(float(n)) - 2 * n)) for n in range(2)]
[thread.start() for thread in threads], [thread.join() for thread in threads]
print(seen)
"""
SUMS = """
import hashlib, sys
import numpy as np
from ema.simulate.harmonic_kernels import contact_forces
rng, orders, found = np.random.default_rng(3), np.array([1, 3, 5]), hashlib.sha256()
angle = np.linspace(0.0, np.pi, 25)[:, None] * orders
for _ in range(2000):
    amplitudes = rng.normal(size=(1, 6)) * np.repeat(10.0 ** -np.arange(3), 2)
    cosine, sine = amplitudes[0, ::2], amplitudes[0, 1::2]
    rates = np.cos(angle) @ (orders * sine) - np.sin(angle) @ (orders * cosine)
    bends = -np.cos(angle) @ (orders**2 * cosine) - np.sin(angle) @ (orders**2 * sine)
    samples = np.array([rates, bends])[:, None]
    contact = np.ones(1), np.array([0.2]), np.zeros((1, 1), np.int64)
    springs = np.ones(1, np.int64), np.ones((1, 1)), np.ones((1, 1)), np.ones(1)
    for part in contact_forces(amplitudes, (orders, samples, 1, 1.0), contact, springs, None, None, True):
        found.update(part.tobytes())
print(found.hexdigest())
"""
EVERY_MODULE = """
import importlib, pathlib
root = pathlib.Path("ema")
for path in sorted(root.rglob("*.py")):
    name = ".".join(path.with_suffix("").parts)
    if "__main__" not in name:
        importlib.import_module(name.removesuffix(".__init__"))
"""


@pytest.fixture
def installation(tmp_path):
    """A copy of the package with a kernel that calls one of another file, in a folder of its own."""
    folder = tmp_path / "site"
    for package in (ema, acquisition):
        source = Path(package.__file__).parent
        shutil.copytree(source, folder / source.name, ignore=shutil.ignore_patterns("__pycache__"))
    (folder / "ema" / "inner_kernels.py").write_text(INNER.format(value="1.0"))
    (folder / "ema" / "outer_kernels.py").write_text(OUTER)
    return folder


def environment(folder, **more):
    """Of a process that imports the copy and keeps no bytecode, so that what is written are kernels alone."""
    own = {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    return {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"} | own | more


def run(folder, script, **more):
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, env=environment(folder, **more), cwd=folder
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout.strip()


def files(folder):
    return {path.relative_to(folder).as_posix(): path.stat().st_mtime_ns for path in folder.rglob("*")}


@pytest.mark.parametrize("own_folder", [False, True])
def test_a_change_in_a_file_compiles_the_kernels_of_other_files_that_call_it(installation, tmp_path, own_folder):
    more = {"NUMBA_CACHE_DIR": str(tmp_path / "kept")} if own_folder else {}
    assert run(installation, CALL, **more) == "4.0 compiled"
    assert run(installation, CALL, **more) == "4.0 kept"
    inner = installation / "ema" / "inner_kernels.py"
    before = inner.stat()
    inner.write_text(INNER.format(value="2.0"))
    # an upgrade may set the time and the size of the old file
    os.utime(inner, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert run(installation, CALL, **more) == "6.0 compiled"
    assert run(installation, CALL, **more) == "6.0 kept"


def test_who_compiles_a_kernel_has_the_numbers_of_who_reads_it(installation):
    """To the last bit: the compiler rounds sums in another order where a function is inlined than where it is not."""
    assert len({run(installation, SUMS) for _ in range(2)}) == 1


def test_kernels_of_an_older_source_take_no_further_room(installation):
    kept = installation / "ema" / "__pycache__"
    run(installation, CALL)
    before = sorted(path.name for path in kept.iterdir())
    (installation / "ema" / "inner_kernels.py").write_text(INNER.format(value="2.0"))
    run(installation, CALL)
    assert sorted(path.name for path in kept.iterdir()) == before


def test_importing_every_module_writes_and_deletes_nothing(installation):
    stale = installation / "ema" / "simulate" / "__pycache__" / "transient_kernels.advance-1.py311.nbi"
    stale.parent.mkdir()
    stale.write_text("a kernel of long ago")
    before = files(installation)
    run(installation, EVERY_MODULE)
    assert files(installation) == before


def test_an_installation_where_nothing_can_be_written_compiles_and_keeps_nothing(installation):
    """Neither beside the sources nor in the folder of the user: files stand where the folders should be."""
    for path in (installation / "ema").rglob("*_kernels.py"):
        (path.parent / "__pycache__").write_text("a file where the folder should be")
    barred = installation / "barred"
    barred.write_text("a file where the folder should be")
    more = {"HOME": str(barred), "XDG_CACHE_HOME": str(barred)}
    before = files(installation)
    assert run(installation, CALL, **more) == "4.0 compiled"
    assert files(installation) == before


def test_a_package_in_an_archive_compiles_and_keeps_nothing(installation, tmp_path):
    """Its sources are no files, so that nothing could tell which of them a compiled function belongs to."""
    archive = shutil.make_archive(str(tmp_path / "packed"), "zip", installation)
    shutil.rmtree(installation / "ema")
    shutil.rmtree(installation / "acquisition")
    kept = {"NUMBA_CACHE_DIR": str(tmp_path / "kept"), "PYTHONPATH": archive}
    for _ in range(2):
        assert run(installation, CALL, **kept) == "4.0 compiled"
    assert not (tmp_path / "kept").exists()


@pytest.mark.parametrize(
    "damage", [lambda whole: b"", lambda whole: whole[:-1], lambda whole: whole[:40] + b"?" + whole[41:]]
)
def test_a_damaged_kernel_is_compiled_again(installation, damage):
    run(installation, CALL)
    (path,) = (installation / "ema" / "__pycache__").glob("outer_kernels.doubled*")
    path.write_bytes(damage(path.read_bytes()))
    assert run(installation, CALL) == "4.0 compiled"
    assert run(installation, CALL) == "4.0 kept"


def test_a_full_disk_keeps_nothing_and_stops_nothing(installation):
    full = "import errno, pathlib\ndef full(*a): raise OSError(errno.ENOSPC, 'no space')\npathlib.Path.replace = full\n"
    before = files(installation)
    assert run(installation, full + CALL) == "4.0 compiled"
    left = files(installation)
    assert set(left) - set(before) == {"ema/__pycache__"}
    assert run(installation, CALL) == "4.0 compiled"


def test_four_processes_compile_different_signatures_at_once(installation):
    """Each keeps its own: numbers of one type never meet the code that was made for another."""
    script = "import sys\nfrom ema.outer_kernels import doubled\nprint(doubled(getattr(__import__('numpy'), sys.argv[1])(1)))"
    kinds = ("float64", "float32", "int64", "complex128")
    for _ in range(2):
        running = [
            subprocess.Popen(
                [sys.executable, "-c", script, kind],
                stdout=subprocess.PIPE,
                text=True,
                cwd=installation,
                env=environment(installation),
            )
            for kind in kinds
        ]
        assert [process.communicate()[0].strip() for process in running] == ["4.0", "4.0", "4.0", "(4+0j)"]
    kept = list((installation / "ema" / "__pycache__").glob("outer_kernels.doubled*.nbc"))
    assert len(kept) == len(kinds)


def test_two_threads_of_one_process_compile_at_once(installation):
    assert run(installation, THREADS) == "[2.0, 2.0]"


def test_the_fingerprint_is_that_of_the_texts(installation, root):
    package = installation / "ema"
    before = of_compiled(package)
    assert before == of_compiled(package) != of_compiled(root / "ema")
    inner = package / "inner_kernels.py"
    inner.write_text(INNER.format(value="2.0"))
    changed = of_compiled(package)
    assert changed != before
    inner.rename(package / "other_kernels.py")
    assert of_compiled(package) not in (before, changed)


def test_a_kernel_outside_the_fingerprint_is_refused_at_once(installation):
    (installation / "ema" / "elsewhere.py").write_text(INNER.format(value="1.0"))
    script = "try:\n    import ema.elsewhere\nexcept ImportError as error:\n    print(error)"
    assert "_kernels.py" in run(installation, script)


def test_every_compiled_module_is_marked_once(root):
    """The fingerprint, the checker of shapes and mypy agree on what is compiled."""
    names = sorted(
        ".".join(path.relative_to(root).with_suffix("").parts)
        for path in compiled_modules(root / "ema")
        if path.name != "compiled.py"
    )
    settings = (root / "pyproject.toml").read_text(encoding="utf-8")
    listed = [line.strip(' ",') for line in settings.splitlines() if line.strip().endswith('_kernels",')]
    assert listed == names
    for path in (root / "ema").rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        assert ("numba" in text and "njit" in text) <= (path.name == "compiled.py"), path
