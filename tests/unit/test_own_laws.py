"""Laws of a user's own between processes: what they are known by, what is stored of them, what is kept compiled."""

import pickle
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from ema import store
from ema.data import FrictionLaw
from ema.errors import InputError
from ema.own_functions import LawName, of_function
from ema.simulate import Section, double_beam, loop, register_law, snapback

TIP = "beam 2:2:+Z"
LAW = '''
from ema.simulate import register_law
from {helpers} import softer


def clip(force, du, k, limit, p0, p1, p2, p3):
    """Elastic up to a share of the slip force."""
    return min(max(force + k * du, -softer(limit)), softer(limit))


Clip = register_law("clip of a file", clip)
'''
HELPER = """
from numba import njit

SHARE = 0.5


@njit
def softer(limit):
    return SHARE * limit
"""


def made(text, name="law", **values):
    """A function from a text that is in no file."""
    scope = dict(values)
    exec(textwrap.dedent(text), scope)
    return scope[name]


def written(folder, name, text):
    """A function of a file of its own, imported."""
    (folder / f"{name}.py").write_text(textwrap.dedent(text), encoding="utf-8")
    sys.path.insert(0, str(folder))
    try:
        return __import__(name).law
    finally:
        sys.path.remove(str(folder))
        sys.modules.pop(name)


PLAIN = """
    FLOOR = 0.25

    def law(force, du, k, limit, p0, p1, p2, p3):
        top = (1.0 - FLOOR) * limit
        return min(max(force + k * du, -top), top)
    """
SAME = '''
    FLOOR = 0.25  # of the slip force

    def law(force: float, du, k, limit, p0, p1, p2, p3) -> float:
        """A clip."""
        top = (
            (1.0 - FLOOR) * limit
        )

        # down to here
        return min(max(force + k * du, -top), top)
    '''


def test_a_fingerprint_is_that_of_what_a_function_computes(tmp_path):
    """The second number was written down: it is that of every release of Python."""
    plain = of_function(written(tmp_path, "plain_law", PLAIN))
    assert of_function(written(tmp_path, "same_law", SAME)) == plain
    assert plain == "source:0198bcc18dc584e1b73de1074e593cd2"
    changes = (("0.25", "0.5"), ("k * du", "k * du * 1.0"), ("-top), top", "-top), limit"), ("min(", "max("))
    others = [
        of_function(written(tmp_path, f"other_law_{n}", PLAIN.replace(*change))) for n, change in enumerate(changes)
    ]
    assert len({plain, *others}) == 1 + len(changes)
    assert all(text.startswith("source:") for text in others)


def test_closures_and_helpers_are_in_a_fingerprint(tmp_path):
    def scaled(share):
        def law(force, du, k, limit, p0, p1, p2, p3):
            return min(max(force + k * du, -share * limit), share * limit)

        return law

    assert of_function(scaled(0.5)) == of_function(scaled(0.5)) != of_function(scaled(0.6))
    text = """
    def top(limit):
        return {share} * limit

    def law(force, du, k, limit, p0, p1, p2, p3):
        return min(max(force + k * du, -top(limit)), top(limit))
    """
    a, b, c = (written(tmp_path, f"with_helper_{n}", text.format(share=share)) for n, share in enumerate((0.5, 0.5, 1)))
    assert of_function(a) == of_function(b) != of_function(c)


def test_a_file_that_was_edited_since_is_not_taken_for_what_was_executed(tmp_path):
    function = written(tmp_path, "edited_law", PLAIN)
    before = of_function(function)
    (tmp_path / "edited_law.py").write_text(textwrap.dedent(PLAIN).replace("force + k", "force + 0.5 * k"))
    assert before.startswith("source:") and of_function(function).startswith("bytecode ")


def test_a_function_without_source_is_known_by_its_bytecode():
    assert of_function(made(PLAIN)).startswith(f"bytecode {sys.version_info.major}.{sys.version_info.minor}:")
    assert of_function(made(PLAIN)) == of_function(made(PLAIN)) != of_function(made(PLAIN.replace("0.25", "0.5")))


def clip(force, du, k, limit, p0, p1, p2, p3):
    return min(max(force + k * du, -limit), limit)


def half(force, du, k, limit, p0, p1, p2, p3):
    return min(max(force + k * du, -0.5 * limit), 0.5 * limit)


def stored(folder, name, function):
    """A model with a law of one's own, saved and loaded."""
    model = double_beam(register_law(name, function)(0.3, 1e9), 1000.0, Section(0.5, 0.04, 0.005, elements=2))
    store.save(folder / "model.h5", model)
    return model, store.load(folder / "model.h5")


def run(model):
    return snapback(model, 20.0, TIP, 0.002).displacements


def test_a_stored_model_runs_with_the_function_it_was_saved_with(tmp_path):
    model, loaded = stored(tmp_path, "clip of the store", clip)
    law = loaded.joints[0].law
    assert law == model.joints[0].law and law.name.fingerprint == of_function(clip)
    np.testing.assert_array_equal(run(loaded), run(model))


def test_a_stored_model_whose_law_has_changed_is_refused_until_the_law_is_made_anew(tmp_path):
    _, loaded = stored(tmp_path, "changed since", clip)
    make = register_law("changed since", half)
    with pytest.raises(InputError, match=r"^law changed since: the function registered under this name is not the one"):
        run(loaded)
    with pytest.raises(InputError, match=r"register the former function, or take the present one: model.with_law"):
        loop(loaded.joints[0].law, 100.0, 1e-4)
    assert np.isfinite(run(loaded.with_law(make(0.3, 1e9)))).all()
    register_law("changed since", clip)
    assert np.isfinite(run(loaded)).all()


