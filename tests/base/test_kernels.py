# SPDX-License-Identifier: Apache-2.0
"""The kernel that a run asks for is taken: else `make test-kernels` would test one kernel three
times."""

import os

import pytest
from kernels import loaded_kernels


@pytest.mark.numerics
def test_the_kernel_that_was_asked_for_is_taken():
    asked = os.environ.get("OPENBLAS_CORETYPE")
    taken = loaded_kernels()
    if asked is None or not taken:
        pytest.skip(f"no kernel is asked for; this machine takes {taken or 'none of OpenBLAS'}")
    assert {name.lower() for name in taken.values()} == {asked.lower()}
