"""Compiled kernels are dropped when any of their sources has changed."""

import os

from ema.simulate.kernel_cache import drop_stale


def test_compiled_kernels_go_when_a_source_changes_and_only_then(tmp_path):
    kept = tmp_path / "__pycache__"
    kept.mkdir()
    source = tmp_path / "inner_kernels.py"
    source.write_text("a = 1")
    (tmp_path / "outer_kernels.py").write_text("b = 1")

    def compiled():
        (kept / "outer_kernels.f-1.py311.nbi").write_text("")
        (kept / "outer_kernels.f-1.py311.1.nbc").write_text("")
        (kept / "outer_kernels.cpython-311.pyc").write_text("")

    compiled()
    assert drop_stale(tmp_path)
    assert sorted(path.suffix for path in kept.iterdir()) == [".pyc", ".stamp"]
    compiled()
    assert not drop_stale(tmp_path)
    assert len(list(kept.glob("*.nb?"))) == 2
    source.write_text("a = 2")
    os.utime(source, ns=(1, 1))
    assert drop_stale(tmp_path)
    assert not list(kept.glob("*.nb?"))


def test_a_folder_that_cannot_be_written_is_left_alone(tmp_path):
    (tmp_path / "__pycache__").write_text("a file where the folder should be")
    (tmp_path / "inner_kernels.py").write_text("a = 1")
    assert not drop_stale(tmp_path)