def test_a_change_that_cannot_be_told_is_said(tmp_path):
    _, loaded = stored(tmp_path, "without source", made(PLAIN))
    register_law("without source", written(tmp_path, "with_source", PLAIN))
    with pytest.raises(
        InputError, match=r"is the one that the law was made with cannot be told; got a fingerprint of s"
    ):
        run(loaded)


def test_a_stored_model_without_its_law_is_refused_in_a_sentence(tmp_path):
    from ema.contact.laws import REGISTERED

    _, loaded = stored(tmp_path, "absent", clip)
    del REGISTERED["absent"]
    with pytest.raises(InputError) as refused:
        run(loaded)
    assert str(refused.value) == (
        "law absent: a law of one's own that this process does not know; register it in every process that runs it, "
        f"its function is in {__name__}"
    )


def test_a_file_of_an_earlier_release_has_a_name_alone_and_runs(tmp_path):
    model, _ = stored(tmp_path, "of earlier files", clip)
    earlier = model.with_law(FrictionLaw("of earlier files", 0.3, 1e9))
    store.save(tmp_path / "earlier.h5", earlier)
    loaded = store.load(tmp_path / "earlier.h5")
    assert not isinstance(loaded.joints[0].law.name, LawName)
    np.testing.assert_array_equal(run(loaded), run(model))


# processes --------------------------------------------------------------------------------------------------------------

SAVE = """
import pickle, sys
from laws_of_mine import Clip
from ema import store
from ema.simulate import loop
law = Clip(1.0, 1e6)
pickle.dump(law, open("law.pickle", "wb"))
print(loop(law, 100.0, 1e-3).forces.max())
"""
NO_COMPILER = """
from numba.core import dispatcher
def never(*_):
    raise AssertionError("compiled")
dispatcher._FunctionCompiler.compile = never
"""
RECEIVE = """
import pickle, sys
from ema.errors import InputError
from ema.simulate import loop
law = pickle.load(open("law.pickle", "rb"))
try:
    print(loop(law, 100.0, 1e-3).forces.max())
except InputError as error:
    print(error)
"""


def python(folder, text):
    done = subprocess.run(
        [sys.executable, "-c", text], cwd=folder, capture_output=True, text=True, check=False, timeout=300
    )
    assert not done.returncode, done.stderr[-2000:]
    return done.stdout.strip()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "laws_of_mine.py").write_text(LAW.format(helpers="helpers_of_mine"), encoding="utf-8")
    (tmp_path / "helpers_of_mine.py").write_text(HELPER, encoding="utf-8")
    return tmp_path


def test_a_law_of_a_file_is_compiled_once_until_it_or_a_helper_changes(folder):
    """The force ends at the share of the slip force that the helper states."""
    assert float(python(folder, SAVE)) == 50.0
    assert list((folder / "__pycache__").glob("laws_of_mine.clip-*.nbc"))
    assert float(python(folder, NO_COMPILER + SAVE)) == 50.0
    (folder / "helpers_of_mine.py").write_text(HELPER.replace("0.5", "0.125"), encoding="utf-8")
    assert float(python(folder, SAVE)) == 12.5


def test_a_law_made_by_exec_under_the_name_of_a_file_is_compiled_by_every_process(folder):
    text = """
import pathlib
from ema.simulate import loop, register_law
text = "def clip(force, du, k, limit, p0, p1, p2, p3):\\n    return min(max(force + k * du, -limit), limit)\\n"
pathlib.Path("page.md").write_text(text)
space = {}
exec(compile(text, "page.md", "exec"), space)
print(loop(register_law("clip of a page", space["clip"])(1.0, 1e6), 100.0, 1e-3).forces.max())
"""
    assert [float(python(folder, text)) for _ in range(2)] == [100.0, 100.0]
    assert not list((folder / "__pycache__").glob("page*.nbc"))


def test_another_process_imports_the_law_or_says_what_it_lacks(folder, tmp_path_factory):
    python(folder, SAVE)
    assert float(python(folder, RECEIVE)) == 50.0
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    (elsewhere / "law.pickle").write_bytes((folder / "law.pickle").read_bytes())
    said = python(elsewhere, RECEIVE)
    assert said.startswith("law clip of a file: a law of one's own that this process does not know; register it")
    (folder / "helpers_of_mine.py").write_text(HELPER.replace("0.5", "0.125"), encoding="utf-8")
    assert "is not the one that the law was made with" in python(folder, RECEIVE)


def test_a_worker_of_dask_without_the_law_says_so(monkeypatch):
    distributed = pytest.importorskip("distributed")
    law = register_law("of this process", made(PLAIN))(1.0, 1e6)
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
        pytest.raises(InputError, match="law of this process: a law of one's own that this process does not know"),
    ):
        client.submit(loop, law, 100.0, 1e-3).result()


def test_a_name_is_pickled_with_its_fingerprint():
    law = register_law("pickled", clip)(0.3, 1e6)
    again = pickle.loads(pickle.dumps(law))
    assert again == law and again.name.fingerprint == of_function(clip) and again.name.module == __name__
