"""What is compiled, and how often."""

import gc
import os
import subprocess
import sys

import numpy as np
import pytest
from numba.core.caching import FunctionCache

from pourcast.engine.compile import Kernel, allocating_kernel, kernel


@kernel
def twice(values, k):
    return 2.0 * values[k]


@kernel
def double(values):
    for k in range(len(values)):
        values[k] = twice(values, k)


@allocating_kernel
def doubled(values):
    copy = np.empty_like(values)
    for k in range(len(values)):
        copy[k] = twice(values, k)
    return copy


needs_compiler = pytest.mark.skipif(
    not isinstance(twice, Kernel), reason="nothing is compiled with NUMBA_DISABLE_JIT=1"
)


@needs_compiler
def test_a_kernel_that_kernels_call_has_machine_code_once_python_calls_it():
    values = np.arange(3.0)
    double(values)
    np.testing.assert_array_equal(values, [0.0, 2.0, 4.0])
    np.testing.assert_array_equal(doubled(values), [0.0, 4.0, 8.0])
    assert len(double.for_python.signatures) == len(doubled.for_python.signatures) == 1
    before = len(twice.for_python.signatures)
    assert twice(values, k=2) == 8.0
    assert (before, len(twice.for_python.signatures)) == (0, 1)


@needs_compiler
def test_garbage_is_searched_for_again_after_compiling():
    double(np.ones(2, np.float32))
    assert gc.isenabled()


_CALLED = """
import numpy as np
from pourcast.engine.simd import LANES
from pourcast.engine.diagnostics import _join_lanes, empty_diagnostics
found = empty_diagnostics()
found.head[0] = 3.0
_join_lanes(found)
print(found.head.tolist() == [3.0] * LANES)
"""


def called_in_a_process(folder):
    run = subprocess.run(
        [sys.executable, "-c", _CALLED], env={**os.environ, "NUMBA_CACHE_DIR": str(folder)},
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert (run.returncode, run.stdout) == (0, "True\n"), run.stderr
    return sorted(folder.rglob("*.nb?"))


@needs_compiler
def test_what_is_damaged_of_a_kept_kernel_is_compiled_anew(tmp_path):
    kept = {path: path.read_bytes() for path in called_in_a_process(tmp_path)}
    assert {path.suffix for path in kept} == {".nbi", ".nbc"}
    for suffix in (".nbi", ".nbc"):
        for fault in ("empty", "cut", "changed"):
            for path, content in kept.items():
                middle = len(content) // 2
                damaged = {
                    "empty": b"",
                    "cut": content[:middle],
                    "changed": content[:middle] + bytes(200) + content[middle + 200 :],
                }[fault]
                path.write_bytes(damaged if path.suffix == suffix else content)
            called_in_a_process(tmp_path)
            written = [path.read_bytes() for path in kept]
            assert [len(content) > 200 for content in written] == [True] * len(kept)


@needs_compiler
def test_a_kernel_that_cannot_be_kept_runs(tmp_path, monkeypatch):
    def full(*_arguments):
        raise OSError("no space left")

    monkeypatch.setattr(FunctionCache, "save_overload", full)

    @kernel
    def first(values):
        return values[0]

    assert first(np.array([4.0, 5.0])) == 4.0
