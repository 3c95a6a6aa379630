"""What is compiled, and how often."""

import gc

import numpy as np
import pytest

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
