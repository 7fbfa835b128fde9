# SPDX-License-Identifier: Apache-2.0
"""Kernels of OpenBLAS differ by processor in rounding: an exact fit leaves 1e-16 with one and may
leave 0 with another.

`make test-kernels` runs the tests with the marker `numerics` with those of two other processors,
which run on any recent x86. `is_numerical` says which modules have it: every module that uses a
fit, unless `LEFT_OUT` names it.
"""

import ctypes
import re
from pathlib import Path

import numpy as np
import scipy.linalg

COMPUTING = "bench|model|signals|spectral|stats|walking"
USES_A_FIT = re.compile(
    rf"^\s*(?:from|import) osl_analysis\.(?:{COMPUTING})\b(?!\.settings)", re.MULTILINE
)
"""An import from a package that computes, other than of its settings."""
LEFT_OUT = {
    "test_configuration": "of a model it reads the settings",
    "test_csv_log": "of the signals it asks for devices",
    "test_journeys": "campaigns from file to page, whose fits other modules test",
    "test_quality": "counts and extremes, which no kernel computes",
    "test_refusal": "messages",
    "test_sheet": "of a model it reads names",
    "test_bench_trial": "a simulator, which fits nothing",
    "test_laboratory": "a simulator, which fits nothing",
}
"""Modules that import from such a package and compare no estimate; each with its reason."""


def is_numerical(module: Path) -> bool:
    """Whether a module of tests compares results of fits."""
    return module.stem not in LEFT_OUT and bool(USES_A_FIT.search(module.read_text("utf-8")))


def loaded_kernels() -> dict[str, str]:
    """The kernel that each OpenBLAS in this process has taken, by library; empty where another
    library is used."""
    # both libraries are loaded now
    product = scipy.linalg.blas.dgemm(1.0, np.eye(2), np.eye(2)) @ np.eye(2)
    assert product.shape == (2, 2)
    maps = Path("/proc/self/maps")
    found = re.findall(r"/.*openblas\S*", maps.read_text()) if maps.is_file() else []
    return {Path(path).name: kernel for path in dict.fromkeys(found) if (kernel := kernel_of(path))}


def kernel_of(path: str) -> str | None:
    """What one library says that it has taken; None if it does not say."""
    library = ctypes.CDLL(path)
    for name in (
        "scipy_openblas_get_corename64_",
        "scipy_openblas_get_corename",
        "openblas_get_corename",
    ):
        if hasattr(library, name):
            asked = getattr(library, name)
            asked.restype = ctypes.c_char_p
            return str(asked().decode())
    return None


if __name__ == "__main__":
    print(
        "kernels:",
        loaded_kernels() or "not OpenBLAS, or it does not say; OPENBLAS_CORETYPE does nothing here",
    )
