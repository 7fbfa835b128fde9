"""The kernel that a run asks for is taken: else `make test-kernels` would test one kernel three
times."""

import os

import pytest
from conftest import ROOT
from kernels import LEFT_OUT, is_numerical, loaded_kernels


def test_every_module_that_uses_a_fit_is_numerical_unless_it_is_left_out_by_name():
    modules = {path.stem: path for path in (ROOT / "tests").glob("test_*.py")}
    of_fits = {name for name in modules if name.startswith(("test_bench_", "test_stats_"))}
    assert len(of_fits) >= 13
    assert {name for name in of_fits if not is_numerical(modules[name])} == set()
    assert LEFT_OUT.keys() <= modules.keys()


@pytest.mark.numerics
def test_the_kernel_that_was_asked_for_is_taken():
    asked, taken = os.environ.get("OPENBLAS_CORETYPE"), loaded_kernels()
    if asked is None or not taken:
        pytest.skip(f"no kernel is asked for; this machine takes {taken or 'none of OpenBLAS'}")
    assert {name.lower() for name in taken.values()} == {asked.lower()}
